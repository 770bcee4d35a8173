"""Planes through the centre of the sphere as mirrors, and the angles that name them.

A mirror with unit normal n carries Q = x to P. Chen et al. 2021 name it by three angles:
P = (cos phi, sin phi sin omega, sin phi cos omega), and gamma, the angle by which the plane
y = 0 is turned. In the normal they are n = (-sin(phi / 2), sin(gamma / 2), n_z) and
tan omega = n_y / n_z, so phi and gamma alone name the mirror with n_z >= 0.
"""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.errors import SolveError
from spherekit.geometry.rotation import transpose, unit_rows


def rotation_vector(matrix: Floats) -> Floats:
    """Return the rotation vectors (..., 3), axis times angle in [0, pi], of matrices.

    Accurate to rounding for small angles, where closure residuals live; near a half
    turn the axis comes from the quaternion.
    """
    r = matrix
    twice_sine = np.empty(r.shape[:-1])
    x = np.subtract(r[..., 2, 1], r[..., 1, 2], out=twice_sine[..., 0])
    y = np.subtract(r[..., 0, 2], r[..., 2, 0], out=twice_sine[..., 1])
    z = np.subtract(r[..., 1, 0], r[..., 0, 1], out=twice_sine[..., 2])
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    small = sine < 1e-4
    factor = np.where(small, 1.0 + angle * angle / 6.0, angle / np.where(small, 1.0, sine))
    out: Floats = 0.5 * factor[..., None] * twice_sine
    flipped = (cosine < 0.0) & (sine < 1e-3)
    if np.any(flipped):
        four = quaternion(r[flipped])
        axis = unit_rows(four[:, :3] * np.where(four[:, 3:] < 0.0, -1.0, 1.0))
        out[flipped] = axis * angle[flipped][:, None]
    return out


def quaternion(matrix: Floats) -> Floats:
    """Return unit quaternions (n, 4) xyzw of rotation matrices (n, 3, 3).

    The sign is the one with the largest component positive; NaN in, NaN out.
    """
    r, trace = matrix, np.trace(matrix, axis1=1, axis2=2)[:, None]
    # four times the products of the quaternion's components
    rows = np.empty((len(r), 4, 4))
    rows[:, :3, :3] = r + transpose(r) + (1.0 - trace)[..., None] * np.eye(3)
    back, ahead = [2, 0, 1], [1, 2, 0]
    rows[:, 3, :3] = rows[:, :3, 3] = r[:, back, ahead] - r[:, ahead, back]
    rows[:, 3, 3:] = 1.0 + trace
    best = np.argmax(np.diagonal(rows, axis1=1, axis2=2), axis=1)
    return unit_rows(rows[np.arange(len(r)), best])


def angles_between(first: Floats, second: Floats) -> Floats:
    """Return the angles (n,) rad of the rotations that carry orientations to others.

    Both are rotation matrices (n, 3, 3) from body axes to fixed axes.
    """
    return np.linalg.norm(rotation_vector(second @ transpose(first)), axis=-1)


def reflections(normals: Floats) -> Floats:
    """Return the matrices (..., 3, 3) of mirrors with unit normals (..., 3)."""
    return np.eye(3) - 2.0 * normals[..., :, None] * normals[..., None, :]


def upward(normals: Floats) -> Floats:
    """Return the normals (..., 3) of the same mirrors with n_z >= 0."""
    return np.where(normals[..., 2:] < 0.0, -normals, normals)


def mirror_angles(normals: Floats) -> tuple[Floats, Floats, Floats]:
    """Return phi, gamma and omega (n,) rad of mirrors with unit normals (n, 3).

    In the paper's axes, for n_z >= 0. phi runs from -pi to pi: it is the arc from Q to P,
    negative where P is on the side z < 0, so that all three angles are smooth where P
    passes through Q. gamma runs from -pi to pi, omega from -pi / 2 to pi / 2. The paper has
    phi >= 0 only.
    """
    x, y, z = np.moveaxis(upward(normals), -1, 0)
    phi = -2.0 * np.arctan2(x, np.hypot(y, z))
    return phi, 2.0 * np.arctan2(y, np.hypot(x, z)), np.arctan2(y, z)


def normals_of(phi: ArrayLike, gamma: ArrayLike) -> Floats:
    """Return the unit normals (n, 3) of mirrors with these phi and gamma (n,) rad.

    NaN where no mirror has them: sin^2(phi / 2) + sin^2(gamma / 2) > 1.
    """
    half, other = (0.5 * np.asarray(angle, dtype=float) for angle in (phi, gamma))
    x, y = -np.sin(half), np.sin(other)
    # cos(a + b) cos(a - b) loses nothing near the edge, where 1 - x^2 - y^2 does
    square = np.cos(half + other) * np.cos(half - other)
    with np.errstate(invalid="ignore"):
        z = np.sqrt(square)
    return np.stack([x, y, z], axis=-1) + 0.0 * z[..., None]


def normal_at(phi: float, gamma: float) -> Floats:
    """Return the unit normal (3,) of one mirror.

    Raises
    ------
    SolveError
        If no mirror has these angles (rad).
    """
    normal = normals_of(phi, gamma)
    if np.any(np.isnan(normal)):
        raise SolveError(
            f"no mirror has phi = {np.degrees(phi):.6g} deg with gamma = "
            f"{np.degrees(gamma):.6g} deg: sin^2(phi / 2) + sin^2(gamma / 2) is above 1; "
            "make one of them smaller"
        )
    return normal


def mirror_of(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the mirrors nearest to improper orthogonal matrices, and how far they are.

    Parameters
    ----------
    matrices
        (n, 3, 3), determinant -1.

    Returns
    -------
    normals, departure
        Unit normals (n, 3) with n_z >= 0, and the angle (n,) rad of the rotation between
        the mirror and the matrix: 0 where the matrix is a reflection.
    """
    _, vectors = np.linalg.eigh(0.5 * (matrices + transpose(matrices)))
    normals = upward(vectors[..., 0])
    return normals, angles_between(reflections(normals), matrices)
