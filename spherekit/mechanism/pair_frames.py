"""Axes and frames of R pairs in the links that they join.

The frame of an R pair in a link is a rotation (3, 3) from pair axes to link axes. Its z
axis is the axis of the pair, and its x axis is the zero direction of the pair variable.
Frames follow from the sizes of the links, or from the axes in a reference pose.
`spherekit.mechanism.joint_construction` makes joints of them.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.rotation import about_z
from spherekit.geometry.triangle import frame_from, perpendicular
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import LinkSizes, Pair, SizeGeometry, as_vector
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import Vector
from spherekit.tolerances import EPS
from spherekit.wording import choices

PairFrames = dict[str, Floats]
"""Frames (3, 3) of R pairs in one of their links, by the name of the pair."""

AxesOfLink = dict[str, Floats]
"""Unit axes (3,) of R pairs in link axes, by the name of the pair."""

LinkAxes = Mapping[str, Mapping[str, Floats]]
"""Unit axes (3,) of R pairs in link axes, by the names of the link and of the pair."""

SAME_AXIS_SINE = 16 * EPS
"""Sine of the angle below which two axes of a link are the same axis.

The value covers the rounding errors of the sines and cosines of arcs and angles. Larger:
nearly coincident axes count as one. Smaller: coincident axes can be missed.
"""

COLLINEAR_SINE = 1e-9
"""Sine of the angle below which two directions lie on one line.

Such directions define no great-circle arc. Larger: more mechanisms are refused or get an
arbitrary zero direction. Smaller: a zero direction can consist of rounding errors.
"""


def pair_frames(mechanism: Mechanism) -> tuple[PairFrames, PairFrames]:
    """Return the frames of all R pairs (hinges) in their first and in their second link.

    A frame F (3, 3) has the x, y and z axis of the pair in its columns, in link axes. The z
    axis is the axis of the pair. Let v be the pair variable (rad), Z(v) the rotation matrix
    about z, and A the rotation of a link from its own axes to ground axes. Then

        A_second = A_first F_first Z(v) F_second^T.

    At v = 0 both frames coincide in space.

    Returns
    -------
    The frames in the first links, and those in the second links, each by the name of the
    pair. Contacts have no frame.
    """
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        return pair_frames_from_sizes(mechanism.pairs, geometry)
    first_frames = {}
    second_frames = {}
    for name, axis_numbers in geometry.axes.items():
        # In the reference pose, link axes and ground axes coincide, so both A are unit
        # matrices. With the value v in this pose, F_second = F_first Z(v). The x axis of
        # F_first is arbitrary, because only the angle between both frames matters.
        axis = np.array(axis_numbers, dtype=float)
        first_frames[name] = frame_from(axis, perpendicular(axis))
        second_frames[name] = first_frames[name] @ about_z(geometry.values.get(name, 0.0))
    return first_frames, second_frames


def pair_frames_from_sizes(
    pairs: Sequence[Pair], geometry: SizeGeometry
) -> tuple[PairFrames, PairFrames]:
    """Return the frames of all R pairs in both of their links, from the sizes of links.

    Parameters
    ----------
    pairs
        All pairs of the mechanism. Contacts have no axis and no frame, and are passed over.
    geometry
        Sizes (arcs and angles) of the links, and the zero angle of each pair. At the axis
        of a pair, each link has a reference direction, which points to another axis of the
        link. If the variable of the pair is 0, the angle from the reference direction of
        the first link to that of the second is the zero angle.

    Returns
    -------
    The frames (3, 3) in the first links, and those in the second links, each by the name of
    the pair. The z column is the axis, and the x column the zero direction of the variable.
    """
    axes_by_link = {}
    for pair in pairs:
        for link in pair.links:
            sizes = geometry.links.get(link, LinkSizes(()))
            axes_by_link[link] = axes_from_sizes(sizes)
    first_frames = {}
    second_frames = {}
    for pair in pairs:
        if pair.kind.has_axis:
            # In each link, the x axis of the reference frame points to another axis of this
            # link. In the first link the frame is then rotated by the zero angle.
            first_link, second_link = pair.links
            first_reference = reference_frame(axes_by_link[first_link], pair.name)
            zero_angle = geometry.zeros.get(pair.name, 0.0)
            first_frames[pair.name] = first_reference @ about_z(zero_angle)
            second_frames[pair.name] = reference_frame(axes_by_link[second_link], pair.name)
    return first_frames, second_frames


def axes_from_sizes(sizes: LinkSizes) -> AxesOfLink:
    """Return the unit axes (3,) of a link in link axes, in the order of `sizes.axes`.

    The first axis is z. The second axis is in the plane x = 0, and its y component is the
    sine of its arc. An arc may be negative. Each axis after the first has an arc (rad), its
    distance from the first axis. Each axis after the second has an angle (rad), the azimuth
    of its arc about the first axis, counter-clockwise from the arc of the second axis.
    """
    # The first axis. A link without axes has none.
    axes: AxesOfLink = {name: np.array([0.0, 0.0, 1.0]) for name in sizes.axes[:1]}
    # The azimuth of the second axis is zero. If sizes are missing, the last axes are left
    # out, because a check of the mechanism reports this fault.
    azimuths = (0.0, *sizes.angles)
    for name, arc, azimuth in zip(sizes.axes[1:], sizes.arcs, azimuths, strict=False):
        sine = np.sin(arc)
        axes[name] = np.array(
            [-sine * np.sin(azimuth), sine * np.cos(azimuth), np.cos(arc)]
        )
    return axes


def reference_frame(axes: Mapping[str, Floats], name: str) -> Floats:
    """Return the frame (3, 3) of a pair axis in its link, by the other axes of the link.

    The angle of the pair (joint) is measured between the x axes of the frames in its two
    links. The columns of a frame are its x, y and z axes in link axes.

    Parameters
    ----------
    axes
        Unit axes (3,) of the link, in link axes.
    name
        The axis that becomes z. The x axis points to the first other axis of the link that
        is not on the same line, or in an arbitrary direction if there is none.
    """
    axis = axes[name]
    # `toward` is the part of the other axis perpendicular to `axis`. This part is zero for
    # axes on one line.
    for other_axis in axes.values():
        toward = cross(cross(axis, other_axis), axis)
        length = np.linalg.norm(toward)
        if length > COLLINEAR_SINE:
            return frame_from(axis, toward / length)
    return frame_from(axis, perpendicular(axis))


def link_axes(mechanism: Mechanism) -> LinkAxes:
    """Return the axes of the R pairs (hinges) on each link.

    Returns
    -------
    For each link, by its name: the unit axes (3,) of its R pairs in link axes, by the name
    of the pair. A pair is therefore under both of its links.
    """
    axes: dict[str, AxesOfLink] = {link: {} for link in mechanism.links}
    both_frames = pair_frames(mechanism)
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            for link, frames in zip(pair.links, both_frames, strict=True):
                axes[link][pair.name] = frames[pair.name][:, 2]
    return axes


def axis_in_link(axes: LinkAxes, link: str, pair: str) -> Vector:
    """Return the unit axis of an R pair in the axes of one of its links.

    Raises
    ------
    ModelError
        If the link has no R pair of this name.
    """
    # `axes` has, for each link, the axes of its R pairs.
    if pair not in axes[link]:
        raise ModelError(
            f'link "{link}" has no R pair "{pair}"'
            f"{choices(pair, axes[link], 'R pairs on it')}"
        )
    return as_vector(axes[link][pair])


def arc_pole(first: Vector, second: Vector) -> Vector:
    """Return the pole of the great-circle arc from one unit vector to another.

    A counter-clockwise rotation about the pole moves the first vector towards the second.

    Raises
    ------
    ModelError
        If the two vectors are equal or opposite, so that many great circles join them.
    """
    pole = cross(np.array(first), np.array(second))
    length = np.linalg.norm(pole)
    if length < COLLINEAR_SINE:
        raise ModelError(
            "the two directions are equal or opposite: they define no arc, because many "
            "great circles pass through both; give two directions that are neither"
        )
    return as_vector(pole / length)
