"""The equation of motion of one freedom as terms.

The state is that of `spherekit.dynamics.state`: the pair variables v, the momentum
p = sqrt(B) u and the work W of each load. In the homogeneous parameter of
`spherekit.engine.kinematics`, with tau its rates of the variables,

    dv/dt = u tau,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B)

(from Di Gregorio 2024, eq. (9), which holds in any coordinate). The closure of the loops
is an invariant of these equations, so nothing has to be solved or stabilised.
"""

from spherekit.engine.algebra import dot, vector
from spherekit.engine.compiler import EventFunction
from spherekit.engine.expression_graph import power, varies
from spherekit.engine.inertia import inertia, tensors
from spherekit.engine.kinematics import RateExpressions, Structure
from spherekit.engine.loads import LoadState, generalised_forces
from spherekit.engine.pose import place_by_variables
from spherekit.engine.system import MOMENT, Symbols, System, SystemEvent, constant
from spherekit.model.mechanism import Mechanism


def one_freedom(mechanism: Mechanism) -> System:
    """Return the equation of a mechanism whose first input is the input."""
    symbols = Symbols.of(mechanism)
    structure = Structure.of(mechanism, mechanism.inputs[0].pair)
    flow = RateExpressions(
        structure, place_by_variables(mechanism, structure.pairs, symbols.variables)
    )
    (momentum,) = symbols.momenta
    share = power(inertia(flow, tensors(mechanism)).coefficients[0], -0.5)
    speed = constant(symbols.layout.unit) * momentum * share
    moving = LoadState.along(
        flow,
        symbols.variables,
        symbols.turns,
        speed,
        MOMENT,
        symbols.switches,
        symbols.table,
    )
    push = constant(symbols.layout.unit + 1) * share
    forces = [generalised_forces(load, moving)[0] * push for load in mechanism.loads]
    tau = vector(flow.tau[0])
    square = dot(tau, tau)
    events: list[SystemEvent] = [(EventFunction(momentum), "rest", -1)]
    driven = structure.driven
    if varies(tau[driven]):
        events.append((EventFunction(tau[driven]), "dead_centre", driven))
    if varies(square):
        crossed = square - constant(symbols.layout.least)
        events.append((EventFunction(crossed, stops=True, sense=-1), "singularity", -1))
    return System(
        structure,
        symbols,
        [rate * speed for rate in flow.tau[0]],
        [sum(forces, 0.0)],
        [force * momentum for force in forces],
        [flow.tau[0]],
        square,
        events,
        moving,
    )
