"""The direct problem by Gauss collocation with NumPy: for whatever a mechanism has."""

import time
from collections.abc import Generator
from dataclasses import replace
from typing import final

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import STATUS_MEANING, Status
from spherekit.dynamics.coordinates import inertia_matrix, reciprocal_condition
from spherekit.dynamics.path import (
    NODES,
    Attempt,
    StatePath,
    Step,
    StepEvents,
    attempt,
    gauss,
    next_length,
    through_steps,
)
from spherekit.dynamics.simulation import (
    CROSSING,
    JUMPS,
    LOCKING,
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
from spherekit.dynamics.start import Problem, variable_of
from spherekit.dynamics.state import Dynamics
from spherekit.engine.integration import CROSSED, good_until
from spherekit.progress import Working
from spherekit.sphere.rotation import all_finite, max_abs

FIRST_ARC = 0.1
SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a simulation."""

FINEST = 0.1 * CROSSED**2
"""Largest tolerance of a step that passes near a crossing of curves, or meets one.

A configuration off its curve by d misses a crossing by sqrt(d), and where that is not less
than `CROSSED`, curves that pass each other cannot be told from some that cross.
"""

MOST_STEPS = 100_000


MISSED = 1.0
"""Part of the step's own measure of error by which it may miss a load within it."""

ASKEW = 1.5
"""Rates of all pair variables per unit rate of a frame's combination at which it is made
anew; it begins with 1."""

WINDOW = 4
"""Steps from whose time that of the steps to come is expected."""


@final
class Collocation:
    """One integration of a problem, kept while it goes on, step by step."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.problem = problem
        self.equation = problem.equation
        self.tolerance = tolerance
        self.frame = problem.frame
        self.path: list[tuple[Step, Floats]] = []
        self.events: list[Event] = []
        motion = self.equation.motion(problem.values[None], problem.frame)
        square = float(
            np.linalg.norm(inertia_matrix(self.equation.mechanism, motion)[0], 2)
        )
        start = self.equation.state(problem.values, problem.speed, problem.frame)
        self.sizes = np.ones(len(start))
        self.sizes[self.equation.momenta] = np.sqrt(square)
        self.sizes[self.equation.works] = square
        self._nodes = 0.5 * (gauss(NODES).nodes + 1.0)
        self.orientation = 0.0
        self.fine = False
        self.drift = 0.0
        self.last: Dynamics | None = None
        self.end: SimulationEnd | None = None
        self._steps = self._integrate()
        self._working = Working("simulating")
        self._reached: list[tuple[float, float]] = [(0.0, 0.0)]

    def field(self, t: Floats, states: Floats) -> Floats:
        """Return the rates of states, in the frame of the last step's end."""
        if self.problem.passes:
            states = self._closed_states(states)
        self.last = self.equation.at(t, states, self.frame, self.problem.whole)
        return self.equation.rates(self.last)

    def _closed_states(self, states: Floats) -> Floats:
        """Return states whose configurations close.

        Rates of others have no limit where sets of configurations cross; those of closed
        ones go on smoothly along the set.
        """
        if not all_finite(states):
            return states
        variables = self.equation.variables
        closed = states.copy()
        closed[:, :variables] = self.equation.nearest_closed(states[:, :variables])
        return closed

    def advance(self) -> bool:
        """Take a step; return whether the integration goes on after it."""
        started = time.perf_counter()
        with np.errstate(all="ignore"):
            try:
                t = next(self._steps)
            except StopIteration as done:
                self.end, t = done.value, self._reached[-1][0]
        seconds = self._reached[-1][1] + time.perf_counter() - started
        self._reached.append((t, seconds))
        self._working.tell(lambda: f"{t:.4g} of {self.problem.until:.6g} s")
        return self.end is None

    @property
    def left(self) -> float | None:
        """What the rest will take at the pace of the last steps (s), None before those."""
        if self.end is not None:
            return 0.0
        if len(self._reached) <= WINDOW + 1:
            return None
        (before, started), (t, now) = self._reached[-WINDOW - 1], self._reached[-1]
        return (self.problem.until - t) * (now - started) / (t - before)

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
        problem = self.problem
        end = self.end or SimulationEnd("time", self.reached, "it goes on")
        if not self.path:
            raise cannot_leave(problem, end.message)
        return Simulation(
            self.equation,
            problem.driven,
            self._travelled(),
            tuple(self.events),
            end,
            EngineReport("numpy", reason, 0.0, self.seconds, len(self.path), forecast),
            tolerance=self.tolerance,
        )

    def _integrate(self) -> Generator[float, None, SimulationEnd]:
        """Yield the time after each step; return the end."""
        problem = self.problem
        t, state = 0.0, self.equation.state(problem.values, problem.speed, problem.frame)
        length = self._first_length(state)
        before: Step | None = None
        for target in (*problem.switches, problem.until):
            while t < target:
                left = target - t
                tried_length = left if left < 1.05 * length else min(length, left)
                tried = self._attempt(t, tried_length, state, before)
                assert self.last is not None
                status = self.last.motion.status
                if tried.error > 1.0 or np.any(status != Status.OK):
                    length = min(next_length(tried), 0.5 * tried_length)
                    if length < SHORTEST * problem.until:
                        return self._stuck(t, state, tried)
                    continue
                within = StepEvents(tried.step, self.last.motion.rates, problem.whole)
                orientation = within.orientation(self.equation.closure)
                if self._refined(orientation):
                    continue
                if len(self.path) >= MOST_STEPS:
                    return SimulationEnd("too_fast", t, too_many(MOST_STEPS))
                if tried_length == length or tried_length < left:
                    length = next_length(tried)
                stopped = self._accept(within, orientation)
                if stopped is not None:
                    return stopped
                t = target if tried_length == left else tried.step.stop
                before = tried.step
                state = self._closed(tried.step.end)
                if self._askew():
                    state, self.frame = self.equation.framed(state, self.frame)
                    before = None
                yield t
            if t < problem.until:
                self._note("switch", t, self.path[-1][0])
                before = None
        return SimulationEnd("time", problem.until, "the time asked for is over")

    def _attempt(
        self, t: float, length: float, state: Floats, before: Step | None
    ) -> Attempt:
        """Try a step; its error is infinite where it misses what a load does within it."""
        equation, watched = self.equation, self.equation.loads.watched
        # Newton's method is of one momentum.
        stiff = equation.variables if watched and equation.freedoms == 1 else None
        tried = attempt(
            self.field, t, length, state, self._step_tolerance, before, self.sizes, stiff
        )
        last = self.last
        assert last is not None
        if self.problem.passes and not self._passes(tried, last):
            return replace(tried, error=np.inf)
        if not watched or tried.error > 1.0 or np.any(last.motion.status != Status.OK):
            return tried
        momenta = equation.momenta
        scale = max(self.sizes[momenta][0], float(max_abs(state[momenta])))
        enough = MISSED * self._step_tolerance * (4 * NODES - 2) * scale / length

        def look(_: Indices, x: Floats) -> tuple[Floats, Floats]:
            when = t + x * length
            states = tried.step.at(when)
            nearest = np.argmin(np.abs(x[:, None] - self._nodes), axis=1)
            frame = last.motion.rates[nearest] if equation.freedoms == 1 else self.frame
            dynamics = equation.at(when, states, frame, self.problem.whole)
            missed = np.abs(dynamics.push - tried.step.rate(when)[:, momenta])
            missed = np.max(missed, axis=1) / enough
            return missed, equation.arguments(dynamics, self.problem.whole, when)

        good = float(good_until(look, 1)[0])
        return tried if good == 1.0 else replace(tried, error=np.inf)

    def _passes(self, tried: Attempt, last: Dynamics) -> bool:
        """Return whether a step keeps to one set of configurations where sets cross.

        It passes through a crossing, ends away from any, and is on no two sets that come
        near each other and do not cross.
        """
        if tried.error > 1.0 or np.any(last.motion.status != Status.OK):
            return True
        within = StepEvents(tried.step, last.motion.rates, self.problem.whole)
        orientation = within.orientation(self.equation.closure)
        size, side = self._sense(orientation)
        near = np.abs(orientation) < CROSSED * size
        if not np.any(orientation * side < 0.0):
            return not np.any(near)
        t = within.crossing(orientation, float(np.copysign(size, side)), CROSSED)
        if np.any(near[-2:]) or t is None:
            return False
        equation = self.equation
        values = tried.step.at(np.array([t]))[0, : equation.variables]
        # Between sets that do not cross, a way from one to the other is not closed.
        gap = float(max_abs(equation.closure.at(values[None]).residual))
        sure = reciprocal_condition(equation.closure, values, equation.freedoms)
        return gap < FINEST and sure < CROSSED

    def _first_length(self, state: Floats) -> float:
        problem = self.problem
        dynamics = self.equation.at(np.zeros(1), state[None], self.frame, problem.whole)
        pace = float(np.linalg.norm(dynamics.speed[0])) / FIRST_ARC
        push = float(np.linalg.norm(dynamics.roots.solved(dynamics.push)[0]))
        pace = max(pace, np.sqrt(push / FIRST_ARC))
        until = problem.until
        length = min(until, 1.0 / max(pace, 1e-300), 1.0)
        return float(max(length, SHORTEST * until))

    def _closed(self, state: Floats) -> Floats:
        """Return the state with its configuration put back onto the curve."""
        variables = self.equation.variables
        closed = state.copy()
        closed[:variables], gap = self.equation.closed(state[:variables])
        self.drift = max(self.drift, gap)
        return closed

    @property
    def _step_tolerance(self) -> float:
        return min(self.tolerance, FINEST) if self.fine else self.tolerance

    def _refined(self, orientation: Floats) -> bool:
        """Return whether a step has to be taken again, to tell whether curves cross."""
        if self.problem.passes:
            return False
        size, side = self._sense(orientation)
        near = np.abs(orientation) < np.sqrt(self.tolerance) * size
        before, self.fine = self.fine, bool(np.any(near | (orientation * side < 0.0)))
        return self.fine and not before and self.tolerance > FINEST

    def _sense(self, orientation: Floats) -> tuple[float, float]:
        """Return the largest orientation so far, with those of a step, and a first one."""
        size = max(abs(self.orientation), float(max_abs(orientation)))
        return size, self.orientation or float(orientation[0])

    def _accept(self, within: StepEvents, orientation: Floats) -> SimulationEnd | None:
        """Keep a step and note its events; return the end if there is one within it."""
        step, rates = within.step, within.rates
        mechanism, driven = self.equation.mechanism, self.problem.driven
        end = self._end(within, orientation)
        last = np.inf if end is None else end.t
        if len(driven) == 1:
            name = mechanism.pairs[mechanism.variable_owners[driven[0]]].name
            happened: list[tuple[EventKind, float, str]] = [
                ("dead_centre", t, name) for t in within.dead_centres(driven)
            ]
            happened += [("rest", t, "") for t in within.rests(self.equation.variables)]
        else:
            happened = [("type_2", t, "") for t in within.dead_centres(driven)]
        for kind, t, pair in sorted(happened, key=lambda item: item[1]):
            if t < last:
                self._note(kind, t, step, pair)
        if len(driven) == 1:
            self.frame = rates[-1]
        self.path.append((step, rates if len(driven) == 1 else self.frame[None]))
        return end

    def _askew(self) -> bool:
        """Return whether the coordinates' vectors have turned far from the frame."""
        if self.equation.freedoms == 1:
            return False
        assert self.last is not None
        return bool(np.linalg.norm(self.last.motion.rates[-1], 2) > ASKEW)

    def _end(self, within: StepEvents, orientation: Floats) -> SimulationEnd | None:
        """Return the end that lies within a step: a stop, or a crossing of curves."""
        reached = within.stop(self.equation.mechanism)
        size, side = self._sense(orientation)
        self.orientation = float(np.copysign(size, side))
        crossing = within.crossing(orientation, self.orientation, CROSSED)
        if self.problem.passes and crossing is not None:
            self.orientation = float(np.copysign(size, orientation[-1]))
            if reached is None or crossing < reached[0]:
                self._note("crossing", crossing, within.step)
            crossing = None
        if crossing is not None and (reached is None or crossing < reached[0]):
            return SimulationEnd("singularity", crossing, CROSSING)
        if reached is None:
            return None
        t, stop = reached
        place = variable_of(self.equation.mechanism, stop.pair)
        value = self._note("stop", t, within.step, stop.pair)[place]
        return stop_end(t, stop.pair, float(value))

    def _note(self, kind: EventKind, t: float, step: Step, pair: str = "") -> Floats:
        """Note an event, and return all variables there."""
        values = step.at(np.array([t]))[0, : self.equation.variables] + self.problem.whole
        inputs = tuple(values[list(self.problem.driven)].tolist())
        self.events.append(Event(kind, t, inputs, pair))
        return values

    def _stuck(self, t: float, state: Floats, tried: Attempt) -> SimulationEnd:
        """Return why no step however short can be taken from here."""
        assert self.last is not None
        codes = self.last.motion.status
        kinds: dict[Status, EndKind] = {
            Status.OFF_PROFILE: "off_profile",
            Status.CURVATURE: "curvature",
        }
        for code, kind in kinds.items():
            if np.any(codes == code):
                return SimulationEnd(kind, t, STATUS_MEANING[code])
        if np.any(codes == Status.NOT_CONVERGED):
            return SimulationEnd("locking", t, LOCKING)
        values = state[: self.equation.variables]
        closure, freedoms = self.equation.closure, self.equation.freedoms
        if self.fine or reciprocal_condition(closure, values, freedoms) < 1e-5:
            return SimulationEnd("singularity", t, CROSSING)
        why = f"no step is short enough (iteration error {tried.error:.2g}); {JUMPS}"
        if not self.path:
            return SimulationEnd("too_fast", t, why)
        return given_up(self.equation, self._travelled(), t, why)

    def _travelled(self) -> StatePath:
        return through_steps(self.path, self.problem.turns, self.drift)
