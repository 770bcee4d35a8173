"""Batched rotations: matrices (n, 3, 3) acting on columns, quaternions xyzw."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for arrays (..., 3); much faster on small arrays than NumPy's own."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out = np.empty((*x.shape, 3), dtype=x.dtype)
    out[..., 0], out[..., 1], out[..., 2] = x, az * bx - ax * bz, ax * by - ay * bx
    return out


def about_z(angle: ArrayLike) -> Floats:
    """Return rotation matrices (..., 3, 3) by angle (rad) about the z axis."""
    angle = np.asarray(angle, dtype=float)
    out = np.zeros((*angle.shape, 3, 3))
    c, s = np.cos(angle), np.sin(angle)
    out[..., 0, 0] = out[..., 1, 1] = c
    out[..., 0, 1], out[..., 1, 0] = -s, s
    out[..., 2, 2] = 1.0
    return out


def transpose(matrix: Floats) -> Floats:
    """Return the inverse of rotation matrices (..., 3, 3)."""
    return np.swapaxes(matrix, -1, -2)


def frame_from(axis: Floats, tangent: Floats) -> Floats:
    """Return frames (..., 3, 3) with columns tangent, axis x tangent, axis.

    `axis` and `tangent` are perpendicular unit vectors (..., 3).
    """
    return np.stack([tangent, cross(axis, tangent), axis], axis=-1)


def frame_toward(axis: Floats, other: Floats) -> Floats:
    """Return frames (..., 3, 3) with the third column `axis`, the first toward `other`.

    `axis` and `other` are unit vectors (..., 3); NaN where they lie on one line.
    """
    side = cross(axis, other)
    side = side / np.linalg.norm(side, axis=-1, keepdims=True)
    return frame_from(axis, cross(side, axis))


def perpendicular(axis: Floats) -> Floats:
    """Return one unit vector at right angles to each unit vector `axis` (..., 3)."""
    helper = np.eye(3)[np.argmin(np.abs(axis), axis=-1)]
    side = cross(axis, helper)
    return np.asarray(side / np.linalg.norm(side, axis=-1, keepdims=True))


def rotation_vector(matrix: Floats) -> Floats:
    """Return the rotation vectors (..., 3), axis times angle in [0, pi], of matrices.

    Accurate to rounding for small angles, where closure residuals live; near a half
    turn the axis comes from the symmetric part.
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
        symmetric = 0.5 * (r + transpose(r))[flipped]
        _, vectors = np.linalg.eigh(symmetric)
        axis = vectors[..., -1]
        turn = np.sum(axis * twice_sine[flipped], axis=-1, keepdims=True)
        axis = np.where(turn < 0.0, -axis, axis)
        out[flipped] = axis * angle[flipped][..., None]
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
    four = np.diagonal(rows, axis1=1, axis2=2)
    best = np.argmax(np.where(np.isnan(four), -1.0, four), axis=1)
    chosen = rows[np.arange(len(r)), best]
    return np.asarray(chosen / np.linalg.norm(chosen, axis=1, keepdims=True))


def from_quaternion(quaternions: NDArray[Any]) -> NDArray[Any]:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4) xyzw.

    Complex ones are taken as they are: the squares of their parts must have the sum 1.
    """
    vector, scalar = quaternions[..., :3], quaternions[..., 3, None, None]
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    out = 2 * vector[..., :, None] * vector[..., None, :]
    out += (2 * scalar * scalar - 1) * np.eye(3)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return np.asarray(out + 2 * scalar * skew.reshape(out.shape))


def arc(a: Floats, b: Floats) -> Floats:
    """Return the angle (rad, 0 to pi) between unit vectors (..., 3), exact near 0, pi."""
    sine = np.linalg.norm(cross(a, b), axis=-1)
    return np.asarray(np.arctan2(sine, np.sum(a * b, axis=-1)))
