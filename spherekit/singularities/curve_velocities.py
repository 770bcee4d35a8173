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
"""Number of sets of arc lengths of a curve whose rates are kept, because all poles are
computed at the same arc lengths."""
CROSSING_DISTANCE_FACTOR = 4.0
"""Least distance of a zero of a rate from a crossing of curves, as a multiple of its error.
Larger: zeros near crossings are lost; smaller: rounding near crossings counts as a zero."""
PROJECTION = np.array([0.5257311, 0.3090170, 0.7925405])
"""Direction (unit vector) on which relative rates are projected to find their zeros. It is
at right angles to no axis, except by chance."""
OTHER_PROJECTIONS = np.array(
    [[0.7288269, -0.6440732, -0.2323382], [0.4386565, 0.6997705, -0.5638278]]
)
"""Two directions (unit vectors, rows) at right angles to `PROJECTION` and to each other.
One of them replaces `PROJECTION` for a pole axis that is nearly at right angles to it."""
LEAST_PROJECTED_RATIO = 0.1
"""Least ratio of the largest component of a relative rate along `PROJECTION` to its largest
size. Below it another direction is used. Larger: the direction is replaced without need;
smaller: rounding of the component can hide double zeros."""
REST_NEWTON_STEPS = 3
"""Number of Gauss-Newton steps from a zero of the projected rate to the least rate."""
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
class _AxisEstimate:
    """The axis of one pole at n configurations, from one of several methods.

    A pole is the axis about which one link rotates relative to another. At each
    configuration, the method with the smallest error is chosen.

    Attributes
    ----------
    direction
        (n, 3) unit vectors along the axis, of arbitrary sense.
    error
        (n,) bounds of the errors of these directions (rad), NaN for unknown axes.
    """

    direction: Floats
    error: Floats


@dataclass(frozen=True)
class PoleAxes:
    """Axes of poles at n configurations, with bounds of their errors.

    The axis of a pole is the axis about which two links rotate relative to each other. An
    unknown axis has the error 1 rad, and its vector may be NaN.

    Attributes
    ----------
    directions
        For each pole (n, 3) unit vectors along its axis, of arbitrary sense.
    errors
        For each pole (n,) bounds of the error of its axis (rad). A bound above 1 is
        replaced by 1.
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
        (n, bodies, 3) angular velocity of each link (body) relative to body 0, the ground,
        and its derivative with respect to the parameter of the motion. Velocities are
        per unit rate of this parameter, such as the arc length of a curve. `dw` is NaN
        in rows in which the second derivatives of the variables are NaN.
    rounding
        (n,) bounds of the rounding errors of w.

    Parameters
    ----------
    position_analysis
        The mechanism, with one degree of freedom.
    values, tangents, bends
        (n, variables) variables (rad) and their first and second derivatives with
        respect to the parameter, for example the arc length of a curve. `bends` is None
        at a crossing of curves.
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
            (n, variables) pair variables (rad) and their derivatives with respect to
            the parameter of the motion, for example the arc length of a curve.
        bends
            (n, variables) second derivatives. None at a crossing of curves, where the
            closure equations are singular and second derivatives are unknown.
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
        """Return, for n configurations, whether both links of a pole move together.

        Links move together if their relative angular speed is at most a multiple of the
        rounding error of this speed.
        """
        speed, _ = self.speeds(pole)
        return speed <= REST_ROUNDING_FACTOR * self.rounding

    def pole_axes(self, poles: Iterable[Pole], plan: Plan | None) -> PoleAxes:
        """Return the axes of poles with bounds of their errors.

        The axis of a pole is the axis about which its two links turn relative to each
        other. There are up to three sources for it: intersections of great circles, the
        relative angular velocity of the links, and its derivative. At each configuration
        the axis with the smallest error bound is taken.

        Parameters
        ----------
        poles
            The poles, as indices of two links.
        plan
            The order in which these poles are constructed from known ones, by intersections
            of great circles. None leaves this source out.
        """
        directions: dict[Pole, Floats] = {}
        errors: dict[Pole, Floats] = {}
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            planned_poles = None if plan is None else PlannedPoles(plan, self.motion)
            for pole in poles:
                estimates: list[_AxisEstimate] = []
                if planned_poles is not None:
                    # (3, n) becomes (n, 3).
                    planned_direction = planned_poles.directions[pole].T
                    estimates.append(
                        _AxisEstimate(planned_direction, planned_poles.errors[pole])
                    )
                estimates.append(self._axis_by_velocity(pole))
                estimates.append(self._axis_by_derivative(pole))
                best = _choose_most_accurate(estimates)
                directions[pole] = best.direction
                errors[pole] = best.error
        return PoleAxes(directions, errors)

    def _axis_by_velocity(self, pole: Pole) -> _AxisEstimate:
        """Return the axis along the relative angular velocity of the links of a pole."""
        w, _ = self.relative(*pole)
        speed, _ = self.speeds(pole)
        return _AxisEstimate(direction=w / speed[:, None], error=self.rounding / speed)

    def _axis_by_derivative(self, pole: Pole) -> _AxisEstimate:
        """Return the pole axis along the derivative of the relative angular velocity.

        w is the angular velocity of the pole's second link relative to the first, and w'
        its derivative with respect to the arc length of a curve of configurations. w is
        along the axis, but near a zero of w the direction of w is lost in rounding. At the
        zero, w' is along the axis. At the arc length x from the zero, the axis has turned a
        little, which adds to the error:

            error = x * (1 + turning rate of the axis) + (rounding error of w) / |w'|

        The distance x is estimated as |w| / |w'|.
        """
        _, dw = self.relative(*pole)
        speed, growth = self.speeds(pole)  # |w| and |w'|
        distance_from_zero = speed / growth
        # The 1 is a reserve. Without it, an axis that does not turn would have no error.
        turning_rate = 1.0 + self._axis_turning_rate(pole)
        # Where w is exactly zero, the rate is NaN. Any finite rate yields the same error
        # there, because the distance is 0.
        turning_rate = np.where(np.isnan(turning_rate), 1.0, turning_rate)
        error = distance_from_zero * turning_rate + self.rounding / growth
        return _AxisEstimate(direction=dw / growth[:, None], error=error)

    def _axis_turning_rate(self, pole: Pole) -> Floats:
        """Return the angle (n,) through which a pole axis turns per unit of arc length.

        The pole axis is the axis of the relative rotation of two links, along their
        relative angular velocity w. The result is the part of w' (derivative with
        respect to the arc length of a curve of configurations) at right angles to the
        axis, divided by |w|. Where w is exactly zero, the rate is NaN.
        """
        _, dw = self.relative(*pole)  # w'
        speed, _ = self.speeds(pole)  # |w|
        # The direction of w, and a bound of its error (rad) by rounding.
        axis = self._axis_by_velocity(pole)
        along_axis = axis.direction * np.vecdot(axis.direction, dw)[:, None]
        across_axis = dw - along_axis
        turning_rate = np.linalg.norm(across_axis / speed[:, None], axis=1)
        # Near a zero of w, the direction of w is only rounding, and the rate is huge but
        # means nothing. The error of the axis is about 1 rad there, and cuts the rate to
        # about 1. Elsewhere the error is small, and the limit is too large to have effect.
        limit = 1.0 / np.clip(axis.error, EPS, 1.0)
        return np.minimum(turning_rate, limit)


def _choose_most_accurate(estimates: Sequence[_AxisEstimate]) -> _AxisEstimate:
    """Return at each configuration the estimate of an axis with the smallest error.

    An unknown axis counts as an error of 1 rad, and larger errors are reduced to 1 rad. Of
    equal errors the first one is taken.
    """
    # Both arrays are (estimates, n, ...).
    directions = np.stack([estimate.direction for estimate in estimates])
    errors = np.stack([estimate.error for estimate in estimates])
    errors = np.minimum(np.nan_to_num(errors, nan=1.0), 1.0)
    best = np.argmin(errors, axis=0)
    rows = np.arange(len(best))
    return _AxisEstimate(direction=directions[best, rows], error=errors[best, rows])


def bound_velocity_rounding(
    jacobian: Floats, tangents: Floats, w: Floats, is_crossing: Bools
) -> Floats:
    """Return bounds (n,) of the rounding errors of the angular velocities of all links.

    Rounding is amplified near a crossing of curves of configurations, where the closure
    equations are nearly singular. With their reciprocal condition number k, a configuration
    has an error of about EPS / k. Velocities at this configuration have an error of
    about EPS / k^2. The bound is the sum of these errors, each times a constant factor.

    Parameters
    ----------
    jacobian
        (n, equations, variables) derivatives of the closure equations.
    tangents
        (n, variables) unit tangents of the curve.
    w
        (n, bodies, 3) angular velocities.
    is_crossing
        (n,) whether curves cross in the configuration. Such configurations are computed by
        another method, which does not amplify rounding (k = 1).
    """
    # With the tangent as a further row, the closure equations are square. These square
    # equations are regular except at crossings of curves.
    equations = bordered(jacobian, tangents)
    reciprocal_condition = bordered_reciprocal_condition(equations, left_inverse(equations))
    reciprocal_condition = np.maximum(reciprocal_condition, EPS)  # prevents division by 0
    reciprocal_condition[is_crossing] = 1.0
    amplification = (
        CONFIGURATION_ERROR_FACTOR / reciprocal_condition
        + VELOCITY_ERROR_FACTOR / reciprocal_condition**2
    )
    # Rounding errors are relative to the largest velocity, or to 1 if it is smaller.
    largest_w = np.linalg.norm(w, axis=2).max(axis=1, initial=1.0)
    return EPS * largest_w * amplification


def _choose_projection(w: Floats) -> Floats:
    """Return the direction along which a component of a relative rate is examined.

    The caller finds the zeros of w, where two links rest relative to each other. For this
    it looks for zeros of one component of w, along the direction that is returned here.

    The direction is `PROJECTION`, unless w is nearly at right angles to it on the whole
    curve. The component along `PROJECTION` would then be zero or lost in rounding.

    Parameters
    ----------
    w
        (n, 3) angular velocity of one link relative to another at n configurations of a
        curve.

    Returns
    -------
    (3,) unit vector, constant on the curve.
    """
    largest_speed = np.max(np.linalg.norm(w, axis=1))
    if np.max(np.abs(w @ PROJECTION)) >= LEAST_PROJECTED_RATIO * largest_speed:
        return PROJECTION
    # The two other directions span the plane at right angles to `PROJECTION`, and w is
    # nearly in this plane. So the larger component is at least 0.7 times the largest |w|.
    largest_components = np.max(np.abs(w @ OTHER_PROJECTIONS.T), axis=0)
    return OTHER_PROJECTIONS[np.argmax(largest_components)]


@dataclass(frozen=True)
class RestPoints:
    """The k points of a curve at which two links rest relative to each other.

    The curve consists of configurations of the mechanism. The points are the zeros of the
    relative angular velocity of both links.

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
        Function that returns how some poles can be constructed from each other, or None if
        they cannot.

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

        `s_bytes` are the bytes of the float64 array s. Results are cached by these bytes,
        because an array cannot be the key of a cache.
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

        A pole is the axis about which one link rotates relative to another. `pole_axes`
        returns each axis with an arbitrary sense. Here the sense at the start of the curve
        is continued along the whole curve. Rates about these axes, and triple products of
        the axes, then have no jumps of sign.

        Parameters
        ----------
        s
            (n,) arc lengths (rad).
        poles
            The poles.
        """
        # The first row is the start of the curve.
        start_and_s = np.append(self.curve.s[0], s)
        axes = self.pole_axes(start_and_s, poles)
        oriented: dict[Pole, Floats] = {}
        for pole, direction in axes.directions.items():
            # Only the sense of this direction is used, because the direction is less
            # accurate where the links nearly rest.
            continuous = self._continuous_direction(start_and_s, pole)
            # The axis at the start keeps its sense. If this is opposite to the continuous
            # direction, all axes along the curve must be opposite to it.
            is_opposite = np.vecdot(direction, continuous) < 0.0
            is_opposite_at_start = is_opposite[0]
            is_reversed = is_opposite[1:] != is_opposite_at_start
            signs = np.where(is_reversed, -1.0, 1.0)
            oriented[pole] = signs[:, None] * direction[1:]
        return oriented

    def signed_rate(self, s: Floats, pole: Pole) -> tuple[Floats, Floats]:
        """Return the relative rate of a pole's links, and its derivative with respect to s.

        The rate is the angular velocity of the second link relative to the first, along the
        axis of the pole, per unit of the arc length s of the curve.

        The axis does not jump to its opposite where the rate vanishes, so the rate changes
        its sign smoothly there. At the start of the curve the rate is not negative.
        """
        w, dw = self.links_at(s).relative(*pole)
        direction = self._continuous_direction(s, pole)
        return np.vecdot(w, direction), np.vecdot(dw, direction)

    def _continuous_direction(self, s: Floats, pole: Pole) -> Floats:
        """Return unit vectors (n, 3) along a pole axis, continuous on the whole curve.

        The pole axis is the axis of the relative rotation of two links, along their
        relative angular velocity w. Each time w passes through zero, w reverses, but
        the unit vectors do not. At the start of the curve they have the direction of w.
        After the first zero they are opposite to w, after the second zero they have its
        direction again, and so on. If the links never move relative to each other, the
        vectors are zero.

        Parameters
        ----------
        s
            (n,) arc lengths (rad).
        pole
            The indices of the two links.
        """
        # The zeros of w on the curve. None if w is zero everywhere.
        rest_points = self.rest_points(pole)
        if rest_points is None:
            return np.zeros((len(s), 3))
        # `speed` is |w|. `growth` is |dw|, where dw is the derivative of w with respect to
        # arc length.
        speed, growth = self.links_at(s).speeds(pole)
        # The distance (rad) from a zero of w is about speed / growth. At distances up to
        # `NEAR_REST_RAD`, the direction of w is inaccurate, but the direction of dw is not.
        is_near_rest = speed <= NEAR_REST_RAD * growth
        direction = np.where(
            is_near_rest[:, None],
            self._direction_by_derivative(s, pole, rest_points),
            self._direction_by_velocity(s, pole, rest_points),
        )
        # Where w is exactly zero, the direction can be NaN. The vector zero replaces NaN,
        # so that its scalar product with w, the signed rate, is 0.
        return np.nan_to_num(direction)

    @np.errstate(invalid="ignore", divide="ignore")
    def _direction_by_velocity(
        self, s: Floats, pole: Pole, rest_points: RestPoints
    ) -> Floats:
        """Return the continuous direction (n, 3) of a pole axis, from the velocity w.

        w is the relative angular velocity of the two links of the pole. The direction of w
        reverses at each zero of w, which is undone here. The result is inaccurate near a
        zero, and NaN at the zero.

        Parameters
        ----------
        s, pole
            (n,) arc lengths (rad) along a curve of configurations, and the two links.
        rest_points
            The zeros of w.
        """
        links = self.links_at(s)
        w, _ = links.relative(*pole)
        speed, _ = links.speeds(pole)
        sense = self._sense_after_reversals(rest_points, s)
        return w / (speed * sense)[:, None]

    @np.errstate(invalid="ignore", divide="ignore")
    def _direction_by_derivative(
        self, s: Floats, pole: Pole, rest_points: RestPoints
    ) -> Floats:
        """Return the continuous direction (n, 3) of a pole axis near zeros of velocity w.

        w is the relative angular velocity of the two links of the pole, and dw its
        derivative with respect to the arc length s of a curve of configurations. Near a
        zero of w, the direction of w is inaccurate, but the direction of dw is not.
        Just before and just after the zero, dw has the same direction: the one that w
        has after the zero.

        At each zero w reverses, but the result does not. So the direction of w after the
        zero is multiplied by -1 if w has reversed an odd number of times since the start of
        the curve.

        Parameters
        ----------
        s, pole
            (n,) arc lengths (rad) within about `NEAR_REST_RAD` of a zero, and the links.
        rest_points
            The zeros of w.
        """
        links = self.links_at(s)
        _, dw = links.relative(*pole)
        _, size_of_dw = links.speeds(pole)
        # The zero is at most about `NEAR_REST_RAD` before or after s. At twice this
        # distance, w has passed the zero in any case.
        s_after_zero = s + 2.0 * NEAR_REST_RAD
        # 1 after an even number of reversals, -1 after an odd number.
        sense = self._sense_after_reversals(rest_points, s_after_zero)
        return dw / (size_of_dw * sense)[:, None]

    def _sense_after_reversals(self, rest_points: RestPoints, s: Floats) -> Floats:
        """Return 1.0 after an even number of reversals of a relative motion, else -1.0.

        Reversals are counted from the start of the curve to each arc length s (n,).
        """
        # A double zero is left out: there the rate only touches zero.
        reversals = rest_points.s[~rest_points.is_double]
        # On a closed curve s may be up to two laps long, and the zeros repeat.
        reversals = np.append(reversals, reversals + self.curve.length)
        reversal_counts = np.searchsorted(reversals, s, side="right")
        return np.where(reversal_counts % 2 == 1, -1.0, 1.0)

    def _find_rest_points(self, pole: Pole) -> RestPoints | None:
        """Return all points of a curve at which two links rest relative to each other.

        First the zeros of one component of their relative angular velocity are located. The
        component is along a constant vector, which is not at right angles to the velocity
        on the whole curve (`_choose_projection`). The result has those zeros at which the
        whole vector vanishes within its rounding error, or is None if the links rest on the
        whole curve.

        Zeros very near to an end at a crossing with other curves are left out. Rounding
        errors are large there, so any velocity may seem to be zero.
        """
        curve = self.curve
        # The velocities of all links at the nodes, the known configurations of the curve.
        node_links = self.links_at(curve.s)
        # Links rest where their relative velocity is zero within its rounding error.
        if np.all(node_links.rests(pole)):
            return None
        node_w, _ = node_links.relative(*pole)
        projection = _choose_projection(node_w)

        def projected_rate(s: Floats) -> tuple[Floats, Floats]:
            """Return one component of the relative angular velocity, and its derivative.

            The velocity is the angular velocity of the second link of `pole` relative
            to the first, at arc lengths s (n,) of the curve. The component (n,) is
            along the constant vector `projection`. Where the links rest, it is zero
            too, and a zero of one number is easy to find. The derivative is with
            respect to s.
            """
            w, dw = self.links_at(s).relative(*pole)
            return w @ projection, dw @ projection

        zeros = find_zeros(projected_rate, curve.s)
        if curve.closed:
            # The start of a closed curve is also its end. A zero there counts once.
            zeros = zeros.merge_seam(curve.length)
        # Where the component touches zero and keeps its sign, the zero is double.
        is_double = zeros.double
        # All simple zeros are moved to the nearest minimum of the length of the whole
        # vector, if it is very near. Where the links rest, this minimum is more accurate
        # than the zero, because all components contribute.
        s = self._refine_zeros(zeros.places, is_double, pole)
        # Bounds of the errors of the arc lengths s.
        errors = self._bound_zero_errors(s, is_double, pole)
        # The links rest where the whole vector vanishes. At other zeros only the component
        # along `projection` vanishes.
        vanishes = self.links_at(s).rests(pole)
        is_rest = vanishes & self._is_apart_from_crossings(s, errors)
        return RestPoints(s[is_rest], is_double[is_rest], errors[is_rest])

    def _bound_zero_errors(self, s: Floats, is_double: Bools, pole: Pole) -> Floats:
        """Return bounds (k,) of the errors of zeros of a relative angular velocity (rad).

        Let r be the bound of the rounding error of the velocity. The slope is the size
        of the derivative of the velocity with respect to arc length.

        - A simple zero moves by r over the slope at the zero. The rounding error of the arc
          length is added.
        - At a double zero the velocity touches zero like a parabola, c x^2 / 2 at the
          distance x, with the second derivative c. The velocity is below r up to x =
          sqrt(2 r / c).

        Parameters
        ----------
        s, is_double
            (k,) arc lengths of the zeros (rad), and whether they are double.
        pole
            The two links that rest relative to each other at the zeros.
        """
        length = self.curve.length
        links = self.links_at(s)
        _, slope = links.speeds(pole)
        rounding_of_s = ZERO_ROUNDING_FACTOR * EPS * length
        # `EPS` prevents a division by zero.
        errors = links.rounding / np.maximum(slope, EPS) + rounding_of_s
        curvature = self._curvature_at_double_zeros(s[is_double], pole)
        errors[is_double] = np.sqrt(2.0 * links.rounding[is_double] / curvature)
        return np.minimum(errors, length)

    def _curvature_at_double_zeros(self, s: Floats, pole: Pole) -> Floats:
        """Return the size c (k,) of the second derivative of a velocity at double zeros.

        The velocity is the relative angular velocity of two links, as a vector. All
        derivatives are with respect to the arc length of the curve of configurations.
        `_bound_zero_errors` needs c to bound the errors of the double zeros.

        At a double zero the velocity touches zero like a parabola. Its first derivative has
        the size c x at a small distance x to either side. So c is this size divided by x.
        The distance is a thousandth of the length of the curve: the velocity is still
        nearly a parabola there, and its derivative is larger than rounding errors.

        Parameters
        ----------
        s
            (k,) arc lengths of the double zeros (rad).
        pole
            The two links whose relative velocity is zero there.
        """
        distance = 1e-3 * self.curve.length
        # The derivative is taken at a point beside the zero, towards the middle of the
        # curve. So this point is never beyond an end.
        is_in_second_half = s > 0.5 * self.curve.length
        s_aside = s + np.where(is_in_second_half, -distance, distance)
        # `speeds` returns the sizes of the velocity and of its first derivative.
        _, derivative_size = self.links_at(s_aside).speeds(pole)
        # The caller divides by the result, so it must not be zero.
        return np.maximum(derivative_size / distance, EPS)

    def _is_apart_from_crossings(self, s: Floats, errors: Floats) -> Bools:
        """Return whether zeros of a velocity can be distinguished from crossings of curves.

        The curve can end at a crossing with other curves. The equations of the velocities
        are nearly singular there, and their rounding errors are large. So any velocity may
        seem to be zero. A zero only counts if it is clearly apart from such an end. Its
        distance has to be more than `CROSSING_DISTANCE_FACTOR` times its error.

        Parameters
        ----------
        s, errors
            (k,) arc lengths of the zeros, and bounds of their errors (rad).
        """
        start_status, stop_status = self.curve.ends
        least_distance = CROSSING_DISTANCE_FACTOR * errors
        is_apart = np.ones(len(s), dtype=bool)
        # A curve with this status ends at a crossing.
        if start_status == Status.AT_SINGULARITY:
            is_apart &= s > least_distance
        if stop_status == Status.AT_SINGULARITY:
            is_apart &= self.curve.length - s > least_distance
        return is_apart

    def _refine_zeros(self, s: Floats, is_double: Bools, pole: Pole) -> Floats:
        """Move zeros of one component of a velocity to nearby minima of the whole vector.

        The vector w is the relative angular velocity of two links along a curve. The given
        zeros are those of its component along a constant vector. Where all components of w
        vanish, the minimum of |w| is more accurate than the zero of one component. To find
        the minimum, Gauss-Newton steps change the arc length by -(w . w') / (w' . w'), with
        the derivative w' with respect to arc length.

        Parameters
        ----------
        s, is_double
            (k,) arc lengths of the zeros (rad), and whether they are double. Double zeros
            are not changed: w' vanishes at these, so the steps are not determined.
        pole
            The two links.

        Returns
        -------
        (k,) arc lengths of the minima (rad).
        """
        for _ in range(REST_NEWTON_STEPS):
            w, dw = self.links_at(s).relative(*pole)
            # The least divisor prevents a division by zero.
            step = np.vecdot(w, dw) / np.maximum(np.vecdot(dw, dw), EPS**2)
            # The size of the step is at most |w| / |w'|, the distance to a zero of w. A
            # long step shows that w does not vanish near s: only the component does.
            only_component_vanishes = np.abs(step) > NEAR_REST_RAD
            s = np.where(is_double | only_component_vanishes, s, s - step)
            if not self.curve.closed:
                # An open curve has no points beyond its ends. A zero at an end stays there.
                s = np.clip(s, 0.0, self.curve.length)
        # On a closed curve, a step can move a zero near the start to a slightly negative
        # arc length. Such a zero is set to the start.
        return np.maximum(s, 0.0)
