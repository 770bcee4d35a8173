"""Derivatives by complex steps: functions of a + i h da have f + i h df, exactly.

With h so small that h squared is nothing beside 1, no difference is taken and no digit is
lost. Such numbers go through code that is written for real ones as long as that is
analytic: products, roots and sines, no absolute values. (W. Squire and G. Trapp, SIAM
Review 40, 1998.)
"""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats

STEP = 2.0**-120


def stepped(values: ArrayLike, change: ArrayLike) -> Floats:
    """Return numbers that carry their derivatives; they are complex."""
    given = np.asarray(values, dtype=float) + 1j * STEP * np.asarray(change, dtype=float)
    return cast(Floats, given)


def slope_of(values: Floats) -> Floats:
    """Return the derivatives that numbers carry."""
    return np.imag(values) / STEP
