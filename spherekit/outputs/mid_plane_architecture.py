"""A mechanism with a mid-plane: the orientations of its links, and its rotations.

The end effector is the mirror image of the base in the mid-plane, so two of its
orientations differ by two reflections. This is a rotation about the line in which both
mid-planes meet, by twice the angle between them. During the rotation the normal of the
mid-plane turns about that line by half the angle (Chen et al. 2021, section 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.mirror import mirror_angles, mirror_of, reflections, upward
from spherekit.geometry.rotation import rotation_about_axis, transpose
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.geometry.triangle import frame_toward
from spherekit.geometry.vectors import cross, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint import Joint, revolute, revolutes
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.fixed_axis_rotation import (
    FollowedRotation,
    axis_and_angle,
    follow_rotation,
    unit,
)
from spherekit.outputs.mid_plane import MidPlane
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import rank_mobility
from spherekit.positions.pair_states import measure_pair_angles
from spherekit.velocities.transmission_measure import Transmission
from spherekit.wording import listing

SINGULAR_START_LEAD_RAD = 0.02
"""Angle (rad) before a singular start of a rotation from which it is followed.

Larger: the mechanism need not reach the pose before the start. Smaller: that pose is nearly
singular too.
"""

SUGGESTION_MARGIN_RAD = np.radians(0.01)
"""Angle (rad) between a suggested pose and the border of the reach.

Larger: the suggestion is further from the pose that was asked for. Smaller: it is nearly
singular.
"""

PROOF_POSE_COUNT = 64
"""Least number of poses at which the proof tests the closed form.

They are chosen from `PROOF_DIRECTION_COUNT` directions. Larger: more time.
"""

PROOF_DIRECTION_COUNT = 2**16
"""Number of mid-planes from which those within reach are chosen.

Larger: fewer mechanisms with a small reach have less than `PROOF_POSE_COUNT` poses.
"""

PROOF_REACH_RATIO = 0.95
"""Part of the reach of the legs within which the proof tests the closed form.

Larger: poses near the limit have larger rounding errors. Smaller: less is tested.
"""

Leg = tuple[int, int, int]
"""Numbers of a leg's pairs at the base, the elbow and the end effector."""

AxisKind = Literal["base", "tip", "elbow", "normal"]
"""What the axis of a pair is.

The axis of a leg at the base, at the end effector (tip) or at its elbow, or the normal of
the mid-plane.
"""

AXIS_KINDS: tuple[AxisKind, ...] = ("base", "tip", "elbow", "normal")
"""The kinds in the order in which axes are preferred for placing a link."""


@dataclass(frozen=True)
class PairAxis:
    """What the axis of a pair is, so that it can be computed in any pose.

    Base and end effector mirror each other in the mid-plane. In this architecture, every
    pair axis is an axis of a leg or the normal of the mid-plane.

    Attributes
    ----------
    kind
        The axis of a leg at the base, at the end effector ("tip") or between its two links
        ("elbow"), or the normal of the mid-plane.
    leg
        Number of the leg, -1 for the normal of the mid-plane.
    sense
        1.0 if the pair axis has the direction of this axis, -1.0 if it is opposite.
    """

    kind: AxisKind
    leg: int
    sense: float


@dataclass(frozen=True)
class MidPlaneArchitecture:
    """A mechanism whose end effector is the mirror image of its base in a plane.

    The unit normal n of this mid-plane determines the pose of the end effector. Mirror axes
    are base axes in which the closed forms of `plane` are simplest.

    Attributes
    ----------
    mechanism
        The mechanism with its base as the ground.
    joints
        The joints of the pairs of the mechanism.
    plane
        The closed forms, in mirror axes.
    effector
        Number of the end effector, the link of the `output`.
    frame
        (3, 3) from mirror axes to the axes of the base.
    image
        (3, 3) matrix with determinant -1 from the axes of the end effector to mirror axes.
        The orientation of the end effector is ``frame @ mirror(n) @ image``, where
        mirror(n) is the reflection in the mid-plane.
    legs
        Numbers of the three pairs of each leg: at the base, elbow, and end effector.
    along
        For each pair (joint) what its axis is: an axis of a leg or the normal n.
    output
        The output whose link is the end effector.
    """

    mechanism: Mechanism
    joints: tuple[Joint, ...]
    plane: MidPlane
    effector: int
    frame: Floats
    image: Floats
    legs: tuple[Leg, ...]
    along: tuple[PairAxis, ...]
    output: Output

    def name_of(self, leg: int) -> str:
        """Return the name of the pair of a leg at the base."""
        base_pair, _, _ = self.legs[leg]
        return self.mechanism.pairs[base_pair].name

    def orientations(self, normals: Floats) -> Floats:
        """Return the orientations of the end effector, the mirror image of the base.

        Mirror axes are a second set of axes fixed to the base, in which formulas are
        simple. The orientation is the product of three matrices, applied in this order:

        1. The constant matrix `image` leads from the axes of the end effector to mirror
           axes. It includes a reflection, because its determinant is -1.
        2. The reflection in the mid-plane. Two reflections together are a rotation.
        3. The constant rotation `frame` leads from mirror axes to the axes of the base.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes, in mirror axes.

        Returns
        -------
        (n, 3, 3) rotations from the axes of the end effector to those of the base.
        """
        return self.frame @ reflections(normals) @ self.image

    @cached_property
    def home(self) -> Floats:
        """(3,) direction m in mirror axes whose mirror image is the output's direction.

        The mid-plane mirrors the base to the end effector. If it has the normal n, the
        output points at mirror(n) m. Only an output with a declared direction has m.
        """
        return self.image @ np.array(self.output.direction)

    def normals_to(self, directions: Floats) -> tuple[Floats, Floats]:
        """Return the mid-planes for which the output points in given directions.

        The direction of the output is a unit vector fixed in the end effector. The
        mid-plane mirrors the base to the end effector, and a constant direction of the
        base, `home`, to the direction of the output. The normal of the mid-plane is
        therefore along the difference of both directions.

        Parameters
        ----------
        directions
            (n, 3) unit vectors in mirror axes. These are axes of the base, turned by the
            constant matrix `frame`, in which the formulas are simplest.

        Returns
        -------
        normals
            (n, 3) unit normals in mirror axes, pointing from `home` to the directions.
        distance
            (n,) distance between `home` and the direction. If it is 0, every plane through
            `home` is a solution, and the normal is NaN.
        """
        # A plain difference would amplify rounding errors of the lengths if both directions
        # are close.
        difference = _difference_of_equal_lengths(directions, self.home)
        distance = np.linalg.norm(difference, axis=1)
        with np.errstate(all="ignore"):
            return difference / distance[:, None], distance

    def angles_to(self, directions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the mid-plane angles for which the output points in given directions.

        The direction of the output is a unit vector fixed in the end effector. The
        mid-plane mirrors the base to the end effector, and a constant direction of the
        base, `home`, to the direction of the output.

        A mid-plane with the unit normal (x, y, z), z >= 0, has the angles phi = -2
        arcsin(x), gamma = 2 arcsin(y) and omega = arctan(y / z) of Chen et al. 2021. The
        components are in mirror axes: the axes of the base, turned by the constant matrix
        `frame`.

        Parameters
        ----------
        directions
            (n, 3) directions of the output, in the axes of the base.

        Returns
        -------
        phi, gamma, omega
            (n,) angles (rad). They are NaN if the direction of the output is `home`,
            because every plane through `home` is then a solution.
        """
        normals, _distance = self.normals_to(directions @ self.frame)
        return mirror_angles(normals)

    def angle_rates(self, directions: Floats, angular_velocities: Floats) -> Floats:
        """Return the derivatives of the angles phi and gamma of the mid-plane.

        Base and end effector mirror each other in the mid-plane. Its unit normal (x, y, z),
        z >= 0, has the angles phi = -2 arcsin(x) and gamma = 2 arcsin(y) of Chen et al.
        2021. Their derivatives are -2 x' / sqrt(1 - x^2) and 2 y' / sqrt(1 - y^2). The
        components are those in mirror axes: the axes of the base, turned by the constant
        matrix `frame`. The normal follows from the direction of the output: this direction
        is the mirror image of a constant direction of the base, `home`.

        Parameters
        ----------
        directions
            (n, 3) direction of the output (the unit vector, fixed in the end effector, that
            the output declares) in the axes of the base.
        angular_velocities
            (n, 3, k) angular velocity of the output per unit rate of each of k variables,
            in the axes of the base.

        Returns
        -------
        (n, k, 2) derivatives of phi and of gamma with respect to these variables.
        """
        velocities = np.swapaxes(angular_velocities, 1, 2)  # (n, k, 3)
        # The direction p of the output changes at the rate w x p.
        direction_rates = cross(velocities, directions[:, None])
        normals, normal_rates = self._normal_rates(
            directions @ self.frame, direction_rates @ self.frame
        )
        x, y, z = normals.T
        with np.errstate(all="ignore"):
            # sqrt(1 - x^2) is the length of (y, z), and sqrt(1 - y^2) that of (x, z).
            # `hypot` returns these lengths without loss of digits.
            half_phi_by_x = -1.0 / np.hypot(y, z)
            half_gamma_by_y = 1.0 / np.hypot(x, z)
            derivatives = np.stack([half_phi_by_x, half_gamma_by_y], axis=1)  # (n, 2)
            # The formulas of the angles are for z >= 0. If z < 0, the opposite normal is
            # used, whose x and y have the opposite rates.
            sign = np.where(z < 0.0, -1.0, 1.0)
            derivatives *= 2.0 * sign[:, None]
            xy_rates = normal_rates[..., :2]  # (n, k, 2)
            return derivatives[:, None] * xy_rates

    def _normal_rates(
        self, directions: Floats, direction_rates: Floats
    ) -> tuple[Floats, Floats]:
        """Return the normals of mid-planes and their derivatives.

        Base and output link mirror each other in the mid-plane. The direction p of the
        output is the mirror image of the constant direction m of the base (`home`). The
        normal is therefore n = (p - m) / L with the distance L of both. Since L' = p' . n,
        its derivative is n' = (p' - L' n) / L.

        Parameters
        ----------
        directions
            (n, 3) directions p of the output, in mirror axes (axes of the base that are
            turned by the constant matrix `frame`).
        direction_rates
            (n, k, 3) derivatives p' with respect to k variables.

        Returns
        -------
        normals
            (n, 3) unit normals in mirror axes, pointing from m to p.
        normal_rates
            (n, k, 3) derivatives of the normals. They are not finite if p is m.
        """
        normals, distance = self.normals_to(directions)
        distance_rates = np.matvec(direction_rates, normals)  # (n, k), L' = p' . n
        with np.errstate(all="ignore"):
            # p' - L' n
            normal_rates = direction_rates - distance_rates[..., None] * normals[:, None]
            return normals, normal_rates / distance[:, None, None]

    def normals(self, orientations: Floats) -> tuple[Floats, Floats]:
        """Return the mid-planes that belong to orientations of the end effector.

        In the orientations that the mechanism can reach, base and end effector mirror each
        other in a plane through the centre, the mid-plane. For any other orientation, the
        mid-plane of the nearest orientation that has one is returned.

        A mid-plane with the unit normal u belongs to the orientation ``frame @ mirror(u) @
        image``, where mirror(u) is the reflection in the plane. Mirror axes are a second
        set of axes fixed to the base, in which the formulas are simplest. The constant
        matrix `image` leads from the axes of the end effector to mirror axes. The constant
        rotation `frame` leads from mirror axes to the axes of the base.

        Parameters
        ----------
        orientations
            (n, 3, 3) rotations from the axes of the end effector to those of the base.

        Returns
        -------
        normals
            (n, 3) unit normals in mirror axes.
        deviation
            (n,) angle (rad) between the given orientation and the one that belongs to the
            returned mid-plane. It is 0 if the given orientation has a mid-plane itself.
        """
        # Solve the formula for mirror(u). The inverse of an orthogonal matrix is its
        # transpose. `mirror_of` finds the nearest reflection.
        improper_rotations = transpose(self.frame) @ orientations @ transpose(self.image)
        return mirror_of(improper_rotations)

    def place(
        self, normals: Floats, modes: ArrayLike, links: Sequence[int] | None = None
    ) -> Floats:
        """Return the orientations of all links relative to the base.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes, in which base and end effector mirror
            each other. The normals are given in mirror axes. The constant matrix `frame`
            leads from mirror axes to the axes of the base.
        modes
            (legs,) or (n, legs) signs, 1 or -1, which choose one of the two elbows (axes
            between its two links) that each leg can have.
        links
            Numbers of the requested links, all by default. The orientations of other links
            are left NaN, except for the base and the end effector.

        Returns
        -------
        (n, links, 3, 3) rotations from the axes of each link to those of the base.
        """
        # The elbows (n, legs, 3) of all legs, which the normals and the signs determine.
        elbows, _products = self.plane.elbows(normals, modes)
        link_count = len(self.mechanism.links)
        rotations = nans((len(normals), link_count, 3, 3))
        rotations[:, 0] = np.eye(3)  # the base is link 0
        rotations[:, self.effector] = self.orientations(normals)
        placed_links = set(range(link_count) if links is None else links)
        for link in placed_links - {0, self.effector}:
            # The axes of two pairs, which are not parallel, determine the orientation.
            first_pair, second_pair = self._choose_placing_pairs(link)
            # Unit vectors (n, 3) along both axes, in mirror axes.
            first_axis, second_axis = np.broadcast_arrays(
                self.axis(first_pair, normals, elbows),
                self.axis(second_pair, normals, elbows),
            )
            # Both axes determine a frame: z along the first axis, x towards the second one.
            # The frame is computed in the axes of the base and in those of the link.
            frame_in_base = self.frame @ frame_toward(first_axis, second_axis)
            frame_in_link = frame_toward(
                axis_in(self.mechanism, self.joints, first_pair, link),
                axis_in(self.mechanism, self.joints, second_pair, link),
            )
            # The rotation that takes the frame in the link to the frame in the base.
            rotations[:, link] = frame_in_base @ frame_in_link.T
        return rotations

    def _choose_placing_pairs(self, link: int) -> tuple[int, int]:
        """Return two pairs of a link that is neither the base nor the end effector.

        The axes of the two pairs are not parallel and so give the orientation of the link.
        The mid-plane is the plane in which base and end effector mirror each other. Each
        other link has axes of two different kinds, which are not parallel:

        - A link of a leg has the axis of the leg at the base or at the end effector (tip),
          and the elbow of the leg.
        - Any other link has the elbow of a leg to which it is hinged, and the normal of the
          mid-plane.
        """
        pairs_of_link = [
            pair for pair, ends in enumerate(self.mechanism.ends) if link in ends
        ]
        # `self.along[pair].kind` is the kind of the axis of a pair. After sorting by kind,
        # the first and the last pair are of different kinds.
        pairs_of_link.sort(key=lambda pair: AXIS_KINDS.index(self.along[pair].kind))
        return pairs_of_link[0], pairs_of_link[-1]

    def axis(self, pair: int, normals: Floats, elbows: Floats) -> Floats:
        """Return the unit axis of a pair.

        The axis is that of a leg at the base, its mirror image at the end effector (tip),
        the elbow of a leg (the axis between its two links), or the normal of the mid-plane,
        in which base and end effector mirror each other.

        Parameters
        ----------
        pair
            Number of the pair.
        normals
            (n, 3) unit normals of the mid-planes.
        elbows
            (n, legs, 3) elbows of all legs, as unit vectors.

        Returns
        -------
        (n, 3) axes, or (1, 3) for a pair of the base, whose axis does not move. All vectors
        are in mirror axes, a set of axes fixed to the base in which formulas are simplest.
        """
        # What the axis of this pair is: its kind, and the number of its leg.
        pair_axis = self.along[pair]
        # `plane.axes` has the axes of all legs at the base. Several pairs can be on one
        # elbow or normal: `sense` is -1 for those with the opposite direction.
        if pair_axis.kind == "base":
            return self.plane.axes[pair_axis.leg][None]
        if pair_axis.kind == "tip":
            return reflections(normals) @ self.plane.axes[pair_axis.leg]
        if pair_axis.kind == "normal":
            return pair_axis.sense * normals
        return pair_axis.sense * elbows[:, pair_axis.leg]

    def axes(self, normals: Floats, elbows: Floats) -> Floats:
        """Return the axes (n, pairs, 3) of all pairs, see `axis`."""
        axes = [self.axis(pair, normals, elbows) for pair in range(len(self.along))]
        return np.stack(np.broadcast_arrays(*axes), axis=1)

    @cached_property
    def _transmission(self) -> Transmission:
        """The transmission measure of the output, with which `transmission` is computed."""
        return Transmission.from_mechanism(self.mechanism, self.output)

    def transmission(self, normals: Floats, elbows: Floats) -> Floats:
        """Return the transmission measure (n,): how well locked inputs hold the output.

        The measure is 0 at a singularity, where the output can move with locked inputs.
        Base and output link mirror each other in the mid-plane. The output of the mechanism
        can be a direction instead of the orientation of a link. A rotation of the output
        link about this direction then does not count.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes.
        elbows
            (n, legs, 3) elbows of all legs: the axes between their two links.
        """
        directions = None
        if self.output.direction is not None:
            # The direction is the mirror image of `home`, a constant direction of the base.
            directions = reflections(normals) @ self.home
        pair_axes = self.axes(normals, elbows)
        return self._transmission.measure(pair_axes, directions)

    def values(self, placed: Floats) -> tuple[Floats, Floats]:
        """Return the pair variables, computed from the orientations of all links.

        Parameters
        ----------
        placed
            (n, links, 3, 3) orientations of all links at n poses.

        Returns
        -------
        values
            (n, pairs) pair variables (rad).
        residuals
            (n, pairs) angle (rad) between the axis of each pair in its first link and the
            axis of the pair in its second link. It is zero, up to rounding, if the links
            fit together.
        """
        # All joints are R pairs. `revolutes` returns them unchanged, for the type checker.
        joints = revolutes(self.joints)
        return measure_pair_angles(self.mechanism.ends, joints, placed)

    def proof(self) -> tuple[float, int]:
        """Test by numbers that the mechanism has the mid-plane symmetric architecture.

        In this architecture, base and end effector mirror each other in a plane. The normal
        of this mid-plane and a sign for each leg then determine the orientations of all
        links (`place`). Here `place` is called for many mid-planes within reach, with all
        combinations of the signs. Then the axis of each pair must have the same direction
        in both of its links. The mechanism must also have two degrees of freedom. The
        caller compares the results with these two requirements.

        Returns
        -------
        gap
            Largest angle (rad) between the axis of a pair as carried by its first link and
            as carried by its second. In this architecture it is a rounding error.
        freedoms
            Least number of degrees of freedom, which has to be 2. It follows from the rank
            of the velocity equations at all these mid-planes. Only the last combination of
            signs is used.

        Raises
        ------
        ModelError
            If no mid-plane within reach of all legs is found.
        """
        normals = _spread_normals(self.plane)
        if not len(normals):
            raise ModelError(
                f"{self.mechanism.name} has no mid-plane symmetric architecture: no "
                "mid-plane was found that all legs reach"
            )
        gap = 0.0
        for signs in product((1, -1), repeat=len(self.legs)):
            # The pair variables (rad), and the angle (rad) between the axes of each pair.
            values, axis_angles = self.values(self.place(normals, signs))
            gap = max(gap, float(np.max(axis_angles)))
        # Here `values` are those of the last signs.
        closure = Closure.of_mechanism(self.mechanism, self.joints)
        linearisation = closure.linearise(values)
        freedoms = rank_mobility(closure.tree, linearisation.vectors)  # at each mid-plane
        return gap, int(np.min(freedoms))

    def check_reach(self, normal: Floats) -> None:
        """Raise `SolveError` if a leg does not reach the mid-plane with a normal (3,).

        Base and end effector mirror each other in the mid-plane. A leg reaches it if the
        axis between its two links (the elbow) can be in this plane. The message names the
        nearest mid-plane that all legs reach.
        """
        # A sign, 1 or -1, chooses one of the two elbows of a leg. Out of reach both elbows
        # are NaN, so any signs can be used here.
        signs = np.ones(len(self.legs))
        elbows, _products = self.plane.elbows(normal[None], signs)  # (1, legs, 3)
        is_out_of_reach = np.isnan(elbows[0, :, 0])
        short_legs = np.flatnonzero(is_out_of_reach).tolist()
        if short_legs:
            nearest_normal = self.plane.nearest(normal, SUGGESTION_MARGIN_RAD)
            raise SolveError(
                f"{self.mechanism.name}: {describe_mid_plane(normal)} is outside the "
                f"workspace: the legs at {listing(map(self.name_of, short_legs))} do not "
                f"reach its mid-plane; the nearest pose inside is "
                f"{describe_mid_plane(nearest_normal)}"
            )

    def rotation_between(
        self, start: Floats, stop: Floats, modes: ArrayLike
    ) -> FollowedRotation:
        """Return the rotation of the end effector about a fixed axis between two poses.

        The end effector is the mirror image of the base in the mid-plane. The normal of
        this plane therefore determines the pose. Of the two opposite normals of a plane,
        the one with z >= 0 is used. The result has the configurations of the mechanism
        along the rotation, as far as the mechanism can follow it.

        Parameters
        ----------
        start, stop
            Normals (3,) of the mid-planes of both poses, in mirror axes. These are a second
            set of axes fixed to the base, in which formulas are simplest.
        modes
            (legs,) signs, 1 or -1. Each leg has two links. The axis between them, the
            elbow, has two possible positions at the start, and the sign chooses one. It is
            the sign of n . (base axis x elbow), with the normal n and the axis of the leg
            at the base.

        Raises
        ------
        SolveError
            - If `modes` is not one sign for each leg.
            - If a leg does not reach the mid-plane of a pose.
            - If the poses coincide, or differ by half a turn.
            - If the rotation can be followed neither from the start nor from a pose shortly
              before it.
        """
        signs = np.asarray(modes, dtype=float)
        if signs.shape != (len(self.legs),) or not np.all(np.abs(signs) == 1.0):
            raise SolveError(
                f"modes: found {signs.tolist()}, expected 1 or -1 for each of "
                f"{len(self.legs)} legs"
            )
        end_normals = np.stack([upward(unit(normal)) for normal in (start, stop)])
        for normal in end_normals:
            self.check_reach(normal)
        # The orientations of the end effector, and so the axis of the rotation between
        # them, are in the usual axes of the base. `rotation_about` takes the axis in these,
        # but the normal in mirror axes.
        start_orientation, stop_orientation = self.orientations(end_normals)
        axis, angle = axis_and_angle(start_orientation, stop_orientation)
        start_normal = end_normals[0]
        return self.rotation_about(start_normal, axis, angle, signs)

    def rotation_about(
        self, start: Floats, axis: Floats, angle: float, modes: Floats
    ) -> FollowedRotation:
        """Return the rotation of the end effector about an axis in the mid-plane.

        The end effector is the mirror image of the base in the mid-plane. If this plane
        turns about an axis in itself, the image turns about the same axis by twice the
        angle.

        The rotation is followed step by step from its start. The path cannot begin at a
        singular configuration. If the start is singular, the same rotation is followed from
        a pose `SINGULAR_START_LEAD_RAD` before the start.

        Parameters
        ----------
        start
            (3,) unit normal of the mid-plane at the start, in mirror axes: the axes of the
            base, turned by the constant matrix `frame`.
        axis
            (3,) unit vector in the axes of the base, at right angles to the normal.
        angle
            Angle of the rotation (rad).
        modes
            (legs,) signs, 1 or -1, which choose one of the two elbows (axes between its two
            links) that each leg can have.

        Raises
        ------
        SolveError
            If no path can begin at the start or shortly before it.
        """
        try:
            return self._follow_rotation_from(0.0, start, axis, angle, modes)
        except SolveError as error:
            try:
                return self._follow_rotation_from(
                    SINGULAR_START_LEAD_RAD, start, axis, angle, modes
                )
            except SolveError:
                raise error from None  # the error at the start itself tells more

    def _follow_rotation_from(
        self, lead: float, start: Floats, axis: Floats, angle: float, modes: Floats
    ) -> FollowedRotation:
        """Return a rotation of the end effector, followed from a pose before its start.

        A path can pass through a singular configuration but cannot begin at one. A path
        with a singular start therefore begins a little earlier. Base and end effector
        mirror each other in the mid-plane. Mirror axes are a second set of axes fixed to
        the base.

        Parameters
        ----------
        lead
            Angle (rad) of the end effector by which the path begins before the start.
        start
            (3,) unit normal of the mid-plane at the start, in mirror axes.
        axis
            (3,) unit vector of the axis of the rotation, in the axes of the base. It is at
            right angles to the normal, so it lies in the mid-plane.
        angle
            Angle (rad) of the rotation after the start.
        modes
            (legs,) signs, 1 or -1, which choose the elbow (axis between both links) of each
            leg.

        Returns
        -------
        The rotation. Its angles begin at -lead and are 0 at the start.
        """
        # 1. Turn the mid-plane back from the start. If a plane turns about an axis in the
        # plane, mirror images turn about the same axis by twice the angle.
        axis_in_mirror_axes = self.frame.T @ axis
        rotation = rotation_about_axis(axis_in_mirror_axes, [-0.5 * lead])  # (1, 3, 3)
        first_normals = rotation @ start  # (1, 3)
        # 2. Compute the pair variables (rad) of this pose.
        link_orientations = self.place(first_normals, modes)
        (first_values,), _residuals = self.values(link_orientations)
        # 3. Follow the rotation from there.
        return follow_rotation(
            self.mechanism,
            first_values,
            axis,
            angle,
            output=self.output.name,
            lead=lead,
        )


def axis_in(mechanism: Mechanism, joints: Sequence[Joint], pair: int, link: int) -> Floats:
    """Return the axis (3,) of an R pair in the axes of one of its links.

    Parameters
    ----------
    mechanism, joints
        The mechanism and the joints of its pairs.
    pair, link
        Numbers of the pair and of the link.
    """
    joint = revolute(joints[pair])
    is_first_link = mechanism.ends[pair][0] == link
    return (joint.first if is_first_link else joint.second)[:, 2]


def _spread_normals(plane: MidPlane) -> Floats:
    """Return normals (n, 3) of mid-planes that all legs reach, spread evenly.

    Base and end effector mirror each other in the mid-plane, and legs join them. The caller
    tests at these mid-planes whether the formulas of this architecture are right for the
    mechanism.

    The base axis is the axis of a leg at the base. A leg reaches the mid-planes whose angle
    to the base axis is at most `plane.reach`. The sine of this angle is |normal . axis|.
    """
    # A normal and its opposite belong to the same plane, so z >= 0 is enough.
    normals = spiral_directions(PROOF_DIRECTION_COUNT, min_z=0.0)
    # (n, legs) sines of the angles between the base axes of the legs and the mid-planes.
    # The largest angle used is a little smaller than `plane.reach`, because rounding errors
    # are large at this limit.
    sines = np.abs(normals @ plane.axes.T)
    limits = np.sin(PROOF_REACH_RATIO * plane.reach)
    all_legs_reach = np.all(sines < limits, axis=1)
    reachable = normals[all_legs_reach]
    # The normals are sorted by z. Every k-th normal is used, so that the normals stay
    # evenly spread.
    step = max(1, len(reachable) // PROOF_POSE_COUNT)
    return reachable[::step]


def describe_mid_plane(normal: Floats) -> str:
    """Return the angles of a mid-plane with the normal (3,) as text."""
    phi, gamma, _ = np.round(np.degrees(mirror_angles(normal)), 9) + 0.0
    return f"phi = {phi:.6g}, gamma = {gamma:.6g} deg"


def _difference_of_equal_lengths(vectors: Floats, reference: Floats) -> Floats:
    """Return differences v - r of unit vectors, as if their lengths were exactly equal.

    The caller needs the direction of each difference. Lengths that differ by rounding would
    change the direction of a small difference. Each vector v is therefore first scaled to
    the length of r. The lengths are nearly 1, so their difference is half of the difference
    of their squares, |v|^2 - |r|^2 = (v - r) . (v + r).

    Parameters
    ----------
    vectors
        (n, 3) unit vectors v, up to rounding.
    reference
        (3,) unit vector r, up to rounding.

    Returns
    -------
    (n, 3) differences v - r.
    """
    difference = vectors - reference
    # |v|^2 - |r|^2, and from it |v| - |r|; both are (n, 1).
    square_difference = np.sum(difference * (vectors + reference), axis=1, keepdims=True)
    length_difference = 0.5 * square_difference
    # v scaled to the length of r, less r.
    return difference - length_difference * vectors
