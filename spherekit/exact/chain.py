"""Closure of a whole mechanism, link by link: orientations, gaps of the loops, Jacobian."""

from functools import cached_property
from typing import final

import numpy as np

from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.joints import exact_joints
from spherekit.exact.series import matrix_product, skew_part, transpose
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


@final
class ExactChain:
    """The links of a mechanism placed one after another from the ground.

    Every link is placed once, across the pair that reaches it first; each further pair
    closes a loop, which is open by the skew part of the rotation left over.
    """

    def __init__(self, arithmetic: Arithmetic, mechanism: Mechanism) -> None:
        self.arithmetic, self.mechanism = arithmetic, mechanism
        self.joints = exact_joints(arithmetic, mechanism)
        self._way = spanning(mechanism.ends)
        used = {pair for pair, _, _ in self._way}
        self.chords = [pair for pair in range(len(self.joints)) if pair not in used]
        self._columns = [
            list(mechanism.variables_of(pair)) for pair in range(len(self.joints))
        ]

    def place(self, values: Numbers) -> tuple[Numbers, list[Numbers]]:
        """Return link orientations (k, n, links, 3, 3) and the turn of every pair.

        `values` (k, n, variables) are series of all pair variables; turns (k, n, 3, 3)
        are of a pair's second link in the axes of its first.
        """
        turns = [
            joint.turn(values[..., columns])
            for joint, columns in zip(self.joints, self._columns, strict=True)
        ]
        first = np.zeros((*values.shape[:2], 3, 3))
        first[0] = np.eye(3)
        orientations = {0: self.arithmetic.exact(first)}
        for pair, parent, child in self._way:
            turn = turns[pair]
            if self.mechanism.ends[pair][0] == child:
                turn = transpose(turn)
            orientations[child] = matrix_product(orientations[parent], turn)
        every = range(len(self.mechanism.links))
        return np.stack([orientations[link] for link in every], axis=2), turns

    def gaps(self, placed: Numbers, turns: list[Numbers]) -> Numbers:
        """Return series (k, n, 3 loops): by how much the loops stay open, rad."""
        gaps = [self.arithmetic.zeros(*placed.shape[:2], 0)]
        for pair in self.chords:
            a, b = self.mechanism.ends[pair]
            left = matrix_product(placed[:, :, a], turns[pair])
            gaps.append(skew_part(matrix_product(left, transpose(placed[:, :, b]))))
        return np.concatenate(gaps, axis=-1)

    def vectors(self, values: Numbers, placed: Numbers) -> Numbers:
        """Return the variables' vectors (n, variables, 3) in ground axes.

        A variable's vector is the angular velocity of its pair's second link relative to
        the first per unit rate. `values` (n, variables), `placed` (n, links, 3, 3).
        """
        vectors = []
        for joint, columns, ends in zip(
            self.joints, self._columns, self.mechanism.ends, strict=True
        ):
            in_link = joint.vectors(values[:, columns])
            vectors.append(in_link @ transpose(placed[:, ends[0]]))
        return np.concatenate(vectors, axis=1)

    def axes(self, values: Numbers, placed: Numbers) -> Numbers:
        """Return (n, pairs, 3): the axis of each R pair, the contact point of others."""
        axes = []
        for joint, columns, ends in zip(
            self.joints, self._columns, self.mechanism.ends, strict=True
        ):
            in_link = joint.axis(values[:, columns])
            axes.append((placed[:, ends[0]] @ in_link[..., None])[..., 0])
        return np.stack(axes, axis=1)

    @cached_property
    def _ways(self) -> Floats:
        """(links, pairs): the sense in which the way from the ground passes a pair."""
        ways = np.zeros((len(self.mechanism.links), len(self.joints)))
        for pair, parent, child in self._way:
            ways[child] = ways[parent]
            ways[child, pair] = 1.0 if self.mechanism.ends[pair][0] == parent else -1.0
        return ways

    @cached_property
    def _passes(self) -> Floats:
        """(loops, variables): the sense in which a loop passes the pair of a variable."""
        passes = np.zeros((len(self.chords), len(self.joints)))
        for row, pair in enumerate(self.chords):
            a, b = self.mechanism.ends[pair]
            passes[row] = self._ways[a] - self._ways[b]
            passes[row, pair] += 1.0
        return passes[:, list(self.mechanism.variable_owners)]

    def velocities(self, vectors: Numbers, rates: Numbers) -> Numbers:
        """Return angular velocities (n, links, 3) relative to the ground, in its axes.

        At `vectors` (n, variables, 3) and rates (n, variables) of the variables.
        """
        n, count, _ = vectors.shape
        velocities = self.arithmetic.zeros(n, len(self.mechanism.links), 3)
        moved = vectors * rates[:, :, None]
        owners = self.mechanism.variable_owners
        for link, senses in enumerate(self._ways):
            for variable in range(count):
                sense = senses[owners[variable]]
                if sense:
                    part = moved[:, variable]
                    velocities[:, link] += part if sense > 0 else -part
        return velocities

    def jacobian(self, vectors: Numbers) -> Numbers:
        """Return (n, 3 loops, variables): gaps change by it times the variables' rates."""
        n, count, _ = vectors.shape
        jacobian = self.arithmetic.zeros(n, 3 * len(self.chords), count)
        for row, senses in enumerate(self._passes):
            for column in np.flatnonzero(senses):
                part = vectors[:, column]
                jacobian[:, 3 * row : 3 * row + 3, column] = (
                    part if senses[column] > 0 else -part
                )
        return jacobian
