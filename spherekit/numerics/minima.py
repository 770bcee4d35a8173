"""Where functions of one variable, known by their values alone, are locally least."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats

Function = Callable[[Floats], Floats]
"""Values (n,) at places (n,)."""

PARTS = np.linspace(0.0, 1.0, 17)[:, None]
"""Places in a cell or bracket that are looked at, for the next one about the least."""
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
        (n,) rising, so dense that the function is simple in a cell.
    limit
        Minima above are left out.
    """
    inside = grid[:-1] + np.diff(grid) * PARTS[:-1]
    x = np.append(inside.T.ravel(), grid[-1])
    y = function(x)
    before, here, after = y[:-2], y[1:-1], y[2:]
    deep = (here < before) & (here <= after) & (here <= limit)
    (at,) = np.nonzero(deep & (np.minimum(before, after) - here > FLAT * here))
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
