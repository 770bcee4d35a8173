"""Vectors of balls, and the frames of R pairs in their links as balls.

A frame is an array (3, 3) whose rows are three orthogonal unit vectors in link axes: the
zero direction, from which the pair angle is counted; the side, which is the cross product
of the axis with the zero direction; and the axis of the pair.
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
    """Return a vector divided by its length; its elements are numbers with error bounds."""
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
    """Return the rotation of an R pair as a linear function of 1, cosine and sine.

    At the angle x, the rotation maps the vectors of the second frame to

        zero direction:  zero_direction cos(x) + side sin(x),
        side:            side cos(x) - zero_direction sin(x),
        axis:            axis,

    where the vectors on the right are those of the first frame. The rotation is the sum of
    the outer products of each image with its vector of the second frame.

    Parameters
    ----------
    first, second
        (3, 3) frames of the pair in its first and second link. The rows are zero direction,
        side and axis in link axes.

    Returns
    -------
    (3, 3, 3) matrices T such that T[0] + cos(x) T[1] + sin(x) T[2] rotates from the axes of
    the second link to those of the first.
    """
    zero_direction, side, axis = first
    second_zero_direction, second_side, second_axis = second
    constant = np.outer(axis, second_axis)
    cosine = np.outer(zero_direction, second_zero_direction) + np.outer(side, second_side)
    sine = np.outer(side, second_zero_direction) + np.outer(-zero_direction, second_side)
    return np.array([constant, cosine, sine])


def azimuth_frame(centre: Vector) -> Frame:
    """Return a frame whose axis is `centre` and from which azimuths of profiles count.

    The zero direction is the part of the y or x axis of the link that is perpendicular to
    the centre. The x axis is avoided if the centre is close to it.
    """
    helper = np.eye(3)[1 if abs(float(centre[0])) > 0.9 else 0]
    return _frame_toward(centre, helper - (helper @ centre) * centre)


def frames_from_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    sizes: Mapping[str, Sequence[Sequence[Ball]]],
    zeros: Mapping[str, Ball],
) -> Frames:
    """Return the frames of R pairs from the arcs and angles of the links.

    The other pairs are rolling and sliding contacts, which have no axis and no frame here.
    All numbers are balls: a ball is a centre and a radius, which bounds the error. A frame
    (3, 3) has three rows in link axes: the zero direction, from which the pair angle is
    counted, the cross product of axis and zero direction (side), and the axis of the pair.
    The zero direction points towards another axis of the link that does not coincide with
    the axis. If there is no such axis, it is any direction at right angles to the axis.

    Parameters
    ----------
    mechanism
        The mechanism, for its pairs.
    geometry
        The same sizes in float64. They decide whether two axes of a link coincide up to
        rounding, so that no zero direction can point from one to the other. The frames of
        the mechanism itself follow from the same decision.
    sizes
        By link: its list of arcs and its list of angles (rad), in balls.
    zeros
        By pair: the angle (rad) at which its variable is zero; 0 if it is missing.

    Returns
    -------
    By name of the pair its frames in its first and second link. The first one is rotated
    about the axis by the zero of the pair (positive sense), so that the variable of the
    pair is the angle from the first frame to the second.
    """
    # 1. Axes of all pairs of a link in link axes, by link and pair.
    float_axes = {link: axes_from_sizes(given) for link, given in geometry.links.items()}
    axes = {}
    for link, (arcs, angles) in sizes.items():
        link_sizes = LinkSizes(geometry.links[link].axes, tuple(arcs), tuple(angles))
        axes[link] = {
            # Adding 0 turns coordinates that are plain numbers into balls.
            name: axis + exact_ball(0.0)
            for name, axis in axes_from_sizes(link_sizes).items()
        }

    # 2. Frames of all R pairs.
    frames = {}
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            first, second = (
                _reference_frame(axes[link], float_axes[link], pair.name)
                for link in pair.links
            )
            zero = zeros.get(pair.name, exact_ball(0.0))
            frames[pair.name] = rotate_frame(first, zero), second
    return frames


def frames_from_pose(
    geometry: PoseGeometry, axes: Mapping[str, Vector], values: Mapping[str, Ball]
) -> Frames:
    """Return the frames of R pairs from the axes in the reference pose.

    In the reference pose the coordinate axes of all links coincide with those of the
    ground, so each pair axis has the same components in both links. All numbers are balls:
    a ball is a centre and a radius, which bounds the error. A frame (3, 3) has three rows
    in link axes: the zero direction, from which the pair angle is counted, the cross
    product of axis and zero direction (side), and the axis of the pair.

    Parameters
    ----------
    geometry
        The axes in float64. The zero direction of a pair is at right angles to its axis and
        to the coordinate axis that is farthest from it. The float64 axis decides which
        coordinate axis that is, because balls that overlap have no order.
    axes
        By pair: its unit axis in the reference pose, as balls.
    values
        By pair: its angle (rad) in the reference pose; 0 if it is missing.

    Returns
    -------
    By name of the pair its frames in its first and second link. The second one is rotated
    by the angle, so that the pair has this angle in the reference pose.
    """
    frames = {}
    for name, float_axis in geometry.axes.items():
        first = _frame_across(axes[name], np.array(float_axis))
        frames[name] = first, rotate_frame(first, values.get(name, exact_ball(0.0)))
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

    The zero direction, from which the pair angle is counted, points towards another axis of
    the link: the first one that does not coincide with the axis of the pair. If there is no
    such axis, it is any direction at right angles to the axis.

    Parameters
    ----------
    axes
        By pair of the link: its axis in link axes, as balls.
    float_axes
        The same axes in float64, by which coincidence is judged.
    name
        Name of the pair.
    """
    axis = axes[name]
    for other_name, other_axis in axes.items():
        sine = np.linalg.norm(np.cross(float_axes[name], float_axes[other_name]))
        if sine > COLLINEAR_SINE:
            # The part of the other axis that is at right angles to the axis.
            perpendicular = np.cross(np.cross(axis, other_axis), axis)
            return _frame_toward(axis, perpendicular)
    return _frame_across(axis, float_axes[name])


def _frame_across(axis: Vector, float_axis: Floats) -> Frame:
    """Return the frame of an axis if no other axis of the link gives the zero direction.

    The zero direction is perpendicular to the coordinate axis that is farthest from the
    pair axis.
    """
    coordinate_axis = np.eye(3)[np.argmin(np.abs(float_axis))]
    return _frame_toward(axis, np.cross(axis, coordinate_axis))


def _frame_toward(axis: Vector, perpendicular: Vector) -> Frame:
    """Return the frame of an axis whose zero direction is along a vector across the axis.

    The vector need not have unit length.
    """
    zero_direction = unit_vector(perpendicular)
    return np.stack([zero_direction, np.cross(axis, zero_direction), axis])
