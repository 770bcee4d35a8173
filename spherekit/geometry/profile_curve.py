"""Smooth curves on the unit sphere by arc length: the profiles of contact pairs.

A curve turns left where its geodesic curvature k is positive. Its frame, with the
tangent t, the point p and n = p x t, obeys dp/ds = t, dt/ds = k n - p, dn/ds = -k t.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats
from spherekit.geometry.arc_length import ArcLength, measure
from spherekit.geometry.parametric_curve import (
    CirclePath,
    FourierPath,
    Path,
    SplinePath,
    axes_about,
    quintic,
)
from spherekit.geometry.profile_checks import check_colatitude, check_simple, checked_points
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import all_finite
from spherekit.numerics.complex_step import add_complex_step, extract_derivative
from spherekit.tolerances import EPS

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


@dataclass(frozen=True)
class Curve:
    """A curve on the unit sphere with its `length` (rad), `closed` or open.

    `table` is the arc length of its `path`, None where the parameter is that. A curve run
    `backwards` keeps its point at s = 0 and has -s for s where it is closed, an open one
    starts at the old end. t, n and k change sign, dk/ds does not.
    """

    path: Path
    table: ArcLength | None
    length: float
    closed: bool
    backwards: bool = False

    @property
    def edges(self) -> Floats:
        """Arc lengths (k,) from 0 to `length`, between which the curve is analytic."""
        starts = np.array([0.0, self.length]) if self.table is None else self.table.starts
        return self.length - starts[::-1] if self.backwards else starts

    def _parameter(self, s: ArrayLike) -> tuple[Floats, Bools]:
        """Return the parameters (n,) at arc lengths (n,), and whether these belong."""
        arcs = np.asarray(s, dtype=float)
        if self.backwards:
            arcs = (0.0 if self.closed else self.length) - arcs
        inside = np.isfinite(arcs)
        arcs = np.where(inside, arcs, np.nan)
        if self.closed:
            arcs = np.mod(arcs, self.length)
        else:
            slack = 4.0 * EPS * self.length
            inside = (arcs >= -slack) & (arcs <= self.length + slack)
            arcs = np.clip(arcs, 0.0, self.length)
        return arcs if self.table is None else self.table.invert(arcs), inside

    def at(self, s: ArrayLike) -> CurvePoint:
        """Return the curve at arc lengths s (n,) in rad; a closed one repeats itself."""
        u, inside = self._parameter(s)
        frame, curvature, rate = self.path.frame(u)
        if self.backwards:
            frame = frame * [-1.0, -1.0, 1.0]
            curvature = 0.0 - curvature
        return CurvePoint(frame, curvature, rate, inside)

    def curvature_second(self, s: ArrayLike) -> Floats:
        """Return the second derivative (n,) of the curvature by the arc length."""
        u, _ = self._parameter(s)
        _, _, rate = self.path.frame(add_complex_step(u, 1.0 / self.path.speed(u)))
        return -extract_derivative(rate) if self.backwards else extract_derivative(rate)

    def reversed(self) -> "Curve":
        """Return the same curve run backwards."""
        return replace(self, backwards=not self.backwards)


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
    sine = float(np.sin(radius))
    return Curve(
        CirclePath(axes_about(centre), sine, float(np.cos(radius))),
        None,
        2.0 * np.pi * sine,
        closed=True,
    )


def great_circle(centre: ArrayLike) -> Curve:
    """Return the great circle, counter-clockwise about its pole, a unit vector (3,).

    Raises
    ------
    ValueError
        If the pole is not a unit vector.
    """
    return Curve(CirclePath(axes_about(centre), 1.0, 0.0), None, 2.0 * np.pi, closed=True)


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
    series[0, : len(even)] = even
    series[1, : len(odd)] = odd
    if not all_finite(series):
        raise ValueError("the coefficients of the colatitude have to be finite")
    path = FourierPath(axes_about(centre), *series)
    check_colatitude(path)
    table = measure(path, azimuth_panels(size))
    return Curve(path, table, table.length, closed=True)


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
    return Curve(path, table, table.length, closed)


def spline_through(points: ArrayLike, closed: bool) -> tuple[SplinePath, ArcLength]:
    """Return the spline of `through` and the table of its arc length; errors as there."""
    *_, last = spline_fits(points, closed)
    return last


def spline_fits(points: ArrayLike, closed: bool) -> Iterator[tuple[SplinePath, ArcLength]]:
    """Yield the splines that lead to `spline_through`, the knots of each by the last."""
    given = checked_points(points, closed)
    steps = arc(given[:-1], given[1:])
    for _ in range(1 + _REFITS):
        knots = np.append(0.0, np.cumsum(steps))
        path = SplinePath(quintic(knots, given, closed), knots, closed)
        table = measure(path, knots)
        yield path, table
        steps = np.diff(table.at_edge(knots))
