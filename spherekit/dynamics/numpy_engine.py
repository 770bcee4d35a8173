"""Simulates motions by Gauss collocation with NumPy, for all loads and mechanisms.

Steps are few and long. The equations of a step are solved by Picard iteration: the rates
are evaluated at all nodes in one call, which takes little longer than a call for one node.
The error is estimated from the last Legendre coefficients of the rates.

`spherekit.dynamics.collocation_step` has the steps and their zeros. Determinants are those
of `CollocationStep.closure_determinants` at the nodes of a step. The matrix is the Jacobian
of the loop-closure equations, with the rates of the pair variables per unit rate of each
coordinate as further rows. Its determinant changes sign where curves of configurations
cross.
"""

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.dynamics.collocation_step import (
    GAUSS_NODES,
    INTEGRATION_MATRIX,
    NODE_COUNT,
    SERIES_MATRIX,
    ClosureDeterminantRecord,
    CollocationStep,
)
from spherekit.dynamics.coordinates import reciprocal_condition
from spherekit.dynamics.equation_of_motion import StateDynamics
from spherekit.dynamics.inertia import inertia_matrix
from spherekit.dynamics.simulated_path import StatePath, make_collocation_path
from spherekit.dynamics.simulation import (
    EngineReport,
    Event,
    EventKind,
    Forecast,
    Simulation,
)
from spherekit.dynamics.simulation_end import (
    CROSSING_MESSAGE,
    JUMP_MESSAGE,
    LOCKING_MESSAGE,
    NOISE_MESSAGE,
    TIME_MESSAGE,
    EndKind,
    SimulationEnd,
    joint_limit_end,
    make_start_error,
    no_step_end,
    too_many_steps_message,
)
from spherekit.dynamics.simulation_start import Problem, variable_of
from spherekit.dynamics.step_probes import find_first_errors
from spherekit.dynamics.taylor_integration import CROSSING_RATIO, MIN_STEP_FRACTION
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.progress import ProgressReporter
from spherekit.status import STATUS_MEANING, Status
from spherekit.tolerances import EPS

FIRST_STEP_ARC = 0.1
"""Arc (rad) along which the first step is meant to lead.

Larger: the first step is rejected more often. Smaller: more steps at the start.
"""

MAX_CROSSING_TOLERANCE_RAD = 0.1 * CROSSING_RATIO**2
"""Largest tolerance of a step that passes near a crossing of curves, or reaches one.

A configuration off its curve by d misses a crossing by sqrt(d). If that is not less than
`CROSSING_RATIO`, curves that pass each other cannot be distinguished from some that cross.
Larger: crossings are missed. Smaller: more steps near crossings.
"""

MAX_COLLOCATION_STEPS = 100_000
"""Steps after which a simulation ends."""

MAX_STEP_ITERATIONS = 40
"""Iterations of a step after which it is rejected."""

MANY_ITERATIONS = 24
"""Iterations above which the next step is shortened.

The number of iterations grows faster than the step. Larger: steps that converge slowly are
kept. Smaller: more steps.
"""

SLOPE_ITERATIONS = (1, 4, 9)
"""Iterations of a step in which Newton's method for a stiff momentum computes its slope.

More: each step takes longer. Fewer: it converges more slowly if the slope changes.
"""

MOMENTUM_DIFFERENCE = 1e-7
"""Step of the difference quotient for the slope of a stiff momentum, relative to its size.

Larger: the slope has a larger truncation error. Smaller: a larger rounding error.
"""

CONTINUED_COEFFICIENTS = 12
"""Number of Legendre coefficients of a step that give the first guess of the next step.

More: high orders grow beyond the step. Fewer: more iterations.
"""

STEP_SAFETY = 0.8
"""Factor of the step that the error estimate allows.

Larger: more steps are rejected. Smaller: more steps.
"""

MAX_STEP_GROWTH = 1.4
"""Largest factor by which a step changes the length that is tried next."""

MIN_STEP_SHRINKAGE = 0.35
"""Smallest factor by which an accepted or rejected step changes the length tried next."""

NOISE_RATIO = 0.2
"""Ratio of the last coefficients to the largest later one from which they are noise.

The coefficients of smooth rates fall. Larger: noise is not noticed, and steps become short.
Smaller: slowly falling coefficients are taken for noise.
"""

MAX_NOISY_STEPS = 50
"""Short noisy steps in a row after which a simulation ends."""

NOISY_STEP_FRACTION = 1e-4
"""Length of a step, relative to the whole time, below which a noisy step is short."""

ERROR_DIVISOR = 4 * NODE_COUNT - 2
"""The error of a step is the length of the step times its last coefficients, divided by
this number.

The integral of the Legendre polynomial of order k is the difference of two others, divided
by 2 k + 1. The last coefficient has k = N - 1. The interval [-1, 1] of the polynomials has
the length 2, so the integral over a step has the additional factor length / 2.
"""

MAX_PROBE_ERROR_RATIO = 1.0
"""Largest error at a probe within a step, relative to the error that the step may have.

Larger: abrupt changes of loads are missed. Smaller: accurate steps are rejected.
"""

LAST_COEFFICIENTS = 3
"""Number of last coefficients of a series by which errors and noise are judged.

More: errors are overestimated. Fewer: coefficients that vanish by symmetry hide errors.
"""

FINAL_STEP_RATIO = 1.05
"""Longest rest of an interval, relative to the next step, that is done in one step.

Larger: last steps are rejected more often. Smaller: very short last steps.
"""

CONVERGED_RATIO = 0.05
"""Change of the states in an iteration, relative to the tolerance, at which it has
converged. Larger: the error of the iteration adds to that of the step."""

DIVERGENCE_RATIO = 4.0
"""Growth of the changes from one iteration to the next at which a step is rejected, after
`FREE_ITERATIONS`. Larger: diverging iterations take longer."""

MIN_CONVERGED_CHANGE = 8 * EPS
"""Smallest change of the states in an iteration, relative to their sizes, that is required
for convergence. Smaller: rounding errors prevent convergence."""

MAX_ROUNDING_CHANGE = 64 * EPS
"""Largest change of the states that may be rounding, if changes no longer fall and the
tolerance is smaller. Larger: slowly converging iterations are accepted."""

FREE_ITERATIONS = 4
"""Number of iterations in which changes may grow by any factor."""

MIN_CROSSING_CONDITION = 1e-5
"""Reciprocal condition number of the closure equations below which a simulation that cannot
continue is at a crossing of curves.

A crossing that a simulation passes needs the same. Larger: other ends and places count as
crossings.
"""

MAX_VARIABLE_RATE = 1.5
"""Largest rate of all pair variables per unit rate of a coordinate before the
coordinates are replaced by new ones, for which it is 1.

Larger: coordinates are used nearer to their singularities. Smaller: coordinates are
replaced more often.
"""

FORECAST_STEPS = 4
"""Number of last steps whose computing time gives an estimate for the remaining ones."""

END_BY_STATUS: dict[Status, tuple[EndKind, str]] = {
    Status.OFF_PROFILE: ("off_profile", STATUS_MEANING[Status.OFF_PROFILE]),
    Status.CURVATURE: ("curvature", STATUS_MEANING[Status.CURVATURE]),
    Status.NOT_CONVERGED: ("locking", LOCKING_MESSAGE),
}
"""Kind and message of the end of a simulation, by the status of a configuration that has
no rates."""


class StepEvent(NamedTuple):
    """An event within an integration step, such as a joint limit or a moment of rest.

    Attributes
    ----------
    t
        Time, s.
    kind
        Kind of the event. Where two curves of configurations cross, it is "crossing" if the
        simulation passes crossings, and "singularity" if it ends there.
    pair
        The pair (joint) to which the event belongs, empty if there is none.
    """

    t: float
    kind: EventKind | Literal["singularity"]
    pair: str = ""


class Collocation:
    """Integrates the equation of motion by Gauss collocation, step by step.

    A state (states,) has the pair variables (rad), the momenta and the work of each load.

    Attributes
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    equation
        The equation of motion.
    tolerance
        The tolerance of the pair variables, rad.
    rate_weights
        (m, variables) weights that define m coordinates at the end of the last step. The
        rate of coordinate i is the sum of the rates of the pair variables with the weights
        of row i. Each momentum belongs to one coordinate. With one degree of freedom, the
        only row is the unit tangent of the configuration curve.
    steps
        The accepted steps.
    events
        The events in these steps.
    start_state
        (states,) the state at the start.
    scales
        (states,) smallest sizes by which errors of the state are divided: 1 rad for
        variables, and the momentum and twice the energy at unit speed.
    determinant_record
        Size and sign, after the last step, of the determinant whose sign changes where
        curves of configurations cross.
    is_near_crossing
        Whether a crossing may be near at which the simulation would end: a singularity in
        which two curves of configurations intersect. Steps are then made with a tolerance
        of at most `MAX_CROSSING_TOLERANCE_RAD`.
    max_closure_residual
        Largest closure residual that was removed between steps, rad.
    noisy_steps
        Number of short noisy steps one after the other.
    end
        Time and reason of the end, or None while the integration continues.
    """

    def __init__(self, problem: Problem, tolerance: float) -> None:
        """Prepare the first step of the integration.

        Parameters
        ----------
        problem
            The mechanism with its loads, and the start of the motion.
        tolerance
            Tolerance of the pair variables (joint angles), rad.
        """
        self.problem = problem
        self.equation = equation = problem.equation
        self.tolerance = tolerance
        # (m, variables) weights that define the m coordinates of the motion, one for each
        # degree of freedom. The rate of coordinate i is the sum of the rates of all pair
        # variables with the weights of row i.
        self.rate_weights = problem.rate_weights
        self.steps: list[CollocationStep] = []
        self.events: list[Event] = []
        self.start_state = equation.make_state(
            problem.values, problem.speed, problem.rate_weights
        )
        self.scales = _make_state_scales(problem, len(self.start_state))
        # The closure determinant changes its sign where two curves of configurations cross.
        # The record finds such a crossing.
        self.determinant_record = ClosureDeterminantRecord()
        # True after a step in which the curve may cross another one. The simulation may
        # have to end there, so steps are then more accurate.
        self.is_near_crossing = False
        self.max_closure_residual = 0.0
        # Number of successive short steps in which rounding errors dominate the rates. The
        # simulation ends when the number is `MAX_NOISY_STEPS`.
        self.noisy_steps = 0
        self.end: SimulationEnd | None = None
        # A generator, from which `advance` takes one step after the other.
        self._integration = self._integrate()
        self._progress = ProgressReporter("simulating")
        # Time of the simulation and computing time after each step, s.
        self._progress_times: list[tuple[float, float]] = [(0.0, 0.0)]

    def advance(self) -> bool:
        """Compute the next step, if there is one, and return whether `end` is still None.

        The method also reports progress, and sets `end` when the integration ends.
        """
        started = time.perf_counter()
        # Steps with numbers that are not finite are rejected, so NumPy need not warn.
        with np.errstate(all="ignore"):
            try:
                t = next(self._integration)
            except StopIteration as stopped:
                # The generator returns the `SimulationEnd`: reason and time of the end.
                self.end = stopped.value
                t = self.reached
        # The remaining computing time is estimated from the computing time (s) up to each
        # time t of the simulation.
        computing_time = self.seconds + time.perf_counter() - started
        self._progress_times.append((t, computing_time))
        # The text is only formed if a report is due.
        is_due = self._progress.report_if_due(
            lambda: f"{t:.4g} of {self.problem.until:.6g} s",
            done=t,
            total=self.problem.until,
        )
        if is_due and self.end is None and self.problem.on_progress:
            # Show the motion so far. A simulation also states why its engine was chosen.
            # This text is not shown here, so any text can be given.
            self.problem.on_progress(self.simulation(reason="it goes on"))
        return self.end is None

    @property
    def remaining_seconds(self) -> float | None:
        """Computing time (s) that the rest of the simulation is expected to need.

        This time is extrapolated from the last `FORECAST_STEPS` steps. It is None until
        there are more steps than `FORECAST_STEPS`.
        """
        if len(self._progress_times) <= FORECAST_STEPS + 1:
            return None
        earlier_time, earlier_seconds = self._progress_times[-FORECAST_STEPS - 1]
        pace = (self.seconds - earlier_seconds) / (self.reached - earlier_time)
        return (self.problem.until - self.reached) * pace

    @property
    def seconds(self) -> float:
        """Computing time so far, s."""
        _, seconds = self._progress_times[-1]
        return seconds

    @property
    def reached(self) -> float:
        """The time (s) that the simulation has reached."""
        t, _ = self._progress_times[-1]
        return t

    def simulation(self, reason: str, forecast: Forecast | None = None) -> Simulation:
        """Return the motion up to the last accepted step, as a simulation.

        The method may be called while the integration continues, to show the motion so far.

        Parameters
        ----------
        reason
            The reason why this engine was chosen, in words.
        forecast
            The expected computing times by which the engine was chosen, or None.

        Raises
        ------
        SolveError
            If there is not even a first step.
        """
        # While the integration continues, the time reached so far counts as the end.
        unfinished = SimulationEnd("time", self.reached, "it goes on")
        end = self.end or unfinished
        if not self.steps:
            raise make_start_error(self.problem, end.message)
        return Simulation(
            equation=self.equation,
            driven=self.problem.driven,
            path=self._make_path(),
            events=tuple(self.events),
            end=end,
            engine=EngineReport(
                name="numpy",
                reason=reason,
                compile_seconds=0.0,
                seconds=self.seconds,
                steps=len(self.steps),
                forecast=forecast,
            ),
            tolerance=self.tolerance,
        )

    def _make_path(self) -> StatePath:
        """Return the path of all accepted steps."""
        return make_collocation_path(
            self.steps, self.problem.turns, self.max_closure_residual
        )

    def _integrate(self) -> Generator[float, None, SimulationEnd]:
        """Take all steps, yield the time (s) after each whole step, and return the end.

        A step is accepted if its error is at most the tolerance. If not, a shorter step
        from the same state is tried.
        """
        problem = self.problem
        equation = self.equation
        t = 0.0
        state = self.start_state
        previous: CollocationStep | None = None
        length = self._choose_first_length()
        # Loads may have kinks at the targets, so no step leads across one.
        for target in problem.targets:
            while t < target:
                rest = target - t
                tried = rest if rest < FINAL_STEP_RATIO * length else length
                attempt = self._attempt_step(
                    start=t, length=tried, state=state, previous=previous
                )
                step = attempt.step
                error = attempt.error
                rates = attempt.dynamics.motion.rates
                if error <= 1.0:
                    # (N,) closure determinant at each node. It changes its sign where
                    # curves of configurations cross.
                    determinants = step.closure_determinants(equation.closure, rates)
                    if not self._stays_on_set(step, determinants):
                        error = np.inf
                if error > 1.0:
                    # The step is rejected. The next one has at most half its length.
                    length = min(_length_factor(error, attempt.iterations), 0.5) * tried
                    if length < MIN_STEP_FRACTION * problem.until:
                        return self._diagnose_failure(step, error, attempt.dynamics)
                    continue
                # Where a crossing comes near, the same step is repeated once. While
                # `is_near_crossing` is set, steps have a smaller tolerance.
                was_near_crossing = self.is_near_crossing
                self.is_near_crossing = self._may_end_at_crossing(determinants)
                comes_near_crossing = self.is_near_crossing and not was_near_crossing
                if comes_near_crossing and self.tolerance > MAX_CROSSING_TOLERANCE_RAD:
                    continue
                if len(self.steps) >= MAX_COLLOCATION_STEPS:
                    message = too_many_steps_message(MAX_COLLOCATION_STEPS)
                    return SimulationEnd("too_fast", t, message)
                is_noisy = self._is_noisy(step)
                # A step that was fitted to the target does not change the length.
                if tried == length or tried < rest:
                    # A shorter step would have as much noise, so noise counts as no error.
                    effective_error = EPS if is_noisy else error
                    length = _length_factor(effective_error, attempt.iterations) * tried
                is_short = tried < NOISY_STEP_FRACTION * problem.until
                self.noisy_steps = self.noisy_steps + 1 if is_noisy and is_short else 0
                if self.noisy_steps == MAX_NOISY_STEPS:
                    return SimulationEnd("too_fast", t, NOISE_MESSAGE)
                end = self._accept(step, rates, determinants)
                if end is not None:
                    return end
                t = target if tried == rest else step.stop
                state, previous = self._prepare_next_step(step, rates)
                yield t
            if t < problem.until:
                self._record_event("switch", t, self.steps[-1])
                previous = None
        return SimulationEnd("time", problem.until, TIME_MESSAGE)

    def _prepare_next_step(
        self, step: CollocationStep, rates: Floats
    ) -> tuple[Floats, CollocationStep | None]:
        """Return the state at which the next step starts, and the step that it continues.

        The method also updates `rate_weights`, which defines the coordinates of the motion:

        - With one degree of freedom, the only coordinate is the arc length of the curve of
          configurations. `rate_weights` is set to the unit tangent at the end of the step.
          The next step needs the tangent, because it shows in which direction the arc
          length increases.
        - With several degrees of freedom, the rate of a coordinate is a weighted sum of the
          rates of the pair variables (joint angles). `rate_weights` has the weights. New
          weights replace them before the coordinates become nearly dependent.

        Parameters
        ----------
        step
            The accepted step.
        rates
            (N, m, variables) derivatives of the pair variables with respect to the m
            coordinates, at the N nodes (times at which the step evaluates the equations).

        Returns
        -------
        state
            (states,) the state at the end of the step, corrected so that all loops close.
        previous
            The accepted step. Its polynomial gives the first guess of the next step. None
            if the coordinates were replaced, because the polynomial belongs to the old
            coordinates.
        """
        state = self._close(step.end_state)
        last_rates = rates[-1]  # at the last node, near the end of the step
        if self.equation.freedoms == 1:
            self.rate_weights = last_rates
        elif np.linalg.norm(last_rates, 2) > MAX_VARIABLE_RATE:
            # The pair variables move fast compared with the coordinates, so the coordinates
            # are nearly dependent.
            state, self.rate_weights = self.equation.renew_coordinates(
                state, self.rate_weights
            )
            return state, None
        return state, step

    def _choose_first_length(self) -> float:
        """Return the length (s) of the first step, from speed and acceleration.

        The length is chosen so that the mechanism moves by about `FIRST_STEP_ARC` in the
        step. The length is the smallest of FIRST_STEP_ARC / speed, sqrt(FIRST_STEP_ARC /
        acceleration) and 1 s, but at most the duration of the simulation, and at least
        `MIN_STEP_FRACTION` times this duration.
        """
        until = self.problem.until
        dynamics = self._evaluate_dynamics(np.zeros(1), self.start_state[None])
        # The rates u of all coordinates.
        speed = float(np.linalg.norm(dynamics.speed))
        # Momenta are p = R u with the symmetric root R of the inertia matrix. If R is taken
        # as constant, dp/dt = R du/dt. So the acceleration du/dt is about R^-1 dp/dt.
        acceleration = float(np.linalg.norm(dynamics.roots.solve(dynamics.momentum_rates)))
        inverse_length = max(
            speed / FIRST_STEP_ARC, (acceleration / FIRST_STEP_ARC) ** 0.5, 1.0
        )
        return max(min(until, 1.0 / inverse_length), MIN_STEP_FRACTION * until)

    def _evaluate_dynamics(self, t: Floats, states: Floats) -> StateDynamics:
        """Return motion and forces at times (n,) and states (n, states).

        A state has the pair variables (rad), then the momenta of the coordinates, then the
        works of the loads. Callers compute the rates of the states, or those of single
        quantities, from the result.

        A simulation may pass crossings of curves of configurations. Near a crossing,
        slightly open loops change the rates of the variables by large amounts. In such a
        simulation the loops are therefore closed first.
        """
        equation = self.equation
        variables = self.equation.variable_count
        if self.problem.passes_crossings and all_finite(states):
            closed = equation.project(states[:, :variables])
            states = np.concatenate([closed, states[:, variables:]], axis=1)
        # `rate_weights` says to which coordinates the momenta belong, see
        # `_prepare_next_step`. At the start, whole turns were subtracted from the
        # variables. Loads such as springs may depend on these turns, so they are passed as
        # `turn_angles` (rad).
        return equation.evaluate(t, states, self.rate_weights, self.problem.turn_angles)

    def _close(self, state: Floats) -> Floats:
        """Return the state (states,) after one Newton step that closes the loops of links.

        Integration errors open the loops a little. The closure residual before the step is
        recorded in `max_closure_residual`.
        """
        variables = self.equation.variable_count
        values, closure_residual = self.equation.project_once(state[:variables])
        self.max_closure_residual = max(self.max_closure_residual, closure_residual)
        return np.concatenate([values, state[variables:]])

    def _attempt_step(
        self,
        start: float,
        length: float,
        state: Floats,
        previous: CollocationStep | None,
    ) -> "StepAttempt":
        """Solve the equations of a step by iteration, and estimate the error of the step.

        Nodes are N times within the step. The states at the nodes are the state at the
        start plus the integral of the polynomial through the rates at the nodes, and the
        rates follow from the states. States and rates are computed in turn until the states
        no longer change (Picard iteration).

        Parameters
        ----------
        start, length
            Time at the start, and length, s.
        state
            (states,) state at the start.
        previous
            The step that ends at `start`. Its series is continued as the first guess of
            the iteration. None if there is none to continue, see `_guess_rates`.
        """
        equation = self.equation
        t = start + 0.5 * length * (GAUSS_NODES + 1.0)
        scale = np.maximum(self.scales, np.abs(state))
        # Loads that change abruptly make the momentum stiff: Picard iteration diverges
        # unless steps are tiny. Newton's method then corrects a single momentum.
        is_stiff = equation.freedoms == 1 and equation.loads.needs_step_probes
        # Position of the momentum in the state.
        momentum = equation.variable_count
        rates = self._guess_rates(t, start, state, previous)
        integration = 0.5 * length * INTEGRATION_MATRIX
        states = state + integration @ rates
        tolerance = self.tolerance
        if self.is_near_crossing:
            tolerance = min(tolerance, MAX_CROSSING_TOLERANCE_RAD)
        converged_change = max(CONVERGED_RATIO * tolerance, MIN_CONVERGED_CHANGE)
        change = np.inf
        error = np.inf
        has_converged = False
        for iterations in range(1, MAX_STEP_ITERATIONS + 1):
            last_change = change
            dynamics = self._evaluate_dynamics(t, states)
            rates = equation.state_rates(dynamics)
            new_states = state + integration @ rates
            if is_stiff:
                if iterations in SLOPE_ITERATIONS:
                    slopes = self._momentum_rate_slopes(t, states, rates, scale)
                    inverse = _momentum_newton_matrix(slopes, length)
                residual = (new_states - states)[:, momentum]
                new_states[:, momentum] = states[:, momentum] + inverse @ residual
            change = float(max_abs((new_states - states) / scale))
            states = new_states
            is_diverging = (
                iterations > FREE_ITERATIONS and change > DIVERGENCE_RATIO * last_change
            )
            if not np.isfinite(change) or is_diverging:
                break
            # Changes that no longer fall are rounding errors, if they are small enough.
            is_rounding = last_change <= change < max(tolerance, MAX_ROUNDING_CHANGE)
            if change < converged_change or is_rounding:
                has_converged = True
                break
        step = CollocationStep(
            start=start,
            length=length,
            state=state,
            series=SERIES_MATRIX @ rates,
            rate_weights=dynamics.motion.rates
            if equation.freedoms == 1
            else self.rate_weights[None],
        )
        # The error stays infinite if the iteration failed or a node has no rates.
        if has_converged and np.all(dynamics.motion.status == Status.OK):
            error = float(np.max(_truncation_errors(step) / scale)) / tolerance
        if error <= 1.0 and not self._passes_probes(step, scale, tolerance):
            error = np.inf
        return StepAttempt(step=step, error=error, iterations=iterations, dynamics=dynamics)

    def _guess_rates(
        self, t: Floats, start: float, state: Floats, previous: CollocationStep | None
    ) -> Floats:
        """Return a first guess of the state's rates (N, states) at the nodes of a step.

        The iteration for the step starts with the guess. The guess continues the polynomial
        of the step before, which is a Legendre series of the rates. Polynomials of high
        order grow fast outside of their step, so only the first coefficients are used.
        Without a step before, the guess is the rate at the start, at all nodes.

        Parameters
        ----------
        t
            (N,) times of the nodes (at which the step evaluates the equations), s.
        start
            Time at the start of the step, s.
        state
            (states,) state at the start.
        previous
            The step before. None in the first step, and if its polynomial does not
            continue: after a kink of a load, or in new coordinates.
        """
        if previous is None:
            dynamics = self._evaluate_dynamics(np.array([start]), state[None])
            return np.repeat(self.equation.state_rates(dynamics), NODE_COUNT, axis=0)
        coefficients_of_low_orders = previous.series[:CONTINUED_COEFFICIENTS]
        return previous.evaluate_series(coefficients_of_low_orders, t)

    def _momentum_rate_slopes(
        self, t: Floats, states: Floats, rates: Floats, scale: Floats
    ) -> Floats:
        """Return the derivative (N,) of dp/dt with respect to the momentum p, at N nodes.

        Newton's method uses it where abrupt changes of loads make the momentum stiff. There
        is one degree of freedom, so a state has a single momentum p. The derivative is a
        difference quotient, or 0 where this quotient is not finite.

        Parameters
        ----------
        t
            (N,) times of the nodes (at which the step evaluates the equations), s.
        states, rates
            (N, states) states at the nodes and their time derivatives.
        scale
            (states,) sizes of the quantities in a state.
        """
        # A state has the pair variables, then the momentum, then the works of the loads.
        momentum_column = self.equation.variable_count

        difference = MOMENTUM_DIFFERENCE * scale[momentum_column]
        shifted_states = states.copy()
        shifted_states[:, momentum_column] += difference
        shifted_rates = self.equation.state_rates(
            self._evaluate_dynamics(t, shifted_states)
        )
        slopes = (shifted_rates - rates)[:, momentum_column] / difference
        slopes[~np.isfinite(slopes)] = 0.0
        return slopes

    def _passes_probes(
        self, step: CollocationStep, scale: Floats, tolerance: float
    ) -> bool:
        """Return whether the loads within a step agree with the polynomial of the step.

        The polynomial describes the rates of the state as functions of time. It is fitted
        at the nodes only. A load that changes abruptly between two nodes would not be
        noticed. At further times (probes), the rates of the momenta from the polynomial are
        therefore compared with those from the loads. A step that does not pass is rejected.

        Parameters
        ----------
        step
            A step whose iteration has converged.
        scale
            (states,) sizes of the quantities in a state, relative to which errors are
            judged.
        tolerance
            Tolerance of the step, rad.
        """
        equation = self.equation
        # Only some loads can change abruptly, such as tanh(1000 x) near x = 0.
        if not equation.loads.needs_step_probes:
            return True
        allowed_rate_error = _allowed_momentum_rate_error(
            tolerance,
            momentum_size=float(np.max(scale[equation.momenta])),
            length=step.length,
        )

        # `find_first_errors` can examine several steps at once. There is only one step
        # here, so the index of the step is not used.
        def probe(_: Indices, fractions: Floats) -> tuple[Floats, Floats]:
            """Return errors of the rates at n places of the step, not only at nodes.

            The first result (n,) is the error as a multiple of the allowed error. The
            second result (n, k) has the arguments of steep functions, such as x in
            tanh(1000 x). A load changes fast where an argument is nearly 0.
            """
            rate_errors, steep_arguments = self._probe_step(step, fractions)
            return np.max(rate_errors, axis=1) / allowed_rate_error, steep_arguments

        # Place of the first large error as a fraction of the step; infinity if there is
        # none.
        (first_error_fraction,) = find_first_errors(probe, step_count=1)
        return bool(np.isinf(first_error_fraction))

    def _probe_step(
        self, step: CollocationStep, fractions: Floats
    ) -> tuple[Floats, Floats]:
        """Compare two values of the rates of the momenta at some times within a step.

        The first value is that of the polynomial of the step, which was fitted to the rates
        at its nodes. The second value is computed from the loads at the times (probes). The
        values differ if a load changes abruptly between two nodes. The caller then rejects
        the step. The returned arguments show the caller where further probes are needed.

        Parameters
        ----------
        step
            The step.
        fractions
            (n,) times of the probes, from 0 at the start of the step to 1 at its end.

        Returns
        -------
        rate_errors
            (n, m) absolute differences of the rates of the m momenta.
        steep_arguments
            (n, k) arguments x of functions such as sign(x) or tanh(1000 x) in the loads. A
            load with this function may change abruptly where x passes or nearly touches 0.
            The caller searches for zeros and extrema of x: at an extremum x can touch 0.
        """
        equation = self.equation
        t = step.start + fractions * step.length
        states = step.evaluate_state(t)
        # The rate of a coordinate is a weighted sum of the rates of the pair variables. A
        # state has a momentum for each coordinate, so `evaluate` needs the weights.
        rate_weights = self._find_rate_weights(step, fractions)
        # A load, such as a spring, may depend on whole turns of an angle. The angles in
        # states lack these turns, so they are passed as well (rad).
        whole_turns = self.problem.turn_angles
        dynamics = equation.evaluate(t, states, rate_weights, whole_turns)
        fitted_rates = step.evaluate_rate(t)[:, equation.momenta]
        rate_errors = np.abs(dynamics.momentum_rates - fitted_rates)
        steep_arguments = equation.loads.evaluate_laws(
            equation.loads.steep_arguments, dynamics.motion, dynamics.speed, t
        )
        return rate_errors, steep_arguments

    def _find_rate_weights(self, step: CollocationStep, fractions: Floats) -> Floats:
        """Return the weights that define the coordinates at times within a step.

        The rate of coordinate i is the sum of the rates of the pair variables (joint
        angles), multiplied by the weights of row i. Each momentum in a state belongs to one
        coordinate, so `EquationOfMotion.evaluate` needs the weights. With several degrees
        of freedom, the weights are the same in the whole step.

        With one degree of freedom, the coordinate is the arc length of the curve of
        configurations, and the weights are the unit tangent of this curve. `evaluate` then
        computes the exact tangent itself. From the weights it only takes in which of the
        two directions the arc length increases. So the tangent at the nearest node of the
        step is accurate enough.

        Parameters
        ----------
        step
            The step.
        fractions
            (n,) times from 0 at the start of the step to 1 at its end.

        Returns
        -------
        (m, variables) with m > 1 degrees of freedom, (n, 1, variables) with one.
        """
        if self.equation.freedoms > 1:
            return self.rate_weights
        # The nodes `GAUSS_NODES` are times in [-1, 1], from start to end of a step.
        times = 2.0 * fractions[:, None] - 1.0
        nearest_nodes = np.argmin(np.abs(times - GAUSS_NODES), axis=1)
        return step.rate_weights[nearest_nodes]

    def _is_noisy(self, step: CollocationStep) -> bool:
        """Return whether the rates in a step are dominated by rounding errors (noise).

        The Legendre coefficients of smooth rates fall with their order. The last
        coefficients are noise if they are not much smaller than the largest of the last two
        thirds. Shorter steps would not reduce such an error.
        """
        sizes = max_abs(step.series[NODE_COUNT // 3 :] / self.scales, axis=1)
        largest_last = np.max(sizes[-LAST_COEFFICIENTS:])
        return bool(largest_last > NOISE_RATIO * np.max(sizes))

    def _stays_on_set(self, step: CollocationStep, determinants: Floats) -> bool:
        """Return whether a step stays on one set of configurations near a crossing.

        A set of configurations is a curve, or a surface if there are several degrees of
        freedom. Where two sets come near each other, a long step could change from one to
        the other. The step may pass through one crossing, but must end away from this
        crossing. Only a simulation that passes crossings needs the test.

        Parameters
        ----------
        step
            The step.
        determinants
            (N,) closure determinants at its nodes, the times at which the equations are
            evaluated. The determinant is zero and changes its sign at a crossing.
        """
        if not self.problem.passes_crossings:
            return True
        # The record has the sign of the determinant before the step, and its largest
        # absolute value so far.
        record = self.determinant_record.include_sizes(determinants)
        is_near = np.abs(determinants) < CROSSING_RATIO * record.largest
        has_other_sign = determinants * record.sign < 0.0
        if not np.any(has_other_sign):
            # The step does not pass a crossing, so it has to stay away from all of them.
            # Near a crossing it could change to the other set without a change of sign.
            return not np.any(is_near)
        ends_near_crossing = np.any(is_near[-2:])  # at one of the last two nodes
        crossing_time = step.find_crossing(determinants, record)
        if ends_near_crossing or crossing_time is None:
            return False
        # The sign can also change because the step has jumped to another set that is near.
        return self._is_true_crossing(step, crossing_time)

    def _is_true_crossing(self, step: CollocationStep, t: float) -> bool:
        """Return whether two sets of configurations truly cross at a time of a step.

        A set of configurations is a curve, or a surface if there are several degrees of
        freedom. In the step, the closure determinant changes its sign. Either the motion
        passes a crossing of two sets, where the loops are closed and the closure equations
        are singular. Or two sets only come near each other, and the step has changed from
        one to the other. Between them it passes points at which the loops are open and the
        closure equations are regular. The caller rejects a step of this second kind.

        Parameters
        ----------
        step
            The step.
        t
            The time (s) at which the determinant is zero.
        """
        equation = self.equation
        values = step.evaluate_state(np.array([t]))[0, : equation.variable_count]
        (closure_residual,) = equation.closure.linearise(values[None]).closure_residual
        condition = reciprocal_condition(equation.closure, values, equation.freedoms)
        is_closed = closure_residual < MAX_CROSSING_TOLERANCE_RAD
        is_singular = condition < MIN_CROSSING_CONDITION
        return bool(is_closed and is_singular)

    def _may_end_at_crossing(self, determinants: Floats) -> bool:
        """Return whether a step may contain a crossing at which the simulation would end.

        At a crossing, two curves of configurations intersect. If the step may contain one,
        the caller computes this step and the next ones with a tolerance of at most
        `MAX_CROSSING_TOLERANCE_RAD`. The result is False if the simulation passes
        crossings.

        The closure determinant is zero at a crossing. The computed path has errors, so it
        can miss the crossing. Its determinants there are small, but not zero. A path with
        the error e misses the crossing by about sqrt(e). A determinant is therefore small
        if it is less than sqrt(e) times the largest one so far. e is the tolerance.

        Parameters
        ----------
        determinants
            (N,) closure determinant at each node of the step. It changes its sign at a
            crossing.
        """
        if self.problem.passes_crossings:
            return False
        # The record has the sign of the determinant before the step, and its largest
        # absolute value so far.
        record = self.determinant_record.include_sizes(determinants)
        limit = np.sqrt(self.tolerance) * record.largest
        # Negative beyond a crossing, where the determinants have the other sign.
        signed_determinants = determinants * record.sign
        return bool(np.any(signed_determinants < limit))

    def _accept(
        self, step: CollocationStep, rates: Floats, determinants: Floats
    ) -> SimulationEnd | None:
        """Add a step and record its events. Return the end if the simulation ends there.

        Parameters
        ----------
        step
            A step whose error is small enough.
        rates
            (N, m, variables) rates of the pair variables (joint angles) per unit rate of
            each of the m coordinates of the equation of motion, at the N nodes of the step.
        determinants
            (N,) closure determinant at each node of the step. It changes its sign where
            curves of configurations cross (`CollocationStep.closure_determinants`).
        """
        self.steps.append(step)
        step_events = list(self._find_step_events(step, rates, determinants))
        # A crossing of curves at which the simulation ends is a "singularity". One that it
        # passes is a "crossing".
        kinds = {event.kind for event in step_events}
        has_crossing = "singularity" in kinds or "crossing" in kinds
        # In the next step, a determinant with another sign, or one that is small compared
        # with the largest so far, shows a crossing.
        self.determinant_record = self.determinant_record.after_step(
            determinants, has_crossing=has_crossing
        )
        # In order of time. Events at the same time stay in their order.
        for t, kind, pair in sorted(step_events, key=lambda step_event: step_event.t):
            if kind == "singularity":
                return SimulationEnd(kind, t, CROSSING_MESSAGE)
            values = self._record_event(kind, t, step, pair)  # variables (rad) at t
            if kind == "joint_limit":
                variable = variable_of(self.equation.mechanism, pair)
                return joint_limit_end(t, pair, float(values[variable]))
        return None

    def _find_step_events(
        self, step: CollocationStep, rates: Floats, determinants: Floats
    ) -> Iterator[StepEvent]:
        """Yield the events within a step, not in order of time.

        They are:

        - exceeded joint limits;
        - a crossing of curves of configurations: a "crossing" if the simulation passes it,
          a "singularity" if the simulation ends there;
        - configurations in which the inputs do not determine the motion: a single input
          reverses there;
        - moments of rest, if there is one input.

        Parameters
        ----------
        step
            The step.
        rates
            (N, m, variables) rates of the pair variables (joint angles) per unit rate of
            each of m coordinates (m degrees of freedom), at the N nodes of the step.
        determinants
            (N,) closure determinant at each node of the step. It changes its sign where
            curves of configurations cross (`CollocationStep.closure_determinants`).
        """
        mechanism = self.equation.mechanism
        # The states have angles without whole turns. Joint limits are limits of the angles
        # with these turns, so the turns (rad) are passed.
        for t, pair in step.find_exceeded_limits(mechanism, self.problem.turn_angles):
            yield StepEvent(t, "joint_limit", pair)
        # The record has the sign of the determinant before the step, and its largest
        # absolute value so far. `find_crossing` finds a crossing where the determinant has
        # another sign, or is negligible compared with this largest value.
        record = self.determinant_record.include_sizes(determinants)
        crossing_time = step.find_crossing(determinants, record)
        if crossing_time is not None:
            if self.problem.passes_crossings:
                yield StepEvent(crossing_time, "crossing")
            else:
                yield StepEvent(crossing_time, "singularity")
        yield from self._find_indeterminate_inputs(step, rates)
        # With one input there is a single momentum. The mechanism rests where the momentum
        # changes its sign. A state has the pair variables first, then the momentum.
        if len(self.problem.driven) == 1:
            momentum_position = self.equation.variable_count
            momentum_series = step.state_series(momentum_position)
            for t in step.find_sign_changes(momentum_series):
                yield StepEvent(t, "rest")

    def _find_indeterminate_inputs(
        self, step: CollocationStep, rates: Floats
    ) -> Iterator[StepEvent]:
        """Yield the events within a step at which the inputs do not determine the motion.

        A single input reverses at such an event (dead centre of the input). With several
        inputs, the event is a singularity of type II. In both cases the determinant of the
        inputs' rates with respect to the coordinates of the motion is zero.

        Parameters
        ----------
        step
            The step.
        rates
            (N, m, variables) derivatives of the pair variables (joint angles) with respect
            to the m coordinates of the motion, at the N nodes of the step.
        """
        driven = list(self.problem.driven)
        input_rates = np.linalg.det(rates[:, :, driven])
        # The matrix converts values at the nodes to the coefficients of a Legendre series,
        # whose zeros within the step are found.
        input_rate_series = SERIES_MATRIX @ input_rates
        for t in step.find_sign_changes(input_rate_series):
            if len(driven) == 1:
                pair = self.equation.mechanism.input_pairs[0]
                yield StepEvent(t, "dead_centre", pair)
            else:
                yield StepEvent(t, "type_2")

    def _record_event(
        self, kind: EventKind, t: float, step: CollocationStep, pair: str = ""
    ) -> Floats:
        """Record an event at a time (s) within a step, and return all variables (rad)."""
        state = step.evaluate_state(np.array([t]))[0]
        values = state[: self.equation.variable_count] + self.problem.turn_angles
        inputs = tuple(values[list(self.problem.driven)].tolist())
        self.events.append(Event(kind, t, inputs, pair))
        return values

    def _diagnose_failure(
        self, step: CollocationStep, error: float, dynamics: StateDynamics
    ) -> SimulationEnd:
        """Return the reason why a simulation ends if even very short steps are rejected.

        Possible reasons are tested in this order: a configuration whose rates can't be
        computed, such as a contact beyond its profile; a crossing of curves of
        configurations; an inertia that vanishes compared with that of earlier steps; a load
        that changes too fast.

        Parameters
        ----------
        step
            The last rejected step.
        error
            The estimated error of this step, divided by the tolerance; see `StepAttempt`.
        dynamics
            Motion and forces at the nodes of this step.
        """
        equation = self.equation
        t = step.start
        # A status says why the rates in a configuration can't be computed.
        for status, (kind, message) in END_BY_STATUS.items():
            if np.any(dynamics.motion.status == status):
                return SimulationEnd(kind, t, message)
        values = step.state[: equation.variable_count]
        # The reciprocal condition number of the closure equations is 0 at a crossing.
        condition = reciprocal_condition(equation.closure, values, equation.freedoms)
        # `is_near_crossing` was set if the closure determinant became small.
        if self.is_near_crossing or condition < MIN_CROSSING_CONDITION:
            return SimulationEnd("singularity", t, CROSSING_MESSAGE)
        message = (
            f"no step is short enough (the error is {error:.2g} times the tolerance); "
            f"{JUMP_MESSAGE}"
        )
        if not self.steps:
            # There are no earlier steps with which the inertia could be compared.
            return SimulationEnd("too_fast", t, message)
        # This call tests whether the inertia vanishes. If not, the load changes too fast.
        return no_step_end(equation, self._make_path(), t, message)


@dataclass(frozen=True)
class StepAttempt:
    """A step whose equations were solved by iteration, and the estimate of its error.

    Attributes
    ----------
    step
        The step, which may be rejected.
    error
        Error relative to the tolerance; at most 1 if the step can be accepted. Nodes are
        the times at which the equations are evaluated. The error is infinite in three
        cases: the iteration failed, the rates at a node cannot be computed, or a load
        changes abruptly between two nodes. The polynomial of the step cannot follow an
        abrupt change.
    iterations
        Number of iterations.
    dynamics
        Motion and forces at the nodes.
    """

    step: CollocationStep
    error: float
    iterations: int
    dynamics: StateDynamics


def _make_state_scales(problem: Problem, state_size: int) -> Floats:
    """Return the typical sizes (state_size,) of the quantities in a state.

    Errors are divided by these sizes, or by the state if it is larger:

    - Pair variables (joint angles): 1 rad.
    - Momenta: sqrt(B), the largest momentum p = R u at unit rates u of the coordinates. R
      is the symmetric root of the inertia matrix M = R R at the start, and B the largest
      principal inertia (kg m2).
    - Works of the loads: B, twice the kinetic energy at unit rates.
    """
    equation = problem.equation
    motion = equation.compute_motion(problem.values[None], problem.rate_weights)
    inertia_at_start = inertia_matrix(equation.mechanism, motion)[0]
    largest_inertia = float(np.linalg.norm(inertia_at_start, 2))
    scales = np.ones(state_size)
    scales[equation.momenta] = np.sqrt(largest_inertia)
    scales[equation.works] = largest_inertia
    return scales


def _truncation_errors(step: CollocationStep) -> Floats:
    """Return errors (states,) of a step, estimated from the last coefficients of rates."""
    last_sizes = max_abs(step.series[-LAST_COEFFICIENTS:], axis=0)
    return last_sizes * step.length / ERROR_DIVISOR


def _momentum_newton_matrix(slopes: Floats, length: float) -> Floats:
    """Return the matrix (N, N) by which Newton's method corrects the momenta at N nodes.

    With one degree of freedom, the momenta p at the N nodes (times of the step) satisfy
    p = p_start + h/2 A p'. The matrix A (`INTEGRATION_MATRIX`), with the factor h/2,
    integrates the rates p' from the start of the step to each node. The result is the
    inverse of the Jacobian 1 - h/2 A diag(d) of these equations. This inverse turns
    residuals of the equations into corrections of p.

    Parameters
    ----------
    slopes
        (N,) derivatives d of p' with respect to p at the nodes, 1/s.
    length
        Length h of the step, s.
    """
    integrals_of_slopes = 0.5 * length * INTEGRATION_MATRIX * slopes  # h/2 A diag(d)
    return np.asarray(np.linalg.inv(np.eye(NODE_COUNT) - integrals_of_slopes))


def _allowed_momentum_rate_error(
    tolerance: float, momentum_size: float, length: float
) -> float:
    """Return the largest error of momentum rates that a step may have at a probe.

    Probes are times between the nodes, the times at which the polynomial of a step is
    fitted to the rates. The error is the difference of the polynomial from the rates by the
    loads. If it is larger at a probe, the caller rejects the step.

    An error e of the rates is assumed to cause the error e * length / ERROR_DIVISOR of the
    momentum, as in `_truncation_errors`. The error of the momentum must not exceed
    MAX_PROBE_ERROR_RATIO * tolerance * momentum_size.

    Parameters
    ----------
    tolerance
        Tolerance of the state relative to the sizes of its quantities.
    momentum_size
        Size of the momenta.
    length
        Length of the step, s.
    """
    return MAX_PROBE_ERROR_RATIO * tolerance * ERROR_DIVISOR * momentum_size / length


def _length_factor(error: float, iterations: int) -> float:
    """Return the length of the next step, relative to the length of the present step.

    Parameters
    ----------
    error
        Error of the present step relative to the tolerance. The error is proportional to
        the N-th power of the length, with the number N of nodes (times in the step at which
        the equation of motion is satisfied).
    iterations
        Number of iterations by which the equations of the present step were solved.
    """
    if not np.isfinite(error):
        return MIN_STEP_SHRINKAGE
    factor = STEP_SAFETY * max(error, EPS) ** (-1.0 / NODE_COUNT)
    # The number of iterations grows faster than the length. After many iterations, shorter
    # steps therefore need less computing time, so the length is reduced.
    has_many_iterations = iterations > MANY_ITERATIONS
    largest_factor = STEP_SAFETY if has_many_iterations else MAX_STEP_GROWTH
    return min(max(factor, MIN_STEP_SHRINKAGE), largest_factor)
