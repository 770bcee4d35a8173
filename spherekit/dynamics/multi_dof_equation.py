"""Derives the equations of motion with several degrees of freedom, as symbolic expressions.

With the homogeneous rates tau_i = D n_i of `spherekit.velocities.coordinate_rates` (D is
their scale and n_i the rates of the variables with respect to coordinate i), the rates u_i
of the coordinates and s_i = u_i / D,

    dv/dt = sum_i tau_i s_i,
    M' (du/dt) / D = Q' - sum_j w_ji . (I_j b_j + w_j x I_j w_j),
    M'_ik = sum_j w_ji . I_j w_jk.

w_ji is the angular velocity of link j at the rates tau_i, b_j the angular acceleration of
link j while no coordinate accelerates, and Q'_i the power of the loads at the rates tau_i.
These are Newton's and Euler's equations of the links along the velocities that remain free.
The loop closure is an invariant of these equations. The momenta in the state are sqrt(m) u,
where m is the sum of the links' largest moments of inertia.

The coordinates are the inputs of the mechanism that is passed. The caller chooses them so
that they determine the rates of all variables. An event ends an integration before the
coordinates cease to determine these rates.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.motion_expressions import EquationExpressions, EquationLayout
from spherekit.mechanism.link_inertia import link_inertia_tensors
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import Expr, dot, has_variables
from spherekit.symbolic.taylor_integrator import EventFunction
from spherekit.symbolic.vector_algebra import cofactors, determinant
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.load_expressions import generalised_forces

MAX_RATE_SQUARES = 400.0
"""Largest sum of the squares of the rates of all variables, per unit rates of the
coordinates. Other coordinates are chosen when it is exceeded.

Larger: coordinates are used nearer to their singularities, where steps are short. Smaller:
coordinates are changed, and equations compiled, more often.
"""


def total_moment_of_inertia(mechanism: Mechanism) -> float:
    """Return the sum of the largest moments of inertia of all moving links, kg m2."""
    link_tensors = [
        tensor for link, tensor in link_inertia_tensors(mechanism).items() if link
    ]
    return float(np.sum(np.linalg.norm(link_tensors, 2, axis=(1, 2))))


def derive_multi_dof_equation(
    mechanism: Mechanism, values: Floats, input_variables: Sequence[int]
) -> EquationExpressions:
    """Return the equations of motion of a mechanism as symbolic expressions.

    Parameters
    ----------
    mechanism
        The mechanism with the pairs of the coordinates as its inputs.
    values
        (variables,) a closed configuration, rad. If closure equations are redundant, those
        that are independent in this configuration are used.
    input_variables
        Indices of the variables of the user's inputs, which may differ from the
        coordinates. The event "type_2" occurs where these inputs do not determine the
        motion.
    """
    layout = EquationLayout(mechanism)
    structure = KinematicStructure.from_mechanism(
        mechanism, mechanism.input_pairs, closed=values
    )
    coordinate_rates = CoordinateRates(structure, layout.variables)
    # Inertia and forces are divided by the mass scale, so that expressions have sizes
    # near 1.
    mass_scale = total_moment_of_inertia(mechanism)
    root_mass_scale = float(np.sqrt(mass_scale))
    # The momenta of the state are the rates of the coordinates times the square root of the
    # mass scale, divided by the unit of momentum.
    speeds = [
        layout.momentum_unit * momentum * (1.0 / root_mass_scale)
        for momentum in layout.momenta
    ]
    motion_rates = coordinate_rates.motion_rates(speeds)
    scaled_speeds = motion_rates.scaled_speeds
    variable_rates = motion_rates.variable_rates
    # The rates of the variables that are coordinates are these speeds.
    for pair, speed in zip(structure.assembly.inputs, speeds, strict=True):
        variable_rates[mechanism.variables_of(pair)[0]] = speed

    # Generalised forces of loads, minus the velocity-dependent ones, for each coordinate.
    load_state = layout.make_load_state(coordinate_rates, variable_rates)
    forces_of_load = [generalised_forces(load, load_state) for load in mechanism.loads]
    moments = InputMoments(coordinate_rates, link_inertia_tensors(mechanism), mass_scale)
    link_accelerations = coordinate_rates.bias_accelerations(variable_rates, motion_rates.w)
    velocity_forces = moments.velocity_moments(link_accelerations, scaled_speeds)
    net_forces = [
        sum((forces[i] for forces in forces_of_load), 0.0) * (1.0 / mass_scale) - resisting
        for i, resisting in enumerate(velocity_forces)
    ]

    # The inertia matrix is small, so it is inverted by its cofactors.
    inertia_cofactors = cofactors(moments.matrix)
    inverse_determinant = 1.0 / dot(moments.matrix[0], inertia_cofactors[0])
    inverse_unit = layout.inverse_momentum_unit
    momentum_factor = inverse_unit * root_mass_scale * coordinate_rates.scale
    momentum_rates = [
        dot(row, net_forces) * inverse_determinant * momentum_factor
        for row in inertia_cofactors
    ]
    work_factor = inverse_unit * inverse_unit
    powers = [dot(forces, scaled_speeds) * work_factor for forces in forces_of_load]

    independence = _derive_independence(layout, coordinate_rates, values)
    return EquationExpressions(
        layout=layout,
        state_rates=[*variable_rates, *momentum_rates, *powers],
        homogeneous_rates=coordinate_rates.tau,
        independence=independence,
        events=_derive_events(layout, coordinate_rates, independence, input_variables),
        load_state=load_state,
    )


def _derive_independence(
    layout: EquationLayout, coordinate_rates: CoordinateRates, values: Floats
) -> Expr:
    """Return a measure of the independence of the loop-closure equations as an expression.

    The equations are those of velocities, J v' = 0, with the rates v' of all variables. The
    measure is zero where they depend on each other. An event ends a simulation where the
    measure falls below a limit.

    The measure is det(J J^T), divided by its value at the configuration `values`. A measure
    far above 1 would make steps less accurate: the integrator heyoka compares errors with
    the largest of the state and of all event functions.

    Parameters
    ----------
    layout
        Symbols of the pair variables (joint angles).
    coordinate_rates
        Rates of all variables per unit rate of each coordinate.
    values
        (variables,) a configuration (rad) in which the loops close and the coordinates
        determine the motion. The determinant is not 0 there.

    Returns
    -------
    The measure.
    """
    closure_determinant = _derive_closure_determinant(coordinate_rates, layout.freedoms)
    # A constant determinant has no zeros. It is not scaled.
    if not has_variables(closure_determinant):
        return closure_determinant
    evaluate = array_function([closure_determinant], layout.variables)
    value = evaluate(values[:, None]).item()
    return closure_determinant * (1.0 / value)


def _derive_closure_determinant(coordinate_rates: CoordinateRates, freedoms: int) -> Expr:
    """Return det(J J^T) of the velocity equations J v' = 0 of the loops, as an expression.

    The determinant is zero where the equations depend on each other. The caller uses it to
    end a simulation near such a configuration. v' are the rates of the pair variables
    (joint angles). The result is computed from solutions v' of the equations, which are
    known already:

    - m is the number of degrees of freedom. The coordinates are m pair variables, whose
      rates determine the rates of all others.
    - Row i of a matrix R has the rates of all variables per unit rate of coordinate i.
    - D is the determinant of the columns of J that belong to the other variables.
    - By a theorem of linear algebra, det(J J^T) = D^2 det(R R^T).
    - The known matrix is T = D R. It has m rows, so det(T T^T) = D^(2 m) det(R R^T).

    Therefore det(J J^T) = det(T T^T) / D^(2 m - 2).

    Parameters
    ----------
    coordinate_rates
        The homogeneous rates T (`tau`) and the determinant D (`scale`).
    freedoms
        The number m of degrees of freedom.
    """
    tau = coordinate_rates.tau
    rate_products = []  # T T^T
    for row in tau:
        rate_products.append([dot(row, other_row) for other_row in tau])
    # Division by the power D^(2 m - 2).
    return _divide_repeatedly(
        determinant(rate_products), divisor=coordinate_rates.scale, count=2 * freedoms - 2
    )


def _divide_repeatedly(value: Expr, divisor: Expr, count: int) -> Expr:
    """Return value / divisor^count, formed by products with the reciprocal."""
    reciprocal = 1.0 / divisor
    for _ in range(count):
        value = value * reciprocal
    return value


def _derive_events(
    layout: EquationLayout,
    coordinate_rates: CoordinateRates,
    independence: Expr,
    input_variables: Sequence[int],
) -> list[EventFunction]:
    """Return the events of the motion, without those of joint limits and of loads.

    An event occurs where its function crosses zero. There are two or three events:

    - A type II singularity ("type_2"), where the inputs of the user do not determine the
      motion. This event is only needed if other pairs are the coordinates of the equation.
    - A singularity, where the measure of independence falls below its limit.
    - The choice of other coordinates, where the rates of the variables per unit rates of
      the coordinates become too large.

    A function can be divided by a constant, which does not move its zeros. The integrator
    controls its error relative to the largest of the state and of all event functions, so
    a large function would make the state inaccurate. Functions of rates are divided by
    `MAX_RATE_SQUARES`, the sum of squared rates at which other coordinates are chosen.

    Parameters
    ----------
    layout
        Layout of the state and of the parameters.
    coordinate_rates
        Homogeneous rates tau_i of all variables: their rates per unit rate of coordinate i,
        times a scale that is the same for all coordinates.
    independence
        Measure of the independence of the closure equations.
    input_variables
        Indices of the variables of the inputs that the user chose.
    """
    tau = coordinate_rates.tau
    inverse_scale = 1.0 / coordinate_rates.scale
    # Sum of the squares of all rates per unit rate of each coordinate.
    rate_squares = sum((dot(rates, rates) for rates in tau), 0.0)
    rate_squares = rate_squares * inverse_scale * inverse_scale
    # sense=-1: only a change from positive to negative is an event.
    events = [
        EventFunction(independence - layout.min_independence, "singularity", sense=-1),
        EventFunction(
            1.0 - rate_squares * (1.0 / MAX_RATE_SQUARES), "coordinates", sense=-1
        ),
    ]
    if set(coordinate_rates.structure.inputs) != set(input_variables):
        # The determinant of the rates of the inputs with respect to the coordinates. It
        # vanishes where the inputs do not determine the motion.
        input_rates = determinant([[rates[v] for v in input_variables] for rates in tau])
        # An expression without variables is constant and has no zeros.
        if has_variables(input_rates):
            # Each row of the determinant has the factor `scale`. There are as many rows as
            # inputs, so this factor is removed once for each input.
            for _ in input_variables:
                input_rates = input_rates / coordinate_rates.scale
            # The size of the function must be comparable with 1. The squares of all rates
            # sum to at most MAX_RATE_SQUARES = 400. The determinant is then at most 200 for
            # two inputs and 1540 for three (Hadamard's bound).
            event = EventFunction(input_rates * (1.0 / MAX_RATE_SQUARES), "type_2")
            events.insert(0, event)
    return events
