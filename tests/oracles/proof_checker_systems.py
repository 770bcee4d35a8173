"""Checks modes counted system by system, and maps of two inputs, without spherekit.

With e^(i angle) = a / b, a rotation times a b is a polynomial in a and b. A point is (z,
1), or (1, w) with the inverse w, so an angle at infinity is a solution like any other.

A system is a part of the equations with its own unknowns, given the angles of earlier
systems. In certificates it is a dictionary ("part") with the links of its equations, its
unknowns, and solutions at some angles ("solved") to start from.
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
    """Check that the systems contain every equation once, and only angles known by then.

    Returns
    -------
    bounds
        Largest number of solutions of each system, the permanent of its degrees.
    table
        Degrees of each equation in all unknowns, by link.
    """
    links = [step["link"] for step in system.onto]
    table = dict(zip(links, system.degrees(), strict=True))
    remaining = dict(table)
    solved_unknowns = set()
    bounds = []
    for part in parts:
        rows = [remaining.pop(link) for link in part["equations"]]
        solved_unknowns |= set(part["unknowns"])
        used = set()
        for row in rows:
            used |= {x for x, degree in zip(system.unknowns, row, strict=True) if degree}
        need(used <= solved_unknowns, "a system with unknowns of a later one")
        columns = [system.unknowns.index(name) for name in part["unknowns"]]
        need(len(columns) == len(rows), "a system that is not square")
        bounds.append(permanent_of([[row[c] for c in columns] for row in rows]))
    is_everything = not remaining and solved_unknowns == set(system.unknowns)
    need(is_everything, "equations are missing")
    return bounds, table


def check_systems(system, certificate, driven):
    """Show that there are as many real modes as roots are given."""
    ctx.prec = 80
    place = [driven[name] for name in system.inputs]
    found = Counting(system, certificate["systems"]).at(place, [0.0] * len(place))
    need(found == certificate["modes"], "another number of modes by systems")


def roots_of(system, part, driven):
    """Return approximations of all solutions of one equation in one unknown.

    The equation is a polynomial in e^(i angle). Its coefficients follow from its values at
    roots of unity (a discrete Fourier transform).

    Returns
    -------
    list of (inverse, [z])
        `inverse` is [True] if z is the inverse of e^(i angle), so that |z| is at most 1.
    """
    (link,) = part["equations"]
    (name,) = part["unknowns"]
    half = Half(system, [link], [name], [False])
    count = part["degree"] + 1
    nodes = [acb(0, 2 * arb.pi() * k / count).exp() for k in range(count)]
    middle = {pair: arb(angle.mid()) for pair, angle in driven.items()}
    values = [half.values([z], middle)[0][0] for z in nodes]
    coefficients = []
    for k in range(count):
        terms = [v * z ** (count - k) for v, z in zip(values, nodes, strict=True)]
        coefficients.append(sum(terms) / count)
    polynomial = acb_poly([acb(x.mid()) for x in coefficients])
    points = []
    for root in polynomial.roots(tol=1e-15):
        z = acb(root.mid())
        is_large = abs(complex(float(z.real), float(z.imag))) > 1
        points.append(([is_large], [acb((1 / z).mid()) if is_large else z]))
    return points


STEP = 0.05
"""How far (rad) given angles go at once where solutions are followed."""


def followed(system, part, driven):
    """Return approximations of all solutions of a system, as `roots_of`.

    They are followed by Newton's method in small steps from the stated solutions whose
    given angles are nearest.
    """
    need(part["solved"], "a system without solutions to start from")
    middle = {pair: float(angle.mid()) for pair, angle in driven.items()}

    def gaps_to(stated):
        given = stated["given"]
        pairs = [pair for pair in part["used"] if pair in given]
        return {pair: wrapped(middle[pair] - given[pair]) for pair in pairs}

    start = min(part["solved"], key=lambda x: max(map(abs, gaps_to(x).values())))
    gaps = gaps_to(start)
    step_count = 1 + int(max(map(abs, gaps.values())) / STEP)
    points = []
    for solution in start["solutions"]:
        inverse = list(solution["inverse"])
        z = [acb(*parts) for parts in solution["z"]]
        for step in range(1, step_count + 1):
            remaining = 1 - step / step_count
            place = {
                pair: arb(angle - gaps.get(pair, 0.0) * remaining)
                for pair, angle in middle.items()
            }
            for column, value in enumerate(z):
                if abs(value) > 2:
                    inverse[column] = not inverse[column]
                    z[column] = (1 / value).mid()
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
        """Return the number of modes in a box if it is proven to be constant, else None.

        Systems are solved one after another. Each solution of a system starts one path for
        the systems after it. An angle is a triple: its value at the centre of the box, its
        rates by the inputs, and a bound of how much more it varies in the box.

        Parameters
        ----------
        place, half
            Centre and half widths (inputs,) of the box, rad.
        """
        count = len(place)
        input_angles = {}
        for k, (name, middle) in enumerate(zip(self.system.inputs, place, strict=True)):
            rates = [int(k == j) for j in range(count)]
            input_angles[name] = (arb(middle), rates, arb(0))
        paths = [input_angles]
        try:
            for part in self.parts:
                next_paths = []
                for path in paths:
                    for angles in self._solved(part, path, half):
                        unknowns = dict(zip(part["unknowns"], angles, strict=True))
                        next_paths.append({**path, **unknowns})
                paths = next_paths
        except (NotShown, ZeroDivisionError, ValueError):
            return None
        return len(paths)

    def _solved(self, part, path, half):
        """Return the angles of all real solutions of a system over a box.

        All complex solutions are enclosed and shown to be different. `NotShown` is raised
        unless there are as many as the bound of the system, so none can be missing.
        """
        has_one_unknown = len(part["unknowns"]) == 1
        middle = {name: angle for name, (angle, _, _) in path.items()}
        find_points = roots_of if has_one_unknown else followed
        points = find_points(self.system, part, middle)
        if len(points) != part["degree"]:
            raise NotShown
        real = []
        balls = []
        for inverse, centre in points:
            axis = Axis(self.system, part, path, half, inverse, centre)
            enclosure = axis.ball()
            balls.append([plain(i, z) for i, z in zip(inverse, enclosure, strict=True)])
            may_be_real = all(abs(z).contains(1) for z in enclosure)
            if may_be_real:
                axis.need_real()
                real.append(axis.angles())
        for first, second in combinations(balls, 2):
            # Two points (a, b) and (c, d) are equal if a d = b c.
            pairs = zip(first, second, strict=True)
            if all((a * d - b * c).contains(0) for (a, b), (c, d) in pairs):
                raise NotShown
        return real


class Axis:
    """One solution over a box of inputs: z + Z d + w, with d from the box's centre.

    Krawczyk's operator is used about z + Z d for all d at once; w is what it finds.
    """

    def __init__(self, system, part, path, half, inverse, centre):
        """Enclose one solution of a system over a box of inputs, or raise `NotShown`.

        Parameters
        ----------
        system, part
            All equations, and the system that is solved.
        path
            Inputs and angles of earlier systems, as in `Counting.at`.
        half
            Half widths (inputs,) of the box, rad.
        inverse, centre
            Approximation of the solution at the centre of the box, as in `roots_of`.
        """
        self.inverse = inverse
        self.centre = np.array(centre)
        moving = list(path)
        count = len(centre)
        self.half = Half(system, part["equations"], part["unknowns"], inverse, moving)
        self.steps = about(half)
        self.one = ball(np.eye(count))
        middle = {name: path[name][0] for name in moving}
        rates = ball([path[name][1] for name in moving])
        variation = about([path[name][2] for name in moving])
        change_of_given = rates @ self.steps + variation
        self.given = {
            n: middle[n] + t for n, t in zip(moving, change_of_given, strict=True)
        }

        value, slope = self.half.values(centre, middle)
        self.pull = inverse_near(slope[:, :count])
        self.rates = mid(-self.pull @ (slope[:, count:] @ rates))
        self.along = self.centre + self.rates @ self.steps
        _, slope = self.half.values(self.along, self.given)
        slope_by_unknowns, slope_by_given = slope[:, :count], slope[:, count:]
        change = (slope_by_unknowns @ self.rates + slope_by_given @ rates) @ self.steps
        self.start = -self.pull @ (value + change + slope_by_given @ variation)
        self.radius = 1.5 * largest(self.start) + arb(1e-14)
        self.rest = self.image(self.radius)

    def image(self, radius):
        """Return Krawczyk's operator on all w of a radius; it must lie within them."""
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
        """Show that the solution is real: its mirror image 1 / conj z is the same solution.

        The mirror image is a solution too. It lies in a box of twice the radius in which
        there is only one.
        """
        wide = 2 * self.radius
        self.image(wide)
        for z, relative_rates, relative_rest, relative_change in self.parts():
            scale = 1 / (z * z.conjugate())
            back = relative_change.conjugate()
            mirrored = np.array([k.conjugate() for k in relative_rates])
            first_order = (scale * mirrored + relative_rates) @ self.steps
            higher_order = scale * (back * back / (1 + back) - relative_rest.conjugate())
            if not largest([z * (scale - 1 - first_order + higher_order)]) < wide:
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
    """Check a certificate that maps the number of modes over two inputs by boxes.

    The boxes must not overlap and must fill the ranges. Each says that it is regular, with
    a number of modes, or contains a type II singularity, or is undecided.
    """
    ctx.prec = 80
    system = System(certificate)
    need(system.follower is None, "maps with wheels are not checked")
    ranges = certificate["inputs"]
    ends = [[system.sizes.angle(end) for end in ranges[name]] for name in ranges]
    low, high = np.array(ends).T
    boxes = certificate["boxes"]
    centres = np.array([box["centre_rad"] for box in boxes])
    halves = np.array([box["half_rad"] for box in boxes])

    distances = np.abs(centres[:, None] - centres)
    is_apart = distances > halves[:, None] + halves - 1e-9
    is_same = np.eye(len(boxes), dtype=bool)
    need(np.all(np.any(is_apart, axis=2) | is_same), "two boxes overlap")
    need(np.all(halves > 0), "an empty box")
    need(np.all(ball(centres) - ball(halves) > low - 1e-9), "a box outside")
    need(np.all(ball(centres) + ball(halves) < high + 1e-9), "a box outside")

    relative_sizes = 2 * halves / mid(high - low).astype(float)
    areas = {}
    for box, area in zip(boxes, np.prod(relative_sizes, axis=1), strict=True):
        areas[box["is"]] = areas.get(box["is"], 0.0) + area
    need(abs(sum(areas.values()) - 1) < 1e-6, "boxes do not fill the ranges")
    for kind, share in certificate["shares"].items():
        need(abs(areas.get(kind, 0.0) - share) < 1e-6, "another share")

    counting = Counting(system, certificate["systems"])
    for box in boxes:
        if box["is"] == "regular":
            centre = ball(box["centre_rad"])
            check_regular(counting, centre, box["half_rad"], box["modes"], 0)
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
