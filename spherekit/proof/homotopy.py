"""Approximations of all complex modes at an input, by a homotopy from products of lines.

Nothing here is proven: what is found is certified elsewhere, and counted there against
the number of solutions that the equations can have at most. The start equations are
products of linear factors of the same degrees, so they have just that number of solutions
(A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8), and the way from them to the equations of the mechanism avoids singular
systems but for unlucky random numbers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.equations import FloatEquations
from spherekit.sphere.rotation import Floats

Complexes = NDArray[np.complex128]

MOST_STEPS = 600
FIRST_STEP, LEAST_STEP, LARGEST_STEP = 0.02, 1e-7, 0.1
TRUSTED = 3e-3
"""Largest correction of a predicted point, over its size: a neighbour's is farther."""
NEARLY = 0.9
"""Ways that come so far are of use: Newton's method in more digits goes on from there."""
SEEDS = 4
"""Ways tried: of four one nearly always misses nothing."""


@final
@dataclass(frozen=True)
class _Line:
    """A random projective line for each angle: e^(i angle) = (a w + b) / (c w + d)."""

    a: Complexes
    b: Complexes
    c: Complexes
    d: Complexes

    @staticmethod
    def random(generator: np.random.Generator, count: int) -> "_Line":
        parts = generator.normal(size=(4, count)) + 1j * generator.normal(size=(4, count))
        return _Line(*parts)

    def place(self, w: Complexes) -> tuple[Complexes, Complexes]:
        """Return numerators and denominators (n, count)."""
        return self.a * w + self.b, self.c * w + self.d


@final
class _Way:
    """The equations at t = 0 and at t = 1, in coordinates w (n, unknowns)."""

    def __init__(
        self,
        equations: FloatEquations,
        rows: Sequence[int],
        unknowns: Sequence[int],
        given: NDArray[Any],
        seed: int,
    ) -> None:
        generator = np.random.default_rng(seed)
        self.equations, self.rows, self.unknowns = equations, rows, list(unknowns)
        self.given = given
        self.count = len(unknowns)
        degrees = equations.equations.construction.degrees[np.ix_(rows, unknowns)]
        self.degrees = degrees.astype(int)
        self.line = _Line.random(generator, self.count)
        self.factors = [
            [generator.normal(size=2 * m) + 1j * generator.normal(size=2 * m) for m in row]
            for row in self.degrees
        ]
        self.gamma = np.exp(2j * np.pi * generator.random(self.count))
        probe = generator.normal(size=(32, self.count)) + 1j * generator.normal(
            size=(32, self.count)
        )
        ends = [np.mean(np.abs(end(probe)[0]), axis=0) for end in (self._start, self._goal)]
        self.scale = ends[0] / ends[1]

    def starts(self) -> Complexes:
        """Return the solutions at t = 0."""
        solutions = list(self._choices(0, {}))
        return np.array(solutions, dtype=complex).reshape(len(solutions), self.count)

    def _choices(self, row: int, taken: dict[int, complex]) -> Iterator[list[complex]]:
        if row == self.count:
            yield [taken[column] for column in range(self.count)]
            return
        for column in range(self.count):
            if column not in taken:
                for value in self.factors[row][column]:
                    yield from self._choices(row + 1, {**taken, column: complex(value)})

    def _start(self, w: Complexes) -> tuple[Complexes, Complexes]:
        """Return values (n, k) and derivatives (n, k, k) at t = 0."""
        n = len(w)
        values = np.ones((n, self.count), dtype=complex)
        logs = np.zeros((n, self.count, self.count), dtype=complex)
        for row, column in product(range(self.count), repeat=2):
            for root in self.factors[row][column]:
                apart = w[:, column] - root
                apart = np.where(apart == 0, 1e-300, apart)
                values[:, row] *= apart
                logs[:, row, column] += 1.0 / apart
        return values, values[:, :, None] * logs

    def _goal(self, w: Complexes) -> tuple[Complexes, Complexes]:
        """Return values and derivatives at t = 1."""
        top, bottom = self.line.place(w)
        z = top / bottom
        unknown = np.stack([0.5 * (z + 1 / z), -0.5j * (z - 1 / z)], axis=-1)
        turns = np.repeat(self.given[None].astype(complex), len(w), axis=0)
        turns[:, self.unknowns] = unknown
        jets = self.equations.at(turns, 1)
        slope = -1j * (self.line.a * self.line.d - self.line.b * self.line.c)
        both = top * bottom
        turning = slope / both
        logs = (self.line.a * bottom + self.line.c * top) / both
        values = np.empty((len(w), self.count), dtype=complex)
        first = np.zeros((len(w), self.count, self.count), dtype=complex)
        for row, jet in enumerate(jets[equation] for equation in self.rows):
            weight = np.prod(both ** self.degrees[row], axis=1)
            values[:, row] = jet[()] * weight
            for column, variable in enumerate(self.unknowns):
                change = values[:, row] * self.degrees[row, column] * logs[:, column]
                if (variable,) in jet:
                    change = change + jet[(variable,)] * turning[:, column] * weight
                first[:, row, column] = change
        return values, first

    def at(self, w: Complexes, t: Floats) -> tuple[Complexes, Complexes, Complexes]:
        """Return values, derivatives by w, and derivative by t."""
        start, start_w = self._start(w)
        goal, goal_w = self._goal(w)
        one, other = self.gamma * (1.0 - t)[:, None], self.scale * t[:, None]
        values = one * start + other * goal
        first = one[..., None] * start_w + other[..., None] * goal_w
        return values, first, self.scale * goal - self.gamma * start

    def points(self, w: Complexes) -> Complexes:
        """Return e^(i angle) (n, k) of the unknown angles."""
        top, bottom = self.line.place(w)
        return np.asarray(top / bottom)


def modes_near(equations: FloatEquations, driven: Floats, seed: int) -> Complexes:
    """Return approximations (n, unknowns) rad of the complex modes at an input.

    `driven` (inputs, 2) are the cosines and sines of the inputs. Some may be missing, and
    some may come twice.
    """
    count = equations.equations.unknowns
    every = list(range(count))
    given = np.concatenate([np.zeros((count, 2)), driven])
    with np.errstate(all="ignore"):
        angles = -1j * np.log(points_near(equations, every, every, given, seed))
    return np.asarray(angles[np.all(np.isfinite(angles), axis=1)])


def points_near(
    equations: FloatEquations,
    rows: Sequence[int],
    unknowns: Sequence[int],
    given: NDArray[Any],
    seed: int,
) -> Complexes:
    """Return e^(i angle) (n, unknowns) of the solutions of a system, infinite ones too.

    `given` (variables, 2) are the cosines and sines of all other variables.
    """
    way = _Way(equations, rows, unknowns, given, seed)
    with np.errstate(all="ignore"):
        return _tracked(way)


def _tracked(way: _Way) -> Complexes:
    w = way.starts()
    n = len(w)
    t, step = np.zeros(n), np.full(n, FIRST_STEP)
    streak = np.zeros(n, dtype=int)
    lost = np.zeros(n, dtype=bool)
    for _ in range(MOST_STEPS):
        going = np.flatnonzero((t < 1.0) & ~lost)
        if not len(going):
            break
        now, length = w[going], np.minimum(step[going], 1.0 - t[going])
        further = _predicted(way, now, t[going], length)
        there = t[going] + length
        further, first, last = _corrected(way, further, there)
        size = 1.0 + np.max(np.abs(further), axis=1)
        good = (first < TRUSTED * size) & (last < 1e-8 * size)
        kept = going[good]
        w[kept], t[kept] = further[good], there[good]
        streak[kept] += 1
        longer = kept[streak[kept] >= 3]
        step[longer] = np.minimum(2.0 * step[longer], LARGEST_STEP)
        streak[longer] = 0
        failed = going[~good]
        step[failed] = 0.5 * length[~good]
        streak[failed] = 0
        lost[failed] = step[failed] < LEAST_STEP
    # a way that ends short of its goal leads to a double solution, or nearly
    points = way.points(w[t > NEARLY])
    return np.asarray(points[~np.any(np.isnan(points), axis=1)])


def _predicted(way: _Way, w: Complexes, t: Floats, length: Floats) -> Complexes:
    """Return points ahead by the Runge-Kutta method of order 4."""

    def slope(w: Complexes, t: Floats) -> Complexes:
        _, first, by_t = way.at(w, t)
        return -_solved(first, by_t)

    h = length[:, None]
    one = slope(w, t)
    two = slope(w + 0.5 * h * one, t + 0.5 * length)
    three = slope(w + 0.5 * h * two, t + 0.5 * length)
    four = slope(w + h * three, t + length)
    return np.asarray(w + h / 6.0 * (one + 2.0 * two + 2.0 * three + four))


def _corrected(way: _Way, w: Complexes, t: Floats) -> tuple[Complexes, Floats, Floats]:
    """Return points after three Newton steps, with the sizes of the first and the last."""
    sizes = []
    for _ in range(3):
        values, first, _ = way.at(w, t)
        change = _solved(first, values)
        w = w - change
        sizes.append(np.nan_to_num(np.max(np.abs(change), axis=1), nan=np.inf))
    return w, sizes[0], sizes[-1]


def _solved(matrices: Complexes, right: Complexes) -> Complexes:
    """Return solutions (n, k), NaN where a matrix is singular."""
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    regular = finite & (
        np.abs(np.linalg.det(np.where(finite[:, None, None], matrices, 0))) > 0
    )
    out = np.full(right.shape, np.nan + 0j)
    out[regular] = np.linalg.solve(matrices[regular], right[regular][..., None])[..., 0]
    return out
