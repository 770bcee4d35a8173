"""Computes configurations near dead centres in quad precision.

At a distance d (rad, in the pair variables) from a dead centre, the error of a
configuration is the rounding error of the geometry divided by d. Within 1e-8 rad, float64
has no correct digit of d, and it does not even show whether the loops close. Two things are
different in this module. The links have the decimal sizes of the file
(`spherekit.positions.decimal_frames`). All computations have 33 digits.

The groups of the mechanism are placed one after another. A dyad is placed by the closed
form of `spherekit.geometry.dyad_axis`, any other group by Newton's method
(`spherekit.positions.quad_group_loops`). A bound of the error of the placed bodies is
updated with each group, to first order. Mechanisms with contacts, or with redundant
equations, are not supported, see `spherekit.positions.fold_bounds`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.geometry.dyad_axis import HalfAngle, middle_axis
from spherekit.geometry.vectors import dot
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.quad_precision import QUAD_EPS, quad
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.positions.decimal_frames import Frames, decimal_frames
from spherekit.positions.fold_bounds import INPUT_ROUNDING
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.quad_group_loops import (
    CONVERGED_QUAD_STEP_RAD,
    NEAREST_START_RAD,
    GroupLoops,
    PairFrames,
    largest_change,
)
from spherekit.positions.quad_rotations import (
    make_frame,
    matrix_vector_products,
    multiply_matrices,
    normalize,
    rotate_about_z,
    transpose_matrices,
)
from spherekit.status import Status
from spherekit.tolerances import EPS, MAX_SINGULAR_ANGLE_ERROR_RAD

ROUNDING_RAD = 1e3 * QUAD_EPS
"""Error bound of a body that only inputs place: a thousand rounding errors in quad."""

FOLD_SAFETY = 2.0
"""Error bounds at a fold are enlarged by this factor, for terms of third order."""
LARGEST_FLAT_DYAD_ERROR_RAD = 0.1
"""Largest error bound of a dyad at its dead centre. If it is larger, it is set to infinity.

The formula of the bound holds for small errors. Larger: bounds become unsafe. Smaller: more
configurations have no bound.
"""


class QuadConfigurations(NamedTuple):
    """Configurations of a mechanism at n values of its inputs, in quad precision.

    Quad precision means 33 digits. These configurations are used where float64 loses too
    many digits, such as near a dead centre. The links are placed group by group. A group is
    a set of bodies that become one rigid body when their loops are closed. At its dead
    centre two ways to close the group meet.

    Inputs are float64 numbers, and may be rounded from decimal numbers of degrees. `status`
    accounts for this rounding error.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad) in float64.
    error
        (n,) bound (rad) of the difference of `values` from the exact variables. The exact
        variables belong to the decimal link sizes in the file and to the float64 inputs.
        The bound is infinite if `values` are not reliable.
    status
        (n,) status of each configuration. OUT_OF_REACH: a group cannot be closed, even if
        the inputs are changed by their rounding errors. AT_SINGULARITY: a group is at its
        dead centre, up to the rounding errors of the inputs, or the error bound is too
        large. Otherwise OK.
    exact_values
        (n, variables) pair variables (rad) in quad precision.
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes, in quad precision.
    """

    values: Floats
    error: Floats
    status: SmallIntegers
    exact_values: Array
    rotations: Array


@dataclass
class _Bodies:
    """The bodies of a mechanism at n values of the inputs, while its groups are placed.

    A body is a set of links whose relative orientations are known already. A group is a set
    of bodies that become one rigid body when their loops are closed. Each group unites its
    bodies, until one body is left.

    Attributes
    ----------
    body_from_link
        For each link the rotations (n, 3, 3) from its axes to those of its body, in quad
        precision. A body has the axes of one of its links.
    values
        (n, variables) pair variables (rad) in quad precision, NaN while they are unknown.
    error
        (n,) bound of the error (rad) of the rotations. The float64 inputs count as exact.
        Only at a dead centre, where their rounding errors have a large effect, the bound
        includes this effect, too.
    rounding
        (n,) bound (rad), to first order, of the effect that the rounding errors of the
        inputs have on the rotations. There are rounding errors because a user may mean
        decimal numbers, which were rounded to float64. The bound serves to decide whether a
        group is out of reach or at its dead centre.
    is_out_of_reach
        (n,) whether a group cannot be closed, even if the inputs are changed by their
        rounding errors.
    is_at_dead_centre
        (n,) whether a group is at its dead centre (where two of its solutions meet), or may
        be if the inputs are changed by their rounding errors. True if Newton's method gave
        no reliable configuration.
    """

    body_from_link: dict[int, Array]
    values: Array
    error: Floats
    rounding: Floats
    is_out_of_reach: Bools
    is_at_dead_centre: Bools

    def merge(self, group: Group, body_rotations: Sequence[Array]) -> None:
        """Unite the bodies of a placed group to one body, in place.

        `body_from_link` has for each link the rotation (n, 3, 3) from its axes to those of
        its body. `body_rotations` has the rotations (n, 3, 3) from the axes of the other
        bodies to those of the first one, whose axes the united body gets.
        """
        for links, rotation in zip(group.bodies[1:], body_rotations, strict=True):
            for link in links:
                self.body_from_link[link] = multiply_matrices(
                    rotation, self.body_from_link[link]
                )


class QuadAssembly:
    """Places the groups (bodies placed together) of a mechanism of R pairs.

    All numbers have quad precision (33 digits), because float64 angles would lose half
    their digits at a dead centre.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly
        Its inputs, and its groups in solving order.
    """

    def __init__(self, mechanism: Mechanism, assembly: Assembly) -> None:
        """Keep the mechanism and its groups. The frames are computed when first needed."""
        self.mechanism = mechanism
        self.assembly = assembly

    @property
    def is_supported(self) -> bool:
        """Whether all pairs are R pairs, and no group has redundant equations."""
        has_only_axes = all(pair.kind.has_axis for pair in self.mechanism.pairs)
        redundant = any(group.redundant for group in self.assembly.groups)
        return has_only_axes and not redundant

    @cached_property
    def frames(self) -> dict[int, Frames]:
        """The frames of each pair, by pair index, from the decimal numbers of the file."""
        return decimal_frames(self.mechanism)

    def place(
        self,
        signs: Sequence[int],
        determinants: Sequence[float],
        q: Floats,
        starts: Floats,
    ) -> QuadConfigurations:
        """Return the configurations of an assembly mode at given inputs.

        The configurations are computed in quad precision (33 digits).

        Parameters
        ----------
        signs
            Sign of each group in the assembly mode: 1 or -1 for a dyad, 0 for other groups.
        determinants
            For each group the sign that the determinant of the Jacobian of its closure
            equations has in the assembly mode. Empty if the signs are not known.
        q
            (n, inputs) float64 values of the inputs (rad). The configurations belong to
            exactly these values. The rounding of the inputs is only used for the status,
            and for the error bounds at a dead centre.
        starts
            (n, variables) float64 configurations (rad), from which Newton's method starts
            for groups that are not dyads.

        Returns
        -------
        The configurations in quad precision and rounded to float64, with their status and
        error bounds.
        """
        with np.errstate(all="ignore"):
            # A body is a set of links whose relative orientations are known. Each group
            # merges its bodies into one; `bodies` is changed in place.
            bodies = self._place_input_bodies(q)
            for position, sign in enumerate(signs):
                group = self.assembly.groups[position]
                if sign:
                    self._place_dyad(bodies, group, sign)
                else:
                    determinant = determinants[position] if determinants else 0.0
                    self._close_group(
                        bodies, group, determinant_sign=determinant, starts=starts
                    )
            values = bodies.values.astype(float)
        # Rounding an angle of up to pi to float64 changes it by at most EPS. The factor 4
        # also covers the rounding when angles are brought into one turn.
        error = 4.0 * EPS + bodies.error
        error = np.where(np.all(np.isfinite(values), axis=1), error, np.inf)
        status = np.full(len(q), Status.OK, dtype=np.int8)
        is_doubtful = bodies.is_at_dead_centre | ~(error <= MAX_SINGULAR_ANGLE_ERROR_RAD)
        status[is_doubtful] = Status.AT_SINGULARITY
        status[bodies.is_out_of_reach] = Status.OUT_OF_REACH
        # There is one body now. Its axes are replaced by those of the ground, link 0. The
        # operator @ returns wrong numbers for stacks of quad matrices, so it is not used.
        ground_from_body = transpose_matrices(bodies.body_from_link[0])
        rotations = [
            multiply_matrices(ground_from_body, bodies.body_from_link[link])
            for link in range(len(bodies.body_from_link))
        ]
        return QuadConfigurations(
            values=values,
            error=error,
            status=status,
            exact_values=bodies.values,
            rotations=np.stack(rotations, axis=1),
        )

    def _place_input_bodies(self, q: Floats) -> _Bodies:
        """Return the bodies at the given inputs, before any group of links is placed.

        A body is a set of links with known relative orientations. Links that input pairs
        join are one body, because the inputs q (n, inputs), in rad, fix their relative
        orientations. Any other link is a body on its own. All numbers are in quad precision
        (33 digits).
        """
        n = len(q)
        mechanism = self.mechanism
        quad_type = quad()
        values = np.full((n, len(mechanism.variable_owners)), np.nan).astype(quad_type)
        # All pairs are revolute, with one variable each.
        for pair, input_values in zip(self.assembly.inputs, q.T, strict=True):
            (variable,) = mechanism.variables_of(pair)
            values[:, variable] = input_values.astype(quad_type)
        return _Bodies(
            body_from_link=self._orient_links_in_bodies(values),
            values=values,
            # Bound (rad) of the error of the rotations, if the inputs are exact.
            error=np.full(n, ROUNDING_RAD),
            # Bound (rad) of the rounding errors of the inputs. A user may mean decimal
            # numbers, and the inputs are these numbers rounded to float64. Near a dead
            # centre the rounding decides whether the loops close.
            rounding=INPUT_ROUNDING * np.maximum(1.0, np.max(np.abs(q), axis=1)),
            is_out_of_reach=np.zeros(n, dtype=bool),
            is_at_dead_centre=np.zeros(n, dtype=bool),
        )

    def _orient_links_in_bodies(self, values: Array) -> dict[int, Array]:
        """Return the orientation of each link relative to the body to which it belongs.

        Links that input pairs join form a body. The axes of the body are those of one of
        its links. Each other link is reached from there through input pairs with known
        angles.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad) in quad precision. Only inputs are read.

        Returns
        -------
        For each link the rotation (n, 3, 3) from its axes to those of its body, in quad
        precision.
        """
        mechanism = self.mechanism
        identity = np.broadcast_to(np.eye(3).astype(quad()), (len(values), 3, 3))
        # Each body has the axes of one of its links, which keeps the identity.
        body_from_link = dict.fromkeys(range(len(mechanism.links)), identity)
        # The body of each link. As indices of links, these are the links with body axes.
        links_with_body_axes = self.assembly.body_of_link
        # From there, each input pair leads from an oriented link (parent) to the next one
        # (child).
        branches = find_spanning_tree(
            mechanism.ends, start=links_with_body_axes, pairs=self.assembly.inputs
        )
        for pair, parent, child in branches:
            first_from_second = self._rotation_in_pair(pair, values)
            first_link, _second_link = mechanism.ends[pair]
            if parent == first_link:
                parent_from_child = first_from_second
            else:
                parent_from_child = transpose_matrices(first_from_second)
            body_from_link[child] = multiply_matrices(
                body_from_link[parent], parent_from_child
            )
        return body_from_link

    def _rotation_in_pair(self, pair: int, values: Array) -> Array:
        """Return the rotation (n, 3, 3) from the second link of an R pair to its first.

        The rotation is F_first Z(angle) F_second^T. F are the frames of the pair in the
        axes of the two links, with the pair axis as z axis, and Z is the rotation about z.
        The angles are in `values` (n, variables), in rad.
        """
        first_frame, second_frame = self.frames[pair]
        (variable,) = self.mechanism.variables_of(pair)
        rotated_frame = multiply_matrices(first_frame, rotate_about_z(values[:, variable]))
        return multiply_matrices(rotated_frame, second_frame.T)

    def _pair_frames(self, bodies: _Bodies, pair: int) -> PairFrames:
        """Return the frames of a pair in the axes of its two bodies."""
        first_link, second_link = self.mechanism.ends[pair]
        first_frame, second_frame = self.frames[pair]
        return PairFrames(
            multiply_matrices(bodies.body_from_link[first_link], first_frame),
            multiply_matrices(bodies.body_from_link[second_link], second_frame),
        )

    def _place_dyad(self, bodies: _Bodies, group: Group, sign: int) -> None:
        """Place the two free bodies of a dyad, and unite them with the first body.

        A dyad has three R pairs: outer pairs join two free bodies to the first body, and
        the middle pair joins these to each other. b is the middle axis, a and c are the
        outer axes, and t is their triple product, zero at the dead centre.

        `bodies` is updated in place: rotations, variables, error bound, and whether the
        dyad is out of reach or at its dead centre.

        Parameters
        ----------
        bodies
            The bodies so far. Body 0 of the group carries the outer axes.
        group
            The dyad.
        sign
            Sign of the triple product of the axes in the order of the pairs of the group.
        """
        # Positions of the pairs in the group; outer pairs join bodies 1 and 2 to body 0.
        outer_1, middle, outer_2 = group.dyad_positions

        def pair_axis(position: int, body: int) -> Array:
            """Return the axis (n, 3) of a pair of the group, in one of its bodies."""
            side = group.ends[position].index(body)
            pair = group.pairs[position]
            link = self.mechanism.ends[pair][side]
            return matrix_vector_products(
                bodies.body_from_link[link], self.frames[pair][side][:, 2]
            )

        a = pair_axis(outer_1, 0)
        c = pair_axis(outer_2, 0)
        # Outer and middle axis in the axes of each free body, and their arc, by its half.
        arc_axes = [
            (pair_axis(outer_1, 1), pair_axis(middle, 1)),
            (pair_axis(outer_2, 2), pair_axis(middle, 2)),
        ]
        half_arcs = [
            HalfAngle(0.5 * np.sqrt(dot(p - m, p - m)), 0.5 * np.sqrt(dot(p + m, p + m)))
            for p, m in arc_axes
        ]
        sum_square = dot(a + c, a + c)
        difference_square = dot(a - c, a - c)
        # The triple product t of the axes a, b, c is computed by its square. With the arcs
        # A and C of the bodies this is a product of two differences of cosines:
        # t^2 = (cos(A - C) - a . c) (a . c - cos(A + C)).
        outer_sine = 0.5 * np.sqrt((sum_square * difference_square).astype(float))
        arcs = half_arcs[0] - half_arcs[1], half_arcs[0] + half_arcs[1]
        factors = [_cosine_difference(arc, sum_square, difference_square) for arc in arcs]
        sizes = [np.abs(factor.astype(float)) for factor in factors]
        triple_square = -factors[0] * factors[1]
        size = triple_square.astype(float)

        def square_error_bound(error: Floats) -> Floats:
            """Return a bound (n,) of the error of `triple_square`.

            `error` (n,) are the errors (rad) of the axes.
            """
            first, second = (
                4.0 * error * (outer_sine + error + np.abs(_sine_of_arc(arc)))
                for arc in arcs
            )
            return sizes[0] * second + sizes[1] * first + first * second

        # A negative t^2 means that the arcs do not close. The rounding of the inputs counts
        # for `is_out_of_reach` and `is_at_dead_centre`, but not for t itself, since the
        # inputs are used as they are.
        error_with_rounding = np.maximum(bodies.error, bodies.rounding)
        bodies.is_out_of_reach |= size < -square_error_bound(error_with_rounding)
        is_at_dead_centre = np.abs(size) <= square_error_bound(error_with_rounding)
        bodies.is_at_dead_centre |= is_at_dead_centre
        triple_product = np.sqrt(
            np.where(
                size > square_error_bound(bodies.error), triple_square, 0.0 * triple_square
            )
        )
        triple_product = triple_product * (group.dyad_parity * sign)
        sum_factor, difference_factor, normal_factor = middle_axis(
            half_arcs[0], half_arcs[1], sum_square, difference_square, triple_product
        )
        b = sum_factor[:, None] * (a + c) + difference_factor[:, None] * (a - c)
        b = b + normal_factor[:, None] * np.cross(a, c)
        # The rotation of a free body takes its outer and middle axis to those in body 0.
        body_rotations = []
        for outer_axis, (p, m) in zip((a, c), arc_axes, strict=True):
            frame_in_base = make_frame(outer_axis, normalize(np.cross(outer_axis, b)))
            frame_in_body = make_frame(p, normalize(np.cross(p, m)))
            body_rotations.append(
                multiply_matrices(frame_in_base, transpose_matrices(frame_in_body))
            )
        sines = [*map(_sine_of_arc, half_arcs), outer_sine]
        error = np.where(is_at_dead_centre, error_with_rounding, bodies.error)
        bodies.error = _dyad_error(
            error, np.sqrt(np.where(is_at_dead_centre, 0.0, size)), sines
        )
        # A carrier that moves by r turns the free bodies by up to r max(sin A, sin C) / t.
        # Later groups then have other outer axes.
        amplification = 1.0 + np.maximum(sines[0], sines[1]) / np.sqrt(np.abs(size))
        bodies.rounding = np.where(
            is_at_dead_centre, bodies.rounding, amplification * bodies.rounding
        )
        bodies.merge(group, body_rotations)
        # The variable of a pair is the angle about its axis from one frame to the other.
        for pair in group.pairs:
            first_frame, second_frame = self._pair_frames(bodies, pair)
            x_of_second = second_frame[..., 0]
            cosine = dot(first_frame[..., 0], x_of_second)
            sine = dot(first_frame[..., 1], x_of_second)
            variable = self.mechanism.variables_of(pair)[0]
            bodies.values[:, variable] = np.arctan2(sine, cosine)

    def _close_group(
        self, bodies: _Bodies, group: Group, determinant_sign: float, starts: Floats
    ) -> None:
        """Close the loops of a group that is not a dyad, and unite its bodies.

        `bodies` is updated: rotations, variables, error bound, and whether the group is out
        of reach or at a dead centre. A fold is a dead centre, where two configurations of
        the group meet. At the distance x from the fold, the loops are open by
        e + h x^2 / 2, with the residual e and the curvature h. If e and h have the same
        sign, this has no root, and the group does not close.

        Parameters
        ----------
        bodies
            The bodies so far.
        group
            An irreducible group.
        determinant_sign
            Sign of the determinant of its Jacobian in the assembly mode, 0 if not known.
        starts
            (n, variables) float64 configurations (rad) of the mechanism, from which
            Newton's method starts.
        """
        group_variables = [self.mechanism.variables_of(pair)[0] for pair in group.pairs]
        loops = GroupLoops(group, [self._pair_frames(bodies, pair) for pair in group.pairs])
        start = starts[:, group_variables].astype(quad())
        fold = loops.find_fold(start)
        # Bound of the angle by which the errors of earlier bodies, and the rounding of the
        # inputs, open the loops. In each of the three components of a loop, the errors of
        # all pairs and inputs are added. Over the components, the root of the sum of
        # squares is taken.
        loop_scale = np.sqrt(3.0 * group.loops)
        tolerance = loop_scale * (
            len(group.pairs) * bodies.error + len(self.assembly.inputs) * bodies.rounding
        )
        # Within this bound, e is zero (the group is at its fold, and flat), or has the sign
        # of h (there is no root).
        is_flat = fold.is_known & (np.abs(fold.residual) <= tolerance)
        has_no_root = fold.residual * np.sign(fold.curvature) > tolerance
        is_out_of_reach = fold.is_known & has_no_root

        # Newton's method starts from a root of the quadratic, which is on the side of the
        # fold that belongs to the assembly mode.
        root = fold.estimate_root(loops, start, determinant_sign)
        values, step_size = loops.close(np.where(fold.is_known[:, None], root, start))
        jacobian = loops.evaluate(values).jacobian
        finite_jacobian = np.nan_to_num(jacobian)
        is_other_mode = np.linalg.slogdet(finite_jacobian)[0] * determinant_sign < 0.0
        smallest = np.linalg.svd(finite_jacobian, compute_uv=False)[:, -1]
        # At a distance s^2 of the input from a dead centre, the smallest singular value is
        # about s. Without a known fold, its square is compared with the rounding.
        is_doubtful = ~fold.is_known & (smallest**2 <= 8.0 * bodies.rounding)
        is_near_start = largest_change(values, start) < NEAREST_START_RAD
        is_regular = (step_size <= CONVERGED_QUAD_STEP_RAD) & is_near_start & ~is_other_mode
        is_regular &= ~is_flat & ~is_out_of_reach & ~is_doubtful

        amplification = 4.0 * np.linalg.norm(left_inverse(jacobian), axis=(1, 2))
        error = np.where(is_regular, amplification * bodies.error, np.inf)
        bodies.rounding = np.where(
            is_regular, amplification * bodies.rounding, bodies.rounding
        )
        # Both roots are within this distance of the fold.
        fold_error = FOLD_SAFETY * np.sqrt(2.0 * tolerance / np.abs(fold.curvature))
        bodies.error = np.where(is_flat, fold_error, error)
        bodies.is_at_dead_centre |= ~is_regular
        bodies.is_out_of_reach |= is_out_of_reach
        values = np.where(is_flat[:, None], fold.values, values)
        rotations = loops.evaluate(values).rotations
        bodies.merge(group, rotations[1:])
        bodies.values[:, group_variables] = values


def _cosine_difference(
    arc: HalfAngle, sum_square: Array, difference_square: Array
) -> Array:
    """Return cos(arc) - a . c for two unit vectors a and c, the outer axes of a dyad.

    The outer axes belong to the pairs that join the dyad to the first body. The caller
    needs the difference for two arcs. The product of both is minus the square of the triple
    product of the three axes of the dyad.

    Near an arc of 0 or 180 deg, a cosine has few digits of its small distance from 1 or -1.
    The small distances are therefore computed and subtracted.

    Parameters
    ----------
    arc
        Sine and cosine (n,) of half the arc.
    sum_square, difference_square
        (n,) squares |a + c|^2 and |a - c|^2 of the sum and the difference of the axes.
    """
    # Distances from 1: 1 - a . c and 1 - cos(arc).
    axes_below_one = 0.5 * difference_square
    arc_below_one = 2.0 * (arc.sine * arc.sine)
    # Distances from -1: 1 + cos(arc) and 1 + a . c.
    arc_above_minus_one = 2.0 * (arc.cosine * arc.cosine)
    axes_above_minus_one = 0.5 * sum_square
    is_arc_below_90_deg = np.abs(arc.sine) < np.abs(arc.cosine)
    return np.where(
        is_arc_below_90_deg,
        axes_below_one - arc_below_one,
        arc_above_minus_one - axes_above_minus_one,
    )


def _sine_of_arc(arc: HalfAngle) -> Floats:
    """Return the sine (n,) of an arc that is given by its half, in float64."""
    return np.asarray(2.0 * arc.sine * arc.cosine).astype(float)


def _dyad_error(error: Floats, triple: Floats, sines: Sequence[Floats]) -> Floats:
    """Return a bound (n,) of the error (rad) of the orientations of a dyad's two bodies.

    A dyad is two bodies, which a middle pair joins to each other. Two outer pairs join them
    to a third body, the carrier, which has been placed before. The dyad is placed relative
    to the carrier, so the bound is the sum of two errors: that of the carrier and that of
    the dyad's angles. For the angles, the smaller one of two bounds is taken. The regular
    bound is small away from the dead centre and infinite at it. The flat bound is also
    finite at the dead centre, where the dyad is flat. An infinite result means unknown.

    Parameters
    ----------
    error
        (n,) error bound (rad) of the orientation of the carrier.
    triple
        (n,) absolute triple product of the three axes of the dyad; 0 at the dead centre.
    sines
        Three arrays (n,), the sines of three angles. The first two are the arcs of the
        bodies: the angles between the outer and the middle axis of each body. The third one
        is the angle between both outer axes.
    """
    regular_error = _regular_angle_error(error, triple)
    flat_error = _flat_angle_error(error, np.minimum.reduce(sines))
    # `fmin` ignores a bound that is NaN. The factor 4 covers neglected terms.
    return 4.0 * (error + np.fmin(regular_error, flat_error))


def _regular_angle_error(error: Floats, triple: Floats) -> Floats:
    """Return a bound (n,) of the error of the angles of a dyad that is not flat.

    A dyad consists of two links joined by a pair. Its three axes have errors of up to
    `error` (n,). The angles then have errors of up to `error` over the determinant of the
    velocity equations, `triple` (n,). This is the triple product of the axes. The product
    is 0 at the dead centre, where the dyad is flat and the bound is infinite.
    """
    return np.where(triple > 0.0, error / triple, np.inf)


def _flat_angle_error(error: Floats, smallest_sine: Floats) -> Floats:
    """Return a bound (n,) of the error of the angles of a dyad at its dead centre.

    The three axes of a dyad form a spherical triangle, which is flat at the dead centre. If
    its angles then change by x, an arc changes by s^2 x^2 / 2 at least, where s is the
    smallest sine of its arcs. Arcs with an error e thus allow x up to sqrt(2 e) / s.

    The formula is valid for small x only. Larger bounds are therefore replaced by infinity.
    """
    bound = np.where(smallest_sine > 0.0, np.sqrt(2.0 * error) / smallest_sine, np.inf)
    return np.where(bound < LARGEST_FLAT_DYAD_ERROR_RAD, bound, np.inf)
