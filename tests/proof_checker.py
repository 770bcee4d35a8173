"""Checks certificates of spherekit without it: python-flint and the standard library.

Links are placed by rotation matrices with dual numbers of balls, and every ball of a root
is tried with Krawczyk's operator over the whole ball, not with bounds of derivatives.
"""

import itertools
import json
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

    def __init__(self, text, tolerance, couplers=None, wheels=False):
        self.data = tomllib.loads(text, parse_float=str)
        self.slack = arb(0, tolerance) if tolerance else arb(0)
        pairs = self.data["pairs"]
        hinges = [name for name, p in pairs.items() if p["type"] in ("R", "P")]
        self.ends = {name: tuple(pairs[name]["links"]) for name in hinges}
        self.links = list(self.data["links"])
        self.couplers = {}
        for contact, made in (couplers or {}).items():
            need(pairs[contact]["type"] == "Cs", "a coupler for what does not slide")
            need(made["link"] not in self.links, "a coupler that is another link")
            self.links.append(made["link"])
            for side, (name, link) in enumerate(
                zip(made["pairs"], pairs[contact]["links"], strict=True)
            ):
                need(name not in self.ends, "a pair of a coupler that is another pair")
                self.ends[name] = link, made["link"]
                self.couplers[name] = contact, side
        rolling = [name for name, p in pairs.items() if p["type"] == "Cr"]
        made = len(hinges) + len(couplers or {}) + (len(rolling) if wheels else 0)
        need(len(pairs) == made, "only R pairs and couplers")

    def circle(self, contact, link):
        """Centre and radius of the circle of a contact on a link."""
        item = self.data["pairs"][contact]
        follower = item.get("follower", {})
        own = follower if follower.get("link") == link else item["profiles"][link]
        if "axis" in own:
            need("radius" in own, "no radius")
            frame = self.frame(own["axis"], link)
            return [frame[k, 2].real for k in range(3)], self.angle(own["radius"])
        need(own.get("kind", "circle") in ("circle", "great_circle"), "no circle")
        key = next(k for k in own if k[:7] == "centre_" or k[:5] == "pole_")
        radius = own.get("radius", own.get("roller"))
        across = arb.pi() / 2 if radius is None else self.angle(radius) + self.slack
        return self.direction(own[key], key.endswith("xyz")), across

    def direction(self, row, is_xyz):
        if is_xyz:
            return [e + self.slack for e in unit([number(e) for e in row])]
        (s, c), (up, across) = ((self.angle(e) + self.slack).sin_cos() for e in row)
        return [c * across, s * across, up]

    def coupler_frame(self, pair, link):
        """Columns of a pair of a coupler: the azimuth of the contact is its angle."""
        contact, side = self.couplers[pair]
        item = self.data["pairs"][contact]
        circles = [self.circle(contact, each) for each in item["links"]]
        if link in item["links"]:
            axis = circles[side][0]
            first = int(abs(float(axis[0].mid())) > 0.9)
            ahead = [int(k == first) - axis[first] * e for k, e in enumerate(axis)]
            x = unit(ahead)
        else:
            (_, one), (_, other) = circles
            inner = item.get("contact", "external") == "internal"
            s, c = (one - other if inner else one + other).sin_cos()
            ways = [0, 1, 0], ([0, c, -s] if inner else [0, -c, s])
            axis, x = (([0, 0, 1], [0, s, c])[side], ways[side])
            axis, x = [arb(e) for e in axis], [arb(e) for e in x]
        y = cross(axis, x)
        return rows([[x[k], y[k], axis[k]] for k in range(3)])

    def angle(self, text):
        degrees = self.data["angle_unit"] == "deg"
        return number(text) * (arb.pi() / 180 if degrees else 1)

    def axes(self, link):
        item = self.data["links"][link]
        turns = ["0", *item.get("angles", [])]
        found = {item["axes"][0]: [arb(0), arb(0), arb(1)]}
        for name, length, turn in zip(
            item["axes"][1:], item.get("arcs", []), turns, strict=False
        ):
            s, c = (self.angle(length) + self.slack).sin_cos()
            st, ct = (self.angle(turn) + (self.slack if turn != "0" else 0)).sin_cos()
            found[name] = [-s * st, s * ct, c]
        return found

    def posed(self, pair, link):
        """The same of a file that gives the axes in a pose, in which links are aligned."""
        item = self.data["pairs"][pair]
        key = "xyz" if "xyz" in item else "lonlat"
        axis = self.direction(item[key], key == "xyz")
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
        if pair in self.couplers:
            return self.coupler_frame(pair, link)
        if "axes" not in self.data["links"][link]:
            axis, x, y, zero = self.posed(pair, link)
            return self.turned(axis, x, y, zero)
        axes = self.axes(link)
        axis = axes[pair]
        others = [o for name, o in axes.items() if name != pair]
        sizes = [abs(float(e.mid())) for e in axis]
        others += [[arb(int(k == sizes.index(min(sizes)))) for k in range(3)]]
        other = next(o for o in others if dot(cross(axis, o), cross(axis, o)) > 1e-18)
        alone = other is others[-1]
        x = unit(cross(axis, other) if alone else cross(cross(axis, other), axis))
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
        self.made = certificate["construction"]
        text, tolerance = certificate["mechanism"], certificate["tolerance_rad"]
        follow = self.made["follow"]
        self.sizes = Sizes(text, tolerance, self.made["couplers"], bool(follow))
        self.unknowns = self.made["unknowns"]
        self.inputs = list(certificate["inputs"])
        self.follower = None
        self.turning = {}
        if follow:
            from proof_checker_gears import follower_of

            self.follower = follower_of(self.sizes, self.inputs)
            need(follow == [self.follower.pair], "other wheels follow")
        self.lap(1)
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
        every = self.unknowns + self.inputs + follow
        need(sorted(angles) == sorted(every), "other unknowns")
        need(len(self.onto) == len(self.unknowns), "not as many equations as unknowns")
        self.frames = {
            (pair, link): self.sizes.frame(pair, link)
            for pair, two in ends.items()
            for link in two
        }

    def lap(self, laps):
        """Count by a variable that goes round once while the input turns `laps` times."""
        if self.follower is None:
            return
        driven, ratio = self.follower.driven, self.follower.ratio * laps
        rate = arb(ratio.numerator) / ratio.denominator
        self.turning = {
            driven: (driven, arb(laps), arb(0)),
            self.follower.pair: (driven, rate, self.follower.offset),
        }

    def bound(self):
        """The permanent of the degrees in the half tangents, counted anew."""
        return permanent_of(self.degrees())

    def degrees(self):
        """The degrees of each equation in the half tangents of the unknowns."""
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
        return table

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
                variable, rate, offset = self.turning.get(pair, (pair, arb(1), arb(0)))
                s, c = (acb(angle[variable]) * rate + offset).sin_cos()
                if self.sizes.ends[pair][0] != parent:
                    s = -s
                turn = rows([[c, -s, 0], [s, c, 0], [0, 0, 1]])
                slopes = list(nothing)
                if variable in self.unknowns:
                    sense = 1 if self.sizes.ends[pair][0] == parent else -1
                    change = [[-s, -c, 0], [c, -s, 0], [0, 0, 0]]
                    slopes[self.unknowns.index(variable)] = sense * rate * rows(change)
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


def permanent_of(table):
    total = 0
    for order in permutations(range(len(table))):
        term = 1
        for row, column in enumerate(order):
            term *= table[row][column]
        total += term
    return total


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
    counted = len(found) == certificate["bound"]
    need(certificate["counted"] == counted, "not counted")
    left = certificate["undecided_rad"]
    need(certificate["complete"] == (counted or not left), "not complete")
    if certificate["systems"]:
        need(system.follower is None, "systems with wheels are not checked")
        from proof_checker_systems import check_systems

        check_systems(system, certificate, driven)
    elif not counted:
        exclude(system, driven, [root for root in found if root["real"]], left)


def exclude(system, driven, real, left):
    """Show that real modes are in the balls of roots, or in the boxes left over."""
    ctx.prec = 80
    boxes = []
    for root in real:
        centre = [acb(dyadic(re)) for re, _ in root["centre"]]
        radius = 0.04
        while not alone(system, centre, radius, driven):
            radius /= 2
            need(radius > root["radius"], "a root is not alone")
        boxes.append(([float(c.real.mid()) for c in centre], [radius] * len(centre)))
    boxes += [(box["centre"], [1.001 * h + 1e-12 for h in box["half"]]) for box in left]

    def known(place, sizes):
        turn = 6.283185307179586
        return any(
            all(
                half >= turn / 2
                or abs((p - c + turn / 2) % turn - turn / 2) + r <= half - 1e-12
                for p, r, c, half in zip(place, sizes, centre, halves, strict=True)
            )
            for centre, halves in boxes
        )

    def first(place):
        value, slope = system.values([acb(p) for p in place], driven)
        return type("Jets", (), {"value": value, "slope": slope})

    count = len(system.unknowns)
    # not about zero, where roots of special geometry lie on the sides of boxes
    start = [arb(0.7 + 0.1 * k) for k in range(count)]
    cover(first, start, [arb.pi() * 1.0001] * count, known, 1e-7)


PARTS = ((12, 4), (24, 6), (48, 8))
"""Parts of the length and of each width that a piece is cut into, until balls are small."""


def column(entries):
    return vector([arb(e) for e in entries])


def one_arc(system, piece, wide):
    """Whether a piece has one y for every s, by Krawczyk's operator over parts of it."""
    return any(one_arc_by(parts, piece, wide) for parts in PARTS)


def one_arc_by(parts, piece, wide):
    """The same with the parts of the length and of each width given."""
    halves, cuts = parts
    centre, frame = piece["centre"], piece["frame"]
    t, normals = frame[0], frame[1:]
    half, radius = arb(piece["half"]), arb(piece["radius"])
    count = len(normals)
    across = vector([0] * count).transpose() if not count else rows(normals).transpose()
    middle = [arb(c) for c in centre]

    def first(places):
        """F, F' t and F' N over balls of all variables."""
        jets = wide(places)
        return jets.value, jets.slope * column(t), jets.slope * across

    _, _, inner = first(middle)
    near = inner.mid().inv().mid()
    one = rows([[int(r == c) for c in range(count)] for r in range(count)])
    for part in range(halves):
        s = half * (2 * part + 1 - halves) / halves
        step = arb(0, half / halves)
        here = [m + s * b for m, b in zip(middle, t, strict=True)]
        axis = [h + step * b for h, b in zip(here, t, strict=True)]
        value, _, _ = first(here)
        _, along, _ = first(axis)
        sides = hull(first, axis, normals, radius, cuts)
        image = -1 * (near * (value + along * acb(step)))
        spread = (one - near * sides) * vector([arb(0, radius)] * count)
        for row in range(count):
            if not abs((image + spread)[row, 0].real).upper() < radius:
                return False
    return True


def hull(first, axis, normals, radius, cuts):
    """F' N over all y of a piece, put together from parts."""
    whole = None
    for cell in itertools.product(range(cuts), repeat=len(normals)):
        place = list(axis)
        for number, normal in zip(cell, normals, strict=True):
            y = radius * (2 * number + 1 - cuts) / cuts + arb(0, (radius / cuts).upper())
            place = [p + y * e for p, e in zip(place, normal, strict=True)]
        sides = first(place)[2].tolist()
        if whole is None:
            whole = sides
        else:
            pairs = [zip(a, b, strict=True) for a, b in zip(whole, sides, strict=True)]
            whole = [[acb(a.real.union(b.real)) for a, b in row] for row in pairs]
    return rows(whole)


class Wide:
    """F and F' by all variables, the input last, over balls."""

    def __init__(self, system):
        self.system = system
        self.names = system.unknowns + system.inputs
        system.unknowns, kept = self.names, system.unknowns
        self.count = len(kept)

    def __call__(self, places):
        value, slope = self.system.values([acb(p) for p in places], {})
        return type("Jets", (), {"value": value, "slope": slope})


def coordinates(piece, place):
    apart = [arb(p) - arb(c) for p, c in zip(place, piece["centre"], strict=True)]
    turn = 2 * arb.pi()
    apart = [a - turn * arb(round(float((a / turn).mid()))) for a in apart]
    return [dot([arb(e) for e in row], apart) for row in piece["frame"]]


def inside(piece, place, off):
    s, *y = coordinates(piece, place)
    fits = abs(s) + off < arb(piece["half"])
    return fits and all(abs(e) + off < arb(piece["radius"]) for e in y)


MOST_CHECKED = 200000
SLACK = 1e-9
"""How far the centre of a piece may be off its arc here; the solver's is 1e-12."""


def close(wide, piece):
    """Whether the arc of a piece is within SLACK of its centre at s = 0."""
    jets = wide([arb(c) for c in piece["centre"]])
    normals = rows(piece["frame"][1:]).transpose()
    near = (jets.slope * normals).mid().inv().mid()
    return all(abs(e.real).upper() < SLACK / 4 for e in (near * jets.value).entries())


def pave(wide, low, high, pieces):
    """Show that nothing in the range is outside the pieces."""
    count = len(wide.names) - 1
    middle = [arb(0)] * count + [(low + high) / 2]
    radius = [arb.pi()] * count + [(high - low) / 2]

    def known(place, sizes):
        return any(boxed(piece, place, sizes) for piece in pieces)

    cover(wide, middle, radius, known, 1e-4)


def cover(first, middle, radius, known, smallest):
    """Show that F has no zero in a box but where it is known."""
    count = len(middle)
    waiting = [(middle, radius)]
    looked = 0
    while waiting:
        middle, radius = waiting.pop()
        looked += 1
        need(looked < MOST_CHECKED, "too many boxes")
        place = [float(m.mid()) for m in middle]
        sizes = [float(r.upper()) for r in radius]
        if known(place, sizes):
            continue
        if looked > 1:
            box = [m + arb(0, r.upper()) for m, r in zip(middle, radius, strict=True)]
            value = first(middle).value
            slope = first(box).slope
            spread = slope * vector([arb(0, r.upper()) for r in radius])
            image = value + spread
            if any(not image[row, 0].real.contains(0) for row in range(value.nrows())):
                continue
            need(max(sizes) > smallest, "a box is neither empty nor in a piece")
        side = max(range(count), key=lambda k: float(radius[k].mid()))
        for sense in (-1, 1):
            part = list(middle)
            part[side] = part[side] + sense * radius[side] / 2
            halves = list(radius)
            halves[side] = halves[side] / 2
            waiting.append((part, halves))


def boxed(piece, place, sizes):
    """Whether a box, in floats with a margin, lies in a piece."""
    turn = 6.283185307179586
    apart = [
        (p - c + turn / 2) % turn - turn / 2
        for p, c in zip(place, piece["centre"], strict=True)
    ]
    limits = [piece["half"]] + [piece["radius"]] * (len(place) - 1)
    for row, limit in zip(piece["frame"], limits, strict=True):
        reach = sum(abs(e) * s for e, s in zip(row, sizes, strict=True))
        if abs(sum(e * a for e, a in zip(row, apart, strict=True))) + reach > limit - 1e-9:
            return False
    return True


DEEPEST = 60


class Arc:
    """The arc of a piece, enclosed over parts of its length."""

    def __init__(self, piece, wide):
        self.piece, self.wide = piece, wide
        self.t, self.normals = piece["frame"][0], piece["frame"][1:]
        self.across = rows(self.normals).transpose()
        self.centre = [arb(c) for c in piece["centre"]]
        slope = wide(self.centre).slope
        self.near = (slope * self.across).mid().inv().mid()

    def at(self, s):
        """Balls of all variables where s is in a ball."""
        count = len(self.normals)
        one = rows([[int(r == c) for c in range(count)] for r in range(count)])
        middle = arb(s.mid())
        axis = [c + middle * e for c, e in zip(self.centre, self.t, strict=True)]
        spread = [a + (s - middle) * e for a, e in zip(axis, self.t, strict=True)]
        radius = self.piece["radius"]
        y = self._narrowed([arb(0, radius)] * count, axis, spread, s - middle, one)
        if any(each.rad() > 0.9 * radius for each in y):
            y = self._shrunk(axis, spread, s - middle, one)
            y = self._narrowed(y, axis, spread, s - middle, one)
        return self._moved(spread, y)

    def _narrowed(self, y, axis, spread, step, one):
        """Balls within those of y, by Krawczyk's operator as long as it narrows them."""
        for _ in range(30):
            before = y
            fixed = [arb(each.mid()) for each in y]
            start = self._moved(axis, fixed)
            value = self.wide(start).value
            box = self._moved(spread, y)
            slope = self.wide(box).slope
            along = slope * column(self.t) * acb(step)
            rest = vector([a - b for a, b in zip(y, fixed, strict=True)])
            image = vector(fixed) - self.near * (value + along)
            image += (one - self.near * (slope * self.across)) * rest
            found = [image[row, 0].real for row in range(len(y))]
            y = [a.intersection(b) for a, b in zip(y, found, strict=True)]
            shrunk = (b.rad() < 0.9 * a.rad() for a, b in zip(before, y, strict=True))
            if not any(shrunk):
                break
        return y

    def _shrunk(self, axis, spread, step, one):
        """Balls of y, from parts of the widths of the piece where over all none shrinks."""
        radius = arb(self.piece["radius"])
        wide = vector([arb(0, radius)] * len(self.normals))
        value = self.wide(axis).value
        along = self.wide(spread).slope * column(self.t) * acb(step)

        def first(places):
            jets = self.wide(places)
            return jets.value, None, jets.slope * self.across

        for _, cuts in PARTS:
            sides = hull(first, spread, self.normals, radius, cuts)
            image = (one - self.near * sides) * wide - self.near * (value + along)
            found = [image[row, 0].real for row in range(len(self.normals))]
            if all(abs(y).upper() < radius for y in found):
                return found
        return [arb(0, radius)] * len(self.normals)

    def _moved(self, axis, y):
        place = list(axis)
        for number, normal in zip(y, self.normals, strict=True):
            place = [p + number * e for p, e in zip(place, normal, strict=True)]
        return place

    def rate(self, s, variable):
        """A ball of the rate of a variable, times what is never zero."""
        slope = self.wide(self.at(s)).slope.tolist()
        return acb_mat([row[:variable] + row[variable + 1 :] for row in slope]).det().real


def check_stops(wide, curve, variable, stops):
    """Show that a variable stops in the boxes given only, and in each of them."""
    chain = curve["pieces"]
    turn = 6.283185307179586
    following = chain[1:] + (chain[:1] if curve["closed"] else [])
    arcs = [Arc(piece, wide) for piece in chain]

    def within(place, stop):
        return all(
            abs((float(p.mid()) - c + turn / 2) % turn - turn / 2) + float(p.rad())
            <= stop["off"] + 1e-9
            for p, c in zip(place, stop["place"], strict=True)
        )

    for arc, further in zip(arcs, following, strict=False):
        end = coordinates(arc.piece, further["centre"])[0] + arb(0, SLACK)
        waiting = [(arb(0) - arb(0, SLACK), end, 0)]
        while waiting:
            low, high, depth = waiting.pop()
            s = low.union(high)
            if not arc.rate(s, variable).contains(0):
                continue
            if any(within(arc.at(s), stop) for stop in stops):
                continue
            need(depth < DEEPEST, "a variable may stop where none is said to")
            middle = arb(s.mid())
            waiting += [(low, middle, depth + 1), (middle, high, depth + 1)]
    for stop in stops:
        away = 4.0 * stop["off"] + 1e-8
        signs = None
        for arc in arcs:
            s, *y = coordinates(arc.piece, stop["place"])
            inner = abs(s) + 2 * away < arb(arc.piece["half"])
            if inner and all(abs(e) < arb(arc.piece["radius"]) for e in y):
                signs = [arc.rate(arb(s.mid()) + side, variable) for side in (-away, away)]
                break
        need(signs is not None, "a stop that is on no piece")
        need(not any(sign.contains(0) for sign in signs), "a stop that is not shown")
        need((signs[0] > 0) != (signs[1] > 0), "no change of sign at a stop")


def check_singularities(wide, system, certificate):
    """Show all stops of the input, and of the outputs that a pair measures."""
    links = list(system.sizes.data.get("outputs", {}).items())
    for number, curve in enumerate(certificate["curves"]):
        check_stops(wide, curve, len(wide.names) - 1, curve["input_stops"])
        for name, output in links:
            two = {output["link"], output.get("relative_to", system.sizes.data["ground"])}
            pairs = [p for p, ends in system.sizes.ends.items() if set(ends) == two]
            if not pairs or pairs[0] not in wide.names[:-1]:
                continue
            own = [
                each
                for each in certificate["singularities"]["found"]
                if (each["output"], each["curve"]) == (name, number)
                and each["type"] in ("I", "I or III")
            ]
            check_stops(wide, curve, wide.names.index(pairs[0]), own)


def check_curves(certificate):
    need(certificate["statement"] == "curves over a range", "another statement")
    need(certificate["complete"] and not certificate["undecided_rad"], "not complete")
    need(not certificate["crossings"], "crossings are not checked")
    still = any(curve["at_one_input"] for curve in certificate["curves"])
    need(not still, "curves at one input are not checked")
    need(not certificate["curves_at_one_input_rad"], "curves at one input are not checked")
    ctx.prec = 80
    system = System(certificate)
    ((_, (low, high)),) = certificate["inputs"].items()
    low, high = system.sizes.angle(low), system.sizes.angle(high)
    laps = certificate["input_turns_of_its_variable"]
    if system.follower is None:
        need(laps == 1 and not certificate["wheels"], "wheels that are not in the file")
    else:
        from proof_checker_gears import check_stated

        tolerance = certificate["tolerance_rad"]
        check_stated(certificate["wheels"], system.follower, laps, tolerance)
        system.lap(laps)
    low, high = low / laps, high / laps
    need(high - low < 2 * arb.pi() + 1e-9, "a range after which all is back")
    wide = Wide(system)
    pieces = []
    for curve in certificate["curves"]:
        chain = curve["pieces"]
        for piece in chain:
            need(piece["half"] > 0 and piece["radius"] > 0, "an empty piece")
            square = rows(piece["frame"]) * rows(piece["frame"]).transpose()
            for row in range(len(piece["frame"])):
                for other in range(len(piece["frame"])):
                    off = abs(square[row, other].real - int(row == other))
                    need(off < 1e-13, "a frame that is not orthonormal")
            need(one_arc(system, piece, wide), "a piece without one arc")
            need(close(wide, piece), "a centre that is off its arc")
        following = chain[1:] + (chain[:1] if curve["closed"] else [])
        for piece, further in zip(chain, following, strict=False):
            need(inside(piece, further["centre"], arb(SLACK)), "two pieces do not meet")
            need(coordinates(piece, further["centre"])[0] > 0, "a piece backwards")
        if not curve["closed"]:
            ends = chain[0]["centre"][-1], chain[-1]["centre"][-1]
            need(all(arb(e) < low or arb(e) > high for e in ends), "a curve that ends")
        for earlier in pieces:
            need(not inside(earlier, chain[0]["centre"], arb(-SLACK)), "one curve twice")
        pieces += chain
    pave(wide, low, high, pieces)
    if "singularities" in certificate:
        check_singularities(wide, system, certificate)


def check(certificate):
    """Raise `Refused` if what a certificate says is not shown by it."""
    before = ctx.prec
    try:
        need(certificate["certificate"] == 1, "another format")
        if certificate["statement"] == "curves over a range":
            check_curves(certificate)
        elif certificate["statement"] == "modes over boxes":
            from proof_checker_systems import check_map

            check_map(certificate)
        elif certificate["statement"] == "wheels fix all angles":
            from proof_checker_wheels import check_wheels

            check_wheels(certificate)
        else:
            check_modes(certificate)
    except (KeyError, ValueError, TypeError, ZeroDivisionError, StopIteration) as fault:
        raise Refused(f"{type(fault).__name__}: {fault}") from fault
    finally:
        ctx.prec = before


def recorded(certificate):
    """Return a certificate as its file has it."""
    return json.loads(json.dumps(certificate))


def refuse(certificate):
    """Raise `AssertionError` unless a certificate is refused."""
    try:
        check(certificate)
    except Refused:
        return
    raise AssertionError("not refused")
