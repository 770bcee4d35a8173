"""The loops of a chain: a spanning tree, the velocity equations, their rank."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

REDUNDANT = 1e-10
"""Equations whose relative singular value is below this repeat the others."""
DEPENDENT = 1e-9
"""The same for the velocity equations whose rank is asked for."""


@final
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
    def firsts(self) -> NDArray[np.intp]:
        """The first body of each pair."""
        return np.array([first for first, _ in self.ends], dtype=np.intp)

    @cached_property
    def seconds(self) -> NDArray[np.intp]:
        """The second body of each pair."""
        return np.array([second for _, second in self.ends], dtype=np.intp)

    @cached_property
    def placements(self) -> tuple[tuple[int, int, int], ...]:
        """Tree pairs in order of placement: (pair, parent body, child body)."""
        return spanning(self.ends)

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
        return tuple(pair for pair in range(len(self.ends)) if pair not in tree)

    @cached_property
    def closing(self) -> NDArray[np.intp]:
        """(3, loops): the chords, and the first and the second body of each."""
        chords = np.array(self.chords, dtype=np.intp)
        return np.stack([chords, self.firsts[chords], self.seconds[chords]])

    @cached_property
    def signs(self) -> Floats:
        """(loops, variables): sense in which loops pass the pair of each variable."""
        rows = np.zeros((len(self.chords), len(self.ends)))
        for row, chord in enumerate(self.chords):
            a, b = self.ends[chord]
            rows[row] = self._pair_paths[a] - self._pair_paths[b]
            rows[row, chord] += 1.0
        return rows[:, list(self.owners)]

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
        matrix = np.zeros((len(self.ends), self.count))
        for pair, (a, b) in enumerate(self.ends):
            matrix[pair, a], matrix[pair, b] = -1.0, 1.0
        return matrix

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
        return np.asarray(self.paths @ (rates[..., None] * vectors))


def condition(matrices: Floats) -> Floats:
    """Return the conditions (n,) of matrices (n, m, k) in the 2-norm.

    Infinite where columns depend on each other, 1 where there is none, NaN of what is not
    finite.
    """
    columns = matrices.shape[2]
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    conditions = np.where(finite, np.inf if columns else 1.0, np.nan)
    sizes = np.linalg.svd(matrices[finite], compute_uv=False)
    if 0 < sizes.shape[1] == columns:
        with np.errstate(divide="ignore", invalid="ignore"):
            conditions[finite] = sizes[:, 0] / sizes[:, -1]
    return np.asarray(conditions)


def left_inverse(matrices: Floats) -> Floats:
    """Return inverses (n, k, m) of matrices (n, m, k) with m >= k; NaN where singular.

    With more rows than columns the extra equations must agree with the others.
    """
    if matrices.shape[1] == matrices.shape[2]:
        try:
            return np.asarray(np.linalg.inv(matrices))
        except np.linalg.LinAlgError:
            return np.concatenate([_one_inverse(matrix[None]) for matrix in matrices])
    inverse = np.full((len(matrices), matrices.shape[2], matrices.shape[1]), np.nan)
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    columns = matrices.shape[2]
    if matrices.shape[1] < columns or not np.any(finite):
        return inverse
    left, sizes, right = np.linalg.svd(matrices[finite], full_matrices=False)
    full = sizes[:, -1] > REDUNDANT * sizes[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverses = (np.swapaxes(right, 1, 2) / sizes[:, None]) @ np.swapaxes(left, 1, 2)
    inverse[finite] = np.where(full[:, None, None], inverses, np.nan)
    return inverse


def _one_inverse(matrix: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def rank_mobility(tree: LoopTree, vectors: Floats, dependent: float = DEPENDENT) -> Floats:
    """Return the nullity (n,) of the velocity equations: the mobility at each sample.

    Singular values below the part `dependent` of the largest count as zero.
    """
    values = np.linalg.svd(tree.jacobian(vectors), compute_uv=False)
    if values.shape[1] == 0:
        return np.full(len(vectors), vectors.shape[1])
    rank = np.sum(values > dependent * values[:, :1], axis=1)
    return np.asarray(vectors.shape[1] - rank)


@final
@dataclass(frozen=True)
class Redundancy:
    """Constraints that repeat others: how many, and the pairs (numbers) they lie among."""

    count: int
    pairs: tuple[int, ...]


def redundancy(tree: LoopTree, vectors: Floats) -> Redundancy:
    """Return the dependent loop equations of one configuration, vectors (variables, 3).

    The left null space of the velocity equations says which loops take part.
    """
    if not tree.chords:
        return Redundancy(0, ())
    jacobian = tree.jacobian(vectors[None])[0]
    left, values, _ = np.linalg.svd(jacobian)
    rank = int(np.sum(values > DEPENDENT * values[0]))
    weights = np.linalg.norm(left[:, rank:].reshape(len(tree.chords), 3, -1), axis=(1, 2))
    taking_part = np.any(tree.signs[weights > DEPENDENT] != 0.0, axis=0)
    pairs = {tree.owners[variable] for variable in np.flatnonzero(taking_part)}
    return Redundancy(len(jacobian) - rank, tuple(sorted(pairs)))
