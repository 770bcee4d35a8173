"""The equations of a mechanism under its loads as terms, before they are compiled.

The state is the pair variables, the momenta in a unit of their own, and the work of each
load in the square of that unit. What is set for each run are parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

from spherekit.conventions import TURN
from spherekit.engine.compiler import EventFunction
from spherekit.engine.expression_graph import Expr, ExpressionNode, symbols
from spherekit.engine.kinematics import Structure
from spherekit.engine.loads import LoadState, Switches
from spherekit.model.load import TorqueTable
from spherekit.model.mechanism import Mechanism

(MOMENT,) = symbols(["moment"])

EventKind = Literal[
    "rest", "dead_centre", "type_2", "singularity", "coordinates", "stop", "switch"
]

SystemEvent = tuple[EventFunction, EventKind, int]
"""An event with its kind, and the variable that it is about or -1."""


@final
@dataclass(frozen=True)
class ParameterLayout:
    """Where what is set for each run stands among the integrator's parameters.

    In this order: whole turns of each variable; the unit of momentum and its reciprocal;
    the least measure of independence; low and high of each stop; the time from which
    tables run, value and slope of each; the sides of the switches.
    """

    variables: int
    freedoms: int
    stops: int
    tables: tuple[str, ...]

    @staticmethod
    def of(mechanism: Mechanism) -> "ParameterLayout":
        """Return the layout for a mechanism with as many freedoms as inputs."""
        return ParameterLayout(
            len(mechanism.variable_names),
            len(mechanism.inputs),
            len(mechanism.stops),
            tuple(load.name for load in mechanism.loads if isinstance(load, TorqueTable)),
        )

    @property
    def momenta(self) -> slice:
        """The momenta among the state."""
        return slice(self.variables, self.variables + self.freedoms)

    @property
    def works(self) -> slice:
        """The works among the state."""
        return slice(self.variables + self.freedoms, None)

    @property
    def unit(self) -> int:
        """The unit of momentum, its reciprocal after it."""
        return self.variables

    @property
    def least(self) -> int:
        """The measure of independence at which a run ends."""
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


def constant(number: int) -> ExpressionNode:
    """Return the variable that stands for one of the integrator's parameters."""
    (made,) = symbols([f"constant_{number}"])
    return made


@final
@dataclass(frozen=True)
class Symbols:
    """The variables of the terms of a mechanism, and what loads ask for."""

    layout: ParameterLayout
    variables: list[ExpressionNode]
    momenta: list[ExpressionNode]
    works: list[ExpressionNode]
    switches: Switches

    @staticmethod
    def of(mechanism: Mechanism) -> "Symbols":
        """Return those of a mechanism."""
        layout = ParameterLayout.of(mechanism)
        return Symbols(
            layout,
            symbols(mechanism.variable_names),
            symbols([f"momentum_{k}" for k in range(layout.freedoms)]),
            symbols([f"work_{k}" for k in range(len(mechanism.loads))]),
            Switches(lambda k: constant(layout.side + k)),
        )

    @property
    def turns(self) -> list[Expr]:
        """The whole turns that each variable is less."""
        return [constant(k) for k in range(self.layout.variables)]

    def table(self, name: str) -> Expr:
        """Return the torque of a table now."""
        place = self.layout.table + 1 + 2 * self.layout.tables.index(name)
        since = MOMENT - constant(self.layout.table)
        return constant(place) + constant(place + 1) * since


@final
@dataclass(frozen=True)
class System:
    """The equations of motion in terms.

    `rates` are those of the variables by time, `push` those of the momenta, `powers` those
    of the works; `tau[i][v]` the homogeneous rates of the variables by each coordinate;
    `measure` vanishes where sets of configurations cross; `events` are those of the
    motion, without stops and switches; `moving` is what loads see.
    """

    structure: Structure
    symbols: Symbols
    rates: Sequence[Expr]
    push: Sequence[Expr]
    powers: Sequence[Expr]
    tau: Sequence[Sequence[Expr]]
    measure: Expr
    events: Sequence[SystemEvent]
    moving: LoadState

    @property
    def equations(self) -> list[tuple[ExpressionNode, Expr]]:
        """Each variable of the state with its rate by time."""
        state = self.symbols
        return [
            *zip(state.variables, self.rates, strict=True),
            *zip(state.momenta, self.push, strict=True),
            *zip(state.works, self.powers, strict=True),
        ]


def stop_events(mechanism: Mechanism, state: Symbols) -> list[SystemEvent]:
    """Return the events at which pairs reach their stops."""
    events: list[SystemEvent] = []
    for number, stop in enumerate(mechanism.stops):
        (place,) = mechanism.variables_of(mechanism.pair_number[stop.pair])
        value = state.variables[place] + TURN * constant(place)
        limits: tuple[tuple[int, Literal[-1, 1]], ...] = ((0, -1), (1, 1))
        for side, sense in limits:
            level = constant(state.layout.stop + 2 * number + side)
            passed = EventFunction(value - level, stops=True, sense=sense)
            events.append((passed, "stop", place))
    return events
