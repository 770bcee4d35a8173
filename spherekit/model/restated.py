"""A mechanism said otherwise: links of other names, in other axes, expressions changed."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.model.dynamics import Mass
from spherekit.model.load import Load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Pair, Profile
from spherekit.sphere.rotation import Floats

Turns = Mapping[str, Floats]
"""Rotations (3, 3) from the old axes of links to the new ones, by link."""

_NONE: Mapping[str, Any] = MappingProxyType({})


def turned(profile: Profile, turn: Floats, pair: Pair) -> Profile:
    """Return a profile of a pair with its centre and points turned by a rotation (3, 3)."""
    del pair
    centre = None if profile.centre is None else turned_vector(turn, profile.centre)
    points = tuple(turned_vector(turn, point) for point in profile.points)
    return replace(profile, centre=centre, points=points)


def restated(
    made: Mechanism,
    *,
    names: Mapping[str, str] = _NONE,
    turns: Turns = _NONE,
    ground: Floats | None = None,
    words: Mapping[str, str] = _NONE,
    turned_profile: Callable[[Profile, Floats, Pair], Profile] = turned,
) -> dict[str, Any]:
    """Return pairs, outputs, masses and loads of a mechanism said otherwise.

    Parameters
    ----------
    made
        The mechanism; its geometry is left to the caller.
    names
        New names of links, of those that get one.
    turns
        Of links that get other axes.
    ground
        What turns vectors along the axes of the ground (3, 3), if these change.
    words
        What stands for names in expressions.
    turned_profile
        A profile of a pair in axes turned by a rotation.
    """
    turns = {
        link: turn for link, turn in turns.items() if not np.array_equal(turn, np.eye(3))
    }

    def pair(item: Pair) -> Pair:
        one, other = (names.get(link, link) for link in item.links)
        if item.profiles is None or not turns.keys() & set(item.links):
            return replace(item, links=(one, other))
        first, second = (
            turned_profile(profile, turns[link], item) if link in turns else profile
            for link, profile in zip(item.links, item.profiles, strict=True)
        )
        return replace(item, links=(one, other), profiles=(first, second))

    return {
        "pairs": tuple(map(pair, made.pairs)),
        "outputs": tuple(
            replace(
                item,
                link=names.get(item.link, item.link),
                relative_to=names.get(item.relative_to, item.relative_to),
                direction=turned_vector(turns[item.link], item.direction)
                if item.link in turns and item.direction is not None
                else item.direction,
            )
            for item in made.outputs
        ),
        "masses": tuple(
            _mass(mass, names.get(mass.link, mass.link), turns.get(mass.link))
            for mass in made.masses
        ),
        "loads": tuple(_load(load, names, turns, ground, words) for load in made.loads),
    }


def _load(
    item: Load,
    names: Mapping[str, str],
    turns: Turns,
    ground: Floats | None,
    words: Mapping[str, str],
) -> Load:
    """Return a load said otherwise; see `restated`."""

    def text(expression: str) -> str:
        return re.sub(r"\w+", lambda name: words.get(name[0], name[0]), expression)

    link = getattr(item, "link", None)
    turn = ground if link is None else turns.get(link)
    frame = turn if getattr(item, "axes", "ground") == "link" else ground
    changes: dict[str, Any] = {}
    for key, form in item.keys.items():
        value = getattr(item, key)
        if form == "link":
            changes[key] = names.get(value, value)
        elif form == "vector" and turn is not None:
            changes[key] = turned_vector(turn, value)
        elif form == "texts":
            texts = tuple(map(text, value))
            changes[key] = texts if frame is None else _turned_texts(frame, texts)
        elif form == "text" and isinstance(value, str):
            changes[key] = text(value)
    return replace(item, **changes)  # type: ignore[type-var]


def turned_vector(turn: Floats, vector: ArrayLike) -> tuple[float, float, float]:
    """Return a vector (3,) turned by a rotation (3, 3)."""
    x, y, z = (turn @ np.array(vector, dtype=float)).tolist()
    return x, y, z


def _mass(mass: Mass, link: str, turn: Floats | None) -> Mass:
    if turn is None:
        return replace(mass, link=link)
    tensor = turn @ np.array(mass.tensor, dtype=float) @ turn.T
    first, second, third = map(tuple, (0.5 * (tensor + tensor.T)).tolist())
    centre = None if mass.centre is None else turned_vector(turn, mass.centre)
    return Mass(link, (first, second, third), mass.mass, centre)


def _turned_texts(turn: Floats, texts: tuple[str, ...]) -> tuple[str, str, str]:
    """Return the expressions of a vector's components in turned axes."""
    x, y, z = (
        " + ".join(
            f"({part!r})*({text})" for part, text in zip(row, texts, strict=True) if part
        )
        or "0"
        for row in turn.tolist()
    )
    return x, y, z
