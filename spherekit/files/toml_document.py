"""A TOML file as text and data, whose faults name file, line and key."""

import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from spherekit.errors import FileError, ModelError
from spherekit.files.toml_lines import KeyPath, locate

Table = Mapping[str, Any]
"""A table of a file, or the whole of it."""


MAX_BYTES = 4 * 1024 * 1024
"""Largest file read; the largest mechanisms need some 100 kB."""

MAX_NESTING = 32
"""Deepest nesting of tables and arrays; the format itself needs 6."""

MAX_KEYS = 30000
"""Most keys and tables of a file; a thousand links and pairs need some 10 000."""

MAX_VALUES = 200000
"""Most values in the arrays of a file."""

MOST_FAULTS = 8
"""Most faults of a file that are told at once."""

_HEADER = re.compile(r"^[ \t]*\[[^,=\n]*\][ \t]*(?:#.*)?$", re.M)
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_MORE_PARTS = rf"(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_NESTING}}}"
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}{_MORE_PARTS}")
_HUGE_INTEGER = re.compile(r"[0-9_]{4300}")
_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.S)
_REPEATED = re.compile(r"Cannot declare \((.*?),?\) twice", re.S)


class LiteralNumber(float):
    """A float that remembers how it was written, so that units convert exactly."""

    __slots__ = ("text",)
    text: str

    def __new__(cls, text: str) -> "LiteralNumber":
        """Read a decimal number."""
        number = super().__new__(cls, text)
        number.text = text
        return number


@dataclass(frozen=True)
class Document:
    """A parsed TOML file; its floats are `LiteralNumber`.

    Data that a program has made come without a text, and their faults without a line.
    """

    name: str
    text: str | None
    data: Table

    @cached_property
    def lines(self) -> Mapping[KeyPath, int]:
        """The line of every key path."""
        return locate(self.text or "")

    def line(self, path: KeyPath) -> int:
        """Return the line of a key path, or that of the nearest table around it."""
        starts = (path[:length] for length in range(len(path), 0, -1))
        return next((self.lines[start] for start in starts if start in self.lines), 1)

    def sentence(self, path: KeyPath, message: str) -> str:
        """Return ``file:line: key.path: message``."""
        key = f"{spelt(path)}: " if path else ""
        where = "" if self.text is None else f":{self.line(path)}"
        return f"{self.name}{where}: {key}{message}"

    def fault(self, path: KeyPath, message: str) -> FileError | ModelError:
        """Return the error to raise about a key path."""
        return self._error(self.sentence(path, message))

    def faults(self, faults: Iterable[tuple[KeyPath, str]]) -> FileError | ModelError:
        """Return one error for several faults, one a line, in the order of the file."""
        unique = dict.fromkeys(sorted(faults, key=lambda item: self.line(item[0])))
        sentences = [self.sentence(path, message) for path, message in unique]
        rest = len(sentences) - MOST_FAULTS
        if rest > 0:
            sentences[MOST_FAULTS:] = [f"{self.name}: and {rest} more faults"]
        return self._error("\n".join(sentences))

    @property
    def _error(self) -> type[FileError | ModelError]:
        return ModelError if self.text is None else FileError


def spelt(path: KeyPath) -> str:
    """Return a key path as people write it: ``pairs.21.links[0]``."""
    words = ""
    for part in path:
        if isinstance(part, int):
            words += f"[{part}]"
        else:
            shown = part if re.fullmatch(r"[\w-]{1,80}", part) else ascii(part)[:80]
            words += f".{shown}" if words else shown
    return words


_PIPED: dict[int, bytes] = {}


def piped(path: Path, most: int = -1) -> bytes | None:
    """Return what comes through a pipe that the shell has opened; None of other files.

    It is kept, since a pipe gives it once: ``/dev/stdin``, ``/dev/fd/63``.

    Raises
    ------
    OSError, ValueError
        If it cannot be read.
    """
    status = path.stat()
    if not stat.S_ISFIFO(status.st_mode) or path.parts[1:2] not in (("dev",), ("proc",)):
        return None
    with path.open("rb") as stream:
        return _PIPED.setdefault(status.st_ino, stream.read(most))


def read_text(path: Path) -> str:
    """Return the text of a file, refusing what cannot be a mechanism file.

    Raises
    ------
    FileError
        If it cannot be opened, is not a regular file or a pipe of the shell, is too
        large, or is not UTF-8.
    """
    try:
        if path.is_dir():
            raise FileError(f"{path}: is a folder; name a file in it")
        data = piped(path, MAX_BYTES + 1)
        if data is not None:
            return _decoded(data, str(path))
        # A pipe would block here for ever; it is refused just below.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise FileError(f"{str(path)!r}: cannot be opened: {reason}") from None
    try:
        with open(handle, "rb") as stream:  # noqa: PTH123 (an open descriptor)
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise FileError(f"{path}: is a device or a pipe, not a regular file")
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from None
    size = max(status.st_size, len(data))
    if size > MAX_BYTES:
        raise FileError(
            f"{path}: has {size} bytes; at most {MAX_BYTES} are read, and a mechanism "
            "file needs far fewer: is it another file?"
        )
    return _decoded(data, str(path))


def parse(text: str, name: str) -> Document:
    """Parse a TOML text.

    Raises
    ------
    FileError
        If it is not TOML, is too large, has too many keys or
        values, or is nested too deeply.
    """
    if len(text) > MAX_BYTES:
        raise FileError(f"{name}: has {len(text)} characters, at most {MAX_BYTES}")
    text = text.replace("\r\n", "\n").removeprefix("\ufeff")
    if long_key := _LONG_KEY.search(text):
        line = text.count("\n", 0, long_key.start()) + 1
        raise FileError(f"{name}:{line}: a key has over {MAX_NESTING} dotted parts")
    keys = text.count("=") + len(_HEADER.findall(text))
    for count, most, what in (
        (keys, MAX_KEYS, "keys and tables"),
        (text.count(","), MAX_VALUES, "values"),
    ):
        if count > most:
            raise FileError(f"{name}: has {count} {what}, at most {most} are read")
    try:
        data = tomllib.loads(text, parse_float=LiteralNumber)
    except tomllib.TOMLDecodeError as error:
        raise FileError(_syntax_fault(text, name, str(error))) from None
    except RecursionError:
        depths = [line.count("[") + line.count("{") for line in text.split("\n")]
        line = depths.index(max(depths)) + 1
        raise FileError(
            f"{name}:{line}: nested too deeply; at most {MAX_NESTING} levels"
        ) from None
    except (ValueError, OverflowError):
        digits = _HUGE_INTEGER.search(text)
        line = text.count("\n", 0, digits.start()) + 1 if digits else 1
        raise FileError(f"{name}:{line}: a value cannot be read: too many digits") from None
    document = Document(name, text, data)
    for path, value in values_in(data):
        inner = isinstance(path[-1], str) or isinstance(value, dict | list)
        if len(path) > MAX_NESTING and inner:
            raise document.fault(
                path[:3], f"nested too deeply; at most {MAX_NESTING} levels"
            )
    return document


def _decoded(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
        guess = "it looks like UTF-16; " if utf16 else ""
        raise FileError(
            f"{name}:{line}: not UTF-8: byte 0x{data[error.start]:02x} at offset "
            f"{error.start}; {guess}save the file as UTF-8"
        ) from None


def values_in(data: Table) -> Iterator[tuple[KeyPath, Any]]:
    """Yield everything in tables and arrays, these too, with its path."""
    waiting: list[tuple[KeyPath, Any]] = [((key,), item) for key, item in data.items()]
    while waiting:
        path, value = waiting.pop()
        yield path, value
        if isinstance(value, dict):
            waiting.extend(((*path, key), item) for key, item in value.items())
        elif isinstance(value, list):
            waiting.extend(((*path, k), item) for k, item in enumerate(value))


def _syntax_fault(text: str, name: str, message: str) -> str:
    parts = _SYNTAX.fullmatch(message)
    lines = text.split("\n")
    what = parts[1] if parts else message
    if parts and parts[2]:
        line, place = int(parts[2]), f"column {parts[3]}: "
    else:
        line, place = len(text.rstrip("\n").split("\n")), "at the end: "
    content = lines[line - 1]
    repeated = _REPEATED.search(what)
    if repeated:
        path = tuple(re.findall(r"'([^']*)'", repeated[1]))
        first = locate("\n".join(lines[: line - 1])).get(path, 0)
        seen = f", first on line {first}" if first else ""
        twice = f"{spelt(path)}: is given twice{seen}"
        return f"{name}:{line}: {twice}; names are unique ({what})"
    subject = re.sub(r"\"[^\"]*\"|'[^']*'|#.*", "", f"{what}\n{content}")
    hint = next((hint for pattern, hint in _HINTS if re.search(pattern, subject)), "")
    return f"{name}:{line}: {place}{what}{hint}"


_HINTS = (
    ("^Cannot overwrite", "; this key is given twice; keys are unique"),
    (r"(?<![\w.])\.\d", "; a number starts with a digit: write 0.5, not .5"),
    (r"\d\.(?!\d)", "; a number has digits after its point: write 5.0 or 5, not 5."),
    (r"=\s*(True|False)\b", "; write true or false in small letters"),
    (r"=\s*[A-Za-z_]", '; text needs quotes: write "R", not R'),
)
"""What is meant, by what tomllib says or what the line has outside of quotes."""
