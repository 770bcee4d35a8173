"""Surfaces of singular configurations of a mechanism with three inputs, as triangle meshes.

The mesh is grown by `spherekit.singularities.surface_front`. This module adds vertices at
further singular configurations to refine the mesh, and cuts it at the ends of the ranges of
the inputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices
from spherekit.completeness import Completeness
from spherekit.errors import AnalysisError
from spherekit.geometry.sphere_mesh import list_edges
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.connectivity import label_components
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.input_revolutions import in_range, less_periods
from spherekit.singularities.curve_starts import LocusPointSearch
from spherekit.singularities.locus import LocusPoints
from spherekit.singularities.singularity_report import (
    LocusName,
    SingularityReport,
    SingularPoints,
)
from spherekit.singularities.slices import LockedInputSection
from spherekit.singularities.surface_front import SurfaceFront
from spherekit.time_limit import TimeLimit

NO_VERTEX = -1
"""Stands for the vertex of an edge on which no new vertex is placed."""
HALVING_TIME_RATIO = 0.25
"""Time that one vertex takes when edges are halved, relative to a vertex of the first mesh.
Larger: less of the time limit is spent on the first mesh."""
EQUAL_INPUT_TOLERANCE_RAD = 1e-9
"""If an input differs by less at the ends of an edge, the edge runs along an end of the
range of that input. Larger: other edges are taken for edges at an end of the range."""


@dataclass(frozen=True)
class _EdgePoints:
    """Points on k edges of a mesh whose vertices are singular configurations.

    The points are interpolated linearly, so they are only near the singular surface. They
    are the starting points of Newton's method, which moves them onto the surface.
    Points that reach it become new vertices of the mesh.

    Attributes
    ----------
    values
        (k, V) values of the V pair variables (rad).
    motions
        (k, V) rates of the variables in the singular motion, in which the inputs (type II)
        or the output (type I) rest.
    edge_vectors
        (k, V) differences of the variables from the first to the second end of each edge
        (rad), less whole periods such as 2 pi. They show how far Newton's method may move a
        point, and which inputs are constant on an edge.
    """

    values: Floats
    motions: Floats
    edge_vectors: Floats


@dataclass(frozen=True)
class SingularSurface:
    """A mesh of triangles on surfaces of singular configurations.

    Surfaces of singular configurations occur in mechanisms with three inputs.

    Attributes
    ----------
    view
        The type of singularity, with the mechanism, its output and the ranges of inputs.
    nodes
        The n vertices, which are singular configurations up to `points.residual`.
    triangles
        (m, 3) indices of vertices. Variables at the ends of an edge may differ by whole
        revolutions in addition to the length of the edge.
    side
        Length of the edges aimed at (rad, in the space of the variables), after halving.
    claim
        The guarantee of completeness: what is known of surfaces that the search may have
        missed.
    irregular
        Number of irregular singular configurations within the ranges that the search
        yielded: surfaces cross at them, or their neighbourhood is singular in more than two
        dimensions. `claim` has the number of those at which Newton's method reached no
        first triangle.
    everywhere
        Whether every configuration is of the type, so that there is no surface.
    """

    view: SingularityReport
    nodes: LocusPoints
    triangles: Indices
    side: float
    claim: Completeness
    irregular: int
    everywhere: bool

    @property
    def kind(self) -> LocusName:
        """The type of singularity."""
        return self.view.kind

    @cached_property
    def points(self) -> SingularPoints:
        """The vertices with their inputs, poses and types."""
        return self.view.points(self.nodes)

    @property
    def component(self) -> Indices:
        """(n,) index of the connected part to which each vertex belongs."""
        edges, _ = list_edges(self.triangles)
        return label_components(len(self.nodes), edges)

    @property
    def guarantee(self) -> str:
        """What the mesh guarantees, in words."""
        return (
            "vertices are exact; between them the mesh is flat, with edges of about "
            f"{np.degrees(self.side):.3g} deg; {self.claim}"
        )

    @property
    def border(self) -> Indices:
        """(k, 2) edges at the border of the mesh, which have only one triangle.

        At these edges the surface leaves the ranges, comes near to a crossing of surfaces,
        or was not completed.
        """
        edges, sides = list_edges(self.triangles)
        triangle_counts = np.bincount(sides.ravel(), minlength=len(edges))
        return edges[triangle_counts == 1]

    def split(self) -> Self:
        """Return a finer mesh, with a new vertex in the middle of every edge.

        The middle of an edge is only near the surface of singular configurations. Newton's
        method moves it onto the surface. An edge for which the method fails stays whole. A
        triangle with one, two or three halved edges becomes two, three or four triangles.
        """
        edges, _ = list_edges(self.triangles)
        middles = self._interpolate(edges, part=0.5)
        # (edges, 2, V) the two tangents of the surface at the first end of each edge, as
        # changes of the V pair variables. A middle moves at right angles to both tangents,
        # so that Newton's method finds one point of the surface. Any point of the surface
        # near the middle is suitable, so tangents at the end of the edge are good enough.
        tangent_rows = np.swapaxes(self.nodes.tangents[edges[:, 0]], 1, 2)
        new_points = self._correct(middles, tangent_rows)
        # All old vertices remain in the mesh.
        remains = np.ones(len(self.nodes), dtype=bool)
        mesh = self._subdivide(np.arange(len(edges)), new_points, remains)
        # `side` is the length of the edges that the mesh aims at.
        return replace(mesh, side=0.5 * self.side)

    def reported(self) -> Self:
        """Return the part of the mesh that is reported to the user.

        The mesh is clipped at both ends of the range of each input. A range can be a little
        less than the period of the input, such as 350 of 360 deg. Triangles may then lead
        from one end of the range to the other through the values outside. They are removed.
        Vertices with another type of singularity are removed, with their triangles.
        """
        # The report knows the type and the ranges of the inputs.
        report = self.view
        mesh = self
        for input_position, (low, high) in enumerate(report.ranges.T):
            # The part above the low end remains, then the part below the high end.
            mesh = mesh._clip(input_position, limit=low, side=1.0)
            mesh = mesh._clip(input_position, limit=high, side=-1.0)
            mesh = mesh._without_bridges(input_position)
        is_of_type = report.has_type(report.types(mesh.nodes.values))
        # Without edges to divide, `_subdivide` only removes the vertices that are not of
        # the type.
        no_edges = np.zeros(0, dtype=np.intp)
        return mesh._subdivide(no_edges, mesh.nodes.rows(no_edges), is_of_type)

    def _without_bridges(self, input_position: int) -> Self:
        """Return the mesh without the triangles that lead out of the range of an input.

        If the range is a little less than the period of the input, such as 350 of 360 deg,
        a triangle can bridge the gap. It has vertices near both ends of the range, and
        leads from one end to the other through the values outside. All vertices must be
        within the range.

        Parameters
        ----------
        input_position
            Position of the input among the inputs.
        """
        report = self.view
        low, high = report.ranges[:, input_position]
        period = report.solver.periods[input_position]
        if not np.isfinite(period) or high - low > period - EQUAL_INPUT_TOLERANCE_RAD:
            return self
        variable = report.solver.driven[input_position]
        angles = self.nodes.values[:, variable]
        inputs = report.inputs_in_range(self.nodes.values)[:, input_position]
        # (m, 3) the vertices at both ends of the sides of each triangle.
        first = self.triangles
        second = np.roll(first, -1, axis=1)
        # The change of the angle along each side, without whole periods. Inside the range
        # this is also the change of the input. Across a bridge the two changes differ by a
        # whole period.
        angle_changes = less_periods(angles[second] - angles[first], self.periods[variable])
        excess = np.abs(inputs[second] - inputs[first] - angle_changes)
        is_bridge = excess > EQUAL_INPUT_TOLERANCE_RAD
        return replace(self, triangles=first[~is_bridge.any(axis=1)])

    def _clip(self, input_position: int, limit: float, side: float) -> Self:
        """Return the part of the mesh in which an input is on one side of a limit.

        The vertices of the mesh are singular configurations. Each edge across the limit
        gets a new vertex: a singular configuration with the input at the limit. The edges
        and triangles beyond the limit are removed.

        Parameters
        ----------
        input_position
            Position of the input among the inputs.
        limit
            The lowest or the highest value of its range (rad).
        side
            1.0 if values above the limit remain, -1.0 if values below it remain.
        """
        # Inputs of the vertices, moved by whole periods into their ranges.
        inputs = self.view.inputs_in_range(self.nodes.values)
        margin = side * (inputs[:, input_position] - limit)
        is_inside = in_range(margin, 0.0, np.inf)
        edges, _ = list_edges(self.triangles)
        (crossing_edges,) = np.nonzero(is_inside[edges[:, 0]] != is_inside[edges[:, 1]])
        ends = edges[crossing_edges]
        # Linear interpolation gives the position of the limit on the edge: 0 at its first
        # end, 1 at its second.
        first_distance, second_distance = np.abs(margin[ends]).T
        part = first_distance / (first_distance + second_distance)
        guess = self._interpolate(ends, part[:, None])

        # The guess is on the straight edge, so it is only near the surface. Newton's method
        # moves it onto the surface. There the input is at the limit along a whole curve, so
        # two linear equations select one point. The first keeps the input at the limit. The
        # second keeps the point from moving along this curve. The tangent plane of the
        # surface at the first end of the edge gives the direction of the curve.
        variable = self.view.solver.driven[input_position]
        tangents = self.nodes.tangents[ends[:, 0]]
        equation_rows = self._limit_equations(variable, tangents, guess.edge_vectors)
        # The guess is moved (in place) to the limit, without a jump by whole revolutions.
        guess.values[:, variable] += less_periods(
            limit - guess.values[:, variable], self.periods[variable]
        )
        # Cut these edges at the new points, and remove the vertices outside.
        new_points = self._correct(guess, equation_rows)
        return self._subdivide(crossing_edges, new_points, is_inside)

    def _limit_equations(
        self, variable: int, tangents: Floats, edge_vectors: Floats
    ) -> Floats:
        """Return two equations for each point at which an edge crosses a limit of an input.

        The edges are sides of the triangles of the mesh. They are cut at these points. A
        point on an edge is only near the surface of singular configurations, and Newton's
        method moves it onto the surface. Two linear equations in the V pair variables
        select one point of the surface:

        1. The input is at its limit.
        2. The point does not move along the tangent direction of the surface in which the
           input is constant. Some edges were made when the mesh was cut at a limit of
           another input, and lie on this limit. On them, the other input keeps its value
           instead.

        Parameters
        ----------
        variable
            Index of the variable of the input.
        tangents
            (k, V, 2) orthonormal tangents of the surface at the first end of each edge.
        edge_vectors
            (k, V) differences of the variables from the first to the second end (rad).

        Returns
        -------
        (k, 2, V) coefficients of both equations.
        """
        # (k, 2) changes of the input along the two tangents. Turned by 90 deg in the
        # tangent plane, they are the direction along which the input is constant.
        input_gradient = tangents[:, variable]
        level_coordinates = input_gradient[:, ::-1] * [-1.0, 1.0]
        second_rows = np.vecmat(level_coordinates, np.swapaxes(tangents, 1, 2))
        unit_vectors = np.eye(edge_vectors.shape[1])
        for other_variable in self.view.solver.driven:
            # An edge lies on a limit of another input if this input is the same at both
            # ends. (The limited input itself differs at the ends.)
            edge_change = np.abs(edge_vectors[:, other_variable])
            is_constant = edge_change < EQUAL_INPUT_TOLERANCE_RAD
            second_rows[is_constant] = unit_vectors[other_variable]
        first_rows = np.broadcast_to(unit_vectors[variable], edge_vectors.shape)
        return np.stack([first_rows, second_rows], axis=1)

    @property
    def periods(self) -> Floats:
        """(V,) growth of each variable (rad) that leaves the configuration unchanged."""
        return variable_periods(self.view.locus.closure)

    def _interpolate(self, edges: Indices, part: Floats | float) -> _EdgePoints:
        """Return points on edges of the mesh, by linear interpolation between the two ends.

        A point has the pair variables and the singular motion. The singular motion is a
        vector of rates with which the inputs or the output rest. Newton's method leads from
        the points onto the surface of singular configurations.

        Parameters
        ----------
        edges
            (k, 2) indices of the vertices at the ends of each edge.
        part
            (k, 1) position on each edge, from 0 (first end) to 1. One number for all edges
            is allowed.
        """
        first, second = self.nodes.values[edges.T]
        first_motion, second_motion = self.nodes.motions[edges.T]
        # A variable can grow by a period without a change of the configuration: an angle by
        # a revolution, an arc length by the circumference of its profile. Such periods are
        # removed from the differences.
        edge_vectors = less_periods(second - first, self.periods)
        # The opposite of a singular motion is a singular motion, too. The motion at the
        # second end gets the sign that agrees with the motion at the first end.
        second_motion *= np.sign(np.vecdot(first_motion, second_motion))[:, None]
        values = first + part * edge_vectors
        motions = first_motion + part * (second_motion - first_motion)
        return _EdgePoints(values, motions, edge_vectors)

    def _correct(self, guess: _EdgePoints, equation_rows: Floats) -> LocusPoints:
        """Move points on edges of the mesh onto the surface of singular configurations.

        Newton's method solves for the pair variables and the singular motion together. The
        singular motion is a vector of rates with which the inputs or the output rest. A
        point that moves by more than half the length of its edge may be on another part of
        the surface. Its residual is set to NaN, so that the point counts as failed.

        Parameters
        ----------
        guess
            Points on k edges, with interpolated singular motions.
        equation_rows
            (k, 2, V) two conditions for each point, which fix the point in the two
            directions along the surface. Newton's method then moves the point only across.
            The product of each row with the V variables stays the same as at the guess.

        Returns
        -------
        The k points, with their residuals.
        """
        # The right-hand sides of the two conditions: the products at the guess.
        targets = np.matvec(equation_rows, guess.values)
        points = self.view.locus.correct(
            guess.values, guess.motions, equation_rows, targets
        )
        distance = np.linalg.norm(points.values - guess.values, axis=1)
        edge_length = np.linalg.norm(guess.edge_vectors, axis=1)
        # The negated comparison is true for points that are NaN.
        points.residual[~(distance < 0.5 * edge_length)] = np.nan
        return points

    def _subdivide(
        self, edge_numbers: Indices, edge_points: LocusPoints, is_inside: Bools
    ) -> Self:
        """Return the mesh with new vertices on some edges, and without some old vertices.

        The method has two uses. To refine the mesh, all edges get a vertex in their middle,
        and all old vertices remain. To cut the mesh at a limit of an input, the edges
        across the limit get a vertex at the limit. The old vertices beyond the limit are
        removed.

        Each triangle is replaced by smaller triangles between its remaining corners and the
        new vertices on its sides. If only one end of a side remains and the side has no new
        vertex, its triangles are removed. Vertices without a triangle are removed, too.

        Parameters
        ----------
        edge_numbers
            (k,) indices, in the order of `list_edges`, of the edges that get a new vertex.
        edge_points
            The k new vertices. Those that Newton's method could not move onto the surface
            of singular configurations (the locus) are left out.
        is_inside
            (n,) whether each old vertex remains.
        """
        # (edges, 2) vertices of edges, and (m, 3) indices of the edges of each triangle.
        edges, sides = list_edges(self.triangles)
        (good,) = np.nonzero(edge_points.is_on_locus)
        # New vertices are numbered after the old ones.
        vertex_of_edge = np.full(len(edges), NO_VERTEX)
        vertex_of_edge[edge_numbers[good]] = len(self.nodes) + np.arange(len(good))

        triangles: list[tuple[int, ...]] = []
        for corners, side_vertices, corner_inside in zip(
            self.triangles.tolist(),
            vertex_of_edge[sides].tolist(),
            is_inside[self.triangles].tolist(),
            strict=True,
        ):
            triangles += _subdivide_triangle(corners, side_vertices, corner_inside)
        # The vertices in use are numbered anew, without gaps.
        used_vertices, new_numbers = np.unique(
            np.array(triangles, dtype=np.intp).reshape(-1, 3), return_inverse=True
        )
        vertices = LocusPoints.concatenate([self.nodes, edge_points.rows(good)])
        return replace(
            self,
            nodes=vertices.rows(used_vertices),
            triangles=new_numbers.reshape(-1, 3),
        )


def _subdivide_triangle(
    corners: list[int], side_vertices: list[int], is_inside: list[bool]
) -> list[tuple[int, ...]]:
    """Divide one triangle of a mesh, if the mesh is cut at a limit or refined.

    A limit is an end of the range of an input. If the mesh is cut there, corners outside
    are removed. Each side across the limit then has a new vertex at the limit. If the mesh
    is refined, all corners are inside, and some sides have a new vertex in their middle.

    Parameters
    ----------
    corners
        Indices of the vertices at the three corners 1, 2, 3 of the triangle.
    side_vertices
        Indices of the new vertices on the sides 12, 23 and 31; `NO_VERTEX` for a side
        without a new vertex.
    is_inside
        Whether each corner is inside.

    Returns
    -------
    Three vertices for each new triangle. Together the new triangles cover the part of the
    triangle that is inside. The list is empty if a side crosses the limit but has no new
    vertex at which it could be cut.
    """
    polygon = _inside_polygon(corners, side_vertices, is_inside)
    if not polygon:
        return []
    if len(polygon) == 6:
        # All sides are halved: four triangles.
        a, ab, b, bc, c, ca = polygon
        return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    # The polygon is split into triangles that share one corner, the apex. With an old
    # vertex as the apex, all corners of a triangle could lie on one line: an old side with
    # its new vertex. So a new vertex is the apex, if there is one.
    apex_position = 0
    for position, vertex in enumerate(polygon):
        is_new_vertex = vertex in side_vertices
        if is_new_vertex:
            apex_position = position
            break
    return _fan_triangles(polygon, apex_position)


def _inside_polygon(
    corners: list[int], side_vertices: list[int], is_inside: list[bool]
) -> list[int]:
    """Return the vertices of the remaining part of a triangle, in the order of its border.

    When a mesh is cut at a limit, the part of a triangle beyond the limit is removed. The
    vertices are the corners that are inside, and the new vertices on the sides. The list is
    empty if nothing remains. It is also empty if a side crosses the limit but has no new
    vertex: the place of the cut is then unknown.

    When a mesh is refined, all corners are inside, and sides can have a new vertex.

    Parameters
    ----------
    corners
        Indices of the vertices at the three corners of the triangle.
    side_vertices
        For each side, from one corner to the next, its new vertex or `NO_VERTEX`.
    is_inside
        Whether each corner is inside.
    """
    polygon: list[int] = []
    for start in range(3):
        end = (start + 1) % 3
        if is_inside[start]:
            polygon.append(corners[start])
        # The side from corner `start` to corner `end`.
        side_vertex = side_vertices[start]
        has_to_be_cut = is_inside[start] != is_inside[end]
        if side_vertex != NO_VERTEX:
            polygon.append(side_vertex)
        elif has_to_be_cut:
            return []
    return polygon


def _fan_triangles(polygon: list[int], apex_position: int) -> list[tuple[int, ...]]:
    """Return triangles that cover a convex polygon and share one of its vertices, the apex.

    Parameters
    ----------
    polygon
        Indices of the vertices, in the order of the border.
    apex_position
        Position of the apex in this list.
    """
    # The other vertices, in the order of the border from the apex on.
    others = polygon[apex_position + 1 :] + polygon[:apex_position]
    apex = polygon[apex_position]
    return [(apex, first, second) for first, second in pairwise(others)]


@checked(AnalysisError)
def singular_surface(
    mechanism: Mechanism,
    kind: LocusName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    side: float = 0.15,
    halved: int = 0,
    slices_of_each: int = 4,
    made: LockedInputSection | None = None,
    budget: TimeLimit | None = None,
) -> SingularSurface:
    """Return the surfaces of singular configurations of a mechanism with three inputs.

    A search yields singular configurations. From each that is not covered yet, a mesh of
    triangles grows over the surface. The edges of the mesh are then halved `halved`
    times.

    Parameters
    ----------
    mechanism
        The mechanism.
    kind
        Type of the singularity: "II", the output can move while the inputs are at rest;
        "I", inputs can move while the output is at rest; or "self-motion", other links can
        move while inputs and output are at rest.
    output, pointing
        The output, and a direction of it if this has to rest instead of the whole link; see
        `spherekit.singularities.stationarity.output_of`.
    side
        Length (rad, in the space of all variables) of the edges of the first mesh.
    halved
        How often every edge is halved afterwards. Its middle is moved onto the surface.
    slices_of_each
        The search follows curves on which two of the inputs are locked. This is the number
        of values at which each input is locked, evenly spread over its range. With 0 the
        search starts from random closed configurations. Not used if `made` is given.
    made
        Curves with two locked inputs that were followed before, or None.
    budget
        The time to spend, unlimited by default.

    Returns
    -------
    The mesh within the ranges of the inputs, with what is known of surfaces that were not
    found. It has no triangles if every configuration is of the type.

    Raises
    ------
    AnalysisError, ModelError, PlanError
        If the mechanism does not have three inputs and three degrees of freedom, if it has
        no such output, or if another argument is not allowed. Also if type I of a direction
        is asked for: with three inputs every configuration is of this type.
    """
    # With such a side no triangle could be made, and no surface would be reported.
    if not 0.0 < side < np.inf:
        raise AnalysisError(
            f"{mechanism.name}: side: found {side}, expected a finite number above 0"
        )
    if halved < 0:
        raise AnalysisError(
            f"{mechanism.name}: halved: found {halved}, expected a number of at least 0"
        )
    search = LocusPointSearch(
        mechanism,
        input_count=3,
        kind=kind,
        output=output,
        pointing=pointing,
        section=made,
        slices_of_each=slices_of_each,
        time_limit=budget,
    )
    time_limit = search.time_limit
    if halved:
        # Each halving multiplies the number of vertices by four. All halvings take this
        # time, relative to the time of the first mesh, which gets the rest of the budget.
        halving_time = HALVING_TIME_RATIO * 4**halved
        search.time_limit = time_limit.part(1.0 / (1.0 + halving_time))
    front = SurfaceFront(search, side)
    irregular = front.mesh_all_surfaces()
    mesh = SingularSurface(
        view=search.report,
        nodes=front.vertices,
        triangles=np.array(front.triangles, dtype=np.intp).reshape(-1, 3),
        side=side,
        claim=search.completeness("surface"),
        irregular=irregular,
        everywhere=search.is_everywhere,
    )
    for _ in range(halved):
        time_limit.report_if_due(f"halving the edges of {len(mesh.triangles)} triangles")
        mesh = mesh.split()
    # The mesh extends a little beyond the ranges of the inputs, where it is cut off.
    return mesh.reported()
