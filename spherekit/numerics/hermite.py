"""Hermite interpolation: values between two ends from values and derivatives at both."""

import numpy as np

from spherekit.arrays import Floats

EndValues = tuple[Floats, Floats]
"""Values and first derivatives at an end, arrays of the same shape."""

EndValuesWithCurvature = tuple[Floats, Floats, Floats]
"""Values, first and second derivatives at an end, arrays of the same shape."""


def cubic_hermite(
    start: EndValues, stop: EndValues, length: Floats | float, fraction: Floats
) -> Floats:
    """Return the values of cubic Hermite polynomials inside cells.

    A cell is an interval of the variable. The polynomial of a cell has the given values and
    derivatives at both ends.

    Parameters
    ----------
    start, stop
        Values and derivatives at the two ends.
    length
        Lengths of the cells, in the unit of the variable.
    fraction
        Positions in the cells, from 0 at the start to 1 at the other end.

    Returns
    -------
    Values of the functions. Their shape is that to which all arrays broadcast.
    """
    start_value, start_slope = start
    stop_value, stop_slope = stop
    x = fraction
    y = 1.0 - x
    blend = start_value + x * x * (3.0 - 2.0 * x) * (stop_value - start_value)
    return blend + x * y * length * (y * start_slope - x * stop_slope)


def quintic_hermite(
    start: EndValuesWithCurvature,
    stop: EndValuesWithCurvature,
    length: Floats,
    fraction: Floats,
) -> Floats:
    """Return the values of quintic Hermite polynomials inside cells.

    A cell is an interval of the variable. The polynomial of a cell has the given values,
    first and second derivatives at both ends. If a second derivative is unknown (NaN), the
    cubic polynomial is taken, which needs only values and first derivatives.

    Parameters
    ----------
    start, stop
        (n, m) values, first and second derivatives of m functions at the ends of n cells.
    length
        (n,) lengths of the cells, in the unit of the variable.
    fraction
        (n,) position in each cell, from 0 at the start to 1 at the other end.

    Returns
    -------
    (n, m) values.
    """
    x = fraction[:, None]
    h = length[:, None]
    y = 1.0 - x
    x3 = x**3
    y3 = y**3
    start_value, start_slope, start_bend = start
    stop_value, stop_slope, stop_bend = stop
    quintic = (
        start_value
        + x3 * (10.0 - 15.0 * x + 6.0 * x * x) * (stop_value - start_value)
        + x * y3 * ((1.0 + 3.0 * x) * h * start_slope + 0.5 * x * h * h * start_bend)
        + x3 * y * (0.5 * y * h * h * stop_bend - (4.0 - 3.0 * x) * h * stop_slope)
    )
    cubic = cubic_hermite((start_value, start_slope), (stop_value, stop_slope), h, x)
    return np.where(np.isnan(quintic), cubic, quintic)
