"""Approximations of all solutions of a system at an input, by a homotopy.

Nothing here is proven: what is found is certified elsewhere, and counted there against
the number of solutions that the equations can have at most. The start equations are
products of linear factors of the same degrees, so they have just that number of solutions
(A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8), and the way from them to the equations of the mechanism avoids singular
systems but for unlucky random numbers.
"""

from collections.abc import Iterator
from functools import reduce
from typing import final

import numpy as np

from spherekit.proof.charts import ChartRoots, Complexes, Polynomials, inverses, values_at
from spherekit.proof.equations import Equations
from spherekit.sphere.rotation import Floats

MOST_STEPS = 600
FIRST_STEP, LEAST_STEP, LARGEST_STEP = 0.02, 1e-7, 0.1
TRUSTED = 3e-3
"""Largest correction of a predicted point, over its size: a neighbour's is farther."""
NEARLY = 0.9
"""Ways that come so far are of use: Newton's method in more digits goes on from there."""
SEEDS = 4
"""Ways tried: of four one nearly always misses nothing."""


def modes_near(equations: Equations, driven: Floats, seed: int) -> Complexes:
    """Return approximations (n, unknowns) rad of the complex modes at an input.

    `driven` (inputs, 2) are the cosines and sines of the inputs. Some may be missing, and
    some may come twice.
    """
    every = list(range(equations.unknowns))
    made = Polynomials.at(equations, every, every, driven[None])
    with np.errstate(all="ignore"):
        angles = -1j * np.log(solutions(made, seed).points)
    return np.asarray(angles[np.all(np.isfinite(angles), axis=1)])


def solutions(made: Polynomials, seed: int) -> ChartRoots:
    """Return approximations of a system's solutions at one input, infinite ones too."""
    with np.errstate(all="ignore"):
        return _Way(made, seed).tracked()


@final
class _Way:
    """A system from products of lines at t = 0 to the one wanted at t = 1."""

    def __init__(self, made: Polynomials, seed: int) -> None:
        generator = np.random.default_rng(seed)

        def random(count: int) -> Complexes:
            return np.asarray(generator.normal(size=(2, count)).T @ (1.0, 1j))

        self.made = made
        self.roots = [[random(size - 1) for size in v.shape[1:]] for v in made.values]
        self.ends = []
        for row, (goal,) in zip(self.roots, made.values, strict=True):
            lines = [np.atleast_1d(np.poly(roots))[::-1] for roots in row]
            start = reduce(np.multiply.outer, lines) * np.exp(
                2j * np.pi * generator.random()
            )
            scale = np.linalg.norm(start) / np.linalg.norm(goal)
            self.ends.append((start, scale * goal))

    def _starts(self, taken: dict[int, complex]) -> Iterator[list[complex]]:
        """Yield the solutions at t = 0 that have values of some unknowns."""
        if len(taken) == len(self.roots):
            yield [taken[column] for column in range(len(taken))]
            return
        for column, values in enumerate(self.roots[len(taken)]):
            if column not in taken:
                for value in values:
                    yield from self._starts({**taken, column: complex(value)})

    def _at(self, points: ChartRoots, t: Floats) -> tuple[Complexes, Complexes, Complexes]:
        """Return values (n, k), derivatives by z (n, k, k), and by t (n, k)."""
        values, slopes = [], []
        for start, goal in self.ends:
            part = t.reshape(-1, *[1] * start.ndim)
            values.append((1.0 - part) * start + part * goal)
            slopes.append(np.broadcast_to(goal - start, (len(t), 1, *start.shape)))
        rows = ChartRoots(points.z, points.inverse, np.arange(len(t)))
        made = self.made
        at_t = Polynomials(
            tuple(values), tuple(slopes), made.error, made.constant, made.degrees
        )
        here, first, by_t = values_at(at_t, rows)
        return here, first, by_t[..., 0]

    def tracked(self) -> ChartRoots:
        """Return where the ways from all solutions at t = 0 end, those that come near."""
        starts = list(self._starts({}))
        z = np.array(starts, dtype=complex).reshape(len(starts), len(self.roots))
        points = ChartRoots.of(z, np.zeros(len(z), dtype=np.intp))
        n = len(z)
        t, step = np.zeros(n), np.full(n, FIRST_STEP)
        streak, lost = np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
        for _ in range(MOST_STEPS):
            going = np.flatnonzero((t < 1.0) & ~lost)
            if not len(going):
                break
            length = np.minimum(step[going], 1.0 - t[going])
            there = t[going] + length
            ahead = self._predicted(points.take(going), t[going], length)
            ahead, first, last = self._corrected(ahead, there)
            size = 1.0 + np.max(np.abs(ahead.z), axis=1)
            good = (first < TRUSTED * size) & (last < 1e-8 * size)
            kept, failed = going[good], going[~good]
            moved = ahead.take(good).moved(ahead.z[good])
            points.z[kept], points.inverse[kept] = moved.z, moved.inverse
            t[kept] = there[good]
            streak[kept] += 1
            longer = kept[streak[kept] >= 3]
            step[longer] = np.minimum(2.0 * step[longer], LARGEST_STEP)
            streak[longer] = streak[failed] = 0
            step[failed] = 0.5 * length[~good]
            lost[failed] = step[failed] < LEAST_STEP
        # a way that ends short of its goal leads to a double solution, or nearly
        return points.take((t > NEARLY) & np.all(np.isfinite(points.z), axis=1))

    def _predicted(self, points: ChartRoots, t: Floats, length: Floats) -> ChartRoots:
        """Return points ahead by the Runge-Kutta method of order 4."""
        h, total = length[:, None], 0.0 * points.z
        slope = total
        for part, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            at = ChartRoots(points.z + part * h * slope, points.inverse, points.row)
            _, first, by_t = self._at(at, t + part * length)
            slope = -_solved(first, by_t)
            total = total + weight * slope
        return ChartRoots(points.z + h / 6.0 * total, points.inverse, points.row)

    def _corrected(
        self, points: ChartRoots, t: Floats
    ) -> tuple[ChartRoots, Floats, Floats]:
        """Return points after three Newton steps, with sizes of the first and the last."""
        sizes = []
        for _ in range(3):
            values, first, _ = self._at(points, t)
            change = _solved(first, values)
            points = ChartRoots(points.z - change, points.inverse, points.row)
            sizes.append(np.nan_to_num(np.max(np.abs(change), axis=1), nan=np.inf))
        return points, sizes[0], sizes[-1]


def _solved(matrices: Complexes, right: Complexes) -> Complexes:
    """Return solutions (n, k), NaN where a matrix is singular."""
    inverse, regular = inverses(matrices)
    change = np.einsum("nij,nj->ni", inverse, right)
    return np.where(regular[:, None], change, np.nan)
