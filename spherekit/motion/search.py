"""Searching the closed configurations of a group from random starts: no proof of all."""

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.model.geometry import Revolute
from spherekit.motion.closure import Closure
from spherekit.motion.distinct import MOST_MODES, Distinct
from spherekit.sphere.rotation import Floats

STARTS = 192
"""Random starts of one round; the search ends after two rounds without news."""
MOST_ROUNDS = 12


def search(closure: Closure, found: Distinct) -> None:
    """Add the configurations to `found` that random starts of a single sample lead to.

    The starts are the same ones every time.
    """
    random = np.random.default_rng(20240616)
    low, high = starting_range(closure)
    dry = 0
    for _ in range(MOST_ROUNDS):
        starts = random.uniform(low, high, (STARTS, len(low)))
        result = closure.solve(starts, iterations=40)
        known = len(found.values)
        found.add(result.values[result.residual < CLOSURE_TOLERANCE])
        dry = dry + 1 if len(found.values) == known else 0
        if dry == 2 or len(found.values) == MOST_MODES:
            break


def starting_range(closure: Closure) -> tuple[Floats, Floats]:
    """Return the limits (variables,) between which random starts are drawn."""
    low: list[float] = []
    high: list[float] = []
    for joint in closure.joints:
        if isinstance(joint, Revolute):
            low, high = [*low, -np.pi], [*high, np.pi]
        elif joint.rolling:
            half = 0.5 * max(joint.first.length, joint.second.length)
            low, high = [*low, -half], [*high, half]
        else:
            low, high = [*low, 0.0, 0.0], [*high, joint.first.length, joint.second.length]
    return np.array(low), np.array(high)
