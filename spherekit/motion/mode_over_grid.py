"""One assembly mode of a mechanism with several inputs, over an input grid of their values.

From a known configuration the mode spreads from sample to neighbouring sample by straight
ways of verified steps, wherever such a way leads: around a region that is out of reach,
but never through a configuration at which the inputs do not determine the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.closure import Closure
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.steps import walk
from spherekit.sphere.rotation import Floats

Rows = NDArray[np.intp]


@final
@dataclass(frozen=True)
class ModeOverGrid:
    """Configurations of one mode at the samples of an input grid.

    `values` (n, variables), NaN where the mode was not reached; `status` (n,): OK, or why
    the last way tried towards a sample ended.
    """

    values: Floats
    status: NDArray[np.int8]


def spread_each(
    closure: Closure,
    driven: Sequence[int],
    input_grid: InputGrid,
    rows: Rows,
    values: Floats,
) -> list[ModeOverGrid]:
    """Return the sheets through closed configurations (k, variables), side by side.

    `rows` (k,) are the samples at which they are.
    """
    n, count = len(input_grid), len(rows)
    sheets = np.full((count * n, values.shape[1]), np.nan)
    status = np.full(count * n, Status.OUT_OF_REACH, dtype=np.int8)
    front = np.arange(count) * n + rows
    sheets[front], status[front] = values, Status.OK
    beside = input_grid.neighbours()
    while len(front):
        first, sample = front - front % n, front % n
        stop = beside[:, sample]
        open_ways = stop.ravel() >= 0
        start = np.tile(front, len(beside))[open_ways]
        stop = (stop + first).ravel()[open_ways]
        new: list[Rows] = []
        while len(stop):
            wanted = status[stop] != Status.OK
            start, stop = start[wanted], stop[wanted]
            _, once = np.unique(stop, return_index=True)
            if not len(once):
                break
            reached, why = walk(
                closure, driven, sheets[start[once]], input_grid.q[stop[once] % n]
            )
            status[stop[once]] = why
            arrived = stop[once][why == Status.OK]
            sheets[arrived] = reached[why == Status.OK]
            new.append(arrived)
            left = np.ones(len(stop), dtype=bool)
            left[once] = False
            start, stop = start[left], stop[left]
        front = np.concatenate(new) if new else np.zeros(0, dtype=np.intp)
    parts = (slice(k * n, (k + 1) * n) for k in range(count))
    return [ModeOverGrid(sheets[part], status[part]) for part in parts]
