"""Checks certificates of spherekit without it: python-flint and the standard library.

Links are placed by rotation matrices with dual numbers of balls, and every ball of a root
is tried with Krawczyk's operator over the whole ball, not with bounds of derivatives.
"""

import tomllib
from itertools import combinations, permutations

from flint import acb, acb_mat, arb, ctx, fmpz


class Refused(Exception):
    """What a certificate says is not so, or not shown."""


def need(true, what):
    if not true:
        raise Refused(what)


class Dual:
    """A matrix of balls and its derivatives by the unknowns."""

    def __init__(self, value, slopes):
        self.value, self.slopes = value, slopes

    def __matmul__(self, other):
        both = zip(self.slopes, other.slopes, strict=True)
        slopes = [a * other.value + self.value * b for a, b in both]
        return Dual(self.value * other.value, slopes)

    def __add__(self, other):
        both = zip(self.slopes, other.slopes, strict=True)
        return Dual(self.value + other.value, [a + b for a, b in both])

    @property
    def T(self):
        return Dual(self.value.transpose(), [s.transpose() for s in self.slopes])


def rows(entries):
    return acb_mat([[acb(e) for e in row] for row in entries])


def vector(entries):
    return rows([[e] for e in entries])


def cross(a, b):
    (x, y, z), (u, v, w) = a, b
    return [y * w - z * v, z * u - x * w, x * v - y * u]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def unit(a):
    length = dot(a, a).sqrt()
    return [x / length for x in a]


def number(text):
    return arb(str(text).replace("_", ""))


class Sizes:
    """The axes and zero directions of a file in the form of sizes."""

    def __init__(self, text, tolerance):
        self.data = tomllib.loads(text, parse_float=str)
        self.slack = arb(0, tolerance) if tolerance else arb(0)
        self.ends = {name: tuple(p["links"]) for name, p in self.data["pairs"].items()}
        self.links = list(self.data["links"])
        need(all(p["type"] == "R" for p in self.data["pairs"].values()), "only R pairs")

    def angle(self, text):
        degrees = self.data["angle_unit"] == "deg"
        return number(text) * (arb.pi() / 180 if degrees else 1)

    def axes(self, link):
        item = self.data["links"][link]
        turns = ["0", *item.get("angles", [])]
        found = {item["axes"][0]: [arb(0), arb(0), arb(1)]}
        for name, length, turn in zip(item["axes"][1:], item["arcs"], turns, strict=False):
            s, c = (self.angle(length) + self.slack).sin_cos()
            st, ct = (self.angle(turn) + (self.slack if turn != "0" else 0)).sin_cos()
            found[name] = [-s * st, s * ct, c]
        return found

    def posed(self, pair, link):
        """The same of a file that gives the axes in a pose, in which links are aligned."""
        item = self.data["pairs"][pair]
        if "xyz" in item:
            axis = [e + self.slack for e in unit([number(e) for e in item["xyz"]])]
        else:
            (s, c), (up, across) = (
                (self.angle(e) + self.slack).sin_cos() for e in item["lonlat"]
            )
            axis = [c * across, s * across, up]
        sizes = [abs(float(e.mid())) for e in axis]
        helper = [arb(int(k == sizes.index(min(sizes)))) for k in range(3)]
        x = unit(cross(axis, helper))
        return (
            axis,
            x,
            cross(axis, x),
            item.get("value") if self.is_second(pair, link) else None,
        )

    def is_second(self, pair, link):
        return self.ends[pair][1] == link

    def frame(self, pair, link):
        """Columns x, y, z of a pair in a link, x towards the first other axis."""
        if "axes" not in self.data["links"][link]:
            axis, x, y, zero = self.posed(pair, link)
            return self.turned(axis, x, y, zero)
        axes = self.axes(link)
        axis = axes[pair]
        others = (o for name, o in axes.items() if name != pair)
        other = next(o for o in others if dot(cross(axis, o), cross(axis, o)) > 1e-18)
        x = unit(cross(cross(axis, other), axis))
        y = cross(axis, x)
        zero = self.data["pairs"][pair].get("zero")
        return self.turned(axis, x, y, None if self.is_second(pair, link) else zero)

    def turned(self, axis, x, y, zero):
        if zero is not None:
            s, c = (self.angle(zero) + self.slack).sin_cos()
            x, y = (
                [c * a + s * b for a, b in zip(x, y, strict=True)],
                [c * b - s * a for a, b in zip(x, y, strict=True)],
            )
        return rows([[x[k], y[k], axis[k]] for k in range(3)])


class System:
    """The equations of a certificate's construction."""

    def __init__(self, certificate):
        self.sizes = Sizes(certificate["mechanism"], certificate["tolerance_rad"])
        self.made = certificate["construction"]
        self.unknowns = self.made["unknowns"]
        self.inputs = list(certificate["inputs"])
        ends = self.sizes.ends
        placed, used, self.across, self.onto = {self.made["root"]}, [], [], []
        for step in self.made["steps"]:
            link, on, by = step["link"], step["on"], step["by"]
            need(link in self.sizes.links and link not in placed, f"{link} placed twice")
            need(len(on) == len(by) in (1, 2) and set(on) <= placed, f"{link} on nothing")
            for parent, pair in zip(on, by, strict=True):
                need(set(ends[pair]) == {link, parent}, f"{pair} does not join them")
            (self.across if len(by) == 1 else self.onto).append(step)
            placed.add(link)
            used += by
        need(placed == set(self.sizes.links), "links are missing")
        need(sorted(used) == sorted(ends), "pairs are missing or used twice")
        angles = [step["by"][0] for step in self.across]
        need(sorted(angles) == sorted(self.unknowns + self.inputs), "other unknowns")
        need(len(self.onto) == len(self.unknowns), "not as many equations as unknowns")
        self.frames = {
            (pair, link): self.sizes.frame(pair, link)
            for pair, two in ends.items()
            for link in two
        }

    def bound(self):
        """The permanent of the degrees in the half tangents, counted anew."""
        ways = {self.made["root"]: []}
        table = []
        for step in self.made["steps"]:
            if len(step["by"]) == 1:
                ways[step["link"]] = [*ways[step["on"][0]], (step["link"], step["by"][0])]
                continue
            one, other = (list(ways[parent]) for parent in step["on"])
            shared = []
            while one and other and one[0] == other[0]:
                shared.append(one.pop(0))
                other.pop(0)
            angles = [angle for _, names in one + other for angle in names.split("|")]
            table.append([2 * angles.count(name) for name in self.unknowns])
            ways[step["link"]] = [*shared, (step["link"], "|".join(angles))]
        total = 0
        for order in permutations(range(len(table))):
            term = 1
            for row, column in enumerate(order):
                term *= table[row][column]
            total += term
        return total

    def values(self, unknown, driven):
        """F and F' at balls of the unknowns."""
        count = len(unknown)
        nothing = [rows([[0] * 3] * 3) for _ in range(count)]
        still = Dual(rows([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), nothing)
        placed = {self.made["root"]: still}
        angle = {**dict(zip(self.unknowns, unknown, strict=True)), **driven}
        found = []

        def constant(matrix):
            return Dual(matrix, [0 * matrix for _ in range(count)])

        for step in self.made["steps"]:
            link, on, by = step["link"], step["on"], step["by"]
            if len(by) == 1:
                (pair,), (parent,) = by, on
                s, c = acb(angle[pair]).sin_cos()
                if self.sizes.ends[pair][0] != parent:
                    s = -s
                turn = rows([[c, -s, 0], [s, c, 0], [0, 0, 1]])
                slopes = list(nothing)
                if pair in self.unknowns:
                    sense = 1 if self.sizes.ends[pair][0] == parent else -1
                    change = [[-s, -c, 0], [c, -s, 0], [0, 0, 0]]
                    slopes[self.unknowns.index(pair)] = sense * rows(change)
                before = constant(self.frames[pair, parent])
                after = constant(self.frames[pair, link].transpose())
                placed[link] = placed[parent] @ before @ Dual(turn, slopes) @ after
                continue
            own = [[self.frames[p, link][k, 2] for k in range(3)] for p in by]
            out = [
                placed[parent]
                @ constant(vector([self.frames[p, parent][k, 2] for k in range(3)]))
                for p, parent in zip(by, on, strict=True)
            ]
            miss = out[0].T @ out[1] + constant(rows([[-dot(*own)]]))
            found.append(miss)
            normal = cross(*own)
            square = dot(normal, normal)
            need(square.real > 0, f"the arc of {link} may be 0 or 180 degrees")
            third = self.crossed(*out)
            inverse = rows([own[0], own[1], normal]).transpose().inv()
            columns = [*out, third]
            parts = [
                each @ constant(rows([[inverse[k, j] for j in range(3)]]))
                for k, each in enumerate(columns)
            ]
            placed[link] = parts[0] + parts[1] + parts[2]
        value = rows([[f.value[0, 0]] for f in found])
        slope = rows([[f.slopes[j][0, 0] for j in range(count)] for f in found])
        return value, slope

    @staticmethod
    def crossed(one, other):
        def of(a, b):
            return vector(cross(a.entries(), b.entries()))

        pairs = zip(one.slopes, other.slopes, strict=True)
        slopes = [of(a, other.value) + of(one.value, b) for a, b in pairs]
        return Dual(of(one.value, other.value), slopes)


def dyadic(parts):
    mantissa, exponent = parts
    return arb(fmpz(mantissa)) * arb(2) ** exponent


def alone(system, centre, radius, driven):
    """Whether Krawczyk's operator proves one solution in the square balls of a radius."""
    value, slope = system.values(centre, driven)
    near = slope.mid().inv().mid()
    around = acb(arb(0, radius), arb(0, radius))
    box = [c + around for c in centre]
    _, slopes = system.values(box, driven)
    count = len(centre)
    one = rows([[int(r == c) for c in range(count)] for r in range(count)])
    image = -1 * (near * value) + (one - near * slopes) * vector([around] * count)
    return all(
        abs(part).upper() < arb(radius)
        for e in image.entries()
        for part in (e.real, e.imag)
    )


def check_modes(certificate):
    need(certificate["statement"] == "modes at inputs", "another statement")
    ctx.prec = certificate["precision_bits"] + 40
    system = System(certificate)
    driven = {k: system.sizes.angle(v) for k, v in certificate["inputs"].items()}
    need(system.bound() == certificate["bound"], "another bound")
    found = certificate["roots"]
    points = []
    for root in found:
        need(len(root["centre"]) == len(system.unknowns), "other unknowns")
        centre = [acb(dyadic(re), dyadic(im)) for re, im in root["centre"]]
        radius = root["radius"]
        need(0 < radius < 0.1, "a radius out of range")
        # the ball is a disk for each angle: a square of 0.7 of its radius lies within
        need(alone(system, centre, 0.7 * radius, driven), "a root is not shown")
        imaginary = [arb(c.imag) + arb(0, radius) for c in centre]
        if root["real"]:
            need(all(c.imag == 0 for c in centre), "a real root off the real axis")
        else:
            need(any(not i.contains(0) for i in imaginary), "a root that may be real")
        disk = acb(arb(0, radius), arb(0, radius))
        points.append([(acb(0, 1) * (c + disk)).exp() for c in centre])
    for one, other in combinations(points, 2):
        apart = any(not a.overlaps(b) for a, b in zip(one, other, strict=True))
        need(apart, "two roots may be one")
    need(certificate["modes"] == sum(r["real"] for r in found), "another number of modes")
    need(certificate["complete"] == (len(found) == certificate["bound"]), "not complete")


def check(certificate):
    """Raise `Refused` if what a certificate says is not shown by it."""
    before = ctx.prec
    try:
        need(certificate["certificate"] == 1, "another format")
        check_modes(certificate)
    except (KeyError, ValueError, TypeError, ZeroDivisionError, StopIteration) as fault:
        raise Refused(f"{type(fault).__name__}: {fault}") from fault
    finally:
        ctx.prec = before
