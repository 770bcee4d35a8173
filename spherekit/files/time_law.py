"""Time laws: the variable of an input, its rate and its acceleration at any time."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.mechanism.elements import check_table_rows
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.sizes import check_finite
from spherekit.quantity import (
    ANGLE,
    ANGULAR_SPEED,
    DURATION,
    AngleUnit,
    Dimension,
    angle_by_time,
    read_quantity,
)

States = tuple[Floats, Floats, Floats]
"""The variable (rad), its rate (rad/s) and acceleration (rad/s2), in the shape of t."""


LAW_SPLINE_DEGREE = 5
"""Degree of the spline of a table. A quintic spline has a continuous fourth derivative, so
the driving torque, which depends on the acceleration, is smooth."""


def store_finite_numbers(instance: Any) -> None:
    """Convert lists and arrays in the fields of a law or a start to tuples.

    Tuples make laws with the same numbers equal. `ModelError` is raised if a number is not
    finite.
    """
    for name, given in list(vars(instance).items()):
        value = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(value, list):
            value = tuple(value)
            object.__setattr__(instance, name, value)
        check_finite(name, value if isinstance(value, tuple) else [value])


@checked_class(ModelError, "at")
@dataclass(frozen=True)
class ConstantSpeed:
    """An input that turns at a constant speed (rad/s) from `start` (rad) at t = 0."""

    speed: float
    start: float = 0.0

    def __post_init__(self) -> None:
        store_finite_numbers(self)

    def at(self, t: ArrayLike) -> States:
        """Return variable, rate and acceleration at times (s) of any shape."""
        return Polynomial((self.start, self.speed)).at(t)


@checked_class(ModelError, "at")
@dataclass(frozen=True)
class Polynomial:
    """A time law in which the variable of an input is a polynomial of the time t.

    The variable (rad) is the sum of ``coefficients[k] t**k``, with t in s and coefficients
    in rad/s^k.
    """

    coefficients: Numbers

    def __post_init__(self) -> None:
        store_finite_numbers(self)
        if not self.coefficients:
            raise ModelError("coefficients: is empty; give at least [c0]")

    def at(self, t: ArrayLike) -> States:
        """Return variable (rad), rate and acceleration at times (s) of any shape."""
        law = np.polynomial.Polynomial(self.coefficients)
        with np.errstate(over="ignore", invalid="ignore"):
            q, dq, ddq = (law.deriv(order)(np.asarray(t, float)) for order in range(3))
        return q, dq, ddq


@checked_class(ModelError, "at")
@dataclass(frozen=True)
class Cycloidal:
    """A time law that moves an input from rest to rest, along a cycloid.

    The variable (rad) of the input is ``start + (stop - start) (x - sin(2 pi x) / (2 pi))``
    with ``x = t / duration``. Before t = 0 and after the duration (s) it is constant.
    """

    start: float
    stop: float
    duration: float

    def __post_init__(self) -> None:
        store_finite_numbers(self)
        if not self.duration > 0:
            raise ModelError(f"duration: found {self.duration:g} s, expected more than 0")

    def at(self, t: ArrayLike) -> States:
        """Return variable, rate and acceleration at times (s) of any shape."""
        # x = t / duration; 0 before the start and 1 after the end.
        x = np.clip(np.asarray(t, dtype=np.float64) / self.duration, 0.0, 1.0)
        rise = self.stop - self.start
        turn = 2 * math.pi
        # The angle 2 pi x. At the end 0 replaces 2 pi, because sin(2 pi) is not exactly 0
        # in float64. Rate and acceleration must be exactly 0 there.
        angle = turn * np.where(x < 1.0, x, 0.0)
        q = self.start + rise * (x - np.sin(angle) / turn)
        dq = rise / self.duration * (1 - np.cos(angle))
        ddq = rise / self.duration**2 * turn * np.sin(angle)
        return q, dq, ddq


@checked_class(ModelError, "at")
@dataclass(frozen=True)
class Tabulated:
    """A time law as a table of angles (rad) of an input at rising times (s).

    A quintic spline passes through the angles. By default its ends have no conditions of
    their own (not-a-knot), so it is exact for polynomials up to the fifth degree. With
    `rest_at_ends`, rate and acceleration are zero at both ends (clamped).
    """

    times: Numbers
    angles: Numbers
    rest_at_ends: bool = False

    def __post_init__(self) -> None:
        store_finite_numbers(self)
        min_rows = 2 if self.rest_at_ends else LAW_SPLINE_DEGREE + 1
        hint = (
            ""
            if self.rest_at_ends
            else ", or 2 with rest_at_ends = true, for the quintic spline of the law"
        )
        check_table_rows("", "angles", self.times, self.angles, min_rows, hint)

    def at(self, t: ArrayLike) -> States:
        """Return the variable of the input, its rate and acceleration at times (s).

        Parameters
        ----------
        t
            Times of any shape. They must be between the first and the last time of the
            table of angles.

        Raises
        ------
        ModelError
            If a time is outside the table.
        """
        t = np.asarray(t, dtype=np.float64)
        first, last = self.times[0], self.times[-1]
        if not np.all((t >= first) & (t <= last)):
            raise ModelError(
                f"the table of the input has times from {first:.6g} to {last:.6g} s, but "
                f"{np.min(t):.6g} to {np.max(t):.6g} s are needed; add rows or shorten the "
                "duration"
            )
        q, dq, ddq = (spline(t) for spline in self._splines)
        return q, dq, ddq

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        """The spline of the variable and its first and second derivatives."""
        # Imported here, because the import of SciPy takes longer than reading a study file.
        from scipy.interpolate import make_interp_spline

        rest = [(1, 0.0), (2, 0.0)]  # order and value of derivatives at an end
        end_conditions: Any = (rest, rest) if self.rest_at_ends else None
        spline = make_interp_spline(
            self.times, self.angles, LAW_SPLINE_DEGREE, bc_type=end_conditions
        )
        return spline, spline.derivative(1), spline.derivative(2)


Law = ConstantSpeed | Polynomial | Cycloidal | Tabulated


class TimeLaw(Protocol):
    """An object that computes variable, rate and acceleration of an input at any time."""

    def at(self, t: ArrayLike) -> States:
        """Return the input at times t (s)."""


def make_field_readers(
    angle_unit: AngleUnit,
) -> Mapping[str, Callable[[str], float | Numbers]]:
    """Return, for each field of numbers of a time law, a function that reads its text.

    A time law says how an input of a mechanism moves in time. Users write its fields as
    text, with or without units, such as ``speed=30rpm`` or ``times=0s+2s+4s``. Each
    function returns the number in rad, rad/s or s, or a tuple if the field is a list. The
    function raises `QuantityError` if the text or its unit is wrong.

    Parameters
    ----------
    angle_unit
        Unit of angles that are written without a unit.
    """
    number = partial(read_quantity, angle_unit=angle_unit)
    number_list = partial(read_quantity_list, angle_unit=angle_unit)
    return {
        "speed": partial(number, dimension=ANGULAR_SPEED),
        "start": partial(number, dimension=ANGLE),
        "stop": partial(number, dimension=ANGLE),
        "duration": partial(number, dimension=DURATION),
        "times": partial(number_list, dimension=DURATION),
        "angles": partial(number_list, dimension=ANGLE),
        "coefficients": partial(read_polynomial_coefficients, angle_unit=angle_unit),
    }


def split_at_plus(text: str) -> list[str]:
    """Return the numbers in a text such as ``0.4+0.2``, in which the sign + separates them.

    A sign + in front of the first number is left out.
    """
    # The plus sign of an exponent, as in 1e+5, is not a separator.
    return re.split(r"(?<![eE])\+", text.strip().removeprefix("+"))


def read_quantity_list(text: str, dimension: Dimension, angle_unit: AngleUnit) -> Numbers:
    """Read a list of angles, speeds or times, such as ``0deg+45deg+90deg``.

    Parameters
    ----------
    text
        Numbers with or without units. The plus sign between them is a separator.
    dimension
        The quantity of all numbers: an angle, a speed or a time.
    angle_unit
        Unit of angles that are written without a unit.

    Returns
    -------
    The numbers in rad, rad/s or s.

    Raises
    ------
    QuantityError
        If a part is not a number with a unit of this quantity.
    """
    return tuple(
        read_quantity(number_text, dimension, angle_unit)
        for number_text in split_at_plus(text)
    )


def read_polynomial_coefficients(text: str, angle_unit: AngleUnit) -> Numbers:
    """Read the coefficients of an angle that is a polynomial in the time t.

    The angle is c_0 + c_1 t + c_2 t^2 + ..., and c_0 is written first. The coefficients
    have different units: an angle, a speed (deg/s), an acceleration (deg/s2), and so on. An
    example is ``10deg+30deg/s``.

    Parameters
    ----------
    text
        Coefficients with or without units. The plus sign between them is a separator.
    angle_unit
        Unit of angles in coefficients that are written without a unit.

    Returns
    -------
    The coefficients in rad, rad/s, rad/s2, ...

    Raises
    ------
    QuantityError
        If a coefficient is not a number with its unit.
    """
    coefficients = []
    for power, coefficient_text in enumerate(split_at_plus(text)):
        dimension = angle_by_time(power)
        coefficients.append(read_quantity(coefficient_text, dimension, angle_unit))
    return tuple(coefficients)


LAW_KINDS: Mapping[str, type[Law]] = {
    "constant_speed": ConstantSpeed,
    "polynomial": Polynomial,
    "cycloidal": Cycloidal,
    "table": Tabulated,
}
"""The time laws by the names that they have in files."""
