"""Numbers of a mechanism file put in the place of others."""

import copy
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from spherekit.conventions import listing, nearest
from spherekit.errors import FileError
from spherekit.files.document import Document, LiteralNumber, parse, spelt
from spherekit.files.locate import KeyPath
from spherekit.files.read import checked_document
from spherekit.files.write import canonical_text
from spherekit.model.changes import AngleUnit
from spherekit.model.mechanism import Mechanism

_LEADS = {"arc": ("arcs", 1), "angle": ("angles", 2)}
"""The list in which a link's sizes stand, and the first axis that one leads to."""

_LONLAT = {"longitude": 0, "latitude": 1}

_ABSENT = ("zero", "value")
"""Angles of pairs that a file may leave out; they are 0 then."""


def document_of(
    given: Mechanism | str | os.PathLike[str], unit: AngleUnit = "deg"
) -> Document:
    """Return the document of a file or shipped name, or of a mechanism, in a unit.

    Axes of a reference pose and points of profiles are there by longitude and latitude.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.
    """
    if isinstance(given, Mechanism):
        return _with_lonlat(parse(canonical_text(given, unit), given.name))
    return _with_lonlat(checked_document(given))


def _with_lonlat(document: Document) -> Document:
    pairs = dict(document.data["pairs"])
    unit = math.degrees if document.data["angle_unit"] == "deg" else float

    def lonlat(direction: Sequence[float]) -> list[LiteralNumber]:
        x, y, z = map(float, direction)
        angles = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
        return [LiteralNumber(repr(unit(angle))) for angle in angles]

    for name, pair in pairs.items():
        made = dict(pair)
        if "xyz" in made:
            made["lonlat"] = lonlat(made.pop("xyz"))
        for link, profile in made.get("profiles", {}).items():
            of_link = dict(profile)
            for key, given in profile.items():
                if key.endswith("_xyz") and isinstance(given[0], Sequence):
                    del of_link[key]
                    of_link[key.removesuffix("_xyz")] = [lonlat(point) for point in given]
            made["profiles"] = {**made["profiles"], link: of_link}
        pairs[name] = made
    return replace(document, data={**document.data, "pairs": pairs})


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
    parts = key.split(".")
    path: list[str | int] = []
    place: Any = document.data
    for k, part in enumerate(parts):
        steps = _steps(document, path, place, part, last=k == len(parts) - 1)
        for step in steps:
            path.append(step)
            place = _within(place, step)
    if place is None and parts[-1] in _ABSENT:
        return tuple(path)
    if isinstance(place, bool) or not isinstance(place, int | float):
        raise FileError(
            f'{document.name}: "{key}" is not a number'
            + (f"; it holds {listing(_names(place))}" if _names(place) else "")
        )
    return tuple(path)


def number_at(document: Document, path: KeyPath) -> float:
    """Return the number at a path, 0 where the file leaves it out."""
    place: Any = document.data
    for step in path:
        place = _within(place, step)
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


def _within(place: Any, step: str | int) -> Any:
    if isinstance(step, int):
        return place[step]
    return place.get(step)


def _names(place: Any) -> list[str]:
    if isinstance(place, Mapping):
        return list(place)
    return [str(k) for k in range(len(place))] if isinstance(place, list) else []


def _steps(
    document: Document, path: list[str | int], place: Any, part: str, last: bool
) -> KeyPath:
    """Return the steps that a part of a key stands for."""
    if len(path) == 2 and path[0] == "links" and part in _LEADS and last:
        name, first = _LEADS[part]
        sizes = place.get(name, [])
        if len(sizes) == 1:
            return name, 0
        pairs = place.get("axes", [])[first:]
        if not sizes:
            raise FileError(f"{document.name}: links.{path[1]} has no {name}")
        raise FileError(
            f"{document.name}: links.{path[1]} has {len(sizes)} {name}; say which by the "
            f"pair it leads to: {listing(f'links.{path[1]}.{name}.{p}' for p in pairs)}"
        )
    if len(path) == 3 and path[0] == "links" and path[2] in ("arcs", "angles"):
        first = 1 if path[2] == "arcs" else 2
        pairs = document.data["links"][path[1]].get("axes", [])[first:]
        if part in pairs:
            return (pairs.index(part),)
    if part in _LONLAT and isinstance(place, Mapping) and "lonlat" in place:
        return "lonlat", _LONLAT[part]
    if part in _LONLAT and last and isinstance(place, list) and len(place) == 2:
        return (_LONLAT[part],)
    if isinstance(place, Mapping) and (part in place or (last and part in _ABSENT)):
        return (part,)
    if isinstance(place, list) and part.isdecimal() and int(part) < len(place):
        return (int(part),)
    names = _names(place)
    where = spelt(tuple(path))
    raise FileError(
        f'{document.name}: {where + ": " if where else ""}there is no "{part}"'
        f"{nearest(part, names) or ';'} "
        + (f"it holds {listing(names)}" if names else "it is a single value")
    )
