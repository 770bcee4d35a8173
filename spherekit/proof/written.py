"""The geometry of a mechanism as balls around the numbers of its file as they are written.

An angle of 45.1 degrees is 45.1 pi / 180 here, and no float64 number next to it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.errors import PlanError
from spherekit.files.document import Document, LiteralNumber, parse
from spherekit.files.read import read
from spherekit.files.write import dumps
from spherekit.model.geometry import COLLINEAR, link_axes
from spherekit.model.mechanism import Mechanism, PoseGeometry
from spherekit.proof.balls import Ball, decimal, exact, pi, wide

Vector = tuple[Ball, Ball, Ball]
Frame = tuple[Vector, Vector, Vector]
"""The unit vectors of a pair in one of its links: zero direction, side, axis."""


@final
@dataclass(frozen=True)
class Written:
    """A mechanism with the text of its file, and by how much its sizes may be off.

    `tolerance` (rad) is that of every arc, angle, zero and direction of the file.
    """

    mechanism: Mechanism
    document: Document
    tolerance: float = 0.0

    @staticmethod
    def of(
        mechanism: Mechanism, document: Document | None = None, tolerance: float = 0.0
    ) -> "Written":
        """Return a mechanism with its document, by default the one it is written as.

        Raises
        ------
        PlanError
            If it has contact pairs, or the tolerance is negative.
        """
        contact = [pair.name for pair in mechanism.pairs if not pair.kind.has_axis]
        if contact:
            raise PlanError(
                f"{mechanism.name}: pair {contact[0]} is a contact pair; proofs are for "
                "mechanisms with R and P pairs only"
            )
        if not 0.0 <= tolerance < 0.1:
            raise PlanError(
                f"a tolerance of {tolerance} rad makes no sense; give 1e-9, say"
            )
        if document is None:
            document = parse(dumps(mechanism), mechanism.name)
            assert read(document) == mechanism or mechanism.user
        return Written(mechanism, document, tolerance)

    def frames(self) -> dict[str, tuple[Frame, Frame]]:
        """Return the frames of every pair in its first and its second link."""
        if isinstance(self.mechanism.geometry, PoseGeometry):
            return self._pose_frames(self.mechanism.geometry)
        return self._size_frames()

    def angle(self, number: float, tolerance: bool = True) -> Ball:
        """Return an angle of the file in rad."""
        turn = pi() / 180 if self.document.data["angle_unit"] == "deg" else exact(1.0)
        return wide(_number(number) * turn, self.tolerance if tolerance else 0.0)

    def input_angle(self, text: str) -> Ball:
        """Return an input given as a decimal number in the unit of the file, in rad."""
        return self.angle(LiteralNumber(text), tolerance=False)

    def input_range(self, pair: str) -> tuple[str, str]:
        """Return the ends of the range of an input as the file has them."""
        item = self.document.data.get("inputs", {}).get(pair, {})
        turn = "360" if self.document.data["angle_unit"] == "deg" else repr(2 * math.pi)
        return _text(item.get("from", 0)), _text(item["to"]) if "to" in item else turn

    def _size_frames(self) -> dict[str, tuple[Frame, Frame]]:
        near = link_axes(self.mechanism)
        data = self.document.data
        axes = {link: self._axes(item) for link, item in data["links"].items()}
        made = {}
        for pair in self.mechanism.pairs:
            first, second = (
                _reference_frame(axes[link], near[link], pair.name) for link in pair.links
            )
            zero = data["pairs"][pair.name].get("zero")
            made[pair.name] = (first if zero is None else self._turned(first, zero), second)
        return made

    def _axes(self, item: Mapping[str, Any]) -> dict[str, Vector]:
        """Return the unit axes of a link in its own frame, in the order listed."""
        names = item.get("axes", [])
        found: dict[str, Vector] = {}
        angles = [None, *item.get("angles", [])]
        for name in names[:1]:
            found[name] = (exact(0.0), exact(0.0), exact(1.0))
        for name, length, turn in zip(
            names[1:], item.get("arcs", []), angles, strict=False
        ):
            across, up = self.angle(length).sin_cos()
            s, c = exact(0.0).sin_cos() if turn is None else self.angle(turn).sin_cos()
            found[name] = (-across * s, across * c, up)
        return found

    def _pose_frames(self, given: PoseGeometry) -> dict[str, tuple[Frame, Frame]]:
        made = {}
        for name, near in given.axes.items():
            item = self.document.data["pairs"][name]
            axis = self._axis(item)
            helper = [exact(0.0)] * 3
            helper[int(np.argmin(np.abs(near)))] = exact(1.0)
            across = unit(cross(axis, (helper[0], helper[1], helper[2])))
            first = (across, cross(axis, across), axis)
            value = item.get("value")
            made[name] = (first, first if value is None else self._turned(first, value))
        return made

    def _axis(self, item: Mapping[str, Any]) -> Vector:
        for key in ("through_xyz", "through_lonlat"):
            if key in item:
                one, other = (
                    self._direction(row, key.endswith("xyz")) for row in item[key]
                )
                return unit(cross(one, other))
        key = "xyz" if "xyz" in item else "lonlat"
        return self._direction(item[key], key == "xyz")

    def _direction(self, row: Any, is_xyz: bool) -> Vector:
        if is_xyz:
            x, y, z = (_number(number) for number in row)
            x, y, z = unit((x, y, z))
            slack = self.tolerance
            return wide(x, slack), wide(y, slack), wide(z, slack)
        longitude, latitude = (self.angle(number) for number in row)
        (s, c), (up, across) = longitude.sin_cos(), latitude.sin_cos()
        return c * across, s * across, up

    def _turned(self, frame: Frame, number: float) -> Frame:
        s, c = self.angle(number).sin_cos()
        x, y, z = frame
        ahead = [c * a + s * b for a, b in zip(x, y, strict=True)]
        side = [c * b - s * a for a, b in zip(x, y, strict=True)]
        return (ahead[0], ahead[1], ahead[2]), (side[0], side[1], side[2]), z


def _text(number: float) -> str:
    return number.text if isinstance(number, LiteralNumber) else str(number)


def _number(number: float) -> Ball:
    """Return a number of a file as it is written."""
    if isinstance(number, LiteralNumber):
        return decimal(number.text.replace("_", ""))
    return exact(number)


def _reference_frame(
    axes: Mapping[str, Vector], near: Mapping[str, Any], name: str
) -> Frame:
    """Return the frame of an axis; its x axis leads to the first other axis.

    Which one that is follows from the float64 axes `near`.
    """
    axis = axes[name]
    for other, direction in axes.items():
        side = np.linalg.norm(np.cross(near[name], near[other]))
        if other != name and side > COLLINEAR:
            toward = unit(cross(cross(axis, direction), axis))
            return toward, cross(axis, toward), axis
    helper = [exact(0.0)] * 3
    helper[int(np.argmin(np.abs(near[name])))] = exact(1.0)
    across = unit(cross(axis, (helper[0], helper[1], helper[2])))
    return across, cross(axis, across), axis


def dot(a: Vector, b: Vector) -> Ball:
    """Return the product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def unit(a: Vector) -> Vector:
    """Return a vector over its length."""
    length = dot(a, a).sqrt()
    return a[0] / length, a[1] / length, a[2] / length
