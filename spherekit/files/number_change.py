"""Numbers of a mechanism file, named by keys such as ``links.2.arc``, read and replaced.

Sweeps, sensitivities and pages vary mechanisms through these keys.
"""

import copy
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
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
from spherekit.files.units import angle_paths
from spherekit.mechanism.mechanism import Mechanism
from spherekit.quantity import AngleUnit
from spherekit.wording import listing, nearest

_LONLAT_NAMES = ("longitude", "latitude")
"""Names for the two numbers of a direction on the sphere."""

_DIRECTION_KEYS = ("lonlat", "points")
"""How the keys of directions end, each with a longitude and a latitude."""

_OPTIONAL_PAIR_KEYS = ("zero", "value")
"""Angles of pairs that a file may leave out; these are 0 by default."""


def document_of(
    mechanism: Mechanism | str | os.PathLike[str], unit: AngleUnit = "deg"
) -> Document:
    """Return the data of a mechanism file, with longitude and latitude for directions.

    Callers change single numbers of these data, for example in a sweep of designs. A
    longitude or latitude can change alone, but a single component of a unit vector cannot.
    Therefore the axes of pairs, the directions of outputs and the points of profiles
    (contact curves) are converted.

    Parameters
    ----------
    mechanism
        The mechanism, the path of a file, or the name of a shipped mechanism.
    unit
        The unit of angles for a mechanism. A file has its own unit.

    Raises
    ------
    FileError
        If there is no such file, or if it has faults. The message has one line for each
        fault.
    """
    if isinstance(mechanism, Mechanism):
        return _with_lonlat(parse(canonical_text(mechanism, unit), mechanism.name))
    # Read the file and check it against the format.
    return _with_lonlat(checked_document(mechanism))


def _with_lonlat(document: Document) -> Document:
    """Return the data of a mechanism file, with angles in place of unit vectors.

    A longitude can change alone, but a single component of a unit vector cannot. The axes
    of pairs, the directions of outputs and the points of profiles (contact curves) become a
    longitude and a latitude, in the unit of the file. The angles are `LiteralNumber`:
    floats that keep their decimal digits as text. Other vectors, such as the centre of a
    circle, stay. The argument is not changed.
    """
    # The tables with directions are copied, because the copies are changed below.
    tables = {
        name: copy.deepcopy(document.data[name])
        for name in ("pairs", "outputs")
        if name in document.data
    }
    to_unit = math.degrees if document.data["angle_unit"] == "deg" else float

    def lonlat(direction: Sequence[float]) -> list[LiteralNumber]:
        """Return the longitude and latitude of a vector (3,), in the unit of the file."""
        x, y, z = map(float, direction)
        longitude = math.atan2(y, x)
        latitude = math.atan2(z, math.hypot(x, y))
        return [LiteralNumber(repr(to_unit(angle))) for angle in (longitude, latitude)]

    for table in tables.values():
        for entry in table.values():
            if "xyz" in entry:
                entry["lonlat"] = lonlat(entry.pop("xyz"))
    # The key ``points_xyz`` of a profile becomes ``points``. A key with a single vector,
    # such as ``centre_xyz``, stays as it is: its first element is a number, not a point.
    for pair in tables["pairs"].values():
        for profile in pair.get("profiles", {}).values():
            for key, points in list(profile.items()):
                if key.endswith("_xyz") and isinstance(points[0], Sequence):
                    del profile[key]
                    profile[key.removesuffix("_xyz")] = [lonlat(point) for point in points]
    return replace(document, data={**document.data, **tables})


def number_path(document: Document, key: str) -> KeyPath:
    """Return the location in a mechanism file of the number that a key names.

    Parameters
    ----------
    document
        A mechanism file with directions as angles, see `document_of`.
    key
        The name of a number in the words of users: its location, with dots between the
        parts, such as ``pairs.41.zero``. An arc of a link can be named by the pair (joint)
        to which the arc leads, ``links.3.arcs.43``. If the link has only one arc,
        ``links.3.arc`` is enough. The axis of a pair has a ``longitude`` and a
        ``latitude``.

    Returns
    -------
    Keys and indices that lead to the number, such as ``("links", "3", "arcs", 0)``.

    Raises
    ------
    FileError
        If there is no such number.
    """
    # The first two parts are a table and the name of an element in it, such as a pair. The
    # name is empty if the key has one part only.
    table, _, path_in_table = key.partition(".")
    name, _, _ = path_in_table.partition(".")
    path_by_key = _number_paths(document, table, name)
    if key in path_by_key:
        return path_by_key[key]

    explanation = _explain_missing_number(document, key, path_by_key)
    raise FileError(f"{document.name}: {explanation}")


@dataclass(frozen=True)
class ReachedTable:
    """The innermost table of a file to which the parts of a key lead.

    The parts of the key ``links.2.arc``, for example, are "links", "2" and "arc". A user
    can give a key that names no number. The error message then says which part is missing,
    and which names the table has.

    Attributes
    ----------
    path
        The parts of the key that exist.
    missing_part
        The first part that does not exist, None if all parts exist.
    entries
        The contents of the table, by name. Empty if the existing parts lead to a list, a
        number or a text.
    """

    path: KeyPath
    missing_part: str | None
    entries: Mapping[str, Any]


def _follow_key(data: Mapping[str, Any], key: str) -> ReachedTable:
    """Follow the parts of a key, such as ``pairs.41.zero``, through nested tables."""
    path: KeyPath = ()
    entries = data
    for part in key.split("."):
        if part not in entries:
            return ReachedTable(path, part, entries)
        path = (*path, part)
        value = entries[part]
        entries = value if isinstance(value, Mapping) else {}
    return ReachedTable(path, None, entries)


def _explain_missing_number(
    document: Document, key: str, path_by_key: Mapping[str, KeyPath]
) -> str:
    """Return a message that explains why a key names no number, and lists valid keys.

    Parameters
    ----------
    document
        A mechanism file.
    key
        The key, such as ``links.2.arcs``.
    path_by_key
        The keys of all numbers of the same element of the file, such as a link, and their
        locations. If a number has several keys, the shorter ones come later.
    """
    reached = _follow_key(document.data, key)
    if reached.missing_part is None:
        # The key leads to something else than a number.
        problem = _explain_other_value(key, path_by_key)
    else:
        problem = _explain_missing_part(key, reached, reached.missing_part)
    # `problem.prefix` is the beginning of the key that is valid. The user may mean another
    # key with this beginning. Of the keys of one number, the message lists the shorter one
    # first: "links.2.arc" before "links.2.arcs.0".
    shorter_first = reversed(list(path_by_key))
    similar_keys = [
        other_key for other_key in shorter_first if other_key.startswith(problem.prefix)
    ]
    # Without similar keys, the message lists the names in the innermost table to which the
    # key leads.
    available = similar_keys or list(reached.entries)
    if not available:
        return problem.text
    return f"{problem.text} Available: {listing(available)}"


@dataclass(frozen=True)
class KeyProblem:
    """Why a key that a user gave, such as ``links.2.arc``, names no number of the file.

    Attributes
    ----------
    text
        The reason as a sentence, perhaps with a proposal of a similar key.
    prefix
        Keys of numbers that begin with this text may be the ones that the user meant.
    """

    text: str
    prefix: str


def _explain_other_value(key: str, path_by_key: Mapping[str, KeyPath]) -> KeyProblem:
    """Explain that a key exists but leads to a table, a list or a text.

    An example is ``links.2.arcs``, which leads to the list of the arcs of a link. The
    result has the message and a prefix. The caller lists the valid keys that begin with the
    prefix, because the user may have meant one of them.

    Parameters
    ----------
    key
        The key.
    path_by_key
        The keys of all numbers of the same element of the file, such as a link, and their
        locations.
    """
    suggestion = nearest(key, path_by_key)  # "; did you mean ...?", or ""
    if not suggestion:
        return KeyProblem(f'the value of "{key}" is not a number.', prefix=key)
    # If the list "links.2.arcs" has only one number, this number has two keys:
    # "links.2.arcs.0" and "links.2.arc". Without its final s, the prefix fits both.
    prefix = key.removesuffix("s")
    return KeyProblem(f'the value of "{key}" is not a number{suggestion}', prefix)


def _explain_missing_part(key: str, reached: ReachedTable, missing_part: str) -> KeyProblem:
    """Explain that a part of a key does not exist in the table to which the key leads."""
    where = f"{key_path_text(reached.path)}: " if reached.path else ""
    suggestion = nearest(missing_part, reached.entries)
    return KeyProblem(
        f'the key "{key}" names no number: {where}there is no "{missing_part}"'
        f"{suggestion or '.'}",
        prefix=".".join(map(str, reached.path)),
    )


def _number_paths(document: Document, table: str, name: str) -> dict[str, KeyPath]:
    """Return the locations of all numbers of an element of a file, by the user's keys.

    A number can have several keys. An example is the number at ``("links", "2", "arcs",
    0)``, which has the keys ``links.2.arcs.0``, ``links.2.arcs.32`` (the pair to which the
    arc leads) and ``links.2.arc``, if the link has only one arc.

    Parameters
    ----------
    document
        A mechanism file with directions as angles.
    table, name
        Name of the table and of the element in it, such as ``"links"`` and ``"2"``. If
        there is no such element, the result is empty.

    Returns
    -------
    For each key, such as ``"links.2.arc"``, the location: a tuple of the keys and indices
    that lead to the number in the data, such as ``("links", "2", "arcs", 0)``.
    """
    entry: Any = {}
    with suppress(AttributeError, KeyError, TypeError):
        entry = document.data[table][name]
    # The location of each number. The key is stored without table and element, as the tuple
    # of its other parts: ("arcs", "32") for ``links.2.arcs.32``.
    path_by_parts: dict[KeyPath, KeyPath] = {}
    # The angles ``zero`` and ``value`` of pairs have keys even if the file leaves them out.
    if table == "pairs" and entry:
        for part in _OPTIONAL_PAIR_KEYS:
            single_part = (part,)
            path_by_parts[single_part] = (table, name, part)
    for inner_path, value in values_in(entry if isinstance(entry, Mapping) else {}):
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        # The first key of a number has the same parts as its location.
        path = (table, name, *inner_path)
        path_by_parts.setdefault(inner_path, path)
        # Further keys. The two numbers of a direction get the keys longitude and latitude.
        # The part "lonlat" may be left out: "pairs.41.longitude" stands for
        # "pairs.41.lonlat.longitude".
        *outer, last = inner_path
        array_key = next((part for part in reversed(outer) if isinstance(part, str)), "")
        is_direction = array_key.endswith(_DIRECTION_KEYS) and table != "user"
        if isinstance(last, int) and is_direction:
            path_by_parts[*outer, _LONLAT_NAMES[last]] = path
            if outer[-1] == "lonlat":
                path_by_parts[*outer[:-1], _LONLAT_NAMES[last]] = path
        match table, inner_path:
            case "links", ("arcs" | "angles" as sizes, int(index)):
                # A size can be named by the pair to whose axis it belongs. Axes are
                # numbered in the order of `axes`, the names of the pairs on the link.
                # arcs[k] leads from axis 0 to axis k + 1. angles[k] is the angle at axis 0
                # between the arc to axis 1 and the arc to axis k + 2.
                ends = entry.get("axes", ())[1 if sizes == "arcs" else 2 :]
                if index < len(ends):
                    path_by_parts[sizes, ends[index]] = path
                # A pair can have a number as its name, which then is no index.
                if str(index) in ends:
                    del path_by_parts[inner_path]
                if len(entry[sizes]) == 1:
                    # The key of an only size is "arc" or "angle", without the final s.
                    single_part = (sizes[:-1],)
                    path_by_parts[single_part] = path
    return {
        ".".join((table, name, *map(str, parts))): path
        for parts, path in path_by_parts.items()
    }


def is_angle(document: Document, key: str) -> bool:
    """Return whether a number of a mechanism file is an angle, so that it has a unit.

    Parameters
    ----------
    document, key
        The file and the key of the number, such as ``links.2.arc``; see `number_path`.
    """
    path = number_path(document, key)
    # `angle_paths` lacks angles of pairs that the file leaves out.
    return path in angle_paths(document) or path[-1] in _OPTIONAL_PAIR_KEYS


def number_at(document: Document, path: KeyPath) -> float:
    """Return the number at a path in a mechanism file.

    A path consists of the keys and indices that lead to the number. The result is 0 if the
    file leaves out the number, or a table on the path to the number.
    """
    value: Any = document.data
    for step in path:
        value = value[step] if isinstance(step, int) else value.get(step)
        if value is None:
            return 0.0
    return float(value)


def with_numbers(document: Document, numbers: Mapping[KeyPath, float]) -> Document:
    """Return the data of a file in which some numbers are replaced.

    Only tables and lists that contain a new number are copied. The old and the new document
    share all other tables and lists.

    Parameters
    ----------
    document
        The data of the file.
    numbers
        The new numbers by their locations: keys and indices that lead to them.
    """
    data = dict(document.data)
    copied_paths: set[KeyPath] = set()
    for path, number in numbers.items():
        # Walk from the outermost table to the innermost one, and copy each once.
        container: Any = data
        for depth, key in enumerate(path[:-1], start=1):
            if path[:depth] not in copied_paths:
                container[key] = copy.copy(container[key])
                copied_paths.add(path[:depth])
            container = container[key]
        # The number keeps its decimal text, from which units are converted without rounding
        # errors.
        decimal_text = repr(float(number))
        container[path[-1]] = LiteralNumber(decimal_text)
    return replace(document, data=data)
