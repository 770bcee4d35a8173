"""Angles less whole turns."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import TURN


def wrap(angles: ArrayLike) -> NDArray[np.float64]:
    """Return angles (rad) less whole turns, in (-pi, pi]; those within it as they are."""
    given = np.asarray(angles, dtype=float)
    turned = given - TURN * np.round(given / TURN)
    return np.where(turned <= -np.pi, np.pi, turned)
