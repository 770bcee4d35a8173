"""The text of a mechanism file with places for the numbers that vary."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice

from spherekit.errors import FileError
from spherekit.files.number_change import number_at, with_numbers
from spherekit.files.toml_document import Document, parse
from spherekit.files.toml_lines import KeyPath
from spherekit.files.toml_text import assignment_text, table_lines

_NUMBER = re.compile(r"(?<![\w.+-])[+-]?\d[\d_]*(?:\.\d[\d_]*)?(?:[eE][+-]?\d+)?(?![\w.])")
_MARKS = "{}.5e-271"
"""A number that no file has; one for each place."""
_TRIED = 64
"""Numbers from the line of a key on that may be its own."""


def text_with_places(document: Document, paths: Sequence[KeyPath]) -> list[str | int]:
    """Return a file's text in parts; where a number stands, its position in `paths`.

    Comments and layout are kept where the file says all these numbers; otherwise its
    data are written anew.
    """
    marks = [_MARKS.format(k + 1) for k in range(len(paths))]
    text = document.text
    for path, mark in zip(paths, marks, strict=True):
        if text is None:
            break
        text = _marked(document, text, path, mark)
    if text is None:
        text = _written(document, paths, marks)
    split = re.split(f"({'|'.join(map(re.escape, marks)) or '(?!)'})", text)
    return [marks.index(part) if part in marks else part for part in split if part]


def _marked(document: Document, text: str, path: KeyPath, mark: str) -> str | None:
    """Return a text with a mark for the number at a path, None where it does not say it."""
    # Lines of TOML end with a line feed alone; `splitlines` knows other line ends too.
    start = len("\n".join([*text.split("\n")[: document.line(path) - 1], ""]))
    for number in islice(_NUMBER.finditer(text, start), _TRIED):
        tried = text[: number.start()] + mark + text[number.end() :]
        with suppress(FileError, KeyError, IndexError, TypeError, ValueError):
            if number_at(parse(tried, document.name), path) == float(mark):
                return tried
    return None


def _written(document: Document, paths: Sequence[KeyPath], marks: Sequence[str]) -> str:
    numbers = dict(zip(paths, map(float, marks), strict=True))
    return "\n".join([*_lines(with_numbers(document, numbers)), ""])


def _lines(document: Document) -> Iterator[str]:
    for key, value in document.data.items():
        if isinstance(value, dict):
            yield from table_lines((key,), value)
        else:
            yield assignment_text(key, value)
