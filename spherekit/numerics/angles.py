"""Angles reduced by whole revolutions."""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import TURN

SAME_ANGLE = 1e-9
"""Angles (rad) that differ by less are one."""


def wrap(angles: ArrayLike) -> Floats:
    """Return angles (rad) less whole turns, in (-pi, pi]; those within it as they are."""
    given = np.asarray(angles, dtype=float)
    turned = given - TURN * np.round(given / TURN)
    return np.where(turned <= -np.pi, np.pi, turned)


def return_by_turns(first: ArrayLike, last: ArrayLike) -> bool:
    """Return whether angles (n,) rad come back to where they were, after whole turns."""
    away = np.asarray(last, dtype=float) - np.asarray(first, dtype=float)
    return bool(np.any(away != 0.0) and np.all(np.abs(wrap(away)) < SAME_ANGLE))
