"""Smooth curves on the unit sphere by arc length: the profiles of contact pairs.

A curve turns left where its geodesic curvature k is positive. Its frame, with the
tangent t, the point p and n = p x t, obeys dp/ds = t, dt/ds = k n - p, dn/ds = -k t.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats
from spherekit.conventions import EPS
from spherekit.sphere.paths import (
    FEWEST_POINTS,
    SLOWEST,
    UNIT_TOLERANCE,
    ArcLength,
    FourierPath,
    Path,
    SplinePath,
    axes_about,
    check_colatitude,
    check_simple,
    checked_points,
    exact_frame,
    measure,
    quintic,
    turned,
)
from spherekit.sphere.rotation import all_finite, arc, slope_of, stepped

__all__ = [
    "FEWEST_POINTS",
    "SLOWEST",
    "UNIT_TOLERANCE",
    "Bools",
    "Curve",
    "CurvePoint",
    "circle",
    "fourier",
    "great_circle",
    "through",
]


_REFITS = 4


@dataclass(frozen=True)
class CurvePoint:
    """A curve at n arc lengths.

    `frame` (n, 3, 3) has the columns t, n = p x t, p; `curvature` k (n,) is geodesic and
    `curvature_rate` (n,) is dk/ds. `inside` (n,) is False where the arc length runs off
    the end of an open curve; the values there are those of that end. An arc length that
    is not finite gives NaN and is not inside.
    """

    frame: Floats
    curvature: Floats
    curvature_rate: Floats
    inside: Bools


class Curve(ABC):
    """A curve on the unit sphere with its `length` (rad), `closed` or open."""

    length: float
    closed: bool

    @property
    @abstractmethod
    def edges(self) -> Floats:
        """Arc lengths (k,) from 0 to `length`, between which the curve is analytic."""

    @abstractmethod
    def at(self, s: ArrayLike) -> CurvePoint:
        """Return the curve at arc lengths s (n,) in rad; a closed one repeats itself."""

    @abstractmethod
    def curvature_second(self, s: ArrayLike) -> Floats:
        """Return the second derivative (n,) of the curvature by the arc length."""

    @abstractmethod
    def reversed(self) -> "Curve":
        """Return the same curve run backwards.

        A closed one keeps its point at s = 0 and has -s for s, an open one starts at the
        old end. t, n and k change sign, dk/ds does not.
        """


def circle(centre: ArrayLike, radius: float) -> Curve:
    """Return the circle of angular `radius` (rad, 0 to pi) about a unit vector (3,).

    It runs counter-clockwise about its centre, which lies on the side of +n: its
    geodesic curvature is cot(radius).

    Raises
    ------
    ValueError
        If the centre is not a unit vector or the radius is not between 0 and pi.
    """
    if not 0.0 < radius < np.pi:
        raise ValueError(
            f"the radius is {np.rad2deg(radius):.6g} deg; it has to lie between 0 and 180 "
            "deg, both excluded"
        )
    sine, cosine = float(np.sin(radius)), float(np.cos(radius))
    return _Circle(axes_about(centre), sine, cosine, 2.0 * np.pi * sine)


def great_circle(centre: ArrayLike) -> Curve:
    """Return the great circle, counter-clockwise about its pole, a unit vector (3,).

    Raises
    ------
    ValueError
        If the pole is not a unit vector.
    """
    return _Circle(axes_about(centre), 1.0, 0.0, 2.0 * np.pi)


def fourier(centre: ArrayLike, cosines: ArrayLike, sines: ArrayLike = ()) -> Curve:
    """Return the closed curve whose colatitude about a centre is a Fourier series.

    At azimuth a the colatitude is ``sum cosines[k] cos(k a) + sines[k] sin(k a)`` (rad).
    The azimuth runs counter-clockwise about the unit vector `centre` (3,), from the
    projection of the x axis, or of the y axis if ``abs(centre[0]) > 0.9``; s = 0 is at
    azimuth 0. Such a curve never meets itself.

    Raises
    ------
    ValueError
        If the centre is not a unit vector, the colatitude leaves (0, pi), or the curve
        has a cusp (it can come to one only where it almost reaches an axis).
    """
    even, odd = (
        np.ravel(np.array(coefficients, dtype=float)) for coefficients in (cosines, sines)
    )
    size = max(len(even), len(odd), 1)
    series = np.zeros((2, size))
    series[0, : len(even)], series[1, : len(odd)] = even, odd
    if not all_finite(series):
        raise ValueError("the coefficients of the colatitude have to be finite")
    path = FourierPath(axes_about(centre), series[0], series[1])
    check_colatitude(path)
    table = measure(path, azimuth_panels(size))
    return _Measured(path, table, table.length, closed=True)


def azimuth_panels(size: int) -> Floats:
    """Return the azimuths between which a series of so many terms is smooth enough."""
    return np.linspace(0.0, 2.0 * np.pi, 4 * size + 1)


def through(points: ArrayLike, closed: bool = True) -> Curve:
    """Return the smooth curve through unit vectors (m, 3) in their order.

    It is the radial projection of an interpolating quintic spline whose parameter is
    its own arc length to high order: k has two continuous derivatives in s, also where
    a closed curve returns to its first point, which is at s = 0 and not repeated.

    Raises
    ------
    ValueError
        If there are fewer than 6 points, one is not a unit vector, two in succession
        coincide or lie 90 degrees or more apart, the last of a closed curve repeats the
        first, or the curve has a cusp or, closed, meets itself.
    """
    path, table = spline_through(points, closed)
    if closed:
        check_simple(path)
    return _Measured(path, table, table.length, closed)


def spline_through(points: ArrayLike, closed: bool) -> tuple[SplinePath, ArcLength]:
    """Return the spline of `through` and the table of its arc length; errors as there."""
    *_, last = spline_fits(points, closed)
    return last


def spline_fits(points: ArrayLike, closed: bool) -> Iterator[tuple[SplinePath, ArcLength]]:
    """Yield the splines that lead to `spline_through`, the knots of each by the last."""
    given = checked_points(points, closed)
    steps = arc(given[:-1], given[1:])
    for _ in range(1 + _REFITS):
        knots = np.concatenate([[0.0], np.cumsum(steps)])
        path = SplinePath(quintic(knots, given, closed), knots, closed)
        table = measure(path, knots)
        yield path, table
        steps = np.diff(table.at_edge(knots))


@dataclass(frozen=True)
class _Circle(Curve):
    """A circle about the third column of `axes`; sine and cosine of its radius."""

    axes: Floats
    sine: float
    cosine: float
    length: float
    closed: bool = True

    @property
    def edges(self) -> Floats:
        return np.array([0.0, self.length])

    def at(self, s: ArrayLike) -> CurvePoint:
        arcs, inside = _into(np.asarray(s, dtype=float), self.length, closed=True)
        outward, along = turned(self.axes, arcs / self.sine)
        point = (self.cosine * self.axes[:, 2, None] + self.sine * outward.T).T
        one = np.where(inside, 1.0, np.nan)
        return CurvePoint(
            exact_frame(point, along), self.cosine / self.sine * one, 0.0 * one, inside
        )

    def curvature_second(self, s: ArrayLike) -> Floats:
        return 0.0 * np.asarray(s, dtype=float)

    def reversed(self) -> Curve:
        return _Reversed(self, self.length, self.closed)


@dataclass(frozen=True)
class _Reversed(Curve):
    """A curve run backwards."""

    forward: Curve
    length: float
    closed: bool

    @property
    def edges(self) -> Floats:
        return self.length - self.forward.edges[::-1]

    def _back(self, s: ArrayLike) -> Floats:
        back = -np.asarray(s, dtype=float)
        return back if self.closed else self.length + back

    def at(self, s: ArrayLike) -> CurvePoint:
        there = self.forward.at(self._back(s))
        return CurvePoint(
            there.frame * np.array([-1.0, -1.0, 1.0]),
            0.0 - there.curvature,
            there.curvature_rate,
            there.inside,
        )

    def curvature_second(self, s: ArrayLike) -> Floats:
        return 0.0 - self.forward.curvature_second(self._back(s))

    def reversed(self) -> Curve:
        return self.forward


@dataclass(frozen=True)
class _Measured(Curve):
    """A curve in its own parameter, with the table of its arc length."""

    path: Path
    table: ArcLength
    length: float
    closed: bool

    @property
    def edges(self) -> Floats:
        return self.table.starts

    def at(self, s: ArrayLike) -> CurvePoint:
        arcs, inside = _into(np.asarray(s, dtype=float), self.length, self.closed)
        return CurvePoint(*self.path.frame(self.table.invert(arcs)), inside)

    def curvature_second(self, s: ArrayLike) -> Floats:
        arcs, _ = _into(np.asarray(s, dtype=float), self.length, self.closed)
        u = self.table.invert(arcs)
        _, _, rate = self.path.frame(stepped(u, 1.0 / self.path.speed(u)))
        return slope_of(rate)

    def reversed(self) -> Curve:
        return _Reversed(self, self.length, self.closed)


def _into(s: Floats, length: float, closed: bool) -> tuple[Floats, Bools]:
    """Return arc lengths (n,) brought into 0 to `length`, and whether they belong."""
    finite = np.isfinite(s)
    if closed:
        return np.mod(np.where(finite, s, np.nan), length), finite
    slack = 4.0 * EPS * length
    inside = (s >= -slack) & (s <= length + slack)
    return np.clip(np.where(finite, s, np.nan), 0.0, length), inside
