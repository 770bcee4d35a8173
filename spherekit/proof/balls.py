"""The only home of python-flint: numbers that carry a bound of their own error.

A ball is a centre and a radius; every operation returns a ball that contains all exact
results of all numbers in its operands (F. Johansson, Arb, 2017).

Vectors of balls and the frames of R pairs in their links.

A frame (3, 3) has three unit vectors as its rows: zero direction, side, axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked_class
from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.model.gears import COLLINEAR, axes_from_sizes
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry, SizeGeometry

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


def exactly(values: ArrayLike) -> Array:
    """Return float64 numbers without error."""
    return np.asarray(np.frompyfunc(library().arb, 1, 1)(np.asarray(values, dtype=float)))


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


def exact(number: float) -> Ball:
    """Return a float64 number without error."""
    return library().arb(float(number))


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


Vector = Array
Frame = Array
Frames = dict[str, tuple[Frame, Frame]]
"""The frames of R pairs in their first and their second link, by name."""


def unit(a: Vector) -> Vector:
    """Return a vector over its length."""
    return a / np.sqrt(a @ a)


def turned(frame: Frame, angle: Ball) -> Frame:
    """Return a frame turned about its axis by an angle (rad)."""
    (s, c), (x, y, z) = angle.sin_cos(), frame
    return np.stack([c * x + s * y, c * y - s * x, z])


def revolute(first: Frame, second: Frame) -> Array:
    """Return (3, 3, 3) how an R pair turns its second link in the first, by its frames.

    By the sum of these times 1, the cosine and the sine of its angle.
    """
    (x, y, z), nothing = first, 0 * first[0]
    moved = [[nothing, nothing, z], [x, y, nothing], [y, -x, nothing]]
    return np.array(moved).swapaxes(1, 2) @ second


def axes_about(centre: Vector) -> Frame:
    """Return the axes from which azimuths about a unit vector are counted, and it."""
    helper = np.eye(3)[1 if abs(float(centre[0])) > 0.9 else 0]
    return _frame(centre, helper - (helper @ centre) * centre)


def frames_of_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    sizes: Mapping[str, Sequence[Sequence[Ball]]],
    zeros: Mapping[str, Ball],
) -> Frames:
    """Return frames from arcs and angles (rad) of links.

    Those of float64 say which axes are on a line.
    """
    near = {link: axes_from_sizes(given) for link, given in geometry.links.items()}
    axes = {}
    for link, (arcs, turns) in sizes.items():
        given = LinkSizes(geometry.links[link].axes, tuple(arcs), tuple(turns))
        placed = axes_from_sizes(given).items()
        axes[link] = {name: axis + exact(0.0) for name, axis in placed}
    made = {}
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            first, second = (
                _reference_frame(axes[link], near[link], pair.name) for link in pair.links
            )
            made[pair.name] = turned(first, zeros.get(pair.name, exact(0.0))), second
    return made


def frames_of_pose(
    geometry: PoseGeometry, axes: Mapping[str, Vector], values: Mapping[str, Ball]
) -> Frames:
    """Return frames from unit axes in the reference pose, and the pairs' values there."""
    made = {}
    for name, near in geometry.axes.items():
        first = _across(axes[name], np.array(near))
        made[name] = first, turned(first, values.get(name, exact(0.0)))
    return made


def declared_frames(mechanism: Mechanism) -> Frames:
    """Return the frames with all sizes as the float64 numbers that they are."""
    given = mechanism.geometry
    if isinstance(given, PoseGeometry):
        axes = {name: unit(exactly(axis)) for name, axis in given.axes.items()}
        return frames_of_pose(given, axes, _exact(given.values))
    sizes = {
        link: [[*exactly(near.arcs)], [*exactly(near.angles)]]
        for link, near in given.links.items()
    }
    return frames_of_sizes(mechanism, given, sizes, _exact(given.zeros))


def _exact(numbers: Mapping[str, float]) -> dict[str, Ball]:
    return {name: exact(number) for name, number in numbers.items()}


def _reference_frame(
    axes: Mapping[str, Vector], near: Mapping[str, Floats], name: str
) -> Frame:
    """Return the frame of an axis; its x axis leads to the first other axis."""
    axis = axes[name]
    for other, direction in axes.items():
        if np.linalg.norm(np.cross(near[name], near[other])) > COLLINEAR:
            return _frame(axis, np.cross(np.cross(axis, direction), axis))
    return _across(axis, near[name])


def _across(axis: Vector, near: Floats) -> Frame:
    """Return the frame of an axis that no other one gives a direction."""
    return _frame(axis, np.cross(axis, np.eye(3)[np.argmin(np.abs(near))]))


def _frame(axis: Vector, toward: Vector) -> Frame:
    """Return the frame of an axis with its x axis along a vector across it."""
    first = unit(toward)
    return np.stack([first, np.cross(axis, first), axis])
