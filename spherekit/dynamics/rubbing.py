"""Friction that follows from the reactions which it changes, of bearings and contacts.

What is carried at place j of a pair k, the force on a bearing or the push of a contact, is
affine in the friction f of all pairs, a_kj + sum of b_kjl f_l. So friction solves

    f_k = r_k sum over j of |a_kj + sum of b_kjl f_l|,   r_k = -grip_k tanh(v_k' / speed_k).

The right-hand side changes by at most B_kl = |r_k| sum of |b_kjl| times a change of f.
Where the largest eigenvalue of B, the feedback, is below 1, it contracts: there is one
friction, and iteration leads to it. From 1 on there may be several or none, as in bearings
that lock. Newton's step is taken where it leaves less than iteration does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing
from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.transmitted import (
    DEPENDENT,
    DETERMINED,
    Balance,
    Balanced,
    Driven,
    accelerating,
    balanced,
    without_centre,
)
from spherekit.errors import SolveError
from spherekit.model.joints import Joint
from spherekit.model.load import Rubbing
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Lacking:
    """What a file would have to say more.

    `centres` are links with inertia without a centre of mass, `distances` contacts of which
    it is not known how far from O their force acts, `floating` pairs that would have to let
    their links slide along the axis as well; where all that is not `enough`, constraints
    that repeat each other leave more open.
    """

    centres: tuple[str, ...] = ()
    distances: tuple[str, ...] = ()
    floating: tuple[str, ...] = ()
    enough: bool = True

    @property
    def wanted(self) -> list[str]:
        """What that is, in words."""
        wanted = []
        if self.centres:
            wanted.append(f"mass and centre of the links {listing(self.centres)}")
        if self.distances:
            contacts = listing(self.distances)
            wanted.append(f"the distance of the contacts {contacts} from the centre")
        if self.floating:
            pairs = listing(self.floating)
            wanted.append(
                f"that the pairs {pairs}, or others in their loops, float (bearings, axial)"
            )
        if not self.enough:
            wanted.append("constraints that do not repeat each other")
        return wanted

    def __bool__(self) -> bool:
        return bool(self.wanted)


def lacking(mechanism: Mechanism, joints: Sequence[Joint], frames: Floats) -> Lacking:
    """Return what would determine all forces at one row, `frames` (pairs, 3, 3) its pairs.

    The reactions that balance each other without loads are a linear space. Each pair that
    floats takes one direction from it, if the force along its axis takes part in what is
    left; the pair in which it does most is taken first.
    """
    contacts = [pair.name for pair in mechanism.pairs if not pair.kind.has_axis]
    distances = [name for name in contacts if mechanism.pair(name).distance is None]
    told = replace(
        mechanism,
        masses=tuple(
            replace(mass, mass=1.0, centre=(0.0, 0.0, 0.0)) for mass in mechanism.masses
        ),
        pairs=tuple(
            replace(pair, distance=1.0) if pair.name in distances else pair
            for pair in mechanism.pairs
        ),
    )
    balance = Balance(told, joints, frames[None], forces=True)
    _, sizes, back = np.linalg.svd(balance.matrix[0])
    rank = int(np.count_nonzero(sizes > DEPENDENT * sizes[0]))
    free = back[rank:].T
    along = [k for k, (_, component) in enumerate(balance.columns) if component == 5]
    floating = []
    while along:
        parts = np.linalg.norm(free[along], axis=1)
        if np.max(parts) < np.sqrt(DETERMINED):
            break
        column = along[int(np.argmax(parts))]
        floating.append(balance.columns[column][0])
        _, _, turn = np.linalg.svd(free[[column]])
        free = free @ turn[1:].T
    forces = [k for k, (_, component) in enumerate(balance.columns) if component > 2]
    names = tuple(mechanism.pairs[pair].name for pair in sorted(floating))
    enough = not np.any(free[forces] ** 2 > DETERMINED)
    return Lacking(tuple(without_centre(mechanism)), tuple(distances), names, enough)


SETTLED = 1e-14
"""Part of the largest force by which forces may still change when friction is known."""

MOST_ROUNDS = 100


@final
@dataclass(frozen=True)
class Rubbed:
    """What each load that rubs carries (n, k), N on bearings and N m of contacts, in sum.

    `settled` (n,) says whether the feedback, what comes back of a change of the friction,
    is below 1 and the friction known, found in `rounds` of iteration.
    """

    carried: Floats
    settled: NDArray[np.bool_]
    rounds: int


def rubbed(driven: Driven, loads: Loads, faster: Floats, drives: Floats) -> Rubbed:
    """Return what the pairs of a mechanism that rub carry, given how it moves without.

    Parameters
    ----------
    driven
        Finite rows in which nothing rubs.
    faster, drives
        (n, k, m), (n, k, inputs): changes of the coordinates' accelerations and of the
        torques at the inputs by unit friction at each pair that rubs.

    Raises
    ------
    SolveError
        If a reaction is open that friction follows from.
    """
    mechanism, motion = driven.mechanism, driven.motion
    parts = [loads.components[k] for k in loads.rubbing]
    bearings = [part.rubs for part in parts if part.rubs is not None]
    whole = any(one.asks_forces for one in bearings)
    solved = balanced(driven, whole)
    balance = solved.balance
    pairs = [mechanism.pair_number[one.pair] for one in bearings]
    _need_determined(driven, solved, bearings)
    n, count = len(motion.values), len(pairs)

    def on_bearings(left: Floats) -> Floats:
        """Return what is carried (n, k, 2, 3); 0 at a second place where there is none."""
        wrenches = balance.on_pairs(balance.held(left)[0])
        forces = np.zeros((n, count, 2, 3))
        for k, (one, pair) in enumerate(zip(bearings, pairs, strict=True)):
            through = wrenches[:, pair, 3:] if one.asks_forces else None
            on_each = one.carried(wrenches[:, pair, :3], through)
            forces[:, k, : on_each.shape[1]] = on_each
        return forces

    still = on_bearings(solved.left)
    change = np.empty((n, count, 2, 3, count))
    inputs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    for k, pair in enumerate(pairs):
        about = np.zeros((n, len(mechanism.pairs)))
        about[:, inputs] = drives[:, k]
        about[:, pair] += 1.0
        needed = accelerating(mechanism, motion, faster[:, k])
        change[..., k] = on_bearings(balance.left_by(needed, about))
    rates = rates_by_time(motion, driven.timing.dq)
    factors = loads.friction(motion.values, rates, driven.timing.t)
    return _solved(still, change, factors)


def _need_determined(driven: Driven, solved: Balanced, rubbing: Sequence[Rubbing]) -> None:
    """Raise `SolveError` if a reaction is open that friction follows from."""
    mechanism, balance = driven.mechanism, solved.balance
    is_open = balance.on_pairs(balance.is_open.astype(float)) != 0.0
    for one, pair in ((one, mechanism.pair_number[one.pair]) for one in rubbing):
        if np.any(is_open[:, pair, :3]) or not np.all(solved.settled):
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: redundant constraints leave the "
                f"reaction of pair {one.pair} open, and so the friction that follows from "
                "it; take a load of kind friction, or give gears their pressure_angle"
            )
        if one.asks_forces and (np.any(is_open[:, pair]) or np.any(balance.slides)):
            wanted = lacking(mechanism, driven.joints, driven.frames[0]).wanted
            more = f"; a file that says {listing(wanted)} determines it" if wanted else ""
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: the force through the centre in pair "
                f"{one.pair} is not determined, and so the friction of its bearings that "
                f"axial asks for{more}; without axial it is that of the couple alone"
            )


def _solved(still: Floats, change: Floats, factors: Floats) -> Rubbed:
    """Return what is carried, given a, b and r of the module."""
    sizes = np.sum(np.linalg.norm(change, axis=3), axis=2)
    feedback = np.max(np.abs(np.linalg.eigvals(np.abs(factors)[..., None] * sizes)), axis=1)

    def at(friction: Floats) -> tuple[Floats, Floats]:
        forces = still + np.einsum("nkjal,nl->nkja", change, friction)
        return forces, np.linalg.norm(forces, axis=3)

    friction = np.zeros_like(factors)
    forces, strengths = at(friction)
    one = np.eye(factors.shape[1])
    rounds = 0
    while rounds < MOST_ROUNDS:
        rounds += 1
        before = np.sum(strengths, axis=2)
        plain = factors * before
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(forces / strengths[..., None])
        slope = np.einsum("nk,nkja,nkjal->nkl", factors, along, change)
        regular = feedback < 1.0
        matrix = np.where(regular[:, None, None], one - slope, one)
        newton = friction + np.linalg.solve(matrix, (plain - friction)[..., None])[..., 0]
        tried = [(guess, *at(guess)) for guess in (plain, newton)]
        left = [
            np.max(np.abs(f - factors * np.sum(size, axis=2)), axis=1)
            for f, _, size in tried
        ]
        better = left[1] < left[0]
        friction, forces, strengths = (
            np.where(better.reshape(-1, *[1] * (old.ndim - 1)), new, old)
            for old, new in zip(*tried, strict=True)
        )
        carried = np.sum(strengths, axis=2)
        gap = np.max(np.abs(carried - before), axis=1)
        moved = regular & ~(gap <= SETTLED * np.max(carried, axis=1))
        if not np.any(moved):
            break
    return Rubbed(carried, regular & ~moved, rounds)
