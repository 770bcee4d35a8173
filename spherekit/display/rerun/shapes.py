"""Polylines and normals of meshes that scenes are drawn with."""

from itertools import combinations, product

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.vectors import all_finite, unit_rows

MAX_PATH_STEP_RAD = np.radians(3.0)
"""Largest step along a path on the sphere. Larger: the path visibly leaves the sphere;
smaller: more points."""

MIN_PATH_STEP_RAD = np.radians(0.2)
"""Length of the intervals of a path of which each keeps one sample. Larger: corners are
lost; smaller: more points."""

CIRCLE_POINTS = 145
"""Number of points of a closed circle."""


def unit_circle() -> Floats:
    """Return the closed unit circle about z, (n, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)


def box(low: Floats, high: Floats) -> list[Floats]:
    """Return the twelve edges (2, 3) of a box between two corners."""
    corners = [np.array(corner) for corner in product(*zip(low, high, strict=True))]
    return [np.array([a, b]) for a, b in combinations(corners, 2) if np.sum(a != b) == 1]


def vertex_normals(vertices: Floats, triangles: Integers) -> Floats:
    """Return unit normals (v, 3) of a triangle mesh at its vertices, for its shading.

    The normal at a vertex is the mean of the normals of the triangles around it, weighted
    by area. Neighbouring triangles may have opposite orders of corners, so that their
    normals would cancel. Therefore one triangle at each vertex is the reference. Normals of
    other triangles are reversed if they point against its normal. A vertex without
    triangles gets (0, 0, 1).

    Parameters
    ----------
    vertices
        (v, 3) points.
    triangles
        (t, 3) indices of the three vertices of each triangle.
    """
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    triangle_normals = np.cross(b - a, c - a)  # length: twice the area
    # The normal of one triangle at each vertex; a triangle without area has no normal.
    references = np.zeros(vertices.shape)
    has_area = np.any(triangle_normals != 0.0, axis=1)
    for corner in range(3):
        references[triangles[has_area, corner]] = triangle_normals[has_area]
    sums = np.zeros(vertices.shape)
    for corner in range(3):
        vertex = triangles[:, corner]
        is_opposite = np.vecdot(references[vertex], triangle_normals) < 0.0
        signed_normals = np.where(is_opposite[:, None], -triangle_normals, triangle_normals)
        np.add.at(sums, vertex, signed_normals)  # also adds where an index is repeated
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    unit_normals = sums / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, unit_normals, [0.0, 0.0, 1.0])


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


def path_on_sphere(directions: Floats, row_length: int | None = None) -> list[Floats]:
    """Return the path of a moving direction on the unit sphere as polylines (n, 3).

    The path is broken at NaN rows, and between successive samples that are a right angle or
    more apart, since the direction may have jumped. A direction that does not move
    has no path.

    Parameters
    ----------
    directions
        (n, 3) unit vectors, in the order of samples.
    row_length
        Number of samples in one line of a grid of two inputs. The path is broken after each
        line. None if the samples follow each other along a single curve.
    """
    is_finite = all_finite(directions, 1)
    # Whether each sample is joined with the next sample.
    is_connected = is_finite[1:] & is_finite[:-1]
    is_connected &= np.einsum("ij,ij->i", directions[1:], directions[:-1]) > 0.0
    if row_length is not None:
        is_connected[row_length - 1 :: row_length] = False
    pieces = np.split(directions, np.flatnonzero(~is_connected) + 1)
    lines = [_resample(piece) for piece in pieces if len(piece) > 1]
    return [line for line in lines if len(line) > 1]


def split_at_nan(points: Floats) -> list[Floats]:
    """Return the polylines between the NaN rows of points (n, k)."""
    is_finite = all_finite(points, 1)
    is_connected = is_finite[1:] & is_finite[:-1]
    pieces = np.split(points, np.flatnonzero(~is_connected) + 1)
    return [piece for piece in pieces if len(piece) > 1]


def _resample(line: Floats) -> Floats:
    """Return a polyline (n, 3) on the unit sphere without too short or too long steps.

    The polyline is divided into intervals of the length `MIN_PATH_STEP_RAD`. To save space,
    only the first point in each interval and the last point of all are used. Longer steps
    than `MAX_PATH_STEP_RAD`, whose chords would visibly leave the sphere, are divided into
    equal arcs. A polyline shorter than `MIN_PATH_STEP_RAD` altogether becomes empty.
    """
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    # Length of the polyline from its beginning to each point.
    length = np.concatenate([[0.0], np.cumsum(steps)])
    if length[-1] < MIN_PATH_STEP_RAD:
        return line[:0]
    _, first_points = np.unique(np.floor(length / MIN_PATH_STEP_RAD), return_index=True)
    points = line[np.union1d(first_points, len(line) - 1)]
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arcs = 2.0 * np.arcsin(np.minimum(0.5 * chords, 1.0))
    counts = np.maximum(np.ceil(arcs / MAX_PATH_STEP_RAD), 1).astype(np.int64)
    # The arc from `points[step]` to the next point is divided into `counts[step]` parts. A
    # new point is at the beginning of each part. `part` is the number of the part.
    step = np.repeat(np.arange(len(arcs)), counts)
    part = np.arange(len(step)) - np.repeat(np.cumsum(counts) - counts, counts)
    angle = arcs[step] * part / counts[step]
    weights = np.stack([np.sin(arcs[step] - angle), np.sin(angle)], axis=1)
    # Both weights are zero where the points of a step are equal.
    weights[arcs[step] == 0.0] = [1.0, 0.0]
    inner = weights[:, :1] * points[step] + weights[:, 1:] * points[step + 1]
    return unit_rows(np.concatenate([inner, points[-1:]]))
