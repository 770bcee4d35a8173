"""Enclosures of pole axes and velocity coefficients of certified modes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np

from spherekit.proof.balls import (
    Ball,
    complex_ball,
    exact,
    lower,
    matrix,
    solved,
)
from spherekit.proof.equations import Equations
from spherekit.proof.modes import CertifiedModes


@final
@dataclass(frozen=True)
class CertifiedPole:
    """The pole of link `first` relative to `second`, while one input moves at unit rate.

    `direction` are three balls in ground axes, `coefficient` a ball, not negative: the
    angular velocity is the coefficient times the direction. Where it may vanish,
    `direction` is None.
    """

    mode: int
    driven: int
    first: int
    second: int
    direction: tuple[Ball, Ball, Ball] | None
    coefficient: Ball


def certified_poles(modes: CertifiedModes) -> list[CertifiedPole]:
    """Return the poles of all pairs of links in all certified real modes.

    With several inputs each moves in turn, the others locked.
    """
    with modes.sharp() as (equations, places):
        return [
            pole
            for number, place in enumerate(places)
            for pole in enclosed_poles(equations, place, number)
        ]


def enclosed_poles(
    equations: Equations, places: Sequence[Ball], mode: int = 0
) -> Iterator[CertifiedPole]:
    """Yield the poles of all pairs of links at narrow balls of all variables."""
    made = equations.construction
    for column in range(made.unknowns, made.unknowns + made.inputs):
        turning = _angular_velocities(equations, places, column)
        yield from _poles(mode, made.pairs[column], turning)


def _angular_velocities(
    equations: Equations, places: Sequence[Ball], driven: int
) -> list[list[Ball]]:
    """Return the angular velocities of all links relative to the root, in ground axes."""
    _, slopes = equations.arrays(places)
    count, bodies = equations.unknowns, equations.written.structure.bodies
    inputs = [float(v + count == driven) for v in range(equations.construction.inputs)]
    following = [row[driven - count] for row in equations.written.ratios()]
    rates = [complex_ball(rate) for rate in (*map(exact, inputs), *following)]
    if count:
        right = -(slopes[:, count:] @ np.array(rates))
        unknown = solved(matrix(slopes[:, :count]), matrix(right[:, None])).entries()
        rates = [*unknown, *rates]
    placed = equations.orientations(places, 1)
    velocities = np.full((bodies, 3), complex_ball(0j), dtype=object)
    for link, jet in placed.items():
        parts = [jet[(v,)] * rate for v, rate in enumerate(rates) if (v,) in jet]
        if parts and link < bodies:
            spin = sum(parts[1:], parts[0]) * jet[()].transpose()
            velocities[link] = spin[2, 1], spin[0, 2], spin[1, 0]
    if equations.construction.root != 0:
        velocities = velocities @ np.array(placed[0][()].tolist())
    return [[entry.real for entry in velocity] for velocity in velocities]


def _poles(
    mode: int, driven: int, turning: Sequence[Sequence[Ball]]
) -> Iterator[CertifiedPole]:
    for second, first in combinations(range(len(turning)), 2):
        pairs = zip(turning[first], turning[second], strict=True)
        x, y, z = (a - b for a, b in pairs)
        size = (x * x + y * y + z * z).sqrt()
        turns = lower(size) > 0.0
        direction = (x / size, y / size, z / size) if turns else None
        yield CertifiedPole(mode, driven, first, second, direction, size)
