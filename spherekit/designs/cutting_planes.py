"""The least maximum of several functions with kinks, within bounds."""

from collections.abc import Callable, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs

Parts = tuple[Floats, Floats, Floats, Floats]
"""Values (k,), gradients (k, n), limits' values (m,) and gradients (m, n) at a place."""


FIRST = 0.05


LONGEST = 0.25


SHORTEST = 1e-9
"""Longest step along an axis: of the first step, of any, and where a descent ends."""


SERIOUS = 0.1
"""Part of the decrease that the planes promise from which a step is taken."""


ROOM = 0.1
"""Part of a promised decrease by which limits are kept to."""


MOST_STEPS = 200


KEPT = 40
"""Places whose planes are kept, the newest."""


NEAR = 4.0
"""Planes of places within this many steps are kept."""


def least_greatest(
    parts: Callable[[Floats], Parts | None], x: Floats, enough: float
) -> tuple[Floats, float]:
    """Return a place (n,) in the unit cube and the greatest of some functions there.

    No step within a shrinking box about it makes the greatest smaller, as far as the planes
    through the functions at all places tried tell (the cutting-plane method with a trust
    region; Schramm and Zowe 1992). Planes that functions bend away from are moved down.

    Parameters
    ----------
    parts
        Functions, and limits that are to stay <= 0, with gradients; None where there are
        none. A gradient at a kink is that of one side.
    x
        (n,) where to begin; limits that are missed there may be missed as much.
    enough
        The descent ends where planes promise less.
    """
    begun = parts(x)
    if begun is None:
        return x, np.inf
    now = np.max(begun[0])
    allowed = np.maximum(begun[2], 0.0)
    looked = [(x, begun)]
    radius = FIRST
    for _ in range(MOST_STEPS):
        step, promised = _step(looked, x, now, allowed, radius)
        if promised < enough and radius <= FIRST * 1e-2:
            break
        tried = np.clip(x + step, 0.0, 1.0)
        there = parts(tried) if promised > 0.0 else None
        if there is not None:
            looked.append((tried, there))
            value = np.max(there[0])
            if now - value >= SERIOUS * promised and np.all(there[2] <= allowed):
                x = tried
                now = value
                radius = min(2.0 * radius, LONGEST)
                continue
        radius *= 0.5
        if radius < SHORTEST:
            break
        looked = [item for item in looked if max_abs(item[0] - x) <= NEAR * radius][-KEPT:]
    return x, now


def _step(
    looked: Sequence[tuple[Floats, Parts]],
    x: Floats,
    now: float,
    allowed: Floats,
    radius: float,
) -> tuple[Floats, float]:
    """Return the step (n,) that planes promise most of, and how much."""
    from scipy.optimize import linprog

    planes = []
    right = []
    for place, (values, gradients, limits, by_limits) in looked:
        # A limit that bends is met with room, as much as the step promises.
        for at, slopes, most, room in (
            (values, gradients, now, 1.0),
            (limits, by_limits, allowed, ROOM),
        ):
            planes.append(np.column_stack([slopes, np.full(len(at), -room)]))
            right.append(most - np.minimum(at + slopes @ (x - place), most))
    low = np.maximum(-radius, -x)
    high = np.minimum(radius, 1.0 - x)
    result = linprog(
        np.append(np.zeros_like(x), 1.0),
        A_ub=np.vstack(planes),
        b_ub=np.concatenate(right),
        bounds=[*zip(low, high, strict=True), (None, 0.0)],
    )
    if result.x is None:
        return np.zeros_like(x), 0.0
    return result.x[:-1], -result.x[-1]
