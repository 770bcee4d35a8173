"""Values of a file as the model has them: radians, unit vectors, fields of its classes.

Which values are angles, rates and directions is said by the schema. Which key is which
field of a class of the model is said here, for reading and for writing.

Angles and directions between a file's unit and the radians used inside.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal
from typing import Any, TypeVar

import numpy as np

from spherekit.conventions import EPS
from spherekit.files.document import Document, KeyPath, LiteralNumber, Table
from spherekit.files.schema import Kind, Leaves, walked
from spherekit.model.dynamics import JointLimit, Mass
from spherekit.model.parts import (
    AngleUnit,
    Input,
    LinkSizes,
    Output,
    Pair,
    Profile,
    Source,
    Vector,
    vector_of,
)
from spherekit.model.study import ConstantSpeed, Cycloidal, Polynomial, Tabulated

LENGTH_TOLERANCE = 1e-3
"""How far from 1 the length of a unit vector may be in a file: three digits given."""

LARGEST_RADIANS = 4 * math.pi
"""Larger angles in a file in radians are taken for degrees, and refused."""

_EXACT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN, traps=[])
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230782")
_DEGREE = _EXACT.divide(_PI, Decimal(180))
_FLOAT_DIGITS = 17
_UNIT_LENGTH = 4 * EPS


def to_radians(number: float, unit: AngleUnit) -> float:
    """Return an angle of a file in radians.

    Degrees of up to 17 digits become what `math.radians` makes of them, so that a file
    and a program agree to the last bit. That cannot reach every float, one in ten is
    skipped; degrees with more digits are converted as written, with one rounding.
    """
    if unit == "rad":
        return float(number)
    written = Decimal(number.text if isinstance(number, LiteralNumber) else repr(number))
    if len(_EXACT.normalize(written).as_tuple().digits) <= _FLOAT_DIGITS:
        return math.radians(number)
    return float(_EXACT.multiply(written, _DEGREE))


def to_text(angle: float, unit: AngleUnit) -> str:
    """Return the shortest decimal that `to_radians` turns into exactly this angle."""
    if unit == "rad" or not math.isfinite(angle) or angle == 0.0:
        return repr(float(angle))
    degrees = _EXACT.divide(Decimal(angle), _DEGREE)
    # 40 digits tell any two floats apart.
    texts = (_decimal_text(Context(prec=k).plus(degrees)) for k in range(1, 40))
    return next(x for x in texts if to_radians(LiteralNumber(x), "deg") == angle)


def unit_vector(xyz: Vector) -> Vector:
    """Return a vector of nearly unit length with exactly unit length.

    One that has it already is returned unchanged, so that files round-trip.

    Raises
    ------
    ValueError
        If its length is zero or off by more than `LENGTH_TOLERANCE`.
    """
    length = math.hypot(*xyz)
    if length == 0.0:
        raise ValueError("the zero vector has no direction; give the axis as [x, y, z]")
    if abs(length - 1) > LENGTH_TOLERANCE:
        x, y, z = (round(component / length, 12) for component in xyz)
        raise ValueError(
            f"found length {length:.9g}, needs a unit vector (to "
            f"{LENGTH_TOLERANCE:g}); did you mean [{x}, {y}, {z}]?"
        )
    if abs(length - 1) <= _UNIT_LENGTH:
        return xyz
    return vector_of(component / length for component in xyz)


def direction(longitude: float, latitude: float) -> Vector:
    """Return the unit vector at a longitude and latitude (rad).

    Raises
    ------
    ValueError
        If the latitude is beyond a pole.
    """
    if abs(latitude) > math.pi / 2:
        raise ValueError("the latitude is beyond a quarter turn; longitude is first")
    cos_longitude, sin_longitude = _cos_sin(longitude)
    cos_latitude, sin_latitude = _cos_sin(latitude)
    return cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude


def _cos_sin(angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    # The float nearest a multiple of pi / 2 stands for it: 90 degrees has cosine 0.
    if abs(angle) > 1 and min(abs(cosine), abs(sine)) < 2.5e-16:
        return round(cosine) + 0.0, round(sine) + 0.0
    return cosine, sine


def _decimal_text(number: Decimal) -> str:
    if -6 <= number.adjusted() < 16:
        text = f"{number:f}"
        return text if "." in text else f"{text}.0"
    mantissa, _, exponent = f"{number:E}".partition("E")
    return f"{mantissa}e{int(exponent)}"


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
        "xyz": lambda path, row: vector(path, unit_vector, vector_of(row)),
        "lonlat": lonlat,
        "series": lambda _, numbers: tuple(map(float, numbers)),
    }
    return walked(data, leaves, kind)


def in_file(data: Table, unit: AngleUnit) -> Any:
    """Return data of the model as a mechanism file has them, angles as its numbers."""

    def angle(_: KeyPath, number: float) -> LiteralNumber:
        return LiteralNumber(to_text(number, unit))

    return walked(data, {"angle": angle, "rate": angle})
