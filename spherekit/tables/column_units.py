"""Units of columns: SI without prefixes, their products and powers, and their notation."""

import re

UNIT_SYMBOLS = frozenset(
    ("1", "rad", "sr", "s", "m", "kg", "N", "J", "W", "Hz", "Pa", "K", "A", "V", "C")
)
"""Symbols from which units are composed; ``1`` is that of a pure number."""

_EXPONENT = re.compile(r"(?<=[A-Za-z])\d")

_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

_ANY_SYMBOL = f"({'|'.join(UNIT_SYMBOLS)})"

_PRODUCT = rf"{_ANY_SYMBOL}\d?( {_ANY_SYMBOL}\d?)*"

_UNIT = re.compile(rf"{_PRODUCT}(/{_PRODUCT})?")


def is_unit(text: str) -> bool:
    """Return whether a text is a unit such as ``kg m2/rad``, or empty for pure numbers.

    A column whose rows differ in kind may have several units, separated by `` or ``.
    """
    return not text or all(_UNIT.fullmatch(unit) for unit in text.split(" or "))


def format_unit(unit: str) -> str:
    """Return a unit with raised exponents, for printing: ``kg m2`` as ``kg m²``."""
    return _EXPONENT.sub(lambda digit: digit[0].translate(_SUPERSCRIPTS), unit)
