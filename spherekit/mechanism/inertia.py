"""Inertia tensors of links about the centre of the sphere."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.rotation import cross, max_abs
from spherekit.geometry.triangle import frame_from
from spherekit.mechanism.sizes import Vector, need_finite

PARALLEL = 1e-9
"""Below this sine two axes count as one line, which has no arc and gives no frame."""


def moments_of_point(mass: float, place: Floats) -> Floats:
    """Return the tensor (3, 3), kg m2, about O of a mass (kg) at a place (3,), m."""
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def moved_to_sphere_centre(tensor: Floats, mass: float, centre: Floats) -> Floats:
    """Return the tensor (3, 3) about O, given that about the centre of mass (kg m2).

    `mass` is in kg, `centre` (3,) in m from O. Steiner's theorem.
    """
    return tensor + moments_of_point(mass, centre)


def axes_frame(first: Floats, second: Floats) -> Floats:
    """Return the frame (3, 3) with z along `first` and `second` at x = 0, y > 0.

    The columns are x, y, z, as the frame of Di Gregorio 2024, Fig. 3, on the two axes.

    Raises
    ------
    ModelError
        If the axes, unit vectors (3,), are parallel.
    """
    across = cross(second, first)
    length = np.linalg.norm(across)
    if length < PARALLEL:
        raise ModelError(
            "the two axes are parallel, so that no plane and no arc is theirs; name "
            "others, or give tensor in link axes"
        )
    return frame_from(first, across / length)


def uniform_arc(
    first: Floats, second: Floats, mass: float, radius: float
) -> tuple[Floats, Floats]:
    """Return tensor about O (kg m2) and centre of mass (m) of a thin uniform arc.

    The mass (kg) is spread evenly over the shorter great-circle arc of a radius (m) from
    the unit vector `first` (3,) to `second`.

    Raises
    ------
    ModelError
        If the two axes are parallel.

    Notes
    -----
    With the length a of the arc, means over it along and across the direction e of its
    middle are <cos^2> = 1/2 + sin a / (2 a) and <sin^2> = 1/2 - sin a / (2 a); the centre
    is at radius sin(a/2) / (a/2) along e.
    """
    frame = axes_frame(first, second)
    length = np.arctan2(second @ frame[:, 1], second @ first)
    half = length / 2
    middle = np.cos(half) * frame[:, 2] + np.sin(half) * frame[:, 1]
    across = np.cos(half) * frame[:, 1] - np.sin(half) * frame[:, 2]
    spread = np.sin(length) / (2 * length)
    taken = (0.5 + spread) * np.outer(middle, middle)
    taken += (0.5 - spread) * np.outer(across, across)
    return mass * radius**2 * (np.eye(3) - taken), radius * np.sin(half) / half * middle


Tensor = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class Mass:
    """Inertia of a link, in link axes.

    `tensor` is the inertia tensor about the centre of the sphere (kg m2). `mass` (kg) and
    `centre`, the centre of mass (m), are needed by gravity only.
    """

    link: str
    tensor: Tensor
    mass: float | None = None
    centre: Vector | None = None


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
    _need_moments(key, moved, MOMENT_TOLERANCE * max_abs(tensor), about)


def check_tensor(key: str, tensor: Floats) -> None:
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
    largest = max_abs(tensor)
    for i, j in np.argwhere(np.abs(tensor - tensor.T) > ASYMMETRY * largest):
        raise ModelError(
            f"{key}: not symmetric: row {i + 1}, column {j + 1} has {tensor[i, j]}, "
            f"row {j + 1}, column {i + 1} has {tensor[j, i]}"
        )
    _need_moments(key, tensor, MOMENT_TOLERANCE * largest, "")


def _need_moments(key: str, tensor: Floats, slack: float, about: str) -> None:
    small, middle, large = np.linalg.eigvalsh(tensor)
    excess = large - middle - small
    if small < -slack:
        what = f"smallest principal moment{about} is {small:.6g} kg m2; none is below 0"
    elif excess > slack:
        what = (
            f"largest principal moment{about} exceeds the sum of the others by "
            f"{excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); check units, "
            "signs of products of inertia, and the point it is about"
        )
    else:
        return
    raise ModelError(f"{key}: not physical: the {what}")
