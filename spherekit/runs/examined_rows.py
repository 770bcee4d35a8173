"""Examines rows of a motion: angles, velocity ratios and singularities of the outputs.

The results are added to the records of `mode_overview.py`.
"""

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.numerics.angles import wrap
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
"""Velocity ratio below which an output counts as resting.

It is also the singular value up to which the sign of the determinant of a Jacobian is not
trusted. Larger: slow outputs seem to rest; smaller: rounding errors seem to be motions.
"""

MAX_RATE_CURVATURE = 0.05
"""Largest nonlinearity of a rate with which a place of rest between samples is computed.

The place is interpolated as if the rate were linear between the two samples. The
nonlinearity is the error of the angle by the trapezoidal rule, divided by the change of the
rate and by the step of the input or of the time. Larger: places between distant samples are
less accurate; smaller: more of them are stored as an interval.
"""


class ExaminedRows:
    """The motion of all outputs at some rows.

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
        # (rows, links, 3, 3) rotations from the axes of each link to those of the ground.
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
            owner = self.motion.mechanism.variable_owners[output.variable]
            axis = output.sense * self.motion.axes[rows, owner]
            ratios = np.einsum("mik,mk->mi", velocity, axis)
            jacobian = ratios[:, :, None]
        elif output.direction is not None:
            pointing = link_rotation @ np.array(output.direction)
            jacobian = np.cross(velocity, pointing[:, None])
            ratios = np.linalg.norm(jacobian, axis=2)
        else:
            jacobian = velocity
            ratios = np.linalg.norm(jacobian, axis=2)
        ratios[~is_ok] = np.nan
        inputs = self.motion.inputs[rows]
        # The rate along the path of samples decides where the output turns back.
        timing = self.motion.timing
        if self.plan.moves_over_time and timing is not None:
            # At a dead centre a ratio is infinite and the rate of the input is zero.
            with np.errstate(invalid="ignore"):
                speeds = np.sum(ratios * timing.dq[rows], axis=1, keepdims=True)
            overview.widen_ratios(speeds)
        else:
            overview.widen_ratios(ratios)
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
        self._add_path(overview, angles, ratios, rates, inputs, places)

    def _add_jacobians(
        self,
        overview: OutputOverview,
        output: ExaminedOutput,
        rows: slice,
        jacobian: Floats,
        places: Floats,
    ) -> None:
        """Note how near the rows of a mode are to singularities of type I.

        The smallest singular value of the velocity Jacobian is zero at such a singularity.
        If the Jacobian is square, a sign change of its determinant along a path shows that
        there is one between two samples.

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
        # Over time, the ranges are those of the speed, to which all inputs contribute.
        if self.plan.is_path and output.variable is None and not self.plan.moves_over_time:
            overview.add_reversals(np.where(is_known[:, None, None], jacobian, np.nan))
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
            # At a dead centre the ratio is infinite and changes its sign, as does the rate
            # of the input. This is no singularity of type I.
            senses = np.sign(np.prod(timing.dq[rows], axis=1))
        # Signs of determinants that are rounding errors mean nothing.
        determinants[gains <= RESTING_RATIO] = np.nan
        overview.add_determinants(determinants, senses, places)

    def _add_transmission_angle(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Note the least transmission angle of an output in the rows of a mode.

        The transmission angle belongs to the dyad (two links with three R pairs) that moves
        the output. The least angle at the samples is noted with its place. The least angle
        between samples, which can be smaller, is estimated by parabolas.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output in the plan.
        rows
            The m rows of the mode.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        dyad = self.plan.joining_dyads[number]
        angles = transmission_angle_of_group(dyad, self.motion.axes[rows])
        overview.smooth_transmission_angle.add(angles)
        overview.transmission_angle = update_minimum(
            overview.transmission_angle, angles, places
        )

    def _add_transmission(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Note the range of the transmission measure of an output in the rows of a mode.

        The measure says how well locked inputs hold the output: 0 at a singularity of type
        II, 1 at best. The least measure at the samples is noted with its place. The
        extremes between samples are estimated by parabolas.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output in the plan.
        rows
            The m rows of the mode.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        measures = self._measure_transmission(number, rows)
        overview.smooth_transmission.add(measures)
        overview.transmission = update_minimum(overview.transmission, measures, places)
        if np.any(np.isfinite(measures)):
            largest = float(np.nanmax(measures))
            if overview.largest_transmission is not None:
                largest = max(largest, overview.largest_transmission)
            overview.largest_transmission = largest

    def _measure_transmission(self, number: int, rows: slice) -> Floats:
        """Return the transmission measure (m,) of an output in m rows.

        It is NaN in rows without a configuration. `number` is the position of the output in
        the plan.
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
        """Extend the range of the angle between the first pose and the pose in each row.

        If the output is an orientation, the angle is that of the rotation from the first
        pose to the pose in the row. If the output is a direction, it is the angle between
        the first direction and the direction in the row.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        output
            The output.
        relative
            (m, 3, 3) rotations from the axes of the link to those of the reference.
        closes
            (m,) whether each row has a configuration. The other rows are left out.
        """
        valid = np.flatnonzero(closes & np.all(np.isfinite(relative), axis=(1, 2)))
        if not len(valid):
            return
        relative = relative[valid]
        if output.direction is not None:
            pointing = relative @ np.array(output.direction)
            if overview.first_pose is None:
                overview.first_pose = pointing[0].tolist()
            first = np.array(overview.first_pose)
            sine = np.linalg.norm(np.cross(pointing, first), axis=1)
            self._add_turned_angles(overview, np.arctan2(sine, pointing @ first))
            return
        if overview.first_pose is None:
            overview.first_pose = relative[0].ravel().tolist()
        first = np.reshape(overview.first_pose, (3, 3))
        difference = first.T @ relative
        # The skew part has the length 2 sin(angle), the trace is 1 + 2 cos(angle).
        skew = difference - difference.swapaxes(1, 2)
        sine = np.linalg.norm(skew[:, [2, 0, 1], [1, 2, 0]], axis=1)
        cosine = np.trace(difference, axis1=1, axis2=2) - 1.0
        self._add_turned_angles(overview, np.arctan2(sine, cosine))

    def _add_turned_angles(self, overview: OutputOverview, angles: Floats) -> None:
        """Extend the range of the angle by which an output has turned from its first pose.

        The angles (m,) in rad are at least 0; the first pose has the angle 0. The largest
        angle can be between two samples. By how much it exceeds the angles at samples is
        therefore estimated by parabolas (`smooth_angle`).
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
        self,
        overview: OutputOverview,
        angles: Floats,
        ratios: Floats,
        rates: Floats | None,
        inputs: Floats,
        places: Floats,
    ) -> None:
        """Extend the range of the angle of an output, and note where the output rests.

        An output comes to rest where its angle turns back. A sample is identified by a
        number, its place: the time (s), the first input (rad) or the number of the sample.

        The rows are those of a block of samples. If some rows have no configuration, they
        divide the others into segments. Within a segment, whole turns are added to the
        angle so that it has no jumps. The first segment of a block continues the last
        segment of the block before, through `overview.last_row`.

        Parameters
        ----------
        overview
            The overview, which is changed in place.
        angles
            (m,) angles of the output (rad), with jumps of whole turns.
        ratios
            (m, inputs) velocity ratios.
        rates
            (m,) rate of the angle, which is zero where the output rests. None for a path of
            several inputs, where differences of successive angles are used instead.
        inputs, places
            (m, inputs) values of the inputs (rad), and (m,) places of the samples.
        """
        if rates is None:
            rates_or_nan = np.full(len(angles), np.nan)
        else:
            rates_or_nan = rates
        rows = np.column_stack([places, angles, rates_or_nan, inputs, ratios])
        # Segments of rows with a configuration and segments of rows without alternate.
        is_known = np.isfinite(angles)
        ends = np.flatnonzero(is_known[1:] != is_known[:-1]) + 1
        for segment in np.split(np.arange(len(angles)), ends):
            if len(segment) and is_known[segment[0]]:
                self._add_segment(overview, rows[segment], inputs.shape[1], rates is None)
            else:
                # The next segment continues no row before it.
                overview.last_row = None
                overview.smooth_angle.add(np.full(len(segment), np.nan))

    def _add_segment(
        self,
        overview: OutputOverview,
        rows: Floats,
        input_count: int,
        takes_rate_of_steps: bool,
    ) -> None:
        """Add neighbouring rows of a path, all of which have a configuration.

        Parameters
        ----------
        overview
            The overview, which is changed in place.
        rows
            (m, 3 + 2 inputs) place, angle (rad) and rate of each row, its inputs (rad) and
            its velocity ratios.
        input_count
            Number of inputs.
        takes_rate_of_steps
            Whether the rates are replaced by differences of successive angles.
        """
        is_first_segment = overview.last_row is None
        if overview.last_row is not None:
            # NaN cannot be stored in the journal, so None stands for it.
            last_row = [np.nan if x is None else x for x in overview.last_row]
            rows = np.vstack([last_row, rows])
        # These are views: a change of the angles or rates is one of the rows.
        places, angles, rates = rows[:, :3].T
        inputs = rows[:, 3 : 3 + input_count]
        ratios = rows[:, 3 + input_count :]
        expected_steps = np.sum(
            0.5 * (ratios[1:] + ratios[:-1]) * np.diff(inputs, axis=0), axis=1
        )
        is_uncertain = ~np.isfinite(expected_steps)
        if self.plan.moves_over_time:
            is_uncertain[:] = True  # ratios are infinite at a dead centre of the input
        expected_steps[is_uncertain] = 0.0
        # Choose the whole turns so that each step is near the expected one.
        turns = np.round((expected_steps - np.diff(angles)) / TURN)
        angles[1:] += TURN * np.cumsum(turns)
        if takes_rate_of_steps:
            rates[1:] = np.diff(angles)
        overview.widen_angle(angles)
        if takes_rate_of_steps:
            # Turning points of the angle are not computed with such rates.
            overview.smooth_angle.add(angles if is_first_segment else angles[1:])

        # The rate is nearly linear between neighbouring rows. Rows in which it is zero up
        # to rounding are passed over.
        moving = np.flatnonzero(np.abs(rates) > RESTING_RATIO)
        reversals = np.flatnonzero(rates[moving][1:] * rates[moving][:-1] < 0.0)
        for before, after in zip(
            moving[reversals].tolist(), moving[reversals + 1].tolist(), strict=True
        ):
            if np.isnan(rates[before:after]).any():
                # A singular configuration is between both rows. The rate can jump there
                # from one sign to the other without being zero.
                continue
            share = rates[before] / (rates[before] - rates[after])
            distance = places[after] - places[before]
            place = float(places[before] + share * distance)
            if takes_rate_of_steps:
                overview.add_rest(place)
                continue
            # The step of the angle shows whether the rate is linear: the trapezoidal rule
            # then gives this step.
            path = places if self.plan.moves_over_time else inputs[:, 0]
            step = path[after] - path[before]
            error = 0.5 * (rates[before] + rates[after]) * step
            error -= angles[after] - angles[before]
            variation = abs((rates[after] - rates[before]) * step)
            is_linear = abs(error) <= MAX_RATE_CURVATURE * variation
            # The rates at both rows have opposite signs. If the rate was linear, the angle
            # between them would exceed that of a row by at most an eighth of the variation.
            # Twice as much is allowed for a rate that is not.
            turning_error = float(abs(error) if is_linear else 0.25 * variation)
            overview.turning_error_rad = max(overview.turning_error_rad, turning_error)
            if not is_linear:
                overview.add_uncertain_rest(float(places[before]), float(places[after]))
                continue
            overview.add_rest(place)
            extreme = angles[before] + 0.5 * rates[before] * share * step
            overview.widen_angle(np.array([extreme]))
        last_row = rows[-1]
        if not abs(last_row[2]) > RESTING_RATIO and len(moving):
            # The next block needs the last rate that is not zero, and its place.
            last_row = last_row.copy()
            last_row[[0, 2]] = rows[moving[-1], [0, 2]]
        overview.last_row = [float(x) if np.isfinite(x) else None for x in last_row]


def _link_rates(motion: Motion) -> Floats:
    """Return the angular velocities (n, inputs, links, 3) of links per rate of each input.

    They are relative to the ground and in ground axes, and NaN where the closure equations
    do not determine them.
    """
    linearisation = motion.linearisation
    jacobian = linearisation.jacobian
    passive = list(motion.passive_variables)
    rates = []
    for pair in motion.assembly.inputs:
        driven = motion.mechanism.variables_of(pair)[0]
        variable_rates = np.zeros((len(motion), motion.values.shape[1]))
        variable_rates[:, driven] = 1.0
        if passive:
            closing = -motion.closure_inverse @ jacobian[:, :, driven, None]
            variable_rates[:, passive] = closing[:, :, 0]
        rates.append(linearisation.tree.body_rates(motion.vectors, variable_rates))
    return np.stack(rates, axis=1)


def note_transmission(
    overview: ModeOverview,
    plan: OverviewPlan,
    motion: Motion,
    rows: slice,
    places: Floats,
) -> None:
    """Note the least transmission angle of all dyads in the rows of an assembly mode.

    A dyad consists of two links with three R pairs. Its transmission angle is the acute
    angle between the planes of its two arcs. It is 0 at a singularity of type II.

    Parameters
    ----------
    overview
        The overview of the mode, which is changed in place.
    plan
        What is examined, with the dyads of the mechanism.
    motion, rows
        The configurations of all modes, and the m rows of this mode.
    places
        (m,) place of each sample: its time (s), the first input (rad) or its number.
    """
    for dyad in plan.dyads:
        angles = transmission_angle_of_group(dyad, motion.axes[rows])
        if not np.any(np.isfinite(angles)):
            continue
        row = first_minimum(angles)
        least = overview.transmission
        if least is None or angles[row] < least[0] - EQUAL_MINIMA_TOLERANCE:
            pair = plan.middle_pair(dyad)
            overview.transmission = [float(angles[row]), pair, float(places[row])]
