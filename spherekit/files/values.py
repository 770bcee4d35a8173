"""Numbers at key paths of a file as angles and directions, faults with their line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from spherekit.files.angles import Vector, angle_at, direction, unit_vector
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath
from spherekit.model.changes import AngleUnit

Table = Mapping[str, Any]


@dataclass(frozen=True)
class DocumentValues:
    """A document whose data fits the schema, and the unit of its angles.

    Every method takes the key path at which the given number, row or table stands, and
    raises `FileError` with its line if it makes no sense there. Angles are in rad.
    """

    document: Document
    unit: AngleUnit

    def vector(self, path: KeyPath, item: Table, prefix: str = "") -> Vector:
        """Read the direction given as `prefix` + xyz or lonlat in a table."""
        if f"{prefix}xyz" in item:
            return self.from_xyz((*path, f"{prefix}xyz"), item[f"{prefix}xyz"])
        return self.from_lonlat((*path, f"{prefix}lonlat"), item[f"{prefix}lonlat"])

    def vectors(self, path: KeyPath, item: Table, lonlat: str, xyz: str) -> list[Vector]:
        """Read the directions given under one of two keys; none if under neither."""
        if xyz in item:
            rows = enumerate(item[xyz])
            return [self.from_xyz((*path, xyz, k), row) for k, row in rows]
        rows = enumerate(item.get(lonlat, []))
        return [self.from_lonlat((*path, lonlat, k), row) for k, row in rows]

    def from_xyz(self, path: KeyPath, row: Sequence[float]) -> Vector:
        """Read a unit vector."""
        x, y, z = row
        try:
            return unit_vector((float(x), float(y), float(z)))
        except ValueError as error:
            self.fail(path, str(error))

    def from_lonlat(self, path: KeyPath, row: Sequence[float]) -> Vector:
        """Read a direction given by longitude and latitude."""
        longitude, latitude = self.angles(path, row)
        try:
            return direction(longitude, latitude)
        except ValueError as error:
            self.fail(path, str(error))

    def angles(self, path: KeyPath, numbers: Sequence[float]) -> tuple[float, ...]:
        """Read a row of angles."""
        return tuple(self.angle((*path, k), number) for k, number in enumerate(numbers))

    def angle(self, path: KeyPath, number: float) -> float:
        """Read an angle."""
        return angle_at(self.document, path, number, self.unit)

    def fail(self, path: KeyPath, message: str) -> NoReturn:
        """Raise the `FileError` about a key path."""
        raise self.document.fault(path, message)
