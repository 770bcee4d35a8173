"""Derives the equation of motion with one degree of freedom, as symbolic expressions.

The state is that of `spherekit.dynamics.equation_of_motion`: the pair variables v, the
momentum p = sqrt(B) u and the work W of each load. With the homogeneous parameter of
`spherekit.velocities.coordinate_rates` as coordinate, u the time derivative of this
coordinate, and tau the derivatives of the variables with respect to it,

    dv/dt = u tau,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B)

(from Di Gregorio 2024, eq. (9), which holds in any coordinate). The loop closure is an
invariant of these equations, so nothing has to be solved or stabilised.

B is the generalised inertia of Eksergian's equation, B = sum_j w_j . I_j w_j over the links
(Di Gregorio 2024, eq. 15). Here w_j is the angular velocity of link j per unit rate of the
coordinate, and I_j its inertia tensor about the centre of the sphere.
"""

from spherekit.dynamics.motion_expressions import EquationExpressions, EquationLayout
from spherekit.mechanism.link_inertia import link_inertia_tensors
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, dot, power
from spherekit.symbolic.taylor_integrator import EventFunction
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.load_expressions import LoadState, generalised_forces


def derive_single_dof_equation(mechanism: Mechanism) -> EquationExpressions:
    """Return the equation of motion of a mechanism that is driven at its first input.

    This is Eksergian's equation as a system of first order (Di Gregorio 2024, eq. (9)):

        dv/dt = tau u,   dp/dt = sum_k Q_k / sqrt(B),   dW_k/dt = Q_k u,
        u = p / sqrt(B).

    - v are the pair variables (joint angles), and tau = dv/dx their derivatives with
      respect to the coordinate x.
    - x is a parameter of the curve of configurations, with the rate u = dx/dt. It is
      chosen so that the input q has the derivative dq/dx = D. D is the determinant of the
      velocity equations with locked q, which have the rates of all other variables as
      unknowns. D is zero at dead centres of q. tau needs no division by D, so it is finite
      there.
    - B is the generalised inertia: the kinetic energy is B u^2 / 2.
    - p = sqrt(B) u is the momentum: the kinetic energy is p^2 / 2.
    - Q_k is the generalised force of load k at x, and W_k its work.

    The state has p / P and W_k / P^2 in place of p and W_k. Each run sets the unit P of
    momentum as a parameter, so that these numbers are near 1.
    """
    layout = EquationLayout(mechanism)
    structure = KinematicStructure.from_mechanism(mechanism, mechanism.inputs[0].pair)
    (scaled_momentum,) = layout.momenta  # p / P
    coordinate_rates = CoordinateRates(structure, layout.variables)
    (tau,) = coordinate_rates.tau  # there is one coordinate

    # `InputMoments` derives the inertia matrix at the inputs, divided by a unit of inertia
    # (kg m2). There is one input, so the only entry of the matrix is B / unit.
    input_moments = InputMoments(coordinate_rates, link_inertia_tensors(mechanism))
    inertia = input_moments.unit * input_moments.matrix[0][0]  # B
    inverse_root_inertia = power(inertia, -0.5)  # 1 / sqrt(B)
    # u = p / sqrt(B), with p = P (p / P).
    speed = layout.momentum_unit * scaled_momentum * inverse_root_inertia
    variable_rates = [derivative * speed for derivative in tau]

    load_state = layout.make_load_state(coordinate_rates, variable_rates)
    # For each load its part in d(p / P)/dt.
    momentum_rates = _derive_momentum_rates(layout, load_state, inverse_root_inertia)
    # d(W_k / P^2)/dt = Q_k u / P^2 is the part of load k in d(p / P)/dt, times p / P.
    work_rates = [rate * scaled_momentum for rate in momentum_rates]
    # tau is zero where the velocity equations are linearly dependent, so the square of tau
    # measures their independence.
    tau_square = dot(tau, tau)
    (input_variable,) = structure.inputs
    input_rate = tau[input_variable]  # dq/dx
    return EquationExpressions(
        layout=layout,
        state_rates=[*variable_rates, sum(momentum_rates, 0.0), *work_rates],
        homogeneous_rates=coordinate_rates.tau,  # dv/dx
        independence=tau_square,
        # Rest, a dead centre of the input (input rate 0) and a singularity.
        events=_derive_events(layout, input_rate, input_variable, tau_square),
        load_state=load_state,
    )


def _derive_momentum_rates(
    layout: EquationLayout, load_state: LoadState, inverse_root_inertia: Expr
) -> list[Expr]:
    """Return, for each load, its part in the rate of the scaled momentum p / P.

    The coordinate x has the generalised inertia B. The momentum is defined as
    p = sqrt(B) dx/dt, so the kinetic energy is p^2 / 2. The rate p dp/dt of this energy is
    the power of all loads, and a load with the generalised force Q has the power Q dx/dt.
    So the part of a load in dp/dt is Q / sqrt(B). P is a unit of momentum.

    Parameters
    ----------
    layout
        The layout, which has the symbol of 1 / P.
    load_state
        The motion on which the loads depend, as expressions.
    inverse_root_inertia
        1 / sqrt(B).
    """
    force_factor = layout.inverse_momentum_unit * inverse_root_inertia
    momentum_rates = []
    for load in load_state.mechanism.loads:
        # With one degree of freedom there is one coordinate, so a load has one Q.
        (force,) = generalised_forces(load, load_state)
        momentum_rates.append(force * force_factor)
    return momentum_rates


def _derive_events(
    layout: EquationLayout, input_rate: Expr, input_variable: int, tau_square: Expr
) -> list[EventFunction]:
    """Return the events of the motion, except those of joint limits and of loads.

    The configurations of the mechanism form a curve with a parameter x. The derivatives of
    all pair variables (joint angles) v are tau = dv/dx. tau is computed from determinants
    of the velocity equations. At a singularity these equations depend on each other, and
    tau is zero.

    An event occurs where its function crosses zero. The functions are:

    - for a moment of rest, the momentum, which is a part of the state,
    - for a dead centre of the input q, its derivative dq/dx,
    - for a singularity, the sum of the squares of tau minus a small limit
      (`layout.min_independence`).

    Parameters
    ----------
    layout
        The layout, which has the symbols of the momentum (in a unit that makes its numbers
        small) and of the limit.
    input_rate, input_variable
        The derivative dq/dx of the input q, and the index of its variable.
    tau_square
        Sum of the squares of tau = dv/dx over all variables v.
    """
    (scaled_momentum,) = layout.momenta
    return [
        EventFunction(scaled_momentum, "rest"),
        EventFunction(input_rate, "dead_centre", input_variable),
        # sense=-1: only a change from positive to negative is an event.
        EventFunction(tau_square - layout.min_independence, "singularity", sense=-1),
    ]
