"""Zeros of many functions of one variable at once, each within its own bracket."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats, Indices
from spherekit.tolerances import EPS

Indexed = Callable[[Floats, Indices], Floats]
"""Values (m,) of the functions with numbers (m,) at places (m,)."""


MOST_STEPS = 80


TINY = 1e-300


def bracketed_zeros(
    function: Indexed,
    low: Floats,
    high: Floats,
    at_low: Floats,
    at_high: Floats,
    tolerance: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Return where functions change their sign, between two ends of opposite signs.

    Parameters
    ----------
    function
        Values of the functions asked for; they need not be continuous.
    low, high, at_low, at_high
        Ends (n,) of the brackets; values there, one not negative, the other negative.
    tolerance
        Width (n,) of a bracket that is narrow enough, besides rounding.

    Returns
    -------
    zero, outside
        (n,) the end of the last bracket with the smaller value, exactly 0 or as near the
        other end as asked for, and the end where the value is negative.

    Notes
    -----
    Inverse quadratic interpolation where it is safe, else halving (T. R. Chandrupatla,
    Advances in Engineering Software 28, 1997, 145-149).
    """
    a, b, c = points = np.array([[high, at_high], [low, at_low], [low, at_low]])
    room = np.broadcast_to(tolerance, low.shape)
    going = np.flatnonzero((at_high != 0.0) & (at_low != 0.0))
    share = np.array(0.5)
    for _ in range(MOST_STEPS):
        if not len(going):
            break
        one, other = a[:, going], b[:, going]
        x = one[0] + share * (other[0] - one[0])
        value = function(x, going)
        same = (value >= 0.0) == (one[1] >= 0.0)
        across = np.where(same, other, one)
        c[:, going] = np.where(same, one, other)
        a[:, going], b[:, going] = (x, value), across
        best = np.where(np.abs(value) < np.abs(across[1]), x, across[0])
        least = 2.0 * EPS * np.abs(best) + 0.5 * room[going] + TINY
        gap = np.abs(across[0] - x)
        left = (value != 0.0) & ~(gap <= 2.0 * least)
        going, gap, least = going[left], gap[left], least[left]
        (x, fx), (y, fy), (z, fz) = points[..., going]
        with np.errstate(all="ignore"):
            place, level = (x - y) / (z - y), (fx - fy) / (fz - fy)
            safe = (level**2 < place) & ((1.0 - level) ** 2 < 1.0 - place)
            share = fx / (fy - fx) * (fz / (fy - fz))
            share += (z - x) / (y - x) * (fx / (fz - fx)) * (fy / (fz - fy))
            room_left = np.minimum(least / gap, 0.5)
            share = np.clip(np.where(safe, share, 0.5), room_left, 1.0 - room_left)
    nearer = np.where(np.abs(a[1]) < np.abs(b[1]), a, b)
    return nearer[0], np.where(a[1] < 0.0, a, b)[0]
