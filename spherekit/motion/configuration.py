"""All configuration curves of a mechanism, and the branches that lie on each.

A branch is one assembly mode over the range of an input; it ends where the input has a
dead centre, and there another one begins. Followed in arc length they are one curve.

The curves do not depend on which pair is called the input. So they are looked for with
the pair whose modes, and the inputs at which these meet, are known with the least work;
what the given input says is an independent check.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.checked import checked
from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.branches import Branch, Solver
from spherekit.motion.curve_search import CurveSearch
from spherekit.motion.dead_inputs import dead_inputs
from spherekit.motion.drive import easiest_drive
from spherekit.motion.stretches import Stretches
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Inputs over the range from which curves are followed where none is known yet."""
SAME_CONFIGURATION = 1e-6
"""A branch and a curve whose variables differ by less (rad) agree."""
STEP = np.radians(2.0)
"""Distance (rad) of inputs with all modes where those at which they meet are not known."""


@final
@dataclass(frozen=True)
class Piece:
    """The part of a curve from `start` to `stop` (s in rad) that is one branch.

    The input only rises or only falls in it and lies in its range. `branch` is None for
    what the curve reaches and none of the branches given holds: a mode that the search for
    them missed, or wheels in mesh a turn later. `stop` may be
    beyond the length of a closed curve: the piece holds the point s = 0. `shift` (rad) is
    by how much the input is greater than on the curve: in a range of several turns the same
    part of a curve is as many pieces.
    """

    branch: int | None
    start: float
    stop: float
    shift: float


@final
@dataclass(frozen=True)
class ConfigurationCurve:
    """A curve and its pieces within the input range, in order of arc length."""

    curve: ArcCurve
    pieces: tuple[Piece, ...]


@final
@dataclass(frozen=True)
class Configurations:
    """The configuration curves that meet an input range, and what is known of others.

    Attributes
    ----------
    curves
        Those found.
    claim
        What is guaranteed: no curve is missing, none that the pair `drive` turns by more
        than a box along, or none that a search met.
    drive
        Name of the pair by whose values the curves were looked for.
    inputs, counts
        (k,) values (rad) of the given input at which all real modes were found, or
        looked for, on their own, and (k,) how many there are.
    mismatches
        What the checks found wrong, in words: inputs at which the modes and the curves
        do not agree, dead points that modes do not meet at. Empty if all agrees.
    """

    curves: tuple[ConfigurationCurve, ...]
    claim: Claim
    drive: str
    inputs: Floats
    counts: NDArray[np.int64]
    mismatches: tuple[str, ...]

    @property
    def guarantee(self) -> Guarantee:
        """The guarantee of the claim."""
        return self.claim.guarantee

    @property
    def box(self) -> float:
        """The size of the box (rad) to which no curve is missing, 0 without one."""
        return self.claim.box


@checked(SolveError)
def configuration_curves(
    solver: Solver,
    branches: Sequence[Branch],
    low: float,
    high: float,
    longest: float = 200.0,
    step: float = STEP,
) -> Configurations:
    """Return the configuration curves of a mechanism that meet an input range.

    Parameters
    ----------
    solver, branches
        The mechanism, and its branches over inputs from `low` to `high` (rad).
    longest
        Length (rad) after which a curve that does not close is ended.
    step
        Distance (rad) of the inputs at which all modes are looked for where it is not
        known at which inputs they meet.
    """
    found = CurveSearch(solver, low, high, longest)
    inputs = np.linspace(low, high, PROBED)
    for branch in branches:
        there = solver.evaluate(branch, inputs[:, None])
        found.add(there.values[there.status == Status.OK])
    drive = easiest_drive(solver)
    dead = dead_inputs(drive, *((low, high) if drive is solver else (-np.pi, np.pi)))
    claim = found.sweep(drive, dead, step)
    complete = claim.guarantee is not Guarantee.SAMPLED
    if not complete:
        claim = found.search()
    found.cross()
    stretches = [
        Stretches.of(each, solver.single, low, high, *solver.periods)
        for each in found.curves
    ]
    found.count(stretches, complete)
    if complete:
        found.compare(drive, dead)
    if found.problems:
        words = f"{len(found.problems)} checks failed, the first: {found.problems[0]}"
        claim = Claim(Guarantee.SAMPLED, words)
    inputs, counts = np.array(found.counted).reshape(-1, 2).T
    return Configurations(
        tuple(
            ConfigurationCurve(curve, _pieces(solver, branches, curve, parts))
            for curve, parts in zip(found.curves, stretches, strict=True)
            if len(parts.starts)
        ),
        claim,
        drive.mechanism.pairs[drive.assembly.input].name,
        inputs,
        counts.astype(np.int64),
        tuple(found.problems),
    )


def _pieces(
    solver: Solver, branches: Sequence[Branch], curve: ArcCurve, stretches: Stretches
) -> tuple[Piece, ...]:
    """Return the parts of a curve within the input range, each with its branch."""
    q = stretches.middles[:, solver.single]
    numbers = _branches_at(solver, branches, curve, stretches.middles, q)
    return tuple(
        Piece(number, float(start), float(stop), float(shift))
        for number, start, stop, shift in zip(
            numbers, stretches.starts, stretches.stops, stretches.shifts, strict=True
        )
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
