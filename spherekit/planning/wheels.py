"""Wheels on carriers: how a rolling contact relates the angles of pairs.

Two wheels that one link carries, each about the centre of its circle, turn relative to
it by angles f and g with sin(r) f - sin(s) g constant, r and s the radii, both centres
on the side of the contact's normal: a linear relation of the angles of the pairs between
them. That the wheels touch is then said twice, by the contact and by the carrier.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.joints import Joint, revolute
from spherekit.sphere.rotation import Floats, cross

ONE_LINE = 1e-9
"""Axes (rad) that differ by less are one; circles that miss by less touch."""
SAME_LENGTH = 1e-7
"""Lengths (rad) that differ by less are one."""
MOST_TURNS = 2
"""Whole turns of wheels that are tried, one of many wheels."""
MOST_ASSEMBLIES = 400_000
"""So many assemblies of wheels at most."""

Way = tuple[tuple[int, int], ...]
"""Pairs, each with the side of the link that is nearer to the start of the way."""
Axes = Mapping[int, tuple[Floats, Floats]]
"""Axes (3,) of R pairs in their first and second link, by number."""


class _Signed(Protocol):
    def __neg__(self: "Number") -> "Number": ...


Number = TypeVar("Number", bound=_Signed)


@final
@dataclass(frozen=True)
class _Centre:
    """A wheel seen from another link: its centre (3,) there, and how it turns about it.

    `turned` are the pairs whose angles add up to that of the wheel, with their signs.
    """

    line: Floats
    turned: Mapping[int, float]
    way: Way


@final
@dataclass(frozen=True)
class Mesh:
    """Two wheels on a carrier: by which pairs each is turned in it, and the signs.

    `contact` is the number of the rolling contact among the pairs of the mechanism. `ways`
    have the pairs from each wheel to the carrier, each with the side of the link that is
    nearer to the wheel.
    """

    contact: int
    carrier: int
    turned: tuple[Mapping[int, float], Mapping[int, float]]
    ways: tuple[Way, Way]

    @property
    def pairs(self) -> set[int]:
        """The pairs whose angles it relates."""
        return {*self.turned[0], *self.turned[1]}

    def relation(self, sizes: tuple[Number, Number]) -> dict[int, Number]:
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


def axes_of(joints: Sequence[Joint], pairs: Iterable[int] | None = None) -> Axes:
    """Return the axes of R pairs, of all or of some of them."""
    numbers = range(len(joints)) if pairs is None else pairs
    made = {n: revolute(joints[n]) for n in numbers if joints[n].has_axis}
    return {n: (joint.first[:, 2], joint.second[:, 2]) for n, joint in made.items()}


def mesh_of(
    ends: Sequence[tuple[int, int]],
    axes: Axes,
    contact: tuple[int, tuple[int, int]],
    centres: tuple[Floats, Floats],
    cosine: float | None = None,
    apart: float = ONE_LINE,
) -> Mesh | None:
    """Return how the nearest carrier holds the wheels of a contact, None if none does.

    Parameters
    ----------
    ends, axes
        The links of pairs, and the axes of those R pairs that a way may take.
    contact
        Its number, and the links that are its wheels.
    centres
        (3,) of the circles, each in its link.
    cosine, apart
        That of the arc between centres of circles that touch, and by how much the arc on a
        carrier may miss it; by default anything.
    """
    number, wheels = contact
    tables = [
        _seen_from_links(ends, axes, wheel, centre)
        for wheel, centre in zip(wheels, centres, strict=True)
    ]
    best = None
    for link in sorted(set(tables[0]) & set(tables[1])):
        one, other = tables[0][link], tables[1][link]
        touch = cosine is None or abs(float(one.line @ other.line) - cosine) <= apart
        if touch and not _one_line(one.line, other.line):
            made = Mesh(number, link, (one.turned, other.turned), (one.way, other.way))
            if best is None or len(made.pairs) < len(best.pairs):
                best = made
    return best


def _seen_from_links(
    ends: Sequence[tuple[int, int]], axes: Axes, wheel: int, centre: Floats
) -> dict[int, _Centre]:
    """Return the links relative to which a wheel turns about its centre only."""
    reached = {wheel: _Centre(centre, {}, ())}
    waiting = [wheel]
    while waiting:
        link = waiting.pop(0)
        here = reached[link]
        for pair, two in axes.items():
            if link not in ends[pair]:
                continue
            side = ends[pair].index(link)
            further = ends[pair][1 - side]
            if further in reached or not _one_line(two[side], here.line):
                continue
            sense = float(np.sign(two[side] @ here.line))
            # the angle moves the second link of a pair
            turned = {**here.turned, pair: sense if side else -sense}
            way = (*here.way, (pair, side))
            reached[further] = _Centre(sense * two[1 - side], turned, way)
            waiting.append(further)
    return reached


def _one_line(one: Floats, other: Floats) -> bool:
    return bool(np.linalg.norm(cross(one, other)) < ONE_LINE)


def least_rolled(
    lengths: Floats, laps: Floats, first: Floats, square: Floats
) -> NDArray[np.int64] | None:
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
        lap = float(laps[k, side])
        step = first @ to_angles[:, k] * (lap if side else -lap)
        step[k] += 0.0 if side else lap
        signed = (sense * earlier for earlier in (*steps, 0.0 * step) for sense in (1, -1))
        if all(np.max(np.abs(step - item)) > SAME_LENGTH for item in signed):
            steps.append(step)
            places.append((k, side))
    turns = np.zeros(laps.shape, dtype=np.int64)
    if not steps:
        return turns
    most = next(
        (
            m
            for m in range(MOST_TURNS, 0, -1)
            if (2 * m + 1) ** len(steps) <= MOST_ASSEMBLIES
        ),
        None,
    )
    if most is None:
        return None
    counts = np.indices((2 * most + 1,) * len(steps)).reshape(len(steps), -1).T - most
    rolled = put + counts @ np.array(steps)
    keys = np.column_stack([np.sum(np.abs(rolled), axis=1), -rolled])
    best = counts[np.lexsort(np.round(keys / SAME_LENGTH).T[::-1])[0]]
    for place, count in zip(places, best, strict=True):
        turns[place] = count
    return turns
