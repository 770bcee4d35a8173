"""Curves on the unit sphere in a parameter of their own: a Fourier colatitude, a spline.

What makes a profile valid: colatitudes, points, and closed curves that stay simple.

Arc length of a curve against its own parameter: measured once, inverted when asked.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss, legint, legval, legvander
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import EPS
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.crossings import bracketed_zeros
from spherekit.sphere.rotation import arc, cross, frame_from, max_abs

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


def dot(a: Floats, b: Floats) -> Floats:
    """Return the products (...) of vectors (..., 3), the same for one as for many."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def exact_frame(point: Floats, tangent: Floats) -> Floats:
    """Return frames (n, 3, 3) orthonormal to rounding from directions nearly so."""
    p = point / np.sqrt(dot(point, point))[:, None]
    t = tangent - dot(tangent, p)[:, None] * p
    return frame_from(p, t / np.sqrt(dot(t, t))[:, None])


FEWEST_POINTS = 6
"""Fewest points of a curve through points: they fix one polynomial of degree 5."""

_TOUCH = 1e-13


def check_colatitude(path: FourierPath) -> None:
    """Raise ValueError if a Fourier colatitude leaves (0, pi) anywhere."""
    even, odd = path.series[1]
    # e^(ia) at the zeros of the slope, and so its angle at the real ones, are roots
    ahead = np.round(0.5 * (even - 1j * odd), 30)  # quotients remain finite
    roots = np.roots(np.concatenate([ahead[::-1], np.conj(ahead[1:])]))
    a = np.angle(np.append(roots, 1.0))
    value = path.colatitude(a, 0)[0]
    at = int(np.argmax(np.abs(value - 0.5 * np.pi)))
    if not 0.0 < value[at] < np.pi:
        raise ValueError(
            f"the colatitude is {np.rad2deg(value[at]):.6g} deg at "
            f"{path.place(float(a[at]))}; it has to stay between 0 and 180 deg, both "
            "excluded"
        )


def checked_points(points: ArrayLike, closed: bool) -> Floats:
    """Return points (m, 3) of exactly unit length; a closed curve's first one again."""
    given = np.array(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"the points have shape {given.shape}; they have to be (m, 3)")
    if len(given) < FEWEST_POINTS:
        raise ValueError(
            f"the curve has {len(given)} points; it needs at least {FEWEST_POINTS}"
        )
    size = np.sqrt(dot(given, given))
    wrong = ~(np.abs(size - 1.0) <= UNIT_TOLERANCE)
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise ValueError(
            f"point {k + 1} has length {size[k]:.9g}; it has to be a unit vector"
        )
    given = given / size[:, None]
    if closed:
        if arc(given[-1], given[0]) < UNIT_TOLERANCE:
            raise ValueError(
                f"the last point, {len(given)}, repeats the first; leave it out: a closed "
                "curve returns to its first point by itself"
            )
        given = np.concatenate([given, given[:1]])
    steps = arc(given[:-1], given[1:])
    count = len(given) - closed
    for k, step in enumerate(steps):
        names = f"points {k + 1} and {(k + 1) % count + 1}"
        if step < 1e-9:
            raise ValueError(f"{names} coincide; leave one of them out")
        if step >= 0.5 * np.pi:
            raise ValueError(
                f"{names} are {np.rad2deg(step):.6g} deg apart; successive points have to "
                "be less than 90 deg apart, so give more of them"
            )
    return given


def check_simple(path: SplinePath) -> None:
    """Raise ValueError if a closed curve through points crosses or touches itself.

    Looks at a polyline of great-circle arcs, at least 8 between successive points. Two arcs
    can meet only where the middle of one is nearer than the longer one's length.
    """
    from scipy.spatial import cKDTree

    count = len(path.knots) - 1
    parts = max(8, -(-400 // count))
    u = path.knots[:-1, None] + np.diff(path.knots)[:, None] * (np.arange(parts) / parts)
    x = path.spline(u.ravel())
    a = x / np.sqrt(dot(x, x))[:, None]
    b = np.roll(a, -1, axis=0)
    middle, length, total = 0.5 * (a + b), np.sqrt(dot(b - a, b - a)), len(a)
    near = cKDTree(middle).query_ball_point(middle, length * (1.0 + 1e-9))
    i, j = np.repeat(np.arange(total), [*map(len, near)]), np.concatenate([*near])
    apart = np.minimum((i - j) % total, (j - i) % total) > 1
    i, j = i[apart], j[apart]
    met = _straddle(a[i], b[i], a[j], b[j]) & _straddle(a[j], b[j], a[i], b[i])
    if np.any(met):
        at = np.argmax(met)
        places = " and ".join(
            f"between points {k + 1} and {(k + 1) % count + 1}"
            for k in sorted((i[at] // parts, j[at] // parts))
        )
        raise ValueError(f"the closed curve meets itself: {places}")


def _straddle(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return where c and d (n, 3) are not strictly on one side of the circle a, b."""
    normal = cross(a, b)
    normal = normal / np.sqrt(dot(normal, normal))[:, None]
    at_c, at_d = dot(normal, c), dot(normal, d)
    return (at_c * at_d <= 0.0) | (np.abs(at_c) <= _TOUCH) | (np.abs(at_d) <= _TOUCH)


SLOWEST = 1e-5
"""A curve whose speed falls below this part of its mean speed has a cusp."""

_ORDER = 16
_DEEPEST = 40
_TAIL = 1e-15
_EXACT = 4.0 * EPS
"""Error of u by the arc length, relative to its largest."""
_ROUNDING = 1e-12
"""What that may be where lengths lose digits."""


@dataclass(frozen=True)
class ArcLength:
    """Arc length against the parameter u, as Legendre series of the speed on panels.

    `edges` (panels + 1,) in u and `starts` (panels + 1,) in s bound the panels;
    `speeds` (order, panels) are the coefficients of ds/dx, x = -1 to 1 on each.
    """

    edges: Floats
    starts: Floats
    speeds: Floats

    @property
    def length(self) -> float:
        """The whole arc length (rad)."""
        return float(self.starts[-1])

    def at_edge(self, u: Floats) -> Floats:
        """Return the arc lengths of parameters that are edges."""
        return self.starts[np.searchsorted(self.edges, u)]

    def invert(self, s: Floats) -> Floats:
        """Return u (n,) at arc lengths s (n,)."""
        return s * self._pace + self._inverse.scattered(s)[0]

    @property
    def _pace(self) -> float:
        """The mean rate of u by the arc length."""
        return float(self.edges[-1] - self.edges[0]) / self.length

    @cached_property
    def _inverse(self) -> PiecewiseChebyshev:
        """What u is more than by its mean rate, by the arc length."""

        def more(s: Floats) -> Floats:
            panel = np.searchsorted(self.starts[1:-1], s, side="right")
            target = s - self.starts[panel]

            def gap(x: Floats, rows: Indices) -> Floats:
                return self.within(panel[rows], x) - target[rows]

            one, left = np.ones_like(s), np.diff(self.starts)[panel] - target
            x, _ = bracketed_zeros(gap, -one, one, -target, left, EPS)
            u = self.edges[panel] + 0.5 * np.diff(self.edges)[panel] * (1.0 + x)
            return (u - s * self._pace)[:, None]

        size, cells = self.edges[-1:], self.starts
        return PiecewiseChebyshev.fit(
            more, 0.0, self.length, _EXACT, size, cells, rounding=_ROUNDING
        )

    def at(self, u: Floats) -> Floats:
        """Return the arc lengths (n,) of parameters u (n,)."""
        panel = np.searchsorted(self.edges[1:-1], u, side="right")
        low, high = self.edges[panel], self.edges[panel + 1]
        return self.starts[panel] + self.within(
            panel, (2.0 * u - low - high) / (high - low)
        )

    def within(self, panel: Indices, x: Floats) -> Floats:
        """Return the arc length (n,) from a panel's start to x."""
        return np.asarray(legval(x, self._covered[:, panel], tensor=False))

    @cached_property
    def _covered(self) -> Floats:
        """(order + 1, panels) the series of the arc length from the panel's start."""
        return np.asarray(legint(self.speeds, lbnd=-1))


def measure(path: FourierPath | SplinePath, edges: Floats) -> ArcLength:
    """Return the table of arc length over panels, halved until the series has ended.

    The curve has to be smooth between `edges`.
    """
    table = integrated(path.speed, edges)
    u = np.sort(np.append(table.edges, 0.5 * (table.edges[1:] + table.edges[:-1])))
    slow = path.speed(u) < SLOWEST * table.length / (edges[-1] - edges[0])
    if np.any(slow):
        raise ValueError(
            f"the curve has a cusp near {path.place(u[np.argmax(slow)])}: its speed "
            "vanishes there; a profile has to be smooth"
        )
    return table


def integrated(
    rate: Callable[[Floats], Floats], edges: Floats, rounding: Floats | None = None
) -> ArcLength:
    """Return the table of the integral of a rate over panels that are halved.

    Gauss-Legendre nodes give each series. `rounding` (panels,) is the relative error of
    the rate where it is known less well than to machine precision: no panel is halved to
    resolve that.
    """
    low, high = edges[:-1], edges[1:]
    ready: list[tuple[Floats, Floats]] = []
    total = 0.0
    noise = np.zeros(len(low)) if rounding is None else rounding
    nodes, weights = leggauss(_ORDER)
    rows = legvander(nodes, _ORDER - 1) * weights[:, None]
    rows *= np.arange(_ORDER) + 0.5
    for depth in range(_DEEPEST + 1):
        half = 0.5 * (high - low)[:, None]
        series = half * (rate(low[:, None] + half * (1.0 + nodes)) @ rows)
        largest = max_abs(series, axis=1)
        if depth == 0:
            total = 2.0 * float(np.sum(largest))
        tail = max_abs(series[:, -2:], axis=1) / _ORDER
        smooth = (tail <= _TAIL * total) | (tail <= noise * largest)
        smooth |= depth == _DEEPEST
        ready.append((low[smooth], series[smooth]))
        rest = ~smooth
        middle = low[rest] + 0.5 * (high[rest] - low[rest])
        low = np.concatenate([low[rest], middle])
        high = np.concatenate([middle, high[rest]])
        noise = np.tile(noise[rest], 2)
        if not len(low):
            break
    starts, speeds = map(np.concatenate, zip(*ready, strict=True))
    order = np.argsort(starts)
    speeds = np.ascontiguousarray(speeds[order].T)
    arcs = np.append(0.0, np.cumsum(2.0 * speeds[0]))
    return ArcLength(np.append(starts[order], edges[-1]), arcs, speeds)
