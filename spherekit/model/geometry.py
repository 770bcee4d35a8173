"""Where each pair's axis and zero direction sit in its two links."""

import numpy as np

from spherekit.errors import ModelError
from spherekit.model.mechanism import LinkSizes, Mechanism, PoseGeometry, SizeGeometry
from spherekit.sphere.rotation import Floats, about_z, cross, frame_from, perpendicular

COLLINEAR = 1e-9
"""Below this sine two axes of a link count as one line for the reference arc."""


def pair_frames(mechanism: Mechanism) -> tuple[Floats, Floats]:
    """Return the frame of every pair in its first and in its second link.

    Returns
    -------
    first, second
        (p, 3, 3): columns are the zero direction, axis x zero direction and the axis,
        in the axes of the pair's first and second link. The variable v of an R pair
        turns one into the other: R_second = R_first F_first Z(v) F_second^T, with Z a
        rotation about z and R_link from link axes to ground axes.

    Raises
    ------
    ModelError
        If the mechanism has contact pairs, whose frames move along their profiles.
    """
    contact = [pair.name for pair in mechanism.pairs if pair.type != "R"]
    if contact:
        raise ModelError(
            f"{mechanism.name}: positions of contact pairs ({', '.join(contact)}) are "
            "not solved by this version; the plan and its Table are available"
        )
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        return _pose_frames(mechanism, geometry)
    return _size_frames(mechanism, geometry)


def link_axes(mechanism: Mechanism) -> dict[str, dict[str, Floats]]:
    """Return the unit axis (3,) of every R pair in each of its links, by names."""
    first, second = pair_frames(mechanism)
    axes: dict[str, dict[str, Floats]] = {link: {} for link in mechanism.links}
    for number, pair in enumerate(mechanism.pairs):
        axes[pair.links[0]][pair.name] = first[number, :, 2]
        axes[pair.links[1]][pair.name] = second[number, :, 2]
    return axes


def _pose_frames(mechanism: Mechanism, geometry: PoseGeometry) -> tuple[Floats, Floats]:
    first, second = [], []
    for pair in mechanism.pairs:
        axis = np.array(geometry.axes[pair.name], dtype=float)
        frame = frame_from(axis, perpendicular(axis))
        first.append(frame)
        second.append(frame @ about_z(geometry.values.get(pair.name, 0.0)))
    return np.array(first), np.array(second)


def _size_frames(mechanism: Mechanism, geometry: SizeGeometry) -> tuple[Floats, Floats]:
    axes = {
        link: axes_from_sizes(geometry.links.get(link, LinkSizes(())))
        for link in mechanism.links
    }
    first, second = [], []
    for pair in mechanism.pairs:
        zero = geometry.zeros.get(pair.name, 0.0)
        first.append(_reference_frame(axes[pair.links[0]], pair.name) @ about_z(zero))
        second.append(_reference_frame(axes[pair.links[1]], pair.name))
    return np.array(first), np.array(second)


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


def _reference_frame(axes: dict[str, Floats], name: str) -> Floats:
    axis = axes[name]
    for other, direction in axes.items():
        if other == name:
            continue
        toward = cross(cross(axis, direction), axis)
        length = np.linalg.norm(toward)
        if length > COLLINEAR:
            return frame_from(axis, toward / length)
    return frame_from(axis, perpendicular(axis))
