"""A whole mechanism in balls, link by link: orientations, gaps of the loops, Jacobian.

All functions take the pair variables as balls, or as power series in whatever moves.

Profiles of contact pairs are curves as a mechanism declares them. Angles, radii and
coefficients are taken as the float64 numbers they are given by, and directions are made
unit vectors. A profile through points is the quintic spline that
`spherekit.geometry.profile_curve` lays through them: its float64 knots and coefficients are
what is declared. No curvature occurs here: curves give places and tangents only, and their
derivatives are those of power series.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, zip_longest
from math import factorial

import numpy as np
from numpy.polynomial.polynomial import polyval

from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.errors import EngineError
from spherekit.geometry.parametric_curve import SplinePath
from spherekit.geometry.profile_curve import spline_through
from spherekit.mechanism.elements import PoseGeometry, Profile
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_frames import (
    Frames,
    axes_about,
    declared_frames,
    exact,
    exactly,
    revolute,
    unit,
)
from spherekit.proof.balls import (
    Ball,
    coefficient,
    floats,
    library,
    middles,
    pi,
    precision,
    series,
    sine_cosine,
    terms,
)
from spherekit.status import Status

MOST_PANELS = 10_000

Curve = Callable[[Array], Array]
"""Frames (n, 3, 3), columns t, n = p x t, p, of a curve at arc lengths (n,) rad."""
Path = Callable[[Array], tuple[Array, Array]]
"""Points (n, 3) and their derivatives by a parameter (n,) of its own."""


def harmonic(parts: Array, angles: Array) -> Array:
    """Return (n, 3, 3) parts[0] + parts[1] cos + parts[2] sin of angles (n,) rad."""
    sine, cosine = (x[:, None, None] for x in sine_cosine(angles))
    return parts[0] + parts[1] * cosine + parts[2] * sine


def ball_curve(profile: Profile, backwards: bool = False) -> Curve:
    """Return the curve of a profile in balls of the present precision.

    Backwards it runs from its end, or a closed one from its start.
    """
    frame, end = _curve(profile, precision())
    return (lambda s: frame(end - s) * [-1, -1, 1]) if backwards else frame


@lru_cache(maxsize=32)
def _curve(profile: Profile, _: int) -> tuple[Curve, Ball]:
    """Return a curve, and its length if it is open, else 0."""
    if profile.kind == "points":
        path, _table = spline_through(np.array(profile.points), profile.closed)
        return _by_arc_length(_spline(path), exactly(path.knots), profile.closed)
    axes = x, y, z = axes_about(unit(exactly(profile.centre or ())))
    if profile.kind not in ("circle", "great_circle"):
        wave = _wave(axes, exactly(profile.cosines), exactly(profile.sines))
        return _by_arc_length(wave, exactly([0.0, 2.0]) * pi(), True)
    sine, cosine = exactly([1.0, 0.0])
    if profile.kind == "circle":
        sine, cosine = exact(profile.radius or 0.0).sin_cos()
    even, odd = [y, -cosine * x, sine * x], [-x, -cosine * y, sine * y]
    parts = np.array([[0 * z, sine * z, cosine * z], even, odd]).swapaxes(1, 2)
    return lambda s: harmonic(parts, s / sine), exact(0.0)


def _by_arc_length(path: Path, edges: Array, closed: bool) -> tuple[Curve, Ball]:
    """Return a path, analytic between `edges` of its parameter, by its arc length.

    The parameter is a power series of the arc length from each of `starts` on, which are
    dense enough for the series to have all digits; each is the arc length's reversed.
    """
    digits = precision()
    count = 8 + digits // 3
    starts: list[Ball] = [exact(0.0)]
    pieces: list[list[Ball]] = []
    with terms(count):
        for low, high in pairwise(edges):
            while floats(high - low) > 0.0:
                if len(pieces) > MOST_PANELS:
                    raise EngineError(
                        "the arc length of a profile does not converge; give its "
                        "points more evenly"
                    )
                on = series(*np.array([[low, 1, *[0] * (count - 2)]]).T)
                arc = lengths(path(on)[1]).item().integral()
                ahead, back = (
                    [x[k].mid() for k in range(count)] for x in (arc, arc.reversion())
                )
                width = min(1.0, _reach(ahead, digits) / float(high - low))
                while True:
                    end = low + (high - low) * width if width < 1.0 else high
                    way = polyval(end - low, ahead).mid()
                    if width == 0.0 or float(way) < _reach(back, digits):
                        break
                    width *= 0.7
                starts.append(starts[-1] + way)
                pieces.append([low, *back[1:]])
                low = end.mid()
    begun, length = np.array(starts), starts[-1]
    table: Array = np.array(pieces)
    near = floats(begun)

    def frame(s: Array) -> Array:
        if closed:
            s = s - exactly(np.floor(floats(coefficient(s, 0)) / near[-1])) * length
        panel = np.searchsorted(near[1:-1], floats(coefficient(s, 0)), side="right")
        point, rate = path(polyval(s - begun[panel], table[panel].T, tensor=False))
        tangent = rate / lengths(rate)[:, None]
        return np.stack([tangent, np.cross(point, tangent), point], axis=-1)

    return frame, exact(0.0) if closed else length


def _reach(coefficients: list[Ball], digits: int) -> float:
    """Return how far from its centre a series has all digits, from its last terms."""
    count = len(coefficients)
    with np.errstate(divide="ignore"):
        logs = np.log(np.abs(floats(np.array(coefficients[-4:]))))
    logs = -(digits * np.log(2.0) + logs) / np.arange(count - 4, count)
    return np.exp(np.min(logs)) * 0.9


def _wave(axes: Array, even: Array, odd: Array) -> Path:
    """Return a curve by its azimuth about the third of `axes`, from its colatitude."""
    x, y, z = axes

    def at(u: Array) -> tuple[Array, Array]:
        colatitude, slope = 0 * u, 0 * u
        for wave, (a, b) in enumerate(zip_longest(even, odd, fillvalue=0)):
            sine, cosine = sine_cosine(wave * u)
            colatitude = colatitude + (a * cosine + b * sine)
            slope = slope + wave * (b * cosine - a * sine)
        (sine, cosine), (s, c) = (
            (part[:, None] for part in sine_cosine(angle)) for angle in (colatitude, u)
        )
        outward, along = c * x + s * y, c * y - s * x
        rate = slope[:, None] * (cosine * outward - sine * z) + sine * along
        return cosine * z + sine * outward, rate

    return at


def _spline(path: SplinePath) -> Path:
    """Return the radial projection of a quintic spline in space, by de Boor's algorithm."""
    degree, control = path.spline.k, exactly(path.spline.c)
    places: Floats = path.spline.t

    def at(u: Array) -> tuple[Array, Array]:
        inner = places[degree + 1 : len(control)]
        first = np.searchsorted(inner, floats(coefficient(u, 0)), side="right")
        points = control[first + np.arange(degree + 1)[:, None]]
        knots = exactly(places[first + np.arange(1, 2 * degree + 1)[:, None], None])
        for level in range(degree):
            low, high = knots[level:degree], knots[degree : 2 * degree - level]
            slope = np.diff(points, axis=0) / (high - low)
            points = points[:-1] + (u[:, None] - low) * slope
        (x,), (rate,) = points, degree * slope
        size = lengths(x)[:, None]
        point = x / size
        return point, (rate - np.sum(point * rate, axis=1, keepdims=True) * point) / size

    return at


def lengths(vectors: Array) -> Array:
    """Return lengths (n,) of vectors (n, 3)."""
    return np.sqrt(np.sum(vectors * vectors, axis=1))


TOUCHING_STEPS = 60
STEPS = 40
"""Most steps of Newton's method."""
ROUNDING = 1e3
"""Steps below this many roundings times the conditioning are rounding."""
CONTRACTION = 0.125
"""Newton's second step may be this part of the first; else other solutions are near."""
SINGULAR = 1.0 / 64.0
"""A matrix whose condition times rounding is more has less than full column rank."""

Turn = Callable[[Array], Array]
"""Of the variables (n, m) of a pair: rotations (n, 3, 3) of its second link in the first's
axes, or vectors (n, 3) in these."""


def _revolute(first: Array, second: Array) -> tuple[Turn, Turn]:
    """Return how an R pair turns, and its axis, by its frames in both links."""
    parts = revolute(first, second)
    return (
        lambda values: harmonic(parts, values[:, 0]),
        lambda values: np.broadcast_to(first[2], (len(values), 3)),
    )


def _contact(
    curves: Sequence[Curve], variables: tuple[int, int], start: Array
) -> tuple[Turn, Turn]:
    """Return how a contact pair turns, and where its links touch.

    The frames of two curves agree at the contact. Each is run along by the variable of its
    number in `variables`, from its `start` (2,) on: in rolling both by the same one.
    """

    def frame(side: int, values: Array) -> Array:
        return curves[side](values[:, variables[side]] + start[side])

    return (
        lambda values: frame(0, values) @ frame(1, values).swapaxes(1, 2),
        lambda values: frame(0, values)[:, :, 2],
    )


def _touching(curves: Sequence[Curve], s: Array) -> Array:
    """Return the arc lengths (2,) near a start at which aligned links touch.

    Least squares, as profiles may miss each other by what the float64 geometry allows.
    """
    turn, _ = _contact(curves, (0, 1), exactly(np.zeros(2)))
    last = np.inf
    for _ in range(TOUCHING_STEPS):
        (miss,) = skew_part(turn(s[None]))
        (inverse,), _ = left_inverse(_vectors(turn, s[None]).swapaxes(1, 2))
        step = inverse @ miss
        s = middles(s - step)
        size = np.max(np.abs(floats(step)))
        if not size < last / 2:
            break
        last = size
    return s


def _vectors(turn: Turn, values: Array) -> Array:
    """Return the vectors (n, m, 3) of a pair's variables in the first link's axes."""
    vectors = []
    for way in exactly(np.eye(values.shape[1])):
        moving = series(values, np.broadcast_to(way, values.shape))
        vectors += turning_rates(turn(moving), 1)
    return np.stack(vectors, axis=1)


def _joints(mechanism: Mechanism, frames: Frames) -> list[tuple[Turn, Turn]]:
    """Return how the pairs of a mechanism turn, and their axes or contact points.

    Which axes a zero direction is taken from, and near which place two profiles touch,
    is read off the float64 geometry; every number is computed anew.
    """
    made = []
    for pair, joint in zip(mechanism.pairs, make_joints(mechanism), strict=True):
        if pair.profiles is None:
            made.append(_revolute(*frames[pair.name]))
            continue
        one, other = pair.profiles
        curves = ball_curve(one), ball_curve(other, pair.contact == "external")
        first, second = joint.contact_profiles
        start = exactly([first.start, second.start])
        if joint.rolling_variables and isinstance(mechanism.geometry, PoseGeometry):
            start = _touching(curves, start)
        made.append(_contact(curves, (first.variable, second.variable), start))
    return made


@dataclass(frozen=True)
class Closed:
    """Configurations (k, variables) that Newton's method reached from starts.

    `inverse` (k, free, equations) is that of the Jacobian's columns of the `free`
    variables, `condition` (k,) its condition, and `residual` by how much loops stay open.
    `distance` is the way from the start, `wild` whether other solutions may be as near, and
    `status` is OK, NOT_CONVERGED or AT_SINGULARITY.
    """

    values: Array
    free: list[int]
    inverse: Array
    condition: Floats
    residual: Floats
    distance: Floats
    wild: Bools
    status: SmallIntegers


class Linkage:
    """The links of a mechanism placed one after another from the ground.

    Every link is placed once, across the pair that reaches it first; each further pair
    closes a loop, which is open by the skew part of the rotation left over.
    """

    def __init__(self, mechanism: Mechanism, frames: Frames | None = None) -> None:
        self.mechanism, ends = mechanism, mechanism.ends
        joints = _joints(mechanism, frames or declared_frames(mechanism))
        self._joints = [
            (*joint, mechanism.variables_of(pair), ends[pair][0])
            for pair, joint in enumerate(joints)
        ]
        self._way = find_spanning_tree(ends)
        self._chords = np.setdiff1d(range(len(joints)), [pair for pair, *_ in self._way])
        ways = np.zeros((len(mechanism.links), len(joints)))
        for pair, parent, child in self._way:
            ways[child] = ways[parent]
            ways[child, pair] = 1.0 if ends[pair][0] == parent else -1.0
        one, other = np.array(ends)[self._chords].T
        passes = np.eye(len(joints))[self._chords] + ways[one] - ways[other]
        owners = mechanism.variable_owners
        # the sense in which the way to a link, or a loop, passes the pair of a variable
        self._ways, self._passes = ways[:, owners], passes[:, owners]

    def place(self, values: Array) -> tuple[Array, Array]:
        """Return link orientations (n, links, 3, 3), and by how much the loops stay open.

        At all pair variables (n, variables); gaps (n, 3 loops) rad.
        """
        turns = [turn(values[:, columns]) for turn, _, columns, _ in self._joints]
        placed = {0: np.broadcast_to(exactly(np.eye(3)), (len(values), 3, 3))}
        for pair, parent, child in self._way:
            turn = turns[pair]
            if self.mechanism.ends[pair][0] == child:
                turn = turn.swapaxes(1, 2)
            placed[child] = placed[parent] @ turn
        gaps = [exactly(np.zeros((len(values), 0)))]
        for pair in self._chords:
            a, b = self.mechanism.ends[pair]
            gaps.append(skew_part(placed[a] @ turns[pair] @ placed[b].swapaxes(1, 2)))
        links = np.stack([placed[link] for link in range(len(placed))], axis=1)
        return links, np.concatenate(gaps, axis=1)

    def axes(self, values: Array, placed: Array) -> Array:
        """Return (n, pairs, 3): the axis of each R pair, the contact point of others."""
        return np.stack(
            [
                np.matvec(placed[:, link], axis(values[:, columns]))
                for _, axis, columns, link in self._joints
            ],
            axis=1,
        )

    def vectors(self, values: Array, placed: Array) -> Array:
        """Return the variables' vectors (n, variables, 3) in ground axes, of balls.

        A variable's vector is the angular velocity of its pair's second link relative to
        the first per unit rate.
        """
        vectors = []
        for pair, (turn, axis, columns, link) in zip(
            self.mechanism.pairs, self._joints, strict=True
        ):
            given = values[:, columns]
            made = axis(given)[:, None] if pair.profiles is None else _vectors(turn, given)
            vectors.append(made @ placed[:, link].swapaxes(1, 2))
        return np.concatenate(vectors, axis=1)

    def velocities(self, vectors: Array, rates: Array) -> Array:
        """Return angular velocities (n, links, 3) relative to the ground, in its axes.

        At `vectors` (n, variables, 3) and rates (n, variables) of the variables.
        """
        return self._ways @ (vectors * rates[:, :, None])

    def jacobian(self, vectors: Array) -> Array:
        """Return (n, 3 loops, variables): gaps change by it times the variables' rates."""
        moved = self._passes[:, None] * vectors.swapaxes(1, 2)[:, None]
        return moved.reshape(len(vectors), 3 * len(self._passes), vectors.shape[1])

    def closed(self, start: Array, held: Sequence[int], eps: float) -> Closed:
        """Return the solutions nearest to starts (k, variables), some of which are held.

        Numbers are rounded to `eps`. A step ends the iteration when it is rounding: no
        longer shrinking, and small against the conditioning.
        """
        k, count = start.shape
        free = [v for v in range(count) if v not in held]
        values, last = start.copy(), np.full(k, np.inf)
        status = np.full(k, Status.NOT_CONVERGED, dtype=np.int8)
        going, sizes = np.ones(k, dtype=bool), []
        while True:
            placed, gaps = self.place(values)
            jacobian = self.jacobian(self.vectors(values, placed))
            inverse, condition = left_inverse(jacobian[:, :, free])
            change = -np.matvec(inverse, gaps)
            size = largest(change)
            rounding = ROUNDING * eps * condition
            sizes.append(size)
            ended = (size <= rounding) & ((size <= 4 * eps) | (size >= last / 2))
            status[going & ended] = Status.OK
            status[going & ~np.isfinite(size)] = Status.AT_SINGULARITY
            going &= ~ended & (size <= 1.0)
            if len(sizes) > STEPS or not np.any(going):
                break
            last = size
            values[:, free] = middles(values[:, free] + np.where(going[:, None], change, 0))
        wild = sizes[:2][-1] > np.maximum(rounding, CONTRACTION * sizes[0])
        off = largest(gaps), largest(values - start)
        return Closed(values, free, inverse, condition, *off, wild, status)

    def motion(self, at: Closed, moved: int, order: int) -> list[Array]:
        """Return the coefficients (k, variables) of all variables' series in one.

        At closed configurations, in which all variables but those that are held and the
        moved one are free. The coefficient of each order solves linear equations with the
        same matrix.
        """
        coefficients = [at.values, *exactly(np.zeros((order, *at.values.shape)))]
        coefficients[1][:, moved] = exact(1.0)
        for power in range(1, order + 1):
            _, gaps = self.place(series(*coefficients[: power + 1]))
            open_ = coefficient(gaps, power)
            coefficients[power][:, at.free] = -np.matvec(at.inverse, open_)
        return coefficients


def largest(values: Array) -> Floats:
    """Return the largest size (k,) in each row of values (k, m)."""
    return np.max(np.abs(floats(values)), axis=1, initial=0.0)


def turning_rates(placed: Array, order: int) -> list[Array]:
    """Return w, dw, ddw (..., 3) so far, of series (..., 3, 3) of rotations."""
    parts = [coefficient(placed, power) for power in range(order + 1)]
    rates = []
    for power in range(order):
        spins = [
            (k + 1) * parts[k + 1] @ parts[power - k].swapaxes(-1, -2)
            for k in range(power + 1)
        ]
        rates.append(factorial(power) * skew_part(np.sum(spins, axis=0)))
    return rates


def skew_part(a: Array) -> Array:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3)."""
    twice = a - a.swapaxes(-1, -2)
    return np.stack([twice[..., 2, 1], twice[..., 0, 2], twice[..., 1, 0]], axis=-1) / 2


def left_inverse(matrices: Array) -> tuple[Array, Floats]:
    """Return the pseudo-inverses (n, k, m) of matrices (n, m, k) of full column rank.

    And their conditions (n,) in Frobenius norms, 1 at least. NaN where a matrix has less.
    By the normal equations, with more than twice the digits that they lose.
    """
    flint = library()
    bits, (n, m, k) = precision(), matrices.shape
    inverses = np.full((n, k, m), flint.arb.nan())
    condition = np.full(n, np.nan)
    for row, given in enumerate(matrices):
        with flint.ctx.workprec(2 * bits + 64):
            a = flint.arb_mat(m, k, list(given.ravel())).mid()
            across = a.transpose()
            try:
                inverse = ((across * a).inv().mid() * across).mid()
            except ZeroDivisionError:
                continue
        made = np.reshape(inverse.entries(), (k, m))
        size = np.linalg.norm(floats(given)) * np.linalg.norm(floats(made))
        if size * 2.0**-bits < SINGULAR:
            inverses[row], condition[row] = made, np.maximum(size, 1.0)
    return inverses, condition
