"""A mechanism with other axes of its links: what is given in them is turned."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.errors import ModelError
from spherekit.model.dynamics import Mass
from spherekit.model.load import Load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Pair, Profile
from spherekit.sphere.rotation import Floats

Turns = Mapping[str, Floats]
"""Rotations (3, 3) from the old axes of links to the new ones, by link."""


def with_link_axes(made: Mechanism, turns: Turns, where: str) -> Mechanism:
    """Return a mechanism whose masses, outputs, loads and profiles are in other axes.

    `where` begins messages. The geometry of R pairs is left to the caller.

    Raises
    ------
    ModelError
        If a profile would lose the place from which lengths along it are measured.
    """
    return replace(
        made,
        pairs=tuple(_pair(pair, turns, where) for pair in made.pairs),
        outputs=tuple(
            replace(output, direction=turned_vector(turns[output.link], output.direction))
            if output.link in turns and output.direction is not None
            else output
            for output in made.outputs
        ),
        masses=tuple(
            turned_mass(mass, turns[mass.link]) if mass.link in turns else mass
            for mass in made.masses
        ),
        loads=tuple(_load(load, turns) for load in made.loads),
    )


def turned_vector(turn: Floats, vector: ArrayLike) -> tuple[float, float, float]:
    """Return a vector (3,) turned by a rotation (3, 3)."""
    x, y, z = (turn @ np.array(vector, dtype=float)).tolist()
    return x, y, z


def _pair(pair: Pair, turns: Turns, where: str) -> Pair:
    moved = [
        link in turns and not np.array_equal(turns[link], np.eye(3)) for link in pair.links
    ]
    if pair.profiles is None or not any(moved):
        return pair
    if pair.type == "Cr":
        raise ModelError(
            f"{where}: {pair.name} rolls on a link whose axes change with it: where its "
            "profile begins would be lost; lock another pair, or another value"
        )
    first, second = (
        _profile(profile, turns[link], pair, where) if changes else profile
        for link, profile, changes in zip(pair.links, pair.profiles, moved, strict=True)
    )
    return replace(pair, profiles=(first, second))


def _profile(profile: Profile, turn: Floats, pair: Pair, where: str) -> Profile:
    if profile.kind == "fourier":
        raise ModelError(
            f"{where}: the Fourier profile of contact {pair.name} is on a link whose axes "
            "change with it; give it by points, or lock another pair"
        )
    centre = None if profile.centre is None else turned_vector(turn, profile.centre)
    points = tuple(turned_vector(turn, point) for point in profile.points)
    return replace(profile, centre=centre, points=points)


def turned_mass(mass: Mass, turn: Floats) -> Mass:
    """Return a mass whose link has other axes, by the rotation (3, 3) to them."""
    tensor = turn @ np.array(mass.tensor, dtype=float) @ turn.T
    rows = tuple(map(tuple, (0.5 * (tensor + tensor.T)).tolist()))
    centre = None if mass.centre is None else turned_vector(turn, mass.centre)
    return replace(mass, tensor=rows, centre=centre)  # type: ignore[arg-type]


def _load(load: Load, turns: Turns) -> Load:
    turn = turns.get(getattr(load, "link", ""))
    if turn is None:
        return load
    changes: dict[str, Any] = {}
    if hasattr(load, "point"):
        changes["point"] = turned_vector(turn, load.point)
    if getattr(load, "axes", "ground") == "link" and not np.array_equal(turn, np.eye(3)):
        for key, form in load.keys.items():
            if form == "texts":
                changes[key] = turned_texts(turn, getattr(load, key))
    return replace(load, **changes) if changes else load  # type: ignore[type-var]


def turned_texts(turn: Floats, texts: tuple[str, ...]) -> tuple[str, str, str]:
    """Return the expressions of a vector's components in turned axes."""
    x, y, z = (
        " + ".join(
            f"({part!r})*({text})" for part, text in zip(row, texts, strict=True) if part
        )
        or "0"
        for row in turn.tolist()
    )
    return x, y, z
