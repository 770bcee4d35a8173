"""Numbers given to change a mechanism, as the model holds them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError

Sizes = float | Sequence[float] | Mapping[str, float]
"""Sizes of a link: its only one, all of them, or some by the pair that they lead to."""

AngleUnit = Literal["deg", "rad"]
"""Units that angles are stated in outside; inside they are rad."""


def in_radians(angle: float, unit: AngleUnit | None) -> float:
    """Return an angle in rad, given in a unit."""
    return math.radians(angle) if unit == "deg" else float(angle)


def all_in_radians(sizes: Sizes, unit: AngleUnit) -> Sizes:
    """Return sizes in rad, given in a unit; a single one as a sequence."""
    if isinstance(sizes, Mapping):
        return {name: in_radians(size, unit) for name, size in sizes.items()}
    return tuple(in_radians(size, unit) for size in np.ravel(np.asarray(sizes)).tolist())


def changed(
    key: str, pairs: Sequence[str], old: tuple[float, ...], given: Sizes
) -> tuple[float, ...]:
    """Return sizes of a link with those given in place of old ones."""
    if not isinstance(given, Mapping):
        return tuple(given) if isinstance(given, Sequence) else (given,)
    unknown = [name for name in given if name not in pairs]
    if unknown:
        raise ModelError(
            f'{key}: none leads to "{unknown[0]}"{nearest(unknown[0], pairs) or ";"} they '
            f"lead to: {listing(pairs)}"
        )
    return tuple(given.get(name, size) for name, size in zip(pairs, old, strict=True))


def rows_of(key: str, given: ArrayLike, shape: tuple[int, ...]) -> Any:
    """Return numbers of a shape as tuples of floats."""
    numbers = np.asarray(given, dtype=float)
    if numbers.shape != shape:
        raise ModelError(f"{key}: has the shape {numbers.shape}, needs {shape}")
    rows = numbers.tolist()
    return tuple(map(tuple, rows)) if len(shape) > 1 else tuple(rows)


def along(key: str, given: ArrayLike) -> tuple[float, float, float]:
    """Return the unit vector along a direction (3,)."""
    x, y, z = rows_of(f"{key}.xyz", given, (3,))
    length = math.hypot(x, y, z)
    if not (math.isfinite(length) and length > 0.0):
        raise ModelError(f"{key}.xyz: found [{x:g}, {y:g}, {z:g}], which has no direction")
    return x / length, y / length, z / length


def need_finite(key: str, numbers: Iterable[float]) -> None:
    """Refuse what is no number, or not finite."""
    for number in numbers:
        if not isinstance(number, int | float | np.number) or not math.isfinite(number):
            raise ModelError(f"{key}: found {number}, needs a finite number")


def need_increasing(key: str, times: tuple[float, ...]) -> None:
    """Refuse times that do not increase; `ModelError` names the first that does not."""
    for number, (one, other) in enumerate(pairwise(times)):
        if not other > one:
            raise ModelError(
                f"{key}: must increase, but {other:g} s follows {one:g} s at positions "
                f"{number} and {number + 1}"
            )
