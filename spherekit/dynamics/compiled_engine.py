"""Simulates the motion of a mechanism by Taylor series of its compiled equation.

With several degrees of freedom, some pair variables are the coordinates of the equation. If
these coordinates cease to determine the motion, the simulation continues with other
coordinates.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, Names
from spherekit.dynamics.compiled_equation import (
    MAX_COARSE_STEP_TOLERANCE,
    MAX_STEP_TOLERANCE,
    compile_equation,
)
from spherekit.dynamics.coordinates import CoordinateMotion, reciprocal_condition
from spherekit.dynamics.generalised_forces import rates_by_time
from spherekit.dynamics.inertia import inertia_matrix
from spherekit.dynamics.multi_dof_equation import MAX_RATE_SQUARES, total_moment_of_inertia
from spherekit.dynamics.simulated_path import (
    CoordinateMomentumConversion,
    CurveMomentumConversion,
    MomentumConversion,
    PathStates,
    StatePath,
    make_taylor_path,
)
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
    NO_SERIES_MESSAGE,
    TIME_MESSAGE,
    EndKind,
    SimulationEnd,
    joint_limit_end,
    make_start_error,
    no_step_end,
    too_many_steps_message,
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
from spherekit.geometry.vectors import all_finite
from spherekit.status import STATUS_MEANING, Status
from spherekit.symbolic.taylor_integrator import CHATTERING_EVENT_COUNT

MAX_RECIPROCAL_CONDITION_AT_CROSSING = 1e-3
"""Largest `reciprocal_condition` at the end of a run that counts as a crossing of curves.

If closure equations are redundant, only some of them are compiled, and a run can also end
because these become dependent. Larger: such ends are reported as crossings. Smaller:
crossings are reported as failures of the equations.
"""

NEAR_CROSSING_RATIO = 1e-3
"""Replaces `CROSSING_RATIO` in runs whose steps have a coarse tolerance.

Steps of `MAX_COARSE_STEP_TOLERANCE` leave their curve of configurations by up to this
tolerance, and then miss a crossing by 3e-4. Such a run ends where this larger ratio is
reached, and another one with finer steps continues. Larger: more of the motion consists of
fine steps. Smaller: a crossing can be missed.
"""

MAX_START_RATE_RATIO = 0.5
"""Largest sum of squared rates for new coordinates, relative to `MAX_RATE_SQUARES`.

Larger: coordinates are changed again soon. Smaller: more configurations have no
coordinates.
"""

MIN_SINGULAR_VALUE = 1e-150
"""Bound that keeps reciprocal squares of singular values finite."""

NO_COORDINATES = (
    "no choice of pair variables determines the motion of all others accurately enough"
)
BY_NUMPY = 'use the NumPy engine: simulate(engine="numpy"), or --engine numpy'

STICKS = (
    "a load that is not smooth would reverse the motion at once, as dry friction does at "
    "rest, and sticking is not modelled; smooth the load, or simulate a shorter time"
)

TOO_MANY_EVENTS_MESSAGE = (
    f"loads switch too often: there were {CHATTERING_EVENT_COUNT} events; make the loads "
    "smooth, or simulate a shorter time"
)

END_BY_RUN_END: dict[RunEnd, tuple[EndKind, str]] = {
    "singularity": ("singularity", CROSSING_MESSAGE),
    "sticking": ("sticking", STICKS),
}
"""Kind and message of the end of a simulation, for ends that need no examination."""


@dataclass(frozen=True)
class CompiledRuns:
    """The successive runs of a simulation by Taylor series.

    A run is an integration of one compiled equation of motion. With one degree of freedom
    its coordinate is the arc length of the curve of configurations. With several degrees of
    freedom, its coordinates are some of the pair variables (joint angles). A new run begins
    when these coordinates no longer determine the motion well. Near a possible crossing of
    curves, a new run with a smaller tolerance of its steps begins.

    Attributes
    ----------
    runs
        The runs in order of time.
    momentum_conversions
        For each run an object that converts its states to those of a `Simulation`. The
        compiled engine and the simulation define the momenta in a state differently.
    compile_seconds
        Time that compiling took, s.
    """

    runs: list[TaylorRun]
    momentum_conversions: list[MomentumConversion]
    compile_seconds: float


def by_taylor_series(
    problem: Problem, tolerance: float, reason: str, forecast: Forecast | None = None
) -> Simulation:
    """Simulate a motion by Taylor series of the compiled equation of motion.

    The simulation consists of one or more runs (integrations). A new run begins when the
    equation of motion gets other coordinates or the steps get a smaller tolerance.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    tolerance
        Error of each step, relative to the largest element of the state.
    reason
        The reason why this engine was chosen, in words, for the report.
    forecast
        The computing times (s) that were expected of each engine. None if the user chose
        the engine.

    Raises
    ------
    EngineError
        If the mechanism can't be compiled, the equation fails during the motion, or a load
        has no Taylor series at the start.
    """
    started = time.perf_counter()
    # Motion at the start: rates of all pair variables (joint angles) per unit rate of each
    # coordinate. The `rate_weights` define the coordinates.
    motion = problem.equation.compute_motion(problem.values[None], problem.rate_weights)
    status = Status(int(motion.status[0]))
    if status != Status.OK:
        raise make_start_error(problem, STATUS_MEANING[status])
    compiled = _integrate(problem, motion, tolerance)
    # The momenta of a run belong to the coordinates of this run. The path converts them to
    # the momenta of a `Simulation`, which can have other coordinates.
    path = make_taylor_path(compiled.runs, compiled.momentum_conversions)
    last_run = compiled.runs[-1]
    seconds = time.perf_counter() - started - compiled.compile_seconds
    # An error is raised if the last run stopped elsewhere than at a crossing of curves of
    # configurations.
    if last_run.end == "singularity":
        _check_crossing(problem, last_run)
    return Simulation(
        equation=problem.equation,
        driven=problem.driven,
        path=path,
        events=_collect_events(problem, path, compiled.runs),
        end=_describe_end(problem, path, last_run),
        engine=EngineReport(
            name="compiled",
            reason=reason,
            compile_seconds=compiled.compile_seconds,
            seconds=seconds,
            steps=len(path.starts),
            forecast=forecast,
        ),
        tolerance=tolerance,
    )


def _integrate(
    problem: Problem, motion: CoordinateMotion, tolerance: float
) -> CompiledRuns:
    """Integrate the compiled equation of motion in one or more runs.

    With several degrees of freedom, some pair variables are the coordinates of the compiled
    equation. Where these coordinates cease to determine the motion well, a new run begins
    with other coordinates. Near a crossing of curves or surfaces of configurations, a new
    run begins with a finer tolerance.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    motion
        The configuration at the start (1 row), with its derivatives with respect to the
        coordinates of the problem.
    tolerance
        Error of each step, relative to the largest element of the state.
    """
    equation = problem.equation
    mechanism = equation.mechanism
    runs: list[TaylorRun] = []
    conversions: list[MomentumConversion] = []
    compile_seconds = 0.0
    values = problem.values
    turns = problem.turns
    variable_rates = rates_by_time(motion, problem.speed[None])[0]
    previous_run: TaylorRun | None = None
    closure_residual = 0.0
    max_tolerance = MAX_COARSE_STEP_TOLERANCE
    # One run for each choice of coordinates or tolerance.
    while True:
        # Compile the equation of these coordinates (none with one degree of freedom).
        coordinate_pairs = coordinates_at(problem, values)
        started = time.perf_counter()
        compiled_equation, was_cached = compile_equation(
            mechanism,
            tolerance=min(tolerance, max_tolerance),
            compact=problem.compact,
            coordinates=coordinate_pairs,
            values=values if coordinate_pairs else None,
        )
        if not was_cached:
            compile_seconds += time.perf_counter() - started

        # Convert the state at the start to that of the compiled equation.
        can_see_crossings = compiled_equation.tolerance <= MAX_STEP_TOLERANCE
        coordinate_variables = [mechanism.angles[pair] for pair in coordinate_pairs]
        rate_weights = np.eye(equation.variable_count)[coordinate_variables]
        if equation.freedoms == 1:
            momentum_unit = float(np.sqrt(inertia_matrix(mechanism, motion)[0, 0, 0]))
            # The momentum is positive in the direction of the homogeneous rates, which may
            # be opposite to the tangent of the problem.
            homogeneous_rates = compiled_equation.homogeneous_rates(problem.values[None])
            sense = float(
                np.copysign(1.0, homogeneous_rates[0, 0] @ problem.rate_weights[0])
            )
            momenta = sense * momentum_unit * problem.speed
            momentum_conversion: MomentumConversion = CurveMomentumConversion(
                compiled_equation, sense
            )
        else:
            # The momenta of the compiled equation are scaled rates of the coordinates,
            # which are pair variables.
            momentum_unit = float(np.sqrt(total_moment_of_inertia(mechanism)))
            momenta = momentum_unit * variable_rates[coordinate_variables]
            momentum_conversion = CoordinateMomentumConversion(equation, rate_weights)

        # Integrate, from the end of the previous run, if there is one.
        integration = TaylorIntegration(
            compiled_equation,
            mechanism,
            RunStart(
                values=values,
                turns=turns,
                momenta=momenta,
                momentum_unit=momentum_unit,
                previous_run=previous_run,
                closure_residual=closure_residual,
            ),
            project=equation.project_once,
            crossing_ratio=CROSSING_RATIO if can_see_crossings else NEAR_CROSSING_RATIO,
        )
        targets = [
            t for t in problem.targets if previous_run is None or t > previous_run.end_time
        ]
        run = integration.run(targets)
        # A later run without a step ends the simulation where the run before ended.
        if not run.segments and runs:
            break
        _check_first_step(problem, run)
        runs.append(run)
        conversions.append(momentum_conversion)
        # The run that follows has a finer tolerance near a crossing, or other coordinates.
        if run.end == "singularity" and not can_see_crossings:
            max_tolerance = MAX_STEP_TOLERANCE
        elif run.end != "coordinates":
            break

        # The configuration and the rates at the end of this run are the start of the next.
        last_state = run.last_state
        turns = run.segments[-1].turns
        values, closure_residual = equation.project_once(
            last_state[: equation.variable_count]
        )
        motion = equation.compute_motion(values[None], rate_weights)
        speed = last_state[None, equation.momenta] / momentum_unit
        variable_rates = rates_by_time(motion, speed)[0]
        previous_run = run
    return CompiledRuns(runs, conversions, compile_seconds)


def coordinates_at(problem: Problem, values: Floats) -> Names:
    """Return names of the R pairs (revolute joints) that become coordinates of a run.

    A run is an integration with one choice of coordinates. Coordinates determine the motion
    well if no other joint angle moves much faster. For a measure, each coordinate in turn
    moves at unit rate while the others rest. The measure is the sum of the squares of the
    rates of all pair variables in these motions. A run ends when this sum exceeds
    `MAX_RATE_SQUARES`. At the start of a run the sum must be below `MAX_START_RATE_RATIO`
    times this limit, so that the run lasts for some time.

    The inputs are chosen if their sum is below this limit. If not, the R pairs with the
    smallest sum are chosen.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    values
        (variables,) pair variables (rad) of a configuration in which all loops close.

    Raises
    ------
    EngineError
        If no R pairs determine the motion well enough.
    """
    equation = problem.equation
    if equation.freedoms == 1:
        # The coordinate is the arc length of the curve of configurations, not a pair.
        return ()
    pair_of_variable = {v: pair for pair, v in equation.mechanism.angles.items()}
    jacobian = equation.closure.linearise(values[None]).jacobian[0]
    # The last right singular vectors of the Jacobian are an orthonormal basis (m,
    # variables) of the velocities that keep the loops closed.
    _, _, right_vectors = np.linalg.svd(jacobian)
    velocity_basis = right_vectors[-equation.freedoms :]

    def are_suitable(variables: tuple[int, ...]) -> bool:
        """Return whether these variables can be coordinates at the start of a run."""
        rate_squares = _sum_rate_squares(velocity_basis, variables)
        return rate_squares < MAX_START_RATE_RATIO * MAX_RATE_SQUARES

    variables = problem.driven  # the variables of the inputs
    if not are_suitable(variables):
        # The variables with the smallest sum among all combinations of R pairs.
        variables = min(
            combinations(sorted(pair_of_variable), equation.freedoms),
            key=lambda choice: _sum_rate_squares(velocity_basis, choice),
        )
    if are_suitable(variables):
        return tuple(pair_of_variable[v] for v in variables)
    # The second argument is advice: use the other engine.
    raise EngineError(f"{equation.mechanism.name}: {NO_COORDINATES}", BY_NUMPY)


def _sum_rate_squares(velocity_basis: Floats, variables: tuple[int, ...]) -> float:
    """Return the sum of squares of all rates, per unit rate of each of m chosen variables.

    A small sum means that the chosen pair variables (joint angles) are good coordinates:
    no other variable moves much faster.

    Let V be the velocity basis, and V_c its columns of the chosen variables. The rates of
    all variables per unit rate of each chosen variable are the rows of V_c^-1 V. The rows
    of V are orthonormal, so the elements of V_c^-1 have the same sum of squares. This sum
    is the sum of 1 / s^2 over the singular values s of V_c.

    Parameters
    ----------
    velocity_basis
        (m, variables) orthonormal basis of the velocities with which the loops stay closed.
    variables
        Indices of the m chosen variables.
    """
    chosen_columns = velocity_basis[:, list(variables)]
    singular_values = np.linalg.svd(chosen_columns, compute_uv=False)
    return float(np.sum(1.0 / np.maximum(singular_values, MIN_SINGULAR_VALUE) ** 2))


def _check_first_step(problem: Problem, run: TaylorRun) -> None:
    """Raise an error if a motion does not have even a first step."""
    if run.segments:
        return
    state = problem.equation.make_state(problem.values, problem.speed, problem.rate_weights)
    if _are_loads_finite(problem, 0.0, state, problem.rate_weights, problem.turn_angles):
        raise EngineError(
            f"{problem.equation.mechanism.name}: at the start {NO_SERIES_MESSAGE}"
        )
    raise make_start_error(problem, JUMP_MESSAGE)


def _check_crossing(problem: Problem, run: TaylorRun) -> None:
    """Raise `EngineError` if a run ended at a configuration that is no crossing.

    A run (integration) ends where its compiled closure equations become dependent, as at a
    crossing of curves of configurations. If constraints are redundant, some equations are
    not compiled. The compiled equations can then become dependent at a configuration where
    all equations together still determine the motion.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    run
        A run that ended because its equations became dependent.
    """
    equation = problem.equation
    values = run.last_state[: equation.variable_count]
    # The reciprocal condition number of all closure equations is 0 at a crossing.
    reciprocal = reciprocal_condition(equation.closure, values, equation.freedoms)
    if reciprocal > MAX_RECIPROCAL_CONDITION_AT_CROSSING:
        # The second argument is advice: use the other engine.
        raise EngineError(
            f"{equation.mechanism.name}: its closure equations are redundant, and the "
            "equations that were chosen as independent become dependent at t = "
            f"{run.end_time:.6g} s",
            BY_NUMPY,
        )


def _collect_events(
    problem: Problem, path: StatePath, runs: Sequence[TaylorRun]
) -> tuple[Event, ...]:
    """Return the events of all runs (integrations) of a simulation in order of time.

    Parameters
    ----------
    problem
        The problem. Its `switches` are times (s) at which loads jump or have kinks, known
        before the simulation.
    path
        The states of the simulation, from which the inputs at each event are computed.
    runs
        The runs of which the simulation consists.
    """
    # The R pair (revolute joint) of each index of a pair variable.
    pair_of_variable = {v: pair for pair, v in problem.equation.mechanism.angles.items()}
    # Time (s), kind, and index of the pair variable; -1 for an event of no pair.
    events: list[tuple[float, EventKind, int]] = []
    for run in runs:
        for t, kind, variable in run.events:
            # A singularity is reported as the end of the simulation. A change of
            # coordinates is not reported.
            if kind == "singularity" or kind == "coordinates":
                continue
            # At t = 0, rest or a dead centre only describe the start that the user chose. A
            # switch (abrupt change of a load) or a joint limit changes the motion even
            # then.
            if t > 0.0 or kind in ("switch", "joint_limit"):
                events.append((t, kind, variable))
    # The events of runs do not include changes of loads at times known before.
    for t in problem.switches:
        if t < runs[-1].end_time:
            events.append((t, "switch", -1))
    events.sort(key=lambda event: event[0])
    # The inputs at the times of all events.
    times = np.array([t for t, *_ in events])
    inputs = path.evaluate(times).values[:, problem.driven]
    return tuple(
        Event(kind, t, tuple(q.tolist()), pair_of_variable.get(variable, ""))
        for (t, kind, variable), q in zip(events, inputs, strict=True)
    )


def _describe_end(problem: Problem, path: StatePath, run: TaylorRun) -> SimulationEnd:
    """Return the reason and the time of the end of a simulation, for the user.

    `END_BY_RUN_END` has the reasons that need no further examination. The others are:

    - The simulated time is over.
    - There are too many steps, or too many events.
    - A pair (joint) reaches a limit.
    - The integration overflows, but the loads themselves are finite: a load changes too
      fast for a Taylor series, for example because of an exp.
    - Steps become too short: a load jumps or grows without bound, or the inertia vanishes.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    path
        The states of the simulation.
    run
        The last of the runs (integrations) of which the simulation consists.
    """
    if run.end == "time":
        return SimulationEnd("time", problem.until, TIME_MESSAGE)
    if run.end in END_BY_RUN_END:
        kind, message = END_BY_RUN_END[run.end]
        return SimulationEnd(kind, run.end_time, message)
    if run.end == "too_many":
        return SimulationEnd("too_fast", run.end_time, _describe_excess(run))
    end_states = path.evaluate(np.array([run.end_time]))  # one row
    if run.end == "joint_limit":
        return _describe_joint_limit(problem, end_states, run)
    if run.end == "not_finite" and _are_loads_finite(
        problem,
        run.end_time,
        state=end_states.states[0],
        # The momenta in the state belong to coordinates, one for each degree of freedom.
        # These weights define the coordinates: the rate of a coordinate is a weighted sum
        # of the rates of the pair variables.
        rate_weights=end_states.rate_weights[0],
        whole_turns=TURN * end_states.turns[0],
    ):
        return SimulationEnd("too_fast", run.end_time, NO_SERIES_MESSAGE)
    # `no_step_end` uses this message unless the inertia vanishes.
    message = f"no step is short enough; {JUMP_MESSAGE}"
    return no_step_end(problem.equation, path, run.end_time, message)


def _describe_excess(run: TaylorRun) -> str:
    """Return the message of a run that ended after too many steps or events."""
    # Too many events end a run at a switch only.
    has_many_events = len(run.events) >= CHATTERING_EVENT_COUNT
    if has_many_events and run.events[-1][1] == "switch":
        return TOO_MANY_EVENTS_MESSAGE
    return too_many_steps_message(MAX_TAYLOR_STEPS)


def _describe_joint_limit(
    problem: Problem, end_states: PathStates, run: TaylorRun
) -> SimulationEnd:
    """Return why a simulation ended: a joint limit, the last event of an integration.

    `end_states` has one row, the state at the end.
    """
    _, _, variable = run.events[-1]
    mechanism = problem.equation.mechanism
    name = mechanism.pairs[mechanism.variable_owners[variable]].name
    return joint_limit_end(run.end_time, name, float(end_states.values[0, variable]))


def _are_loads_finite(
    problem: Problem, t: float, state: Floats, rate_weights: Floats, whole_turns: Floats
) -> bool:
    """Return whether all loads have finite values at a state.

    The engine integrates by Taylor series, and stops where a series is not finite. The
    result decides the message: either a load has no finite value, or it has one but no
    Taylor series.

    Parameters
    ----------
    problem
        The mechanism with its loads.
    t
        Time, s.
    state
        (states,) pair variables (joint angles, rad), m momenta, and works of loads. Each of
        the m coordinates has a momentum, where m is the number of degrees of freedom.
    rate_weights
        (m, variables) weights W: the rates of the coordinates are W @ rates of the pair
        variables.
    whole_turns
        (variables,) multiples of 2 pi (rad) that were subtracted from the pair variables in
        the state. Loads may depend on them.
    """
    with np.errstate(all="ignore"):
        dynamics = problem.equation.evaluate(
            np.array([t]), state[None], rate_weights, whole_turns
        )
    load_forces = dynamics.forces  # generalised forces of all loads
    return bool(all_finite(load_forces))
