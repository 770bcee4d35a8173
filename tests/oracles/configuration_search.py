"""A search for configurations that shares no code with the package."""

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation

SOUND = 1e-4
"""Smallest singular value of the equations in a configuration that is compared."""


def skew(v):
    """Return the matrices (m, n, 3, 3) of the cross product with vectors (n, m, 3)."""
    x, y, z = np.moveaxis(v, 2, 0)
    rows = [[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]]
    return np.transpose(rows, (3, 2, 0, 1))


def search_configurations(mechanism, random, starts, q=0.0, steps=26):
    """Search the configurations of a mechanism with locked inputs, from random starts.

    Links joined by locked pairs form a body. Gauss-Newton steps start from random
    orientations of all bodies. The equations say that the axis of every R pair has the same
    direction in both bodies, and that the centres of two circles in contact keep their arc.

    Parameters
    ----------
    mechanism
        Mechanism with a reference pose of axes, and circles in contact.
    random
        Random number generator.
    starts
        Number of starts.
    q
        Angle (rad) of the only input. With several inputs it must be 0.
    steps
        Number of Gauss-Newton steps.

    Returns
    -------
    rotations
        (configurations, bodies, 3, 3) distinct orientations, relative to the reference
        pose, with the first body fixed. Nearly singular configurations are left out.
    links
        Number of a link of each body.
    """
    # Bodies, and the two bodies of each free pair.
    driven = [mechanism.pair(name) for name in mechanism.input_pairs]
    free_pairs = [pair for pair in mechanism.pairs if pair not in driven]
    locked = nx.Graph([pair.links for pair in driven])
    locked.add_nodes_from(mechanism.links)
    number = mechanism.links.index
    bodies = sorted(
        sorted(map(number, component)) for component in nx.connected_components(locked)
    )
    body_of_link = {mechanism.links[k]: b for b, links in enumerate(bodies) for k in links}
    body_pairs = [[body_of_link[link] for link in pair.links] for pair in free_pairs]
    first_body, second_body = np.array(body_pairs).T
    body_count = len(bodies)
    pair_count = len(free_pairs)
    pair_rows = np.arange(pair_count)

    # Vectors (2, pairs, 3): axis or centre of circle, in the first and the second body.
    vectors = np.empty((2, pair_count, 3))
    for k, pair in enumerate(free_pairs):
        if pair.type == "R":
            vectors[:, k] = mechanism.geometry.axes[pair.name]
        else:
            vectors[:, k] = [profile.centre for profile in pair.profiles]
    is_contact = np.array([pair.type != "R" for pair in free_pairs])
    contact_cosine = np.sum(vectors[0] * vectors[1], axis=1)[is_contact]
    turned = q - mechanism.geometry.values.get(driven[0].name, 0.0)
    if turned:
        (lock,) = driven
        axis = np.array(mechanism.geometry.axes[lock.name])
        turn = Rotation.from_rotvec(turned * axis)
        for side in (0, 1):
            is_on_turned_link = [pair.links[side] == lock.links[1] for pair in free_pairs]
            vectors[side, is_on_turned_link] = turn.apply(vectors[side, is_on_turned_link])
    vectors = vectors[..., None]

    rotations = Rotation.random(starts * body_count, rng=random).as_matrix()
    rotations = rotations.reshape(starts, body_count, 3, 3)
    rotations[:, 0] = np.eye(3)
    for step in range(steps + 1):
        first = (rotations[:, first_body] @ vectors[0])[..., 0]
        second = (rotations[:, second_body] @ vectors[1])[..., 0]
        gaps = first - second
        gaps[:, is_contact] = 0.0
        cosine = np.sum(first * second, axis=2)[:, is_contact]
        gaps[:, is_contact, 0] = cosine - contact_cosine

        # A small turn x of a body changes its vector v by x cross v.
        jacobian = np.zeros((starts, pair_count, 3, body_count, 3))
        normals = np.swapaxes(np.cross(first, second), 0, 1)
        for sign, body, slopes in (
            (1.0, first_body, -skew(first)),
            (-1.0, second_body, skew(second)),
        ):
            slopes[is_contact] = 0.0
            slopes[is_contact, :, 0] = sign * normals[is_contact]
            jacobian[:, pair_rows, :, body] += slopes
        rows = jacobian[:, :, :, 1:].reshape(starts, 3 * pair_count, -1)
        if step == steps:
            break
        # The small multiple of the identity keeps singular systems solvable.
        normal_matrix = np.swapaxes(rows, 1, 2) @ rows + 1e-13 * np.eye(rows.shape[2])
        right_side = np.swapaxes(rows, 1, 2) @ gaps.reshape(starts, -1, 1)
        change = -np.linalg.solve(normal_matrix, right_side)[..., 0]
        change = change.reshape(starts, body_count - 1, 3)
        length = np.max(np.linalg.norm(change, axis=2), axis=1)[:, None, None]
        change *= np.minimum(1.0, 0.7 / np.maximum(length, 1e-300))  # at most 0.7 rad
        turns = Rotation.from_rotvec(change.reshape(-1, 3)).as_matrix()
        turns = turns.reshape(starts, body_count - 1, 3, 3)
        rotations[:, 1:] = turns @ rotations[:, 1:]

    is_closed = np.max(np.abs(gaps), axis=(1, 2)) < 1e-11
    is_regular = np.linalg.svd(rows, compute_uv=False)[:, -1] > SOUND
    distinct = []
    for candidate in rotations[is_closed & is_regular]:
        if all(np.max(np.abs(candidate - accepted)) > 1e-5 for accepted in distinct):
            distinct.append(candidate)
    configurations = np.array(distinct).reshape(-1, body_count, 3, 3)
    return configurations, [links[0] for links in bodies]


def count_missing(rotations, candidates, apart=1e-4):
    """Return how many configurations (k, bodies, 3, 3) are not among the candidates.

    Configurations are equal if no element of their rotations differs by more than `apart`.
    """
    gaps = np.abs(rotations[:, None] - candidates[None])
    distances = np.max(gaps, axis=(2, 3, 4), initial=0.0)
    return int(np.sum(np.min(distances, axis=1, initial=np.inf) > apart))
