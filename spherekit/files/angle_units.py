"""Converts angles and directions between the unit of a file and radians."""

import math
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal

from spherekit.files.toml_document import LiteralNumber
from spherekit.mechanism.elements import as_vector
from spherekit.mechanism.sizes import Vector
from spherekit.quantity import (
    AngleUnit,
    QuantityError,
    angle_unit_and_factor,
    check_turns,
    split_unit,
)
from spherekit.tolerances import EPS

LENGTH_TOLERANCE = 1e-3
"""Largest deviation from 1 of the length of a unit vector in a file.

Three digits of each component are enough. Smaller: files with rounded components are
refused; larger: vectors that were not meant as unit vectors are accepted.
"""

MAX_PLAUSIBLE_RAD = 4 * math.pi
"""Larger angles in a file in radians, other than travels, are taken for degrees."""

MAX_PLAIN_DIGITS = 17
"""Degrees with at most so many digits are converted as `math.radians` does."""

CONVERTED_DIGITS = 30
"""Digits of a decimal angle that is converted from degrees to rad or the reverse.

They are far more than the 17 of a float. Larger: certificates contain longer numbers.
"""

MAX_EXPONENT = 308
"""Largest power of ten of a decimal angle in a text, upwards and downwards.

It is that of normal floats. Larger: such angles are written with more digits. Smaller:
texts of floats are refused.
"""

UNIT_LENGTH_ROUNDING = 4 * EPS
"""Deviation from 1 of the length of a vector that was normalized in float64."""

AXIS_COMPONENT_ROUNDING = 2.5e-16
"""Largest cosine or sine that is exactly zero.

It is that of an angle of at most one turn, rounded to float64.
"""

_EXACT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN, traps=[])
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230782")
_DEGREE = _EXACT.divide(_PI, Decimal(180))


def to_radians(number: float, unit: AngleUnit) -> float:
    """Return an angle of a file in radians.

    Degrees with up to `MAX_PLAIN_DIGITS` digits are converted by `math.radians`, so that a
    file and a program agree to the last bit. `math.radians` cannot reach about one angle in
    ten. Such an angle is written with more digits of degrees. Degrees with more digits are
    converted with 60 digits and rounded once.
    """
    if unit == "rad":
        return float(number)
    decimal = Decimal(number.text if isinstance(number, LiteralNumber) else repr(number))
    if len(_EXACT.normalize(decimal).as_tuple().digits) <= MAX_PLAIN_DIGITS:
        return math.radians(number)
    return float(_EXACT.multiply(decimal, _DEGREE))


def read_decimal_angle(text: str, angle_unit: AngleUnit) -> Decimal:
    """Return the angle in a text as an exact decimal number, in the unit of a file.

    Proofs need the decimal number itself, not the nearest float. A number without a unit is
    in the unit of the file. A result that is converted from another unit is rounded to
    `CONVERTED_DIGITS` digits, because pi is irrational.

    Parameters
    ----------
    text
        The text, such as ``40``, ``40deg``, ``0.7rad`` or ``0.5turn``.
    angle_unit
        Unit of the file, and of the result.

    Raises
    ------
    QuantityError
        If the text is not a number, if its unit is not one of angles, if a number without a
        unit is implausibly large, or if the power of ten exceeds `MAX_EXPONENT`.
    InvalidOperation
        If the exponent of the number is larger than can be computed with.
    """
    number_text, unit = split_unit(text)
    number = Decimal(number_text)
    if number.is_finite() and abs(number.adjusted()) > MAX_EXPONENT:
        raise QuantityError(
            f'"{text}" is too large or too small: its power of ten is not in the range '
            f"-{MAX_EXPONENT} to {MAX_EXPONENT}"
        )
    if not unit:
        # Refuses implausibly many turns, such as 400 in a file in rad.
        check_turns(float(number), angle_unit)
        return number
    # `deg_or_rad` is the unit of the text, or deg for turns. The factor is 360 for turns,
    # otherwise 1. It adds at most three digits.
    deg_or_rad, factor = angle_unit_and_factor(number_text, unit)
    angle = Context(prec=len(number_text) + 3).multiply(number, Decimal(factor))
    if deg_or_rad == angle_unit:
        return angle
    # `_EXACT` computes with 60 digits, so its rounding errors do not change the result.
    # `_DEGREE` is pi / 180.
    if angle_unit == "rad":
        converted_angle = _EXACT.multiply(angle, _DEGREE)
    else:
        converted_angle = _EXACT.divide(angle, _DEGREE)
    # Adding 0 (`plus`) rounds the number to the digits of the context.
    return Context(prec=CONVERTED_DIGITS).plus(converted_angle)


def to_text(angle: float, unit: AngleUnit) -> str:
    """Return an angle as the shortest decimal number that is read back as the same float.

    Parameters
    ----------
    angle
        The angle (rad).
    unit
        Unit of the decimal number in the file, "rad" or "deg".
    """
    if unit == "rad" or not math.isfinite(angle) or angle == 0.0:
        return repr(float(angle))
    # Degrees are computed in decimal arithmetic with many digits. The loop finds the least
    # number of digits that is enough, which is far below 40.
    degrees = _EXACT.divide(Decimal(angle), _DEGREE)
    for digits in range(1, 40):
        text = _decimal_text(Context(prec=digits).plus(degrees))
        if to_radians(LiteralNumber(text), "deg") == angle:
            return text
    raise AssertionError(f"no decimal number of degrees converts to {angle!r} rad")


def unit_vector(xyz: Vector) -> Vector:
    """Scale a vector of a file, whose length is nearly 1, to the length 1.

    A vector whose length is 1 up to rounding is returned unchanged, so that writing a file
    and reading it back preserves vectors exactly.

    Raises
    ------
    ValueError
        If the length of the vector is zero, or deviates from 1 by more than
        `LENGTH_TOLERANCE`.
    """
    length = math.hypot(*xyz)
    if length == 0.0:
        raise ValueError("the zero vector has no direction; give the axis as [x, y, z]")
    if abs(length - 1) > LENGTH_TOLERANCE:
        x, y, z = (round(component / length, 12) for component in xyz)
        raise ValueError(
            f"found length {length:.9g}, expected a unit vector (length 1, "
            f"tolerance {LENGTH_TOLERANCE:g}); did you mean [{x}, {y}, {z}]?"
        )
    if abs(length - 1) <= UNIT_LENGTH_ROUNDING:
        return xyz
    return as_vector(component / length for component in xyz)


def direction(longitude: float, latitude: float) -> Vector:
    """Return the unit vector at a longitude and latitude (rad) on the sphere.

    The longitude is measured about z from x, and the latitude from the xy plane.

    Raises
    ------
    ValueError
        If the latitude is not within a quarter turn of zero.
    """
    if abs(latitude) > math.pi / 2:
        raise ValueError(
            "the latitude is not within -90 to 90 deg; lonlat lists the longitude first"
        )
    cos_longitude, sin_longitude = _cos_sin(longitude)
    cos_latitude, sin_latitude = _cos_sin(latitude)
    return cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude


def _cos_sin(angle: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle (rad), exact at multiples of 90 degrees.

    This holds for at most one turn, in both directions.
    """
    cosine = math.cos(angle)
    sine = math.sin(angle)
    # pi / 2 is rounded in float64, so its cosine is not exactly 0.
    if abs(angle) > 1 and min(abs(cosine), abs(sine)) < AXIS_COMPONENT_ROUNDING:
        return round(cosine) + 0.0, round(sine) + 0.0
    return cosine, sine


def _decimal_text(number: Decimal) -> str:
    """Return a number as TOML text, with an exponent if it is very large or small."""
    if -6 <= number.adjusted() < 16:
        text = f"{number:f}"
        return text if "." in text else f"{text}.0"
    mantissa, _, exponent = f"{number:E}".partition("E")
    return f"{mantissa}e{int(exponent)}"
