"""The loops of a chain of bodies: spanning tree, velocity equations, mobility by rank.

A chain consists of bodies joined by pairs. A spanning tree of pairs reaches every body from
body 0. Each other pair is a chord, which closes one loop: the chord, and the tree paths to
its two bodies. At rates of the pair variables that keep the loops closed, the angular
velocities around each loop add up to zero,

    sum over the variables v of  sign(loop, v) rate_v w_v  =  0,

where the velocity vector w_v is the angular velocity of the second body of the pair
relative to the first one at unit rate of v, and the sign is +1, -1 or 0. These are three
equations for each loop; their matrix is the Jacobian of the loop closure.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism

RANK_TOLERANCE = 1e-9
"""Singular values of the velocity equations below this part of the largest count as zero.

Larger: configurations near singular ones have a higher mobility. Smaller: because of
rounding, redundant constraints are not recognised.
"""


@dataclass(frozen=True)
class LoopTree:
    """A spanning tree of bodies, and the loops that the other pairs close.

    The bodies and the pairs (joints) between them form a graph. Each pair that is not in
    the tree is a chord, which closes one loop.

    Attributes
    ----------
    count
        Number of bodies. Body 0 is the root.
    ends
        First and second body of each pair.
    pair_of_variable
        The pair to which each variable belongs.
    """

    count: int
    ends: tuple[tuple[int, int], ...]
    pair_of_variable: tuple[int, ...]

    @staticmethod
    def of_mechanism(mechanism: Mechanism) -> "LoopTree":
        """Return the tree of a whole mechanism: bodies are links, body 0 is the ground."""
        return LoopTree(len(mechanism.links), mechanism.ends, mechanism.variable_owners)

    @cached_property
    def first_bodies(self) -> Indices:
        """(pairs,) the first body of each pair."""
        return np.array(self.ends, dtype=np.intp)[:, 0]

    @cached_property
    def second_bodies(self) -> Indices:
        """(pairs,) the second body of each pair."""
        return np.array(self.ends, dtype=np.intp)[:, 1]

    @cached_property
    def placements(self) -> tuple[tuple[int, int, int], ...]:
        """The pairs of the tree, in an order in which the bodies can be placed.

        Each item is a tuple: the pair, the body that is placed already (parent), and the
        body that the pair places next (child).
        """
        return find_spanning_tree(self.ends)

    @cached_property
    def _pair_paths(self) -> Floats:
        """(bodies, pairs) how the tree path to a body passes each pair, as in `paths`."""
        paths = np.zeros((self.count, len(self.ends)))
        for pair, parent, child in self.placements:
            paths[child] = paths[parent]
            paths[child, pair] = 1.0 if self.ends[pair][0] == parent else -1.0
        return paths

    @cached_property
    def paths(self) -> Floats:
        """(bodies, variables) signs with which variables turn a body relative to body 0.

        The sign is +1 if the path in the tree from body 0 to the body passes the pair of
        the variable from its first to its second body. The sign is -1 in the opposite
        sense, and 0 if the path does not pass the pair.
        """
        return self._pair_paths[:, list(self.pair_of_variable)]

    @cached_property
    def chords(self) -> tuple[int, ...]:
        """The pairs outside the tree, each of which closes one loop."""
        tree_pairs = {pair for pair, _, _ in self.placements}
        return tuple(sorted({*range(len(self.ends))} - tree_pairs))

    @property
    def loop_count(self) -> int:
        """Number of independent loops. Each pair outside the tree closes one."""
        return len(self.chords)

    @cached_property
    def closing(self) -> Indices:
        """(3, loops) the chord of each loop, its first body, and its second body."""
        chords = np.array(self.chords, dtype=np.intp)
        return np.stack([chords, self.first_bodies[chords], self.second_bodies[chords]])

    @cached_property
    def signs(self) -> Floats:
        """(loops, variables) how each loop passes a variable: +1, -1 or 0 as in `paths`.

        A loop runs along the tree from body 0 to the first body of its chord (the pair that
        closes it), over the chord, and along the tree back from the second body.
        """
        chords, firsts, seconds = self.closing
        signs_of_pairs = self._pair_paths[firsts] - self._pair_paths[seconds]
        return (signs_of_pairs + np.eye(len(self.ends))[chords])[
            :, list(self.pair_of_variable)
        ]

    @property
    def longest_loop(self) -> int:
        """Number of variables in the longest loop."""
        return int(np.max(np.count_nonzero(self.signs, axis=1), initial=0))

    @property
    def longest_path(self) -> int:
        """Number of variables on the longest tree path from body 0 to a body."""
        return int(np.max(np.count_nonzero(self.paths, axis=1)))

    @cached_property
    def incidence(self) -> Floats:
        """(pairs, bodies) -1 at the first body of each pair, +1 at the second."""
        bodies = np.eye(self.count)
        return bodies[self.second_bodies] - bodies[self.first_bodies]

    @cached_property
    def cycles(self) -> Floats:
        """(loops, pairs) orthonormal basis of the cycles of the graph."""
        # Cycles are the left null space of the incidence matrix, whose rank is one less
        # than the number of bodies in a connected graph.
        left_vectors, _, _ = np.linalg.svd(self.incidence)
        return np.ascontiguousarray(left_vectors[:, self.count - 1 :].T)

    def jacobian(self, vectors: Floats) -> Floats:
        """Return the matrices of the velocity equations of all loops, for n configurations.

        Bodies are joined by pairs (joints). Around each closed loop, the angular velocities
        of the pairs add up to zero: three equations for each loop. A pair has the sign +1
        if the loop passes from its first to its second body, -1 if it passes in the
        opposite sense. The sign is 0 if the pair is not in the loop (`signs`).

        Parameters
        ----------
        vectors
            (n, variables, 3) velocity vector of each pair variable, in common axes: the
            angular velocity of the second body of the pair relative to the first at unit
            rate.

        Returns
        -------
        (n, 3 loops, variables) matrices J. The loops stay closed at rates with J rates = 0.
        """
        n, variables, _ = vectors.shape
        # Axes: configuration, loop, component of the vector, variable.
        blocks = self.signs[None, :, None, :] * np.swapaxes(vectors, 1, 2)[:, None]
        loop_count = len(self.chords)  # each pair outside of the tree closes one loop
        return np.ascontiguousarray(blocks.reshape(n, 3 * loop_count, variables))

    def body_rates(self, vectors: Floats, rates: Floats) -> Floats:
        """Return the angular velocities (n, bodies, 3) of all bodies relative to body 0.

        Parameters
        ----------
        vectors
            (n, variables, 3) velocity vector of each variable in the axes of body 0: the
            relative angular velocity of the bodies of its pair at unit rate.
        rates
            (n, variables) rates of the variables.
        """
        return self.paths @ (rates[..., None] * vectors)


def rank_mobility(
    tree: LoopTree, vectors: Floats, rank_tolerance: float = RANK_TOLERANCE
) -> Floats:
    """Return the mobility (degrees of freedom) of n configurations, as an array (n,).

    The mobility is the number of pair variables less the rank of the velocity equations.

    Parameters
    ----------
    tree
        The bodies, the pairs (joints) that join them, and the loops that they form.
    vectors
        (n, variables, 3) velocity vector of each variable: the angular velocity of the
        second body of its pair relative to the first one at unit rate.
    rank_tolerance
        Singular values below this part of the largest count as zero.
    """
    singular_values = np.linalg.svd(tree.jacobian(vectors), compute_uv=False)
    is_nonzero = singular_values > rank_tolerance * singular_values[:, :1]
    return vectors.shape[1] - np.sum(is_nonzero, axis=1)


def redundancy(tree: LoopTree, vectors: Floats) -> tuple[int, tuple[int, ...]]:
    """Return the number of redundant velocity equations, and the pairs in their loops.

    The velocity equations state that the angular velocities of the pairs (joints) around
    each closed loop add up to zero. These are three equations for each loop. An equation is
    redundant if it follows from the others.

    Parameters
    ----------
    tree
        The bodies, the pairs, and the loops that they form. Its signs (loops, variables)
        state in which sense a loop passes the pair of a variable: +1 or -1. The sign is 0
        if the pair is not in the loop.
    vectors
        (variables, 3) velocity vector of each variable in one configuration: the angular
        velocity of the second body of its pair relative to the first one at unit rate.

    Returns
    -------
    count
        Number of equations less the rank of their matrix.
    pairs
        Indices of the pairs in the loops whose equations depend on each other.
    """
    if tree.loop_count == 0:
        return 0, ()
    # The matrix of the velocity equations: three rows for each loop, one column for each
    # variable.
    (jacobian,) = tree.jacobian(vectors[None])
    equation_count = len(jacobian)
    left_vectors, singular_values, _ = np.linalg.svd(jacobian)
    rank = int(np.sum(singular_values > RANK_TOLERANCE * singular_values[0]))
    # The remaining left singular vectors are the linear dependencies between the equations.
    # Axes: loop, component of its vector equation, dependency.
    dependencies = left_vectors[:, rank:].reshape(tree.loop_count, 3, -1)
    # A loop is dependent if one of its equations has a weight in a dependency.
    loop_weights = np.linalg.norm(dependencies, axis=(1, 2))
    is_dependent_loop = loop_weights > RANK_TOLERANCE
    signs_in_dependent_loops = tree.signs[is_dependent_loop]
    is_in_dependent_loop = np.any(signs_in_dependent_loops != 0.0, axis=0)
    variables = np.flatnonzero(is_in_dependent_loop)
    pairs = {tree.pair_of_variable[variable] for variable in variables}
    return equation_count - rank, tuple(sorted(pairs))
