"""Inputs that differ by whole periods and belong to the same configuration.

The configurations of a mechanism repeat when an input grows by its period: one revolution,
or several if wheels roll. An infinite period means that they never repeat.
"""

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN

RANGE_TOLERANCE_RAD = 1e-12
"""An input that exceeds a range by less is at its end, because the rest is rounding."""


def into_range(
    q: Floats, low: Floats | float, high: Floats | float, period: Floats | float
) -> Floats:
    """Return inputs shifted by whole periods into a range, or as near to it as possible.

    If several shifted inputs are in the range, the smallest is returned. An input with an
    infinite period is not changed.

    Parameters
    ----------
    q
        Inputs (rad). The shapes of all parameters broadcast.
    low, high
        Ends of the range (rad).
    period
        Growth of the input (rad) after which configurations repeat.
    """
    is_periodic = np.isfinite(period)
    # In place of an infinite period any number avoids NaN. It has no effect on the result.
    period = np.where(is_periodic, period, TURN)
    # `above` is the smallest shifted input that is in the range or above it. An input that
    # is below the low end by rounding only counts as in the range. `below` is one period
    # less. If `above` is beyond the high end, `below` may be nearer to the range.
    above = low + np.mod(q - low + RANGE_TOLERANCE_RAD, period) - RANGE_TOLERANCE_RAD
    below = above - period
    is_outside = above > high + RANGE_TOLERANCE_RAD
    below_is_nearer = is_outside & (low - below < above - high)
    return np.where(is_periodic, np.where(below_is_nearer, below, above), q)


def less_periods(differences: Floats, periods: Floats) -> Floats:
    """Return differences (..., variables) of variables reduced by whole periods."""
    return differences - whole_laps(differences, periods)


def whole_laps(differences: Floats, periods: Floats) -> Floats:
    """Return the multiples of the periods that are nearest to differences of variables.

    Parameters
    ----------
    differences
        (..., variables) differences (rad).
    periods
        (variables,) periods (rad). The result is zero where the period is not finite.
    """
    is_periodic = np.isfinite(periods)
    scale = np.where(is_periodic, periods, 1.0)
    return np.where(is_periodic, np.round(differences / scale) * scale, 0.0)


def turns_in_range(
    q: Floats, low: float, high: float, period: float
) -> tuple[Floats, Indices]:
    """Return all inputs in a range that differ from given ones by whole periods.

    A given input for which there is none is returned once, shifted by whole periods as near
    to the range as possible.

    Parameters
    ----------
    q
        (m,) inputs (rad).
    low, high
        Ends of the range (rad). If its length is a whole number of periods, an input at
        its low end is not repeated at its high end.
    period
        Growth of the input (rad) after which configurations repeat. If it is infinite,
        each input is returned once.

    Returns
    -------
    shifted
        (k,) inputs (rad). The shifted values of one given input follow each other in rising
        order.
    sources
        (k,) positions of the given inputs from which they come.
    """
    # The smallest input in the range for each given one.
    first = into_range(q, low, high, period)
    if not np.isfinite(period):
        return first, np.arange(len(first))
    # Number of further periods that can be added to it.
    further = np.floor((high - first + RANGE_TOLERANCE_RAD) / period)
    # In a range of k whole periods each input occurs k times, so k - 1 periods are added at
    # most. `whole_periods` is 0 if the length of the range is no whole number of periods.
    period_count = whole_periods(low, high, period)
    max_further = period_count - 1 if period_count else np.inf
    further = np.clip(further, 0.0, max_further)
    laps_to_try = np.arange(np.max(further, initial=0.0) + 1)
    sources, laps = np.nonzero(laps_to_try <= further[:, None])
    return first[sources] + period * laps, sources


def whole_periods(low: float, high: float, period: float) -> int:
    """Return the number of periods in a range (rad), 0 if it is not a whole number."""
    if not np.isfinite(period):
        return 0
    count = round((high - low) / period)
    deviation = abs(high - low - count * period)
    return count if deviation <= RANGE_TOLERANCE_RAD * (1 + count) else 0


def in_range(q: Floats, low: Floats | float, high: Floats | float) -> Bools:
    """Return whether inputs (rad) are in a range, including its ends."""
    return (q >= low - RANGE_TOLERANCE_RAD) & (q <= high + RANGE_TOLERANCE_RAD)
