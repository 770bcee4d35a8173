"""Triangles between singular configurations: split more finely, and cut at a range."""

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.arc_length import periods_of
from spherekit.motion.turns import in_range, into_range, less_periods
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

Indices = NDArray[np.int64]

SIDES = ((0, 1), (1, 2), (2, 0))


@final
@dataclass(frozen=True)
class Mesh:
    """Triangles of vertices on a locus.

    Attributes
    ----------
    locus, points
        The locus, and the vertices (n).
    triangles
        (m, 3) numbers of vertices.
    component
        (n,) number of the seed each vertex was reached from.
    held
        (n, V) which variables of vertices are at an end of a range that cuts the mesh.
    """

    locus: Locus
    points: LocusPoints
    triangles: Indices
    component: Indices
    held: NDArray[np.bool_]

    @property
    def border(self) -> Indices:
        """(k, 2) the edges with one triangle."""
        edges, _, often = self._edges()
        return np.asarray(edges[often == 1])

    def split(self) -> Self:
        """Return the mesh with every edge halved, at a point of the locus.

        An edge whose middle Newton's method does not find is kept.
        """
        edges, of_triangle, _ = self._edges()
        guess, motions = self._between(edges, np.full(len(edges), 0.5))
        borders = np.swapaxes(self.points.tangents[edges[:, 0]], 1, 2)
        made = self._found(guess, motions, borders, edges)
        count = len(self.points)
        middle = np.full(len(edges), -1)
        middle[made.good] = count + np.arange(int(made.good.sum()))
        triangles: list[tuple[int, int, int]] = []
        for corners, sides in zip(self.triangles.tolist(), of_triangle, strict=True):
            triangles += _parts(corners, middle[sides].tolist())
        held = np.zeros_like(self.held, shape=(len(edges), self.held.shape[1]))
        return self._with(made, held, edges, triangles)

    def within(self, driven: int, low: float, high: float) -> Self:
        """Return what of the mesh has a variable (rad) in a range, cut at its ends."""
        mesh = self._cut(driven, low, high, low, 1.0)
        return mesh._cut(driven, low, high, high, -1.0)

    def only(self, wanted: NDArray[np.bool_]) -> Self:
        """Return the triangles whose vertices are all wanted (n,)."""
        if np.all(wanted):
            return self
        none = self.points.rows(np.zeros(0, dtype=np.intp))
        kept = self.triangles[np.all(wanted[self.triangles], axis=1)]
        corners = [(a, b, c) for a, b, c in kept.tolist()]
        return self._with(none, self.held[:0], np.zeros((0, 2), dtype=np.int64), corners)

    def _cut(self, driven: int, low: float, high: float, end: float, way: float) -> Self:
        period = periods_of(self.locus.closure)[driven]
        q = into_range(self.points.values[:, driven], low, high, period)
        beyond = way * (q - end)
        inside = in_range(beyond, 0.0, np.inf)
        edges, of_triangle, _ = self._edges()
        crossed = inside[edges[:, 0]] != inside[edges[:, 1]]
        crossing = edges[crossed]
        one, other = np.abs(beyond[crossing]).T
        guess, motions = self._between(crossing, one / (one + other))
        every = np.eye(guess.shape[1])
        held = np.all(self.held[crossing], axis=1)
        tangents = self.points.tangents[crossing[:, 0]]
        slope = tangents[:, driven]
        along = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
        beside = np.einsum("nvk,nk->nv", tangents, along)
        beside = np.where(held.any(axis=1)[:, None], every[held.argmax(axis=1)], beside)
        borders = np.stack([np.broadcast_to(every[driven], guess.shape), beside], axis=1)
        miss = less_periods(end - guess[:, driven], np.full(len(guess), period))
        guess[:, driven] += miss
        made = self._found(guess, motions, borders, crossing)
        at = np.full(len(edges), -1)
        numbers = np.full(len(crossing), -1)
        numbers[made.good] = len(self.points) + np.arange(int(made.good.sum()))
        at[crossed] = numbers
        triangles: list[tuple[int, int, int]] = []
        for corners, sides in zip(self.triangles.tolist(), of_triangle, strict=True):
            triangles += _inner(corners, at[sides].tolist(), inside[corners].tolist())
        held[:, driven] = True
        return self._with(made, held, crossing, triangles)

    def _edges(self) -> tuple[Indices, Indices, Indices]:
        """Return edges (k, 2), those (m, 3) of triangles, and how many have each."""
        sides = np.stack([self.triangles[:, pair] for pair in SIDES], axis=1)
        edges, which, often = np.unique(
            np.sort(sides.reshape(-1, 2), axis=1),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        return edges, which.reshape(-1, 3), often

    def _between(self, edges: Indices, part: Floats) -> tuple[Floats, Floats]:
        """Return values and motions (k, V) at a part (k,) of the way along edges."""
        values, motions = self.points.values, self.points.motions
        one, other = edges.T
        away = less_periods(values[other] - values[one], periods_of(self.locus.closure))
        sense = np.sign(np.sum(motions[one] * motions[other], axis=1))[:, None]
        turned = sense * motions[other] - motions[one]
        step = part[:, None]
        return values[one] + step * away, motions[one] + step * turned

    def _found(
        self, guess: Floats, motions: Floats, borders: Floats, edges: Indices
    ) -> LocusPoints:
        """Return the locus near guesses, NaN where that is not between the edge's ends."""
        targets = np.einsum("nkv,nv->nk", borders, guess)
        made = self.locus.correct(guess, motions, borders, targets)
        ends = self.points.values[edges]
        length = np.linalg.norm(
            less_periods(ends[:, 1] - ends[:, 0], periods_of(self.locus.closure)), axis=1
        )
        far = ~(np.linalg.norm(made.values - guess, axis=1) < 0.5 * length)
        made.residual[far] = np.nan
        return made

    def _with(
        self,
        points: LocusPoints,
        held: NDArray[np.bool_],
        edges: Indices,
        triangles: list[tuple[int, int, int]],
    ) -> Self:
        """Return the mesh with the good points on edges (k, 2), and other triangles.

        Vertices of no triangle go.
        """
        good = points.good
        every = LocusPoints.joined([self.points, points.rows(good)])
        component = np.concatenate([self.component, self.component[edges[good, 0]]])
        corners = np.array(triangles, dtype=np.int64).reshape(-1, 3)
        used, numbers = np.unique(corners, return_inverse=True)
        return type(self)(
            self.locus,
            every.rows(used),
            numbers.reshape(-1, 3).astype(np.int64),
            component[used],
            np.concatenate([self.held, held[good]])[used],
        )


def _parts(corners: list[int], middles: list[int]) -> list[tuple[int, int, int]]:
    """Return the triangles of one with the middles of its sides, -1 for a side kept."""
    (a, b, c), (ab, bc, ca) = corners, middles
    split = sum(middle >= 0 for middle in middles)
    if split == 0:
        return [(a, b, c)]
    if split == 3:
        return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    while ab < 0 or (split == 2 and bc < 0):
        a, b, c, ab, bc, ca = b, c, a, bc, ca, ab
    if split == 1:
        return [(a, ab, c), (ab, b, c)]
    return [(ab, b, bc), (a, ab, bc), (a, bc, c)]


def _inner(
    corners: list[int], cuts: list[int], inside: list[bool]
) -> list[tuple[int, int, int]]:
    """Return the triangles of what of one is inside; none where a cut is missing."""
    count = sum(inside)
    if count in (0, 3):
        return [(corners[0], corners[1], corners[2])] if count else []
    odd = inside.index(count == 1)
    a, b, c = (corners[(odd + k) % 3] for k in range(3))
    ab, ca = cuts[odd], cuts[(odd + 2) % 3]
    if ab < 0 or ca < 0:
        return []
    return [(a, ab, ca)] if count == 1 else [(ab, b, c), (ab, c, ca)]
