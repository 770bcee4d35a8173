"""What the margins sampled in a triangle say of the region within it.

Each margin is interpolated by a polynomial of degree 2; how far it is off at four more
places bounds its error. What is said is as sure as these samples.
"""

from enum import IntEnum

import numpy as np

from spherekit.region.margins import void
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


class Verdict(IntEnum):
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
    """Return the `Verdict` (n,) of triangles (n, 3) from their sampled margins (n, 10, k).

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
    whole = ~missing.any(axis=1)
    filled = np.where(missing, 0.0, rows)
    control = np.einsum("cs,nsk->nck", _BERNSTEIN, filled[:, :6])
    awaited = np.einsum("cs,nsk->nck", _CHECKS, filled[:, :6])
    on_edge = np.arange(3) + 3 * flipped(triangles)
    awaited = np.concatenate(
        [np.take_along_axis(awaited, on_edge[..., None], axis=1), awaited[:, 6:]], axis=1
    )
    gap = np.abs(awaited - filled[:, 6:])
    error = np.max(gap, axis=1)
    low = np.min(control, axis=1) - VALUE_SLACK * error
    high = np.max(control, axis=1) + VALUE_SLACK * error
    smallest = np.min(np.where(missing, np.inf, rows), axis=1)
    largest = np.max(np.where(missing, -np.inf, rows), axis=1)
    with np.errstate(invalid="ignore"):
        spread = STEADY * (largest - smallest)
        low = np.where(whole, low, np.where(smallest > spread, 1.0, -1.0))
        high = np.where(whole, high, np.where(-largest > spread, -1.0, 1.0))
    nowhere = missing.all(axis=1)
    low = np.where(nowhere, 1.0, low)
    negative, uncertain = high < 0.0, (low <= 0.0) & (high >= 0.0)
    hole = void(rows)
    simple = _within_cone(points[triangles], filled[:, :6], error, uncertain)
    simple &= np.all(whole | ~uncertain, axis=1)
    verdict = np.where(simple, Verdict.SIMPLE, Verdict.OPEN)
    verdict = np.where(uncertain.any(axis=1), verdict, Verdict.INSIDE)
    none_negative = np.all(missing | (rows >= 0.0), axis=(1, 2))
    broken = np.where(none_negative, Verdict.BROKEN, Verdict.OPEN)
    verdict = np.where(hole.any(axis=1), broken, verdict)
    out = negative.any(axis=1) | hole.all(axis=1)
    contested = np.count_nonzero(uncertain, axis=1) > 1
    return np.where(out, Verdict.OUTSIDE, verdict).astype(np.intp), contested


def _within_cone(corners: Floats, values: Floats, error: Floats, uncertain: Bools) -> Bools:
    """Return whether the gradients of the uncertain margins lie in a cone."""
    n = len(values)
    slopes = np.einsum("vdc,nck->nvkd", _SLOPES, values)
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    base = np.linalg.norm(one, axis=1)
    shift = np.sum(one * other, axis=1) / base
    height = np.linalg.norm(cross(one, other), axis=1) / base
    wide = (slice(None), None, None)
    first = slopes[..., 0] / base[wide]
    second = (slopes[..., 1] - shift[wide] * first) / height[wide]
    room = np.hypot(1.0 / base, (1.0 + np.abs(shift) / base) / height)
    size = np.hypot(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = SLOPE_SLACK * error[:, None] * room[wide] / size
    slack = np.where(size > 0.0, slack, np.inf).reshape(n, -1)
    used = np.broadcast_to(uncertain[:, None], size.shape).reshape(n, -1)
    angle = np.where(used, np.arctan2(second, first).reshape(n, -1), np.nan)
    rising = np.sort(angle, axis=1)
    last = np.maximum(np.count_nonzero(used, axis=1) - 1, 0)[:, None]
    around = np.take_along_axis(rising, last, axis=1) - 2.0 * np.pi
    gaps = np.diff(np.concatenate([around, rising], axis=1), axis=1)
    widest = np.argmax(np.where(np.isnan(gaps), -1.0, gaps), axis=1)[:, None]
    end = np.take_along_axis(rising, widest, axis=1)
    middle = end + np.pi - 0.5 * np.take_along_axis(gaps, widest, axis=1)
    along = np.cos(angle - middle) - slack
    return np.asarray(np.all((along > np.sin(0.5 * SHARPEST)) | ~used, axis=1))
