"""Search for points of a locus, from which curves and surfaces are then followed.

Points are singular configurations on slices with locked inputs, or are reached by Newton's
method from random configurations.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import AnalysisError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import starting_range
from spherekit.singularities.locus import LocusPoints, SingularityLocus
from spherekit.singularities.singularity_report import LocusName, SingularityReport
from spherekit.singularities.slices import (
    LockedInputSection,
    cut,
    singular_points_on_slice,
    solver_of,
)
from spherekit.singularities.stationarity import output_of
from spherekit.time_limit import TimeLimit
from spherekit.tolerances import CLOSURE_TOLERANCE
from spherekit.wording import counted

CLOSING_NEWTON_STEPS = 40
"""Largest number of Newton steps from a random start to closed loops. Larger: more
starts succeed; smaller: failures end sooner."""
RANDOM_LOCUS_NEWTON_STEPS = 30
"""Largest number of Newton steps from closed loops to the locus. Effects as above."""
CURVE_STARTS_PER_ROUND = 256
"""Number of random starts in one round. Larger: rounds without a new result are
stronger evidence; smaller: the search ends sooner."""
STARTS_OF_EVERYWHERE_TEST = 64
"""Number of random starts that decide whether every configuration is singular. Larger:
a type that is regular in few configurations only is noticed."""
SLICE_CURVES_AT_ONCE = 16
"""Number of curves of slices whose singular points form one batch. Larger: curves are
followed from more points at the same time, and the time limit is checked less often."""
MAX_ROUNDS_WITHOUT_RESULT = 3
"""Number of successive rounds of random starts without a new result that end a search."""
MAX_RANDOM_ROUNDS = 12
"""Largest number of rounds of random starts in a search."""
RANDOM_SEED = 20240616
"""Seed of the random starts, fixed so that results are repeatable."""
TIME_SHARE_OF_SLICES = 0.6
"""Part of the time limit that slices may take. The rest is for following the locus."""


class LocusPointSearch:
    """A search that yields singular configurations of one type in batches.

    The singular configurations come from slices or from random starts. A slice has the
    configurations in which all inputs but one are locked at given values. The caller
    reports by `record_new_result` that the last batch gave a new curve or surface. Random
    starts end after some rounds without a new result.

    Parameters
    ----------
    mechanism
        The mechanism.
    input_count
        Number of inputs that the mechanism must have.
    kind, output, pointing
        Type of singularity, and the output (see
        `spherekit.singularities.stationarity.output_of`).
    section
        Slices that were followed before, or None.
    slices_of_each
        Number of values at which each input is locked, if `section` is None. With 0, random
        starts are used.
    time_limit
        Processor time to spend; None for unlimited.

    Attributes
    ----------
    report
        The locus (all singular configurations of the type), and the methods that compute
        inputs, poses and types of its points.
    section
        The slices, or None with random starts.
    is_everywhere
        Whether every configuration is on the locus, so that no points are yielded.

    Raises
    ------
    AnalysisError, ModelError, PlanError
        If the mechanism does not have `input_count` inputs and as many degrees of freedom,
        if it has no such output, or if `slices_of_each` is negative. Also if type I of a
        direction is asked for with three inputs, because every configuration is then of
        this type.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        input_count: int,
        kind: LocusName,
        output: str | None,
        pointing: str | Sequence[float] | None,
        section: LockedInputSection | None,
        slices_of_each: int,
        time_limit: TimeLimit | None,
    ) -> None:
        """Check the request, and follow slices if the search starts from slices.

        The search yields singular configurations of one type. Points are searched on
        slices, which are curves of configurations with all inputs but one locked.

        Parameters
        ----------
        mechanism
            The mechanism.
        input_count
            Number of inputs that it must have.
        kind
            Type of singularity: "I" if inputs can move while the output rests, "II" if the
            output can move while the inputs rest, or another `LocusName`.
        output, pointing
            The output: the orientation of a link, or one direction fixed in it.
        section
            Slices that were followed before, or None.
        slices_of_each
            Number of values at which each input is locked, if there are no slices yet. With
            0, points are searched from random starts.
        time_limit
            Processor time to spend; None for unlimited.
        """
        if slices_of_each < 0:
            raise AnalysisError(
                f"{mechanism.name}: slices_of_each is {slices_of_each}; it has to be 0 or "
                "more"
            )
        # The linear equations that the rates satisfy if the output rests.
        output_condition = output_of(mechanism, output, pointing)
        solver = solver_of(mechanism)
        if len(solver.driven) != input_count:
            raise AnalysisError(
                f"{mechanism.name} has {counted(len(solver.driven), 'input')}, not "
                f"{input_count}; "
                "singular_curves is for two inputs, and singular_surface for three"
            )
        # If the output rests, the rates of the inputs satisfy `equation_count` equations: 3
        # for an orientation, 2 for a direction. With more inputs than equations, inputs can
        # move while the output rests in every configuration, so all are of type I.
        if kind == "I" and output_condition.equation_count < input_count:
            raise AnalysisError(
                f"{mechanism.name}: the direction of an output has two degrees of freedom, "
                "but there are three inputs; leave out `pointing` to get the singularities "
                "of type I for the orientation of the link"
            )
        self.report = SingularityReport.for_output(solver, output_condition, kind)
        self.time_limit = time_limit or TimeLimit()
        self.section = section
        self.is_everywhere = is_singular_everywhere(self.report)
        # No points are yielded if every configuration is singular, so no slices are
        # followed.
        if section is None and slices_of_each and not self.is_everywhere:
            # The rest of the time is for following curves or surfaces from the points.
            slice_limit = self.time_limit.part(TIME_SHARE_OF_SLICES)
            self.section = cut(solver, ranges_of(mechanism), slices_of_each, slice_limit)
        # Counters of the search, which decide when the search ends, and which
        # `completeness` reports.
        self._random_starts = 0
        self._singular_points = 0
        self._searched_slice_curves = 0
        self._rounds_without_result = 0

    def batches(self) -> Iterator[LocusPoints]:
        """Yield singular configurations until the search or the time limit ends."""
        if self.is_everywhere:
            return
        if self.section is None:
            batches = self._batches_from_random_starts()
        else:
            batches = self._batches_on_slices(self.section)
        for points in batches:
            self._singular_points += len(points)
            yield points

    def _batches_on_slices(self, section: LockedInputSection) -> Iterator[LocusPoints]:
        """Yield singular configurations that are found on the curves of slices.

        A slice is the set of configurations in which all inputs but one are locked at
        certain values. It consists of curves. Each batch has the singular configurations on
        up to `SLICE_CURVES_AT_ONCE` curves. The search ends early if the time limit is
        reached, which is tested before each batch.

        Parameters
        ----------
        section
            The curves of all slices.
        """
        curves = section.slices
        for first in range(0, len(curves), SLICE_CURVES_AT_ONCE):
            if not self.time_limit.goes_on(f"slice curve {first + 1} of {len(curves)}"):
                return
            chunk = curves[first : first + SLICE_CURVES_AT_ONCE]
            self._searched_slice_curves += len(chunk)
            yield LocusPoints.concatenate(
                [singular_points_on_slice(curve, self.report.locus) for curve in chunk]
            )

    def _batches_from_random_starts(self) -> Iterator[LocusPoints]:
        """Yield the singular configurations that rounds of random starts lead to."""
        random = np.random.default_rng(RANDOM_SEED)
        solver = self.report.solver
        for number in range(MAX_RANDOM_ROUNDS):
            if self._rounds_without_result >= MAX_ROUNDS_WITHOUT_RESULT:
                return
            if not self.time_limit.goes_on(f"round {number + 1} of random starts"):
                return
            values = closed_configurations(solver, CURVE_STARTS_PER_ROUND, random)
            self._random_starts += CURVE_STARTS_PER_ROUND
            self._rounds_without_result += 1
            yield points_from(self.report.locus, values, solver.driven)

    def record_new_result(self) -> None:
        """Record that the last batch gave a curve or surface that was not known before."""
        self._rounds_without_result = 0

    def completeness(self, item: str) -> Completeness:
        """Return what is known of curves or surfaces that the search may have missed.

        The search looks for singular configurations of one type. There are three cases:

        - Every configuration of the mechanism is singular (`is_everywhere`), so there are
          no curves or surfaces.
        - The search used slices: curves of configurations with all inputs but one locked. A
          curve or surface that crosses no slice is missed. Such a curve or surface is so
          small that it lies between neighbouring slices.
        - The search used random starts (`section` is None), of which nothing is known about
          what was missed.

        Parameters
        ----------
        item
            The kind of result, in the singular: ``"curve"`` or ``"surface"``.
        """
        if self.is_everywhere:
            reason = (
                f"all configurations that {STARTS_OF_EVERYWHERE_TEST} random starts led to "
                "are singular of this type"
            )
            return Completeness(Guarantee.SAMPLED, reason)
        if self.section is None:
            return self._completeness_of_random_starts(item)
        # Notes say what was left out because of a time limit, and can be empty.
        notes = [self.section.note, self.time_limit.note]
        if any(notes):
            reason = f"{self._searched_slice_curves} curves on slices were searched"
            return Completeness(Guarantee.SAMPLED, _join_reasons([reason, *notes]))
        return _completeness_between_slices(item, self.section.gaps)

    def _completeness_of_random_starts(self, item: str) -> Completeness:
        """Return how many random starts were used, and how many led to nothing new.

        From a start Newton's method can reach a singular configuration. The caller of the
        search then follows the curve or surface of singular configurations from there.

        Parameters
        ----------
        item
            The kind of result, in the singular: ``"curve"`` or ``"surface"``.
        """
        starts_without_result = self._rounds_without_result * CURVE_STARTS_PER_ROUND
        reason = (
            f"{self._random_starts} random starts in the ranges of the inputs led to "
            f"{self._singular_points} singular configurations; the last "
            f"{starts_without_result} starts led to no new {item}"
        )
        # The note says what was left out because of the time limit, and can be empty.
        reasons = [reason, self.time_limit.note]
        return Completeness(Guarantee.SAMPLED, _join_reasons(reasons))


def _completeness_between_slices(item: str, gaps: Sequence[float]) -> Completeness:
    """Return the statement that a search in slices can only have missed small items.

    The items are curves or surfaces of singular configurations. A slice has the
    configurations in which all inputs but one are locked at given values. An item that is
    smaller than the gaps can lie between the slices.

    Parameters
    ----------
    item
        The kind of result, in the singular: ``"curve"`` or ``"surface"``.
    gaps
        For each input, the distance (rad) between its neighbouring locked values.
    """
    sides = " by ".join(f"{np.degrees(gap):.3g}" for gap in gaps)
    # The short form follows the words "complete to a box of 10 deg:".
    short_form = f"but for {item}s within a box of {sides} deg between slices"
    sentence = (
        f"complete, except perhaps for {item}s that are so small that they lie "
        f"within a box of {sides} deg of the inputs"
    )
    return Completeness(Guarantee.TO_BOX, short_form, max(gaps), sentence)


def _join_reasons(reasons: Sequence[str]) -> str:
    """Return reasons as one text, without the empty ones."""
    return "; ".join(reason for reason in reasons if reason)


def ranges_of(mechanism: Mechanism) -> list[tuple[float, float]]:
    """Return the lowest and the highest declared value (rad) of each input."""
    return [item.range for item in mechanism.inputs]


def closed_configurations(
    solver: PositionSolver, count: int, random: np.random.Generator
) -> Floats:
    """Return closed configurations that Newton's method reaches from random starts.

    In a closed configuration, all loops of links are closed. The caller searches from these
    configurations for singular ones, or tests whether all of them are singular. The start
    values of the inputs are distributed uniformly over their ranges. Newton's method does
    not change the inputs.

    The variable of a rolling contact is the length along which two wheels have rolled. If
    the gear ratios determine these lengths from the inputs, Newton's method keeps these
    lengths. With other lengths, the wheels would be put together in another way than in the
    mechanism.

    Parameters
    ----------
    solver
        Position solver of the mechanism.
    count
        Number of random starts.
    random
        Source of random numbers.

    Returns
    -------
    (n, V) variables (rad), n <= count.
    """
    low, high = starting_range(solver.closure)
    start = random.uniform(low, high, (count, len(low)))
    # Indices of the variables that Newton's method does not change: first the inputs.
    fixed_variables = list(solver.driven)
    range_starts, range_stops = np.transpose(ranges_of(solver.mechanism))
    start[:, fixed_variables] = random.uniform(
        range_starts, range_stops, (count, len(fixed_variables))
    )
    # The rolled lengths as functions of the inputs. None without rolling contacts.
    gear_phases = solver.gear_phases
    if gear_phases is not None and gear_phases.all_known:
        rolled_lengths = gear_phases.rolled_lengths(start[:, fixed_variables])
        start[:, list(gear_phases.variables)] = rolled_lengths
        fixed_variables += gear_phases.variables
    solution = solver.closure.solve(start, fixed_variables, max_steps=CLOSING_NEWTON_STEPS)
    return solution.values[solution.closure_residual < CLOSURE_TOLERANCE]


def is_singular_everywhere(report: SingularityReport) -> bool:
    """Return whether all configurations that are reached from random starts are singular.

    `report` states the type of singularity. If all configurations have this type, the
    singular configurations are no curves or surfaces that could be followed.
    """
    values = closed_configurations(
        report.solver, STARTS_OF_EVERYWHERE_TEST, np.random.default_rng(RANDOM_SEED)
    )
    return len(values) > 0 and bool(np.all(report.has_type(report.types(values))))


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def points_from(
    locus: SingularityLocus, values: Floats, driven: Sequence[int]
) -> LocusPoints:
    """Return the singular configurations that Newton's method reaches from given ones.

    Newton's method changes a configuration until it is singular. Meanwhile, all inputs but
    one are locked, so that they stay in their ranges. The free input is another one for
    each configuration in turn, and in some configurations no input is locked
    (`_locked_input_conditions`).

    Parameters
    ----------
    locus
        The set of all singular configurations of one type, with its equations.
    values
        (n, V) closed configurations (rad).
    driven
        Indices of the inputs' variables.

    Returns
    -------
    At most n points.
    """
    # Unknowns of Newton's method are the configuration and its singular motion. This is a
    # set of rates that close the loops while the inputs (type II) or the output (type I)
    # rest. A regular configuration has no such motion. Newton's method therefore starts
    # with the closed motion in which the inputs, or the output, move least.
    motions = locus.measure(locus.tangent_space(values)).motion
    # (n, inputs - 1, V) the product of a matrix and the variables of a configuration has
    # the values of its locked inputs. Newton's method does not change these values.
    conditions = _locked_input_conditions(len(values), values.shape[1], driven)
    locked_values = np.matvec(conditions, values)
    points = locus.correct(
        values, motions, conditions, locked_values, max_steps=RANDOM_LOCUS_NEWTON_STEPS
    )
    return points.rows(points.is_on_locus)


def _locked_input_conditions(
    row_count: int, variable_count: int, driven: Sequence[int]
) -> Floats:
    """Return linear conditions that lock all inputs but one in each configuration.

    The caller searches for singular configurations by Newton's method. The method starts
    from the given configurations and keeps the values of the locked inputs. With two
    inputs, configuration 0 has the second input locked, configuration 1 the first input,
    and configuration 2 no input. Configuration 3 begins again with the second input. One
    choice of locked inputs may succeed where the others find nothing.

    Parameters
    ----------
    row_count
        Number n of configurations.
    variable_count
        Number V of the pair variables.
    driven
        Indices of the inputs' variables.

    Returns
    -------
    (n, inputs - 1, V) one matrix for each configuration. The product of a matrix and the
    values of the V variables has the values of the locked inputs.
    """
    # (inputs, V) the product of each row and the variables is the value of one input.
    input_rows = np.eye(variable_count)[list(driven)]
    choices = []
    for free_input in range(len(input_rows)):
        choices.append(np.delete(input_rows, free_input, 0))
    # The last choice locks no input. The equations 0 = 0 of this choice do no harm, because
    # each step of Newton's method is the shortest one that satisfies all equations.
    choices.append(np.zeros_like(input_rows[1:]))
    choice_of_row = np.arange(row_count) % len(choices)
    return np.array(choices)[choice_of_row]
