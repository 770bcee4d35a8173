"""Inertia of links: tensors about the centre O of the sphere, and their checks."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.triangle import frame_from
from spherekit.geometry.vectors import all_finite, cross, max_abs
from spherekit.mechanism.sizes import Vector, check_finite

PARALLEL_AXES_SINE = 1e-9
"""Sine of the angle below which two axes lie on one line, and define neither arc nor frame.

Larger: more links are refused. Smaller: frames may consist of rounding errors.
"""

MOMENT_TOLERANCE = 1e-3
"""Largest violation of the conditions on principal moments, over the largest element.

The moments of a thin arc are exactly on the limit, and published tables print few digits.
Larger: wrong tensors pass. Smaller: correct tensors with few digits are refused.
"""

ASYMMETRY_TOLERANCE = 1e-12
"""Largest difference of two mirrored elements of a tensor, over the largest element.

Larger: typing errors in small elements pass. Smaller: rounding errors are refused.
"""

Tensor = tuple[Vector, Vector, Vector]
"""Inertia tensor (kg m2) as three rows."""


@dataclass(frozen=True)
class Mass:
    """Inertia of a link of a mechanism, in link axes.

    Attributes
    ----------
    link
        Name of the link.
    tensor
        Inertia tensor about the centre of the sphere (kg m2).
    mass
        Mass (kg). Only gravity and transmitted forces need it.
    centre
        Centre of mass (m) from the centre of the sphere. Only gravity and transmitted
        forces need it.
    """

    link: str
    tensor: Tensor
    mass: float | None = None
    centre: Vector | None = None


def point_mass_inertia(mass: float, point: Floats) -> Floats:
    """Return the inertia tensor (3, 3) about O (kg m2) of a point mass (kg) at (3,) m."""
    return mass * (point @ point * np.eye(3) - np.outer(point, point))


def shift_to_sphere_centre(tensor: Floats, mass: float, centre: Floats) -> Floats:
    """Return the inertia tensor (3, 3) about the sphere's centre O, by Steiner's theorem.

    Parameters
    ----------
    tensor
        (3, 3) inertia tensor about the centre of mass (kg m2), in link axes.
    mass
        Mass (kg).
    centre
        (3,) centre of mass (m) from O, in link axes.
    """
    return tensor + point_mass_inertia(mass, centre)


def axes_frame(first: Floats, second: Floats) -> Floats:
    """Return the frame (3, 3) with z along `first` and with `second` at x = 0, y > 0.

    The inertia tensor of a link can be stated in this frame. Both arguments are unit
    vectors (3,) along axes of the link, in link axes. The columns of the frame are its axes
    x, y and z. Di Gregorio 2024, Fig. 3, describes links in this frame.

    Raises
    ------
    ModelError
        If the axes are parallel.
    """
    normal = cross(second, first)
    sine = np.linalg.norm(normal)
    if sine < PARALLEL_AXES_SINE:
        raise ModelError(
            "the two axes are parallel, so they define neither a plane nor an arc; name "
            "other axes, or give the inertia tensor in the axes of the link (key tensor, "
            "without arc and frame)"
        )
    x_axis = normal / sine
    # The frame with the z axis `first` and this x axis.
    return frame_from(first, x_axis)


def uniform_arc(
    first: Floats, second: Floats, mass: float, radius: float
) -> tuple[Floats, Floats]:
    """Return the inertia of a thin arc of uniform density, a simple model of a link.

    Parameters
    ----------
    first, second
        (3,) unit vectors to the ends of the arc, the shorter great-circle arc between them.
    mass
        Mass of the arc (kg).
    radius
        Distance (m) of the arc from O, the centre of the sphere.

    Returns
    -------
    tensor
        (3, 3) inertia tensor about O (kg m2), in the same axes as the two vectors.
    centre
        (3,) centre of mass (m) from O.

    Raises
    ------
    ModelError
        If the two vectors are parallel or opposite.

    Notes
    -----
    A point of the arc at the angle phi from its middle has the unit vector cos(phi) e +
    sin(phi) f. Here e points to the middle, and f is perpendicular to e in the plane of the
    arc. Over an arc of the angle a, the means are <cos^2> = 1/2 + sin a / (2 a) and <sin^2>
    = 1/2 - sin a / (2 a). The centre of mass is at the distance radius sin(a/2) / (a/2)
    along e.
    """
    frame = axes_frame(first, second)
    # The columns of the frame are its axes. The arc is in the plane of y and z: it begins
    # at z, which is along `first`, and turns towards y.
    arc = np.arctan2(second @ frame[:, 1], second @ first)
    half_arc = arc / 2
    middle = np.cos(half_arc) * frame[:, 2] + np.sin(half_arc) * frame[:, 1]
    tangent = np.cos(half_arc) * frame[:, 1] - np.sin(half_arc) * frame[:, 2]
    half_mean_difference = np.sin(arc) / (2 * arc)
    # Mean of the dyadic product of the unit vectors along the arc.
    mean_dyad = (0.5 + half_mean_difference) * np.outer(middle, middle)
    mean_dyad += (0.5 - half_mean_difference) * np.outer(tangent, tangent)
    tensor = mass * radius**2 * (np.eye(3) - mean_dyad)
    centre = radius * np.sin(half_arc) / half_arc * middle
    return tensor, centre


def check_mass(mass: Mass) -> None:
    """Raise an error if no body can have this inertia.

    The inertia tensor of a link is about the centre O of the sphere. A mass and a centre of
    mass may be stated with it.

    Raises
    ------
    ModelError
        If the tensor is not symmetric, or has a negative principal moment. If one principal
        moment exceeds the sum of the two others. If the mass is not positive. If a centre
        of mass is stated without a mass, or is too far away for the range of float64. If
        the tensor about the centre of mass, computed from these data, breaks one of these
        rules.
    """
    key = f"mass.{mass.link}"
    if mass.mass is not None:
        check_finite(f"{key}.mass", [mass.mass])
        if not mass.mass > 0:
            raise ModelError(f"{key}.mass: found {mass.mass:g} kg, expected more than 0")
    tensor = np.array(mass.tensor, dtype=np.float64)
    check_tensor(f"{key}.tensor", tensor)
    # Mass and centre determine the tensor about the centre of mass (Steiner's theorem),
    # which has to be possible too.
    if mass.centre is None:
        return
    if mass.mass is None:
        raise ModelError(
            f"{key}.centre: a centre of mass needs the key mass in the same table, in kg"
        )
    check_finite(f"{key}.centre", mass.centre)
    with np.errstate(over="ignore", invalid="ignore"):
        central_tensor = tensor - point_mass_inertia(mass.mass, np.array(mass.centre))
    if not all_finite(central_tensor):
        raise ModelError(
            f"{key}.centre: found {list(mass.centre)} m, which is too far from the centre "
            f"of the sphere for a mass of {mass.mass:g} kg"
        )
    about = f" about the centre of mass ({mass.mass:g} kg at {list(mass.centre)} m)"
    # The difference has the rounding errors of both tensors. The tolerance is therefore
    # relative to the larger one, about O.
    _check_principal_moments(
        key, central_tensor, tolerance=MOMENT_TOLERANCE * max_abs(tensor), about=about
    )


def check_tensor(key: str, tensor: Floats) -> None:
    """Raise an error if no body has such an inertia tensor (3, 3) about any point.

    `key` is the beginning of the message.

    Raises
    ------
    ModelError
        If the tensor is not symmetric, has a negative principal moment, or a principal
        moment that exceeds the sum of the two others.
    """
    if tensor.shape != (3, 3):
        raise ModelError(f"{key}: has the shape {tensor.shape}, expected the shape (3, 3)")
    check_finite(key, tensor.ravel())
    largest = max_abs(tensor)
    for i, j in np.argwhere(np.abs(tensor - tensor.T) > ASYMMETRY_TOLERANCE * largest):
        raise ModelError(
            f"{key}: the tensor is not symmetric: row {i + 1}, column {j + 1} has "
            f"{tensor[i, j]}, but row {j + 1}, column {i + 1} has {tensor[j, i]}; give the "
            "same number in both places"
        )
    # `about` is the part of the message that names the reference point. Here it is empty.
    _check_principal_moments(key, tensor, tolerance=MOMENT_TOLERANCE * largest, about="")


def _check_principal_moments(
    key: str, tensor: Floats, tolerance: float, about: str
) -> None:
    """Raise `ModelError` if no body can have the principal moments of an inertia tensor.

    No principal moment can be negative, or exceed the sum of the two others.

    Parameters
    ----------
    key
        Key of the tensor in the file, the beginning of the message.
    tensor
        (3, 3) symmetric tensor (kg m2).
    tolerance
        Violation (kg m2) that is accepted.
    about
        Words of the message for the point to which the tensor refers, such as " about the
        centre of mass". Empty if the message need not name the point.
    """
    small, middle, large = np.linalg.eigvalsh(tensor)
    excess = large - middle - small
    if small < -tolerance:
        what = (
            f"smallest principal moment{about} is {small:.6g} kg m2, but no principal "
            "moment can be negative; check units and signs of products of inertia"
        )
    elif excess > tolerance:
        what = (
            f"largest principal moment{about} exceeds the sum of the others by "
            f"{excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); check units, "
            "signs of products of inertia, and the point to which the tensor refers"
        )
    else:
        return
    raise ModelError(f"{key}: no body has this inertia: the {what}")
