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
    """The two circles of a rolling contact.

    Attributes
    ----------
    first_centre, second_centre
        (3,) unit vectors to the centres, each in its link.
    first_sine, second_sine
        Sines of both radii, or numbers proportional to them: the numbers of teeth.
    arc
        Arc (rad) between the centres.
    is_internal
        Whether the second circle lies within the first.
    """

    first_centre: Any
    second_centre: Any
    first_sine: Any
    second_sine: Any
    arc: Any
    is_internal: bool


class Wheels:
    """The links of a file whose R pairs join all links without a loop."""

    def __init__(self, certificate):
        """Read the links, the contacts, and the stated rates of all pairs by the inputs.

        R pairs must join all links without a loop. `rates` has for each of them one ball (a
        number with an error bound) per input: the rate of the pair while only this input
        turns, at unit rate. The certificate states the rates of the followers, the pairs
        that are no inputs, as numbers ("ratios") with a bound of their error ("off").
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
            need(0 <= row["off"] < 1e-12, "ratios that are no numbers")
            self.rates[row["pair"]] = [arb(ratio, row["off"]) for ratio in row["ratios"]]
        need(sorted(self.rates) == sorted(self.sizes.ends), "pairs are missing")
        self.followers = [row["pair"] for row in certificate["ratios"]]
        self.contacts = [n for n, p in data["pairs"].items() if p["type"] == "Cr"]
        need(len(self.sizes.ends) == len(self.sizes.links) - 1, "a loop of R pairs")

    def path_of_pairs(self, start, goal):
        """Return the pairs from one link to another, in order.

        Each pair is given with the index, 0 or 1, of the link of the pair that comes first
        on the path.
        """
        reached = {start: []}
        waiting = [start]
        for link in waiting:
            for pair, ends in self.sizes.ends.items():
                further = ends[1 - ends.index(link)] if link in ends else None
                if further is not None and further not in reached:
                    reached[further] = [*reached[link], (pair, ends.index(link))]
                    waiting.append(further)
        need(goal in reached, "wheels that no pairs join")
        return reached[goal]

    def circles_of(self, contact):
        """Return the two circles of a rolling contact, as `RollingCircles`.

        The file gives circles by their centres and radii. Or it gives cones, with their
        axes and their numbers of teeth or half angles. A cone intersects the sphere in a
        circle, whose radius is the half angle of the cone. Only the ratio of the sines of
        both radii matters for rolling, and numbers of teeth have the same ratio.
        """
        item = self.sizes.data["pairs"][contact]
        # In an internal contact the second circle lies within the first.
        is_internal = item.get("contact", "external") == "internal"
        if "axes" not in item:
            (first_centre, first_radius), (second_centre, second_radius) = (
                self.sizes.circle(contact, link) for link in item["links"]
            )
            if is_internal:
                arc = first_radius - second_radius
            else:
                arc = first_radius + second_radius
            return RollingCircles(
                first_centre,
                second_centre,
                first_radius.sin(),
                second_radius.sin(),
                arc,
                is_internal,
            )
        need(item.keys() & {"teeth", "half_angles"}, "cones of no size")
        frames = [
            self.sizes.frame(pair, link)
            for pair, link in zip(item["axes"], item["links"], strict=True)
        ]
        first_centre, second_centre = (frame[:, 2] for frame in frames)

        # The link that carries both wheels has both axes, whose arc is measured there.
        first_ends, second_ends = (self.sizes.ends[pair] for pair in item["axes"])
        carrier = next(link for link in first_ends if link in second_ends)
        u, v = (self.sizes.frame(pair, carrier)[:, 2] for pair in item["axes"])
        normal = np.cross(u, v)
        arc = arb.atan2((normal @ normal).sqrt(), u @ v)
        if "teeth" in item:
            first_sine, second_sine = (arb(int(count)) for count in item["teeth"])
        else:
            # The cones touch, so the arc between their axes is the sum of both half angles,
            # or their difference. The second half angle follows, even if the file has it.
            half_angle = self.sizes.angle(item["half_angles"][0]) + self.sizes.slack
            second_half_angle = half_angle - arc if is_internal else arc - half_angle
            first_sine = half_angle.sin()
            second_sine = second_half_angle.sin()
        return RollingCircles(
            first_centre, second_centre, first_sine, second_sine, arc, is_internal
        )

    def slips(self, contact, angles):
        """Return the gap of two circles, and the slip that each pair between them causes.

        Let a and b be the centres of the circles, and r and s their radii. The circles
        touch at the point along the contact line sin(s) a + sin(r) b, or -sin(s) a +
        sin(r) b if the second circle lies within the first. They roll if the angular
        velocity of one relative to the other has no part across this line: if its cross
        product with the line, the slip, is zero.

        Parameters
        ----------
        contact
            Name of the rolling contact.
        angles
            Angles (balls, rad) of the pairs on the path from the first wheel to the second.

        Returns
        -------
        gap
            Cosine of the arc between the centres, less that of touching circles.
        slip
            (3,) vectors by pair, in axes of the first wheel: the slip while the pair turns
            at unit rate. It is the cross product of the pair's axis with the contact line.
        """
        first_link, second_link = self.sizes.data["pairs"][contact]["links"]
        circles = self.circles_of(contact)
        # The rotation from the axes of a link on the path to those of the first wheel. It
        # is continued from link to link.
        rotation = ball(np.eye(3))
        axes_in_first_wheel = {}
        path = self.path_of_pairs(first_link, second_link)
        for (pair, link_index), angle in zip(path, angles, strict=True):
            ends = self.sizes.ends[pair]
            before = self.sizes.frame(pair, ends[link_index])
            after = self.sizes.frame(pair, ends[1 - link_index])
            # A pair turns its second link (index 1) relative to its first. On a path from
            # the second to the first, the rotation is the inverse one.
            sign = -1 if link_index == 1 else 1
            s, c = angle.sin_cos()
            axes_in_first_wheel[pair] = sign * (rotation @ before[:, 2])
            # The third axis of both frames is that of the pair. The entries of the rotation
            # about it are cos, sin, and 1 on the axis.
            rotation_of_pair = spin(c, sign * s, 1)
            rotation = rotation @ before @ rotation_of_pair @ after.T
        first_centre = circles.first_centre
        second_centre = rotation @ circles.second_centre
        first_weight = circles.second_sine
        if circles.is_internal:
            first_weight = -first_weight
        second_weight = circles.first_sine
        contact_line = first_weight * first_centre + second_weight * second_centre
        slip = {}
        for pair, axis in axes_in_first_wheel.items():
            slip[pair] = np.cross(axis, contact_line)
        gap = first_centre @ second_centre - circles.arc.cos()
        return gap, slip


def check_wheels(certificate):
    """Check a certificate that wheels roll at the stated ratios, and at no others.

    Two wheels roll if their circles touch and the slips of all pairs between them, at the
    stated rates of the pairs, add up to zero. Gap and slip are trigonometric polynomials of
    degree 2 in the angle of each pair, so values at five angles of each pair bound them at
    all angles.

    No other ratios make the slips zero if the slips of the followers, whose ratios the
    certificate states, are linearly independent.
    """
    ctx.prec = 80  # bits of all balls
    wheels = Wheels(certificate)
    slip_matrices = []
    for contact in wheels.contacts:
        first_link, second_link = wheels.sizes.data["pairs"][contact]["links"]
        path = wheels.path_of_pairs(first_link, second_link)
        need(len(path) <= MAX_PAIRS, "too many pairs between two wheels")
        # Between the five angles, a polynomial exceeds its largest value at these by a
        # factor of at most `INTERPOLATION_NORM` for each pair. So this bound at them
        # implies `MAX_GAP` everywhere.
        allowed = MAX_GAP / INTERPOLATION_NORM ** len(path)
        pair_angles = [2 * arb.pi() * k / ANGLES_PER_PAIR for k in range(ANGLES_PER_PAIR)]
        for angles in itertools.product(pair_angles, repeat=len(path)):
            gap, slip = wheels.slips(contact, angles)
            need(abs(gap) < allowed, "circles that do not touch")
            # (3, inputs): the slip while one input turns at unit rate.
            total = sum(np.outer(slip[pair], wheels.rates[pair]) for pair in slip)
            need(np.all(size(total) < allowed), "wheels that slip")
        # Constant ratios that hold at all angles hold at the last ones, which are enough to
        # exclude others. The columns are the slips of the followers.
        zero = ball(np.zeros(3))
        columns = [slip.get(pair, zero) for pair in wheels.followers]
        slip_matrices.append(np.stack(columns, axis=1))
    matrix_of_all = np.concatenate(slip_matrices)
    # A^T A is regular if and only if the columns of A are linearly independent.
    determinant = matrix(matrix_of_all.T @ matrix_of_all).det()
    need(not determinant.contains(0), "ratios that may be others")
