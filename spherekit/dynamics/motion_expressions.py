"""The equations of a mechanism under its loads as terms, before they are compiled.

The state is the pair variables, the momenta in a unit of their own, and the work of each
load in the square of that unit. What is set for each run are parameters.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from spherekit.conventions import TURN
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.compiler import EventFunction
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, symbols
from spherekit.velocities.load_expressions import LoadState
from spherekit.velocities.velocity_equations import CoordinateRates

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
