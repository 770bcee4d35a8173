"""Enclosures of pole axes and velocity coefficients of certified modes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

from spherekit.proof.balls import (
    Ball,
    BallMatrix,
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
    jets = equations.at(places, 1)
    zero = complex_ball(exact(0.0))

    def slope(row: int, column: int) -> Ball:
        jet = jets[row]
        return jet[(column,)].entries()[0] if (column,) in jet else zero

    count = equations.unknowns
    square = matrix(
        [[slope(row, column) for column in range(count)] for row in range(count)]
    )
    ratios = [ratio_row[driven - count] for ratio_row in equations.written.ratios()]
    following = {
        count + equations.construction.inputs + number: complex_ball(ratio)
        for number, ratio in enumerate(ratios)
    }
    given = {driven: complex_ball(exact(1.0)), **following}
    right = matrix(
        [
            [-sum((slope(row, column) * rate for column, rate in given.items()), zero)]
            for row in range(count)
        ]
    )
    rates = list(solved(square, right).entries()) if count else []
    by_variable = {**dict(enumerate(rates)), **given}
    placed = equations.orientations(places, 1)
    root = equations.construction.root
    ground: BallMatrix | None = placed[0][()].transpose() if root != 0 else None
    velocities = []
    for link in range(equations.written.structure.bodies):
        velocity = [zero, zero, zero]
        if link != root:
            jet = placed[link]
            moved = None
            for variable, rate in by_variable.items():
                if (variable,) in jet:
                    part = jet[(variable,)] * rate
                    moved = part if moved is None else moved + part
            if moved is not None:
                spin = moved * jet[()].transpose()
                velocity = [spin[2, 1], spin[0, 2], spin[1, 0]]
        if ground is not None:
            velocity = list(
                (ground * matrix([[component] for component in velocity])).entries()
            )
        velocities.append([component.real for component in velocity])
    return velocities


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
