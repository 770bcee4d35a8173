"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding one. A spanning tree of pairs places every body in the
axes of body 0; each remaining pair closes one loop, and the rotation vector by which it
fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.geometry import Joint, Revolute
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import (
    Floats,
    about_z,
    cross,
    rotation_vector,
    transpose,
)


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
    def branches(self) -> tuple[tuple[int, int, int], ...]:
        """Tree pairs in order of placement: (pair, parent body, child body)."""
        placed, order = {0}, []
        queue = [0]
        while queue:
            parent = queue.pop(0)
            for pair, (a, b) in enumerate(self.ends):
                if parent in (a, b):
                    child = b if parent == a else a
                    if child not in placed:
                        placed.add(child)
                        queue.append(child)
                        order.append((pair, parent, child))
        return tuple(order)

    @cached_property
    def _pair_paths(self) -> Floats:
        paths = np.zeros((self.count, len(self.ends)))
        for pair, parent, child in self.branches:
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
        tree = {pair for pair, _, _ in self.branches}
        return tuple(pair for pair in range(len(self.ends)) if pair not in tree)

    @cached_property
    def signs(self) -> Floats:
        """(loops, variables): sense in which loops pass the pair of each variable."""
        rows = np.zeros((len(self.chords), len(self.ends)))
        for row, chord in enumerate(self.chords):
            a, b = self.ends[chord]
            rows[row] = self._pair_paths[a] - self._pair_paths[b]
            rows[row, chord] += 1.0
        return rows[:, list(self.owners)]

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
        return np.asarray(np.einsum("bv,nv,nvk->nbk", self.paths, rates, vectors))


@final
@dataclass(frozen=True)
class PairStates:
    """The pairs of n samples as their variables have them.

    `first`, `second`: (n, pairs, 3, 3) frames in the axes of the pair's two bodies, which
    coincide in space. `curvatures`, `curvature_rates`: (n, pairs, 2) of the two profiles
    and their derivatives by arc length, zero for R pairs. `inside`: (n, pairs) whether
    the contact lies on both profiles.
    """

    first: Floats
    second: Floats
    curvatures: Floats
    curvature_rates: Floats
    inside: NDArray[np.bool_]


def pair_states(joints: Sequence[Joint], values: Floats) -> PairStates:
    """Return the states of pairs for variables (n, variables)."""
    n, pairs = len(values), len(joints)
    first, second = np.empty((n, pairs, 3, 3)), np.empty((n, pairs, 3, 3))
    curvatures, rates = np.zeros((n, pairs, 2)), np.zeros((n, pairs, 2))
    inside = np.ones((n, pairs), dtype=bool)
    at = 0
    for k, joint in enumerate(joints):
        if isinstance(joint, Revolute):
            first[:, k] = joint.first @ about_z(values[:, at])
            second[:, k] = joint.second
            at += 1
            continue
        last = at if joint.rolling else at + 1
        offset = joint.start if joint.rolling else (0.0, 0.0)
        one = joint.first.at(np.nan_to_num(values[:, at]) + offset[0])
        other = joint.second.at(np.nan_to_num(values[:, last]) + offset[1])
        first[:, k], second[:, k] = one.frame, other.frame
        curvatures[:, k, 0], curvatures[:, k, 1] = one.curvature, other.curvature
        rates[:, k, 0], rates[:, k, 1] = one.curvature_rate, other.curvature_rate
        inside[:, k] = one.inside & other.inside
        at = last + 1
    return PairStates(first, second, curvatures, rates, inside)


def variable_vectors(joints: Sequence[Joint], frames: Floats, curvatures: Floats) -> Floats:
    """Return the vectors (n, variables, 3) of all variables.

    `frames` (n, pairs, 3, 3) are the pair frames in the axes wanted, `curvatures` as in
    `PairStates`. With t, n, p the tangent, normal and point of a contact and k1, k2 the
    curvatures: the axis (R); (k1 - k2) p (Cr); n + k1 p and -(n + k2 p) (Cs).
    """
    vectors = []
    for k, joint in enumerate(joints):
        normal, point = frames[:, k, :, 1], frames[:, k, :, 2]
        k1, k2 = curvatures[:, k, :1], curvatures[:, k, 1:]
        if isinstance(joint, Revolute):
            vectors.append(point)
        elif joint.rolling:
            vectors.append((k1 - k2) * point)
        else:
            vectors += [normal + k1 * point, -(normal + k2 * point)]
    return np.stack(vectors, axis=1)


@final
@dataclass(frozen=True)
class PairRates:
    """First derivatives at the pairs: of the variables' vectors and of the pair axes.

    `vectors` (n, variables, 3); `axes` (n, pairs, 3), see `pair_axes`.
    """

    vectors: Floats
    axes: Floats


def pair_axes(joints: Sequence[Joint], frames: Floats) -> Floats:
    """Return (n, pairs, 3): axis (R), contact line (Cr), normal of contact plane (Cs)."""
    column = [2 if isinstance(joint, Revolute) or joint.rolling else 0 for joint in joints]
    return np.stack([frames[:, k, :, c] for k, c in enumerate(column)], axis=1)


def pair_rates(
    joints: Sequence[Joint],
    frames: Floats,
    states: PairStates,
    first_w: Floats,
    second_w: Floats,
) -> PairRates:
    """Return how vectors and axes change, given the rates of the pairs' two links.

    `first_w`, `second_w` (n, pairs, 3) are angular velocities of the links in the axes
    that `frames` (n, pairs, 3, 3) are given in. The contact moves along the profiles at
    s1' = (w . p - k2 w . n) / (k1 - k2) and s2' = (w . p - k1 w . n) / (k1 - k2), w the
    relative angular velocity (derived from the frames' own derivatives).
    """
    vectors, axes = [], []
    for k, joint in enumerate(joints):
        w1, w2 = first_w[:, k], second_w[:, k]
        tangent, normal, point = (frames[:, k, :, c] for c in range(3))
        if isinstance(joint, Revolute):
            turned = cross(w1, point)
            vectors.append(turned)
            axes.append(turned)
            continue
        k1, k2 = states.curvatures[:, k, :1], states.curvatures[:, k, 1:]
        dk1, dk2 = states.curvature_rates[:, k, :1], states.curvature_rates[:, k, 1:]
        relative = w2 - w1
        along_p = np.sum(relative * point, axis=1, keepdims=True)
        along_n = np.sum(relative * normal, axis=1, keepdims=True)
        if joint.rolling:
            along_n = np.zeros_like(along_n)
        s1 = (along_p - k2 * along_n) / (k1 - k2)
        s2 = (along_p - k1 * along_n) / (k1 - k2)
        moved = cross(w1, point) + s1 * tangent
        if joint.rolling:
            vectors.append((dk1 - dk2) * s1 * point + (k1 - k2) * moved)
            axes.append(moved)
        else:
            vectors.append(cross(w1, normal + k1 * point) + s1 * dk1 * point)
            vectors.append(-cross(w2, normal + k2 * point) - s2 * dk2 * point)
            axes.append(cross(w1, tangent) + s1 * (k1 * normal - point))
    return PairRates(np.stack(vectors, axis=1), np.stack(axes, axis=1))


@final
@dataclass(frozen=True)
class Closure:
    """A loop tree with the joints of its pairs.

    `lead_first`, `lead_second`: (n or 1, pairs, 3, 3), from the axes of the pair's links
    to those of the bodies that hold them; identities where bodies are links.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    lead_first: Floats
    lead_second: Floats

    @staticmethod
    def of(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, each link a body."""
        same = np.broadcast_to(np.eye(3), (1, len(joints), 3, 3))
        return Closure(LoopTree.of(mechanism), joints, same, same)

    def take(self, rows: NDArray[np.intp]) -> "Closure":
        """Return the closure of some samples only."""
        if len(self.lead_first) == 1:
            return self
        return Closure(
            self.tree, self.joints, self.lead_first[rows], self.lead_second[rows]
        )

    def place(self, values: Floats) -> tuple[Floats, PairStates]:
        """Return body orientations (n, bodies, 3, 3) in body 0, and the pairs' states."""
        states = pair_states(self.joints, values)
        first, second = self.lead_first @ states.first, self.lead_second @ states.second
        states = replace(states, first=first, second=second)
        placed = np.empty((len(values), self.tree.count, 3, 3))
        placed[:, 0] = np.eye(3)
        for pair, parent, child in self.tree.branches:
            ahead = self.tree.ends[pair][0] == parent
            one, other = (first, second) if ahead else (second, first)
            placed[:, child] = placed[:, parent] @ one[:, pair] @ transpose(other[:, pair])
        return placed, states

    def frames(self, placed: Floats, states: PairStates) -> Floats:
        """Return the pair frames (n, pairs, 3, 3) in the axes of body 0."""
        return placed[:, [a for a, _ in self.tree.ends]] @ states.first

    def residual(self, placed: Floats, states: PairStates) -> Floats:
        """Return (n, 3 loops): rotation vectors (rad) by which the loops stay open."""
        gaps = []
        for chord in self.tree.chords:
            a, b = self.tree.ends[chord]
            around = (
                placed[:, a]
                @ states.first[:, chord]
                @ transpose(placed[:, b] @ states.second[:, chord])
            )
            gaps.append(rotation_vector(around))
        return np.concatenate(gaps, axis=1) if gaps else np.zeros((len(placed), 0))

    def vectors(self, placed: Floats, states: PairStates) -> Floats:
        """Return the variables' vectors (n, variables, 3) in the axes of body 0."""
        frames = self.frames(placed, states)
        return variable_vectors(self.joints, frames, states.curvatures)

    def linearise(self, values: Floats) -> tuple[Floats, Floats]:
        """Return residual (n, 3 loops) and Jacobian (n, 3 loops, variables)."""
        placed, states = self.place(values)
        jacobian = self.tree.jacobian(self.vectors(placed, states))
        return self.residual(placed, states), jacobian

    def solve(
        self,
        values: Floats,
        held: int | None,
        iterations: int = 12,
        trust: float = 0.5,
    ) -> "NewtonResult":
        """Close the loops by Newton's method, each sample on its own.

        Parameters
        ----------
        values
            (n, variables) starting values; the variable `held` is not changed.
        held
            Number of the input's variable, or None if all variables are free.
        iterations, trust
            Most steps taken, and the largest change (rad) of a variable in one step.

        Returns
        -------
        NewtonResult
            Per sample: values, residual, the size of the first step and the ratio of
            the second to the first (0 where one step was enough).
        """
        free = [v for v in range(values.shape[1]) if v != held]
        values = values.copy()
        n = len(values)
        residual = np.full(n, np.inf)
        first_step, ratio = np.zeros(n), np.zeros(n)
        active = np.arange(n)
        best = values.copy()
        for step in range(iterations + 1):
            part = self.take(active)
            gap, jacobian = part.linearise(values[active])
            size = np.max(np.abs(gap), axis=1)
            better = size < residual[active]
            improved = active[better]
            best[improved], residual[improved] = values[improved], size[better]
            going = np.isfinite(size) & (size > 1e-15) & (better | (size > 1e-9))
            if step == iterations or not np.any(going):
                break
            active, gap, jacobian = active[going], gap[going], jacobian[going]
            change = _solve_rows(jacobian[:, :, free], -gap)
            length = np.max(np.abs(change), axis=1)
            if step == 0:
                first_step[active] = length
            elif step == 1:
                ratio[active] = length / np.maximum(first_step[active], 1e-300)
            change *= np.minimum(1.0, trust / np.maximum(length, 1e-300))[:, None]
            values[active[:, None], free] += change
        return NewtonResult(best, residual, first_step, ratio)


@final
@dataclass(frozen=True)
class NewtonResult:
    """What Newton's method reached for each sample."""

    values: Floats
    residual: Floats
    first_step: Floats
    ratio: Floats


def _solve_rows(matrices: Floats, right: Floats) -> Floats:
    if matrices.shape[1] == matrices.shape[2]:
        try:
            return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            pass
    inverse = np.linalg.pinv(matrices, rcond=REDUNDANT)
    return np.asarray(np.einsum("nij,nj->ni", inverse, right))


REDUNDANT = 1e-10
"""Equations whose relative singular value is below this repeat the others."""


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
    values = np.linalg.svd(matrices[finite], compute_uv=False)
    columns = matrices.shape[2]
    full = np.zeros(len(matrices), dtype=bool)
    if values.shape[1] >= columns:
        full[finite] = values[:, columns - 1] > REDUNDANT * values[:, 0]
    inverse[full] = np.linalg.pinv(matrices[full], rcond=REDUNDANT)
    return inverse


def _one_inverse(matrix: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def rank_mobility(tree: LoopTree, vectors: Floats, tolerance: float = 1e-9) -> Floats:
    """Return the nullity (n,) of the velocity equations: the mobility at each sample."""
    values = np.linalg.svd(tree.jacobian(vectors), compute_uv=False)
    if values.shape[1] == 0:
        return np.full(len(vectors), vectors.shape[1])
    rank = np.sum(values > tolerance * values[:, :1], axis=1)
    return np.asarray(vectors.shape[1] - rank)


@final
@dataclass(frozen=True)
class Redundancy:
    """Constraints that repeat others: how many, and the pairs (numbers) they lie among."""

    count: int
    pairs: tuple[int, ...]


def redundancy(tree: LoopTree, vectors: Floats, tolerance: float = 1e-9) -> Redundancy:
    """Return the dependent loop equations of one configuration, vectors (variables, 3).

    The left null space of the velocity equations says which loops take part.
    """
    jacobian = tree.jacobian(vectors[None])[0]
    left, values, _ = np.linalg.svd(jacobian)
    rank = int(np.sum(values > tolerance * values[0])) if len(values) else 0
    weights = np.linalg.norm(left[:, rank:].reshape(len(tree.chords), 3, -1), axis=(1, 2))
    taking_part = np.any(tree.signs[weights > tolerance] != 0.0, axis=0)
    pairs = {tree.owners[variable] for variable in np.flatnonzero(taking_part)}
    return Redundancy(len(jacobian) - rank, tuple(sorted(pairs)))
