"""When the rows of a motion happen, and how fast its inputs move there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.model.laws import TimeLaw
from spherekit.numeric.rows import ArrayRows
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Timing(ArrayRows):
    """Times `t` (n,) in s, and the inputs' rates and accelerations there.

    `dq`, `ddq` (n, inputs) in rad/s and rad/s2; rows as in the motion.
    """

    t: Floats
    dq: Floats
    ddq: Floats

    def repeated(self, count: int) -> "Timing":
        """Return the rows so many times, one block after another."""
        return Timing(*(_repeated(part, count) for part in (self.t, self.dq, self.ddq)))


def _repeated(rows: Floats, count: int) -> Floats:
    if rows.strides[0] == 0 and len(rows):  # the same number throughout takes no memory
        return np.broadcast_to(rows[0], (count * len(rows), *rows.shape[1:]))
    return np.tile(rows, (count, *(1,) * (rows.ndim - 1)))


@final
@dataclass(frozen=True)
class Extent:
    """Least and greatest variables and rates of all inputs over a whole motion.

    `inputs` (2, inputs) rad and `rates` (2, inputs) rad/s; the latter NaN where nothing
    says how the inputs move.
    """

    inputs: Floats
    rates: Floats

    @classmethod
    def of(cls, inputs: Floats, timing: Timing | None) -> "Extent":
        """Return the extent of inputs (n, inputs) with their timing."""
        ends = _ends(inputs)
        return cls(ends, np.full_like(ends, np.nan) if timing is None else _ends(timing.dq))


def _ends(rows: Floats) -> Floats:
    if rows.strides[0] == 0 and len(rows):
        rows = rows[:1]
    # Column by column, which is ten times as quick.
    return np.array([[np.min(x) for x in rows.T], [np.max(x) for x in rows.T]])


def by_laws(
    inputs: Sequence[str], laws: Mapping[str, TimeLaw], t: Floats
) -> tuple[Floats, Timing]:
    """Return the inputs (n, inputs) rad at times (n,) by the law of each, and the timing.

    Raises
    ------
    ModelError
        If a table does not reach over all times.
    """
    q, dq, ddq = (
        np.stack(parts, axis=1)
        for parts in zip(*(laws[name].at(t) for name in inputs), strict=True)
    )
    return q, Timing(t, dq, ddq)
