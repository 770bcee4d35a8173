"""Checks that wheels in mesh turn as a certificate says, without spherekit.

Circles about a and b that touch roll on each other if their links' angular velocities
differ by a vector along the contact only, which is at u a + v b for numbers u and v. Each
of these products is a trigonometric polynomial of degree 2 in every angle between the
wheels, so that values at five angles of each bound it everywhere.

`arb` is a ball: a number with a rigorous bound of its error. All arithmetic is in balls.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx
from oracles.proof_checker import Sizes, ball, matrix, need, size, spin

TOUCHING = 1e-9
"""Decimal numbers say only nearly that a wheel's carrier is where its circle is."""
NODES = 5
NORM = 2.0
"""Norm of interpolation at five evenly spaced angles, rounded up."""
MOST = 6
"""Pairs on the way from one wheel to the other."""


class RollingCircles(NamedTuple):
    """The two circles of a rolling contact.

    Attributes
    ----------
    first_centre, second_centre
        (3,) unit vectors to the centres, each in its link.
    first_size, second_size
        Two numbers in the ratio of the sines of both radii: numbers of teeth, or the sines.
    arc
        Arc (rad) between the centres.
    is_internal
        Whether the second circle lies within the first.
    """

    first_centre: Any
    second_centre: Any
    first_size: Any
    second_size: Any
    arc: Any
    is_internal: bool


class Wheels:
    """The links of a file that hang on its R pairs without a loop."""

    def __init__(self, certificate):
        """Read the links, the contacts, and the stated rates of all pairs by the inputs.

        `rates` has for each pair one ball per input: the rate of the pair while this input
        turns at unit rate. The certificate states a rate by a number and a bound ("off") of
        its error. R pairs must join all links without a loop. Followers are the pairs whose
        rates follow from rolling contacts ("Cr").
        """
        self.sizes = Sizes(
            certificate["mechanism"],
            certificate["tolerance_rad"],
            couplers=None,
            wheels=True,
        )
        data = self.sizes.data
        self.inputs = list(data["inputs"])
        self.columns = certificate["inputs"]
        need(sorted(self.inputs) == sorted(self.columns), "other inputs")
        self.rates = {}
        for name in self.columns:
            self.rates[name] = [arb(int(name == column)) for column in self.columns]
        for row in certificate["ratios"]:
            need(row["pair"] not in self.rates, "a pair twice")
            need(len(row["ratios"]) == len(self.columns), "other inputs")
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
        circle, whose radius is the half angle of the cone.
        """
        item = self.sizes.data["pairs"][contact]
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
            first_size, second_size = (arb(int(count)) for count in item["teeth"])
        else:
            half_angle = self.sizes.angle(item["half_angles"][0])
            second_half_angle = half_angle - arc if is_internal else arc - half_angle
            first_size = half_angle.sin()
            second_size = second_half_angle.sin()
        return RollingCircles(
            first_centre, second_centre, first_size, second_size, arc, is_internal
        )

    def slips(self, contact, angles):
        """Return the gap of two circles, and the slip that each pair between them causes.

        Let a and b be the centres of the circles, and r and s their radii. The circles
        touch at the point along sin(s) a + sin(r) b, or -sin(s) a + sin(r) b if the second
        circle lies within the first. This is the vector along the contact.

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
            (3,) slip per unit rate, by pair. It is the cross product of the axis of the
            pair with a vector along the contact.
        """
        first_link, second_link = self.sizes.data["pairs"][contact]["links"]
        circles = self.circles_of(contact)
        # The rotation from the axes of a link on the path to those of the first wheel, and
        # the axes of all pairs there.
        rotation = ball(np.eye(3))
        axes = {}
        path = self.path_of_pairs(first_link, second_link)
        for (pair, side), angle in zip(path, angles, strict=True):
            ends = self.sizes.ends[pair]
            before = self.sizes.frame(pair, ends[side])
            after = self.sizes.frame(pair, ends[1 - side])
            sense = -1 if side else 1
            s, c = angle.sin_cos()
            axes[pair] = sense * (rotation @ before[:, 2])
            # A rotation about the third axis, in the frames of the pair.
            rotation_of_pair = spin(c, sense * s, 1)
            rotation = rotation @ before @ rotation_of_pair @ after.T
        first_centre = circles.first_centre
        second_centre = rotation @ circles.second_centre
        first_weight = circles.second_size
        if circles.is_internal:
            first_weight = -first_weight
        contact_line = first_weight * first_centre + circles.first_size * second_centre
        slip = {pair: np.cross(axis, contact_line) for pair, axis in axes.items()}
        gap = first_centre @ second_centre - circles.arc.cos()
        return gap, slip


def check_wheels(certificate):
    """Check a certificate that wheels roll at the stated ratios, and at no others.

    On a grid of angles between two wheels, their circles touch, and the slips of all pairs
    at the stated rates add up to zero. Gap and slip are trigonometric polynomials of degree
    2 in the angle of each pair, so five angles of each determine them. They exceed their
    largest value on the grid by a factor of at most `NORM` for each pair.

    The slips of the pairs whose ratios are stated (followers) are the columns of a matrix.
    If it has full rank, no other ratios make the slips zero.
    """
    ctx.prec = 80
    wheels = Wheels(certificate)
    slip_matrices = []
    for contact in wheels.contacts:
        first_link, second_link = wheels.sizes.data["pairs"][contact]["links"]
        path = wheels.path_of_pairs(first_link, second_link)
        need(len(path) <= MOST, "too many pairs between two wheels")
        # The bound on the grid that implies `TOUCHING` at all angles.
        allowed = TOUCHING / NORM ** len(path)
        nodes = [2 * arb.pi() * k / NODES for k in range(NODES)]
        for angles in itertools.product(nodes, repeat=len(path)):
            gap, slip = wheels.slips(contact, angles)
            need(abs(gap) < allowed, "circles that do not touch")
            total = sum(np.outer(slip[pair], wheels.rates[pair]) for pair in slip)
            need(np.all(size(total) < allowed), "wheels that slip")
        zero = ball(np.zeros(3))
        columns = [slip.get(pair, zero) for pair in wheels.followers]
        slip_matrices.append(np.stack(columns, axis=1))
    matrix_of_all = np.concatenate(slip_matrices)
    determinant = matrix(matrix_of_all.T @ matrix_of_all).det()
    need(not determinant.contains(0), "ratios that may be others")
