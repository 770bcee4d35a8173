"""Configurations, with derivatives with respect to independent coordinates.

The derivatives are of the first and second order. There are as many coordinates as degrees
of freedom. The coordinates are pair variables (such as the variables of the inputs), fixed
weighted sums of pair variables, or, for one degree of freedom, the arc length s of the
configuration curve in the space of all pair variables. With the arc length as coordinate,
every dead centre is an ordinary point.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherekit.arrays import Floats, SmallIntegers
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import all_finite, nans
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import has_penetration
from spherekit.status import Status
from spherekit.velocities.pole_sequence import solve_null_motion

Order = Literal[1, 2]
"""Order of the derivatives that are computed."""


@dataclass(frozen=True)
class CoordinateMotion(ArrayRows):
    """Configurations in n rows, and their derivatives with respect to m coordinates.

    There are m degrees of freedom and m independent coordinates, for example the input
    angles, or the arc length of the curve of configurations. A derivative with respect to a
    coordinate is a rate per unit rate of this coordinate.

    Attributes
    ----------
    values
        (n, variables) pair variables (joint angles, rad).
    rates
        (n, m, variables) derivatives of the pair variables with respect to each coordinate.
    second
        (n, m, m, variables) second derivatives. NaN if only the first order was requested.
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    w
        (n, m, links, 3) angular velocities of the links per unit rate of each coordinate,
        in ground axes.
    dw
        (n, m, m, links, 3) at [:, i, k] the derivative of w[:, i] with respect to
        coordinate k. NaN if only the first order was requested.
    status
        (n,) OK, unless a contact of two profiles is impossible: OFF_PROFILE (beyond the end
        of a profile) or CURVATURE (the profiles have equal curvature at the contact, or
        penetrate each other).
    frames
        (n, pairs, 3, 3) frames of the pairs (joints) in ground axes. Of the two frames of a
        pair, this is the one in its first link.
    """

    values: Floats
    rates: Floats
    second: Floats
    rotations: Floats
    w: Floats
    dw: Floats
    status: SmallIntegers
    frames: Floats

    def with_senses(self, senses: Floats) -> "CoordinateMotion":
        """Return the motion with all coordinates reversed in rows that have the sense -1.

        A row is one configuration. If the coordinate is the arc length of a curve, it is
        computed with an arbitrary sense. The caller knows which sense is wanted in each
        row. First derivatives change their signs. Second derivatives stay the same, because
        two signs cancel.

        Parameters
        ----------
        senses
            (n,) +1 or -1.
        """
        rates = self.rates * senses[:, None, None]
        w = self.w * senses[:, None, None, None]
        return replace(self, rates=rates, w=w)


def motion_by_arc_length(
    closure: Closure, values: Floats, order: Order = 2
) -> CoordinateMotion:
    """Return configurations and their derivatives d/ds, s the arc length of a curve.

    The configurations of a mechanism with one degree of freedom form a curve in the space
    of all pair variables (joint angles). Unlike an input angle, the arc length s of this
    curve is a valid coordinate even at dead centres. The first derivative is the unit
    tangent of the curve, the null vector of the velocity equations. Its sense is arbitrary
    in each row; see `continuous_signs` and `CoordinateMotion.with_senses`.

    Parameters
    ----------
    closure
        The loop-closure equations of a whole mechanism with one degree of freedom.
    values
        (n, variables) configurations (rad) in which all loops close.
    order
        1 leaves out the second derivatives.
    """
    linearisation = closure.linearise(values)
    null_motion = solve_null_motion(closure.tree, linearisation.vectors)
    # `null_motion.inverse` is the inverse of the velocity equations, with a last row that
    # sets the length of the tangent. It is used to solve the differentiated equations for
    # the second derivatives. The length of the tangent is constant along the curve, so the
    # last right-hand side is zero there. The last column of the inverse is left out.
    closing_inverse = null_motion.inverse[:, :, :-1]
    return _complete_motion(
        linearisation, null_motion.rates[:, None], closing_inverse, order
    )


def motion_by_combinations(
    closure: Closure, values: Floats, weights: Floats, order: Order = 2
) -> CoordinateMotion:
    """Return configurations, differentiated with respect to weighted sums of variables.

    The m coordinates are weighted sums of the pair variables. The weights of each sum are a
    row of a matrix F. The rates r of all variables per unit rate of coordinate i solve J r
    = 0 (the loops stay closed) and F r = e_i (coordinate i has the rate 1, the others
    rest). J is the Jacobian of the loop-closure equations.

    Parameters
    ----------
    closure
        The loop-closure equations of a whole mechanism with m degrees of freedom.
    values
        (n, variables) pair variables (rad) of configurations in which all loops close.
    weights
        (m, variables) the matrix F, or (n, m, variables) one for each configuration.
    order
        1 leaves out the second derivatives.

    Returns
    -------
    n rows, one for each configuration. Where the coordinates do not determine the motion,
    derivatives are NaN or, by rounding, very large; see `determinacy`.
    """
    linearisation = closure.linearise(values)
    m = weights.shape[-2]
    # For each configuration the matrix with J above F.
    coordinate_rows = np.broadcast_to(weights, (len(values), *weights.shape[-2:]))
    equations = np.concatenate([linearisation.jacobian, coordinate_rows], axis=1)
    # Closure equations may be redundant. The matrix then has more rows than columns and
    # only a left inverse, which is NaN if the matrix is singular.
    inverse = left_inverse(equations)
    # The inverse has a column for each equation: the changes of the variables per closure
    # error, then the rates of the variables with respect to each coordinate.
    closing_inverse = inverse[:, :, :-m]
    rates_in_columns = _refine_last_columns(inverse, equations, m)
    rates = np.ascontiguousarray(transpose(rates_in_columns))
    return _complete_motion(linearisation, rates, closing_inverse, order)


def _refine_last_columns(inverse: Floats, matrix: Floats, count: int) -> Floats:
    """Return the last columns of inverse matrices, corrected for rounding errors.

    These columns are the rates of the variables per unit rate of each coordinate. The
    correction is one step of iterative refinement. With the matrix A, a column x of its
    inverse and the column e of the unit matrix, the residual is e - A x. The inverse times
    this residual is added to x.

    If closure equations are redundant, A has more rows than columns. The residual of the
    last columns is still zero up to rounding. For these columns, e is zero in all closure
    equations, so redundant ones do not contradict the others.

    Parameters
    ----------
    inverse
        (n, variables, equations) left inverses of the matrices.
    matrix
        (n, equations, variables) matrices. Their last `count` rows define the coordinates,
        and all other rows are closure equations.
    count
        Number of columns to refine, one for each coordinate.
    """
    columns = inverse[:, :, -count:]
    unit_columns = np.eye(matrix.shape[1])[:, -count:]
    residual = unit_columns - matrix @ columns
    return columns + inverse @ residual


def motion_by_variables(
    closure: Closure, values: Floats, variables: Sequence[int], order: Order = 2
) -> CoordinateMotion:
    """Return configurations, differentiated with respect to some of the pair variables.

    Derivatives are NaN or, by rounding, very large where the mechanism can move although
    these variables are locked. With a single variable this is a dead centre.

    Parameters
    ----------
    closure
        The loop-closure equations of a whole mechanism with m degrees of freedom.
    values
        (n, variables) configurations (rad) in which all loops close.
    variables
        Indices of the m variables that are the coordinates.
    order
        1 leaves out the second derivatives.
    """
    # Each coordinate is a weighted sum of all pair variables, in which the chosen variable
    # has the weight 1 and all others have 0.
    weights = np.eye(values.shape[1])[list(variables)]
    return motion_by_combinations(closure, values, weights, order)


def _complete_motion(
    linearisation: Linearisation, rates: Floats, closing_inverse: Floats, order: Order
) -> CoordinateMotion:
    """Return a motion with all derivatives, from the first ones of the pair variables.

    Derivatives are with respect to m independent coordinates, such as the input angles. The
    function adds the second derivatives of the variables, and the angular velocities of the
    links with their derivatives. It also adds a status for each configuration, which tells
    whether its contacts are possible.

    Parameters
    ----------
    linearisation
        n configurations with the Jacobians of their loop-closure equations.
    rates
        (n, m, variables) derivatives of the variables with respect to each coordinate.
    closing_inverse
        (n, variables, equations) matrices that solve the differentiated closure equations
        for the second derivatives, see `_differentiate_rates`.
    order
        1 leaves out the second derivatives.
    """
    # The angular velocity of a link is the sum of the rates of the variables along the path
    # from the ground to the link, times the vectors (axes) about which they turn.
    w = linearisation.tree.body_rates(linearisation.vectors[:, None], rates)
    n, m, variables = rates.shape
    if order == 2:
        second, dw = _second_derivatives(linearisation, rates, w, closing_inverse)
    else:
        second = nans((n, m, m, variables))
        dw = nans((n, m, *w.shape[1:]))
    return CoordinateMotion(
        values=linearisation.values,
        rates=rates,
        second=second,
        rotations=linearisation.rotations,
        w=w,
        dw=dw,
        status=_contact_status(linearisation),
        frames=linearisation.frames,
    )


def _contact_status(linearisation: Linearisation) -> SmallIntegers:
    """Return the status (n,) of configurations: OK unless a contact does not exist."""
    status = np.full(len(linearisation.values), Status.OK, dtype=np.int8)
    status[has_penetration(linearisation.joints, linearisation.states)] = Status.CURVATURE
    # OFF_PROFILE is assigned last, because it takes precedence.
    status[~np.all(linearisation.states.inside, axis=1)] = Status.OFF_PROFILE
    return status


def _second_derivatives(
    linearisation: Linearisation, rates: Floats, w: Floats, closing_inverse: Floats
) -> tuple[Floats, Floats]:
    """Return second derivatives of the variables, and derivatives of angular velocities.

    `_complete_motion` adds both to a motion that is given by m independent coordinates.

    Parameters
    ----------
    linearisation
        n configurations with the Jacobians J of their loop-closure equations.
    rates
        (n, m, variables) derivatives of the pair variables (joint angles) with respect to
        each of m coordinates.
    w
        (n, m, links, 3) at [:, i] the angular velocities of the links while coordinate i
        has the rate 1 and the others rest.
    closing_inverse
        (n, variables, equations) matrices that solve the differentiated closure equations
        for the second derivatives, see `_differentiate_rates`.

    Returns
    -------
    second
        (n, m, m, variables) at [:, i, k] the derivative of rate i with respect to
        coordinate k.
    dw
        (n, m, m, links, 3) at [:, i, k] the derivative of w[:, i] with respect to
        coordinate k.
    """
    tree = linearisation.tree
    # (n, variables, 3) the axis about which each pair variable turns.
    axes = linearisation.vectors
    n, m, variables = rates.shape
    second = np.empty((n, m, m, variables))
    dw = np.empty((n, m, *w.shape[1:]))
    for k in range(m):
        # Derivatives with respect to coordinate k of the axes, of J and of all rates.
        axis_derivatives = linearisation.vector_rates(w[:, k])
        jacobian_derivative = tree.jacobian(axis_derivatives)
        second[:, :, k] = _differentiate_rates(rates, jacobian_derivative, closing_inverse)
        # The angular velocity of a link is a sum of rates times axes, along the path from
        # the ground to the link. `body_rates` forms this sum. By the product rule, the
        # derivative has two terms.
        dw[:, :, k] = tree.body_rates(axes[:, None], second[:, :, k])
        dw[:, :, k] += tree.body_rates(axis_derivatives[:, None], rates)
    return second, dw


def _differentiate_rates(
    rates: Floats, jacobian_derivative: Floats, closing_inverse: Floats
) -> Floats:
    """Return the derivatives of all rates with respect to one coordinate q.

    The rates r_i of the variables with respect to coordinate i keep the loops closed: J r_i
    = 0, with the Jacobian J of the loop-closure equations. Differentiated with respect to
    q, this is

        J dr_i/dq = -dJ/dq r_i.

    A second condition, F dr_i/dq = 0, makes the solution unique. There are two cases:

    - The coordinates are weighted sums of the variables. F (m, variables) has the weights.
      F r_i is constant, since the rates of the coordinates with respect to each other are 1
      or 0.
    - The coordinate is the arc length of the configuration curve, r is the unit tangent,
      and F = r^T. The derivative of a unit vector is perpendicular to the vector.

    Parameters
    ----------
    rates
        (n, m, variables) the rates r_i with respect to each of m coordinates.
    jacobian_derivative
        (n, equations, variables) dJ/dq.
    closing_inverse
        (n, variables, equations) the matrix with which x = closing_inverse y solves J x = y
        and F x = 0.

    Returns
    -------
    (n, m, variables) dr_i/dq.
    """
    # The vectors are rows here, and y = J x is written as the row y = x J^T.
    right_sides = -(rates @ transpose(jacobian_derivative))
    return right_sides @ transpose(closing_inverse)


def determinacy(rates: Floats) -> Floats:
    """Return how well some pair variables determine the motion as coordinates.

    The measure is 1 / N with the 2-norm N of the matrix of rates. N is the largest length
    of the vector of all rates, if the vector of the coordinates' rates has length 1.
    Callers treat a configuration as singular if the measure is below a limit.

    Parameters
    ----------
    rates
        (n, m, variables) rates of all variables per unit rate of each of m coordinates,
        which are some of these variables.

    Returns
    -------
    (n,) from 0 to 1: 1 if no variable other than the coordinates moves, near 0 where other
    variables move while the coordinates rest, and 0 where rates are not finite.
    """
    is_finite = all_finite(rates, (1, 2))
    measure = np.zeros(len(rates))
    measure[is_finite] = 1.0 / np.linalg.norm(rates[is_finite], ord=2, axis=(1, 2))
    return measure


def reciprocal_condition(closure: Closure, values: Floats, freedom_count: int = 1) -> float:
    """Return the reciprocal condition number of the loop-closure equations.

    The number is 0 where curves of configurations cross. A simulation uses it to
    find out whether the motion has reached such a crossing.

    With V variables and m degrees of freedom, V - m of the equations are independent. The
    singular values of the Jacobian are sorted, the largest first. The result is the value
    at position V - m, divided by the first one. Redundant equations only add singular
    values after this position, so they do not make the result zero.

    Parameters
    ----------
    closure
        The loop-closure equations.
    values
        (variables,) pair variables (rad) of a configuration in which all loops close.
    freedom_count
        Number of degrees of freedom.
    """
    sizes = np.linalg.svd(closure.linearise(values[None]).jacobian[0], compute_uv=False)
    rank = len(values) - freedom_count
    if not rank:
        return 1.0
    return float(sizes[rank - 1] / sizes[0]) if len(sizes) >= rank else 0.0


def continuous_signs(vectors: Floats, start: Floats) -> Floats:
    """Return the signs (n,) that turn a sequence of axes into a continuous direction.

    The sense of each axis is arbitrary, like the sense of a tangent of a curve. After
    multiplication by its sign, each vector makes an acute angle with the vector before.

    Parameters
    ----------
    vectors
        (n, k) vectors of arbitrary sense, such as tangents of a curve at successive points.
    start
        (k,) vector with which the first vector is to make an acute angle.
    """
    previous = np.concatenate([start[None], vectors[:-1]])
    cosines = np.vecdot(previous, vectors)
    # Each reversal also reverses all vectors that follow, so the signs are multiplied.
    return np.asarray(np.cumprod(np.where(cosines < 0.0, -1.0, 1.0)))
