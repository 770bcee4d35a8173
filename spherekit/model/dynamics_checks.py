"""Whether masses, loads and stops can be real; the errors say by how much they are not."""

import inspect
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError
from spherekit.model import expression
from spherekit.model.dynamics import (
    AXES,
    Damper,
    Friction,
    Gravity,
    Load,
    Mass,
    Moment,
    PairTorque,
    PointForce,
    Spring,
    Stop,
    TorqueFunction,
    TorqueTable,
)
from spherekit.model.inertia import moments_of_point
from spherekit.model.laws import need_increasing

MOMENT_TOLERANCE = 1e-3
"""Excess of a principal moment that passes for rounding, as part of the largest entry.

The moments of a thin arc stand exactly on the limit, and tables print few digits.
"""

ASYMMETRY = 1e-12
"""Difference of two mirrored entries that passes for rounding, as part of the largest."""


def check_mass(mass: Mass) -> None:
    """Refuse an inertia that no body has.

    Raises
    ------
    ModelError
        If the tensor is not symmetric, has a negative principal moment, or one that
        exceeds the sum of the two others; if the mass is not positive; if the tensor is
        smaller than that of the mass at its centre.
    """
    key = f"mass.{mass.link}"
    if mass.mass is not None:
        _need_finite(f"{key}.mass", [mass.mass])
        if not mass.mass > 0:
            raise ModelError(f"{key}.mass: found {mass.mass:g} kg, needs more than 0")
    tensor = np.array(mass.tensor, dtype=np.float64)
    check_tensor(f"{key}.tensor", tensor)
    if mass.centre is None:
        return
    if mass.mass is None:
        raise ModelError(f"{key}.centre: needs a mass with it, in kg")
    _need_finite(f"{key}.centre", mass.centre)
    moved = tensor - moments_of_point(mass.mass, np.array(mass.centre))
    about = f" about the centre of mass ({mass.mass:g} kg at {list(mass.centre)} m)"
    slack = MOMENT_TOLERANCE * float(np.max(np.abs(tensor)))
    _need_moments(key, moved, slack, about)


def check_tensor(key: str, tensor: NDArray[np.float64]) -> None:
    """Refuse an inertia tensor that no body has about any point; `key` says where it is.

    Raises
    ------
    ModelError
        If it is not symmetric, has a negative principal moment, or one that exceeds the
        sum of the two others.
    """
    if tensor.shape != (3, 3):
        raise ModelError(f"{key}: has the shape {tensor.shape}, needs (3, 3)")
    _need_finite(key, tensor.ravel())
    largest = float(np.max(np.abs(tensor)))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(tensor[i, j] - tensor[j, i]) > ASYMMETRY * largest:
            raise ModelError(
                f"{key}: not symmetric: row {i + 1}, column {j + 1} has {tensor[i, j]}, "
                f"row {j + 1}, column {i + 1} has {tensor[j, i]}"
            )
    _need_moments(key, tensor, MOMENT_TOLERANCE * largest, "")


def _need_moments(key: str, tensor: NDArray[np.float64], slack: float, about: str) -> None:
    small, middle, large = map(float, np.linalg.eigvalsh(tensor))
    if small < -slack:
        raise ModelError(
            f"{key}: not physical: the smallest principal moment{about} is {small:.6g} "
            "kg m2; none is below 0"
        )
    excess = large - middle - small
    if excess > slack:
        raise ModelError(
            f"{key}: not physical: the largest principal moment{about} exceeds the sum of "
            f"the others by {excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); "
            "check units, signs of products of inertia, and the point it is about"
        )


def check_loads(
    loads: Iterable[Load], masses: Iterable[Mass], types: Mapping[str, str]
) -> None:
    """Refuse loads with numbers, expressions or places that have no meaning.

    Parameters
    ----------
    loads
        Those of a mechanism; the links and pairs that they name exist.
    masses
        Those of its moving links.
    types
        The type of every pair, by name.

    Raises
    ------
    ModelError
        If a load acts at a contact pair, an expression breaks the grammar, a number is
        not finite or has a sign that cannot be, or gravity lacks a mass with its centre.
    """
    masses = tuple(masses)
    revolute = [name for name, type_ in types.items() if type_ == "R"]
    for load in loads:
        key = f"loads.{load.name}"
        if isinstance(load, Gravity):
            _check_gravity(key, load, masses)
        elif isinstance(load, PointForce | Moment):
            _check_on_link(key, load, revolute)
        else:
            _need_revolute(f"{key}.pair", load.pair, types)
            _check_at_pair(key, load, revolute)


def check_stops(stops: Iterable[Stop], types: Mapping[str, str]) -> None:
    """Refuse stops that are not a range of an R pair's variable."""
    for stop in stops:
        key = f"stops.{stop.pair}"
        _need_revolute(key, stop.pair, types)
        _need_finite(key, (stop.low, stop.high))
        if not stop.low < stop.high:
            raise ModelError(
                f"{key}: the range must rise from `from` to `to`, but it is "
                f"{stop.low:.6g} to {stop.high:.6g} rad"
            )


def _check_gravity(key: str, load: Gravity, masses: tuple[Mass, ...]) -> None:
    _need_finite(f"{key}.acceleration", load.acceleration)
    if not masses:
        raise ModelError(
            f"{key}: gravity needs a moving link with a mass: give mass and centre in "
            "[mass.LINK], or leave gravity out"
        )
    lacking = [each.link for each in masses if each.centre is None]
    if lacking:
        raise ModelError(
            f"{key}: gravity needs mass and centre of every link with inertia; "
            f"[mass.LINK] lacks them for link {listing(lacking)}"
        )


def _check_on_link(key: str, load: PointForce | Moment, revolute: list[str]) -> None:
    if load.axes not in AXES:
        raise ModelError(
            f'{key}.axes: found "{load.axes}", allowed: {listing(AXES)}'
            f"{nearest(load.axes, AXES)}"
        )
    if isinstance(load, PointForce):
        _need_finite(f"{key}.point", load.point)
        what, parts = "force", load.force
    else:
        what, parts = "moment", load.moment
    for number, text in enumerate(parts):
        _need_expression(f"{key}.{what}[{number}]", text, revolute)


def _check_at_pair(
    key: str,
    load: PairTorque | Spring | Damper | Friction | TorqueTable,
    revolute: list[str],
) -> None:
    if isinstance(load, PairTorque):
        if callable(load.torque):
            _need_function(f"{key}.torque", load.torque)
        else:
            _need_expression(f"{key}.torque", load.torque, revolute)
    elif isinstance(load, Spring):
        push = "; a torque that pushes away is a load of kind torque, an expression"
        _need_at_least_zero(f"{key}.stiffness", load.stiffness, "N m/rad", push)
        _need_finite(f"{key}.rest", [load.rest])
    elif isinstance(load, Damper):
        drive = "; a torque that drives is a load of kind torque, an expression"
        _need_at_least_zero(f"{key}.damping", load.damping, "N m s/rad", drive)
    elif isinstance(load, Friction):
        _need_at_least_zero(f"{key}.torque", load.torque, "N m")
        _need_at_least_zero(f"{key}.viscous", load.viscous, "N m s/rad")
        _need_finite(f"{key}.speed", [load.speed])
        if not load.speed > 0:
            raise ModelError(
                f"{key}.speed: found {load.speed:g} rad/s, needs more than 0: the rate "
                "below which the jump of dry friction is smoothed"
            )
    else:
        _check_table(key, load)


def _check_table(key: str, load: TorqueTable) -> None:
    if len(load.times) != len(load.torques):
        raise ModelError(
            f"{key}.torques: has {len(load.torques)} values, but times has "
            f"{len(load.times)}"
        )
    if len(load.times) < 2:
        raise ModelError(f"{key}.times: has {len(load.times)} values, needs at least 2")
    _need_finite(f"{key}.times", load.times)
    _need_finite(f"{key}.torques", load.torques)
    need_increasing(f"{key}.times", load.times)
    if load.periodic and load.torques[0] != load.torques[-1]:
        raise ModelError(
            f"{key}.torques: a periodic table ends with the torque it starts with, but "
            f"this one has {load.torques[0]:g} and {load.torques[-1]:g} N m"
        )


def _need_expression(key: str, text: Any, revolute: list[str]) -> None:
    if not isinstance(text, str):
        raise ModelError(
            f'{key}: found {text!r}, needs an expression in quotes, such as "0.5*sin(t)"'
        )
    try:
        expression.parse(text, expression.load_names(revolute))
    except ModelError as error:
        raise ModelError(f"{key}: in the expression, {error}") from None


def _need_function(key: str, function: TorqueFunction) -> None:
    try:
        inspect.signature(function).bind(0.0, 0.0, 0.0)
    except TypeError as error:
        raise ModelError(
            f"{key}: the function has to take time, variable and rate (t, q, dq): {error}"
        ) from None
    except ValueError:  # some builtins have no signature
        return


def _need_revolute(key: str, pair: str, types: Mapping[str, str]) -> None:
    if types[pair] == "R":
        return
    revolute = [name for name, type_ in types.items() if type_ == "R"]
    raise ModelError(
        f'{key}: "{pair}" is a contact pair ({types[pair]}), whose variables are arc '
        f"lengths; only R pairs have torques and stops. R pairs: {listing(revolute)}"
    )


def _need_at_least_zero(key: str, number: float, unit: str, hint: str = "") -> None:
    _need_finite(key, [number])
    if number < 0:
        raise ModelError(f"{key}: found {number:g} {unit}, needs at least 0{hint}")


def _need_finite(key: str, numbers: Any) -> None:
    for number in numbers:
        if not math.isfinite(number):
            raise ModelError(f"{key}: found {number}, needs a finite number")
