"""Poles of a motion in which one input moves, in rows."""

from collections.abc import MutableMapping
from dataclasses import dataclass, field

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.pole_plan import Plan, Pole, PrimaryPole

TURN_KNOWN = 1e-6
"""Relative error to which the derivative of an axis is known where it is given."""

REPORTED_ERRORS = (
    "error",
    "velocity_coefficient_error",
    "acceleration_coefficient_error",
)
"""Error bounds of a `PoleField` whose largest values a run reports: those of the direction
(rad), of the velocity coefficient and of the acceleration coefficient (1/rad)."""

POLE_ERRORS = (*REPORTED_ERRORS, "direction_dq_error")
"""All error bounds of a pole. The last one is that of the derivative of the direction."""


def axis_pairs(plan: Plan) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair, and those."""
    return {step.pole: step.pair for step in plan.steps if isinstance(step, PrimaryPole)}


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
    derivatives. `direction_dq[pole]` (n, 3) is how directions
    turn by the input, 1/rad, and `direction_dq_error[pole]` (n,) a bound of its error.
    `loss` (n,): the part of the largest of them, or of 1, that may be wrong.
    `status` (n,): the motion's, with AT_SINGULARITY where the rates are
    not finite. `pole_status[pole]` (n,): the same, with NO_POLE or ILL_CONDITIONED
    where only this pole cannot be given. `by_equations` (n,): samples solved from the
    velocity equations instead; `by_kernel` (n,): rows that a kernel vouches for;
    `by_decimals` (n,): rows of the decimal sizes of the file, beside a dead centre.
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
    status: SmallIntegers
    pole_status: MutableMapping[Pole, SmallIntegers] = field(default_factory=dict)
    by_equations: Bools
    by_kernel: Bools
    by_decimals: Bools
    loss: Floats
    direction_dq: MutableMapping[Pole, Floats] = field(default_factory=dict)
    direction_dq_error: MutableMapping[Pole, Floats] = field(default_factory=dict)

    @property
    def made(self) -> "PoleField":
        """All of it, as arrays: itself."""
        return self
