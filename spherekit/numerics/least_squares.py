"""Sums of squares minimised from many starts side by side."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats, Indices

Residuals = Callable[[Floats, Indices], tuple[Floats, Floats]]
"""Residuals (k, m) of starts (k,) at values (k, variables), and their derivatives."""


STEPS = 60
"""Steps of a start at most."""


FIRST_DAMPING, EASED, RAISED = 0.1, 0.2, 5.0


LEAST_DAMPING, MOST_DAMPING = 1e-12, 1e9


STILL = 1e-15
"""A step in which no variable changes by more is the last one."""


def descent(
    residuals: Residuals,
    start: Floats,
    low: Floats | float = -np.inf,
    high: Floats | float = np.inf,
    close: float = 0.0,
    longest: float = np.inf,
) -> tuple[Floats, Floats]:
    """Go down by Levenberg and Marquardt's method; return where that leads, and the sums.

    Parameters
    ----------
    start
        (n, variables).
    low, high
        (variables,) limits that variables do not leave, none by default.
    close
        Root of a sum of squares that is small enough.
    longest
        The most that a variable changes in a step.

    Returns
    -------
    values, squares
        (n, variables), and the sums (n,) of squared residuals there.
    """
    n, count = start.shape
    values = start.copy()
    active = np.arange(n)
    damping = np.full(n, FIRST_DAMPING)
    gap, slope = residuals(values, active)
    squares = np.sum(gap**2, axis=1)
    for _ in range(STEPS):
        here, across = values[active], np.swapaxes(slope, 1, 2)
        right = -(across @ gap[..., None])
        normal = across @ slope
        stopped = (here <= low) & (right[..., 0] < 0.0)
        stopped |= (here >= high) & (right[..., 0] > 0.0)
        normal[stopped] = right[stopped] = 0.0
        normal += damping[active, None, None] * np.eye(count)
        change = np.linalg.solve(normal, right)[..., 0]
        size = np.max(np.abs(change), axis=1, initial=0.0)
        change *= np.minimum(1.0, longest / np.maximum(size, STILL))[:, None]
        tried = np.clip(here + change, low, high)
        there, turned = residuals(tried, active)
        sums = np.sum(there**2, axis=1)
        better = sums < squares[active]
        values[active[better]], squares[active[better]] = tried[better], sums[better]
        gap[better], slope[better] = there[better], turned[better]
        damping[active] = np.maximum(
            damping[active] * np.where(better, EASED, RAISED), LEAST_DAMPING
        )
        going = (squares[active] >= close**2) & (damping[active] < MOST_DAMPING)
        going &= size > STILL
        active = active[going]
        gap = gap[going]
        slope = slope[going]
        if not len(active):
            break
    return values, squares
