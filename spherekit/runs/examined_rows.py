"""Examines rows of a motion: angles, velocity ratios and singularities of the outputs.

The results are added to the records of `mode_overview.py`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.motion import Motion
from spherekit.runs.mode_overview import (
    EQUAL_MINIMA_TOLERANCE,
    ModeOverview,
    OutputOverview,
    first_minimum,
    update_minimum,
)
from spherekit.runs.overview_plan import ExaminedOutput, OverviewPlan
from spherekit.status import Status
from spherekit.velocities.transmission_angle import transmission_angle_of_group

RESTING_RATIO = 1e-9
"""Velocity ratio, speed (rad/s) or step (rad) below which an output counts as resting.

It is also the singular value up to which the sign of the determinant of a Jacobian is not
trusted. Larger: slow outputs seem to rest; smaller: rounding errors seem to be motions.
"""

MAX_RATE_CURVATURE = 0.05
"""Largest nonlinearity of a rate with which a place of rest between samples is computed.

The place is interpolated by a parabola of the rate between the two samples. The
nonlinearity is the error of the angle by the trapezoidal rule, divided by the change of the
rate and by the step of the input or of the time. Larger: places between distant samples are
less accurate; smaller: more of them are stored as an interval.
"""


@dataclass(frozen=True)
class OutputRows(ArrayRows):
    """The motion of an output (observed link) at m successive samples of a path.

    Attributes
    ----------
    places
        (m,) number that identifies each sample: its time (s), the first input (rad) or the
        number of the sample.
    angles
        (m,) angle of the output, rad. It is NaN in rows without a configuration.
    rates
        (m,) rate of the angle, which is zero where the output rests. NaN if it is unknown.
    inputs
        (m, inputs) values of the inputs, rad.
    ratios
        (m, inputs) velocity ratios: rate of the angle per unit rate of each input.
    """

    places: Floats
    angles: Floats
    rates: Floats
    inputs: Floats
    ratios: Floats

    @classmethod
    def from_last_rows(cls, stored_rows: Sequence[Sequence[float | None]]) -> Self:
        """Return the last rows of the previous block, with which the next block continues.

        `OutputOverview.last_rows` stores each of them as a list of place, angle, rate,
        inputs and ratios. None stands for NaN.
        """
        rows = np.array(
            [[np.nan if x is None else x for x in numbers] for numbers in stored_rows]
        )
        places, angles, rates = rows[:, :3].T
        inputs, ratios = np.split(rows[:, 3:], 2, axis=1)
        return cls(places, angles, rates, inputs, ratios)

    def last_rows(self) -> list[list[float | None]]:
        """Return the last rows of a block of samples as lists, for the next block.

        The next block needs them to find out whether the output turns back between the
        blocks. A list has place (time, first input or sample number), angle, rate, inputs
        and velocity ratios. NaN becomes None, because the lists are stored as JSON.

        The result has up to four rows: the last row in which the output moves, the rows
        just before and after it, and the last row of the block. The places in these rows
        bound the step in which the output turns back, or the rest before it turns back. The
        rate of the row before the moving row is replaced by NaN, so that no reversal is
        noted twice.

        The result has only the last row if no row moves, or if the rate is unknown in a row
        after the last moving one. A reversal across such a row is not noted.
        """
        last = len(self.rates) - 1
        numbers = [last]
        moving = self.find_moving()
        rates = self.rates.copy()
        if len(moving) and not np.any(np.isnan(rates[moving[-1] :])):
            last_moving = int(moving[-1])
            rates[:last_moving] = np.nan
            neighbours = (max(last_moving - 1, 0), min(last_moving + 1, last))
            numbers = sorted({last_moving, *neighbours, last})
        columns = [self.places, self.angles, rates, *self.inputs.T, *self.ratios.T]
        rows = np.stack(columns, axis=1)[numbers]
        return [[x if np.isfinite(x) else None for x in row] for row in rows.tolist()]

    def segments(self) -> Iterator[Self]:
        """Yield the longest row ranges where all rows have a configuration, or none has."""
        has_angle = np.isfinite(self.angles)
        starts = 1 + np.flatnonzero(has_angle[1:] != has_angle[:-1])
        for start, end in pairwise([0, *starts, len(has_angle)]):
            yield self.rows(slice(start, end))

    def find_moving(self) -> Indices:
        """Return the rows in which the rate is not zero up to rounding."""
        return np.flatnonzero(np.abs(self.rates) > RESTING_RATIO)

    def find_reversals(self) -> list[tuple[int, int]]:
        """Return pairs of rows between which the output turns back (its rate changes sign).

        Callers look for a turning point of the output between the two rows. Rows in which
        the output rests are passed over, so the two rows need not be neighbours. Changes
        across a row of unknown rate (NaN) are left out. Such a row is a
        singular configuration, in which the sign of the rate may jump.
        """
        moving = self.find_moving()  # without rows of unknown rate
        rates = self.rates[moving]
        changes = np.flatnonzero(rates[1:] * rates[:-1] < 0.0)
        reversals = []
        for before, after in zip(
            moving[changes].tolist(), moving[changes + 1].tolist(), strict=True
        ):
            if not np.any(np.isnan(self.rates[before:after])):
                reversals.append((before, after))
        return reversals


class ExaminedRows:
    """The motion of all outputs at some rows, from which overviews are computed.

    An output is a link that is observed relative to another link. A row is one sample in
    one assembly mode (way to assemble the mechanism).

    Parameters
    ----------
    plan
        The outputs.
    motion
        The configurations of the rows, mode after mode.
    """

    def __init__(self, plan: OverviewPlan, motion: Motion) -> None:
        self.plan = plan
        self.motion = motion
        self.is_ok = motion.status == Status.OK
        self.closes = has_configuration(motion.status)
        # (rows, links, 3, 3) rotations from the axes of each link to the axes of the
        # ground.
        self.rotations = motion.rotations
        # (rows, inputs, links, 3) angular velocities per rate of each input.
        self.link_rates = _link_rates(motion)

    def add_output(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Add the rows of one assembly mode to the overview of an output.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output.
        rows
            The m rows of the mode.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number,
            see `OverviewPlan.places`.
        """
        output = self.plan.outputs[number]
        is_ok = self.is_ok[rows]
        self._add_transmission_angle(overview, number, rows, places)
        if self.plan.transmissions is not None:
            self._add_transmission(overview, number, rows, places)
        # (m, inputs, 3) angular velocity relative to the reference, per rate of each input.
        velocity = (
            self.link_rates[rows, :, output.link]
            - self.link_rates[rows, :, output.reference]
        )
        reference_rotation = self.rotations[rows, output.reference]
        link_rotation = self.rotations[rows, output.link]
        if output.variable is not None:
            # The output is the angle of a pair, with a signed velocity ratio.
            owner = self.motion.mechanism.variable_owners[output.variable]
            axis = output.sense * self.motion.axes[rows, owner]
            ratios = np.einsum("mik,mk->mi", velocity, axis)
            jacobian = ratios[:, :, None]
        elif output.direction is not None:
            # The output is a direction on the link. Its velocity is a vector.
            pointing = link_rotation @ np.array(output.direction)
            jacobian = np.cross(velocity, pointing[:, None])
            ratios = np.linalg.norm(jacobian, axis=2)
        else:
            # The output is the orientation of the link.
            jacobian = velocity
            ratios = np.linalg.norm(jacobian, axis=2)
        ratios[~is_ok] = np.nan
        inputs = self.motion.inputs[rows]
        # The rate along the path of samples decides where the output turns back.
        timing = self.motion.timing
        if self.plan.moves_over_time and timing is not None:
            # At a dead centre a ratio can be infinite and the rate of the input zero, so
            # that their product is NaN.
            with np.errstate(invalid="ignore"):
                # (m, 1 or 3) the rate of the angle, or the velocity of the output.
                rates_over_time = np.sum(jacobian * timing.dq[rows, :, None], axis=1)
            rates_over_time[~is_ok] = np.nan
            if output.variable is None:
                # The velocities due to the inputs are added as vectors.
                speeds = np.linalg.norm(rates_over_time, axis=1, keepdims=True)
            else:
                speeds = rates_over_time
            overview.widen_ratios(speeds)
            velocities = rates_over_time[:, None]
        else:
            overview.widen_ratios(ratios)
            velocities = jacobian
        if self.plan.is_path and output.variable is None:
            is_known = is_ok & np.all(np.isfinite(velocities), axis=(1, 2))
            overview.add_reversals(np.where(is_known[:, None, None], velocities, np.nan))
        self._add_jacobians(overview, output, rows, jacobian, places)

        if output.variable is None:
            relative = reference_rotation.swapaxes(1, 2) @ link_rotation
            self._add_rotations(overview, output, relative, self.closes[rows])
            return
        angles = output.sense * self.motion.values[rows, output.variable]
        if not self.plan.is_path:
            self._add_scattered_angles(overview, angles)
            return
        rates = ratios[:, 0] if inputs.shape[1] == 1 else None
        if self.plan.moves_over_time and timing is not None:
            rates = speeds[:, 0]
        has_rates = rates is not None
        path = OutputRows(
            places=places,
            angles=angles,
            rates=rates if rates is not None else np.full(len(angles), np.nan),
            inputs=inputs,
            ratios=ratios,
        )
        self._add_path(overview, path, has_rates)

    def _add_jacobians(
        self,
        overview: OutputOverview,
        output: ExaminedOutput,
        rows: slice,
        jacobian: Floats,
        places: Floats,
    ) -> None:
        """Note how near the rows of an assembly mode are to singularities of type I.

        At such a singularity the output rests, at least in one direction. The smallest
        singular value of the velocity Jacobian is zero then. If the Jacobian is square, a
        sign change of its determinant along a path shows a singularity between two samples.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        output
            The output.
        rows
            The m rows of the mode.
        jacobian
            (m, inputs, 1 or 3) velocity of the output per rate of each input: its angular
            velocity, the velocity of its direction, or the rate of its angle.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        input_count, component_count = jacobian.shape[1:]
        is_known = self.is_ok[rows] & np.all(np.isfinite(jacobian), axis=(1, 2))
        if not np.any(is_known):
            overview.last_determinant = None
            return
        # Directions move in the plane that is perpendicular to them.
        freedoms = 2 if output.direction is not None else component_count
        rank = min(input_count, freedoms)
        gains = np.full(len(jacobian), np.nan)
        if rank == 1:
            gains[is_known] = np.linalg.norm(jacobian[is_known], axis=(1, 2))
        else:
            values = np.linalg.svd(jacobian[is_known], compute_uv=False)
            gains[is_known] = values[:, rank - 1]
        overview.add_gains(gains, places)
        if not self.plan.is_path or input_count != freedoms:
            return
        determinants = np.full(len(jacobian), np.nan)
        regular = jacobian[is_known]
        if output.direction is not None:
            direction = np.array(output.direction)
            pointing = self.rotations[rows, output.link][is_known] @ direction
            normal = np.cross(regular[:, 0], regular[:, 1])
            determinants[is_known] = np.sum(normal * pointing, axis=1)
        else:
            determinants[is_known] = np.linalg.det(regular)
        senses = np.zeros(len(jacobian))
        timing = self.motion.timing
        if self.plan.moves_over_time and timing is not None:
            # Where an input turns back, the determinant can change its sign without a
            # singularity of type I. A change of `senses` shows such places.
            senses = np.sign(np.prod(timing.dq[rows], axis=1))
        # Signs of determinants that are rounding errors mean nothing.
        determinants[gains <= RESTING_RATIO] = np.nan
        overview.add_determinants(determinants, senses, places)

    def _add_transmission_angle(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Note the least transmission angle of an output in the rows of a mode.

        The transmission angle is the acute angle between the planes of the two links of a
        dyad (two links with three R pairs). Here the dyad is the one that moves the output.
        The least angle at the samples is noted with its place.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output in the plan.
        rows
            The m rows (samples) of the assembly mode.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        dyad = self.plan.joining_dyads[number]
        angles = transmission_angle_of_group(dyad, self.motion.axes[rows])
        # This estimates the extremes between samples by parabolas.
        overview.smooth_transmission_angle.add(angles)
        overview.transmission_angle = update_minimum(
            overview.transmission_angle, angles, places
        )

    def _add_transmission(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Note the range of the transmission measure of an output in the rows of a mode.

        The measure says how well locked inputs keep the output at rest. It is 0 at a
        singularity of type II (dead centre of the input) and 1 at best. The least measure
        at the samples is noted with its place.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output in the plan.
        rows
            The m rows (samples) of the assembly mode.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        measures = self._measure_transmission(number, rows)
        # This estimates the extremes between samples by parabolas.
        overview.smooth_transmission.add(measures)
        overview.transmission = update_minimum(overview.transmission, measures, places)
        # The measure is NaN in rows without a configuration.
        if np.any(np.isfinite(measures)):
            largest = float(np.nanmax(measures))
            if overview.largest_transmission is not None:
                largest = max(largest, overview.largest_transmission)
            overview.largest_transmission = largest

    def _measure_transmission(self, number: int, rows: slice) -> Floats:
        """Return the transmission measure (m,) of an output in m rows.

        The measure is 0 at singularities of type II (the output can move with locked
        inputs), and 1 at best. It is NaN in rows without a configuration.
        `number` is the position of the output in the plan.
        """
        assert self.plan.transmissions is not None
        transmission = self.plan.transmissions[number]
        directions = transmission.output_directions(self.rotations[rows])
        measures = transmission.measure(self.motion.vectors[rows], directions)
        return np.where(self.closes[rows], measures, np.nan)

    def _add_rotations(
        self,
        overview: OutputOverview,
        output: ExaminedOutput,
        relative: Floats,
        closes: Bools,
    ) -> None:
        """Extend the range of the angle by which an output has turned from its first pose.

        If the output is an orientation, this is the angle of the rotation from the first
        pose. If the output is a direction, it is the angle between the first direction and
        the present one.

        Parameters
        ----------
        overview
            The overview of the output in one assembly mode, which is changed in place.
        output
            The output.
        relative
            (m, 3, 3) rotation matrix of each row (sample), from the axes of the link of the
            output to the axes of its reference link.
        closes
            (m,) whether each row has a configuration. The other rows have no angle.
        """
        valid = np.flatnonzero(closes & np.all(np.isfinite(relative), axis=(1, 2)))
        angles = np.full(len(relative), np.nan)
        if not len(valid):
            self._add_turned_angles(overview, angles)
            return
        # `poses` is (k, 3) for directions, or (k, 3, 3) for rotations.
        is_direction = output.direction is not None
        poses = relative[valid]
        if is_direction:
            poses = poses @ np.array(output.direction)
        if overview.first_pose is None:
            overview.first_pose = poses[0].ravel().tolist()
        first_pose = np.reshape(overview.first_pose, poses.shape[1:])
        find_angles = _angles_of_directions if is_direction else _angles_of_rotations
        angles[valid] = find_angles(first_pose, poses)
        self._add_turned_angles(overview, angles)

    def _add_turned_angles(self, overview: OutputOverview, angles: Floats) -> None:
        """Extend the range of the angle by which an output has turned from its first pose.

        The angles (m,) in rad are at least 0, or NaN without a configuration; the first
        pose has the angle 0. The largest angle can be between two samples. `smooth_angle`
        estimates this angle by parabolas.
        """
        overview.widen_angle(angles)
        overview.smooth_angle.add(angles)

    def _add_scattered_angles(self, overview: OutputOverview, angles: Floats) -> None:
        """Extend the range of an angle over the samples of a grid, which have no order.

        Whole turns are added to each angle (rad) so that it is within half a turn of the
        first one.
        """
        finite = angles[np.isfinite(angles)]
        if not len(finite):
            return
        if overview.first_pose is None:
            overview.first_pose = [float(finite[0])]
        (first,) = overview.first_pose
        overview.widen_angle(first + wrap(finite - first))

    def _add_path(
        self, overview: OutputOverview, path: OutputRows, has_rates: bool
    ) -> None:
        """Extend the range of the angle of an output, and note where it turns back.

        The path is divided into segments. Either all rows (samples) of a segment have a
        configuration, or none has, and their angles are NaN. The first segment of a block
        (group of samples) continues from the last rows of the block before. These are
        stored in `overview.last_rows`, which is None if the last row has no configuration.

        Parameters
        ----------
        overview
            The overview of the output, which is changed in place.
        path
            The rows of a block. Their angles may still have jumps of whole turns.
        has_rates
            Whether the rates of the path are known. If not, differences of successive
            angles replace them.
        """
        for segment in path.segments():
            angles = segment.angles
            # The first row represents all rows of the segment.
            has_configurations = len(angles) > 0 and np.isfinite(angles[0])
            if has_configurations:
                self._add_segment(overview, segment, has_rates)
            else:
                # The next segment starts anew, without a row before it.
                overview.last_rows = None
                # `smooth_angle` lays parabolas through successive angles. NaN interrupts
                # them.
                overview.smooth_angle.add(np.full(len(angles), np.nan))

    def _add_segment(
        self, overview: OutputOverview, segment: OutputRows, has_rates: bool
    ) -> None:
        """Add successive rows of a path to the overview of an output.

        All of these rows have a configuration. The range of the angle is extended, and
        places at which the output turns back are noted. A place is the time, the first
        input or the number of a sample. Rows come in blocks (groups of samples), and a path
        can continue from block to block.

        - With known rates, the place and the angle of a turning point are interpolated.
        - Without rates, only the place is found, from the differences of successive angles.
          How far the range extends between rows is estimated by parabolas.

        Parameters
        ----------
        overview
            The overview of the output, which is changed in place.
        segment
            The rows. Their angles may still have jumps of whole turns.
        has_rates
            Whether the rates are known.
        """
        repeated_rows = 0
        if overview.last_rows is not None:
            # The segment continues from the last rows of the block before.
            last_rows = OutputRows.from_last_rows(overview.last_rows)
            segment = OutputRows.concatenate([last_rows, segment])
            repeated_rows = len(overview.last_rows)
        segment = replace(segment, angles=self._remove_jumps(segment, repeated_rows))
        overview.widen_angle(segment.angles)
        if has_rates:
            # The rate changes its sign between the two rows of a reversal.
            for before, after in segment.find_reversals():
                # The range is extended to the angle of the turning point.
                self._add_turning_point(overview, segment, before, after)
        else:
            # The rate of each row becomes the change of the angle since the row before.
            segment = _take_steps_as_rates(segment, repeated_rows)
            # `smooth_angle` makes the parabolas. The rows of the block before were added to
            # `smooth_angle` with that block.
            overview.smooth_angle.add(segment.angles[repeated_rows:])
            for before, after in segment.find_reversals():
                # The output rests for a moment where it turns back.
                overview.add_rest(_place_between_steps(segment, before, after))
        # The next segment continues from these rows.
        overview.last_rows = segment.last_rows()

    def _remove_jumps(self, segment: OutputRows, repeated_rows: int) -> Floats:
        """Return the output angles (m,) of successive rows without jumps of whole turns.

        Each step of the angle is predicted from the velocity ratios (output rate per input
        rate) by the trapezoidal rule. Whole turns are added so that the step is as near to
        the prediction as possible.

        Parameters
        ----------
        segment
            The m rows (samples).
        repeated_rows
            Number of rows at the beginning that are repeated from the block before. Their
            jumps were removed with that block.
        """
        mean_ratios = 0.5 * (segment.ratios[1:] + segment.ratios[:-1])
        predicted_steps = np.sum(mean_ratios * np.diff(segment.inputs, axis=0), axis=1)
        # Without a usable prediction, a step of less than half a turn is assumed. In
        # simulations the ratios are never used, as they are infinite at a dead centre.
        is_uncertain = ~np.isfinite(predicted_steps)
        if self.plan.moves_over_time:
            is_uncertain[:] = True
        predicted_steps[is_uncertain] = 0.0
        turns = np.round((predicted_steps - np.diff(segment.angles)) / TURN)
        # The steps between repeated rows stay.
        turns[: max(repeated_rows - 1, 0)] = 0.0
        angles = segment.angles.copy()
        angles[1:] += TURN * np.cumsum(turns)
        return angles

    def _add_turning_point(
        self, overview: OutputOverview, segment: OutputRows, before: int, after: int
    ) -> None:
        """Note that an output turns back between two rows, and extend its range to there.

        There are three cases:

        - The output rests in rows between both rows. It turns back in these.
        - The rate is nearly linear between both rows. The place and the angle of the
          turning point are interpolated, and the error of this angle is estimated.
        - The rate is not linear. Only the places of the two rows are noted. A bound tells
          how far the angle can go beyond the angles of both rows.

        The estimate or the bound is noted in the overview. The summary of the run states
        the largest one as the amount by which the true range may exceed the range found.

        Parameters
        ----------
        overview
            The overview of the output, which is changed in place.
        segment
            Rows (samples) of a path, with angles without jumps.
        before, after
            Indices of the two rows. The rates in these rows have opposite signs.
        """
        if after - before > 1:
            # The range already has the angles of the rows in which the output rests.
            first_rest, last_rest = segment.places[before + 1], segment.places[after - 1]
            overview.add_rest(float(0.5 * (first_rest + last_rest)))
            return
        rate_before = segment.rates[before]
        rate_after = segment.rates[after]
        # The rates are derivatives of the angle with respect to time, or to the single
        # input.
        if self.plan.moves_over_time:
            path = segment.places  # times
        else:
            path = segment.inputs[:, 0]
        step = path[after] - path[before]
        # For a linear rate, the trapezoidal rule yields the step of the angle exactly.
        linear_angle_step = 0.5 * (rate_before + rate_after) * step
        angle_step = segment.angles[after] - segment.angles[before]
        error = abs(linear_angle_step - angle_step)
        # The change of the rate times the step, an angle. The rate counts as linear if the
        # error is a small share of this angle.
        variation = abs((rate_after - rate_before) * step)
        is_linear = error <= MAX_RATE_CURVATURE * variation
        if not is_linear:
            # Let the rate r only rise or only fall over the step h, with a zero at x. Then
            # the angle goes beyond its value in the row before by at most |r_before| x, and
            # beyond its value in the row after by at most |r_after| (h - x). One of the two
            # bounds is at most a quarter of `variation`.
            overview.add_turning_error(0.25 * variation)
            first_place = float(segment.places[before])
            overview.add_uncertain_rest(first_place, float(segment.places[after]))
            return
        overview.add_turning_error(error)
        share, extreme_step = _interpolate_rest(rate_before, rate_after, angle_step / step)
        distance = segment.places[after] - segment.places[before]
        overview.add_rest(float(segment.places[before] + share * distance))
        extreme = segment.angles[before] + extreme_step * step
        overview.widen_angle(np.array([extreme]))


def _interpolate_rest(
    rate_before: float, rate_after: float, mean_rate: float
) -> tuple[float, float]:
    """Return where between two rows an output turns back, if its rate is nearly linear.

    The rate is interpolated by the parabola r(x) = a + (b - a) x + c x (1 - x), where x is
    the share of the step between both rows. Its mean over the step is (a + b) / 2 + c / 6,
    from which c follows.

    Parameters
    ----------
    rate_before, rate_after
        The rates a and b in both rows, which have opposite signs.
    mean_rate
        The change of the angle between both rows, divided by the step.

    Returns
    -------
    share
        The share x of the step at which the rate is zero.
    extreme_step
        The change of the angle from the row before to this place, divided by the step.
    """
    curvature = 6.0 * (mean_rate - 0.5 * (rate_before + rate_after))
    change = rate_after - rate_before
    # The parabola is a + slope x - c x^2. The curvature c is small beside the change b - a,
    # so the zero between the rows is the root of smaller magnitude. This form of the
    # solution has no cancellation.
    slope = change + curvature
    root = np.sqrt(max(slope**2 + 4.0 * curvature * rate_before, 0.0))
    share = -2.0 * rate_before / (slope + np.copysign(root, slope))
    extreme_step = share * (rate_before + share * (0.5 * slope - share * curvature / 3.0))
    return float(share), float(extreme_step)


def _take_steps_as_rates(segment: OutputRows, repeated_rows: int) -> OutputRows:
    """Return successive rows with steps of the angle in place of its rates.

    A step is the change of the angle from the previous row. Its sign shows in which
    direction the output moves. The first `repeated_rows` rows are repeated from the block
    before. They keep their rates, which already are steps. The first row of the segment
    has no previous row and keeps its rate, too.
    """
    kept_rows = max(repeated_rows, 1)
    steps = np.diff(segment.angles)[kept_rows - 1 :]
    return replace(segment, rates=np.append(segment.rates[:kept_rows], steps))


def _place_between_steps(path: OutputRows, before: int, after: int) -> float:
    """Return the place at which the angle of an output turns back, if rates are unknown.

    A place is the time, the first input or the number of a sample. A step is the change of
    the angle from one row to the next. The angle turns back between two steps of opposite
    sign.

    - If the output rests between the two steps, the place is the middle of this rest.
    - Otherwise the second step follows the first one. The mean rate in a step is taken as
      the rate in its middle. Between the two middles the rate is interpolated linearly.
      The angle turns back where this rate is zero.

    Parameters
    ----------
    path
        Rows of the path. `rates` has steps: the step that ends in each row.
    before, after
        Indices of the rows in which the two steps end. In the rows between them the output
        rests.
    """
    places = path.places
    if after - before > 1:
        # The step to the row `after` starts in the row before it, so the rest ends there.
        return float(0.5 * (places[before] + places[after - 1]))
    rows = np.array([before, after])
    steps = path.rates[rows]
    lengths = places[rows] - places[rows - 1]
    middle_before, middle_after = 0.5 * (places[rows] + places[rows - 1])
    rate_before, rate_after = steps / lengths
    share = rate_before / (rate_before - rate_after)
    return float(middle_before + share * (middle_after - middle_before))


def _angles_of_directions(first: Floats, directions: Floats) -> Floats:
    """Return the angles (k,) in rad between one unit vector (3,) and k others (k, 3)."""
    sine = np.linalg.norm(np.cross(directions, first), axis=1)
    return np.arctan2(sine, directions @ first)


def _angles_of_rotations(first: Floats, rotations: Floats) -> Floats:
    """Return the angles (k,) in rad by which rotations (k, 3, 3) differ from the first."""
    difference = first.T @ rotations
    # For the angle a and the axis u of a rotation matrix R, the matrix R - R^T has the
    # elements of the vector 2 sin(a) u, and the trace of R is 1 + 2 cos(a).
    skew = difference - difference.swapaxes(1, 2)
    vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    twice_sine = np.linalg.norm(vector, axis=1)
    twice_cosine = np.trace(difference, axis1=1, axis2=2) - 1.0
    return np.arctan2(twice_sine, twice_cosine)


def _link_rates(motion: Motion) -> Floats:
    """Return the angular velocity of each link per unit rate of each input.

    The array is (n, inputs, links, 3): n rows (samples in all assembly modes), and vectors
    relative to the ground in ground axes. The array is NaN where the closure equations
    (conditions that loops stay closed) do not determine the velocities.
    """
    linearisation = motion.linearisation
    # (n, equations, variables) derivatives of the closure equations with respect to the
    # pair variables.
    jacobian = linearisation.jacobian
    # The passive variables are the pair variables that are not inputs.
    passive = list(motion.passive_variables)
    rates = []
    for pair in motion.assembly.inputs:
        # One input moves at unit rate, and the other inputs are locked. A pair that is an
        # input has a single variable.
        driven = motion.mechanism.variables_of(pair)[0]
        variable_rates = np.zeros((len(motion), motion.values.shape[1]))
        variable_rates[:, driven] = 1.0
        if passive:
            # The passive variables change so that the loops stay closed. The inverse
            # belongs to the columns of the passive variables in the Jacobian.
            closing = -motion.closure_inverse @ jacobian[:, :, driven, None]
            variable_rates[:, passive] = closing[:, :, 0]
        # (n, variables, 3) the angular velocity between the two links of a pair, per unit
        # rate of each variable. For a revolute pair it is the axis.
        velocity_vectors = motion.vectors
        rates.append(linearisation.tree.body_rates(velocity_vectors, variable_rates))
    return np.stack(rates, axis=1)


def note_transmission(
    overview: ModeOverview,
    plan: OverviewPlan,
    motion: Motion,
    rows: slice,
    places: Floats,
) -> None:
    """Note the least transmission angle of all dyads in the rows of an assembly mode.

    A dyad consists of two links with three R pairs. The transmission angle of a dyad is the
    acute angle between the planes of its two arcs. The angle is 0 at a singularity of type
    II.

    Parameters
    ----------
    overview
        The overview of the mode, which is changed in place.
    plan
        What is examined, with the dyads of the mechanism.
    motion, rows
        The configurations in all assembly modes, and the m rows (samples) of this mode.
    places
        (m,) place of each sample: its time (s), the first input (rad) or its number.
    """
    for dyad in plan.dyads:
        angles = transmission_angle_of_group(dyad, motion.axes[rows])
        if not np.any(np.isfinite(angles)):
            continue
        row = first_minimum(angles)
        least = overview.transmission
        # Minima that differ only by rounding count as equal; the first one stays.
        if least is None or angles[row] < least[0] - EQUAL_MINIMA_TOLERANCE:
            pair = plan.middle_pair(dyad)
            overview.transmission = [float(angles[row]), pair, float(places[row])]
