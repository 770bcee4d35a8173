"""All real modes over boxes of inputs, counted system after system.

The equations fall into systems that are solved one after the other. Where as many roots of
a system are proven as there can be, complex ones and those at infinity too, and each is
proven to be real or not, its real ones are all there are; the next system is looked at for
each of them, with their angles as further inputs. Over a box of inputs roots that are
proven to be different at its centre and regular everywhere never meet.

Approximations of all solutions of a system at an input, by a homotopy.

Nothing here is proven: what is found is certified elsewhere, and counted there against
the number of solutions that the equations can have at most. The start equations are
products of linear factors of the same degrees, so they have just that number of solutions
(A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8), and the way from them to the equations of the mechanism avoids singular
systems but for unlucky random numbers.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import final

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.numeric.crossings import wrap
from spherekit.proof.balls import circle
from spherekit.proof.charts import (
    ChartRoots,
    Given,
    Polynomials,
    Tubes,
    are_apart,
    are_real,
    continued,
    inverses,
    polished,
    roots_of_one,
    stepped,
    tubes,
    turns_of,
    values_at,
)
from spherekit.proof.construction import permanent, systems_of
from spherekit.proof.equations import Equations

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


Path = tuple[int, ...]
"""Which root of each system before a mode goes on from."""
WIDEST_ANGLE = 0.3
"""Angles of roots (rad) over boxes that vary by more are no inputs of the next system."""


@final
@dataclass(frozen=True)
class KnownRoots:
    """All roots of a system at one choice of what is given to it, to start from."""

    at: Array
    points: ChartRoots


SAME = 1e-9
"""Angles (rad) that differ by less are taken for one and widened by what they differ."""
BORROWED = 1.0
"""How far away (rad) roots are known that are followed to where none are."""
MOST_KNOWN = 64
DETOUR = 16
"""Steps of ways round through complex inputs, for roots that a straight one loses."""
Guide = dict[Path, KnownRoots]
"""Roots known near a box, of each system and of each mode of those before."""


@final
@dataclass(frozen=True)
class _Mode:
    """A mode of the systems so far over the box of a number.

    `angle`, `turn`, `rates` and `off` are of all unknowns, zero where not known yet: angles
    (rad) at the centre, their cosines and sines, how they move with the inputs, and by how
    much more at most. It stands for `times` modes, whose angles are all within.
    """

    row: int
    path: Path
    angle: Floats
    turn: Floats
    rates: Floats
    off: Floats
    times: int = 1

    def with_root(
        self, root: int, unknowns: Sequence[int], solution: tuple[Floats, ...]
    ) -> "_Mode":
        """Return the mode that goes on with a root: its angles, turns, rates and off."""
        angle, turn, rates, off = (
            values.copy() for values in (self.angle, self.turn, self.rates, self.off)
        )
        for values, new in zip((angle, turn, rates, off), solution, strict=True):
            values[unknowns] = new
        return _Mode(self.row, (*self.path, root), angle, turn, rates, off, self.times)


@final
@dataclass(frozen=True)
class SolvedSystem:
    """One system: its equations and unknowns by number, and all its solutions for modes.

    `given` are the variables that are angles of each of `solved`.
    """

    equations: tuple[int, ...]
    unknowns: tuple[int, ...]
    given: tuple[int, ...]
    solved: tuple[KnownRoots, ...] = ()


@final
class Systems:
    """The systems of a mechanism's equations, and how many roots each can have."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        made = equations.construction
        parts = systems_of(made)
        every = list(range(made.unknowns))
        self.parts = parts if parts is not None else [(every, every)]
        self.known_roots: list[list[KnownRoots]] = [[] for _ in self.parts]
        self.bounds = [permanent(2 * made.degrees[np.ix_(*part)]) for part in self.parts]

    def solved(self, guide: Guide) -> tuple[SolvedSystem, ...]:
        """Return the systems with the solutions that a guide has of each."""
        return tuple(
            SolvedSystem(
                tuple(rows),
                tuple(unknowns),
                tuple(self.given_to(number)),
                tuple(roots for path, roots in guide.items() if len(path) == number),
            )
            for number, (rows, unknowns) in enumerate(self.parts)
        )

    def starts(self) -> tuple[SolvedSystem, ...]:
        """Return the systems with solutions at places from which others were followed."""
        return tuple(
            replace(system, solved=tuple(roots))
            for system, roots in zip(self.solved({}), self.known_roots, strict=True)
        )

    def given_to(self, number: int) -> list[int]:
        """Return the variables that are given to a system: all but its unknowns."""
        unknowns = self.parts[number][1]
        return [v for v in range(self.equations.variables) if v not in unknowns]

    def _found(self, number: int, given: Floats) -> KnownRoots | None:
        """Return all roots of a system at what is given to it, None if some are lost."""
        rows, unknowns = self.parts[number]
        made = Polynomials.at(self.equations, rows, unknowns, turns_of(given)[None])
        for seed in range(SEEDS):
            roots, good = polished(made, solutions(made, seed))
            roots = roots.take(good)
            roots = roots.take(_first_of_each(roots))
            if len(roots.z) == self.bounds[number]:
                return KnownRoots(given, roots)
        return None

    def counted(
        self,
        centres: Floats,
        turns: Floats,
        half: Floats,
        guides: Sequence[Guide],
        hard: Bools,
    ) -> tuple[Bools, Indices, list[Guide]]:
        """Return over which boxes of the inputs (m, inputs) all is proven, and the modes.

        Those are the numbers of real ones; with them the roots of each box.

        `turns` (m, inputs, 2) are the cosines and sines of the exact centres, next to
        which `centres` are. Roots are followed from the `guides` of each box; where they
        are lost on the straight way, another one is tried where it is `hard` (m,).
        """
        m = len(centres)
        good = np.ones(m, dtype=bool)
        modes = np.zeros(m, dtype=np.intp)
        following: list[Guide] = [{} for _ in range(m)]
        count, inputs = self.equations.construction.unknowns, centres.shape[1]
        none, turn, slope = (np.zeros((count, *size)) for size in ((), (2,), (inputs,)))
        waiting = [_Mode(row, (), none, turn, slope, none) for row in range(m)]
        for number, (_, unknowns) in enumerate(self.parts):
            part = [mode for mode in waiting if good[mode.row]]
            waiting = []
            if not part:
                break
            rows = [mode.row for mode in part]
            given, whole, moving = self._given(number, part, centres, turns, half)
            roots, proven, distinct = self._proven(
                number, part, given, whole, moving, guides, hard
            )
            bound = self.bounds[number]
            apart = are_apart(roots, proven.radius, proven.good, bound)
            real, off_circle = are_real(roots, proven)
            decided = np.all((real | off_circle).reshape(-1, bound), axis=1)
            angle, slopes, reach = _angles(roots, proven, half[np.repeat(rows, bound)])
            for place, mode in enumerate(part):
                row, path = mode.row, mode.path
                mine = slice(place * bound, (place + 1) * bound)
                if distinct[place]:
                    at = ChartRoots(
                        roots.z[mine], roots.inverse[mine], np.zeros(bound, np.intp)
                    )
                    following[row][path] = KnownRoots(given[place], at)
                elif path in guides[row]:
                    following[row][path] = guides[row][path]
                good[row] &= apart[place] and decided[place]
                for root in np.flatnonzero(real[mine]) if good[row] else ():
                    if number + 1 == len(self.parts):
                        modes[row] += mode.times
                        continue
                    where = place * bound + int(root)
                    turned = circle(angle[where])
                    solution = angle[where], turned, slopes[where], reach[where]
                    waiting.append(mode.with_root(int(root), unknowns, solution))
                    good[row] &= bool(np.all(proven.reach[where] < WIDEST_ANGLE))
            waiting = self._joined(number + 1, waiting, half)
        return good, modes, following

    def _given(
        self,
        number: int,
        part: Sequence[_Mode],
        centres: Floats,
        turns: Floats,
        half: Floats,
    ) -> tuple[Floats, Floats, Given]:
        """Return the angles given to a system for modes, their turns, and how they move."""
        rows, others = [mode.row for mode in part], self.given_to(number)
        inputs = centres.shape[1]

        def joined(values: Sequence[Floats], ends: Iterable[Floats]) -> Floats:
            pairs = zip(values, ends, strict=True)
            return np.stack([np.concatenate(two)[others] for two in pairs])

        moving = Given(
            half[rows],
            joined([mode.rates for mode in part], [np.eye(inputs)] * len(part)),
            joined([mode.off for mode in part], [np.zeros(inputs)] * len(part)),
        )
        angles = joined([mode.angle for mode in part], centres[rows])
        return angles, joined([mode.turn for mode in part], turns[rows]), moving

    def _joined(self, number: int, modes: list[_Mode], half: Floats) -> list[_Mode]:
        """Return modes of which those that systems from a number on cannot tell are one.

        They differ in angles that no such system has, as where a link is turned over.
        """
        degrees = self.equations.construction.degrees
        left = [row for rows, _ in self.parts[number:] for row in rows]
        used = np.any(degrees[left] > 0, axis=0)[: self.equations.unknowns]
        joined: dict[int, list[_Mode]] = {}
        for mode in modes:
            row_modes = joined.setdefault(mode.row, [])
            for place, other in enumerate(row_modes):
                apart = np.abs(wrap(mode.angle - other.angle))
                drift = np.abs(mode.rates - other.rates) @ half[mode.row]
                spare = 1.05 * (apart + drift)
                if np.all(spare[used] < SAME):
                    off = np.maximum(mode.off + spare, other.off)
                    row_modes[place] = replace(
                        other, off=off, times=other.times + mode.times
                    )
                    break
            else:
                row_modes.append(mode)
        return [mode for row_modes in joined.values() for mode in row_modes]

    def _add(self, number: int, roots: KnownRoots | None) -> None:
        """Keep roots of a system to start from elsewhere."""
        if roots is not None:
            self.known_roots[number] = [roots, *self.known_roots[number][: MOST_KNOWN - 1]]

    def _borrowed(self, number: int, given: Floats) -> KnownRoots | None:
        """Return the roots known for what is nearest to what is given to a system."""
        best, nearest = None, BORROWED
        for roots in self.known_roots[number]:
            apart = np.abs(wrap(roots.at - given))
            if (gap := float(np.max(apart, initial=0.0))) < nearest:
                best, nearest = roots, gap
        return best

    def _proven(
        self,
        number: int,
        part: Sequence[_Mode],
        given: Floats,
        turns: Floats,
        moving: Given,
        guides: Sequence[Guide],
        hard: Bools,
    ) -> tuple[ChartRoots, Tubes, Bools]:
        """Return the roots at all boxes, what is proven, and where none were lost."""
        system, bound = self.parts[number], self.bounds[number]
        made = Polynomials.at(self.equations, *system, turns)
        if len(system[1]) == 1:
            tried, ended = polished(made, roots_of_one(made))
            proven = tubes(made, tried, moving)
            return tried, proven, are_apart(tried, proven.radius, ended, bound)
        nothing = ChartRoots(
            np.zeros((bound, len(system[1])), dtype=complex),
            np.zeros((bound, len(system[1])), dtype=bool),
            np.zeros(bound, dtype=np.intp),
        )
        origins, strange = [], np.zeros(len(part), dtype=bool)
        for place, (mode, here) in enumerate(zip(part, given, strict=True)):
            near = guides[mode.row].get(mode.path)
            if near is None:
                near = self._borrowed(number, here)
                strange[place] = near is not None
            if near is None:
                near = self._found(number, here)
                self._add(number, near)
            origins.append(near or KnownRoots(here, nothing))
        roots = ChartRoots(
            np.concatenate([origin.points.z for origin in origins]),
            np.concatenate([origin.points.inverse for origin in origins]),
            np.repeat(np.arange(len(origins)), bound),
        )
        places = np.stack([origin.at for origin in origins])
        there = Polynomials.at(self.equations, *system, turns_of(places))
        rough = stepped(there, roots, given - places)
        verdict = _judged(made, rough, moving, bound)
        lost = np.flatnonzero(~verdict[2] & (strange | hard[[mode.row for mode in part]]))
        if len(lost):
            rows = (lost[:, None] * bound + np.arange(bound)).ravel()
            at = roots.take(rows)
            at = ChartRoots(at.z, at.inverse, np.repeat(np.arange(len(lost)), bound))
            ways = at, places[lost], given[lost], DETOUR
            again = continued(self.equations, system, *ways)
            verdict = _judged(made, _replaced(verdict[0], rows, again), moving, bound)
        for missing in np.flatnonzero(~verdict[2] & strange):
            anew = self._found(number, given[missing])
            self._add(number, anew)
            if anew is not None:
                rows = missing * bound + np.arange(bound)
                tried = _replaced(verdict[0], rows, anew.points)
                verdict = _judged(made, tried, moving, bound)
        return verdict


def _judged(
    made: Polynomials, roots: ChartRoots, moving: Given, bound: int
) -> tuple[ChartRoots, Tubes, Bools]:
    """Return roots polished, what is proven of them, and where all are different."""
    tried, ended = polished(made, roots)
    proven = tubes(made, tried, moving)
    return tried, proven, are_apart(tried, proven.radius, ended, bound)


def _replaced(roots: ChartRoots, rows: Indices, other: ChartRoots) -> ChartRoots:
    """Return roots with others in some of their rows."""
    z, inverse = roots.z.copy(), roots.inverse.copy()
    z[rows], inverse[rows] = other.z, other.inverse
    return ChartRoots(z, inverse, roots.row)


def _angles(
    roots: ChartRoots, proven: Tubes, half: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return angles (n, k) of roots, of which the real ones are of use, rates, and off.

    At the centre, by the inputs, and how far they go from that over boxes.
    """
    size = np.abs(roots.z)
    sense = np.where(roots.inverse, -1, 1)
    with np.errstate(all="ignore"):
        rates = proven.rates / (1j * sense * roots.z)[:, :, None]
        # log(1 + w) is off from w by at most this
        w = proven.reach / size
        off = 0.5 * w**2 / (1.0 - w) + proven.width[:, None] / size
        lost = 1e-15 * np.einsum("nkd,nd->nk", np.abs(rates), half)
    off = np.where(w < 0.5, 1.05 * off + np.abs(size - 1.0) + lost + 1e-13, np.inf)
    return np.asarray(sense * np.angle(roots.z)), rates.real, off


def _first_of_each(roots: ChartRoots) -> Indices:
    over = np.where(roots.inverse, 1.0, roots.z)
    under = np.where(roots.inverse, roots.z, 1.0)
    gap = np.max(np.abs(over[:, None] * under - under[:, None] * over), axis=2)
    return np.flatnonzero(~np.any(np.tril(gap < 1e-7, -1), axis=1))
