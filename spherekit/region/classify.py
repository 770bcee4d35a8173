"""What the margins sampled in a triangle say of the region within it.

Each margin is interpolated by a polynomial of degree 2; how far it is off at four more
places bounds its error. What is said is as sure as these samples.
"""

from enum import IntEnum

import numpy as np

from spherekit.region.constraint_functions import void
from spherekit.region.mesh import Bools, Indices, unit
from spherekit.sphere.rotation import Floats, cross

VALUE_SLACK = 3.0
SLOPE_SLACK = 12.0
"""Errors of the interpolant and its slope by the largest seen at the four places: a
cubic needs 2 and 11."""
SHARPEST = 0.25
"""Corners of the region sharper than this (rad) are cut out by ever smaller triangles."""
STEADY = 1.0
"""A margin undefined in part of a triangle keeps its sign where its smallest size is more
than this times its spread."""

MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
QUARTERS = np.array(
    [
        [[0.75, 0.25, 0.0], [0.0, 0.75, 0.25], [0.25, 0.0, 0.75]],
        [[0.25, 0.75, 0.0], [0.0, 0.25, 0.75], [0.75, 0.0, 0.25]],
    ]
)
"""Barycentric coordinates of the samples on the edges 12, 23, 31 of a triangle."""


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


def flipped(triangles: Indices) -> Indices:
    """Return 1 (n, 3) where an edge runs from its higher vertex to the lower, else 0."""
    return (triangles > triangles[:, [1, 2, 0]]).astype(np.intp)


def samples(points: Floats, triangles: Indices) -> tuple[Floats, Floats, Floats]:
    """Return the places where margins are sampled in triangles, besides their vertices.

    The middles (n, 3, 3) of the edges 12, 23, 31, a check (n, 3, 3) on each edge, a
    quarter of it from its lower vertex, and the centroids (n, 3).
    """
    corners = points[triangles]
    barycentric = QUARTERS[flipped(triangles), np.arange(3)]
    return (
        unit(np.einsum("pb,nbx->npx", MIDDLES, corners)),
        unit(np.einsum("npb,nbx->npx", barycentric, corners)),
        unit(corners.sum(axis=1)),
    )


def _matrices() -> tuple[Floats, Floats, Floats]:
    """Return what turns 6 values into Bernstein coefficients, slopes and checks.

    The slopes are those along the edges 12 and 13, at the vertices.
    """
    bernstein = np.zeros((6, 6))
    bernstein[:3, :3] = np.eye(3)
    for row, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
        bernstein[3 + row, [i, j]] = -0.5
        bernstein[3 + row, 3 + row] = 2.0
    b1, b2, b3, b12, b23, b13 = bernstein
    slopes = 2.0 * np.stack(
        [[b12 - b1, b13 - b1], [b2 - b12, b23 - b12], [b23 - b13, b3 - b13]]
    )
    places = np.concatenate([*QUARTERS, np.full((1, 3), 1 / 3)])
    p, q, r = places.T
    terms = np.stack([p * p, q * q, r * r, 2 * p * q, 2 * q * r, 2 * p * r], axis=1)
    return bernstein, slopes, terms @ bernstein


_BERNSTEIN, _SLOPES, _CHECKS = _matrices()


def judge(points: Floats, triangles: Indices, rows: Floats) -> tuple[Indices, Bools]:
    """Return the `TriangleClass` (n,) of triangles (n, 3) by sampled margins (10, n, k).

    The rows are those of the vertices and of `samples`, in that order. The second array
    says where more than one margin is uncertain.

    - A margin is certainly negative, or positive, where its bounds are.
    - The uncertain ones leave a simple border if all their gradients, anywhere in the
      triangle, lie in a cone less than half a turn wide: the smallest margin then rises
      along a direction, so its zeros are a graph over the other, and nothing closes on
      itself. The cone may be so wide that the region has corners of `SHARPEST`.
    - Else the triangle is open.
    """
    missing = np.isnan(rows)
    filled = np.where(missing, 0.0, rows)
    low, high, error = _bounds(triangles, filled)
    whole = np.asarray(~missing.any(axis=0))
    if not whole.all():
        _bound_in_part(rows, whole, low, high)
    negative, uncertain = high < 0.0, (low < 0.0) & (high >= 0.0)
    verdict = np.full(len(triangles), int(TriangleClass.INSIDE), dtype=np.intp)
    verdict[uncertain.any(axis=1)] = TriangleClass.OPEN
    tried = np.flatnonzero(
        uncertain.any(axis=1) & ~negative.any(axis=1) & np.all(whole | ~uncertain, axis=1)
    )
    corners = points[triangles[tried]]
    simple = _within_cone(corners, filled[:6, tried], error[tried], uncertain[tried])
    verdict[tried[simple]] = TriangleClass.SIMPLE
    if missing.any():
        empty = void(rows)
        broken = empty.any(axis=0)
        verdict[broken] = TriangleClass.OPEN
        verdict[broken & np.all(missing | (rows >= 0.0), axis=(0, 2))] = (
            TriangleClass.BROKEN
        )
        verdict[empty.all(axis=0)] = TriangleClass.OUTSIDE
    verdict[negative.any(axis=1)] = TriangleClass.OUTSIDE
    return verdict, np.count_nonzero(uncertain, axis=1) > 1


def _bounds(triangles: Indices, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Return bounds of margins (n, k) in triangles, and the error of interpolation."""
    control = np.tensordot(_BERNSTEIN, rows[:6], axes=1)
    awaited = np.tensordot(_CHECKS, rows[:6], axes=1)
    turned = flipped(triangles).T[..., None]
    gaps = [
        np.where(turned[k] == 1, awaited[3 + k], awaited[k]) - rows[6 + k] for k in range(3)
    ]
    error = np.max(np.abs([*gaps, awaited[6] - rows[9]]), axis=0)
    slack = VALUE_SLACK * error
    return control.min(axis=0) - slack, control.max(axis=0) + slack, error


def _bound_in_part(rows: Floats, whole: Bools, low: Floats, high: Floats) -> None:
    """Bound the margins that are NaN at some samples by the others, if they are steady.

    A margin that is NaN at all samples bounds nothing.
    """
    missing = np.isnan(rows)
    smallest = np.min(np.where(missing, np.inf, rows), axis=0)
    largest = np.max(np.where(missing, -np.inf, rows), axis=0)
    with np.errstate(invalid="ignore"):
        spread = STEADY * (largest - smallest)
        positive = (smallest > spread) | missing.all(axis=0)
        negative = -largest > spread
    low[~whole] = np.where(positive, 1.0, -1.0)[~whole]
    high[~whole] = np.where(negative & ~positive, -1.0, 1.0)[~whole]


def _within_cone(corners: Floats, values: Floats, error: Floats, uncertain: Bools) -> Bools:
    """Return whether the gradients of the uncertain margins lie in a cone.

    `corners` (n, 3, 3) are those of the triangles, `values` (6, n, k) the margins at them
    and at mid-edge, `error` (n, k) how far the margins are off.
    """
    n = len(corners)
    slopes = np.tensordot(_SLOPES, values, axes=1)
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    base = np.linalg.norm(one, axis=1)[:, None]
    shift = np.sum(one * other, axis=1)[:, None] / base
    height = np.linalg.norm(cross(one, other), axis=1)[:, None] / base
    first = slopes[:, 0] / base
    second = (slopes[:, 1] - shift * first) / height
    room = np.hypot(1.0 / base, (1.0 + np.abs(shift) / base) / height)
    size = np.hypot(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = SLOPE_SLACK * error * room / size
    slack = np.where(size > 0.0, slack, np.inf)
    angle = np.where(uncertain, np.arctan2(second, first), np.nan)
    slack, angle = (
        np.moveaxis(columns, 1, 0).reshape(n, 3 * uncertain.shape[1])
        for columns in (slack, angle)
    )
    rising = np.sort(angle, axis=1)
    last = np.maximum(np.count_nonzero(~np.isnan(angle), axis=1) - 1, 0)
    around = rising[np.arange(n), last] - 2.0 * np.pi
    gaps = np.diff(np.column_stack([around, rising]), axis=1)
    widest = np.argmax(np.where(np.isnan(gaps), -1.0, gaps), axis=1)
    gap, end = gaps[np.arange(n), widest], rising[np.arange(n), widest]
    along = np.cos(angle - (end + np.pi - 0.5 * gap)[:, None]) - slack
    return np.asarray(np.all((along > np.sin(0.5 * SHARPEST)) | np.isnan(angle), axis=1))
