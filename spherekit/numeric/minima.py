"""Where a function of one variable, known by its values alone, is locally least."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats, Indices

Function = Callable[[Floats], Floats]
"""Values (n,) at places (n,)."""

RESOLVED = 0.02
"""A cubic polynomial that misses a value by less of its size says what lies between."""
HALVED = 2
"""Times that every cell of the grid is halved, whatever the polynomial says."""
DEEPEST = 9
NARROWER = 0.02
"""Half the width of the next bracket, in parts of the last, where a parabola is right."""
ROUNDS = 12
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
    low = (y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:]) & (y[1:-1] <= limit)
    low &= np.minimum(y[:-2], y[2:]) - y[1:-1] > FLAT * y[1:-1]
    (at,) = np.nonzero(low)
    rows = np.stack([at, at + 1, at + 2])
    return _narrowed(function, x[rows], y[rows], 1e-9 * (grid[-1] - grid[0]))


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
        error = np.abs(_cubic(x, y, cells, middle) - value)
        again = (error > RESOLVED * value) | (depth < HALVED)
        new = np.searchsorted(x, middle)
        left = new + np.arange(len(new)) - 1
        x, y = np.insert(x, new, middle), np.insert(y, new, value)
        doubtful = np.zeros(len(x) - 1, dtype=bool)
        doubtful[left] = doubtful[left + 1] = again
    return x, y


def _cubic(x: Floats, y: Floats, cells: Indices, at: Floats) -> Floats:
    """Return the polynomials through the four values about cells, at a place in each."""
    count = min(4, len(x))
    first = np.clip(cells - 1, 0, len(x) - count)
    nodes = first[:, None] + np.arange(count)
    value = np.zeros(len(cells))
    for k in range(count):
        others = np.delete(nodes, k, axis=1)
        part = (at[:, None] - x[others]) / (x[nodes[:, [k]]] - x[others])
        value += y[nodes[:, k]] * np.prod(part, axis=1)
    return value


def _narrowed(
    function: Function, x: Floats, y: Floats, width: float
) -> tuple[Floats, Floats]:
    """Return the least value in each of k brackets (3, k), and where it is.

    About the vertex of the parabola through three places three more are looked at, and
    the least of all with its neighbours is the next bracket.
    """
    for _ in range(ROUNDS):
        wide = x[2] - x[0] > width
        if not np.any(wide):
            break
        a, b, c = x[:, wide]
        rise, fall = (y[2, wide] - y[1, wide]), (y[1, wide] - y[0, wide])
        with np.errstate(invalid="ignore", divide="ignore"):
            slopes = rise / (c - b), fall / (b - a)
            vertex = 0.5 * (a + b) - 0.5 * slopes[1] * (c - a) / (slopes[0] - slopes[1])
        beside = NARROWER * (c - a)
        vertex = np.where(np.isfinite(vertex), vertex, b)
        vertex = np.clip(vertex, a + 2.0 * beside, c - 2.0 * beside)
        new = np.stack([vertex - beside, vertex, vertex + beside])
        places = np.concatenate([x[:, wide], new])
        values = np.concatenate([y[:, wide], function(new.ravel()).reshape(new.shape)])
        order = np.argsort(places, axis=0)
        places, values = (np.take_along_axis(v, order, axis=0) for v in (places, values))
        least = 1 + np.nanargmin(values[1:-1], axis=0)
        rows = np.stack([least - 1, least, least + 1])
        x[:, wide] = np.take_along_axis(places, rows, axis=0)
        y[:, wide] = np.take_along_axis(values, rows, axis=0)
    return x[1], y[1]
