"""The configuration manifold to second order: its tangent space and how that turns.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.motion.closure import Closure
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.loops import REDUNDANT, LoopTree
from spherekit.singular.output_part import OutputPart
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
    flatness
        (n,) smallest singular value of J over its greatest, 1 without loops; 0 where the
        motion of the mechanism itself is singular.
    oriented
        Whether the sense of the basis is fixed everywhere by J alone.
    """

    at: Linearisation
    basis: Floats
    inverse: Floats
    reciprocal_condition: Floats
    oriented: bool

    @property
    def freedoms(self) -> int:
        """The number g of freedoms."""
        return int(self.basis.shape[2])

    @cached_property
    def closing(self) -> Floats:
        """(n, V) Newton's shortest step towards closed loops."""
        return np.asarray(-np.einsum("nve,ne->nv", self.inverse, self.at.residual))

    @cached_property
    def directions(self) -> Floats:
        """The columns of the basis and the closing step, (n, V, g + 1)."""
        return np.concatenate([self.basis, self.closing[:, :, None]], axis=2)

    @cached_property
    def turned(self) -> Floats:
        """(n, g + 1, V, 3) derivatives of the vectors along each of the directions.

        That of contacts along the closing step is of those which close a loop only nearly.
        """
        n, count, many = self.directions.shape
        ways = np.swapaxes(self.directions, 1, 2).reshape(-1, count)
        repeated = self.at.take(np.repeat(np.arange(n), many))
        w = repeated.body_rates(ways)
        return repeated.turned(w).vectors.reshape(n, many, count, 3)

    @cached_property
    def bends(self) -> Floats:
        """(n, g + 1, V, V): how rates change that go on closing the loops.

        Along direction j rates x have to change by bends[j] x at least.
        """
        return _bends(self.at.tree, self.inverse, self.turned)

    def along(self, directions: Floats) -> Floats:
        """Return the changes (n, V) that basis coordinates (n, g) stand for."""
        return np.asarray(np.einsum("nvg,ng->nv", self.basis, directions))


@final
@dataclass(frozen=True)
class PartMotions:
    """Motions of a part alone, while the whole mechanism is at configurations.

    `basis` (n, V, k) are rates that close the loops of the part, zero for all other pairs;
    `inverse` and `oriented` are of these loops, as in `TangentSpace`.
    """

    space: TangentSpace
    part: OutputPart
    basis: Floats
    inverse: Floats
    oriented: bool

    @cached_property
    def bends(self) -> Floats:
        """(n, g + 1, V, V): how rates change that go on closing the loops of the part."""
        kept = np.array(self.part.variables)
        n, many, count, _ = self.space.turned.shape
        bends = np.zeros((n, many, count, count))
        turned = self.space.turned[:, :, kept]
        bends[:, :, kept[:, None], kept] = _bends(self.part.tree, self.inverse, turned)
        return bends

    def along(self, directions: Floats) -> Floats:
        """Return the rates (n, V) that basis coordinates (n, k) stand for."""
        return np.asarray(np.einsum("nvk,nk->nv", self.basis, directions))


def _bends(tree: LoopTree, inverse: Floats, turned: Floats) -> Floats:
    """Return how rates bend, from the derivatives (n, g + 1, V, 3) of their vectors."""
    n, many, count, _ = turned.shape
    bent = tree.jacobian(turned.reshape(-1, count, 3))
    return -inverse[:, None] @ bent.reshape(n, many, *bent.shape[1:])


def tangent_space(
    closure: Closure, values: Floats, freedoms: int, like: Floats | None = None
) -> TangentSpace:
    """Return the tangent spaces at configurations (n, V); NaN where values are.

    `like` (n, V, g) are bases that those found are turned to as nearly as possible.
    """
    at = closure.at(values)
    return TangentSpace(at, *_kernel(at.jacobian, freedoms, like))


def part_motions(
    space: TangentSpace, part: OutputPart, like: Floats | None = None
) -> PartMotions:
    """Return the motions of a part; `like` (n, V, k) are bases that they are turned to."""
    kept = list(part.variables)
    jacobian = part.tree.jacobian(space.at.vectors[:, kept])
    near = None if like is None else like[:, kept]
    inner, inverse, _, oriented = _kernel(jacobian, len(part.driven), near)
    n, count, _ = space.at.vectors.shape
    basis = np.zeros((n, count, len(part.driven)))
    basis[:, kept] = inner
    return PartMotions(space, part, basis, inverse, oriented)


def _kernel(
    jacobian: Floats, freedoms: int, like: Floats | None
) -> tuple[Floats, Floats, Floats, bool]:
    """Return basis, inverse, reciprocal condition and orientation of J (n, rows, V)."""
    n, rows, count = jacobian.shape
    rank = count - freedoms
    finite = np.all(np.isfinite(jacobian), axis=(1, 2))
    left, sizes, right = np.linalg.svd(np.where(finite[:, None, None], jacobian, 0.0))
    basis = np.swapaxes(right[:, rank:], 1, 2).copy()
    if like is not None:
        one, _, other = np.linalg.svd(np.swapaxes(basis, 1, 2) @ like)
        basis = basis @ (one @ other)
    elif rows == rank and freedoms:
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
    reciprocal_condition = np.ones(n)
    if rank:
        reciprocal_condition = sizes[:, rank - 1] / np.maximum(
            sizes[:, 0], np.finfo(float).tiny
        )
    oriented = rows == rank and like is None
    return basis, inverse, reciprocal_condition, oriented
