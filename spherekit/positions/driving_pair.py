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
    """Return a solver with the driving pair for which meetings of modes are found fastest.

    The configuration curves of a mechanism do not depend on which pair is driven, so the
    pair of least cost is chosen. The search needs the inputs at which assembly modes meet:
    the zeros of functions of the input (`make_mode_coalescence`). The time of one value of
    these functions is the cost of a driving pair. For some pairs the functions are not
    known. A group consists of links that are placed together, such as a dyad (two links).

    Returns
    -------
    A solver of the same mechanism. The argument is returned if it is fast enough, if the
    functions are not known for any pair, or if a group has contacts or redundant
    constraints.
    """
    groups = solver.assembly.groups
    have_contacts = any(not group.revolute for group in groups)
    are_redundant = any(group.redundant for group in groups)
    if have_contacts or are_redundant:
        return solver
    given_cost = _estimate_cost(solver)
    if given_cost < ACCEPTABLE_COST_S:
        return solver

    other_solvers = _drive_each_pair(solver)
    candidates = [solver, *other_solvers]
    costs = [given_cost, *map(_estimate_cost, other_solvers)]
    if np.min(costs) < np.inf:
        return candidates[np.argmin(costs)]
    # All costs are infinite. Functions that take too long are better than none.
    for candidate in candidates:
        if make_mode_coalescence(candidate) is not None:
            return candidate
    return solver


def _drive_each_pair(solver: PositionSolver) -> list[PositionSolver]:
    """Return solvers of a mechanism, one for each pair at which it can be driven."""
    solvers = []
    for pair in solver.mechanism.pairs:
        mechanism = solver.mechanism.with_inputs(pair.name)
        # The plan fails for a pair at which the mechanism cannot be driven.
        with suppress(PlanError):
            solvers.append(PositionSolver(mechanism, plan_assembly(mechanism)))
    return solvers


def _estimate_cost(solver: PositionSolver) -> float:
    """Return the time (s) that tells how costly it is to find where assembly modes meet.

    Modes meet at the zeros of certain functions of the input. The result is the time to
    evaluate all these functions once. The time is infinite if the functions are not known,
    or if a group of three loops makes them slower than `ACCEPTABLE_COST_S`.
    """
    coalescence = make_mode_coalescence(solver, ACCEPTABLE_COST_S)
    return np.inf if coalescence is None else coalescence.cost
