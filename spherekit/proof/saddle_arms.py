"""The four arms of a saddle: their directions, and the signs of rates along them.

At a saddle two configuration curves cross or narrowly miss each other. The reduced equation
g(u, v) = 0 is then level + Q(u, v) / 2 = 0 up to small errors, with the quadratic form Q of
g''. Its zeros are four arms, one in each quadrant of u and v. The tangent of a curve g = 0
is along (-g_v, g_u). The rates of the variables along the curve are the derivatives of the
variables with respect to u and v, applied to this tangent.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import Ball, lower_magnitude, upper_magnitude, widen

Quadrant = tuple[int, int]
"""The signs of u and v."""


@dataclass(frozen=True)
class SaddleDerivatives:
    """Derivatives of the variables and of the reduced equation g near a saddle.

    A saddle is a place where two configuration curves cross or narrowly miss each other.
    Points near it are described by two coordinates u and v. All loop equations but one are
    solved, so all variables of the mechanism are functions of u and v. The last equation is
    g(u, v) = 0 (Lyapunov-Schmidt reduction, `ReducedEquation`); its zeros are the curves.

    The derivatives with respect to u and v are balls (numbers with a bound of their error).
    These balls contain all values in a rectangle about the saddle. u and v are scaled so
    that curves that cross are nearly the diagonals u = v and u = -v.

    From the derivatives, `bound_arm_rates` proves in which sense each variable changes
    along the branches of the curves.

    Attributes
    ----------
    variable_rates
        (variables, 2) first derivatives of the variables with respect to u and v.
    hessian
        (2, 2) second derivatives of g with respect to u and v.
    size
        Largest |u| or |v| of the rectangle.
    """

    variable_rates: Array
    hessian: Array
    size: float


@dataclass(frozen=True)
class ArmErrors:
    """How much the arms of a saddle differ from four straight lines.

    A saddle is a place where two configuration curves cross or narrowly miss each other.
    Arms are the four branches that leave it. The curves are the zeros of a function g(u, v)
    of two coordinates (`SaddleDerivatives`).

    Let Q = (u, v) g'' (u, v)^T be the quadratic form of the second derivatives g''. If g is
    exactly Q / 2, the arms are the straight lines with Q = 0, and the gradient of g is g''
    (u, v)^T. In fact Q is not exactly 0 on the arms, and the gradient differs a little. The
    proof of the directions of the arms, and of signs of rates along them, allows for both
    errors.

    Curves that miss each other bend near the saddle, in the central zone. The bounds of
    both errors are valid on the arms outside this zone. Let m be the larger of |u| and |v|.

    Attributes
    ----------
    relative_form_error
        Bound of |Q| / m^2.
    relative_gradient_error
        Bound of |e| / m for both components e of the difference between the gradient of g
        and g'' (u, v)^T.
    centre_error
        Bound (rad) of the distance of the exact saddle from u = v = 0, the computed one.
    """

    relative_form_error: float
    relative_gradient_error: float
    centre_error: float


@dataclass(frozen=True)
class ArcErrors:
    """How much arcs that pass a saddle differ from curves of a quadratic function.

    A saddle is a place where two configuration curves cross or narrowly miss each other. In
    two coordinates u and v the arcs are zeros of a function g(u, v), and the slopes of g
    are 0 at the saddle, u = v = 0. Let Q = (u, v) g'' (u, v)^T be the quadratic form of the
    second derivatives. If g is exactly quadratic, g = level + Q / 2 with a constant level.
    Then Q is -2 level on the arcs, and the gradient of g is g'' (u, v)^T. The computed
    saddle u = v = 0 is not exact, so g has a small slope there. Q and the gradient
    therefore differ a little from these values. The proof that variables grow or fall all
    along the arcs allows for both differences.

    The bounds are valid at all points of the arcs. Let m be the larger of |u| and |v|.

    Attributes
    ----------
    relative_form_error
        Bound of |Q + 2 level| / m^2.
    relative_gradient_error
        Bound of |e| / m for both components e of the difference between the gradient of g
        and g'' (u, v)^T.
    """

    relative_form_error: float
    relative_gradient_error: float


@dataclass(frozen=True)
class ArmRates:
    """Signs of the rates of the variables on the four arms, and how far the arms reach.

    A saddle is a place where two configuration curves cross or nearly do. Arms are the four
    branches that leave it, one in each quadrant of two coordinates u and v. A quadrant is
    written as the signs of u and v, such as (1, -1). Rates are derivatives of the variables
    of the mechanism along an arm.

    Attributes
    ----------
    outward_signs
        For each quadrant (variables,) the sign of the rate of each variable on the arm
        outside the central zone, in the direction away from the saddle; 0 if it is not
        proven.
    reach
        For each quadrant (variables,) a bound (rad) of the change of each variable on the
        arm, from the computed saddle u = v = 0.
    """

    outward_signs: Mapping[Quadrant, Indices]
    reach: Mapping[Quadrant, Floats]


@dataclass(frozen=True)
class SlopeBounds:
    """Bounds of the slope v / u on an arm: a branch of configuration curves at a saddle.

    u and v are coordinates with the saddle at u = v = 0. Both bounds have the same sign.
    With the bounds, the signs of the rates of variables along the arm are proven.

    Attributes
    ----------
    flat
        The bound of smaller magnitude, nearer to the u axis.
    steep
        The bound of larger magnitude, nearer to the v axis.
    """

    flat: float
    steep: float


@dataclass(frozen=True)
class ArmSlopes:
    """Bounds of the ratio v / u on the four arms (branches) of a saddle.

    A saddle is a place where two configuration curves cross or narrowly miss each other.
    Points near it have coordinates u and v, with the saddle at u = v = 0. The ratio v / u
    at a point of an arm, here called its slope, is the slope of the line from the saddle to
    this point. Curves that miss each other bend near the saddle. The bounds are not valid
    in this central zone.

    Attributes
    ----------
    positive
        For the two arms of positive slope. On one arm u and v are positive, on the other
        one both are negative.
    negative
        For the two arms of negative slope. On these arms u and v have opposite signs.
    """

    positive: SlopeBounds
    negative: SlopeBounds


@dataclass(frozen=True)
class DirectionRates:
    """The gradient of g and the signs of rates in one direction from a saddle.

    A saddle is a place where two configuration curves cross or nearly do. In coordinates u
    and v they are the curves g(u, v) = 0, with the saddle at u = v = 0. A direction is a
    straight line that leaves the saddle. It consists of the points with the same ratio
    v / u, on one side of the saddle. A curve that passes through one of these points has
    the tangent (-g_v, g_u) there, perpendicular to the gradient of g. Rates are derivatives
    of the variables of the mechanism along this tangent. Their signs say which variables
    grow and which fall. `SectorRates` derives from the signs in two directions those in all
    directions between them.

    The gradient is computed at one point of the direction, (1, slope) or (-1, -slope). It
    is taken to be a linear function of u and v, up to a bounded error. So it is
    proportional to the distance from the saddle, and all points in the direction have the
    same signs.

    Attributes
    ----------
    g_u, g_v
        Derivatives of g with respect to u and v at this point, as balls (numbers with a
        bound of their error).
    signs
        (variables,) signs of the rates along (-g_v, g_u), 0 if not proven.
    """

    g_u: Ball
    g_v: Ball
    signs: Indices

    def opposite(self) -> "DirectionRates":
        """Return the gradient and the signs of rates in the opposite direction (-u, -v).

        The gradient of g, a linear function of u and v up to a bounded error, has the
        opposite sign there. So have the tangent (-g_v, g_u) and the rates of all variables
        along it.
        """
        return DirectionRates(-self.g_u, -self.g_v, -self.signs)


@dataclass(frozen=True)
class SectorRates:
    """Signs of rates in all directions from a saddle between two directions.

    A saddle is a place where two configuration curves, zeros of a function g(u, v), cross
    or nearly do. A curve near it stays between two directions from the saddle. The signs
    prove which variables of the mechanism grow along this curve, and which fall.

    Rates are derivatives of the variables along the tangent (-g_v, g_u) of the curve, where
    g_u and g_v are derivatives of g. Near the saddle, g is a constant plus a quadratic
    form, up to an error. So the rates are linear functions of u and v, up to errors. The
    rates are computed as intervals that contain these errors, and only signs of whole
    intervals are used.

    A point between the two directions is a sum of one point in each direction. A rate there
    is the sum of the rates at these two points. So a sign that is equal in both directions
    is valid between the directions.

    Attributes
    ----------
    first, last
        The gradient of g and the signs of rates in the two directions.
    """

    first: DirectionRates
    last: DirectionRates

    @property
    def is_towards_larger_u(self) -> bool:
        """Whether the tangent (-g_v, g_u) points towards larger u in all directions."""
        return bool(self.first.g_v < 0 and self.last.g_v < 0)

    @property
    def is_towards_larger_v(self) -> bool:
        """Whether the tangent (-g_v, g_u) points towards larger v in all directions."""
        return bool(self.first.g_u > 0 and self.last.g_u > 0)

    @property
    def signs(self) -> Indices:
        """(variables,) proven signs of the rates along the tangent, 0 if not proven."""
        has_common_sign = self.first.signs == self.last.signs
        return np.where(has_common_sign, self.first.signs, 0)


def _bound_arm_slopes(hessian: Array, relative_form_error: float) -> ArmSlopes:
    """Return bounds of the slopes v / u of the arms of a saddle.

    A saddle is a place where two configuration curves cross or nearly do. Arms are the four
    branches that leave it, in coordinates u and v. The bounds serve to prove the signs of
    rates along the arms.

    On an arm, the quadratic form Q = a u^2 + 2 b u v - d v^2 is 0 up to an error, which
    `relative_form_error` (called E in the comments) bounds. u and v are scaled so that the
    arms are nearly the diagonals, and a and d are positive. The slopes with Q = 0 are
    (b +- sqrt(b^2 + a d)) / d, one positive and one negative.

    Parameters
    ----------
    hessian
        (2, 2) second derivatives of g, the function with the curves as zeros. They are the
        matrix of Q, ((a, b), (b, -d)), in balls (numbers with a bound of their error).
    relative_form_error
        Largest |Q(u, v)| / m^2 on the arms, where m is the larger of |u| and |v|.

    Raises
    ------
    ZeroDivisionError
        If it is not certain that Q = 0 has one positive and one negative slope.
    """
    # On an arm Q = e m^2 with |e| <= E. Where |u| is larger, m^2 = u^2, and Q with a - e
    # for a is exactly 0. Where |v| is larger, Q with d + e for d is exactly 0. So the balls
    # of a and d are widened by E, to contain these coefficients.
    a = widen(hessian[0, 0], relative_form_error)
    d = widen(-hessian[1, 1], relative_form_error)
    b = hessian[0, 1]
    root = (b * b + a * d).sqrt()
    positive_slope = (root + b) / d
    negative_slope_size = (root - b) / d
    if not (a > 0 and d > 0 and positive_slope > 0 and negative_slope_size > 0):
        raise ZeroDivisionError
    return ArmSlopes(
        positive=SlopeBounds(
            flat=lower_magnitude(positive_slope),
            steep=upper_magnitude(positive_slope),
        ),
        negative=SlopeBounds(
            flat=-lower_magnitude(negative_slope_size),
            steep=-upper_magnitude(negative_slope_size),
        ),
    )


def _evaluate_direction(
    derivatives: SaddleDerivatives, slope: float, relative_gradient_error: float
) -> DirectionRates:
    """Return the gradient of g and the signs of all rates in one direction from a saddle.

    Configuration curves g(u, v) = 0 cross or nearly do at the saddle, u = v = 0. A curve
    through a point (u, v) has the tangent (-g_v, g_u) there. The signs say which variables
    grow and which fall along this tangent. `SectorRates` derives from the signs in two
    directions those in all directions between them.

    The points in the direction are those with u > 0 and v = slope * u. The gradient is
    computed at u = 1. Up to a bounded error it is the linear function g'' (u, v)^T, so it
    is proportional to u at the other points. The signs are therefore the same there.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    slope
        Slope v / u of the direction.
    relative_gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.
    """
    point = (1.0, slope)
    g_u, g_v = _enclose_gradient(derivatives.hessian, point, relative_gradient_error)
    tangent = [-g_v, g_u]
    # (variables,) = (variables, 2) times (2,), by the chain rule.
    rates = derivatives.variable_rates @ tangent
    return DirectionRates(g_u, g_v, signs=_proven_signs(rates))


def _enclose_gradient(
    hessian: Array, point: tuple[float, float], relative_error: float
) -> list[Ball]:
    """Return g_u and g_v at a point (u, v), as balls: numbers with a bound of their error.

    g is a function with configuration curves as zeros. Its gradient is 0 at the saddle
    u = v = 0, where curves cross or nearly do. So the gradient at (u, v) is g'' (u, v)^T up
    to an error. g_u and g_v are its components, the derivatives with respect to u and v.

    Parameters
    ----------
    hessian
        (2, 2) balls of the second derivatives g''.
    point
        u and v.
    relative_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.
    """
    u, v = point
    error = relative_error * max(abs(u), abs(v))
    return [widen(entry, error) for entry in hessian @ exact_balls([u, v])]


def _proven_signs(balls: Array) -> Indices:
    """Return the signs (n,) of balls (n,), 0 for each ball that contains 0."""
    return (balls > 0).astype(int) - (balls < 0)


def _prove_rate_signs(
    derivatives: SaddleDerivatives,
    slope_bounds: SlopeBounds,
    relative_gradient_error: float,
) -> Indices:
    """Return the signs of the rates of all variables along an arm, towards larger v.

    An arm is a branch of configuration curves, the zeros of g(u, v), that leaves a saddle
    (where curves cross or nearly do) at u = v = 0. Rates are derivatives of the variables
    along the tangent (-g_v, g_u) of the arm, with the derivatives g_u and g_v of g. If g_u
    is proven to be positive, v grows along this tangent.

    The slope v / u on the arm is between two bounds. The function g is a quadratic form up
    to a small error, so each rate is a linear function of u and v. If a rate has the same
    sign in the directions of both bounds, it has this sign on the whole arm.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    slope_bounds
        Bounds of the slope v / u of the arm.
    relative_gradient_error
        Bound of the error of the derivatives of g with respect to u and v, divided by the
        larger of |u| and |v|.

    Returns
    -------
    (variables,) the signs, 0 if not proven.
    """
    # `flat` and `steep` are the slope bounds of smaller and of larger magnitude. The rates
    # are evaluated at points with u > 0. The result is also valid for the opposite arm: at
    # (-u, -v) the tangent (-g_v, g_u) and all rates along it are reversed. So the signs
    # towards larger v are the same as at (u, v).
    sector = SectorRates(
        first=_evaluate_direction(derivatives, slope_bounds.flat, relative_gradient_error),
        last=_evaluate_direction(derivatives, slope_bounds.steep, relative_gradient_error),
    )
    # Without a proof that v grows along (-g_v, g_u), no sign is known.
    if not sector.is_towards_larger_v:
        return np.zeros_like(sector.signs)
    return sector.signs


def _bound_changes(derivatives: SaddleDerivatives, slope_bounds: SlopeBounds) -> Floats:
    """Return bounds of the changes of all variables from a saddle to points on an arm.

    A saddle is a place where two configuration curves cross or nearly do. An arm is a
    branch of these curves that leaves it. Points near the saddle have two coordinates u and
    v, and the saddle is at u = v = 0. The caller needs to know how far the arm reaches.

    By the mean value theorem, the change of a variable from the saddle to the point (u, v)
    is r . (u, v). The vector r has the derivatives of the variable at a point near the
    saddle. The bound of this change is proportional to max(|u|, |v|), so it is computed for
    max(|u|, |v|) = 1.

    Parameters
    ----------
    derivatives
        Derivatives of the variables with respect to u and v near the saddle.
    slope_bounds
        Bounds of the slope v / u of the arm.

    Returns
    -------
    (variables,) bounds (rad) of the changes, divided by the larger of |u| and |v|.
    """
    # A linear function of u and v has its largest magnitude, relative to max(|u|, |v|), in
    # the direction of one of these points.
    points = _list_extreme_points(slope_bounds)
    # (variables, points) = (variables, 2) times (2, points). The derivatives are balls
    # (numbers with a bound of their error) that contain all values near the saddle.
    changes = derivatives.variable_rates @ exact_balls(points).T
    return np.array([max(map(upper_magnitude, row)) for row in changes])


def _list_extreme_points(slope_bounds: SlopeBounds) -> list[Floats]:
    """Return points (u, v) that bound all linear functions of u and v on an arm.

    An arm is a curve on which the slope v / u is between two bounds of the same sign,
    `flat` and `steep`. A linear function a u + b v is proportional to the size of (u, v),
    here the larger of |u| and |v|. So it is enough to examine points of size 1. If the
    magnitude of the function is at most c at the returned points, it is at most c times
    the size at all points of the arm.

    The points of size 1 are the border of a square. Between both slopes the border is a
    straight line, or two lines that meet at a corner of the square. The magnitude of a
    linear function is largest at an end of a line. The ends are returned as vectors (2,)
    with u > 0. At the opposite points, linear functions have the same magnitudes.
    """
    low, high = sorted((slope_bounds.flat, slope_bounds.steep))
    slopes = [low, high]
    # The corner has u = 1, and v = 1 or -1 with the sign of the slopes.
    corner_slope = float(np.sign(low))
    if low < corner_slope < high:
        slopes.append(corner_slope)
    return [np.array([1.0, slope]) / max(1.0, abs(slope)) for slope in slopes]


def bound_arm_rates(derivatives: SaddleDerivatives, errors: ArmErrors) -> ArmRates:
    """Return whether each variable grows along the arms of a saddle, and bounds of changes.

    A saddle is a place where two configuration curves cross or nearly do. Near it, the
    curves are the zeros of a function g(u, v) of two coordinates. They are known in a
    rectangle about the computed saddle, u = v = 0. The arms are the four branches that
    leave the saddle, one in each quadrant of u and v.

    The rate of a variable is its derivative along an arm, away from the saddle. Where a
    rate has a proven sign, the variable is not stationary on the arm. Where it has none,
    the variable may be stationary. The bound of its change (`reach`) then says how far from
    the saddle this can be.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g in the rectangle.
    errors
        If g were a quadratic form, the arms would be straight lines. The errors bound how
        much the arms and the gradient of g differ from this case.

    Returns
    -------
    For each arm, the proven signs of the rates of all variables (`outward_signs`), and
    bounds (rad) of the changes of all variables on the arm (`reach`).

    Raises
    ------
    ZeroDivisionError
        If the slopes of the arms cannot be bounded.
    """
    # Bounds of the slopes v / u. Arms in opposite quadrants have the same bounds:
    # `positive` where u and v have equal signs, `negative` where their signs differ.
    arm_slopes = _bound_arm_slopes(derivatives.hessian, errors.relative_form_error)
    outward_signs = {}
    reach = {}
    # A quadrant is written as the signs of u and v.
    for slope_bounds, quadrant_of_larger_v, quadrant_of_smaller_v in (
        (arm_slopes.positive, (1, 1), (-1, -1)),
        (arm_slopes.negative, (-1, 1), (1, -1)),
    ):
        # The first arm leads away from the saddle towards larger v, the second towards
        # smaller v. So the outward signs of the second arm are reversed.
        signs_towards_larger_v = _prove_rate_signs(
            derivatives, slope_bounds, errors.relative_gradient_error
        )
        outward_signs[quadrant_of_larger_v] = signs_towards_larger_v
        outward_signs[quadrant_of_smaller_v] = -signs_towards_larger_v
        # The bounds are divided by the larger of |u| and |v|, which is at most the size of
        # the rectangle. `centre_error` is added because the exact saddle may be a little
        # beside the computed one, u = v = 0.
        relative_changes = _bound_changes(derivatives, slope_bounds)
        changes_to_border = relative_changes * derivatives.size + errors.centre_error
        reach[quadrant_of_larger_v] = changes_to_border
        reach[quadrant_of_smaller_v] = changes_to_border
    return ArmRates(outward_signs, reach)


def find_monotonic_variables(
    derivatives: SaddleDerivatives, level: Ball, gradient_at_saddle: float
) -> Bools:
    """Return a mask of variables without stationary point between two joined saddle arms.

    Near a saddle the configurations are the curves g(u, v) = 0, with g = level + Q(u, v) /
    2 up to errors. Q is a quadratic form, positive on the u axis and negative on the v
    axis. If the level is not 0, the curves do not cross. Then two of the four arms
    (branches) are joined by an arc that passes the saddle. The other two are joined by an
    arc on the opposite side, in the opposite directions (-u, -v). In opposite directions
    the bounds of the rates differ only in sign (`DirectionRates`). So a proof for one arc
    is valid for both.

    The rate of a variable is its derivative along the tangent (-g_v, g_u) of the curve. Two
    conditions are proven on the whole arc:

    - The tangent points towards larger u on an arc about the v axis, and towards larger v
      on an arc about the u axis. So the tangent leads along the arc without turning back.
    - The rate of the variable has one sign. So the variable grows or falls all along the
      arc.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g in a rectangle about the saddle.
    level
        The value of g at the saddle, a ball (number with a bound of its error) without 0.
    gradient_at_saddle
        Bound of both components of the gradient of g at the computed saddle.

    Returns
    -------
    (variables,) whether the rate of the variable has one proven sign along both arcs.

    Raises
    ------
    ZeroDivisionError
        If the slopes of the arms cannot be bounded.
    """
    # How much the arcs differ from curves of a quadratic function g.
    errors = _bound_arc_errors(derivatives.hessian, level, gradient_at_saddle)
    arm_slopes = _bound_arm_slopes(derivatives.hessian, errors.relative_form_error)
    if level > 0:
        # Q is negative on the arcs, so they are seen in directions about the v axis.
        sector = _evaluate_sector_about_v_axis(
            derivatives, arm_slopes, errors.relative_gradient_error
        )
        has_known_sense = sector.is_towards_larger_u
    else:
        # Q is positive on the arcs, so they are seen in directions about the u axis.
        sector = _evaluate_sector_about_u_axis(
            derivatives, arm_slopes, errors.relative_gradient_error
        )
        has_known_sense = sector.is_towards_larger_v
    # The sign of a rate is 0 if it is not proven.
    has_proven_sign = sector.signs != 0
    return has_known_sense & has_proven_sign


def _bound_arc_errors(hessian: Array, level: Ball, gradient_at_saddle: float) -> ArcErrors:
    """Return how much arcs that pass a saddle differ from curves of a quadratic function.

    The arcs are configurations with g(u, v) = 0, where g = level + Q(u, v) / 2 + error,
    with a quadratic form Q. The computed saddle u = v = 0 is not exact, so g has a small
    gradient there, with components of at most s. This is the only error: the coefficients
    of Q are balls that contain the second derivatives everywhere in the rectangle about the
    saddle, so Q has no error of its own.

    Let m be the larger of |u| and |v|. In each direction from the saddle, Q is proportional
    to m^2 and its gradient to m. The caller examines directions, so the errors are divided
    by m^2 and by m.

    - The gradient adds at most s |u| + s |v| <= 2 s m to g. So Q, which has the factor
      1 / 2 in g, differs from -2 level by at most 4 s m. Divided by m^2, this is
      `relative_form_error`, 4 s / m.
    - The derivatives of g with respect to u and v have an error of at most s. Divided by
      m, this is `relative_gradient_error`, s / m.

    Both quotients are largest at the point of the arcs with the least m, and are returned
    for this point.

    Parameters
    ----------
    hessian
        (2, 2) second derivatives of g, the matrix of Q, in balls (numbers with a bound of
        their error).
    level
        The value of g at the saddle, a ball that does not contain 0.
    gradient_at_saddle
        The bound s of both components of the gradient at the computed saddle.
    """
    # A lower bound of m on the arcs.
    least_distance = _bound_distance_from_saddle(hessian, level)
    # 4 s / m and s / m. The factors 4 and 1 are increased a little for rounding.
    return ArcErrors(
        relative_form_error=4.004 * gradient_at_saddle / least_distance,
        relative_gradient_error=1.001 * gradient_at_saddle / least_distance,
    )


def _bound_distance_from_saddle(hessian: Array, level: Ball) -> float:
    """Return a lower bound of m, the larger of |u| and |v|, on arcs that pass a saddle.

    The caller divides errors by m, and so needs the least m of the arcs.

    The arcs are zeros of a function g(u, v) = level + Q(u, v) / 2 up to an error, with the
    quadratic form Q of the second derivatives g''. Without the error, |Q| is 2 |level| on
    the arcs. The bound allows for errors of Q up to |level|, so that |Q| >= |level|. Also,
    |Q| <= m^2 S, where S is the sum of the magnitudes of the elements of g''. Both give
    m^2 >= |level| / S.

    The bound may be false if the error of Q is larger. Nothing is proven then, because
    `relative_form_error` exceeds S, and `_bound_arm_slopes` raises `ZeroDivisionError`.

    Parameters
    ----------
    hessian
        (2, 2) balls (numbers with a bound of their error): g'', the matrix of Q.
    level
        The value of g at the saddle, a ball that does not contain 0.
    """
    sum_of_magnitudes = sum(map(upper_magnitude, hessian.flat))
    return float(np.sqrt(lower_magnitude(level) / sum_of_magnitudes))


def _evaluate_sector_about_v_axis(
    derivatives: SaddleDerivatives, arm_slopes: ArmSlopes, relative_gradient_error: float
) -> SectorRates:
    """Return the signs of rates at both edges of a sector about the positive v axis.

    A saddle is at u = v = 0. An arc of a configuration curve g(u, v) = 0 passes near the
    saddle, at v > 0. The arc joins two arms (branches): one with a slope v / u > 0 and one
    with a slope < 0. Each slope is known between two bounds. The edges of the sector are
    rays from the saddle, one for each arm. Their slopes are the bounds of smaller magnitude
    (the flat ones), so the sector contains the whole arc.

    Rates are derivatives of the variables along the curve. Up to errors for which the signs
    allow, they are linear functions of u and v. The rate at a point between the edges is
    then the sum of the rates at one point of each edge. So a sign that is equal at both
    edges is valid in the whole sector. The caller proves by this sign that a variable only
    grows or only falls along the arc.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    arm_slopes
        Bounds of the slopes v / u of the arms.
    relative_gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.
    """
    above_u_axis = _evaluate_direction(
        derivatives, arm_slopes.positive.flat, relative_gradient_error
    )
    # With a negative slope, the direction (1, slope) has v < 0. The edge of the sector has
    # v > 0, so it is the opposite direction.
    below_u_axis = _evaluate_direction(
        derivatives, arm_slopes.negative.flat, relative_gradient_error
    )
    return SectorRates(first=above_u_axis, last=below_u_axis.opposite())


def _evaluate_sector_about_u_axis(
    derivatives: SaddleDerivatives, arm_slopes: ArmSlopes, relative_gradient_error: float
) -> SectorRates:
    """Return the signs of rates at both edges of a sector about the positive u axis.

    A saddle is at u = v = 0. An arc of a configuration curve g(u, v) = 0 passes near the
    saddle, at u > 0. The arc joins two arms (branches): one with a slope v / u > 0 and one
    with a slope < 0. Each slope is known between two bounds. The edges of the sector are
    rays from the saddle, one for each arm. Their slopes are the bounds of larger magnitude
    (the steep ones), so the sector contains the whole arc.

    Rates are derivatives of the variables along the curve. Up to errors for which the signs
    allow, they are linear functions of u and v. The rate at a point between the edges is
    then the sum of the rates at one point of each edge. So a sign that is equal at both
    edges is valid in the whole sector. The caller proves by this sign that a variable only
    grows or only falls along the arc.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    arm_slopes
        Bounds of the slopes v / u of the arms.
    relative_gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.
    """
    # Both edges are directions (1, slope), with u > 0.
    above_u_axis = _evaluate_direction(
        derivatives, arm_slopes.positive.steep, relative_gradient_error
    )
    below_u_axis = _evaluate_direction(
        derivatives, arm_slopes.negative.steep, relative_gradient_error
    )
    return SectorRates(first=above_u_axis, last=below_u_axis)
