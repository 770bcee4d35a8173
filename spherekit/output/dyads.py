"""Dyads placed one after another on one body, as vectors of pair axes over many rows.

With the output held, a mechanism often falls apart into dyads that stand on the body of
the two links that the output joins. Only the axes of pairs are needed then, no rotation
matrix: the middle axis of a dyad follows from the outer ones (`spherekit.sphere.dyad`).
The rates of its pairs follow from the triple product t of its axes, and with them how
the inputs move per unit rate of the output. Arrays are (3, n), components first.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import REACH_SLACK
from spherekit.model.geometry import COLLINEAR
from spherekit.model.joints import Revolute
from spherekit.model.mechanism import Mechanism
from spherekit.motion.assembly_modes import FLAT_DYAD
from spherekit.planning.assembly import Assembly, Group
from spherekit.rates.vectors import cross, dot
from spherekit.sphere.dyad import HalfArc, middle_axis, triple_square
from spherekit.sphere.rotation import Floats

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
@dataclass(frozen=True)
class Fraction:
    """A rate, linear in the output's angular velocity w: top . w / bottom.

    `top` (3, n) and `bottom` (n,); both stay finite at a singular configuration.
    """

    top: Floats
    bottom: Floats


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
@dataclass
class Placed:
    """The dyads at n rows, every part computed once for the signs that it depends on.

    `given_axes` are the axes (3, n) of pairs on given links, `given_rotation` the columns
    (3, 3, n) of the orientation of the given link, for its other axes.
    """

    dyads: Dyads
    given_axes: Mapping[int, Floats]
    given_rotation: Floats | None
    computed: dict[Hashable, Any] = field(default_factory=dict)

    def key(self, name: str, what: int, groups: frozenset[int], signs: Signs) -> Hashable:
        """Return a key for what depends on the signs of some groups only."""
        return (name, what, *(s if k in groups else 0 for k, s in enumerate(signs)))

    def axis(self, pair: int, link: int, signs: Signs) -> Floats:
        """Return the axis (3, n) or (3, 1) of a pair, seen on one of its links."""
        dyads = self.dyads
        pair, link, sense = dyads.source(pair, link)
        if sense < 0.0:
            return -self.axis(pair, link, signs)
        if link == dyads.base:
            return dyads.axis_in(pair, link)[:, None]
        if link in dyads.given and pair in self.given_axes:
            return self.given_axes[pair]
        if link in dyads.placed_by:
            group = dyads.placed_by[link]
            if pair == dyads.stands[group].middle:
                return self.middle(group, signs)[0]
        return self.vector(dyads.axis_in(pair, link), link, signs, ("axis", pair))

    def vector(
        self, vector: Floats, link: int, signs: Signs, name: tuple[str, int]
    ) -> Floats:
        """Return a vector (3,) of a link in base axes, (3, n) or (3, 1)."""
        dyads = self.dyads
        if link == dyads.base:
            return vector[:, None]
        if link in dyads.given:
            key: Hashable = (*name, link)
            if key not in self.computed:
                assert self.given_rotation is not None
                columns = self.given_rotation.reshape(3, -1)
                self.computed[key] = (vector @ columns).reshape(3, -1)
            return np.asarray(self.computed[key])
        group = dyads.placed_by[link]
        key = (self.key(*name, dyads.needs[group], signs), link)
        if key not in self.computed:
            spread = dyads.spreads.get((*name, link))
            if spread is None:
                spread = dyads.spread_of(vector, link)
                dyads.spreads[*name, link] = spread
            p = self.axis(spread.outer, link, signs)
            q = self.axis(spread.middle, link, signs)
            a, b, c = spread.weights
            self.computed[key] = a * p + b * q + c * cross(p, q)
        return np.asarray(self.computed[key])

    def outer(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the axes of a dyad's near and far pair."""
        stand = self.dyads.stands[group]
        return (
            self.axis(stand.near, stand.foot, signs),
            self.axis(stand.far, stand.hold, signs),
        )

    def middle(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the middle axis (3, n) and middle . (near x far), NaN out of reach."""
        key = self.key("middle", group, self.dyads.needs[group], signs)
        if key not in self.computed:
            level, across, height = self._halves(group, signs)
            sign = signs[group] * self.dyads.stands[group].parity
            self.computed[key] = level + sign * across, sign * height
        middle: tuple[Floats, Floats] = self.computed[key]
        return middle

    def _halves(self, group: int, signs: Signs) -> tuple[Floats, Floats, Floats]:
        """Return the part of the middle axis that both signs share, the other, and |t|."""
        key = self.reach_key(group, signs)
        if key not in self.computed:
            stand = self.dyads.stands[group]
            halves = stand.cones.halves
            a, c = self.outer(group, signs)
            total, difference = a + c, a - c
            squares = dot(total, total), dot(difference, difference)
            square = triple_square(*halves, *squares)
            grazes = np.abs(square) < REACH_SLACK
            if np.any(grazes):
                square[grazes] = np.maximum(square[grazes], 0.0)
            root = np.sqrt(square)
            along, beside, height = middle_axis(*halves, *squares, root)
            level = total * along
            if stand.cones.near != stand.cones.far:
                level += difference * beside
            across = cross(difference, total)  # 2 a x c, to rounding of its own size
            across *= 0.5 * height
            self.computed[key] = level, across, root
            self.computed[key, "squares"] = squares
            self.computed[key, "sound"] = root >= FLAT_DYAD * stand.flat
        parts: tuple[Floats, Floats, Floats] = self.computed[key]
        return parts

    def margin(self, group: int, signs: Signs) -> Floats:
        """Return by how much (rad) a dyad reaches, negative if it does not (n,)."""
        key = self.reach_key(group, signs), "margin"
        if key not in self.computed:
            cones = self.dyads.stands[group].cones
            u, v = self._beside(group, signs, "squares")
            half = np.arcsin(np.minimum(0.5 * np.sqrt(np.minimum(u, v)), 1.0))
            base = np.where(u < v, np.pi - 2.0 * half, 2.0 * half)
            centre = 0.5 * (cones.longest + cones.shortest)
            reach = 0.5 * (cones.longest - cones.shortest)
            self.computed[key] = reach - np.abs(base - centre)
        return np.asarray(self.computed[key])

    def square(self, group: int, signs: Signs) -> Floats:
        """Return t^2 (n,) of a dyad: negative where it does not reach."""
        u, v = self._beside(group, signs, "squares")
        halves = self.dyads.stands[group].cones.halves
        return np.asarray(triple_square(*halves, u, v))

    def sound(self, group: int, signs: Signs) -> NDArray[np.bool_]:
        """Return whether a dyad closes and is neither stretched nor folded (n,)."""
        return np.asarray(self._beside(group, signs, "sound"))

    def _beside(self, group: int, signs: Signs, what: str) -> Any:
        self._halves(group, signs)
        return self.computed[self.reach_key(group, signs), what]

    def reach_key(self, group: int, signs: Signs) -> Hashable:
        """Return the key of what a dyad's reach depends on: all but its own sign."""
        return self.key("halves", group, self.dyads.needs[group] - {group}, signs)

    def angle(self, pair: int, signs: Signs) -> tuple[Floats, Hashable]:
        """Return the variable (n,) of a pair in (-pi, pi] rad, and its key."""
        needs = (self.dyads.needs_of(link) for link in self.dyads.ends[pair])
        key = self.key("angle", pair, frozenset().union(*needs), signs)
        if key not in self.computed:
            self.computed[key] = self._angle(pair, signs)
        return self.computed[key], key

    def _angle(self, pair: int, signs: Signs) -> Floats:
        dyads = self.dyads
        a, b = dyads.ends[pair]
        if dyads.base in (a, b):
            other, part = self._side(pair, b if a == dyads.base else a, signs)
            size = float(np.hypot(part[0], part[1]))
            turn = np.array([[part[0], part[1]], [-part[1], part[0]]]) / size
            x, y = turn @ dyads.frame_in(pair, dyads.base)[:, :2].T @ other
            return polar_angle(y if a == dyads.base else -y, x, size)
        one, first = self._side(pair, a, signs)
        other, second = self._side(pair, b, signs)
        x = dot(one, other) - first[2] * second[2]
        y = dot(self.axis(pair, b, signs), cross(one, other))
        turn = second[0] * first[0] + second[1] * first[1]
        side = second[1] * first[0] - second[0] * first[1]
        size = float(turn * turn + side * side)
        return polar_angle(y * turn - x * side, x * turn + y * side, size)

    def _side(self, pair: int, link: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return a vector of a link off a pair's axis, and its components in the frame.

        The components (3,) are those in the pair's frame in that link.
        """
        dyads = self.dyads
        frame = dyads.frame_in(pair, link)
        if link in dyads.given:
            vector = self.vector(frame[:, 0], link, signs, ("zero", pair))
            return vector, np.array([1.0, 0.0, 0.0])
        stand = dyads.stands[dyads.placed_by[link]]
        other = stand.middle
        if pair == other or dyads.is_coaxial(pair, other, link):
            other = stand.near if link == stand.first else stand.far
        return self.axis(other, link, signs), dyads.axis_in(other, link) @ frame

    def rate(self, pair: int, signs: Signs) -> Fraction:
        """Return the rate of a pair's variable per unit rate of the output.

        Notes
        -----
        The rates of the two bodies, w_foot + a A = w_hold + c C - b B, times the product
        of two of the axes, leave the rate of the third pair.
        """
        dyads = self.dyads
        group = dyads.group_of[pair]
        key = self.key("rate", pair, dyads.moves_with(pair), signs)
        if key not in self.computed:
            stand = dyads.stands[group]
            a, c = self.outer(group, signs)
            b, triple = self.middle(group, signs)
            near: int | None = stand.near
            far: int | None = stand.far
            if pair == stand.near:
                across, body, near = cross(b, c), stand.first, None
            elif pair == stand.middle:
                across, body = cross(c, a), stand.second
            else:
                across, body, far = cross(b, a), stand.second, None
            moved = self.along(across, stand.hold, far, signs)
            still = self.along(across, stand.foot, near, signs)
            rate = difference(moved, still)
            ahead = dyads.ends[pair][1] == body
            self.computed[key] = Fraction(
                rate.top, rate.bottom * (-triple if ahead else triple)
            )
        fraction: Fraction = self.computed[key]
        return fraction

    def along(
        self, vector: Floats, link: int, across: int | None, signs: Signs
    ) -> Fraction | None:
        """Return vector . w of a link; None for zero.

        The vector is at right angles to the axis of the pair `across` on that link, if
        one is named.
        """
        dyads = self.dyads
        if link == dyads.base:
            return None
        if link in dyads.given:
            return Fraction(vector, np.ones(1))
        group = dyads.placed_by[link]
        stand = dyads.stands[group]
        at_first = link == stand.first
        pair, foot = (stand.near, stand.foot) if at_first else (stand.far, stand.hold)
        if across is not None and dyads.is_coaxial(pair, across, link):
            return self.along(vector, foot, pair, signs)
        carried = self.along(vector, foot, None, signs)
        turning = self.rate(pair, signs)
        share = dot(vector, self.axis(pair, link, signs))
        ahead = dyads.ends[pair][1] == link
        turned = Fraction(turning.top * (share if ahead else -share), turning.bottom)
        return turned if carried is None else _sum(turned, carried)


def _sum(one: Fraction, other: Fraction) -> Fraction:
    return Fraction(
        one.top * other.bottom + other.top * one.bottom, one.bottom * other.bottom
    )


def difference(one: Fraction | None, other: Fraction | None) -> Fraction:
    """Return the difference of two rates; None stands for zero."""
    if other is None:
        assert one is not None, "what stands on the base alone does not move"
        return one
    minus = Fraction(-other.top, other.bottom)
    return minus if one is None else _sum(one, minus)


def polar_angle(y: Floats, x: Floats, size: float) -> Floats:
    """Return arctan2(y, x) of vectors (n,) whose common length is known.

    The inverse sine of the smaller component is as accurate, and several times quicker.
    """
    sine, cosine = np.abs(y), np.abs(x)
    angle = np.arcsin(np.minimum(sine, cosine) / size)
    angle = np.where(sine > cosine, 0.5 * np.pi - angle, angle)
    angle = np.where(x < 0.0, np.pi - angle, angle)
    return np.copysign(angle, y)
