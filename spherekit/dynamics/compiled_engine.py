"""The direct problem by Taylor series of the compiled equation of motion."""

import time
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import STATUS_MEANING, Status
from spherekit.dynamics.inertia import equivalent_inertia
from spherekit.dynamics.kinematics import reciprocal_condition
from spherekit.dynamics.path import Traced
from spherekit.dynamics.simulation import (
    CROSSING,
    JUMPS,
    NO_SERIES,
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
from spherekit.dynamics.start import Problem
from spherekit.engine.equation import compiled_equation
from spherekit.engine.integration import MOST_STEPS, Run, integrate
from spherekit.engine.loads import FULL_TURN
from spherekit.errors import EngineError
from spherekit.sphere.rotation import Floats

NO_CROSSING = 1e-3
"""Less belongs to a crossing of curves, see `reciprocal_condition`."""
STICKS = (
    "a load that is not smooth would turn back at once, as dry friction does at rest; "
    "sticking is not modelled: smooth the load, or end here"
)


@final
@dataclass(frozen=True)
class TaylorPath:
    """A compiled run; `sense` is that of the homogeneous rates along the curve."""

    run: Run
    sense: float

    @property
    def starts(self) -> Floats:
        """(steps,) times at which steps start (s)."""
        return self.run.starts

    @property
    def lengths(self) -> Floats:
        """(steps,) their lengths (s)."""
        return self.run.lengths

    @property
    def drift(self) -> float:
        """Largest closure residual (rad) that was taken out."""
        return self.run.drift

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""
        states, rates, turns = self.run.at(t)
        count = turns.shape[1]
        states[:, count] *= self.sense
        rates[:, count] *= self.sense
        frames = self.sense * self.run.tau(states[:, :count])[:, None]
        return Traced(states, rates, frames, turns)


def by_taylor_series(
    problem: Problem,
    tolerance: float,
    compact: bool,
    reason: str,
    forecast: Forecast | None = None,
) -> Simulation:
    """Return the motion of a problem.

    Parameters
    ----------
    tolerance, compact
        See `spherekit.engine.equation.compiled_equation`.
    reason, forecast
        Why it is this engine that runs.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled, or not on all of the way, or a load has no
        series at the start.
    """
    mechanism = problem.equation.mechanism
    if problem.equation.freedoms > 1:
        raise EngineError(
            f"{mechanism.name}: the compiled engine is of one input; this mechanism has "
            f"{problem.equation.freedoms}, which NumPy simulates"
        )
    started = time.perf_counter()
    made, known = compiled_equation(mechanism, tolerance, compact)
    compiling = 0.0 if known else time.perf_counter() - started
    started = time.perf_counter()
    motion = problem.equation.motion(problem.values[None], problem.frame)
    status = Status(int(motion.status[0]))
    if status != Status.OK:
        raise cannot_leave(problem, STATUS_MEANING[status])
    unit = float(np.sqrt(equivalent_inertia(mechanism, motion)[0]))
    tau = np.asarray(made.tau(problem.values[:, None]))[:, 0]
    sense = float(np.copysign(1.0, tau @ problem.frame[0]))
    run = integrate(
        made,
        mechanism,
        problem.values,
        problem.turns,
        sense * unit * float(problem.speed[0]),
        unit,
        (*problem.switches, problem.until),
        problem.equation.closed,
    )
    seconds = time.perf_counter() - started
    if not run.stretches:
        state = problem.equation.state(problem.values, problem.speed, problem.frame)
        if _has_value(problem, 0.0, state, problem.frame, problem.whole):
            raise EngineError(f"{mechanism.name}: at the start {NO_SERIES}")
        raise cannot_leave(problem, JUMPS)
    path = TaylorPath(run, sense)
    if run.end == "singularity":
        _need_crossing(problem, path)
    report = EngineReport("compiled", reason, compiling, seconds, len(run.starts), forecast)
    return Simulation(
        problem.equation,
        problem.driven,
        path,
        _events(problem, path),
        _end(problem, path),
        report,
        tolerance=tolerance,
    )


def _need_crossing(problem: Problem, path: TaylorPath) -> None:
    """Raise `EngineError` where no curves cross at the end of a path.

    Of redundant equations those that are independent where they were chosen are compiled;
    elsewhere they may depend on each other though the others hold the mechanism.
    """
    state = path.at(np.array([path.run.time])).states[0]
    equation = problem.equation
    if reciprocal_condition(equation.closure, state[: equation.variables]) > NO_CROSSING:
        raise EngineError(
            f"{equation.mechanism.name}: of its redundant equations those that were chosen "
            f"depend on each other at t = {path.run.time:.6g} s; use NumPy's "
            'simulate(engine="numpy"), or --engine numpy'
        )


def _events(problem: Problem, path: TaylorPath) -> tuple[Event, ...]:
    mechanism = problem.equation.mechanism
    run, names = path.run, [pair.name for pair in mechanism.pairs]
    found = [
        (
            each.t,
            each.kind,
            names[mechanism.variable_owners[each.variable]] if each.variable >= 0 else "",
        )
        for each in run.passages
        if each.kind != "singularity" and (each.t > 0.0 or each.kind in ("switch", "stop"))
    ]
    found += [(t, "switch", "") for t in problem.switches if t < run.time]
    found.sort(key=lambda item: item[0])
    if not found:
        return ()
    t = np.array([each[0] for each in found])
    traced = path.at(t)
    (driven,) = problem.driven
    q = traced.states[:, driven] + FULL_TURN * traced.turns[:, driven]
    return tuple(
        Event(kind, t, (float(q),), pair)
        for (t, kind, pair), q in zip(found, q, strict=True)
    )


def _end(problem: Problem, path: TaylorPath) -> SimulationEnd:
    run = path.run
    if run.end == "time":
        return SimulationEnd("time", problem.until, "the time asked for is over")
    if run.end == "stop":
        place = run.passages[-1].variable
        mechanism = problem.equation.mechanism
        traced = path.at(np.array([run.time]))
        value = traced.states[0, place] + FULL_TURN * traced.turns[0, place]
        name = mechanism.pairs[mechanism.variable_owners[place]].name
        return stop_end(run.time, name, float(value))
    if run.end == "singularity":
        return SimulationEnd("singularity", run.time, CROSSING)
    if run.end == "sticking":
        return SimulationEnd("sticking", run.time, STICKS)
    if run.end == "too_many":
        return SimulationEnd("too_fast", run.time, too_many(MOST_STEPS))
    traced = path.at(np.array([run.time]))
    whole = FULL_TURN * traced.turns[0]
    if run.end == "not_finite" and _has_value(
        problem, run.time, traced.states[0], traced.frames[0], whole
    ):
        return SimulationEnd("too_fast", run.time, NO_SERIES)
    why = f"no step is short enough; {JUMPS}"
    return given_up(problem.equation, path, run.time, why)


def _has_value(
    problem: Problem, t: float, state: Floats, frame: Floats, whole: Floats
) -> bool:
    """Return whether all loads have values at a state."""
    with np.errstate(all="ignore"):
        found = problem.equation.at(np.array([t]), state[None], frame, whole)
    return bool(np.all(np.isfinite(found.forces)))
