"""Points at which edges of a triangle mesh cross the border of a region."""

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.border_point import find_crossings
from spherekit.geometry.region_margins import MarginEvaluator

KEY_BITS = 32
"""Number of bits for the index of a vertex in the key of an edge, a 64-bit integer."""


class EdgeCrossings:
    """Crossings of mesh edges with the border of a region, each computed once.

    The region has the directions in which all margins (functions of the direction) are at
    least 0. Edges are great-circle arcs between a vertex inside the region and one outside.
    The triangles on both sides of an edge share its crossing. Crossings are numbered in the
    order in which they were computed.

    Attributes
    ----------
    points
        (c, 3) unit vectors.
    margins
        (c,) index of the margin that is zero at each of the c crossings.
        `UNDEFINED_MARGIN` (-1) if the region ends because a margin is NaN.
    """

    def __init__(self) -> None:
        """Begin without crossings."""
        self._keys = np.zeros(0, np.intp)  # see `_edge_keys`
        self.points = np.zeros((0, 3))
        self.margins = np.zeros(0, np.intp)

    def find(
        self,
        evaluate: MarginEvaluator,
        vertices: Floats,
        inside: Indices,
        outside: Indices,
    ) -> Indices:
        """Return the indices of the points where mesh edges cross the border of a region.

        Each edge joins a vertex inside the region to a vertex outside. Crossings that no
        earlier call has computed are computed now, and stored in `points` and `margins`.

        Parameters
        ----------
        evaluate
            The margins of the region: functions of the direction that are at least 0 in it.
        vertices
            (V, 3) unit vectors, the vertices of the mesh.
        inside, outside
            (n,) indices of the vertices of each edge inside and outside the region.

        Returns
        -------
        (n,) indices of the crossings in `points`.
        """
        # The key of an edge is an integer that contains the indices of both vertices.
        keys = _edge_keys(inside, outside)
        new_keys = np.setdiff1d(keys, self._keys)
        new_inside = _inside_vertices(new_keys)
        new_outside = _outside_vertices(new_keys)
        # The points, and the index of the margin that ends the region at each of them.
        points, zero_margins = find_crossings(
            evaluate, vertices[new_inside], vertices[new_outside]
        )
        self._keys = np.append(self._keys, new_keys)
        self.points = np.concatenate([self.points, points])
        self.margins = np.append(self.margins, zero_margins)
        return self._look_up(keys)

    def _look_up(self, keys: Indices) -> Indices:
        """Return the numbers (n,) of crossings with known keys (n,)."""
        order = np.argsort(self._keys)
        return order[np.searchsorted(self._keys, keys, sorter=order)]


def _edge_keys(inside: Indices, outside: Indices) -> Indices:
    """Return one integer for each mesh edge, the key by which it is found again.

    The index of the vertex inside the region is in the upper 32 bits of the integer, the
    index of the vertex outside in the lower ones.
    """
    return (inside << KEY_BITS) | outside


def _inside_vertices(keys: Indices) -> Indices:
    """Return, for each edge, the index of its vertex inside the region, from the key."""
    return keys >> KEY_BITS


def _outside_vertices(keys: Indices) -> Indices:
    """Return, for each edge, the index of its vertex outside the region, from the key."""
    return keys & (2**KEY_BITS - 1)
