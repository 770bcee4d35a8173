"""The ways out of a configuration, also out of one in which configuration curves cross."""

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.closure import Closure
from spherekit.motion.loops import left_inverse
from spherekit.motion.segments import bordered
from spherekit.sphere.rotation import Floats

RADIUS = 0.02
"""How far (rad) from the configuration points of the curves are looked for."""
MOVES = 1e-4
"""Relative singular values of the velocity equations below this are motions here."""
DIRECTIONS = 64
"""Directions of motion tried where there are several motions."""
MOST_STEPS = 20
SAME = 1e-6
"""Points (rad) nearer to each other than this part of the radius are one."""


def ways_out(closure: Closure, values: Floats, radius: float = RADIUS) -> Floats:
    """Return closed configurations (n, variables) around one, on every way out of it.

    `values` (variables,) closes; where one curve passes there are two, one on each side.
    Each is `radius` (rad) away in the variables. Where the configuration is part of
    a surface there is no end of them, and some are returned.
    """
    _, sizes, right = np.linalg.svd(closure.at(values[None]).jacobian[0])
    sizes = np.append(sizes, np.zeros(len(right) - len(sizes)))
    motions = right[sizes < MOVES * max(sizes[0], MOVES)]
    if not len(motions):
        return np.zeros((0, len(values)))
    start = values + radius * _directions(len(motions)) @ motions
    for _ in range(MOST_STEPS):
        at = closure.at(start)
        away = start - values
        length = np.linalg.norm(away, axis=1)
        inverse = left_inverse(bordered(at.jacobian, away / length[:, None]))
        change = np.einsum("nij,nj->ni", inverse[:, :, :-1], -at.residual)
        change += inverse[:, :, -1] * (radius - length)[:, None]
        moved = np.max(np.abs(change), axis=1)
        change *= np.minimum(1.0, 0.5 * radius / np.maximum(moved, 1e-300))[:, None]
        start = start + np.nan_to_num(change)
    length = np.linalg.norm(start - values, axis=1)
    closed = closure.at(start).gap < CLOSURE_TOLERANCE
    closed &= np.abs(length - radius) < SAME * radius
    found: list[Floats] = []
    for point in start[closed]:
        if all(np.max(np.abs(point - other)) > SAME * radius for other in found):
            found.append(point)
    return np.array(found).reshape(-1, len(values))


def _directions(count: int) -> Floats:
    """Return unit vectors (n, count) spread over the sphere of so many dimensions."""
    if count == 1:
        return np.array([[1.0], [-1.0]])
    if count == 2:
        turn = 2.0 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)
    random = np.random.default_rng(20240616)
    found = random.normal(size=(DIRECTIONS, count))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))
