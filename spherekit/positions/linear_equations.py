"""Linear equations of many configurations at once, also redundant and singular ones."""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite, nans

REDUNDANT_EQUATION_RATIO = 1e-10
"""Singular values of redundant equations below this part of the largest count as zero.

Larger: well-determined equations near a singularity count as singular. Smaller: rounding
errors of redundant equations are taken for independent equations.
"""


def condition_numbers(matrices: Floats) -> Floats:
    """Return the condition numbers (n,) of matrices (n, rows, columns) in the 2-norm.

    The numbers are infinite or about 1e16 if the columns are linearly dependent. They are
    infinite if there are more columns than rows, 1 without columns, and NaN if a matrix is
    not finite.
    """
    _, rows, columns = matrices.shape
    is_finite = all_finite(matrices, (1, 2))
    conditions = np.where(is_finite, np.inf if columns else 1.0, np.nan)
    if 0 < columns <= rows:
        conditions[is_finite] = np.linalg.cond(matrices[is_finite])
    return conditions


def left_inverse(matrices: Floats) -> Floats:
    """Return left inverses B (n, columns, rows) of matrices A (n, rows, columns): B A = 1.

    With more rows than columns, B is the pseudoinverse, and x = B b is the least-squares
    solution of A x = b.

    Returns
    -------
    The inverses. The inverse of a square matrix is NaN if the matrix is exactly singular.
    With more rows than columns, it is NaN if the smallest singular value is at most
    `REDUNDANT_EQUATION_RATIO` times the largest one. With fewer rows than columns, all are
    NaN.
    """
    n, rows, columns = matrices.shape
    if rows == columns:
        try:
            return np.asarray(np.linalg.inv(matrices))
        except np.linalg.LinAlgError:
            # NumPy refuses all matrices if one of them is exactly singular.
            with np.errstate(invalid="ignore"):
                is_regular = np.linalg.slogdet(matrices)[0] != 0.0
            inverses = nans(matrices.shape)
            inverses[is_regular] = np.linalg.inv(matrices[is_regular])
            return inverses
    if rows < columns or not columns:
        return nans((n, columns, rows))
    is_finite = all_finite(matrices, (1, 2))[:, None, None]
    # Pseudoinverse by the singular value decomposition A = U S V^T: B = V S^-1 U^T. NumPy's
    # decomposition fails for NaN. Matrices with NaN are replaced by zero matrices, whose
    # inverses become NaN in the last line.
    left_vectors, singular_values, right_vectors = np.linalg.svd(
        np.where(is_finite, matrices, 0.0), full_matrices=False
    )
    has_full_rank = (
        singular_values[:, -1] > REDUNDANT_EQUATION_RATIO * singular_values[:, 0]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled_vectors = np.swapaxes(right_vectors, 1, 2) / singular_values[:, None]
        inverses = scaled_vectors @ np.swapaxes(left_vectors, 1, 2)
    return np.where(has_full_rank[:, None, None], inverses, np.nan)


def solve_least_norm(matrices: Floats, right_sides: Floats) -> Floats:
    """Return the solutions x (n, columns) of n systems of linear equations A x = b.

    If a system has many solutions, the one with the least norm is returned. If the
    equations contradict each other, x minimises the sum of squared errors.

    Parameters
    ----------
    matrices
        (n, rows, columns) the matrices A.
    right_sides
        (n, rows) the right-hand sides b.

    Returns
    -------
    (n, columns) solutions x. The solution of a nearly singular square matrix is very large.
    """
    n, rows, columns = matrices.shape
    is_regular = np.zeros(n, dtype=bool)
    solutions = np.empty((n, columns))
    if rows == columns:
        # `solve` is fastest, but fails if one of the n matrices is exactly singular. The
        # others are then solved without it, so that their solutions do not depend on it.
        try:
            return np.asarray(np.linalg.solve(matrices, right_sides[..., None])[..., 0])
        except np.linalg.LinAlgError:
            with np.errstate(invalid="ignore"):
                is_regular = np.linalg.slogdet(matrices)[0] != 0.0
            solutions[is_regular] = np.linalg.solve(
                matrices[is_regular], right_sides[is_regular, :, None]
            )[..., 0]
    inverses = np.linalg.pinv(matrices[~is_regular], rcond=REDUNDANT_EQUATION_RATIO)
    solutions[~is_regular] = np.einsum("nij,nj->ni", inverses, right_sides[~is_regular])
    return solutions
