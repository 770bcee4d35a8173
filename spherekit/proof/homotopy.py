"""Approximations of all solutions of a system of equations, by a homotopy.

Nothing is proven in this module. Other modules prove that there is a solution near each
approximation, and compare the number of solutions with the largest possible one.

The homotopy leads from a start system at t = 0 to the equations of the mechanism at t = 1.
The start equations are products of linear factors and have the degrees of the mechanism's
equations. They have exactly this largest possible number of solutions, and all of them are
known (A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8). For almost all random numbers no path passes a singular system.
"""

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
"""Largest number of steps, accepted or not, of all paths.

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
    """The equations of a homotopy, and the solutions at its start.

    Attributes
    ----------
    ends
        Coefficients of each equation, as a polynomial in z = e^(i angle) of its unknowns:
        (1, 2, d_1 + 1, d_2 + 1, ...). The first axis has the length 1, because functions
        that evaluate polynomials take systems at several inputs, and there is one here. The
        second axis has the start system at t = 0 and the system to be solved at t = 1. Then
        there is one axis for each unknown, from the power 0 to its degree d.
    solutions
        (n, k) e^(i angle) of all solutions at t = 0.
    """

    ends: list[Complexes]
    solutions: Complexes


@dataclass(frozen=True)
class HomotopyValues:
    """The equations of a homotopy H(z, t) and their derivatives at points.

    A homotopy is a family of equations H(z, t) = 0. It leads from equations with known
    solutions at t = 0 to those that are to be solved at t = 1.

    Attributes
    ----------
    values
        (n, k) H.
    by_unknowns
        (n, k, k) derivatives by z.
    by_t
        (n, k) derivatives by t.
    """

    values: Complexes
    by_unknowns: Complexes
    by_t: Complexes


@np.errstate(all="ignore")
def track_homotopy(polynomials: Polynomials, seed: int) -> ChartRoots:
    """Return approximations of the solutions of a system, infinite ones too.

    A homotopy H(z, t) is a family of systems that leads from random equations with known
    solutions at t = 0 to the given system at t = 1. From each known solution a path of
    points with H = 0 is followed. Each step along the path is predicted from its
    derivative, then corrected by Newton's method. Steps that fail are halved.

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
    ends = start_system.ends
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
            at_points = _evaluate_homotopy(ends, predicted, predicted_t)
            rate = apply_matrices(invert_matrices(at_points.by_unknowns), at_points.by_t)
            predicted_t = t[moving] + part * length
            predicted = replace(start, z=start.z - part * length[:, None] * rate)
        # 2. Correct by Newton's method at the end of the step.
        magnitude = 1.0 + np.max(np.abs(predicted.z), axis=1)
        corrections = []
        for _ in range(3):
            at_points = _evaluate_homotopy(ends, predicted, predicted_t)
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
    """Return a homotopy from products of linear factors to a system.

    Each start equation is a product of linear factors (z - root) with random roots. For
    each unknown z there are as many factors as the degree of the system's equation in this
    unknown. All solutions of the start equations are known.

    Parameters
    ----------
    polynomials
        The system at one set of values of its given variables (inputs, and unknowns that
        were solved for before). The coefficients of an equation in two unknowns are an
        array whose entry (0, i, j) belongs to the powers i and j of the unknowns.
    generator
        Random numbers for the roots of the linear factors.
    """

    def draw_roots(degree: int) -> Complexes:
        """Return the random complex roots (degree,) of the factors of one unknown."""
        real_and_imaginary = generator.normal(size=(2, degree))
        return np.asarray(real_and_imaginary.T @ (1.0, 1j))

    # For each equation and unknown the roots of its factors. An axis of the coefficients
    # has the powers from 0 to the degree.
    factor_roots = [
        [draw_roots(degree=size - 1) for size in array.shape[1:]]
        for array in polynomials.coefficients
    ]
    ends: list[Complexes] = []
    for roots, goal in zip(factor_roots, polynomials.coefficients, strict=True):
        # Coefficients of the product of the factors of each unknown, the power 0 first.
        factors = [np.atleast_1d(np.poly(values))[::-1] for values in roots]
        # A random phase of the start equations avoids singular systems on the paths.
        phase = np.exp(2j * np.pi * generator.random())
        start = reduce(np.multiply.outer, factors) * phase
        # Both ends get coefficients of the same size. `start` has no axis for the set of
        # given values yet.
        scale = np.linalg.norm(start) / np.linalg.norm(goal)
        ends.append(np.stack([start[None], scale * goal], axis=1))
    # In a solution one factor of each equation vanishes. It determines one unknown, so the
    # factors of two equations must be of different unknowns. The permutation `order` says
    # which: in equation i it is a factor of the unknown order[i].
    solutions = []
    for order in permutations(range(len(factor_roots))):
        roots_of_equations = [
            roots[unknown] for roots, unknown in zip(factor_roots, order, strict=True)
        ]
        for values in product(*roots_of_equations):
            # `values` are in the order of the equations; sort them by unknowns.
            solutions.append(np.array(values)[np.argsort(order)])
    points = np.array(solutions, dtype=complex).reshape(-1, len(factor_roots))
    return HomotopyStart(ends, points)


def _evaluate_homotopy(
    ends: list[Complexes], points: ChartRoots, t: Floats
) -> HomotopyValues:
    """Return the equations of a homotopy and their derivatives at points.

    The equations H(z, t) = (1 - t) start(z) + t goal(z) lead from the start system at t = 0
    to the system that is to be solved at t = 1.

    Parameters
    ----------
    ends
        Coefficients of each equation, as a polynomial in z = e^(i angle) of its unknowns:
        (1, 2, d_1 + 1, d_2 + 1, ...). The first axis has the length 1, because functions
        that evaluate polynomials take systems at several inputs, and there is one here. The
        second axis has the start system at t = 0 and the system to be solved at t = 1. Then
        there is one axis for each unknown, from the power 0 to its degree d.
    points
        n points. Each coordinate is z = e^(i angle) of an unknown, or 1 / z if z is large,
        so that infinite solutions have finite coordinates.
    t
        (n,) the parameter of each point.
    """
    # Derivatives of order 0 are the values (n, k, 2) of both systems, those of order 1 are
    # (n, k, k, 2) derivatives by z. The last axis is the second axis of the coefficients:
    # the systems at t = 0 and at t = 1.
    end_values = points.derivatives(ends, 0)
    end_slopes = points.derivatives(ends, 1)
    # n: point, k: equation, l: unknown, e: system.
    weights = np.stack([1.0 - t, t], axis=1)
    return HomotopyValues(
        values=apply_matrices(end_values, weights),
        by_unknowns=np.einsum("nkle,ne->nkl", end_slopes, weights),
        by_t=end_values[..., 1] - end_values[..., 0],
    )
