"""Points at which an output comes near a singularity along its curves without reaching it.

The distance from type I is measured by the velocity coefficient, the distance from type
II by the transmission measure. Unlike c and d of a relation c y' = d q', neither
vanishes if the links of the relation are badly chosen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.minima import find_local_minima
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.configuration_space import Piece
from spherekit.singularities.input_output_relation import Type
from spherekit.singularities.passed_parts import PassedPart
from spherekit.singularities.sampled_singularities import (
    END_TOLERANCE_RAD,
    SampledSingularities,
)
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_TRANSMISSION
from spherekit.velocities.transmission_angle import distance_from_type_two

EQUAL_EXTREMUM_INPUT_RAD = 1e-7
"""Inputs of an extremum that differ by less count as the same input: rounding leaves
half the digits of its position. Larger: an extremum just before the end of a full range
is moved to its start."""
EQUAL_MINIMUM_RAD = 1e-7
"""Arc lengths of a minimum in two laps that differ by less from a lap are one minimum,
because rounding leaves half the digits of its position. Larger: two minima near the seam
of laps can become one. Smaller: a minimum at the seam is listed twice."""
EQUAL_TRANSMISSION_ANGLE_RAD = 1e-8
"""Transmission angles that differ by less are equal. Larger: modes that come slightly less
near to type II are listed, too."""
INWARD_PART = 1e-3
"""Distance from the end of a piece of a curve, in parts of its length, at which a
measure is compared with its value at the end."""


AngleFunction = Callable[[Floats], Floats]
"""A function that returns angles (n,) in rad at arc lengths (n,) of a curve."""


@dataclass(frozen=True)
class NearMiss:
    """A point at which an output comes near a type of singularity without reaching it.

    Attributes
    ----------
    type, output
        The type, I (the output rests) or II (the input rests), and the index of the output
        among the outputs.
    curve, s
        Index of the curve of configurations, and arc length of the point on the curve
        (rad).
    q
        The input at the point (rad), within the range of the input.
    assembly_modes
        Numbers of the assembly modes (ways to assemble the mechanism) that have the
        configuration.
    angle
        The distance (rad) from the singularity: for type I the arctangent of the velocity
        coefficient, for type II the arcsine of the transmission measure. This measure
        states from 0 to 1 how firmly the locked input holds the output.
    velocity_coefficient
        The absolute value of y'/q', the rate of the output divided by the rate of the
        input.
    """

    type: Type
    output: int
    curve: int
    s: float
    q: float
    assembly_modes: tuple[int, ...]
    angle: float
    velocity_coefficient: float


def near_misses(sampled: SampledSingularities, near: float) -> list[NearMiss]:
    """Return the points at which outputs come near singularities of types I and II.

    The distance from a type is an angle, which is at most `near` at a near miss:

    - At type I the output rests while the input moves. The tangent of the angle is the
      velocity coefficient, the rate of the output divided by the rate of the input.
    - At type II the output can move although the input is locked. The sine of the angle is
      the transmission measure, which states from 0 to 1 how firmly the locked input holds
      the output.

    Singular configurations themselves are not included. In some mechanisms these angles are
    small everywhere, for example in a gear reducer with a slow output. A smaller limit than
    `near` then applies.

    Parameters
    ----------
    sampled
        The singularities on all curves of configurations, and the range of the input.
    near
        Largest angle (rad) of a near miss.
    """
    misses: list[NearMiss] = []
    for kind in (Type.I, Type.II):
        for output in range(len(sampled.report.outputs)):
            for number in range(len(sampled.curves)):
                misses += _near_misses_on_curve(sampled, kind, output, number, near)
    return misses


def _near_misses_on_curve(
    sampled: SampledSingularities, kind: Type, output: int, number: int, near: float
) -> list[NearMiss]:
    """Return where an output comes near one type of singularity on one curve.

    The curve consists of configurations of the mechanism. The distance from the type is an
    angle, which is zero at a singularity. Near misses are the local minima of its sine
    along the curve that are between two limits. Up to the lower limit the configuration
    counts as singular. Above the upper limit it is not near.

    Parameters
    ----------
    sampled
        The singularities on all curves.
    kind
        Type I (the output rests) or II (the input rests).
    output, number
        Index of the output, and index of the curve.
    near
        Largest angle of a near miss (rad).
    """
    # The distance from the type (rad) as a function of the arc length.
    angle = partial(sampled.angle, kind, number, output=output)
    limits = _sine_limits(sampled, kind, number, angle, near)
    # Arc lengths of the minima up to the upper limit, and the sines there.
    positions, sines, end_inputs = local_minima(sampled, number, angle, limits.largest)
    is_not_singular = sines > limits.least
    misses: list[NearMiss] = []
    for s, end_input in zip(
        positions[is_not_singular], end_inputs[is_not_singular], strict=True
    ):
        # The configuration, with one row.
        values = sampled.curves[number].at(s).values
        if kind is Type.II and _has_only_distant_dyads(sampled, values, output, near):
            # The output is placed by pairs of links (dyads). None of these is nearly
            # stretched or folded, so type II is far. The distance is only small because the
            # links have short arcs.
            continue
        (distance,) = sampled.angle(kind, number, s[None], output)
        # The tangent of the distance from type I is the velocity coefficient: the size of
        # the output's rate over that of the input's rate.
        (type_one_angle,) = sampled.angle(Type.I, number, s[None], output)
        # A near miss for each input in the range at which the configuration occurs. A
        # minimum at an end of the range is one at this end only.
        for q, modes in _inputs_and_modes(sampled, number, float(s), values[0]):
            # At other minima `end_input` is NaN, and the comparison False.
            if abs(q - end_input) > EQUAL_EXTREMUM_INPUT_RAD:
                continue
            # A smooth minimum at an end of the range is found twice.
            if any(
                miss.assembly_modes == modes and abs(miss.q - q) < EQUAL_EXTREMUM_INPUT_RAD
                for miss in misses
            ):
                continue
            misses.append(
                NearMiss(
                    type=kind,
                    output=output,
                    curve=number,
                    s=float(s),
                    q=q,
                    assembly_modes=modes,
                    angle=float(distance),
                    velocity_coefficient=np.tan(float(type_one_angle)),
                )
            )
    return misses


@dataclass(frozen=True)
class _SineLimits:
    """Limits between which a local minimum of a sine is a near miss of a singularity.

    The sine is a measure of the distance from one type of singularity, and is zero there.

    Attributes
    ----------
    least
        Minima up to this sine are singularities.
    largest
        Minima above this sine are too far from a singularity to be reported.
    """

    least: float
    largest: float


def _sine_limits(
    sampled: SampledSingularities,
    kind: Type,
    number: int,
    angle: AngleFunction,
    near: float,
) -> _SineLimits:
    """Return the limits between which a minimum of a distance counts as a near miss.

    The distance is an angle that is zero at a singularity. Its sine is compared with the
    limits. Up to the lower limit the configuration counts as singular itself. Above the
    upper limit it is not near a singularity. In some mechanisms the distance is small
    everywhere, so the limits are reduced there:

    - Type I: the tangent of the angle is the velocity coefficient (size of the output's
      rate over that of the input's rate). In a gear reducer the coefficient is small
      throughout. If the coefficient is below 1 on the whole curve, the upper limit is
      multiplied by its largest value.
    - Type II: the sine of the angle says how firmly the locked input holds the output. The
      sine is proportional to the sines of the arcs between the axes of links if all arcs
      are small. Both limits are multiplied by the largest sine of such an arc.

    Parameters
    ----------
    sampled
        The singularities on all curves of configurations.
    kind, number
        The type, and the index of the curve.
    angle
        The distance from the type along the curve.
    near
        Largest angle of a near miss (rad).
    """
    # The distance is at most a right angle. The sine of a larger angle would be too small.
    largest_sine = np.sin(min(near, np.pi / 2.0))
    if kind is Type.I:
        greatest_angle = np.nanmax(angle(sampled.curves[number].s), initial=0.0)
        greatest_coefficient = np.tan(greatest_angle)
        largest_sine *= min(1.0, greatest_coefficient)
        return _SineLimits(least=SINGULAR_TRANSMISSION, largest=largest_sine)
    return _SineLimits(
        least=SINGULAR_TRANSMISSION * sampled.largest_arc_sine,
        largest=largest_sine * sampled.largest_arc_sine,
    )


def least_transmission(
    sampled: SampledSingularities, output: int
) -> tuple[float, float, tuple[int, ...]] | None:
    """Return the transmission angle of an output that is nearest to type II.

    If a dyad (two links in series) places the output, its transmission angle is the acute
    angle between the planes of the arcs of both links. The angle is 0 where the dyad is
    stretched or folded, a singularity of type II: the output can move although the inputs
    are locked. Candidates for the smallest angle are the local minima along all
    configuration curves, the ends of curves and of the range of the input, and the
    crossings of curves.

    Parameters
    ----------
    sampled
        The singularities on all curves, and the range.
    output
        Position of the output.

    Returns
    -------
    The angle (rad), an input (rad) at which it occurs, and the numbers of all assembly
    modes in which the same angle occurs, perhaps at another input. None if no dyad places
    the output, or if no candidate is in the range.
    """
    # Angle, input and assembly modes of each local minimum and each crossing.
    candidates: list[tuple[float, float, tuple[int, ...]]] = []
    for number, curve in enumerate(sampled.curves):

        def angles(s: Floats, curve: ArcCurve = curve) -> Floats:
            """Return the transmission angles (n,) at arc lengths (n,) of the curve."""
            return sampled.transmission_angles(curve.at(s).values)[output]

        positions, _, _ = local_minima(sampled, number, angles)
        crossing_ends = sampled.crossing_ends(number)
        if len(positions) == 0 and not crossing_ends:
            # The angle is constant or NaN. One point of each piece is enough.
            pieces = _find_pieces(sampled, number)
            positions = np.array([0.5 * (piece.start + piece.stop) for piece in pieces])
        minima = list(zip(positions, curve.at(positions).values, strict=True))
        # A curve ends a little before a crossing with other curves. `crossing_ends` gives
        # the arc length of such an end, and the configuration of the crossing itself.
        for s, values in [*minima, *crossing_ends]:
            (angle,) = sampled.transmission_angles(values[None])[output]
            # Type II is at the angle 0, so the distance from it is the angle. An angle that
            # is zero up to rounding is stored as zero.
            is_zero = distance_from_type_two(angle) <= SINGULAR_TRANSMISSION
            rounded_angle = 0.0 if is_zero else float(angle)
            for q, modes in _inputs_and_modes(sampled, number, float(s), values):
                candidates.append((rounded_angle, q, modes))
    if not candidates:
        return None
    # If a group of links other than a dyad places the output, all angles are NaN. It is
    # enough to test the first one.
    first_angle, _, _ = candidates[0]
    if not np.isfinite(first_angle):
        return None
    # The angle with the smallest distance from type II is the smallest angle.
    nearest_angle, q, _ = min(
        candidates, key=lambda candidate: distance_from_type_two(candidate[0])
    )
    modes_at_nearest: set[int] = set()
    for angle, _, modes in candidates:
        if abs(angle - nearest_angle) < EQUAL_TRANSMISSION_ANGLE_RAD:
            modes_at_nearest |= set(modes)
    return nearest_angle, q, tuple(sorted(modes_at_nearest))


def _inputs_and_modes(
    sampled: SampledSingularities, curve: int, s: float, values: Floats
) -> list[tuple[float, tuple[int, ...]]]:
    """Return the inputs in the range at which a configuration occurs, with its modes.

    The configuration can occur at several inputs, which differ by whole periods. An
    assembly mode is a way to assemble the mechanism. If no known mode has the configuration
    at an input, this input is left out.

    Parameters
    ----------
    sampled
        The singularities on all curves of configurations, and the range of the input.
    curve, s
        Index of the curve with the configuration, and its arc length on the curve (rad).
        The curve and the arc length determine the assembly modes.
    values
        (variables,) the variables of the configuration (rad), which include the input.

    Returns
    -------
    Each input (rad), with the numbers of the assembly modes.
    """
    # If the range has whole periods, the mechanism has the same configuration at both
    # ends. An input nearer to the upper end than `margin` is given as the lower end.
    occurrences = sampled.find_occurrences(
        [(curve, s)], values, margin=EQUAL_EXTREMUM_INPUT_RAD
    )
    inputs_and_modes = []
    for q, modes, is_in_range in occurrences:
        has_mode = len(modes) > 0
        if has_mode and is_in_range:
            inputs_and_modes.append((q, tuple(modes)))
    return inputs_and_modes


def local_minima(
    sampled: SampledSingularities,
    number: int,
    angles: AngleFunction,
    limit: float = np.inf,
) -> tuple[Floats, Floats, Floats]:
    """Return the local minima of the sine of an angle along a curve of configurations.

    The angle is a distance from a singularity, or a transmission angle. A minimum inside
    the curve is a point between two points with larger sines. An end of the curve, or of
    the part in the range of the input, is also a minimum if the sine a little inwards is
    not smaller. In a simulation, the parts of the curve that it passes are this range.

    Parameters
    ----------
    sampled
        The singularities on all curves, and the range of the input.
    number
        Index of the curve.
    angles
        The angle along the curve.
    limit
        Minima with a larger sine are left out.

    Returns
    -------
    positions, sines
        (k,) arc lengths (rad) of the minima, and the sines at them.
    end_inputs
        (k,) inputs (rad) of minima at ends of the range, NaN for other minima.
    """
    curve = sampled.curves[number]

    def squared_sine(s: Floats) -> Floats:
        """Return the squared sines (n,), which are smooth and have the same minima."""
        return np.sin(angles(s)) ** 2

    squared_limit = limit**2
    if curve.closed:
        positions, squares = _minima_in_lap(squared_sine, curve, squared_limit)
    else:
        positions, squares = find_local_minima(squared_sine, curve.s, squared_limit)

    # The ends of the curve, and the points at which the input leaves the range.
    ends = _find_ends(sampled, number)
    end_squares = squared_sine(ends.s)
    is_below_limit = end_squares <= squared_limit
    is_minimum = end_squares <= squared_sine(ends.inward_s)
    is_included = is_below_limit & is_minimum
    is_at_range_limit = _is_at_range_limit(sampled, number, ends)
    inputs_of_ends = np.where(is_at_range_limit, ends.q, np.nan)
    end_inputs = np.append(np.full(len(positions), np.nan), inputs_of_ends[is_included])
    positions = np.append(positions, ends.s[is_included])
    squares = np.append(squares, end_squares[is_included])
    return positions, np.sqrt(squares), end_inputs


def _has_only_distant_dyads(
    sampled: SampledSingularities, values: Floats, output: int, near: float
) -> bool:
    """Return whether only dyads place an output, none of them near its dead centre.

    The caller asks this at a configuration where the measured distance of the mechanism
    from type II is small. Short arcs of links can make it small, too. If the function
    returns True, they are the reason, and the caller reports no near miss.

    A dyad is two links in series. At its dead centre it is stretched or folded, which is a
    singularity of type II. The result is False if another group of links helps to place the
    output, or if no group does.

    Parameters
    ----------
    sampled
        The singularities, and the mechanism.
    values
        (1, variables) the configuration (rad).
    output
        Index of the output.
    near
        Largest distance from a dead centre that is near (rad).
    """
    (least_angle,) = sampled.least_dyad_angle(values, output)
    # The angle is NaN, and the comparison False, if not only dyads place the output.
    return bool(least_angle > near)


def _minima_in_lap(
    function: Callable[[Floats], Floats], curve: ArcCurve, limit: float
) -> tuple[Floats, Floats]:
    """Return the local minima of a function in one lap of a closed curve.

    The curve has a grid of arc lengths. A minimum is found only between two
    samples. A minimum at the start of the curve, s = 0, would have no sample before it.
    Therefore two cells of the next lap are added, and the lap goes from the second grid
    point to the same point of the next lap. A minimum at this point is found in both laps,
    up to rounding, and is taken once.

    Parameters
    ----------
    function
        Values (n,) of the function at arc lengths (n,).
    curve
        The closed curve.
    limit
        Minima with a larger value are left out.

    Returns
    -------
    positions, values
        (k,) arc lengths (rad) from 0 to the length of the curve, and the minima.
    """
    next_lap = curve.s[1:3] + curve.length
    positions, values = find_local_minima(function, np.append(curve.s, next_lap), limit)
    lap_start = curve.s[1]
    since_start = positions - lap_start
    is_in_lap = since_start >= -EQUAL_MINIMUM_RAD
    is_in_lap &= since_start < curve.length + EQUAL_MINIMUM_RAD
    positions, values = positions[is_in_lap], values[is_in_lap]
    # A minimum is repeated if its position is that of another one plus a lap.
    lap_differences = np.subtract.outer(positions, positions + curve.length)
    is_repeated = np.any(np.abs(lap_differences) < 2.0 * EQUAL_MINIMUM_RAD, axis=1)
    return np.mod(positions[~is_repeated], curve.length), values[~is_repeated]


@dataclass(frozen=True)
class _PieceEnds(ArrayRows):
    """Some ends of pieces of a curve of configurations.

    A piece is a part of the curve that belongs to one assembly mode (way to assemble the
    mechanism). The caller searches the minima of a function on the curve. Such a minimum
    can lie at an end of a piece.

    Attributes
    ----------
    s
        (k,) arc lengths (rad) of the ends.
    inward_s
        (k,) arc length (rad) of a comparison point for each end. The point is inside the
        piece. Its distance from the end is the part `INWARD_PART` of the length of the
        piece. The end counts as a minimum if the function has the same or a larger value at
        the comparison point.
    q
        (k,) inputs (rad) of the ends. Whole periods are added to bring them into the range
        of the input.
    """

    s: Floats
    inward_s: Floats
    q: Floats


def _find_ends(sampled: SampledSingularities, number: int) -> _PieceEnds:
    """Return the points at which the motion along a curve of configurations ends.

    The caller searches minima of a function along the curve. A minimum can also lie at a
    point where the motion ends.

    A simulation passes parts of the curve. The result then has the ends of these parts,
    except those at crossings with other curves, because the motion can go on there.

    In other motions, the curve is divided into pieces within the range of the input. On a
    piece the input only rises or only falls. The ends of pieces are of four kinds, and the
    result has the first two:

    - The input is at a limit of its range. A range of whole periods has no such ends,
      because configurations repeat.
    - The curve is open and ends. Ends at a crossing with other curves are left out, because
      the motion can go on there.
    - The input turns back, and another piece follows.
    - The input is inside the range, and differs from a limit by whole periods. The curve is
      cut there because it is also used with a shifted input. Another piece follows.

    Parameters
    ----------
    sampled
        The singularities on all curves, and the range of the input.
    number
        Index of the curve.
    """
    ends = _find_piece_ends(sampled, number)
    if sampled.is_simulation:
        return ends.rows(~_is_at_crossing(sampled.curves[number], ends))
    is_at_range_limit = _is_at_range_limit(sampled, number, ends)
    is_at_curve_end = _is_at_curve_end(sampled.curves[number], ends)
    is_included = is_at_range_limit | is_at_curve_end
    return ends.rows(is_included)


def _is_at_range_limit(
    sampled: SampledSingularities, number: int, ends: _PieceEnds
) -> Bools:
    """Return a mask (k,) of ends of pieces that are at the limits of the input range.

    A piece is a part of a curve of configurations, in one assembly mode. The motion ends at
    a limit, so a minimum of a function along the curve can lie there. If the range is a
    whole number of periods, no end is at a limit, because configurations repeat. In a
    simulation, the pieces are the parts that the motion passes, so all ends count as
    limits.

    Parameters
    ----------
    sampled, number
        The range of the input, and the index of the curve.
    ends
        k ends of pieces of the curve.
    """
    if sampled.is_simulation:
        return np.ones(len(ends.s), dtype=bool)
    low, high = sampled.range
    # The count is 0 if the range is not a whole number of periods, for example 1.5.
    if sampled.count_periods_in_range(number) > 0:
        return np.zeros(len(ends.s), dtype=bool)
    is_at_low = np.abs(ends.q - low) < END_TOLERANCE_RAD
    is_at_high = np.abs(ends.q - high) < END_TOLERANCE_RAD
    return is_at_low | is_at_high


def _is_at_curve_end(curve: ArcCurve, ends: _PieceEnds) -> Bools:
    """Return a mask (k,) of ends of pieces (sections of a curve) that end the curve itself.

    The caller searches minima of a function along the curve. A minimum can also be at an
    end of the curve, since the motion cannot go on there. A closed curve has no ends. An
    end at a crossing with other curves is left out, because the motion can go on there.
    Such an end has the status `AT_SINGULARITY`.

    Parameters
    ----------
    curve
        The curve. `curve.ends` are the statuses of its start and its end.
    ends
        k ends of pieces. `ends.s` are their arc lengths.
    """
    if curve.closed:
        return np.zeros(len(ends.s), dtype=bool)
    is_at_start = np.abs(ends.s) < END_TOLERANCE_RAD
    is_at_stop = np.abs(ends.s - curve.length) < END_TOLERANCE_RAD
    return (is_at_start | is_at_stop) & ~_is_at_crossing(curve, ends)


def _is_at_crossing(curve: ArcCurve, ends: _PieceEnds) -> Bools:
    """Return a mask (k,) of ends of pieces that are at crossings with other curves.

    A piece is a part of a curve of configurations, in one assembly mode. Minima of the
    distance from a singularity are also sought at the ends of pieces. The callers leave out
    ends at crossings, because the motion can go on there.

    Parameters
    ----------
    curve
        The curve. `curve.ends` are the statuses of its start and its end, `AT_SINGULARITY`
        at a crossing.
    ends
        k ends of pieces of the curve. `ends.s` are their arc lengths.
    """
    is_at_crossing = np.zeros(len(ends.s), dtype=bool)
    for s, status in zip((0.0, curve.length), curve.ends, strict=True):
        if status is Status.AT_SINGULARITY:
            is_at_crossing |= np.abs(ends.s - s) < END_TOLERANCE_RAD
    return is_at_crossing


def _find_pieces(
    sampled: SampledSingularities, number: int
) -> Sequence[Piece] | Sequence[PassedPart]:
    """Return the pieces of a curve, or the parts of it that a simulation passes."""
    if sampled.is_simulation:
        return sampled.passed_parts(number)
    return sampled.configurations.curves[number].pieces


def _find_piece_ends(sampled: SampledSingularities, number: int) -> _PieceEnds:
    """Return the ends of all pieces of a curve: start and stop of each, in their order.

    A piece is a part of a curve of configurations, in one assembly mode (way to assemble
    the mechanism). In a simulation it is a part that the motion passes. The caller searches
    minima of a function on the curve, such as the squared sine of a transmission angle. An
    end can be a minimum of the piece.

    Parameters
    ----------
    sampled
        All curves, and the range of the input.
    number
        Index of the curve.

    Returns
    -------
    For each end its arc length and input, and the arc length of a comparison point inside
    the piece. With this point the caller decides whether the end is a minimum.
    """
    pieces = _find_pieces(sampled, number)
    # Arc lengths along the curve (rad), one for each piece.
    starts = np.array([piece.start for piece in pieces], dtype=float)
    stops = np.array([piece.stop for piece in pieces], dtype=float)
    # The distance of the comparison point from the end is a small part of the length of the
    # piece. A simulation can pass many laps of a closed curve. One lap then counts as the
    # length.
    lengths = np.minimum(stops - starts, sampled.curves[number].length)
    inward_distances = INWARD_PART * lengths
    # One row (start, stop) for each piece, then all rows one after another.
    end_s = np.column_stack([starts, stops]).ravel()
    inward_s = np.column_stack(
        [starts + inward_distances, stops - inward_distances]
    ).ravel()
    # The input on the curve may be outside of its range. Configurations repeat after a
    # period of the input. The `shift` of a piece, some whole periods, leads into the range.
    shifts = np.repeat([piece.shift for piece in pieces], 2)
    input_variable = sampled.position_analysis.solver.input_variable
    inputs_on_curve = sampled.curves[number].at(end_s).values[:, input_variable]
    return _PieceEnds(s=end_s, inward_s=inward_s, q=inputs_on_curve + shifts)
