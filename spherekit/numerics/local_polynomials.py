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
    """Return a function that evaluates a series at one position in the least time.

    The series is fitted again by polynomials of degree `LOCAL_DEGREE` (7) in the distance
    from the middle of narrow cells. Their coefficients are Python floats. For a few
    functions at a single position, Horner's scheme with floats takes less time than
    creating a NumPy array.

    Parameters
    ----------
    series
        m functions of one variable.
    scales
        (m,) scales of the functions, to which `LOCAL_TOLERANCE` is relative.

    Returns
    -------
    A function that maps a position in the range of the series to the m values.
    """
    # Functions that lose digits cannot be fitted to `LOCAL_TOLERANCE`. An error below
    # `rounding_tolerance` that a halving does not reduce is rounding, and is accepted.
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
    orders = np.arange(LOCAL_DEGREE + 1)
    # Row k has the coefficients of 1, x, x^2, ... in T_k(x).
    powers_of_order = np.zeros((LOCAL_DEGREE + 1, LOCAL_DEGREE + 1))
    for order in orders:
        unit_series = np.eye(LOCAL_DEGREE + 1)[order]
        powers_of_order[order, : order + 1] = chebyshev.cheb2poly(unit_series)
    # The indices are: cell c, order k, function m, power j.
    powers = np.einsum("ckm,kj->cmj", fine_series.coefficients, powers_of_order)
    # The argument of T_k is t / half width, with the distance t from the middle.
    powers /= half_widths[:, None, None] ** orders
    inner_edges = fine_series.edges[1:-1].tolist()
    middles = (fine_series.edges[:-1] + half_widths).tolist()
    rows_by_cell = [[(*row,) for row in cell] for cell in powers.tolist()]

    def evaluate(x: float) -> list[float]:
        """Return the values of all functions at x, by Horner's scheme in its cell."""
        cell = bisect_right(inner_edges, x)
        t = x - middles[cell]
        # The eight coefficients a, b, ..., h of a polynomial of degree 7. A loop over them
        # would take longer.
        return [
            ((((((h * t + g) * t + f) * t + e) * t + d) * t + c) * t + b) * t + a
            for a, b, c, d, e, f, g, h in rows_by_cell[cell]
        ]

    return evaluate
