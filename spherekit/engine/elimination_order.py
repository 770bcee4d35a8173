"""The order in which variables are eliminated from the loop equations, chosen by numbers.

The equations of a loop are three rows of the closure Jacobian. An order is a sequence of
pivots; each takes a loop and solves its equations for three variables, or fewer where they
repeat equations of loops before. An order is regular at a configuration if the axes of each
pivot are independent there. It need not be regular at all others: where equations repeat,
the loops that can give three variables may differ from one assembly mode to the next.
"""

from collections.abc import Sequence
from itertools import combinations
from operator import itemgetter

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.motion.loops import left_inverse

Pivot = tuple[int, list[int]]
"""A loop, and the variables that it gives, at most three."""
EliminationOrder = Sequence[Pivot]
"""Pivots that together give all passive variables."""

REPEATED = 1e-9
"""Equations that are left smaller than this at all configurations repeat others."""
FLATTER = 0.2
"""A pivot whose axes are this much flatter than the best ones may still be chosen first,
where fewer loops have them."""
FILL = 4
"""A place that is filled costs so many products: others have to be done for it later."""
MAX_AMPLIFICATION = 100.0
"""An order is regular if the inverse that it gives is at most so many times larger than the
least one, that of the singular value decomposition. Larger: rows lose more digits and need
quad precision. Smaller: more orders are needed, each with expressions of its own."""
MOST_ORDERS = 16
"""Orders that are tried for one set of configurations. Each takes about as long to write in
expressions as the first."""
REFERENCES = 32
"""Configurations at most by which one order is chosen."""


def assign_elimination_orders(
    jacobians: Floats, passive: Sequence[int]
) -> list[tuple[EliminationOrder, Indices]]:
    """Return elimination orders, and the configurations at which each is regular.

    Parameters
    ----------
    jacobians
        (n, 3 loops, variables) closure Jacobians of configurations.
    passive
        Numbers of the variables that are no inputs, which are eliminated.

    Returns
    -------
    list of (EliminationOrder, (k,) indices)
        The first order is chosen by all configurations, the next ones by those that are
        left. Configurations at which the velocity equations are singular belong to the
        first order, as do those that are left after `MOST_ORDERS` orders. The list is empty
        where no order gives all variables.
    """
    least = inverse_sizes(jacobians[:, :, list(passive)])
    assigned: list[tuple[EliminationOrder, Indices]] = []
    rest: list[Indices] = []
    left = np.arange(len(jacobians))
    while len(left) and len(assigned) < MOST_ORDERS:
        some = left[np.unique(np.linspace(0, len(left) - 1, REFERENCES).astype(int))]
        order = choose_elimination_order(jacobians[some], passive)
        regular = np.zeros(len(left), dtype=bool)
        if order is not None:
            sizes = eliminated_inverse_sizes(jacobians[left], order)
            regular = (sizes <= MAX_AMPLIFICATION * least[left]) | np.isinf(least[left])
        if not np.any(regular):
            # No order suits these together: the first of them gets its own.
            order = choose_elimination_order(jacobians[left[:1]], passive)
            if order is not None:
                sizes = eliminated_inverse_sizes(jacobians[left], order)
                regular = sizes <= MAX_AMPLIFICATION * least[left]
            regular[0] = True
        if order is None:
            rest.append(left[regular])
        else:
            assigned.append((order, left[regular]))
        left = left[~regular]
    if assigned:
        first_order, first_rows = assigned[0]
        assigned[0] = first_order, np.sort(np.concatenate([first_rows, *rest, left]))
    return assigned


def choose_elimination_order(
    jacobians: Floats, passive: Sequence[int]
) -> EliminationOrder | None:
    """Return the order in which loops give the `passive` variables; None if none does.

    Parameters
    ----------
    jacobians
        (k, 3 loops, variables) those of some configurations. The worst of them counts.
    passive
        Numbers of the variables to eliminate.
    """
    k, rows, count = jacobians.shape
    left = jacobians.reshape(k, rows // 3, 3, count).copy()
    loops = list(range(rows // 3))
    columns = list(passive)
    pivots: list[Pivot] = []
    while columns:
        best = _most_regular(left, loops, columns)
        if best is None:
            return None
        loop, chosen = best
        pivots.append(best)
        loops.remove(loop)
        columns = [c for c in columns if c not in chosen]
        solved = np.linalg.pinv(left[:, loop][:, :, chosen]) @ left[:, loop]
        left[:, loops] -= left[:, loops][..., chosen] @ solved[:, None]
    return pivots


def _most_regular(
    left: Floats, loops: Sequence[int], columns: Sequence[int]
) -> Pivot | None:
    """Return the pivot whose axes depend least on each other, wherever they do most.

    Of many, one that takes few products and fills few places.
    """
    rated: list[tuple[float, int, Pivot]] = []
    there = np.any(left[:, loops], axis=(0, 2))
    for loop, here in zip(loops, there, strict=True):
        rows = left[:, loop]
        sizes = np.linalg.svd(rows[:, :, columns], compute_uv=False)
        rank = np.sum(np.max(sizes, axis=0) > REPEATED)
        used = [c for c in columns if here[c]]
        for chosen in map(list, combinations(used, rank)) if rank else ():
            block = rows[:, :, chosen]
            spread = np.prod(np.linalg.norm(block, axis=1), axis=1)
            flat = np.prod(np.linalg.svd(block, compute_uv=False), axis=1)
            flat = np.min(flat / np.maximum(spread, 1e-300))
            more = [c for c in used if c not in chosen]
            users = there[np.any(there[:, chosen], axis=1)]
            cost = FILL * np.sum(~users[:, more]) + (len(users) - 1) * (1 + len(more))
            rated.append((flat, -cost, (loop, chosen)))
    most = max((flat for flat, _, _ in rated), default=0.0)
    if not most > 0.0:
        return None
    near = (candidate for candidate in rated if candidate[0] >= FLATTER * most)
    return max(near, key=itemgetter(1, 0))[2]


def inverse_sizes(matrices: Floats) -> Floats:
    """Return the Frobenius norms (n,) of the least left inverses of matrices (n, m, k).

    They are infinite where a matrix is singular.
    """
    n, rows, columns = matrices.shape
    if rows < columns:
        return np.full(n, np.inf)
    sizes = np.linalg.norm(left_inverse(matrices), axis=(1, 2))
    return np.where(np.isfinite(sizes), sizes, np.inf)


def eliminated_inverse_sizes(jacobians: Floats, order: EliminationOrder) -> Floats:
    """Return the Frobenius norms (n,) of the left inverses that an elimination order gives.

    The steps are those of `spherekit.engine.columns.loop_inverse`, by numbers. The norms
    are NaN where a pivot is singular.

    Parameters
    ----------
    jacobians
        (n, 3 loops, variables) closure Jacobians.
    order
        The pivots that give all passive variables.
    """
    n, equations, count = jacobians.shape
    loops = equations // 3
    unit = np.broadcast_to(np.eye(equations), (n, equations, equations))
    rows = np.concatenate([jacobians, unit], axis=2)
    rows = rows.reshape(n, loops, 3, count + equations)
    with np.errstate(all="ignore"):
        for loop, chosen in order:
            axes = rows[:, loop][:, :, chosen]
            if len(chosen) == 3:
                inverse = left_inverse(axes)
            else:
                # Fewer variables than equations: the normal equations, as there.
                transposed = np.swapaxes(axes, 1, 2)
                inverse = left_inverse(transposed @ axes) @ transposed
            solved = inverse @ rows[:, loop]
            for other in range(loops):
                if other != loop:
                    rows[:, other] -= rows[:, other][:, :, chosen] @ solved
            rows[:, loop, : len(chosen)] = solved
        sizes = np.zeros(n)
        for loop, chosen in order:
            part = rows[:, loop, : len(chosen), count:]
            sizes += np.sum(part**2, axis=(1, 2))
        return np.sqrt(sizes)
