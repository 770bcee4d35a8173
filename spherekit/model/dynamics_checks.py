"""Whether masses and stops can be real; the errors say by how much they are not."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import ModelError
from spherekit.model.dynamics import Mass, Stop
from spherekit.model.inertia import moments_of_point
from spherekit.model.needs import need_angle, need_finite

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism

MOMENT_TOLERANCE = 1e-3
"""Excess of a principal moment that passes for rounding, as part of the largest entry.

The moments of a thin arc stand exactly on the limit, and tables print few digits.
"""

ASYMMETRY = 1e-12
"""Difference of two mirrored entries that passes for rounding, as part of the largest."""


def check_mass(mass: Mass) -> None:
    """Refuse an inertia that no body has.

    Raises
    ------
    ModelError
        If the tensor is not symmetric, has a negative principal moment, or one that
        exceeds the sum of the two others; if the mass is not positive; if the tensor is
        smaller than that of the mass at its centre.
    """
    key = f"mass.{mass.link}"
    if mass.mass is not None:
        need_finite(f"{key}.mass", [mass.mass])
        if not mass.mass > 0:
            raise ModelError(f"{key}.mass: found {mass.mass:g} kg, needs more than 0")
    tensor = np.array(mass.tensor, dtype=np.float64)
    check_tensor(f"{key}.tensor", tensor)
    if mass.centre is None:
        return
    if mass.mass is None:
        raise ModelError(f"{key}.centre: needs a mass with it, in kg")
    need_finite(f"{key}.centre", mass.centre)
    moved = tensor - moments_of_point(mass.mass, np.array(mass.centre))
    about = f" about the centre of mass ({mass.mass:g} kg at {list(mass.centre)} m)"
    slack = MOMENT_TOLERANCE * float(np.max(np.abs(tensor)))
    _need_moments(key, moved, slack, about)


def check_tensor(key: str, tensor: NDArray[np.float64]) -> None:
    """Refuse an inertia tensor that no body has about any point; `key` says where it is.

    Raises
    ------
    ModelError
        If it is not symmetric, has a negative principal moment, or one that exceeds the
        sum of the two others.
    """
    if tensor.shape != (3, 3):
        raise ModelError(f"{key}: has the shape {tensor.shape}, needs (3, 3)")
    need_finite(key, tensor.ravel())
    largest = float(np.max(np.abs(tensor)))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(tensor[i, j] - tensor[j, i]) > ASYMMETRY * largest:
            raise ModelError(
                f"{key}: not symmetric: row {i + 1}, column {j + 1} has {tensor[i, j]}, "
                f"row {j + 1}, column {i + 1} has {tensor[j, i]}"
            )
    _need_moments(key, tensor, MOMENT_TOLERANCE * largest, "")


def _need_moments(key: str, tensor: NDArray[np.float64], slack: float, about: str) -> None:
    small, middle, large = map(float, np.linalg.eigvalsh(tensor))
    if small < -slack:
        raise ModelError(
            f"{key}: not physical: the smallest principal moment{about} is {small:.6g} "
            "kg m2; none is below 0"
        )
    excess = large - middle - small
    if excess > slack:
        raise ModelError(
            f"{key}: not physical: the largest principal moment{about} exceeds the sum of "
            f"the others by {excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); "
            "check units, signs of products of inertia, and the point it is about"
        )


def check_stop(stop: Stop, mechanism: "Mechanism") -> None:
    """Refuse a stop that is not a range of an R pair's variable."""
    key = f"stops.{stop.pair}"
    need_angle(key, stop.pair, mechanism)
    need_finite(key, (stop.low, stop.high))
    if not stop.low < stop.high:
        raise ModelError(
            f"{key}: the range must rise from `from` to `to`, but it is "
            f"{stop.low:.6g} to {stop.high:.6g} rad"
        )
