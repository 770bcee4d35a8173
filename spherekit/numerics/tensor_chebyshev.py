"""Functions of several variables as tensor Chebyshev series on cells of a box.

A cell is halved across the direction in which its series converges worst. This ends when
its error is small enough, when the cell is as narrow as allowed in this direction, or when
there are enough cells. A cell whose error is still too large, or where the functions do not
exist, is not part of the domain.
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
        (splits, 4) halvings of cells, that of the whole box first. A row has the index of
        the halved axis, the position of the cut, and the links to the lower and the upper
        half. A positive link is the row of another halving. A link of -1 - k is the
        finished cell k. A link of 0 leads outside the domain.
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

        A cell whose error is too large is halved. A cell is left out of the domain if it is
        too narrow to be halved, if there are too many cells, or if all samples are NaN.

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
        pending = [_PendingCell(np.array([low, high], dtype=float), unused_link, 0)]
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
                # Halves must not be narrower than allowed. A width is the smallest one
                # times a power of 2, so any factor between 1 and 2 separates cells that can
                # be halved.
                is_wide = width_fractions[axis] > 1.5 * MIN_CELL_FRACTION
                # The largest value is NaN if all samples are NaN.
                exists = fits.largest_values[number] >= 0.0
                if room >= 0 and is_wide and exists:
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

        The box was halved again and again into cells, which gives a binary tree. The search
        goes down this tree. The position must be in the box. A position at a cut counts as
        part of the upper half.

        Each row of `splits` is one halving. It has the axis along which a box is halved,
        the coordinate of the cut, and the links to its lower and upper half. A positive
        link is the row of a further split. A link of -1 - k is cell k. A link of 0 means
        that there is no cell.
        """
        # Without a split, the box is the only cell (0), or there is none (-1). `bounds` has
        # a row for each cell.
        if not self._python_splits:
            return len(self.bounds) - 1
        link = 0
        while True:
            axis, middle, lower_link, upper_link = self._python_splits[link]
            link = upper_link if x[axis] >= middle else lower_link
            if link <= 0:
                # The result is k for a link of -1 - k, and -1 for a link of 0.
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

        A row is a halving of a cell: the axis and the coordinate of the cut, and the links
        to the lower and the upper half.
        """
        return [
            (int(axis), middle, int(lower_link), int(upper_link))
            for axis, middle, lower_link, upper_link in self.splits.tolist()
        ]


@dataclass(frozen=True)
class _PendingCell:
    """A part of a box that still has to be approximated or halved.

    A box is halved again and again into cells. The halvings ("splits") form a binary tree.
    Each split refers to its two halves by numbers ("links", see `set_link`). The link to
    this cell is set when it is known whether the cell is halved again.

    Attributes
    ----------
    bounds
        (2, m) lower and upper corner.
    parent_split
        The split that produced this cell: a list of four numbers, which is a row of the
        table of all splits. The numbers are the axis across which the larger cell is
        halved, the position of the cut, and the links to the lower and the upper half.
    link_index
        Index in `parent_split` of the number that refers to this cell: 2 for a lower half,
        3 for an upper one.
    """

    bounds: Floats
    parent_split: list[float]
    link_index: int

    def set_link(self, link: int) -> None:
        """Set the link (a number) that leads from the halved larger cell to this cell.

        The link is the index of a split if this cell is halved, and -1 - k if it is the
        finished cell k. The link is 0 if the cell is not part of the domain. The number 0
        is free for this purpose: split 0 halves the whole box, and no link leads to the
        box.
        """
        self.parent_split[self.link_index] = link


class CellSums:
    """Fast evaluation of weighted sums of the functions of a `TensorChebyshev`.

    The box of m variables is divided into cells. In each cell, a sum is a polynomial: its
    coefficients times products of Chebyshev polynomials T_k, one for each variable. One
    position is evaluated at a time. Only small arrays are used and nothing is checked,
    because the overhead of NumPy calls takes most of the time of a single value.
    """

    def __init__(self, series: TensorChebyshev, weights: Floats) -> None:
        """Prepare K weighted sums of F functions.

        Parameters
        ----------
        series
            Chebyshev series of the functions in the cells of a box of m variables.
        weights
            (F, K) weight of each function (first axis) in each sum (second axis).
        """
        # (cells, degree + 1, ..., degree + 1, K) coefficients of the sums. For each
        # variable there is one axis, the order k of its Chebyshev polynomial T_k.
        coefficients = series.coefficients @ weights
        # A list with one array per cell, because lists are faster to read one by one.
        self._coefficients_by_cell = [*coefficients]
        self._order_count = coefficients.shape[1]
        self._orders = np.arange(self._order_count, dtype=float)
        # Chebyshev polynomials are defined from -1 to 1. A position in a cell is scaled to
        # this range as (position - middle) * scale. The bounds (cells, 2, m) are the lower
        # and the upper corner of each cell.
        low = series.bounds[:, 0]  # (cells, m)
        high = series.bounds[:, 1]
        middles = 0.5 * (low + high)
        scales = 2.0 / (high - low)
        # (cells, m, 2) as nested lists.
        self._middles_and_scales = np.stack([middles, scales], axis=2).tolist()

    def evaluate(self, cell: int, x: Sequence[float]) -> Floats:
        """Return K weighted sums of functions at one position in a cell.

        The functions and their weights were given when this object was made. Within a cell,
        each sum is a polynomial: its coefficients times products of Chebyshev polynomials
        T_k, one for each of the m variables.

        Parameters
        ----------
        cell
            Index of the cell, as `TensorChebyshev.find_cell` returns it.
        x
            (m,) position. If a coordinate is outside the cell, or NaN, the nearest edge of
            the cell is taken (for NaN the upper or the lower edge).

        Returns
        -------
        (K,) sums.
        """
        # Each pass sums over the first remaining axis of orders. With two variables, n
        # orders and K sums, `remaining` has these shapes:
        #   at first              (n, n, K)
        #   after variable 1      (n * K,)
        #   after variable 2      (K,)
        # Local names and functions of `math` save time.
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

    The error of an approximation is measured at these positions. The positions are a
    sequence without randomness: 0.5 plus multiples of (1/g, 1/g^2, ...), modulo 1, scaled
    to the cube. Here g is the real root of g^(m + 1) = g + 1.

    Parameters
    ----------
    count
        Number of positions besides the corners.
    variables
        Number m of variables, the dimension of the cube.

    Returns
    -------
    (count + 2^m, m) positions, the corners last.
    """
    # Fixed-point iteration g = (1 + g)^(1 / (m + 1)). It converges in fewer than 40 steps.
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (variables + 1))
    steps = root ** -np.arange(1.0, variables + 1)
    fractions = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    corners = grid_points([np.array([-1.0, 1.0])] * variables)
    return np.concatenate([2.0 * fractions - 1.0, corners])


def _worst_direction(series: Floats, width_fractions: Floats) -> int:
    """Return the index of the variable in which a Chebyshev series converges worst.

    The cell of the series is to be halved across this direction. Large coefficients of the
    two highest orders of a variable show slow convergence.

    Parameters
    ----------
    series
        (degree + 1, ..., F) coefficients of F functions, with one axis of orders for each
        variable. The coefficients are relative to the scale of each function.
    width_fractions
        (m,) widths of the cell, as fractions of the whole box. If a coefficient is not
        finite, the widest direction is returned.
    """
    if not np.all(np.isfinite(series)):
        return int(np.argmax(width_fractions))
    # The last axis of the series is the functions, the others are the variables.
    largest_last_coefficients = [
        np.max(np.abs(np.take(series, [-1, -2], axis=axis)))
        for axis in range(series.ndim - 1)
    ]
    return int(np.argmax(largest_last_coefficients))
