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
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx, fmpz

PERIOD = 6.283185307179586
ball = np.frompyfunc(arb, 1, 1)
mid = np.frompyfunc(lambda each: each.mid(), 1, 1)
size = np.frompyfunc(lambda each: abs(each).upper(), 1, 1)
union = np.frompyfunc(lambda one, other: one.union(other), 2, 1)
shared = np.frompyfunc(lambda one, other: one.intersection(other), 2, 1)


class Refused(Exception):
    """A statement of a certificate is wrong, or is not proven."""


def need(condition, message):
    """Raise `Refused` with a message unless a condition of a certificate is fulfilled."""
    if not condition:
        raise Refused(message)


def matrix(entries):
    """Return a matrix of python-flint: of real balls if all entries are real."""
    try:
        return arb_mat(entries.tolist())
    except TypeError:
        return acb_mat(entries.tolist())


def inverse(entries):
    return np.array(matrix(entries).inv().tolist())


def inverse_near(entries):
    return mid(inverse(mid(entries)))


def about(radii):
    """Return balls about zero with the given radii."""
    return np.array([arb(0, radius) for radius in radii])


def wrapped(angle):
    return (angle + PERIOD / 2) % PERIOD - PERIOD / 2


def constant(value, count):
    return np.stack([value, *[0 * value] * count])


def times(one, other, product=np.matmul):
    """Return the product of two dual arrays as a dual array, by the product rule."""
    slopes = product(one[1:], other[0]) + product(one[0], other[1:])
    return np.concatenate([product(one[0], other[0])[None], slopes])


def crossed(one, other):
    """Return the vector product of two dual columns as a dual array."""
    return times(one, other, lambda a, b: np.cross(a, b, axis=-2))


def unit(a):
    return a / (a @ a).sqrt()


def farthest_coordinate_axis(axis):
    """Return the x, y or z axis whose angle with a vector is nearest to a right angle."""
    return ball(np.eye(3))[np.argmin(np.abs(mid(axis).astype(float)))]


def across(axis):
    """Return the unit vector (3,) of azimuth 0 about the centre `axis` of a circle."""
    first = int(abs(float(axis[0].mid())) > 0.9)
    return unit(np.eye(3, dtype=int)[first] - axis[first] * axis)


def number(text):
    return arb(str(text).replace("_", ""))


class Sizes:
    """The axes of all pairs and their zero directions, in each link of a mechanism file."""

    def __init__(self, text, tolerance, couplers=None, wheels=False):
        """Read the links and pairs (joints) of a mechanism file.

        Parameters
        ----------
        text
            Text of the TOML file; its decimal numbers are not rounded.
        tolerance
            Uncertainty (rad) of all sizes.
        couplers
            A coupler is a bar that replaces a sliding contact (Cs) of two circles. It joins
            the centres of both circles. This is a dictionary by the name of the contact,
            with the name of the bar ("link") and of the two pairs at its ends ("pairs").
        wheels
            Whether rolling contacts (Cr) may occur.
        """
        self.data = tomllib.loads(text, parse_float=str)
        # A ball is an interval. A size + `slack` contains all sizes within the tolerance.
        self.slack = arb(0, tolerance) if tolerance else arb(0)
        pairs = self.data["pairs"]
        # R pairs are revolute. P pairs (arc prismatic) slide along an arc, which is a
        # rotation about its pole. So both are hinges.
        hinges = [name for name, pair in pairs.items() if pair["type"] in ("R", "P")]
        self.ends = {name: tuple(pairs[name]["links"]) for name in hinges}
        self.links = list(self.data["links"])
        # By the name of a pair at the end of a coupler: the contact, and the number (0 or
        # 1) of the circle at this end.
        self.couplers = {}
        couplers = couplers or {}
        for contact, coupler in couplers.items():
            need(
                pairs[contact]["type"] == "Cs",
                "a coupler for a pair that is not a sliding contact",
            )
            need(coupler["link"] not in self.links, "a coupler with the name of a link")
            self.links.append(coupler["link"])
            ends = zip(coupler["pairs"], pairs[contact]["links"], strict=True)
            for circle_number, (name, link_of_circle) in enumerate(ends):
                need(name not in self.ends, "a coupler whose pair has the name of a pair")
                self.ends[name] = (link_of_circle, coupler["link"])
                self.couplers[name] = (contact, circle_number)
        # Every pair of the file must be a hinge, or be replaced, or be a wheel if allowed.
        supported_count = len(hinges) + len(couplers)
        if wheels:
            rolling = [name for name, pair in pairs.items() if pair["type"] == "Cr"]
            supported_count += len(rolling)
        need(len(pairs) == supported_count, "a pair that is not replaced or not supported")

    def circle(self, contact, link):
        """Return the centre (3,) and the radius (rad) of the circle of a contact on a link.

        Both are balls (numbers with a rigorous error bound), in the axes of the link. The
        mechanism file may state the centre as an axis of the link, as a vector, or by
        longitude and latitude, under keys such as `centre_xyz` or `pole_lonlat`. A great
        circle has no stated radius; it is 90 degrees. The circle of a cam follower may be
        under the key `follower`; its radius is called `roller`.

        Parameters
        ----------
        contact
            Name of the pair in which two profiles touch.
        link
            Name of the link whose profile is the circle.
        """
        item = self.data["pairs"][contact]
        follower = item.get("follower", {})
        is_follower = follower.get("link") == link
        profile = follower if is_follower else item["profiles"][link]
        if "axis" in profile:
            need("radius" in profile, "no radius")
            centre = self.frame(profile["axis"], link)[:, 2]
            # `slack` is the uncertainty of the sizes of the file, a ball about zero.
            return centre, self.angle(profile["radius"]) + self.slack
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
        """Return the frame (3, 3) of a pair at the end of a coupler, in columns x, y, z.

        The coupler is a bar that replaces two circles in sliding contact. It has a pair at
        each of their centres. The frame is in the axes of `link`, which is the coupler or
        the link of a circle. The z axis points to the centre of the circle. In the link of
        the circle, x is a fixed direction. In the coupler, x points to the contact. The
        pair angle leads from the first to the second.
        """
        # The contact of the circles, and the circle with this pair: 0 is the first, 1 the
        # second.
        contact, circle_number = self.couplers[pair]
        item = self.data["pairs"][contact]
        first_link, second_link = item["links"]
        if link in (first_link, second_link):
            axis, _ = self.circle(contact, link)
            # A unit vector perpendicular to the axis, the direction of azimuth 0.
            x = across(axis)
        else:
            # The link is the coupler. In its coordinates, the first centre is (0, 0, 1). On
            # the great circle from there towards (0, 1, 0), the contact is at the arc
            # `first_radius`.
            _, first_radius = self.circle(contact, first_link)
            _, second_radius = self.circle(contact, second_link)
            # The second centre is on this great circle too: behind an external contact, or
            # before an internal one. Before the first centre, its arc is negative.
            is_internal = item.get("contact", "external") == "internal"
            if is_internal:
                arc = first_radius - second_radius
            else:
                arc = first_radius + second_radius
            s, c = arc.sin_cos()
            # The x axis at a centre points along the great circle to the contact.
            if circle_number == 0:
                axis = ball([0, 0, 1])
                x = ball([0, 1, 0])
            else:
                axis = ball([0, s, c])
                if is_internal:
                    x = ball([0, c, -s])
                else:
                    x = ball([0, -c, s])
        return np.stack([x, np.cross(axis, x), axis], axis=1)

    def angle(self, text):
        degrees = self.data["angle_unit"] == "deg"
        return number(text) * (arb.pi() / 180 if degrees else 1)

    def axes(self, link):
        """Return the joint axes (3,) of a link by their pairs, with the first axis on z.

        The file states the arc of each other axis from the first axis. The second axis is
        in the half plane of z and positive y. For each further axis, the file also states
        an angle about the first axis, counted from the second axis. All numbers are balls
        (numbers with a rigorous error bound).
        """
        item = self.data["links"][link]
        first_pair, *other_pairs = item["axes"]
        axes = {first_pair: ball([0, 0, 1])}
        for number, (pair, arc) in enumerate(
            zip(other_pairs, item.get("arcs", []), strict=True)
        ):
            # `slack` is the uncertainty of sizes. The angle 0 of the second axis only
            # defines where y is, so it has no uncertainty.
            s, c = (self.angle(arc) + self.slack).sin_cos()
            if number == 0:
                azimuth = self.angle("0")
            else:
                azimuth = self.angle(item["angles"][number - 1]) + self.slack
            azimuth_sine, azimuth_cosine = azimuth.sin_cos()
            axes[pair] = np.array([-s * azimuth_sine, s * azimuth_cosine, c])
        return axes

    def frame(self, pair, link):
        """Return the frame (3, 3) of a pair (joint) in a link, in columns x, y, z.

        z is the axis of the pair. The pair angle turns x in its first link to x in its
        second link. The direction of x depends on the form of the file:

        - With sizes of links (arcs between axes), x lies towards the first other axis of
          the link. In the first link of the pair, x and y are then rotated by `zero`.
        - With axes in a reference pose, x is chosen from the axis alone, so it is the same
          in both links. In the second link, x and y are then rotated by `value`, the angle
          of the pair in this pose.

        The entries are balls (numbers with an error bound) with the uncertainty of the
        sizes of the file, `slack`.
        """
        # A coupler is a bar that replaces two circles sliding on each other.
        if pair in self.couplers:
            return self.coupler_frame(pair, link)
        item = self.data["pairs"][pair]
        is_second = self.ends[pair][1] == link
        if "axes" in self.data["links"][link]:
            axes = self.axes(link)
            axis = axes.pop(pair)
            normals = [np.cross(axis, other_axis) for other_axis in axes.values()]
            # An axis that coincides with the axis of the pair gives no direction: its
            # normal is zero.
            towards = [np.cross(n, axis) for n in normals if n @ n > 1e-18]
            rotation = None if is_second else item.get("zero")
        else:
            # Cartesian coordinates, or longitude and latitude.
            is_xyz = "xyz" in item
            axis = self.direction(item["xyz" if is_xyz else "lonlat"], is_xyz)
            towards = []
            rotation = item.get("value") if is_second else None
        # Any fixed direction will do if no axis gives one.
        x = unit([*towards, np.cross(axis, farthest_coordinate_axis(axis))][0])
        y = np.cross(axis, x)
        if rotation is not None:
            s, c = (self.angle(rotation) + self.slack).sin_cos()
            x, y = c * x + s * y, c * y - s * x
        return np.stack([x, y, axis], axis=1)


@dataclass(frozen=True)
class Placement:
    """A step of a construction, in which one link is placed on links placed before it.

    On one pair (joint), the link turns by a variable angle. On two pairs, the link closes a
    loop, and its fixed arc between their axes gives one equation.

    Attributes
    ----------
    link
        Name of the link.
    parents
        Names of the one or two links placed before it.
    pairs
        Name of the pair that joins the link to each of them.
    """

    link: str
    parents: tuple[str, ...]
    pairs: tuple[str, ...]

    @property
    def closes_a_loop(self):
        """Whether the link is placed by two pairs."""
        return len(self.pairs) == 2


class TurnedLink(NamedTuple):
    """A link on a path of links, with all angles by which it turns relative to the one
    before it.
    """

    link: str
    angles: tuple[str, ...]


class LinearAngle(NamedTuple):
    """The angle of a pair (rad) as ``rate * variable + offset``."""

    variable: str
    rate: arb
    offset: arb


class System:
    """The closure equations that follow from the construction stated in a certificate."""

    def __init__(self, certificate):
        """Read the construction of a certificate and check that it places every link.

        A certificate is the file of a proof. A construction starts from the root (first
        link) and places the other links one after another. There must be as many equations
        as unknown pair angles. A follower is a pair that turns with an input through two
        wheels in mesh, so its angle is known too. A coupler is a bar that replaces a
        sliding contact of two circles: it joins their centres.
        """
        construction = certificate["construction"]
        follower_pairs = construction["follow"]
        self.sizes = Sizes(
            certificate["mechanism"],
            certificate["tolerance_rad"],
            construction["couplers"],
            wheels=bool(follower_pairs),
        )
        self.unknowns = construction["unknowns"]
        self.inputs = list(certificate["inputs"])
        self.follower = self._read_follower(follower_pairs)
        # Each variable is the angle of an input, and one turn of it is 1 revolution.
        self.choose_variable(1)

        self.root = construction["root"]
        self.placements = self._read_placements(construction["steps"])
        self._check_pairs_and_angles(follower_pairs)
        self.frames = {}
        for pair, links in self.sizes.ends.items():
            for link in links:
                self.frames[pair, link] = self.sizes.frame(pair, link)

    def _read_follower(self, follower_pairs):
        """Return the follower: the pair that is coupled to an input by wheels in mesh.

        The follower is found from the mechanism file. It must be the pair that the
        certificate (file of a proof) names. `need` raises an error otherwise.

        Parameters
        ----------
        follower_pairs
            A list of the one follower that the certificate names. It is empty without
            wheels, and the result is then None.
        """
        if not follower_pairs:
            return None
        from oracles.proof_checker_gears import follower_of

        follower = follower_of(self.sizes, self.inputs)
        need(
            follower_pairs == [follower.pair],
            "the stated followers are not those of the file",
        )
        return follower

    def _read_placements(self, steps):
        """Return the steps that place all links but the root (first link), in order.

        Each link must be placed once, on one or two links placed before it, by the pairs
        that join it to them. `need` raises an error otherwise.

        Parameters
        ----------
        steps
            Steps of the certificate: a "link", the links "on" which it is placed, and the
            pairs "by" which it is joined to them.
        """
        ends = self.sizes.ends
        placed_links = {self.root}
        placements = []
        for step in steps:
            link = step["link"]
            parents = step["on"]
            pairs = step["by"]
            is_new_link = link in self.sizes.links and link not in placed_links
            need(is_new_link, f"{link} placed twice")
            is_on_placed_links = set(parents) <= placed_links
            need(
                len(parents) == len(pairs) in (1, 2) and is_on_placed_links,
                f"{link} on nothing",
            )
            for parent, pair in zip(parents, pairs, strict=True):
                need(set(ends[pair]) == {link, parent}, f"{pair} does not join them")
            placements.append(Placement(link, tuple(parents), tuple(pairs)))
            placed_links.add(link)
        need(placed_links == set(self.sizes.links), "links are missing")
        return placements

    def _check_pairs_and_angles(self, follower_pairs):
        """Check that each pair is used once, and that equations are as many as unknowns.

        A placement puts a link on links placed before it:

        - on one pair. The link can turn about this pair. The pair's angle must be an
          unknown, an input, or that of a follower (pair that wheels turn with an input).
        - on two pairs. The link closes a loop, and gives one equation.
        """
        used_pairs = []
        turning_pairs = []
        for placement in self.placements:
            used_pairs.extend(placement.pairs)
            if not placement.closes_a_loop:
                (pair,) = placement.pairs
                turning_pairs.append(pair)
        need(
            sorted(used_pairs) == sorted(self.sizes.ends), "pairs are missing or used twice"
        )
        variables = self.unknowns + self.inputs + follower_pairs
        need(
            sorted(turning_pairs) == sorted(variables),
            "a variable angle is not in the steps",
        )
        need(
            len(self.closing_links()) == len(self.unknowns),
            "not as many equations as unknowns",
        )

    def closing_links(self):
        """Return the links that close a loop, each of which gives one equation."""
        return [item.link for item in self.placements if item.closes_a_loop]

    def choose_variable(self, revolutions):
        """Choose a variable of which one turn brings all wheels back to their start.

        The input turns the first of two wheels in mesh. The follower is the pair of the
        second wheel. Both wheels are back at their start only after several revolutions of
        the input. Then the angle of each of the two pairs is rate * variable + offset, with
        one variable, which has the name of the input. `driven_angles` has these relations.
        Without wheels, each variable is the angle of its pair.

        Parameters
        ----------
        revolutions
            Number of revolutions of the input for one turn of the variable.
        """
        self.driven_angles = {}
        if self.follower is None:
            return
        input_pair = self.follower.driven
        ratio = self.follower.ratio * revolutions
        follower_rate = arb(ratio.numerator) / ratio.denominator
        self.driven_angles[input_pair] = LinearAngle(
            variable=input_pair, rate=arb(revolutions), offset=arb(0)
        )
        self.driven_angles[self.follower.pair] = LinearAngle(
            variable=input_pair, rate=follower_rate, offset=self.follower.offset
        )

    def bound(self):
        """Largest number of solutions: the permanent of the degrees in half tangents."""
        return permanent_of(self.degrees())

    def degrees(self):
        """Return the degree of each equation (row) in each unknown (column).

        The unknowns are half tangents tan(angle / 2). `bound` computes the largest number
        of solutions from the degrees. A placement puts a link on one or two links placed
        before it, its parents. With two parents the link closes a loop and gives an
        equation: its two axes, one on each parent, must be apart by the arc of the link.

        The path of a link is the list of links that lead from the root (first link) to it.
        Each link on it turns relative to the link before it: a link on one pair by one
        angle, a link that closes a loop by all angles of the loop. A `TurnedLink` is a link
        with the names of these angles.

        The paths of both parents may begin with the same links. The turns of these links
        do not change the arc between the two axes. A rotation is quadratic in the half
        tangent of its angle. So each angle of the other links adds 2 to the degree in it.
        """
        path_by_link = {self.root: []}
        degrees_of_equations = []
        for placement in self.placements:
            link = placement.link
            first_path, *further_paths = [path_by_link[p] for p in placement.parents]
            if not placement.closes_a_loop:
                turned_link = TurnedLink(link, placement.pairs)
                path_by_link[link] = [*first_path, turned_link]
                continue
            (second_path,) = further_paths
            common, first_rest, second_rest = split_common_start(first_path, second_path)
            angles_of_loop = []
            for turned_link in first_rest + second_rest:
                angles_of_loop.extend(turned_link.angles)
            degrees = [2 * angles_of_loop.count(unknown) for unknown in self.unknowns]
            degrees_of_equations.append(degrees)
            # The loop places this link relative to the last common link.
            path_by_link[link] = [*common, TurnedLink(link, tuple(angles_of_loop))]
        return degrees_of_equations

    def values(self, unknown, driven):
        """Return the k closure equations F and their derivatives F' (k, unknowns).

        They are evaluated at balls of the unknowns.
        """
        angles = {**dict(zip(self.unknowns, unknown, strict=True)), **driven}
        equations = PolynomialEquations(
            self, self.closing_links(), unknowns=[], inverse=[], moving=self.unknowns
        )
        return equations.values([], angles)


class PolynomialEquations:
    """Equations of links, polynomials in the e^(i angle) of pairs or in their inverses.

    The numbers e^(i angle), or their inverses, of the pairs `unknowns` are the unknowns. A
    dual array has its value at index 0 of the first axis. Then follow its derivatives by
    the unknowns, and those by the angles of the pairs `moving`.
    """

    def __init__(self, system, links, unknowns, inverse, moving=()):
        self.system, self.links, self.inverse = system, links, inverse
        self.unknowns, self.moving = unknowns, list(moving)
        # Number of derivatives of a dual array.
        self.count = len(unknowns) + len(self.moving)
        self.placements = {item.link: item for item in system.placements}

    def values(self, centre, driven):
        """Return the polynomials P of all equations, and their derivatives.

        `centre` has balls of the unknowns, and `driven` has those of all other angles.
        """
        self.points = dict(zip(self.unknowns, centre, strict=True))
        self.driven, self.done = driven, {}
        return parts_of([self._place_on_axes(link)[0] for link in self.links])

    def _matrix_and_scale(self, link):
        """Return the scaled matrix from a link to the link before it, and the scale.

        The matrix takes vectors from the coordinates of the link to those of the link
        before it. For a link that closes a loop, this is the common link of
        `_place_on_axes`. The matrix is multiplied by the scale, so that its entries are
        polynomials in the unknowns.
        """
        if link not in self.done:
            self.done[link] = (
                self._place_on_axes(link)[1:]
                if self.placements[link].closes_a_loop
                else self._turn_about_pair(link)
            )
        return self.done[link]

    def _turn_about_pair(self, link):
        """Return the scaled rotation from a link to the link before it, and its scale.

        The link is joined to the link before it by one pair, whose angle is known or
        unknown. The scale is the common denominator of the rotation matrix. Multiplied by
        it, the matrix is polynomial in the unknowns, numbers e^(i angle).

        Results are dual arrays, which hold a value and its derivatives along the first
        axis: index 0 is the value, and further indices are derivatives.
        """
        placement = self.placements[link]
        (pair,) = placement.pairs
        (parent,) = placement.parents
        # The angle of a pair counts from its first link to its second.
        sense = 1 if self.system.sizes.ends[pair][0] == parent else -1
        is_unknown = pair in self.points  # which has the value of each unknown
        if is_unknown:
            turn, scale = self._turn_by_unknown_angle(pair, sense)
        else:
            turn = self._turn_by_known_angle(pair, sense)
            scale = constant(ball([[1]]), self.count)
        # The frame of the pair in either link does not depend on the unknowns.
        before = constant(self.system.frames[pair, parent], self.count)
        after = constant(self.system.frames[pair, link].T, self.count)
        return times(times(before, turn), after), scale

    def _turn_by_unknown_angle(self, pair, sense):
        """Return a scaled rotation about the z axis by an unknown angle, and its scale.

        The unknown is z = e^(i angle), or its inverse if the pair is in `inverse`. With
        e^(i angle) = a / b, the numbers are a = z and b = 1, or a = 1 and b = z. The scale
        w = a b turns cosine and sine into polynomials:

        - w cos(angle) = (a^2 + b^2) / 2
        - w sin(angle) = (a^2 - b^2) / 2i

        Parameters
        ----------
        pair
            Name of the pair.
        sense
            1, or -1 for the rotation by the opposite angle.

        Returns
        -------
        turn, scale
            Dual arrays (1 + n, 3, 3) and (1 + n, 1, 1): the value, then n derivatives, of
            which only that by z is not zero.
        """
        column = self.unknowns.index(pair)
        z = self.points[pair]
        one = acb(1)
        if self.inverse[column]:
            a, b = one, z
            da_dz, db_dz = 0, one
        else:
            a, b = z, one
            da_dz, db_dz = one, 0
        w = a * b
        w_cosine = (a * a + b * b) / 2
        w_sine = (a * a - b * b) / acb(0, 2)
        dw_dz = a * db_dz + da_dz * b
        w_cosine_dz = a * da_dz + b * db_dz
        w_sine_dz = (a * da_dz - b * db_dz) / acb(0, 1)

        turn = constant(spin(w_cosine, sense * w_sine, w), self.count)
        turn[1 + column] = spin(w_cosine_dz, sense * w_sine_dz, dw_dz)
        scale = constant(ball([[1]]), self.count)
        scale[0] = w
        scale[1 + column] = dw_dz
        return turn, scale

    def _turn_by_known_angle(self, pair, sense):
        """Return a rotation about the z axis by a known angle, as a dual array.

        It is a factor of the matrix of a link. A known angle has its value in `driven`, or
        follows from such a value if it is the angle of a wheel. Every other angle is an
        unknown of the polynomials (`_turn_by_unknown_angle`).

        A dual array (1 + n, 3, 3) has its value at index 0, then n derivatives: first those
        by the unknowns, which are zero here, then those by the angles in `moving`. The
        caller names in `moving` the known angles by which it needs derivatives.

        Parameters
        ----------
        pair
            Name of the pair.
        sense
            1, or -1 for the rotation by the opposite angle.
        """
        # A wheel turns by a multiple of the input angle, plus an offset (`driven_angles`).
        # Every other angle is a variable of its own.
        own_angle = LinearAngle(pair, arb(1), arb(0))
        angle = self.system.driven_angles.get(pair, own_angle)
        value = self.driven[angle.variable] * angle.rate + angle.offset
        sine, cosine = value.sin_cos()
        turn = constant(spin(cosine, sense * sine, 1), self.count)
        if angle.variable in self.moving:
            first_of_moving = 1 + len(self.unknowns)
            index = first_of_moving + self.moving.index(angle.variable)
            # The cosine has the derivative -sine, the sine has the derivative cosine, and
            # the 1 on the axis has the derivative 0.
            turn[index] = angle.rate * spin(-sine, sense * cosine, 0)
        return turn

    def _path(self, link):
        """Return the links from the root to a link whose matrices place it, one by one.

        The root is not in the list. The matrix of a link that closes a loop leads to the
        last link that the paths of both its parents share.
        """
        placement = self.placements.get(link)
        if placement is None:
            return []
        if placement.closes_a_loop:
            common, _, _ = split_common_start(*map(self._path, placement.parents))
            return [*common, link]
        return [*self._path(placement.parents[0]), link]

    def _place_on_axes(self, link):
        """Return the closure equation of a link, the matrix that places it, and its scale.

        The link closes a loop: two pairs join it to two links placed before it, its
        parents. A path is the list of links from the root (first link) to a parent. The
        common link is the last one that both paths share.

        - The equation says that the arc between the axes of both pairs, as the parents
          place them, is the arc of the link.
        - The matrix takes vectors from the coordinates of the link to those of the common
          link, and multiplies them by the scale. Links that are placed later need it for
          their own equations.
        - The scale makes equation and matrix polynomial in the unknowns. An unknown is the
          number z = e^(i angle) of a pair, or its inverse. The cosine of the angle is
          (z^2 + 1) / (2 z), so the rotation about the pair has the denominator z. The scale
          is the product of all denominators between the common link and both parents.

        This method computes the axes in the common link, along the paths. The function
        `place_on_axes` computes the equation and the matrix from them.

        Results are dual arrays: index 0 of the first axis is the value, further indices are
        its derivatives.
        """
        placement = self.placements[link]
        parents = placement.parents
        pairs = placement.pairs
        _, *paths = split_common_start(*map(self._path, parents))
        axes_in_common = []
        scales = []
        for path, pair, parent in zip(paths, pairs, parents, strict=True):
            axis, scale = self._axis_at_start_of_path(path, pair, parent)
            axes_in_common.append(axis)
            scales.append(scale)
        # The z column of the frame of a pair is its axis.
        axes_in_link = [self.system.frames[pair, link][:, 2] for pair in pairs]
        equation, matrix = place_on_axes(link, axes_in_link, axes_in_common, scales)
        return equation, matrix, times(*scales)

    def _axis_at_start_of_path(self, path, pair, parent):
        """Return a pair axis in the link before a path, times a scale; and the scale.

        `path` has the links from there to `parent`, which is a link of the pair. Both
        results are dual arrays: the value and its derivatives, along the first axis.
        """
        # The derivatives of the axis in its parent, and of the scale 1, are zero.
        axis = constant(self.system.frames[pair, parent][:, 2:], self.count)
        scale = constant(ball([[1]]), self.count)
        for path_link in reversed(path):
            matrix_of_link, scale_of_link = self._matrix_and_scale(path_link)
            axis = times(matrix_of_link, axis)
            scale = times(scale, scale_of_link)
        return axis, scale


def spin(c, s, still):
    """Return the matrix with cosine c, sine s and the entry `still` on the third axis."""
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, still]], dtype=object)


def place_on_axes(link, axes, axes_in_common, scales):
    """Return the closure equation of a link on two axes, and its matrix, as dual arrays.

    The link is joined to other links by pairs about its two axes. Both axes are also known
    in one other link, the common link. There they are the fractions u / a and w / b of
    polynomials in the unknowns. The denominators a and b are called scales. Both results
    are multiplied by a b, so that they are polynomials too.

    - The equation u . w - a b cos(arc) = 0 says that the axes u / a and w / b are as far
      apart as in the link, where `arc` is between them.
    - The matrix takes vectors in the link to vectors in the common link, times a b.

    A dual array (1 + n, rows, columns) has its value first, and then its derivatives by n
    unknowns.

    Parameters
    ----------
    link
        Name of the link, for messages.
    axes
        Two axes (3,) in the link.
    axes_in_common, scales
        The numerators u and w, two dual columns (1 + n, 3, 1), and the denominators a and
        b, two dual numbers (1 + n, 1, 1).
    """
    u, w = axes_in_common
    a, b = scales
    first_axis, second_axis = axes
    both_scales = times(a, b)
    # A row times a column is their dot product.
    u_as_row = u.swapaxes(1, 2)
    equation = times(u_as_row, w) - both_scales * (first_axis @ second_axis)
    normal = np.cross(first_axis, second_axis)
    # Numbers may be complex balls (complex numbers with error bounds). These cannot be
    # compared with 0, but their real parts can.
    need((normal @ normal).real > 0, f"the arc of {link} may be 0 or 180 degrees")
    # Three vectors in the link are a basis: both axes and their vector product. The matrix
    # takes them to the columns a b (u / a), a b (w / b) and a b (u / a) x (w / b).
    inverse_basis = inverse(np.stack([first_axis, second_axis, normal], axis=1))
    columns = (times(u, b), times(w, a), crossed(u, w))
    return equation, np.concatenate(columns, axis=2) @ inverse_basis


def parts_of(duals):
    """Return the values (k,) and the derivatives (k, n) of k dual numbers."""
    table = np.array([dual[:, 0, 0] for dual in duals]).reshape(len(duals), -1)
    return table[:, 0], table[:, 1:]


def split_common_start(one, other):
    """Return the common beginning of two lists, and the rest of each list."""
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
    """Return whether Krawczyk's operator proves one solution in balls about `centre`."""
    centre, around = np.array(centre), np.full(len(centre), square(radius))
    value, slope = system.values(centre, driven)
    near = inverse_near(slope)
    slopes = system.values(centre + around, driven)[1]
    image = (ball(np.eye(len(centre))) - near @ slopes) @ around - near @ value
    return largest(image) < arb(radius)


def check_modes(certificate):
    """Check a certificate (file of a proof) that counts the assembly modes at given inputs.

    Assembly modes are the real solutions (roots) of the closure equations. Each stated root
    must be proven to exist, and all must be different.

    The certificate may also claim that its real roots are all there are ("complete"). This
    is right in two cases:

    - It lists as many complex roots as the degrees of the equations allow ("counted").
    - It has no undecided boxes, which are regions of angles that the proof says nothing
      about. The last step checks that no other real root is outside such boxes.
    """
    need(certificate["statement"] == "modes at inputs", "another statement")
    # Somewhat more bits than the certificate was computed with.
    ctx.prec = certificate["precision_bits"] + 40
    system = System(certificate)
    driven = {k: system.sizes.angle(v) for k, v in certificate["inputs"].items()}
    # The largest number of isolated complex solutions, by the degrees of the equations.
    need(system.bound() == certificate["bound"], "another bound")
    roots = certificate["roots"]
    check_roots_are_different([check_root(root, system, driven) for root in roots])

    real_roots = [root for root in roots if root["real"]]
    need(certificate["modes"] == len(real_roots), "another number of modes")
    is_counted = len(roots) == certificate["bound"]
    need(certificate["counted"] == is_counted, "not counted")
    undecided_boxes = certificate["undecided_rad"]
    is_complete = is_counted or not undecided_boxes
    need(certificate["complete"] == is_complete, "not complete")
    # The equations may have been solved in several systems, one after the other. Then
    # `check_systems` checks that no other real root exists.
    if certificate["systems"]:
        # A follower is a pair that turns with an input through two wheels in mesh.
        need(system.follower is None, "systems with wheels are not checked")
        from oracles.proof_checker_systems import check_systems

        check_systems(system, certificate, driven)
    elif not is_counted:
        exclude_other_modes(system, driven, real_roots, undecided_boxes)


SQUARE_IN_DISK = 0.7
"""Half the side of a square within a disk of radius 1: less than 1 / sqrt(2)."""


def check_root(root, system, driven):
    """Check that a root of a certificate exists; return balls of its e^(i angle).

    A root states a disk about a complex number (`centre`) for each unknown angle.
    Krawczyk's operator must prove that squares in these disks contain exactly one solution.
    For a real root the centres must be real: a mirrored solution would be in the squares
    too, so the only one is real. For another root, the disk of some angle must be apart
    from the real axis.

    Parameters
    ----------
    root
        Root of the certificate: "centre", "radius" (rad), and "real".
    system, driven
        Equations, and balls (numbers with a rigorous error bound) of the input angles by
        their pairs.
    """
    need(len(root["centre"]) == len(system.unknowns), "a root without all angles")
    centre = [acb(dyadic(re), dyadic(im)) for re, im in root["centre"]]
    radius = root["radius"]
    need(0 < radius < 0.1, "a radius out of range")
    half_side = SQUARE_IN_DISK * radius
    need(has_one_solution(system, centre, half_side, driven), "a root is not shown")
    if root["real"]:
        need(all(c.imag == 0 for c in centre), "a real root off the real axis")
    else:
        imaginary_parts = [arb(c.imag) + arb(0, radius) for c in centre]
        is_apart_from_axis = any(not part.contains(0) for part in imaginary_parts)
        need(is_apart_from_axis, "a root that may be real")
    # The squares about the disks contain the solution, too.
    return [(acb(0, 1) * (c + square(radius))).exp() for c in centre]


def check_roots_are_different(points):
    """Check that any two roots differ in the e^(i angle) of some unknown.

    e^(i angle) is the same after a whole turn.

    Parameters
    ----------
    points
        For each root, balls of the e^(i angle) of all unknowns.
    """
    for first, second in combinations(points, 2):
        is_apart = any(not a.overlaps(b) for a, b in zip(first, second, strict=True))
        need(is_apart, "two roots may be one")


def exclude_other_modes(system, driven, real_roots, undecided_boxes):
    """Prove that every real assembly mode is near a listed root, or in an undecided box.

    First, a box about each root is proven to contain no second root. Then the space of all
    angles is divided into parts, until each part contains no root or is in one of the
    boxes.

    Parameters
    ----------
    system, driven
        Equations, and balls (numbers with a rigorous error bound) of the input angles by
        their pairs.
    real_roots
        The roots of the certificate (file of a proof) with real angles.
    undecided_boxes
        Boxes in which the certificate leaves open whether there are roots.
    """
    # 80 bits: rounding of about 1e-24, far less than the smallest part (1e-7).
    ctx.prec = 80
    boxes = []  # centre and half widths (unknowns,) in rad
    for root in real_roots:
        # Real and imaginary part of each angle. The imaginary parts are zero. A part is
        # stated as two integers, mantissa and exponent of 2.
        centre = [acb(dyadic(re)) for re, _ in root["centre"]]
        # Half width (rad) of the box. It is halved until one root only is proven in it.
        radius = 0.04
        while not has_one_solution(system, centre, radius, driven):
            radius /= 2
            need(radius > root["radius"], "a root is not alone")
        middle = np.array([float(c.real.mid()) for c in centre])
        boxes.append((middle, np.full(len(centre), radius)))
    # A small margin. Otherwise rounding could decide whether a part is in a box that shares
    # a side with it.
    for box in undecided_boxes:
        boxes.append((np.array(box["centre"]), 1.001 * np.array(box["half"]) + 1e-12))

    def is_in_a_box(middle, half_widths):
        """Return whether a part, stated in floats, is in one of the boxes.

        A box whose half width is half a turn contains all values of this angle.
        """
        for centre, halves in boxes:
            farthest_distance = np.abs(wrapped(middle - centre)) + half_widths
            # `PERIOD` is a whole turn.
            has_all_angles = halves >= PERIOD / 2
            if np.all(has_all_angles | (farthest_distance <= halves - 1e-12)):
                return True
        return False

    count = len(system.unknowns)
    # Not centred at zero: roots at special angles such as 0 would be on the sides of parts.
    start = ball(0.7 + 0.1 * np.arange(count))
    # Slightly more than half a turn to both sides, so that no angle is left out.
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
"""Largest distance of the centre of a piece from the arc of the curve in this piece. The
solver of spherekit allows 1e-12."""
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
    """Prove that a function has no zero in a box, except in boxes whose zeros are known.

    The box is halved into parts, across the longest side of each part. A part is done if it
    is in a known box, or if the mean-value form F(middle) + F'(part) (part - middle) is not
    zero anywhere. All numbers are balls (intervals with rigorous bounds).

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
        # Over the first box, usually a whole turn of each angle, the test cannot succeed.
        if examined > 1:
            spread = about(half_widths)  # intervals about zero, of the half widths
            image = evaluate(middle)[0] + evaluate(middle + spread)[1] @ spread
            if not all(value.contains(0) for value in image):
                continue
            need(
                max(half_widths) > smallest, "a small box may have a zero that is not known"
            )
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
            axis_points = axis_point + step * self.axis
            image = self._krawczyk_operator(axis_point, axis_points, step, cuts)
            if not np.all(size(image) < self.radius):
                return False
        return True

    def passes_centre(self):
        """Whether the arc is within SLACK of the centre at s = 0."""
        return np.all(size(self.inverse_slope @ self.value) < SLACK / 4)

    def _krawczyk_operator(self, axis_point, axis_points, step, cuts):
        """Return Krawczyk's operator on all y of the piece, over a part of its axis.

        A piece is a straight box about an arc of a curve F = 0. A point of the piece has
        the coordinate s along the axis and the coordinates y across it; y is zero on the
        axis. A ball is an interval. Krawczyk's operator is

            Y - C (F'_y Y + F), computed as (1 - C F'_y) Y - C F:

        - Y are the balls of all y of the piece, with the middle 0 (`all_y`).
        - F are the values on this part of the axis, where y is 0.
        - F'_y are the derivatives by y, over all Y (`slopes`).
        - C is an approximate inverse of F'_y (`inverse_slope`).

        If the result is inside Y, there is exactly one y with F = 0 for each s.

        Parameters
        ----------
        axis_point, axis_points
            Middle of the part of the axis, and balls of all its points.
        step
            Ball of s in the part, relative to its middle.
        cuts
            Number of intervals that each y is cut into for the derivatives.
        """
        slopes = self._slopes_across(axis_points, cuts)
        # F at all points of the part by the mean-value theorem: the value at the middle,
        # plus the derivative along the axis times the step. `equations` returns F and its
        # derivatives by all variables.
        middle_value, _ = self.equations(axis_point)
        _, derivatives = self.equations(axis_points)
        value = middle_value + derivatives @ self.axis * step
        contraction = self.identity - self.inverse_slope @ slopes
        return contraction @ self.all_y - self.inverse_slope @ value

    def _slopes_across(self, axis_points, cuts):
        """Return balls of the derivatives of F by y, for all y of the piece.

        F = 0 are the closure equations. A piece is a straight box. y are the coordinates
        across its axis, each from -radius to radius. `axis_points` are balls that contain
        the points of the axis.

        Each y is cut into equal intervals, numbered from 0 to `cuts` - 1. A cell has one
        interval of each y. The result is the union of the derivatives over all cells, which
        is narrower than the derivatives over the whole box.
        """
        slopes = None
        y_count = len(self.inverse_slope)
        for cell in itertools.product(range(cuts), repeat=y_count):
            middle = self.radius * (2 * ball(cell) + 1 - cuts) / cuts
            y = middle + arb(0, (self.radius / cuts).upper())
            _, derivatives = self.equations(axis_points + self.across @ y)
            cell_slopes = derivatives @ self.across
            if slopes is None:
                slopes = cell_slopes
            else:
                slopes = union(slopes, cell_slopes)
        return slopes

    def at(self, s):
        """Return balls (intervals) that contain the points of the arc for a range of s.

        The arc is the part of a configuration curve F = 0 in a piece, which is a straight
        box. s is the coordinate along the axis of the box, and y are those across it. For
        each s the arc has one y, which is to be enclosed. The search starts with the balls
        of all y of the piece. Krawczyk's operator narrows them and loses no solution.

        Parameters
        ----------
        s
            Ball of the coordinate along the axis: the range of s.

        Returns
        -------
        (variables,) balls of the variables.
        """
        middle_s = arb(s.mid())
        step = s - middle_s
        axis_point = self.centre + middle_s * self.axis
        axis_points = axis_point + step * self.axis
        y = self._narrowed(self.all_y, axis_point, axis_points, step)
        if any(item.rad() > 0.9 * self.radius for item in y):
            # A ball is hardly narrower than the piece, since the bounds of F' over all y
            # are too wide. Bounds over parts of the piece are narrower, so it is cut.
            y = self._inside_piece_by_cuts(axis_point, axis_points, step)
            y = self._narrowed(y, axis_point, axis_points, step)
        return axis_points + self.across @ y

    def _inside_piece_by_cuts(self, axis_point, axis_points, step):
        """Return balls of the y with F = 0, by derivatives over parts of the piece.

        Each y is cut into 4 parts, and if this is not enough into 6 or 8. The first image
        by Krawczyk's operator that lies within the piece is returned, or else all y of the
        piece. Parameters are those of `_narrowed`.
        """
        for _, cuts in PARTS:
            image = self._krawczyk_operator(axis_point, axis_points, step, cuts)
            if np.all(size(image) < self.radius):
                return image
        return self.all_y

    def _narrowed(self, y, axis_point, axis_points, step):
        """Return smaller balls (intervals) of y that contain the curve, for a range of s.

        The curve is the set of points with F = 0, the closure equations. A piece is a
        straight box about an arc of it. A point of the piece has the coordinate s along the
        axis of the box and the coordinates y across it.

        The image of y by Krawczyk's operator contains the same points of the curve as y.
        So they are in the common part of both. This is repeated up to 30 times, and no more
        when no ball shrinks to less than 0.9 of its radius.

        Parameters
        ----------
        y
            Balls of the coordinates across the axis.
        axis_point
            The one point of the axis at the middle of the range of s.
        axis_points
            Balls that contain the points of the axis for all s of the range.
        step
            Ball of s relative to the middle of the range.
        """
        for _ in range(30):
            image = self._image_across(y, axis_point, axis_points, step)
            narrowed = shared(y, image)
            has_shrunk = any(
                after.rad() < 0.9 * before.rad()
                for before, after in zip(y, narrowed, strict=True)
            )
            y = narrowed
            if not has_shrunk:
                break
        return y

    def _image_across(self, y, axis_point, axis_points, step):
        """Return balls with all solutions of F = 0 in given balls, for a range of s.

        A ball is an interval. A piece is a straight box about a part of the curve F = 0. A
        point of the piece has the coordinate s along the axis of the box. Its coordinates y
        are across the axis, in the directions `across`.

        The result is the image of the given balls y by Krawczyk's operator,
        m + (1 - C F'_y) (y - m) - C F(m):

        - m are the middles of the balls y.
        - F'_y are the derivatives of F by y, and C is an approximate inverse of them.
        - F(m) must hold for all s of the range. By the mean-value theorem, it is the value
          at the middle of the range, plus the derivative along the axis times the step of
          s.

        Parameters
        ----------
        y
            Balls of the coordinates across the axis.
        axis_point
            The point of the axis at the middle of the range of s.
        axis_points
            Balls that contain the points of the axis for all s of the range.
        step
            Ball of s relative to the middle of the range.
        """
        middle_y = mid(y)
        # The equations return F and its derivatives.
        value_at_middle, _ = self.equations(axis_point + self.across @ middle_y)
        _, slope = self.equations(axis_points + self.across @ y)
        slope_by_s = slope @ self.axis
        slope_by_y = slope @ self.across
        value_for_all_s = value_at_middle + slope_by_s * step
        image_of_middle = middle_y - self.inverse_slope @ value_for_all_s
        contraction = self.identity - self.inverse_slope @ slope_by_y
        return image_of_middle + contraction @ (y - middle_y)

    def rate(self, s, variable):
        """Return a ball of the rate of a variable along the arc, up to a factor.

        The rate is the determinant of F' without the column of the variable, times a factor
        that is never zero. It is zero where the variable stops.
        """
        _, slope = self.equations(self.at(s))
        return matrix(np.delete(slope, variable, axis=1)).det()


def check_stops(arcs, following, variable, stops):
    """Prove that a variable stops in each given box of a curve, and nowhere else.

    A variable stops where its rate along the curve is zero. Outside of the boxes the rate
    is proven to have no zero, by halving parts of the curve. Before and after each box the
    rates have opposite signs, so there is a zero between them. That there is only one is
    not checked.

    `Arc.rate` encloses the rate, up to a factor that is never zero. The rates x of all
    variables solve F' x = 0 for the closure equations F, so by Cramer's rule the rate of
    one variable is the determinant of F' without its column.

    Parameters
    ----------
    arcs, following
        `Arc` of each piece of a curve, and the piece that follows it. The last piece of an
        open curve has none.
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

    # An arc is examined from the centre of its piece to that of the next piece. It ends at
    # the centre of the last piece of an open curve.
    for arc, next_piece in zip(arcs, following, strict=False):
        start = arb(0) - arb(0, SLACK)
        end = coordinates(arc.piece, next_piece["centre"])[0] + arb(0, SLACK)
        waiting = [(start, end, 0)]
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
    # The signs are compared at a distance from the centre of the box, on an arc that is
    # long enough. Larger distances need longer arcs. Near the box, balls of the rate may
    # contain zero, because the rate is small there.
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
        need(rates is not None, "no piece contains the stop and both its sides")
        need(
            not any(rate.contains(0) for rate in rates),
            "the sign of a rate beside a stop is not certain",
        )
        need((rates[0] > 0) != (rates[1] > 0), "no change of sign at a stop")


def check_singularities(equations, system, certificate, chains):
    """Check that input and outputs stop where a certificate says so, and nowhere else.

    A variable stops where its rate along a curve of configurations is zero. A stop of the
    input is a dead centre. A stop of an output is a singularity of type I, or of type III
    if the input may stop there too; the certificate then says "I or III". An output is only
    checked if a pair joins its two links, and the angle of this pair is an unknown.

    Parameters
    ----------
    equations
        Closure equations, with the names of their variables. The last one is the input.
    system
        `System` of the certificate, for the file and for the links of each pair.
    certificate
        Certificate (file of a proof) with the stops of each curve.
    chains
        Two lists for each curve. A curve is covered by a sequence of boxes, its pieces. The
        first list has the `Arc` of each piece: the part of the curve inside it. The second
        list has the next piece for each of these. The last piece of an open curve has none.
    """
    sizes = system.sizes
    outputs = list(sizes.data.get("outputs", {}).items())
    if not outputs:
        # Without declared outputs, they are the links that a pair joins to the ground.
        ground = sizes.data["ground"]
        for ends in sizes.ends.values():
            if ground in ends:
                (link,) = set(ends) - {ground}
                outputs.append((f"{link}/{ground}", {"link": link}))
    singularities = certificate["singularities"]["found"]
    curves = zip(certificate["curves"], chains, strict=True)
    for number, (curve, (arcs, following)) in enumerate(curves):
        *unknowns, _ = equations.names
        input_variable = len(unknowns)
        check_stops(arcs, following, input_variable, curve["input_stops"])
        for name, output in outputs:
            reference = output.get("relative_to", system.sizes.data["ground"])
            links = {output["link"], reference}
            pairs = [p for p, ends in system.sizes.ends.items() if set(ends) == links]
            if not pairs or pairs[0] not in unknowns:
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
        system.choose_variable(laps)
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
    """Check a certificate (file of a proof) of any of the four kinds of statements.

    flint has one working precision for all; the checks set it, and it is restored here.

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
    """Return a certificate as it is read from its JSON file."""
    return json.loads(json.dumps(certificate))


def refuse(certificate):
    """Raise `AssertionError` unless a certificate is refused."""
    try:
        check(certificate)
    except Refused:
        return
    raise AssertionError("not refused")
