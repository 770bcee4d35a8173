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
    quadratic_form
        Bound of |Q| / m^2 at all points of the arms.
    gradient
        Bound of the components of the error of the gradient, divided by m.
    centre
        Bound (rad) of the distance of the exact saddle from the computed one, which is at
        u = v = 0.
    """

    quadratic_form: float
    gradient: float
    centre: float


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
class DirectionRates:
    """The gradient of g and the signs of rates in one direction from the saddle.

    A saddle is a configuration in which two curves of configurations cross. Near it they
    are the curves g(u, v) = 0 in two coordinates u and v, with u = v = 0 at the saddle. The
    gradient of g is perpendicular to such a curve, so the curve has the tangent
    (-g_v, g_u). Rates are derivatives of the variables of the mechanism along it.

    Attributes
    ----------
    g_u, g_v
        The derivatives of g by u and by v at points near the saddle, divided by ``|u|``. At
        the saddle they are 0, and near it they are about proportional to the distance. They
        are balls, which are numbers with a bound of their error.
    signs
        (variables,) signs of the rates along (-g_v, g_u), 0 if not proven.
    """

    g_u: Ball
    g_v: Ball
    signs: Indices

    def opposite(self) -> "DirectionRates":
        """Return the same for the opposite direction from the saddle."""
        return DirectionRates(-self.g_u, -self.g_v, -self.signs)


def _bound_arm_slopes(hessian: Array, form_error: float) -> dict[int, tuple[float, float]]:
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
    For the signs 1 and -1 the bounds, that of smaller magnitude first.

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
        sign: (sign * lower_magnitude(ball), sign * upper_magnitude(ball))
        for sign, ball in magnitudes.items()
    }


def _evaluate_direction(
    derivatives: SaddleDerivatives, slope: float, gradient_error: float
) -> DirectionRates:
    """Return the gradient of g and the signs of all rates in a direction (1, slope).

    The configurations near a saddle are the curve g(u, v) = 0 in two coordinates u and v,
    with u = v = 0 at the saddle. At the point (u, v) the gradient (g_u, g_v) is the matrix
    g'' times (u, v), up to an error of `gradient_error` times the larger of |u| and |v|. It
    is proportional to the distance from the saddle, so its signs depend on the direction
    only. The curve has the tangent (-g_v, g_u), and the rates of the variables along it are
    their derivatives by u and v times this tangent.

    The signs tell which variables grow and which fall along this tangent. The numbers are
    balls (intervals with a centre and a radius). A sign is 0 if the ball of the rate
    contains 0, so that nothing is proven.
    """
    # The gradient is divided by u, so it is computed for u = 1 and v = slope, of which
    # the larger one has this size. `widen` adds the error to the radius of a ball.
    error = gradient_error * max(1.0, abs(slope))
    direction = exact_balls([1.0, slope])
    g_u, g_v = (widen(entry, error) for entry in derivatives.hessian @ direction)
    rates = derivatives.variable_rates @ [-g_v, g_u]
    return DirectionRates(g_u, g_v, signs=(rates > 0).astype(int) - (rates < 0))


def _prove_rate_signs(
    derivatives: SaddleDerivatives, slope_bounds: tuple[float, float], gradient_error: float
) -> Indices:
    """Return the signs of the rates of all variables along an arm, towards larger v.

    A saddle is a place where two configuration curves cross or nearly do, and an arm is a
    branch of them that leaves it. The arm is a curve g(u, v) = 0 with the tangent
    (-g_v, g_u), which points towards larger v if g_u > 0. The gradient (g_u, g_v) and the
    rates along the tangent are linear in the slope v / u of the arm, up to errors. A sign
    that is proven at both bounds of this slope is therefore proven for the whole arm.

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
    first, last = (
        _evaluate_direction(derivatives, slope, gradient_error) for slope in slope_bounds
    )
    points_to_larger_v = first.g_u > 0 and last.g_u > 0
    if not points_to_larger_v:
        return np.zeros_like(first.signs)
    return np.where(first.signs == last.signs, first.signs, 0)


def _bound_changes(
    derivatives: SaddleDerivatives, slope_bounds: tuple[float, float]
) -> Floats:
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
        Bounds of the slope v / u of the arm, which have the same sign.

    Returns
    -------
    (variables,) the bounds (rad), divided by the larger of |u| and |v|.
    """
    low, high = sorted(slope_bounds)
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
        How much the arms differ from straight lines.

    Raises
    ------
    ZeroDivisionError
        If the directions of the arms are not bounded.
    """
    outward_signs = {}
    reach = {}
    # Two arms have a positive slope v / u, and two a negative one; `sign` is this sign.
    for sign, slope_bounds in _bound_arm_slopes(
        derivatives.hessian, errors.quadratic_form
    ).items():
        signs_towards_larger_v = _prove_rate_signs(
            derivatives, slope_bounds, errors.gradient
        )
        # From the saddle to the border of the rectangle, where the larger of |u| and |v| is
        # at most `derivatives.size`. The saddle may be a little beside u = v = 0.
        changes = (
            _bound_changes(derivatives, slope_bounds) * derivatives.size + errors.centre
        )
        # Two arms in opposite quadrants have this sign of the slope. One leaves the saddle
        # towards larger v, the other one towards smaller v.
        for v_sign in (1, -1):
            quadrant = sign * v_sign, v_sign
            outward_signs[quadrant] = v_sign * signs_towards_larger_v
            reach[quadrant] = changes
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
    slope_bounds = _bound_arm_slopes(
        derivatives.hessian, 4.004 * gradient_at_saddle / least_distance
    )
    gradient_error = 1.001 * gradient_at_saddle / least_distance
    flat_positive, steep_positive = slope_bounds[1]
    flat_negative, steep_negative = slope_bounds[-1]
    # The directions from the saddle to both ends of one arc. The other arc is opposite, and
    # has the same signs reversed.
    if level > 0:
        # Q is negative, so |v| is large. The arc with v > 0 crosses the v axis. All its
        # directions are steeper than the flat bounds.
        first = _evaluate_direction(derivatives, flat_positive, gradient_error)
        last = _evaluate_direction(derivatives, flat_negative, gradient_error).opposite()
        # g falls with growing v, so the tangent (-g_v, g_u) points towards larger u.
        is_oriented = first.g_v < 0 and last.g_v < 0
    else:
        # Q is positive, so |u| is large. The arc with u > 0 crosses the u axis. All its
        # directions are flatter than the steep bounds.
        first = _evaluate_direction(derivatives, steep_positive, gradient_error)
        last = _evaluate_direction(derivatives, steep_negative, gradient_error)
        # g grows with u, so the tangent points towards larger v.
        is_oriented = first.g_u > 0 and last.g_u > 0
    # Rates are linear in the direction. They keep their sign along the arc if they have it
    # in the directions to both ends.
    has_equal_signs = (first.signs == last.signs) & (first.signs != 0)
    return np.asarray(is_oriented & has_equal_signs)
