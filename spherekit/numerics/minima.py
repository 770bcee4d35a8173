"""Local minima of functions of one variable of which only values are known."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats

Function = Callable[[Floats], Floats]
"""Takes positions (n,) and returns the values (n,) at them."""

FRACTIONS = np.linspace(0.0, 1.0, 17)[:, None]
"""(17, 1) positions in a cell or bracket that are sampled, as fractions of its width.

The first one is 0 and the last one is 1. The next bracket is the neighbourhood of the
smallest sample, an eighth of the width. More fractions: minima in a cell are less easily
missed, with more function values.
"""

BRACKET_RATIO = 1e-9
"""Width of a final bracket, as a fraction of the range.

Near a minimum the value changes with the square of the distance. A smaller bracket would
therefore only show rounding errors.
"""

LEAST_BRACKET_SPACINGS = 2.0
"""Width of the narrowest bracket, as a multiple of the distance of floating-point numbers.

Larger: positions far from zero are less accurate. Smaller: a bracket may have no number
between its ends, so that it is not narrowed further and the search does not end.
"""

MIN_DEPTH_RATIO = 1e-9
"""A minimum must be lower, by this part of its value, than a sample among two on each side.

Smaller: rounding errors of a constant function become minima.
"""


def find_local_minima(
    function: Function, grid: Floats, limit: float = np.inf
) -> tuple[Floats, Floats]:
    """Return the local minima of a function inside a range, from its values only.

    The function is sampled finely. Each sample that is smaller than both neighbours
    brackets a minimum, which is then refined.

    Parameters
    ----------
    function
        A smooth function that is never negative; NaN where it has no value. It takes
        positions (n,) and returns values (n,).
    grid
        (n,) rising positions from one end of the range to the other. The cells between them
        must be so small that the function has a simple shape in each.
    limit
        A minimum is left out if the smallest sample near it is above this value.

    Returns
    -------
    positions, values
        (k,) positions of the minima in rising order, and the values of the function at
        them.
    """
    # All cells are sampled at `FRACTIONS` (fractions, 1) of their width, from 0 to 1. The
    # end of a cell is the start of the next one, so the last fraction is left out.
    starts = grid[:-1]
    widths = np.diff(grid)
    inner = starts + widths * FRACTIONS[:-1]  # (fractions, cells)
    # All samples in rising order: cell by cell, and then the end of the range.
    x = np.append(inner.T.ravel(), grid[-1])
    y = function(x)
    before = y[:-2]
    center = y[1:-1]
    after = y[2:]
    # Three successive samples with the smallest in the middle are a bracket of a minimum.
    # Comparisons with NaN are false.
    is_minimum = (center < before) & (center <= after) & (center <= limit)
    # A minimum has to be deeper than the rounding errors of a constant function. On each
    # side, its depth is measured against the higher one of the two nearest samples. One
    # sample is not enough: if a minimum is midway between two samples, these are equal.
    higher_before = np.fmax(before, np.append(y[0], y[:-3]))
    higher_after = np.fmax(after, np.append(y[3:], y[-1]))
    depth = np.minimum(higher_before, higher_after) - center
    is_minimum &= depth > MIN_DEPTH_RATIO * center
    (index,) = np.nonzero(is_minimum)
    # `center` begins with the second sample, so the smallest sample is `index + 1` in `x`.
    # Its neighbours, `index` and `index + 2`, are the ends of the bracket.
    positions = minimize_in_brackets(
        function,
        low=x[index],
        high=x[index + 2],
        width=BRACKET_RATIO * (grid[-1] - grid[0]),
    )
    return positions, function(positions)


def minimize_in_brackets(
    function: Function, low: Floats, high: Floats, width: float = 1e-14
) -> Floats:
    """Return the position (n,) of the smallest value in each of n brackets.

    A bracket is an interval that contains one local minimum. All brackets are sampled. Each
    is then narrowed to the samples next to its smallest sample, until all are narrow
    enough.

    Parameters
    ----------
    function
        A function with one local minimum in each bracket. NaN counts as infinite.
    low, high
        (n,) ends of the brackets.
    width
        The brackets are narrowed until none is wider than this, or than
        `LEAST_BRACKET_SPACINGS` times the distance of neighbouring floating-point numbers.
    """
    brackets = np.arange(len(low))
    # The spacing of the floating-point numbers is largest at the end with the larger size.
    spacing = np.spacing(np.maximum(np.abs(low), np.abs(high)))
    width_limits = np.maximum(width, LEAST_BRACKET_SPACINGS * spacing)
    while np.any(high - low > width_limits):
        # (fractions, n) samples in all brackets. `FRACTIONS` is a column (fractions, 1) of
        # numbers from 0 to 1.
        positions = low + (high - low) * FRACTIONS
        values = function(positions.ravel()).reshape(positions.shape)
        smallest = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
        # The new bracket ends at the neighbours of the smallest sample, or at this sample
        # itself if it is an end of the bracket.
        low = positions[np.maximum(smallest - 1, 0), brackets]
        high = positions[np.minimum(smallest + 1, len(FRACTIONS) - 1), brackets]
    return 0.5 * (low + high)
