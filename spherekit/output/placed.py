"""Dyads placed one after another on one body, as vectors of pair axes over many rows.

The middle axis of a dyad follows from the outer ones (`spherekit.sphere.dyad`). The rates
of its pairs follow from the triple product t of its axes, and with them how the inputs
move per unit rate of the output. Arrays are (3, n), components first.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import REACH_SLACK
from spherekit.motion.assembly_modes import FLAT_DYAD
from spherekit.output.dyads import Dyads, Signs
from spherekit.rates.vectors import cross, dot
from spherekit.sphere.dyad import middle_axis, triple_square
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Fraction:
    """A rate, linear in the output's angular velocity w: top . w / bottom.

    `top` (3, n) and `bottom` (n,); both stay finite at a singular configuration.
    """

    top: Floats
    bottom: Floats


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
            turn = np.array([[part[0], part[1]], [-part[1], part[0]]])
            x, y = turn @ dyads.frame_in(pair, dyads.base)[:, :2].T @ other
            return np.asarray(np.arctan2(y if a == dyads.base else -y, x))
        one, first = self._side(pair, a, signs)
        other, second = self._side(pair, b, signs)
        x = dot(one, other) - first[2] * second[2]
        y = dot(self.axis(pair, b, signs), cross(one, other))
        turn = second[0] * first[0] + second[1] * first[1]
        side = second[1] * first[0] - second[0] * first[1]
        return np.asarray(np.arctan2(y * turn - x * side, x * turn + y * side))

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
