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
    """Return a solver of the same mechanism, with a driving pair of low cost.

    The solver serves to search all curves of configurations. These curves do not depend on
    the driving pair, so any pair may be chosen.

    The search needs the inputs at which assembly modes meet. They are zeros of certain
    functions of the input, the mode coalescence. The cost of a driving pair is the time of
    one value of these functions. It is infinite if they are not known, or take more than
    `ACCEPTABLE_COST_S`.

    The given solver is returned if its cost is below `ACCEPTABLE_COST_S`, if the functions
    are unknown for every driving pair, or if a group (a set of bodies that are placed
    together) has contacts or redundant constraints. Otherwise the cheapest pair is chosen.
    """
    # `group.revolute` says that a group has R pairs only, so no contacts.
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
    # All costs are infinite. Functions that are known and take too long are better than
    # none.
    for candidate in solvers:
        if make_mode_coalescence(candidate):
            return candidate
    return solver


def _estimate_cost(solver: PositionSolver) -> float:
    """Return the time (s) of one value of the functions whose zeros are meetings of modes.

    It is infinite if the functions are not known, or take more than `ACCEPTABLE_COST_S`.
    """
    coalescence = make_mode_coalescence(solver, ACCEPTABLE_COST_S)
    return np.inf if coalescence is None else coalescence.cost
