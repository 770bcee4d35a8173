"""What a kernel found of the rows of a motion, as columns, and what it vouches for."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.planning.poles import Pole
from spherekit.rates.core import NEARLY_FLAT
from spherekit.sphere.rotation import Floats

LARGEST_ERROR = 1e-10
"""Rows in which a direction, or the derivative of a rate, may be off by more are not
vouched for: norms alone say too little of them."""


@final
@dataclass(frozen=True)
class RateColumns:
    """Poles and rates of n rows in which one input moves.

    `poles` are those of which there is something; arrays have a row for each of them:
    `direction` (3, poles, n), unit vectors along the relative angular velocity, or the axes
    of pairs; `rate` (2, poles, n) the coefficient and its derivative; `angle` (poles, n)
    how far the relative angular velocity is from cancelling, 1 for pairs; `error`
    (3, poles, n) bounds of the errors of direction, coefficient and derivative. `w[link]`,
    `dw[link]`
    (3, n). `worst` (n,) is the largest bound that decides.
    """

    poles: tuple[Pole, ...]
    direction: Floats
    rate: Floats
    angle: Floats
    error: Floats
    w: Mapping[int, Floats]
    dw: Mapping[int, Floats]
    worst: Floats

    @property
    def every(self) -> Iterator[Floats]:
        """All arrays, their rows along the last axis."""
        yield from (self.direction, self.rate, self.angle, self.error)
        yield from (*self.w.values(), *self.dw.values())


@final
@dataclass(frozen=True)
class RowColumns:
    """What a kernel found at n rows: closure, and rates for each input that moves.

    `residual` (n,) rad is how far loops are open, `sensitivity` (n,) and
    `configuration_error` (n,) are those of `Motion`, `flatness` the reciprocal condition of
    the equations at sensitivity 1.
    """

    residual: Floats
    sensitivity: Floats
    configuration_error: Floats
    rates: Sequence[RateColumns]
    flatness: float
    rounding: float

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(n,) rows whose loops are open by no more than the rounding of the numbers."""
        return np.asarray(self.residual <= self.rounding)

    @property
    def vouched(self) -> NDArray[np.bool_]:
        """(n,) rows whose numbers are as good as those of the careful way."""
        held = self.sensitivity <= self.flatness / NEARLY_FLAT
        for each in self.rates:
            held &= each.worst <= LARGEST_ERROR
        return np.asarray(held)
