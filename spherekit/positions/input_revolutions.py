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

    Configurations repeat when an input grows by its period. If several shifted inputs are
    in the range, the smallest is returned. An input with an infinite period is not changed.

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
    # Replace infinite periods by any number, to avoid NaN. The result does not use it.
    period = np.where(is_periodic, period, TURN)
    # The first shifted input at or above the low end. An input below the low end by no more
    # than rounding counts as at this end.
    distance_above_low = np.mod(q - low + RANGE_TOLERANCE_RAD, period)
    first_above_low = low + distance_above_low - RANGE_TOLERANCE_RAD
    last_below_low = first_above_low - period
    # If no shifted input is in the range, the nearer of its two neighbours is returned.
    is_none_in_range = first_above_low > high + RANGE_TOLERANCE_RAD
    is_below_nearer = low - last_below_low < first_above_low - high
    shifted = np.where(is_none_in_range & is_below_nearer, last_below_low, first_above_low)
    return np.where(is_periodic, shifted, q)


def less_periods(differences: Floats, periods: Floats) -> Floats:
    """Return differences (..., variables) of variables reduced by whole periods."""
    return differences - whole_laps(differences, periods)


def whole_laps(differences: Floats, periods: Floats) -> Floats:
    """Return the multiples of the periods that are nearest to differences of variables.

    A period, such as a revolution, is a change that leaves the configuration the same.

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

    Configurations repeat when an input grows by its period. An input for which there is
    none in the range is returned once, shifted as near to the range as possible.

    Parameters
    ----------
    q
        (m,) inputs (rad).
    low, high
        Ends of the range (rad). If its length is a whole number of periods, an input at its
        low end is not repeated at its high end.
    period
        Growth of the input (rad) after which configurations repeat. If it is infinite, each
        input is returned once.

    Returns
    -------
    shifted
        (k,) inputs (rad). The shifted values of one input follow each other in rising
        order.
    sources
        (k,) positions in `q` of the inputs from which they come.
    """
    first = into_range(q, low, high, period)
    if not np.isfinite(period):
        return first, np.arange(len(first))
    counts = _count_inputs_in_range(first, low, high, period)
    sources = np.repeat(np.arange(len(first)), counts)
    # Number of whole periods that are added: 0, 1, ... for each given input.
    further_periods = np.concatenate(
        [np.empty(0, dtype=np.intp), *(np.arange(count) for count in counts)]
    )
    return first[sources] + period * further_periods, sources


def _count_inputs_in_range(
    first: Floats, low: float, high: float, period: float
) -> Indices:
    """Return how many of the inputs first, first + period, ... are in a range.

    All these inputs belong to the same configuration.

    Parameters
    ----------
    first
        (m,) for each of m configurations, the smallest of its inputs in the range (rad). If
        it has no input in the range, `first` is one outside, and the result is 1.
    low, high
        Ends of the range (rad).
    period
        Finite period (rad).

    Returns
    -------
    (m,) numbers of inputs. In a range of k whole periods there are k, because an input at
    the low end is not repeated at the high end.
    """
    further_count = np.floor((high - first + RANGE_TOLERANCE_RAD) / period)
    # 0 if the length of the range is no whole number of periods.
    period_count = whole_periods(low, high, period)
    max_further_count = period_count - 1 if period_count else np.inf
    return np.clip(further_count, 0.0, max_further_count).astype(np.intp) + 1


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
