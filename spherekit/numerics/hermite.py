"""Hermite interpolation: values between two ends from derivatives at both."""

import numpy as np

from spherekit.arrays import Floats

Slope = tuple[Floats, Floats]
"""Values and first derivatives at an end, arrays of any one shape."""


def cubic(start: Slope, stop: Slope, h: Floats | float, x: Floats) -> Floats:
    """Return cubic Hermite values at parts x, 0 to 1, of cells of lengths h.

    All arrays broadcast.
    """
    (value, slope), (last, last_slope) = start, stop
    y = 1.0 - x
    blend = value + x * x * (3.0 - 2.0 * x) * (last - value)
    return blend + x * y * h * (y * slope - x * last_slope)


def hermite(
    start: tuple[Floats, Floats, Floats],
    stop: tuple[Floats, Floats, Floats],
    h: Floats,
    part: Floats,
) -> Floats:
    """Return quintic Hermite values (n, m) at parts (n,), 0 to 1, of cells.

    `h` (n,) are their lengths; `start` and `stop` are values, first and second derivatives
    (n, m) at both ends; where those are not known, NaN, the values are cubic.
    """
    x, h = part[:, None], h[:, None]
    y = 1.0 - x
    x3, y3 = x**3, y**3
    value, slope, bend = start
    last, last_slope, last_bend = stop
    quintic = (
        value
        + x3 * (10.0 - 15.0 * x + 6.0 * x * x) * (last - value)
        + x * y3 * ((1.0 + 3.0 * x) * h * slope + 0.5 * x * h * h * bend)
        + x3 * y * (0.5 * y * h * h * last_bend - (4.0 - 3.0 * x) * h * last_slope)
    )
    return np.where(
        np.isnan(quintic), cubic((value, slope), (last, last_slope), h, x), quintic
    )
