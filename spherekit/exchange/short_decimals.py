"""Short decimals for numbers of an imported model, which carry rounding errors.

A number such as 29.999999999999996 deg is written as 30.0.
"""

import math

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs

DECIMAL_ROUNDING = 4e-15
"""Largest change of a number, relative to the largest number beside it.

Larger: digits of the model are lost; smaller: rounding errors are written as digits.
"""

DEGREES_ROUNDING = 1e-14
"""The same for angles in degrees: relative, or absolute (deg) for angles below 1 degree."""


def round_to_short_decimal(
    value: float, scale: float, rounding: float = DECIMAL_ROUNDING
) -> float:
    """Return the shortest decimal that equals a number up to rounding errors.

    For example 29.999999999999996 becomes 30.0. Such numbers come from computed poses.

    Parameters
    ----------
    value
        The number.
    scale
        Size of the quantity to which the number belongs, such as the length of its vector.
        A number not larger than `rounding` times the scale becomes 0.0.
    rounding
        Largest change, relative to the larger one of scale and number.
    """
    value = float(value)
    max_change = rounding * max(abs(scale), abs(value))
    for digits in range(1, 18):
        decimal = float(f"{value:.{digits}g}")
        if abs(decimal - value) <= max_change:
            return 0.0 if abs(value) <= max_change else decimal
    return value


def round_to_short_degrees(angle: float) -> float:
    """Return an angle (rad) in degrees, without digits that are only rounding errors."""
    return round_to_short_decimal(math.degrees(angle), 1.0, DEGREES_ROUNDING)


def round_relative_to_one(vector: Floats) -> list[float]:
    """Return the components of a vector, without digits that are only rounding errors.

    Rounding errors are assumed to be as large as those of numbers near 1, even for small
    components. The vector is a unit vector, or a point of a model (m).
    """
    return [round_to_short_decimal(component, 1.0) for component in vector]


def round_components(vector: Floats) -> list[float]:
    """Return the components of a vector, without digits that are only rounding errors.

    The largest component sets the size of the rounding errors of all components.
    """
    return [round_to_short_decimal(component, max_abs(vector)) for component in vector]
