"""Chooses the pair to drive when all configuration curves of a mechanism are searched.

The configuration curves do not depend on which pair is driven, but the groups do. For
example, the groups of a six-bar are two dyads if one pair is driven, and a triad if another
pair is driven. The inputs at which modes meet take longer to compute for a triad.
"""

from contextlib import suppress

import numpy as np

from spherekit.errors import PlanError
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.mode_coalescence import make_mode_coalescence
from spherekit.positions.position_solver import PositionSolver

ACCEPTABLE_COST_S = 2e-3
"""Acceptable time of one value of the functions whose zeros are the meetings of modes.

If the given pair takes less, no other is tried. Larger: slower pairs are accepted.
Smaller: all pairs are tried more often.
"""


def choose_driving_pair(solver: PositionSolver) -> PositionSolver:
    """Return a solver of the same mechanism, with a driving pair of low cost.

    The solver serves to search all curves of configurations. These curves do not depend on
    the driving pair, so any pair may be chosen.

    The search needs the inputs at which assembly modes meet. Each group (bodies that are
    placed together) has a function of the input that is zero at these inputs: the product
    of the determinants of its equations over all modes. `make_mode_coalescence` returns
    these functions, or None for a driving pair for which they are not known. The cost of a
    pair is the time of one value of the functions. Above `ACCEPTABLE_COST_S` it counts as
    infinite, as if they were not known.

    The cheapest pair is chosen. If all costs are infinite, it is the first pair for which
    the functions are known. In three cases the given solver is returned instead:

    - its cost is below `ACCEPTABLE_COST_S`,
    - the functions are not known for any driving pair,
    - a group has contacts or redundant constraints.
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
    # All costs are infinite. Functions that take too long are better than none.
    for candidate in solvers:
        has_functions = make_mode_coalescence(candidate) is not None
        if has_functions:
            return candidate
    return solver


def _estimate_cost(solver: PositionSolver) -> float:
    """Return the time (s) of one value of the functions whose zeros are meetings of modes.

    It is infinite if the functions are not known, or take more than `ACCEPTABLE_COST_S`.
    """
    coalescence = make_mode_coalescence(solver, ACCEPTABLE_COST_S)
    return np.inf if coalescence is None else coalescence.cost
