"""What a kernel found of the poles and rates of a motion's rows, as columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.planning.poles import Pole
from spherekit.sphere.rotation import Floats


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
    def with_sign(self) -> tuple[Floats, Floats, Floats, Floats]:
        """What changes its sign with the direction."""
        return self.direction, self.turn, self.rate, self.change

    def relative(self, rows: slice) -> tuple[Floats, Floats]:
        """Return (3, rows) the relative angular velocity, and its derivative."""
        unit, rate = self.direction[:, rows], self.rate[rows]
        return rate * unit, self.change[rows] * unit + rate * self.turn[:, rows]

    def parted(self) -> "PoleColumns":
        """Return a copy all of whose rows can be written to."""
        return PoleColumns(
            np.array(self.direction),
            np.array(self.turn),
            np.array(self.rate),
            np.array(self.change),
            np.array(self.angle),
            np.array(self.direction_error),
            np.array(self.rate_error),
            np.array(self.change_error),
            self.is_signed,
        )


@final
@dataclass(frozen=True)
class RateColumns:
    """Poles and rates of n rows in which one input moves.

    `poles` are those of which there is something. `w[link]`, `dw[link]` (3, n) are as in
    `PoleField`.
    """

    poles: Mapping[Pole, PoleColumns]
    w: Mapping[int, Floats]
    dw: Mapping[int, Floats]

    def parted(self) -> "RateColumns":
        """Return a copy all of whose rows can be written to."""
        return RateColumns(
            {pole: columns.parted() for pole, columns in self.poles.items()},
            {link: np.array(vectors) for link, vectors in self.w.items()},
            {link: np.array(vectors) for link, vectors in self.dw.items()},
        )
