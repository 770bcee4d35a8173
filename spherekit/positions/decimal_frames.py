"""Pair frames in quad precision, from the decimal numbers of a mechanism file.

The links have the decimal sizes of the file, 64.02 degrees for example, and not the nearest
float64 numbers. The mechanism is written as a file in degrees and read again, which
restores the decimals.

The z axis of a pair frame is the pair axis. Its x axis is the direction from which the pair
variable is measured. It is chosen by the same rule as in float64
(`spherekit.mechanism.pair_frames.pair_frames`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.files.mechanism_writer import canonical_text
from spherekit.files.toml_document import Document, LiteralNumber, parse
from spherekit.geometry.vectors import dot
from spherekit.mechanism.elements import LinkSizes, Pair, PoseGeometry
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
    """Return the frames of all pairs of a mechanism of R pairs, in quad precision.

    The caller places the links with these frames. Near a dead centre, float64 angles would
    lose half of their digits. The frames are computed from the decimal numbers of the
    mechanism file, such as 64.02 degrees. Float64 numbers would have errors of 1e-16.

    Returns
    -------
    The frames (3, 3) of each pair in its first and in its second link, by the index of the
    pair. The columns of a frame are axes in link axes; the last one is the pair axis.
    """
    # Loads and user data are left out: they can be Python objects, which cannot be written
    # to a file.
    written = replace(mechanism, loads=(), user={})
    document = parse(canonical_text(written, "deg"), mechanism.name)
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        # The file has the axes of all pairs in one configuration, the reference pose. The
        # "value" of a pair is its angle in this pose.
        angles_in_pose = _read_pair_angles(document, "value")
        # `geometry.axes` is in float64. `_frames_from_pose` restores the decimals of the
        # file.
        frames_by_name = _frames_from_pose(geometry.axes, angles_in_pose)
    else:
        # The file has the sizes of each link, which are angles between its pair axes. The
        # "zero" of a pair is an angle by which its frame in the first link is turned.
        axes_by_link = {
            link: _read_link_axes(sizes, document.data["links"][link])
            for link, sizes in geometry.links.items()
        }
        zero_angles = _read_pair_angles(document, "zero")
        frames_by_name = _frames_from_sizes(mechanism.pairs, axes_by_link, zero_angles)
    return {mechanism.pair_number[name]: frames for name, frames in frames_by_name.items()}


def _frames_from_pose(
    axes: Mapping[str, Sequence[float]], angles: Mapping[str, Any]
) -> dict[str, Frames]:
    """Return the frames of pairs whose axes are stated in a reference pose.

    In this pose the coordinate systems of all links and of the ground coincide, so a pair
    axis has the same components in both links. A pair has a frame in each of its two links,
    with z along its axis. The second frame is the first one, rotated about z by the pair
    variable. The x axis of the first frame is arbitrary, because only the angle between
    both frames matters.

    Parameters
    ----------
    axes
        Axis (3,) of each pair in the reference pose, by the name of the pair.
    angles
        Pair variables in the reference pose (rad, quad precision), by the name of the pair.
        Pairs that are left out have the variable 0.

    Returns
    -------
    For the name of each pair its frames (3, 3) in the first and in the second link.
    """
    frames: dict[str, Frames] = {}
    for name, axis in axes.items():
        # `repr` returns the shortest decimal number that float64 rounds to this number.
        # This is the number of the file, if it has at most 15 digits and was not scaled.
        exact_axis = normalize(_parse_decimals([repr(float(x)) for x in axis]))
        # The axis in float64 decides which x axis is chosen. The choice is then the same as
        # in computations with float64.
        first = _frame_with_any_x_axis(exact_axis, np.array(axis, dtype=float))
        second = first
        if name in angles:
            second = multiply_matrices(first, rotate_about_z(angles[name]))
        frames[name] = first, second
    return frames


@dataclass(frozen=True)
class _LinkAxes:
    """Unit vectors (3,) of the pair axes of a link, by the name of the pair.

    Attributes
    ----------
    exact
        The vectors in quad precision.
    rounded
        The same vectors in float64. Whether two axes are collinear is decided with these
        vectors, so that the decision is the same as in computations with float64.
    """

    exact: Mapping[str, Array]
    rounded: Mapping[str, Floats]

    def frame(self, name: str) -> Array:
        """Return the frame (3, 3) of a pair in this link, in quad precision (33 digits).

        The z axis is the pair axis. The x axis points to the first other axis of the link
        that is not collinear with the pair axis. If there is none, x is any normal
        direction. This is the rule in float64, so the pair variable has the same zero.
        """
        axis = self.exact[name]
        for other_name, other_axis in self.exact.items():
            cross_product = np.cross(self.rounded[name], self.rounded[other_name])
            if np.linalg.norm(cross_product) > COLLINEAR_SINE:
                # The part of the other axis that is normal to the pair axis.
                normal_part = other_axis - dot(axis, other_axis)[..., None] * axis
                return make_frame(axis, normalize(normal_part))
        return _frame_with_any_x_axis(axis, self.rounded[name])


def _read_link_axes(sizes: LinkSizes, link_table: Mapping[str, Any]) -> _LinkAxes:
    """Return the pair axes of a link, in quad precision and in float64.

    The frames of the pairs are made from the axes in quad precision. The axes in float64
    decide which axes are collinear, as in computations with float64.

    Parameters
    ----------
    sizes
        The arcs and angles (rad) in float64.
    link_table
        The table of the link in the mechanism file. It has the same arcs and angles in
        degrees, as decimal numbers without rounding errors.
    """
    exact_sizes = LinkSizes(
        sizes.axes,
        arcs=tuple(map(_degrees_to_radians, link_table.get("arcs", ()))),
        angles=tuple(map(_degrees_to_radians, link_table.get("angles", ()))),
    )
    exact_axes = {
        name: np.asarray(axis, dtype=quad())
        for name, axis in axes_from_sizes(exact_sizes).items()
    }
    return _LinkAxes(exact=exact_axes, rounded=axes_from_sizes(sizes))


def _frames_from_sizes(
    pairs: Sequence[Pair],
    axes_by_link: Mapping[str, _LinkAxes],
    zero_angles: Mapping[str, Any],
) -> dict[str, Frames]:
    """Return the frames of pairs, computed from the pair axes of their links.

    The axes come from the sizes of the links in the file, such as arcs between axes. A pair
    has a frame in each of its two links, with z along its axis. Its variable is zero where
    both frames coincide.

    Parameters
    ----------
    pairs
        The pairs.
    axes_by_link
        The pair axes of each link.
    zero_angles
        Angle (rad, quad precision) by which the frame of a pair in its first link is
        rotated about the pair axis, by the name of the pair. This moves the zero of the
        variable. Pairs that are left out have the angle 0.

    Returns
    -------
    For the name of each pair its frames (3, 3) in the first and in the second link.
    """
    frames: dict[str, Frames] = {}
    for pair in pairs:
        first_link, second_link = pair.links
        first = axes_by_link[first_link].frame(pair.name)
        second = axes_by_link[second_link].frame(pair.name)
        if pair.name in zero_angles:
            first = multiply_matrices(first, rotate_about_z(zero_angles[pair.name]))
        frames[pair.name] = first, second
    return frames


def _read_pair_angles(document: Document, key: str) -> dict[str, Any]:
    """Return the angles (rad, quad precision) that a mechanism file states for its pairs.

    The key in the file is "value" or "zero". The result maps names of pairs to angles.
    Pairs without the key are left out.
    """
    pairs: Mapping[str, Any] = document.data["pairs"]
    return {
        name: _degrees_to_radians(item[key]) for name, item in pairs.items() if key in item
    }


def _degrees_to_radians(number: float) -> Any:
    """Return an angle in rad, in quad precision, from a number of a file in degrees.

    A `LiteralNumber` has the text of the file. Other numbers are taken as Python writes
    them.
    """
    text = number.text if isinstance(number, LiteralNumber) else repr(number)
    return _parse_decimals([text])[0] * (quad_pi() / 180)


def _parse_decimals(texts: Sequence[str]) -> Array:
    """Return decimal numbers (k,) in quad precision, from k texts.

    Underscores between digits are removed, which quad numbers do not accept.
    """
    return np.array([text.replace("_", "") for text in texts]).astype(quad())


def _frame_with_any_x_axis(axis: Array, rounded_axis: Floats) -> Array:
    """Return a frame (3, 3) with a given z axis (3,), if no other axis fixes its x axis.

    The x axis is normal to z and to the coordinate axis that differs most from z. The
    rounded axis (float64) decides which one this is, so that the result agrees with the
    frame that is computed in float64.
    """
    coordinate_axis = np.eye(3)[np.argmin(np.abs(rounded_axis))].astype(quad())
    return make_frame(axis, normalize(np.cross(axis, coordinate_axis)))
