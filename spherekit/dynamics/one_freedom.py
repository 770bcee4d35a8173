"""The equation of motion of one degree of freedom, as expressions.

The state is that of `spherekit.dynamics.equation_of_motion`: the pair variables v, the
momentum p = sqrt(B) u and the work W of each load. In the homogeneous parameter of
`spherekit.velocities.velocity_equations`, with tau its rates of the variables,

    dv/dt = u tau,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B)

(from Di Gregorio 2024, eq. (9), which holds in any coordinate). The closure of the loops
is an invariant of these equations, so nothing has to be solved or stabilised.

The generalised inertia of Eksergian's equation is B = sum w_j . I_j w_j over the links,
with w_j the angular velocity of link j per unit rate of p and I_j its tensor about the
centre of the sphere (Di Gregorio 2024, eq. 15).
"""

from spherekit.dynamics.motion_expressions import ParameterLayout, System, constant
from spherekit.mechanism.link_inertia import tensors
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.compiler import EventFunction
from spherekit.symbolic.expression_graph import dot, power
from spherekit.velocities.load_expressions import generalised_forces
from spherekit.velocities.velocity_equations import CoordinateRates, InputMoments, Structure


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
