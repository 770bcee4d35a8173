"""Orientations of links as expressions of the pair variables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.mechanism.graph import spanning
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linearisation import LoopTree
from spherekit.symbolic.expression_graph import Expr, function
from spherekit.symbolic.vector_algebra import Exprs, constants, vector
from spherekit.velocities.axis_rotations import (
    AxisRotation,
    Entries,
    JointTransform,
    TurningPairs,
)


@dataclass(frozen=True)
class LinkOrientation:
    """The orientation of a link: R = basis @ within, from link axes to ground axes.

    `basis` (3, 3) holds expressions, `within` (3, 3) numbers or terms of sizes. `depth`
    counts what had to be placed before: directions are cheapest in the least deep of the
    links that hold them.
    """

    basis: Exprs
    within: Entries
    depth: int

    def direction(self, axis: Entries) -> Exprs:
        """Return a vector (3,) fixed in the link, or columns (3, 3), in ground axes."""
        return self.basis @ self.fixed(axis)

    def fixed(self, axis: Entries) -> Exprs:
        """Return what `seen` gives for a vector fixed in the link: numbers."""
        return constants(self.within @ axis)

    def seen(self, given: Exprs) -> Exprs:
        """Return the components (3,) of a vector in ground axes along the basis."""
        return self.basis.T @ given

    def tensor(self, inertia: Entries) -> Exprs:
        """Return M (3, 3) with w . I w = y . M y for y = `seen(w)`, I in link axes."""
        return constants(self.within @ inertia @ self.within.T)


GROUND = LinkOrientation(constants(np.eye(3)), np.eye(3), 0)
"""The placement of the ground in its own axes."""


def placed_by(
    chain: JointTransform, start: LinkOrientation, variables: Sequence[Expr]
) -> LinkOrientation:
    """Return the placement of a link that a chain of turns joins to a placed one."""
    basis, within = start.basis, start.within
    for constant, turn in zip(chain.constants, chain.turns, strict=False):
        basis = basis @ constants(within @ constant)
        within = np.eye(3)
        if not isinstance(turn, AxisRotation):
            basis = basis @ turn
            continue
        sense = 1.0 if turn.scale > 0.0 else -1.0
        angle = abs(turn.scale) * variables[turn.variable] + sense * turn.offset
        cosine, sine = function("cos", angle), sense * function("sin", angle)
        basis = np.stack(
            [
                basis[:, 0] * cosine + basis[:, 1] * sine,
                basis[:, 1] * cosine - basis[:, 0] * sine,
                basis[:, 2],
            ],
            axis=1,
        )
    return LinkOrientation(basis, chain.constants[-1], start.depth + 1)


def place_by_variables(
    mechanism: Mechanism,
    pairs: TurningPairs,
    variables: Sequence[Expr],
    ways: Iterable[tuple[int, int, int]] | None = None,
) -> list[LinkOrientation]:
    """Return the placements of links on ways, those of others where the ground is.

    `ways` are pairs with the links that they lead from and to, in order: by default the
    shortest ways from the ground to all links.
    """
    placed = [GROUND] * len(mechanism.links)
    for pair, parent, child in spanning(mechanism.ends) if ways is None else ways:
        chain = pairs.chains[pair]
        if mechanism.ends[pair][0] != parent:
            chain = chain.reversed()
        placed[child] = placed_by(chain, placed[parent], variables)
    return placed


def along_ways(tree: LoopTree, parts: Sequence[Exprs]) -> list[Exprs]:
    """Return for each link the sum (3,) of the parts of pairs on the way to it."""
    sums = [vector([0.0, 0.0, 0.0])] * tree.count
    for pair, parent, child in tree.placements:
        ahead, part = tree.ends[pair][0] == parent, parts[pair]
        sums[child] = sums[parent] + part if ahead else sums[parent] - part
    return sums
