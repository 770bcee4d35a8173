"""The configuration manifold to second order: its tangent space and how that turns.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.motion.closure import Closure
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.loops import REDUNDANT
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class TangentSpace:
    """n configurations of a mechanism with V variables and g freedoms.

    Attributes
    ----------
    at
        The configurations, with orientations, vectors and residual.
    basis
        (n, V, g) orthonormal rates that close the loops. With as many equations as V - g
        the sense is such that det [J; basis^T] > 0, or that of the basis aligned to.
    inverse
        (n, V, 3 loops) pseudo-inverse of J.
    closing
        (n, V) Newton's shortest step towards closed loops.
    turned
        (n, g + 1, V, 3) derivatives of the vectors along each column of the basis, and
        along the closing step (that of contacts which close a loop only nearly).
    bends
        (n, g + 1, V, V): along direction j of those, rates x that close the loops have to
        change by bends[j] x at least, to go on closing them.
    flatness
        (n,) smallest singular value of J over its greatest, 1 without loops; 0 where the
        motion of the mechanism itself is singular.
    oriented
        Whether the sense of the basis is fixed everywhere by J alone.
    """

    at: Linearisation
    basis: Floats
    inverse: Floats
    closing: Floats
    turned: Floats
    bends: Floats
    reciprocal_condition: Floats
    oriented: bool

    @property
    def freedoms(self) -> int:
        """The number g of freedoms."""
        return int(self.basis.shape[2])

    @property
    def directions(self) -> Floats:
        """The columns of the basis and the closing step, (n, V, g + 1)."""
        return np.concatenate([self.basis, self.closing[:, :, None]], axis=2)

    def along(self, directions: Floats) -> Floats:
        """Return the changes (n, V) that basis coordinates (n, g) stand for."""
        return np.asarray(np.einsum("nvg,ng->nv", self.basis, directions))


def tangent_space(
    closure: Closure, values: Floats, freedoms: int, like: Floats | None = None
) -> TangentSpace:
    """Return the tangent spaces at configurations (n, V); NaN where values are.

    `like` (V, g) is a basis that those found are turned to as nearly as possible.
    """
    at = closure.at(values)
    jacobian = at.jacobian
    n, rows, count = jacobian.shape
    rank = count - freedoms
    finite = np.all(np.isfinite(jacobian), axis=(1, 2))
    left, sizes, right = np.linalg.svd(np.where(finite[:, None, None], jacobian, 0.0))
    basis = np.swapaxes(right[:, rank:], 1, 2).copy()
    if like is not None:
        one, _, other = np.linalg.svd(np.swapaxes(basis, 1, 2) @ like)
        basis = basis @ (one @ other)
    elif rows == rank:
        sense = np.linalg.det(left) * np.linalg.det(right)
        basis[:, :, -1] *= np.where(sense < 0.0, -1.0, 1.0)[:, None]
    floor = np.maximum(REDUNDANT * sizes[:, :1], np.finfo(float).tiny)
    kept = 1.0 / np.where(sizes[:, :rank] > floor, sizes[:, :rank], np.inf)
    inverse = (
        np.swapaxes(right[:, :rank], 1, 2)
        * kept[:, None]
        @ np.swapaxes(left[:, :, :rank], 1, 2)
    )
    basis[~finite] = inverse[~finite] = np.nan
    closing = -np.einsum("nve,ne->nv", inverse, at.residual)
    ways = np.concatenate([basis, closing[:, :, None]], axis=2)
    many = freedoms + 1
    repeated = at.take(np.repeat(np.arange(n), many))
    w = repeated.body_rates(np.swapaxes(ways, 1, 2).reshape(-1, count))
    turned = repeated.turned(w).vectors
    bends = -inverse[:, None] @ closure.tree.jacobian(turned).reshape(n, many, rows, count)
    reciprocal_condition = np.ones(n)
    if rank:
        reciprocal_condition = sizes[:, rank - 1] / np.maximum(
            sizes[:, 0], np.finfo(float).tiny
        )
    return TangentSpace(
        at,
        basis,
        inverse,
        closing,
        turned.reshape(n, many, count, 3),
        bends,
        reciprocal_condition,
        rows == rank and like is None,
    )
