"""Bevel gears as rolling cones: pitch cones from numbers of teeth and the shaft angle.

Where each pair's axis and zero direction sit in its two links, and which arcs and angles
the axes of a reference pose say.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import lru_cache
from typing import Generic, Literal, NamedTuple, TypeVar

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.curve_contact import nearest_frames
from spherekit.geometry.profile_curve import Curve, circle, fourier, great_circle, through
from spherekit.geometry.rotation import cross
from spherekit.geometry.tilt_torsion import about_z
from spherekit.geometry.triangle import arc, frame_from, perpendicular
from spherekit.mechanism.elements import (
    Angles,
    LinkSizes,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    vector_of,
)
from spherekit.mechanism.joint import Ends, Joint, Links, Revolute, Rolling, Sliding
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import Vector
from spherekit.tolerances import EPS
from spherekit.wording import choices, listing

Frames = dict[str, Floats]
"""Frames (3, 3) of R pairs in one of their links, or axes (3,), by name."""

SAME_AXIS = 16 * EPS
"""Sine below which two axes of a link are one: rounding of their arcs and angles."""
ONE_LINE = 1e-9
"""Axes (rad) that differ by less are one; circles that miss by less touch."""
COLLINEAR = 1e-9
"""Below this sine two directions count as one line: they fix no arc."""


TOUCHING = 1e-6
"""Profiles must meet in the reference pose to this (rad); then they are made to exactly."""


def joints_of(mechanism: Mechanism, apart: float = TOUCHING) -> tuple[Joint, ...]:
    """Return the joints of a mechanism, see `joints_in_pose`."""
    return joints_in_pose(mechanism, apart)[0]


def joints_in_pose(
    mechanism: Mechanism, apart: float = TOUCHING
) -> tuple[tuple[Joint, ...], Floats | None]:
    """Return the joints of pairs, and their variables in the given pose if there is one.

    Profiles that are `apart` (rad) there touch where they are nearest.

    Raises
    ------
    ModelError
        If profiles are not curves, or do not touch in the reference pose.
    """
    given = mechanism.geometry
    posed = isinstance(given, PoseGeometry)
    values = given.values if isinstance(given, PoseGeometry) else {}
    first, second = pair_frames(mechanism)
    joints: list[Joint] = []
    reference: list[float] = []
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            joints.append(Revolute(first[pair.name], second[pair.name]))
            reference.append(values.get(pair.name, 0.0))
            continue
        curves = contact_curves(mechanism, pair)
        start = touching(mechanism, pair, curves, apart) if posed else pair.start
        if pair.type == "Cr":
            joints.append(Rolling(*curves, start))
            reference.append(0.0)
        else:
            joints.append(Sliding(*curves))
            reference += start
    return tuple(joints), np.array(reference) if posed else None


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
) -> Ends:
    """Return the arc lengths (rad) at which two profiles touch with links aligned."""
    s, miss = nearest_frames(*curves)
    if not miss < apart:
        raise ModelError(
            f"{mechanism.name}: pairs.{pair.name}: the profiles do not touch in the "
            f"reference pose: the nearest frames differ by {miss:.3g} rad; "
            'move a profile, or set contact = "internal" or "external"'
        )
    return float(s[0]), float(s[1])


def link_axes(mechanism: Mechanism) -> "LinkAxes":
    """Return the unit axis (3,) of every R pair in each of its links, by names."""
    axes: dict[str, Frames] = {link: {} for link in mechanism.links}
    both = pair_frames(mechanism)
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            for link, frames in zip(pair.links, both, strict=True):
                axes[link][pair.name] = frames[pair.name][:, 2]
    return axes


def pair_frames(mechanism: Mechanism) -> tuple[Frames, Frames]:
    """Return the frames (3, 3) of R pairs in their first and their second link, by name."""
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        return frames_of_sizes(mechanism.pairs, geometry)
    first, second = {}, {}
    for name, given in geometry.axes.items():
        axis = np.array(given, dtype=float)
        first[name] = frame_from(axis, perpendicular(axis))
        second[name] = first[name] @ about_z(geometry.values.get(name, 0.0))
    return first, second


LinkAxes = Mapping[str, Mapping[str, Floats]]
"""The unit axis (3,) of every R pair in each of its links, by names; see `link_axes`."""


def given_axis(axes: LinkAxes, link: str, pair: str) -> Vector:
    """Return the unit axis of an R pair in the axes of one of its links.

    Raises
    ------
    ModelError
        If there is no such pair on the link.
    """
    if pair not in axes[link]:
        raise ModelError(
            f'link "{link}" has no R pair "{pair}"'
            f"{choices(pair, axes[link], 'R pairs on it')}"
        )
    return vector_of(axes[link][pair])


def arc_pole(first: Vector, second: Vector) -> Vector:
    """Return the pole of the great-circle arc from one unit vector to another.

    Turning about it counter-clockwise moves the first towards the second.

    Raises
    ------
    ModelError
        If the two are equal or opposite, so that many great circles join them.
    """
    pole = cross(np.array(first), np.array(second))
    length = np.linalg.norm(pole)
    if length < COLLINEAR:
        raise ModelError(
            "the two directions are equal or opposite: they define no arc; give two that "
            "the arc passes through"
        )
    return vector_of(pole / length)


def frames_of_sizes(pairs: Sequence[Pair], geometry: SizeGeometry) -> tuple[Frames, Frames]:
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
            near, far = (reference_frame(axes[link], pair.name) for link in pair.links)
            first[pair.name] = near @ about_z(geometry.zeros.get(pair.name, 0.0))
            second[pair.name] = far
    return first, second


def axes_from_sizes(sizes: LinkSizes) -> Frames:
    """Return the unit axes (3,) of a link in its own frame, in the order listed."""
    axes: Frames = {name: np.array([0.0, 0.0, 1.0]) for name in sizes.axes[:1]}
    for name, length, turn in zip(
        sizes.axes[1:], sizes.arcs, (0.0, *sizes.angles), strict=False
    ):
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
    for direction in axes.values():
        toward = cross(cross(axis, direction), axis)
        length = np.linalg.norm(toward)
        if length > COLLINEAR:
            return frame_from(axis, toward / length)
    return frame_from(axis, perpendicular(axis))


PoseSize = tuple[Literal["arcs", "angles"], str, float, Floats]
"""An arc from the first R pair's axis of a link to another one's, or an angle there.

The kind: arcs start at the first axis; angles count at it, counter-clockwise, from the arc
to the second axis. The pair to which it leads. What it is in the pose (rad). What turns the
axis of the pair when the size grows, (3,) in ground axes.
"""


def pose_sizes(mechanism: Mechanism, link: str) -> tuple[PoseSize, ...]:
    """Return the sizes of a link in a reference pose, its axes in the order of the pairs.

    An axis on the line of the first one has none: no arc parts them.
    """
    assert isinstance(mechanism.geometry, PoseGeometry)
    (_, start), *others = (
        (pair.name, np.array(mechanism.geometry.axes[pair.name], dtype=float))
        for pair in mechanism.pairs
        if pair.kind.has_axis and link in pair.links
    )
    made: list[PoseSize] = []
    toward: Floats | None = None
    for name, axis in others:
        normal = cross(start, axis)
        sine = float(np.linalg.norm(normal))
        if sine < COLLINEAR:
            continue
        normal = normal / sine
        made.append(("arcs", name, float(np.arctan2(sine, start @ axis)), normal))
        if toward is None:
            toward = normal
        else:
            angle = float(np.arctan2(cross(toward, normal) @ start, toward @ normal))
            made.append(("angles", name, angle, start))
    return tuple(made)


ROUNDING = 8 * EPS
"""Half angles that touch to this (rad) are kept to the last bit."""


def pitch_angles(
    teeth: tuple[int, int], shaft_angle: float, contact: Literal["external", "internal"]
) -> Ends:
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
    second = shaft_angle - sense * first
    if not 0.0 < min(first, second) <= max(first, second) < math.pi:
        raise ModelError(
            f"gears with {teeth[0]} and {teeth[1]} teeth have no pitch cones that touch in "
            f"{contact} contact at a shaft angle of {math.degrees(shaft_angle):.6g} deg"
        )
    return first, second


def touching_angles(
    half_angles: Sequence[float],
    shaft_angle: float,
    contact: Literal["external", "internal"],
) -> Ends:
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
    first, *others = half_angles
    sense = 1.0 if contact == "external" else -1.0
    second = shaft_angle - sense * first
    if not others and not 0.0 < second < math.pi:
        raise ModelError(
            f"at a shaft angle of {_degrees(shaft_angle)} deg no second cone touches a "
            f"first of {_degrees(first)} deg in {contact} contact: its half angle would be "
            f"{_degrees(second)} deg"
        )
    miss = abs(others[0] - second) if others else 0.0
    if miss > TOUCHING:
        raise ModelError(
            f"the cones do not touch: the shaft angle is {_degrees(shaft_angle)} deg, in "
            f"{contact} contact half angles of {_degrees(first)} and {_degrees(others[0])} "
            f"deg give {_degrees(others[0] + sense * first)} deg; they miss by "
            f"{_degrees(miss)} deg. Leave the second out and it follows"
        )
    return first, others[0] if others and miss <= ROUNDING else second


def carrier_of(
    joined: Mapping[str, Links],
    axes: LinkAxes,
    links: Links,
    pairs: Links,
) -> tuple[str, list[tuple[str, int]], float]:
    """Return the link that carries the axes of two gears, by which R pairs, at what angle.

    `joined` and `axes` are the links and the axes of every R pair, `links` the two gears,
    `pairs` the R pairs they turn about. Those that lead to the carrier are the gears' own
    or coaxial ones: the sun of a planetary train turns about its shaft in the frame, and so
    does the arm that carries the planet. With each is its sense, -1 where it points the
    other way. Between the axes is the shaft angle (rad).

    Raises
    ------
    ModelError
        If no link carries both.
    """
    every = {
        pair: (axes[near][pair], axes[far][pair]) for pair, (near, far) in joined.items()
    }
    one, other = (
        seen_from_links(joined, every, link, np.array(given_axis(axes, link, pair)))
        for link, pair in zip(links, pairs, strict=True)
    )
    both = [link for link in one if link in other and link not in links]
    if not both:
        raise ModelError(
            f'R pairs "{pairs[0]}" and "{pairs[1]}" do not join the gears to a common '
            "link, nor does a pair coaxial with one of them; name the pairs whose axes one "
            "link carries, or give each gear its circle under profiles"
        )
    carrier = min(both, key=lambda link: len(one[link].way + other[link].way))
    carried = []
    for seen in (one[carrier], other[carrier]):
        pair, side = seen.way[-1]
        carried.append((pair, int(seen.turned[pair] * (2 * side - 1))))
    return carrier, carried, float(arc(one[carrier].line, other[carrier].line))


Name = TypeVar("Name", bound=Hashable)
Link = TypeVar("Link", bound=Hashable)


class Seen(NamedTuple, Generic[Name]):
    """A line of a wheel (3,) seen from another link that turns about it.

    `way` are the pairs that lead there, each with the side of the link that is nearer to
    the wheel; their angles add up to that of the wheel, with the signs of `turned`.
    """

    line: Floats
    turned: Mapping[Name, float]
    way: tuple[tuple[Name, int], ...]


def seen_from_links(
    ends: Mapping[Name, tuple[Link, Link]],
    axes: Mapping[Name, tuple[Floats, Floats]],
    wheel: Link,
    line: Floats,
) -> dict[Link, Seen[Name]]:
    """Return the links relative to which a wheel turns about a line of it (3,) only.

    `ends` are the links of pairs, `axes` those of R pairs in both their links.
    """
    reached: dict[Link, Seen[Name]] = {wheel: Seen(line, {}, ())}
    waiting = [wheel]
    for link in waiting:  # which grows on the way
        here = reached[link]
        for pair, two in axes.items():
            if link not in ends[pair]:
                continue
            side = ends[pair].index(link)
            further = ends[pair][1 - side]
            if further in reached or not one_line(two[side], here.line):
                continue
            sense = float(np.sign(two[side] @ here.line))
            # the angle moves the second link of a pair
            turned = {**here.turned, pair: sense if side else -sense}
            reached[further] = Seen(
                sense * two[1 - side], turned, (*here.way, (pair, side))
            )
            waiting.append(further)
    return reached


def one_line(one: Floats, other: Floats) -> bool:
    """Return whether two axes (3,) are one."""
    return bool(np.linalg.norm(cross(one, other)) < ONE_LINE)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.9g}"


def start_of_phase(mechanism: Mechanism, pair: Pair, phase: Angles) -> Ends:
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
    shafts, carriers, placed = zip(
        *(_shaft(mechanism, pair, link, phase) for link in pair.links), strict=True
    )
    if carriers[0] != carriers[1]:
        raise ModelError(
            f"the pairs {' and '.join(shafts)} lead to the links {' and '.join(carriers)}; "
            "they have to join the wheels to the one link that carries both; give start "
            "instead"
        )
    wheels = [Wheel.of(curve) for curve in contact_curves(mechanism, pair)]

    def lengths(angles: Sequence[float]) -> list[float]:
        turns = [turned(angle) for turned, angle in zip(placed, angles, strict=True)]
        return lengths_at(wheels, turns)

    angles = [phase[shaft] for shaft in shafts]
    for side in [k for k, x in enumerate(shafts) if x in mechanism.input_pairs][:1]:
        sizes = np.sin([wheel.radius for wheel in wheels])
        grown = np.subtract(lengths([angle + 0.1 for angle in angles]), lengths(angles))
        paces = np.sign(np.sin(grown / sizes)) * sizes
        angles[1 - side] -= float(paces[side] / paces[1 - side]) * angles[side]
        angles[side] = 0.0
    first, second = lengths(angles)
    return first, second


def _shaft(
    mechanism: Mechanism, contact: Pair, link: str, phase: Angles
) -> tuple[str, str, Callable[[float], Floats]]:
    """Return the shaft of a wheel, its carrier, and what turns the wheel's axes into its.

    That is a rotation (3, 3) for each angle of the shaft.
    """
    given = [mechanism.pair(name) for name in phase]
    shaft = next((x for x in given if x.kind.has_axis and link in x.links), None)
    if shaft is None:
        raise ModelError(
            f"none of {listing(phase)} is an R pair of link {link}; name the shafts of "
            "both wheels"
        )
    side = contact.links.index(link)
    if contact.profiles is None or contact.profiles[side].round_axis is None:
        raise ModelError(f"the profile of {link} is no circle about a shaft")
    near, far = (frames[shaft.name] for frames in pair_frames(mechanism))
    if shaft.links[1] == link:
        return shaft.name, shaft.links[0], lambda angle: near @ about_z(angle) @ far.T
    return shaft.name, shaft.links[1], lambda angle: far @ about_z(-angle) @ near.T


def lengths_at(wheels: Sequence["Wheel"], turns: Sequence[Floats]) -> list[float]:
    """Return the lengths (2,) rad along two wheels where they touch.

    `turns` (3, 3) lead from their axes to those of their carrier.

    Raises
    ------
    ModelError
        If they touch everywhere.
    """
    radius, beyond = (wheel.radius for wheel in wheels)
    centre, beside = (x @ wheel.centre for wheel, x in zip(wheels, turns, strict=True))
    across = beside - (centre @ beside) * centre
    size = np.linalg.norm(across)
    if size < COLLINEAR:
        raise ModelError("both wheels turn about one line, so they touch everywhere")
    sense = np.sign(np.sin(radius - beyond))
    point = np.cos(radius) * centre + np.sin(radius) * sense * across / size
    return [wheel.length(x.T @ point) for wheel, x in zip(wheels, turns, strict=True)]


class Wheel(NamedTuple):
    """A circle in its link: its centre on the side of the contact's normal, and radius.

    Azimuths about the centre are counted from `ahead`; the length along it is the sine of
    the radius times the azimuth, less `start`.
    """

    centre: Floats
    ahead: Floats
    radius: float
    start: float

    @staticmethod
    def of(curve: Curve, start: float = 0.0) -> "Wheel":
        """Return the wheel whose circle is a curve."""
        at = curve.at(np.zeros(1))
        _, normal, point = at.frame[0].T
        bend = float(at.curvature[0])
        size = np.hypot(1.0, bend)
        return Wheel(
            (normal + bend * point) / size,
            (point - bend * normal) / size,
            float(np.arctan2(1.0, bend)),
            start,
        )

    def length(self, direction: Floats) -> float:
        """Return the length (rad) where the contact lies in a direction (3,)."""
        side = cross(self.centre, self.ahead)
        azimuth = np.arctan2(side @ direction, self.ahead @ direction)
        return float(np.sin(self.radius) * azimuth - self.start)
