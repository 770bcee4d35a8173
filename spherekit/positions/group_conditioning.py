"""How well the closure equations of one group determine its variables."""

from typing import NamedTuple

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
    """Return how well the closure equations of a group determine its variables.

    A group is a set of bodies that are placed together by closing their loops. The measure
    is the reciprocal condition number of their Jacobian.

    If all axes of a group are close together, the vectors in the Jacobian have nearly one
    direction. Such a group would seem singular, although it is only small. The vectors are
    therefore scaled first: the components across their common direction become as large as
    those along it.

    Parameters
    ----------
    jacobians
        (n, 3 loops, variables) derivatives of the closure residuals of a group.

    Returns
    -------
    (n,) reciprocals of the condition numbers in the Frobenius norm. The value is 0 where
    the Jacobian is singular. The value is 1 where the Jacobian is not finite, so that
    samples without a configuration do not count as singular.
    """
    reciprocal_condition = np.ones(len(jacobians))
    finite = all_finite(jacobians, (1, 2))
    scaled = _equalise_directions(jacobians[finite])  # the scaling stated above
    norm = np.linalg.norm(scaled, axis=(1, 2))
    inverse_norm = np.linalg.norm(left_inverse(scaled), axis=(1, 2))
    reciprocal_condition[finite] = np.nan_to_num(1.0 / (norm * inverse_norm))
    return reciprocal_condition


def _equalise_directions(jacobians: Floats) -> Floats:
    """Return Jacobians (n, 3 loops, variables) scaled as if their axes were far apart.

    Each column of a Jacobian consists of vectors in space, one for each loop. If the axes
    of the pairs are close together, all these vectors have nearly one direction. The
    Jacobian is then ill-conditioned. The components of the vectors along their common
    direction are therefore divided by their size in this direction. The components across
    the direction are divided by their size across. The rank does not change. So the
    condition number can tell singular groups from groups that are only small.
    """
    # Axes of `loops`: sample, loop, component of the vector, variable.
    n, rows, variable_count = jacobians.shape
    loop_count = rows // 3
    loops = jacobians.reshape(n, loop_count, 3, variable_count)
    # The vectors of all loops and variables become the columns of one matrix.
    vectors = np.moveaxis(loops, 2, 1).reshape(n, 3, loop_count * variable_count)
    spread = _measure_spread(vectors)
    # The matrix d d^T projects on the direction d, and 1 - d d^T on the plane across it.
    project_along = spread.direction @ np.swapaxes(spread.direction, 1, 2)
    project_across = np.eye(3) - project_along
    size_along = spread.size_along[:, None, None]
    size_across = spread.size_across[:, None, None]
    # If all axes are parallel, the size across is a rounding error, by which nothing must
    # be divided.
    size_across = np.maximum(size_across, MIN_RELATIVE_SPREAD * size_along)
    # The scaling (n, 3, 3) multiplies the vectors of all loops.
    scaling = project_along / size_along + project_across / size_across
    return (scaling[:, None] @ loops).reshape(n, rows, variable_count)


class VectorSpread(NamedTuple):
    """The common direction of vectors in space, and their sizes along and across it.

    The size of a set of m vectors along a direction is the root of the sum of their squared
    components in this direction. If the size across is much smaller than the size along,
    the vectors are nearly parallel. There are n such sets.

    Attributes
    ----------
    direction
        (n, 3, 1) unit vector along which the size of the set is largest.
    size_along
        (n,) size along this direction.
    size_across
        (n,) largest size along any direction at a right angle to this direction.
    """

    direction: Floats
    size_along: Floats
    size_across: Floats


def _measure_spread(vectors: Floats) -> VectorSpread:
    """Return the common direction of vectors, and their sizes along and across it.

    The direction is the first left singular vector, and the sizes are the first two
    singular values.

    Parameters
    ----------
    vectors
        (n, 3, m) matrices with the vectors as columns.
    """
    left_vectors, singular_values, _ = np.linalg.svd(vectors, full_matrices=False)
    # A single vector has only one singular value. Its size across is zero.
    singular_values = np.pad(singular_values, ((0, 0), (0, 1)))
    return VectorSpread(
        direction=left_vectors[:, :, :1],
        size_along=singular_values[:, 0],
        size_across=singular_values[:, 1],
    )
