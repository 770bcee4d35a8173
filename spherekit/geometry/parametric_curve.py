"""Curves on the unit sphere in a parameter of their own: a Fourier colatitude, a spline."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.geometry.triangle import frame_from
from spherekit.geometry.vectors import cross, dot

UNIT_TOLERANCE = 1e-6
"""Centres and points may differ from unit length by this much; they are normalised."""


@dataclass(frozen=True)
class CirclePath:
    """A circle about the third column of `axes`; its parameter is its arc length.

    `sine` and `cosine` are those of its radius.
    """

    axes: Floats
    sine: float
    cosine: float

    def speed(self, u: Floats) -> Floats:
        """Return |dp/du| at u of any shape."""
        return np.ones(np.shape(u))

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the frames (n, 3, 3), k (n,) and dk/ds (n,) at u (n,)."""
        outward, along = turned(self.axes, u / self.sine)
        point = (self.cosine * self.axes[:, 2, None] + self.sine * outward.T).T
        return exact_frame(point, along), self.cosine / self.sine + 0.0 * u, 0.0 * u


@dataclass(frozen=True)
class FourierPath:
    """A colatitude about the third column of `axes`; its parameter is the azimuth."""

    axes: Floats
    cosines: Floats
    sines: Floats

    def colatitude(self, a: Floats, derivatives: int) -> list[Floats]:
        """Return the colatitude and so many derivatives at azimuths a of any shape."""
        angles = np.multiply.outer(np.arange(len(self.cosines)), a)
        c, s = np.cos(angles), np.sin(angles)
        shape = (-1, *[1] * np.ndim(a))
        terms = (
            even.reshape(shape) * c + odd.reshape(shape) * s
            for even, odd in self.series[: derivatives + 1]
        )
        return [np.add.accumulate(x, axis=0)[-1] for x in terms]  # one place as many

    @cached_property
    def series(self) -> list[tuple[Floats, Floats]]:
        """Cosines and sines (k,) of the colatitude and its first three derivatives."""
        made = [(self.cosines, self.sines)]
        orders = np.arange(len(self.cosines))
        for _ in range(3):
            even, odd = made[-1]
            made.append((orders * odd, -orders * even))
        return made

    def speed(self, u: Floats) -> Floats:
        """Return |dp/du| at u of any shape."""
        colatitude, slope = self.colatitude(u, 1)
        sine = np.sin(colatitude)
        return np.sqrt(slope * slope + sine * sine)

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the frames (n, 3, 3), k (n,) and dk/ds (n,) at u (n,)."""
        colatitude, d1, d2, d3 = self.colatitude(u, 3)
        s, c = np.sin(colatitude), np.cos(colatitude)
        # components first: a place each in the innermost loops
        outward, along = (vectors.T for vectors in turned(self.axes, u))
        centre = self.axes[:, 2, None]
        point = c * centre + s * outward
        away = c * outward - s * centre
        v = np.sqrt(d1 * d1 + s * s)
        tangent = (d1 / v) * away + (s / v) * along
        # k = bend / v^3 with bend = det(p, p', p''), in the basis away, along
        bend = 2.0 * c * d1**2 + s * (s * c - d2)
        bend_rate = d1 * (3.0 * c * d2 - 2.0 * s * d1**2 + s * (2.0 * c**2 - s**2)) - s * d3
        v_rate = d1 * (d2 + s * c) / v
        k = bend / v**3
        return (
            exact_frame(point.T, tangent.T),
            k,
            bend_rate / v**4 - 3.0 * k * v_rate / v**2,
        )

    def place(self, u: float) -> str:
        """Return words for where u is."""
        return f"azimuth {np.rad2deg(u) % 360.0:.6g} deg"


@dataclass(frozen=True)
class SplinePath:
    """The radial projection p = x / |x| of a spline x(u) in space through points.

    ``spline(u, order)`` is a derivative (..., 3) of it by u, as of SciPy's `BSpline`.
    """

    spline: Any
    knots: Floats
    closed: bool

    def _derivative(self, u: Floats, order: int) -> Floats:
        """Return a derivative (..., 3) of the spline; u may be a complex step."""
        there = self.spline(np.real(u), order)
        if np.iscomplexobj(u):
            there = there + np.imag(u)[..., None] * 1j * self.spline(np.real(u), order + 1)
        return there

    def speed(self, u: Floats) -> Floats:
        """Return |dp/du| at u of any shape."""
        x, x1 = self._derivative(u, 0), self._derivative(u, 1)
        across = cross(x, x1)
        return np.sqrt(dot(across, across)) / dot(x, x)

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the frames (n, 3, 3), k (n,) and dk/ds (n,) at u (n,)."""
        x, x1, x2, x3 = (self._derivative(u, order) for order in range(4))
        r = np.sqrt(dot(x, x))
        across = cross(x, x1)
        size = np.sqrt(dot(across, across))
        # k = ratio^3 det(x, x', x'') with ratio = |x| / |x cross x'|; |p'| = size / r^2
        ratio = r / size
        bend, bend_rate = dot(across, x2), dot(across, x3)
        ratio_rate = ratio * (dot(x, x1) / r**2 - dot(across, cross(x, x2)) / size**2)
        k_rate = ratio**3 * bend_rate + 3.0 * ratio**2 * ratio_rate * bend
        k_rate = k_rate * r**2 / size
        return exact_frame(x, cross(across, x)), ratio**3 * bend, k_rate

    def place(self, u: float) -> str:
        """Return words for where u is."""
        count = len(self.knots) - self.closed
        return f"point {1 + np.argmin(np.abs(self.knots - u)) % count}"


Path = CirclePath | FourierPath | SplinePath
"""A curve on the unit sphere in a parameter u of its own."""


def quintic(knots: Floats, points: Floats, closed: bool) -> Any:
    """Return the quintic spline through points (m, 3) at knots (m,), periodic if closed."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(knots, points, k=5, bc_type="periodic" if closed else None)


def axes_about(centre: ArrayLike) -> Floats:
    """Return axes (3, 3): columns towards azimuth 0 and 90 degrees, and the centre."""
    given = np.array(centre)
    size = np.sqrt(dot(given, given))
    if not abs(size - 1.0) <= UNIT_TOLERANCE:
        raise ValueError(
            f"the centre has length {abs(size):.9g}; it has to be a unit vector"
        )
    unit = given / size
    first = np.eye(3)[1 if abs(unit[0]) > 0.9 else 0]
    for _ in range(2):
        first = first - dot(first, unit) * unit
        first = first / np.sqrt(dot(first, first))
    return np.stack([first, cross(unit, first), unit], axis=1)


def turned(axes: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
    """Return the unit vectors (n, 3) at right angles to the third axis: out, onward."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    x, y = axes[:, 0, None], axes[:, 1, None]
    return (c * x + s * y).T, (c * y - s * x).T


def exact_frame(point: Floats, tangent: Floats) -> Floats:
    """Return frames (n, 3, 3) orthonormal to rounding from directions nearly so."""
    p = point / np.sqrt(dot(point, point))[:, None]
    t = tangent - dot(tangent, p)[:, None] * p
    return frame_from(p, t / np.sqrt(dot(t, t))[:, None])
