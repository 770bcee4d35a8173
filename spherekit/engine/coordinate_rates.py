"""Velocity equations as terms, in the variables of the inputs: rates, misfits, moments.

In homogeneous form: `tau[i]` are the rates of all variables times `scale` while input i
moves at the rate 1 and the others rest. The scale vanishes where these inputs do not say
how all variables move.

With links placed along a tree of pairs, the pairs that close loops miss each other by a
small rotation. At the inputs at rest the variables change so that all pairs fit again:
w_second - w_first = A x - e, with A the vectors of the pair's variables, x their changes,
and e the rotation by which its second link is turned against where the pair has it. With
the misfit of a configuration that is nearly closed, x is Newton's step; with the rate of
the misfit by a size, the derivative of the variables by it.

The moments that a motion takes at the inputs are Newton's and Euler's equations of the
links along the velocities that an input leaves free while the others rest:

    torque_i = sum_j w_ji . (I_j a_j + w_j x I_j w_j) - the power of the loads by input i,

with w_ji the angular velocity of link j per unit rate of input i.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.engine.algebra import Exprs, cross, dot, vector, vector_sum
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    derivatives,
)
from spherekit.engine.kinematics import Structure
from spherekit.engine.pose import Angles, LinkOrientation, placed_by, spin_vectors
from spherekit.engine.turns import Entries
from spherekit.motion.loops import LoopTree


def _rotations(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    pair: int,
) -> list[Exprs]:
    """Return the rotation (3, 3) of a pair's second link, and where the pair has it."""
    first, second = structure.mechanism.ends[pair]
    chain = structure.pairs.chains[pair]
    there = placed_by(chain, links[first], Angles(variables))
    return [
        np.stack([placed.direction(axis) for axis in np.eye(3)], axis=1)
        for placed in (links[second], there)
    ]


def _half_turn(basis: Exprs, rate: Exprs) -> Exprs:
    """Return half the sum of b x b' over the columns of two matrices (3, 3)."""
    total = vector([0.0, 0.0, 0.0])
    for k in range(3):
        total = total + cross(basis[:, k], rate[:, k])
    return np.asarray(total * 0.5)


def misfits(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> dict[int, Exprs]:
    """Return by how much (3,) each pair that closes a loop is off, to first order (rad)."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        made[pair] = _half_turn(there, here)
    return made


def openness(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> Expr:
    """Return the square of by how much loops are open (rad2), half turns included."""
    total: Expr = 0.0
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        for entry in (here - there).ravel():
            total = total + 0.5 * (entry * entry)
    return total


def misfit_rates(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    by: ExpressionNode,
) -> dict[int, Exprs]:
    """Return the rates (3,) of the misfits by a size, the variables held."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        turned = []
        for basis in _rotations(structure, links, variables, pair):
            rate = vector(derivatives(list(basis.ravel()), by)).reshape(3, 3)
            turned.append(_half_turn(basis, rate))
        made[pair] = np.asarray(turned[0] - turned[1])
    return made


def answers(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> list[Expr]:
    """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""
    return newton_step(structure, links, misfit)[0]


def newton_step(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> tuple[list[Expr], Expr]:
    """Return the `answers`, and the determinant of the equations."""
    solver = structure.solved(structure.at_rest, structure.vectors(links), misfit)
    made = [solver.rates[v] / solver.scale for v in range(len(solver.vectors))]
    return made, solver.scale


def rates_by_inputs(
    structure: Structure, links: Sequence[LinkOrientation]
) -> tuple[list[list[Expr]], Expr]:
    """Return the derivatives of all variables by each input, and the determinant.

    It is that of the equations: its sign changes where modes meet.
    """
    made, vectors = [], structure.vectors(links)
    for pair in structure.input_pairs:
        solver = structure.solved(structure.moving(pair), vectors)
        made.append([solver.rates[v] / solver.scale for v in range(len(solver.vectors))])
    return made, solver.scale


@final
class CoordinateRates:
    """Rates at given placements of the links.

    `vectors[v]` (3,) are the angular velocities of pairs' second links relative to the
    first per unit rate of variables, in ground axes; `w[i][link]` (3,) those of links per
    unit rate of input i, times `scale` as `tau[i][v]` are.
    """

    def __init__(self, structure: Structure, placed: Sequence[LinkOrientation]) -> None:
        self.structure = structure
        mechanism = structure.mechanism
        self.tree = LoopTree.of(mechanism)
        self._spins = [
            spin_vectors(structure.pairs, placed, v)
            for v in range(len(mechanism.variable_owners))
        ]
        self.vectors = structure.vectors(placed)
        self.tau: list[list[Expr]] = []
        for moving in structure.input_pairs:
            solver = structure.solved(structure.moving(moving), self.vectors)
            self.tau.append([solver.rates[v] for v in range(len(self.vectors))])
            self.scale = solver.scale
        self.w = [self.links(self._parts(tau)) for tau in self.tau]

    def _parts(self, rates: Sequence[Expr]) -> list[Exprs]:
        """Return what pairs turn by (3,) at rates of their variables."""
        owned = self.structure.mechanism.variables_of
        return [
            vector_sum([self.vectors[v] * rates[v] for v in owned(pair)])
            for pair in range(len(self.tree.ends))
        ]

    def links(self, parts: Sequence[Exprs]) -> list[Exprs]:
        """Return the sums (3,) of what pairs turn by, on the way to each link."""
        vectors = [vector_sum([])] * self.tree.count
        for pair, parent, child in self.tree.placements:
            ahead = self.tree.ends[pair][0] == parent
            part = parts[pair]
            vectors[child] = vectors[parent] + part if ahead else vectors[parent] - part
        return vectors

    def bias(self, rates: Sequence[Expr], w: Sequence[Exprs]) -> list[Exprs]:
        """Return the angular accelerations (3,) of links while no input accelerates.

        `rates` are those of the variables by time, `w` (3,) the links' angular velocities.
        """
        turning = [self._turning(pair, rates, w) for pair in range(len(self.tree.ends))]
        misfits = {pair: np.asarray(turned * -1.0) for pair, turned in enumerate(turning)}
        solver = self.structure.solved(self.structure.at_rest, self.vectors, misfits)
        share = 1.0 / solver.scale
        second = [solver.rates[v] * share for v in range(len(self.vectors))]
        accelerated = self._parts(second)
        return self.links([a + b for a, b in zip(accelerated, turning, strict=True)])

    def _turning(self, pair: int, rates: Sequence[Expr], w: Sequence[Exprs]) -> Exprs:
        """Return the change (3,) of what a pair turns by, while its rates stay."""
        mechanism = self.structure.mechanism
        variables = mechanism.variables_of(pair)
        if mechanism.pairs[pair].kind.has_axis:
            # w_first x (rate axis), and rate axis = w_second - w_first.
            first, second = mechanism.ends[pair]
            return cross(w[first], w[second])
        changes = [
            spin.change(w[spin.link], rates[v]) * (spin.size * rates[v])
            for v in variables
            for spin in self._spins[v]
        ]
        return vector_sum(changes)


@final
class InputMoments:
    """What links with tensors (3, 3), by number and in link axes, resist to inputs."""

    def __init__(
        self,
        flow: CoordinateRates,
        placed: Sequence[LinkOrientation],
        tensors: Mapping[int, Entries],
    ) -> None:
        self.flow = flow
        self._share = 1.0 / flow.scale
        # Entries near 0 are made exact zeros, so they need a size near one.
        plain = [tensor for tensor in tensors.values() if tensor.dtype != object]
        sizes = [float(np.max(np.abs(tensor))) for tensor in plain]
        self._unit = max(sizes, default=1.0) or 1.0
        self._momenta = {
            link: (placed[link], placed[link].tensor(tensor / self._unit))
            for link, tensor in tensors.items()
            if link
        }

    def _momentum(self, link: int, w: Exprs) -> Exprs:
        placed, tensor = self._momenta[link]
        return np.asarray(placed.basis @ (tensor @ placed.seen(w)))

    def inertia(self, one: int, other: int) -> Expr:
        """Return the inertia between two inputs."""
        total: Expr = 0.0
        for link, (placed, tensor) in self._momenta.items():
            y, x = (placed.seen(self.flow.w[which][link]) for which in (one, other))
            total = total + dot(y, tensor @ x)
        return total * (self._share * self._share) * self._unit

    def moving(self, speeds: Sequence[Expr]) -> "MovingInputs":
        """Return the motion in which inputs have these rates."""
        slow = [speed * self._share for speed in speeds]
        rates = [_along(column, slow) for column in zip(*self.flow.tau, strict=True)]
        w = [_along(column, slow) for column in zip(*self.flow.w, strict=True)]
        return MovingInputs(self, rates, w)

    def resisted(self, moving: int, w: Sequence[Exprs], a: Sequence[Exprs]) -> Expr:
        """Return the moment of an input at links' velocities and accelerations (3,)."""
        total: Expr = 0.0
        for link in self._momenta:
            turned = cross(w[link], self._momentum(link, w[link]))
            push = self._momentum(link, a[link]) + turned
            total = total + dot(self.flow.w[moving][link], push)
        return total * self._share * self._unit


@final
@dataclass(frozen=True)
class MovingInputs:
    """A motion: rates by time of all variables, and angular velocities (3,) of links."""

    moments: InputMoments
    rates: Sequence[Expr]
    w: Sequence[Exprs]

    def resistance(self, moving: int, accelerations: Sequence[Expr]) -> Expr:
        """Return what links resist to an input while inputs accelerate like this."""
        flow = self.moments.flow
        bias = flow.bias(self.rates, self.w)
        slow = [acceleration * (1.0 / flow.scale) for acceleration in accelerations]
        a = [
            base + _along(velocities, slow)
            for base, velocities in zip(bias, zip(*flow.w, strict=True), strict=True)
        ]
        return self.moments.resisted(moving, self.w, a)


def _along(parts: Sequence[Any], rates: Sequence[Expr]) -> Any:
    total = parts[0] * rates[0]
    for part, rate in zip(parts[1:], rates[1:], strict=True):
        total = total + part * rate
    return total
