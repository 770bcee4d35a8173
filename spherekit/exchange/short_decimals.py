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


def shorten(value: float, scale: float, rounding: float = DECIMAL_ROUNDING) -> float:
    """Return the shortest decimal number that differs from a number by rounding only.

    For example 29.999999999999996 becomes 30.0.

    Parameters
    ----------
    value
        The number.
    scale
        A size that the number is compared with, such as the length of its vector. A number
        not larger than `rounding` times the scale becomes 0.0.
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


def shorten_angle(angle: float) -> float:
    """Return an angle (rad) as a short decimal in degrees."""
    return shorten(math.degrees(angle), 1.0, DEGREES_ROUNDING)


def shorten_axis(axis: Floats) -> list[float]:
    """Return the components of a unit vector (3,) as short decimals."""
    return [shorten(component, 1.0) for component in axis]


def shorten_vector(vector: Floats) -> list[float]:
    """Return the components of a vector as short decimals.

    Changes by rounding are small relative to the largest component.
    """
    return [shorten(component, max_abs(vector)) for component in vector]
