"""Pair frames in quad precision, from the decimal numbers of a mechanism file.

The links have the decimal sizes of the file, 64.02 degrees for example, and not the nearest
float64 numbers. The mechanism is written as a file in degrees and read again, which
restores the decimals.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.files.mechanism_writer import canonical_text
from spherekit.files.toml_document import Document, LiteralNumber, parse
from spherekit.geometry.vectors import dot
from spherekit.mechanism.elements import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes
from spherekit.numerics.quad_precision import quad, quad_pi
from spherekit.positions.quad_rotations import (
    make_frame,
    multiply_matrices,
    normalize,
    rotate_about_z,
)

Frames = tuple[Array, Array]
"""Frames (3, 3) of a pair in its first and its second link, in quad precision.

The columns of a frame are unit vectors in the axes of the link. The last one is the pair
axis. ``R_first @ first @ Z(angle) == R_second @ second`` for orientations R of the links,
where Z is a rotation about z by the pair variable.
"""


def decimal_frames(mechanism: Mechanism) -> dict[int, Frames]:
    """Return the frames of all pairs of a mechanism of R pairs in quad precision.

    They are computed from the decimal numbers of the mechanism file. The nearest float64
    numbers would already have errors of 1e-16.

    Returns
    -------
    For the number of each pair, its frames (3, 3) in its first and in its second link.
    """
    document = parse(canonical_text(mechanism, "deg"), mechanism.name)
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        return _frames_from_pose(mechanism, geometry, document)
    return _frames_from_sizes(mechanism, geometry, document)


def _frames_from_pose(
    mechanism: Mechanism, geometry: PoseGeometry, document: Document
) -> dict[int, Frames]:
    """Return the frames of pairs whose axes are given in a reference pose.

    The frames have quad precision. They follow from the decimal numbers of the file,
    because the nearest float64 numbers already have errors of 1e-16. The z axis of a frame
    is the pair axis.

    Parameters
    ----------
    mechanism
        The mechanism.
    geometry
        The axes in the reference pose, as float64 numbers. Each is printed as the shortest
        decimal number that gives it. This is the number of the file, if that has at most 15
        digits.
    document
        The mechanism as a file in degrees. It has the variables of pairs in the pose as
        decimal numbers of degrees, which are exact. (The same numbers in rad, in
        `geometry`, are rounded.) A pair that is not listed has the variable 0.

    Returns
    -------
    For the number of each pair its frames (3, 3) in the first and in the second link.
    """
    values = _angles_of_pairs(document, "value")
    frames: dict[int, Frames] = {}
    for name, axis in geometry.axes.items():
        # In the reference pose both links have the same axes. With the variable v there,
        # the frames satisfy first @ Z(v) = second, where Z is a rotation about z.
        exact_axis = normalize(_parse_decimals([repr(float(x)) for x in axis]))
        # There is no other axis to which the x axis of the frame could point. It is chosen
        # perpendicular to one of the coordinate axes. The float64 axis decides to which
        # one, so that float64 computations have the same x axis.
        first = _frame_without_reference(exact_axis, np.array(axis, dtype=float))
        second = first
        if name in values:
            second = multiply_matrices(first, rotate_about_z(values[name]))
        frames[mechanism.pair_number[name]] = first, second
    return frames


def _frames_from_sizes(
    mechanism: Mechanism, geometry: SizeGeometry, document: Document
) -> dict[int, Frames]:
    """Return the frames of pairs from the arcs and angles of the links.

    The frames have quad precision and follow from the decimal numbers of the file, not from
    the nearest float64 numbers. The z axis of a frame is the pair axis.

    Parameters
    ----------
    mechanism
        The mechanism.
    geometry
        Its links with their sizes, in rad.
    document
        The mechanism as a file in degrees.

    Returns
    -------
    For the number of each pair its frames (3, 3) in the first and in the second link.
    """
    # Unit vectors of the axes of each link, in float64 and in quad precision. Those in quad
    # precision follow from the arcs and angles as the file has them, in degrees. Those in
    # float64 only decide which axes are collinear. Each x axis then points to the same
    # other axis as in computations with float64 numbers.
    links = geometry.links
    float_axes = {link: axes_from_sizes(sizes) for link, sizes in links.items()}
    exact_axes = {}
    for link, sizes in links.items():
        link_table = document.data["links"][link]
        arcs = tuple(map(_degrees_to_radians, link_table.get("arcs", ())))
        angles = tuple(map(_degrees_to_radians, link_table.get("angles", ())))
        exact_sizes = LinkSizes(sizes.axes, arcs, angles)
        exact_axes[link] = {
            name: np.asarray(axis, dtype=quad())
            for name, axis in axes_from_sizes(exact_sizes).items()
        }
    # The number "zero" of a pair in the file is an angle from the x axis of its first
    # frame. If the x axis of the second frame is there, the variable is zero. The first
    # frame is therefore rotated by this angle.
    zeros = _angles_of_pairs(document, "zero")
    frames: dict[int, Frames] = {}
    for number, pair in enumerate(mechanism.pairs):
        first_link, second_link = pair.links
        first = _reference_frame(exact_axes[first_link], float_axes[first_link], pair.name)
        second = _reference_frame(
            exact_axes[second_link], float_axes[second_link], pair.name
        )
        if pair.name in zeros:
            first = multiply_matrices(first, rotate_about_z(zeros[pair.name]))
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

    Its columns are x, y and z axis. The z axis is the axis itself. The x axis points
    towards the first other axis of the link that is not collinear with this one. If there
    is none, it is normal to the coordinate axis that differs most from the axis.

    Parameters
    ----------
    axes
        Unit vectors (3,) of the axes of the link in quad precision, by the name of the
        pair.
    float_axes
        The same vectors in float64. They decide which axes are collinear, as in all float64
        computations.
    name
        Name of the pair whose frame is computed.
    """
    axis = axes[name]
    for reference_name, reference in axes.items():
        cross_product = np.cross(float_axes[name], float_axes[reference_name])
        if np.linalg.norm(cross_product) > COLLINEAR_SINE:
            # The part of the reference axis that is normal to the axis.
            normal_part = reference - dot(axis, reference)[..., None] * axis
            return make_frame(axis, normalize(normal_part))
    return _frame_without_reference(axis, float_axes[name])


def _frame_without_reference(axis: Array, float_axis: Floats) -> Array:
    """Return the frame (3, 3) of an axis (3,) if no other axis fixes its x axis.

    The x axis is perpendicular to the coordinate axis that differs most from the axis.
    """
    coordinate_axis = np.eye(3)[np.argmin(np.abs(float_axis))].astype(quad())
    return make_frame(axis, normalize(np.cross(axis, coordinate_axis)))
