"""Ball arithmetic: numbers that carry a bound of their error.

A ball is a centre and a radius. An operation on balls returns a ball that contains the
exact results for all values inside its operands (F. Johansson, Arb, 2017). This is the only
module that imports python-flint.
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

UNIT_ROUNDOFF = 2.0**-53
"""Largest relative error of one rounding to float64."""

DEFAULT_DIGITS = 50
"""Decimal digits of `Digits` unless another number of digits is asked for.

Larger: reference values take longer. Smaller: more of their digits are rounding.
"""

MIN_DIGITS = 20
"""Fewest decimal digits of `Digits`."""

MAX_DIGITS = 300
"""Most decimal digits of `Digits`."""


def flint_library() -> Any:
    """Return python-flint, which is imported when it is first needed."""
    import flint

    return flint


@contextmanager
def working_precision(bits: int) -> Iterator[None]:
    """Compute with ball centres of `bits` bits within this context."""
    with flint_library().ctx.workprec(bits):
        yield


def precision_bits() -> int:
    """Return the number of bits of ball centres in the present context."""
    return int(flint_library().ctx.prec)


@checked_class(EngineError)
class Digits:
    """The number of decimal digits in which reference values are computed.

    Reference values check the normal results, which have 16 digits.

    Parameters
    ----------
    digits
        Number of decimal digits, from 20 to 300.

    Attributes
    ----------
    digits
        The number of digits as given.
    eps
        Distance from 1 to the next larger number in this precision.

    Raises
    ------
    EngineError
        If fewer than 20 or more than 300 digits are asked for.
    """

    def __init__(self, digits: int = DEFAULT_DIGITS) -> None:
        """Convert the decimal digits, with one more for rounding, to a number of bits."""
        if not MIN_DIGITS <= digits <= MAX_DIGITS:
            raise EngineError(
                f"digits: found {digits}, expected a number between {MIN_DIGITS} and "
                f"{MAX_DIGITS}"
            )
        self.digits = digits
        self._bits = round((digits + 1) * np.log2(10.0))
        self.eps = 2.0 ** (1 - self._bits)

    def within(self) -> AbstractContextManager[None]:
        """Return a `with` context in which balls are computed with `digits` digits.

        A ball is a number that is stored with a bound of its error. Reference values are
        balls. Calculate with them inside this context: outside, results have only about 16
        digits.
        """
        return working_precision(self._bits)


sine_cosine = np.frompyfunc(lambda ball: ball.sin_cos(), 1, 2)
"""Return the sines and the cosines of an array of balls or power series (rad)."""

exact_centres = np.frompyfunc(lambda ball: ball.mid(), 1, 1)
"""Return the centres of an array of balls as balls of radius 0."""


def centre_floats(balls: Array) -> Floats:
    """Return the float64 numbers next to the centres of an array of real balls."""
    return np.asarray(balls, dtype=float)


def centre_float(ball: Ball) -> float:
    """Return the float64 number next to the centre of a real ball."""
    return float(ball.mid())


def power_series(*coefficients: Array) -> Array:
    """Return an array of power series in one variable, with balls as coefficients.

    Balls are numbers with a bound of their error. A function of a series is again a series.
    Its coefficients are the derivatives of the function with respect to the variable,
    divided by factorials.

    Parameters
    ----------
    coefficients
        One array (...) of balls for each power of the variable, the power 0 first.

    Returns
    -------
    (...) power series with as many terms as there are arrays.
    """
    series_type = flint_library().arb_series
    # The last axis counts the powers of the variable.
    coefficient_rows = np.stack(coefficients, axis=-1)
    series = np.empty(coefficient_rows.shape[:-1], dtype=object)
    for index in np.ndindex(series.shape):
        series[index] = series_type(list(coefficient_rows[index]), len(coefficients))
    return series


def series_coefficient(series: Array, power: int) -> Array:
    """Return the coefficients (...) of one power in an array (...) of power series.

    An element that is a ball (number with a bound of its error) is a constant series.
    """
    series_type = flint_library().arb_series

    def select_coefficient(entry: Any) -> Ball:
        if isinstance(entry, series_type):
            return entry[power]
        return 0 * entry if power else entry

    return np.asarray(np.frompyfunc(select_coefficient, 1, 1)(series))


def enclose_both(first: Array, second: Array) -> Array:
    """Return balls (numbers with error bounds) that contain the balls of two arrays.

    The caller evaluates a piecewise function at balls that meet several pieces. It joins
    the values of these pieces one after another.

    Both arrays have the shape (...), and each ball contains the two balls at its place. If
    the elements are power series, this is done for each coefficient that both series have.
    """
    series_type = flint_library().arb_series

    def unite(a: Any, b: Any) -> Any:
        if not isinstance(a, series_type):
            return a.union(b)
        # `prec` is the number of known coefficients of a series, from power 0 on.
        count = min(a.prec, b.prec)
        coefficients = [a[power].union(b[power]) for power in range(count)]
        return series_type(coefficients, count)

    return np.asarray(np.frompyfunc(unite, 2, 1)(first, second))


def ball_ends(balls: Array) -> tuple[Floats, Floats]:
    """Return float64 numbers below and above the intervals of real balls.

    A ball is a centre and a radius, that is an interval. The caller looks up in which piece
    of a curve each end of the interval is. There are two exceptions, in which both results
    are the centre, rounded to float64:

    - The radius is 0. So float64 numbers stay unchanged.
    - An end of the interval is not finite. The results are then no bounds.

    Parameters
    ----------
    balls
        (...) real balls, in an array of any shape.

    Returns
    -------
    lows, highs
        (...) the lower and the upper bounds, in arrays of the same shape.
    """
    # At first both ends are the centres.
    lows = centre_floats(balls)
    highs = lows.copy()
    for index, ball in np.ndenumerate(balls):
        # The conversion to float64 can round towards the centre; `nextafter` corrects this.
        low = np.nextafter(float(ball.lower()), -np.inf)
        high = np.nextafter(float(ball.upper()), np.inf)
        is_exact = ball.rad() == 0
        is_finite = np.isfinite(low) and np.isfinite(high)
        if is_finite and not is_exact:
            lows[index] = low
            highs[index] = high
    return lows, highs


@contextmanager
def series_length_limit(count: int) -> Iterator[None]:
    """Compute with power series of at most `count` terms within this context."""
    context = flint_library().ctx
    length_before = context.cap
    context.cap = count
    try:
        yield
    finally:
        context.cap = length_before


def solve_balls(square: Array, right: Array) -> Array:
    """Return balls that contain all solutions of linear equations with ball coefficients.

    A ball is a number with a bound of its error. The result contains the solution for each
    matrix and each right-hand side within these bounds.

    Parameters
    ----------
    square
        (n, n) real or complex balls, the matrix.
    right
        (n, m) real or complex balls, m right-hand sides.

    Returns
    -------
    (n, m) balls, one column for each right-hand side.

    Raises
    ------
    ZeroDivisionError
        If it is not proven that every matrix within the balls is regular.
    """
    flint = flint_library()
    has_complex = any(isinstance(entry, flint.acb) for entry in (*square.flat, *right.flat))
    matrix_type = flint.acb_mat if has_complex else flint.arb_mat
    solution = matrix_type(square.tolist()).solve(matrix_type(right.tolist()))
    return np.array(solution.tolist())


def widen(ball: Ball, radius: float) -> Ball:
    """Return the ball of all numbers at a distance of at most `radius` from a real ball."""
    return ball + flint_library().arb(0.0, radius)


def pi_ball() -> Ball:
    """Return pi as a ball."""
    return flint_library().arb.pi()


def polar_angle(cosine: Ball, sine: Ball) -> Ball:
    """Return the polar angle (rad) of the plane vector (cosine, sine).

    Cosine and sine are balls (numbers with a bound of their error). The function atan2
    jumps at half a turn. A ball across this jump would be as wide as a turn. Vectors with
    a negative cosine are therefore rotated by half a turn first.
    """
    atan2 = flint_library().arb.atan2
    if cosine < 0:
        return atan2(-sine, -cosine) + pi_ball()
    return atan2(sine, cosine)


def complex_ball(*parts: complex | Ball) -> Ball:
    """Return a complex ball from an exact number, or from real and imaginary balls."""
    return flint_library().acb(*parts)


def upper_magnitude(ball: Ball) -> float:
    """Return a float64 number that is at least the magnitude of every number in a ball.

    The centre of a ball is NaN if nothing is known, for example after a division by a ball
    that contains 0. Such a ball can contain any number, and the result is infinite.
    """
    if ball == 0:
        return 0.0
    magnitude = float(np.nextafter(float(ball.abs_upper()), np.inf))
    return np.inf if np.isnan(magnitude) else magnitude


def lower_magnitude(ball: Ball) -> float:
    """Return a float64 number that is at most the magnitude of every number in a ball.

    If the centre of the ball is NaN, nothing is known and the result is 0.
    """
    # The comparison is false for NaN.
    magnitude = float(np.nextafter(float(ball.abs_lower()), -np.inf))
    return magnitude if magnitude > 0.0 else 0.0


def cosines_and_sines(angles: Any) -> Floats:
    """Return the cosines and sines of angles, each rounded only once, to float64.

    Proofs need a guaranteed bound of the rounding, which NumPy's functions lack. So the
    values are computed with more digits in ball arithmetic (numbers with a bound of their
    error), and then rounded. The caller sets these digits (`working_precision`); 53 bits
    are too few.

    Parameters
    ----------
    angles
        (...) angles (rad): float64 numbers, which count as exact, or balls with errors far
        below the rounding of a float64.

    Returns
    -------
    (..., 2) cosine and sine of each angle.
    """
    # Convert each angle to a ball of the library.
    balls = np.frompyfunc(flint_library().arb, 1, 1)(angles)
    sine, cosine = sine_cosine(balls)
    return centre_floats(np.stack([cosine, sine], axis=-1))
