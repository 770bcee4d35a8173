"""Which line of a TOML text each key and array item stands on; tomllib does not say."""

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import final

KeyPath = tuple[str | int, ...]
"""A path into the parsed data: keys, and positions within arrays."""

_BLANK = re.compile(r"[ \t]*")
_GAP = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")
_STRINGS = (
    re.compile(r'"""(?:[^\\"]|\\[\s\S]|"(?!""))*"{3,5}'),
    re.compile(r"'''(?:[^']|'(?!''))*'{3,5}"),
    re.compile(r'"(?:[^"\\\n]|\\[^\n])*"'),
    re.compile(r"'[^'\n]*'"),
)


def locate(text: str) -> Mapping[KeyPath, int]:
    """Return the line number (from 1) of every key path in a TOML text.

    A text that does not parse gives the lines up to the fault.
    """
    scanner = _Scanner(text)
    with suppress(_Unreadable, RecursionError):
        scanner.document()
    return scanner.lines


def line_of(lines: Mapping[KeyPath, int], path: KeyPath) -> int:
    """Return the line of a key path, or that of the nearest table around it."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return 1


class _Unreadable(Exception):
    """The text is not TOML from here on."""


@final
class _Scanner:
    """One pass over a TOML text; values are skipped, not interpreted."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        self.line = 1
        self.lines: dict[KeyPath, int] = {}
        self.array_sizes: dict[KeyPath, int] = {}

    def document(self) -> None:
        table: KeyPath = ()
        self.take(_GAP)
        while self.position < len(self.text):
            if self.text.startswith("[[", self.position):
                table = self.header("[[", "]]")
            elif self.text.startswith("[", self.position):
                table = self.header("[", "]")
            else:
                self.assignment(table)
            self.take(_GAP)

    def header(self, opening: str, closing: str) -> KeyPath:
        self.expect(opening)
        line = self.line
        keys = self.key()
        self.expect(closing)
        path: KeyPath = ()
        for key in keys[:-1]:
            path = self.enter(path, key)
            self.lines.setdefault(path, line)
        if opening == "[":
            path = (*path, keys[-1])
        else:
            name = (*path, keys[-1])
            self.lines.setdefault(name, line)
            self.array_sizes[name] = self.array_sizes.get(name, 0) + 1
            path = self.enter(path, keys[-1])
        # A table opened by the header of a table inside it has its own header later.
        self.lines[path] = line
        return path

    def enter(self, path: KeyPath, key: str) -> KeyPath:
        """Return the path of a table; in an array of tables, of its last one."""
        inner = (*path, key)
        size = self.array_sizes.get(inner, 0)
        return (*inner, size - 1) if size else inner

    def assignment(self, table: KeyPath) -> None:
        path, line = table, self.line
        for key in self.key():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self.expect("=")
        self.take(_BLANK)
        self.value(path)

    def key(self) -> list[str]:
        keys: list[str] = []
        while True:
            self.take(_BLANK)
            if self.text.startswith(('"', "'"), self.position):
                keys.append(_unquoted(self.string()))
            else:
                keys.append(self.need(_BARE_KEY))
            self.take(_BLANK)
            if not self.text.startswith(".", self.position):
                return keys
            self.position += 1

    def value(self, path: KeyPath) -> None:
        if self.text.startswith(('"', "'"), self.position):
            self.string()
        elif self.text.startswith("[", self.position):
            self.array(path)
        elif self.text.startswith("{", self.position):
            self.inline_table(path)
        else:
            self.need(_SCALAR)

    def array(self, path: KeyPath) -> None:
        self.expect("[")
        self.take(_GAP)
        index = 0
        while not self.text.startswith("]", self.position):
            item = (*path, index)
            self.lines[item] = self.line
            self.value(item)
            self.comma_before("]")
            index += 1
        self.expect("]")

    def inline_table(self, path: KeyPath) -> None:
        self.expect("{")
        self.take(_GAP)
        while not self.text.startswith("}", self.position):
            self.assignment(path)
            self.comma_before("}")
        self.expect("}")

    def comma_before(self, closing: str) -> None:
        self.take(_GAP)
        if not self.text.startswith(closing, self.position):
            self.expect(",")
            self.take(_GAP)

    def string(self) -> str:
        for pattern in _STRINGS:
            if pattern.match(self.text, self.position):
                return self.take(pattern)
        raise _Unreadable

    def need(self, pattern: re.Pattern[str]) -> str:
        taken = self.take(pattern)
        if not taken:
            raise _Unreadable
        return taken

    def expect(self, symbol: str) -> None:
        if not self.text.startswith(symbol, self.position):
            raise _Unreadable
        self.position += len(symbol)

    def take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.position)
        if match is None:
            return ""
        self.position = match.end()
        self.line += match[0].count("\n")
        return match[0]


def _unquoted(key: str) -> str:
    if key.startswith("'"):
        return key[1:-1]
    try:
        return str(json.loads(key, strict=False))
    except ValueError:  # an escape that TOML has and JSON has not, such as \U0001F600
        return key[1:-1]
