"""Curves on the unit sphere as functions of a parameter u: circle, Fourier series, spline.

Each path computes its speed |dp/du| and its frame from formulas. A frame (3, 3) has the
columns t, n = p x t and p, where p is the point and t the unit tangent. The arc length s of
a path is in `spherekit.geometry.arc_length`, curves as functions of arc length are in
`spherekit.geometry.profile_curve`.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.geometry.triangle import frame_from
from spherekit.geometry.vectors import cross, dot

UNIT_LENGTH_TOLERANCE = 1e-6
"""Largest deviation of a centre or a point from unit length; the vectors are normalised.

Larger: wrong vectors are accepted. Smaller: vectors in files need more digits.
"""

MAX_FIRST_COMPONENT = 0.9
"""Largest size of the x component of a centre whose azimuth is counted from the x axis.

For a larger one the azimuth is counted from the y axis. The number is part of the meaning
of files.
"""


@dataclass(frozen=True)
class PathFrames:
    """Frames and geodesic curvatures of a path on the unit sphere at n parameters.

    p is the point of the path, t the unit tangent there. Their vector product p x t is the
    normal, which points to the left of the path.

    Attributes
    ----------
    frame
        (n, 3, 3) frames with the columns t, p x t and p.
    curvature
        (n,) geodesic curvatures k, positive if the path turns left.
    curvature_rate
        (n,) derivatives dk/ds with respect to the arc length s.
    """

    frame: Floats
    curvature: Floats
    curvature_rate: Floats


@dataclass(frozen=True)
class CirclePath:
    """A circle on the unit sphere, whose parameter u is its arc length (rad).

    Attributes
    ----------
    axes
        (3, 3) orthonormal columns. The third column points to the centre of the circle on
        the sphere, the first column from there towards the start of the circle.
    sine, cosine
        Sine and cosine of the angular radius.
    """

    axes: Floats
    sine: float
    cosine: float

    def speed(self, u: Floats) -> Floats:
        """Return the speed |dp/du|, which is 1, at parameters u of any shape."""
        return np.ones(np.shape(u))

    def frames(self, u: Floats) -> PathFrames:
        """Return point, tangent, normal and geodesic curvature at parameters u (n,).

        The path is a circle, and u is the arc length along the circle (rad). The result has
        the derivative of the geodesic curvature with respect to u.
        """
        # A circle of angular radius r on the unit sphere has the length 2 pi sin(r). So an
        # arc length u covers the angle u / sin(r) about the centre, called the azimuth.
        # `outward` (n, 3) points from the centre to this azimuth, and `tangent` is 90
        # degrees ahead.
        outward, tangent = radial_directions(self.axes, u / self.sine)
        centre = self.axes[:, 2]
        point = self.cosine * centre + self.sine * outward
        # 0 u has the shape (n,), and is NaN where u is NaN.
        zeros = 0.0 * u
        return PathFrames(
            frame=orthonormal_frame(point, tangent),
            # The geodesic curvature of a circle is the cotangent of its radius.
            curvature=self.cosine / self.sine + zeros,
            curvature_rate=zeros,
        )


@dataclass(frozen=True)
class FourierPath:
    """A path whose colatitude is a Fourier series of the azimuth, which is its parameter.

    The path is a curve on the unit sphere. Its colatitude (angle from an axis) at the
    azimuth u is sum cosines[k] cos(k u) + sines[k] sin(k u), in rad.

    Attributes
    ----------
    axes
        (3, 3) orthonormal columns. Colatitude 0 is at the third column, azimuth 0 is
        towards the first column and azimuth 90 degrees towards the second column.
    cosines, sines
        (k,) coefficients (rad).
    """

    axes: Floats
    cosines: Floats
    sines: Floats

    def colatitude(self, azimuth: Floats, derivative_count: int) -> list[Floats]:
        """Return the colatitude (rad) and its derivatives with respect to the azimuth.

        The curve is described by its colatitude (angle from the centre), a Fourier series
        of the azimuth.

        Parameters
        ----------
        azimuth
            Azimuths (rad) about the centre of the curve, of any shape.
        derivative_count
            Number of derivatives, at most 3.
        """
        # Cosines and sines of k times the azimuth, with the orders k along the first axis.
        angles = np.multiply.outer(np.arange(len(self.cosines)), azimuth)
        c = np.cos(angles)
        s = np.sin(angles)
        shape = (-1, *[1] * np.ndim(azimuth))
        # `np.add.accumulate` adds the terms one by one, in their order. So the rounding
        # error of a result does not depend on the number of azimuths.
        return [
            np.add.accumulate(
                cosines.reshape(shape) * c + sines.reshape(shape) * s, axis=0
            )[-1]
            for cosines, sines in self.derivative_coefficients[: derivative_count + 1]
        ]

    @cached_property
    def derivative_coefficients(self) -> list[tuple[Floats, Floats]]:
        """Cosine and sine coefficients (k,) of the colatitude and of three derivatives."""
        coefficients = [(self.cosines, self.sines)]
        orders = np.arange(len(self.cosines))
        for _ in range(3):
            cosines, sines = coefficients[-1]
            coefficients.append((orders * sines, -orders * cosines))
        return coefficients

    def speed(self, u: Floats) -> Floats:
        """Return the speed |dp/du| of the path at azimuths u of any shape."""
        colatitude, slope = self.colatitude(u, 1)
        sine = np.sin(colatitude)
        return np.sqrt(slope * slope + sine * sine)

    def frames(self, u: Floats) -> PathFrames:
        """Return point, tangent, normal and geodesic curvature at azimuths u (n,).

        The curve is described by its colatitude (angle from a centre) over the azimuth
        about this centre. The result has the derivative of the curvature with respect to
        arc length.
        """
        # d1, d2 and d3 are derivatives of the colatitude with respect to the azimuth; s and
        # c are the sine and the cosine of the colatitude.
        colatitude, d1, d2, d3 = self.colatitude(u, 3)
        s = np.sin(colatitude)
        c = np.cos(colatitude)
        # Vectors are stored as (3, n), so that they can be multiplied by arrays (n,).
        # `outward` points from the centre to the azimuth, `eastward` is 90 degrees ahead.
        outward, eastward = (directions.T for directions in radial_directions(self.axes, u))
        centre = self.axes[:, 2, None]
        point = c * centre + s * outward
        southward = c * outward - s * centre
        # dp/du has the components d1 southward and s eastward.
        speed = np.sqrt(d1 * d1 + s * s)
        tangent = (d1 / speed) * southward + (s / speed) * eastward
        curvature, curvature_rate = self._curvature(s, c, (d1, d2, d3))
        return PathFrames(
            frame=orthonormal_frame(point.T, tangent.T),
            curvature=curvature,
            curvature_rate=curvature_rate,
        )

    @staticmethod
    def _curvature(
        s: Floats, c: Floats, derivatives: tuple[Floats, Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Return the geodesic curvature k of the path, and its derivative dk/ds.

        The path is described by its colatitude (angle from a centre) over the azimuth. The
        derivative is with respect to arc length.

        Parameters
        ----------
        s, c
            (n,) sine and cosine of the colatitude.
        derivatives
            d1, d2, d3 (n,): derivatives of the colatitude with respect to the azimuth.

        Notes
        -----
        Primes denote derivatives with respect to the azimuth. The point is p, and v = |p'|
        is the speed, the derivative of the arc length. With D = det(p, p', p''),

            k = D / v^3,    k' / v = D' / v^4 - 3 k v' / v^2.

        The second formula is the derivative dk/ds. The part of p'' along p does not matter
        for D. The other components, southward and eastward, are

            p': d1, s               p'': d2 - s c, 2 c d1

        So D = 2 c d1^2 + s^2 c - s d2. By the product rule, with s' = c d1 and c' = -s d1,

            D' = -2 s d1^3 + 4 c d1 d2 + (2 s c^2 d1 - s^3 d1) - (c d1 d2 + s d3).
        """
        d1, d2, d3 = derivatives
        v = np.sqrt(d1 * d1 + s * s)
        v_rate = d1 * (d2 + s * c) / v
        determinant = 2.0 * c * d1**2 + s * (s * c - d2)
        determinant_rate = (
            d1 * (3.0 * c * d2 - 2.0 * s * d1**2 + s * (2.0 * c**2 - s**2)) - s * d3
        )
        k = determinant / v**3
        return k, determinant_rate / v**4 - 3.0 * k * v_rate / v**2

    def describe_position(self, u: float) -> str:
        """Return a text with the azimuth u (rad), such as "azimuth 30 deg"."""
        return f"azimuth {np.rad2deg(u) % 360.0:.6g} deg"


@dataclass(frozen=True)
class SplinePath:
    """A curve on the unit sphere: the radial projection p = x / |x| of a spline x(u).

    Attributes
    ----------
    spline
        A function of parameters u and an order, such as SciPy's `BSpline`. It returns the
        derivative (..., 3) of x of this order with respect to u.
    knots
        (m,) parameters of the interpolated points. The last one of a closed path belongs to
        the first point.
    closed
        Whether the path is closed.
    """

    spline: Any
    knots: Floats
    closed: bool

    def _differentiate(self, u: Floats, order: int) -> Floats:
        """Return a derivative (..., 3) of the spline at parameters u (...).

        A complex u has a derivative in its imaginary part (complex step). SciPy's splines
        take real parameters only, so the imaginary part of the result is added by the chain
        rule.
        """
        derivative = self.spline(np.real(u), order)
        if np.iscomplexobj(u):
            next_derivative = self.spline(np.real(u), order + 1)
            derivative = derivative + np.imag(u)[..., None] * 1j * next_derivative
        return derivative

    def speed(self, u: Floats) -> Floats:
        """Return |dp/du| = |x cross x'| / |x|^2 at parameters u of any shape."""
        x = self._differentiate(u, 0)
        x1 = self._differentiate(u, 1)
        product = cross(x, x1)
        return np.sqrt(dot(product, product)) / dot(x, x)

    def frames(self, u: Floats) -> PathFrames:
        """Return point, tangent, normal and geodesic curvature at parameters u (n,).

        The result has the derivative of the curvature with respect to arc length. The curve
        on the unit sphere is p = x / |x|, the projection of a spline x(u) in space.
        """
        x = self._differentiate(u, 0)
        x1 = self._differentiate(u, 1)
        x2 = self._differentiate(u, 2)
        x3 = self._differentiate(u, 3)
        # The part of x' perpendicular to x, times |x|^2. It has the direction of dp/du.
        along_tangent = cross(cross(x, x1), x)
        curvature, curvature_rate = self._curvature(x, x1, x2, x3)
        return PathFrames(
            frame=orthonormal_frame(x, along_tangent),
            curvature=curvature,
            curvature_rate=curvature_rate,
        )

    @staticmethod
    def _curvature(x: Floats, x1: Floats, x2: Floats, x3: Floats) -> tuple[Floats, Floats]:
        """Return the geodesic curvature k and dk/ds of the projected curve.

        Parameters
        ----------
        x, x1, x2, x3
            (n, 3) the spline x and its derivatives x', x'' and x''' with respect to its
            parameter.

        Notes
        -----
        The geodesic curvature is det(p, p', p'') / |p'|^3 with p = x / |x|. The vector p'
        is x' / |x| plus a part along x. The vector p'' is x'' / |x| plus parts along x and
        x'. These parts do not change the determinant, so

            k = q^3 D,  q = |x| / |x cross x'|,  D = det(x, x', x'') = (x cross x') . x''.

        The derivatives with respect to the parameter are

            k' = q^3 D' + 3 q^2 q' D,
            D' = (x cross x') . x''',
            q' / q = (x . x') / |x|^2 - (x cross x') . (x cross x'') / |x cross x'|^2.

        The product rule gives D' two more determinants, which are 0 because two of their
        vectors are equal. dk/ds is k' divided by the speed |x cross x'| / |x|^2.
        """
        size = np.sqrt(dot(x, x))
        normal = cross(x, x1)
        normal_size = np.sqrt(dot(normal, normal))
        q = size / normal_size
        q_rate = q * (dot(x, x1) / size**2 - dot(normal, cross(x, x2)) / normal_size**2)
        determinant = dot(normal, x2)
        determinant_rate = dot(normal, x3)
        k_rate = q**3 * determinant_rate + 3.0 * q**2 * q_rate * determinant
        return q**3 * determinant, k_rate * size**2 / normal_size

    def describe_position(self, u: float) -> str:
        """Return the nearest given point to a position, such as "point 3", for messages.

        The spline was laid through given points, which are counted from 1. `u` is the
        parameter of the position.
        """
        # The last knot of a closed path belongs to the first point, which is counted once.
        point_count = len(self.knots) - self.closed
        return f"point {1 + np.argmin(np.abs(self.knots - u)) % point_count}"


Path = CirclePath | FourierPath | SplinePath
"""A curve on the unit sphere as a function of its own parameter u."""


def quintic(knots: Floats, points: Floats, closed: bool) -> Any:
    """Return the quintic spline through points (m, 3) at knots (m,), periodic if closed."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(knots, points, k=5, bc_type="periodic" if closed else None)


def axes_about(centre: ArrayLike) -> Floats:
    """Return the axes (3, 3) in which azimuths about a centre are measured.

    The columns are unit vectors to azimuth 0, to azimuth 90 degrees and to the centre.
    Azimuth 0 is the direction of the x axis, projected perpendicular to the centre. If the
    centre is close to the x axis, the y axis takes the place of the x axis.

    Parameters
    ----------
    centre
        (3,) unit vector. The vector can be complex: the real part is the vector, and the
        imaginary part is tiny and proportional to the derivative of the vector (complex
        step).

    Raises
    ------
    ValueError
        If the centre is not a unit vector (3,).
    """
    vector = np.array(centre)
    if vector.shape != (3,):
        raise ValueError(
            f"the vector to the centre has shape {vector.shape}; it has to be (3,)"
        )
    # Single precision and integers become double precision; complex numbers stay complex.
    vector = vector.astype(np.result_type(vector, np.float64))
    # `abs` ignores the tiny imaginary part of a complex step.
    size = _length(vector)
    if not abs(size - 1.0) <= UNIT_LENGTH_TOLERANCE:
        raise ValueError(
            f"the vector to the centre has length {abs(size):.9g}; it has to be a unit "
            "vector"
        )
    unit = vector / size
    # If the projected axis were too close to the centre, digits would be lost.
    is_near_x_axis = abs(unit[0]) > MAX_FIRST_COMPONENT
    y_axis = np.array([0.0, 1.0, 0.0])
    x_axis = np.array([1.0, 0.0, 0.0])
    first = y_axis if is_near_x_axis else x_axis
    # The second pass removes the rounding error of the first one.
    for _ in range(2):
        first = first - dot(first, unit) * unit
        first = first / _length(first)
    return np.stack([first, cross(unit, first), unit], axis=1)


def _length(vector: Floats) -> Any:
    """Return the length of a vector (3,), real or complex.

    A complex vector has a derivative in its imaginary part (complex step). The squares are
    summed without conjugation, so that the imaginary part of the length is its derivative.
    """
    return np.sqrt(dot(vector, vector))


def radial_directions(axes: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors perpendicular to the third of three axes, at azimuths about it.

    Parameters
    ----------
    axes
        (3, 3) orthonormal columns.
    azimuth
        (n,) azimuths (rad), from the first axis towards the second one.

    Returns
    -------
    outward
        (n, 3) vectors at the azimuth.
    tangential
        (n, 3) derivatives of these vectors with respect to the azimuth, which are 90
        degrees ahead.
    """
    c = np.cos(azimuth)
    s = np.sin(azimuth)
    x = axes[:, 0, None]
    y = axes[:, 1, None]
    return (c * x + s * y).T, (c * y - s * x).T


def orthonormal_frame(point: Floats, tangent: Floats) -> Floats:
    """Return the orthonormal frames (n, 3, 3) of points of a curve.

    The columns of a frame are t, p x t and p. Here p is the unit vector to the point, and t
    the unit tangent of the curve. The part of the tangent along p is removed, so that both
    are at right angles in spite of rounding errors.

    Parameters
    ----------
    point
        (n, 3) vectors to the points, of any length.
    tangent
        (n, 3) tangents of any length, at right angles to the points up to rounding.
    """
    p = point / np.sqrt(dot(point, point))[:, None]
    t = tangent - dot(tangent, p)[:, None] * p
    return frame_from(p, t / np.sqrt(dot(t, t))[:, None])
