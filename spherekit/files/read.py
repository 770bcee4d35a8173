"""A mechanism from a TOML file of format 1."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

from spherekit.checked import checked
from spherekit.conventions import TURN
from spherekit.errors import FileError, ModelError, SpherekitError
from spherekit.files.angles import Vector
from spherekit.files.check import check
from spherekit.files.contact import Contacts
from spherekit.files.document import Document, parse, read_text
from spherekit.files.library import find, is_study
from spherekit.files.locate import KeyPath
from spherekit.files.read_dynamics import DynamicsReader
from spherekit.files.values import DocumentValues, Table
from spherekit.model.changes import AngleUnit
from spherekit.model.gears import start_of_phase
from spherekit.model.geometry import arc_pole, given_axis
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import (
    Input,
    LinkSizes,
    NamedMode,
    Output,
    Pair,
    PoseGeometry,
    SizeGeometry,
    Source,
)

AnyMechanism = Mechanism | str | os.PathLike[str]
"""A mechanism, or where `load` finds it: its path, or the name of a shipped one."""

_SIZES_OF_LINK = ("axes", "arcs", "angles", "signed_arcs", "unpaired")
_SIZES_OF_PAIR = ("zero",)
_ARC_OF_PAIR = ("through_xyz", "through_lonlat")
_AXIS_OF_PAIR = ("xyz", "lonlat", *_ARC_OF_PAIR)
_POSE_OF_PAIR = (*_AXIS_OF_PAIR, "value")
_TURNING = ("R", "P")
_PART = re.compile(r"(\w+)|\[(\d+)\]")
_KEYED = re.compile(r"(\w+(?:\.\w+|\[\d+\])*): (.*)", re.S)


@checked(FileError)
def load(name_or_path: str | os.PathLike[str]) -> Mechanism:
    """Read a mechanism file, given by its path or by the name of a shipped mechanism.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.

    Examples
    --------
    >>> import spherekit as sk
    >>> sk.load("four_bar").variable_names
    ('theta_21', 'theta_32', 'theta_43', 'theta_41')
    """
    path = find(name_or_path)
    if is_study(path):
        raise FileError(
            f"{path}: is a study, not a mechanism; read it with load_study, or run it "
            "with spherekit run"
        )
    return loads(read_text(path), str(path))


def mechanism_of(given: AnyMechanism) -> Mechanism:
    """Return the mechanism that is given, or named; errors as of `load`."""
    return given if isinstance(given, Mechanism) else load(given)


def angle_unit_of(name_or_path: str | os.PathLike[str]) -> AngleUnit:
    """Return the unit of the angles in a mechanism file; errors as of `load`."""
    unit: AngleUnit = checked_document(name_or_path).data["angle_unit"]
    return unit


def checked_document(name_or_path: str | os.PathLike[str]) -> Document:
    """Return the document of a file that keeps to the format; errors as of `load`."""
    path = find(name_or_path)
    document = parse(read_text(path), str(path))
    check(document)
    return document


@checked(FileError)
def loads(text: str, name: str = "text") -> Mechanism:
    """Read a mechanism from the text of a file; errors call the file `name`.

    Raises
    ------
    FileError
        With one line for each fault.
    """
    return read(parse(text, name))


def read(document: Document) -> Mechanism:
    """Return the mechanism that a document states.

    Raises
    ------
    FileError
        With one line for each fault; of data without a text `ModelError`.
    """
    check(document)
    return stated(document)


def stated(document: Document) -> Mechanism:
    """Return the mechanism that a document states which fits the format.

    Raises
    ------
    FileError
        With what makes no sense in it; of data without a text `ModelError`.
    """
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
class _Reader(DocumentValues):
    """Builds a mechanism without masses and loads from data that fits the schema."""

    def mechanism(self) -> Mechanism:
        data = self.document.data
        ground = data["ground"]
        source = data.get("source")
        geometry = self.geometry()
        made = Mechanism(
            name=data["name"],
            ground=ground,
            links=tuple(data["links"]),
            pairs=self.pairs(geometry),
            geometry=geometry,
            inputs=tuple(self.input(pair) for pair in data.get("inputs", {})),
            outputs=tuple(
                Output(
                    name,
                    item["link"],
                    item.get("relative_to", ground),
                    self.pointing(name, item, geometry),
                )
                for name, item in data.get("outputs", {}).items()
            ),
            modes=tuple(self.mode(name) for name in data.get("modes", {})),
            source=Source(**source) if source else None,
            user=_plain(data.get("user", {})),
        )
        pairs = tuple(self.in_phase(made, pair) for pair in made.pairs)
        return replace(made, pairs=pairs) if pairs != made.pairs else made

    def in_phase(self, made: Mechanism, pair: Pair) -> Pair:
        """Return a pair, where the file says its phase with the start that this means."""
        item, path = self.document.data["pairs"][pair.name], ("pairs", pair.name, "phase")
        if "phase" not in item:
            return pair
        if "start" in item:
            self.fail(path, "start says that already; give one of both")
        angles = {
            shaft: self.angle((*path, shaft), value)
            for shaft, value in item["phase"].items()
        }
        try:
            return replace(pair, start=start_of_phase(made, pair, angles))
        except ModelError as error:
            self.fail(path, str(error))

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
                    pair: self.axis(pair)
                    for pair, item in data["pairs"].items()
                    if any(key in item for key in _AXIS_OF_PAIR)
                },
                self.angles_of_pairs("value"),
            )
        turning = self.joined()
        if turning and not sizes:
            self.fail(
                ("pairs", next(iter(turning))),
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
            unpaired=tuple(item.get("unpaired", ())),
            signed=item.get("signed_arcs", False),
        )

    def angles_of_pairs(self, key: str) -> dict[str, float]:
        return {
            pair: self.angle(("pairs", pair, key), item[key])
            for pair, item in self.document.data["pairs"].items()
            if key in item
        }

    def axis(self, pair: str) -> Vector:
        """Read the axis of a pair in the reference pose: of an arc, its pole."""
        item, path = self.document.data["pairs"][pair], ("pairs", pair)
        ends = self.vectors(path, item, "through_lonlat", "through_xyz")
        if not ends:
            return self.vector(path, item)
        try:
            return arc_pole(ends[0], ends[1])
        except ModelError as error:
            key = next(key for key in _ARC_OF_PAIR if key in item)
            self.fail((*path, key), str(error))

    def pairs(self, geometry: SizeGeometry | PoseGeometry) -> tuple[Pair, ...]:
        joined = self.joined()
        contacts = Contacts(self.document, self.unit, geometry, joined)
        return tuple(
            Pair(name, "R", joined[name]) if name in joined else contacts.pair(name)
            for name in self.document.data["pairs"]
        )

    def joined(self) -> dict[str, tuple[str, str]]:
        """Return the two links of every pair with an axis: R, and P about its pole."""
        return {
            pair: (item["links"][0], item["links"][1])
            for pair, item in self.document.data["pairs"].items()
            if item["type"] in _TURNING
        }

    def pointing(
        self, output: str, item: Table, geometry: SizeGeometry | PoseGeometry
    ) -> Vector | None:
        """Read the direction of an output, in axes of its link."""
        path: KeyPath = ("outputs", output)
        given = [key for key in ("axis", "xyz", "lonlat") if key in item]
        if len(given) > 1:
            self.fail((*path, given[1]), f"the direction is given by {given[0]} already")
        if "axis" not in item:
            return self.vector(path, item) if given else None
        try:
            return given_axis(geometry, self.joined(), item["link"], item["axis"])
        except ModelError as error:
            self.fail((*path, "axis"), str(error))

    def mode(self, name: str) -> NamedMode:
        given = self.document.data["modes"][name].items()
        at = {pair: self.angle(("modes", name, pair), x) for pair, x in given}
        return NamedMode(name, at)

    def input(self, pair: str) -> Input:
        item, path = self.document.data["inputs"][pair], ("inputs", pair)
        start = self.angle((*path, "from"), item["from"]) if "from" in item else 0.0
        stop = self.angle((*path, "to"), item["to"]) if "to" in item else TURN
        return Input(pair, start, stop)


def _relayed(document: Document, name: str, error: ModelError) -> SpherekitError:
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
