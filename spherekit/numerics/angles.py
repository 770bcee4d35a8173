"""Angles reduced by whole revolutions."""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import TURN

SAME_ANGLE_RAD = 1e-9
"""Angles (rad) that differ by less are the same angle."""


def wrap(angles: ArrayLike) -> Floats:
    """Return angles (rad) reduced by whole revolutions to (-pi, pi].

    Angles that are already in this interval are returned unchanged.
    """
    angles = np.asarray(angles, dtype=float)
    reduced = angles - TURN * np.round(angles / TURN)
    # Rounding may also leave a little more than pi.
    return np.where(np.abs(reduced) >= np.pi, np.pi, reduced)


def return_after_revolutions(first: ArrayLike, last: ArrayLike) -> bool:
    """Return whether angles move from `first` to `last` by whole revolutions.

    The inputs at the first and at the last sample then show that the path of the samples is
    closed.

    Parameters
    ----------
    first, last
        (n,) angles (rad) at the start and at the end of a motion.

    Returns
    -------
    True if every angle changes by a whole number of revolutions, which may be 0. But False
    if `first` and `last` are exactly equal, because then nothing has moved.
    """
    change = np.asarray(last, dtype=float) - np.asarray(first, dtype=float)
    return bool(np.any(change != 0.0) and np.all(np.abs(wrap(change)) < SAME_ANGLE_RAD))
