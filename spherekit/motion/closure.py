"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding one. A spanning tree of pairs places every body in the
axes of body 0; each remaining pair closes one loop, and the rotation vector by which it
fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.model.graph import joined, spanning
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import REDUNDANT, Linearisation, LoopTree
from spherekit.sphere.rotation import max_abs, transpose

ROUNDED = 1e-15
"""Loops that are open by less (rad) are closed to rounding."""
SETTLED = 1e-8
"""A Newton step (rad) below this leaves an error that its square bounds."""


def newton(
    change: Callable[[Floats, Indices], Floats],
    values: Floats,
    most: int,
    settled: float = 0.0,
    trust: float = np.inf,
) -> tuple[Floats, Floats]:
    """Return what so many steps at most make of values (n, variables), and their sizes.

    `change` returns the steps (k, variables) of some rows from values (k, variables). A row
    ends with a step of at most `settled` (rad), or one that is not a number; no variable
    changes by more than `trust` in one. The sizes (2, n) are that of the first step, and
    that of the second by the first, 0 where one was enough: small both, they say that the
    start was near a solution.
    """
    values, active = values.copy(), np.arange(len(values))
    sizes = np.zeros((2, len(values)))
    for taken in range(most):
        step = change(values[active], active)
        length = max_abs(step, axis=1)
        if taken < 2:
            sizes[taken, active] = length
        part = np.minimum(1.0, trust / np.maximum(length, 1e-300))
        values[active] += step * part[:, None]
        active = active[length > settled]
        if not len(active):
            break
    sizes[1] /= np.maximum(sizes[0], 1e-300)
    return values, sizes


@dataclass(frozen=True)
class Closure:
    """A loop tree with the joints of its pairs.

    `leads`: (n or 1, pairs, 3, 3) twice, from the axes of the pair's first and second links
    to those of the bodies that hold them; None where bodies are links.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    leads: tuple[Floats, Floats] | None = None

    @staticmethod
    def of(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, each link a body."""
        return Closure(LoopTree.of(mechanism), joints)

    def take(self, rows: Indices) -> "Closure":
        """Return the closure of some samples only."""
        if self.leads is None or len(self.leads[0]) == 1:
            return self
        first, second = self.leads
        return Closure(self.tree, self.joints, (first[rows], second[rows]))

    @staticmethod
    def stacked(parts: Sequence["Closure"]) -> "Closure":
        """Return the closure of a sample of each part; they differ in their leads alone."""
        leads = [part.leads for part in parts if part.leads is not None]
        if not leads:
            return parts[0]
        first, second = (np.concatenate(side) for side in zip(*leads, strict=True))
        return Closure(parts[0].tree, parts[0].joints, (first, second))

    def at(self, values: Floats) -> Linearisation:
        """Return the closure at configurations (n, variables)."""
        return Linearisation(self.tree, self.joints, values, self.leads)

    def solve(
        self,
        values: Floats,
        held: Sequence[int] = (),
        iterations: int = 12,
        trust: float = 0.5,
    ) -> Linearisation:
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
        Linearisation
            The closure where that ended, closed or not.
        """
        return self.solving(values, held, iterations, trust)[0]

    def solving(
        self, values: Floats, held: Sequence[int], iterations: int, trust: float = 0.5
    ) -> tuple[Linearisation, Floats]:
        """Return what `solve` does, and the sizes of its steps, see `newton`."""
        free = [v for v in range(values.shape[1]) if v not in held]
        values = values.copy()

        def change(some: Floats, rows: Indices) -> Floats:
            whole, step = values[rows], np.zeros_like(some)
            whole[:, free] = some
            at = self.take(rows).at(whole)
            open_ = at.gap > ROUNDED
            step[open_] = least_change(at.jacobian[open_][:, :, free], -at.residual[open_])
            return step

        values[:, free], steps = newton(change, values[:, free], iterations, SETTLED, trust)
        return self.at(values), steps


def least_change(matrices: Floats, right: Floats) -> Floats:
    """Return the least x (n, k) with matrices (n, m, k) x = right (n, m)."""
    if matrices.shape[1] == matrices.shape[2]:
        try:
            return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            pass
    return np.einsum("nij,nj->ni", np.linalg.pinv(matrices, rcond=REDUNDANT), right)


class Locked(NamedTuple):
    """A closure with some variables locked, and the way back to all variables.

    `closure` has the variables `kept` of the whole closure, in order; `values` (V,) holds
    the locked ones.
    """

    closure: Closure
    kept: tuple[int, ...]
    values: Floats

    def whole(self, values: Floats) -> Floats:
        """Return all variables (n, V) from those kept."""
        out = np.tile(self.values, (len(values), 1))
        out[:, list(self.kept)] = values
        return out

    def rates(self, rates: Floats) -> Floats:
        """Return the rates (n, V) of all variables from those of the variables kept."""
        out = np.zeros((len(rates), len(self.values)))
        out[:, list(self.kept)] = rates
        return out


def lock(closure: Closure, held: Mapping[int, float]) -> Locked:
    """Return a closure of links with R pairs or rolling contacts locked.

    `held` has the value (rad) of each locked pair's variable, by the variable's number.
    Where locked pairs close a loop of their own, the last of them is taken to fit.
    """
    tree, values = closure.tree, np.zeros(len(closure.tree.owners))
    values[list(held)] = list(held.values())
    locked = {tree.owners[variable] for variable in held}
    body = joined(tree.count, (tree.ends[pair] for pair in locked))
    bodies = sorted(set(body))
    states = closure.at(values[None]).states
    lift = np.tile(np.eye(3), (tree.count, 1, 1))
    for pair, parent, child in spanning(tree.ends, bodies, locked):
        turn = states.first[0, pair] @ transpose(states.second[0, pair])
        lift[child] = lift[parent] @ (
            turn if tree.ends[pair][0] == parent else transpose(turn)
        )
    pairs = [pair for pair in range(len(tree.ends)) if pair not in locked]
    kept = tuple(v for v, owner in enumerate(tree.owners) if owner not in locked)
    sides = np.array([tree.ends[pair] for pair in pairs], dtype=np.intp).reshape(-1, 2).T
    leads = lift[sides]
    ends = tuple((bodies.index(body[a]), bodies.index(body[b])) for a, b in sides.T)
    owners = tuple(pairs.index(tree.owners[variable]) for variable in kept)
    joints = tuple(closure.joints[pair] for pair in pairs)
    part = LoopTree(len(bodies), ends, owners)
    return Locked(Closure(part, joints, (leads[:1], leads[1:])), kept, values)
