"""Angles and directions between the unit of a file and radians."""

import math
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal

from spherekit.files.toml_document import LiteralNumber
from spherekit.mechanism.elements import as_vector
from spherekit.mechanism.sizes import AngleUnit, Vector
from spherekit.tolerances import EPS

LENGTH_TOLERANCE = 1e-3
"""How far from 1 the length of a unit vector may be in a file: three digits given."""


LARGEST_RADIANS = 4 * math.pi
"""Larger angles in a file in radians are taken for degrees, and refused."""


_EXACT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN, traps=[])


_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230782")


_DEGREE = _EXACT.divide(_PI, Decimal(180))


_FLOAT_DIGITS = 17


_UNIT_LENGTH = 4 * EPS


def to_radians(number: float, unit: AngleUnit) -> float:
    """Return an angle of a file in radians.

    Degrees of up to 17 digits become what `math.radians` makes of them, so that a file
    and a program agree to the last bit. That cannot reach every float, one in ten is
    skipped; degrees with more digits are converted as written, with one rounding.
    """
    if unit == "rad":
        return float(number)
    written = Decimal(number.text if isinstance(number, LiteralNumber) else repr(number))
    if len(_EXACT.normalize(written).as_tuple().digits) <= _FLOAT_DIGITS:
        return math.radians(number)
    return float(_EXACT.multiply(written, _DEGREE))


def to_text(angle: float, unit: AngleUnit) -> str:
    """Return the shortest decimal that `to_radians` turns into exactly this angle."""
    if unit == "rad" or not math.isfinite(angle) or angle == 0.0:
        return repr(float(angle))
    degrees = _EXACT.divide(Decimal(angle), _DEGREE)
    # 40 digits tell any two floats apart.
    texts = (_decimal_text(Context(prec=k).plus(degrees)) for k in range(1, 40))
    return next(x for x in texts if to_radians(LiteralNumber(x), "deg") == angle)


def unit_vector(xyz: Vector) -> Vector:
    """Return a vector of nearly unit length with exactly unit length.

    One that has it already is returned unchanged, so that files round-trip.

    Raises
    ------
    ValueError
        If its length is zero or off by more than `LENGTH_TOLERANCE`.
    """
    length = math.hypot(*xyz)
    if length == 0.0:
        raise ValueError("the zero vector has no direction; give the axis as [x, y, z]")
    if abs(length - 1) > LENGTH_TOLERANCE:
        x, y, z = (round(component / length, 12) for component in xyz)
        raise ValueError(
            f"found length {length:.9g}, needs a unit vector (to "
            f"{LENGTH_TOLERANCE:g}); did you mean [{x}, {y}, {z}]?"
        )
    if abs(length - 1) <= _UNIT_LENGTH:
        return xyz
    return as_vector(component / length for component in xyz)


def direction(longitude: float, latitude: float) -> Vector:
    """Return the unit vector at a longitude and latitude (rad).

    Raises
    ------
    ValueError
        If the latitude is beyond a pole.
    """
    if abs(latitude) > math.pi / 2:
        raise ValueError("the latitude is beyond a quarter turn; longitude is first")
    cos_longitude, sin_longitude = _cos_sin(longitude)
    cos_latitude, sin_latitude = _cos_sin(latitude)
    return cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude


def _cos_sin(angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    # The float nearest a multiple of pi / 2 stands for it: 90 degrees has cosine 0.
    if abs(angle) > 1 and min(abs(cosine), abs(sine)) < 2.5e-16:
        return round(cosine) + 0.0, round(sine) + 0.0
    return cosine, sine


def _decimal_text(number: Decimal) -> str:
    if -6 <= number.adjusted() < 16:
        text = f"{number:f}"
        return text if "." in text else f"{text}.0"
    mantissa, _, exponent = f"{number:E}".partition("E")
    return f"{mantissa}e{int(exponent)}"
