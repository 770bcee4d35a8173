"""Singular curves of a mechanism in its mid-plane architecture, mode by mode.

The unit normal n of the mid-plane and the signs of the legs determine a configuration.

- Type I: an input moves while the output rests if a driven leg is at the limit of its
  reach, ``|n . b| = sin a`` with its base axis b and its arc a. These are circles of n.
- Type II: with the inputs locked there are usually as many velocity equations as unknowns.
  Their determinant is a smooth function of n in each mode. It changes its sign where the
  output can move with the inputs at rest, also where the loops lose their rank. The regular
  equations of `spherekit.singularities` do not hold there. If there are more equations than
  unknowns (over-constrained loops), this module has no curves of type II.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import ModelError
from spherekit.geometry.sphere_mesh import hemisphere, list_edges
from spherekit.geometry.triangle import arc, perpendicular
from spherekit.geometry.vectors import all_finite, cross, nans, unit_rows
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.connectivity import order_chains
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.singularities.singular_curves import CurveSeen, SingularCurves
from spherekit.singularities.singularity_report import LocusName, SingularityReport
from spherekit.singularities.slices import solver_of
from spherekit.singularities.stationarity import output_of
from spherekit.time_limit import TimeLimit
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS, REACH_SLACK

LOCUS_MESH_SIDE_RAD = float(np.radians(4.0))
"""Longest side (rad) of the triangles in which curves are searched.

Larger: more closed curves that are smaller than a triangle are missed. Smaller: more time.
"""

LIMIT_ARC_STEP_RAD = float(np.radians(1.0))
"""Largest angle (rad) between neighbouring points of a circle of type I, about its centre.

Larger: fewer points on each curve. Smaller: more time.
"""

LEAST_ARC_RAD = 1e-7
"""Angle (rad) of an arc of type I, about the centre of its circle, below which it is empty.

It is above the rounding error of both ends, about 1e-8 where a circle touches a limit.
Larger: short arcs are missed. Smaller: rounding errors can make arcs.
"""

COLLINEAR_ELBOWS_SINE = 1e-6
"""Sine of the angle between both driven elbows below which they lie on one line.

Larger: curves where the loops lose their rank can be reported as lines of elbows. Smaller:
rounding errors hide that the elbows lie on one line.
"""


def mid_plane_loci(
    mechanism: Mechanism,
    kind: LocusName,
    output: str | None = None,
    budget: TimeLimit | None = None,
) -> SingularCurves | None:
    """Return the singular curves of one type, for a mechanism with mid-plane architecture.

    Base and output mirror each other in the mid-plane. Its unit normal n and a sign for
    each leg determine a configuration. The sign chooses one of the two elbows (axes between
    its two links) that the leg can have. A singular curve is therefore a curve of normals.
    The normals n and -n belong to the same plane, so each plane is considered once.

    Curves of type I (an input can move while the output rests) are computed in closed form.
    Curves of type II (the output can move with locked inputs) are searched on a mesh of
    mid-planes. Closed curves that are smaller than its triangles can be missed.
    Configurations in which the output is no mirror image of the base are not searched. The
    result states how complete it is.

    Parameters
    ----------
    mechanism
        The mechanism.
    kind
        The type of singularity.
    output
        Name of the output; may be left out if there is one.
    budget
        Limit of the time; none by default.

    Returns
    -------
    The curves. None if the mechanism has no mid-plane architecture, or for type II if its
    velocity equations with locked inputs are not square.
    """
    try:
        form = mid_plane_form(mechanism, output)
    except ModelError:
        return None
    budget = budget or TimeLimit()
    search = _MidPlaneCurveSearch(form, mechanism, kind, output)
    if kind == "I":
        curves = list(search.find_borders())
    elif not search.has_square_equations:
        return None
    else:
        curves = list(search.find_determinant_zeros(budget))
    excluded = "configurations in which the output is not a mirror image of the base"
    # COMPONENT: complete for mirror images. TO_BOX: complete for curves larger than the
    # mesh. SAMPLED: the time was over before the search ended.
    if kind == "I":
        method = f"borders of the reach of driven legs in closed form, without {excluded}"
        completeness = Completeness(Guarantee.COMPONENT, method)
    elif budget.note:
        completeness = Completeness(Guarantee.SAMPLED, budget.note)
    else:
        method = f"changes of sign over the mid-planes of every mode, without {excluded}"
        completeness = Completeness(Guarantee.TO_BOX, method, LOCUS_MESH_SIDE_RAD)
    # Singular configurations that are on no curve: none are searched.
    stray = np.zeros((0, len(mechanism.variable_owners)))
    return SingularCurves(kind, curves=tuple(curves), claim=completeness, stray=stray)


@dataclass(frozen=True)
class SingularMotions:
    """A motion at each of n configurations, and how nearly it is a singular motion.

    At a singular configuration some rates of the pairs solve the velocity equations while
    the output or the inputs rest. Of all rates with unit length, those with the least error
    of these equations are stored.

    Attributes
    ----------
    rates
        (n, variables) rates of the pair variables, of unit length.
    residual
        (n,) the larger one of two errors, which are both 0 at a singular configuration: the
        error of these equations, and the rotation (rad) that a loop lacks to be closed. The
        residual is infinite where there is no configuration.
    """

    rates: Floats
    residual: Floats


class _MidPlaneCurveSearch:
    """Finds the curves of singular mid-planes of a mechanism in each of its modes.

    Parameters
    ----------
    form
        The mid-plane architecture, in which base and output mirror each other in a plane.
    mechanism
        The mechanism.
    kind
        The type of singularity.
    output
        Name of the output, or None if there is one.

    Attributes
    ----------
    report
        Object that describes the singular configurations of this type.
    locus
        The equations of this type.
    passive
        Numbers of the variables that are not driven.
    """

    def __init__(
        self,
        form: MidPlaneArchitecture,
        mechanism: Mechanism,
        kind: LocusName,
        output: str | None,
    ) -> None:
        """Prepare the search for singular configurations of one type.

        Parameters
        ----------
        form
            The mid-plane architecture, in which base and output mirror each other in a
            plane. The normal of this plane determines a configuration in each mode (way to
            assemble the legs).
        mechanism
            The mechanism.
        kind
            The type: "I" if an input can move while the output rests, otherwise "II".
        output
            Name of the output, or None if there is one.
        """
        self.form = form
        solver = solver_of(mechanism)
        # The report has the equations of the type, and describes singular configurations.
        self.report = SingularityReport(solver, output_of(mechanism, output), kind)
        # The equations whose solutions are the singular configurations.
        self.locus = self.report.locus
        # Numbers of the variables that are not driven.
        self.passive = [
            v for v in range(len(mechanism.variable_owners)) if v not in solver.driven
        ]

    @property
    def has_square_equations(self) -> bool:
        """Whether there are as many velocity equations as variables that are not driven.

        Each closed loop (chord of the tree of links) has three equations.
        """
        return 3 * len(self.locus.closure.tree.chords) == len(self.passive)

    def find_borders(self) -> Iterator[CurveSeen]:
        """Yield the curves of type I, which are the borders of the reach of driven legs.

        A driven leg is a leg whose pair at the base is an input. At the limit of its reach
        it is stretched or folded. There the input can move while the output rests, which is
        a singularity of type I. Base and output mirror each other in the mid-plane. The
        normal of this plane determines the pose, so each point of a curve is a normal. The
        curves are circles, or arcs of circles. Arcs end where another leg does not reach,
        or at n_z = 0, because n and -n belong to the same plane.

        An assembly mode has a sign, 1 or -1, for each leg, which chooses one of its two
        possible elbows (axes between both links). The curves are yielded for each choice of
        the signs of the other legs. At its limit the driven leg has only one elbow, and its
        sign is set to 1.
        """
        leg_count = len(self.form.legs)
        # `driven` has the numbers of the two driven legs.
        for driven_leg in self.form.plane.driven:
            # The name of the input: the pair of this leg at the base.
            input_name = self.form.name_of(driven_leg)
            limit_arcs = self._find_limit_arcs(driven_leg)
            for other_signs in product((1, -1), repeat=leg_count - 1):
                # The signs of all legs: 1 is inserted at the place of the driven leg.
                signs = np.insert(np.array(other_signs), driven_leg, 1)
                reason = f"leg of {input_name} at the limit of its reach"
                for normals, is_closed in limit_arcs:
                    yield self._make_curve(normals, signs, is_closed, reason)

    def _find_limit_arcs(self, leg: int) -> list[tuple[Floats, bool]]:
        """Return the arcs of normals n at which a leg is at the limit of its reach.

        The elbow of the leg (axis between its two links) is in the mid-plane, at the angle
        a (arc of the link) from the base axis b of the leg. At the limit of the reach,
        ``|n . b| = sin a``. This gives two circles, with the centres b and -b. Only the
        parts with n_z >= 0 that all other legs reach are returned. They end at zeros of
        n . d - c, where d is the z axis and c is 0, or d is the base axis of another leg
        and c is plus or minus the sine of its reach. On a circle this is an equation
        A cos(t) + B sin(t) = C for the angle t about the centre.

        Returns
        -------
        For each arc: its unit normals (n, 3), and whether it is a whole circle. The last
        normal of a whole circle is the first one.
        """
        plane = self.form.plane
        axis = plane.axes[leg]
        radius = np.cos(plane.reach[leg])
        if radius**2 <= REACH_SLACK:
            return []  # the circle is a point, at which all elbows are possible
        x_axis = perpendicular(axis)
        y_axis = cross(axis, x_axis)
        other_axes = np.delete(plane.axes, leg, axis=0)
        other_limits = np.sin(np.delete(plane.reach, leg))
        border_axes = np.concatenate([np.eye(3)[2:], other_axes, other_axes])
        border_values = np.concatenate([[0.0], other_limits, -other_limits])
        arcs = []
        for centre in (axis, -axis):
            height = np.sin(plane.reach[leg]) * centre

            def place_on_circle(angles: Floats, height: Floats = height) -> Floats:
                """Return the normals (n, 3) at angles (n,) rad about the centre."""
                cosines = np.cos(angles)[:, None] * x_axis
                sines = np.sin(angles)[:, None] * y_axis
                return height + radius * (cosines + sines)

            cosine_factors = radius * (border_axes @ x_axis)
            sine_factors = radius * (border_axes @ y_axis)
            with np.errstate(all="ignore"):
                half_widths = np.arccos(
                    (border_values - border_axes @ height)
                    / np.hypot(cosine_factors, sine_factors)
                )
            middles = np.arctan2(sine_factors, cosine_factors)
            ends = np.concatenate([middles - half_widths, middles + half_widths])
            ends = np.unique(np.mod(ends[np.isfinite(ends)], 2.0 * np.pi))
            # Without an end, the only arc is the whole circle.
            is_closed = len(ends) == 0
            starts = np.zeros(1) if is_closed else ends
            stops = np.append(starts[1:], starts[0] + 2.0 * np.pi)
            middle_normals = place_on_circle(0.5 * (starts + stops))
            feet = plane.elbow_feet(middle_normals)
            is_reached = np.all(feet.triple_product_square >= 0.0, axis=1)
            # Two equal ends that differ by rounding enclose no arc.
            lengths = stops - starts
            is_arc = is_reached & (middle_normals[:, 2] > 0.0) & (lengths > LEAST_ARC_RAD)
            for number in np.flatnonzero(is_arc):
                step_count = max(8, int(np.ceil(lengths[number] / LIMIT_ARC_STEP_RAD)))
                angles = np.linspace(starts[number], stops[number], step_count + 1)
                arcs.append((place_on_circle(angles), is_closed))
        return arcs

    def find_determinant_zeros(self, budget: TimeLimit) -> Iterator[CurveSeen]:
        """Yield the curves of type II: the output can move while the inputs are locked.

        In these mechanisms, base and output mirror each other in the mid-plane. The unit
        normal of this plane determines the pose. With locked inputs the velocity equations
        of the loops are a square system for the rates of the other pairs. Its determinant
        is 0 if the output can move. The determinant is a function of the normal, whose
        changes of sign are searched in each assembly mode. A mode has a sign, 1 or -1, for
        each leg, which chooses one of two positions of the elbow (axis between two links).

        Parameters
        ----------
        budget
            Limit of the time. If it is over, the remaining modes are not searched.
        """
        for mode in product((1, -1), repeat=len(self.form.legs)):
            if not budget.goes_on(f"mode {mode}"):
                return
            signs = np.array(mode)
            # A function of the normals of mid-planes, in this mode.
            compute_determinants = partial(self._compute_determinants, signs)
            yield from self._find_zero_curves(compute_determinants, signs)

    def _find_zero_curves(
        self,
        function: Callable[[Floats], Floats],
        signs: Integers,
    ) -> Iterator[CurveSeen]:
        """Yield the curves of type II, on which a function of the mid-plane is zero.

        Base and output mirror each other in the mid-plane. The function is the determinant
        of the velocity equations, which is 0 if the output can move while the inputs rest.
        The unit normals of mid-planes are points of a hemisphere, which a mesh of triangles
        covers. Zeros of the function are computed on the edges where it changes its sign.
        Two zeros on edges of the same triangle are joined, and joined zeros form curves.

        Parameters
        ----------
        function
            Function of normals (n, 3) with values (n,), NaN where a leg does not reach.
        signs
            (legs,) signs of the assembly mode, 1 or -1 for each leg.
        """
        vertices, triangles = hemisphere(LOCUS_MESH_SIDE_RAD)
        # (edges, 2) numbers of the vertices of each edge, and (triangles, 3) numbers of the
        # edges of each triangle.
        edges, triangle_edges = list_edges(triangles)
        # An edge has a zero if one of the values at its ends is negative and the other one
        # is not. A value of exactly 0 must have a sign too, otherwise the curve has a gap.
        values = function(vertices)[edges]
        is_negative = values < 0.0
        has_zero = all_finite(values, 1) & (is_negative[:, 0] != is_negative[:, 1])
        zeros = _find_zeros_on_edges(
            function, edge_ends=vertices[edges[has_zero]], end_values=values[has_zero]
        )
        links = _link_zeros(has_zero, triangle_edges)
        # A chain is the numbers of the zeros of one curve, in order.
        for chain in order_chains(len(zeros), links):
            is_closed = _is_chain_closed(chain, links)
            if is_closed:
                chain = np.append(chain, chain[0])
            normals = zeros[chain]
            if is_closed and np.max(np.ptp(normals, axis=0)) <= 8.0 * EPS:
                # A vertex at which the function is 0 without a change of sign around it.
                continue
            # Why the configurations of the curve are singular, as text for users.
            reason = self._find_reason(normals, signs)
            yield self._make_curve(normals, signs, is_closed, reason)

    def _find_reason(self, normals: Floats, signs: Integers) -> str:
        """Return the reason why a curve is singular of type II, as text for users.

        Each point of the curve is a configuration. At type II the output can move while the
        inputs rest. Base and end effector mirror each other in a plane, the mid-plane of
        the configuration. It contains the elbows of all legs (the axes between the two
        links of each leg). There are two possible reasons:

        - The elbows of both driven legs are on one line along the whole curve, so they do
          not determine the mid-plane.
        - The velocity equations of the loops depend on each other: their matrix has lost
          rank.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes at n points of the curve.
        signs
            (legs,) signs of the mode: 1 or -1 for each leg, which chooses one of the two
            elbows that the leg can have.
        """
        first, second = self.form.plane.driven  # numbers of both driven legs
        elbows, _products = self.form.plane.elbows(normals, signs)  # (n, legs, 3)
        # Sine of the angle between both elbows at each mid-plane.
        sine = np.linalg.norm(cross(elbows[:, first], elbows[:, second]), axis=1)
        # If the loops are the reason, the elbows can still be on one line at single points
        # of the curve. The median ignores such points.
        if np.nanmedian(sine) < COLLINEAR_ELBOWS_SINE:
            names = " and ".join(self.form.mechanism.input_pairs)
            return f"elbows of the legs of {names} along one line"
        return "the loops lose rank"

    def _find_configurations(self, normals: Floats, signs: Integers) -> Floats:
        """Return the pair variables (n, variables) rad at mid-planes in one mode.

        Base and output mirror each other in the mid-plane. Its normal and the signs of the
        legs determine a configuration, by the formulas of `form`. The result is NaN where a
        leg does not reach the mid-plane.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes.
        signs
            (legs,) signs of the mode, 1 or -1 for each leg, which choose one of the two
            elbows (axes between its two links) that the leg can have.
        """
        link_orientations = self.form.place(normals, signs)
        # The links fit together by construction, so the closure residuals are not needed.
        values, _residuals = self.form.values(link_orientations)
        return values

    def _compute_determinants(self, signs: Integers, normals: Floats) -> Floats:
        """Return the determinants of the velocity equations with locked inputs.

        The caller searches the curves on which a determinant changes its sign. Where it is
        0, the output can move while the inputs rest (type II), or the velocity equations of
        the loops are dependent. The matrix is the Jacobian of the loop closure without the
        columns of the driven variables. This matrix is square.

        Parameters
        ----------
        signs
            (legs,) signs of the assembly mode, 1 or -1 for each leg, which choose one of
            the two elbows (axes between its two links) that the leg can have.
        normals
            (n, 3) unit normals of the mid-planes, in which base and output mirror each
            other. A normal and the signs determine a configuration.

        Returns
        -------
        (n,) determinants, NaN where a leg does not reach.
        """
        values = self._find_configurations(normals, signs)
        determinants = nans(len(normals))
        # Only normals with a configuration. `passive` has the numbers of the variables that
        # are not driven.
        rows = np.flatnonzero(all_finite(values, 1))
        jacobian = self.locus.closure.linearise(values[rows]).jacobian
        determinants[rows] = np.linalg.det(jacobian[:, :, self.passive])
        return determinants

    def _find_singular_motions(self, values: Floats) -> SingularMotions:
        """Return the rates of the pairs that come nearest to a singular motion.

        At a singularity of type I an input moves while the output rests. At one of type II
        the output moves while the inputs rest. The rates of all pairs then solve two groups
        of linear equations: the velocity equations of the loops, and equations which state
        that the output (or the inputs) rest. This is possible only if the least singular
        value of the matrix of all equations is 0. Its singular vector has the rates. The
        caller leaves out configurations with a large residual, since they are not singular.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad), NaN where there is no configuration.
        """
        linearisation = self.locus.tangent_space(values).linearisation
        # The equations of this type: the output rests (type I), or the inputs (type II).
        rest_equations = self.locus.constraint.equations(linearisation)
        # (n, equations, variables)
        equations = np.concatenate([linearisation.jacobian, rest_equations], axis=1)
        # The decomposition cannot take NaN, so the equations of missing configurations are
        # set to 0. Their closure residual is set to infinity below.
        _, singular_values, right_vectors = np.linalg.svd(np.nan_to_num(equations))
        closure_residual = np.nan_to_num(linearisation.closure_residual, nan=np.inf)
        least_singular_value = singular_values[:, -1]
        return SingularMotions(
            rates=right_vectors[:, -1],
            residual=np.maximum(closure_residual, least_singular_value),
        )

    def _make_curve(
        self, normals: Floats, signs: Integers, is_closed: bool, reason: str
    ) -> CurveSeen:
        """Return a curve of singularities of the searched type, I or II, for reports.

        At type I the output rests while an input moves. At type II the output moves while
        the inputs rest. Points that are not singular, or not of this type, are left out.

        Base and output link mirror each other in the mid-plane, a plane through the centre.
        Its unit normal and the signs of the mode determine the configuration, so a curve of
        configurations is described by a curve of normals.

        Parameters
        ----------
        normals
            (n, 3) unit normals of the mid-planes of the curve.
        signs
            (legs,) signs of the assembly mode, 1 or -1 for each leg, which choose one of
            the two elbows (axes between its two links) that the leg can have.
        is_closed
            Whether the last mid-plane is the first one again.
        reason
            Why the curve is singular, as text.
        """
        values = self._find_configurations(normals, signs)
        motions = self._find_singular_motions(values)
        # The same configurations with their inputs, their poses and their types.
        points = self.report.describe(values, motions.rates, motions.residual)

        # The residual is 0 at a singular configuration, and large at regular points and
        # where a loop is open.
        is_singular = motions.residual < CLOSURE_TOLERANCE
        # A point can be of another type than the searched one, because its type considers
        # all its singular motions. Points with both types I and II are selected.
        has_type = self.report.has_type(points.type)
        selected = np.flatnonzero(is_singular & has_type)
        no_points = points.rows(slice(0))
        # Arc length (rad) that the normal has travelled along the curve at each point.
        arc_length = np.append(0.0, np.cumsum(arc(normals[1:], normals[:-1])))
        return CurveSeen(
            points=points.rows(selected),
            # The points at which types I and II occur together are not listed here.
            both=no_points,
            s=arc_length[selected],
            closed=is_closed and len(selected) == len(normals),
            why=reason,
            modes=tuple(signs.tolist()),
        )


def _find_zeros_on_edges(
    function: Callable[[Floats], Floats], edge_ends: Floats, end_values: Floats
) -> Floats:
    """Return the point of each given mesh edge at which a function is zero.

    The caller joins these points to the curves on which the function is zero. The mesh
    covers a part of the unit sphere. Its points are unit vectors, the variable of the
    function.

    Parameters
    ----------
    function
        Function of unit vectors (n, 3) with values (n,).
    edge_ends
        (k, 2, 3) unit vectors to both ends of each edge.
    end_values
        (k, 2) values of the function at both ends, one negative and the other not.

    Returns
    -------
    (k, 3) unit vectors.
    """
    edge_starts, edge_stops = edge_ends.swapaxes(0, 1)
    edge_count = len(edge_ends)

    def interpolate(parts: Floats, rows: Indices) -> Floats:
        """Return points on some edges (`rows`) at parts (0 to 1) of their lengths."""
        difference = (edge_stops - edge_starts)[rows]
        return unit_rows(edge_starts[rows] + parts[:, None] * difference)

    def evaluate(parts: Floats, rows: Indices) -> Floats:
        """Return the values of the function at these points."""
        return function(interpolate(parts, rows))

    values_at_start, values_at_stop = end_values.T
    zero_parts, _ = find_bracketed_zeros(
        evaluate,
        low=np.zeros(edge_count),
        high=np.ones(edge_count),
        values_at_low=values_at_start,
        values_at_high=values_at_stop,
    )
    return interpolate(zero_parts, np.arange(edge_count))


def _link_zeros(has_zero: Bools, triangle_edges: Indices) -> Indices:
    """Return pairs (n, 2) of neighbouring zeros of a function on a triangle mesh.

    The zeros form curves. An edge of the mesh has one zero at most. Two zeros are
    neighbours if they are on edges of the same triangle. Zeros are numbered from 0 in the
    order of their edges.

    Parameters
    ----------
    has_zero
        (edges,) whether each edge has a zero.
    triangle_edges
        (triangles, 3) numbers of the edges of each triangle.
    """
    # The number of the zero of each edge, -1 without one.
    zero_of_edge = np.where(has_zero, np.cumsum(has_zero) - 1, -1)
    # An edge has a zero if the function has different signs at its ends. Around a triangle
    # the sign changes twice or never, so a curve that enters also leaves. The sorted
    # numbers of a triangle with a curve are -1 and those of its two zeros.
    triangle_zeros = np.sort(zero_of_edge[triangle_edges], axis=1)
    has_two_zeros = np.sum(triangle_zeros >= 0, axis=1) == 2
    return triangle_zeros[has_two_zeros, 1:]


def _is_chain_closed(chain: Indices, links: Indices) -> bool:
    """Return whether the chain of the zeros of one curve is closed.

    The curve is the set of points at which a function on a triangle mesh is zero. Its zeros
    on mesh edges are linked if they are on edges of the same triangle. The first zero of a
    closed chain has two links, the first zero of an open chain at most one. Two zeros that
    are linked twice do not surround an area, so this chain counts as open.

    Parameters
    ----------
    chain
        Numbers of the zeros along the curve, in order.
    links
        (links, 2) pairs of the numbers of linked zeros.
    """
    link_count = np.count_nonzero(links == chain[0])
    return bool(link_count == 2 and len(chain) > 2)
