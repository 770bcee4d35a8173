"""Converts the data of a file to the values of the model, and back.

The schema says which values are angles, rates and directions. The table `KEYS` says which
key of a file is which field of a class of the model.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from spherekit.files.angle_units import (
    MAX_PLAUSIBLE_RAD,
    direction,
    to_radians,
    to_text,
    unit_vector,
)
from spherekit.files.schema import Converters, Kind, convert_values
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
from spherekit.mechanism.sizes import Vector
from spherekit.quantity import (
    ANGLE,
    ANGULAR_SPEED,
    AngleUnit,
    Dimension,
    QuantityError,
    angle_by_time,
    read_quantity,
)

Element = TypeVar("Element")


def _same_names(names: str) -> dict[str, str]:
    """Return a mapping for keys that have the names of their fields, from ``"key key"``."""
    return {name: name for name in names.split()}


KEYS: Mapping[type, Mapping[str, str]] = {
    Source: _same_names("citation assumed"),
    LinkSizes: _same_names("axes arcs angles")
    | {"signed_arcs": "signed"}
    | _same_names("unpaired"),
    Pair: _same_names("type links contact start one_sided distance pressure_angle"),
    Profile: _same_names("kind")
    | {"centre_xyz": "centre", "centre_lonlat": "centre"}
    | _same_names("radius")
    | {"points_xyz": "points"}
    | _same_names("points closed cosines sines"),
    Input: {"from": "start", "to": "stop"},
    Output: {"link": "link", "relative_to": "relative_to", "xyz": "direction"},
    Mass: _same_names("tensor mass centre"),
    JointLimit: {"from": "low", "to": "high"},
    ConstantSpeed: {"speed": "speed", "from": "start"},
    Polynomial: _same_names("coefficients"),
    Cycloidal: {"from": "start", "to": "stop", "duration": "duration"},
    Tabulated: _same_names("times angles rest_at_ends"),
}
"""Field of each class of the model by its key in files, in the order of writing.

Two keys for one field are two ways to state the field; the first key is written.
"""


def construct_element(
    cls: Callable[..., Element], table: Table, other_fields: Table | None = None
) -> Element:
    """Construct an element of a mechanism, such as a pair, from its table in a file.

    Parameters
    ----------
    cls
        The class of the element.
    table
        Values by key of the file, with angles in rad and directions as unit vectors. Keys
        that belong to other objects are ignored.
    other_fields
        Values of further fields, by field name, that are not in the table.
    """
    # `field_by_key` has the field of the class for each key of the file.
    field_by_key = KEYS[cls]  # type: ignore[index]
    table_fields = {
        field_by_key[key]: value for key, value in table.items() if key in field_by_key
    }
    return cls(**(other_fields or {}), **table_fields)


def table_of(element: Any) -> dict[str, Any]:
    """Return the table that describes an element of a mechanism in a file.

    The table has the values of the fields by key of the file, with angles in rad. Fields
    with their default value are left out.
    """
    default_by_field = {item.name: item.default for item in fields(element)}
    table: dict[str, Any] = {}
    # Some fields can be stated by two keys, such as "centre_xyz" and "centre_lonlat". The
    # first key states the stored value as it is.
    handled_fields = set()
    for key, field_name in KEYS[type(element)].items():
        value = getattr(element, field_name)
        is_default = not np.any(value != default_by_field[field_name])
        if field_name not in handled_fields and not is_default:
            table[key] = value
        handled_fields.add(field_name)
    return table


def convert_to_model(
    document: Document,
    data: Table,
    kind: Kind = "mechanism",
    angle_unit: AngleUnit = "rad",
) -> Any:
    """Return data with angles in rad, directions as unit vectors and arrays as tuples.

    Parameters
    ----------
    document
        The file, for its angle unit and for messages.
    data
        Tables of the file that fit the schema.
    kind
        The kind of file.
    angle_unit
        Unit of angles if the file does not state one.

    Raises
    ------
    FileError
        If an angle in rad looks like degrees, the unit of a text is wrong, a latitude
        exceeds 90 deg, or a direction is not a unit vector. If the document was built from
        data in code, the error is a `ModelError`.
    """
    unit: AngleUnit = document.data.get("angle_unit", angle_unit)

    # Each converter takes the path of the key, for messages, and the value in the file.
    def convert_text(path: KeyPath, text: str, dimension: Dimension) -> float:
        """Return an angle or a rate in rad from a text with a unit, such as ``30deg``."""
        try:
            number = read_quantity(text, dimension, unit)
        except QuantityError as problem:
            raise document.fault(path, str(problem)) from None
        if not math.isfinite(number):
            raise document.fault(path, f'found "{text}", expected a finite number')
        return number

    def convert_angle(path: KeyPath, number: float | str) -> float:
        """Return an angle in rad; refuse numbers that look like degrees."""
        if isinstance(number, str):
            return convert_text(path, number, ANGLE)
        if unit == "rad" and abs(number) > MAX_PLAUSIBLE_RAD:
            raise document.fault(
                path,
                f"found {float(number)} rad, more than two turns: this looks like "
                'degrees; write radians, or set angle_unit = "deg" for the whole file',
            )
        return to_radians(number, unit)

    def convert_travel(path: KeyPath, number: float | str) -> float:
        """Return an angle in rad, of any size."""
        if isinstance(number, str):
            return convert_text(path, number, ANGLE)
        return to_radians(number, unit)

    def convert_rate(path: KeyPath, number: float | str) -> float:
        """Return an angular speed in rad/s."""
        if isinstance(number, str):
            return convert_text(path, number, ANGULAR_SPEED)
        return to_radians(number, unit)

    def convert_coefficient(path: KeyPath, number: float | str) -> float:
        """Return a coefficient of a polynomial in time; its index is the power of s."""
        if isinstance(number, str):
            return convert_text(path, number, angle_by_time(int(path[-1])))
        return to_radians(number, unit)

    def convert_xyz(path: KeyPath, components: Any) -> Vector:
        """Return the unit vector with three components."""
        try:
            return unit_vector(as_vector(components))
        except ValueError as error:
            raise document.fault(path, str(error)) from None

    def convert_lonlat(path: KeyPath, angles: Any) -> Vector:
        """Return the unit vector at a longitude and a latitude."""
        longitude, latitude = (
            convert_angle((*path, index), angle) for index, angle in enumerate(angles)
        )
        try:
            return direction(longitude, latitude)
        except ValueError as error:
            raise document.fault(path, str(error)) from None

    def convert_series(path: KeyPath, numbers: Any) -> tuple[float, ...]:
        """Return an array of plain numbers without units."""
        return tuple(map(float, numbers))

    # By the names of the parts of the schema that declare the values.
    converters: Converters = {
        "angle": convert_angle,
        "travel": convert_travel,  # laws and locked pairs may have many turns
        "rate": convert_rate,
        "coefficient": convert_coefficient,
        "xyz": convert_xyz,
        "lonlat": convert_lonlat,
        "series": convert_series,
    }
    return convert_values(data, converters, kind)


def convert_to_file(data: Table, unit: AngleUnit) -> Any:
    """Convert angles and rates in tables to the unit in which a mechanism file has them.

    Parameters
    ----------
    data
        Tables as in a mechanism file, with angles in rad and rates in rad/s.
    unit
        The unit of angles in the file, "deg" or "rad".

    Returns
    -------
    The same tables with converted numbers. Each of these is a `LiteralNumber`, a float with
    the text that is written to the file. The text is read back as the same angle.
    """

    def convert_angle(path: KeyPath, angle: float) -> LiteralNumber:
        """Return an angle (rad) or rate (rad/s) in the unit of the file."""
        return LiteralNumber(to_text(angle, unit))

    return convert_values(data, {"angle": convert_angle, "rate": convert_angle})


def angle_paths(document: Document) -> set[KeyPath]:
    """Return the locations of all angles in a mechanism file.

    The schema of the file declares which numbers are angles; longitudes and latitudes are
    included. A location is a path of keys, which ends with an index for a number in an
    array. Callers look up whether a number that varies is an angle.
    """
    paths: set[KeyPath] = set()

    def add_angle(path: KeyPath, number: float) -> float:
        """Add the path of an angle, and return the angle unchanged."""
        paths.add(path)
        return number

    def add_lonlat(path: KeyPath, angles: Any) -> Any:
        """Add the paths of a longitude and a latitude, and return both unchanged."""
        paths.update((*path, index) for index in range(len(angles)))
        return angles

    # `convert_values` calls these functions for each angle, with its path. Only the
    # recorded paths are needed, not the result.
    convert_values(document.data, {"angle": add_angle, "lonlat": add_lonlat})
    return paths
