"""Rotation matrices in quad precision.

The operator @ of numpy-quaddtype 1.0 returns wrong numbers for stacks of matrices. Products
are therefore written as sums here.
"""

import numpy as np

from spherekit.arrays import Array
from spherekit.geometry.vectors import dot
from spherekit.numerics.quad_precision import quad


def normalize(vectors: Array) -> Array:
    """Return unit vectors along vectors (..., 3)."""
    return vectors / np.sqrt(dot(vectors, vectors))[..., None]


def rotate_about_z(angle: Array) -> Array:
    """Return rotations (..., 3, 3) about z by angles (...) rad, in quad precision."""
    angle = np.asarray(angle, dtype=quad())
    cosine = np.cos(angle)
    sine = np.sin(angle)
    zero = np.zeros_like(angle)
    rows = [
        [cosine, -sine, zero],
        [sine, cosine, zero],
        [zero, zero, zero + 1],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def multiply_matrices(a: Array, b: Array) -> Array:
    """Return the matrix products of matrices a and b (..., 3, 3)."""
    return np.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def matrix_vector_products(matrices: Array, vectors: Array) -> Array:
    """Return the products of matrices (..., i, j) with vectors (..., j)."""
    return np.sum(matrices * vectors[..., None, :], axis=-1)


def transpose_matrices(matrices: Array) -> Array:
    """Return the transposes of matrices (..., 3, 3). They invert rotations."""
    return np.swapaxes(matrices, -1, -2)


def make_frame(z_axis: Array, x_axis: Array) -> Array:
    """Return frames (..., 3, 3) whose columns are x, y and z axis.

    `z_axis` and `x_axis` (..., 3) are unit vectors at right angles.
    """
    return np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=-1)
