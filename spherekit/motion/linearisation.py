"""Configurations of bodies joined by pairs, and their equations to second order.

A `Closure` says which bodies and pairs there are; a `Linearisation` is that closure at n
configurations. Every part of it is computed when it is first asked for, and kept.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.joints import Joint, PairRates, PairStates
from spherekit.motion.loops import LoopTree
from spherekit.motion.pairs import pair_axes, pair_rates, pair_states, variable_vectors
from spherekit.sphere.rotation import Floats, rotation_vector, transpose

_UNTURNED = np.eye(3)
KEPT = ("placed", "frames", "vectors", "jacobian", "residual")


@final
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
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    values: Floats
    leads: tuple[Floats, Floats] | None = None
    rotations: Floats | None = None

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def states(self) -> PairStates:
        """The pairs' frames in their bodies, curvatures, and what lies on profiles."""
        states = pair_states(self.joints, self.values)
        if self.leads is None:
            return states
        first, second = self.leads[0] @ states.first, self.leads[1] @ states.second
        return replace(states, first=first, second=second)

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
        """Pair axes (n, pairs, 3) in the axes of body 0, see `motion/pairs.py`."""
        return pair_axes(self.joints, self.frames)

    @cached_property
    def vectors(self) -> Floats:
        """The variables' vectors (n, variables, 3) in the axes of body 0."""
        return variable_vectors(self.joints, self.frames, self.states.curvatures)

    @cached_property
    def residual(self) -> Floats:
        """(n, 3 loops): rotation vectors (rad) by which the loops stay open."""
        chords, firsts, seconds = self.tree.closing
        if not len(chords):
            return np.zeros((len(self.values), 0))
        one = self.placed[:, firsts] @ self.states.first[:, chords]
        other = self.placed[:, seconds] @ self.states.second[:, chords]
        gaps = rotation_vector(one @ transpose(other))
        return gaps.reshape(len(gaps), 3 * len(chords))

    @property
    def gap(self) -> Floats:
        """(n,) the largest component of the residual (rad)."""
        return np.asarray(np.max(np.abs(self.residual), axis=1, initial=0.0))

    @cached_property
    def jacobian(self) -> Floats:
        """J (n, 3 loops, variables): rates with J rates = 0 keep the loops closed."""
        return self.tree.jacobian(self.vectors)

    def body_rates(self, rates: Floats) -> Floats:
        """Return angular velocities (n, bodies, 3) at rates (n, variables)."""
        return self.tree.body_rates(self.vectors, rates)

    def pair_rates(self, first_w: Floats, second_w: Floats) -> PairRates:
        """Return how vectors and axes change; see `spherekit.motion.pairs.pair_rates`."""
        return pair_rates(self.joints, self.frames, self.states, first_w, second_w)

    def turned(self, w: Floats) -> PairRates:
        """Return how vectors and axes change as bodies turn at w (n, bodies, 3)."""
        return self.pair_rates(w[:, self.tree.firsts], w[:, self.tree.seconds])

    def bias(self, rates: Floats) -> Floats:
        """Return J' rates (n, 3 loops), J' the change of J at rates (n, variables)."""
        turned = self.turned(self.body_rates(rates)).vectors
        return np.asarray(np.einsum("nij,nj->ni", self.tree.jacobian(turned), rates))

    def take(self, rows: NDArray[np.intp] | slice) -> "Linearisation":
        """Return some rows, with what is known of them."""
        leads = self.leads
        if leads is not None and len(leads[0]) > 1:
            leads = leads[0][rows], leads[1][rows]
        rotations = None if self.rotations is None else self.rotations[rows]
        part = Linearisation(self.tree, self.joints, self.values[rows], leads, rotations)
        kept = vars(self)
        for name in KEPT:
            if name in kept:
                vars(part)[name] = kept[name][rows]
        if "states" in kept:
            states = (getattr(self.states, item.name)[rows] for item in fields(PairStates))
            vars(part)["states"] = PairStates(*states)
        return part
