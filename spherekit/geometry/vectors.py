"""Products of vectors in arrays, and small functions of arrays.

Vectors have their components along the last axis, or along the last axis but one in the
functions for columns.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors (..., 3).

    On small arrays it is much faster than NumPy's own function.
    """
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    product = np.empty((*x.shape, 3), dtype=x.dtype)
    product[..., 0] = x
    product[..., 1] = az * bx - ax * bz
    product[..., 2] = ax * by - ay * bx
    return product


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products (...) of vectors (..., 3).

    The products are always added in this order. A vector therefore gives exactly the same
    result alone and in a large array.
    """
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross_columns(a: Floats, b: Floats) -> Floats:
    """Return the cross products (..., 3, n) of vectors (..., 3, n)."""
    return np.cross(a, b, axis=-2)


def dot_columns(a: Floats, b: Floats) -> Floats:
    """Return the scalar products (..., n) of vectors (..., 3, n)."""
    return np.einsum("...in,...in->...n", a, b)


def norm_columns(a: Floats) -> Floats:
    """Return the lengths (..., n) of vectors (..., 3, n).

    Lengths must be between 1e-150 and 1e150, so that their squares are accurate numbers.
    """
    return np.sqrt(dot_columns(a, a))


def unit_rows(vectors: Floats) -> Floats:
    """Return vectors (..., k) divided by their lengths; NaN for a vector of zeros.

    Lengths must be between 1e-150 and 1e150, so that their squares are accurate numbers.
    """
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def all_finite(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return whether all numbers are finite, or all those along some axes."""
    return np.all(np.isfinite(values), axis=axis)


def nans(shape: int | tuple[int, ...]) -> Floats:
    """Return an array of NaN, which represent unknown numbers."""
    return np.full(shape, np.nan)


def max_abs(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return the largest absolute value, of all numbers or along axes; 0 of no numbers."""
    return np.max(np.abs(values), axis=axis, initial=0.0)
