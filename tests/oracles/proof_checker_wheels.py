"""Checks that wheels in mesh turn as a certificate says, without spherekit.

Two circles about a and b roll on each other if they touch, and if the difference of the
angular velocities of their links is along the line to the contact point. The contact point
is u a + v b with two numbers u and v. The gap of the circles and the slip at the contact
are trigonometric polynomials of degree 2 in each angle between the wheels. Their values at
five values of each angle therefore bound them everywhere.

`arb` is a ball: a number with a rigorous bound of its error. All arithmetic is in balls.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx
from oracles.proof_checker import Sizes, ball, matrix, need, size, spin

MAX_GAP = 1e-9
"""Largest gap and slip at which circles count as rolling on each other.

The decimal numbers of a file are rounded, so the circles of wheels touch only nearly.
"""

ANGLES_PER_PAIR = 5
"""Number of angles that determine a trigonometric polynomial of degree 2."""

INTERPOLATION_NORM = 2.0
"""Bound of a trigonometric polynomial of degree 2, relative to its largest value at five
evenly spaced angles.

It is the norm of the interpolation (Lebesgue constant), 1.99, rounded up.
"""

MAX_PAIRS = 6
"""Largest number of pairs between two wheels: there are 5 to that power angles to check."""


class RollingCircles(NamedTuple):
    """The two circles on the unit sphere that roll on each other at a contact of wheels.

    Attributes
    ----------
    first_centre, second_centre
        (3,) unit vectors to the centres, each in its link.
    first_sine, second_sine
        Sines of both radii, or numbers proportional to them: the numbers of teeth.
    arc
        Arc (rad) between the centres of touching circles.
    is_internal
        Whether the first circle lies within the second.
    """

    first_centre: Any
    second_centre: Any
    first_sine: Any
    second_sine: Any
    arc: Any
    is_internal: bool


class PairOnPath(NamedTuple):
    """An R pair (revolute joint) on the path of pairs from one link to another.

    Attributes
    ----------
    pair
        Name of the pair.
    link_before, link_after
        The links that it joins, in the order of the path.
    sense
        1 if the angle of the pair turns the link after it relative to the link before it,
        and -1 if it turns the link before relative to the link after.
    """

    pair: str
    link_before: str
    link_after: str
    sense: int


class Wheels:
    """The links of a file whose R pairs join all links without a loop."""

    def __init__(self, certificate):
        """Read the links, the contacts, and the stated rates of all pairs by the inputs.

        A certificate is the file of a proof. R pairs (revolute joints) must join all links
        without a loop. `rates` has for each of them one ball (a number with an error bound)
        per input: the rate of the pair while only this input turns, at unit rate. The
        certificate states the rates of the followers, the pairs that are no inputs, as
        numbers ("ratios") with a bound of their error ("off"). `need` refuses the
        certificate with a message if a condition is false.
        """
        # The links may have rolling contacts, which this check does not use to place them.
        self.sizes = Sizes(
            certificate["mechanism"], certificate["tolerance_rad"], wheels=True
        )
        data = self.sizes.data
        # The order of the certificate is that of the rates.
        inputs = certificate["inputs"]
        need(sorted(data["inputs"]) == sorted(inputs), "other inputs")
        self.rates = {}
        for name in inputs:
            self.rates[name] = [arb(int(name == moved)) for moved in inputs]
        for row in certificate["ratios"]:
            need(row["pair"] not in self.rates, "a pair twice")
            need(len(row["ratios"]) == len(inputs), "other inputs")
            # Larger errors would make the statement worthless.
            need(0 <= row["off"] < 1e-12, "ratios that are too uncertain")
            self.rates[row["pair"]] = [arb(ratio, row["off"]) for ratio in row["ratios"]]
        need(sorted(self.rates) == sorted(self.sizes.ends), "pairs are missing")
        self.followers = [row["pair"] for row in certificate["ratios"]]
        self.contacts = [n for n, p in data["pairs"].items() if p["type"] == "Cr"]
        # If this number of pairs joins all links, they form no loop.
        need(len(self.sizes.ends) == len(self.sizes.links) - 1, "a loop of R pairs")
        first_link = self.sizes.links[0]
        for link in self.sizes.links:
            self.path_of_pairs(first_link, link)  # refuses a link that is not joined

    def path_of_pairs(self, start, goal):
        """Return the pairs from one link to another in order, as a list of `PairOnPath`.

        The links are searched breadth first from the start. `ends` has the links of all
        pairs but contacts. These pairs join all links without a loop, so there is one path
        only.
        """
        path_by_link = {start: []}
        waiting = [start]
        for link in waiting:
            for pair, ends in self.sizes.ends.items():
                if link not in ends:
                    continue
                # The angle of a pair turns its second link relative to its first.
                first_link, second_link = ends
                sense = 1 if link == first_link else -1
                next_link = second_link if link == first_link else first_link
                if next_link not in path_by_link:
                    step = PairOnPath(pair, link, next_link, sense)
                    path_by_link[next_link] = [*path_by_link[link], step]
                    waiting.append(next_link)
        need(goal in path_by_link, "links that no pairs join")
        return path_by_link[goal]

    def path_between_wheels(self, contact):
        """Return the path of pairs from the first wheel of a contact to the second."""
        first_link, second_link = self.sizes.data["pairs"][contact]["links"]
        return self.path_of_pairs(first_link, second_link)

    def circles_of(self, contact):
        """Return the two circles of a rolling contact, as `RollingCircles`.

        The file has circles by their centres and radii, or cones by their axes and their
        numbers of teeth or half angles. Sizes are balls (numbers with an error bound) with
        the uncertainty of the file (`sizes.slack`). The sine of a radius is the distance of
        the circle from its axis, which determines how fast the circle rolls.
        """
        item = self.sizes.data["pairs"][contact]
        # In an internal contact the first circle lies within the second.
        is_internal = item.get("contact", "external") == "internal"
        if "axes" in item:
            return self._circles_of_cones(item, is_internal)
        first_link, second_link = item["links"]
        first_centre, first_radius = self.sizes.circle(contact, first_link)
        second_centre, second_radius = self.sizes.circle(contact, second_link)
        if is_internal:
            arc_between_centres = second_radius - first_radius
        else:
            arc_between_centres = first_radius + second_radius
        return RollingCircles(
            first_centre,
            second_centre,
            first_sine=first_radius.sin(),
            second_sine=second_radius.sin(),
            arc=arc_between_centres,
            is_internal=is_internal,
        )

    def _circles_of_cones(self, item, is_internal):
        """Return the circles of two cones that touch.

        A cone intersects the sphere in a circle, whose radius is the half angle of the
        cone. Only the ratio of the sines of both radii matters for rolling, and numbers of
        teeth have the same ratio.

        Parameters
        ----------
        item
            Table of the contact in the file.
        is_internal
            Whether the first cone lies within the second.
        """
        need(item.keys() & {"teeth", "half_angles"}, "cones of no size")
        first_pair, second_pair = item["axes"]
        first_link, second_link = item["links"]
        arc = self._arc_between_axes(first_pair, second_pair)
        if "teeth" in item:
            first_sine, second_sine = (arb(int(count)) for count in item["teeth"])
        else:
            # The arc between the axes of touching cones is the sum of both half angles, or
            # their difference. The second half angle follows from the first and the arc, so
            # that the cones touch exactly even if the file rounds both. `slack` is the
            # uncertainty of a size of the file, a ball (interval) about zero. The arc has
            # it already.
            first_half_angle = self.sizes.angle(item["half_angles"][0]) + self.sizes.slack
            if is_internal:
                second_half_angle = arc + first_half_angle
            else:
                second_half_angle = arc - first_half_angle
            first_sine = first_half_angle.sin()
            second_sine = second_half_angle.sin()
        return RollingCircles(
            self.sizes.frame(first_pair, first_link)[:, 2],
            self.sizes.frame(second_pair, second_link)[:, 2],
            first_sine,
            second_sine,
            arc,
            is_internal,
        )

    def _arc_between_axes(self, first_pair, second_pair):
        """Return the arc (rad) between two pair axes, in the link that has both."""
        second_ends = self.sizes.ends[second_pair]
        carrier = next(k for k in self.sizes.ends[first_pair] if k in second_ends)
        first_axis = self.sizes.frame(first_pair, carrier)[:, 2]
        second_axis = self.sizes.frame(second_pair, carrier)[:, 2]
        normal = np.cross(first_axis, second_axis)
        return arb.atan2((normal @ normal).sqrt(), first_axis @ second_axis)

    def slips(self, contact, angles):
        """Return the gap of two circles, and the slip that each pair between them causes.

        The circles roll if they touch, and if the angular velocity of one relative to the
        other has no part across the contact line (from the centre of the sphere to the
        contact). The slip is the cross product of the angular velocity with this line.

        Parameters
        ----------
        contact
            Name of the rolling contact.
        angles
            Angles (rad) of the pairs on the path from the first wheel to the second, as
            balls (numbers with an error bound).

        Returns
        -------
        gap
            Cosine of the arc between the centres, less that of touching circles.
        slip
            (3,) vectors by pair, in axes of the first wheel: the slip while the pair turns
            at unit rate.
        """
        circles = self.circles_of(contact)
        axis_by_pair, rotation = self._place_path(self.path_between_wheels(contact), angles)
        second_centre = rotation @ circles.second_centre
        line = contact_line(circles, circles.first_centre, second_centre)
        slip = {pair: np.cross(axis, line) for pair, axis in axis_by_pair.items()}
        gap = circles.first_centre @ second_centre - circles.arc.cos()
        return gap, slip

    def _place_path(self, path, angles):
        """Return the axes of all pairs on a path, and the rotation of its last link.

        A path leads from its first link over R pairs (revolute joints) to its last link.
        The links are placed at given angles of the pairs. `slips` computes the gap and the
        slip of two wheels from the result. The wheels are the first and the last link.

        Parameters
        ----------
        path, angles
            Pairs in the order of the path (`PairOnPath`), and the angle (rad) of each pair
            as a ball, a number with an error bound.

        Returns
        -------
        axis_by_pair
            (3,) unit vector on the axis of each pair, in axes of the first link. It is the
            angular velocity of the link after the pair relative to the link before it, if
            the angle of the pair grows at the rate 1.
        rotation
            (3, 3) rotation from the axes of the last link to those of the first.
        """
        # Rotation from the axes of the link reached so far to those of the first link.
        rotation = ball(np.eye(3))
        axis_by_pair = {}
        for step, angle in zip(path, angles, strict=True):
            before = self.sizes.frame(step.pair, step.link_before)
            after = self.sizes.frame(step.pair, step.link_after)
            axis_by_pair[step.pair] = step.sense * (rotation @ before[:, 2])
            # `before` and `after` are the frames of the pair in the two links that it
            # joins. Their third column is the axis of the pair. The pair turns one frame
            # relative to the other about this axis. The sense is -1 if the path leads from
            # the second link of the pair to the first.
            s, c = angle.sin_cos()
            rotation_of_pair = spin(c, step.sense * s, 1)
            rotation = rotation @ before @ rotation_of_pair @ after.T
        return axis_by_pair, rotation


def contact_line(circles, first_centre, second_centre):
    """Return a vector (3,) along the line from the sphere's centre to a rolling contact.

    With the centres a and b of the circles and their radii r and s, it is sin(s) a + sin(r)
    b, or -sin(s) a + sin(r) b if the first circle lies within the second.

    Parameters
    ----------
    circles
        `RollingCircles`.
    first_centre, second_centre
        (3,) unit vectors to the centres, in the same axes.
    """
    first_weight = -circles.second_sine if circles.is_internal else circles.second_sine
    second_weight = circles.first_sine
    return first_weight * first_centre + second_weight * second_centre


def check_wheels(certificate):
    """Check a certificate that wheels roll at the stated ratios, and at no others.

    A certificate is the file of a proof. It states the ratios of the followers (pairs that
    are no inputs). `check_rolling` checks them. It returns the slip at a contact of each
    pair that turns alone at unit rate.

    Suppose other ratios were possible. Then the inputs at rest and the followers at the
    differences of the ratios would cause no slip. This is impossible if the slips of the
    followers are linearly independent.
    """
    ctx.prec = 80  # bits of all balls
    wheels = Wheels(certificate)
    slip_matrices = []
    for contact in wheels.contacts:
        slip = check_rolling(wheels, contact)
        # One column for the slip of each follower; pairs beyond the wheels cause none.
        no_slip = ball(np.zeros(3))
        columns = [slip.get(pair, no_slip) for pair in wheels.followers]
        slip_matrices.append(np.stack(columns, axis=1))
    matrix_of_all = np.concatenate(slip_matrices)
    # A^T A is regular if and only if the columns of A are linearly independent.
    determinant = matrix(matrix_of_all.T @ matrix_of_all).det()
    need(not determinant.contains(0), "ratios that may be others")


def check_rolling(wheels, contact):
    """Check that two wheels roll at the stated ratios, in all positions of their pairs.

    They roll if their circles touch and if they do not slip: at the stated rates, the slips
    by all pairs between them add up to zero. Gap and slip are trigonometric polynomials of
    degree 2 in the angle of each pair. So values at five angles of each pair bound them at
    all angles. `need` refuses the certificate if a condition is false.

    The result has a slip (3,) for each pair: that at the contact while this pair turns
    alone at unit rate, in the last of these positions. The caller uses the slips to show
    that wheels with any other ratios slip in this position (`check_wheels`).
    """
    path = wheels.path_between_wheels(contact)
    need(len(path) <= MAX_PAIRS, "too many pairs between two wheels")
    # Between the five angles, a polynomial exceeds its largest value at these by a factor
    # of at most `INTERPOLATION_NORM` for each pair. So this bound at them implies `MAX_GAP`
    # everywhere.
    allowed = MAX_GAP / INTERPOLATION_NORM ** len(path)
    pair_angles = [2 * arb.pi() * k / ANGLES_PER_PAIR for k in range(ANGLES_PER_PAIR)]
    for angles in itertools.product(pair_angles, repeat=len(path)):
        gap, slip = wheels.slips(contact, angles)
        need(abs(gap) < allowed, "circles that do not touch")
        # (3, inputs): the slip while one input turns at unit rate. `rates` has the stated
        # rate of a pair per unit rate of each input.
        total_slip = sum(np.outer(slip[pair], wheels.rates[pair]) for pair in slip)
        need(np.all(size(total_slip) < allowed), "wheels that slip")
    return slip
