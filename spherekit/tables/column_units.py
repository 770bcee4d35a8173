"""Units of columns: SI without prefixes, their products and powers, and their notation."""

import re

UNIT_SYMBOLS = frozenset(
    ("1", "rad", "sr", "s", "m", "kg", "N", "J", "W", "Hz", "Pa", "K", "A", "V", "C")
)
"""Symbols from which units are composed; ``1`` is that of a pure number."""

_EXPONENT = re.compile(r"(?<=[A-Za-z])\d")

_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

_ANY_SYMBOL = f"({'|'.join(UNIT_SYMBOLS)})"

# The pure number 1 has no exponent: 12 is not a unit.
_POWER = rf"(?!1\d){_ANY_SYMBOL}[2-9]?"

_PRODUCT = rf"{_POWER}( {_POWER})*"

_UNIT = re.compile(rf"{_PRODUCT}(/{_PRODUCT})?")


def is_unit(text: str) -> bool:
    """Return whether a text is a unit such as ``kg m2/rad``, or empty for pure numbers.

    A column whose rows differ in kind may have several units, separated by `` or ``.
    """
    return not text or all(_UNIT.fullmatch(unit) for unit in text.split(" or "))


def format_unit(unit: str) -> str:
    """Return a unit with raised exponents, for printing: ``kg m2`` as ``kg m²``."""
    return _EXPONENT.sub(lambda digit: digit[0].translate(_SUPERSCRIPTS), unit)
