"""Vectors of balls and the frames of R pairs in their links.

A frame (3, 3) has three unit vectors as its rows: zero direction, side, axis.
"""

from collections.abc import Mapping

import numpy as np

from spherekit.model.geometry import COLLINEAR, axes_from_sizes
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry, SizeGeometry
from spherekit.proof.balls import Ball, Balls, exactly
from spherekit.sphere.rotation import Floats

Vector = Balls
Frame = Balls
Frames = dict[str, tuple[Frame, Frame]]
"""The frames of R pairs in their first and their second link, by name."""
Arcs = tuple[list[Ball], list[Ball]]
"""The arcs and angles (rad) of a link, as `LinkSizes` has them."""


def unit(a: Vector) -> Vector:
    """Return a vector over its length."""
    square: Ball = a @ a
    return np.asarray(a / square.sqrt())


def carried(vector: Vector, start: Frame, goal: Frame) -> Vector:
    """Return the vector that has in one frame the coordinates that another has in a second.

    `vector` is in the axes in which `start` is given, the result in those of `goal`.
    """
    return np.asarray(goal.T @ (start @ vector))


def turned(frame: Frame, angle: Ball) -> Frame:
    """Return a frame turned about its axis by an angle (rad)."""
    (s, c), (x, y, z) = angle.sin_cos(), frame
    return np.stack([c * x + s * y, c * y - s * x, z])


def axes_about(centre: Vector) -> Frame:
    """Return the axes from which azimuths about a unit vector are counted, and it."""
    helper = np.eye(3)[1 if abs(float(centre[0])) > 0.9 else 0]
    first = unit(helper - (helper @ centre) * centre)
    return np.stack([first, np.cross(centre, first), centre])


def frames_of_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    sizes: Mapping[str, Arcs],
    zeros: Mapping[str, Ball],
) -> Frames:
    """Return frames from arcs and angles; those of float64 say which axes are on a line."""
    near = {link: axes_from_sizes(given) for link, given in geometry.links.items()}
    axes = {
        link: dict(zip(geometry.links[link].axes, _axes(*given), strict=False))
        for link, given in sizes.items()
    }
    made = {}
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            first, second = (
                _reference_frame(axes[link], near[link], pair.name) for link in pair.links
            )
            zero = zeros.get(pair.name)
            made[pair.name] = first if zero is None else turned(first, zero), second
    return made


def frames_of_pose(
    geometry: PoseGeometry, axes: Mapping[str, Vector], values: Mapping[str, Ball]
) -> Frames:
    """Return frames from unit axes in the reference pose, and the pairs' values there."""
    made = {}
    for name, near in geometry.axes.items():
        first = _across(axes[name], np.array(near))
        value = values.get(name)
        made[name] = first, first if value is None else turned(first, value)
    return made


def declared_frames(mechanism: Mechanism) -> Frames:
    """Return the frames with all sizes as the float64 numbers that they are."""
    given = mechanism.geometry
    if isinstance(given, PoseGeometry):
        axes = {name: unit(exactly(axis)) for name, axis in given.axes.items()}
        return frames_of_pose(given, axes, _exact(given.values))
    sizes: dict[str, Arcs] = {
        link: (list(exactly(sizes_of_link.arcs)), list(exactly(sizes_of_link.angles)))
        for link, sizes_of_link in given.links.items()
    }
    return frames_of_sizes(mechanism, given, sizes, _exact(given.zeros))


def _exact(numbers: Mapping[str, float]) -> dict[str, Ball]:
    return dict(zip(numbers, exactly(list(numbers.values())), strict=True))


def _axes(arcs: list[Ball], angles: list[Ball]) -> list[Vector]:
    """Return the unit axes of a link in its sizes_of_link frame, in the order listed."""
    axes = [exactly([0.0, 0.0, 1.0])]
    for length, turn in zip(arcs, [*exactly([0.0]), *angles], strict=False):
        (across, up), (s, c) = length.sin_cos(), turn.sin_cos()
        axes.append(np.array([-across * s, across * c, up]))
    return axes


def _reference_frame(
    axes: Mapping[str, Vector], near: Mapping[str, Floats], name: str
) -> Frame:
    """Return the frame of an axis; its x axis leads to the first other axis."""
    axis = axes[name]
    for other, direction in axes.items():
        side = np.linalg.norm(np.cross(near[name], near[other]))
        if other != name and side > COLLINEAR:
            toward = unit(np.cross(np.cross(axis, direction), axis))
            return np.stack([toward, np.cross(axis, toward), axis])
    return _across(axis, near[name])


def _across(axis: Vector, near: Floats) -> Frame:
    """Return the frame of an axis that no other one gives a direction."""
    helper = np.eye(3)[int(np.argmin(np.abs(near)))]
    across = unit(np.cross(axis, helper))
    return np.stack([across, np.cross(axis, across), axis])
