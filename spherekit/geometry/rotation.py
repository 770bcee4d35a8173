"""Batched rotations: matrices (n, 3, 3) acting on columns, quaternions xyzw."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats


def cross(a: Array, b: Array) -> Array:
    """Return a x b for arrays (..., 3); much faster on small arrays than NumPy's own."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out = np.empty((*x.shape, 3), dtype=x.dtype)
    out[..., 0], out[..., 1], out[..., 2] = x, az * bx - ax * bz, ax * by - ay * bx
    return out


def transpose(matrix: Floats) -> Floats:
    """Return the inverse of rotation matrices (..., 3, 3)."""
    return np.swapaxes(matrix, -1, -2)


def from_quaternion(quaternions: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4) xyzw.

    Complex ones are taken as they are: the squares of their parts must have the sum 1.
    """
    vector, scalar = quaternions[..., :3], quaternions[..., 3, None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    out = 2 * vector[..., :, None] * vector[..., None, :]
    out += (2 * scalar * scalar - 1) * np.eye(3)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return out + 2 * scalar * skew.reshape(out.shape)


def rotation_between_pairs(
    first: Array, second: Array, to_first: Array, to_second: Array
) -> Array:
    """Return the rotations that carry two unit vectors to two others.

    Parameters
    ----------
    first, second
        (..., 3) the two vectors before the rotation, real or complex.
    to_first, to_second
        (..., 3) the same two vectors after it. They have the same scalar product.

    Returns
    -------
    (..., 3, 3) rotation matrices; NaN if the two vectors are parallel.
    """
    # The rows of `dual` give the components of a vector along first, second and normal,
    # multiplied by |normal|^2.
    normal = cross(first, second)
    dual = np.stack([cross(second, normal), cross(normal, first), normal], axis=-2)
    images = np.stack([to_first, to_second, cross(to_first, to_second)], axis=-1)
    return images @ dual / np.sum(normal * normal, axis=-1)[..., None, None]


def log_rate(vector: Floats, w: Floats) -> Floats:
    """Return the change d' (n, 3) of rotation vectors d as Q turns at w (n, 3).

    d' = w - d x w / 2 + c d x (d x w) with c = (1 - (a / 2) cot(a / 2)) / a^2 and a the
    length of d, w the spatial angular velocity of Q (Bullo and Murray 1995, eq. 2.11). With
    w in the axes of the rotated body the second term is added: it is that of -d.
    """
    first = cross(vector, w)
    return w - 0.5 * first + _C(_square(vector)) * cross(vector, first)


def log_rate_change(vector: Floats, rate: Floats, w: Floats) -> Floats:
    """Return the change (n, 3) of `log_rate` for fixed w while d changes at `rate`."""
    along = 2.0 * np.sum(vector * rate, axis=1, keepdims=True)
    first, turned = cross(vector, w), cross(rate, w)
    return (
        -0.5 * turned
        + _C_RATE(_square(vector)) * along * cross(vector, first)
        + _C(_square(vector)) * (cross(rate, first) + cross(vector, turned))
    )


def _square(vector: Floats) -> Floats:
    return np.sum(vector * vector, axis=1, keepdims=True)


def _terms() -> list[float]:
    """Return the first terms of c by the square of the angle, |B_2k| / (2k)!.

    By Euler's rule for sums of even powers, from the convolution of those before.
    """
    terms = [1.0 / 12.0]
    while len(terms) < 32:
        terms.append(np.dot(terms, terms[::-1]) / (2 * len(terms) + 3))
    return terms


_C = np.polynomial.Polynomial(_terms())
"""The factor c of `log_rate`, exact to rounding for angles up to pi."""
_C_RATE = _C.deriv()


def all_finite(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return whether numbers are finite: all, or all along some axes."""
    return np.all(np.isfinite(values), axis=axis)


def unit_rows(vectors: Floats) -> Floats:
    """Return vectors (..., k) of length 1 along those given."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def nans(shape: int | tuple[int, ...]) -> Floats:
    """Return an array of numbers that are not known."""
    return np.full(shape, np.nan)


def max_abs(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return the largest size of numbers, of all or along axes; 0 of none."""
    return np.max(np.abs(values), axis=axis, initial=0.0)
