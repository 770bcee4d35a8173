"""Mirror planes through the centre of the sphere, and the angles that describe them.

A mirror with the unit normal n carries the point Q = (1, 0, 0) to its image P. Chen et al.
2021 describe it by three angles:

- phi and omega are the polar angles of P = (cos phi, sin phi sin omega, sin phi cos omega),
- gamma is the angle between the plane y = 0 and its mirror image, with the sign of n_y.

In terms of these angles n = (-sin(phi / 2), sin(gamma / 2), n_z) and tan omega = n_y / n_z.
So phi and gamma alone determine the mirror, with n_z >= 0.
"""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.errors import SolveError
from spherekit.geometry.rotation import angles_between, transpose
from spherekit.geometry.vectors import all_finite
from spherekit.tolerances import EPS

NORMAL_ROUNDING = 4.0 * EPS
"""Rounding error of n_z^2 if n_z is computed from the angles phi and gamma of a mirror.

Larger: angles of which no mirror exists give a mirror with n_z = 0. Smaller: mirrors with
n_z = 0 are lost by rounding.
"""


def reflections(normals: Floats) -> Floats:
    """Return the matrices (..., 3, 3) of mirrors with unit normals (..., 3)."""
    return np.eye(3) - 2.0 * normals[..., :, None] * normals[..., None, :]


def upward(normals: Floats) -> Floats:
    """Return the normals (..., 3) of the same mirrors with n_z >= 0."""
    return np.where(normals[..., 2:] < 0.0, -normals, normals)


def mirror_angles(normals: Floats) -> tuple[Floats, Floats, Floats]:
    """Return phi, gamma and omega (n,), rad, of mirrors with unit normals (n, 3).

    These angles state poses of a mechanism in which base and output link are mirror images
    of each other.

    A mirror reflects points in the plane through the centre with the normal n. Of the two
    opposite normals, the one with n_z >= 0 defines the angles:

    - phi is the arc from Q = (1, 0, 0) to its mirror image P, with the sign of -n_x. So
      n_x = -sin(phi / 2).
    - gamma is the arc from (0, 1, 0) to its mirror image, with the sign of n_y. So n_y =
      sin(gamma / 2).
    - omega is the angle about the x axis from the z axis to n, positive towards the y axis.
      So tan omega = n_y / n_z.

    phi and gamma are between -pi and pi, omega is between -pi / 2 and pi / 2. With the sign
    of phi, all three angles are smooth where P passes through Q. Chen et al. 2021 have
    phi >= 0 only.
    """
    # Adding 0 turns -0 into 0. With z = -0, `arctan2` would give an omega beyond pi / 2.
    x, y, z = np.moveaxis(upward(normals) + 0.0, -1, 0)
    phi = -2.0 * np.arctan2(x, np.hypot(y, z))
    gamma = 2.0 * np.arctan2(y, np.hypot(x, z))
    omega = np.arctan2(y, z)
    return phi, gamma, omega


def normals_of(phi: ArrayLike, gamma: ArrayLike) -> Floats:
    """Return the unit normals of mirrors through the centre, from the two angles of each.

    In some mechanisms, base and output are mirror images of each other. Two angles of the
    mirror then state a pose of the output, which is computed from the normal.

    The angles tell how far a mirror moves two points of the unit sphere:

    - phi is the arc from (1, 0, 0) to its mirror image, positive if n_x is negative. Half
      of it is the arc from the point to the mirror plane, so n_x = -sin(phi / 2).
    - gamma is the arc from (0, 1, 0) to its mirror image, positive if n_y is positive. In
      the same way n_y = sin(gamma / 2).

    Parameters
    ----------
    phi, gamma
        (n,) angles (rad) between -pi and pi.

    Returns
    -------
    (n, 3) normals with n_z >= 0. NaN if an angle is not finite, or if no unit vector has
    these n_x and n_y, because n_x^2 + n_y^2 > 1. A sum above 1 by rounding only gives n_z =
    0.
    """
    half_phi = 0.5 * np.asarray(phi, dtype=float)
    half_gamma = 0.5 * np.asarray(gamma, dtype=float)
    with np.errstate(invalid="ignore"):
        x = -np.sin(half_phi)
        y = np.sin(half_gamma)
        # This product equals 1 - x^2 - y^2, but loses no digits where it is nearly zero.
        z_square = np.cos(half_phi + half_gamma) * np.cos(half_phi - half_gamma)
        # At n_z = 0 rounding errors decide about the sign.
        is_rounded = (z_square >= -NORMAL_ROUNDING) & (z_square < 0.0)
        z = np.sqrt(np.where(is_rounded, 0.0, z_square))
    # If z is NaN, the added term makes the other components NaN too.
    return np.stack([x, y, z], axis=-1) + 0.0 * z[..., None]


def normal_at(phi: float, gamma: float) -> Floats:
    """Return the unit normal (3,) of the mirror with the angles phi and gamma, rad.

    A mirror is a plane through the centre of the sphere. In some mechanisms, base and
    output are mirror images of each other. The mirror is then called the mid-plane of both.
    The angles are defined by the normal (-sin(phi / 2), sin(gamma / 2), n_z) with n_z >= 0
    (Chen et al. 2021). The angles are between -pi and pi. ``|phi|`` is the arc from the
    point (1, 0, 0) to its mirror image, and ``|gamma|`` is that from (0, 1, 0) to its
    image.

    Raises
    ------
    SolveError
        If an angle is not finite. If sin^2(phi / 2) + sin^2(gamma / 2) > 1: no unit vector
        has these components.
    """
    if not all_finite([phi, gamma]):
        raise SolveError(
            f"the mid-plane has phi = {phi} rad and gamma = {gamma} rad; give two finite "
            "angles"
        )
    normal = normals_of(phi, gamma)
    if np.any(np.isnan(normal)):
        raise SolveError(
            f"no mid-plane has phi = {np.degrees(phi):.6g} deg with gamma = "
            f"{np.degrees(gamma):.6g} deg: sin^2(phi / 2) + sin^2(gamma / 2) is above 1; "
            "make one of them smaller"
        )
    return normal


def mirror_of(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the mirrors closest to improper orthogonal matrices, and the deviations.

    A mirror is a plane through the centre of the sphere. Each matrix is a reflection in a
    plane, followed by a rotation about the normal of this plane. The plane is the mirror.

    Parameters
    ----------
    matrices
        (n, 3, 3) orthogonal matrices with determinant -1.

    Returns
    -------
    normals
        (n, 3) unit normals of the mirrors, with n_z >= 0.
    deviation
        (n,) angle (rad) by which mirror and matrix differ; 0 if the matrix is a reflection.
    """
    # Each matrix is a reflection with a normal n, followed by a rotation about n by an
    # angle d. Its symmetric part has the eigenvalue -1 for n, and cos(d) twice at right
    # angles to n. `eigh` sorts the eigenvalues, so n is the first column. No other
    # reflection is closer to the matrix than the one with this normal.
    _, eigenvectors = np.linalg.eigh(0.5 * (matrices + transpose(matrices)))
    normals = upward(eigenvectors[..., 0])
    return normals, angles_between(reflections(normals), matrices)
