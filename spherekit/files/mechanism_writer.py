"""Writes a mechanism as a TOML file of format 1, in canonical order."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath
from spherekit.errors import EngineError, FileError, OutputError
from spherekit.files.mechanism_reader import AnyMechanism, loads, mechanism_of
from spherekit.files.schema import FORMAT
from spherekit.files.toml_document import Table
from spherekit.files.toml_text import assignment_text, table_lines
from spherekit.files.units import convert_to_file, table_of
from spherekit.mechanism.elements import Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.load import Load, no_expression_message
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.quantity import AngleUnit
from spherekit.storage.atomic_write import write_text

_Table = dict[str, Any]


@checked(OutputError)
def dump(mechanism: AnyMechanism, path: AnyPath, angle_unit: AngleUnit = "deg") -> None:
    """Write a mechanism file that reads back as exactly this mechanism.

    Parameters
    ----------
    mechanism
        The mechanism, its name, or its file.
    path
        Path of the file to be written.
    angle_unit
        Unit of the angles in the file, "deg" or "rad".

    Raises
    ------
    OutputError
        If no file can be written at `path`, or the format cannot express the mechanism.
    """
    write_text(path, dumps(mechanism_of(mechanism), angle_unit))


@checked(OutputError)
def dumps(mechanism: Mechanism, angle_unit: AngleUnit = "deg") -> str:
    """Return the text of a file that reads back as exactly this mechanism.

    Parameters
    ----------
    mechanism
        The mechanism.
    angle_unit
        Unit of the angles in the file, "deg" or "rad".

    Raises
    ------
    OutputError
        If the format cannot express the mechanism. Examples are an axis that is not a unit
        vector, a profile with fields of another kind (such as a great circle with a
        radius), a load that is a Python function, and user data of a type that TOML lacks.
    """
    try:
        text = canonical_text(mechanism, angle_unit)
    except EngineError as error:
        raise OutputError(f"{mechanism.name}: cannot be written: {error}") from None
    try:
        read_back = loads(text, mechanism.name)
    except FileError as error:
        # Lines of the message begin with the name and often with a line number of the
        # file. There is no file yet, so this beginning is removed.
        location = rf"^{re.escape(mechanism.name)}(:\d+)?: "
        message = re.sub(location, "", str(error), flags=re.MULTILINE)
        raise OutputError(f"{mechanism.name}: cannot be written: {message}") from None
    # Nothing is lost if the mechanism that was read back has the same text.
    lines = text.split("\n")
    lines_read_back = canonical_text(read_back, angle_unit).split("\n")
    for line, line_read_back in zip_longest(lines, lines_read_back):
        if line != line_read_back:
            # A line is None if its text has ended.
            change = _describe_change(line or "", line_read_back or "")
            advice = "give only values that the file format has for this table"
            if _changes_direction(line or "", line_read_back or ""):
                advice = "give unit vectors"
            raise OutputError(
                f"{mechanism.name}: {change} when the file is read back; {advice}"
            )
    return text


def _describe_change(line: str, line_read_back: str) -> str:
    """Return how a line of a file changes when the file is read back, for an error message.

    `dumps` writes a mechanism, reads it back and writes it again. The two texts must be
    equal. The arguments are the lines at which they first differ. Examples of the result:
    "radius = 20.0 would become 10.0", "radius = 20.0 would be lost".

    Parameters
    ----------
    line
        The line of the first text. Empty between two tables and after the end.
    line_read_back
        The line of the second text, in the same place. Empty in the same cases.
    """
    if not line:
        # The table or the file ends here in the first text only.
        return f"{line_read_back} would be added"
    key, _, value_read_back = line_read_back.partition(" = ")
    if value_read_back and line.startswith(f"{key} = "):
        return f"{line} would become {value_read_back}"
    # The second text has another key here, so the key of `line` is lost.
    return f"{line} would be lost"


def _changes_direction(line: str, line_read_back: str) -> bool:
    """Whether both lines give the same direction, such as an axis, other components.

    The reader normalises directions, so only unit vectors are read back unchanged.
    """
    key, _, _ = line.partition(" = ")
    is_direction = key == "xyz" or key.endswith("_xyz")
    return is_direction and line_read_back.startswith(f"{key} = ")


def canonical_text(mechanism: Mechanism, angle_unit: AngleUnit) -> str:
    """Return the text of a mechanism file, without checking that it can be read back.

    `dumps` adds this check. Without it, there is also a text of a mechanism whose file the
    reader would refuse, for example for `mechanism_hash`.

    The text is made from the mechanism alone. The form of a file from which the mechanism
    was read, such as comments and the order of keys, has no influence. Nevertheless, the
    texts of equal mechanisms can differ in the order of modes, in the signs of zeros, and
    in user data (order of keys, or 1 instead of 1.0).

    Raises
    ------
    OutputError
        If the user data holds what TOML lacks.
    EngineError
        If a load is a Python function.
    """
    try:
        return "\n".join([*_lines(mechanism, angle_unit), ""])
    except (TypeError, ValueError, RecursionError) as error:
        raise OutputError(f"{mechanism.name}: cannot be written: {error}") from None


def mechanism_hash(mechanism: Mechanism) -> str:
    """Return the SHA-256 of a mechanism's canonical file in radians, in hexadecimal.

    The errors are those of `canonical_text`.
    """
    # Text in user data may have surrogates, which UTF-8 lacks.
    content = canonical_text(mechanism, "rad").encode(errors="surrogatepass")
    return hashlib.sha256(content).hexdigest()


def _lines(mechanism: Mechanism, unit: AngleUnit) -> Iterator[str]:
    """Yield the lines of the file."""
    yield assignment_text("format", FORMAT)
    yield assignment_text("name", mechanism.name)
    yield assignment_text("angle_unit", unit)
    yield assignment_text("ground", mechanism.ground)
    if mechanism.description:
        yield assignment_text("description", mechanism.description)
    for name, table in convert_to_file(_tables(mechanism), unit).items():
        yield from table_lines((name,), table)


def _tables(mechanism: Mechanism) -> dict[str, _Table]:
    """Return the tables of a mechanism file by name. Empty tables are left out.

    Values are taken from the model, with angles in rad. They are converted to the unit of
    the file later.
    """
    geometry = mechanism.geometry
    source = mechanism.source
    # The other kind of geometry (a pose with the axes of all pairs) has no sizes of links.
    # It is written to the tables of the pairs.
    link_sizes = geometry.links if isinstance(geometry, SizeGeometry) else {}
    tables: dict[str, _Table] = {
        "source": {} if source is None else table_of(source),
        "links": {
            link: table_of(link_sizes[link]) if link in link_sizes else {}
            for link in mechanism.links
        },
        "pairs": {pair.name: _pair_table(mechanism, pair) for pair in mechanism.pairs},
        "inputs": {item.pair: table_of(item) for item in mechanism.inputs},
        "outputs": {output.name: table_of(output) for output in mechanism.outputs},
        "mass": {mass.link: table_of(mass) for mass in mechanism.masses},
        "loads": {load.name: _load_table(load) for load in mechanism.loads},
        "joint_limits": {limit.pair: table_of(limit) for limit in mechanism.joint_limits},
        "modes": dict(mechanism.modes),
        "user": dict(mechanism.user),
    }
    return {name: table for name, table in tables.items() if table}


def _pair_table(mechanism: Mechanism, pair: Pair) -> _Table:
    """Return the table of a pair (joint) in a mechanism file.

    If the geometry of the mechanism is a reference pose (one configuration), the table has
    the axis of the pair and its variable in this pose. If the geometry consists of sizes of
    links, the table has the zero angle of the pair: the angle between the reference
    directions of both links if the variable is 0.
    """
    table: _Table = {"type": pair.type, "links": pair.links}
    geometry = mechanism.geometry
    # For each key that this pair may have: the values of all pairs.
    values_by_key: Mapping[str, Table]
    if isinstance(geometry, PoseGeometry):
        values_by_key = {"xyz": geometry.axes, "value": geometry.values}
    else:
        values_by_key = {"zero": geometry.zeros}
    for key, value_by_pair in values_by_key.items():
        if pair.name in value_by_pair:
            table[key] = value_by_pair[pair.name]
    # The other keys of the pair follow, such as "one_sided". Values equal to the default
    # are left out.
    table |= table_of(pair)
    for link, profile in zip(pair.links, pair.profiles or (), strict=False):
        profile_table = table_of(profile)
        if profile.points:
            # Only curves through points can be closed or open.
            profile_table["closed"] = profile.closed
        table.setdefault("profiles", {})[link] = profile_table
    return table


def _load_table(load: Load) -> _Table:
    """Return the table of a load in a mechanism file.

    Keys without a value are left out, and so is the default kind, a torque at a pair.

    Raises
    ------
    EngineError
        If the load is a Python function, which cannot be written to a file.
    """
    table: _Table = {} if load.kind == PairTorque.kind else {"kind": load.kind}
    for key in load.field_kinds:
        value = getattr(load, key)
        if callable(value):
            raise EngineError(no_expression_message(getattr(load, "pair", "")))
        if value is not None:
            table[key] = value
    return table
