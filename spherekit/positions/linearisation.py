"""The loops of a chain: a spanning tree, the velocity equations, their rank.

Configurations of bodies joined by pairs, and their equations to second order.

A `Closure` says which bodies and pairs there are; a `Linearisation` is that closure at n
configurations. Every part of it is computed when it is first asked for, and kept.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.mirror import rotation_vector
from spherekit.geometry.rotation import all_finite, max_abs, nans, transpose
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint import Joint, Kind, PairStates
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.pair_states import Places, _by_kind, pair_states

REDUNDANT = 1e-10
"""Equations whose relative singular value is below this repeat the others."""
DEPENDENT = 1e-9
"""The same for the velocity equations whose rank is asked for."""


@dataclass(frozen=True)
class LoopTree:
    """A spanning tree of bodies and the loops that the other pairs close.

    `ends[e]` are the first and second body of pair e, `owners[v]` the pair of variable v.
    """

    count: int
    ends: tuple[tuple[int, int], ...]
    owners: tuple[int, ...]

    @staticmethod
    def of(mechanism: Mechanism) -> "LoopTree":
        """Return the tree of a whole mechanism, rooted in the ground."""
        return LoopTree(len(mechanism.links), mechanism.ends, mechanism.variable_owners)

    @cached_property
    def firsts(self) -> Indices:
        """The first body of each pair."""
        return np.array(self.ends, dtype=np.intp)[:, 0]

    @cached_property
    def seconds(self) -> Indices:
        """The second body of each pair."""
        return np.array(self.ends, dtype=np.intp)[:, 1]

    @cached_property
    def placements(self) -> tuple[tuple[int, int, int], ...]:
        """Tree pairs in order of placement: (pair, parent body, child body)."""
        return find_spanning_tree(self.ends)

    @cached_property
    def _pair_paths(self) -> Floats:
        paths = np.zeros((self.count, len(self.ends)))
        for pair, parent, child in self.placements:
            paths[child] = paths[parent]
            paths[child, pair] = 1.0 if self.ends[pair][0] == parent else -1.0
        return paths

    @cached_property
    def paths(self) -> Floats:
        """(bodies, variables): sense in which the way from body 0 to each body uses it."""
        return self._pair_paths[:, list(self.owners)]

    @cached_property
    def chords(self) -> tuple[int, ...]:
        """The pairs that close a loop each."""
        tree = {pair for pair, _, _ in self.placements}
        return tuple(sorted({*range(len(self.ends))} - tree))

    @cached_property
    def closing(self) -> Indices:
        """(3, loops): the chords, and the first and the second body of each."""
        chords = np.array(self.chords, dtype=np.intp)
        return np.stack([chords, self.firsts[chords], self.seconds[chords]])

    @cached_property
    def signs(self) -> Floats:
        """(loops, variables): sense in which loops pass the pair of each variable."""
        chords, firsts, seconds = self.closing
        rows = self._pair_paths[firsts] - self._pair_paths[seconds]
        return (rows + np.eye(len(self.ends))[chords])[:, list(self.owners)]

    @property
    def longest_loop(self) -> int:
        """The number of variables in the longest loop."""
        return int(np.max(np.count_nonzero(self.signs, axis=1), initial=0))

    @property
    def longest_path(self) -> int:
        """The number of variables on the longest way from body 0."""
        return int(np.max(np.count_nonzero(self.paths, axis=1)))

    @cached_property
    def incidence(self) -> Floats:
        """(pairs, bodies): -1 at the first body of each pair, 1 at the second."""
        bodies = np.eye(self.count)
        return bodies[self.seconds] - bodies[self.firsts]

    @cached_property
    def cycles(self) -> Floats:
        """(loops, pairs) an orthonormal basis of the cycles of the graph."""
        left, _, _ = np.linalg.svd(self.incidence)
        return np.ascontiguousarray(left[:, self.count - 1 :].T)

    def jacobian(self, vectors: Floats) -> Floats:
        """Return J (n, 3 loops, variables) from vectors (n, variables, 3): J rates = 0.

        A variable's vector is the angular velocity of its pair's second body relative to
        the first per unit rate of the variable.
        """
        n, variables, _ = vectors.shape
        grid = self.signs[None, :, None, :] * np.swapaxes(vectors, 1, 2)[:, None]
        return np.ascontiguousarray(grid.reshape(n, 3 * len(self.chords), variables))

    def body_rates(self, vectors: Floats, rates: Floats) -> Floats:
        """Return angular velocities (n, bodies, 3) relative to body 0, in its axes."""
        return self.paths @ (rates[..., None] * vectors)


def condition(matrices: Floats) -> Floats:
    """Return the conditions (n,) of matrices (n, m, k) in the 2-norm.

    Infinite where columns depend on each other, 1 where there is none, NaN of what is not
    finite.
    """
    _, rows, columns = matrices.shape
    finite = all_finite(matrices, (1, 2))
    conditions = np.where(finite, np.inf if columns else 1.0, np.nan)
    if 0 < columns <= rows:
        conditions[finite] = np.linalg.cond(matrices[finite])
    return conditions


def left_inverse(matrices: Floats) -> Floats:
    """Return inverses (n, k, m) of matrices (n, m, k) with m >= k; NaN where singular.

    With more rows than columns the extra equations must agree with the others.
    """
    n, rows, columns = matrices.shape
    if rows == columns:
        try:
            return np.asarray(np.linalg.inv(matrices))
        except np.linalg.LinAlgError:
            with np.errstate(invalid="ignore"):
                regular = np.linalg.slogdet(matrices)[0] != 0.0
            inverse = nans(matrices.shape)
            inverse[regular] = np.linalg.inv(matrices[regular])
            return inverse
    if rows < columns or not columns:
        return nans((n, columns, rows))
    finite = all_finite(matrices, (1, 2))[:, None, None]
    left, sizes, right = np.linalg.svd(np.where(finite, matrices, 0.0), full_matrices=False)
    full = sizes[:, -1] > REDUNDANT * sizes[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverses = (np.swapaxes(right, 1, 2) / sizes[:, None]) @ np.swapaxes(left, 1, 2)
    return np.where(full[:, None, None], inverses, np.nan)


def rank_mobility(tree: LoopTree, vectors: Floats, dependent: float = DEPENDENT) -> Floats:
    """Return the nullity (n,) of the velocity equations: the mobility at each sample.

    Singular values below the part `dependent` of the largest count as zero.
    """
    values = np.linalg.svd(tree.jacobian(vectors), compute_uv=False)
    return vectors.shape[1] - np.sum(values > dependent * values[:, :1], axis=1)


def redundancy(tree: LoopTree, vectors: Floats) -> tuple[int, tuple[int, ...]]:
    """Return how many loop equations of one configuration repeat others, and their pairs.

    By the vectors (variables, 3); the pairs, by their numbers, are those of the loops that
    take part in the left null space of the velocity equations.
    """
    if not tree.chords:
        return 0, ()
    jacobian = tree.jacobian(vectors[None])[0]
    left, values, _ = np.linalg.svd(jacobian)
    rank = int(np.sum(values > DEPENDENT * values[0]))
    weights = np.linalg.norm(left[:, rank:].reshape(len(tree.chords), 3, -1), axis=(1, 2))
    taking_part = np.any(tree.signs[weights > DEPENDENT] != 0.0, axis=0)
    pairs = {tree.owners[variable] for variable in np.flatnonzero(taking_part)}
    return len(jacobian) - rank, tuple(sorted(pairs))


_UNTURNED = np.eye(3)
Locks = tuple[list[int], Floats]
"""Variables, and the values (n or 1, locks) rad at which they are locked."""


@dataclass(frozen=True)
class Linearisation:
    """n configurations of a closure, with all that follows from them.

    Attributes
    ----------
    tree, joints
        The loops, and the joints of the pairs.
    values
        (n, variables) rad.
    leads
        (n or 1, pairs, 3, 3) twice, see `Closure`; None where bodies are links.
    rotations
        (n, bodies, 3, 3) orientations in body 0 that are known already.
    locks
        Variables with the values at which they are locked, one equation more each.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    values: Floats
    leads: tuple[Floats, Floats] | None = None
    rotations: Floats | None = None
    locks: Locks | None = None

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def states(self) -> PairStates:
        """The pairs' frames in their bodies, curvatures, and what lies on profiles."""
        states = pair_states(self.joints, self.values)
        if self.leads is None:
            return states
        first, second = self.leads[0] @ states.first, self.leads[1] @ states.second
        return states._replace(first=first, second=second)

    @cached_property
    def placed(self) -> Floats:
        """Orientations (n, bodies, 3, 3) of the bodies in body 0."""
        if self.rotations is not None:
            return self.rotations
        placed = np.empty((len(self.values), self.tree.count, 3, 3))
        placed[:, 0] = _UNTURNED
        across = self.states.first @ transpose(self.states.second)
        for pair, parent, child in self.tree.placements:
            ahead = self.tree.ends[pair][0] == parent
            turn = across[:, pair] if ahead else transpose(across[:, pair])
            if parent:
                np.matmul(placed[:, parent], turn, out=placed[:, child])
            else:
                placed[:, child] = turn
        return placed

    @cached_property
    def frames(self) -> Floats:
        """Pair frames (n, pairs, 3, 3) in the axes of body 0; columns as in `Joint`."""
        return self.placed[:, self.tree.firsts] @ self.states.first

    @cached_property
    def axes(self) -> Floats:
        """(n, pairs, 3), in the axes of body 0.

        The axis (R), the contact line (Cr), the normal of the contact plane (Cs).
        """
        axes = np.empty(self.frames.shape[:-1])
        for kind, _, pairs, _ in _by_kind(self.joints):
            axes[:, pairs] = self.frames[..., kind.axis_column][:, pairs]
        return axes

    @cached_property
    def vectors(self) -> Floats:
        """The variables' vectors (n, variables, 3) in the axes of body 0."""
        frames, curvatures = self.frames, self.states.curvatures
        return self._of_variables(
            lambda kind, pairs: kind.velocity_vectors(
                frames[:, pairs], curvatures[:, pairs]
            )
        )

    def _of_variables(self, of_kind: Callable[[Kind, Places], Floats]) -> Floats:
        """Return vectors (n, variables, 3), for pairs of each kind what a function says."""
        vectors = np.empty((*self.values.shape, 3))
        for kind, _, pairs, variables in _by_kind(self.joints):
            vectors[:, variables] = of_kind(kind, pairs).reshape(
                vectors[:, variables].shape
            )
        return vectors

    @cached_property
    def residual(self) -> Floats:
        """(n, 3 loops): rotation vectors (rad) by which the loops stay open.

        After them how far what is locked is away, (n, locks).
        """
        chords, firsts, seconds = self.tree.closing
        one = self.placed[:, firsts] @ self.states.first[:, chords]
        other = self.placed[:, seconds] @ self.states.second[:, chords]
        gaps = rotation_vector(one @ transpose(other))
        gaps = gaps.reshape(len(gaps), 3 * len(chords))
        if self.locks is None:
            return gaps
        variables, places = self.locks
        return np.append(gaps, self.values[:, variables] - places, axis=1)

    @property
    def gap(self) -> Floats:
        """(n,) the largest component of the residual (rad)."""
        return max_abs(self.residual, axis=1)

    @cached_property
    def jacobian(self) -> Floats:
        """J (n, equations, variables): rates with J rates = 0 keep the loops closed."""
        jacobian = self.tree.jacobian(self.vectors)
        if self.locks is None:
            return jacobian
        rows = np.eye(jacobian.shape[2])[self.locks[0]]
        every = np.broadcast_to(rows, (len(jacobian), *rows.shape))
        return np.concatenate([jacobian, every], axis=1)

    def body_rates(self, rates: Floats) -> Floats:
        """Return angular velocities (n, bodies, 3) at rates (n, variables)."""
        return self.tree.body_rates(self.vectors, rates)

    def pair_rates(self, first_w: Floats, second_w: Floats) -> Floats:
        """Return how the vectors (n, variables, 3) change, given the rates of the links.

        `first_w`, `second_w` (n, pairs, 3) are angular velocities in the axes of body 0.
        """
        frames, states = self.frames, self.states
        return self._of_variables(
            lambda kind, pairs: kind.vector_rates(
                frames[:, pairs], states.take(pairs), first_w[:, pairs], second_w[:, pairs]
            )
        )

    def turned(self, w: Floats) -> Floats:
        """Return how the vectors change as bodies turn at w (n, bodies, 3)."""
        return self.pair_rates(w[:, self.tree.firsts], w[:, self.tree.seconds])

    def bias(self, rates: Floats) -> Floats:
        """Return J' rates (n, equations), J' the change of J at rates (n, variables)."""
        turned = self.turned(self.body_rates(rates))
        bias = np.einsum("nij,nj->ni", self.tree.jacobian(turned), rates)
        if self.locks is None:
            return bias
        return np.pad(bias, ((0, 0), (0, len(self.locks[0]))))
