"""Writes values as TOML text.

A library would write the same data, but with another layout. The layout matters here: the
hash of a mechanism is computed from this text, and run folders store it.
"""

import datetime
import re
from collections.abc import Iterator, Mapping
from typing import Any

from spherekit.escaping import toml_string
from spherekit.files.toml_document import LiteralNumber

MAX_LINE_CHARACTERS = 88
"""Longest line of an array; a longer array is written with one item a line."""

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def assignment_text(key: str, value: object) -> str:
    """Return ``key = value``, on several lines if the value is a long array."""
    try:
        line = f"{key_text(key)} = {value_text(value)}"
    except TypeError as error:
        raise TypeError(f"{key}: {error}; give another value, or omit this key") from None
    if len(line) <= MAX_LINE_CHARACTERS or not isinstance(value, list | tuple):
        return line
    items = "".join(f"    {value_text(item)},\n" for item in value)
    return f"{key_text(key)} = [\n{items}]"


def table_lines(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a TOML file for a table and the tables within it.

    Each table begins with a blank line and its header, such as ``[links.2]``. A table that
    contains only other tables gets no header.

    Parameters
    ----------
    path
        The keys that lead to the table, for the header.
    table
        Values and inner tables by key.
    """
    inner_tables = {key: item for key, item in table.items() if isinstance(item, Mapping)}
    assignments = [
        assignment_text(key, table[key]) for key in table if key not in inner_tables
    ]
    if assignments or not inner_tables:
        yield ""
        yield f"[{'.'.join(map(key_text, path))}]"
        yield from assignments
    for key, inner_table in inner_tables.items():
        yield from table_lines((*path, key), inner_table)


def key_text(key: object) -> str:
    """Return a key, in quotes if TOML needs them.

    Raises
    ------
    TypeError
        If the key is not text.
    """
    if not isinstance(key, str):
        raise TypeError(f"the key {key!r} is not text")
    return key if _BARE_KEY.fullmatch(key) else toml_string(key)


def value_text(value: object) -> str:
    """Return a Python value as TOML text on one line, to be written after a key.

    Raises
    ------
    TypeError
        If TOML has no values of this type.
    """
    if isinstance(value, LiteralNumber):
        return value.text
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, int):
        # This includes True and False, which TOML writes in lower case.
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(value_text(item) for item in value)}]"
    if isinstance(value, Mapping):
        items = [f"{key_text(key)} = {value_text(item)}" for key, item in value.items()]
        return f"{{{', '.join(items)}}}"
    raise TypeError(f"TOML has no value of type {type(value).__name__}")
