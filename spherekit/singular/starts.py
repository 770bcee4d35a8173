"""Singular configurations that random closed configurations lead to: no proof of all."""

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.branches import Solver
from spherekit.motion.search import starting_range
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

CLOSING_STEPS = 40
"""Newton's steps that a random start may take to closed loops."""
LOCUS_STEPS = 30
"""The same from there to the locus."""


def closed_configurations(
    solver: Solver, ranges: Floats, count: int, random: np.random.Generator
) -> Floats:
    """Return the closed configurations (n, V) that random starts lead to.

    `ranges` (g, 2) rad are those of the inputs, which are spread over them and held.
    """
    low, high = starting_range(solver.closure)
    start = random.uniform(low, high, (count, len(low)))
    driven = list(solver.driven)
    start[:, driven] = random.uniform(*ranges.T, (count, len(driven)))
    found = solver.closure.solve(start, driven, iterations=CLOSING_STEPS)
    return found.values[found.residual < CLOSURE_TOLERANCE]


def seeds_from(locus: Locus, values: Floats) -> LocusPoints:
    """Return the points of a locus that configurations (n, V) lead to."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = locus.onto(values, LOCUS_STEPS)
    return found.rows(np.flatnonzero(found.good))
