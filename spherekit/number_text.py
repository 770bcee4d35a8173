"""Numbers as text for the screen: few digits, and 0 for a number below its error."""

import math

SCREEN_DIGITS = 6
"""Significant digits of numbers on the screen. Tables in files have all digits."""

LEAST_ANGLE_STEP_DEG = 1e-4
"""Angles are rounded to this step (deg), which no drawing resolves.

Without rounding, an angle of 0 with numerical errors would read ``4e-14``.
"""


def number_text(value: float, error: float = 0.0, digits: int = SCREEN_DIGITS) -> str:
    """Return a number as text with few digits, for the screen.

    Parameters
    ----------
    value
        The number.
    error
        Bound of the error. A number that is not larger than its error becomes ``0``.
    digits
        Number of significant digits.

    Returns
    -------
    The number as text, ``0`` instead of ``-0``, and ``-`` if it is NaN.
    """
    if math.isnan(value):
        return "-"
    if abs(value) <= error:
        return "0"
    # If the error is NaN, the value can still be -0.0, which becomes 0.0 here.
    value_without_minus_zero = value + 0.0
    return f"{value_without_minus_zero:.{digits}g}"


def last_significant_digit(value: float, digits: int) -> float:
    """Return the place value of the last significant digit: 0.1 for 21.2 with 3 digits.

    Zero has no significant digits; the result is then infinite.
    """
    if not value:
        return math.inf
    return 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)


def bound_text(bound: float) -> str:
    """Return an error bound with one digit, rounded up so that it stays a bound."""
    if not math.isfinite(bound):
        return f"{bound:.0e}"
    if bound <= 0.0:
        return "0"
    # For smaller exponents, the power of ten is not a normal float64 number.
    exponent = max(math.floor(math.log10(bound)), -307)
    # The factor keeps a bound such as 3e-14 from being rounded up to 4e-14.
    digit = math.ceil(bound / 10.0**exponent * (1.0 - 1e-12))
    return f"{digit * 10.0**exponent:.0e}"


def degrees_text(angle_rad: float) -> str:
    """Return an angle (rad) as text in degrees, without the unit."""
    degrees = math.degrees(angle_rad)
    steps = degrees / LEAST_ANGLE_STEP_DEG
    if not math.isfinite(steps):  # also if only the division by the step overflows
        return number_text(degrees)
    return number_text(round(steps) * LEAST_ANGLE_STEP_DEG)


def degree_range_text(lowest_rad: float, highest_rad: float) -> str:
    """Return a range of angles (rad) as text in degrees, such as ``-12.5 to 40``."""
    return f"{degrees_text(lowest_rad)} to {degrees_text(highest_rad)}"
