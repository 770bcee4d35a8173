"""Directions and triangle meshes on the unit sphere, and how a mesh is refined.

A mesh is an array of vertices (V, 3), unit vectors, and an array of triangles (T, 3),
vertex numbers. Edges are arcs of great circles.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.tilt_torsion import pointing
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, unit_rows

TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
"""Corners of a triangle that its edges 12, 23 and 31 join."""

_MESH_ROTATION = np.array([[0.36, 0.48, -0.8], [-0.8, 0.60, 0.0], [0.48, 0.64, 0.6]])
"""A rotation that keeps the vertices of the icosahedron away from the coordinate axes.
Regions of mechanisms are often symmetric about these axes, and have corners or borders on
them."""


def spiral_directions(count: int, min_z: float = -1.0) -> Floats:
    """Return directions that are evenly distributed over a cap of the sphere.

    The directions follow a spiral. From each direction to the next, the azimuth changes by
    the golden section of a revolution. Directions on adjacent turns are then not close to
    each other.

    Parameters
    ----------
    count
        Number of directions.
    min_z
        The cap has z > min_z. By default it is the whole sphere.

    Returns
    -------
    (count, 3) unit vectors.
    """
    number = np.arange(count) + 0.5
    z = 1.0 - (1.0 - min_z) * number / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * number
    side = np.sqrt(1.0 - z * z)
    return np.stack([side * np.cos(azimuth), side * np.sin(azimuth), z], axis=1)


@cache
def icosahedron(spacing: float) -> tuple[Floats, Indices]:
    """Return a mesh of the whole sphere, a refined icosahedron.

    Triangles run counter-clockwise seen from outside.

    Parameters
    ----------
    spacing
        Longest edge (rad). The faces are quartered until their edges are not longer.

    Returns
    -------
    points, triangles
        (V, 3) vertices and (T, 3) triangles.
    """
    # The 12 vertices are the corners of three perpendicular rectangles, whose sides are in
    # the ratio of the golden section.
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    rectangle = np.array([[0.0, y, golden * z] for y, z in signs])
    points = unit_rows(np.concatenate([np.roll(rectangle, k, axis=1) for k in range(3)]))
    # Three mutual neighbours form a face. The cosine between neighbours is 0.447, between
    # other vertices at most -0.447.
    cosines = points @ points.T
    faces = np.array(
        [k for k in combinations(range(12), 3) if np.min(cosines[np.ix_(k, k)]) > 0.4]
    )
    is_inward = np.linalg.det(points[faces]) < 0.0
    faces[is_inward] = faces[is_inward, ::-1]
    # The mesh is rotated, so that no vertex is on a coordinate axis. Regions on the sphere
    # often have corners there, because mechanisms are symmetric. At a vertex on a border,
    # rounding would decide whether the vertex is inside.
    return quarter_until_short(points @ _MESH_ROTATION.T, faces, spacing)


@cache
def hemisphere(spacing: float) -> tuple[Floats, Indices]:
    """Return a triangle mesh of the half of the unit sphere with z >= 0.

    The mesh starts from the four upper faces of an octahedron, so edges run along the
    equator. Faces are quartered until no edge is longer than `spacing` (rad). The results
    are the vertices (V, 3) and the triangles (T, 3) as vertex numbers.
    """
    points = np.concatenate([np.eye(3), -np.eye(2, 3)])
    return quarter_until_short(
        points, np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]), spacing
    )


def sphere_mesh(columns: int = 96, rows: int = 48) -> tuple[Floats, Indices]:
    """Return a mesh of the sphere along meridians and parallels, for drawings.

    Parameters
    ----------
    columns, rows
        Number of steps of the longitude and of the latitude.

    Returns
    -------
    points, triangles
        (V, 3) vertices and (T, 3) indices of the vertices of each triangle. Each parallel
        has columns + 1 vertices, so the meridian at longitude 0 and the poles are repeated.
    """
    longitude, colatitude = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, columns + 1), np.linspace(0.0, np.pi, rows + 1)
    )
    vertices = pointing(np.stack([longitude.ravel(), colatitude.ravel()], axis=1))
    # Each quadrilateral between two meridians and two parallels is divided into two
    # triangles. `corner` is its vertex of least longitude and colatitude.
    row_length = columns + 1
    corner = (np.arange(rows)[:, None] * row_length + np.arange(columns)).ravel()
    below = corner + row_length
    upper = np.stack([corner, below, corner + 1], axis=-1)
    lower = np.stack([corner + 1, below, below + 1], axis=-1)
    return vertices, np.concatenate([upper, lower])


def quarter_until_short(
    points: Floats, triangles: Indices, spacing: float
) -> tuple[Floats, Indices]:
    """Return a mesh of the unit sphere with no edge longer than `spacing`.

    The middles of the edges divide all triangles into four. This is repeated until all
    edges are short enough.

    Parameters
    ----------
    points, triangles
        (V, 3) vertices, which are unit vectors, and (T, 3) indices of the vertices of each
        triangle.
    spacing
        Longest edge (rad).

    Returns
    -------
    points, triangles
        The new mesh. Old vertices come first.
    """
    while np.max(measure_edges(points, triangles)) > spacing:
        # `sides` (T, 3) are the indices of the edges ab, bc and ca of each triangle.
        edges, sides = list_edges(triangles)
        a, b, c = triangles.T
        # Each edge gets a new vertex at its middle. New vertices follow the old ones.
        ab, bc, ca = len(points) + sides.T
        middles = unit_rows(points[edges].sum(axis=1))
        points = np.concatenate([points, middles])
        quarters = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return points, triangles


def measure_edges(points: Floats, triangles: Indices) -> Floats:
    """Return the arcs (T, 3) in rad of the edges of triangles."""
    corners = points[triangles]
    return arc(corners, np.roll(corners, -1, axis=1))


def list_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Return the edges of a mesh, each once.

    Parameters
    ----------
    triangles
        (T, 3) vertex numbers.

    Returns
    -------
    edges
        (E, 2) vertices of each edge, the lower number first.
    sides
        (T, 3) for each triangle the indices of its edges, between the vertices 1 and 2, 2
        and 3, 3 and 1.
    """
    ends = triangles[:, TRIANGLE_EDGES]  # (T, 3, 2) vertices of the three edges
    lower = ends.min(axis=2)
    higher = ends.max(axis=2)
    # Both numbers form one integer of 64 bits, the lower number in its upper 32 bits.
    # `np.unique` is much faster on integers than on rows.
    keys, sides = np.unique((lower << 32) | higher, return_inverse=True)
    edges = np.stack([keys >> 32, keys & (2**32 - 1)], axis=1)
    return edges, sides.reshape(len(triangles), 3)


def triangle_areas(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the signed areas of triangles whose sides are arcs of great circles.

    The area E follows from tan(E / 2) = a . (b x c) / (1 + a . b + b . c + c . a)
    (A. van Oosterom and J. Strackee, 1983).

    Parameters
    ----------
    a, b, c
        (n, 3) unit vectors, the corners.

    Returns
    -------
    (n,) areas (sr), positive if the corners are counter-clockwise seen from outside.
    """
    # a . (b x c). Differences of the corners lose no digits for small triangles.
    volume = np.vecdot(a, cross(b - a, c - a))
    return 2.0 * np.arctan2(
        volume, 1.0 + np.vecdot(a, b) + np.vecdot(b, c) + np.vecdot(c, a)
    )


@dataclass(frozen=True)
class BisectedMesh:
    """A triangle mesh after some of its triangles were cut.

    Attributes
    ----------
    points, triangles
        (V, 3) vertices and (T, 3) indices of the vertices of each triangle. Old vertices
        come first, with unchanged numbers.
    origin
        (T,) index that each triangle had before, or -1 for the parts of cut triangles. With
        it, the caller keeps the computed properties of the triangles that were not cut.
    """

    points: Floats
    triangles: Indices
    origin: Indices


def bisect_triangles(points: Floats, triangles: Indices, is_marked: Bools) -> BisectedMesh:
    """Return the mesh on the unit sphere in which marked triangles are cut into four.

    Neighbours are cut into two to four, so that no vertex is in the middle of an edge. The
    method is newest vertex bisection (W. F. Mitchell 1989), in the array form of S. Funken,
    D. Praetorius and P. Wissgott, 2011.

    Parameters
    ----------
    points, triangles
        (V, 3) vertices, which are unit vectors, and (T, 3) triangles. The first edge of
        each triangle is the one that is cut first.
    is_marked
        (T,) triangles to cut.
    """
    # (E, 2) vertices of each edge, and (T, 3) indices of the edges of each triangle.
    edges, sides = list_edges(triangles)
    is_cut = np.zeros(len(edges), dtype=bool)
    is_cut[sides[is_marked]] = True
    # A triangle in which any edge is cut must be cut at its first edge. Cuts spread to
    # neighbours until nothing changes.
    while np.any(must_cut := is_cut[sides].any(axis=1) & ~is_cut[sides[:, 0]]):
        is_cut[sides[must_cut, 0]] = True
    # Indices (E,) of the new vertices. The indices for edges that are not cut have no
    # meaning, and are not used.
    midpoint_of_edge = len(points) - 1 + np.cumsum(is_cut)
    # The middles of the arcs over the edges.
    midpoints = unit_rows(points[edges[is_cut]].sum(axis=1))
    points = np.concatenate([points, midpoints])

    # Vertices n1, n2, n3 and midpoints m1, m2, m3 of the edges 12, 23, 31:
    #
    #            n3
    #           /  \
    #         m3    m2
    #         /      \
    #       n1 - m1 - n2
    #
    # The vertices of a child are in the order of its first edge, then its newest vertex.
    n1, n2, n3 = triangles.T
    m1, m2, m3 = midpoint_of_edge[sides].T
    first_cut, second_cut, third_cut = is_cut[sides].T

    def child(is_made: Bools, *vertices: Indices) -> Indices:
        """Return new triangles (k, 3) by their vertices, where `is_made` is true."""
        return np.stack(vertices, axis=1)[is_made]

    uncut = np.flatnonzero(~first_cut)
    parts = [
        triangles[uncut],
        # The first edge only: two halves. A half with a further cut is halved again.
        child(first_cut & ~third_cut, n3, n1, m1),
        child(first_cut & ~second_cut, n2, n3, m1),
        child(third_cut, m1, n3, m3),
        child(third_cut, n1, m1, m3),
        child(second_cut, m1, n2, m2),
        child(second_cut, n3, m1, m2),
    ]
    triangles = np.concatenate(parts)
    # The index of the old triangle, or -1 for the parts of triangles that were cut.
    origin = np.full(len(triangles), -1)
    origin[: len(uncut)] = uncut
    return BisectedMesh(points, triangles, origin)
