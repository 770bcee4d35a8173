"""Margins: functions that are not negative in a region, sampled in triangles.

What the margins sampled in a triangle say of the region within it.

Each margin is interpolated by a polynomial of degree 2; how far it is off at four more
places bounds its error. What is said is as sure as these samples.
"""

from collections.abc import Callable, Mapping
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import RegionError
from spherekit.geometry.rotation import cross, max_abs


def spread(count: int, lowest: float = -1.0) -> Floats:
    """Return directions (count, 3) spread evenly over z > `lowest`, on a spiral.

    It turns by the golden section from one to the next.
    """
    number = np.arange(count) + 0.5
    z = 1.0 - (1.0 - lowest) * number / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * number
    side = np.sqrt(1.0 - z * z)
    return np.stack([side * np.cos(azimuth), side * np.sin(azimuth), z], axis=1)


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
    return NOISE * np.median(np.where(np.isnan(rows), 0.0, np.abs(rows)), axis=0)


def least(rows: Floats) -> Floats:
    """Return the smallest margin (n,), below 0 just where a place is outside.

    A margin that is NaN counts for nothing where another is negative, else as -1: the
    place cannot be reached.
    """
    missing = np.isnan(rows)
    if not missing.any():
        return np.min(rows, axis=1)
    smallest = np.fmin.reduce(rows, axis=1)
    return np.where(missing.any(axis=1) & ~(smallest < 0.0), -1.0, smallest)


def chosen(rows: Floats, number: Indices) -> Floats:
    """Return the margin (n,) with each row's own number, -1 where it is NaN.

    `UNDEFINED` asks for the smallest margin.
    """
    return np.where(
        number == UNDEFINED,
        least(rows),
        np.nan_to_num(rows[np.arange(len(rows)), number], nan=-1.0),
    )


def active(rows: Floats, floor: Floats) -> Indices:
    """Return the number (n,) of the smallest margin, `UNDEFINED` if only NaN excludes.

    Of those that are equal up to rounding, `floor` (k,), it is the first.
    """
    smallest = np.fmin.reduce(rows, axis=1)
    return np.where(
        np.isnan(rows).any(axis=1) & ~(smallest <= 0.0),
        UNDEFINED,
        np.argmax(rows <= smallest[:, None] + floor, axis=1),
    )


def check_positive(sizes: Mapping[str, float]) -> None:
    """Raise `RegionError` where a size, by its name, is not positive and finite."""
    for name, size in sizes.items():
        if not 0.0 < size < np.inf:
            raise RegionError(f"{name} is {size}; it has to be positive and finite")


VALUE_SLACK = 3.0


SLOPE_SLACK = 12.0
"""Errors of the interpolant and its slope by the largest seen at the four places: a
cubic needs 2 and 11."""


SHARPEST = 0.25
"""Corners of the region sharper than this (rad) are cut out by ever smaller triangles."""


STEADY = 1.0
"""A margin undefined in part of a triangle keeps its sign where its smallest size is more
than this times its spread."""


CHECKED = np.array(
    [[9, 3, 0], [0, 9, 3], [3, 0, 9], [3, 9, 0], [0, 3, 9], [9, 0, 3], [4, 4, 4]]
)
"""Barycentric coordinates, in twelfths, of the samples on the edges 12, 23, 31 of a
triangle, nearer to their first ends and to the others, and of its centroid."""


class TriangleClass(IntEnum):
    """What a triangle is."""

    OUTSIDE = 0
    INSIDE = 1
    SIMPLE = 2
    """The border within is a single graph over some direction, or there is none."""
    BROKEN = 3
    """The border within is that of where the margins are defined, which samples alone
    tell."""
    OPEN = 4
    """A part of the region, or a hole, may hide within."""


def _matrices() -> tuple[Floats, Floats, Floats]:
    """Return what turns 6 values into Bernstein coefficients, slopes and checks.

    The slopes are those along the edges 12 and 13, at the vertices.
    """
    bernstein = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    bernstein[3:, :3] = -0.5 * np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]])
    b1, b2, b3, b12, b23, b13 = bernstein
    slopes = 2.0 * np.stack(
        [[b12 - b1, b13 - b1], [b2 - b12, b23 - b12], [b23 - b13, b3 - b13]]
    )
    p, q, r = CHECKED.T / 12.0
    terms = np.stack([p * p, q * q, r * r, 2 * p * q, 2 * q * r, 2 * p * r], axis=1)
    return bernstein, slopes, terms @ bernstein


_BERNSTEIN, _SLOPES, _CHECKS = _matrices()


def judge(points: Floats, triangles: Indices, rows: Floats) -> tuple[Indices, Bools]:
    """Return the `TriangleClass` (n,) of triangles (n, 3) by sampled margins (10, n, k).

    The rows are those of the vertices, of the middles of the edges 12, 23, 31, of a check
    on each edge, a quarter of it from its lower vertex, and of the centroids. The second
    array says where more than one margin is uncertain.

    - A margin is certainly negative, or positive, where its bounds are.
    - One that is NaN at some samples is bounded by the others if these are steady; one
      that is NaN at all bounds nothing.
    - The uncertain ones leave a simple border if all their gradients, anywhere in the
      triangle, lie in a cone less than half a turn wide: the smallest margin then rises
      along a direction, so its zeros are a graph over the other, and nothing closes on
      itself. The cone may be so wide that the region has corners of `SHARPEST`.
    - Else the triangle is open.
    """
    missing = np.isnan(rows)
    filled = np.where(missing, 0.0, rows)
    low, high, error = _bounds(triangles, filled)
    whole = np.all(~missing, axis=0)
    smallest = np.fmin.reduce(rows, axis=0)
    largest = np.fmax.reduce(rows, axis=0)
    spread = STEADY * (largest - smallest)
    low = np.where(whole, low, np.where(smallest <= spread, -1.0, 1.0))
    high = np.where(whole, high, np.where(-largest > spread, -1.0, 1.0))
    negative = high < 0.0
    uncertain = (low < 0.0) & (high >= 0.0)
    verdict = np.full(len(triangles), TriangleClass.INSIDE)
    verdict[uncertain.any(axis=1)] = TriangleClass.OPEN
    tried = np.flatnonzero(
        uncertain.any(axis=1) & ~negative.any(axis=1) & np.all(whole | ~uncertain, axis=1)
    )
    simple = _within_cone(
        points[triangles[tried]], filled[:6, tried], error[tried], uncertain[tried]
    )
    verdict[tried[simple]] = TriangleClass.SIMPLE
    empty = missing.any(axis=2) & ~(np.fmin.reduce(rows, axis=2) < 0.0)
    broken = empty.any(axis=0)
    verdict[broken] = TriangleClass.OPEN
    verdict[broken & np.all(missing | (rows >= 0.0), axis=(0, 2))] = TriangleClass.BROKEN
    verdict[empty.all(axis=0)] = TriangleClass.OUTSIDE
    verdict[negative.any(axis=1)] = TriangleClass.OUTSIDE
    return verdict, np.count_nonzero(uncertain, axis=1) > 1


def _bounds(triangles: Indices, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Return bounds of margins (n, k) in triangles, and the error of interpolation."""
    control = np.tensordot(_BERNSTEIN, rows[:6], axes=1)
    awaited = np.tensordot(_CHECKS, rows[:6], axes=1)
    falls = triangles > np.roll(triangles, -1, axis=1)
    awaited[:3] = np.where(falls.T[..., None], awaited[3:6], awaited[:3])
    error = max_abs(awaited[[0, 1, 2, 6]] - rows[6:], axis=0)
    slack = VALUE_SLACK * error
    return control.min(axis=0) - slack, control.max(axis=0) + slack, error


def _within_cone(corners: Floats, values: Floats, error: Floats, uncertain: Bools) -> Bools:
    """Return whether the gradients of the uncertain margins lie in a cone about their mean.

    `corners` (n, 3, 3) are those of the triangles, `values` (6, n, k) the margins at them
    and at mid-edge, `error` (n, k) how far the margins are off.
    """
    slopes = np.tensordot(_SLOPES, values, axes=1)
    one = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    base = np.linalg.norm(one, axis=1)[:, None]
    shift = np.vecdot(one, other)[:, None] / base
    height = np.linalg.norm(cross(one, other), axis=1)[:, None] / base
    along = slopes[:, 0] / base
    gradient = along + 1j * (slopes[:, 1] - shift * along) / height
    size = np.abs(gradient)
    room = np.hypot(1.0 / base, (1.0 + np.abs(shift) / base) / height)
    with np.errstate(all="ignore"):
        slack = SLOPE_SLACK * error * room / size
        ways = np.where(uncertain, gradient / size, 0.0)
        axis = np.sum(ways, axis=(0, 2))
        rise = np.real(ways * np.conj(axis / np.abs(axis))[:, None]) - slack
    return np.all((rise > np.sin(0.5 * SHARPEST)) | ~uncertain, axis=(0, 2))
