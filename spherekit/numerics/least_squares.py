"""Minimisation of sums of squares from many starts side by side."""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats, Indices

Residuals = Callable[[Floats, Indices], tuple[Floats, Floats]]
"""Takes values (k, variables) and the indices (k,) of the starts to which they belong.

Returns the residuals (k, m) and their derivatives (k, m, variables).
"""

MAX_LEAST_SQUARES_STEPS = 60
"""Largest number of steps per start. Smaller: slow starts end before they reach a
minimum."""

FIRST_DAMPING = 0.1
"""Damping of the first step. Larger: shorter first steps, closer to steepest descent."""

DAMPING_DECREASE = 0.2
"""Factor of the damping after a step that reduced the sum of squares."""

DAMPING_INCREASE = 5.0
"""Factor of the damping after a step that would not reduce the sum, and is not taken."""

MIN_DAMPING = 1e-12
"""Smallest damping, which keeps the equations of a step regular."""

MAX_DAMPING = 1e9
"""Damping at which a start is given up, because no step reduces its sum any more."""

MIN_STEP = 1e-15
"""A descent ends after a step in which no variable changes by more than this."""


def minimize_squares(
    residuals: Residuals,
    start: Floats,
    low: Floats | float = -np.inf,
    high: Floats | float = np.inf,
    sufficient_root: float = 0.0,
    longest_step: float = np.inf,
) -> tuple[Floats, Floats]:
    """Minimise sums of squared residuals by the Levenberg-Marquardt method.

    The variables are found from several independent starts, evaluated together. Each start
    has its own damping (weight of short steps).

    Parameters
    ----------
    residuals
        The residuals and their derivatives.
    start
        (n, variables) values, within the limits, from which the n descents start.
    low, high
        (variables,) limits of the variables.
    sufficient_root
        A descent ends when the root of its sum of squares is smaller than this.
    longest_step
        Largest change of a variable in one step.

    Returns
    -------
    values
        (n, variables) values at the end of each descent.
    squares
        (n,) sums of squared residuals at these values.
    """
    count, variables = start.shape
    values = start.copy()
    active = np.arange(count)
    damping = np.full(count, FIRST_DAMPING)
    # The residuals and their derivatives are stored for the active starts only.
    residual, jacobian = residuals(values, active)
    squares = np.sum(residual**2, axis=1)
    for _ in range(MAX_LEAST_SQUARES_STEPS):
        active_values = values[active]
        transposed = np.swapaxes(jacobian, 1, 2)
        descent_direction = -(transposed @ residual[..., None])
        normal_matrix = transposed @ jacobian
        # A variable at its limit that would leave it is fixed: its equation becomes
        # damping * change = 0.
        is_fixed = (active_values <= low) & (descent_direction[..., 0] < 0.0)
        is_fixed |= (active_values >= high) & (descent_direction[..., 0] > 0.0)
        normal_matrix[is_fixed] = 0.0
        descent_direction[is_fixed] = 0.0
        normal_matrix += damping[active, None, None] * np.eye(variables)
        change = np.linalg.solve(normal_matrix, descent_direction)[..., 0]
        step_size = np.max(np.abs(change), axis=1, initial=0.0)
        change *= np.minimum(1.0, longest_step / np.maximum(step_size, MIN_STEP))[:, None]
        new_values = np.clip(active_values + change, low, high)

        new_residual, new_jacobian = residuals(new_values, active)
        new_squares = np.sum(new_residual**2, axis=1)
        is_better = new_squares < squares[active]
        values[active[is_better]] = new_values[is_better]
        squares[active[is_better]] = new_squares[is_better]
        residual[is_better] = new_residual[is_better]
        jacobian[is_better] = new_jacobian[is_better]
        damping_factor = np.where(is_better, DAMPING_DECREASE, DAMPING_INCREASE)
        damping[active] = np.maximum(damping[active] * damping_factor, MIN_DAMPING)

        is_unfinished = squares[active] >= sufficient_root**2
        is_unfinished &= damping[active] < MAX_DAMPING
        is_unfinished &= step_size > MIN_STEP
        active = active[is_unfinished]
        residual = residual[is_unfinished]
        jacobian = jacobian[is_unfinished]
        if not len(active):
            break
    return values, squares
