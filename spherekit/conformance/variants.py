"""The same mechanism said otherwise: turned as a whole, or links of other names, order."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.model.dynamics import Gravity, Moment, PointForce
from spherekit.model.geometry import axes_from_sizes, reference_frame
from spherekit.model.link_axes import turned_mass, turned_texts, turned_vector
from spherekit.model.load import Load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, Pair, PoseGeometry, Profile, SizeGeometry
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
    links = {mechanism.ground}
    if isinstance(given, PoseGeometry):
        links = set(mechanism.links)
        axes = {name: turned_vector(rotation, axis) for name, axis in given.axes.items()}
        geometry: PoseGeometry | SizeGeometry = replace(given, axes=axes)
    else:
        geometry = _turned_ground(mechanism, given, rotation)
    return replace(
        mechanism,
        geometry=geometry,
        pairs=tuple(_pair(pair, links, rotation) for pair in mechanism.pairs),
        masses=tuple(
            turned_mass(mass, rotation) if mass.link in links else mass
            for mass in mechanism.masses
        ),
        loads=tuple(_load(load, links, rotation) for load in mechanism.loads),
        outputs=tuple(
            replace(output, direction=turned_vector(rotation, output.direction))
            if output.link in links and output.direction is not None
            else output
            for output in mechanism.outputs
        ),
    )


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


def _pair(pair: Pair, links: set[str], rotation: Floats) -> Pair:
    if pair.profiles is None or not links & set(pair.links):
        return pair
    first, second = (
        _profile(profile, rotation) if link in links else profile
        for link, profile in zip(pair.links, pair.profiles, strict=True)
    )
    return replace(pair, profiles=(first, second))


def _profile(profile: Profile, rotation: Floats) -> Profile:
    if not profile.points:
        raise NotTurnedError(f"a {profile.kind} counts its arc length from the axes")
    points = tuple(turned_vector(rotation, point) for point in profile.points)
    return replace(profile, points=points)


def _load(load: Load, links: set[str], rotation: Floats) -> Load:
    match load:
        case Gravity(acceleration=vector):
            return replace(load, acceleration=turned_vector(rotation, vector))
        case PointForce(link=link, force=texts, point=point):
            if load.axes == "ground" or link in links:
                texts = turned_texts(rotation, texts)
            point = turned_vector(rotation, point) if link in links else point
            return replace(load, force=texts, point=point)
        case Moment(link=link, moment=texts):
            if load.axes == "ground" or link in links:
                return replace(load, moment=turned_texts(rotation, texts))
    return load


def renamed(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """Return a mechanism with other names of links; moving ones in the order of `names`."""
    given = mechanism.geometry
    if isinstance(given, SizeGeometry):
        links = {names[link]: sizes for link, sizes in given.links.items()}
        given = replace(given, links=links)
    contacts = [pair for pair in mechanism.pairs if pair.kind.freedoms > 1]
    variables = {
        f"s_{pair.name}_{link}": f"s_{pair.name}_{names[link]}"
        for pair in contacts
        for link in pair.links
    }

    def of(item: Any) -> Any:
        """Return a part with the names of its links, and of variables in expressions."""
        changes = {
            key: names[getattr(item, key)]
            for key in ("link", "relative_to")
            if hasattr(item, key)
        }
        for key in ("torque", "force", "moment"):
            value = getattr(item, key, None)
            if isinstance(value, str):
                changes[key] = _put(value, variables)
            elif isinstance(value, tuple):
                changes[key] = tuple(_put(text, variables) for text in value)  # type: ignore[assignment]
        return replace(item, **changes)

    return replace(
        mechanism,
        ground=names[mechanism.ground],
        links=tuple(names.values()),
        pairs=tuple(
            replace(pair, links=(names[pair.links[0]], names[pair.links[1]]))
            for pair in mechanism.pairs
        ),
        geometry=given,
        outputs=tuple(map(of, mechanism.outputs)),
        masses=tuple(map(of, mechanism.masses)),
        loads=tuple(map(of, mechanism.loads)),
    )


def _put(text: str, words: Mapping[str, str]) -> str:
    return re.sub(r"\w+", lambda match: words.get(match[0], match[0]), text)
