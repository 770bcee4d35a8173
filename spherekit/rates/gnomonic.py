"""Poles and coefficients by the formulas of the gnomonic chart.

The central projection onto the plane x = 1 takes the axis of (x, y, z) to the complex
number p = (y + jz) / x, and a great circle to the straight line p = (s + j tan theta) u
with u = exp(j epsilon), its slope epsilon and its distance tan theta from the centre
(Di Gregorio, Lecture 2 of the short course "Recent Results on Planar and Spherical
Kinematics", Barcelona 2019, cases (a), (b), (c)). Axes with x = 0, the infinity great
circle, have no point there, and neighbours of it have few digits. The lecture has no
derivatives; they follow from the same formulas by the rules of quotients and products.

The reference (x, y, z) is fixed to the frame, as in the lecture, with x along (1, 1, 1) of
the ground axes: these lie along pairs of many mechanisms, and would be at infinity.
"""

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.model.joints import PairRates
from spherekit.motion.motion import Motion
from spherekit.planning.poles import BlockPoles, LinePole, Plan, Pole, Step, pole_of
from spherekit.rates.lines import (
    Lines,
    block_rate,
    decompose,
    decompose_rate,
    line_sources,
    solve_block,
)
from spherekit.rates.vectors import cross, dot, norm, unit_rate
from spherekit.sphere.rotation import Floats

Points = NDArray[np.complexfloating[Any, Any]]

REFERENCE = (
    np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 2.0]])
    / np.sqrt([3.0, 2.0, 6.0])[:, None]
)
"""The axes x, y and z of the chart in ground axes, row by row."""


@final
@dataclass(frozen=True)
class _Line:
    """A straight line by a point, its slope (n,), the point's doubt, a second point's."""

    point: Points
    slope: Floats
    point_doubt: Floats
    second: tuple[Points, Floats] | None = None

    @property
    def along(self) -> Points:
        """(n,) u = exp(j epsilon)."""
        return np.asarray(np.exp(1j * self.slope))

    @property
    def distance(self) -> Floats:
        """(n,) tan theta."""
        return np.imag(self.point * np.conj(self.along))

    @property
    def normal(self) -> Floats:
        """(3, n) of the great circle's plane, of any length."""
        u = self.along
        return np.stack([-self.distance, -u.imag, u.real])

    def distance_rate(self, point_rate: Points, slope_rate: Floats) -> Floats:
        """Return the derivative (n,) of the distance, given those of point and slope."""
        back = np.conj(self.along)
        return np.imag(point_rate * back) - slope_rate * np.real(self.point * back)

    def doubt(self, p: Points) -> Floats:
        """Return a bound (n,) of how far the line may miss its true place at p."""
        rounding = EPS * (np.abs(self.point) + np.abs(p))
        if self.second is None:
            return self.point_doubt + rounding
        q, q_doubt = self.second
        ends = self.point_doubt * np.abs(p - q) + q_doubt * np.abs(p - self.point)
        return np.asarray(ends / np.abs(self.point - q) + rounding)


@final
class Chart:
    """The poles of a plan as points of the plane, in the order of its steps.

    `lines` are the same poles as unit vectors; its error bounds are those of the points,
    propagated through the chart's formulas and seen from the centre of the sphere.
    """

    def __init__(self, plan: Plan, motion: Motion) -> None:
        self.plan = plan
        self.motion = motion
        self.lines = Lines.of_pairs(plan, motion, "gnomonic")
        self._point: dict[Pole, Points] = {}
        self._doubt: dict[Pole, Floats] = {}
        self._point_rate: dict[Pole, Points] = {}
        for step in plan.steps:
            if isinstance(step, LinePole):
                self._intersect(step)
                continue
            if isinstance(step, BlockPoles):
                solve_block(plan, step, motion, self.lines)
            for pole in _poles(step):
                self._project(pole)

    def _project(self, pole: Pole) -> None:
        unit = self.lines.unit[pole]
        self._point[pole] = _point(unit)
        self._doubt[pole] = self.lines.error[pole] / (REFERENCE[0] @ unit) ** 2

    def _intersect(self, step: LinePole) -> None:
        one, other = self._two_lines(step)
        between = np.sin(other.slope - one.slope)
        p = (one.distance * other.along - other.distance * one.along) / between
        doubt = (one.doubt(p) + other.doubt(p)) / np.abs(between) + EPS * np.abs(p)
        size = np.sqrt(1.0 + np.abs(p) ** 2)
        self._point[step.pole], self._doubt[step.pole] = p, doubt
        lines = self.lines
        lines.unit[step.pole] = (
            REFERENCE.T @ np.stack([np.ones_like(size), p.real, p.imag]) / size
        )
        lines.error[step.pole] = np.minimum(np.nan_to_num(doubt / size, nan=1.0), 1.0)
        across = cross(one.normal, other.normal)
        lines.angle[step.pole] = norm(across) / (norm(one.normal) * norm(other.normal))

    def _two_lines(self, step: LinePole) -> "tuple[_Line, _Line]":
        """Return the first two lines of a pole: the lecture's cases (a), (b), (c)."""
        made: list[_Line] = []
        for k in step.via[:2]:
            a, b = line_sources(step, k)
            p, q = self._point[a], self._point[b]
            second = (q, self._doubt[b])
            made.append(_Line(p, np.angle(p - q), self._doubt[a], second))
        for number in step.contacts[: 2 - len(made)]:
            normal = REFERENCE @ self.lines.contact[number]
            contact = self.motion.frames[:, number, :, 2].T
            slope = np.arctan2(normal[1], -normal[2])
            doubt = EPS / (REFERENCE[0] @ contact) ** 2
            made.append(_Line(_point(contact), slope, doubt))
        return made[0], made[1]

    def add_rates(self, turned: PairRates) -> None:
        """Add the derivatives of all directions, given those at the pairs."""
        lines = self.lines
        for number in lines.contact:
            lines.contact_rate[number] = np.ascontiguousarray(turned.axes[:, number].T)
        for step in self.plan.steps:
            if isinstance(step, LinePole):
                self._intersect_rate(step)
                continue
            if isinstance(step, BlockPoles):
                block_rate(self.plan, step, self.motion, turned, lines)
            else:
                rate = np.ascontiguousarray(turned.axes[:, step.pair].T)
                lines.rate[step.pole] = rate
            for pole in _poles(step):
                point = self._point[pole]
                self._point_rate[pole] = _point_rate(
                    lines.unit[pole], point, lines.rate[pole]
                )

    def _intersect_rate(self, step: LinePole) -> None:
        one, other = self._two_lines(step)
        rates: list[tuple[Points, Floats]] = []
        for k in step.via[:2]:
            a, b = line_sources(step, k)
            p, q = self._point[a], self._point[b]
            dp, dq = self._point_rate[a], self._point_rate[b]
            rates.append((dp, np.imag((dp - dq) / (p - q))))
        for number in step.contacts[: 2 - len(rates)]:
            n, dn = self.lines.contact[number], self.lines.contact_rate[number]
            contact = self.motion.frames[:, number, :, 2].T
            # a point that stays on the line, whatever the contact itself does
            foot = -n * dot(dn, contact)
            rate = _point_rate(contact, _point(contact), foot)
            n, dn = REFERENCE @ n, REFERENCE @ dn
            square = n[1] ** 2 + n[2] ** 2
            rates.append((rate, (n[1] * dn[2] - n[2] * dn[1]) / square))
        (d_one, slope_one), (d_other, slope_other) = rates
        t1 = one.distance_rate(d_one, slope_one)
        t2 = other.distance_rate(d_other, slope_other)
        between = other.slope - one.slope
        p = self._point[step.pole]
        moved = (t1 + 1j * one.distance * slope_other) * other.along
        moved -= (t2 + 1j * other.distance * slope_one) * one.along
        moved -= p * np.cos(between) * (slope_other - slope_one)
        change = np.asarray(moved / np.sin(between), dtype=complex)
        self._point_rate[step.pole] = change
        size = np.sqrt(1.0 + np.abs(p) ** 2)
        vector_rate = REFERENCE.T @ np.stack(
            [np.zeros_like(size), change.real, change.imag]
        )
        unit = self.lines.unit[step.pole]
        self.lines.rate[step.pole] = unit_rate(unit, size, vector_rate)

    def ratio(self, body: int) -> tuple[Floats, Floats]:
        """Return x in w_body - w_a = x u (n,), and the sine that it was divided by.

        a and b are the links of the input and u the unit vector of the pole of a and the
        body. With any fourth link s, [u . (u_s,body x u_sb)] x = u_ba . (u_s,body x u_sb),
        the lecture's input-output relation ii). Where the plan has no fourth link with
        both poles, x follows from the relative motion theorem as on the other routes.
        """
        unit = self.lines.unit
        a, b = self.plan.ends[self.plan.input]
        one, driven = unit[pole_of(a, body)], unit[pole_of(a, b)]
        fourth = self._fourth(body)
        if fourth is None:
            return decompose(driven, one, unit[pole_of(b, body)])
        normal = cross(*(unit[pole] for pole in fourth))
        size = dot(one, normal)
        return dot(driven, normal) / size, np.abs(size)

    def ratio_rate(self, body: int) -> Floats:
        """Return the derivative (n,) of what `ratio` gives."""
        unit, rate = self.lines.unit, self.lines.rate
        a, b = self.plan.ends[self.plan.input]
        one, driven = pole_of(a, body), pole_of(a, b)
        fourth = self._fourth(body)
        if fourth is None:
            whole, first, second = (
                (unit[pole], rate[pole]) for pole in (driven, one, pole_of(b, body))
            )
            return decompose_rate(whole, first, second)
        c, d = fourth
        normal = cross(unit[c], unit[d])
        turned = cross(rate[c], unit[d]) + cross(unit[c], rate[d])
        size = dot(unit[one], normal)
        factor = dot(unit[driven], normal) / size
        over = dot(rate[driven], normal) + dot(unit[driven], turned)
        under = dot(rate[one], normal) + dot(unit[one], turned)
        return np.asarray((over - factor * under) / size)

    def _fourth(self, body: int) -> tuple[Pole, Pole] | None:
        """Return the poles of the body and of the input with the first usable link.

        A link that shares an axis with two of the others makes both sides zero.
        """
        a, b = self.plan.ends[self.plan.input]
        others = {a, b, body}
        for s in self.plan.bodies:
            same = (
                sum(axis >> link & 1 for link in others)
                for axis, _ in self.plan.coaxial
                if axis >> s & 1
            )
            if s not in others and all(shared < 2 for shared in same):
                poles = pole_of(body, s), pole_of(b, s)
                if all(pole in self.lines.unit for pole in poles):
                    return poles
        return None


def _poles(step: Step) -> tuple[Pole, ...]:
    return step.poles if isinstance(step, BlockPoles) else (step.pole,)


def _point(vectors: Floats) -> Points:
    """Return the points (n,) of vectors (3, n)."""
    x, y, z = REFERENCE @ vectors
    return np.asarray((y + 1j * z) / x)


def _point_rate(vectors: Floats, points: Points, rates: Floats) -> Points:
    """Return the derivative (n,) of the points of vectors that change at rates (3, n)."""
    x, y, z = REFERENCE @ rates
    return np.asarray((y + 1j * z - points * x) / (REFERENCE[0] @ vectors))
