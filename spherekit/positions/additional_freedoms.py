"""Recognises configurations from which a mechanism can move in more than one way at once.

A mechanism with one degree of freedom can have configurations in which it has several, and
keeps them while it moves. An example is a sheet of paper whose straight creases are folded
by 180 deg: the zigzag creases then turn independently of each other. Such configurations
form surfaces, or sets of more dimensions, and not curves. In such a configuration some
links can move although the input is locked. These configurations are therefore no assembly
modes of the motion.
"""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs
from spherekit.positions.loop_closure import Closure
from spherekit.tolerances import CLOSURE_TOLERANCE

NULL_RATIO = 1e-5
"""Singular values of the closure Jacobian below this part of the largest count as zero.

Larger: configurations near a crossing of curves are tried as points of a surface. Smaller:
rounding errors hide additional freedoms.
"""
TRIED_STEP_RAD = 0.01
"""Length of the steps in which a configuration is moved.

If two curves cross at the configuration, the loops cannot be closed after a step in a
direction between the curves. They stay open by about the square of the step. Larger: steps
may leave a small surface. Smaller: curves that touch each other in higher order count as a
surface.
"""
TRIED_DIRECTIONS = 8
"""Number of directions in which a configuration is moved. Larger: slower and safer."""
DIRECTION_SEED = 20240616
"""Seed of the directions, which are the same in every run."""
MAX_CLOSING_STEPS = 12
"""Largest number of Newton steps that close the loops after a step."""


def has_additional_freedoms(closure: Closure, values: Floats) -> bool:
    """Return whether a configuration belongs to a surface of configurations.

    The closure Jacobian J has the rank r. If J has this rank in the whole neighbourhood,
    the configurations form a surface (manifold). Its dimension is the number of independent
    motions that J allows. Otherwise several sets of configurations meet. To decide, the
    configuration is moved in several directions, and the loops are closed by Newton's
    method with the r largest singular values of J. They can be closed in this way only on a
    manifold.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    values
        (variables,) a closed configuration (rad).

    Returns
    -------
    Whether the mechanism has several degrees of freedom at the configuration, and at all
    tried configurations around it. It is false at a crossing of curves, where the mechanism
    has several degrees of freedom only to first order.
    """
    _, singular_values, right_vectors = np.linalg.svd(
        closure.linearise(values[None]).jacobian[0]
    )
    rank = int(np.sum(singular_values > NULL_RATIO * singular_values[0]))
    motions = right_vectors[rank:]
    if len(motions) < 2:
        return False
    random = np.random.default_rng(DIRECTION_SEED)
    directions = random.normal(size=(TRIED_DIRECTIONS, len(motions))) @ motions
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = values + TRIED_STEP_RAD * directions
    for _ in range(MAX_CLOSING_STEPS):
        linearisation = closure.linearise(points)
        left, sizes, right = np.linalg.svd(linearisation.jacobian, full_matrices=False)
        # The other singular values are zero on the manifold, and nearly so beside it. A
        # division by them would lead far away.
        left = np.swapaxes(left, 1, 2)[:, :rank]
        parts = np.vecdot(left, linearisation.residual[:, None]) / sizes[:, :rank]
        steps = -np.matvec(np.swapaxes(right, 1, 2)[:, :, :rank], parts)
        points = points + steps
        if np.all(max_abs(steps, axis=1) < CLOSURE_TOLERANCE):
            break
    linearisation = closure.linearise(points)
    is_closed = linearisation.closure_residual < CLOSURE_TOLERANCE
    # A step across a manifold would be undone by Newton's method.
    has_moved = np.linalg.norm(points - values, axis=1) > 0.5 * TRIED_STEP_RAD
    return bool(np.all(is_closed & has_moved))
