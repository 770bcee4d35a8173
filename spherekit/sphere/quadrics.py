"""Common points of three quadrics in the projective space of quaternions.

A rotation that keeps the arc between a fixed and a moving axis lies on a quadric of that
space; three such conditions, the platform of a triad on its three bars, have eight
common points, real or complex (C. M. Gosselin, J. Sefrioui and M. J. Richard, 1994).
They follow from the Macaulay matrix of degree 4 and the eigenvectors of a multiplication
matrix (D. Cox, J. Little and D. O'Shea, Using Algebraic Geometry, 2005, chapter 2.4).
"""

from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats, cross

COMMON_POINTS = 8
"""Complex points that three quadrics have in common, counted with multiplicity."""


ISOLATED = 1e-10
"""Least relative singular value of the Macaulay matrix, of those that must not be 0.

Below, rounding cannot tell isolated points from a curve or surface of them.
"""


def arc_quadric(
    fixed: NDArray[Any], moving: NDArray[Any], cosine: NDArray[Any]
) -> NDArray[Any]:
    """Return the quadrics of rotations R with fixed . (R moving) = cosine.

    Parameters
    ----------
    fixed, moving
        Unit vectors (..., 3), real or complex, `moving` in the axes that R turns.
    cosine
        (...,) cosine of the arc between the two axes.

    Returns
    -------
    quadric
        (..., 4, 4) symmetric Q with q Q q = |q|^2 (fixed . (R moving) - cosine) for the
        quaternion q xyzw of R.
    """
    dot = np.sum(fixed * moving, axis=-1)
    outer = fixed[..., :, None] * moving[..., None, :]
    quadric = np.empty((*dot.shape, 4, 4), dtype=outer.dtype)
    quadric[..., :3, :3] = outer + np.swapaxes(outer, -1, -2)
    quadric[..., :3, :3] -= (dot + cosine)[..., None, None] * np.eye(3)
    quadric[..., :3, 3] = quadric[..., 3, :3] = cross(moving, fixed)
    quadric[..., 3, 3] = dot - cosine
    return quadric


def _monomials(degree: int) -> list[tuple[int, ...]]:
    return list(combinations_with_replacement(range(4), degree))


_QUADRATIC, _CUBIC = _monomials(2), _monomials(3)
_QUARTIC = {monomial: place for place, monomial in enumerate(_monomials(4))}
_PRODUCTS = np.array(
    [[_QUARTIC[tuple(sorted(a + b))] for b in _QUADRATIC] for a in _QUADRATIC]
)
_SHIFTED = np.array([[_QUARTIC[tuple(sorted((x, *m)))] for m in _CUBIC] for x in range(4)])
_ROWS, _COLUMNS = (np.array(places) for places in zip(*_QUADRATIC, strict=True))
_WEIGHTS = np.where(_ROWS == _COLUMNS, 1.0, 2.0)
_FORMS = np.array([[0.61, -0.47, 0.53, 0.36], [-0.29, 0.58, 0.66, -0.38]])
"""Two linear forms in no special position: their ratio tells the points apart."""
_RANK = len(_QUARTIC) - COMMON_POINTS


def common_points(quadrics: NDArray[Any]) -> NDArray[np.complex128]:
    """Return the eight complex points that three quadrics have in common.

    Parameters
    ----------
    quadrics
        (n, 3, 4, 4) symmetric matrices, real or complex.

    Returns
    -------
    points
        (n, 8, 4) complex, of norm 1 and any phase; a point of multiplicity m comes m
        times, accurate to the m-th root of rounding. NaN where the quadrics have a
        curve or surface in common.
    """
    n = len(quadrics)
    multiples = len(_QUADRATIC)
    macaulay = np.zeros((n, 3, multiples, len(_QUARTIC)), dtype=quadrics.dtype)
    coefficients = _WEIGHTS * quadrics[..., _ROWS, _COLUMNS]
    macaulay[:, :, np.arange(multiples)[:, None], _PRODUCTS] = coefficients[:, :, None]
    _, values, right = np.linalg.svd(macaulay.reshape(n, 3 * multiples, len(_QUARTIC)))
    isolated = values[:, _RANK - 1] > ISOLATED * values[:, 0]
    points = np.full((n, COMMON_POINTS, 4), np.nan, dtype=complex)
    points[isolated] = _points(np.swapaxes(right[isolated, _RANK:].conj(), 1, 2))
    return points


def _points(kernel: NDArray[Any]) -> NDArray[np.complex128]:
    """Return the points (n, 8, 4) whose quartic monomials span kernels (n, 35, 8)."""
    shifted = kernel[:, _SHIFTED]
    one, other = np.moveaxis(np.einsum("hx,nxmk->nhmk", _FORMS, shifted), 1, 0)
    basis, triangle = np.linalg.qr(other)
    adjoint = np.swapaxes(basis, 1, 2).conj()
    _, vectors = np.linalg.eig(np.linalg.solve(triangle, adjoint @ one))
    multiples = np.einsum("nxmk,nkp->npmx", shifted, vectors)
    best = np.argmax(np.sum(np.abs(multiples) ** 2, axis=3), axis=2)
    points = np.take_along_axis(multiples, best[:, :, None, None], axis=2)[:, :, 0]
    return np.asarray(points / np.linalg.norm(points, axis=2, keepdims=True))


def nearest_real(points: NDArray[np.complex128]) -> tuple[Floats, Floats]:
    """Return unit quaternions (..., 4) nearest to complex points, and how far they are.

    The phase is the one that leaves the smallest imaginary part, whose norm is the
    distance (...,).
    """
    square = np.sum(points * points, axis=-1, keepdims=True)
    turned = points * np.exp(-0.5j * np.angle(square))
    length = np.linalg.norm(turned.real, axis=-1, keepdims=True)
    return turned.real / length, np.linalg.norm(turned.imag, axis=-1)
