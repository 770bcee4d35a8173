"""The direct problem: the motion of a mechanism from its start and its loads."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.dynamics.compiled_engine import by_taylor_series, coordinates_at
from spherekit.dynamics.compiled_equation import (
    MAX_STEP_TOLERANCE,
    estimate_compile_seconds,
)
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.dynamics.simulated_path import BLOCK
from spherekit.dynamics.simulation import (
    NO_SERIES,
    Event,
    Forecast,
    Simulation,
    SimulationEnd,
)
from spherekit.dynamics.simulation_start import PoseStart, Problem, Torques, prepare
from spherekit.errors import EngineError, PlanError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings, Start, StartGiven
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.load_dependence import has_smooth_loads
from spherekit.mechanism.mechanism import Mechanism
from spherekit.progress import tell
from spherekit.symbolic.compiler import ENGINE_CHOICES, EngineChoice
from spherekit.wording import listing

LEAST = {"numpy": 1e-13, "compiled": 1e-15}
"""Smallest tolerance of each engine; below, rounding decides."""

CHECK_TOLERANCE_RATIO = 1e-2
"""Tolerance of the simulation that checks another one, relative to the tolerance of that.

Larger: the error is estimated less reliably. Smaller: checks take longer.
"""

COMPILED_SPEEDUP = 200.0
"""Ratio of the solving times of NumPy and the compiled engine, without compiling.

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
) -> Simulation:
    """Return the motion of a mechanism of any mobility under its loads.

    Parameters
    ----------
    mechanism
        A mechanism with masses; its loads act, its joint limits end the simulation.
    start
        Input variable (rad) and rate (rad/s) at t = 0 on an assembly mode, which may be
        ``{"q": 0.4, "dq": 1.2}`` or ``"q=0.4,dq=1.2"``; or a whole configuration.
    until
        Time (s) at which to end.
    torque
        The driving torque (N m) at the input, if there is one: a number, an expression
        such as ``"10*sin(2*t) - dtheta_21"``, or a function f(t, q, dq) of the time and of
        the input's variable and rate, which the NumPy engine calls. Of several inputs a
        mapping from their names; an input without a torque turns freely.
    input_pair, assembly_mode
        The driven R pairs, by default the inputs; the assembly mode at the start.
    tolerance
        Error of the pair variables (rad) aimed at. Steps are made for it; motions that
        depend strongly on their start multiply errors beyond it: see `check`.
    switches
        Times (s) at which expressions have kinks; knots of torque tables are known.
    crossings
        Whether a simulation ends where sets of configurations cross, or goes straight on,
        as rigid links without play do; only NumPy's engine can.
    check
        Whether to repeat the run with steps made for a hundredth of the error and compare.
        Where they differ by more than the tolerance, or power is off balance, the tighter
        run is kept and compared with a still tighter one; `Simulation.missed` is what is
        left to say.
    engine
        ``"auto"`` takes the one that is expected to be done first, or the one that can do
        what is asked, kinks of loads included; the result says which, and why.
    compact
        False compiles longer for about two thirds of the time of solving.
    seen
        Is given the simulation so far, every few seconds while NumPy's engine solves it;
        not where a one-sided contact may end it earlier.

    Returns
    -------
    Simulation
        With all that was found, also where it ended before `until`.

    Raises
    ------
    ModelError, SolveError
        Before any integration: for what is missing or impossible.
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
    start = start if isinstance(start, PoseStart) else Start.of(start)
    need_allowed(mechanism, engine, tolerance)
    passes = crossings == "pass"
    if passes and engine == "compiled":
        raise EngineError(
            f"{mechanism.name}: only NumPy's engine passes crossings",
            "leave engine or crossings out",
        )
    problem = prepare(
        mechanism, start, until, torque, input_pair, assembly_mode, switches, passes
    )
    if any(pair.one_sided for pair in mechanism.pairs):
        seen = None
    problem = replace(problem, seen=seen, compact=compact)
    return (_checked if check else _solved)(problem, tolerance, engine)


def need_allowed(mechanism: Mechanism, engine: str, tolerance: float) -> None:
    """Refuse an engine that there is not, or a tolerance that it does not reach.

    Raises
    ------
    SolveError
        If so.
    """
    if engine not in ENGINE_CHOICES:
        raise SolveError(
            f'{mechanism.name}: engine "{engine}" is not known; it is '
            f"{listing(ENGINE_CHOICES)}"
        )
    least = LEAST["numpy" if engine == "numpy" else "compiled"]
    if not least <= tolerance <= 1e-2:
        raise SolveError(
            f"{mechanism.name}: tolerance is {tolerance:g}, allowed is {least:g} to 1e-2"
        )


def _checked(problem: Problem, tolerance: float, engine: EngineChoice) -> Simulation:
    """Return a simulation with its error against a tighter one.

    Where the tolerance is missed, the tighter one takes its place, as long as there is one.
    """
    simulation = _solved(problem, tolerance, engine)
    engine = simulation.engine.name
    made_for = min(tolerance, MAX_STEP_TOLERANCE) if engine == "compiled" else tolerance
    least = 0.1 * LEAST[engine]
    while True:
        tighter = max(CHECK_TOLERANCE_RATIO * made_for, least)
        tight = _solved(problem, tighter, engine)
        error = _difference(simulation, tight)
        simulation = replace(simulation, error=error, tolerance=tolerance)
        if simulation.missed is None or tighter <= least:
            return simulation
        why = (
            f"{simulation.engine.reason}; off by {error:.1e} rad with steps for "
            f"{made_for:g} rad, so in shorter ones"
        )
        report = replace(tight.engine, reason=why, forecast=simulation.engine.forecast)
        simulation = replace(tight, engine=report)
        made_for = tighter


def _difference(one: Simulation, other: Simulation) -> float:
    """Return the largest difference (rad) of a variable, infinite if the ends differ."""
    if one.end.kind != other.end.kind:
        return np.inf
    last = min(one.end.t, other.end.t)
    path = one.path
    t = np.append(path.starts, path.starts + 0.4 * path.lengths)
    t = np.append(t[t < last], last)
    return float(max_abs(one.at(t).values - other.at(t).values))


def _solved(problem: Problem, tolerance: float, engine: EngineChoice) -> Simulation:
    if engine == "compiled":
        return until_lift_off(by_taylor_series(problem, tolerance, ASKED))
    return until_lift_off(_cheaper(problem, tolerance, engine))


ASKED = "it was asked for"
EXPECTED = "expected NumPy {numpy:.2g} s more, compiled {compiled:.2g} s"


def _cheaper(problem: Problem, tolerance: float, engine: EngineChoice) -> Simulation:
    """Return the motion by NumPy, or the engine expected to take less time from here.

    NumPy starts, and goes on until what is left takes it longer than compiling. What it
    cannot do as well is compiled at once.
    """
    mechanism = problem.equation.mechanism
    solver = Collocation(problem, tolerance)
    try:
        if engine == "numpy":
            raise EngineError(ASKED)
        if problem.passes:
            raise EngineError("only NumPy's engine passes crossings")
        pairs = coordinates_at(problem, problem.values)
        compiling = estimate_compile_seconds(mechanism, tolerance, problem.compact, pairs)
        why = "it was compiled before" if compiling == 0.0 else ""
        if tolerance < LEAST["numpy"]:
            why = "NumPy does not reach the tolerance"
        if not has_smooth_loads(mechanism):
            why = "NumPy does not find the kinks of the loads"
        forecast: Forecast | None = None
        while not why and solver.advance():
            left = solver.left
            if left is None:
                continue
            now = {"numpy": left, "compiled": compiling + left / COMPILED_SPEEDUP}
            forecast = forecast or now
            if now["compiled"] < left:
                why = EXPECTED.format(**now)
                forecast = now
        if why:
            tell(f"compiling the equation of motion, about {compiling:.0f} s", compiling)
            simulation = by_taylor_series(problem, tolerance, why, forecast)
            if simulation.end.message != NO_SERIES:
                return simulation
            why = NO_SERIES
    except (EngineError, PlanError) as refused:
        why = refused.fault
    if not why:
        forecast = forecast or {"numpy": solver.seconds, "compiled": compiling}
        why = EXPECTED.format(**forecast)
    else:
        forecast = None
    while solver.end is None and solver.advance():
        pass
    return solver.simulation(why, forecast)


CONTACT_PROBES = 8
"""Places in each step at which the pushes of contacts are computed.

Smaller: a contact that lifts off for a short time is missed. Larger: more time.
"""

MAX_RELATIVE_PULL = 1e-9
"""Largest pull of a contact that counts as rounding, relative to the largest reaction.

Larger: contacts lift off late. Smaller: rounding ends simulations.
"""

FIRST_STEPS = 8
"""Steps whose largest reaction is the least to which pulls are compared.

Smaller: if a mechanism starts without reactions, their rounding ends the simulation.
"""

LIFT_OFF_TOLERANCE_S = 1e-14
"""Tolerance of the time at which a contact lifts off."""


def until_lift_off(simulation: Simulation) -> Simulation:
    """Return a simulation up to the time at which a one-sided contact would have to pull.

    Raises
    ------
    SolveError
        If one would have to pull from the start.
    """
    mechanism = simulation.mechanism
    one_sided = [k for k, pair in enumerate(mechanism.pairs) if pair.one_sided]
    if not one_sided:
        return simulation
    path = simulation.path
    fractions = np.arange(CONTACT_PROBES) / CONTACT_PROBES
    t = (path.starts[:, None] + fractions * path.lengths[:, None]).ravel()
    t = np.append(t[t < simulation.end.t], simulation.end.t)

    def compute_pushes(t: Floats) -> tuple[Floats, Floats]:
        """Return pushes (n, contacts) and the largest reaction (n,) at times t, N m."""
        moments = simulation.moments(t).moments
        return moments[:, one_sided, 0], np.fmax.reduce(np.abs(moments), axis=(1, 2))

    pushes_of_blocks = []
    reactions_of_blocks = []
    for block in np.array_split(t, 1 + len(t) // BLOCK):
        block_pushes, block_reactions = compute_pushes(block)
        pushes_of_blocks.append(block_pushes)
        reactions_of_blocks.append(block_reactions)
    pushes = np.concatenate(pushes_of_blocks)
    largest = np.fmax.accumulate(np.concatenate(reactions_of_blocks))
    largest = np.maximum(largest, largest[: FIRST_STEPS * CONTACT_PROBES][-1])
    is_pulling = np.any(pushes < -MAX_RELATIVE_PULL * largest[:, None], axis=1)
    pulling_rows = np.flatnonzero(is_pulling)
    if not len(pulling_rows):
        return simulation
    row = pulling_rows[0]
    contact = np.argmin(pushes[row])
    name = mechanism.pairs[one_sided[contact]].name
    if row == 0:
        raise SolveError(
            f"{mechanism.name}: contact {name} would have to pull at the start, and is "
            "one_sided: press it with a spring, start more slowly, or leave one_sided out"
        )
    from scipy.optimize import brentq

    lift_off_time = float(t[row - 1])
    if pushes[row - 1, contact] > 0.0:
        lift_off_time = brentq(
            lambda x: compute_pushes(np.array([x]))[0][0, contact],
            lift_off_time,
            t[row],
            xtol=LIFT_OFF_TOLERANCE_S,
        )
    end = SimulationEnd(
        "lift_off",
        lift_off_time,
        f"contact {name} lifts off: it would have to pull to keep its links together; "
        "press it with a spring, or move more slowly",
    )
    inputs = tuple(simulation.at([lift_off_time]).inputs[0].tolist())
    events = [event for event in simulation.events if event.t <= lift_off_time]
    events.append(Event("lift_off", lift_off_time, inputs, name))
    return replace(simulation, events=tuple(events), end=end)
