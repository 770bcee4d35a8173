"""The units that columns may have: SI without prefixes, products and powers, as printed."""

import re

SYMBOLS = frozenset(
    ("1", "rad", "sr", "s", "m", "kg", "N", "J", "W", "Hz", "Pa", "K", "A", "V", "C")
)

_EXPONENT = re.compile(r"(?<=[A-Za-z])\d")
_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_POWER = re.compile(r"([A-Za-z]+|1)(\d?)")


def is_unit(text: str) -> bool:
    """Return whether a text is a unit such as ``kg m2/rad``, or empty for pure numbers.

    Several by ``or`` are units of one column whose rows differ in kind.
    """
    return not text or all(_is_single(unit) for unit in text.split(" or "))


def in_signs(unit: str) -> str:
    """Return a unit as people print it: ``kg m2`` as ``kg m²``."""
    return _EXPONENT.sub(lambda digit: digit[0].translate(_RAISED), unit)


def _is_single(text: str) -> bool:
    parts = [part.split() for part in text.split("/")]
    matches = [_POWER.fullmatch(symbol) for part in parts for symbol in part]
    return (
        len(parts) <= 2
        and all(parts)
        and all(match is not None and match[1] in SYMBOLS for match in matches)
    )
