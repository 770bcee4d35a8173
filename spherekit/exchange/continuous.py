"""Angles on a grid that go on from node to node."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats


def continued_on_grid(
    values: Floats, rates: Floats, nodes: Floats, shape: tuple[int, ...], periods: Floats
) -> Floats:
    """Return values (n, K) less whole periods, so that neighbours follow their rates.

    Each connected part of the grid goes on from its first node. Where rates grow beyond all
    bounds, or values grow by a period around a hole, some neighbours stay a period apart.

    Parameters
    ----------
    values, rates
        (n, K) and their derivatives (n, K, m) at the nodes; NaN where there are none.
    nodes
        (n, m) the inputs, on a grid of a shape, the last running fastest.
    periods
        (K,) of the values; infinite where they have none.
    """
    beside = list(_beside(shape))
    present = np.all(np.isfinite(values), axis=1)
    values, done = values.copy(), ~present
    finite = np.isfinite(periods)

    def ahead(start: NDArray[np.intp], end: NDArray[np.intp]) -> Floats:
        slope = 0.5 * (rates[start] + rates[end])
        way = nodes[end] - nodes[start]
        return np.asarray(values[start] + np.einsum("nki,ni->nk", slope, way))

    edges = np.concatenate(beside) if beside else np.empty((0, 2), dtype=np.intp)
    edges = edges[present[edges[:, 0]] & present[edges[:, 1]]]
    while not np.all(done):
        done[int(np.argmin(done))] = True
        while True:
            for columns in ((0, 1), (1, 0)):
                start, end = edges[:, columns[0]], edges[:, columns[1]]
                new = done[start] & ~done[end]
                if np.any(new):
                    break
            else:
                break
            ends, first = np.unique(end[new], return_index=True)
            starts = start[new][first]
            off = (ahead(starts, ends) - values[ends])[:, finite]
            turns = np.round(off / periods[finite])
            values[np.ix_(ends, finite)] += turns * periods[finite]
            done[ends] = True
    return values


def _beside(shape: tuple[int, ...]) -> Iterator[NDArray[np.intp]]:
    """Yield the pairs of neighbours (k, 2) along each axis of a grid."""
    number = np.arange(int(np.prod(shape))).reshape(shape)
    for axis in range(len(shape)):
        rows = np.moveaxis(number, axis, 0)
        yield from (np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairwise(rows))
