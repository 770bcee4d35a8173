"""The text of a mechanism file, cut at the numbers that vary.

When the page saves the file, it puts the present numbers between the parts of the text.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice

from spherekit.errors import FileError
from spherekit.files.number_change import number_at, with_numbers
from spherekit.files.toml_document import Document, parse
from spherekit.files.toml_lines import KeyPath
from spherekit.files.toml_text import assignment_text, table_lines

_TOML_NUMBER = re.compile(
    r"(?<![\w.+-])[+-]?\d[\d_]*(?:\.\d[\d_]*)?(?:[eE][+-]?\d+)?(?![\w.])"
)
"""A number in TOML that is no part of a word."""

_MARK_FORMAT = "{}.5e-271"
"""Number that no file has, as text. It marks the position of a number of the file."""

_MAX_TRIED_NUMBERS = 64
"""Largest number of trials in the search for a number, which begins at the line of its key.

Each trial parses the whole file. Larger: long files take longer. Smaller: a number far
behind its key, as in a long array, is not found, and the file is written anew without its
comments.
"""


def split_at_numbers(document: Document, paths: Sequence[KeyPath]) -> list[str | int]:
    """Cut the text of a mechanism file at the numbers that vary.

    An interactive page saves the file by putting the present numbers between the parts.
    Comments and layout stay if all numbers are found in the text. Otherwise new text is
    written from the data of the file.

    Parameters
    ----------
    document
        The mechanism file.
    paths
        Paths of the numbers in the file: a table, then keys.

    Returns
    -------
    Texts, and between them integers. Each integer stands for the number with this index in
    `paths`.
    """
    # Each mark is a number that no file contains. The text is cut where it has exactly the
    # characters of a mark. Text that is written anew states numbers as `repr` does, so the
    # marks are written in this form, too.
    marks = [repr(float(_MARK_FORMAT.format(index + 1))) for index in range(len(paths))]
    text = document.text
    for path, mark in zip(paths, marks, strict=True):
        if text is None:
            break
        text = _mark_number(document, text, path, mark)
    if text is None:
        text = _write_with_marks(document, paths, marks)
    # The pattern (?!), for a list without numbers, never matches.
    pattern = "|".join(map(re.escape, marks)) or "(?!)"
    parts = re.split(f"({pattern})", text)
    return [marks.index(part) if part in marks else part for part in parts if part]


def _mark_number(document: Document, text: str, path: KeyPath, mark: str) -> str | None:
    """Return the text of a mechanism file with a mark in place of one number.

    The text is later cut at the marks, where an interactive page puts new numbers. A mark
    is itself a number, one that no file contains, so the text remains valid TOML.

    The position of the number is found by trial, starting at the line of its key. One
    number after another is replaced by the mark, until the parsed text has the mark at
    `path`. At most `_MAX_TRIED_NUMBERS` are tried, because each trial parses the whole
    text.

    Parameters
    ----------
    document
        The file.
    text
        Its text, in which other numbers may have marks already.
    path
        Path of the number in the file.
    mark
        The number that serves as a mark, as text.

    Returns
    -------
    The text, or None if the number is not found.
    """
    # The search starts at the first character of the line of the key. The first line has
    # the number 1.
    lines_before = text.split("\n")[: document.line(path) - 1]
    start = sum(len(line) + len("\n") for line in lines_before)
    for match in islice(_TOML_NUMBER.finditer(text, start), _MAX_TRIED_NUMBERS):
        marked_text = text[: match.start()] + mark + text[match.end() :]
        # A mark in another place may make the text invalid. After such an error the next
        # number is tried.
        with suppress(FileError, KeyError, IndexError, TypeError, ValueError):
            if number_at(parse(marked_text, document.name), path) == float(mark):
                return marked_text
    return None


def _write_with_marks(
    document: Document, paths: Sequence[KeyPath], marks: Sequence[str]
) -> str:
    """Return the data of a file as new text, with marks for the numbers at paths."""
    mark_by_path = dict(zip(paths, map(float, marks), strict=True))
    return "\n".join([*_document_lines(with_numbers(document, mark_by_path)), ""])


def _document_lines(document: Document) -> Iterator[str]:
    """Yield the lines of the tables and values of a document."""
    for key, value in document.data.items():
        if isinstance(value, dict):
            yield from table_lines((key,), value)
        else:
            yield assignment_text(key, value)
