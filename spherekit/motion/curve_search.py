"""Looking for the configuration curves of a mechanism, and checking what was found."""

from collections.abc import Iterable, Iterator
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.assemblies import assemblies
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.crossing import ways_out
from spherekit.motion.input_turning_points import InputTurningPoints
from spherekit.motion.monotone_segments import MonotoneSegments, turning_inputs
from spherekit.motion.range_search import RANGE_ROUNDS, RangeSearch
from spherekit.motion.search import SEED, STARTS, Census
from spherekit.numeric.turns import wrap
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

CHECKED = 12
"""Inputs over the range at which modes are counted besides those they were sought at."""
MOST_CURVES = 64
"""Curves that are followed; a chain of many dyads can have more."""
NEAR_DEAD = 1e-6
"""Inputs (rad) nearer to a dead point than this are not counted at."""
NEAR_CROSSING = 1e-3
"""Configurations (rad) nearer to a crossing of curves than this are not start of one."""
SAME_INPUT = 1e-5
"""Dead points (rad) found in two ways may differ by this."""


@final
class CurveSearch:
    """The curves found so far over a range of the input, and what went wrong on the way.

    `counted` are inputs and the numbers of real modes that were found there without the
    curves; `problems` says in words what does not agree.
    """

    def __init__(self, solver: Solver, low: float, high: float, longest: float) -> None:
        self.solver, self.low, self.high = solver, low, high
        self.longest = longest
        self.curves: list[ArcCurve] = []
        self.counted: list[tuple[float, int]] = []
        self.problems: list[str] = []

    def add(self, values: Floats) -> int:
        """Follow new curves from configurations (n, variables); return how many."""
        before = len(self.curves)
        failed: list[tuple[Floats, str]] = []
        while len(values):
            middle = len(values) // 2
            given, values = values[middle], np.delete(values, middle, axis=0)
            through = (c for c in self.curves if not len(_elsewhere(c, given[None])))
            curve = next(through, None)
            if curve is None:
                try:
                    curve = follow_arc(self.solver.closure, given, longest=self.longest)
                except SolveError as problem:
                    failed.append((given, str(problem)))
                    continue
                self.curves.append(curve)
            values = _elsewhere(curve, values)
        for given, words in failed:
            if not any(_ends_at(curve, given) for curve in self.curves):
                self.problems.append(words)
        return len(self.curves) - before

    def cross(self) -> None:
        """Follow the curves that cross those found, until there are no new ones.

        On some of them the input may stand still, so that no input leads to them.
        """
        for end in _crossing_ends(self.curves):  # which grow on the way
            self.add(ways_out(self.solver.closure, end))

    def sweep(self, drive: Solver, dead: InputTurningPoints, step: float) -> Claim:
        """Follow the curves of all modes of `drive` between its dead inputs."""
        for q in dead.probes(step):
            values, complete = _modes(drive, float(q))
            if not complete:
                words = "no elimination finds all modes at an input"
                return Claim(Guarantee.SAMPLED, words)
            if drive is self.solver:
                self.counted.append((float(q), len(values)))
            self.add(values)
        return dead.claim(step)

    def search(self) -> Claim:
        """Follow the curves that random starts over the range lead to.

        The starts are others than those by which a run finds its assembly modes, so that
        how often they met the curves known before says what both may have missed.
        """
        if self.solver.meshes is not None and not self.solver.meshes.all_known:
            return Claim(
                Guarantee.COMPONENT, "wheels in mesh as in the assembly modes given"
            )
        low, high = np.array([self.low]), np.array([self.high])
        starts = RangeSearch(self.solver, low, high, seed=SEED + 1)
        census = Census(len(self.solver.mechanism.variable_owners), RANGE_ROUNDS)
        working = Working("searching the configuration curves")
        while census.goes_on and len(self.curves) < MOST_CURVES:
            values, _ = starts.rounds()
            self.add(values)
            met = np.full(len(values), -1, dtype=np.intp)
            for number, curve in enumerate(self.curves):
                met[curve.passes(values)] = number
            census.add(STARTS, met, len(self.curves))
            working.tell(lambda: census.words("curves"))
        return Claim(Guarantee.SAMPLED, census.words("curves"))

    def count(self, monotone_segments: list[MonotoneSegments], complete: bool) -> None:
        """Compare the number of modes with that of the curves' crossings.

        Where the modes at an input are complete, at inputs spread over the range too.
        """
        if complete:
            parts = (np.arange(CHECKED) + 0.5) / CHECKED
            for q in self.low + parts * (self.high - self.low):
                values, all_found = _modes(self.solver, float(q))
                if all_found:
                    self.counted.append((float(q), len(values)))
        ends = np.array(
            [end for part in monotone_segments for end in (*part.lowest, *part.highest)]
        )
        crossed = np.array([end[self.solver.single] for end in _crossing_ends(self.curves)])
        for q, modes in self.counted:
            if np.min(np.abs(ends - q), initial=np.inf) < NEAR_DEAD:
                continue
            if np.min(np.abs(wrap(crossed - q)), initial=np.inf) < NEAR_CROSSING:
                continue
            crossings = sum(part.count(q) for part in monotone_segments)
            if crossings < modes or (complete and crossings != modes):
                self.problems.append(
                    f"at the input {np.degrees(q):.6g} deg there are {modes} modes, but "
                    f"the curves have {crossings}"
                )

    def compare(self, drive: Solver, dead: InputTurningPoints) -> None:
        """Check that curves turn back only where modes of `drive` meet."""
        name = drive.mechanism.pairs[drive.assembly.input].name
        for curve in self.curves:
            for q in turning_inputs(curve, drive.single, dead.low, *drive.periods):
                if not dead.has(q, SAME_INPUT):
                    self.problems.append(
                        f"{name} = {np.degrees(q):.6g} deg: a curve turns back, but no "
                        "modes meet"
                    )


def _modes(solver: Solver, q: float) -> tuple[Floats, bool]:
    """Return the variables (n, variables) of all modes at an input, and whether all."""
    modes = assemblies(solver, np.array([q]))
    count = len(solver.mechanism.variable_owners)
    values = np.array([values for _, values in modes.modes]).reshape(-1, count)
    return values, all(m is None or m.is_complete for m in modes.methods)


def _crossing_ends(curves: Iterable[ArcCurve]) -> Iterator[Floats]:
    """Yield the last nodes (variables,) of curves that end because others cross them."""
    for curve in curves:
        for why, end in zip(curve.ends, curve.nodes.values[[0, -1]], strict=True):
            if why == Status.AT_SINGULARITY:
                yield end


def _ends_at(curve: ArcCurve, values: Floats) -> bool:
    """Return whether a curve ends at a configuration because others cross it there."""
    return any(
        np.max(np.abs(curve.wrapped(values - end))) < NEAR_CROSSING
        for end in _crossing_ends([curve])
    )


def _elsewhere(curve: ArcCurve, values: Floats) -> Floats:
    return np.asarray(values[~curve.passes(values)])
