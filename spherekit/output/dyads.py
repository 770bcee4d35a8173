"""Dyads that stand one after another on one body, and what their placement depends on.

With the output held, a mechanism often falls apart into dyads that stand on the body of
the two links that the output joins. Only the axes of pairs are needed then, no rotation
matrix; `spherekit.output.closing_link` computes these over many rows.

How inputs move with an output, and the measures of type I that follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.arrays import Floats
from spherekit.model.gears import COLLINEAR
from spherekit.model.joints import Revolute
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import Assembly, Group
from spherekit.sphere.dyad import HalfArc
from spherekit.sphere.rotation import cross

Signs = tuple[int, ...]


@final
@dataclass(frozen=True)
class DyadArcs:
    """The arcs (rad) of a dyad's two bodies, and what follows from them.

    `near` is the arc of the body at the first axis, `far` that at the second.
    """

    near: float
    far: float

    @property
    def shortest(self) -> float:
        """The least arc between the outer axes at which the dyad closes."""
        return abs(self.near - self.far)

    @property
    def longest(self) -> float:
        """The greatest such arc."""
        total = self.near + self.far
        return min(total, 2.0 * np.pi - total)

    @cached_property
    def halves(self) -> tuple[HalfArc, HalfArc]:
        """Both arcs by their halves."""
        return HalfArc.of(self.near), HalfArc.of(self.far)


@final
@dataclass(frozen=True)
class DyadPlacement:
    """A dyad on the growing body: pairs, the links they join, and its sign.

    `near`, `middle`, `far` are its pairs; the bodies are the links `first` (near and
    middle) and `second` (middle and far), which stand on the links `foot` and `hold`.
    `parity` turns the sign of a mode into that of middle . (near x far).
    """

    near: int
    middle: int
    far: int
    foot: int
    first: int
    second: int
    hold: int
    parity: int
    cones: DyadArcs

    @property
    def flat(self) -> float:
        """The triple product of its axes when its two arcs are at right angles."""
        return float(np.sin(self.cones.near) * np.sin(self.cones.far))


@final
@dataclass(frozen=True)
class AxisCoefficients:
    """How a link's axis follows from two others of it: a p + b q + c (p x q)."""

    outer: int
    middle: int
    weights: tuple[float, float, float]


@final
class Dyads:
    """The dyads of an assembly that stand on one body, in solving order.

    Parameters
    ----------
    mechanism, joints, assembly
        A mechanism of R pairs and its groups.
    base
        The number of the link whose axes all vectors are given in.
    given
        Numbers of links whose orientations, or at least pair axes, are given with the
        rows; the rate of the output is that of these links relative to the base.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        joints: Sequence[Revolute],
        assembly: Assembly,
        base: int,
        given: Sequence[int],
    ) -> None:
        self.ends = mechanism.ends
        self.joints = joints
        self.base = base
        self.given = tuple(given)
        self.spreads: dict[tuple[str, int, int], AxisCoefficients] = {}
        self._coaxial: dict[tuple[int, int, int], bool] = {}
        self._sources: dict[tuple[int, int], tuple[int, int, float]] = {}
        self.stands = tuple(self._stand(group) for group in assembly.groups)
        self.placed_by = {
            link: number
            for number, stand in enumerate(self.stands)
            for link in (stand.first, stand.second)
        }
        self.needs: list[frozenset[int]] = []
        for number, stand in enumerate(self.stands):
            ends = ((stand.near, stand.foot), (stand.far, stand.hold))
            before = (self.needs_of(self.source(*end)[1]) for end in ends)
            self.needs.append(frozenset({number}).union(*before))
        self.group_of = {
            pair: number
            for number, stand in enumerate(self.stands)
            for pair in (stand.near, stand.middle, stand.far)
        }

    @staticmethod
    def fit(assembly: Assembly, base: int) -> bool:
        """Return whether all groups are dyads of two links on the body of the base."""
        return all(
            group.is_dyad
            and base in group.bodies[0]
            and len(group.bodies[1]) == len(group.bodies[2]) == 1
            for group in assembly.groups
        )

    def _stand(self, group: Group) -> DyadPlacement:
        near, middle, far = (group.pairs[place] for place in group.dyad_places)
        first, second = group.bodies[1][0], group.bodies[2][0]
        return DyadPlacement(
            near,
            middle,
            far,
            sum(self.ends[near]) - first,
            first,
            second,
            sum(self.ends[far]) - second,
            group.dyad_parity,
            DyadArcs(self._arc(first, near, middle), self._arc(second, far, middle)),
        )

    def needs_of(self, link: int) -> frozenset[int]:
        """Return the groups that the orientation of a link depends on."""
        group = self.placed_by.get(link)
        return frozenset() if group is None else self.needs[group]

    def source(self, pair: int, link: int) -> tuple[int, int, float]:
        """Return where the axis of a pair comes from: pair, link, and sense.

        On a link that stands by an axis on the same line, it is that axis.
        """
        asked = pair, link
        if asked in self._sources:
            return self._sources[asked]
        sense = 1.0
        while link in self.placed_by:
            stand = self.stands[self.placed_by[link]]
            at_first = link == stand.first
            outer = stand.near if at_first else stand.far
            if not self.is_coaxial(pair, outer, link):
                break
            ahead = self.axis_in(pair, link) @ self.axis_in(outer, link)
            sense *= float(np.sign(ahead))
            pair, link = outer, stand.foot if at_first else stand.hold
        self._sources[asked] = pair, link, sense
        return self._sources[asked]

    def axis_in(self, pair: int, link: int) -> Floats:
        """Return the axis (3,) of a pair in the axes of one of its links."""
        return self.frame_in(pair, link)[:, 2]

    def frame_in(self, pair: int, link: int) -> Floats:
        """Return the frame (3, 3) of a pair in the axes of one of its links."""
        joint = self.joints[pair]
        return joint.first if self.ends[pair][0] == link else joint.second

    def _arc(self, link: int, one: int, other: int) -> float:
        a, b = self.axis_in(one, link), self.axis_in(other, link)
        return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))

    def spread_of(self, vector: Floats, link: int) -> AxisCoefficients:
        """Return how a vector (3,) of a placed link follows from its dyad's axes."""
        stand = self.stands[self.placed_by[link]]
        outer = stand.near if link == stand.first else stand.far
        p, q = self.axis_in(outer, link), self.axis_in(stand.middle, link)
        frame = np.stack([p, q, np.cross(p, q)], axis=1)
        a, b, c = np.linalg.lstsq(frame, vector, rcond=None)[0]  # no error for a point
        return AxisCoefficients(outer, stand.middle, (float(a), float(b), float(c)))

    def moves_with(self, pair: int) -> frozenset[int]:
        """Return groups that the rate of a dyad's pair depends on, at most."""
        group = self.group_of[pair]
        stand = self.stands[group]
        groups = self.needs[group]
        for link in (stand.foot, stand.hold):
            if link in self.placed_by:
                below = self.stands[self.placed_by[link]]
                groups |= self.moves_with(below.near) | self.needs_of(link)
        return groups

    def is_coaxial(self, one: int, other: int, link: int) -> bool:
        """Return whether two pairs of a link have their axes on one line."""
        key = one, other, link
        if key not in self._coaxial:
            arc = self._arc(link, one, other)
            self._coaxial[key] = min(arc, np.pi - arc) < COLLINEAR
        return self._coaxial[key]


@final
@dataclass(frozen=True)
class InputRates:
    """Rates of the inputs, linear in the output's angular velocity w: top . w / bottom.

    `tops` (n, inputs, 3) and `bottoms` (n, inputs) or (n, 1); both stay finite at a
    singular configuration.
    """

    tops: Floats
    bottoms: Floats

    @staticmethod
    def of_turns(turns: Floats, directions: Floats | None) -> "InputRates":
        """Return what follows from the output's velocities (n, 3, inputs) per input rate.

        Those of three inputs; or those of two with `directions` (n, 3), of which the part
        at right angles to these counts.
        """
        across, volume = reciprocal(np.swapaxes(turns, 1, 2), directions)
        return InputRates(across, volume[:, None])

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates per unit angular velocity of the output."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.tops / self.bottoms[..., None]

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `spherekit.output.inverse.Inverse`."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.abs(self.bottoms) / np.linalg.norm(self.tops, axis=2))


def reciprocal(vectors: Floats, along: Floats | None) -> tuple[Floats, Floats]:
    """Return the vectors reciprocal to others times their volume, and that volume.

    Of three vectors (..., 3, 3), in rows; or of two (..., 2, 3) and what stands beside
    them, `along` (..., 3), of which only the first two are returned.
    """
    a, b = vectors[..., 0, :], vectors[..., 1, :]
    third = vectors[..., 2, :] if along is None else along
    every = [cross(b, third), cross(third, a)]
    if along is None:
        every.append(cross(a, b))
    return np.stack(every, axis=-2), np.sum(a * every[0], axis=-1)
