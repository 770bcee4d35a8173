"""The equation of motion as a system that the Taylor integrator runs.

The state is that of `spherekit.dynamics.state`: the pair variables v, the momentum
p = sqrt(B) u and the work W of each load. In the homogeneous parameter of
`spherekit.engine.kinematics`, with tau its rates of the variables,

    dv/dt = u tau,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B)

(from Di Gregorio 2024, eq. (9), which holds in any coordinate). The closure of the loops
is an invariant of these equations, so nothing has to be solved or stabilised.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, Literal, final

import numpy as np

from spherekit.engine.algebra import dot, vector
from spherekit.engine.cache import COMPILED
from spherekit.engine.compiler import (
    CompiledFunction,
    EventFunction,
    Integrator,
    available,
    compile_function,
    compile_integrator,
    compile_with_rates,
    heyoka,
)
from spherekit.engine.expression_graph import Expr, ExpressionNode, power, symbols, varies
from spherekit.engine.inertia import inertia, tensors
from spherekit.engine.kinematics import RateExpressions, Structure
from spherekit.engine.loads import (
    FULL_TURN,
    LoadState,
    Switches,
    generalised_force,
    steep_arguments,
)
from spherekit.engine.pose import place_by_variables
from spherekit.engine.turns import turning_pairs
from spherekit.model.dynamics import (
    Stop,
    TorqueTable,
)
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

LOOSEST = 1e-12
"""Largest tolerance of a step.

A larger one saves little, for the order of the series grows with the digits, not the
number of steps; and crossings of curves need closed configurations to be seen.
"""

(_MOMENT,) = symbols(["moment"])

EventKind = Literal["rest", "dead_centre", "singularity", "stop", "switch"]


@final
@dataclass(frozen=True)
class ParameterLayout:
    """Where what is set for each run stands among the integrator's parameters.

    In this order: whole turns of each variable; the unit of momentum and its reciprocal;
    the least square of |tau|; low and high of each stop; the time from which tables run,
    value and slope of each; the sides of the switches.
    """

    variables: int
    stops: int
    tables: tuple[str, ...]

    @property
    def unit(self) -> int:
        """The unit of momentum, its reciprocal after it."""
        return self.variables

    @property
    def least(self) -> int:
        """The square of |tau| at which a run ends."""
        return self.variables + 2

    @property
    def stop(self) -> int:
        """The first stop's low."""
        return self.variables + 3

    @property
    def table(self) -> int:
        """The time from which tables run."""
        return self.stop + 2 * self.stops

    @property
    def side(self) -> int:
        """The side of the first switch."""
        return self.table + 1 + 2 * len(self.tables)


@final
@dataclass(frozen=True)
class CompiledEquation:
    """The compiled equation of motion of a mechanism with its loads and stops.

    The state of the integrator is the pair variables less whole turns, the momentum in
    its unit, and the work of each load in the square of that unit. `events` are the kinds
    of the integrator's events, with the variable they are about. `tau` gives the rates of
    all variables by the homogeneous parameter, `tangent` their length. `conditions` gives
    what the switches depend on, then its rates by time, from the state, the time and all
    parameters. `steep` gives from the same the rate of the momentum, then the arguments at
    whose zeros and turns loads may change faster than a series shows, None where no load
    does; `tolerance` is that of a step. The integrator holds the state of a run, so `lock`
    is held while one lasts; the functions may be called by several threads at once.
    """

    structure: Structure
    layout: ParameterLayout
    integrator: Integrator
    events: tuple[tuple[EventKind, int], ...]
    tau: CompiledFunction
    conditions: CompiledFunction | None
    steep: CompiledFunction | None
    tolerance: float
    lock: Lock = field(default_factory=Lock, repr=False, compare=False)

    @property
    def switches(self) -> int:
        """How many switches the loads have."""
        return sum(kind == "switch" for kind, _ in self.events)


def compiled_equation(
    mechanism: Mechanism,
    tolerance: float,
    compact: bool = True,
    number: type[Any] = float,
) -> tuple[CompiledEquation, bool]:
    """Return the equation of a mechanism, and whether it had been compiled before.

    Parameters
    ----------
    mechanism
        One freedom, its first input the input; all its loads act. The values of torque
        tables and stops are set for each run, so mechanisms that differ in them only
        share one equation.
    tolerance
        Error of each step, in states of size one, at most `LOOSEST`.
    compact
        heyoka's compact mode: compiles faster, runs slower.
    number
        The type the integrator computes with: float, or heyoka's ``real128`` where the
        machine has it, for reference solutions.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled.
    """
    common = _common(mechanism)
    fresh: list[bool] = []

    def make() -> CompiledEquation:
        fresh.append(True)
        return _compile(common, min(tolerance, LOOSEST), compact, number)

    return COMPILED.get(common, _request(tolerance, compact, number), make), not fresh


def compiling_time(mechanism: Mechanism, tolerance: float, compact: bool) -> float:
    """Return about how long `compiled_equation` will take (s), 0 where it is kept.

    Fitted to the shipped mechanisms with up to ten loads, on one core; half and twice as
    much occur. Machine code that heyoka has kept on disk takes less and is not noticed.

    Raises
    ------
    EngineError
        If heyoka is not installed, or a profile cannot be compiled.
    """
    turning_pairs(mechanism)
    if not available():
        heyoka()
    if COMPILED.known(_common(mechanism), _request(tolerance, compact, float)):
        return 0.0
    variables = len(mechanism.variable_names)
    on_links = sum("pair" not in load.keys for load in mechanism.loads)
    at_pairs = len(mechanism.loads) - on_links
    if compact:
        return max(0.22 * variables - 0.55, 0.3) + 0.07 * on_links + 0.02 * at_pairs
    return 0.06 * variables**2 * (1.0 + 0.25 * on_links + 0.03 * at_pairs)


def _request(tolerance: float, compact: bool, number: type[Any]) -> str:
    return repr(("motion", min(tolerance, LOOSEST), compact, number.__name__))


def _common(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without what is set for each run."""
    tables = any(isinstance(load, TorqueTable) for load in mechanism.loads)
    if not tables and not mechanism.stops:
        return mechanism
    return replace(
        mechanism,
        loads=tuple(
            replace(load, times=(0.0, 1.0), torques=(0.0, 0.0), periodic=False)
            if isinstance(load, TorqueTable)
            else load
            for load in mechanism.loads
        ),
        stops=tuple(Stop(stop.pair, -1.0, 1.0) for stop in mechanism.stops),
    )


def _compile(
    mechanism: Mechanism, tolerance: float, compact: bool, number: type[Any]
) -> CompiledEquation:
    names = mechanism.variable_names
    layout = ParameterLayout(
        len(names),
        len(mechanism.stops),
        tuple(load.name for load in mechanism.loads if isinstance(load, TorqueTable)),
    )
    structure = Structure.of(mechanism, mechanism.inputs[0].pair)
    variables = symbols(names)
    works = symbols([f"work_{k}" for k in range(len(mechanism.loads))])
    (momentum,) = symbols(["momentum"])
    flow = RateExpressions(
        structure, place_by_variables(mechanism, structure.pairs, variables)
    )
    share = power(inertia(flow, tensors(mechanism)).coefficients[0], -0.5)
    speed = _constant(layout.unit) * momentum * share
    switches = Switches(lambda k: _constant(layout.side + k))
    moving = LoadState(
        flow,
        variables,
        [_constant(k) for k in range(layout.variables)],
        speed,
        _MOMENT,
        switches,
        lambda name: _table(layout, name),
    )
    push = _constant(layout.unit + 1) * share
    forces = [generalised_force(load, moving) * push for load in mechanism.loads]
    equations = [
        *((v, tau * speed) for v, tau in zip(variables, flow.tau[0], strict=True)),
        (momentum, sum(forces, 0.0)),
        *((work, f * momentum) for work, f in zip(works, forces, strict=True)),
    ]
    arguments = dict.fromkeys(
        each for load in mechanism.loads for each in steep_arguments(load, moving)
    )
    events, kinds = _events(flow, variables, momentum, layout)
    count = layout.side + len(switches.conditions)
    constants = [_constant(k) for k in range(count)]
    conditions = None
    if switches.conditions:
        running = [*equations, (_MOMENT, 1.0)]
        conditions = compile_with_rates(switches.conditions, running, constants)
    for which, condition in enumerate(switches.conditions):
        assert conditions is not None
        stuck = _sticking(conditions, which, layout)
        events.append(EventFunction(condition, switch=layout.side + which, sticks=stuck))
        kinds.append(("switch", -1))
    steep = None
    if arguments and number is float:
        steep = compile_function(
            [sum(forces, 0.0), *arguments],
            [*variables, momentum, *works, _MOMENT, *constants],
            compact=True,
        )
    return CompiledEquation(
        structure,
        layout,
        compile_integrator(
            equations, _MOMENT, constants, tolerance, compact, events, number
        ),
        tuple(kinds),
        compile_function(flow.tau[0], variables, compact=True),
        conditions,
        steep,
        tolerance,
    )


def _constant(number: int) -> ExpressionNode:
    """Return the variable that stands for one of the integrator's parameters."""
    (made,) = symbols([f"constant_{number}"])
    return made


def _table(layout: ParameterLayout, name: str) -> Expr:
    place = layout.table + 1 + 2 * layout.tables.index(name)
    since = _MOMENT - _constant(layout.table)
    return _constant(place) + _constant(place + 1) * since


def _events(
    flow: RateExpressions,
    variables: Sequence[Expr],
    momentum: Expr,
    layout: ParameterLayout,
) -> tuple[list[EventFunction], list[tuple[EventKind, int]]]:
    mechanism, driven = flow.structure.mechanism, flow.structure.driven
    tau = vector(flow.tau[0])
    square = dot(tau, tau)
    events = [EventFunction(momentum)]
    kinds: list[tuple[EventKind, int]] = [("rest", -1)]
    if varies(tau[driven]):
        events.append(EventFunction(tau[driven]))
        kinds.append(("dead_centre", driven))
    if varies(square):
        crossed = square - _constant(layout.least)
        events.append(EventFunction(crossed, stops=True, sense=-1))
        kinds.append(("singularity", -1))
    for number, stop in enumerate(mechanism.stops):
        (place,) = mechanism.variables_of(mechanism.pair_number[stop.pair])
        value = variables[place] + FULL_TURN * _constant(place)
        limits: tuple[tuple[int, Literal[-1, 1]], ...] = ((0, -1), (1, 1))
        for side, sense in limits:
            level = _constant(layout.stop + 2 * number + side)
            events.append(EventFunction(value - level, stops=True, sense=sense))
            kinds.append(("stop", place))
    return events, kinds


def _sticking(
    conditions: CompiledFunction, which: int, layout: ParameterLayout
) -> Callable[[Floats, float, Floats], bool]:
    """Return whether a condition, now of its new sign, goes back at once."""

    def stuck(state: Floats, time: float, constants: Floats) -> bool:
        row = np.concatenate([state, [time], constants])[:, None]
        found = np.asarray(conditions(row))[:, 0]
        sides = constants[layout.side :]
        return bool(found[len(sides) + which] * sides[which] < 0.0)

    return stuck
