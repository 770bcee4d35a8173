"""Saddles: positions where configuration curves cross, or narrowly miss each other.

Near such a position the configurations are the zeros of a reduced equation g(u, v)
(`spherekit.proof.reduced_equation`) in a rectangle. Suppose that g is convex in u and
concave in v, positive on the sides u = +-r, and negative and lower than g(0, 0) at
(0, +-s), where s is a small part of the extent of the rectangle along v. The zeros are then
four arms, one in each quadrant, which leave through the sides of constant v.

How the arms are joined depends on the level c only, the largest value over v of the least
value of g over u. If c is 0, two curves cross in one point. Otherwise they are two arcs
that miss each other, and the sign of c says which arms they join. The value and the slopes
of g at any point of the rectangle enclose c:

- c exceeds this value by at most the slope by v times the length of the rectangle along v,
  because g is concave in v.
- c is below this value by at most the slope by u times the length of the rectangle along u,
  because g is convex in u.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import (
    Ball,
    centre_floats,
    lower_magnitude,
    upper_magnitude,
    widen,
    working_precision,
)
from spherekit.proof.reduced_equation import (
    ReducedEquation,
    SaddleReduction,
    reduce_at_saddle,
    zero_balls,
)
from spherekit.proof.saddle_arms import (
    ArmErrors,
    ArmRates,
    Quadrant,
    SaddleDerivatives,
    bound_arm_rates,
    find_monotonic_variables,
)
from spherekit.proof.tubes import COORDINATE_ROUNDING_RAD, OrientedBox

LEVEL_PRECISIONS_BITS = (80, 160, 320, 640)
"""Bits of ball centres in which the level is enclosed until its sign is known.

More bits tell narrower gaps from crossings, and take longer where the level is 0.
"""

LARGEST_RECTANGLE_RAD = 0.4
"""Half width (rad) of the largest rectangle that is tried.

Larger: more trials that fail. Smaller: arms are shorter.
"""

SMALLEST_RECTANGLE_RAD = 1e-5
"""Half width (rad) below which no rectangle is tried.

Larger: sharply bent crossings are missed. Smaller: more trials that fail.
"""

RECTANGLE_REDUCTION = 0.75
"""Half width of each rectangle that is tried, over the half width of the one before.

Larger: more trials. Smaller: rectangles are smaller than necessary.
"""

CROSSING_RECTANGLE_RAD = 0.02
"""Half width (rad) below which a crossing is accepted although rate signs are open.

A smaller rectangle may show more signs of rates. Larger: more signs stay open. Smaller:
arms reach less far, so that chains need more arcs near the crossing.
"""

GAP_RECTANGLE_RAD = 1e-3
"""Half width (rad) below which a near crossing is accepted although rate signs are open.

A near crossing is a saddle with a level that is not proven to be 0. The effects of larger
or smaller values are the same as for `CROSSING_RECTANGLE_RAD`.
"""

INNER_HEIGHT_RATIO = 1.0 / 16.0
"""Part of the height of the rectangle beyond which the quadrants distinguish the arms.

Larger: chains end on arms only farther from the saddle. Smaller: the test fails more often.
"""

HEIGHT_RATIO = 0.7
"""Height of the rectangle over its width, in units in which the arms are diagonals.

It is below 1 so that the arms leave through the sides of constant v.
"""

STRAIGHT_ARM_RATIO = 100.0
"""Distance from a saddle, over the gap, beyond which arms count as straight.

Larger: rate signs are proven only farther away. Smaller: the bend near the gap leaves more
signs open.
"""


@dataclass(frozen=True)
class Saddle(OrientedBox):
    """An oriented box with four arms of configuration curves that meet, or nearly do.

    The first two coordinates of the box are u and v. The configurations in the box are the
    zeros of a function g(u, v). The configurations form four branches (arms), one in each
    quadrant of u and v. A rate is the derivative of a variable along an arm.

    Attributes
    ----------
    level_sign
        Sign of the level, the value of g at its saddle point: 0 if the curves are proven to
        cross, None if no sign is proven. With a positive level the arms of equal sign of v
        are joined, with a negative level the arms of equal sign of u.
    gap
        Upper bound (rad) of the distance between the curves where they miss each other.
    central_zone
        (variables,) half width (rad), in each variable, of the zone about the centre in
        which the arms bend. The signs of rates do not apply in this zone.
    outward_signs
        For each quadrant (variables,) the sign of the rate of each variable on the arm
        outside the central zone, in the direction away from the saddle; 0 if it is not
        proven.
    reach
        For each quadrant (variables,) the largest change (rad) of each variable on the arm
        from the centre.
    is_monotonic
        (variables,) whether a variable is proven to have no stationary point between two
        arms that are joined.
    """

    level_sign: int | None
    gap: float
    central_zone: Floats
    outward_signs: Mapping[Quadrant, Indices]
    reach: Mapping[Quadrant, Floats]
    is_monotonic: Bools

    def point_near_arm(self, quadrant: Quadrant) -> Floats:
        """Return a point (variables,) near an arm, close to where it leaves the box."""
        uv = 0.9 * np.array([HEIGHT_RATIO, 1.0]) * self.limits[:2] * quadrant
        return self.centre + self.frame[:, :2] @ uv

    def find_quadrant(self, position: Floats, error: float) -> Quadrant | None:
        """Return the quadrant of the arm that a configuration is on, None if not proven.

        A saddle is a place where two configuration curves cross or narrowly miss each
        other. Four branches of the curves, its arms, lead away from it. The quadrant of an
        arm is the signs of the coordinates u and v in the box of the saddle. With the
        result, the caller tells on which arm a piece of a known curve lies.

        Near the centre a curve can pass from one quadrant to another, so the signs do not
        identify an arm there. Let h be `INNER_HEIGHT_RATIO` times the half height of the
        box. Where ``|v|`` exceeds h, each quadrant is proven to contain exactly one arm.

        Parameters
        ----------
        position
            (variables,) approximate values (rad) of the variables in the configuration.
        error
            Largest distance (rad) of the configuration from the position.
        """
        # The axes of the box are orthonormal, so coordinates have at most the error of the
        # position. `limits` are the half lengths of the box.
        u, v = self.coordinates(position)[:2]
        inner_height = INNER_HEIGHT_RATIO * self.limits[1]
        is_outside_centre = abs(v) - error > inner_height + COORDINATE_ROUNDING_RAD
        # Outside the centre the sign of v is certain. The sign of u needs a separate test.
        has_sign_of_u = abs(u) > error + COORDINATE_ROUNDING_RAD
        if not (is_outside_centre and has_sign_of_u and self.contains(position, error)):
            return None
        return int(np.sign(u)), int(np.sign(v))


def find_saddle(
    equations: ArcEquations,
    position: Floats,
    is_proven_crossing: Callable[[OrientedBox], bool],
    is_allowed: Callable[[OrientedBox], bool],
) -> Saddle | None:
    """Return the saddle near a position, None if none is found.

    A saddle is a place where configuration curves cross or narrowly miss each other, in a
    box that is proven to contain it. All equations but one determine the variables there
    as functions of two coordinates u and v. The last equation is g(u, v) = 0, where g has a
    saddle point. The curves cross if the value of g at this point is 0.

    Curves cannot be followed through a saddle. So the caller lets them begin and end there,
    and does not search the box of the saddle for further curves.

    Boxes about the saddle are tried, from large to small. The first one is used in which a
    saddle is proven and that is good enough (`_is_good_enough`).

    Parameters
    ----------
    equations
        The equations of the mechanism.
    position
        (variables,) a position (rad) near which a saddle may be. It is where the following
        of a curve failed, or the centre of a box that may contain unknown curves.
    is_proven_crossing
        Function that returns whether a box is proven to contain a crossing: a configuration
        in which the derivatives of the equations lose a rank.
    is_allowed
        Function that returns whether a box may be used, because boxes of saddles must not
        overlap. A saddle is itself an oriented box.
    """
    # Balls are numbers with error bounds. Dividing by a ball that contains 0 raises
    # `ZeroDivisionError`. If `reduce_at_saddle` raises it, no saddle is found.
    with working_precision(LEVEL_PRECISIONS_BITS[0]), suppress(ZeroDivisionError):
        saddle_reduction = reduce_at_saddle(equations, position)
        size = LARGEST_RECTANGLE_RAD
        while size > SMALLEST_RECTANGLE_RAD:
            # `_prove_saddle` catches this error and returns None, so that smaller boxes are
            # still tried.
            saddle = _prove_saddle(saddle_reduction, size, is_proven_crossing)
            if saddle is not None and is_allowed(saddle) and _is_good_enough(saddle, size):
                return saddle
            size *= RECTANGLE_REDUCTION
    return None


def _is_good_enough(saddle: Saddle, size: float) -> bool:
    """Return whether no smaller box about a saddle needs to be tried.

    At a saddle curves of configurations cross or nearly do; four arms (branches) leave it.
    A box is good if it proves on all arms whether each variable grows or falls. A smaller
    box may prove more of these signs, but contains less of the curves. So a small box is
    accepted even without all signs.

    Parameters
    ----------
    saddle
        The saddle, as proven with this box.
    size
        Half width (rad) of the box.
    """
    # On each arm, a sign of 0 means that it is not proven whether the variable grows or
    # falls.
    has_open_sign = any(0 in signs for signs in saddle.outward_signs.values())
    # The level is 0 only if the curves are proven to cross. Otherwise they may miss each
    # other, and smaller boxes are tried.
    curves_cross = saddle.level_sign == 0
    small_size = CROSSING_RECTANGLE_RAD if curves_cross else GAP_RECTANGLE_RAD
    return size < small_size or not has_open_sign


def _prove_saddle(
    saddle_reduction: SaddleReduction,
    size: float,
    is_proven_crossing: Callable[[OrientedBox], bool],
) -> Saddle | None:
    """Return the saddle with a rectangle of one size, None if that is not proven.

    The configurations near the saddle are the zeros of a function g(u, v), the reduced
    equation, in a rectangle of two coordinates. The zeros have to be four branches, the
    arms. The level, the value of g at its saddle point, decides how the arms are joined; if
    it is 0, they cross. The signs of the rates of all variables along the arms follow.

    Parameters
    ----------
    saddle_reduction
        The reduced equation about its saddle point.
    size
        Half width (rad) of the rectangle, in the units of `SaddleReduction.units`.
    is_proven_crossing
        See `find_saddle`.
    """
    reduced_equation = saddle_reduction.reduced_equation
    frame = reduced_equation.frame
    rectangle = np.array([1.0, HEIGHT_RATIO]) * size * saddle_reduction.units
    normals = frame[:, 2:].T
    centre = exact_balls(reduced_equation.centre)

    # 1. The box: the rectangle, and limits of all other coordinates.
    approximate_level, residual = reduced_equation.split_residual(centre)
    # Room for the coordinates except u and v: their second-order change, and part of the
    # size.
    bend = rectangle @ saddle_reduction.other_curvatures @ rectangle
    other_limit = 0.2 * size + np.max(bend, initial=0.0)
    limits = np.array([*rectangle, *[other_limit] * len(normals)])
    # Each step may fail with a division by zero: then nothing is proven.
    try:
        box_balls = reduced_equation.enclose_box(limits)
        derivatives, curvatures = reduced_equation.differentiate_twice(box_balls, residual)
        variable_rates = derivatives.variable_rates
        hessian = curvatures.hessian
        # 2. Derivatives over the box. The other coordinates follow from u and v: first the
        # residual at the centre is removed, then u and v change. All other coordinates must
        # stay within their limit.
        other_changes = normals @ derivatives.correction + (
            normals @ variable_rates
        ) @ zero_balls(rectangle)
        has_saddle_form = hessian[0, 0] > 0 and hessian[1, 1] < 0
        stays_inside = all(
            upper_magnitude(change) < other_limit for change in other_changes
        )
        if not (has_saddle_form and stays_inside):
            return None
        value, gradient = reduced_equation.evaluate_on_surface(
            centre, approximate_level, derivatives
        )
        if not _has_four_arms(limits, value, gradient, hessian):
            return None
        # 3. The saddle in scaled units of u and v, in which they have the same size.
        units = exact_balls(saddle_reduction.units)
        saddle_derivatives = SaddleDerivatives(
            variable_rates=variable_rates * units,
            hessian=hessian * units * units[:, None],
            size=1.001 * size,
        )
        # 4. A crossing: the level is 0, and the arms meet in one point.
        box = OrientedBox(reduced_equation.centre, frame, limits)
        none_monotonic = np.zeros(limits.shape, dtype=bool)
        if is_proven_crossing(box):
            arm_rates = bound_arm_rates(
                saddle_derivatives,
                ArmErrors(
                    relative_form_error=0.0, relative_gradient_error=0.0, centre_error=1e-12
                ),
            )
            return _make_saddle(
                box,
                level_sign=0,
                gap=0.0,
                central_zone=0.0 * limits,
                arm_rates=arm_rates,
                is_monotonic=none_monotonic,
            )

        # 5. Otherwise the level, with its sign if that is proven, bounds the gap between
        # the curves.
        level, gradient_at_saddle = _enclose_level(reduced_equation, limits)
        least_curvature = min(
            lower_magnitude(hessian[0, 0]), lower_magnitude(hessian[1, 1])
        )
        largest_level = upper_magnitude(level)
        level_sign = (level > 0) - (level < 0)
        gap = 2.0 * np.sqrt(2.0 * largest_level / least_curvature)
        # Beyond this distance from the saddle arms are straight up to small errors.
        straight_distance = (
            STRAIGHT_ARM_RATIO * gap + 1e4 * gradient_at_saddle / least_curvature + 1e-300
        )
        errors = ArmErrors(
            relative_form_error=2.001
            * (largest_level / straight_distance + 2.0 * gradient_at_saddle)
            / straight_distance,
            relative_gradient_error=1.001 * gradient_at_saddle / straight_distance,
            centre_error=4.0 * straight_distance,
        )
        rate_sums = np.array([sum(map(upper_magnitude, row)) for row in variable_rates])
        arm_rates = bound_arm_rates(saddle_derivatives, errors)
        is_monotonic = none_monotonic
        if level_sign:
            is_monotonic = find_monotonic_variables(
                saddle_derivatives, level, gradient_at_saddle
            )
        return _make_saddle(
            box,
            level_sign=level_sign or None,
            gap=gap,
            central_zone=4.0 * straight_distance * rate_sums + 1e-12,
            arm_rates=arm_rates,
            is_monotonic=is_monotonic,
        )
    except ZeroDivisionError:
        return None


def _make_saddle(
    box: OrientedBox,
    level_sign: int | None,
    gap: float,
    central_zone: Floats,
    arm_rates: ArmRates,
    is_monotonic: Bools,
) -> Saddle:
    """Return a saddle with the attributes of a box and the further attributes below.

    At a saddle two configuration curves cross or narrowly miss each other. The curves are
    the zeros of a function g(u, v) with a saddle point. Four branches of the curves, the
    arms, lead from the saddle out of the box, one in each quadrant of u and v.

    Curves that miss each other bend from one arm to another. The central zone is the zone
    about the saddle in which they bend. Outside this zone, the arms are straight up to
    small errors.

    Parameters
    ----------
    box
        The box about the saddle. Its first two coordinates are u and v.
    level_sign
        Sign of the value of g at the saddle point: 0 if the curves cross, 1 or -1 if they
        miss each other, None if it is not proven.
    gap
        Upper bound (rad) of the distance between the curves where they miss each other, 0
        if they cross.
    central_zone
        (variables,) half width (rad) of the central zone in each variable: the largest
        difference from its value at the centre. It is 0 if `level_sign` is 0.
    arm_rates
        For each arm, the sign of the rate of each variable in the direction away from the
        saddle (`outward_signs`). Also for each arm, the largest change (rad) of each
        variable on it (`reach`).
    is_monotonic
        (variables,) whether it is proven that a variable is not stationary in the central
        zone. A variable is stationary where its rate along the curve is 0.
    """
    return Saddle(
        centre=box.centre,
        frame=box.frame,
        limits=box.limits,
        level_sign=level_sign,
        gap=gap,
        central_zone=central_zone,
        outward_signs=arm_rates.outward_signs,
        reach=arm_rates.reach,
        is_monotonic=is_monotonic,
    )


def _enclose_level(reduced_equation: ReducedEquation, limits: Floats) -> tuple[Ball, float]:
    """Return the level of a saddle, and a bound of the slopes near it.

    F(z) = 0 are the equations of a mechanism in the variables z. At a crossing of curves,
    their derivatives F' lose a rank: l F' is 0 for a unit vector l. So small changes of z
    hardly change the component of F along l. The equations F(z) = g l leave this component
    free. Its value g is a new unknown number. With given values of two coordinates u and v
    of z, these equations determine z and g as functions of u and v. The configurations are
    the points z with g(u, v) = 0.

    The level is the value of g at its saddle point, which Newton's method approximates.
    Since g is convex in u and concave in v, the slopes at the approximation bound the
    error. The level differs from the value there by at most these slopes times the size of
    the rectangle. The precision is increased until the sign of the level is known, or to
    the last one of `LEVEL_PRECISIONS_BITS`.

    Parameters
    ----------
    reduced_equation
        The reduced equation about its critical point.
    limits
        (variables,) half lengths (rad) of the box; the first two belong to the rectangle.

    Returns
    -------
    level
        A ball that contains the level. The ball contains 0 if the sign is not known.
    gradient_at_position
        Bound of both components of the gradient of g at the approximate saddle point.

    Raises
    ------
    ZeroDivisionError
        If the approximate saddle point is farther from the centre of the box than 0.001 of
        its half lengths.
    """
    position = exact_balls(reduced_equation.centre)
    # Largest distance of two points of the rectangle along u or v: twice the half length,
    # and a little more for rounding.
    largest_distance = 2.002 * np.max(limits[:2])
    for bits in LEVEL_PRECISIONS_BITS:
        with working_precision(bits):
            equations = ArcEquations(
                reduced_equation.equations.decimal_mechanism,
                reduced_equation.equations.construction,
            )
            sharp_equation = replace(reduced_equation, equations=equations)
            # The point of the last precision is the start for the next one.
            position = sharp_equation.find_critical_point(position)
            offset = (centre_floats(position) - reduced_equation.centre) @ (
                reduced_equation.frame
            )
            if not np.all(np.abs(offset) < 1e-3 * limits):
                raise ZeroDivisionError
            # F at the position is split into a multiple of l, near g l, and a remainder.
            # `correction` bounds how much z and g change when the remainder is removed.
            approximate_level, residual = sharp_equation.split_residual(position)
            box_balls = sharp_equation.enclose_box(limits)
            derivatives = sharp_equation.differentiate(box_balls, residual)
            value, gradient = sharp_equation.evaluate_on_surface(
                position, approximate_level, derivatives
            )
            gradient_at_position = max(map(upper_magnitude, gradient))
            # The radius of the ball grows by the largest difference.
            level = widen(value, largest_distance * gradient_at_position)
            if not level.contains(0):
                break
    return level, gradient_at_position


@dataclass(frozen=True)
class _CentreMagnitudes:
    """Upper bounds of the magnitudes of g(u, v) and its slopes at the centre u = v = 0.

    The point u = v = 0 is the centre of a rectangle near a saddle, where curves of
    configurations cross or nearly do. The configurations are the zeros of g. The proof that
    these zeros are four arms (`_has_four_arms`) uses the bounds.

    Attributes
    ----------
    value
        Bound of the magnitude of g.
    slope_u, slope_v
        Bounds of the magnitudes of the derivatives of g with respect to u and with respect
        to v.
    """

    value: float
    slope_u: float
    slope_v: float


def _has_four_arms(limits: Floats, value: Ball, gradient: Array, hessian: Array) -> bool:
    """Return whether the zeros of g in a rectangle are four arms, one in each quadrant.

    The caller accepts a rectangle about a saddle only with this proof. At a saddle, curves
    of configurations cross or nearly do. The closure equations near it are reduced to one
    equation g(u, v) = 0, so its zeros are the configurations. g is proven to be convex in u
    and concave in v. The arms are branches of these curves. They follow if g has these
    signs:

        v             at u = -u_limit   at u = 0   at u = u_limit
        above h             +              -             +
        -h to h             +           any sign         +
        below -h            +              -             +

    The inner height h is the half height of the rectangle times `INNER_HEIGHT_RATIO`. Where
    v is above h or below -h, g is negative at u = 0, positive on both sides u = +-u_limit,
    and convex in u. So for each of these v, g has exactly one zero with u > 0 and one with
    u < 0. These zeros form the four arms. At u = 0 only v = h and v = -h are tested,
    because g is concave in v.

    Between -h and h the curves may cross, or bend from one arm to another. The value of g
    at its saddle point later decides which of these is true. So the last test is that the
    saddle point is between -h and h.

    Parameters
    ----------
    limits
        (variables,) half lengths (rad) of the box about the saddle. The first two are those
        of the rectangle, along u and v. The other coordinates of the box are functions of u
        and v, so g does not contain them.
    value, gradient
        g and its slopes (2,) at the centre u = v = 0, as balls (numbers with a bound of
        their error).
    hessian
        (2, 2) balls that contain the second derivatives of g in the whole box. That by u is
        positive (convex), that by v negative (concave).
    """
    u_limit, v_limit = limits[:2]
    inner_height = INNER_HEIGHT_RATIO * v_limit
    slope_u, slope_v = map(upper_magnitude, gradient)
    centre = _CentreMagnitudes(
        value=upper_magnitude(value), slope_u=slope_u, slope_v=slope_v
    )
    # 1. The columns u = -u_limit and u = u_limit of the table.
    if not _is_positive_on_sides(u_limit, v_limit, centre, hessian):
        return False
    # 2. The column u = 0.
    if not _is_negative_beyond(inner_height, centre, hessian):
        return False
    # 3. The saddle point.
    return _has_saddle_point_within(inner_height, u_limit, centre, hessian)


def _is_positive_on_sides(
    u_limit: float, v_limit: float, centre: _CentreMagnitudes, hessian: Array
) -> bool:
    """Return whether g(u, v) is positive on the sides u = +-u_limit of a rectangle.

    The rectangle has the centre u = v = 0 at a saddle, where curves of configurations cross
    or nearly cross. The configurations are the zeros of g. This is one part of the proof
    that they are four arms (`_has_four_arms`). g is positive on a side if it rises from the
    centre to this side by more than ``|g(0, 0)|``.

    Parameters
    ----------
    u_limit, v_limit
        Half lengths (rad) of the rectangle.
    centre
        Bounds of the magnitudes of g and its slopes at the centre.
    hessian
        (2, 2) balls (numbers with error bounds) of the second derivatives; the second
        derivative with respect to u is positive.
    """
    rise = _bound_rise_to_sides(u_limit, v_limit, centre, hessian)
    # The rise is of the size of u_limit^2. 1e-12 of this size is far above the rounding
    # errors of a few float64 products.
    return bool(rise - centre.value > 1e-12 * u_limit * u_limit)


def _is_negative_beyond(
    inner_height: float, centre: _CentreMagnitudes, hessian: Array
) -> bool:
    """Return whether g(0, v) is negative for all ``|v|`` above the inner height h.

    A rectangle of the coordinates u and v has its centre u = v = 0 at a saddle, where
    curves of configurations cross or nearly cross. The configurations are the zeros of
    g(u, v). This is one part of the proof that they are four arms (`_has_four_arms`).

    g(0, h) is negative if g falls from the centre to v = h by more than ``|g(0, 0)|``. g is
    concave in v, so it falls further beyond. The same holds for v = -h.

    Parameters
    ----------
    inner_height
        The inner height h (rad), a distance along v from the centre. Only nearer to the
        centre can the curves cross, or bend from one arm to another.
    centre
        Bounds of the magnitudes of g and its slopes at the centre.
    hessian
        (2, 2) balls (numbers with error bounds) of the second derivatives; the second
        derivative with respect to v is negative.
    """
    descent = _bound_descent_along_v(inner_height, centre.slope_v, hessian)
    # 1.001 allows for the rounding of a few float64 products.
    return bool(descent > 1.001 * centre.value)


def _has_saddle_point_within(
    inner_height: float, u_limit: float, centre: _CentreMagnitudes, hessian: Array
) -> bool:
    """Return whether the saddle point of g(u, v) has ``|v|`` below the inner height h.

    This is the last part of the proof that the configuration curves near a saddle, the
    zeros of g in a rectangle, are four arms. g is convex in u and concave in v.

    For each v, let b(v) be the least value of g along u in the rectangle, the bottom of a
    valley. The saddle point is the lowest point of g along u and the highest along v. So
    its v is the one at which b is highest. b is concave, because it is the least of concave
    functions of v. So the highest point of b is between -h and h if b(0) exceeds b(h) and
    b(-h). All three are compared with g(0, 0):

    - b(0) >= g(0, 0) - u_limit ``|g_u(0, 0)|``, because g is convex in u. The subtracted
      product is called the valley depth.
    - b(h) <= g(0, h), because the least value along u is at most that at u = 0. So b(h) is
      lower than g(0, 0) by at least the descent g(0, 0) - g(0, h). The same is true for -h.

    So it is enough that both descents exceed the valley depth. As a margin, the test
    requires twice the depth.

    Parameters
    ----------
    inner_height
        The inner height h (rad), a distance along v from the centre.
    u_limit
        Half length (rad) of the rectangle along u.
    centre
        Bounds of the magnitudes of g and its slopes at the centre.
    hessian
        (2, 2) balls (numbers with error bounds) of the second derivatives; the second
        derivative with respect to v is negative.
    """
    # A lower bound of both descents, to v = h and to v = -h.
    descent = _bound_descent_along_v(inner_height, centre.slope_v, hessian)
    valley_depth_at_centre = u_limit * centre.slope_u
    # 1.001 allows for the rounding of a few float64 products.
    return bool(descent > 1.001 * (2.0 * valley_depth_at_centre))


def _bound_rise_to_sides(
    u_limit: float, v_limit: float, centre: _CentreMagnitudes, hessian: Array
) -> float:
    """Return a lower bound of g(u, v) - g(0, 0) on the sides u = +-u_limit of a rectangle.

    The zeros of g are the configurations near a saddle, where curves of configurations
    cross or nearly cross. If g rises enough from the centre, the caller concludes that it
    is positive on these sides. The bound is Taylor's formula of second order about the
    centre. The first term has the least value of g_uu, which is positive. All other terms
    have their largest magnitudes and are subtracted:

        g_uu u^2 / 2 - |g_uv| |u v| - |g_vv| v^2 / 2 - |g_u| |u| - |g_v| |v|.

    Parameters
    ----------
    u_limit, v_limit
        Half lengths (rad) of the rectangle, the largest ``|u|`` and ``|v|``.
    centre
        Bounds of the magnitudes of the slopes g_u and g_v at the centre.
    hessian
        (2, 2) balls (numbers with error bounds) that contain the second derivatives in the
        whole rectangle; that with respect to u is positive.
    """
    # g_uu is positive, so its least magnitude is its least value.
    least_uu = lower_magnitude(hessian[0, 0])
    largest_uv = upper_magnitude(hessian[0, 1])
    largest_vv = upper_magnitude(hessian[1, 1])
    twice_second_order = (
        least_uu * u_limit * u_limit
        - 2 * largest_uv * u_limit * v_limit
        - largest_vv * v_limit * v_limit
    )
    return float(
        0.5 * twice_second_order - centre.slope_u * u_limit - centre.slope_v * v_limit
    )


def _bound_descent_along_v(height: float, slope_v: float, hessian: Array) -> float:
    """Return a lower bound of g(0, 0) - g(0, v) at v = height and at v = -height.

    g(u, v) is a function with configuration curves as zeros, concave in v. Two tests of a
    saddle (where the curves cross or nearly do) require that g descends enough from the
    centre. The bound is Taylor's formula of second order along v, with the least curvature
    on the way.

    Parameters
    ----------
    height
        Distance (rad) along v.
    slope_v
        Upper bound of the magnitude of the slope of g along v at the centre.
    hessian
        (2, 2) balls (numbers with error bounds) that contain the second derivatives in a
        whole rectangle about the centre. The second derivative with respect to v is
        negative.
    """
    # g_vv is negative, so its least magnitude gives the smallest descent.
    least_vv = lower_magnitude(hessian[1, 1])
    return float(0.5 * least_vv * height**2 - slope_v * height)
