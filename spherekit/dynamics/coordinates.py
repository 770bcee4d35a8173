"""Configurations with their first and second derivatives by independent coordinates.

There are as many coordinates as degrees of freedom. They are pair variables (such as those
of the inputs), fixed sums of pair variables, or, for one degree of freedom, the arc length
s of the configuration curve in the space of all pair variables. In the arc length every
dead centre is an ordinary point.
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
    """Configurations in rows, and their derivatives with respect to m coordinates.

    There are as many coordinates as degrees of freedom. They are, for example, the input
    angles, or the arc length of the curve of configurations.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad).
    rates
        (n, m, variables) derivatives of the pair variables by each coordinate.
    second
        (n, m, m, variables) second derivatives. NaN if only the first order was requested.
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    w
        (n, m, links, 3) angular velocities of the links per unit rate of each coordinate,
        in ground axes.
    dw
        (n, m, m, links, 3) at [i, k] the derivative of the i-th of these by coordinate k.
        NaN if only the first order was requested.
    status
        (n,) OK, or OFF_PROFILE or CURVATURE if a contact does not exist.
    frames
        (n, pairs, 3, 3) pair frames in ground axes.
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
        """Return the motion with all coordinates reversed in rows whose sense is -1.

        First derivatives change their signs. Second derivatives stay the same, because they
        change their signs twice, even if they are by two different coordinates.

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
    """Return configurations with the arc length of their curve as the only coordinate.

    The unit tangent of the curve is the null vector of the velocity equations. Its sense is
    arbitrary in each row; see `continuous_signs` and `CoordinateMotion.with_senses`.

    Parameters
    ----------
    closure
        The loops of a whole mechanism with one degree of freedom.
    values
        (n, variables) closed configurations (rad).
    order
        1 leaves out the second derivatives.
    """
    linearisation = closure.linearise(values)
    null_motion = solve_null_motion(closure.tree, linearisation.vectors)
    # The inverse is that of the velocity equations and of one more equation, which fixes
    # the length of the tangent. The last column belongs to the latter.
    closing_inverse = null_motion.inverse[:, :, :-1]
    return _complete_motion(
        linearisation, null_motion.rates[:, None], closing_inverse, order
    )


def motion_by_combinations(
    closure: Closure, values: Floats, weights: Floats, order: Order = 2
) -> CoordinateMotion:
    """Return configurations and their derivatives by weighted sums of the pair variables.

    These sums are the m coordinates. Their weights are the rows of a matrix F. The rates r
    of all variables per unit rate of coordinate i solve J r = 0 (the loops stay closed) and
    F r = e_i (coordinate i has the rate 1, the others rest). J is the Jacobian of the
    loop-closure equations.

    Parameters
    ----------
    closure
        The loops of a whole mechanism with m degrees of freedom.
    values
        (n, variables) closed configurations (rad).
    weights
        (m, variables), or (n, m, variables) for each row: the matrix F.
    order
        1 leaves out the second derivatives.

    Returns
    -------
    n rows. A row in which the coordinates do not determine the motion is NaN.
    """
    linearisation = closure.linearise(values)
    m = weights.shape[-2]
    # For each row of `values` the matrix of J and F, one above the other.
    coordinate_rows = np.broadcast_to(weights, (len(values), *weights.shape[-2:]))
    equations = np.concatenate([linearisation.jacobian, coordinate_rows], axis=1)
    # There may be more closure equations than independent ones, so the matrix has a left
    # inverse. It is NaN if the matrix is singular.
    inverse = left_inverse(equations)
    # The inverse has a column for each equation: the changes of the variables per closure
    # error, then the rates of the variables by each coordinate.
    closing_inverse = inverse[:, :, :-m]
    rates_in_columns = _refine_last_columns(inverse, equations, m)
    rates = np.ascontiguousarray(transpose(rates_in_columns))
    return _complete_motion(linearisation, rates, closing_inverse, order)


def _refine_last_columns(inverse: Floats, matrix: Floats, count: int) -> Floats:
    """Return the last columns of inverse matrices, after a step of iterative refinement.

    An inverse loses digits, which the step restores: the residuals of the columns are
    computed and multiplied by the inverse.

    Parameters
    ----------
    inverse, matrix
        (n, variables, equations) left inverses of the matrices (n, equations, variables).
    count
        Number of the columns that are refined.
    """
    columns = inverse[:, :, -count:]
    # The product of a matrix and its inverse is the unit matrix.
    unit_columns = np.eye(matrix.shape[1])[:, -count:]
    residual = unit_columns - matrix @ columns
    return columns + inverse @ residual


def motion_by_variables(
    closure: Closure, values: Floats, variables: Sequence[int], order: Order = 2
) -> CoordinateMotion:
    """Return configurations and their derivatives by some of the pair variables.

    Rates are not finite if these variables do not determine the motion: at dead centres of
    a single variable, and at singularities of type II of several variables.

    Parameters
    ----------
    closure
        The loops of a whole mechanism with m degrees of freedom.
    values
        (n, variables) closed configurations (rad).
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
    """Return a motion with all derivatives, from the first derivatives of the variables.

    These are the second derivatives of the variables, and the angular velocities of the
    links with their derivatives.

    Parameters
    ----------
    linearisation
        n closed configurations with their Jacobians.
    rates
        (n, m, variables) derivatives of the variables by each coordinate.
    closing_inverse
        (n, variables, equations) the matrices of `_differentiate_rates`.
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

    Parameters
    ----------
    linearisation
        n closed configurations with their Jacobians.
    rates
        (n, m, variables) derivatives of the variables by each of m coordinates.
    w
        (n, m, links, 3) angular velocities of the links by each coordinate.
    closing_inverse
        (n, variables, equations) the matrices of `_differentiate_rates`.

    Returns
    -------
    second
        (n, m, m, variables) at [:, i, k] the derivative of rate i by coordinate k.
    dw
        (n, m, m, links, 3) at [:, i, k] the derivative of w_i by coordinate k.
    """
    tree = linearisation.tree
    vectors = linearisation.vectors
    n, m, variables = rates.shape
    second = np.empty((n, m, m, variables))
    dw = np.empty((n, m, *w.shape[1:]))
    for k in range(m):
        # Derivatives by coordinate k of the pair axes, of J and of all rates.
        vector_derivatives = linearisation.vector_rates(w[:, k])
        jacobian_derivative = tree.jacobian(vector_derivatives)
        second[:, :, k] = _differentiate_rates(rates, jacobian_derivative, closing_inverse)
        # Angular velocities are sums of rates times axes: the product rule has two terms.
        dw[:, :, k] = tree.body_rates(vectors[:, None], second[:, :, k])
        dw[:, :, k] += tree.body_rates(vector_derivatives[:, None], rates)
    return second, dw


def _differentiate_rates(
    rates: Floats, jacobian_derivative: Floats, closing_inverse: Floats
) -> Floats:
    """Return the derivatives of all rates by one coordinate q.

    The rates r_i of the variables by coordinate i keep the loops closed: J r_i = 0, with
    the Jacobian J of the loop-closure equations. Differentiated by q, this is

        J dr_i/dq = -dJ/dq r_i.

    A second condition, F dr_i/dq = 0, makes the solution unique. There are two cases:

    - The coordinates are weighted sums of the variables. F (m, variables) has the weights.
      F r_i is constant, since the rates of the coordinates by each other are 1 or 0.
    - The coordinate is the arc length of the configuration curve. Then r is the unit
      tangent, and F = r^T. The derivative of a unit vector is perpendicular to it.

    Parameters
    ----------
    rates
        (n, m, variables) the rates r_i by each of m coordinates.
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
    """Return how well pair variables determine the motion as coordinates.

    The measure is 1 / N, where N is the 2-norm of the matrix of rates. If the vector of the
    coordinates' rates has length 1, the vector of the rates of all variables has at most
    the length N. With one degree of freedom, 1 / N is the size of the derivative of the
    coordinate by the arc length of the configuration curve (in the space of all variables).

    Parameters
    ----------
    rates
        (n, m, variables) rates of all variables per unit rate of each of m coordinates,
        which are some of these variables.

    Returns
    -------
    (n,) 1 if no other variable moves, since N counts the coordinates too. It approaches 0
    where other variables move while the coordinates rest. It is 0 in rows in which rates
    are not finite.
    """
    is_finite = all_finite(rates, (1, 2))
    measure = np.zeros(len(rates))
    measure[is_finite] = 1.0 / np.linalg.norm(rates[is_finite], ord=2, axis=(1, 2))
    return measure


def reciprocal_condition(closure: Closure, values: Floats, freedoms: int = 1) -> float:
    """Return the reciprocal condition number of the loop-closure equations.

    With V variables and m degrees of freedom, V - m of these equations are independent. The
    result is singular value number V - m of their Jacobian, in falling order, divided by
    the largest one. It vanishes where curves of configurations cross. Redundant equations
    have no effect.

    Parameters
    ----------
    closure
        The loops.
    values
        (variables,) a closed configuration (rad).
    freedoms
        Number of degrees of freedom.
    """
    sizes = np.linalg.svd(closure.linearise(values[None]).jacobian[0], compute_uv=False)
    rank = len(values) - freedoms
    if not rank:
        return 1.0
    return float(sizes[rank - 1] / sizes[0]) if len(sizes) >= rank else 0.0


def continuous_signs(vectors: Floats, start: Floats) -> Floats:
    """Return the signs (n,) that turn a sequence of axes into a continuous direction.

    The result has 1 for vectors that keep their direction, and -1 for those to be reversed.
    Each vector, multiplied by its sign, then makes an acute angle with the one before.

    Parameters
    ----------
    vectors
        (n, k) vectors of arbitrary sense, such as tangents of a curve at successive points.
    start
        (k,) vector with which the first one makes an acute angle.
    """
    previous = np.concatenate([start[None], vectors[:-1]])
    cosines = np.vecdot(previous, vectors)
    return np.asarray(np.cumprod(np.where(cosines < 0.0, -1.0, 1.0)))
