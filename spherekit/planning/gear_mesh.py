"""Wheels on carriers: how a rolling contact relates the angles of pairs."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.vectors import max_abs

SAME_LENGTH = 1e-7
"""Lengths (rad) that differ by less are one."""


MOST_TURNS = 2
"""Whole turns of wheels that are tried, one of many wheels."""


MOST_ASSEMBLIES = 400_000
"""So many assemblies of wheels at most."""


Way = tuple[tuple[int, int], ...]
"""Pairs, each with the side of the link that is nearer to the start of the way."""


class GearMesh(NamedTuple):
    """Two wheels on a carrier: by which pairs each is turned in it, and the signs.

    `contact` is the number of the rolling contact among the pairs of the mechanism. `ways`
    have the pairs from each wheel to the carrier, each with the side of the link that is
    nearer to the wheel.
    """

    contact: int
    turned: tuple[Mapping[int, float], Mapping[int, float]]
    ways: tuple[Way, Way]

    @property
    def pairs(self) -> set[int]:
        """The pairs whose angles it relates."""
        return {*self.turned[0], *self.turned[1]}

    def relation(self, sizes: tuple[Any, Any]) -> dict[int, Any]:
        """Return the factors by pair of the sum of angles that stays the same.

        `sizes` are those of the angles of both wheels: sin(r) and -sin(s).
        """
        return {
            pair: size if sign > 0.0 else -size
            for size, turned in zip(sizes, self.turned, strict=True)
            for pair, sign in turned.items()
        }


def back(way: Way) -> Way:
    """Return a way from its end to its start."""
    return tuple((pair, 1 - side) for pair, side in reversed(way))


def least_rolled(
    lengths: Floats, laps: Floats, first: Floats, square: Floats
) -> Integers | None:
    """Return the whole turns (m, 2) of wheels with which they have rolled least.

    Of those that have rolled as far, the ones with the greatest first length; None where
    there are too many to be tried. Only turns that lengths differ by are.

    Parameters
    ----------
    lengths, laps
        (m, 2) along both circles of each contact where all angles are zero, and those of
        a whole turn.
    first, square
        (m, m) by how much a length decreases with the angles that follow, along the first
        circle, and by how much more than along the second.
    """
    to_angles = np.linalg.inv(square)
    put = lengths[:, 0] - first @ to_angles @ (lengths[:, 0] - lengths[:, 1])
    steps: list[Floats] = []
    places = []
    for k, side in np.ndindex(*laps.shape):
        step = first @ to_angles[:, k] * (2 * side - 1)
        step[k] += 1 - side
        step *= laps[k, side]
        signed = (sense * earlier for earlier in (*steps, 0.0 * step) for sense in (1, -1))
        if all(max_abs(step - item) > SAME_LENGTH for item in signed):
            steps.append(step)
            places.append((k, side))
    most = min(MOST_TURNS, int(0.5 * (MOST_ASSEMBLIES ** (1.0 / len(steps)) - 1.0)))
    if most < 1:
        return None
    counts = np.indices((2 * most + 1,) * len(steps)).reshape(len(steps), -1).T - most
    turns = np.zeros(laps.shape, dtype=np.int64)
    turns[*np.transpose(places)] = counts[_least(put + counts @ np.array(steps))]
    return turns


def _least(rolled: Floats) -> Any:
    """Return which lengths (n, m) are the least in sum, then the greatest one by one."""
    keys = np.column_stack([np.sum(np.abs(rolled), axis=1), -rolled])
    return np.lexsort(np.round(keys / SAME_LENGTH).T[::-1])[0]
