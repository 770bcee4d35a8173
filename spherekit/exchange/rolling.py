"""What a rolling contact of circles says of hinges: a constant ratio of their rates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.errors import ModelError
from spherekit.model.mechanism import Mechanism, Pair
from spherekit.motion.linearisation import Linearisation
from spherekit.sphere.rotation import Floats

ONE_LINE = 1e-9
"""Sine below which an axis passes through the centre of a circle."""


@final
@dataclass(frozen=True)
class Ratio:
    """A rolling contact as an equation: factors by hinge, whose sum of rates is zero."""

    pair: str
    factors: Mapping[str, float]


def ratio_of(
    mechanism: Mechanism,
    at: Linearisation,
    number: int,
    ways: Sequence[tuple[int, int, int]],
) -> Ratio:
    """Return what the contact of a number says of the hinges of a tree.

    Parameters
    ----------
    at
        One configuration.
    ways
        The tree: (pair, parent, child).

    Raises
    ------
    ModelError
        Unless two circles roll that turn about their centres on one carrier.

    Notes
    -----
    On the way through the tree from the first link a to the second b all hinges lie first
    along the axis A of the first circle, then along B. Rolling, w_b - w_a = x A + y B has
    the direction of the contact p: x (A x p) . n + y (B x p) . n = 0 with n along A x B.
    """
    pair = mechanism.pairs[number]
    first, second = mechanism.ends[number]
    centres = _centres(mechanism, at, pair)
    p = at.frames[0, number, :, 2]
    n = np.cross(centres[0], centres[1])
    weights = [float(np.cross(centre, p) @ n) for centre in centres]
    factors: dict[str, float] = {}
    side = 0
    for hinge, sense in _between(ways, mechanism.ends, first, second):
        axis = at.frames[0, hinge, :, 2]
        if side == 0 and not _on_one_line(axis, centres[0]):
            side = 1
        name = mechanism.pairs[hinge].name
        if not _on_one_line(axis, centres[side]):
            raise _no_ratio(
                mechanism, pair, f"hinge {name} between its links lies along neither centre"
            )
        factors[name] = sense * float(np.sign(axis @ centres[side])) * weights[side]
    most = max(abs(factor) for factor in factors.values())
    return Ratio(pair.name, {name: factor / most for name, factor in factors.items()})


def _centres(mechanism: Mechanism, at: Linearisation, pair: Pair) -> list[Floats]:
    """Return the centres (3,) of both circles in ground axes."""
    if pair.type != "Cr" or pair.profiles is None:
        raise _no_ratio(mechanism, pair, f"a {pair.kind.words} has none")
    centres = []
    for link, profile in zip(pair.links, pair.profiles, strict=True):
        if profile.round_axis is None:
            raise _no_ratio(mechanism, pair, f"the profile of link {link} is no circle")
        turn = at.placed[0, mechanism.link_number[link]]
        centres.append(turn @ np.array(profile.round_axis))
    return centres


def _between(
    ways: Sequence[tuple[int, int, int]],
    ends: Sequence[tuple[int, int]],
    first: int,
    second: int,
) -> list[tuple[int, float]]:
    """Return the pairs from one link to another, and whether each is passed forwards."""
    up = {child: (pair, parent) for pair, parent, child in ways}

    def to_root(link: int) -> list[int]:
        path = []
        while link in up:
            pair, link = up[link]
            path.append(pair)
        return path

    one, other = to_root(first), to_root(second)
    while one and other and one[-1] == other[-1]:
        one.pop()
        other.pop()
    passed, link = [], first
    for pair in [*one, *reversed(other)]:
        forwards = ends[pair][0] == link
        passed.append((pair, 1.0 if forwards else -1.0))
        link = ends[pair][1] if forwards else ends[pair][0]
    return passed


def _on_one_line(axis: Floats, other: Floats) -> bool:
    return float(np.linalg.norm(np.cross(axis, other))) < ONE_LINE


def _no_ratio(mechanism: Mechanism, pair: Pair, why: str) -> ModelError:
    return ModelError(
        f"{mechanism.name}: pairs.{pair.name}: bodies on hinges express R pairs, and "
        f"rolling circles that turn about their centres on one carrier, whose ratio is "
        f"constant; {why}. Leave the pair out of a copy of the file, or lock it away"
    )
