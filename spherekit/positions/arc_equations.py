"""Arc equations of a group of R pairs, and its configuration at their solutions.

A removed binary link (`spherekit.positions.elimination_order`) joins body A to body B of
the tree. The pair of the link in A has the axis a in body A, the pair in B has the axis b
in body B, and the binary link keeps these two axes at a fixed arc. Its equation is

    a . (R_AB b) = cos(arc),

where R_AB is the orientation of B in A, the product of the rotations about the pairs of the
tree on the path from A to B. The rotation about one pair is linear in 1, cos(angle) and
sin(angle). The equation is therefore linear in these three numbers of each of its angles,
which is the form that `spherekit.geometry.trigonometric_system` solves.

All formulas are also valid for complex angles. Rotations are then complex matrices with
R^T R = 1, and no product takes a complex conjugate.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Complexes, Floats, Indices
from spherekit.geometry.rotation import rotation_between_pairs, transpose
from spherekit.geometry.trigonometric_system import (
    angle_factors,
    find_all_angles,
    jacobian_determinants,
)
from spherekit.geometry.vectors import cross, dot
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.planning.assembly_plan import Group
from spherekit.positions.elimination_order import BinaryLink, EliminationOrder
from spherekit.positions.pair_states import pair_angle

Z_ROTATION_TERMS = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ]
)
"""(3, 3, 3) matrices T with Z(angle) = T[0] + cos(angle) T[1] + sin(angle) T[2].

Z(angle) is the rotation matrix about the z axis.
"""


@dataclass(frozen=True)
class GroupGeometry:
    """Pair frames of a group (bodies that are placed together) with R pairs only.

    Its arc equations follow from them. Each says that two axes of a link are at a fixed
    arc. The z axis of a pair frame is the axis of the pair. R_first and R_second are the
    orientations of the two bodies of a pair, and F_first and F_second its frames in them:

        R_second = R_first F_first Z(angle) F_second^T.

    Attributes
    ----------
    group
        The group, with R pairs only.
    pair_frames
        (2, pairs, samples, 3, 3) rotations from the frame of each pair to the axes of its
        first body [0] and of its second body [1]. Real or complex. A sample is one choice
        of the inputs, or one real or complex solution of the groups placed before.
    """

    group: Group
    pair_frames: Array

    def pair_frame(self, pair: int, body: int) -> Array:
        """Return the frame (samples, 3, 3) of a pair in one of the two bodies it joins."""
        side = self.group.ends[pair].index(body)
        return self.pair_frames[side, pair]

    def arc_sines(self, binary_link: BinaryLink) -> Floats:
        """Return the sine (samples,) of the arc between the two axes of a binary link.

        A binary link has two pairs. If the sine is zero, its axes coincide and the link can
        rotate freely about them. The pair frames must be real.
        """
        axes_in_link, _ = self._link_axes(binary_link)
        return np.asarray(np.linalg.norm(cross(*axes_in_link), axis=-1))

    def form_equations(self, order: EliminationOrder) -> Array:
        """Return the arc equations of a group, one for each removed link.

        Without the removed links, the other bodies of the group form a tree, whose pair
        angles are the unknowns. A removed link has two pairs, whose axes are fixed in its
        two neighbours in the tree. The arc between these axes must be equal to the arc of
        the removed link. This equation is linear in 1, cosine and sine of each angle.

        Parameters
        ----------
        order
            The t unknown angles (`tree_pairs`) and the t removed links. For each removed
            link it also has the pairs of the tree between its two neighbours.

        Returns
        -------
        (samples, t, 3, ..., 3) coefficients. The second axis counts the equations. The last
        t axes belong to the angles, in the order of `order.tree_pairs`. The entries at the
        index 0, 1 and 2 of such an axis are the coefficients of 1, the cosine and the sine
        of the angle.
        """
        equations = [
            self._form_equation(order.tree_pairs, binary_link, path)
            for binary_link, path in zip(
                order.removed_links, order.spanned_pairs, strict=True
            )
        ]
        return np.stack(equations, axis=1)

    def solve_equations(self, order: EliminationOrder) -> tuple[Complexes, Complexes]:
        """Compute all complex solutions of the arc equations, and their determinants.

        To have fewer unknowns, t links with two pairs each are removed from the group,
        until the other bodies form a tree. The unknowns are the angles of the pairs of this
        tree. Each removed link gives an equation: the angle between the axes of its two
        pairs must equal the arc (size) of the link. There are as many unknowns as
        equations.

        Parameters
        ----------
        order
            The t unknown angles (`tree_pairs`) and the t removed links. Its matrix
            `incidence` states which equation (row) contains which angle (column).
            `root_count` is the number of complex solutions, which follows from it.

        Returns
        -------
        tree_angles
            (samples, order.root_count, t) angles of `order.tree_pairs` (rad). NaN if not
            all solutions of a sample were found.
        determinants
            (samples, order.root_count) determinants of the derivatives of the equations
            with respect to the angles. A determinant is zero if two solutions coincide.
        """
        equations = self.form_equations(order)
        tree_angles = find_all_angles(equations, order.incidence)
        return tree_angles, jacobian_determinants(equations, tree_angles)

    def place_bodies(self, order: EliminationOrder, tree_angles: Array) -> Array:
        """Return the orientations of all bodies at solutions of the arc equations.

        To form the equations, some links with two pairs were removed, so that the other
        bodies form a tree without loops. These are placed pair by pair from the base body.
        The removed links are put between their two neighbours at the end.

        Parameters
        ----------
        order
            The tree and the removed links to which the angles belong.
        tree_angles
            (samples, solutions, t) real or complex angles of `order.tree_pairs` (rad).

        Returns
        -------
        (samples, solutions, bodies, 3, 3) rotations from the axes of each body to those of
        the first body of the group.
        """
        ends = self.group.ends
        shape = (*tree_angles.shape[:2], len(self.group.bodies), 3, 3)
        orientations = np.empty(shape, tree_angles.dtype)
        # First, orientations relative to the base body of the tree. Each branch of the tree
        # is a pair, a body that is placed, and the next body.
        orientations[:, :, order.base_body] = np.eye(3)
        branches = find_spanning_tree(ends, start=[order.base_body], pairs=order.tree_pairs)
        for pair, body, next_body in branches:
            # R_next = R F Z(angle) F_next^T, where F and F_next are the frames of the pair
            # in `body` and in `next_body`. Z is the rotation about the z axis, the axis of
            # the pair, by its angle. The angle counts from the first body of the pair to
            # the second. If `next_body` is the first one, the angle has the other sign.
            direction = 1.0 if ends[pair][0] == body else -1.0
            angle = direction * tree_angles[..., order.tree_pairs.index(pair)]
            # Z(angle) = T[0] + cos(angle) T[1] + sin(angle) T[2] with `Z_ROTATION_TERMS` T.
            # The factors are 1, cosine and sine along the last axis.
            z_rotation = np.tensordot(angle_factors(angle), Z_ROTATION_TERMS, 1)
            frame = self.pair_frame(pair, body)[:, None]
            next_frame = self.pair_frame(pair, next_body)[:, None]
            step = frame @ z_rotation @ transpose(next_frame)
            orientations[:, :, next_body] = orientations[:, :, body] @ step

        for binary_link in order.removed_links:
            axes_in_link, axes_in_neighbours = self._link_axes(binary_link)
            placed_axes = [
                (orientations[:, :, neighbour] @ axis[:, None, :, None])[..., 0]
                for neighbour, axis in zip(
                    binary_link.neighbours, axes_in_neighbours, strict=True
                )
            ]
            # The link is placed by the rotation that takes its two axes to the axes of its
            # neighbours. The rotation exists, because the arc equation gives the
            # neighbours' axes the arc of the link's axes.
            rotation = rotation_between_pairs(
                *(axis[:, None] for axis in axes_in_link), *placed_axes
            )
            # Complex pair frames give a complex rotation. With real angles only its real
            # part is stored.
            is_complex = np.iscomplexobj(orientations)
            orientations[:, :, binary_link.body] = rotation if is_complex else rotation.real
        # Now relative to the first body of the group.
        return transpose(orientations[:, :, :1]) @ orientations

    def measure_pair_angles(self, orientations: Floats) -> Floats:
        """Return the angles of all pairs in configurations at the first sample.

        A sample is one choice of the inputs. The caller has only one sample, for which it
        has found several solutions.

        A pair has a frame in each of its two bodies. The z axes of both frames are the axis
        of the pair. The angle of the pair is the rotation about z from the x axis of the
        first frame to the x axis of the second frame.

        Parameters
        ----------
        orientations
            (1, solutions, bodies, 3, 3) rotations from the axes of each body to those of
            the first body of the group.

        Returns
        -------
        (solutions, pairs) angles in [-pi, pi] (rad).
        """
        first_bodies, second_bodies = np.transpose(self.group.ends)
        # Frames (pairs, 3, 3) of all pairs in the axes of their first and second bodies.
        # Index 0 is the first sample.
        first_in_body = self.pair_frames[0][:, 0]
        second_in_body = self.pair_frames[1][:, 0]
        # The same frames in the axes of the first body of the group, for each solution.
        first_frames = orientations[0][:, first_bodies] @ first_in_body
        second_frames = orientations[0][:, second_bodies] @ second_in_body
        return pair_angle(first_frames, second_frames)

    def measure_pair_angles_at(self, orientations: Floats, samples: Indices) -> Floats:
        """Return the angles of all pairs in configurations at different samples.

        A pair has a frame in each of its two bodies. The z axes of both frames are the axis
        of the pair. The angle of the pair is the rotation about z from the x axis of the
        first frame to the x axis of the second frame.

        A sample is one choice of the inputs. A body can consist of several links whose
        relative positions depend on the inputs. The frames in such a body differ from
        sample to sample, so the sample of each configuration is needed.

        Parameters
        ----------
        orientations
            (k, bodies, 3, 3) rotations from the axes of each body to those of the first
            body, in k configurations.
        samples
            (k,) index of the sample to which each configuration belongs.

        Returns
        -------
        (k, pairs) angles in [-pi, pi] (rad).
        """
        first_bodies, second_bodies = np.transpose(self.group.ends)
        # Frames (pairs, samples, 3, 3) of all pairs in their first and second bodies.
        frames_in_first, frames_in_second = self.pair_frames
        # The frames (k, pairs, 3, 3) at the sample of each configuration.
        first_in_body = np.moveaxis(frames_in_first[:, samples], 0, 1)
        second_in_body = np.moveaxis(frames_in_second[:, samples], 0, 1)
        first_frames = orientations[:, first_bodies] @ first_in_body
        second_frames = orientations[:, second_bodies] @ second_in_body
        return pair_angle(first_frames, second_frames)

    def _link_axes(
        self, binary_link: BinaryLink
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return the axes of both pairs of a binary link, in the link and its neighbours.

        A binary link is a body with two R pairs, each of which joins it to a neighbour. The
        axis of a pair is the z axis of its frame. From the axes the callers compute the arc
        of the link, or place the link on the axes of its neighbours.

        Returns
        -------
        axes_in_link
            Two unit axes, (samples, 3) each, in the axes of the binary link.
        axes_in_neighbours
            The same two axes, each in the axes of the neighbour that its pair joins.
        """
        axes_in_link = []
        axes_in_neighbours = []
        for pair, neighbour in zip(binary_link.pairs, binary_link.neighbours, strict=True):
            axes_in_link.append(self.pair_frame(pair, binary_link.body)[..., 2])
            axes_in_neighbours.append(self.pair_frame(pair, neighbour)[..., 2])
        return (
            (axes_in_link[0], axes_in_link[1]),
            (axes_in_neighbours[0], axes_in_neighbours[1]),
        )

    def _form_equation(
        self, tree_pairs: tuple[int, ...], binary_link: BinaryLink, path: tuple[int, ...]
    ) -> Array:
        """Return the equation a . (R_AB b) - cos(arc) = 0 of one binary link.

        The binary link joins body A to body B and keeps the axis a, fixed in A, and the
        axis b, fixed in B, at a fixed arc. R_AB is the orientation of B in A, a product of
        rotations about the pairs on the path in the tree of the other bodies. A pair with
        the frames F and F_next in the two bodies that it joins contributes the factor
        F Z(angle) F_next^T. Z is the rotation about the z axis, the axis of the pair:
        Z(angle) = T[0] + cos(angle) T[1] + sin(angle) T[2] with `Z_ROTATION_TERMS` T.

        Parameters
        ----------
        tree_pairs
            The t pairs of the tree, in the order of the axes of the result.
        binary_link
            The removed link. A and B are its first and its second neighbour.
        path
            Pairs of the tree from A to B.

        Returns
        -------
        (samples, 3, ..., 3) coefficients with one axis per pair of the tree. Index 0, 1 and
        2 of such an axis is the factor of 1, the cosine and the sine of the angle.
        """
        axes_in_link, (axis_a, axis_b) = self._link_axes(binary_link)

        # The row vector a^T R_AB is multiplied out pair by pair, from A to B. In the sums n
        # is the sample, and i and k are the components of the vector before and after a
        # pair. Each pair inserts an axis x for 1, cos and sin in front of the components.
        # A pair frame is the rotation (n, 3, 3) from the axes of the pair to those of a
        # body.
        row_vector = axis_a
        body = binary_link.neighbours[0]
        for pair in path:
            first_body, second_body = self.group.ends[pair]
            is_forward = body == first_body
            next_body = second_body if is_forward else first_body
            # Against the direction of the pair, the rotation about z is the inverse, the
            # transpose of each of the three matrices.
            z_terms = Z_ROTATION_TERMS if is_forward else transpose(Z_ROTATION_TERMS)
            frame = self.pair_frame(pair, body)[:, None]
            next_frame = self.pair_frame(pair, next_body)[:, None]
            rotation_terms = frame @ z_terms @ transpose(next_frame)
            row_vector = np.einsum("n...i,nxik->n...xk", row_vector, rotation_terms)
            body = next_body
        coefficients = np.einsum("n...i,ni->n...", row_vector, axis_b)

        # The axes of the coefficients follow the path. The axes are put in the order of the
        # tree pairs. An angle that is not on the path has only the factor of 1, at index 0.
        path_axes = [1 + path.index(pair) for pair in tree_pairs if pair in path]
        shape = (len(coefficients), *[3] * len(tree_pairs))
        equation = np.zeros(shape, dtype=coefficients.dtype)
        index_in_equation = [slice(None) if pair in path else 0 for pair in tree_pairs]
        equation[:, *index_in_equation] = np.transpose(coefficients, [0, *path_axes])

        # The first coefficient of each sample is the constant term. The scalar product of
        # both axes in the link is cos(arc).
        equation.reshape(len(equation), -1)[:, 0] -= dot(*axes_in_link)
        return equation
