"""Systems of equations linear in the cosine and sine of each angle, and their solutions.

The arc between two axes of bodies that are joined by R pairs gives such an equation. A
system has t = 1, 2 or 3 equations in as many angles x, y, z. An array (n, t, 3, ..., 3)
stores n systems: axis 1 counts the equations, and the last t axes belong to the angles.
Indices 0, 1 and 2 of such an axis are the coefficients of 1, the cosine and the sine of the
angle. The left side of an equation is the sum of the coefficients times these factors.

All angles but the first are eliminated by resultants:

- If one angle is left, an equation is a *form* (c0, c1, c2): c0 + c1 cos + c2 sin = 0.
- Two forms b, c in the last angle have a common zero if their resultant is zero. The
  resultant is n1^2 + n2^2 - n0^2 with n = b x c.
- Of three equations the first must not contain z. Its form a in y has two zeros. The
  product of the resultant over both, times (a1^2 + a2^2)^p, is a polynomial. Here p is the
  degree of the resultant in y.

What remains is the eliminant, a trigonometric polynomial of known degree in x. Its roots
are the values of e^(ix). C. W. Wampler (2004) eliminates the same equations by Sylvester's
method.

Angles and coefficients may be complex, because real solutions become complex where two of
them meet. No product here takes a complex conjugate.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Complexes, Floats, Indices
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.numerics.array_rows import ArrayRows

Numbers = NDArray[np.inexact[Any]]

FIRST_SAMPLE_RAD = 0.3183
"""First angle at which the eliminant is sampled.

With sizes in whole degrees, the configuration at this angle is not special. In a special
configuration an equation can lose an angle, for example.
"""

SAMPLES_PER_DEGREE = 4
"""Number of samples of the eliminant, divided by its degree d. Already 2 d + 1 samples
determine it. The others show coefficients beyond the degree, which are rounding
errors.
"""

MAX_COEFFICIENT_ERROR = 1e-9
"""Largest rounding error of a coefficient of the eliminant, relative to its largest one.
Larger: roots with fewer correct digits are trusted. Smaller: more systems are reported as
incomplete."""

ZERO_ELIMINANT = 1e-14
"""The eliminant counts as zero below this part of its largest possible magnitude. Larger:
systems with small eliminants count as having infinitely many solutions.
"""

EMPTY_EQUATION_SIZE = 1e-10
"""An equation with smaller coefficients (norm) is satisfied by all angles. Equations of
arcs have coefficients of about 1."""

UNDETERMINED_RATIO = 1e-5
"""The first of three equations does not determine y if the part of it that depends on y is
smaller than this, relative to the whole equation. At a solution the rest of the equation is
as small as this part, so the check at roots measures both together."""

MATCHED_IMAGINARY_RAD = 0.3
"""Every root whose angle has an imaginary part up to this must lead to a solution.
Otherwise real solutions may be missing."""

MAX_IMAGINARY_RAD = 2.0
"""Solutions are not computed for roots whose angle has a larger imaginary part."""

ROOT_CLUSTER_RAD = 3e-3
"""Roots and solutions nearer to each other than this belong together. Rounding separates
the roots of one multiple solution by less."""

SAME_SOLUTION_RAD = 1e-6
"""Two solutions are one if all their angles differ by less."""

ON_CIRCLE_RAD = 1e-6
"""A root that is nearer to the unit circle has a real first angle. Rounding moves a simple
root by less."""

OFF_CIRCLE_RAD = 1e-3
"""A root that is farther from the unit circle has no real first angle. Rounding moves a
double root by less."""

MAX_SOLUTION_RESIDUAL = 1e-10
"""Largest relative residual of a solution after Newton's method."""

MAX_START_RESIDUAL = 0.01
"""Largest relative residual of a start of Newton's method. Worse starts are dropped."""

MAX_STARTS_PER_ROOT = 4
"""Largest number of starts of Newton's method for a root: two values of y, two of z."""

FLAT_JACOBIAN_RATIO = 1e-5
"""A solution may be multiple if the determinant of its Jacobian is below this part of the
largest value that the lengths of the columns allow."""

ELIMINATION_STRIDE = 8
"""Number of neighbouring systems of three equations of which one is solved by elimination.

For the other systems, Newton's method starts from its solutions, which is faster.
"""

MAX_ROOT_NEWTON_STEPS = 10
"""Largest number of steps of Newton's method from a start to a solution. Larger: more
starts far from a solution converge, in more time. Smaller: more solutions are lost."""

STEP_TOLERANCE_RAD = 1e-9
"""Newton's method ends when no angle changed by more than this. Its convergence is
quadratic, so the error is then at the level of rounding."""

MAX_STEP_RAD = 0.3
"""Largest change of an angle in a step of Newton's method."""


@dataclass(frozen=True)
class EliminantRoots:
    """Roots of the eliminants of n systems of equations.

    The equations contain cosines and sines of several angles. The eliminant is the
    trigonometric polynomial in the first angle x that remains when the other angles are
    eliminated. Its terms are e^(ikx) with k from -d to d, where d is its degree. As a
    polynomial in e^(ix) it has 2 d roots, one for each solution of the system.

    Attributes
    ----------
    roots
        (n, 2 * d) values of e^(ix). All roots are NaN if the coefficient of the highest
        power is zero.
    relative_errors
        (n,) estimated rounding error of the coefficients of each eliminant, relative to its
        largest coefficient.
    problems
        For each system the reason why the roots do not give the solutions of the system, or
        "".
    """

    roots: Complexes
    relative_errors: Floats
    problems: list[str]


@dataclass(frozen=True)
class FourierCoefficients:
    """Coefficients of n trigonometric polynomials in an angle x, of the degree d.

    Attributes
    ----------
    by_order
        (n, 2 * d + 1) coefficients of e^(ikx), in the order k = -d, ..., 0, ..., d.
    relative_errors
        (n,) estimated rounding error of the coefficients, relative to the largest
        coefficient of the same polynomial.
    """

    by_order: Complexes
    relative_errors: Floats


@dataclass(frozen=True)
class EliminantSamples:
    """Values of the eliminants of n systems at m values of the first angle.

    A system has two equations in two angles, or three equations in three angles. The
    eliminant is the polynomial in the cosine and sine of the first angle that remains when
    the other angles are eliminated. The eliminant is zero at the solutions. Samples
    determine its coefficients.

    Attributes
    ----------
    values
        (n, m) values of the eliminants, stored as complex numbers.
    magnitude_limits
        (n, m) upper limits of the magnitudes of these values. An eliminant far below its
        limits at all m angles counts as zero everywhere.
    can_eliminate
        (n,) whether the angles can be eliminated. With two equations this is always so.
        With three equations, the first one must depend on the second angle.
    """

    values: Complexes
    magnitude_limits: Floats
    can_eliminate: Bools


@dataclass(frozen=True)
class FormZeros:
    """The zeros of forms: equations c0 + c1 cos(y) + c2 sin(y) = 0 in one angle y.

    Attributes
    ----------
    factors
        (..., 2, 3) factors 1, cos(y) and sin(y) of the coefficients c0, c1 and c2 at both
        zeros y, which may be complex. NaN or infinite if the denominator is 0.
    denominators
        (...,) c1^2 + c2^2, the denominator of the cosines and sines.
    """

    factors: Complexes
    denominators: Complexes


@dataclass(frozen=True)
class SecondAngleZeros:
    """The second angle y of n systems of three equations, at r values of the first angle.

    With a value of the first angle inserted, the equations in y and z are

    1. c0 + c1 cos(y) + c2 sin(y) = 0, because the first equation does not contain z,
    2. and 3. two equations that contain both y and z.

    Equation 1 has two zeros y. With one of them inserted, the equations 2 and 3 become
    forms in z: sums b0 + b1 cos(z) + b2 sin(z).

    Attributes
    ----------
    factors
        (n, r, 2, 3) values 1, cos(y) and sin(y) at both zeros of equation 1.
    denominators
        (n, r) c1^2 + c2^2, the number by which these cosines and sines were divided. If the
        number is 0, equation 1 does not determine y.
    last_forms
        (n, r, 2, 2, 3) coefficients b0, b1, b2. Axis 2 belongs to the zeros of equation 1,
        axis 3 to the equations 2 and 3.
    """

    factors: Complexes
    denominators: Complexes
    last_forms: Complexes


@dataclass(frozen=True)
class NewtonResult:
    """Angles to which Newton's method leads, with their quality.

    A system has t equations in t angles, which may be complex. Each term of an equation is
    a coefficient times factors: for each angle at most one cosine or sine. Coefficients are
    about 1, but the cosines and sines of complex angles can be large.

    Attributes
    ----------
    angles
        (n, m, t) angles (rad) of n systems with t unknowns, from m starts each.
    residual
        (n, m) largest error of the equations, divided by the size of the factors. Large
        factors cause larger rounding errors.
    is_flat
        (n, m) whether the matrix of derivatives (Jacobian) is almost singular. Several
        solutions may coincide there.
    """

    angles: Complexes
    residual: Floats
    is_flat: Bools


@dataclass(frozen=True)
class RootSolutions(ArrayRows):
    """Solutions of n systems of equations, computed from the roots of their eliminants.

    The eliminant is the polynomial in e^(ix), with x the first angle, that remains when the
    other angles of a system are eliminated. Each root gives a first angle x. With x, the
    equations give starts for all angles, which Newton's method improves. A system with k
    roots and s starts for each root has m = k s starts. The starts are in the order of the
    roots.

    Attributes
    ----------
    angles
        (n, m, t) the t angles (rad) to which Newton's method leads from each start.
    is_solution
        (n, m) whether Newton's method converged to a solution whose first angle belongs to
        the root.
    is_flat
        (n, m) whether the matrix of derivatives (Jacobian) is almost singular. Several
        solutions may coincide there.
    """

    angles: Complexes
    is_solution: Bools
    is_flat: Bools


def eliminant_degree(incidence: Bools) -> int:
    """Return the degree of the eliminant in the first angle.

    A system has t = 1, 2 or 3 equations in as many angles x, y, z. Each equation has degree
    1 in the cosine and sine of each angle that it contains. The eliminant is the
    trigonometric polynomial in x that remains when the other angles are eliminated. The
    number of complex solutions of the system is twice its degree. The degree also says at
    how many values of x the eliminant has to be sampled to get its coefficients.

    The first one of three equations never contains z. If the equations contain all other
    angles, the degrees are:

    ====  ===========================================  ======
    t     eliminant                                    degree
    ====  ===========================================  ======
    1     the equation                                 1
    2     resultant R of both equations                4
    3     R(y1) R(y2) (a1^2 + a2^2)^p                  16
    ====  ===========================================  ======

    With t = 3, R is the resultant of the last two equations: z is eliminated from them. p
    is the degree of R in y. The first equation is a0 + a1 cos(y) + a2 sin(y) = 0, with the
    zeros y1 and y2. R(y1) R(y2) is a fraction with the denominator (a1^2 + a2^2)^p.

    Parameters
    ----------
    incidence
        (t, t), true where an equation (row) contains an angle (column).

    Returns
    -------
    The degree, or 0 if the equations do not contain the angles that are to be eliminated
    from them (see `_can_eliminate_in_order`).
    """
    if not _can_eliminate_in_order(incidence):
        return 0
    equation_count = len(incidence)
    first_angle, second_angle = 0, 1
    if equation_count == 1:
        return int(incidence[0, first_angle])
    resultant_degree = _resultant_degree(incidence, first_angle)
    if equation_count == 2:
        return resultant_degree
    # The eliminant R(y1) R(y2) (a1^2 + a2^2)^p contains x in two ways:
    # 1. Directly, if y1 and y2 are taken as constant. Each R has the degree of the
    #    resultant.
    # 2. By the coefficients a. If all a are multiplied by k, then y1 and y2 stay the same,
    #    and the eliminant is multiplied by k^(2p). So each term has 2 p factors a. The
    #    degree of each a in x is 1 if the first equation contains x, otherwise 0.
    power = _resultant_degree(incidence, second_angle)
    degree_of_first_coefficients = int(incidence[0, first_angle])
    return 2 * resultant_degree + 2 * power * degree_of_first_coefficients


def _can_eliminate_in_order(incidence: Bools) -> bool:
    """Return whether all angles but the first can be eliminated, beginning with the last.

    A system has t equations in t angles. If the result is true, one equation in the first
    angle remains, whose roots give the solutions. The conditions depend on t:

    - t = 1: the equation must contain its angle.
    - t = 2: the last angle is eliminated from both equations, so both must contain it.
    - t = 3: the last angle is eliminated from the last two equations, as for t = 2. The
      second angle is then eliminated from the remaining equation and the first equation.
      So the first equation must contain the second angle, but not the last.

    Parameters
    ----------
    incidence
        (t, t) whether an equation (row) contains an angle (column), for t = 1, 2 or 3.
    """
    if not np.all(incidence[-2:, -1]):
        return False
    if len(incidence) < 3:
        return True
    _, contains_second, contains_third = incidence[0]
    return bool(contains_second and not contains_third)


def _resultant_degree(incidence: Bools, angle: int) -> int:
    """Return the degree, in one angle, of the resultant of the last two equations.

    The degree counts factors cosine and sine of the angle. The resultant is what remains of
    the two equations when the last angle is eliminated. Each of its terms is a product of
    four coefficients, two of each equation. A coefficient has the degree 1 if its equation
    contains the angle, otherwise 0. So each equation that contains the angle adds 2.

    Parameters
    ----------
    incidence
        (t, t) whether an equation (row) contains an angle (column), for t = 2 or 3.
    angle
        Index of the angle, counted from 0. It is not the last one.
    """
    return 2 * int(np.sum(incidence[-2:, angle]))


def find_near_real_angles(equations: Numbers, incidence: Bools) -> tuple[Complexes, str]:
    """Return the real solutions of one system of equations, and some complex ones.

    Each equation is a polynomial in the cosines and sines of angles. Real solutions are the
    configurations of a mechanism. Rounding can make real solutions slightly complex.
    Complex solutions are therefore returned too, if the imaginary part of the first angle
    is below `MAX_IMAGINARY_RAD`.

    Parameters
    ----------
    equations
        (t, 3, ..., 3) coefficients of one system of t = 2 or 3 equations in t angles. Each
        of the last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of
        1, the cosine and the sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column). It must be possible to
        eliminate all angles but the first (`eliminant_degree` is not 0).

    Returns
    -------
    angles
        (k, t) complex solutions (rad), without copies.
    problem
        The reason why real solutions may be missing, or "".
    """
    systems = equations[None]
    with np.errstate(all="ignore"):
        # Roots are values of e^(ix), x the first angle. |log |root|| is the imaginary part
        # of x without its sign.
        eliminant_roots = _find_eliminant_roots(systems, incidence)
        roots = eliminant_roots.roots[0]
        relative_error = eliminant_roots.relative_errors[0]
        problem = eliminant_roots.problems[0]
        if problem:
            return np.empty((0, len(equations)), dtype=complex), problem
        imaginary = np.abs(np.log(np.abs(roots)))
        is_near = imaginary < MAX_IMAGINARY_RAD
        roots = roots[is_near]
        imaginary = imaginary[is_near]

        solutions = _solve_at_roots(systems, roots[None], MAX_STARTS_PER_ROOT)
        candidates = np.flatnonzero(solutions.is_solution[0])
        distinct = candidates[_are_distinct(solutions.angles[0, candidates])]
        angles = solutions.angles[0, distinct]
        is_flat = solutions.is_flat[0, distinct]

        # A cluster of roots must lead to as many solutions, or to one that may be multiple.
        # Fewer solutions mean that at least one was lost.
        roots_in_rows = roots[:, None]
        is_same_cluster = np.abs(roots_in_rows / roots - 1.0) < ROOT_CLUSTER_RAD
        solution_roots = np.exp(1j * angles[:, 0])
        is_near_root = np.abs(roots_in_rows / solution_roots - 1.0) < ROOT_CLUSTER_RAD
        is_lost = np.sum(is_near_root, axis=1) < np.sum(is_same_cluster, axis=1)
        is_lost &= ~np.any(is_near_root & is_flat, axis=1)
        if len(equations) == 3:
            # Where the first equation does not determine y, its zeros are meaningless.
            second_forms = _second_angle_forms(systems, -1j * np.log(roots[None]))
            form_sizes = np.linalg.norm(second_forms[0], axis=1)
            is_lost |= form_sizes / np.linalg.norm(equations[0]) < UNDETERMINED_RATIO
        lost_count = np.sum(is_lost & (imaginary < MATCHED_IMAGINARY_RAD))
    if not relative_error < MAX_COEFFICIENT_ERROR:
        degree = eliminant_degree(incidence)
        problem = (
            f"the eliminant has coefficients {relative_error:.1g} beyond degree {degree}"
        )
    elif lost_count:
        problem = f"{lost_count} roots of the eliminant lost solutions"
    return angles, problem


def find_all_angles(equations: Numbers, incidence: Bools) -> Complexes:
    """Return all complex solutions of n systems of trigonometric equations.

    A system has t equations in t angles. If all angles except the first angle x are
    eliminated, the eliminant remains: a trigonometric polynomial in x. With the degree d
    its terms are e^(ikx) with k from -d to d, so it has 2 d roots e^(ix). The solutions of
    a system are complete if 2 d different ones are found. The zeros of a single equation
    are not compared: a double zero is returned twice. Most systems of three equations
    are solved by Newton's method from the solutions of a neighbour in the list. Neighbours
    should therefore be similar.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column). The angles must be
        eliminable in their order: `eliminant_degree` must not be 0.

    Returns
    -------
    (n, 2 d, t) angles (rad). NaN for a system whose solutions are not complete.
    """
    n, t = equations.shape[:2]
    with np.errstate(all="ignore"):
        if t == 1:
            # The only equation is c0 + c1 cos(x) + c2 sin(x) = 0, with two zeros.
            # `factors` are the values 1, cos(x) and sin(x) at each zero.
            zeros = _find_form_zeros(equations[:, 0])
            return _angles_from_factors(zeros.factors)[..., None]
        # `angles` is filled in step by step; systems without complete solutions stay NaN.
        solution_count = 2 * eliminant_degree(incidence)
        angles = np.full((n, solution_count, t), np.nan, dtype=complex)

        # 1. Elimination, with one start of Newton's method for each root: for all systems
        # of two equations, but only for every `ELIMINATION_STRIDE`-th of three equations.
        stride = ELIMINATION_STRIDE if t == 3 else 1
        systems = np.arange(0, n, stride)
        if len(systems):
            solutions = _eliminate(equations[systems], incidence, starts_per_root=1)
            _store_complete(angles, systems, solutions.angles, solutions.is_solution)

        # 2. Newton's method for systems without complete solutions, from the solutions of
        # the nearest solved system in the list.
        solved = np.flatnonzero(~np.isnan(angles[:, 0, 0]))
        unsolved = np.flatnonzero(np.isnan(angles[:, 0, 0]))
        if len(solved) and len(unsolved):
            distances = np.abs(solved - unsolved[:, None])
            neighbours = solved[np.argmin(distances, axis=1)]
            result = _run_newton(equations[unsolved], angles[neighbours])
            is_solution = result.residual < MAX_SOLUTION_RESIDUAL
            _store_complete(angles, unsolved, result.angles, is_solution)

        # 3. Elimination for systems whose solutions are still not complete, now with all
        # starts of Newton's method that belong to a root.
        unsolved = np.flatnonzero(np.isnan(angles[:, 0, 0]))
        if len(unsolved):
            solutions = _eliminate(
                equations[unsolved], incidence, starts_per_root=MAX_STARTS_PER_ROOT
            )
            _store_complete(angles, unsolved, solutions.angles, solutions.is_solution)
    return angles


def estimate_real_angles(equations: Floats, incidence: Bools) -> tuple[Floats, Bools]:
    """Return starting values for Newton's method of the real solutions of n systems.

    A system has as many trigonometric equations as angles. Only systems with clear roots
    e^(ix) of the first angle x are decided. Each root must be clearly on or off the unit
    circle, and the roots on it must be separate.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) real coefficients of n systems of t = 2 or 3 equations in t
        angles. Each of the last t axes belongs to an angle: indices 0, 1 and 2 are the
        coefficients of 1, the cosine and the sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column). It must be possible to
        eliminate all angles but the first (`eliminant_degree` is not 0).

    Returns
    -------
    angles
        (n, m, t) real angles (rad), NaN if a system has fewer than m solutions. Callers
        must check that Newton's method leads from these starts to different solutions.
    is_clear
        (n,) whether there is one start for each real solution.
    """
    with np.errstate(all="ignore"):
        # Roots are values of e^(ix), x the first angle. |log |root|| is the distance from
        # the unit circle, and the imaginary part of x without its sign.
        eliminant_roots = _find_eliminant_roots(equations, incidence)
        roots = eliminant_roots.roots
        circle_distance = np.abs(np.log(np.abs(roots)))
        is_real = circle_distance < ON_CIRCLE_RAD
        is_clear = np.all(is_real | (circle_distance > OFF_CIRCLE_RAD), axis=1)
        is_clear &= eliminant_roots.relative_errors < MAX_COEFFICIENT_ERROR
        is_clear &= np.array(eliminant_roots.problems, dtype=str) == ""

        # Roots on the unit circle have a real first angle. A row of `first_angles` has the
        # real first angles of a system, then NaN.
        order = np.argsort(~is_real, axis=1, kind="stable")
        order = order[:, : np.max(np.sum(is_real, axis=1), initial=0)]
        first_angles = np.angle(np.take_along_axis(roots, order, axis=1))
        first_angles[~np.take_along_axis(is_real, order, axis=1)] = np.nan

        # Real roots must be apart from each other.
        differences = first_angles[:, :, None] - first_angles[:, None]
        distances = np.abs(np.exp(1j * differences) - 1.0)
        distances[:, *np.diag_indices(first_angles.shape[1])] = np.inf
        is_clear &= ~np.any(distances < ROOT_CLUSTER_RAD, axis=(1, 2))
        if equations.shape[1] == 3:
            # The first of three equations must determine the second angle.
            second_forms = _second_angle_forms(equations, first_angles)
            ratios = np.linalg.norm(second_forms, axis=2)
            coefficients = equations.reshape(len(ratios), 3 * 3**3)
            ratios /= np.linalg.norm(coefficients, axis=1)[:, None]
            is_clear &= ~np.any(ratios < UNDETERMINED_RATIO, axis=1)

        n, root_count = first_angles.shape
        if not root_count:
            return np.empty((n, 0, len(incidence))), is_clear
        # Several starts have the same first angle. The one with the smallest residual is
        # returned.
        starts = _start_angles(equations, first_angles.astype(complex))
        shape = (n, root_count, starts.shape[1] // root_count)
        residual = np.nan_to_num(_relative_residual(equations, starts), nan=np.inf)
        best = np.argmin(residual.reshape(shape), axis=2)[:, :, None, None]
        starts = np.take_along_axis(starts.reshape(*shape, -1), best, axis=2)[:, :, 0]
    return starts.real, is_clear


def _eliminate(equations: Numbers, incidence: Bools, starts_per_root: int) -> RootSolutions:
    """Solve n systems of trigonometric equations by elimination of all angles but one.

    The eliminant is the polynomial in e^(ix), with x the first angle, that remains. Each of
    its roots gives the first angle of a solution, and starts of Newton's method for all
    angles.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column).
    starts_per_root
        Largest number of starts of Newton's method for each root. Those with the smallest
        errors of the equations are used. The root gives the first angle, and an equation
        then gives two values of the next angle. So two equations have 2 possible starts per
        root. Three equations have 4: two second angles, and two last angles for each.

    Returns
    -------
    The angles to which each start leads, and two marks for each. `is_solution`: whether
    Newton's method has converged to a solution with the first angle of the root. `is_flat`:
    whether the Jacobian is almost singular there. A root that is zero or infinite gives no
    angle. A system with such a root is not solved: its angles are NaN and all marks false.
    """
    roots = _find_eliminant_roots(equations, incidence).roots
    has_angle = np.isfinite(roots) & (roots != 0.0)  # (n, roots)
    is_solved = np.all(has_angle, axis=1)
    solved = _solve_at_roots(equations[is_solved], roots[is_solved], starts_per_root)

    # `start_count` is the number of starts of a system at all its roots together.
    start_count, angle_count = solved.angles.shape[1:]
    shape = (len(equations), start_count)
    solutions = RootSolutions(
        angles=np.full((*shape, angle_count), np.nan, dtype=complex),
        is_solution=np.zeros(shape, dtype=bool),
        is_flat=np.zeros(shape, dtype=bool),
    )
    solutions.assign_rows(np.flatnonzero(is_solved), solved)
    return solutions


def _solve_at_roots(
    equations: Numbers, roots: Complexes, starts_per_root: int
) -> RootSolutions:
    """Return the solutions of n systems of equations from the roots of their eliminants.

    The eliminant is the polynomial in e^(ix), with x the first angle, that remains when the
    other angles are eliminated. A root gives x. The other angles follow from the equations,
    and Newton's method corrects all of them.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    roots
        (n, k) values of e^(ix), x the first angle.
    starts_per_root
        Number s of starts of Newton's method for each root. The starts with the smallest
        errors of the equations are used. A root gives one first angle, and two values of
        each other angle. So s is at most 2 for two equations and 4 for three.
    """
    # (n, k * s, t) angles, the starts of a root one after another.
    starts = _choose_starts(equations, roots, starts_per_root)
    result = _run_newton(equations, starts)
    # A start does not count if Newton's method leads to the solution of another root, which
    # has another first angle.
    first_angle_changes = np.abs(result.angles[:, :, 0] - starts[:, :, 0])  # (n, k * s)
    is_near_root = first_angle_changes < ROOT_CLUSTER_RAD
    is_converged = result.residual < MAX_SOLUTION_RESIDUAL
    # Where `is_flat` is true, the Jacobian is almost singular, and several solutions may
    # coincide.
    return RootSolutions(result.angles, is_converged & is_near_root, result.is_flat)


def _choose_starts(equations: Numbers, roots: Complexes, starts_per_root: int) -> Complexes:
    """Return starts of Newton's method with small residuals for each root.

    The systems have t equations in t angles. Each root of the eliminant (polynomial in the
    first angle) gives the first angle. The other angles have several possible values.
    Combinations with a small residual are starts.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations. Each of the last t axes
        belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and sine.
    roots
        (n, k) values of e^(ix), x the first angle.
    starts_per_root
        Largest number s of starts for each root.

    Returns
    -------
    (n, k * s, t) angles (rad), the starts of a root one after another. The angles are
    complex, because x is complex if its root is not on the unit circle. Starts whose
    residual exceeds `MAX_START_RESIDUAL` are replaced by NaN.
    """
    first_angles = -1j * np.log(roots)  # x from e^(ix)
    all_starts = _start_angles(equations, first_angles)
    starts = _best_starts(
        equations, all_starts, root_count=roots.shape[1], starts_per_root=starts_per_root
    )
    residual = _relative_residual(equations, starts)
    starts[residual > MAX_START_RESIDUAL] = np.nan
    return starts


def _store_complete(
    angles: Complexes, systems: Indices, solutions: Complexes, is_solution: Bools
) -> None:
    """Store the solutions of those systems for which all solutions were found.

    The other systems keep their values in `angles`, which are NaN. The caller can
    then try another method for them.

    Parameters
    ----------
    angles
        (n, c, t) angles (rad) of n systems with t unknowns, changed in place. Every system
        has c solutions, real and complex ones together.
    systems
        (k,) indices of the systems for which solutions were computed.
    solutions, is_solution
        (k, m, t) angles (rad), and (k, m) which of them are solutions. Others are failed
        computations. The same solution may occur several times.
    """
    for system, candidates, is_valid in zip(systems, solutions, is_solution, strict=True):
        distinct = candidates[is_valid][_are_distinct(candidates[is_valid])]
        if len(distinct) == angles.shape[1]:
            angles[system] = distinct


def angle_factors(angle: Numbers) -> Numbers:
    """Return (..., 3): 1, cosine and sine of angles (...,) in rad, real or complex."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def _angles_from_factors(factors: Complexes) -> Complexes:
    """Return the angles x (...,) in rad from (..., 3) values k, k cos(x) and k sin(x).

    The common factor k may be any complex number but 0. Angles may be complex.

    An angle follows from e^(ix) or from e^(-ix). The larger of both values is used. With a
    large imaginary part, the smaller value would lose its digits by subtraction.
    """
    scale, scaled_cosine, scaled_sine = np.moveaxis(factors, -1, 0)
    forward = (scaled_cosine + 1j * scaled_sine) / scale
    backward = (scaled_cosine - 1j * scaled_sine) / scale
    return np.where(
        np.abs(forward) > np.abs(backward), -1j * np.log(forward), 1j * np.log(backward)
    )


def _find_form_zeros(form: Numbers) -> FormZeros:
    """Return the zeros of equations c0 + c1 cos(y) + c2 sin(y) = 0 in one angle y.

    With w = c1^2 + c2^2 and r = sqrt(w - c0^2), the equation has two zeros, one for each
    sign of r: cos(y) = (-c0 c1 - r c2) / w and sin(y) = (-c0 c2 + r c1) / w. A zero is
    stored as the three factors of c0, c1 and c2: the values 1, cos(y) and sin(y). The
    denominators w are returned, because y is not determined where w is 0.

    Parameters
    ----------
    form
        (..., 3) coefficients c0, c1, c2.
    """
    # The zeros are complex if r is imaginary.
    c0, c1, c2 = np.moveaxis(form.astype(complex), -1, 0)
    w = c1 * c1 + c2 * c2
    r = np.sqrt(w - c0 * c0)
    # (..., 3) the numerators of 1, cos(y) and sin(y) at each of the two zeros.
    first_numerators = np.stack([w, -c0 * c1 - r * c2, -c0 * c2 + r * c1], axis=-1)
    second_numerators = np.stack([w, -c0 * c1 + r * c2, -c0 * c2 - r * c1], axis=-1)
    numerators = np.stack([first_numerators, second_numerators], axis=-2)  # (..., 2, 3)
    return FormZeros(factors=numerators / w[..., None, None], denominators=w)


def _insert_first_angle(equations: Numbers, first_angles: Numbers) -> Complexes:
    """Insert values of the first angle into equations linear in cosines and sines.

    The remaining equations are then solved for the other angles.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    first_angles
        (n, r) values of the first angle (rad).

    Returns
    -------
    (n, r, t, 3, ..., 3) coefficients of the remaining equations, with one angle less.
    """
    factors = angle_factors(first_angles).astype(complex)
    # n system, k equation, x factor of the first angle, r value of the first angle.
    return np.einsum("nkx...,nrx->nrk...", equations, factors)


def _second_angle_forms(equations: Numbers, first_angles: Numbers) -> Complexes:
    """Return the equation in the second angle at values of the first angle.

    In each system of three equations, the first equation contains only the first and the
    second angle. With a value of the first angle inserted, it is a form c0 + c1 cos(y) +
    c2 sin(y) = 0 in the second angle y. Callers check whether the coefficients are nearly
    zero, because then the form does not determine y.

    Parameters
    ----------
    equations
        (n, 3, 3, 3, 3) coefficients of n systems of three equations. Each of the last three
        axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and
        sine.
    first_angles
        (n, r) values of the first angle (rad).

    Returns
    -------
    (n, r, 3) coefficients of 1, cosine and sine of the second angle.
    """
    return _select_second_angle_form(_insert_first_angle(equations, first_angles))


def _select_second_angle_form(remaining: Complexes) -> Complexes:
    """Return the first of three equations as an equation (n, r, 3) in the second angle y.

    The result has the coefficients of 1, cos(y) and sin(y). Callers solve it for y, or
    check whether it determines y. The last angle z is not in the first equation, because
    the equations of a system are ordered in this way.

    Parameters
    ----------
    remaining
        (n, r, 3, 3, 3) coefficients of the equations of n systems, with r values of the
        first angle inserted. Axis 2 counts the equations. Axis 3 belongs to y and axis 4 to
        z: indices 0, 1 and 2 are the coefficients of 1, cosine and sine.
    """
    first_equation = remaining[:, :, 0]
    # The coefficients of cos(z) and sin(z), indices 1 and 2 of the last axis, are 0.
    return first_equation[:, :, :, 0]


def _solve_second_angle(equations: Numbers, first_angles: Numbers) -> SecondAngleZeros:
    """Return the second angle y of systems of three equations at given first angles.

    The first of three equations does not contain the last angle z. With a first angle
    inserted, it is the form c0 + c1 cos(y) + c2 sin(y) = 0. Its two zeros are values of y.
    Each of them is inserted into the other two equations, in which only z remains. Callers
    solve these equations for z, or eliminate z from them. The result also has the number
    c1^2 + c2^2, by which cos(y) and sin(y) were divided. Where it is zero, the form does
    not determine y.

    Parameters
    ----------
    equations
        (n, 3, 3, 3, 3) coefficients of n systems of three equations. Each of the last three
        axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and
        sine.
    first_angles
        (n, r) values of the first angle (rad).
    """
    remaining = _insert_first_angle(equations, first_angles)
    second_angle_form = _select_second_angle_form(remaining)
    zeros = _find_form_zeros(second_angle_form)
    other_equations = remaining[:, :, 1:]
    # The sum over y inserts its factors 1, cos(y) and sin(y). Letters: n system, r value of
    # the first angle, k equation, y and z factors of these angles, s zero of the form.
    last_forms = np.einsum("nrkyz,nrsy->nrskz", other_equations, zeros.factors)
    return SecondAngleZeros(zeros.factors, zeros.denominators, last_forms)


def _sample_eliminants(
    equations: Numbers, incidence: Bools, first_angles: Floats
) -> EliminantSamples:
    """Return the values of the eliminants of n systems at values of the first angle.

    The eliminant is the polynomial in the cosine and sine of the first angle that remains
    when the other angles are eliminated. The eliminant is zero at the solutions.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t = 2 or 3 equations in t angles.
        Each of the last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients
        of 1, cosine and sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column).
    first_angles
        (m,) values of the first angle (rad).
    """
    system_count, equation_count = equations.shape[:2]
    all_first_angles = np.broadcast_to(first_angles, (system_count, len(first_angles)))
    if equation_count == 2:
        samples = _sample_eliminants_of_two(equations, all_first_angles)
    else:
        # The resultant of the last two equations does not contain the third angle. The
        # first equation has two zeros, which are values of the second angle. The values of
        # the resultant at these two zeros are multiplied. This product is a fraction. The
        # exponent of its denominator, which is removed, is the degree of the resultant in
        # the second angle.
        resultant_degree = _resultant_degree(incidence, angle=1)
        samples = _sample_eliminants_of_three(equations, all_first_angles, resultant_degree)
    if np.isrealobj(equations):
        # The eliminant of real equations is real. Intermediate results are complex, so
        # rounding leaves imaginary parts, which are removed. The type stays complex.
        real_values = samples.values.real.astype(complex)
        samples = replace(samples, values=real_values)
    return samples


def _sample_eliminants_of_two(
    equations: Numbers, first_angles: Numbers
) -> EliminantSamples:
    """Return values of the eliminants of systems of two equations in two angles.

    With a value of the first angle inserted, both equations are forms in the last angle: c0
    + c1 cos + c2 sin = 0. The eliminant, in which this angle is eliminated, is their
    resultant. This expression in the coefficients is zero if both forms have a common zero.

    Parameters
    ----------
    equations
        (n, 2, 3, 3) coefficients of n systems of two equations. Each axis of length 3
        belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and sine.
    first_angles
        (n, m) values of the first angle (rad).
    """
    forms = _insert_first_angle(equations, first_angles)  # (n, m, equations, 3)
    # A resultant has the degree 2 in the coefficients of each form. Its magnitude is at
    # most the product of the squared norms of both forms.
    magnitude_limits = np.prod(_squared_norms(forms), axis=2)
    # The resultant of two equations always eliminates the second angle.
    can_eliminate = np.ones(len(equations), dtype=bool)
    return EliminantSamples(_resultants(forms), magnitude_limits, can_eliminate)


def _sample_eliminants_of_three(
    equations: Numbers, first_angles: Numbers, resultant_degree: int
) -> EliminantSamples:
    """Return values of the eliminants of systems of three equations in three angles.

    The eliminant is the polynomial in the first angle x that remains when the angles y and
    z are eliminated. Its roots are the angles x of the solutions. Each of its values is
    computed at a given x:

    1. The first equation does not contain z. At the given x it has two zeros y.
    2. At each zero y, the other two equations are forms c0 + c1 cos(z) + c2 sin(z) = 0.
       They have one resultant, which is zero if both forms have a common zero z.
    3. So the product of the resultants at both zeros y is zero if x belongs to a solution.
    4. This product is a fraction. cos(y) and sin(y) are fractions with the denominator w,
       which depends on x. If the resultant has the degree p in them, the product has the
       denominator w^p. The eliminant is the numerator: the product times w^p.

    Parameters
    ----------
    equations
        (n, 3, 3, 3, 3) coefficients of n systems of three equations. Each of the last three
        axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and
        sine.
    first_angles
        (n, m) values of the first angle (rad).
    resultant_degree
        The degree p.
    """
    zeros = _solve_second_angle(equations, first_angles)
    # `last_forms` are the two forms in the last angle, at each zero.
    resultants = _resultants(zeros.last_forms)  # (n, m, zeros)
    values = np.prod(resultants, axis=2) * zeros.denominators**resultant_degree
    # Limits that the magnitudes of the values cannot exceed. The limit of a resultant is
    # the product of the squared norms of its forms.
    squared_norms = _squared_norms(zeros.last_forms)  # (n, m, zeros, equations)
    resultant_limits = np.prod(squared_norms, axis=(2, 3))
    denominator_sizes = np.abs(zeros.denominators)
    return EliminantSamples(
        values=values,
        magnitude_limits=denominator_sizes**resultant_degree * resultant_limits,
        # The second angle can only be eliminated if the first equation determines it.
        can_eliminate=_determines_second_angle(equations, zeros.denominators),
    )


def _determines_second_angle(equations: Numbers, denominators: Complexes) -> Bools:
    """Return a mask (n,) of the systems whose first equation determines the angle y.

    A system has three equations, and y is the second angle. The first equation, with a
    value of the first angle inserted, is c0 + c1 cos(y) + c2 sin(y) = 0. Its solution has
    the denominator c1^2 + c2^2. If the denominator is nearly 0 at all values of the first
    angle, the equation does not determine y.

    Parameters
    ----------
    equations
        (n, 3, 3, 3, 3) coefficients of n systems of three equations. Each of the last three
        axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1, cosine and
        sine.
    denominators
        (n, m) c1^2 + c2^2 at m values of the first angle.
    """
    first_equations = equations[:, 0].reshape(len(equations), 3**3)
    first_norms = np.linalg.norm(first_equations, axis=1)
    # The denominator is quadratic in the coefficients, so the limit of their norm is
    # squared.
    smallest_denominator = (UNDETERMINED_RATIO * first_norms) ** 2
    return max_abs(denominators, axis=1) > smallest_denominator


def _resultants(forms: Complexes) -> Complexes:
    """Return the resultants (...,) of pairs of equations in one angle.

    A form (c0, c1, c2) is the equation c0 + c1 cos(x) + c2 sin(x) = 0. The resultant of two
    forms is zero if they have a common solution.

    Parameters
    ----------
    forms
        (..., 2, 3) both forms of each pair.
    """
    # The resultant of the forms b and c is n1^2 + n2^2 - n0^2 with n = b x c.
    normal = np.cross(forms[..., 0, :], forms[..., 1, :])
    return normal[..., 1] ** 2 + normal[..., 2] ** 2 - normal[..., 0] ** 2


def _squared_norms(forms: Complexes) -> Floats:
    """Return the squared norms (...,) of equations (..., 3) in one angle.

    The magnitude of the resultant of two equations is at most the product of their squared
    norms.
    """
    return np.sum(np.abs(forms) ** 2, axis=-1)


def _find_eliminant_roots(equations: Numbers, incidence: Bools) -> EliminantRoots:
    """Return the roots of the eliminants of n systems of two or three equations.

    The eliminant is the trigonometric polynomial in the first angle x that remains when the
    other angles are eliminated. The terms of the eliminant are e^(ikx) with k from -degree
    to degree. The eliminant is sampled at equally spaced values of x. A Fourier transform
    gives the coefficients. The eigenvalues of the companion matrix are the roots, values of
    e^(ix).

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    incidence
        (t, t) whether an equation (row) contains an angle (column).
    """
    degree = eliminant_degree(incidence)
    count = SAMPLES_PER_DEGREE * degree
    sample_angles = FIRST_SAMPLE_RAD + 2 * np.pi * np.arange(count) / count
    samples = _sample_eliminants(equations, incidence, sample_angles)
    coefficients = _fourier_coefficients(samples.values, degree)

    # The samples begin at FIRST_SAMPLE_RAD, so the coefficients belong to powers of e^(i (x
    # - FIRST_SAMPLE_RAD)). The factor turns the roots into values of e^(ix).
    highest_first = coefficients.by_order[:, ::-1]
    roots = _polynomial_roots(highest_first) * np.exp(1j * FIRST_SAMPLE_RAD)
    # For each system, why its roots do not give its solutions, or "".
    problems = _find_problems(equations, samples, roots)
    return EliminantRoots(roots, coefficients.relative_errors, problems)


def _fourier_coefficients(samples: Complexes, degree: int) -> FourierCoefficients:
    """Return the coefficients of trigonometric polynomials from their samples.

    Parameters
    ----------
    samples
        (n, count) values at equal steps of 2 pi / count from the angle 0. The count is
        larger than 2 * degree + 1, so some coefficients show the rounding errors.
    degree
        Degree of the polynomials.
    """
    count = samples.shape[1]
    # (n, count) coefficients of e^(ikx) for k = 0, 1, ... The last ones belong to k = ...,
    # -2, -1.
    spectrum = np.fft.fft(samples, axis=1) / count
    not_negative = spectrum[:, : degree + 1]
    beyond_degree = spectrum[:, degree + 1 : count - degree]
    negative = spectrum[:, count - degree :]
    # Coefficients beyond the degree would be zero without rounding errors.
    largest_error = np.max(np.abs(beyond_degree), axis=1)
    return FourierCoefficients(
        by_order=np.concatenate([negative, not_negative], axis=1),
        relative_errors=largest_error / max_abs(spectrum, axis=1),
    )


def _find_problems(
    equations: Numbers, samples: EliminantSamples, roots: Complexes
) -> list[str]:
    """Return, for each system, why its solutions cannot be found by elimination, or "".

    The eliminant is the polynomial in the first angle that remains when the other angles
    are eliminated. There are three reasons:

    - An angle cannot be eliminated, because an equation that should determine it does not
      depend on it. Values of the eliminant can then be NaN or infinite.
    - An equation is empty, or the eliminant is zero everywhere, so that every value of the
      first angle would be a root.
    - The coefficient of the highest power of e^(ix) is zero, so all roots are NaN.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations. The coefficients are
        about 1, so an equation with tiny coefficients is empty.
    samples
        Values of the eliminants at several first angles.
    roots
        (n, 2 * degree) roots of the eliminants, values of e^(ix).
    """
    can_eliminate = samples.can_eliminate & all_finite(samples.values, 1)

    coefficients = equations.reshape(*equations.shape[:2], 3 ** equations.shape[1])
    equation_norms = np.linalg.norm(coefficients, axis=2)
    has_empty_equation = np.min(equation_norms, axis=1) < EMPTY_EQUATION_SIZE

    # `magnitude_limits` bound the magnitudes that the values can have with coefficients of
    # this size. Values far below these limits count as zero.
    largest_value = max_abs(samples.values, axis=1)
    largest_limit = np.max(samples.magnitude_limits, axis=1)
    is_zero_everywhere = ~(largest_value > ZERO_ELIMINANT * largest_limit)

    # For each system, the first reason that applies, or an empty text.
    has_infinitely_many = has_empty_equation | is_zero_everywhere
    reasons = np.select(
        [~can_eliminate, has_infinitely_many, ~all_finite(roots, 1)],
        [
            "an equation does not depend on the angle that it must determine",
            "there are infinitely many complex solutions",
            "the coefficient of the highest power of the eliminant is zero",
        ],
        default="",
    )
    return reasons.tolist()


def _polynomial_roots(coefficients: Complexes) -> Complexes:
    """Return the roots (n, d) of n polynomials of degree d.

    The roots are the eigenvalues of the companion matrices. If the coefficient of the
    highest power is zero, all roots are NaN.

    Parameters
    ----------
    coefficients
        (n, d + 1) coefficients, that of the highest power first.
    """
    n = len(coefficients)
    degree = coefficients.shape[1] - 1
    companions = np.zeros((n, degree, degree), dtype=complex)
    companions[:, 1:, :-1] = np.eye(degree - 1)
    companions[:, 0] = -coefficients[:, 1:] / coefficients[:, :1]
    is_finite = all_finite(companions, (1, 2))
    roots = np.full((n, degree), np.nan, dtype=complex)
    roots[is_finite] = np.linalg.eigvals(companions[is_finite])
    return roots


def _start_angles(equations: Numbers, first_angles: Complexes) -> Complexes:
    """Return starts of Newton's method for all angles, if the first angle is known.

    With the first angle inserted, the equations have several zeros in the other angles. All
    combinations of zeros are starts. Not all starts are near a solution, so the caller
    selects those with small residuals.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    first_angles
        (n, r) first angles (rad) of solutions.

    Returns
    -------
    (n, r * s, t) angles (rad). The s starts of a first angle follow one another: 4 for
    three equations, 2 for two. Each solution with that first angle is near one of them.
    """
    if equations.shape[1] == 2:
        starts = _start_angles_of_two(equations, first_angles)
    else:
        starts = _start_angles_of_three(equations, first_angles)
    # All starts of a system in one axis.
    n, r, s, t = starts.shape
    return starts.reshape(n, r * s, t)


def _start_angles_of_two(equations: Numbers, first_angles: Complexes) -> Complexes:
    """Return starts of Newton's method for systems of two equations.

    With the first angle inserted, both equations contain only the last angle. The one that
    is more accurate gives two values of this angle. Each of them is a start.

    Parameters
    ----------
    equations
        (n, 2, 3, 3) coefficients of n systems. Each axis of length 3 belongs to an angle:
        indices 0, 1 and 2 are the coefficients of 1, cosine and sine.
    first_angles
        (n, r) first angles (rad) of solutions.

    Returns
    -------
    (n, r, 2, 2) angles (rad). Axis 2 belongs to the values of the last angle, axis 3 to
    both angles.
    """
    last_angles = _last_angles(_insert_first_angle(equations, first_angles))  # (n, r, 2)
    starts = np.empty((*last_angles.shape, 2), dtype=complex)
    starts[..., 0] = first_angles[:, :, None]
    starts[..., 1] = last_angles
    return starts


def _start_angles_of_three(equations: Numbers, first_angles: Complexes) -> Complexes:
    """Return starts of Newton's method for systems of three equations.

    The first equation does not contain the last angle. With the first angle inserted, the
    first equation gives two values of the second angle. With one of these values inserted,
    one of the last two equations gives two values of the last angle.

    Parameters
    ----------
    equations
        (n, 3, 3, 3, 3) coefficients of n systems. Each of the last three axes belongs to an
        angle: indices 0, 1 and 2 are the coefficients of 1, cosine and sine.
    first_angles
        (n, r) first angles (rad) of solutions.

    Returns
    -------
    (n, r, 4, 3) angles (rad). Axis 2 belongs to the four combinations of a second and a
    last angle, axis 3 to the three angles.
    """
    zeros = _solve_second_angle(equations, first_angles)
    # `factors` are the values 1, cosine and sine of the second angle.
    second_angles = _angles_from_factors(zeros.factors)  # (n, r, 2)
    # `last_forms` are the last two equations, with only the last angle left. The last axis
    # of the result has two values of this angle for each value of the second one.
    last_angles = _last_angles(zeros.last_forms)  # (n, r, 2, 2)
    starts = np.empty((*last_angles.shape, 3), dtype=complex)
    starts[..., 0] = first_angles[:, :, None, None]
    starts[..., 1] = second_angles[:, :, :, None]
    starts[..., 2] = last_angles
    n, r = first_angles.shape
    return starts.reshape(n, r, 4, 3)


def _last_angles(forms: Complexes) -> Complexes:
    """Return two possible values of the last angle, from two equations in it alone.

    The other angles have been inserted in these equations. A form (c0, c1, c2) is an
    equation c0 + c1 cos + c2 sin = 0 in one angle, with two zeros. At a solution of the
    system, both forms have one zero in common. It is not identified here. Both zeros of one
    form are returned, and `_best_starts` selects by the residuals.

    Parameters
    ----------
    forms
        (..., 2, 3) two forms in the last angle.

    Returns
    -------
    (..., 2) both zeros (rad) of the form that gives them more accurately.
    """
    # The form with the larger coefficients of cosine and sine gives more accurate zeros.
    angle_parts = np.linalg.norm(forms[..., 1:], axis=-1)
    better = np.argmax(angle_parts, axis=-1)[..., None, None]
    better_forms = np.take_along_axis(forms, better, axis=-2)[..., 0, :]
    zeros = _find_form_zeros(better_forms)
    # `zeros.factors` has the values 1, cosine and sine of the angle at each zero.
    return _angles_from_factors(zeros.factors)


def _best_starts(
    equations: Numbers, starts: Complexes, root_count: int, starts_per_root: int
) -> Complexes:
    """Select the starts of Newton's method with the smallest residuals, for each root.

    Each root of the eliminant (polynomial in the first angle) has several starts, because
    the other angles have several possible values.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    starts
        (n, root_count * s, t) angles (rad), the s starts of a root one after another.
    root_count
        Number of roots of each system.
    starts_per_root
        Number of starts to return for each root, at most s.

    Returns
    -------
    (n, root_count * starts_per_root, t) angles (rad), the best start of each root first.
    """
    n, start_count, t = starts.shape
    shape = (n, root_count, start_count // max(root_count, 1))  # there may be no root
    residual = _relative_residual(equations, starts)
    best = np.argsort(residual.reshape(shape), axis=2)[:, :, :starts_per_root, None]
    best_starts = np.take_along_axis(starts.reshape(*shape, t), best, axis=2)
    return best_starts.reshape(n, root_count * best.shape[2], t)


def _run_newton(equations: Numbers, angles: Complexes) -> NewtonResult:
    """Solve trigonometric equations by Newton's method from several starts.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    angles
        (n, m, t) starts (rad), m for each system. Solutions, and so starts, may be complex.

    Returns
    -------
    The angles after the last step, their residuals, and whether several solutions may
    coincide there. A start need not lead to a solution, so the caller checks the residuals.
    """
    largest_change = np.inf
    for step in range(MAX_ROOT_NEWTON_STEPS + 1):
        values, jacobians = _evaluate(equations, angles)
        determinants = np.abs(np.linalg.det(jacobians))
        if step == MAX_ROOT_NEWTON_STEPS or largest_change < STEP_TOLERANCE_RAD:
            break
        # Where the Jacobian is singular or NaN, no step is possible and the angles stay.
        is_regular = determinants > 0.0
        change = np.zeros_like(angles)
        right_side = -values[is_regular][..., None]
        change[is_regular] = np.linalg.solve(jacobians[is_regular], right_side)[..., 0]
        # Long steps are shortened, so that no angle changes by more than MAX_STEP_RAD. The
        # small number avoids a division by 0.
        length = np.max(np.abs(change), axis=2, initial=0.0, keepdims=True)
        shortening = np.minimum(1.0, MAX_STEP_RAD / np.maximum(length, 1e-300))
        angles = angles + change * shortening
        # `length` is from before the shortening, so a shortened step never ends the loop.
        largest_change = np.nanmax(length, initial=0.0)
    # Near a multiple solution the Jacobian is almost singular: its determinant is small
    # compared with the product of the lengths of its columns (Hadamard's bound).
    bound = np.prod(np.linalg.norm(jacobians, axis=2), axis=2)
    is_flat = determinants < FLAT_JACOBIAN_RATIO * bound
    return NewtonResult(angles, _relative_residual(equations, angles), is_flat)


def _relative_residual(equations: Numbers, angles: Complexes) -> Floats:
    """Return the largest residual of each solution, relative to the size of the factors.

    The caller chooses starts of Newton's method and accepts solutions by this number.

    A term of an equation is a coefficient times one factor (1, cosine or sine) of each
    angle. Coefficients are about 1. Complex angles can have large cosines and sines, which
    cause larger rounding errors. The residual is therefore divided by the product, over all
    angles, of the norm of (1, cosine, sine).

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    angles
        (n, m, t) angles (rad), real or complex.

    Returns
    -------
    (n, m) residuals.
    """
    factor_norms = np.linalg.norm(angle_factors(angles), axis=3)
    size = np.prod(factor_norms, axis=2)
    values, _ = _evaluate(equations, angles)
    return max_abs(values, axis=2) / size


def _are_distinct(angles: Complexes) -> Bools:
    """Return a mask (n,) of the solutions (n, t) that are not copies of earlier ones."""
    roots = np.exp(1j * angles)
    is_same = np.all(np.abs(roots[:, None] / roots - 1.0) < SAME_SOLUTION_RAD, axis=2)
    return ~np.any(np.tril(is_same, -1), axis=1)


def jacobian_determinants(equations: Numbers, angles: Complexes) -> Complexes:
    """Return the determinants of the Jacobians of n systems of equations.

    A Jacobian has the derivatives of the equations with respect to the angles. Its
    determinant is zero where two solutions coincide.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    angles
        (n, m, t) angles (rad), m for each system.

    Returns
    -------
    (n, m) determinants.
    """
    _, jacobians = _evaluate(equations, angles)
    return np.linalg.det(jacobians)


def _evaluate(equations: Numbers, angles: Complexes) -> tuple[Complexes, Complexes]:
    """Return the values of n systems of equations and their derivatives.

    The derivatives are with respect to the angles. An equation is a sum of coefficients,
    each multiplied by one factor (1, cosine or sine) of every angle. Its derivative with
    respect to an angle is the same sum with 0, -sine and cosine in place of the factors of
    that angle.

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle: indices 0, 1 and 2 are the coefficients of 1,
        cosine and sine.
    angles
        (n, m, t) angles (rad), m for each system.

    Returns
    -------
    values
        (n, m, t) left sides of the t equations.
    jacobians
        (n, m, t, t) derivatives; equations in rows, angles in columns.
    """
    factors = angle_factors(angles)  # (n, m, t, 3)
    cosines = factors[..., 1]
    sines = factors[..., 2]
    # A plain zero would hide NaN of unknown angles.
    zeros = 0.0 * angles
    factor_rates = np.stack([zeros, -sines, cosines], axis=-1)  # (n, m, t, 3)

    values = _insert_factors(equations, factors)
    derivatives = []
    for angle in range(angles.shape[2]):
        factors_by_angle = factors.copy()
        factors_by_angle[:, :, angle] = factor_rates[:, :, angle]
        derivatives.append(_insert_factors(equations, factors_by_angle))
    return values, np.stack(derivatives, axis=3)


def _insert_factors(equations: Numbers, factors: Numbers) -> Complexes:
    """Return sums of the coefficients of equations times one factor of every angle.

    The factors of an angle are 1, its cosine and its sine. With these factors the sums are
    the values of the equations. If the factors of one angle are replaced by their
    derivatives, the sums are derivatives of the equations with respect to this angle.

    For two angles this is the sum over x and y of equations[n, k, x, y] factors[n, m, 0, x]
    factors[n, m, 1, y].

    Parameters
    ----------
    equations
        (n, t, 3, ..., 3) coefficients of n systems of t equations in t angles. Each of the
        last t axes belongs to an angle.
    factors
        (n, m, t, 3) factors, or their derivatives, of the t angles of m solutions of each
        system.

    Returns
    -------
    (n, m, t) sums, one for each equation.
    """
    # Each step sums over the axis of one angle. Letters: n system, m solution, k equation,
    # x factor of the angle.
    sums = np.einsum("nkx...,nmx->nmk...", equations, factors[:, :, 0])
    for angle in range(1, factors.shape[2]):
        sums = np.einsum("nmkx...,nmx->nmk...", sums, factors[:, :, angle])
    return sums
