"""The number type of quad precision, with 113 bits or about 33 decimal digits.

Quad precision is used where float64 leaves too few digits. The package that defines it is
imported only when a first row needs it.
"""

from functools import cache
from typing import Any

QUAD_EPS = 2.0**-112
"""The distance of 1 to the next larger number in quad precision."""


@cache
def quad() -> Any:
    """Return the NumPy data type of quad precision."""
    from numpy_quaddtype import QuadPrecDType

    return QuadPrecDType()


@cache
def quad_pi() -> Any:
    """Return pi in quad precision."""
    from numpy_quaddtype import pi

    return pi
