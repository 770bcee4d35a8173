"""The equations of motion of several freedoms as terms, in the variables of the inputs.

With the homogeneous rates tau_i = D n_i of `spherekit.engine.coordinate_rates`, u_i the
rates of the inputs' variables and s_i = u_i / D,

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
from typing import final

import numpy as np

from spherekit.engine.algebra import (
    Exprs,
    cofactors,
    constants,
    cross,
    determinant,
    dot,
    vector,
)
from spherekit.engine.arrays import array_function
from spherekit.engine.compiler import EventFunction
from spherekit.engine.coordinate_rates import CoordinateRates
from spherekit.engine.expression_graph import Expr, varies
from spherekit.engine.inertia import tensors
from spherekit.engine.kinematics import Structure
from spherekit.engine.loads import LoadState, generalised_forces
from spherekit.engine.pose import LinkOrientation, place_by_variables
from spherekit.engine.system import MOMENT, Symbols, System, SystemEvent, constant
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

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
    symbols = Symbols.of(mechanism)
    layout = symbols.layout
    structure = Structure.at(mechanism, values)
    placed = place_by_variables(mechanism, structure.pairs, symbols.variables)
    flow = CoordinateRates(structure, placed)
    size = mass_size(mechanism)
    root = float(np.sqrt(size))
    share = 1.0 / flow.scale
    speeds = [constant(layout.unit) * y * (1.0 / root) for y in symbols.momenta]
    slow = [speed * share for speed in speeds]
    rates = [
        sum((tau[v] * s for tau, s in zip(flow.tau, slow, strict=True)), 0.0)
        for v in range(layout.variables)
    ]
    for pair, speed in zip(structure.assembly.inputs, speeds, strict=True):
        rates[mechanism.variables_of(pair)[0]] = speed
    w = [_along(by_input, slow) for by_input in zip(*flow.w, strict=True)]
    moving = LoadState(
        mechanism,
        placed,
        flow.tau,
        flow.w,
        symbols.variables,
        symbols.turns,
        rates,
        MOMENT,
        symbols.switches,
        symbols.table,
    )
    forces = [generalised_forces(load, moving) for load in mechanism.loads]
    masses = _Masses(mechanism, placed, flow, size)
    pull = masses.pull(flow.bias(rates, w), slow)
    total = [sum(of_loads, 0.0) * (1.0 / size) for of_loads in zip(*forces, strict=True)]
    total = total or [0.0] * layout.freedoms
    right = vector([a - b for a, b in zip(total, pull, strict=True)])
    matrix = masses.matrix
    changes = _solved(matrix, right)
    back = constant(layout.unit + 1) * root * flow.scale
    square = constant(layout.unit + 1) * constant(layout.unit + 1)
    powers = [dot(vector(of_load), vector(slow)) * square for of_load in forces]
    gram = [[dot(vector(a), vector(b)) for b in flow.tau] for a in flow.tau]
    spread = sum((gram[k][k] for k in range(layout.freedoms)), 0.0) * share * share
    measure = determinant(gram)
    for _ in range(2 * layout.freedoms - 2):
        measure = measure * share
    if varies(measure):
        # heyoka's tolerance is relative to the largest of the state and of all events.
        begun = array_function([measure], symbols.variables)(values[:, None])
        measure = measure * (1.0 / float(begun[0, 0]))
    return System(
        structure,
        symbols,
        rates,
        [change * back for change in changes],
        powers,
        flow.tau,
        measure,
        _events(symbols, flow, measure, spread, held),
        moving,
    )


def _along(parts: Sequence[Exprs], rates: Sequence[Expr]) -> Exprs:
    total = vector([0.0, 0.0, 0.0])
    for part, rate in zip(parts, rates, strict=True):
        total = total + part * rate
    return total


def _solved(matrix: Sequence[Sequence[Expr]], right: Exprs) -> list[Expr]:
    minors = cofactors(matrix)
    share = 1.0 / dot(vector(matrix[0]), vector(minors[0]))
    return [dot(vector(row), right) * share for row in minors]


def _events(
    symbols: Symbols,
    flow: CoordinateRates,
    measure: Expr,
    spread: Expr,
    held: Sequence[int],
) -> list[SystemEvent]:
    mechanism = flow.structure.mechanism
    events: list[SystemEvent] = []
    taken = {mechanism.variables_of(pair)[0] for pair in flow.structure.assembly.inputs}
    if taken != set(held):
        part = determinant([[tau[v] for v in held] for tau in flow.tau])
        if varies(part):
            for _ in held:
                part = part / flow.scale
            events.append((EventFunction(part * (1.0 / STEEPEST)), "type_2", -1))
    if varies(measure):
        crossed = EventFunction(
            measure - constant(symbols.layout.least), stops=True, sense=-1
        )
        events.append((crossed, "singularity", -1))
    if varies(spread):
        room = 1.0 - spread * (1.0 / STEEPEST)
        events.append((EventFunction(room, stops=True, sense=-1), "coordinates", -1))
    return events


@final
class _Masses:
    """What the links' inertia does, all of it over `size`."""

    def __init__(
        self,
        mechanism: Mechanism,
        placed: Sequence[LinkOrientation],
        flow: CoordinateRates,
        size: float,
    ) -> None:
        self._links = [
            (link, placed[link], placed[link].tensor(tensor / size))
            for link, tensor in tensors(mechanism).items()
            if link and np.any(tensor)
        ]
        self._seen = [
            [placed.seen(w[link]) for w in flow.w] for link, placed, _ in self._links
        ]
        self._momenta = [
            [constants(tensor) @ y for y in seen]
            for (_, _, tensor), seen in zip(self._links, self._seen, strict=True)
        ]

    @property
    def matrix(self) -> list[list[Expr]]:
        """The inertia matrix by tau."""
        count = len(self._seen[0])
        matrix: list[list[Expr]] = [[0.0] * count for _ in range(count)]
        for seen, momenta in zip(self._seen, self._momenta, strict=True):
            for i in range(count):
                for k in range(i + 1):
                    matrix[i][k] = matrix[i][k] + dot(seen[i], momenta[k])
        for i in range(count):
            for k in range(i):
                matrix[k][i] = matrix[i][k]
        return matrix

    def pull(self, bias: Sequence[Exprs], slow: Sequence[Expr]) -> list[Expr]:
        """Return what the links resist by at no acceleration of the inputs, by tau.

        With y_i the rates w_ji seen from the link, h its momentum: y_i . I b, as I y_i . b,
        and y_i . (w x h) = sum of s_k h . (y_i x y_k), of which one sign is enough.
        """
        count = len(slow)
        pulls: list[Expr] = [0.0] * count
        turned: list[list[Expr]] = [[0.0] * count for _ in range(count)]
        for (link, placed, _), seen, momenta in zip(
            self._links, self._seen, self._momenta, strict=True
        ):
            acceleration, momentum = placed.seen(bias[link]), _along(momenta, slow)
            for i in range(count):
                pulls[i] = pulls[i] + dot(momenta[i], acceleration)
                for k in range(i):
                    turned[i][k] = turned[i][k] + dot(cross(seen[i], seen[k]), momentum)
        for i in range(count):
            for k in range(i):
                pulls[i] = pulls[i] + slow[k] * turned[i][k]
                pulls[k] = pulls[k] - slow[i] * turned[i][k]
        return pulls
