"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs. A spanning tree of pairs places every body
in the axes of body 0; each remaining pair closes one loop, and the rotation vector by
which it fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats, about_z, rotation_vector, transpose


@final
@dataclass(frozen=True)
class LoopTree:
    """A spanning tree of bodies and the loops that the other pairs close.

    `ends[e]` are the first and second body of pair e. `signs[c, e]` says how pair e is
    passed in loop c: +1 along, -1 against, 0 not at all.
    """

    count: int
    ends: tuple[tuple[int, int], ...]

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
    def paths(self) -> Floats:
        """(bodies, pairs): signed tree pairs on the way from body 0 to each body."""
        paths = np.zeros((self.count, len(self.ends)))
        for pair, parent, child in self.branches:
            paths[child] = paths[parent]
            paths[child, pair] = 1.0 if self.ends[pair][0] == parent else -1.0
        return paths

    @cached_property
    def chords(self) -> tuple[int, ...]:
        """The pairs that close a loop each."""
        tree = {pair for pair, _, _ in self.branches}
        return tuple(pair for pair in range(len(self.ends)) if pair not in tree)

    @cached_property
    def signs(self) -> Floats:
        """(loops, pairs) matrix of the senses in which loops pass pairs."""
        rows = np.zeros((len(self.chords), len(self.ends)))
        for row, chord in enumerate(self.chords):
            a, b = self.ends[chord]
            rows[row] = self.paths[a] - self.paths[b]
            rows[row, chord] += 1.0
        return rows

    def jacobian(self, axes: Floats) -> Floats:
        """Return (n, 3 loops, pairs) from pair axes (n, pairs, 3): J rates = 0."""
        n, pairs, _ = axes.shape
        grid = self.signs[None, :, None, :] * np.swapaxes(axes, 1, 2)[:, None]
        return np.ascontiguousarray(grid.reshape(n, 3 * len(self.chords), pairs))

    def body_rates(self, axes: Floats, rates: Floats) -> Floats:
        """Return angular velocities (n, bodies, 3) relative to body 0, in its axes."""
        return np.asarray(np.einsum("be,ne,nek->nbk", self.paths, rates, axes))


@final
@dataclass(frozen=True)
class Closure:
    """A loop tree with the pair frames in its bodies' axes.

    `first`, `second`: (n or 1, pairs, 3, 3), see `spherekit.model.geometry`.
    """

    tree: LoopTree
    first: Floats
    second: Floats

    def take(self, rows: NDArray[np.intp]) -> "Closure":
        """Return the closure of some samples only."""
        if len(self.first) == 1:
            return self
        return Closure(self.tree, self.first[rows], self.second[rows])

    def orientations(self, values: Floats) -> Floats:
        """Return (n, bodies, 3, 3), body axes to the axes of body 0."""
        n = len(values)
        placed = np.empty((n, self.tree.count, 3, 3))
        placed[:, 0] = np.eye(3)
        for pair, parent, child in self.tree.branches:
            ahead = self.tree.ends[pair][0] == parent
            one, other = (self.first, self.second) if ahead else (self.second, self.first)
            turn = about_z(values[:, pair] if ahead else -values[:, pair])
            placed[:, child] = (
                placed[:, parent] @ one[:, pair] @ turn @ transpose(other[:, pair])
            )
        return placed

    def axes(self, placed: Floats) -> Floats:
        """Return the pair axes (n, pairs, 3) in the axes of body 0."""
        bodies = [a for a, _ in self.tree.ends]
        own = np.broadcast_to(self.first[..., 2], (len(placed), len(bodies), 3))
        return np.asarray(np.einsum("npij,npj->npi", placed[:, bodies], own))

    def residual(self, values: Floats, placed: Floats) -> Floats:
        """Return (n, 3 loops): rotation vectors (rad) by which the loops stay open."""
        gaps = []
        for chord in self.tree.chords:
            a, b = self.tree.ends[chord]
            around = (
                placed[:, a]
                @ self.first[:, chord]
                @ about_z(values[:, chord])
                @ transpose(placed[:, b] @ self.second[:, chord])
            )
            gaps.append(rotation_vector(around))
        return np.concatenate(gaps, axis=1) if gaps else np.zeros((len(values), 0))

    def linearise(self, values: Floats) -> tuple[Floats, Floats]:
        """Return residual (n, 3 loops) and Jacobian (n, 3 loops, pairs)."""
        placed = self.orientations(values)
        return self.residual(values, placed), self.tree.jacobian(self.axes(placed))

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
            (n, pairs) starting values; the variable `held` is not changed.
        held
            Number of the input pair, or None if all variables are free.
        iterations, trust
            Most steps taken, and the largest change (rad) of a variable in one step.

        Returns
        -------
        NewtonResult
            Per sample: values, residual, the size of the first step and the ratio of
            the second to the first (0 where one step was enough).
        """
        free = [e for e in range(len(self.tree.ends)) if e != held]
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
    inverse = np.linalg.pinv(matrices, rcond=1e-12)
    return np.asarray(np.einsum("nij,nj->ni", inverse, right))
