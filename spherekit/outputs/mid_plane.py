"""The mid-plane architecture: base and end effector mirror each other in one plane.

Three or more legs of two links with equal arcs lead from the base to the end effector,
and their middle axes, the elbows, lie in one plane. The unit normal n of this mid-plane
is the whole pose: two freedoms, and closed forms both ways (Chen et al. 2021, section 2).
Which mechanisms have this form is found out by `spherekit.outputs.mid_plane_loci`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.geometry.direction_region import find_region
from spherekit.geometry.mirror import upward
from spherekit.geometry.vectors import cross, nans
from spherekit.numerics.angles import wrap
from spherekit.tolerances import REACH_SLACK

COARSE = 1e-2
"""Error (sr) of the reach whose nearest point is looked for; its border does not depend on
it."""


@dataclass(frozen=True)
class MidPlane:
    """Legs between a base and its mirror image, in mirror axes.

    Mirror axes: x halves the angle between the base axes of the two driven legs, z points
    along the first times the second; those of the paper are its O-x0y0z0. The mode of a
    leg is the sign of n . (base axis x elbow), with n_z >= 0.

    Attributes
    ----------
    axes
        (legs, 3) unit axes at the base.
    arcs
        (legs,) rad, of both links of each leg.
    driven
        Numbers of the two driven legs.
    dials
        (legs, 3, 3): frames with the base axis as third column; the azimuth of the elbow
        is counted from the first column.
    phases, senses
        (legs,): the reading, the variable of the leg's pair at the base, is sense times
        (azimuth - phase) in (-pi, pi].
    """

    axes: Floats
    arcs: Floats
    driven: list[int]
    dials: Floats
    phases: Floats
    senses: Floats

    @property
    def reach(self) -> Floats:
        """(legs,) rad, how far from a mid-plane the axis of a leg at the base may be."""
        return np.minimum(self.arcs, np.pi - self.arcs)

    def elbows(self, normals: Floats, modes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the elbows (n, legs, 3) and n . (base axis x elbow), (n, legs).

        NaN where a leg does not reach the mid-plane; the second is 0 at the limit of its
        reach.
        """
        middle, aside, left = self.nearest_elbows(normals)
        with np.errstate(all="ignore"):
            root = np.multiply(np.sqrt(left), modes)
            return middle + root[..., None] * aside, root

    def nearest_elbows(self, normals: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (n, legs, 3) that both elbows of a leg lie beside, and root^2.

        With the ways (n, legs, 3) from there to elbows of root 1. The last (n, legs) is the
        square of n . (base axis x elbow), negative where the leg does not reach the
        mid-plane: sin(arc + h) sin(arc - h) with h the angle from the base axis to it.
        """
        sine = normals @ self.axes.T
        flat = self.axes - sine[..., None] * normals[:, None]
        square = np.vecdot(flat, flat)
        one, other = np.sin(self.arcs) * np.sqrt(square), np.cos(self.arcs) * sine
        left = (one + other) * (one - other)
        left[np.abs(left) <= REACH_SLACK] = 0.0
        with np.errstate(all="ignore"):
            flat /= square[..., None]
            return np.cos(self.arcs)[:, None] * flat, cross(normals[:, None], flat), left

    def readings(self, elbows: Floats) -> Floats:
        """Return the variables (n, legs) rad of the pairs at the base."""
        x, y, _ = np.moveaxis(np.vecmat(elbows, self.dials), -1, 0)
        return self.senses * wrap(np.arctan2(y, x) - self.phases)

    def normals(self, inputs: Floats) -> Floats:
        """Return the normals (n, 3), n_z >= 0, for driven readings (n, 2) rad.

        NaN where both driven elbows lie on one line: they span no plane.
        """
        across = cross(*np.swapaxes(self._driven_elbows(inputs), 0, 1))
        length = np.linalg.norm(across, axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            return upward(np.where(length > REACH_SLACK, across / length, np.nan))

    def _driven_elbows(self, inputs: Floats) -> Floats:
        """Return the elbows (n, 2, 3) of the driven legs at readings (n, 2) rad."""
        azimuth = self.senses[self.driven] * inputs + self.phases[self.driven]
        x, y, z = np.moveaxis(self.dials[self.driven], -1, 0)
        turned = np.cos(azimuth)[..., None] * x + np.sin(azimuth)[..., None] * y
        arcs = self.arcs[self.driven, None]
        return np.cos(arcs) * z + np.sin(arcs) * turned

    def modes(self, inputs: Floats) -> Floats:
        """Return the modes (n, 2) of the driven legs at driven readings (n, 2) rad."""
        aside = cross(self.axes[self.driven], self._driven_elbows(inputs))
        return np.sign(np.vecdot(self.normals(inputs)[:, None], aside))

    def solutions(self, normals: Floats) -> dict[tuple[int, int], Floats]:
        """Return the driven readings (n, 2) rad in each mode of the driven legs.

        For the paper's mechanism these are the four configurations of its Fig. 5: a driven
        link points away from the middle of the base in mode -1 of the first leg and 1 of
        the second, Fig. 5(a), and towards it in the other ones.
        """
        made, modes = {}, np.ones(len(self.arcs))
        for signs in ((-1, 1), (-1, -1), (1, 1), (1, -1)):
            modes[self.driven] = signs
            made[signs] = self.readings(self.elbows(normals, modes)[0])[:, self.driven]
        return made

    def nearest(self, normal: Floats, margin: float = 0.0) -> Floats:
        """Return the mid-plane (3,) nearest to one (3,), all legs within reach.

        `margin` (rad) is how far inside it is at least. NaN if there is none.
        """
        limits = np.sin(self.reach - margin)
        reach = find_region(
            lambda normals: limits**2 - (normals @ self.axes.T) ** 2, COARSE
        )
        return upward(reach.nearest(normal)) if reach.components else nans(3)
