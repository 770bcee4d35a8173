"""The rates of a mechanism of several freedoms as terms, in the variables of its inputs.

In homogeneous form: `tau[i]` are the rates of all variables times `scale` while input i
moves at the rate 1 and the others rest. The scale vanishes where these inputs do not say
how all variables move.
"""

from collections.abc import Sequence
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs, cross, vector_sum
from spherekit.engine.expression_graph import Expr
from spherekit.engine.kinematics import Structure
from spherekit.engine.pose import LinkOrientation, spin_vectors
from spherekit.motion.loops import LoopTree


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
