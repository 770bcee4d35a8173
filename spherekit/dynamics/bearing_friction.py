"""Friction that depends on the reactions which it changes.

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
from itertools import count

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import Names
from spherekit.dynamics.transmitted_forces import (
    DEPENDENT,
    DETERMINED,
    DrivenState,
    Loads,
    NewtonEuler,
    accelerating,
    balanced,
    without_centre,
)
from spherekit.errors import SolveError
from spherekit.geometry.rotation import max_abs, nans
from spherekit.mechanism.load import BearingFriction
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import listing


@dataclass(frozen=True)
class IndeterminateForces:
    """What a file would have to say more.

    `centres` are links with inertia without a centre of mass, `distances` contacts of which
    it is not known how far from O their force acts, `floating` pairs that would have to let
    their links slide along the axis as well; where all that is not `enough`, constraints
    that repeat each other leave more open.
    """

    centres: Names = ()
    distances: Names = ()
    floating: Names = ()
    enough: bool = True

    @property
    def wanted(self) -> list[str]:
        """What that is, in words."""
        wanted = []
        if self.centres:
            wanted.append(f"mass and centre of the links {listing(self.centres)}")
        if self.distances:
            wanted.append(
                f"the distance of the contacts {listing(self.distances)} from the centre"
            )
        if self.floating:
            wanted.append(
                f"that the pairs {listing(self.floating)}, or others in their loops, float "
                "(bearings, axial)"
            )
        if not self.enough:
            wanted.append("constraints that do not repeat each other")
        return wanted


def lacking(mechanism: Mechanism, frames: Floats) -> IndeterminateForces:
    """Return what would determine all forces at one row, `frames` (pairs, 3, 3) its pairs.

    The reactions that balance each other without loads are a linear space. Each pair that
    floats takes one direction from it, if the force along its axis takes part in what is
    left; the pair in which it does most is taken first.
    """
    distances = tuple(
        pair.name
        for pair in mechanism.pairs
        if not pair.kind.has_axis and pair.distance is None
    )
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
    balance = NewtonEuler(told, frames[None], forces=True)
    _, sizes, back = np.linalg.svd(balance.matrix[0])
    free = back[np.count_nonzero(sizes > DEPENDENT * sizes[0]) :].T
    along = [k for k, (_, component) in enumerate(balance.columns) if component == 5]
    from scipy.linalg import qr

    # Pivots are what is left of the rows after those taken, the longest first.
    turn, rows, order = qr(free[along].T, pivoting=True)
    taken = np.count_nonzero(np.abs(np.diag(rows)) >= np.sqrt(DETERMINED))
    floating = sorted(balance.columns[along[k]][0] for k in order[:taken])
    free = free @ turn[:, taken:]
    forces = [k for k, (_, component) in enumerate(balance.columns) if component > 2]
    return IndeterminateForces(
        tuple(without_centre(mechanism)),
        distances,
        tuple(mechanism.names_of(floating)),
        not np.any(free[forces] ** 2 > DETERMINED),
    )


SETTLED = 1e-14
"""Part of the largest force by which forces may still change when friction is known."""


MOST_ROUNDS = 100


def rubbed(
    every: DrivenState, loads: Loads, good: Bools, inverse: Floats | None = None
) -> tuple[Floats, Bools, int]:
    """Return what pairs that rub carry, given how a mechanism moves without.

    In rows that are `good`, (n, k) N on bearings and N m of contacts, in sum, else NaN;
    where (n,) that is not known, since the feedback, what comes back of a change of the
    friction, is not below 1; and in how many rounds of iteration it is found.

    Parameters
    ----------
    every
        Rows in which nothing rubs.
    good
        Which of them are finite.
    inverse
        That of the inertia matrix (n, m, m), by which friction changes the accelerations;
        without it they are given, and it changes the torques at the inputs.

    Raises
    ------
    SolveError
        If a reaction is open that friction follows from.
    """
    carried = nans((len(good), len(loads.rubbing)))
    driven, locked = every.rows(good), np.zeros(len(good), dtype=bool)
    mechanism, motion = driven.mechanism, driven.motion
    velocities = np.swapaxes(loads.velocities(motion)[..., loads.rubbing], 1, 2)
    faster, driving = 0.0 * velocities, -velocities
    if inverse is not None:
        faster, driving = velocities @ inverse[good], 0.0 * velocities
    parts = [loads.components[k] for k in loads.rubbing]
    bearings = [x.rubs for x in parts if x.rubs is not None]
    balance = balanced(driven, any(one.asks_forces for one in bearings))
    pairs = [mechanism.pair_number[one.pair] for one in bearings]
    _need_determined(driven, balance, bearings)

    def on_bearings(left: Floats) -> Floats:
        # (n, k, 2, 3); 0 at a second place where there is none
        wrenches = balance.on_pairs(balance.held(left)[0])
        forces = np.zeros((len(left), len(pairs), 2, 3))
        for k, (one, pair) in enumerate(zip(bearings, pairs, strict=True)):
            through = wrenches[:, pair, 3:] if one.asks_forces else None
            on_each = one.carried(wrenches[:, pair, :3], through)
            forces[:, k, : on_each.shape[1]] = on_each
        return forces

    still = on_bearings(balance.left)
    change = np.empty((*still.shape, len(pairs)))
    inputs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    for k, pair in enumerate(pairs):
        about = np.zeros((len(still), len(mechanism.pairs)))
        about[:, inputs] = driving[:, k]
        about[:, pair] += 1.0
        needed = accelerating(mechanism, motion, faster[:, k])
        change[..., k] = on_bearings(balance.left_by(needed, about))
    laws, timing = [part.magnitude for part in parts], driven.timing
    factors = loads.grips * loads.evaluated(laws, motion, timing.dq, timing.t)
    carried[good], locked[good], rounds = _solved(still, change, factors)
    return carried, locked, rounds


def _need_determined(
    driven: DrivenState, balance: NewtonEuler, rubbing: Sequence[BearingFriction]
) -> None:
    """Raise `SolveError` if a reaction is open that friction follows from."""
    mechanism = driven.mechanism
    for one in rubbing:
        is_open = balance.opened[:, mechanism.pair_number[one.pair]]
        if np.any(is_open[:, :3]) or not np.all(balance.settled):
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: redundant constraints leave the "
                f"reaction of pair {one.pair} open, and so the friction that follows from "
                "it; take a load of kind friction, or give gears their pressure_angle"
            )
        if one.asks_forces and (np.any(is_open) or np.any(balance.slides)):
            wanted = lacking(mechanism, driven.motion.frames[0]).wanted
            more = f"; a file that says {listing(wanted)} determines it" if wanted else ""
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: the force through the centre in pair "
                f"{one.pair} is not determined, and so the friction of its bearings that "
                f"axial asks for{more}; without axial it is that of the couple alone"
            )


def _solved(still: Floats, change: Floats, factors: Floats) -> tuple[Floats, Bools, int]:
    """Return what is carried, and what is not known, given a, b and r of the module."""
    sizes = np.sum(np.linalg.norm(change, axis=3), axis=2)
    feedback = max_abs(np.linalg.eigvals(np.abs(factors)[..., None] * sizes), axis=1)

    def at(friction: Floats) -> Floats:
        return still + np.einsum("nkjal,nl->nkja", change, friction)

    def load(friction: Floats) -> Floats:
        return np.sum(np.linalg.norm(at(friction), axis=3), axis=2)

    friction = np.zeros_like(factors)
    one = np.eye(factors.shape[1])
    carried = load(friction)
    for rounds in count(1):
        before = carried
        plain = factors * carried
        forces = at(friction)
        strengths = np.linalg.norm(forces, axis=3, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(forces / strengths)
        slope = np.einsum("nk,nkja,nkjal->nkl", factors, along, change)
        regular = feedback < 1.0
        matrix = np.where(regular[:, None, None], one - slope, one)
        newton = friction + np.linalg.solve(matrix, (plain - friction)[..., None])[..., 0]
        tried = [(guess, load(guess)) for guess in (plain, newton)]
        left = [max_abs(guess - factors * size, axis=1) for guess, size in tried]
        better = (left[1] < left[0])[:, None]
        friction, carried = (np.where(better, b, a) for a, b in zip(*tried, strict=True))
        gap = max_abs(carried - before, axis=1)
        moved = regular & ~(gap <= SETTLED * np.max(carried, axis=1))
        if rounds == MOST_ROUNDS or not np.any(moved):
            break
    return carried, moved | ~regular, rounds
