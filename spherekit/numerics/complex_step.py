"""Derivatives by complex steps.

For an analytic function f and a tiny step h, f(a + i h da) = f(a) + i h df, where df is the
derivative of f in the direction da. The error is of the order h^2, which is far below
rounding. No difference of two values is taken, so no digit is lost.

The function may be ordinary code for real numbers if it is analytic: products, roots and
sines are allowed, absolute values and comparisons are not. See W. Squire and G. Trapp,
Using complex variables to estimate derivatives of real functions, SIAM Review 40, 1998.
"""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats

COMPLEX_STEP = 2.0**-120
"""The step h. It is a power of 2, so that dividing by it does not round."""


def add_complex_step(values: ArrayLike, direction: ArrayLike) -> Floats:
    """Return a + i h da for values a, directions da and a tiny step h.

    If a function is evaluated there, the imaginary part divided by h is the derivative
    along da. The array is complex, but declared as float, since functions for real numbers
    take it.
    """
    stepped = np.asarray(values, dtype=float) + 1j * COMPLEX_STEP * np.asarray(
        direction, dtype=float
    )
    return cast(Floats, stepped)


def extract_derivative(values: Floats) -> Floats:
    """Return the derivatives df of results f + i h df."""
    return np.imag(values) / COMPLEX_STEP
