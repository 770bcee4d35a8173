"""A mechanism of a reference pose, given by arcs and angles within its links instead."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from spherekit.errors import ModelError
from spherekit.model.geometry import frames_of_sizes, pair_frames
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.sphere.rotation import Floats

Frames = tuple[Mapping[str, Floats], Mapping[str, Floats]]
"""Frames (3, 3) of R pairs in their first and in their second link, by name."""


def given_by_sizes(made: Mechanism, where: str) -> Mechanism:
    """Return a mechanism of a reference pose by sizes, with its variables and link axes.

    The z and y axes of each link stand first in its list, so that its frame stays. The pose
    is one of the configurations and no longer named. `where` begins messages.

    Raises
    ------
    ModelError
        If a contact rolls: how far it has is said by the pose.
    """
    rolling = [pair.name for pair in made.pairs if pair.rolls]
    if rolling:
        raise ModelError(
            f"{where}: without that pose it is not known how far {rolling[0]} has rolled; "
            "lock the pair there, or give the mechanism by arcs and angles"
        )
    assert isinstance(made.geometry, PoseGeometry)
    frames = pair_frames(made)
    axes: dict[str, dict[str, Floats]] = {link: {} for link in made.links}
    for name, frame in frames[0].items():
        for link in made.pair(name).links:
            axes[link][name] = frame[:, 2]
    links = {link: _sizes(link, carried) for link, carried in axes.items()}
    zeros = zeros_from(made, links, frames, frames[0])
    return replace(made, geometry=SizeGeometry(links, zeros))


def zeros_from(
    made: Mechanism,
    links: Mapping[str, LinkSizes],
    wanted: Frames,
    names: Iterable[str],
) -> dict[str, float]:
    """Return the zeros (rad) of pairs with which their frames in sizes are those wanted.

    Only the sum over both links of a pair counts: the frames may be turned alike.
    """
    have = frames_of_sizes(made, SizeGeometry(links, {}))
    zeros = {}
    for name in names:
        ahead, back = (
            want[name].T @ frames[name] for want, frames in zip(wanted, have, strict=True)
        )
        zeros[name] = _about(back) - _about(ahead)
    return zeros


def _sizes(link: str, axes: Mapping[str, Floats]) -> LinkSizes:
    """Return a link by the axes (3,) that it carries."""
    unpaired = (f"{link}_z", f"{link}_y")
    arcs, angles = [0.5 * np.pi], []
    for x, y, z in axes.values():
        arcs.append(float(np.arctan2(np.hypot(x, y), z)))
        angles.append(float(np.arctan2(-x, y)))
    return LinkSizes((*unpaired, *axes), tuple(arcs), tuple(angles), unpaired)


def _about(turn: Floats) -> float:
    """Return the angle of a rotation about z."""
    return float(np.arctan2(turn[1, 0], turn[0, 0]))
