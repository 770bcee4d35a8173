"""All sign changes of an analytic function of one variable whose derivative is unknown.

The range is cut into cells. In each cell the function is replaced by its Chebyshev
polynomial, whose zeros are computed. A cell is halved until the polynomial agrees with the
function, up to a small part of the largest value in the cell. The disagreement is estimated
from the last coefficients and from a few samples away from the nodes. See L. N. Trefethen,
Approximation Theory and Approximation Practice, 2013, chapter 18.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Floats
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.chebyshev import find_real_zeros, fit_cells, trim_series
from spherekit.tolerances import EPS

SIGN_CHANGE_DEGREE = 32
"""Degree of the polynomial in a cell. Larger: fewer cells, each with more samples."""

FIRST_EDGES = np.array([0.0, 0.2371, 0.4918, 0.7653, 1.0])
"""Edges of the first cells, as fractions of the range.

The fractions are irregular, so that a zero at a round number is not at an edge.
"""

MAX_SIGN_CHANGE_HALVINGS = 12
"""Halvings after which a cell is not cut again. Larger: narrower doubtful intervals."""

MAX_FRUITLESS_HALVINGS = 2
"""Successive halvings that settle neither half, after which a cell is not cut again.

Where a function is not smooth, for example because only its own rounding errors are seen,
smaller cells do not become clearer. Larger: more samples are spent on such places.
"""

MAX_CELLS = 400
"""Default limit of the sampled cells. Smaller: more of the range stays doubtful."""

SIGN_CHANGE_NEWTON_STEPS = 3
"""Newton steps with the function itself that refine the zeros of the polynomials."""

MAX_NEWTON_STEP = 1e-3
"""Longest Newton step that is taken, in the unit of the variable.

The zero of a polynomial is closer than this to the zero of the function. A longer step is
an artefact of a small slope, and the zero is left where it is.
"""

MERGE_RATIO = 1e-6
"""Doubtful intervals with a smaller gap, relative to the length of one, are merged."""

FIT_TOLERANCE = 1e-8
"""Largest error of a polynomial, relative to the largest value in its cell.

Smaller: more cells are halved. Larger: small extrema near zero are hidden by the error.
"""

NONZERO_ERROR_RATIO = 4.0
"""A value that exceeds the error of the polynomial by this factor is not zero."""

CLEARLY_NONZERO_ERROR_RATIO = 4.0 * NONZERO_ERROR_RATIO
"""The same factor for the ends of a doubtful interval, which must be clearly nonzero."""

ROUNDING_ERROR_RATIO = 1e-13
"""A polynomial with a smaller relative error deviates by rounding only.

Halving such a cell reveals nothing more about an extremum near zero.
"""

HALF_WIDTHS = 2.0 * np.logspace(-10.0, 0.0, 61)
"""Half widths that are tried for a doubtful interval about an extremum, in half cells."""

TAIL_LENGTH = 4
"""Number of last coefficients that indicate the error of the polynomial."""

EDGE_MARGIN = 1e-2
"""An extremum beyond the edge by less than this, in half cells, is examined in both cells.

Without the margin, rounding could move an extremum at an edge out of both cells.
"""

_CHECK_POSITIONS = np.linspace(-1.0, 1.0, 6)[:, None]
"""(6, 1) positions in a cell, from -1 to 1, where polynomial and function are compared."""

SAMPLES_PER_CELL = SIGN_CHANGE_DEGREE + 1 + len(_CHECK_POSITIONS)
"""Number of values of the function that a cell takes."""


def find_sign_changes(
    function: Callable[[Floats], Floats],
    low: float,
    high: float,
    max_cells: int = MAX_CELLS,
    smooth_width: float = np.inf,
) -> tuple[Floats, Floats]:
    """Return where a function changes its sign, and where this could not be decided.

    Two zeros close together are separated if the function between them exceeds its error.
    Closer zeros are inside a doubtful interval.

    Parameters
    ----------
    function
        Maps positions (n,) to values (n,). NaN where the function has no value.
    low, high
        Ends of the range.
    max_cells
        Approximate limit of the number of cells. A cell takes `SAMPLES_PER_CELL` values.
    smooth_width
        Width of a cell in which samples resolve a smooth function. Narrower cells are not
        cut again after `MAX_FRUITLESS_HALVINGS` successive halvings without a settled half.
        Halvings of wider cells do not count, because samples may be too sparse there.

    Returns
    -------
    sign_changes
        (k,) positions in rising order.
    doubtful_intervals
        (d, 2) disjoint intervals in rising order. An interval contains an extremum that is
        zero up to the error of the function, or a cell in which the function is not smooth
        or has no value.
    """
    edges = low + (high - low) * FIRST_EDGES
    # (n, 2) ends of the cells of the current pass. Results of finished cells are collected
    # in the four lists.
    cells = np.stack([edges[:-1], edges[1:]], axis=1)
    zeros_of_cells: list[Floats] = []
    slopes_of_cells: list[Floats] = []
    uncertainties_of_cells: list[Floats] = []
    doubtful_of_cells: list[Floats] = []
    sampled_cells = 0
    fruitless_halvings = np.zeros(len(cells), dtype=int)
    # In a narrow cell the few check positions may happen to show too small a rounding
    # error, so that a double zero would seem to differ from zero. A cell therefore inherits
    # the largest rounding error of the cells that contain it.
    inherited_errors = np.zeros(len(cells))
    for depth in range(MAX_SIGN_CHANGE_HALVINGS + 1):
        sampled_cells += len(cells)
        middles = cells.mean(axis=1)
        half_widths = 0.5 * (cells[:, 1] - cells[:, 0])
        fits = fit_cells(
            lambda x: function(x[:, 0]),
            cells[..., None],
            SIGN_CHANGE_DEGREE,
            _CHECK_POSITIONS,
        )
        # Series and results of a cell refer to its reduced position, from -1 to 1.
        contents = [
            _examine_cell(series[:, 0], deviations, largest_value, inherited_error)
            for series, deviations, largest_value, inherited_error in zip(
                fits.coefficients,
                fits.deviations,
                fits.largest_values,
                inherited_errors,
                strict=True,
            )
        ]

        can_halve = (
            depth < MAX_SIGN_CHANGE_HALVINGS and sampled_cells + 2 * len(cells) <= max_cells
        )
        is_halved = np.array([content.needs_halving for content in contents])
        is_halved &= fruitless_halvings < MAX_FRUITLESS_HALVINGS
        is_halved &= can_halve
        for cell in np.flatnonzero(~is_halved):
            content = contents[cell]
            zeros_of_cells.append(middles[cell] + half_widths[cell] * content.zeros)
            slopes_of_cells.append(content.slopes / half_widths[cell])
            uncertainties_of_cells.append(half_widths[cell] * content.uncertainties)
            doubtful_of_cells.append(middles[cell] + half_widths[cell] * content.doubtful)
        if not np.any(is_halved):
            break

        if depth > 0:
            # Cells 2k and 2k + 1 are the halves of one cell of the previous pass.
            neither_settled = np.repeat(is_halved.reshape(-1, 2).all(axis=1), 2)
            is_fruitless = neither_settled & (2.0 * half_widths <= smooth_width)
            fruitless_halvings = (fruitless_halvings + 1) * is_fruitless
        # Both halves inherit the number of fruitless halvings and the rounding error.
        fruitless_halvings = np.repeat(fruitless_halvings[is_halved], 2)
        rounding_errors = np.array([content.rounding_error for content in contents])
        inherited_errors = np.maximum(inherited_errors, rounding_errors)
        inherited_errors = np.repeat(inherited_errors[is_halved], 2)
        split_edges = np.insert(cells[is_halved], [1, 1], middles[is_halved, None], axis=1)
        cells = split_edges.reshape(-1, 2)

    positions = np.concatenate(zeros_of_cells)
    slopes = np.concatenate(slopes_of_cells)
    uncertainties = np.concatenate(uncertainties_of_cells)
    doubtful_intervals = merge_intervals(np.concatenate(doubtful_of_cells))
    # An extremum a little beyond an end of the range is not in the range.
    is_in_range = (doubtful_intervals[:, 1] >= low) & (doubtful_intervals[:, 0] <= high)
    doubtful_intervals = doubtful_intervals[is_in_range]
    # Near an extremum that is zero up to the error, sign changes may be due to the error.
    starts = doubtful_intervals[:, :1]
    stops = doubtful_intervals[:, 1:]
    is_doubtful = np.any((starts <= positions) & (positions <= stops), axis=0)
    positions = positions[~is_doubtful]
    slopes = slopes[~is_doubtful]
    uncertainties = uncertainties[~is_doubtful]
    # A zero near an edge may have been found in both cells. The slopes of two different
    # zeros that follow one another have opposite signs.
    order = np.argsort(positions)
    positions, slopes, uncertainties = positions[order], slopes[order], uncertainties[order]
    reach = uncertainties[:-1] + uncertainties[1:] + 4.0 * EPS * max(abs(low), abs(high))
    is_repeated = (np.diff(positions) <= reach) & (
        (slopes[:-1] > 0.0) == (slopes[1:] > 0.0)
    )
    is_new = np.append(True, ~is_repeated)[: len(positions)]
    positions = np.clip(positions[is_new], low, high)
    slopes = slopes[is_new]
    if len(positions):
        # The slopes of the polynomials replace the unknown derivative of the function.
        for _ in range(SIGN_CHANGE_NEWTON_STEPS):
            with np.errstate(all="ignore"):
                step = -function(positions) / slopes
            positions = positions + np.where(np.abs(step) < MAX_NEWTON_STEP, step, 0.0)
    return np.clip(np.sort(positions), low, high), np.clip(doubtful_intervals, low, high)


@dataclass(frozen=True)
class _CellContent:
    """Zeros and doubtful intervals of a function in one cell of its range.

    A cell is an interval in which the function is replaced by a polynomial. Positions are
    scaled so that the cell extends from -1 to 1. A doubtful interval contains an extremum
    that is zero up to the error of the polynomial. The function may have two close zeros
    there, or none. `find_sign_changes` halves cells that need it, and collects the zeros
    and doubtful intervals of all other cells.

    Attributes
    ----------
    zeros, slopes
        (k,) positions of sign changes of the polynomial, and its derivatives at them. They
        include zeros beyond an edge of the cell by less than their uncertainty.
    uncertainties
        (k,) estimated distances within which the zeros of the function are.
    doubtful
        (d, 2) ends of the doubtful intervals; the whole cell if the polynomial does not fit
        the function.
    needs_halving
        Whether polynomials of both halves could show more. True if the polynomial does not
        fit. Also true if there are doubtful intervals, and the error of the polynomial is
        larger than rounding errors.
    rounding_error
        Error of the polynomial if it consists of rounding errors only, otherwise 0. In
        smaller cells inside this cell, the error is taken to be at least as large.
    """

    zeros: Floats
    slopes: Floats
    uncertainties: Floats
    doubtful: Floats
    needs_halving: bool
    rounding_error: float


_NO_ZEROS = np.zeros(0)
_NO_INTERVALS = np.zeros((0, 2))
_WHOLE_CELL = np.array([[-1.0, 1.0]])


def _examine_cell(
    series: Floats, deviations: Floats, largest_value: float, inherited_error: float
) -> _CellContent:
    """Return the zeros and doubtful intervals of a function in a cell.

    The function is known by its polynomial in the cell, a Chebyshev series on [-1, 1]. An
    interval is doubtful if an extremum in it is zero up to the error of the polynomial, so
    that the function may have two zeros there, or none.

    Parameters
    ----------
    series
        (degree + 1,) Chebyshev coefficients of the polynomial in the cell.
    deviations
        Differences between the polynomial and the function at the check positions.
    largest_value
        Largest absolute sample in the cell.
    inherited_error
        Largest rounding error measured in the larger cells that contain this cell.
    """
    # The error of the polynomial, by comparison and by the size of its last coefficients.
    error = max(np.max(deviations), np.max(np.abs(series[-TAIL_LENGTH:])))
    # A polynomial that does not fit says nothing about the cell. The comparison is false if
    # samples are NaN, because the error is NaN then.
    fits = error <= FIT_TOLERANCE * largest_value and 0.0 < largest_value < np.inf
    if not fits:
        return _CellContent(
            zeros=_NO_ZEROS,
            slopes=_NO_ZEROS,
            uncertainties=_NO_ZEROS,
            doubtful=_WHOLE_CELL,
            needs_halving=True,
            rounding_error=0.0,
        )
    is_rounding = error <= ROUNDING_ERROR_RATIO * largest_value
    rounding_error = error if is_rounding else 0.0
    error = max(error, inherited_error)
    # Last coefficients far below the error are dropped, which saves time.
    series = trim_series(series, 1e-3 * error)
    # There is no zero if the constant term exceeds the sum of all others and the error,
    # because no Chebyshev polynomial exceeds 1 in the cell.
    if abs(series[0]) > np.sum(np.abs(series[1:])) + NONZERO_ERROR_RATIO * error:
        return _CellContent(
            zeros=_NO_ZEROS,
            slopes=_NO_ZEROS,
            uncertainties=_NO_ZEROS,
            doubtful=_NO_INTERVALS,
            needs_halving=False,
            rounding_error=rounding_error,
        )

    derivative = np.asarray(chebyshev.chebder(series), dtype=float)
    extrema = find_real_zeros(derivative, 1.0 + EDGE_MARGIN)
    extreme_sizes = np.abs(chebyshev.chebval(extrema, series))
    touching = extrema[extreme_sizes <= NONZERO_ERROR_RATIO * error]
    doubtful = _enclose_touching_extrema(series, touching, error)

    # The polynomial is monotone between two extrema, so each sign change is a single zero.
    # A zero of the function in this cell may be a zero of the polynomial beyond an edge.
    limit = 1.0 + EDGE_MARGIN
    cuts = np.unique([-limit, *extrema, limit])
    values = chebyshev.chebval(cuts, series)
    (changing,) = np.nonzero((values[:-1] >= 0.0) != (values[1:] >= 0.0))
    zeros, _ = find_bracketed_zeros(
        lambda x, _: np.asarray(chebyshev.chebval(x, series), dtype=float),
        cuts[changing],
        cuts[changing + 1],
        values[changing],
        values[changing + 1],
    )
    slopes = np.asarray(chebyshev.chebval(zeros, derivative), dtype=float)
    # The smallest positive number avoids a division by 0.
    sizes = np.maximum(np.abs(slopes), np.finfo(float).tiny)
    uncertainties = np.minimum(NONZERO_ERROR_RATIO * error / sizes, EDGE_MARGIN)
    # Rounding alone moves a zero by about EPS.
    is_inside = np.abs(zeros) <= 1.0 + np.maximum(uncertainties, 4.0 * EPS)
    return _CellContent(
        zeros=zeros[is_inside],
        slopes=slopes[is_inside],
        uncertainties=uncertainties[is_inside],
        doubtful=doubtful,
        needs_halving=len(touching) > 0 and not is_rounding,
        rounding_error=rounding_error,
    )


def _enclose_touching_extrema(series: Floats, touching: Floats, error: float) -> Floats:
    """Return intervals (k, 2) about k extrema in which a polynomial may be zero.

    At these extrema the polynomial is zero up to its error, so the number of zeros near
    them is uncertain. An interval is widened until the polynomial is clearly nonzero at
    both ends.

    Parameters
    ----------
    series
        Chebyshev coefficients of the polynomial on [-1, 1].
    touching
        (k,) positions of extrema that are zero up to the error, from -1 to 1.
    error
        Bound of the error of the polynomial.
    """
    # `HALF_WIDTHS` are the widths that are tried, in rising order. The values at both ends
    # of each interval have the shape (half widths, k).
    widths_in_rows = HALF_WIDTHS[:, None]
    lower_values = chebyshev.chebval(touching - widths_in_rows, series)
    upper_values = chebyshev.chebval(touching + widths_in_rows, series)
    clear_size = CLEARLY_NONZERO_ERROR_RATIO * error
    may_be_zero = (np.abs(lower_values) <= clear_size) | (
        np.abs(upper_values) <= clear_size
    )
    has_clear_ends = ~may_be_zero
    has_clear_ends[-1] = True  # without clear ends, the widest interval is taken
    # `argmax` returns the first, and so the smallest, width with clear ends.
    half_widths = HALF_WIDTHS[np.argmax(has_clear_ends, axis=0)]
    return np.stack([touching - half_widths, touching + half_widths], axis=1)


def merge_intervals(intervals: Floats) -> Floats:
    """Return intervals (d, 2) in rising order, after merging those that overlap or touch.

    The common end of two touching intervals can differ by rounding. A gap between two
    intervals is therefore ignored if it is at most `MERGE_RATIO` times the length of the
    interval after the gap.
    """
    merged: list[tuple[float, float]] = []
    # The largest end of all intervals so far.
    furthest_stop = -np.inf
    for start, stop in intervals[np.argsort(intervals[:, 0])].tolist():
        tolerance = MERGE_RATIO * abs(stop - start)
        is_separate = start > furthest_stop + tolerance
        furthest_stop = max(furthest_stop, stop)
        if merged and not is_separate:
            start, _ = merged.pop()
        merged.append((start, furthest_stop))
    return np.array(merged).reshape(-1, 2)
