"""Checks and conversions of numbers that users state: angles, directions and arrays."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.quantity import AngleUnit

Sizes = float | Sequence[float] | Mapping[str, float]
"""Arcs or angles of a link.

The value is a number if the link has only one arc or angle, a sequence of all of them, or a
mapping of some of them by the pair at whose axis they end.
"""

Vector = tuple[float, float, float]


def to_radians(angle: float, unit: AngleUnit | None) -> float:
    """Return an angle in rad. Without a unit it is in rad already."""
    return math.radians(angle) if unit == "deg" else float(angle)


def angles_in_radians(angles: ArrayLike, unit: AngleUnit) -> Floats:
    """Return angles, or rates of angles, in rad from an array in any unit of angles."""
    values = np.asarray(angles, dtype=float)
    return np.radians(values) if unit == "deg" else values


def as_float_rows(key: str, numbers: ArrayLike, shape: tuple[int, ...]) -> Any:
    """Return numbers of a required shape as a tuple of floats, or of tuples of floats.

    Vectors and tensors that users state are checked and stored in this form.

    Parameters
    ----------
    key
        Name of the numbers, with which the error message begins.
    numbers
        The numbers, as an array or as nested lists or tuples.
    shape
        The required shape, of one or two axes.

    Raises
    ------
    ModelError
        If the numbers have another shape.
    """
    array = np.asarray(numbers, dtype=float)
    if array.shape != shape:
        raise ModelError(f"{key}: has the shape {array.shape}, expected {shape}")
    rows = array.tolist()
    return tuple(map(tuple, rows)) if len(shape) > 1 else tuple(rows)


def unit_vector_along(key: str, direction: ArrayLike) -> Vector:
    """Return the unit vector along a direction (3,) of any length.

    Users may state the axis of a pair (joint) by such a direction.

    Parameters
    ----------
    key
        Words that say where the direction is stated. Error messages begin with them.
    direction
        (3,) a vector along the direction.

    Raises
    ------
    ModelError
        If the direction has not three numbers, is zero or is not finite.
    """
    x, y, z = as_float_rows(f"{key}.xyz", direction, (3,))
    length = math.hypot(x, y, z)
    if not (math.isfinite(length) and length > 0.0):
        raise ModelError(
            f"{key}.xyz: found [{x:g}, {y:g}, {z:g}], which has no direction; give three "
            "finite numbers, not all 0"
        )
    return x / length, y / length, z / length


def check_finite(key: str, numbers: Iterable[float]) -> None:
    """Raise `ModelError`, which names the key, unless all values are finite numbers."""
    for number in numbers:
        if not isinstance(number, int | float | np.number) or not math.isfinite(number):
            raise ModelError(f"{key}: found {number}, expected a finite number")
