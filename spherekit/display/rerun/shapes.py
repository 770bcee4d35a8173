"""Polylines, meshes and rotations that the pictures are made of."""

from itertools import combinations, product

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.vectors import all_finite, unit_rows

LONGEST_CHORD = np.radians(3.0)
"""Longer steps along a path are cut into pieces, so that it stays on the sphere."""

SHORTEST_CHORD = np.radians(0.2)
"""Points of a path that are closer than this are thinned out."""


CIRCLE = 145
"""Points of a closed circle."""


def unit_circle() -> Floats:
    """Return the closed unit circle about z, (n, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, CIRCLE)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)


def box(low: Floats, high: Floats) -> list[Floats]:
    """Return the twelve edges (2, 3) of a box between two corners."""
    corners = [np.array(corner) for corner in product(*zip(low, high, strict=True))]
    return [np.array([a, b]) for a, b in combinations(corners, 2) if np.sum(a != b) == 1]


def vertex_normals(vertices: Floats, triangles: Integers) -> Floats:
    """Return unit normals (v, 3) of a mesh, means of those of the triangles around.

    Where these have no common side, they are turned to agree with the first one.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    summed = np.zeros_like(vertices)
    for k in range(3):
        corner = triangles[:, k]
        against = np.vecdot(summed[corner], flat) < 0.0
        np.add.at(summed, corner, np.where(against[:, None], -flat, flat))
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    unit = summed / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, unit, [0.0, 0.0, 1.0])


def graticule() -> list[Floats]:
    """Return the meridians and parallels every 30 degrees."""
    circle, up = unit_circle(), np.array([0.0, 0.0, 1.0])
    meridians = [
        circle[:, :2] @ np.array([[np.cos(east), np.sin(east), 0.0], up])
        for east in np.radians(np.arange(0, 180, 30))
    ]
    return meridians + [
        circle * np.cos(north) + np.sin(north) * up
        for north in np.radians(np.arange(-60, 90, 30))
    ]


def path_on_sphere(directions: Floats, row: int | None = None) -> list[Floats]:
    """Return the path of a direction (n, 3) as polylines, without its NaN rows.

    A path is cut where a row is NaN, where it jumps by more than a right angle from one
    sample to the next, and after every `row` samples if that is given. A direction that
    does not move has no path.
    """
    finite = all_finite(directions, 1)
    joined = finite[1:] & finite[:-1]
    joined &= np.einsum("ij,ij->i", directions[1:], directions[:-1]) > 0.0
    if row is not None:
        joined[row - 1 :: row] = False
    pieces = np.split(directions, np.flatnonzero(~joined) + 1)
    lines = [_even_steps(piece) for piece in pieces if len(piece) > 1]
    return [line for line in lines if len(line) > 1]


def unbroken(points: Floats) -> list[Floats]:
    """Return the polylines between the NaN rows of points (n, k)."""
    finite = all_finite(points, 1)
    pieces = np.split(points, np.flatnonzero(~(finite[1:] & finite[:-1])) + 1)
    return [piece for piece in pieces if len(piece) > 1]


def _even_steps(line: Floats) -> Floats:
    """Return a polyline with steps neither much too short nor too long."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    if length[-1] < SHORTEST_CHORD:
        return line[:0]
    _, first = np.unique(np.floor(length / SHORTEST_CHORD), return_index=True)
    kept = np.union1d(first, len(line) - 1)
    at = np.union1d(length[kept], np.arange(0.0, length[-1], LONGEST_CHORD))
    return unit_rows(
        np.stack([np.interp(at, length[kept], column[kept]) for column in line.T], axis=1)
    )
