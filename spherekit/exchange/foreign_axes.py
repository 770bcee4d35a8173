"""The point in which the axes of another program's model meet, and plain decimals."""

import math

import numpy as np

from spherekit.arrays import Floats

PARALLEL = 1e-9
"""Sine below which two axes are parallel."""


def distances(place: Floats, points: Floats, axes: Floats) -> Floats:
    """Return how far (n,) m lines through points along unit axes (n, 3) pass a place."""
    return np.linalg.norm(np.cross(place - points, axes), axis=1)


def common_point(points: Floats, axes: Floats, within: float) -> Floats | None:
    """Return the point (3,) that lines pass within a distance (m), None if parallel.

    Lines go through points along unit axes (n, 3). The point of least squared distances,
    where the farthest lines are left out until the others pass it. Where all lines are one,
    any point of it will do, and the one nearest to the origin is taken.
    """
    kept, best = np.arange(len(points)), None
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    while len(kept) > 1:
        summed = np.sum(across[kept], axis=0)
        if np.linalg.eigvalsh(summed)[0] < PARALLEL**2 * len(kept):
            break
        pulled = np.sum(across[kept] @ points[kept, :, None], axis=0)[:, 0]
        best = np.linalg.solve(summed, pulled)
        gaps = distances(best, points[kept], axes[kept])
        if np.max(gaps) <= within:
            break
        kept = np.delete(kept, np.argmax(gaps))
    if best is not None:
        return best
    foot = points[0] - (points[0] @ axes[0]) * axes[0]
    return foot if np.max(distances(foot, points, axes)) <= within else None


ROUNDING = 4e-15
"""Numbers that differ by less, relative to what is beside them, are one."""

DEGREES = 1e-14
"""The same of angles in degrees, relative, or absolute where they are below one."""


def plain(number: float, scale: float, rounding: float = ROUNDING) -> float:
    """Return the shortest decimal within the rounding of numbers as large as `scale`."""
    number = float(number)
    allowed = rounding * max(abs(scale), abs(number))
    for digits in range(1, 18):
        short = float(f"{number:.{digits}g}")
        if abs(short - number) <= allowed:
            return 0.0 if abs(number) <= allowed else short
    return number


def plain_angle(angle: float) -> float:
    """Return an angle (rad) as it stands in a file, in degrees."""
    return plain(math.degrees(angle), 1.0, DEGREES)


def plain_axis(axis: Floats) -> list[float]:
    """Return the components of an axis (3,) as they stand in a file."""
    return [plain(part, 1.0) for part in axis]
