"""All real modes over boxes of inputs, counted system after system.

The equations fall into systems that are solved one after the other. Where as many roots of
a system are proven as there can be, complex ones and those at infinity too, and each is
proven to be real or not, its real ones are all there are; the next system is looked at for
each of them, with their angles as further inputs. Over a box of inputs roots that are
proven to be different at its centre and regular everywhere never meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.balls import circle
from spherekit.proof.charts import (
    ChartRoots,
    Polynomials,
    Tubes,
    are_apart,
    are_real,
    continued,
    inverses,
    polished,
    roots_of_one,
    tubes,
    turns_of,
    values_at,
)
from spherekit.proof.construction import permanent
from spherekit.proof.eliminated import systems_of
from spherekit.proof.equations import Equations
from spherekit.proof.homotopy import SEEDS, points_near
from spherekit.sphere.rotation import Floats

Path = tuple[int, ...]
"""Which root of each system before a mode goes on from."""
WIDEST_ANGLE = 0.3
"""Angles of roots (rad) over boxes that vary by more are no inputs of the next system."""


@final
@dataclass(frozen=True)
class Known:
    """All roots of a system at one choice of what is given to it, to start from."""

    at: NDArray[Any]
    points: ChartRoots


DETOUR = 16
"""Steps of ways round through complex inputs, for roots that a straight one loses."""
_Waiting = tuple[int, Path, Floats, Floats, Floats]
Guide = dict[Path, Known]
"""Roots known near a box, of each system and of each mode of those before."""


@final
@dataclass(frozen=True)
class Counted:
    """What is proven over boxes: `good` (m,), and then the numbers of real modes."""

    good: NDArray[np.bool_]
    modes: NDArray[np.intp]
    guides: list[Guide]


@final
@dataclass
class _Part:
    """One system at several boxes: which box, what is given, and by how much it varies."""

    row: list[int] = field(default_factory=list)
    path: list[Path] = field(default_factory=list)
    given: list[Floats] = field(default_factory=list)
    turns: list[Floats] = field(default_factory=list)
    half: list[Floats] = field(default_factory=list)


@final
class Systems:
    """The systems of a mechanism's equations, and how many roots each can have."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        made = equations.construction
        parts = systems_of(made)
        every = list(range(made.unknowns))
        self.parts = parts if parts is not None else [(every, every)]
        self.bounds = [permanent(2 * made.degrees[np.ix_(*part)]) for part in self.parts]

    def given_to(self, number: int) -> list[int]:
        """Return the variables that are given to a system: all but its unknowns."""
        unknowns = self.parts[number][1]
        return [v for v in range(self.equations.variables) if v not in unknowns]

    def _found(self, number: int, given: Floats) -> Known | None:
        """Return all roots of a system at what is given to it, None if some are lost."""
        rows, unknowns = self.parts[number]
        turns = np.zeros((self.equations.variables, 2))
        turns[self.given_to(number)] = turns_of(given)
        made = Polynomials.at(self.equations, rows, unknowns, turns_of(given)[None])
        for seed in range(SEEDS):
            near = points_near(self.equations.floats, rows, unknowns, turns, seed)
            roots = ChartRoots.of(near, np.zeros(len(near), dtype=np.intp))
            roots, good = polished(made, roots)
            roots = roots.take(good)
            roots = roots.take(_first_of_each(roots))
            if len(roots.z) == self.bounds[number]:
                return Known(given, roots)
        return None

    def counted(
        self,
        centres: Floats,
        turns: Floats,
        half: Floats,
        guides: Sequence[Guide],
        hard: NDArray[np.bool_],
    ) -> Counted:
        """Return the numbers of modes over boxes of the inputs (m, inputs).

        `turns` (m, inputs, 2) are the cosines and sines of the exact centres, next to
        which `centres` are. Roots are followed from the `guides` of each box; where they
        are lost on the straight way, another one is tried where it is `hard` (m,).
        """
        m = len(centres)
        good = np.ones(m, dtype=bool)
        modes = np.zeros(m, dtype=np.intp)
        following: list[Guide] = [{} for _ in range(m)]
        count = self.equations.construction.unknowns
        waiting: list[_Waiting] = [
            (row, (), np.zeros(count), np.zeros((count, 2)), np.zeros(count))
            for row in range(m)
        ]
        for number, (_, unknowns) in enumerate(self.parts):
            part, own = _Part(), []
            for row, path, angle, turn, off in waiting:
                if not good[row]:
                    continue
                others = self.given_to(number)
                part.row.append(row)
                part.path.append(path)
                part.given.append(np.concatenate([angle, centres[row]])[others])
                part.turns.append(np.concatenate([turn, turns[row]])[others])
                part.half.append(np.concatenate([off, half[row]])[others])
                own.append((angle, turn, off))
            waiting = []
            if not part.row:
                break
            roots, proven, distinct = self._proven(number, part, guides, hard)
            bound = self.bounds[number]
            apart = are_apart(roots, proven.radius, proven.good, bound)
            real, off_circle = are_real(roots, proven)
            for place, (row, path) in enumerate(zip(part.row, part.path, strict=True)):
                mine = slice(place * bound, (place + 1) * bound)
                if distinct[place]:
                    at = ChartRoots(
                        roots.z[mine], roots.inverse[mine], np.zeros(bound, np.intp)
                    )
                    following[row][path] = Known(part.given[place], at)
                elif path in guides[row]:
                    following[row][path] = guides[row][path]
                good[row] &= apart[place] and bool(np.all((real | off_circle)[mine]))
                for root in np.flatnonzero(real[mine]) if good[row] else ():
                    if number + 1 == len(self.parts):
                        modes[row] += 1
                        continue
                    angle, turn, off = own[place]
                    angle, turn, off = angle.copy(), turn.copy(), off.copy()
                    where = place * bound + int(root)
                    reach = 1.05 * proven.reach[where]
                    good[row] &= bool(np.all(reach < WIDEST_ANGLE))
                    z = roots.z[where]
                    angle[unknowns] = np.where(roots.inverse[where], -1, 1) * np.angle(z)
                    turn[unknowns] = circle(angle[unknowns])
                    off[unknowns] = reach + np.abs(np.abs(z) - 1.0) + 1e-13
                    waiting.append((row, (*path, int(root)), angle, turn, off))
        return Counted(good, modes, following)

    def _proven(
        self,
        number: int,
        part: _Part,
        guides: Sequence[Guide],
        hard: NDArray[np.bool_],
    ) -> tuple[ChartRoots, Tubes, NDArray[np.bool_]]:
        """Return the roots at all boxes, what is proven, and where none were lost."""
        system, bound = self.parts[number], self.bounds[number]
        given, half = np.stack(part.given), np.stack(part.half)
        made = Polynomials.at(self.equations, *system, np.stack(part.turns))
        if len(system[1]) == 1:
            tried, ended = polished(made, roots_of_one(made))
            proven = tubes(made, tried, half)
            return tried, proven, are_apart(tried, proven.radius, ended, bound)
        nothing = ChartRoots(
            np.zeros((bound, len(system[1])), dtype=complex),
            np.zeros((bound, len(system[1])), dtype=bool),
            np.zeros(bound, dtype=np.intp),
        )
        known = []
        for row, path, here in zip(part.row, part.path, given, strict=True):
            near = guides[row].get(path)
            if near is None:
                near = self._found(number, here)
            known.append(near or Known(here, nothing))
        roots = ChartRoots(
            np.concatenate([each.points.z for each in known]),
            np.concatenate([each.points.inverse for each in known]),
            np.repeat(np.arange(len(known)), bound),
        )
        rough = _stepped(self.equations, system, roots, known, given)
        tried, ended = polished(made, rough)
        proven = tubes(made, tried, half)
        distinct = are_apart(tried, proven.radius, ended, bound)
        lost = np.flatnonzero(~distinct & hard[part.row])
        if len(lost):
            rows = (lost[:, None] * bound + np.arange(bound)).ravel()
            at = roots.take(rows)
            at = ChartRoots(at.z, at.inverse, np.repeat(np.arange(len(lost)), bound))
            start = np.stack([known[row].at for row in lost])
            again = continued(self.equations, system, at, start, given[lost], DETOUR)
            z, inverse = tried.z.copy(), tried.inverse.copy()
            z[rows], inverse[rows] = again.z, again.inverse
            tried, ended = polished(made, ChartRoots(z, inverse, tried.row))
            proven = tubes(made, tried, half)
            distinct = are_apart(tried, proven.radius, ended, bound)
        return tried, proven, distinct


def _stepped(
    equations: Equations,
    system: tuple[Sequence[int], Sequence[int]],
    roots: ChartRoots,
    known: Sequence[Known],
    goal: Floats,
) -> ChartRoots:
    """Return roots moved by their rates from where they are known to a goal."""
    start = np.stack([each.at for each in known])
    made = Polynomials.at(equations, *system, turns_of(start))
    with np.errstate(all="ignore"):
        _, first, by_input = values_at(made, roots)
        inverse, _ = inverses(first)
        change = np.einsum("njg,ng->nj", -inverse @ by_input, (goal - start)[roots.row])
    small = np.all(np.abs(change) < 0.5, axis=1, keepdims=True)
    return roots.moved(np.where(small, roots.z + change, roots.z))


def _first_of_each(roots: ChartRoots) -> NDArray[np.intp]:
    over = np.where(roots.inverse, 1.0, roots.z)
    under = np.where(roots.inverse, roots.z, 1.0)
    gap = np.max(np.abs(over[:, None] * under - under[:, None] * over), axis=2)
    return np.flatnonzero(~np.any(np.tril(gap < 1e-7, -1), axis=1))
