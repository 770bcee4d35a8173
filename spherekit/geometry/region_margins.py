"""Margins: functions that are at least 0 inside a region and negative outside.

This module evaluates and compares margins. `spherekit.geometry.triangle_class` finds the
position of a triangle of directions from the margins in it.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats, Indices
from spherekit.errors import RegionError

Margins = Callable[[Floats], ArrayLike]
"""A function of points (n, d) that returns margins (n, k), k >= 1. The number k of margins
is the same at every call. Points are unit vectors or unit quaternions."""

RELATIVE_ROUNDING = 1e-13
"""Rounding error of a margin, relative to its median size. Larger: larger negative margins
are accepted on the border. Smaller: rounding errors count as negative margins there, and
corners are not found."""

UNDEFINED_MARGIN = -1
"""Index that stands for all margins together, where the region ends because a margin
becomes NaN, so that no margin is 0 at the border."""


class MarginEvaluator:
    """Calls the margins, checks the arrays that they return, and counts the calls.

    Margins are functions of points that are at least 0 inside a region and negative
    outside. One function returns all of them.

    Parameters
    ----------
    margins
        The function to call.
    sampled
        (n, k) margins from which the rounding errors are estimated. By default the margins
        of the first call are used.

    Attributes
    ----------
    rounding_errors
        (k,) estimated rounding error of each margin, in its unit. On the border, a negative
        margin of smaller size counts as 0. Without `sampled`, empty before the first call.
    evaluations, calls
        Number of points at which the margins were evaluated, and of calls.
    """

    def __init__(self, margins: Margins, sampled: Floats | None = None) -> None:
        """Begin with no calls. The class describes the arguments."""
        self.margins = margins
        self.evaluations = 0
        self.calls = 0
        self.rounding_errors = (
            np.zeros(0) if sampled is None else estimate_rounding(sampled)
        )

    def __call__(self, points: Floats) -> Floats:
        """Evaluate and check all k margins at n points: returns (n, k) for points (n, d).

        A margin is a function of the user that is at least 0 inside a region. NaN means
        that a point cannot be reached.

        Raises
        ------
        RegionError
            If the shape of the margins is wrong or has changed, or a margin is infinite.
        """
        # Without points the function is not called. `rounding_errors` has one number for
        # each margin, but is empty before the first call.
        if not len(points):
            margin_count = len(self.rounding_errors) or 1
            return np.zeros((0, margin_count))
        self.evaluations += len(points)
        self.calls += 1
        values = np.asarray(self.margins(points), dtype=float)
        if values.ndim != 2 or len(values) != len(points) or not values.shape[1]:
            raise RegionError(
                f"for {len(points)} points, the function of the margins returned an array "
                f"of the shape {values.shape}; it must return one row for each point and "
                "one column for each margin"
            )
        if np.isinf(values).any():
            raise RegionError(
                "a margin is infinite; return NaN where a point cannot be reached, and "
                "finite values elsewhere"
            )
        # The rounding errors are estimated only once. With other errors in a later call,
        # the same point could be inside in one call and outside in another.
        if not self.rounding_errors.size:
            self.rounding_errors = estimate_rounding(values)
        if values.shape[1] != len(self.rounding_errors):
            raise RegionError(
                f"the function returned {values.shape[1]} margins for each point, but "
                f"{len(self.rounding_errors)} in an earlier call; return the same "
                "number of margins in every call"
            )
        return values


def estimate_rounding(values: Floats) -> Floats:
    """Return the rounding errors (k,) of margins from sampled values (n, k).

    NaN is ignored. The error of a margin without any number is 0.
    """
    median_sizes = np.zeros(values.shape[1])
    has_number = ~np.isnan(values).all(axis=0)
    median_sizes[has_number] = np.nanmedian(np.abs(values[:, has_number]), axis=0)
    return RELATIVE_ROUNDING * median_sizes


def smallest_margins(values: Floats) -> Floats:
    """Return the smallest margin of each point.

    The smallest margin is negative if and only if the point is outside the region.

    Parameters
    ----------
    values
        (n, k) margins, functions that are at least 0 inside the region. NaN means that the
        mechanism cannot reach the point, which is then outside.

    Returns
    -------
    (n,) smallest margins. If a margin is NaN and no other is negative, the result is -1, so
    that the point counts as outside. If another margin is negative, its value is returned,
    because it shows how far outside the point is.
    """
    is_missing = np.isnan(values)
    if not is_missing.any():
        return np.min(values, axis=1)
    smallest = np.fmin.reduce(values, axis=1)
    return np.where(is_missing.any(axis=1) & ~(smallest < 0.0), -1.0, smallest)


def select_margins(values: Floats, numbers: Indices) -> Floats:
    """Return one margin of each point: the margin that ends a region there.

    A margin is a function that is at least 0 inside the region. Outside, at least one
    margin is negative or NaN (not defined). The caller searches the border of the region as
    the zero, or the change of sign, of the selected margin.

    Parameters
    ----------
    values
        (n, k) margins of n points.
    numbers
        (n,) index of the selected margin for each point. If the region ends because a
        margin becomes NaN, no margin is zero at the border. The index is then
        `UNDEFINED_MARGIN`, and the result is that of `smallest_margins`.

    Returns
    -------
    (n,) selected margins. A selected margin that is NaN is replaced by -1, so that the
    point counts as outside.
    """
    is_undefined = numbers == UNDEFINED_MARGIN
    columns = np.where(is_undefined, 0, numbers)  # 0 is replaced below
    single_margins = np.nan_to_num(values[np.arange(len(values)), columns], nan=-1.0)
    return np.where(is_undefined, smallest_margins(values), single_margins)


def find_active_margins(values: Floats, rounding_errors: Floats) -> Indices:
    """Return, for each point, the index of the margin that excludes it from a region.

    A margin is a function that is at least 0 inside the region. A margin that is negative
    or NaN excludes a point.

    Parameters
    ----------
    values
        (n, k) margins at points outside the region or on its border.
    rounding_errors
        (k,) rounding error of each margin.

    Returns
    -------
    (n,) index of the smallest margin, the first of those that are equal up to rounding.
    `UNDEFINED_MARGIN` if only NaN excludes the point.
    """
    smallest = np.fmin.reduce(values, axis=1)  # ignores NaN
    only_nan_excludes = np.isnan(values).any(axis=1) & ~(smallest <= 0.0)
    # argmax of booleans is the position of the first True.
    first_smallest = np.argmax(values <= smallest[:, None] + rounding_errors, axis=1)
    return np.where(only_nan_excludes, UNDEFINED_MARGIN, first_smallest)


def require_positive(sizes: Mapping[str, float]) -> None:
    """Raise `RegionError` if a size, stored under its name, is not positive and finite."""
    for name, size in sizes.items():
        if not 0.0 < size < np.inf:
            raise RegionError(f"{name} is {size}; it has to be positive and finite")
