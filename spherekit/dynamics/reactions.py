"""What the pairs transmit: the moments about the centre that hold links to their motion.

Newton's and Euler's equation of each moving link about the centre O,

    I a + w x I w = moments of the loads + moments of its pairs,

has on the right, of each pair, a part along what its variables turn about, which loads and
drives say, and the reaction, which does no work. The forces through O that the pairs
transmit as well have no moment about it: they are not determined in a spherical mechanism
of rigid links, each of which every one of its pairs holds at O.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.inverse import InverseSolution, needed_torques
from spherekit.model.joints import Joint, Revolute, Rolling
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats, cross, transpose

DEPENDENT = 1e-9
"""Reactions whose relative singular value is below this balance each other."""

DETERMINED = 1e-7
"""A reaction that takes a larger part than this in such a balance is not determined."""


ROUNDING = 1e-12
"""A contact pulls where it does so by more than this part of the largest reaction."""


@final
@dataclass(frozen=True)
class Reactions:
    """What every pair transmits at n rows of a motion.

    `moments` (n, pairs, 3) N m: that of the first link on the second about O, in pair axes,
    the columns of the pair's frame in ground axes `frames` (n, pairs, 3, 3); its opposite
    acts on the first link. Of an R pair z is the axis and its component the torque of
    loads and drives; of a contact x is the tangent, y the normal to the side of the first
    body, z the point. Components whose share redundant constraints leave open are NaN, as
    are rows that failed; `is_open` (n, pairs, 3) says which. `unbalanced` (n,) N m is the
    largest moment by which a link misses its equation, `torques` what drives the inputs,
    `status` (n, pairs) theirs, with LIFT_OFF where a contact would have to pull.
    """

    torques: InverseSolution
    frames: Floats
    moments: Floats
    is_open: NDArray[np.bool_]
    unbalanced: Floats
    status: NDArray[np.int8]

    @property
    def contacts(self) -> NDArray[np.bool_]:
        """(pairs,) which pairs are contacts."""
        pairs = self.torques.mechanism.pairs
        return np.array([not pair.kind.has_axis for pair in pairs])

    @property
    def across(self) -> Floats:
        """(n, pairs) N m: the part across the axis, or across the point of a contact."""
        return np.asarray(np.hypot(self.moments[..., 0], self.moments[..., 1]))

    @property
    def push(self) -> Floats:
        """(n, pairs) N m: force of contacts along the normal, times the radius.

        Positive where it presses; NaN of R pairs.
        """
        return np.where(self.contacts, self.moments[..., 0], np.nan)

    @property
    def traction(self) -> Floats:
        """(n, pairs) N m: that along the tangent, on the second link, likewise."""
        return np.where(self.contacts, -self.moments[..., 1], np.nan)


def reactions(motion: Motion) -> Reactions:
    """Return what every pair transmits in a motion; see `needed_torques`.

    Notes
    -----
    The equations of all links are more than the reactions, by as many as there are inputs,
    since the torques of these are known: what is left over checks both.
    """
    torques = needed_torques(motion)
    mechanism, timing = motion.mechanism, motion.timing
    assert timing is not None
    at = Linearisation(motion.linearisation.tree, motion.joints, torques.values)
    applied, about = _applied(torques, at)
    needed = _inertial(torques) - applied
    for pair, (first, second) in enumerate(mechanism.ends):
        along = about[:, pair, None] * at.frames[:, pair, :, 2]
        needed[:, second] -= along
        needed[:, first] += along
    columns = [
        (pair, column)
        for pair, joint in enumerate(motion.joints)
        for column in _held(joint)
    ]
    n, links = len(motion), len(mechanism.links)
    matrix = np.zeros((n, links, 3, len(columns)))
    for k, (pair, column) in enumerate(columns):
        first, second = mechanism.ends[pair]
        matrix[:, second, :, k] = at.frames[:, pair, :, column]
        matrix[:, first, :, k] = -at.frames[:, pair, :, column]
    good = torques.status == Status.OK
    found, loose, left = _balanced(
        matrix[good, 1:].reshape(-1, 3 * (links - 1), len(columns)),
        needed[good, 1:].reshape(-1, 3 * (links - 1)),
    )
    moments = np.full((n, len(mechanism.pairs), 3), np.nan)
    is_open = np.zeros((n, len(mechanism.pairs), 3), dtype=bool)
    unbalanced = np.full(n, np.nan)
    unbalanced[good] = left
    moments[good] = 0.0
    moments[good, :, 2] = about[good]
    for k, (pair, column) in enumerate(columns):
        moments[good, pair, column] = found[:, k]
        is_open[good, pair, column] = loose[:, k]
    moments[is_open] = np.nan
    status = np.repeat(torques.status[:, None], len(mechanism.pairs), axis=1)
    contacts = np.array([not pair.kind.has_axis for pair in mechanism.pairs])
    size = np.max(np.abs(np.nan_to_num(moments)), axis=(1, 2))
    with np.errstate(invalid="ignore"):
        pulls = contacts & (moments[:, :, 0] < -ROUNDING * size[:, None])
    status[good[:, None] & pulls] = Status.LIFT_OFF
    return Reactions(torques, at.frames, moments, is_open, unbalanced, status)


def _held(joint: Joint) -> tuple[int, ...]:
    """Return the columns of a pair's frame about which it holds its links."""
    return (0, 1) if isinstance(joint, Revolute | Rolling) else (0,)


def _inertial(found: InverseSolution) -> Floats:
    """Return what turns the links so (n, links, 3): I a + w x I w, in ground axes."""
    mechanism = found.mechanism
    motion = found.motion
    speed, change = found.input_rates, found.input_accelerations
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


def _applied(found: InverseSolution, at: Linearisation) -> tuple[Floats, Floats]:
    """Return moments of loads on links (n, links, 3), and torques at pairs (n, pairs)."""
    mechanism, motion = found.mechanism, found.motion
    loads = Loads(mechanism)
    rates = rates_by_time(motion, found.input_rates)
    good = found.status == Status.OK
    magnitudes = np.full((len(found.t), len(loads.components)), np.nan)
    magnitudes[good] = loads.magnitudes(found.values[good], rates[good], found.t[good])
    moments = np.zeros((len(found.t), len(mechanism.links), 3))
    about = np.zeros((len(found.t), len(mechanism.pairs)))
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
        about[:, mechanism.pair_number[item.pair]] += found.torques[:, k]
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
