"""The only home of python-flint: numbers that carry a bound of their own error.

A ball is a centre and a radius; every operation returns a ball that contains all exact
results of all numbers in its operands (F. Johansson, Arb, 2017).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError

Ball = Any
"""A real ball, `flint.arb`, or a complex one, `flint.acb`."""

UNIT = 2.0**-53
"""Relative error of one rounding to float64."""

DIGITS = 50
"""Decimal digits of `Digits` unless others are asked for."""

FEWEST, MOST = 20, 300


def library() -> Any:
    """Return python-flint."""
    import flint

    return flint


@contextmanager
def bits(precision: int) -> Iterator[None]:
    """Compute with centres of so many bits within this context."""
    with library().ctx.workprec(precision):
        yield


def precision() -> int:
    """Return the bits of centres at present."""
    return int(library().ctx.prec)


@checked_class(EngineError)
class Digits:
    """How many decimal `digits` reference values are computed in; `eps` is their spacing.

    Raises
    ------
    EngineError
        If fewer than 20 or more than 300 digits are asked for.
    """

    def __init__(self, digits: int = DIGITS) -> None:
        if not FEWEST <= digits <= MOST:
            raise EngineError(
                f"{digits} digits were asked for; give between {FEWEST} and {MOST}"
            )
        self.digits = digits
        self._bits = round((digits + 1) * np.log2(10.0))
        self.eps = 2.0 ** (1 - self._bits)

    def within(self) -> AbstractContextManager[None]:
        """Return the context in which balls are computed with so many digits."""
        return bits(self._bits)


sine_cosine = np.frompyfunc(lambda ball: ball.sin_cos(), 1, 2)
middles = np.frompyfunc(lambda ball: ball.mid(), 1, 1)


def floats(balls: Array) -> Floats:
    """Return the float64 numbers next to the centres of real balls."""
    return np.asarray(balls, dtype=float)


def series(*coefficients: Array) -> Array:
    """Return power series with coefficients (...), that of the power 0 first."""
    made, rows = library().arb_series, np.stack(coefficients, axis=-1)
    out = np.empty(rows.shape[:-1], dtype=object)
    for place in np.ndindex(out.shape):
        out[place] = made(list(rows[place]), len(coefficients))
    return out


def coefficient(of: Array, power: int) -> Array:
    """Return the coefficients (...) of a power in series; a ball is its own of power 0."""
    kind = library().arb_series

    def taken(item: Any) -> Ball:
        if isinstance(item, kind):
            return item[power]
        return 0 * item if power else item

    return np.asarray(np.frompyfunc(taken, 1, 1)(of))


@contextmanager
def terms(count: int) -> Iterator[None]:
    """Compute with series of at most so many terms within this context."""
    context = library().ctx
    before, context.cap = context.cap, count
    try:
        yield
    finally:
        context.cap = before


def solved(square: Array, right: Array) -> Array:
    """Return balls (n, m) of all solutions of linear equations, right sides (n, m).

    Raises
    ------
    ZeroDivisionError
        If the square matrix may be singular.
    """
    flint = library()
    either = any(isinstance(entry, flint.acb) for entry in (*square.flat, *right.flat))
    matrix = flint.acb_mat if either else flint.arb_mat
    return np.array(matrix(square.tolist()).solve(matrix(right.tolist())).tolist())


def wide(centre: Ball, radius: float) -> Ball:
    """Return the ball around all numbers at most a radius from those of a ball."""
    return centre + library().arb(0.0, radius)


def pi() -> Ball:
    """Return the circle's number."""
    return library().arb.pi()


def angle_of(cosine: Ball, sine: Ball) -> Ball:
    """Return the angle (rad) of a point of a circle, without a jump at half a turn."""
    atan2 = library().arb.atan2
    if cosine < 0:
        return atan2(-sine, -cosine) + pi()
    return atan2(sine, cosine)


def complex_ball(*parts: complex | Ball) -> Ball:
    """Return a complex ball: of a number without error, of real and imaginary balls."""
    return library().acb(*parts)


def upper(ball: Ball) -> float:
    """Return a float64 number that no magnitude in a ball exceeds."""
    return 0.0 if ball == 0 else float(np.nextafter(float(ball.abs_upper()), np.inf))


def lower(ball: Ball) -> float:
    """Return a float64 number that every magnitude in a ball reaches."""
    return max(float(np.nextafter(float(ball.abs_lower()), -np.inf)), 0.0)


def middle(ball: Ball) -> float:
    """Return a float64 number next to the centre of a real ball."""
    return float(ball.mid())


def circle(angles: Any) -> Floats:
    """Return float64 cosines and sines (..., 2) of angles (...), each rounded once.

    Angles are float64 numbers, taken as they are, or balls far narrower than a rounding.
    """
    sine, cosine = sine_cosine(np.frompyfunc(library().arb, 1, 1)(angles))
    return floats(np.stack([cosine, sine], axis=-1))
