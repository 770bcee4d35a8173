"""A mechanism to a TOML file of format 1, in canonical order.

Numbers of a mechanism file put in the place of others.
"""

import copy
import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from itertools import zip_longest
from operator import getitem
from typing import Any

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, listing, nearest
from spherekit.errors import EngineError, FileError, OutputError
from spherekit.files.atomic import write_text
from spherekit.files.document import (
    Document,
    KeyPath,
    LiteralNumber,
    Table,
    parse,
    spelt,
    values_in,
)
from spherekit.files.read import AnyMechanism, checked_document, loads, mechanism_of
from spherekit.files.schema import FORMAT
from spherekit.files.toml_text import assignment, tables
from spherekit.files.units import in_file, table_of
from spherekit.model.dynamics import PairTorque
from spherekit.model.load import Load, not_written
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import AngleUnit, Pair, PoseGeometry, SizeGeometry

_Table = dict[str, Any]


@checked(OutputError)
def dump(mechanism: AnyMechanism, path: AnyPath, angle_unit: AngleUnit = "deg") -> None:
    """Write a mechanism file that reads back as exactly this mechanism.

    Raises
    ------
    OutputError
        If it cannot be written there, or the format cannot express the mechanism.
    """
    write_text(path, dumps(mechanism_of(mechanism), angle_unit))


@checked(OutputError)
def dumps(mechanism: Mechanism, angle_unit: AngleUnit = "deg") -> str:
    """Return the text of a file that reads back as exactly this mechanism.

    Raises
    ------
    OutputError
        If the format cannot express the mechanism: an axis that is not a unit vector, a
        profile with values its kind does not have, user data that TOML lacks.
    """
    try:
        text = canonical_text(mechanism, angle_unit)
    except (TypeError, RecursionError) as error:
        raise OutputError(f"{mechanism.name}: cannot be written: {error}") from None
    try:
        again = loads(text, mechanism.name)
    except FileError as error:
        raise OutputError(
            f"{mechanism.name}: the file would not be readable: {error}"
        ) from None
    texts = text, canonical_text(again, angle_unit)
    for line, other in zip_longest(*(one.split("\n") for one in texts)):
        if line != other:
            raise OutputError(
                f"{mechanism.name}: {line or other} would not read back the same; the "
                "format holds unit vectors, and in a profile only what its kind needs"
            )
    return text


def canonical_text(mechanism: Mechanism, angle_unit: AngleUnit) -> str:
    """Return the text `dumps` would check, unchecked: for fingerprints, not for files.

    Raises
    ------
    TypeError
        If the user data holds what TOML lacks.
    """
    return "\n".join([*_lines(mechanism, angle_unit), ""])


def mechanism_hash(mechanism: Mechanism) -> str:
    """Return the SHA-256 of a mechanism's canonical file in radians, in hexadecimal."""
    return hashlib.sha256(canonical_text(mechanism, "rad").encode()).hexdigest()


def _lines(mechanism: Mechanism, unit: AngleUnit) -> Iterator[str]:
    yield assignment("format", FORMAT)
    yield assignment("name", mechanism.name)
    yield assignment("angle_unit", unit)
    yield assignment("ground", mechanism.ground)
    for name, content in in_file(_content(mechanism), unit).items():
        yield from tables((name,), content)


def _content(mechanism: Mechanism) -> dict[str, _Table]:
    """Return the tables of the file; a table may be left out where it is empty."""
    geometry, source = mechanism.geometry, mechanism.source
    sizes = geometry.links if isinstance(geometry, SizeGeometry) else {}
    content: dict[str, _Table] = {
        "source": {} if source is None else table_of(source),
        "links": {x: table_of(sizes[x]) if x in sizes else {} for x in mechanism.links},
        "pairs": {item.name: _pair(mechanism, item) for item in mechanism.pairs},
        "inputs": {item.pair: table_of(item) for item in mechanism.inputs},
        "outputs": {item.name: table_of(item) for item in mechanism.outputs},
        "mass": {item.link: table_of(item) for item in mechanism.masses},
        "loads": {item.name: _load(item) for item in mechanism.loads},
        "joint_limits": {item.pair: table_of(item) for item in mechanism.joint_limits},
        "modes": dict(mechanism.modes),
        "user": dict(mechanism.user),
    }
    return {name: table for name, table in content.items() if table}


def _pair(mechanism: Mechanism, pair: Pair) -> _Table:
    table: _Table = {"type": pair.type, "links": pair.links}
    geometry = mechanism.geometry
    where: Mapping[str, Table] = (
        {"xyz": geometry.axes, "value": geometry.values}
        if isinstance(geometry, PoseGeometry)
        else {"zero": geometry.zeros}
    )
    table |= {key: given[pair.name] for key, given in where.items() if pair.name in given}
    table |= table_of(pair)
    for link, profile in zip(pair.links, pair.profiles or (), strict=False):
        closed = {"closed": profile.closed} if profile.points else {}
        table.setdefault("profiles", {})[link] = table_of(profile) | closed
    return table


def _load(load: Load) -> _Table:
    table: _Table = {} if load.kind == PairTorque.kind else {"kind": load.kind}
    for key in load.keys:
        given = getattr(load, key)
        if callable(given):
            raise EngineError(not_written(getattr(load, "pair", "")))
        if given is not None:
            table[key] = given
    return table


_LONLAT = ("longitude", "latitude")

_ABSENT = ("zero", "value")
"""Angles of pairs that a file may leave out; they are 0 then."""


def document_of(
    given: Mechanism | str | os.PathLike[str], unit: AngleUnit = "deg"
) -> Document:
    """Return the document of a file or shipped name, or of a mechanism, in a unit.

    Axes of a reference pose, where outputs point, and points of profiles are there by
    longitude and latitude.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.
    """
    if isinstance(given, Mechanism):
        return _with_lonlat(parse(canonical_text(given, unit), given.name))
    return _with_lonlat(checked_document(given))


def _with_lonlat(document: Document) -> Document:
    tables = ("pairs", "outputs")
    data = {x: copy.deepcopy(document.data[x]) for x in tables if x in document.data}
    unit = math.degrees if document.data["angle_unit"] == "deg" else float

    def lonlat(direction: Sequence[float]) -> list[LiteralNumber]:
        x, y, z = map(float, direction)
        angles = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
        return [LiteralNumber(repr(unit(angle))) for angle in angles]

    for item in (item for table in data.values() for item in table.values()):
        if "xyz" in item:
            item["lonlat"] = lonlat(item.pop("xyz"))
    for pair in data["pairs"].values():
        for profile in pair.get("profiles", {}).values():
            for key, given in list(profile.items()):
                if key.endswith("_xyz") and isinstance(given[0], Sequence):
                    del profile[key]
                    profile[key.removesuffix("_xyz")] = [lonlat(point) for point in given]
    return replace(document, data={**document.data, **data})


def number_path(document: Document, key: str) -> KeyPath:
    """Return where the number of a key stands in a document.

    A key is the path of a number in the file. Sizes of a link are also named by the pair
    they lead to, ``links.3.arcs.43``, and where a link has one only, ``links.3.arc``; the
    axis of a pair by ``longitude`` and ``latitude``.

    Raises
    ------
    FileError
        If there is no such number.
    """
    table, name, *_ = *key.split("."), ""
    named = _named_numbers(document, table, name)
    if key in named:
        return named[key]
    path: KeyPath = ()
    place = document.data
    wrong = f'"{key}" is not a number;'
    for part in key.split("."):
        if part not in place:
            where = f"{spelt(path)}: " if path else ""
            wrong = f'{where}there is no "{part}"{nearest(part, place) or ";"}'
            break
        path, place = (*path, part), place[part]
        if not isinstance(place, Mapping):
            place = {}
    within = ".".join(map(str, path))
    there = [number for number in reversed(named) if number.startswith(within)]
    raise FileError(
        f"{document.name}: {wrong} there are {listing(there or [*place]) or 'none'}"
    )


def _named_numbers(document: Document, table: str, name: str) -> dict[str, KeyPath]:
    """Return where the numbers of an entry of a table stand, by all their names."""
    entry: Any = {}
    with suppress(AttributeError, KeyError, TypeError):
        entry = document.data[table][name]
    at: dict[KeyPath, KeyPath] = {}
    if table == "pairs" and entry:
        at = {(key,): (table, name, key) for key in _ABSENT}
    for place, value in values_in(entry if isinstance(entry, Mapping) else {}):
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        path, (*around, last) = (table, name, *place), place
        at.setdefault(place, path)
        if isinstance(last, int) and len(reduce(getitem, around, entry)) == len(_LONLAT):
            at[*around, _LONLAT[last]] = path
            if around[-1] == "lonlat":
                at[*around[:-1], _LONLAT[last]] = path
        match table, place:
            case "links", ("arcs" | "angles" as kind, int(k)):
                pair = k + (1 if kind == "arcs" else 2)
                at |= {(kind, x): path for x in entry.get("axes", ())[pair:][:1]}
                if len(entry[kind]) == 1:
                    at[(kind[:-1],)] = path
    return {".".join((table, name, *map(str, key))): path for key, path in at.items()}


def number_at(document: Document, path: KeyPath) -> float:
    """Return the number at a path, 0 where the file leaves it out."""
    place: Any = document.data
    for step in path:
        place = place[step] if isinstance(step, int) else place.get(step)
    return 0.0 if place is None else float(place)


def with_numbers(document: Document, numbers: Mapping[KeyPath, float]) -> Document:
    """Return a document with other numbers at some paths."""
    data = dict(document.data)
    copied: set[KeyPath] = set()
    for path, number in numbers.items():
        place: Any = data
        for k, step in enumerate(path[:-1]):
            if path[: k + 1] not in copied:
                place[step] = copy.copy(place[step])
                copied.add(path[: k + 1])
            place = place[step]
        place[path[-1]] = LiteralNumber(repr(float(number)))
    return replace(document, data=data)
