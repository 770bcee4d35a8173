"""A mesh over the sphere that is refined until the border of a region is known.

Each triangle of the mesh has a class (`spherekit.geometry.triangle_class`). Triangles that
may hide a part of the region are cut. In triangles that the border crosses, the border is
stored as `BorderSegments`. The triangles and the segments together give the area of the
region, its surface and its border curves.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.geometry.border_point import find_corners, find_crossings
from spherekit.geometry.border_segment import ORDERS, BorderSegments
from spherekit.geometry.region_margins import MarginEvaluator, smallest_margins
from spherekit.geometry.sphere_mesh import (
    bisect_triangles,
    icosahedron,
    list_edges,
    measure_edges,
    triangle_areas,
)
from spherekit.geometry.triangle_class import TriangleClass, classify_triangles
from spherekit.geometry.vectors import unit_rows
from spherekit.numerics.connectivity import order_chains
from spherekit.tolerances import EPS

MIN_EDGE_RAD = 1e-6
"""Triangles with shorter edges are not cut to reach the tolerance of the area."""

MAX_BROKEN_EDGE_RAD = 0.05
"""A triangle with a longer edge is cut if the margins are defined in only a part of it."""

EVALUATIONS_PER_CUT = 50
"""Approximate number of evaluations that cutting a triangle costs."""

ROUNDING_FACTOR = 16.0
"""A segment is not improved further if its error is below this times the rounding error."""

UNCLASSIFIED = -1
"""Class of a new triangle."""


@dataclass(frozen=True)
class TriangleDivision:
    r"""How the border of a region divides the triangles of a mesh that it crosses.

    The area of a region is summed over the triangles inside. Triangles that the border
    crosses are divided first, so that only their part inside the region counts. A mesh has
    T triangles. The border in one of them is a segment, a smooth curve given by several
    nodes. There are n segments, which run with the region on their left. The region in a
    triangle is a fan, and an extra triangle if two vertices are inside::

        one vertex inside: A        two vertices inside: A and B

                 A                              C
                /|\                            / \
        start  *-*-*  stop             stop   *-*-*  start
              /     \                        /    _.\
             /       \                      / _.-'   \
            C --------- D                 A ---------- B

    - The fan consists of small triangles between a vertex inside (the apex A) and two
      neighbouring nodes of the segment.
    - The extra triangle is A, B, start.

    If the border has a corner in a triangle, it consists of two segments there. Both have
    fans from the same apex, and the first one has the extra triangle.

    Attributes
    ----------
    inside_count
        (T,) for every triangle of the mesh, the number of its vertices inside the region.
    apex
        (n,) vertex number of the apex A of each segment.
    other_inside
        (n,) vertex number of the other vertex inside, B. Without an extra triangle the
        number has no meaning.
    has_extra_triangle
        (n,) whether the region contains the extra triangle.
    """

    inside_count: Integers
    apex: Indices
    other_inside: Indices
    has_extra_triangle: Bools

    def fan_triangles(self, node: Indices, segment: Indices) -> Indices:
        """Return the triangles of the fans, as numbers of their three corners.

        Parameters
        ----------
        node
            (m,) numbers of the nodes of all segments, in the order of the segments.
        segment
            (m,) number of the segment of each node.
        """
        # A triangle joins the apex to a node and to the next node of the same segment.
        has_next_node = segment[:-1] == segment[1:]
        corners = [self.apex[segment[:-1]], node[:-1], node[1:]]
        return np.stack(corners, axis=1)[has_next_node]

    def extra_triangles(self, start_node: Indices) -> Indices:
        """Return the extra triangles, as numbers of their three corners.

        Parameters
        ----------
        start_node
            (n,) number of the first node of each segment.
        """
        corners = [self.apex, self.other_inside, start_node]
        return np.stack(corners, axis=1)[self.has_extra_triangle]


class RegionRefinement:
    """Refines a mesh of triangles on the sphere and finds the border of a region in it.

    The region has the directions in which all margins (functions of the direction) are at
    least 0. A segment is the border in one triangle, as a curve beside the arc of a great
    circle.

    Parameters
    ----------
    evaluate
        The margins of the region.
    spacing
        Longest edge (rad) of the first triangles.

    Attributes
    ----------
    points, triangles, values
        (V, 3) vertices, (T, 3) vertex numbers, counter-clockwise seen from outside, and
        (V, k) margins at the vertices.
    classes
        (T,) `TriangleClass`, or `UNCLASSIFIED`.
    longest_edges
        (T,) longest edge (rad) of each classified triangle.
    has_several_uncertain
        (T,) whether several margins may be positive or negative in a triangle. One of them
        may then cut off a part of the region beyond the border of another one.
    segments
        The border in the triangles where it is known.
    """

    def __init__(self, evaluate: MarginEvaluator, spacing: float) -> None:
        """Make the first triangle mesh, in which the border of the region is not known yet.

        The region consists of the directions in which all margins are at least 0. A margin
        is a function of the direction.

        Parameters
        ----------
        evaluate
            Function that evaluates the margins of directions.
        spacing
            Longest edge (rad) of the first triangles.
        """
        self.evaluate = evaluate
        self.points, self.triangles = icosahedron(spacing)
        self.values = evaluate(self.points)  # margins at the vertices
        # `_classify` computes these for each triangle: its class, which says whether the
        # border crosses it; its longest edge (rad); and whether several margins may have
        # either sign in it.
        count = len(self.triangles)
        self.classes = np.full(count, UNCLASSIFIED)
        self.longest_edges = np.zeros(count)
        self.has_several_uncertain = np.zeros(count, dtype=bool)

        # `_find_border` finds the points at which edges cross the border, and the segments
        # of the border between them, one or two in each triangle that it crosses.
        #
        # A crossing has a key, the number of the margin that is zero there, and a point.
        # The key has the number of the edge's vertex inside the region in its upper 32
        # bits, and that of the vertex outside in its lower ones.
        self._crossing_keys = np.zeros(0, np.intp)
        self._crossing_margins = np.zeros(0, np.intp)
        self._crossing_points = np.zeros((0, 3))
        self.segments = BorderSegments.empty()

    def refine(self, tolerance: float, feature: float, max_evaluations: int) -> None:
        """Cut triangles of the mesh until the area of the region is accurate enough.

        Each triangle has a class. It is *open* if a part of the region, or a hole, may be
        hidden in it. It is *broken* if the margins, the functions that are at least 0 in
        the region, are defined in a part of it only. Each round takes the first of these
        steps that finds triangles to cut:

        1. Classify the new triangles. Cut the large triangles that are open or broken.
        2. Search the border in the triangles that it crosses. A triangle in which it is not
           found becomes open. Cut the large ones.
        3. If the error of the area exceeds the tolerance, cut the triangles that cause it.

        Parameters
        ----------
        tolerance
            Error of the area (sr) at which the refinement ends.
        feature
            Smallest size (rad) of parts and holes of the region that are to be found. An
            open triangle is large if it has a longer edge. Smaller ones are cut in the
            third step only.
        max_evaluations
            Number of points at which the margins may be evaluated. The refinement ends
            before a cut that would exceed it.
        """
        while True:
            # Step 1.
            self._classify()
            is_cut = self.classes == TriangleClass.BROKEN
            is_cut &= self.longest_edges > MAX_BROKEN_EDGE_RAD
            is_cut |= self.is_open & (self.longest_edges > feature)
            if not is_cut.any():
                # Step 2. This call can make triangles open.
                self._find_border()
                is_cut = self.is_open & (self.longest_edges > feature)
            if not is_cut.any():
                # Step 3.
                is_cut = self._reduce_error(tolerance)
            cost = EVALUATIONS_PER_CUT * np.count_nonzero(is_cut)
            if not cost or self.evaluate.evaluations + cost > max_evaluations:
                break
            self._cut(is_cut)
        # If the limit of evaluations ends the loop after step 1, the border in the newest
        # triangles has not been searched yet. In all other cases this call does nothing.
        self._find_border()

    @property
    def is_inside(self) -> Bools:
        """Whether each vertex (V,) is in the region."""
        return smallest_margins(self.values) >= 0.0

    @property
    def areas(self) -> Floats:
        """Areas (T,) of the triangles (sr)."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return triangle_areas(a, b, c)

    @property
    def is_open(self) -> Bools:
        """(T,) whether a triangle may hide a part of the region, or a hole of it."""
        return self.classes == TriangleClass.OPEN

    def areas_inside(self) -> Floats:
        """Return the area (T,) of the region (sr) that is assigned to each triangle.

        A triangle with all three vertices inside is counted as a whole. If one or two are
        inside, the border of the region crosses the triangle in a segment from start to
        end. The chord is the great-circle arc between these points. The area is the sum of:

        - the triangle of the chord and of one vertex inside, the apex;
        - the area between the chord and the segment, negative if the segment bends inwards;
        - if two vertices are inside, the triangle of both and of the start of the segment.

        If a segment bends out of its triangle, the area beyond the edge is still assigned
        to this triangle. Only sums over connected triangles are therefore exact.
        """
        division = self._divide_triangles()
        apex = self.points[division.apex]
        other_inside = self.points[division.other_inside]
        start, end = np.moveaxis(self.segments.ends, 1, 0)
        part = triangle_areas(apex, start, end) + self.segments.area
        part += division.has_extra_triangle * triangle_areas(apex, other_inside, start)
        count = division.inside_count
        whole_triangles = (count == 3) * self.areas
        return whole_triangles + np.bincount(self.segments.triangle, part, len(count))

    def surface(self) -> tuple[Floats, Indices]:
        """Return a triangulation of the region alone, up to its border.

        Triangles of the mesh with all vertices inside the region are taken as they are.
        Triangles that the border crosses are divided, and only their part inside is taken.
        The border in a triangle is a segment, a curve given by several nodes. The part
        inside is a fan of triangles between one vertex, the apex, and these nodes. If
        another vertex is inside, an extra triangle joins it to the apex and to the first
        node.

        Returns
        -------
        points
            (P, 3) unit vectors: the vertices of the mesh, then the nodes of the border.
        triangles
            (F, 3) numbers of points.
        """
        division = self._divide_triangles()
        # The nodes of all segments, one segment after another.
        segment_count = len(self.segments.start)
        border_points, segment = self.segments.node_points(np.arange(segment_count))
        points = np.concatenate([self.points, border_points])
        node = np.arange(len(self.points), len(points))  # numbers of the border points
        is_start = np.diff(segment, prepend=-1) > 0

        whole_triangles = self.triangles[division.inside_count == 3]
        fan_triangles = division.fan_triangles(node, segment)
        extra_triangles = division.extra_triangles(node[is_start])
        return points, np.concatenate([whole_triangles, fan_triangles, extra_triangles])

    def border_loops(self) -> list[Indices]:
        """Return the closed curves of the border, as segment numbers in their order.

        A segment is the border in one triangle, or a part of it up to a corner.
        """
        segment_count = len(self.segments.start)
        next_segment = self._find_next_segments()
        has_next = next_segment >= 0
        links = np.stack([np.arange(segment_count), next_segment], axis=1)[has_next]
        return order_chains(segment_count, links, directed=True)

    def _find_next_segments(self) -> Indices:
        """Return the number of the segment (n,) that follows each one, -1 if there is none.

        The border enters a triangle at a crossing of one edge and leaves it at a crossing
        of another edge. There are two sorts of segments:

        - The leading segment of a triangle begins where the border enters. It ends where
          the border leaves, or else at a corner of the border within the triangle.
        - A second segment follows after a corner, and ends where the border leaves.

        Both segments of a triangle store both crossings, `start` and `stop`.
        """
        segments = self.segments
        leading = np.flatnonzero(segments.is_leading)
        second = np.flatnonzero(~segments.is_leading)
        # For each crossing, the segments in the triangle that the border enters there.
        leading_after = np.full(len(self._crossing_keys), -1)
        leading_after[segments.start[leading]] = leading
        second_after = np.full(len(self._crossing_keys), -1)
        second_after[segments.start[second]] = second

        # The border continues in the next triangle, except after a leading segment that
        # ends at a corner.
        next_segment = leading_after[segments.stop]
        second_in_triangle = second_after[segments.start]
        ends_at_corner = segments.is_leading & (second_in_triangle >= 0)
        next_segment[ends_at_corner] = second_in_triangle[ends_at_corner]
        return next_segment

    def _divide_triangles(self) -> TriangleDivision:
        """Return how the segments of the border divide their triangles.

        A segment is the border in one triangle, with the region on its left. If one vertex
        is inside, it is the apex of the fan. If two are inside, the apex is the one that is
        farther from the start of the segment. The fan then leaves out the triangle of both
        vertices and the start.
        """
        inside_count = self.is_inside[self.triangles].sum(axis=1)
        # The odd vertex is the only one inside, or the only one outside. The others follow
        # counter-clockwise.
        odd, second, third = self._odd_vertex_first(self.segments.triangle)
        has_one_inside = inside_count[self.segments.triangle] == 1
        # If the border has a corner, it consists of two segments in this triangle, and only
        # the first (leading) one starts on an edge.
        has_extra_triangle = ~has_one_inside & self.segments.is_leading
        return TriangleDivision(
            inside_count=inside_count,
            apex=np.where(has_one_inside, odd, second),
            other_inside=third,
            has_extra_triangle=has_extra_triangle,
        )

    def _odd_vertex_first(self, selected: Indices) -> Indices:
        """Return the vertices (3, n) of triangles that the border crosses.

        The first vertex is inside the region while both others are outside, or the reverse.
        The order around the triangle is unchanged.
        """
        # If one vertex is inside, the odd one is inside. If two are, it is outside.
        vertices = self.triangles[selected]
        is_inside = self.is_inside[vertices]
        is_odd = is_inside == (is_inside.sum(axis=1) == 1)[:, None]
        position = (np.argmax(is_odd, axis=1)[:, None] + np.arange(3)) % 3
        return np.take_along_axis(vertices, position, axis=1).T

    def _classify(self) -> None:
        """Sample the margins in the new triangles, and classify these.

        Margins are functions of the direction that are at least 0 in the region. A class
        says whether the triangle is inside or outside the region, or whether the border
        crosses it. `classes`, `longest_edges` and `has_several_uncertain` are updated. The
        last one says whether several margins may have either sign in a triangle.

        In a triangle, each margin is interpolated from samples at the vertices and at the
        middles of the edges. Check points show how large the interpolation error is.
        """
        new = np.flatnonzero(self.classes == UNCLASSIFIED)
        triangles = self.triangles[new]
        self.longest_edges[new] = measure_edges(self.points, triangles).max(axis=1)
        # (E, 2) vertices of each edge, and (T, 3) numbers of the edges of each triangle.
        edges, sides = list_edges(triangles)
        low, high = np.moveaxis(self.points[edges], 1, 0)
        centroids = self.points[triangles].sum(axis=1)
        # The samples are middles of edges, check points on edges, and centroids as further
        # check points. The interpolation is exact at the middle of an edge, so its check
        # point is at a quarter, from the vertex with the lower number. Triangles with a
        # common edge share its samples. `unit_rows` makes unit vectors of the sums.
        samples = np.concatenate([low + high, 3.0 * low + high, centroids])
        margins = self.evaluate(unit_rows(samples))
        middle, check, centroid = np.split(margins, [len(edges), 2 * len(edges)])
        # (10, T, k) the k margins at the ten samples of each triangle. Those at its three
        # vertices are in `values`.
        stacked = np.concatenate(
            [self.values[triangles.T], middle[sides.T], check[sides.T], centroid[None]]
        )
        self.classes[new], self.has_several_uncertain[new] = classify_triangles(
            self.points, triangles, stacked
        )

    def _find_border(self) -> None:
        """Find the border in the crossed triangles where it is not known yet.

        A triangle is crossed if one or two of its vertices are inside the region. The
        border in it, a segment, is added to `segments`. The triangle gets the class OPEN if
        no border is found, or if another margin is negative on it. A part of the region may
        then be hidden in the triangle.
        """
        inside_count = self.is_inside[self.triangles].sum(axis=1)
        is_crossed = inside_count % 3 != 0
        # The vertices of such a triangle do not show where its border is.
        is_broken = self.classes == TriangleClass.BROKEN
        self.classes[is_broken & ~is_crossed] = TriangleClass.OPEN
        is_crossed[self.segments.triangle] = False
        # The vertices differ, although the class says that there is no border.
        self.classes[is_crossed & (self.classes < TriangleClass.SIMPLE)] = (
            TriangleClass.OPEN
        )

        crossed = np.flatnonzero(is_crossed)
        odd, second, third = self._odd_vertex_first(crossed)
        crossings = (
            self._find_edge_crossings(odd, second),
            self._find_edge_crossings(odd, third),
        )
        # The border runs from start to stop with the region on its left.
        start_stop = np.where(inside_count[crossed] == 1, crossings, crossings[::-1])
        margins = self._crossing_margins[start_stop]
        starts, stops = self._crossing_points[start_stop]

        # `margins` (2, n) are the numbers of the margins that are 0 at start and stop. If
        # they differ, the border has a corner between them.
        with_corner = np.flatnonzero(margins[0] != margins[1])
        corner, is_corner = find_corners(
            self.evaluate,
            starts[with_corner],
            stops[with_corner],
            margins[:, with_corner].T,
        )
        self.classes[crossed[with_corner[~is_corner]]] = TriangleClass.OPEN
        corner = corner[is_corner]
        with_corner = with_corner[is_corner]
        leading_stops = stops.copy()
        leading_stops[with_corner] = corner

        # One leading segment per triangle, then the second segments after corners.
        position = np.append(np.arange(len(crossed)), with_corner)
        triangle = crossed[position]
        segments = BorderSegments.find(
            self.evaluate,
            ends=(
                np.concatenate([starts, corner]),
                np.concatenate([leading_stops, stops[with_corner]]),
            ),
            margin=np.append(margins[0], margins[1, with_corner]),
            triangle=triangle,
            crossings=(start_stop[0, position], start_stop[1, position]),
            is_leading=np.arange(len(position)) < len(crossed),
            is_searched=~self.is_open[triangle],
        )
        # If several margins may have either sign, others than that of the segment are
        # evaluated along it. It is not sound if one of them is negative there.
        is_audited = self.has_several_uncertain[triangle] & segments.is_sound
        segments.audit(self.evaluate, np.flatnonzero(is_audited))
        self.classes[triangle[~segments.is_sound]] = TriangleClass.OPEN
        self.segments = BorderSegments.concatenate([self.segments, segments])

    def _find_edge_crossings(self, first: Indices, second: Indices) -> Indices:
        """Return the numbers of the crossings of edges with the border.

        Parameters
        ----------
        first, second
            (n,) vertices of the edges, one of each edge inside the region.

        Returns
        -------
        (n,) numbers of crossings. The keys, points and margins of new ones are computed and
        appended to `_crossing_keys`, `_crossing_points` and `_crossing_margins`.
        """
        # An integer key identifies each edge: the vertex inside in its upper 32 bits, and
        # the vertex outside in its lower ones. Edges with a known key are not searched.
        inside, outside = np.where(self.is_inside[first], [first, second], [second, first])
        keys = inside << 32 | outside
        new_keys = np.setdiff1d(keys, self._crossing_keys)
        new_inside = new_keys >> 32
        new_outside = new_keys & (2**32 - 1)
        # The border is where the smallest margin is zero. Margins are functions of the
        # direction that are at least 0 in the region. `margins` are the numbers of those
        # that vanish.
        points, margins = find_crossings(
            self.evaluate, self.points[new_inside], self.points[new_outside]
        )
        self._crossing_keys = np.append(self._crossing_keys, new_keys)
        self._crossing_points = np.concatenate([self._crossing_points, points])
        self._crossing_margins = np.append(self._crossing_margins, margins)
        # Look up the number of each key.
        order = np.argsort(self._crossing_keys)
        return order[np.searchsorted(self._crossing_keys, keys, sorter=order)]

    def _reduce_error(self, tolerance: float) -> Bools:
        """Reduce the error of the area, and return which triangles (T,) have to be cut.

        The error has two parts. Each may be up to half of the tolerance (sr). The border is
        approximated by polynomials, and open triangles may hide parts of the region.
        """
        is_cut = self._improve_segments(0.5 * tolerance)
        is_cut |= self._choose_open_triangles(0.5 * tolerance)
        return is_cut & (self.longest_edges > MIN_EDGE_RAD)

    def _improve_segments(self, max_error: float) -> Bools:
        """Raise the degrees of border polynomials until the area is accurate enough.

        A segment is the border in one triangle, approximated by a polynomial. Its order is
        the degree of this polynomial.

        Parameters
        ----------
        max_error
            Largest error of the area (sr) that all segments together may cause.

        Returns
        -------
        (T,) which triangles have to be cut, because their segments have the highest order
        and are still not accurate enough.
        """
        is_cut = np.zeros(len(self.triangles), dtype=bool)
        segments = self.segments
        while True:
            is_poor = self._find_poor_segments(max_error)
            can_raise = is_poor & (segments.order < ORDERS[-1])
            if not can_raise.any():
                is_cut[segments.triangle[is_poor]] = True
                return is_cut
            segments.raise_order(self.evaluate, np.flatnonzero(can_raise))
            # The border of a segment may be impossible to find at the nodes of a higher
            # order. The segment is then not sound, and its triangle may hide a part of the
            # region.
            self.classes[segments.triangle[~segments.is_sound]] = TriangleClass.OPEN

    def _find_poor_segments(self, max_error: float) -> Bools:
        """Return the segments (n,) of the border that are to be approximated better.

        If the sum of all errors is small enough, there are none.

        Parameters
        ----------
        max_error
            Largest error of the area (sr) that all segments together may cause.
        """
        segments = self.segments
        # The whole area of an open triangle counts as an error, so its segment does not.
        is_counted = ~self.is_open[segments.triangle]
        # The area is integrated along the segments, so its rounding error grows with their
        # lengths. An error of about this size cannot be reduced.
        rounding_error = EPS * segments.length
        can_improve = segments.error > ROUNDING_FACTOR * rounding_error
        error = np.where(is_counted & can_improve, segments.error, 0.0)
        if error.sum() <= max_error:
            return np.zeros(len(error), dtype=bool)
        # If all segments had half of their equal share of `max_error`, the sum would be
        # small enough. A smaller limit improves more segments at once.
        equal_share = max_error / np.count_nonzero(is_counted)
        return error > 0.5 * equal_share

    def _choose_open_triangles(self, max_area: float) -> Bools:
        """Return the open triangles (T,) that have to be cut.

        An open triangle may hide a part of the region, so its whole area counts as an error
        of the area of the region.

        Parameters
        ----------
        max_area
            Area (sr) that all open triangles together may have.
        """
        open_area = self.is_open * self.areas
        if open_area.sum() <= max_area:
            return np.zeros(len(open_area), dtype=bool)
        # The largest triangles are cut first; small ones matter only after these. A larger
        # factor than 0.1 cuts fewer triangles in a round, so that more rounds follow.
        return open_area > 0.1 * open_area.max()

    def _cut(self, is_cut: Bools) -> None:
        """Cut the triangles for which `is_cut` (T,) is true.

        Their neighbours are cut too where a vertex would otherwise be in the middle of an
        edge. Triangles that are not cut keep their segments (the parts of the border in
        them) and what `_classify` determined for them. Segments of triangles that are cut
        are removed.
        """
        old_count = len(self.points)
        mesh = bisect_triangles(self.points, self.triangles, is_cut)
        self.points = mesh.points
        self.triangles = mesh.triangles
        origin = mesh.origin  # the old number of each triangle, -1 for new ones
        new_values = self.evaluate(self.points[old_count:])
        self.values = np.concatenate([self.values, new_values])
        is_kept = origin >= 0
        # New triangles are marked, so that `_classify` computes their classes, longest
        # edges and flags. Until then they have placeholders in all three arrays: their
        # `origin` -1 selects the last entry of the old array.
        self.classes = np.where(is_kept, self.classes[origin], UNCLASSIFIED)
        self.longest_edges = self.longest_edges[origin]
        self.has_several_uncertain = self.has_several_uncertain[origin]
        # The new number of each old triangle, -1 if it was cut.
        new_number = np.full(len(is_cut), -1)
        new_number[origin[is_kept]] = np.flatnonzero(is_kept)
        self.segments.triangle[:] = new_number[self.segments.triangle]
        self.segments = self.segments.rows(self.segments.triangle >= 0)
