"""Derives the equation of motion with one degree of freedom, as symbolic expressions.

The state is that of `spherekit.dynamics.equation_of_motion`: the pair variables v, the
momentum p = sqrt(B) u and the work W of each load. With the homogeneous parameter of
`spherekit.velocities.coordinate_rates` as coordinate, u its rate by time, and tau the
rates of the variables by it,

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
from spherekit.symbolic.expression_graph import dot, power
from spherekit.symbolic.taylor_integrator import EventFunction
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.load_expressions import generalised_forces


def derive_single_dof_equation(mechanism: Mechanism) -> EquationExpressions:
    """Return the equation of motion of a mechanism that is driven at its first input.

    The coordinate x is a parameter of the configuration curve, with the rate u = dx/dt. The
    homogeneous rates tau = dv/dx are the rates of all pair variables v by it. B is the
    generalised inertia, so the kinetic energy is B u^2 / 2. Q is the generalised force. The
    state has the variables v, the momentum p = sqrt(B) u and the work W of each load. The
    kinetic energy is p^2 / 2. The equation is (Di Gregorio 2024, eq. (9))

        dv/dt = tau u,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B).

    In the compiled equation p is divided by a unit P of momentum, and W by P^2, so that the
    numbers in the state are near 1. Each run sets P as a parameter.
    """
    layout = EquationLayout(mechanism)
    structure = KinematicStructure.from_mechanism(mechanism, mechanism.inputs[0].pair)
    (momentum,) = layout.momenta
    coordinate_rates = CoordinateRates(structure, layout.variables)
    moments = InputMoments(coordinate_rates, link_inertia_tensors(mechanism))
    (tau,) = coordinate_rates.tau

    # 1 / sqrt(B). The matrix has B in the unit of inertia `moments.unit`, in kg m2.
    inverse_root_inertia = power(moments.unit * moments.matrix[0][0], -0.5)
    # u = p / sqrt(B). The symbol `momentum` is p / P, and `layout.momentum_unit` is P.
    speed = layout.momentum_unit * momentum * inverse_root_inertia
    variable_rates = [rate * speed for rate in tau]

    load_state = layout.make_load_state(coordinate_rates, variable_rates)
    # The part of each load in d(p/P)/dt = Q / (P sqrt(B)).
    force_factor = layout.inverse_momentum_unit * inverse_root_inertia
    momentum_rates = [
        generalised_forces(load, load_state)[0] * force_factor for load in mechanism.loads
    ]
    # The power of a load over P^2: Q u / P^2 = (Q / (P sqrt(B))) (p / P).
    powers = [rate * momentum for rate in momentum_rates]

    # The homogeneous rates tau are the minors of the velocity equations. If these are
    # dependent, all minors vanish. This is so where curves of configurations cross. The
    # square of tau therefore measures the independence of the equations.
    tau_square = dot(tau, tau)
    (input_variable,) = structure.inputs
    return EquationExpressions(
        layout=layout,
        state_rates=[*variable_rates, sum(momentum_rates, 0.0), *powers],
        homogeneous_rates=coordinate_rates.tau,
        independence=tau_square,
        events=[
            EventFunction(momentum, "rest"),
            EventFunction(tau[input_variable], "dead_centre", input_variable),
            # `sense=-1`: the event occurs only if the function falls through zero.
            EventFunction(tau_square - layout.min_independence, "singularity", sense=-1),
        ],
        load_state=load_state,
    )
