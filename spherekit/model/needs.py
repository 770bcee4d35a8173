"""Numbers, expressions and pairs that loads, masses and stops may have."""

import inspect
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.expression import load_names, parse

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism


def need_angle(key: str, pair: str, mechanism: "Mechanism") -> None:
    """Refuse a pair whose variable is not an angle, at a key."""
    if pair in mechanism.angles:
        return
    raise ModelError(
        f'{key}: "{pair}" is a contact pair ({mechanism.pair(pair).type}), whose variables '
        "are arc lengths; only R pairs have torques and stops. R pairs: "
        f"{listing(mechanism.angles)}"
    )


def need_expression(key: str, text: Any, mechanism: "Mechanism") -> None:
    """Refuse a text that is not an expression in the variables of R pairs and the time."""
    if not isinstance(text, str):
        raise ModelError(
            f'{key}: found {text!r}, needs an expression in quotes, such as "0.5*sin(t)"'
        )
    try:
        parse(text, load_names(mechanism.angles))
    except ModelError as error:
        raise ModelError(f"{key}: in the expression, {error}") from None


def need_function(key: str, function: Callable[[float, float, float], float]) -> None:
    """Refuse a function that cannot be called with time, variable and rate."""
    try:
        inspect.signature(function).bind(0.0, 0.0, 0.0)
    except TypeError as error:
        raise ModelError(
            f"{key}: the function has to take time, variable and rate (t, q, dq): {error}"
        ) from None
    except ValueError:  # some builtins have no signature
        return


def need_at_least_zero(key: str, number: float, unit: str, hint: str = "") -> None:
    """Refuse a number that is negative or not finite."""
    need_finite(key, [number])
    if number < 0:
        raise ModelError(f"{key}: found {number:g} {unit}, needs at least 0{hint}")


def need_smoothing(key: str, speed: float) -> None:
    """Refuse a rate (rad/s) that does not smooth the jump of dry friction."""
    need_finite(key, [speed])
    if not speed > 0:
        raise ModelError(
            f"{key}: found {speed:g} rad/s, needs more than 0: the rate below which the "
            "jump of dry friction is smoothed"
        )


def need_finite(key: str, numbers: Any) -> None:
    """Refuse numbers that are not finite."""
    for number in numbers:
        if not math.isfinite(number):
            raise ModelError(f"{key}: found {number}, needs a finite number")
