"""All real modes over boxes of the inputs, counted system by system.

The equations fall into systems that are solved one after the other. Suppose that as many
roots of a system are proven as it can have, including complex roots and roots at infinity,
and that each root is proven to be real or not. Then no real root of the system is missing.
The next system is solved for each of them, with their angles as further given variables.
Roots that are proven to be different at the centre of a box of inputs, and regular over the
whole box, never meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import cosines_and_sines
from spherekit.proof.construction import permanent
from spherekit.proof.homotopy import HOMOTOPY_SEEDS, track_homotopy
from spherekit.proof.root_charts import (
    ChartRoots,
    KnownAngleChanges,
    Polynomials,
    RootTubes,
    apply_matrices,
    are_distinct,
    classify_real_roots,
    enclose_roots,
    evaluate_polynomials,
    invert_matrices,
    polish_roots,
    solve_one_unknown,
)
from spherekit.proof.tubes import PRODUCT_ROUNDING

MAX_SQUARED_DISTANCE = 1.0
"""Squared distance of given angles, as points of circles, below which roots are followed.

Larger: roots are followed farther, and some may be lost. Smaller: more homotopies.
"""

MAX_STORED_SOLUTIONS = 128
"""Largest number of sets of given angles for which the roots are remembered.

Larger: a longer search for the nearest roots. Smaller: roots are followed farther.
"""

SAME_ROOT_GAP = 1e-7
"""Gap, in z, below which two approximate roots count as one.

Larger: close roots are lost. Smaller: one root that two paths reached is counted twice.
"""


@np.errstate(all="ignore")
def approximate_modes(
    equations: ArcEquations, circle_points: Floats, seed: int
) -> Complexes:
    """Return approximations of the complex modes at one value of each input.

    Complex modes are all solutions of the loop equations; the real modes are assembly modes
    (ways to assemble the mechanism). A homotopy finds them: it changes random equations
    with known solutions into the equations of the mechanism, and follows the solutions.
    Nothing is proven.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    circle_points
        (given, 2) cosines and sines of the inputs and of angles that wheels determine.
    seed
        Seed of the random numbers.

    Returns
    -------
    (n, unknowns) complex angles (rad). Modes can be missing, and can occur twice.
    """
    # One system with all equations and all unknowns.
    all_numbers = range(equations.unknown_count)
    system = EquationSystem(equations, all_numbers, all_numbers)
    polynomials = system.form_polynomials(circle_points[None])
    # Solutions are e^(i angle). Solutions at 0 and at infinity have no finite angle.
    angles = -1j * np.log(track_homotopy(polynomials, seed).points)
    return angles[np.all(np.isfinite(angles), axis=1)]


@dataclass(frozen=True)
class SystemSolution:
    """All roots of a system of equations at one set of values of its given variables.

    Given variables are inputs, and angles that other systems have determined. Roots at
    other values of the given variables are followed from these roots.

    Attributes
    ----------
    given
        (given,) angles (rad) of the given variables.
    roots
        All roots e^(i angle), including complex roots and roots at infinity.
    """

    given: Floats
    roots: ChartRoots


@dataclass(frozen=True)
class RootAngles:
    """Angles of n roots at the centre of a box of inputs, and their change over the box.

    A root is a solution of a system of closure equations: k unknown angles, which change
    with the inputs. At any inputs in the box, an angle is the one at the centre, plus the
    rates times the changes of the inputs, with at most the given error.

    Only the rows of real roots have meaningful angles. The rows of complex roots remain, so
    that root i is in row i.

    Attributes
    ----------
    angle
        (n, k) angles (rad) at the centre.
    rates
        (n, k, inputs) derivatives with respect to the inputs.
    error
        (n, k) largest deviation (rad) from this linear change, anywhere in the box.
    """

    angle: Floats
    rates: Floats
    error: Floats


@dataclass(frozen=True)
class SystemFindings:
    """Proven properties of the n roots of a system of equations, for several modes.

    The closure equations consist of systems that are solved one after another. A mode is a
    real solution of all earlier systems, over a box of inputs. With its angles inserted,
    this system has several solutions (roots) for each mode.

    Attributes
    ----------
    mode
        (n,) index of the mode to which each root belongs.
    is_complete
        (modes,) whether all roots of this system are proven in a mode: they differ from
        each other, and each is known to be real or not.
    is_real
        (n,) which roots are proven real.
    angles
        The angles of the roots over the box.
    """

    mode: Indices
    is_complete: Bools
    is_real: Bools
    angles: RootAngles


class EquationSystem:
    """A part of the closure equations of a mechanism, solved for some of its unknowns.

    The equations are divided into such systems, which are solved one after another.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    rows
        Indices of the equations of this system.
    unknowns
        Indices of the unknowns of this system. There are as many unknowns as equations.

    Attributes
    ----------
    given
        Indices of all other variables: unknowns of other systems, inputs, and angles that
        wheels determine. Their values are given when the system is solved.
    degrees
        (k, variables) trigonometric degrees, the unknowns first, then the given variables.
    bound
        Upper bound of the number of roots, including complex roots and roots at infinity.
    solved
        Values of the given variables for which all roots are known. Approximate roots for
        other values are followed from the nearest of these.
    """

    def __init__(
        self, equations: ArcEquations, rows: Sequence[int], unknowns: Sequence[int]
    ) -> None:
        """List the given variables, and bound the number of roots.

        The system consists of some equations of the mechanism, solved for as many unknowns.
        All other variables are given: inputs, and unknowns of other systems. Some of these
        may not occur in the equations.

        No root is missing if as many distinct roots are found as the bound permits.

        Parameters
        ----------
        equations
            The loop-closure equations of the mechanism.
        rows
            Indices of the equations of this system.
        unknowns
            Indices of the variables for which it is solved, as many as equations.
        """
        self.equations = equations
        self.rows = rows
        self.unknowns = unknowns
        self.given = [
            variable
            for variable in range(equations.variable_count)
            if variable not in unknowns
        ]
        self.degrees = equations.degrees[np.ix_(rows, [*unknowns, *self.given])]
        # Degree m in an angle is degree 2 m in e^(i angle). For equations with a separate
        # degree in each unknown, Bezout's bound of the number of roots is the permanent of
        # the degrees (equations, unknowns).
        self.bound = permanent(2 * self.degrees[:, : len(unknowns)])
        # Values of the given variables at which all roots are known, with these roots.
        self.solved: list[SystemSolution] = []

    def form_polynomials(self, circle_points: Array) -> Polynomials:
        """Insert given angles into the equations, which leaves polynomials in the unknowns.

        Given angles are inputs, and angles that other systems have determined. An unknown
        angle becomes z = e^(i angle). The largest possible number of roots of polynomials
        is known (Bezout's theorem), so a proof can show that no root is missing.

        Parameters
        ----------
        circle_points
            (m, given, 2) cosines and sines of m sets of given angles. The error bounds are
            valid if each number is an exact cosine or sine, rounded once.

        Returns
        -------
        For each set the coefficients, with error bounds, and their derivatives with respect
        to the given angles. Proofs also need two properties of the equations: their
        trigonometric degrees, and bounds of their derivatives with respect to real angles.
        """
        coefficients = []
        derivatives = []
        # `rows` are the indices of the equations of this system.
        for equation in self.rows:
            polynomial = self.equations.harmonics.insert_given_angles(
                equation, self.unknowns, circle_points
            )
            coefficients.append(polynomial.coefficients)
            derivatives.append(polynomial.coefficient_derivatives)
        return Polynomials(
            coefficients=tuple(coefficients),
            coefficient_derivatives=tuple(derivatives),
            error=self._bound_coefficient_errors(coefficients, derivatives),
            derivative_bound=self.equations.derivative_bound[self.rows],
            degrees=self.degrees,
        )

    def _bound_coefficient_errors(
        self, coefficients: Sequence[Complexes], derivatives: Sequence[Complexes]
    ) -> Floats:
        """Return bounds of the errors of the polynomial coefficients of each equation.

        An equation is stored as a Fourier sum over all angles. Inserting given angles
        leaves a polynomial in the unknowns. Its coefficients have two errors: that of the
        stored sum, and the rounding by the insertion. One bound of each equation holds for
        all its coefficients and their derivatives.

        Parameters
        ----------
        coefficients, derivatives
            For each equation the array of its coefficients, and the array of their
            derivatives with respect to the given angles.

        Returns
        -------
        (equations,) one bound for each equation.
        """
        # Each coefficient is a sum of rounded terms.
        rounding_errors = []
        for equation_coefficients, equation_derivatives in zip(
            coefficients, derivatives, strict=True
        ):
            sums = np.append(equation_coefficients, equation_derivatives)
            rounding_errors.append(_bound_sum_rounding(sums))
        # (equations,) bounds of the errors of the stored Fourier sums.
        stored_errors = self._bound_stored_errors()
        return stored_errors + rounding_errors

    def _bound_stored_errors(self) -> Floats:
        """Return error bounds (equations,) of the stored equations and their derivatives.

        An equation is stored as a sum of waves e^(i d x) of the angles x. The derivative of
        a wave has its error times the degree d. The largest degree gives one bound for an
        equation and its first derivatives.
        """
        largest_degree = np.max(self.degrees, axis=1, initial=1)
        return self.equations.harmonics.error[self.rows] * largest_degree

    def prove_roots(
        self, modes: Array, centres: Floats, circle_points: Floats, half: Floats
    ) -> SystemFindings:
        """Prove the roots of this system over one box of inputs for each mode.

        A mode is a real root of the systems solved before, over its box of inputs. The
        roots of this system are approximated at the centre of the box. Each root is then
        proven to be the only root in a tube, which is a neighbourhood of the linear motion
        of the root over the box. If Newton's method has converged to as many distinct roots
        at the centre as the system can have (`bound`), they are added to `solved`, as
        starts for other boxes.

        Parameters
        ----------
        modes
            (modes,) records with the fields angle, circle_points (cosine and sine), rates
            and error of all unknowns; the values of later systems are 0. See `count_modes`.
        centres
            (modes, inputs) centre (rad) of the box of each mode.
        circle_points
            (modes, inputs, 2) cosines and sines of the exact centres.
        half
            (modes, inputs) half widths (rad) of the boxes.
        """
        # An input has no error, and the derivative 1 with respect to itself.
        no_error = 0.0 * centres
        unit_rates = no_error[..., None] + np.eye(centres.shape[1])

        def select_given(name: str, of_inputs: Array) -> Array:
            """Return a property of all given variables, for each mode.

            Given variables are the unknowns of other systems, and the inputs. `name` is the
            property: the field "angle", "circle_points", "rates" or "error" of `modes`,
            which has values for all unknowns. `of_inputs` has the values of the property
            for the inputs. The result has the modes as first axis, then the variables.
            """
            # In the numbering of all variables the inputs follow the unknowns.
            return np.concatenate([modes[name], of_inputs], axis=1)[:, self.given]

        given = select_given("angle", centres)
        polynomials = self.form_polynomials(select_given("circle_points", circle_points))
        known_angle_changes = KnownAngleChanges(
            input_half_widths=half,
            rates=select_given("rates", unit_rates),
            max_error=select_given("error", no_error),
        )
        if len(self.unknowns) == 1:
            approximations = solve_one_unknown(polynomials)
        else:
            approximations = self._follow_roots(given)
        roots, has_converged = polish_roots(polynomials, approximations)
        tubes = enclose_roots(polynomials, roots, known_angle_changes)
        # If all roots at the centre of a box are known, these roots are starts for other
        # boxes. Each mode has `bound` roots, one after another.
        has_all_roots = are_distinct(roots, tubes.centre_radius, has_converged, self.bound)
        for mode in np.flatnonzero(has_all_roots):
            rows_of_mode = slice(mode * self.bound, (mode + 1) * self.bound)
            self.solved.append(
                SystemSolution(given[mode], roots.select_roots(rows_of_mode))
            )
        del self.solved[:-MAX_STORED_SOLUTIONS]
        is_real, is_not_real = classify_real_roots(
            roots, tubes.centre_radius, tubes.uniqueness_radius
        )
        # The proof needs more: a tube for each root, and a decision whether it is real.
        is_decided = tubes.is_proven & (is_real | is_not_real)
        is_complete = are_distinct(roots, tubes.centre_radius, is_decided, self.bound)
        angles = _bound_root_angles(roots, tubes, half[roots.row])
        return SystemFindings(
            mode=roots.row, is_complete=is_complete, is_real=is_real, angles=angles
        )

    def _follow_roots(self, given: Floats) -> ChartRoots:
        """Return approximations of all roots of this system, which are then to be proven.

        The roots are solutions of the system for its unknowns. They depend on the given
        variables: inputs, and unknowns of other systems. Start values are values of the
        given variables at which all roots are known. The roots are moved by one step along
        the tangent, from the start values to the given ones. Newton's method then improves
        them (`prove_roots`).

        Parameters
        ----------
        given
            (m, given variables) m sets of values (rad) of the given variables.

        Returns
        -------
        For each set as many roots as the system can have (`bound`).
        """
        # Cosines and sines of the stored start values, of which the nearest are chosen.
        solved_points = cosines_and_sines([solution.given for solution in self.solved])
        values_of_starts = []
        points_of_starts = []
        for requested in given:
            # One set of start values (given,), and all roots there as points (bound, k). A
            # point has the complex numbers e^(i angle) of the k unknowns.
            start_values, start_points = self._choose_start(requested, solved_points)
            values_of_starts.append(start_values)
            points_of_starts.append(start_points)
        points = np.concatenate(points_of_starts)
        # For each point the index of its set.
        set_of_point = np.repeat(np.arange(len(given)), self.bound)
        # `ChartRoots` stores numbers above 1 in magnitude as their inverse, so that none is
        # infinite.
        roots = ChartRoots.from_points(points, row=set_of_point)
        return self._step_along_tangent(roots, np.array(values_of_starts), given)

    def _step_along_tangent(
        self, roots: ChartRoots, start_values: Floats, given: Floats
    ) -> ChartRoots:
        """Return roots moved linearly from one set of given values to another.

        The roots solve polynomials with the given variables as parameters. The results are
        approximations, which Newton's method then refines.

        A root has a coordinate z for each unknown angle. z is e^(i angle), which can have
        any magnitude, because the angles of a root can be complex. If the magnitude exceeds
        1, z is the inverse instead.

        Parameters
        ----------
        roots
            n roots at the start values. `roots.row` has the set of values of each root.
        start_values, given
            (m, given) values (rad) of the given variables at the start and at the end.
        """
        polynomials = self.form_polynomials(cosines_and_sines(start_values))
        at_starts = evaluate_polynomials(polynomials, roots)
        # P(z, g) = 0 gives the derivatives of the roots z with respect to the given
        # variables g: -P_z^-1 P_g. If P_z is singular, `invert_matrices` returns NaN. The
        # derivatives are then set to 0, so the root stays where it is.
        rates = np.nan_to_num(-invert_matrices(at_starts.by_unknowns) @ at_starts.by_given)
        steps = wrap(given - start_values)[roots.row]
        return roots.with_points(roots.z + apply_matrices(rates, steps))

    def _choose_start(
        self, requested: Floats, solved_points: Floats
    ) -> tuple[Floats, Complexes]:
        """Return values of the given variables at which all roots are known, and the roots.

        The given variables are the inputs and the angles that other systems of equations
        have determined. A root is one solution of the equations: complex numbers
        e^(i angle) of the k unknown angles. The caller follows the roots from the returned
        values to the requested ones.

        `solved` stores sets of values at which all roots are known. The set nearest to the
        requested values is used. If none is near, a homotopy computes all roots at the
        requested values.

        Parameters
        ----------
        requested
            (given,) requested values (rad) of the given variables.
        solved_points
            (solutions, given, 2) cosines and sines of the values in `solved`.

        Returns
        -------
        values
            (given,) values (rad) of the given variables at which the roots are known.
        roots
            (roots, k) e^(i angle) of the unknowns in all roots. The number of roots is
            `bound`, the largest number of roots that the system of equations can have.
        """
        if len(solved_points):
            # Comparing cosines and sines ignores whole turns of the angles.
            offsets = solved_points - cosines_and_sines(requested)
            squared_distances = np.sum(offsets**2, axis=(1, 2))
            nearest = np.argmin(squared_distances)
            # From farther away, following the roots could fail.
            if squared_distances[nearest] < MAX_SQUARED_DISTANCE:
                solution = self.solved[nearest]
                return solution.given, solution.roots.points
        polynomials = self.form_polynomials(cosines_and_sines(requested)[None])
        return requested, self._solve_by_homotopy(polynomials)

    def _solve_by_homotopy(self, polynomials: Polynomials) -> Complexes:
        """Return all roots of a system, computed by a homotopy without known roots.

        A homotopy follows paths from the roots of random equations to those of the system.
        Sometimes it loses a path. Homotopies with other random numbers are then tried.

        Parameters
        ----------
        polynomials
            The equations of the system, at one set of values of its given variables.

        Returns
        -------
        (bound, k) numbers e^(i angle) of the k unknowns in each root. `bound` is the
            largest number of roots that the system can have. All numbers are zero if no
            homotopy finds so many roots.
        """
        for seed in range(HOMOTOPY_SEEDS):
            approximations = track_homotopy(polynomials, seed)
            roots, has_converged = polish_roots(polynomials, approximations)
            roots = roots.select_roots(has_converged)
            if not len(roots.z):
                continue
            (gaps,) = roots.pairwise_gaps(len(roots.z))
            # Two paths can lead to the same root, which is kept once. A root is left out if
            # its gap to an earlier root (in the lower triangle) is small.
            repeats_another = np.any(np.tril(gaps < SAME_ROOT_GAP, -1), axis=1)
            roots = roots.select_roots(~repeats_another)
            if len(roots.z) == self.bound:
                return roots.points
        return np.zeros((self.bound, len(self.unknowns)), dtype=complex)


def list_systems(equations: ArcEquations) -> list[EquationSystem]:
    """Return the systems of a mechanism in the order in which they are solved."""
    return [
        EquationSystem(equations, rows, unknowns)
        for rows, unknowns in equations.construction.equation_systems
    ]


@np.errstate(all="ignore")
def count_modes(
    systems: Sequence[EquationSystem], centres: Floats, circle_points: Floats, half: Floats
) -> tuple[Bools, Indices]:
    """Return over which boxes of the inputs all modes are proven, and their numbers.

    The systems of equations are solved one after another. A mode of the systems solved so
    far is a real root of all these systems. For each mode, the roots of the next system are
    proven over the box, and its real roots extend the mode. All roots must be proven to be
    different, and each must be proven to be real or not. Otherwise nothing is proven over
    the box.

    Parameters
    ----------
    systems
        The systems of the mechanism in order.
    centres
        (m, inputs) float64 numbers (rad) near the centres of the boxes. Angles that wheels
        determine count as inputs.
    circle_points
        (m, inputs, 2) cosines and sines of the exact centres.
    half
        (m, inputs) half widths (rad).

    Returns
    -------
    is_proven
        (m,) bools.
    mode_counts
        (m,) how many real modes there are, where proven.
    """
    m, inputs = centres.shape
    is_proven = np.ones(m, dtype=bool)
    unknowns = (systems[0].equations.unknown_count,)
    # One row for each real mode of the systems solved so far: the index of the box, then
    # numbers for all unknowns. These are the angle (rad) at the centre of the box, its
    # cosine and sine, its derivatives with respect to the inputs, and its largest deviation
    # (rad) from linear motion. Unknowns of later systems are 0.
    modes = np.zeros(
        m,
        [
            ("box", np.intp),
            ("angle", float, unknowns),
            ("circle_points", float, (*unknowns, 2)),
            ("rates", float, (*unknowns, inputs)),
            ("error", float, unknowns),
        ],
    )
    modes["box"] = np.arange(m)
    for system in systems:
        modes = modes[is_proven[modes["box"]]]
        if not len(modes):
            break
        boxes = modes["box"]
        findings = system.prove_roots(
            modes, centres[boxes], circle_points[boxes], half[boxes]
        )
        is_proven[boxes[~findings.is_complete]] = False
        # Each real root of a proven box extends its mode.
        (real_roots,) = np.nonzero(findings.is_real & is_proven[boxes][findings.mode])
        modes = modes[findings.mode[real_roots]]
        angles = findings.angles
        modes["angle"][:, system.unknowns] = angles.angle[real_roots]
        modes["rates"][:, system.unknowns] = angles.rates[real_roots]
        modes["error"][:, system.unknowns] = angles.error[real_roots]
        modes["circle_points"][:, system.unknowns] = cosines_and_sines(
            angles.angle[real_roots]
        )
    return is_proven, np.bincount(modes["box"], minlength=m)


def _bound_root_angles(
    roots: ChartRoots, tubes: RootTubes, half_widths: Floats
) -> RootAngles:
    """Return the angles of n roots, and how they change over boxes of the inputs.

    A root is a solution of closure equations for k unknown angles. Each real root extends
    an assembly mode (way to assemble the links) by these angles. The equations of the next
    links are then solved with them.

    A root has k coordinates z = e^(i s angle), with the sense s = 1, or s = -1 if the
    inverse is stored. With the derivatives z' of z, the derivatives of the angle with
    respect to the inputs are z' / (i s z).

    The caller uses only real roots. Their exact angles are real, so only the real parts of
    the computed derivatives are returned.

    Parameters
    ----------
    roots
        The approximate roots at the centres of the boxes.
    tubes
        For each root the derivatives z' (`rates`) with respect to the inputs, and how far
        the exact root can be from this linear motion over the box.
    half_widths
        (n, inputs) half widths (rad) of the box of each root.
    """
    sense = np.where(roots.inverse, -1, 1)
    # (n, k, 1) derivatives of z with respect to its own angle.
    slopes_of_z = (1j * sense * roots.z)[:, :, np.newaxis]
    complex_rates = tubes.rates / slopes_of_z
    return RootAngles(
        angle=sense * np.angle(roots.z),
        rates=complex_rates.real,
        error=_bound_angle_deviation(roots, tubes, complex_rates, half_widths),
    )


def _bound_angle_deviation(
    roots: ChartRoots, tubes: RootTubes, rates: Complexes, half_widths: Floats
) -> Floats:
    """Return how far the angles of roots may be from linear motion over boxes of inputs.

    A root is a solution for k unknown angles. Its coordinate z of an angle is e^(i angle)
    or e^(-i angle), so the angle is, up to its sign, the imaginary part of log z. Let z0 be
    the approximate root at the centre of the box, and w = (z - z0) / z0 the relative
    change. Then

        log z = log z0 + w + remainder,
        z - z0 = linear motion + deviation,   where |deviation| <= tube radius.

    So the angle deviates from linear motion by at most (tube radius) / ``|z0|``, plus the
    remainder. The tube radius includes the error of z0.

    Two margins are added for rounding. A third one, the difference of ``|z0|`` from 1, only
    makes the bound larger. The bound is valid without it.

    Parameters
    ----------
    roots
        The approximate roots z0, at the centres of the boxes.
    tubes
        For each root the linear motion of z over the box. `tube_radius` (n,) bounds how far
        the exact root can be from this motion. `displacement` (n, k) bounds ``|z - z0|``.
    rates
        (n, k, inputs) derivatives of the k angles with respect to the inputs, computed as
        complex numbers.
    half_widths
        (n, inputs) half widths (rad) of the box of each root.

    Returns
    -------
    (n, k) bounds (rad). Infinite if z changes by half of its magnitude or more.
    """
    magnitude = np.abs(roots.z)
    tube_deviation = tubes.tube_radius[:, np.newaxis] / magnitude
    relative_change = tubes.displacement / magnitude
    logarithm_remainder = _bound_logarithm_remainder(relative_change)
    # The third margin. The exact z of a real root has the magnitude 1, so a difference of
    # |z0| from 1 is an error of z0. The tube radius already covers this error.
    magnitude_error = np.abs(magnitude - 1.0)
    # These allowances are far larger than the rounding errors (relative error 1.1e-16,
    # angles below pi). The factor 1.05 covers the rounding of the first two terms.
    motion_rounding = 1e-15 * apply_matrices(np.abs(rates), half_widths)
    angle_rounding = 1e-13
    bound = (
        1.05 * (logarithm_remainder + tube_deviation)
        + magnitude_error
        + motion_rounding
        + angle_rounding
    )
    # For larger changes the bound of the remainder is not valid.
    return np.where(relative_change < 0.5, bound, np.inf)


def _bound_logarithm_remainder(relative_change: Floats) -> Floats:
    """Return a bound of the difference of log(1 + w) and w.

    The bound is valid for complex w of a magnitude up to `relative_change` c < 1. The
    series w - w^2/2 + w^3/3 - ... gives the bound c^2 / 2 / (1 - c).
    """
    return 0.5 * relative_change**2 / (1.0 - relative_change)


def _bound_sum_rounding(sums: Complexes) -> float:
    """Return a bound of the rounding error of coefficients that were computed as sums.

    An equation is the cosine of an arc as a function of the angles, less the constant
    cosine of the arc in the link. Rounding is relative to these two terms, which are larger
    than their sum if they cancel. The constant is at most 1 in magnitude. So the cosine
    term is at most 1 plus the sum.
    """
    largest_sum = float(np.max(np.abs(sums), initial=0.0))
    largest_term = 1.0 + largest_sum
    return PRODUCT_ROUNDING * largest_term
