"""The tangent space of the configuration manifold, and its derivative.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly
from spherekit.planning.submechanism import moving_pairs
from spherekit.positions.linear_equations import REDUNDANT_EQUATION_RATIO
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_tree import LoopTree

TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class OutputPart:
    """The pairs by which an output moves: what else moves is no singularity of it.

    Attributes
    ----------
    tree
        The loops that they close, rooted in the link that the output is seen from.
    variables, driven
        Their variables, and those of them that are inputs, numbered as in the mechanism.
    way
        (V,) the sense in which the way to the output passes each variable of the
        mechanism, 0 for most.
    """

    tree: LoopTree
    variables: tuple[int, ...]
    driven: tuple[int, ...]
    way: tuple[float, ...]

    @staticmethod
    def of(
        mechanism: Mechanism, assembly: Assembly, link: int, relative_to: int
    ) -> "OutputPart | None":
        """Return the part that moves a link relative to another, None for all pairs."""
        pairs = moving_pairs(mechanism, assembly, (link, relative_to))
        if len(pairs) == len(mechanism.pairs):
            return None
        ends = [mechanism.ends[pair] for pair in pairs]
        bodies = list(dict.fromkeys([relative_to, link, *(x for two in ends for x in two)]))
        owners = mechanism.variable_owners
        variables = tuple(v for v, owner in enumerate(owners) if owner in pairs)
        tree = LoopTree(
            len(bodies),
            tuple((bodies.index(a), bodies.index(b)) for a, b in ends),
            tuple(pairs.index(owners[v]) for v in variables),
        )
        way = np.zeros(len(owners))
        way[list(variables)] = tree.paths[1]
        driven = [mechanism.variables_of(pair)[0] for pair in assembly.inputs]
        return OutputPart(
            tree, variables, tuple(v for v in driven if v in variables), tuple(way.tolist())
        )


@dataclass(frozen=True)
class TangentSpace:
    """Motions that close loops, at n configurations of a mechanism with V variables.

    Attributes
    ----------
    at
        The configurations, with orientations, vectors and residual.
    tree, kept
        The loops, and their variables: of the mechanism, or of a part of it alone.
    basis
        (n, V, k) orthonormal rates that close the loops, zero for other variables. With as
        many equations as rank the sense is such that det [J; basis^T] > 0, or that of the
        basis aligned to.
    inverse
        (n, variables, 3 loops) pseudo-inverse of J.
    reciprocal_condition
        (n,) smallest singular value of J over its greatest, 1 without loops; 0 where the
        motion of the mechanism itself is singular.
    oriented
        Whether the sense of the basis is fixed everywhere by J alone.
    whole
        Of a part the motions of the whole mechanism, along which configurations change.
    """

    at: Linearisation
    tree: LoopTree
    kept: Indices
    basis: Floats
    inverse: Floats
    reciprocal_condition: Floats
    oriented: bool
    whole: "TangentSpace | None" = None

    @property
    def freedoms(self) -> int:
        """The number k of freedoms."""
        return int(self.basis.shape[2])

    @cached_property
    def closing(self) -> Floats:
        """(n, V) Newton's shortest step towards closed loops."""
        return -np.einsum("nve,ne->nv", self.inverse, self.at.residual)

    @cached_property
    def directions(self) -> Floats:
        """The columns of the basis and the closing step, (n, V, g + 1)."""
        return np.concatenate([self.basis, self.closing[:, :, None]], axis=2)

    @cached_property
    def turned(self) -> Floats:
        """(n, g + 1, V, 3) derivatives of the vectors along each of the directions.

        That of contacts along the closing step is of those which close a loop only nearly.
        """
        every = (self.at.body_rates(ways) for ways in np.moveaxis(self.directions, 2, 0))
        return np.stack([self.at.turned(w) for w in every], axis=1)

    @cached_property
    def bends(self) -> Floats:
        """(n, g + 1, V, V): how rates change that go on closing the loops.

        Along direction j of the whole rates x have to change by bends[j] x at least.
        """
        turned = (self.whole or self).turned
        n, many, count, _ = turned.shape
        bent = self.tree.jacobian(turned[:, :, self.kept].reshape(-1, len(self.kept), 3))
        bends = np.zeros((n, many, count, count))
        bends[:, :, self.kept[:, None], self.kept] = -self.inverse[:, None] @ bent.reshape(
            n, many, *bent.shape[1:]
        )
        return bends

    def along(self, ways: Floats) -> Floats:
        """Return the changes (n, V) that basis coordinates (n, k) stand for."""
        return np.einsum("nvk,nk->nv", self.basis, ways)


def decomposed(matrices: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """Return the singular value decompositions of matrices (n, j, k), and which are finite.

    Those that are not count as zero.
    """
    finite = all_finite(matrices, (1, 2))
    return *np.linalg.svd(np.where(finite[:, None, None], matrices, 0.0)), finite


def tangent_space(
    at: Linearisation,
    freedoms: int,
    like: Floats | None = None,
    part: OutputPart | None = None,
    whole: TangentSpace | None = None,
) -> TangentSpace:
    """Return the motions that close the loops at configurations; NaN where those are.

    Of the whole mechanism, or of a `part` of it. `like` (n, V, freedoms) are bases that
    those found are turned to as nearly as possible.
    """
    every = range(at.values.shape[1])
    tree, variables = (at.tree, every) if part is None else (part.tree, part.variables)
    kept = np.array(variables, dtype=np.intp)
    jacobian = tree.jacobian(at.vectors[:, kept])
    n, rows, count = jacobian.shape
    rank = count - freedoms
    left, sizes, right, finite = decomposed(jacobian)
    inner = np.swapaxes(right[:, rank:], 1, 2).copy()
    if like is not None:
        one, _, other = np.linalg.svd(np.swapaxes(inner, 1, 2) @ like[:, kept])
        inner = inner @ (one @ other)
    elif rows == rank and freedoms:
        sense = np.linalg.det(left) * np.linalg.det(right)
        inner[:, :, -1] *= np.where(sense < 0.0, -1.0, 1.0)[:, None]
    floor = np.maximum(REDUNDANT_EQUATION_RATIO * sizes[:, :1], TINY)
    sizable = np.where(sizes[:, :rank] > floor, sizes[:, :rank], np.inf)
    scaled = np.swapaxes(right[:, :rank], 1, 2) / sizable[:, None]
    inverse = scaled @ np.swapaxes(left[:, :, :rank], 1, 2)
    inner[~finite] = inverse[~finite] = np.nan
    basis = np.zeros((n, len(every), freedoms))
    basis[:, kept] = inner
    condition = np.ones(n)
    if rank:
        condition = sizes[:, rank - 1] / np.maximum(sizes[:, 0], TINY)
    return TangentSpace(
        at, tree, kept, basis, inverse, condition, rows == rank and like is None, whole
    )
