"""Zeros of many functions of one variable at once, each within its own bracket."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import EPS
from spherekit.numeric.chebyshev import Floats

Indexed = Callable[[Floats, NDArray[np.intp]], Floats]
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
    low, high
        Ends (n,) of the brackets.
    at_low, at_high
        Values (n,) at the ends, one not negative and the other negative.
    tolerance
        Width (n,) of a bracket that is narrow enough, besides rounding.

    Returns
    -------
    zero, outside
        (n,) the end of the last bracket with the smaller value, and the end where the
        value is negative; the bracket is as narrow as asked for, unless the value at
        `zero` is exactly 0.

    Notes
    -----
    Inverse quadratic interpolation where it is safe, else halving (T. R. Chandrupatla,
    Advances in Engineering Software 28, 1997, 145-149).
    """
    b, fb, a, fa = low.copy(), at_low.copy(), high.copy(), at_high.copy()
    c, fc = b.copy(), fb.copy()
    room = np.broadcast_to(np.asarray(tolerance, dtype=float), low.shape)
    going = np.flatnonzero((fa != 0.0) & (fb != 0.0))
    share = np.full(len(going), 0.5)
    for _ in range(MOST_STEPS):
        if not len(going):
            break
        ga, gb = a[going], b[going]
        x = ga + share * (gb - ga)
        value = function(x, going)
        same = (value >= 0.0) == (fa[going] >= 0.0)
        c[going] = np.where(same, ga, gb)
        fc[going] = np.where(same, fa[going], fb[going])
        b[going] = np.where(same, gb, ga)
        fb[going] = np.where(same, fb[going], fa[going])
        a[going], fa[going] = x, value
        best = np.where(np.abs(value) < np.abs(fb[going]), x, b[going])
        least = 2.0 * EPS * np.abs(best) + 0.5 * room[going] + TINY
        gap = np.abs(b[going] - x)
        settled = (value == 0.0) | (gap <= 2.0 * least)
        going, gap, least = going[~settled], gap[~settled], least[~settled]
        share = np.clip(
            _share(a[going], b[going], c[going], fa[going], fb[going], fc[going]),
            np.minimum(least / gap, 0.5),
            np.maximum(1.0 - least / gap, 0.5),
        )
    nearer = np.abs(fa) < np.abs(fb)
    return np.where(nearer, a, b), np.where(fa < 0.0, a, b)


def _share(a: Floats, b: Floats, c: Floats, fa: Floats, fb: Floats, fc: Floats) -> Floats:
    """Return how far from a to b the next place is."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        place, value = (a - b) / (c - b), (fa - fb) / (fc - fb)
        safe = (value**2 < place) & ((1.0 - value) ** 2 < 1.0 - place)
        first = fa / (fb - fa) * (fc / (fb - fc))
        second = (c - a) / (b - a) * (fa / (fc - fa)) * (fb / (fc - fb))
        return np.where(safe, first + second, 0.5)
