"""Complex rotations: matrices R with R^T R = 1 and complex entries.

Real solutions of trigonometric equations meet and become complex ones; what is to stay
analytic while they do has to be known on both. Products here are bilinear, a . b = sum
a_k b_k without conjugation, so a formula for real unit vectors holds word for word.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Complexes = NDArray[np.complex128]


def dot(a: Complexes, b: Complexes) -> Complexes:
    """Return a . b (...,) of arrays (..., 3), without conjugation."""
    return np.asarray(np.sum(a * b, axis=-1))


def cross(a: Complexes, b: Complexes) -> Complexes:
    """Return a x b of arrays (..., 3)."""
    return np.asarray(np.cross(a, b), dtype=complex)


def taking(
    first: NDArray[Any], second: NDArray[Any], to_first: Complexes, to_second: Complexes
) -> Complexes:
    """Return the rotations (..., 3, 3) that take two unit vectors (..., 3) to two others.

    Both pairs have the same scalar product; NaN where it is 1 or -1.
    """
    base = dot(first, second)
    square = 1.0 - base * base
    dual = (first - base[..., None] * second, second - base[..., None] * first)
    normal, to_normal = cross(first, second), cross(to_first, to_second)
    out = to_first[..., :, None] * dual[0][..., None, :]
    out = out + to_second[..., :, None] * dual[1][..., None, :]
    out = out + to_normal[..., :, None] * normal[..., None, :]
    return np.asarray(out / square[..., None, None])
