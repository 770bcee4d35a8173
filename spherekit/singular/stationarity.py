"""The motions that close the loops, and what stands still in singular ones.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular: where the
inputs stand still (type II) in a motion, or the output (type I).

The configuration manifold to second order: its tangent space and how that turns.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import nearest
from spherekit.errors import AnalysisError
from spherekit.model.gears import link_axes
from spherekit.model.mechanism import Mechanism, chosen_output
from spherekit.motion.loops import REDUNDANT, Linearisation, LoopTree
from spherekit.planning.inputs import Assembly
from spherekit.planning.part import moving_pairs
from spherekit.planning.poles import Pole, pole_of
from spherekit.sphere.rotation import all_finite, cross, perpendicular

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
    floor = np.maximum(REDUNDANT * sizes[:, :1], TINY)
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


@dataclass(frozen=True)
class InputsLocked:
    """The inputs' variables stand still."""

    variables: tuple[int, ...]

    @property
    def count(self) -> int:
        """The number of inputs."""
        return len(self.variables)

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""
        chosen = np.eye(at.values.shape[1])[list(self.variables)]
        return np.tile(chosen, (len(at), 1, 1))

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        n, variables, many = space.directions.shape
        return np.zeros((n, many, self.count, variables))


@dataclass(frozen=True)
class OutputStationary:
    """A link does not turn, or a direction in it does not move, relative to another link.

    `link`, `relative_to` are numbers of bodies of the loops. `pointing` is a unit vector
    in the link's axes, or None where its whole orientation is the output. `way` (V,) is
    the sense in which each variable turns the link, along any way of pairs to it: by
    default along the tree of the loops.
    """

    link: int
    relative_to: int
    pointing: tuple[float, float, float] | None = None
    way: tuple[float, ...] | None = None

    @property
    def pole(self) -> Pole:
        """The two links, smaller number first."""
        return pole_of(self.link, self.relative_to)

    @property
    def count(self) -> int:
        """The freedoms that the output has: 3 of an orientation, 2 of a direction."""
        return 3 if self.pointing is None else 2

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        at = space.at
        watched, turning = self._watched_at(at)
        of_link = at.tree.paths[self.link][:, None] * at.vectors
        w = np.einsum("nvg,nvk->ngk", space.directions, of_link)
        moved = cross(w[:, :, None], watched[:, None])
        turned = self._between(at)[:, None] * space.turned
        change = moved @ np.swapaxes(turning, 1, 2)[:, None]
        return change + watched[:, None] @ np.swapaxes(turned, 2, 3)

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""
        watched, turning = self._watched_at(at)
        return watched @ np.swapaxes(turning, 1, 2)

    def _between(self, at: Linearisation) -> Floats:
        """Return how variables turn the output: (V,) 1, -1, or 0 for no part in it."""
        if self.way is not None:
            return np.array(self.way)
        return at.tree.paths[self.link] - at.tree.paths[self.relative_to]

    def _watched_at(self, at: Linearisation) -> tuple[Floats, Floats]:
        """Return directions (n, m, 3) about which the link may not turn, and what turns it.

        The latter (n, V, 3), the former all axes, or those across the direction.
        """
        axes = np.eye(3)
        if self.pointing is not None:
            direction = np.array(self.pointing)
            side = perpendicular(direction)
            axes = np.stack([side, cross(direction, side)], axis=1)
        watched = np.swapaxes(at.placed[:, self.link] @ axes, 1, 2)
        return watched, self._between(at)[:, None] * at.vectors

    def orientation(self, at: Linearisation) -> Floats:
        """Return (n, 3, 3), from the link's axes to those of the reference link."""
        return np.swapaxes(at.placed[:, self.relative_to], 1, 2) @ at.placed[:, self.link]

    def angular_velocity(self, space: TangentSpace, rates: Floats) -> Floats:
        """Return (n, k, 3) in the axes of body 0, of k rates (n, V, k)."""
        turning = self._between(space.at)[:, None] * space.at.vectors
        return np.einsum("nvk,nvd->nkd", rates, turning)


StationarityConstraint = InputsLocked | OutputStationary
"""Linear equations E x = 0 in the rates x of the variables."""


def output_of(
    mechanism: Mechanism,
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
) -> OutputStationary:
    """Return an output of a mechanism, by default its first one.

    Parameters
    ----------
    mechanism
        A mechanism that names outputs.
    output
        Name of an output.
    pointing
        Name of an R pair on the output's link, whose axis is the direction that counts,
        or a vector (3,) in that link's axes. By default, with two inputs, the direction
        that the output declares; else the link's orientation counts.

    Raises
    ------
    ModelError
        If there is no such output.
    AnalysisError
        If there is no such direction.
    """
    several = output is None and len(mechanism.outputs) > 1
    chosen = mechanism.outputs[0] if several else chosen_output(mechanism, output)
    number = mechanism.link_number
    direction = chosen.direction if len(mechanism.inputs) == 2 else None
    if pointing is not None:
        direction = _direction(mechanism, chosen.link, pointing)
    return OutputStationary(number[chosen.link], number[chosen.relative_to], direction)


def _direction(
    mechanism: Mechanism, link: str, pointing: str | Sequence[float]
) -> tuple[float, float, float]:
    if isinstance(pointing, str):
        axes = link_axes(mechanism)[link]
        if pointing not in axes:
            raise AnalysisError(
                f'{mechanism.name}: no R pair "{pointing}" is on link {link}'
                f"{nearest(pointing, axes) or ';'} R pairs: {', '.join(axes)}"
            )
        vector = axes[pointing]
    else:
        vector = np.asarray(pointing, dtype=float)
        size = np.linalg.norm(vector) if vector.shape == (3,) else np.nan
        if not 0.0 < size < np.inf:
            raise AnalysisError(
                f"{mechanism.name}: a pointing direction is a vector of three numbers, not "
                f"all zero, in the axes of link {link}; {pointing!r} is none"
            )
        vector = vector / size
    x, y, z = vector.tolist()
    return x, y, z
