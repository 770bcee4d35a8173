"""Words of messages: counted nouns, lists, spelling suggestions, sizes of memory."""

import difflib
import re
from collections.abc import Collection, Iterable, Mapping

_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.]*(?:e[-+]?\d+)?(?![\w.])")
"""A number that is no part of a key, such as ``links.4.arc``."""


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return a hint ``; did you mean "x"?`` for a misspelt word, or an empty string."""
    words = list(allowed)
    close = [candidate for candidate in words if candidate.casefold() == word.casefold()]
    close = close or [candidate for candidate in words if sorted(candidate) == sorted(word)]
    close = close or difflib.get_close_matches(word, words, n=1, cutoff=0.5)
    return f'; did you mean "{close[0]}"?' if close else ""


def choices(word: object, allowed: Collection[str], what: str, most: int = 12) -> str:
    """Return how a message about an unknown word ends: the nearest, and what is allowed."""
    hint = nearest(str(word), allowed) or ";"
    return f"{hint} {what}: {listing(allowed, most) or 'none'}"


def counted(number: object, noun: str) -> str:
    """Return a number with its noun, ``1 row`` or ``2 rows``; grids are ``41x21 rows``."""
    return f"{number} {noun}{'' if str(number) == '1' else 's'}"


def listing(words: Iterable[object], limit: int = 12) -> str:
    """Return words as ``a, b, c``, cut after `limit` with the number left out."""
    items = [str(word) for word in words]
    rest = len(items) - limit
    shown = ", ".join(items[:limit])
    return f"{shown} and {rest} more" if rest > 0 else shown


def size_text(count: float) -> str:
    """Return a number of bytes as ``1.5 GB``."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"


def without_numbers(text: str) -> str:
    """Return a text by which those that differ in numbers only are one."""
    return _NUMBER.sub("", text)


def numbered(word: str, numbers: Iterable[object]) -> str:
    """Return a word with what it counts: ``assembly mode 0``, ``assembly modes 0, 1``."""
    every = list(numbers)
    return f"{word}{'' if len(every) == 1 else 's'} {listing(every)}"


def with_units(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    """Return names of columns with the units of those that have one."""
    return [f"{name} [{units[name]}]" if units.get(name) else name for name in names]
