"""Parts of messages: counted nouns, lists, spelling suggestions, sizes of memory."""

import difflib
import re
from collections.abc import Collection, Iterable, Mapping

_SEPARATE_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.]*(?:e[-+]?\d+\.?)?(?![\w.])")
"""A number that is not part of a key such as ``links.4.arc``, with a full stop after it."""


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return a spelling suggestion ``; did you mean "x"?``, or an empty text.

    Three rules are tried in turn: a word that differs only in upper and lower case, a word
    with the same letters in another order, and a similar word.

    Parameters
    ----------
    word
        The misspelt word.
    allowed
        Words that could be meant.
    """
    words = list(allowed)
    similar = [x for x in words if x.casefold() == word.casefold()]
    if not similar:
        similar = [x for x in words if sorted(x) == sorted(word)]
    if not similar:
        similar = difflib.get_close_matches(word, words, n=1, cutoff=0.6)
    return f'; did you mean "{similar[0]}"?' if similar else ""


def choices(word: object, allowed: Collection[str], what: str, most: int = 12) -> str:
    """Return the end of a message about an unknown word: a suggestion and the choices.

    With a suggestion it reads ``; did you mean "12"? Pairs: 12, 23, 34``, otherwise
    ``. Pairs: 12, 23, 34``.

    Parameters
    ----------
    word
        The unknown word.
    allowed
        Words that are allowed.
    what
        A noun for the allowed words, such as ``Pairs``.
    most
        Largest number of allowed words that are listed.
    """
    # The suggestion begins with a semicolon. Without a suggestion, a full stop comes first.
    suggestion = nearest(str(word), allowed)
    beginning = suggestion or "."
    return f"{beginning} {what}: {listing(allowed, most) or 'none'}"


def counted(number: object, noun: str) -> str:
    """Return a number with its noun, such as ``1 row`` or ``2 rows``.

    The number may be a text such as ``41x21`` (the size of a grid): ``41x21 rows``.
    """
    return f"{number} {noun}{'' if str(number) == '1' else 's'}"


def listing(words: Iterable[object], limit: int = 12) -> str:
    """Return words as ``a, b, c``; beyond the limit only their number is stated."""
    items = [str(word) for word in words]
    omitted = len(items) - limit
    listed = ", ".join(items[:limit])
    return f"{listed} and {omitted} more" if omitted > 0 else listed


def size_text(count: float) -> str:
    """Return a number of bytes as text, such as ``1.5 GB``."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        # From 999.5 of the smaller unit on, rounding to three digits gives 1 of this one.
        if count >= 0.9995 * scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"


def without_numbers(text: str) -> str:
    """Return a text without its numbers, to group messages that differ in numbers only."""
    return _SEPARATE_NUMBER.sub("", text)


def numbered(word: str, numbers: Iterable[object]) -> str:
    """Return a word with numbers: ``assembly mode 0``, ``assembly modes 0, 1``."""
    items = list(numbers)
    return f"{word}{'' if len(items) == 1 else 's'} {listing(items)}"


def with_units(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    """Return names of columns, followed by their unit if there is one: ``q [rad]``."""
    return [f"{name} [{units[name]}]" if units.get(name) else name for name in names]
