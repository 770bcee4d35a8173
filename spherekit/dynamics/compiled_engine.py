"""The direct problem by Taylor series of the compiled equation of motion."""

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, combinations

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import STATUS_MEANING, TURN, Status
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    equivalent_inertia,
    reciprocal_condition,
)
from spherekit.dynamics.forces import rates_by_time
from spherekit.dynamics.path import (
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
from spherekit.engine.equation import (
    COARSEST,
    LOOSEST,
    CompiledEquation,
    Coordinates,
    compiled_equation,
)
from spherekit.engine.integration import CROSSED, MOST_STEPS, Integration, Run
from spherekit.engine.system import STEEPEST, mass_size
from spherekit.errors import EngineError, PlanError
from spherekit.sphere.rotation import all_finite

NO_CROSSING = 1e-3
"""Less belongs to a crossing of curves, see `reciprocal_condition`."""

NEAR = 1e-3
"""Where independence is less than this part of its largest, steps are made fine enough to
see a crossing; a configuration off its curve by `COARSEST` misses one by 3e-4."""

NO_COORDINATES = "no pair variables say surely enough how all others move"
BY_NUMPY = 'use NumPy\'s simulate(engine="numpy"), or --engine numpy'

ENOUGH = 0.5
"""Part of `STEEPEST` with which coordinates may be taken."""

STICKS = (
    "a load that is not smooth would turn back at once, as dry friction does at rest; "
    "sticking is not modelled: smooth the load, or end here"
)


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
    solve = _along_curve if problem.equation.freedoms == 1 else _by_coordinates
    compiling, started = 0.0, time.perf_counter()

    def compiled(coordinates: Coordinates | None, most: float) -> CompiledEquation:
        nonlocal compiling
        before = time.perf_counter()
        step = min(tolerance, most)
        made, reused = compiled_equation(
            problem.equation.mechanism, step, compact, coordinates=coordinates
        )
        compiling += 0.0 if reused else time.perf_counter() - before
        return made

    motion = problem.equation.motion(problem.values[None], problem.frame)
    status = Status(int(motion.status[0]))
    if status != Status.OK:
        raise cannot_leave(problem, STATUS_MEANING[status])
    runs, frames = solve(problem, motion, compiled)
    path, run = through_runs(runs, frames), runs[-1]
    seconds = time.perf_counter() - started - compiling
    if run.end == "singularity":
        _need_crossing(problem, run)
    report = EngineReport(
        "compiled", reason, compiling, seconds, len(path.starts), forecast
    )
    return Simulation(
        problem.equation,
        problem.driven,
        path,
        _events(problem, path, runs),
        _end(problem, path, run),
        report,
        tolerance=tolerance,
    )


Compiled = Callable[[Coordinates | None, float], CompiledEquation]
"""The equation in some coordinates, with steps for a tolerance or less."""


def _along_curve(
    problem: Problem, motion: CoordinateMotion, compiled: Compiled
) -> tuple[list[Run], list[Frames]]:
    """Return the run of one freedom, and its frames."""
    mechanism = problem.equation.mechanism
    made = compiled(None, LOOSEST)
    unit = float(np.sqrt(equivalent_inertia(mechanism, motion)[0]))
    tau = made.rates(problem.values[None])[0, 0]
    sense = float(np.copysign(1.0, tau @ problem.frame[0]))
    run = Integration(
        made,
        mechanism,
        problem.values,
        problem.turns,
        sense * unit * problem.speed,
        unit,
        problem.equation.closed,
    ).run((*problem.switches, problem.until))
    _need_stretches(problem, run)
    return [run], [on_curve(made, sense)]


def _by_coordinates(
    problem: Problem, motion: CoordinateMotion, compiled: Compiled
) -> tuple[list[Run], list[Frames]]:
    """Return runs of several freedoms, by other pair variables where it has to be."""
    equation = problem.equation
    root = float(np.sqrt(mass_size(equation.mechanism)))
    runs: list[Run] = []
    framed: list[Frames] = []
    values, turns = problem.values, problem.turns
    rates = rates_by_time(motion, problem.speed[None])[0]
    before: Run | None = None
    gap, most = 0.0, COARSEST
    while True:
        made, places = _coordinates(problem, values, compiled, most)
        fine = made.tolerance <= LOOSEST
        targets = [t for t in problem.switches if before is None or t > before.time]
        run = Integration(
            made,
            equation.mechanism,
            values,
            turns,
            root * rates[list(places)],
            root,
            equation.closed,
            CROSSED if fine else NEAR,
            before,
            gap,
        ).run((*targets, problem.until))
        if not run.stretches and runs:
            break
        _need_stretches(problem, run)
        frame = np.eye(equation.variables)[list(places)]
        runs.append(run)
        framed.append(in_coordinates(equation, frame))
        if run.end == "singularity" and not fine:
            most = LOOSEST
        elif run.end != "coordinates":
            break
        state, turns = run.last, run.stretches[-1].turns
        values, gap = equation.closed(state[: equation.variables])
        along = equation.motion(values[None], frame)
        rates = rates_by_time(along, state[None, equation.momenta] / root)[0]
        before = run
    return runs, framed


def first_of(problem: Problem) -> Coordinates | None:
    """Return the coordinates that a run begins with, None of one freedom."""
    if problem.equation.freedoms == 1:
        return None
    coordinates = next(_candidates(problem, problem.values), None)
    if coordinates is None:
        raise EngineError(f"{problem.equation.mechanism.name}: {NO_COORDINATES}", BY_NUMPY)
    return coordinates


def _coordinates(
    problem: Problem, values: Floats, compiled: Compiled, most: float
) -> tuple[CompiledEquation, tuple[int, ...]]:
    """Return the equation in pair variables that say how all others move, and these."""
    why = NO_COORDINATES
    for coordinates in _candidates(problem, values):
        angles = problem.equation.mechanism.angles
        try:
            return compiled(coordinates, most), tuple(
                angles[pair] for pair in coordinates.pairs
            )
        except PlanError as fault:
            why = str(fault)
    raise EngineError(f"{problem.equation.mechanism.name}: {why}", BY_NUMPY)


def _candidates(problem: Problem, values: Floats) -> Iterator[Coordinates]:
    """Yield coordinates at a configuration.

    The inputs, if they say well enough how all variables move, then R pairs whose variables
    do, the best first.
    """
    equation, driven = problem.equation, problem.driven
    mechanism = equation.mechanism
    jacobian = equation.closure.at(values[None]).jacobian[0]
    free = np.linalg.svd(jacobian)[2][-equation.freedoms :]

    def spread(places: tuple[int, ...]) -> float:
        sizes = np.linalg.svd(free[:, list(places)], compute_uv=False)
        return float(np.sum(1.0 / np.maximum(sizes, 1e-150) ** 2))

    def others() -> Iterator[tuple[int, ...]]:
        angles = sorted(mechanism.angles.values())
        yield from sorted(combinations(angles, equation.freedoms), key=spread)

    for places in chain([driven], others()):
        if spread(places) < ENOUGH * STEEPEST:
            pairs = (mechanism.pairs[mechanism.variable_owners[v]].name for v in places)
            yield Coordinates(tuple(pairs), values, driven)


def _need_stretches(problem: Problem, run: Run) -> None:
    """Raise an error where a motion has not even a first step."""
    if run.stretches:
        return
    state = problem.equation.state(problem.values, problem.speed, problem.frame)
    if _has_value(problem, 0.0, state, problem.frame, problem.whole):
        raise EngineError(f"{problem.equation.mechanism.name}: at the start {NO_SERIES}")
    raise cannot_leave(problem, JUMPS)


def _need_crossing(problem: Problem, run: Run) -> None:
    """Raise `EngineError` where no curves cross at the end of a run.

    Of redundant equations those that are independent where they were chosen are compiled;
    elsewhere they may depend on each other though the others hold the mechanism.
    """
    equation = problem.equation
    values, freedoms = run.last[: equation.variables], equation.freedoms
    if reciprocal_condition(equation.closure, values, freedoms) > NO_CROSSING:
        raise EngineError(
            f"{equation.mechanism.name}: of its redundant equations those that were chosen "
            f"depend on each other at t = {run.time:.6g} s",
            BY_NUMPY,
        )


def _events(problem: Problem, path: StatePath, runs: Sequence[Run]) -> tuple[Event, ...]:
    mechanism = problem.equation.mechanism
    names = [pair.name for pair in mechanism.pairs]
    passages = [
        (t, kind, names[mechanism.variable_owners[place]] if place >= 0 else "")
        for run in runs
        for t, kind, place in run.passages
        if kind not in ("singularity", "coordinates")
        and (t > 0.0 or kind in ("switch", "stop"))
    ]
    passages += [(t, "switch", "") for t in problem.switches if t < runs[-1].time]
    passages.sort(key=lambda item: item[0])
    if not passages:
        return ()
    t = np.array([passage[0] for passage in passages])
    traced = path.at(t)
    driven = list(problem.driven)
    inputs = traced.states[:, driven] + TURN * traced.turns[:, driven]
    return tuple(
        Event(kind, t, tuple(q.tolist()), pair)  # type: ignore[arg-type]
        for (t, kind, pair), q in zip(passages, inputs, strict=True)
    )


def _end(problem: Problem, path: StatePath, run: Run) -> SimulationEnd:
    if run.end == "time":
        return SimulationEnd("time", problem.until, "the time asked for is over")
    if run.end == "stop":
        place = run.passages[-1][2]
        mechanism = problem.equation.mechanism
        traced = path.at(np.array([run.time]))
        value = traced.states[0, place] + TURN * traced.turns[0, place]
        name = mechanism.pairs[mechanism.variable_owners[place]].name
        return stop_end(run.time, name, float(value))
    if run.end == "singularity":
        return SimulationEnd("singularity", run.time, CROSSING)
    if run.end == "sticking":
        return SimulationEnd("sticking", run.time, STICKS)
    if run.end == "too_many":
        return SimulationEnd("too_fast", run.time, too_many(MOST_STEPS))
    traced = path.at(np.array([run.time]))
    whole = TURN * traced.turns[0]
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
        dynamics = problem.equation.at(np.array([t]), state[None], frame, whole)
    return bool(all_finite(dynamics.forces))
