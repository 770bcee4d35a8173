"""Orientations of links as expressions of the pair variables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs, constants, cross, vector
from spherekit.engine.expression_graph import Expr, function
from spherekit.engine.turns import AxisRotation, Chain, Entries, ProfileFrame, TurningPairs
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism


@final
@dataclass(frozen=True)
class LinkOrientation:
    """The orientation of a link: R = basis @ within, from link axes to ground axes.

    `basis` (3, 3) holds expressions, `within` (3, 3) numbers or terms of sizes. The basis
    need not be orthonormal; `metric` is its Gram matrix. `depth` counts what had to be
    placed before: directions are cheapest in the least deep of the links that hold them.
    """

    basis: Exprs
    within: Entries
    metric: Entries
    depth: int

    def direction(self, axis: Entries) -> Exprs:
        """Return a vector (3,) fixed in the link, in ground axes."""
        return np.asarray(self.basis @ constants(self.within @ axis))

    def fixed(self, axis: Entries) -> Exprs:
        """Return what `seen` gives for a vector fixed in the link: numbers."""
        return constants(self.metric @ (self.within @ axis))

    def seen(self, given: Exprs) -> Exprs:
        """Return the components (3,) of a vector in ground axes along the basis."""
        return np.asarray(self.basis.T @ given)

    def tensor(self, inertia: Entries) -> Exprs:
        """Return M (3, 3) with w . I w = y . M y for y = `seen(w)`, I in link axes."""
        return constants(self.within @ inertia @ self.within.T)


def ground_placement() -> LinkOrientation:
    """Return the placement of the ground in its own axes."""
    return LinkOrientation(constants(np.eye(3)), np.eye(3), np.eye(3), 0)


@final
@dataclass(frozen=True)
class Angles:
    """Sine and cosine of each turn, formed once."""

    variables: Sequence[Expr]

    def of(self, turn: AxisRotation) -> tuple[Expr, Expr]:
        """Return the cosine and the sine of a turn."""
        angle = self.variables[turn.variable]
        sense = 1.0 if turn.scale > 0.0 else -1.0
        scale, offset = abs(turn.scale), sense * turn.offset
        if scale != 1.0:
            angle = scale * angle
        if offset != 0.0:
            angle = angle + offset
        return function("cos", angle), sense * function("sin", angle)


def placed_by(chain: Chain, start: LinkOrientation, angles: Angles) -> LinkOrientation:
    """Return the placement of a link that a chain of turns joins to a placed one."""
    basis, within = start.basis, start.within
    for constant, turn in zip(chain.constants, chain.turns, strict=False):
        basis = basis @ constants(within @ constant)
        within = np.eye(3)
        if isinstance(turn, ProfileFrame):
            basis = basis @ turn.frame
            continue
        cosine, sine = angles.of(turn)
        basis = np.stack(
            [
                basis[:, 0] * cosine + basis[:, 1] * sine,
                basis[:, 1] * cosine - basis[:, 0] * sine,
                basis[:, 2],
            ],
            axis=1,
        )
    return LinkOrientation(basis, chain.constants[-1], np.eye(3), start.depth + 1)


def place_by_variables(
    mechanism: Mechanism, pairs: TurningPairs, variables: Sequence[Expr]
) -> list[LinkOrientation]:
    """Return the placements of all links along the shortest ways from the ground."""
    return placed_along(mechanism, pairs, Angles(variables), spanning(mechanism.ends))


def placed_along(
    mechanism: Mechanism,
    pairs: TurningPairs,
    angles: Angles,
    ways: Iterable[tuple[int, int, int]],
) -> list[LinkOrientation]:
    """Return the placements of links on ways, those of others where the ground is.

    `ways` are pairs with the links that they lead from and to, in order.
    """
    placed = [ground_placement()] * len(mechanism.links)
    for pair, parent, child in ways:
        chain = pairs.chains[pair]
        ahead = mechanism.ends[pair][0] == parent
        placed[child] = placed_by(
            chain if ahead else chain.reversed(), placed[parent], angles
        )
    return placed


@final
@dataclass(frozen=True)
class Spin:
    """A part of a variable's vector in ground axes: `size` times an `axis` (3,).

    It turns with a link, and slides on it by `slide` (3,) per unit of the variable.
    """

    size: float
    link: int
    axis: Exprs
    slide: Exprs | None

    def change(self, w: Exprs, rate: Expr) -> Exprs:
        """Return the rate (3,) of the axis while the link turns and the variable runs."""
        turned = cross(w, self.axis)
        return turned if self.slide is None else np.asarray(turned + self.slide * rate)


def spin_vectors(
    pairs: TurningPairs, placed: Sequence[LinkOrientation], variable: int
) -> tuple[Spin, ...]:
    """Return the parts of a variable's vector."""
    spins = pairs.spins[variable]
    if variable in pairs.twin:
        other = pairs.twin[variable]
        if placed[other.link].depth < placed[spins[0].link].depth:
            spins = (other,)

    def placed_as(link: int, axis: Entries) -> Exprs:
        return vector(list(placed[link].direction(axis)))

    return tuple(
        Spin(
            spin.size,
            spin.link,
            placed_as(spin.link, spin.axis),
            None if spin.slide is None else placed_as(spin.link, spin.slide),
        )
        for spin in spins
    )
