"""Smooth curves on the unit sphere by arc length: the profiles of contact pairs.

A curve turns left where its geodesic curvature k is positive. Its frame, with the
tangent t, the point p and n = p x t, obeys dp/ds = t, dt/ds = k n - p, dn/ds = -k t.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, final

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import EPS
from spherekit.sphere.rotation import Floats, arc, cross, frame_from

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Bools = NDArray[np.bool_]

FEWEST_POINTS = 6
"""Fewest points of a curve through points: they fix one polynomial of degree 5."""

UNIT_TOLERANCE = 1e-6
"""Centres and points may differ from unit length by this much; they are normalised."""

SLOWEST = 1e-5
"""A curve whose speed falls below this part of its mean speed has a cusp."""

_ORDER = 16
_DEEPEST = 40
_TAIL = 1e-15
_REFITS = 4
_TOUCH = 1e-13


@final
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

    @abstractmethod
    def at(self, s: ArrayLike) -> CurvePoint:
        """Return the curve at arc lengths s (n,) in rad; a closed one repeats itself."""

    @abstractmethod
    def reversed(self) -> "Curve":
        """Return the same curve run backwards.

        A closed one keeps its point at s = 0 and has -s for s, an open one starts at the
        old end. t, n and k change sign, dk/ds does not.
        """


def circle(centre: Sequence[float], radius: float) -> Curve:
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
    return _Circle(_axes_about(centre), float(np.sin(radius)), float(np.cos(radius)))


def great_circle(centre: Sequence[float]) -> Curve:
    """Return the great circle, counter-clockwise about its pole, a unit vector (3,).

    Raises
    ------
    ValueError
        If the pole is not a unit vector.
    """
    return _Circle(_axes_about(centre), 1.0, 0.0)


def fourier(
    centre: Sequence[float], cosines: Sequence[float], sines: Sequence[float] = ()
) -> Curve:
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
    size = max(len(cosines), len(sines), 1)
    series = np.zeros((2, size))
    series[0, : len(cosines)] = cosines
    series[1, : len(sines)] = sines
    if not np.all(np.isfinite(series)):
        raise ValueError("the coefficients of the colatitude have to be finite")
    path = _FourierPath(_axes_about(centre), series[0], series[1])
    _check_colatitude(path)
    table = _measure(path, np.linspace(0.0, 2.0 * np.pi, 4 * size + 1))
    return _Measured(path, table, closed=True)


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
    given = _checked_points(points, closed)
    steps = arc(given[:-1], given[1:])
    for attempt in range(1 + _REFITS):
        knots = np.concatenate([[0.0], np.cumsum(steps)])
        path = _SplinePath(_quintic(knots, given, closed), knots)
        table = _measure(path, knots)
        if attempt < _REFITS:
            steps = np.diff(table.at_edge(knots))
    made = _Measured(path, table, closed=closed)
    if closed:
        _check_simple(path)
    return made


class _Path(Protocol):
    """A curve in a parameter u of its own."""

    def speed(self, u: Floats) -> Floats:
        """Return |dp/du| at u of any shape."""

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the frames (n, 3, 3), k (n,) and dk/ds (n,) at u (n,)."""

    def place(self, u: float) -> str:
        """Return words for where u is."""


@final
@dataclass(frozen=True)
class _Circle(Curve):
    """A circle about the third column of `axes`; sine and cosine of its radius."""

    axes: Floats
    sine: float
    cosine: float
    closed: bool = True

    @property
    def length(self) -> float:  # type: ignore[override]
        return 2.0 * np.pi * self.sine

    def at(self, s: ArrayLike) -> CurvePoint:
        arcs, inside = _into(np.asarray(s, dtype=float), self.length, closed=True)
        outward, along = _turned(self.axes, arcs / self.sine)
        point = self.cosine * self.axes[:, 2] + self.sine * outward
        one = np.where(inside, 1.0, np.nan)
        return CurvePoint(
            frame_from(point, along), self.cosine / self.sine * one, 0.0 * one, inside
        )

    def reversed(self) -> Curve:
        return _Reversed(self, self.length, self.closed)


@final
@dataclass(frozen=True)
class _Reversed(Curve):
    """A curve run backwards."""

    forward: Curve
    length: float
    closed: bool

    def at(self, s: ArrayLike) -> CurvePoint:
        back = -np.asarray(s, dtype=float)
        there = self.forward.at(back if self.closed else self.length + back)
        return CurvePoint(
            there.frame * np.array([-1.0, -1.0, 1.0]),
            0.0 - there.curvature,
            there.curvature_rate,
            there.inside,
        )

    def reversed(self) -> Curve:
        return self.forward


@final
@dataclass(frozen=True)
class _ArcLength:
    """Arc length against the parameter u, as Legendre series of the speed on panels.

    `edges` (panels + 1,) in u and `starts` (panels + 1,) in s bound the panels;
    `speeds` (order, panels) are the coefficients of ds/dx, x = -1 to 1 on each.
    """

    edges: Floats
    starts: Floats
    speeds: Floats

    def at_edge(self, u: Floats) -> Floats:
        """Return the arc lengths of parameters that are edges."""
        return np.asarray(self.starts[np.searchsorted(self.edges, u)])

    def invert(self, s: Floats) -> Floats:
        """Return u (n,) at arc lengths s (n,) by Newton steps kept inside a bracket."""
        last = len(self.edges) - 2
        panel = np.clip(np.searchsorted(self.starts, s, side="right") - 1, 0, last)
        target = s - self.starts[panel]
        low, high = np.full(s.shape, -1.0), np.full(s.shape, 1.0)
        x = 2.0 * target / (self.starts[panel + 1] - self.starts[panel]) - 1.0
        done = ~np.isfinite(x)
        for _ in range(100):
            covered, rate = self.within(panel, x)
            low = np.where(covered <= target, x, low)
            high = np.where(covered >= target, x, high)
            new = x - (covered - target) / rate
            lost = (new < low - 1e-9) | (new > high + 1e-9)
            new = np.where(lost, 0.5 * (low + high), new)
            near = ~lost & (np.abs(new - x) < 1e-9)
            x, done = np.where(done, x, new), done | near
            if np.all(done):
                break
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        return np.asarray(self.edges[panel] + half * (1.0 + np.clip(x, -1.0, 1.0)))

    def within(self, panel: NDArray[np.intp], x: Floats) -> tuple[Floats, Floats]:
        """Return the arc length from a panel's start to x, and ds/dx, both (n,)."""
        before, here = np.ones_like(x), x
        rate = self.speeds[0, panel]
        covered = rate * (1.0 + x)
        for degree in range(1, len(self.speeds)):
            after = ((2 * degree + 1) * x * here - degree * before) / (degree + 1)
            part = self.speeds[degree, panel]
            rate = rate + part * here
            covered = covered + part * (after - before) / (2 * degree + 1)
            before, here = here, after
        return covered, rate


@final
@dataclass(frozen=True)
class _Measured(Curve):
    """A curve in its own parameter, with the table of its arc length."""

    path: _Path
    table: _ArcLength
    closed: bool

    @property
    def length(self) -> float:  # type: ignore[override]
        return float(self.table.starts[-1])

    def at(self, s: ArrayLike) -> CurvePoint:
        arcs, inside = _into(np.asarray(s, dtype=float), self.length, self.closed)
        return CurvePoint(*self.path.frame(self.table.invert(arcs)), inside)

    def reversed(self) -> Curve:
        return _Reversed(self, self.length, self.closed)


@final
@dataclass(frozen=True)
class _FourierPath:
    """A colatitude about the third column of `axes`; its parameter is the azimuth."""

    axes: Floats
    cosines: Floats
    sines: Floats

    def colatitude(self, a: Floats, derivatives: int) -> list[Floats]:
        """Return the colatitude and so many derivatives at azimuths a of any shape."""
        out = [np.full_like(a, self.cosines[0])]
        out += [np.zeros_like(a) for _ in range(derivatives)]
        for k in range(1, len(self.cosines)):
            c, s = np.cos(k * a), np.sin(k * a)
            even, odd = float(self.cosines[k]), float(self.sines[k])
            for order in range(derivatives + 1):
                out[order] += even * c + odd * s
                even, odd = k * odd, -k * even
        return out

    def speed(self, u: Floats) -> Floats:
        colatitude, slope = self.colatitude(u, 1)
        return np.asarray(np.hypot(slope, np.sin(colatitude)))

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        colatitude, d1, d2, d3 = self.colatitude(u, 3)
        s, c = np.sin(colatitude), np.cos(colatitude)
        outward, along = _turned(self.axes, u)
        centre = self.axes[:, 2]
        point = c[:, None] * centre + s[:, None] * outward
        away = c[:, None] * outward - s[:, None] * centre
        v = np.hypot(d1, s)
        tangent = (d1 / v)[:, None] * away + (s / v)[:, None] * along
        # k = bend / v^3 with bend = det(p, p', p''), in the basis away, along
        bend = 2.0 * c * d1**2 + s * (s * c - d2)
        bend_rate = d1 * (3.0 * c * d2 - 2.0 * s * d1**2 + s * (2.0 * c**2 - s**2)) - s * d3
        v_rate = d1 * (d2 + s * c) / v
        k = bend / v**3
        return frame_from(point, tangent), k, bend_rate / v**4 - 3.0 * k * v_rate / v**2

    def place(self, u: float) -> str:
        return f"azimuth {np.rad2deg(u) % 360.0:.6g} deg"


@final
@dataclass(frozen=True)
class _SplinePath:
    """The radial projection p = x / |x| of a spline x(u) in space through points."""

    spline: "BSpline"
    knots: Floats

    def speed(self, u: Floats) -> Floats:
        x, x1 = self.spline(u), self.spline(u, 1)
        across = cross(x, x1)
        return np.asarray(np.sqrt(_dot(across, across)) / _dot(x, x))

    def frame(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        x, x1, x2, x3 = (self.spline(u, order) for order in range(4))
        r = np.sqrt(_dot(x, x))
        across = cross(x, x1)
        size = np.sqrt(_dot(across, across))
        point = x / r[:, None]
        side = across / size[:, None]
        side = side - _dot(side, point)[:, None] * point
        tangent = cross(side, point)
        tangent = tangent / np.sqrt(_dot(tangent, tangent))[:, None]
        # k = ratio^3 det(x, x', x'') with ratio = |x| / |x cross x'|; |p'| = size / r^2
        ratio = r / size
        bend, bend_rate = _dot(across, x2), _dot(across, x3)
        ratio_rate = ratio * (_dot(x, x1) / r**2 - _dot(across, cross(x, x2)) / size**2)
        k_rate = ratio**3 * bend_rate + 3.0 * ratio**2 * ratio_rate * bend
        k_rate = k_rate * r**2 / size
        return frame_from(point, tangent), ratio**3 * bend, k_rate

    def place(self, u: float) -> str:
        return f"point {1 + int(np.argmin(np.abs(self.knots - u))) % self.count}"

    @property
    def count(self) -> int:
        """The number of points, the repeated first one of a closed curve left out."""
        return len(self.knots) - int(self.closed)

    @property
    def closed(self) -> bool:
        """Whether the spline is periodic."""
        return self.spline.extrapolate == "periodic"


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the products (...) of vectors (..., 3), the same for one as for many."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def _axes_about(centre: Sequence[float]) -> Floats:
    """Return axes (3, 3): columns towards azimuth 0 and 90 degrees, and the centre."""
    given = np.array(centre, dtype=float)
    size = float(np.sqrt(_dot(given, given)))
    if not abs(size - 1.0) <= UNIT_TOLERANCE:
        raise ValueError(f"the centre has length {size:.9g}; it has to be a unit vector")
    unit = given / size
    first = np.eye(3)[1 if abs(unit[0]) > 0.9 else 0]
    for _ in range(2):
        first = first - _dot(first, unit) * unit
        first = first / np.sqrt(_dot(first, first))
    return np.stack([first, cross(unit, first), unit], axis=1)


def _turned(axes: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
    """Return the unit vectors (n, 3) at right angles to the third axis: out, onward."""
    c, s = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    return c * axes[:, 0] + s * axes[:, 1], c * axes[:, 1] - s * axes[:, 0]


def _into(s: Floats, length: float, closed: bool) -> tuple[Floats, Bools]:
    """Return arc lengths (n,) brought into 0 to `length`, and whether they belong."""
    finite = np.isfinite(s)
    if closed:
        return np.mod(np.where(finite, s, np.nan), length), finite
    slack = 4.0 * EPS * length
    inside = (s >= -slack) & (s <= length + slack)
    return np.clip(np.where(finite, s, np.nan), 0.0, length), inside


def _measure(path: _Path, edges: Floats) -> _ArcLength:
    """Return the table of arc length over panels, halved until the series has ended.

    Gauss-Legendre nodes give each series; the curve has to be smooth between `edges`.
    """
    nodes, weights = leggauss(_ORDER)
    rows = np.polynomial.legendre.legvander(nodes, _ORDER - 1) * weights[:, None]
    rows *= np.arange(_ORDER) + 0.5
    low, high = edges[:-1], edges[1:]
    ready: list[tuple[Floats, Floats, Floats]] = []
    slowest, where, total = np.inf, 0.0, 0.0
    for depth in range(_DEEPEST + 1):
        half = 0.5 * (high - low)
        u = low[:, None] + half[:, None] * (1.0 + nodes)
        speed = path.speed(u)
        at = np.unravel_index(int(np.argmin(speed)), speed.shape)
        if speed[at] < slowest:
            slowest, where = float(speed[at]), float(u[at])
        series = half[:, None] * (speed @ rows)
        if depth == 0:
            total = 2.0 * float(np.sum(series[:, 0]))
        tail = np.max(np.abs(series[:, -2:]), axis=1) / _ORDER
        smooth = (tail <= _TAIL * total) | (depth == _DEEPEST)
        ready.append((low[smooth], high[smooth], series[smooth]))
        rest = ~smooth
        middle = low[rest] + half[rest]
        low, high = np.concatenate([low[rest], middle]), np.concatenate([middle, high[rest]])
        if not len(low):
            break
    ends = path.speed(edges)
    if np.min(ends) < slowest:
        slowest, where = float(np.min(ends)), float(edges[np.argmin(ends)])
    if slowest < SLOWEST * total / (edges[-1] - edges[0]):
        raise ValueError(
            f"the curve has a cusp near {path.place(where)}: its speed vanishes there; a "
            "profile has to be smooth"
        )
    starts = np.concatenate([part[0] for part in ready])
    order = np.argsort(starts)
    speeds = np.concatenate([part[2] for part in ready])[order]
    return _ArcLength(
        edges=np.append(starts[order], edges[-1]),
        starts=np.concatenate([[0.0], np.cumsum(2.0 * speeds[:, 0])]),
        speeds=np.ascontiguousarray(speeds.T),
    )


def _check_colatitude(path: _FourierPath) -> None:
    """Raise ValueError if a Fourier colatitude leaves (0, pi) anywhere."""
    a = np.linspace(0.0, 2.0 * np.pi, 64 * len(path.cosines), endpoint=False)
    spacing = float(a[1])
    for _ in range(4):
        # towards the stationary point nearby; the samples that have none stay near
        _, slope, bend = path.colatitude(a, 2)
        step = np.divide(slope, bend, out=np.zeros_like(a), where=bend != 0.0)
        a = a - np.clip(step, -spacing, spacing)
    value = path.colatitude(a, 0)[0]
    for at, wrong in (
        (int(np.argmin(value)), np.min(value) <= 0.0),
        (int(np.argmax(value)), np.max(value) >= np.pi),
    ):
        if wrong:
            raise ValueError(
                f"the colatitude is {np.rad2deg(value[at]):.6g} deg at "
                f"{path.place(float(a[at]))}; it has to stay between 0 and 180 deg, both "
                "excluded"
            )


def _checked_points(points: ArrayLike, closed: bool) -> Floats:
    """Return points (m, 3) of exactly unit length; a closed curve's first one again."""
    given = np.array(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"the points have shape {given.shape}; they have to be (m, 3)")
    if len(given) < FEWEST_POINTS:
        raise ValueError(
            f"the curve has {len(given)} points; it needs at least {FEWEST_POINTS}"
        )
    size = np.sqrt(_dot(given, given))
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
    count = len(given) - int(closed)
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


def _quintic(knots: Floats, points: Floats, closed: bool) -> "BSpline":
    """Return the quintic spline through points (m, 3) at knots (m,), periodic if closed."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(knots, points, k=5, bc_type="periodic" if closed else None)


def _check_simple(path: _SplinePath) -> None:
    """Raise ValueError if a closed curve through points crosses or touches itself.

    Looks at a polyline of great-circle arcs, at least 8 between successive points.
    Arcs can meet only where their middles are nearer than half their lengths together;
    a tree finds those pairs, long arcs first so that each search has one radius.
    """
    from scipy.spatial import cKDTree

    count = len(path.knots) - 1
    parts = max(8, -(-400 // count))
    u = path.knots[:-1, None] + np.diff(path.knots)[:, None] * (np.arange(parts) / parts)
    x = path.spline(u.ravel())
    a = x / np.sqrt(_dot(x, x))[:, None]
    b = np.roll(a, -1, axis=0)
    middle, length = 0.5 * (a + b), np.sqrt(_dot(b - a, b - a))
    size = np.floor(np.log2(length))
    total = len(a)
    for each in np.unique(size):
        these, shorter = np.flatnonzero(size == each), np.flatnonzero(size <= each)
        found = cKDTree(middle[shorter]).query_ball_point(middle[these], 2.0 ** (each + 1))
        i = np.repeat(these, [len(row) for row in found])
        j = shorter[np.concatenate([np.asarray(row, dtype=int) for row in found])]
        apart = np.minimum((i - j) % total, (j - i) % total) > 1
        gap = middle[i] - middle[j]
        close = np.sqrt(_dot(gap, gap)) <= 0.5 * (length[i] + length[j]) * (1.0 + 1e-9)
        i, j = i[apart & close], j[apart & close]
        met = _straddle(a[i], b[i], a[j], b[j]) & _straddle(a[j], b[j], a[i], b[i])
        if np.any(met):
            at = int(np.argmax(met))
            first, second = sorted((int(i[at]) // parts, int(j[at]) // parts))
            raise ValueError(
                f"the closed curve meets itself: between points {first + 1} and "
                f"{(first + 1) % count + 1} and between points {second + 1} and "
                f"{(second + 1) % count + 1}"
            )


def _straddle(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return where c and d (n, 3) are not strictly on one side of the circle a, b."""
    normal = cross(a, b)
    normal = normal / np.sqrt(_dot(normal, normal))[:, None]
    at_c, at_d = _dot(normal, c), _dot(normal, d)
    return np.asarray(
        (at_c * at_d <= 0.0) | (np.abs(at_c) <= _TOUCH) | (np.abs(at_d) <= _TOUCH)
    )
