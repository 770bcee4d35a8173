"""The same mechanism said otherwise: turned as a whole, or links of other names, order."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spherekit.model.geometry import axes_from_sizes, reference_frame
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, Pair, PoseGeometry, Profile, SizeGeometry
from spherekit.model.restated import restated, turned_vector
from spherekit.model.restated import turned as turned_profile
from spherekit.sphere.rotation import Floats

DATUM = ("datum_z", "datum_y")
"""Axes without pairs that say how the ground is turned."""


class NotTurnedError(Exception):
    """A mechanism cannot be said in other ground axes: its file gives no way to."""


def turned(mechanism: Mechanism, rotation: Floats) -> Mechanism:
    """Return a mechanism rotated as a whole, `rotation` (3, 3), its ground axes kept.

    Links given by their sizes keep their axes, those given in a pose turn with it.

    Raises
    ------
    NotTurnedError
        If the origin of a profile's arc length follows from the axes.
    """
    given = mechanism.geometry
    links: tuple[str, ...] = (mechanism.ground,)
    if isinstance(given, PoseGeometry):
        links = mechanism.links
        axes = {name: turned_vector(rotation, axis) for name, axis in given.axes.items()}
        geometry: PoseGeometry | SizeGeometry = replace(given, axes=axes)
    else:
        geometry = _turned_ground(mechanism, given, rotation)
    turns = dict.fromkeys(links, rotation)
    parts = restated(mechanism, turns=turns, ground=rotation, turned_profile=_profile)
    return replace(mechanism, geometry=geometry, **parts)


def _turned_ground(
    mechanism: Mechanism, given: SizeGeometry, rotation: Floats
) -> SizeGeometry:
    """Return sizes in which the ground's frame is that of two axes without pairs."""
    ground = mechanism.ground
    sizes = given.links.get(ground, LinkSizes(()))
    before = {name: rotation @ axis for name, axis in axes_from_sizes(sizes).items()}
    arcs = [float(np.arccos(np.clip(axis[2], -1.0, 1.0))) for axis in before.values()]
    angles = [float(np.arctan2(-axis[0], axis[1])) for axis in before.values()]
    made = LinkSizes(
        (*DATUM, *sizes.axes), (np.pi / 2, *arcs), tuple(angles), (*DATUM, *sizes.unpaired)
    )
    after = axes_from_sizes(made)
    zeros = dict(given.zeros)
    for pair in mechanism.pairs:
        if pair.kind.has_axis and ground in pair.links:
            frame = reference_frame(after, pair.name)
            turn = frame.T @ reference_frame(before, pair.name)
            angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
            sign = 1.0 if pair.links[0] == ground else -1.0
            zeros[pair.name] = zeros.get(pair.name, 0.0) + sign * angle
    return SizeGeometry({**given.links, ground: made}, zeros)


def _profile(profile: Profile, rotation: Floats, pair: Pair) -> Profile:
    if not profile.points:
        raise NotTurnedError(f"a {profile.kind} counts its arc length from the axes")
    return turned_profile(profile, rotation, pair)


def renamed(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """Return a mechanism with other names of links; moving ones in the order of `names`."""
    given = mechanism.geometry
    if isinstance(given, SizeGeometry):
        links = {names[link]: sizes for link, sizes in given.links.items()}
        given = replace(given, links=links)
    words = {
        f"s_{pair.name}_{link}": f"s_{pair.name}_{names[link]}"
        for pair in mechanism.pairs
        if pair.kind.freedoms > 1
        for link in pair.links
    }
    return replace(
        mechanism,
        ground=names[mechanism.ground],
        links=tuple(names.values()),
        geometry=given,
        **restated(mechanism, names=names, words=words),
    )
