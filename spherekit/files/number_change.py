"""Numbers of a mechanism file replaced by others."""

import copy
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from operator import getitem
from typing import Any

from spherekit.errors import FileError
from spherekit.files.mechanism_reader import checked_document
from spherekit.files.mechanism_writer import canonical_text
from spherekit.files.toml_document import Document, LiteralNumber, parse, spelt, values_in
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import AngleUnit
from spherekit.wording import listing, nearest

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
