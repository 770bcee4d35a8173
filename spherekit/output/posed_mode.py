"""One working mode of placed dyads: how it reaches, its inputs, rates, axes and angles."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import REACH_SLACK, Status
from spherekit.output.closing_link import Fraction, Placed
from spherekit.output.dyads import Signs
from spherekit.rates.request import dot, norm


@final
@dataclass(frozen=True)
class Reachability:
    """Whether the dyads of a mode close (n,), see `Inverse`; `key` names what it is of."""

    key: Hashable
    margin: Floats
    limiting: SmallIntegers
    status: SmallIntegers


def reach_of(placed: Placed, signs: Signs) -> Reachability:
    """Return whether the dyads of a mode close."""
    numbers = range(len(signs))
    key = ("reach", *(placed.reach_key(number, signs) for number in numbers))
    if key not in placed.computed:
        margin = placed.margin(0, signs)
        limiting = np.zeros(len(margin), dtype=np.int8)
        status = np.zeros(len(margin), dtype=np.int8)
        for number in numbers:
            another = placed.margin(number, signs)
            limiting[another < margin] = number
            margin = np.fmin(margin, another)
            status[~placed.sound(number, signs)] = Status.AT_SINGULARITY
        status[~(margin >= -REACH_SLACK)] = Status.OUT_OF_REACH
        placed.computed[key] = Reachability(key, margin, limiting, status)
    reach: Reachability = placed.computed[key]
    return reach


@final
@dataclass(frozen=True)
class Rate:
    """How an input moves with the output: a vector (3, n) along its normal, and sizes."""

    normal: Floats
    size: Floats
    sense: Floats
    speed: Floats

    @property
    def unit(self) -> Floats:
        """The unit normal (3, n)."""
        return self.normal * (self.sense / self.size)


@final
@dataclass(frozen=True)
class PosedMode:
    """One mode of placed dyads; `turn` are the rate of the bar's gap and the directions.

    `driven` are the pairs of the inputs, `measure` gives the measure of type II. What
    other modes share is taken from what is known of `placed` already.
    """

    placed: Placed
    signs: Signs
    reach: Reachability
    driven: tuple[int, ...]
    measure: "Callable[[PosedMode], Floats]"
    turn: tuple[Fraction, Floats] | None = None

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi], NaN where the mode has no configuration."""
        return np.stack([self.input(pair) for pair in self.driven], axis=1)

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""
        return np.stack([self.rate(pair).speed for pair in self.driven], axis=1)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) its squares, continued smoothly and negative beyond the reach."""
        return np.stack([self.speed_square(pair) for pair in self.driven], axis=1)

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, NaN where the mode has no configuration."""
        measure = self.measure(self)
        held = np.isin(self.reach.status, (Status.OK, Status.AT_SINGULARITY))
        return np.where(held, measure, np.nan)

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        rates = [self.rate(pair) for pair in self.driven]
        return np.stack([(rate.unit / rate.speed).T for rate in rates], axis=1)

    @property
    def slope(self) -> Floats:
        """The derivative (n,) of the bar's gap by the turn."""
        assert self.turn is not None
        gap, directions = self.turn
        return dot(gap.top, directions) / gap.bottom

    def input(self, pair: int) -> Floats:
        """Return an input (n,), NaN where the mode has no configuration."""
        computed = self.placed.computed
        angle, key = self.placed.angle(pair, self.signs)
        masked = (key, self.reach.key)
        if masked not in computed:
            held = angle.copy()
            status = self.reach.status
            held[(status != Status.OK) & (status != Status.AT_SINGULARITY)] = np.nan
            computed[masked] = held
        return np.asarray(computed[masked])

    def rate(self, pair: int) -> Rate:
        """Return how an input moves with the output, its turn being what the bar asks."""
        placed, signs = self.placed, self.signs
        key = ("size", placed.key("rate", pair, placed.dyads.moves_with(pair), signs))
        if key not in placed.computed:
            rate = placed.rate(pair, signs)
            if self.turn is not None:
                gap, directions = self.turn
                along, about = dot(rate.top, directions), dot(gap.top, directions)
                rate = Fraction(rate.top * about - gap.top * along, rate.bottom * about)
            size = norm(rate.top)
            speed = np.abs(rate.bottom) / size
            placed.computed[key] = Rate(rate.top, size, np.sign(rate.bottom), speed)
        output_rate: Rate = placed.computed[key]
        return output_rate

    def speed_square(self, pair: int) -> Floats:
        """Return the square (n,) of the speed of `rate`, continued beyond the reach.

        Smoothly, where the dyad of the pair stands on the base and the output alone.
        """
        dyads, signs = self.placed.dyads, self.signs
        square = self.rate(pair).speed ** 2
        stand = dyads.stands[dyads.group_of[pair]]
        other = stand.cones.far if pair == stand.near else stand.cones.near
        beyond = self.placed.square(dyads.group_of[pair], signs) / np.sin(other) ** 2
        return np.where(np.isnan(square), np.fmin(beyond, 0.0), square)

    def axes(self, count: int) -> Floats:
        """Return the axes (n, count, 3) of the first pairs, NaN where the mode has none."""
        n = len(self.reach.status)
        axes = np.empty((n, count, 3))
        for pair in range(count):
            axes[:, pair] = self._axis(pair).T
        return axes

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad, NaN out of reach."""
        return self.placed.angle(pair, self.signs)[0]

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        NaN where an axis cannot be placed; it may be known where the mode does not close.
        """
        cosine = dot(self._axis(one), self._axis(other))
        return np.broadcast_to(cosine, len(self.reach.status))

    def _axis(self, pair: int) -> Floats:
        dyads = self.placed.dyads
        placed = {dyads.base, *dyads.given, *dyads.placed_by}
        nearest = min(
            (link for link in dyads.ends[pair] if link in placed),
            key=lambda link: len(dyads.needs_of(dyads.source(pair, link)[1])),
        )
        return self.placed.axis(pair, nearest, self.signs)
