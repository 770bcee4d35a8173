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


@final
@dataclass(frozen=True)
class ModeOverGrid:
    """Configurations of one mode at the samples of an input grid.

    `values` (n, variables), NaN where the mode was not reached; `status` (n,): OK, or why
    the last way tried towards a sample ended.
    """

    values: Floats
    status: NDArray[np.int8]


def spread(
    closure: Closure, driven: Sequence[int], input_grid: InputGrid, row: int, values: Floats
) -> ModeOverGrid:
    """Return the sheet through a closed configuration (variables,) at one sample."""
    n = len(input_grid)
    sheet = np.full((n, len(values)), np.nan)
    status = np.full(n, Status.OUT_OF_REACH, dtype=np.int8)
    sheet[row], status[row] = values, Status.OK
    beside = input_grid.neighbours()
    front = np.array([row])
    while len(front):
        start = np.tile(front, len(beside))
        stop = beside[:, front].ravel()
        new: list[NDArray[np.intp]] = []
        open_ways = stop >= 0
        start, stop = start[open_ways], stop[open_ways]
        while len(stop):
            wanted = status[stop] != Status.OK
            start, stop = start[wanted], stop[wanted]
            _, once = np.unique(stop, return_index=True)
            if not len(once):
                break
            reached, why = walk(
                closure, driven, sheet[start[once]], input_grid.q[stop[once]]
            )
            status[stop[once]] = why
            arrived = stop[once][why == Status.OK]
            sheet[arrived] = reached[why == Status.OK]
            new.append(arrived)
            left = np.ones(len(stop), dtype=bool)
            left[once] = False
            start, stop = start[left], stop[left]
        front = np.concatenate(new) if new else np.zeros(0, dtype=np.intp)
    return ModeOverGrid(sheet, status)
