"""Triangles on the unit sphere, refined by bisection so that no vertex hangs."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats, arc, cross
from spherekit.sphere.tilt_torsion import pointing

Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

EDGES = ((0, 1), (1, 2), (2, 0))
_TILT = np.array([[0.36, 0.48, -0.8], [-0.8, 0.60, 0.0], [0.48, 0.64, 0.6]])
"""A rotation that keeps the first vertices away from the axes of common regions."""


def unit(vectors: Floats) -> Floats:
    """Return vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


@cache
def icosahedron(spacing: float) -> tuple[Floats, Indices]:
    """Return vertices (V, 3) and triangles (T, 3), edges at most `spacing` (rad) long.

    Each face of the icosahedron is quartered as often as that needs. Triangles run
    counter-clockwise seen from outside; their first edge is the one bisected first.
    """
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=float)
    flat = np.column_stack([np.zeros(4), signs[:, 0], golden * signs[:, 1]])
    points = unit(np.concatenate([np.roll(flat, k, axis=1) for k in range(3)]))
    dots = points @ points.T
    near = (dots > 0.4) & (dots < 0.5)
    faces = [
        (i, j, k) if np.linalg.det(points[[i, j, k]]) > 0.0 else (i, k, j)
        for i in range(12)
        for j in range(i)
        for k in range(j)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    return refined(points @ _TILT.T, np.array(faces, dtype=np.intp), spacing)


@cache
def hemisphere(spacing: float) -> tuple[Floats, Indices]:
    """Return vertices (V, 3) with z >= 0 and triangles (T, 3), as `icosahedron`.

    They are quarters of the octahedron's upper half, so that edges lie along the equator.
    """
    corners = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]
    points = np.array([*corners, (0.0, 0.0, 1.0)])
    faces = np.array([(k, (k + 1) % 4, 4) for k in range(4)], dtype=np.intp)
    return refined(points, faces, spacing)


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


def spread(count: int, lowest: float = -1.0) -> Floats:
    """Return directions (count, 3) spread evenly over z > `lowest`, on a spiral.

    It turns by the golden section from one to the next.
    """
    number = np.arange(count) + 0.5
    z = 1.0 - (1.0 - lowest) * number / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * number
    side = np.sqrt(1.0 - z * z)
    return np.stack([side * np.cos(azimuth), side * np.sin(azimuth), z], axis=1)


def refined(points: Floats, triangles: Indices, spacing: float) -> tuple[Floats, Indices]:
    """Return triangles quartered until their edges are at most `spacing` (rad) long."""
    while np.max(edge_lengths(points, triangles)) > spacing:
        edges, sides = edges_of(triangles)
        a, b, c = triangles.T
        ab, bc, ca = len(points) + sides.T
        points = np.concatenate([points, unit(points[edges].sum(axis=1))])
        quarters = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return points, triangles


def edge_lengths(points: Floats, triangles: Indices) -> Floats:
    """Return the arcs (T, 3) in rad of the edges of triangles."""
    corners = points[triangles]
    return np.stack([arc(corners[:, i], corners[:, j]) for i, j in EDGES], axis=1)


def edges_of(triangles: Indices) -> tuple[Indices, Indices]:
    """Return the edges (E, 2), lower vertex first, and those of each triangle (T, 3)."""
    both = np.sort(triangles[:, np.array(EDGES)].reshape(-1, 2), axis=1)
    size = int(both.max(initial=0)) + 1
    keys, place = np.unique(both[:, 0] * size + both[:, 1], return_inverse=True)
    edges = np.stack([keys // size, keys % size], axis=1)
    return edges, place.reshape(-1, 3)


def triangle_areas(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the signed areas (n,) in sr of triangles of great circles, ccw positive.

    tan(E/2) = a . (b x c) / (1 + a . b + b . c + c . a)  (A. van Oosterom and J. Strackee,
    1983), the product by differences, which keeps the digits of small triangles.
    """
    volume = np.sum(a * cross(b - a, c - a), axis=-1)
    dots = np.sum(a * b, axis=-1) + np.sum(b * c, axis=-1) + np.sum(c * a, axis=-1)
    return np.asarray(2.0 * np.arctan2(volume, 1.0 + dots))


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
    cut[sides[marked].ravel()] = True
    while True:
        closing = cut[sides].any(axis=1) & ~cut[sides[:, 0]]
        if not closing.any():
            break
        cut[sides[closing, 0]] = True
    middle = np.full(len(edges), -1, dtype=np.intp)
    middle[cut] = len(points) + np.arange(np.count_nonzero(cut))
    points = np.concatenate([points, unit(points[edges[cut]].sum(axis=1))])
    n1, n2, n3 = triangles.T
    m1, m2, m3 = middle[sides].T
    first, second, third = cut[sides].T

    def child(where: Bools, *vertices: Indices) -> Indices:
        return np.stack([vertex[where] for vertex in vertices], axis=1)

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
    origin = np.full(len(triangles), -1, dtype=np.intp)
    origin[: len(kept)] = kept
    return points, triangles, origin


def labels(count: int, links: Indices) -> Indices:
    """Return the number (count,) of the connected part each of `count` things is in.

    `links` (L, 2) join two things each; parts are numbered by their first thing.
    """
    # SciPy's graphs take long to import, and only some regions need them.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    joined = coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), (count, count))
    return np.asarray(connected_components(joined, directed=False)[1], dtype=np.intp)
