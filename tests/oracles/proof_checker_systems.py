"""Checks modes counted system by system, and maps of two inputs, without spherekit.

In e^(i angle) = a / b a rotation times a b is a polynomial in a and b, which are the
points (z, 1) and (1, w): so an angle at infinity is a solution like others.
"""

from itertools import combinations, product

import numpy as np
from flint import acb, acb_poly, arb, ctx
from oracles.proof_checker import (
    Half,
    System,
    about,
    ball,
    inverse_near,
    largest,
    mid,
    need,
    permanent_of,
    square,
    wrapped,
)

DEEPEST = 7


def plain(inverse, z):
    """The pair (a, b) of a point."""
    return (acb(1), z) if inverse else (z, acb(1))


def check_parts(system, parts):
    """The degrees of each system's equations: all are in one, with what is known before."""
    table = dict(zip((step["link"] for step in system.onto), system.degrees(), strict=True))
    known, left, bounds = set(), dict(table), []
    for part in parts:
        own = [left.pop(link) for link in part["equations"]]
        known |= set(part["unknowns"])
        used = {n for row in own for n, d in zip(system.unknowns, row, strict=True) if d}
        need(used <= known, "a system with unknowns of a later one")
        columns = [system.unknowns.index(name) for name in part["unknowns"]]
        need(len(columns) == len(own), "a system that is not square")
        bounds.append(permanent_of([[row[c] for c in columns] for row in own]))
    need(not left and known == set(system.unknowns), "equations are missing")
    return bounds, table


def check_systems(system, certificate, driven):
    """Show that there are as many real modes as roots are given."""
    ctx.prec = 80
    place = [driven[name] for name in system.inputs]
    found = Counting(system, certificate["systems"]).at(place, [0.0] * len(place))
    need(found == certificate["modes"], "another number of modes by systems")


def roots_of(system, part, driven):
    """Approximations of all solutions of one equation in one unknown."""
    ((link,), (name,)) = part["equations"], part["unknowns"]
    half = Half(system, [link], [name], [False])
    size = part["degree"] + 1
    turns = [acb(0, 2 * arb.pi() * k / size).exp() for k in range(size)]
    middle = {pair: arb(angle.mid()) for pair, angle in driven.items()}
    values = [half.values([z], middle)[0][0] for z in turns]
    made = [
        sum(v * z ** (size - k) for v, z in zip(values, turns, strict=True)) / size
        for k in range(size)
    ]
    found = acb_poly([acb(each.mid()) for each in made]).roots(tol=1e-15)
    points = []
    for root in found:
        z = acb(root.mid())
        big = abs(complex(float(z.real), float(z.imag))) > 1
        points.append(([big], [acb((1 / z).mid()) if big else z]))
    return points


STEP = 0.05
"""How far (rad) given angles go at once where solutions are followed."""


def followed(system, part, driven):
    """Approximations of all solutions of a system, followed from the nearest given."""
    need(part["solved"], "a system without solutions to start from")
    middle = {pair: float(angle.mid()) for pair, angle in driven.items()}

    def gaps(each):
        near = {pair: each["given"][pair] for pair in part["used"] if pair in each["given"]}
        return {pair: wrapped(middle[pair] - angle) for pair, angle in near.items()}

    start = min(part["solved"], key=lambda each: max(map(abs, gaps(each).values())))
    apart = gaps(start)
    steps = 1 + int(max(map(abs, apart.values())) / STEP)
    points = []
    for solution in start["solutions"]:
        inverse, z = list(solution["inverse"]), [acb(*each) for each in solution["z"]]
        for step in range(1, steps + 1):
            place = {
                pair: arb(angle - apart.get(pair, 0.0) * (1 - step / steps))
                for pair, angle in middle.items()
            }
            for column, each in enumerate(z):
                if abs(each) > 2:
                    inverse[column], z[column] = not inverse[column], (1 / each).mid()
            half = Half(system, part["equations"], part["unknowns"], inverse)
            for _ in range(4):
                value, slope = half.values(z, place)
                z = list(mid(np.array(z) - inverse_near(slope) @ mid(value)))
        points.append((inverse, z))
    return points


class Counting:
    """The number of modes over boxes of the inputs, system by system."""

    def __init__(self, system, parts):
        self.system, self.parts = system, parts
        bounds, table = check_parts(system, parts)
        for part, bound in zip(parts, bounds, strict=True):
            part["degree"] = bound
            rows_of = [table[link] for link in part["equations"]]
            columns = zip(system.unknowns, *rows_of, strict=True)
            part["used"] = {name for name, *row in columns if any(row)} | set(system.inputs)

    def at(self, place, half):
        """The number of modes if it is proven to be the same in a box, else None.

        Every angle is a number, its rates by the inputs, and how much more it varies.
        """
        count = len(place)
        names = self.system.inputs
        path = {
            name: (arb(middle), [int(k == d) for k in range(count)], arb(0))
            for d, (name, middle) in enumerate(zip(names, place, strict=True))
        }
        paths = [path]
        try:
            for part in self.parts:
                paths = [
                    {**path, **dict(zip(part["unknowns"], angles, strict=True))}
                    for path in paths
                    for angles in self._solved(part, path, half)
                ]
        except (NotShown, ZeroDivisionError, ValueError):
            return None
        return len(paths)

    def _solved(self, part, path, half):
        """The angles of all real solutions, where there are as many as there can be."""
        alone = len(part["unknowns"]) == 1
        middle = {name: angle for name, (angle, _, _) in path.items()}
        points = (roots_of if alone else followed)(self.system, part, middle)
        if len(points) != part["degree"]:
            raise NotShown
        real, balls = [], []
        for inverse, centre in points:
            axis = Axis(self.system, part, path, half, inverse, centre)
            within = axis.ball()
            balls.append([plain(i, z) for i, z in zip(inverse, within, strict=True)])
            if all(abs(z).contains(1) for z in within):
                axis.need_real()
                real.append(axis.angles())
        for one, other in combinations(balls, 2):
            pairs = zip(one, other, strict=True)
            if all((a * d - b * c).contains(0) for (a, b), (c, d) in pairs):
                raise NotShown
        return real


class Axis:
    """One solution over a box of inputs: z + Z d + w, with d from the box's centre.

    Krawczyk's operator is used about z + Z d for all d at once; w is what it finds.
    """

    def __init__(self, system, part, path, half, inverse, centre):
        self.inverse, self.centre, moving = inverse, np.array(centre), list(path)
        self.half = Half(system, part["equations"], part["unknowns"], inverse, moving)
        self.steps, count = about(half), len(centre)
        self.one = ball(np.eye(count))
        rates = ball([path[name][1] for name in moving])
        more = about([path[name][2] for name in moving])
        middle = {name: path[name][0] for name in moving}
        turned = rates @ self.steps + more
        self.given = {n: middle[n] + t for n, t in zip(moving, turned, strict=True)}
        value, slope = self.half.values(centre, middle)
        self.pull = inverse_near(slope[:, :count])
        self.rates = mid(-self.pull @ (slope[:, count:] @ rates))
        self.along = self.centre + self.rates @ self.steps
        _, slope = self.half.values(self.along, self.given)
        inner, outer = slope[:, :count], slope[:, count:]
        change = (inner @ self.rates + outer @ rates) @ self.steps
        self.start = -self.pull @ (value + change + outer @ more)
        self.radius = 1.5 * largest(self.start) + arb(1e-14)
        self.rest = self.image(self.radius)

    def image(self, radius):
        """What the operator makes of all w of a radius, within that."""
        around = np.full(len(self.centre), square(radius))
        _, slope = self.half.values(self.along + around, self.given)
        inner = slope[:, : len(self.centre)]
        moved = self.start + (self.one - self.pull @ inner) @ around
        if not largest(moved) < radius:
            raise NotShown
        return moved

    def ball(self):
        return self.along + self.rest

    def parts(self):
        """Of each angle z, Z / z, w / z and (Z d + w) / z."""
        for row, (z, w) in enumerate(zip(self.centre, self.rest, strict=True)):
            bent = self.rates[row] / z
            yield z, bent, w / z, bent @ self.steps + w / z

    def need_real(self):
        """Show that the mirror image 1 / conj z of the solution is that solution."""
        wide = 2 * self.radius
        self.image(wide)
        for z, bent, rest, moved in self.parts():
            size = 1 / (z * z.conjugate())
            back = moved.conjugate()
            mirrored = np.array([k.conjugate() for k in bent])
            first = (size * mirrored + bent) @ self.steps
            far = size * (back * back / (1 + back) - rest.conjugate())
            if not largest([z * (size - 1 - first + far)]) < wide:
                raise NotShown

    def angles(self):
        """The angles of a real solution, their rates, and how much more they vary."""
        made = []
        for inverse, (z, bent, rest, moved) in zip(self.inverse, self.parts(), strict=True):
            sense = -1 if inverse else 1
            angle, size = sense * z.log().imag, arb(abs(moved).upper())
            if not size < 0.5:
                raise NotShown
            rates = [arb((sense * k.imag).mid()) for k in bent]
            more = abs(rest) + size**2 / (2 * (1 - size)) + arb(angle.rad()) + arb(1e-20)
            made.append((arb(angle.mid()), rates, arb(more.upper())))
        return made


class NotShown(Exception):
    """What is tried is not proven over a box: it may be over its parts."""


def check_map(certificate):
    """Show what is said of each box of two inputs, and that they fill their ranges."""
    ctx.prec = 80
    system = System(certificate)
    need(system.follower is None, "maps with wheels are not checked")
    names = list(certificate["inputs"])
    ends = [[system.sizes.angle(e) for e in certificate["inputs"][n]] for n in names]
    boxes = certificate["boxes"]
    centres, halves = (
        np.array([box[k] for box in boxes]) for k in ("centre_rad", "half_rad")
    )
    apart = np.abs(centres[:, None] - centres) > halves[:, None] + halves - 1e-9
    same = np.eye(len(boxes), dtype=bool)
    need(np.all(np.any(apart, axis=2) | same), "two boxes overlap")
    low, high = np.array(ends).T
    need(np.all(halves > 0), "an empty box")
    need(np.all(ball(centres) - ball(halves) > low - 1e-9), "a box outside")
    need(np.all(ball(centres) + ball(halves) < high + 1e-9), "a box outside")
    parts = 2 * halves / mid(high - low).astype(float)
    areas = {}
    for box, area in zip(boxes, np.prod(parts, axis=1), strict=True):
        areas[box["is"]] = areas.get(box["is"], 0.0) + area
    need(abs(sum(areas.values()) - 1) < 1e-6, "boxes do not fill the ranges")
    for words, share in certificate["shares"].items():
        need(abs(areas.get(words, 0.0) - share) < 1e-6, "another share")
    counting = Counting(system, certificate["systems"])
    for box in boxes:
        place = ball(box["centre_rad"])
        if box["is"] == "regular":
            check_regular(counting, place, box["half_rad"], box["modes"], 0)
        elif box["is"] == "contains type II":
            check_contains(counting, box)
        else:
            need(box["is"] == "undecided", "a box of no kind")


def check_regular(counting, place, half, modes, depth):
    found = counting.at(place, half)
    if found is not None:
        need(found == modes, "another number of modes in a box")
        return
    need(depth < DEEPEST, "a box that is not shown to be regular")
    half = np.array(half) / 2
    for signs in product((-1, 1), repeat=2):
        check_regular(counting, place + ball(signs * half), half, modes, depth + 1)


def check_contains(counting, box):
    seen = set()
    centre, half = np.array(box["centre_rad"]), np.array(box["half_rad"])
    for steps in (2, 4, 16):
        for grid in product(np.linspace(-0.999, 0.999, steps + 1), repeat=2):
            seen.add(counting.at(ball(centre + half * grid), [0.0, 0.0]))
            if len(seen - {None}) > 1:
                return
    need(False, "a box that is not shown to have a singular configuration")
