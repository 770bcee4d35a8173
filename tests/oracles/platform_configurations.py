"""The configurations of a 3-RRR platform, counted without the package's equations.

With the cranks locked, the tip of the first coupler moves on a circle. The arcs from the
second tip to the first tip and to the second elbow are known, so the second tip is one of
two points. These two tips determine the platform, and with it the third tip. The function
is the arc from the third elbow to the third tip, less the arc of the third coupler. It is
defined on one or two closed curves, and each change of its sign is a configuration.
"""

import numpy as np

TANGENT = 1e-4
"""A smaller extremum of the function (cosine of the arc) leaves its count in doubt."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def count_configurations(elbows, couplers, platform, points=6000):
    """Return the number of configurations of a 3-RRR with locked cranks.

    The tip of the first coupler moves around a circle in `points` steps. At each step there
    are two positions of the second tip. Each of them determines the platform, and with it
    the third tip. The cosine of the arc from the third elbow to this tip, less the cosine
    of the third coupler's arc, is zero in a configuration. Its changes of sign are counted.

    Parameters
    ----------
    elbows
        (3, 3) unit axes between cranks and couplers, in rows, in ground axes.
    couplers
        (3,) arcs of the couplers, rad.
    platform
        (3, 3) unit axes of the platform, in rows, in its own axes.
    points
        Number of points of the circle.

    Returns
    -------
    int or None
        None if two configurations nearly coincide.
    """
    first_elbow, second_elbow, third_elbow = elbows
    across = unit(np.cross(first_elbow, [0.3, -0.5, 0.81]))
    angle = 2.0 * np.pi * (np.arange(points) + 0.1234) / points
    circle = np.cos(angle)[:, None] * across
    circle = circle + np.sin(angle)[:, None] * np.cross(first_elbow, across)
    first_tips = np.cos(couplers[0]) * first_elbow + np.sin(couplers[0]) * circle

    # The second tip is a . first tip + b . second elbow +- root . their cross product.
    platform_cosine = platform[0] @ platform[1]
    coupler_cosine = np.cos(couplers[1])
    between = first_tips @ second_elbow
    scale = 1.0 - between**2
    along_tip = (platform_cosine - coupler_cosine * between) / scale
    along_elbow = (coupler_cosine - platform_cosine * between) / scale
    square = (1.0 - along_tip * platform_cosine - along_elbow * coupler_cosine) / scale
    is_closed = square >= 0.0
    root = np.sqrt(np.where(is_closed, square, 0.0))
    platform_frame = np.stack(
        [platform[0], platform[1], np.cross(platform[0], platform[1])], axis=1
    )
    branches = []
    for sign in (1.0, -1.0):
        second_tips = along_tip[:, None] * first_tips + along_elbow[:, None] * second_elbow
        normals = np.cross(first_tips, second_elbow)
        second_tips = second_tips + sign * root[:, None] * normals
        moving_frame = np.stack(
            [first_tips, second_tips, np.cross(first_tips, second_tips)], axis=2
        )
        third_tips = moving_frame @ np.linalg.solve(platform_frame, platform[2])
        branches.append(third_tips @ third_elbow - np.cos(couplers[2]))

    if np.all(is_closed):
        curves = branches  # two closed curves, one for each sign
    else:
        # The signs meet at the ends of each closed range: one curve, there and back.
        starts = np.flatnonzero(is_closed & ~np.roll(is_closed, 1))
        start = int(starts[0]) if len(starts) else 0
        is_closed = np.roll(is_closed, -start)
        plus, minus = (np.roll(branch, -start) for branch in branches)
        edges = np.flatnonzero(np.diff(is_closed, prepend=False, append=False))
        curves = [
            np.concatenate([plus[begin:end], minus[begin:end][::-1]])
            for begin, end in edges.reshape(-1, 2)
        ]
    count = 0
    for curve in curves:
        next_step = np.roll(curve, -1) - curve
        last_step = curve - np.roll(curve, 1)
        is_extremum = next_step * last_step <= 0.0
        if np.any(is_extremum & (np.abs(curve) < TANGENT)):
            return None
        count += int(np.sum(curve * np.roll(curve, 1) < 0.0))
    return count
