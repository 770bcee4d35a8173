"""A mechanism described differently: links renamed, in other axes, expressions changed."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.elements import Pair, Profile, as_vector
from spherekit.mechanism.load_kinds import as_tensor
from spherekit.mechanism.mechanism import Mechanism, holds
from spherekit.mechanism.sizes import Vector

Turns = Mapping[str, Floats]
"""Rotations (3, 3) from the old axes of links to the new ones, by link."""


Words = Mapping[str, str]
"""What stands for names."""


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
    names: Words = _NONE,
    turns: Turns = _NONE,
    ground: Floats | None = None,
    words: Words = _NONE,
    turned_profile: Callable[[Profile, Floats, Pair], Profile] = turned,
) -> dict[str, Any]:
    """Return pairs, outputs, masses and loads of a mechanism said otherwise.

    The geometry is left to the caller. `names` are new names of links, `turns` the
    rotations of those that get other axes, `ground` (3, 3) turns vectors along the axes of
    the ground, if these change, `words` stand for names in expressions, and
    `turned_profile` gives a profile of a pair in axes turned by a rotation.
    """
    turns = {
        link: turn for link, turn in turns.items() if not np.array_equal(turn, np.eye(3))
    }

    def said(item: Any) -> Any:
        link = getattr(item, "link", None)
        turn = ground if link is None else turns.get(link)
        frame = turn if getattr(item, "axes", "ground") == "link" else ground
        changes: dict[str, Any] = {}
        for key, form in holds(item).items():
            match form, getattr(item, key):
                case "link", value:
                    changes[key] = names.get(value, value)
                case "links", links:
                    changes[key] = tuple(names.get(link, link) for link in links)
                case "profiles", (_, _) as profiles:
                    changes[key] = tuple(
                        turned_profile(profile, turns[link], item)
                        if link in turns
                        else profile
                        for link, profile in zip(item.links, profiles, strict=True)
                    )
                case "vector", value if value is not None and turn is not None:
                    changes[key] = turned_vector(turn, value)
                case "tensor", rows if turn is not None:
                    tensor = turn @ np.array(rows, dtype=float) @ turn.T
                    changes[key] = as_tensor(0.5 * (tensor + tensor.T))
                case "texts", texts:
                    texts = tuple(map(text, texts))
                    changes[key] = texts if frame is None else _turned_texts(frame, texts)
                case "text", str() as value:
                    changes[key] = text(value)
        return replace(item, **changes)

    def text(expression: str) -> str:
        return re.sub(r"\w+", lambda name: words.get(name[0], name[0]), expression)

    return {
        name: tuple(map(said, getattr(made, name)))
        for name in ("pairs", "outputs", "masses", "loads")
    }


def turned_vector(turn: Floats, vector: ArrayLike) -> Vector:
    """Return a vector (3,) turned by a rotation (3, 3)."""
    return as_vector(turn @ np.array(vector, dtype=float))


def _turned_texts(turn: Floats, texts: Names) -> Names:
    """Return the expressions of a vector's components in turned axes."""
    sums = (
        [f"({part!r})*({text})" for part, text in zip(row, texts, strict=True) if part]
        for row in turn.tolist()
    )
    return tuple(" + ".join(parts) or "0" for parts in sums)
