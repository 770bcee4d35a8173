"""Planes through the sphere's centre as mirrors, and the angles that name them.

A mirror with unit normal n carries Q = x to P. Chen et al. 2021 name it by three angles:
P = (cos phi, sin phi sin omega, sin phi cos omega), and gamma, the angle by which the plane
y = 0 is turned. In the normal they are n = (-sin(phi / 2), sin(gamma / 2), n_z) and
tan omega = n_y / n_z, so phi and gamma alone name the mirror with n_z >= 0.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from spherekit.errors import SolveError
from spherekit.sphere.rotation import Floats, transpose


@final
@dataclass(frozen=True)
class MirrorAngles:
    """`phi`, `gamma` and `omega` (n,) rad of mirrors with n_z >= 0.

    phi runs from -pi to pi: it is the arc from Q to P, negative where P is on the side
    z < 0, so that all three angles are smooth where P passes through Q. gamma runs from
    -pi to pi, omega from -pi / 2 to pi / 2. The paper has phi >= 0 only.
    """

    phi: Floats
    gamma: Floats
    omega: Floats


def reflections(normals: Floats) -> Floats:
    """Return the matrices (..., 3, 3) of mirrors with unit normals (..., 3)."""
    return np.asarray(np.eye(3) - 2.0 * normals[..., :, None] * normals[..., None, :])


def upward(normals: Floats) -> Floats:
    """Return the normals (..., 3) of the same mirrors with n_z >= 0."""
    return np.asarray(np.where(normals[..., 2:] < 0.0, -normals, normals))


def mirror_angles(normals: Floats) -> MirrorAngles:
    """Return the angles of mirrors with unit normals (n, 3) in the paper's axes."""
    x, y, z = np.moveaxis(upward(normals), -1, 0)
    return MirrorAngles(
        -2.0 * np.arctan2(x, np.hypot(y, z)),
        2.0 * np.arctan2(y, np.hypot(x, z)),
        np.arctan2(y, z),
    )


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
    normals = np.stack([x, y, z], axis=-1)
    return np.asarray(np.where(np.isnan(z)[..., None], np.nan, normals))


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
    between = matrices @ reflections(normals)
    skew = between - transpose(between)
    sine = 0.5 * np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2)
    cosine = 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0)
    return normals, np.asarray(np.arctan2(sine, cosine))
