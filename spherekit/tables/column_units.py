"""Units of columns: SI without prefixes, products and powers, and how they are printed."""

import re

SYMBOLS = frozenset(
    ("1", "rad", "sr", "s", "m", "kg", "N", "J", "W", "Hz", "Pa", "K", "A", "V", "C")
)


_EXPONENT = re.compile(r"(?<=[A-Za-z])\d")


_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


_PRODUCT = rf"({'|'.join(SYMBOLS)})\d?( ({'|'.join(SYMBOLS)})\d?)*"


_UNIT = re.compile(rf"{_PRODUCT}(/{_PRODUCT})?")


def is_unit(text: str) -> bool:
    """Return whether a text is a unit such as ``kg m2/rad``, or empty for pure numbers.

    Several by ``or`` are units of one column whose rows differ in kind.
    """
    return not text or all(_UNIT.fullmatch(unit) for unit in text.split(" or "))


def in_signs(unit: str) -> str:
    """Return a unit as people print it: ``kg m2`` as ``kg m²``."""
    return _EXPONENT.sub(lambda digit: digit[0].translate(_RAISED), unit)
