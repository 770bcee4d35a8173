"""Which pair of a mechanism to take for the input when all its curves are wanted.

The configuration curves are the same whichever pair is driven; how the groups fall out
is not. Driven at one pair a six-bar is two dyads, at another a triad.
"""

import numpy as np

from spherekit.errors import PlanError
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.complex_modes import meetings_of
from spherekit.planning.assembly import plan_assembly

CHEAP = 2e-3
"""A pair whose functions of meeting modes take less than this (s) is good enough."""


def easiest_drive(solver: Solver) -> Solver:
    """Return a mechanism driven where the inputs at which modes meet are found easily.

    It is the given one where they are found easily too, or at no other pair.
    """
    if any(not group.revolute or group.redundant for group in solver.assembly.groups):
        return solver
    as_driven = meetings_of(solver, CHEAP)
    if as_driven is not None and as_driven.cost < CHEAP:
        return solver
    others = []
    for pair in solver.mechanism.pairs:
        mechanism = solver.mechanism.with_inputs(pair.name)
        try:
            others.append(Solver(mechanism, plan_assembly(mechanism)))
        except PlanError:
            continue
    costs = [np.inf if as_driven is None else as_driven.cost]
    for other in others:
        meetings = meetings_of(other, CHEAP)
        costs.append(np.inf if meetings is None else meetings.cost)
    if np.min(costs) < np.inf:
        return (solver, *others)[int(np.argmin(costs))]
    return next((way for way in (solver, *others) if meetings_of(way)), solver)
