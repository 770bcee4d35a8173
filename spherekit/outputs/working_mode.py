"""One working mode of dyads placed one after another on one body, over many rows.

The middle axis of a dyad follows from the outer ones (`spherekit.geometry.dyad_axis`). The
rates of its pairs follow from the triple product t of its axes, and with them how the
inputs move per unit rate of the output. Arrays are (3, n), components first. What depends
on the signs of some groups only is computed once for all modes that share these.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.geometry.dyad_axis import middle_axis, triple_square
from spherekit.outputs.dyad_chain import Dyads, Signs
from spherekit.positions.assembly_mode import has_configuration
from spherekit.status import Status
from spherekit.tolerances import REACH_SLACK, SINGULAR_DYAD_SINE
from spherekit.velocities.direction_signs import dot, norm
from spherekit.velocities.pole_request import cross


@dataclass(frozen=True)
class Fraction:
    """A rate, linear in the output's angular velocity w: top . w / bottom.

    `top` (3, n) and `bottom` (n,); both stay finite at a singular configuration.
    """

    top: Floats
    bottom: Floats

    def __sub__(self, other: "Fraction") -> "Fraction":
        top = self.top * other.bottom - other.top * self.bottom
        return Fraction(top, self.bottom * other.bottom)


Made = TypeVar("Made")
Of = Callable[["PosedMode", Any], Made]
"""A method of a mode that is asked about one thing."""


def _once(method: Of[Made]) -> Of[Made]:
    """Compute what a method returns once for all modes with the signs that it needs."""

    @wraps(method)
    def once(mode: "PosedMode", what: Hashable) -> Made:
        needs, about = mode.dyads.needs, (method, what)
        key = (about, *(mode.signs[k] for k in needs.get(about, ())))
        if key not in mode.shared:
            alone = replace(mode, asked=set())
            with np.errstate(all="ignore"):
                made = method(alone, what)
            needs[about] = frozenset(alone.asked)
            key = (about, *(mode.signs[k] for k in needs[about]))
            mode.shared[key] = made
        mode.asked.update(needs[about])
        return mode.shared[key]  # type: ignore[no-any-return]

    return once


@dataclass(frozen=True)
class PosedMode:
    """The dyads at n poses of the output, in one mode.

    `given_axes` are the axes (3, n) of pairs on the given link, `given_rotation` the
    columns (3, 3, n) of its orientation, for its other axes. `driven` are the pairs of the
    inputs, `measure` gives the measure of type II. Where a bar gives the output's turn,
    `turn` are the rate of its gap, the directions (3, n) and the status (n,). Modes of the
    same poses have `shared` in common; `asked` are the dyads whose signs were asked for.
    """

    dyads: Dyads
    signs: Signs
    given_axes: Mapping[int, Floats]
    given_rotation: Floats | None
    driven: tuple[int, ...] = ()
    measure: "Callable[[PosedMode], Floats] | None" = None
    turn: tuple[Fraction, Floats, SmallIntegers] | None = None
    shared: dict[Hashable, Any] = field(default_factory=dict)
    asked: set[int] = field(default_factory=set)

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi], NaN where the mode has no configuration."""
        return np.stack([self.input(pair) for pair in self.driven], axis=1)

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""
        return np.stack([self.speed(pair) for pair in self.driven], axis=1)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) its squares, continued smoothly and negative beyond the reach."""
        return np.stack([self._speed_square(pair) for pair in self.driven], axis=1)

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, NaN where the mode has no configuration."""
        assert self.measure is not None
        return np.where(self._held, self.measure(self), np.nan)

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        moved = [self.moved(pair)[0] for pair in self.driven]
        return np.stack([(rate.top / rate.bottom).T for rate in moved], axis=1)

    @property
    def slope(self) -> Floats:
        """The derivative (n,) of the bar's gap by the turn."""
        assert self.turn is not None
        gap, directions, _ = self.turn
        return dot(gap.top, directions) / gap.bottom

    @property
    def status(self) -> SmallIntegers:
        """(n,) whether the mode closes, see `Inverse`."""
        return self.reach[2] if self.turn is None else self.turn[2]

    @property
    def _held(self) -> Bools:
        return has_configuration(self.status)

    @property
    def reach(self) -> tuple[Floats, SmallIntegers, SmallIntegers]:
        """Margin, limiting dyad and status of the dyads (n,), see `Inverse`."""
        return self._reach("")

    @_once
    def _reach(self, _dyads: str) -> tuple[Floats, SmallIntegers, SmallIntegers]:
        margins, sound = [], []
        for number, stand in enumerate(self.dyads.stands):
            root, (u, v) = self._halves(number)[2:]
            half = np.arcsin(np.minimum(0.5 * np.sqrt(np.minimum(u, v)), 1.0))
            base = np.where(u < v, np.pi - 2.0 * half, 2.0 * half)
            margins.append(np.minimum(base - stand.shortest, stand.longest - base))
            sound.append(root >= SINGULAR_DYAD_SINE * np.prod(np.sin(stand.arcs)))
        margin = np.fmin.reduce(margins)
        limiting = np.argmax(margins == margin, axis=0).astype(np.int8)
        status = np.where(np.all(sound, axis=0), Status.OK, Status.AT_SINGULARITY)
        status[~(margin >= -REACH_SLACK)] = Status.OUT_OF_REACH
        return margin, limiting, status.astype(np.int8)

    def axis(self, pair: int, link: int) -> Floats:
        """Return the axis (3, n) or (3, 1) of a pair, seen on one of its links."""
        dyads = self.dyads
        pair, link, sense = dyads.source(pair, link)
        group = dyads.placed_by.get(link)
        if link == dyads.given and pair in self.given_axes:
            axis = self.given_axes[pair]
        elif group is not None and pair == dyads.stands[group].middle:
            axis = self.middle(group)[0]
        else:
            axis = self.vector(link, dyads.axis_in(pair, link))
        return -axis if sense < 0.0 else axis

    def vector(self, link: int, vector: Floats) -> Floats:
        """Return a vector (3,) of a link in base axes, (3, n) or (3, 1)."""
        if link == self.dyads.base:
            return vector[:, None]
        return self._carried((link, *vector.tolist()))

    @_once
    def _carried(self, carried: tuple[int, float, float, float]) -> Floats:
        link, *vector = carried
        if link == self.dyads.given:
            assert self.given_rotation is not None
            return (np.array(vector) @ self.given_rotation.reshape(3, -1)).reshape(3, -1)
        stand = self.dyads.stands[self.dyads.placed_by[link]]
        p = self.axis(self.dyads.stands_by(link)[0], link)
        q = self.axis(stand.middle, link)
        a, b, c = self.dyads.spread(*carried)
        return a * p + b * q + c * cross(p, q)

    def _outer(self, group: int) -> tuple[Floats, Floats]:
        """Return the axes of a dyad's near and far pair."""
        stand = self.dyads.stands[group]
        return self.axis(stand.near, stand.foot), self.axis(stand.far, stand.hold)

    @_once
    def middle(self, group: int) -> tuple[Floats, Floats]:
        """Return the middle axis (3, n) and middle . (near x far), NaN out of reach."""
        level, across, height, _ = self._halves(group)
        self.asked.add(group)
        sign = self.signs[group] * self.dyads.stands[group].parity
        return level + sign * across, sign * height

    @_once
    def _halves(self, group: int) -> tuple[Floats, Floats, Floats, tuple[Floats, Floats]]:
        """Return the part of the middle axis that both signs share, the other, and |t|.

        With them the squares of the sum and the difference of the outer axes.
        """
        stand = self.dyads.stands[group]
        a, c = self._outer(group)
        total, rest = a + c, a - c
        squares = dot(total, total), dot(rest, rest)
        square = triple_square(*stand.halves, *squares)
        square[(square < 0.0) & (square > -REACH_SLACK)] = 0.0
        root = np.sqrt(square)
        along, beside, height = middle_axis(*stand.halves, *squares, root)
        level = total * along
        if stand.arcs[0] != stand.arcs[1]:
            level += rest * beside
        across = cross(rest, total)  # 2 a x c, to rounding of its own size
        across *= 0.5 * height
        return level, across, root, squares

    @_once
    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad, NaN out of reach."""
        dyads = self.dyads
        a, b = dyads.ends[pair]
        one, first = self._side(pair, a)
        other, second = self._side(pair, b)
        x = dot(one, other) - first[2] * second[2]
        y = dot(self.axis(pair, b), cross(one, other))
        turned = second[0] * first[0] + second[1] * first[1]
        side = second[1] * first[0] - second[0] * first[1]
        return np.arctan2(y * turned - x * side, x * turned + y * side)

    def _side(self, pair: int, link: int) -> tuple[Floats, Floats]:
        """Return a vector of a link off a pair's axis, and its components in the frame.

        The components (3,) are those in the pair's frame in that link.
        """
        dyads = self.dyads
        frame = dyads.frame_in(pair, link)
        if link in (dyads.base, dyads.given):
            return self.vector(link, frame[:, 0]), np.array([1.0, 0.0, 0.0])
        other = dyads.stands[dyads.placed_by[link]].middle
        if pair == other or dyads.is_coaxial(pair, other, link):
            other, _ = dyads.stands_by(link)
        return self.axis(other, link), dyads.axis_in(other, link) @ frame

    @_once
    def input(self, pair: int) -> Floats:
        """Return an input (n,), NaN where the mode has no configuration."""
        return np.where(self._held, self.angle(pair), np.nan)

    @_once
    def rate(self, pair: int) -> Fraction:
        """Return the rate of a pair's variable per unit rate of the output.

        Notes
        -----
        The rates of the two bodies, w_foot + a A = w_hold + c C - b B, times the product
        of two of the axes, leave the rate of the third pair.
        """
        group = self.dyads.group_of[pair]
        stand = self.dyads.stands[group]
        (a, c), (b, triple) = self._outer(group), self.middle(group)
        if pair == stand.near:
            across, body = cross(b, c), stand.first
        elif pair == stand.middle:
            across, body = cross(c, a), stand.second
        else:
            across, body = cross(b, a), stand.second
        moved = self.along(across, stand.hold, None if pair == stand.far else stand.far)
        stays = self.along(across, stand.foot, None if pair == stand.near else stand.near)
        rate, ahead = moved - stays, self.dyads.ends[pair][1] == body
        return Fraction(rate.top, rate.bottom * (-triple if ahead else triple))

    def along(self, vector: Floats, link: int, across: int | None) -> Fraction:
        """Return vector . w of a link.

        The vector is at right angles to the axis of the pair `across` on that link, if
        one is named.
        """
        dyads = self.dyads
        if link == dyads.base:
            return Fraction(np.zeros((3, 1)), np.ones(1))
        if link == dyads.given:
            return Fraction(vector, np.ones(1))
        pair, foot = dyads.stands_by(link)
        if across is not None and dyads.is_coaxial(pair, across, link):
            return self.along(vector, foot, pair)
        turning, share = self.rate(pair), dot(vector, self.axis(pair, link))
        back = -share if dyads.ends[pair][1] == link else share
        return self.along(vector, foot, None) - Fraction(turning.top * back, turning.bottom)

    @_once
    def moved(self, pair: int) -> tuple[Fraction, Floats]:
        """Return the rate of an input, the turn being what the bar asks, and its size."""
        rate = self.rate(pair)
        if self.turn is not None:
            gap, directions, _ = self.turn
            along, about = dot(rate.top, directions), dot(gap.top, directions)
            rate = Fraction(rate.top * about - gap.top * along, rate.bottom * about)
        return rate, norm(rate.top)

    def normal(self, pair: int) -> Floats:
        """Return the unit normal (3, n) along which the output turns with an input."""
        rate, size = self.moved(pair)
        return rate.top * (np.sign(rate.bottom) / size)

    @_once
    def speed(self, pair: int) -> Floats:
        """Return how fast (n,) the output turns about that per unit rate of the input."""
        rate, size = self.moved(pair)
        return np.abs(rate.bottom) / size

    def _speed_square(self, pair: int) -> Floats:
        """Return the square (n,) of the speed, continued beyond the reach.

        Smoothly, where the dyad of the pair stands on the base and the output alone.
        """
        group, square = self.dyads.group_of[pair], self.speed(pair) ** 2
        stand = self.dyads.stands[group]
        other = stand.arcs[1 if pair == stand.near else 0]
        triple = triple_square(*stand.halves, *self._halves(group)[3])
        return np.where(np.isnan(square), np.fmin(triple / np.sin(other) ** 2, 0.0), square)

    def axes(self, count: int) -> Floats:
        """Return the axes (n, count, 3) of the first pairs, NaN where the mode has none."""
        axes = np.empty((len(self.status), count, 3))
        for pair in range(count):
            axes[:, pair] = self._axis(pair).T
        return axes

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        NaN where an axis cannot be placed; it may be known where the mode does not close.
        """
        return np.broadcast_to(dot(self._axis(one), self._axis(other)), len(self.status))

    def _axis(self, pair: int) -> Floats:
        dyads = self.dyads
        order = {**dyads.placed_by, dyads.base: -1, dyads.given: -1}
        first = min(dyads.ends[pair], key=lambda link: order.get(link, np.inf))
        return self.axis(pair, first)
