"""A TOML file as text and data; a fault in it is reported with file, line and key."""

import ast
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
from spherekit.files.toml_lines import KeyPath, locate_keys
from spherekit.wording import counted

Table = Mapping[str, Any]
"""A table of a file, or the whole file."""

MAX_BYTES = 4 * 1024 * 1024
"""Largest file read; the largest mechanisms need some 100 kB."""

MAX_NESTING = 32
"""Deepest nesting of tables and arrays; the format itself needs 6.

Deeper nesting could exceed the recursion limit of the code that reads the data.
"""

MAX_KEYS = 30000
"""Most keys and tables of a file; a thousand links and pairs need some 10 000."""

MAX_VALUES = 200000
"""Most values in the arrays of a file."""

MAX_REPORTED_FAULTS = 8
"""Most faults of a file that one message lists."""

MAX_KEY_CHARACTERS = 80
"""Most characters of a key that a message shows."""

_HEADER = re.compile(r"^[ \t]*\[[^,=\n]*\][ \t]*(?:#.*)?$", re.M)
_KEY_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_MORE_PARTS = rf"(?:[ \t]*+\.[ \t]*+{_KEY_PART}){{{MAX_NESTING}}}"
_LONG_KEY = re.compile(rf"(?<![\w-]){_KEY_PART}{_MORE_PARTS}")
_HUGE_INTEGER = re.compile(r"[0-9_]{4300}")
"""An integer beyond the number of digits that Python converts."""

_PARSER_MESSAGE = re.compile(
    r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.S
)
_REPEATED_TABLE = re.compile(r"Cannot declare (\(.*\)) twice", re.S)

_SYNTAX_HINTS = (
    (
        "^Cannot overwrite",
        "this line gives a key that is given already: remove one of the two",
    ),
    (r"(?<![\w.])\.\d", "a number must start with a digit: write 0.5, not .5"),
    (
        r"\d\.(?!\w)|\d\.[eE][+-]?\d",
        "a number needs a digit after its decimal point: 5. is not allowed, write 5.0 or 5",
    ),
    (r"=\s*(True|False)\b", "true and false are written in small letters"),
    # The unclosed text remains after texts in quotes have been removed.
    (
        r"^Illegal character \n[^\n]*=\s*[\"']",
        "a text must end on its line, and the closing quote is missing: add the quote",
    ),
    (r"=\s*(?!(?:true|false|inf|nan)\b)[A-Za-z_]", 'text needs quotes: write "R", not R'),
)
"""Patterns of the parser's message followed by the faulty line, and a hint for each."""


class LiteralNumber(float):
    """A float that keeps its text in the file, so that units are converted exactly."""

    __slots__ = ("text",)
    text: str

    def __new__(cls, text: str) -> "LiteralNumber":
        """Read a decimal number."""
        number = super().__new__(cls, text)
        number.text = text
        return number


@dataclass(frozen=True)
class Document:
    """A parsed TOML file, which reports faults with file, line and key.

    A key path is a tuple of the keys and indices that lead to a value, such as
    ``("links", "2", "arcs", 0)``.

    Attributes
    ----------
    name
        Name of the file in messages.
    text
        Text of the file. None for data that a program has made.
    data
        The tables of the file. Floats of a text are `LiteralNumber`, which keep their
        decimals.
    """

    name: str
    text: str | None
    data: Table

    @cached_property
    def lines(self) -> Mapping[KeyPath, int]:
        """The line number of every key path."""
        return locate_keys(self.text or "")

    def line(self, path: KeyPath) -> int:
        """Return the line of a key path, or of the innermost table around it."""
        # From the whole path to its first key.
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return 1

    def sentence(self, path: KeyPath, message: str) -> str:
        """Return ``file:line: key.path: message``."""
        key = f"{key_path_text(path)}: " if path else ""
        line = "" if self.text is None else f":{self.line(path)}"
        return f"{self.name}{line}: {key}{message}"

    def fault(self, path: KeyPath, message: str) -> FileError | ModelError:
        """Return the error to raise about a key path."""
        return self._error(self.sentence(path, message))

    def faults(self, faults: Iterable[tuple[KeyPath, str]]) -> FileError | ModelError:
        """Return one error that lists several faults in the order of the file.

        Parameters
        ----------
        faults
            Key path (keys that lead to the value) and message of each fault. Equal faults
            are listed once.
        """
        # Sorted by the line of the key path. The dictionary removes repeated faults.
        unique_faults = dict.fromkeys(sorted(faults, key=lambda item: self.line(item[0])))
        sentences = [self.sentence(path, message) for path, message in unique_faults]
        unlisted = len(sentences) - MAX_REPORTED_FAULTS
        if unlisted > 0:
            sentences = sentences[:MAX_REPORTED_FAULTS]
            sentences.append(f"{self.name}: and {counted(unlisted, 'more fault')}")
        return self._error("\n".join(sentences))

    @property
    def _error(self) -> type[FileError | ModelError]:
        return ModelError if self.text is None else FileError


def key_path_text(path: KeyPath) -> str:
    """Return a key path as users write it: ``pairs.21.links[0]``.

    A path is a tuple of the keys and indices that lead to a value. Error messages show the
    text. A key is shown as it is if it has only letters, digits, ``_`` and ``-``. A key
    with other characters is put in quotes, with escape sequences. So is a key of more than
    `MAX_KEY_CHARACTERS`, and the text of a key is cut to this length.
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        is_plain = re.fullmatch(rf"[\w-]{{1,{MAX_KEY_CHARACTERS}}}", part)
        key = part if is_plain else ascii(part)[:MAX_KEY_CHARACTERS]
        text += f".{key}" if text else key
    return text


_pipe_contents: dict[int, bytes] = {}
"""What was read from pipes so far, by inode number."""


def read_pipe(path: Path, max_bytes: int = -1) -> bytes | None:
    """Return the content of a pipe that the shell has opened; None for other files.

    Examples are ``/dev/stdin`` and ``/dev/fd/63``. A pipe can be read only once, so later
    calls return the content that the first call has stored.

    Parameters
    ----------
    path
        The path of a file or a pipe.
    max_bytes
        Largest number of bytes that the first call reads; -1 for all. It has no effect on
        the result of later calls.

    Raises
    ------
    OSError, ValueError
        If the file or pipe cannot be read.
    """
    status = path.stat()
    is_shell_path = path.parts[1:2] in (("dev",), ("proc",))
    if not stat.S_ISFIFO(status.st_mode) or not is_shell_path:
        return None
    with path.open("rb") as stream:
        # A second call finds the pipe empty, because the first call has read it.
        content = stream.read(max_bytes)
    # The inode number identifies the pipe. `setdefault` returns stored content, if there is
    # some.
    return _pipe_contents.setdefault(status.st_ino, content)


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises
    ------
    FileError
        If the file cannot be opened, is neither a regular file nor a pipe of the shell, is
        larger than `MAX_BYTES`, or is not UTF-8.
    """
    try:
        if path.is_dir():
            raise FileError(f"{path}: this is a folder; give a file in it")
        # The content of a pipe that the shell has opened, such as ``/dev/stdin``. None for
        # any other file. One byte more than allowed is read, so that the excess is noticed.
        data = read_pipe(path, MAX_BYTES + 1)
        if data is not None:
            if len(data) > MAX_BYTES:
                raise FileError(f"{path}: is too large; at most {MAX_BYTES} bytes are read")
            return _decode(data, str(path))
        # Without O_NONBLOCK, opening a named pipe (made by ``mkfifo``) would wait for a
        # writer.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise FileError(f"{str(path)!r}: cannot be opened: {reason}") from None
    try:
        with open(handle, "rb") as stream:  # noqa: PTH123 (an open descriptor)
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise FileError(f"{path}: this is a device or a pipe, not a regular file")
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from None
    size = max(status.st_size, len(data))
    if size > MAX_BYTES:
        raise FileError(
            f"{path}: found {size} bytes, but at most {MAX_BYTES} are read. A mechanism "
            "file needs far fewer; check whether this is the right file"
        )
    return _decode(data, str(path))


def parse(text: str, name: str) -> Document:
    """Parse a TOML text.

    Parameters
    ----------
    text
        The text.
    name
        Name of the file in messages.

    Raises
    ------
    FileError
        If the text is not TOML, is too large, has too many keys or values, or is nested too
        deeply.
    """
    # Refuse texts that are much larger than any mechanism.
    if len(text) > MAX_BYTES:
        raise FileError(
            f"{name}: found {len(text)} characters, but at most {MAX_BYTES} are read"
        )
    text = text.replace("\r\n", "\n").removeprefix("\ufeff")
    # Each part of a dotted key (a.b.c) is a level of nesting. Keys with very many parts are
    # refused before parsing, whose time grows with the square of their number.
    if long_key := _LONG_KEY.search(text):
        line = text.count("\n", 0, long_key.start()) + 1
        raise FileError(
            f"{name}:{line}: a key has too many parts between dots; at most {MAX_NESTING} "
            "are allowed"
        )
    # The counts of "=" and "," can exceed the numbers of keys and values, because strings
    # can contain these characters too.
    key_count = text.count("=") + len(_HEADER.findall(text))
    if key_count > MAX_KEYS:
        raise FileError(
            f"{name}: found {key_count} keys and tables, but at most {MAX_KEYS} are read"
        )
    value_count = text.count(",")
    if value_count > MAX_VALUES:
        raise FileError(
            f"{name}: found {value_count} values, but at most {MAX_VALUES} are read"
        )

    # Parse the text, and convert the errors of the parser to messages with a line.
    try:
        data = tomllib.loads(text, parse_float=LiteralNumber)
    except tomllib.TOMLDecodeError as error:
        raise FileError(_syntax_message(text, name, str(error))) from None
    except RecursionError:
        # The line with the most opening brackets is probably the faulty one.
        depths = [line.count("[") + line.count("{") for line in text.split("\n")]
        line = depths.index(max(depths)) + 1
        raise FileError(
            f"{name}:{line}: the tables and arrays are nested too deeply; at most "
            f"{MAX_NESTING} levels are allowed"
        ) from None
    except (ValueError, OverflowError):
        digits = _HUGE_INTEGER.search(text)
        line = text.count("\n", 0, digits.start()) + 1 if digits else 1
        raise FileError(
            f"{name}:{line}: an integer has too many digits; correct it"
        ) from None

    # The nesting of tables and arrays is limited. A path has one part for each key and for
    # each index in an array. Numbers and texts in an array are not a further level of
    # nesting.
    document = Document(name, text, data)
    for path, value in values_in(data):
        has_key = isinstance(path[-1], str)
        is_table_or_array = isinstance(value, dict | list)
        is_level = has_key or is_table_or_array
        if len(path) > MAX_NESTING and is_level:
            raise document.fault(
                path[:3],
                "the tables and arrays are nested too deeply; at most "
                f"{MAX_NESTING} levels are allowed",
            )
    return document


def values_in(data: Table) -> Iterator[tuple[KeyPath, Any]]:
    """Yield the path and value of everything in tables and arrays, including these."""
    pending: list[tuple[KeyPath, Any]] = [((key,), item) for key, item in data.items()]
    while pending:
        path, value = pending.pop()
        yield path, value
        if isinstance(value, dict):
            pending.extend(((*path, key), item) for key, item in value.items())
        elif isinstance(value, list):
            pending.extend(((*path, index), item) for index, item in enumerate(value))


def _decode(data: bytes, name: str) -> str:
    """Return the text of a file from its bytes, or raise `FileError`."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        is_utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
        guess = "it looks like UTF-16; " if is_utf16 else ""
        raise FileError(
            f"{name}:{line}: the file is not UTF-8: byte 0x{data[error.start]:02x} at "
            f"offset {error.start}; {guess}save the file as UTF-8"
        ) from None


def _syntax_message(text: str, name: str, parser_message: str) -> str:
    """Return the message about a text that is not valid TOML, with a hint for the user.

    Parameters
    ----------
    text
        The text of the file.
    name
        Name of the file.
    parser_message
        The message of `tomllib`, which ends with the position of the fault.
    """
    # Divide the message into the problem, the line and the column. Faults at the end of the
    # text have no position.
    lines = text.split("\n")
    match = _PARSER_MESSAGE.fullmatch(parser_message)
    problem = match[1] if match else parser_message
    if match and match[2]:
        line = int(match[2])
        position = f"column {match[3]}: "
    else:
        line = len(text.rstrip("\n").split("\n"))
        position = "at the end: "

    # If the file has a table twice, the line of the first one is added. The message of the
    # parser has the path as a tuple in Python.
    repeated = _REPEATED_TABLE.fullmatch(problem)
    if repeated:
        path = ast.literal_eval(repeated[1])
        first_line = locate_keys("\n".join(lines[: line - 1])).get(path, 0)
        first = f" (first on line {first_line})" if first_line else ""
        return (
            f"{name}:{line}: {key_path_text(path)}: this table is given twice{first}; "
            "give one of the two another name, or remove it"
        )
    # Look for signs of a common mistake in the problem and in the line. Strings and
    # comments are removed, because they can contain any text.
    without_strings = re.sub(r"\"[^\"]*\"|'[^']*'|#.*", "", f"{problem}\n{lines[line - 1]}")
    for pattern, text_of_hint in _SYNTAX_HINTS:
        if re.search(pattern, without_strings):
            # The hint is easier to understand than the message of the parser.
            return f"{name}:{line}: {position}{text_of_hint} (TOML: {problem})"
    return f"{name}:{line}: {position}{problem}"
