"""Functions of one variable as Chebyshev series on cells as narrow as each place needs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise, product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from spherekit.arrays import Floats, Indices

DEGREE = 15
MOST_CELLS = 2**13
ROUNDING = 1e-10
"""What functions that lose digits may be off by: see `PiecewiseChebyshev.fit`."""

ON_THE_AXIS = 1e-6
"""A zero whose imaginary part, in half cells, is smaller is taken for real."""


@dataclass(frozen=True)
class PiecewiseChebyshev:
    """m functions on [edges[0], edges[-1]] by `coefficients` (cells, degree + 1, m).

    `edges` (cells + 1,) bound the cells in rising order. `error` is the largest difference
    from the functions measured between the sampled points, relative to the size of each.
    """

    edges: Floats
    coefficients: Floats
    error: float = np.nan

    @staticmethod
    def fit(
        function: Callable[[Floats], Floats],
        low: float,
        high: float,
        tolerance: float = 1e-13,
        size: Floats | None = None,
        cells: int | Floats = 1,
        degree: int = DEGREE,
        most: int = MOST_CELLS,
        rounding: float = 0.0,
    ) -> "PiecewiseChebyshev":
        """Return the interpolant of a function (n,) -> (n, m), of this degree.

        Starting from so many equal `cells`, or from those between given edges, each is
        halved until its error, measured at the extrema of the next Chebyshev polynomial,
        is below `tolerance` times `size` (m,) for every function, or is below `rounding`
        and does not fall when the cell is halved, or there are `most`: `error` says what
        was reached. Without sizes the largest value at the first places counts for all.
        """
        edges = np.linspace(low, high, cells + 1) if isinstance(cells, int) else cells
        bounds = np.stack([edges[:-1], edges[1:]], axis=1)
        checks = np.cos(np.arange(degree + 2)[:, None] * np.pi / (degree + 1))

        def rising(x: Floats) -> Floats:
            order = np.argsort(x[:, 0])
            return function(np.minimum(x[order, 0], high))[np.argsort(order)]

        before, largest = np.full(len(bounds), np.inf), 0.0
        done: dict[float, Floats] = {}
        while len(bounds):
            series, gap, largest_value = sampled(rising, bounds[..., None], degree, checks)
            if size is None:
                size = np.full(gap.shape[2], np.max(largest_value) or 1.0)
            error = np.max(gap / size, axis=(1, 2))
            good = (error <= tolerance) | ((error < rounding) & (error > 0.5 * before))
            good |= len(done) + 2 * len(bounds) > most
            done.update(zip(bounds[good, 0].tolist(), series[good], strict=True))
            largest = float(np.max(error[good], initial=largest))
            bounds, before = bounds[~good], np.repeat(error[~good], 2)
            middle = np.mean(bounds, axis=1, keepdims=True)
            bounds = np.insert(bounds, [1, 1], middle, axis=1).reshape(-1, 2)
        starts = sorted(done)
        series = np.stack([done[start] for start in starts])
        return PiecewiseChebyshev(np.array([*starts, high]), series, largest)

    def grid(self, parts: int) -> Floats:
        """Return so many places in each cell, spread evenly, and the last edge."""
        cells = len(self.coefficients)
        return np.interp(
            np.arange(parts * cells + 1) / parts, np.arange(cells + 1), self.edges
        )

    def at(self, x: ArrayLike) -> Floats:
        """Return the functions (n, m) at x (n,) between the first and the last edge."""
        x = np.asarray(x, dtype=float)
        bounds = sliding_window_view(self.edges, 2)
        return summed(x[:, None], self._cells(x), bounds[..., None], self.coefficients)

    def scattered(self, x: Floats) -> Floats:
        """Return few functions (m, n) at x (n,), each place for itself."""
        cell = self._cells(x)
        low, high = self.edges[cell], self.edges[cell + 1]
        place = np.clip((2.0 * x - (low + high)) / (high - low), -1.0, 1.0)
        series = self._by_order.take(cell, axis=2)
        return np.asarray(chebyshev.chebval(place, series, tensor=False))

    def _cells(self, x: Floats) -> Indices:
        return np.searchsorted(self.edges[1:-1], x, side="right")

    @cached_property
    def _by_order(self) -> Floats:
        """(degree + 1, m, cells) the coefficients of each order."""
        return np.ascontiguousarray(self.coefficients.transpose(1, 2, 0))

    @cached_property
    def derivative(self) -> "PiecewiseChebyshev":
        """The derivatives of the interpolant."""
        rates = 2.0 / np.diff(self.edges)
        return PiecewiseChebyshev(
            self.edges, chebyshev.chebder(self.coefficients, axis=1) * rates[:, None, None]
        )


def summed(x: Floats, owner: Indices, bounds: Floats, coefficients: Floats) -> Floats:
    """Return functions (n, F) at places x (n, m) in cells (n,), NaN in none, -1.

    By `bounds` (cells, 2, m) of the cells, `coefficients` (cells, degree + 1, ..., F).
    """
    order = np.argsort(owner, kind="stable")
    values = np.full((len(x), coefficients.shape[-1]), np.nan)
    owner = owner[order]
    low, high = bounds[owner].swapaxes(0, 1)
    places = (2.0 * x[order] - low - high) / (high - low)
    polynomials = polynomials_at(places, coefficients.shape[1] - 1)
    every = np.searchsorted(owner, np.arange(len(coefficients) + 1))
    for number, (start, stop) in enumerate(pairwise(every.tolist())):
        if start < stop:
            made = products(polynomials[start:stop])
            values[order[start:stop]] = made @ coefficients[number].reshape(
                made.shape[1], -1
            )
    return values


@cache
def nodes(degree: int) -> Floats:
    """Return the zeros (degree + 1,) of the next Chebyshev polynomial, rising."""
    return np.cos((np.arange(degree, -1, -1) + 0.5) * np.pi / (degree + 1))


def sampled(
    function: Callable[[Floats], Floats], bounds: Floats, degree: int, checks: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the series of a function (n, m) -> (n, F) on cells, and what they miss.

    `bounds` (cells, 2, m) are those of the cells, `checks` (k, m) places in the cube from
    -1 to 1. The series are (cells, degree + 1, ..., F), the differences (cells, k, F) from
    the function at the checks in size; the largest samples (cells,) come last, NaN where
    there is no finite one.
    """
    m = bounds.shape[2]
    grid = tensor([nodes(degree)] * m)
    places = np.concatenate([grid, checks])
    half = 0.5 * (bounds[:, 1] - bounds[:, 0])
    x = bounds[:, None, 0] + half[:, None] * (1.0 + places)
    samples = function(x.reshape(-1, m)).reshape(len(bounds), len(places), -1)
    series = samples[:, : len(grid)].reshape(len(bounds), *[degree + 1] * m, -1)
    for axis in range(1, m + 1):
        series = np.moveaxis(np.tensordot(series, fitting(degree), (axis, 1)), -1, axis)
    flat = series.reshape(len(bounds), len(grid), -1)
    gap = np.abs(products(polynomials_at(checks, degree)) @ flat - samples[:, len(grid) :])
    return series, gap, np.fmax.reduce(np.abs(samples), axis=(1, 2))


def tensor(axes: Sequence[Floats]) -> Floats:
    """Return the places (n, m) of a grid with given ones along each of m axes."""
    return np.array(list(product(*axes)))


def polynomials_at(x: Floats, degree: int) -> Floats:
    """Return Chebyshev polynomials (n, m, degree + 1) at x (n, m) from -1 to 1."""
    return np.asarray(chebyshev.chebvander(np.clip(x, -1.0, 1.0), degree))


def products(polynomials: Floats) -> Floats:
    """Return the products (n, (degree + 1)^m) of polynomials (n, m, degree + 1)."""
    made = polynomials[:, 0]
    for k in range(1, polynomials.shape[1]):
        made = (made[:, :, None] * polynomials[:, k, None]).reshape(len(made), -1)
    return made


@cache
def fitting(degree: int) -> Floats:
    """Return the matrix that makes series of values at the `nodes`."""
    made = polynomials_at(nodes(degree), degree).T * (2.0 / (degree + 1))
    made[0] *= 0.5
    return made


def trimmed(series: Floats, size: float) -> Floats:
    """Return a series without its last terms that are smaller than `size`."""
    (large,) = np.nonzero(np.abs(series) > size)
    return series[: np.max(large + 1, initial=2)]


def real_zeros(series: Floats, most: float = 1.0) -> Floats:
    """Return the real zeros of a series on [-most, most], as eigenvalues."""
    series = trimmed(series, 1e-15 * float(np.max(np.abs(series), initial=0.0)))
    if len(series) < 2 or abs(series[0]) > np.sum(np.abs(series[1:])):
        return np.zeros(0)
    roots = chebyshev.chebroots(series)
    real = roots.real[np.abs(roots.imag) < ON_THE_AXIS]
    return np.sort(real[np.abs(real) <= most])
