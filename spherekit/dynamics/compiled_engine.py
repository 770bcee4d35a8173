"""The direct problem by Taylor series of the compiled equation of motion."""

import time
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, Names
from spherekit.dynamics.compiled_equation import (
    MAX_COARSE_STEP_TOLERANCE,
    MAX_STEP_TOLERANCE,
    compile_equation,
)
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    inertia_matrix,
    reciprocal_condition,
)
from spherekit.dynamics.generalised_forces import rates_by_time
from spherekit.dynamics.multi_dof_equation import MAX_RATE_SQUARES, total_moment_of_inertia
from spherekit.dynamics.simulated_path import (
    Frames,
    StatePath,
    in_coordinates,
    on_curve,
    through_runs,
)
from spherekit.dynamics.simulation import (
    CROSSING,
    JUMPS,
    NO_SERIES,
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
from spherekit.dynamics.simulation_start import Problem
from spherekit.dynamics.taylor_integration import (
    CROSSING_RATIO,
    MAX_TAYLOR_STEPS,
    RunEnd,
    RunStart,
    TaylorIntegration,
    TaylorRun,
)
from spherekit.errors import EngineError
from spherekit.geometry.rotation import all_finite
from spherekit.status import STATUS_MEANING, Status

NO_CROSSING = 1e-3
"""Less belongs to a crossing of curves, see `reciprocal_condition`."""

NEAR = 1e-3
"""Where independence is less than this part of its largest, steps are made fine enough to
see a crossing; a configuration off its curve by `MAX_COARSE_STEP_TOLERANCE` misses one by
3e-4."""

NO_COORDINATES = "no pair variables say surely enough how all others move"
BY_NUMPY = 'use NumPy\'s simulate(engine="numpy"), or --engine numpy'

ENOUGH = 0.5
"""Part of `MAX_RATE_SQUARES` with which coordinates may be taken."""

STICKS = (
    "a load that is not smooth would turn back at once, as dry friction does at rest; "
    "sticking is not modelled: smooth the load, or end here"
)

SAID: dict[RunEnd, tuple[EndKind, str]] = {
    "singularity": ("singularity", CROSSING),
    "sticking": ("sticking", STICKS),
    "too_many": ("too_fast", too_many(MAX_TAYLOR_STEPS)),
}


def by_taylor_series(
    problem: Problem, tolerance: float, reason: str, forecast: Forecast | None = None
) -> Simulation:
    """Return the motion of a problem.

    Parameters
    ----------
    tolerance
        See `spherekit.dynamics.compiled_equation.compile_equation`.
    reason, forecast
        Why it is this engine that runs.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled, or not on all of the way, or a load has no
        series at the start.
    """
    started = time.perf_counter()
    motion = problem.equation.compute_motion(problem.values[None], problem.frame)
    status = Status(int(motion.status[0]))
    if status != Status.OK:
        raise cannot_leave(problem, STATUS_MEANING[status])
    runs, frames, compiling = _run(problem, motion, tolerance)
    path = through_runs(runs, frames)
    run = runs[-1]
    seconds = time.perf_counter() - started - compiling
    if run.end == "singularity":
        _need_crossing(problem, run)
    return Simulation(
        problem.equation,
        problem.driven,
        path,
        _events(problem, path, runs),
        _end(problem, path, run),
        EngineReport("compiled", reason, compiling, seconds, len(path.starts), forecast),
        tolerance=tolerance,
    )


def _run(
    problem: Problem, motion: CoordinateMotion, tolerance: float
) -> tuple[list[TaylorRun], list[Frames], float]:
    """Return the runs, of several freedoms by other pair variables where it has to be.

    With their frames, and what compiling took (s).
    """
    equation = problem.equation
    mechanism = problem.equation.mechanism
    runs: list[TaylorRun] = []
    framed: list[Frames] = []
    values, turns = problem.values, problem.turns
    rates = rates_by_time(motion, problem.speed[None])[0]
    before: TaylorRun | None = None
    gap, most, compiling = 0.0, MAX_COARSE_STEP_TOLERANCE, 0.0
    while True:
        pairs = coordinates_at(problem, values)
        started = time.perf_counter()
        finest, held = min(tolerance, most), values if pairs else None
        made, reused = compile_equation(mechanism, finest, problem.compact, pairs, held)
        compiling += 0.0 if reused else time.perf_counter() - started
        places = [mechanism.angles[pair] for pair in pairs]
        fine = made.tolerance <= MAX_STEP_TOLERANCE
        frame = np.eye(equation.variable_count)[places]
        if equation.freedoms == 1:
            unit = float(np.sqrt(inertia_matrix(mechanism, motion)[0, 0, 0]))
            along = made.homogeneous_rates(problem.values[None])[0, 0] @ problem.frame[0]
            sense = float(np.copysign(1.0, along))
            momenta, frames = sense * unit * problem.speed, on_curve(made, sense)
        else:
            unit = float(np.sqrt(total_moment_of_inertia(mechanism)))
            momenta, frames = unit * rates[places], in_coordinates(equation, frame)
        run = TaylorIntegration(
            made,
            mechanism,
            RunStart(values, turns, momenta, unit, before, gap),
            equation.project_once,
            CROSSING_RATIO if fine else NEAR,
        ).run([t for t in problem.targets if before is None or t > before.end_time])
        if not run.segments and runs:
            break
        _need_segments(problem, run)
        runs.append(run)
        framed.append(frames)
        if run.end == "singularity" and not fine:
            most = MAX_STEP_TOLERANCE
        elif run.end != "coordinates":
            break
        state, turns = run.last_state, run.segments[-1].turns
        values, gap = equation.project_once(state[: equation.variable_count])
        motion = equation.compute_motion(values[None], frame)
        rates = rates_by_time(motion, state[None, equation.momenta] / unit)[0]
        before = run
    return runs, framed, compiling


def coordinates_at(problem: Problem, values: Floats) -> Names:
    """Return R pairs whose variables say how all others move; none of one freedom.

    The inputs, if they say it well enough, else R pairs whose variables do best.

    Raises
    ------
    EngineError
        If none do.
    """
    equation = problem.equation
    if equation.freedoms == 1:
        return ()
    pairs = {v: pair for pair, v in equation.mechanism.angles.items()}
    jacobian = equation.closure.at(values[None]).jacobian[0]
    free = np.linalg.svd(jacobian)[2][-equation.freedoms :]

    def spread(places: tuple[int, ...]) -> float:
        sizes = np.linalg.svd(free[:, list(places)], compute_uv=False)
        return float(np.sum(1.0 / np.maximum(sizes, 1e-150) ** 2))

    best = min(combinations(sorted(pairs), equation.freedoms), key=spread)
    for places in (problem.driven, best):
        if spread(places) < ENOUGH * MAX_RATE_SQUARES:
            return tuple(pairs[v] for v in places)
    raise EngineError(f"{equation.mechanism.name}: {NO_COORDINATES}", BY_NUMPY)


def _need_segments(problem: Problem, run: TaylorRun) -> None:
    """Raise an error where a motion has not even a first step."""
    if run.segments:
        return
    state = problem.equation.make_state(problem.values, problem.speed, problem.frame)
    if _has_value(problem, 0.0, state, problem.frame, problem.whole):
        raise EngineError(f"{problem.equation.mechanism.name}: at the start {NO_SERIES}")
    raise cannot_leave(problem, JUMPS)


def _need_crossing(problem: Problem, run: TaylorRun) -> None:
    """Raise `EngineError` where no curves cross at the end of a run.

    Of redundant equations those that are independent where they were chosen are compiled;
    elsewhere they may depend on each other though the others hold the mechanism.
    """
    equation = problem.equation
    values = run.last_state[: equation.variable_count]
    if reciprocal_condition(equation.closure, values, equation.freedoms) > NO_CROSSING:
        raise EngineError(
            f"{equation.mechanism.name}: of its redundant equations those that were chosen "
            f"depend on each other at t = {run.end_time:.6g} s",
            BY_NUMPY,
        )


def _events(
    problem: Problem, path: StatePath, runs: Sequence[TaylorRun]
) -> tuple[Event, ...]:
    pairs = {v: pair for pair, v in problem.equation.mechanism.angles.items()}
    passages: list[tuple[float, EventKind, int]] = [
        (t, kind, place)
        for run in runs
        for t, kind, place in run.events
        if kind != "singularity"
        and kind != "coordinates"
        and (t > 0.0 or kind in ("switch", "joint_limit"))
    ]
    passages += [(t, "switch", -1) for t in problem.switches if t < runs[-1].end_time]
    passages.sort(key=lambda passage: passage[0])
    inputs = path.at(np.array([t for t, *_ in passages])).values[:, problem.driven]
    return tuple(
        Event(kind, t, tuple(q.tolist()), pairs.get(place, ""))
        for (t, kind, place), q in zip(passages, inputs, strict=True)
    )


def _end(problem: Problem, path: StatePath, run: TaylorRun) -> SimulationEnd:
    if run.end == "time":
        return SimulationEnd("time", problem.until, OVER)
    if run.end in SAID:
        kind, words = SAID[run.end]
        return SimulationEnd(kind, run.end_time, words)
    traced = path.at(np.array([run.end_time]))
    if run.end == "joint_limit":
        place = run.events[-1][2]
        mechanism = problem.equation.mechanism
        name = mechanism.pairs[mechanism.variable_owners[place]].name
        return stop_end(run.end_time, name, float(traced.values[0, place]))
    if run.end == "not_finite" and _has_value(
        problem, run.end_time, traced.states[0], traced.frames[0], TURN * traced.turns[0]
    ):
        return SimulationEnd("too_fast", run.end_time, NO_SERIES)
    why = f"no step is short enough; {JUMPS}"
    return given_up(problem.equation, path, run.end_time, why)


def _has_value(
    problem: Problem, t: float, state: Floats, frame: Floats, whole: Floats
) -> bool:
    """Return whether all loads have values at a state."""
    with np.errstate(all="ignore"):
        dynamics = problem.equation.evaluate(np.array([t]), state[None], frame, whole)
    return bool(all_finite(dynamics.forces))
