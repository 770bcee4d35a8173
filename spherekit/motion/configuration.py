"""All configuration curves of a mechanism, and the branches that lie on each.

A branch is one assembly mode over the range of an input; it ends where the input has a
dead centre, and there another one begins. Followed in arc length they are one curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.branches import Branch, Solver
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Inputs over the range from which curves are followed where none is known yet."""
SAME_CONFIGURATION = 1e-6
"""A branch and a curve whose variables differ by less (rad) agree."""


@final
@dataclass(frozen=True)
class Piece:
    """The part of a curve from `start` to `stop` (s in rad) that is one branch.

    The input only rises or only falls in it and lies in its range. `branch` is None for
    what the curve reaches and none of the branches given holds: a mode that the search for
    them missed, or wheels in mesh a turn later. `stop` may be
    beyond the length of a closed curve: the piece holds the point s = 0.
    """

    branch: int | None
    start: float
    stop: float


@final
@dataclass(frozen=True)
class ConfigurationCurve:
    """A curve and its pieces within the input range, in order of arc length."""

    curve: ArcCurve
    pieces: tuple[Piece, ...]


def configuration_curves(
    solver: Solver,
    branches: Sequence[Branch],
    low: float,
    high: float,
    longest: float = 200.0,
) -> tuple[ConfigurationCurve, ...]:
    """Return the configuration curves that branches over an input range lie on.

    Parameters
    ----------
    solver, branches
        The mechanism, and its branches over inputs from `low` to `high` (rad).
    longest
        Length (rad) after which a curve that does not close is ended.

    Curves on which no branch was found are not found either.
    """
    curves: list[ArcCurve] = []
    inputs = np.linspace(low, high, PROBED)
    for branch in branches:
        there = solver.evaluate(branch, inputs[:, None])
        todo = there.values[there.status == Status.OK]
        for curve in curves:
            todo = _elsewhere(curve, todo)
        while len(todo):
            middle = len(todo) // 2
            given, todo = todo[middle], np.delete(todo, middle, axis=0)
            try:
                curves.append(follow_arc(solver.closure, given, longest=longest))
            except SolveError:
                continue
            todo = _elsewhere(curves[-1], todo)
    return tuple(
        ConfigurationCurve(curve, _pieces(solver, branches, curve, low, high))
        for curve in curves
    )


def _elsewhere(curve: ArcCurve, values: Floats) -> Floats:
    return np.asarray(values[np.isnan(curve.find(values))])


def _pieces(
    solver: Solver, branches: Sequence[Branch], curve: ArcCurve, low: float, high: float
) -> tuple[Piece, ...]:
    driven = solver.single
    cuts = np.unique(
        np.concatenate(
            [
                curve.dead_points(driven).places,
                curve.at_input(driven, low).places,
                curve.at_input(driven, high).places,
            ]
        )
    )
    if curve.closed:
        first = cuts[0] if len(cuts) else 0.0
        cuts = np.append(cuts if len(cuts) else first, first + curve.length)
    else:
        cuts = np.concatenate([[0.0], cuts, [curve.length]])
    cuts = cuts[np.append(True, np.diff(cuts) > SAME_CONFIGURATION)]
    starts, stops = cuts[:-1], cuts[1:]
    middles = curve.at(0.5 * (starts + stops)).values
    q = low + np.mod(middles[:, driven] - low, 2.0 * np.pi)
    inside = q <= high
    numbers = _branches_at(solver, branches, curve, middles[inside], q[inside])
    return tuple(
        Piece(number, float(start), float(stop))
        for number, start, stop in zip(numbers, starts[inside], stops[inside], strict=True)
    )


def _branches_at(
    solver: Solver, branches: Sequence[Branch], curve: ArcCurve, values: Floats, q: Floats
) -> list[int | None]:
    """Return the branch that has each configuration (n, variables) at its input (n,)."""
    numbers: NDArray[np.object_] = np.full(len(q), None, dtype=object)
    for branch in branches:
        there = solver.evaluate(branch, q[:, None]).values
        gap = np.max(np.abs(curve.wrapped(there - values)), axis=1)
        numbers[gap < SAME_CONFIGURATION] = branch.number
    return list(numbers)
