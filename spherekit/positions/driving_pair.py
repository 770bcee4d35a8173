"""Which pair of a mechanism to drive when all its configuration curves are wanted.

The configuration curves are the same whichever pair is driven; how the groups fall out
is not. Driven at one pair a six-bar is two dyads, at another a triad.
"""

from contextlib import suppress

import numpy as np

from spherekit.errors import PlanError
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.input_turning_points import meetings_of
from spherekit.positions.position_solver import PositionSolver

CHEAP = 2e-3
"""A pair whose functions of meeting modes take less than this (s) is good enough."""


def easiest_drive(solver: PositionSolver) -> PositionSolver:
    """Return a mechanism driven where the inputs at which modes meet are found easily.

    It is the given one where they are found easily too, or at no other pair.
    """
    if any(not group.revolute or group.redundant for group in solver.assembly.groups):
        return solver

    def cost(way: PositionSolver) -> float:
        meetings = meetings_of(way, CHEAP)
        return np.inf if meetings is None else meetings.cost

    ways, costs = [solver], [cost(solver)]
    if costs[0] < CHEAP:
        return solver
    for pair in solver.mechanism.pairs:
        mechanism = solver.mechanism.with_inputs(pair.name)
        with suppress(PlanError):
            ways.append(PositionSolver(mechanism, plan_assembly(mechanism)))
            costs.append(cost(ways[-1]))
    if np.min(costs) < np.inf:
        return ways[np.argmin(costs)]
    return next((way for way in ways if meetings_of(way)), solver)
