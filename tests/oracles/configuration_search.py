"""A search for configurations that shares no code with the package."""

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation

SOUND = 1e-4
"""Least singular value of a configuration that is compared."""


def skew(v):
    """Return the matrices (m, n, 3, 3) of the cross product with vectors (n, m, 3)."""
    x, y, z = np.moveaxis(v, 2, 0)
    rows = [[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]]
    return np.transpose(rows, (3, 2, 0, 1))


def search_configurations(made, random, starts, q=0.0, steps=26):
    """Return the distinct orientations (k, bodies, 3, 3) that close the pairs.

    With a link of each body: those are the links joined by driven pairs. Gauss-Newton
    steps from random orientations of all bodies; the equations say that every axis of the
    reference pose has one direction in space, and that the centres of two circles in
    contact keep their arc. A single input may be turned to q (rad), its second link then
    has its axes elsewhere.
    """
    driven = [made.pair(name) for name in made.input_pairs]
    left = [pair for pair in made.pairs if pair not in driven]
    locked = nx.Graph([pair.links for pair in driven])
    locked.add_nodes_from(made.links)
    number = made.links.index
    bodies = sorted(sorted(map(number, on)) for on in nx.connected_components(locked))
    body = {made.links[link]: k for k, links in enumerate(bodies) for link in links}
    first, second = np.array([[body[link] for link in pair.links] for pair in left]).T
    u, row = np.empty((2, len(left), 3)), np.arange(len(left))
    for k, pair in enumerate(left):
        axis = made.geometry.axes.get(pair.name)
        u[:, k] = axis if pair.type == "R" else [p.centre for p in pair.profiles]
    touching = np.array([pair.type != "R" for pair in left])
    cosine = np.sum(u[0] * u[1], axis=1)[touching]
    turned = q - made.geometry.values.get(driven[0].name, 0.0)
    if turned:
        (lock,) = driven
        turn = Rotation.from_rotvec(turned * np.array(made.geometry.axes[lock.name]))
        for side in (0, 1):
            on = [pair.links[side] == lock.links[1] for pair in left]
            u[side, on] = turn.apply(u[side, on])
    u, count = u[..., None], len(bodies)
    turns = Rotation.random(starts * count, rng=random).as_matrix()
    turns = turns.reshape(starts, count, 3, 3)
    turns[:, 0] = np.eye(3)
    for step in range(steps + 1):
        one, other = (turns[:, first] @ u[0])[..., 0], (turns[:, second] @ u[1])[..., 0]
        gaps, slopes = one - other, (-skew(one), skew(other))
        gaps[:, touching] = 0.0
        gaps[:, touching, 0] = np.sum(one * other, axis=2)[:, touching] - cosine
        jacobian = np.zeros((starts, len(left), 3, count, 3))
        for side, (at, slope) in enumerate(zip((first, second), slopes, strict=True)):
            across = (-1.0) ** side * np.swapaxes(np.cross(one, other), 0, 1)
            slope[touching] = 0.0
            slope[touching, :, 0] = across[touching]
            jacobian[:, row, :, at] += slope
        rows = jacobian[:, :, :, 1:].reshape(starts, 3 * len(left), -1)
        if step == steps:
            break
        square = np.swapaxes(rows, 1, 2) @ rows + 1e-13 * np.eye(rows.shape[2])
        right = np.swapaxes(rows, 1, 2) @ gaps.reshape(starts, -1, 1)
        change = -np.linalg.solve(square, right)[..., 0].reshape(starts, count - 1, 3)
        length = np.max(np.linalg.norm(change, axis=2), axis=1)[:, None, None]
        change *= np.minimum(1.0, 0.7 / np.maximum(length, 1e-300))
        moved = Rotation.from_rotvec(change.reshape(-1, 3)).as_matrix()
        turns[:, 1:] = moved.reshape(starts, count - 1, 3, 3) @ turns[:, 1:]
    closed = np.max(np.abs(gaps), axis=(1, 2)) < 1e-11
    distinct = []
    for turn in turns[closed & (np.linalg.svd(rows, compute_uv=False)[:, -1] > SOUND)]:
        if all(np.max(np.abs(turn - other)) > 1e-5 for other in distinct):
            distinct.append(turn)
    return np.array(distinct).reshape(-1, count, 3, 3), [links[0] for links in bodies]


def count_missing(turns, placed, apart=1e-4):
    """Return how many orientations (k, bodies, 3, 3) are none of those placed."""
    away = np.max(np.abs(turns[:, None] - placed[None]), axis=(2, 3, 4), initial=0.0)
    return int(np.sum(np.min(away, axis=1, initial=np.inf) > apart))
