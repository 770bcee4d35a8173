"""Reads numbers that may carry a unit, such as ``35``, ``35deg`` and ``2rad/s``.

The rule is the same for every option of the command and for every text in Python. A number
with a unit is in that unit. An angle without a unit is in the unit of the file, or in
degrees if there is no file. A time without a unit is in s.
"""

import math
import re
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from spherekit.wording import listing

AngleUnit = Literal["deg", "rad"]
"""Unit in which users state angles. Inside the package all angles are in rad."""

MAX_TURNS_WITHOUT_UNIT = {"rad": 2.0, "deg": 10.0}
"""Turns beyond which an angle without a unit is refused, by the unit in which it is read.

In rad the limit is low, because 144 is far more likely to mean 144 degrees than 23 turns.
Larger: such mistakes are not reported. Smaller: motions of a few turns need a unit.
"""

_ANGLE_UNITS: dict[str, tuple[AngleUnit, int]] = {
    "deg": ("deg", 1),
    "°": ("deg", 1),
    "rad": ("rad", 1),
    "turn": ("deg", 360),
}
"""The size of each unit of angles: the unit in which it is stated, and its number."""

_RPM = ("deg", 6)
"""One revolution per minute in degrees per second."""

_NUMBER_WITH_UNIT = re.compile(
    r"\s*(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"\s*(?P<unit>[A-Za-z°][A-Za-z0-9°/^² ]*?)\s*"
)
"""A number followed by a unit. The unit begins with a letter or the degree sign."""


class QuantityError(ValueError):
    """A text cannot be read as a number with a unit. The message says what is wrong."""


@dataclass(frozen=True)
class Dimension:
    """The kind of a quantity: an angle, an angle divided by a power of time, or a time.

    Attributes
    ----------
    noun
        The quantity in words for messages, such as ``an angular speed``.
    time_power
        Power of seconds by which an angle is divided: 0 for an angle, 1 for its rate, 2 for
        its acceleration. None for a time.
    """

    noun: str
    time_power: int | None

    @property
    def is_time(self) -> bool:
        """Whether the quantity is a time, and not an angle divided by times."""
        return self.time_power is None

    @property
    def units(self) -> tuple[str, ...]:
        """The units that users may write, such as ``deg/s`` and ``rpm``."""
        if self.time_power is None:
            return ("s", "ms")
        suffix = _per_time(self.time_power)
        names = [f"{name}{suffix}" for name in ("deg", "rad", "turn")]
        return (*names, "rpm") if self.time_power == 1 else tuple(names)

    def unit_of_file(self, angle_unit: AngleUnit) -> str:
        """Return the unit of a number of this dimension that a file states without a unit.

        `angle_unit` is the unit of angles of the file, such as deg.
        """
        if self.time_power is None:
            return "s"
        return f"{angle_unit}{_per_time(self.time_power)}"


def _per_time(power: int) -> str:
    """Return the part of a unit for a division by a power of seconds: "", "/s", "/s2"."""
    if power == 0:
        return ""
    return "/s" if power == 1 else f"/s{power}"


ANGLE = Dimension("an angle", 0)
ANGULAR_SPEED = Dimension("an angular speed", 1)
ANGULAR_ACCELERATION = Dimension("an angular acceleration", 2)
DURATION = Dimension("a time", None)


def angle_by_time(power: int) -> Dimension:
    """Return the dimension of an angle divided by time to the power 0, 1, 2, ...

    The coefficients of a polynomial in time have these dimensions.
    """
    named = (ANGLE, ANGULAR_SPEED, ANGULAR_ACCELERATION)
    if power < len(named):
        return named[power]
    return Dimension(f"an angle per s^{power}", power)


@dataclass(frozen=True)
class FieldUnit:
    """The unit of a number that is a parameter of an analysis.

    Types such as `Degrees` contain the unit, as ``Annotated[float, FieldUnit("deg")]``. For
    example, ``near: Degrees = 5.0`` declares a parameter that is a number in degrees in
    Python. If a user writes ``0.1rad``, it is converted to degrees.

    Attributes
    ----------
    angle_unit
        Unit of angles, deg or rad, of the number in Python.
    dimension
        The kind of the quantity, such as an angle or an angular speed. The number of an
        angular speed is in `angle_unit` per second.
    """

    angle_unit: AngleUnit
    dimension: Dimension = ANGLE

    @property
    def text(self) -> str:
        """The unit of the number in Python, such as ``deg/s``."""
        return self.dimension.unit_of_file(self.angle_unit)


Degrees = Annotated[float, FieldUnit("deg")]
DegreesPerSecond = Annotated[float, FieldUnit("deg", ANGULAR_SPEED)]
DegreesPerSecond2 = Annotated[float, FieldUnit("deg", ANGULAR_ACCELERATION)]
Radians = Annotated[float, FieldUnit("rad")]
Seconds = Annotated[float, FieldUnit("rad", DURATION)]
"""Types of parameters of analyses that are angles, their rates, or times."""


def field_unit_of(annotation: Any) -> FieldUnit | None:
    """Return the unit that the type annotation of a parameter states, or None without one.

    The text of a parameter that a user writes is converted to this unit. The unit is a
    `FieldUnit` in ``Annotated``. The annotation may also be a union or a tuple in which a
    member has the unit, such as ``Degrees | None``.
    """
    if get_origin(annotation) is Annotated:
        for extra in annotation.__metadata__:
            if isinstance(extra, FieldUnit):
                return extra
        return None
    for member in get_args(annotation):
        if (unit := field_unit_of(member)) is not None:
            return unit
    return None


def split_unit(text: str) -> tuple[str, str]:
    """Divide a text such as ``35deg`` into its number and its unit.

    The unit is empty if the text is only a number.

    Raises
    ------
    QuantityError
        If the text does not begin with a number.
    """
    # Try the whole text as a number first, as 1e9 is not 1 with the unit e9.
    with suppress(ValueError):
        float(text)
        return text.strip(), ""
    match = _NUMBER_WITH_UNIT.fullmatch(text)
    if match is None:
        raise QuantityError(f'"{text}" is not a number (a unit is optional)')
    return match["number"], match["unit"]


def angle_unit_and_factor(
    number: str, unit: str, dimension: Dimension = ANGLE
) -> tuple[AngleUnit, int]:
    """Return how many deg or rad a unit of angles, speeds or accelerations has.

    For example, ``turn`` is 360 deg and ``rpm`` is 6 deg/s.

    Parameters
    ----------
    number
        The number in front of the unit; it is only repeated in messages.
    unit
        The unit as the user wrote it, such as ``turn/s``.
    dimension
        The expected quantity: an angle, or an angle divided by a power of time.

    Returns
    -------
    angle_unit
        "deg" or "rad". The part of the unit for time, such as ``/s2``, is left out.
    factor
        The number of deg or rad in the unit, such as 360 for ``turn/s``.

    Raises
    ------
    QuantityError
        If the unit is unknown, or belongs to another dimension.
    """
    assert dimension.time_power is not None
    word = unit.replace(" ", "").replace("^", "").replace("²", "2")
    if word == "rpm" and dimension.time_power == 1:
        return _RPM  # type: ignore[return-value]
    suffix = _per_time(dimension.time_power)
    name = word.removesuffix(suffix) if suffix else word
    # A word without the suffix, such as "deg" for a speed, is refused.
    if name in _ANGLE_UNITS and word == f"{name}{suffix}":
        return _ANGLE_UNITS[name]
    raise _unit_error(number, unit, dimension)


def read_quantity(
    source: str | float,
    dimension: Dimension,
    angle_unit: AngleUnit,
    target: AngleUnit = "rad",
    is_limited: bool = True,
) -> float:
    """Read a number that may carry a unit, and convert it to the unit of the result.

    For example, ``30rpm`` becomes 3.14 (rad/s), and ``250ms`` becomes 0.25 (s).

    Parameters
    ----------
    source
        A number, or a text such as ``35``, ``35deg`` or ``2 rad/s``.
    dimension
        The kind of the quantity: a time, an angle, or an angle divided by a power of time.
    angle_unit
        The unit of angles of the file, in which a number without a unit is read.
    target
        The unit of angles of the result.
    is_limited
        Whether an angle without a unit is refused if it has more turns than
        `MAX_TURNS_WITHOUT_UNIT`.

    Returns
    -------
    The number: a time in s, an angle in `target`, or a rate or acceleration in `target` per
    s or s2.

    Raises
    ------
    QuantityError
        If the text is not a number, its unit is not one of the dimension, or the angle is
        implausible.
    """
    if isinstance(source, str):
        number_text, unit = split_unit(source)
    else:
        number_text, unit = repr(float(source)), ""
    number = float(number_text)
    if dimension.is_time:
        if unit not in ("", *dimension.units):
            raise _unit_error(number_text, unit, dimension)
        return number / 1000.0 if unit == "ms" else number
    # An angle, or its rate or acceleration.
    if unit:
        stated_unit, factor = angle_unit_and_factor(number_text, unit, dimension)
        number *= factor
    else:
        stated_unit = angle_unit
        if is_limited and dimension.time_power == 0:
            check_turns(number, angle_unit)
    if stated_unit == target:
        return number
    return math.radians(number) if target == "rad" else math.degrees(number)


def check_turns(number: float, angle_unit: AngleUnit) -> None:
    """Raise `QuantityError` if an angle without a unit has implausibly many turns.

    The user has probably forgotten the unit, for example written 90 where the file is in
    rad. The message says in which unit the number was read.
    """
    turn = 360.0 if angle_unit == "deg" else 2.0 * math.pi
    turns = abs(number) / turn
    # NaN and infinite numbers pass here; other checks refuse them.
    if MAX_TURNS_WITHOUT_UNIT[angle_unit] < turns < math.inf:
        # All digits, so that whoever follows the advice gets the angle that was written.
        digits = f"{number:.15g}"
        hint = "" if angle_unit == "deg" else f"{digits}deg if it is in degrees, or "
        raise QuantityError(
            f"found {digits} without a unit, which is read as {digits} {angle_unit} "
            f"(the unit of the file), that is, {turns:.3g} turns; write {hint}"
            f"{digits}{angle_unit} if you mean this many turns"
        )


def _unit_error(number: str, unit: str, dimension: Dimension) -> QuantityError:
    """Return the error about a unit that a quantity cannot have."""
    return QuantityError(
        f'found the unit "{unit}", but the units of {dimension.noun} are '
        f"{listing(dimension.units)}; write for example {number}{dimension.units[0]}"
    )
