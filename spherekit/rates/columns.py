"""What a kernel found of the rows of a motion, as columns, and what it vouches for."""

from collections.abc import Mapping, Sequence
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
class PoleColumns:
    """A pole at n rows.

    `direction` (3, n) a unit vector along the relative angular velocity, or the axis of a
    pair, `turn` (3, n) its derivative by the input; `rate` and `change` (n,) the
    coefficient and its derivative, not negative where the pole `is_signed`: it then has no
    sense of its own. `angle` (n,) how far the relative angular velocity is from cancelling,
    1 for pairs; the errors (n,) are bounds of those of direction, rate and change.
    """

    direction: Floats
    turn: Floats
    rate: Floats
    change: Floats
    angle: Floats
    direction_error: Floats
    rate_error: Floats
    change_error: Floats
    is_signed: bool

    @property
    def with_sign(self) -> tuple[Floats, ...]:
        """What changes its sign with the direction."""
        return self.direction, self.turn, self.rate, self.change

    def relative(self, rows: slice) -> tuple[Floats, Floats]:
        """Return (3, rows) the relative angular velocity, and its derivative."""
        unit, rate = self.direction[:, rows], self.rate[rows]
        return rate * unit, self.change[rows] * unit + rate * self.turn[:, rows]

    def parted(self) -> "PoleColumns":
        """Return a copy all of whose rows can be written to."""
        made = {
            name: np.array(part) if isinstance(part, np.ndarray) else part
            for name, part in vars(self).items()
        }
        return PoleColumns(**made)


@final
@dataclass(frozen=True)
class RateColumns:
    """Poles and rates of n rows in which one input moves.

    `poles` are those of which there is something. `w[link]`, `dw[link]` (3, n) are as in
    `PoleField`. `worst` (n,) is the largest bound that decides, if it is kept.
    """

    poles: Mapping[Pole, PoleColumns]
    w: Mapping[int, Floats]
    dw: Mapping[int, Floats]
    worst: Floats | None

    def parted(self) -> "RateColumns":
        """Return a copy all of whose rows can be written to."""
        return RateColumns(
            {pole: own.parted() for pole, own in self.poles.items()},
            {link: np.array(own) for link, own in self.w.items()},
            {link: np.array(own) for link, own in self.dw.items()},
            self.worst,
        )


@final
@dataclass(frozen=True)
class RowColumns:
    """What a kernel found at n rows: closure, and rates for each input that moves.

    `residual` (n,) rad is how far loops are open, `sensitivity` (n,) and
    `configuration_error` (n,) are those of `Motion`, `flatness` the reciprocal condition of
    the equations at sensitivity 1.
    """

    residual: Floats
    sensitivity: Floats | None
    configuration_error: Floats | None
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
        assert self.sensitivity is not None
        held = self.sensitivity <= self.flatness / NEARLY_FLAT
        for each in self.rates:
            assert each.worst is not None
            held &= each.worst <= LARGEST_ERROR
        return np.asarray(held)
