"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding one. A spanning tree of pairs places every body in the
axes of body 0; each remaining pair closes one loop, and the rotation vector by which it
fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.joints import Joint, PairStates
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import REDUNDANT, LoopTree
from spherekit.motion.pairs import pair_states, variable_vectors
from spherekit.sphere.rotation import Floats, rotation_vector, transpose


@final
@dataclass(frozen=True)
class Closure:
    """A loop tree with the joints of its pairs.

    `lead_first`, `lead_second`: (n or 1, pairs, 3, 3), from the axes of the pair's links
    to those of the bodies that hold them; None where bodies are links.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    lead_first: Floats | None = None
    lead_second: Floats | None = None

    @staticmethod
    def of(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, each link a body."""
        return Closure(LoopTree.of(mechanism), joints)

    def take(self, rows: NDArray[np.intp]) -> "Closure":
        """Return the closure of some samples only."""
        if self.lead_first is None or self.lead_second is None:
            return self
        if len(self.lead_first) == 1:
            return self
        return Closure(
            self.tree, self.joints, self.lead_first[rows], self.lead_second[rows]
        )

    def place(self, values: Floats) -> tuple[Floats, PairStates]:
        """Return body orientations (n, bodies, 3, 3) in body 0, and the pairs' states."""
        states = pair_states(self.joints, values)
        if self.lead_first is not None and self.lead_second is not None:
            first, second = self.lead_first @ states.first, self.lead_second @ states.second
            states = replace(states, first=first, second=second)
        first, second = states.first, states.second
        placed = np.empty((len(values), self.tree.count, 3, 3))
        placed[:, 0] = np.eye(3)
        across = first @ transpose(second)
        for pair, parent, child in self.tree.branches:
            ahead = self.tree.ends[pair][0] == parent
            turn = across[:, pair] if ahead else transpose(across[:, pair])
            placed[:, child] = placed[:, parent] @ turn
        return placed, states

    def frames(self, placed: Floats, states: PairStates) -> Floats:
        """Return the pair frames (n, pairs, 3, 3) in the axes of body 0."""
        return placed[:, [a for a, _ in self.tree.ends]] @ states.first

    def residual(self, placed: Floats, states: PairStates) -> Floats:
        """Return (n, 3 loops): rotation vectors (rad) by which the loops stay open."""
        chords = list(self.tree.chords)
        if not chords:
            return np.zeros((len(placed), 0))
        one, other = (
            placed[:, [self.tree.ends[chord][k] for chord in chords]] @ frames[:, chords]
            for k, frames in enumerate((states.first, states.second))
        )
        gaps = rotation_vector(one @ transpose(other))
        return gaps.reshape(len(placed), 3 * len(chords))

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
        held: Sequence[int] = (),
        iterations: int = 12,
        trust: float = 0.5,
    ) -> "NewtonResult":
        """Close the loops by Newton's method, each sample on its own.

        Parameters
        ----------
        values
            (n, variables) starting values.
        held
            Numbers of the variables that are not changed, those of inputs.
        iterations, trust
            Most steps taken, and the largest change (rad) of a variable in one step.

        Returns
        -------
        NewtonResult
            Per sample: values, residual, the size of the first step and the ratio of
            the second to the first (0 where one step was enough).
        """
        free = [v for v in range(values.shape[1]) if v not in held]
        values = values.copy()
        n = len(values)
        residual = np.full(n, np.inf)
        first_step, ratio = np.zeros(n), np.zeros(n)
        active = np.arange(n)
        best = values.copy()
        for step in range(iterations + 1):
            part = self.take(active)
            gap, jacobian = part.linearise(values[active])
            size = np.max(np.abs(gap), axis=1, initial=0.0)
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
