"""The point that axes of another program's model meet in."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np

from spherekit.sphere.rotation import Floats

PARALLEL = 1e-9
"""Sine below which two axes are parallel."""


@final
@dataclass(frozen=True)
class Line:
    """A named line through a point (3,) along a unit vector (3,)."""

    name: str
    point: Floats
    axis: Floats

    def distance(self, place: Floats) -> float:
        """Return how far (m) it passes a place (3,)."""
        return float(np.linalg.norm(np.cross(place - self.point, self.axis)))


def common_point(lines: Sequence[Line], within: float) -> Floats | None:
    """Return the point (3,) that most lines pass within a distance (m), None if parallel.

    Among points that equally many lines pass, the one nearest to all. Where all lines are
    one, any point of it will do, and the one nearest to the origin is taken.
    """
    candidates = [
        place
        for one, other in combinations(lines, 2)
        if (place := _nearest([one, other])) is not None
    ]
    if not candidates:
        first = lines[0]
        foot = first.point - (first.point @ first.axis) * first.axis
        apart = max(line.distance(foot) for line in lines)
        return np.asarray(foot) if apart <= within else None

    def quality(place: Floats) -> tuple[int, float]:
        gaps = [line.distance(place) for line in lines]
        return sum(gap <= within for gap in gaps), -sum(gaps)

    best = max(candidates, key=quality)
    near = [line for line in lines if line.distance(best) <= within]
    finer = _nearest(near)
    return best if finer is None else finer


def _nearest(lines: Sequence[Line]) -> Floats | None:
    """Return the point (3,) of least squared distances, None where lines are parallel."""
    if len(lines) < 2:
        return None
    across = [np.eye(3) - np.outer(line.axis, line.axis) for line in lines]
    summed = np.sum(across, axis=0)
    if np.linalg.eigvalsh(summed)[0] < PARALLEL**2 * len(lines):
        return None
    right = np.sum([a @ line.point for a, line in zip(across, lines, strict=True)], axis=0)
    return np.asarray(np.linalg.solve(summed, right))
