"""Values of a file as the model has them: radians, unit vectors, fields of its classes.

Which values are angles, rates and directions is said by the schema. Which key is which
field of a class of the model is said here, for reading and for writing.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

import numpy as np

from spherekit.files.angles import angle_at, direction, to_radians, to_text, unit_vector
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath
from spherekit.files.schema import Kind, Leaves, walked
from spherekit.files.toml_text import Literal
from spherekit.model.changes import AngleUnit
from spherekit.model.dynamics import Mass, Stop
from spherekit.model.laws import ConstantSpeed, Cycloidal, Polynomial, Tabulated
from spherekit.model.parts import Input, LinkSizes, Output, Pair, Profile, Source

Part = TypeVar("Part")
Table = Mapping[str, Any]

KEYS: Mapping[type, Mapping[str, str]] = {
    Source: {"citation": "citation", "assumed": "assumed"},
    LinkSizes: {
        "axes": "axes",
        "arcs": "arcs",
        "angles": "angles",
        "signed_arcs": "signed",
        "unpaired": "unpaired",
    },
    Pair: {
        "type": "type",
        "links": "links",
        "contact": "contact",
        "start": "start",
        "one_sided": "one_sided",
        "distance": "distance",
        "pressure_angle": "pressure_angle",
    },
    Profile: {
        "kind": "kind",
        "centre_xyz": "centre",
        "centre_lonlat": "centre",
        "radius": "radius",
        "points_xyz": "points",
        "points": "points",
        "closed": "closed",
        "cosines": "cosines",
        "sines": "sines",
    },
    Input: {"from": "start", "to": "stop"},
    Output: {"link": "link", "relative_to": "relative_to", "xyz": "direction"},
    Mass: {"tensor": "tensor", "mass": "mass", "centre": "centre"},
    Stop: {"from": "low", "to": "high"},
    ConstantSpeed: {"speed": "speed", "from": "start"},
    Polynomial: {"coefficients": "coefficients"},
    Cycloidal: {"from": "start", "to": "stop", "duration": "duration"},
    Tabulated: {"times": "times", "angles": "angles", "rest_at_ends": "rest_at_ends"},
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
        value, default = getattr(part, name), defaults[name]
        same = value is None if default is None else not np.any(value != default)
        if name not in written and (default is MISSING or not same):
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
        return angle_at(document, path, number, unit)

    def vector(read: Callable[[Any], Any]) -> Callable[[KeyPath, Any], Any]:
        def judged(path: KeyPath, row: Any) -> Any:
            try:
                return read(row)
            except ValueError as error:
                raise document.fault(path, str(error)) from None

        return judged

    def lonlat(path: KeyPath, row: Any) -> Any:
        pair = [angle((*path, k), number) for k, number in enumerate(row)]
        return vector(lambda angles: direction(*angles))(path, pair)

    leaves: Leaves = {
        "angle": angle,
        "travel": lambda _, number: to_radians(number, unit),
        "rate": lambda _, number: to_radians(number, unit),
        "xyz": vector(
            lambda row: unit_vector((float(row[0]), float(row[1]), float(row[2])))
        ),
        "lonlat": lonlat,
        "series": lambda _, numbers: tuple(map(float, numbers)),
    }
    return walked(data, leaves, kind)


def in_file(data: Table, unit: AngleUnit) -> Any:
    """Return data of the model as a mechanism file has them, angles as its numbers."""

    def angle(_: KeyPath, number: float) -> Literal:
        return Literal(to_text(number, unit))

    return walked(data, {"angle": angle, "rate": angle})
