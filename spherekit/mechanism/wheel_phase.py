"""The contact point of two wheels at given angles of their shafts.

A wheel is a link with a circular profile in a rolling contact. The phase of two wheels is
stated in files by the values of their shafts in one configuration. This determines the arc
lengths along both circles at which the wheels touch when the variable of the contact is
zero.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.rotation import about_z
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import Angles, Pair, PoseGeometry
from spherekit.mechanism.joint import Ends
from spherekit.mechanism.joint_construction import make_contact_curves
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, pair_frames
from spherekit.wording import listing


class Wheel(NamedTuple):
    """The circle of a wheel on the unit sphere, in the axes of its link.

    Attributes
    ----------
    centre
        (3,) unit vector to the centre of the circle, on the side to which the normal of the
        curve points.
    zero_direction
        (3,) unit vector perpendicular to `centre`. Azimuths about the centre are counted
        counter-clockwise from this vector.
    radius
        Angle between centre and circle (rad), between 0 and pi.
    start
        Arc length (rad) from the zero direction to the point at which lengths are zero.
    """

    centre: Floats
    zero_direction: Floats
    radius: float
    start: float

    @staticmethod
    def from_curve(curve: Curve, start: float = 0.0) -> "Wheel":
        """Return the wheel whose circle is a curve of constant curvature.

        Arc lengths of the wheel are zero at the point of the curve with the arc length
        `start` (rad).
        """
        # Tangent, normal and point of the curve where its arc length is zero.
        origin = curve.evaluate(np.zeros(1))
        _, normal, point = origin.frame[0].T
        # The geodesic curvature of a circle is the cotangent of its radius. So the radius
        # has the sine 1 / size and the cosine curvature / size. A rotation of the point by
        # the radius, towards the normal, leads to the centre.
        curvature = float(origin.curvature[0])
        size = np.hypot(1.0, curvature)
        return Wheel(
            centre=(normal + curvature * point) / size,
            # A unit vector perpendicular to the centre, in the plane of centre and point.
            zero_direction=(point - curvature * normal) / size,
            radius=float(np.arctan2(1.0, curvature)),
            start=start,
        )

    def arc_length(self, direction: Floats) -> float:
        """Return the arc length (rad) of the point of the circle nearest to a direction.

        `direction` is a vector (3,) in link axes. The length is measured along the circle
        from the point at the `zero_direction`, counter-clockwise and at most half a
        circumference. The result is this length minus `start`.
        """
        side = cross(self.centre, self.zero_direction)
        azimuth = np.arctan2(side @ direction, self.zero_direction @ direction)
        return float(np.sin(self.radius) * azimuth - self.start)


class WheelShaft(NamedTuple):
    """The R pair (hinge) about which a wheel rotates.

    Attributes
    ----------
    pair
        Name of the R pair.
    carrier
        Name of the other link of the pair.
    orientation
        Function that returns, for an angle of the pair (rad), the rotation (3, 3) from the
        axes of the wheel to those of the carrier.
    """

    pair: str
    carrier: str
    orientation: Callable[[float], Floats]


def find_contact_start(mechanism: Mechanism, contact: Pair, phase: Angles) -> Ends:
    """Return the arc lengths at which two wheels touch in a configuration of their shafts.

    Wheels are links with circles as profiles. The shaft of a wheel is the R pair about
    which the wheel rotates. The carrier is the link at the other end of both shafts.

    Parameters
    ----------
    mechanism
        Mechanism given by arcs and angles.
    contact
        A rolling contact of circles. Both its links rotate about R pairs of one carrier.
    phase
        The value (rad) of each of these two R pairs, by its name.

    Returns
    -------
    Arc lengths (rad) along the circles of the first and the second link. If one of the
    shafts is driven, the arc lengths belong to the configuration in which the variable of
    this shaft is zero.

    Raises
    ------
    ModelError
        If these are not the shafts of the wheels, or the mechanism is given in a reference
        pose.
    """
    if isinstance(mechanism.geometry, PoseGeometry):
        raise ModelError(
            "this mechanism is given by a reference pose, which already determines how the "
            "wheels mesh; leave phase out, and give the value of each shaft in the "
            "reference pose"
        )
    shafts = [_find_shaft(mechanism, contact, link, phase) for link in contact.links]
    if shafts[0].carrier != shafts[1].carrier:
        raise ModelError(
            f"the pairs {shafts[0].pair} and {shafts[1].pair} join the wheels to different "
            f"links, {shafts[0].carrier} and {shafts[1].carrier}; name two pairs that join "
            "the wheels to one link that carries both, or give start (the arc lengths "
            "along both circles) in place of phase"
        )
    wheels = [Wheel.from_curve(curve) for curve in make_contact_curves(mechanism, contact)]

    def contact_lengths(angles: Sequence[float]) -> list[float]:
        """Return the arc lengths (rad) at the contact if the shafts have these angles."""
        rotations = [
            shaft.orientation(angle) for shaft, angle in zip(shafts, angles, strict=True)
        ]
        return find_wheel_contact(wheels, rotations)

    angles = [phase[shaft.pair] for shaft in shafts]
    driven_sides = [
        side for side, shaft in enumerate(shafts) if shaft.pair in mechanism.input_pairs
    ]
    # Roll both wheels until the driven shaft reads zero.
    if driven_sides:
        driven = driven_sides[0]
        other = 1 - driven
        # If a shaft rotates by an angle, the length along its circle grows by plus or minus
        # the sine of the radius times the angle. A test rotation of both shafts by 0.1 rad
        # shows the sign: growth / circle_sines is then plus or minus 0.1, apart from whole
        # turns by which the lengths may jump. The sine removes these turns.
        circle_sines = np.sin([wheel.radius for wheel in wheels])
        growth = np.subtract(
            contact_lengths([angle + 0.1 for angle in angles]), contact_lengths(angles)
        )
        lengths_per_angle = np.sign(np.sin(growth / circle_sines)) * circle_sines
        # In rolling, both lengths grow by the same amount.
        ratio = float(lengths_per_angle[driven] / lengths_per_angle[other])
        angles[other] -= ratio * angles[driven]
        angles[driven] = 0.0
    first_length, second_length = contact_lengths(angles)
    return first_length, second_length


def _find_shaft(
    mechanism: Mechanism, contact: Pair, wheel: str, phase: Angles
) -> WheelShaft:
    """Find the R pair (hinge) about which a wheel of a rolling contact rotates.

    The caller rotates both wheels about their shafts, to find where their circles touch.

    Parameters
    ----------
    mechanism
        The mechanism.
    contact
        The rolling contact of the wheel.
    wheel
        Name of the link with the circle.
    phase
        Angles (rad) of the shafts of both wheels in one configuration, by the names of
        their R pairs. The shaft is chosen among these names. The angles are not used here.

    Raises
    ------
    ModelError
        If none of the pairs is an R pair of the wheel, or the wheel has no circle.
    """
    pairs = [mechanism.pair(name) for name in phase]
    shaft = next((x for x in pairs if x.kind.has_axis and wheel in x.links), None)
    if shaft is None:
        raise ModelError(
            f"none of {listing(phase)} is an R pair of link {wheel}; name the shafts of "
            "both wheels"
        )
    side = contact.links.index(wheel)
    if contact.profiles is None or contact.profiles[side].round_axis is None:
        raise ModelError(f"the profile of {wheel} is not a circle about a shaft")
    first_frames, second_frames = pair_frames(mechanism)
    # The second link of a pair is rotated relative to the first by the angle, about the z
    # axis of the frames of the pair in both links.
    first = first_frames[shaft.name]
    second = second_frames[shaft.name]
    # The orientation is the rotation matrix from the wheel to the other link of the shaft.
    if shaft.links[1] == wheel:
        return WheelShaft(
            pair=shaft.name,
            carrier=shaft.links[0],
            orientation=lambda angle: first @ about_z(angle) @ second.T,
        )
    return WheelShaft(
        pair=shaft.name,
        carrier=shaft.links[1],
        orientation=lambda angle: second @ about_z(-angle) @ first.T,
    )


def find_wheel_contact(
    wheels: Sequence[Wheel], orientations: Sequence[Floats]
) -> list[float]:
    """Return the arc lengths (2,) along two wheels at the point where they touch.

    A file can state how two wheels mesh by their phase: the angles of their shafts in one
    configuration. The contact point in this configuration is found here.

    Parameters
    ----------
    wheels
        The two wheels.
    orientations
        Rotations (3, 3) from the axes of each wheel to those of the carrier, the link on
        which both wheels rotate.

    Raises
    ------
    ModelError
        If the centres of both wheels are on one line through the centre of the sphere.
    """
    first_radius, second_radius = (wheel.radius for wheel in wheels)
    # Unit vectors to the centres, in the axes of the carrier.
    first_centre, second_centre = (
        rotation @ wheel.centre
        for wheel, rotation in zip(wheels, orientations, strict=True)
    )
    # Each circle has two opposite centres on the sphere. Where the wheels touch, both
    # curves have the same normal. A great circle from the contact point along this normal
    # leads to both centres `Wheel.centre`. The arc to each centre is the radius (rad).
    #
    # So the arc from the first centre back to the contact point leads towards the second
    # centre if the second radius is smaller, otherwise away from it. `across` is the part
    # of the second centre perpendicular to the first.
    across = second_centre - (first_centre @ second_centre) * first_centre
    size = np.linalg.norm(across)
    have_same_line = size < COLLINEAR_SINE
    if have_same_line:
        raise ModelError(
            "both wheels turn about the same line, so phase has no meaning; leave phase out"
        )
    # 1 if the first circle is larger, -1 if it is smaller. Equal circles would have the
    # same centre, which is refused above.
    side = np.sign(first_radius - second_radius)
    # (3,) unit vector to the contact point.
    point = (
        np.cos(first_radius) * first_centre + np.sin(first_radius) * side * across / size
    )
    # The transposed rotation leads back to the axes of each wheel.
    return [
        wheel.arc_length(rotation.T @ point)
        for wheel, rotation in zip(wheels, orientations, strict=True)
    ]
