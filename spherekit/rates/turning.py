"""How pole axes turn: derivatives of their directions by the input."""

import numpy as np

from spherekit.planning.poles import CoaxialPole, Plan, Pole, PrimaryPole
from spherekit.sphere.rotation import Floats

TURN_KNOWN = 1e-6
"""Relative error to which the derivative of an axis is known where it is given."""


def axis_pairs(plan: Plan) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair, and those."""
    return {
        step.pole: step.pair
        for step in plan.steps
        if isinstance(step, PrimaryPole | CoaxialPole)
    }


def carrier(plan: Plan, pole: Pole) -> int | None:
    """Return the link that carries a pole's axis, None if none does."""
    body_pole = plan.pole(*pole)
    pair = None if body_pole is None else axis_pairs(plan).get(body_pole)
    if pair is None or not plan.mechanism.pairs[pair].kind.has_axis:
        return None
    return plan.mechanism.ends[pair][0]


def carried_turn(unit: Floats, w: Floats) -> Floats:
    """Return (n, 3) the derivative of an axis (n, 3) that a link at w (n, 3) carries."""
    return np.cross(w, unit)


def turn_along(
    unit: Floats,
    dv: Floats,
    coefficients: tuple[Floats, Floats],
    errors: tuple[Floats, Floats],
) -> Floats:
    """Return (n, 3) the derivative of a direction (n, 3), from v = r u.

    `dv` (n, 3) is the derivative of v, `coefficients` (n,) are r and its derivative, with
    the bounds of their `errors`. NaN where r is too small to know it to `TURN_KNOWN`.
    """
    rate, change = coefficients
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.asarray((dv - change[:, None] * unit) / rate[:, None])
        size = np.maximum(1.0, np.sqrt(np.sum(turns * turns, axis=1)))
        sure = size * errors[0] + errors[1] < TURN_KNOWN * size * np.abs(rate)
    turns[~sure] = np.nan
    return turns
