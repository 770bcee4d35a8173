"""The friction of bearings, which follows from the reactions that it changes.

The moment across the axis of a bearing's pair is affine in the friction f of all bearings,
a_k + sum of b_kl f_l. So friction solves

    f_k = r_k |a_k + sum of b_kl f_l|,    r_k = -grip_k tanh(v_k' / speed_k).

The right-hand side changes by at most B_kl = |r_k| |b_kl| times a change of f. Where the
largest eigenvalue of B, the feedback, is below 1, it contracts: there is one friction, and
iteration leads to it. From 1 on there may be several or none, as in bearings that lock.
Newton's step is taken where it leaves less than iteration does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.transmitted import Balance, Driven, left_over, turning
from spherekit.errors import SolveError
from spherekit.model.joints import Joint
from spherekit.sphere.rotation import Floats

SETTLED = 1e-14
"""Part of the largest moment by which moments may still change when friction is known."""

MOST_ROUNDS = 100


@final
@dataclass(frozen=True)
class Rubbed:
    """Moments (n, pairs) N m across the axes of pairs with bearings that rub, 0 of others.

    `feedback` (n,) is what comes back of a change of the friction, `settled` (n,) whether
    that is below 1 and the friction known, found in `rounds` of iteration.
    """

    across: Floats
    feedback: Floats
    settled: NDArray[np.bool_]
    rounds: int


def rubbed(
    driven: Driven, joints: Sequence[Joint], loads: Loads, faster: Floats, drives: Floats
) -> Rubbed:
    """Return what the bearings of a mechanism carry, given how it moves while none rubs.

    Parameters
    ----------
    driven
        Finite rows in which no bearing rubs.
    faster, drives
        (n, k, m), (n, k, inputs): changes of the coordinates' accelerations and of the
        torques at the inputs by a unit torque at the pair of each bearing that rubs.

    Raises
    ------
    SolveError
        If redundant constraints leave a reaction open that friction follows from.
    """
    mechanism, motion = driven.mechanism, driven.motion
    balance = Balance(mechanism, joints, driven.at.frames)
    pairs = [mechanism.pair_number[loads.components[k].pair] for k in loads.rubbing]
    places = [[balance.columns.index((pair, axis)) for axis in (0, 1)] for pair in pairs]
    for component, across_both in zip(loads.rubbing, places, strict=True):
        if np.any(balance.is_open[:, across_both]):
            name = loads.names[loads.owners[component]]
            raise SolveError(
                f"{mechanism.name}: loads.{name}: redundant constraints leave the reaction "
                f"of pair {loads.components[component].pair} open, and so the friction of "
                "its bearings; take a load of kind friction"
            )
    n, count = len(motion.values), len(pairs)
    columns = np.array(places).ravel()

    def moments(left: Floats) -> Floats:
        return balance.held(left)[0][:, columns].reshape(n, count, 2)

    still = moments(left_over(driven, balance)[0])
    change = np.empty((n, count, 2, count))
    inputs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    for k, pair in enumerate(pairs):
        about = np.zeros((n, len(mechanism.pairs)))
        about[:, inputs] = drives[:, k]
        about[:, pair] += 1.0
        needed = turning(mechanism, motion, faster[:, k])
        change[..., k] = moments(balance.left_by(needed, about))
    rates = rates_by_time(motion, driven.timing.dq)
    factors = loads.friction(motion.values, rates, driven.timing.t)
    carried = _solved(still, change, factors)
    across = np.zeros((n, len(mechanism.pairs)))
    across[:, pairs] = carried.across
    return Rubbed(across, carried.feedback, carried.settled, carried.rounds)


def _solved(still: Floats, change: Floats, factors: Floats) -> Rubbed:
    """Return the friction's moments (n, k) across, given a, b and r of the module."""
    sizes = np.linalg.norm(change, axis=2)
    feedback = np.max(np.abs(np.linalg.eigvals(np.abs(factors)[..., None] * sizes)), axis=1)

    def at(friction: Floats) -> tuple[Floats, Floats]:
        moments = still + (change @ friction[:, None, :, None])[..., 0]
        return moments, np.linalg.norm(moments, axis=2)

    friction = np.zeros_like(factors)
    moments, across = at(friction)
    one = np.eye(factors.shape[1])
    rounds = 0
    while rounds < MOST_ROUNDS:
        rounds += 1
        plain = factors * across
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(moments / across[..., None])
        slope = np.einsum("nk,nka,nkal->nkl", factors, along, change)
        regular = feedback < 1.0
        matrix = np.where(regular[:, None, None], one - slope, one)
        newton = friction + np.linalg.solve(matrix, (plain - friction)[..., None])[..., 0]
        tried = [(guess, *at(guess)) for guess in (plain, newton)]
        left = [np.max(np.abs(f - factors * size), axis=1) for f, _, size in tried]
        better = (left[1] < left[0])[:, None]
        before = across
        friction = np.where(better, newton, plain)
        moments = np.where(better[..., None], tried[1][1], tried[0][1])
        across = np.where(better, tried[1][2], tried[0][2])
        gap = np.max(np.abs(across - before), axis=1)
        moved = regular & ~(gap <= SETTLED * np.max(across, axis=1))
        if not np.any(moved):
            break
    return Rubbed(across, feedback, regular & ~moved, rounds)
