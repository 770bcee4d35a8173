"""Numbers of a mechanism file, named by keys such as ``links.2.arc``, read and replaced.

Sweeps, sensitivities and pages vary mechanisms through these keys.
"""

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
from spherekit.files.toml_document import (
    Document,
    LiteralNumber,
    key_path_text,
    parse,
    values_in,
)
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import AngleUnit
from spherekit.wording import listing, nearest

_LONLAT_NAMES = ("longitude", "latitude")
"""Names for the two numbers of a direction on the sphere."""

_OPTIONAL_PAIR_KEYS = ("zero", "value")
"""Angles of pairs that a file may leave out; they are 0 then."""


def document_of(
    mechanism: Mechanism | str | os.PathLike[str], unit: AngleUnit = "deg"
) -> Document:
    """Return the document of a mechanism, in which all directions are two angles.

    Axes of a reference pose, directions of outputs, and points of profiles are given by
    longitude and latitude, since their three components cannot vary one by one.

    Parameters
    ----------
    mechanism
        The mechanism, the path of a file, or the name of a shipped mechanism.
    unit
        The unit of angles if a mechanism is given. A file has its own.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.
    """
    if isinstance(mechanism, Mechanism):
        return _with_lonlat(parse(canonical_text(mechanism, unit), mechanism.name))
    return _with_lonlat(checked_document(mechanism))


def _with_lonlat(document: Document) -> Document:
    """Return a document whose unit vectors are replaced by longitude and latitude.

    These are the axes of pairs, the directions of outputs, and the points of profiles. The
    given document is not changed.
    """
    tables = {
        name: copy.deepcopy(document.data[name])
        for name in ("pairs", "outputs")
        if name in document.data
    }
    to_unit = math.degrees if document.data["angle_unit"] == "deg" else float

    def lonlat(direction: Sequence[float]) -> list[LiteralNumber]:
        """Return longitude and latitude, in the unit of the file, of a vector (3,)."""
        x, y, z = map(float, direction)
        longitude = math.atan2(y, x)
        latitude = math.atan2(z, math.hypot(x, y))
        return [LiteralNumber(repr(to_unit(angle))) for angle in (longitude, latitude)]

    for table in tables.values():
        for entry in table.values():
            if "xyz" in entry:
                entry["lonlat"] = lonlat(entry.pop("xyz"))
    for pair in tables["pairs"].values():
        for profile in pair.get("profiles", {}).values():
            for key, points in list(profile.items()):
                if key.endswith("_xyz") and isinstance(points[0], Sequence):
                    del profile[key]
                    profile[key.removesuffix("_xyz")] = [lonlat(point) for point in points]
    return replace(document, data={**document.data, **tables})


def number_path(document: Document, key: str) -> KeyPath:
    """Return the path of the number that a key names.

    Parameters
    ----------
    document
        A document with directions as angles, see `document_of`.
    key
        The path of a number in the file. A size of a link may also be named by the pair
        that it leads to, ``links.3.arcs.43``, or by ``links.3.arc`` if the link has only
        one. The axis of a pair has a ``longitude`` and a ``latitude``.

    Raises
    ------
    FileError
        If there is no such number.
    """
    # The empty text stands for the name of the entry if the key has one part only.
    table, name, *_ = *key.split("."), ""
    paths = _number_paths(document, table, name)
    if key in paths:
        return paths[key]

    # Find the first part of the key that does not exist, for the message.
    path: KeyPath = ()
    value: Any = document.data
    problem = f'"{key}" is not a number;'
    for part in key.split("."):
        if part not in value:
            where = f"{key_path_text(path)}: " if path else ""
            problem = f'{where}there is no "{part}"{nearest(part, value) or ";"}'
            break
        path = (*path, part)
        value = value[part]
        if not isinstance(value, Mapping):
            value = {}
    prefix = ".".join(map(str, path))
    alternatives = [number for number in reversed(paths) if number.startswith(prefix)]
    raise FileError(
        f"{document.name}: {problem} there are "
        f"{listing(alternatives or [*value]) or 'none'}"
    )


def _number_paths(document: Document, table: str, name: str) -> dict[str, KeyPath]:
    """Return the paths of the numbers of one entry of a table, by all their names.

    Parameters
    ----------
    document
        The document.
    table, name
        Name of the table and of the entry, such as ``"links"`` and ``"2"``. If there is no
        such entry, no path is returned.
    """
    entry: Any = {}
    with suppress(AttributeError, KeyError, TypeError):
        entry = document.data[table][name]
    paths: dict[KeyPath, KeyPath] = {}  # by names within the entry
    # `paths[key,]` has the index (key,): a path of one part.
    if table == "pairs" and entry:
        for key in _OPTIONAL_PAIR_KEYS:
            paths[key,] = (table, name, key)
    for inner_path, value in values_in(entry if isinstance(entry, Mapping) else {}):
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        # The plain name of the number, then its further names.
        path = (table, name, *inner_path)
        paths.setdefault(inner_path, path)
        *outer, last = inner_path
        if isinstance(last, int) and len(reduce(getitem, outer, entry)) == 2:
            # The first or second number of a direction.
            paths[*outer, _LONLAT_NAMES[last]] = path
            if outer[-1] == "lonlat":
                paths[*outer[:-1], _LONLAT_NAMES[last]] = path
        match table, inner_path:
            case "links", ("arcs" | "angles" as key, int(index)):
                # arcs[k] leads to axis k + 1 of the link, angles[k] to axis k + 2.
                axis = index + (1 if key == "arcs" else 2)
                axes = entry.get("axes", ())
                if axis < len(axes):
                    paths[key, axes[axis]] = path
                if len(entry[key]) == 1:
                    paths[key[:-1],] = path  # "arc" or "angle"
    return {
        ".".join((table, name, *map(str, inner_path))): path
        for inner_path, path in paths.items()
    }


def number_at(document: Document, path: KeyPath) -> float:
    """Return the number at a path; 0 if the file leaves it out."""
    value: Any = document.data
    for step in path:
        value = value[step] if isinstance(step, int) else value.get(step)
    return 0.0 if value is None else float(value)


def with_numbers(document: Document, numbers: Mapping[KeyPath, float]) -> Document:
    """Return a document with other numbers at some paths.

    The given document is not changed. Tables on the way to a new number are copied, the
    others are shared by both documents.

    Parameters
    ----------
    document
        The document.
    numbers
        The new numbers by their paths.
    """
    data = dict(document.data)
    copied_paths: set[KeyPath] = set()
    for path, number in numbers.items():
        container: Any = data
        for depth, step in enumerate(path[:-1], start=1):
            if path[:depth] not in copied_paths:
                container[step] = copy.copy(container[step])
                copied_paths.add(path[:depth])
            container = container[step]
        container[path[-1]] = LiteralNumber(repr(float(number)))
    return replace(document, data=data)
