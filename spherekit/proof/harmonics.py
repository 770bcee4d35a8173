"""The equations at real angles as Fourier sums, evaluated in float64 with error bounds.

An equation of degree m in an angle is a linear combination of e^(i k angle), k = -m ... m.
Its values at 2 m + 1 evenly spaced angles of each variable, in balls, give the
coefficients by a discrete Fourier transform. Float64 values and derivatives then take few
products. Their error has two sources: rounding, and the radii of the balls. The norm of
trigonometric interpolation (Ehlich and Zeller 1966) bounds what the radii change anywhere,
and Bernstein's inequality carries the bound over to derivatives.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np

from spherekit.arrays import Array, Complexes, Floats, Indices
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import (
    UNIT_ROUNDOFF,
    Ball,
    exact_centres,
    flint_library,
    pi_ball,
    upper_magnitude,
)

BallEquations = Callable[[Sequence[Ball]], Array]
"""Returns the values (equations,) of all equations at balls (rad) of all variables."""


@dataclass(frozen=True)
class PartialPolynomial:
    """An equation in which some angles are known, as a polynomial in the unknown angles.

    An unknown angle occurs as z = e^(i angle). An equation that has the degree m in cosines
    and sines of the angle has the powers -m to m of z. Here it is multiplied by z^m, which
    gives the powers 0 to 2 m.

    Attributes
    ----------
    coefficients
        (n, 2 m_1 + 1, 2 m_2 + 1, ...) coefficients for n sets of known angles. Each further
        axis belongs to an unknown, and its index is the power 0, 1, ... of z. The equation
        has the degrees m_1, m_2, ... in the unknowns.
    coefficient_derivatives
        (n, g, 2 m_1 + 1, ...) derivatives of the coefficients with respect to g known
        angles.
    """

    coefficients: Complexes
    coefficient_derivatives: Complexes


class Harmonics:
    """Closure equations of a mechanism as Fourier series, for fast values at many angles.

    An equation of degree m in an angle is a sum of waves e^(i j angle), j = -m ... m. The
    angles are real.

    Parameters
    ----------
    degrees
        (k, v) degree of each of k equations in each of v variables.
    evaluate
        Returns the values (k,) of all equations in balls, at balls (rad) of all variables.

    Attributes
    ----------
    degrees
        The degrees as given.
    max_degree
        Largest degree of any equation in any variable, at least 1.
    coefficients
        For each equation an array with one axis for each variable. Index j of an axis of
        length 2 m + 1 belongs to e^(i (j - m) angle).
    error
        (k,) error bounds of the values of the equations. A derivative has this error times
        the degrees in the variables of the derivative.
    """

    def __init__(self, degrees: Indices, evaluate: BallEquations) -> None:
        """Compute the Fourier coefficients of all equations.

        Afterwards the equations can be evaluated fast in float64, with a bound of the
        error.

        Parameters
        ----------
        degrees
            (k, v) degree m of each of k equations in each of v angles. An equation is a sum
            of waves: products with one factor e^(i j angle) for each angle. With the degree
            m in an angle, the whole numbers j are from -m to m.
        evaluate
            Function that returns the values (k,) of all equations at balls (rad) of all
            angles. A ball is a number with a bound of its error.
        """
        self.degrees = degrees
        # `initial` is the least result, also without equations.
        self.max_degree = int(np.max(degrees, initial=1))

        nodes = _NodeEvaluator(evaluate)
        coefficients_and_errors = [
            # The values on a grid, with 2 m + 1 evenly spaced values of each angle,
            # determine the coefficients of all waves.
            _interpolate(nodes.evaluate_equation(equation, node_counts))
            for equation, node_counts in enumerate((2 * degrees + 1).tolist())
        ]
        self.coefficients = [coefficients for coefficients, _ in coefficients_and_errors]
        self.error = np.array([error for _, error in coefficients_and_errors])

    def derivatives(self, circle_points: Floats, order: int) -> list[Floats]:
        """Return values and derivatives of all k equations at n points.

        An equation is a Fourier sum: each term is a coefficient, times one wave of each
        variable, such as e^(2 i angle). The derivatives follow from those of the waves.

        Parameters
        ----------
        circle_points
            (n, v, 2) cosine and sine of each of v variables, which are angles.
        order
            Highest order of the derivatives: 1 or 2.

        Returns
        -------
        Arrays: values (n, k), first derivatives (n, k, v) and, for order 2, second
        derivatives (n, k, v, v).
        """
        n, v, _ = circle_points.shape
        equation_count = len(self.coefficients)
        results = [
            np.zeros((n, equation_count, *[v] * power)) for power in range(order + 1)
        ]
        # All waves and their derivatives. Axes: variable, order of the derivative, wave,
        # point.
        waves = _evaluate_waves(circle_points, self.max_degree, order)
        for equation, coefficients in enumerate(self.coefficients):
            # Indices of the variables that occur in the equation.
            variables = np.flatnonzero(self.degrees[equation])
            # The coefficients have an axis of length 2 m + 1 for each variable. Its degree
            # m is the highest multiple of its angle in the equation. `squeeze` removes the
            # axes of length 1, of variables that do not occur.
            coefficients_that_occur = np.squeeze(coefficients)
            # Values and derivatives of the equation at the points. `sums` has an axis for
            # each variable that occurs. The index on this axis is the order of the
            # derivative with respect to the variable. The points are the last axis. Waves
            # above the degree m of a variable are left out in `_sum_waves`. The values of
            # the equations are real, so the imaginary parts are only rounding errors.
            sums = _sum_waves(coefficients_that_occur, waves[variables]).real
            # `_select_derivative` returns the derivative (n,) with respect to the variables
            # with the given positions in `variables`. Without positions it returns the
            # values.
            count = len(variables)
            results[0][:, equation] = _select_derivative(sums, count)
            for first in range(count):
                slope = _select_derivative(sums, count, first)
                results[1][:, equation, variables[first]] = slope
            if order > 1:
                for first, second in product(range(count), repeat=2):
                    curvature = _select_derivative(sums, count, first, second)
                    results[2][:, equation, variables[first], variables[second]] = curvature
        return results

    def insert_given_angles(
        self, equation: int, unknowns: Sequence[int], given: Array
    ) -> "PartialPolynomial":
        """Return an equation as a polynomial in z = e^(i angle) of its unknown angles.

        All other angles are given, with n sets of values. An equation of degree m in an
        angle is a sum of the waves e^(i j angle) = z^j with j = -m ... m. Multiplied by
        z^m, it has the powers 0 to 2 m of z.

        Parameters
        ----------
        equation
            Index of the equation.
        unknowns
            Indices of the variables that stay unknown.
        given
            (n, g, 2) cosines and sines of the g given variables, in order.

        Returns
        -------
        The coefficients of the polynomials, and their derivatives with respect to the given
        angles.
        """
        variable_count = self.degrees.shape[1]
        given_variables = [
            variable for variable in range(variable_count) if variable not in unknowns
        ]
        given_count = len(given_variables)
        # The coefficients have an axis of length 2 m + 1 for each variable. Its index k
        # belongs to the wave e^(i (k - m) angle). For an unknown, this wave becomes z^k,
        # since the equation is multiplied by z^m. So k is then the power of z.
        coefficients = self.coefficients[equation].transpose([*unknowns, *given_variables])
        waves = _evaluate_waves(given, self.max_degree, order=1)
        # The sum over the waves of the given angles has these axes:
        # - first one of length 2 for each given angle. Its index is the order of the
        #   derivative with respect to this angle;
        # - next one for each unknown, with the powers of z;
        # - last one with the n sets of given angles.
        sums = _sum_waves(coefficients, waves)
        # Without given angles, there is no sum, and the last axis has the length 1.
        sums = np.broadcast_to(sums, (*sums.shape[:-1], len(given)))
        # `_select_derivative` returns the value. With an index k it returns the derivative
        # with respect to the given angle k.
        values = _select_derivative(sums, given_count)  # (2 m_1 + 1, ..., n)
        slopes = np.empty((given_count, *values.shape), dtype=complex)
        for k in range(given_count):
            slopes[k] = _select_derivative(sums, given_count, k)
        # The axis of the n sets comes first.
        return PartialPolynomial(
            np.moveaxis(values, source=-1, destination=0),
            np.moveaxis(slopes, source=-1, destination=0),
        )


class _NodeEvaluator:
    """Evaluates equations at nodes, which are evenly spaced angles of each variable.

    Fourier coefficients are computed from these values. The grids of several equations can
    share nodes, so the values of all equations at a node are computed once and stored.
    """

    def __init__(self, evaluate: BallEquations) -> None:
        """Store the function that evaluates all equations.

        The function takes angles (rad) as balls, which are numbers with a bound of their
        error.
        """
        self._evaluate = evaluate
        # By node: values (k,) of all k equations, as balls. A node is given by two numbers
        # for each variable: the index of its angle, and how many angles are in a turn.
        self._values_by_node: dict[tuple[tuple[int, int], ...], Array] = {}

    def evaluate_equation(self, equation: int, node_counts: Sequence[int]) -> Array:
        """Return the values of one equation at a grid of evenly spaced angles (nodes).

        A discrete Fourier transform of these values gives the coefficients of the equation.

        Parameters
        ----------
        equation
            Index of the equation.
        node_counts
            (v,) number of nodes in a turn of each variable.

        Returns
        -------
        Values in balls (numbers with a bound of their error), in an array of shape
        `node_counts`. Index j of a variable with c nodes belongs to the angle 2 pi j / c.
        """
        values = np.empty(node_counts, dtype=object)
        for index in np.ndindex(*node_counts):
            # For each variable: the index of its angle, and the number of angles in a turn.
            node = tuple(zip(index, node_counts, strict=True))
            # The values (k,) of all k equations at a node are computed once and stored.
            if node not in self._values_by_node:
                angles = [2 * pi_ball() * j / count for j, count in node]
                self._values_by_node[node] = self._evaluate(angles)
            values[index] = self._values_by_node[node][equation]
        return values


def _sum_waves(coefficients: Complexes, waves: Complexes) -> Complexes:
    """Return Fourier sums of several variables, with their derivatives, at n points.

    A Fourier sum of one variable is the sum over j = -m ... m of c_j e^(i j angle), a sum
    of waves. With several variables, the coefficients have an axis for each. The sum is
    taken over one axis after another. Derivatives follow from the derivatives of the waves.

    Parameters
    ----------
    coefficients
        (..., sizes) coefficients. The last axes belong to the variables in `waves`, with
        lengths 2 m + 1. Any axes before them remain in the result.
    waves
        (variables, orders, 2 max_degree + 1, n) waves and their derivatives at the points,
        from `_evaluate_waves`.

    Returns
    -------
    (orders, ..., orders, remaining axes, n). The first axes belong to the variables, one
    axis to each. The index on such an axis is the order of the derivative with respect to
    this variable. For example, [1, 0] is the first derivative with respect to the first of
    two variables.
    """
    # The last axis is the point. Its length is 1 until the first sum, since the
    # coefficients are the same at all points.
    sums: Complexes = coefficients[..., None]
    # The last variable is summed first. Before its sum, the axes of `sums` are: orders of
    # variables already summed, remaining axes, waves of variables still to sum, points. The
    # sum removes the last axis of waves, and adds a first axis of orders.
    for waves_of_variable in waves[::-1]:
        # A variable of a lower degree m needs only the waves -m to m, in the middle of the
        # axis.
        wave_count = sums.shape[-2]
        unused = (waves_of_variable.shape[1] - wave_count) // 2
        used_waves = waves_of_variable[:, unused : unused + wave_count]
        # Letters: w wave of this variable, n point, o order of the derivative.
        sums = np.einsum("...wn,own->o...n", sums, used_waves)
    return sums


def _select_derivative(
    sums: Complexes | Floats, variable_count: int, *variables: int
) -> Array:
    """Return the value or one derivative from the result of `_sum_waves`.

    `_sum_waves` computes Fourier sums of several variables with their derivatives.

    Parameters
    ----------
    sums
        Values and derivatives of the Fourier sums. The first axes belong to the variables,
        one axis to each. The index on such an axis is the order of the derivative with
        respect to this variable.
    variable_count
        Number of these variables.
    *variables
        Indices of the variables of the derivative. None for the value, i for the first
        derivative with respect to variable i, i and j for the second derivative with
        respect to i and j.
    """
    order_by_variable = [0] * variable_count
    for variable in variables:
        order_by_variable[variable] += 1
    return sums[tuple(order_by_variable)]


def _evaluate_waves(circle_points: Floats, max_degree: int, order: int) -> Complexes:
    """Return the waves e^(i k x), k = -max_degree ... max_degree, and their derivatives.

    Parameters
    ----------
    circle_points
        (n, v, 2) cosine and sine of each of v variables x (angles), at n points.
    max_degree
        Largest k.
    order
        Highest order of the derivatives.

    Returns
    -------
    (v, order + 1, 2 max_degree + 1, n). Axes: variable, order of the derivative with
    respect to x, k, point.
    """
    z = (circle_points[..., 0] + 1j * circle_points[..., 1]).T  # (v, n)
    positive_powers = [z]
    while len(positive_powers) < max_degree:
        positive_powers.append(positive_powers[-1] * z)
    negative_powers = [power.conj() for power in positive_powers[::-1]]
    waves = np.array([*negative_powers, np.ones(z.shape), *positive_powers])
    # Each differentiation multiplies the wave by i k.
    wave_numbers = np.arange(-len(positive_powers), len(positive_powers) + 1)
    factors = np.vander(1j * wave_numbers, order + 1, increasing=True)
    waves_of_variables = waves.swapaxes(0, 1)  # (v, waves, n)
    factors_of_orders = factors.T  # (order + 1, waves)
    return waves_of_variables[:, None, :, :] * factors_of_orders[None, :, :, None]


def _bound_rounding_count(wave_count: int) -> int:
    """Return a bound of the number of roundings in a sum of waves of one variable.

    The waves are powers of z = e^(i angle), with exponents from -m to m. Each further power
    adds at most 8 roundings. The sum of the products of waves and coefficients adds at most
    `wave_count` + 2. With the number, rounding errors of equations are bounded.
    """
    if wave_count == 1:
        # The only wave is the constant 1.
        return 0
    highest_power = wave_count // 2
    return wave_count + 2 + 8 * highest_power


def _interpolate(values: Array) -> tuple[Complexes, float]:
    """Return the Fourier coefficients of one equation, and an error bound of its values.

    An equation of degree m in an angle is a sum of 2 m + 1 waves e^(i j angle). Its values
    at equally many evenly spaced angles (nodes) give the coefficients, by a discrete
    Fourier transform in each variable.

    Parameters
    ----------
    values
        Values of the equation in balls (numbers with a bound of their error), at all
        combinations of nodes. The axis of each variable has the length 2 m + 1; its first
        angle is 0.

    Returns
    -------
    coefficients
        Array of the same shape. Index 0 of each axis is the wave -m.
    error
        Error bound, at any angles, of values computed in float64 from these coefficients.
    """
    node_counts = values.shape

    # 1. Transform the centres of the balls, in one variable after another. The radii of the
    #    balls are taken into account in step 2.
    sums = exact_centres(values)
    balls_about_zero = values - sums
    largest_radius = max(map(upper_magnitude, balls_about_zero.flat))
    for axis, count in enumerate(node_counts):
        # Flint's matrix has the waves 0 to m, then -m to -1, so it is rolled to begin with
        # -m. The matrix has the factor 1 / sqrt(count); coefficients need 1 / count.
        transform = np.array(flint_library().acb_mat.dft(count).tolist())
        rows = transform / exact_ball(count).sqrt()
        wave_rows = np.roll(rows, count // 2, axis=0)
        # The product has the axis of the waves first. This axis moves to the place of the
        # nodes.
        transformed = np.tensordot(wave_rows, sums, axes=(1, axis))
        sums = np.moveaxis(transformed, source=0, destination=axis)

    # 2. The error of float64 values has three parts: conversion of the coefficients,
    #    rounding of the sums, and radii of the balls.
    coefficients = sums.astype(complex)
    conversion_error = sum(map(upper_magnitude, (sums - coefficients).flat))
    # Each rounding changes a sum by at most `UNIT_ROUNDOFF` times the magnitudes of its
    # terms, to first order. The factor 2 is a margin, also for the rounding of this bound.
    roundings = sum(map(_bound_rounding_count, node_counts))
    margin = 2.0
    sum_of_magnitudes = np.sum(np.abs(coefficients))
    rounding_error = margin * roundings * UNIT_ROUNDOFF * sum_of_magnitudes
    # At the nodes the error is at most the largest radius of a ball. Between the nodes it
    # can be larger, at most by the factor `_interpolation_norm` for each variable.
    radius_error = largest_radius * prod(map(_interpolation_norm, node_counts))
    # The factor 1.001 covers the rounding of this sum.
    return coefficients, 1.001 * (radius_error + conversion_error) + rounding_error


def _interpolation_norm(node_count: int) -> float:
    """Return the norm of interpolation at an odd number of evenly spaced angles.

    The interpolant is a trigonometric polynomial. The norm is the largest magnitude that
    the polynomial can take anywhere if its magnitude is at most 1 at these angles (Ehlich
    and Zeller 1966). The norm turns a bound of errors at these angles into one at all
    angles.
    """
    halves = (2 * np.arange(node_count) + 1) * np.pi / (2 * node_count)
    return np.sum(1.0 / np.abs(np.sin(halves))) / node_count * (1 + 1e-9)
