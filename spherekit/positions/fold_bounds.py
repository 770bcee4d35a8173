"""Bounds the errors of configurations, in float64, also at and near folds.

At a fold, two configurations of the mechanism meet at one input, and the closure Jacobian J
without the inputs has one singular value s near zero. With v and u its right and left
singular vectors, loops that are moved by x along v are open along u by

    f(x) = e + s x + h x^2 / 2,    h = u . D^2 F [v, v],

up to terms of third order, where F is the closure residual. The zeros of f are the closed
configurations. The other loop equations determine the other variables. If e has an error of
up to g, a simple zero of f has an error of up to g / s. Near a fold, both zeros have errors
of up to about sqrt(2 g / |h|). The residual is evaluated at the bound, to see whether f
describes it up to there. If two singular values are near zero, there is no bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite, cross, max_abs
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import list_rolling_variables
from spherekit.tolerances import EPS

INPUT_ROUNDING = 2.0 * EPS
"""Rounding error of an input, relative to the input or to 1 rad, whichever is larger. An
input that is nearer to a dead centre is taken to be at it. A float64 number in rad can
stand for a decimal number of degrees, as pi does for 180 degrees.
"""
LARGEST_MODEL_ERROR = 0.25
"""The quadratic model f is used if it differs from the closure residual by at most this
part of s x, or of h x^2 / 2 near a fold, at the bound. Larger: more configurations have a
bound; smaller: bounds are safer."""
LEAST_SECOND_SINGULAR_VALUE = 1e-4
"""At a fold, the second smallest singular value of J must be larger than this part of the
largest. Smaller: a second fold nearby can be missed."""
SAFETY_FACTOR = 1.5
"""Bounds of the quadratic model are enlarged by this factor, for terms of higher order."""
LARGEST_REACH_RAD = 1e-4
"""The quadratic model is not tried farther from a configuration."""
LARGEST_STEP_RAD = 1e-3
"""A step to the root of the quadratic model is not taken if it is larger."""
MAX_FOLD_NEWTON_STEPS = 4
"""Number of steps to the root of the quadratic model. Each doubles the digits."""


def bound_by_kantorovich(
    residual_bound: Floats, sensitivity: Floats, curvature: Floats, loop_count: int
) -> Floats:
    """Return how far a computed configuration can be from one with exactly closed loops.

    Newton's method would close the loops step by step. The Newton-Kantorovich theorem
    bounds the sum of all steps by the first one. If the Jacobian J of the loop residuals
    changes little along the first step, the closed configuration is at most twice this step
    away.

    Parameters
    ----------
    residual_bound
        (n,) for each of n configurations a bound (rad) of every component of the residuals.
        Each loop has three components.
    sensitivity
        (n,) Frobenius norm of the inverse of J. To first order, it bounds the change of the
        pair variables per unit change of the residuals.
    curvature
        (n,) bounds (1/rad) of how fast J changes. If the vector of all variables changes by
        the length d (rad), the three rows of J that belong to one loop change by at most
        `curvature` times d.
    loop_count
        Number of loops.

    Returns
    -------
    (n,) bounds (rad), infinite where the theorem does not apply.

    References
    ----------
    Ciarlet, Mardare: On the Newton-Kantorovich theorem. Analysis and Applications 10, 2012.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        # The theorem needs the vector of all residuals and the whole J. The norm of the
        # residuals is at most sqrt(3 loop_count) residual_bound. J changes by at most
        # sqrt(loop_count) curvature, per unit length of the change of the variables.
        first_step = sensitivity * np.sqrt(3.0 * loop_count) * residual_bound
        jacobian_change = np.sqrt(loop_count) * curvature
        kantorovich_number = jacobian_change * sensitivity * first_step
        root = np.sqrt(np.maximum(1.0 - 2.0 * kantorovich_number, 0.0))
        distance = 2.0 * first_step / (1.0 + root)
        # The stored variables are themselves rounded.
        bound = distance + 2.0 * EPS
        # The theorem applies up to a Kantorovich number of 1/2.
        return np.where(kantorovich_number <= 0.5, bound, np.inf)


def curvature_bound(linearisation: Linearisation) -> Floats:
    """Return bounds (n,) of the change of the closure Jacobian J per radian of motion.

    The caller needs the bounds for the Newton-Kantorovich theorem, which bounds the errors
    of n configurations.

    The columns of J are the velocity vectors of the variables. For an R pair the vector is
    its axis. If variable j moves, the vector of variable i changes by the vector product of
    both vectors. Let p be the largest length of all these products. If the m variables of a
    loop move by x, J y changes by at most m p |x| |y| (Cauchy's inequality). The vector of
    a contact also changes with its own variable, by at most c per radian. The result is
    m p + c for the longest loop.
    """
    vectors = linearisation.vectors
    loop_length = linearisation.tree.longest_loop
    if all(joint.has_axis for joint in linearisation.joints):
        # The vector product of two axes has the sine of their angle as its length. This
        # sine is at most the sum of the sines of the angles from both axes to the first
        # axis. So twice the largest of these sines bounds all products. The largest squared
        # length of the axes bounds them, too.
        apart = np.max(np.linalg.norm(cross(vectors[:, :1], vectors), axis=2), axis=1)
        turn = np.minimum(2.0 * apart, np.max(np.sum(vectors**2, axis=2), axis=1))
        return loop_length * turn
    # The vectors of contacts can be very long, so all products are computed.
    turn = np.zeros(len(vectors))
    for variable in range(vectors.shape[1]):
        products = cross(vectors[:, variable : variable + 1], vectors)
        turn = np.maximum(turn, np.max(np.linalg.norm(products, axis=2), axis=1))
    return loop_length * turn + _contact_change_bound(linearisation)


def _contact_change_bound(linearisation: Linearisation) -> Floats:
    """Return bounds (n,) of the change of contact vectors with their own variables (1/rad).

    The curvatures of both profiles change along the contact point, which changes the
    velocity vectors of the contact. The vector of a rolling contact also turns with the
    contact point, as fast as it is long.
    """
    curvature_rates = np.sum(np.abs(linearisation.states.curvature_rates), axis=2)
    change = np.max(curvature_rates, axis=1)
    rolling = [variable for variable, _ in list_rolling_variables(linearisation.joints)]
    if rolling:
        rolling_lengths = np.linalg.norm(linearisation.vectors[:, rolling], axis=2)
        change = change + np.max(rolling_lengths, axis=1)
    return change


def rounding_of_loops(linearisation: Linearisation) -> float:
    """Return by how much rounding errors open loops, in each component (rad).

    Two roundings of size `EPS` are counted for the closure residual. One more is counted
    for each variable of the longest loop, because pairs are computed from rounded numbers
    of the mechanism file.
    """
    return EPS * (2.0 + linearisation.tree.longest_loop)


@dataclass(frozen=True)
class FoldPlacement:
    """n configurations near folds after an improvement, with bounds of their errors.

    At a fold two configurations of the mechanism for the same inputs become equal. There is
    then one direction of motion in which the loops stay nearly closed. If a configuration
    moves by x in this direction, one component of the closure residual (by how much the
    loops are open) is nearly a quadratic function of x. Its roots are the two
    configurations.

    Attributes
    ----------
    values
        (n, variables) rad, the configuration at the root of the quadratic function that is
        nearest to the given configuration. If there is no root, it is the configuration at
        the minimum or maximum of the function, where the loops are least open.
    error
        (n,) bounds (rad) of the errors of the variables; infinite if they are not known.
    is_out_of_reach
        (n,) whether the loops cannot be closed at the given inputs. They stay open by more
        than all rounding errors explain, also those of the inputs.
    """

    values: Floats
    error: Floats
    is_out_of_reach: Bools


def place_at_folds(
    closure: Closure, driven: Sequence[int], q: Floats, values: Floats
) -> FoldPlacement:
    """Improve configurations at folds, and bound their errors.

    At a fold two configurations meet, and the input has a dead centre. The equations are
    nearly singular there, so Newton's method is inaccurate. In the space of the variables
    there is one direction in which the loops hardly open. If the configuration moves by x
    in this direction, the closure error is a quadratic function of x. Its nearest root is
    the improved configuration.

    Parameters
    ----------
    closure
        The loops of a whole mechanism.
    driven
        Indices of the variables of the inputs.
    q
        (n, inputs) rad, the values of the inputs.
    values
        (n, variables) rad, configurations near the fold, which are nearly closed.

    Returns
    -------
    Configurations with bounds. The bounds contain the rounding of the sizes of the file to
    float64, and at a fold the rounding of the inputs.
    """
    driven = list(driven)
    passive = np.delete(np.arange(values.shape[1]), driven)
    values = values.copy()
    values[:, driven] = q
    # The error is infinite until a bound is computed. The arrays are filled in below.
    placement = FoldPlacement(
        values=values,
        error=np.full(len(values), np.inf),
        is_out_of_reach=np.zeros(len(values), dtype=bool),
    )
    rows = np.flatnonzero(all_finite(values, 1))
    equations = 3 * len(closure.tree.chords)
    if not len(rows) or not 0 < len(passive) <= equations:
        return placement
    # Take steps to the nearest root of the quadratic function, which is computed anew for
    # each step.
    closure = closure.select_rows(rows)
    improved = values[rows]
    for _ in range(MAX_FOLD_NEWTON_STEPS):
        linearisation = closure.linearise(improved)
        fold = _FoldModel(linearisation, passive)
        step = fold.step_to_nearest_root()
        is_small = max_abs(step, axis=1) < LARGEST_STEP_RAD
        improved[:, passive] += np.where(is_small[:, None], step, 0.0)
    linearisation = closure.linearise(improved)
    fold = _FoldModel(linearisation, passive)
    values[rows] = improved

    # Error bound by Newton's method, where its theorem applies. `gap` bounds each component
    # (rad) by which the loops may be open.
    gap = linearisation.closure_residual + rounding_of_loops(linearisation)
    newton_error = bound_by_kantorovich(
        residual_bound=gap,
        sensitivity=fold.sensitivity,
        curvature=curvature_bound(linearisation),
        loop_count=closure.tree.loop_count,
    )
    # Error bound by the quadratic function. At a fold the rounding of the inputs matters,
    # and opens the loops by `input_gap`.
    input_rounding = INPUT_ROUNDING * np.maximum(1.0, max_abs(improved[:, driven], axis=1))
    input_gap = input_rounding * np.max(
        np.abs(linearisation.jacobian[:, :, driven]), axis=(1, 2)
    )
    fold_error = fold.bound_errors(closure, gap + input_gap)
    # The quadratic function has no root if its extreme value has the sign of its curvature.
    # The loops then do not close, if this value is larger than all rounding.
    quadratic = fold.quadratic
    extreme = quadratic.extreme_value * np.sign(quadratic.curvature)
    rounding = np.sqrt(equations) * (rounding_of_loops(linearisation) + input_gap)
    is_open = np.isfinite(fold_error) & (extreme > rounding)
    has_bound = np.isfinite(newton_error)
    placement.error[rows] = np.where(has_bound, newton_error, fold_error)
    placement.is_out_of_reach[rows] = is_open & ~has_bound
    return placement


@dataclass(frozen=True)
class _QuadraticResidual:
    """A quadratic function of how far loops are open, for each of n configurations.

    At a fold two closed configurations are close together. Their distances from a computed
    configuration are about the roots of this function. The roots give the correction of
    the configuration and a bound of its error.

    The configuration is moved by a distance x (rad) along a right singular vector of the
    Jacobian of the loops. The residual is the vector of how far the loops are open. Its
    component along the left singular vector is then f(x) = e + s x + h x^2 / 2.

    Attributes
    ----------
    value, slope, curvature
        (n,) the coefficients e (rad), s and h (1/rad). The slope s is the singular value of
        both vectors, so it is not negative.
    """

    value: Floats
    slope: Floats
    curvature: Floats

    def evaluate(self, x: Floats) -> Floats:
        """Return f(x) at distances x (n,)."""
        return self.value + self.slope * x + 0.5 * self.curvature * x**2

    @property
    def extreme_value(self) -> Floats:
        """(n,) the minimum or maximum of f."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.value - 0.5 * self.slope**2 / self.curvature

    @property
    def extreme_distance(self) -> Floats:
        """(n,) the distance x (rad) of the minimum or maximum of f."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return -self.slope / self.curvature

    def find_nearest_root(self) -> Floats:
        """Return the root (n,) of f nearer to x = 0; its extremum if f has no root."""
        with np.errstate(divide="ignore", invalid="ignore"):
            discriminant = self.slope**2 - 2.0 * self.curvature * self.value
            # The quadratic formula in the form with the square root in the denominator. The
            # slope is not negative, so this is the root with the smaller absolute value.
            root = -2.0 * self.value / (self.slope + np.sqrt(discriminant))
        return np.where(discriminant > 0.0, root, self.extreme_distance)


class _FoldModel:
    """Models of the closure residual F at n configurations near folds.

    F is by how much the loops are open. At a fold two configurations meet at one input. The
    smallest singular value s of the Jacobian J of F is then near zero: J v = s u, with the
    unit vectors v and u. If the variables move along v, the loops hardly open to first
    order. The component u . F, as a function of the distance x along v, shows where the
    loops close again. In all other directions, a step of Newton's method closes the loops.

    In the code, v is `_direction` and u is `_residual_direction`.

    Attributes
    ----------
    sensitivity
        (n,) Frobenius norm of the left inverse of J, the derivative of the residual with
        respect to the variables that are not inputs. It bounds the change of the variables
        per change of the residual. Infinite if a singular value is zero.
    quadratic
        The component u . F at the distance x along v, up to terms of third order.
    """

    def __init__(self, linearisation: Linearisation, free: Indices) -> None:
        """Decompose the closure Jacobian at n nearly closed configurations.

        The closure residual is by how much the loops are open. Its Jacobian J has the
        derivatives with respect to the variables that are not inputs. At a fold, two
        configurations for the same inputs become equal. Near a fold, the smallest singular
        value of J is near zero, so the loops hardly open if the variables move in a certain
        direction.

        Parameters
        ----------
        linearisation
            The loop closure at the configurations.
        free
            Indices of the variables that are not inputs.
        """
        self._linearisation = linearisation
        self._free = free
        # The singular values are sorted from large to small. `np.linalg.svd` returns the
        # left vectors as columns and the right ones as rows, which are made columns too.
        left_vectors, singular_values, right_vector_rows = np.linalg.svd(
            linearisation.jacobian[:, :, free], full_matrices=False
        )
        self._left_vectors = left_vectors
        self._singular_values = singular_values
        self._right_vectors = np.swapaxes(right_vector_rows, 1, 2)
        # The vectors of the smallest singular value. If the variables move along
        # `_direction`, the residual changes along `_residual_direction`, but only little.
        self._direction = self._right_vectors[:, :, -1]
        self._residual_direction = left_vectors[:, :, -1]
        # How much the variables can change per change of the residual: the Frobenius norm
        # of the inverse of J, whose singular values are the reciprocals.
        with np.errstate(divide="ignore"):
            self.sensitivity = np.sqrt(np.sum(singular_values**-2.0, axis=1))
        # The component of the residual along `_residual_direction`, as a quadratic function
        # of the distance along `_direction` from each configuration. Its roots approximate
        # the two configurations near a fold.
        self.quadratic = self._expand_residual()

    def _expand_residual(self) -> _QuadraticResidual:
        """Expand the residual component u . F to second order in the distance along v.

        F is the closure residual (by how much the loops are open) and J its Jacobian. The
        smallest singular value s of J is nearly zero at a fold, where two configurations
        meet. Its singular vectors v (`_direction`) and u (`_residual_direction`) satisfy
        J v = s u. The roots of the quadratic function approximate both configurations.
        """
        second_derivative = self._second_derivative_along(self._direction)
        return _QuadraticResidual(
            value=np.vecdot(self._residual_direction, self._linearisation.residual),
            # The derivative of u . F along v is u . J v, the smallest singular value.
            slope=self._singular_values[:, -1],
            curvature=np.vecdot(self._residual_direction, second_derivative),
        )

    def _second_derivative_along(self, direction: Floats) -> Floats:
        """Return the second derivatives (n, equations) of the residual along a direction.

        The residual is by how much the loops are open, at n configurations.

        The direction (n, free) has a component for each variable that is not an input. The
        inputs are constant.
        """
        # The derivatives of all variables with respect to the distance along the direction.
        rates = np.zeros_like(self._linearisation.values)
        rates[:, self._free] = direction
        # If the variables change at constant rates, the second derivative of the residual
        # is (dJ/dt) rates, with the Jacobian J.
        return self._linearisation.bias(rates)

    def _close_other_equations(self, residual: Floats) -> Floats:
        """Return the step (n, free) that closes the loops in all directions but u.

        The step changes the variables that are not inputs. u is the left singular vector of
        the smallest singular value of their Jacobian J. `residual` (n, equations) is the
        closure residual of the loops, in rad. The step solves J step = -residual, with the
        part of the residual along u left out.

        At a fold, two closed configurations are close together and this singular value is
        nearly zero. A linear step along u would be too large there. The callers therefore
        treat the residual along u separately.
        """
        # Without the last singular value, which is the smallest.
        singular_values = self._singular_values[:, :-1]
        left_vectors = np.swapaxes(self._left_vectors[:, :, :-1], 1, 2)  # as rows
        right_vectors = self._right_vectors[:, :, :-1]  # as columns
        with np.errstate(divide="ignore", invalid="ignore"):
            # The components of the residual along the left vectors, and of the step along
            # the right vectors.
            residual_parts = np.vecdot(left_vectors, residual[:, None])
            step_parts = residual_parts / singular_values
            return -np.matvec(right_vectors, step_parts)

    def step_to_nearest_root(self) -> Floats:
        """Return the step (n, free) to the nearer closed configuration.

        At a fold two closed configurations are close together. `quadratic` tells by how
        much the loops open if the variables move along `_direction`. The step leads along
        this direction to the nearer root of `quadratic`, and closes the loops in the other
        directions. Without a root, the step leads to where the loops are least open.
        """
        distance = self.quadratic.find_nearest_root()
        others = self._close_other_equations(self._linearisation.residual)
        return distance[:, None] * self._direction + others

    def bound_errors(self, closure: Closure, gap: Floats) -> Floats:
        """Return bounds (n,) in rad of the distances to the closed configurations.

        If a configuration is moved by x along v (`_direction`), the loops are open along u
        (`_residual_direction`) by f(x) = e + s x + h x^2 / 2 (`quadratic`). v and u are the
        right and left singular vectors of the smallest singular value s of the closure
        Jacobian.

        The closed configurations are at the roots of f, and e is uncertain by up to g. If
        s x is much larger than h x^2 / 2, there is one root nearby, with an error of up to
        g / s. Near a fold there are two roots, with errors of up to about sqrt(2 g / |h|).
        The bound is checked with the residuals at its two ends.

        Parameters
        ----------
        closure
            The loops, to evaluate the residual at the bound.
        gap
            (n,) bound (rad) of each component by which loops may be open.

        Returns
        -------
        Bounds, infinite where f does not describe the residual up to the bound. Near a fold
        the bounds contain both roots.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # The bound g of the component along u, from the bound of every component.
            gap = gap * np.sqrt(self._left_vectors.shape[1])
            slope = self.quadratic.slope
            size = np.abs(self.quadratic.curvature)
            # Bounds of a simple root, twice g / s, and of two roots. If |e| is at most g,
            # the roots (-s +- sqrt(s^2 - 2 h e)) / h are at most 2 s / |h| + sqrt(2 g /
            # |h|).
            simple_root = SAFETY_FACTOR * 2.0 * gap / slope
            both_roots = SAFETY_FACTOR * (2.0 * slope / size + np.sqrt(2.0 * gap / size))
            # A root is simple if f is nearly straight up to its bound.
            is_simple = size * simple_root <= 0.5 * slope
            reach = np.where(is_simple, simple_root, both_roots)
            reach = np.minimum(reach, LARGEST_REACH_RAD)
            # The dominant term of f at the bound.
            rise = np.where(is_simple, slope * reach, 0.5 * size * reach**2)
            # (n,) error (rad) of the variables in all directions but v.
            other_error = np.zeros_like(gap)
            is_valid = np.ones(len(gap), dtype=bool)
            for side in (1.0, -1.0):
                # Move to the end of the bound, where the residual along u must agree with
                # f.
                x = side * reach
                residual, other_change = self._move_along_fold(closure, x)
                expected = self.quadratic.evaluate(x)
                is_valid &= np.abs(residual - expected) <= LARGEST_MODEL_ERROR * rise
                # The residual must also have the sign of f beyond the roots, and be larger
                # than the gap, so that no root is outside the bound.
                sign = np.where(is_simple, side, np.sign(self.quadratic.curvature))
                is_valid &= residual * sign > gap
                other_error = np.maximum(other_error, other_change)
            if self._singular_values.shape[1] > 1:
                # A second singular value near zero would mean a second fold.
                largest = self._singular_values[:, 0]
                second_smallest = self._singular_values[:, -2]
                is_valid &= second_smallest > LEAST_SECOND_SINGULAR_VALUE * largest
                other_error = 2.0 * other_error + gap / second_smallest
            error = 2.0 * EPS + reach + other_error
            return np.where(is_valid & (other_error <= reach), error, np.inf)

    def _move_along_fold(self, closure: Closure, x: Floats) -> tuple[Floats, Floats]:
        """Move the configurations by distances x, and return by how much the loops open.

        The configurations move along `_direction`, in which the loops open least. The
        inputs are constant. To first order, only the residual along `_residual_direction`
        changes. A further step closes the loops in all other directions of the residual.

        `bound_errors` compares the residual with the quadratic model `quadratic`, to check
        that the model is accurate at the distance x.

        Parameters
        ----------
        closure
            The loops, to evaluate the residual.
        x
            (n,) distances (rad) along `_direction`.

        Returns
        -------
        residual
            (n,) by how much (rad) the loops are open along `_residual_direction`.
        other_change
            (n,) largest change (rad) of a variable in the further step.
        """
        moved_values = self._linearisation.values.copy()
        # `_free` has the indices of the variables that are not inputs.
        moved_values[:, self._free] += x[:, None] * self._direction
        step = self._close_other_equations(closure.linearise(moved_values).residual)
        moved_values[:, self._free] += step
        residual = np.vecdot(
            self._residual_direction, closure.linearise(moved_values).residual
        )
        return residual, max_abs(step, axis=1)
