"""The least of the greatest of several functions that have kinks, within bounds."""

from collections.abc import Callable

import numpy as np

from spherekit.sphere.rotation import Floats

Parts = tuple[Floats, Floats, Floats, Floats]
"""Values (k,), gradients (k, n), limits' values (m,) and gradients (m, n) at a place."""

FIRST, LONGEST, SHORTEST = 0.05, 0.25, 1e-9
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
    now = float(np.max(begun[0]))
    allowed = np.maximum(begun[2], 0.0)
    places, made, radius = [x], [begun], FIRST
    for _ in range(MOST_STEPS):
        step, promised = _step(places, made, x, now, allowed, radius)
        if promised < enough and radius <= FIRST * 1e-2:
            break
        tried = np.clip(x + step, 0.0, 1.0)
        there = parts(tried) if promised > 0.0 else None
        if there is not None:
            places.append(tried)
            made.append(there)
            value = float(np.max(there[0]))
            if now - value >= SERIOUS * promised and np.all(there[2] <= allowed):
                x, now, radius = tried, value, min(2.0 * radius, LONGEST)
                continue
        radius *= 0.5
        if radius < SHORTEST:
            break
        near = [
            k
            for k, place in enumerate(places)
            if np.max(np.abs(place - x)) <= NEAR * radius
        ][-KEPT:]
        places, made = [places[k] for k in near], [made[k] for k in near]
    return x, now


def _step(
    places: list[Floats],
    made: list[Parts],
    x: Floats,
    now: float,
    allowed: Floats,
    radius: float,
) -> tuple[Floats, float]:
    """Return the step (n,) that planes promise most of, and how much."""
    from scipy.optimize import linprog

    n = len(x)
    planes, right = [], []
    for place, (values, gradients, limits, slopes) in zip(places, made, strict=True):
        away = x - place
        at_x = np.minimum(values + gradients @ away, now)
        planes.append(np.column_stack([gradients, -np.ones(len(values))]))
        right.append(now - at_x)
        # A limit that bends is met with room, as much as the step promises.
        at_x = np.minimum(limits + slopes @ away, allowed)
        planes.append(np.column_stack([slopes, -np.full(len(limits), ROOM)]))
        right.append(allowed - at_x)
    low, high = np.maximum(-radius, -x), np.minimum(radius, 1.0 - x)
    bounds = [*zip(low, high, strict=True), (None, 0.0)]
    result = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.vstack(planes),
        b_ub=np.concatenate(right),
        bounds=bounds,
        method="highs",
    )
    if result.x is None:
        return np.zeros(n), 0.0
    return result.x[:n], float(-result.x[n])
