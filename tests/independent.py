"""A search for configurations that shares no code with the package."""

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation


def multi_start(edges, driven, axes, random, starts, steps=26, q=0.0):
    """Return the distinct orientations (k, bodies, 3, 3) that close the pairs.

    Gauss-Newton steps from random orientations of all bodies; the equations say that
    every axis has one direction in space. Bodies are the links joined by driven pairs;
    a single one may be turned by q (rad), its second link then has its axes elsewhere.
    """
    names = [f"p{a}_{b}" for a, b in edges]
    locked = nx.Graph(
        [edge for edge, name in zip(edges, names, strict=True) if name in driven]
    )
    locked.add_nodes_from(link for edge in edges for link in edge)
    bodies = sorted(nx.connected_components(locked), key=min)
    body = {link: k for k, links in enumerate(bodies) for link in links}
    left = [k for k, name in enumerate(names) if name not in driven]
    first, second = np.array([[body[link] for link in edges[k]] for k in left]).T
    u, row = np.stack([axes[left], axes[left]]), np.arange(len(left))
    if q:
        (lock,) = (k for k, name in enumerate(names) if name in driven)
        turn = Rotation.from_rotvec(q * axes[lock])
        for side in (0, 1):
            on = [edges[k][side] == edges[lock][1] for k in left]
            u[side, on] = turn.apply(u[side, on])
    u = u[..., None]
    count = len(bodies)
    turns = Rotation.random(starts * count, rng=random).as_matrix()
    turns = turns.reshape(starts, count, 3, 3)
    turns[:, 0] = np.eye(3)

    def skew(v):
        x, y, z = np.moveaxis(v, 2, 0)
        rows = [[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]]
        return np.transpose(rows, (3, 2, 0, 1))

    for step in range(steps + 1):
        one, other = turns[:, first] @ u[0], turns[:, second] @ u[1]
        gaps = (one - other)[..., 0]
        jacobian = np.zeros((starts, len(left), 3, count, 3))
        jacobian[:, row, :, first] -= skew(one[..., 0])
        jacobian[:, row, :, second] += skew(other[..., 0])
        worst = np.max(np.abs(gaps), axis=(1, 2))
        if step == steps:
            break
        rows = jacobian[:, :, :, 1:].reshape(starts, 3 * len(left), -1)
        square = np.swapaxes(rows, 1, 2) @ rows + 1e-13 * np.eye(rows.shape[2])
        right = np.swapaxes(rows, 1, 2) @ gaps.reshape(starts, -1, 1)
        change = -np.linalg.solve(square, right)[..., 0].reshape(starts, count - 1, 3)
        length = np.max(np.linalg.norm(change, axis=2), axis=1)[:, None, None]
        change *= np.minimum(1.0, 0.7 / np.maximum(length, 1e-300))
        moved = Rotation.from_rotvec(change.reshape(-1, 3)).as_matrix()
        turns[:, 1:] = moved.reshape(starts, count - 1, 3, 3) @ turns[:, 1:]
    distinct = []
    for turn in turns[worst < 1e-11]:
        if all(np.max(np.abs(turn - other)) > 1e-5 for other in distinct):
            distinct.append(turn)
    return np.array(distinct).reshape(-1, count, 3, 3), [min(links) - 1 for links in bodies]
