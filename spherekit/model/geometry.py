"""Where each pair's axis and zero direction sit in its two links."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np

from spherekit.conventions import EPS, listing, nearest
from spherekit.errors import ModelError
from spherekit.model.joints import Joint, Revolute, Rolling, Sliding
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, Pair, PoseGeometry, Profile, SizeGeometry
from spherekit.sphere.profile import Curve, circle, fourier, great_circle, through
from spherekit.sphere.rotation import Floats, about_z, cross, frame_from, perpendicular
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
    return frames_of_sizes(mechanism, mechanism.geometry)


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
    mechanism: Mechanism, geometry: SizeGeometry
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the frames (3, 3) of every R pair in its first and its second link, by name.

    The first is turned by the pair's zero.
    """
    axes = {
        link: axes_from_sizes(geometry.links.get(link, LinkSizes(())))
        for link in mechanism.links
    }
    first, second = {}, {}
    for pair in mechanism.pairs:
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
