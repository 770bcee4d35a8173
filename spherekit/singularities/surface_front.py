"""An advancing front that covers surfaces of singular configurations with triangles.

Every open edge of the mesh, an edge with one triangle, gets a second triangle. Its apex is
a vertex of the front near the ideal position, or a new vertex that Newton's method brings
onto the locus. The mesh starts from singular configurations that `LocusPointSearch` yields.
It extends by one triangle beyond the ranges of the inputs.

Overlaps are tested in the tangent plane of the surface at a vertex. Points of this plane
are complex numbers, in the two coordinates along `LocusPoints.tangents`.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.input_revolutions import in_range, less_periods
from spherekit.singularities.curve_starts import LocusPointSearch
from spherekit.singularities.locus import LocusPoints
from spherekit.wording import counted

EQUILATERAL_HEIGHT = 0.75**0.5
"""Height of an equilateral triangle of side 1. Other lengths with the unit "edge lengths"
are relative to `SurfaceFront.edge_length`."""
MERGING_DISTANCE = 0.75
"""A vertex of the front within this distance (edge lengths) of the ideal apex is used
instead of a new vertex. Larger: fewer and less regular triangles."""
MIN_VERTEX_DISTANCE = 0.5
"""Least distance (edge lengths) of a new vertex from all others of the same sheet, except
in the first triangle of a mesh. Smaller: narrower triangles."""
MAX_EDGE_LENGTH = 1.5
"""Longest edge (edge lengths), measured in a tangent plane. Larger: remaining gaps are
closed by longer triangles."""
MIN_TRIANGLE_HEIGHT = 0.2
"""Least height (edge lengths) of a triangle above the open edge on which it is put.
Smaller: flat triangles appear, whose overlaps are decided by rounding."""
SAME_SHEET_COSINE = 0.8
"""Least cosine of the angles between tangent planes, and between singular motions, of
vertices on the same sheet of the surface. Larger: smaller edges are necessary where the
surface bends; smaller: sheets that pass each other are connected."""
RANGE_MARGIN = 0.25
"""Distance (edge lengths) beyond the ranges within which a vertex still counts as inside.
The surface may curve back across the end of a range between vertices beyond it."""
VERTICES_COMPUTED_TOGETHER = 32
"""Number of new vertices that Newton's method computes at once, for speed."""
MAX_FRONT_VERTICES = 20_000
"""Number of vertices at which a mesh ends, before halving."""
SURFACE_CROSSING_CONDITION = 1e-4
"""Surfaces cross at a point if the reciprocal condition number of its equations is smaller.
Larger: the mesh ends farther away from crossings; smaller: it may change from surface to
surface."""
NEW_VERTEX = -1
"""Stands for the new vertex at the ideal apex of a triangle."""

Edge = tuple[int, int]
"""Indices of two vertices of the mesh, the lower one first unless an order is stated."""


class SurfaceFront:
    """A mesh of triangles on surfaces of singular configurations.

    The mesh grows at its open edges, which have a triangle on one side only. The next
    triangle on an open edge should be equilateral: its third vertex should be at the ideal
    apex, a position in the tangent plane at the first end of the edge. Positions in the
    tangent plane at a vertex are complex numbers.

    Attributes
    ----------
    search, report
        Source of singular configurations, and the type of singularity with the ranges of
        the inputs.
    edge_length
        Length of the edges aimed at (rad, in the space of the variables).
    periods
        (V,) growth of each variable (rad) that leaves the configuration unchanged.
    vertices
        The points of the locus.
    triangles
        Vertices of each triangle. All triangles of a surface have the same orientation.
    is_inside
        For each vertex whether all inputs are within their ranges, with a margin.
    open_edges
        Edges with one triangle, each with the third vertex of that triangle.
    directed_edges
        The edges of all triangles in their order of vertices.
    waiting_edges
        Open edges in the order in which they may get a second triangle.
    computed_vertices
        New vertices for open edges, computed in advance; None where there is no point of
        the same part of the surface.
    """

    def __init__(self, search: LocusPointSearch, edge_length: float) -> None:
        """Make an empty mesh; the class explains the parameters."""
        self.search = search
        self.report = search.report
        self.edge_length = edge_length
        self.periods = variable_periods(self.report.locus.closure)
        self.vertices = self.report.locus.project(np.zeros((0, len(self.periods))))
        self.triangles: list[tuple[int, int, int]] = []
        self.is_inside: list[bool] = []
        self.open_edges: dict[Edge, int] = {}
        self.computed_vertices: dict[Edge, LocusPoints | None] = {}
        self.directed_edges: set[Edge] = set()
        self.waiting_edges: deque[Edge] = deque()

    def find_vertices_near(self, values: Floats, motion: Floats, radius: float) -> Indices:
        """Return the indices of the vertices near a configuration on the same sheet.

        A sheet is a part of a surface of singular configurations. Two sheets can pass each
        other at a small distance. Sheets differ in their singular motion: the rates of all
        variables in the motion in which the inputs, or the output, are at rest. The sign of
        this motion is arbitrary and does not count. The vertices show whether the mesh
        already covers the configuration, and which of them a new triangle can use.

        Parameters
        ----------
        values
            (V,) pair variables of the configuration (rad).
        motion
            (V,) rates of its singular motion, with norm 1.
        radius
            Largest distance (rad, in the space of the variables).
        """
        differences = less_periods(self.vertices.values - values, self.periods)
        is_same_sheet = np.abs(self.vertices.motions @ motion) > SAME_SHEET_COSINE
        is_near = np.linalg.norm(differences, axis=1) < radius
        return np.flatnonzero(is_near & is_same_sheet)

    def mesh_all_surfaces(self) -> int:
        """Cover the surfaces of singular configurations that `search` finds with triangles.

        A mesh starts at a found configuration if all its inputs are within their ranges,
        and no triangles are near it yet. The mesh is stored as `vertices` and `triangles`.
        It is incomplete if the limit of vertices or time is reached.

        Newton's method may reach no first triangle at a configuration. If no other mesh
        covers this configuration later, the text `search.time_limit.note` says so. With
        this text, the mesh does not count as complete.

        Returns
        -------
        Number of found configurations within the ranges of the inputs at which surfaces
        cross. No mesh starts there, because the equations for Newton's method are nearly
        singular.
        """
        crossings = 0
        seeds_without_triangle: list[LocusPoints] = []
        for points in self.search.batches():
            is_inside = self.report.points(points).inside
            is_crossing = points.reciprocal_condition < SURFACE_CROSSING_CONDITION
            crossings += int(np.sum(is_inside & is_crossing))
            for row in np.flatnonzero(is_inside):
                # The slice selects one point as an array of one row.
                seed = points.rows(slice(row, row + 1))
                if not self._needs_mesh(seed):
                    continue
                if self.mesh_surface(seed):
                    self.search.record_new_result()
                elif not self.search.time_limit.note:
                    seeds_without_triangle.append(seed)
            # The note is set as soon as a limit ends a search.
            if self.search.time_limit.note:
                break
        # A mesh from another seed may have covered a seed in the meantime.
        uncovered = sum(self._needs_mesh(seed) for seed in seeds_without_triangle)
        if uncovered:
            self._note_uncovered(uncovered)
        return crossings

    def _needs_mesh(self, seed: LocusPoints) -> bool:
        """Return whether a mesh can start at a configuration (one row) and none covers it.

        Where surfaces cross, the equations for Newton's method are nearly singular.
        """
        if seed.reciprocal_condition[0] < SURFACE_CROSSING_CONDITION:
            return False
        covering = self.find_vertices_near(
            seed.values[0], seed.motions[0], self.edge_length
        )
        return len(covering) == 0

    def _note_uncovered(self, count: int) -> None:
        """Note that singular configurations have no mesh, so that no surface is claimed."""
        time_limit = self.search.time_limit
        edge_deg = np.degrees(self.edge_length)
        note = (
            f"no triangle with edges of {edge_deg:.3g} deg could be made at "
            f"{counted(count, 'singular configuration')}"
        )
        time_limit.note = f"{time_limit.note}; {note}" if time_limit.note else note

    def _may_add_vertex(self) -> bool:
        """Return whether the limits of vertices and of time allow another vertex."""
        time_limit = self.search.time_limit
        count = len(self.vertices)
        if count < MAX_FRONT_VERTICES:
            return time_limit.goes_on(f"vertex {count} of a mesh")
        time_limit.note = f"stopped at {count} vertices"
        return False

    def mesh_surface(self, seed: LocusPoints) -> bool:
        """Cover the surface through one singular configuration, the `seed`, with triangles.

        The first triangle is equilateral, with a corner at the seed. The mesh then grows at
        its open edges, which have a triangle on one side only. An open edge gets a second
        triangle if one of its ends is within the ranges of the inputs. The growth ends when
        no such edge is left, or at the limit of vertices or time. Nothing is done if a
        limit is reached before, or if Newton's method fails at the first triangle.

        Parameters
        ----------
        seed
            The configuration, as an array of one row.

        Returns
        -------
        Whether the seed became a vertex of the mesh.
        """
        if not self._may_add_vertex():
            return False
        # The other two corners, as offsets from the seed in its tangent plane (complex
        # numbers).
        equilateral = [self.edge_length, self.edge_length * (0.5 + 1j * EQUILATERAL_HEIGHT)]
        starts = seed.rows(np.array([0, 0]))
        neighbours = self._compute_vertices(starts, equilateral)
        corners = [point for point in neighbours if point is not None]
        # Newton's method can fail at a neighbour. Without a triangle the seed is no vertex,
        # because it would count as covered, with all seeds near it.
        if len(corners) < 2:
            return False
        self._add_triangle(*(self._add_vertex(point) for point in (seed, *corners)))
        # `_add_triangle` appends the open edges of each new triangle to `waiting_edges`.
        while self.waiting_edges and self._may_add_vertex():
            edge = self.waiting_edges.popleft()
            if self._needs_triangle(edge):
                self._attach_triangle(edge)
        return True

    def _needs_triangle(self, edge: Edge) -> bool:
        """Return whether an edge is open and has an end within the ranges."""
        has_end_inside = any(self.is_inside[vertex] for vertex in edge)
        return edge in self.open_edges and has_end_inside

    def _add_vertex(self, point: LocusPoints) -> int:
        """Add one singular configuration as a vertex; return the index of the vertex."""
        self.vertices = LocusPoints.concatenate([self.vertices, point])
        low, high = self.report.ranges
        margin = RANGE_MARGIN * self.edge_length
        inputs = self.report.inputs_in_range(point.values)
        is_inside = in_range(inputs, low - margin, high + margin)
        self.is_inside.append(bool(np.all(is_inside)))
        return len(self.vertices) - 1

    def _add_triangle(self, a: int, b: int, c: int) -> None:
        """Add a triangle with the same orientation as its neighbour at the edge a, b.

        The mesh grows at its open edges, those that have only one triangle. A side of the
        new triangle becomes an open edge if it has no other triangle. A side that already
        has a triangle now has two, and is no longer open.

        Parameters
        ----------
        a, b, c
            Indices of the vertices.
        """
        # Two neighbours of one orientation pass their common edge in opposite directions.
        if (a, b) in self.directed_edges:
            a, b = b, a
        self.triangles.append((a, b, c))
        for start, end, opposite in ((a, b, c), (b, c, a), (c, a, b)):
            self.directed_edges.add((start, end))
            self._open_or_close_edge(_sorted_edge(start, end), opposite)

    def _open_or_close_edge(self, edge: Edge, opposite: int) -> None:
        """Register a new triangle at one of its sides.

        The first triangle on an edge makes the edge open: it waits for a second triangle.
        The second triangle closes the edge. A closed edge may stay in `waiting_edges`. It
        is skipped when its turn comes.

        Parameters
        ----------
        edge
            The two vertices of the side.
        opposite
            The third vertex of the new triangle. The second triangle has to be on the other
            side of the edge.
        """
        if edge in self.open_edges:
            del self.open_edges[edge]
        else:
            self.open_edges[edge] = opposite
            self.waiting_edges.append(edge)

    def _compute_vertices(
        self, starts: LocusPoints, offsets: Sequence[complex]
    ) -> list[LocusPoints | None]:
        """Return new vertices of the mesh on the surface of singular configurations.

        Each vertex is computed from a position in the tangent plane at an earlier vertex.
        It is the point at which a line through the position, at right angles to the plane,
        meets the surface.

        Each point of the surface has a singular motion: rates that keep the loops closed
        while the inputs, or the output, rest. Newton's method solves for the V pair
        variables of the point and for this motion together.

        Parameters
        ----------
        starts
            The k earlier vertices, at which the planes touch the surface.
        offsets
            For each vertex a position in its tangent plane, as a complex number:
            coordinates (rad) along the two tangents, from the vertex.

        Returns
        -------
        One point for each position. None if Newton's method fails, if surfaces cross at the
        point, or if the point is on another part of the surface than the earlier vertex.
        """
        # (k, 2) coordinates along the two tangents (k, V, 2) of each vertex.
        coordinates = np.stack([np.real(offsets), np.imag(offsets)], axis=1)
        plane_positions = starts.values + np.matvec(starts.tangents, coordinates)
        points = self._project_onto_surface(starts, coordinates, plane_positions)
        is_accepted = self._continues_surface(points, starts, plane_positions)
        return [
            # A slice of one row, because a point is stored as an array of points.
            points.rows(slice(row, row + 1)) if accepted else None
            for row, accepted in enumerate(is_accepted.tolist())
        ]

    def _project_onto_surface(
        self, starts: LocusPoints, coordinates: Floats, plane_positions: Floats
    ) -> LocusPoints:
        """Move positions in tangent planes onto the surface of singular configurations.

        Each position moves at right angles to its plane, by Newton's method.

        Parameters
        ----------
        starts
            The k vertices at which the planes touch the surface.
        coordinates
            (k, 2) positions in the planes, along the two tangents of each plane (rad).
        plane_positions
            (k, V) the same positions as values of the V pair variables (rad).
        """
        # The singular motion (rates with inputs or output at rest) to first order.
        motion_guess = starts.motions + np.matvec(starts.motion_derivatives, coordinates)
        # Two conditions for each point: its coordinates along the two tangents stay the
        # same.
        plane_rows = np.swapaxes(starts.tangents, 1, 2)
        plane_coordinates = np.matvec(plane_rows, plane_positions)
        return self.report.locus.correct(
            values=plane_positions,
            motions=motion_guess,
            conditions=plane_rows,
            targets=plane_coordinates,
        )

    def _continues_surface(
        self, points: LocusPoints, starts: LocusPoints, plane_positions: Floats
    ) -> Bools:
        """Return whether each new point is on the same part of a surface as its start.

        Newton's method can also reach a point on another part, which must not become a
        vertex.

        Parameters
        ----------
        points
            The k points that Newton's method reached from positions in tangent planes.
        starts
            The k vertices at which these planes touch the surface.
        plane_positions
            (k, V) the positions in the planes, as values of the pair variables (rad).

        Returns
        -------
        (k,) truth values.
        """
        # Where surfaces cross, the equations of the points are nearly singular.
        is_crossing = points.reciprocal_condition < SURFACE_CROSSING_CONDITION
        # The tangent planes at both ends are similar if the surface bends little in
        # between.
        plane_cosine = _tangent_plane_cosines(starts, points)
        has_similar_plane = plane_cosine >= SAME_SHEET_COSINE
        # Each point has a singular motion: rates that close the loops while the inputs, or
        # the output, rest. The motions differ between parts of surfaces (sheets) that pass
        # each other. The sign of a motion is arbitrary.
        motion_cosine = np.abs(np.vecdot(points.motions, starts.motions))
        is_on_same_sheet = motion_cosine >= SAME_SHEET_COSINE
        # A point that is farther than half an edge from the tangent plane belongs to
        # another part of the surface.
        distance = np.linalg.norm(points.values - plane_positions, axis=1)
        is_near_plane = distance <= 0.5 * self.edge_length
        # Whether Newton's method reached a singular configuration.
        is_singular = points.is_on_locus
        return (
            is_singular
            & ~is_crossing
            & has_similar_plane
            & is_on_same_sheet
            & is_near_plane
        )

    def _project(self, base: int, vertices: Indices | list[int]) -> list[complex]:
        """Return the positions of vertices in the tangent plane at another vertex."""
        differences = self.vertices.values[vertices] - self.vertices.values[base]
        coordinates = less_periods(differences, self.periods) @ self.vertices.tangents[base]
        return [complex(x, y) for x, y in coordinates]

    def _ideal_apex(self, edge: Edge) -> complex:
        """Return the apex that makes the triangle on the open side of an edge equilateral.

        The apex is a position in the tangent plane at the first vertex of the edge, as a
        complex number with this vertex at 0.
        """
        opposite = self.open_edges[edge]
        end, opposite_position = self._project(edge[0], [edge[1], opposite])
        height = EQUILATERAL_HEIGHT * self.edge_length * end / abs(end)
        is_opposite_left = _twice_area(0.0, end, opposite_position) > 0.0
        # The new triangle is on the other side: a factor of -i turns to the right.
        return 0.5 * end + height * (-1j if is_opposite_left else 1j)

    def _new_vertex(self, edge: Edge) -> LocusPoints | None:
        """Return the new vertex that completes an equilateral triangle on an open edge.

        The mesh approximates a surface of singular configurations. An open edge of the mesh
        has a triangle on one side only. The ideal apex of a second triangle is a position
        in the tangent plane of the surface at the first end of the edge. From there,
        Newton's method goes to a singular configuration, which is the new vertex. The
        result is None if the method fails.

        To save time, the vertices for the next waiting edges are computed together and
        stored in `computed_vertices`.
        """
        if edge not in self.computed_vertices:
            edges = self._edges_to_compute(edge)
            first_ends = self.vertices.rows(np.array([first for first, _ in edges]))
            apexes = [self._ideal_apex(open_edge) for open_edge in edges]
            vertices = self._compute_vertices(first_ends, apexes)
            self.computed_vertices |= dict(zip(edges, vertices, strict=True))
        return self.computed_vertices.pop(edge)

    def _edges_to_compute(self, edge: Edge) -> list[Edge]:
        """Return an edge, and the next waiting edges without computed vertices."""
        edges = [edge]
        for waiting_edge in self.waiting_edges:
            if len(edges) == VERTICES_COMPUTED_TOGETHER:
                break
            is_computed = waiting_edge in self.computed_vertices
            if self._needs_triangle(waiting_edge) and not is_computed:
                edges.append(waiting_edge)
        return edges

    def _attach_triangle(self, edge: Edge) -> None:
        """Put a triangle on the open side of an edge, if there is room for one.

        An open edge has a triangle on one side only. The ideal apex makes the triangle
        equilateral. Candidates for the apex are, in this order: vertices of open edges very
        near to the ideal apex, a new vertex, and vertices of open edges at a greater
        distance. The first candidate whose triangle has a good shape and overlaps no other
        is taken. If there is none, the edge stays open.
        """
        a, b = edge
        # A position in the tangent plane at a, as a complex number: the coordinates (rad)
        # along the two tangents.
        ideal = self._ideal_apex(edge)
        ideal_offset = self.vertices.tangents[a] @ [ideal.real, ideal.imag]
        # Only vertices in this neighbourhood are candidates, and only open edges between
        # them are tested for crossings. The radius has to exceed `MAX_EDGE_LENGTH`, the
        # largest distance of a candidate from the ideal apex, since open edges beyond a
        # candidate can cross the triangle, too. Vertices of other sheets of the surface
        # that pass nearby are left out.
        neighbours = self.find_vertices_near(
            self.vertices.values[a] + ideal_offset,
            self.vertices.motions[a],
            radius=2.5 * self.edge_length,
        )
        # Positions of vertices in the tangent plane at a, as complex numbers.
        positions = dict(
            zip(neighbours.tolist(), self._project(a, neighbours), strict=True)
        )
        positions[a] = 0.0
        (positions[b],) = self._project(a, [b])
        positions[NEW_VERTEX] = ideal
        nearby_open_edges = [
            open_edge
            for open_edge in self.open_edges
            if open_edge[0] in positions and open_edge[1] in positions
        ]
        front_vertices = _ends_of(nearby_open_edges) - {a, b}
        # Vertices by their distance from the ideal apex, relative to the length of the
        # edges, the nearest one first.
        distances = sorted(
            (abs(positions[vertex] - ideal) / self.edge_length, vertex)
            for vertex in front_vertices
        )
        merging = [k for distance, k in distances if distance < MERGING_DISTANCE]
        reachable = [k for distance, k in distances if distance < MAX_EDGE_LENGTH]
        for apex in (*merging, NEW_VERTEX, *reachable):
            new_point = None
            if apex == NEW_VERTEX:
                new_point = self._new_vertex(edge)
                # A new vertex is crowded if another one is nearer than
                # `MIN_VERTEX_DISTANCE`.
                if new_point is None or self._is_crowded(new_point):
                    continue
            if self._triangle_fits(edge, apex, positions, nearby_open_edges):
                # A new vertex gets its number only if the triangle fits.
                if new_point is not None:
                    apex = self._add_vertex(new_point)
                self._add_triangle(a, b, apex)
                return

    def _is_crowded(self, point: LocusPoints) -> bool:
        """Return whether a point is too near to a vertex to become a vertex itself."""
        radius = MIN_VERTEX_DISTANCE * self.edge_length
        neighbours = self.find_vertices_near(point.values[0], point.motions[0], radius)
        return len(neighbours) > 0

    def _triangle_fits(
        self,
        edge: Edge,
        apex: int,
        positions: dict[int, complex],
        nearby_open_edges: list[Edge],
    ) -> bool:
        """Return whether a triangle on an edge has a good shape and overlaps no other.

        Its height and sides have to be within limits, its new sides may not cross an open
        edge, and no vertex of an open edge may be inside it. An open edge has a triangle on
        one side only.

        Parameters
        ----------
        edge
            The open edge.
        apex
            Index of the third vertex, or `NEW_VERTEX` for a new one at the ideal apex,
            which makes the triangle equilateral.
        positions
            Positions of the vertices around, and of `NEW_VERTEX`, in the tangent plane at
            the first vertex of the edge, as complex numbers (rad).
        nearby_open_edges
            Open edges whose vertices have positions.
        """
        a = positions[edge[0]]
        b = positions[edge[1]]
        apex_position = positions[apex]
        # The area is positive if the apex is on the same side as the ideal one.
        outward_sense = np.sign(_twice_area(a, b, positions[NEW_VERTEX]))
        twice_area = outward_sense * _twice_area(a, b, apex_position)
        # Twice the area is the height times the length of the edge. Rounding would decide
        # whether a flatter triangle overlaps others.
        if twice_area < MIN_TRIANGLE_HEIGHT * self.edge_length * abs(b - a):
            return False
        # The two new sides, from each end of the edge to the apex.
        for end in edge:
            # An edge has at most two triangles. `directed_edges` has the edges of all
            # triangles, with their vertices in the order of the triangle. `open_edges`
            # has the edges with one triangle, with the lower vertex first.
            new_edge = _sorted_edge(end, apex)
            has_triangle = (
                new_edge in self.directed_edges or new_edge[::-1] in self.directed_edges
            )
            has_two_triangles = has_triangle and new_edge not in self.open_edges
            if has_two_triangles:
                return False
            if abs(apex_position - positions[end]) > MAX_EDGE_LENGTH * self.edge_length:
                return False
            # Edges with a common vertex cannot cross.
            for first, second in nearby_open_edges:
                has_common_vertex = {end, apex} & {first, second}
                if not has_common_vertex and _segments_cross(
                    positions[end], apex_position, positions[first], positions[second]
                ):
                    return False
        other_vertices = _ends_of(nearby_open_edges) - {*edge, apex}
        return not any(
            _is_in_triangle(positions[vertex], a, b, apex_position)
            for vertex in other_vertices
        )


def _tangent_plane_cosines(first: LocusPoints, second: LocusPoints) -> Floats:
    """Return the cosine (k,) of the greatest angle between tangent planes at two points.

    The tangent planes belong to surfaces of singular configurations. If the angle is large,
    the caller takes the two points to be on different parts of surfaces. The cosines of the
    principal angles between two planes are the singular values of the product of their
    orthonormal bases. The smallest cosine belongs to the greatest angle. The cosine is 0 in
    rows in which a point is missing (NaN).
    """
    overlap = np.swapaxes(first.tangents, 1, 2) @ second.tangents
    is_finite = all_finite(overlap, (1, 2))
    cosines = np.linalg.svd(
        np.where(is_finite[:, None, None], overlap, 0.0), compute_uv=False
    )
    smallest_cosine: Floats = cosines[:, -1]
    return smallest_cosine


def _sorted_edge(first: int, second: int) -> Edge:
    """Return an edge with the lower vertex index first."""
    return min(first, second), max(first, second)


def _ends_of(edges: Sequence[Edge]) -> set[int]:
    """Return all vertices of some edges."""
    return {vertex for edge in edges for vertex in edge}


def _twice_area(a: complex, b: complex, c: complex) -> float:
    """Return twice the area of a triangle, positive if c is to the left of a to b."""
    return ((b - a).conjugate() * (c - a)).imag


def _segments_cross(a: complex, b: complex, c: complex, d: complex) -> bool:
    """Return whether the segments from a to b and from c to d cross."""
    are_c_d_on_both_sides = _twice_area(a, b, c) * _twice_area(a, b, d) < 0.0
    if not are_c_d_on_both_sides:
        return False
    return _twice_area(c, d, a) * _twice_area(c, d, b) < 0.0


def _is_in_triangle(point: complex, a: complex, b: complex, c: complex) -> bool:
    """Return whether a point is inside a triangle of any orientation."""
    areas = [_twice_area(a, b, point), _twice_area(b, c, point), _twice_area(c, a, point)]
    return min(areas) > 0.0 or max(areas) < 0.0
