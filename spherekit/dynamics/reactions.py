"""The moments and forces that the pairs of a mechanism transmit.

The Newton-Euler equation of each moving link about the centre O is

    I a + w x I w = moments of the loads + moments of its pairs.

The moment of a pair has a part along the vectors of its variables, which loads and drives
determine, and the reaction, which does no work. Forces through O have no moment about O.
These forces follow from the equations of the forces on all links, if the file says which
pairs let their links slide along the axis, and where centres of mass and contacts are.
Every R pair that does not slide holds its links at O. If none slides, each loop of R pairs
leaves three such forces undetermined.
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
from spherekit.tolerances import MAX_ROW_PULL


@dataclass(frozen=True)
class Reactions(JointReactions):
    """The moments and forces that every pair transmits, at n rows of a motion.

    Components are along the pair axes, the columns of `frames`. The axes of an R pair are
    fixed in its second link, and z is the axis of the pair. The moment about z is the
    torque of loads and drives. At a contact, x is the tangent, y the normal on the side of
    the first body, and z points from the centre O to the contact. Failed rows, and
    components that redundant constraints leave undetermined, are NaN.

    Attributes
    ----------
    wrenches, opened, unbalanced, slides
        As in `JointReactions`.
    torques
        The driving torques of the motion, with its configurations.
    lacking
        The information that the mechanism file lacks, if the forces are not determined.
    status
        (n, pairs) status of the torques, and LIFT_OFF if a contact would have to pull.
    """

    torques: InverseSolution
    lacking: IndeterminateForces
    status: SmallIntegers

    @property
    def frames(self) -> Floats:
        """(n, pairs, 3, 3) pair frames in ground axes."""
        return self.torques.motion.frames

    @property
    def forces(self) -> Floats:
        """(n, pairs, 3) forces through O of the first link on the second, N."""
        return self.wrenches[..., 3:]

    @property
    def is_open(self) -> Bools:
        """(n, pairs, 3) whether a component of a moment is undetermined."""
        return self.opened[..., :3]

    @property
    def open_forces(self) -> Bools:
        """(n, pairs, 3) whether a component of a force is undetermined."""
        return self.opened[..., 3:]

    @property
    def contacts(self) -> Bools:
        """(pairs,) whether a pair is a contact."""
        pairs = self.torques.mechanism.pairs
        return np.array([not pair.kind.has_axis for pair in pairs])

    @property
    def on_bearings(self) -> Mapping[str, Floats]:
        """The forces (n, bearings, 3) on the bearings of pairs (joints), N, in pair axes.

        There are n rows (samples of the motion). Axis z of a pair is its axis of rotation.
        A mechanism file lists the bearings of a pair among its loads, because they cause
        friction. The keys are the names of these loads.

        Two bearings together exert the moment and the force that the pair transmits. A
        single bearing exerts the moment by a force across the axis, at its distance from
        the centre O. The rest of the force across the axis then acts at O, and is not in
        the result. Along the axis, each bearing exerts its share of the force.

        A component is NaN if the equations of equilibrium leave it undetermined. The z
        component is NaN if the file does not say how the bearings share the force along the
        axis.
        """
        forces_on_bearings: dict[str, Floats] = {}
        for load in self._bearing_loads:
            pair = self._pair_number(load)
            moment = self.moments[:, pair]
            force = self.forces[:, pair]
            forces = load.supported_loads(moment, force)
            # So far, the axial force of a floating bearing is 0 even in rows without a
            # valid result. In these rows all components must be NaN.
            forces[self.torques.status != Status.OK] = np.nan
            forces_on_bearings[load.name] = forces
        return forces_on_bearings

    @property
    def couples(self) -> Mapping[str, Floats]:
        """Sizes (N) of the bearing forces that the moment of a pair causes.

        The bearings on the axis of a pair support its moment by forces. The key is the name
        of the load (`Bearings`) that describes the bearings. The sizes (n, bearings) are
        computed without the force that the pair transmits through the centre O.
        """
        return {
            load.name: np.linalg.norm(
                load.supported_loads(self.moments[:, self._pair_number(load)]), axis=-1
            )
            for load in self._bearing_loads
        }

    @property
    def _bearing_loads(self) -> list[Bearings]:
        """The loads that describe bearings of pairs."""
        loads = self.torques.mechanism.loads
        return [load for load in loads if isinstance(load, Bearings)]

    def _pair_number(self, load: Bearings) -> int:
        """Return the number of the pair whose bearings a load describes."""
        return self.torques.mechanism.pair_number[load.pair]

    @property
    def push(self) -> Floats:
        """(n, pairs) N m: force of each contact along its normal, times the radius.

        The product is positive if the contact presses, and NaN for R pairs.
        """
        return np.where(self.contacts, self.moments[..., 0], np.nan)

    @property
    def traction(self) -> Floats:
        """(n, pairs) N m: force of each contact along its tangent, times the radius.

        The force acts on the second link. NaN for R pairs.
        """
        return np.where(self.contacts, self.moments[..., 1], np.nan)

    def in_first(self, vectors: Floats) -> Floats:
        """Convert vectors at R pairs (revolute joints) to axes fixed in the first link.

        The components are along pair axes, which are fixed in the second link of the pair.
        Both frames have the same z axis; the angle between their x axes is the angle of the
        pair.

        Parameters
        ----------
        vectors
            (n, pairs, 3) components along the pair axes.

        Returns
        -------
        (n, pairs, 2) components x and y; NaN for contacts, which have no angle.
        """
        mechanism = self.torques.mechanism
        # `mechanism.angles` has the column of the angle of each R pair in `values`.
        angles = nans(vectors.shape[:2])
        pair_numbers = [mechanism.pair_number[pair] for pair in mechanism.angles]
        angles[:, pair_numbers] = self.torques.values[:, [*mechanism.angles.values()]]
        cos = np.cos(angles)
        sin = np.sin(angles)
        x = vectors[..., 0]
        y = vectors[..., 1]
        return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def reactions(motion: Motion) -> Reactions:
    """Return the moments and forces that every pair transmits in a motion.

    Parameters
    ----------
    motion
        Motion of all inputs with its timing, as for `needed_torques`.

    Returns
    -------
    Moments and forces, NaN in rows without torques. The status of a contact that would have
    to pull is LIFT_OFF.

    Notes
    -----
    Because the torques at the inputs are known, there are more equations than unknown
    reactions: one more for each input. The residual of the equations, `unbalanced`, is
    therefore a check of torques and reactions.

    A component of a moment or force is undetermined (`opened`) if reactions can balance
    each other without loads. `lacking` names what the file would have to state to determine
    the forces, for example which bearings let their links slide. A link slides (`slides`)
    if no pair fixes it at the centre O of the mechanism.
    """
    torques = needed_torques(motion)
    mechanism = motion.mechanism
    timing = motion.timing
    assert timing is not None
    # `carried` are the sums of bearing forces to which friction of bearings is
    # proportional.
    driven = DrivenState(
        mechanism, torques.motion, timing, torques.torques, torques.carried
    )
    # The equations are solved in rows with torques only.
    is_ok = torques.status == Status.OK
    joint_reactions = compute_reactions(driven.rows(is_ok), forces=True)
    # If components are undetermined, further information is listed that would determine
    # them. The list stays empty if a link slides, since no pair fixes it at O.
    indeterminate_forces = IndeterminateForces()
    open_counts = np.count_nonzero(joint_reactions.opened, axis=(1, 2))
    if np.any(open_counts) and not np.any(joint_reactions.slides):
        # At special configurations, such as singularities, further components are
        # undetermined. The row with the fewest undetermined components is taken therefore.
        frames = torques.motion.frames[is_ok]
        indeterminate_forces = diagnose_indeterminate_forces(
            mechanism, frames[np.argmin(open_counts)]
        )

    def all_rows(values: Any, failed_value: float | bool) -> Any:
        """Return an array for all rows, from an array for the rows that are OK."""
        array = np.full((len(motion), *values.shape[1:]), failed_value)
        array[is_ok] = values
        return array

    result = Reactions(
        wrenches=all_rows(joint_reactions.wrenches, np.nan),
        opened=all_rows(joint_reactions.opened, False),
        unbalanced=all_rows(joint_reactions.unbalanced, np.nan),
        slides=all_rows(joint_reactions.slides, False),
        torques=torques,
        lacking=indeterminate_forces,
        status=np.repeat(torques.status[:, None], len(mechanism.pairs), axis=1),
    )
    # `push` is the force of a contact along its normal times the radius. If it is negative,
    # the contact would have to pull. Pulls that are small compared with the largest moment
    # of the row may be rounding. Teeth with a pressure angle press on one of their two
    # sides, so they never pull.
    largest_moment = max_abs(np.nan_to_num(result.moments), axis=(1, 2))
    is_pulling = result.push < -MAX_ROW_PULL * largest_moment[:, None]
    has_sides = np.array([pair.pressure_angle is not None for pair in mechanism.pairs])
    result.status[is_pulling & ~has_sides] = Status.LIFT_OFF
    return result
