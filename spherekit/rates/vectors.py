"""Vector algebra on component-first arrays (..., 3, n), the layout of the kernels."""

import numpy as np

from spherekit.sphere.rotation import Floats


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for arrays (..., 3, n)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    a0, a1, a2 = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    b0, b1, b2 = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    out[..., 0, :] = a1 * b2 - a2 * b1
    out[..., 1, :] = a2 * b0 - a0 * b2
    out[..., 2, :] = a0 * b1 - a1 * b0
    return out


def dot(a: Floats, b: Floats) -> Floats:
    """Return a . b (..., n) for arrays (..., 3, n)."""
    return np.asarray(
        a[..., 0, :] * b[..., 0, :]
        + a[..., 1, :] * b[..., 1, :]
        + a[..., 2, :] * b[..., 2, :]
    )


def norm(a: Floats) -> Floats:
    """Return |a| (..., n) for arrays (..., 3, n)."""
    return np.sqrt(dot(a, a))
