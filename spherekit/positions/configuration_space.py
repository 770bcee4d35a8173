"""All configuration curves of a mechanism, and the assembly modes that lie on each.

An assembly mode is followed over the range of an input. At a dead centre of the input it
ends, and another mode begins. Both modes are parts of one configuration curve, which passes
smoothly through the dead centre.

The curves do not depend on which pair is the input. The curves are therefore searched with
the pair for which the modes, and the inputs at which these meet, take the least work. The
modes of the given input are an independent check.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Integers
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.additional_freedoms import has_additional_freedoms
from spherekit.positions.assembly_enumeration import (
    RANGE_ROUNDS,
    can_find_all_modes,
    enumerate_assemblies,
    random_starts,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.curve_crossing import find_outgoing_points
from spherekit.positions.driving_pair import choose_driving_pair
from spherekit.positions.input_revolutions import in_range, turns_in_range, whole_laps
from spherekit.positions.input_turning_points import (
    InputTurningPoints,
    find_input_turning_points,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SEED, SearchStatistics
from spherekit.progress import ProgressReporter
from spherekit.status import Status
from spherekit.wording import counted

START_INPUTS = 181
"""Number of inputs over the range at which points of modes serve as starts of curves.

Larger: more time. Smaller: curves of short modes can be missed.
"""
EQUAL_CONFIGURATION_RAD = 1e-6
"""Two configurations at the same input belong to one mode if they differ by less.

A piece of a curve belongs to the mode that has the same variables at the middle of the
piece. Larger: a neighbouring mode near a crossing may be taken. Smaller: rounding errors
leave pieces without a mode.
"""
LONGEST_CURVE_RAD = 200.0
"""Length after which a curve that does not close is ended in each sense.

The length is increased to `LAP_PERIODS` periods of the input if that is more. With wheels,
a period can be many revolutions. A period of more than twice `LONGEST_CURVE_RAD` is
ignored.
"""
LAP_PERIODS = 8.0
"""A lap of a closed curve is assumed to be shorter than this number of input periods."""
PROBE_STEP_RAD = np.radians(2.0)
"""Distance of the inputs at which modes are computed if it is unknown where modes meet.

Larger: short components of curves are missed. Smaller: more time.
"""
SAME_CUT_RAD = 1e-6
"""Two cuts of a curve are one cut if their arc lengths differ by less."""
CHECKED_INPUTS = 12
"""Number of inputs over the range at which modes are counted, only to check the curves."""
MAX_CURVES = 64
"""A random search ends at this number of curves. A chain of many dyads can have more."""
MAX_START_INPUT_RAD = 1e3
"""A larger input of a start is reduced by whole periods.

Larger: rounding errors of the input open the loops by about `CLOSURE_TOLERANCE`, so that
curves cannot be followed. Smaller: the arc length 0 is at another point of some curves.
"""
NEAR_TURN_RAD = 1e-6
"""Inputs nearer to the end of a piece than this are not checked, because of rounding."""
SAME_CROSSING_END_RAD = 1e-3
"""Ends of curves that are nearer to each other than this are at the same crossing.

The curves that leave a crossing are searched on a sphere about an end, whose radius is
`curve_crossing.RADIUS_RAD`. Ends much nearer to each other than this radius lead to the
same curves. Larger: the curves of a second crossing nearby are missed. Smaller: the same
curves are searched again from each end, which takes time.
"""
UNCHECKED_CROSSING_DISTANCE_RAD = 1e-3
"""Distance from a crossing of curves at which nothing is checked.

Inputs nearer to the input of a crossing are not checked. If a curve that starts nearer to a
crossing fails, this is not reported as a problem.
"""


class Piece(NamedTuple):
    """A part of a configuration curve on which the input only rises or only falls.

    All its configurations belong to one assembly mode, and its inputs are in the given
    range of the input. Configurations repeat after a period of the input. So the input on
    the curve may be shifted by whole periods. Each shift that leads a part of the curve
    into the range gives a piece.

    Attributes
    ----------
    assembly_mode
        Number of the mode. None if no known mode has the configurations of the piece.
    middle
        (variables,) configuration at the middle of the piece (rad), with `shift` added to
        the input.
    start, stop
        Arc lengths (rad) of its ends on the curve. On a closed curve they begin at one
        point. If this point is inside the piece, `stop` exceeds the length of the curve.
    shift
        Whole periods of the input (rad). They are added to the input on the curve, which
        gives the input of the piece.
    lowest, highest
        Smallest and largest input of the piece (rad), with `shift` added.
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
    """Divide a curve into parts on which the input only rises or only falls.

    Parameters
    ----------
    curve
        The curve. If the input is constant on it, it is one part.
    driven
        Index of the variable of the input.
    low, high
        Range of the input (rad).
    period
        Growth of the input (rad) after which all configurations of the mechanism return.
        It is 2 pi if no wheels roll on each other. It is infinite if wheels follow the
        input by gear ratios and are not known to return. It is NaN if wheels roll on each
        other, but none follows the input by a gear ratio. If the period is not finite, the
        period of this curve is used (`ArcCurve.returns_after`).

    Returns
    -------
    The pieces within the range in order of arc length, without their assembly modes. A part
    of the curve gives a piece for each period in the range. If the range is a single input,
    or narrower than `SAME_CUT_RAD`, the pieces have no length: each is a point of the curve
    with this input.
    """
    period = curve.returns_after(driven, period)
    if not _may_reach_range(curve, driven, low, high, period):
        return []
    if high - low <= SAME_CUT_RAD and not curve.rests(driven):
        return _find_points_at_input(curve, driven, 0.5 * (low + high), period)
    cuts = _find_cuts(curve, driven, low, high, period)
    # A part is inside the range if the input at its middle is, shifted by whole periods.
    # `turns_in_range` returns all such inputs, and for each the index of its part.
    part_middles = curve.at(0.5 * (cuts[:-1] + cuts[1:])).values
    shifted_inputs, parts = turns_in_range(part_middles[:, driven], low, high, period)
    is_inside = in_range(shifted_inputs, low, high)
    parts = parts[is_inside]
    shifted_inputs = shifted_inputs[is_inside]
    # From here on, each list has one item for each piece: the arc lengths of its ends, and
    # the configuration at its middle with the shifted input.
    starts = cuts[parts]
    stops = cuts[parts + 1]
    middles = part_middles[parts]
    shifts = shifted_inputs - middles[:, driven]
    middles[:, driven] = shifted_inputs
    # The input only rises or only falls, so it has its extreme values at the ends.
    start_inputs = curve.at(starts).values[:, driven] + shifts
    stop_inputs = curve.at(stops).values[:, driven] + shifts
    lowest = np.minimum(start_inputs, stop_inputs)
    highest = np.maximum(start_inputs, stop_inputs)
    return [
        Piece(
            assembly_mode=None,
            middle=middles[k],
            start=float(starts[k]),
            stop=float(stops[k]),
            shift=float(shifts[k]),
            lowest=float(lowest[k]),
            highest=float(highest[k]),
        )
        for k in range(len(parts))
    ]


def _find_points_at_input(
    curve: ArcCurve, driven: int, q: float, period: float
) -> list[Piece]:
    """Return the points of a curve at an input, each as a piece without length.

    `monotone_pieces` returns them if the range of the input is a single value. The input on
    the curve can differ from `q` by whole periods. This difference is the `shift` of the
    piece.

    Parameters
    ----------
    curve
        The configuration curve.
    driven
        Index of the variable of the input.
    q
        The input (rad).
    period
        Growth of the input (rad) after which the curve repeats, or infinite.
    """
    places = curve.find_value(driven, q, period).places
    points = curve.at(places).values
    shifts = whole_laps(q - points[:, [driven]], np.array([period]))[:, 0]
    points[:, driven] += shifts
    return [
        Piece(
            assembly_mode=None,
            middle=point,
            start=s,
            stop=s,
            shift=shift,
            lowest=float(point[driven]),
            highest=float(point[driven]),
        )
        for point, s, shift in zip(points, places.tolist(), shifts.tolist(), strict=True)
    ]


def _find_cuts(
    curve: ArcCurve, driven: int, low: float, high: float, period: float
) -> Floats:
    """Return the arc lengths (n,) at which a curve is divided into parts, in rising order.

    The input turns back there, or is at an end of its range. The first part begins at the
    first arc length, and the last part ends at the last one.

    Parameters
    ----------
    curve
        The configuration curve.
    driven
        Index of the variable of the input.
    low, high
        Range of the input (rad).
    period
        Growth of the input (rad) after which the curve repeats, or infinite. Inputs that
        differ by whole periods count as equal.
    """
    turning_points = curve.dead_points(driven).places
    at_low_end = curve.find_value(driven, low, period).places
    at_high_end = curve.find_value(driven, high, period).places
    cuts = np.unique(np.concatenate([turning_points, at_low_end, at_high_end]))
    if curve.closed:
        # The last part ends where the first one begins, one lap later. Without any cut, the
        # whole curve is one part that begins at 0.
        cuts = cuts if len(cuts) else np.zeros(1)
        cuts = np.append(cuts, cuts[0] + curve.length)
    else:
        cuts = np.concatenate([[0.0], cuts, [curve.length]])
    # Of cuts that are equal up to rounding, only the first one is kept.
    differs_from_previous = np.append(True, np.diff(cuts) > SAME_CUT_RAD)
    return cuts[differs_from_previous]


def _may_reach_range(
    curve: ArcCurve, driven: int, low: float, high: float, period: float
) -> bool:
    """Return whether the input of a curve may be in a range, by a quick test.

    The test uses only the stored points (nodes) of the curve. The answer False is certain.

    Parameters
    ----------
    curve
        The configuration curve.
    driven
        Index of the variable of the input.
    low, high
        Range of the input (rad).
    period
        Growth of the input (rad) after which the curve repeats, or infinite.
    """
    # A chord is the straight line between two successive nodes, in the space of all
    # variables. On this line, the input is between its values at both nodes. The nodes are
    # so close that the curve deviates from the line by less than the length of the chord.
    # The input on the curve exceeds these values by less than this length.
    margin = float(np.max(curve.chord_lengths))
    lowest = float(np.min(curve.nodes.values[:, driven])) - margin
    highest = float(np.max(curve.nodes.values[:, driven])) + margin
    if not np.isfinite(period):
        return lowest <= high and highest >= low
    # The inputs of the curve repeat after each period. Shift them by whole periods as far
    # up as possible, such that the lowest one is still at most `high`. The curve may reach
    # the range if the highest one is then at least `low`.
    shift = np.floor((high - lowest) / period) * period
    return bool(highest + shift >= low)


class ConfigurationCurve(NamedTuple):
    """A curve of configurations, and its pieces within the range of the input.

    A piece is a part on which the input only rises or only falls. The pieces are in order
    of arc length.
    """

    curve: ArcCurve
    pieces: tuple[Piece, ...]


class Configurations(NamedTuple):
    """The configuration curves that have a configuration with the input in its range.

    A configuration curve consists of all closed configurations that the mechanism reaches
    from one of them. To search the curves, configurations were computed at values of the
    pair `drive`. The pair `drive` is the input, or another pair if that was less work.

    Attributes
    ----------
    curves
        The curves that were found.
    claim
        What is guaranteed, with its reason. There are three cases:

        - No curve is missing.
        - Short curves may be missing. In parts of the range of the pair `drive`, all
          configurations were computed only at values up to `claim.box` (rad) apart, so a
          curve between two of these values may not have been noticed.
        - Any curve may be missing.
    drive
        Name of the pair whose values were prescribed when the configurations were computed.
    inputs
        (k,) values (rad) of the mechanism's input at which all assembly modes (ways to
        assemble the links) were computed without following curves. These modes serve to
        check the curves.
    counts
        (k,) number of assembly modes at each of these inputs.
    mismatches
        Sentences about inputs at which the numbers of modes and the curves disagree.
    """

    curves: tuple[ConfigurationCurve, ...]
    claim: Completeness
    drive: str
    inputs: Floats
    counts: Integers
    mismatches: Names

    @property
    def guarantee(self) -> Guarantee:
        """Whether curves can be missing, as a `Guarantee`: a part of the `claim`."""
        return self.claim.guarantee


@checked(SolveError)
def configuration_curves(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    low: float,
    high: float,
) -> Configurations:
    """Return the configuration curves of a mechanism that meet the range of its input.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    assembly_modes
        Its assembly modes over the range. The curves through them come first.
    low, high
        Ends of the range of the input (rad).

    Returns
    -------
    The curves, and how complete they are. Each curve is divided into pieces, on which the
    input only rises or only falls. At some inputs the modes are counted independently of
    the curves, as a check. If a check fails, less is claimed about completeness.

    Raises
    ------
    PlanError
        If there are several inputs.
    SolveError
        If the range is not finite, or `low` is above `high`.
    """
    input_variable = solver.input_variable
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise SolveError(
            f"{solver.mechanism.name}: the range of the input is from {low:g} to {high:g} "
            "rad; give finite ends, the lower one first"
        )
    (period,) = solver.periods
    longest = LONGEST_CURVE_RAD
    if period <= 2.0 * LONGEST_CURVE_RAD:
        longest = max(LONGEST_CURVE_RAD, LAP_PERIODS * period)
    search = _CurveSearch(solver, low, high, longest)
    # Starts from the given modes and from the reference pose.
    inputs = np.linspace(low, high, START_INPUTS)
    for assembly_mode in assembly_modes:
        samples = solver.evaluate(assembly_mode, inputs[:, None])
        search.add_curves(samples.values[samples.status == Status.OK])
    reference = solver.reference
    if reference is not None and low <= reference[input_variable] <= high:
        # No mode passes through the reference pose if the input is stationary on its curve.
        search.add_curves(reference[None])
    # The curves are divided at values of the pair with which this takes the least work. If
    # this pair is not the input, its whole revolution is searched.
    drive = choose_driving_pair(solver)
    drive_range = (low, high) if drive is solver else (-np.pi, np.pi)
    turning_points = find_input_turning_points(drive, *drive_range)
    claim = search.search_between_turning_points(drive, turning_points)
    is_complete = claim.guarantee is not Guarantee.SAMPLED
    if not is_complete:
        claim = search.search_from_random_starts()
    search.follow_curves_from_crossings()
    # Divide the curves where the input turns back, and count modes as a check.
    pieces_by_curve = [
        monotone_pieces(curve, input_variable, low, high, period) for curve in search.curves
    ]
    all_pieces = [piece for pieces in pieces_by_curve for piece in pieces]
    search.check_mode_counts(all_pieces, is_complete)
    if search.problems:
        failed = counted(len(search.problems), "check")
        claim = Completeness(
            Guarantee.SAMPLED, f"{failed} failed, the first: {search.problems[0]}"
        )
    if search.surface_count:
        configurations = counted(search.surface_count, "configuration")
        claim = replace(
            claim,
            reason=f"{claim.reason}; {configurations} with additional freedoms were "
            "found, which are no assembly modes of this motion",
        )
    count_inputs, counts = np.array(search.mode_counts).reshape(-1, 2).T
    return Configurations(
        curves=tuple(
            ConfigurationCurve(curve, _assign_modes(solver, assembly_modes, curve, pieces))
            for curve, pieces in zip(search.curves, pieces_by_curve, strict=True)
            if pieces
        ),
        claim=claim,
        drive=drive.mechanism.pairs[drive.assembly.input].name,
        inputs=count_inputs,
        counts=counts.astype(np.int64),
        mismatches=tuple(search.problems),
    )


def _assign_modes(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    curve: ArcCurve,
    pieces: Sequence[Piece],
) -> tuple[Piece, ...]:
    """Return pieces of a curve with the numbers of their assembly modes.

    A piece is a part of a configuration curve on which the input only rises or only falls.
    A piece belongs to the assembly mode that has the configuration at its middle.

    Parameters
    ----------
    solver
        The mechanism.
    assembly_modes
        Its modes over the range of the input.
    curve
        The configuration curve.
    pieces
        Its pieces, without numbers.

    Returns
    -------
    The pieces in the same order. A piece has the number None if no mode has the
    configuration at its middle.
    """
    numbered_pieces = list(pieces)
    # Configurations (pieces, variables) at the middles, and their inputs (pieces, 1).
    middles = np.array([piece.middle for piece in pieces])
    inputs = middles[:, [solver.input_variable]]
    for assembly_mode in assembly_modes:
        # Configurations of the mode at these inputs. The configurations are NaN, and thus
        # not near, where the mode does not exist.
        values = solver.evaluate(assembly_mode, inputs).values
        difference = max_abs(curve.wrapped(values - middles), axis=1)
        for row in np.flatnonzero(difference < EQUAL_CONFIGURATION_RAD):
            piece = numbered_pieces[row]
            numbered_pieces[row] = piece._replace(assembly_mode=assembly_mode.number)
    return tuple(numbered_pieces)


class _CurveSearch:
    """Collects the configuration curves of a mechanism over a range of its input.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    low, high
        Ends of the range of the input (rad).
    longest
        Curves are followed from their starts in both senses. A curve that does not close is
        ended after this length (rad) in each sense.

    Attributes
    ----------
    curves
        The curves found so far.
    mode_counts
        Inputs (rad), with the numbers of real modes that were computed there independently
        of the curves.
    problems
        Sentences about what does not agree, and about curves that could not be followed.
    surface_count
        Number of configurations that are on no curve, because the mechanism has several
        degrees of freedom at them and around them.
    """

    def __init__(
        self, solver: PositionSolver, low: float, high: float, longest: float
    ) -> None:
        """Start with no curves over the range of the input from `low` to `high` (rad)."""
        self.solver = solver
        self.low = low
        self.high = high
        self.longest = longest
        self.curves: list[ArcCurve] = []
        self.mode_counts: list[tuple[float, int]] = []
        self.problems: list[str] = []
        self.surface_count = 0

    def add_curves(self, values: Floats) -> None:
        """Follow the curves through some configurations, unless a known curve passes them.

        New curves are appended to `curves`. If no curve can be followed from a
        configuration, a message is added to `problems`, with two exceptions:

        - Configurations near a crossing of curves are ignored.
        - Configurations at which the mechanism has several degrees of freedom are only
          counted, in `surface_count`. No curve passes through them.

        Parameters
        ----------
        values
            (n, variables) configurations (rad), often of one assembly mode in the order of
            the input.
        """
        # All curves are followed first, because their ends show where curves cross.
        failures = self._follow_unknown_curves(values)
        for start, message in failures:
            if self._is_near_crossing_end(start):
                continue
            if has_additional_freedoms(self.solver.closure, start):
                self.surface_count += 1
            else:
                self.problems.append(message)

    def _follow_unknown_curves(self, values: Floats) -> list[tuple[Floats, str]]:
        """Follow and add curves until each given configuration is on one of the curves.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).

        Returns
        -------
        The configurations (variables,) from which no curve could be followed, each with a
        message that says why.
        """
        failures: list[tuple[Floats, str]] = []
        # Leave out the configurations on known curves.
        for curve in self.curves:
            values = values[~curve.passes(values)]
        while len(values):
            # Start in the middle of the list. Following is difficult from configurations
            # near the ends of a mode.
            middle = len(values) // 2
            start = self._reduce_input(values[middle])
            values = np.delete(values, middle, axis=0)
            try:
                curve = follow_arc(self.solver.closure, start, longest=self.longest)
            except SolveError as error:
                failures.append((start, str(error)))
                continue
            self.curves.append(curve)
            # Leave out the other configurations on this curve.
            values = values[~curve.passes(values)]
        return failures

    def _reduce_input(self, values: Floats) -> Floats:
        """Return a configuration (variables,), rad, with a large input made small.

        The input is reduced by whole periods if it exceeds `MAX_START_INPUT_RAD`.
        """
        q = values[None, [self.solver.input_variable]]
        if np.isfinite(self.solver.periods[0]) and np.abs(q) > MAX_START_INPUT_RAD:
            (values,) = self.solver.shift_inputs(values[None], self.solver.reduce_inputs(q))
        return values

    def _is_near_crossing_end(self, values: Floats) -> bool:
        """Return whether a known curve ends at a crossing near a configuration.

        At a crossing several curves meet, and none can be followed from there.
        `values` (variables,) are the pair variables (rad).
        """
        for curve in self.curves:
            for end in _crossing_ends([curve]):
                distance = max_abs(curve.wrapped(values - end))
                if distance < UNCHECKED_CROSSING_DISTANCE_RAD:
                    return True
        return False

    def follow_curves_from_crossings(self) -> None:
        """Follow the curves that leave the crossings at which known curves end.

        A crossing is a configuration at which several curves meet. From there, curves are
        found that other searches can miss. For example, a search at a certain input misses
        a curve on which the input has another, constant value. Each crossing is searched
        only once.
        """
        searched_ends: list[Floats] = []
        # New curves are appended to `curves` during this loop, so their ends are searched.
        for curve in self.curves:
            # The ends (one or two configurations) of the curve that are at crossings.
            for end in _crossing_ends([curve]):
                # `wrapped` removes whole periods of the variables.
                distances = [
                    float(max_abs(curve.wrapped(end - other))) for other in searched_ends
                ]
                is_searched = min(distances, default=np.inf) < SAME_CROSSING_END_RAD
                if not is_searched:
                    searched_ends.append(end)
                    # Points near the crossing, on all curves that leave it.
                    outgoing_points = find_outgoing_points(self.solver.closure, end)
                    self.add_curves(outgoing_points)

    def search_between_turning_points(
        self, drive: PositionSolver, turning_points: InputTurningPoints
    ) -> Completeness:
        """Follow the curves of all modes between the angles of a pair at which modes meet.

        The curves of configurations are the same whichever pair is driven. The caller
        therefore chooses a pair for which the search is fast: the input or another one. An
        assembly mode is one way to assemble the links at an angle of the driven pair.

        A mode ends where it meets another one, at a turning point of this angle. Between
        two turning points the number of modes is constant. All modes are therefore computed
        at one angle between them, and the curve through each is followed. Where turning
        points may have been missed, modes are computed at several angles, `PROBE_STEP_RAD`
        apart.

        Parameters
        ----------
        drive
            A solver of the same mechanism that drives the chosen pair.
        turning_points
            The angles of the driven pair at which modes meet.

        Returns
        -------
        How complete the curves are. Nothing is guaranteed if no elimination computes all
        modes at an angle of the driven pair.
        """
        incomplete = Completeness(
            Guarantee.SAMPLED, "no elimination finds all modes at an input"
        )
        if not can_find_all_modes(drive):
            return incomplete
        # `probes` returns the angles at which modes are computed: one between two turning
        # points, or several where turning points may be missing.
        for q in turning_points.probes(PROBE_STEP_RAD):
            configurations = enumerate_assemblies(drive, np.array([q]))
            if not configurations.is_complete:
                return incomplete
            # If the driven pair is the input of the mechanism, the numbers of modes also
            # serve to check the curves (`check_mode_counts`).
            if drive is self.solver:
                self.mode_counts.append((q, len(configurations.values)))
            self.add_curves(configurations.values)
        # How complete the modes at these angles are, and so the curves through them.
        return turning_points.claim(PROBE_STEP_RAD)

    def search_from_random_starts(self) -> Completeness:
        """Follow the configuration curves to which random starts over the range lead.

        The search ends when many starts have led to each known curve, because few curves
        can then be missing.

        Returns
        -------
        How complete the curves are, with the numbers of starts.
        """
        # `all_known` says whether the input determines how far all wheels have rolled. If
        # not, wheels can mesh at any of their angles, so there are infinitely many curves.
        # Then nothing is searched, and there is only what is connected to the given modes.
        # Without wheels `gear_phases` is None.
        gear_phases = self.solver.gear_phases
        if gear_phases is not None and not gear_phases.all_known:
            return Completeness(
                Guarantee.COMPONENT, "wheels meshed as in the given assembly modes"
            )
        low = np.array([self.low])
        high = np.array([self.high])
        rounds = random_starts(self.solver, low, high, seed=SEED + 1)
        variable_count = len(self.solver.mechanism.variable_owners)
        # A round is a fixed number of starts. The first item of `random_starts` has the
        # starts of `RANGE_ROUNDS` rounds.
        statistics = SearchStatistics(variable_count, min_rounds=RANGE_ROUNDS)
        progress = ProgressReporter("searching the configuration curves")
        while statistics.needs_more_starts and len(self.curves) < MAX_CURVES:
            # The number of starts that were made, and the closed configurations (rad) to
            # which they led.
            start_count, values, _ = next(rounds)
            self.add_curves(values)
            # The index of the curve on which each configuration lies, -1 for none.
            curve_numbers = np.full(len(values), -1, dtype=np.intp)
            for number, curve in enumerate(self.curves):
                curve_numbers[curve.passes(values)] = number
            statistics.add(start_count, hits=curve_numbers, total=len(self.curves))
            progress.report_if_due(lambda: statistics.progress_text("curves"))
        return Completeness(Guarantee.SAMPLED, statistics.describe("curves"))

    def check_mode_counts(self, pieces: Sequence[Piece], is_complete: bool) -> None:
        """Check the curves by comparing numbers of pieces with numbers of assembly modes.

        A piece is a part of a curve on which the input only rises or only falls, so it is
        one mode. `mode_counts` has some inputs, and the number of modes that were computed
        there without the curves. If fewer pieces than modes contain this input, a curve is
        missing. If the curves should be complete, more pieces than modes are an error. A
        sentence about each error is added to `problems`.

        Parameters
        ----------
        pieces
            The pieces of all curves.
        is_complete
            Whether the curves should be complete. If so, modes are counted at further
            inputs.
        """
        if is_complete:
            self._count_modes_at_further_inputs()
        # The smallest and the largest input (rad) of each piece.
        input_ranges = [(piece.lowest, piece.highest) for piece in pieces]
        lowest, highest = np.array(input_ranges).reshape(-1, 2).T
        for q, mode_count in self.mode_counts:
            # Where modes meet, rounding decides how many there are.
            if self._is_near_meeting(q, np.concatenate([lowest, highest])):
                continue
            piece_count = np.sum((lowest < q) & (q < highest))
            if is_complete:
                is_wrong = piece_count != mode_count
            else:
                is_wrong = piece_count < mode_count
            if is_wrong:
                self.problems.append(
                    f"at the input {np.degrees(q):.6g} deg there are {mode_count} modes, "
                    f"but the curves have {piece_count}"
                )

    def _count_modes_at_further_inputs(self) -> None:
        """Count the modes at inputs spread over the range, as a check of the curves.

        Inputs and counts are appended to `mode_counts`. Inputs at which the count may have
        missed modes are left out.
        """
        # The middles of `CHECKED_INPUTS` equal parts of the range. The ends and the middles
        # of the parts alternate.
        ends_and_middles = np.linspace(self.low, self.high, 2 * CHECKED_INPUTS + 1)
        # In a range that is a single input, all middles are equal.
        for q in np.unique(ends_and_middles[1::2]):
            configurations = enumerate_assemblies(self.solver, np.array([q]))
            if configurations.is_complete:
                self.mode_counts.append((q, len(configurations.values)))

    def _is_near_meeting(self, q: float, piece_ends: Floats) -> bool:
        """Return whether the number of modes at an input may depend on rounding.

        At such an input the caller does not compare the numbers of modes and pieces. Modes
        meet at the end of a piece (part of a curve), where the input reverses, and
        where curves cross.

        Parameters
        ----------
        q
            The input (rad), within the range.
        piece_ends
            (ends,) inputs (rad) at the ends of all pieces, within the same range.
        """
        end_distance = np.min(np.abs(piece_ends - q), initial=np.inf)
        if end_distance < NEAR_TURN_RAD:
            return True
        # Inputs of crossings may differ by whole turns from those in the range. `wrap`
        # removes whole turns.
        crossing_inputs = np.array(
            [end[self.solver.input_variable] for end in _crossing_ends(self.curves)]
        )
        crossing_distance = np.min(np.abs(wrap(crossing_inputs - q)), initial=np.inf)
        return bool(crossing_distance < UNCHECKED_CROSSING_DISTANCE_RAD)


def _crossing_ends(curves: Iterable[ArcCurve]) -> Iterator[Floats]:
    """Yield the last nodes (variables,) of curves that end because others cross them."""
    for curve in curves:
        # `ends` says for both ends why the curve ends there.
        first_and_last_node = curve.nodes.values[[0, -1]]
        for reason, end in zip(curve.ends, first_and_last_node, strict=True):
            if reason == Status.AT_SINGULARITY:
                yield end
