"""Inertia tensors about the centre of the sphere, from what is known of a link."""

import numpy as np

from spherekit.errors import ModelError
from spherekit.sphere.rotation import Floats, cross, frame_from

PARALLEL = 1e-9
"""Below this sine two axes count as one line, which has no arc and gives no frame."""


def moments_of_point(mass: float, place: Floats) -> Floats:
    """Return the tensor (3, 3), kg m2, about O of a mass (kg) at a place (3,), m."""
    return np.asarray(mass * (place @ place * np.eye(3) - np.outer(place, place)))


def moved_to_sphere_centre(tensor: Floats, mass: float, centre: Floats) -> Floats:
    """Return the tensor (3, 3) about O, given that about the centre of mass (kg m2).

    `mass` is in kg, `centre` (3,) in m from O. Steiner's theorem.
    """
    return np.asarray(tensor + moments_of_point(mass, centre))


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
    length = float(np.arctan2(second @ frame[:, 1], second @ first))
    half = length / 2
    middle = np.cos(half) * frame[:, 2] + np.sin(half) * frame[:, 1]
    across = np.cos(half) * frame[:, 1] - np.sin(half) * frame[:, 2]
    spread = np.sin(length) / (2 * length)
    taken = (0.5 + spread) * np.outer(middle, middle)
    taken += (0.5 - spread) * np.outer(across, across)
    tensor = mass * radius**2 * (np.eye(3) - taken)
    return tensor, radius * np.sin(half) / half * middle
