"""Singularities against poles, motions and the velocity equations."""

from typing import Any

import numpy as np
from cross_checks.assembly_modes import describe_inputs
from cross_checks.evidence import Kind, check

from spherekit.completeness import Guarantee
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.input_revolutions import whole_periods

MIN_SINGULAR_CONDITIONING = 1e5
"""Least condition number, with locked inputs, at a singularity that is listed."""
DISTANCE_BESIDE_RAD = 1e-7
"""Distance (rad) in the inputs between a listed singularity and a point beside it."""
MIN_CONDITIONING_BESIDE = 30.0
"""Least condition number, with locked inputs, of the worst mode at such a point."""
SAME_INPUT_RAD = 1e-6
"""Inputs (rad) that differ by less are the same."""
MAX_CHECKED = 8
"""Largest number of singularities of a mechanism that are checked."""
END_TOLERANCE_RAD = 1e-5
"""Distance (rad) by which a listed input may lie outside the range of the input."""


def listed(evidence, notes):
    """Return the tables of singularities by their default command, if there are any."""
    result = evidence.run_analysis("singularities")
    if result.status:
        return None
    return result.tables


INPUT_RESTS = ("II", "III", "self-motion")
"""Kinds of places at which links can move though the inputs are locked."""


@check("places are singular", "where a locked input lets links move, rank is lost")
def places_are_singular(evidence, notes):
    """Look at the conditioning of the mechanism with its inputs locked."""
    tables = listed(evidence, notes)
    if tables is None:
        return
    points = tables["singularities"]
    points = points[points["kind"].isin(INPUT_RESTS)]
    if evidence.has_one_input:
        _check_on_curves(evidence, points, notes)
    else:
        _check_beside_listed_inputs(evidence, points, notes)


def _check_on_curves(evidence, points, notes):
    """Check listed singularities of a mechanism with one input.

    Each must lie on its configuration curve at the input that is listed. There the
    mechanism with a locked input must be nearly movable: its condition number
    (`conditioning`) must exceed `MIN_SINGULAR_CONDITIONING`. Only singularities that are
    certain and have an arc length `s` on a curve are checked. In a singularity of type III
    two curves may cross.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and the results of its analyses; and `Notes`,
        which collect contradictions.
    points
        The table of singularities at which the input can rest while links move.
    """
    curves = evidence.configurations.curves
    position_analysis = evidence.position_analysis
    input_variable = position_analysis.solver.input_variable
    points = points[points["s"].notna() & (points["certain"] == "yes")]
    # Where the analysis left out links that only follow the others, the table has no angles
    # of their pairs. The arc length `s` then does not count their motion, so it is no place
    # on these curves.
    points = _with_all_angles(points)
    row: Any
    # A few singularities of each mechanism are enough.
    for row in points.head(MAX_CHECKED).itertuples():
        values = curves[row.curve].curve.at(row.s).values.reshape(1, -1)
        conditioning = float(position_analysis.given(values).conditioning[0])
        notes.add_contradiction_if(
            not conditioning > MIN_SINGULAR_CONDITIONING,
            f"{row.kind} of {row.output} at q = {np.degrees(row.q):.9g} deg (curve "
            f"{row.curve}, s = {row.s:.9g}): the locked mechanism has the conditioning "
            f"{conditioning:.3g} there",
        )
        if row.kind == "III":
            # A computed curve ends a small distance before a crossing, so its input differs
            # there. The condition number is large all the same.
            continue
        input_difference = abs(values[0, input_variable] - row.q)
        # Inputs that differ by whole turns are the same.
        whole_turns = round(input_difference / (2.0 * np.pi))
        gap = abs(input_difference - 2.0 * np.pi * whole_turns)
        notes.add_contradiction_if(
            not gap < SAME_INPUT_RAD,
            f"{row.kind} of {row.output}: the curve is at {gap:.2e} rad from q = "
            f"{row.q:.9g}",
        )


def _with_all_angles(points):
    """Return the rows of a table of singularities in which no pair angle is NaN.

    The analysis leaves out links that only follow the others. Their pair angles are NaN,
    and the arc length `s` of such a row does not count their motion.
    """
    has_angles = points.filter(like="theta_").notna()
    return points[has_angles.all(axis=1)]


def _check_beside_listed_inputs(evidence, points, notes):
    """Check listed singularities of a mechanism with several inputs.

    At a singularity of type II or III two configurations meet, and the mechanism can move
    although its inputs are locked. One input at a time is changed by `DISTANCE_BESIDE_RAD`,
    up and down, and all configurations are computed there. At least one of them must be
    nearly singular: its condition number with locked inputs (`conditioning`) must be at
    least `MIN_CONDITIONING_BESIDE`. The condition number is infinite at a singularity.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and the results of its analyses; and `Notes`,
        which collect contradictions.
    points
        Rows of the table of singularities, all of type II or III.
    """
    position_analysis = evidence.position_analysis
    names = [f"q_{name}" for name in position_analysis.inputs]
    listed_inputs = points[names].to_numpy(dtype=float)
    chosen = evidence.random.permutation(len(listed_inputs))[:MAX_CHECKED]
    directions = np.concatenate([np.eye(len(names)), -np.eye(len(names))])
    for singular_inputs in listed_inputs[chosen]:
        # The largest condition number; 0 if no configuration exists beside the singularity.
        worst = 0.0
        for direction in directions:
            inputs = singular_inputs + DISTANCE_BESIDE_RAD * direction
            values = enumerate_assemblies(position_analysis.solver, inputs).values
            if len(values):
                conditioning = position_analysis.given(values).conditioning
                worst = max(worst, float(np.nanmax(conditioning)))
        notes.add_contradiction_if(
            0.0 < worst < MIN_CONDITIONING_BESIDE,
            f"type II or III at {describe_inputs(singular_inputs)}: "
            f"{DISTANCE_BESIDE_RAD:g} rad beside it the worst "
            f"conditioning of all modes is {worst:.3g}",
        )


@check(
    "assembly modes end at places",
    "where an assembly mode goes out of reach a type II is listed",
)
def assembly_modes_end_at_places(evidence, notes):
    """Require a listed singularity wherever an assembly mode ends between two samples.

    An assembly mode (way to assemble the links) ends where one sample is OK and the next
    one is out of reach, or the other way round. There two modes meet, at a singularity of
    type II or III. If the configurations were only searched at samples, a missing
    singularity may not have been found (`Kind.NOT_FOUND`); otherwise it is a contradiction.
    Only mechanisms with one input are checked.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and the results of its analyses; and `Notes`,
        which collect contradictions.
    """
    tables = listed(evidence, notes) if evidence.has_one_input else None
    if tables is None:
        return
    is_sampled = evidence.configurations.guarantee is Guarantee.SAMPLED
    all_points = tables["singularities"]
    points = all_points[all_points["kind"].isin(INPUT_RESTS)]  # type II or III
    for assembly_mode, rows in tables["motion"].groupby("assembly_mode"):
        is_of_mode = [_names_mode(text, assembly_mode) for text in points["assembly_mode"]]
        points_of_mode = points[np.array(is_of_mode, dtype=bool)]
        for low, high in _find_mode_ends(rows):
            notes.count_comparisons()
            if not _is_point_listed_between(evidence, points_of_mode, low, high):
                notes.add_finding(
                    f"assembly mode {assembly_mode} ends between q = "
                    f"{np.degrees(low):.6f} and "
                    f"{np.degrees(high):.6f} deg, and no type II or III of it is listed",
                    Kind.NOT_FOUND if is_sampled else Kind.CONTRADICTION,
                )


def _find_mode_ends(rows):
    """Return the intervals (low, high) of the input, rad, in which a mode begins or ends.

    `rows` are the samples of one assembly mode. One end of each interval is a sample that
    is OK, and the other end the next sample, which is out of reach.
    """
    q = rows["q"].to_numpy()
    status = rows["status"].to_numpy()
    return [
        (min(q[k], q[k + 1]), max(q[k], q[k + 1]))
        for k in range(len(q) - 1)
        if {status[k], status[k + 1]} == {"OK", "OUT_OF_REACH"}
    ]


def _is_point_listed_between(evidence, points, low, high):
    """Return whether one of some listed singularities is in an interval of the input.

    A row without an arc length `s` and an input `q` is a curve that is singular as a whole,
    so it counts for every interval.

    Parameters
    ----------
    evidence
        `Evidence`, which has the mechanism.
    points
        Rows of the table of singularities.
    low, high
        Ends of the interval (rad). Singularities up to `SAME_INPUT_RAD` outside count, too.
    """
    is_whole_curve = points["s"].isna() & points["q"].isna()
    if is_whole_curve.any():
        return True
    # Over a whole turn both ends of the range are one configuration, which is listed at one
    # end only. It is added at the other end.
    listed_q = add_opposite_ends(evidence, points["q"].to_numpy(dtype=float))
    is_between = (listed_q >= low - SAME_INPUT_RAD) & (listed_q <= high + SAME_INPUT_RAD)
    return bool(is_between.any())


def add_opposite_ends(evidence, q):
    """Return inputs (n,) rad, with those at one end of a whole turn also at the other end.

    If the range of the input is whole turns, both of its ends are the same configurations,
    which the table of singularities lists once.
    """
    (item,) = evidence.position_analysis.mechanism.inputs
    low, high = sorted((item.start, item.stop))
    (period,) = evidence.position_analysis.solver.periods
    if not whole_periods(low, high, period):
        return q
    candidates = np.concatenate([q, q + (high - low), q - (high - low)])
    is_in_range = (candidates >= low - END_TOLERANCE_RAD) & (
        candidates <= high + END_TOLERANCE_RAD
    )
    return candidates[is_in_range]


def _names_mode(text, assembly_mode):
    """Return whether a text such as "0, 1" or "0+1" contains the number of a mode."""
    return str(assembly_mode) in str(text).replace(",", " ").replace("+", " ").split()


@check("singular rows are listed", "where rows are AT_SINGULARITY a place is listed")
def singular_rows_are_listed(evidence, notes):
    """Require a listed singularity within 1e-3 rad of every row that is AT_SINGULARITY.

    A row is one sample in one assembly mode. No singularity is required if the run says
    that the mechanism is singular everywhere, or if a whole configuration curve is listed
    as singular. With several inputs nothing is required, and rows are only counted: the
    singular configurations are then curves or surfaces, and the list has some points only.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and the results of its analyses; and `Notes`,
        which collect contradictions.
    """
    tables = listed(evidence, notes)
    if tables is None:
        return
    points = tables["singularities"]
    motion = tables["motion"]
    rows = motion[motion["status"] == "AT_SINGULARITY"]
    if not len(rows):
        return
    run = evidence.run_analysis("singularities")
    is_everywhere = "everywhere" in run.printed or "in every configuration" in run.printed
    if evidence.has_one_input:
        names = ["q"]
        listed_q = points["q"].to_numpy(dtype=float)
        # Both ends of a range of whole turns are one configuration, listed once.
        places = add_opposite_ends(evidence, listed_q)[:, None]
        # A row without an arc length `s` is a whole singular curve.
        has_whole_curve = bool(points["s"].isna().any())
    else:
        if not len(points):
            return  # the default command does not follow singular surfaces
        names = [f"q_{name}" for name in evidence.position_analysis.inputs]
        places = points[names].to_numpy(dtype=float)
        has_whole_curve = False
    is_required = evidence.has_one_input and not has_whole_curve and not is_everywhere
    for q in rows[names].to_numpy()[:MAX_CHECKED]:
        gap = np.min(np.max(np.abs(places - q), axis=1), initial=np.inf)
        is_listed = gap < 1e-3
        notes.add_contradiction_if(
            is_required and not is_listed,
            f"a row at {describe_inputs(q)} is AT_SINGULARITY, the nearest place listed is "
            f"{gap:.2e} rad off",
        )
