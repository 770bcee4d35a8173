"""Triangles over the sphere, refined until a region's border and area are known.

The directions where given margins are not negative, with area, border and parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.errors import RegionError
from spherekit.geometry.region_border import (
    ORDERS,
    BoundarySegments,
    corners,
    crossings,
    nearest_on,
)
from spherekit.geometry.region_margins import (
    Evaluator,
    Margins,
    TriangleClass,
    check_positive,
    judge,
    least,
)
from spherekit.geometry.rotation import unit_rows
from spherekit.geometry.sphere_mesh import (
    bisected,
    chains,
    edge_lengths,
    edges_of,
    icosahedron,
    labels,
    triangle_areas,
)
from spherekit.tolerances import EPS

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
        self.verdict = np.full(count, -1)
        self.size = np.zeros(count)
        self.contested = np.zeros(count, dtype=bool)
        self.crossing_keys = self.crossing_margins = nothing = np.zeros(0, np.intp)
        self.crossing_points = none = self.points[:0]
        no = self.contested[:0]
        self.pieces = BoundarySegments.over(
            evaluate, (none, none), nothing, (nothing, nothing, nothing, no), no
        )

    def run(self, tolerance: float, feature: float, most: int) -> None:
        """Refine until the error is at most `tolerance` (sr) or nothing more helps.

        Open triangles are cut down to `feature` (rad), and below only while that brings
        the error down to the tolerance; the work ends after `most` evaluations.
        """
        while True:
            self._judge()
            cut = (self.verdict == TriangleClass.BROKEN) & (self.size > BROKEN_SIZE)
            cut |= self.open & (self.size > feature)
            if not cut.any():
                self._bound()
                cut = self.open & (self.size > feature)
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

    @property
    def open(self) -> Bools:
        """Of which triangles (T,) too little is known."""
        return self.verdict == TriangleClass.OPEN

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
        part += more * triangle_areas(apex, beside, start)
        return (held == 3) * self.areas + np.bincount(self.pieces.owner, part, len(held))

    def surface(self) -> tuple[Floats, Indices]:
        """Return points and triangles of the region alone, its border as it was found."""
        held, apex, third, more = self._mixed()
        nodes, piece = self.pieces.points(np.arange(len(apex)))
        points = np.concatenate([self.points, nodes])
        number = np.arange(len(self.points), len(points))
        starts = np.diff(piece, prepend=-1) > 0
        fan = np.stack([apex[piece], number, number + 1], axis=1)[:-1][~starts[1:]]
        first = np.stack([apex, third, number[starts]], axis=1)[more]
        return points, np.concatenate([self.triangles[held == 3], fan, first])

    def loops(self) -> list[Indices]:
        """Return the pieces of every closed curve of the border, in order."""
        pieces = self.pieces
        number = np.arange(len(self.pieces.start))
        second, first = of_start = np.full((2, len(self.crossing_keys)), -1)
        of_start[pieces.leading.astype(int), pieces.start] = number
        corner = np.where(pieces.leading, second[pieces.start], -1)
        ahead = np.where(corner >= 0, corner, first[pieces.stop])
        links = np.stack([number, ahead], axis=1)[ahead >= 0]
        return chains(len(number), links, directed=True)

    def _turned(self, which: Indices) -> Indices:
        """Return the vertices (3, n) of mixed triangles, that unlike the others first."""
        vertices = self.triangles[which]
        held = self.inside[vertices]
        unlike = held == (held.sum(axis=1) == 1)[:, None]
        place = (np.argmax(unlike, axis=1)[:, None] + np.arange(3)) % 3
        return np.take_along_axis(vertices, place, axis=1).T

    def _judge(self) -> None:
        """Sample the triangles not yet judged."""
        fresh = np.flatnonzero(self.verdict < 0)
        triangles = self.triangles[fresh]
        self.size[fresh] = edge_lengths(self.points, triangles).max(axis=1)
        edges, sides = edges_of(triangles)
        low, high = np.moveaxis(self.points[edges], 1, 0)
        centres = self.points[triangles].sum(axis=1)
        places = np.concatenate([low + high, 3.0 * low + high, centres])
        margins = self.evaluate(unit_rows(places))
        middle, check, centre = np.split(margins, [len(edges), 2 * len(edges)])
        rows = [self.values[triangles.T], middle[sides.T], check[sides.T], centre[None]]
        self.verdict[fresh], self.contested[fresh] = judge(
            self.points, triangles, np.concatenate(rows)
        )

    def _bound(self) -> None:
        """Find the border in the mixed triangles where it is not known yet."""
        held = self.inside[self.triangles].sum(axis=1)
        mixed = held % 3 != 0
        self.verdict[(self.verdict == TriangleClass.BROKEN) & ~mixed] = TriangleClass.OPEN
        mixed[self.pieces.owner] = False
        self.verdict[mixed & (self.verdict < TriangleClass.SIMPLE)] = TriangleClass.OPEN
        fresh = np.flatnonzero(mixed)
        odd, second, third = self._turned(fresh)
        both = self._cross(odd, second), self._cross(odd, third)
        ends = np.where(held[fresh] == 1, both, both[::-1])
        margins = self.crossing_margins[ends]
        (a, b) = self.crossing_points[ends]
        turning = np.flatnonzero(margins[0] != margins[1])
        pair = margins[:, turning].T
        corner, sound = corners(self.evaluate, a[turning], b[turning], pair)
        self.verdict[fresh[turning[~sound]]] = TriangleClass.OPEN
        more, corner = turning[sound], corner[sound]
        middle = b.copy()
        middle[more] = corner
        every = np.append(np.arange(len(fresh)), more)
        owner = fresh[every]
        pieces = BoundarySegments.over(
            self.evaluate,
            (np.concatenate([a, corner]), np.concatenate([middle, b[more]])),
            np.append(margins[0], margins[1, more]),
            (owner, *ends[:, every], np.arange(len(every)) < len(fresh)),
            ~self.open[owner],
        )
        pieces.audit(self.evaluate, np.flatnonzero(self.contested[owner] & pieces.sound))
        self.verdict[owner[~pieces.sound]] = TriangleClass.OPEN
        self.pieces = BoundarySegments.joined([self.pieces, pieces])

    def _cross(self, one: Indices, other: Indices) -> Indices:
        """Return the numbers of the crossings of edges (n,), one end inside."""
        ends = np.where(self.inside[one], [one, other], [other, one])
        keys = ends[0] << 32 | ends[1]
        fresh = np.setdiff1d(keys, self.crossing_keys)
        points, margins = crossings(
            self.evaluate, self.points[fresh >> 32], self.points[fresh & (2**32 - 1)]
        )
        self.crossing_keys = np.append(self.crossing_keys, fresh)
        self.crossing_points = np.concatenate([self.crossing_points, points])
        self.crossing_margins = np.append(self.crossing_margins, margins)
        order = np.argsort(self.crossing_keys)
        return order[np.searchsorted(self.crossing_keys, keys, sorter=order)]

    def _improve(self, tolerance: float) -> Bools:
        """Bring the error down without new triangles; return those to cut for more."""
        cut = np.zeros(len(self.triangles), dtype=bool)
        pieces, share = self.pieces, 0.5 * tolerance
        while True:
            counted = ~self.open[pieces.owner]
            poor = counted & (pieces.error > ROUNDED * EPS * pieces.length)
            error = np.where(poor, pieces.error, 0.0)
            if error.sum() <= share:
                break
            poor = error > 0.5 * share / np.count_nonzero(counted)
            rough = poor & (pieces.order < ORDERS[-1])
            if not rough.any():
                cut[pieces.owner[poor]] = True
                break
            pieces.raise_order(self.evaluate, np.flatnonzero(rough))
            self.verdict[pieces.owner[~pieces.sound]] = TriangleClass.OPEN
        area = self.open * self.areas
        if area.sum() > share:
            cut |= area > 0.1 * area.max()
        return cut & (self.size > FINEST)

    def _cut(self, marked: Bools) -> None:
        """Cut the marked triangles, keeping what is known of the others."""
        count = len(self.points)
        self.points, self.triangles, origin = bisected(self.points, self.triangles, marked)
        self.values = np.concatenate([self.values, self.evaluate(self.points[count:])])
        place = np.full(len(marked) + 1, -1)
        place[origin] = np.arange(len(origin))
        self.verdict = np.where(origin >= 0, self.verdict[origin], -1)
        self.size = self.size[origin]
        self.contested = self.contested[origin]
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
        return np.concatenate(
            [*(arc.points[:-1] for arc in self.arcs), self.arcs[0].points[:1]]
        )

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
                "the region is empty, so no point of it is nearest; sets of margins that "
                f"exclude each other: {self.excluding}"
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
    check_positive(
        {"tolerance": tolerance, "spacing": spacing, "feature": feature, "most": most}
    )
    evaluate = Evaluator(margins)
    search = Refinement(evaluate, spacing)
    search.run(tolerance, feature, most)
    areas = search.area_inside()
    unresolved = float(np.sum(search.areas[search.open]))
    counted = ~search.open[search.pieces.owner]
    components, gaps, boundaries = _parts(search, areas)
    return Region(
        float(np.sum(areas)),
        float(np.sum(search.pieces.error[counted])) + unresolved + ROUNDING,
        unresolved,
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
    triangles, value = search.triangles, least(search.values)
    inside = value >= 0.0
    edges, _ = edges_of(triangles)
    label = labels(len(inside), edges[inside[edges[:, 0]] == inside[edges[:, 1]]])
    held = inside[triangles]
    which = np.stack([np.argmax(held, axis=1), np.argmin(held, axis=1)], axis=1)
    beside = label[np.take_along_axis(triangles, which, axis=1)]
    sizes = np.stack([areas, search.areas - areas], axis=1)
    total = np.bincount(beside.ravel(), sizes.ravel(), label.max() + 1)
    order = np.argsort(-total, kind="stable")
    kinds = [order[np.isin(order, label[some])].tolist() for some in (inside, ~inside)]
    numbers = {part: number for kind in kinds for number, part in enumerate(kind)}
    loops = search.loops()
    sides = [beside[search.pieces.owner[loop[0]]].tolist() for loop in loops]

    def part_of(part: int) -> Part:
        members = np.flatnonzero(label == part)
        deepest = members[np.argmax(np.abs(value[members]))]
        around = tuple(k for k, side in enumerate(sides) if part in side)
        depth = float(value[deepest])
        return Part(float(total[part]), around, search.points[deepest], depth)

    boundaries = (
        Boundary(_arcs(search.pieces, loop), numbers[component], numbers[gap])
        for loop, (component, gap) in zip(loops, sides, strict=True)
    )
    components, gaps = (tuple(map(part_of, kind)) for kind in kinds)
    return components, gaps, tuple(boundaries)


def _arcs(pieces: BoundarySegments, loop: Indices) -> tuple[BorderArc, ...]:
    """Return the smooth arcs of a closed chain of pieces."""
    margin = pieces.margin[loop]
    loop = np.roll(loop, -np.argmax(margin != np.roll(margin, 1)))
    ends = np.flatnonzero(np.diff(pieces.margin[loop])) + 1
    return tuple(
        BorderArc(int(pieces.margin[chain[0]]), pieces.curve(chain))
        for chain in np.split(loop, ends)
    )


def _excluding(
    evaluate: Evaluator, values: Floats, spacing: float, feature: float
) -> tuple[tuple[int, ...], ...]:
    """Return the smallest sets of margins that no direction satisfies together."""

    def empty(some: tuple[int, ...]) -> bool:
        if np.any(least(values[:, some]) >= 0.0):
            return False
        search = Refinement(Evaluator(lambda places: evaluate(places)[:, some]), spacing)
        search.run(np.inf, feature, 100_000)
        return not search.inside.any()

    sets: list[tuple[int, ...]] = []
    for size in range(1, LARGEST_SET + 1):
        for some in combinations(range(values.shape[1]), size):
            if not any(set(smaller) <= set(some) for smaller in sets) and empty(some):
                sets.append(some)
    return tuple(sets)
