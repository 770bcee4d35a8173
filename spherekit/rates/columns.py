"""What a kernel found of the poles and rates of a motion's rows, as columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.numeric.lent_memory import LentMemory, Reader, Refilled
from spherekit.planning.poles import Pole
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class PoleColumns:
    """A pole at n rows.

    `direction` (3, n) a unit vector along the relative angular velocity, or the axis of a
    pair, `turn` (3, n) its derivative by the input; `rate` and `change` (n,) the
    coefficient and its derivative. `angle` (n,) how far the relative angular velocity is
    from cancelling, 1 for pairs; the errors (n,) are bounds of those of direction, rate
    and change.
    """

    direction: Floats
    turn: Floats
    rate: Floats
    change: Floats
    angle: Floats
    direction_error: Floats
    rate_error: Floats
    change_error: Floats

    def without(self, gaps: "Gaps") -> "PoleColumns":
        """Return columns where those that are numbers throughout have gaps."""
        return PoleColumns(
            gaps.of(self.direction),
            gaps.of(self.turn),
            gaps.of(self.rate),
            gaps.of(self.change),
            gaps.of(self.angle),
            gaps.of(self.direction_error),
            gaps.of(self.rate_error),
            gaps.of(self.change_error),
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


@final
class Gaps:
    """Makes columns that are numbers throughout NaN at some rows; the same ones once."""

    def __init__(self, rows: NDArray[np.intp], memory: LentMemory) -> None:
        self._rows, self._memory = rows, memory
        self._made: dict[bytes, Floats] = {}

    def within(self, columns: "RateColumns") -> "RateColumns":
        """Return columns where those that are numbers throughout have gaps."""
        if not len(self._rows):
            return columns
        return RateColumns(
            {pole: part.without(self) for pole, part in columns.poles.items()},
            {link: self.of(vectors) for link, vectors in columns.w.items()},
            {link: self.of(vectors) for link, vectors in columns.dw.items()},
        )

    def of(self, column: Floats) -> Floats:
        """Return a column of any kind (..., n)."""
        if column.strides[-1] or not len(self._rows):
            return column
        key = column[..., 0].tobytes()
        if key not in self._made:
            numbers, rows = np.atleast_1d(column[..., 0])[:, None], self._rows
            shape = len(numbers), column.shape[-1]
            made = self._memory.array(*shape)
            made[:] = numbers
            made[:, rows] = np.nan

            def pieces(reader: Reader) -> None:
                again = np.repeat(numbers, shape[1], axis=1)
                again[:, rows] = np.nan
                reader(slice(0, shape[1]), again)

            Refilled(self._memory, shape, pieces).fills(made)
            self._made[key] = made.reshape(column.shape)
        return self._made[key]
