"""A mesh over the sphere that is refined until the border of a region is known.

Each triangle of the mesh has a class (`spherekit.geometry.triangle_class`). Triangles that
may hide a part of the region are cut. In triangles that the border crosses, the border is
stored as `BorderSegments`. The triangles and the segments together give the area of the
region, its surface and its border curves.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, Integers
from spherekit.geometry.border_point import find_corners
from spherekit.geometry.border_segment import ORDERS, BorderSegments
from spherekit.geometry.edge_crossings import EdgeCrossings
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

    At a corner of the border in a triangle, two segments meet. Both have fans from the same
    apex, and the first one has the extra triangle.

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
        """Return the triangles of the fans as point numbers (n, 3).

        A segment is the border of the region in one triangle of the mesh, a curve given by
        nodes. Its fan consists of triangles between its apex (a vertex of the mesh inside
        the region) and two successive nodes. Vertices and nodes share one numbering.

        Parameters
        ----------
        node
            (m,) point numbers of the nodes of all segments, in the order of the segments.
        segment
            (m,) index of the segment of each node.
        """
        apex_of_node = self.apex[segment]
        corners = np.stack([apex_of_node[:-1], node[:-1], node[1:]], axis=1)
        are_on_same_segment = segment[:-1] == segment[1:]
        return corners[are_on_same_segment]

    def extra_triangles(self, start_node: Indices) -> Indices:
        """Return the extra triangles as vertex numbers (n, 3).

        If the border leaves two vertices of a mesh triangle inside the region, its fan does
        not cover the part inside. An extra triangle between both vertices and the start of
        the border covers the rest.

        Parameters
        ----------
        start_node
            (n,) index of the first node of each segment.
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
        (T,) length (rad) of the longest edge of each classified triangle.
    has_several_uncertain
        (T,) whether several margins may change their sign in a triangle. The border of one
        margin may then not be the border of the region.
    crossings
        Points at which the border crosses edges of the mesh.
    segments
        The border in the triangles where it is known.
    """

    def __init__(self, evaluate: MarginEvaluator, spacing: float) -> None:
        """Begin with a coarse triangle mesh; the border of the region is not known yet.

        The region consists of the directions in which all margins are at least 0. A margin
        is a function of the direction.

        Parameters
        ----------
        evaluate
            Function that returns the margins at directions.
        spacing
            Longest edge (rad) of the triangles at the beginning.
        """
        self.evaluate = evaluate
        points, triangles = icosahedron(spacing)
        # The mesh is cached. Users may change the arrays of a region.
        self.points = points.copy()
        self.triangles = triangles.copy()
        self.values = evaluate(self.points)  # margins at the vertices
        # Properties of the triangles, which `_classify` determines. The class says whether
        # the border crosses a triangle. A margin is uncertain if it may have either sign
        # there.
        count = len(self.triangles)
        self.classes = np.full(count, UNCLASSIFIED)
        self.longest_edges = np.zeros(count)
        self.has_several_uncertain = np.zeros(count, dtype=bool)

        # The border, which `_find_border` searches: its crossings with edges of the mesh,
        # and the segments (pieces) between crossings.
        self.crossings = EdgeCrossings()
        self.segments = BorderSegments.empty()

    def refine(self, tolerance: float, feature: float, max_evaluations: int) -> None:
        """Cut triangles of the mesh until the area of the region is accurate enough.

        The region has the directions at which all margins, functions of the direction, are
        at least 0.

        Parameters
        ----------
        tolerance
            Error of the area (sr) at which the refinement ends.
        feature
            Smallest size (rad) of parts and holes of the region that are to be found.
        max_evaluations
            The refinement ends if the next cuts would probably need more evaluations of the
            margins than this number in all. The number can be exceeded, because the cost of
            cuts is only estimated. The evaluations for the first mesh and for the final
            search of the border are not limited.
        """
        while True:
            self._classify()
            is_cut = self._choose_triangles(tolerance, feature)
            cost = EVALUATIONS_PER_CUT * np.count_nonzero(is_cut)
            if not cost or self.evaluate.evaluations + cost > max_evaluations:
                break
            self._cut(is_cut)
        # The border is completed in all triangles that it crosses. Parts are missing if the
        # limit of evaluations has ended the loop.
        self._find_border()

    def _choose_triangles(self, tolerance: float, feature: float) -> Bools:
        """Return a mask (T,) of the triangles that have to be cut next.

        Margins are the functions that are at least 0 in the region. A triangle is *open* if
        it may hide a small part of the region, or a hole of the region. A triangle is
        *broken* if the margins are defined in only a part of it. There are three reasons
        for a cut. The first one that applies to any triangle decides:

        1. Triangles are open and have an edge longer than `feature`, or are broken and have
           an edge longer than `MAX_BROKEN_EDGE_RAD`.
        2. The border is searched in the triangles that it crosses. Triangles in which the
           search fails become open. Open triangles are cut if an edge is longer than
           `feature`.
        3. The error of the area exceeds the tolerance. The triangles that cause it are cut.

        Parameters
        ----------
        tolerance
            Accepted error of the area (sr).
        feature
            Smallest size (rad) of parts and holes of the region that are to be found.
        """
        is_large = self.longest_edges > feature
        is_broken = self.classes == TriangleClass.BROKEN
        is_large_broken = is_broken & (self.longest_edges > MAX_BROKEN_EDGE_RAD)
        is_cut = is_large_broken | (self.is_open & is_large)
        if is_cut.any():
            return is_cut

        self._find_border()  # it may open triangles
        is_cut = self.is_open & is_large
        if is_cut.any():
            return is_cut

        return self._reduce_error(tolerance)

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
        r"""Return the area (T,) of the region (sr) that is assigned to each triangle.

        A triangle with all vertices inside is counted as a whole. If one or two are inside,
        the border crosses the triangle in a segment (piece of the border) from start to
        end. The chord is the great-circle arc between these points::

            one vertex inside: A        two vertices inside: A and B

                    A                              C
                   / \                            / \
           start  *---*  end              end    *---*  start
                 /     \                        /    _.\
                /       \                      / _.-'   \
               C ------- D                    A --------- B

        The area is the sum of:

        - the triangle A, start, end;
        - the area between the chord and the segment, negative if the segment bends inwards;
        - if two vertices are inside, the triangle A, B, start.

        A corner of the border in a triangle divides the border there into two segments. The
        first two areas are added for each segment, the last one only for the first segment.
        A segment can bend over an edge of its triangle. The area beyond the edge is
        assigned to the same triangle. So the sum of all results is the area of the region.
        """
        division = self._divide_triangles()
        # Areas for each segment (n,) of the border. The apex is the vertex A of the
        # drawings, and `other_inside` is B.
        apex = self.points[division.apex]
        other_inside = self.points[division.other_inside]
        start, end = np.moveaxis(self.segments.ends, 1, 0)
        chord_triangle = triangle_areas(apex, start, end)
        beside_chord = self.segments.area
        extra_triangle = np.where(
            division.has_extra_triangle, triangle_areas(apex, other_inside, start), 0.0
        )
        inside_part = chord_triangle + beside_chord + extra_triangle

        # Areas for each triangle (T,) of the mesh: the sums over its segments.
        triangle_count = len(self.triangles)
        crossed = np.bincount(self.segments.triangle, inside_part, triangle_count)
        whole = np.where(division.inside_count == 3, self.areas, 0.0)
        return whole + crossed

    def surface(self) -> tuple[Floats, Indices]:
        r"""Return a triangulation of only the region, up to its border.

        Triangles of the mesh with all vertices inside the region stay whole. Triangles that
        the border crosses are divided, and only their part inside the region is used. The
        border in a triangle is a segment, a curve through several nodes (*)::

                  C
                 / \
           end  *-*-*  start
               /    _.\
              / _.-'   \
             A --------- B

        Here A and B are inside the region. Each two neighbouring nodes form a small
        triangle with A. These triangles are a fan with the apex A. The extra triangle A, B,
        start fills the rest. If only one vertex is inside, the fan from this vertex fills
        the whole part inside.

        Returns
        -------
        points
            (P, 3) unit vectors: the vertices of the mesh, then the nodes of the border.
        triangles
            (F, 3) indices of points.
        """
        division = self._divide_triangles()
        all_segments = np.arange(len(self.segments.start))
        nodes = self.segments.node_points(all_segments)
        points = np.concatenate([self.points, nodes.points])
        node_numbers = np.arange(len(self.points), len(points))
        # The first node of each segment. A segment runs so that the region is on its left.
        start_numbers = node_numbers[nodes.is_start]

        whole_triangles = self.triangles[division.inside_count == 3]
        fan_triangles = division.fan_triangles(node_numbers, nodes.segment)
        extra_triangles = division.extra_triangles(start_numbers)
        return points, np.concatenate([whole_triangles, fan_triangles, extra_triangles])

    def border_loops(self) -> list[Indices]:
        """Return the closed curves of the border, as segment numbers in their order.

        A segment is the border of the region in one triangle of the mesh. A corner in a
        triangle divides its border into two segments. Each loop is an array of segment
        numbers.
        """
        segment_count = len(self.segments.start)
        next_segment = self._find_next_segments()
        has_next = next_segment >= 0
        links = np.stack([np.arange(segment_count), next_segment], axis=1)[has_next]
        return order_chains(segment_count, links, directed=True)

    def _find_next_segments(self) -> Indices:
        """Return, for each segment (n,), the index of the next one along the border, or -1.

        The border curves are assembled from segments (pieces of the border) in this order.
        A crossing is a point at which the border crosses an edge of the mesh. The border
        enters a triangle at the crossing `start` and leaves it at the crossing `stop`. It
        consists of one segment there, or of two if it has a corner in the triangle::

            start ---- leading segment ---- stop
            start -- leading segment -- corner -- second segment -- stop

        Both segments of a triangle store both crossings.
        """
        segments = self.segments
        leading = np.flatnonzero(segments.is_leading)
        second = np.flatnonzero(~segments.is_leading)
        # (crossings,) the segments in the triangle that the border enters at each crossing,
        # -1 if there is none.
        crossing_count = len(self.crossings.points)
        leading_at_entry = np.full(crossing_count, -1)
        leading_at_entry[segments.start[leading]] = leading
        second_at_entry = np.full(crossing_count, -1)
        second_at_entry[segments.start[second]] = second

        # (n,) for each segment, the second segment of the same triangle, and the leading
        # segment of the triangle that the border enters next.
        second_in_triangle = second_at_entry[segments.start]
        leading_in_next_triangle = leading_at_entry[segments.stop]
        ends_at_corner = segments.is_leading & (second_in_triangle >= 0)
        return np.where(ends_at_corner, second_in_triangle, leading_in_next_triangle)

    def _divide_triangles(self) -> TriangleDivision:
        r"""Return how the border divides the triangles that it crosses.

        The callers need the part of each triangle inside the region, for the area of the
        region and for its triangulation. A segment is a smooth piece of the border in one
        triangle, with the region on its left. Its nodes (*) run from start to stop. The
        vertices follow counter-clockwise: odd, second, third. The odd vertex is the only
        one inside, or the only one outside::

            inside: odd                     inside: second and third

                  odd                               odd
                  /|\                               / \
         start   *-*-*   stop              stop    *-*-*    start
                /     \                           /    _.\
               /       \                         / _.-'   \
            second --- third                second ------- third

        With one vertex inside, the part inside is a fan of small triangles. Each of them
        joins the apex (here odd) to two successive nodes. With two vertices inside, the
        apex is second. The dashed line separates the fan from an extra triangle: second,
        third and start.

        At a corner of the border in a triangle, the leading segment ends and another one
        begins. Both have a fan from the same apex. Only the leading segment has the extra
        triangle, because it begins at start.
        """
        # (T,) for every triangle of the mesh.
        inside_count = self.is_inside[self.triangles].sum(axis=1)
        # (n,) for every segment.
        odd, second, third = self._odd_vertex_first(self.segments.triangle)
        has_one_inside = inside_count[self.segments.triangle] == 1
        has_two_inside = ~has_one_inside
        has_extra_triangle = has_two_inside & self.segments.is_leading
        return TriangleDivision(
            inside_count=inside_count,
            apex=np.where(has_one_inside, odd, second),
            other_inside=third,  # used only for extra triangles
            has_extra_triangle=has_extra_triangle,
        )

    def _odd_vertex_first(self, selected: Indices) -> Indices:
        """Return the vertices (3, n) of triangles that the border crosses.

        The first ("odd") vertex is alone on its side of the border: it is inside the region
        and both others are outside, or the reverse. The border thus crosses the two edges
        at the first vertex. The order around the triangle is unchanged.
        """
        # With one vertex inside, this vertex is odd. With two inside, the outside vertex is
        # odd.
        vertices = self.triangles[selected]
        is_inside = self.is_inside[vertices]
        is_odd = is_inside == (is_inside.sum(axis=1) == 1)[:, None]
        position = (np.argmax(is_odd, axis=1)[:, None] + np.arange(3)) % 3
        return np.take_along_axis(vertices, position, axis=1).T

    def _classify(self) -> None:
        """Determine the classes of the new triangles from samples of the margins.

        Margins are functions of the direction that are at least 0 in the region. A class
        says whether a triangle of the mesh is inside or outside the region, or crossed by
        the border. The method updates `classes`, `longest_edges` and
        `has_several_uncertain`: whether several margins may have either sign in the
        triangle.
        """
        new = np.flatnonzero(self.classes == UNCLASSIFIED)
        triangles = self.triangles[new]
        samples = self._sample_margins(triangles)
        classes, has_several_uncertain = classify_triangles(self.points, triangles, samples)
        self.classes[new] = classes
        self.has_several_uncertain[new] = has_several_uncertain
        self.longest_edges[new] = measure_edges(self.points, triangles).max(axis=1)

    def _sample_margins(self, triangles: Indices) -> Floats:
        """Return the margins at ten points of each of n triangles.

        Margins are functions of the direction. In a triangle, each one is interpolated from
        its values at the vertices and the middles of the edges. The other points are check
        points, which show the interpolation error. At the middle of an edge there is no
        error, so its check point is at a quarter.

        Parameters
        ----------
        triangles
            (n, 3) vertex numbers.

        Returns
        -------
        (10, n, k) margins: at the three vertices, at the middles of the three edges, at
        their check points, and at the centroid.
        """
        # Two triangles share the samples on a common edge. The check point of an edge is
        # nearer to its first vertex.
        edges, edges_of_triangle = list_edges(triangles)
        first = self.points[edges[:, 0]]
        second = self.points[edges[:, 1]]
        middle_points = unit_rows(first + second)
        check_points = unit_rows(3.0 * first + second)
        centroids = unit_rows(self.points[triangles].sum(axis=1))

        # The margins are evaluated in one call, and divided by kind of point.
        margins = self.evaluate(np.concatenate([middle_points, check_points, centroids]))
        edge_count = len(edges)
        at_middles = margins[:edge_count]
        at_checks = margins[edge_count : 2 * edge_count]
        at_centroids = margins[2 * edge_count :]
        return np.concatenate(
            [
                self.values[triangles.T],  # known since the vertices were made
                at_middles[edges_of_triangle.T],
                at_checks[edges_of_triangle.T],
                at_centroids[None],
            ]
        )

    def _find_border(self) -> None:
        """Find the border in the crossed triangles where it is not known yet.

        A triangle is crossed if one or two of its vertices are inside the region. The
        border in it, a segment, is added to `segments`. The triangle gets the class OPEN if
        no border is found, or if another margin is negative on it. A part of the region may
        then be hidden in the triangle. A triangle also gets this class if its earlier class
        does not agree with its vertices.
        """
        inside_count = self.is_inside[self.triangles].sum(axis=1)
        is_crossed = inside_count % 3 != 0
        # In a broken triangle, some margins are undefined. If all its vertices are on one
        # side, they do not show where the border is.
        is_broken = self.classes == TriangleClass.BROKEN
        self.classes[is_broken & ~is_crossed] = TriangleClass.OPEN
        is_crossed[self.segments.triangle] = False
        # Vertices are on both sides, although the class says that there is no border.
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
        margins = self.crossings.margins[start_stop]
        starts, stops = self.crossings.points[start_stop]

        # `margins` (2, n) are the indices of the margins that are 0 at start and stop. If
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
        # Where several margins may have either sign, the margins that are not 0 on a
        # segment are evaluated along it. A segment on which one of them is negative is not
        # sound.
        is_checked = self.has_several_uncertain[triangle] & segments.is_sound
        segments.reject_excluded_segments(self.evaluate, np.flatnonzero(is_checked))
        self.classes[triangle[~segments.is_sound]] = TriangleClass.OPEN
        self.segments = BorderSegments.concatenate([self.segments, segments])

    def _find_edge_crossings(self, first: Indices, second: Indices) -> Indices:
        """Return the indices (n,) of the points at which mesh edges cross the border.

        The points are items of `crossings`. Those not known yet are computed and added.

        Parameters
        ----------
        first, second
            (n,) indices of both vertices of each edge. One of them is inside the region.
        """
        first_is_inside = self.is_inside[first]
        return self.crossings.find(
            self.evaluate,
            self.points,
            inside=np.where(first_is_inside, first, second),
            outside=np.where(first_is_inside, second, first),
        )

    def _reduce_error(self, tolerance: float) -> Bools:
        """Reduce the error of the area, and return a mask (T,) of the triangles to be cut.

        Two causes contribute to the error, each up to half of the tolerance (sr):

        - The piece of the border in a triangle, a segment, is approximated by a polynomial.
          The order of the segment is the degree of the polynomial. Orders are raised first.
          Triangles are cut only if the highest order is not accurate enough.
        - A triangle is open if a part of the region, or a hole, may be hidden in it. Its
          whole area counts as an error. The largest open triangles are cut.

        The T triangles are those of the mesh. Triangles with edges of at most
        `MIN_EDGE_RAD` are not cut.

        Parameters
        ----------
        tolerance
            Largest error of the area (sr).
        """
        max_error = 0.5 * tolerance
        self._raise_orders(max_error)
        # Segments that are not accurate enough even with the highest order.
        is_poor = self._find_poor_segments(max_error)
        is_cut = np.zeros(len(self.triangles), dtype=bool)
        is_cut[self.segments.triangle[is_poor]] = True
        is_cut |= self._choose_open_triangles(max_error)
        return is_cut & (self.longest_edges > MIN_EDGE_RAD)

    def _raise_orders(self, max_error: float) -> None:
        """Raise the degrees of border polynomials until the area is accurate enough.

        A segment is the border in one triangle, approximated by a polynomial. Its order is
        the degree of this polynomial. Segments with the highest order stay unchanged.

        Parameters
        ----------
        max_error
            Largest error of the area (sr) that all segments together may cause.
        """
        segments = self.segments
        while True:
            is_poor = self._find_poor_segments(max_error)
            can_raise = is_poor & (segments.order < ORDERS[-1])
            if not can_raise.any():
                return
            segments.raise_order(self.evaluate, np.flatnonzero(can_raise))
            # The search at more nodes (points of the polynomial) may fail to find the
            # border. A segment whose border is not found is not sound. Its triangle becomes
            # open: the triangle may hide a part of the region.
            self.classes[segments.triangle[~segments.is_sound]] = TriangleClass.OPEN

    def _find_poor_segments(self, max_error: float) -> Bools:
        """Return a mask (n,) of the border segments that need a better approximation.

        A segment is the piece of the border in one triangle. It is approximated by a curve,
        which causes an error of the area of the region. If the sum of all errors is small
        enough, no segment is returned.

        Parameters
        ----------
        max_error
            Largest error of the area (sr) that all segments together may cause.
        """
        segments = self.segments
        # An open triangle may hide a part of the region. Its segment is not counted,
        # because `_choose_open_triangles` counts its whole area as an error.
        is_counted = ~self.is_open[segments.triangle]
        # The rounding error of an area grows with the length of the segment. An error of
        # about this size cannot be reduced.
        rounding_error = EPS * segments.length
        can_improve = segments.error > ROUNDING_FACTOR * rounding_error
        error = np.where(is_counted & can_improve, segments.error, 0.0)
        if error.sum() <= max_error:
            return np.zeros(len(error), dtype=bool)
        # The sum is small enough if no segment has more than an equal share of `max_error`.
        # Half of this share is the limit, so that fewer rounds of improvement are needed.
        equal_share = max_error / np.count_nonzero(is_counted)
        return error > 0.5 * equal_share

    def _choose_open_triangles(self, max_area: float) -> Bools:
        """Return a mask (T,) of the open triangles that have to be cut.

        An open triangle may contain a part of the region, or a hole, that was not found. So
        its whole area counts as an error of the area of the region.

        Parameters
        ----------
        max_area
            Area (sr) that all open triangles together may have.
        """
        open_area = self.is_open * self.areas
        if open_area.sum() <= max_area:
            return np.zeros(len(open_area), dtype=bool)
        # The largest triangles are cut first. With a larger factor than 0.1, fewer
        # triangles would be cut in a round, and more rounds would follow.
        return open_area > 0.1 * open_area.max()

    def _cut(self, is_cut: Bools) -> None:
        """Cut the triangles for which `is_cut` (T,) is true.

        Neighbours are cut where necessary, so that no new vertex is in the middle of an
        edge. The margins (functions of the direction that are at least 0 in the region) are
        evaluated at the new vertices. Triangles that are not cut retain their properties
        and their segments (pieces of the border).
        """
        mesh = bisect_triangles(self.points, self.triangles, is_cut)
        new_points = mesh.points[len(self.points) :]
        new_margins = self.evaluate(new_points)
        self.values = np.concatenate([self.values, new_margins])
        self.points = mesh.points
        self.triangles = mesh.triangles

        # `mesh.origin` (new T,) is the old index of each triangle, -1 for new ones. The
        # properties of new triangles are placeholders until `_classify` computes them.
        self.classes = _carry_over(self.classes, mesh.origin, UNCLASSIFIED)
        self.longest_edges = _carry_over(self.longest_edges, mesh.origin, 0.0)
        self.has_several_uncertain = _carry_over(
            self.has_several_uncertain, mesh.origin, False
        )
        # Segments name their triangles by index, and the indices have changed.
        self._renumber_segments(mesh.origin, old_count=len(is_cut))

    def _renumber_segments(self, origin: Indices, old_count: int) -> None:
        """Give the segments the new indices of their triangles after triangles were cut.

        A segment is a piece of the border of the region inside one triangle of the mesh.
        Segments in triangles that were cut into smaller ones are dropped.

        Parameters
        ----------
        origin
            (T,) old index of each triangle, -1 for new ones.
        old_count
            Number of triangles before the cut.
        """
        # The new index of each old triangle, -1 if it was cut.
        is_kept = origin >= 0
        new_number = np.full(old_count, -1)
        new_number[origin[is_kept]] = np.flatnonzero(is_kept)

        triangle = new_number[self.segments.triangle]
        self.segments = replace(self.segments, triangle=triangle).rows(triangle >= 0)


def _carry_over(values: Array, origin: Indices, placeholder: float) -> Array:
    """Return properties of triangles in the new numbering after some triangles were cut.

    Parameters
    ----------
    values
        (old T,) one value for each triangle, in the old numbering.
    origin
        (T,) old index of each triangle, -1 for new ones.
    placeholder
        Value of the new triangles.
    """
    is_kept = origin >= 0
    carried = np.full(len(origin), placeholder, dtype=values.dtype)
    carried[is_kept] = values[origin[is_kept]]
    return carried
