"""Smooth curves on the unit sphere: the profiles of contact pairs.

A curve is a function of its arc length. The frame of a curve has the columns t, n = p x t
and p, where p is the point and t the tangent. Its derivatives with respect to the arc
length s are dp/ds = t, dt/ds = k n - p and dn/ds = -k t. The geodesic curvature k is
positive where the curve turns left.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats
from spherekit.geometry.arc_length import ArcLength, measure_arc_length
from spherekit.geometry.parametric_curve import (
    CirclePath,
    FourierPath,
    Path,
    SplinePath,
    axes_about,
    quintic,
)
from spherekit.geometry.profile_checks import (
    check_colatitude,
    check_no_self_intersection,
    normalised_points,
)
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import all_finite
from spherekit.numerics.complex_step import add_complex_step, extract_derivative
from spherekit.tolerances import PROFILE_END_ROUNDING

SPLINE_REFITS = 4
"""Number of times a spline is fitted again, with knots at the arc lengths of the last fit.

The first knots are sums of the arcs between the points. Larger: the parameter is closer to
the arc length. Smaller: curvatures between unevenly spaced points vary more. The number is
part of the meaning of files.
"""


@dataclass(frozen=True)
class CurvePoint:
    """Points of a curve on the unit sphere at m arc lengths s, with frames and curvatures.

    p is the point of the curve, and t the unit tangent there.

    Attributes
    ----------
    frame
        (m, 3, 3) frames with the columns t, n = p x t and p.
    curvature
        (m,) geodesic curvatures k, positive where the curve turns left.
    curvature_rate
        (m,) derivatives dk/ds with respect to arc length.
    inside
        (m,) whether the arc length belongs to the curve. Beyond the end of an open curve
        the other fields have their values at the end. For an arc length that is not finite
        the other fields are NaN.
    """

    frame: Floats
    curvature: Floats
    curvature_rate: Floats
    inside: Bools


@dataclass(frozen=True)
class Curve:
    """A curve on the unit sphere as a function of its arc length.

    Attributes
    ----------
    path
        The same curve as a function of its own parameter, such as the azimuth.
    table
        Arc length of the path as a function of its parameter; None if they are the same.
    length
        The whole arc length (rad).
    closed
        Whether the curve is closed.
    backwards
        Whether the curve runs against its path. A closed curve then starts at the same
        point, and an open one at the other end. The tangent, the normal and the geodesic
        curvature change their signs; the derivative of the curvature with respect to arc
        length does not.
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

    def _find_parameters(self, s: ArrayLike) -> tuple[Floats, Bools]:
        """Return the parameters of the path at arc lengths s (n,), rad, of the curve.

        The path is the same curve as a function of its own parameter, such as the azimuth.
        A curve may run backwards, against its path. An open backwards curve starts at the
        end of the path, a closed one at the start of the path.

        Returns
        -------
        parameters
            (n,) parameters of the path. Beyond an end of an open curve, the parameter is
            that of the end. For an arc length that is not finite, the parameter is NaN.
        inside
            (n,) whether the arc length is finite and not beyond an end of an open curve.
        """
        # `path_length` is the arc length on the path, from the start of the path.
        path_length = np.asarray(s, dtype=float)
        if self.backwards:
            path_length = (0.0 if self.closed else self.length) - path_length
        inside = np.isfinite(path_length)
        path_length = np.where(inside, path_length, np.nan)
        if self.closed:
            path_length = np.mod(path_length, self.length)
        else:
            slack = PROFILE_END_ROUNDING * self.length
            inside = (path_length >= -slack) & (path_length <= self.length + slack)
            path_length = np.clip(path_length, 0.0, self.length)
        # `table` has the arc length as a function of the parameter. Without a table, the
        # parameter is the arc length.
        u = path_length if self.table is None else self.table.invert(path_length)
        return u, inside

    def evaluate(self, s: ArrayLike) -> CurvePoint:
        """Return the curve at arc lengths s (n,), rad; a closed curve is periodic."""
        u, inside = self._find_parameters(s)
        frames = self.path.frames(u)
        frame = frames.frame
        curvature = frames.curvature
        if self.backwards:
            frame = frame * [-1.0, -1.0, 1.0]
            curvature = 0.0 - curvature  # without negative zeros
        return CurvePoint(frame, curvature, frames.curvature_rate, inside)

    def curvature_second(self, s: ArrayLike) -> Floats:
        """Return the second derivatives (n,) d2k/ds2 of the curvature k at s (n,)."""
        u, _ = self._find_parameters(s)
        frames = self.path.frames(add_complex_step(u, 1.0 / self.path.speed(u)))
        derivative = extract_derivative(frames.curvature_rate)
        return -derivative if self.backwards else derivative

    def reversed(self) -> "Curve":
        """Return the same curve run backwards."""
        return replace(self, backwards=not self.backwards)


def circle(centre: ArrayLike, radius: float) -> Curve:
    """Return a circle, which runs counter-clockwise about its centre.

    Its geodesic curvature is cot(radius): positive for radii below 90 degrees, where the
    circle turns left. The normal n = p x t, with the point p and the tangent t, points to
    the side of the centre.

    Parameters
    ----------
    centre
        (3,) unit vector.
    radius
        Angular radius (rad), between 0 and pi.

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
    path = CirclePath(axes_about(centre), sine, float(np.cos(radius)))
    # The parameter of a circle is its arc length, so there is no table of arc lengths.
    return Curve(path, table=None, length=2.0 * np.pi * sine, closed=True)


def great_circle(centre: ArrayLike) -> Curve:
    """Return the great circle that runs counter-clockwise about a unit vector (3,).

    Raises
    ------
    ValueError
        If the centre is not a unit vector.
    """
    path = CirclePath(axes_about(centre), sine=1.0, cosine=0.0)
    return Curve(path, table=None, length=2.0 * np.pi, closed=True)


def fourier(centre: ArrayLike, cosines: ArrayLike, sines: ArrayLike = ()) -> Curve:
    """Return a closed curve from the Fourier series of its colatitude.

    The colatitude (angle from the centre) at the azimuth a is the sum of cosines[k] cos(k
    a) + sines[k] sin(k a). The azimuth runs counter-clockwise about the centre, as
    `axes_about` defines it. The arc length s is 0 at azimuth 0. The curve has one point at
    each azimuth, so it never meets itself.

    Parameters
    ----------
    centre
        (3,) unit vector.
    cosines, sines
        Coefficients (rad); `sines[0]` has no effect.

    Raises
    ------
    ValueError
        If the centre is not a unit vector, a coefficient is not finite, or the colatitude
        leaves (0, pi). If the colatitude comes so near to 0 or pi that the curve has
        practically a cusp: its speed is less than `MIN_SPEED_RATIO` times its mean speed.
    """
    # Both series get the same number of orders, padded with zeros.
    cosines = np.ravel(np.array(cosines, dtype=float))
    sines = np.ravel(np.array(sines, dtype=float))
    order_count = max(len(cosines), len(sines), 1)
    series = np.zeros((2, order_count))
    series[0, : len(cosines)] = cosines
    series[1, : len(sines)] = sines
    if not all_finite(series):
        raise ValueError("the coefficients of the colatitude have to be finite")
    path = FourierPath(axes_about(centre), *series)
    check_colatitude(path)
    table = measure_arc_length(path, azimuth_panels(order_count))
    return Curve(path, table, table.length, closed=True)


def azimuth_panels(order_count: int) -> Floats:
    """Return azimuths (rad) that divide a turn into panels for an integral of the azimuth.

    The integrand, such as the speed along a curve, depends on a Fourier series of the
    azimuth with `order_count` orders, from 0 on. There are four panels for each order. In a
    panel even the highest order varies by less than a quarter of its period, so a short
    series describes the integrand there.
    """
    return np.linspace(0.0, 2.0 * np.pi, 4 * order_count + 1)


def through(points: ArrayLike, closed: bool = True) -> Curve:
    """Return the smooth curve through points in their order.

    The curve is the radial projection of a quintic spline through the points. The parameter
    of the spline is nearly the arc length s. The geodesic curvature has two continuous
    derivatives with respect to s, also at the first point of a closed curve. Open curves
    may meet themselves.

    Parameters
    ----------
    points
        (m, 3) unit vectors, at least 6 for a quintic spline. The first one is not repeated
        at the end of a closed curve.
    closed
        Whether the curve returns to its first point.

    Raises
    ------
    ValueError
        If there are fewer than 6 points, or one is not a unit vector. If two successive
        points coincide or are 90 degrees or more apart. If the last point of a closed curve
        repeats the first. If the curve has a cusp, or a closed curve meets itself.
    """
    path, table = spline_through(points, closed)
    if closed:
        check_no_self_intersection(path)
    return Curve(path, table, length=table.length, closed=closed)


def spline_through(points: ArrayLike, closed: bool) -> tuple[SplinePath, ArcLength]:
    """Return the spline curve through points, and its arc length.

    A closed curve may meet itself. All other errors of `through` are raised.
    """
    *_, last_fit = spline_fits(points, closed)
    return last_fit


def spline_fits(points: ArrayLike, closed: bool) -> Iterator[tuple[SplinePath, ArcLength]]:
    """Yield splines through the same points, each with its arc length.

    The last spline is the smooth curve through the points (`spline_through`). A caller that
    differentiates the curve with respect to the points needs all splines. The reason is
    that the points also move the knots of the last spline, which follow from the splines
    before.

    Knots are the parameters of a spline at the points. For the first spline they are the
    sums of the great-circle arcs between the points. For every later spline they are the
    arc lengths of the points on the spline before. The parameter thus becomes nearly the
    arc length.

    Parameters
    ----------
    points
        (m, 3) unit vectors. The first one is not repeated at the end of a closed curve.
    closed
        Whether the curve returns to its first point.
    """
    # In a closed curve, the first point is repeated at the end.
    unit_points = normalised_points(points, closed)
    steps = arc(unit_points[:-1], unit_points[1:])
    for _ in range(1 + SPLINE_REFITS):
        knots = np.append(0.0, np.cumsum(steps))
        path = SplinePath(quintic(knots, unit_points, closed), knots, closed)
        arc_length = measure_arc_length(path, knots)
        yield path, arc_length
        # The next steps are the arc lengths between successive knots.
        steps = np.diff(arc_length.evaluate_at_edges(knots))
