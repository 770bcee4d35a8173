"""Loop equations of groups that are not dyads, and their folds, in quad precision.

At a fold two configurations of the group meet, and the Jacobian has one singular value
zero. Near a fold, Newton's method converges slowly or to the wrong configuration. If the
variables move along the singular vector, the loops open by a quadratic function of the
distance. This function then shows whether the group closes, and where.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Floats
from spherekit.numerics.quad_precision import quad
from spherekit.planning.assembly_plan import Group
from spherekit.positions.fold_bounds import LEAST_SECOND_SINGULAR_VALUE
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.quad_rotations import (
    matrix_vector_products,
    multiply_matrices,
    rotate_about_z,
    transpose_matrices,
)

MAX_QUAD_NEWTON_STEPS = 40
"""Largest number of Newton steps for one group. A step gains about 16 digits at most, since
the Jacobian is inverted in float64, and few near a dead centre.
"""
MAX_FOLD_STEPS = 6
"""Largest number of Newton steps to the fold of a group. Each gains about eight digits."""
FOLD_PROBE_RAD = 1e-4
"""The step over which the curvature at a fold is measured."""
FOLD_STEP_RAD = 1e-12
"""Largest last step of Newton's method with which a fold counts as found.

The residual at the fold is then known up to the square of this number.
"""
LEAST_CURVATURE = 1e-3
"""A smaller curvature h (1/rad) cannot be distinguished from terms of third order."""
LARGEST_NEWTON_STEP_RAD = 0.1
"""Newton's method ends without a result if a step is larger."""
CONVERGED_QUAD_STEP_RAD = 1e-27
"""Newton's method has converged to a simple root if its last step is smaller."""
NEAREST_START_RAD = 1e-3
"""A solution that differs by more from the float64 values belongs to another
configuration."""


def largest_change(values: Array, start: Array) -> Floats:
    """Return the largest difference (n,) of any variable, in float64, from (n, pairs)."""
    return np.max(np.abs((values - start).astype(float)), axis=1)


class PairFrames(NamedTuple):
    """The two frames of a revolute pair, one in each body, in quad precision (33 digits).

    The z axis of both is the axis of the pair. The first frame, rotated about z by the
    angle of the pair, coincides with the second frame in space. This relation gives the
    relative orientation of the bodies. A body is a set of links whose relative orientations
    are known at each sample of the inputs. These orientations can change with an input. So
    there are frames for each of the n samples.

    Attributes
    ----------
    in_first_body
        (n, 3, 3) the first frame, in the axes of the first body of the pair.
    in_second_body
        (n, 3, 3) the second frame, in the axes of the second body.
    """

    in_first_body: Array
    in_second_body: Array


@dataclass(frozen=True)
class LoopEvaluation:
    """The loop equations of a group of bodies, evaluated for n configurations (rows).

    Newton's method solves them in quad precision (33 digits).

    Attributes
    ----------
    rotations
        For each body the rotation (n, 3, 3) from its axes to those of body 0, the first
        body of the group, in quad precision.
    residual
        (n, m) rotation vectors by which the loops are open, in quad precision. A vector has
        the sine of the rotation angle as its length. Each loop has three components, so m
        is three times the number of loops.
    jacobian
        (n, m, pairs) derivatives of the residual with respect to the variables, one for
        each pair, in float64.
    """

    rotations: list[Array]
    residual: Array
    jacobian: Floats


@dataclass(frozen=True)
class GroupFold:
    """The fold of a group of bodies, at n rows.

    A row is one sample of the inputs. At a fold the Jacobian of the loop equations has a
    singular value 0, with the right singular vector v and the left one u. The loops are
    open by e (rad) along u, and closed in all other directions. If the variables are moved
    from the fold by x (rad) along v, the loops are open by f(x) = e + h x^2 / 2 (rad) along
    u. The group closes at the roots of f. If e is 0, its two configurations meet at the
    fold.

    Attributes
    ----------
    values
        (n, pairs) variables (rad) at the fold, in quad precision.
    direction
        (n, pairs) unit vector v.
    residual
        (n,) opening e (rad) of the loops at the fold, along u.
    curvature
        (n,) coefficient h (1/rad) of the quadratic function f.
    is_known
        (n,) whether there is one fold nearby. Without a fold, the other numbers have no
        meaning.
    """

    values: Array
    direction: Floats
    residual: Floats
    curvature: Floats
    is_known: Bools

    def estimate_root(
        self, loops: "GroupLoops", start: Array, determinant_sign: float
    ) -> Array:
        """Estimate the configuration that belongs to an assembly mode near a fold.

        A group is a set of bodies that are placed together. At a fold its Jacobian is
        singular, so Newton's method works badly near it. The estimate is a better start.

        At the inputs of a row the loops need not close at the fold: in one direction they
        are open by e (`residual`). If the variables move from the fold by x (rad) along the
        unit vector `direction`, the opening becomes f(x) = e + h x^2 / 2 (rad), where h is
        `curvature`. The loops close at the roots x = +- sqrt(-2 e / h). The two roots
        belong to two modes (ways to assemble). The determinants of their Jacobians have
        opposite signs.

        There are n configurations (rows). Rows without a fold (`is_known` is false) may be
        NaN.

        Parameters
        ----------
        loops
            The loops of the group.
        start
            (n, pairs) float64 configurations (rad) near the required one.
        determinant_sign
            Sign of the determinant of the Jacobian in the required mode. If it is not known
            (0), the root nearer to `start` is taken.

        Returns
        -------
        (n, pairs) variables (rad) in quad precision. If f has no root, those of the fold.
        """
        # Without a root the maximum is 0, and both roots become the fold.
        distance = np.sqrt(np.maximum(-2.0 * self.residual / self.curvature, 0.0))
        ahead = self._move_along_direction(distance)
        behind = self._move_along_direction(-distance)
        if determinant_sign:
            is_ahead = loops.determinant_signs(ahead) * determinant_sign > 0.0
        else:
            is_ahead = largest_change(ahead, start) < largest_change(behind, start)
        return np.where(is_ahead[:, None], ahead, behind)

    def _move_along_direction(self, distance: Floats) -> Array:
        """Return the variables (n, pairs) at distances (n,) from the fold, all in rad."""
        return self.values + (distance[:, None] * self.direction).astype(quad())


class GroupLoops:
    """The loop equations of one group of bodies in quad precision, at n rows.

    A row is one sample of the inputs. The variables are those of the pairs of the group, in
    its order. Bodies are numbered within the group.

    Parameters
    ----------
    group
        An irreducible group of R pairs.
    pair_frames
        For each pair its frames in the axes of its first and of its second body.
    """

    def __init__(self, group: Group, pair_frames: Sequence[PairFrames]) -> None:
        """Find the spanning tree by which bodies are placed; other pairs close loops."""
        self.group = group
        self.pair_frames = pair_frames
        self.tree = LoopTree(len(group.bodies), group.ends, tuple(range(len(group.pairs))))

    def evaluate(self, values: Array) -> LoopEvaluation:
        """Evaluate the loop equations at variables (n, pairs), in rad.

        The bodies are placed along the pairs of a spanning tree. Each other pair, a chord,
        closes a loop. The residual is the rotation by which the loop is open, in quad
        precision. The Jacobian is in float64, which is enough for the steps of Newton's
        method.
        """
        # For each pair: the first frame, rotated by the angle of the pair, in the axes of
        # the first body. In a closed loop, the rotated frame coincides with the frame of
        # the pair in the second body.
        rotated_frames = [
            multiply_matrices(frames.in_first_body, rotate_about_z(values[:, k]))
            for k, frames in enumerate(self.pair_frames)
        ]
        rotations = self._place_bodies(rotated_frames)
        residuals = [
            self._open_angles(rotations, pair, rotated_frames[pair])
            for pair in self.tree.chords
        ]
        # For nearly closed loops, the derivative of a residual by the angle of a pair is
        # the axis of the pair, with the sign in which the loop passes the pair (0 if it
        # does not).
        axes = self._pair_axes(rotations).astype(float)
        return LoopEvaluation(
            rotations=rotations,
            residual=np.concatenate(residuals, axis=1),
            jacobian=self.tree.jacobian(axes),
        )

    def determinant_signs(self, values: Array) -> Floats:
        """Return the signs (n,) of the determinant of the Jacobian of the loop equations.

        The sign differs between the two assembly modes that meet at a dead centre.
        `values` (n, pairs) are the pair variables (rad).

        The sign has no meaning in rows that are not finite.
        """
        jacobian = self.evaluate(values).jacobian
        return np.linalg.slogdet(np.nan_to_num(jacobian))[0]

    def _place_bodies(self, rotated_frames: Sequence[Array]) -> list[Array]:
        """Return the rotation (n, 3, 3) from the axes of each body to those of body 0.

        The bodies are placed one after the other, along the pairs of a spanning tree. The
        rotations show by how much the loops are open.

        A pair has one frame in each of its two bodies. The next body is placed such that
        the first frame, rotated about z by the angle of the pair, coincides with the second
        frame in space. The same frame is then known in the axes of both bodies, which gives
        their relative rotation.

        Parameters
        ----------
        rotated_frames
            For each pair the rotated first frame (n, 3, 3), in the axes of the first body.
        """
        identity = np.eye(3).astype(quad())
        rotations = {0: np.broadcast_to(identity, rotated_frames[0].shape)}
        # The pair joins a placed body (parent) to the next body (child).
        for pair, parent, child in self.tree.placements:
            # Rotation from the axes of the second body of the pair to those of the first.
            first_from_second = multiply_matrices(
                rotated_frames[pair],
                transpose_matrices(self.pair_frames[pair].in_second_body),
            )
            first_body, _ = self.group.ends[pair]
            parent_from_child = (
                first_from_second
                if parent == first_body
                else transpose_matrices(first_from_second)
            )
            rotations[child] = multiply_matrices(rotations[parent], parent_from_child)
        return [rotations[body] for body in range(len(rotations))]

    def _open_angles(
        self, rotations: Sequence[Array], chord: int, rotated_frame: Array
    ) -> Array:
        """Return the rotation vectors (n, 3) in rad by which one loop is open.

        A chord is a pair that closes a loop, with a frame in each of the two bodies that it
        joins. The frame in the first body, rotated by the angle of the pair, coincides with
        the frame in the second body if the loop is closed. The rotation vector leads from
        the latter frame to the rotated one.

        Parameters
        ----------
        rotations
            Rotation (n, 3, 3) of each body.
        chord
            The pair that closes the loop.
        rotated_frame
            (n, 3, 3) the rotated frame in the first body, in the axes of this body.
        """
        first_body, second_body = self.group.ends[chord]
        # Both frames in the axes of body 0.
        from_first_body = multiply_matrices(rotations[first_body], rotated_frame)
        from_second_body = multiply_matrices(
            rotations[second_body], self.pair_frames[chord].in_second_body
        )
        difference = multiply_matrices(
            from_first_body, transpose_matrices(from_second_body)
        )
        # The skew part of a rotation is sin(angle) times the axis. For nearly closed loops
        # this is the rotation vector.
        skew = difference - transpose_matrices(difference)
        return 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)

    def _pair_axes(self, rotations: Sequence[Array]) -> Array:
        """Return the axes (n, pairs, 3) of all pairs, in the axes of body 0.

        `rotations` has for each body the rotation (n, 3, 3) from its axes to those of
        body 0.
        """
        axes = []
        for (first_body, _), frames in zip(self.group.ends, self.pair_frames, strict=True):
            z_axis = frames.in_first_body[..., 2]
            axes.append(matrix_vector_products(rotations[first_body], z_axis))
        return np.stack(axes, axis=1)

    def close(self, values: Array) -> tuple[Array, Floats]:
        """Close the loops of a group by Newton's method from variables (n, pairs), in rad.

        A group has links that become one body when all pairs between them are closed. The
        residual (closure errors of the loops) is computed in quad precision, and so is the
        solution. The derivatives of the residual are inverted in float64 only, because
        errors of a step are corrected by the next step.

        Returns
        -------
        values
            (n, pairs) variables (rad) in quad precision.
        step_size
            (n,) last Newton step (rad), the largest of any variable. Newton's method has
            converged if the step is smaller than `CONVERGED_QUAD_STEP_RAD`.
        """
        n = len(values)
        values = values.copy()
        step_size = np.full(n, np.inf)
        # Whether a row of variables still takes steps. The rows are independent.
        active = np.ones(n, dtype=bool)
        for _ in range(MAX_QUAD_NEWTON_STEPS):
            # The residual, and its derivatives with respect to the variables (`jacobian`).
            evaluation = self.evaluate(values)
            inverse = left_inverse(evaluation.jacobian).astype(quad())
            step = -matrix_vector_products(inverse, evaluation.residual)
            length = np.max(np.abs(step.astype(float)), axis=1)
            step_size = np.where(active, length, step_size)
            # Rows that have converged, or that diverge, take no further step.
            is_too_long = ~(length < LARGEST_NEWTON_STEP_RAD)  # also true for NaN
            active &= (length > CONVERGED_QUAD_STEP_RAD) & ~is_too_long
            if not np.any(active):
                break
            values[active] += step[active]
        return values, step_size

    def find_fold(self, values: Array) -> GroupFold:
        """Find the fold near variables (n, pairs), in rad.

        At a fold two configurations of a group of bodies meet, if its loops close there.
        The vectors v and u are the right and left singular vectors of the smallest singular
        value s of the Jacobian. If the variables move by x along v, the loops are open
        along u by f(x) = e + s x + h x^2 / 2. At the fold the slope s is zero, and the
        loops close in all directions but u. Newton's method solves both conditions. Its
        step along v is -s / h. The rest e along u is part of the result, and decides
        whether the group closes near the fold.

        The Jacobian and its singular vectors are computed in float64. Their errors only
        slow Newton's method down. Only the residual needs quad precision.
        """
        values = values.copy()
        start = values.copy()
        is_known = np.ones(len(values), dtype=bool)
        for _ in range(MAX_FOLD_STEPS):
            evaluation = self.evaluate(values)
            left_vectors, singular_values, right_vectors = np.linalg.svd(
                np.nan_to_num(evaluation.jacobian)
            )
            # The vectors v and u of the smallest singular value.
            direction = right_vectors[:, -1]
            residual_direction = left_vectors[:, :, -1]
            # The derivative of the Jacobian along v, by a central difference.
            probe_step = (FOLD_PROBE_RAD * direction).astype(quad())
            jacobian_ahead = self.evaluate(values + probe_step).jacobian
            probe_step = (-FOLD_PROBE_RAD * direction).astype(quad())
            jacobian_behind = self.evaluate(values + probe_step).jacobian
            jacobian_change = (jacobian_ahead - jacobian_behind) / (2.0 * FOLD_PROBE_RAD)
            curvature = np.vecdot(residual_direction, np.matvec(jacobian_change, direction))
            step_to_fold = -singular_values[:, -1] / curvature
            # The inverse of the Jacobian without its smallest singular value closes the
            # loops in all directions but u.
            scaled_vectors = (
                np.swapaxes(right_vectors[:, :-1], 1, 2) / singular_values[:, None, :-1]
            )
            inverse = scaled_vectors @ np.swapaxes(left_vectors[:, :, :-1], 1, 2)
            step = -matrix_vector_products(inverse.astype(quad()), evaluation.residual)
            step = step + (step_to_fold[:, None] * direction).astype(quad())
            # A fold that is farther from the start belongs to another configuration.
            length = np.max(np.abs(step.astype(float)), axis=1)
            is_known &= length < NEAREST_START_RAD
            values = np.where(is_known[:, None], values + step, values)
        # The steps have converged near the start, to a fold with a clear curvature, and
        # there is no second fold (a second singular value near zero).
        is_known &= length < FOLD_STEP_RAD
        is_known &= largest_change(values, start) < NEAREST_START_RAD
        second_smallest = singular_values[:, -2]
        is_known &= second_smallest > LEAST_SECOND_SINGULAR_VALUE * singular_values[:, 0]
        is_known &= np.abs(curvature) > LEAST_CURVATURE
        # Products with the components of u; their sum is e.
        components = self.evaluate(values).residual * residual_direction.astype(quad())
        return GroupFold(
            values=values,
            direction=direction,
            residual=np.sum(components, axis=1).astype(float),
            curvature=curvature,
            is_known=is_known,
        )
