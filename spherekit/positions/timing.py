"""When the rows of a motion happen, and how fast its inputs move there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.files.time_law import TimeLaw
from spherekit.numerics.array_rows import ArrayRows


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
        return self.rows(np.tile(np.arange(len(self.ddq)), count))


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
