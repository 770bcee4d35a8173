"""The poles of a motion in which one input moves, as arrays with one row per configuration.

Symbols: w are the angular velocities of links per unit rate of the moving input, and v is
the difference of w for the two links of a pole. The direction u of a pole is the axis of
the pair that joins its two links. Without such a pair it is the direction of v.
"""

from collections.abc import MutableMapping
from dataclasses import dataclass, field, replace
from math import nan
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.pole_plan import Plan, Pole, PrimaryPole

MAX_DIRECTION_DQ_ERROR = 1e-6
"""Largest error of the derivative of a direction, relative to its size or to 1.

A derivative with a larger error bound is NaN in a `PoleField`. Larger: more derivatives are
returned, with fewer correct digits.
"""


NeededPoles = Literal["directions", "rates", "planes", "turns"]
"""A set of poles in `Needs`."""

BASIC_NEEDS: tuple[NeededPoles, ...] = ("directions", "rates", "planes")
"""The sets of `Needs` for whose poles the direction is computed."""


@dataclass(frozen=True)
class PoleQuantity:
    """Declaration of a quantity of a pole, such as its direction.

    A pole is the axis of the relative rotation of two links.

    Attributes
    ----------
    name
        The attribute of `PoleField` that has the quantity. The same name is used in
        `Batch.of_poles`.
    components
        Number of components: 3 for a vector, 1 for a number.
    changes_sign
        Whether the quantity changes its sign if the direction of the pole is reversed.
    sufficient_needs
        Names of fields of `Needs`, such as "rates". Each field is a set of poles that an
        analysis needs. The quantity is computed for each pole that is in at least one of
        the named sets.
    is_derivative
        Whether the quantity is a derivative with respect to the input, for which `Needs`
        must have ``derivatives=True``.
    error
        "none" if there is no bound of the error of the quantity, "bounded" if there is
        a bound, and "reported" if a run also reports the largest bound of all rows.
    locked_value
        Value for two links that cannot move relative to each other while one input moves
        and the other inputs are locked: 0, which is exact, or NaN if the quantity is not
        defined.
    """

    name: str
    components: int
    changes_sign: bool
    sufficient_needs: tuple[NeededPoles, ...] = BASIC_NEEDS
    is_derivative: bool = False
    error: Literal["none", "bounded", "reported"] = "none"
    locked_value: float = nan

    @property
    def has_error_bound(self) -> bool:
        """Whether a `PoleField` has an error bound of this quantity."""
        return self.error != "none"

    @property
    def error_name(self) -> str:
        """The attribute of `PoleField` that has the error bound of this quantity."""
        return f"{self.name}_error"

    @property
    def error_column(self) -> str:
        """The name of the error bound of this quantity in tables and in `Batch`.

        A pole is the axis of relative rotation of two links. For its direction, the main
        quantity, the name is just "error_bound".
        """
        return "error_bound" if self.name == "direction" else f"{self.name}_error_bound"


POLE_QUANTITIES = (
    PoleQuantity("direction", 3, changes_sign=True, error="reported"),
    PoleQuantity(
        "direction_dq",
        3,
        changes_sign=True,
        sufficient_needs=("turns",),
        is_derivative=True,
        error="bounded",
    ),
    PoleQuantity(
        "velocity_coefficient",
        1,
        changes_sign=True,
        sufficient_needs=("rates",),
        error="reported",
        locked_value=0.0,
    ),
    PoleQuantity(
        "acceleration_coefficient",
        1,
        changes_sign=True,
        sufficient_needs=("rates",),
        is_derivative=True,
        error="reported",
        locked_value=0.0,
    ),
    PoleQuantity("conditioning", 1, changes_sign=False),
)
"""All quantities of a pole, the direction first.

A new quantity is an entry here, an attribute of `PoleField`, expressions in
`spherekit.velocities.input_columns` and a column in ``analyses/poles.py``. It is NaN in
rows that are not computed from these expressions, until the code for these rows computes
it too (`spherekit.velocities.decimal_rates` and `pole_evaluation`).
"""

REPORTED_ERRORS = tuple(
    quantity.error_name for quantity in POLE_QUANTITIES if quantity.error == "reported"
)
"""Error bounds of a `PoleField` whose largest values a run reports."""

POLE_ERRORS = REPORTED_ERRORS + tuple(
    quantity.error_name for quantity in POLE_QUANTITIES if quantity.error == "bounded"
)
"""All error bounds of a pole."""

SIGNED_COMPONENTS = {
    quantity.name: quantity.components
    for quantity in POLE_QUANTITIES
    if quantity.changes_sign
}
"""Number of components of each quantity of a pole that changes its sign with the
direction."""


def axis_pairs(plan: Plan) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair (joint).

    A pole is the axis about which one body rotates relative to another. By pole, the result
    has the indices of these pairs.
    """
    return {step.pole: step.pair for step in plan.steps if isinstance(step, PrimaryPole)}


@dataclass(frozen=True, kw_only=True)
class PoleField(ArrayRows):
    """Poles at the n rows of a motion in which one input moves while others are locked.

    Vectors are in ground axes. Rates are per unit rate of the moving input, and derivatives
    are with respect to this input. Failed rows are NaN. Mappings have the pole of two links
    (i, j), i < j, as their key, or the index of a link. Every bound contains the rounding
    errors and the error of the configuration.

    Attributes
    ----------
    direction
        (n, 3) unit vector u of each pole. It is continuous along each assembly mode. At the
        first sample of a mode, and at all samples of a grid of several inputs, it points to
        the side on which the sum of all axes and contact points lies. The pole of a pair is
        the axis of this pair, with its sign.
    velocity_coefficient
        (n,) for each pole the number k for which k u is the angular velocity of link j
        relative to link i.
    acceleration_coefficient
        (n,) derivative of the velocity coefficient (1/rad).
    conditioning
        (n,) for each pole |w_j - w_i| / (|w_i| + |w_j|). If this number is small, digits
        cancel in the difference, which gives the direction of the pole. If the pole is the
        axis of a pair, its direction does not come from a difference, and the number is 1.
    direction_error
        (n,) bound of the error of the direction (rad).
    velocity_coefficient_error, acceleration_coefficient_error
        (n,) bounds of the errors of the two coefficients.
    planes
        (n, 2, 3) unit normals of two great circles that meet in the pole, for the poles of
        which they were requested.
    w, dw
        (n, 3) by link, the angular velocity relative to the ground and its derivative.
    status
        (n,) status of the motion, AT_SINGULARITY if the rates are not determined, and
        ILL_CONDITIONED if the routes "first" or "conditioned" do not determine them.
    pole_status
        (n,) status of each pole: NO_POLE or ILL_CONDITIONED if only this pole is not
        determined, otherwise the `status` of the row.
    is_quad_precision
        (n,) rows that were computed a second time, in quad precision. On the route
        "equations" all rows are counted as such.
    is_certified
        (n,) rows whose float64 results a kernel certifies.
    is_decimal
        (n,) rows near a dead centre that were computed from the decimal sizes of the file.
    relative_error_bound
        (n,) error bound of `w` and `dw`, relative to the largest vector of any link, or
        to 1 if 1 is larger. Not computed for certified rows, where it is given as 0.
    direction_dq
        (n, 3) derivative of each direction (1/rad).
    direction_dq_error
        (n,) bound of the error of this derivative.
    """

    direction: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    conditioning: MutableMapping[Pole, Floats] = field(default_factory=dict)
    direction_error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient_error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient_error: MutableMapping[Pole, Floats] = field(
        default_factory=dict
    )
    planes: MutableMapping[Pole, Floats] = field(default_factory=dict)
    w: MutableMapping[int, Floats] = field(default_factory=dict)
    dw: MutableMapping[int, Floats] = field(default_factory=dict)
    status: SmallIntegers
    pole_status: MutableMapping[Pole, SmallIntegers] = field(default_factory=dict)
    is_quad_precision: Bools
    is_certified: Bools
    is_decimal: Bools
    relative_error_bound: Floats
    direction_dq: MutableMapping[Pole, Floats] = field(default_factory=dict)
    direction_dq_error: MutableMapping[Pole, Floats] = field(default_factory=dict)

    @property
    def as_arrays(self) -> "PoleField":
        """The field itself. In a `LazyField`, this property computes all columns first."""
        return self

    def without_pole_values(self) -> "PoleField":
        """Return the field with NaN for all quantities of poles and for their bounds."""
        unknown_values: dict[str, Any] = {}
        for name in (*(quantity.name for quantity in POLE_QUANTITIES), *POLE_ERRORS):
            values_by_pole = getattr(self, name)
            unknown_values[name] = {
                pole: np.full_like(values, np.nan)
                for pole, values in values_by_pole.items()
            }
        return replace(self, **unknown_values)
