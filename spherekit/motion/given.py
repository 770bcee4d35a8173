"""Given configurations as a motion."""

import numpy as np

from spherekit.conventions import Status
from spherekit.motion.branches import Solver
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats


def motion_of(solver: Solver, values: Floats) -> Motion:
    """Return closed configurations (n, V) as a motion of one nameless branch.

    Singular ones are rows like others: their status is OK.
    """
    n = len(values)
    placed, states = solver.closure.place(values)
    gap = np.abs(solver.closure.residual(placed, states))
    return Motion(
        mechanism=solver.mechanism,
        joints=solver.joints,
        assembly=solver.assembly,
        branches=(),
        samples=n,
        sample=np.arange(n),
        branch=np.zeros(n, dtype=np.int64),
        inputs=values[:, list(solver.driven)],
        values=values,
        rotations=placed,
        status=np.full(n, Status.OK, dtype=np.int8),
        residual=np.max(gap, axis=1, initial=0.0),
        is_path=False,
    )
