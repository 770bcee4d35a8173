"""The equations of a mechanism: the arc of each link that is put on two axes.

f = U . W - cos(arc), with U and W the axes of the link's two pairs in the links placed
before, is a polynomial in the cosines and sines of the angles. Every placed link turns
another one by a rotation about a fixed axis, of norm 1 as are all its derivatives by the
angle; a link put on two axes contributes a matrix of known norm. So the derivatives of f
of any order are bounded by one constant for each equation, for all configurations at once,
real ones or with imaginary parts of the angles up to a bound.

Products of matrices with their derivatives by some variables, of floats or of balls.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import PlanError
from spherekit.proof.balls import (
    UNIT,
    Ball,
    BallMatrix,
    Balls,
    Frame,
    complex_ball,
    exact,
    lower,
    matrix,
    middle,
    upper,
)
from spherekit.proof.construction import Across, Construction, Onto, Ranks
from spherekit.proof.gears import Written
from spherekit.proof.harmonics import MOST_NODES, Harmonics
from spherekit.sphere.rotation import Floats

Jet = Mapping[tuple[int, ...], Any]
"""A matrix under (), its derivatives under (j,) and (j, l) with j <= l; zero if missing."""


class Arithmetic(Protocol):
    """What jets are computed in."""

    def times(self, one: Any, other: Any) -> Any:
        """Return the matrix product."""

    def cross(self, one: Any, other: Any) -> Any:
        """Return the vector product of columns."""

    def dot(self, one: Any, other: Any) -> Any:
        """Return the product of columns without conjugation, 1 x 1."""


@final
class Batches:
    """Arrays (n, 3, 3) and (n, 3, 1) of floats."""

    def times(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        return np.asarray(one @ other)

    def cross(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        ax, ay, az = np.moveaxis(one[..., 0], -1, 0)
        bx, by, bz = np.moveaxis(other[..., 0], -1, 0)
        rows = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
        return np.stack(rows, axis=-1)[..., None]

    def dot(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        return np.asarray(np.swapaxes(one, -1, -2) @ other)


@final
class Matrices:
    """Matrices of balls."""

    def times(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        return one * other

    def cross(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        ax, ay, az = one.entries()
        bx, by, bz = other.entries()
        return matrix([[ay * bz - az * by], [az * bx - ax * bz], [ax * by - ay * bx]])

    def dot(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        return one.transpose() * other


def product(one: Jet, other: Jet, times: Any, order: int) -> Jet:
    """Return the jet of a bilinear product, with derivatives up to an order of 0 to 2."""
    out: dict[tuple[int, ...], Any] = {}
    for a, left in one.items():
        for b, right in other.items():
            if len(a) + len(b) > order:
                continue
            key = tuple(sorted(a + b))
            term = times(left, right)
            if a and a == b:
                term = term + term
            out[key] = out[key] + term if key in out else term
    return out


def total(*jets: Jet) -> Jet:
    """Return the sum of jets."""
    out: dict[tuple[int, ...], Any] = {}
    for jet in jets:
        for key, value in jet.items():
            out[key] = out[key] + value if key in out else value
    return out


def values_and_slopes(jets: list[Jet], variables: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return values (n, k) and slopes (n, k, v) of many configurations."""
    values = np.stack([jet[()] for jet in jets], axis=1)
    slopes = np.zeros((*values.shape, variables), dtype=values.dtype)
    for row, jet in enumerate(jets):
        for column in range(variables):
            if (column,) in jet:
                slopes[:, row, column] = jet[(column,)]
    return values, slopes


SHORTEST = 1e-6
"""Least sine of the arc of a link that is put on two axes: else it can spin there."""


@final
@dataclass(frozen=True)
class Turning:
    """How a link turns in the one before: still + cos(angle) even + sin(angle) odd."""

    variable: int
    parts: tuple[Any, Any, Any]


@final
@dataclass(frozen=True)
class Putting:
    """A link put on axes u and w of two others; `rows` take its axes to coordinates.

    Its orientation is U a + W b + (U x W) n, with U and W the axes where they are and a, b,
    n the `rows`. `cosine` is that of its arc; `sine` is a lower bound.
    """

    u: Any
    w: Any
    rows: tuple[Any, Any, Any]
    cosine: Any
    sine: float


@final
@dataclass(frozen=True)
class Bounds:
    """Bounds of f of each equation at real angles, (equations,) each.

    All derivatives of order k are at most `constant` times the k-th power of `degrees`;
    the float64 values are off by at most `error` times that. `degrees` is
    (equations, variables).
    """

    constant: Floats
    error: Floats
    degrees: Floats


@final
class Equations:
    """The equations of a mechanism in the arithmetic of balls of the present precision.

    Raises
    ------
    PlanError
        If a link that is put on two axes has an arc of 0 or 180 degrees.
    """

    def __init__(self, written: Written, construction: Construction) -> None:
        self.written, self.construction = written, construction
        self.ranks = Ranks(construction)
        self.unknowns = construction.unknowns
        self.variables = len(construction.pairs)
        self.frames = written.frames()
        self.offsets = self._offsets()
        self.parts: dict[int, Turning | Putting] = {}
        for step in construction.steps:
            made = self._turning(step) if isinstance(step, Across) else self._putting(step)
            self.parts[step.link] = made
        self._carrying = {
            above for link in self.ranks.parent for above in self.ranks.way(link)[1:]
        } | {p for step in construction.equations for p in step.parents}

    def frame(self, pair: int, link: int) -> Frame:
        """Return the frame of a pair in one of its links."""
        side = self.written.structure.ends[pair].index(link)
        return self.frames[pair][side]

    def _offsets(self) -> dict[int, Ball]:
        """Return the angles (rad) at an input of 0 of pairs that turn with its variable."""
        followers = self.written.structure.followers
        if self.construction.followers or not followers:
            return {}
        _, *angles = self.written.given([exact(0.0)])
        return dict(zip(followers, angles, strict=True))

    def _turning(self, step: Across) -> Turning:
        one = matrix(self.frame(step.pair, step.parent).T)
        other = matrix(self.frame(step.pair, step.link))
        ahead = self.written.structure.ends[step.pair][0] == step.parent
        sense = 1 if ahead else -1
        parts = ([0, 0, 0, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 1, 0, 0, 0, 0])
        odd = [0, -sense, 0, sense, 0, 0, 0, 0, 0]
        still, even, turned = (
            one * matrix([row[:3], row[3:6], row[6:]]) * other for row in (*parts, odd)
        )
        if step.pair in self.offsets:
            s, c = complex_ball(self.offsets[step.pair]).sin_cos()
            even, turned = even * c + turned * s, turned * c - even * s
        return Turning(step.variable, (still, even, turned))

    def _putting(self, step: Onto) -> Putting:
        a, b = (self.frame(pair, step.link)[2] for pair in step.pairs)
        normal = np.cross(a, b)
        square = normal @ normal
        sine = float(np.sqrt(lower(square)) * (1 - 8 * UNIT))
        if not sine > SHORTEST:
            structure = self.written.structure
            raise PlanError(
                f"{structure.name}: link {structure.links[step.link]} has an arc of about "
                "0 or 180 deg between two pairs, about which it could spin; nothing can "
                "be proven of it"
            )
        rows = [
            matrix([vector / square])
            for vector in (np.cross(b, normal), np.cross(normal, a), normal)
        ]
        axes = [
            matrix(self.frame(pair, parent)[2:].T)
            for pair, parent in zip(step.pairs, step.parents, strict=True)
        ]
        return Putting(axes[0], axes[1], (rows[0], rows[1], rows[2]), a @ b, sine)

    def at(self, places: Sequence[Ball], order: int = 1) -> list[Jet]:
        """Return the jets of f of each equation at balls of all variables."""
        return self._placed(places, order).values

    def arrays(self, places: Sequence[Ball], order: int = 1) -> list[Balls]:
        """Return f (k,), and its derivatives (k, v), (k, v, v), at balls of variables."""
        jets, zero, count = self.at(places, order), complex_ball(0j), self.variables
        arrays = []
        for power in range(order + 1):
            array = np.full((len(jets), *[count] * power), zero, dtype=object)
            for jet, derivatives in zip(jets, array, strict=True):
                for key in (key for key in jet if power and len(key) == power):
                    derivatives[key] = derivatives[key[::-1]] = jet[key][0, 0]
            arrays.append(array)
        arrays[0][:] = [jet[()][0, 0] for jet in jets]
        return arrays

    def orientations(self, places: Sequence[Ball], order: int = 0) -> dict[int, Jet]:
        """Return the jets of all links' orientations in the root, at balls of variables."""
        return self._placed(places, order).orientations()

    def _placed(self, places: Sequence[Ball], order: int) -> "_Placing":
        pairs = [complex_ball(place).sin_cos() for place in places]
        turns = [(cosine, sine) for sine, cosine in pairs]
        return _Placing(self, Matrices(), self.parts, turns, order)

    @cached_property
    def floats(self) -> "FloatEquations":
        """The same equations in float64, with bounds of what that is off by."""
        return FloatEquations(self)

    @cached_property
    def real(self) -> "Harmonics | Placed":
        """The same equations at real angles only, which is quicker: coefficients if few."""
        degrees = self.construction.degrees
        few = np.max(np.prod(2.0 * degrees + 1.0, axis=1)) <= MOST_NODES
        return Harmonics(degrees, self._values) if few else Placed(self.floats)

    def _values(self, angles: Sequence[Ball]) -> list[Ball]:
        """Return f of each equation at real angles."""
        return [jet[()][0, 0].real for jet in self.at(angles, 0)]

    def norms(self, stretch: Floats) -> tuple[dict[int, float], Floats]:
        """Return bounds of the links' orientations and of f of each equation (equations,).

        For angles whose imaginary parts are at most the log of `stretch` (variables,), 1
        for real angles. Orientations are those in the link that `ranks` say.
        """
        factors: dict[int, float] = {}
        products = []
        for step in self.construction.steps:
            if isinstance(step, Across):
                factors[step.link] = float(stretch[step.variable] ** abs(step.turns))
                continue
            one, other = (
                prod(factors[link] for link in way)
                for way in self.ranks.apart(*step.parents)[1:]
            )
            both = one * other
            sums = (one + other + both) * (1 + 16 * UNIT)
            factors[step.link] = sums / self._part(step.link).sine
            products.append(both)
        return factors, np.array(products) * (1 + 64 * UNIT)

    def _part(self, link: int) -> Putting:
        part = self.parts[link]
        assert isinstance(part, Putting)
        return part


def _constant(value: Any) -> Jet:
    return {(): value}


def _multiple(turn: tuple[Any, Any], times: int) -> tuple[Any, Any]:
    """Return cosine and sine of a multiple of an angle from those of the angle."""
    cosine, sine = turn
    if times == 0:
        return 0 * cosine + 1, 0 * sine
    c, s = cosine, sine
    for _ in range(abs(times) - 1):
        c, s = c * cosine - s * sine, s * cosine + c * sine
    return c, s if times > 0 else -s


@final
class _Placing:
    """Links placed at one configuration, or at many, with derivatives."""

    def __init__(
        self,
        equations: Equations,
        arithmetic: Arithmetic,
        parts: dict[int, Turning | Putting],
        turns: Sequence[tuple[Any, Any]],
        order: int,
    ) -> None:
        self.equations_of, self.arithmetic, self.order = equations, arithmetic, order
        self.parts, self.turns = parts, turns
        self.local: dict[int, Jet] = {}
        self.values: list[Jet] = []
        for step in equations.construction.steps:
            if isinstance(step, Across):
                self.local[step.link] = self._turned(step)
            else:
                self.local[step.link] = self._put(step)

    def orientations(self) -> dict[int, Jet]:
        """Return the jets of orientations in the root."""
        construction, times = self.equations_of.construction, self.arithmetic.times
        ranks = self.equations_of.ranks
        placed: dict[int, Jet] = {}
        for step in construction.steps:
            above = ranks.parent[step.link]
            local = self.local[step.link]
            if above == construction.root:
                placed[step.link] = local
            else:
                assert above is not None
                placed[step.link] = product(placed[above], local, times, self.order)
        return placed

    def _turned(self, step: Across) -> Jet:
        part = self.parts[step.link]
        assert isinstance(part, Turning)
        cosine, sine = _multiple(self.turns[step.variable], step.turns)
        still, even, odd = part.parts
        one = even * cosine + odd * sine
        jet: dict[tuple[int, ...], Any] = {(): still + one}
        if self.order > 0:
            jet[(step.variable,)] = (odd * cosine - even * sine) * step.turns
        if self.order > 1:
            jet[(step.variable, step.variable)] = -one * step.turns**2
        return jet

    def _put(self, step: Onto) -> Jet:
        part = self.parts[step.link]
        assert isinstance(part, Putting)
        arithmetic = self.arithmetic
        _, first, second = self.equations_of.ranks.apart(*step.parents)
        one, other = self._along(first, part.u), self._along(second, part.w)
        value = dict(product(one, other, arithmetic.dot, self.order))
        value[()] = value[()] - part.cosine
        self.values.append(value)
        if step.link not in self.equations_of._carrying and not self.whole:
            return {}
        third = product(one, other, arithmetic.cross, self.order)
        a, b, n = (_constant(row) for row in part.rows)
        times = arithmetic.times
        return total(
            product(one, a, times, self.order),
            product(other, b, times, self.order),
            product(third, n, times, self.order),
        )

    whole = True

    def _along(self, way: Sequence[int], axis: Any) -> Jet:
        """Return an axis of the first link of a way in the link that the way leads to."""
        jet: Jet = {(): axis}
        for link in way:
            jet = product(self.local[link], jet, self.arithmetic.times, self.order)
        return jet


@final
class FloatEquations:
    """Equations in float64 for many configurations at once, real or complex."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.parts: dict[int, Turning | Putting] = {}
        self._turned: dict[int, float] = {}
        self._put: dict[int, tuple[float, float, float, float]] = {}
        for link, part in equations.parts.items():
            if isinstance(part, Turning):
                made = [_floats(jet) for jet in part.parts]
                still, even, odd = (array for array, _ in made)
                self.parts[link] = Turning(part.variable, (still, even, odd))
                self._turned[link] = 3.0 * sum(miss for _, miss in made)
                continue
            (u, off_u), (w, off_w) = _floats(part.u), _floats(part.w)
            rows = [_floats(row) for row in part.rows]
            cosine = middle(part.cosine)
            off_rows = 2.0 * max(miss for _, miss in rows)
            off_cosine = upper(part.cosine - exact(cosine))
            self._put[link] = 2.0 * off_u, 2.0 * off_w, off_rows, off_cosine
            self.parts[link] = Putting(
                u, w, (rows[0][0], rows[1][0], rows[2][0]), cosine, part.sine
            )

    @cached_property
    def bounds(self) -> Bounds:
        """The bounds for real angles."""
        equations = self.equations
        factors, constant = equations.norms(np.ones(equations.variables))
        errors: dict[int, float] = {}
        off = []
        for step in equations.construction.steps:
            if isinstance(step, Across):
                rounding = 64 * UNIT * max(1, abs(step.turns))
                errors[step.link] = self._turned[step.link] + rounding
                continue
            off_u, off_w, off_rows, off_cosine = self._put[step.link]
            _, first, second = equations.ranks.apart(*step.parents)
            c_u, e_u = _carried(first, factors, errors, off_u)
            c_w, e_w = _carried(second, factors, errors, off_w)
            both = e_u * c_w + c_u * e_w + e_u * e_w + 32 * UNIT * c_u * c_w
            off.append(both + off_cosine + 8 * UNIT * (c_u * c_w + 1.0))
            sine = equations._part(step.link).sine
            error = (e_u + e_w + both) * (1.0 / sine + off_rows)
            sums = c_u + c_w + c_u * c_w
            errors[step.link] = error + sums * (off_rows + 64 * UNIT / sine)
        degrees = equations.construction.degrees.astype(float)
        return Bounds(constant, 2.0 * np.array(off), degrees)

    def at(self, turns: NDArray[Any], order: int) -> list[Jet]:
        """Return the jets, each entry (n,), at cosines and sines (n, variables, 2)."""
        pairs = [
            (turns[:, v, 0, None, None], turns[:, v, 1, None, None])
            for v in range(turns.shape[1])
        ]
        placing = _Placing(self.equations, Batches(), self.parts, pairs, order)
        return [
            {key: value[..., 0, 0] for key, value in jet.items()} for jet in placing.values
        ]


@final
class Placed:
    """Equations at real angles by placing the links, where coefficients are too many."""

    def __init__(self, equations: FloatEquations) -> None:
        self.floats, self.variables = equations, equations.equations.variables
        self.error = equations.bounds.error

    def first(self, turns: Floats) -> tuple[Floats, Floats]:
        """See `Harmonics`."""
        return values_and_slopes(self.floats.at(turns, 1), self.variables)

    def second(self, turns: Floats) -> tuple[Floats, Floats, Floats]:
        """See `Harmonics`."""
        jets = self.floats.at(turns[None], 2)
        values, slopes = values_and_slopes(jets, self.variables)
        curvatures = np.zeros((len(jets), self.variables, self.variables))
        for row, jet in enumerate(jets):
            for key, entry in jet.items():
                if len(key) == 2:
                    curvatures[row][key] = curvatures[row][key[::-1]] = entry[0]
        return values[0], slopes[0], curvatures


def _carried(
    way: Sequence[int], factors: dict[int, float], errors: dict[int, float], off: float
) -> tuple[float, float]:
    """Return the norm of an axis carried along a way, and its error in float64."""
    constant, error = 1.0, off + 4 * UNIT
    for link in way:
        c, e = factors[link], errors[link]
        error = e * constant + c * error + e * error + 32 * UNIT * c * constant
        constant = constant * c
    return constant, error


def _floats(balls: BallMatrix) -> tuple[Floats, float]:
    """Return a real matrix of balls in float64, and how far its entries are off."""
    rows = balls.tolist()
    made = np.array([[float(entry.real.mid()) for entry in row] for row in rows])
    miss = max(
        upper(entry.real - exact(float(near)))
        for row, nears in zip(rows, made, strict=True)
        for entry, near in zip(row, nears, strict=True)
    )
    return made, miss
