"""Finds the line of a TOML text on which each key and each array item stands.

The standard library parses TOML but does not report lines. Messages about a mechanism file
name the line of the faulty key, so this module splits the text into tokens once more. It
expects a text that is valid TOML.
"""

import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

KeyPath = tuple[str | int, ...]
"""A path into parsed data: keys of tables, and indices of array items."""

_STRING = (
    r'"""(?:[^\\"]|\\[\s\S]|"(?!""))*"{3,5}'
    r"|'''(?:[^']|'(?!''))*'{3,5}"
    r'|"(?:[^"\\\n]|\\[^\n])*"'
    r"|'[^'\n]*'"
)
"""The four kinds of strings: of several lines or one, with escapes or without."""

_TOKEN = re.compile(rf"{_STRING}|#[^\n]*|[\[\]{{}}=,.\n]|[^\s\[\]{{}}=,.#\"']+|[\"']")
"""Strings, comments, punctuation, ends of lines, and everything else between them."""


def locate_keys(text: str) -> Mapping[KeyPath, int]:
    """Return the line number, from 1, of every key path in a TOML text."""
    scanner = _KeyScanner()
    for token in _TOKEN.findall(text):
        scanner.read_token(token)
    return scanner.lines


@dataclass
class _KeyScanner:
    """State while the tokens of a TOML text are read one after another.

    Attributes
    ----------
    lines
        Line number of each key path so far.
    array_table_sizes
        Number of tables so far in each array of tables, ``[[name]]``.
    table
        Path of the table whose header was read last.
    key_path
        Path of the key whose value is read.
    brackets
        The open brackets of arrays ``[`` and inline tables ``{``, each with a path. For an
        array it is the path of the next item, for an inline table its own path.
    key_parts
        Parts of a dotted key, or of a header, read so far.
    is_value
        True between ``=`` and the end of a value, where words are not keys.
    header_depth
        Number of brackets that opened a header: 1 for a table, 2 for an array of tables.
    line
        Number of the present line.
    """

    lines: dict[KeyPath, int] = field(default_factory=dict)
    array_table_sizes: Counter[KeyPath] = field(default_factory=Counter)
    table: KeyPath = ()
    key_path: KeyPath = ()
    brackets: list[tuple[str, KeyPath]] = field(default_factory=list)
    key_parts: list[str] = field(default_factory=list)
    is_value: bool = False
    header_depth: int = 0
    line: int = 1

    def read_token(self, token: str) -> None:
        """Read the next token of a TOML text, in order to find the line of each key.

        A token is a string, a comment, a punctuation mark, the end of a line, or a word.
        The reader records the line of each key and of each item of an array in `lines`.

        Attributes that change here are

        - `line`: the present line,
        - `brackets`: the open brackets, each with a path. For an array ``[`` it is the path
          of its next item, for an inline table ``{`` the path of the table,
        - `key_parts`: the parts of a key so far,
        - `key_path`: the path of the last key or item,
        - `header_depth`: the number of brackets that open a table header,
        - `is_value`: whether a value, instead of a key, is read.
        """
        # The innermost open bracket with its path, see above.
        bracket, path = self.brackets[-1] if self.brackets else ("", self.table)
        is_part_of_item = token not in ("]", ",", "\n") and not token.startswith("#")
        if bracket == "[" and is_part_of_item:
            # An item of an array begins, or continues. `setdefault` keeps the line at which
            # it began.
            self.key_path = path
            self.lines.setdefault(path, self.line)

        # The order of the cases matters. Brackets, commas and ends of lines come first,
        # even within values. All other tokens of values are skipped next, so that the last
        # cases deal with keys and headers only.
        if token == "\n" and not self.brackets:
            # The end of a line ends a value or a header.
            self.is_value = False
            self.header_depth = 0
            self.key_parts = []
        elif token in ("[", "{") and (self.is_value or bracket == "["):
            # An array or an inline table begins.
            inner_path = (*self.key_path, 0) if token == "[" else self.key_path
            self.brackets.append((token, inner_path))
            self.is_value = False
        elif token in ("]", "}") and self.brackets:
            # An array or an inline table ends. `is_value` remains true up to a comma or the
            # end of the line, before which no key can follow.
            self.brackets.pop()
            self.is_value = True
        elif token == "," and self.brackets:
            # The next item of an array, or the next key of an inline table, follows.
            self.is_value = False
            self.key_parts = []
            if bracket == "[":
                next_index = int(path[-1]) + 1
                self.brackets[-1] = (bracket, (*path[:-1], next_index))
        elif self.is_value or bracket == "[" or token[0] in "#\n.":
            # Values, comments and the dots between parts of a key are skipped.
            pass
        elif token == "[":
            self.header_depth += 1
        elif token == "=":
            self._start_value(path)
        elif token == "]" and self.header_depth and self.key_parts:
            # The header of a table ends. The rest of its line is skipped like a value.
            self._enter_table()
            self.is_value = True
        else:
            self.key_parts.append(_unquote(token))
        self.line += token.count("\n")

    def _start_value(self, table: KeyPath) -> None:
        """Record the line of the key whose parts were read, and begin to read its value.

        A dotted key such as ``a.b`` has two parts, and both ``a`` and ``a.b`` get this
        line. The path `table` of the present table is put in front.
        """
        self.key_path = table
        for key in self.key_parts:
            self.key_path = (*self.key_path, key)
            self.lines.setdefault(self.key_path, self.line)
        self.key_parts = []
        self.is_value = True

    def _enter_table(self) -> None:
        """Record the line of a table header, and make its table the present one.

        The reader calls it at the end of a header such as ``[pairs.41]``. The parts
        ``pairs`` and ``41`` are then in `key_parts`. The keys that follow belong to the
        present table.
        """
        outer_path = self._enter_outer_tables(self.key_parts[:-1])
        path = (*outer_path, self.key_parts[-1])
        # A header with two brackets, ``[[name]]``, begins a table of an array.
        if self.header_depth > 1:
            path = self._begin_array_table(path)
        # The line of a table is that of its own header, even if another line was recorded
        # for it earlier. For example, the header ``[pairs.41]`` also records its line for
        # the table ``pairs``. If the header ``[pairs]`` follows, its line replaces that.
        self.lines[path] = self.line
        self.table = path

    def _begin_array_table(self, array_path: KeyPath) -> KeyPath:
        """Return the path of a new table in an array of tables.

        A header in two brackets, such as ``[[names]]``, begins a table of the array at
        `array_path`. The tables of an array are numbered from 0. The line of the array is
        the line of its first header.
        """
        self.lines.setdefault(array_path, self.line)
        index = self.array_table_sizes[array_path]
        self.array_table_sizes[array_path] += 1
        return (*array_path, index)

    def _enter_outer_tables(self, keys: Sequence[str]) -> KeyPath:
        """Return the path of the table that contains the table of a header.

        The table of the header ``[pairs.41]``, for example, is in the table ``pairs``. The
        present line is recorded for the outer tables that have no line yet.

        `keys` are all parts of the header but the last one. If a part names an array of
        tables, the last table of the array is meant, and the path contains its index.
        """
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            # The sizes are a `Counter`, which has 0 for a path that is no array of tables.
            array_size = self.array_table_sizes[path]
            if array_size:
                path = (*path, array_size - 1)
            self.lines.setdefault(path, self.line)
        return path


def _unquote(key: str) -> str:
    """Return a key without its quotes and escapes."""
    if not key.startswith('"'):
        return key.strip("'")
    try:
        return str(tomllib.loads(f"key = {key}")["key"])
    except tomllib.TOMLDecodeError:  # the text is not valid TOML
        return key[1:-1]
