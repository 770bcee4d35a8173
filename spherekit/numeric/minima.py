"""Where a function of one variable, known by its values alone, is locally least."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats

Function = Callable[[Floats], Floats]
"""Values (n,) at places (n,)."""

RESOLVED = 0.02
"""A cubic polynomial that misses a value by less of its size says what lies between."""
HALVED = 2
"""Times that every cell of the grid is halved, whatever the polynomial says."""
DEEPEST = 9
PARTS = np.linspace(0.0, 1.0, 17)[:, None]
"""Places in a bracket that are looked at for the next one, about the least of them."""
KNOWN = 1e-9
"""Brackets as narrow, in parts of the range, hold the place well enough."""
FLAT = 1e-9
"""Minima that are lower than what is beside them by less of their size are none."""


def minima(
    function: Function, grid: Floats, limit: float = np.inf
) -> tuple[Floats, Floats]:
    """Return the places (k,) within a range at which a function is locally least, and it.

    Parameters
    ----------
    function
        Not negative and smooth; NaN where it has no value.
    grid
        (n,) rising: its cells are halved until cubic polynomials through four values
        predict the fifth.
    limit
        Minima above are left out.
    """
    x, y = _resolved(function, grid)
    deep = (y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:]) & (y[1:-1] <= limit)
    deep &= np.minimum(y[:-2], y[2:]) - y[1:-1] > FLAT * y[1:-1]
    (at,) = np.nonzero(deep)
    places = least_within(function, x[at], x[at + 2], KNOWN * (grid[-1] - grid[0]))
    return places, function(places)


def least_within(
    function: Function, low: Floats, high: Floats, narrow: float = 1e-14
) -> Floats:
    """Return where a function is least in brackets (n,), which are cut until narrow."""
    at = np.arange(len(low))
    while np.any(high - low > narrow):
        places = low + (high - low) * PARTS
        values = function(places.ravel()).reshape(places.shape)
        best = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
        low = places[np.maximum(best - 1, 0), at]
        high = places[np.minimum(best + 1, len(PARTS) - 1), at]
    return 0.5 * (low + high)


def _resolved(function: Function, grid: Floats) -> tuple[Floats, Floats]:
    """Return places and values between which cubic polynomials predict the function."""
    x, y = grid, function(grid)
    doubtful = np.ones(len(x) - 1, dtype=bool)
    for depth in range(DEEPEST):
        (cells,) = np.nonzero(doubtful)
        if not len(cells):
            break
        middle = 0.5 * (x[cells] + x[cells + 1])
        value = function(middle)
        count = min(4, len(x))
        nodes = np.clip(cells - 1, 0, len(x) - count)[:, None] + np.arange(count)
        gaps = x[nodes][:, :, None] - x[nodes][:, None]
        parts, other = np.ones_like(gaps), ~np.eye(count, dtype=bool)
        np.divide((middle[:, None] - x[nodes])[:, None], gaps, out=parts, where=other)
        error = np.abs(np.vecdot(y[nodes], np.prod(parts, axis=2)) - value)
        again = (error > RESOLVED * value) | (depth < HALVED)
        new = np.searchsorted(x, middle)
        left = new + np.arange(len(new)) - 1
        x, y = np.insert(x, new, middle), np.insert(y, new, value)
        doubtful = np.zeros(len(x) - 1, dtype=bool)
        doubtful[left] = doubtful[left + 1] = again
    return x, y
