"""Enclosures of pole axes and velocity coefficients of certified modes."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from spherekit.arrays import Array
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exactly
from spherekit.proof.balls import Ball, lower, solved

EnclosedPole = tuple[tuple[int, int, int], Array | None, Ball]
"""The driven pair, the link that moves, and the link it is seen from; then three balls in
ground axes of the direction, None where it may have none, and one, not negative, of the
velocity coefficient. The angular velocity is this times the direction."""


def enclosed_poles(equations: Equations, places: Sequence[Ball]) -> Iterator[EnclosedPole]:
    """Yield the poles of all pairs of links at narrow balls of all variables.

    With several inputs each moves in turn, the others locked.
    """
    for column, pair in enumerate(equations.construction.driven):
        turning = _angular_velocities(equations, places, column)
        for second, first in combinations(range(len(turning)), 2):
            spin = turning[first] - turning[second]
            size = np.sqrt(spin @ spin)
            yield (pair, first, second), spin / size if lower(size) > 0.0 else None, size


def _angular_velocities(equations: Equations, places: Sequence[Ball], driven: int) -> Array:
    """Return the angular velocities of all links in ground axes, but for one vector.

    While the input of a number moves at unit rate.
    """
    _, slopes = equations.arrays(places)
    made, structure = equations.construction, equations.written.structure
    count, moved = made.unknowns, exactly(np.eye(made.inputs)[driven])
    rates = [*moved, *(row[driven] for row in equations.written.ratios())]
    if count:
        right = -(slopes[:, count:] @ rates)
        rates = [*solved(slopes[:, :count], right[:, None])[:, 0], *rates]
    placed = equations.orientations(places, 1)
    velocities = exactly(np.zeros((structure.bodies, 3)))
    for link, jet in placed.items():
        parts = [jet[(v,)] * rate for v, rate in enumerate(rates) if (v,) in jet]
        if parts and link < structure.bodies:
            spin = sum(parts) @ jet[()].T
            velocities[link] = spin[2, 1], spin[0, 2], spin[1, 0]
    return velocities @ placed[0][()]
