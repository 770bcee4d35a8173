"""The equations of a mechanism under its loads as terms, before they are compiled.

The state is the pair variables, the momenta in a unit of their own, and the work of each
load in the square of that unit. What is set for each run are parameters.

The equations of motion of several freedoms as terms, in the variables of the inputs.

With the homogeneous rates tau_i = D n_i of `spherekit.engine.kinematics`, u_i the
rates of the inputs' variables and s_i = u_i / D,

    dv/dt = sum tau_i s_i,   M' (du/dt) / D = Q' - sum_j w_ji . (I_j b_j + w_j x I_j w_j),

M'_ik = sum_j w_ji . I_j w_jk, with w_ji the links' angular velocities by tau_i, b_j their
accelerations while no input accelerates and Q'_i the power of the loads by tau_i: Newton's
and Euler's equations of the links along the velocities that are left free. The closure of
the loops is an invariant of them. The state holds sqrt(m) u for the momenta, with m the
sum of the links' moments of inertia.

The inputs here are coordinates, chosen for the configurations where they say how all
variables move: an event ends a run before they do not.

The equation of motion of one freedom as terms.

The state is that of `spherekit.dynamics.state`: the pair variables v, the momentum
p = sqrt(B) u and the work W of each load. In the homogeneous parameter of
`spherekit.engine.kinematics`, with tau its rates of the variables,

    dv/dt = u tau,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B)

(from Di Gregorio 2024, eq. (9), which holds in any coordinate). The closure of the loops
is an invariant of these equations, so nothing has to be solved or stabilised.

The generalised inertia of Eksergian's equation is B = sum w_j . I_j w_j over the links,
with w_j the angular velocity of link j per unit rate of p and I_j its tensor about the
centre of the sphere (Di Gregorio 2024, eq. 15).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.engine.algebra import cofactors, determinant
from spherekit.engine.compiler import EventFunction, compile_function
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    TermFunction,
    array_function,
    dot,
    power,
    symbols,
    varies,
)
from spherekit.engine.kinematics import CoordinateRates, InputMoments, Structure
from spherekit.engine.loads import LoadState, generalised_forces
from spherekit.model.load import TorqueTable
from spherekit.model.mechanism import Mechanism

(MOMENT,) = symbols(["moment"])


def constant(number: int) -> ExpressionNode:
    """Return the variable that stands for one of the integrator's parameters."""
    return symbols([f"constant_{number}"])[0]


class ParameterLayout:
    """The terms of the state, and where what is set for each run stands.

    The state is all `variable_terms`, `momentum_terms` and `work_terms`: so many
    `variables`, as many `freedoms` as inputs, whose `momenta` are there, and `works` of the
    loads. What is set are the integrator's parameters, in this order: whole turns of each
    variable; the `unit` of momentum and its reciprocal; the `least` measure of
    independence; low and high of each `stop`; the time from which each `table` runs, value
    and slope of each; the `side` of the first of the switches, which are those of
    `conditions` that loads switch on.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.variables = v = len(mechanism.variable_names)
        self.freedoms = m = len(mechanism.inputs)
        self.variable_terms = symbols(mechanism.variable_names)
        self.momentum_terms = symbols(f"momentum_{k}" for k in range(m))
        self.work_terms = symbols(f"work_{k}" for k in range(len(mechanism.loads)))
        self.state = [*self.variable_terms, *self.momentum_terms, *self.work_terms]
        self.momenta, self.works = slice(v, v + m), slice(v + m, None)
        self.tables = [x.name for x in mechanism.loads if isinstance(x, TorqueTable)]
        self.unit, self.least, self.stop = v, v + 2, v + 3
        self.table = self.stop + 2 * len(mechanism.joint_limits)
        self.side = self.table + 1 + 2 * len(self.tables)
        self.conditions: list[Expr] = []

    def moving(self, flow: CoordinateRates, rates: Sequence[Expr]) -> LoadState:
        """Return what loads see of a motion by the coordinates; see `LoadState`."""
        return LoadState(
            flow.mechanism,
            flow.placed,
            flow.tau,
            flow.w,
            self.variable_terms,
            [constant(k) for k in range(self.variables)],
            rates,
            MOMENT,
            self._switch,
            self._table,
        )

    def _switch(self, condition: Expr) -> Expr:
        """Return the factor of a condition."""
        if condition not in self.conditions:
            self.conditions.append(condition)
        return constant(self.side + self.conditions.index(condition))

    def _table(self, name: str) -> Expr:
        """Return the torque of a table now."""
        place = self.table + 1 + 2 * self.tables.index(name)
        return constant(place) + constant(place + 1) * (MOMENT - constant(self.table))


@dataclass(frozen=True)
class System:
    """The equations of motion in terms.

    `changes` are the rates of the state by time; `tau[i][v]` the homogeneous rates of the
    variables by each coordinate; `measure` vanishes where sets of configurations cross;
    `events` are those of the motion, without joint limits and switches; `moving` is what
    loads see.
    """

    layout: ParameterLayout
    changes: Sequence[Expr]
    tau: Sequence[Sequence[Expr]]
    measure: Expr
    events: Sequence[EventFunction]
    moving: LoadState


def stop_events(mechanism: Mechanism, state: ParameterLayout) -> Iterator[EventFunction]:
    """Yield the events at which pairs reach their joint limits."""
    for number, stop in enumerate(mechanism.joint_limits):
        (place,) = mechanism.variables_of(mechanism.pair_number[stop.pair])
        value = state.variable_terms[place] + TURN * constant(place)
        first = state.stop + 2 * number
        yield EventFunction(value - constant(first), "joint_limit", place, -1)
        yield EventFunction(value - constant(first + 1), "joint_limit", place, 1)


def tensors(mechanism: Mechanism) -> dict[int, Floats]:
    """Return the tensors (3, 3) of links with mass about O, in link axes (kg m2)."""
    return {
        mechanism.link_number[mass.link]: np.array(mass.tensor) for mass in mechanism.masses
    }


def one_freedom(mechanism: Mechanism) -> System:
    """Return the equation of a mechanism whose first input is the input."""
    layout = ParameterLayout(mechanism)
    structure = Structure.of(mechanism, mechanism.inputs[0].pair)
    (momentum,) = layout.momentum_terms
    flow = CoordinateRates(structure, layout.variable_terms)
    masses, (tau,) = InputMoments(flow, tensors(mechanism)), flow.tau
    share = power(masses.unit * masses.matrix[0][0], -0.5)
    speed = constant(layout.unit) * momentum * share
    rates = [rate * speed for rate in tau]
    moving = layout.moving(flow, rates)
    push = constant(layout.unit + 1) * share
    forces = [generalised_forces(load, moving)[0] * push for load in mechanism.loads]
    square = dot(tau, tau)
    (driven,) = structure.inputs
    return System(
        layout,
        [*rates, sum(forces, 0.0), *(force * momentum for force in forces)],
        flow.tau,
        square,
        [
            EventFunction(momentum, "rest"),
            EventFunction(tau[driven], "dead_centre", driven),
            EventFunction(square - constant(layout.least), "singularity", sense=-1),
        ],
        moving,
    )


def term_function(
    outputs: Sequence[Expr],
    inputs: Sequence[ExpressionNode],
    compiled: bool,
    number: type[Any] = float,
    compact: bool = False,
) -> TermFunction:
    """Return expressions as a function; there is nothing to compile where none is."""
    if compiled and outputs:
        return compile_function(outputs, inputs, compact, number)
    return array_function(outputs, inputs, number)


STEEPEST = 400.0
"""Squares of all variables' rates per unit rates of the coordinates, added up, at which
others have to be taken."""


def mass_size(mechanism: Mechanism) -> float:
    """Return the sum of the links' largest moments of inertia, kg m2."""
    by_link = [tensor for link, tensor in tensors(mechanism).items() if link]
    return float(np.sum(np.linalg.norm(by_link, 2, axis=(1, 2))))


def several_freedoms(mechanism: Mechanism, values: Floats, held: Sequence[int]) -> System:
    """Return the equations of a mechanism whose inputs are the coordinates.

    Parameters
    ----------
    values
        (variables,) a closed configuration, at which independent equations are chosen
        where they repeat.
    held
        The variables of the mechanism's own inputs, for the event "type_2".
    """
    layout = ParameterLayout(mechanism)
    structure = Structure.of(mechanism, mechanism.input_pairs, closed=values)
    variables = layout.variable_terms
    flow = CoordinateRates(structure, variables)
    size = mass_size(mechanism)
    root = float(np.sqrt(size))
    share = 1.0 / flow.scale
    speeds = [constant(layout.unit) * y * (1.0 / root) for y in layout.momentum_terms]
    slow, rates, w = flow.moving(speeds)
    for pair, speed in zip(structure.assembly.inputs, speeds, strict=True):
        rates[mechanism.variables_of(pair)[0]] = speed
    moving = layout.moving(flow, rates)
    forces = [generalised_forces(load, moving) for load in mechanism.loads]
    masses = InputMoments(flow, tensors(mechanism), size)
    pull = masses.pull(flow.bias(rates, w), slow)
    right = [
        sum((force[k] for force in forces), 0.0) * (1.0 / size) - against
        for k, against in enumerate(pull)
    ]
    matrix = masses.matrix
    minors = cofactors(matrix)
    reciprocal = 1.0 / dot(matrix[0], minors[0])
    per_unit = constant(layout.unit + 1)
    back, square = per_unit * root * flow.scale, per_unit * per_unit
    powers = [dot(of_load, slow) * square for of_load in forces]
    spread = sum((dot(tau, tau) for tau in flow.tau), 0.0) * share * share
    measure = determinant([[dot(a, b) for b in flow.tau] for a in flow.tau])
    for _ in range(2 * layout.freedoms - 2):
        measure = measure * share
    if varies(measure):
        # heyoka's tolerance is relative to the largest of the state and of all events.
        begun = array_function([measure], variables)(values[:, None])
        measure = measure * (1.0 / begun.item())
    return System(
        layout,
        [*rates, *(dot(row, right) * reciprocal * back for row in minors), *powers],
        flow.tau,
        measure,
        _events(layout, flow, measure, spread, held),
        moving,
    )


def _events(
    layout: ParameterLayout,
    flow: CoordinateRates,
    measure: Expr,
    spread: Expr,
    held: Sequence[int],
) -> list[EventFunction]:
    events = [
        EventFunction(measure - constant(layout.least), "singularity", sense=-1),
        EventFunction(1.0 - spread * (1.0 / STEEPEST), "coordinates", sense=-1),
    ]
    if set(flow.structure.inputs) != set(held):
        part = determinant([[tau[v] for v in held] for tau in flow.tau])
        if varies(part):
            for _ in held:
                part = part / flow.scale
            events.insert(0, EventFunction(part * (1.0 / STEEPEST), "type_2"))
    return events
