"""Zeros of many functions of one variable at once, each in its own bracket."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats, Indices
from spherekit.tolerances import EPS

IndexedFunction = Callable[[Floats, Indices], Floats]
"""Returns the values (m,) of some functions at positions (m,), one position for each.

The second argument is the indices (m,) of these functions.
"""

MAX_ITERATIONS = 80
"""Largest number of function values per bracket.

Halving alone takes about 53 to reach the rounding error of a bracket whose ends are of
similar size, and more near 0. Smaller: brackets of discontinuous functions may not become
narrow.
"""

MIN_BRACKET_WIDTH = 1e-300
"""Width that is narrow enough for a zero at 0, where rounding errors set no limit."""


def find_bracketed_zeros(
    function: IndexedFunction,
    low: Floats,
    high: Floats,
    values_at_low: Floats,
    values_at_high: Floats,
    tolerance: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Return where n functions change their sign between the two ends of their brackets.

    All brackets are narrowed together. A bracket that is narrow enough is left out of the
    next function call.

    Parameters
    ----------
    function
        A callable that takes positions (k,) and the indices (k,) of the functions to
        evaluate there, and returns the values (k,). The functions may jump.
    low, high
        (n,) ends of the brackets.
    values_at_low, values_at_high
        (n,) values of the functions at `low` and at `high`. One of the two is negative, and
        the other one is not.
    tolerance
        Width, or (n,) widths, at which a bracket is narrow enough. A bracket is also narrow
        enough if its width is the rounding error of its ends.

    Returns
    -------
    zero
        (n,) the end of the last bracket at which the function has the smaller absolute
        value.
    negative_side
        (n,) the end of the last bracket where the function is negative.

    References
    ----------
    T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a
    nonlinear function without using derivatives, Advances in Engineering Software 28, 1997,
    145-149.
    """
    # Each array is (2, n): positions, then values. The newest point is a, and b is the
    # other end of the bracket. The point c is the end that was replaced last.
    points = np.array([[high, values_at_high], [low, values_at_low], [low, values_at_low]])
    a, b, c = points
    tolerance = np.broadcast_to(tolerance, low.shape)
    active = np.flatnonzero((values_at_high != 0.0) & (values_at_low != 0.0))
    fraction = np.array(0.5)  # of the way from a to b
    for _ in range(MAX_ITERATIONS):
        if not len(active):
            break
        old_a = a[:, active]
        old_b = b[:, active]
        x = old_a[0] + fraction * (old_b[0] - old_a[0])
        value = function(x, active)
        has_sign_of_a = (value >= 0.0) == (old_a[1] >= 0.0)
        new_b = np.where(has_sign_of_a, old_b, old_a)
        c[:, active] = np.where(has_sign_of_a, old_a, old_b)
        a[:, active] = (x, value)
        b[:, active] = new_b

        # A bracket is finished at an exact zero, or if it is narrow compared with the
        # rounding of the better of its ends, and with the tolerance.
        best = np.where(np.abs(value) < np.abs(new_b[1]), x, new_b[0])
        resolution = 2.0 * EPS * np.abs(best) + 0.5 * tolerance[active] + MIN_BRACKET_WIDTH
        width = np.abs(new_b[0] - x)
        is_unfinished = (value != 0.0) & ~(width <= 2.0 * resolution)
        active = active[is_unfinished]
        width = width[is_unfinished]
        resolution = resolution[is_unfinished]

        # Inverse quadratic interpolation through the three points, if Chandrupatla's
        # criterion says that the interpolant is monotone in the bracket, else halving.
        (xa, fa), (xb, fb), (xc, fc) = points[..., active]
        with np.errstate(all="ignore"):
            xi = (xa - xb) / (xc - xb)
            phi = (fa - fb) / (fc - fb)
            is_safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            fraction = fa / (fb - fa) * (fc / (fb - fc))
            fraction += (xc - xa) / (xb - xa) * (fa / (fc - fa)) * (fb / (fc - fb))
            # The next point keeps the distance `resolution` from both ends. A point closer
            # to an end would narrow the bracket from one side only.
            margin = np.minimum(resolution / width, 0.5)
            fraction = np.clip(np.where(is_safe, fraction, 0.5), margin, 1.0 - margin)
    zero = np.where(np.abs(a[1]) < np.abs(b[1]), a, b)[0]
    negative_side = np.where(a[1] < 0.0, a, b)[0]
    return zero, negative_side
