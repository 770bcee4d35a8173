"""Approximations of all solutions of a system of equations, by a homotopy.

Nothing is proven in this module. Other modules prove that there is a solution near each
approximation, and compare the number of solutions with the largest possible one.

The homotopy leads from a start system at t = 0 to the equations of the mechanism at t = 1.
The start equations are products of linear factors and have the degrees of the mechanism's
equations. They have exactly this largest possible number of solutions, and all of them are
known (A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8). For almost all random numbers no path passes a singular system.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import permutations, product

import numpy as np

from spherekit.arrays import Complexes, Floats
from spherekit.proof.root_charts import (
    ChartRoots,
    Polynomials,
    apply_matrices,
    invert_matrices,
)

MAX_HOMOTOPY_STEPS = 600
"""Largest number of steps, accepted or not, of each path.

Larger: paths that pass near singular systems arrive. Smaller: they are lost sooner.
"""

FIRST_HOMOTOPY_STEP = 0.02
"""First step of each path in t.

Larger: it fails on more paths and is repeated. Smaller: more steps at the start.
"""

MIN_HOMOTOPY_STEP = 1e-7
"""Step in t below which a path is given up.

Larger: paths near singular systems are lost. Smaller: more time is spent on them.
"""

MAX_HOMOTOPY_STEP = 0.1
"""Largest step of a path in t.

Larger: fewer steps, but paths may jump to neighbours. Smaller: more steps.
"""

HOMOTOPY_STEP_GROWTH = 1.2
"""Length of the step after an accepted step, divided by the length of the accepted one.

Larger: more steps fail because they are too long. Smaller: more steps.
"""

MAX_PREDICTION_ERROR = 3e-3
"""Largest first correction of a predicted point, over 1 + its magnitude.

The root of a neighbouring path is farther away. Larger: paths may jump to neighbours.
Smaller: shorter steps.
"""

MAX_LAST_CORRECTION = 1e-8
"""Largest last correction of a predicted point, over 1 + its magnitude.

Larger: points beside their path are accepted. Smaller: more steps are repeated.
"""

USEFUL_PROGRESS = 0.9
"""Value of t from which on a path that stops is still returned.

Newton's method with more digits continues from there. Larger: nearly double solutions are
lost. Smaller: more approximations that lead nowhere.
"""

HOMOTOPY_SEEDS = 4
"""Number of homotopies with different random numbers.

Of four, one nearly always loses no path. Larger: fewer roots are missed, in more time.
Smaller: more roots are missed.
"""


@dataclass(frozen=True)
class HomotopyStart:
    """The equations of a homotopy, and their solutions at its start.

    A homotopy is a family of equations with a parameter t. At t = 0 it is a start system
    with known solutions, at t = 1 the system to be solved, the goal. The solutions are
    followed from 0 to 1.

    Attributes
    ----------
    start_and_goal
        For each equation the coefficients of polynomials in z = e^(i angle) of the
        unknowns: an array (1, 2, d_1 + 1, d_2 + 1, ...). The first axis is required by
        `ChartRoots.evaluate`, which can take several sets of coefficients. Here there is
        one set. The second axis has the start system and the goal. Each unknown then has an
        axis of powers from 0 to its degree d.
    solutions
        (n, k) values of z for the k unknowns in all n solutions at t = 0.
    """

    start_and_goal: list[Complexes]
    solutions: Complexes


@dataclass(frozen=True)
class HomotopyValues:
    """The equations of a homotopy H(z, t) = 0 and their derivatives, at n points.

    At t = 0 the equations have known solutions, at t = 1 they are to be solved. The
    derivatives are used to follow the solutions.

    Attributes
    ----------
    values
        (n, k) values of H, for k equations.
    by_unknowns
        (n, k, k) derivatives with respect to the k unknowns z.
    by_t
        (n, k) derivatives with respect to t.
    """

    values: Complexes
    by_unknowns: Complexes
    by_t: Complexes


@np.errstate(all="ignore")
def track_homotopy(polynomials: Polynomials, seed: int) -> ChartRoots:
    """Return approximations of the solutions of a system, including solutions at infinity.

    A homotopy H(z, t) is a family of systems that leads from random equations with known
    solutions at t = 0 to the given system at t = 1. From each known solution a path of
    points with H = 0 is followed. Each step is predicted from the derivative of the path,
    then corrected by Newton's method. Steps that fail are halved.

    Parameters
    ----------
    polynomials
        The system as polynomials in z = e^(i angle) of its unknowns, at one set of values
        of its given variables.
    seed
        Seed of the random start system.

    Returns
    -------
    The ends of all paths that came near t = 1. Some solutions may be missing.
    """
    # For each path: its points, its t, and the step that is tried next.
    start_system = _make_start_system(polynomials, np.random.default_rng(seed))
    start_and_goal = start_system.start_and_goal
    path_count = len(start_system.solutions)
    rows = np.zeros(path_count, dtype=np.intp)
    # Each unknown is stored as z or 1 / z, the one of magnitude 1 at most (`inverse`).
    paths = ChartRoots.from_points(start_system.solutions, rows)
    t = np.zeros(path_count)
    step = np.full(path_count, FIRST_HOMOTOPY_STEP)
    for _ in range(MAX_HOMOTOPY_STEPS):
        moving = np.flatnonzero((t < 1.0) & (step >= MIN_HOMOTOPY_STEP))
        if not len(moving):
            break

        # 1. Predict by the midpoint rule: the derivative dz/dt = -H_z^-1 H_t at half the
        # step gives the end.
        start = paths.select_roots(moving)
        length = np.minimum(step[moving], 1.0 - t[moving])
        predicted_t = t[moving]
        predicted = start
        for part in (0.5, 1.0):
            at_points = _evaluate_homotopy(start_and_goal, predicted, predicted_t)
            rate = apply_matrices(invert_matrices(at_points.by_unknowns), at_points.by_t)
            predicted_t = t[moving] + part * length
            predicted = replace(start, z=start.z - part * length[:, None] * rate)
        # 2. Correct by Newton's method at the end of the step.
        magnitude = 1.0 + np.max(np.abs(predicted.z), axis=1)
        corrections = []
        for _ in range(3):
            at_points = _evaluate_homotopy(start_and_goal, predicted, predicted_t)
            change = apply_matrices(
                invert_matrices(at_points.by_unknowns), at_points.values
            )
            predicted = replace(predicted, z=predicted.z - change)
            largest_change = np.nan_to_num(np.max(np.abs(change), axis=1), nan=np.inf)
            corrections.append(largest_change / magnitude)
        is_good = (corrections[0] < MAX_PREDICTION_ERROR) & (
            corrections[-1] < MAX_LAST_CORRECTION
        )

        # 3. Accept or reject the steps. Points that have become large change to 1 / z.
        accepted = moving[is_good]
        rejected = moving[~is_good]
        advanced = predicted.select_roots(is_good).with_points(predicted.z[is_good])
        paths.z[accepted] = advanced.z
        paths.inverse[accepted] = advanced.inverse
        t[accepted] = predicted_t[is_good]
        step[accepted] = np.minimum(
            HOMOTOPY_STEP_GROWTH * step[accepted], MAX_HOMOTOPY_STEP
        )
        step[rejected] = 0.5 * length[~is_good]
    # A path that stops shortly before t = 1 leads to a double solution, or nearly.
    is_finite = np.all(np.isfinite(paths.z), axis=1)
    return paths.select_roots((t > USEFUL_PROGRESS) & is_finite)


def _make_start_system(
    polynomials: Polynomials, generator: np.random.Generator
) -> HomotopyStart:
    """Return a homotopy from products of linear factors to a system of equations.

    The homotopy changes start equations with known solutions continuously into the system.
    A start equation is a product of factors (z - root) with random roots. For each unknown
    z it has as many factors as the degree of the system's equation in z. So both have the
    same largest number of solutions.

    Parameters
    ----------
    polynomials
        The system to be solved, at one set of its given variables. An equation in two
        unknowns has an array of coefficients with the indices (0, power of the first, power
        of the second).
    generator
        Generator of random numbers for the roots of the linear factors.
    """
    factor_roots = _draw_factor_roots(polynomials, generator)
    start_and_goal: list[Complexes] = []
    for roots, goal in zip(factor_roots, polynomials.coefficients, strict=True):
        # A random complex factor avoids singular systems between start and goal.
        phase = np.exp(2j * np.pi * generator.random())
        start = _expand_factors(roots) * phase
        # Start and goal get coefficients of the same norm.
        scale = np.linalg.norm(start) / np.linalg.norm(goal)
        # The first axis of `goal` has length 1, for one set of given values. `start` gets
        # such an axis.
        start_and_goal.append(np.stack([start[None], scale * goal], axis=1))
    return HomotopyStart(start_and_goal, _list_start_solutions(factor_roots))


def _draw_factor_roots(
    polynomials: Polynomials, generator: np.random.Generator
) -> list[list[Complexes]]:
    """Return random complex roots of the linear factors of each start equation.

    A start equation of a homotopy is a product of factors (z - root), with known solutions.
    The result has, for each equation and each unknown z, an array of roots. The number of
    roots is the degree of the given equation in z.
    """
    factor_roots = []
    for coefficients in polynomials.coefficients:
        # The first axis numbers sets of coefficients; here there is one set. Each other
        # axis has the powers of one unknown, from 0 to its degree.
        roots_of_unknowns = []
        for power_count in coefficients.shape[1:]:
            degree = power_count - 1
            real_and_imaginary = generator.normal(size=(2, degree))
            roots_of_unknowns.append(np.asarray(real_and_imaginary.T @ (1.0, 1j)))
        factor_roots.append(roots_of_unknowns)
    return factor_roots


def _expand_factors(roots_of_unknowns: Sequence[Complexes]) -> Complexes:
    """Return the coefficients of a product of linear factors (z - root).

    The product is an equation of the start system, for which the solutions are known.
    `roots_of_unknowns` has the roots of the factors of each unknown z. The coefficients
    (d_1 + 1, d_2 + 1, ...) have an axis for each unknown, from the power 0 to the degree d.
    """
    # The polynomial of each unknown. `np.poly` returns the coefficient 1.0 if there is no
    # root, otherwise all coefficients with the highest power first.
    polynomials = [np.atleast_1d(np.poly(roots))[::-1] for roots in roots_of_unknowns]
    return reduce(np.multiply.outer, polynomials)


def _list_start_solutions(factor_roots: Sequence[Sequence[Complexes]]) -> Complexes:
    """Return all solutions (n, k) of k equations that are products of linear factors.

    A homotopy starts from these known solutions. In a solution, one factor (z - root) of
    each equation is zero and determines the unknown z. So each equation must determine a
    different unknown.

    `factor_roots` has the roots by equation, then by unknown.
    """
    unknown_count = len(factor_roots)
    solutions = []
    # All ways to assign an unknown to each equation.
    for unknown_by_equation in permutations(range(unknown_count)):
        possible_roots = [
            roots_of_unknowns[unknown]
            for roots_of_unknowns, unknown in zip(
                factor_roots, unknown_by_equation, strict=True
            )
        ]
        for roots_by_equation in product(*possible_roots):
            solution = np.empty(unknown_count, dtype=complex)
            solution[list(unknown_by_equation)] = roots_by_equation
            solutions.append(solution)
    return np.array(solutions, dtype=complex).reshape(-1, unknown_count)


def _evaluate_homotopy(
    start_and_goal: list[Complexes], points: ChartRoots, t: Floats
) -> HomotopyValues:
    """Return the equations of a homotopy and their derivatives at n points.

    The equations H(z, t) = (1 - t) start(z) + t goal(z) change from a start system with
    known solutions (t = 0) to the system that is to be solved, the goal (t = 1).

    Parameters
    ----------
    start_and_goal
        For each equation the coefficients of polynomials in z = e^(i angle) of the
        unknowns: an array (1, 2, d_1 + 1, d_2 + 1, ...). The first axis is required by
        `ChartRoots.evaluate`, which can take several sets of coefficients. Here there is
        one set. The second axis has the start system and the goal. Each unknown then has an
        axis of powers from 0 to its degree d.
    points
        The n points. A coordinate is z of an unknown, or 1 / z if z is large, so that it is
        always finite. Derivatives are with respect to this coordinate.
    t
        (n,) the parameter t of each point.
    """
    # (n, k, 2) values of the k equations, and (n, k, k, 2) their derivatives with respect
    # to the k coordinates. Last axis: start system, goal.
    values_of_systems = points.evaluate(start_and_goal)
    slopes_of_systems = points.first_derivatives(start_and_goal)
    start_values = values_of_systems[..., 0]
    goal_values = values_of_systems[..., 1]
    weights = np.stack([1.0 - t, t], axis=1)
    return HomotopyValues(
        # Weighted sums over the two systems.
        values=apply_matrices(values_of_systems, weights),
        # Letters: n point, k equation, l unknown, e system.
        by_unknowns=np.einsum("nkle,ne->nkl", slopes_of_systems, weights),
        by_t=goal_values - start_values,
    )
