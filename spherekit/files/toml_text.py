"""TOML text from values: keys, strings, arrays and tables, laid out for reading."""

import datetime
import re
from collections.abc import Iterator, Mapping
from typing import Any

from spherekit.escaping import toml_string
from spherekit.files.toml_document import LiteralNumber

_WIDTH = 88
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def assignment(key: str, value: object) -> str:
    """Return ``key = value``; an array too long for a line gets one item a line."""
    line = f"{key_text(key)} = {value_text(value)}"
    if len(line) <= _WIDTH or not isinstance(value, list | tuple):
        return line
    items = "".join(f"    {value_text(item)},\n" for item in value)
    return f"{key_text(key)} = [\n{items}]"


def tables(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """Return the lines of a table and the tables within it, each after a blank line."""
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lines = [assignment(key, table[key]) for key in table if key not in inner]
    if lines or not inner:
        yield from ("", f"[{'.'.join(map(key_text, path))}]", *lines)
    for key, value in inner.items():
        yield from tables((*path, key), value)


def key_text(key: object) -> str:
    """Return a key, in quotes where TOML needs them."""
    if not isinstance(key, str):
        raise TypeError(f"the key {key!r} is not text")
    return key if _BARE_KEY.fullmatch(key) else toml_string(key)


def value_text(value: object) -> str:
    """Return a value on one line.

    Raises
    ------
    TypeError
        If TOML has no such value.
    """
    if isinstance(value, LiteralNumber):
        return value.text
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, int):  # true and false too
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(value_text(item) for item in value)}]"
    if isinstance(value, Mapping):
        items = (f"{key_text(key)} = {value_text(item)}" for key, item in value.items())
        return f"{{{', '.join(items)}}}"
    raise TypeError(f"TOML has no value of type {type(value).__name__}")
