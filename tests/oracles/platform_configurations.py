"""The configurations of a 3-RRR platform, counted without the package's equations.

With the cranks locked, the tip of the first coupler is a point of a circle. The second tip
then is one of two points at known arcs from it and from the second elbow, and the platform
places the third one. The arc from the third elbow to it is a function on one or two closed
curves; each change of its sign, less that of the coupler, is a configuration.
"""

import numpy as np

TANGENT = 1e-4
"""A smaller extremum of the function (cosine of the arc) leaves its count in doubt."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def count_configurations(elbows, couplers, platform, points=6000):
    """Return the number of configurations, None where two nearly coincide.

    Parameters
    ----------
    elbows
        (3, 3) unit axes between cranks and couplers, in rows, in ground axes.
    couplers
        (3,) arcs of the couplers, rad.
    platform
        (3, 3) unit axes of the platform, in rows, in its own axes.
    """
    first, second, third = elbows
    across = unit(np.cross(first, [0.3, -0.5, 0.81]))
    angle = 2.0 * np.pi * (np.arange(points) + 0.1234) / points
    round_first = np.cos(angle)[:, None] * across
    round_first = round_first + np.sin(angle)[:, None] * np.cross(first, across)
    tips = np.cos(couplers[0]) * first + np.sin(couplers[0]) * round_first

    side = platform[0] @ platform[1]
    reach = np.cos(couplers[1])
    between = tips @ second
    scale = 1.0 - between**2
    on_tip = (side - reach * between) / scale
    on_elbow = (reach - side * between) / scale
    height = (1.0 - on_tip * side - on_elbow * reach) / scale
    closes = height >= 0.0
    root = np.sqrt(np.where(closes, height, 0.0))
    values = []
    for sense in (1.0, -1.0):
        other = on_tip[:, None] * tips + on_elbow[:, None] * second
        other = other + sense * root[:, None] * np.cross(tips, second)
        moving = np.stack([tips, other, np.cross(tips, other)], axis=2)
        own = np.stack(
            [platform[0], platform[1], np.cross(platform[0], platform[1])], axis=1
        )
        placed = moving @ np.linalg.solve(own, platform[2])
        values.append(placed @ third - np.cos(couplers[2]))

    if np.all(closes):
        curves = values
    else:
        begin = int(np.flatnonzero(closes & ~np.roll(closes, 1))[0]) if closes.any() else 0
        turned = [np.roll(part, -begin) for part in (closes, *values)]
        edges = np.flatnonzero(np.diff(turned[0], prepend=False, append=False))
        curves = [
            np.concatenate([turned[1][start:stop], turned[2][start:stop][::-1]])
            for start, stop in edges.reshape(-1, 2)
        ]
    count = 0
    for curve in curves:
        step, last = np.roll(curve, -1) - curve, curve - np.roll(curve, 1)
        is_extremum = step * last <= 0.0
        if np.any(is_extremum & (np.abs(curve) < TANGENT)):
            return None
        count += int(np.sum(curve * np.roll(curve, 1) < 0.0))
    return count
