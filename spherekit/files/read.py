"""A mechanism from a TOML file of format 1."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn, final

from spherekit.conventions import nearest
from spherekit.errors import FileError, ModelError
from spherekit.files.angles import (
    AngleUnit,
    Vector,
    angle_at,
    direction,
    unit_vector,
)
from spherekit.files.check import check
from spherekit.files.document import Document, parse, read_text
from spherekit.files.library import find, is_study
from spherekit.files.locate import KeyPath
from spherekit.files.read_dynamics import DynamicsReader
from spherekit.model.gears import gear_axes, pitch_angles
from spherekit.model.mechanism import (
    Input,
    LinkSizes,
    Mechanism,
    Output,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    Source,
)

_Table = Mapping[str, Any]

FULL_TURN = 6.283185307179586
_SIZES_OF_LINK = ("axes", "arcs", "angles")
_SIZES_OF_PAIR = ("zero",)
_POSE_OF_PAIR = ("xyz", "lonlat", "value")
_PART = re.compile(r"(\w+)|\[(\d+)\]")
_KEYED = re.compile(r"(\w+(?:\.\w+|\[\d+\])*): (.*)", re.S)


def load(name_or_path: str | os.PathLike[str]) -> Mechanism:
    """Read a mechanism file, given by its path or by the name of a shipped mechanism.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.
    """
    path = find(name_or_path)
    if is_study(path):
        raise FileError(
            f"{path}: is a study, not a mechanism; read it with load_study, or run it "
            "with spherekit run"
        )
    return loads(read_text(path), str(path))


def loads(text: str, name: str = "text") -> Mechanism:
    """Read a mechanism from the text of a file; errors call the file `name`.

    Raises
    ------
    FileError
        With one line for each fault.
    """
    document = parse(text, name)
    check(document)
    name = document.data["name"]
    try:
        mechanism = _Reader(document, document.data["angle_unit"]).mechanism()
        reader = DynamicsReader(document, mechanism)
        return replace(
            mechanism,
            masses=reader.masses(),
            loads=reader.loads(),
            stops=reader.stops(),
        )
    except ModelError as error:
        raise _relayed(document, name, error) from None


@final
@dataclass(frozen=True)
class _Reader:
    """Builds a mechanism without masses and loads from data that fits the schema."""

    document: Document
    unit: AngleUnit

    def mechanism(self) -> Mechanism:
        data = self.document.data
        ground = data["ground"]
        source = data.get("source")
        return Mechanism(
            name=data["name"],
            ground=ground,
            links=tuple(data["links"]),
            pairs=tuple(self.pair(name) for name in data["pairs"]),
            geometry=self.geometry(),
            inputs=tuple(self.input(pair) for pair in data.get("inputs", {})),
            outputs=tuple(
                Output(name, item["link"], item.get("relative_to", ground))
                for name, item in data.get("outputs", {}).items()
            ),
            source=Source(**source) if source else None,
            user=_plain(data.get("user", {})),
        )

    def geometry(self) -> SizeGeometry | PoseGeometry:
        data = self.document.data
        sizes = self.given("links", _SIZES_OF_LINK)
        sizes += self.given("pairs", _SIZES_OF_PAIR)
        pose = self.given("pairs", _POSE_OF_PAIR)
        if sizes and pose:
            first, second = sorted((sizes[0], pose[0]), key=self.document.line)
            other = ".".join(map(str, first))
            line = self.document.line(first)
            self.fail(
                second,
                f"two geometries: {other} (line {line}) belongs to the "
                f"{'sizes' if first in sizes else 'reference-pose'} form, this key to "
                "the other; keep the sizes (axes, arcs, angles in links, zero in "
                "pairs) or the reference pose (xyz or lonlat and value in pairs)",
            )
        if pose:
            return PoseGeometry(
                {
                    pair: self.vector(("pairs", pair), item)
                    for pair, item in data["pairs"].items()
                    if "xyz" in item or "lonlat" in item
                },
                self.angles_of_pairs("value"),
            )
        revolute = [name for name, item in data["pairs"].items() if item["type"] == "R"]
        if revolute and not sizes:
            self.fail(
                ("pairs", revolute[0]),
                "no geometry: give axes and arcs in every link, or xyz or lonlat in "
                "every R pair",
            )
        links = {
            link: self.sizes(link)
            for link, item in data["links"].items()
            if any(key in item for key in _SIZES_OF_LINK)
        }
        return SizeGeometry(links, self.angles_of_pairs("zero"))

    def given(self, table: str, keys: Sequence[str]) -> list[KeyPath]:
        """Return the paths of those of these keys that any entry of a table has."""
        return [
            (table, name, key)
            for name, item in self.document.data[table].items()
            for key in keys
            if key in item
        ]

    def sizes(self, link: str) -> LinkSizes:
        item, path = self.document.data["links"][link], ("links", link)
        if "axes" not in item:
            self.fail(path, "the key axes is missing: the names of the R pairs on it")
        return LinkSizes(
            tuple(item["axes"]),
            self.angles((*path, "arcs"), item.get("arcs", [])),
            self.angles((*path, "angles"), item.get("angles", [])),
        )

    def angles_of_pairs(self, key: str) -> dict[str, float]:
        return {
            pair: self.angle(("pairs", pair, key), item[key])
            for pair, item in self.document.data["pairs"].items()
            if key in item
        }

    def pair(self, name: str) -> Pair:
        item, path = self.document.data["pairs"][name], ("pairs", name)
        first, second = item["links"]
        if "teeth" in item:
            return self.gears(name, item)
        if "profiles" not in item:
            return Pair(name, item["type"], (first, second))
        profiles = item["profiles"]
        for link in profiles:
            if link not in (first, second):
                self.fail(
                    (*path, "profiles", link),
                    f'the pair joins "{first}" and "{second}", not "{link}"'
                    f"{nearest(link, (first, second))}",
                )
        built = (
            self.profile((*path, "profiles", first), profiles[first]),
            self.profile((*path, "profiles", second), profiles[second]),
        )
        start = self.angles((*path, "start"), item.get("start", [0.0, 0.0]))
        return Pair(
            name,
            item["type"],
            (first, second),
            built,
            item.get("contact", "external"),
            (start[0], start[1]),
        )

    def gears(self, name: str, item: _Table) -> Pair:
        """Return the rolling contact of two bevel gears: circles about their axes."""
        path: KeyPath = ("pairs", name, "axes")
        contact = item.get("contact", "external")
        try:
            centres, shaft_angle = gear_axes(
                self.geometry(),
                self.joined(),
                (item["links"][0], item["links"][1]),
                (item["axes"][0], item["axes"][1]),
            )
            teeth = item["teeth"]
            radii = pitch_angles((teeth[0], teeth[1]), shaft_angle, contact)
        except ModelError as error:
            self.fail(path, str(error))
        circles = [
            Profile("circle", centre, radius)
            for centre, radius in zip(centres, radii, strict=True)
        ]
        start = self.angles(("pairs", name, "start"), item.get("start", [0.0, 0.0]))
        links = (item["links"][0], item["links"][1])
        return Pair(
            name, "Cr", links, (circles[0], circles[1]), contact, (start[0], start[1])
        )

    def joined(self) -> dict[str, tuple[str, str]]:
        """Return the two links of every R pair."""
        return {
            pair: (item["links"][0], item["links"][1])
            for pair, item in self.document.data["pairs"].items()
            if item["type"] == "R"
        }

    def profile(self, path: KeyPath, item: _Table) -> Profile:
        has_centre = "centre_xyz" in item or "centre_lonlat" in item
        rows = item.get("points_xyz", item.get("points", []))
        key = "points_xyz" if "points_xyz" in item else "points"
        turn = self.from_xyz if key == "points_xyz" else self.from_lonlat
        radius = item.get("radius")
        return Profile(
            kind=item["kind"],
            centre=self.vector(path, item, "centre_") if has_centre else None,
            radius=None if radius is None else self.angle((*path, "radius"), radius),
            points=tuple(turn((*path, key, k), row) for k, row in enumerate(rows)),
            closed=item.get("closed", True),
            cosines=self.angles((*path, "cosines"), item.get("cosines", [])),
            sines=self.angles((*path, "sines"), item.get("sines", [])),
        )

    def input(self, pair: str) -> Input:
        item, path = self.document.data["inputs"][pair], ("inputs", pair)
        start = self.angle((*path, "from"), item["from"]) if "from" in item else 0.0
        stop = self.angle((*path, "to"), item["to"]) if "to" in item else FULL_TURN
        return Input(pair, start, stop)

    def vector(self, path: KeyPath, item: _Table, prefix: str = "") -> Vector:
        """Read the direction given as `prefix` + xyz or lonlat in a table."""
        if f"{prefix}xyz" in item:
            return self.from_xyz((*path, f"{prefix}xyz"), item[f"{prefix}xyz"])
        return self.from_lonlat((*path, f"{prefix}lonlat"), item[f"{prefix}lonlat"])

    def from_xyz(self, path: KeyPath, row: Sequence[float]) -> Vector:
        x, y, z = row
        try:
            return unit_vector((float(x), float(y), float(z)))
        except ValueError as error:
            self.fail(path, str(error))

    def from_lonlat(self, path: KeyPath, row: Sequence[float]) -> Vector:
        longitude, latitude = self.angles(path, row)
        try:
            return direction(longitude, latitude)
        except ValueError as error:
            self.fail(path, str(error))

    def angles(self, path: KeyPath, numbers: Sequence[float]) -> tuple[float, ...]:
        return tuple(self.angle((*path, k), number) for k, number in enumerate(numbers))

    def angle(self, path: KeyPath, number: float) -> float:
        return angle_at(self.document, path, number, self.unit)

    def fail(self, path: KeyPath, message: str) -> NoReturn:
        raise self.document.fault(path, message)


def _relayed(document: Document, name: str, error: ModelError) -> FileError:
    """Return the model's complaint with the file and the line of the key it names."""
    message = str(error).removeprefix(f"{name}: ")
    keyed = _KEYED.fullmatch(message)
    if keyed:
        path = _path(keyed[1])
        if path[0] in document.data:
            return document.fault(path, keyed[2])
    return document.fault((), message)


def _path(key: str) -> KeyPath:
    """Return the path of a key as `spelt` writes it."""
    return tuple(int(number) if number else name for name, number in _PART.findall(key))


def _plain(value: Any) -> Any:
    """Return user data with ordinary floats."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if isinstance(value, float) else value
