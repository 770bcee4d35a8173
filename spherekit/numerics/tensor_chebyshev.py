"""Functions of several variables as tensor Chebyshev series on cells of a box.

A cell is halved across the direction in which its series converges worst. This ends when
its error is small enough, when the cell is as narrow as allowed, or when there are enough
cells. A cell whose error is still too large, or where the functions do not exist, is not
part of the domain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import acos, copysign

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.chebyshev import evaluate_cells, fit_cells, grid_points

TENSOR_SERIES_DEGREE = 11
"""Default degree in each variable. Larger: fewer cells, each with more coefficients."""

MAX_TENSOR_CELLS = 2048
"""Default limit of the cells. Smaller: the domain covers less of the box."""

MIN_CELL_FRACTION = 1.0 / 32.0
"""Smallest width of a cell in each direction, as a fraction of the box.

Smaller: the domain reaches closer to places where the functions do not exist or are not
smooth, with many more cells.
"""

CHECK_COUNT = 48
"""Number of positions in a cell, besides its corners, at which its error is measured."""


@dataclass(frozen=True)
class TensorChebyshev:
    """F functions of m variables, given by tensor Chebyshev series on cells of a box.

    The cells are the leaves of a binary tree of halvings. The domain is the union of the
    cells; it may be smaller than the box.

    Attributes
    ----------
    low, high
        (m,) lower and upper corner of the box.
    splits
        (splits, 4) inner nodes of the tree, the root first: axis of the split, its
        position, and the links to the lower and the upper half. A positive link is the row
        of another split. A link of -1 - k is cell k. A link of 0 leads outside the domain.
    bounds
        (cells, 2, m) lower and upper corner of each cell.
    coefficients
        (cells, degree + 1, ..., F) coefficients, with one axis of orders per variable.
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
        scales: Floats,
        degree: int = TENSOR_SERIES_DEGREE,
        max_cells: int = MAX_TENSOR_CELLS,
    ) -> "TensorChebyshev":
        """Return the interpolant of F functions on a box.

        A cell whose error is too large is halved. If this is not possible, because the cell
        is narrow, there are too many cells, or no sample is finite, it is left out of the
        domain.

        Parameters
        ----------
        function
            Maps positions (n, m) to values (n, F), NaN where a function has no value.
        low, high
            (m,) lower and upper corner of the box.
        tolerance
            Largest error in a cell, relative to the scale of each function.
        scales
            (F,) scales of the functions.
        degree
            Degree in each variable.
        max_cells
            Limit of the number of cells.
        """
        variables = len(low)
        check_positions = _spread_positions(CHECK_COUNT, variables)
        splits: list[list[float]] = []
        cell_bounds: list[Floats] = []
        cell_series: list[Floats] = []
        # The whole box has no parent. Its link is written to a list that is not used.
        unused_link = [0.0]
        pending = [_PendingCell(np.stack([low, high]), unused_link, 0)]
        while pending:
            bounds = np.array([cell.bounds for cell in pending])
            fits = fit_cells(function, bounds, degree, check_positions)
            with np.errstate(invalid="ignore"):
                errors = np.max(fits.deviations / scales, axis=(1, 2))
                is_accurate = errors <= tolerance
            # Number of cells that would still be allowed if all pending cells were halved.
            room = max_cells - len(cell_bounds) - 2 * len(pending)
            halves: list[_PendingCell] = []
            for number, cell in enumerate(pending):
                series = fits.coefficients[number]
                width_fractions = (cell.bounds[1] - cell.bounds[0]) / (high - low)
                axis = _worst_direction(series / scales, width_fractions)
                # An accurate cell k has the link -1 - k.
                if is_accurate[number]:
                    cell_bounds.append(cell.bounds)
                    cell_series.append(series)
                    cell.set_link(-len(cell_bounds))
                    continue
                # Halves must not be narrower than allowed. Widths are halved exactly, so
                # any factor between 1 and 2 distinguishes them.
                is_wide = width_fractions[axis] > 1.5 * MIN_CELL_FRACTION
                # The largest value is NaN, and not positive, if no sample is finite.
                exists = fits.largest_values[number] >= 0.0
                if room > 0 and is_wide and exists:
                    cell.set_link(len(splits))
                    middle = float(np.mean(cell.bounds[:, axis]))
                    split = [axis, middle, 0.0, 0.0]
                    splits.append(split)
                    lower_bounds = cell.bounds.copy()
                    lower_bounds[1, axis] = middle
                    upper_bounds = cell.bounds.copy()
                    upper_bounds[0, axis] = middle
                    # In a split, the links to the halves have the indices 2 and 3.
                    halves.append(_PendingCell(lower_bounds, split, 2))
                    halves.append(_PendingCell(upper_bounds, split, 3))
            pending = halves
        series_shape = (*[degree + 1] * variables, len(scales))
        return TensorChebyshev(
            low=low,
            high=high,
            splits=np.array(splits).reshape(-1, 4),
            bounds=np.array(cell_bounds).reshape(-1, 2, variables),
            coefficients=np.array(cell_series).reshape(-1, *series_shape),
        )

    @property
    def covered_fraction(self) -> float:
        """The volume of the domain as a fraction of the box."""
        volumes = np.prod(self.bounds[:, 1] - self.bounds[:, 0], axis=1)
        return float(np.sum(volumes) / np.prod(self.high - self.low))

    def find_cell(self, x: Sequence[float]) -> int:
        """Return the index of the cell that contains a position (m,), -1 if none does.

        The position must be in the box. The cells are the leaves of a binary tree. Each row
        of `splits` is an inner node. It has the axis along which a cell is halved, the
        coordinate at which it is halved, and the links to its lower and upper half. A
        positive link is the row of a further split, a link of -1 - k is cell k, and 0 is no
        cell.
        """
        # Without a split, the box is the only cell (0), or there is none (-1).
        if not self._python_splits:
            return len(self.bounds) - 1
        link = 0
        while True:
            axis, middle, lower_link, upper_link = self._python_splits[link]
            link = upper_link if x[axis] >= middle else lower_link
            if link <= 0:
                return -1 - link

    def find_cells(self, x: Floats) -> Indices:
        """Return the cells (n,) of positions (n, m), -1 outside the box or the domain."""
        is_inside = np.all((x >= self.low) & (x <= self.high), axis=1)
        cells = [
            self.find_cell(position) if inside else -1
            for position, inside in zip(x, is_inside, strict=True)
        ]
        return np.array(cells, np.intp)

    def evaluate(self, x: Floats) -> Floats:
        """Return the functions (n, F) at positions (n, m), NaN outside the domain."""
        return evaluate_cells(x, self.find_cells(x), self.bounds, self.coefficients)

    @cached_property
    def _python_splits(self) -> list[tuple[int, float, int, int]]:
        """The rows of `splits` as Python numbers, which are faster to read one by one.

        A row is a halving of a cell: the axis along which it is halved, the coordinate at
        which it is halved, and the links to the lower and to the upper half.
        """
        return [
            (int(axis), middle, int(lower_link), int(upper_link))
            for axis, middle, lower_link, upper_link in self.splits.tolist()
        ]


@dataclass(frozen=True)
class _PendingCell:
    """A cell that has not been fitted yet, and the link of the tree that leads to it.

    The box is halved into cells, which are the leaves of a binary tree. The tree consists
    of splits (cells that are halved), each with links to its two halves.

    Attributes
    ----------
    bounds
        (2, m) lower and upper corner.
    parent_split
        The split that made this cell, which is shared with the list of all splits. It has
        four numbers: the axis across which a cell is halved, the position, and the links to
        the lower and the upper half.
    link_index
        Index of the link to this cell in the split: 2 for a lower half, 3 for an upper one.
    """

    bounds: Floats
    parent_split: list[float]
    link_index: int

    def set_link(self, link: int) -> None:
        """Set the link that leads from the parent to this cell.

        The link is the number of a split if this cell is halved, -1 - k if it is cell k of
        the series, and 0 if it is not part of the domain.
        """
        self.parent_split[self.link_index] = link


class CellSums:
    """Weighted sums of the functions of a `TensorChebyshev`, evaluated at single positions.

    A sum at a position is the sum of its coefficients times products of Chebyshev
    polynomials T_k, one for each of the m variables. Only small arrays are used and nothing
    is checked, because most of the time of a single value is the overhead of NumPy calls.
    """

    def __init__(self, series: TensorChebyshev, weights: Floats) -> None:
        """Prepare K sums of the F functions, with weights (F, K)."""
        # (cells, degree + 1, ..., degree + 1, K) coefficients of the sums, with one axis of
        # orders k for each variable.
        coefficients = series.coefficients @ weights
        self._coefficients_by_cell = [*coefficients]
        self._order_count = coefficients.shape[1]
        self._orders = np.arange(self._order_count, dtype=float)
        # (cells, m) numbers that turn a position into a reduced position, from -1 to 1,
        # which is (position - middle) * scale.
        low = series.bounds[:, 0]
        high = series.bounds[:, 1]
        middles = 0.5 * (low + high)
        scales = 2.0 / (high - low)
        self._middles_and_scales = np.stack([middles, scales], axis=2).tolist()

    def evaluate(self, cell: int, x: Sequence[float]) -> Floats:
        """Return the sums (K,) at a position (m,) in a cell.

        `cell` is its number, as `TensorChebyshev.find_cell` returns it. A position outside
        the cell gets the value at its edge, and so does NaN.
        """
        # Each pass sums over the first remaining axis of orders. With two variables, n
        # orders and K sums, `remaining` has these shapes:
        #   at first              (n, n, K)
        #   after variable 1      (n * K,)
        #   after variable 2      (K,)
        # Local names and functions of `math` save time, which matters for a single value.
        remaining = self._coefficients_by_cell[cell]
        order_count = self._order_count
        orders = self._orders
        cos = np.cos
        for value, (middle, scale) in zip(x, self._middles_and_scales[cell], strict=True):
            reduced = (value - middle) * scale
            if not -1.0 <= reduced <= 1.0:
                reduced = copysign(1.0, reduced)
            # T_k(reduced) = cos(k acos(reduced))
            polynomials = cos(orders * acos(reduced))
            remaining = polynomials.dot(remaining.reshape(order_count, -1))
        return remaining  # type: ignore[no-any-return]


def _spread_positions(count: int, variables: int) -> Floats:
    """Return evenly spread positions in the cube from -1 to 1, and its corners.

    The positions are multiples of (1/g, 1/g^2, ...) modulo 1, where g is the real root of
    g^(m + 1) = g + 1. This generalises the golden ratio to m variables.

    Returns
    -------
    (count + 2^m, m) positions, the corners last.
    """
    # The iteration g = (1 + g)^(1 / (m + 1)) is a contraction, which converges to rounding
    # in fewer than 40 steps.
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (variables + 1))
    steps = root ** -np.arange(1.0, variables + 1)
    # Half a step from 0, so that no position is at an edge.
    fractions = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    corners = grid_points([np.array([-1.0, 1.0])] * variables)
    return np.concatenate([2.0 * fractions - 1.0, corners])


def _worst_direction(series: Floats, width_fractions: Floats) -> int:
    """Return the direction in which a series has the largest coefficients of high order.

    The direction is the number of a variable. Large last coefficients (of the two highest
    orders) mean that the series converges badly in this variable.

    Parameters
    ----------
    series
        (degree + 1, ..., F) coefficients, relative to the scale of each function.
    width_fractions
        (m,) widths of the cell. The widest direction is returned if a coefficient is not
        finite.
    """
    if not np.all(np.isfinite(series)):
        return int(np.argmax(width_fractions))
    # The last axis of the series is the functions, the others are the variables.
    largest_last_coefficients = [
        np.max(np.abs(np.take(series, [-1, -2], axis=axis)))
        for axis in range(series.ndim - 1)
    ]
    return int(np.argmax(largest_last_coefficients))
