"""The direct problem by Gauss collocation with NumPy: for whatever a mechanism has."""

import time
from collections.abc import Generator
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import STATUS_MEANING, Status
from spherekit.dynamics.collocation import (
    NODES,
    Attempt,
    Step,
    attempt,
    gauss,
    next_length,
)
from spherekit.dynamics.events import StepEvents
from spherekit.dynamics.kinematics import reciprocal_condition
from spherekit.dynamics.path import CollocationPath, Travelled
from spherekit.dynamics.simulation import (
    CROSSING,
    JUMPS,
    EndKind,
    EngineReport,
    Event,
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
from spherekit.engine.probes import good_until
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

FIRST_ARC = 0.1
SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a simulation."""

CROSSED = 1e-6
"""Orientations smaller than this part of the largest are those of a crossing of curves.

A configuration off its curve by d misses a crossing by sqrt(d), so the root of the
tolerance counts where it is more.
"""

MOST_STEPS = 100_000


MISSED = 1.0
"""Part of the step's own measure of error by which it may miss a load within it."""

WINDOW = 4
"""Steps from whose time that of the steps to come is expected."""


@final
class Collocation:
    """One integration of a problem, kept while it goes on, step by step."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.problem = problem
        self.equation = problem.equation
        self.tolerance = tolerance
        self.tangent = problem.tangent
        self.path: list[Travelled] = []
        self.events: list[Event] = []
        speed_one = self.equation.state(problem.values, 1.0, problem.tangent)
        unit = float(speed_one[self.equation.variables])
        self.sizes = np.ones(len(speed_one))
        self.sizes[self.equation.variables :] = unit**2
        self.sizes[self.equation.variables] = unit
        self._nodes = 0.5 * (gauss(NODES).nodes + 1.0)
        self.orientation = 0.0
        self.drift = 0.0
        self.last: Dynamics | None = None
        self.end: SimulationEnd | None = None
        self._steps = self._integrate()
        self._working = Working("simulating")
        self._reached: list[tuple[float, float]] = [(0.0, 0.0)]

    def field(self, t: Floats, states: Floats) -> Floats:
        """Return the rates of states, on the side of the last step's tangent."""
        self.last = self.equation.at(t, states, self.tangent, self.problem.whole)
        return self.equation.rates(self.last)

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
        t, state = 0.0, self.equation.state(problem.values, problem.speed, problem.tangent)
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
                if len(self.path) >= MOST_STEPS:
                    return SimulationEnd("too_fast", t, too_many(MOST_STEPS))
                if tried_length == length or tried_length < left:
                    length = next_length(tried)
                stopped = self._accept(tried.step)
                if stopped is not None:
                    return stopped
                t = target if tried_length == left else tried.step.stop
                before = tried.step
                state = self._closed(tried.step.end)
                yield t
            if t < problem.until:
                self._note("switch", t, self._input(state), "")
                before = None
        return SimulationEnd("time", problem.until, "the time asked for is over")

    def _attempt(
        self, t: float, length: float, state: Floats, before: Step | None
    ) -> Attempt:
        """Try a step; its error is infinite where it misses what a load does within it."""
        stiff = self.equation.variables if self.equation.loads.watched else None
        tried = attempt(
            self.field, t, length, state, self.tolerance, before, self.sizes, stiff
        )
        last = self.last
        assert last is not None
        if stiff is None or tried.error > 1.0 or np.any(last.motion.status != Status.OK):
            return tried
        scale = max(self.sizes[stiff], abs(float(state[stiff])))
        enough = MISSED * self.tolerance * (4 * NODES - 2) * scale / length

        def look(_: NDArray[np.intp], x: Floats) -> tuple[Floats, Floats]:
            when = t + x * length
            states = tried.step.at(when)
            nearest = np.argmin(np.abs(x[:, None] - self._nodes), axis=1)
            along = last.motion.rates[nearest]
            found = self.equation.at(when, states, along, self.problem.whole)
            rates = self.equation.rates(found)[:, stiff]
            missed = np.abs(rates - tried.step.rate(when)[:, stiff])
            return missed / enough, self.equation.arguments(found, self.problem.whole, when)

        good = float(good_until(look, 1)[0])
        return tried if good == 1.0 else replace(tried, error=np.inf)

    def _first_length(self, state: Floats) -> float:
        problem = self.problem
        found = self.equation.at(np.zeros(1), state[None], self.tangent, problem.whole)
        pace = abs(float(found.speed[0])) / FIRST_ARC
        push = abs(float(np.sum(found.forces) / found.B[0]))
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

    def _accept(self, step: Step) -> SimulationEnd | None:
        """Keep a step and note its events; return the end if there is one within it."""
        assert self.last is not None
        mechanism, driven = self.equation.mechanism, self.problem.driven
        tangents = self.last.motion.rates
        within = StepEvents(step, tangents, self.problem.whole)
        end = self._end(within)
        last = np.inf if end is None else end.t
        name = mechanism.pairs[mechanism.variable_owners[driven]].name
        found = [("dead_centre", t, name) for t in within.dead_centres(driven)]
        found += [("rest", t, "") for t in within.rests(self.equation.variables)]
        for kind, t, pair in sorted(found, key=lambda item: item[1]):
            if t < last:
                self._note(kind, t, self._input(step.at(np.array([t]))[0]), pair)
        self.path.append(Travelled(step, tangents))
        self.tangent = tangents[-1]
        return end

    def _end(self, within: StepEvents) -> SimulationEnd | None:
        """Return the end that lies within a step: a stop, or a crossing of curves."""
        reached = within.stop(self.equation.mechanism)
        orientation = within.orientation(self.equation.closure)
        size = max(abs(self.orientation), float(np.max(np.abs(orientation))))
        side = self.orientation or float(orientation[0])
        self.orientation = float(np.copysign(size, side))
        least = max(CROSSED, float(np.sqrt(self.tolerance)))
        crossing = within.crossing(orientation, self.orientation, least)
        if crossing is not None and (reached is None or crossing < reached[0]):
            return SimulationEnd("singularity", crossing, CROSSING)
        if reached is None:
            return None
        t, stop = reached
        state = within.step.at(np.array([t]))[0]
        place = variable_of(self.equation.mechanism, stop.pair)
        value = float(state[place] + self.problem.whole[place])
        self._note("stop", t, self._input(state), stop.pair)
        return stop_end(t, stop.pair, value)

    def _input(self, state: Floats) -> float:
        driven = self.problem.driven
        return float(state[driven] + self.problem.whole[driven])

    def _note(self, kind: str, t: float, q: float, pair: str) -> None:
        self.events.append(Event(kind, t, q, pair))  # type: ignore[arg-type]

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
        values = state[: self.equation.variables]
        if reciprocal_condition(self.equation.closure, values) < 1e-5:
            return SimulationEnd("singularity", t, CROSSING)
        why = f"no step is short enough (iteration error {tried.error:.2g}); {JUMPS}"
        if not self.path:
            return SimulationEnd("too_fast", t, why)
        return given_up(self.equation, self._travelled(), t, why)

    def _travelled(self) -> CollocationPath:
        return CollocationPath(tuple(self.path), self.problem.turns, self.drift)
