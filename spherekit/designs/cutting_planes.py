"""Minimises the largest of several functions with kinks, within bounds and limits."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs

FIRST_TRUST_RADIUS = 0.05
"""First radius of the trust region, in units of the ranges of the variables."""

MAX_TRUST_RADIUS = 0.25
"""Largest radius of the trust region, in units of the ranges."""

MIN_TRUST_RADIUS = 1e-9
"""Radius of the trust region, in units of the ranges, below which a descent ends."""

SERIOUS_DECREASE = 0.1
"""A step is accepted if it decreases the maximum by this part of the predicted decrease."""

LIMIT_ALLOWANCE = 0.1
"""Distance from a limit, as a part of the predicted decrease, that a step must keep.

Without this distance, a step along a limit that bends would end beyond the limit.
"""

MAX_CUTTING_STEPS = 200
"""Largest number of trial steps of a descent."""

MAX_STORED_POINTS = 40
"""Largest number of points whose planes are used. The newest are kept."""

PLANE_REACH = 4.0
"""Planes of points are used up to this distance, in units of the trust radius."""


class LinearisedFunctions(NamedTuple):
    """Functions of an optimisation at one point, with their gradients.

    The optimisation minimises the largest objective, while no limit may be positive. It
    uses the linear approximation of these functions.

    Attributes
    ----------
    objectives
        (k,) functions whose maximum is minimised.
    objective_gradients
        (k, n) derivatives of the objectives with respect to the n variables.
    limits
        (m,) functions that must not be positive.
    limit_gradients
        (m, n) derivatives of the limits with respect to the n variables.
    """

    objectives: Floats
    objective_gradients: Floats
    limits: Floats
    limit_gradients: Floats


def minimize_largest(
    functions: Callable[[Floats], LinearisedFunctions | None],
    x: Floats,
    min_decrease: float,
) -> tuple[Floats, float]:
    """Minimise the largest of some functions over the unit cube.

    The cutting-plane method with a trust region is used (Schramm and Zowe 1992). Each
    function is linearised at all points that were tried. These linear functions (planes)
    predict how much a step decreases the maximum. A plane that is above its function,
    because the function is not convex, is moved down. The method ends where no step within
    a shrinking box around the point is predicted to decrease the maximum.

    Parameters
    ----------
    functions
        Function of a point (n,) that returns objectives, limits (which must not be
        positive) and their gradients. None where the functions are not defined.
    x
        (n,) first point. A limit that is violated at this point may remain violated by as
        much.
    min_decrease
        The method ends when the predicted decrease of the maximum in a small box is
        smaller.

    Returns
    -------
    x
        (n,) last point.
    largest
        The largest objective at the last point; infinite if the functions are not defined
        at the first point.
    """
    start = functions(x)
    if start is None:
        return x, np.inf
    largest = np.max(start.objectives)
    allowed_limits = np.maximum(start.limits, 0.0)
    points = [(x, start)]
    radius = FIRST_TRUST_RADIUS
    for _ in range(MAX_CUTTING_STEPS):
        step, predicted_decrease = _predict_step(points, x, largest, allowed_limits, radius)
        # In a large box, a step may look poor only because the functions bend. So the
        # descent ends at a small box only.
        if predicted_decrease < min_decrease and radius <= FIRST_TRUST_RADIUS * 1e-2:
            break
        # A step that decreases the maximum enough is accepted and widens the box. Any other
        # step narrows the box, and its planes improve the prediction.
        trial_point = np.clip(x + step, 0.0, 1.0)
        trial = functions(trial_point) if predicted_decrease > 0.0 else None
        if trial is not None:
            points.append((trial_point, trial))
            trial_largest = np.max(trial.objectives)
            decreases = largest - trial_largest >= SERIOUS_DECREASE * predicted_decrease
            if decreases and np.all(trial.limits <= allowed_limits):
                x = trial_point
                largest = trial_largest
                radius = min(2.0 * radius, MAX_TRUST_RADIUS)
                continue
        radius *= 0.5
        if radius < MIN_TRUST_RADIUS:
            break
        reach = PLANE_REACH * radius
        near_points = [item for item in points if max_abs(item[0] - x) <= reach]
        points = near_points[-MAX_STORED_POINTS:]
    return x, largest


def _predict_step(
    points: Sequence[tuple[Floats, LinearisedFunctions]],
    x: Floats,
    largest: float,
    allowed_limits: Floats,
    radius: float,
) -> tuple[Floats, float]:
    """Return the step of largest predicted decrease, by a linear program.

    The linear program minimises d, the change of the largest objective, by the choice of
    the step s. Each objective f with the gradient g at a point p that was tried gives the
    inequality f + g (x + s - p) <= largest + d. For a limit, d becomes ``LIMIT_ALLOWANCE *
    d``, and the largest objective becomes the value that the limit may have.

    Parameters
    ----------
    points
        Points (n,) that were tried, with the functions at each of them.
    x
        (n,) present point.
    largest
        The largest objective at the present point.
    allowed_limits
        (m,) values that the limits may have.
    radius
        Radius of the trust region.

    Returns
    -------
    step
        (n,) step, zero if the linear program has no solution.
    predicted_decrease
        The predicted decrease of the largest objective.
    """
    from scipy.optimize import linprog

    rows = []
    right_sides = []
    for point, functions in points:
        # Objectives decrease by the unknown decrease, limits by a part of it.
        for values, gradients, bounds, decrease_part in (
            (functions.objectives, functions.objective_gradients, largest, 1.0),
            (functions.limits, functions.limit_gradients, allowed_limits, LIMIT_ALLOWANCE),
        ):
            rows.append(np.column_stack([gradients, np.full(len(values), -decrease_part)]))
            # If a function is not convex, its plane may be above the bound at x. Such a
            # plane is moved down to the bound.
            values_at_x = values + gradients @ (x - point)
            right_sides.append(bounds - np.minimum(values_at_x, bounds))
    low = np.maximum(-radius, -x)
    high = np.minimum(radius, 1.0 - x)
    result = linprog(
        # The cost function is d itself.
        np.append(np.zeros_like(x), 1.0),
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(right_sides),
        bounds=[*zip(low, high, strict=True), (None, 0.0)],
    )
    if result.x is None:
        return np.zeros_like(x), 0.0
    return result.x[:-1], -result.x[-1]
