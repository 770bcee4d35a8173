"""What the pairs transmit: moments about the centre and forces through it.

Newton's and Euler's equation of each moving link about the centre O,

    I a + w x I w = moments of the loads + moments of its pairs,

has on the right, of each pair, a part along what its variables turn about, which loads and
drives say, and the reaction, which does no work. The forces through O have no moment about
it. They are determined, by the equations of the forces on all links, as far as the file
says which pairs let their links slide along the axis, and where centres of mass are: every
pair that does not slide holds its links at O, and each loop of R pairs leaves three such
forces open.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.dynamics.bearing_friction import (
    IndeterminateForces,
    diagnose_indeterminate_forces,
)
from spherekit.dynamics.inverse_dynamics import InverseSolution, needed_torques
from spherekit.dynamics.transmitted_forces import (
    DrivenState,
    JointReactions,
    compute_reactions,
)
from spherekit.geometry.vectors import max_abs, nans
from spherekit.mechanism.friction import Bearings
from spherekit.positions.motion import Motion
from spherekit.status import Status

ROUNDING = 1e-12
"""A contact pulls where it does so by more than this part of the largest reaction."""


@dataclass(frozen=True)
class Reactions(JointReactions):
    """What every pair transmits at n rows of a motion.

    `moments` (n, pairs, 3) N m: that of the first link on the second about O, in pair axes,
    the columns of the pair's frame in ground axes `frames` (n, pairs, 3, 3), of an R pair
    fixed in its second link; its opposite acts on the first link. `forces` (n, pairs, 3) N
    are those through O likewise, of a contact at its point. Of an R pair z is the axis and
    its component the torque of loads and drives; of a contact x is the tangent, y the
    normal to the side of the first body, z the point. Components that constraints leave
    open are NaN, as are rows that failed; `is_open` and `open_forces` (n, pairs, 3) say
    which, `lacking` what would determine the forces, `slides` (n, links) which links no
    pair holds at O, so that no force is. `unbalanced` (n,) N m is the largest moment by
    which a link misses its equation, `torques` what drives the inputs, `status` (n, pairs)
    theirs, with LIFT_OFF where a contact would have to pull.
    """

    torques: InverseSolution
    lacking: IndeterminateForces
    status: SmallIntegers

    @property
    def frames(self) -> Floats:
        """(n, pairs, 3, 3) those of the pairs in ground axes."""
        return self.torques.motion.frames

    @property
    def forces(self) -> Floats:
        """(n, pairs, 3) N."""
        return self.wrenches[..., 3:]

    @property
    def is_open(self) -> Bools:
        """(n, pairs, 3) which components of moments are not determined."""
        return self.opened[..., :3]

    @property
    def open_forces(self) -> Bools:
        """(n, pairs, 3) which components of forces are not."""
        return self.opened[..., 3:]

    @property
    def contacts(self) -> Bools:
        """(pairs,) which pairs are contacts."""
        pairs = self.torques.mechanism.pairs
        return np.array([not pair.kind.has_axis for pair in pairs])

    @property
    def on_bearings(self) -> Mapping[str, Floats]:
        """(n, bearings, 3) N by load: the forces on its bearings, in pair axes.

        Along the axis they are NaN where the file does not say how that part is shared,
        across it where the force through O is open.
        """
        return {load.name: load.supported_loads(*self._of(load)) for load in self._bearings}

    @property
    def couples(self) -> Mapping[str, Floats]:
        """(n, bearings) N by load: what of these forces is of the couple alone."""
        return {
            load.name: np.linalg.norm(load.supported_loads(self._of(load)[0]), axis=-1)
            for load in self._bearings
        }

    @property
    def _bearings(self) -> list[Bearings]:
        loads = self.torques.mechanism.loads
        return [load for load in loads if isinstance(load, Bearings)]

    def _of(self, load: Bearings) -> tuple[Floats, Floats]:
        pair = self.torques.mechanism.pair_number[load.pair]
        return self.moments[:, pair], self.forces[:, pair]

    @property
    def push(self) -> Floats:
        """(n, pairs) N m: force of contacts along the normal, times the radius.

        Positive where it presses; NaN of R pairs.
        """
        return np.where(self.contacts, self.moments[..., 0], np.nan)

    @property
    def traction(self) -> Floats:
        """(n, pairs) N m: that along the tangent, on the second link, likewise."""
        return np.where(self.contacts, self.moments[..., 1], np.nan)

    def in_first(self, vectors: Floats) -> Floats:
        """Return x and y (n, pairs, 2), in the first link, of vectors (n, pairs, 3).

        Of an R pair along the axes that coincide with the pair axes where its variable is
        zero, but are fixed in its first link; NaN of contacts.
        """
        mechanism = self.torques.mechanism
        turned = nans(vectors.shape[:2])
        numbers = [mechanism.pair_number[pair] for pair in mechanism.angles]
        turned[:, numbers] = self.torques.values[:, [*mechanism.angles.values()]]
        cos = np.cos(turned)
        sin = np.sin(turned)
        x = vectors[..., 0]
        y = vectors[..., 1]
        return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def reactions(motion: Motion) -> Reactions:
    """Return what every pair transmits in a motion; see `needed_torques`.

    Notes
    -----
    The equations of all links are more than the reactions, by as many as there are inputs,
    since the torques of these are known: what is left over checks both.
    """
    torques = needed_torques(motion)
    mechanism = motion.mechanism
    timing = motion.timing
    assert timing is not None
    driven = DrivenState(
        mechanism, torques.motion, timing, torques.torques, torques.carried
    )
    good = torques.status == Status.OK
    carried = compute_reactions(driven.rows(good), forces=True)
    missing = IndeterminateForces()
    count = np.count_nonzero(carried.opened, axis=(1, 2))
    if np.any(count) and not np.any(carried.slides):
        frames = torques.motion.frames[good]
        missing = diagnose_indeterminate_forces(mechanism, frames[np.argmin(count)])

    def spread(made: Any, none: float | bool) -> Any:
        every = np.full((len(motion), *made.shape[1:]), none)
        every[good] = made
        return every

    result = Reactions(
        spread(carried.wrenches, np.nan),
        spread(carried.opened, False),
        spread(carried.unbalanced, np.nan),
        spread(carried.slides, False),
        torques,
        missing,
        np.repeat(torques.status[:, None], len(mechanism.pairs), axis=1),
    )
    size = max_abs(np.nan_to_num(result.moments), axis=(1, 2))
    result.status[result.push < -ROUNDING * size[:, None]] = Status.LIFT_OFF
    return result
