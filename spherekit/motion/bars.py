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


def joined_by_three(bars: Sequence[Bar]) -> tuple[int, int] | None:
    """Return the two bodies that all of three bars join, None of other bars."""
    ends = {frozenset(bar.bodies) for bar in bars}
    return bars[0].bodies if len(bars) == 3 and len(ends) == 1 else None


@final
@dataclass(frozen=True)
class Frames:
    """The pair frames (2, pairs, 3, 3) of a group's bodies: in the first, in the second.

    R_second = R_first first Z(angle) second^T, R from body axes to those of body 0.
    """

    ends: tuple[tuple[int, int], ...]
    sides: Floats

    @staticmethod
    def of(group: Group, closure: Closure) -> "Frames":
        """Return the frames of a group of R pairs at the closure's only sample."""
        unturned = closure.at(np.zeros((1, len(group.pairs)))).states
        return Frames(group.ends, np.stack([unturned.first[0], unturned.second[0]]))

    def of_pair(self, pair: int, body: int) -> Floats:
        """Return the frame (3, 3) of a pair in one of its bodies."""
        return np.asarray(self.sides[self.ends[pair].index(body), pair])

    def arcs(self, bars: Sequence[Bar]) -> "Arcs":
        """Return the axes of bars."""
        pairs = [bar.pairs for bar in bars]
        inner = [[self.ends[k].index(bar.body) for k in bar.pairs] for bar in bars]
        axes = self.sides[..., 2]
        return Arcs(axes[inner, pairs], axes[1 - np.array(inner), pairs])

    def angles(self, placed: Floats) -> Floats:
        """Return the angles (n, pairs) rad of pairs between placed bodies."""
        one = placed[:, [a for a, _ in self.ends]] @ self.sides[0]
        other = placed[:, [b for _, b in self.ends]] @ self.sides[1]
        turn = transpose(one) @ other
        return np.asarray(np.arctan2(turn[..., 1, 0], turn[..., 0, 0]))


@final
@dataclass(frozen=True)
class Arcs:
    """The unit axes (bars, 2, 3) of bars' pairs: in the bars, in the bodies they join."""

    inner: Floats
    outer: Floats

    @property
    def cosines(self) -> Floats:
        """(bars,) of the arcs between a bar's two axes."""
        return np.asarray(np.sum(self.inner[:, 0] * self.inner[:, 1], axis=1))

    @property
    def sines(self) -> Floats:
        """(bars,) the same; at 0 the bar can spin between its neighbours."""
        return np.asarray(np.linalg.norm(cross(self.inner[:, 0], self.inner[:, 1]), axis=1))

    def place(self, placed: Floats, bars: Sequence[Bar]) -> None:
        """Set the orientations of the bars in `placed` (n, bodies, 3, 3)."""
        joined = placed[:, [bar.bodies for bar in bars]]
        ends = (joined @ self.outer[..., None])[..., 0]
        in_bars = frame_toward(self.inner[:, 0], self.inner[:, 1])
        turned = frame_toward(ends[:, :, 0], ends[:, :, 1])
        placed[:, [bar.body for bar in bars]] = turned @ transpose(in_bars)
