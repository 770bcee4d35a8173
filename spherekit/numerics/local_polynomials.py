"""Fast evaluation of functions of one variable at single positions."""

from bisect import bisect_right
from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Floats
from spherekit.numerics.chebyshev import LOSSY_TOLERANCE, PiecewiseChebyshev

LOCAL_DEGREE = 7
"""Degree of the local polynomials. Horner's scheme is written out for this degree."""

LOCAL_TOLERANCE = 1e-14
"""Error of the local polynomials, relative to the scale of each function."""

FIRST_CELLS = 16
"""Number of equal cells with which the fit begins."""


def make_local_polynomials(
    series: PiecewiseChebyshev, scales: Floats
) -> Callable[[float], list[float]]:
    """Return a fast function that evaluates a series at one position.

    The series is fitted again, by polynomials of degree `LOCAL_DEGREE` (7) in the distance
    from the middle of narrow cells (intervals). Their coefficients are Python floats. At a
    single position, Horner's scheme with floats takes less time than creating a NumPy
    array.

    Parameters
    ----------
    series
        m functions of one variable.
    scales
        (m,) sizes of the functions. `LOCAL_TOLERANCE` is relative to them.

    Returns
    -------
    A function that maps a position in the range of the series to the m values.
    """
    # The fit halves cells until its error is below `LOCAL_TOLERANCE`. Rounding errors can
    # prevent this. If halving no longer helps, an error up to `rounding_tolerance` is
    # accepted.
    fine_series = PiecewiseChebyshev.fit(
        function=series.evaluate,
        low=float(series.edges[0]),
        high=float(series.edges[-1]),
        tolerance=LOCAL_TOLERANCE,
        scales=scales,
        first_cells=FIRST_CELLS,
        degree=LOCAL_DEGREE,
        rounding_tolerance=LOSSY_TOLERANCE,
    )
    half_widths = 0.5 * np.diff(fine_series.edges)
    middles = (fine_series.edges[:-1] + half_widths).tolist()
    inner_edges = fine_series.edges[1:-1].tolist()
    power_coefficients = _convert_to_powers(fine_series.coefficients, half_widths)
    # Python floats: for each cell and function the eight coefficients of its polynomial.
    polynomials_by_cell = [
        [tuple(polynomial) for polynomial in polynomials_of_cell]
        for polynomials_of_cell in power_coefficients.tolist()
    ]

    def evaluate(x: float) -> list[float]:
        """Return the values of all functions at x, by Horner's scheme in its cell."""
        cell = bisect_right(inner_edges, x)
        t = x - middles[cell]
        # The eight coefficients a, b, ..., h belong to `LOCAL_DEGREE` 7. A loop over them
        # would take longer.
        return [
            ((((((h * t + g) * t + f) * t + e) * t + d) * t + c) * t + b) * t + a
            for a, b, c, d, e, f, g, h in polynomials_by_cell[cell]
        ]

    return evaluate


def _convert_to_powers(coefficients: Floats, half_widths: Floats) -> Floats:
    """Convert Chebyshev series to powers of the distance from the middle of each cell.

    A cell is an interval of the variable. The caller evaluates the functions by Horner's
    scheme, which needs powers.

    Parameters
    ----------
    coefficients
        (cells, LOCAL_DEGREE + 1, m) coefficients of the Chebyshev polynomials T_k(t / h),
        with the distance t from the middle and half the width h of the cell.
    half_widths
        (cells,) half the width h of each cell.

    Returns
    -------
    (cells, m, LOCAL_DEGREE + 1) coefficients of the powers 0, 1, ... of t.
    """
    count = LOCAL_DEGREE + 1
    # Row k has the coefficients of 1, x, x^2, ... in T_k(x).
    powers_in_polynomial = np.zeros((count, count))
    for order in range(count):
        unit_series = np.eye(count)[order]
        powers_in_polynomial[order, : order + 1] = chebyshev.cheb2poly(unit_series)
    # The indices are: cell c, order k, function m, power j.
    powers_of_ratio = np.einsum("ckm,kj->cmj", coefficients, powers_in_polynomial)
    # From powers of t / h to powers of t.
    exponents = np.arange(count)
    powers_of_ratio /= half_widths[:, None, None] ** exponents
    return powers_of_ratio
