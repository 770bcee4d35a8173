"""One curve of singular configurations of a mechanism with two inputs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.positions.configuration_curve import ON_CURVE_DISTANCE_RAD, Chords
from spherekit.positions.curve_segment import CurvePoints
from spherekit.singularities.locus import LocusPoints, SingularityLocus
from spherekit.status import Status

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss-Legendre rule on (-1, 1) for arc lengths between two nodes."""
VANISHING_FUNCTION = 1e-6
"""A function smaller than this at two successive nodes is taken to vanish between them, and
has no zero there. Larger: zeros where the function is small are missed; smaller: rounding
of a function that vanishes everywhere gives zeros."""
SAME_MOTION_COSINE = 1.0 - 1e-6
"""Singular motions are the same up to their sign if the size of their cosine exceeds
this."""

LocusFunction = Callable[[LocusPoints], Floats]
"""A function of points of a curve, with one value (n,) for each point."""


@dataclass(frozen=True)
class SingularCurve:
    """A curve of singular configurations through verified nodes (computed points).

    Its parameter is the arc length in the space of all pair variables. Each node has a
    singular motion: unit rates in which the inputs or the output rest.

    Attributes
    ----------
    locus
        The singular configurations of the type, of which the curve is a part.
    nodes
        The nodes in order, with tangents in the direction of the curve. The last node
        of a closed curve is the first node, with variables that have grown by whole
        periods.
    periods
        (V,) growth of each variable (rad) that leaves the configuration unchanged.
    closed
        Whether the curve is closed.
    ends
        The reasons why the curve ends, at its start and at its end. OK: it is closed or
        reached the largest length. AT_SINGULARITY: curves cross. OFF_PROFILE: a contact
        leaves its profile. MODE_LOST: it was not followed further.
    """

    locus: SingularityLocus
    nodes: LocusPoints
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def chords(self) -> Chords:
        """The chords between successive nodes."""
        return Chords(to_curve_points(self.nodes))

    @cached_property
    def s(self) -> Floats:
        """(n,) arc lengths (rad) of the nodes of the curve, in the space of the variables.

        Nodes are the computed points of the curve (singular configurations).

        The lengths between successive nodes are the lengths of cubic polynomials that
        have the tangents of the curve at both nodes (Hermite). With the unit vector e
        of a chord of length L and the unit tangents t0 and t1 at its ends, the
        derivative of the cubic with respect to x, which goes from 0 to 1, is

            L (t0 + x (b + 3 x a)),   a = t0 + t1 - 2 e,   b = 2 (e - t0 - a).

        The length of a cubic is the integral of the size of its derivative, computed by
        Gauss quadrature.
        """
        # Axes of the arrays: chord, Gauss point, variable. A curve has one tangent, with
        # the index 0.
        tangents = self.nodes.tangents[:, None, :, 0]
        t0 = tangents[:-1]
        t1 = tangents[1:]
        e = self.chords.directions[:, None]
        a = t0 + t1 - 2.0 * e
        b = 2.0 * (e - t0 - a)
        # Gauss points and weights belong to the range from -1 to 1. Here the range is
        # from 0 to 1, half as long.
        x = 0.5 * (GAUSS_POINTS[:, None] + 1.0)
        weights = 0.5 * GAUSS_WEIGHTS
        derivative_over_length = t0 + x * (b + 3.0 * x * a)
        relative_lengths = np.linalg.norm(derivative_over_length, axis=2) @ weights
        return np.append(0.0, np.cumsum(relative_lengths * self.chords.chord_lengths))

    def points_on_chords(self, chord_numbers: Indices, parts: Floats) -> LocusPoints:
        """Return points of a curve of singular configurations between its nodes.

        Nodes are the computed points of the curve. A chord is the straight line from one
        node to the next. Each point is selected by its projection onto a chord, and
        Newton's method moves it onto the curve. The method solves for the configuration and
        its singular motion: unit rates of all V variables in which the inputs (type II) or
        the output (type I) rest.

        Parameters
        ----------
        chord_numbers
            (n,) indices of chords; chord k starts at node k.
        parts
            (n,) position of the projection on each chord, from 0 to 1.
        """
        # Newton's method starts from values between those of the two nodes.
        start_values = self.chords.predict(chord_numbers, parts)
        start_motions = self._interpolate_motions(chord_numbers, parts)
        # The projection of each point onto its chord is prescribed: its V variables satisfy
        # the equation direction . variables = component (rad).
        directions = self.chords.directions[chord_numbers]  # unit vectors (n, V)
        lengths = self.chords.chord_lengths[chord_numbers]
        components_of_nodes = np.vecdot(directions, self.nodes.values[chord_numbers])
        components = components_of_nodes + parts * lengths
        # At each point, all rates that close the loops are combinations of some basis
        # vectors. Functions of the points can be determinants in this basis, such as
        # `cusp_determinants`. `zeros` compares their signs along a chord. A reversed basis
        # vector would change the sign, so the basis is aligned with that of the first node.
        first_node_bases = self.nodes.bases.rows(chord_numbers)
        points = self.locus.correct(
            values=start_values,
            motions=start_motions,
            conditions=directions[:, None],
            targets=components[:, None],
            reference=first_node_bases,
        )
        # A curve has one tangent (index 0). Its sign is arbitrary in the result, and is
        # changed to the direction of the curve.
        along_chord = np.vecdot(points.tangents[:, :, 0], directions)
        return orient_tangents(points, np.where(along_chord < 0.0, -1.0, 1.0))

    def _interpolate_motions(self, chord_numbers: Indices, parts: Floats) -> Floats:
        """Return rates (n, V) between the singular motions of the two nodes of a chord.

        Nodes are computed points of the curve, and a chord joins two successive ones. The
        rates of the V variables are interpolated linearly.

        Chord k starts at node k. `parts` (n,) are positions on the chords, 0 at the start
        and 1 at the end.
        """
        first_motions = self.nodes.motions[chord_numbers]
        motion_changes = self.nodes.motions[chord_numbers + 1] - first_motions
        return first_motions + parts[:, None] * motion_changes

    def find(self, values: Floats, motions: Floats) -> Bools:
        """Return a mask (n,) of the configurations that are on the curve.

        The curve consists of singular configurations. A chord is the straight line between
        two successive nodes (computed points); chord k starts at node k. A configuration is
        projected onto each chord near it, and compared with the point of the curve that has
        the same projection. Whole periods of the variables and signs of the motions do not
        matter.

        Parameters
        ----------
        values, motions
            (n, V) variables (rad), and unit rates of the singular motions, in which the
            inputs or the output rest.

        Returns
        -------
        (n,) whether the configuration and its singular motion are on the curve.
        """
        # Each of the m projections is one configuration on one chord near it.
        # `distances_along` are the lengths (rad) from the start of the chord. `offsets` (m,
        # V) are the differences of the variables from the start, less whole periods.
        projections = self.chords.project(values, self.periods)
        chord_numbers = projections.chords
        chord_lengths = self.chords.chord_lengths[chord_numbers]
        # Projections as parts of the chords, from 0 to 1.
        parts = projections.distances_along / chord_lengths
        points = self.points_on_chords(chord_numbers, parts)
        # The configurations, moved by whole periods to the chords.
        shifted_values = self.nodes.values[chord_numbers] + projections.offsets
        distance = max_abs(shifted_values - points.values, axis=1)
        configurations = projections.configurations
        motion_cosine = np.abs(np.vecdot(points.motions, motions[configurations]))
        is_on_curve = (distance < ON_CURVE_DISTANCE_RAD) & (
            motion_cosine > SAME_MOTION_COSINE
        )
        return np.isin(np.arange(len(values)), configurations[is_on_curve])

    def zeros(self, function: LocusFunction) -> LocusPoints:
        """Return the points at which a function changes its sign along the curve.

        The curve consists of singular configurations, and nodes are its computed points.
        The signs at successive nodes are compared. Each change is then located between the
        two nodes. The unknown is the position on the chord, the straight line from one node
        to the next. Two zeros between the same nodes are not noticed. If the function is
        smaller than `VANISHING_FUNCTION` at both nodes, its sign is only rounding, and no
        zero is returned.

        Parameters
        ----------
        function
            Function of n points of the curve that returns their values (n,). The values are
            about 1 in size, such as determinants of unit vectors.
        """
        # The sign of a value can depend on the basis of rates at a node. Signs are compared
        # in aligned bases.
        node_values = self._comparable_node_values(function)
        starts = node_values[:-1]
        stops = node_values[1:]
        is_clear = np.maximum(np.abs(starts), np.abs(stops)) > VANISHING_FUNCTION
        changes_sign = (starts >= 0.0) != (stops >= 0.0)
        (chord_numbers,) = np.nonzero(is_clear & changes_sign)
        # The position on a chord is 0 at its start and 1 at its end.
        parts, _ = find_bracketed_zeros(
            lambda x, rows: function(self.points_on_chords(chord_numbers[rows], x)),
            low=np.zeros(len(chord_numbers)),
            high=np.ones(len(chord_numbers)),
            values_at_low=node_values[chord_numbers],
            values_at_high=node_values[chord_numbers + 1],
            tolerance=1e-14,
        )
        return self.points_on_chords(chord_numbers, parts)

    def _comparable_node_values(self, function: LocusFunction) -> Floats:
        """Return the values (n,) of a function at all nodes, with comparable signs.

        Nodes are the computed points of a curve of singular configurations. Each node has a
        basis of its possible rates. The function is for example a determinant in this
        basis, and its sign changes if a basis vector is reversed. The basis of each node is
        aligned with that of the node before, so signs of successive nodes are comparable.

        The last node of a closed curve is the first node again, with the basis of the first
        node. The value at the last node is computed again, in a basis that is aligned with
        the node before.
        """
        node_values = function(self.nodes)
        if self.closed:
            # The last node, as the end of the last chord (part 1). The points of a
            # chord have bases that are aligned with the basis of its first node.
            last_chord = len(node_values) - 2
            last_node = self.points_on_chords(np.array([last_chord]), parts=np.ones(1))
            node_values[-1] = function(last_node)[0]
        return node_values

    def cusps(self) -> LocusPoints:
        """Return the cusps: points of the curve where the inputs, or the output, reverse.

        The curve consists of singular configurations. Each has a singular motion, in which
        the inputs (type II) or the output (type I) rest. At a cusp, this motion is parallel
        to the tangent of the curve. If the mechanism moves along the curve, the inputs (or
        the output) rest for a moment there, and generally reverse. In a drawing over the
        inputs (or over the output), the curve has a sharp point there.

        Sometimes only a part of the mechanism can move the output, and singular motions are
        sought in this part. The result is empty if the part has fewer degrees of freedom
        than the mechanism.
        """
        # `motion_dimension` is the number of independent motions among which singular
        # motions are sought.
        whole_mechanism_moves = self.locus.motion_dimension == self.locus.degrees_of_freedom
        if whole_mechanism_moves:
            # The mechanism has two degrees of freedom. So the tangent and the singular
            # motion have two coordinates each. The determinant of these coordinates is zero
            # where the tangent and the motion are parallel.
            return self.zeros(cusp_determinants)
        no_points = self.nodes.rows(slice(0))
        return no_points


def cusp_determinants(points: LocusPoints) -> Floats:
    """Return how far the tangent of a curve is from parallel to the singular motion.

    The singular motion has the rates with which the inputs or the output rest. With two
    degrees of freedom, the rates that close the loops are a plane. Tangent and singular
    motion are vectors in this plane, with two coordinates each. The result (n,) is the
    determinant of these coordinates, which changes its sign at a cusp, where both vectors
    are parallel.
    """
    # Axes of the arrays: point, variable, vector of the orthonormal basis of the plane.
    plane_basis = points.bases.motion
    motion = np.vecmat(points.motions, plane_basis)
    tangent = np.vecmat(points.tangents[:, :, 0], plane_basis)
    return motion[:, 0] * tangent[:, 1] - motion[:, 1] * tangent[:, 0]


def to_curve_points(points: LocusPoints) -> CurvePoints:
    """Return points of a curve as `CurvePoints`, whose second derivatives are unknown."""
    tangents = points.tangents[:, :, 0]
    return CurvePoints(
        points.values, tangents, np.full_like(tangents, np.nan), points.residual
    )


def orient_tangents(points: LocusPoints, sense: Floats | float) -> LocusPoints:
    """Return points with their tangents reversed where the sense (n,) is -1."""
    sense = np.reshape(sense, (-1, 1, 1))
    return replace(
        points,
        tangents=sense * points.tangents,
        motion_derivatives=sense * points.motion_derivatives,
    )
