"""Functions of one variable as Chebyshev series on cells as narrow as each place needs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.numeric.chebyshev import DEGREE, Basis, Floats

MOST_CELLS = 2**13
ROUNDING = 1e-10
"""A cell whose error is below this and does not fall when it is halved has reached
rounding."""


@final
@dataclass(frozen=True)
class AdaptiveChebyshev:
    """m functions on [edges[0], edges[-1]] by `coefficients` (cells, degree + 1, m).

    `edges` (cells + 1,) bound the cells in rising order.
    """

    edges: Floats
    coefficients: Floats

    @staticmethod
    def fit(
        function: Callable[[Floats], Floats],
        low: float,
        high: float,
        size: Floats,
        tolerance: float = 1e-13,
        cells: int = 1,
        degree: int = DEGREE,
    ) -> "AdaptiveChebyshev":
        """Return the interpolant of a function (n,) -> (n, m), of this degree.

        Starting from equal `cells`, each is halved until its error, measured at the
        extrema of the next Chebyshev polynomial, is below `tolerance` times `size` (m,)
        for every function, or is rounding, or there are `MOST_CELLS`.
        """
        count = degree + 1
        basis = Basis.of(degree)
        places = np.concatenate([basis.nodes, basis.between])
        starts = low + (high - low) * np.arange(cells) / cells
        ends = np.append(starts[1:], high)
        before = np.full(cells, np.inf)
        done: list[tuple[float, float, Floats]] = []
        while len(starts):
            half = 0.5 * (ends - starts)[:, None]
            x = np.minimum(starts[:, None] + half * (1.0 + places), ends[:, None])
            order = np.argsort(x.ravel())
            found = np.empty((x.size, len(size)))
            found[order] = function(x.ravel()[order])
            found = found.reshape(len(starts), -1, len(size))
            series = basis.series(found[:, :count])
            gap = basis.at_between(series) - found[:, count:]
            error = np.max(np.abs(gap) / size, axis=(1, 2))
            good = (error <= tolerance) | ((error < ROUNDING) & (error > 0.5 * before))
            if len(done) + 2 * len(starts) > MOST_CELLS:
                good[:] = True
            done += zip(starts[good], ends[good], series[good], strict=True)
            left, right, before = starts[~good], ends[~good], np.repeat(error[~good], 2)
            middle = 0.5 * (left + right)
            starts = np.stack([left, middle], axis=1).ravel()
            ends = np.stack([middle, right], axis=1).ravel()
        done.sort(key=lambda cell: cell[0])
        edges = np.array([cell[0] for cell in done] + [high])
        return AdaptiveChebyshev(edges, np.stack([cell[2] for cell in done]))

    def at(self, x: ArrayLike) -> Floats:
        """Return the functions (n, m) at x (n,) between the first and the last edge."""
        x = np.asarray(x, dtype=float)
        cell = np.searchsorted(self.edges, x, side="right") - 1
        cell = np.clip(cell, 0, len(self.coefficients) - 1)
        low, high = self.edges[cell], self.edges[cell + 1]
        place = np.clip((2.0 * x - low - high) / (high - low), -1.0, 1.0)
        return _sum(self.coefficients, cell, place)


def _sum(series: Floats, cell: NDArray[np.intp], x: Floats) -> Floats:
    """Return the series of each x's own cell, by Clenshaw's recurrence."""
    x = x[:, None]
    after = np.zeros((len(x), series.shape[2]))
    here = np.zeros_like(after)
    for order in range(series.shape[1] - 1, 0, -1):
        here, after = 2.0 * x * here - after + series[cell, order], here
    return np.asarray(x * here - after + series[cell, 0])
