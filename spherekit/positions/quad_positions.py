"""Computes configurations near dead centres in quad precision.

At a distance d (rad, in the pair variables) from a dead centre, the error of a
configuration is the rounding error of the geometry divided by d. Within 1e-8 rad, float64
has no correct digit of d, and it does not even show whether the loops close. Two things are
different in this module. The links have the decimal sizes of the file, 64.02 degrees for
example, and not the nearest float64 numbers. All computations have 33 digits.

The groups of the mechanism are placed one after another. A dyad is placed by the closed
form of `spherekit.geometry.dyad_axis`, any other group by Newton's method. Near a dead
centre of such a group, the residual at its fold tells whether the group closes, and from
where Newton's method starts. A bound of the error of the placed bodies is updated with each
group, to first order. Mechanisms with contacts, or with redundant equations, are not
supported, see `spherekit.positions.fold_bounds`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.files.mechanism_writer import canonical_text
from spherekit.files.toml_document import Document, LiteralNumber, parse
from spherekit.geometry.dyad_axis import HalfAngle, middle_axis
from spherekit.geometry.vectors import dot
from spherekit.mechanism.elements import LinkSizes, PoseGeometry
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes
from spherekit.numerics.quad_precision import QUAD_EPS, quad, quad_pi
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_tree import LoopTree
from spherekit.status import Status
from spherekit.tolerances import EPS

ROUNDING_RAD = 1e3 * QUAD_EPS
"""Error bound of a body that is placed by inputs alone: some hundred rounding errors in
quad."""
INPUT_ROUNDING = 2.0 * EPS
"""Rounding error of an input, relative to the input or to 1 rad, whichever is larger. An
input that is nearer to a dead centre is taken to be at it. The float64 number can stand for
a decimal number of degrees, as that of pi for 180 degrees."""
LARGEST_ANGLE_ERROR_RAD = 1e-5
"""Configurations with a larger error bound have the status AT_SINGULARITY, and
`PositionSolver.evaluate` returns NaN for their variables."""
MAX_NEWTON_STEPS = 40
"""Newton steps for one group. A step gains about 16 digits at most, since the Jacobian is
inverted in float64, and few near a dead centre."""
MAX_FOLD_STEPS = 6
"""Newton steps to the fold of a group. Each gains about eight digits."""
FOLD_PROBE_RAD = 1e-4
"""The step over which the curvature at a fold is measured."""
FOLD_STEP_RAD = 1e-12
"""The fold is found if the last step is smaller. Its residual is then known to the square
of this."""
LEAST_SECOND_SINGULAR_VALUE = 1e-4
"""At a fold, the second smallest singular value is larger than this part of the largest.
Smaller: a second fold nearby can be missed."""
LEAST_CURVATURE = 1e-3
"""Smaller curvatures (1/rad) of f are not told from those of third order."""
FOLD_SAFETY = 2.0
"""Error bounds at a fold are enlarged by this factor, for terms of third order."""
LARGEST_NEWTON_STEP_RAD = 0.1
"""Newton's method is given up if a step is larger."""
CLOSED_STEP_RAD = 1e-27
"""Newton's method has converged to a simple root if its last step is smaller."""
NEAREST_START_RAD = 1e-3
"""A solution that differs by more from the float64 values belongs to another
configuration."""

Frames = tuple[Array, Array]
"""Frames (3, 3) of a pair in its first and its second link, in quad precision.

The columns of a frame are unit vectors in the axes of the link. The last one is the pair
axis. ``R_first @ first @ Z(angle) == R_second @ second`` for orientations R of the links,
where Z is a rotation about z by the pair variable.
"""


class Placed(NamedTuple):
    """Configurations of a mechanism at n rows of its inputs.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad) in float64.
    error
        (n,) bound of the error of `values` (rad) by the decimal sizes, with their rounding
        to float64. Infinite if they are not reliable.
    status
        (n,) OK; OUT_OF_REACH if a group does not close for any input within its rounding;
        AT_SINGULARITY if a group is at its dead centre within the rounding of the inputs,
        or if the error bound is too large.
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


def decimal_frames(mechanism: Mechanism) -> dict[int, Frames]:
    """Return the frames of all pairs, computed from the decimal numbers of the file.

    The mechanism is written as a file in degrees and read again, which restores the
    decimals.

    Returns
    -------
    dict from the number of a pair to its two frames.
    """
    document = parse(canonical_text(mechanism, "deg"), mechanism.name)
    geometry = mechanism.geometry
    frames: dict[int, Frames] = {}
    if isinstance(geometry, PoseGeometry):
        values = _angles_of_pairs(document, "value")
        for name, axis in geometry.axes.items():
            # In the reference pose both links of a pair have the same axes. The frames
            # differ by the value of the variable there.
            exact_axis = _normalize(_parse_decimals([repr(float(x)) for x in axis]))
            first = _frame_without_reference(exact_axis, np.array(axis, dtype=float))
            second = first
            if name in values:
                second = product(first, _rotate_about_z(values[name]))
            frames[mechanism.pair_number[name]] = first, second
        return frames
    float_axes = {link: axes_from_sizes(sizes) for link, sizes in geometry.links.items()}
    axes = {}
    for link, sizes in geometry.links.items():
        item = document.data["links"][link]
        arcs, angles = (
            tuple(_degrees_to_radians(number) for number in item.get(key, ()))
            for key in ("arcs", "angles")
        )
        exact_sizes = LinkSizes(sizes.axes, arcs, angles)
        axes[link] = {
            name: np.asarray(axis, dtype=quad())
            for name, axis in axes_from_sizes(exact_sizes).items()
        }
    zeros = _angles_of_pairs(document, "zero")
    for number, pair in enumerate(mechanism.pairs):
        first, second = (
            _reference_frame(axes[link], float_axes[link], pair.name) for link in pair.links
        )
        if pair.name in zeros:
            first = product(first, _rotate_about_z(zeros[pair.name]))
        frames[number] = first, second
    return frames


def _parse_decimals(texts: Sequence[str]) -> Array:
    """Return decimal numbers (k,) in quad precision, from k texts.

    Underscores between digits are removed, which quad numbers do not accept.
    """
    return np.array([text.replace("_", "") for text in texts]).astype(quad())


def _degrees_to_radians(number: float) -> Any:
    """Return an angle in rad, in quad precision, from a number of a file in degrees.

    A `LiteralNumber` has the text of the file. Other numbers are taken as Python writes
    them.
    """
    text = number.text if isinstance(number, LiteralNumber) else repr(number)
    return _parse_decimals([text])[0] * (quad_pi() / 180)


def _angles_of_pairs(document: Document, key: str) -> dict[str, Any]:
    """Return an angle (rad, quad precision) of each pair that has this key in the file.

    The key is "value" or "zero". The result maps names of pairs to angles.
    """
    pairs: Mapping[str, Any] = document.data["pairs"]
    return {
        name: _degrees_to_radians(item[key]) for name, item in pairs.items() if key in item
    }


def _reference_frame(
    axes: Mapping[str, Array], float_axes: Mapping[str, Floats], name: str
) -> Array:
    """Return the frame (3, 3) of an axis of a link, in quad precision.

    The x axis of the frame points towards the first other axis of the link that is not
    collinear with this one.

    Parameters
    ----------
    axes, float_axes
        Unit vectors (3,) of the axes of the link by name of pair, in quad precision and in
        float64. The latter decide which axes are collinear, as in the float64 computations.
    name
        Name of the pair whose frame is computed.
    """
    axis = axes[name]
    for other, direction in axes.items():
        sine = np.linalg.norm(np.cross(float_axes[name], float_axes[other]))
        if sine > COLLINEAR_SINE:
            return _frame(
                axis, _normalize(direction - dot(axis, direction)[..., None] * axis)
            )
    return _frame_without_reference(axis, float_axes[name])


def _frame_without_reference(axis: Array, float_axis: Floats) -> Array:
    """Return the frame (3, 3) of an axis (3,) if no other axis fixes its x axis.

    The x axis is perpendicular to the coordinate axis that differs most from the axis.
    """
    helper = np.eye(3)[np.argmin(np.abs(float_axis))].astype(quad())
    return _frame(axis, _normalize(np.cross(axis, helper)))


def _frame(axis: Array, first: Array) -> Array:
    """Return frames (..., 3, 3) from their z axes and x axes (..., 3).

    `axis` is z and `first` is x. Both are unit vectors at right angles.
    """
    return np.stack([first, np.cross(axis, first), axis], axis=-1)


def _normalize(a: Array) -> Array:
    """Return unit vectors along vectors (..., 3)."""
    return a / np.sqrt(dot(a, a))[..., None]


def _rotate_about_z(angle: Array) -> Array:
    """Return rotations (..., 3, 3) about z by angles (...) rad in quad precision."""
    angle = np.asarray(angle, dtype=quad())
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rows = [
        [cosine, -sine, zero],
        [sine, cosine, zero],
        [zero, zero, zero + 1],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def product(a: Array, b: Array) -> Array:
    """Return matrix products of matrices (..., 3, 3).

    The operator @ of numpy-quaddtype 1.0 returns wrong numbers for stacks of matrices.
    """
    return np.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def rotated(a: Array, vector: Array) -> Array:
    """Return products of matrices (..., k, 3) with vectors (..., 3)."""
    return np.sum(a * vector[..., None, :], axis=-1)


def _transpose(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)


@dataclass
class _Bodies:
    """The bodies of a mechanism at n rows of inputs, while its groups are placed.

    A body is a set of links whose relative orientations are known already. At the end there
    is one body.

    Attributes
    ----------
    within
        (n, 3, 3) for each link: rotations from its axes to those of its body, in quad
        precision.
    values
        (n, variables) pair variables (rad) in quad precision, NaN as long as they are
        unknown.
    error
        (n,) bound of the error (rad) of the rotations if the inputs are exact.
    rounding
        (n,) rounding error (rad) of the inputs.
    is_out_of_reach
        (n,) whether a group closes for no input within this rounding error.
    is_at_dead_centre
        (n,) whether a group is at its dead centre for an input within this rounding error,
        or whether its configuration is not reliable.
    """

    within: dict[int, Array]
    values: Array
    error: Floats
    rounding: Floats
    is_out_of_reach: Bools
    is_at_dead_centre: Bools


class QuadAssembly:
    """Places the groups of a mechanism of R pairs in quad precision.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly
        Its inputs, and its groups in solving order.
    """

    def __init__(self, mechanism: Mechanism, assembly: Assembly) -> None:
        self.mechanism, self.assembly = mechanism, assembly

    @property
    def is_supported(self) -> bool:
        """Whether all pairs are R pairs, and no group has redundant equations."""
        has_only_axes = all(pair.kind.has_axis for pair in self.mechanism.pairs)
        redundant = any(group.redundant for group in self.assembly.groups)
        return has_only_axes and not redundant

    @cached_property
    def frames(self) -> dict[int, Frames]:
        """The frames of each pair, by its number, from the decimal numbers of the file."""
        return decimal_frames(self.mechanism)

    def place(
        self,
        signs: Sequence[int],
        determinants: Sequence[float],
        q: Floats,
        starts: Floats,
    ) -> Placed:
        """Return the configurations of an assembly mode at given inputs.

        Parameters
        ----------
        signs
            Sign of each group in the assembly mode: 1 or -1 for a dyad, 0 for other groups.
        determinants
            Sign of the determinant of each group in the mode, or empty if not known.
        q
            (n, inputs) values of the inputs (rad). They are used exactly as the float64
            numbers are.
        starts
            (n, variables) float64 configurations (rad), from which Newton's method starts
            for groups that are not dyads.

        Returns
        -------
        Configurations with their status and error bounds.
        """
        with np.errstate(all="ignore"):
            bodies = self._place_input_bodies(q)
            for number, sign in enumerate(signs):
                group = self.assembly.groups[number]
                if sign:
                    self._place_dyad(bodies, group, sign)
                else:
                    determinant = determinants[number] if determinants else 0.0
                    self._close_group(bodies, group, determinant, starts)
            values = bodies.values.astype(float)
        # The rounding to float64, and that of bringing angles into one turn.
        error = 4.0 * EPS + bodies.error
        error = np.where(np.all(np.isfinite(values), axis=1), error, np.inf)
        status = np.full(len(q), Status.OK, dtype=np.int8)
        status[bodies.is_at_dead_centre | ~(error <= LARGEST_ANGLE_ERROR_RAD)] = (
            Status.AT_SINGULARITY
        )
        status[bodies.is_out_of_reach] = Status.OUT_OF_REACH
        ground = _transpose(bodies.within[0])
        rotations = [
            product(ground, bodies.within[link]) for link in range(len(bodies.within))
        ]
        placed = np.stack(rotations, axis=1)
        return Placed(values, error, status, bodies.values, placed)

    def _place_input_bodies(self, q: Floats) -> _Bodies:
        """Return the bodies before any group is placed.

        Links that input pairs join are one body, because the inputs q (n, inputs), in rad,
        fix their relative orientations.
        """
        n, mechanism = len(q), self.mechanism
        identity = np.broadcast_to(np.eye(3).astype(quad()), (n, 3, 3))
        within = dict.fromkeys(range(len(mechanism.links)), identity)
        values = np.full((n, len(mechanism.variable_owners)), np.nan).astype(quad())
        for pair, input_values in zip(self.assembly.inputs, q.T, strict=True):
            values[:, mechanism.variables_of(pair)[0]] = input_values.astype(quad())
        tree_steps = find_spanning_tree(
            mechanism.ends, self.assembly.bodies, self.assembly.inputs
        )
        for pair, parent, child in tree_steps:
            first, second = self.frames[pair]
            angle = values[:, mechanism.variables_of(pair)[0]]
            rotation = product(product(first, _rotate_about_z(angle)), second.T)
            ahead = mechanism.ends[pair][0] == parent
            within[child] = product(
                within[parent], rotation if ahead else _transpose(rotation)
            )
        all_false = np.zeros((2, n), dtype=bool)
        rounding = INPUT_ROUNDING * np.maximum(1.0, np.max(np.abs(q), axis=1))
        error = np.full(n, ROUNDING_RAD)
        return _Bodies(within, values, error, rounding, all_false[0], all_false[1])

    def _axis(self, bodies: _Bodies, pair: int, side: int) -> Array:
        """Return the axis (n, 3) of a pair in the axes of the body of one of its links.

        `side` is 0 for the first link of the pair, and 1 for the second.
        """
        link = self.mechanism.ends[pair][side]
        return rotated(bodies.within[link], self.frames[pair][side][:, 2])

    def _place_dyad(self, bodies: _Bodies, group: Group, sign: int) -> None:
        """Place the two free bodies of a dyad, and unite them with the first body.

        The symbols a, b, c and t are those of `spherekit.geometry.dyad_axis`: b is the
        middle axis, a and c are the outer axes, and t is the triple product. `bodies` is
        updated: rotations, variables, error bound and the two flags.

        Parameters
        ----------
        bodies
            The bodies so far. Body 0 of the group carries the outer axes.
        group
            The dyad.
        sign
            Sign of the triple product of the axes in the order of the pairs of the group.
        """
        near, middle, far = group.dyad_positions

        def axis(place: int, body: int) -> Array:
            side = group.ends[place].index(body)
            # axis of the pair at a position of the group, in one of the bodies of the group
            return self._axis(bodies, group.pairs[place], side)

        a, c = axis(near, 0), axis(far, 0)
        # Outer and middle axis in the axes of each free body, and their arc, by its half.
        arc_axes = (axis(near, 1), axis(middle, 1)), (axis(far, 2), axis(middle, 2))
        half_arcs = [
            HalfAngle(0.5 * np.sqrt(dot(p - m, p - m)), 0.5 * np.sqrt(dot(p + m, p + m)))
            for p, m in arc_axes
        ]
        sum_square, difference_square = dot(a + c, a + c), dot(a - c, a - c)
        # t^2 is a product of two differences of cosines: t^2 = (cos(A - C) - a . c) (a . c
        # - cos(A + C)), with the arcs A and C of the bodies.
        outer_sine = 0.5 * np.sqrt((sum_square * difference_square).astype(float))
        arcs = half_arcs[0] - half_arcs[1], half_arcs[0] + half_arcs[1]
        factors = [_cosine_difference(arc, sum_square, difference_square) for arc in arcs]
        sizes = [np.abs(factor.astype(float)) for factor in factors]
        triple_square = -factors[0] * factors[1]
        size = triple_square.astype(float)

        def square_error_bound(error: Floats) -> Floats:
            """Return a bound (n,) of the error of t^2 if axes have an error (n,) in rad."""
            first, second = (
                4.0 * error * (outer_sine + error + np.abs(_sine_of_arc(arc)))
                for arc in arcs
            )
            return sizes[0] * second + sizes[1] * first + first * second

        # A negative t^2 means that the arcs do not close. The rounding of the inputs counts
        # for the flags, but not for t itself, since the inputs are used as they are.
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
        body_rotations = [
            product(
                _frame(outer, _normalize(np.cross(outer, b))),
                _transpose(_frame(p, _normalize(np.cross(p, m)))),
            )
            for outer, (p, m) in zip((a, c), arc_axes, strict=True)
        ]
        sines = [*map(_sine_of_arc, half_arcs), outer_sine]
        error = np.where(is_at_dead_centre, error_with_rounding, bodies.error)
        bodies.error = _dyad_error(
            error, np.sqrt(np.where(is_at_dead_centre, 0.0, size)), sines
        )
        self._unite_bodies(bodies, group, body_rotations)
        # The variable of a pair is the angle about its axis from one frame to the other.
        for pair in group.pairs:
            first_frame, other = (
                product(bodies.within[link], frame)
                for link, frame in zip(
                    self.mechanism.ends[pair], self.frames[pair], strict=True
                )
            )
            cosine, sine = (dot(first_frame[..., k], other[..., 0]) for k in (0, 1))
            variable = self.mechanism.variables_of(pair)[0]
            bodies.values[:, variable] = np.arctan2(sine, cosine)

    @staticmethod
    def _unite_bodies(
        bodies: _Bodies, group: Group, body_rotations: Sequence[Array]
    ) -> None:
        """Unite the bodies of a group, in place.

        `body_rotations` are rotations (n, 3, 3) of all bodies but the first, from their
        axes to those of the first.
        """
        for links, rotation in zip(group.bodies[1:], body_rotations, strict=True):
            for link in links:
                bodies.within[link] = product(rotation, bodies.within[link])

    def _close_group(
        self, bodies: _Bodies, group: Group, determinant: float, starts: Floats
    ) -> None:
        """Close the loops of a group that is not a dyad, and unite its bodies.

        `bodies` is updated: rotations, variables, error bound and the two flags. Near a
        dead centre, the sign of the residual at the fold tells whether the group closes.

        Parameters
        ----------
        bodies
            The bodies so far.
        group
            An irreducible group.
        determinant
            Sign of the determinant of its Jacobian in the assembly mode, 0 if not known.
        starts
            (n, variables) float64 configurations (rad) of the mechanism, from which
            Newton's method starts.
        """
        group_variables = [self.mechanism.variables_of(pair)[0] for pair in group.pairs]
        loops = _GroupLoops(self, bodies, group)
        start = starts[:, group_variables].astype(quad())
        fold = loops.find_fold(start)
        # By how much the errors of earlier bodies, and the rounding of the inputs, open the
        # loops in the direction of the residual of the fold.
        loop_scale = np.sqrt(3.0 * group.loops)
        tolerance = loop_scale * (
            len(group.pairs) * bodies.error + len(self.assembly.inputs) * bodies.rounding
        )
        is_flat = fold.is_known & (np.abs(fold.residual) <= tolerance)
        has_no_root = fold.residual * np.sign(fold.curvature) > tolerance
        is_out_of_reach = fold.is_known & has_no_root

        # Newton's method starts from a root of the quadratic, which is on the side of the
        # fold that belongs to the assembly mode.
        root = fold.estimate_root(loops, start, determinant)
        x, size = loops.close(np.where(fold.is_known[:, None], root, start))
        jacobian = np.nan_to_num(loops.at(x)[2])
        is_other_mode = np.linalg.slogdet(jacobian)[0] * determinant < 0.0
        least = np.linalg.svd(jacobian, compute_uv=False)[:, -1]
        # At a distance s^2 of the input from a dead centre, the smallest singular value is
        # about s. Without a known fold, its square is compared with the rounding.
        is_doubtful = ~fold.is_known & (least**2 <= 8.0 * bodies.rounding)
        is_near = _largest_change(x, start) < NEAREST_START_RAD
        is_regular = (size <= CLOSED_STEP_RAD) & is_near & ~is_other_mode
        is_regular &= ~is_flat & ~is_out_of_reach & ~is_doubtful

        sensitivity = np.linalg.norm(left_inverse(loops.at(x)[2]), axis=(1, 2))
        error = np.where(is_regular, 4.0 * bodies.error * sensitivity, np.inf)
        # Both roots are within this distance of the fold.
        fold_error = FOLD_SAFETY * np.sqrt(2.0 * tolerance / np.abs(fold.curvature))
        bodies.error = np.where(is_flat, fold_error, error)
        bodies.is_at_dead_centre |= ~is_regular
        bodies.is_out_of_reach |= is_out_of_reach
        x = np.where(is_flat[:, None], fold.values, x)
        body_rotations = loops.at(x)[0]
        self._unite_bodies(bodies, group, body_rotations[1:])
        bodies.values[:, group_variables] = x


@dataclass(frozen=True)
class _Fold:
    """The fold of a group near given variables, at n rows.

    Along the right singular vector v of the smallest singular value of the Jacobian, loops
    open by f(x) = e + h x^2 / 2 in the direction of the left singular vector u, where x is
    the distance from the fold. The group closes at the roots of f.

    Attributes
    ----------
    values
        (n, pairs) variables (rad) at the fold, in quad precision.
    direction
        (n, pairs) unit vector v.
    residual, curvature
        (n,) e (rad) and h (1/rad).
    is_known
        (n,) whether there is one fold nearby. Otherwise the other numbers have no meaning.
    """

    values: Array
    direction: Floats
    residual: Floats
    curvature: Floats
    is_known: Bools

    def estimate_root(
        self, loops: "_GroupLoops", start: Array, determinant: float
    ) -> Array:
        """Estimate the root of f that belongs to an assembly mode.

        Parameters
        ----------
        loops
            The loops of the group.
        start
            (n, pairs) float64 configurations (rad).
        determinant
            Sign of the determinant of the Jacobian in the mode, 0 if not known. The root
            nearer to `start` is taken then.

        Returns
        -------
        (n, pairs) variables (rad) in quad precision; those of the fold if f has no root.
        """
        distance = np.sqrt(np.maximum(-2.0 * self.residual / self.curvature, 0.0))
        roots = [
            self.values + ((side * distance)[:, None] * self.direction).astype(quad())
            for side in (1.0, -1.0)
        ]
        if determinant:
            jacobian = np.nan_to_num(loops.at(roots[0])[2])
            is_first = np.linalg.slogdet(jacobian)[0] * determinant > 0.0
        else:
            is_first = _largest_change(roots[0], start) < _largest_change(roots[1], start)
        return np.where(is_first[:, None], roots[0], roots[1])


def _largest_change(values: Array, start: Array) -> Floats:
    """Return the largest difference (n,) of any variable, in float64, from (n, pairs)."""
    return np.max(np.abs((values - start).astype(float)), axis=1)


class _GroupLoops:
    """The loop equations of one group in quad precision, at n rows.

    Variables are those of the pairs of the group, in its order, and bodies are numbered
    within the group. `pair_frames` has, for each pair, its frames (n, 3, 3) in the axes of
    its first and of its second body.
    """

    def __init__(self, assembly: QuadAssembly, bodies: _Bodies, group: Group) -> None:
        self.group = group
        self.tree = LoopTree(len(group.bodies), group.ends, tuple(range(len(group.pairs))))
        self.pair_frames = [
            tuple(
                product(bodies.within[link], frame)
                for link, frame in zip(
                    assembly.mechanism.ends[pair], assembly.frames[pair], strict=True
                )
            )
            for pair in group.pairs
        ]

    def at(self, values: Array) -> tuple[list[Array], Array, Floats]:
        """Evaluate the loop equations at variables (n, pairs), in rad.

        Returns
        -------
        bodies
            (n, 3, 3) for each body: rotations from its axes to those of body 0.
        gaps
            (n, 3 loops) rotation vector (rad, to first order) by which each loop is open.
        jacobian
            (n, 3 loops, pairs) derivatives of the gaps, in float64.
        """
        turned_frames = [
            product(frame_in_first, _rotate_about_z(values[:, k]))
            for k, (frame_in_first, _) in enumerate(self.pair_frames)
        ]
        identity = np.broadcast_to(np.eye(3).astype(quad()), (len(values), 3, 3))
        placed: dict[int, Array] = {0: identity}
        for place, parent, child in self.tree.placements:
            rotation = product(turned_frames[place], _transpose(self.pair_frames[place][1]))
            ahead = self.group.ends[place][0] == parent
            placed[child] = product(
                placed[parent], rotation if ahead else _transpose(rotation)
            )
        gaps = []
        for place in self.tree.chords:
            first, second = self.group.ends[place]
            first_frame = product(placed[first], turned_frames[place])
            other = product(placed[second], self.pair_frames[place][1])
            relative_rotation = product(first_frame, _transpose(other))
            # The skew part of a small rotation is its rotation vector.
            skew = relative_rotation - _transpose(relative_rotation)
            gaps.append(
                0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
            )
        vectors = [
            rotated(placed[first], frame_in_first[..., 2])
            for (first, _), (frame_in_first, _) in zip(
                self.group.ends, self.pair_frames, strict=True
            )
        ]
        jacobian = self.tree.jacobian(np.stack(vectors, axis=1).astype(float))
        bodies = [placed[body] for body in range(len(placed))]
        return bodies, np.concatenate(gaps, axis=1), jacobian

    def close(self, values: Array) -> tuple[Array, Floats]:
        """Close the loops by Newton's method from variables (n, pairs), in rad.

        The Jacobian is inverted in float64. The residual in quad precision decides the
        limit.

        Returns
        -------
        values
            (n, pairs) variables (rad) in quad precision.
        size
            (n,) length (rad) of the last step, the largest of any variable. Newton's method
            has converged if it is at most `CLOSED_STEP_RAD`.
        """
        n = len(values)
        values = values.copy()
        size = np.full(n, np.inf)
        active = np.ones(n, dtype=bool)
        for _ in range(MAX_NEWTON_STEPS):
            _, gaps, jacobian = self.at(values)
            inverse = left_inverse(jacobian).astype(quad())
            step = -rotated(inverse, gaps)
            length = np.max(np.abs(step.astype(float)), axis=1)
            size = np.where(active, length, size)
            active &= (length > CLOSED_STEP_RAD) & (length < LARGEST_NEWTON_STEP_RAD)
            if not np.any(active):
                break
            values[active] += step[active]
        return values, size

    def find_fold(self, values: Array) -> _Fold:
        """Find the fold near variables (n, pairs), in rad.

        There the slope of f is zero and the loops close in all other directions. Both
        conditions are solved by Newton's method.
        """
        values = values.copy()
        start = values.copy()
        is_known = np.ones(len(values), dtype=bool)
        for _ in range(MAX_FOLD_STEPS):
            _, gaps, jacobian = self.at(values)
            left, sizes, right = np.linalg.svd(np.nan_to_num(jacobian))
            direction, side = right[:, -1], left[:, :, -1]
            # The change of the Jacobian along v, by a central difference.
            jacobians = [
                self.at(values + (step * direction).astype(quad()))[2]
                for step in (FOLD_PROBE_RAD, -FOLD_PROBE_RAD)
            ]
            bend = (jacobians[0] - jacobians[1]) / (2.0 * FOLD_PROBE_RAD)
            curvature = np.vecdot(side, np.matvec(bend, direction))
            along = -sizes[:, -1] / curvature
            # The inverse of the Jacobian without its smallest singular value.
            parts = np.swapaxes(right[:, :-1], 1, 2) / sizes[:, None, :-1]
            inverse = parts @ np.swapaxes(left[:, :, :-1], 1, 2)
            step = -rotated(inverse.astype(quad()), gaps)
            step = step + (along[:, None] * direction).astype(quad())
            length = np.max(np.abs(step.astype(float)), axis=1)
            is_known &= length < NEAREST_START_RAD
            values = np.where(is_known[:, None], values + step, values)
        is_known &= length < FOLD_STEP_RAD
        is_known &= _largest_change(values, start) < NEAREST_START_RAD
        is_known &= sizes[:, -2] > LEAST_SECOND_SINGULAR_VALUE * sizes[:, 0]
        is_known &= np.abs(curvature) > LEAST_CURVATURE
        residual = np.sum(self.at(values)[1] * side.astype(quad()), axis=1).astype(float)
        return _Fold(values, direction, residual, curvature, is_known)


def _cosine_difference(
    arc: HalfAngle, sum_square: Array, difference_square: Array
) -> Array:
    """Return the difference cos(arc) - a . c for two unit axes a and c.

    Of two formulas, the one without cancellation is used for each element.

    Parameters
    ----------
    arc
        Sine and cosine (n,) of half the arc.
    sum_square, difference_square
        (n,) squares |a + c|^2 and |a - c|^2.
    """
    first = 0.5 * difference_square - 2.0 * (arc.sine * arc.sine)
    second = 2.0 * (arc.cosine * arc.cosine) - 0.5 * sum_square
    return np.where(np.abs(arc.sine) < np.abs(arc.cosine), first, second)


def _sine_of_arc(arc: HalfAngle) -> Floats:
    """Return the sine (n,) of an arc that is given by its half, in float64."""
    return np.asarray(2.0 * arc.sine * arc.cosine).astype(float)


def _dyad_error(error: Floats, triple: Floats, sines: Sequence[Floats]) -> Floats:
    """Return a bound of the error of the bodies of a dyad, after it is placed.

    Away from the dead centre, the error of the body before is divided by the triple
    product. At the dead centre the triple product is zero. The dyad is then a flat
    spherical triangle, and the error of its angles is the square root of the error, divided
    by the sine of an arc next to the angle. The smaller of both bounds is used.

    Parameters
    ----------
    error
        (n,) error bound (rad) of the body that carries the outer axes.
    triple
        (n,) absolute triple product of the axes, which is the determinant of the velocity
        equations of the dyad. 0 at the dead centre.
    sines
        Sines (n,) of the arcs of both bodies, and of the arc between the outer axes.

    Returns
    -------
    (n,) bound (rad). It is infinite if both bounds are, or at a dead centre with a sine
    that is not large compared with the root of the error. The dyad can then turn about a
    line.
    """
    least = np.minimum.reduce(sines)
    dead_centre_error = np.where(least > 0.0, np.sqrt(2.0 * error) / least, np.inf)
    regular_case = np.where(triple > 0.0, error / triple, np.inf)
    return 4.0 * (
        error
        + np.fmin(
            regular_case, np.where(dead_centre_error < 0.1, dead_centre_error, np.inf)
        )
    )
