"""The moments of several inputs that a motion takes, as terms.

Newton's and Euler's equations of the links along the velocities that an input leaves free
while the others rest: with w_ji the angular velocity of link j per unit rate of input i,

    torque_i = sum_j w_ji . (I_j a_j + w_j x I_j w_j) - the power of the loads by input i.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.engine.algebra import Exprs, cross, dot
from spherekit.engine.coordinate_rates import CoordinateRates
from spherekit.engine.expression_graph import Expr
from spherekit.engine.pose import LinkOrientation
from spherekit.engine.turns import Entries


@final
class InputMoments:
    """What links with tensors (3, 3), by number and in link axes, resist to inputs."""

    def __init__(
        self,
        flow: CoordinateRates,
        placed: Sequence[LinkOrientation],
        tensors: Mapping[int, Entries],
    ) -> None:
        self.flow = flow
        self._share = 1.0 / flow.scale
        # Entries near 0 are made exact zeros, so they need a size near one.
        plain = [tensor for tensor in tensors.values() if tensor.dtype != object]
        sizes = [float(np.max(np.abs(tensor))) for tensor in plain]
        self._unit = max(sizes, default=1.0) or 1.0
        self._momenta = {
            link: (placed[link], placed[link].tensor(tensor / self._unit))
            for link, tensor in tensors.items()
            if link
        }

    def _momentum(self, link: int, w: Exprs) -> Exprs:
        placed, tensor = self._momenta[link]
        return np.asarray(placed.basis @ (tensor @ placed.seen(w)))

    def inertia(self, one: int, other: int) -> Expr:
        """Return the inertia between two inputs."""
        total: Expr = 0.0
        for link in self._momenta:
            momentum = self._momentum(link, self.flow.w[other][link])
            total = total + dot(self.flow.w[one][link], momentum)
        return total * (self._share * self._share) * self._unit

    def moving(self, speeds: Sequence[Expr]) -> "MovingInputs":
        """Return the motion in which inputs have these rates."""
        slow = [speed * self._share for speed in speeds]
        rates = [_along(column, slow) for column in zip(*self.flow.tau, strict=True)]
        w = [_along(column, slow) for column in zip(*self.flow.w, strict=True)]
        return MovingInputs(self, rates, w)

    def resisted(self, moving: int, w: Sequence[Exprs], a: Sequence[Exprs]) -> Expr:
        """Return the moment of an input at links' velocities and accelerations (3,)."""
        total: Expr = 0.0
        for link in self._momenta:
            turned = cross(w[link], self._momentum(link, w[link]))
            push = self._momentum(link, a[link]) + turned
            total = total + dot(self.flow.w[moving][link], push)
        return total * self._share * self._unit


@final
@dataclass(frozen=True)
class MovingInputs:
    """A motion: rates by time of all variables, and angular velocities (3,) of links."""

    moments: InputMoments
    rates: Sequence[Expr]
    w: Sequence[Exprs]

    def resistance(self, moving: int, accelerations: Sequence[Expr]) -> Expr:
        """Return what links resist to an input while inputs accelerate like this."""
        flow = self.moments.flow
        bias = flow.bias(self.rates, self.w)
        slow = [acceleration * (1.0 / flow.scale) for acceleration in accelerations]
        a = [
            base + _along(velocities, slow)
            for base, velocities in zip(bias, zip(*flow.w, strict=True), strict=True)
        ]
        return self.moments.resisted(moving, self.w, a)


def _along(parts: Sequence[Any], rates: Sequence[Expr]) -> Any:
    total = parts[0] * rates[0]
    for part, rate in zip(parts[1:], rates[1:], strict=True):
        total = total + part * rate
    return total
