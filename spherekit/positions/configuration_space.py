"""All configuration curves of a mechanism, and the assembly modes that lie on each.

An assembly mode is followed over the range of an input; it ends where the input has a
dead centre, and there another one begins. Followed in arc length they are one curve.

The curves do not depend on which pair is called the input. So they are looked for with
the pair whose modes, and the inputs at which these meet, are known with the least work;
what the given input says is an independent check.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Integers
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.assembly_enumeration import RANGE_ROUNDS, assemblies, random_starts
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.curve_crossing import find_outgoing_points
from spherekit.positions.driving_pair import choose_driving_pair
from spherekit.positions.input_revolutions import in_range, turns_in_range
from spherekit.positions.input_turning_points import (
    InputTurningPoints,
    input_turning_points,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SEED, SearchStatistics
from spherekit.progress import ProgressReporter
from spherekit.status import Status
from spherekit.wording import counted

PROBED = 181
"""Inputs over the range from which curves are followed where none is known yet."""
SAME_CONFIGURATION = 1e-6
"""An assembly mode and a curve whose variables differ by less (rad) agree."""
LONGEST = 200.0
"""Length (rad) after which a curve that does not close is ended in each sense. Where wheels
count turns of the input, and return within twice as much, it gets the length to close."""
LAP = 8.0
"""A lap of a curve is shorter than so many periods of the input."""
STEP = np.radians(2.0)
"""Distance (rad) of inputs with all modes where those at which they meet are not known."""
SHORTEST = 1e-6
"""Cuts of a curve (rad) nearer to each other than this are one."""
CHECKED = 12
"""Inputs over the range at which modes are counted besides those they were sought at."""
MOST_CURVES = 64
"""Curves that are followed; a chain of many dyads can have more."""
NEAR_DEAD = 1e-6
"""Inputs (rad) nearer to a dead point than this are not counted at."""
NEAR_CROSSING = 1e-3
"""Configurations (rad) nearer to a crossing of curves than this are not start of one."""


class Piece(NamedTuple):
    """The part of a curve from `start` to `stop` (s in rad) that is one assembly mode.

    The input only rises or only falls in it, from `lowest` to `highest`, and lies in its
    range. `assembly_mode` is None for what the curve reaches and none of the assembly modes
    given holds: a mode that the search for them missed, or wheels in mesh a turn later.
    `stop` may be beyond the length of a closed curve: the piece holds the point s = 0.
    `shift` (rad) is by how much the input is greater than on the curve: in a range of
    several turns the same part of a curve is as many pieces. `middle` (variables,) is its
    middle point, the input in the range.
    """

    assembly_mode: int | None
    middle: Floats
    start: float
    stop: float
    shift: float
    lowest: float
    highest: float


def monotone_pieces(
    curve: ArcCurve, driven: int, low: float, high: float, period: float
) -> list[Piece]:
    """Return the parts of a curve on which an input only rises or falls, in order.

    Those of a range of the variable `driven`, from `low` to `high` (rad), their assembly
    modes unknown. Where the range is longer than what the curve returns with, the same part
    is there again for each time that the input passes it. A curve on which the input stands
    still is one part. `period` is the growth of the variable with which the same
    configurations return, infinite where only the curve itself can say so.
    """
    period = curve.returns_after(driven, period)
    zeros = (
        curve.dead_points(driven),
        curve.at_input(driven, low, period),
        curve.at_input(driven, high, period),
    )
    cuts = np.unique(np.concatenate([zero.places for zero in zeros]))
    if curve.closed:
        cuts = cuts if len(cuts) else np.zeros(1)
        cuts = np.append(cuts, cuts[0] + curve.length)
    else:
        cuts = np.concatenate([[0.0], cuts, [curve.length]])
    cuts = cuts[np.append(True, np.diff(cuts) > SHORTEST)]
    middles = curve.at(0.5 * (cuts[:-1] + cuts[1:])).values
    turned, which = turns_in_range(middles[:, driven], low, high, period)
    inside = in_range(turned, low, high)
    which = which[inside]
    ends = cuts[[which, which + 1]]
    middles = middles[which]
    shifts = turned[inside] - middles[:, driven]
    middles[:, driven] = turned[inside]
    inputs = [curve.at(end).values[:, driven] + shifts for end in ends]
    numbers = [*ends, shifts, np.minimum(*inputs), np.maximum(*inputs)]
    return list(map(Piece, [None] * len(which), middles, *np.array(numbers).tolist()))


class ConfigurationCurve(NamedTuple):
    """A curve and its pieces within the input range, in order of arc length."""

    curve: ArcCurve
    pieces: tuple[Piece, ...]


class Configurations(NamedTuple):
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
        What the checks found wrong, in words: inputs at which the modes and the curves do
        not agree. Empty if all agrees.
    """

    curves: tuple[ConfigurationCurve, ...]
    claim: Completeness
    drive: str
    inputs: Floats
    counts: Integers
    mismatches: Names

    @property
    def guarantee(self) -> Guarantee:
        """The guarantee of the claim."""
        return self.claim.guarantee


@checked(SolveError)
def configuration_curves(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    low: float,
    high: float,
) -> Configurations:
    """Return the configuration curves of a mechanism that meet an input range.

    Parameters
    ----------
    solver, assembly modes
        The mechanism, and its assembly modes over inputs from `low` to `high` (rad).
    """
    (period,) = solver.periods
    longest = LONGEST if period > 2.0 * LONGEST else max(LONGEST, LAP * period)
    search = _CurveSearch(solver, low, high, longest)
    inputs = np.linspace(low, high, PROBED)
    for assembly_mode in assembly_modes:
        there = solver.evaluate(assembly_mode, inputs[:, None])
        search.add(there.values[there.status == Status.OK])
    reference = solver.reference
    if reference is not None and low <= reference[solver.input_variable] <= high:
        search.add(reference[None])  # where the input stands still no mode goes through it
    drive = choose_driving_pair(solver)
    dead = input_turning_points(
        drive, *((low, high) if drive is solver else (-np.pi, np.pi))
    )
    claim = search.sweep(drive, dead)
    complete = claim.guarantee is not Guarantee.SAMPLED
    if not complete:
        claim = search.search()
    # On some curves that cross others the input may stand still: no input leads to them.
    for end in _crossing_ends(search.curves):  # which grow on the way
        search.add(find_outgoing_points(solver.closure, end))
    parts = [
        monotone_pieces(curve, solver.input_variable, low, high, period)
        for curve in search.curves
    ]
    search.count([part for one in parts for part in one], complete)
    if search.problems:
        failed = counted(len(search.problems), "check")
        claim = Completeness(
            Guarantee.SAMPLED, f"{failed} failed, the first: {search.problems[0]}"
        )
    inputs, counts = np.array(search.counted).reshape(-1, 2).T
    return Configurations(
        tuple(
            ConfigurationCurve(curve, _assigned(solver, assembly_modes, curve, pieces))
            for curve, pieces in zip(search.curves, parts, strict=True)
            if pieces
        ),
        claim,
        drive.mechanism.pairs[drive.assembly.input].name,
        inputs,
        counts.astype(np.int64),
        tuple(search.problems),
    )


def _assigned(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    curve: ArcCurve,
    pieces: Sequence[Piece],
) -> tuple[Piece, ...]:
    """Return pieces of a curve, each with the mode whose configuration its middle is."""
    assigned = list(pieces)
    middles = np.array([piece.middle for piece in pieces])
    for assembly_mode in assembly_modes:
        there = solver.evaluate(assembly_mode, middles[:, [solver.input_variable]]).values
        gap = max_abs(curve.wrapped(there - middles), axis=1)
        for row in np.flatnonzero(gap < SAME_CONFIGURATION):
            assigned[row] = assigned[row]._replace(assembly_mode=assembly_mode.number)
    return tuple(assigned)


class _CurveSearch:
    """The curves found so far over a range of the input, and what went wrong on the way.

    `counted` are inputs and the numbers of real modes that were found there without the
    curves; `problems` says in words what does not agree.
    """

    def __init__(
        self, solver: PositionSolver, low: float, high: float, longest: float
    ) -> None:
        self.solver = solver
        self.low = low
        self.high = high
        self.longest = longest
        self.curves: list[ArcCurve] = []
        self.counted: list[tuple[float, int]] = []
        self.problems: list[str] = []

    def add(self, values: Floats) -> None:
        """Follow new curves from configurations (n, variables)."""
        failed: list[tuple[Floats, str]] = []
        for curve in self.curves:
            values = values[~curve.passes(values)]
        while len(values):
            middle = len(values) // 2
            given = values[middle]
            values = np.delete(values, middle, axis=0)
            try:
                curve = follow_arc(self.solver.closure, given, longest=self.longest)
            except SolveError as problem:
                failed.append((given, str(problem)))
                continue
            self.curves.append(curve)
            values = values[~curve.passes(values)]
        for given, words in failed:
            # a curve that ends there may do so because others cross it
            if not any(
                max_abs(curve.wrapped(given - end)) < NEAR_CROSSING
                for curve in self.curves
                for end in _crossing_ends([curve])
            ):
                self.problems.append(words)

    def sweep(self, drive: PositionSolver, dead: InputTurningPoints) -> Completeness:
        """Follow the curves of all modes of `drive` between its dead inputs."""
        for q in dead.probes(STEP):
            here = assemblies(drive, np.array([q]))
            if not here.is_complete:
                return Completeness(
                    Guarantee.SAMPLED, "no elimination finds all modes at an input"
                )
            if drive is self.solver:
                self.counted.append((q, len(here.values)))
            self.add(here.values)
        return dead.claim(STEP)

    def search(self) -> Completeness:
        """Follow the curves that random starts over the range lead to.

        The starts are others than those by which a run finds its assembly modes, so that
        how often they met the curves known before says what both may have missed.
        """
        if self.solver.gear_phases is not None and not self.solver.gear_phases.all_known:
            return Completeness(
                Guarantee.COMPONENT, "wheels in mesh as in the assembly modes given"
            )
        low = np.array([self.low])
        starts = random_starts(self.solver, low, np.array([self.high]), seed=SEED + 1)
        census = SearchStatistics(len(self.solver.mechanism.variable_owners), RANGE_ROUNDS)
        working = ProgressReporter("searching the configuration curves")
        while census.goes_on and len(self.curves) < MOST_CURVES:
            made, values, _ = next(starts)
            self.add(values)
            met = np.full(len(values), -1, dtype=np.intp)
            for number, curve in enumerate(self.curves):
                met[curve.passes(values)] = number
            census.add(made, met, len(self.curves))
            working.tell(lambda: census.words("curves"))
        return Completeness(Guarantee.SAMPLED, census.words("curves"))

    def count(self, pieces: Sequence[Piece], complete: bool) -> None:
        """Compare the number of modes with that of the curves' crossings.

        Where the modes at an input are complete, at inputs spread over the range too.
        """
        if complete:
            for q in np.linspace(self.low, self.high, 2 * CHECKED + 1)[1::2]:
                here = assemblies(self.solver, np.array([q]))
                if here.is_complete:
                    self.counted.append((q, len(here.values)))
        lows, highs = np.array([(p.lowest, p.highest) for p in pieces]).reshape(-1, 2).T
        crossed = np.array(
            [end[self.solver.input_variable] for end in _crossing_ends(self.curves)]
        )
        for q, modes in self.counted:
            away = np.min(np.abs([lows - q, highs - q]), initial=np.inf)
            past = np.min(np.abs(wrap(crossed - q)), initial=np.inf)
            if away < NEAR_DEAD or past < NEAR_CROSSING:
                continue
            crossings = np.sum((lows < q) & (q < highs))
            if crossings < modes or (complete and crossings != modes):
                self.problems.append(
                    f"at the input {np.degrees(q):.6g} deg there are {modes} modes, but "
                    f"the curves have {crossings}"
                )


def _crossing_ends(curves: Iterable[ArcCurve]) -> Iterator[Floats]:
    """Yield the last nodes (variables,) of curves that end because others cross them."""
    for curve in curves:
        for why, end in zip(curve.ends, curve.nodes.values[[0, -1]], strict=True):
            if why == Status.AT_SINGULARITY:
                yield end
