"""Angles of passive pairs over full revolutions, for many designs at once.

Closed forms give the angles of pairs in (-pi, pi]. Loads such as wound springs depend on
the revolutions, too. The angles are therefore followed from the *anchor*, where they are in
(-pi, pi], along the inputs to each sample, as `positions.angle_unwrapping` does for one
mechanism. The inputs between the anchor and the sample are so dense that no angle moves far
from one input to the next.

The functions return *revolution offsets*: multiples of 2 pi (rad) to be added to the angles
that the closed form gives.
"""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.angle_unwrapping import count_revolutions

INPUT_SPACING_RAD = np.radians(3.0)
"""Largest distance (rad) of successive inputs at which angles are evaluated.

Larger: a quick revolution between two inputs may be missed. Smaller: more time.
"""

MAX_ANGLE_STEP_RAD = 1.0
"""Largest change (rad) of an angle between two inputs; otherwise the interval is halved.

The limit is below half a revolution, from which on the direction of a change is ambiguous.
"""

MAX_INPUT_HALVINGS = 12
"""Largest number of halvings of an interval of inputs.

An angle that still changes by more than `MAX_ANGLE_STEP_RAD` is not followed there. Larger:
angles are followed nearer to singular configurations. Smaller: less time there.
"""

MODE_END_BISECTIONS = 30
"""Number of bisections by which the input at which an assembly mode ends is found."""

AngleFunction = Callable[[Indices, Floats], Floats]
"""A function that returns the angles (pairs, m), in rad, of some pairs.

Its arguments are the indices (m,) of designs and the inputs (m, inputs) of each. The angles
are NaN where a design does not close.
"""


def _follow_all_designs(
    angles_at: AngleFunction, design_count: int, q: Floats
) -> tuple[Floats, Floats]:
    """Return angles of all designs at successive inputs, and their changes in between.

    The angles belong to pairs (joints) for which loads depend on whole revolutions. The
    change (growth) of an angle is continuous, without jumps by 2 pi.

    Parameters
    ----------
    angles_at
        Function of design indices (m,) and inputs (m, inputs). It returns the angles
        (pairs, m) in rad.
    design_count
        Number n of designs.
    q
        (k, inputs) successive inputs (rad).

    Returns
    -------
    angles
        (pairs, k, n) angles (rad) in (-pi, pi].
    growth
        (pairs, k - 1, n) growth (rad) of each angle from one input to the next, NaN where
        it cannot be followed.
    """
    # All designs at the first input, then all designs at the second input, and so on.
    designs = np.tile(np.arange(design_count), len(q))
    inputs = np.repeat(q, design_count, axis=0)
    angles = angles_at(designs, inputs)
    # The same design at the next input is n places later in these arrays. So the starts of
    # steps are all places except the last n, and the ends all except the first n.
    growth = _follow_growth(
        angles_at,
        designs[design_count:],
        start_inputs=inputs[:-design_count],
        end_inputs=inputs[design_count:],
        start_angles=angles[:, :-design_count],
        end_angles=angles[:, design_count:],
    )
    pair_count = len(angles)
    return (
        angles.reshape(pair_count, -1, design_count),
        growth.reshape(pair_count, -1, design_count),
    )


def _follow_growth(
    angles_at: AngleFunction,
    designs: Indices,
    start_inputs: Floats,
    end_inputs: Floats,
    start_angles: Floats,
    end_angles: Floats,
    halvings: int = MAX_INPUT_HALVINGS,
) -> Floats:
    """Return by how much angles grow between two inputs, without jumps by revolutions.

    The angles are known up to whole revolutions. Their difference in (-pi, pi] is the
    growth if it is small. Where it exceeds `MAX_ANGLE_STEP_RAD` for some angle of a design,
    the interval of the inputs is halved, and the growths of both halves are added.

    Parameters
    ----------
    angles_at
        Function of design indices (m,) and inputs (m, inputs) that returns the angles
        (pairs, m) in rad.
    designs
        (m,) index of the design of each interval.
    start_inputs, end_inputs
        (m, inputs) inputs (rad) at the ends of each interval.
    start_angles, end_angles
        (pairs, m) angles (rad) at these inputs.
    halvings
        Number of times that an interval may still be halved.

    Returns
    -------
    (pairs, m) growth (rad). NaN for intervals on which the angles cannot be followed: the
    design does not close at an input, or an angle changes too much even on the shortest
    interval.
    """
    growth = wrap(end_angles - start_angles)
    # Indices of the intervals that are too long.
    long = np.flatnonzero(max_abs(growth, axis=0) > MAX_ANGLE_STEP_RAD)
    growth[:, long] = np.nan
    if len(long) and halvings:
        middle_inputs = 0.5 * (start_inputs[long] + end_inputs[long])
        middle_angles = angles_at(designs[long], middle_inputs)
        first_half = _follow_growth(
            angles_at,
            designs[long],
            start_inputs=start_inputs[long],
            end_inputs=middle_inputs,
            start_angles=start_angles[:, long],
            end_angles=middle_angles,
            halvings=halvings - 1,
        )
        second_half = _follow_growth(
            angles_at,
            designs[long],
            start_inputs=middle_inputs,
            end_inputs=end_inputs[long],
            start_angles=middle_angles,
            end_angles=end_angles[:, long],
            halvings=halvings - 1,
        )
        growth[:, long] = first_half + second_half
    return growth


def unwrap_along_one_input(
    angles_at: AngleFunction,
    design_count: int,
    anchor: float,
    q: Floats,
    repeats: bool,
) -> Floats:
    """Return the whole revolutions to add to pair angles, so that they are continuous.

    An offset is the multiple of 2 pi that is added to an angle in (-pi, pi]. The sum is
    continuous along the only input, from the anchor on. Loads such as wound springs depend
    on it.

    If configurations repeat, the angles are followed over one revolution of the input (a
    lap). What they gain in a lap is added for each lap.

    Parameters
    ----------
    angles_at
        The angles of designs at inputs.
    design_count
        Number n of designs.
    anchor
        Input (rad) at which angles are in (-pi, pi].
    q
        (k,) inputs (rad).
    repeats
        Whether the configurations repeat after a revolution of the input; false if gear
        ratios relate angles to the input.

    Returns
    -------
    (pairs, k, n) offsets (rad), zero where a design does not close.
    """
    # Without repetition the lap is 0 for all inputs.
    laps = np.floor((q - anchor) / TURN) * repeats
    reduced_q = q - laps * TURN
    ends = [anchor, *reduced_q]
    if repeats:
        ends.append(anchor + TURN)
    spacing_count = int(np.ptp(ends) / INPUT_SPACING_RAD)
    dense = np.linspace(min(ends), max(ends), 2 + spacing_count)
    # All inputs at which angles are evaluated, rising.
    stations = np.unique([*ends, *dense])
    angles, growth = _follow_all_designs(angles_at, design_count, stations[:, None])
    anchor_index = np.searchsorted(stations, anchor)
    # Angles are followed from the anchor to larger inputs, and then to smaller ones.
    unwrapped = np.empty_like(angles)
    upwards = slice(anchor_index, None)
    unwrapped[:, upwards] = _accumulate_growth(
        angles_at, stations[upwards], angles[:, upwards], growth[:, anchor_index:]
    )
    downwards = slice(anchor_index, None, -1)
    unwrapped[:, downwards] = _accumulate_growth(
        angles_at,
        stations[downwards],
        angles[:, downwards],
        -growth[:, :anchor_index][:, ::-1],
    )
    growth_per_lap = np.zeros_like(unwrapped[:, 0])
    if repeats:
        lap_growth = np.round((unwrapped[:, -1] - unwrapped[:, 0]) / TURN) * TURN
        # (stations - 1, n) whether angles can be followed from a station to the end of the
        # lap, which is the anchor of the next lap.
        reaches_end = np.isfinite(np.cumsum(growth[0, ::-1], axis=0))[::-1]
        closes_all_round = reaches_end[0]
        # If a mode ends within the lap, angles of the piece that reaches the end of the lap
        # are counted from the anchor of the next lap.
        unwrapped[:, :-1] -= np.where(
            reaches_end & ~closes_all_round, lap_growth[:, None], 0.0
        )
        growth_per_lap = np.where(closes_all_round, lap_growth, 0.0)
        unwrapped[:, -1] = unwrapped[:, 0] + growth_per_lap
    index = np.searchsorted(stations, reduced_q)
    offsets = (
        unwrapped[:, index] + laps[:, None] * growth_per_lap[:, None] - angles[:, index]
    )
    return np.nan_to_num(offsets)


def _accumulate_growth(
    angles_at: AngleFunction, stations: Floats, angles: Floats, growth: Floats
) -> Floats:
    """Add up the changes of angles, so that angles count whole revolutions.

    A station is a value of the input. The sums start with the angles at the first station.
    Between two stations a design may have a gap: its angles cannot be followed, for example
    because it cannot be assembled. Counting then starts anew with angles in (-pi, pi] at
    the end of the gap, which is found by bisection.

    Parameters
    ----------
    angles_at
        Function of design indices (m,) and inputs (m, 1) that returns the angles (pairs, m)
        in rad, NaN where a design does not close.
    stations
        (k,) successive values (rad) of the input.
    angles
        (pairs, k, n) angles (rad) of n designs at the stations, in (-pi, pi].
    growth
        (pairs, k - 1, n) change (rad) of each angle from one station to the next. NaN where
        it cannot be followed, for example where the design cannot be assembled.

    Returns
    -------
    (pairs, k, n) angles (rad) over full revolutions, NaN where a design cannot be
        assembled.
    """
    unwrapped = np.empty_like(angles)
    # An angle of half a revolution may be just above -pi by rounding. It becomes pi.
    unwrapped[:, 0] = _replace_minus_half_revolution(angles[:, 0])
    for k in range(1, len(stations)):
        next_angles = unwrapped[:, k - 1] + growth[:, k - 1]
        # NaN if the angles could not be followed from the station before. If one pair of a
        # design is NaN, all are. So the first pair tells.
        is_continued = ~np.isnan(next_angles[0])
        closes = np.isfinite(angles[0, k])
        # Designs for which counting starts anew here.
        designs = np.flatnonzero(closes & ~is_continued)
        if len(designs):
            next_angles[:, designs] = _unwrap_from_mode_end(
                angles_at,
                designs,
                input_before=stations[k - 1],
                next_input=stations[k],
                wrapped_angles=angles[:, k, designs],
            )
        unwrapped[:, k] = next_angles
    return unwrapped


def _replace_minus_half_revolution(angles: Floats) -> Floats:
    """Replace angles of -pi, up to rounding, by pi, the other name of the same angle.

    All `angles` (rad) are in (-pi, pi]. Without the replacement, rounding would decide
    whether an angle of half a revolution counts as one revolution more or less.
    """
    # The count is -1 for angles that are -pi up to rounding, and 0 for all others.
    return angles - TURN * count_revolutions(angles)


def _unwrap_from_mode_end(
    angles_at: AngleFunction,
    designs: Indices,
    input_before: float,
    next_input: float,
    wrapped_angles: Floats,
) -> Floats:
    """Return angles at an input for assembly modes that begin shortly before it.

    An assembly mode is one way to assemble the mechanism. A mode begins at the first input
    at which the mechanism can be assembled, which is found by bisection. At this input the
    angles are in (-pi, pi]. The angles are followed to `next_input`, where they may be
    outside this range. Angles that cannot be followed are in (-pi, pi] at `next_input`.

    Parameters
    ----------
    angles_at
        Function of design indices (m,) and inputs (m, 1) that returns the angles (pairs, m)
        in rad, NaN where a design does not close.
    designs
        (m,) indices of designs.
    input_before
        Input (rad) from which angles cannot be followed to `next_input`, usually because
        the designs cannot be assembled there.
    next_input
        Input (rad) at which all of the designs can be assembled.
    wrapped_angles
        (pairs, m) angles (rad) at `next_input`, in (-pi, pi].

    Returns
    -------
    (pairs, m) angles (rad) at `next_input`, not wrapped to (-pi, pi].
    """
    end_inputs = np.full((len(designs), 1), next_input)
    # The beginning of each mode is between `outside`, where it does not exist, and
    # `inside`, where it does.
    outside = np.full((len(designs), 1), input_before)
    inside = end_inputs
    inside_angles = wrapped_angles
    for _ in range(MODE_END_BISECTIONS):
        middle = 0.5 * (outside + inside)
        middle_angles = angles_at(designs, middle)
        closes = np.isfinite(middle_angles[0])
        inside = np.where(closes[:, None], middle, inside)
        outside = np.where(closes[:, None], outside, middle)
        inside_angles = np.where(closes, middle_angles, inside_angles)
    # The change of each angle from the start of the mode to `next_input`, without jumps
    # by whole revolutions.
    growth = _follow_growth(
        angles_at,
        designs,
        start_inputs=inside,
        end_inputs=end_inputs,
        start_angles=inside_angles,
        end_angles=wrapped_angles,
    )
    # An angle of half a revolution may be just above -pi by rounding. It becomes pi.
    start_angles = _replace_minus_half_revolution(inside_angles)
    reduced_angles = _replace_minus_half_revolution(wrapped_angles)
    # `growth` is NaN where the angles cannot be followed.
    return np.where(np.isnan(growth), reduced_angles, start_angles + growth)


def unwrap_along_several_inputs(
    angles_at: AngleFunction, design_count: int, anchor: Floats, q: Floats, points: Floats
) -> Floats:
    """Return the whole revolutions to add to pair angles, so that they are continuous.

    An offset is the multiple of 2 pi that is added to an angle in (-pi, pi]. The sum is
    continuous from sample to sample.

    Each sample is reached from the sample before on a straight path of the inputs, the
    first one from the anchor. Points are reached from the nearest sample. If a design does
    not close all along such a path, the straight path from the anchor is tried. If the
    design does not close along that path, either, the sum is left in (-pi, pi].

    Parameters
    ----------
    angles_at
        The angles of designs at inputs.
    design_count
        Number n of designs.
    anchor
        (inputs,) inputs (rad) at which angles are in (-pi, pi].
    q
        (k, inputs) samples (rad).
    points
        (m, inputs) further inputs (rad).

    Returns
    -------
    (pairs, k + m, n) offsets (rad) of the angles at the samples and then at the points.
    They are zero where a design does not close.
    """
    targets = np.concatenate([q, points])
    # The sample from which each target is reached. The first target is reached from the
    # anchor; its -1 is not used.
    origins = [*range(-1, len(q) - 1)]
    origins += [int(np.argmin(max_abs(q - point, axis=1))) for point in points]
    anchor_angles = angles_at(np.arange(design_count), np.tile(anchor, (design_count, 1)))
    anchor_offsets = -TURN * count_revolutions(anchor_angles)
    offsets = np.zeros((len(anchor_offsets), len(targets), design_count))
    for k, (target, origin) in enumerate(zip(targets, origins, strict=True)):
        target_offsets = np.full_like(anchor_offsets, np.nan)
        from_anchor = (anchor, anchor_offsets)
        from_origin = (targets[origin], offsets[:, origin]) if k else from_anchor
        for start, start_offsets in (from_origin, from_anchor):
            path = np.linspace(
                start, target, 2 + int(max_abs(target - start) / INPUT_SPACING_RAD)
            )
            # `growth` is NaN on steps on which a design cannot be followed.
            angles, growth = _follow_all_designs(angles_at, design_count, path)
            total_growth = np.sum(growth, axis=1)
            # The offset grows by the continuous growth minus the change of the angles
            # themselves, which may jump by whole revolutions.
            followed = start_offsets + total_growth - (angles[:, -1] - angles[:, 0])
            target_offsets = np.where(np.isnan(target_offsets), followed, target_offsets)
            # The path from the anchor is tried only if an angle that exists at the target
            # has no offset yet.
            if not np.any(np.isnan(target_offsets) & np.isfinite(angles[:, -1])):
                break
        reduced = -TURN * count_revolutions(angles[:, -1])
        target_offsets = np.where(np.isnan(target_offsets), reduced, target_offsets)
        offsets[:, k] = np.nan_to_num(TURN * np.round(target_offsets / TURN))
    return offsets
