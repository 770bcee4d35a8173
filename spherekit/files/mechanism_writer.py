"""A mechanism to a TOML file of format 1, in canonical order."""

import hashlib
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath
from spherekit.errors import EngineError, FileError, OutputError
from spherekit.files.mechanism_reader import AnyMechanism, loads, mechanism_of
from spherekit.files.schema import FORMAT
from spherekit.files.toml_document import Table
from spherekit.files.toml_text import assignment, tables
from spherekit.files.units import in_file, table_of
from spherekit.mechanism.elements import Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.load import Load, not_written
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import AngleUnit
from spherekit.storage.atomic_write import write_text

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
