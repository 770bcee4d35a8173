"""The directions where given margins are not negative, with area, border and parts."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import final

import numpy as np

from spherekit.errors import RegionError
from spherekit.region.border import BoundarySegments, nearest_on
from spherekit.region.margins import (
    Evaluator,
    Margins,
    TriangleClass,
    check_positive,
    least,
)
from spherekit.region.mesh import Bools, Indices, labels
from spherekit.region.refine import Refinement
from spherekit.sphere.rotation import Floats

ROUNDING = 1e-14
"""Rounding of a sum of areas (sr), part of every error."""
LARGEST_SET = 4
"""Sets of more margins than this are not tried when a region is empty."""


@final
@dataclass(frozen=True)
class BorderArc:
    """A smooth arc of the border: `points` (m, 3), the region to their left.

    `margin` is the number of the margin that is 0 on it, -1 where a margin is undefined
    on the other side.
    """

    margin: int
    points: Floats


@final
@dataclass(frozen=True)
class Boundary:
    """A closed curve of the border, as its smooth arcs in order.

    `component` and `gap` are the numbers of the part of the region on its left and of the
    part of the outside on its right.
    """

    arcs: tuple[BorderArc, ...]
    component: int
    gap: int

    @property
    def points(self) -> Floats:
        """The points (m, 3) of the whole curve, the first repeated at the end."""
        parts = [arc.points[:-1] for arc in self.arcs]
        return np.concatenate([*parts, self.arcs[0].points[:1]])

    @property
    def corners(self) -> Floats:
        """The points (c, 3) where arcs of different margins meet."""
        starts = [arc.points[0] for arc in self.arcs if len(self.arcs) > 1]
        return np.reshape(starts, (-1, 3))


@final
@dataclass(frozen=True)
class Part:
    """A connected part of the region or of the outside.

    `area` is in sr, `boundaries` are the numbers of the curves around it, `place` (3,) is
    its vertex with the largest, or most negative, smallest margin `depth`.
    """

    area: float
    boundaries: tuple[int, ...]
    place: Floats
    depth: float


@final
@dataclass(frozen=True)
class Region:
    """Directions where all margins are at least 0.

    Attributes
    ----------
    area, error
        Area (sr) and a bound of its error: what doubling the order of the border changes,
        and the whole area of every triangle of which too little is known.
    unresolved
        That latter area alone (sr): tangent borders, corners sharper than 0.25 rad,
        borders of where a margin is defined.
    components
        Connected parts, the largest first.
    gaps
        Connected parts of the outside, the largest first; the others are the holes.
    boundaries
        Closed curves between a component and a gap.
    excluding
        For an empty region, the smallest sets of margins that leave nothing together.
    points, triangles, values
        Vertices (V, 3), triangles (T, 3), counter-clockwise from outside, and margins
        (V, k) at the vertices; NaN where undefined.
    surface_points, surface_triangles
        Points (P, 3), the vertices first, and triangles (F, 3) that cover the region alone,
        up to its border: what maps are drawn on.
    evaluations, calls
        Places at which the margins were evaluated, and calls that took.
    """

    area: float
    error: float
    unresolved: float
    components: tuple[Part, ...]
    gaps: tuple[Part, ...]
    boundaries: tuple[Boundary, ...] = field(repr=False)
    excluding: tuple[tuple[int, ...], ...]
    points: Floats = field(repr=False)
    triangles: Indices = field(repr=False)
    values: Floats = field(repr=False)
    surface_points: Floats = field(repr=False)
    surface_triangles: Indices = field(repr=False)
    evaluations: int
    calls: int
    border: BoundarySegments = field(repr=False)
    margins: Margins = field(repr=False)

    @property
    def inside(self) -> Bools:
        """Which vertices (V,) are in the region."""
        return np.asarray(least(self.values) >= 0.0)

    @property
    def holes(self) -> tuple[Part, ...]:
        """The gaps but for the largest."""
        return self.gaps[1:]

    def nearest(self, point: Sequence[float] | Floats) -> Floats:
        """Return the point (3,) of the region nearest to a direction (3,).

        A direction in the region is returned as it is, scaled to length 1.

        Raises
        ------
        RegionError
            The region is empty, or the direction is not a vector.
        """
        place = np.asarray(point, dtype=float)
        length = np.linalg.norm(place)
        if place.shape != (3,) or not 0.0 < length < np.inf:
            raise RegionError(
                f"{point!r} is not a direction; give three finite numbers, not all 0"
            )
        place = place / length
        evaluate = Evaluator(self.margins, self.values)
        if least(evaluate(place[None]))[0] >= 0.0:
            return np.asarray(place)
        if not len(self.border.margin):
            raise RegionError(
                "the region is empty, so no point of it is nearest"
                + (
                    f"; margins {self.excluding[0]} exclude each other"
                    * bool(self.excluding)
                )
            )
        return nearest_on(self.border, evaluate, place)


def find_region(
    margins: Margins,
    tolerance: float = 1e-4,
    spacing: float = 0.2,
    feature: float = 1e-3,
    most: int = 1_000_000,
) -> Region:
    """Return the directions where all margins are at least 0.

    Parameters
    ----------
    margins
        Values (n, k) at unit vectors (n, 3). Smooth across the border where they can be:
        a margin that ends at the border, or jumps there, costs far more. NaN says that a
        direction cannot be reached, unless another margin is negative there.
    tolerance
        Error of the area (sr) to aim at; `error` says what was reached.
    spacing
        Longest edge (rad) of the first triangles, which are sampled at half of it. What the
        margins do between samples is taken from polynomials of degree 2 whose error is
        sampled too: features of margins that are narrower and leave no trace at the
        samples are not seen.
    feature
        Triangles in which a part of the region, or a hole, may hide are cut until their
        edges are shorter than this (rad); below, only as the tolerance asks.
    most
        Evaluations after which the work ends.

    Raises
    ------
    RegionError
        A size is not positive, or the margins do not return a row for each place.
    """
    sizes = {"tolerance": tolerance, "spacing": spacing, "feature": feature, "most": most}
    check_positive(sizes)
    evaluate = Evaluator(margins)
    search = Refinement(evaluate, spacing)
    search.run(tolerance, feature, most)
    open_area, areas = search.open_area(), search.area_inside()
    counted = search.verdict[search.owner] != TriangleClass.OPEN
    components, gaps, boundaries = _parts(search, areas)
    excluding: tuple[tuple[int, ...], ...] = ()
    if not components:
        excluding = _excluding(evaluate, search.values, spacing, feature)
    return Region(
        float(np.sum(areas)),
        float(np.sum(search.pieces.error[counted])) + open_area + ROUNDING,
        open_area,
        components,
        gaps,
        boundaries,
        excluding,
        search.points,
        search.triangles,
        search.values,
        *search.surface(),
        evaluate.evaluations,
        evaluate.calls,
        search.pieces,
        margins,
    )


def _parts(
    search: Refinement, areas: Floats
) -> tuple[tuple[Part, ...], tuple[Part, ...], tuple[Boundary, ...]]:
    """Return the parts of the region and of the outside, and the curves between them."""
    triangles, inside = search.triangles, search.inside
    pairs = np.concatenate(
        [triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]
    )
    label = labels(len(inside), pairs[inside[pairs[:, 0]] == inside[pairs[:, 1]]])
    count = int(label.max()) + 1
    held = inside[triangles]
    rows = np.arange(len(triangles))
    total = np.zeros(count)
    some = held.any(axis=1)
    np.add.at(total, label[triangles[rows, np.argmax(held, axis=1)]][some], areas[some])
    some = ~held.all(axis=1)
    rest = search.areas - areas
    np.add.at(total, label[triangles[rows, np.argmin(held, axis=1)]][some], rest[some])
    is_region = np.zeros(count, dtype=bool)
    is_region[label] = inside
    order = np.argsort(-total, kind="stable")
    numbers = np.empty(count, dtype=np.intp)
    for state in (True, False):
        alike = order[is_region[order] == state]
        numbers[alike] = np.arange(len(alike))
    boundaries, sides = [], []
    for loop in search.loops():
        vertices = triangles[search.owner[loop[0]]]
        state = inside[vertices]
        component = int(numbers[label[vertices[np.argmax(state)]]])
        gap = int(numbers[label[vertices[np.argmin(state)]]])
        sides.append((component, gap))
        boundaries.append(Boundary(_arcs(search.pieces, loop), component, gap))
    value = least(search.values)
    parts: tuple[list[Part], list[Part]] = ([], [])
    for part in order:
        kind = int(not is_region[part])
        around = [k for k, side in enumerate(sides) if side[kind] == numbers[part]]
        members = np.flatnonzero(label == part)
        depth = value[members] if is_region[part] else -value[members]
        deepest = members[np.argmax(depth)]
        parts[kind].append(
            Part(
                float(total[part]),
                tuple(around),
                search.points[deepest],
                float(value[deepest]),
            )
        )
    return tuple(parts[0]), tuple(parts[1]), tuple(boundaries)


def _arcs(pieces: BoundarySegments, loop: Indices) -> tuple[BorderArc, ...]:
    """Return the smooth arcs of a closed chain of pieces."""
    margin = pieces.margin[loop]
    turns = np.flatnonzero(margin != np.roll(margin, 1))
    if len(turns):
        loop = np.roll(loop, -turns[0])
        margin = np.roll(margin, -turns[0])
    starts = np.flatnonzero(np.concatenate([[True], margin[1:] != margin[:-1]]))
    arcs = []
    for chain in np.split(loop, starts[1:]):
        points = pieces.curve(chain)
        arcs.append(BorderArc(int(pieces.margin[chain[0]]), points))
    return tuple(arcs)


def _excluding(
    evaluate: Evaluator, values: Floats, spacing: float, feature: float
) -> tuple[tuple[int, ...], ...]:
    """Return the smallest sets of margins that no direction satisfies together."""
    count = values.shape[1]
    sets: list[tuple[int, ...]] = []
    for size in range(1, min(count, LARGEST_SET) + 1):
        for chosen in combinations(range(count), size):
            if any(set(smaller) <= set(chosen) for smaller in sets):
                continue
            columns = list(chosen)
            if np.any(least(values[:, columns]) >= 0.0):
                continue
            some = Evaluator(lambda places, columns=columns: evaluate(places)[:, columns])  # type: ignore[misc]
            search = Refinement(some, spacing)
            search.run(np.inf, feature, 100_000)
            if not np.any(search.inside):
                sets.append(chosen)
    return tuple(sets)
