"""Profiles of contact pairs as a mechanism declares them, in balls.

Angles, radii and coefficients are taken as the float64 numbers they are given by, and
directions are made unit vectors. A profile through points is the quintic spline that
`spherekit.sphere.profile` lays through them: its float64 knots and coefficients are what is
declared. No curvature occurs here: curves give places and tangents only, and their
derivatives are those of power series.
"""

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, final

import numpy as np

from spherekit.errors import EngineError
from spherekit.model.parts import Profile
from spherekit.proof.balls import (
    Ball,
    Balls,
    coefficient,
    exactly,
    floats,
    pi,
    precision,
    series,
    sine_cosine,
    square_root,
    terms,
)
from spherekit.proof.frames import axes_about, unit
from spherekit.sphere.paths import SplinePath
from spherekit.sphere.profile import spline_through
from spherekit.sphere.rotation import Floats

MOST_PANELS = 10_000


def harmonic(parts: Balls, angles: Balls) -> Balls:
    """Return (n, 3, 3) parts[0] + parts[1] cos + parts[2] sin of angles (n,) rad."""
    sine, cosine = (np.asarray(x)[:, None, None] for x in sine_cosine(angles))
    return np.asarray(parts[0] + parts[1] * cosine + parts[2] * sine)


class BallCurve(ABC):
    """A curve on the unit sphere by its arc length, closed or open, `length` (rad) long."""

    length: Ball
    closed: bool

    @abstractmethod
    def frame(self, s: Balls) -> Balls:
        """Return frames (n, 3, 3), columns t, n = p x t, p, at arc lengths s (n,) rad."""

    def backwards(self, s: Balls) -> Balls:
        """Return frames run backwards: from the old end, or a closed one from its start."""
        made = self.frame(-s if self.closed else self.length - s)
        return np.asarray(made * np.array([-1.0, -1.0, 1.0]))


def ball_curve(profile: Profile) -> BallCurve:
    """Return the curve of a profile in balls of the present precision."""
    return _curve(profile, precision())


@lru_cache(maxsize=32)
def _curve(profile: Profile, _: int) -> BallCurve:
    if profile.kind == "points":
        path, _table = spline_through(np.array(profile.points), profile.closed)
        return _Measured(_Spline(path), profile.closed)
    axes = axes_about(unit(exactly(profile.centre or ())))
    if profile.kind == "circle":
        return _Circle(axes, *exactly([profile.radius or 0.0])[0].sin_cos())
    if profile.kind == "great_circle":
        return _Circle(axes, *exactly([1.0, 0.0]))
    return _Measured(_Fourier(axes, profile.cosines, profile.sines), True)


@final
class _Circle(BallCurve):
    """A circle about the third of `axes` with the sine and cosine of its radius."""

    closed = True

    def __init__(self, axes: Balls, sine: Ball, cosine: Ball) -> None:
        (x, y, z), nothing = axes, exactly(np.zeros(3))
        self._sine, self.length = sine, 2 * pi() * sine
        still = [nothing, sine * z, cosine * z]
        even = [y, -cosine * x, sine * x]
        odd = [-x, -cosine * y, sine * y]
        self._parts = np.array([still, even, odd]).swapaxes(1, 2)

    def frame(self, s: Balls) -> Balls:
        return harmonic(self._parts, s / self._sine)


class _Path(ABC):
    """A curve in a parameter of its own; between its `edges` it is analytic."""

    edges: Balls

    @abstractmethod
    def at(self, u: Balls) -> tuple[Balls, Balls]:
        """Return points (n, 3) and their derivatives by u (n,)."""

    def speed(self, u: Balls) -> Balls:
        """Return |dp/du|."""
        return _length(self.at(u)[1])


@final
class _Measured(BallCurve):
    """A curve in a parameter of its own, with the parameter as power series of arc length.

    From `starts` on, which are dense enough for the series to have all digits; each is
    that of the arc length's series reversed.
    """

    def __init__(self, path: _Path, closed: bool) -> None:
        self._path, self.closed = path, closed
        digits = precision()
        count = 8 + digits // 3
        starts: list[Ball] = [exactly([0.0])[0]]
        pieces: list[list[Ball]] = []
        with terms(count):
            for low, high in zip(path.edges[:-1], path.edges[1:], strict=True):
                while floats(high - low) > 0.0:
                    if len(pieces) > MOST_PANELS:
                        raise EngineError(
                            "the arc length of a profile does not converge; give its "
                            "points more evenly"
                        )
                    ahead, back = self._expanded(low, count)
                    width = min(1.0, _reach(ahead, digits) / float(high - low))
                    while True:
                        end = low + (high - low) * width if width < 1.0 else high
                        arc = _value(ahead, end - low).mid()
                        if width == 0.0 or float(arc) < _reach(back, digits):
                            break
                        width *= 0.7
                    starts.append(starts[-1] + arc)
                    pieces.append([low, *back[1:]])
                    low = end.mid()
        self._starts, self.length = np.array(starts), starts[-1]
        self._near = floats(self._starts)
        self._pieces: Balls = np.array(pieces)

    def _expanded(self, u: Ball, count: int) -> tuple[list[Ball], list[Ball]]:
        """Return the coefficients of the arc length from u on, and of u by it."""
        zero, one = exactly([0.0, 1.0])
        start = (np.array([x]) for x in (u, one, *[zero] * (count - 2)))
        arc = self._path.speed(series(*start)).item().integral()
        ahead, back = ([x[k].mid() for k in range(count)] for x in (arc, arc.reversion()))
        return ahead, back

    def frame(self, s: Balls) -> Balls:
        if self.closed and len(s):
            laps = np.floor(floats(coefficient(s, 0)) / self._near[-1])
            s = s - exactly(laps) * self.length
        near = floats(coefficient(s, 0))
        panel = np.searchsorted(self._near, near, side="right") - 1
        panel = np.clip(panel, 0, len(self._pieces) - 1)
        u = _value(self._pieces[panel].T, s - self._starts[panel])
        point, rate = self._path.at(np.asarray(u))
        tangent = rate / _length(rate)[:, None]
        return np.stack([tangent, np.cross(point, tangent), point], axis=-1)


def _reach(coefficients: list[Ball], digits: int) -> float:
    """Return how far from its centre a series has all digits, from its last terms."""
    count = len(coefficients)
    sizes = np.abs(floats(np.array(coefficients[-4:])))
    powers = np.arange(count - 4, count)
    with np.errstate(divide="ignore"):
        logs = -(digits * np.log(2.0) + np.log(sizes)) / powers
    return float(np.exp(np.min(logs)) * 0.9)


def _value(coefficients: Any, x: Any) -> Any:
    """Return a power series at x, by Horner's rule; both may be arrays."""
    total = coefficients[-1] + 0 * x
    for number in coefficients[-2::-1]:
        total = total * x + number
    return total


@final
class _Fourier(_Path):
    """A colatitude about the third of `axes`; its parameter is the azimuth."""

    def __init__(
        self, axes: Balls, cosines: tuple[float, ...], sines: tuple[float, ...]
    ) -> None:
        self._axes = axes
        self._even, self._odd = exactly(cosines), exactly(sines)
        self.edges = exactly([0.0, 2.0]) * pi()

    def at(self, u: Balls) -> tuple[Balls, Balls]:
        colatitude, slope = 0 * u, 0 * u
        for amplitudes, derived in ((self._even, 1), (self._odd, 0)):
            for wave, size in enumerate(amplitudes):
                two = sine_cosine(wave * u)
                colatitude = colatitude + size * two[derived]
                slope = slope + (wave * (1 - 2 * derived) * size) * two[1 - derived]
        (sine, cosine), (s, c) = (
            (np.asarray(x)[:, None] for x in sine_cosine(angle))
            for angle in (colatitude, u)
        )
        x, y, z = self._axes
        outward, along = c * x + s * y, c * y - s * x
        away = cosine * outward - sine * z
        return cosine * z + sine * outward, slope[:, None] * away + sine * along


@final
class _Spline(_Path):
    """The radial projection of a quintic spline in space."""

    def __init__(self, path: SplinePath) -> None:
        self._path, self.edges = path, exactly(path.knots)
        degree, control = int(path.spline.k), exactly(path.spline.c)  # type: ignore[union-attr]
        self._float_knots: Floats = path.spline.t  # type: ignore[union-attr]
        self._knots = knots = exactly(self._float_knots)
        width = knots[degree + 1 : degree + len(control)] - knots[1 : len(control)]
        slopes = degree * (control[1:] - control[:-1]) / width[:, None]
        self._levels = (degree, knots, control), (degree - 1, knots[1:-1], slopes)

    def at(self, u: Balls) -> tuple[Balls, Balls]:
        knots = self._path.knots
        span = np.searchsorted(knots, floats(coefficient(u, 0)), side="right") - 1
        span = np.clip(span, 0, len(knots) - 2)
        span = np.searchsorted(self._float_knots, knots[span], side="right") - 1
        x, rate = (
            self._combined(u[:, None], span - k, *level)
            for k, level in enumerate(self._levels)
        )
        size = _length(x)[:, None]
        point = x / size
        outward = np.sum(point * rate, axis=1, keepdims=True)
        return point, (rate - outward * point) / size

    def _combined(
        self, u: Balls, span: Any, degree: int, knots: Balls, control: Balls
    ) -> Balls:
        """Return a spline of a degree at u (n, 1) in spans (n,) by de Boor's algorithm."""
        points = [control[span - degree + r] for r in range(degree + 1)]
        for level in range(1, degree + 1):
            for r in reversed(range(level, degree + 1)):
                i = span - degree + r
                low, high = knots[i][:, None], knots[i + degree + 1 - level][:, None]
                share = (u - low) / (high - low)
                points[r] = (1 - share) * points[r - 1] + share * points[r]
        return np.asarray(points[degree])


def _length(vectors: Balls) -> Balls:
    """Return lengths (n,) of vectors (n, 3)."""
    return np.asarray(square_root(np.sum(vectors * vectors, axis=1)))
