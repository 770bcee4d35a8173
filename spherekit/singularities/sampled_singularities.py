"""Singularities of a mechanism with one input, and how near the rows of a motion come.

Each row is located on its configuration curve. Along the curve all quantities are regular,
also at dead centres, where rates per unit rate of the input are infinite.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Integers
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.pole_plan import pole_of
from spherekit.planning.submechanism import placing_groups
from spherekit.positions.configuration_space import Configurations, Piece
from spherekit.positions.input_revolutions import (
    in_range,
    into_range,
    turns_in_range,
    whole_laps,
    whole_periods,
)
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.input_output_relation import Form, Type
from spherekit.singularities.passed_parts import (
    PassedPart,
    SimulatedRows,
    find_passed_parts,
)
from spherekit.singularities.placing_part import find_placing_part
from spherekit.singularities.single_freedom import SingleFreedomSingularities
from spherekit.singularities.singular_point import SingularPoint
from spherekit.status import Status
from spherekit.tolerances import NEAR_CROSSING_RAD
from spherekit.velocities.transmission_angle import (
    MAX_TYPE_II_DISTANCE_RAD,
    distance_from_type_two,
    transmission_angle_of_group,
)
from spherekit.velocities.transmission_measure import (
    MIN_OUTPUT_MOTION,
    Transmission,
    input_authority,
)

AT_CROSSING_RAD = 1e-8
"""A configuration whose distance to a crossing is smaller is taken for the crossing."""
END_TOLERANCE_RAD = 1e-9
"""An input or arc length that differs from the end of a range or curve by less is at it."""
PIECE_END_TOLERANCE_RAD = 1e-6
"""A piece (section) of a curve includes points beyond its ends by less than this length."""


class Occurrence(NamedTuple):
    """An input at which a configuration (position of all links) occurs.

    The mechanism repeats its configurations when the input grows by a period. So the same
    configuration can occur at several inputs.

    Attributes
    ----------
    q
        The input (rad).
    modes
        Numbers of the assembly modes (ways to assemble the mechanism) that have the
        configuration at this input.
    is_inside
        Whether the input is in its range. In a simulation, whether the simulated motion
        passes the configuration at this input.
    """

    q: float
    modes: list[int]
    is_inside: bool


@dataclass(frozen=True)
class _CrossingDistances:
    """Distances of n configurations from the crossings of curves of configurations.

    A curve consists of the configurations that a mechanism with one input can reach. Curves
    are followed only up to a little before a crossing. So a configuration near a crossing
    is on no curve, and these distances give the reason. The distance of two configurations
    is the largest difference of their variables (rad). All distances are infinite if there
    is no crossing.

    Attributes
    ----------
    any_crossing
        (n,) distances from the nearest crossing. They tell whether a configuration is in
        the gap between a curve and a crossing. The configuration of a crossing may be
        unknown. The distance is then that from the last computed point of a curve that ends
        there.
    located_crossing
        (n,) distances from the nearest crossing whose configuration was computed. They tell
        whether a configuration is itself a crossing.
    """

    any_crossing: Floats
    located_crossing: Floats


class SampledSingularities:
    """The singularities on all configuration curves, and measures at given rows.

    A configuration curve consists of all configurations that a mechanism with one input
    reaches from one of them. A row is one sample of a motion. At singularities of type I
    the output rests while the input moves, at those of type II the input rests.

    Parameters
    ----------
    position_analysis
        Position analysis of a mechanism with one degree of freedom.
    outputs
        The outputs as pairs (o, s) of link indices: the motion of link o relative to
        link s.
    values, assembly_mode
        Configurations (n, variables) of the rows in rad, NaN for none, and the assembly
        mode (n,) of each.
    passed
        (n,) inputs (rad) of rows that are a simulation. Only the parts of curves between
        the rows are then inside, and the range has the inputs on these parts.

    Attributes
    ----------
    whole, position_analysis
        The given position analysis, and the position analysis of the part on which the
        outputs depend. Links of the report and variables of the curves are numbered as
        in the part.
    configurations, report
        All curves, and the singularities on them.
    curves
        The curves of `configurations`.
    curve, s
        (n,) index of the curve on which each row is, -1 if it is on none, and (n,) the arc
        length of the row on this curve.
    status
        (n,) status of each row. OK: the row is on a curve. AT_SINGULARITY: the row is
        so near to a crossing of curves that no curve is followed to the row. MODE_LOST:
        all other rows.
    crossed
        (n,) whether the row is itself a crossing of curves, at which every rate may
        vanish.
    range
        Lowest and highest input (rad).
    """

    def __init__(
        self,
        position_analysis: PositionAnalysis,
        outputs: Sequence[tuple[int, int]],
        values: Floats,
        assembly_mode: Integers,
        passed: Floats | None = None,
    ) -> None:
        """Follow all curves of configurations, and locate the rows of a motion on them.

        A curve consists of the configurations that a mechanism with one input can reach. A
        row is one sample in one assembly mode (way to assemble the mechanism). Links
        without an influence on the outputs are left out first.

        Parameters
        ----------
        position_analysis
            Position analysis of a mechanism with one degree of freedom.
        outputs
            Pairs of link indices (o, s): the output is the motion of link o relative to
            s.
        values, assembly_mode
            Configurations (n, variables) of the rows in rad, and the mode (n,) of each.
        passed
            (n,) inputs (rad) of the rows if they are a simulation, otherwise None.
        """
        self.whole = position_analysis
        self._values = values
        # The part of the mechanism that determines the positions of the output links.
        output_links = [link for output in outputs for link in output]
        part = find_placing_part(position_analysis, output_links)
        self.position_analysis = part.position_analysis
        # For each assembly mode of the part, the assembly modes of the whole mechanism that
        # contain this mode.
        self._whole_modes = part.whole_modes
        # Index of the variable of the input, among all variables of the part.
        self._driven = self.position_analysis.solver.input_variable
        # All curves of the part, each with its pieces in the different assembly modes.
        self.configurations: Configurations = self.position_analysis.configurations
        self.curves = [item.curve for item in self.configurations.curves]
        # The singularities on the curves. The links have other indices in the part, so
        # outputs are passed by names of links.
        names = position_analysis.mechanism.links
        self.report = SingleFreedomSingularities(
            self.position_analysis, self.curves, [(names[o], names[s]) for o, s in outputs]
        )

        part_values = values[:, part.variables]
        # For each row the index of the curve on which it is, -1 if it is on none, and its
        # arc length on this curve.
        self.curve, self.s = self._find_curve_points(part_values, assembly_mode)
        # Curves end a little before a crossing with other curves, so a row at a crossing is
        # on no curve. The status says so.
        distances = self._distances_to_crossings(part_values)
        self.status = self._decide_status(distances)
        # `crossed` says whether a row is itself a crossing. This is known only for
        # crossings whose configuration was computed.
        is_at_crossing = distances.located_crossing < AT_CROSSING_RAD
        is_on_no_curve = self.curve < 0
        self.crossed = is_on_no_curve & is_at_crossing

        # The least and the greatest input.
        self.range: tuple[float, float] = position_analysis.range
        # The parts of curves that a simulation passes; None for other motions.
        self._passed_parts: list[PassedPart] | None = None
        if passed is not None:
            rows = SimulatedRows(
                curve=self.curve,
                s=self.s,
                q=passed,
                assembly_mode=assembly_mode,
                crossing=self._find_crossings_at_rows(part_values),
            )
            periods = [self._period(number) for number in range(len(self.curves))]
            self._passed_parts = find_passed_parts(
                rows, self.curves, self._crossings, self._driven, periods
            )
            passed_inputs = np.append(passed, self._find_passed_dead_centres())
            self.range = float(np.min(passed_inputs)), float(np.max(passed_inputs))

    def _find_curve_points(
        self, values: Floats, assembly_mode: Integers
    ) -> tuple[Integers, Floats]:
        """Return the curve of configurations on which each row is, and its arc length.

        A curve consists of the configurations that a mechanism with one input can reach. A
        row is one sample of a motion.

        Parameters
        ----------
        values
            (n, variables) configurations (rad), NaN for none. The variables are those of
            the part of the mechanism that moves the outputs.
        assembly_mode
            (n,) assembly mode of each row.

        Returns
        -------
        curve_numbers, s
            (n,) indices of the curves, -1 for rows on none, and (n,) arc lengths (rad), NaN
            for rows on none.
        """
        curve_numbers = np.full(len(values), -1)
        s = nans(len(values))
        is_finite = all_finite(values, 1)

        def search_curve(number: int, is_candidate: Bools) -> None:
            """Search one curve for those candidate rows that are on no curve so far."""
            (rows,) = np.nonzero(is_candidate & is_finite & (curve_numbers < 0))
            positions = self.curves[number].find(values[rows])
            is_on_curve = np.isfinite(positions)
            curve_numbers[rows[is_on_curve]] = number
            s[rows[is_on_curve]] = positions[is_on_curve]

        # For each curve, whether each row (n,) has an assembly mode of the curve.
        has_mode_of_curve = []
        # The order is that of `self.curves`.
        for item in self.configurations.curves:
            modes_of_curve = self.modes_of(item.pieces)
            has_mode_of_curve.append(np.isin(assembly_mode, modes_of_curve))
        # Each row is searched on the curves of its assembly mode. A row that is not found
        # there is searched on all other curves.
        for number, has_mode in enumerate(has_mode_of_curve):
            search_curve(number, has_mode)
        for number, has_mode in enumerate(has_mode_of_curve):
            search_curve(number, ~has_mode)
        return curve_numbers, s

    def _distances_to_crossings(self, values: Floats) -> "_CrossingDistances":
        """Return how far configurations (n, variables) are from the nearest crossing."""
        any_crossing = np.full(len(values), np.inf)
        located_crossing = np.full(len(values), np.inf)
        for point in self.report.crossings:
            difference = self.curves[point.curve].wrapped(values - point.values)
            distance = max_abs(difference, axis=1)
            # `fmin` ignores NaN, the distance of a row without a configuration.
            any_crossing = np.fmin(any_crossing, distance)
            if point.crossing is not None:
                located_crossing = np.fmin(located_crossing, distance)
        return _CrossingDistances(any_crossing, located_crossing)

    @cached_property
    def _crossings(self) -> list[SingularPoint]:
        """The crossings of curves, each once; the report has them once for every output."""
        first_output = self.report.outputs[0]
        return [point for point in self.report.crossings if point.output == first_output]

    def _find_crossings_at_rows(self, values: Floats) -> Integers:
        """Return the index of the crossing at which each row (n,) is, -1 for none.

        Parameters
        ----------
        values
            (n, variables) configurations (rad) of the rows.
        """
        crossing_numbers = np.full(len(values), -1)
        for number, point in enumerate(self._crossings):
            difference = self.curves[point.curve].wrapped(values - point.values)
            is_near = max_abs(difference, axis=1) < NEAR_CROSSING_RAD
            crossing_numbers[is_near] = number
        return crossing_numbers

    def _decide_status(self, distances: "_CrossingDistances") -> Array:
        """Return the status (n,) of each row, which says why a row is on no curve.

        A row is one sample of one assembly mode. OK means that the row is on a curve of
        configurations.

        Where curves cross, the closure equations are singular. Curves are followed only up
        to a little before the crossing. A row in this gap is on no curve, and its status is
        AT_SINGULARITY.
        """
        is_near_crossing = distances.any_crossing < NEAR_CROSSING_RAD
        status = np.where(is_near_crossing, Status.AT_SINGULARITY, Status.MODE_LOST)
        status[self.curve >= 0] = Status.OK
        return status

    def modes_of(self, pieces: Iterable[Piece]) -> list[int]:
        """Return the numbers of the assembly modes of pieces of curves.

        The configuration curves belong to a submechanism: the links and pairs that
        determine the positions of the outputs. A piece is a section of such a curve
        that is one assembly mode of the submechanism. This mode belongs to one or
        several modes of the whole mechanism, whose numbers are returned.
        """
        modes: list[int] = []
        for part_mode in {piece.assembly_mode for piece in pieces}:
            if part_mode is not None:
                modes += self._whole_modes[part_mode]
        return sorted(modes)

    def find_occurrences(
        self, places: Sequence[tuple[int, float]], values: Floats, margin: float = 0.0
    ) -> Iterator[Occurrence]:
        """Yield the inputs at which a configuration occurs, with its assembly modes.

        A singular configuration has a table row for each of these inputs. After a period of
        the input the mechanism is in the same configuration again. In a range of two
        revolutions, for example, a four-bar has each configuration twice.

        - If a simulation passes the configuration, the inputs at which it passes are
          yielded.
        - If a simulation does not pass it, a single input is yielded, marked as not inside.
        - For other motions, all inputs in the range are yielded. If there is none, the
          input nearest to the range is yielded, marked as not inside.

        Parameters
        ----------
        places
            The configuration as points of curves of configurations: index of the curve and
            arc length (rad). There are several if curves cross in the configuration.
        values
            (variables,) the variables of the configuration (rad).
        margin
            In a range of whole periods, both ends are the same. An input nearer to the
            upper end than this (rad) is moved to the lower end.
        """
        # This is true only for simulations.
        if self._passes_any(places):
            yield from self._find_passages(places, values)
            return
        # The period of the input is that of the first curve.
        first_curve, _ = places[0]
        inputs = self._find_inputs(first_curve, values[self._driven], margin)
        if self.is_simulation:
            # The simulation does not pass the configuration. One input is enough to list
            # the configuration.
            inputs = inputs[:1]
        for q in inputs:
            is_in_range = bool(in_range(np.array(q), *self.range))
            yield Occurrence(
                q,
                modes=self._modes_at(places, q),
                is_inside=is_in_range and not self.is_simulation,
            )

    def _find_passages(
        self, places: Sequence[tuple[int, float]], values: Floats
    ) -> Iterator[Occurrence]:
        """Yield the inputs at which a simulation passes a configuration, in rising order.

        Each input has the numbers of its assembly modes (ways to assemble the mechanism).
        These are the modes of all samples that the simulation has on the same part of a
        curve of configurations.

        Parameters
        ----------
        places
            The configuration as points of curves of configurations: index of the curve and
            arc length (rad). There are several if curves cross in the configuration.
        values
            (variables,) the variables of the configuration (rad).
        """
        q = values[self._driven]
        modes_by_input: dict[float, set[int]] = {}
        for curve, s in places:
            period = np.array(self._period(curve))
            for part in self.passed_parts(curve):
                passages = part.find_passages(np.array([s]), PIECE_END_TOLERANCE_RAD)
                # A curve ends a little before a crossing, so its input there differs a
                # little from that of the crossing. The exact input is q plus whole periods.
                inputs_on_curve = self.input_in_part(part, passages)
                for passed_input in q + whole_laps(inputs_on_curve - q, period):
                    modes = modes_by_input.setdefault(float(passed_input), set())
                    modes |= part.assembly_modes
        for passed_input, modes in sorted(modes_by_input.items()):
            yield Occurrence(passed_input, modes=sorted(modes), is_inside=True)

    def passed_parts(self, curve: int) -> list[PassedPart]:
        """Return the parts of a curve that a simulation passes; none for other motions."""
        return [part for part in self._passed_parts or [] if part.curve == curve]

    def input_in_part(self, part: PassedPart, s: Floats) -> Floats:
        """Return the inputs (n,) of a simulation at arc lengths (n,) of a part, in rad."""
        return self.curves[part.curve].at(s).values[:, self._driven] + part.shift

    def _modes_at(self, places: Sequence[tuple[int, float]], q: float) -> list[int]:
        """Return the assembly modes that have a configuration at an input q (rad).

        The configuration is given by its places: indices of curves and arc lengths (rad).
        """
        # A piece is a part of a curve that is one assembly mode (way to assemble the
        # mechanism).
        pieces: list[Piece] = []
        for curve, s in places:
            pieces += self._pieces_at(curve, s, q)
        return self.modes_of(pieces)

    def _passes_any(self, places: Sequence[tuple[int, float]]) -> bool:
        """Return whether a simulation passes any of some places; False for other motions.

        A place is the index of a configuration curve, and an arc length (rad) on this
        curve. A simulation passes only parts of curves.
        """
        for curve, s in places:
            for part in self.passed_parts(curve):
                if len(part.find_passages(np.array([s]), PIECE_END_TOLERANCE_RAD)):
                    return True
        return False

    def _find_inputs(self, curve: int, q: float, margin: float) -> list[float]:
        """Return all inputs in the range that have the same configuration as an input q.

        A singular configuration gets a table row for each of these inputs. They differ from
        q by whole periods. If none of them is in the range, the nearest one outside is
        returned. If the range is a whole number of periods, its lower and its upper end
        have the same configuration, and only one end is returned.

        Parameters
        ----------
        curve, q
            Index of a curve through the configuration, and the input (rad) there. The
            curve determines the period.
        margin
            If the range is a whole number of periods, an input nearer to its upper end than
            this (rad) is set to its lower end. So rounding does not decide which end is
            returned.
        """
        low, high = self.range
        inputs, _ = turns_in_range(np.array([q]), low, high, self._period(curve))
        # The count is 0 if the range is not a whole number of periods.
        has_whole_periods = self.count_periods_in_range(curve) > 0
        if has_whole_periods:
            is_at_upper_end = high - inputs < margin
            inputs = np.where(is_at_upper_end, low, inputs)
        occurrence_inputs: list[float] = inputs.tolist()
        return occurrence_inputs

    def _pieces_at(self, curve: int, s: float, q: float) -> Iterator[Piece]:
        """Yield the pieces of a curve that include an arc length s at an input q.

        A piece is a part of the curve in one assembly mode (way to assemble the mechanism).
        The pieces tell the assembly modes of the configuration.

        If the range of the input has several periods, each period has a piece for the same
        part of the curve. For example, let the range be 0 to 720 deg with a period of 360
        deg. One piece includes s at the input 30 deg, another one includes s at 390 deg.
        For q = 30 deg only the first piece is yielded.

        A piece is yielded if its input at s is q. The two ends of a range of whole periods
        count as the same input. In a simulation all inputs that differ by whole periods do.

        Parameters
        ----------
        curve, s
            Index of the curve, and arc length (rad).
        q
            The input (rad).
        """
        for piece, input_in_piece in self._pieces_with_inputs(curve, s):
            # Both inputs belong to the same configuration, so they differ by whole periods.
            periods_between = round((input_in_piece - q) / self._period(curve))
            if self._is_same_input(curve, periods_between):
                yield piece

    def _pieces_with_inputs(self, curve: int, s: float) -> Iterator[tuple[Piece, float]]:
        """Yield each piece of a curve that includes an arc length, with its input (rad).

        A piece is a part of a curve of configurations in one assembly mode (way to assemble
        the mechanism). So the pieces tell the modes of a configuration. The input is the
        one at this arc length, shifted by whole periods into the range of the input.

        On a closed curve, the same configurations repeat in each lap. In a lap the arc
        length grows by the length of the curve, and the input by its `rise`.

        Parameters
        ----------
        curve, s
            Index of the curve, and arc length (rad).
        """
        arc_curve = self.curves[curve]
        input_on_curve = float(arc_curve.at(s).values[0, self._driven])
        # A piece of a closed curve may begin in the lap before and end in the lap after.
        laps = (0, 1, -1) if arc_curve.closed else (0,)
        for lap in laps:
            s_in_lap = s + lap * arc_curve.length
            input_in_lap = input_on_curve + lap * arc_curve.rise[self._driven]
            for piece in self.configurations.curves[curve].pieces:
                if _includes(piece, s_in_lap):
                    # The input on the curve can be outside of the range. With `shift`, some
                    # whole periods of the input, it is inside.
                    input_in_range = input_in_lap + piece.shift
                    yield piece, input_in_range

    def _is_same_input(self, curve: int, periods_between: int) -> bool:
        """Return whether two inputs that differ by some periods count as the same input.

        A period is the growth of the input after which configurations repeat.

        Parameters
        ----------
        curve
            Index of the curve with this configuration. Other curves can have other periods.
        periods_between
            Number of periods between the inputs, of either sign.
        """
        if self.is_simulation:
            # The input of a simulation may pass any number of periods. Inputs that differ
            # by whole periods all count as the same one.
            return True
        periods_in_range = self.count_periods_in_range(curve)
        if periods_in_range == 0:
            # The range of the input is not a whole number of periods.
            return periods_between == 0
        # The range is a whole number of periods. Its lower and its upper end count as the
        # same input, and `periods_in_range` periods are between them.
        return periods_between % periods_in_range == 0

    def input_at(self, curve: int, s: Floats) -> Floats:
        """Return the input (n,) at arc lengths s (n,), in the range if possible.

        After a whole period of the input the configuration is the same. So inputs (rad) are
        shifted by whole periods into the range, or as near to it as possible.
        """
        q = self.curves[curve].at(s).values[:, self._driven]
        return into_range(q, *self.range, self._period(curve))

    def is_in_first_period(self, curve: int, q: Floats) -> Bools:
        """Return whether inputs q (n,) are in the first period of the range, with its ends.

        If configurations do not repeat, all inputs are.
        """
        low = self.range[0]
        high = low + self._period(curve)
        return (q >= low - END_TOLERANCE_RAD) & (q <= high + END_TOLERANCE_RAD)

    def _find_passed_dead_centres(self) -> Floats:
        """Return the inputs (rad) at the dead centres that a simulation passes.

        The input turns back there, so it is not between the inputs of the rows.
        """
        inputs = np.zeros(0)
        for part in self._passed_parts or []:
            dead_centres = self.curves[part.curve].dead_points(self._driven).places
            passages = part.find_passages(dead_centres)
            inputs = np.append(inputs, self.input_in_part(part, passages))
        return inputs

    def count_periods_in_range(self, curve: int) -> int:
        """Return how many periods of a curve the range has.

        The result is 0 if this is not a whole number, or in a simulation.
        """
        if self.is_simulation:
            return 0
        return whole_periods(*self.range, self._period(curve))

    def _period(self, curve: int) -> float:
        """Return the growth of the input (rad) after which configurations repeat."""
        (period,) = self.position_analysis.solver.periods
        return self.curves[curve].returns_after(self._driven, period)

    @property
    def is_simulation(self) -> bool:
        """Whether the rows are a simulation: only parts that it passes are inside."""
        return self._passed_parts is not None

    def angle(self, kind: Type, curve: int, s: Floats, output: int) -> Floats:
        """Return the angular distance of an output from type I or II along a curve.

        - At type I the output rests while the input moves. The tangent of the angle is the
          absolute value of the velocity coefficient y'/q', the rate of the output
          divided by the rate of the input. Primes are derivatives with respect to the
          arc length of the curve.
        - At type II the input rests while the output moves. The sine of the angle is the
          transmission measure (`Transmission`), which states from 0 to 1 how firmly the
          locked input holds the output.

        The angle says how far a configuration is from a singularity of this type. It is 0
        only at the singularity, and at most pi/2.

        Parameters
        ----------
        kind
            Type I or II.
        curve, s
            Index of the curve of configurations, and arc lengths (n,) on the curve (rad).
        output
            Index of the output among the outputs.

        Returns
        -------
        (n,) angles (rad); for type I NaN where both rates vanish.
        """
        if kind is Type.I:
            return self._angle_to_type_one(curve, s, output)
        return self._angle_to_type_two(curve, s, output)

    def _angle_to_type_one(self, curve: int, s: Floats, output: int) -> Floats:
        """Return the angular distance (n,) of an output from singularities of type I.

        The tangent of the angle is the velocity coefficient: the rate of the output
        divided by the rate of the input. The angle is zero where the output rests while
        the input moves, and NaN where both rest.

        Parameters
        ----------
        curve, s
            Index of the curve of configurations, and arc lengths (n,) on the curve (rad).
        output
            Index of the output.
        """
        link_motion = self.report.curve_motions[curve].links_at(s)
        # `speeds` returns the absolute values of the relative angular velocity of two links
        # per unit of arc length, and of its derivative.
        output_speed, _ = link_motion.speeds(self.report.outputs[output])
        input_speed, _ = link_motion.speeds(self.report.input)
        # Speeds up to `MIN_OUTPUT_MOTION` are zero up to rounding.
        is_moving = np.hypot(output_speed, input_speed) > MIN_OUTPUT_MOTION
        return np.where(is_moving, np.arctan2(output_speed, input_speed), np.nan)

    def _angle_to_type_two(self, curve: int, s: Floats, output: int) -> Floats:
        """Return the angular distance (n,) of an output from singularities of type II.

        The sine of the angle is the transmission measure, which states from 0 to 1 how
        firmly the locked input fixes the output. The angle is zero where the output can
        move while the input rests.

        Parameters
        ----------
        curve, s
            Index of the curve of configurations, and arc lengths (n,) on the curve (rad).
        output
            Index of the output.
        """
        curve_motion = self.report.curve_motions[curve]
        locked_variables = (self._driven,)
        output_link, reference_link = self.report.outputs[output]
        transmission = Transmission(
            curve_motion.curve.closure.tree, locked_variables, output_link, reference_link
        )
        # The measure needs the angular velocity per unit rate of each variable.
        velocity_vectors = curve_motion.links_at(s).motion.vectors
        return np.arcsin(transmission.measure(velocity_vectors))

    def measures(self) -> dict[tuple[int, Form], dict[str, Floats]]:
        """Return how near the rows (samples of a motion) are to singularities, by output.

        Two of the measures are the coefficients of the relation c y' = d q' between a rate
        y' of the output link and the rate q' of the input. c is 0 at type II (the input
        rests), d is 0 at type I (the output rests). An output has one or two relations:

        - In form i, y' is the rate of the output link relative to the reference link of the
          output.
        - In form ii, y' is its rate relative to the reference link of the input.

        Returns
        -------
        The keys are the index of an output and a form of its relation. The values are
        columns (n,) by name, NaN in rows that are on no curve of configurations. Only ``c``
        and ``d`` depend on the form:

        - ``c`` and ``d``: the coefficients of the relation,
        - ``output_rate`` and ``input_rate``: rates of the output and the input as the
          configuration moves along its curve, per unit of arc length,
        - ``distance_I`` and ``distance_II`` (rad): angles that vanish at singularities of
          type I or II, see `angle`,
        - ``transmission`` (rad): the transmission angle of the dyad (two links in series)
          that places the output,
        - ``input_margin_I`` and ``input_margin_II`` (rad): change of the input from the row
          to the nearest singularity of the type along the curve.
        """
        columns: dict[tuple[int, Form], dict[str, Floats]] = {}
        for number in np.unique(self.curve[self.curve >= 0]).tolist():
            (rows,) = np.nonzero(self.curve == number)
            curve_measures = self._measures_on_curve(number, self.s[rows])
            for output_and_form, values_by_name in curve_measures.items():
                if output_and_form not in columns:
                    columns[output_and_form] = {
                        name: nans(len(self.s)) for name in values_by_name
                    }
                for name, values in values_by_name.items():
                    columns[output_and_form][name][rows] = values
        return dict(sorted(columns.items()))

    def _measures_on_curve(
        self, number: int, s: Floats
    ) -> dict[tuple[int, Form], dict[str, Floats]]:
        """Return how near the points of one curve are to singularities, for each output.

        `measures` combines the results of all curves. A curve consists of configurations of
        the mechanism.

        An output has one or two relations c y' = d q' between a rate y' of the output link
        and the rate q' of the input. In form "i", y' is relative to the reference link of
        the output. In form "ii", y' is relative to the reference link of the input.

        Parameters
        ----------
        number, s
            Index of the curve, and arc lengths (m,) on the curve (rad).

        Returns
        -------
        Columns (m,) by name, for each output and each form of its relation. `measures`
        explains the names.
        """
        curve_measures: dict[tuple[int, Form], dict[str, Floats]] = {}
        # For each output the transmission angle (m,) of the two links in series that place
        # the output link: the acute angle between their planes.
        angles = self.transmission_angles(self.curves[number].at(s).values)
        for output, transmission_angle in enumerate(angles):
            curve_relations = self.report.evaluate_relations(number, s, output)
            # For types I and II: an angle that vanishes at singularities of the type, and
            # how far the input is from its value at the nearest one on the curve.
            distances_and_margins = self._distances_and_margins(number, s, output)
            for relation in curve_relations.relations:
                curve_measures[output, relation.form] = {
                    "input_rate": curve_relations.input_rate,
                    "output_rate": curve_relations.output_rate,
                    "transmission": transmission_angle,
                    **distances_and_margins,
                    "c": relation.c,
                    "d": relation.d,
                }
        return curve_measures

    def _distances_and_margins(
        self, curve: int, s: Floats, output: int
    ) -> dict[str, Floats]:
        """Return how far an output is from singularities of types I and II along a curve.

        The output rests at type I, and the input rests at type II. There are two kinds of
        distances: an angle that vanishes at the type (``distance_I``), and the change of
        the input up to the nearest singularity of the type (``input_margin_I``).

        Parameters
        ----------
        curve, s
            Index of the curve of configurations, and arc lengths (m,) on the curve (rad).
        output
            Index of the output among the outputs.

        Returns
        -------
        (m,) angles (rad) by their names.
        """
        columns: dict[str, Floats] = {}
        for kind in (Type.I, Type.II):
            columns[f"distance_{kind}"] = self.angle(kind, curve, s, output)
            columns[f"input_margin_{kind}"] = self._input_margin(curve, output, kind, s)
        return columns

    def transmission_angles(self, values: Floats) -> list[Floats]:
        """Return the transmission angle of each output at configurations.

        An output is the motion of one link relative to another one. In many mechanisms, two
        links in series (a dyad) determine the position of the output link. The transmission
        angle is then the acute angle between the planes of these two links. It measures
        the distance from a singularity of type II, at which it is zero.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).

        Returns
        -------
        (n,) angles (rad) for each output, NaN if a group other than a dyad places it.
        """
        solver = self.position_analysis.solver
        axes = solver.closure.linearise(values).axes
        return [
            transmission_angle_of_group(solver.assembly.joining_group(*links), axes)
            for links in self.report.outputs
        ]

    def least_dyad_angle(self, values: Floats, output: int) -> Floats:
        """Return the least distance from type II of the dyads that place an output.

        The caller asks whether a dyad is the reason why a mechanism is near a singularity
        of type II. A dyad is two links in series. It is at such a singularity if it is
        stretched or folded. Its distance from there is the transmission angle, the acute
        angle between the planes of both links.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        output
            Index of the output.

        Returns
        -------
        (n,) angles (rad). NaN if a group of links that is no dyad helps to place the
        output, or if no group does.
        """
        solver = self.position_analysis.solver
        # An output is the relative motion of two links.
        links = frozenset(self.report.outputs[output])
        # The groups of links that place these two links if the input is locked.
        groups = placing_groups(solver.mechanism, solver.assembly, links)
        if not groups:
            # The locked input itself joins both links, so no dyad places the output.
            return nans(len(values))
        # The loop computes a minimum, so the start value is the largest possible distance.
        least = np.full(len(values), MAX_TYPE_II_DISTANCE_RAD)
        # The axes of all pairs in each configuration.
        axes = solver.closure.linearise(values).axes
        for group in groups:
            if not group.is_dyad:
                return nans(len(values))
            angle = transmission_angle_of_group(group, axes)
            # The distance is 0 where the dyad is stretched or folded.
            least = np.minimum(least, distance_from_type_two(angle))
        return least

    @cached_property
    def largest_arc_sine(self) -> float:
        """The largest sine of an arc between two axes of a link.

        This sine is the scale of the transmission measure, which says how far a
        configuration is from a singularity of type II. If all arcs are small, the mechanism
        is nearly planar, and the measure is proportional to this sine. In mechanisms with
        contacts the arcs are not the only sizes, because their profiles have sizes, too.
        Their scale is therefore not computed from arcs, but is 1.
        """
        mechanism = self.position_analysis.solver.mechanism
        if mechanism.has_contacts:
            return 1.0
        sines = [0.0]
        for axes in link_axes(mechanism).values():
            if not axes:
                continue
            # Unit vectors (axes of the link, 3). The sine is the size of a cross product.
            directions = np.array(list(axes.values()))
            for direction in directions:
                sines.extend(np.linalg.norm(np.cross(direction, directions), axis=1))
        # If all axes coincide, the scale is 1.
        return float(max(sines)) or 1.0

    def singular_values(self) -> Floats:
        """Return two measures (2, n) of how firmly the locked input fixes all links.

        They are the smallest singular value of the loop equations with the input locked,
        and its ratio to the largest one; see
        `spherekit.velocities.transmission_measure.input_authority`. A row is one sample of
        one assembly mode. Rows on no configuration curve are NaN.
        """
        solver = self.whole.solver
        values = np.where(self.curve[:, None] >= 0, self._values, np.nan)
        vectors = solver.closure.linearise(values).vectors
        return input_authority(solver.closure.tree, [solver.input_variable], vectors)

    def output_angle(self, curve: int, output: int, s: Floats) -> Floats:
        """Return the angle (n,), in rad, of an output along a curve of configurations.

        The output is the rotation of one link relative to another. If an R pair joins both
        links, the angle is the variable of this pair, or its negative. Otherwise the angle
        is 0 at the first arc length. From there on, the relative angular velocity per unit
        of arc length is integrated by the trapezoidal rule.

        Parameters
        ----------
        curve, output
            Index of the curve of configurations, and index of the output.
        s
            (n,) rising arc lengths (rad).
        """
        angle = self.pair_angle(output, self.curves[curve].at(s).values)
        if angle is not None:
            return angle
        pole = pole_of(*self.report.outputs[output])
        rate, _ = self.report.curve_motions[curve].signed_rate(s, pole)
        trapezoids = 0.5 * (rate[1:] + rate[:-1]) * np.diff(s)
        return np.append(0.0, np.cumsum(trapezoids))

    def pair_angle(self, output: int, values: Floats) -> Floats | None:
        """Return the angle (n,) of an output, None if no R pair joins its two links.

        Parameters
        ----------
        output
            Index of the output.
        values
            (n, variables) configurations (rad).
        """
        link, reference = self.report.outputs[output]
        mechanism = self.position_analysis.mechanism
        variable = mechanism.angle_between(link, reference)
        if variable is None:
            return None
        # A pair variable is the angle of the second link of the pair relative to the first.
        _, second_link = mechanism.ends[mechanism.variable_owners[variable]]
        return values[:, variable] if second_link == link else -values[:, variable]

    def configuration(self, curve: int, s: float) -> Floats:
        """Return the orientations (links, 3, 3) of the part at an arc length (rad)."""
        arc_curve = self.curves[curve]
        return arc_curve.closure.linearise(arc_curve.at(s).values).rotations[0]

    def crossing_ends(self, curve: int) -> list[tuple[float, Floats]]:
        """Return the ends of a curve of configurations at crossings with other curves.

        A curve ends a little before the crossing. With the result, callers can examine the
        crossing itself, too.

        Parameters
        ----------
        curve
            Index of the curve.

        Returns
        -------
        For each such end its arc length (rad), and the variables (variables,) of the
        crossing (rad). Whole revolutions are added to the variables, so that they differ
        little from those at the end of the curve.
        """
        arc_curve = self.curves[curve]
        ends: list[tuple[float, Floats]] = []
        for crossing in self._crossings:
            for crossing_curve, s in crossing.places:
                if crossing_curve == curve:
                    # The first node of the curve, or the last one.
                    end_values = arc_curve.nodes.values[0 if s == 0.0 else -1]
                    difference = arc_curve.wrapped(crossing.values - end_values)
                    ends.append((s, end_values + difference))
        return ends

    def _input_margin(self, number: int, output: int, kind: Type, s: Floats) -> Floats:
        """Return how far the input is from the input of the nearest singularity on a curve.

        The curve consists of configurations. Each point has a difference of inputs to the
        singularity before it, and one to the singularity after it. The smaller difference
        is the result.

        Parameters
        ----------
        number, output
            Index of the curve, and index of the output.
        kind
            Type of the singularity. Crossings with other curves count for every type.
        s
            (n,) arc lengths (rad).

        Returns
        -------
        (n,) absolute differences (rad), NaN if the curve has no such singularity, or if all
        its points are singular.
        """
        singularities = self._singular_positions(number, output, kind)
        curve = self.curves[number]
        inputs = curve.at(s).values[:, self._driven]
        # Singularities are sorted by their arc length. For each point, this is the index of
        # the first singularity that comes after the point.
        next_number = np.searchsorted(singularities.s, s)
        # NaN stands for the missing singularity before the first one, or after the last
        # one. NaN in front raises all indices by 1, so that `next_number` yields the
        # singularity before the point.
        input_before = np.append(np.nan, singularities.q)[next_number]
        input_after = np.append(singularities.q, np.nan)[next_number]
        # `fmin` ignores NaN.
        return np.fmin(np.abs(input_before - inputs), np.abs(input_after - inputs))

    def _singular_positions(
        self, number: int, output: int, kind: Type
    ) -> "_SingularPositions":
        """Return the singularities of one type on a curve of configurations, in order.

        Crossings with other curves are included, because they are singular, too.

        The caller searches, for each point of the curve, the singularity before it and the
        one after it. Singularities of a closed curve repeat in each lap. They are listed
        for three laps, so that each point of the middle lap has both.

        Parameters
        ----------
        number, output, kind
            Index of the curve, index of the output, and type of the singularity.
        """
        curve = self.curves[number]
        # Singular points state their output by the indices of its two links.
        links = self.report.outputs[output]
        arc_lengths: list[float] = []
        inputs: list[float] = []
        # Index of the input among the variables of a configuration.
        input_variable = self._driven
        for point in self.report.points:
            if point.curve == number and point.output == links and point.type == kind:
                arc_lengths.append(point.s)
                inputs.append(point.values[input_variable])
        for crossing_s, crossing_values in self.crossing_ends(number):
            arc_lengths.append(crossing_s)
            inputs.append(crossing_values[input_variable])
        s = np.array(arc_lengths, dtype=float)
        q = np.array(inputs, dtype=float)
        if curve.closed:
            # In a lap the arc length grows by the length of the curve, the input by `rise`.
            rise = curve.rise[input_variable]
            s = np.concatenate([s - curve.length, s, s + curve.length])
            q = np.concatenate([q - rise, q, q + rise])
        order = np.argsort(s)
        return _SingularPositions(s[order], q[order])


@dataclass(frozen=True)
class _SingularPositions:
    """Positions of k singularities on one configuration curve, in order of arc length.

    Attributes
    ----------
    s, q
        (k,) arc lengths and inputs (rad).
    """

    s: Floats
    q: Floats


def _includes(piece: Piece, s: float) -> bool:
    """Return whether a piece of a curve includes an arc length, within a tolerance."""
    start = piece.start - PIECE_END_TOLERANCE_RAD
    stop = piece.stop + PIECE_END_TOLERANCE_RAD
    return start <= s <= stop
