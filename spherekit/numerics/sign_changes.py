"""All changes of sign of an analytic function of one variable, its derivative unknown.

The range is cut into cells until a Chebyshev polynomial of known degree is the function
to a small part of its largest value in the cell, as far as its last coefficients and
samples between its nodes tell (the way of L. N. Trefethen, Approximation Theory and
Approximation Practice, 2013, chapter 18: the zeros of the polynomial are eigenvalues).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Floats
from spherekit.numerics.bracketed_zeros import bracketed_zeros
from spherekit.numerics.chebyshev import real_zeros, sampled, trimmed

DEGREE = 32
FIRST = np.array([0.0, 0.2371, 0.4918, 0.7653, 1.0])
"""Parts of the range that bound the first cells: a zero in a round place is at no edge."""
DEEPEST = 12
"""Halvings of a cell before it is given up."""
BARREN = 2
"""Halvings of a cell that made no part of it clear before it is given up: what a function
is not smooth in, such as its own rounding, does not get clearer."""
MOST_CELLS = 400
POLISHING_STEPS = 3
MOVED = 1e-3
"""A zero of a polynomial is not farther than this from that of the function."""
TOGETHER = 1e-6
"""Doubtful parts whose distance is less, over their length, are one."""
FITTED = 1e-8
"""Largest error of a polynomial, over the largest value in its cell."""
CERTAIN = 4.0
"""An extremum is not zero if it is so many times larger than the error."""
ROUNDING_ONLY = 1e-13
"""A polynomial whose error, over the largest value in its cell, is smaller than this is off
by rounding only. Halving its cell then does not tell more of an extremum near zero."""
REACHES = 2.0 * np.logspace(-10.0, 0.0, 61)
"""Half widths, in half cells, that a doubtful part about an extremum may have."""
TAIL = 4
"""Last coefficients that show the error of the polynomial."""
BEYOND = 1e-2
"""Extrema so little beyond a cell, in half cells, are looked at from both sides."""

_CHECKED = np.linspace(-1.0, 1.0, 6)[:, None]
"""Places in a cell, -1 to 1, at which the polynomial is compared with the function."""


def crossings(
    function: Callable[[Floats], Floats],
    low: float,
    high: float,
    most: int = MOST_CELLS,
    smooth: float = np.inf,
) -> tuple[Floats, Floats]:
    """Return where a function (n,) -> (n,) changes its sign, and where that is left open.

    The places (k,) from `low` to `high` rise. The others (d, 2) are first and last places
    of extrema that are zero to the error of the function, and of cells in which it is not
    known or not smooth, as where samples are NaN. A pair of zeros is found if the
    function between them is larger than its error there. No more than about `most` cells
    of 39 samples are looked at. In a cell no wider than `smooth` the function, if it is
    smooth there, is well given by so many samples.
    """
    edges = low + (high - low) * FIRST
    cells = np.stack([edges[:-1], edges[1:]], axis=1)
    roots: list[list[Floats]] = []
    doubtful: list[Floats] = []
    looked, barren = 0, np.zeros(len(cells), dtype=int)
    # The error that was measured by chance at few places of a narrow cell may be too small.
    # The extremum of a double zero then seems to differ from zero. So a cell inherits it.
    inherited = np.zeros(len(cells))
    for depth in range(DEEPEST + 1):
        looked += len(cells)
        middle = cells.mean(axis=1)
        half = 0.5 * (cells[:, 1] - cells[:, 0])
        of_cells = sampled(lambda x: function(x[:, 0]), cells[..., None], DEGREE, _CHECKED)
        contents = [*map(_in_cell, *of_cells, inherited)]
        again = np.array([x.halving_helps for x in contents]) & (barren < BARREN)
        again &= depth < DEEPEST and looked + 2 * len(cells) <= most
        for number in np.flatnonzero(~again):
            content = contents[number]
            zeros = middle[number] + half[number] * content.zeros
            roots.append([zeros, content.slopes / half[number]])
            doubtful.append(middle[number] + half[number] * content.doubtful)
        if not np.any(again):
            break
        if depth:  # cells are halves, two and two of one
            both = np.repeat(again.reshape(-1, 2).all(axis=1), 2) & (2.0 * half <= smooth)
            barren = (barren + 1) * both
        barren = np.repeat(barren[again], 2)
        errors = np.array([content.rounding_error for content in contents])
        inherited = np.repeat(np.maximum(inherited, errors)[again], 2)
        cells = np.insert(cells[again], [1, 1], middle[again, None], axis=1).reshape(-1, 2)
    places, slopes = np.concatenate(roots, axis=1)
    parts = _merged(np.concatenate(doubtful))
    # Changes of sign beside an extremum that is zero to the error are not known to be any.
    within = (parts[:, :1] <= places) & (places <= parts[:, 1:])
    is_known = ~np.any(within, axis=0)
    places, slopes = places[is_known], slopes[is_known]
    for _ in range(POLISHING_STEPS if len(places) else 0):
        with np.errstate(all="ignore"):
            step = -function(places) / slopes
        places = places + np.where(np.abs(step) < MOVED, step, 0.0)
    return np.clip(np.sort(places), low, high), np.clip(parts, low, high)


class _CellContent(NamedTuple):
    """What a function has in a cell, which is [-1, 1] here.

    `zeros` (k,) with the `slopes` (k,) there, and `doubtful` parts (d, 2). `halving_helps`
    says that halves of the cell may tell more of these. `rounding_error` is the error of
    the polynomial where that is rounding only, else 0.
    """

    zeros: Floats
    slopes: Floats
    doubtful: Floats
    halving_helps: bool
    rounding_error: float


NONE = np.zeros(0)
NO_PARTS = np.zeros((0, 2))


def _in_cell(series: Floats, gap: Floats, largest: float, inherited: float) -> _CellContent:
    """Return what a function has in a cell.

    Parameters
    ----------
    series
        (degree + 1, 1) its Chebyshev series.
    gap
        How far the series is from the function at some places.
    largest
        The largest value in the cell.
    inherited
        The rounding error that was measured in wider cells.
    """
    series = series[:, 0]
    error = max(np.max(gap), np.max(np.abs(series[-TAIL:])))
    if not error <= FITTED * largest or not largest:
        return _CellContent(NONE, NONE, np.array([[-1.0, 1.0]]), True, 0.0)
    is_rounding = error <= ROUNDING_ONLY * largest
    rounding_error = error if is_rounding else 0.0
    error = max(error, inherited)
    series = trimmed(series, 1e-3 * error)
    if abs(series[0]) > np.sum(np.abs(series[1:])) + CERTAIN * error:
        return _CellContent(NONE, NONE, NO_PARTS, False, rounding_error)
    slope = np.asarray(chebyshev.chebder(series), dtype=float)
    extrema = real_zeros(slope, 1.0 + BEYOND)
    touching = extrema[np.abs(chebyshev.chebval(extrema, series)) <= CERTAIN * error]
    # A zero of higher order is flat, and doubtful the farther.
    around = touching + np.multiply.outer([-1.0, 1.0], REACHES)[..., None]
    is_zero = np.abs(chebyshev.chebval(around, series)) <= 4.0 * CERTAIN * error
    ends_there = ~np.any(is_zero, axis=0)
    ends_there[-1] = True
    reach = REACHES[np.argmax(ends_there, axis=0)]
    cuts = np.unique([-1.0, *np.clip(extrema, -1.0, 1.0), 1.0])
    values = chebyshev.chebval(cuts, series)
    (part,) = np.nonzero((values[:-1] >= 0.0) != (values[1:] >= 0.0))
    places, _ = bracketed_zeros(
        lambda x, _: np.asarray(chebyshev.chebval(x, series), dtype=float),
        cuts[part],
        cuts[part + 1],
        values[part],
        values[part + 1],
    )
    return _CellContent(
        places,
        np.asarray(chebyshev.chebval(places, slope), dtype=float),
        np.stack([touching - reach, touching + reach], axis=1),
        len(touching) > 0 and not is_rounding,
        rounding_error,
    )


def _merged(parts: Floats) -> Floats:
    """Return parts (d, 2) of a line in order, those that touch as one."""
    start, stop = parts[np.argsort(parts[:, 0])].T
    reach = np.maximum.accumulate(stop)
    new = np.ones(len(parts), dtype=bool)
    new[1:] = start[1:] > reach[:-1] + TOGETHER * np.abs(stop - start)[1:]
    return np.stack([start[new], reach[np.roll(new, -1)]], axis=1)
