"""Newton's method from many starts side by side: how far steps go, and if they contract."""

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats


@final
class NewtonSteps:
    """The steps of one correction of n samples.

    `first` (n,) is the size of the first step, `ratio` (n,) that of the second by the
    first, 0 where one was enough: small both, they say that the start was near a solution
    (`spherekit.motion.continuation`). No variable changes by more than `trust` in a step.
    """

    def __init__(self, count: int, trust: float = np.inf) -> None:
        self.first, self.ratio, self.trust = np.zeros(count), np.zeros(count), trust
        self._taken = 0

    def part(self, size: Floats, rows: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """Note a step of sizes (k,) of some rows; return the part (k, 1) to take of it."""
        if self._taken == 0:
            self.first[rows] = size
        elif self._taken == 1:
            self.ratio[rows] = size / np.maximum(self.first[rows], 1e-300)
        self._taken += 1
        return np.minimum(1.0, self.trust / np.maximum(size, 1e-300))[:, None]


def newton(
    change: Callable[[Floats, NDArray[np.intp]], Floats],
    values: Floats,
    most: int,
    settled: float = 0.0,
    trust: float = np.inf,
) -> tuple[Floats, NewtonSteps]:
    """Return what so many steps at most make of values (n, variables), and the steps.

    `change` returns the steps (k, variables) of some rows from values (k, variables). A row
    ends with a step of at most `settled` (rad), or one that is not a number.
    """
    steps = NewtonSteps(len(values), trust)
    values, active = values.copy(), np.arange(len(values))
    for _ in range(most):
        step = change(values[active], active)
        length = np.max(np.abs(step), axis=1, initial=0.0)
        values[active] += step * steps.part(length, active)
        active = active[length > settled]
        if not len(active):
            break
    return values, steps
