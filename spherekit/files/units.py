"""Values of a file as the model has them: radians, unit vectors, fields of its classes.

Which values are angles, rates and directions is said by the schema. Which key is which
field of a class of the model is said here, for reading and for writing.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from spherekit.files.angle_units import (
    LARGEST_RADIANS,
    direction,
    to_radians,
    to_text,
    unit_vector,
)
from spherekit.files.schema import Kind, Leaves, walked
from spherekit.files.time_law import ConstantSpeed, Cycloidal, Polynomial, Tabulated
from spherekit.files.toml_document import Document, LiteralNumber, Table
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.elements import (
    Input,
    LinkSizes,
    Output,
    Pair,
    Profile,
    Source,
    as_vector,
)
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.sizes import AngleUnit, Vector

Part = TypeVar("Part")


def _same(names: str) -> dict[str, str]:
    """Return keys that have the names of their fields."""
    return {name: name for name in names.split()}


KEYS: Mapping[type, Mapping[str, str]] = {
    Source: _same("citation assumed"),
    LinkSizes: _same("axes arcs angles") | {"signed_arcs": "signed"} | _same("unpaired"),
    Pair: _same("type links contact start one_sided distance pressure_angle"),
    Profile: _same("kind")
    | {"centre_xyz": "centre", "centre_lonlat": "centre"}
    | _same("radius")
    | {"points_xyz": "points"}
    | _same("points closed cosines sines"),
    Input: {"from": "start", "to": "stop"},
    Output: {"link": "link", "relative_to": "relative_to", "xyz": "direction"},
    Mass: _same("tensor mass centre"),
    JointLimit: {"from": "low", "to": "high"},
    ConstantSpeed: {"speed": "speed", "from": "start"},
    Polynomial: _same("coefficients"),
    Cycloidal: {"from": "start", "to": "stop", "duration": "duration"},
    Tabulated: _same("times angles rest_at_ends"),
}
"""The fields of classes of the model by their keys in files, in the order of writing."""


def made(kind: Callable[..., Part], item: Table, more: Table | None = None) -> Part:
    """Return what a table of converted values states; `more` has the other fields."""
    keys = KEYS[kind]  # type: ignore[index]
    given = {keys[key]: value for key, value in item.items() if key in keys}
    return kind(**(more or {}), **given)


def table_of(part: Any) -> dict[str, Any]:
    """Return the table that states a part, without what is as by default."""
    defaults = {item.name: item.default for item in fields(part)}
    table, written = {}, set()
    for key, name in KEYS[type(part)].items():
        value = getattr(part, name)
        if name not in written and np.any(value != defaults[name]):
            table[key] = value
        written.add(name)
    return table


def converted(document: Document, data: Table, kind: Kind = "mechanism") -> Any:
    """Return data of a document that fit the format, as the model has them.

    Angles are in rad, directions unit vectors, arrays tuples.

    Raises
    ------
    FileError
        Where a number makes no sense as what it is; of data without text `ModelError`.
    """
    unit: AngleUnit = document.data.get("angle_unit", "rad")

    def angle(path: KeyPath, number: float) -> float:
        if unit == "rad" and abs(number) > LARGEST_RADIANS:
            raise document.fault(
                path,
                f"found {float(number)} rad, more than two turns: this looks like "
                'degrees; write radians, or set angle_unit = "deg" for the whole file',
            )
        return to_radians(number, unit)

    def vector(path: KeyPath, read: Callable[..., Vector], *given: Any) -> Vector:
        try:
            return read(*given)
        except ValueError as error:
            raise document.fault(path, str(error)) from None

    def lonlat(path: KeyPath, row: Any) -> Vector:
        angles = (angle((*path, k), number) for k, number in enumerate(row))
        return vector(path, direction, *angles)

    leaves: Leaves = {
        "angle": angle,
        **dict.fromkeys(("travel", "rate"), lambda _, number: to_radians(number, unit)),
        "xyz": lambda path, row: vector(path, unit_vector, as_vector(row)),
        "lonlat": lonlat,
        "series": lambda _, numbers: tuple(map(float, numbers)),
    }
    return walked(data, leaves, kind)


def in_file(data: Table, unit: AngleUnit) -> Any:
    """Return data of the model as a mechanism file has them, angles as its numbers."""

    def angle(_: KeyPath, number: float) -> LiteralNumber:
        return LiteralNumber(to_text(number, unit))

    return walked(data, {"angle": angle, "rate": angle})
