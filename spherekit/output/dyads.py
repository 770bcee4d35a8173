"""Dyads placed one after another on one body, as vectors of pair axes over many rows.

With the output held, a mechanism often falls apart into dyads that stand on the body of
the two links that the output joins. Only the axes of pairs are needed then, no rotation
matrix: the middle axis b of a dyad between the axes a and c at arcs A and C is

    b = (cos A + cos C) (a + c) / |a + c|^2 + (cos A - cos C) (a - c) / |a - c|^2
        + t (a x c) / |a x c|^2,
    t^2 = (cos(A - C) - a . c) (a . c - cos(A + C)),

three terms at right angles to each other (derived here; it is the formula of two
intersecting cones, with both factors in half angles so that small arcs lose no digits).
The rates of its pairs follow from the triple product t of its axes, and with them how
the inputs move per unit rate of the output. Arrays are (3, n), components first.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from spherekit.conventions import REACH_SLACK
from spherekit.model.geometry import COLLINEAR, Revolute
from spherekit.model.mechanism import Mechanism
from spherekit.planning.assembly import Assembly, Group
from spherekit.rates.vectors import cross, dot
from spherekit.sphere.rotation import Floats

Signs = tuple[int, ...]


@final
@dataclass(frozen=True)
class Cones:
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

    def square(self, sum_square: Floats, difference_square: Floats) -> Floats:
        """Return t^2 (n,) from |a + c|^2 and |a - c|^2, negative out of reach."""
        more, less = self.near + self.far, self.near - self.far
        if np.cos(less) > 0.0:
            outside = 0.5 * difference_square - 2.0 * np.sin(0.5 * less) ** 2
        else:
            outside = 2.0 * np.cos(0.5 * less) ** 2 - 0.5 * sum_square
        if np.cos(more) > 0.0:
            inside = 2.0 * np.sin(0.5 * more) ** 2 - 0.5 * difference_square
        else:
            inside = 0.5 * sum_square - 2.0 * np.cos(0.5 * more) ** 2
        return np.asarray(outside * inside)


@final
@dataclass(frozen=True)
class Stand:
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
    cones: Cones

    @property
    def flat(self) -> float:
        """The triple product of its axes when its two arcs are at right angles."""
        return float(np.sin(self.cones.near) * np.sin(self.cones.far))


@final
@dataclass(frozen=True)
class Spread:
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
        self.stands = tuple(self._stand(group) for group in assembly.groups)
        self.placed_by = {
            link: number
            for number, stand in enumerate(self.stands)
            for link in (stand.first, stand.second)
        }
        self.needs: list[tuple[int, ...]] = []
        for number, stand in enumerate(self.stands):
            before = {
                other
                for link in (stand.foot, stand.hold)
                if link in self.placed_by
                for other in self.needs[self.placed_by[link]]
            }
            self.needs.append((*sorted(before), number))
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

    def _stand(self, group: Group) -> Stand:
        def joint(a: int, b: int) -> int:
            return next(k for k, pair in enumerate(group.ends) if set(pair) == {a, b})

        places = joint(0, 1), joint(1, 2), joint(0, 2)
        near, middle, far = (group.pairs[place] for place in places)
        first, second = group.bodies[1][0], group.bodies[2][0]
        even = (places[1], places[0], places[2]) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        return Stand(
            near,
            middle,
            far,
            sum(self.ends[near]) - first,
            first,
            second,
            sum(self.ends[far]) - second,
            1 if even else -1,
            Cones(self._arc(first, near, middle), self._arc(second, far, middle)),
        )

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

    def spread(self, pair: int, link: int) -> Spread:
        """Return how the axis of a pair on a placed link follows from its dyad's."""
        return self.spread_of(self.axis_in(pair, link), link)

    def spread_of(self, vector: Floats, link: int) -> Spread:
        """Return the same for any vector (3,) in the link's axes."""
        stand = self.stands[self.placed_by[link]]
        outer = stand.near if link == stand.first else stand.far
        p, q = self.axis_in(outer, link), self.axis_in(stand.middle, link)
        frame = np.stack([p, q, np.cross(p, q)], axis=1)
        a, b, c = np.linalg.solve(frame, vector)
        return Spread(outer, stand.middle, (float(a), float(b), float(c)))

    def is_coaxial(self, one: int, other: int, link: int) -> bool:
        """Return whether two pairs of a link have their axes on one line."""
        a, b = self.axis_in(one, link), self.axis_in(other, link)
        return float(np.linalg.norm(np.cross(a, b))) < COLLINEAR


@final
@dataclass
class Placed:
    """The dyads at n rows, every part computed once for the signs that it depends on.

    `vectors(pair, link)` gives the axis (3, n) of a pair on a given link; `turned` the
    vector (3, n) in base axes of a vector (3,) of a given link.
    """

    dyads: Dyads
    given_axes: Mapping[int, Floats]
    given_rotation: Floats | None
    known: dict[Hashable, Any] = field(default_factory=dict)

    def key(self, name: str, what: int, group: int, signs: Signs) -> Hashable:
        return (name, what, *(signs[other] for other in self.dyads.needs[group]))

    def axis(self, pair: int, link: int, signs: Signs) -> Floats:
        """Return the axis (3, n) or (3, 1) of a pair, seen on one of its links."""
        dyads = self.dyads
        if link == dyads.base:
            return dyads.axis_in(pair, link)[:, None]
        if link in dyads.given:
            if pair in self.given_axes:
                return self.given_axes[pair]
            return self.vector(dyads.axis_in(pair, link), link, signs, ("axis", pair))
        group = dyads.placed_by[link]
        stand = dyads.stands[group]
        if pair == stand.middle:
            return self.middle(group, signs)[0]
        if pair == (stand.near if link == stand.first else stand.far):
            foot = stand.foot if link == stand.first else stand.hold
            return self.axis(pair, foot, signs)
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
            if key not in self.known:
                assert self.given_rotation is not None
                r = self.given_rotation
                self.known[key] = (
                    vector[0] * r[:, 0] + vector[1] * r[:, 1] + vector[2] * r[:, 2]
                )
            return np.asarray(self.known[key])
        group = dyads.placed_by[link]
        key = (self.key(name[0], name[1], group, signs), link)
        if key not in self.known:
            spread = dyads.spread_of(vector, link)
            p = self.axis(spread.outer, link, signs)
            q = self.axis(spread.middle, link, signs)
            a, b, c = spread.weights
            self.known[key] = a * p + b * q + c * cross(p, q)
        return np.asarray(self.known[key])

    def outer(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the axes of a dyad's near and far pair."""
        stand = self.dyads.stands[group]
        return (
            self.axis(stand.near, stand.foot, signs),
            self.axis(stand.far, stand.hold, signs),
        )

    def middle(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the middle axis (3, n) and middle . (near x far) (n,), NaN out of reach."""
        key = self.key("middle", group, group, signs)
        if key not in self.known:
            level, across, height = self._halves(group, signs)
            sign = signs[group] * self.dyads.stands[group].parity
            self.known[key] = level + sign * across, sign * height
        found: tuple[Floats, Floats] = self.known[key]
        return found

    def _halves(self, group: int, signs: Signs) -> tuple[Floats, Floats, Floats]:
        """Return the part of the middle axis that both signs share, the other, and |t|."""
        before = signs[:group] + (0,) + signs[group + 1 :]
        key = self.key("halves", group, group, before)
        if key not in self.known:
            cones = self.dyads.stands[group].cones
            a, c = self.outer(group, signs)
            total, difference = a + c, a - c
            u, v = dot(total, total), dot(difference, difference)
            more = (np.cos(cones.near) + np.cos(cones.far)) / u
            less = (np.cos(cones.near) - np.cos(cones.far)) / v
            square = cones.square(u, v)
            root = np.sqrt(np.where(square > -REACH_SLACK, np.maximum(square, 0.0), np.nan))
            across = cross(a, c)
            self.known[key] = (
                total * more + difference * less,
                across * (4.0 * root / (u * v)),
                root,
            )
            base = 2.0 * np.arctan2(np.sqrt(v), np.sqrt(u))
            centre = 0.5 * (cones.longest + cones.shortest)
            reach = 0.5 * (cones.longest - cones.shortest)
            self.known[key, "margin"] = reach - np.abs(base - centre)
        found: tuple[Floats, Floats, Floats] = self.known[key]
        return found

    def margin(self, group: int, signs: Signs) -> Floats:
        """Return by how much (rad) a dyad reaches, negative if it does not (n,)."""
        self._halves(group, signs)
        before = signs[:group] + (0,) + signs[group + 1 :]
        return np.asarray(self.known[self.key("halves", group, group, before), "margin"])

    def angle(self, pair: int, signs: Signs) -> Floats:
        """Return the variable (n,) of a dyad's pair in (-pi, pi] rad."""
        group = self.dyads.group_of[pair]
        key = self.key("angle", pair, group, signs)
        if key not in self.known:
            a, b = self.dyads.ends[pair]
            one, first = self._side(pair, a, signs)
            other, second = self._side(pair, b, signs)
            axis = self.axis(pair, a if a == self.dyads.base else b, signs)
            x = dot(one, other) - first[2] * second[2]
            y = dot(axis, cross(one, other))
            turn = second[0] * first[0] + second[1] * first[1]
            side = second[1] * first[0] - second[0] * first[1]
            self.known[key] = np.arctan2(y * turn - x * side, x * turn + y * side)
        return np.asarray(self.known[key])

    def _side(self, pair: int, link: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return a vector of a link off a pair's axis, and its components in the frame.

        The components (3,) are those in the pair's frame in that link.
        """
        dyads = self.dyads
        frame = dyads.frame_in(pair, link)
        if link == dyads.base or link in dyads.given:
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
        key = self.key("rate", pair, group, signs)
        if key not in self.known:
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
            moved = self._along(across, stand.hold, far, signs)
            still = self._along(across, stand.foot, near, signs)
            rate = _difference(moved, still)
            ahead = dyads.ends[pair][1] == body
            self.known[key] = Fraction(rate.top, rate.bottom * (-triple if ahead else triple))
        found: Fraction = self.known[key]
        return found

    def _along(
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
            return self._along(vector, foot, pair, signs)
        carried = self._along(vector, foot, None, signs)
        own = self.rate(pair, signs)
        share = dot(vector, self.axis(pair, link, signs))
        ahead = dyads.ends[pair][1] == link
        turned = Fraction(own.top * (share if ahead else -share), own.bottom)
        return turned if carried is None else _sum(turned, carried)


def _sum(one: Fraction, other: Fraction) -> Fraction:
    return Fraction(
        one.top * other.bottom + other.top * one.bottom, one.bottom * other.bottom
    )


def _difference(one: Fraction | None, other: Fraction | None) -> Fraction:
    if other is None:
        assert one is not None, "a dyad on the base alone does not move with the output"
        return one
    minus = Fraction(-other.top, other.bottom)
    return minus if one is None else _sum(one, minus)

