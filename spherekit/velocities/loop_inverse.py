"""Loop equations solved as expressions, three variables of a loop at a time.

Three variables of a loop are eliminated by the vector products of their axes, which does
not depend on how the axes of the ground lie. A loop whose equations repeat others gives
fewer: two by their axes and the normal of these, or one. `elimination_order.py` chooses
which ones, and in which order.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.symbolic.expression_graph import dot
from spherekit.symbolic.vector_algebra import Exprs, cross
from spherekit.velocities.elimination_order import Pivot


def loop_inverse(equations: Exprs, pivots: Sequence[Pivot]) -> Exprs:
    """Return the inverse (variables, loops, 3) of equations (loops, 3, variables).

    It says by how much what a loop has on its right-hand side counts for a variable.
    """
    loops, _, count = equations.shape
    unit = np.eye(3 * loops).reshape(loops, 3, 3 * loops)
    rows = [*np.concatenate([equations, unit], axis=2)]
    inverse = np.zeros((count, loops, 3)).astype(object)
    for loop, at in pivots:
        axes, rows[loop][:, at] = rows[loop][:, at].T, 0.0
        rows[loop] = _inverse(axes) @ rows[loop]
        for other in range(loops):
            if other != loop:
                used, rows[other][:, at] = rows[other][:, at], 0.0
                rows[other] -= used @ rows[loop]
    for loop, at in pivots:
        inverse[at] = rows[loop][:, count:].reshape(-1, loops, 3)
    return inverse


def _inverse(axes: Exprs) -> Exprs:
    """Return what (m, 3) gives the parts along m axes of a vector in their span."""
    if len(axes) == 1:
        return axes * (1.0 / dot(axes[0], axes[0]))
    if len(axes) == 2:
        normal = cross(*axes)
        both = np.stack([cross(axes[1], normal), cross(normal, axes[0])])
        return both * (1.0 / dot(normal, normal))
    a, b, c = axes
    normals = np.stack([cross(b, c), cross(c, a), cross(a, b)])
    return normals * (1.0 / dot(a, normals[0]))
