"""Least squares in any arithmetic: Householder's decomposition of many matrices at once."""

import numpy as np

from spherekit.exact.arithmetic import Arithmetic, Numbers

SLACK = 64
"""A column shorter than this many roundings of the longest depends on the others."""


def left_inverse(arithmetic: Arithmetic, matrices: Numbers) -> Numbers:
    """Return the pseudo-inverses (n, k, m) of matrices (n, m, k) of full column rank.

    NaN where a matrix has less. Householder QR with column pivoting (Golub and Van Loan
    2013, Algorithm 5.4.1).
    """
    n, m, k = matrices.shape
    lost = arithmetic.exact(np.full((n, k, m), np.nan))
    if m < k:
        return lost
    upper = matrices.copy()
    across = np.broadcast_to(arithmetic.exact(np.eye(m)), (n, m, m)).copy()
    order = np.tile(np.arange(k), (n, 1))
    rows = np.arange(n)
    for c in range(k):
        sizes = np.sum(upper[:, c:, c:] * upper[:, c:, c:], axis=1)
        pick = c + np.argmax(sizes, axis=1)
        for array in (upper, order[:, None, :]):
            kept = array[:, :, c].copy()
            array[:, :, c] = array[rows, :, pick]
            array[rows, :, pick] = kept
        column = upper[:, c:, c]
        length = arithmetic.root(np.sum(column * column, axis=1))
        mirror = column.copy()
        mirror[:, 0] = column[:, 0] + np.where(column[:, 0] < 0, -length, length)
        square = np.sum(mirror * mirror, axis=1)
        factor = 2 / np.where(square == 0, arithmetic.exact(np.ones(n)), square)
        for array in (upper[:, c:, c:], across[:, c:, :]):
            along = (mirror[:, None, :] @ array)[:, 0]
            array -= mirror[:, :, None] * (factor[:, None] * along)[:, None, :]
    diagonal = np.stack([np.abs(upper[:, c, c]) for c in range(k)], axis=1)
    full = np.all(diagonal > SLACK * arithmetic.eps * diagonal[:, :1], axis=1)
    upper, across, order = upper[full], across[full], order[full]
    solved = across[:, :k].copy()
    for c in reversed(range(k)):
        for d in range(c + 1, k):
            solved[:, c] = solved[:, c] - upper[:, c, d, None] * solved[:, d]
        solved[:, c] = solved[:, c] / upper[:, c, c, None]
    chosen = lost[full]
    chosen[np.arange(len(order))[:, None], order] = solved
    lost[full] = chosen
    return lost
