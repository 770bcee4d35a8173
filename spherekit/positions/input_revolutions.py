"""Which whole turns of an input stand for one configuration, and which one is meant."""

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN

ROUNDED = 1e-12
"""An input outside a range by less (rad) is at its end."""


def into_range(
    q: Floats, low: Floats | float, high: Floats | float, period: Floats | float
) -> Floats:
    """Return inputs (rad) less whole periods so that they are in a range, or nearest to it.

    Of several in the range the least. Shapes broadcast.
    """
    returns = np.isfinite(period)
    period = np.where(returns, period, TURN)
    above = low + np.mod(q - low + ROUNDED, period) - ROUNDED
    below = above - period
    nearer = (above > high + ROUNDED) & (low - below < above - high)
    return np.where(returns, np.where(nearer, below, above), q)


def less_periods(differences: Floats, periods: Floats) -> Floats:
    """Return differences of variables (..., variables) less whole periods."""
    return differences - whole_laps(differences, periods)


def whole_laps(differences: Floats, periods: Floats) -> Floats:
    """Return the whole periods in differences (..., variables), zero without a period."""
    finite = np.isfinite(periods)
    scale = np.where(finite, periods, 1.0)
    return np.where(finite, np.round(differences / scale) * scale, 0.0)


def turns_in_range(
    q: Floats, low: float, high: float, period: float
) -> tuple[Floats, Indices]:
    """Return the whole periods (k,) of inputs (m,) that lie in a range, and whose they are.

    Of an input without one the nearest. A range of whole periods ends where it begins.

    Returns
    -------
    turned, which
        Inputs (k,), those of one rising, and the positions (k,) of what they come from.
    """
    first = into_range(q, low, high, period)
    if not np.isfinite(period):
        return first, np.arange(len(first))
    most = (whole_periods(low, high, period) or np.inf) - 1
    more = np.clip(np.floor((high - first + ROUNDED) / period), 0.0, most)
    which, laps = np.nonzero(np.arange(np.max(more, initial=0.0) + 1) <= more[:, None])
    return first[which] + period * laps, which


def whole_periods(low: float, high: float, period: float) -> int:
    """Return how many whole periods a range has, 0 if it is not a whole number of them."""
    if not np.isfinite(period):
        return 0
    count = round((high - low) / period)
    return count if abs(high - low - count * period) <= ROUNDED * (1 + count) else 0


def in_range(q: Floats, low: Floats | float, high: Floats | float) -> Bools:
    """Return whether inputs (rad) are in a range, its ends included."""
    return (q >= low - ROUNDED) & (q <= high + ROUNDED)
