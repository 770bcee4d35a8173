"""The number type of quad precision: 113 bits, 33 decimal digits."""

from functools import cache
from typing import Any

QUAD_EPS = 2.0**-112
"""The spacing of numbers just above 1."""


@cache
def quad() -> Any:
    """Return the number type; it is loaded with the first row that needs it."""
    from numpy_quaddtype import QuadPrecDType

    return QuadPrecDType()


@cache
def quad_pi() -> Any:
    """Return the circle's number."""
    from numpy_quaddtype import pi

    return pi
