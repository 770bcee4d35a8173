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
from spherekit.dynamics.inverse import InverseSolution, needed_torques
from spherekit.dynamics.transmitted import Driven, transmitted
from spherekit.model.dynamics import Bearings
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats

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
    def bearing(self) -> Floats:
        """(n, pairs) N: the force across the axis on each bearing, NaN where none is said.

        That a single one has it about the centre; two have that of the couple, for a force
        through the centre, which adds to it, is not determined.
        """
        forces = np.full(self.across.shape, np.nan)
        mechanism = self.torques.mechanism
        for load in mechanism.loads:
            if isinstance(load, Bearings):
                pair = mechanism.pair_number[load.pair]
                forces[:, pair] = self.across[:, pair] / load.arm
        return forces

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
    driven = Driven(mechanism, at, torques.motion, timing, torques.torques, torques.across)
    good = torques.status == Status.OK
    carried = transmitted(driven.rows(good), motion.joints)
    n = len(motion)
    moments = np.full((n, len(mechanism.pairs), 3), np.nan)
    is_open = np.zeros((n, len(mechanism.pairs), 3), dtype=bool)
    unbalanced = np.full(n, np.nan)
    moments[good], is_open[good] = carried.moments, carried.is_open
    unbalanced[good] = carried.unbalanced
    status = np.repeat(torques.status[:, None], len(mechanism.pairs), axis=1)
    contacts = np.array([not pair.kind.has_axis for pair in mechanism.pairs])
    size = np.max(np.abs(np.nan_to_num(moments)), axis=(1, 2))
    with np.errstate(invalid="ignore"):
        pulls = contacts & (moments[:, :, 0] < -ROUNDING * size[:, None])
    status[good[:, None] & pulls] = Status.LIFT_OFF
    return Reactions(torques, at.frames, moments, is_open, unbalanced, status)
