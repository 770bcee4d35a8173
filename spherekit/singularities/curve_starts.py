"""Where singular configurations are looked for: on slices, or from random starts."""

from collections.abc import Iterator, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.completeness import Completeness, Guarantee, TimeLimit
from spherekit.errors import AnalysisError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import starting_range
from spherekit.singularities.several_inputs import LocusName, SingularityReport
from spherekit.singularities.slices import (
    LockedInputSection,
    LocusPoints,
    SingularityLocus,
    cut,
    seeds,
    solver_of,
)
from spherekit.singularities.stationarity import output_of
from spherekit.tolerances import CLOSURE_TOLERANCE

CLOSING_STEPS = 40
"""Newton's steps that a random start may take to closed loops."""
LOCUS_STEPS = 30
"""The same from there to the locus."""
STARTS = 256
"""Random starts of one round."""
PROBES = 64
"""Random starts by which it is told whether every configuration is singular."""
SECTIONS = 16
"""Curves on slices that are searched at once."""
DRY = 3
"""Rounds in a row without news that end a search."""
MOST_ROUNDS = 12
SEED = 20240616
FOR_SLICES = 0.6
"""Part of the time that slices may take."""


class StartPoints:
    """Batches of points of a locus, from slices if there are any, else from random starts.

    Whoever reads them tells by `met` that a batch had news: random starts end after
    some rounds without.

    Parameters
    ----------
    mechanism, inputs
        The mechanism, and how many inputs it has to have.
    kind, output, pointing
        What is looked for.
    made
        The slices that are there already.
    slices_of_each
        Values at which each input is locked, for slices if there are none; or 0.
    budget
        Time to spend.

    Attributes
    ----------
    view
        The mechanism, and what is looked for.
    everywhere
        Whether all configurations are looked for, so that nothing is.

    Raises
    ------
    AnalysisError, PlanError
        If there are not so many inputs with a freedom each, no such output, or type I of
        a direction is asked for that they never leave at rest along a locus only.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: int,
        kind: LocusName,
        output: str | None,
        pointing: str | Sequence[float] | None,
        made: LockedInputSection | None,
        slices_of_each: int,
        budget: TimeLimit | None,
    ) -> None:
        rest = output_of(mechanism, output, pointing)
        solver = solver_of(mechanism)
        if len(solver.driven) != inputs:
            raise AnalysisError(
                f"{mechanism.name} has {len(solver.driven)} inputs; curves of singular "
                "configurations are those of a mechanism with two, surfaces those of three"
            )
        if kind == "I" and rest.count < inputs:
            raise AnalysisError(
                f"{mechanism.name}: three inputs move a direction in more ways than it "
                "has; ask for type I of the link's orientation, without `pointing`"
            )
        self.view = SingularityReport.of(solver, rest, kind)
        self.budget, self.cut = budget or TimeLimit(), made
        self.everywhere = everywhere(self.view)
        if made is None and slices_of_each and not self.everywhere:
            share = self.budget.part(FOR_SLICES)
            self.cut = cut(solver, ranges_of(mechanism), slices_of_each, share)
        self.starts = self.hits = self.searched = 0
        self._dry = 0

    def batches(self) -> Iterator[LocusPoints]:
        """Yield points of the locus, as long as that is worth the time."""
        if self.everywhere:
            return
        for points in self._of_random_starts() if self.cut is None else self._on(self.cut):
            self.hits += len(points)
            yield points

    def _on(self, section: LockedInputSection) -> Iterator[LocusPoints]:
        every = section.slices
        for first in range(0, len(every), SECTIONS):
            if not self.budget.goes_on(f"slice curve {first + 1} of {len(every)}"):
                return
            some = every[first : first + SECTIONS]
            self.searched += len(some)
            yield LocusPoints.joined([seeds(one, self.view.locus) for one in some])

    def _of_random_starts(self) -> Iterator[LocusPoints]:
        random = np.random.default_rng(SEED)
        solver = self.view.solver
        for number in range(MOST_ROUNDS):
            words = f"round {number + 1} of random starts"
            if self._dry >= DRY or not self.budget.goes_on(words):
                return
            values = closed_configurations(solver, STARTS, random)
            self.starts += STARTS
            self._dry += 1
            yield points_from(self.view.locus, values, solver.driven)

    def met(self) -> None:
        """Say that the last batch had news."""
        self._dry = 0

    def claim(self, what: str) -> Completeness:
        """Return what is known of curves or surfaces (`what`) that were not found."""
        if self.everywhere:
            words = f"all configurations that {PROBES} random starts led to are of it"
            return Completeness(Guarantee.SAMPLED, words)
        notes = [self.budget.note]
        if self.cut is None:
            reason = (
                f"{self.starts} random starts in the ranges of the inputs led to "
                f"{self.hits} singular configurations, the last {self._dry * STARTS} to no "
                f"{what} not known before"
            )
        else:
            notes = [self.cut.note, *notes]
            reason = f"{self.searched} curves on slices were searched"
            if not any(notes):
                sides = " by ".join(f"{np.degrees(gap):.3g}" for gap in self.cut.gaps)
                reason = f"but for {what}s within a box of {sides} deg between slices"
                return Completeness(Guarantee.TO_BOX, reason, max(self.cut.gaps))
        return Completeness(Guarantee.SAMPLED, "; ".join(filter(None, [reason, *notes])))


def ranges_of(mechanism: Mechanism) -> list[tuple[float, float]]:
    """Return the lowest and highest value (rad) of each input that is looked at."""
    return [item.range for item in mechanism.inputs]


def closed_configurations(
    solver: PositionSolver, count: int, random: np.random.Generator
) -> Floats:
    """Return the closed configurations (n, V) that random starts lead to.

    Inputs are spread over their ranges and held. With them what wheels in mesh have
    rolled, where that is known.
    """
    low, high = starting_range(solver.closure)
    start = random.uniform(low, high, (count, len(low)))
    held = list(solver.driven)
    first, last = np.transpose(ranges_of(solver.mechanism))
    start[:, held] = random.uniform(first, last, (count, len(held)))
    meshes = solver.gear_phases
    if meshes is not None and meshes.all_known:
        start[:, list(meshes.variables)] = meshes.rolled_lengths(start[:, held])
        held += meshes.variables
    solution = solver.closure.solve(start, held, iterations=CLOSING_STEPS)
    return solution.values[solution.gap < CLOSURE_TOLERANCE]


def everywhere(view: SingularityReport) -> bool:
    """Return whether every configuration that random starts lead to is on the locus.

    What has no more freedoms than the locus has is not looked for on curves or surfaces.
    """
    values = closed_configurations(view.solver, PROBES, np.random.default_rng(SEED))
    return len(values) > 0 and bool(np.all(view.is_own(view.types(values))))


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def points_from(
    locus: SingularityLocus, values: Floats, driven: Sequence[int]
) -> LocusPoints:
    """Return the points of a locus that configurations (n, V) lead to.

    All `driven` variables but one are held, one after the other free, so that the others
    stay in their ranges; or none, as by the shortest way alone crossings of it are met.
    """
    every = np.eye(values.shape[1])[list(driven)]
    ways = [*(np.delete(every, free, 0) for free in range(len(every))), 0.0 * every[1:]]
    borders = np.array(ways)[np.arange(len(values)) % len(ways)]
    motion = locus.measure(locus.space(values)).motion
    targets = np.matvec(borders, values)
    points = locus.correct(values, motion, borders, targets, most=LOCUS_STEPS)
    return points.rows(points.good)
