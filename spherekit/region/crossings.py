"""Points of the border: on edges of triangles, and corners where two margins are 0."""

import numpy as np

from spherekit.conventions import EPS
from spherekit.numeric.brackets import bracketed_zeros
from spherekit.region.constraint_functions import Evaluator, active, chosen, least
from spherekit.region.mesh import Bools, Indices, unit
from spherekit.sphere.rotation import Floats, arc, cross

MOST_STEPS = 30
SETTLED = 1e-14
"""A corner is found when it moves by less than this (rad)."""
BEYOND = 1e-7
"""Where the smallest margin is exactly 0, the one that ends the region is looked for this
much farther on, as part of the edge."""
FARTHEST = 4.0
"""A corner farther from its chord than this times the chord's arc is not its corner."""


def along(start: Floats, end: Floats, angle: Floats) -> Floats:
    """Return the points (n, 3) at angles (rad) from `start` on the arcs to `end`."""
    side = cross(start, end - start)
    toward = unit(cross(side, start))
    return np.cos(angle)[:, None] * start + np.sin(angle)[:, None] * toward


def crossings(
    evaluate: Evaluator, inside: Floats, outside: Floats
) -> tuple[Floats, Indices]:
    """Return where arcs (n,) from inside to outside leave the region, and by which margin.

    `inside` and `outside` are (n, 3); the second array holds the margins' numbers.
    """
    length = arc(inside, outside)

    def rows(angle: Floats, which: Indices) -> Floats:
        return evaluate(along(inside[which], outside[which], angle))

    every, zero = np.arange(len(length)), np.zeros(len(length))
    ends = least(evaluate(np.concatenate([inside, outside])))
    place, beyond = bracketed_zeros(
        lambda angle, which: least(rows(angle, which)),
        zero,
        length,
        ends[: len(length)],
        ends[len(length) :],
        EPS,
    )
    at = least(rows(place, every))
    after = rows(np.where(at == 0.0, place + BEYOND * length, beyond), every)
    number = active(after, evaluate.floor)
    still = np.flatnonzero(least(after) >= 0.0)
    number[still] = active(rows(place[still], still), evaluate.floor)
    return along(inside, outside, place), number


def corners(
    evaluate: Evaluator, start: Floats, end: Floats, third: Floats, pair: Indices
) -> tuple[Floats, Bools]:
    """Return the points (n, 3) near chords where two margins are 0, and whether found.

    Parameters
    ----------
    start, end
        Ends (n, 3) of the chords: the first margin is 0 at one, the second at the other.
    third
        (n, 3) points beside the chords.
    pair
        (n, 2) numbers of the margins.

    Notes
    -----
    Broyden's method (C. G. Broyden, 1965) in the tangent plane, from the slopes over the
    three points.
    """
    first = unit(start + end)
    length = arc(start, end)
    toward = unit(cross(cross(start, end - start), first))
    frame = np.stack([toward, cross(first, toward)], axis=1)
    corner = np.full(len(start), np.nan)[:, None] * first
    sound = np.zeros(len(start), dtype=bool)

    def values(x: Floats, which: Indices) -> Floats:
        places = unit(first[which] + np.einsum("nd,ndx->nx", x, frame[which]))
        rows = evaluate(places)
        return np.stack([chosen(rows, pair[which, k]) for k in range(2)], axis=1)

    def flat(points: Floats) -> Floats:
        toward = np.einsum("nx,ndx->nd", points, frame)
        return np.asarray(toward / np.sum(points * first, axis=1)[:, None])

    every = np.arange(len(start))
    a, b, c = flat(start), flat(end), flat(third)
    fa, fb, fc = (values(x, every) for x in (a, b, c))
    steps = np.stack([b - a, c - a], axis=2)
    with np.errstate(all="ignore"):
        usable = np.abs(np.linalg.det(steps)) > 0.0
        steps[~usable] = np.eye(2)
        slope = np.stack([fb - fa, fc - fa], axis=2) @ np.linalg.inv(steps)
    x, value = 0.5 * (a + b), values(0.5 * (a + b), every)
    going = np.flatnonzero(usable)
    for _ in range(MOST_STEPS):
        matrix = slope[going]
        going = going[np.abs(np.linalg.det(matrix)) > 0.0]
        if not len(going):
            break
        step = -np.linalg.solve(slope[going], value[going][..., None])[..., 0]
        size = np.linalg.norm(step, axis=1)
        most = FARTHEST * length[going]
        step *= np.minimum(1.0, most / np.where(size > 0.0, size, 1.0))[:, None]
        x[going] += step
        new = values(x[going], going)
        square = np.where(size > 0.0, np.sum(step**2, axis=1), 1.0)
        miss = new - value[going] - np.einsum("nij,nj->ni", slope[going], step)
        slope[going] += miss[:, :, None] * step[:, None, :] / square[:, None, None]
        value[going] = new
        exact = np.all(np.abs(new) <= 0.01 * evaluate.floor[pair[going]], axis=1)
        settled = (size < SETTLED) | exact & (size < 100.0 * SETTLED)
        near = np.linalg.norm(x[going], axis=1) < most
        sound[going[settled & near]] = True
        going = going[~settled & (np.linalg.norm(x[going], axis=1) < 3.0 * most)]
    corner[sound] = unit(first + np.einsum("nd,ndx->nx", x, frame))[sound]
    return corner, sound
