"""Functions of several variables as tensor Chebyshev series on cells of a box.

A cell is halved across the direction in which its series falls off worst, until its error
is small enough, it is as narrow as allowed, or there are enough cells. What is then not
resolved, or has places where the functions do not exist, is no part of the domain.

Functions of one variable at single places, in the least time that Python takes.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import acos, copysign

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Floats, Indices
from spherekit.numerics.chebyshev import (
    ROUNDING,
    PiecewiseChebyshev,
    sampled,
    summed,
    tensor,
)

DEGREE = 11
MOST_CELLS = 2048
NARROWEST = 1.0 / 32.0
"""Part of the box that a cell is wide at least, in each direction."""

CHECKS = 48
"""Places in a cell, other than those sampled, where its error is measured."""


@dataclass(frozen=True)
class TensorChebyshev:
    """F functions on cells of a box by `coefficients` (cells, degree + 1, ..., F).

    `low`, `high` (m,) bound the box. `splits` is the tree of halvings: (direction, place,
    next below, next above) of each inner one; a next of -1 - k is cell k, one of 0 the part
    that is not in the domain. `bounds` (cells, 2, m) are those of the cells.
    """

    low: Floats
    high: Floats
    splits: Floats
    bounds: Floats
    coefficients: Floats

    @staticmethod
    def fit(
        function: Callable[[Floats], Floats],
        low: Floats,
        high: Floats,
        tolerance: float,
        size: Floats,
        degree: int = DEGREE,
        most: int = MOST_CELLS,
    ) -> "TensorChebyshev":
        """Return the interpolant of a function (n, m) -> (n, F), NaN where it is none.

        Errors are relative to `size` (F,).
        """
        m, checks = len(low), _spread(CHECKS, len(low))
        splits: list[list[float]] = []
        kept: list[tuple[Floats, Floats]] = []
        open_: list[tuple[Floats, list[float], int]] = [(np.stack([low, high]), [0.0], 0)]
        while open_:
            bounds = np.array([cell for cell, *_ in open_])
            series, gap, samples = sampled(function, bounds, degree, checks)
            with np.errstate(invalid="ignore"):
                good = np.max(gap / size, axis=(1, 2)) <= tolerance
            later: list[tuple[Floats, list[float], int]] = []
            room = most - len(kept) - 2 * len(open_)
            for number, (cell, parent, place) in enumerate(open_):
                wide = (cell[1] - cell[0]) / (high - low)
                axis = _worst(series[number] / size, wide)
                if good[number]:
                    kept.append((cell, series[number]))
                    parent[place] = -len(kept)
                elif room > 0 and wide[axis] > 1.5 * NARROWEST and samples[number] >= 0.0:
                    parent[place] = len(splits)
                    split = [axis, float(np.mean(cell[:, axis])), 0.0, 0.0]
                    splits.append(split)
                    for side in (0, 1):
                        part = cell.copy()
                        part[1 - side, axis] = split[1]
                        later.append((part, split, 2 + side))
            open_ = later
        cells, parts = ([item[k] for item in kept] for k in (0, 1))
        return TensorChebyshev(
            low,
            high,
            np.array(splits).reshape(-1, 4),
            np.array(cells).reshape(-1, 2, m),
            np.array(parts).reshape(-1, *[degree + 1] * m, len(size)),
        )

    @property
    def covered(self) -> float:
        """The part of the box that is in the domain."""
        sizes = np.prod(self.bounds[:, 1] - self.bounds[:, 0], axis=1)
        return float(np.sum(sizes) / np.prod(self.high - self.low))

    def cell(self, x: Sequence[float]) -> int:
        """Return the cell of a place within the box, -1 outside the domain."""
        if not self._tree:
            return len(self.bounds) - 1
        node = 0
        while True:
            axis, middle, below, above = self._tree[node]
            node = above if x[axis] >= middle else below
            if node <= 0:
                return -1 - node

    def cells(self, x: Floats) -> Indices:
        """Return the cells (n,) of places (n, m), -1 outside the box or the domain."""
        inside = np.all((x >= self.low) & (x <= self.high), axis=1)
        every = zip(x, inside, strict=True)
        return np.array([self.cell(row) if good else -1 for row, good in every], np.intp)

    def at(self, x: Floats) -> Floats:
        """Return the functions (n, F) at places (n, m), NaN outside the domain."""
        return summed(x, self.cells(x), self.bounds, self.coefficients)

    @cached_property
    def _tree(self) -> list[tuple[int, float, int, int]]:
        return [(int(a), b, int(c), int(d)) for a, b, c, d in self.splits.tolist()]


class TensorCells:
    """Sums of the functions of a `TensorChebyshev` at one place, in little time."""

    def __init__(self, series: TensorChebyshev, factors: Floats) -> None:
        coefficients = series.coefficients @ factors
        self._count = coefficients.shape[1]
        self._orders = np.arange(self._count, dtype=float)
        self._coefficients = [*coefficients]
        middle = 0.5 * (series.bounds[:, 0] + series.bounds[:, 1])
        scale = 2.0 / (series.bounds[:, 1] - series.bounds[:, 0])
        self._affine = np.stack([middle, scale], axis=2).tolist()

    def at(self, number: int, x: Sequence[float]) -> Floats:
        """Return the sums (K,) at a place in the cell of this number."""
        sums = self._coefficients[number]
        orders = self._orders
        cos = np.cos
        for value, (middle, scale) in zip(x, self._affine[number], strict=True):
            place = (value - middle) * scale
            angle = acos(place if -1.0 <= place <= 1.0 else copysign(1.0, place))
            sums = cos(orders * angle).dot(sums.reshape(self._count, -1))
        return sums  # type: ignore[no-any-return]


def _spread(count: int, m: int) -> Floats:
    """Return places (count, m) in the cube from -1 to 1, evenly, and its corners."""
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (m + 1))
    steps = root ** -np.arange(1.0, m + 1)
    inner = 2.0 * ((0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0) - 1.0
    return np.concatenate([inner, tensor([np.array([-1.0, 1.0])] * m)])


def _worst(series: Floats, wide: Floats) -> int:
    """Return the direction in which a series falls off worst; of none, the widest."""
    if not np.all(np.isfinite(series)):
        return int(np.argmax(wide))
    tails = [
        np.max(np.abs(np.take(series, [-1, -2], axis=axis)))
        for axis in range(series.ndim - 1)
    ]
    return int(np.argmax(tails))


DEGREE = 7
TOLERANCE = 1e-14
FIRST_CELLS = 16


def local_polynomials(
    series: PiecewiseChebyshev, size: Floats
) -> Callable[[float], list[float]]:
    """Return the functions (m) of a series at one place, in the least time.

    To `TOLERANCE` of the size (m,) of each, as polynomials of degree `DEGREE` by the
    distance from the middle of cells of their own. Their coefficients are Python floats: a
    few functions at a single place take less time with them than the making of an array.
    """
    fine = PiecewiseChebyshev.fit(
        series.at,
        float(series.edges[0]),
        float(series.edges[-1]),
        TOLERANCE,
        size,
        FIRST_CELLS,
        DEGREE,
        rounding=ROUNDING,
    )
    half = 0.5 * np.diff(fine.edges)
    orders = np.arange(DEGREE + 1)
    powers = np.zeros((DEGREE + 1, DEGREE + 1))
    for order in orders:
        powers[order, : order + 1] = chebyshev.cheb2poly(np.eye(DEGREE + 1)[order])
    monomials = np.einsum("ckm,kj->cmj", fine.coefficients, powers)
    monomials /= half[:, None, None] ** orders
    inner = fine.edges[1:-1].tolist()
    centres = (fine.edges[:-1] + half).tolist()
    rows = [[(*coefficients,) for coefficients in cell] for cell in monomials.tolist()]

    def at(x: float) -> list[float]:
        cell = bisect_right(inner, x)
        t = x - centres[cell]
        return [
            ((((((h * t + g) * t + f) * t + e) * t + d) * t + c) * t + b) * t + a
            for a, b, c, d, e, f, g, h in rows[cell]
        ]

    return at
