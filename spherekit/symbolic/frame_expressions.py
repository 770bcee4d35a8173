"""Frames of R pairs in their links, as symbolic expressions of the sizes of a design.

The frames are those of `spherekit.mechanism.pair_frames`, except that chosen sizes may be
expressions. The frames differ in one respect: the zero direction of a pair whose axis
is given in a reference pose is arbitrary, because its variable counts from its value in
that pose.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.elements import LinkSizes, Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes, reference_frame
from spherekit.mechanism.pose_sizes import pose_sizes
from spherekit.symbolic.expression_graph import Expr
from spherekit.symbolic.vector_algebra import Exprs, cosine, cross, sine, vector

DesignGeometry = Mapping[tuple[str, Any], Expr]
"""Sizes (rad) that replace those of a mechanism, as numbers or expressions.

A key is the kind of a size and what it belongs to:

- ``("arcs", (link, pair))`` is the arc of a link that leads to the axis of a pair, and
  ``("angles", (link, pair))`` is the angle of this arc. In a reference pose they are those
  of `pose_sizes`.
- ``("zeros", pair)`` is the zero angle of a pair in a link given by sizes.
- ``("values", pair)`` is the value of a pair variable in the reference pose.
- ``("longitudes", pair)`` and ``("latitudes", pair)`` give the axis of a pair in the
  reference pose. A pair has both or none of them.
"""


Frames = tuple[Exprs, Exprs]
"""The frames (3, 3) of a pair in its first and its second link.

A frame is a rotation from pair axes to link axes; its third column is the axis of the pair.
"""


def revolute_frames(mechanism: Mechanism, design: DesignGeometry) -> dict[str, Frames]:
    """Return the frames of every R pair (revolute joint) as expressions.

    A pair has one frame in each of its two links. The z axis of both is the axis of the
    pair. The variable of the pair is the angle about z from the x axis of the first frame
    to that of the second. A mechanism file defines the axes in links by a reference pose or
    by sizes (arcs and angles between axes).

    Parameters
    ----------
    mechanism
        The mechanism, whose own sizes are used if `design` does not replace them.
    design
        Numbers or expressions for some sizes.

    Returns
    -------
    By the name of each pair two rotation matrices (3, 3), from the frame to the axes of the
    first and of the second link.

    Raises
    ------
    EngineError
        If a link with varied sizes has an arc of 0 or 180 degrees. An angle is counted from
        the direction of an arc, which is not defined there.
    """
    geometry = mechanism.geometry
    frames_by_pair = {}
    for pair in mechanism.pairs:
        if not pair.kind.has_axis:
            continue
        # With a reference pose, the angle between both x axes is the value of the variable
        # in this pose. With sizes, the file can add an offset, the zero angle, to each
        # variable.
        if isinstance(geometry, PoseGeometry):
            frames = _frames_from_pose(mechanism, geometry, design, pair)
        else:
            zero = design.get(("zeros", pair.name), geometry.zeros.get(pair.name, 0.0))
            first_frame, second_frame = (
                _frame_from_sizes(mechanism, geometry, design, link, pair.name)
                for link in pair.links
            )
            # The zero angle turns the x axis of the frame in the first link about the
            # pair's axis.
            frames = first_frame @ about_z(zero), second_frame
        frames_by_pair[pair.name] = frames
    return frames_by_pair


def _frames_from_pose(
    mechanism: Mechanism, geometry: PoseGeometry, design: DesignGeometry, pair: Pair
) -> Frames:
    """Return the frames of a pair whose axis is given in the reference pose.

    The reference pose is a configuration for which the file states the axes of all pairs.
    Link axes and ground axes coincide in this pose. A pair has a frame in each of its two
    links, with the pair's axis as z axis. The variable of the pair is the angle between the
    two x axes. The x axis in the first link is chosen: it points east, along the circle of
    latitude. The x axis in the second link follows from the value of the variable in this
    pose.

    Parameters
    ----------
    mechanism, geometry
        The mechanism and its geometry, with axes and values in the reference pose.
    design
        Numbers or expressions that replace some sizes. A key (`DesignGeometry`) consists of
        the kind of the size, such as "longitudes", and the pair (or link and pair) that has
        it.
    pair
        An R pair (revolute joint).

    Returns
    -------
    The frames (3, 3) of the pair in the axes of its first and of its second link.
    """
    frame = _frame_in_pose(geometry, design, pair.name)
    # In the pose, both links have the same frame. The design may change the size of a link:
    # an arc or an angle between its axes. This change rotates the frame of the pair in that
    # link only.
    first_frame, second_frame = (
        _rotate_by_size_changes(mechanism, design, link, pair.name, frame)
        for link in pair.links
    )
    # If no size is changed, both x axes point east so far. The angle between the x axes has
    # to be the value of the variable in the reference pose. So the second frame is turned
    # by this value.
    value = design.get(("values", pair.name), geometry.values.get(pair.name, 0.0))
    return first_frame, second_frame @ about_z(value)


def _frame_in_pose(geometry: PoseGeometry, design: DesignGeometry, pair: str) -> Exprs:
    """Return the frame (3, 3) of a pair in its first link in the reference pose.

    Its columns are the direction to the east, the direction to the north, and the axis of
    the pair, in link axes. East and north are those on a globe at the point where the axis
    meets the sphere. `design` may replace the longitude and the latitude of the axis by
    expressions.
    """
    x, y, z = geometry.axes[pair]
    longitude = design.get(("longitudes", pair), float(np.arctan2(y, x)))
    latitude = design.get(("latitudes", pair), float(np.arctan2(z, np.hypot(x, y))))
    axis = direction_from_angles(longitude, latitude)
    east = vector([-1.0 * sine(longitude), cosine(longitude), 0.0])
    return np.stack([east, cross(axis, east), axis], axis=1)


def direction_from_angles(longitude: Expr, latitude: Expr) -> Exprs:
    """Return the unit vector (3,) of a longitude and a latitude (rad)."""
    radius = cosine(latitude)
    return vector([radius * cosine(longitude), radius * sine(longitude), sine(latitude)])


def _rotate_by_size_changes(
    mechanism: Mechanism, design: DesignGeometry, link: str, pair: str, frame: Exprs
) -> Exprs:
    """Return the frame of a pair in a link after changes of the link's sizes.

    The frame is known in the reference pose, a configuration for which the file states the
    axes of all pairs. A design can replace sizes of the link by other values or by
    expressions. The differences from the sizes in the reference pose rotate the frame.

    The sizes (rad) of a pair of the link are an arc and an angle (see `pose_sizes`). The
    arc leads to the axis of the pair from the first axis: that of the link's first R pair
    (revolute joint). The angle, at the first axis, is counted from the first arc.

    - A change of the arc rotates the frame about the normal of the plane of the arc.
    - A change of the angle rotates the frame about the first axis.

    The change of the angle would also rotate the plane of the arc. The known normal is that
    in the reference pose, so the rotation by the change of the arc comes first.

    Parameters
    ----------
    mechanism
        The mechanism, with its sizes in the reference pose.
    design
        Numbers or expressions that replace some sizes. A key is "arcs" or "angles", with
        the names of the link and of the pair.
    link, pair
        Names of the link and of one of its pairs.
    frame
        (3, 3) frame of the pair in the reference pose.
    """
    # The arc and the angle of this pair in the reference pose, by kind. The first axis, and
    # an axis collinear with it, has neither. The first arc, from which angles are counted,
    # has no angle.
    pose_size_by_kind = {
        size.kind: size for size in pose_sizes(mechanism, link) if size.pair == pair
    }
    for kind in ("arcs", "angles"):
        pose_size = pose_size_by_kind.get(kind)
        size = design.get((kind, (link, pair)))
        if pose_size is not None and size is not None:
            # The frame turns about this axis as the size grows.
            rotation_axis = pose_size.growth_axis
            frame = _rotation_about(rotation_axis, size - pose_size.value) @ frame
    return frame


def _frame_from_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    design: DesignGeometry,
    link: str,
    pair: str,
) -> Exprs:
    """Return the frame (3, 3) of a pair in a link that is described by arcs and angles.

    An arc is the angle between two axes of the link.

    The columns of the frame are the zero direction of the pair, a perpendicular direction
    and the axis, in link axes. The first axis of the link is z. The reference arc of the
    first axis leads to the second axis. The reference arc of every other axis comes from
    the first axis. The zero direction points along the reference arc. The zero angle of the
    pair is not included.

    Parameters
    ----------
    mechanism, geometry
        The mechanism and its geometry, with the sizes of links.
    design
        Numbers or expressions that replace some sizes. A key is "arcs" or "angles", with
        the names of the link and of the pair.
    link, pair
        Names of the link and of one of its R pairs.

    Raises
    ------
    EngineError
        If the reference arc is 0 or 180 degrees, so that it has no direction.
    """
    sizes = geometry.links.get(link, LinkSizes(()))
    # Keys of arcs and angles are the link and the pair. If no size of this link varies, the
    # frame consists of numbers.
    varied_links = {key[0] for kind, key in design if kind in ("arcs", "angles")}
    if link not in varied_links:
        return reference_frame(axes_from_sizes(sizes), pair).astype(object)

    axis_index = sizes.axes.index(pair)
    arc_end = axis_index or 1  # index of the axis to which the reference arc leads
    reference_arc = sizes.arcs[arc_end - 1]
    if abs(np.sin(reference_arc)) < COLLINEAR_SINE:
        raise EngineError(
            f"{mechanism.name}: links.{link}: the arc to {sizes.axes[arc_end]} is 0 or 180 "
            f"deg. If this arc changes, the zero of pair {pair} jumps, so there are no "
            "derivatives with respect to sizes of this link; vary sizes of another link, "
            "or compare with a copy of the file in which this arc differs a little"
        )
    size_key = link, sizes.axes[arc_end]
    arc = design.get(("arcs", size_key), reference_arc)
    # The angle of the second axis is zero by definition.
    azimuth: Expr = 0.0
    if arc_end > 1:
        azimuth = design.get(("angles", size_key), sizes.angles[arc_end - 2])

    # The zero direction follows the shorter arc between the axes. If the reference arc
    # exceeds 180 degrees, the shorter one starts in the opposite direction.
    sense = 1.0 if np.sin(reference_arc) > 0.0 else -1.0
    outward = vector([-1.0 * sine(azimuth), cosine(azimuth), 0.0])
    first_axis = vector([0.0, 0.0, 1.0])
    if axis_index == 0:
        axis = first_axis
        tangent = outward * sense
    else:
        axis = outward * sine(arc) + first_axis * cosine(arc)
        tangent = (first_axis * sine(arc) - outward * cosine(arc)) * sense
    return np.stack([tangent, cross(axis, tangent), axis], axis=1)


def about_z(angle: Expr) -> Exprs:
    """Return the rotation (3, 3) about z by an angle (rad)."""
    c = cosine(angle)
    s = sine(angle)
    return np.array([[c, -1.0 * s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=object)


def _rotation_about(axis: Floats, angle: Expr) -> Exprs:
    """Return the rotation (3, 3) by an angle (rad) about a unit axis (3,) of numbers.

    Rodrigues' formula: R = 1 cos(angle) + K sin(angle) + axis axis^T (1 - cos(angle)),
    where K v is the cross product of the axis and v.
    """
    x, y, z = axis.tolist()
    cross_matrix = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=object)
    identity = np.eye(3).astype(object)
    projection = np.outer(axis, axis).astype(object)
    c = cosine(angle)
    return identity * c + cross_matrix * sine(angle) + projection * (1.0 - c)
