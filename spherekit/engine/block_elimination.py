"""Loop equations solved as terms, three variables of a loop at a time.

Three variables of a loop are eliminated by the vector products of their axes, which does
not depend on how the axes of the ground lie. A loop whose equations repeat others gives
fewer: two by their axes and the normal of these, or one. Which ones, and in which order,
is chosen by numbers at some configurations, and holds for all others but those where
the axes chosen come to depend on each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs, cross, dot, vector
from spherekit.engine.expression_graph import Expr
from spherekit.sphere.rotation import Floats

REPEATED = 1e-9
"""Equations that are left smaller than this throughout repeat others."""

FLATTER = 0.2
"""Three variables that are this much flatter than the best ones may still be chosen first,
where that fills less of the equations."""

Pivot = tuple[int, tuple[int, ...]]
"""A loop, and the variables that it gives, at most three."""


def pivots_of(jacobians: Floats) -> tuple[Pivot, ...] | None:
    """Return the order in which loops give variables; None if none is regular.

    `jacobians` (k, 3 loops, variables) are those of some configurations.
    """
    k, rows, count = jacobians.shape
    left = jacobians.reshape(k, rows // 3, 3, count).copy()
    loops, columns = list(range(rows // 3)), list(range(count))
    pivots: list[Pivot] = []
    while columns:
        best = _most_regular(left, loops, columns)
        if best is None:
            return None
        loop, pivot_columns = best
        pivots.append(best)
        loops.remove(loop)
        columns = [c for c in columns if c not in pivot_columns]
        inverse = np.linalg.pinv(left[:, loop][:, :, list(pivot_columns)])
        for other in loops:
            used = left[:, other][:, :, list(pivot_columns)]
            if np.any(used):
                left[:, other] -= used @ (inverse @ left[:, loop])
    return tuple(pivots)


def _most_regular(
    left: Floats, loops: Sequence[int], columns: Sequence[int]
) -> Pivot | None:
    """Return the pivot whose axes depend least on each other, wherever they do most."""
    rated: list[tuple[float, int, Pivot]] = []
    for loop in loops:
        used_columns = [c for c in columns if np.any(left[:, loop, :, c])]
        sizes = np.linalg.svd(left[:, loop][:, :, columns], compute_uv=False)
        rank = int(np.sum(np.max(sizes, axis=0) > REPEATED))
        for chosen in combinations(used_columns, rank) if rank else ():
            block = left[:, loop][:, :, list(chosen)]
            spread = np.prod(np.linalg.norm(block, axis=1), axis=1)
            flat = np.prod(np.linalg.svd(block, compute_uv=False), axis=1)
            flat = flat / np.maximum(spread, 1e-300)
            more = [c for c in columns if c not in chosen and c in used_columns]
            users = [
                o for o in loops if o != loop and np.any(left[:, o][:, :, list(chosen)])
            ]
            fills = sum(not np.any(left[:, o, :, c]) for o in users for c in more)
            cost = 4 * fills + len(users) * (1 + len(more))
            rated.append((float(np.min(flat)), -cost, (loop, chosen)))
    if not rated or not (most := max(rated)[0]) > 0.0:
        return None
    near = [candidate for candidate in rated if candidate[0] >= FLATTER * most]
    return max(near, key=lambda candidate: (candidate[1], candidate[0]))[2]


@final
@dataclass(frozen=True)
class LoopInverse:
    """The inverse of loop equations as terms.

    `blocks[pivot][loop]` (m, 3) give the m variables of a pivot by what a loop has on its
    right-hand side; those that are zero are missing.
    """

    blocks: Mapping[Pivot, Mapping[int, Exprs]]

    def solved(self, right: Sequence[Exprs]) -> dict[int, Expr]:
        """Return the variables, by number, that the right-hand sides (3,) of loops give."""
        values: dict[int, Expr] = {}
        for (_, pivot_columns), blocks in self.blocks.items():
            parts = [block @ right[loop] for loop, block in blocks.items()]
            total = parts[0]
            for part in parts[1:]:
                total = total + part
            values |= dict(zip(pivot_columns, total, strict=True))
        return values

    @property
    def rows(self) -> dict[int, dict[int, Exprs]]:
        """The row of each variable, by number: what (3,) each loop counts for."""
        return {
            variable: {loop: block[k] for loop, block in blocks.items()}
            for (_, pivot_columns), blocks in self.blocks.items()
            for k, variable in enumerate(pivot_columns)
        }


def loop_inverse(
    columns: Mapping[int, Mapping[int, Exprs]], pivots: Sequence[Pivot]
) -> LoopInverse:
    """Return the inverse of equations whose `columns[loop][variable]` (3,) are not zero."""
    left = {loop: dict(by_variable) for loop, by_variable in columns.items()}
    unit = np.array([[1.0 if i == j else 0.0 for j in range(3)] for i in range(3)], object)
    right: dict[int, dict[int, Exprs]] = {loop: {loop: unit} for loop in columns}
    for loop, pivot_columns in pivots:
        back = _inverse([left[loop].pop(variable) for variable in pivot_columns])
        left[loop] = {v: np.asarray(back @ x) for v, x in left[loop].items()}
        right[loop] = {m: np.asarray(back @ x) for m, x in right[loop].items()}
        for other in columns:
            if other == loop or not any(v in left[other] for v in pivot_columns):
                continue
            size = len(next(left[other][v] for v in pivot_columns if v in left[other]))
            zero = vector([0.0] * size)
            used = np.stack([left[other].pop(v, zero) for v in pivot_columns], axis=1)
            for mine, its in ((left[other], left[loop]), (right[other], right[loop])):
                for key, value in its.items():
                    change = used @ value
                    mine[key] = mine[key] - change if key in mine else -1.0 * change
    return LoopInverse({pivot: right[pivot[0]] for pivot in pivots})


def _inverse(axes: Sequence[Exprs]) -> Exprs:
    """Return what (m, 3) gives the parts along m axes of a vector in their span."""
    if len(axes) == 1:
        return np.stack([axes[0] * (1.0 / dot(axes[0], axes[0]))])
    if len(axes) == 2:
        normal = cross(*axes)
        share = 1.0 / dot(normal, normal)
        return np.stack([cross(axes[1], normal) * share, cross(normal, axes[0]) * share])
    a, b, c = axes
    normals = cross(b, c), cross(c, a), cross(a, b)
    share = 1.0 / dot(a, normals[0])
    return np.stack([normal * share for normal in normals])
