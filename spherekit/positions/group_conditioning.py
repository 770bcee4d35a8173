"""How well the closure equations of one group determine its variables."""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite
from spherekit.positions.linear_equations import left_inverse

MIN_RELATIVE_SPREAD = 1e-9
"""Smallest spread of axes, relative to their common direction, that is compensated.

Larger: groups with nearly parallel axes count as singular. Smaller: rounding errors of
parallel axes are enlarged as if they were a spread.
"""


def group_reciprocal_condition(jacobians: Floats) -> Floats:
    """Return the reciprocal condition numbers of the Jacobians of a group.

    A group is a set of bodies that are placed together by closing their loops. The result
    does not depend on how close together the axes of the group are: a group whose axes all
    lie in a small part of the sphere is small, not singular.

    Parameters
    ----------
    jacobians
        (n, 3 loops, variables) derivatives of the closure residuals of a group.

    Returns
    -------
    (n,) reciprocals of the condition numbers in the Frobenius norm. The value is 0 where
    the Jacobian is singular. It is 1 where the Jacobian is not finite, so that samples
    without a configuration do not count as singular.
    """
    reciprocal_condition = np.ones(len(jacobians))
    finite = all_finite(jacobians, (1, 2))
    # If all axes are close together, the vectors in the Jacobian have nearly one direction.
    # The scaling makes their components across this direction as large as those along it.
    scaled = _equalise_directions(jacobians[finite])
    norm = np.linalg.norm(scaled, axis=(1, 2))
    inverse_norm = np.linalg.norm(left_inverse(scaled), axis=(1, 2))
    reciprocal_condition[finite] = np.nan_to_num(1.0 / (norm * inverse_norm))
    return reciprocal_condition


def _equalise_directions(jacobians: Floats) -> Floats:
    """Return Jacobians (n, 3 loops, variables) scaled as if their axes were far apart.

    The columns of a Jacobian consist of vectors in space, one for each loop. If the axes of
    the pairs are close together, all these vectors have nearly one direction, and the
    Jacobian is ill-conditioned although the mechanism is only small. The condition number
    of the scaled Jacobian does not show this.

    The components of the vectors along their common direction are divided by the largest
    singular value of all vectors, and the components across it by the second. All loops are
    scaled alike, so that the rank of the Jacobian does not change.
    """
    # Axes of `loops`: sample, loop, component of the vector, variable. In `vectors`, the
    # columns are the vectors of all loops and variables.
    n, rows, count = jacobians.shape
    loops = jacobians.reshape(n, rows // 3, 3, count)
    vectors = np.moveaxis(loops, 2, 1).reshape(n, 3, rows // 3 * count)
    # The first left singular vector is the common direction d, and d d^T projects on it.
    left_vectors, singular_values, _ = np.linalg.svd(vectors, full_matrices=False)
    direction = left_vectors[:, :, :1]
    along_common = direction @ np.swapaxes(direction, 1, 2)
    # A Jacobian with a single column has one singular value only.
    singular_values = np.pad(singular_values, ((0, 0), (0, 1)))
    largest = singular_values[:, :1, None]
    # If all axes are parallel, the second singular value is a rounding error, by which
    # nothing must be divided.
    second = np.maximum(singular_values[:, 1:2, None], MIN_RELATIVE_SPREAD * largest)
    # The scaling (n, 3, 3) multiplies the vectors of all loops.
    scaling = along_common / largest + (np.eye(3) - along_common) / second
    return (scaling[:, None] @ loops).reshape(n, rows, count)
