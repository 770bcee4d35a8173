"""All configuration curves of a mechanism, and the assembly modes that lie on each.

An assembly mode is followed over the range of an input; it ends where the input has a
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
from spherekit.conventions import Status, counted
from spherekit.errors import SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.curve_search import CurveSearch
from spherekit.motion.driving_pair import easiest_drive
from spherekit.motion.input_turning_points import input_turning_points
from spherekit.motion.monotone_segments import MonotoneSegments
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Inputs over the range from which curves are followed where none is known yet."""
SAME_CONFIGURATION = 1e-6
"""An assembly mode and a curve whose variables differ by less (rad) agree."""
LAP = 8.0
"""A lap of a curve is shorter than so many periods of the input."""
STEP = np.radians(2.0)
"""Distance (rad) of inputs with all modes where those at which they meet are not known."""


@final
@dataclass(frozen=True)
class Piece:
    """The part of a curve from `start` to `stop` (s in rad) that is one assembly mode.

    The input only rises or only falls in it and lies in its range. `assembly_mode` is None
    for what the curve reaches and none of the assembly modes given holds: a mode that the
    search for them missed, or wheels in mesh a turn later. `stop` may be beyond the length
    of a closed curve: the piece holds the point s = 0. `shift` (rad) is by how much the
    input is greater than on the curve: in a range of several turns the same part of a curve
    is as many pieces.
    """

    assembly_mode: int | None
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


@checked(SolveError)
def configuration_curves(
    solver: Solver,
    assembly_modes: Sequence[AssemblyMode],
    low: float,
    high: float,
    longest: float = 200.0,
    step: float = STEP,
) -> Configurations:
    """Return the configuration curves of a mechanism that meet an input range.

    Parameters
    ----------
    solver, assembly modes
        The mechanism, and its assembly modes over inputs from `low` to `high` (rad).
    longest
        Length (rad) after which a curve that does not close is ended in each sense. Where
        wheels count turns of the input, and return within twice as much, a curve is given
        the length to close.
    step
        Distance (rad) of the inputs at which all modes are looked for where it is not
        known at which inputs they meet.
    """
    (period,) = solver.periods
    if period <= 2.0 * longest:
        longest = max(longest, LAP * float(period))
    search = CurveSearch(solver, low, high, longest)
    inputs = np.linspace(low, high, PROBED)
    for assembly_mode in assembly_modes:
        there = solver.evaluate(assembly_mode, inputs[:, None])
        search.add(there.values[there.status == Status.OK])
    reference = solver.geometry.reference
    if reference is not None and low <= reference[solver.single] <= high:
        search.add(reference[None])  # where the input stands still no mode goes through it
    drive = easiest_drive(solver)
    dead = input_turning_points(
        drive, *((low, high) if drive is solver else (-np.pi, np.pi))
    )
    claim = search.sweep(drive, dead, step)
    complete = claim.guarantee is not Guarantee.SAMPLED
    if not complete:
        claim = search.search()
    search.cross()
    monotone_segments = [
        MonotoneSegments.of(curve, solver.single, low, high, *solver.periods)
        for curve in search.curves
    ]
    search.count(monotone_segments, complete)
    if complete:
        search.compare(drive, dead)
    if search.problems:
        failed = counted(len(search.problems), "check")
        words = f"{failed} failed, the first: {search.problems[0]}"
        claim = Claim(Guarantee.SAMPLED, words)
    inputs, counts = np.array(search.counted).reshape(-1, 2).T
    pieces = _pieces(solver, assembly_modes, search.curves, monotone_segments)
    return Configurations(
        tuple(
            ConfigurationCurve(curve, parts)
            for curve, parts in zip(search.curves, pieces, strict=True)
            if parts
        ),
        claim,
        drive.mechanism.pairs[drive.assembly.input].name,
        inputs,
        counts.astype(np.int64),
        tuple(search.problems),
    )


def _pieces(
    solver: Solver,
    assembly_modes: Sequence[AssemblyMode],
    curves: Sequence[ArcCurve],
    segments: Sequence[MonotoneSegments],
) -> list[tuple[Piece, ...]]:
    """Return the parts of curves within the input range, each with its assembly mode.

    That is the mode whose configuration at its middle is the curve's.
    """
    if not curves:
        return []
    middles = np.concatenate([parts.middles for parts in segments])
    numbers: NDArray[np.object_] = np.full(len(middles), None, dtype=object)
    for assembly_mode in assembly_modes:
        there = solver.evaluate(assembly_mode, middles[:, [solver.single]]).values
        gap = np.max(np.abs(curves[0].wrapped(there - middles)), axis=1)
        numbers[gap < SAME_CONFIGURATION] = assembly_mode.number
    modes = iter(numbers.tolist())
    return [
        tuple(
            Piece(next(modes), float(start), float(stop), float(shift))
            for start, stop, shift in zip(
                parts.starts, parts.stops, parts.shifts, strict=True
            )
        )
        for parts in segments
    ]
