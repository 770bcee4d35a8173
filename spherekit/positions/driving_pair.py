"""Chooses the pair to drive when all configuration curves of a mechanism are searched.

The configuration curves do not depend on which pair is driven, but the groups do. Driven at
one pair a six-bar consists of two dyads, and at another pair of a triad, for which the
inputs where modes meet take longer to compute.
"""

from contextlib import suppress

import numpy as np

from spherekit.errors import PlanError
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.mode_coalescence import make_mode_coalescence
from spherekit.positions.position_solver import PositionSolver

ACCEPTABLE_COST_S = 2e-3
"""Time of one value of the functions whose zeros are the meetings of modes.

If the given pair takes less, no other is tried. Larger: slower pairs are accepted.
Smaller: all pairs are tried more often.
"""


def choose_driving_pair(solver: PositionSolver) -> PositionSolver:
    """Return a solver of the same mechanism with the driving pair that costs least.

    The mechanism is driven at one pair. Assembly modes meet at certain values of this
    input, where a function of the input changes its sign. The cost is the time of one value
    of this function. The given solver is returned if its cost is acceptable, if the
    functions are unknown for every driving pair, or if a group (a set of bodies that are
    placed together) has contacts or redundant constraints.
    """
    if any(not group.revolute or group.redundant for group in solver.assembly.groups):
        return solver
    solvers = [solver]
    costs = [_estimate_cost(solver)]
    if costs[0] < ACCEPTABLE_COST_S:
        return solver
    for pair in solver.mechanism.pairs:
        mechanism = solver.mechanism.with_inputs(pair.name)
        # A pair at which the mechanism cannot be driven is passed over.
        with suppress(PlanError):
            solvers.append(PositionSolver(mechanism, plan_assembly(mechanism)))
            costs.append(_estimate_cost(solvers[-1]))
    if np.min(costs) < np.inf:
        return solvers[np.argmin(costs)]
    # All known functions exceed the acceptable cost. They are better than none.
    for candidate in solvers:
        if make_mode_coalescence(candidate):
            return candidate
    return solver


def _estimate_cost(solver: PositionSolver) -> float:
    """Return the time (s) of one value of the functions, infinite if it is too costly."""
    meetings = make_mode_coalescence(solver, ACCEPTABLE_COST_S)
    return np.inf if meetings is None else meetings.cost
