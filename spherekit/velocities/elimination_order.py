"""Chooses the order in which variables are eliminated from the velocity equations of loops.

The compiled functions of the engine solve the velocity equations J r = 0 by a fixed
sequence of pivots, which is chosen here from numerical closure Jacobians J. The equations
of a loop are three rows of J. A pivot is a loop with the variables for which its equations
are solved. There are three variables, or fewer if the equations of the loop depend on
the equations of earlier loops.

The columns of a pivot are the axes of its variables. An elimination order is well
conditioned at a configuration if the axes of each pivot are far from linearly dependent
there (`MAX_AMPLIFICATION`). The same order can be badly conditioned elsewhere. With
redundant equations, the loops that can give three variables may differ between assembly
modes. One set of configurations may therefore require several orders.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.positions.linear_equations import left_inverse

Pivot = tuple[int, list[int]]
"""Index of a loop, and the indices of the variables that its equations give, at most
three."""
EliminationOrder = Sequence[Pivot]
"""Pivots in the order of elimination. Together they give all passive variables."""

REDUNDANT_SINGULAR_VALUE = 1e-9
"""Singular values below this at all configurations count as zero, so the equations of a
loop are redundant. Larger: nearly redundant equations give no variables; smaller: pivots
can be rounding errors."""
MIN_INDEPENDENCE_RATIO = 0.2
"""Pivots whose axes are at least this independent, relative to the most independent ones,
are chosen by their cost. Larger: better conditioned pivots; smaller: fewer products."""
FILL_COST = 4
"""Cost, in products, of an entry of the Jacobian that is zero before a pivot and not after
it. Such an entry needs further products in later steps."""
MAX_AMPLIFICATION = 100.0
"""Largest norm of the inverse that a well-conditioned elimination order gives, relative to
the norm of the smallest left inverse. Larger: rows lose more digits and need quad
precision. Smaller: more orders are used, each with expressions of its own.
"""
MAX_LEFT_INVERSE_ERROR = 1e-6
"""Largest component of B A - 1 for an inverse B that an elimination order gives for the
equations A. Beyond it a pivot was only rounding, and B is no inverse, whatever its size.
Larger: inverses with fewer digits are accepted. Smaller: more orders are used."""
MOST_ORDERS = 16
"""Largest number of orders for one set of configurations. The expressions of each order
take about as long to generate as the expressions of the first order."""
MAX_CONFIGURATIONS_PER_ORDER = 32
"""Largest number of configurations from which one order is chosen."""


class PivotCandidate(NamedTuple):
    """A possible pivot: variables for which the equations of one loop can be solved.

    The velocity equations of a mechanism are solved loop by loop. In the equations, each
    variable has its axis as coefficients.

    Attributes
    ----------
    loop
        Index of the loop.
    variables
        Indices of the variables.
    independence
        How far the axes of the variables are from linearly dependent: 1 for axes at right
        angles, 0 for dependent axes. The least value of all configurations counts.
    """

    loop: int
    variables: list[int]
    independence: float


def assign_elimination_orders(
    jacobians: Floats, passive: Sequence[int]
) -> list[tuple[EliminationOrder, Indices]]:
    """Choose elimination orders, and assign each configuration to one of them.

    An elimination order says which variables are eliminated from the velocity equations of
    which loop, one loop after another. An order is well conditioned at a configuration if
    the inverse to which the order leads is not much larger than the smallest left inverse.
    The first order is chosen for all configurations whose equations are regular. Each
    further order is chosen for the configurations at which no order so far is well
    conditioned.

    Parameters
    ----------
    jacobians
        (n, 3 loops, variables) closure Jacobians of n configurations.
    passive
        Indices of the variables that are not inputs. These are eliminated.

    Returns
    -------
    Pairs of an order and the indices (k,) of its configurations. The first order also gets
    the configurations with singular velocity equations, and those at which none of the
    orders is well conditioned. The list is empty if no order was found that is well
    conditioned at any configuration.
    """
    least_sizes = inverse_sizes(jacobians[:, :, list(passive)])

    def find_suited(order: EliminationOrder | None, rows: Indices) -> Bools:
        """Return a mask of the `rows` at which an order is well conditioned."""
        if order is None:
            return np.zeros(len(rows), dtype=bool)
        sizes = eliminated_inverse_sizes(jacobians[rows], order)
        return np.asarray(sizes <= MAX_AMPLIFICATION * least_sizes[rows])

    assigned: list[tuple[EliminationOrder, Indices]] = []
    # Every order is equally bad at configurations with singular equations. No order is
    # chosen for these configurations, unless there are no others.
    is_singular = np.isinf(least_sizes)
    has_choice = ~is_singular if not np.all(is_singular) else is_singular
    # `remaining` are the indices of the configurations for which an order is still to be
    # chosen. No order is chosen for the configurations in `left_over`.
    remaining = np.flatnonzero(has_choice)
    left_over: list[Indices] = [np.flatnonzero(~has_choice)]
    while len(remaining) and len(assigned) < MOST_ORDERS:
        # An even selection of the remaining configurations.
        chosen_rows = remaining[
            np.unique(
                np.linspace(0, len(remaining) - 1, MAX_CONFIGURATIONS_PER_ORDER).astype(int)
            )
        ]
        order = choose_elimination_order(jacobians[chosen_rows], passive)
        is_suited = find_suited(order, remaining)
        if not np.any(is_suited):
            # The order is badly conditioned at all remaining configurations. Another order
            # is chosen for the first of them alone.
            order = choose_elimination_order(jacobians[remaining[:1]], passive)
            is_suited = find_suited(order, remaining)
        if order is None or not np.any(is_suited):
            # The first configuration is left without an order, so that each pass removes at
            # least one configuration.
            left_over.append(remaining[:1])
            remaining = remaining[1:]
        else:
            assigned.append((order, remaining[is_suited]))
            remaining = remaining[~is_suited]
    if not assigned:
        return []

    # An order that was chosen for other configurations may still suit a configuration that
    # is left over.
    remaining = np.concatenate([*left_over, remaining])
    for number, (order, rows) in enumerate(assigned):
        is_suited = find_suited(order, remaining)
        assigned[number] = (order, np.sort(np.append(rows, remaining[is_suited])))
        remaining = remaining[~is_suited]
    first_order, first_rows = assigned[0]
    assigned[0] = (first_order, np.sort(np.append(first_rows, remaining)))
    return assigned


def choose_elimination_order(
    jacobians: Floats, passive: Sequence[int]
) -> EliminationOrder | None:
    """Choose one elimination order for several configurations.

    The method is Gaussian elimination of the Jacobians, with a choice of the pivot in each
    step. A pivot is a loop with the variables (at most three) for which its equations are
    solved. The compiled functions of the engine have a fixed sequence of pivots, so all
    configurations get the same pivots. A pivot is good if the axes of its variables are far
    from linearly dependent at all configurations, and if the step needs few products.

    Parameters
    ----------
    jacobians
        (k, 3 loops, variables) closure Jacobians of the configurations.
    passive
        Indices of the variables to eliminate.

    Returns
    -------
    The order, or None if no order gives all passive variables.
    """
    k, rows, count = jacobians.shape
    # (k, loops, 3, variables): the equations after the steps so far.
    remaining = jacobians.reshape(k, rows // 3, 3, count).copy()
    # Loops and variables that are not yet used by a pivot.
    loops = list(range(rows // 3))
    columns = list(passive)
    pivots: list[Pivot] = []
    # By loop, its possible pivots. A pivot changes only the equations of loops that contain
    # its variables. To save time, the candidates of other loops are kept.
    candidates: dict[int, list[PivotCandidate]] = {}
    while columns:
        # (loops, variables): whether the equations of a loop contain a variable.
        contains_variable = np.any(remaining[:, loops], axis=(0, 2))
        for loop, loop_contains in zip(loops, contains_variable, strict=True):
            if loop not in candidates:
                loop_variables = [c for c in columns if loop_contains[c]]
                candidates[loop] = _judge_candidates(
                    loop, remaining[:, loop], loop_variables
                )
        pivot = _choose_pivot(candidates, loops, columns, contains_variable)
        if pivot is None:
            return None
        loop, chosen = pivot
        pivots.append(pivot)
        # The equations of loops that contain a variable of the pivot change, so their
        # candidates are judged again.
        for changed_loop, contains in zip(loops, contains_variable, strict=True):
            if np.any(contains[chosen]):
                del candidates[changed_loop]
        loops.remove(loop)
        columns = [c for c in columns if c not in chosen]
        # Express the variables of the pivot by the others, and insert them into the loops
        # that remain. A pivot has fewer than three variables if the three equations of its
        # loop depend on those of earlier loops. The pseudo-inverse solves such equations,
        # too.
        axes = remaining[:, loop][:, :, chosen]
        solved = np.linalg.pinv(axes) @ remaining[:, loop]
        remaining[:, loops] -= remaining[:, loops][..., chosen] @ solved[:, None]
    return pivots


def _judge_candidates(
    loop: int, rows: Floats, loop_variables: Sequence[int]
) -> list[PivotCandidate]:
    """Return the sets of variables for which the equations of one loop can be solved.

    A loop has three equations, of which some may follow from other loops. A set has as many
    variables as there are independent equations. The caller chooses one of the sets, of
    this or another loop, as the next pivot of the elimination.

    Parameters
    ----------
    loop
        Index of the loop.
    rows
        (k, 3, variables) equations of the loop at k configurations. Variables that were
        solved from other loops have been replaced by their solutions.
    loop_variables
        Indices of the variables that these equations contain.

    Returns
    -------
    The possible pivots: the loop with each set, and how far the axes of its variables are
    from linearly dependent. The list is empty if the loop has no independent equation.
    """
    # Coefficients that are only rounding errors at all configurations determine no
    # variable. They remain where a variable cancels in the elimination.
    coefficient_sizes = np.max(np.linalg.norm(rows, axis=1), axis=0)
    loop_variables = [
        c for c in loop_variables if not coefficient_sizes[c] <= REDUNDANT_SINGULAR_VALUE
    ]
    if not loop_variables:
        return []
    # The number of independent equations: the singular values that exceed rounding errors
    # at some configuration.
    sizes = np.linalg.svd(rows[:, :, loop_variables], compute_uv=False)
    rank = int(np.sum(np.max(sizes, axis=0) > REDUNDANT_SINGULAR_VALUE))
    if not rank:
        return []
    sets = [list(chosen) for chosen in combinations(loop_variables, rank)]
    # (sets, k, 3, rank): for each set and configuration, the columns of its variables.
    columns = np.moveaxis(rows[:, :, sets], 2, 0)
    # How independent the columns of each set are at its worst configuration.
    independence = np.min(_axes_independence(columns), axis=1)
    return [
        PivotCandidate(loop, variables, value)
        for variables, value in zip(sets, independence.tolist(), strict=True)
    ]


def _axes_independence(vectors: Floats) -> Floats:
    """Return how independent vectors are: 1 at right angles, 0 if linearly dependent.

    Independence is the volume that the vectors span (the product of their singular values),
    divided by the product of their lengths.

    Parameters
    ----------
    vectors
        (..., 3, r) with r vectors as columns.
    """
    volume = np.prod(np.linalg.svd(vectors, compute_uv=False), axis=-1)
    lengths_product = np.prod(np.linalg.norm(vectors, axis=-2), axis=-1)
    # The limit prevents a division by zero if a vector is zero.
    return np.asarray(volume / np.maximum(lengths_product, 1e-300))


def _choose_pivot(
    candidates: Mapping[int, Sequence[PivotCandidate]],
    loops: Sequence[int],
    columns: Sequence[int],
    contains_variable: Bools,
) -> Pivot | None:
    """Choose the next pivot of an elimination: a loop and the variables solved from it.

    Two aims compete: few lost digits, and few products in the expressions. Digits are lost
    if the coefficients of the variables are nearly linearly dependent vectors: their
    independence (0 to 1) is low. A pivot qualifies if its independence is at least
    `MIN_INDEPENDENCE_RATIO` times that of the best pivot. Of these, the cheapest is chosen.

    Parameters
    ----------
    candidates
        By loop, its possible pivots.
    loops
        Indices of the loops that are no pivots yet.
    columns
        Indices of the variables that are not eliminated yet. In the matrix of the equations
        each variable has a column.
    contains_variable
        (loops, variables) whether the equations of a loop contain a variable. Row k
        belongs to the loop with the index `loops[k]`.

    Returns
    -------
    The pivot, or None if no loop can be solved for a variable.
    """
    best_independence = max(
        (candidate.independence for loop in loops for candidate in candidates[loop]),
        default=0.0,
    )
    if not best_independence > 0.0:
        return None
    best_pivot: Pivot | None = None
    best_rank = (-np.inf, 0.0)
    for loop, loop_contains in zip(loops, contains_variable, strict=True):
        loop_variables = [c for c in columns if loop_contains[c]]
        for candidate in candidates[loop]:
            # The comparison with "not" also leaves out NaN.
            if not candidate.independence >= MIN_INDEPENDENCE_RATIO * best_independence:
                continue
            cost = _elimination_cost(candidate, loop_variables, contains_variable)
            # Lowest cost first, then the highest independence.
            rank = (-cost, candidate.independence)
            if rank > best_rank:
                best_rank = rank
                best_pivot = (loop, candidate.variables)
    return best_pivot


def _elimination_cost(
    candidate: PivotCandidate, loop_variables: Sequence[int], contains_variable: Bools
) -> int:
    """Return the approximate number of products to eliminate the variables of a pivot.

    A pivot is a loop with the variables for which its equations are solved. The solution
    contains the other variables of the loop, and is inserted into all other loops that
    contain a variable of the pivot.

    Parameters
    ----------
    candidate
        The pivot.
    loop_variables
        Indices of the variables in its loop that are not eliminated yet.
    contains_variable
        (loops, variables) whether the equations of a loop contain a variable. The loop of
        the pivot is one of them.
    """
    other_variables = [c for c in loop_variables if c not in candidate.variables]
    has_pivot_variable = np.any(contains_variable[:, candidate.variables], axis=1)
    loops_with_pivot = contains_variable[has_pivot_variable]
    # One product per other variable and one for the right side, for each of these loops
    # except the loop of the pivot itself.
    products = (len(loops_with_pivot) - 1) * (1 + len(other_variables))
    # Elimination adds the other variables to loops that do not contain them yet. Each
    # added coefficient costs products in later steps.
    filled = int(np.sum(~loops_with_pivot[:, other_variables]))
    return FILL_COST * filled + products


def inverse_sizes(matrices: Floats) -> Floats:
    """Return the Frobenius norms (n,) of the smallest left inverses of matrices (n, m, k).

    A left inverse L of a matrix A satisfies L A = 1. Its norm shows how badly conditioned A
    is. The norm is infinite if a matrix is singular, or if m < k.
    """
    n, rows, columns = matrices.shape
    if rows < columns:
        return np.full(n, np.inf)
    sizes = np.linalg.norm(left_inverse(matrices), axis=(1, 2))
    return np.where(np.isfinite(sizes), sizes, np.inf)


def eliminated_inverse_sizes(jacobians: Floats, order: EliminationOrder) -> Floats:
    """Return the Frobenius norms of the inverses that an elimination order yields.

    The velocity equations of all loops are solved in a fixed order of pivots. A pivot is a
    loop with the variables for which it is solved. The solution is a left inverse of the
    equations. If it is much larger than the smallest one (`inverse_sizes`), the order
    amplifies rounding errors, and the caller does not use it.

    Parameters
    ----------
    jacobians
        (n, 3 * loops, variables) coefficients of the velocity equations at n
        configurations.
    order
        The pivots for all variables that are not inputs (passive).

    Returns
    -------
    (n,) norms of the left inverses. An inverse multiplies the right-hand sides of the
    equations and yields the passive variables. The norm is infinite if a pivot is singular.
    """
    with np.errstate(all="ignore"):
        inverses = _eliminated_inverses(jacobians, order)
        variables = [variable for _, chosen in order for variable in chosen]
        # If the coefficients of a pivot are singular, their computed inverse is huge, and
        # is determined by rounding errors. Huge factors can cancel by chance, so the size
        # alone does not show the fault. The inverse times the equations must be 1, too.
        errors = np.abs(inverses @ jacobians[:, :, variables] - np.eye(len(variables)))
        is_inverse = np.max(errors, axis=(1, 2)) <= MAX_LEFT_INVERSE_ERROR
        sizes = np.linalg.norm(inverses, axis=(1, 2))
        return np.where(is_inverse, sizes, np.inf)


def _eliminated_inverses(jacobians: Floats, order: EliminationOrder) -> Floats:
    """Return left inverses of closure Jacobians by elimination in a fixed order.

    The caller compares their sizes with the smallest possible ones. Large inverses show
    that the order amplifies rounding errors.

    Parameters
    ----------
    jacobians
        (n, 3 * loops, variables) coefficients of the velocity equations at n
        configurations.
    order
        The pivots: loops with the variables for which they are solved. Together these are
        all variables that are not inputs (passive).

    Returns
    -------
    (n, passive variables, 3 * loops) inverses, with the variables in the order of the
    pivots. The result is wrong or not finite if a pivot is singular.
    """
    n, equation_count, variable_count = jacobians.shape
    # The identity matrix beside the equations becomes the inverse.
    unit = np.broadcast_to(np.eye(equation_count), (n, equation_count, equation_count))
    equations = np.concatenate([jacobians, unit], axis=2)
    # For each loop its three equations (n, 3, variables + equations).
    rows_by_loop = np.split(equations, equation_count // 3, axis=1)
    for loop, chosen in order:
        # (n, 3, chosen) the coefficients of the variables of the pivot.
        coefficients = rows_by_loop[loop][:, :, chosen]
        # The equations of this loop are solved for the variables of the pivot, by a product
        # with the left inverse of the coefficients. The solution, one row per variable,
        # replaces the equations.
        solved_rows = _solving_matrix(coefficients) @ rows_by_loop[loop]
        rows_by_loop[loop] = solved_rows
        # The solution is inserted into all other loops.
        for other_loop, rows in enumerate(rows_by_loop):
            if other_loop != loop:
                rows -= rows[:, :, chosen] @ solved_rows
    solved_rows = np.concatenate([rows_by_loop[loop] for loop, _ in order], axis=1)
    return np.asarray(solved_rows[:, :, variable_count:])


def _solving_matrix(coefficients: Floats) -> Floats:
    """Return the matrices that solve the equations of a loop for some of its variables.

    The caller multiplies the three equations by such a matrix, and inserts the solution
    into the equations of the other loops. With three variables, the matrix is the inverse
    of the coefficients. With fewer variables, the three equations are redundant: some of
    them follow from loops that are solved before. The matrix then gives the least-squares
    solution.

    Parameters
    ----------
    coefficients
        (n, 3, m) coefficients of the m variables in the three equations of the loop.

    Returns
    -------
    (n, m, 3) left inverses.
    """
    if coefficients.shape[2] == 3:
        return left_inverse(coefficients)
    # The normal equations of A x = b are A^T A x = A^T b.
    transposed = np.swapaxes(coefficients, 1, 2)
    inverse_of_square = left_inverse(transposed @ coefficients)
    return np.asarray(inverse_of_square @ transposed)
