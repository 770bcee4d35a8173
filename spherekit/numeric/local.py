"""Functions of one variable at single places, in the least time that Python takes."""

from bisect import bisect_right
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.numeric.chebyshev import ROUNDING, Floats, PiecewiseChebyshev

DEGREE = 7
TOLERANCE = 1e-14
FIRST_CELLS = 16


@final
@dataclass(frozen=True)
class LocalPolynomials:
    """m functions as polynomials of degree `DEGREE` on cells of their own.

    `inner` are the edges between cells in rising order, `centres` the middles of the
    cells, and `rows[cell]` has the coefficients of each function by powers of the
    distance from the middle, the constant first. All are Python floats: at a single
    place a few functions take less time with them than the making of an array.
    """

    inner: list[float]
    centres: list[float]
    rows: list[list[tuple[float, ...]]]

    @staticmethod
    def of(series: PiecewiseChebyshev, size: Floats) -> "LocalPolynomials":
        """Return the functions of a series, to `TOLERANCE` of the size (m,) of each."""
        low, high = float(series.edges[0]), float(series.edges[-1])
        fine = PiecewiseChebyshev.fit(
            series.at, low, high, TOLERANCE, size, FIRST_CELLS, DEGREE, rounding=ROUNDING
        )
        orders = np.arange(DEGREE + 1)
        powers = np.zeros((DEGREE + 1, DEGREE + 1))
        for order in orders:
            powers[order, : order + 1] = chebyshev.cheb2poly(np.eye(DEGREE + 1)[order])
        half = 0.5 * np.diff(fine.edges)
        monomials = np.einsum("ckm,kj->cmj", fine.coefficients, powers)
        monomials /= half[:, None, None] ** orders
        return LocalPolynomials(
            fine.edges[1:-1].tolist(),
            (fine.edges[:-1] + half).tolist(),
            [[tuple(coefficients) for coefficients in cell] for cell in monomials.tolist()],
        )

    def at(self, x: float) -> list[float]:
        """Return the functions (m) at one place."""
        cell = bisect_right(self.inner, x)
        t = x - self.centres[cell]
        return [
            ((((((h * t + g) * t + f) * t + e) * t + d) * t + c) * t + b) * t + a
            for a, b, c, d, e, f, g, h in self.rows[cell]
        ]
