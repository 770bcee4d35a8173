"""Eksergian's equation of a mechanism as a system that the Taylor integrator runs.

In any coordinate p along the motion B p'' + 1/2 dB/dp p'^2 = Q (Di Gregorio 2024, eq. 9).
With the homogeneous parameter of `spherekit.engine.kinematics` the state is the pair
variables v and the speed u = dp/dt: v' = tau(v) u, u' = (Q - 1/2 dB/dp u^2) / B. Closure is
an invariant of these equations, so nothing has to be solved or stabilised; dead centres,
where the form in the input's angle is singular, are ordinary points. The work of the loads
is integrated along, so that the energy balance measures the error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np

from spherekit.engine.cache import cached
from spherekit.engine.compiler import (
    Event,
    Expr,
    Function,
    Integrator,
    compile_function,
    compile_integrator,
    derivative,
    parameter,
    symbols,
    time_symbol,
)
from spherekit.engine.inertia import inertia, tensors
from spherekit.engine.kinematics import Flow, Structure
from spherekit.engine.loads import FULL_TURN, AppliedLoad, Moving, Switches, sign_of
from spherekit.engine.pose import place_by_variables
from spherekit.errors import EngineError
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

SCALES = ("speed", "work")
"""Units of dp/dt and of the work of the loads in the integrator's state.

Its tolerance is relative to the largest element of the state; the minors of a mechanism
with short arcs are tiny, and would make dp/dt that element.
"""


@final
@dataclass(frozen=True)
class Dynamics:
    """The compiled equations of motion of a mechanism under given loads.

    The parameters of the integrator are the whole turns by which each variable is
    reduced, the `SCALES`, the values of the stops, and the sides of the switches;
    `events` names its events. Its state is the reduced variables, the speed dp/dt and
    the work of the loads, both over their scales. `size` gives dq/dp, |tau| and B by p
    from reduced variables. `inputs` are those
    variables, the speed dp/dt, the time and the whole turns; `outputs` what `observe`
    gives from them. `conditions` gives what the switches depend on, then its rates by
    time, from the same inputs and the sides of the switches.
    """

    structure: Structure
    loads: tuple[str, ...]
    stops: tuple[str, ...]
    integrator: Integrator
    events: tuple[str, ...]
    size: Function
    conditions: Function | None
    inputs: tuple[Expr, ...]
    outputs: tuple[Expr, ...]

    @cached_property
    def observe(self) -> Function:
        """Rates of all variables by time, d2q/dt2, B, dB/dq, energy, powers of loads.

        Compiled when first read.
        """
        return compile_function(self.outputs, self.inputs)

    @property
    def seconds(self) -> float:
        """What compiling took that a run needs."""
        parts = (self.integrator, self.size, self.conditions)
        return sum(each.seconds for each in parts if each)


def dynamics(
    mechanism: Mechanism,
    input_pair: str,
    loads: Sequence[AppliedLoad] = (),
    dead_centres: Sequence[str] = (),
    stops: Sequence[str] = (),
    tolerance: float = 1e-13,
    compact: bool = True,
    number: type[Any] = float,
) -> Dynamics:
    """Return the compiled equations; from the cache where they were compiled before.

    Parameters
    ----------
    mechanism, input_pair
        A mechanism with one freedom, and the pair whose angle q is the input.
    loads
        All loads that act, those of the actuator among them.
    dead_centres, stops
        Names of variables whose dead centres are to be noted, and of those that have a
        stop; the stops' values are given for each run.
    tolerance
        Error per step, relative to the largest element of the state, or absolute where
        that is below one.
    compact
        heyoka's compact mode: compiles faster, runs slower.
    number
        The type the integrator computes with: float, or heyoka's ``real128`` where the
        machine has it, for reference solutions.

    Raises
    ------
    EngineError
        If no link that can move has mass, or the mechanism cannot be compiled.
    """
    request = repr(
        (
            "dynamics",
            input_pair,
            [(load.name, load.content) for load in loads],
            tuple(dead_centres),
            tuple(stops),
            tolerance,
            compact,
            number.__name__,
        )
    )
    return cached(
        mechanism,
        request,
        lambda: _compile(
            mechanism,
            input_pair,
            loads,
            dead_centres,
            stops,
            tolerance,
            compact,
            number,
        ),
    )


def _compile(
    mechanism: Mechanism,
    input_pair: str,
    loads: Sequence[AppliedLoad],
    dead_centres: Sequence[str],
    stops: Sequence[str],
    tolerance: float,
    compact: bool,
    number: type[Any],
) -> Dynamics:
    masses = tensors(mechanism)
    if not any(np.any(tensor) for link, tensor in masses.items() if link):
        raise EngineError(
            f"{mechanism.name}: no link that moves has mass; give one a [mass.LINK]"
        )
    names = mechanism.variable_names
    structure = Structure.of(mechanism, input_pair)
    variables = symbols(names)
    speed, work, moment = symbols(("speed", "work", "time"))
    flow = Flow(structure, place_by_variables(mechanism, structure.pairs, variables))
    whole = inertia(flow, masses)

    def under_loads(
        pace: Expr, time: Expr, turns: Sequence[Expr], switches: Switches
    ) -> tuple[list[Expr], Expr]:
        moving = Moving(flow, variables, turns, pace, time, switches)
        forces = [load.force(moving) for load in loads]
        return forces, (sum(forces) - 0.5 * whole.rate * pace * pace) / whole.value

    count = len(names)
    first_stop = count + len(SCALES)
    first_switch = first_stop + len(stops)
    switches = Switches(lambda k: parameter(first_switch + k))
    turns = [parameter(k) for k in range(count)]
    pace_scale, work_scale = (parameter(count + k) for k in range(len(SCALES)))
    pace = pace_scale * speed
    forces, change = under_loads(pace, time_symbol(), turns, switches)
    equations = [
        *((name, tau * pace) for name, tau in zip(variables, flow.tau, strict=True)),
        (speed, change / pace_scale),
        (work, sum(forces) * pace / work_scale),
    ]
    events, labels = _events(flow, variables, dead_centres, stops, first_stop)
    turns = symbols([f"turns_{name}" for name in names])
    rates = [tau * speed for tau in flow.tau]
    sided = Switches(lambda k: symbols([f"side_{k}"])[0])
    _, gained = under_loads(speed, moment, turns, sided)
    conditions = None
    if sided.conditions:
        sides = [sided.factor(k) for k in range(len(sided.conditions))]
        conditions = _conditions(
            sided.conditions,
            [*zip(variables, rates, strict=True), (speed, gained), (moment, 1.0)],
            [*turns, *sides],
        )
    for which, condition in enumerate(switches.conditions):
        assert conditions is not None
        stuck = _sticking(conditions, which, count, first_switch)
        events.append(Event(condition, switch=first_switch + which, sticks=stuck))
        labels.append(f"switch {which + 1} of the loads")
    integrator = compile_integrator(equations, tolerance, compact, events, number)
    plain = Switches(lambda k: sign_of(plain.conditions[k]))
    forces, gained = under_loads(speed, moment, turns, plain)
    inputs = [*variables, speed, moment, *turns]
    tau_q, tau_q_rate = flow.input_rate, flow.tau_rate[structure.driven]
    share = 1.0 / tau_q
    outputs = [
        *rates,
        tau_q_rate * speed * speed + tau_q * gained,
        whole.value * share * share,
        (whole.rate - 2.0 * whole.value * tau_q_rate * share) * share * share * share,
        0.5 * whole.value * speed * speed,
        *(force * speed for force in forces),
    ]
    size = compile_function([tau_q, flow.speed, whole.value], variables)
    return Dynamics(
        structure,
        tuple(load.name for load in loads),
        tuple(stops),
        integrator,
        tuple(labels),
        size,
        conditions,
        tuple(inputs),
        tuple(outputs),
    )


def _conditions(
    conditions: Sequence[Expr],
    flowing: Sequence[tuple[Expr, Expr]],
    constants: Sequence[Expr],
) -> Function:
    """Return a function of all inputs with the conditions, then their rates by time."""
    changes = [
        sum(derivative(condition, item) * rate for item, rate in flowing)
        for condition in conditions
    ]
    inputs = [*(item for item, _ in flowing), *constants]
    return compile_function([*conditions, *changes], inputs)


def _sticking(
    conditions: Function, which: int, count: int, first_switch: int
) -> Callable[[Floats, float, Floats], bool]:
    """Return whether a condition, now of its new sign, goes back at once."""

    def stuck(state: Floats, time: float, constants: Floats) -> bool:
        speed = state[count] * constants[count]
        turns, sides = constants[:count], constants[first_switch:]
        row = np.concatenate([state[:count], [speed, time], turns, sides])[:, None]
        changes = np.asarray(conditions(row))[len(sides) :, 0]
        return bool(changes[which] * sides[which] < 0.0)

    return stuck


def _events(
    flow: Flow,
    variables: Sequence[Expr],
    dead_centres: Sequence[str],
    stops: Sequence[str],
    first_stop: int,
) -> tuple[list[Event], list[str]]:
    names = flow.structure.mechanism.variable_names
    events, labels = [], []
    for name in dead_centres:
        events.append(Event(flow.tau[names.index(name)]))
        labels.append(f"dead centre of {name}")
    for number, name in enumerate(stops):
        place = names.index(name)
        value = variables[place] + FULL_TURN * parameter(place)
        reached = value - parameter(first_stop + number)
        events.append(Event(reached, stops=True))
        labels.append(f"stop of {name}")
    return events, labels
