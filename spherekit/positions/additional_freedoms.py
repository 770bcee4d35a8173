"""Recognises configurations from which a mechanism can move in more than one way at once.

A mechanism with one degree of freedom can have configurations with several degrees of
freedom, and keep these while it moves. An example is a sheet of paper whose straight
creases are folded by 180 deg: the zigzag creases then turn independently of each other.
Such configurations form surfaces, or sets of more dimensions, and not curves. In such a
configuration some links can move although the input is locked. These configurations are
therefore no assembly modes of the motion.
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
    """Return whether a mechanism can move in several independent ways at a configuration.

    Velocity equations cannot decide this, because they allow several motions in two cases:
    the configurations form a surface, or two curves of configurations cross. The mechanism
    is therefore moved by small finite steps in several directions that these equations
    allow, and its loops are closed again. On a surface this succeeds after every step. At a
    crossing it fails after a step in a direction between the curves. The caller only counts
    configurations on a surface, because no single curve passes through them.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    values
        (variables,) a closed configuration (rad).

    Returns
    -------
    Whether the mechanism has several degrees of freedom at the configuration, and at all
    tried configurations around it.
    """
    motions = _find_first_order_motions(closure.linearise(values[None]).jacobian[0])
    if len(motions) < 2:
        return False
    starts = values + TRIED_STEP_RAD * _choose_directions(motions)
    # All over a surface, the closure Jacobian has the same rank as here. Newton's method
    # uses this rank.
    rank = len(values) - len(motions)
    points = _close_loops(closure, starts, rank)
    is_closed = closure.linearise(points).closure_residual < CLOSURE_TOLERANCE
    # Newton's method may have led back to the first configuration. Such an end point does
    # not count.
    has_moved = np.linalg.norm(points - values, axis=1) > 0.5 * TRIED_STEP_RAD
    return bool(np.all(is_closed & has_moved))


def _find_first_order_motions(jacobian: Floats) -> Floats:
    """Return the motions that the velocity equations of a mechanism allow.

    Parameters
    ----------
    jacobian
        (equations, variables) closure Jacobian J.

    Returns
    -------
    (m, variables) orthonormal rates of the variables: a basis of the null space of J.
    """
    _, singular_values, right_vectors = np.linalg.svd(jacobian)
    rank = int(np.sum(singular_values > NULL_RATIO * singular_values[0]))
    return right_vectors[rank:]


def _choose_directions(motions: Floats) -> Floats:
    """Return random directions (`TRIED_DIRECTIONS`, variables) of possible motions.

    `motions` (m, variables) are independent motions that the velocity equations allow, as
    rates of the pair variables. Each direction is a unit vector and a random combination of
    these motions.
    """
    random = np.random.default_rng(DIRECTION_SEED)
    directions = random.normal(size=(TRIED_DIRECTIONS, len(motions))) @ motions
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def _close_loops(closure: Closure, points: Floats, rank: int) -> Floats:
    """Close the loops of nearly closed configurations by Newton's method, if possible.

    The mechanism may have several degrees of freedom. Its closed configurations are then a
    surface in the space of all variables. The rank r of the closure Jacobian on this
    surface is the number of variables minus the degrees of freedom. Each step is computed
    with the r largest singular values only (truncated singular value decomposition). The
    smaller singular values are about zero, so a division by them would lead far away.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    points
        (n, variables) nearly closed configurations (rad).
    rank
        The rank r.

    Returns
    -------
    (n, variables) configurations (rad) after the last step, closed or not.
    """
    for _ in range(MAX_CLOSING_STEPS):
        linearisation = closure.linearise(points)
        left_vectors, singular_values, right_vectors = np.linalg.svd(
            linearisation.jacobian, full_matrices=False
        )
        # Each vector is in a row of these arrays: (n, r, equations) and (n, r, variables).
        left_vectors = np.swapaxes(left_vectors, 1, 2)[:, :rank]
        right_vectors = right_vectors[:, :rank]
        # J = U S V^T, so the step -V S^-1 U^T residual closes the loops to first order.
        components = np.vecdot(left_vectors, linearisation.residual[:, None])
        components /= singular_values[:, :rank]
        steps = -np.matvec(np.swapaxes(right_vectors, 1, 2), components)
        points = points + steps
        if np.all(max_abs(steps, axis=1) < CLOSURE_TOLERANCE):
            break
    return points
