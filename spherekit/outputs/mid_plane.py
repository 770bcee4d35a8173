"""Closed forms of a mechanism whose base and end effector mirror each other in a plane.

Three or more legs of two links with equal arcs lead from the base to the end effector.
Their middle axes, the elbows, lie in one plane, the mid-plane. The unit normal n of this
plane determines the pose. There are two degrees of freedom, and closed forms in both
directions (Chen et al. 2021, section 2). `spherekit.outputs.mid_plane_symmetry` finds out
whether a mechanism has this architecture.
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

REACH_MESH_ERROR_SR = 1e-2
"""Error (sr) of the area of the region in which the nearest mid-plane is searched.

The border of the region is exact whatever its mesh is. Larger: small parts of the region
can be missed. Smaller: more time.
"""


@dataclass(frozen=True)
class ElbowFeet:
    """The two possible elbows of each leg at m poses, by the point half-way between them.

    A leg has two links of equal arcs. Its elbow is the unit vector of the axis between
    them. Base and end effector mirror each other in the mid-plane. The elbow lies in the
    mid-plane, and its angle to the base axis of the leg is the arc of a link. Two unit
    vectors fulfil both conditions:

        elbow = foot + triple_product * direction.

    The two vectors differ only in the sign of the triple product n . (base axis x elbow),
    with the unit normal n of the mid-plane. This sign is the mode of the leg.

    Attributes
    ----------
    foot
        (m, legs, 3) point of the mid-plane half-way between both elbows.
    direction
        (m, legs, 3) vector in the mid-plane at right angles to the base axis. It is the
        change of the elbow per unit of the triple product, so its length is not 1.
    triple_product_square
        (m, legs) square of the triple product, which is equal for both elbows. It is
        negative where the leg does not reach the mid-plane, and zero at the limit of the
        reach, where both elbows meet.
    """

    foot: Floats
    direction: Floats
    triple_product_square: Floats

    def elbows(self, modes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the elbows of the legs in given modes, and their triple products.

        A leg has two links of equal arcs, and its elbow is the axis between them. The end
        effector is the mirror image of the base in a plane, the mid-plane. The elbow of
        each leg lies in this plane.

        The angle from the elbow to the axis of the leg on the base is the arc of a link.
        Two positions of the elbow in the mid-plane have this angle. They differ in the sign
        of the triple product n . (base axis x elbow), with the unit normal n of the
        mid-plane. `foot` is the point half-way between both positions. `direction` is the
        change of the elbow per unit of the triple product:

            elbow = foot + triple_product * direction.

        Parameters
        ----------
        modes
            (legs,) or (m, legs) signs, 1 or -1, of the triple products.

        Returns
        -------
        elbows
            (m, legs, 3) unit vectors at m poses, NaN out of reach.
        triple_products
            (m, legs) triple products, NaN out of reach.
        """
        with np.errstate(all="ignore"):
            # The square root of a negative square is NaN.
            triple_products = np.multiply(np.sqrt(self.triple_product_square), modes)
            elbows = self.foot + triple_products[..., None] * self.direction
        return elbows, triple_products


@dataclass(frozen=True)
class MidPlane:
    """Legs between a base and its mirror image, in mirror axes.

    A leg has two links of equal arcs; the axis between them is the elbow. All elbows lie in
    the mid-plane with the unit normal n, which mirrors the base to the end effector. The
    mode of a leg is the sign of n . (base axis x elbow), with n_z >= 0. In mirror axes, x
    halves the angle between the base axes of the two driven legs, and z points along the
    vector product of the first and the second of these axes (O-x0y0z0 of Chen et al. 2021).

    Attributes
    ----------
    axes
        (legs, 3) unit axes of the legs at the base.
    arcs
        (legs,) arc (rad) of each of both links of the leg.
    driven
        Numbers of the two driven legs.
    dials
        (legs, 3, 3) frames whose third column is the base axis of the leg. The azimuth of
        the elbow about this axis is counted from the first column.
    phases, senses
        (legs,) The variable of the leg's pair at the base (its reading) is
        ``sense * (azimuth - phase)`` in (-pi, pi] rad.
    """

    axes: Floats
    arcs: Floats
    driven: list[int]
    dials: Floats
    phases: Floats
    senses: Floats

    @property
    def reach(self) -> Floats:
        """(legs,) largest angle (rad) between the base axis of a leg and a mid-plane."""
        return np.minimum(self.arcs, np.pi - self.arcs)

    def elbows(self, normals: Floats, modes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the elbows of all legs, the axes in which their two links meet.

        A leg leads from the base to the end effector, and both its links have equal arcs.
        Base and end effector mirror each other in the mid-plane, in which all elbows lie.

        Parameters
        ----------
        normals
            (m, 3) unit normals of the mid-planes at m poses.
        modes
            (legs,) or (m, legs) signs, 1 or -1, which choose one of the two elbows that
            each leg can have.

        Returns
        -------
        elbows
            (m, legs, 3) unit vectors, NaN where a leg does not reach the mid-plane. If the
            arcs of a leg are right angles and the normal is along its base axis, every axis
            in the mid-plane is an elbow. The result is then meaningless.
        triple_products
            (m, legs) numbers normal . (base axis x elbow). The signs are those of the
            modes. The numbers are 0 at the limit of the reach, where both elbows
            coincide, and NaN out of reach.
        """
        # The foot of a leg is the point of the mid-plane half-way between both elbows.
        return self.elbow_feet(normals).elbows(modes)

    def elbow_feet(self, normals: Floats) -> ElbowFeet:
        """Return the points half-way between both possible elbows of each leg.

        An elbow is the axis between the two links of a leg, as a point of the unit sphere.
        Both links have equal arcs. The elbow lies in the mid-plane, and its angle to the
        base axis of the leg is this arc. Two points fulfil both conditions. The foot is
        half-way between them. With the other two attributes of the result, the elbows are

            foot +- sqrt(triple_product_square) * direction.

        The square is negative if the leg does not reach the mid-plane.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes, in which base and end effector mirror
            each other.

        Notes
        -----
        Let e be an elbow, b the base axis of its leg, a the arc of each link, and h the
        angle from b to the mid-plane, positive on the side of the normal n. The projection
        p of b onto the mid-plane has the length cos(h). The elbow e lies in the mid-plane.
        The elbow is the sum of its components along p and along n x p, vectors at right
        angles:

            e = (e . p) p / cos(h)^2 + (e . (n x p)) (n x p) / cos(h)^2.

        - In the first term e . p = e . b = cos(a). This term is equal for both elbows: it
          is the foot.
        - In the second term n x p = n x b, since p is b less a multiple of n. So e . (n x
          p) is the triple product t = n . (b x e), which has opposite signs for the two
          elbows. The vector (n x p) / cos(h)^2, by which t is multiplied, is `direction`.

        The size of t follows because e has the length 1: t^2 = cos(h)^2 - cos(a)^2 =
        sin(a + h) sin(a - h). The product of sines is computed, because the difference of
        squares loses digits near the limit of the reach, where t is 0.
        """
        # (n, legs) and (n, legs, 3).
        sine_h = normals @ self.axes.T
        projection = self.axes - sine_h[..., None] * normals[:, None]
        cosine_h_square = np.vecdot(projection, projection)
        # sin(a) cos(h) and cos(a) sin(h): their sum and difference are the two sines.
        sine_cosine = np.sin(self.arcs) * np.sqrt(cosine_h_square)
        cosine_sine = np.cos(self.arcs) * sine_h
        triple_product_square = (sine_cosine + cosine_sine) * (sine_cosine - cosine_sine)
        # At the limit of the reach rounding errors decide about the sign.
        triple_product_square[np.abs(triple_product_square) <= REACH_SLACK] = 0.0
        with np.errstate(all="ignore"):
            scaled_projection = projection / cosine_h_square[..., None]  # p / cos(h)^2
            return ElbowFeet(
                foot=np.cos(self.arcs)[:, None] * scaled_projection,
                direction=cross(normals[:, None], scaled_projection),
                triple_product_square=triple_product_square,
            )

    def readings(self, elbows: Floats) -> Floats:
        """Return the variables (n, legs), rad, of the pairs (joints) at the base.

        The elbow is the middle axis of a leg of two links. The variable follows from the
        azimuth of the elbow about the base axis of the leg.

        Parameters
        ----------
        elbows
            (n, legs, 3) elbows of all legs.
        """
        # Components (n, legs) of the elbows in the frames of the pairs.
        x, y, _ = np.moveaxis(np.vecmat(elbows, self.dials), -1, 0)
        return wrap(self.senses * (np.arctan2(y, x) - self.phases))

    def normals(self, inputs: Floats) -> Floats:
        """Return the normals of the mid-planes at given values of both inputs.

        Base and end effector mirror each other in the mid-plane, so its normal determines
        the pose. Each input determines the elbow of its leg (the axis between the two links
        of the leg). Both elbows lie in the mid-plane.

        Parameters
        ----------
        inputs
            (n, 2) variables of the driven pairs at the base (rad).

        Returns
        -------
        (n, 3) unit normals with n_z >= 0; NaN where both elbows lie on one line.
        """
        first_elbow, second_elbow = np.swapaxes(self._driven_elbows(inputs), 0, 1)
        product = cross(first_elbow, second_elbow)
        # The sine of the angle between both elbows. A sine within the rounding errors of
        # the elbows means that both are on one line.
        sine = np.linalg.norm(product, axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            normals = np.where(sine > REACH_SLACK, product / sine, np.nan)
        return upward(normals)

    def _driven_elbows(self, inputs: Floats) -> Floats:
        """Return the elbows (n, 2, 3) of both driven legs at input values (n, 2), rad.

        An elbow is the unit vector of the axis between the two links of a leg. It is at the
        angle `arcs` from the base axis of the leg, at the azimuth that follows from the
        input.
        """
        azimuth = self.senses[self.driven] * inputs + self.phases[self.driven]
        x_axis, y_axis, z_axis = np.moveaxis(self.dials[self.driven], -1, 0)
        radial = np.cos(azimuth)[..., None] * x_axis + np.sin(azimuth)[..., None] * y_axis
        arcs = self.arcs[self.driven, None]
        return np.cos(arcs) * z_axis + np.sin(arcs) * radial

    def modes(self, inputs: Floats) -> Floats:
        """Return the signs (n, 2) of the driven legs at input values (n, 2) rad.

        A leg has two links; its elbow is the axis between them. The mid-plane contains all
        elbows and has the normal n. The sign of a leg is the sign of n . (base axis x
        elbow). The sign tells which of two possible elbows the leg has. It is 0 where both
        coincide, and NaN where the inputs determine no mid-plane.
        """
        products = cross(self.axes[self.driven], self._driven_elbows(inputs))
        return np.sign(np.vecdot(self.normals(inputs)[:, None], products))

    def solutions(self, normals: Floats) -> dict[tuple[int, int], Floats]:
        """Return the inputs for some mid-planes, in all four modes of the driven legs.

        This is the inverse kinematics: base and end effector mirror each other in the
        mid-plane, so it determines the pose. The elbow of a leg (the axis between its two
        links) has two possible positions, which its sign distinguishes. A mode is the signs
        of both driven legs.

        For the mechanism of Chen et al. 2021 the modes are the four configurations of Fig.
        5. With the signs (-1, 1) both driven links point away from the middle of the base,
        Fig. 5(a). If the sign of a leg is reversed, its driven link points towards the
        middle.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes.

        Returns
        -------
        The variables (n, 2) rad of both driven pairs, by the signs of their legs; NaN where
        the leg does not reach the mid-plane.
        """
        # For each leg, the point halfway between the two possible positions of its elbow.
        feet = self.elbow_feet(normals)
        leg_count = len(self.arcs)
        # The variable of a base pair depends on the elbow of its own leg only. The
        # variables (n, legs) of all legs are therefore computed once for each sign of the
        # elbows.
        variables_by_sign = {}
        for sign in (-1, 1):
            elbows, _triple_products = feet.elbows(np.full(leg_count, sign))
            variables_by_sign[sign] = self.readings(elbows)  # pair variables (n, legs)
        first_leg, second_leg = self.driven
        inputs_by_mode = {}
        for first_sign, second_sign in ((-1, 1), (-1, -1), (1, 1), (1, -1)):
            first_input = variables_by_sign[first_sign][:, first_leg]
            second_input = variables_by_sign[second_sign][:, second_leg]
            inputs = np.column_stack([first_input, second_input])
            inputs_by_mode[first_sign, second_sign] = inputs
        return inputs_by_mode

    def nearest(self, normal: Floats, margin: float = 0.0) -> Floats:
        """Return the mid-plane within reach of all legs that is nearest to a given one.

        Base and end effector mirror each other in the mid-plane. Its normal determines the
        pose.

        Parameters
        ----------
        normal
            (3,) unit normal of the given mid-plane, which may be out of reach.
        margin
            Least angle (rad) to the border of the reach, not negative.

        Returns
        -------
        (3,) unit normal with n_z >= 0; NaN if no mid-plane within reach is found.
        """
        # A leg reaches the mid-plane if the angle between its base axis and the plane is at
        # most its reach. The sine of this angle is the scalar product of normal and axis.
        # Its square is compared, since the sign does not matter. A margin larger than the
        # reach of a leg leaves no mid-plane.
        if np.any(self.reach < margin):
            return nans(3)
        sine_limits = np.sin(self.reach - margin)
        # The border of the region of all normals within reach is exact. Parts of the region
        # that are smaller than the tolerance can be missed.
        region = find_region(
            lambda normals: sine_limits**2 - (normals @ self.axes.T) ** 2,
            tolerance=REACH_MESH_ERROR_SR,
        )
        return upward(region.nearest(normal)) if region.components else nans(3)
