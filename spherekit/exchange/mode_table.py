"""Finds the assembly modes of explicit formulas, and compares each with the mechanism.

Exported source code contains a table of assembly modes. Each mode has *mode values*, the
numbers that select the mode in the formulas (see `formula_expressions`):

- If the formulas are in closed form, the mode values are the sign of each dyad (+1 or -1):
  the sign of the triple product of its three axes. An assembly mode of a run has one sign
  for each dyad by definition. If circles in contact are replaced by links between their
  centres, the equivalent linkage has other dyads. The signs of these dyads are determined
  from configurations.
- Otherwise the mode values are the variables of all pairs at one input, at which the loops
  are well conditioned. Newton's method starts from them.

If modes follow smooth curves through crossings, the inputs at which curves cross divide the
range of the input into *intervals*, and a mode has values in each of them. Otherwise there
is one interval.

The formulas then compute each mode at several inputs. A mode that deviates from the mode of
the mechanism is not written, and a message names the reason.

A *row* of a motion is one configuration: one assembly mode at one sample of the inputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.completeness import Guarantee
from spherekit.designs.varied_mechanism import VariedMechanism
from spherekit.errors import EngineError
from spherekit.exchange.formula_expressions import (
    Formulas,
    LeftOutMode,
    Mode,
    ModeTable,
    SmoothModes,
)
from spherekit.files.study import Crossings
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.joint_construction import make_joints
from spherekit.numerics.angles import wrap
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import Motion
from spherekit.positions.motion_cache import position_analysis_of
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.symbolic.expression_graph import Expr
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.wording import listing

MODE_SAMPLES = 121
"""Number of samples in the ranges of the inputs. Without crossings, the compared inputs are
among them."""
FINE_SAMPLES = 6001
"""Number of samples that replace `MODE_SAMPLES` if a mode is accurate at none of them.

A mode may exist only within a few degrees of the input.
"""
COMPARED_INPUTS = 20
"""Largest number of inputs at which a mode without crossings is compared."""
ANGLE_TOLERANCE_RAD = 1e-9
"""Largest difference (rad) of a pair variable between formulas and mechanism.

Ten times the error bound of the variables of the mechanism is added. A larger value accepts
a wrong mode whose links nearly coincide with those of the right one. A smaller value
rejects right modes of long chains because of rounding errors.
"""
MAX_CONFIGURATION_ERROR_RAD = 1e-5
"""Configurations whose error bound (rad) of the variables is larger are not compared."""
MIN_TRIPLE_PRODUCT = 1e-6
"""Triple products of smaller magnitude may have the wrong sign because of rounding."""
START_OFFSET_RAD = 1e-3
"""Distance (rad) from the right variables at which the test of Newton's method starts.

It is divided by the square of the sensitivity of the loops if that exceeds 1. With a larger
value Newton's method may converge to another mode. With a smaller value the test is weaker.
"""
NEWTON_STEPS = 8
"""Number of Newton steps in that test. Fewer steps may not converge."""
UNDETERMINED_MODE = (
    "some closure equations of this mechanism repeat others, and those that the formulas "
    "solve do not determine this mode"
)
"""Reason for which a mode is not written if independent equations depend on the mode."""
LEAST_COMPARED_INPUTS = 4
"""Smallest number of inputs that are compared in each interval, if the mode has as many."""
INTERVAL_SAMPLES = 24
"""Additional samples in each interval between crossings. Fewer: short intervals have few
configurations that can be compared."""
BESIDE_CROSSING_RAD = 1e-3
"""Distance (rad) from a crossing, on both sides, at which closed forms are compared too.
Less: rounding errors of the formulas near the crossing exceed the tolerance; more: two
curves that cross at a shallow angle are compared less closely."""
MAX_BESIDE_RATIO = 0.1
"""Largest such distance, relative to the distance of the next crossing."""
UNKNOWN_AT_CROSSING_RAD = 1e-6
"""Distance (rad) from a crossing within which sources give no numbers of a mode whose signs
change there. `sk.evaluate` gives no rates of a dyad whose sine is smaller. Less: rates have
fewer than four digits."""


@dataclass(frozen=True)
class ModeCandidate:
    """An assembly mode (way to assemble the mechanism) that may be exported.

    The formulas are evaluated at the inputs of n known configurations of the mode. The mode
    is exported if the formulas compute the same configurations.

    In the formulas, a few numbers select the mode: its mode values. Mode values can change
    at inputs at which curves of configurations cross. Crossings divide the range of the
    input into intervals. Without crossings there is one interval.

    Attributes
    ----------
    mode
        The assembly mode.
    motion
        The n known configurations, in the order of the inputs. Their variables are
        accurate.
    values
        (n, variables) variables (rad) of the pairs in the formulas, in these
        configurations. The formulas may belong to an equivalent linkage, in which links
        replace contacts of circles.
    interval
        (n,) index of the interval of each configuration.
    mode_values
        (intervals, values) mode values in each interval. For formulas in closed form, the
        mode values are the signs (+1 or -1) of the dyads (two links and three R pairs).
        Otherwise the mode values are the variables (rad) from which Newton's method starts.
        Values can be NaN in an interval in which the mode has no configuration.
    """

    mode: AssemblyMode
    motion: Motion
    values: Floats
    interval: Indices
    mode_values: Floats

    def find_known_input(self, interval: int) -> Floats | None:
        """Return the inputs (inputs,) rad of a known configuration in an interval, or None.

        Intervals are the parts of the input's range between crossings of configuration
        curves. Newton's method starts from this configuration if the formulas have no
        closed form.
        """
        row = _middle_row(self.interval, interval)
        return None if row is None else self.motion.inputs[row]

    @property
    def allowed_difference(self) -> Floats:
        """(n,) largest accepted error (rad) of the formulas in each configuration.

        An assembly mode is rejected if a pair variable (joint angle) of the formulas
        differs by more. The limit is a fixed tolerance plus ten times the error bound of
        the compared variables. The factor ten leaves room for the rounding errors of the
        formulas, which have no error bound of their own.
        """
        return ANGLE_TOLERANCE_RAD + 10.0 * self.motion.kantorovich_error


def _middle_row(row_intervals: Indices, interval: int) -> int | None:
    """Return the index of the middle configuration in an interval, or None without any.

    A row is one configuration. `row_intervals` has the index of the interval of each row.
    """
    rows = np.flatnonzero(row_intervals == interval)
    return int(rows[len(rows) // 2]) if len(rows) else None


class ModeProblem(Exception):
    """Says why one assembly mode cannot be written. Other modes are not affected."""


def compare_modes(
    formulas: Formulas,
    varied: VariedMechanism,
    terms: DesignExpressions,
    angles: Sequence[Expr],
    assembly_mode: int | str | None,
    crossings: Crossings = "end",
) -> ModeTable:
    """Find the assembly modes of a mechanism, and check each with the formulas.

    Parameters
    ----------
    formulas
        The formulas. Their mode table is not read.
    varied, terms
        The mechanism of the formulas, and the terms from which they are built.
    angles
        In closed form the variables (rad) of all R pairs that are not driven, in the order
        of `passive_variables`, as terms of `formulas.variables`. Otherwise not used.
    assembly_mode
        Number or name of the only assembly mode to write. By default all are written.
    crossings
        How an assembly mode continues where its curve of configurations crosses the curve
        of another mode. With "end" it keeps the signs of its dyads. A dyad is two links
        with three R pairs, and its sign is one of two ways to assemble it. With "pass" the
        mode follows the smooth curve through the crossing.

    Returns
    -------
    The modes that the formulas give correctly, and the reason for each other mode.

    Raises
    ------
    EngineError
        If no mode can be written.
    SolveError
        If the mechanism has no such assembly mode, or cannot be assembled. With crossings
        "pass" also if there are several inputs, or if it is not known which modes continue
        each other.
    """
    position_analysis = position_analysis_of(varied.mechanism, crossings)
    crossing_inputs = np.zeros(0)
    if crossings == "pass":
        crossing_inputs = np.array([x.input for x in position_analysis.mode_meetings])
    requested_modes = position_analysis.assembly_modes
    if assembly_mode is not None:
        requested_modes = (
            requested_modes[position_analysis.find_mode_index(assembly_mode)],
        )
    sampled_motion = position_analysis.sparse(MODE_SAMPLES)
    if len(crossing_inputs):
        inputs_by_interval = _sample_intervals(crossing_inputs, *position_analysis.range)
        sampled_motion = position_analysis.at(
            np.union1d(sampled_motion.inputs[:, 0], inputs_by_interval)
        )
    candidates: list[ModeCandidate] = []
    left_out: list[LeftOutMode] = []
    for mode in requested_modes:
        try:
            candidates.append(
                _find_candidate(
                    position_analysis, sampled_motion, mode, crossing_inputs, varied, terms
                )
            )
        except ModeProblem as problem:
            left_out.append(LeftOutMode(mode.number, mode.title, str(problem)))
    # The interval in which a smooth curve has the number of the mode.
    first_interval = int(
        np.searchsorted(crossing_inputs, position_analysis.numbering_input)
    )
    if not len(crossing_inputs):
        first_interval = 0
    written: list[ModeCandidate] = []
    undetermined_modes: list[int] = []
    modes: list[Mode] = []
    compared: list[int] = []
    differences: list[float] = [0.0]
    deviations = _compute_deviations(formulas, terms, angles, candidates)
    for candidate, deviation in zip(candidates, deviations, strict=True):
        mode = candidate.mode
        motion = candidate.motion
        # The deviation is NaN where the formulas do not close: the mode is then rejected.
        relative_deviation = np.nan_to_num(
            deviation / candidate.allowed_difference, nan=np.inf
        )
        worst_row = int(np.argmax(relative_deviation))
        if relative_deviation[worst_row] > 1.0:
            if not terms.structure.has_independent_equations(candidate.values[worst_row]):
                undetermined_modes.append(mode.number)
                reason = UNDETERMINED_MODE
            else:
                worst_input = listing(f"{q:.6g}" for q in motion.inputs[worst_row])
                reason = (
                    "the formulas do not give this mode: at the input "
                    f"{worst_input} rad a variable differs by "
                    f"{deviation[worst_row]:.2g} rad"
                )
            left_out.append(LeftOutMode(mode.number, mode.title, reason))
            continue
        known_input = candidate.find_known_input(first_interval)
        mode_values = candidate.mode_values[first_interval]
        if known_input is None:  # The mode has no configuration in that interval.
            # Up to the nearest interval with configurations, the signs do not change.
            nearest_row = np.argmin(np.abs(candidate.interval - first_interval))
            nearest_interval = int(candidate.interval[nearest_row])
            known_input = candidate.find_known_input(nearest_interval)
            assert known_input is not None
            if np.any(np.isnan(mode_values)):
                mode_values = candidate.mode_values[nearest_interval]
        modes.append(
            Mode(
                number=mode.number,
                name=mode.signs_and_name,
                at=tuple(known_input.tolist()),
                values=tuple(mode_values.tolist()),
            )
        )
        written.append(candidate)
        compared.append(len(deviation))
        differences.append(float(np.max(deviation)))
    if not modes:
        problems = "; ".join(f"{mode.name}: {mode.reason}" for mode in left_out)
        raise EngineError(
            f"{varied.mechanism.name}: no assembly mode can be written: {problems}"
        )
    smooth = None
    if crossings == "pass":
        smooth = _join_mode_values(position_analysis, crossing_inputs, written)
    return ModeTable(
        modes=tuple(modes),
        left_out=tuple(left_out),
        undetermined=tuple(undetermined_modes),
        compared=min(compared),
        largest_difference=max(differences),
        smooth=smooth,
    )


def _sample_intervals(crossing_inputs: Floats, low: float, high: float) -> Floats:
    """Return inputs (rad) at which exported formulas are compared with the mechanism.

    The inputs at which curves of configurations cross divide the range of the input into
    intervals. An assembly mode that passes through a crossing can need other signs in its
    formulas from there on. The result therefore has inputs within all intervals, and inputs
    close to each crossing on both sides.

    Parameters
    ----------
    crossing_inputs
        Inputs (rad) of the crossings, in increasing order, at least one.
    low, high
        Ends of the range (rad). Inputs outside of the range are left out.
    """
    # gaps[k] and gaps[k + 1] are the distances of crossing k from its neighbours.
    gaps = np.diff(crossing_inputs, prepend=-np.inf, append=np.inf)
    # Distance of the inputs beside each crossing. The distance is at most a tenth of the
    # gap to the next crossing, so these inputs stay in the two adjacent intervals.
    distance = np.minimum(
        BESIDE_CROSSING_RAD, MAX_BESIDE_RATIO * np.minimum(gaps[:-1], gaps[1:])
    )
    ends = np.unique(np.clip([low, *crossing_inputs, high], low, high))
    inside = [
        np.linspace(start, stop, INTERVAL_SAMPLES + 2)[1:-1]
        for start, stop in pairwise(ends)
    ]
    inputs = np.concatenate(
        [crossing_inputs - distance, crossing_inputs + distance, *inside]
    )
    return inputs[(inputs >= low) & (inputs <= high)]


def _join_mode_values(
    position_analysis: PositionAnalysis,
    crossing_inputs: Floats,
    candidates: Sequence[ModeCandidate],
) -> SmoothModes:
    """Return the mode values of all modes in the intervals of the input.

    A mode is one way to assemble the links. Each mode follows a smooth curve of
    configurations, which crosses other curves.

    Mode values are the numbers that select a mode in the formulas. Crossings divide the
    range of the input into intervals, and a mode can have other values in each of them.
    There is also a short interval about each crossing. In this interval the values of a
    mode are unknown (NaN) if they change at the crossing.

    Parameters
    ----------
    position_analysis
        The position analysis, whose modes follow smooth curves.
    crossing_inputs
        Rising inputs (rad) at which curves cross.
    candidates
        The modes that are written.
    """
    low, high = position_analysis.range
    (period,) = position_analysis.solver.periods
    # Axes of `mode_values`: interval, mode, value; of `inputs`: interval, mode.
    mode_values = np.stack([candidate.mode_values for candidate in candidates], axis=1)
    inputs = np.full(mode_values.shape[:2], np.nan)
    for interval, mode in np.ndindex(*inputs.shape):
        known_input = candidates[mode].find_known_input(interval)
        if known_input is not None:
            inputs[interval, mode] = known_input[0]  # there is one input
    # Lists with one item for each interval, with those about the crossings.
    starts = [-np.inf]
    all_mode_values = [mode_values[0]]
    all_inputs = [inputs[0]]
    gaps = np.diff(crossing_inputs, prepend=-np.inf, append=np.inf)
    for k, crossing in enumerate(crossing_inputs.tolist()):
        # Crossing k lies between the intervals k and k + 1.
        changes = np.any(mode_values[k] != mode_values[k + 1], axis=1)
        half_width = min(UNKNOWN_AT_CROSSING_RAD, 0.25 * min(gaps[k], gaps[k + 1]))
        starts += [crossing - half_width, crossing + half_width]
        all_mode_values += [
            np.where(changes[:, None], np.nan, mode_values[k]),
            mode_values[k + 1],
        ]
        all_inputs += [np.where(changes, np.nan, inputs[k]), inputs[k + 1]]
    if position_analysis.solver.gear_phases is not None:
        # Where wheels count the turns, curves may cross at unknown inputs outside of the
        # range. Mode values are unknown (NaN) there.
        margin = 2.0 * UNKNOWN_AT_CROSSING_RAD
        starts = [-np.inf, low - margin, *starts[1:], high + margin]
        unknown = np.full_like(mode_values[0], np.nan)
        all_mode_values = [unknown, *all_mode_values, unknown]
        all_inputs = [inputs[0] * np.nan, *all_inputs, inputs[0] * np.nan]
    return SmoothModes(
        low=low,
        high=high,
        period=float(period),
        crossings=tuple(crossing_inputs.tolist()),
        are_all_known=position_analysis.claim.guarantee is Guarantee.COMPLETE,
        starts=tuple(starts),
        mode_values=np.array(all_mode_values),
        inputs=np.array(all_inputs),
    )


def passive_variables(terms: DesignExpressions) -> dict[str, int]:
    """Return the index of the variable of each R pair that is not driven, by pair name."""
    return {
        pair: variable
        for pair, variable in terms.mechanism.angles.items()
        if pair not in terms.inputs
    }


def _find_candidate(
    position_analysis: PositionAnalysis,
    sampled_motion: Motion,
    mode: AssemblyMode,
    crossing_inputs: Floats,
    varied: VariedMechanism,
    terms: DesignExpressions,
) -> ModeCandidate:
    """Choose configurations of an assembly mode, and determine its mode values.

    *Mode values* are the numbers that select the mode in the formulas: the signs of its
    dyads in closed form, otherwise the variables from which Newton's method starts. A dyad
    consists of two links and three R pairs. Its sign says in which of two ways it is
    assembled.

    Parameters
    ----------
    position_analysis, sampled_motion
        The position analysis of the mechanism, and its motion at about `MODE_SAMPLES`
        samples.
    crossing_inputs
        Inputs (rad) at which curves of configurations cross. The crossings divide the range
        into intervals, in which the mode has different values if it follows a smooth curve.
    varied, terms
        The mechanism of the formulas, and the terms from which they are built. The formulas
        can belong to an equivalent linkage, in which links replace contacts of circles.

    Raises
    ------
    ModeProblem
        If the mode is well conditioned at no sample, or if a dyad changes its sign within
        one interval.
    """
    motion = _select_well_conditioned_rows(
        position_analysis, sampled_motion, mode, crossing_inputs, terms.has_closed_form
    )
    interval = np.zeros(len(motion), dtype=np.intp)
    if len(crossing_inputs):
        interval = np.searchsorted(crossing_inputs, motion.inputs[:, 0])
    # Variables of the pairs in the formulas, which may be those of an equivalent linkage.
    values = motion.values
    if varied.equivalent_linkage is not None:
        values = varied.equivalent_linkage.values(values)
    interval_count = len(crossing_inputs) + 1
    if terms.has_closed_form and varied.equivalent_linkage is None:
        # A mode is defined by its signs. A mode that follows a smooth curve through
        # crossings consists of sections, one in each interval, with different signs.
        signs = [piece.signs for _, piece in mode.pieces] or [mode.signs] * interval_count
        return ModeCandidate(mode, motion, values, interval, np.array(signs, dtype=float))
    # The mode values of each interval are read from the configurations in it.
    mode_values: list[Floats | None] = []
    for number in range(interval_count):
        middle_row = _middle_row(interval, number)
        if middle_row is None:
            mode_values.append(None)
        elif terms.has_closed_form:
            mode_values.append(_dyad_signs(terms, values[interval == number]))
        else:
            mode_values.append(values[middle_row])
    # Intervals without a configuration get NaN.
    value_count = max(len(x) for x in mode_values if x is not None)
    unknown_values = np.full(value_count, np.nan)
    all_mode_values = np.array([unknown_values if x is None else x for x in mode_values])
    return ModeCandidate(mode, motion, values, interval, all_mode_values)


def _select_well_conditioned_rows(
    position_analysis: PositionAnalysis,
    sampled_motion: Motion,
    mode: AssemblyMode,
    crossing_inputs: Floats,
    includes_neighbours: bool,
) -> Motion:
    """Choose configurations of an assembly mode at which formulas are tested.

    The formulas must give the same configurations as the mechanism. Near a dead centre the
    variables are inaccurate, and Newton's method may converge to another mode. Therefore
    only the better conditioned half of the configurations in each interval is used: the
    configurations with a `sensitivity` up to the median.

    Parameters
    ----------
    position_analysis
        The position analysis of the mechanism, which computes more samples if necessary.
    sampled_motion
        The motion of all modes at about `MODE_SAMPLES` samples.
    crossing_inputs
        Inputs (rad) that divide the range into intervals.
    includes_neighbours
        Whether the accurate configurations next to each crossing are chosen as well.

    Returns
    -------
    Configurations (rows) of the mode, in the order of the samples: about `COMPARED_INPUTS`,
    or `LEAST_COMPARED_INPUTS` in each interval if that is more.

    Raises
    ------
    ModeProblem
        If no sample of the mode is accurate enough to be compared.
    """
    # Find accurate rows of the mode, if necessary among more samples.
    rows = _find_accurate_rows(sampled_motion, mode)
    if not len(rows) and len(position_analysis.inputs) == 1:
        sampled_motion = position_analysis.at(
            np.linspace(*position_analysis.range, FINE_SAMPLES)
        )
        rows = _find_accurate_rows(sampled_motion, mode)
    if not len(rows):
        status_codes = sampled_motion.status[sampled_motion.assembly_mode == mode.number]
        counts = zip(*np.unique(status_codes, return_counts=True), strict=True)
        statuses = listing(f"{count} {Status(int(code)).name}" for code, count in counts)
        raise ModeProblem(
            f"no sample was found at which the mode is well conditioned ({statuses}); give "
            "ranges of the inputs in which it exists"
        )
    motion = sampled_motion.rows(rows)
    sensitivity = motion.sensitivity
    if not len(crossing_inputs):
        return motion.rows(
            _spread_well_conditioned(sensitivity, np.arange(len(rows)), COMPARED_INPUTS)
        )
    # Choose rows in each interval that has accurate rows. Crossings are known with one
    # input only.
    interval = np.searchsorted(crossing_inputs, motion.inputs[:, 0])
    interval_numbers = np.unique(interval)
    count = max(LEAST_COMPARED_INPUTS, COMPARED_INPUTS // len(interval_numbers))
    chosen: list[Indices] = []
    for number in interval_numbers:
        in_interval = np.flatnonzero(interval == number)
        chosen.append(_spread_well_conditioned(sensitivity, in_interval, count))
        if includes_neighbours:
            chosen.append(in_interval[[0, -1]])  # next to the two ends of the interval
    return motion.rows(np.unique(np.concatenate(chosen)))


def _spread_well_conditioned(sensitivity: Floats, rows: Indices, count: int) -> Indices:
    """Choose rows (configurations), spread evenly over the better conditioned half of rows.

    Variables of well conditioned configurations are exact enough to test formulas with
    them.

    Parameters
    ----------
    sensitivity
        (n,) sensitivity of all n configurations of a motion: the largest error of the
        variables per unit of the error with which the loops are closed.
    rows
        Indices of the configurations among which to choose.
    count
        Largest number of rows to return.
    """
    well_conditioned = rows[sensitivity[rows] <= np.median(sensitivity[rows])]
    # Choose rows at even distances in the list.
    positions = np.linspace(0, len(well_conditioned) - 1, count)
    return np.asarray(well_conditioned[np.unique(np.round(positions).astype(int))])


def _find_accurate_rows(sampled_motion: Motion, mode: AssemblyMode) -> Indices:
    """Return the indices of the rows of a mode that are accurate enough to compare.

    A row is one configuration of one assembly mode. An accurate row has the status OK, and
    the error bound of its variables does not exceed `MAX_CONFIGURATION_ERROR_RAD`.
    """
    is_valid = (sampled_motion.assembly_mode == mode.number) & (
        sampled_motion.status == Status.OK
    )
    rows = np.flatnonzero(is_valid)
    is_accurate = sampled_motion.rows(rows).kantorovich_error <= MAX_CONFIGURATION_ERROR_RAD
    return np.asarray(rows[is_accurate])


def _dyad_signs(terms: DesignExpressions, values: Floats) -> Floats:
    """Return the sign of each dyad (two links and three R pairs) in one assembly mode.

    A dyad can be assembled in two ways. The sign of the dyad, which is the sign of the
    triple product of its three axes, tells which way is meant. The formulas belong to an
    equivalent linkage of the mechanism: links between the centres of circles replace their
    contacts.

    Parameters
    ----------
    terms
        The terms of the formulas, for the equivalent linkage.
    values
        (n, variables) variables (rad) of the equivalent linkage in n configurations of the
        mode.

    Returns
    -------
    (dyads,) signs +1 or -1, in the order in which the dyads are solved.

    Raises
    ------
    ModeProblem
        If a dyad changes its sign within the mode.
    """
    mechanism = terms.mechanism
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    # (n, variables, 3) unit vector along the axis of each variable, in each configuration
    axis_by_variable = closure.linearise(values).vectors
    signs: list[float] = []
    # In closed form every group is a dyad.
    for group in terms.structure.assembly.groups:
        # The three pairs are R pairs, which have one variable each.
        dyad_variables = [mechanism.variables_of(pair)[0] for pair in group.pairs]
        axes = axis_by_variable[:, dyad_variables]  # (n, 3, 3)
        triple_products = np.linalg.det(axes)  # (n,)
        # At a dead centre the triple product is zero. The sign of the largest triple
        # product is the most reliable.
        largest = triple_products[np.argmax(np.abs(triple_products))]
        reliable = triple_products[np.abs(triple_products) > MIN_TRIPLE_PRODUCT]
        if np.any(reliable * largest < 0.0):
            pairs = listing(mechanism.names_of(group.pairs))
            raise ModeProblem(
                f"the dyad of pairs {pairs} changes its side within this mode; export "
                "ranges of the inputs in which it does not"
            )
        signs.append(1.0 if largest >= 0.0 else -1.0)
    return np.array(signs)


def _compute_deviations(
    formulas: Formulas,
    terms: DesignExpressions,
    angles: Sequence[Expr],
    candidates: Sequence[ModeCandidate],
) -> list[Floats]:
    """Compute how far results of the formulas are from known configurations of the modes.

    In closed form the formulas compute the variables from the signs of the dyads. Otherwise
    Newton's method starts near each configuration: each variable is moved by an amount so
    small that the method should not converge to another mode.

    Parameters
    ----------
    formulas, terms
        The formulas, and the terms from which they are built.
    angles
        In closed form the variables of the R pairs that are not driven, as terms.
    candidates
        The assembly modes with their configurations.

    Returns
    -------
    For each candidate an array (n,): in each of its n configurations, the largest
    difference (rad) of a variable between formulas and mechanism; NaN where the formulas do
    not close.
    """
    if not candidates:
        return []
    counts = [len(candidate.motion) for candidate in candidates]
    # The configurations of all candidates are computed together. Each is one column.
    inputs = np.concatenate([candidate.motion.inputs for candidate in candidates]).T
    expected = np.concatenate([candidate.values for candidate in candidates]).T
    motion = np.zeros((len(formulas.motion), sum(counts)))
    # The inputs come first. The other rows (rates, accelerations, loads) may be zero,
    # because the variables of pairs do not depend on them.
    motion[: len(inputs)] = inputs
    if terms.has_closed_form:
        # (values, configurations): for each configuration the mode values in its interval
        mode_values = np.concatenate(
            [candidate.mode_values[candidate.interval] for candidate in candidates]
        ).T
        evaluate = formulas.numpy_function(angles)
        computed = evaluate(motion, mode_values, formulas.size_values)
        deviation = wrap(computed - expected[[*passive_variables(terms).values()]])
    else:
        sensitivity = np.concatenate(
            [mode_candidate.motion.sensitivity for mode_candidate in candidates]
        )
        offset = START_OFFSET_RAD / np.maximum(1.0, sensitivity**2)
        # The variables are moved in alternating directions.
        directions = np.where(np.arange(len(expected)) % 2, 1.0, -1.0)
        computed = expected + directions[:, None] * offset
        step = formulas.numpy_function(formulas.step)
        for _ in range(NEWTON_STEPS):
            # The last row is the closure residual.
            computed = step(motion, computed, formulas.size_values)[:-1]
        deviation = computed - expected
        # Differences of angles are taken modulo 2 pi. The other variables are arc lengths
        # of profiles.
        angle_rows = [*terms.mechanism.angles.values()]
        # Where Newton's method has diverged, a deviation is infinite and becomes NaN.
        with np.errstate(invalid="ignore"):
            deviation[angle_rows] = wrap(deviation[angle_rows])
    largest = max_abs(deviation, axis=0) if len(deviation) else np.zeros(deviation.shape[1])
    return np.split(largest, np.cumsum(counts)[:-1])
