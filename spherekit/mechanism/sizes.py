"""Numbers that change the sizes of a mechanism, checked and in radians."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from spherekit.errors import ModelError

Sizes = float | Sequence[float] | Mapping[str, float]
"""Sizes of a link: its only one, all of them, or some by the pair that they lead to."""


Vector = tuple[float, float, float]


AngleUnit = Literal["deg", "rad"]
"""Units that angles are stated in outside; inside they are rad."""


def in_radians(angle: float, unit: AngleUnit | None) -> float:
    """Return an angle in rad, given in a unit."""
    return math.radians(angle) if unit == "deg" else float(angle)


def rows_of(key: str, given: ArrayLike, shape: tuple[int, ...]) -> Any:
    """Return numbers of a shape as tuples of floats."""
    numbers = np.asarray(given, dtype=float)
    if numbers.shape != shape:
        raise ModelError(f"{key}: has the shape {numbers.shape}, needs {shape}")
    rows = numbers.tolist()
    return tuple(map(tuple, rows)) if len(shape) > 1 else tuple(rows)


def along(key: str, given: ArrayLike) -> Vector:
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
