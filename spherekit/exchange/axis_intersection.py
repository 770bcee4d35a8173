"""The point in which lines in space nearly meet, such as axes of an imported model."""

import numpy as np

from spherekit.arrays import Floats

PARALLEL_SINE = 1e-9
"""Sine of the angle below which two axes are parallel.

Larger: axes of a model whose centre is far away are refused as parallel; smaller: the
common point of axes that are parallel but for rounding lies at an arbitrary distance.
"""


def distances_to_lines(position: Floats, points: Floats, axes: Floats) -> Floats:
    """Return the distances (n,) of a position from n lines, in the unit of the points.

    Parameters
    ----------
    position
        (3,) the position.
    points, axes
        (n, 3) a point and the unit vector of each line.
    """
    return np.linalg.norm(np.cross(position - points, axes), axis=1)


def find_common_point(points: Floats, axes: Floats, max_distance: float) -> Floats | None:
    """Return the point in which most of n lines nearly meet.

    In an imported model the lines are joint axes, and the point is the centre of the
    spherical mechanism. The point has the least sum of squared distances from the lines. If
    a line misses the point by more than `max_distance`, the farthest line is left out and
    the point is computed again, until all remaining lines fit. If there is only one line,
    or all lines coincide, the result is the point of the line nearest to the origin.

    A line has a point p, a unit vector a, and the projection P = I - a a^T onto the plane
    at right angles to it. The point c solves sum(P) c = sum(P p), summed over the lines.

    Parameters
    ----------
    points, axes
        (n, 3) a point (m) and the unit vector of each line.
    max_distance
        Largest distance (m) at which a line may miss the point.

    Returns
    -------
    (3,) the point (m), or None if the lines are parallel and do not coincide. Lines that
    were left out may miss the point.
    """
    used_lines = np.arange(len(points))
    common_point = None
    projections = np.eye(3) - axes[:, :, None] * axes[:, None]
    while len(used_lines) > 1:
        # The lines are parallel if they have tiny angles to a common direction. The first
        # singular vector of the axes is the direction with the least sum of squared sines
        # of these angles. The other singular values squared add up to this sum.
        smaller_values = np.linalg.svd(axes[used_lines], compute_uv=False)[1:]
        if np.sum(smaller_values**2) < PARALLEL_SINE**2 * len(used_lines):
            # The remaining lines are parallel. A point that was found with more lines is
            # kept.
            break
        # The equations P c = P p of all lines are solved by least squares. Their sum,
        # sum(P) c = sum(P p), has the same solution, but its condition number is the square
        # of theirs.
        projected_points = projections[used_lines] @ points[used_lines, :, None]
        least_squares = np.linalg.lstsq(
            np.concatenate(projections[used_lines]), projected_points.ravel()
        )
        common_point = least_squares[0].astype(np.float64)
        distances = distances_to_lines(common_point, points[used_lines], axes[used_lines])
        if np.max(distances) <= max_distance:
            break
        used_lines = np.delete(used_lines, np.argmax(distances))
    if common_point is not None:
        return common_point
    # There is one line, or all lines are parallel. Parallel lines may coincide.
    nearest_to_origin = points[0] - (points[0] @ axes[0]) * axes[0]
    distances = distances_to_lines(nearest_to_origin, points, axes)
    return nearest_to_origin if np.max(distances) <= max_distance else None
