"""Vectors of balls, and the frames of R pairs in their links as balls.

A frame is an array (3, 3) with three orthogonal unit vectors in link axes as rows: the zero
direction, from which the pair angle is counted; the side, which is the cross product of the
axis with the zero direction; and the axis of the pair.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats
from spherekit.mechanism.elements import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes
from spherekit.proof.balls import Ball, flint_library

Vector = Array
"""(3,) balls."""

Frame = Array
"""(3, 3) balls: the rows are zero direction, side and axis of a pair in link axes."""

Frames = dict[str, tuple[Frame, Frame]]
"""By name of an R pair: its frames in its first and in its second link."""


def exact_balls(values: ArrayLike) -> Array:
    """Return an array of float64 numbers as balls of radius 0."""
    numbers = np.asarray(values, dtype=float)
    return np.asarray(np.frompyfunc(flint_library().arb, 1, 1)(numbers))


def exact_ball(number: float) -> Ball:
    """Return a float64 number as a ball of radius 0."""
    return flint_library().arb(float(number))


def unit_vector(vector: Vector) -> Vector:
    """Return a vector divided by its length. The components are balls (with bounds)."""
    return vector / np.sqrt(vector @ vector)


def rotate_frame(frame: Frame, angle: Ball) -> Frame:
    """Return a frame rotated about its axis by an angle (rad)."""
    sine, cosine = angle.sin_cos()
    zero_direction, side, axis = frame
    return np.stack(
        [
            cosine * zero_direction + sine * side,
            cosine * side - sine * zero_direction,
            axis,
        ]
    )


def revolute_rotation_terms(first: Frame, second: Frame) -> Array:
    """Return the rotation of a revolute pair as a linear function of 1, cosine and sine.

    Each link has a frame of three unit vectors: the axis of the pair, the zero direction,
    from which the pair angle is counted, and the side (cross product of axis and zero
    direction). At the angle x, the rotation maps the vectors of the second link to

        zero direction:  zero_direction cos(x) + side sin(x),
        side:            side cos(x) - zero_direction sin(x),
        axis:            axis,

    where the vectors on the right belong to the first link. The rotation matrix is the sum
    of three outer products: of each right-hand side with the vector of the second link that
    is mapped to it. The constant terms are computed once and serve for all angles.

    Parameters
    ----------
    first, second
        (3, 3) frames of the pair in its first and second link. The rows are zero direction,
        side and axis in link axes.

    Returns
    -------
    (3, 3, 3) matrices T such that T[0] + cos(x) T[1] + sin(x) T[2] rotates from the axes of
    the second link to the axes of the first link.
    """
    zero_direction, side, axis = first
    second_zero_direction, second_side, second_axis = second
    constant = np.outer(axis, second_axis)
    cosine = np.outer(zero_direction, second_zero_direction) + np.outer(side, second_side)
    sine = np.outer(side, second_zero_direction) + np.outer(-zero_direction, second_side)
    return np.array([constant, cosine, sine])


def azimuth_frame(centre: Vector) -> Frame:
    """Return the frame in which the azimuths of a profile about its centre are measured.

    The rows of a frame are the zero direction (azimuth 0), the side (azimuth 90 degrees)
    and the axis. The axis is `centre`, a unit vector (3,) in link axes. The zero direction
    is the part of the x axis of the link that is normal to `centre`. If the centre is close
    to the x axis, the y axis of the link is used.
    """
    helper = np.eye(3)[1 if abs(float(centre[0])) > 0.9 else 0]
    return _frame_toward(centre, helper - (helper @ centre) * centre)


def frames_from_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    sizes: Mapping[str, Sequence[Sequence[Ball]]],
    zeros: Mapping[str, Ball],
) -> Frames:
    """Return the frames of revolute pairs from the sizes of the links.

    The sizes of a link locate its axes: arcs from its first axis to the others, and angles
    between these arcs. A ball is a number with a bound of its error.

    A frame (3, 3) has three unit vectors in link axes as rows: the zero direction, the side
    (cross product of axis and zero direction), and the axis of the pair. The zero direction
    points towards another axis of the link.

    Parameters
    ----------
    mechanism
        The mechanism, for its pairs.
    geometry
        The same sizes in float64. The float64 sizes decide which axes of a link coincide up
        to rounding, since such axes cannot give a zero direction.
    sizes
        By link: its list of arcs and its list of angles (rad), in balls.
    zeros
        By pair: the angle (rad) between the zero directions of its two links at which the
        variable of the pair is zero. The angle is 0 if the pair is missing here.

    Returns
    -------
    By name of the pair its frames in its first and second link. The first frame is rotated
    about the axis by the angle of `zeros`. So the variable of the pair is the angle from
    the first frame to the second.
    """
    # 1. The axes of each link in its own axes, in float64 and in balls.
    float_axes = {link: axes_from_sizes(given) for link, given in geometry.links.items()}
    axes = {}
    for link, (arcs, angles) in sizes.items():
        link_sizes = LinkSizes(geometry.links[link].axes, tuple(arcs), tuple(angles))
        axes[link] = {
            # Some coordinates are plain numbers; adding a ball 0 turns them into balls.
            name: axis + exact_ball(0.0)
            for name, axis in axes_from_sizes(link_sizes).items()
        }

    # 2. Frames of all revolute pairs, in both their links.
    frames = {}
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            unrotated_frames = [
                _reference_frame(axes[link], float_axes[link], pair.name)
                for link in pair.links
            ]
            first_frame, second_frame = unrotated_frames
            zero_angle = zeros.get(pair.name, exact_ball(0.0))
            frames[pair.name] = rotate_frame(first_frame, zero_angle), second_frame
    return frames


def frames_from_pose(
    geometry: PoseGeometry, axes: Mapping[str, Vector], values: Mapping[str, Ball]
) -> Frames:
    """Return the frames of revolute pairs from the axes in the reference pose.

    The reference pose is a configuration in which the file gives all axes. There the
    coordinate axes of all links coincide with the coordinate axes of the ground, so an axis
    has equal components in both its links. A ball is a number with a centre, and a radius
    that bounds its error. A frame (3, 3) has three unit vectors in link axes as rows: the
    zero direction, from which the pair angle is counted, the side (cross product of axis
    and zero direction), and the axis.

    Parameters
    ----------
    geometry
        The axes in float64. The zero direction of a pair is perpendicular to the pair axis
        and to the coordinate axis that is farthest from it. The axes in float64 decide
        which coordinate axis this is.
    axes
        By pair: its unit axis in the reference pose, as balls.
    values
        By pair: its angle (rad) in the reference pose. The angle is 0 if the pair is
        missing.

    Returns
    -------
    By name of the pair its frames in its first and second link. The second frame is rotated
    by the angle, so that the pair has this angle in the reference pose.
    """
    frames = {}
    for name, float_axis in geometry.axes.items():
        first_frame = _frame_across(axes[name], np.array(float_axis))
        angle = values.get(name, exact_ball(0.0))
        second_frame = rotate_frame(first_frame, angle)
        frames[name] = first_frame, second_frame
    return frames


def declared_frames(mechanism: Mechanism) -> Frames:
    """Return the frames of R pairs with all sizes taken as exact float64 numbers."""
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        axes = {
            name: unit_vector(exact_balls(axis)) for name, axis in geometry.axes.items()
        }
        return frames_from_pose(geometry, axes, _exact_by_name(geometry.values))
    sizes = {
        link: [[*exact_balls(link_sizes.arcs)], [*exact_balls(link_sizes.angles)]]
        for link, link_sizes in geometry.links.items()
    }
    return frames_from_sizes(mechanism, geometry, sizes, _exact_by_name(geometry.zeros))


def _exact_by_name(numbers: Mapping[str, float]) -> dict[str, Ball]:
    """Return float64 numbers as balls of radius 0, by the same names."""
    return {name: exact_ball(number) for name, number in numbers.items()}


def _reference_frame(
    axes: Mapping[str, Vector], float_axes: Mapping[str, Floats], name: str
) -> Frame:
    """Return the frame of a pair in a link, as balls (numbers with a bound of their error).

    The frame (3, 3) has three unit vectors as rows: the zero direction, from which the pair
    angle is counted, the side (axis x zero direction), and the axis. The zero direction
    points towards the first other axis of the link that does not coincide with the axis of
    the pair. If there is no such axis, any direction across the axis is taken.

    Parameters
    ----------
    axes
        By name of the pair: its axis (3,) in link axes, as balls.
    float_axes
        The same axes in float64, which decide whether two axes coincide.
    name
        Name of the pair.
    """
    axis = axes[name]
    for other_name, other_axis in axes.items():
        sine = np.linalg.norm(np.cross(float_axes[name], float_axes[other_name]))
        if sine > COLLINEAR_SINE:
            # The component of the other axis at right angles to the axis of the pair.
            perpendicular = np.cross(np.cross(axis, other_axis), axis)
            return _frame_toward(axis, perpendicular)
    return _frame_across(axis, float_axes[name])


def _frame_across(axis: Vector, float_axis: Floats) -> Frame:
    """Return the frame of a pair axis, with a zero direction that needs no other axis.

    The rows of a frame are the zero direction of the pair angle, the side and the axis. The
    zero direction is normal to the coordinate axis that is farthest from the pair axis. The
    axis in float64, `float_axis`, decides which one this is.
    """
    coordinate_axis = np.eye(3)[np.argmin(np.abs(float_axis))]
    return _frame_toward(axis, np.cross(axis, coordinate_axis))


def _frame_toward(axis: Vector, perpendicular: Vector) -> Frame:
    """Return the frame with a given axis and zero direction.

    The rows of a frame (3, 3) are the zero direction of the pair angle, the side (at 90
    degrees from it) and the axis. `axis` is a unit vector. `perpendicular` is a vector of
    any length along the zero direction.
    """
    zero_direction = unit_vector(perpendicular)
    return np.stack([zero_direction, np.cross(axis, zero_direction), axis])
