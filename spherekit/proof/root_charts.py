"""Certified complex roots for all inputs of a box, in charts without infinity.

In z = e^(i angle) the equations are polynomials of degree 2 m in each unknown, where m is
the trigonometric degree. Either z or 1/z has a magnitude of at most 1. Each root is stored
in this *chart*, so that a root at infinity is like any other, and all bounds are sums over
coefficients.

A root is certified for all inputs q of a box at once: there is exactly one root in a tube
about z0 + z' (q - q0). The *given* variables of a system are the inputs, and the unknowns
of the systems that were solved before.

Numbers may be infinite or NaN where a test fails. Callers let NumPy divide by zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.proof.tubes import PRODUCT_ROUNDING, ROUND_UP

CHART_CHANGE_MAGNITUDE = 1.05
"""Magnitude above which a point is moved to the other chart (z or 1 / z).

Larger: weaker bounds. Smaller: points near the unit circle change charts in every step.
"""

MOTION_FACTOR = 1.7
"""Radius in which a root is proven to be the only one, over its motion in the box.

Larger: the derivatives change more, and the test fails. Smaller: the root leaves the
radius.
"""

RESIDUAL_FACTOR = 50.0
"""Part of the same radius, over the distance of the root from its approximation.

Larger: the derivatives change more, and the test fails. Smaller: the radius hardly exceeds
the error of the approximation.
"""

MAX_POLISHING_STEPS = 8
"""Largest number of Newton steps that improve approximate roots.

Larger: poor approximations succeed. Smaller: they fail sooner.
"""

POLISHING_TOLERANCE = 1e-13
"""Newton step (in z) below which no further step is made.

Larger: larger residuals, and larger radii of the roots. Smaller: steps that are rounding.
"""

CONVERGED_STEP = 1e-9
"""Last Newton step (in z) above which a root has not converged.

Larger: approximations that are not near a root are kept. Smaller: nearly double roots are
given up.
"""


@dataclass(frozen=True)
class Polynomials:
    """The polynomials of a system for m sets of given values, with error bounds.

    Systems are parts of the equations of a mechanism, and are solved one after another. The
    polynomials are in z = e^(i angle) of each unknown angle of this system. All other
    angles have given values: the inputs, and the unknowns of earlier systems. Common
    roots with all |z| = 1 have real angles, so they are real solutions of the system.
    Proofs of roots need the error bounds.

    Attributes
    ----------
    coefficients
        For each of the k equations an array (m, 2 d_1 + 1, 2 d_2 + 1, ...). The first axis
        is the set of given values. Each further axis belongs to one unknown. An equation of
        degree d in its angle has the powers -d to d of z. It is multiplied by z^d, so that
        the index on the axis is the power, 0 to 2 d.
    coefficient_derivatives
        For each equation (m, given, ...): derivatives of the coefficients with respect to
        the given variables.
    error
        (k,) for each equation a number that bounds the error of each single coefficient and
        of each derivative of a coefficient.
    derivative_bound
        (k,) for each equation a number C that bounds its derivatives at real angles, by
        Bernstein's inequality. The magnitude of a derivative is at most C times the degree
        in each angle by which the equation is differentiated. For example, C d_1 d_2 bounds
        the second derivative with respect to the angles 1 and 2.
    degrees
        (k, variables) trigonometric degrees, the unknowns first, then the given variables.
    """

    coefficients: tuple[Complexes, ...]
    coefficient_derivatives: tuple[Complexes, ...]
    error: Floats
    derivative_bound: Floats
    degrees: Indices


@dataclass(frozen=True)
class ChartRoots:
    """Complex points, such as roots of a system of equations, that may be at infinity.

    The coordinates are e^(i angle) of the k unknown angles of the system. Each is stored in
    one of two charts: this number, or its inverse. The chart with a magnitude of at most
    about 1 is used, so that a coordinate at infinity is stored as 0.

    Attributes
    ----------
    z
        (n, k) e^(i angle) of each unknown, or its inverse.
    inverse
        (n, k) whether `z` is the inverse.
    row
        (n,) for each point the index of the set of given values to which it belongs. Given
        values are the angles of the inputs, and the unknowns of systems that were solved
        before.
    """

    z: Complexes
    inverse: Bools
    row: Indices

    @staticmethod
    def from_points(points: Complexes, row: Indices) -> "ChartRoots":
        """Store each coordinate of some points, or its inverse if its magnitude exceeds 1.

        So all stored numbers have magnitudes of at most 1. A coordinate at infinity is
        stored as 0, the inverse of infinity.

        Parameters
        ----------
        points
            (n, k) coordinates e^(i angle) of k unknown angles. Infinite numbers and NaN
            stand for points at infinity.
        row
            (n,) for each point the index of the set of given values to which it belongs.
            Given values are the angles of inputs, and unknowns that were solved before.
        """
        # The negation also covers NaN.
        inverse = ~(np.abs(points) <= 1.0)
        z = np.where(inverse, 1.0 / points, points)
        return ChartRoots(np.where(np.isfinite(points), z, 0.0), inverse, row)

    @property
    def points(self) -> Complexes:
        """(n, k) e^(i angle), including infinite values."""
        return np.where(self.inverse, 1.0 / self.z, self.z)

    def pairwise_gaps(self, count: int) -> Floats:
        """Return the distances between the roots of each row, including roots at infinity.

        The distances show which roots differ. A row is one set of values of the given
        variables (inputs, and unknowns that were solved before).

        A coordinate e^(i angle) of a root is stored as a number z: the coordinate itself,
        or its inverse. It is written as a fraction a / b: as z / 1, or as 1 / z if the
        inverse is stored. At infinity the inverse z is 0. Two coordinates a / b and c / d
        are equal if their gap |a d - c b| is 0. As |z| is at most about 1, the gap is at
        most about 2.

        Parameters
        ----------
        count
            Number of roots in each row. The roots of row 0 come first, then those of row 1,
            and so on.

        Returns
        -------
        (m, count, count) for m rows, with the first and the second root as further axes:
        the largest gap of any unknown.
        """
        unknown_count = self.z.shape[1]
        shape = (-1, count, unknown_count)
        numerators = np.where(self.inverse, 1.0, self.z).reshape(shape)
        denominators = np.where(self.inverse, self.z, 1.0).reshape(shape)
        # Axes of the products: row, first root (a / b), second root (c / d), unknown.
        a = numerators[:, :, np.newaxis]
        b = denominators[:, :, np.newaxis]
        c = numerators[:, np.newaxis, :]
        d = denominators[:, np.newaxis, :]
        gaps = np.abs(a * d - c * b)
        return np.max(gaps, axis=3, initial=0.0)

    def select_roots(self, chosen: Any) -> "ChartRoots":
        """Return the points that an index, a mask or a Python slice chooses."""
        return ChartRoots(self.z[chosen], self.inverse[chosen], self.row[chosen])

    def evaluate(self, polynomials: Sequence[Complexes]) -> Complexes:
        """Return the values of polynomials in the stored z, at n points.

        Let P be a polynomial of degree s in x = e^(i angle), with coefficients c_p. The
        attribute `z` has x or 1 / x, with a magnitude of at most about 1. So no numbers are
        large or infinite. The value at a point is

            P(z) = sum of c_p z^p,                  if z = x is stored,
            z^s P(1 / z) = sum of c_p z^(s - p),    if z = 1 / x is stored.

        The same is done for each of the k unknowns.

        Parameters
        ----------
        polynomials
            For each polynomial an array (m, ..., size_1, ..., size_k) of coefficients. The
            first axis numbers m sets of coefficients, for different inputs. The attribute
            `row` (n,) has for each point the index of its set. The last k axes are the
            powers of the k unknowns. Any axes between remain in the result, for example
            derivatives of the coefficients with respect to the inputs.

        Returns
        -------
        (n, polynomials, ...), where the dots are the axes that remain.
        """
        # The derivative of order 0, with respect to no unknown, is the value.
        values = [self._differentiate(P, unknowns=()) for P in polynomials]
        return np.stack(values, axis=1)

    def first_derivatives(self, polynomials: Sequence[Complexes]) -> Complexes:
        """Return the first derivatives of polynomials with respect to the stored z.

        Newton's method improves approximate roots with these derivatives.

        The attribute `z` (n, k) has, for each of n points and k unknowns, x = e^(i angle)
        if its magnitude is at most about 1, and 1 / x otherwise. Where z = 1 / x, the
        polynomial is multiplied by a power of z, so that it is a polynomial in z (see
        `evaluate`).

        Parameters
        ----------
        polynomials
            For each polynomial P an array (m, ..., size_1, ..., size_k) of coefficients.
            The first axis numbers m sets of coefficients, for different inputs. The
            attribute `row` (n,) has for each point the index of its set. The last k axes
            are the powers of the k unknowns. Any axes between remain in the result.

        Returns
        -------
        (n, polynomials, k, ...). Axis 2 is the unknown by which P is differentiated. The
        dots are the axes that remain.
        """
        unknowns = range(self.z.shape[1])
        arrays = []
        for polynomial in polynomials:
            # The derivative with respect to each unknown u, (n, ...).
            gradient = [self._differentiate(polynomial, (u,)) for u in unknowns]
            arrays.append(np.stack(gradient, axis=1))
        return np.stack(arrays, axis=1)

    def second_derivatives(self, polynomials: Sequence[Complexes]) -> Complexes:
        """Return the second derivatives of polynomials with respect to the stored z.

        They show how much the first derivatives change near a point. The test that a root
        is the only one there needs this.

        The attribute `z` (n, k) has, for each of n points and k unknowns, x = e^(i angle)
        if its magnitude is at most about 1, and 1 / x otherwise. Where z = 1 / x, the
        polynomial is multiplied by a power of z, so that it is a polynomial in z (see
        `evaluate`).

        Parameters
        ----------
        polynomials
            For each polynomial P an array (m, ..., size_1, ..., size_k) of coefficients.
            The first axis numbers m sets of coefficients, for different inputs. The
            attribute `row` (n,) has for each point the index of its set. The last k axes
            are the powers of the k unknowns. Any axes between remain in the result.

        Returns
        -------
        (n, polynomials, k, k, ...). Axes 2 and 3 are the unknowns by which P is
        differentiated. The dots are the axes that remain.
        """
        unknowns = range(self.z.shape[1])
        arrays = []
        for polynomial in polynomials:
            rows = []
            for first in unknowns:
                # The derivatives with respect to `first` and each unknown u, (n, ...).
                row = [self._differentiate(polynomial, (first, u)) for u in unknowns]
                rows.append(np.stack(row, axis=1))
            arrays.append(np.stack(rows, axis=1))
        return np.stack(arrays, axis=1)

    def _differentiate(
        self, coefficients: Complexes, unknowns: tuple[int, ...]
    ) -> Complexes:
        """Return the value or a derivative of one polynomial, at n points.

        Each unknown e^(i angle), or its inverse, is stored as a number z of magnitude up to
        1. Derivatives are with respect to this z.

        Parameters
        ----------
        coefficients
            (m, ..., size_1, ..., size_k) coefficients of the powers of the k unknowns, for
            m sets of inputs. Each point belongs to one set. A coefficient may be a vector
            or a matrix. Its axes are those between m and size_1, and remain in the result.
        unknowns
            Indices of the unknowns with respect to which the polynomial is differentiated.
            (0, 0) is the second derivative with respect to unknown 0; an empty tuple is the
            value.

        Returns
        -------
        (n, ...) where the dots are the axes of a coefficient.
        """
        # `row` has for each point the index of its set of inputs. So the n points become
        # the first axis.
        terms = coefficients[self.row]
        # The last axis is multiplied by the powers of the last unknown and summed. Then the
        # same is done for the unknown before.
        for column in reversed(range(self.z.shape[1])):
            order_in_unknown = unknowns.count(column)
            powers = self._powers(column, terms.shape[-1], order_in_unknown)
            # n: point, p: power.
            terms = np.einsum("n...p,np->n...", terms, powers)
        return terms

    def _powers(self, column: int, size: int, order: int) -> Complexes:
        """Return the factors of the coefficients in a polynomial, or in a derivative.

        A polynomial of one unknown has coefficients c_0, c_1, ... of the powers of e^(i
        angle). If z = e^(i angle) is stored, c_p has the factor z^p. If z is the inverse,
        the polynomial is multiplied by z^(size - 1), so c_p has the factor z^(size - 1 -
        p). Derivatives are with respect to the stored z.

        Parameters
        ----------
        column
            Index of the unknown.
        size
            Number of coefficients.
        order
            Order of the derivative: 0, 1 or 2.

        Returns
        -------
        (n, size) factors at n points.
        """
        is_inverse = self.inverse[:, column, np.newaxis]  # (n, 1)
        z = self.z[:, column, np.newaxis]  # (n, 1)
        ascending = np.arange(size)
        descending = ascending[::-1]
        exponents = np.where(is_inverse, descending, ascending)  # (n, size)
        # For exponents below the order, the derivative factor is 0. The exponent is then
        # set to 0, to avoid a division by zero.
        return _derivative_factor(exponents, order) * z ** np.maximum(exponents - order, 0)

    def with_points(self, z: Complexes) -> "ChartRoots":
        """Return points with new coordinates, inverted where they have become large.

        A chart is e^(i angle) of an unknown or its inverse, with a magnitude of at most
        about 1. A coordinate above `CHART_CHANGE_MAGNITUDE` is replaced by its inverse.

        Parameters
        ----------
        z
            (n, k) new coordinates, in the charts of the present points.
        """
        is_large = np.abs(z) > CHART_CHANGE_MAGNITUDE
        return ChartRoots(np.where(is_large, 1.0 / z, z), self.inverse ^ is_large, self.row)


def _derivative_factor(exponents: Indices, order: int) -> Floats:
    """Return the factor of z^(p - order) in a derivative of z^p, for exponents p.

    z is e^(i angle) of an unknown, or its inverse. The factor is 1 for order 0, p for order
    1 and p (p - 1) for order 2.
    """
    factor = np.ones(exponents.shape)
    for step in range(order):
        factor *= exponents - step
    return factor


@dataclass(frozen=True)
class PolynomialValues:
    """The k polynomials P of a system and their first derivatives at n points.

    The unknowns are numbers x = e^(i angle) of real or complex angles. A number z with a
    magnitude of at most about 1 is stored: x itself, or 1 / x. In the latter case x = 1 / z
    is inserted into the polynomial. The result is multiplied by a power of z that removes
    negative powers, so that P is a polynomial in z. The coefficients depend on given
    angles: inputs, and unknowns that were solved before.

    Newton's method improves approximate roots with these values and derivatives.

    Attributes
    ----------
    values
        (n, k) values of P.
    by_unknowns
        (n, k, k) derivatives P_z with respect to the stored z.
    by_given
        (n, k, given) derivatives P_g with respect to the given angles (rad).
    """

    values: Complexes
    by_unknowns: Complexes
    by_given: Complexes


def evaluate_polynomials(polynomials: Polynomials, roots: ChartRoots) -> PolynomialValues:
    """Return the polynomials and their first derivatives at points."""
    by_unknowns = roots.first_derivatives(polynomials.coefficients)
    return PolynomialValues(
        values=roots.evaluate(polynomials.coefficients),
        by_unknowns=by_unknowns,
        by_given=roots.evaluate(polynomials.coefficient_derivatives),
    )


def polish_roots(polynomials: Polynomials, roots: ChartRoots) -> tuple[ChartRoots, Bools]:
    """Improve approximate roots of systems of polynomials by Newton's method.

    A coordinate z of a root is e^(i angle) of an unknown angle, or the inverse of this
    number. The one with a magnitude of at most about 1 is stored. So a step of 1 or more
    means failure. The root then keeps its value before this step.

    Parameters
    ----------
    polynomials
        The system, for m sets of values of its given variables (inputs, and unknowns that
        were solved before).
    roots
        n approximate roots, each with the index of the set of given values to which it
        belongs.

    Returns
    -------
    roots
        The improved roots.
    has_converged
        (n,) whether the last step of each root is less than `CONVERGED_STEP`.
    """
    is_good = np.ones(len(roots.z), dtype=bool)
    for _ in range(MAX_POLISHING_STEPS):
        at_roots = evaluate_polynomials(polynomials, roots)
        change = apply_matrices(invert_matrices(at_roots.by_unknowns), at_roots.values)
        step_size = np.max(np.abs(change), axis=1, initial=0.0)
        is_good &= step_size < 1.0
        roots = roots.with_points(np.where(is_good[:, None], roots.z - change, roots.z))
        # All roots that have not failed have negligible steps.
        if np.max(step_size[is_good], initial=0.0) < POLISHING_TOLERANCE:
            break
    return roots, is_good & (step_size < CONVERGED_STEP)


def invert_matrices(matrices: Complexes) -> Complexes:
    """Return the inverses (n, k, k) of matrices, NaN for singular matrices."""
    is_regular = np.all(np.isfinite(matrices), axis=(1, 2))
    finite_matrices = np.where(is_regular[:, None, None], matrices, 0)
    is_regular &= np.abs(np.linalg.det(finite_matrices)) > 0.0
    inverses = np.full_like(matrices, np.nan)
    inverses[is_regular] = np.linalg.inv(matrices[is_regular])
    return inverses


def apply_matrices(matrices: Array, vectors: Array) -> Array:
    """Return the products (n, i) of matrices (n, i, j) with vectors (n, j)."""
    return np.matvec(matrices, vectors)


def _bound_rounding(polynomials: Polynomials, rows: Indices) -> Floats:
    """Return error bounds (n, k) of polynomial values at points with all |z| at most 1.

    The bounds cover the errors of the coefficients and the rounding of the sums. There are
    k polynomials in z = e^(i angle) for each set of values of the given variables. `rows`
    (n,) is the index of the set to which each point belongs.
    """
    magnitudes = [
        np.abs(array).reshape(len(array), -1) for array in polynomials.coefficients
    ]
    counts = [array.shape[1] for array in magnitudes]
    totals = np.stack([np.sum(array, axis=1) for array in magnitudes], axis=1)
    errors = polynomials.error + 4 * PRODUCT_ROUNDING * totals
    return np.multiply(counts, errors)[rows]


@dataclass(frozen=True)
class ChangeBounds:
    """Bounds of errors and changes of the k polynomials P of a system near n roots.

    P depends on k unknowns z and on given variables g: inputs, and unknowns that were
    solved before. The inputs vary in a box, and g0 is the value of g at the centre of the
    box. The bounds are valid for all z within some radius about the approximate root z0,
    and for all g in the box. `enclose_roots` uses them to prove that there is exactly one
    root near each approximation.

    Attributes
    ----------
    value_error
        (n, k) bound of the errors of computed values of P within the radius.
    slope_change
        (n, k, k) bound of the change of the derivatives of P with respect to z, from their
        values at (z0, g0). Axes: root, equation, unknown.
    drift
        (n, k) bound of how much P changes because its derivatives P_g with respect to g are
        not constant. On the line from (z0, g0) to (z, g) this is the mean change of P_g,
        times the change of g.
    """

    value_error: Floats
    slope_change: Floats
    drift: Floats


def _bound_changes(
    polynomials: Polynomials, roots: ChartRoots, radius: Floats, given_change: Floats
) -> ChangeBounds:
    """Return bounds of how far polynomials P are from linear near approximate roots.

    P depends on the unknowns z and the given variables g. A change of a derivative of P is
    bounded by two terms. The first has the computed second derivatives at the root, times
    the changes of z and g. The second is a remainder, bounded by Bernstein's inequality. A
    derivative of P is at most C = `derivative_bound` times the product of the degrees in
    its variables.

    Parameters
    ----------
    polynomials
        The k polynomials for m sets of values of the given variables.
    roots
        n approximate roots. `roots.row` is the index of the set of given values of each
        root.
    radius
        (n,) radius about each root, in z: largest change of each unknown.
    given_change
        (n, given) largest change (rad) of the given variables over the box.
    """
    count = roots.z.shape[1]
    # A trigonometric polynomial of degree d, times z^d, is a polynomial of degree 2 d in z.
    degrees_in_z = 2.0 * polynomials.degrees[:, :count]
    degrees_in_given = polynomials.degrees[:, count:]
    # Outside the unit circle a polynomial of degree d grows at most by |z|^d.
    largest_magnitude = np.maximum(np.abs(roots.z) + radius[:, None], 1.0)
    growth = np.exp(np.log(largest_magnitude) @ degrees_in_z.T) * ROUND_UP
    derivative_bound = polynomials.derivative_bound * growth
    value_error = growth * _bound_rounding(polynomials, roots.row)
    # (n, k) sums of degree times change, without unit. P changes at most by C times the
    # sum. Any derivative of P changes at most by the bound of this derivative times the
    # sum.
    change_by_z = radius[:, None] * np.sum(degrees_in_z, axis=1)
    change_by_given = given_change @ degrees_in_given.T
    total_change = change_by_z + change_by_given
    # P_z is bounded by C times this degree. For an unknown that an equation does not
    # contain, 1 is more than necessary.
    slope_degrees = np.maximum(degrees_in_z, 1.0)

    # Change of P_z. First term: second derivatives with respect to (g, z) and (z, z), times
    # the changes. i: equation, j: unknown, g: given variable.
    slope_change_by_given = np.einsum(
        "nijg,ng->nij",
        np.abs(roots.first_derivatives(polynomials.coefficient_derivatives)),
        given_change,
    )
    second_by_z = np.sum(np.abs(roots.second_derivatives(polynomials.coefficients)), axis=3)
    slope_change = second_by_z * radius[:, None, None] + slope_change_by_given
    # Second term, without the factor `slope_degrees`: third derivatives times half of the
    # square of the change, and the error of the computed second derivatives.
    remainder = 0.5 * derivative_bound * total_change**2 + value_error * total_change
    slope_change += remainder[:, :, None] * slope_degrees

    # Change of P_g, times the change of g. Let z change first, then g. The change of z
    # gives the second derivatives with respect to z and g, and third derivatives with
    # respect to g, z and z. The third derivatives have the factor 1/2, which is left out.
    # The change of g gives the second derivatives with respect to g, which are not
    # computed, so that C bounds them.
    drift_by_z = np.sum(slope_change_by_given, axis=2) * radius[:, None]
    largest_drift = drift_by_z + derivative_bound * change_by_given * (
        change_by_given + change_by_z**2
    )
    # Errors of the computed P_g, and of its computed derivatives with respect to z.
    derivative_error = value_error * (1.0 + total_change) * total_change
    return ChangeBounds(
        value_error=value_error,
        slope_change=slope_change,
        # P_g changes at most linearly with the inputs, so that its mean change is half of
        # its largest one.
        drift=0.5 * largest_drift + derivative_error,
    )


@dataclass(frozen=True)
class KnownAngleChanges:
    """Changes of the known angles of equations, while the inputs vary in small boxes.

    A box is an interval for each input. A proof must show that equations have a solution
    for all inputs in the box. Some angles in the equations are known: the inputs, and
    angles that were solved before. All known angles change in the box. If the inputs differ
    by dq from the centre, the known angles change by

        rates dq + error,   |error| <= max_error.

    For an input itself, the rate with respect to this input is 1, and the error is 0.

    Attributes
    ----------
    input_half_widths
        (boxes, inputs) half widths (rad) of the boxes.
    rates
        (boxes, known angles, inputs) derivatives of the known angles with respect to the
        inputs.
    max_error
        (boxes, known angles) bounds (rad) of the error.
    """

    input_half_widths: Floats
    rates: Floats
    max_error: Floats

    def select_boxes(self, box_numbers: Indices) -> "KnownAngleChanges":
        """Return the changes in some boxes. A number may occur more than once."""
        return KnownAngleChanges(
            input_half_widths=self.input_half_widths[box_numbers],
            rates=self.rates[box_numbers],
            max_error=self.max_error[box_numbers],
        )

    def upper_bounds(self) -> Floats:
        """Return bounds (boxes, known angles) of how far known angles move in a box (rad).

        Known angles are functions of the inputs. Their changes from the centre of a box of
        the inputs are bounded for all points of the box.
        """
        # A linear function changes most towards a corner of the box.
        linear_change = apply_matrices(np.abs(self.rates), self.input_half_widths)
        return (linear_change + self.max_error) * ROUND_UP


@dataclass(frozen=True)
class RootTubes:
    """Tubes about n approximate roots, each with exactly one root for all inputs of a box.

    A root is a solution of the equations for k unknown angles, which may be complex. Its
    coordinate z for an angle is e^(i angle) or its inverse. The one whose magnitude is at
    most about 1 at the approximation is chosen. So even a root with an infinite e^(i angle)
    has finite coordinates.

    While the inputs q vary over a box with the centre q0, the root z(q) moves. The tube
    surrounds it: the axis of the tube is z0 + rates (q - q0), with the approximate root z0
    at q0. A distance of two points is the largest difference of any coordinate.

    Attributes
    ----------
    is_proven
        (n,) whether exactly one root is proven. All further attributes are meaningless
        where this is false.
    centre_radius
        (n,) bound of the distance of the root z(q0) from z0.
    uniqueness_radius
        (n,) radius about z0: for each q in the box, no other root is nearer to z0 than
        this.
    tube_radius
        (n,) bound of the distance of the root z(q) from the axis, everywhere in the box.
    displacement
        (n, k) for each coordinate a bound of the magnitude of z(q) - z0 in the box. The
        bound includes the motion along the axis.
    rates
        (n, k, inputs) derivatives of the axis (z, complex) with respect to the inputs
        (1/rad).
    """

    is_proven: Bools
    centre_radius: Floats
    uniqueness_radius: Floats
    tube_radius: Floats
    displacement: Floats
    rates: Complexes


def enclose_roots(
    polynomials: Polynomials,
    roots: ChartRoots,
    known_angle_changes: KnownAngleChanges,
) -> RootTubes:
    """Return tubes about approximate roots with exactly one root for each input.

    A tube is a neighbourhood of the linear motion (axis) of a root over a box of inputs. P
    are the polynomials, P_z and P_g their derivatives with respect to the unknowns z and
    the given variables g. Let the matrix Y be near the inverse of P_z at the approximate
    root. Suppose that Y P_z differs from the identity by at most `slack` < 1 within a
    radius and for all inputs of the box. The distance of the root from any point within the
    radius is then at most the largest |Y P| at this point, divided by 1 - slack. If this
    distance plus the motion along the axis of the tube is less than the radius, at all
    points of the axis, the root stays inside.

    |Y P| on the axis is its value at the centre of the box and the integral of its
    derivative along the axis, Y P_z z' + Y P_g g'. The rates z' of the axis make this
    derivative zero at the centre. Away from the centre Y P_z and Y P_g change at most
    linearly, so half of their largest changes bounds the mean of the derivative.

    Parameters
    ----------
    polynomials
        The polynomials for m sets of values of the given variables, the centres of the
        boxes.
    roots
        Approximate roots.
    known_angle_changes
        The boxes of the inputs about each of these sets.
    """
    count = roots.z.shape[1]
    changes_at_roots = known_angle_changes.select_boxes(roots.row)
    half = changes_at_roots.input_half_widths
    given_error = changes_at_roots.max_error
    at_roots = evaluate_polynomials(polynomials, roots)
    values = at_roots.values
    by_unknowns = at_roots.by_unknowns
    by_given = at_roots.by_given
    inverse = invert_matrices(by_unknowns)
    inverse_size = np.abs(inverse)
    inverse_by_given = inverse @ by_given

    # Motion of the root over the box: linear part, and what deviations of the given
    # variables add.
    rates = -inverse_by_given @ changes_at_roots.rates
    motion = apply_matrices(np.abs(rates), half) * ROUND_UP
    given_change = changes_at_roots.upper_bounds()
    from_given_error = apply_matrices(np.abs(inverse_by_given), given_error)
    newton_step = np.abs(apply_matrices(inverse, values))

    # The radius in which the root is to be proven to be the only one.
    degrees_in_given = polynomials.degrees[:, count:]
    bend = polynomials.derivative_bound * (given_change @ degrees_in_given.T) ** 2
    total_motion = motion + from_given_error + apply_matrices(inverse_size, bend)
    rounding = _bound_rounding(polynomials, roots.row)
    centre_distance = newton_step + apply_matrices(inverse_size, rounding)
    radius = MOTION_FACTOR * total_motion + RESIDUAL_FACTOR * centre_distance
    uniqueness_radius = np.max(radius, axis=1) + 1e-12

    # |1 - Y P_z|: at the approximation, and its change within the radius and over the box.
    changes = _bound_changes(polynomials, roots, uniqueness_radius, given_change)
    # Bounds of derivatives with respect to z have these factors, see `_bound_changes`.
    slope_degrees = np.maximum(2.0 * polynomials.degrees[:, :count], 1.0)
    deviation = np.abs(np.eye(count) - inverse @ by_unknowns) + PRODUCT_ROUNDING
    deviation += inverse_size @ (
        changes.value_error[:, :, None] * slope_degrees
        + PRODUCT_ROUNDING * np.abs(by_unknowns)
    )
    deviation_change = inverse_size @ changes.slope_change
    row_sums = np.sum(deviation + deviation_change, axis=2)
    slack = np.max(row_sums, axis=1) * ROUND_UP

    # |Y P| at the centre, and on the axis over the box.
    value_rounding = changes.value_error + PRODUCT_ROUNDING * np.abs(values)
    at_centre = newton_step + apply_matrices(inverse_size, value_rounding)
    drift = changes.drift + PRODUCT_ROUNDING * apply_matrices(
        np.abs(by_given), given_change
    )
    on_axis = (
        at_centre
        + from_given_error
        + apply_matrices(inverse_size, drift)
        + apply_matrices(deviation + 0.5 * deviation_change, motion)
    )
    centre_radius = np.max(at_centre, axis=1) / (1.0 - slack) * ROUND_UP
    tube_radius = np.max(on_axis, axis=1) / (1.0 - slack) * ROUND_UP
    stays_inside = np.max(motion, axis=1) + tube_radius < uniqueness_radius
    return RootTubes(
        is_proven=(slack < 1.0) & stays_inside,
        centre_radius=centre_radius,
        uniqueness_radius=uniqueness_radius,
        tube_radius=tube_radius,
        displacement=(motion + tube_radius[:, None]) * ROUND_UP,
        rates=rates,
    )


def solve_one_unknown(polynomials: Polynomials) -> ChartRoots:
    """Return approximations of all roots of one equation with one unknown.

    The equation is a polynomial in z = e^(i angle) with coefficients c_0, ..., c_n. The
    coefficients depend on given variables (inputs, and unknowns that were solved before);
    there are m sets of values. The roots are eigenvalues of the companion matrix: the
    entries below the diagonal are 1, and the last column has -c_k / c_n.

    If c_n is 0, there are roots at infinity, and the approximations may be wrong. A later
    proof of the roots fails then.
    """
    (coefficients,) = polynomials.coefficients  # of the only equation
    m, size = coefficients.shape
    companion = np.tile(np.eye(size - 1, k=-1, dtype=complex), (m, 1, 1))
    last_column = -coefficients[:, :-1] / coefficients[:, -1:]
    # `eigvals` needs finite numbers.
    companion[:, :, -1] = np.where(np.isfinite(last_column), last_column, 0.0)
    points = np.linalg.eigvals(companion).reshape(-1, 1)
    # Each root is stored as z or 1 / z, whichever has a magnitude of at most 1.
    return ChartRoots.from_points(points, np.repeat(np.arange(m), size - 1))


def are_distinct(roots: ChartRoots, radius: Floats, is_good: Bools, count: int) -> Bools:
    """Return a mask of the rows with good roots that are proven to differ from each other.

    If `count` is the largest possible number of roots, these are all roots of such a row.

    A row is one set of values of the given variables (inputs, and unknowns that were solved
    before). A root has complex values of the unknown angles. A coordinate z of a root is
    e^(i angle), or the inverse of this number if its magnitude exceeds 1. The gap of two
    roots (`ChartRoots.pairwise_gaps`) is a distance that is always finite. Two roots differ
    if the gap of their approximations is larger than any change of the gap within the
    errors of both roots.

    Parameters
    ----------
    roots
        The n approximate roots of m rows, row after row, with n = m `count`.
    radius
        (n,) bound of the error of each approximation, valid for all its coordinates z.
    is_good
        (n,) whether a root is usable, for example proven.
    count
        Number of roots in each row.

    Returns
    -------
    (m,) whether all roots of the row are good and different.
    """
    radius_by_row = radius.reshape(-1, count)
    is_good_by_row = is_good.reshape(-1, count)
    # (m, count, count) for each row, first root and second root.
    largest_changes = _bound_gap_change(
        radius_by_row[:, :, np.newaxis], radius_by_row[:, np.newaxis, :]
    )
    is_apart = roots.pairwise_gaps(count) > largest_changes
    is_same_root = np.eye(count, dtype=bool)
    return np.all(is_apart | is_same_root, axis=(1, 2)) & np.all(is_good_by_row, axis=1)


def _bound_gap_change(radius: Floats, other_radius: Floats) -> Floats:
    """Return how much the gap of two roots can change within their errors.

    Two roots are proven to differ if their gap is larger than this change. A coordinate of
    a root is e^(i angle). It is stored inverted if its magnitude exceeds 1. So the stored
    coordinates y and z of two roots have magnitudes of at most about 1. Their errors are at
    most r and s. The gap (`ChartRoots.pairwise_gaps`) is

        |y - z|,     if both are stored in the same way: it changes by at most r + s,
        |y z - 1|,   if one is stored inverted: it changes by at most about r + s + r s.

    The second bound is larger, and is used in both cases. `ROUND_UP` covers its rounding,
    and 1e-14 the rounding of a gap. The factor 1.5 is a margin, for magnitudes slightly
    above 1.

    Parameters
    ----------
    radius, other_radius
        Bounds r and s of the errors of y and z, arrays of shapes that NumPy can combine.
    """
    change = radius + other_radius + radius * other_radius
    return 1.5 * change * ROUND_UP + 1e-14


def classify_real_roots(
    roots: ChartRoots, radius: Floats, uniqueness_radius: Floats
) -> tuple[Bools, Bools]:
    """Return masks of roots proven to have real angles, and of roots proven not to.

    A coordinate z of a root is e^(i angle) or its inverse, so the angle is real if |z| = 1.

    - Real: because the equations are real, the mirror image of a root in the unit circle,
      1/conj(z) in all coordinates, is a root, too. There is only one root within the
      uniqueness radius of the approximation. If the mirror image lies within this radius,
      it is the root itself. Then z = 1/conj(z), so |z| = 1.
    - Not real: some |z| differs from 1 by more than its error.

    Parameters
    ----------
    roots
        The approximate roots.
    radius, uniqueness_radius
        (n,) largest error of each approximation, and radius about it in which there is only
        one root. Both are distances in every single coordinate z.

    Returns
    -------
    is_real, is_not_real
        (n,) for each root. Both are false if nothing is proven.
    """
    magnitude = np.abs(roots.z)
    # 1e-14 covers the rounding of magnitudes.
    root_radius = radius[:, np.newaxis] * ROUND_UP + 1e-14
    mirror_distance = _bound_mirror_distance(magnitude, root_radius)
    mirror_is_inside = mirror_distance * ROUND_UP < uniqueness_radius[:, np.newaxis]
    # The bound of the mirror distance holds only if the magnitude exceeds the radius. For
    # safety, it must exceed twice the radius.
    has_valid_bound = magnitude > 2 * root_radius
    is_real = np.all(has_valid_bound & mirror_is_inside, axis=1)
    is_not_real = np.any(np.abs(magnitude - 1.0) > root_radius, axis=1)
    return is_real, is_not_real


def _bound_mirror_distance(magnitude: Floats, radius: Floats) -> Floats:
    """Return a bound of the distance from c to the mirror image of any point near c.

    The mirror image of a complex number z in the unit circle is 1/conj(z). Here z is a
    coordinate of a root, and c its approximation with the error bound r. The caller
    `classify_real_roots` proves |z| = 1 if the bound is less than the uniqueness radius,
    within which there is only one root. For all z with ``|z - c|`` up to r,

        |1/conj(z) - c| <= |1/conj(z) - 1/conj(c)| + |1/conj(c) - c|
                        <= r / ((|c| - r) |c|) + ||c| - 1/|c||.

    Parameters
    ----------
    magnitude
        ``|c|``, an array. It must exceed the radius.
    radius
        r, an array of a shape that NumPy can combine with `magnitude`.
    """
    spread_of_mirrors = radius / ((magnitude - radius) * magnitude)
    mirror_of_centre = np.abs(magnitude - 1.0 / magnitude)
    # If |c| is near 1, the difference above is small, and its rounding error is not small
    # compared with it. 1e-14 covers this error. The caller covers relative errors by
    # `ROUND_UP`.
    return spread_of_mirrors + mirror_of_centre + 1e-14
