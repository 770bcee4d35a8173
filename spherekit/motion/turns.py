"""Which whole turns of an input stand for one configuration, and which one is meant."""

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats

ROUNDED = 1e-12
"""An input outside a range by less (rad) is at its end."""
TURN = 2.0 * np.pi


def into_range(
    q: Floats, low: Floats | float, high: Floats | float, period: Floats | float
) -> Floats:
    """Return inputs (rad) less whole periods so that they are in a range, or nearest to it.

    Of several in the range the least. Shapes broadcast.
    """
    q, low, high = np.asarray(q, dtype=float), np.asarray(low), np.asarray(high)
    returns = np.isfinite(period)
    period = np.where(returns, period, TURN)
    above = low + np.mod(q - low + ROUNDED, period) - ROUNDED
    below = above - period
    nearer = (above > high + ROUNDED) & (low - below < above - high)
    return np.where(returns, np.where(nearer, below, above), q)


def in_range(q: Floats, low: Floats | float, high: Floats | float) -> NDArray[np.bool_]:
    """Return whether inputs (rad) are in a range, its ends included."""
    return np.asarray((q >= low - ROUNDED) & (q <= high + ROUNDED))
