"""Angles less whole turns."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import TURN

SAME_ANGLE = 1e-9
"""Angles (rad) that differ by less are one."""


def wrap(angles: ArrayLike) -> NDArray[np.float64]:
    """Return angles (rad) less whole turns, in (-pi, pi]; those within it as they are."""
    given = np.asarray(angles, dtype=float)
    turned = given - TURN * np.round(given / TURN)
    return np.where(turned <= -np.pi, np.pi, turned)


def return_by_turns(first: ArrayLike, last: ArrayLike) -> bool:
    """Return whether angles (n,) rad come back to where they were, after whole turns."""
    away = np.asarray(last, dtype=float) - np.asarray(first, dtype=float)
    return bool(np.any(away != 0.0) and np.all(np.abs(wrap(away)) < SAME_ANGLE))


def widest_swing(angles: NDArray[np.float64], returns: bool) -> tuple[float, int, int]:
    """Return how far angles (n,) rad swing in one piece, and where it is least, greatest.

    NaN parts pieces; where the way `returns`, the last goes on with the first if they meet.
    """
    pieces = np.split(np.arange(len(angles)), np.flatnonzero(np.isnan(angles)))
    pieces = [piece[np.isfinite(angles[piece])] for piece in pieces]
    first, last = pieces[0], pieces[-1]
    # NaN at an end is no angle that meets another.
    meets = abs(float(wrap(angles[-1] - angles[0]))) < SAME_ANGLE
    if returns and meets and len(pieces) > 1:
        pieces.append(np.concatenate([last, first]))
    widest = 0.0, int(np.nanargmin(angles)), int(np.nanargmin(angles))
    for piece in pieces:
        if len(piece):
            turned = np.unwrap(angles[piece])
            low, high = int(np.argmin(turned)), int(np.argmax(turned))
            swing = float(turned[high] - turned[low])
            if swing > widest[0]:
                widest = swing, int(piece[low]), int(piece[high])
    return widest
