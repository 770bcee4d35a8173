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
from functools import cache
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

        # Equations share many of their nodes, so values of all equations are cached. A node
        # is a fraction of a turn (numerator, denominator) for each variable.
        @cache
        def evaluate_node(fractions: tuple[tuple[int, int], ...]) -> Array:
            """Return the values (k,) of all equations at a node."""
            return evaluate([2 * pi_ball() * part / count for part, count in fractions])

        # An equation of degree m has 2 m + 1 waves, so its values at as many angles give
        # the coefficients of the waves. `_interpolate` also returns an error bound of the
        # values that are computed from the coefficients in float64.
        node_counts = (2 * degrees + 1).tolist()
        coefficients_and_errors = [
            _interpolate(counts, equation, evaluate_node)
            for equation, counts in enumerate(node_counts)
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
            # A row of `sums` is the derivative of order a by the first variable, b by the
            # second, c by the third and so on. Its number is
            # a + b (order + 1) + c (order + 1)^2 + ...
            # For example, two variables x and y with order 2 have nine rows:
            #   0: f,     1: df/dx,        2: d2f/dx2,
            #   3: df/dy, 4: d2f/(dx dy),  5: not used,
            #   6: d2f/dy2,                7 and 8: not used.
            # The first derivatives are in the rows (order + 1)^j, here 1 and 3. The numbers
            # of two such rows add up to the row of the second derivative by both variables:
            # 1 + 1 = 2, 1 + 3 = 4, 3 + 3 = 6.
            first_rows = (order + 1) ** np.arange(len(variables))
            results[0][:, equation] = sums[0]
            results[1][:, equation, variables] = sums[first_rows].T
            if order > 1:
                second_rows = first_rows[:, None] + first_rows
                second_derivatives = sums[second_rows].T
                results[2][:, equation, variables[:, None], variables] = second_derivatives
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
        coefficients
            (n, 2 m_1 + 1, 2 m_2 + 1, ...) coefficients, with one axis for each unknown;
            index j belongs to z^j.
        derivatives
            (n, g, 2 m_1 + 1, ...) their derivatives by the given angles (1/rad).
        """
        others = [j for j in range(self.degrees.shape[1]) if j not in unknowns]
        # The given angles are inserted into the harmonics (waves) e^(i j angle) of the
        # Fourier sum. The sum is taken over the axes of these angles only. The axes of the
        # unknowns remain, and their waves are the powers of z. `order` 1 asks for first
        # derivatives of the waves.
        coefficients = self.coefficients[equation].transpose([*unknowns, *others])
        waves = _evaluate_waves(given, self.max_degree, order=1)
        # (2^g, 2 m_1 + 1, ..., n). Index 0 of the first axis is the value of the sum, and
        # index 2^k its first derivative by given angle k. The other indices are mixed
        # derivatives, which are not used.
        sums = _sum_waves(coefficients, waves)
        # Without given angles the last axis has the length 1 so far.
        sums = np.broadcast_to(sums, (*sums.shape[:-1], len(given)))
        sums = np.moveaxis(sums, -1, 0)  # (n, 2^g, 2 m_1 + 1, ...)
        first_derivatives = 2 ** np.arange(len(others))
        return PartialPolynomial(sums[:, 0], sums[:, first_derivatives])


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
    (orders ** variables, ..., n). Index a + b orders + c orders^2 ... of the first axis is
    the a-th derivative by the first variable, the b-th by the second one and so on. With
    two variables and two orders (value and first derivative), the rows are the value, the
    derivatives by the first and by the second variable, and the mixed one.
    """
    # The first axis has the value and the derivatives, the last one the n points. Before
    # the first sum both have the length 1. Each sum removes the last axis of coefficients,
    # and multiplies the number of derivatives by that of the orders. The last variable is
    # summed first, so that the order of the derivative by the first variable changes
    # fastest in the end.
    sums: Complexes = coefficients[None, ..., None]
    for wave in waves[::-1]:
        # `wave` has the waves -max_degree to max_degree. A variable of a lower degree m
        # needs only those from -m to m, which are in the middle.
        unused = (wave.shape[1] - sums.shape[-2]) // 2
        wave = wave[:, unused : wave.shape[1] - unused]
        # Letters: w wave of this variable, n point, o order of the derivative by this
        # variable, p derivatives by the variables that are summed already. In the first sum
        # axis n of `sums` has the length 1, and is repeated for all points.
        sums = np.einsum("p...wn,own->po...n", sums, wave)
        # Join the axes p and o: all derivatives by the variables summed so far.
        sums = sums.reshape(-1, *sums.shape[2:])
    return sums


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
    z = (circle_points[..., 0] + 1j * circle_points[..., 1]).T
    positive_powers = [z]
    while len(positive_powers) < max_degree:
        positive_powers.append(positive_powers[-1] * z)
    negative_powers = [power.conj() for power in positive_powers[::-1]]
    waves = np.array([*negative_powers, np.ones(z.shape), *positive_powers])
    # Each derivative multiplies the wave by i k.
    wave_numbers = np.arange(-len(positive_powers), len(positive_powers) + 1)
    factors = np.vander(1j * wave_numbers, order + 1, increasing=True)
    return waves.swapaxes(0, 1)[:, None] * factors.T[..., None]


def _interpolate(
    node_counts: Sequence[int], equation: int, evaluate_node: Callable[..., Array]
) -> tuple[Complexes, float]:
    """Return the Fourier coefficients of one equation and the error of its values.

    An equation of degree m in an angle has 2 m + 1 harmonics (waves) e^(i j angle). Its
    values at as many evenly spaced angles, the nodes, give the coefficients by a discrete
    Fourier transform in each variable.

    Parameters
    ----------
    node_counts
        Number 2 m + 1 of nodes, and of waves, of each variable.
    equation
        Number of the equation.
    evaluate_node
        Returns the values of all equations in balls. Its argument has for each variable the
        angle as a fraction of a turn (numerator, denominator).

    Returns
    -------
    coefficients
        (node_counts) with one axis for each variable, the wave -m first.
    error
        Bound of the error of float64 values of the equation at any angles.
    """
    # 1. Values of the equation at all combinations of nodes, one axis for each variable.
    values = np.empty(node_counts, dtype=object)
    for index in np.ndindex(*node_counts):
        values[index] = evaluate_node(tuple(zip(index, node_counts, strict=True)))[equation]

    # 2. The discrete Fourier transform of their centres, in one variable after another. A
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

    # 3. The error of float64 values: conversion of the coefficients, rounding of the sums,
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
