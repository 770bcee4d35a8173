"""Curves of singular configurations, followed by verified steps.

The method is the same as in `spherekit.positions.continuation`. The second derivative
of a curve at a node is estimated from the last step.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.positions.continuation import UNFINISHED, CurveContinuation, TriedSteps
from spherekit.positions.curve_limits import CurveLimits
from spherekit.positions.curve_segment import CurvePoints
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.loop_closure import NewtonSteps
from spherekit.positions.verified_steps import STEP_PARTS, Verification, extrapolate
from spherekit.singularities.locus import (
    LocusPoints,
    SingularityLocus,
    append_conditions,
)
from spherekit.singularities.singular_curve import (
    SingularCurve,
    orient_tangents,
    to_curve_points,
)
from spherekit.status import Status
from spherekit.time_limit import TimeLimit
from spherekit.tolerances import END_AT_SINGULARITY_CONDITION

MAX_CURVE_STEP_RAD = 0.3
"""Longest step in arc length. Larger: faster where curves are straight; smaller: nodes are
denser, and fewer zeros between them are missed."""
MAX_SINGULAR_CURVE_LENGTH_RAD = 200.0
"""Arc length after which a curve that does not close is ended in each direction. Larger:
such curves take longer; smaller: long curves are cut."""
CURVE_FREEDOMS = 2
"""Number of degrees of freedom of the mechanisms in which loci are curves."""
FIRST_CURVE_STEP_RAD = 0.05
"""Length of the first step that is tried. It affects the computing time only."""

SAME_LAP_COSINE = 0.8
"""Least size of the cosine between the singular motions at the start and at the end of a
lap. Smaller: a lap may close at another sheet of the locus."""


def trace_curves(
    locus: SingularityLocus, starts: LocusPoints, time_limit: TimeLimit | None = None
) -> list[SingularCurve | None]:
    """Return the curves of singular configurations through given ones.

    All curves are followed at the same time, in both directions from their starts.

    Parameters
    ----------
    locus
        The singular configurations of one type, of a mechanism with two degrees of freedom.
    starts
        n singular configurations, one for each curve.
    time_limit
        Processor time, unlimited by default. When it is reached, curves that are not
        complete end with status MODE_LOST.

    Returns
    -------
    n curves, with None for a start from which no step succeeds.
    """
    count = len(starts)
    # Rows 0 to n - 1 follow the curves in one direction, rows n to 2 n - 1 in the other.
    both_directions = LocusPoints.concatenate([starts, orient_tangents(starts, -1.0)])
    start_nodes = _LocusNodes(
        values=both_directions.values,
        # The last axis numbers the dimensions of the locus. A curve has one.
        tangents=both_directions.tangents[:, :, 0],
        # Second derivatives of the curve are not known before the first step.
        bends=np.zeros(both_directions.values.shape),
        residual=both_directions.residual,
        points=both_directions,
    )
    paths = _LocusCurves(
        start_nodes=start_nodes,
        periods=variable_periods(locus.closure),
        max_length=MAX_SINGULAR_CURVE_LENGTH_RAD,
        max_step=MAX_CURVE_STEP_RAD,
        locus=locus,
        time_limit=time_limit or TimeLimit(),
    )
    paths.follow(FIRST_CURVE_STEP_RAD)
    return [paths.join_halves(row, count + row) for row in range(count)]


@dataclass(frozen=True)
class _LocusNodes(CurvePoints):
    """n nodes (computed points) of curves of singular configurations.

    The tangents point in the direction in which the curve is followed. The second
    derivatives are estimated from the last step, and are zero at the start.

    Attributes
    ----------
    points
        The nodes as points of the locus, with the singular motions.
    """

    points: LocusPoints


def _equations_with_tangent(points: LocusPoints, tangents: Floats) -> Floats:
    """Return the linearised equations of points on a curve, with the tangent as last row.

    The points are singular configurations. Each has a singular motion: rates of the
    variables that keep the loops closed while the inputs (type II) or the output (type I)
    rest. The unknowns of the equations are first the change of the configuration, then the
    change of its singular motion.

    The equations leave one freedom, the change along the curve. The product of the last row
    and a change is the part of the change along the tangent. With this row the matrix is
    regular except where curves cross. The caller compares the matrices before and after a
    step, to test whether the step stays on its curve.

    Parameters
    ----------
    points
        n points with their linearised equations.
    tangents
        (n, V) tangents of the curve: changes of the V variables of the configuration.
    """
    # The unknown change of the configuration has coordinates in this basis. The tangent is
    # converted to the same coordinates. In the last row, zeros belong to the change of the
    # motion.
    configuration_basis = points.bases.configuration
    tangent_rows = tangents[:, None]
    return append_conditions(points.equations, tangent_rows, configuration_basis)


@dataclass
class _LocusCurves(CurveContinuation[_LocusNodes]):
    """Curves of singular configurations (of a locus) that are followed at the same time.

    Arrays have two rows for each curve. A row in the first half follows the curve in one
    direction from its start, a row in the second half in the opposite direction.

    Attributes
    ----------
    locus
        The singular configurations.
    time_limit
        Time after which all curves end.
    """

    step_tests = Verification(slack=1e-9, settled=1e-6, middle=1e-3)
    smallest_step = 2e-6
    same_point_rad = 1e-8
    max_nodes = 20_000

    locus: SingularityLocus
    time_limit: TimeLimit

    def end_finished_curves(self, rows: Indices) -> None:
        """End curves that are complete, and all curves when the time limit is reached.

        Each curve is followed in both directions from its start. If a curve has closed in
        the first direction, its second direction ends with status OK. At the time limit,
        curves end with the status MODE_LOST.

        Parameters
        ----------
        rows
            Rows of the curves that are followed at present. Each direction of a curve has a
            row.
        """
        self._end_closed_curves(rows)
        unfinished = rows[self.end_status[rows] == UNFINISHED]
        # The text names the step that is left out when there is no more time.
        if len(unfinished) and not self.time_limit.goes_on("the rest of a singular curve"):
            self.end_status[unfinished] = Status.MODE_LOST

    def _end_closed_curves(self, rows: Indices) -> None:
        """End the second direction of curves that closed in the first direction.

        Each curve is followed from its start in two directions. If the curve closes in the
        first direction, the second one would only repeat the curve.

        Parameters
        ----------
        rows
            Rows that are followed at present. There are two rows for each of the n curves:
            row k is the first direction of curve k, and row n + k the second one.
        """
        curve_count = len(self.end_status) // 2
        second_directions = rows[rows >= curve_count]
        first_directions = second_directions - curve_count
        is_closed = self.is_closed[first_directions]
        self.end_status[second_directions[is_closed]] = Status.OK

    def try_steps(
        self, rows: Indices, nodes: _LocusNodes, distances: Floats
    ) -> TriedSteps[_LocusNodes]:
        """Try a step on each of k curves of singular configurations.

        The end and the middle of the step are predicted by a Taylor polynomial and
        corrected by Newton's method. The step is verified if the corrections are small, if
        the equations change so little that they are singular nowhere on the way, and if
        both ends predict the middle.

        Parameters
        ----------
        rows
            (k,) rows of the curves (not used: all curves have the same equations).
        nodes
            The k nodes (points of the curves) from which the steps start.
        distances
            (k,) lengths of the steps along the tangents (rad).

        Returns
        -------
        The nodes at the ends of the steps, and whether each step is verified.
        """
        start = nodes.points
        # Each step is verified at its middle and at its end. Rows 2 j and 2 j + 1 of the
        # arrays below are the middle and the end of step j.
        parts = distances[:, None] * STEP_PARTS
        # The component of a point along the tangent at the start selects it on the curve.
        start_tangents = np.repeat(nodes.tangents, 2, axis=0)
        motion_derivatives = start.motion_derivatives[:, :, 0]
        targets = np.vecdot(nodes.tangents, start.values)[:, None] + parts
        points = self.locus.correct(
            values=extrapolate(start.values, nodes.tangents, nodes.bends, parts),
            motions=extrapolate(
                start.motions, motion_derivatives, np.zeros_like(motion_derivatives), parts
            ),
            conditions=start_tangents[:, None],
            targets=targets.reshape(-1, 1),
            reference=start.bases.rows(np.repeat(np.arange(len(start)), 2)),
        )
        # The size of a step includes the change of the singular motion, which is fast where
        # curves pass each other.
        step_sizes = distances * np.hypot(1.0, np.linalg.norm(motion_derivatives, axis=1))
        good = points.is_on_locus & self.step_tests.accepts_correction(
            NewtonSteps(points.first_step, points.step_ratio), np.repeat(step_sizes, 2)
        )
        # The sign of a tangent is arbitrary. Here each tangent gets the direction of the
        # step.
        tangent_cosine = np.vecdot(points.tangents[:, :, 0], start_tangents)
        points = orient_tangents(points, np.sign(tangent_cosine))
        equations_before = _equations_with_tangent(start, nodes.tangents)
        equations_before = np.repeat(equations_before, 2, axis=0)
        equations_after = _equations_with_tangent(points, start_tangents)
        # The matrix A of the equations stays regular on the way if |A^-1 dA| < 1.
        relative_change = np.linalg.pinv(equations_before) @ (
            equations_after - equations_before
        )
        change = np.linalg.norm(relative_change, axis=(1, 2))
        good &= self.step_tests.accepts_change(change, np.abs(tangent_cosine))

        middles = points.values[::2]
        end_points = points.rows(slice(1, None, 2))
        is_verified = self.verify_steps(
            starts=to_curve_points(start),
            stops=to_curve_points(end_points),
            middles=middles,
            distances=distances,
            is_good=good.reshape(-1, 2),
            rounding=self.step_tests.slack,
        )
        end_tangents = end_points.tangents[:, :, 0]
        lengths = np.linalg.norm(end_points.values - start.values, axis=1, keepdims=True)
        bends = (end_tangents - nodes.tangents) / lengths
        new_nodes = _LocusNodes(
            values=end_points.values,
            tangents=end_tangents,
            bends=bends,
            residual=end_points.residual,
            points=end_points,
        )
        changes = np.max(change.reshape(-1, 2), axis=1)
        return TriedSteps(new_nodes, is_verified, changes)

    def start_after_periods(
        self, starts: _LocusNodes, nodes: _LocusNodes, values: Floats
    ) -> _LocusNodes:
        """Return the starts of curves, moved by whole periods of the variables.

        A curve of singular configurations closes if it returns to its start, up to whole
        periods of the angles. To test this, the caller compares the moved start with the
        last node. Each configuration has a singular motion: rates that close
        the loops while the inputs, or the output, rest. The motions at the start and at the
        last node must be the same, up to their arbitrary signs. If the motions differ, the
        start becomes NaN, and the curve does not close.

        Parameters
        ----------
        starts, nodes
            First and last nodes (computed configurations) of k curves. Their singular
            motions are in the attribute `points`.
        values
            (k, V) variables of the starts, moved by whole periods (rad).
        """
        # (k, V) unit vectors of the singular motions.
        start_motions = starts.points.motions
        cosine = np.vecdot(start_motions, nodes.points.motions)
        # Two unit vectors are the same, up to the sign, if their cosine is near 1 or -1.
        has_same_motion = np.abs(cosine) >= SAME_LAP_COSINE
        # The motion at the start is multiplied by this sign. Its sense is then that of the
        # motion at the last node.
        sense = np.sign(cosine)
        # NaN marks starts at which the curve does not close.
        sense[~has_same_motion] = np.nan
        moved_values = values.copy()
        moved_values[~has_same_motion] = np.nan
        points = replace(
            starts.points,
            values=moved_values,
            motions=sense[:, None] * start_motions,
            # (k, V, 1) derivatives of the motions along the curves.
            motion_derivatives=sense[:, None, None] * starts.points.motion_derivatives,
        )
        # The variables are stored twice: here and in `points`.
        return replace(starts, values=moved_values, points=points)

    def select_steps(
        self, rows: Indices, steps: Floats, new_nodes: _LocusNodes, is_verified: Bools
    ) -> Bools:
        """Return a mask (k,) of the verified steps that stay on the profiles of contacts.

        A step leads along a curve of singular configurations. A contact exists only while
        its contact point is on both of its profiles (contact curves of the links). A step
        is not taken if it moves a contact point beyond the end of a profile. The curve of
        configurations then ends with the status OFF_PROFILE.

        Parameters
        ----------
        rows
            (k,) rows of the curves.
        steps
            (k,) lengths of the steps. The base class passes them, but they are not needed
            here.
        new_nodes
            The k nodes at which the steps end.
        is_verified
            (k,) whether each step passed all tests.
        """
        is_taken = is_verified.copy()
        # `inside` says for each contact whether the contact point is on both profiles.
        states = self.locus.closure.linearise(new_nodes.values[is_verified]).states
        is_taken[is_verified] = np.all(states.inside, axis=1)
        self.end_status[rows[is_verified & ~is_taken]] = Status.OFF_PROFILE
        return is_taken

    def end_stuck_curve(self, row: int) -> None:
        """End a curve from whose last node no step succeeds."""
        reciprocal_condition = self.last_nodes.points.reciprocal_condition[row]
        if self._is_at_profile_end(row):
            self.end_status[row] = Status.OFF_PROFILE
        elif reciprocal_condition < END_AT_SINGULARITY_CONDITION:
            self.end_status[row] = Status.AT_SINGULARITY
        else:
            self.end_status[row] = Status.MODE_LOST

    def _is_at_profile_end(self, row: int) -> bool:
        """Return whether the last node of a curve is at an end of the profile of a contact.

        Beyond an end, Newton's method fails, so that no step is verified.
        """
        values = self.last_nodes.values[row]
        bounds = CurveLimits.of_mechanism(self.locus.closure, stops={}).bounds
        return any(
            bound.sense * (values[bound.variable] - bound.value) < self.smallest_step
            for bound in bounds
        )

    def join_halves(self, ahead: int, behind: int) -> SingularCurve | None:
        """Join the two halves of a curve, which were followed in both directions.

        A closed curve is already complete in one direction. The result is None if no step
        succeeded in either direction.

        Parameters
        ----------
        ahead, behind
            Rows of the two directions among the followed curves.
        """
        for row in (ahead, behind):
            if self.is_closed[row]:
                points = self.collect_nodes(row).points
                # A closed curve has no ends; OK stands for both.
                ends = (Status.OK, Status.OK)
                return SingularCurve(
                    self.locus, points, self.periods, closed=True, ends=ends
                )
        # The points behind the start, in reversed order and without the start. Their
        # tangents are reversed, so that all tangents point along the joined curve.
        nodes_behind = self.collect_nodes(behind).points.rows(slice(None, 0, -1))
        points = LocusPoints.concatenate(
            [orient_tangents(nodes_behind, -1.0), self.collect_nodes(ahead).points]
        )
        if len(points) < 2:
            return None
        ends = (Status(self.end_status[behind]), Status(self.end_status[ahead]))
        return SingularCurve(self.locus, points, self.periods, closed=False, ends=ends)
