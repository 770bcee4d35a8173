"""Rates and pole axes along a configuration curve, per unit of its arc length.

Per arc length every rate is finite, at the dead points of every pair too. The angular
velocity of link j relative to i is w u with u a unit vector along their pole; w is smooth
through its zeros, and there u is the limit that the derivative of w u points along.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.numerics.zeros import find_zeros
from spherekit.planning.pole_plan import Plan, Pole
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_segment import bordered, bordered_reciprocal_condition
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.motion import make_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.tolerances import EPS
from spherekit.velocities.pole_sequence import PlannedPoles

NEAR_REST = 1e-6
"""Relative rates below this part of their derivative take its direction."""
AT_REST = 100.0
"""Relative rates below this times the bound of their rounding error vanish."""
KEPT = 16
"""Sets of places on a curve whose rates are kept: all poles are asked for at the same."""
ASIDE = np.array([0.5257311, 0.3090170, 0.7925405])
"""A direction that no axis is at right angles to, but by chance."""
SETTLING = 3
"""Gauss-Newton steps to where a rate is least."""


Axes = tuple[dict[Pole, Floats], dict[Pole, Floats]]
"""Unit vectors (n, 3) along poles, and bounds (n,) of their errors.

NaN with an error of 1 where the links do not move relative to each other and nothing else
says where their pole is.
"""


class LinkMotion:
    """The links of a mechanism in given motions at n configurations.

    Attributes
    ----------
    values
        (n, variables) rad.
    w, dw
        (n, bodies, 3) angular velocity relative to body 0 and its derivative by the
        motion's parameter; `dw` is NaN where second derivatives of the variables are.
    rounding
        (n,) bounds of the rounding errors of w. Beside a crossing of curves the
        configuration itself is known to EPS / flatness only, and what follows from it to
        EPS / flatness^2.
    """

    def __init__(
        self, tracer: PositionAnalysis, values: Floats, tangents: Floats, bends: Floats
    ) -> None:
        self.values = values
        self.motion = make_motion(tracer.solver, values)
        at = self.motion.linearisation
        self.w = at.body_rates(tangents)
        self.dw = at.body_rates(bends)
        self.dw += at.tree.body_rates(at.turned(self.w), tangents)
        equations = bordered(at.jacobian, tangents)
        flat = np.maximum(
            bordered_reciprocal_condition(equations, left_inverse(equations)), EPS
        )
        flat[np.isnan(bends[:, 0])] = 1.0  # a motion that is given
        size = np.linalg.norm(self.w, axis=2).max(axis=1, initial=1.0)
        self.rounding = EPS * size * (8.0 / flat + 0.25 / flat**2)

    def relative(self, i: int, j: int) -> tuple[Floats, Floats]:
        """Return w and dw (n, 3) of body j relative to body i."""
        return self.w[:, j] - self.w[:, i], self.dw[:, j] - self.dw[:, i]

    def speeds(self, pole: Pole) -> tuple[Floats, Floats]:
        """Return the sizes (n,) of w and dw of a pole's links."""
        w, dw = self.relative(*pole)
        return np.linalg.norm(w, axis=1), np.linalg.norm(dw, axis=1)

    def axes(self, poles: Iterable[Pole], planned: Plan | None) -> Axes:
        """Return the axes of poles, in either sense, and bounds of their errors.

        By the great circles of the plan, along the relative angular velocity, or its
        derivative where that vanishes: what has the least error bound. At a distance x
        from a zero of w the derivative is off the axis by about x |u'|.
        """
        units, errors = {}, {}
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            sequence = None if planned is None else PlannedPoles(planned, self.motion)
            for pole in poles:
                (w, dw) = self.relative(*pole)
                (length, growth) = self.speeds(pole)
                unit, error = w / length[:, None], self.rounding / length
                rate = (dw - unit * np.vecdot(unit, dw)[:, None]) / length[:, None]
                swing = np.linalg.norm(rate, axis=1)
                swing = np.minimum(swing, 1.0 / np.clip(error, EPS, 1.0))
                turned = length * (1.0 + np.nan_to_num(swing))
                away = (self.rounding + turned) / growth
                ways = [(unit, error), (dw / growth[:, None], away)]
                if sequence is not None:
                    ways.insert(0, (sequence.directions[pole].T, sequence.errors[pole]))
                unit, error = (np.stack(part) for part in zip(*ways, strict=True))
                error = np.minimum(np.nan_to_num(error, nan=1.0), 1.0)
                best = np.argmin(error, axis=0), np.arange(len(w))
                units[pole], errors[pole] = unit[best], error[best]
        return units, errors


class AlongCurve:
    """Rates and axes of the links of a mechanism along one of its configuration curves.

    Parameters
    ----------
    tracer
        The mechanism, with one freedom.
    curve
        One of its configuration curves.
    plan_of
        What makes the plan of some poles, None where there is none.
    """

    def __init__(
        self,
        tracer: PositionAnalysis,
        curve: ArcCurve,
        plan_of: Callable[[tuple[Pole, ...]], Plan | None],
    ) -> None:
        self.tracer = tracer
        self.curve = curve
        self.plan_of = plan_of
        self._at = lru_cache(KEPT)(self._links)
        self.zeros = cache(self._zeros)

    def at(self, s: Floats) -> LinkMotion:
        """Return the links at s (n,) by arc length; the last results are kept."""
        return self._at(s.tobytes())

    def _links(self, places: bytes) -> LinkMotion:
        there = self.curve.at(np.frombuffer(places))
        return LinkMotion(self.tracer, there.values, there.tangents, there.bends)

    def axes(self, s: Floats, poles: Iterable[Pole]) -> Axes:
        """Return the axes of poles at s (n,), in either sense, and bounds of errors."""
        wanted = tuple(dict.fromkeys(poles))
        return self.at(s).axes(wanted, self.plan_of(wanted))

    def oriented(self, s: Floats, poles: Sequence[Pole]) -> dict[Pole, Floats]:
        """Return the axes (n, 3) with senses that are continuous along the curve.

        They are those of `axes` where the curve starts.
        """
        both = np.append(self.curve.s[0], s)
        units, _ = self.axes(both, poles)
        for pole, unit in units.items():
            against = np.vecdot(unit, self._heading(both, pole)) < 0.0
            units[pole] = np.where(against != against[0], -1.0, 1.0)[1:, None] * unit[1:]
        return units

    def signed(self, s: Floats, pole: Pole) -> tuple[Floats, Floats]:
        """Return the rate (n,) of a pole's links at s, and its slope.

        Its sign is such that it is smooth through zero, and not negative at the start.
        """
        (w, dw) = self.at(s).relative(*pole)
        unit = self._heading(s, pole)
        return np.vecdot(w, unit), np.vecdot(dw, unit)

    def _heading(self, s: Floats, pole: Pole) -> Floats:
        """Return unit vectors (n, 3) along a pole, of one sense on the whole curve.

        Along w, which reverses at each of its zeros but the double ones; at these along
        its derivative. Zero where the links move as one.
        """
        there, roots = self.at(s), self.zeros(pole)
        if roots is None:
            return np.zeros((len(s), 3))
        (w, dw) = there.relative(*pole)
        (length, growth) = there.speeds(pole)
        resting = length <= NEAR_REST * growth
        reversals = roots[0][~roots[1]]
        again = np.append(reversals, reversals + self.curve.length)  # a lap later
        odd = np.searchsorted(again, s + 2.0 * NEAR_REST * resting, side="right") % 2 == 1
        size = np.where(resting, growth, length) * np.where(odd, -1.0, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nan_to_num(np.where(resting[:, None], dw, w) / size[:, None])

    def _zeros(self, pole: Pole) -> tuple[Floats, Bools, Floats] | None:
        """Return all s at which two links rest relative to each other, None if everywhere.

        With whether each is double, and bounds of the errors of s (k,). They are zeros of
        any component of the relative rate, at which all of it vanishes.
        """
        curve = self.curve
        there = self.at(curve.s)
        if np.all(there.speeds(pole)[0] <= AT_REST * there.rounding):
            return None

        def component(s: Floats) -> tuple[Floats, Floats]:
            w, dw = self.at(s).relative(*pole)
            return w @ ASIDE, dw @ ASIDE

        rests = find_zeros(component, curve.s)
        if curve.closed:
            rests = rests.merge_seam(curve.length)
        s, double = rests.places, rests.double
        for _ in range(SETTLING):
            w, dw = self.at(s).relative(*pole)
            step = np.vecdot(w, dw) / np.maximum(np.vecdot(dw, dw), EPS**2)
            s = np.where(double | (np.abs(step) > NEAR_REST), s, s - step)
        s = np.maximum(s, 0.0)
        there = self.at(s)
        speed, slope = there.speeds(pole)
        error = there.rounding / np.maximum(slope, EPS) + 16.0 * EPS * curve.length
        step = 1e-3 * curve.length
        aside = np.where(s[double] > 0.5 * curve.length, -step, step)
        bend = np.maximum(self.at(s[double] + aside).speeds(pole)[1] / step, EPS)
        error[double] = np.sqrt(2.0 * there.rounding[double] / bend)
        error = np.minimum(error, curve.length)
        rest = speed <= AT_REST * there.rounding
        for why, way in zip(curve.ends, (s, curve.length - s), strict=True):
            if why == Status.AT_SINGULARITY:  # the zero may be that of the crossing
                rest &= way > 4.0 * error
        return s[rest], double[rest], error[rest]
