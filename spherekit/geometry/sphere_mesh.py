"""Triangles on the unit sphere, refined by bisection so that no vertex hangs."""

from functools import cache
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.rotation import cross, unit_rows
from spherekit.geometry.tilt_torsion import pointing
from spherekit.geometry.triangle import arc

EDGES = np.array([[0, 1], [1, 2], [2, 0]])
_TILT = np.array([[0.36, 0.48, -0.8], [-0.8, 0.60, 0.0], [0.48, 0.64, 0.6]])
"""A rotation that keeps the first vertices away from the axes of common regions."""


@cache
def icosahedron(spacing: float) -> tuple[Floats, Indices]:
    """Return vertices (V, 3) and triangles (T, 3), edges at most `spacing` (rad) long.

    Each face of the icosahedron is quartered as often as that needs. Triangles run
    counter-clockwise seen from outside; their first edge is the one bisected first.
    """
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    flat = np.array([[0.0, y, golden * z] for y in (1, -1) for z in (1, -1)])
    points = unit_rows(np.concatenate([np.roll(flat, k, axis=1) for k in range(3)]))
    dots = points @ points.T
    faces = np.array(
        [k for k in combinations(range(12), 3) if np.min(dots[np.ix_(k, k)]) > 0.4]
    )
    inward = np.linalg.det(points[faces]) < 0.0
    faces[inward] = faces[inward, ::-1]
    return refined(points @ _TILT.T, faces, spacing)


@cache
def hemisphere(spacing: float) -> tuple[Floats, Indices]:
    """Return vertices (V, 3) with z >= 0 and triangles (T, 3), as `icosahedron`.

    They are quarters of the octahedron's upper half, so that edges lie along the equator.
    """
    points = np.concatenate([np.eye(3), -np.eye(2, 3)])
    return refined(points, np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]), spacing)


def sphere_mesh(columns: int = 96, rows: int = 48) -> tuple[Floats, Indices]:
    """Return vertices (v, 3) and triangles (t, 3) along longitudes and latitudes."""
    longitude, colatitude = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, columns + 1), np.linspace(0.0, np.pi, rows + 1)
    )
    vertices = pointing(np.stack([longitude.ravel(), colatitude.ravel()], axis=1))
    across = columns + 1
    corner = (np.arange(rows)[:, None] * across + np.arange(columns)).ravel()
    upper = np.stack([corner, corner + across, corner + 1], axis=-1)
    lower = np.stack([corner + 1, corner + across, corner + across + 1], axis=-1)
    return vertices, np.concatenate([upper, lower])


def refined(points: Floats, triangles: Indices, spacing: float) -> tuple[Floats, Indices]:
    """Return triangles quartered until their edges are at most `spacing` (rad) long."""
    while np.max(edge_lengths(points, triangles)) > spacing:
        edges, sides = edges_of(triangles)
        a, b, c = triangles.T
        ab, bc, ca = len(points) + sides.T
        points = np.concatenate([points, unit_rows(points[edges].sum(axis=1))])
        quarters = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return points, triangles


def edge_lengths(points: Floats, triangles: Indices) -> Floats:
    """Return the arcs (T, 3) in rad of the edges of triangles."""
    corners = points[triangles]
    return arc(corners, np.roll(corners, -1, axis=1))


def edges_of(triangles: Indices) -> tuple[Indices, Indices]:
    """Return the edges (E, 2), lower vertex first, and those of each triangle (T, 3)."""
    low, high = np.moveaxis(np.sort(triangles[:, EDGES], axis=2), 2, 0)
    keys, place = np.unique(low << 32 | high, return_inverse=True)
    return np.stack([keys >> 32, keys & (2**32 - 1)], axis=1), place.reshape(-1, 3)


def triangle_areas(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the signed areas (n,) in sr of triangles of great circles, ccw positive.

    tan(E/2) = a . (b x c) / (1 + a . b + b . c + c . a)  (A. van Oosterom and J. Strackee,
    1983), the product by differences, which keeps the digits of small triangles.
    """
    volume = np.vecdot(a, cross(b - a, c - a))
    return 2.0 * np.arctan2(
        volume, 1.0 + np.vecdot(a, b) + np.vecdot(b, c) + np.vecdot(c, a)
    )


def bisected(
    points: Floats, triangles: Indices, marked: Bools
) -> tuple[Floats, Indices, Indices]:
    """Return vertices and triangles with the marked ones cut into four.

    Neighbours are cut in two to four where it takes that to leave no vertex within an
    edge (newest vertex bisection, W. F. Mitchell 1989, in the array form of S. Funken,
    D. Praetorius and P. Wissgott, 2011).

    Returns
    -------
    points, triangles
        The old vertices come first and keep their numbers.
    origin
        (T,) the number of the old triangle where it was left as it was, else -1.
    """
    edges, sides = edges_of(triangles)
    cut = np.zeros(len(edges), dtype=bool)
    cut[sides[marked]] = True
    while np.any(closing := cut[sides].any(axis=1) & ~cut[sides[:, 0]]):
        cut[sides[closing, 0]] = True
    middle = len(points) - 1 + np.cumsum(cut)
    points = np.concatenate([points, unit_rows(points[edges[cut]].sum(axis=1))])
    n1, n2, n3 = triangles.T
    m1, m2, m3 = middle[sides].T
    first, second, third = cut[sides].T

    def child(where: Bools, *vertices: Indices) -> Indices:
        return np.stack(vertices, axis=1)[where]

    kept = np.flatnonzero(~first)
    parts = [
        triangles[kept],
        child(first & ~third, n3, n1, m1),
        child(first & ~second, n2, n3, m1),
        child(third, m1, n3, m3),
        child(third, n1, m1, m3),
        child(second, m1, n2, m2),
        child(second, n3, m1, m2),
    ]
    triangles = np.concatenate(parts)
    origin = np.full(len(triangles), -1)
    origin[: len(kept)] = kept
    return points, triangles, origin


def labels(count: int, links: Indices) -> Indices:
    """Return the number (count,) of the connected part each of `count` things is in.

    `links` (L, 2) join two things each; parts are numbered by their first thing.
    """
    # SciPy's graphs take long to import, and only some regions need them.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    joined = coo_matrix((np.ones(len(links)), (*links.T,)), (count, count))
    return np.asarray(connected_components(joined, directed=False)[1], dtype=np.intp)


def chains(count: int, links: Indices, directed: bool = False) -> list[Indices]:
    """Return the numbers of things along each line that they make, open ones first.

    `links` (L, 2) join at most two to each of `count` things, where `directed` the first
    to the one after it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import depth_first_order

    joined = coo_matrix((np.ones(len(links)), (*links.T,)), (count, count)).tocsr()
    before = np.bincount((links[:, 1] if directed else links).ravel(), minlength=count)
    order = np.argsort(before, kind="stable")
    _, ends = np.unique(labels(count, links)[order], return_index=True)
    starts = order[np.sort(ends)].tolist()
    orders = (depth_first_order(joined, k, directed, False) for k in starts)
    return [line.astype(np.intp) for line in orders]
