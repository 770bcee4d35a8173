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


@final
class Balance:
    """Newton's and Euler's equations of all links at n rows, solved for what pairs hold."""

    def __init__(
        self, mechanism: Mechanism, joints: Sequence[Joint], frames: Floats
    ) -> None:
        """`frames` (n, pairs, 3, 3) are those of the pairs in ground axes."""
        self.mechanism, self.frames = mechanism, frames
        self.columns = [
            (pair, column) for pair, joint in enumerate(joints) for column in _held(joint)
        ]
        n, links = len(frames), len(mechanism.links)
        matrix = np.zeros((n, links, 3, len(self.columns)))
        for k, (pair, column) in enumerate(self.columns):
            first, second = mechanism.ends[pair]
            matrix[:, second, :, k] = frames[:, pair, :, column]
            matrix[:, first, :, k] = -frames[:, pair, :, column]
        self._matrix = matrix[:, 1:].reshape(n, 3 * (links - 1), len(self.columns))
        left, sizes, back = np.linalg.svd(self._matrix, full_matrices=False)
        kept = sizes > DEPENDENT * sizes[:, :1]
        with np.errstate(divide="ignore"):
            scales = np.where(kept, 1.0 / sizes, 0.0)
        self._inverse = transpose(back) @ (scales[..., None] * transpose(left))
        share = np.sum(np.where(kept[..., None], back, 0.0) ** 2, axis=1)
        self.is_open = 1.0 - share > DETERMINED

    def left_by(self, needed: Floats, about: Floats) -> Floats:
        """Return what is left for reactions (n, links, 3), `about` (n, pairs) taken off.

        `needed` (n, links, 3) N m turns the links, `about` are torques about axes.
        """
        left = needed.copy()
        for pair, (first, second) in enumerate(self.mechanism.ends):
            along = about[:, pair, None] * self.frames[:, pair, :, 2]
            left[:, second] -= along
            left[:, first] += along
        return left

    def held(self, left: Floats) -> tuple[Floats, Floats]:
        """Return the reactions (n, columns) and what misses the equations (n,)."""
        right = left[:, 1:].reshape(len(left), self._matrix.shape[1], 1)
        reactions = self._inverse @ right
        # A step of refinement brings back the digits that the inverse loses.
        reactions = reactions + self._inverse @ (right - self._matrix @ reactions)
        missed = right - self._matrix @ reactions
        return reactions[..., 0], np.max(np.abs(missed[..., 0]), axis=1, initial=0.0)


def transmitted(driven: Driven, joints: Sequence[Joint]) -> Transmitted:
    """Return what every pair transmits; open components are NaN."""
    mechanism = driven.mechanism
    balance = Balance(mechanism, joints, driven.at.frames)
    left, about = left_over(driven, balance)
    reactions, missed = balance.held(left)
    moments = np.zeros((len(about), len(mechanism.pairs), 3))
    is_open = np.zeros(moments.shape, dtype=bool)
    moments[:, :, 2] = about
    for k, (pair, column) in enumerate(balance.columns):
        moments[:, pair, column] = reactions[:, k]
        is_open[:, pair, column] = balance.is_open[:, k]
    moments[is_open] = np.nan
    return Transmitted(moments, is_open, missed)


def left_over(driven: Driven, balance: Balance) -> tuple[Floats, Floats]:
    """Return what reactions have to do on links (n, links, 3), and torques (n, pairs)."""
    applied, about = _applied(driven)
    motion, speed = driven.motion, driven.timing.dq
    needed = turning(driven.mechanism, motion, driven.timing.ddq)
    needed += _gyroscopic(driven.mechanism, motion, speed)
    return balance.left_by(needed - applied, about), about


def _held(joint: Joint) -> tuple[int, ...]:
    """Return the columns of a pair's frame about which it holds its links."""
    return tuple(range(3 - joint.freedoms))


def turning(mechanism: Mechanism, motion: CoordinateMotion, change: Floats) -> Floats:
    """Return I a (n, links, 3), for coordinates that accelerate so (n, m), N m."""
    return _times_tensors(mechanism, motion, np.einsum("ni,nila->nla", change, motion.w))


def _gyroscopic(mechanism: Mechanism, motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return I a + w x I w (n, links, 3) while the coordinates do not accelerate, N m."""
    w = np.einsum("ni,nila->nla", speed, motion.w)
    bend = np.einsum("ni,nk,nikla->nla", speed, speed, motion.dw)
    moments = _times_tensors(mechanism, motion, bend)
    return moments + cross(w, _times_tensors(mechanism, motion, w))


def _times_tensors(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> Floats:
    """Return the links' tensors times vectors (n, links, 3), in ground axes."""
    products = np.zeros_like(vectors)
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = motion.rotations[:, link]
        tensor = turn @ np.array(mass.tensor) @ transpose(turn)
        products[:, link] = (tensor @ vectors[:, link, :, None])[..., 0]
    return products


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
