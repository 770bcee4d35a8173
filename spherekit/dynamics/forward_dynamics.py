"""Forward dynamics: the motion of a mechanism from its start and its loads."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from spherekit.argument_validation import checked
from spherekit.dynamics.compiled_engine import by_taylor_series, coordinates_at
from spherekit.dynamics.compiled_equation import (
    MAX_STEP_TOLERANCE,
    estimate_compile_seconds,
)
from spherekit.dynamics.lift_off import end_at_lift_off
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.dynamics.simulation import Forecast, Simulation
from spherekit.dynamics.simulation_end import NO_SERIES_MESSAGE
from spherekit.dynamics.simulation_start import PoseStart, Problem, Torques, prepare
from spherekit.errors import EngineError, PlanError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings, StartGiven, read_start
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.load_dependence import has_smooth_loads
from spherekit.mechanism.mechanism import Mechanism
from spherekit.progress import announce
from spherekit.quantity import AngleUnit
from spherekit.symbolic.compiler import ENGINE_CHOICES, EngineChoice
from spherekit.wording import listing

MIN_TOLERANCE_BY_ENGINE = {"numpy": 1e-13, "compiled": 1e-15}
"""Smallest tolerance (rad) of each engine. Rounding errors are larger than smaller ones."""

MAX_TOLERANCE_RAD = 1e-2
"""Largest tolerance of a simulation."""

CHECK_MIN_TOLERANCE_RATIO = 0.1
"""Smallest tolerance of a simulation that checks another one, relative to the smallest one
that users can choose (`MIN_TOLERANCE_BY_ENGINE`). Rounding errors may be larger than it."""

CHECK_TOLERANCE_RATIO = 1e-2
"""Tolerance of a simulation that checks another one, relative to that of the other one.

Larger: the error is estimated less reliably. Smaller: checks take longer.
"""

COMPILED_SPEEDUP = 200.0
"""Ratio of the solving time of NumPy to that of the compiled engine, without compiling.

Larger: short simulations are compiled although NumPy would finish sooner. Smaller: long
ones are compiled too late.
"""


@checked(SolveError)
def simulate(
    mechanism: AnyMechanism,
    start: StartGiven | PoseStart,
    until: float,
    *,
    torque: Torques | None = None,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int = 0,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
    crossings: Crossings = "end",
    check: bool = False,
    engine: EngineChoice = "auto",
    compact: bool = True,
    seen: Callable[[Simulation], None] | None = None,
    angle_unit: AngleUnit = "rad",
) -> Simulation:
    """Return the motion of a mechanism with any number of inputs under its loads.

    Parameters
    ----------
    mechanism
        A mechanism with masses. Its loads act, and its joint limits end the simulation.
    start
        Variable (rad) and rate (rad/s) of the input at t = 0 in an assembly mode, also as
        ``{"q": 0.4, "dq": 1.2}`` or ``"q=20deg,dq=1rad/s"``, or a whole configuration. In a
        text, a number without a unit is in the unit of the mechanism's file.
    until
        Time (s) at which to end.
    torque
        The driving torque (N m) at the input, if there is one: a number, an expression
        such as ``"10*sin(2*t) - dtheta_21"``, or a function f(t, q, dq) of the time and of
        the variable and the rate of the input, which the NumPy engine calls. With several
        inputs a mapping from their names. An input without a torque turns freely.
    input_pair
        The driven R pairs, by default the inputs of the mechanism.
    assembly_mode
        Number of the assembly mode at the start.
    tolerance
        Error of the pair variables (rad) for which steps are chosen: at most 1e-2, and at
        least 1e-15, or 1e-13 with NumPy. In motions that depend strongly on their start,
        errors grow beyond it; see `check`.
    switches
        Times (s) at which expressions of loads have kinks. The kinks of torque tables need
        not be given.
    crossings
        What happens where curves or surfaces of configurations cross. With ``"end"`` the
        simulation ends there. With ``"pass"`` it continues straight on, as rigid links
        without play do. Only the NumPy engine can continue.
    check
        Whether to repeat the simulation with a hundredth of the tolerance, and to compare
        both. If they differ by more than the tolerance, or if the power is not balanced,
        the more accurate simulation is kept and compared with a still more accurate one.
        `Simulation.missed` tells whether the tolerance is still missed.
    engine
        ``"numpy"``, ``"compiled"`` or ``"auto"``. The last one takes the engine that is
        expected to finish first, or the only engine that supports all loads. The result
        says which engine was taken, and why.
    compact
        Whether the compiled engine uses the compact mode of heyoka, the library that
        compiles and solves its equations. Without this mode, compiling takes longer, and
        solving takes about a third less time.
    seen
        A function that is called with the simulation so far, every few seconds while the
        NumPy engine solves it. It is never called if the mechanism has one-sided contacts:
        only afterwards is it known whether the lift-off of a contact ends the simulation.
    angle_unit
        Unit of the numbers of a mapping `start`, ``"rad"`` or ``"deg"`` (and per s). The
        objects `Start` and `PoseStart`, and the result, are in rad.

    Returns
    -------
    Simulation
        The motion as far as it was computed, also if it ended before `until`.

    Raises
    ------
    ModelError, SolveError
        Before any integration, if something is missing or impossible.
    EngineError
        With ``engine="compiled"``, if that engine cannot do what is asked.

    Examples
    --------
    >>> import spherekit as sk
    >>> braked = sk.simulate(
    ...     "four_bar", sk.Start(q=0.3, dq=1.0), 2.0, torque=lambda t, q, dq: 5.0 - 2.0 * dq
    ... )
    >>> braked.end.kind
    'time'
    >>> braked.at([0.0, 1.0, 2.0]).q.shape
    (3,)
    """
    mechanism = mechanism_of(mechanism)
    if not isinstance(start, PoseStart):
        start = read_start(start, mechanism, angle_unit)
    check_engine_and_tolerance(mechanism, engine, tolerance)
    passes_crossings = crossings == "pass"
    if passes_crossings and engine == "compiled":
        raise EngineError(
            f'{mechanism.name}: crossings="pass" requires the engine "numpy"',
            "leave out one of the options engine and crossings",
        )
    problem = prepare(
        mechanism,
        start,
        until,
        torque=torque,
        input_pair=input_pair,
        assembly_mode=assembly_mode,
        switches=switches,
        passes=passes_crossings,
    )
    if any(pair.one_sided for pair in mechanism.pairs):
        # The pushes of contacts are known only after the simulation.
        seen = None
    problem = replace(problem, on_progress=seen, compact=compact)
    if check:
        return _simulate_and_compare(problem, tolerance, engine)
    return _simulate_problem(problem, tolerance, engine)


def check_engine_and_tolerance(mechanism: Mechanism, engine: str, tolerance: float) -> None:
    """Raise `SolveError` if an engine is unknown or a tolerance is out of its range.

    The engine is ``"numpy"``, ``"compiled"`` or ``"auto"`` (the faster one). The tolerance
    (rad) applies to the result of a simulation. Its smallest value depends on the engine.
    For ``"auto"`` this is the smallest value of the compiled engine. If it turns out later
    that only NumPy can simulate the mechanism, `_refuse_tolerance_of_numpy` compares the
    tolerance with the smallest value of NumPy.
    """
    if engine not in ENGINE_CHOICES:
        raise SolveError(
            f'{mechanism.name}: engine: found "{engine}". Allowed: '
            f"{listing(ENGINE_CHOICES)}"
        )
    smallest = MIN_TOLERANCE_BY_ENGINE["numpy" if engine == "numpy" else "compiled"]
    if not smallest <= tolerance <= MAX_TOLERANCE_RAD:
        raise SolveError(
            # 1e-2 is `MAX_TOLERANCE_RAD`, written in this way.
            f"{mechanism.name}: tolerance: found {tolerance:g}, expected a number from "
            f"{smallest:g} to 1e-2"
        )


def _refuse_tolerance_of_numpy(name: str, tolerance: float, reason: str) -> None:
    """Raise `SolveError` if a tolerance is too small for NumPy, the only possible engine.

    Parameters
    ----------
    name
        Name of the mechanism.
    tolerance
        The tolerance, rad.
    reason
        Why the compiled engine is not possible.
    """
    smallest = MIN_TOLERANCE_BY_ENGINE["numpy"]
    if tolerance < smallest:
        raise SolveError(
            f"{name}: tolerance: found {tolerance:g}, but only the NumPy engine is "
            f"possible ({reason}), which needs at least {smallest:g}"
        )


def _simulate_and_compare(
    problem: Problem, tolerance: float, engine: EngineChoice
) -> Simulation:
    """Return a simulation with its error, measured against a more accurate simulation.

    The more accurate simulation (the reference) has a smaller tolerance for its steps. If
    the error exceeds the user's tolerance, the reference takes the place of the first
    simulation and is compared with a still more accurate one, and so on. This ends when the
    error meets the user's tolerance, or when the tolerance of the steps can't be reduced
    any more. Of the last two simulations the less accurate one is returned, because only
    the error of this simulation is known.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    tolerance, engine
        As in `simulate`.
    """
    simulation = _simulate_problem(problem, tolerance, engine)
    # The engine of the first simulation computes all further simulations.
    engine = simulation.engine.name
    # The tolerance of the steps of `simulation`. That of the compiled engine has an upper
    # limit, so that crossings of curves of configurations are noticed.
    step_tolerance = tolerance
    if engine == "compiled":
        step_tolerance = min(tolerance, MAX_STEP_TOLERANCE)
    min_step_tolerance = CHECK_MIN_TOLERANCE_RATIO * MIN_TOLERANCE_BY_ENGINE[engine]
    while True:
        reference_tolerance = max(
            CHECK_TOLERANCE_RATIO * step_tolerance, min_step_tolerance
        )
        reference = _simulate_problem(problem, reference_tolerance, engine)
        error = _largest_difference(simulation, reference)
        checked_simulation = replace(simulation, error=error, tolerance=tolerance)
        # `missed` is a message if the simulation misses the user's tolerance.
        is_accurate = checked_simulation.missed is None
        if is_accurate or reference_tolerance <= min_step_tolerance:
            return checked_simulation
        # The reference takes the place of the simulation. Its `engine` report says why.
        simulation = _explain_reference(reference, checked_simulation, step_tolerance)
        step_tolerance = reference_tolerance


def _explain_reference(
    reference: Simulation, simulation: Simulation, step_tolerance: float
) -> Simulation:
    """Return a reference simulation with a report on why it replaces a less accurate one.

    Parameters
    ----------
    reference
        The more accurate simulation, with shorter steps.
    simulation
        The less accurate simulation, with its measured error.
    step_tolerance
        Tolerance of the steps of the less accurate simulation, rad.
    """
    reason = (
        f"{simulation.engine.reason}; the error was {simulation.error:.1e} rad with steps "
        f"for {step_tolerance:g} rad, so shorter steps were used"
    )
    # `forecast` has the expected computing times by which the engine was chosen for the
    # first simulation.
    report = replace(reference.engine, reason=reason, forecast=simulation.engine.forecast)
    return replace(reference, engine=report)


def _largest_difference(simulation: Simulation, reference: Simulation) -> float:
    """Return the largest difference (rad) of any pair variable between two simulations.

    The reference has a smaller tolerance, so the difference is an estimate of the error.
    The result is infinite if the simulations end for different reasons.
    """
    if simulation.end.kind != reference.end.kind:
        return np.inf
    end_time = min(simulation.end.t, reference.end.t)
    path = simulation.path
    # At the start of each step, and once within it.
    t = np.append(path.starts, path.starts + 0.4 * path.lengths)
    t = np.append(t[t < end_time], end_time)
    return float(max_abs(simulation.at(t).values - reference.at(t).values))


def _simulate_problem(
    problem: Problem, tolerance: float, engine: EngineChoice
) -> Simulation:
    """Return the motion by one engine, up to the lift-off of a contact."""
    if engine == "compiled":
        simulation = by_taylor_series(problem, tolerance, REQUESTED_REASON)
    else:
        simulation = _simulate_by_choice(problem, tolerance, engine)
    return end_at_lift_off(simulation)


REQUESTED_REASON = "it was requested"
"""Reason for an engine that the user chose."""

FORECAST_REASON = (
    "expected times: {numpy:.2g} s more with NumPy, {compiled:.2g} s with the compiled "
    "engine"
)
"""Reason for the engine that is expected to finish first."""


def _simulate_by_choice(
    problem: Problem, tolerance: float, engine: EngineChoice
) -> Simulation:
    """Return the simulated motion, by NumPy or by the compiled engine, whichever is faster.

    The compiled engine is fast, but compiling takes time. The NumPy engine starts, and
    continues if it is expected to finish sooner than the compiled engine, whose time
    includes compiling. The compiled engine is used at once if the equation is already
    compiled, or if NumPy would be less accurate.

    Parameters
    ----------
    problem
        The mechanism with its loads, and the start of the motion.
    tolerance
        As in `simulate`.
    engine
        "numpy" to use NumPy in any case, or "auto".
    """
    mechanism = problem.equation.mechanism
    collocation = Collocation(problem, tolerance)
    # The reason for the choice of the engine. It stays empty while the forecast of the
    # computing times decides for NumPy.
    reason = ""
    forecast: Forecast | None = None
    # If only NumPy is possible, an `EngineError` is raised in this block, and its text is
    # the reason.
    try:
        if engine == "numpy":
            raise EngineError(REQUESTED_REASON)
        if problem.passes_crossings:
            raise EngineError('crossings="pass" requires the engine "numpy"')
        pairs = coordinates_at(problem, problem.values)
        compile_seconds = estimate_compile_seconds(
            mechanism, tolerance, problem.compact, pairs
        )
        # Reasons to use the compiled engine at once.
        if compile_seconds == 0.0:
            reason = "its code was compiled before"
        if tolerance < MIN_TOLERANCE_BY_ENGINE["numpy"]:
            reason = "NumPy does not reach the tolerance"
        if not has_smooth_loads(mechanism):
            reason = "NumPy does not find the kinks of the loads"
        # Without such a reason, NumPy takes one step after the other, as long as NumPy is
        # expected to finish first.
        while not reason and collocation.advance():
            numpy_seconds = collocation.remaining_seconds
            if numpy_seconds is None:
                continue
            compiled_seconds = compile_seconds + numpy_seconds / COMPILED_SPEEDUP
            present_forecast = {"numpy": numpy_seconds, "compiled": compiled_seconds}
            # The first forecast is reported if NumPy finishes.
            forecast = forecast or present_forecast
            if compiled_seconds < numpy_seconds:
                reason = FORECAST_REASON.format(**present_forecast)
                forecast = present_forecast
        if reason:
            announce(
                f"compiling the equation of motion, about {compile_seconds:.0f} s",
                compile_seconds,
            )
            simulation = by_taylor_series(problem, tolerance, reason, forecast)
            if simulation.end.message != NO_SERIES_MESSAGE:
                return simulation
            reason = NO_SERIES_MESSAGE
    except (EngineError, PlanError) as refusal:
        reason = refusal.fault
    # NumPy finishes the simulation. The forecast is reported if it was the reason for
    # NumPy.
    if not reason:
        forecast = forecast or {
            "numpy": collocation.seconds,
            "compiled": compile_seconds,
        }
        reason = FORECAST_REASON.format(**forecast)
    else:
        forecast = None
    if engine == "auto":
        _refuse_tolerance_of_numpy(mechanism.name, tolerance, reason)
    while collocation.end is None and collocation.advance():
        pass
    return collocation.simulation(reason, forecast)
