"""The moments about the centre that pairs transmit, given what moves and drives the links.

Newton's and Euler's equations of all moving links are solved for the parts of the pairs'
moments about the directions that their variables do not turn about.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.timing import Timing
from spherekit.sphere.rotation import Floats, cross, transpose

DEPENDENT = 1e-9
"""Reactions whose relative singular value is below this balance each other."""

DETERMINED = 1e-7
"""A reaction that takes a larger part than this in such a balance is not determined."""


@final
@dataclass(frozen=True)
class Driven:
    """n rows of a mechanism that moves, with the torques (n, inputs) that drive it.

    `at` are its configurations, `motion` how it moves by its inputs, `timing` how these
    move in time; `across` as of `spherekit.dynamics.forces.Loads.magnitudes`.
    """

    mechanism: Mechanism
    at: Linearisation
    motion: CoordinateMotion
    timing: Timing
    torques: Floats
    across: Floats | None

    def rows(self, good: NDArray[np.bool_]) -> "Driven":
        """Return some of the rows."""
        motion = self.motion
        part = CoordinateMotion(
            motion.values[good],
            motion.rates[good],
            motion.second[good],
            motion.rotations[good],
            motion.w[good],
            motion.dw[good],
            motion.status[good],
        )
        timing = self.timing
        return Driven(
            self.mechanism,
            Linearisation(self.at.tree, self.at.joints, self.at.values[good]),
            part,
            Timing(timing.t[good], timing.dq[good], timing.ddq[good]),
            self.torques[good],
            None if self.across is None else self.across[good],
        )


@final
@dataclass(frozen=True)
class Transmitted:
    """Moments (n, pairs, 3) in pair axes, which are open, what is left over (n,)."""

    moments: Floats
    is_open: NDArray[np.bool_]
    unbalanced: Floats

    @property
    def across(self) -> Floats:
        """(n, pairs) N m: the part across the axis."""
        return np.asarray(np.hypot(self.moments[..., 0], self.moments[..., 1]))


def transmitted(driven: Driven, joints: Sequence[Joint]) -> Transmitted:
    """Return what every pair transmits; open components are NaN."""
    mechanism, at = driven.mechanism, driven.at
    applied, about = _applied(driven)
    needed = _inertial(driven) - applied
    for pair, (first, second) in enumerate(mechanism.ends):
        along = about[:, pair, None] * at.frames[:, pair, :, 2]
        needed[:, second] -= along
        needed[:, first] += along
    columns = [
        (pair, column) for pair, joint in enumerate(joints) for column in _held(joint)
    ]
    n, links = len(about), len(mechanism.links)
    matrix = np.zeros((n, links, 3, len(columns)))
    for k, (pair, column) in enumerate(columns):
        first, second = mechanism.ends[pair]
        matrix[:, second, :, k] = at.frames[:, pair, :, column]
        matrix[:, first, :, k] = -at.frames[:, pair, :, column]
    found, loose, left = _balanced(
        matrix[:, 1:].reshape(-1, 3 * (links - 1), len(columns)),
        needed[:, 1:].reshape(-1, 3 * (links - 1)),
    )
    moments = np.zeros((n, len(mechanism.pairs), 3))
    is_open = np.zeros((n, len(mechanism.pairs), 3), dtype=bool)
    moments[:, :, 2] = about
    for k, (pair, column) in enumerate(columns):
        moments[:, pair, column] = found[:, k]
        is_open[:, pair, column] = loose[:, k]
    moments[is_open] = np.nan
    return Transmitted(moments, is_open, left)


def _held(joint: Joint) -> tuple[int, ...]:
    """Return the columns of a pair's frame about which it holds its links."""
    return tuple(range(3 - joint.freedoms))


def _inertial(driven: Driven) -> Floats:
    """Return what turns the links so (n, links, 3): I a + w x I w, in ground axes."""
    mechanism, motion = driven.mechanism, driven.motion
    speed, change = driven.timing.dq, driven.timing.ddq
    w = np.einsum("ni,nila->nla", speed, motion.w)
    faster = np.einsum("ni,nila->nla", change, motion.w)
    faster += np.einsum("ni,nk,nikla->nla", speed, speed, motion.dw)
    needed = np.zeros_like(w)
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = motion.rotations[:, link]
        tensor = turn @ np.array(mass.tensor) @ transpose(turn)
        spin = (tensor @ w[:, link, :, None])[..., 0]
        needed[:, link] = (tensor @ faster[:, link, :, None])[..., 0]
        needed[:, link] += cross(w[:, link], spin)
    return np.asarray(needed)


def _applied(driven: Driven) -> tuple[Floats, Floats]:
    """Return moments of loads on links (n, links, 3), and torques at pairs (n, pairs)."""
    mechanism, motion, t = driven.mechanism, driven.motion, driven.timing.t
    loads = Loads(mechanism)
    rates = rates_by_time(motion, driven.timing.dq)
    magnitudes = loads.magnitudes(motion.values, rates, t, driven.across)
    moments = np.zeros((len(t), len(mechanism.links), 3))
    about = np.zeros((len(t), len(mechanism.pairs)))
    for k, part in enumerate(loads.components):
        if part.pair:
            about[:, mechanism.pair_number[part.pair]] += magnitudes[:, k]
        for moment in part.moments:
            link = mechanism.link_number[moment.link]
            turn = motion.rotations[:, link]
            direction = np.broadcast_to(np.array(moment.direction), (len(turn), 3))
            if moment.axes == "link":
                direction = (turn @ direction[..., None])[..., 0]
            if moment.arm is not None:
                direction = cross(turn @ np.array(moment.arm), direction)
            moments[:, link] += magnitudes[:, k, None] * direction
    for k, item in enumerate(mechanism.inputs):
        about[:, mechanism.pair_number[item.pair]] += driven.torques[:, k]
    return moments, about


def _balanced(matrices: Floats, right: Floats) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return x (n, k) with matrices x = right, which are open, what is left over (n,)."""
    left, sizes, back = np.linalg.svd(matrices, full_matrices=False)
    kept = sizes > DEPENDENT * sizes[:, :1]
    with np.errstate(divide="ignore"):
        scales = np.where(kept, 1.0 / sizes, 0.0)
    inverse = transpose(back) @ (scales[..., None] * transpose(left))
    found = (inverse @ right[..., None])[..., 0]
    # A step of refinement brings back the digits that the inverse loses.
    missed = right - (matrices @ found[..., None])[..., 0]
    found = found + (inverse @ missed[..., None])[..., 0]
    missed = right - (matrices @ found[..., None])[..., 0]
    alone = np.where(kept[..., None], back, 0.0)
    share = np.sum(alone**2, axis=1)
    return found, 1.0 - share > DETERMINED, np.max(np.abs(missed), axis=1, initial=0.0)
