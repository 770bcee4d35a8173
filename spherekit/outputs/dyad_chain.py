"""Dyads that stand one after another on one body, and what their placement depends on.

With the output held, a mechanism often falls apart into dyads that stand on the body of
the two links that the output joins. Only the axes of pairs are needed then, no rotation
matrix; `spherekit.outputs.working_mode` computes these over many rows.

How inputs move with an output, and the measures of type I that follow.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.dyad_axis import HalfAngle
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross
from spherekit.mechanism.joint import Revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.planning.assembly_plan import Assembly, Group

Signs = tuple[int, ...]


@dataclass(frozen=True)
class DyadPlacement:
    """A dyad on the growing body: pairs, the links they join, and its sign.

    `near`, `middle`, `far` are its pairs; the bodies are the links `first` (near and
    middle) and `second` (middle and far), which stand on the links `foot` and `hold`.
    `parity` turns the sign of a mode into that of middle . (near x far). `arcs` (rad) are
    those of the first and of the second body.
    """

    near: int
    middle: int
    far: int
    foot: int
    first: int
    second: int
    hold: int
    parity: int
    arcs: tuple[float, float]

    @property
    def shortest(self) -> float:
        """The least arc (rad) between the outer axes at which the dyad closes."""
        return abs(self.arcs[0] - self.arcs[1])

    @property
    def longest(self) -> float:
        """The greatest such arc."""
        return min(sum(self.arcs), 2.0 * np.pi - sum(self.arcs))

    @cached_property
    def halves(self) -> tuple[HalfAngle, HalfAngle]:
        """Both arcs by their halves."""
        return HalfAngle.from_arc(self.arcs[0]), HalfAngle.from_arc(self.arcs[1])


class Dyads:
    """The dyads of an assembly that stand on one body, in solving order.

    Parameters
    ----------
    mechanism, joints, assembly
        A mechanism of R pairs and its groups.
    base
        The number of the link whose axes all vectors are given in.
    given
        The number of the link whose orientation, or at least pair axes, is given with the
        rows; the rate of the output is that of this link relative to the base.

    Attributes
    ----------
    stands, placed_by, group_of
        The dyads, and by which of them each link is placed and each pair is held.
    needs
        Dyads whose signs matter to what has been asked of a mode.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        joints: Sequence[Revolute],
        assembly: Assembly,
        base: int,
        given: int,
    ) -> None:
        self.ends, self.joints = mechanism.ends, joints
        self.base, self.given = base, given
        self._cache_methods()
        self.stands = tuple(map(self._stand, assembly.groups))
        self.placed_by: dict[int, int] = {}
        self.group_of: dict[int, int] = {}
        self.needs: dict[Hashable, frozenset[int]] = {}
        for number, stand in enumerate(self.stands):
            self.placed_by |= dict.fromkeys((stand.first, stand.second), number)
            self.group_of |= dict.fromkeys((stand.near, stand.middle, stand.far), number)

    def _cache_methods(self) -> None:
        """Let `source` and `spread` remember what they have returned."""
        self.source = cache(self._source)
        self.spread = cache(self._spread)

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the two caches, which do not pickle."""
        state = dict(vars(self))
        del state["source"], state["spread"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._cache_methods()

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
        near, middle, far = (group.pairs[place] for place in group.dyad_positions)
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
            (self._arc(first, near, middle), self._arc(second, far, middle)),
        )

    def stands_by(self, link: int) -> tuple[int, int]:
        """Return by which outer pair of its dyad a link stands, and on which link."""
        stand = self.stands[self.placed_by[link]]
        if link == stand.first:
            return stand.near, stand.foot
        return stand.far, stand.hold

    def _source(self, pair: int, link: int) -> tuple[int, int, float]:
        """Return where the axis of a pair comes from: pair, link, and sense.

        On a link that stands by an axis on the same line, it is that axis.
        """
        if link not in self.placed_by:
            return pair, link, 1.0
        outer, foot = self.stands_by(link)
        if not self.is_coaxial(pair, outer, link):
            return pair, link, 1.0
        ahead = self.axis_in(pair, link) @ self.axis_in(outer, link)
        source, on, sense = self.source(outer, foot)
        return source, on, sense * float(np.sign(ahead))

    def axis_in(self, pair: int, link: int) -> Floats:
        """Return the axis (3,) of a pair in the axes of one of its links."""
        return self.frame_in(pair, link)[:, 2]

    def frame_in(self, pair: int, link: int) -> Floats:
        """Return the frame (3, 3) of a pair in the axes of one of its links."""
        joint = self.joints[pair]
        return joint.first if self.ends[pair][0] == link else joint.second

    def _arc(self, link: int, one: int, other: int) -> float:
        return float(arc(self.axis_in(one, link), self.axis_in(other, link)))

    def _spread(self, link: int, *vector: float) -> Floats:
        """Return how a vector of a placed link follows from its dyad's axes, p outer, q.

        The weights (3,) of p, q and p x q.
        """
        pairs = self.stands_by(link)[0], self.stands[self.placed_by[link]].middle
        p, q = (self.axis_in(pair, link) for pair in pairs)
        frame = np.stack([p, q, np.cross(p, q)], axis=1)
        return np.linalg.lstsq(frame, np.array(vector))[0]  # no error for a point

    def is_coaxial(self, one: int, other: int, link: int) -> bool:
        """Return whether two pairs of a link have their axes on one line."""
        return bool(np.sin(self._arc(link, one, other)) < COLLINEAR_SINE)


def input_rates(tops: Floats, bottoms: Floats) -> tuple[Floats, Floats]:
    """Return rates (n, inputs, 3) by the output's angular velocity w, and measures.

    The rates are tops . w / bottoms, with `tops` (n, inputs, 3) and `bottoms` (n, inputs)
    or (n, 1), both finite at a singular configuration. The measures (n, inputs) are those
    of type I, see `spherekit.outputs.inverse_kinematics.Inverse`.
    """
    with np.errstate(all="ignore"):
        return tops / bottoms[..., None], np.abs(bottoms) / np.linalg.norm(tops, axis=2)


def rates_of_turns(turns: Floats, directions: Floats | None) -> tuple[Floats, Floats]:
    """Return `input_rates` from the output's velocities (n, 3, inputs) per input rate.

    Those of three inputs; or those of two with `directions` (n, 3), of which the part at
    right angles to these counts.
    """
    across, volume = reciprocal(np.swapaxes(turns, 1, 2), directions)
    return input_rates(across, volume[:, None])


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
    return np.stack(every, axis=-2), np.vecdot(a, every[0])
