"""The guides of assembly modes through closed configurations, several side by side."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.follow import ModeCurve, follow_each
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.mode_over_grid import ModeOverGrid, spread_each
from spherekit.motion.steps import walk
from spherekit.sphere.rotation import Floats

NEAREST = 8
"""Samples nearest to a configuration that straight ways are tried to."""


@final
@dataclass(frozen=True)
class Guided:
    """A closed configuration (variables,) with what guides its mode.

    `freedoms` is the mobility by rank there, None where no constraint is redundant;
    `guide` is None where the mode is out of range or has another number of freedoms than
    there are inputs. `tried` counts the steps tried along a curve.
    """

    values: Floats
    freedoms: int | None = None
    guide: ModeCurve | ModeOverGrid | None = None
    tried: int = 0


def guided(solver: Solver, input_grid: InputGrid, values: Floats) -> list[Guided]:
    """Return the guides through nearly closed configurations (n, variables)."""
    driven = list(solver.driven)
    values = solver.closure.solve(values, driven).values
    if not any(group.redundant for group in solver.assembly.groups):
        return _guides(solver, input_grid, values, [None] * len(values))
    freedoms = [solver.freedoms(one) for one in values]
    moving = np.array([number == len(driven) for number in freedoms], dtype=bool)
    there = iter(
        _guides(solver, input_grid, values[moving], [len(driven)] * int(np.sum(moving)))
    )
    return [
        next(there) if moves else Guided(one, number)
        for one, number, moves in zip(values, freedoms, moving, strict=True)
    ]


def _guides(
    solver: Solver, input_grid: InputGrid, values: Floats, freedoms: list[int | None]
) -> list[Guided]:
    driven = list(solver.driven)
    if len(driven) == 1:
        low, high = input_grid.range
        curves = follow_each(solver.closure, driven[0], values, low, high)
        inside = [c.inputs[0] <= high and c.inputs[-1] >= low for c in curves]
        return [
            Guided(one, number, curve if met else None, curve.tried)
            for one, number, curve, met in zip(
                values, freedoms, curves, inside, strict=True
            )
        ]
    made = [Guided(one, number) for one, number in zip(values, freedoms, strict=True)]
    starts = []
    for number, one in enumerate(values):
        near = input_grid.nearest(one[driven], NEAREST)
        start = np.repeat(one[None], len(near), axis=0)
        reached, status = walk(solver.closure, driven, start, input_grid.q[near])
        arrived = np.flatnonzero(status == Status.OK)
        if len(arrived):
            starts.append((number, int(near[arrived[0]]), reached[arrived[0]]))
    if starts:
        numbers, rows, there = zip(*starts, strict=True)
        sheets = spread_each(
            solver.closure, driven, input_grid, np.array(rows), np.array(there)
        )
        for number, sheet in zip(numbers, sheets, strict=True):
            made[number] = Guided(values[number], freedoms[number], sheet)
    return made
