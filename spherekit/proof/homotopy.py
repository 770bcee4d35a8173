"""Approximations of all solutions of a system at an input, by a homotopy.

Nothing here is proven: what is found is certified elsewhere, and counted there against
the number of solutions that the equations can have at most. The start equations are
products of linear factors of the same degrees, so they have just that number of solutions
(A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8), and the way from them to the equations of the mechanism avoids singular
systems but for unlucky random numbers.
"""

from dataclasses import replace
from functools import reduce
from itertools import permutations, product

import numpy as np

from spherekit.arrays import Complexes, Floats
from spherekit.proof.root_charts import ChartRoots, Polynomials, applied, inverses

MOST_STEPS = 600


FIRST_STEP, LEAST_STEP, LARGEST_STEP, LONGER = 0.02, 1e-7, 0.1, 1.2


TRUSTED = 3e-3
"""Largest correction of a predicted point, over its size: a neighbour's is farther."""


NEARLY = 0.9
"""Ways that come so far are of use: Newton's method in more digits goes on from there."""


SEEDS = 4
"""Ways tried: of four one nearly always misses nothing."""


@np.errstate(all="ignore")
def solutions(made: Polynomials, seed: int) -> ChartRoots:
    """Return approximations of a system's solutions at one input, infinite ones too.

    The ways from all solutions of products of lines, at t = 0, are followed; those are left
    out that do not come near.
    """
    ends, z = _product_of_lines(made, np.random.default_rng(seed))
    points = ChartRoots.of(z, np.zeros(len(z), dtype=np.intp))
    t, step = np.zeros(len(z)), np.full(len(z), FIRST_STEP)
    for _ in range(MOST_STEPS):
        going = np.flatnonzero((t < 1.0) & (step >= LEAST_STEP))
        if not len(going):
            break
        start = points.take(going)
        length = np.minimum(step[going], 1.0 - t[going])
        there, ahead = t[going], start
        for part in (0.5, 1.0):
            _, first, by_t = _at(ends, ahead, there)
            there, way = t[going] + part * length, applied(inverses(first), by_t)
            ahead = replace(start, z=start.z - part * length[:, None] * way)
        size, off = 1.0 + np.max(np.abs(ahead.z), axis=1), []
        for _ in range(3):
            values, first, _ = _at(ends, ahead, there)
            change = applied(inverses(first), values)
            ahead = replace(ahead, z=ahead.z - change)
            off.append(np.nan_to_num(np.max(np.abs(change), axis=1), nan=np.inf) / size)
        good = (off[0] < TRUSTED) & (off[-1] < 1e-8)
        kept, failed = going[good], going[~good]
        moved = ahead.take(good).moved(ahead.z[good])
        points.z[kept], points.inverse[kept], t[kept] = moved.z, moved.inverse, there[good]
        step[kept] = np.minimum(LONGER * step[kept], LARGEST_STEP)
        step[failed] = 0.5 * length[~good]
    # a way that ends short of its goal leads to a double solution, or nearly
    return points.take((t > NEARLY) & np.all(np.isfinite(points.z), axis=1))


Ends = list[Complexes]
"""Coefficients (1, 2, sizes) of each equation at t = 0 and at t = 1."""


def _product_of_lines(
    made: Polynomials, generator: np.random.Generator
) -> tuple[Ends, Complexes]:
    """Return equations that lead from products of lines to a system, and where from."""
    roots = [
        [generator.normal(size=(2, size - 1)).T @ (1.0, 1j) for size in v.shape[1:]]
        for v in made.values
    ]
    ends: Ends = []
    for row, goal in zip(roots, made.values, strict=True):
        lines = [np.atleast_1d(np.poly(values))[::-1] for values in row]
        start = reduce(np.multiply.outer, lines) * np.exp(2j * np.pi * generator.random())
        scale = np.linalg.norm(start) / np.linalg.norm(goal)
        ends.append(np.stack([start[None], scale * goal], axis=1))
    # each equation gives another unknown its value
    starts = [
        np.array(values)[np.argsort(order)]
        for order in permutations(range(len(roots)))
        for values in product(*(row[k] for row, k in zip(roots, order, strict=True)))
    ]
    return ends, np.array(starts, dtype=complex).reshape(-1, len(roots))


def _at(
    ends: Ends, points: ChartRoots, t: Floats
) -> tuple[Complexes, Complexes, Complexes]:
    """Return values (n, k), derivatives by z (n, k, k), and by t (n, k)."""
    here, first = (points.derivatives(ends, order) for order in (0, 1))
    parts = np.stack([1.0 - t, t], axis=1)
    slopes = np.einsum("nkle,ne->nkl", first, parts)
    return applied(here, parts), slopes, here[..., 1] - here[..., 0]
