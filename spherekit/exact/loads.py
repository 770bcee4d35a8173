"""What loads do on a motion, in any arithmetic, with switches where they have kinks.

What a load is made of is said in `spherekit.model.dynamics`. An expression that is not
smooth is continued beyond its kinks: each `abs`, `sign`, `min` and `max` depends on the
sign of a condition, which is held on the side it is said to be on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.series import cross
from spherekit.model.expression import KINKED, Expression, fold
from spherekit.model.load import LinkMoment, expression_of
from spherekit.model.mechanism import Mechanism
from spherekit.model.torque_table import TorqueTable

Sides = NDArray[np.float64] | None
"""The sides (switches,) +1 or -1 of all conditions; None takes those they are on."""


@final
@dataclass(frozen=True)
class ExactLoadState:
    """A mechanism in motion at n rows, by a coordinate of its own.

    `values` (n, variables) rad, whole turns included; `rates` (n, variables) and `w`
    (n, links, 3), in ground axes, per unit rate of the coordinate; `rotations`
    (n, links, 3, 3); `speed` (n,) the rate of the coordinate by time; `t` (n,) s.
    """

    values: Numbers
    rates: Numbers
    w: Numbers
    rotations: Numbers
    speed: Numbers
    t: Numbers


@final
@dataclass
class _Switches:
    """The conditions met so far, in the order in which expressions are evaluated."""

    sides: Sides
    arithmetic: Arithmetic
    conditions: list[Numbers] = field(default_factory=list)

    def side(self, condition: Numbers) -> Any:
        """Return the side of the next condition (n,)."""
        self.conditions.append(condition)
        if self.sides is None:
            return np.sign(self.arithmetic.floats(condition)).astype(int)
        return int(self.sides[len(self.conditions) - 1])


@final
class ExactLoads:
    """The loads of a mechanism; numbers in their expressions are the float64 they are."""

    def __init__(self, arithmetic: Arithmetic, mechanism: Mechanism) -> None:
        self.arithmetic, self.mechanism = arithmetic, mechanism
        self.parts = [
            part for load in mechanism.loads for part in load.components(mechanism)
        ]
        self._variables = mechanism.angles

    def knots(self, until: float) -> list[Any]:
        """Return the times between 0 and `until` (s) at which tables have kinks."""
        knots = []
        for part in self.parts:
            table = part.magnitude
            if not isinstance(table, TorqueTable):
                continue
            times = self.arithmetic.exact(table.times)
            turns = range(1)
            if table.periodic:
                period = table.times[-1] - table.times[0]
                first = int(np.floor(-table.times[-1] / period))
                turns = range(first, int(np.ceil((until - table.times[0]) / period)) + 1)
            for turn in turns:
                knots += [t + turn * (times[-1] - times[0]) for t in times]
        inside = [t for t in knots if 0.0 < float(t) < until]
        return sorted(set(inside))

    def force(
        self, moving: ExactLoadState, sides: Sides, inside: float
    ) -> tuple[Numbers, list[Numbers]]:
        """Return the generalised force of all loads (n,), and the switches' conditions.

        `inside` is a time (s) between the knots that the rows lie between.
        """
        switches = _Switches(sides, self.arithmetic)
        total = self.arithmetic.zeros(len(moving.t))
        for part in self.parts:
            if isinstance(part.magnitude, TorqueTable):
                magnitude = self._table(part.magnitude, moving.t, inside)
            else:
                law = expression_of(part.magnitude)
                magnitude = self._value(law, moving, switches)
            if part.pair:
                total = total + magnitude * moving.rates[:, self._variables[part.pair]]
            for moment in part.moments:
                total = total + magnitude * self._power(moment, moving)
        return total, switches.conditions

    def _table(self, table: TorqueTable, t: Numbers, inside: float) -> Numbers:
        """Return a table's torque along the line that it has at the time `inside`."""
        times, torques = (self.arithmetic.exact(x) for x in (table.times, table.torques))
        period = times[-1] - times[0]
        turn = 0
        if table.periodic:
            turn = int(np.floor((inside - table.times[0]) / float(period)))
        within = inside - turn * float(period)
        after = int(np.clip(np.searchsorted(table.times, within), 1, len(times) - 1))
        slope = (torques[after] - torques[after - 1]) / (times[after] - times[after - 1])
        since = t - turn * period - times[after - 1]
        return np.asarray(torques[after - 1] + slope * since)

    def _power(self, moment: LinkMoment, moving: ExactLoadState) -> Numbers:
        """Return the power (n,) of a moment per unit rate of the coordinate."""
        link = self.mechanism.link_number[moment.link]
        w, turn = moving.w[:, link], moving.rotations[:, link]
        if moment.arm is not None:
            arm = (turn @ self.arithmetic.exact(moment.arm)[:, None])[..., 0]
            w = cross(w[None], arm[None])[0]
        direction = self.arithmetic.exact(moment.direction)
        if moment.axes == "link":
            direction = (turn @ direction[:, None])[..., 0]
        return np.asarray(np.sum(w * direction, axis=-1))

    def _value(self, law: Expression, moving: ExactLoadState, switches: _Switches) -> Any:
        def named(name: str) -> Any:
            if name == "t":
                return moving.t
            kind, _, pair = name.partition("_")
            variable = self._variables[pair]
            if kind == "theta":
                return moving.values[:, variable]
            return moving.rates[:, variable] * moving.speed

        def apply(function: str, given: Sequence[Any]) -> Any:
            if function in KINKED:
                return _kinked(function, given, switches)
            return self.arithmetic.function(function, *given)

        def number(value: float) -> Any:
            return self.arithmetic.exact(value)[()]

        return fold(law.root, number, named, apply)


def _kinked(name: str, given: Sequence[Any], switches: _Switches) -> Any:
    if name == "sign":
        return switches.side(given[0]) + 0 * given[0]
    if name == "abs":
        return switches.side(given[0]) * given[0]
    upward = 1 if name == "max" else -1
    best = given[0]
    for item in given[1:]:
        gap = best - item
        best = (best + item + upward * switches.side(gap) * gap) / 2
    return best
