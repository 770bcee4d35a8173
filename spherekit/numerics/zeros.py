"""All zeros of a smooth function of one variable whose derivative is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.tolerances import EPS

DifferentiableFunction = Callable[[Floats], tuple[Floats, Floats]]
"""Takes positions (n,); returns the values (n,) and the derivatives (n,) at them."""

MAX_ZERO_CELL_HALVINGS = 8
"""Halvings of a grid cell, after which it is assumed to contain one extremum at most.

Smaller: close zeros can be missed. Larger: more function values near zeros of high order.
"""

DOUBLE_ZERO_RATIO = 1e-14
"""Extrema smaller than this, relative to the largest value on the grid, are double zeros.

Larger: two close zeros are reported as one double zero. Smaller: a double zero is lost, or
reported as two zeros, because of rounding.
"""

SAME_ZERO_RATIO = 1e-10
"""Zeros whose distance is less than this fraction of the range are the same zero."""

EXACT_ZERO_RATIO = 1e-13
"""Values below this fraction of the limit for double zeros count as exactly zero."""


@dataclass(frozen=True)
class Zeros:
    """Zeros of a function of one variable.

    Attributes
    ----------
    places
        (k,) positions in rising order.
    double
        (k,) whether the function only touches zero at the position, without a change of its
        sign (a double zero).
    """

    places: Floats
    double: Bools

    @staticmethod
    def merge(places: Floats, double: Bools, gap: float) -> "Zeros":
        """Return zeros in rising order, but only the first one of close zeros.

        A zero is left out if it is at most `gap` above the previous one, even if that one
        is left out too. For example, with the gap 0.15, the zeros 1.0, 1.1, 1.2 and 1.5
        become 1.0 and 1.5. Simple and double zeros are treated alike.

        Parameters
        ----------
        places
            (k,) positions of the zeros in any order.
        double
            (k,) whether the function only touches zero there.
        gap
            Largest distance of neighbouring zeros that count as one.
        """
        order = np.argsort(places, kind="stable")
        places = places[order]
        double = double[order]
        is_new = np.diff(places, prepend=-np.inf) > gap
        return Zeros(places[is_new], double[is_new])

    def merge_seam(self, period: float) -> "Zeros":
        """Return the zeros of a periodic function in [0, period), each only once.

        Both ends of the range are the same point, the seam. A zero there may have been
        found near 0, near the period, or near both, but is reported only once. A zero found
        near 0 keeps its position. A zero found only near the period is moved to 0.

        For example, with the period 360 and zeros at 1e-9, 90 and 360, those at 1e-9 and 90
        remain.
        """
        seam_width = SAME_ZERO_RATIO * period
        first_place = np.min(self.places, initial=seam_width)
        has_zero_at_start = first_place < seam_width
        seam_position = first_place if has_zero_at_start else 0.0
        # Zeros near the period are moved to the seam position. `merge` keeps the first of
        # several zeros there.
        is_at_end = self.places > period - seam_width
        places = np.where(is_at_end, seam_position, self.places)
        return Zeros.merge(places, self.double, seam_width)


@dataclass(frozen=True)
class _EndZero:
    """A zero at an end of the range of a function.

    `find_zeros` adds it to the zeros inside the range. Rounding errors can produce false
    zeros near the end, which are removed.

    Attributes
    ----------
    position
        The end of the range.
    is_double
        Whether the function only touches zero at the end, with a slope of about zero.
    spurious_distance
        Other zeros within this distance from the end are removed. They are due to rounding,
        or they are the zero at the end, found a second time.
    """

    position: float
    is_double: bool
    spurious_distance: float


def find_zeros(function: DifferentiableFunction, grid: Floats) -> Zeros:
    """Return all zeros of a function on the range of a grid.

    In each cell the function is approximated by its cubic Hermite polynomial, whose error
    is measured at the middle. A cell is halved until this polynomial has no zero or is
    monotone.

    Parameters
    ----------
    function
        Values and derivatives at positions.
    grid
        (n,) rising positions. The cells must be small enough for a cubic polynomial to
        resemble the function. A structure that is much narrower than a cell is not seen.

    Returns
    -------
    The zeros in rising order. Two close zeros count as one double zero if the function
    between them is nearly 0: smaller than `DOUBLE_ZERO_RATIO` times its largest value on
    the grid.
    """
    values, slopes = function(grid)
    tiny = np.finfo(float).tiny
    floor = DOUBLE_ZERO_RATIO * float(np.max(np.abs(values))) + tiny
    # The columns of `cells` are the grid cells. The rows are the ends a and b, the values
    # at a and b, and the slopes at a and b. The first four rows of a cell are a bracket: an
    # interval in which the function counts as monotone.
    cells = np.stack(
        [grid[:-1], grid[1:], values[:-1], values[1:], slopes[:-1], slopes[1:]]
    )
    brackets: list[Floats] = []
    for _ in range(MAX_ZERO_CELL_HALVINGS):
        cells, error = _halve_cells(function, cells)
        is_empty, is_monotone = _classify_cells(cells, error + floor)
        # Cells without a zero are dropped, monotone cells are brackets, and the remaining
        # ones are halved again.
        brackets.append(cells[:4, is_monotone & ~is_empty])
        cells = cells[:, ~is_empty & ~is_monotone]
        if not cells.size:
            break

    # The remaining cells contain one extremum or none. The slope changes its sign at an
    # extremum. A cell is cut there, unless the extremum is a double zero.
    slopes_of_cells = cells[4:]
    has_extremum = _change_sign(*slopes_of_cells)
    brackets.append(cells[:4, ~has_extremum])
    a, b, value_a, value_b, slope_a, slope_b = cells[:, has_extremum]
    extrema, _ = find_bracketed_zeros(lambda x, _: function(x)[1], a, b, slope_a, slope_b)
    extreme_values, _ = function(extrema)
    is_nonzero = np.abs(extreme_values) > floor
    left_parts = np.stack([a, extrema, value_a, extreme_values])
    right_parts = np.stack([extrema, b, extreme_values, value_b])
    brackets.append(left_parts[:, is_nonzero])
    brackets.append(right_parts[:, is_nonzero])
    double_zeros = extrema[~is_nonzero]

    def flattened_function(x: Floats, _: Indices) -> Floats:
        """Return the values at positions, with tiny ones replaced by zero."""
        # Near a zero of high order the function is below the rounding errors in a wide
        # range, and no bracket would become narrow. Such values count as exactly zero.
        value = function(x)[0]
        return np.where(np.abs(value) < EXACT_ZERO_RATIO * floor, 0.0, value)

    # The function counts as monotone in a bracket, so a change of sign is a single zero.
    a, b, value_a, value_b = np.concatenate(brackets, axis=1)
    changes = _change_sign(value_a, value_b)
    simple_zeros, _ = find_bracketed_zeros(
        flattened_function,
        a[changes],
        b[changes],
        value_a[changes],
        value_b[changes],
        tolerance=EPS,
    )

    places = np.concatenate([double_zeros, simple_zeros])
    double = np.arange(len(places)) < len(double_zeros)
    return _add_end_zeros(places, double, grid, values, slopes, floor)


def _classify_cells(cells: Floats, margin: Floats) -> tuple[Bools, Bools]:
    """Find the cells that contain no zero, and the cells with a monotone function.

    In both cases the cell is not divided further: it has no zero, or at most one. In each
    cell the function is approximated by a cubic polynomial in Bernstein form, with four
    coefficients. The values of the polynomial are between the smallest and the largest
    coefficient. The polynomial is monotone if the coefficients rise or fall throughout.

    Parameters
    ----------
    cells
        (6, n) rows: the two ends of each cell, the values at both ends, and the slopes at
        both ends.
    margin
        (n,) bound of the difference between polynomial and function. Coefficients, and
        steps from one to the next, must exceed this bound.

    Returns
    -------
    is_empty
        (n,) whether the cell contains no zero.
    is_monotone
        (n,) whether the polynomial clearly rises or falls throughout the cell, so that the
        function is taken to have at most one zero.
    """
    # The outer Bernstein coefficients are the values at the ends. The inner ones follow
    # from the slopes.
    a, b, value_a, value_b, slope_a, slope_b = cells
    third = (b - a) / 3.0
    coefficients = np.stack(
        [value_a, value_a + third * slope_a, value_b - third * slope_b, value_b]
    )
    differences = np.diff(coefficients, axis=0)
    is_empty = np.all(coefficients > margin, axis=0) | np.all(
        coefficients < -margin, axis=0
    )
    is_monotone = np.all(differences > margin, axis=0) | np.all(
        differences < -margin, axis=0
    )
    return is_empty, is_monotone


def _add_end_zeros(
    places: Floats,
    double: Bools,
    grid: Floats,
    values: Floats,
    slopes: Floats,
    floor: float,
) -> Zeros:
    """Return the zeros inside a range together with those at its two ends.

    Near a zero at an end, the function is within its rounding errors, which may have
    produced false zeros. These are removed in favour of the zero at the end. If the
    function only touches zero there, like a parabola, this is a double zero (a zero without
    a change of sign).

    Parameters
    ----------
    places, double
        (k,) positions of the zeros inside the range, in any order, and whether they are
        double.
    grid, values, slopes
        (n,) positions at which the function was evaluated, its values and its derivatives.
    floor
        Values up to this size count as zero.
    """
    # Second derivatives at both ends, from differences of the slopes.
    first_curvature = (slopes[1] - slopes[0]) / (grid[1] - grid[0])
    last_curvature = (slopes[-1] - slopes[-2]) / (grid[-1] - grid[-2])
    possible_zeros = (
        _find_end_zero(grid[0], values[0], slopes[0], first_curvature, floor),
        _find_end_zero(grid[-1], values[-1], slopes[-1], last_curvature, floor),
    )
    end_zeros = [zero for zero in possible_zeros if zero is not None]
    is_spurious = np.zeros(len(places), dtype=bool)
    for zero in end_zeros:
        distance = np.abs(places - zero.position)
        is_spurious |= distance <= zero.spurious_distance
    is_double_end_zero = np.array([zero.is_double for zero in end_zeros], dtype=bool)
    # A zero found both inside and at an end is reported once.
    return Zeros.merge(
        np.append(places[~is_spurious], [zero.position for zero in end_zeros]),
        np.append(double[~is_spurious], is_double_end_zero),
        SAME_ZERO_RATIO * (grid[-1] - grid[0]),
    )


def _find_end_zero(
    position: float, value: float, slope: float, curvature: float, floor: float
) -> _EndZero | None:
    """Return the zero of a function at an end of its range, None if there is none.

    Near the end the function is approximated by a parabola, which shows whether the
    function crosses zero or only touches it (double zero). Near a zero at the end,
    rounding can produce false ("spurious") zeros. The result has the distance up to which
    such zeros occur.

    Parameters
    ----------
    position
        The end of the range.
    value, slope, curvature
        The function and its first and second derivative at the end.
    floor
        Values up to this size count as zero.
    """
    is_zero = np.abs(value) <= floor
    if not is_zero:
        return None
    # The two tests below need only the absolute values of slope and curvature.
    parabola = EndParabola(np.abs(slope), np.abs(curvature))
    if not parabola.has_double_zero(floor):
        # The zero is simple, so slope^2 > 2 floor curvature. A parabola for which this is
        # true reaches the value `floor` within the distance 2 floor / slope.
        return _EndZero(
            position, is_double=False, spurious_distance=2.0 * floor / abs(slope)
        )
    spurious_distance = parabola.max_distance_of_spurious_zeros(floor)
    return _EndZero(position, is_double=True, spurious_distance=spurious_distance)


@dataclass(frozen=True)
class EndParabola:
    """A parabola that approximates a function near an end of its range where it is zero.

    The parabola shows whether the function only touches zero there (double zero). Near a
    double zero, rounding errors can produce false zeros. Values count as zero up to a size
    that the methods call `floor`. The signs of slope and curvature are not used: the
    methods assume opposite signs, with which the parabola returns to zero.

    Attributes
    ----------
    slope, curvature
        Absolute values of the first and the second derivative at the end.
    """

    slope: float
    curvature: float

    def has_double_zero(self, floor: float) -> bool:
        """Return whether the parabola only touches zero near the end.

        The values of the parabola at its extremum and at the end differ by
        slope^2 / (2 curvature). The parabola counts as touching zero if this difference is
        at most `floor`, the size up to which values count as zero.
        """
        # Square roots are compared, because the square of the slope may overflow.
        return bool(self.slope <= np.sqrt(2.0 * floor) * np.sqrt(self.curvature))

    def max_distance_of_spurious_zeros(self, floor: float) -> float:
        """Return the distance from the end within which values can count as zero.

        Zeros found at smaller distances may be caused by rounding. Values count as zero up
        to the size `floor`. At the distance t the parabola is c t^2 / 2 - s t, with the
        curvature c and the slope s. It falls below zero first, and then rises to `floor` at
        t = (s + sqrt(s^2 + 2 floor c)) / c.
        """
        root = np.hypot(self.slope, np.sqrt(2.0 * floor) * np.sqrt(self.curvature))
        # The smallest positive number avoids a division by 0 for a straight line.
        return float((self.slope + root) / max(self.curvature, np.finfo(float).tiny))


def _halve_cells(function: DifferentiableFunction, cells: Floats) -> tuple[Floats, Floats]:
    """Return the halves of cells, and the error of the cubic polynomial in each cell.

    In each cell the function is approximated by its Hermite polynomial, the cubic with the
    values and slopes of the function at both ends. The function is evaluated in the middle,
    which also shows the error of the polynomial.

    Parameters
    ----------
    function
        Returns the values and derivatives at positions.
    cells
        (6, n) rows: ends a and b, values at a and b, slopes at a and b.

    Returns
    -------
    halves
        (6, 2 n) the left halves of all cells, then the right halves.
    error
        (2 n,) for each half, the error at the middle of the cell from which it comes.
    """
    a, b, value_a, value_b, slope_a, slope_b = cells
    middle = 0.5 * (a + b)
    value, slope = function(middle)
    # In the middle of a cell of width h the polynomial is
    # (f_a + f_b) / 2 + h (f_a' - f_b') / 8.
    hermite_value = 0.5 * (value_a + value_b) + (b - a) * (slope_a - slope_b) / 8.0
    error = np.abs(hermite_value - value)
    left = np.stack([a, middle, value_a, value, slope_a, slope])
    right = np.stack([middle, b, value, value_b, slope, slope_b])
    return np.concatenate([left, right], axis=1), np.tile(error, 2)


def _change_sign(first: Floats, second: Floats) -> Bools:
    """Return whether one of two numbers is negative and the other one is not."""
    return (first >= 0.0) != (second >= 0.0)
