"""The binary links of a group as arcs between two other bodies, and how they are placed.

A body with two R pairs keeps one axis of each of its neighbours at a fixed arc. With the
neighbours placed, that arc is the only condition, and the body follows from its axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.motion.closure import Closure
from spherekit.planning.assembly import Group
from spherekit.sphere.rotation import Floats, cross, frame_toward, transpose


@final
@dataclass(frozen=True)
class Bar:
    """A body with two pairs: the pairs, and the two bodies that it joins by them."""

    body: int
    pairs: tuple[int, int]
    bodies: tuple[int, int]


def bars_of(group: Group) -> tuple[Bar, ...]:
    """Return the bodies of a group that have two pairs, with two other bodies."""
    bars = []
    for body in range(len(group.bodies)):
        pairs = [k for k, ends in enumerate(group.ends) if body in ends]
        others = [sum(group.ends[k]) - body for k in pairs]
        if len(pairs) == 2 and others[0] != others[1]:
            bars.append(Bar(body, (pairs[0], pairs[1]), (others[0], others[1])))
    return tuple(bars)


@final
@dataclass(frozen=True)
class Frames:
    """The pair frames of a group's bodies: (pairs, 3, 3) in the first and second body.

    R_second = R_first first Z(angle) second^T, R from body axes to those of body 0.
    """

    ends: tuple[tuple[int, int], ...]
    first: Floats
    second: Floats

    @staticmethod
    def of(group: Group, closure: Closure) -> "Frames":
        """Return the frames of a group of R pairs at the closure's only sample."""
        _, unturned = closure.place(np.zeros((1, len(group.pairs))))
        return Frames(group.ends, unturned.first[0], unturned.second[0])

    def of_pair(self, pair: int, body: int) -> Floats:
        """Return the frame (3, 3) of a pair in one of its bodies."""
        return np.asarray((self.first if self.ends[pair][0] == body else self.second)[pair])

    def axis(self, pair: int, body: int) -> Floats:
        """Return the unit axis (3,) of a pair in one of its bodies."""
        return self.of_pair(pair, body)[:, 2]

    def outer_axes(self, bar: Bar) -> tuple[Floats, Floats]:
        """Return the axes (3,) of a bar's pairs in the two bodies that it joins."""
        one, other = bar.pairs
        return self.axis(one, bar.bodies[0]), self.axis(other, bar.bodies[1])

    def cosine(self, bar: Bar) -> float:
        """Return the cosine of a bar's arc."""
        one, other = bar.pairs
        return float(self.axis(one, bar.body) @ self.axis(other, bar.body))

    def is_pointlike(self, bar: Bar, least: float = 1e-9) -> bool:
        """Return whether a bar's axes lie on one line, so that it can spin about it."""
        one, other = bar.pairs
        sine = cross(self.axis(one, bar.body), self.axis(other, bar.body))
        return bool(np.linalg.norm(sine) < least)

    def place_bars(self, placed: Floats, bars: Sequence[Bar]) -> None:
        """Set the orientations of bars in `placed` (n, bodies, 3, 3)."""
        for bar in bars:
            one, other = bar.pairs
            own = frame_toward(self.axis(one, bar.body), self.axis(other, bar.body))
            ends = [
                placed[:, body] @ axis
                for body, axis in zip(bar.bodies, self.outer_axes(bar), strict=True)
            ]
            placed[:, bar.body] = frame_toward(*ends) @ own.T

    def angles(self, placed: Floats) -> Floats:
        """Return the angles (n, pairs) rad of pairs between placed bodies."""
        one = placed[:, [a for a, _ in self.ends]] @ self.first
        other = placed[:, [b for _, b in self.ends]] @ self.second
        turn = transpose(one) @ other
        return np.asarray(np.arctan2(turn[..., 1, 0], turn[..., 0, 0]))
