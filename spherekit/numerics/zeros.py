"""All zeros of a smooth function of one variable whose derivative is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.numerics.bracketed_zeros import bracketed_zeros
from spherekit.tolerances import EPS

Function = Callable[[Floats], tuple[Floats, Floats]]
"""Values and derivatives (n,) at places (n,)."""

DEEPEST = 8
"""Halvings of a cell of the grid before it is taken to hold one extremum at most."""
TOUCHES = 1e-14
"""An extremum this near to zero, relative to the largest value, is a double zero."""
SAME = 1e-10
"""Zeros nearer to each other than this part of the range are one."""


ROUNDED = 1e-13
"""Where a function is below this part of what touches zero, it is zero."""


@dataclass(frozen=True)
class Zeros:
    """Places (k,) in rising order, and whether the function only touches zero there."""

    places: Floats
    double: Bools

    @staticmethod
    def apart(places: Floats, double: Bools, gap: float) -> "Zeros":
        """Return zeros in order, those nearer to the one before than a gap left out."""
        order = np.argsort(places, kind="stable")
        places, double = places[order], double[order]
        fresh = np.diff(places, prepend=-np.inf) > gap
        return Zeros(places[fresh], double[fresh])

    def once(self, length: float) -> "Zeros":
        """Return those of a lap of this length, one at its end as one at its start."""
        seam = SAME * length
        first = np.min(self.places, initial=seam)
        at_end = self.places > length - seam
        places = np.where(at_end, first if first < seam else 0.0, self.places)
        return Zeros.apart(places, self.double, seam)


def zeros(function: Function, grid: Floats) -> Zeros:
    """Return the zeros of a function on the range of a rising grid (n,).

    A cell of the grid is halved until its cubic Hermite polynomial, whose error is
    measured at the middle, has no zero, or is monotone. The grid has to be fine enough
    for that polynomial to mean something. Pairs of zeros that are too near to part
    (about the square root of `TOUCHES` times the scale of the bend) are a double one.
    """
    value, slope = function(grid)
    tiny = np.finfo(float).tiny
    floor = TOUCHES * float(np.max(np.abs(value))) + tiny
    cells = np.stack([grid[:-1], grid[1:], value[:-1], value[1:], slope[:-1], slope[1:]])
    parts: list[Floats] = []
    for _ in range(DEEPEST):
        cells, error = _halved(function, cells)
        a, b, fa, fb, da, db = cells
        third = (b - a) / 3.0  # by Bernstein's bounds
        control = np.stack([fa, fa + third * da, fb - third * db, fb])
        empty, monotone = (
            np.all(x > error + floor, axis=0) | np.all(x < -error - floor, axis=0)
            for x in (control, np.diff(control, axis=0))
        )
        parts.append(cells[:4, monotone & ~empty])
        cells = cells[:, ~empty & ~monotone]
        if not cells.size:
            break
    turning = _changes(*cells[4:])
    parts.append(cells[:4, ~turning])
    a, b, fa, fb, falls, rises = cells[:, turning]
    tops, _ = bracketed_zeros(lambda x, _: function(x)[1], a, b, falls, rises)
    top_value, _ = function(tops)
    apart = np.abs(top_value) > floor
    sides = np.stack([(a, tops, fa, top_value), (tops, b, top_value, fb)])
    parts += [*sides[:, :, apart]]
    tops = tops[~apart]
    a, b, fa, fb = np.concatenate(parts, axis=1)

    def near(x: Floats, _: Indices) -> Floats:
        there = function(x)[0]
        return np.where(np.abs(there) < ROUNDED * floor, 0.0, there)

    signed = _changes(fa, fb)
    simple, _ = bracketed_zeros(near, a[signed], b[signed], fa[signed], fb[signed], EPS)
    ends, rise = grid[[0, -1]], np.abs(slope[[0, -1]])
    edge = np.abs(value[[0, -1]]) <= floor
    bend = np.abs(np.diff(slope)[[0, -1]] / np.diff(grid)[[0, -1]])
    touched = edge & (rise**2 <= 2.0 * floor * bend)
    way = (rise + np.sqrt(rise**2 + 2.0 * floor * bend)) / np.maximum(bend, tiny)
    places = np.concatenate([tops, simple])
    far = np.all(~touched | (np.abs(places[:, None] - ends) > way), axis=1)
    double = np.append((np.arange(len(places)) < len(tops))[far], touched[edge])
    places = np.append(places[far], ends[edge])
    return Zeros.apart(places, double, SAME * (grid[-1] - grid[0]))


def _halved(function: Function, cells: Floats) -> tuple[Floats, Floats]:
    """Return both halves of cells, and how far their polynomials were from the middle.

    A cell (6, n) has its ends a, b, then the values at a and b, then the slopes.
    """
    a, b, fa, fb, da, db = cells
    middle = 0.5 * (a + b)
    value, slope = function(middle)
    error = np.abs(0.5 * (fa + fb) + (b - a) * (da - db) / 8.0 - value)
    left = np.stack([a, middle, fa, value, da, slope])
    right = np.stack([middle, b, value, fb, slope, db])
    return np.concatenate([left, right], axis=1), np.tile(error, 2)


def _changes(one: Floats, other: Floats) -> Bools:
    return (one >= 0.0) != (other >= 0.0)
