"""A whole mechanism in balls, link by link: orientations, gaps of the loops, Jacobian.

All functions take the pair variables as balls, or as power series in whatever moves.

Profiles of contact pairs as a mechanism declares them, in balls.

Angles, radii and coefficients are taken as the float64 numbers they are given by, and
directions are made unit vectors. A profile through points is the quintic spline that
`spherekit.sphere.profile` lays through them: its float64 knots and coefficients are what is
declared. No curvature occurs here: curves give places and tangents only, and their
derivatives are those of power series.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.model.gears import geometry_of
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry, Profile
from spherekit.proof.balls import (
    Ball,
    Frame,
    Frames,
    axes_about,
    coefficient,
    declared_frames,
    exactly,
    floats,
    library,
    middles,
    pi,
    precision,
    revolute,
    series,
    sine_cosine,
    square_root,
    terms,
    unit,
)
from spherekit.sphere.paths import SplinePath
from spherekit.sphere.profile import spline_through

MOST_PANELS = 10_000


def harmonic(parts: Array, angles: Array) -> Array:
    """Return (n, 3, 3) parts[0] + parts[1] cos + parts[2] sin of angles (n,) rad."""
    sine, cosine = (np.asarray(x)[:, None, None] for x in sine_cosine(angles))
    return parts[0] + parts[1] * cosine + parts[2] * sine


class BallCurve(ABC):
    """A curve on the unit sphere by its arc length, closed or open, `length` (rad) long."""

    length: Ball
    closed: bool

    @abstractmethod
    def frame(self, s: Array) -> Array:
        """Return frames (n, 3, 3), columns t, n = p x t, p, at arc lengths s (n,) rad."""

    def backwards(self, s: Array) -> Array:
        """Return frames run backwards: from the old end, or a closed one from its start."""
        made = self.frame(-s if self.closed else self.length - s)
        return made * np.array([-1.0, -1.0, 1.0])


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


class _Circle(BallCurve):
    """A circle about the third of `axes` with the sine and cosine of its radius."""

    closed = True

    def __init__(self, axes: Array, sine: Ball, cosine: Ball) -> None:
        (x, y, z), nothing = axes, exactly(np.zeros(3))
        self._sine, self.length = sine, 2 * pi() * sine
        still = [nothing, sine * z, cosine * z]
        even = [y, -cosine * x, sine * x]
        odd = [-x, -cosine * y, sine * y]
        self._parts = np.array([still, even, odd]).swapaxes(1, 2)

    def frame(self, s: Array) -> Array:
        return harmonic(self._parts, s / self._sine)


class _Path(ABC):
    """A curve in a parameter of its own; between its `edges` it is analytic."""

    edges: Array

    @abstractmethod
    def at(self, u: Array) -> tuple[Array, Array]:
        """Return points (n, 3) and their derivatives by u (n,)."""

    def speed(self, u: Array) -> Array:
        """Return |dp/du|."""
        return _length(self.at(u)[1])


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
        self._pieces: Array = np.array(pieces)

    def _expanded(self, u: Ball, count: int) -> tuple[list[Ball], list[Ball]]:
        """Return the coefficients of the arc length from u on, and of u by it."""
        zero, one = exactly([0.0, 1.0])
        start = (np.array([x]) for x in (u, one, *[zero] * (count - 2)))
        arc = self._path.speed(series(*start)).item().integral()
        ahead, back = ([x[k].mid() for k in range(count)] for x in (arc, arc.reversion()))
        return ahead, back

    def frame(self, s: Array) -> Array:
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


class _Fourier(_Path):
    """A colatitude about the third of `axes`; its parameter is the azimuth."""

    def __init__(
        self, axes: Array, cosines: tuple[float, ...], sines: tuple[float, ...]
    ) -> None:
        self._axes = axes
        self._even, self._odd = exactly(cosines), exactly(sines)
        self.edges = exactly([0.0, 2.0]) * pi()

    def at(self, u: Array) -> tuple[Array, Array]:
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

    def at(self, u: Array) -> tuple[Array, Array]:
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
        self, u: Array, span: Any, degree: int, knots: Array, control: Array
    ) -> Array:
        """Return a spline of a degree at u (n, 1) in spans (n,) by de Boor's algorithm."""
        points = [control[span - degree + r] for r in range(degree + 1)]
        for level in range(1, degree + 1):
            for r in reversed(range(level, degree + 1)):
                i = span - degree + r
                low, high = knots[i][:, None], knots[i + degree + 1 - level][:, None]
                share = (u - low) / (high - low)
                points[r] = (1 - share) * points[r - 1] + share * points[r]
        return np.asarray(points[degree])


def _length(vectors: Array) -> Array:
    """Return lengths (n,) of vectors (n, 3)."""
    return np.asarray(square_root(np.sum(vectors * vectors, axis=1)))


STEPS = 60
"""Most steps of Newton's method."""

SINGULAR = 1.0 / 64.0
"""A matrix whose condition times rounding is more has less than full column rank."""


Curve = Callable[[Array], Array]
"""Frames (n, 3, 3), columns t, n = p x t, p, of a curve at arc lengths (n,) rad."""


class _Joint(ABC):
    """A pair as declared, with the variables (n, m) of its own."""

    @abstractmethod
    def turn(self, values: Array) -> Array:
        """Return rotations (n, 3, 3) of the second link in the first's axes."""

    @abstractmethod
    def axis(self, values: Array) -> Array:
        """Return the axis, or the contact point, (n, 3) in the first link's axes."""

    def vectors(self, values: Array) -> Array:
        """Return the variables' vectors (n, m, 3) in the first link's axes, of balls."""
        vectors = []
        for column in range(values.shape[1]):
            moving = values.copy()
            one = exactly(np.ones(len(values)))
            moving[:, column] = series(values[:, column], one)
            vectors.append(turning_rates(self.turn(moving), 1)[0])
        return np.stack(vectors, axis=1)


class _Revolute(_Joint):
    """An R pair with its frames in both links."""

    def __init__(self, first: Frame, second: Frame) -> None:
        self._parts, self._axis = revolute(first, second), first[2]

    def turn(self, values: Array) -> Array:
        return harmonic(self._parts, values[:, 0])

    def axis(self, values: Array) -> Array:
        return np.broadcast_to(self._axis, (len(values), 3))

    def vectors(self, values: Array) -> Array:
        return self.axis(values)[:, None]


class _Contact(_Joint):
    """A contact pair: two curves, whose frames agree at the contact.

    Each is run along by the variable of its number in `variables`, from its `start` (2,)
    on: in rolling both by the same one.
    """

    def __init__(
        self, curves: Sequence[Curve], variables: tuple[int, int], start: Array
    ) -> None:
        self._curves, self._variables, self.start = curves, variables, start

    def turn(self, values: Array) -> Array:
        one, other = (self._frame(side, values) for side in (0, 1))
        return one @ other.swapaxes(1, 2)

    def axis(self, values: Array) -> Array:
        return self._frame(0, values)[:, :, 2]

    def _frame(self, side: int, values: Array) -> Array:
        return self._curves[side](values[:, self._variables[side]] + self.start[side])

    def touching(self) -> Array:
        """Return the arc lengths (2,) near the start at which aligned links touch.

        Least squares, as profiles may miss each other by what the float64 geometry allows.
        """
        free = _Contact(self._curves, (0, 1), exactly(np.zeros(2)))
        s, last = self.start, np.inf
        for _ in range(STEPS):
            miss = skew_part(free.turn(s[None]))
            inverse, _ = left_inverse(free.vectors(s[None]).swapaxes(1, 2))
            step = (inverse @ miss[..., None])[0, :, 0]
            s = middles(s - step)
            size = float(np.max(np.abs(floats(step))))
            if size == 0.0 or not size < last / 2:
                break
            last = size
        return s


def _joints(mechanism: Mechanism, frames: Frames) -> list[_Joint]:
    """Return the pairs of a mechanism, in their order.

    Which axes a zero direction is taken from, and near which place two profiles touch,
    is read off the float64 geometry; every number is computed anew.
    """
    made: list[_Joint] = []
    for pair, joint in zip(mechanism.pairs, geometry_of(mechanism).joints, strict=True):
        if pair.profiles is None:
            made.append(_Revolute(*frames[pair.name]))
            continue
        one, other = map(ball_curve, pair.profiles)
        curves = one.frame, other.backwards if pair.contact == "external" else other.frame
        tracks = joint.tracks
        start = exactly([track.start for track in tracks])
        contact = _Contact(curves, (tracks[0].variable, tracks[1].variable), start)
        if joint.rolled and isinstance(mechanism.geometry, PoseGeometry):
            contact.start = contact.touching()
        made.append(contact)
    return made


class Linkage:
    """The links of a mechanism placed one after another from the ground.

    Every link is placed once, across the pair that reaches it first; each further pair
    closes a loop, which is open by the skew part of the rotation left over.
    """

    def __init__(self, mechanism: Mechanism, frames: Frames | None = None) -> None:
        self.mechanism, ends = mechanism, mechanism.ends
        joints = _joints(mechanism, frames or declared_frames(mechanism))
        self._joints = [
            (joint, list(mechanism.variables_of(pair)), ends[pair])
            for pair, joint in enumerate(joints)
        ]
        self._way = spanning(ends)
        used = {pair for pair, _, _ in self._way}
        self._chords = [pair for pair in range(len(joints)) if pair not in used]
        ways = np.zeros((len(mechanism.links), len(joints)))
        for pair, parent, child in self._way:
            ways[child] = ways[parent]
            ways[child, pair] = 1.0 if ends[pair][0] == parent else -1.0
        passes = np.array([ways[a] - ways[b] for a, b in (ends[p] for p in self._chords)])
        passes = passes.reshape(len(self._chords), len(joints))
        passes[range(len(self._chords)), self._chords] += 1.0
        owners = list(mechanism.variable_owners)
        # the sense in which the way to a link, or a loop, passes the pair of a variable
        self._ways, self._passes = ways[:, owners], passes[:, owners]

    def place(self, values: Array) -> tuple[Array, Array]:
        """Return link orientations (n, links, 3, 3), and by how much the loops stay open.

        At all pair variables (n, variables); gaps (n, 3 loops) rad.
        """
        turns = [joint.turn(values[:, columns]) for joint, columns, _ in self._joints]
        placed = {0: np.broadcast_to(exactly(np.eye(3)), (len(values), 3, 3))}
        for pair, parent, child in self._way:
            turn = turns[pair]
            if self.mechanism.ends[pair][0] == child:
                turn = turn.swapaxes(1, 2)
            placed[child] = turn if parent == 0 else placed[parent] @ turn
        gaps = [exactly(np.zeros((len(values), 0)))]
        for pair in self._chords:
            a, b = self.mechanism.ends[pair]
            gaps.append(skew_part(placed[a] @ turns[pair] @ placed[b].swapaxes(1, 2)))
        orientations = np.stack([placed[link] for link in range(len(placed))], axis=1)
        return orientations, np.concatenate(gaps, axis=1)

    def vectors(self, values: Array, placed: Array) -> Array:
        """Return the variables' vectors (n, variables, 3) in ground axes, of balls.

        A variable's vector is the angular velocity of its pair's second link relative to
        the first per unit rate.
        """
        vectors = [
            joint.vectors(values[:, columns]) @ placed[:, ends[0]].swapaxes(1, 2)
            for joint, columns, ends in self._joints
        ]
        return np.concatenate(vectors, axis=1)

    def axes(self, values: Array, placed: Array) -> Array:
        """Return (n, pairs, 3): the axis of each R pair, the contact point of others."""
        axes = [
            (placed[:, ends[0]] @ joint.axis(values[:, columns])[..., None])[..., 0]
            for joint, columns, ends in self._joints
        ]
        return np.stack(axes, axis=1)

    def velocities(self, vectors: Array, rates: Array) -> Array:
        """Return angular velocities (n, links, 3) relative to the ground, in its axes.

        At `vectors` (n, variables, 3) and rates (n, variables) of the variables.
        """
        return self._ways @ (vectors * rates[:, :, None])

    def jacobian(self, vectors: Array) -> Array:
        """Return (n, 3 loops, variables): gaps change by it times the variables' rates."""
        moved = self._passes[:, None] * vectors.swapaxes(1, 2)[:, None]
        return np.asarray(
            moved.reshape(len(vectors), 3 * len(self._passes), vectors.shape[1])
        )

    def inverse(self, values: Array, free: Sequence[int]) -> tuple[Array, Floats, Array]:
        """Return the inverse of the Jacobian's free columns, its condition, and gaps."""
        placed, gaps = self.place(values)
        jacobian = self.jacobian(self.vectors(values, placed))[:, :, list(free)]
        return *left_inverse(jacobian), gaps

    def motion(
        self, values: Array, inverse: Array, free: Sequence[int], moved: int, order: int
    ) -> list[Array]:
        """Return the coefficients (k, variables) of all variables' series in one.

        At closed configurations (k, variables); `inverse` is that of the Jacobian's columns
        of the `free` variables, all but those that are held and the moved one. The
        coefficient of each order solves linear equations with the same matrix.
        """
        coefficients = [values, *(exactly(np.zeros(values.shape)) for _ in range(order))]
        coefficients[1][:, moved] = exactly(np.ones(len(values)))
        for power in range(1, order + 1):
            _, gaps = self.place(series(*coefficients[: power + 1]))
            open_ = coefficient(gaps, power)[..., None]
            coefficients[power][:, list(free)] = -(inverse @ open_)[..., 0]
        return coefficients


def turning_rates(placed: Array, order: int) -> list[Array]:
    """Return w, dw, ddw (..., 3) so far, of series (..., 3, 3) of rotations."""
    parts = [coefficient(placed, power) for power in range(order + 1)]
    rates = []
    for power in range(order):
        spin = sum(
            (k + 1) * parts[k + 1] @ parts[power - k].swapaxes(-1, -2)
            for k in range(power + 1)
        )
        rates.append((2 if power == 2 else 1) * skew_part(np.asarray(spin)))
    return rates


def skew_part(a: Array) -> Array:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3)."""
    turns = ((2, 1), (0, 2), (1, 0))
    return np.stack([(a[..., p, q] - a[..., q, p]) / 2 for p, q in turns], axis=-1)


def left_inverse(matrices: Array) -> tuple[Array, Floats]:
    """Return the pseudo-inverses (n, k, m) of matrices (n, m, k) of full column rank.

    And their conditions (n,) in Frobenius norms, 1 at least. NaN where a matrix has less.
    By the normal equations, with more than twice the digits that they lose.
    """
    flint = library()
    bits, (n, m, k) = precision(), matrices.shape
    inverses = np.full((n, k, m), flint.arb.nan(), dtype=object)
    condition = np.full(n, np.nan)
    for row, given in enumerate(matrices):
        with flint.ctx.workprec(2 * bits + 64):
            a = flint.arb_mat(m, k, list(given.ravel())).mid()
            across = a.transpose()
            try:
                inverse = ((across * a).inv().mid() * across).mid()
            except ZeroDivisionError:
                continue
        made = np.array(inverse.entries(), dtype=object).reshape(k, m)
        sizes = [np.linalg.norm(floats(matrix)) for matrix in (given, made)]
        size = max(float(np.prod(sizes)), 1.0)
        if size * 2.0**-bits < SINGULAR:
            inverses[row], condition[row] = made, size
    return inverses, condition
