"""A mechanism to a TOML file of format 1, in canonical order."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from spherekit.checked import checked
from spherekit.errors import EngineError, FileError, OutputError
from spherekit.files.atomic import write_text
from spherekit.files.read import AnyMechanism, loads, mechanism_of
from spherekit.files.schema import FORMAT
from spherekit.files.toml_text import assignment, tables
from spherekit.files.units import in_file, table_of
from spherekit.model.changes import AngleUnit
from spherekit.model.dynamics import PairTorque
from spherekit.model.load import Load, not_written
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Pair, PoseGeometry, Profile

_Table = dict[str, Any]


@checked(OutputError)
def dump(
    mechanism: AnyMechanism, path: str | os.PathLike[str], angle_unit: AngleUnit = "deg"
) -> None:
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
    if angle_unit not in ("deg", "rad"):
        raise OutputError(f'angle_unit is {angle_unit!r}; allowed: "deg", "rad"')
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
    changed = _first_difference(mechanism, again)
    if changed:
        raise OutputError(
            f"{mechanism.name}: {changed} would not read back the same; the format "
            "holds tuples, unit vectors, and in a profile only what its kind needs"
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
    source = mechanism.source
    content: dict[str, _Table] = {
        "source": {} if source is None else table_of(source),
        "links": {link: _link(mechanism, link) for link in mechanism.links},
        "pairs": {item.name: _pair(mechanism, item) for item in mechanism.pairs},
        "inputs": {item.pair: table_of(item) for item in mechanism.inputs},
        "outputs": {item.name: table_of(item) for item in mechanism.outputs},
        "mass": {item.link: table_of(item) for item in mechanism.masses},
        "loads": {item.name: _load(item) for item in mechanism.loads},
        "stops": {item.pair: table_of(item) for item in mechanism.stops},
        "modes": {mode.name: mode.values for mode in mechanism.modes},
        "user": dict(mechanism.user),
    }
    return {name: table for name, table in content.items() if table}


def _link(mechanism: Mechanism, link: str) -> _Table:
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry) or link not in geometry.links:
        return {}
    return table_of(geometry.links[link])


def _pair(mechanism: Mechanism, pair: Pair) -> _Table:
    table: _Table = {"type": pair.type, "links": pair.links}
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        where: Mapping[str, Mapping[str, Any]]
        where = {"xyz": geometry.axes, "value": geometry.values}
    else:
        where = {"zero": geometry.zeros}
    table |= {key: given[pair.name] for key, given in where.items() if pair.name in given}
    table |= table_of(pair)
    if pair.profiles is not None:
        profiles = zip(pair.links, pair.profiles, strict=True)
        table["profiles"] = {link: _profile(profile) for link, profile in profiles}
    return table


def _profile(profile: Profile) -> _Table:
    table = table_of(profile)
    return {**table, "closed": profile.closed} if profile.points else table


def _load(load: Load) -> _Table:
    table: _Table = {} if load.kind == PairTorque.kind else {"kind": load.kind}
    for key in load.keys:
        given = getattr(load, key)
        if callable(given):
            raise EngineError(not_written(getattr(load, "pair", "")))
        if given is not None:
            table[key] = given
    return table


def _first_difference(mechanism: Mechanism, again: Mechanism) -> str:
    for field in fields(mechanism):
        ours, theirs = getattr(mechanism, field.name), getattr(again, field.name)
        if field.name == "user":
            # As text, since a NaN in it differs from itself, and a tuple from a list.
            same = list(tables((), ours)) == list(tables((), theirs))
        else:
            try:
                same = bool(ours == theirs)
            except ValueError:  # NumPy arrays have no single truth value
                same = False
        if not same:
            return f"{field.name}{_place(ours, theirs)}"
    return ""


def _place(ours: object, theirs: object) -> str:
    if not isinstance(ours, tuple) or not isinstance(theirs, tuple):
        return ""
    for one, other in zip(ours, theirs, strict=False):
        if one is not other and repr(one) != repr(other):
            return f' of "{getattr(one, "name", one)}"'
    return ""
