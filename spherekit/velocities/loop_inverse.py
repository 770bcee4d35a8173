"""The inverse of the loop equations as expressions, by block elimination.

The pivots are three variables of a loop at a time. The inverse of their three axes consists
of vector products, which do not depend on the choice of the ground axes. If some equations
of a loop follow from others, the loop gives a pivot of two variables, or of one.
`elimination_order.py` chooses the pivots and their order.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.symbolic.expression_graph import dot
from spherekit.symbolic.vector_algebra import Exprs, cross
from spherekit.velocities.elimination_order import Pivot


def loop_inverse(equations: Exprs, pivots: Sequence[Pivot]) -> Exprs:
    """Return a left inverse of the velocity equations by Gauss-Jordan elimination.

    Each loop has three equations: the sum of the variables' vectors times their rates is 0.
    A pivot is a loop with the variables for which its equations are solved: three
    variables, or fewer if some equations of the loop follow from other loops. The solution
    is inserted into all other loops. The pivots contain all variables but the inputs.
    Entries are symbolic expressions. The caller uses the inverse to bound the errors of
    variables that open loops cause.

    Parameters
    ----------
    equations
        (loops, 3, variables) coefficients of the rates of all variables.
    pivots
        The loop and the variables of each pivot, in the order of elimination. The vectors
        of the variables of a pivot are linearly independent.

    Returns
    -------
    (variables, loops, 3) the change of each variable if the right-hand side of one equation
    is 1 and all others are 0. The change is 0 for inputs.
    """
    loops, _, variable_count = equations.shape
    # The identity matrix beside the equations becomes the inverse.
    unit = np.eye(3 * loops).reshape(loops, 3, 3 * loops)
    # For each loop the three equations, with the columns of the variables and of the unit.
    rows = [*np.concatenate([equations, unit], axis=2)]
    inverse = np.zeros((variable_count, loops, 3)).astype(object)
    for loop, variables in pivots:
        # (m, 3) the vectors of the m variables of the pivot.
        axes = rows[loop][:, variables].T
        # The columns of these variables are not used any more. Zeros make the products
        # below shorter.
        rows[loop][:, variables] = 0.0
        # The three equations of the loop are solved for the m variables, and m rows with
        # the rate of one variable each replace the equations. (If m < 3, 3 - m of the
        # equations follow from other loops.) The matrix `axes_inverse` (m, 3) turns a
        # vector into its components along the axes.
        axes_inverse = _axes_inverse(axes)
        rows[loop] = axes_inverse @ rows[loop]
        # The solution is inserted into the equations of the other loops.
        for other_loop in range(loops):
            if other_loop != loop:
                factors = rows[other_loop][:, variables]
                rows[other_loop][:, variables] = 0.0
                rows[other_loop] -= factors @ rows[loop]
    for loop, variables in pivots:
        # The solved rows of each pivot are rows of the inverse.
        inverse[variables] = rows[loop][:, variable_count:].reshape(-1, loops, 3)
    return inverse


def _axes_inverse(axes: Exprs) -> Exprs:
    """Return the matrix (m, 3) that gives the components of a vector along m axes.

    The matrix is a left inverse of the matrix with the axes as columns. For three axes a,
    b, c the rows are b x c, c x a and a x b, divided by a . (b x c).

    Parameters
    ----------
    axes
        (m, 3) with m = 1, 2 or 3 independent axes. With fewer than three axes, the vector
        has to be a sum of multiples of the axes.
    """
    if len(axes) == 1:
        return axes * (1.0 / dot(axes[0], axes[0]))
    if len(axes) == 2:
        normal = cross(*axes)
        numerators = np.stack([cross(axes[1], normal), cross(normal, axes[0])])
        return numerators * (1.0 / dot(normal, normal))
    a, b, c = axes
    normals = np.stack([cross(b, c), cross(c, a), cross(a, b)])
    return normals * (1.0 / dot(a, normals[0]))
