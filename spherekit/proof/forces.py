"""What masses and loads do on a motion in balls, with switches where loads have kinks.

What a load is made of is said in `spherekit.model.dynamics`. An expression that is not
smooth is continued beyond its kinks: each `abs`, `sign`, `min` and `max` depends on the
sign of a condition, which is held on the side it is said to be on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.expression import KINKED, ON_ARRAYS, fold
from spherekit.model.load import LinkMoment, TorqueTable, expression_of
from spherekit.model.mechanism import Mechanism
from spherekit.proof.balls import Ball, Balls, exact, exactly, floats
from spherekit.proof.rows import ExactRows

Sides = NDArray[np.float64] | None
"""The sides (switches,) +1 or -1 of all conditions; None takes those they are on."""


@final
@dataclass
class Moving:
    """A mechanism in motion at n rows, by a coordinate of its own.

    `values` (n, variables) rad, whole turns included; `rates` (n, variables) and `w`
    (n, links, 3), in ground axes, per unit rate of the coordinate; `rotations`
    (n, links, 3, 3); `speed` (n,) the rate of the coordinate by time; `t` (n,) s.
    """

    values: Balls
    rates: Balls
    w: Balls
    rotations: Balls
    speed: Balls
    t: Balls


def exact_inertia(exact: ExactRows) -> tuple[Balls, Balls]:
    """Return the equivalent inertia B (n,), kg m2, and its derivative by the input (n,).

    Twice the kinetic energy per squared rate of the input that moves (Di Gregorio 2024,
    eqs. (14), (15)). Inertia tensors are taken as the float64 numbers they are given by.

    Raises
    ------
    ValueError
        If the rows were made with order 1, without derivatives.
    """
    if exact.dw is None:
        raise ValueError("inertia needs rows of order 2 or 3")
    with exact.arithmetic.within():
        return inertia(exact.mechanism, exact.rotations, exact.w, exact.dw)


def inertia(
    mechanism: Mechanism, rotations: Balls, w: Balls, dw: Balls
) -> tuple[Balls, Balls]:
    """Return B (n,) of a coordinate and its derivative by it, see `exact_inertia`.

    From orientations (n, links, 3, 3), angular velocities (n, links, 3) per unit rate of
    the coordinate, and their derivatives by it.
    """
    B = dB = exactly(np.zeros(len(w)))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn, turning = rotations[:, link], w[:, link, :, None]
        momentum = turn @ (exactly(mass.tensor) @ (turn.swapaxes(1, 2) @ turning))
        B = B + np.sum(turning * momentum, axis=(1, 2))
        dB = dB + 2 * np.sum(dw[:, link, :, None] * momentum, axis=(1, 2))
    return B, dB


@final
class _Switches:
    """The conditions met so far, in the order in which expressions are evaluated."""

    def __init__(self, sides: Sides) -> None:
        self.sides = sides
        self.conditions: list[Balls] = []

    def side(self, condition: Balls) -> Any:
        """Return the side of the next condition (n,)."""
        self.conditions.append(np.atleast_1d(condition))
        if self.sides is None:
            return np.sign(floats(condition))
        return self.sides[len(self.conditions) - 1]

    def applied(self, name: str, given: Sequence[Any]) -> Any:
        """Return a function of expressions; NaN outside its domain."""
        if name == "sign":
            return self.side(given[0]) + 0 * given[0]
        if name == "abs":
            return self.side(given[0]) * given[0]
        if name in KINKED:
            upward = 1 if name == "max" else -1
            best = given[0]
            for item in given[1:]:
                gap = best - item
                best = (best + item + upward * self.side(gap) * gap) / 2
            return best
        if not hasattr(exact(0.0), name):
            return ON_ARRAYS[name](*given)
        return np.frompyfunc(lambda x, *more: getattr(x, name)(*more), len(given), 1)(
            *given
        )


@final
class Forces:
    """The loads of a mechanism; numbers in their expressions are the float64 they are."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.parts = [
            part for load in mechanism.loads for part in load.components(mechanism)
        ]

    def knots(self, until: float) -> list[Ball]:
        """Return the times between 0 and `until` (s) at which tables have kinks."""
        knots = []
        for part in self.parts:
            table = part.magnitude
            if not isinstance(table, TorqueTable):
                continue
            times = exactly(table.times)
            turns = range(1)
            if table.periodic:
                period = table.times[-1] - table.times[0]
                first = int(np.floor(-table.times[-1] / period))
                turns = range(first, int(np.ceil((until - table.times[0]) / period)) + 1)
            for turn in turns:
                knots += [(t + turn * (times[-1] - times[0])).mid() for t in times]
        inside = {float(t): t for t in knots if 0.0 < float(t) < until}
        return [inside[t] for t in sorted(inside)]

    def at(self, moving: Moving, sides: Sides, inside: float) -> tuple[Balls, list[Balls]]:
        """Return the generalised force of all loads (n,), and the switches' conditions.

        `inside` is a time (s) between the knots that the rows lie between.
        """
        switches, variables = _Switches(sides), self.mechanism.angles
        total = exactly(np.zeros(len(moving.t)))

        def named(name: str) -> Any:
            kind, _, pair = name.partition("_")
            if kind == "t":
                return moving.t
            if kind == "theta":
                return moving.values[:, variables[pair]]
            return moving.rates[:, variables[pair]] * moving.speed

        for part in self.parts:
            if isinstance(part.magnitude, TorqueTable):
                magnitude = _of_table(part.magnitude, moving.t, inside)
            else:
                law = expression_of(part.magnitude)
                magnitude = fold(law.root, exact, named, switches.applied)
            if part.pair:
                total = total + magnitude * moving.rates[:, variables[part.pair]]
            for moment in part.moments:
                total = total + magnitude * self._power(moment, moving)
        return total, switches.conditions

    def _power(self, moment: LinkMoment, moving: Moving) -> Balls:
        """Return the power (n,) of a moment per unit rate of the coordinate."""
        link = self.mechanism.link_number[moment.link]
        w, turn = moving.w[:, link], moving.rotations[:, link]
        if moment.arm is not None:
            w = np.cross(w, turn @ exactly(moment.arm))
        direction = exactly(moment.direction)
        direction = turn @ direction if moment.axes == "link" else direction
        return np.asarray(np.sum(w * direction, axis=1))


def _of_table(table: TorqueTable, t: Balls, inside: float) -> Balls:
    """Return a table's torque along the line that it has at the time `inside`."""
    times, torques = exactly(table.times), exactly(table.torques)
    period = times[-1] - times[0]
    turn = 0
    if table.periodic:
        turn = int(np.floor((inside - table.times[0]) / float(period)))
    within = inside - turn * float(period)
    after = int(np.clip(np.searchsorted(table.times, within), 1, len(times) - 1))
    slope = (torques[after] - torques[after - 1]) / (times[after] - times[after - 1])
    return np.asarray(torques[after - 1] + slope * (t - turn * period - times[after - 1]))
