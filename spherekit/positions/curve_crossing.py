"""Configurations in which configuration curves cross: the closure equations lose rank.

At a crossing x the velocity equations J(x) v = 0 have k > 1 independent solutions, the
columns of T. Every left null vector l of J satisfies l J = 0. The crossing is the solution
of

    F(x) = 0    and    l J(x) T = 0    for every l,

where F is the closure residual. These equations are regular unless the second-order terms
below are degenerate. A motion x' = T y is possible to second order if

    y . B y = 0    with    B = T^T (l dJ/dx) T    for every l.

For k = 2 the solutions are the directions of no or two curves, for k = 3 of up to four.
Keller (1977) calls these the algebraic bifurcation equations.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.positions.curve_segment import bordered_step
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, newton
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS

MAX_NULL_RATIO = 3e-3
"""Singular values of J below this part of the largest can be zero at a crossing nearby.

Larger: more numbers of curves are tried at each configuration. Smaller: a crossing is
missed if the search starts farther from it.
"""
MAX_CROSSING_STEPS = 20
"""Largest number of Newton steps to a crossing, a direction, or an outgoing curve."""
MAX_CROSSING_DISTANCE_RAD = 0.05
"""Largest difference of a variable at the crossing from that at the start of the search."""
CROSSING_TOLERANCE = 1e-9
"""Largest closure residual (rad) of a crossing, and largest of its zero singular values.

Larger: near misses, where two curves pass each other, count as crossings. Smaller:
rounding hides crossings.
"""
MAX_LAST_CORRECTION_RAD = 1e-6
"""A crossing is accepted if the last step of Newton's method is smaller.

Larger: inaccurate crossings are returned. Smaller: crossings of higher order are missed.
"""
MIN_SECOND_ORDER = 1e-7
"""Second-order terms that are smaller do not decide how many curves cross."""
DIRECTION_TOLERANCE = 1e-7
"""A unit vector satisfies the quadratic equations if their residuals are smaller.

Two directions are the same if one minus the cosine of their angle is smaller.
"""
MAX_INVERSE_NORM = 1e3
"""If the inverse of a direction's equations has a larger norm, directions may coincide."""
RADIUS_RAD = 0.02
"""Distance of the configurations on outgoing curves from the one that they leave."""
MOTION_RATIO = 1e-4
"""Singular values of J below this part of the largest belong to independent motions."""
START_COUNT = 64
"""Number of start vectors on the sphere from which directions are searched."""
START_SEED = 20240616
"""Seed of the start vectors, which are the same in every run."""
DEPENDENT_EQUATION_RATIO = 1e-12
"""Singular values of the equations below this part of the largest count as zero."""
ROUNDED_STEP_RAD = 1e-11
"""A smaller step to a crossing is caused by rounding if it no longer shrinks."""
MIN_STEP_DECREASE = 0.25
"""A step shrinks if it is smaller than this part of the step before."""
SAME_POINT_RATIO = 1e-6
"""Points nearer to each other than this part of the radius are one point."""


class Crossing(NamedTuple):
    """A configuration in which several configuration curves cross.

    At a crossing the closure equations lose rank: their Jacobian allows several independent
    motions.

    Attributes
    ----------
    values
        (variables,) the configuration (rad).
    freedoms
        Number of independent motions: the number of variables minus the rank of the
        velocity equations.
    tangents
        (curves, variables) unit tangent of each curve through the crossing, in one of its
        two directions. Complex solutions of the second-order equations are left out.
    resolved
        Whether the number of curves was found from second-order terms. If not, `tangents`
        is empty.
    miss
        How far the configuration is from an exact crossing (rad). At an exact crossing the
        loops are closed: the closure residual is zero. The closure Jacobian has lost rank:
        all its singular values beyond the rank are zero. `miss` is the largest of these
        numbers, in absolute value.
    error
        Size (rad) of the last step of Newton's method that found `values`.
    """

    values: Floats
    freedoms: int
    tangents: Floats
    resolved: bool
    miss: float
    error: float


def find_crossing(closure: Closure, values: Floats) -> Crossing | None:
    """Return the crossing near a configuration (variables,), None if there is none.

    Callers have a configuration near a supposed crossing, for example the last one before a
    curve ends. At a crossing, several curves of configurations meet. The closure Jacobian
    (derivatives of the loop equations by the pair variables) has a lower rank there. The
    loops therefore allow several independent motions. The largest possible number of
    motions is tried first.
    """
    # Singular values that are small near the crossing can be zero at it, and do not count.
    _, singular_values, _ = np.linalg.svd(closure.linearise(values[None]).jacobian[0])
    rank = int(np.sum(singular_values > MAX_NULL_RATIO * singular_values[0]))
    # Two motions are tried in any case: the rank near a crossing may still be full.
    most_motions = max(2, len(values) - rank)
    for motion_count in range(most_motions, 1, -1):
        crossing = _solve_crossing(closure, values, motion_count)
        if crossing is not None:
            return crossing
    return None


def find_outgoing_points(closure: Closure, values: Floats) -> Floats:
    """Return points on all curves of configurations that leave a given configuration.

    From these points the curves can be followed. The points are searched at a fixed
    distance from the configuration, by Newton's method from `START_COUNT` start points that
    are spread over a sphere. A curve to which no start point leads is missed.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism.
    values
        (variables,) the configuration (rad). If one curve passes through it, there are two
        outgoing points, one on each side.

    Returns
    -------
    (n, variables) configurations (rad), `RADIUS_RAD` away in the space of the variables.
    """
    _, singular_values, right_vectors = np.linalg.svd(
        closure.linearise(values[None]).jacobian[0]
    )
    # Singular values below `MOTION_RATIO` times the scale count as zero. The scale is the
    # largest singular value, but at least `MOTION_RATIO`. So a Jacobian with only tiny
    # singular values counts as zero.
    scale = max(singular_values[0], MOTION_RATIO)
    rank = int(np.sum(singular_values >= MOTION_RATIO * scale))
    # Motions that keep the loops closed to first order. The curves are searched on a small
    # sphere in the space of these motions.
    motions = right_vectors[rank:]
    if not len(motions):
        return motions

    def step_to_sphere(points: Floats, _: Indices) -> Floats:
        """Return Newton steps that close the loops at a fixed distance from `values`.

        The distance is an additional equation. Linearised, it says: the component of the
        step along the direction from `values` is the radius minus the present distance.
        """
        offsets = points - values
        distances = np.linalg.norm(offsets, axis=1)
        directions = offsets / distances[:, None]
        steps = bordered_step(closure.linearise(points), directions, RADIUS_RAD - distances)
        return np.nan_to_num(steps)

    points = values + RADIUS_RAD * _spread_unit_vectors(len(motions)) @ motions
    points, _ = newton(
        step_to_sphere, points, MAX_CROSSING_STEPS, longest_step=0.5 * RADIUS_RAD
    )
    # Keep the points at which the loops are closed and the distance is right.
    distances = np.linalg.norm(points - values, axis=1)
    is_solution = closure.linearise(points).closure_residual < CLOSURE_TOLERANCE
    is_solution &= np.abs(distances - RADIUS_RAD) < SAME_POINT_RATIO * RADIUS_RAD
    # Several start points can lead to the same point, which is kept once.
    distinct: list[Floats] = []
    for point in points[is_solution]:
        if all(
            max_abs(point - known_point) > SAME_POINT_RATIO * RADIUS_RAD
            for known_point in distinct
        ):
            distinct.append(point)
    return np.array(distinct).reshape(-1, len(values))


def _spread_unit_vectors(count: int) -> Floats:
    """Return unit vectors (n, count) spread over the sphere, the same in every call."""
    random = np.random.default_rng(START_SEED)
    return unit_rows(random.normal(size=(START_COUNT, count)))


def _solve_crossing(closure: Closure, start: Floats, freedoms: int) -> Crossing | None:
    """Solve the equations of a crossing with the Gauss-Newton method.

    At a crossing, several curves of configurations meet. The closure residual F(x) (by how
    much the loops are open) is zero there. Some singular values of its Jacobian J are zero
    too, which is written as l J(x) T = 0. T has the k independent motions (right singular
    vectors) as columns, and l is any left singular vector of these zero values.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism.
    start
        (variables,) configuration (rad) near the crossing.
    freedoms
        Number k of independent motions at the crossing.

    Returns
    -------
    The crossing, None if the method does not converge to one nearby.
    """
    x = start.copy()
    rank = len(start) - freedoms  # of J at the crossing
    error = np.inf  # size (rad) of the last step
    has_converged = False
    for iteration in range(MAX_CROSSING_STEPS + 1):
        linearisation = closure.linearise(x[None])
        jacobian = linearisation.jacobian[0]
        residual = linearisation.residual[0]
        left_vectors, singular_values, right_vectors = np.linalg.svd(jacobian)
        left_null_vectors = left_vectors[:, rank:]
        motions = right_vectors[rank:]
        # Derivatives (l, k, b) of l J T with respect to x. In the sum, b is the variable of
        # the derivative, m an equation, l a left null vector, k a motion and a its
        # variable.
        rates = compute_jacobian_rates(closure, x)
        bends = np.einsum("bma,ml,ka->lkb", rates, left_null_vectors, motions)
        if has_converged or iteration == MAX_CROSSING_STEPS:
            break
        # Rows: the equations F = 0, then l J T = 0. These are more equations than
        # variables, so the step is a least-squares solution.
        matrix = np.concatenate([jacobian, bends.reshape(-1, len(x))])
        right_side = np.append(residual, left_null_vectors.T @ jacobian @ motions.T)
        step, *_ = np.linalg.lstsq(matrix, -right_side, rcond=DEPENDENT_EQUATION_RATIO)
        previous_error = error
        error = float(max_abs(step))
        x = x + step
        if not all_finite(x) or max_abs(x - start) > MAX_CROSSING_DISTANCE_RAD:
            return None
        # Steps that no longer become smaller are caused by rounding.
        is_rounding = (
            error < ROUNDED_STEP_RAD and error > MIN_STEP_DECREASE * previous_error
        )
        has_converged = error < 4.0 * EPS or is_rounding
    miss = float(max_abs(np.append(residual, singular_values[rank:])))
    if miss > CROSSING_TOLERANCE or error > MAX_LAST_CORRECTION_RAD:
        return None
    # The second-order terms decide in which directions real curves leave the crossing: the
    # quadratic forms T^T (l dJ/dx) T, one for each l, made symmetric.
    forms = bends @ motions.T
    directions = _find_directions(0.5 * (forms + np.swapaxes(forms, 1, 2)))
    is_resolved = directions is not None
    tangents = np.zeros((0, len(x))) if directions is None else directions @ motions
    return Crossing(
        values=x,
        freedoms=freedoms,
        tangents=tangents,
        resolved=is_resolved,
        miss=miss,
        error=error,
    )


def compute_jacobian_rates(closure: Closure, values: Floats) -> Floats:
    """Return the derivatives dJ/dx of the closure Jacobian J at variables x.

    These second derivatives of the closure equations decide how curves leave a crossing.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism.
    values
        (variables,) the configuration x (rad).

    Returns
    -------
    (variables, equations, variables) derivatives, with three equations for each loop. The
    first axis is the variable of the derivative.
    """
    # The derivative with respect to one variable is the rate of J if this variable has the
    # rate 1 and all others are at rest. The loops open in this motion. There is one such
    # motion, and one row of the linearisation, for each variable.
    count = len(values)
    linearisation = closure.linearise(np.tile(values, (count, 1)))
    # Each column of J consists of the velocity vector of one variable: the relative angular
    # velocity in its pair per unit rate. For an R pair this vector is the axis. The rate of
    # the vector follows from the angular velocities of both bodies of the pair.
    #
    # Bodies are placed along a tree of pairs, and `body_rates` gives the angular velocities
    # of these bodies. A pair outside the tree closes each loop. While a loop opens, there
    # are two copies of the second body of this pair: one placed by the tree, and one
    # carried by the pair. J describes the copy carried by the pair. The angular velocity of
    # this copy follows from the first body and the pair.
    first_rates = linearisation.body_rates(np.eye(count))[:, closure.tree.first_bodies]
    second_rates = _rates_of_second_bodies(linearisation, first_rates)
    vector_rates = linearisation.vector_rates_of_pairs(first_rates, second_rates)
    # J has the velocity vectors as entries, with the constant factors 1, -1 or 0. So the
    # same function of the rates of these vectors gives the rates of J.
    return closure.tree.jacobian(vector_rates)


def _rates_of_second_bodies(linearisation: Linearisation, first_rates: Floats) -> Floats:
    """Return the angular velocities of the second bodies of all pairs in n motions.

    There is one motion for each of the n variables. In motion k, variable k has the rate 1
    and all others are at rest. In general this motion opens the loops of the variable. The
    second body of its pair rotates relative to the first body. The two bodies of every
    other pair have the same angular velocity.

    The caller needs the angular velocities of both bodies of each pair. They determine how
    the velocity vectors in the closure Jacobian change.

    Parameters
    ----------
    linearisation
        One configuration, repeated in as many rows as there are variables.
    first_rates
        (variables, pairs, 3) for each motion the angular velocities of the first body of
        each pair. They follow from the tree of pairs along which bodies are placed.

    Returns
    -------
    (variables, pairs, 3) angular velocities of the second body of each pair.
    """
    # The angular velocity in the pair of each variable per unit rate. Axes: row, variable,
    # component.
    unit_velocities = linearisation.vectors
    second_rates = first_rates.copy()
    for variable, pair in enumerate(linearisation.tree.pair_of_variable):
        row = variable  # in which only this variable moves
        second_rates[row, pair] += unit_velocities[row, variable]
    return second_rates


def _find_directions(forms: Floats) -> Floats | None:
    """Return the directions of the configuration curves that cross at a configuration.

    There are k independent motions to first order. A motion with the components y is
    possible to second order if y . B y = 0 for every quadratic form B of the closure
    equations.

    Parameters
    ----------
    forms
        (forms, k, k) the symmetric matrices B. Some can be zero or depend on others, if
        closure equations are redundant.

    Returns
    -------
    (curves, k) unit vectors y. None if the forms do not determine them, or if k is neither
    2 nor 3.
    """
    motion_count = forms.shape[1]  # the number k of independent motions
    # `_find_common_zeros` solves one or two quadratic equations.
    if not len(forms) or motion_count not in (2, 3):
        return None
    independent_forms = _find_independent_forms(forms)
    # k - 1 independent equations have finitely many solutions on the unit sphere.
    if len(independent_forms) != motion_count - 1:
        return None
    return _find_common_zeros(independent_forms)


def _find_independent_forms(forms: Floats) -> Floats:
    """Return independent quadratic forms that vanish at the same vectors as all given ones.

    A form is y . B y with a symmetric matrix B. If B is a linear combination of other
    matrices, its form vanishes wherever the others do, and is superfluous. So a basis of
    the space of all given matrices is enough. From the number of independent forms the
    caller sees whether they determine finitely many vectors.

    Parameters
    ----------
    forms
        (forms, k, k) the symmetric matrices.

    Returns
    -------
    (m, k, k) symmetric matrices of the m independent forms. m is 0 if all forms are smaller
    than `MIN_SECOND_ORDER`, because they may be rounding errors.
    """
    size = forms.shape[1]
    rows, columns = np.triu_indices(size)
    # The upper triangles of the matrices are vectors. The first right singular vectors are
    # a basis.
    _, singular_values, right_vectors = np.linalg.svd(forms[:, rows, columns])
    if singular_values[0] < MIN_SECOND_ORDER:
        return np.zeros((0, size, size))
    # A form that is tiny relative to the largest one may be a rounding error.
    count = int(np.sum(singular_values > MIN_SECOND_ORDER * singular_values[0]))
    independent_forms = np.zeros((count, size, size))
    independent_forms[:, rows, columns] = right_vectors[:count]
    # The lower triangle is the mirror image of the upper one.
    independent_forms[:, columns, rows] = right_vectors[:count]
    return independent_forms


@dataclass(frozen=True)
class _ZeroSearch:
    """The results of Newton's method for common zeros of quadratic forms, from n starts.

    At a crossing of configuration curves, k independent motions are possible to first
    order. The directions of the curves are the unit vectors y (k,) at which all quadratic
    forms y . B y vanish. The symmetric matrices B are the second-order terms of the closure
    equations.

    Attributes
    ----------
    points
        (n, k) unit vectors after the last step.
    residuals
        (n,) largest absolute value of any quadratic form before the last step.
    inverse_norms
        (n,) norm of the inverse of the matrix of the linear equations that gave the last
        step. The norm is large if two zeros nearly coincide.
    """

    points: Floats
    residuals: Floats
    inverse_norms: Floats


def _find_common_zeros(forms: Floats) -> Floats | None:
    """Return the unit vectors y (n, k) at which k - 1 quadratic forms y . B y vanish.

    These vectors are the directions of the curves at a crossing. Newton's method starts
    from vectors spread over the sphere. A vector and its opposite count as the same zero.

    Parameters
    ----------
    forms
        (k - 1, k, k) the symmetric matrices B.

    Returns
    -------
    The unit vectors. None if two zeros coincide, or nearly.
    """
    search = _search_zeros(forms, _spread_unit_vectors(forms.shape[1]))
    has_converged = search.residuals < DIRECTION_TOLERANCE
    # Where two zeros coincide, the equations of Newton's method are singular, and the
    # inverse of their matrix is infinite.
    is_simple = search.inverse_norms < MAX_INVERSE_NORM
    if not np.all(is_simple[has_converged]):
        return None
    zeros: list[Floats] = []
    for point in search.points[has_converged]:
        # The product of two equal or opposite unit vectors is 1 or -1.
        if all(abs(point @ zero) < 1.0 - DIRECTION_TOLERANCE for zero in zeros):
            zeros.append(point)
    return np.array(zeros).reshape(-1, forms.shape[1])


def _search_zeros(forms: Floats, y: Floats) -> _ZeroSearch:
    """Search common zeros of quadratic forms y . B y on the unit sphere by Newton's method.

    At a crossing of configuration curves, k independent motions are possible to first
    order. The unit vectors y (k,) at which all forms are zero are the directions of the
    curves.

    A step dy of Newton's method solves 2 (B y) . dy = -y . B y for each form. It also
    solves y . dy = 0, which keeps the length of y to first order.

    Parameters
    ----------
    forms
        (k - 1, k, k) the symmetric matrices B, one for each form.
    y
        (n, k) unit vectors from which n searches start.
    """
    for _ in range(MAX_CROSSING_STEPS):
        # The vectors B y: axes start (n), form (f), component (i).
        slopes = np.einsum("fij,nj->nfi", forms, y)
        form_values = np.sum(slopes * y[:, None], axis=2)
        residuals = np.append(form_values, np.zeros((len(y), 1)), axis=1)
        # The matrices are square. `left_inverse` returns NaN for singular matrices.
        inverse = left_inverse(np.concatenate([2.0 * slopes, y[:, None]], axis=1))
        y = unit_rows(y - (inverse @ residuals[..., None])[..., 0])
    # The residuals and the inverse belong to the points before the last step.
    return _ZeroSearch(
        points=y,
        residuals=max_abs(residuals, axis=1),
        inverse_norms=np.linalg.norm(inverse, axis=(1, 2)),
    )
