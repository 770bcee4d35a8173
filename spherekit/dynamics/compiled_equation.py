"""Compiles the equation of motion of a mechanism into a Taylor integrator.

`spherekit.dynamics.single_dof_equation` and `spherekit.dynamics.multi_dof_equation` derive
the expressions of the equation. This module adds joint limits, switches of loads and checks
of steep loads.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.motion_expressions import (
    TIME_SYMBOL,
    EquationExpressions,
    EquationLayout,
    make_joint_limit_events,
    parameter_symbol,
)
from spherekit.dynamics.multi_dof_equation import derive_multi_dof_equation
from spherekit.dynamics.single_dof_equation import derive_single_dof_equation
from spherekit.errors import EngineError
from spherekit.mechanism.load import (
    BearingFriction,
    Load,
    TorqueTable,
    no_expression_message,
)
from spherekit.mechanism.load_kinds import JointLimit, PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.compiler import available, compile_function, heyoka
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import ArrayFunction
from spherekit.symbolic.expression_graph import iterate_nodes
from spherekit.symbolic.taylor_integrator import EventFunction, Integrator
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.function_cache import FUNCTION_CACHE
from spherekit.velocities.load_expressions import steep_arguments

MAX_STEP_TOLERANCE = 1e-12
"""Largest tolerance of a step, relative to the largest element of the state.

Larger: crossings of curves are missed, since they are seen in closed configurations only,
while little time is saved: the order of the series grows with the digits, the number of
steps hardly does. Smaller: more time.
"""

MAX_COARSE_STEP_TOLERANCE = 1e-7
"""Largest tolerance of a step with several degrees of freedom.

An integration with this tolerance ends well before a crossing of sets of configurations,
and continues with `MAX_STEP_TOLERANCE`. Steps far from crossings can therefore be less
accurate than those that have to detect crossings. Larger: the integration ends later and
can miss a crossing.
"""


class EquationArguments(NamedTuple):
    """The arguments of `compile_equation`, from which an equation can be compiled again.

    Machine code cannot be pickled (written as bytes for another process). An equation is
    therefore pickled as these arguments. The fields are the parameters of
    `compile_equation`.
    """

    mechanism: Mechanism
    tolerance: float
    compact: bool
    coordinates: Sequence[str]
    values: Floats | None


@dataclass(frozen=True)
class CompiledEquation:
    """The compiled equation of motion of a mechanism with its loads and joint limits.

    The state of the integrator consists of the pair variables (rad) reduced by whole turns,
    the momenta divided by a unit of momentum, and the work of each load divided by the
    square of this unit. A momentum is a rate times the square root of an inertia, so that
    the square of its unit sqrt(J) is the unit of work.

    Attributes
    ----------
    layout
        Layout of the state and of the parameters.
    integrator
        The Taylor integrator, which stores the state of a run. `lock` is acquired for a
        run.
    rates_function
        A function that computes from the variables the homogeneous rates of all variables
        with respect to each coordinate, then the measure of independence of the
        loop-closure equations. A homogeneous rate is the rate per unit rate of the
        coordinate, times the determinant D of the velocity equations for given rates of the
        coordinates. Homogeneous rates stay finite where D is zero, which is where the
        coordinates do not determine the rates.
    switch_function
        A function that computes from state, time and parameters the switch conditions, then
        their time derivatives. A load changes abruptly where a condition is zero. None
        without conditions.
    probe_function
        A function that computes from state, time and parameters the rates of the momenta,
        then the arguments of steep functions in loads, such as x in tanh(1000 x). Where its
        argument passes or nearly touches 0, such a function changes too fast for the Taylor
        series of a step. None if no load has such functions.
    tolerance
        Tolerance of a step, relative to the largest element of the state.
    arguments
        Arguments of `compile_equation`, which are pickled in place of the equation.
    """

    layout: EquationLayout
    integrator: Integrator
    rates_function: ArrayFunction
    switch_function: ArrayFunction | None
    probe_function: ArrayFunction | None
    tolerance: float
    arguments: EquationArguments = field(repr=False, compare=False)
    lock: Lock = field(default_factory=Lock, repr=False, compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments only, since machine code and locks do not pickle."""
        return _compile_again, (self.arguments,)

    def homogeneous_rates(self, values: Floats) -> Floats:
        """Return the homogeneous rates with respect to m coordinates at n configurations.

        A homogeneous rate is the rate of a variable per unit rate of a coordinate, times
        the determinant of the velocity equations. Unlike the rate itself, it stays finite
        where this determinant is zero, that is where the coordinates do not determine the
        rates.

        Parameters
        ----------
        values
            (n, variables) pair variables (joint angles, rad).

        Returns
        -------
        (n, m, variables) the homogeneous rates with respect to each coordinate.
        """
        # (m * variables + 1, n): first one row for each homogeneous rate. The last row is
        # another quantity, the measure of independence of the loop-closure equations.
        outputs: Floats = self.rates_function(values.T)
        rates = outputs[:-1]
        layout = self.layout
        return rates.T.reshape(-1, layout.freedoms, layout.variable_count)

    def measure_independence(self, values: Floats) -> Floats:
        """Return a measure (n,) of how independent the loop-closure equations are.

        The measure is zero where these equations depend on each other, that is where curves
        or surfaces of configurations cross. `values` (n, variables) are the pair variables
        (rad).
        """
        return self.rates_function(values.T)[-1]


def compile_equation(
    mechanism: Mechanism,
    tolerance: float,
    compact: bool = True,
    coordinates: Sequence[str] = (),
    values: Floats | None = None,
) -> tuple[CompiledEquation, bool]:
    """Return the compiled equation of motion, and whether it had been compiled before.

    Parameters
    ----------
    mechanism
        The mechanism, with all loads that act. Mechanisms that differ only in the values of
        torque tables and joint limits share one equation.
    tolerance
        Error of each step relative to the largest element of the state. At most
        `MAX_STEP_TOLERANCE`, with several degrees of freedom `MAX_COARSE_STEP_TOLERANCE`,
        is used.
    compact
        Whether to use heyoka's compact mode, which compiles faster and runs slower.
    coordinates
        With several degrees of freedom the R pairs whose variables are the coordinates.
    values
        With several degrees of freedom a closed configuration (variables,) in which the
        coordinates determine the rates of all variables.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled.
    PlanError
        If the coordinates are not independent.
    """
    _check_expressible(mechanism)
    arguments = EquationArguments(
        mechanism=mechanism,
        tolerance=tolerance,
        compact=compact,
        coordinates=coordinates,
        values=values,
    )
    # The equation is derived for this mechanism. Its inputs are the coordinates, and torque
    # tables and joint limits have fixed numbers, so that runs with other numbers share it.
    common_mechanism = _remove_run_data(mechanism, coordinates)
    step_tolerance = _limit_tolerance(tolerance, coordinates)
    # Everything else on which the equation depends. `values` only help to derive it, so an
    # equation that was compiled with other `values` is used again.
    key = _cache_key(mechanism, step_tolerance, compact)
    was_cached = True

    def compile_now() -> CompiledEquation:
        """Compile the equation. The cache calls this only if it has no such equation."""
        nonlocal was_cached
        was_cached = False
        expressions = _derive_equation(arguments, common_mechanism)
        return _compile_expressions(
            expressions, common_mechanism, step_tolerance, arguments
        )

    equation = FUNCTION_CACHE.get(common_mechanism, key, compile_now)
    return equation, was_cached


def _derive_equation(
    arguments: EquationArguments, common_mechanism: Mechanism
) -> EquationExpressions:
    """Derive the equation of motion as symbolic expressions, which are then compiled.

    Parameters
    ----------
    arguments
        The arguments of `compile_equation`, with the mechanism of the user. `values` are
        the joint angles of a configuration, in which independent loop-closure equations are
        chosen. None with one degree of freedom.
    common_mechanism
        The mechanism of the user with two changes. Its inputs are the coordinates of the
        equation. The values in torque tables and joint limits are placeholders, because
        they are set before each simulation.
    """
    if arguments.values is None:
        return derive_single_dof_equation(common_mechanism)
    # The coordinates can be other pairs than the inputs of the user. The integrator reports
    # where the user's inputs no longer determine the motion, so it needs their variables.
    mechanism = arguments.mechanism
    input_variables = [mechanism.angles[pair] for pair in mechanism.input_pairs]
    return derive_multi_dof_equation(common_mechanism, arguments.values, input_variables)


def _compile_again(arguments: EquationArguments) -> CompiledEquation:
    """Return the compiled equation that a pickle describes by its arguments."""
    equation, _ = compile_equation(*arguments)
    return equation


def estimate_compile_seconds(
    mechanism: Mechanism, tolerance: float, compact: bool, coordinates: Sequence[str] = ()
) -> float:
    """Return the estimated time of `compile_equation` (s), 0 if it was compiled before.

    The estimate helps to decide whether compiling pays. The estimate was fitted to the
    shipped mechanisms with up to ten loads, on one core. Actual times are between half and
    twice the estimate.

    Parameters
    ----------
    mechanism
        The mechanism with its loads.
    tolerance
        Error of each step of the integration, relative to the largest element of the state.
    compact
        Whether to use heyoka's compact mode, which compiles faster and runs slower.
    coordinates
        With several degrees of freedom the R pairs (revolute joints) with the coordinates.

    Raises
    ------
    EngineError
        If heyoka is not installed, or a load or the profile of a contact can't be
        compiled.
    """
    # These calls raise the errors that compiling would raise, for loads, for profiles of
    # contacts, and if heyoka is not installed. Their results are not needed.
    _check_expressible(mechanism)
    pair_rotations(mechanism)
    if not available():
        heyoka()  # raises an error that says how to install it
    # Look for the equation in the cache.
    step_tolerance = _limit_tolerance(tolerance, coordinates)
    common_mechanism = _remove_run_data(mechanism, coordinates)
    if FUNCTION_CACHE.has(common_mechanism, _cache_key(mechanism, step_tolerance, compact)):
        return 0.0
    variables = len(mechanism.variable_names)
    # A load that acts at a pair (joint) names this pair in its field "pair".
    loads_at_pairs = sum("pair" in load.field_kinds for load in mechanism.loads)
    loads_on_links = len(mechanism.loads) - loads_at_pairs
    # All numbers are fitted to measured times (s). `coordinates` is empty with one degree
    # of freedom.
    if compact:
        base_seconds = 0.5 if coordinates else 0.0
        kinematics_seconds = max(0.22 * variables - 0.55, 0.3)
        load_seconds = 0.07 * loads_on_links
        return base_seconds + kinematics_seconds + load_seconds + 0.02 * loads_at_pairs
    kinematics_seconds = (0.36 if coordinates else 0.06) * variables**2
    return kinematics_seconds * (1.0 + 0.25 * loads_on_links + 0.03 * loads_at_pairs)


def _check_expressible(mechanism: Mechanism) -> None:
    """Raise `EngineError` if a load is not an expression of the state."""
    for load in mechanism.loads:
        if isinstance(load, PairTorque) and callable(load.torque):
            raise EngineError(no_expression_message(load.pair))
        if isinstance(load, BearingFriction) and load.friction_coefficient > 0.0:
            raise EngineError(
                f"{mechanism.name}: the friction of loads.{load.name} depends on the "
                f"reaction of pair {load.pair}, which the compiled engine does not compute",
                "use the NumPy engine, which computes it",
            )


def _limit_tolerance(tolerance: float, coordinates: Sequence[str]) -> float:
    """Return the tolerance of a step."""
    return min(tolerance, MAX_COARSE_STEP_TOLERANCE if coordinates else MAX_STEP_TOLERANCE)


def _cache_key(mechanism: Mechanism, step_tolerance: float, compact: bool) -> str:
    """Return a text that distinguishes the compiled equations of motion of one mechanism.

    Compiling takes long, so equations are stored in a cache with this key. `mechanism` has
    the inputs of the user, because the equation reports where these inputs do not determine
    the motion (type II singularity).
    """
    return repr(("motion", step_tolerance, compact, mechanism.input_pairs))


def _remove_run_data(mechanism: Mechanism, coordinates: Sequence[str]) -> Mechanism:
    """Return the mechanism without numbers that are parameters of its equation.

    The numbers of torque tables and joint limits are set before each simulation. Here they
    are replaced by arbitrary ones. Mechanisms that differ only in these numbers then share
    one compiled equation. The coordinates of the equation become the inputs.

    Parameters
    ----------
    mechanism
        The mechanism with its loads and joint limits.
    coordinates
        Names of the pairs (joints) whose variables are the coordinates. If it is empty, the
        inputs stay.
    """
    if coordinates and tuple(coordinates) != mechanism.input_pairs:
        mechanism = mechanism.with_inputs(*coordinates)
    has_tables = any(isinstance(load, TorqueTable) for load in mechanism.loads)
    if not has_tables and not mechanism.joint_limits:
        return mechanism
    loads: list[Load] = []
    for load in mechanism.loads:
        if isinstance(load, TorqueTable):
            load = replace(load, times=(0.0, 1.0), torques=(0.0, 0.0), periodic=False)
        loads.append(load)
    joint_limits = [JointLimit(limit.pair, -1.0, 1.0) for limit in mechanism.joint_limits]
    return replace(mechanism, loads=tuple(loads), joint_limits=tuple(joint_limits))


def _compile_expressions(
    expressions: EquationExpressions,
    mechanism: Mechanism,
    step_tolerance: float,
    arguments: EquationArguments,
) -> CompiledEquation:
    """Compile the integrator and the functions of an equation of motion.

    Parameters
    ----------
    expressions
        The equation of motion as expressions.
    mechanism
        The mechanism with its loads and joint limits, without data of a run.
    step_tolerance
        Tolerance of a step, relative to the largest element of the state.
    arguments
        The arguments of `compile_equation`, to be pickled.
    """
    compact = arguments.compact
    layout = expressions.layout
    # The differential equations: each symbol of the state with its rate.
    equations = [*zip(layout.state, expressions.state_rates, strict=True)]
    # Arguments at whose zeros or extrema loads may change faster than a series shows.
    arguments_of_loads = chain.from_iterable(
        steep_arguments(load, expressions.load_state) for load in mechanism.loads
    )
    # The keys of a dictionary have each argument once, in order.
    probed_arguments = dict.fromkeys(arguments_of_loads)
    # Events at which a run stops. An event whose expression does not contain the motion
    # cannot occur.
    moving_symbols = {*layout.variables, *layout.momenta}
    events = [
        event
        for event in (*expressions.events, *make_joint_limit_events(mechanism, layout))
        if moving_symbols & {*iterate_nodes([event.expression])}
    ]
    # The inputs of the compiled functions: state, time and parameters.
    conditions = layout.switch_conditions
    parameters = [
        parameter_symbol(k) for k in range(layout.switch_parameters + len(conditions))
    ]
    inputs = [*layout.state, TIME_SYMBOL, *parameters]

    # At a zero of a switch condition a load changes abruptly: the integrator reverses the
    # parameter with the sign of the condition.
    switch_function = None
    if conditions:
        condition_rates = differentiate(conditions, dict(equations) | {TIME_SYMBOL: 1.0})
        switch_function = compile_function(
            [*conditions, *condition_rates], inputs, compact=True
        )
        for index, condition in enumerate(conditions):
            switch_event = EventFunction(
                condition,
                "switch",
                switch=layout.switch_parameters + index,
                sticks=_make_sticking_test(switch_function, index, layout),
            )
            events.append(switch_event)

    probe_function = None
    # This function tests whether a step follows the equation between its ends.
    if probed_arguments:
        momentum_rates = expressions.state_rates[layout.momentum_slice]
        probe_function = compile_function(
            [*momentum_rates, *probed_arguments], inputs, compact=True
        )

    rate_outputs = [*chain(*expressions.homogeneous_rates), expressions.independence]
    return CompiledEquation(
        layout=layout,
        integrator=Integrator(
            equations,
            time_symbol=TIME_SYMBOL,
            parameter_symbols=parameters,
            tolerance=step_tolerance,
            compact=compact,
            events=events,
        ),
        rates_function=compile_function(rate_outputs, layout.variables, compact=True),
        switch_function=switch_function,
        probe_function=probe_function,
        tolerance=step_tolerance,
        arguments=arguments,
    )


def _make_sticking_test(
    switch_function: ArrayFunction, index: int, layout: EquationLayout
) -> Callable[[Floats, float, Floats], bool]:
    """Return a function that tells whether the motion sticks where a load changes abruptly.

    An example is dry friction. Its switch condition is the sliding rate, and dry friction
    changes where this rate is zero. Each condition has a sign, a parameter of the equation
    of motion. At a zero of the condition the sign is reversed, and with it the load. The
    reversed load may drive the condition back to zero at once. The motion then sticks.

    Parameters
    ----------
    switch_function
        Returns all switch conditions, then their time derivatives, from state, time and
        parameters.
    index
        Index of the condition to test.
    layout
        Layout of the parameters, which contain the signs of the conditions.

    Returns
    -------
    Function of state, time (s) and parameters, in which the sign is already reversed.
    """

    def sticks(state: Floats, time: float, parameters: Floats) -> bool:
        """Return whether the tested switch condition moves back to zero.

        The condition was zero, and its sign was reversed in the parameters. With the load
        that results from the new sign, the time derivative of the condition may have the
        opposite sign. The condition then returns to zero at once, and the motion sticks.
        """
        # The integrator drops the parameters after the last one that occurs in an
        # expression. Zeros take their place. If the sign of this condition was dropped, the
        # result is therefore False: the equation does not contain the sign, so its reversal
        # changes no load.
        dropped = layout.switch_parameters + len(layout.switch_conditions) - len(parameters)
        parameters = np.pad(parameters, (0, dropped))
        # One column: `switch_function` computes several states at once.
        inputs = np.concatenate([state, [time], parameters])[:, None]
        # The signs of all conditions are the last parameters.
        signs = parameters[layout.switch_parameters :]
        outputs = switch_function(inputs)[:, 0]
        # All conditions come first, then their time derivatives.
        condition_rates = outputs[len(signs) :]
        return bool(condition_rates[index] * signs[index] < 0.0)

    return sticks
