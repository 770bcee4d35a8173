"""The four arms of a saddle: their directions, and the signs of rates along them.

At a saddle two configuration curves cross or narrowly miss each other. The reduced equation
g(u, v) = 0 is then level + Q(u, v) / 2 = 0 up to small errors, with the quadratic form Q of
g''. Its zeros are four arms, one in each quadrant of u and v. The tangent of a curve g = 0
is along (-g_v, g_u). The rates of the variables along the curve are the derivatives of the
variables by u and v, applied to this tangent.
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
    Two coordinates u and v describe the points near it. All loop equations but one are
    solved there, so that all variables of the mechanism are functions of u and v. The last
    equation is g(u, v) = 0 (Lyapunov-Schmidt reduction, `ReducedEquation`). Its zeros are
    the curves.

    The derivatives are by u and v. They are balls (numbers with a bound of their error)
    that enclose all values in a rectangle about the saddle. u and v are scaled so that the
    curves of a crossing are nearly the diagonals u = v and u = -v.

    Attributes
    ----------
    variable_rates
        (variables, 2) first derivatives of the variables.
    hessian
        (2, 2) second derivatives of g.
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
    Arms are the four branches that leave it. In two coordinates u and v, the curves are the
    zeros of a function g(u, v) (`SaddleDerivatives`).

    The arms are straight if g is the quadratic form Q / 2 of its second derivatives g'',
    with Q = (u, v) g'' (u, v)^T. They are then the four lines with Q = 0, and g has the
    gradient g'' (u, v)^T on them. Real arms bend where curves narrowly miss each other. On
    them Q is not exactly 0, and the gradient is slightly different. m is the larger of |u|
    and |v| at a point.

    Attributes
    ----------
    form_error
        Bound of |Q| / m^2 at all points of the arms.
    gradient_error
        Bound of the components of the error of the gradient, divided by m.
    centre_error
        Bound (rad) of the distance of the exact saddle from the computed one, which is at
        u = v = 0.
    """

    form_error: float
    gradient_error: float
    centre_error: float


@dataclass(frozen=True)
class ArmRates:
    """Signs of the rates of the variables on the four arms, and how far the arms reach.

    A saddle is a place where two configuration curves cross or nearly do. Arms are the four
    branches that leave it, one in each quadrant of two coordinates u and v. A quadrant is a
    pair of signs of u and v, such as (1, -1). Rates are derivatives of the variables of the
    mechanism along an arm.

    Attributes
    ----------
    outward_signs
        For each quadrant (variables,) the sign of the rate of each variable on the arm, in
        the direction away from the saddle; 0 if it is not proven.
    reach
        For each quadrant (variables,) a bound (rad) of the change of each variable on the
        arm, from the point u = v = 0. This point is the computed saddle.
    """

    outward_signs: Mapping[Quadrant, Indices]
    reach: Mapping[Quadrant, Floats]


@dataclass(frozen=True)
class SlopeBounds:
    """Bounds of the slope v / u of an arm: a branch of curves that leaves a saddle.

    Both bounds have the same sign.

    Attributes
    ----------
    flat
        The bound of smaller magnitude.
    steep
        The bound of larger magnitude.
    """

    flat: float
    steep: float


@dataclass(frozen=True)
class DirectionRates:
    """The gradient of g and the signs of rates in one direction from the saddle.

    A saddle is a configuration in which two curves of configurations cross. Near it they
    are the curves g(u, v) = 0 in two coordinates u and v, with u = v = 0 at the saddle. The
    gradient of g is perpendicular to such a curve, so the curve has the tangent
    (-g_v, g_u). Rates are derivatives of the variables of the mechanism along it.

    The gradient is given at the point of the direction with u = 1 or u = -1, as if g were
    a quadratic form. At a point t (u, v) of the same direction, with t > 0, it is t times
    as large. All points of the direction therefore have the same signs.

    Attributes
    ----------
    g_u, g_v
        The derivatives of g by u and by v at this point, as balls: numbers with a bound of
        their error.
    signs
        (variables,) signs of the rates along (-g_v, g_u), 0 if not proven.
    """

    g_u: Ball
    g_v: Ball
    signs: Indices

    def opposite(self) -> "DirectionRates":
        """Return the gradient and the signs in the opposite direction, at (-u, -v).

        The gradient of a quadratic form changes its sign there, so everything does.
        """
        return DirectionRates(-self.g_u, -self.g_v, -self.signs)


def _bound_arm_slopes(hessian: Array, form_error: float) -> dict[int, SlopeBounds]:
    """Return bounds of the slope v / u of the arms, by the sign of this slope.

    A saddle is a place where two configuration curves cross or nearly do. Arms are the four
    branches that leave it, in two coordinates u and v. The bounds serve to prove the signs
    of rates along the arms.

    On an arm the quadratic form Q = a u^2 + 2 b u v - d v^2 is 0 up to an error. u and v
    are scaled so that the arms are nearly the diagonals u = v and u = -v. Then a and d are
    positive, and v / u = (b +- sqrt(b^2 + a d)) / d has one positive and one negative
    value. Their magnitudes are (sqrt(b^2 + a d) +- b) / d.

    Parameters
    ----------
    hessian
        (2, 2) the matrix of Q. Its elements are balls, numbers with a bound of their error.
    form_error
        Largest |Q(u, v)| on the arms, over the square of the larger of |u| and |v|.

    Returns
    -------
    The bounds for the signs 1 and -1.

    Raises
    ------
    ZeroDivisionError
        If the form may not have two real directions with Q = 0.
    """
    # The error of Q is at most `form_error` times u^2 if |u| is larger, which is like an
    # error of a. Otherwise it is like an error of d. Both are widened.
    a = widen(hessian[0, 0], form_error)
    d = widen(-hessian[1, 1], form_error)
    b = hessian[0, 1]
    root = (b * b + a * d).sqrt()
    magnitudes = {sign: (root + sign * b) / d for sign in (1, -1)}
    if not (a > 0 and d > 0 and magnitudes[1] > 0 and magnitudes[-1] > 0):
        raise ZeroDivisionError
    return {
        sign: SlopeBounds(
            flat=sign * lower_magnitude(ball), steep=sign * upper_magnitude(ball)
        )
        for sign, ball in magnitudes.items()
    }


def _evaluate_direction(
    derivatives: SaddleDerivatives, slope: float, gradient_error: float
) -> DirectionRates:
    """Return the gradient of g and the signs of all rates at the point u = 1, v = slope.

    The configurations near a saddle are the curve g(u, v) = 0 in two coordinates u and v,
    with u = v = 0 at the saddle. The signs tell which variables grow and which fall along
    the tangent (-g_v, g_u) of this curve. They are the same at all points of the direction
    (1, slope) from the saddle, because the gradient is proportional to the distance.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    slope
        Slope v / u of the direction.
    gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.
    """
    point = (1.0, slope)
    gradient = _enclose_gradient(derivatives.hessian, point, gradient_error)
    g_u, g_v = gradient
    # The derivative of each variable along the tangent, by the chain rule.
    rates = derivatives.variable_rates @ [-g_v, g_u]
    return DirectionRates(g_u, g_v, signs=_proven_signs(rates))


def _enclose_gradient(
    hessian: Array, point: tuple[float, float], relative_error: float
) -> list[Ball]:
    """Return g_u and g_v at a point (u, v), as balls: numbers with a bound of their error.

    The gradient is g'' (u, v)^T, up to an error.

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
    derivatives: SaddleDerivatives, slope_bounds: SlopeBounds, gradient_error: float
) -> Indices:
    """Return the signs of the rates of all variables along an arm, towards larger v.

    A saddle is a place where two configuration curves cross or nearly do, and an arm is a
    branch of them that leaves it. Near the saddle the curves are g(u, v) = 0 in two
    coordinates u and v. The arm has the tangent (-g_v, g_u), which points towards larger v
    if g_u > 0.

    The signs are evaluated in the directions of the two bounds of the slope v / u of the
    arm. A sign that is the same in both is the sign on the whole arm (`_common_signs`).

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    slope_bounds
        Bounds of the slope v / u of the arm.
    gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.

    Returns
    -------
    (variables,) the signs, 0 if not proven.
    """
    flat_rates = _evaluate_direction(derivatives, slope_bounds.flat, gradient_error)
    steep_rates = _evaluate_direction(derivatives, slope_bounds.steep, gradient_error)
    points_to_larger_v = flat_rates.g_u > 0 and steep_rates.g_u > 0
    if not points_to_larger_v:
        return np.zeros_like(flat_rates.signs)
    return _common_signs(flat_rates, steep_rates)


def _common_signs(first: DirectionRates, last: DirectionRates) -> Indices:
    """Return the signs of rates that are proven in two directions and all between them.

    Between two directions the gradient of g, and with it each rate, is a weighted mean of
    its values in both, except for errors. The balls of both values contain the errors, and
    no error between them is larger than the weighted mean of theirs. A sign that is equal
    in both directions is therefore the sign between them, too. Other signs are returned as
    0.
    """
    return np.where(first.signs == last.signs, first.signs, 0)


def _bound_changes(derivatives: SaddleDerivatives, slope_bounds: SlopeBounds) -> Floats:
    """Return bounds of the changes of all variables from u = v = 0 to points on an arm.

    A saddle is a place where two configuration curves cross or nearly do, and an arm is a
    branch of them that leaves it. Changes are linear in u and v. So the bounds are computed
    for points with max(|u|, |v|) = 1, the border of a square. A linear function on a piece
    of this border is largest at an end of the piece, or at a corner of the square in it.

    Parameters
    ----------
    derivatives
        Derivatives of the variables by u and v near the saddle.
    slope_bounds
        Bounds of the slope v / u of the arm.

    Returns
    -------
    (variables,) the bounds (rad), divided by the larger of |u| and |v|.
    """
    low, high = sorted((slope_bounds.flat, slope_bounds.steep))
    slopes = [low, high]
    corner_slope = float(np.sign(low))
    if low < corner_slope < high:
        slopes.append(corner_slope)
    points = [np.array([1.0, slope]) / max(1.0, abs(slope)) for slope in slopes]
    changes = derivatives.variable_rates @ exact_balls(points).T
    return np.array([max(map(upper_magnitude, row)) for row in changes])


def bound_arm_rates(derivatives: SaddleDerivatives, errors: ArmErrors) -> ArmRates:
    """Return the signs of all rates on the four arms, and the changes of the variables.

    A saddle is a place where two configuration curves cross or nearly do. The arms are the
    zeros of g(u, v) near it, one in each quadrant of the coordinates u and v. Rates are
    derivatives of the variables of the mechanism along an arm.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g over the rectangle.
    errors
        How much the arms differ from straight lines from the point u = v = 0: bounds of the
        errors of the quadratic form (`form_error`), of the gradient of g
        (`gradient_error`), and of the position of the saddle (`centre_error`, in rad).

    Raises
    ------
    ZeroDivisionError
        If the directions of the arms are not bounded.
    """
    slope_bounds_by_sign = _bound_arm_slopes(derivatives.hessian, errors.form_error)
    outward_signs = {}
    reach = {}
    for slope_sign, slope_bounds in slope_bounds_by_sign.items():
        # Two arms in opposite quadrants have this sign of the slope v / u. On one of them v
        # is positive and u has the sign of the slope. On the other one v is negative.
        upper_quadrant = (slope_sign, 1)
        lower_quadrant = (-slope_sign, -1)
        # Away from the saddle, v grows on the upper arm and falls on the lower one.
        signs_towards_larger_v = _prove_rate_signs(
            derivatives, slope_bounds, errors.gradient_error
        )
        outward_signs[upper_quadrant] = signs_towards_larger_v
        outward_signs[lower_quadrant] = -signs_towards_larger_v
        # The changes on both arms have the same bounds. The larger of |u| and |v| is at
        # most `derivatives.size`. The saddle may be a little beside u = v = 0.
        changes = _bound_changes(derivatives, slope_bounds)
        changes_to_border = changes * derivatives.size + errors.centre_error
        reach[upper_quadrant] = changes_to_border
        reach[lower_quadrant] = changes_to_border
    return ArmRates(outward_signs, reach)


def find_monotonic_variables(
    derivatives: SaddleDerivatives, level: Ball, gradient_at_saddle: float
) -> Bools:
    """Return which variables have no stationary point between two joined arms.

    Near a saddle the configurations are the curves g(u, v) = 0, approximately
    g = level + Q(u, v) / 2 with the quadratic form Q of the second derivatives. If the
    level, the value of g at the saddle, is not 0, the curves do not cross. Two of the four
    arms (branches) are then joined by an arc that passes the saddle at a distance, and the
    other two by an arc on the opposite side of the saddle.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g over the rectangle.
    level
        The value of g at the saddle: a ball (number with a bound of its error) that does
        not contain 0.
    gradient_at_saddle
        Bound of the components of the gradient of g at the point that counts as the saddle.

    Returns
    -------
    (variables,) whether the rate of a variable has one proven sign all along both arcs.

    Raises
    ------
    ZeroDivisionError
        If the directions of the arcs are not bounded.
    """
    # On the arcs |Q| is twice the level, up to errors. |Q| is at most m^2 times the sum of
    # all |g''|, with the larger m of |u| and |v|. So m exceeds this distance.
    least_distance = np.sqrt(
        lower_magnitude(level) / sum(map(upper_magnitude, derivatives.hessian.flat))
    )
    # If g has a gradient s at the point that counts as the saddle, g changes by up to 2 s m
    # in addition to Q / 2, and Q by up to 4 s m. `_bound_arm_slopes` needs this over m^2.
    # The gradient of g changes by s. The last digits of the factors cover rounding.
    slope_bounds_by_sign = _bound_arm_slopes(
        derivatives.hessian, 4.004 * gradient_at_saddle / least_distance
    )
    gradient_error = 1.001 * gradient_at_saddle / least_distance
    positive_slopes = slope_bounds_by_sign[1]
    negative_slopes = slope_bounds_by_sign[-1]
    # The signs on one of the two arcs. The other arc is opposite, and has the same signs
    # reversed.
    if level > 0:
        # Q is negative, so |v| is large: the directions to points of the arcs are steeper
        # than the flat bounds.
        signs = _prove_signs_across_v_axis(
            derivatives, positive_slopes.flat, negative_slopes.flat, gradient_error
        )
    else:
        # Q is positive, so |u| is large: the directions are flatter than the steep bounds.
        signs = _prove_signs_across_u_axis(
            derivatives, positive_slopes.steep, negative_slopes.steep, gradient_error
        )
    return np.asarray(signs != 0)


def _prove_signs_across_v_axis(
    derivatives: SaddleDerivatives,
    positive_slope: float,
    negative_slope: float,
    gradient_error: float,
) -> Indices:
    """Return the signs of all rates on an arc that crosses the v axis at v > 0.

    The arc is a curve g(u, v) = 0 that passes a saddle at a distance, and the rates are the
    derivatives of the variables of the mechanism along it, towards larger u.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    positive_slope, negative_slope
        Slopes v / u of the directions from the saddle to both ends of the arc.
    gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.

    Returns
    -------
    (variables,) the signs, 0 if not proven.
    """
    first = _evaluate_direction(derivatives, positive_slope, gradient_error)
    # With a negative slope the point (1, slope) has v < 0. The opposite one has v > 0.
    last = _evaluate_direction(derivatives, negative_slope, gradient_error).opposite()
    # If g falls with growing v, the tangent (-g_v, g_u) points towards larger u.
    points_to_larger_u = first.g_v < 0 and last.g_v < 0
    return _common_signs(first, last) if points_to_larger_u else np.zeros_like(first.signs)


def _prove_signs_across_u_axis(
    derivatives: SaddleDerivatives,
    positive_slope: float,
    negative_slope: float,
    gradient_error: float,
) -> Indices:
    """Return the signs of all rates on an arc that crosses the u axis at u > 0.

    The arc is a curve g(u, v) = 0 that passes a saddle at a distance, and the rates are the
    derivatives of the variables of the mechanism along it, towards larger v.

    Parameters
    ----------
    derivatives
        Derivatives of the variables and of g near the saddle.
    positive_slope, negative_slope
        Slopes v / u of the directions from the saddle to both ends of the arc.
    gradient_error
        Bound of the error of g_u and g_v, divided by the larger of |u| and |v|.

    Returns
    -------
    (variables,) the signs, 0 if not proven.
    """
    first = _evaluate_direction(derivatives, positive_slope, gradient_error)
    last = _evaluate_direction(derivatives, negative_slope, gradient_error)
    # If g grows with u, the tangent (-g_v, g_u) points towards larger v.
    points_to_larger_v = first.g_u > 0 and last.g_u > 0
    return _common_signs(first, last) if points_to_larger_v else np.zeros_like(first.signs)
