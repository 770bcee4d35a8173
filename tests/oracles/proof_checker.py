"""Checks certificates of spherekit without it: by NumPy's arrays of python-flint's balls.

Links are placed by rotation matrices with dual numbers of balls, and every ball of a root
is tried with Krawczyk's operator over the whole ball, not with bounds of derivatives.

A dual array has its value first, and then its derivatives by the unknowns.
"""

import itertools
import json
import tomllib
from itertools import combinations, permutations

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx, fmpz

PERIOD = 6.283185307179586
ball = np.frompyfunc(arb, 1, 1)
mid = np.frompyfunc(lambda each: each.mid(), 1, 1)
size = np.frompyfunc(lambda each: abs(each).upper(), 1, 1)
union = np.frompyfunc(lambda one, other: one.union(other), 2, 1)
shared = np.frompyfunc(lambda one, other: one.intersection(other), 2, 1)


class Refused(Exception):
    """What a certificate says is not so, or not shown."""


def need(true, what):
    if not true:
        raise Refused(what)


def matrix(entries):
    """A matrix of flint, of real balls if all entries are."""
    try:
        return arb_mat(entries.tolist())
    except TypeError:
        return acb_mat(entries.tolist())


def inverse(entries):
    return np.array(matrix(entries).inv().tolist())


def inverse_near(entries):
    return mid(inverse(mid(entries)))


def about(radii):
    """Balls about zero."""
    return np.array([arb(0, radius) for radius in radii])


def wrapped(angle):
    return (angle + PERIOD / 2) % PERIOD - PERIOD / 2


def constant(value, count):
    return np.stack([value, *[0 * value] * count])


def times(one, other, product=np.matmul):
    """The dual product of two dual arrays."""
    slopes = product(one[1:], other[0]) + product(one[0], other[1:])
    return np.concatenate([product(one[0], other[0])[None], slopes])


def crossed(one, other):
    """The dual vector product of two dual columns."""
    return times(one, other, lambda a, b: np.cross(a, b, axis=-2))


def unit(a):
    return a / (a @ a).sqrt()


def helper(axis):
    """The axis of coordinates that is farthest from another."""
    return ball(np.eye(3))[np.argmin(np.abs(mid(axis).astype(float)))]


def across(axis):
    """The direction of azimuth 0 about the centre of a circle."""
    first = int(abs(float(axis[0].mid())) > 0.9)
    return unit(np.eye(3, dtype=int)[first] - axis[first] * axis)


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
            two = zip(made["pairs"], pairs[contact]["links"], strict=True)
            for side, (name, link) in enumerate(two):
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
            return self.frame(own["axis"], link)[:, 2], self.angle(own["radius"])
        need(own.get("kind", "circle") in ("circle", "great_circle"), "no circle")
        key = next(k for k in own if k[:7] == "centre_" or k[:5] == "pole_")
        radius = own.get("radius", own.get("roller"))
        half = arb.pi() / 2 if radius is None else self.angle(radius) + self.slack
        return self.direction(own[key], key.endswith("xyz")), half

    def direction(self, row, is_xyz):
        if is_xyz:
            return unit(np.array([number(e) for e in row])) + self.slack
        (s, c), (up, out) = ((self.angle(e) + self.slack).sin_cos() for e in row)
        return np.array([c * out, s * out, up])

    def coupler_frame(self, pair, link):
        """Columns of a pair of a coupler: the azimuth of the contact is its angle."""
        contact, side = self.couplers[pair]
        item = self.data["pairs"][contact]
        circles = [self.circle(contact, each) for each in item["links"]]
        if link in item["links"]:
            axis = circles[side][0]
            x = across(axis)
        else:
            (_, one), (_, other) = circles
            inner = item.get("contact", "external") == "internal"
            s, c = (one - other if inner else one + other).sin_cos()
            ways = [0, 1, 0], ([0, c, -s] if inner else [0, -c, s])
            axis, x = ball(([0, 0, 1], [0, s, c])[side]), ball(ways[side])
        return np.stack([x, np.cross(axis, x), axis], axis=1)

    def angle(self, text):
        degrees = self.data["angle_unit"] == "deg"
        return number(text) * (arb.pi() / 180 if degrees else 1)

    def axes(self, link):
        item = self.data["links"][link]
        turns = ["0", *item.get("angles", [])]
        found = {item["axes"][0]: ball([0, 0, 1])}
        for name, length, turn in zip(
            item["axes"][1:], item.get("arcs", []), turns, strict=False
        ):
            s, c = (self.angle(length) + self.slack).sin_cos()
            st, ct = (self.angle(turn) + (self.slack if turn != "0" else 0)).sin_cos()
            found[name] = np.array([-s * st, s * ct, c])
        return found

    def frame(self, pair, link):
        """Columns x, y, z of a pair in a link, x towards the first other axis.

        Of a file that gives the axes in a pose, links are aligned there.
        """
        if pair in self.couplers:
            return self.coupler_frame(pair, link)
        item, second = self.data["pairs"][pair], self.ends[pair][1] == link
        if "axes" not in self.data["links"][link]:
            key = "xyz" if "xyz" in item else "lonlat"
            axis, others = self.direction(item[key], key == "xyz"), []
            zero = item.get("value") if second else None
        else:
            axes = self.axes(link)
            axis = axes.pop(pair)
            normals = [np.cross(axis, other) for other in axes.values()]
            others = [np.cross(n, axis) for n in normals if n @ n > 1e-18]
            zero = None if second else item.get("zero")
        x = unit([*others, np.cross(axis, helper(axis))][0])
        y = np.cross(axis, x)
        if zero is not None:
            s, c = (self.angle(zero) + self.slack).sin_cos()
            x, y = c * x + s * y, c * y - s * x
        return np.stack([x, y, axis], axis=1)


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
            from oracles.proof_checker_gears import follower_of

            self.follower = follower_of(self.sizes, self.inputs)
            need(follow == [self.follower.pair], "other wheels follow")
        self.lap(1)
        ends = self.sizes.ends
        placed, used, turned, self.onto = {self.made["root"]}, [], [], []
        for step in self.made["steps"]:
            link, on, by = step["link"], step["on"], step["by"]
            need(link in self.sizes.links and link not in placed, f"{link} placed twice")
            need(len(on) == len(by) in (1, 2) and set(on) <= placed, f"{link} on nothing")
            for parent, pair in zip(on, by, strict=True):
                need(set(ends[pair]) == {link, parent}, f"{pair} does not join them")
            (turned if len(by) == 1 else self.onto).append(step)
            placed.add(link)
            used += by
        need(placed == set(self.sizes.links), "links are missing")
        need(sorted(used) == sorted(ends), "pairs are missing or used twice")
        angles = [step["by"][0] for step in turned]
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
            above, one, other = parted(*(ways[parent] for parent in step["on"]))
            angles = [angle for _, names in one + other for angle in names.split("|")]
            table.append([2 * angles.count(name) for name in self.unknowns])
            ways[step["link"]] = [*above, (step["link"], "|".join(angles))]
        return table

    def values(self, unknown, driven):
        """F (k,) and F' (k, unknowns) at balls of the unknowns."""
        angles = {**dict(zip(self.unknowns, unknown, strict=True)), **driven}
        links = [step["link"] for step in self.onto]
        return Half(self, links, [], [], self.unknowns).values([], angles)


class Half:
    """Equations of links, polynomials in the e^(i angle) of pairs or in their inverses.

    Derivatives are by these, and then by the pairs `moving`.
    """

    def __init__(self, system, links, unknowns, inverse, moving=()):
        self.system, self.links, self.inverse = system, links, inverse
        self.unknowns, self.moving = unknowns, list(moving)
        self.count = len(unknowns) + len(self.moving)
        self.steps = {step["link"]: step for step in system.made["steps"]}

    def values(self, centre, driven):
        """P and its derivatives at balls of the points and of all other angles."""
        self.points = dict(zip(self.unknowns, centre, strict=True))
        self.driven, self.done = driven, {}
        return parts_of([self._put(link)[0] for link in self.links])

    def _local(self, link):
        """The matrix of a link in the one before, times its scale, and the scale."""
        if link not in self.done:
            turned = len(self.steps[link]["by"]) == 1
            self.done[link] = self._turned(link) if turned else self._put(link)[1:]
        return self.done[link]

    def _turned(self, link):
        step = self.steps[link]
        (pair,), (parent,) = step["by"], step["on"]
        sense = 1 if self.system.sizes.ends[pair][0] == parent else -1
        before = constant(self.system.frames[pair, parent], self.count)
        after = constant(self.system.frames[pair, link].T, self.count)
        scale = constant(ball([[1]]), self.count)
        if pair in self.points:
            column = self.unknowns.index(pair)
            z, one = self.points[pair], acb(1)
            a, b, up, down = (one, z, 0, one) if self.inverse[column] else (z, one, one, 0)
            c, s, w = (a * a + b * b) / 2, (a * a - b * b) / acb(0, 2), a * b
            dc, ds = a * up + b * down, (a * up - b * down) / acb(0, 1)
            dw = a * down + up * b
            turn = constant(spin(c, sense * s, w), self.count)
            turn[1 + column] = spin(dc, sense * ds, dw)
            scale[0], scale[1 + column] = w, dw
        else:
            turning = self.system.turning.get(pair, (pair, arb(1), arb(0)))
            variable, rate, offset = turning
            s, c = (self.driven[variable] * rate + offset).sin_cos()
            turn = constant(spin(c, sense * s, 1), self.count)
            if variable in self.moving:
                column = 1 + len(self.unknowns) + self.moving.index(variable)
                turn[column] = rate * spin(-s, sense * c, 0)
        return times(times(before, turn), after), scale

    def _way(self, link):
        step = self.steps.get(link)
        if step is None:
            return []
        if len(step["by"]) == 1:
            return [*self._way(step["on"][0]), link]
        return [*parted(*map(self._way, step["on"]))[0], link]

    def _put(self, link):
        """The equation of a link put on two axes, its matrix times its scale, the scale."""
        step = self.steps[link]
        _, *ways = parted(*map(self._way, step["on"]))
        out, scales = [], []
        for way, pair, parent in zip(ways, step["by"], step["on"], strict=True):
            axis = constant(self.system.frames[pair, parent][:, 2:], self.count)
            scale = constant(ball([[1]]), self.count)
            for each in reversed(way):
                place, size = self._local(each)
                axis, scale = times(place, axis), times(scale, size)
            out.append(axis)
            scales.append(scale)
        axes = [self.system.frames[pair, link][:, 2] for pair in step["by"]]
        return *put(link, axes, out, scales), times(*scales)


def spin(c, s, still):
    """A matrix about the third axis."""
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, still]], dtype=object)


def put(link, axes, out, scales):
    """The equation of a link put on two axes, and its matrix, times both scales.

    `axes` are its own, `out` dual columns of where they are, times one scale each.
    """
    both = times(*scales)
    miss = times(out[0].swapaxes(1, 2), out[1]) - both * (axes[0] @ axes[1])
    normal = np.cross(*axes)
    need((normal @ normal).real > 0, f"the arc of {link} may be 0 or 180 degrees")
    own = inverse(np.stack([*axes, normal], axis=1))
    columns = times(out[0], scales[1]), times(out[1], scales[0]), crossed(*out)
    return miss, np.concatenate(columns, axis=2) @ own


def parts_of(duals):
    """Values (k,) and derivatives (k, n) of dual arrays of one entry each."""
    table = np.array([dual[:, 0, 0] for dual in duals]).reshape(len(duals), -1)
    return table[:, 0], table[:, 1:]


def parted(one, other):
    """What two ways share, and the rest of both."""
    same = [a == b for a, b in zip(one, other, strict=False)]
    count = [*same, False].index(False)
    return one[:count], one[count:], other[count:]


def permanent_of(table):
    orders = permutations(range(len(table)))
    return sum(np.prod([row[k] for row, k in zip(table, o, strict=True)]) for o in orders)


def dyadic(parts):
    mantissa, exponent = parts
    return arb(fmpz(mantissa)) * arb(2) ** exponent


def square(radius):
    return acb(arb(0, radius), arb(0, radius))


def largest(entries):
    return max(abs(part).upper() for e in entries for part in (e.real, e.imag))


def alone(system, centre, radius, driven):
    """Whether Krawczyk's operator proves one solution in the square balls of a radius."""
    centre, around = np.array(centre), np.full(len(centre), square(radius))
    value, slope = system.values(centre, driven)
    near = inverse_near(slope)
    slopes = system.values(centre + around, driven)[1]
    image = (ball(np.eye(len(centre))) - near @ slopes) @ around - near @ value
    return largest(image) < arb(radius)


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
        points.append([(acb(0, 1) * (c + square(radius))).exp() for c in centre])
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
        from oracles.proof_checker_systems import check_systems

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
        middle = np.array([float(c.real.mid()) for c in centre])
        boxes.append((middle, np.full(len(centre), radius)))
    for box in left:
        boxes.append((np.array(box["centre"]), 1.001 * np.array(box["half"]) + 1e-12))

    def known(place, sizes):
        return any(
            np.all(
                (halves >= PERIOD / 2)
                | (np.abs(wrapped(place - centre)) + sizes <= halves - 1e-12)
            )
            for centre, halves in boxes
        )

    count = len(system.unknowns)
    # not about zero, where roots of special geometry lie on the sides of boxes
    start = ball(0.7 + 0.1 * np.arange(count))
    radii = np.full(count, arb.pi() * 1.0001)
    cover(lambda place: system.values(place, driven), start, radii, known, 1e-7)


PARTS = ((12, 4), (24, 6), (48, 8))
"""Parts of the length and of each width that a piece is cut into, until balls are small."""
MOST_CHECKED = 200000
SLACK = 1e-9
"""How far the centre of a piece may be off its arc here; the solver's is 1e-12."""
DEEPEST = 60


class Wide:
    """F and F' by all variables, the input last, over balls."""

    def __init__(self, system):
        self.system, self.names = system, system.unknowns + system.inputs
        system.unknowns = self.names

    def __call__(self, places):
        return self.system.values(places, {})


def coordinates(piece, place):
    apart = ball(place) - ball(piece["centre"])
    turns = np.round(mid(apart).astype(float) / PERIOD)
    return ball(piece["frame"]) @ (apart - 2 * arb.pi() * ball(turns))


def inside(piece, place, off):
    s, *y = coordinates(piece, place)
    fits = abs(s) + off < arb(piece["half"])
    return fits and all(abs(e) + off < arb(piece["radius"]) for e in y)


def cover(first, middle, radius, known, smallest):
    """Show that F has no zero in a box but where it is known."""
    waiting = [(middle, radius)]
    looked = 0
    while waiting:
        middle, radius = waiting.pop()
        looked += 1
        need(looked < MOST_CHECKED, "too many boxes")
        sizes = size(radius)
        if known(mid(middle).astype(float), sizes.astype(float)):
            continue
        if looked > 1:
            spread = about(sizes)
            image = first(middle)[0] + first(middle + spread)[1] @ spread
            if not all(value.contains(0) for value in image):
                continue
            need(max(sizes) > smallest, "a box is neither empty nor in a piece")
        side = np.arange(len(radius)) == np.argmax(radius.astype(float))
        halves = np.where(side, radius / 2, radius)
        waiting += [(middle + sense * side * halves, halves) for sense in (-1, 1)]


def boxed(piece, place, sizes):
    """Whether a box, in floats with a margin, lies in a piece."""
    frame = np.array(piece["frame"])
    limits = [piece["half"]] + [piece["radius"]] * (len(place) - 1)
    apart = frame @ wrapped(place - np.array(piece["centre"]))
    return bool(np.all(np.abs(apart) + np.abs(frame) @ sizes <= np.array(limits) - 1e-9))


class Arc:
    """The arc of a piece, enclosed over parts of its length."""

    def __init__(self, piece, wide):
        self.piece, self.wide, self.radius = piece, wide, arb(piece["radius"])
        self.t, self.across = ball(piece["frame"][0]), ball(piece["frame"][1:]).T
        self.centre = ball(piece["centre"])
        self.value, slope = wide(self.centre)
        self.near = inverse_near(slope @ self.across)
        self.one = ball(np.eye(len(self.near)))
        self.all = about([self.radius] * len(self.near))

    def is_one(self):
        """Whether the piece has one y for every s, by Krawczyk's operator over parts."""
        return any(self._is_one_by(*parts) for parts in PARTS)

    def _is_one_by(self, halves, cuts):
        half = arb(self.piece["half"])
        step = arb(0, half / halves)
        for part in range(halves):
            here = self.centre + half * (2 * part + 1 - halves) / halves * self.t
            image = self._image(here, here + step * self.t, step, cuts)
            if not np.all(size(image) < self.radius):
                return False
        return True

    def is_close(self):
        """Whether the arc is within SLACK of the centre at s = 0."""
        return np.all(size(self.near @ self.value) < SLACK / 4)

    def _image(self, here, axis, step, cuts):
        """What the operator makes of all y, with F' over parts of them."""
        whole = None
        for cell in itertools.product(range(cuts), repeat=len(self.near)):
            middle = self.radius * (2 * ball(cell) + 1 - cuts) / cuts
            y = middle + arb(0, (self.radius / cuts).upper())
            sides = self.wide(axis + self.across @ y)[1] @ self.across
            whole = sides if whole is None else union(whole, sides)
        change = self.wide(here)[0] + self.wide(axis)[1] @ self.t * step
        return (self.one - self.near @ whole) @ self.all - self.near @ change

    def at(self, s):
        """Balls of all variables where s is in a ball."""
        middle = arb(s.mid())
        axis, step = self.centre + middle * self.t, s - middle
        spread = axis + step * self.t
        y = self._narrowed(self.all, axis, spread, step)
        if any(each.rad() > 0.9 * self.radius for each in y):
            images = (self._image(axis, spread, step, cuts) for _, cuts in PARTS)
            small = (image for image in images if np.all(size(image) < self.radius))
            y = self._narrowed(next(small, self.all), axis, spread, step)
        return spread + self.across @ y

    def _narrowed(self, y, axis, spread, step):
        """Balls within those of y, by Krawczyk's operator as long as it narrows them."""
        for _ in range(30):
            before, fixed = y, mid(y)
            value, _ = self.wide(axis + self.across @ fixed)
            _, slope = self.wide(spread + self.across @ y)
            image = fixed - self.near @ (value + slope @ self.t * step)
            image += (self.one - self.near @ (slope @ self.across)) @ (y - fixed)
            y = shared(y, image)
            if not any(b.rad() < 0.9 * a.rad() for a, b in zip(before, y, strict=True)):
                break
        return y

    def rate(self, s, variable):
        """A ball of the rate of a variable, times what is never zero."""
        _, slope = self.wide(self.at(s))
        return matrix(np.delete(slope, variable, axis=1)).det()


def check_stops(arcs, following, variable, stops):
    """Show that a variable stops in the boxes given only, and in each of them."""

    def within(place, stop):
        off = np.abs(wrapped(mid(place).astype(float) - np.array(stop["place"])))
        radii = np.array([float(p.rad()) for p in place])
        return np.all(off + radii <= stop["off"] + 1e-9)

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
            if inner and all(abs(e) < arc.radius for e in y):
                signs = [arc.rate(arb(s.mid()) + side, variable) for side in (-away, away)]
                break
        need(signs is not None, "a stop that is on no piece")
        need(not any(sign.contains(0) for sign in signs), "a stop that is not shown")
        need((signs[0] > 0) != (signs[1] > 0), "no change of sign at a stop")


def check_singularities(wide, system, certificate, chains):
    """Show all stops of the input, and of the outputs that a pair measures."""
    links = list(system.sizes.data.get("outputs", {}).items())
    curves = zip(certificate["curves"], chains, strict=True)
    for number, (curve, chain) in enumerate(curves):
        check_stops(*chain, len(wide.names) - 1, curve["input_stops"])
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
            check_stops(*chain, wide.names.index(pairs[0]), own)


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
        from oracles.proof_checker_gears import check_stated

        tolerance = certificate["tolerance_rad"]
        check_stated(certificate["wheels"], system.follower, laps, tolerance)
        system.lap(laps)
    low, high = low / laps, high / laps
    need(high - low < 2 * arb.pi() + 1e-9, "a range after which all is back")
    wide = Wide(system)
    pieces, chains = [], []
    for curve in certificate["curves"]:
        chain, arcs = curve["pieces"], []
        for piece in chain:
            need(piece["half"] > 0 and piece["radius"] > 0, "an empty piece")
            frame = ball(piece["frame"])
            off = frame @ frame.T - np.eye(len(frame), dtype=int)
            need(np.all(size(off) < 1e-13), "a frame that is not orthonormal")
            arcs.append(Arc(piece, wide))
            need(arcs[-1].is_one(), "a piece without one arc")
            need(arcs[-1].is_close(), "a centre that is off its arc")
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
        chains.append((arcs, following))
    count = len(wide.names) - 1
    middle = np.array([arb(0)] * count + [(low + high) / 2])
    radius = np.array([arb.pi()] * count + [(high - low) / 2])
    cover(wide, middle, radius, lambda *box: any(boxed(p, *box) for p in pieces), 1e-4)
    if "singularities" in certificate:
        check_singularities(wide, system, certificate, chains)


def check(certificate):
    """Raise `Refused` if what a certificate says is not shown by it."""
    before = ctx.prec
    try:
        need(certificate["certificate"] == 1, "another format")
        if certificate["statement"] == "curves over a range":
            check_curves(certificate)
        elif certificate["statement"] == "modes over boxes":
            from oracles.proof_checker_systems import check_map

            check_map(certificate)
        elif certificate["statement"] == "wheels fix all angles":
            from oracles.proof_checker_wheels import check_wheels

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
