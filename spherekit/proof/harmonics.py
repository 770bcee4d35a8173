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
    """What is left of an equation in which some angles are known: a polynomial.

    The polynomial is one in z_1, z_2, ... with z = e^(i angle) of each unknown angle.

    Attributes
    ----------
    coefficients
        (n, 2 m_1 + 1, 2 m_2 + 1, ...) coefficients for n sets of known angles. Index j of
        the axis of an unknown belongs to the power z^j. The equation has the trigonometric
        degrees m_1, m_2, ... in the unknowns.
    coefficient_derivatives
        (n, g, 2 m_1 + 1, ...) derivatives of the coefficients by the g known angles.
    """

    coefficients: Complexes
    coefficient_derivatives: Complexes


class Harmonics:
    """Equations at real angles by their Fourier coefficients.

    An equation of degree m in an angle is a sum of waves e^(i j angle), j = -m ... m.

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
        """Evaluate all equations at evenly spaced angles, and transform the values.

        Parameters
        ----------
        degrees
            (k, v) trigonometric degree of each of k equations in each of v angles: the
            largest m of the waves e^(i j angle), j = -m ... m, of which it consists.
        evaluate
            Returns the values (k,) of all equations at balls (rad) of all angles. A ball is
            a number with a bound of its error.
        """
        self.degrees = degrees
        # `initial` is the least result. Without it, `max` fails if there is no equation.
        self.max_degree = int(np.max(degrees, initial=1))

        nodes = _NodeEvaluator(evaluate)
        coefficients_and_errors = [
            # An equation of degree m has 2 m + 1 waves. Its values at as many angles give
            # the coefficients of the waves.
            _interpolate(nodes.evaluate_equation(equation, node_counts))
            for equation, node_counts in enumerate((2 * degrees + 1).tolist())
        ]
        self.coefficients = [coefficients for coefficients, _ in coefficients_and_errors]
        self.error = np.array([error for _, error in coefficients_and_errors])

    def derivatives(self, circle_points: Floats, order: int) -> list[Floats]:
        """Return values and derivatives of all equations at n points.

        An equation is a Fourier sum. Each term is a coefficient times one harmonic (wave)
        e^(i j angle) of each variable. Its derivatives follow from those of the waves.

        Parameters
        ----------
        circle_points
            (n, v, 2) cosines and sines of the variables, which are angles.
        order
            Highest order of the derivatives: 1 or 2.

        Returns
        -------
        Values (n, k), first derivatives (n, k, v) and, for order 2, second derivatives
        (n, k, v, v).
        """
        n, v, _ = circle_points.shape
        equation_count = len(self.coefficients)
        results = [
            np.zeros((n, equation_count, *[v] * power)) for power in range(order + 1)
        ]
        # All waves up to the largest degree, with their derivatives: axes variable, order
        # of the derivative, wave j, point.
        waves = _evaluate_waves(circle_points, self.max_degree, order)
        for equation, coefficients in enumerate(self.coefficients):
            # The array of coefficients has an axis for each variable. Its length is 2 m + 1
            # if the equation has the degree m in the variable. Axes of variables that do
            # not occur (m = 0) have the length 1, and `squeeze` leaves them out.
            variables = np.flatnonzero(self.degrees[equation])
            sums = _sum_waves(np.squeeze(coefficients), waves[variables]).real
            # `sums` counts only the variables of this equation, as 0, 1, ...
            count = len(variables)
            results[0][:, equation] = _select_derivative(sums, count)
            for i in range(count):
                slope = _select_derivative(sums, count, i)
                results[1][:, equation, variables[i]] = slope
            if order > 1:
                for i, j in product(range(count), repeat=2):
                    curvature = _select_derivative(sums, count, i, j)
                    results[2][:, equation, variables[i], variables[j]] = curvature
        return results

    def insert_given_angles(
        self, equation: int, unknowns: Sequence[int], given: Array
    ) -> "PartialPolynomial":
        """Return an equation as a polynomial in z = e^(i angle) of some of its angles.

        All other angles are given, with n sets of values. An equation of degree m in an
        angle has the powers -m to m of z. Its coefficients are stored in this order.
        Multiplied by z^m, the equation has the powers 0 to 2 m, and the index of a
        coefficient is its power.

        Parameters
        ----------
        equation
            Number of the equation.
        unknowns
            Numbers of the variables whose z stay unknown.
        given
            (n, g, 2) cosines and sines of the other g variables, in order.

        Returns
        -------
        The coefficients of the polynomials, and their derivatives by the given angles.
        """
        others = [j for j in range(self.degrees.shape[1]) if j not in unknowns]
        # The given angles are inserted into the harmonics (waves) e^(i j angle) of the
        # Fourier sum. The sum is taken over the axes of these angles only. The axes of the
        # unknowns remain, and their waves are the powers of z.
        coefficients = self.coefficients[equation].transpose([*unknowns, *others])
        waves = _evaluate_waves(given, self.max_degree, order=1)
        sums = _sum_waves(coefficients, waves)
        # Without given angles the last axis, that of the n sets, has the length 1 so far.
        sums = np.broadcast_to(sums, (*sums.shape[:-1], len(given)))
        values = _select_derivative(sums, len(others))  # (2 m_1 + 1, ..., n)
        slopes = np.empty((len(others), *values.shape), dtype=complex)
        for k in range(len(others)):
            slopes[k] = _select_derivative(sums, len(others), k)
        # The axis of the n sets comes first.
        return PartialPolynomial(np.moveaxis(values, -1, 0), np.moveaxis(slopes, -1, 0))


class _NodeEvaluator:
    """Evaluates equations at nodes, which are evenly spaced angles of each variable.

    Several equations have the same nodes. The values of all equations at a node are
    computed once and stored.
    """

    def __init__(self, evaluate: BallEquations) -> None:
        """Store the function that evaluates all equations at balls (rad)."""
        self._evaluate = evaluate
        # By node: values (k,) of all k equations in balls. A node has for each variable a
        # fraction of a turn, as the number of the node and the count of nodes in a turn.
        self._values_by_node: dict[tuple[tuple[int, int], ...], Array] = {}

    def evaluate_equation(self, equation: int, node_counts: Sequence[int]) -> Array:
        """Return the values of an equation at all combinations of nodes.

        Parameters
        ----------
        equation
            Number of the equation.
        node_counts
            (v,) number of nodes in a turn of each variable.

        Returns
        -------
        (node_counts) values in balls, numbers with a bound of their error. Index j of the
        axis of a variable with c nodes belongs to the angle 2 pi j / c.
        """
        values = np.empty(node_counts, dtype=object)
        for index in np.ndindex(*node_counts):
            node = tuple(zip(index, node_counts, strict=True))
            if node not in self._values_by_node:
                angles = [2 * pi_ball() * number / count for number, count in node]
                self._values_by_node[node] = self._evaluate(angles)
            values[index] = self._values_by_node[node][equation]
        return values


def _sum_waves(coefficients: Complexes, waves: Complexes) -> Complexes:
    """Return Fourier sums of several variables, with their derivatives, at n points.

    A Fourier sum of one variable is the sum over j = -m ... m of c_j e^(i j angle). In the
    sums of several variables, the coefficients have an axis for each variable. The sum is
    taken over one axis after another. The derivatives of the sums follow from those of the
    waves e^(i j angle).

    Parameters
    ----------
    coefficients
        (..., sizes) with one axis of length 2 m + 1 for each of the variables in `waves`.
        Other axes before them are kept.
    waves
        (variables, orders, 2 max_degree + 1, n) from `_evaluate_waves`.

    Returns
    -------
    (orders, orders, ..., kept axes, n), first one axis of length `orders` for each
    variable. The index [a, b, ...] is the a-th derivative by the first variable, the b-th
    by the second one and so on; all 0 is the value (`_select_derivative`).
    """
    # The shape of `sums` with two variables of 5 and 3 waves, n points and 2 orders:
    #   at first                              (5, 3, 1), the axis of points is repeated
    #   after the sum over variable 1      (2, 5, n)
    #   after the sum over variable 0   (2, 2, n)
    # The last variable is summed first, so that the first axis is that of variable 0.
    sums: Complexes = coefficients[..., None]
    for wave in waves[::-1]:
        # `wave` has the waves -max_degree to max_degree. A variable of a lower degree m
        # needs only those from -m to m, which are in the middle.
        wave_count = sums.shape[-2]
        unused = (wave.shape[1] - wave_count) // 2
        wave = wave[:, unused : unused + wave_count]
        # Letters: w wave of this variable, n point, o order of the derivative by it.
        sums = np.einsum("...wn,own->o...n", sums, wave)
    return sums


def _select_derivative(
    sums: Complexes | Floats, variable_count: int, *variables: int
) -> Array:
    """Return the value or a derivative from the result of `_sum_waves`.

    Parameters
    ----------
    sums
        Values and derivatives. The first axes are the orders of the derivative by each
        variable.
    variable_count
        Number of these variables.
    *variables
        Numbers of the variables by which the derivative is taken, one after another: none
        for the value, i and j for the second derivative by the variables i and j.
    """
    orders = [0] * variable_count
    for variable in variables:
        orders[variable] += 1
    return sums[tuple(orders)]


def _evaluate_waves(circle_points: Floats, max_degree: int, order: int) -> Complexes:
    """Return the waves e^(i k x), k = -max_degree ... max_degree, and their derivatives.

    Parameters
    ----------
    circle_points
        (n, v, 2) cosines and sines of the variables x.
    max_degree
        Largest k.
    order
        Highest order of the derivatives.

    Returns
    -------
    (v, order + 1, 2 max_degree + 1, n). Axes: variable, order of the derivative by x, wave
    k, point.
    """
    z = (circle_points[..., 0] + 1j * circle_points[..., 1]).T  # (v, n)
    positive_powers = [z]
    while len(positive_powers) < max_degree:
        positive_powers.append(positive_powers[-1] * z)
    negative_powers = [power.conj() for power in positive_powers[::-1]]
    waves = np.array([*negative_powers, np.ones(z.shape), *positive_powers])
    # Each derivative multiplies the wave by i k.
    wave_numbers = np.arange(-len(positive_powers), len(positive_powers) + 1)
    factors = np.vander(1j * wave_numbers, order + 1, increasing=True)
    waves_of_variables = waves.swapaxes(0, 1)  # (v, waves, n)
    factors_of_orders = factors.T  # (order + 1, waves)
    return waves_of_variables[:, None, :, :] * factors_of_orders[None, :, :, None]


def _interpolate(values: Array) -> tuple[Complexes, float]:
    """Return the Fourier coefficients of one equation and the error of its values.

    An equation of degree m in an angle has 2 m + 1 harmonics (waves) e^(i j angle). Its
    values at as many evenly spaced angles, the nodes, give the coefficients by a discrete
    Fourier transform in each variable.

    Parameters
    ----------
    values
        Values of the equation in balls at all combinations of nodes. The axis of each
        variable has the length 2 m + 1 and begins with the angle 0.

    Returns
    -------
    coefficients
        Array of the same shape, with the wave -m first in each axis.
    error
        Bound of the error of float64 values of the equation at any angles.
    """
    node_counts = values.shape

    # 1. The discrete Fourier transform of the centres, in one variable after another. A
    # value less its centre is a ball about 0. Its largest magnitude is the radius, which
    # adds to the error below.
    sums = exact_centres(values)
    balls_about_zero = values - sums
    largest_radius = max(map(upper_magnitude, balls_about_zero.flat))
    for axis, count in enumerate(node_counts):
        # The matrix of the transform has rows of the waves 0 to m, then -m to -1. It is
        # rolled so that the wave -m comes first. Coefficients need the factor 1 / count.
        # Flint's matrix has the factor 1 / sqrt(count), so this factor is applied again.
        transform = np.array(flint_library().acb_mat.dft(count).tolist())
        rows = transform / exact_ball(count).sqrt()
        wave_rows = np.roll(rows, count // 2, axis=0)
        sums = np.moveaxis(np.tensordot(wave_rows, sums, (1, axis)), 0, axis)

    # 2. The error of float64 values: conversion of the coefficients, rounding of the sums,
    # and radii of the balls.
    coefficients = sums.astype(complex)
    conversion_error = sum(map(upper_magnitude, (sums - coefficients).flat))
    # Number of roundings that a value has at most. A variable with `count` waves needs the
    # powers of z = e^(i angle) up to count // 2. The error of each power is that of the
    # power before, of z and of one complex product: at most 8 more roundings. The sum of
    # `count` products has at most count + 2. The factor 2 below is an allowance.
    roundings = sum(count + 2 + 8 * (count // 2) for count in node_counts if count > 1)
    rounding_error = 2.0 * roundings * UNIT_ROUNDOFF * np.sum(np.abs(coefficients))
    # The values at the nodes are wrong by at most their radii. Between the nodes, the
    # interpolated error can be larger by at most the norm of the interpolation.
    radius_error = largest_radius * prod(map(_interpolation_norm, node_counts))
    # The factor covers the rounding of this sum.
    return coefficients, 1.001 * (radius_error + conversion_error) + rounding_error


def _interpolation_norm(node_count: int) -> float:
    """Return the norm of interpolation at an odd number of evenly spaced angles.

    The interpolant is a trigonometric polynomial. The norm is the largest magnitude that it
    can take anywhere if its magnitude is at most 1 at these angles (Ehlich and Zeller
    1966).
    """
    halves = (2 * np.arange(node_count) + 1) * np.pi / (2 * node_count)
    return np.sum(1.0 / np.abs(np.sin(halves))) / node_count * (1 + 1e-9)
