"""Checks certificates of spherekit without it, with the balls of python-flint.

A ball is a number with a rigorous bound of its error; every operation on balls is rigorous.
Links are placed by rotation matrices with dual numbers of balls. Roots are proven by
Krawczyk's operator: if it maps a box into itself, the box has exactly one zero.

A dual array (1 + n, ...) has its value first, and then its derivatives by n unknowns.
A certificate is a dictionary as its JSON file has it; its construction says how links are
placed one after another (`steps`), and which pair angles are unknown.
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


def need(condition, message):
    """Raise `Refused` with a message unless a condition of a certificate is fulfilled."""
    if not condition:
        raise Refused(message)


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


def farthest_coordinate_axis(axis):
    """The x, y or z axis that is nearest to a right angle with a vector."""
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
        """Read the links and pairs of a mechanism file.

        Parameters
        ----------
        text
            Text of the TOML file; its decimal numbers are not rounded.
        tolerance
            Uncertainty (rad) of all sizes.
        couplers
            Two circles that slide on each other (Cs) move like a bar between their centres.
            By such a contact: the name of this bar, its coupler, and the names of the two
            pairs at its ends.
        wheels
            Whether rolling contacts (Cr) may occur. Without wheels in the construction of a
            certificate, nothing would place them.
        """
        self.data = tomllib.loads(text, parse_float=str)
        # A ball about zero that is added to sizes, so that all true sizes are included.
        self.slack = arb(0, tolerance) if tolerance else arb(0)
        pairs = self.data["pairs"]
        hinges = [name for name, pair in pairs.items() if pair["type"] in ("R", "P")]
        self.ends = {name: tuple(pairs[name]["links"]) for name in hinges}
        self.links = list(self.data["links"])
        self.couplers = {}  # contact and side by the name of a coupler's pair
        for contact, coupler in (couplers or {}).items():
            need(pairs[contact]["type"] == "Cs", "a coupler for what does not slide")
            need(coupler["link"] not in self.links, "a coupler that is another link")
            self.links.append(coupler["link"])
            sides = zip(coupler["pairs"], pairs[contact]["links"], strict=True)
            for side, (name, link) in enumerate(sides):
                need(name not in self.ends, "a pair of a coupler that is another pair")
                self.ends[name] = (link, coupler["link"])
                self.couplers[name] = (contact, side)
        rolling = [name for name, pair in pairs.items() if pair["type"] == "Cr"]
        count = len(hinges) + len(couplers or {}) + (len(rolling) if wheels else 0)
        need(len(pairs) == count, "only R pairs and couplers")

    def circle(self, contact, link):
        """Return the centre (3,) and the radius (rad) of the circle of a contact on a link.

        The centre is given by an axis of the link, or as a vector or longitude and latitude
        under a key such as `centre_xyz` or `pole_lonlat`. A great circle states no radius,
        which is 90 degrees. The circle of a roller, a link that follows a curve, may be
        stated under the key `follower`.
        """
        item = self.data["pairs"][contact]
        follower = item.get("follower", {})
        is_follower = follower.get("link") == link
        profile = follower if is_follower else item["profiles"][link]
        if "axis" in profile:
            need("radius" in profile, "no radius")
            centre = self.frame(profile["axis"], link)[:, 2]
            return centre, self.angle(profile["radius"])
        kind = profile.get("kind", "circle")
        need(kind in ("circle", "great_circle"), "no circle")
        key = next(k for k in profile if k.startswith(("centre_", "pole_")))
        centre = self.direction(profile[key], key.endswith("xyz"))
        radius = profile.get("radius", profile.get("roller"))
        if radius is None:
            return centre, arb.pi() / 2
        return centre, self.angle(radius) + self.slack

    def direction(self, row, is_xyz):
        if is_xyz:
            return unit(np.array([number(e) for e in row])) + self.slack
        (s, c), (up, out) = ((self.angle(e) + self.slack).sin_cos() for e in row)
        return np.array([c * out, s * out, up])

    def coupler_frame(self, pair, link):
        """Return the frame (3, 3) of a coupler's pair in a link, in columns.

        The coupler is the bar between the centres of two circles that slide on each other.
        It has a pair at each centre. The axis of a pair is the centre of the circle. Its
        angle is the azimuth of the point of contact about the centre, from the x axis of
        the frame.
        """
        contact, side = self.couplers[pair]
        item = self.data["pairs"][contact]
        first_circle, second_circle = (self.circle(contact, x) for x in item["links"])
        if link in item["links"]:
            axis = (first_circle, second_circle)[side][0]
            x = across(axis)
        else:
            # In the coupler the first centre is z. The second one is at (0, s, c), at the
            # arc of the sum or the difference of both radii. The x axis of each frame is
            # perpendicular to its centre and points to the contact, which is on the great
            # circle through both centres.
            first_radius, second_radius = first_circle[1], second_circle[1]
            is_internal = item.get("contact", "external") == "internal"
            if is_internal:
                s, c = (first_radius - second_radius).sin_cos()
                towards_contact = ([0, 1, 0], [0, c, -s])
            else:
                s, c = (first_radius + second_radius).sin_cos()
                towards_contact = ([0, 1, 0], [0, -c, s])
            axis = ball(([0, 0, 1], [0, s, c])[side])
            x = ball(towards_contact[side])
        return np.stack([x, np.cross(axis, x), axis], axis=1)

    def angle(self, text):
        degrees = self.data["angle_unit"] == "deg"
        return number(text) * (arb.pi() / 180 if degrees else 1)

    def axes(self, link):
        """Return the axes (3,) of a link by their pairs, the first axis on z.

        The position of every other axis is its arc from the first axis and its angle about
        the first axis. The second axis has the angle 0, towards y. The file gives angles
        from the third axis on.
        """
        item = self.data["links"][link]
        first_pair, *pairs = item["axes"]
        turns = ["0", *item.get("angles", [])]
        axes = {first_pair: ball([0, 0, 1])}
        # `slack` is the uncertainty of sizes. The angle 0 of the second axis is exact.
        for pair, arc, turn in zip(pairs, item.get("arcs", []), turns, strict=False):
            s, c = (self.angle(arc) + self.slack).sin_cos()
            turn_slack = self.slack if turn != "0" else 0
            st, ct = (self.angle(turn) + turn_slack).sin_cos()
            axes[pair] = np.array([-s * st, s * ct, c])
        return axes

    def frame(self, pair, link):
        """Return the frame (3, 3) of a pair in a link, in columns x, y, z.

        z is the axis of the pair, and x lies towards the first other axis of the link. In a
        file that gives axes in a reference pose, x is chosen from the axis alone, so both
        frames of a pair are equal there. The file may state a zero position: the angle by
        which x and y are rotated about the axis. It belongs to the first link of the pair
        in a file with sizes, and to the second link (`value`) in a file with a pose.
        """
        if pair in self.couplers:
            return self.coupler_frame(pair, link)
        item = self.data["pairs"][pair]
        is_second = self.ends[pair][1] == link
        if "axes" in self.data["links"][link]:
            axes = self.axes(link)
            axis = axes.pop(pair)
            normals = [np.cross(axis, other_axis) for other_axis in axes.values()]
            # Axes that coincide with the axis of the pair give no direction: their normal
            # is zero up to rounding.
            towards = [np.cross(n, axis) for n in normals if n @ n > 1e-18]
            zero = None if is_second else item.get("zero")
        else:
            key = "xyz" if "xyz" in item else "lonlat"
            axis = self.direction(item[key], key == "xyz")
            towards = []
            zero = item.get("value") if is_second else None
        # The last candidate is only used if there is no other: any fixed direction will do.
        x = unit([*towards, np.cross(axis, farthest_coordinate_axis(axis))][0])
        y = np.cross(axis, x)
        if zero is not None:
            s, c = (self.angle(zero) + self.slack).sin_cos()
            x, y = c * x + s * y, c * y - s * x
        return np.stack([x, y, axis], axis=1)


class System:
    """The equations of a certificate's construction."""

    def __init__(self, certificate):
        """Read the construction of a certificate and check that it places every link.

        Each step places a link `by` one or two pairs `on` links that are placed already.
        With one pair (`turned`) the angle of the pair is a variable. With two pairs
        (`onto`) the link closes a loop, which gives one equation. There are as many
        equations as unknown angles. Through two wheels in mesh the angle of one pair, the
        follower, follows from the input.
        """
        self.made = certificate["construction"]
        text = certificate["mechanism"]
        tolerance = certificate["tolerance_rad"]
        followers = self.made["follow"]
        self.sizes = Sizes(text, tolerance, self.made["couplers"], bool(followers))
        self.unknowns = self.made["unknowns"]
        self.inputs = list(certificate["inputs"])
        self.follower = None
        self.turning = {}
        if followers:
            from oracles.proof_checker_gears import follower_of

            self.follower = follower_of(self.sizes, self.inputs)
            need(followers == [self.follower.pair], "other wheels follow")
        # The input itself is the variable, until `lap` is called with more laps.
        self.lap(1)

        ends = self.sizes.ends
        placed = {self.made["root"]}
        used_pairs = []
        turned = []
        self.onto = []
        for step in self.made["steps"]:
            link, on, by = step["link"], step["on"], step["by"]
            need(link in self.sizes.links and link not in placed, f"{link} placed twice")
            need(len(on) == len(by) in (1, 2) and set(on) <= placed, f"{link} on nothing")
            for parent, pair in zip(on, by, strict=True):
                need(set(ends[pair]) == {link, parent}, f"{pair} does not join them")
            if len(by) == 1:
                turned.append(step)
            else:
                self.onto.append(step)
            placed.add(link)
            used_pairs += by
        need(placed == set(self.sizes.links), "links are missing")
        need(sorted(used_pairs) == sorted(ends), "pairs are missing or used twice")
        angles = [step["by"][0] for step in turned]
        variables = self.unknowns + self.inputs + followers
        need(sorted(angles) == sorted(variables), "other unknowns")
        need(len(self.onto) == len(self.unknowns), "not as many equations as unknowns")
        self.frames = {}
        for pair, links in ends.items():
            for link in links:
                self.frames[pair, link] = self.sizes.frame(pair, link)

    def lap(self, laps):
        """Count by a variable that goes round once while the input turns `laps` times.

        With wheels, configurations repeat after several revolutions of the input. `turning`
        gets for the input and for the follower: the variable, and the rate and the offset
        (rad) of the angle as a function of it.
        """
        if self.follower is None:
            return
        driven, ratio = self.follower.driven, self.follower.ratio * laps
        rate = arb(ratio.numerator) / ratio.denominator
        self.turning = {
            driven: (driven, arb(laps), arb(0)),
            self.follower.pair: (driven, rate, self.follower.offset),
        }

    def bound(self):
        """Largest number of solutions: the permanent of the degrees in half tangents."""
        return permanent_of(self.degrees())

    def degrees(self):
        """Return the degrees of each equation (rows) in the half tangents of the unknowns.

        Half tangents are tan(angle / 2). An equation contains the angles on the two paths
        from its axes to their last common link, each with the degree 2. A path is a list of
        links from the root, each with the pairs whose angles its orientation depends on. A
        link that closes a loop depends on all angles of the loop.
        """
        paths = {self.made["root"]: []}
        table = []
        for step in self.made["steps"]:
            if len(step["by"]) == 1:
                path = paths[step["on"][0]]
                paths[step["link"]] = [*path, (step["link"], (step["by"][0],))]
                continue
            common, first, second = split_common_start(
                *(paths[parent] for parent in step["on"])
            )
            angles = [name for _, names in first + second for name in names]
            table.append([2 * angles.count(name) for name in self.unknowns])
            paths[step["link"]] = [*common, (step["link"], tuple(angles))]
        return table

    def values(self, unknown, driven):
        """F (k,) and F' (k, unknowns) at balls of the unknowns."""
        angles = {**dict(zip(self.unknowns, unknown, strict=True)), **driven}
        links = [step["link"] for step in self.onto]
        return PolynomialEquations(self, links, [], [], self.unknowns).values([], angles)


class PolynomialEquations:
    """Equations of links, polynomials in the e^(i angle) of pairs or in their inverses.

    A dual array has its value at index 0 of the first axis, then its derivatives by these
    numbers of the unknowns, then by the angles of the pairs `moving`.
    """

    def __init__(self, system, links, unknowns, inverse, moving=()):
        self.system, self.links, self.inverse = system, links, inverse
        self.unknowns, self.moving = unknowns, list(moving)
        # Number of derivatives of a dual array.
        self.count = len(unknowns) + len(self.moving)
        self.steps = {step["link"]: step for step in system.made["steps"]}

    def values(self, centre, driven):
        """P and its derivatives at balls of the points and of all other angles."""
        self.points = dict(zip(self.unknowns, centre, strict=True))
        self.driven, self.done = driven, {}
        return parts_of([self._place_on_axes(link)[0] for link in self.links])

    def _matrix_and_scale(self, link):
        """The matrix of a link in the one before, times its scale, and the scale."""
        if link not in self.done:
            turned = len(self.steps[link]["by"]) == 1
            self.done[link] = (
                self._turn_about_pair(link) if turned else self._place_on_axes(link)[1:]
            )
        return self.done[link]

    def _turn_about_pair(self, link):
        """Return the matrix of a link placed by one pair, and its scale, as dual arrays.

        For an unknown angle with e^(i angle) = a / b, the rotation times a b is polynomial
        in a and b: w = a b, c = (a^2 + b^2) / 2 and s = (a^2 - b^2) / 2i replace 1, cos and
        sin. The scale is w. The number z of an unknown is e^(i angle), with a = z and
        b = 1, or its inverse, with a = 1 and b = z. Other angles are given, with the
        scale 1.

        The first index of a dual array is 0 for the value. It is 1 + k for the derivative
        by the unknown k, and follows the unknowns for the derivatives by `moving` angles.
        """
        step = self.steps[link]
        (pair,) = step["by"]
        (parent,) = step["on"]
        # The angle of a pair counts from its first link to its second.
        sense = 1 if self.system.sizes.ends[pair][0] == parent else -1
        before = constant(self.system.frames[pair, parent], self.count)
        after = constant(self.system.frames[pair, link].T, self.count)
        scale = constant(ball([[1]]), self.count)
        if pair in self.points:
            column = self.unknowns.index(pair)
            z = self.points[pair]
            one = acb(1)
            if self.inverse[column]:
                a, b, da, db = one, z, 0, one
            else:
                a, b, da, db = z, one, one, 0
            c = (a * a + b * b) / 2
            s = (a * a - b * b) / acb(0, 2)
            w = a * b
            dc = a * da + b * db
            ds = (a * da - b * db) / acb(0, 1)
            dw = a * db + da * b
            turn = constant(spin(c, sense * s, w), self.count)
            turn[1 + column] = spin(dc, sense * ds, dw)
            scale[0] = w
            scale[1 + column] = dw
        else:
            # A wheel turns by `rate` times the angle of the input, and `offset`.
            default = (pair, arb(1), arb(0))
            variable, rate, offset = self.system.turning.get(pair, default)
            s, c = (self.driven[variable] * rate + offset).sin_cos()
            turn = constant(spin(c, sense * s, 1), self.count)
            if variable in self.moving:
                column = 1 + len(self.unknowns) + self.moving.index(variable)
                turn[column] = rate * spin(-s, sense * c, 0)
        return times(times(before, turn), after), scale

    def _path(self, link):
        step = self.steps.get(link)
        if step is None:
            return []
        if len(step["by"]) == 1:
            return [*self._path(step["on"][0]), link]
        return [*split_common_start(*map(self._path, step["on"]))[0], link]

    def _place_on_axes(self, link):
        """Return the equation of a link placed on two axes, its matrix, and its scale.

        The matrix times vectors in the link gives vectors in the last common link of both
        paths, multiplied by the scale, the denominator that rotations by unknown angles
        have. Both axes are transformed to this link. All results are dual arrays.
        """
        step = self.steps[link]
        _, *paths = split_common_start(*map(self._path, step["on"]))
        axes_in_common = []
        scales = []
        for path, pair, parent in zip(paths, step["by"], step["on"], strict=True):
            axis = constant(self.system.frames[pair, parent][:, 2:], self.count)
            scale = constant(ball([[1]]), self.count)
            for path_link in reversed(path):
                matrix_of_link, scale_of_link = self._matrix_and_scale(path_link)
                axis = times(matrix_of_link, axis)
                scale = times(scale, scale_of_link)
            axes_in_common.append(axis)
            scales.append(scale)
        axes = [self.system.frames[pair, link][:, 2] for pair in step["by"]]
        equation, placed = place_on_axes(link, axes, axes_in_common, scales)
        return equation, placed, times(*scales)


def spin(c, s, still):
    """A matrix about the third axis."""
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, still]], dtype=object)


def place_on_axes(link, axes, axes_in_common, scales):
    """Return the closure equation of a link on two axes, and its matrix, as dual arrays.

    A dual array has its value first, and then its derivatives by the unknowns. The equation
    says that the two axes keep the arc of the link. The matrix takes vectors in the link to
    vectors in the other link. Both results are multiplied by both scales.

    Parameters
    ----------
    link
        Name of the link, for messages.
    axes
        Two axes (3,) in the link.
    axes_in_common, scales
        Two dual columns and two dual numbers: the same axes in another link, each times its
        scale. A scale is the common denominator of the column.
    """
    both_scales = times(*scales)
    cosine = times(axes_in_common[0].swapaxes(1, 2), axes_in_common[1])
    equation = cosine - both_scales * (axes[0] @ axes[1])
    normal = np.cross(*axes)
    need((normal @ normal).real > 0, f"the arc of {link} may be 0 or 180 degrees")
    # The matrix takes both axes and their vector product to the same vectors in the other
    # link, which are its columns in the basis of the three.
    inverse_basis = inverse(np.stack([*axes, normal], axis=1))
    columns = (
        times(axes_in_common[0], scales[1]),
        times(axes_in_common[1], scales[0]),
        crossed(*axes_in_common),
    )
    return equation, np.concatenate(columns, axis=2) @ inverse_basis


def parts_of(duals):
    """Values (k,) and derivatives (k, n) of dual arrays of one entry each."""
    table = np.array([dual[:, 0, 0] for dual in duals]).reshape(len(duals), -1)
    return table[:, 0], table[:, 1:]


def split_common_start(one, other):
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


def has_one_solution(system, centre, radius, driven):
    """Whether Krawczyk's operator proves one solution in the square balls of a radius."""
    centre, around = np.array(centre), np.full(len(centre), square(radius))
    value, slope = system.values(centre, driven)
    near = inverse_near(slope)
    slopes = system.values(centre + around, driven)[1]
    image = (ball(np.eye(len(centre))) - near @ slopes) @ around - near @ value
    return largest(image) < arb(radius)


def check_modes(certificate):
    """Check a certificate that counts the assembly modes at given inputs.

    Each stated root must be proven by Krawczyk's operator, real or certainly not real, and
    different from all others. The count is complete if there are as many roots as the
    polynomial bound allows, or if no other real root exists outside the undecided boxes.
    """
    need(certificate["statement"] == "modes at inputs", "another statement")
    # Somewhat more bits than the certificate was computed with.
    ctx.prec = certificate["precision_bits"] + 40
    system = System(certificate)
    driven = {k: system.sizes.angle(v) for k, v in certificate["inputs"].items()}
    need(system.bound() == certificate["bound"], "another bound")
    roots = certificate["roots"]
    points = []
    for root in roots:
        need(len(root["centre"]) == len(system.unknowns), "other unknowns")
        centre = [acb(dyadic(re), dyadic(im)) for re, im in root["centre"]]
        radius = root["radius"]
        need(0 < radius < 0.1, "a radius out of range")
        # The ball is a disk for each angle. A square with the half side 0.7 of its radius
        # is inside, because 0.7 is less than 1 / sqrt(2).
        need(has_one_solution(system, centre, 0.7 * radius, driven), "a root is not shown")
        imaginary = [arb(c.imag) + arb(0, radius) for c in centre]
        if root["real"]:
            need(all(c.imag == 0 for c in centre), "a real root off the real axis")
        else:
            need(any(not i.contains(0) for i in imaginary), "a root that may be real")
        points.append([(acb(0, 1) * (c + square(radius))).exp() for c in centre])
    for first, second in combinations(points, 2):
        is_apart = any(not a.overlaps(b) for a, b in zip(first, second, strict=True))
        need(is_apart, "two roots may be one")

    real_roots = [root for root in roots if root["real"]]
    need(certificate["modes"] == len(real_roots), "another number of modes")
    is_counted = len(roots) == certificate["bound"]
    need(certificate["counted"] == is_counted, "not counted")
    undecided_boxes = certificate["undecided_rad"]
    is_complete = is_counted or not undecided_boxes
    need(certificate["complete"] == is_complete, "not complete")
    # The equations may have been solved in several systems, one after the other.
    if certificate["systems"]:
        need(system.follower is None, "systems with wheels are not checked")
        from oracles.proof_checker_systems import check_systems

        check_systems(system, certificate, driven)
    elif not is_counted:
        exclude_other_modes(system, driven, real_roots, undecided_boxes)


def exclude_other_modes(system, driven, real_roots, undecided_boxes):
    """Show that every real mode lies in the ball of a root, or in an undecided box.

    Around each root the largest box is sought that has no second root. The rest of the
    torus of all angles is divided until each part has no zero or lies in such a box.

    Parameters
    ----------
    system, driven
        Equations, and balls of the input angles by their pairs.
    real_roots
        The roots of the certificate with real angles.
    undecided_boxes
        Boxes of the certificate in which roots are not decided.
    """
    ctx.prec = 80
    boxes = []  # centre and half widths (unknowns,) in rad
    for root in real_roots:
        centre = [acb(dyadic(re)) for re, _ in root["centre"]]
        radius = 0.04
        while not has_one_solution(system, centre, radius, driven):
            radius /= 2
            need(radius > root["radius"], "a root is not alone")
        middle = np.array([float(c.real.mid()) for c in centre])
        boxes.append((middle, np.full(len(centre), radius)))
    # Undecided boxes are enlarged a little, and tested with a margin below, so that the
    # rounding of floats does not matter where the two have a side in common.
    for box in undecided_boxes:
        boxes.append((np.array(box["centre"]), 1.001 * np.array(box["half"]) + 1e-12))

    def is_in_a_box(middle, half_widths):
        """Whether a part, in floats, is in one of the boxes. Half a turn is all angles."""
        for centre, halves in boxes:
            reach = np.abs(wrapped(middle - centre)) + half_widths
            if np.all((halves >= PERIOD / 2) | (reach <= halves - 1e-12)):
                return True
        return False

    count = len(system.unknowns)
    # The box of all angles is halved repeatedly. It is not centred at zero: in special
    # geometries roots may be at angles such as 0, and would be on the sides of parts.
    start = ball(0.7 + 0.1 * np.arange(count))
    radii = np.full(count, arb.pi() * 1.0001)
    exclude_zeros(
        lambda place: system.values(place, driven),
        middle=start,
        radius=radii,
        is_in_known_box=is_in_a_box,
        smallest=1e-7,
    )


PARTS = ((12, 4), (24, 6), (48, 8))
"""Parts of the length and of each width that a piece is cut into, until balls are small."""
MOST_CHECKED = 200000
SLACK = 1e-9
"""How far the centre of a piece may be off its arc here; the solver's is 1e-12."""
DEEPEST = 60


class ClosureEquations:
    """The closure equations F and their derivatives F' by all variables, over balls.

    Variables are the unknown pair angles and, as the last, the input.
    """

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


def exclude_zeros(evaluate, middle, radius, is_in_known_box, smallest):
    """Show that a function has no zero in a box, except in boxes whose zeros are known.

    Parts are halved across their longest side until the mean-value form
    F(middle) + F'(part) (part - middle) excludes a zero, or the part is in a known box.

    Parameters
    ----------
    evaluate
        Function of balls (n,) that returns F and its derivatives.
    middle, radius
        (n,) balls: centre and half widths of the box.
    is_in_known_box
        Function of the centre and half widths of a part, in floats, that returns whether
        the part is in a box whose zeros are known.
    smallest
        Half width (rad) below which the check gives up.
    """
    waiting = [(middle, radius)]
    examined = 0
    while waiting:
        middle, radius = waiting.pop()
        examined += 1
        need(examined < MOST_CHECKED, "too many boxes")
        half_widths = size(radius)
        if is_in_known_box(mid(middle).astype(float), half_widths.astype(float)):
            continue
        # The whole box is not tested: derivatives over it tell nothing.
        if examined > 1:
            spread = about(half_widths)
            image = evaluate(middle)[0] + evaluate(middle + spread)[1] @ spread
            if not all(value.contains(0) for value in image):
                continue
            need(max(half_widths) > smallest, "a box is neither empty nor in a piece")
        is_longest = np.arange(len(radius)) == np.argmax(radius.astype(float))
        halved = np.where(is_longest, radius / 2, radius)
        waiting += [(middle + sign * is_longest * halved, halved) for sign in (-1, 1)]


def is_box_inside(piece, place, sizes):
    """Whether a box, in floats with a margin, lies in a piece."""
    frame = np.array(piece["frame"])
    limits = [piece["half"]] + [piece["radius"]] * (len(place) - 1)
    apart = frame @ wrapped(place - np.array(piece["centre"]))
    return bool(np.all(np.abs(apart) + np.abs(frame) @ sizes <= np.array(limits) - 1e-9))


class Arc:
    """The arc of a configuration curve in a piece, enclosed over parts of its length.

    Points of a piece are centre + s axis + across y, where s is the coordinate along the
    straight axis of the piece and y are those across it, up to `radius`. The arc is the set
    of points with F = 0, one y for each s.

    Attributes
    ----------
    axis, across
        Unit vector (variables,) of the axis, and the unit vectors (variables, y) across it.
    value
        F at the centre.
    equations
        F and F' over balls, `ClosureEquations`.
    inverse_slope
        Approximate inverse of F' across the axis, by which Krawczyk's operator is
        preconditioned.
    identity
        Identity matrix of the size of `inverse_slope`.
    all_y
        Balls of all y of the piece.
    """

    def __init__(self, piece, equations):
        self.piece, self.equations, self.radius = piece, equations, arb(piece["radius"])
        self.axis, self.across = ball(piece["frame"][0]), ball(piece["frame"][1:]).T
        self.centre = ball(piece["centre"])
        self.value, slope = equations(self.centre)
        self.inverse_slope = inverse_near(slope @ self.across)
        self.identity = ball(np.eye(len(self.inverse_slope)))
        self.all_y = about([self.radius] * len(self.inverse_slope))

    def has_one_point_for_each_s(self):
        """Whether the piece has one y for every s, by Krawczyk's operator over parts."""
        return any(self._has_one_point_with_cuts(*parts) for parts in PARTS)

    def _has_one_point_with_cuts(self, halves, cuts):
        half = arb(self.piece["half"])
        step = arb(0, half / halves)
        for part in range(halves):
            axis_point = self.centre + half * (2 * part + 1 - halves) / halves * self.axis
            image = self._image(axis_point, axis_point + step * self.axis, step, cuts)
            if not np.all(size(image) < self.radius):
                return False
        return True

    def passes_centre(self):
        """Whether the arc is within SLACK of the centre at s = 0."""
        return np.all(size(self.inverse_slope @ self.value) < SLACK / 4)

    def _image(self, axis_point, axis_points, step, cuts):
        """Return Krawczyk's operator on all y of the piece, over a part of its axis.

        A point of the piece has the coordinate s along the axis and the coordinates y
        across it. The operator is (1 - C F'_y) Y - C F, where C is an approximate inverse
        of the derivatives F'_y by y, Y are balls of all y, and F is that on the axis. If
        the result is inside Y, there is exactly one y with F = 0 for each s.

        Parameters
        ----------
        axis_point, axis_points
            Middle of the part of the axis, and balls of all its points.
        step
            Ball of s in the part, relative to its middle.
        cuts
            Parts that each y is cut into; F' is evaluated on each of them.
        """
        # F'_y over all y is the union of those over cells. Each y is cut into equal
        # intervals with numbers from 0 to `cuts` - 1. Smaller balls give sharper bounds.
        slopes = None
        for cell in itertools.product(range(cuts), repeat=len(self.inverse_slope)):
            middle = self.radius * (2 * ball(cell) + 1 - cuts) / cuts
            y = middle + arb(0, (self.radius / cuts).upper())
            part_slopes = self.equations(axis_points + self.across @ y)[1] @ self.across
            slopes = part_slopes if slopes is None else union(slopes, part_slopes)
        # F on this part of the axis, by the mean-value form.
        change = (
            self.equations(axis_point)[0]
            + self.equations(axis_points)[1] @ self.axis * step
        )
        return (
            self.identity - self.inverse_slope @ slopes
        ) @ self.all_y - self.inverse_slope @ change

    def at(self, s):
        """Return balls of all variables for arc lengths in a ball s."""
        middle_s = arb(s.mid())
        step = s - middle_s
        axis_point = self.centre + middle_s * self.axis
        axis_points = axis_point + step * self.axis
        y = self._narrowed(self.all_y, axis_point, axis_points, step)
        if any(item.rad() > 0.9 * self.radius for item in y):
            # The balls are hardly smaller: begin with derivatives over parts of the width.
            images = (self._image(axis_point, axis_points, step, cuts) for _, cuts in PARTS)
            small = (image for image in images if np.all(size(image) < self.radius))
            y = self._narrowed(next(small, self.all_y), axis_point, axis_points, step)
        return axis_points + self.across @ y

    def _narrowed(self, y, axis_point, axis_points, step):
        """Return smaller balls of the y with F = 0, for all s of a range.

        A point has the coordinate s along the axis of the piece and the coordinates y
        across it. Krawczyk's operator maps balls of y to balls that contain the same
        solutions of F = 0: m - C F(m) + (1 - C F'_y) (y - m), with the middles m of the
        balls and an approximate inverse C of the derivatives F'_y. It is applied as long as
        it narrows a ball to less than 0.9 of its radius, at most 30 times. Further steps
        would hardly narrow the balls.

        Parameters
        ----------
        y
            Balls of the coordinates across the axis.
        axis_point, axis_points
            Point of the axis at the middle of the range, and balls of its points for all s.
        step
            Ball of s relative to the middle of the range.
        """
        for _ in range(30):
            previous = y
            middle_y = mid(y)
            value, _ = self.equations(axis_point + self.across @ middle_y)
            _, slope = self.equations(axis_points + self.across @ y)
            image = middle_y - self.inverse_slope @ (value + slope @ self.axis * step)
            image += (self.identity - self.inverse_slope @ (slope @ self.across)) @ (
                y - middle_y
            )
            y = shared(y, image)
            if not any(b.rad() < 0.9 * a.rad() for a, b in zip(previous, y, strict=True)):
                break
        return y

    def rate(self, s, variable):
        """Return a ball of the rate of a variable along the arc, up to a factor.

        The rate is the determinant of F' without the column of the variable, times a factor
        that is never zero. It is zero where the variable stops.
        """
        _, slope = self.equations(self.at(s))
        return matrix(np.delete(slope, variable, axis=1)).det()


def check_stops(arcs, following, variable, stops):
    """Show that a variable stops only in the given boxes of a curve, and once in each.

    Along the curve, F = 0 for the closure equations F. The rates of the variables solve
    F' x = 0, so the rate of one variable is a determinant of F' without its column, up to a
    common factor. Outside of the boxes the rate is shown to have no zero, by halving parts
    of the arcs. On both sides of a box it has opposite signs.

    Parameters
    ----------
    arcs, following
        `Arc` of each piece of a curve, and the piece that follows it.
    variable
        Number of the variable.
    stops
        Boxes with the centre `place` (variables,) and the half width `off` (rad).
    """

    # Small numbers are margins: 1e-9 for the rounding of floats, `SLACK` for the distance
    # of the centre of a piece from its arc.
    def is_within(place, stop):
        """Whether balls of a point are within the box of a stop."""
        gap = np.abs(wrapped(mid(place).astype(float) - np.array(stop["place"])))
        radii = np.array([float(item.rad()) for item in place])
        return np.all(gap + radii <= stop["off"] + 1e-9)

    for arc, next_piece in zip(arcs, following, strict=False):
        end = coordinates(arc.piece, next_piece["centre"])[0] + arb(0, SLACK)
        waiting = [(arb(0) - arb(0, SLACK), end, 0)]
        while waiting:
            low, high, depth = waiting.pop()
            s = low.union(high)
            if not arc.rate(s, variable).contains(0):
                continue
            if stops:
                place = arc.at(s)
                if any(is_within(place, stop) for stop in stops):
                    continue
            need(depth < DEEPEST, "a variable may stop where none is said to")
            middle = arb(s.mid())
            waiting += [(low, middle, depth + 1), (middle, high, depth + 1)]
    # The signs are compared at a distance beyond the box, on an arc that reaches so far.
    for stop in stops:
        distance = 4.0 * stop["off"] + 1e-8
        rates = None
        for arc in arcs:
            s, *y = coordinates(arc.piece, stop["place"])
            is_on_arc = abs(s) + 2 * distance < arb(arc.piece["half"])
            if is_on_arc and all(abs(item) < arc.radius for item in y):
                middle = arb(s.mid())
                rates = [arc.rate(middle + x, variable) for x in (-distance, distance)]
                break
        need(rates is not None, "a stop that is on no piece")
        need(not any(rate.contains(0) for rate in rates), "a stop that is not shown")
        need((rates[0] > 0) != (rates[1] > 0), "no change of sign at a stop")


def check_singularities(equations, system, certificate, chains):
    """Show all stops of the input on each curve, and those of some outputs.

    A variable stops where its rate along the curve is zero. A stop of the input is a dead
    centre; a stop of an output is a singularity of type I. Outputs are checked whose links
    are joined by an R pair, so that the variable of the pair is the output. At a crossing
    it may be open whether a stop is of type I or III ("I or III").

    Parameters
    ----------
    equations, system
        Closure equations with the input as last variable, and their system.
    certificate
        Certificate with the stops of each curve.
    chains
        For each curve its arcs, one for each piece, and the pieces that follow them.
    """
    outputs = list(system.sizes.data.get("outputs", {}).items())
    singularities = certificate["singularities"]["found"]
    curves = zip(certificate["curves"], chains, strict=True)
    for number, (curve, (arcs, following)) in enumerate(curves):
        input_variable = len(equations.names) - 1
        check_stops(arcs, following, input_variable, curve["input_stops"])
        for name, output in outputs:
            reference = output.get("relative_to", system.sizes.data["ground"])
            links = {output["link"], reference}
            pairs = [p for p, ends in system.sizes.ends.items() if set(ends) == links]
            if not pairs or pairs[0] not in equations.names[:-1]:
                continue
            stops = [
                item
                for item in singularities
                if item["output"] == name
                and item["curve"] == number
                and item["type"] in ("I", "I or III")
            ]
            check_stops(arcs, following, equations.names.index(pairs[0]), stops)


def check_curves(certificate):
    """Check a certificate of all configuration curves over a range of the input.

    A curve is a chain of pieces: straight boxes along the curve, each with exactly one
    point of the curve for every position s along its axis. It is shown that

    - each piece has such an arc, which passes its centre up to `SLACK`,
    - each piece begins within the piece before it, and further along the curve,
    - a curve that is not closed leaves the range of the input at both ends,
    - no curve is listed twice,
    - there are no configurations in the range outside of the pieces.

    If the certificate lists singularities, these are checked, too.
    """
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
    # The variable of the curves goes round once while the input turns `laps` times.
    low, high = low / laps, high / laps
    need(high - low < 2 * arb.pi() + 1e-9, "a range after which all is back")
    equations = ClosureEquations(system)
    pieces, chains = [], []
    for curve in certificate["curves"]:
        chain, arcs = curve["pieces"], []
        for piece in chain:
            need(piece["half"] > 0 and piece["radius"] > 0, "an empty piece")
            frame = ball(piece["frame"])
            off = frame @ frame.T - np.eye(len(frame), dtype=int)
            need(np.all(size(off) < 1e-13), "a frame that is not orthonormal")
            arcs.append(Arc(piece, equations))
            need(arcs[-1].has_one_point_for_each_s(), "a piece without one arc")
            need(arcs[-1].passes_centre(), "a centre that is off its arc")
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
    # All unknown angles are examined over one revolution, the input over its range.
    count = len(equations.names) - 1
    middle = np.array([arb(0)] * count + [(low + high) / 2])
    radius = np.array([arb.pi()] * count + [(high - low) / 2])
    exclude_zeros(
        equations,
        middle=middle,
        radius=radius,
        is_in_known_box=lambda *box: any(is_box_inside(p, *box) for p in pieces),
        smallest=1e-4,
    )
    if "singularities" in certificate:
        check_singularities(equations, system, certificate, chains)


def check(certificate):
    """Check a certificate of any statement.

    The checks set the working precision of flint, which is global; it is restored.

    Raises
    ------
    Refused
        If the certificate does not prove its statement, or has another format.
    """
    precision = ctx.prec
    try:
        need(certificate["certificate"] == 1, "another format")
        if certificate["statement"] == "curves over a range":
            check_curves(certificate)
        elif certificate["statement"] == "modes over boxes":
            # Modules of other statements import from this one, so they are imported late.
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
        ctx.prec = precision


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
