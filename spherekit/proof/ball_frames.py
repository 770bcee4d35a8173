"""Vectors of balls, and the frames of R pairs in their links.

A frame (3, 3) has three unit vectors as its rows: zero direction, side, axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats
from spherekit.mechanism.elements import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes
from spherekit.proof.balls import Ball, library


def exactly(values: ArrayLike) -> Array:
    """Return float64 numbers without error."""
    return np.asarray(np.frompyfunc(library().arb, 1, 1)(np.asarray(values, dtype=float)))


def exact(number: float) -> Ball:
    """Return a float64 number without error."""
    return library().arb(float(number))


Vector = Array


Frame = Array


Frames = dict[str, tuple[Frame, Frame]]
"""The frames of R pairs in their first and their second link, by name."""


def unit(a: Vector) -> Vector:
    """Return a vector over its length."""
    return a / np.sqrt(a @ a)


def turned(frame: Frame, angle: Ball) -> Frame:
    """Return a frame turned about its axis by an angle (rad)."""
    (s, c), (x, y, z) = angle.sin_cos(), frame
    return np.stack([c * x + s * y, c * y - s * x, z])


def revolute(first: Frame, second: Frame) -> Array:
    """Return (3, 3, 3) how an R pair turns its second link in the first, by its frames.

    By the sum of these times 1, the cosine and the sine of its angle.
    """
    (x, y, z), nothing = first, 0 * first[0]
    moved = [[nothing, nothing, z], [x, y, nothing], [y, -x, nothing]]
    return np.array(moved).swapaxes(1, 2) @ second


def axes_about(centre: Vector) -> Frame:
    """Return the axes from which azimuths about a unit vector are counted, and it."""
    helper = np.eye(3)[1 if abs(float(centre[0])) > 0.9 else 0]
    return _frame(centre, helper - (helper @ centre) * centre)


def frames_of_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    sizes: Mapping[str, Sequence[Sequence[Ball]]],
    zeros: Mapping[str, Ball],
) -> Frames:
    """Return frames from arcs and angles (rad) of links.

    Those of float64 say which axes are on a line.
    """
    near = {link: axes_from_sizes(given) for link, given in geometry.links.items()}
    axes = {}
    for link, (arcs, turns) in sizes.items():
        given = LinkSizes(geometry.links[link].axes, tuple(arcs), tuple(turns))
        placed = axes_from_sizes(given).items()
        axes[link] = {name: axis + exact(0.0) for name, axis in placed}
    made = {}
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            first, second = (
                _reference_frame(axes[link], near[link], pair.name) for link in pair.links
            )
            made[pair.name] = turned(first, zeros.get(pair.name, exact(0.0))), second
    return made


def frames_of_pose(
    geometry: PoseGeometry, axes: Mapping[str, Vector], values: Mapping[str, Ball]
) -> Frames:
    """Return frames from unit axes in the reference pose, and the pairs' values there."""
    made = {}
    for name, near in geometry.axes.items():
        first = _across(axes[name], np.array(near))
        made[name] = first, turned(first, values.get(name, exact(0.0)))
    return made


def declared_frames(mechanism: Mechanism) -> Frames:
    """Return the frames with all sizes as the float64 numbers that they are."""
    given = mechanism.geometry
    if isinstance(given, PoseGeometry):
        axes = {name: unit(exactly(axis)) for name, axis in given.axes.items()}
        return frames_of_pose(given, axes, _exact(given.values))
    sizes = {
        link: [[*exactly(near.arcs)], [*exactly(near.angles)]]
        for link, near in given.links.items()
    }
    return frames_of_sizes(mechanism, given, sizes, _exact(given.zeros))


def _exact(numbers: Mapping[str, float]) -> dict[str, Ball]:
    return {name: exact(number) for name, number in numbers.items()}


def _reference_frame(
    axes: Mapping[str, Vector], near: Mapping[str, Floats], name: str
) -> Frame:
    """Return the frame of an axis; its x axis leads to the first other axis."""
    axis = axes[name]
    for other, direction in axes.items():
        if np.linalg.norm(np.cross(near[name], near[other])) > COLLINEAR_SINE:
            return _frame(axis, np.cross(np.cross(axis, direction), axis))
    return _across(axis, near[name])


def _across(axis: Vector, near: Floats) -> Frame:
    """Return the frame of an axis that no other one gives a direction."""
    return _frame(axis, np.cross(axis, np.eye(3)[np.argmin(np.abs(near))]))


def _frame(axis: Vector, toward: Vector) -> Frame:
    """Return the frame of an axis with its x axis along a vector across it."""
    first = unit(toward)
    return np.stack([first, np.cross(axis, first), axis])
