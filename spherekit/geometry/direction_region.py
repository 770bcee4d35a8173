"""Regions of directions in which margins are at least 0: area, border and parts."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import RegionError
from spherekit.geometry.border_segment import BorderSegments, find_nearest_point
from spherekit.geometry.region_margins import (
    MarginEvaluator,
    Margins,
    require_positive,
    smallest_margins,
)
from spherekit.geometry.region_refinement import RegionRefinement
from spherekit.geometry.sphere_mesh import list_edges
from spherekit.geometry.vectors import max_abs, unit_rows
from spherekit.numerics.connectivity import label_components

AREA_ROUNDING_SR = 1e-14
"""Rounding error of a sum of areas (sr), a part of every error."""

MAX_EXCLUDING_MARGINS = 4
"""Largest number of margins that are tried together as the reason why a region is empty."""

EVALUATIONS_PER_SET = 100_000
"""Evaluations of margins after which the search for one such set of margins ends."""


@dataclass(frozen=True)
class BorderArc:
    """A smooth arc of the border of a region on the unit sphere.

    The region has the directions in which all margins (functions of the direction) are at
    least 0.

    Attributes
    ----------
    margin
        Index of the margin that is 0 on the arc. -1 if the region ends at the arc because a
        margin is undefined beyond it.
    points
        (m, 3) unit vectors along the arc, with the region to their left, seen from outside
        the sphere.
    """

    margin: int
    points: Floats


@dataclass(frozen=True)
class Boundary:
    """A closed curve of the border of a region of directions.

    The region has the directions in which all margins (functions of the direction) are at
    least 0. The connected parts of the region are called components. The connected parts of
    the outside are called gaps.

    Attributes
    ----------
    arcs
        Smooth arcs of the curve, in order. One margin is 0 along each arc.
    component
        Index of the component on the left of the curve, seen from outside the sphere.
    gap
        Index of the gap on the right of the curve.
    """

    arcs: tuple[BorderArc, ...]
    component: int
    gap: int

    @property
    def points(self) -> Floats:
        """Points (m, 3) of the whole curve, the first repeated at the end."""
        return np.concatenate(
            [*(arc.points[:-1] for arc in self.arcs), self.arcs[0].points[:1]]
        )

    @property
    def corners(self) -> Floats:
        """Points (c, 3) at which arcs with different margins meet."""
        # A single arc is a smooth closed curve without corners.
        corner_arcs = self.arcs if len(self.arcs) > 1 else ()
        starts = [arc.points[0] for arc in corner_arcs]
        return np.reshape(starts, (-1, 3))


@dataclass(frozen=True)
class Part:
    """A connected part of a region of directions, or of the directions outside of it.

    In the region all margins (functions of the direction) are at least 0. The depth of a
    direction is its smallest margin, which is negative outside.

    Attributes
    ----------
    area
        Area (sr).
    boundaries
        Indices of the closed boundary curves around the part.
    place
        (3,) unit vector: of the vertices of the mesh in this part, the one that is farthest
        inside the part. Its depth has the largest absolute value.
    depth
        Depth of this vertex, negative for a part of the outside.
    """

    area: float
    boundaries: tuple[int, ...]
    place: Floats
    depth: float


@dataclass(frozen=True)
class Region:
    """The directions in which all margins are at least 0.

    A margin is a function of the direction that is negative where, for example, a limit is
    exceeded. The region was measured with a mesh of triangles on the unit sphere.

    Attributes
    ----------
    area
        Area of the region (sr).
    error
        Bound of the error of the area (sr). The bound has two parts: the change of the area
        if the order of the border curves is halved, and the area of all unresolved
        triangles.
    unresolved
        Area (sr) of the triangles in which too little is known about the border. Such
        triangles contain tangent borders, corners sharper than 0.25 rad, or the border of
        where a margin is defined.
    components
        Connected parts, the largest first. A part with an area below `unresolved` may be
        connected to another part. The area of such a part can be negative by its error.
    gaps
        Connected parts of the outside, the largest first. All but the first are holes.
    boundaries
        Closed curves between a component and a gap.
    excluding
        For an empty region, the smallest sets of margins that no direction satisfies
        together, as indices of margins. Sets of more than `MAX_EXCLUDING_MARGINS` margins
        are not searched, so there may be none.
    points
        (V, 3) vertices of the mesh.
    triangles
        (T, 3) indices of the vertices of each triangle, counter-clockwise seen from
        outside.
    values
        (V, k) margins at the vertices, NaN where a margin is undefined.
    surface_points
        (P, 3) points, first the vertices of the mesh, then points of the border.
    surface_triangles
        (F, 3) triangles between these points, which cover only the region, up to its
        border.
    evaluations
        Number of directions at which the margins were evaluated.
    calls
        Number of calls of the function of the margins.
    border
        The segments of the border, which `nearest` uses.
    margins
        The function of the margins, which `nearest` uses.
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
    border: BorderSegments = field(repr=False)
    margins: Margins = field(repr=False)

    @property
    def inside(self) -> Bools:
        """Whether each vertex (V,) of the mesh is in the region."""
        return smallest_margins(self.values) >= 0.0

    @property
    def holes(self) -> tuple[Part, ...]:
        """The holes of the region: all gaps except the largest."""
        return self.gaps[1:]

    def nearest(self, point: Sequence[float] | Floats) -> Floats:
        """Return the unit vector (3,) of the region that is nearest to a direction (3,).

        The region has the directions in which all margins are at least 0. Margins are
        functions of the direction, such as a distance to a limit. A direction inside the
        region is returned itself, scaled to length 1.

        Raises
        ------
        RegionError
            The region is empty, or the direction is not a vector. Or the direction is in a
            hole that the mesh missed, and no border is known.
        """
        direction = _unit_direction(point)
        # `sampled` has known values, from which the evaluator estimates rounding errors.
        evaluate = MarginEvaluator(self.margins, sampled=self.values)
        if smallest_margins(evaluate(direction[None]))[0] >= 0.0:
            return direction
        # Outside, the nearest point is on the border. `border.margin` has one item for each
        # segment of the border. If there is no segment, the region is empty, or it is the
        # whole sphere except for holes between the samples.
        if len(self.border.margin):
            return find_nearest_point(self.border, evaluate, direction)
        if self.components:
            raise RegionError(
                "the direction is in a hole of the region that the search missed, so its "
                "border is not known; find the region with a smaller spacing"
            )
        reason = f"sets of margins that exclude each other: {self.excluding}"
        if not self.excluding:
            reason = f"no set of at most {MAX_EXCLUDING_MARGINS} margins is the reason"
        raise RegionError(f"the region is empty, so no point of it is nearest; {reason}")


def _unit_direction(point: Sequence[float] | Floats) -> Floats:
    """Return the unit vector (3,) of a direction (3,) of any length.

    Raises
    ------
    RegionError
        If the direction is not three finite numbers, or if all are 0.
    """
    try:
        direction = np.asarray(point, dtype=float)
    except (TypeError, ValueError):
        direction = np.zeros(0)  # a wrong shape, which is refused below
    largest = max_abs(direction)
    if direction.shape != (3,) or not 0.0 < largest < np.inf:
        raise RegionError(
            f"{point!r} is not a direction; give three finite numbers, not all 0"
        )
    # Squares of huge or tiny components would leave the range of numbers.
    return unit_rows(direction / largest)


def find_region(
    margins: Margins,
    tolerance: float = 1e-4,
    spacing: float = 0.2,
    feature: float = 1e-3,
    most: int = 1_000_000,
) -> Region:
    """Return the region of directions in which all margins are at least 0.

    A margin is a function of the direction that is negative where, for example, a limit is
    exceeded. The sphere is covered with triangles, which are cut until the border of the
    region in them is known.

    Parameters
    ----------
    margins
        Function of unit vectors (n, 3) that returns margins (n, k). Margins should be
        smooth across the border. A margin that ends or jumps at the border takes far more
        evaluations. A direction in which a margin is NaN counts as outside.
    tolerance
        Required error of the area (sr). `Region.error` is the error that was reached.
    spacing
        Longest edge (rad) of the first triangles, which are sampled at half of it. Narrower
        features of margins that do not affect the samples are missed.
    feature
        Triangles in which a part of the region, or a hole, may be hidden are cut until
        their edges are shorter than this (rad). Smaller ones are cut only if the tolerance
        requires it.
    most
        Evaluations after which the search ends.

    Raises
    ------
    RegionError
        A size is not positive and finite. The margins do not return a row for each place,
        or not the same number of margins in every call, or an infinite margin.
    """
    require_positive(
        {"tolerance": tolerance, "spacing": spacing, "feature": feature, "most": most}
    )
    evaluate = MarginEvaluator(margins)
    refinement = RegionRefinement(evaluate, spacing)
    refinement.refine(tolerance, feature, most)
    areas_inside = refinement.areas_inside()
    # In open triangles too little is known. Their whole area counts as error.
    unresolved = float(np.sum(refinement.areas[refinement.is_open]))
    is_counted = ~refinement.is_open[refinement.segments.triangle]
    segment_error = float(np.sum(refinement.segments.error[is_counted]))
    components, gaps, boundaries = _find_parts(refinement, areas_inside)
    excluding: tuple[tuple[int, ...], ...] = ()
    if not components:
        excluding = _find_excluding_sets(evaluate, refinement.values, spacing, feature)
    surface_points, surface_triangles = refinement.surface()
    return Region(
        area=float(np.sum(areas_inside)),
        error=segment_error + unresolved + AREA_ROUNDING_SR,
        unresolved=unresolved,
        components=components,
        gaps=gaps,
        boundaries=boundaries,
        excluding=excluding,
        points=refinement.points,
        triangles=refinement.triangles,
        values=refinement.values,
        surface_points=surface_points,
        surface_triangles=surface_triangles,
        evaluations=evaluate.evaluations,
        calls=evaluate.calls,
        border=refinement.segments,
        margins=margins,
    )


def _find_parts(
    refinement: RegionRefinement, areas_inside: Floats
) -> tuple[tuple[Part, ...], tuple[Part, ...], tuple[Boundary, ...]]:
    """Return the parts of the region and of the outside, and the curves between them.

    Parameters
    ----------
    refinement
        The refined mesh with the border.
    areas_inside
        (T,) area of the region (sr) in each triangle.

    Returns
    -------
    components
        Connected parts of the region, the largest first.
    gaps
        Connected parts of the outside of the region, the largest first.
    boundaries
        Closed curves between a component and a gap.
    """
    triangles = refinement.triangles
    depth = smallest_margins(refinement.values)
    is_inside = depth >= 0.0

    # Vertices belong to one part if edges that the border does not cut connect them.
    edges, _ = list_edges(triangles)
    is_uncut = is_inside[edges[:, 0]] == is_inside[edges[:, 1]]
    part_of_vertex = label_components(len(is_inside), edges[is_uncut])

    # For each triangle, one vertex inside and one outside stand for its two parts. In a
    # triangle without a border both are the same vertex, and one of its two areas is 0.
    inside_corners = is_inside[triangles]
    corners = np.stack(
        [np.argmax(inside_corners, axis=1), np.argmin(inside_corners, axis=1)], axis=1
    )
    parts_of_triangle = part_of_vertex[np.take_along_axis(triangles, corners, axis=1)]
    areas = np.stack([areas_inside, refinement.areas - areas_inside], axis=1)
    part_areas = np.bincount(
        parts_of_triangle.ravel(), areas.ravel(), part_of_vertex.max() + 1
    )

    # Parts of the region (components) and of the outside (gaps), the largest first.
    by_size = np.argsort(-part_areas, kind="stable")
    inside_parts = by_size[np.isin(by_size, part_of_vertex[is_inside])].tolist()
    outside_parts = by_size[np.isin(by_size, part_of_vertex[~is_inside])].tolist()
    component_numbers = {part: number for number, part in enumerate(inside_parts)}
    gap_numbers = {part: number for number, part in enumerate(outside_parts)}

    # The closed curves of the border, with the parts on both sides.
    boundaries = []
    parts_of_boundary = []
    for loop in refinement.border_loops():
        triangle = refinement.segments.triangle[loop[0]]
        inside_part, outside_part = parts_of_triangle[triangle].tolist()
        parts_of_boundary.append((inside_part, outside_part))
        boundaries.append(
            Boundary(
                arcs=_split_into_arcs(refinement.segments, loop),
                component=component_numbers[inside_part],
                gap=gap_numbers[outside_part],
            )
        )

    def make_part(part: int) -> Part:
        """Return a part of the region or of the outside, given by its index."""
        vertices = np.flatnonzero(part_of_vertex == part)
        deepest = vertices[np.argmax(np.abs(depth[vertices]))]
        return Part(
            area=float(part_areas[part]),
            boundaries=tuple(
                number for number, parts in enumerate(parts_of_boundary) if part in parts
            ),
            place=refinement.points[deepest],
            depth=float(depth[deepest]),
        )

    components = tuple(make_part(part) for part in inside_parts)
    gaps = tuple(make_part(part) for part in outside_parts)
    return components, gaps, tuple(boundaries)


def _split_into_arcs(segments: BorderSegments, loop: Indices) -> tuple[BorderArc, ...]:
    """Return the smooth arcs of a closed border curve.

    The region has several margins, functions that are at least 0 inside. The border
    consists of segments (pieces), and one of the margins is 0 on each segment. An arc
    consists of successive segments on which the same margin is 0.

    Parameters
    ----------
    segments
        The segments of all border curves.
    loop
        (n,) numbers of the segments of the closed curve, in order.
    """
    # (n,) number of the margin that is 0 on each segment.
    margin = segments.margin[loop]
    # The loop is rotated so that an arc begins at its first segment.
    begins_arc = margin != np.roll(margin, 1)
    loop = np.roll(loop, -np.argmax(begins_arc))
    later_starts = np.flatnonzero(np.diff(segments.margin[loop])) + 1
    arcs = []
    for chain in np.split(loop, later_starts):
        margin_of_arc = int(segments.margin[chain[0]])
        arcs.append(BorderArc(margin_of_arc, segments.polyline(chain)))
    return tuple(arcs)


def _find_excluding_sets(
    evaluate: MarginEvaluator, values: Floats, spacing: float, feature: float
) -> tuple[tuple[int, ...], ...]:
    """Return the smallest sets of margins that no direction satisfies together.

    These sets explain to the user why a region is empty. A direction satisfies a margin
    (function of the direction) that is at least 0 there.

    Parameters
    ----------
    evaluate
        Returns all k margins.
    values
        (V, k) margins at V directions that are already known.
    spacing
        Longest edge (rad) of the triangles with which the search begins.
    feature
        Size (rad) of the smallest part of a region to be found. A triangle may contain such
        a part although no computed direction is in the part. These triangles are cut until
        their edges are shorter than this size.

    Returns
    -------
    Sets of at most `MAX_EXCLUDING_MARGINS` indices of margins. No set contains another one.
    """

    def excludes_all(margins: tuple[int, ...]) -> bool:
        """Return whether no direction satisfies the margins with these numbers."""
        if np.any(smallest_margins(values[:, margins]) >= 0.0):
            return False
        # Search the region in which only these margins count.
        selected = MarginEvaluator(lambda points: evaluate(points)[:, margins])
        refinement = RegionRefinement(selected, spacing)
        # Only the existence of a region matters, so the tolerance of its area is infinite.
        refinement.refine(
            tolerance=np.inf, feature=feature, max_evaluations=EVALUATIONS_PER_SET
        )
        return not refinement.is_inside.any()

    # Small sets are tried first. A larger set that contains an excluding set is skipped.
    excluding: list[tuple[int, ...]] = []
    for size in range(1, MAX_EXCLUDING_MARGINS + 1):
        for margins in combinations(range(values.shape[1]), size):
            contains_smaller = any(set(smaller) <= set(margins) for smaller in excluding)
            if not contains_smaller and excludes_all(margins):
                excluding.append(margins)
    return tuple(excluding)
