"""Which boxes have no configuration since no sum of the equations can vanish in them.

With f and F' at a box's centre, the values of the linear parts over the box are a zonotope,
and zero is outside of it if and only if it is beyond one of its facets (McMullen, On
zonotopes, 1971). The normal of a facet is a sum of equations in which all variables but
two, or one where there are as many as equations, have no slope. Any sum is one that may be
taken, so that nothing rests on how well its weights are computed.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.tubes import ROUNDING, UP
from spherekit.sphere.rotation import Floats

FLATTEST = 1e-9
"""Least determinant of slopes by which weights are computed."""


def apart(values: Floats, slopes: Floats, radii: Floats, bent: Floats) -> NDArray[np.bool_]:
    """Return which boxes are proven to have no zero (n,).

    Parameters
    ----------
    values, slopes
        Of the equations at the centres, (n, k) and (n, k, v).
    radii
        Of the boxes, (n, v).
    bent
        (n, k) by how much at most the equations differ from their linear parts over the
        boxes, errors included.
    """
    out = np.zeros(len(values), dtype=bool)
    count = values.shape[1]
    moving = np.flatnonzero(np.any(radii > 0.0, axis=0))
    if len(values) == 0 or count == 1 or not count <= len(moving) <= count + 1:
        return out
    steep, wide = slopes[..., moving], radii[:, moving]
    columns = list(combinations(range(len(moving)), count))
    sizes = np.stack([np.abs(np.linalg.det(steep[..., kept])) for kept in columns], axis=1)
    largest = np.argmax(sizes, axis=1)
    sizes = sizes[np.arange(len(sizes)), largest]
    for number, kept in enumerate(columns):
        rows = np.flatnonzero((largest == number) & (sizes > FLATTEST))
        if len(rows):
            weights = _normals(steep[rows], kept)
            out[rows] = _beyond(weights, values[rows], steep[rows], wide[rows], bent[rows])
    return out


def _normals(slopes: Floats, kept: tuple[int, ...]) -> Floats:
    """Return weights (n, facets, k) of the facets, from the inverse of some columns."""
    inverse = np.linalg.inv(slopes[..., kept])
    left = [column for column in range(slopes.shape[2]) if column not in kept]
    if not left:
        return np.asarray(inverse)
    also = inverse @ slopes[..., left]
    pairs = [
        also[:, one] * inverse[:, other] - also[:, other] * inverse[:, one]
        for one, other in combinations(range(len(kept)), 2)
    ]
    return np.concatenate([inverse, np.stack(pairs, axis=1)], axis=1)


def _beyond(
    weights: Floats, values: Floats, slopes: Floats, radii: Floats, bent: Floats
) -> NDArray[np.bool_]:
    """Return whether one of the sums of equations cannot vanish."""
    size = np.abs(values) + np.einsum("nkv,nv->nk", np.abs(slopes), radii)
    reach = np.einsum("nwv,nv->nw", np.abs(weights @ slopes), radii)
    reach += np.einsum("nwk,nk->nw", np.abs(weights), bent + ROUNDING * size)
    sums = np.abs(np.einsum("nwk,nk->nw", weights, values))
    return np.asarray(np.any(sums > reach * UP, axis=1))
