"""Configurations in which curves cross: the closure equations lose rank.

There the velocity equations have k > 1 independent solutions T. The configuration x solves
F(x) = 0 and l . J(x) T = 0 with every l that J loses there, and these equations are regular
where the second-order terms below are not degenerate. A motion x' = T y goes on to second
order if y . B y = 0 for B = T' (l . dJ/dx) T and every l with l J = 0: for k = 2 these are
the directions of no or two curves, for k = 3 of up to four (Keller 1977 calls them the
algebraic bifurcation equations).
"""

from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.rotation import all_finite, max_abs, unit_rows
from spherekit.positions.curve_segment import bordered_step
from spherekit.positions.linearisation import left_inverse
from spherekit.positions.loop_closure import Closure, newton
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS

NEARLY_NULL = 3e-3
"""Relative singular values below this may vanish at the crossing nearby."""
MOST_STEPS = 20
FAR = 0.05
"""The crossing lies within this (rad) of where a curve ended before it."""
MISSED = 1e-9
"""Configurations that miss closing and rank loss by more (rad) are not crossings."""
DEGENERATE = 1e-7
"""Second-order terms below this, relative, do not decide how many curves cross."""
ON_ALL = 1e-7
"""Unit vectors that miss all forms by less lie on them, and are one if that near."""
MOST_FLAT = 1e4
"""Where the inverse of their equations is larger, two common points may be one."""
RADIUS = 0.02
"""How far (rad) from a configuration points on the ways out of it are looked for."""
MOVES = 1e-4
"""Relative singular values of the velocity equations below this are motions here."""
SPREAD = 64
"""Directions of motion tried where second-order terms do not decide."""
SAME = 1e-6
"""Points (rad) nearer to each other than this part of the radius are one."""


class Crossing(NamedTuple):
    """A configuration where the closure equations lose rank.

    Attributes
    ----------
    values
        (variables,) rad.
    freedoms
        The variables less the rank of the velocity equations.
    tangents
        (assembly modes, variables) unit directions of the real curves through it, one sense
        of each.
    resolved
        Whether second-order terms say how many there are. If not, `tangents` is empty.
    miss
        By how much (rad) the loops stay open, or rank loss is missed. A mechanism whose
        sizes miss a crossing by less than rounding cannot be told from one with it.
    error
        Size (rad) of the last correction of `values`.
    """

    values: Floats
    freedoms: int
    tangents: Floats
    resolved: bool
    miss: float
    error: float


def crossing_near(closure: Closure, values: Floats) -> Crossing | None:
    """Return the crossing beside a configuration (variables,), None if there is none."""
    _, sizes, _ = np.linalg.svd(closure.at(values[None]).jacobian[0])
    rank = int(np.sum(sizes > NEARLY_NULL * sizes[0]))
    for freedoms in range(max(2, len(values) - rank), 1, -1):
        if crossing := _located(closure, values, freedoms):
            return crossing
    return None


def ways_out(closure: Closure, values: Floats) -> Floats:
    """Return closed configurations (n, variables) around one, on every way out of it.

    `values` (variables,) closes; where one curve passes there are two, one on each side.
    Each is `RADIUS` (rad) away in the variables. Where the configuration is part of
    a surface there is no end of them, and some are returned.
    """
    _, sizes, right = np.linalg.svd(closure.at(values[None]).jacobian[0])
    motions = right[int(np.sum(sizes >= MOVES * max(sizes[0], MOVES))) :]
    if not len(motions):
        return motions

    def change(here: Floats, _: Indices) -> Floats:
        away = here - values
        length = np.linalg.norm(away, axis=1)
        borders = away / length[:, None]
        return np.nan_to_num(bordered_step(closure.at(here), borders, RADIUS - length))

    start = values + RADIUS * _spread(len(motions)) @ motions
    start, _ = newton(change, start, MOST_STEPS, trust=0.5 * RADIUS)
    length = np.linalg.norm(start - values, axis=1)
    closed = closure.at(start).gap < CLOSURE_TOLERANCE
    closed &= np.abs(length - RADIUS) < SAME * RADIUS
    ways: list[Floats] = []
    for point in start[closed]:
        if all(max_abs(point - other) > SAME * RADIUS for other in ways):
            ways.append(point)
    return np.array(ways).reshape(-1, len(values))


def _spread(count: int) -> Floats:
    """Return unit vectors (n, count) spread over the sphere, the same ones every time."""
    return unit_rows(np.random.default_rng(20240616).normal(size=(SPREAD, count)))


def _located(closure: Closure, start: Floats, freedoms: int) -> Crossing | None:
    """Solve F = 0 and l . J t = 0, for all l and t that J loses, by Gauss and Newton."""
    x, rank, error, settled = start.copy(), len(start) - freedoms, np.inf, False
    for turn in range(MOST_STEPS + 1):
        at = closure.at(x[None])
        jacobian, residual = at.jacobian[0], at.residual[0]
        left, sizes, right = np.linalg.svd(jacobian)
        lost, null = left[:, rank:], right[rank:]
        bends = np.einsum("bma,ml,ka->lkb", jacobian_rates(closure, x), lost, null)
        if settled or turn == MOST_STEPS:
            break
        matrix = np.concatenate([jacobian, bends.reshape(-1, len(x))])
        rest = np.append(residual, lost.T @ jacobian @ null.T)
        step = np.linalg.lstsq(matrix, -rest, rcond=1e-12)[0]
        before, error = error, float(max_abs(step))
        x = x + step
        if not all_finite(x) or max_abs(x - start) > FAR:
            return None
        settled = error < 4.0 * EPS or (error < 1e-11 and error > 0.25 * before)
    miss = float(max_abs(np.append(residual, sizes[rank:])))
    if miss > MISSED or error > 1e-6:
        return None
    forms = bends @ null.T
    tangents = _directions(0.5 * (forms + np.swapaxes(forms, 1, 2)))
    along = np.zeros((0, len(x))) if tangents is None else tangents @ null
    return Crossing(x, freedoms, along, tangents is not None, miss, error)


def jacobian_rates(closure: Closure, values: Floats) -> Floats:
    """Return dJ/dx (variables, 3 loops, variables), the first index that of x.

    Each variable moves alone, the loops not closed.
    """
    count, tree = len(values), closure.tree
    at = closure.at(np.tile(values, (count, 1)))
    first = at.body_rates(np.eye(count))[:, tree.firsts]
    second = first.copy()
    every = np.arange(count)
    second[every, list(tree.owners)] += at.vectors[every, every]
    return tree.jacobian(at.pair_rates(first, second))


def _directions(forms: Floats) -> Floats | None:
    """Return unit vectors (assembly modes, k) on which all forms vanish, None if undecided.

    Equations that repeat others give forms that vanish or repeat others.
    """
    size = forms.shape[1]
    upper = np.triu_indices(size)
    if not len(forms):
        return None
    _, sizes, right = np.linalg.svd(forms[:, *upper])
    if sizes[0] < DEGENERATE or size not in (2, 3):
        return None
    if np.sum(sizes > DEGENERATE * sizes[0]) != size - 1:
        return None
    kept = np.zeros((size - 1, size, size))
    kept[:, *upper] = right[: size - 1]
    kept[:, upper[1], upper[0]] = kept[:, *upper]
    return _common(kept)


def _common(forms: Floats) -> Floats | None:
    """Return the common points of k - 1 forms (k - 1, k, k), unit vectors (n, k).

    Newton's method leads to each from vectors spread over the sphere. None where two points
    are one, or nearly.
    """
    y = _spread(forms.shape[1])
    for _ in range(MOST_STEPS):
        slopes = np.einsum("fij,nj->nfi", forms, y)
        rest = np.append(np.sum(slopes * y[:, None], axis=2), np.zeros((len(y), 1)), axis=1)
        inverse = left_inverse(np.concatenate([2.0 * slopes, y[:, None]], axis=1))
        y = unit_rows(y - (inverse @ rest[..., None])[..., 0])
    points: list[Floats] = []
    for point, off, flat in zip(
        y, max_abs(rest, axis=1), np.linalg.norm(inverse, axis=(1, 2)), strict=True
    ):
        if off < ON_ALL and not flat < MOST_FLAT:
            return None
        if off < ON_ALL and all(abs(point @ other) < 1.0 - ON_ALL for other in points):
            points.append(point)
    return np.array(points).reshape(-1, len(y[0]))
