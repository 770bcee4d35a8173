"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding one. A spanning tree of pairs places every body in the
axes of body 0; each remaining pair closes one loop, and the rotation vector by which it
fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.rotation import max_abs
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linearisation import REDUNDANT, Linearisation, Locks, LoopTree

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
    values = values.copy()
    active = np.arange(len(values))
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
    to those of the bodies that hold them; None where bodies are links. `locks` are
    variables, and the values (n or 1, locks) rad at which they are locked.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    leads: tuple[Floats, Floats] | None = None
    locks: Locks | None = None

    @staticmethod
    def of(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, each link a body."""
        return Closure(LoopTree.of(mechanism), joints)

    def take(self, rows: Indices) -> "Closure":
        """Return the closure of some samples only."""
        leads = self.leads
        locks = self.locks
        if leads is not None and len(leads[0]) > 1:
            leads = leads[0][rows], leads[1][rows]
        if locks is not None and len(locks[1]) > 1:
            locks = locks[0], locks[1][rows]
        return replace(self, leads=leads, locks=locks)

    def locked(self, variables: Sequence[int], values: Floats) -> "Closure":
        """Return the closure with some variables locked at values (n or 1, locks) rad."""
        return replace(self, locks=(list(variables), values))

    def at(self, values: Floats) -> Linearisation:
        """Return the closure at configurations (n, variables)."""
        return Linearisation(self.tree, self.joints, values, self.leads, None, self.locks)

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
        free = np.delete(np.arange(values.shape[1]), held)
        values = values.copy()

        def change(some: Floats, rows: Indices) -> Floats:
            whole = values[rows]
            whole[:, free] = some
            step = np.zeros_like(some)
            at = self.take(rows).at(whole)
            open_ = at.gap > ROUNDED
            step[open_] = least_change(at.jacobian[open_][:, :, free], -at.residual[open_])
            return step

        values[:, free], steps = newton(change, values[:, free], iterations, SETTLED, trust)
        return self.at(values), steps


def least_change(matrices: Floats, right: Floats) -> Floats:
    """Return the least x (n, k) with matrices (n, m, k) x = right (n, m)."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
    except np.linalg.LinAlgError:  # not square, or singular
        return np.einsum("nij,nj->ni", np.linalg.pinv(matrices, rcond=REDUNDANT), right)
