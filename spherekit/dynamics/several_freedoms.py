"""The equations of motion of several degrees of freedom, as expressions.

With the homogeneous rates tau_i = D n_i of `spherekit.velocities.velocity_equations`, u_i
the rates of the inputs' variables and s_i = u_i / D,

    dv/dt = sum tau_i s_i,   M' (du/dt) / D = Q' - sum_j w_ji . (I_j b_j + w_j x I_j w_j),

M'_ik = sum_j w_ji . I_j w_jk, with w_ji the links' angular velocities by tau_i, b_j their
accelerations while no input accelerates and Q'_i the power of the loads by tau_i: Newton's
and Euler's equations of the links along the velocities that are left free. The closure of
the loops is an invariant of them. The state holds sqrt(m) u for the momenta, with m the
sum of the links' moments of inertia.

The inputs here are coordinates, chosen for the configurations where they say how all
variables move: an event ends a run before they do not.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.motion_expressions import ParameterLayout, System, constant
from spherekit.mechanism.link_inertia import tensors
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.compiler import EventFunction
from spherekit.symbolic.expression_graph import Expr, array_function, dot, varies
from spherekit.symbolic.vector_algebra import cofactors, determinant
from spherekit.velocities.load_expressions import generalised_forces
from spherekit.velocities.velocity_equations import CoordinateRates, InputMoments, Structure

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
