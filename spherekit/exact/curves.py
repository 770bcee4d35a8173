"""Profiles of contact pairs as a mechanism declares them, in any arithmetic.

Angles, radii and coefficients are taken as the float64 numbers they are given by, and
directions are made unit vectors in the arithmetic. A profile through points is the
quintic spline that `spherekit.sphere.profile` lays through them: its float64 knots and
coefficients are what is declared. No curvature occurs here: curves give places and
tangents only, and their derivatives are those of power series.
"""

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import TYPE_CHECKING, cast, final

import numpy as np

from spherekit.exact.arcs import ArcTable
from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.series import cosine_sine, cross, dot, product, quotient, root
from spherekit.model.parts import Profile
from spherekit.sphere.paths import SplinePath
from spherekit.sphere.profile import spline_through
from spherekit.sphere.rotation import Floats

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


class ExactCurve(ABC):
    """A curve on the unit sphere by its arc length."""

    @abstractmethod
    def frame(self, s: Numbers) -> Numbers:
        """Return frames (k, n, 3, 3), columns t, n = p x t, p, at series s (k, n), rad."""


def exact_curve(arithmetic: Arithmetic, profile: Profile, backwards: bool) -> ExactCurve:
    """Return the curve of a profile, run backwards if so."""
    curve = _forward(arithmetic, profile)
    return _Backwards(curve) if backwards else curve


@lru_cache(maxsize=32)
def _forward(arithmetic: Arithmetic, profile: Profile) -> "_Circle | _Measured":
    if profile.kind == "points":
        path, _ = spline_through(np.array(profile.points), profile.closed)
        return _Measured(arithmetic, _Spline(path), profile.closed)
    axes = _axes_about(arithmetic, np.array(profile.centre))
    if profile.kind == "circle":
        radius = arithmetic.exact(float(profile.radius or 0.0))
        return _Circle(arithmetic, axes, *arithmetic.cosine_sine(radius))
    if profile.kind == "great_circle":
        return _Circle(arithmetic, axes, arithmetic.zeros(), arithmetic.exact(1.0))
    fourier = _Fourier(axes, profile.cosines, profile.sines)
    return _Measured(arithmetic, fourier, closed=True)


@final
class _Circle(ExactCurve):
    """A circle about the third column of `axes` with the cosine and sine of its radius."""

    def __init__(
        self, arithmetic: Arithmetic, axes: Numbers, cosine: Numbers, sine: Numbers
    ) -> None:
        self._arithmetic, self._axes = arithmetic, axes
        self._cosine, self._sine = cosine, sine
        self.length = 2 * arithmetic.pi() * sine
        self.closed = True

    def frame(self, s: Numbers) -> Numbers:
        outward, along = _turned(self._arithmetic, self._axes, s / self._sine)
        centre = _constant(self._axes[:, 2], s)
        point = centre * self._cosine + outward * self._sine
        normal = centre * self._sine - outward * self._cosine
        return np.stack([along, normal, point], axis=-1)


@final
class _Measured(ExactCurve):
    """A curve in a parameter of its own, with the table of its arc length."""

    def __init__(
        self, arithmetic: Arithmetic, path: "_Fourier | _Spline", closed: bool
    ) -> None:
        self._arithmetic, self._path = arithmetic, path
        self._table = ArcTable(arithmetic, path)
        self.length = self._table.length
        self.closed = closed

    def frame(self, s: Numbers) -> Numbers:
        arithmetic = self._arithmetic
        first = s[0]
        if self.closed:
            whole = float(arithmetic.floats(np.asarray(self.length)))
            laps = np.floor(arithmetic.floats(first) / whole)
            first = first - arithmetic.exact(laps) * self.length
        u = self._table.parameters(first)[None]
        for k in range(1, len(s)):
            speed = self._path.speed(arithmetic, u)
            rate = np.stack([(j + 1) * s[j + 1] for j in range(k)])
            u = np.concatenate([u, quotient(rate, speed)[-1:] / k])
        point, rate = self._path.at(arithmetic, u)
        size = root(arithmetic, dot(rate, rate))
        tangent = quotient(rate, np.repeat(size[..., None], 3, axis=-1))
        return np.stack([tangent, cross(point, tangent), point], axis=-1)


@final
class _Backwards(ExactCurve):
    """A curve run backwards: from its old end, or a closed one from the same place."""

    def __init__(self, forward: "_Circle | _Measured") -> None:
        self._forward = forward

    def frame(self, s: Numbers) -> Numbers:
        back = -s
        if not self._forward.closed:
            back[0] = back[0] + self._forward.length
        tangent, normal, point = np.moveaxis(self._forward.frame(back), -1, 0)
        return np.stack([-tangent, -normal, point], axis=-1)


@final
class _Fourier:
    """A colatitude about the third column of `axes`; its parameter is the azimuth."""

    def __init__(
        self, axes: Numbers, cosines: tuple[float, ...], sines: tuple[float, ...]
    ) -> None:
        self._axes, self._cosines, self._sines = axes, cosines, sines

    def at(self, arithmetic: Arithmetic, u: Numbers) -> tuple[Numbers, Numbers]:
        colatitude, slope = self._colatitude(arithmetic, u)
        cosine, sine = (x[..., None] for x in cosine_sine(arithmetic, colatitude))
        outward, along = _turned(arithmetic, self._axes, u)
        centre = _constant(self._axes[:, 2], u)
        point = product(cosine, centre) + product(sine, outward)
        away = product(cosine, outward) - product(sine, centre)
        return point, product(slope[..., None], away) + product(sine, along)

    def edges(self, arithmetic: Arithmetic) -> Numbers:
        """Return the parameters of panels as long as a quarter of the shortest wave."""
        count = 4 * max(len(self._cosines), len(self._sines), 1)
        share = arithmetic.exact(np.arange(count + 1.0)) / count
        return np.asarray(share * (2 * arithmetic.pi()))

    def speed(self, arithmetic: Arithmetic, u: Numbers) -> Numbers:
        """Return |dp/du|, a series (k, n)."""
        colatitude, slope = self._colatitude(arithmetic, u)
        _, sine = cosine_sine(arithmetic, colatitude)
        return root(arithmetic, product(slope, slope) + product(sine, sine))

    def _colatitude(self, arithmetic: Arithmetic, u: Numbers) -> tuple[Numbers, Numbers]:
        """Return the colatitude and its derivative by the azimuth, series (k, n)."""
        size = max(len(self._cosines), len(self._sines))
        even = np.zeros(size)
        odd = np.zeros(size)
        even[: len(self._cosines)], odd[: len(self._sines)] = self._cosines, self._sines
        even, odd = arithmetic.exact(even), arithmetic.exact(odd)
        c1, s1 = cosine_sine(arithmetic, u)
        c, s = c1, s1
        total = _constant(even[:1], u)[..., 0]
        slope = 0 * total
        for k in range(1, size):
            if k > 1:
                c, s = product(c, c1) - product(s, s1), product(s, c1) + product(c, s1)
            total = total + c * even[k] + s * odd[k]
            slope = slope + k * (c * odd[k] - s * even[k])
        return total, slope


@final
class _Spline:
    """The radial projection of a quintic spline in space."""

    def __init__(self, path: SplinePath) -> None:
        self._path = path
        self._pieces: dict[str, Numbers] = {}

    def at(self, arithmetic: Arithmetic, u: Numbers) -> tuple[Numbers, Numbers]:
        x, rate = self._space(arithmetic, u)
        size = root(arithmetic, dot(x, x))
        wide = np.repeat(size[..., None], 3, axis=-1)
        point = quotient(x, wide)
        outward = dot(point, rate)
        return point, quotient(rate - product(outward[..., None], point), wide)

    def edges(self, arithmetic: Arithmetic) -> Numbers:
        """Return the knots."""
        return arithmetic.exact(self._path.knots)

    def speed(self, arithmetic: Arithmetic, u: Numbers) -> Numbers:
        """Return |dp/du|, a series (k, n)."""
        _, rate = self.at(arithmetic, u)
        return root(arithmetic, dot(rate, rate))

    def _space(self, arithmetic: Arithmetic, u: Numbers) -> tuple[Numbers, Numbers]:
        """Return the spline in space and its derivative, series (k, n, 3)."""
        if arithmetic.name not in self._pieces:
            self._pieces[arithmetic.name] = _pieces(arithmetic, self._path)
        pieces = self._pieces[arithmetic.name]
        knots = self._path.knots
        span = np.searchsorted(knots, arithmetic.floats(u[0]), side="right") - 1
        span = np.clip(span, 0, len(knots) - 2)
        h = u.copy()
        h[0] = u[0] - arithmetic.exact(knots)[span]
        h = h[..., None]
        coefficients = pieces[span]
        degree = coefficients.shape[1] - 1
        x = _constant(coefficients[:, degree], u)
        rate = _constant(degree * coefficients[:, degree], u)
        for power in reversed(range(degree)):
            x = product(x, h)
            x[0] = x[0] + coefficients[:, power]
            if power:
                rate = product(rate, h)
                rate[0] = rate[0] + power * coefficients[:, power]
        return x, rate


def _pieces(arithmetic: Arithmetic, path: SplinePath) -> Numbers:
    """Return (spans, degree + 1, 3): the spline in powers of u from each knot on."""
    spline = cast("BSpline", path.spline)
    degree = int(spline.k)
    every, control = arithmetic.exact(spline.t), arithmetic.exact(spline.c)
    span = np.searchsorted(spline.t, path.knots[:-1], side="right") - 1
    start = arithmetic.exact(path.knots[:-1])
    pieces, factor = [], 1
    for order in range(degree + 1):
        rest = degree - order
        knots = every[order : len(every) - order]
        at = span - order
        points = [control[at - rest + r] for r in range(rest + 1)]
        for level in range(1, rest + 1):
            for r in reversed(range(level, rest + 1)):
                i = at - rest + r
                share = (start - knots[i]) / (knots[i + rest + 1 - level] - knots[i])
                share = share[:, None]
                points[r] = (1 - share) * points[r - 1] + share * points[r]
        pieces.append(points[rest] / factor)
        factor *= order + 1
        if rest:
            count = len(control) - 1
            width = knots[rest + 1 : rest + 1 + count] - knots[1 : 1 + count]
            control = rest * (control[1:] - control[:-1]) / width[:, None]
    return np.stack(pieces, axis=1)


def _turned(
    arithmetic: Arithmetic, axes: Numbers, azimuth: Numbers
) -> tuple[Numbers, Numbers]:
    """Return the unit vectors (k, n, 3) at right angles to the third axis: out, onward."""
    c, s = (x[..., None] for x in cosine_sine(arithmetic, azimuth))
    return c * axes[:, 0] + s * axes[:, 1], c * axes[:, 1] - s * axes[:, 0]


def _constant(vectors: Numbers, like: Numbers) -> Numbers:
    """Return a series (k, n, m) of constants (m,) or (n, m) for one (k, n)."""
    shape = (*like.shape[1:], vectors.shape[-1])
    first = np.broadcast_to(vectors, shape)[None]
    return np.concatenate([first, *[0 * first] * (len(like) - 1)])


def unit(arithmetic: Arithmetic, vector: Floats) -> Numbers:
    """Return the unit vector (3,) along a float64 vector."""
    given = arithmetic.exact(vector)
    return np.asarray(given / arithmetic.root(np.sum(given * given)))


def _axes_about(arithmetic: Arithmetic, centre: Floats) -> Numbers:
    """Return axes (3, 3): columns towards azimuth 0 and 90 degrees, and the centre."""
    third = unit(arithmetic, centre)
    toward = np.eye(3)[1 if abs(centre[0]) > 0.9 * np.linalg.norm(centre) else 0]
    first = arithmetic.exact(toward)
    first = first - np.sum(first * third) * third
    first = first / arithmetic.root(np.sum(first * first))
    (second,) = cross(third[None, None], first[None, None])[0]
    return np.stack([first, second, third], axis=1)
