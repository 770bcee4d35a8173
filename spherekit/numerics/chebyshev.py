"""Functions of one variable as Chebyshev series on cells, and the algebra of such series.

The algebra also covers tensor series of several variables, which
`spherekit.numerics.tensor_chebyshev` uses. T_k is the Chebyshev polynomial of order k. On
a cell [low, high] the argument of T_k is the reduced position, which goes from -1 to 1.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from spherekit.arrays import Floats, Indices

DEFAULT_SERIES_DEGREE = 15
"""Default degree on a cell. Larger: fewer cells, each with more samples."""

DEFAULT_MAX_CELLS = 2**13
"""Default limit of the cells. Smaller: functions with kinks get a larger error."""

LOSSY_TOLERANCE = 1e-10
"""Relative error that is accepted for functions which lose digits.

It is meant for the argument `rounding_tolerance` of `PiecewiseChebyshev.fit`.
"""

MAX_IMAGINARY_PART = 1e-6
"""A zero of a series is real if its imaginary part, in half cells, is smaller.

A double zero is computed as a complex pair whose imaginary part is about the square root of
the rounding error. Smaller: double zeros are lost. Larger: near-zeros become zeros.
"""


@dataclass(frozen=True)
class PiecewiseChebyshev:
    """m functions of one variable, given by Chebyshev series on cells.

    On each cell a function is the sum of c_k T_k(x), with the Chebyshev polynomials T_k and
    the position x in the cell, from -1 to 1.

    Attributes
    ----------
    edges
        (cells + 1,) edges of the cells, rising.
    coefficients
        (cells, degree + 1, m) coefficients of T_0, T_1, ... for each function.
    error
        Largest measured difference from the approximated functions, relative to the scale
        of each function.
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
        scales: Floats | None = None,
        first_cells: int | Floats = 1,
        degree: int = DEFAULT_SERIES_DEGREE,
        max_cells: int = DEFAULT_MAX_CELLS,
        rounding_tolerance: float = 0.0,
    ) -> "PiecewiseChebyshev":
        """Return the interpolant of m functions on [low, high].

        The range is divided into cells, with one polynomial each. A cell is halved until
        its error is small enough for every function. The polynomial agrees with the
        function at the samples, so the error is measured about midway between them. The
        largest error is the attribute `error` of the result.

        Parameters
        ----------
        function
            Maps rising positions (n,) to values (n, m).
        low, high
            Ends of the range.
        tolerance
            Largest error, relative to the scale of each function.
        scales
            (m,) scales of the functions. By default the largest value at the first samples
            is the scale of all functions.
        first_cells
            Number of equal cells to begin with, or their edges.
        degree
            Degree of the series.
        max_cells
            If halving would lead to more cells, the cells stay as they are.
        rounding_tolerance
            Limit of errors that may be due to rounding. A cell with a smaller error is not
            halved again if the last halving reduced its error by less than half.
        """
        if isinstance(first_cells, int):
            edges = np.linspace(low, high, first_cells + 1)
        else:
            edges = first_cells
        bounds = np.stack([edges[:-1], edges[1:]], axis=1)
        check_positions = np.cos(np.arange(degree + 2)[:, None] * np.pi / (degree + 1))

        def call_in_rising_order(x: Floats) -> Floats:
            """Return the values (n, m) at positions (n, 1) in any order."""
            # Rounding may move the last position beyond the range.
            order = np.argsort(x[:, 0])
            return function(np.minimum(x[order, 0], high))[np.argsort(order)]

        # `bounds` (cells, 2) are the cells that are not finished, and `last_errors` the
        # errors of the cells from which they were halved.
        last_errors = np.full(len(bounds), np.inf)
        largest_error = 0.0
        # The series of each finished cell, by the lower end of the cell.
        series_by_start: dict[float, Floats] = {}
        while len(bounds):
            fits = fit_cells(
                call_in_rising_order, bounds[..., None], degree, check_positions
            )
            if scales is None:
                largest_value = np.max(fits.largest_values) or 1.0
                scales = np.full(fits.deviations.shape[2], largest_value)
            errors = np.max(fits.deviations / scales, axis=(1, 2))
            is_rounding = (errors < rounding_tolerance) & (errors > 0.5 * last_errors)
            is_final = (errors <= tolerance) | is_rounding
            # All cells are final if halving the others would exceed the limit.
            cell_count = len(series_by_start) + len(bounds) + np.sum(~is_final)
            is_final |= cell_count > max_cells
            starts = bounds[is_final, 0].tolist()
            series_by_start.update(zip(starts, fits.coefficients[is_final], strict=True))
            largest_error = float(np.max(errors[is_final], initial=largest_error))

            # The other cells are halved: (low, high) becomes (low, middle), (middle, high).
            bounds = bounds[~is_final]
            last_errors = np.repeat(errors[~is_final], 2)
            middles = np.mean(bounds, axis=1, keepdims=True)
            bounds = np.insert(bounds, [1, 1], middles, axis=1).reshape(-1, 2)
        starts = sorted(series_by_start)
        coefficients = np.stack([series_by_start[start] for start in starts])
        return PiecewiseChebyshev(np.array([*starts, high]), coefficients, largest_error)

    def spread_positions(self, count: int) -> Floats:
        """Return `count` evenly spread positions per cell, and the last edge.

        The first position of a cell is its edge.
        """
        cells = len(self.coefficients)
        return np.interp(
            np.arange(count * cells + 1) / count, np.arange(cells + 1), self.edges
        )

    def evaluate(self, x: ArrayLike) -> Floats:
        """Return the functions (n, m) at positions (n,) between the first and last edge."""
        x = np.asarray(x, dtype=float)
        bounds = sliding_window_view(self.edges, 2)
        return evaluate_cells(
            x[:, None], self._find_cells(x), bounds[..., None], self.coefficients
        )

    def evaluate_pointwise(self, x: Floats) -> Floats:
        """Return the functions (m, n) at positions (n,), in any cells.

        Positions outside the range count as the nearest end of the range. Each position
        takes the coefficients of its own cell. For few functions at positions in many
        cells, this method is faster than `evaluate`.
        """
        cell = self._find_cells(x)
        low = self.edges[cell]
        high = self.edges[cell + 1]
        reduced = np.clip((2.0 * x - (low + high)) / (high - low), -1.0, 1.0)
        series = self._coefficients_by_order.take(cell, axis=2)
        return np.asarray(chebyshev.chebval(reduced, series, tensor=False))

    def _find_cells(self, x: Floats) -> Indices:
        """Return the cell (n,) of each position; positions outside get the nearest cell."""
        return np.searchsorted(self.edges[1:-1], x, side="right")

    @cached_property
    def _coefficients_by_order(self) -> Floats:
        """(degree + 1, m, cells) coefficients, with the order as the first axis."""
        return np.ascontiguousarray(self.coefficients.transpose(1, 2, 0))

    @cached_property
    def derivative(self) -> "PiecewiseChebyshev":
        """The derivatives of the interpolant with respect to the variable."""
        reduced_per_position = 2.0 / np.diff(self.edges)
        slopes = chebyshev.chebder(self.coefficients, axis=1)
        return PiecewiseChebyshev(self.edges, slopes * reduced_per_position[:, None, None])


@dataclass(frozen=True)
class CellFits:
    """Chebyshev series of F functions of m variables, fitted to samples in several cells.

    A cell is an interval of one variable, or a box in several variables.

    In a cell, a series is a sum of coefficients times products of one Chebyshev polynomial
    per variable. The polynomials have the orders from 0 to the degree.

    Attributes
    ----------
    coefficients
        (cells, degree + 1, ..., F) coefficients, with one axis of orders per variable.
    deviations
        (cells, checks, F) absolute differences between the series and the functions at
        check positions.
    largest_values
        (cells,) largest absolute sample of each cell, NaN if all samples are NaN.
    """

    coefficients: Floats
    deviations: Floats
    largest_values: Floats


def fit_cells(
    function: Callable[[Floats], Floats],
    bounds: Floats,
    degree: int,
    check_positions: Floats,
) -> CellFits:
    """Return Chebyshev series of functions on several cells.

    A cell is an interval of one variable, or a box in several variables. The function is
    called once, with the samples of all cells.

    Parameters
    ----------
    function
        Maps positions (n, m) to the values (n, F) of F functions.
    bounds
        (cells, 2, m) lower and upper corner of each cell, in m variables.
    degree
        Degree of the series in each variable.
    check_positions
        (k, m) reduced positions, from -1 to 1, at which the series are compared with the
        functions.

    Returns
    -------
    Coefficients (cells, degree + 1, ..., F) with one axis of orders per variable, absolute
    deviations (cells, k, F), and the largest absolute sample of each cell. Only the largest
    sample ignores NaN.
    """
    variables = bounds.shape[2]
    grid = grid_points([chebyshev_nodes(degree)] * variables)
    reduced = np.concatenate([grid, check_positions])
    x = _place_in_cells(reduced, bounds)
    # (cells, positions, F)
    samples = function(x.reshape(-1, variables)).reshape(len(bounds), len(reduced), -1)
    grid_samples = samples[:, : len(grid)]
    check_samples = samples[:, len(grid) :]

    coefficients = _transform_grid_samples(grid_samples, degree, variables)
    # (cells, orders, F) and (k, orders): coefficients, and products of one polynomial per
    # variable, for all combinations of orders in the same sequence.
    flat_coefficients = coefficients.reshape(len(bounds), len(grid), -1)
    products = multiply_variables(evaluate_polynomials(check_positions, degree))
    # (cells, k, F) the series at the check positions: sums of coefficients times products.
    series_values = products @ flat_coefficients
    return CellFits(
        coefficients=coefficients,
        deviations=np.abs(series_values - check_samples),
        largest_values=np.fmax.reduce(np.abs(samples), axis=(1, 2)),
    )


def _place_in_cells(reduced: Floats, bounds: Floats) -> Floats:
    """Return positions (cells, n, m) at the same relative places in each cell.

    Cells are boxes in m variables. The relative ("reduced") positions (n, m) are from -1 to
    1. `bounds` (cells, 2, m) are the lower and the upper corner of each cell.
    """
    low = bounds[:, 0]
    high = bounds[:, 1]
    half_widths = 0.5 * (high - low)
    return low[:, None] + half_widths[:, None] * (1.0 + reduced)


def _transform_grid_samples(grid_samples: Floats, degree: int, variables: int) -> Floats:
    """Return the Chebyshev coefficients of functions from samples at a grid of nodes.

    A cell is a box in m variables. Its samples are transformed along one variable after
    another.

    Parameters
    ----------
    grid_samples
        (cells, (degree + 1)^m, F) samples at the points of a grid of `chebyshev_nodes`. The
        last variable varies fastest.
    degree
        Degree of the series in each variable.
    variables
        Number m of variables.

    Returns
    -------
    (cells, degree + 1, ..., F) coefficients. Each variable has an axis, along which the
    order of its Chebyshev polynomial rises from 0 to the degree.
    """
    # Before the transform, each variable has an axis of its nodes.
    cell_count = len(grid_samples)
    tensor = grid_samples.reshape(cell_count, *[degree + 1] * variables, -1)
    for axis in range(1, variables + 1):
        # The sum runs over the axis of nodes. The new axis of orders comes last, and is
        # moved to the place of the nodes.
        transformed = np.tensordot(tensor, fitting_matrix(degree), (axis, 1))
        tensor = np.moveaxis(transformed, -1, axis)
    return tensor


def evaluate_cells(
    x: Floats, cell_of: Indices, bounds: Floats, coefficients: Floats
) -> Floats:
    """Evaluate Chebyshev series of F functions of m variables at positions in cells.

    A cell is a box in the m variables. In it a function is a sum of coefficients times
    products of one Chebyshev polynomial per variable. Their arguments are the position in
    the cell, from -1 to 1. Positions outside their cell get the value at its edge.

    Parameters
    ----------
    x
        (n, m) positions.
    cell_of
        (n,) cell of each position, -1 if it is in none.
    bounds
        (cells, 2, m) lower and upper corner of each cell.
    coefficients
        (cells, degree + 1, ..., F) Chebyshev series of the cells.

    Returns
    -------
    (n, F) values, NaN at positions in no cell.
    """
    # `groups.order` has the positions that are in a cell, sorted by their cells.
    groups = group_by_cell(cell_of)
    sorted_x = x[groups.order]
    sorted_cells = cell_of[groups.order]
    reduced = reduce_positions(sorted_x, bounds[sorted_cells])
    polynomials = evaluate_polynomials(reduced, degree=coefficients.shape[1] - 1)
    values = np.full((len(x), coefficients.shape[-1]), np.nan)
    # For speed, one matrix product evaluates all positions of a cell.
    for cell, start, stop in zip(groups.cells, groups.starts, groups.stops, strict=True):
        products = multiply_variables(polynomials[start:stop])
        # One row of coefficients for each product of polynomials, one column per function.
        series = coefficients[cell].reshape(products.shape[1], -1)
        values[groups.order[start:stop]] = products @ series
    return values


@dataclass(frozen=True)
class CellGroups:
    """Indices of positions, grouped by the cell (interval or box) that contains them.

    A position is a point at which a piecewise function is evaluated. Each cell has its own
    series, so all positions of a cell are evaluated together.

    Attributes
    ----------
    order
        (k,) indices of the positions that are in a cell, sorted by cell.
    cells
        The numbers of the cells that contain positions, in rising order.
    starts, stops
        For each of these cells: ``order[start:stop]`` has the indices of its positions.
    """

    order: Indices
    cells: list[int]
    starts: list[int]
    stops: list[int]


def group_by_cell(cell_of: Indices) -> CellGroups:
    """Group positions by their cells (n,); positions in no cell (-1) are left out."""
    sorted_by_cell = np.argsort(cell_of, kind="stable")
    order = sorted_by_cell[cell_of[sorted_by_cell] >= 0]
    cells, starts, counts = np.unique(cell_of[order], return_index=True, return_counts=True)
    return CellGroups(
        order, cells.tolist(), starts.tolist(), stops=(starts + counts).tolist()
    )


def reduce_positions(x: Floats, bounds: Floats) -> Floats:
    """Return positions in their cells, scaled so that each cell reaches from -1 to 1.

    The positions are (n, m), in m variables. `bounds` (n, 2, m) are the lower and the upper
    corner of the cell of each position. Chebyshev series take such scaled positions.
    """
    low = bounds[:, 0]
    high = bounds[:, 1]
    return (2.0 * x - low - high) / (high - low)


@cache
def chebyshev_nodes(degree: int) -> Floats:
    """Return the zeros (degree + 1,) of the Chebyshev polynomial T_(degree + 1), rising.

    Interpolation at these positions determines a series of the given degree.
    """
    return np.cos((np.arange(degree, -1, -1) + 0.5) * np.pi / (degree + 1))


def grid_points(axes: Sequence[Floats]) -> Floats:
    """Return the points (n, m) of a grid with given positions along each of m axes.

    The last axis varies fastest.
    """
    return np.array(list(product(*axes)))


def evaluate_polynomials(reduced: Floats, degree: int) -> Floats:
    """Return the Chebyshev polynomials T_0 ... T_degree at positions from -1 to 1.

    The positions are (n, m), and the result is (n, m, degree + 1). Positions beyond -1 or 1
    count as -1 or 1.
    """
    return np.asarray(chebyshev.chebvander(np.clip(reduced, -1.0, 1.0), degree))


def multiply_variables(polynomials: Floats) -> Floats:
    """Return all products of one Chebyshev polynomial per variable.

    With two variables they are T_j(x_1) T_k(x_2) for all orders j and k, with k varying
    fastest. The value of a series is the sum of its coefficients times these products.

    Parameters
    ----------
    polynomials
        (n, m, degree + 1) values of T_0 ... T_degree at n positions, for each variable.

    Returns
    -------
    (n, (degree + 1)^m) products, in the order of the flattened coefficients of a series in
    m variables.
    """
    products = polynomials[:, 0]
    for variable in range(1, polynomials.shape[1]):
        factors = polynomials[:, variable, None]
        products = (products[:, :, None] * factors).reshape(len(products), -1)
    return products


@cache
def fitting_matrix(degree: int) -> Floats:
    """Return the matrix that turns values at the `chebyshev_nodes` into coefficients."""
    # Discrete orthogonality: the coefficient of T_k is the mean of 2 f T_k over the nodes,
    # and that of T_0 is the mean of f.
    matrix = evaluate_polynomials(chebyshev_nodes(degree), degree).T * (2.0 / (degree + 1))
    matrix[0] *= 0.5
    return matrix


def trim_series(series: Floats, threshold: float) -> Floats:
    """Return a series without its last terms of absolute size up to the threshold.

    A shorter series is faster to evaluate. The first two terms always remain.
    """
    (large,) = np.nonzero(np.abs(series) > threshold)
    return series[: np.max(large + 1, initial=2)]


def find_real_zeros(series: Floats, limit: float = 1.0) -> Floats:
    """Return the real zeros of a Chebyshev series in [-limit, limit], rising.

    A double zero is returned twice.

    `series` has the coefficients of the Chebyshev polynomials T_0, T_1, ... The zeros are
    eigenvalues of its companion matrix. Rounding turns a double zero into two complex ones,
    so zeros with imaginary parts below `MAX_IMAGINARY_PART` count as real. `limit` is 1, or
    a little more for zeros that rounding moves beyond an end.
    """
    # Last coefficients as tiny as rounding errors (1e-15) would lead to large wrong
    # eigenvalues, so they are removed.
    largest_coefficient = float(np.max(np.abs(series), initial=0.0))
    series = trim_series(series, 1e-15 * largest_coefficient)
    # Up to a limit r, T_k does not exceed cosh(k acosh(r)). If the constant term is larger
    # than all other terms together can be, there is no zero. The limit is increased by the
    # imaginary part that a zero may have.
    orders = np.arange(1, len(series))
    largest_values = np.cosh(orders * np.arccosh(limit + MAX_IMAGINARY_PART))
    if len(series) < 2 or abs(series[0]) > np.abs(series[1:]) @ largest_values:
        return np.zeros(0)
    roots = chebyshev.chebroots(series)
    real_roots = roots.real[np.abs(roots.imag) < MAX_IMAGINARY_PART]
    return np.sort(real_roots[np.abs(real_roots) <= limit])
