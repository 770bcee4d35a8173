"""The configuration whose output link is nearest to an orientation, and how it moves.

Nearest means by the angle a of the rotation d that is left between the orientation wanted
and the one reached. At the nearest one the gradient of a^2 / 2 along the configurations
vanishes: G^T d + J^T m = 0, with J v' = 0 the velocity equations, w = G v' the angular
velocity of the output link and m multipliers of the loops. With as many freedoms as the
orientation has, or where the mechanism can follow, d and m are 0. Differentiated once and
twice by the angle turned through, the condition gives exact rates.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.closure import Closure
from spherekit.motion.linearisation import Linearisation
from spherekit.sphere.poses import LogRate
from spherekit.sphere.rotation import Floats, cross, rotation_vector, transpose

DEPARTED = 1e-10
"""A mechanism that is further from the orientation wanted (rad) has departed from it."""


@final
@dataclass(frozen=True)
class Target:
    """An output link, number `link`, of a mechanism with `freedoms`, and its closure."""

    closure: Closure
    link: int
    freedoms: int

    @property
    def reach(self) -> Floats:
        """(variables,) sense in which the way to the output link uses each variable."""
        return np.asarray(self.closure.tree.paths[self.link])

    def at(self, values: Floats, wanted: Floats) -> "Optimality":
        """Return n configurations (n, variables) beside orientations (n, 3, 3)."""
        at = self.closure.at(values)
        left = rotation_vector(wanted @ transpose(at.placed[:, self.link]))
        turning = self.reach[None, None, :] * np.swapaxes(at.vectors, 1, 2)
        return Optimality(self, at, turning, left)


@final
@dataclass(frozen=True)
class Optimality:
    """n configurations, and how far they are from being the nearest ones.

    `turning` G (n, 3, variables); `left` d (n, 3) rad.
    """

    target: Target
    at: Linearisation
    turning: Floats
    left: Floats

    @property
    def values(self) -> Floats:
        """The variables (n, variables)."""
        return self.at.values

    @property
    def reached(self) -> Floats:
        """Orientations (n, 3, 3) of the output link."""
        return np.asarray(self.at.placed[:, self.target.link])

    @cached_property
    def _split(self) -> tuple[Floats, Floats, Floats]:
        """The pseudo-inverse of J with its known rank, its null space, its flatness."""
        n, rows, count = self.at.jacobian.shape
        if rows == 0:
            return np.zeros((n, count, 0)), np.tile(np.eye(count), (n, 1, 1)), np.ones(n)
        rank = count - self.target.freedoms
        left, sizes, right = np.linalg.svd(self.at.jacobian)
        kept = sizes[:, :rank]
        with np.errstate(divide="ignore"):
            inverse = np.swapaxes(right[:, :rank], 1, 2) / kept[:, None, :]
        inverse = np.einsum("nvr,nmr->nvm", inverse, left[:, :, :rank])
        return inverse, np.swapaxes(right[:, rank:], 1, 2), kept[:, -1] / kept[:, 0]

    @property
    def free(self) -> Floats:
        """Orthonormal motions (n, variables, freedoms) that keep the loops closed."""
        return self._split[1]

    @property
    def loop_conditioning(self) -> Floats:
        """(n,) relative size of the weakest loop equation; 0 where a motion comes free."""
        return self._split[2]

    @cached_property
    def swing(self) -> Floats:
        """Angular velocities (n, 3, freedoms) of the output link by the free motions."""
        return self.turning @ self.free

    @cached_property
    def output_singular_value(self) -> Floats:
        """(n,) least size of an angular velocity by a free motion of unit length."""
        sizes = np.linalg.svd(self.swing, compute_uv=False)
        return np.asarray(sizes[:, self.target.freedoms - 1])

    @cached_property
    def system(self) -> Floats:
        """J above G, (n, 3 loops + 3, variables): of full rank where motions are seen."""
        return np.concatenate([self.at.jacobian, self.turning], axis=1)

    @cached_property
    def _pseudo_inverse(self) -> Floats:
        return np.asarray(np.linalg.pinv(np.nan_to_num(self.system), rcond=1e-14))

    @cached_property
    def _pulls(self) -> Floats:
        """Vectors f (n, variables, 3): the gradient by each variable is vector . f."""
        inverse, _, _ = self._split
        slope = np.einsum("nkv,nk->nv", self.turning, self.left)
        return self._combined(self.left, -np.einsum("nvm,nv->nm", inverse, slope))

    def _combined(self, at_output: Floats, at_loops: Floats) -> Floats:
        """Return what rotations (n, 3) and multipliers (n, 3 loops) pull at variables."""
        tree = self.target.closure.tree
        loops = at_loops.reshape(len(at_loops), len(tree.chords), 3)
        pulled = np.einsum("lv,nlk->nvk", tree.signs, loops)
        return np.asarray(pulled + self.target.reach[:, None] * at_output[:, None])

    def _turned(self, rates: Floats) -> Floats:
        """Return how vectors change, (n, variables, 3), at rates (n, variables)."""
        return self.at.turned(self.at.body_rates(rates)).vectors

    def _turned_twice(self, rates: Floats, turned: Floats) -> Floats:
        """Return the second derivatives (n, variables, 3) of vectors at constant rates.

        NaN for contact pairs, whose profiles would be needed to one more derivative.
        """
        tree = self.at.tree
        first = self.at.body_rates(rates)[:, tree.firsts]
        change = tree.body_rates(turned, rates)[:, tree.firsts]
        out = np.full_like(turned, np.nan)
        for v, pair in enumerate(self.target.closure.tree.owners):
            if self.target.closure.joints[pair].has_axis:
                out[:, v] = cross(change[:, pair], self.at.vectors[:, v])
                out[:, v] += cross(first[:, pair], turned[:, v])
        return out

    @property
    def _departs(self) -> bool:
        return bool(np.any(np.linalg.norm(self.left, axis=1) > DEPARTED))

    @cached_property
    def _curved(self) -> Floats:
        """How the gradient by the free motions bends with them, (n, freedoms, freedoms)."""
        if not self._departs:
            return np.zeros((len(self.values), *2 * (self.free.shape[2],)))
        columns = [
            np.einsum("nvk,nvk->nv", self._turned(self.free[:, :, j]), self._pulls)
            for j in range(self.free.shape[2])
        ]
        return np.asarray(np.swapaxes(self.free, 1, 2) @ np.stack(columns, axis=2))

    @cached_property
    def stiffness(self) -> Floats:
        """Second derivative (n, freedoms, freedoms) of a^2 / 2 along configurations."""
        log = LogRate(self.left, -1.0)
        turned = [log.of(self.swing[:, :, j]) for j in range(self.swing.shape[2])]
        return np.asarray(
            np.swapaxes(self.swing, 1, 2) @ np.stack(turned, axis=2) - self._curved
        )

    @cached_property
    def least_eigenvalue(self) -> Floats:
        """(n,) least second derivative of a^2 / 2 along configurations; -1 if unknown."""
        stiffness = 0.5 * (self.stiffness + np.swapaxes(self.stiffness, 1, 2))
        finite = np.all(np.isfinite(stiffness), axis=(1, 2))
        least = np.full(len(stiffness), -1.0)
        least[finite] = np.linalg.eigvalsh(stiffness[finite])[:, 0]
        return least

    def step(self) -> Floats:
        """Return the change (n, variables) of Newton's method towards the nearest one.

        Where a^2 / 2 is not convex the curvature is left out, which always descends.
        """
        inverse, free, _ = self._split
        closing = -np.einsum("nvm,nm->nv", inverse, self.at.residual)
        turned = np.einsum("nkv,nv->nk", self.turning, closing)
        left = self.left - LogRate(self.left, -1.0).of(turned)
        pull = np.einsum("nkj,nk->nj", self.swing, left)
        if self._departs:
            force = np.einsum("nvk,nvk->nv", self._turned(closing), self._pulls)
            pull += np.einsum("nvj,nv->nj", free, force)
        plain = np.swapaxes(self.swing, 1, 2) @ self.swing
        convex = self.least_eigenvalue > 1e-6 * self.output_singular_value**2
        used = np.where(convex[:, None, None], self.stiffness, plain)
        along = np.einsum("nij,nj->ni", _inverse(used), pull)
        return np.asarray(np.einsum("nvj,nj->nv", free, along) + closing)

    def exact_step(self) -> Floats:
        """Return the change (n, variables) of Newton's method where the link can follow.

        The orientation is one more equation then, which also holds the links where the
        loops alone do not.
        """
        right = np.concatenate([-self.at.residual, self.left], axis=1)
        return np.asarray(np.einsum("nvm,nm->nv", self._pseudo_inverse, right))

    def miss(self, exact: bool) -> Floats:
        """Return by how much (n,) loops are open, and how far off the link is (rad).

        As the gradient of a^2 / 2, or with `exact` as the rotation left.
        """
        if exact:
            both = np.concatenate([self.at.residual, self.left], axis=1)
            return np.asarray(np.max(np.abs(both), axis=1))
        pull = np.einsum("nkj,nk->nj", self.swing, self.left)
        open_by = self.at.gap
        return np.asarray(np.maximum(open_by, np.max(np.abs(pull), axis=1)))

    def rates(self, axis: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return first and second derivatives (n, variables) by theta.

        As the target turns about an `axis` (3,), a unit vector in the axes of body 0; and
        whether (n,) the output link turns exactly as wanted. The configurations have to be
        nearest ones. Where the link follows exactly, its rotation is one more equation of
        the motion, which also holds where the loops alone do not fix it.
        """
        first, second, misfit = self._exact_rates(axis)
        follows = np.linalg.norm(self.left, axis=1) < DEPARTED
        follows &= misfit < DEPARTED
        if not np.all(follows):
            near, rows = self._nearest_rates(axis), follows[:, None]
            first, second = np.where(rows, first, near[0]), np.where(rows, second, near[1])
        return first, second, follows

    def _exact_rates(self, axis: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the rates if the output link turns about the axis, and by how far not."""
        rows = self.system.shape[1]
        inverse = self._pseudo_inverse
        right = np.zeros((len(self.values), rows))
        right[:, -3:] = axis
        first = np.einsum("nvm,nm->nv", inverse, right)
        left = np.einsum("nmv,nv->nm", self.system, first) - right
        turned = self._turned(first)
        bias = np.zeros_like(right)
        loops = self.target.closure.tree.jacobian(turned)
        bias[:, :-3] = -np.einsum("nij,nj->ni", loops, first)
        bias[:, -3:] = -np.einsum("v,nvk,nv->nk", self.target.reach, turned, first)
        second = np.einsum("nvm,nm->nv", inverse, bias)
        further = np.einsum("nmv,nv->nm", self.system, second) - bias
        size = 1.0 + np.max(np.abs(bias), axis=1)
        misfit = np.max(np.abs(left), axis=1)
        misfit = np.maximum(misfit, np.max(np.abs(further), axis=1) / size)
        return first, second, misfit

    def _nearest_rates(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the rates of the nearest configurations, from the condition for those."""
        inverse, free, _ = self._split
        log, backward = LogRate(self.left), LogRate(self.left, -1.0)
        tree, reach = self.target.closure.tree, self.target.reach
        about = np.broadcast_to(axis, self.left.shape)
        soft = _inverse(self.stiffness)

        def along(gradient: Floats) -> Floats:
            motion = np.einsum("nij,nj->ni", soft, gradient)
            return np.asarray(np.einsum("nvj,nj->nv", free, motion))

        def seen(change: Floats) -> Floats:
            return np.asarray(np.einsum("nkj,nk->nj", self.swing, change))

        first = along(seen(log.of(about)))
        turned = self._turned(first)
        w = np.einsum("nkv,nv->nk", self.turning, first)
        left_rate = log.of(about) - backward.of(w)
        pulls = self._pulls
        slope = np.einsum("nvk,nvk->nv", turned, pulls)
        slope += np.einsum("nkv,nk->nv", self.turning, left_rate)
        pulls_rate = self._combined(left_rate, -np.einsum("nvm,nv->nm", inverse, slope))

        bias = np.einsum("nij,nj->ni", tree.jacobian(turned), first)
        held = -np.einsum("nvm,nm->nv", inverse, bias)
        twice = self._turned_twice(first, turned) + self._turned(held)
        departed = np.linalg.norm(self.left, axis=1) > DEPARTED
        twice[~departed] = 0.0
        force = np.einsum("nvk,nvk->nv", twice, pulls)
        force += 2.0 * np.einsum("nvk,nvk->nv", turned, pulls_rate)
        w_bias = np.einsum("nkv,nv->nk", self.turning, held)
        w_bias += np.einsum("v,nvk,nv->nk", reach, turned, first)
        left_bias = log.changed(left_rate, about) - backward.changed(left_rate, w)
        left_bias -= backward.of(w_bias)
        second = held + along(np.einsum("nvj,nv->nj", free, force) + seen(left_bias))
        return first, second


def _inverse(matrices: Floats) -> Floats:
    """Return inverses of square matrices (n, k, k); NaN where singular."""
    out = np.full_like(matrices, np.nan)
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    regular = np.zeros(len(matrices), dtype=bool)
    regular[finite] = np.abs(np.linalg.det(matrices[finite])) > 0.0
    out[regular] = np.linalg.inv(matrices[regular])
    return out
