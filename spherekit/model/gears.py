"""Bevel gears as rolling cones: pitch cones from numbers of teeth and the shaft angle.

Where each pair's axis and zero direction sit in its two links.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, final

import numpy as np

from spherekit.conventions import EPS, listing, nearest
from spherekit.errors import ModelError
from spherekit.model.joints import Joint, Revolute, Rolling, Sliding
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, Pair, PoseGeometry, Profile, SizeGeometry
from spherekit.sphere.profile import Curve, circle, fourier, great_circle, through
from spherekit.sphere.rotation import Floats, about_z, arc, cross, frame_from, perpendicular
from spherekit.sphere.touching import nearest_frames

Vector = tuple[float, float, float]

SAME_AXIS = 16 * EPS
"""Sine below which two axes of a link are one: rounding of their arcs and angles."""
COLLINEAR = 1e-9
"""Below this sine two directions count as one line: they fix no arc."""


@final
@dataclass(frozen=True)
class Geometry:
    """The joints of a mechanism, in the order of its pairs.

    `reference` holds the variables of the given reference pose, if there is one.
    """

    joints: tuple[Joint, ...]
    reference: Floats | None


TOUCHING = 1e-6
"""Profiles must meet in the reference pose to this (rad); then they are made to exactly."""


def geometry_of(mechanism: Mechanism, apart: float = TOUCHING) -> Geometry:
    """Return the joints of a mechanism and its reference pose.

    Profiles that are `apart` (rad) there touch where they are nearest.

    Raises
    ------
    ModelError
        If profiles are not curves, or do not touch in the reference pose.
    """
    given = mechanism.geometry
    first, second = pair_frames(mechanism)
    joints: list[Joint] = []
    reference: list[float] = []
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            joints.append(Revolute(first[pair.name], second[pair.name]))
            if isinstance(given, PoseGeometry):
                reference.append(given.values.get(pair.name, 0.0))
            continue
        curves = contact_curves(mechanism, pair)
        start = pair.start
        if isinstance(given, PoseGeometry):
            start = touching(mechanism, pair, curves, apart)
        if pair.type == "Cr":
            joints.append(Rolling(*curves, start))
            reference.append(0.0)
        else:
            joints.append(Sliding(*curves))
            reference += start
    in_pose = isinstance(given, PoseGeometry)
    return Geometry(tuple(joints), np.array(reference) if in_pose else None)


def contact_curves(mechanism: Mechanism, pair: Pair) -> tuple[Curve, Curve]:
    """Return the curves of both links of a contact, which run alike where they touch."""
    assert pair.profiles is not None
    made = []
    for link, profile in zip(pair.links, pair.profiles, strict=True):
        try:
            made.append(_curve(profile))
        except ValueError as problem:
            raise ModelError(
                f"{mechanism.name}: pairs.{pair.name}.profiles.{link}: {problem}"
            ) from None
    first, second = made
    return first, second.reversed() if pair.contact == "external" else second


@lru_cache(maxsize=64)
def _curve(profile: Profile) -> Curve:
    """Return a profile as a curve; planning, positions and kernels ask for the same."""
    if profile.kind == "points":
        return through(np.array(profile.points), profile.closed)
    centre = np.array(profile.centre)
    if profile.kind == "circle":
        return circle(centre, float(profile.radius or 0.0))
    if profile.kind == "great_circle":
        return great_circle(centre)
    return fourier(centre, np.array(profile.cosines), np.array(profile.sines))


def touching(
    mechanism: Mechanism, pair: Pair, curves: tuple[Curve, Curve], apart: float
) -> tuple[float, float]:
    """Return the arc lengths (rad) at which two profiles touch with links aligned."""
    s, miss = nearest_frames(*curves)
    if not miss < apart:
        raise ModelError(
            f"{mechanism.name}: pairs.{pair.name}: the profiles do not touch in the "
            f"reference pose: the nearest frames differ by {miss:.3g} rad; "
            'move a profile, or set contact = "internal" or "external"'
        )
    return float(s[0]), float(s[1])


def link_axes(mechanism: Mechanism) -> dict[str, dict[str, Floats]]:
    """Return the unit axis (3,) of every R pair in each of its links, by names."""
    axes: dict[str, dict[str, Floats]] = {link: {} for link in mechanism.links}
    first, second = pair_frames(mechanism)
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            axes[pair.links[0]][pair.name] = first[pair.name][:, 2]
            axes[pair.links[1]][pair.name] = second[pair.name][:, 2]
    return axes


def pair_frames(mechanism: Mechanism) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the frames (3, 3) of R pairs in their first and their second link, by name."""
    if isinstance(mechanism.geometry, PoseGeometry):
        return _pose_frames(mechanism.geometry)
    return frames_of_sizes(mechanism.pairs, mechanism.geometry)


def given_axis(
    geometry: SizeGeometry | PoseGeometry,
    joined: Mapping[str, tuple[str, str]],
    link: str,
    axis: str,
) -> Vector:
    """Return the unit axis of an R pair in the axes of one of its links.

    `joined` holds the two links of every R pair.

    Raises
    ------
    ModelError
        If there is no such pair, it is not on the link, or its axis is not given there.
    """
    if axis not in joined:
        raise ModelError(
            f'no R pair is named "{axis}"{nearest(axis, joined) or "."} R pairs: '
            f"{listing(joined)}"
        )
    if link not in joined[axis]:
        raise ModelError(f'R pair "{axis}" is not on link "{link}"')
    axes: Mapping[str, Vector | Floats]
    if isinstance(geometry, PoseGeometry):
        axes = geometry.axes
    else:
        sizes = geometry.links.get(link, LinkSizes(()))
        further = len(sizes.axes) - 1
        if len(sizes.arcs) < further or len(sizes.angles) < further - 1:
            raise ModelError(f'arcs or angles of link "{link}" are missing')
        axes = axes_from_sizes(sizes)
    if axis not in axes:
        raise ModelError(f'the axis of pair "{axis}" is not given in link "{link}"')
    x, y, z = axes[axis]
    return float(x), float(y), float(z)


def arc_pole(first: Vector, second: Vector) -> Vector:
    """Return the pole of the great-circle arc from one unit vector to another.

    Turning about it counter-clockwise moves the first towards the second.

    Raises
    ------
    ModelError
        If the two are equal or opposite, so that many great circles join them.
    """
    pole = cross(np.array(first), np.array(second))
    length = float(np.linalg.norm(pole))
    if length < COLLINEAR:
        which = "equal" if np.dot(first, second) > 0 else "opposite"
        raise ModelError(
            f"the two directions are {which}: they define no arc; give two directions "
            "that the arc passes through, neither equal nor opposite"
        )
    x, y, z = pole / length
    return float(x), float(y), float(z)


def _pose_frames(
    geometry: PoseGeometry,
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    first, second = {}, {}
    for name, given in geometry.axes.items():
        axis = np.array(given, dtype=float)
        first[name] = frame_from(axis, perpendicular(axis))
        second[name] = first[name] @ about_z(geometry.values.get(name, 0.0))
    return first, second


def frames_of_sizes(
    pairs: Sequence[Pair], geometry: SizeGeometry
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the frames (3, 3) of every R pair in its first and its second link, by name.

    The first is turned by the pair's zero.
    """
    axes = {
        link: axes_from_sizes(geometry.links.get(link, LinkSizes(())))
        for pair in pairs
        for link in pair.links
    }
    first, second = {}, {}
    for pair in pairs:
        if pair.kind.has_axis:
            zero = about_z(geometry.zeros.get(pair.name, 0.0))
            first[pair.name] = reference_frame(axes[pair.links[0]], pair.name) @ zero
            second[pair.name] = reference_frame(axes[pair.links[1]], pair.name)
    return first, second


def axes_from_sizes(sizes: LinkSizes) -> dict[str, Floats]:
    """Return the unit axes (3,) of a link in its own frame, in the order listed."""
    axes: dict[str, Floats] = {}
    for position, name in enumerate(sizes.axes):
        if position == 0:
            axes[name] = np.array([0.0, 0.0, 1.0])
            continue
        length = sizes.arcs[position - 1]
        turn = sizes.angles[position - 2] if position > 1 else 0.0
        across = np.sin(length)
        axes[name] = np.array(
            [-across * np.sin(turn), across * np.cos(turn), np.cos(length)]
        )
    return axes


def reference_frame(axes: Mapping[str, Floats], name: str) -> Floats:
    """Return the frame (3, 3) of an axis of a link, from all axes of the link.

    Its x axis leads to the first other axis that is not on the same line.
    """
    axis = axes[name]
    for other, direction in axes.items():
        if other == name:
            continue
        toward = cross(cross(axis, direction), axis)
        length = np.linalg.norm(toward)
        if length > COLLINEAR:
            return frame_from(axis, toward / length)
    return frame_from(axis, perpendicular(axis))


ROUNDING = 8 * EPS
"""Half angles that touch to this (rad) are kept to the last bit."""


def pitch_angles(
    teeth: tuple[int, int], shaft_angle: float, contact: Literal["external", "internal"]
) -> tuple[float, float]:
    """Return the half angles (rad) of the pitch cones of two bevel gears.

    Parameters
    ----------
    teeth
        Numbers of teeth; of an internal pair the ring comes second.
    shaft_angle
        Angle between the axes (rad), 0 to pi.
    contact
        External: the cones lie beside each other and their half angles add up to the
        shaft angle. Internal: the first rolls inside the second.

    Raises
    ------
    ModelError
        If no cones with these teeth touch at this shaft angle.

    Notes
    -----
    sin d1 / sin d2 = N1 / N2 with d1 + d2 or d2 - d1 equal to the shaft angle:
    tan d1 = sin S / (N2 / N1 + cos S), or tan d1 = sin S / (N2 / N1 - cos S).
    """
    sense = 1.0 if contact == "external" else -1.0
    ratio = teeth[1] / teeth[0]
    first = math.atan2(math.sin(shaft_angle), ratio + sense * math.cos(shaft_angle))
    second = shaft_angle - first if contact == "external" else shaft_angle + first
    if not (0.0 < first < math.pi and 0.0 < second < math.pi):
        raise ModelError(
            f"gears with {teeth[0]} and {teeth[1]} teeth have no pitch cones that touch in "
            f"{contact} contact at a shaft angle of {math.degrees(shaft_angle):.6g} deg"
        )
    return first, second


def touching_angles(
    half_angles: Sequence[float],
    shaft_angle: float,
    contact: Literal["external", "internal"],
) -> tuple[float, float]:
    """Return the half angles (rad) of two cones that touch along a line.

    Parameters
    ----------
    half_angles
        Those of both cones (rad), between 0 and pi, or of the first alone. Two that
        touch but for rounding are returned as they are; within `TOUCHING` the second is
        made to fit.
    shaft_angle
        Angle between the axes (rad), 0 to pi.
    contact
        External: d1 + d2 is the shaft angle. Internal: the first rolls inside the
        second, d2 - d1 is the shaft angle.

    Raises
    ------
    ModelError
        If the cones do not touch at this shaft angle, or touch all round.
    """
    for given in half_angles:
        if not 0.0 < given < math.pi:
            raise ModelError(
                f"found a half angle of {_degrees(given)} deg; it has to lie between 0 "
                "and 180 deg, both excluded"
            )
    if math.sin(shaft_angle) < COLLINEAR:
        raise ModelError(
            f"the shaft angle is {_degrees(shaft_angle)} deg: cones about one line do not "
            "touch along a single line"
        )
    first, external = half_angles[0], contact == "external"
    second = shaft_angle - first if external else shaft_angle + first
    if len(half_angles) == 1:
        if not 0.0 < second < math.pi:
            raise ModelError(
                f"at a shaft angle of {_degrees(shaft_angle)} deg no second cone touches "
                f"a first of {_degrees(first)} deg in {contact} contact: its half angle "
                f"would be {_degrees(second)} deg"
            )
        return first, second
    miss = abs(half_angles[1] - second)
    if miss > TOUCHING:
        parts = (first, half_angles[1]) if external else (half_angles[1], first)
        total = parts[0] + parts[1] if external else parts[0] - parts[1]
        raise ModelError(
            f"the cones do not touch: the shaft angle is {_degrees(shaft_angle)} deg, in "
            f"{contact} contact the half angles give {_degrees(parts[0])} "
            f"{'+' if external else '-'} {_degrees(parts[1])} = {_degrees(total)} deg; "
            f"they miss by {_degrees(miss)} deg. Leave the second out and it follows"
        )
    return first, half_angles[1] if miss <= ROUNDING else second


def gear_axes(
    geometry: SizeGeometry | PoseGeometry,
    joined: Mapping[str, tuple[str, str]],
    links: tuple[str, str],
    axes: tuple[str, str],
) -> tuple[tuple[Vector, Vector], float]:
    """Return the gears' axes in their links, and the shaft angle (rad) between them.

    `joined` holds the two links of every R pair, `links` the two gears, `axes` the R pairs
    they turn about.
    """
    first, second = (
        given_axis(geometry, joined, link, axis)
        for link, axis in zip(links, axes, strict=True)
    )
    carrier, carried = carrier_of(geometry, joined, links, axes)
    one, other = (
        sense * np.array(given_axis(geometry, joined, carrier, pair))
        for pair, sense in carried
    )
    return (first, second), float(arc(one, other))


def carrier_of(
    geometry: SizeGeometry | PoseGeometry,
    joined: Mapping[str, tuple[str, str]],
    links: tuple[str, str],
    axes: tuple[str, str],
) -> tuple[str, list[tuple[str, int]]]:
    """Return the link that carries the axes of two gears, and by which R pairs.

    These are the gears' own or coaxial ones: the sun of a planetary train turns about its
    shaft in the frame, and so does the arm that carries the planet. With each is its
    sense, -1 where it points the other way. The arguments are those of `gear_axes`.

    Raises
    ------
    ModelError
        If no link carries both, or the file lacks where their axes are in it.
    """
    one, other = (
        _carried(geometry, joined, link, axis)
        for link, axis in zip(links, axes, strict=True)
    )
    both = [link for link in one if link in other and link not in links]
    if not both:
        for link in sorted(set(joined[axes[0]]).intersection(joined[axes[1]])):
            for axis in axes:
                given_axis(geometry, joined, link, axis)  # says what of it is missing
        raise ModelError(
            f'R pairs "{axes[0]}" and "{axes[1]}" do not join the gears to a common link, '
            "nor does a pair coaxial with one of them; name the pairs whose axes one link "
            "carries, or give each gear its circle under profiles"
        )
    carrier = min(both, key=lambda link: one[link][0] + other[link][0])
    return carrier, [carried[carrier][1:] for carried in (one, other)]


def _carried(
    geometry: SizeGeometry | PoseGeometry,
    joined: Mapping[str, tuple[str, str]],
    link: str,
    axis: str,
) -> dict[str, tuple[int, str, int]]:
    """Return the links that carry an axis of a link.

    With how many pairs lead there, the R pair that has the axis in that link, and its
    sense.
    """
    carried = {link: (0, axis, 1)}
    order = [link]
    for here in order:  # which grows on the way
        steps, by, sense = carried[here]
        line = np.array(given_axis(geometry, joined, here, by))
        for pair, ends in joined.items():
            beyond = next((end for end in ends if end not in carried), None)
            if here not in ends or beyond is None:
                continue
            try:
                one = np.array(given_axis(geometry, joined, here, pair))
                given_axis(geometry, joined, beyond, pair)
            except ModelError:
                continue
            if np.linalg.norm(np.cross(one, line)) < SAME_AXIS:
                way = sense if one @ line > 0.0 else -sense
                carried[beyond] = steps + 1, pair, way
                order.append(beyond)
    return carried


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.9g}"


def start_of_phase(
    mechanism: Mechanism, pair: Pair, phase: Mapping[str, float]
) -> tuple[float, float]:
    """Return the arc lengths (rad) at which two wheels touch at values of their shafts.

    Parameters
    ----------
    pair
        A rolling contact of circles, whose two shafts join its links to their carrier.
    phase
        The value (rad) of each of the two R pairs, by its name. If one of them is driven,
        the lengths are those where it is at zero, from which turns are counted.

    Raises
    ------
    ModelError
        If these are not its shafts, or a reference pose says where wheels touch.
    """
    if isinstance(mechanism.geometry, PoseGeometry):
        raise ModelError(
            "the reference pose says how the wheels are put together; give the value of "
            "each shaft there instead"
        )
    wheels = [_Wheel.of(mechanism, pair, side, phase) for side in (0, 1)]
    one, other = wheels
    if one.carrier != other.carrier:
        raise ModelError(
            f"the pairs {one.shaft} and {other.shaft} lead to the links {one.carrier} and "
            f"{other.carrier}; they have to join the wheels to the one link that carries "
            "both; give start instead"
        )
    centre, beside = one.axis, other.axis
    across = beside - (centre @ beside) * centre
    size = float(np.linalg.norm(across))
    if size < COLLINEAR:
        raise ModelError("both wheels turn about one line, so they touch everywhere")
    sense = np.sign(np.sin(one.radius - other.radius))
    point = np.cos(one.radius) * centre + np.sin(one.radius) * sense * across / size
    angles = [phase[wheel.shaft] for wheel in wheels]
    driven = {item.pair for item in mechanism.inputs}
    paces = [wheel.pace(point, angle) for wheel, angle in zip(wheels, angles, strict=True)]
    for side, wheel in enumerate(wheels):
        if wheel.shaft in driven:
            rolled = -paces[side] * angles[side]
            angles[1 - side] += rolled / paces[1 - side]
            angles[side] = 0.0
            break
    first, second = (
        wheel.length(point, angle) for wheel, angle in zip(wheels, angles, strict=True)
    )
    return first, second


@final
@dataclass(frozen=True)
class _Wheel:
    """A wheel on its shaft: its circle, and the frames (3, 3) of carrier and wheel there.

    `forward` is 1 if the shaft turns it against the carrier, -1 if the other way round.
    """

    shaft: str
    carrier: str
    frames: tuple[Floats, Floats]
    forward: float
    curve: Curve

    @staticmethod
    def of(
        mechanism: Mechanism, contact: Pair, side: int, phase: Mapping[str, float]
    ) -> "_Wheel":
        link = contact.links[side]
        shafts = [mechanism.pair(name) for name in phase]
        turning = [x for x in shafts if x.kind.has_axis and link in x.links]
        if not turning:
            raise ModelError(
                f"none of {listing(phase)} is an R pair of link {link}; name the shafts of "
                "both wheels"
            )
        shaft = turning[0]
        if contact.profiles is None or contact.profiles[side].round_axis is None:
            raise ModelError(f"the profile of {link} is no circle about a shaft")
        first, second = (frames[shaft.name] for frames in pair_frames(mechanism))
        here = shaft.links[1] == link
        return _Wheel(
            shaft.name,
            shaft.links[0] if here else shaft.links[1],
            (first, second) if here else (second, first),
            1.0 if here else -1.0,
            contact_curves(mechanism, contact)[side],
        )

    @property
    def bend(self) -> float:
        """The geodesic curvature of its circle."""
        return float(self.curve.at(np.zeros(1)).curvature[0])

    @property
    def radius(self) -> float:
        """That of its circle (rad), about the centre on the side of the normal."""
        return float(np.arctan2(1.0, self.bend))

    @property
    def centre(self) -> Floats:
        """That centre (3,) in the wheel."""
        _, normal, point = self.curve.at(np.zeros(1)).frame[0].T
        return np.asarray((normal + self.bend * point) / np.hypot(1.0, self.bend))

    @property
    def axis(self) -> Floats:
        """The same centre in the carrier, where it stays."""
        return np.asarray(self.frames[0] @ self.frames[1].T @ self.centre)

    def length(self, point: Floats, angle: float) -> float:
        """Return the arc length (rad) at a point (3,) of the carrier, by its angle."""
        back = about_z(-self.forward * angle)
        on_wheel = self.frames[1] @ back @ self.frames[0].T @ point
        tangent = self.curve.at(np.zeros(1)).frame[0, :, 0]
        ahead = cross(tangent, self.centre)
        azimuth = np.arctan2(tangent @ on_wheel, ahead @ on_wheel)
        return float(np.sin(self.radius) * azimuth)

    def pace(self, point: Floats, angle: float) -> float:
        """Return how that length grows by the angle."""
        size = float(np.sin(self.radius))
        grown = self.length(point, angle + 0.1) - self.length(point, angle)
        return float(np.sign(np.sin(grown / size))) * size
