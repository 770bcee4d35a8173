"""Rates and pole axes along a configuration curve, per unit of its arc length.

Per unit of arc length every rate is finite, also at the dead points of every pair. The
angular velocity of link j relative to link i is w u, where u is a unit vector along their
pole axis. w is smooth and may change its sign. Where w = 0, u is the limit, in the
direction of the derivative of the angular velocity.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
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

NEAR_REST_RAD = 1e-6
"""Arc length from a zero of a relative rate within which the direction of its derivative is
used for its sense. Larger: the direction is less accurate; smaller: rounding of the rate
decides the sense."""
REST_ROUNDING_FACTOR = 100.0
"""Relative rates below this multiple of the bound of their rounding error are zero. Larger:
slow links count as resting; smaller: rounding hides zeros."""
CACHED_POSITION_SETS = 16
"""Sets of arc lengths of a curve whose rates are kept, because all poles are needed at the
same arc lengths."""
PROJECTION = np.array([0.5257311, 0.3090170, 0.7925405])
"""Direction on which relative rates are projected to find their zeros. It is at right
angles to no axis, except by chance."""
REST_NEWTON_STEPS = 3
"""Gauss-Newton steps from a zero of the projected rate to the least relative rate."""
ZERO_ROUNDING_FACTOR = 16.0
"""Error of a zero from rounding of its arc length, in EPS times the length of the curve."""
CONFIGURATION_ERROR_FACTOR = 8.0
"""Error of a configuration, in EPS over the reciprocal condition number of its equations.
Larger: more rates count as zero, and more axes as unknown; smaller: the error bound of a
velocity may be exceeded."""
VELOCITY_ERROR_FACTOR = 0.25
"""Error of quantities that follow from a configuration, in EPS over the square of the
reciprocal condition number. Larger or smaller: as for `CONFIGURATION_ERROR_FACTOR`."""


@dataclass(frozen=True)
class PoleAxes:
    """Axes of poles at n configurations.

    The axis of a pole is the axis about which two links rotate relative to each other. If
    the links do not move relative to each other, it can still follow from a construction of
    poles as intersections of great circles (a plan). Otherwise it is unknown. An unknown
    axis has the error 1 rad, and its vector may be NaN.

    Attributes
    ----------
    directions
        (n, 3) unit vectors by pole, of arbitrary sense.
    errors
        (n,) bounds of the errors of the axes (rad) by pole. A bound above 1 is replaced by
        1.
    """

    directions: dict[Pole, Floats]
    errors: dict[Pole, Floats]

    def largest_error(self, poles: Iterable[Pole]) -> Floats:
        """Return the largest error bound (n,) of the axes of some poles (rad)."""
        return np.max([self.errors[pole] for pole in poles], axis=0)


class LinkMotion:
    """Velocities of all links in given motions at n configurations.

    Attributes
    ----------
    values
        (n, variables) variables (rad).
    motion
        The configurations.
    w, dw
        (n, bodies, 3) angular velocity relative to body 0, and its derivative by the
        parameter of the motion. `dw` is NaN in rows in which the second derivatives of the
        variables are NaN.
    rounding
        (n,) bounds of the rounding errors of w. Near a crossing of curves, with the
        reciprocal condition number k of the equations, the configuration itself has an
        error of about EPS / k, and quantities that follow from it EPS / k^2.

    Parameters
    ----------
    position_analysis
        The mechanism, with one degree of freedom.
    values, tangents, bends
        (n, variables) variables (rad) and their first and second derivatives by the
        parameter, for example the arc length of a curve. `bends` is None at a crossing of
        curves.
    """

    def __init__(
        self,
        position_analysis: PositionAnalysis,
        values: Floats,
        tangents: Floats,
        bends: Floats | None,
    ) -> None:
        """Compute the angular velocities of all links.

        Parameters
        ----------
        position_analysis
            The mechanism, with one degree of freedom.
        values, tangents
            (n, variables) pair variables (rad) and their derivatives by the parameter of
            the motion, for example the arc length of a curve.
        bends
            (n, variables) second derivatives. None at a crossing of curves: the closure
            equations are singular there, and another method gives values and tangents, but
            no second derivatives. Accelerations are then NaN.
        """
        if bends is None:
            bends = np.full_like(tangents, np.nan)
        self.values = values
        self.motion = make_motion(position_analysis.solver, values)
        linearisation = self.motion.linearisation
        self.w = linearisation.body_rates(tangents)
        # w is a sum of vectors times rates (`body_rates`). By the product rule its
        # derivative has two terms: the rates change (`bends`), and the vectors change as
        # the links turn.
        self.dw = linearisation.body_rates(bends)
        vector_derivatives = linearisation.vector_rates(self.w)
        self.dw += linearisation.tree.body_rates(vector_derivatives, tangents)
        # Second derivatives are NaN at a crossing of curves.
        is_crossing = np.isnan(bends[:, 0])
        self.rounding = bound_velocity_rounding(
            linearisation.jacobian, tangents, self.w, is_crossing
        )

    def relative(self, i: int, j: int) -> tuple[Floats, Floats]:
        """Return w and dw (n, 3) of body j relative to body i."""
        return self.w[:, j] - self.w[:, i], self.dw[:, j] - self.dw[:, i]

    def speeds(self, pole: Pole) -> tuple[Floats, Floats]:
        """Return the sizes (n,) of w and dw of a pole's links relative to each other."""
        w, dw = self.relative(*pole)
        return np.linalg.norm(w, axis=1), np.linalg.norm(dw, axis=1)

    def rests(self, pole: Pole) -> Bools:
        """Return whether (n,) the two links of a pole rest relative to each other.

        Their relative speed is then at most a multiple of its rounding error.
        """
        speed, _ = self.speeds(pole)
        return speed <= REST_ROUNDING_FACTOR * self.rounding

    def pole_axes(self, poles: Iterable[Pole], plan: Plan | None) -> PoleAxes:
        """Return the axes of poles with bounds of their errors.

        The axis of a pole is the axis about which its two links turn relative to each
        other. There are up to three sources: a construction by great circles, the relative
        angular velocity, and its derivative. At each configuration the axis with the
        smallest error bound is taken.

        Parameters
        ----------
        poles
            The poles, as numbers of two links.
        plan
            A construction that gives these poles, or None.
        """
        directions: dict[Pole, Floats] = {}
        errors: dict[Pole, Floats] = {}
        rows = np.arange(len(self.values))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            planned_poles = None if plan is None else PlannedPoles(plan, self.motion)
            for pole in poles:
                candidates = [self._axis_by_velocity(pole), self._axis_by_derivative(pole)]
                if planned_poles is not None:
                    planned_direction = planned_poles.directions[pole].T
                    candidates.insert(0, (planned_direction, planned_poles.errors[pole]))
                # (sources, n, 3) directions and (sources, n) errors.
                candidate_directions = np.stack([axis for axis, _ in candidates])
                candidate_errors = np.stack([error for _, error in candidates])
                # An error of 1 rad stands for an unknown axis. If no source knows the axis,
                # the direction of the first one is taken, which has no meaning.
                candidate_errors = np.nan_to_num(candidate_errors, nan=1.0)
                candidate_errors = np.minimum(candidate_errors, 1.0)
                best = np.argmin(candidate_errors, axis=0)
                directions[pole] = candidate_directions[best, rows]
                errors[pole] = candidate_errors[best, rows]
        return PoleAxes(directions, errors)

    def _axis_by_velocity(self, pole: Pole) -> tuple[Floats, Floats]:
        """Return the axis (n, 3) along the angular velocity, and its error bound (n,)."""
        w, _ = self.relative(*pole)
        speed, _ = self.speeds(pole)
        return w / speed[:, None], self.rounding / speed

    def _axis_by_derivative(self, pole: Pole) -> tuple[Floats, Floats]:
        """Return the axis (n, 3) along the derivative of w, and its error bound (n,).

        w is the angular velocity of the pole's second link relative to the first, along the
        axis. This method is used near a zero of w, where the direction of w is lost in
        rounding. At the zero, the derivative w' by the arc length is along the axis. At the
        arc length x from the zero, it is not, because the axis has turned in between. The
        error is at most x times the rate at which the axis turns, plus rounding.
        """
        _, dw = self.relative(*pole)
        speed, growth = self.speeds(pole)  # |w| and |w'|
        distance_from_zero = speed / growth
        # The 1 is a reserve: without it, the bound would vanish if the axis does not turn.
        turning_rate = 1.0 + self._axis_turning_rate(pole)
        # Where w is exactly zero, the rate is not defined (NaN). The distance is zero
        # there, so that any finite rate gives the same error.
        turning_rate = np.where(np.isnan(turning_rate), 1.0, turning_rate)
        error = distance_from_zero * turning_rate + self.rounding / growth
        return dw / growth[:, None], error

    def _axis_turning_rate(self, pole: Pole) -> Floats:
        """Return the angle (n,) through which an axis turns per unit of arc length.

        It is the part of w' at right angles to the axis, divided by |w|. Here w is the
        relative angular velocity along the axis, and w' its derivative by the arc length.
        Where w is exactly zero, it has no direction, and the rate is NaN.

        Near a zero of w its direction is only rounding, and the formula gives huge numbers
        without a meaning. The result is therefore at most 1 / e, where e is the error bound
        (rad) of the axis along w. Near the zero, e and this limit are about 1. Elsewhere e
        is so small that the limit has no effect.
        """
        _, dw = self.relative(*pole)
        speed, _ = self.speeds(pole)
        axis, axis_error = self._axis_by_velocity(pole)
        along_axis = axis * np.vecdot(axis, dw)[:, None]
        across_axis = dw - along_axis
        turning_rate = np.linalg.norm(across_axis / speed[:, None], axis=1)
        limit = 1.0 / np.clip(axis_error, EPS, 1.0)
        return np.minimum(turning_rate, limit)


def bound_velocity_rounding(
    jacobian: Floats, tangents: Floats, w: Floats, is_crossing: Bools
) -> Floats:
    """Return bounds (n,) of the rounding errors of the angular velocities of all links.

    Rounding is amplified near a crossing of curves, where the closure equations are nearly
    singular. With their reciprocal condition number k, a configuration has an error of
    about EPS / k, and quantities that follow from it have one of about EPS / k^2. The bound
    is a sum of multiples of both.

    Parameters
    ----------
    jacobian
        (n, equations, variables) derivatives of the closure equations.
    tangents
        (n, variables) unit tangents of the curve.
    w
        (n, bodies, 3) angular velocities.
    is_crossing
        (n,) whether curves cross in the configuration. Another method computes such
        configurations with their tangents, so that rounding is not amplified (k = 1).
    """
    # The closure equations with the tangent as a further row are square and regular, except
    # at crossings of curves.
    equations = bordered(jacobian, tangents)
    reciprocal_condition = bordered_reciprocal_condition(equations, left_inverse(equations))
    reciprocal_condition = np.maximum(reciprocal_condition, EPS)
    reciprocal_condition[is_crossing] = 1.0
    amplification = (
        CONFIGURATION_ERROR_FACTOR / reciprocal_condition
        + VELOCITY_ERROR_FACTOR / reciprocal_condition**2
    )
    # Angular velocities of 1 or less have the rounding errors of 1.
    largest_w = np.linalg.norm(w, axis=2).max(axis=1, initial=1.0)
    return EPS * largest_w * amplification


@dataclass(frozen=True)
class RestPoints:
    """The k points of a curve at which two links rest relative to each other.

    Attributes
    ----------
    s
        (k,) arc lengths (rad).
    is_double
        (k,) whether the zero is double: the relative rate touches zero without a change of
        sign, or has two zeros that cannot be separated.
    errors
        (k,) bounds of the errors of s (rad).
    """

    s: Floats
    is_double: Bools
    errors: Floats


class CurveMotion:
    """Velocities and pole axes of all links along one configuration curve.

    Parameters
    ----------
    position_analysis
        The mechanism, with one degree of freedom.
    curve
        One of its configuration curves.
    plan_poles
        Function that returns the plan of some poles, or None if there is none.

    Attributes
    ----------
    rest_points
        Function that returns the `RestPoints` of a pole on the whole curve; None if its
        links rest relative to each other everywhere. Results are kept.
    """

    def __init__(
        self,
        position_analysis: PositionAnalysis,
        curve: ArcCurve,
        plan_poles: Callable[[tuple[Pole, ...]], Plan | None],
    ) -> None:
        """Prepare cached functions of the curve; the class explains the parameters."""
        self.position_analysis = position_analysis
        self.curve = curve
        self.plan_poles = plan_poles
        self._cached_links = lru_cache(CACHED_POSITION_SETS)(self._evaluate_links)
        self.rest_points = cache(self._find_rest_points)

    def links_at(self, s: Floats) -> LinkMotion:
        """Return the velocities of all links at arc lengths s (n,); results are kept."""
        # An array cannot be a key of a cache, but its bytes can.
        return self._cached_links(s.tobytes())

    def _evaluate_links(self, s_bytes: bytes) -> LinkMotion:
        """Return the velocities of all links at arc lengths s (rad).

        `s_bytes` are the bytes of the float64 array s. They are a key of the cache of this
        method, which the array itself cannot be.
        """
        points = self.curve.at(np.frombuffer(s_bytes))
        return LinkMotion(
            self.position_analysis, points.values, points.tangents, points.bends
        )

    def pole_axes(self, s: Floats, poles: Iterable[Pole]) -> PoleAxes:
        """Return the axes of poles at arc lengths s (n,), of arbitrary sense."""
        distinct_poles = tuple(dict.fromkeys(poles))
        plan = self.plan_poles(distinct_poles)
        return self.links_at(s).pole_axes(distinct_poles, plan)

    def oriented_axes(self, s: Floats, poles: Sequence[Pole]) -> dict[Pole, Floats]:
        """Return the axes (n, 3) of poles with senses that are continuous along the curve.

        `pole_axes` returns each axis with an arbitrary sense. Here the sense at the start
        of the curve is continued along the whole curve.

        Parameters
        ----------
        s
            (n,) arc lengths (rad).
        poles
            The poles.
        """
        # The first row is the start of the curve.
        start_and_s = np.append(self.curve.s[0], s)
        # Accurate axes of arbitrary sense. `_continuous_direction` is less accurate near
        # points at which the links rest, and only gives the sense.
        directions = self.pole_axes(start_and_s, poles).directions
        for pole, direction in directions.items():
            continuous = self._continuous_direction(start_and_s, pole)
            # The axis at the start keeps its sense. If it is opposite to the continuous
            # direction, all other axes must be opposite to it, too.
            is_opposite = np.vecdot(direction, continuous) < 0.0
            is_reversed = is_opposite != is_opposite[0]
            signs = np.where(is_reversed, -1.0, 1.0)
            directions[pole] = signs[1:, None] * direction[1:]
        return directions

    def signed_rate(self, s: Floats, pole: Pole) -> tuple[Floats, Floats]:
        """Return the relative rate (n,) of a pole's links, and its derivative by s (n,).

        The rate is smooth through its zeros, and not negative at the start of the curve.
        """
        w, dw = self.links_at(s).relative(*pole)
        direction = self._continuous_direction(s, pole)
        return np.vecdot(w, direction), np.vecdot(dw, direction)

    def _continuous_direction(self, s: Floats, pole: Pole) -> Floats:
        """Return unit vectors (n, 3) along a pole, continuous on the whole curve.

        They are along w, the angular velocity of the pole's second link relative to the
        first. At the start of the curve they have its direction. At each zero at which w
        reverses, the sign changes: direction of w, opposite direction, and so on. Near
        zeros they are along the derivative of w. They are zero if the links never move
        relative to each other.

        Parameters
        ----------
        s
            (n,) arc lengths (rad).
        pole
            The numbers of the two links.
        """
        links = self.links_at(s)
        rest_points = self.rest_points(pole)
        if rest_points is None:
            return np.zeros((len(s), 3))
        w, dw = links.relative(*pole)
        # `speed` is |w|, and `growth` is |dw|. Near a simple zero of w, the distance from
        # it is about speed / growth.
        speed, growth = links.speeds(pole)
        is_near_rest = speed <= NEAR_REST_RAD * growth
        sense_of_w = self._sense_after_reversals(rest_points, s)
        # On both sides of a zero, dw has the direction that w has behind the zero. The
        # sense of dw is therefore that of w at a point that is surely behind the zero,
        # which is at most `NEAR_REST_RAD` ahead.
        sense_of_dw = self._sense_after_reversals(rest_points, s + 2.0 * NEAR_REST_RAD)
        with np.errstate(invalid="ignore", divide="ignore"):
            direction_by_w = w / (speed * sense_of_w)[:, None]
            direction_by_dw = dw / (growth * sense_of_dw)[:, None]
        direction = np.where(is_near_rest[:, None], direction_by_dw, direction_by_w)
        return np.nan_to_num(direction)

    def _sense_after_reversals(self, rest_points: RestPoints, s: Floats) -> Floats:
        """Return 1.0 after an even number of reversals of a relative motion, else -1.0.

        Reversals are counted from the start of the curve to each arc length s (n,).
        """
        # At a double zero the rate touches zero and does not reverse.
        reversals = rest_points.s[~rest_points.is_double]
        # On a closed curve s may be up to two laps long, and the zeros repeat.
        reversals = np.append(reversals, reversals + self.curve.length)
        reversal_counts = np.searchsorted(reversals, s, side="right")
        return np.where(reversal_counts % 2 == 1, -1.0, 1.0)

    def _find_rest_points(self, pole: Pole) -> RestPoints | None:
        """Return all points at which the two links of a pole rest relative to each other.

        The relative angular velocity is that of the pole's second link relative to the
        first. First the zeros of one of its components are located: that along
        `PROJECTION`, a direction at right angles to no axis, except by chance. The
        result has those zeros at which the whole vector vanishes within its rounding error.
        It is None if the links rest on the whole curve.
        """
        curve = self.curve
        node_links = self.links_at(curve.s)
        if np.all(node_links.rests(pole)):
            return None

        def projected_rate(s: Floats) -> tuple[Floats, Floats]:
            """Return one component of the relative angular velocity, and its derivative.

            The velocity is that of the second link of `pole` relative to the first, at arc
            lengths s (n,) of the curve. The component (n,) is that along the constant
            vector `PROJECTION`. The derivative is by s.
            """
            w, dw = self.links_at(s).relative(*pole)
            return w @ PROJECTION, dw @ PROJECTION

        zeros = find_zeros(projected_rate, curve.s)
        if curve.closed:
            # A zero at the start of a closed curve is one at its end, too. It counts once.
            zeros = zeros.merge_seam(curve.length)
        is_double = zeros.double
        # Rounding moves the zeros of one component. Newton's method moves them to the
        # minimum of the whole vector nearby, which is more accurate.
        s = self._refine_zeros(zeros.places, is_double, pole)
        # Bounds of the errors of the arc lengths, first as if all zeros were simple.
        # `slope` is the size of the derivative of the relative rate by s, and
        # `links.rounding` a bound of the rounding error of the rate.
        links = self.links_at(s)
        _, slope = links.speeds(pole)
        rounding_of_s = ZERO_ROUNDING_FACTOR * EPS * curve.length
        # A simple zero moves by the error of the rate over its slope. `EPS` prevents a
        # division by zero.
        errors = links.rounding / np.maximum(slope, EPS) + rounding_of_s
        # Double zeros get another bound. Near one the rate is a parabola, c x^2 / 2 at the
        # distance x, which is below the rounding r up to x = sqrt(2 r / c). The slope there
        # is c x, so the second derivative c is estimated from the slope at a distance of a
        # thousandth of the length, towards the middle of the curve. Larger distances: the
        # curve is no parabola; smaller: the slope is only rounding.
        step = 1e-3 * curve.length
        double_s = s[is_double]
        aside = np.where(double_s > 0.5 * curve.length, -step, step)
        _, slope_aside = self.links_at(double_s + aside).speeds(pole)
        curvature = np.maximum(slope_aside / step, EPS)
        errors[is_double] = np.sqrt(2.0 * links.rounding[is_double] / curvature)
        errors = np.minimum(errors, curve.length)
        # The links rest where the whole vector vanishes. At other zeros only the component
        # along `PROJECTION` vanishes.
        is_rest = links.rests(pole)
        distances_to_ends = (s, curve.length - s)
        for end_status, distance in zip(curve.ends, distances_to_ends, strict=True):
            if end_status == Status.AT_SINGULARITY:
                # At a crossing with other curves, where this curve ends, every rate may
                # vanish. A zero that cannot be distinguished from this end is left out: one
                # nearer than four times its error. Larger: more zeros are left out.
                is_rest &= distance > 4.0 * errors
        return RestPoints(s[is_rest], is_double[is_rest], errors[is_rest])

    def _refine_zeros(self, s: Floats, is_double: Bools, pole: Pole) -> Floats:
        """Return the points with the smallest relative rate near simple zeros.

        The given zeros are those of one component of the relative angular velocity w.
        Gauss-Newton steps lead to the minimum of the length of w: each changes the arc
        length by -(w . w') / (w' . w'), with the derivative w' by the arc length.

        Parameters
        ----------
        s, is_double
            (k,) arc lengths of the zeros (rad), and whether they are double. Double zeros
            are not changed: w' vanishes there as well, so the steps are not determined.
        pole
            The two links.
        """
        for _ in range(REST_NEWTON_STEPS):
            w, dw = self.links_at(s).relative(*pole)
            step = np.vecdot(w, dw) / np.maximum(np.vecdot(dw, dw), EPS**2)
            # A longer step shows that only the component vanishes, and not the vector.
            is_unchanged = is_double | (np.abs(step) > NEAR_REST_RAD)
            s = np.where(is_unchanged, s, s - step)
        # A step may leave the curve at its start, s = 0.
        return np.maximum(s, 0.0)
