"""Margins: functions whose common non-negative set is a region; calls are counted."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from spherekit.errors import RegionError
from spherekit.region.mesh import Bools, Indices
from spherekit.sphere.rotation import Floats

Margins = Callable[[Floats], ArrayLike]
"""Margins (n, k) at places (n, d): at least one, k always the same."""

NOISE = 1e-13
"""Rounding of margins, by their median size over the first places."""
UNDEFINED = -1
"""Stands for the number of a margin where the border is that of being defined."""


class Evaluator:
    """Calls margins, checks what they return, and counts.

    A margin below 0 by less than its `floor` (k,) is 0 up to rounding; that follows from
    margins that were `sampled` (n, k), or from the first call.
    """

    def __init__(self, margins: Margins, sampled: Floats | None = None) -> None:
        self.margins = margins
        self.evaluations = 0
        self.calls = 0
        self.floor = np.zeros(0) if sampled is None else rounding(sampled)

    def __call__(self, places: Floats) -> Floats:
        """Return the margins (n, k) at places (n, d)."""
        if not len(places):
            return np.zeros((0, len(self.floor) or 1))
        self.evaluations += len(places)
        self.calls += 1
        rows = np.asarray(self.margins(places), dtype=float)
        if rows.ndim != 2 or len(rows) != len(places) or not rows.shape[1]:
            raise RegionError(
                f"margins of {len(places)} places have shape {rows.shape}; the function "
                "has to return one row for each place and one column for each margin"
            )
        if np.isinf(rows).any():
            raise RegionError(
                "a margin is infinite; give NaN where a place cannot be reached, and "
                "finite values elsewhere"
            )
        if not self.floor.size:
            self.floor = rounding(rows)
        if rows.shape[1] != len(self.floor):
            raise RegionError(
                f"margins have {rows.shape[1]} columns, and had {len(self.floor)} before; "
                "return the same margins at every call"
            )
        return rows


def rounding(rows: Floats) -> Floats:
    """Return how far (k,) margins are off by rounding, from their size in rows (n, k)."""
    size = np.where(np.isnan(rows), 0.0, np.abs(rows))
    return np.asarray(NOISE * np.median(size, axis=0))


def least(rows: Floats) -> Floats:
    """Return the smallest margin (n,), below 0 just where a place is outside.

    A margin that is NaN counts for nothing where another is negative, else as -1: the
    place cannot be reached.
    """
    missing = np.isnan(rows)
    if not missing.any():
        return np.asarray(np.min(rows, axis=1))
    smallest = np.min(np.where(missing, np.inf, rows), axis=1)
    return np.where(missing.any(axis=1) & (smallest >= 0.0), -1.0, smallest)


def chosen(rows: Floats, number: Indices) -> Floats:
    """Return the margin (n,) with each row's own number, -1 where it is NaN.

    `UNDEFINED` asks for the smallest margin.
    """
    value = np.take_along_axis(rows, np.maximum(number, 0)[:, None], axis=1)[:, 0]
    value = np.where(np.isnan(value), -1.0, value)
    return np.where(number == UNDEFINED, least(rows), value)


def active(rows: Floats, floor: Floats) -> Indices:
    """Return the number (n,) of the smallest margin, `UNDEFINED` if only NaN excludes.

    Of those that are equal up to rounding, `floor` (k,), it is the first.
    """
    missing = np.isnan(rows)
    filled = np.where(missing, np.inf, rows)
    smallest = np.min(filled, axis=1, keepdims=True)
    number = np.argmax(filled <= smallest + floor, axis=1)
    undefined = missing.any(axis=1) & (np.min(filled, axis=1) > 0.0)
    return np.where(undefined, UNDEFINED, number)


def void(rows: Floats) -> Bools:
    """Return where (n,) a margin is NaN and none is negative."""
    filled = np.where(np.isnan(rows), np.inf, rows)
    return np.asarray(np.isnan(rows).any(axis=-1) & (np.min(filled, axis=-1) >= 0.0))
