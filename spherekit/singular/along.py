"""Rates and pole axes along a configuration curve, per unit of its arc length.

Per arc length every rate is finite, at the dead points of every pair too. The angular
velocity of link j relative to i is w u with u a unit vector along their pole; w is smooth
through its zeros, and there u is the limit that the derivative of w u points along.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import EPS
from spherekit.errors import PlanError
from spherekit.motion.arc_curve import ArcCurve, CurvePoints, bordered, bordered_condition
from spherekit.motion.loops import left_inverse
from spherekit.motion.motion import Motion, PositionAnalysis, motion_of
from spherekit.numeric.zeros import ArrayRows, Zeros, zeros
from spherekit.planning.plan import plan
from spherekit.planning.poles import Plan, Pole, pole_of
from spherekit.rates.sequence import PlannedPoles

NEAR_REST = 1e-6
"""Relative rates below this part of their derivative take its direction."""
TURNS = 0.7
"""Cosine of the angle by which an axis turns between two places, at most."""
SWING = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
"""Places about a near miss, in the length that its swing takes."""
MOST_HALVINGS = 24
AT_REST = 100.0
"""Relative rates below this times the bound of their rounding error vanish."""
KEPT = 16
"""Sets of places on a curve whose rates are kept: all poles are asked for at the same."""
FOLLOWED = 0.1
"""Axes with a larger error bound (rad) do not say where the pole is."""

Plans = dict[tuple[Pole, ...], Plan | None]
"""Plans by the poles they give, None where counting freedoms gives none."""


@dataclass(frozen=True)
class Axis:
    """Unit vectors (n, 3) along a pole, and error bounds (n,).

    NaN with an error of 1 where the links do not move relative to each other and nothing
    else says where their pole is.
    """

    unit: Floats
    error: Floats

    def or_better(self, other: "Axis") -> "Axis":
        """Return at each row the axis with the smaller error bound, in doubt this one."""
        take = other.error < self.error
        unit = np.where(take[:, None], other.unit, self.unit)
        return Axis(unit, np.where(take, other.error, self.error))


@dataclass(frozen=True)
class Sense:
    """Which way a pole's axis points along a curve: unit vectors (k, 3) at places s (k,).

    They turn little from one to the next. `lost` are intervals (m, 2) of s in which the
    axis could not be followed, however short the steps.
    """

    s: Floats
    units: Floats
    lost: Floats

    def signs(self, s: Floats, vectors: Floats) -> Floats:
        """Return +1 or -1 (n,): whether vectors (n, 3) at s (n,) point that way."""
        k = np.clip(np.searchsorted(self.s, s) - 1, 0, len(self.s) - 2)
        part = ((s - self.s[k]) / (self.s[k + 1] - self.s[k]))[:, None]
        there = (1.0 - part) * self.units[k] + part * self.units[k + 1]
        return np.where(np.sum(vectors * there, axis=1) < 0.0, -1.0, 1.0)


@dataclass(frozen=True)
class _Seen(ArrayRows):
    """A pole's axis in either sense and its rate vector (k, 3) at rising places s (k,)."""

    s: Floats
    unit: Floats
    w: Floats

    @property
    def turns(self) -> Floats:
        """(k - 1,) cosines of the angles between successive axes."""
        return np.sum(self.unit[1:] * self.unit[:-1], axis=1)

    @property
    def chain(self) -> Floats:
        """Signs (k,) with which each axis is turned to the side of the one before."""
        return np.cumprod(np.append(1.0, np.where(self.turns < 0.0, -1.0, 1.0)))


@dataclass(frozen=True)
class LinkRates:
    """First and second derivatives by the motion's parameter of a set of bodies.

    `w`, `dw`: (n, bodies, 3) angular velocity relative to body 0 and its derivative;
    `reciprocal_condition`: (n,) reciprocal condition of the equations, 0 where what loops
    stay open by leaves nothing of the rates or of their derivatives.
    """

    w: Floats
    dw: Floats
    reciprocal_condition: Floats

    def relative(self, i: int, j: int) -> tuple[Floats, Floats]:
        """Return w and dw (n, 3) of body j relative to body i."""
        return self.w[:, j] - self.w[:, i], self.dw[:, j] - self.dw[:, i]


class AlongCurve:
    """Rates and axes of the links of a mechanism along one of its configuration curves.

    Parameters
    ----------
    tracer
        The mechanism, with one freedom.
    curve
        One of its configuration curves.
    plans
        Plans of poles already made, which all curves share.
    """

    def __init__(self, tracer: PositionAnalysis, curve: ArcCurve, plans: Plans) -> None:
        self.tracer, self.curve = tracer, curve
        self.closure = curve.segments.closure
        self._senses: dict[Pole, Sense] = {}
        self._kept: dict[bytes, tuple[CurvePoints, Motion, LinkRates]] = {}
        self._plans = plans
        self._primary = tracer.mechanism.pole_pairs

    def points(self, s: Floats) -> CurvePoints:
        """Return the curve at s (n,)."""
        return self._moving(s)[0]

    def rates(self, s: Floats) -> LinkRates:
        """Return the rates of all links relative to the ground, by arc length."""
        return self._moving(s)[2]

    def vectors(self, s: Floats) -> Floats:
        """Return the vectors of the variables (n, variables, 3) in ground axes."""
        return self._moving(s)[1].vectors

    def _moving(self, s: Floats) -> tuple[CurvePoints, Motion, LinkRates]:
        """Return the velocity equations solved at s (n,); the last results are kept."""
        key = s.tobytes()
        if key not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.pop(next(iter(self._kept)))
            points = self.curve.at(s)
            motion = motion_of(self.tracer.solver, points.values)
            at = motion.linearisation
            w, dw = at.body_rates(points.tangents), at.body_rates(points.bends)
            dw += at.tree.body_rates(at.turned(w).vectors, points.tangents)
            equations = bordered(at.jacobian, points.tangents)
            condition = bordered_condition(equations, left_inverse(equations))
            self._kept[key] = points, motion, LinkRates(w, dw, condition)
        return self._kept[key]

    def axes(self, s: Floats, poles: Iterable[Pole]) -> dict[Pole, Axis]:
        """Return the axes of poles at s (n,), in either sense.

        By the great circles of the plan where those are well conditioned. Otherwise along
        the relative angular velocity, or its derivative where that vanishes: what has the
        least error bound.
        """
        wanted = tuple(dict.fromkeys(pole_of(*pole) for pole in poles))
        _, motion, rates = self._moving(s)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            out = {pole: _along_rate(rates, *pole) for pole in wanted}
            planned = self._plan(wanted)
            if planned is not None:
                sequence = PlannedPoles(planned, motion)
                for pole, axis in out.items():
                    error = np.minimum(np.nan_to_num(sequence.error[pole], nan=1.0), 1.0)
                    out[pole] = Axis(sequence.unit[pole].T, error).or_better(axis)
        return out

    def _plan(self, poles: tuple[Pole, ...]) -> Plan | None:
        """Return the plan for some poles; None where counting freedoms gives none."""
        if poles not in self._plans:
            try:
                by_rank = self.tracer.by_rank
                self._plans[poles] = plan(self.tracer.mechanism, poles, None, by_rank)
            except PlanError:
                self._plans[poles] = None
        return self._plans[poles]

    def oriented(self, s: Floats, poles: Iterable[Pole]) -> dict[Pole, Axis]:
        """Return the axes with senses that are continuous along the curve."""
        return {
            pole: Axis(
                self.sense(pole).signs(s, axis.unit)[:, None] * axis.unit, axis.error
            )
            for pole, axis in self.axes(s, poles).items()
        }

    def leaving(
        self, values: Floats, tangents: Floats, poles: Iterable[Pole]
    ) -> tuple[dict[Pole, Axis], LinkRates]:
        """Return axes and rates at configurations with given motions (n, variables).

        At a crossing of curves each of them is given by its tangent. Second derivatives
        are not known there: NaN.
        """
        motion = motion_of(self.tracer.solver, values)
        w = motion.linearisation.body_rates(tangents)
        rates = LinkRates(w, np.full_like(w, np.nan), np.ones(len(values)))
        sure, out = np.full(len(values), EPS), {}
        with np.errstate(invalid="ignore", divide="ignore"):
            for pole in poles:
                number = self._primary.get(pole)
                out[pole] = (
                    _along_rate(rates, *pole)
                    if number is None
                    else Axis(motion.axes[:, number], sure)
                )
        return out, rates

    def sense(self, pole: Pole) -> Sense:
        """Return the sense of a pole's axis, continuous from the start of the curve.

        On a closed curve an axis may come back reversed.
        """
        self.follow([pole])
        return self._senses[pole]

    def follow(self, poles: Iterable[Pole]) -> None:
        """Find the senses of several poles at once, which costs less than one by one."""
        wanted = [p for p in dict.fromkeys(poles) if p not in self._senses]
        if wanted:
            first = self._seen(self.curve.s, wanted)
            self._senses |= {pole: self._followed(pole, first[pole]) for pole in wanted}

    def signed(self, pole: Pole, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return w and dw/ds (n,) of a pole, and the bound of the rounding error of w.

        The rate is that of its second link relative to its first. Its sign is that of the
        sense of the axis, so it is smooth through zero.
        """
        w, dw, rounding = self._relative(pole, s)
        length, growth = np.linalg.norm(w, axis=1), np.linalg.norm(dw, axis=1)
        resting = length <= NEAR_REST * growth
        with np.errstate(invalid="ignore", divide="ignore"):
            size = np.where(resting, growth, length)[:, None]
            unit = np.nan_to_num(np.where(resting[:, None], dw, w) / size)
        unit *= self.sense(pole).signs(s, unit)[:, None]
        return np.sum(w * unit, axis=1), np.sum(dw * unit, axis=1), rounding

    def rests(self, pole: Pole) -> bool:
        """Return whether two links move as one on the whole curve."""
        w, _, rounding = self._relative(pole, self.curve.s)
        return bool(np.all(np.linalg.norm(w, axis=1) <= AT_REST * rounding))

    def zeros(self, pole: Pole) -> Zeros:
        """Return all s at which two links stand still relative to each other."""
        return self.locate(lambda s: self.signed(pole, s)[:2], self.sense(pole).s)

    def locate(
        self, function: Callable[[Floats], tuple[Floats, Floats]], grid: Floats
    ) -> Zeros:
        """Return the zeros of a function of s and its derivative, once a lap."""
        roots = zeros(function, grid)
        return roots.once(self.curve.length) if self.curve.closed else roots

    def _relative(self, pole: Pole, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return w, dw (n, 3) of a pole's links at s, and the rounding error (n,)."""
        rates = self.rates(s)
        return *rates.relative(*pole), rounding_of(rates)

    def _seen(self, s: Floats, poles: Sequence[Pole]) -> dict[Pole, _Seen]:
        axes, out = self.axes(s, poles), {}
        for pole in poles:
            good = axes[pole].error < FOLLOWED
            w = self._relative(pole, s)[0]
            out[pole] = _Seen(s[good], axes[pole].unit[good], w[good])
        return out

    def _followed(self, pole: Pole, seen: _Seen) -> Sense:
        """Return the sense of a pole on a grid that is halved where its axis turns fast."""
        for _ in range(MOST_HALVINGS):
            wide = np.abs(seen.turns) < TURNS
            if np.any(wide):
                more = 0.5 * (seen.s[1:] + seen.s[:-1])[wide]
            elif pole in self._primary or self.rests(pole):
                break
            else:
                more = self._near_misses(pole, seen)
            added = self._seen(more, [pole])[pole]
            if not len(added.s):
                break
            both = _Seen.joined([seen, added])
            seen = both.rows(np.argsort(both.s))
        if len(seen.s) < 2:
            ends = np.array([0.0, self.curve.length])
            return Sense(ends, np.zeros((2, 3)), ends[None])
        lost = np.abs(seen.turns) < TURNS
        gaps = np.stack([seen.s[:-1], seen.s[1:]], axis=1)[lost]
        return Sense(seen.s, seen.unit * seen.chain[:, None], gaps)

    def _near_misses(self, pole: Pole, seen: _Seen) -> Floats:
        """Return places (m,) that resolve where w seems to reverse but does not vanish.

        There the axis swings to the other side while the links nearly stand still. The
        place nearest to rest is found by the Gauss-Newton method.
        """
        along = seen.chain * np.sum(seen.unit * seen.w, axis=1)
        (cells,) = np.nonzero((along[1:] >= 0.0) != (along[:-1] >= 0.0))
        low, high = seen.s[cells], seen.s[cells + 1]
        s = low + along[cells] / (along[cells] - along[cells + 1]) * (high - low)
        for _ in range(12):
            w, dw, rounding = self._relative(pole, s)
            step = np.sum(w * dw, axis=1) / np.sum(dw * dw, axis=1)
            if np.all(np.abs(step) < 1e-10 * self.curve.length):
                break
            s = np.clip(s - step, low, high)
        size, growth = np.linalg.norm(w, axis=1), np.linalg.norm(dw, axis=1)
        around = s[:, None] + np.outer(size / growth, SWING)
        inside = (around > low[:, None]) & (around < high[:, None])
        inside &= (size > AT_REST * rounding)[:, None]
        return np.setdiff1d(around[inside], seen.s)


def rounding_of(rates: LinkRates) -> Floats:
    """Return (n,) a bound of the rounding error of the rates of links.

    Beside a crossing of curves the configuration itself is known to EPS / flatness only,
    and what follows from it to EPS / flatness^2.
    """
    size = np.linalg.norm(rates.w, axis=2).max(axis=1, initial=1.0)
    flat = np.maximum(rates.reciprocal_condition, EPS)
    return EPS * size * (8.0 / flat + 0.25 / flat**2)


def _along_rate(rates: LinkRates, i: int, j: int) -> Axis:
    """Return the axis along w_j - w_i, or where that vanishes along its derivative.

    At a distance x from a zero of w the derivative is off the axis by about x |u'|.
    """
    w, dw = rates.relative(i, j)
    length, growth = np.linalg.norm(w, axis=1), np.linalg.norm(dw, axis=1)
    rounding, unit = rounding_of(rates), w / length[:, None]
    rate = (dw - unit * np.sum(unit * dw, axis=1, keepdims=True)) / length[:, None]
    error = np.minimum(np.nan_to_num(rounding / length, nan=1.0), 1.0)
    swing = np.minimum(np.linalg.norm(rate, axis=1), 1.0 / np.maximum(error, EPS))
    away = rounding / growth + length / growth * (1.0 + np.nan_to_num(swing))
    limit = Axis(dw / growth[:, None], np.minimum(np.nan_to_num(away, nan=1.0), 1.0))
    return Axis(unit, error).or_better(limit)
