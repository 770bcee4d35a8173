"""Angles of passive pairs, counted over full revolutions.

A computed motion has the angles of passive R pairs in (-pi, pi]. Along an assembly mode
these angles are continuous functions of the inputs, and loads such as wound springs depend
on how many revolutions a pair has made. The revolutions are counted from the anchor: the
inputs of the reference pose, or zero. At the anchor every passive angle is in (-pi, pi].

Angles that gear ratios fix are linear functions of the inputs. All others are followed by
verified steps from the anchor, however far apart the samples are.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.group_conditioning import group_reciprocal_condition
from spherekit.positions.input_paths import follow_inputs
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.mode_predictor import ModeCurve, follow_each
from spherekit.positions.motion import Motion
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_GROUP_CONDITION

SAME_MODE_TOLERANCE_RAD = 0.3
"""Angles that differ more from the angles of a followed mode belong to another mode.

The comparison is between verified configurations at equal inputs. Larger: neighbouring
modes are confused. Smaller: interpolated angles are no longer recognised.
"""
DEAD_CENTRE_SLACK_RAD = 1e-4
"""An input that exceeds the end of a followed curve by less is taken to be at the end.

The curve ends at a dead centre, a little before the inputs of the last samples.
"""
CROSSING_DISTANCE_RAD = 1e-4
"""Distance from a crossing of curves at which angles on both sides are compared."""
LARGEST_REDUCED_ANGLE = np.pi + 1e-3
"""Upper end (rad) of the interval into which angles at the anchor are reduced.

The end is a little greater than pi. An angle of half a revolution is therefore positive in
spite of rounding. Rounding errors are large if the anchor is a dead centre.
"""

LastAngles = dict[str, list[float]]
"""The last configuration of each mode, with its revolutions, by the number of the mode.

The next block of samples continues from these configurations. The mapping is empty for
mechanisms with one input: the value of the only input determines all revolutions.
"""


def count_revolutions(angles: Floats) -> Floats:
    """Return how many whole revolutions angles (rad) are outside the interval (-pi, pi]."""
    return np.ceil((angles - LARGEST_REDUCED_ANGLE) / TURN)


class RevolutionSteps(NamedTuple):
    """Whole revolutions that the angles of pairs gain in n steps between configurations.

    The revolutions are to be added to the stored angle at the end of a step, which is in
    (-pi, pi]. For example, an angle that grows from 179 to 181 deg is stored as -179 deg at
    the end, and gains one revolution.

    Attributes
    ----------
    revolutions
        (n, angles) whole revolutions in each step.
    is_connected
        (n,) whether the mechanism can move from one configuration to the other while the
        inputs change along a straight line.
    """

    revolutions: Floats
    is_connected: Bools


class PeriodicInputs(NamedTuple):
    """Inputs written as a number of whole periods, plus a remainder.

    A period is a growth of the input after which the configurations repeat. At the
    remainders, angles of pairs are compared with those of a followed curve. In each whole
    period, the angles gain fixed numbers of revolutions.

    Attributes
    ----------
    period_counts
        (n,) whole numbers of periods.
    remainders
        (n,) inputs less these periods (rad).
    """

    period_counts: Floats
    remainders: Floats


class CurveDistance(NamedTuple):
    """Differences between the angles of n configurations and those of a followed curve.

    Each configuration is compared with the point of the curve at the same input. Angles are
    known up to full revolutions, so each difference is divided into whole revolutions and a
    remainder. A large remainder shows that the configuration is not on the curve.

    Attributes
    ----------
    revolutions
        (n, angles) whole revolutions nearest to the difference: the angle of the curve less
        that of the configuration.
    deviation
        (n,) largest absolute remainder (rad) among the angles of a configuration.
    """

    revolutions: Floats
    deviation: Floats


@dataclass(frozen=True)
class UnwrappedStretch:
    """A stretch of one input over which the angles of an assembly mode were followed.

    An assembly mode is one way to assemble the links. Angles of pairs are known up to full
    revolutions. Along the stretch the angles were followed continuously. Their revolutions
    are counted so that the angles are in (-pi, pi] at the reference input. The reference
    input is the anchor (the input of the reference pose, or zero), or one period above. If
    the stretch reaches neither, the reference input is the one nearest to the anchor.

    Attributes
    ----------
    curve
        The followed configurations.
    input_variable
        Index of the variable of the input.
    angles
        Indices of the variables that are passive angles (angles of pairs without an input).
    period
        Growth of the input (rad) after which the configurations repeat, or infinite.
    winding
        (angles,) revolutions that the angles gain in one period.
    reference_revolutions
        (angles,) whole revolutions by which the angles of the curve exceed (-pi, pi] at the
        reference input. These revolutions are subtracted from all revolutions of the curve.
    """

    curve: ModeCurve
    input_variable: int
    angles: list[int]
    period: float
    winding: Floats
    reference_revolutions: Floats

    def count_revolutions(self, values: Floats) -> Floats:
        """Return the whole revolutions to add to the passive angles of configurations.

        A stretch is a range of the input over which configurations were followed as a
        curve. With the revolutions added, each passive angle (of a pair without an input)
        is a continuous function of the input. The angle is in (-pi, pi] at the reference
        input (see the class). When the input has grown by a period, the configurations
        repeat, except that angles may have gained whole revolutions.

        Parameters
        ----------
        values
            (n, variables) configurations (rad). The input can be several revolutions. The
            passive angles are in (-pi, pi].

        Returns
        -------
        (n, angles) revolutions, with a column for each passive angle. NaN for
        configurations that are not on this stretch.
        """
        _, highest = self._range_with_slack
        # Shift the inputs by whole periods into the range of the curve.
        inputs = self._shift_to_curve(values[:, self.input_variable])
        shifted_inputs = inputs.remainders
        subtracted_periods = inputs.period_counts
        # The whole revolutions by which the angles differ from those of the curve at the
        # same input, and the largest difference that remains.
        to_curve = self._compare_with_curve(shifted_inputs, values)
        # The shifted inputs are never below the lowest input of the curve.
        is_on_stretch = shifted_inputs <= highest
        # A larger deviation shows that the configuration belongs to another mode.
        is_on_stretch &= to_curve.deviation < SAME_MODE_TOLERANCE_RAD
        # The revolutions to add are:
        # 1. Those from the given angles to the angles of the curve.
        # 2. Those that the angles gain in the subtracted periods: `winding` in each.
        # 3. Less those by which the curve is outside (-pi, pi] at the reference input.
        gained_revolutions = subtracted_periods[:, None] * self.winding
        revolutions = to_curve.revolutions + gained_revolutions - self.reference_revolutions
        return np.where(is_on_stretch[:, None], revolutions, np.nan)

    @property
    def _range_with_slack(self) -> tuple[float, float]:
        """Lowest and highest input (rad) that count as inputs of the curve.

        A curve ends a little before a dead centre, where the input turns back. Inputs up to
        `DEAD_CENTRE_SLACK_RAD` beyond an end of the curve therefore count as at the end.
        """
        low, high = self.curve.inputs[[0, -1]]
        return low - DEAD_CENTRE_SLACK_RAD, high + DEAD_CENTRE_SLACK_RAD

    def _shift_to_curve(self, inputs: Floats) -> PeriodicInputs:
        """Shift inputs (n,) by whole periods into the range of the followed curve.

        After a period of the input the configurations repeat. The shifted inputs are in the
        period that begins a little below the first input of the curve, because a curve can
        begin a little above a dead centre.

        Returns
        -------
        The shifted inputs, and the numbers of periods that were taken off.
        """
        first_input = self.curve.inputs[0]
        lowest_input = first_input - DEAD_CENTRE_SLACK_RAD
        above_first = inputs - first_input
        above_lowest = above_first + DEAD_CENTRE_SLACK_RAD
        # With an infinite period, `np.mod` returns positive numbers unchanged, and infinity
        # for negative ones.
        return PeriodicInputs(
            period_counts=np.floor(above_lowest / self.period),
            remainders=lowest_input + np.mod(above_lowest, self.period),
        )

    def _compare_with_curve(self, inputs: Floats, values: Floats) -> CurveDistance:
        """Compare the pair angles of configurations with those of the followed curve.

        The curve is a part of an assembly mode, with continuous angles. The result serves
        to make the angles of the configurations continuous, and to recognise configurations
        of other modes.

        Parameters
        ----------
        inputs
            (n,) inputs (rad) at which the curve is evaluated. Beyond an end of the curve,
            it is evaluated at the end.
        values
            (n, variables) configurations (rad), with angles known up to whole revolutions.

        Returns
        -------
        The whole revolutions from the angles to those of the curve, and the largest
        difference that remains.
        """
        low, high = self.curve.inputs[[0, -1]]
        curve_values, _ = self.curve.interpolate(np.clip(inputs, low, high))
        difference = (curve_values - values)[:, self.angles]
        revolutions = np.round(difference / TURN)
        deviation = max_abs(difference - TURN * revolutions, axis=1)
        return CurveDistance(revolutions, deviation)


class AngleUnwrapping:
    """Counts the full revolutions of the passive pairs (without an input) of a mechanism.

    Solutions give angles in (-pi, pi] only. With the counted revolutions, the angles are
    continuous functions of the inputs. With one input, the curves that were followed are
    stored for later calls.
    """

    def __init__(self, solver: PositionSolver) -> None:
        self.solver = solver
        self._closure = solver.closure
        self._driven = list(solver.driven)
        self._angles = sorted({*solver.angles} - {*solver.driven})
        self._stretches: dict[int, list[UnwrappedStretch]] = {}

    def count(
        self,
        mode: int,
        values: Floats,
        q: Floats,
        requested: Sequence[int],
        last: Sequence[float] | None = None,
    ) -> Floats:
        """Return the revolutions to be added to the variables of configurations.

        With these revolutions, angles are continuous functions of the inputs within an
        assembly mode (one way to assemble the links at given inputs). The anchor is the
        inputs of the reference pose, or zero. There all angles are in (-pi, pi].

        Parameters
        ----------
        mode
            Number of the assembly mode. With one input, a mode is followed once over a
            range of the input. The result is stored under this number for later calls.
        values
            (n, variables) configurations of the mode (rad). With several inputs each is
            followed to the one before.
        q
            (n, inputs) inputs (rad) over full revolutions. They may differ from the inputs
            in `values` by whole periods, after which configurations repeat.
        requested
            Indices of the variables for which revolutions are needed. The revolutions of
            other variables may be zero.
        last
            (variables,) the configuration before `values[0]`, such as the last one of the
            previous block, with angles over full revolutions. Its count is continued. If
            None, revolutions are counted from the anchor. Not used with one input.

        Returns
        -------
        (n, variables) whole revolutions, NaN for angles that cannot be followed.
        """
        revolutions = np.zeros_like(values)
        # Angles that gear ratios fix are linear functions of the inputs, which need not be
        # followed. Their revolutions at the anchor are subtracted.
        linear_variables = set(self._driven)
        anchor_angles = self.solver.gear_train_angles(self.solver.anchor_inputs[None])
        for pair, angle in self.solver.gear_train_angles(q).items():
            (variable,) = self.solver.mechanism.variables_of(pair)
            anchor_revolutions = count_revolutions(anchor_angles[pair])
            # Angle that is continuous and in (-pi, pi] at the anchor.
            counted_angle = angle - TURN * anchor_revolutions
            difference = counted_angle - values[:, variable]
            revolutions[:, variable] = np.round(difference / TURN)
            linear_variables.add(variable)
        # The other passive angles are followed, all together, if revolutions of any of them
        # are requested.
        followed_variables = [v for v in self._angles if v not in linear_variables]
        if not set(followed_variables) & set(requested) or not len(values):
            return revolutions
        shifted = self.solver.shift_inputs(values, q)
        if len(self._driven) == 1:
            passive = self._count_by_stretches(mode, shifted)
        else:
            passive = self._count_along_path(shifted, last)
        # `passive` has a column for each passive angle.
        is_followed = np.isin(self._angles, followed_variables)
        revolutions[:, followed_variables] = passive[:, is_followed]
        return revolutions

    def count_through_crossings(
        self, mode: AssemblyMode, values: Floats, q: Floats, requested: Sequence[int]
    ) -> Floats:
        """Return revolutions that are continuous through the crossings that a mode passes.

        At a crossing, two curves of configurations intersect. The mode consists of pieces:
        from each crossing on, it is the assembly mode of the mechanism that lies on the
        same smooth curve. The revolutions of the angles are first counted on each piece
        separately. The angles are then shifted so that they continue the angles of the
        piece before. At the anchor, if it is in the range, they are in (-pi, pi].

        Parameters
        ----------
        mode
            A mode with `pieces`, which are pairs of the crossing (input in rad) at which a
            piece begins and the assembly mode from there on.
        values
            (n, variables) configurations of the mode (rad).
        q
            (n, 1) inputs (rad) over full revolutions.
        requested
            Indices of the variables whose revolutions are needed.

        Returns
        -------
        (n, variables) whole revolutions. On the piece with the anchor they are the
        revolutions of this piece.
        """
        revolutions = np.zeros_like(values)
        piece_numbers = mode.pieces_at(q[:, 0])
        (anchor,) = self.solver.anchor_inputs
        shift = np.zeros(values.shape[1])
        anchor_shift = shift  # the shift of the piece with the anchor
        for number, (crossing, piece) in enumerate(mode.pieces):
            # `count` stores the followed curve of each piece under its own negative number.
            # Numbers from 0 on are those of modes.
            key = -1 - mode.number * len(mode.pieces) - number
            is_on_piece = piece_numbers == number
            # At a crossing itself it is open which of the curves is followed.
            ends = [start for start, _ in mode.pieces[number : number + 2]]
            for end in ends:
                is_on_piece &= np.abs(q[:, 0] - end) > CROSSING_DISTANCE_RAD
            rows = np.flatnonzero(is_on_piece)
            revolutions[rows] = self.count(key, values[rows], q[rows], requested)
            revolutions[rows] += shift
            if number:
                # The angles just below and just above the crossing must agree. Samples at
                # the crossing are compared with the angles just below.
                previous_piece = mode.pieces[number - 1][1]
                previous_key = key + 1
                below = self._unwrap_at(
                    previous_key,
                    previous_piece,
                    crossing - CROSSING_DISTANCE_RAD,
                    requested,
                )
                above = self._unwrap_at(
                    key, piece, crossing + CROSSING_DISTANCE_RAD, requested
                )
                if not (all_finite(below) and all_finite(above)):
                    continue  # The curve ends at the crossing.
                at_crossing = np.abs(q[:, 0] - crossing) <= CROSSING_DISTANCE_RAD
                difference = below - values[at_crossing]
                revolutions[at_crossing] = shift + np.round(difference / TURN)
                change = np.round((below - above) / TURN)
                shift = shift + change
                if crossing <= anchor:
                    anchor_shift = shift
                revolutions[rows] += change
        revolutions -= anchor_shift
        revolutions[:, self._driven] = 0.0
        return revolutions

    def _unwrap_at(
        self, key: int, mode: AssemblyMode, q: float, requested: Sequence[int]
    ) -> Floats:
        """Return the variables of a mode at one input, counted over full revolutions.

        Parameters
        ----------
        key
            Number under which `count` stores the configurations of this mode, which it
            follows once over a range of the input. Later calls use them again.
        mode
            The assembly mode (way to assemble the links).
        q
            Value of the only input (rad).
        requested
            Indices of the variables whose revolutions are needed. The other variables may
            be returned without their revolutions.

        Returns
        -------
        (variables,) pair variables (rad); NaN if the mode does not exist at the input.
        """
        # All arrays have one row.
        inputs = np.array([[q]])
        values = self.solver.evaluate(mode, inputs).values
        if not all_finite(values):
            return values[0]
        revolutions = self.count(key, values, inputs, requested)
        unwrapped: Floats = values + TURN * revolutions
        return unwrapped[0]

    def _count_by_stretches(self, mode: int, values: Floats) -> Floats:
        """Return the revolutions of passive angles in configurations of one assembly mode.

        Passive angles are those of pairs without an input. Their revolutions make them
        continuous over the input. The mechanism has one input. A stretch is a range of the
        input over which the mode was followed, so that angles are counted continuously.
        Known stretches are tried first. From a configuration that is on none of them, a new
        stretch is followed and stored.

        Parameters
        ----------
        mode
            Number of the mode, under which its stretches are stored.
        values
            (n, variables) configurations (rad). The input counts full revolutions; the
            other angles are in (-pi, pi].

        Returns
        -------
        (n, angles) revolutions to be added to the passive angles. All are NaN for a
        configuration that is on no stretch, not even on the one followed from it.
        """
        (driven,) = self._driven
        # Growth of the input (rad) after which configurations repeat. Infinity means that
        # they never repeat. It also replaces NaN, an unknown period: then wheels do not
        # follow the input by gear ratios.
        (period,) = np.nan_to_num(self.solver.periods, nan=np.inf, posinf=np.inf)
        revolutions = nans((len(values), len(self._angles)))
        # Indices of the configurations that are on no stretch so far.
        remaining = np.arange(len(values))
        stretches = self._stretches.setdefault(mode, [])
        # `_count_on_stretch` fills in the rows of `revolutions` that are on the stretch,
        # and returns the indices of the others.
        for stretch in stretches:
            remaining = _count_on_stretch(stretch, values, remaining, revolutions)
        while len(remaining):
            start = remaining[0]
            stretch = self._follow_stretch(
                values[start], inputs=values[remaining, driven], period=period
            )
            stretches.append(stretch)
            remaining = _count_on_stretch(stretch, values, remaining, revolutions)
            # The start may be missing even from its own stretch. The start is not tried
            # again, so that the loop ends.
            remaining = remaining[remaining != start]
        return revolutions

    def _follow_stretch(
        self, start: Floats, inputs: Floats, period: float
    ) -> UnwrappedStretch:
        """Follow an assembly mode from a configuration, to count revolutions of its angles.

        The anchor is the input of the reference pose, or zero. Angles of pairs are known up
        to full revolutions; at the anchor they are in (-pi, pi] by definition. If
        configurations repeat after a period of the input, the curve is followed over the
        period that begins at the anchor. Without a period, or if the curve does not repeat,
        it is followed over the anchor and `inputs`.

        Parameters
        ----------
        start
            (variables,) a configuration (rad).
        inputs
            (m,) further inputs (rad). Not used if the curve repeats.
        period
            Growth of the input (rad) after which the configurations repeat, or infinite.

        Returns
        -------
        The followed curve, with the revolutions that its angles gain in a period. The
        result also has the revolutions at the reference input: the anchor, if the curve
        reaches the anchor.
        """
        (driven,) = self._driven
        (anchor,) = self.solver.anchor_inputs
        angles = self._angles
        if np.isfinite(period):
            # One period from the anchor on contains all configurations. The start is
            # shifted into it by whole periods.
            start_input = anchor + np.mod(start[driven] - anchor, period)
            (values,) = self.solver.shift_inputs(start[None], np.array([[start_input]]))
            ends = [anchor, anchor + period]
        else:
            values = start
            ends = [anchor, *inputs.tolist()]
        (curve,) = follow_each(
            self._closure, driven, values[None], low=min(ends), high=max(ends)
        )
        low, high = curve.inputs[[0, -1]]
        # Revolutions of the angles in one period; none if the curve ends before.
        growth = (curve.values[-1] - curve.values[0])[angles]
        winding = np.round(growth / TURN)
        covers_period = high - low > period - DEAD_CENTRE_SLACK_RAD
        if not covers_period:
            winding = np.zeros(len(angles))
        elif not max_abs(growth - TURN * winding) < SAME_MODE_TOLERANCE_RAD:
            # After one period the curve is in another mode: it does not repeat.
            return self._follow_stretch(start, inputs, np.inf)
        # The curve may begin above the anchor, but reach the input one period above the
        # anchor. The configuration there is the same as at the anchor, so this input is the
        # reference.
        reference_input = np.clip(anchor, low, high)
        begins_above_anchor = low > anchor + DEAD_CENTRE_SLACK_RAD
        ends_one_period_on = high > anchor + period - DEAD_CENTRE_SLACK_RAD
        if begins_above_anchor and ends_one_period_on:
            reference_input = high
        interpolated_values, _ = curve.interpolate(np.array([reference_input]))
        reference_values = interpolated_values[0]
        return UnwrappedStretch(
            curve=curve,
            input_variable=driven,
            angles=angles,
            period=period,
            winding=winding,
            reference_revolutions=count_revolutions(reference_values)[angles],
        )

    def _count_along_path(self, values: Floats, last: Sequence[float] | None) -> Floats:
        """Return the revolutions of successive configurations, for several inputs.

        The anchor is the inputs of the reference pose, or zero. There all angles are in
        (-pi, pi] by definition. The first of these cases that applies to a configuration
        gives its revolutions:

        1. The mechanism can move to the previous configuration while the inputs change
           along a straight line. The angles then continue those of that configuration.
        2. After whole periods were subtracted from the inputs, such a path leads to the
           anchor. The angles then continue those at the anchor. For each subtracted period
           they gain the revolutions of the period that begins at the anchor. If that period
           cannot be followed, nothing is added.
        3. Otherwise the angles are in (-pi, pi] at the inputs less whole periods.

        Parameters
        ----------
        values
            (n, variables) configurations (rad), inputs over full revolutions.
        last
            (variables,) the configuration that precedes `values[0]`, with angles over full
            revolutions; None if there is none.

        Returns
        -------
        (n, angles) revolutions to be added to the passive angles.
        """
        angles = self._angles
        # The chain begins with the last configuration of the previous block, if any. Each
        # configuration is followed back to the inputs of its predecessor. Where this
        # fails, a new part of the chain begins.
        chain = values if last is None else np.concatenate([[last], values])
        steps = self._follow_to(chain[1:], chain[:-1])
        begins_part = np.concatenate([[last is None], ~steps.is_connected])

        # Follow the first configuration of each part to the anchor, after its inputs were
        # shifted by whole periods to be near the anchor. Where the path ends before the
        # anchor, the angles near the anchor are reduced to (-pi, pi].
        first = chain[begins_part]
        periods = self.solver.periods
        q = first[:, self._driven]
        whole_periods = whole_laps(q - self.solver.anchor_inputs, periods)
        goal = np.full_like(q, self.solver.anchor_inputs)
        near_anchor = self.solver.shift_inputs(first, q - whole_periods)
        followed = follow_inputs(self._closure, self._driven, near_anchor, goal)
        at_anchor = followed.nodes.values
        input_error = max_abs(at_anchor[:, self._driven] - goal, axis=1)
        is_connected = input_error < DEAD_CENTRE_SLACK_RAD
        revolutions = np.zeros((len(chain), len(angles)))
        reference = np.where(is_connected[:, None], at_anchor, near_anchor)
        revolutions[begins_part] = -count_revolutions(reference[:, angles])

        # Add the revolutions that the angles gain in these whole periods of the inputs. For
        # each part and each input with such periods, the gain in one period is measured
        # from the anchor on, unless the anchor is singular.
        jacobian = np.delete(
            self._closure.linearise(at_anchor).jacobian, self._driven, axis=2
        )
        is_connected &= group_reciprocal_condition(jacobian) >= SINGULAR_GROUP_CONDITION
        parts, inputs = np.nonzero(whole_periods * is_connected[:, None])
        anchor_values = at_anchor[parts]
        period = periods[inputs, None]
        one_period_on = goal[parts] + np.eye(len(periods))[inputs] * period
        gain = self._follow_to(
            anchor_values, self.solver.shift_inputs(anchor_values, one_period_on)
        )
        has_gain = gain.is_connected
        laps = whole_periods[parts[has_gain], inputs[has_gain], None] / period[has_gain]
        rows = np.flatnonzero(begins_part)[parts[has_gain]]
        # Several inputs of one part may add to the same row.
        np.add.at(revolutions, rows, gain.revolutions[has_gain] * laps)

        # Within a part, each configuration continues the one before it.
        for row in np.flatnonzero(~begins_part[1:]):
            revolutions[row + 1] = revolutions[row] - steps.revolutions[row]
        return revolutions[len(chain) - len(values) :]

    def _follow_to(self, values: Floats, targets: Floats) -> RevolutionSteps:
        """Follow configurations to the inputs of other ones, and compare the angles.

        The angles of the targets are known up to whole revolutions. The followed angles
        change continuously along the path. So both differ by whole revolutions, which the
        caller uses to make the angles of different configurations continuous.

        Parameters
        ----------
        values, targets
            (n, variables) closed configurations (rad). The inputs of `values` are moved on
            a straight path to those of `targets`.

        Returns
        -------
        RevolutionSteps
            The revolutions by which the followed angles exceed those of the targets.
            `is_connected` is False if a path fails, or leads to another configuration than
            the target.
        """
        # The inputs, which are the variables `_driven`, move to q. The last configurations
        # of the paths are `nodes`.
        followed = follow_inputs(
            self._closure, self._driven, values, q=targets[:, self._driven]
        )
        # `_angles` are the passive variables that are angles.
        difference = (followed.nodes.values - targets)[:, self._angles]
        revolutions = np.round(difference / TURN)
        # At equal inputs, two configurations are equal up to revolutions, or belong to
        # different assembly modes and differ much.
        deviation = max_abs(difference - TURN * revolutions, axis=1)
        is_same_mode = deviation < SAME_MODE_TOLERANCE_RAD
        return RevolutionSteps(revolutions, (followed.status == Status.OK) & is_same_mode)


def _count_on_stretch(
    stretch: UnwrappedStretch, values: Floats, rows: Indices, revolutions: Floats
) -> Indices:
    """Count the revolutions of the pair angles of configurations that are on a stretch.

    The revolutions make the passive angles (of pairs without an input) continuous functions
    of the input. The caller looks for the remaining configurations on other stretches.

    Parameters
    ----------
    stretch
        A range of the input over which configurations were followed continuously.
    values
        (n, variables) configurations (rad), with pair angles in (-pi, pi].
    rows
        (k,) indices of the configurations that are looked for on the stretch.
    revolutions
        (n, angles) whole revolutions to add to the passive angles. The rows of the k
        configurations are changed in place. They become NaN for configurations that are not
        on the stretch.

    Returns
    -------
    The indices of the configurations that are not on the stretch.
    """
    if not len(rows):
        return rows
    revolutions[rows] = stretch.count_revolutions(values[rows])
    # A configuration that is not on the stretch has NaN for all angles.
    is_not_on_stretch = np.isnan(revolutions[rows, 0])
    return rows[is_not_on_stretch]


def continue_angles(
    motion: Motion, names: Iterable[str], unwrapping: AngleUnwrapping, last: LastAngles
) -> Mapping[str, Floats]:
    """Return the variables of pairs over full revolutions at a block of samples.

    Solutions give angles in (-pi, pi], which become continuous functions of the inputs. A
    sample is one value of the inputs.

    Parameters
    ----------
    motion
        The block. Its rows are all samples of the first assembly mode (one way to assemble
        the links), then all samples of the next mode. Passive variables of rows without a
        solution stay NaN.
    names
        Names of pairs with one variable.
    unwrapping
        Counts the revolutions for the mechanism of the motion.
    last
        For each mode, by its number, the last configuration of the block before, over full
        revolutions. The mapping is changed in place to the last configurations of this
        block. With one input it is neither used nor changed.

    Returns
    -------
    mapping from the name of each pair to (n,) values. The value of a driven pair is the
    input of the row.
    """
    mechanism = motion.mechanism
    inputs = motion.assembly.inputs
    names = list(names)
    revolutions = np.zeros_like(motion.values)
    # `mechanism.angles` maps the name of each R pair to the index of its variable.
    requested = [mechanism.angles[name] for name in names if name in mechanism.angles]
    # A motion with a `sense` comes from a simulation, so its angles are continuous.
    if requested and motion.sense is None:
        for index, mode in enumerate(motion.assembly_modes):
            first = index * motion.samples
            key = str(mode.number)
            mode_values = motion.values[first : first + motion.samples]
            rows = np.flatnonzero(all_finite(mode_values, 1)) + first
            if not len(rows):
                continue
            values = motion.values[rows]
            q = motion.inputs[rows]
            if mode.pieces:
                revolutions[rows] = unwrapping.count_through_crossings(
                    mode, values, q, requested
                )
            else:
                revolutions[rows] = unwrapping.count(
                    mode.number, values, q, requested, last.get(key)
                )
            if len(inputs) > 1:
                last_values = motion.values[rows[-1]] + TURN * revolutions[rows[-1]]
                last_values[list(unwrapping.solver.driven)] = motion.inputs[rows[-1]]
                last[key] = last_values.tolist()
    variables = {}
    for name in names:
        pair = mechanism.pair_number[name]
        (variable,) = mechanism.variables_of(pair)
        variables[name] = motion.values[:, variable] + TURN * revolutions[:, variable]
        if pair in inputs:
            variables[name] = motion.inputs[:, inputs.index(pair)]
    return variables


def unwrap_motion(motion: Motion, unwrapping: AngleUnwrapping) -> Motion:
    """Return a motion whose angles run over full revolutions, as loads need them."""
    values = motion.values.copy()
    # Maps the name of each R pair to the column of its angle.
    angles = motion.mechanism.angles
    for pair, angle in continue_angles(motion, angles, unwrapping, {}).items():
        values[:, angles[pair]] = angle
    return replace(motion, values=values)
