"""Layout and expressions of an equation of motion, before it is compiled.

The state consists of the pair variables, the momenta and the work of each load. A momentum
is a rate times the square root of an inertia, such as p = sqrt(B) u with the kinetic energy
p^2 / 2, so its square has the dimension of work. Each run has a unit P of momentum: momenta
are divided by P and works by P^2. Quantities that are set for each run, such as P or joint
limits, are parameters of the compiled integrator.
`spherekit.dynamics.single_dof_equation` and `spherekit.dynamics.multi_dof_equation` derive
the expressions, and `spherekit.dynamics.compiled_equation` compiles them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from spherekit.conventions import TURN
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, symbols
from spherekit.symbolic.taylor_integrator import EventFunction
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.load_expressions import LoadState

(TIME_SYMBOL,) = symbols(["moment"])
"""The variable that stands for the time, s."""


def parameter_symbol(number: int) -> ExpressionNode:
    """Return the variable that stands for one of the integrator's parameters."""
    return symbols([f"constant_{number}"])[0]


class EquationLayout:
    """Indices of quantities in the state and among the parameters of a compiled equation.

    The state is `variables`, `momenta`, `works`. The parameters are, in this order:

    - the number of whole turns that is taken off each variable,
    - the unit of momentum, and its reciprocal,
    - the limit of the measure of independence of the loop-closure equations, below which an
      integration ends,
    - the lower and the upper value of each joint limit,
    - the time at which the current interval of the torque tables begins,
    - value and slope of each torque table in this interval,
    - the sign of each switch condition, 1 or -1.

    Attributes
    ----------
    variable_count
        Number of pair variables.
    freedoms
        Number of degrees of freedom.
    variables, momenta, works
        Symbols of the three parts of the state.
    state
        Symbols of the whole state.
    momentum_slice, work_slice
        Positions of the momenta and of the works in a state.
    unit_parameter, inverse_unit_parameter
        Numbers of the parameters that are the unit of momentum and its reciprocal.
    min_independence_parameter
        Number of the parameter that is the limit of the measure of independence.
    limit_parameters, table_parameters, switch_parameters
        Numbers of the first parameters of the joint limits, of the torque tables (the
        time) and of the switch conditions.
    table_names
        Names of the loads given by torque tables.
    switch_conditions
        Expressions at whose zeros a load changes abruptly. Loads append them while they are
        written as expressions.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Define where each quantity is in the state and parameters of an equation.

        The state is the vector that is integrated: all pair variables (joint angles), a
        momentum for each degree of freedom, and the work of each load.

        Parameters are numbers in the compiled equation that are constant during an
        integration step, such as joint limits. Parameters can be changed without compiling
        again, and are numbered from 0. An attribute ``..._parameter`` is the index of one
        parameter; ``..._parameters`` is the index of the first of several parameters.
        """
        self.variable_count = len(mechanism.variable_names)
        self.freedoms = len(mechanism.inputs)
        self.variables = symbols(mechanism.variable_names)
        self.momenta = symbols(f"momentum_{k}" for k in range(self.freedoms))
        self.works = symbols(f"work_{k}" for k in range(len(mechanism.loads)))
        self.state = [*self.variables, *self.momenta, *self.works]
        work_start = self.variable_count + self.freedoms
        self.momentum_slice = slice(self.variable_count, work_start)
        self.work_slice = slice(work_start, None)

        self.table_names = [
            load.name for load in mechanism.loads if isinstance(load, TorqueTable)
        ]
        # Numbers of parameters in each group, in the order of the groups.
        first_numbers = _number_consecutively(
            # The state has each variable without whole turns. Loads such as springs need
            # the full angle, so the number of turns of each variable is a parameter.
            turns=self.variable_count,
            # Momenta are divided by this unit, so that their numbers are near 1.
            momentum_unit=1,
            inverse_momentum_unit=1,
            # The loop-closure equations have a measure of independence, which is 0 where
            # they are dependent. An integration ends where it falls below this small limit.
            min_independence=1,
            # Lower and upper value of each joint limit.
            joint_limits=2 * len(mechanism.joint_limits),
            # Torque tables are linear in an interval of time: its start, then value and
            # slope of each table.
            torque_tables=1 + 2 * len(self.table_names),
            # Signs of the conditions of loads that change abruptly. The conditions are not
            # known yet. Each will append a parameter at the end.
            switch_signs=0,
        )
        self.unit_parameter = first_numbers["momentum_unit"]
        self.inverse_unit_parameter = first_numbers["inverse_momentum_unit"]
        self.min_independence_parameter = first_numbers["min_independence"]
        self.limit_parameters = first_numbers["joint_limits"]
        self.table_parameters = first_numbers["torque_tables"]
        self.switch_parameters = first_numbers["switch_signs"]
        self.switch_conditions: list[Expr] = []

    @property
    def common_slice(self) -> slice:
        """Positions of all parameters but the signs of the switch conditions."""
        return slice(self.switch_parameters)

    @property
    def switch_slice(self) -> slice:
        """Positions of the signs of the switch conditions among the parameters."""
        return slice(self.switch_parameters, None)

    @property
    def turn_symbols(self) -> list[ExpressionNode]:
        """Symbols of the numbers of whole turns that are taken off the variables."""
        return [parameter_symbol(variable) for variable in range(self.variable_count)]

    @property
    def momentum_unit(self) -> ExpressionNode:
        """The symbol of the unit of momentum."""
        return parameter_symbol(self.unit_parameter)

    @property
    def inverse_momentum_unit(self) -> ExpressionNode:
        """The symbol of the reciprocal of the unit of momentum."""
        return parameter_symbol(self.inverse_unit_parameter)

    @property
    def min_independence(self) -> ExpressionNode:
        """The symbol of the limit below which loop-closure equations count as dependent."""
        return parameter_symbol(self.min_independence_parameter)

    def make_load_state(
        self, coordinate_rates: CoordinateRates, variable_rates: Sequence[Expr]
    ) -> LoadState:
        """Return the motion on which loads depend, as expressions and symbols.

        Loads need two kinds of rates. The magnitude of a load, such as a damper, depends on
        time derivatives. The generalised force of a load at a coordinate needs rates per
        unit rate of this coordinate (principle of virtual power). The second kind is
        multiplied by the determinant of the velocity equations, so that the rates contain
        no division. Such rates are called homogeneous.

        Parameters
        ----------
        coordinate_rates
            Orientations of all links (`placed`), and the homogeneous rates of the pair
            variables (`tau`) and of the links (`w`).
        variable_rates
            Time derivatives of the pair variables (joint angles).
        """
        # The variables in the equation are reduced by whole turns. Loads such as springs
        # need the whole angles, so `revolutions` has symbols for the numbers of turns.
        #
        # The last two arguments are functions that loads call for a sign, and for a torque
        # given by a table over time.
        return LoadState(
            mechanism=coordinate_rates.mechanism,
            placed=coordinate_rates.placed,
            tau=coordinate_rates.tau,
            w=coordinate_rates.w,
            variables=self.variables,
            revolutions=self.turn_symbols,
            rates=variable_rates,
            time=TIME_SYMBOL,
            sign_of_condition=self._make_sign_symbol,
            table_torque=self._make_table_torque,
        )

    def _make_sign_symbol(self, condition: Expr) -> Expr:
        """Return the symbol of a parameter that is the sign of a condition, 1 or -1.

        A load changes abruptly at a zero of the condition, an expression. The integrator
        reverses the parameter there. A condition that is new is added to
        `switch_conditions`.
        """
        if condition not in self.switch_conditions:
            self.switch_conditions.append(condition)
        index = self.switch_conditions.index(condition)
        return parameter_symbol(self.switch_parameters + index)

    def _make_table_torque(self, name: str) -> Expr:
        """Return the torque given by a table over time, as an expression for one interval.

        The torque is linear in time within the interval. The start of the interval, and the
        value and slope of the table there, are parameters of the equation. The parameters
        change from interval to interval without compiling again.
        """
        interval_start = parameter_symbol(self.table_parameters)
        number = self.table_parameters + 1 + 2 * self.table_names.index(name)
        value = parameter_symbol(number)
        slope = parameter_symbol(number + 1)
        return value + slope * (TIME_SYMBOL - interval_start)


def _number_consecutively(**counts: int) -> dict[str, int]:
    """Return the index of the first parameter of each group, by the name of the group.

    `counts` are the numbers of parameters in the groups. The groups follow each other in
    this order, from index 0.
    """
    first_numbers = {}
    next_number = 0
    for name, count in counts.items():
        first_numbers[name] = next_number
        next_number += count
    return first_numbers


@dataclass(frozen=True)
class EquationExpressions:
    """The equation of motion as symbolic expressions, ready to be compiled.

    Attributes
    ----------
    layout
        Positions of quantities in the state and among the parameters.
    state_rates
        Time derivatives of the quantities in the state.
    homogeneous_rates
        For each coordinate the rates of all pair variables (joint angles) per unit rate of
        the coordinate, times the determinant of the velocity equations. The factor removes
        divisions, so these rates stay finite where the coordinate does not determine the
        motion. A simulation needs them for the direction of its curve of configurations.
    independence
        Measure of the independence of the loop-closure equations. The measure is zero where
        these equations depend on each other, which is where curves of configurations cross.
    events
        Conditions that are watched during an integration. Some events end it, and others
        are only recorded. Events of joint limits and of loads that change abruptly are
        added later.
    load_state
        Symbols in the expressions of loads: variables, rates, orientations of links and
        the time.
    """

    layout: EquationLayout
    state_rates: Sequence[Expr]
    homogeneous_rates: Sequence[Sequence[Expr]]
    independence: Expr
    events: Sequence[EventFunction]
    load_state: LoadState


def make_joint_limit_events(
    mechanism: Mechanism, layout: EquationLayout
) -> Iterator[EventFunction]:
    """Yield two events for each joint limit: the angle falls below or exceeds its range.

    An event occurs where its expression passes through zero, downwards (-1) or upwards (1).
    The integration then ends.

    Parameters
    ----------
    mechanism
        The mechanism with its joint limits.
    layout
        Symbols of the pair variables, and numbers of the parameters with the limits.
    """
    for index, limit in enumerate(mechanism.joint_limits):
        (variable,) = mechanism.variables_of(mechanism.pair_number[limit.pair])
        # Angles in the state are without whole turns. Parameter number v of the compiled
        # equation is the number of turns to add to variable v.
        angle = layout.variables[variable] + TURN * parameter_symbol(variable)
        # The lower and the upper value of each joint limit are two more parameters.
        first_number = layout.limit_parameters + 2 * index
        low = parameter_symbol(first_number)
        high = parameter_symbol(first_number + 1)
        yield EventFunction(angle - low, "joint_limit", variable, -1)
        yield EventFunction(angle - high, "joint_limit", variable, 1)
