"""Poles of a motion in which one input moves, in rows."""

from collections.abc import MutableMapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.numeric.rows import ArrayRows
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


@final
@dataclass(frozen=True, kw_only=True)
class PoleField(ArrayRows):
    """Requested poles of a motion in which one input moves; rows as in the motion.

    NaN where the motion failed. Derivatives are by that input, the others held.

    `direction[pole]` (n, 3) unit vector in ground axes, continuous along each assembly
    mode and at its first sample on the side of the mechanism's axes (of a pair: its
    axis); `rate[pole]` (n,): rate * direction is the angular velocity of the pole's
    second link relative to its first per unit rate of the input;
    `acceleration_coefficient[pole]` (n,) its derivative by the input (1/rad);
    `angle[pole]` (n,) how far the angular velocities of its links are from cancelling:
    |w_j - w_i| over |w_i| + |w_j|, 1 for the axes of pairs. `error[pole]` (n,) bound of
    the direction's error (rad), `velocity_coefficient_error[pole]` and
    `acceleration_coefficient_error[pole]` (n,) those of the two coefficients: of
    rounding, and of what the configuration is off by. `planes[pole]` (n, 2, 3) unit
    normals of those planes, for the poles asked for. `w[link]`, `dw[link]` (n, 3):
    rates of links relative to the ground, per unit rate of the input, and their
    derivatives. `direction_dq[pole]` (n, 3) is how directions turn, of the poles of
    which a kernel says it. `loss` (n,): the part of the largest of them, or of 1, that
    may be wrong. `status` (n,): the motion's, with AT_SINGULARITY where the rates are
    not finite. `pole_status[pole]` (n,): the same, with NO_POLE or ILL_CONDITIONED
    where only this pole cannot be given. `by_equations` (n,): samples solved from the
    velocity equations instead; `by_kernel` (n,): rows that a kernel vouches for.
    """

    direction: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    angle: MutableMapping[Pole, Floats] = field(default_factory=dict)
    error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient_error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient_error: MutableMapping[Pole, Floats] = field(
        default_factory=dict
    )
    planes: MutableMapping[Pole, Floats] = field(default_factory=dict)
    w: MutableMapping[int, Floats] = field(default_factory=dict)
    dw: MutableMapping[int, Floats] = field(default_factory=dict)
    status: NDArray[np.int8]
    pole_status: MutableMapping[Pole, NDArray[np.int8]] = field(default_factory=dict)
    by_equations: NDArray[np.bool_]
    by_kernel: NDArray[np.bool_]
    loss: Floats
    direction_dq: MutableMapping[Pole, Floats] = field(default_factory=dict)

    @property
    def made(self) -> "PoleField":
        """All of it, as arrays: itself."""
        return self

    def turned(self, plan: Plan, pole: Pole) -> Floats:
        """Return (n, 3) how the direction of a pole of links turns by the input, 1/rad.

        From w_j - w_i = r u and its derivative, so NaN where r is too small to know it; of
        the axis of a pair, which its links carry, u' = w x u also where these stand still
        relative to each other.
        """
        if pole in self.direction_dq:
            return self.direction_dq[pole]
        i, j = pole
        unit, link = self.direction[pole], carrier(plan, pole)
        if link is not None and link in self.w:
            return carried_turn(unit, self.w[link])
        return turn_along(
            unit,
            self.dw[j] - self.dw[i],
            (self.velocity_coefficient[pole], self.acceleration_coefficient[pole]),
            (
                self.velocity_coefficient_error[pole],
                self.acceleration_coefficient_error[pole],
            ),
        )
