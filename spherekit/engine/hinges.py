"""Sliding contacts of circles as links that are hinged at both centres.

Where two circles touch, their centres keep their distance: a contact of circles moves its
links as a link between the centres does (two circles on a plane are a four-bar; the same
holds on the sphere). Positions and modes are then those of R pairs, and what rotations
lie between the turns of all pairs are numbers, three angles of Euler each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import EQUAL_CURVATURE
from spherekit.engine.algebra import Exprs
from spherekit.engine.expression_graph import Expr, function
from spherekit.engine.turns import (
    AxisRotation,
    AxisTerm,
    Chain,
    Entries,
    TurningPairs,
    turning_pairs,
)
from spherekit.errors import EngineError
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import LinkSizes, Mechanism, Pair, SizeGeometry
from spherekit.sphere.rotation import Floats, arc, cross


@final
@dataclass(frozen=True)
class Hinged:
    """A mechanism whose contacts are links, and the rotations between its turns.

    `constants` are those of the pairs of the given mechanism (`turning_pairs`), two of an R
    pair and three of a contact; `contacts` are the numbers of these. `turns` say how its
    variables follow from those of the given one.
    """

    mechanism: Mechanism
    contacts: tuple[int, ...]
    constants: tuple[tuple[Floats, ...], ...]
    turns: tuple[AxisRotation, ...]

    @property
    def numbers(self) -> list[float]:
        """The angles of all rotations (rad), in order."""
        every = [rotation for rotations in self.constants for rotation in rotations]
        return [angle for rotation in every for angle in _angles(rotation)]

    def values(self, given: Floats) -> Floats:
        """Return its variables (n, v) from those of the given mechanism (n, w)."""
        columns = [
            turn.scale * given[:, turn.variable] + turn.offset for turn in self.turns
        ]
        return np.stack(columns, axis=1)

    def pairs(self, given: Mapping[int, Expr]) -> TurningPairs:
        """Return the pairs of the mechanism with terms for some of the `numbers`."""
        chains: list[Chain] = []
        twin: dict[int, AxisTerm] = {}
        spins: list[tuple[AxisTerm, ...]] = []
        at = 0
        for number, rotations in enumerate(self.constants):
            made = []
            for constant in rotations:
                made.append(_constant(constant, at, given))
                at += 3
            parts: list[tuple[Entries, Entries]] = [(made[0], made[-1])]
            if number in self.contacts:
                parts = [(made[0], np.eye(3)), (made[1], made[2])]
            for first, second in parts:
                variable = len(chains)
                one, other = self.mechanism.ends[variable]
                chains.append(Chain((first, second), (AxisRotation(variable),)))
                spins.append((AxisTerm(1.0, one, first[:, 2]),))
                twin[variable] = AxisTerm(1.0, other, second[2])
        return TurningPairs(tuple(chains), tuple(spins), twin, {})


def hinged(mechanism: Mechanism) -> Hinged | None:
    """Return a mechanism with links for its contacts; None if some are of other kinds.

    Raises
    ------
    EngineError
        If profiles of a contact curve into each other.
    """
    joints = geometry_of(mechanism).joints
    contacts = [n for n, joint in enumerate(joints) if joint.tracks]
    # Curves that slide have a variable each.
    slide = all(len({track.variable for track in joints[n].tracks}) == 2 for n in contacts)
    if not contacts or not slide:
        return None
    try:
        chains = turning_pairs(mechanism).chains
    except EngineError:
        return None
    for n in contacts:
        bends = [
            float(track.curve.at(np.zeros(1)).curvature[0]) for track in joints[n].tracks
        ]
        if bends[0] - bends[1] < EQUAL_CURVATURE:
            raise EngineError(
                f"{mechanism.name}: pairs.{mechanism.pairs[n].name}: the profiles curve "
                "into each other, or alike"
            )
    constants = tuple(
        tuple(np.array(rotation, dtype=float) for rotation in chain.constants)
        for chain in chains
    )
    pairs: list[Pair] = []
    axes: dict[str, dict[str, Floats]] = {link: {} for link in mechanism.links}
    for n, (pair, rotations) in enumerate(zip(mechanism.pairs, constants, strict=True)):
        one, other = pair.links
        if n not in contacts:
            pairs.append(pair)
            axes[one][pair.name] = rotations[0][:, 2]
            axes[other][pair.name] = rotations[1][2]
            continue
        bar = f"centres_{pair.name}"
        while bar in mechanism.links:
            bar += "_"
        near, far = (Pair(f"{bar}_{link}", "R", ends) for link, ends in _ends(pair, bar))
        pairs += [near, far]
        axes[one][near.name] = rotations[0][:, 2]
        axes[bar] = {near.name: np.array([0.0, 0.0, 1.0]), far.name: rotations[1][:, 2]}
        axes[other][far.name] = rotations[2][2]
    sizes = {link: _sizes(directions) for link, directions in axes.items()}
    made = replace(
        mechanism,
        links=tuple(axes),
        pairs=tuple(pairs),
        geometry=SizeGeometry(sizes),
        stops=(),
    )
    turns = [turn for chain in chains for turn in chain.turns]
    round_ones = tuple(turn for turn in turns if isinstance(turn, AxisRotation))
    return Hinged(made, tuple(contacts), constants, round_ones)


def _ends(pair: Pair, bar: str) -> tuple[tuple[str, tuple[str, str]], ...]:
    one, other = pair.links
    return (one, (one, bar)), (other, (bar, other))


def _sizes(axes: Mapping[str, Floats]) -> LinkSizes:
    """Return how axes (3,) of a link lie to each other; its frame is another one."""
    names, every = tuple(axes), list(axes.values())
    arcs = tuple(float(arc(every[0], axis)) for axis in every[1:])
    normals = [cross(every[0], axis) for axis in every[1:]]
    angles = tuple(_turn(every[0], normals[0], normal) for normal in normals[1:])
    return LinkSizes(names, arcs, angles)


def _turn(axis: Floats, one: Floats, other: Floats) -> float:
    return float(np.arctan2(np.dot(axis, cross(one, other)), np.dot(one, other)))


def _angles(rotation: Floats) -> tuple[float, float, float]:
    """Return a, b, c of a rotation Z(a) Y(b) Z(c)."""
    x, y, z = rotation[:, 2]
    a = float(np.arctan2(y, x)) if np.hypot(x, y) > 0.0 else 0.0
    b = float(np.arctan2(np.hypot(x, y), z))
    rest = (_about_y(b).T @ _about_z(a).T).astype(float) @ rotation
    return a, b, float(np.arctan2(rest[1, 0], rest[0, 0]))


def _constant(rotation: Floats, at: int, given: Mapping[int, Expr]) -> Entries:
    """Return a rotation with terms for those of its three angles that are given."""
    if not any(at + k in given for k in range(3)):
        return rotation
    a, b, c = (given.get(at + k, angle) for k, angle in enumerate(_angles(rotation)))
    return np.asarray(_about_z(a) @ _about_y(b) @ _about_z(c))


def _about_z(angle: Expr) -> Exprs:
    c, s = _cosine(angle), _sine(angle)
    return _matrix([[c, -1.0 * s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_y(angle: Expr) -> Exprs:
    c, s = _cosine(angle), _sine(angle)
    return _matrix([[c, 0.0, s], [0.0, 1.0, 0.0], [-1.0 * s, 0.0, c]])


def _matrix(rows: Sequence[Sequence[Expr]]) -> Exprs:
    return np.array(rows, dtype=object)


def _sine(angle: Expr) -> Expr:
    return float(np.sin(angle)) if isinstance(angle, float) else function("sin", angle)


def _cosine(angle: Expr) -> Expr:
    return float(np.cos(angle)) if isinstance(angle, float) else function("cos", angle)
