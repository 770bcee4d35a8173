"""The line of a TOML text on which each key and array item stands."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence

KeyPath = tuple[str | int, ...]
"""A path into the parsed data: keys, and positions within arrays."""


_STRING = (
    r'"""(?:[^\\"]|\\[\s\S]|"(?!""))*"{3,5}'
    r"|'''(?:[^']|'(?!''))*'{3,5}"
    r'|"(?:[^"\\\n]|\\[^\n])*"'
    r"|'[^'\n]*'"
)


_TOKEN = re.compile(rf"{_STRING}|#[^\n]*|[\[\]{{}}=,.\n]|[^\s\[\]{{}}=,.#\"']+|[\"']")


def locate(text: str) -> Mapping[KeyPath, int]:
    """Return the line number (from 1) of every key path in a TOML text.

    Values are passed over, not interpreted.
    """
    lines: dict[KeyPath, int] = {}
    sizes: Counter[KeyPath] = Counter()
    table: KeyPath = ()
    at: KeyPath = ()
    opened: list[tuple[str, KeyPath]] = []
    keys: list[str] = []
    is_value, header, line = False, 0, 1
    for token in _TOKEN.findall(text):
        kind, around = opened[-1] if opened else ("", table)
        if kind == "[" and token[0] not in "],\n#":
            at = around
            lines.setdefault(at, line)
        if token == "\n" and not opened:
            is_value, header, keys = False, 0, []
        elif token in ("[", "{") and (is_value or kind == "["):
            opened.append((token, (*at, 0) if token == "[" else at))
            is_value = False
        elif token in ("]", "}") and opened:
            opened.pop()
            is_value = True
        elif token == "," and opened:
            is_value, keys = False, []
            if kind == "[":
                opened[-1] = kind, (*around[:-1], int(around[-1]) + 1)
        elif is_value or kind == "[" or token[0] in "#\n.":
            pass
        elif token == "[":
            header += 1
        elif token == "=":
            at, is_value = around, True
            for key in keys:
                at = (*at, key)
                lines.setdefault(at, line)
            keys = []
        elif token == "]" and header and keys:
            table = _entered(keys, header, line, lines, sizes)
            is_value = True
        else:
            keys.append(_unquoted(token))
        line += token.count("\n")
    return lines


def _entered(
    keys: Sequence[str],
    header: int,
    line: int,
    lines: dict[KeyPath, int],
    sizes: Counter[KeyPath],
) -> KeyPath:
    """Return the path of the table that a header of one or two brackets begins."""
    path: KeyPath = ()
    for key in keys[:-1]:
        path = (*path, key)
        if sizes[path]:
            path = (*path, sizes[path] - 1)
        lines.setdefault(path, line)
    path = (*path, keys[-1])
    if header > 1:
        lines.setdefault(path, line)
        sizes[path] += 1
        path = (*path, sizes[path] - 1)
    # A table opened by the header of a table inside it has its own header later.
    lines[path] = line
    return path


def _unquoted(key: str) -> str:
    if not key.startswith('"'):
        return key.strip("'")
    try:
        return str(json.loads(key, strict=False))
    except ValueError:  # an escape that TOML has and JSON has not, such as \U0001F600
        return key[1:-1]
