"""Integrates a compiled equation of motion and stores the Taylor series of its steps.

The integrator's tolerance is relative to the largest element of its state. So that a run
stays accurate over thousands of revolutions, the state is normalised after some steps:
angles are reduced by whole turns, the work done is set aside, and the unit of momentum
grows with the momentum. In each step the loops open by little more than rounding. These
errors add up, so the loops are closed from time to time.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.dynamics.compiled_equation import CompiledEquation
from spherekit.dynamics.motion_expressions import EquationLayout
from spherekit.dynamics.step_probes import find_first_errors
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_kinds import joint_limit_roundings
from spherekit.mechanism.mechanism import Mechanism
from spherekit.progress import ProgressReporter
from spherekit.symbolic.taylor_integrator import (
    CHATTERING_EVENT_COUNT,
    IntegrationEventKind,
    Integrator,
)

STEPS_PER_SEGMENT = 50
"""Steps after which the state is normalised.

Larger: the state grows, and with it the absolute error of steps. Smaller: more time.
"""

SEGMENTS_PER_CLOSURE = 20
"""Segments after which the configuration is put back onto its curve.

Larger: loops open further. Smaller: more time.
"""

MAX_TAYLOR_STEPS = 300_000
"""Steps after which a run ends. The series of this many steps take about 0.6 GB."""

MIN_STEP_FRACTION = 1e-11
"""Shortest step relative to the whole time; a shorter one ends a run of either engine.

Larger: fast changes of loads end runs that could continue. Smaller: runs that cannot
continue take longer to end.
"""

CROSSING_RATIO = 1e-5
"""Ratio below which a configuration counts as a crossing of curves, in both engines.

The ratio is that of a measure, which is zero at a crossing, to its largest value so far.
The NumPy engine measures by the determinants of `CollocationStep.closure_determinants`, the
compiled engine by the square root of the independence of the closure equations. At the
distance d from its curve, a configuration misses a crossing by sqrt(d). The ratio therefore
has to fit `spherekit.dynamics.compiled_equation.MAX_STEP_TOLERANCE`. Larger: curves that
pass each other closely are taken for crossing ones. Smaller: crossings are missed.
"""

MAX_PROBE_ERROR = 100.0
"""Largest error of the momentum change in a step, as a multiple of the step's tolerance.

Larger: abrupt changes of loads are missed. Smaller: accurate steps are repeated.
"""

RETRY_FRACTION = 0.9
"""Length of a repeated step, relative to the time to the first point with an error.

Larger: the next step can contain that point again. Smaller: more steps.
"""

MIN_RETRY_FRACTION = 0.03
"""Smallest length of a repeated step, relative to the step that it replaces.

Larger: it can contain the erroneous place again. Smaller: abrupt changes at the start of a
step need more steps.
"""

MAX_TAYLOR_STEP_GROWTH = 4.0
"""Largest ratio of the length of a step to that of a shortened step before it."""

TURN_ROUNDING = 2.4492935982947064e-16
"""2 pi less its nearest float64, rad."""


@dataclass(frozen=True)
class TaylorStep:
    """One step of an integration by Taylor series.

    Attributes
    ----------
    start, length
        Time at the start, and length, s.
    series
        (states, order + 1) Taylor coefficients of the state, in powers of the time since
        the start.
    event_count
        Number of events that had occurred before the step.
    switch_signs
        (switches,) signs, 1 or -1, of the switch conditions in the step. A load changes
        abruptly where its switch condition is zero.
    """

    start: float
    length: float
    series: Floats
    event_count: int
    switch_signs: Floats


RunEnd = Literal[
    "time",
    "joint_limit",
    "singularity",
    "coordinates",
    "sticking",
    "too_fast",
    "too_many",
    "not_finite",
]


@dataclass(frozen=True)
class Segment:
    """Some successive steps of an integration by Taylor series, normalised together.

    The integrator's errors are relative to the largest number in its state, so its numbers
    have to stay small. The state is therefore normalised between two segments: angles are
    reduced by whole turns, the work of loads is added to a separate sum, and the unit of
    momentum grows with the momentum.

    Attributes
    ----------
    layout
        Positions of pair variables (joint angles), momenta and works in the state.
    starts, lengths
        (k,) start times and lengths of the k steps, s.
    series
        (k, states, order + 1) Taylor coefficients of the normalised state, in powers of
        time.
    turns
        (variables,) how many whole turns were subtracted from each variable.
    momentum_unit
        Unit, sqrt(J), by which momenta in the series are divided. A momentum is a rate
        times the square root of an inertia. Works are divided by the square of this unit.
    work
        (loads,) work of each load before the segment, J.
    """

    layout: EquationLayout
    starts: Floats
    lengths: Floats
    series: Floats
    turns: Floats
    momentum_unit: float
    work: Floats

    def evaluate(self, t: Floats) -> tuple[Floats, Floats]:
        """Return the states and their time derivatives (n, states) at times (n,) in s.

        A state has the pair variables, the momenta and the work of each load, in SI units.
        Whole turns were subtracted from the variables before this segment (`turns`), and
        are not added again here. Works are counted from the start of the simulation.
        """
        step = np.searchsorted(self.starts[1:], t, side="right")
        states, rates = _evaluate_series(self.series[step], t - self.starts[step])
        # In the series, momenta are divided by a unit, and works by the square of this
        # unit.
        work_unit = self.momentum_unit**2
        for array in (states, rates):
            array[:, self.layout.momentum_slice] *= self.momentum_unit
            array[:, self.layout.work_slice] *= work_unit
        # The series contain the work since the start of the segment only.
        states[:, self.layout.work_slice] += self.work
        return states, rates


@dataclass(frozen=True)
class TaylorRun:
    """A run: a finished integration of one compiled equation by Taylor series.

    Attributes
    ----------
    equation
        The equation that was integrated.
    segments
        Parts of the run in order of time. Each is a group of successive steps.
    events
        For each event its time (s), its kind, and the index of the pair variable (joint
        angle) to which it belongs, or -1.
    end
        The reason why the integration ended.
    end_time
        The time at which it ended, s.
    max_closure_residual
        Largest opening of a loop that corrections have removed, rad.
    max_independence
        Largest measure of independence of the loop-closure equations in the run. The
        measure is zero where sets of configurations cross. A run ends where the measure is
        very small relative to this largest value.
    """

    equation: CompiledEquation
    segments: tuple[Segment, ...]
    events: tuple[tuple[float, IntegrationEventKind, int], ...]
    end: RunEnd
    end_time: float
    max_closure_residual: float
    max_independence: float

    @property
    def last_state(self) -> Floats:
        """The state (states,) at the end: pair variables, momenta and works, in SI units.

        Whole turns are taken off the pair variables. The last segment (group of steps)
        states how many (`turns`).
        """
        states, _ = self.segments[-1].evaluate(np.array([self.end_time]))
        return states[0]


def _evaluate_series(series: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Return the values and rates (n, states) of n Taylor series of the state.

    Parameters
    ----------
    series
        (n, states, order + 1) coefficients of the powers of time, the constant first.
    h
        (n,) times since the start of each series, s.
    """
    h = h[:, None]
    values = series[:, :, -1]
    rates = np.zeros_like(values)
    # Horner's scheme for the polynomial and its derivative at once.
    for order in range(series.shape[2] - 2, -1, -1):
        rates = rates * h + values
        values = values * h + series[:, :, order]
    return values, rates


@dataclass(frozen=True)
class StepProbe:
    """Compares the Taylor series of k steps with the equation of motion.

    The series of a step is computed at its start. The series does not show a load that
    changes abruptly later in the step, such as tanh(1000 x) where x passes zero. The rates
    of the momenta in the series then differ from the rates that the equation of motion
    gives.

    Attributes
    ----------
    equation
        The compiled equation of motion, whose loads have such functions.
    starts, lengths
        (k,) start times and lengths of the steps, s.
    series
        (k, states, order + 1) Taylor coefficients of the state, in powers of the time since
        the start.
    common_parameters
        (parameters,) the parameters of the equation that are the same in all steps.
    switch_signs
        (k, switches) the parameters that follow: the signs of the switch conditions in each
        step.
    """

    equation: CompiledEquation
    starts: Floats
    lengths: Floats
    series: Floats
    common_parameters: Floats
    switch_signs: Floats

    def compare(self, steps: Indices, places: Floats) -> tuple[Floats, Floats]:
        """Compare the Taylor series of steps with the equation of motion at n places.

        A step with a large error is later repeated as a shorter one. Steep functions are
        functions such as tanh(1000 x) in the loads, which change abruptly where their
        argument x passes through zero. From the arguments, the caller finds these zeros,
        and compares there as well.

        Parameters
        ----------
        steps
            (n,) indices of steps.
        places
            (n,) fractions of these steps, from 0 at the start to 1 at the end.

        Returns
        -------
        errors
            (n,) errors of the momenta, as multiples of the largest error that is allowed.
        arguments
            (n, arguments) arguments x of the steep functions.
        """
        layout = self.equation.layout
        times_in_step = places * self.lengths[steps]
        states, rates = _evaluate_series(self.series[steps], times_in_step)
        momentum_rates, arguments = self._evaluate_equation(steps, times_in_step, states)
        # The error of a rate, times the length of the step, is an error of the momentum.
        rate_errors = np.abs(rates[:, layout.momentum_slice] - momentum_rates)
        momentum_errors = np.max(rate_errors, axis=1) * self.lengths[steps]
        # The largest allowed error is relative to the largest number in the state. This
        # number is about 1, because the unit of momentum is chosen accordingly. So the
        # allowed error need not be multiplied by it.
        max_error = MAX_PROBE_ERROR * self.equation.tolerance
        return momentum_errors / max_error, arguments

    def _evaluate_equation(
        self, steps: Indices, times_in_step: Floats, states: Floats
    ) -> tuple[Floats, Floats]:
        """Return the rates of the momenta that the equation of motion gives at n states.

        `compare` compares these rates with those of the Taylor series, and finds in this
        way the error of the series.

        A load with a steep function, such as tanh(1000 x), may change abruptly where its
        argument x is zero. The arguments are returned as well, so that their zeros can be
        found and the rates be compared there.

        Parameters
        ----------
        steps
            (n,) indices of steps.
        times_in_step
            (n,) times since the starts of these steps, s.
        states
            (n, states) states at these times.

        Returns
        -------
        (n, m) rates of the m momenta, and (n, arguments) values of all x.
        """
        probe_function = self.equation.probe_function
        assert probe_function is not None
        # The inputs of the function: state, time, parameters. Columns are the n times.
        times = self.starts[steps] + times_in_step
        inputs = [
            states.T,
            times[None],
            # Parameters that are the same in all steps.
            np.repeat(self.common_parameters[:, None], len(steps), axis=1),
            # The last parameters: signs of conditions that switch loads.
            self.switch_signs[steps].T,
        ]
        outputs = probe_function(np.concatenate(inputs))
        # One rate of the momentum for each degree of freedom, then the arguments.
        momentum_rates, arguments = np.split(outputs, [self.equation.layout.freedoms])
        return momentum_rates.T, arguments.T


@dataclass(frozen=True)
class RunStart:
    """The start of a run (an integration by Taylor series).

    Attributes
    ----------
    values
        (variables,) pair variables (joint angles, rad) of a configuration with closed
        loops, reduced by whole revolutions.
    turns
        (variables,) how many whole revolutions were subtracted from each variable.
    momenta
        (m,) momenta, in the unit square root of joule. With one degree of freedom the
        momentum is sqrt(B) u, with the inertia B and the rate u along the curve of
        configurations. The momentum is positive in the direction of the tangent that the
        compiled equation computes (`homogeneous_rates`).

        With several degrees of freedom, m of the pair variables are the coordinates. Each
        momentum is the rate of a coordinate times the constant sqrt(J). J is the sum of the
        largest moments of inertia of all links.
    momentum_unit
        A typical size of the momenta, not zero, in the same unit. The state of the
        integrator has the momenta divided by the larger of this size and the norm of
        `momenta`. So they are at most 1 at the start, a size like that of the angles. This
        is needed because errors of a step are relative to the largest number in the state.
    previous_run
        The run that this one continues, with other coordinates or a smaller tolerance. None
        for the first run.
    closure_residual
        By how much the loops were open (rad) at the end of the previous run. They have been
        closed in `values`. The number is kept because the integration reports the largest
        opening.
    """

    values: Floats
    turns: Floats
    momenta: Floats
    momentum_unit: float
    previous_run: TaylorRun | None = None
    closure_residual: float = 0.0


class TaylorIntegration:
    """Integrates a compiled equation of motion, step by step, and stores its Taylor series.

    Parameters
    ----------
    equation
        The compiled equation.
    mechanism
        The mechanism, whose torque tables and joint limits are used.
    start
        The state at the start of the integration.
    project
        A function that closes the loops of a configuration (variables,), and returns the
        closed configuration and the closure residual (rad) before.
    crossing_ratio
        The integration ends where the measure of independence of the loop-closure equations
        falls below the square of this ratio times the largest value of the measure. The
        measure is zero where curves or surfaces of configurations cross.
    """

    def __init__(
        self,
        equation: CompiledEquation,
        mechanism: Mechanism,
        start: RunStart,
        project: Callable[[Floats], tuple[Floats, float]],
        crossing_ratio: float,
    ) -> None:
        """Compute the state of the integrator at the start.

        The class describes the parameters. `project` closes the loops of a configuration,
        and `crossing_ratio` says how near to a crossing of configuration curves the run
        ends.
        """
        self.equation = equation
        self.layout = equation.layout
        self.project = project
        self.crossing_ratio = crossing_ratio
        # Torque tables and joint limits are parameters of the compiled equation.
        self.tables = [x for x in mechanism.loads if isinstance(x, TorqueTable)]
        self.limit_values: list[float] = []
        for limit in mechanism.joint_limits:
            # heyoka misses a limit at which a step starts exactly, if the angle then rests
            # or comes back in this step. So limits are wider by a rounding error.
            low_rounding, high_rounding = joint_limit_roundings(limit)
            self.limit_values += [limit.low - low_rounding, limit.high + high_rounding]
        self.variable_count = len(start.values)
        self.is_angle = np.isin(
            np.arange(self.variable_count), [*mechanism.angles.values()]
        )

        # Two quantities are stored apart from the integrator's state, so that its numbers
        # stay small: whole turns of the variables, and the work (J) of each load before the
        # current segment (up to `STEPS_PER_SEGMENT` steps).
        self.time = 0.0
        self.turns = start.turns
        self.work = np.zeros(len(mechanism.loads))
        self.max_closure_residual = start.closure_residual
        # The measure of independence of the loop-closure equations is zero where several
        # curves or surfaces of configurations cross. Small values are judged relative to
        # the largest value so far.
        independence = equation.measure_independence(start.values[None])
        self.max_independence = float(independence[0])
        previous = start.previous_run
        if previous is not None:
            self.time = previous.end_time
            self.max_closure_residual = max(
                previous.max_closure_residual, start.closure_residual
            )
            # The measures of two equations differ by a factor, which follows from both
            # measures in the same configuration.
            previous_measure = previous.equation.measure_independence(start.values[None])
            self.max_independence *= previous.max_independence / float(previous_measure[0])
            self.work = previous.last_state[previous.equation.layout.work_slice]
        # The state of the integrator: variables, momenta in their unit, works. The unit is
        # at least the norm of the momenta, since errors of a step are relative to the
        # largest number in the state.
        self.momentum_unit = max(start.momentum_unit, float(np.linalg.norm(start.momenta)))
        self.switch_signs = np.zeros(len(self.layout.switch_conditions))
        self.start_state = np.concatenate(
            [start.values, start.momenta / self.momentum_unit, np.zeros_like(self.work)]
        )
        self.segments: list[Segment] = []
        # Number of steps so far, rejected ones included.
        self.steps_tried = 0
        # Longest step (s) that is tried. Limited after a step missed a change of a load.
        self.max_step = np.inf

    def run(self, targets: Sequence[float]) -> TaylorRun:
        """Integrate the equation of motion up to the last target, and return the result.

        The integration ends earlier at an event, such as a singularity, if a step fails, or
        after `MAX_TAYLOR_STEPS` steps.

        Parameters
        ----------
        targets
            Rising times (s) at which a step has to end. Loads that are torque tables are
            linear in time between two targets.
        """
        integrator = self.equation.integrator
        progress = ProgressReporter("simulating")
        # The integrator has only one state, so a run in another thread has to wait.
        with self.equation.lock:
            # Some loads change abruptly where a number changes its sign, such as dry
            # friction where the sliding rate does. Find the signs at the start.
            self._set_switch_signs(targets[0])
            # Parameters of the equation, such as the slopes of torque tables, here for the
            # time from the start to the first target. `_integrate_to` changes them later.
            parameters = self._make_parameters(targets[0])
            integrator.start(self.start_state, self.time, parameters)
            for target in targets:
                # `end` is "time" if the target was reached, otherwise another reason.
                end = self._integrate_to(integrator, target, targets[-1], progress)
                if end != "time":
                    break
            return TaylorRun(
                equation=self.equation,
                segments=tuple(self.segments),
                events=tuple(_list_events(integrator)),
                end=end,
                end_time=self.time,
                max_closure_residual=self.max_closure_residual,
                max_independence=self.max_independence,
            )

    def _integrate_to(
        self,
        integrator: Integrator,
        target: float,
        last_target: float,
        progress: ProgressReporter,
    ) -> RunEnd:
        """Integrate up to a target, segment by segment, and return why this ended.

        A segment is a number of successive steps. After each segment, progress is reported.

        Parameters
        ----------
        integrator
            The integrator, with the state that the run has reached.
        target
            Time (s) up to which to integrate. The result is "time" if this time is reached.
        last_target
            Last target of the run, s.
        progress
            Object that shows the progress to the user.
        """
        end: RunEnd | None = None
        while end is None:
            end = self._integrate_segment(
                integrator, target, min_step=MIN_STEP_FRACTION * last_target
            )
            # A function of the text, which is called only if a report is due.
            progress.report_if_due(
                lambda: f"{self.time:.4g} of {last_target:.6g} s",
                done=self.time,
                total=last_target,
            )
            if end is None and self.steps_tried >= MAX_TAYLOR_STEPS:
                end = "too_many"
        return end

    @property
    def min_independence(self) -> float:
        """The measure of independence of the closure equations at which the run ends."""
        return self.crossing_ratio**2 * self.max_independence

    def _integrate_segment(
        self, integrator: Integrator, target: float, min_step: float
    ) -> RunEnd | None:
        """Integrate one segment (group of steps), and return why the integration ends.

        A segment consists of at most `STEPS_PER_SEGMENT` steps, and is stored. The result
        is None if the integration continues. If loads may change abruptly, the steps are
        compared with the equation of motion (probed). A step that missed a change is
        repeated with a smaller length.

        Parameters
        ----------
        integrator
            The integrator, with the state that the run has reached.
        target
            Time up to which the torque tables of loads are linear, s.
        min_step
            Length of a step below which the run ends, s.
        """
        # The state is changed in place. Some parameters of the equation depend on this
        # change: the unit of momentum, and the numbers of whole turns.
        self._normalise(integrator.state)
        self._renew_parameters(integrator, target)
        steps: list[TaylorStep] = []
        has_probes = self.equation.probe_function is not None
        # Steps before this index agree with the loads. A shortened step is probed at once.
        # Other steps of a segment are probed together, which is faster.
        probed_steps = 0
        end: RunEnd | None = None
        while end is None and len(steps) < STEPS_PER_SEGMENT:
            self.steps_tried += 1
            start = integrator.time
            event_count = len(integrator.seen_events)
            remaining = target - start
            is_shortened = self.max_step < remaining
            # The signs of the switch conditions that apply in this step.
            switch_signs = self.switch_signs
            if has_probes:
                parameters = self._all_parameters(integrator)
                switch_signs = parameters[self.layout.switch_slice]
            outcome, length = integrator.step(min(remaining, self.max_step))
            if outcome == "not_finite":
                end = "not_finite"
            elif length > 0.0 or outcome == "event":
                self.time = integrator.time
                step = TaylorStep(
                    start=start,
                    length=length,
                    series=integrator.coefficients,
                    event_count=event_count,
                    switch_signs=switch_signs,
                )
                steps.append(step)
            # Whether and why the run ends. The outcome "limit" means that the step has the
            # largest length that was allowed.
            if outcome == "limit" and not is_shortened:
                end = "time"
            elif outcome == "event":
                end = self._classify_event(integrator)
            elif length < min_step and outcome in ("step", "limit"):
                end = "too_fast"

            is_segment_over = end is not None or len(steps) == STEPS_PER_SEGMENT
            if not has_probes or not (is_shortened or is_segment_over):
                continue
            # The first step that missed a change of a load is discarded, with those after
            # it, and repeated with a smaller length.
            probing = self._probe_steps(integrator, steps[probed_steps:])
            probed_steps += probing.agreeing_steps
            self.max_step = probing.max_next_step
            if probed_steps < len(steps):
                end = None if self.max_step > min_step else "too_fast"
                self._return_to_start(integrator, steps[probed_steps])
                del steps[probed_steps:]
            elif is_shortened and outcome == "limit":
                self.max_step = MAX_TAYLOR_STEP_GROWTH * length
        if steps:
            self._store_segment(steps)
        return end

    def _store_segment(self, steps: Sequence[TaylorStep]) -> None:
        """Store steps as a segment, and update `max_independence`.

        A segment is a part of the simulated motion, from which states at any time are
        evaluated later. `max_independence` is the largest value so far of the measure of
        how independent the loop-closure equations are.

        The segment has three things that the Taylor series of the steps do not contain:
        whole turns of the joint angles, the unit by which the momenta in the series are
        divided, and the work of each load before the segment.
        """
        series = np.array([step.series for step in steps])
        self.segments.append(
            Segment(
                layout=self.layout,
                starts=np.array([step.start for step in steps]),
                lengths=np.array([step.length for step in steps]),
                series=series,
                turns=self.turns,
                momentum_unit=self.momentum_unit,
                work=self.work,
            )
        )
        # The measure of independence of the loop-closure equations is zero where several
        # curves or surfaces of configurations cross. "Nearly zero" is judged relative to
        # its largest value so far. The terms of order 0 are the state at the start of each
        # step.
        start_values = series[:, : self.variable_count, 0]
        independence = self.equation.measure_independence(start_values)
        self.max_independence = max(self.max_independence, float(np.max(independence)))

    def _all_parameters(self, integrator: Integrator) -> Floats:
        """Return all parameters of the compiled equation, in the order of `EquationLayout`.

        The integrator stores the parameters up to the last one that occurs in an
        expression. The other parameters have no effect and are 0.
        """
        parameters = integrator.parameters
        count = self.layout.switch_parameters + len(self.switch_signs)
        return np.pad(parameters, (0, count - len(parameters)))

    def _return_to_start(self, integrator: Integrator, step: TaylorStep) -> None:
        """Set the integrator back to the start of a step."""
        self.time = step.start
        parameters = self._all_parameters(integrator)
        parameters[self.layout.switch_slice] = step.switch_signs
        events_before = integrator.seen_events[: step.event_count]
        integrator.start(step.series[:, 0], self.time, parameters)
        integrator.seen_events.extend(events_before)

    def _probe_steps(
        self, integrator: Integrator, steps: Sequence[TaylorStep]
    ) -> "ProbeResult":
        """Return how many steps agree with the loads, and the longest allowed next step.

        A step agrees if its Taylor series satisfies the equation of motion at further times
        within the step. The first step that does not agree has missed a change of a load.
        This step has to be repeated so that it ends before the change.

        Parameters
        ----------
        integrator
            The integrator, which stores the parameters of the equation.
        steps
            Successive steps that have not been tested yet.
        """
        if not steps:
            return ProbeResult(agreeing_steps=0)
        # Some loads change abruptly where a condition changes its sign. Switch signs are
        # the signs of these conditions. Each step has its own switch signs. All steps have
        # the other parameters of the equation in common.
        parameters = self._all_parameters(integrator)
        common_parameters = parameters[self.layout.common_slice]
        probe = StepProbe(
            equation=self.equation,
            starts=np.array([step.start for step in steps]),
            lengths=np.array([step.length for step in steps]),
            series=np.array([step.series for step in steps]),
            common_parameters=common_parameters,
            switch_signs=np.array([step.switch_signs for step in steps]),
        )
        # For each step, the place of its first error as a fraction of the step; infinity if
        # the step agrees.
        error_fractions = find_first_errors(probe.compare, len(steps))
        for index, error_fraction in enumerate(error_fractions):
            if error_fraction <= 1.0:
                # The repeated step ends before the error. A least length makes the step get
                # past a change of a load right at its start.
                fraction = max(RETRY_FRACTION * error_fraction, MIN_RETRY_FRACTION)
                return ProbeResult(index, float(fraction * steps[index].length))
        return ProbeResult(agreeing_steps=len(steps))

    def _classify_event(self, integrator: Integrator) -> RunEnd:
        """Return the reason why the run ends at the last event."""
        number, _ = integrator.seen_events[-1]
        kind = integrator.events[number].kind
        # A run ends at a switch of a load if there are too many events of any kind, or if
        # the load would switch back at once.
        if kind == "switch":
            has_too_many = len(integrator.seen_events) >= CHATTERING_EVENT_COUNT
            return "too_many" if has_too_many else "sticking"
        return kind if kind in ("coordinates", "joint_limit") else "singularity"

    def _normalise(self, state: Floats) -> None:
        """Change a state so that its numbers stay small and its loops stay closed.

        Errors of a step are relative to the largest number in the state. Whole revolutions
        and work are therefore moved from the state to separate sums, and the unit of
        momentum is adapted. After every `SEGMENTS_PER_CLOSURE` segments (groups of steps)
        the pair variables (joint angles) are also corrected so that the loops are closed.
        The state (states,) is changed in place.
        """
        values = state[: self.variable_count]
        self._reduce_angles(values)
        if self.segments and len(self.segments) % SEGMENTS_PER_CLOSURE == 0:
            values[:], residual = self.project(values)
            self.max_closure_residual = max(self.max_closure_residual, residual)
        self._set_work_aside(state[self.layout.work_slice])
        self._adapt_momentum_unit(state[self.layout.momentum_slice])

    def _renew_parameters(self, integrator: Integrator, interval_end: float) -> None:
        """Set the parameters of the equation for the time from now to `interval_end` (s).

        Torques from tables, for example, are linear in this interval. The integrator itself
        reverses signs of switch conditions (conditions at which a load jumps) during its
        steps. Its present signs are therefore read first and stay as they are.
        """
        present_parameters = self._all_parameters(integrator)
        self.switch_signs = present_parameters[self.layout.switch_slice]
        new_parameters = self._make_parameters(interval_end)
        # The integrator has only the parameters up to the last one that the equation uses.
        used_count = len(integrator.parameters)
        integrator.parameters[:] = new_parameters[:used_count]

    def _reduce_angles(self, values: Floats) -> None:
        """Subtract whole revolutions from angles (variables,) in place, and count them.

        The tolerance is relative to the largest number, so large angles would make the
        others inaccurate. Arc lengths of contacts have no revolutions.
        """
        turns = np.round(values / TURN) * self.is_angle
        values -= turns * TURN
        # The digits of 2 pi beyond float64, without which errors grow with revolutions.
        values -= turns * TURN_ROUNDING
        self.turns = self.turns + turns

    def _set_work_aside(self, works: Floats) -> None:
        """Add the works of the state to a separate sum (J), and set them to 0 in place.

        In the state, momenta are multiples of `momentum_unit` (sqrt(J)), and works are
        multiples of its square (J).

        The tolerance of a step is relative to the largest number in the state. If works
        stayed in the state, a growing work would make the other numbers inaccurate.
        """
        self.work = self.work + works * self.momentum_unit**2
        works[:] = 0.0

    def _adapt_momentum_unit(self, momenta: Floats) -> None:
        """Increase the unit of the momenta of the state, if they exceed 1.

        Errors of a step are relative to the largest number in the state, so momenta must
        not exceed 1, the size of angles in rad. If their norm exceeds 1, the unit is
        multiplied by this norm, and the momenta are changed in place. The unit never
        shrinks, since works in multiples of the square of a tiny unit would be large.
        """
        size = float(np.linalg.norm(momenta))
        if size > 1.0:
            self.momentum_unit *= size
            momenta /= size

    def _make_parameters(self, interval_end: float) -> Floats:
        """Return the parameters of the equation from now to the time `interval_end` (s).

        Parameters are numbers in the compiled equation that are constant in this interval,
        such as joint limits and value and slope of torque tables. `EquationLayout` defines
        their order.
        """
        # Torque tables are linear in time during the interval.
        table_parameters = [self.time]
        for table in self.tables:
            # Value at this time, and slope, of the table.
            table_parameters += _linear_piece(table, self.time, interval_end)
        return np.array(
            [
                *self.turns,  # whole turns that were subtracted from each joint angle
                # The state has the momenta divided by this unit. The equation multiplies
                # some terms by the unit and others by its reciprocal.
                self.momentum_unit,
                1.0 / self.momentum_unit,
                self.min_independence,  # below this, closure equations count as dependent
                *self.limit_values,  # of the joint limits
                *table_parameters,
                # The signs, 1 or -1, of conditions. A load changes abruptly where a
                # condition changes its sign.
                *self.switch_signs,
            ]
        )

    def _set_switch_signs(self, interval_end: float) -> None:
        """Compute the signs of the switch conditions at the start of the motion.

        A load changes abruptly at a zero of its switch condition, such as dry friction
        where the sliding rate is zero. The signs of the conditions are parameters of the
        equation of motion. During the motion the integrator reverses them. A condition may
        depend on the signs of the conditions before it, so the signs are computed one after
        the other.

        Parameters
        ----------
        interval_end
            Time (s) of the next knot (listed time) of a torque table. Up to this time the
            torque is linear in time. Its slope is one of the parameters of the equation.
        """
        switch_function = self.equation.switch_function
        if switch_function is None:
            return
        count = len(self.switch_signs)
        for k in range(count):
            # The parameters include the signs of conditions 0 to k - 1.
            parameters = self._make_parameters(interval_end)
            inputs = np.concatenate([self.start_state, [self.time], parameters])
            # All conditions, then their time derivatives.
            outputs = switch_function(inputs[:, None])[:, 0]
            self.switch_signs[k] = _choose_sign(
                condition=outputs[k], condition_rate=outputs[count + k]
            )


@dataclass(frozen=True)
class ProbeResult:
    """How many successive steps agree with loads that may change abruptly.

    Attributes
    ----------
    agreeing_steps
        Number of steps, from the first one, that agree with the loads.
    max_next_step
        Longest length (s) of the next step; infinite if all steps agree.
    """

    agreeing_steps: int
    max_next_step: float = np.inf


def _list_events(
    integrator: Integrator,
) -> Iterator[tuple[float, IntegrationEventKind, int]]:
    """Yield time (s), kind and pair variable of each event that an integrator has seen."""
    for number, time in integrator.seen_events:
        event = integrator.events[number]
        yield time, event.kind, event.variable


def _linear_piece(table: TorqueTable, start: float, end: float) -> tuple[float, float]:
    """Return value at the start, and slope, of a torque table, linear in an interval.

    The table is read inside the interval, at 1/4 and 3/4 of it. The ends are rounded, so
    they can lie outside the table or in the next piece of it.

    Parameters
    ----------
    table
        The torque table.
    start, end
        An interval of time (s) without knots of the table inside it.
    """
    duration = end - start
    early, late = table.at(start + duration * np.array([0.25, 0.75]))
    value_at_start = 1.5 * early - 0.5 * late
    slope = 2.0 * (late - early) / duration
    return value_at_start, slope


def _choose_sign(condition: float, condition_rate: float) -> float:
    """Return the sign (1 or -1) of a switch condition at the start of a motion.

    A load jumps where its switch condition changes its sign. If the condition is zero, its
    sign right after the start is the sign of its rate. The sign is positive if the rate is
    zero too.
    """
    if condition != 0.0:
        return float(np.sign(condition))
    if condition_rate != 0.0:
        return float(np.sign(condition_rate))
    return 1.0
