"""The direct problem by Gauss collocation with NumPy: for whatever a mechanism has.

All nodes of a step at once: few, long, vectorised steps. The equations of a step are solved
by Picard iteration: the right-hand side is evaluated at all nodes in one call, which costs
an array code little more than one node. The last coefficients of the rate's series say how
well the solution is resolved.
"""

import time
from collections.abc import Generator, Iterator
from typing import Literal

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.dynamics.coordinates import reciprocal_condition
from spherekit.dynamics.equation_of_motion import StateDynamics
from spherekit.dynamics.inertia import inertia_matrix
from spherekit.dynamics.simulated_path import (
    GAUSS,
    INTEGRAL,
    NODES,
    TO_SERIES,
    StatePath,
    Step,
    through_steps,
)
from spherekit.dynamics.simulation import (
    CROSSING,
    JUMPS,
    LOCKING,
    NOISE,
    OVER,
    EndKind,
    EngineReport,
    Event,
    EventKind,
    Forecast,
    Simulation,
    SimulationEnd,
    cannot_leave,
    given_up,
    stop_end,
    too_many,
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

MAX_ITERATIONS = 40
"""Iterations of a step after which it is rejected."""

MANY_ITERATIONS = 24
"""Iterations above which the next step is shortened.

The number of iterations grows faster than the step. Larger: steps that converge slowly are
kept. Smaller: more steps.
"""

SLOPE_ITERATIONS = (1, 4, 9)
"""Iterations in which Newton's method for a stiff momentum computes its slope.

More: each step takes longer. Fewer: it converges more slowly if the slope changes.
"""

MOMENTUM_DIFFERENCE = 1e-7
"""Difference for that slope, relative to the size of the momentum.

Larger: the slope has a larger truncation error. Smaller: a larger rounding error.
"""

CONTINUED_COEFFICIENTS = 12
"""Coefficients of a step that are continued as the first guess of the next.

More: high orders grow beyond the step. Fewer: more iterations.
"""

STEP_SAFETY = 0.8
"""Factor of the step that the error estimate allows.

Larger: more steps are rejected. Smaller: more steps.
"""

MAX_STEP_GROWTH = 1.4
"""Largest ratio of a step to the one before."""

MIN_STEP_SHRINKAGE = 0.35
"""Smallest ratio of a step to the one before or the one that it replaces."""

NOISE_RATIO = 0.2
"""Size of the last coefficients relative to the later ones from which they are noise.

The coefficients of smooth rates fall. Larger: noise is not noticed, and steps become short.
Smaller: slowly falling coefficients are taken for noise.
"""

MAX_NOISY_STEPS = 50
"""Short noisy steps in a row after which a simulation ends."""

NOISY_STEP_FRACTION = 1e-4
"""Part of the whole time below which a noisy step counts as short."""

ERROR_DIVISOR = 4 * NODES - 2
"""The error of a step is its length times its last coefficients over this number.

The integral of the Legendre polynomial of order k is the difference of two others over
2 k + 1. The last coefficient has k = N - 1, and a step has half its length for each unit.
"""

MAX_PROBE_ERROR_RATIO = 1.0
"""Largest error at a probe within a step, relative to the error that the step may have.

Larger: abrupt changes of loads are missed. Smaller: accurate steps are rejected.
"""

MAX_FRAME_RATE = 1.5
"""Largest rate of all pair variables per unit rate of a coordinate before the frame is
renewed; it is 1 in a new frame.

Larger: coordinates are used nearer to their singularities. Smaller: frames are renewed more
often.
"""

FORECAST_STEPS = 4
"""Last steps from whose computing time that of the remaining ones is estimated."""

END_BY_STATUS: dict[Status, tuple[EndKind, str]] = {
    Status.OFF_PROFILE: ("off_profile", STATUS_MEANING[Status.OFF_PROFILE]),
    Status.CURVATURE: ("curvature", STATUS_MEANING[Status.CURVATURE]),
    Status.NOT_CONVERGED: ("locking", LOCKING),
}
"""Ends of a simulation at configurations in which there are no rates, by their status."""


class Collocation:
    """One integration of a problem, kept while it goes on, step by step."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.problem = problem
        self.equation = equation = problem.equation
        self.tolerance = tolerance
        self.frame = problem.frame
        self.path: list[Step] = []
        self.events: list[Event] = []
        motion = equation.compute_motion(problem.values[None], problem.frame)
        square = float(np.linalg.norm(inertia_matrix(equation.mechanism, motion)[0], 2))
        self.start = equation.make_state(problem.values, problem.speed, problem.frame)
        self.sizes = np.ones(len(self.start))
        self.sizes[equation.momenta] = np.sqrt(square)
        self.sizes[equation.works] = square
        self.orientation = 0.0
        self.fine = False
        self.drift = 0.0
        self.creeping = 0
        self.end: SimulationEnd | None = None
        self._steps = self._integrate()
        self._working = ProgressReporter("simulating")
        self._reached: list[tuple[float, float]] = [(0.0, 0.0)]

    def advance(self) -> bool:
        """Take a step; return whether the integration goes on after it."""
        started = time.perf_counter()
        with np.errstate(all="ignore"):
            try:
                t = next(self._steps)
            except StopIteration as done:
                self.end, t = done.value, self.reached
        self._reached.append((t, self.seconds + time.perf_counter() - started))
        is_time = self._working.tell(lambda: f"{t:.4g} of {self.problem.until:.6g} s")
        if is_time and self.end is None and self.problem.seen:
            self.problem.seen(self.simulation("it goes on"))
        return self.end is None

    @property
    def left(self) -> float | None:
        """What the rest will take at the pace of the last steps (s), None before those."""
        if len(self._reached) <= FORECAST_STEPS + 1:
            return None
        before, started = self._reached[-FORECAST_STEPS - 1]
        pace = (self.seconds - started) / (self.reached - before)
        return (self.problem.until - self.reached) * pace

    @property
    def seconds(self) -> float:
        """What solving has taken (s)."""
        return self._reached[-1][1]

    @property
    def reached(self) -> float:
        """The time (s) up to which it has come."""
        return self._reached[-1][0]

    def simulation(self, reason: str, forecast: Forecast | None = None) -> Simulation:
        """Return the motion as far as it is known; `reason` says why it is NumPy's."""
        end = self.end or SimulationEnd("time", self.reached, "it goes on")
        if not self.path:
            raise cannot_leave(self.problem, end.message)
        return Simulation(
            self.equation,
            self.problem.driven,
            self._travelled(),
            tuple(self.events),
            end,
            EngineReport("numpy", reason, 0.0, self.seconds, len(self.path), forecast),
            tolerance=self.tolerance,
        )

    def _travelled(self) -> StatePath:
        return through_steps(self.path, self.problem.turns, self.drift)

    def _integrate(self) -> Generator[float, None, SimulationEnd]:
        """Yield the time after each step; return the end."""
        problem = self.problem
        equation = self.equation
        t = 0.0
        state = self.start
        before = None
        length = self._first_length()
        for target in problem.targets:
            while t < target:
                left = target - t
                tried = left if left < 1.05 * length else length
                step, error, iterations, last = self._attempt(t, tried, state, before)
                rates = last.motion.rates
                if error <= 1.0:
                    orientation = step.orientation(equation.closure, rates)
                    if not self._keeps(step, orientation):
                        error = np.inf
                if error > 1.0:
                    length = min(_factor(error, iterations), 0.5) * tried
                    if length < MIN_STEP_FRACTION * problem.until:
                        return self._stuck(step, error, last)
                    continue
                if self._refined(orientation):
                    continue
                if len(self.path) >= MAX_COLLOCATION_STEPS:
                    return SimulationEnd("too_fast", t, too_many(MAX_COLLOCATION_STEPS))
                noisy = self._noisy(step)
                if tried == length or tried < left:
                    # A shorter step has as much noise.
                    length = _factor(EPS if noisy else error, iterations) * tried
                creeps = noisy and tried < NOISY_STEP_FRACTION * problem.until
                self.creeping = self.creeping + 1 if creeps else 0
                if self.creeping == MAX_NOISY_STEPS:
                    return SimulationEnd("too_fast", t, NOISE)
                stopped = self._accept(step, rates, orientation)
                if stopped is not None:
                    return stopped
                t = target if tried == left else step.stop
                before = step
                state = self._closed(step.end)
                if equation.freedoms == 1:
                    self.frame = rates[-1]
                elif np.linalg.norm(rates[-1], 2) > MAX_FRAME_RATE:
                    state, self.frame = equation.renew_frame(state, self.frame)
                    before = None
                yield t
            if t < problem.until:
                self._note("switch", t, self.path[-1])
                before = None
        return SimulationEnd("time", problem.until, OVER)

    def _first_length(self) -> float:
        until = self.problem.until
        dynamics = self._dynamics(np.zeros(1), self.start[None])
        speed = float(np.linalg.norm(dynamics.speed)) / FIRST_STEP_ARC
        push = float(np.linalg.norm(dynamics.roots.solve(dynamics.momentum_rates)))
        pace = max(speed, (push / FIRST_STEP_ARC) ** 0.5, 1.0)
        return max(min(until, 1.0 / pace), MIN_STEP_FRACTION * until)

    def _dynamics(self, t: Floats, states: Floats) -> StateDynamics:
        """Return what acts at states, in the frame of the last step's end.

        Where crossings are passed at configurations that close: rates of others have no
        limit where sets of configurations cross, those of closed ones go on smoothly along
        the set.
        """
        equation = self.equation
        variables = self.equation.variable_count
        if self.problem.passes and all_finite(states):
            closed = equation.project(states[:, :variables])
            states = np.concatenate([closed, states[:, variables:]], axis=1)
        return equation.evaluate(t, states, self.frame, self.problem.whole)

    def _closed(self, state: Floats) -> Floats:
        """Return the state with its configuration put back onto the curve."""
        variables = self.equation.variable_count
        values, gap = self.equation.project_once(state[:variables])
        self.drift = max(self.drift, gap)
        return np.concatenate([values, state[variables:]])

    def _attempt(
        self, start: float, length: float, state: Floats, before: Step | None
    ) -> tuple[Step, float, int, StateDynamics]:
        """Try a step, from `before`, the one that ends there.

        Return it with its error, what the polynomial leaves out over what is tolerated,
        infinite where the iteration failed, there are no rates, or it misses what a load
        does within it; with the number of iterations, and what acts at the nodes.
        """
        equation = self.equation
        t = start + 0.5 * length * (GAUSS + 1.0)
        scale = np.maximum(self.sizes, np.abs(state))
        # Newton's method is of one momentum.
        stiff = equation.freedoms == 1 and equation.loads.needs_step_probes
        if before is None:
            first = self._dynamics(np.array([start]), state[None])
            rates = np.repeat(equation.state_rates(first), NODES, axis=0)
        else:
            rates = before.summed(before.series[:CONTINUED_COEFFICIENTS], t)
        integral = 0.5 * length * INTEGRAL
        states = state + integral @ rates
        tolerance = (
            min(self.tolerance, MAX_CROSSING_TOLERANCE_RAD) if self.fine else self.tolerance
        )
        enough = max(0.05 * tolerance, 8 * EPS)
        change = np.inf
        error = np.inf
        settled = False
        for count in range(1, MAX_ITERATIONS + 1):
            last = change
            dynamics = self._dynamics(t, states)
            rates = equation.state_rates(dynamics)
            moved = state + integral @ rates
            if stiff:
                if count in SLOPE_ITERATIONS:
                    inverse = self._inverse(t, states, rates, length, scale)
                place = equation.variable_count
                moved[:, place] = states[:, place] + inverse @ (moved - states)[:, place]
            change = float(max_abs((moved - states) / scale))
            states = moved
            if not np.isfinite(change) or (count > 4 and change > 4.0 * last):
                break
            if change < enough or last <= change < max(tolerance, 64 * EPS):
                settled = True
                break
        series = TO_SERIES @ rates
        frames = dynamics.motion.rates if equation.freedoms == 1 else self.frame[None]
        step = Step(start, length, state, series, frames)
        if settled and np.all(dynamics.motion.status == Status.OK):
            left_out = max_abs(series[-3:], axis=0) * length / ERROR_DIVISOR
            error = float(np.max(left_out / scale)) / tolerance
        if error <= 1.0 and not self._looked(step, scale, tolerance):
            error = np.inf
        return step, error, count, dynamics

    def _inverse(
        self, t: Floats, states: Floats, rates: Floats, length: float, scale: Floats
    ) -> Floats:
        """Return the matrix (N, N) of Newton's method for the momenta at N nodes.

        It turns residuals of the collocation equations into corrections of the momenta.

        Parameters
        ----------
        t
            (N,) times of the nodes, s.
        states, rates
            (N, states) states at the nodes and their rates.
        length
            Length of the step, s.
        scale
            (states,) sizes of the state.
        """
        momentum = self.equation.variable_count
        shift = MOMENTUM_DIFFERENCE * scale[momentum]
        shifted_states = states.copy()
        shifted_states[:, momentum] += shift
        shifted_rates = self.equation.state_rates(self._dynamics(t, shifted_states))
        # The derivative of the momentum's rate by the momentum at each node.
        slope = (shifted_rates - rates)[:, momentum] / shift
        slope[~np.isfinite(slope)] = 0.0
        return np.linalg.inv(np.eye(NODES) - 0.5 * length * INTEGRAL * slope)

    def _looked(self, step: Step, scale: Floats, tolerance: float) -> bool:
        """Return whether loads do within a step what its series say."""
        equation = self.equation
        momenta = self.equation.momenta
        loads = equation.loads
        if not loads.needs_step_probes:
            return True
        largest = max(scale[equation.variable_count], float(max_abs(step.state[momenta])))
        enough = MAX_PROBE_ERROR_RATIO * tolerance * ERROR_DIVISOR * largest / step.length

        def probe(_: Indices, places: Floats) -> tuple[Floats, Floats]:
            """Return errors (n,) and steep arguments (n, arguments); see `step_probes`."""
            t = step.start + places * step.length
            # The frames are the tangents at the nodes, which are in [-1, 1].
            nearest = np.argmin(np.abs(2.0 * places[:, None] - 1.0 - GAUSS), axis=1)
            frame = step.frames[nearest] if equation.freedoms == 1 else self.frame
            dynamics = equation.evaluate(t, step.at(t), frame, self.problem.whole)
            missed = np.abs(dynamics.momentum_rates - step.rate(t)[:, momenta])
            steep = loads.evaluate_laws(
                loads.steep_arguments, dynamics.motion, dynamics.speed, t
            )
            return np.max(missed, axis=1) / enough, steep

        return bool(find_first_errors(probe, 1)[0] > 1.0)

    def _noisy(self, step: Step) -> bool:
        """Return whether a step's last coefficients are noise: not smaller than others."""
        sizes = max_abs(step.series[NODES // 3 :] / self.sizes, axis=1)
        return bool(np.max(sizes[-3:]) > NOISE_RATIO * np.max(sizes))

    def _keeps(self, step: Step, orientation: Floats) -> bool:
        """Return whether a step keeps to one set of configurations where sets cross.

        Where crossings are passed: it passes through one, ends away from any, and is on no
        two sets that come near each other and do not cross.
        """
        if not self.problem.passes:
            return True
        equation = self.equation
        size, side = self._sense(orientation)
        near = np.abs(orientation) < CROSSING_RATIO * size
        if not np.any(orientation * side < 0.0):
            return not np.any(near)
        t = step.crossing(orientation, float(np.copysign(size, side)))
        if np.any(near[-2:]) or t is None:
            return False
        values = step.at(np.array([t]))[0, : equation.variable_count]
        # Between sets that do not cross, a way from one to the other is not closed.
        (gap,) = equation.closure.at(values[None]).gap
        sure = reciprocal_condition(equation.closure, values, equation.freedoms)
        return bool(gap < MAX_CROSSING_TOLERANCE_RAD and sure < CROSSING_RATIO)

    def _refined(self, orientation: Floats) -> bool:
        """Return whether a step has to be taken again, to tell whether curves cross."""
        if self.problem.passes:
            return False
        size, side = self._sense(orientation)
        near = orientation * np.sign(side) < np.sqrt(self.tolerance) * size
        before, self.fine = self.fine, bool(np.any(near))
        return self.fine and not before and self.tolerance > MAX_CROSSING_TOLERANCE_RAD

    def _sense(self, orientation: Floats) -> tuple[float, float]:
        """Return the largest orientation so far, with those of a step, and a first one."""
        size = max(abs(self.orientation), float(max_abs(orientation)))
        return size, self.orientation or float(orientation[0])

    def _accept(
        self, step: Step, rates: Floats, orientation: Floats
    ) -> SimulationEnd | None:
        """Keep a step and note its events; return the end if there is one within it."""
        self.path.append(step)
        happened = self._happened(step, rates, orientation)
        for t, kind, pair in sorted(happened, key=lambda item: item[0]):
            if kind == "singularity":
                return SimulationEnd(kind, t, CROSSING)
            values = self._note(kind, t, step, pair)
            if kind == "joint_limit":
                number = variable_of(self.equation.mechanism, pair)
                return stop_end(t, pair, float(values[number]))
        return None

    def _happened(
        self, step: Step, rates: Floats, orientation: Floats
    ) -> Iterator[tuple[float, EventKind | Literal["singularity"], str]]:
        """Yield what happens within a step, where at one time, what ends it first."""
        mechanism = self.equation.mechanism
        driven = list(self.problem.driven)
        for t, pair in step.stopped(mechanism, self.problem.whole):
            yield t, "joint_limit", pair
        size, side = self._sense(orientation)
        self.orientation = float(np.copysign(size, side))
        crossing = step.crossing(orientation, self.orientation)
        if crossing is not None:
            yield crossing, "crossing" if self.problem.passes else "singularity", ""
            self.orientation = float(np.copysign(size, orientation[-1]))
        # There the inputs do not say how all else moves; a single one turns back.
        alone = len(driven) == 1
        kind: EventKind = "dead_centre" if alone else "type_2"
        for t in step.passed(TO_SERIES @ np.linalg.det(rates[:, :, driven])):
            yield t, kind, mechanism.input_pairs[0] if alone else ""
        if alone:
            for t in step.passed(step.column(self.equation.variable_count)):
                yield t, "rest", ""

    def _note(self, kind: EventKind, t: float, step: Step, pair: str = "") -> Floats:
        """Note an event, and return all variables there."""
        values = (
            step.at(np.array([t]))[0, : self.equation.variable_count] + self.problem.whole
        )
        inputs = tuple(values[list(self.problem.driven)].tolist())
        self.events.append(Event(kind, t, inputs, pair))
        return values

    def _stuck(self, step: Step, error: float, last: StateDynamics) -> SimulationEnd:
        """Return why no step however short can be taken from the start of one."""
        equation = self.equation
        t = step.start
        for code, (kind, words) in END_BY_STATUS.items():
            if np.any(last.motion.status == code):
                return SimulationEnd(kind, t, words)
        values = step.state[: equation.variable_count]
        sure = reciprocal_condition(equation.closure, values, equation.freedoms)
        if self.fine or sure < 1e-5:
            return SimulationEnd("singularity", t, CROSSING)
        why = f"no step is short enough (iteration error {error:.2g}); {JUMPS}"
        if not self.path:
            return SimulationEnd("too_fast", t, why)
        return given_up(equation, self._travelled(), t, why)


def _factor(error: float, iterations: int) -> float:
    """Return by what the next step is longer, or shorter after one not accepted."""
    if not np.isfinite(error):
        return MIN_STEP_SHRINKAGE
    factor = STEP_SAFETY * max(error, EPS) ** (-1.0 / NODES)
    most = STEP_SAFETY if iterations > MANY_ITERATIONS else MAX_STEP_GROWTH
    return min(max(factor, MIN_STEP_SHRINKAGE), most)
