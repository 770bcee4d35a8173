"""The loop closure linearised at given configurations, with its second derivatives.

A `Closure` (`spherekit.positions.loop_closure`) describes which bodies and pairs there are.
A `Linearisation` is this closure at n configurations. Each of its quantities is computed
when it is first read, and then stored.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.rotation import rotation_vector, transpose
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.joint import Joint, Kind, PairStates
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.pair_states import (
    IndexRange,
    evaluate_pair_states,
    group_joints_by_kind,
)

_IDENTITY = np.eye(3)
"""Orientation of body 0 in its own axes."""

Locks = tuple[list[int], Floats]
"""Indices of the locked variables, and their values (n or 1, locks) in rad."""


@dataclass(frozen=True)
class Linearisation:
    """The loop equations of a chain of bodies, linearised at n configurations.

    The equations say that the loops of bodies and pairs close. All quantities, such as the
    Jacobian, are computed when they are first needed.

    The velocity vector of a variable is the angular velocity of the second body of its pair
    relative to the first one at unit rate of the variable.

    Attributes
    ----------
    tree, joints
        The loops, and the joints of the pairs.
    values
        (n, variables) values of the pair variables (rad).
    body_from_links
        Two arrays (n or 1, pairs, 3, 3) of rotations from the axes of the first and of the
        second link of each pair to the axes of its body, if bodies are groups of links.
        None if each body is one link.
    known_rotations
        (n, bodies, 3, 3) the `rotations`, if they are known already.
    locks
        Indices of locked variables, and their values. Each locked variable adds one
        equation.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    values: Floats
    body_from_links: tuple[Floats, Floats] | None = None
    known_rotations: Floats | None = None
    locks: Locks | None = None

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def states(self) -> PairStates:
        """Frames of the pairs in their bodies, and the geometry of contacts.

        For contacts, the states have the curvatures of both profiles, and tell whether the
        contact point is on both profiles.
        """
        states = evaluate_pair_states(self.joints, self.values)
        if self.body_from_links is None:
            return states
        body_from_first, body_from_second = self.body_from_links
        return states._replace(
            first=body_from_first @ states.first, second=body_from_second @ states.second
        )

    @cached_property
    def rotations(self) -> Floats:
        """(n, bodies, 3, 3) rotations from the axes of each body to those of body 0.

        There is one matrix for each of n configurations. The bodies are placed one after
        the other, from body 0 along pairs (joints).
        """
        if self.known_rotations is not None:
            return self.known_rotations
        # `placements` lists pairs, each with a body that is placed already (parent) and the
        # body that the pair places (child).
        rotations = np.empty((len(self.values), self.tree.count, 3, 3))
        rotations[:, 0] = _IDENTITY
        # `states` has two frames of each pair: `first` in the axes of its first body,
        # `second` in the axes of its second body. Both describe the same frame in space, so
        # together they give the rotation from the second body to the first.
        first_from_second = self.states.first @ transpose(self.states.second)
        for pair, parent, child in self.tree.placements:
            # A pair can also lead from its second body to its first one; then the rotation
            # is inverted.
            is_forward = self.tree.ends[pair][0] == parent
            parent_from_child = (
                first_from_second[:, pair]
                if is_forward
                else transpose(first_from_second[:, pair])
            )
            if parent:
                np.matmul(rotations[:, parent], parent_from_child, out=rotations[:, child])
            else:
                rotations[:, child] = parent_from_child  # The parent is body 0 itself.
        return rotations

    @cached_property
    def frames(self) -> Floats:
        """(n, pairs, 3, 3) pair frames in the axes of body 0; columns as in `Joint`."""
        return self.rotations[:, self.tree.first_bodies] @ self.states.first

    @cached_property
    def axes(self) -> Floats:
        """(n, pairs, 3) unit vector of each pair, in the axes of body 0.

        For an R pair the vector is along the axis. For a rolling contact it is along the
        line from the centre of the sphere to the contact. For a sliding contact it is along
        the common tangent of the profiles.
        """
        axes = np.empty(self.frames.shape[:-1])
        for kind, _, pairs, _ in group_joints_by_kind(self.joints):
            axes[:, pairs] = self.frames[..., kind.axis_column][:, pairs]
        return axes

    @cached_property
    def vectors(self) -> Floats:
        """(n, variables, 3) velocity vectors of the variables, in the axes of body 0."""
        frames = self.frames
        curvatures = self.states.curvatures
        return self._collect_vectors(
            lambda kind, pairs: kind.velocity_vectors(
                frames[:, pairs], curvatures[:, pairs]
            )
        )

    def _collect_vectors(
        self, vectors_of_kind: Callable[[Kind, IndexRange], Floats]
    ) -> Floats:
        """Return vectors (n, variables, 3) that are computed for each kind of pair.

        The result is in the order of the variables. `vectors_of_kind` takes a kind and the
        indices of the pairs of this kind. It returns their vectors (n, pairs, variables of
        a pair, 3).
        """
        vectors = np.empty((*self.values.shape, 3))
        for kind, _, pairs, variables in group_joints_by_kind(self.joints):
            vectors[:, variables] = vectors_of_kind(kind, pairs).reshape(
                vectors[:, variables].shape
            )
        return vectors

    @cached_property
    def residual(self) -> Floats:
        """(n, equations) errors of loop closure (rad) at n configurations.

        All are zero if the loops are closed. Newton's method solves residual = 0. The
        bodies are placed along a tree of pairs (joints). Each pair outside the tree, a
        chord, closes one loop. The position of each of its two bodies gives a frame of the
        chord. In a closed loop both frames are equal. The error is the rotation vector that
        turns the frame of the second body into that of the first: three components for each
        loop.

        Some variables can be locked at given values. Their differences from these values
        are appended.
        """
        # The number, the first body and the second body of each chord. `states` contains
        # the frame of each pair in the axes of its first and of its second body, at the
        # values of its variables.
        chords, firsts, seconds = self.tree.closing
        first_frames = self.rotations[:, firsts] @ self.states.first[:, chords]
        second_frames = self.rotations[:, seconds] @ self.states.second[:, chords]
        loop_rotations = rotation_vector(first_frames @ transpose(second_frames))
        loop_residual = loop_rotations.reshape(len(loop_rotations), 3 * len(chords))
        if self.locks is None:
            return loop_residual
        variables, locked_values = self.locks
        lock_residual = self.values[:, variables] - locked_values
        return np.append(loop_residual, lock_residual, axis=1)

    @property
    def closure_residual(self) -> Floats:
        """(n,) largest absolute component of the closure residual (rad)."""
        return max_abs(self.residual, axis=1)

    @cached_property
    def jacobian(self) -> Floats:
        """(n, equations, variables) matrices J of the velocity equations.

        If the rates of the variables satisfy J rates = 0, the loops stay closed and locked
        variables stay at rest. At closed configurations J is the derivative of the
        `residual` (by how much the loops are open).
        """
        jacobian = self.tree.jacobian(self.vectors)
        if self.locks is None:
            return jacobian
        lock_rows = np.eye(jacobian.shape[2])[self.locks[0]]
        lock_rows = np.broadcast_to(lock_rows, (len(jacobian), *lock_rows.shape))
        return np.concatenate([jacobian, lock_rows], axis=1)

    def body_rates(self, rates: Floats) -> Floats:
        """Return the angular velocities (n, bodies, 3) at rates (n, variables)."""
        return self.tree.body_rates(self.vectors, rates)

    def vector_rates_of_pairs(self, first_w: Floats, second_w: Floats) -> Floats:
        """Return the time derivatives (n, variables, 3) of the velocity vectors.

        A pair (joint) joins two bodies. Each of its variables has a velocity vector: the
        angular velocity of the second body relative to the first at unit rate of the
        variable. For a revolute pair it is the unit vector of the axis. The Jacobian of the
        loops consists of these vectors, so callers compute its rate from the derivatives.
        The formula for the derivative depends on the kind of pair. All vectors and rates
        are relative to body 0, in the axes of body 0.

        Parameters
        ----------
        first_w, second_w
            (n, pairs, 3) angular velocities of the first and of the second body of each
            pair, relative to body 0.
        """
        # (n, pairs, 3, 3) frames of the pairs, in the axes of body 0.
        frames = self.frames
        # At a contact of two profiles (such as wheels), the derivative also depends on the
        # curvatures of the profiles. The states of the pairs contain these curvatures.
        states = self.states
        # The lambda is called for each kind of pair, with the indices of the pairs of this
        # kind.
        return self._collect_vectors(
            lambda kind, pairs: kind.vector_rates(
                frames[:, pairs],
                states.select_pairs(pairs),
                first_w[:, pairs],
                second_w[:, pairs],
            )
        )

    def vector_rates(self, w: Floats) -> Floats:
        """Return the time derivatives (n, variables, 3) of the velocity vectors.

        The velocity vector of a variable is the relative angular velocity of the bodies of
        its pair at unit rate.

        `w` (n, bodies, 3) are the angular velocities of the bodies, in the axes of body 0.
        """
        return self.vector_rates_of_pairs(
            w[:, self.tree.first_bodies], w[:, self.tree.second_bodies]
        )

    def bias(self, rates: Floats) -> Floats:
        """Return the bias acceleration (n, equations): (dJ/dt) rates.

        The velocity equations J rates = 0 keep the loops closed. Their time derivative is
        J accelerations + bias = 0. The bias is quadratic in the rates (n, variables).
        """
        vector_rates = self.vector_rates(self.body_rates(rates))
        bias = np.einsum("nij,nj->ni", self.tree.jacobian(vector_rates), rates)
        if self.locks is None:
            return bias
        # The equations of locked variables are linear.
        return np.pad(bias, ((0, 0), (0, len(self.locks[0]))))
