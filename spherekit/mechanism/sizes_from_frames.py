"""Arcs, angles and zeros of links that result from given frames of R pairs."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.mechanism.changed_axes import EMPTY_MAPPING
from spherekit.mechanism.elements import LinkSizes, Pair, SizeGeometry
from spherekit.mechanism.pair_frames import pair_frames_from_sizes

Frames = Mapping[str, Floats]
"""Frames (3, 3) of R pairs in one of their links, by the name of the pair."""


def sizes_from_frames(
    pairs: Sequence[Pair],
    frames: tuple[Frames, Frames],
    known_sizes: Mapping[str, LinkSizes] = EMPTY_MAPPING,
) -> SizeGeometry:
    """Return the sizes with which R pairs have given frames in the axes of their links.

    Sizes are arcs from the first axis of a link to the others, and angles (azimuths) about
    the first axis, counter-clockwise from the second axis. The first axis of a link defines
    its z axis, and the second one is in the half-plane x = 0, y > 0. Each link gets two
    extra axes, z and y, in front of the axes of its pairs. The coordinate axes of the given
    frames then stay the same. The zero of a pair is the angle in its first link from which
    the variable of the pair counts.

    Parameters
    ----------
    pairs
        The pairs of the mechanism.
    frames
        Frames of R pairs in their first and in their second links. The z column is the axis
        of the pair, and the x column the direction of the variable's zero.
    known_sizes
        Sizes of the links that have their sizes already, which are not checked against the
        frames.
    """
    axes_by_link: dict[str, dict[str, Floats]] = {}
    for pair in pairs:
        for link, frames_of_end in zip(pair.links, frames, strict=True):
            axes = axes_by_link.setdefault(link, {})
            if pair.name in frames_of_end:
                axes[pair.name] = frames_of_end[pair.name][:, 2]
    pair_names = {pair.name for pair in pairs}
    links = {}
    for link, axes in axes_by_link.items():
        # The arc from z to y is a right angle, and angles are measured from it.
        link_axes = (_free_name(link, "z", pair_names), _free_name(link, "y", pair_names))
        arcs = [0.5 * np.pi]
        angles = []
        for axis in axes.values():
            x, y, z = axis  # its components in link axes
            arcs.append(float(np.arctan2(np.hypot(x, y), z)))
            # The azimuth about z, counter-clockwise from y: -x is a quarter turn from y.
            angles.append(float(np.arctan2(-x, y)))
        sizes = LinkSizes(
            axes=(*link_axes, *axes),
            arcs=tuple(arcs),
            angles=tuple(angles),
            unpaired=link_axes,
        )
        links[link] = known_sizes.get(link, sizes)

    # The frames from these sizes differ from the given ones by rotations about z, in both
    # links of a pair. The zero of the pair is an angle in the first link. A rotation in the
    # second link has the effect of the opposite one in the first, hence the difference.
    frames_without_zeros = pair_frames_from_sizes(pairs, SizeGeometry(links, {}))
    zeros = {}
    for name in frames[0]:
        first_angle, second_angle = (
            _rotation_angle_about_z(with_zeros[name].T @ without_zeros[name])
            for with_zeros, without_zeros in zip(frames, frames_without_zeros, strict=True)
        )
        zeros[name] = second_angle - first_angle
    return SizeGeometry(links, zeros)


def _free_name(link: str, letter: str, pair_names: Collection[str]) -> str:
    """Return a name for an extra axis of a link, such as ``crank_z``, that no pair has."""
    ending = f"_{letter}"
    while (name := link[: MAX_NAME_LENGTH - len(ending)] + ending) in pair_names:
        ending += letter
    return name


def _rotation_angle_about_z(rotation: Floats) -> float:
    """Return the angle (rad) of a rotation matrix (3, 3) about z."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
