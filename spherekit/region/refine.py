"""Triangles over the sphere, refined until a region's border and area are known.

The directions where given margins are not negative, with area, border and parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.conventions import EPS
from spherekit.errors import RegionError
from spherekit.region.border import ORDERS, BoundarySegments, corners, crossings, nearest_on
from spherekit.region.mesh import (
    Evaluator,
    Margins,
    TriangleClass,
    bisected,
    chains,
    check_positive,
    edge_lengths,
    edges_of,
    icosahedron,
    judge,
    labels,
    least,
    triangle_areas,
)
from spherekit.sphere.rotation import unit_rows

FINEST = 1e-6
"""Triangles with edges shorter than this (rad) are not cut further."""
BROKEN_SIZE = 0.05
"""Longest edge (rad) of a triangle in which the border is that of being defined."""
COST_OF_CUT = 50
"""Evaluations that cutting a triangle costs, about."""
ROUNDED = 16.0
"""A piece whose error is below this times rounding is as good as it gets."""


class Refinement:
    """The state of the search: a mesh, what is known of its triangles, and the border."""

    def __init__(self, evaluate: Evaluator, spacing: float) -> None:
        self.evaluate = evaluate
        self.points, self.triangles = icosahedron(spacing)
        self.values = evaluate(self.points)
        count = len(self.triangles)
        self.verdict = np.full(count, -1, dtype=np.intp)
        self.size = np.zeros(count)
        self.contested = np.zeros(count, dtype=bool)
        none, nothing, no = np.zeros((0, 3)), np.zeros(0, np.intp), self.contested[:0]
        place = nothing, nothing, nothing, no
        self.pieces = BoundarySegments.over(evaluate, (none, none), nothing, place, no)
        self.crossing_keys, self.crossing_points, self.crossing_margins = (
            nothing,
            none,
            nothing,
        )

    def run(self, tolerance: float, feature: float, most: int) -> None:
        """Refine until the error is at most `tolerance` (sr) or nothing more helps.

        Open triangles are cut down to `feature` (rad), and below only while that brings
        the error down to the tolerance; the work ends after `most` evaluations.
        """
        while True:
            self._judge()
            cut = (self.verdict == TriangleClass.BROKEN) & (self.size > BROKEN_SIZE)
            cut |= (self.verdict == TriangleClass.OPEN) & (self.size > feature)
            if not cut.any():
                self._bound()
                cut = (self.verdict == TriangleClass.OPEN) & (self.size > feature)
            if not cut.any():
                cut = self._improve(tolerance)
            cost = COST_OF_CUT * np.count_nonzero(cut)
            if not cost or self.evaluate.evaluations + cost > most:
                break
            self._cut(cut)
        self._bound()

    @property
    def inside(self) -> Bools:
        """Which vertices (V,) are in the region."""
        return least(self.values) >= 0.0

    @property
    def areas(self) -> Floats:
        """The areas (T,) of the triangles (sr)."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return triangle_areas(a, b, c)

    def open_area(self) -> float:
        """Return the area (sr) of the triangles of which too little is known."""
        return float(np.sum(self.areas[self.verdict == TriangleClass.OPEN]))

    def _mixed(self) -> tuple[Integers, Indices, Indices, Bools]:
        """Return what triangles with a piece of the border are divided into.

        The number (T,) of vertices inside of every triangle; for each piece the vertex with
        which it makes a fan, the third vertex of a triangle between the fan and the rest,
        and whether the region has that triangle too.
        """
        held = self.inside[self.triangles].sum(axis=1)
        odd, second, third = self._turned(self.pieces.owner)
        single = held[self.pieces.owner] == 1
        return held, np.where(single, odd, second), third, ~single & self.pieces.leading

    def area_inside(self) -> Floats:
        """Return the area (T,) of the region that each triangle accounts for.

        A piece of the border may leave its triangle: only the sum over triangles that
        hang together means something.
        """
        held, top, third, more = self._mixed()
        apex, beside = self.points[top], self.points[third]
        start, end = np.moveaxis(self.pieces.ends, 1, 0)
        part = triangle_areas(apex, start, end) + self.pieces.area
        part += np.where(more, triangle_areas(apex, beside, start), 0.0)
        area = np.where(held == 3, self.areas, 0.0)
        np.add.at(area, self.pieces.owner, part)
        return area

    def surface(self) -> tuple[Floats, Indices]:
        """Return points and triangles of the region alone, its border as it was found."""
        held, apex, third, more = self._mixed()
        pieces = self.pieces
        points, triangles = [self.points], [self.triangles[held == 3]]
        count = len(self.points)
        for order in ORDERS:
            some = np.flatnonzero(pieces.order == order)
            nodes = pieces.points(some, order)
            number = count + np.arange(nodes.shape[0] * (order + 1)).reshape(-1, order + 1)
            fan = (
                np.repeat(apex[some], order),
                number[:, :-1].ravel(),
                number[:, 1:].ravel(),
            )
            first = np.stack([apex[some], third[some], number[:, 0]], axis=1)
            triangles += [np.stack(fan, axis=1), first[more[some]]]
            points.append(nodes.reshape(-1, 3))
            count += number.size
        return np.concatenate(points), np.concatenate(triangles)

    def loops(self) -> list[Indices]:
        """Return the pieces of every closed curve of the border, in order."""
        pieces, nothing = self.pieces, np.full(len(self.crossing_keys), -1)
        first, second = nothing, nothing.copy()
        for of_corner, leads in ((first, pieces.leading), (second, ~pieces.leading)):
            of_corner[pieces.start[leads]] = np.flatnonzero(leads)
        corner = np.where(pieces.leading, second[pieces.start], -1)
        ahead = np.where(corner >= 0, corner, first[pieces.stop])
        links = np.stack([np.arange(len(ahead)), ahead], axis=1)[ahead >= 0]
        return chains(len(ahead), links, directed=True)

    def _turned(self, which: Indices) -> tuple[Indices, Indices, Indices]:
        """Return the vertices of mixed triangles, the one unlike the two others first."""
        vertices = self.triangles[which]
        held = self.inside[vertices]
        unlike = held == (held.sum(axis=1) == 1)[:, None]
        place = (np.argmax(unlike, axis=1)[:, None] + np.arange(3)) % 3
        odd, second, third = np.take_along_axis(vertices, place, axis=1).T
        return odd, second, third

    def _judge(self) -> None:
        """Sample the triangles not yet judged."""
        fresh = np.flatnonzero(self.verdict < 0)
        if not len(fresh):
            return
        triangles = self.triangles[fresh]
        self.size[fresh] = edge_lengths(self.points, triangles).max(axis=1)
        edges, sides = edges_of(triangles)
        low, high = np.moveaxis(self.points[edges], 1, 0)
        centres = self.points[triangles].sum(axis=1)
        places = unit_rows(np.concatenate([low + high, 3.0 * low + high, centres]))
        margins = self.evaluate(places)
        middle, check, centre = np.split(margins, [len(edges), 2 * len(edges)])
        rows = [self.values[triangles.T], middle[sides.T], check[sides.T], centre[None]]
        self.verdict[fresh], self.contested[fresh] = judge(
            self.points, triangles, np.concatenate(rows)
        )

    def _bound(self) -> None:
        """Find the border in the mixed triangles where it is not known yet."""
        held = self.inside[self.triangles].sum(axis=1)
        mixed = (held == 1) | (held == 2)
        self.verdict[(self.verdict == TriangleClass.BROKEN) & ~mixed] = TriangleClass.OPEN
        mixed[self.pieces.owner] = False
        fresh = np.flatnonzero(mixed)
        if not len(fresh):
            return
        smooth = np.isin(self.verdict[fresh], (TriangleClass.SIMPLE, TriangleClass.BROKEN))
        self.verdict[fresh[~smooth]] = TriangleClass.OPEN
        odd, second, third = self._turned(fresh)
        both = self._cross(odd, second), self._cross(odd, third)
        start, stop = np.where(held[fresh] == 1, both, both[::-1])
        first, last = self.crossing_margins[start], self.crossing_margins[stop]
        a, b = self.crossing_points[start], self.crossing_points[stop]
        turning = np.flatnonzero(first != last)
        pair = np.stack([first[turning], last[turning]], axis=1)
        corner, sound = corners(self.evaluate, a[turning], b[turning], pair)
        self.verdict[fresh[turning[~sound]]] = TriangleClass.OPEN
        more = turning[sound]
        middle = b.copy()
        middle[more] = corner[sound]
        owner, leading = np.append(fresh, fresh[more]), np.arange(len(fresh) + len(more))
        pieces = BoundarySegments.over(
            self.evaluate,
            (np.concatenate([a, middle[more]]), np.concatenate([middle, b[more]])),
            np.append(first, last[more]),
            (
                owner,
                np.append(start, start[more]),
                np.append(stop, stop[more]),
                leading < len(fresh),
            ),
            self.verdict[owner] != TriangleClass.OPEN,
        )
        pieces.audit(self.evaluate, np.flatnonzero(self.contested[owner] & pieces.sound))
        self.verdict[owner[~pieces.sound]] = TriangleClass.OPEN
        self.pieces = BoundarySegments.joined([self.pieces, pieces])

    def _cross(self, one: Indices, other: Indices) -> Indices:
        """Return the numbers of the crossings of edges (n,), one end inside."""
        ends = np.where(self.inside[one], [one, other], [other, one])
        keys = ends[0] << 32 | ends[1]
        fresh = np.setdiff1d(keys, self.crossing_keys)
        if len(fresh):
            inside, outside = self.points[fresh >> 32], self.points[fresh & (2**32 - 1)]
            points, margins = crossings(self.evaluate, inside, outside)
            self.crossing_keys = np.concatenate([self.crossing_keys, fresh])
            self.crossing_points = np.concatenate([self.crossing_points, points])
            self.crossing_margins = np.concatenate([self.crossing_margins, margins])
        order = np.argsort(self.crossing_keys)
        return order[np.searchsorted(self.crossing_keys, keys, sorter=order)]

    def _improve(self, tolerance: float) -> Bools:
        """Bring the error down without new triangles; return those to cut for more."""
        cut = np.zeros(len(self.triangles), dtype=bool)
        share = 0.5 * tolerance
        while True:
            pieces = self.pieces
            counted = pieces.sound & (self.verdict[pieces.owner] != TriangleClass.OPEN)
            error = np.where(counted, pieces.error, 0.0)
            error[error <= ROUNDED * EPS * pieces.length] = 0.0
            if error.sum() <= share:
                break
            poor = error > 0.5 * share / max(1, int(np.count_nonzero(counted)))
            rough = poor & (pieces.order < ORDERS[-1])
            if not rough.any():
                cut[pieces.owner[poor]] = True
                break
            pieces.raise_order(self.evaluate, np.flatnonzero(rough))
            self.verdict[pieces.owner[~pieces.sound]] = TriangleClass.OPEN
        vague = self.verdict == TriangleClass.OPEN
        area = np.where(vague, self.areas, 0.0)
        if area.sum() > share:
            cut |= vague & (area > 0.1 * area.max())
        return cut & (self.size > FINEST)

    def _cut(self, marked: Bools) -> None:
        """Cut the marked triangles, keeping what is known of the others."""
        count = len(self.points)
        self.points, self.triangles, origin = bisected(self.points, self.triangles, marked)
        self.values = np.concatenate([self.values, self.evaluate(self.points[count:])])
        kept = origin >= 0
        place = np.full(len(marked), -1, dtype=np.intp)
        place[origin[kept]] = np.flatnonzero(kept)
        self.verdict = np.where(kept, self.verdict[origin], -1)
        self.size, self.contested = self.size[origin], self.contested[origin]
        self.pieces.owner[:] = place[self.pieces.owner]
        self.pieces = self.pieces.rows(self.pieces.owner >= 0)


ROUNDING = 1e-14
"""Rounding of a sum of areas (sr), part of every error."""
LARGEST_SET = 4
"""Sets of more margins than this are not tried when a region is empty."""


@dataclass(frozen=True)
class BorderArc:
    """A smooth arc of the border: `points` (m, 3), the region to their left.

    `margin` is the number of the margin that is 0 on it, -1 where a margin is undefined
    on the other side.
    """

    margin: int
    points: Floats


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
        return least(self.values) >= 0.0

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
            return place
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
    counted = search.verdict[search.pieces.owner] != TriangleClass.OPEN
    components, gaps, boundaries = _parts(search, areas)
    return Region(
        float(np.sum(areas)),
        float(np.sum(search.pieces.error[counted])) + open_area + ROUNDING,
        open_area,
        components,
        gaps,
        boundaries,
        () if components else _excluding(evaluate, search.values, spacing, feature),
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
    triangles, inside, value = search.triangles, search.inside, least(search.values)
    edges, _ = edges_of(triangles)
    alike = inside[edges[:, 0]] == inside[edges[:, 1]]
    label = labels(len(inside), edges[alike])
    total = np.zeros(int(label.max()) + 1)
    for state, sizes in ((True, areas), (False, search.areas - areas)):
        which = np.argmax(inside[triangles] == state, axis=1)
        owner = triangles[np.arange(len(triangles)), which]
        total += np.bincount(label[owner], sizes, len(total))
    is_region = np.zeros(len(total), dtype=bool)
    is_region[label] = inside
    order = np.argsort(-total, kind="stable")
    kinds = [order[is_region[order] == state].tolist() for state in (True, False)]
    numbers = {part: number for kind in kinds for number, part in enumerate(kind)}
    boundaries = []
    for loop in search.loops():
        vertices = triangles[search.pieces.owner[loop[0]]]
        beside = (vertices[np.argmax(inside[vertices] == state)] for state in (True, False))
        component, gap = (numbers[int(label[vertex])] for vertex in beside)
        boundaries.append(Boundary(_arcs(search.pieces, loop), component, gap))

    def part_of(number: int, sides: list[int], sign: float) -> Part:
        members = np.flatnonzero(label == number)
        deepest = members[np.argmax(sign * value[members])]
        around = (k for k, side in enumerate(sides) if side == numbers[number])
        size, depth = float(total[number]), float(value[deepest])
        return Part(size, tuple(around), search.points[deepest], depth)

    components = [boundary.component for boundary in boundaries]
    gaps = [boundary.gap for boundary in boundaries]
    return (
        tuple(part_of(number, components, 1.0) for number in kinds[0]),
        tuple(part_of(number, gaps, -1.0) for number in kinds[1]),
        tuple(boundaries),
    )


def _arcs(pieces: BoundarySegments, loop: Indices) -> tuple[BorderArc, ...]:
    """Return the smooth arcs of a closed chain of pieces."""
    margin = pieces.margin[loop]
    turns = np.flatnonzero(margin != np.roll(margin, 1))
    if len(turns):
        loop = np.roll(loop, -turns[0])
    ends = np.flatnonzero(np.diff(pieces.margin[loop])) + 1
    return tuple(
        BorderArc(int(pieces.margin[chain[0]]), pieces.curve(chain))
        for chain in np.split(loop, ends)
    )


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
