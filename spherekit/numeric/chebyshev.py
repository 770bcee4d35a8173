"""Functions of one variable between two ends, as Chebyshev series on equal cells."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

DEGREE = 15
MOST_CELLS = 2**13


@final
@dataclass(frozen=True)
class Basis:
    """Chebyshev series of one degree on [-1, 1], from values at as many `nodes`.

    `nodes` (degree + 1,) fall; `between` (degree + 2,) are the extrema of the next
    polynomial, which lie midway between them and at both ends.
    """

    nodes: Floats
    between: Floats
    fitting: Floats
    checking: Floats

    @staticmethod
    def of(degree: int) -> "Basis":
        """Return the series of a degree."""
        count = degree + 1
        angles = (np.arange(count) + 0.5) * np.pi / count
        between = np.arange(count + 1) * np.pi / count
        orders = np.arange(count)
        fitting = np.cos(np.outer(orders, angles)) * (2.0 / count)
        fitting[0] *= 0.5
        checking = np.cos(np.outer(between, orders))
        return Basis(np.cos(angles), np.cos(between), fitting, checking)

    def series(self, values: Floats) -> Floats:
        """Return the coefficients (cells, degree + 1, m) of values at the nodes."""
        return np.asarray(np.einsum("kj,cjm->ckm", self.fitting, values))

    def at_between(self, series: Floats) -> Floats:
        """Return the values (cells, degree + 2, m) of series at `between`."""
        return np.asarray(np.einsum("jk,ckm->cjm", self.checking, series))


@final
@dataclass(frozen=True)
class PiecewiseChebyshev:
    """m functions on [low, high] by `coefficients` (cells, degree + 1, m).

    `error` is the largest difference from the function measured between the sampled
    points, relative to the largest value.
    """

    low: float
    high: float
    coefficients: Floats
    error: float

    @staticmethod
    def fit(
        function: Callable[[Floats], Floats],
        low: float,
        high: float,
        tolerance: float = 1e-13,
        most: int = MOST_CELLS,
    ) -> "PiecewiseChebyshev":
        """Return the interpolant of a function (n,) -> (n, m).

        Cells are halved until the error measured at the extrema of the next Chebyshev
        polynomial, which lie midway between the sampled points, is below `tolerance`, or
        until there are `most` cells: `error` says what was reached.
        """
        basis = Basis.of(DEGREE)
        cells = 1
        while True:
            starts = low + (high - low) * np.arange(cells) / cells
            half = 0.5 * (high - low) / cells

            def sample(x: Floats, starts: Floats = starts, half: float = half) -> Floats:
                s = np.minimum(starts[:, None] + half * (1.0 + x), high)
                return function(s.ravel()).reshape(*s.shape, -1)

            known, checked = sample(basis.nodes), sample(basis.between)
            series = basis.series(known)
            gap = np.max(np.abs(basis.at_between(series) - checked))
            error = float(gap / (np.max(np.abs(checked)) or 1.0))
            if error <= tolerance or 2 * cells > most:
                return PiecewiseChebyshev(low, high, series, error)
            cells *= 2

    def at(self, s: ArrayLike) -> Floats:
        """Return the functions (n, m) at s (n,) within [low, high]."""
        cell, x = self._within(np.asarray(s, dtype=float))
        return self._sum(self.coefficients, cell, x)

    def derivative(self, s: ArrayLike) -> Floats:
        """Return the derivatives (n, m) of the interpolant at s (n,)."""
        cell, x = self._within(np.asarray(s, dtype=float))
        return self._sum(self._slopes, cell, x)

    @cached_property
    def _rate(self) -> float:
        return len(self.coefficients) / (self.high - self.low)

    @cached_property
    def _slopes(self) -> Floats:
        return np.asarray(
            chebyshev.chebder(self.coefficients, axis=1) * (2.0 * self._rate), dtype=float
        )

    def _within(self, s: Floats) -> tuple[NDArray[np.intp], Floats]:
        place = (s - self.low) * self._rate
        cell = np.clip(place.astype(np.intp), 0, len(self.coefficients) - 1)
        return cell, np.clip(2.0 * (place - cell) - 1.0, -1.0, 1.0)

    @staticmethod
    def _sum(series: Floats, cell: NDArray[np.intp], x: Floats) -> Floats:
        """Return the series of each x's own cell, by Clenshaw's recurrence."""
        x = x[:, None]
        after = np.zeros((len(x), series.shape[2]))
        here = np.zeros_like(after)
        for order in range(series.shape[1] - 1, 0, -1):
            here, after = 2.0 * x * here - after + series[cell, order], here
        return np.asarray(x * here - after + series[cell, 0])
