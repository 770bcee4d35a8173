"""The geometry of a mechanism as balls around the numbers of its file as they are written.

An angle of 45.1 degrees is 45.1 pi / 180 here, and no float64 number next to it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, final

import numpy as np

from spherekit.errors import PlanError
from spherekit.files.document import Document, LiteralNumber, parse
from spherekit.files.read import read
from spherekit.files.write import dumps
from spherekit.model.geometry import COLLINEAR, axes_from_sizes
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry, SizeGeometry
from spherekit.proof.balls import Ball, decimal, exact, middle, pi, wide
from spherekit.proof.circles import Touching, touching
from spherekit.proof.gears import Train, carried_wheels, train_of
from spherekit.proof.structure import Structure, structure_of
from spherekit.proof.vectors import Frame, Vector, cross, unit

PHASE = 1e-13
"""A start that the reader finds of a phase is known to this (rad)."""


@final
@dataclass(frozen=True)
class Written:
    """A mechanism with the text of its file, and by how much its sizes may be off.

    `tolerance` (rad) is that of every arc, angle, zero and direction of the file.
    `structure` are the links and R pairs that it stands for, `train` its wheels in mesh.
    """

    mechanism: Mechanism
    document: Document
    tolerance: float
    structure: Structure
    train: Train | None = None

    @staticmethod
    def of(
        mechanism: Mechanism, document: Document | None = None, tolerance: float = 0.0
    ) -> "Written":
        """Return a mechanism with its document, by default the one it is written as.

        Raises
        ------
        PlanError
            If it has contacts that are not of circles, or circles that roll by what does
            not follow from the inputs, or the tolerance is negative.
        """
        structure = structure_of(mechanism)
        if not 0.0 <= tolerance < 0.1:
            raise PlanError(
                f"a tolerance of {tolerance} rad makes no sense; give 1e-9, say"
            )
        if document is None:
            document = parse(dumps(mechanism), mechanism.name)
            assert read(document) == mechanism or mechanism.user
        made = Written(mechanism, document, tolerance, structure)
        return made._in_mesh() if structure.wheels else made

    def frames(self) -> list[tuple[Frame, Frame]]:
        """Return the frames of every pair of the structure in its two links."""
        given = self.mechanism.geometry
        if isinstance(given, PoseGeometry):
            made = self._pose_frames(given)
        else:
            made = self._size_frames()
        frames = [made[name] for name in self.structure.pairs if name in made]
        for coupler in self.structure.couplers:
            pair = self.mechanism.pairs[coupler.contact]
            frames += _coupler_frames(touching(self, pair, made))
        return frames

    def given(self, inputs: Sequence[Ball]) -> list[Ball]:
        """Return the angles (rad) of the inputs and of all pairs that follow from them."""
        if self.train is None:
            return list(inputs)
        frames = self.frames()
        touches = [self._touching(mesh.contact) for mesh in self.train.meshes]
        starts = [self._starts(mesh.contact) for mesh in self.train.meshes]
        return [*inputs, *self.train.angles(touches, starts, frames, inputs)]

    def ratios(self) -> list[list[Ball]]:
        """Return the rates (followers, inputs) of the angles that wheels fix."""
        if self.train is None:
            return []
        return self.train.ratios([self._touching(m.contact) for m in self.train.meshes])

    def exact_ratios(self) -> list[Fraction] | None:
        """Return the rates of the followers by the only input, None if not exact."""
        if self.train is None:
            return []
        touches = [self._touching(m.contact) for m in self.train.meshes]
        return self.train.exact_ratios(touches)

    def motion_columns(self) -> list[tuple[str, float]]:
        """Return the column of the table motion and the factor of each pair's angle.

        The angles of couplers are lengths over the sines of radii there.
        """
        columns = [(f"theta_{name}", 1.0) for name in self.structure.pairs]
        frames = dict(zip(self.structure.pairs, self.frames(), strict=True))
        for coupler in self.structure.couplers:
            pair = self.mechanism.pairs[coupler.contact]
            contact = touching(self, pair, frames)
            names = pair.kind.variable_names(pair.name, pair.links)
            for side, sense in ((0, 1), (1, contact.sense)):
                sine = middle(contact.circles[side].radius.sin())
                columns[coupler.pairs[side]] = names[side], sense / sine
        return columns

    def item(self, pair: str) -> Mapping[str, Any]:
        """Return the table of a pair in the file."""
        table: Mapping[str, Any] = self.document.data["pairs"][pair]
        return table

    def _touching(self, contact: int) -> Touching:
        frames = dict(zip(self.structure.pairs, self.frames(), strict=True))
        return touching(self, self.mechanism.pairs[contact], frames)

    def _starts(self, contact: int) -> tuple[Ball, Ball]:
        """Return the lengths (rad) along both circles at which a contact starts."""
        pair = self.mechanism.pairs[contact]
        item = self.item(pair.name)
        if "phase" in item:
            one, other = (wide(exact(length), PHASE) for length in pair.start)
            return one, other
        one, other = (self.angle(length, False) for length in item.get("start", (0.0, 0.0)))
        return one, other

    def _in_mesh(self) -> "Written":
        """Return the same with its wheels in mesh."""
        structure, mechanism = self.structure, self.mechanism
        frames = self.frames()
        meshes = []
        for contact in structure.wheels:
            pair, wheels = mechanism.pairs[contact], mechanism.ends[contact]
            touch = self._touching(contact)
            made = carried_wheels(structure, contact, wheels, touch, frames)
            if made is None:
                raise PlanError(
                    f"{mechanism.name}: pair {pair.name} is a rolling contact, and no link "
                    f"carries {pair.links[0]} and {pair.links[1]} each about the centre of "
                    "its circle so that they touch; of rolling contacts proofs are for "
                    "wheels that a link carries so, and for sliding contacts of circles"
                )
            meshes.append(made)
        given = mechanism.geometry
        reference = None
        if isinstance(given, PoseGeometry):
            names = structure.pairs
            values = (self.item(axis).get("value") for axis in given.axes)
            reference = {
                names.index(name): exact(0.0) if value is None else self.angle(value)
                for name, value in zip(given.axes, values, strict=True)
            }
        touches = [self._touching(contact) for contact in structure.wheels]
        starts = [self._starts(contact) for contact in structure.wheels]
        train = train_of(structure, meshes, touches, starts, frames, reference)
        meshed = replace(structure, followers=train.followers)
        return replace(self, structure=meshed, train=train)

    def angle(self, number: float, tolerance: bool = True) -> Ball:
        """Return an angle of the file in rad."""
        turn = pi() / 180 if self.document.data["angle_unit"] == "deg" else exact(1.0)
        return wide(_number(number) * turn, self.tolerance if tolerance else 0.0)

    def input_angle(self, text: str) -> Ball:
        """Return an input given as a decimal number in the unit of the file, in rad."""
        return self.angle(LiteralNumber(text), tolerance=False)

    def input_range(self, pair: str) -> tuple[str, str]:
        """Return the ends of an input's range as the file has them, the lower first."""
        item = self.document.data.get("inputs", {}).get(pair, {})
        turn = "360" if self.document.data["angle_unit"] == "deg" else repr(2 * math.pi)
        ends = _text(item.get("from", 0)), _text(item["to"]) if "to" in item else turn
        low, high = sorted(ends, key=float)
        return low, high

    def _size_frames(self) -> dict[str, tuple[Frame, Frame]]:
        given = self.mechanism.geometry
        assert isinstance(given, SizeGeometry)
        near = {link: axes_from_sizes(sizes) for link, sizes in given.links.items()}
        data = self.document.data
        axes = {link: self._axes(item) for link, item in data["links"].items()}
        made = {}
        for pair in self.mechanism.pairs:
            if not pair.kind.has_axis:
                continue
            first, second = (
                _reference_frame(axes[link], near[link], pair.name) for link in pair.links
            )
            zero = data["pairs"][pair.name].get("zero")
            made[pair.name] = (first if zero is None else self._turned(first, zero), second)
        return made

    def _axes(self, item: Mapping[str, Any]) -> dict[str, Vector]:
        """Return the unit axes of a link in its own frame, in the order listed."""
        names = item.get("axes", [])
        axes: dict[str, Vector] = {}
        angles = [None, *item.get("angles", [])]
        for name in names[:1]:
            axes[name] = (exact(0.0), exact(0.0), exact(1.0))
        for name, length, turn in zip(
            names[1:], item.get("arcs", []), angles, strict=False
        ):
            across, up = self.angle(length).sin_cos()
            s, c = exact(0.0).sin_cos() if turn is None else self.angle(turn).sin_cos()
            axes[name] = (-across * s, across * c, up)
        return axes

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
                one, other = (self.direction(row, key.endswith("xyz")) for row in item[key])
                return unit(cross(one, other))
        key = "xyz" if "xyz" in item else "lonlat"
        return self.direction(item[key], key == "xyz")

    def direction(self, row: Any, is_xyz: bool) -> Vector:
        """Return a direction of the file, by coordinates or longitude and latitude."""
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


def _coupler_frames(contact: Touching) -> list[tuple[Frame, Frame]]:
    """Return the frames of both pairs of a coupler, in the link of the contact and in it.

    The angle of each is the azimuth of the contact about the centre.
    """
    sine, cosine = contact.arc.sin_cos()
    zero, one = exact(0.0), exact(1.0)
    axes = (zero, zero, one), (zero, sine, cosine)
    toward = contact.towards(*axes)
    return [
        (circle.axes, (ahead, cross(axis, ahead), axis))
        for circle, axis, ahead in zip(contact.circles, axes, toward, strict=True)
    ]
