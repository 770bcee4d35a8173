"""The geometry of a mechanism as balls around the decimal numbers of its file.

An angle that the file writes as 45.1 degrees is the ball of 45.1 pi / 180, and not the
float64 number next to it. A tolerance widens every such ball.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import TURN
from spherekit.files.toml_document import Document, LiteralNumber
from spherekit.mechanism.bevel_gears import find_gear_carrier
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.proof.ball_frames import (
    Frame,
    Frames,
    Vector,
    azimuth_frame,
    exact_ball,
    frames_from_pose,
    frames_from_sizes,
    unit_vector,
)
from spherekit.proof.balls import Ball, flint_library, pi_ball, polar_angle, widen

AXIS_KEYS = {"through_xyz", "through_lonlat", "xyz", "lonlat"}
"""Keys of a pair in a file that state where its axis is."""

PHASE_ERROR_RAD = 1e-13
"""Error bound (rad) of an arc length `start` that the reader computes from a phase.

At this arc length the variable of the contact is 0. The bound is valid for a phase of up to
one turn and equal wheels. For more turns, or unequal wheels, the bound grows in proportion
to the length that the wheels have rolled.
"""


@dataclass(frozen=True)
class CircleContact:
    """Two circles along which two links touch, each circle in the axes of its link.

    All numbers are balls: numbers with a bound of their error.

    Attributes
    ----------
    frames
        For each circle (3, 3) with unit vectors as rows: the directions of azimuth 0 and 90
        degrees about the centre, and the centre. The centre of a great circle is its pole.
    radii
        Angular radii (rad) of both circles.
    sines
        Two numbers in the ratio of the sines of the radii; wheels turn in this ratio. If
        the file gives numbers of teeth, the result has these numbers, since their ratio is
        exact.
    sense
        1 if one circle is inside its partner (internal contact), -1 if the circles are side
        by side (external contact). Wheels in internal contact turn in the same direction
        about their centres, in external contact in opposite directions.
    """

    frames: Sequence[Frame]
    radii: Sequence[Ball]
    sines: Sequence[Ball]
    sense: int

    @property
    def centre_arc(self) -> Ball:
        """Arc (rad) from the centre of the first circle to the centre of the second.

        Both circles touch, and the arc is on the great circle through the centres and the
        contact. The arc is positive in the direction from the first centre to the contact.
        In external contact it is the sum of the radii. In internal contact it is their
        difference, which can be negative.
        """
        return self.radii[0] - self.sense * self.radii[1]

    def contact_directions(
        self, first_centre: Vector, second_centre: Vector
    ) -> tuple[Vector, Vector]:
        """Return the directions from the centres of two circles to their contact point.

        The directions are unit tangents of the sphere at the centres. The contact point is
        on the great circle through both centres. "Forwards" on this great circle is the
        direction of the shorter way from the first centre to the contact point.

        Parameters
        ----------
        first_centre, second_centre
            (3,) unit vectors in any common axes, which are the axes of the result, too.
        """
        # Both tangents point forwards. `centre_arc` is the arc from the first centre to the
        # second. It is positive if it leads forwards, and negative if it leads backwards.
        tangent_at_first, tangent_at_second = _great_circle_tangents(
            first_centre, second_centre, self.centre_arc
        )
        # By the definition of forwards, the contact is forwards from the first centre. If
        # one circle is inside the other (`sense` 1), both centres are on the same side of
        # the contact. The contact is then forwards from the second centre. If the circles
        # are side by side (`sense` -1), the second centre is beyond the contact.
        return tangent_at_first, self.sense * tangent_at_second


def _great_circle_tangents(
    first: Vector, second: Vector, arc: Ball
) -> tuple[Vector, Vector]:
    """Return the unit tangents of a great circle at two of its points.

    All numbers are balls (numbers with a bound of their error).

    Parameters
    ----------
    first, second
        (3,) the points, as unit vectors.
    arc
        Arc (rad) from the first point to the second. Both tangents point in the sense in
        which this arc is positive.
    """
    sine, cosine = arc.sin_cos()
    # With c = `first` and its tangent d, the point at an arc x is cos(x) c + sin(x) d. The
    # second point, at x = `arc`, gives d. The tangent there is -sin(x) c + cos(x) d.
    tangent_at_first = (second - cosine * first) / sine
    tangent_at_second = (cosine * second - first) / sine
    return tangent_at_first, tangent_at_second


@dataclass(frozen=True)
class _ContactCircle:
    """The circle of one link in a contact pair, such as a pair of bevel gears.

    It touches the circle of the other link. All numbers are balls: numbers with a bound of
    their error.

    Attributes
    ----------
    centre
        Unit vector (3,) in link axes. A flat follower has a great circle, whose centre is
        its pole.
    radius
        Angular radius (rad). It is pi / 2 for a great circle.
    """

    centre: Vector
    radius: Ball


@dataclass(frozen=True)
class DecimalGeometry:
    """The sizes of a mechanism as the exact decimal numbers of its file, for proofs.

    Attributes
    ----------
    mechanism
        The mechanism that the file describes.
    document
        The parsed file. Its numbers remember how they were written.
    tolerance
        Bound (rad) of the error of every arc, angle, zero and direction of the file.
    """

    mechanism: Mechanism
    document: Document
    tolerance: float

    @property
    def in_degrees(self) -> bool:
        """Whether angles of the file are in degrees and not in radians."""
        return bool(self.document.data["angle_unit"] == "deg")

    def pair_table(self, pair: str) -> Mapping[str, Any]:
        """Return the table of a pair in the file."""
        table: Mapping[str, Any] = self.document.data["pairs"][pair]
        return table

    def angle_ball(self, number: float, has_tolerance: bool = True) -> Ball:
        """Return an angle of the file in rad, widened by the tolerance on request."""
        unit = pi_ball() / 180 if self.in_degrees else exact_ball(1.0)
        return widen(_number_ball(number) * unit, self.tolerance if has_tolerance else 0.0)

    def input_angle(self, text: str) -> Ball:
        """Return an input (rad) from a decimal number in the unit of the file."""
        return self.angle_ball(LiteralNumber(text), has_tolerance=False)

    def input_range_text(self, pair: str) -> tuple[str, str]:
        """Return the lower and the upper end of an input's range as the file writes them.

        If the file gives no range, the range is one turn from 0 on. `pair` is the name of
        the input.
        """
        table = self.document.data.get("inputs", {}).get(pair, {})
        turn = 360 if self.in_degrees else 2 * math.pi
        ends = decimal_text(table.get("from", 0)), decimal_text(table.get("to", turn))
        low, high = sorted(ends, key=float)
        return low, high

    def revolute_frames(self) -> Frames:
        """Return the frames of the revolute pairs in their two links, by names of pairs.

        With these frames, configurations are computed from the exact decimal numbers of the
        file, not from numbers rounded to float64.

        A frame (3, 3) has three unit vectors in link axes as rows: the zero direction, from
        which the pair angle is counted, the side (axis x zero direction), and the axis.
        Components are balls, numbers with a bound of their error, around the decimal
        numbers of the file. The file gives either all axes in one pose, or arcs and angles
        of the links.
        """
        geometry = self.mechanism.geometry
        # 1. The file gives all axes in one pose. The key "value" of a pair is its angle in
        #    this pose.
        if isinstance(geometry, PoseGeometry):
            axes = {
                name: self._axis_direction(self.pair_table(name)) for name in geometry.axes
            }
            return frames_from_pose(geometry, axes, self.pair_angles("value"))

        # 2. The file gives for each link the arcs between its axes, and the angles between
        #    these arcs. The key "zero" of a pair is the angle between its links where its
        #    variable is zero.
        sizes = {
            link: [
                [self.angle_ball(number) for number in table.get(key, [])]
                for key in ("arcs", "angles")
            ]
            for link, table in self.document.data["links"].items()
            if link in geometry.links
        }
        zeros = self.pair_angles("zero")
        return frames_from_sizes(self.mechanism, geometry, sizes, zeros)

    def pair_angles(self, key: str) -> dict[str, Ball]:
        """Return the angles (rad) that pairs of the file have under a key, by pair."""
        return {
            name: self.angle_ball(table[key])
            for name, table in self.document.data["pairs"].items()
            if key in table
        }

    def circle_contact(self, contact: int) -> CircleContact:
        """Return the two touching circles of a contact pair of the file.

        Proofs derive from them the link that replaces a sliding contact, or the equation of
        two rolling wheels.

        The file describes the circles as bevel gears (shafts, with teeth or half angles of
        the cones), or as profiles (centre and radius of each). All numbers are balls
        (numbers with a bound of their error).

        Parameters
        ----------
        contact
            Index of the contact among the pairs of the mechanism. Both its profiles must be
            circles.
        """
        pair = self.mechanism.pairs[contact]
        table = self.pair_table(pair.name)
        # Whether the circles are beside each other (-1) or one inside the other (1).
        sense = -1 if pair.contact == "external" else 1
        is_bevel_gear_pair = "axes" in table
        if is_bevel_gear_pair:
            circles = self._gear_circles(table, pair.links, sense)
        else:
            frames = self.revolute_frames()
            circles = [self._profile_circle(table, link, frames) for link in pair.links]

        # Rolling circles turn in the ratio of the sines of their radii, so only this ratio
        # is used. Numbers of teeth have the same ratio, and are exact.
        if "teeth" in table:
            sines = [exact_ball(teeth) for teeth in table["teeth"]]
        else:
            sines = [circle.radius.sin() for circle in circles]
        return CircleContact(
            # In these frames the azimuths of contact points about the centres are measured.
            frames=[azimuth_frame(circle.centre) for circle in circles],
            radii=[circle.radius for circle in circles],
            sines=sines,
            sense=sense,
        )

    def _gear_circles(
        self, table: Mapping[str, Any], gears: tuple[str, str], sense: int
    ) -> list[_ContactCircle]:
        """Return the circles along which two bevel gears roll.

        The file names the shaft of each gear, a revolute pair, and gives teeth or half
        angles of the cones. The centre of a gear's circle is the axis of its shaft, in the
        link of the gear. The angle between the shafts is measured in the carrier, the link
        in which both turn. All numbers are balls (numbers with error bounds).

        Parameters
        ----------
        table
            Table of the contact in the file.
        gears
            Names of the links of both gears.
        sense
            1 for internal, -1 for external contact.
        """
        frames = self.revolute_frames()
        shaft_names = table["axes"]
        centres = [
            self._pair_axis(frames, shaft_name, gear)
            for shaft_name, gear in zip(shaft_names, gears, strict=True)
        ]
        joined_links = {name: self.mechanism.pair(name).links for name in frames}
        gear_carrier = find_gear_carrier(
            joined_links, link_axes(self.mechanism), gears, shaft_names
        )
        # `shaft.sense` is -1 if the axis of the shaft has the opposite direction in the
        # carrier.
        first_shaft, second_shaft = (
            shaft.sense * self._pair_axis(frames, shaft.pair, gear_carrier.link)
            for shaft in gear_carrier.shafts
        )
        radii = self._cone_half_angles(table, first_shaft, second_shaft, sense)
        return [
            _ContactCircle(centre, radius)
            for centre, radius in zip(centres, radii, strict=True)
        ]

    def _pair_axis(self, frames: Frames, pair: str, link: str) -> Vector:
        """Return the axis (3,) of an R pair in the axes of one of its links.

        The axis is a vector of balls (numbers with a bound of their error). `frames` has
        the frames of each R pair in its two links.
        """
        side = self.mechanism.pair(pair).links.index(link)
        # The rows of a frame are the zero direction, the side and the axis of the pair.
        return frames[pair][side][2]

    def contact_starts(self, contact: int) -> Array:
        """Return the arc lengths (2,) rad on both circles where the pair variable is 0."""
        pair = self.mechanism.pairs[contact]
        table = self.pair_table(pair.name)
        if "phase" in table:
            # The file has no key `start`. The file reader computed both arc lengths in
            # float64 from the phase (the angles of both shafts in one configuration). If a
            # shaft is driven, the file reader rolled the wheels until its angle was 0.
            turn = 360.0 if self.in_degrees else TURN
            turns = max(map(abs, table["phase"].values())) / turn
            # A great circle has no radius.
            radii = [profile.radius or math.pi / 2 for profile in pair.profiles or ()]
            sines = np.sin(radii)
            # The circumference of a circle is 2 pi times the sine of its radius. So while
            # the wheel with the longer circle makes one turn, the other wheel makes
            # `largest_ratio` turns. Rounding errors grow with the number of turns.
            largest_ratio = float(np.max(sines) / np.min(sines))
            error = PHASE_ERROR_RAD * max(1.0, turns * largest_ratio)
            return np.array([widen(length, error) for length in pair.start])
        starts = table.get("start", (0.0, 0.0))
        return np.array([self.angle_ball(start, has_tolerance=False) for start in starts])

    def _axis_direction(self, table: Mapping[str, Any]) -> Vector:
        """Return the unit axis (3,) of a pair in ground axes, from its table in the file.

        Under a key "through_..." the table has two directions on the great circle along
        which a P pair slides. The axis is perpendicular to both.
        """
        (key,) = AXIS_KEYS & table.keys()
        if key.startswith("through"):
            first, second = (self._direction(row, key) for row in table[key])
            return unit_vector(np.cross(first, second))
        return self._direction(table[key], key)

    def _direction(self, row: Any, key: str) -> Vector:
        """Return a unit vector (3,) from a row of the file.

        Depending on the end of `key` the row has three coordinates ("xyz") or longitude and
        latitude ("lonlat").
        """
        if key.endswith("xyz"):
            direction = unit_vector(np.array([_number_ball(number) for number in row]))
            return direction + widen(0.0, self.tolerance)
        longitude, latitude = (self.angle_ball(number) for number in row)
        sine, cosine = longitude.sin_cos()
        height, equatorial = latitude.sin_cos()
        return np.array([cosine * equatorial, sine * equatorial, height])

    def _cone_half_angles(
        self,
        table: Mapping[str, Any],
        first_shaft: Vector,
        second_shaft: Vector,
        sense: int,
    ) -> tuple[Ball, Ball]:
        """Return the half angles (rad) of the pitch cones of two bevel gears.

        With the angle g between the shafts, the cones touch if their half angles a and b
        satisfy b = g - a (external contact) or b = g + a (internal contact). If the file
        gives numbers of teeth, sin(a) : sin(b) is their ratio, which determines a.
        Otherwise the file gives a. All numbers are balls (numbers with error bounds).

        Parameters
        ----------
        table
            Table of the contact in the file.
        first_shaft, second_shaft
            (3,) unit axes of the gears in the axes of the carrier, the link in which both
            turn.
        sense
            1 for internal, -1 for external contact.
        """
        normal = np.cross(first_shaft, second_shaft)
        shaft_angle = polar_angle(first_shaft @ second_shaft, (normal @ normal).sqrt())
        if "teeth" in table:
            sine, cosine = shaft_angle.sin_cos()
            first_teeth, second_teeth = table["teeth"]
            ratio = exact_ball(second_teeth) / first_teeth
            # From sin(b) = ratio sin(a): tan(a) = sin(g) / (ratio - sense cos(g)).
            first = polar_angle(ratio - sense * cosine, sine)
        else:
            first = self.angle_ball(table["half_angles"][0])
        return first, shaft_angle + sense * first

    def _profile_circle(
        self, table: Mapping[str, Any], link: str, frames: Frames
    ) -> _ContactCircle:
        """Read from the mechanism file the circle along which a link touches another one.

        The numbers of the circle are balls (numbers with error bounds). The file gives the
        centre as a direction or by the name of a revolute pair. The radius in the file is
        that of a roller or of the profile (contact curve) of the link.

        Parameters
        ----------
        table
            Table of the contact in the file.
        link
            Name of the link.
        frames
            By name of a revolute pair: its frames in both links. Each has the axis as its
            last row.
        """
        # The circle of a roller is under "follower", all other circles under the link's
        # name in "profiles".
        circle = table.get("follower", {})
        if circle.get("link") != link:
            circle = table["profiles"][link]
        if "axis" in circle:
            # The centre is on the axis of a revolute pair of the link.
            centre = self._pair_axis(frames, circle["axis"], link)
        else:
            # The key is for example "centre_xyz", or "pole_lonlat" for a flat follower.
            key = next(key for key in circle if key.startswith(("centre", "pole")))
            centre = self._direction(circle[key], key)
        radius = circle.get("roller", circle.get("radius"))
        if radius is None:
            # A circle without a radius is a great circle about its pole.
            return _ContactCircle(centre, pi_ball() / 2)
        return _ContactCircle(centre, self.angle_ball(radius))


def decimal_text(number: float) -> str:
    """Return a number of a file as the file writes it."""
    return number.text if isinstance(number, LiteralNumber) else str(number)


def _number_ball(number: float) -> Ball:
    """Return a number of a file as a ball, which is a number with a bound of its error.

    A decimal number such as 45.1 is no float64 number. If its text is known, the ball
    contains the decimal number. Otherwise the float64 number counts as exact.
    """
    if isinstance(number, LiteralNumber):
        ball = flint_library().arb(number.text.replace("_", ""))
        assert ball.is_finite()
        return ball
    return exact_ball(number)
