"""How surely the locked inputs of a mechanism hold an output: the measure of type II.

Let the rates of all pairs misfit: the rates of the two links of pair e differ by what the
pair allows and by a misfit m_e besides. With the inputs locked, the misfits needed at least
to turn the output at unit rate are its transmission, the root of the sum of their squares,
in parts of that which is needed with every pair locked:

    transmission^2 = rho min (sum |m_e|^2)   over all rates that turn the output by 1,

where rho is the resistance between the output and the link it is seen from in the graph
whose edges are the pairs. It is 0 exactly where the output can turn with the inputs at
rest, whatever the reason: a singular Jacobian of the output, or loops that lose their rank.
It is 1 if every pair is locked, and 1 / transmission is by how much the output gives way
more than that if pairs have play. Misfits that go around no loop turn the output alone; the
others, J x on an orthonormal basis of the cycles of the graph for rates x of the passive
pairs, give transmission^-2 = 1 + |A J^+|^2 / rho with A x the part of x on the way to the
output. No choice of loops, ground, frame or unit of a variable changes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import LoopTree

SINGULAR = 1e-6
"""A configuration whose transmission is less is at a singularity of type II: the output is
known to less than half the digits of the inputs."""
LOOSE = 1e10
"""Motions whose singular value is less than its reciprocal are held by rounding alone."""
STILL = 1e-8
"""A motion that turns the output by less than this part of its size leaves it at rest."""
ROWS = 4096
"""Rows computed at once."""


@dataclass(frozen=True)
class Transmission:
    """The measure of one output of a mechanism.

    Attributes
    ----------
    tree
        The loops.
    driven
        Numbers of the variables that the inputs lock.
    link, relative_to
        Numbers of the bodies that the output joins.
    direction
        What the output points at, in the axes of its link, so that turning about it does
        not count; None where its whole orientation does.
    """

    tree: LoopTree
    driven: tuple[int, ...]
    link: int
    relative_to: int
    direction: tuple[float, float, float] | None = None

    @staticmethod
    def of(mechanism: Mechanism, output: Output) -> "Transmission":
        """Return the measure of an output with the mechanism's inputs locked.

        With two inputs an output that declares a direction points.
        """
        held = [mechanism.variables_of(pair)[0] for pair in driven_pairs(mechanism)]
        number = mechanism.link_number
        return Transmission(
            LoopTree.of(mechanism),
            tuple(held),
            number[output.link],
            number[output.relative_to],
            output.direction if len(held) == 2 else None,
        )

    def of_values(self, closure: Closure, values: Floats) -> Floats:
        """Return the transmission (n,) of configurations (n, variables); NaN for NaN."""
        there = closure.at(values)
        return self.at(there.vectors, self.pointed(there.placed))

    def pointed(self, placed: Floats) -> Floats | None:
        """Return the directions (n, 3) of a pointing output of bodies (n, bodies, 3, 3)."""
        if self.direction is None:
            return None
        return placed[:, self.link] @ np.array(self.direction)

    @np.errstate(over="ignore")
    def at(self, vectors: Floats, directions: Floats | None = None) -> Floats:
        """Return the transmission (n,), from 0 at a singularity of type II to 1.

        Parameters
        ----------
        vectors
            (n, variables, 3) angular velocities of the pairs' second links relative to
            the first per unit rate of each variable, or along them, in any one frame.
        directions
            (n, 3) what a pointing output points at, in the same frame: turning about it
            does not count.
        """
        transmission = nans(len(vectors))
        finite = all_finite(vectors, (1, 2))
        if directions is not None:
            finite &= all_finite(directions, 1)
        rows = np.flatnonzero(finite)
        owners = [self.tree.owners[v] for v in passive(self.tree, self.driven)]
        for start in range(0, len(rows), ROWS):
            some = rows[start : start + ROWS]
            columns, loops = passive_equations(self.tree, self.driven, vectors[some])
            lacking = max(0, len(owners) - loops.shape[1])
            loops = np.pad(loops, ((0, 0), (0, lacking), (0, 0)))
            way = self._way[owners] * columns
            if directions is not None:
                axes = directions[some][:, :, None]
                way -= axes * np.sum(axes * way, axis=1, keepdims=True)
            inverse = left_inverse(loops)
            gives = way @ inverse
            weak = ~(max_abs(inverse, (1, 2)) < LOOSE)
            gives[weak] = _by_singular_values(way[weak], loops[weak])
            size = np.linalg.norm(gives, 2, axis=(1, 2))
            transmission[some] = 1.0 / np.sqrt(1.0 + size**2 / (self._way @ self._way))
        return transmission

    @cached_property
    def _way(self) -> Floats:
        """(pairs,) of a current of 1 from the link the output is seen from to its own."""
        ways = np.linalg.pinv(self.tree.incidence.T, rcond=1e-9)
        return ways[:, self.link] - ways[:, self.relative_to]


def passive(tree: LoopTree, driven: Sequence[int]) -> list[int]:
    """Return the numbers of the variables that no input locks."""
    return [v for v in range(len(tree.owners)) if v not in driven]


def passive_equations(
    tree: LoopTree, driven: Sequence[int], vectors: Floats
) -> tuple[Floats, Floats]:
    """Return orthonormal vectors (n, 3, passive) and the loops (n, 3 loops, passive).

    The loops are those of an orthonormal basis of the cycles, so that their singular
    values are the sines of the angles between the rates that the passive pairs allow and
    those that bodies can have.
    """
    free = passive(tree, driven)
    columns = np.swapaxes(_units(tree, vectors)[:, free], 1, 2)
    through = tree.cycles[:, [tree.owners[v] for v in free]]
    loops = through[:, None] * columns[:, None]
    return columns, loops.reshape(len(vectors), 3 * len(through), len(free))


def hold(tree: LoopTree, driven: Sequence[int], vectors: Floats) -> Floats:
    """Return (2, n) how locked inputs hold all links, and the part of the greatest hold.

    That is the least singular value of `passive_equations`, and its ratio to the
    greatest; 0 where any link can move with the inputs at rest, 1 without passive pairs,
    NaN where the vectors are.
    """
    made = nans((2, len(vectors)))
    finite = all_finite(vectors, (1, 2))
    _, loops = passive_equations(tree, driven, vectors[finite])
    equations, free = loops.shape[1:]
    if not free:
        made[:, finite] = 1.0
    elif equations < free:
        made[:, finite] = 0.0
    else:
        sizes = np.linalg.svd(loops, compute_uv=False)
        made[:, finite] = sizes[:, -1], sizes[:, -1] / sizes[:, 0]
    return made


def _units(tree: LoopTree, vectors: Floats) -> Floats:
    """Return orthonormal vectors (n, variables, 3) for the variables of each pair."""
    sizes = np.linalg.norm(vectors, axis=2, keepdims=True)
    units = vectors / np.where(sizes > 0.0, sizes, 1.0)
    for v, owner in enumerate(tree.owners):
        if v and tree.owners[v - 1] == owner:
            one, other = units[:, v - 1], units[:, v]
            other -= one * np.sum(one * other, axis=1, keepdims=True)
            size = np.linalg.norm(other, axis=1, keepdims=True)
            other /= np.where(size > 0.0, size, 1.0)
    return units


def _by_singular_values(way: Floats, loops: Floats) -> Floats:
    """Return `way` times the pseudo-inverse of `loops`, (n, 3, equations).

    Motions that rounding alone holds, or nothing, are as good as infinite where the output
    moves in them, and do not count where it rests.
    """
    left, sizes, right = np.linalg.svd(loops, full_matrices=False)
    moved = way @ np.swapaxes(right, 1, 2)
    still = (sizes < 1.0 / LOOSE) & (np.linalg.norm(moved, axis=1) < STILL)
    by = np.where(still, 0.0, 1.0 / np.maximum(sizes, 1e-300))
    return (moved * by[:, None]) @ np.swapaxes(left, 1, 2)
