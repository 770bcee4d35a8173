"""Follows configuration curves in their own arc length, step by verified step.

A step is predicted with exact first and second derivatives, and corrected in the hyperplane
normal to the tangent. The bordered Jacobian is the closure Jacobian with the tangent as a
further row. Where two curves pass each other closely, its determinants have opposite signs
on the two curves. A step from one curve to the other would therefore change the Jacobian
much, and is rejected by a test of this change.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.positions.configuration_curve import POINT_ROUNDING_FACTOR, ArcCurve
from spherekit.positions.continuation import NEAR_END_RAD, CurveContinuation, TriedSteps
from spherekit.positions.curve_limits import CurveLimits
from spherekit.positions.curve_segment import (
    CurvePoints,
    bordered,
    bordered_reciprocal_condition,
    bordered_step,
    correct,
    curve_points,
)
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, newton
from spherekit.positions.verified_steps import STEP_PARTS, Verification, extrapolate
from spherekit.status import Status
from spherekit.tolerances import (
    CLOSURE_TOLERANCE,
    END_AT_SINGULARITY_CONDITION,
    EPS,
    SINGULAR_CURVE_CONDITION,
)

MAX_CURVE_LENGTH_RAD = 500.0
"""Length after which a curve that does not close is ended."""
MAX_CONTINUATION_STEP_RAD = 0.4
"""Longest step of arc length. Larger: more steps fail. Smaller: more steps."""
FIRST_CONTINUATION_STEP_RAD = 0.1
"""The first step of arc length that is tried."""
MAX_STEP_ROTATION_RAD = 0.4
"""Largest angle by which the tangent turns in a step, by the curvature at its start.

Larger: more steps fail. Smaller: more steps are necessary.
"""

SAME_POINT_RAD = 1e-9
"""Points of a curve nearer to each other than this are the same point.

A lap ends where it started, and a curve ends at a limit, up to this distance. Larger: a
curve that passes its start closely counts as closed. Smaller: rounding errors prevent
curves from closing.
"""
MIN_RIGID_RATIO = 1e-4
"""Smallest singular value, relative to the largest, with which the loops allow no motion.

Larger: inaccurate starts with redundant constraints are accepted. Smaller: their errors
count as missing mobility.
"""
MAX_START_RESIDUAL_RAD = 1e-6
"""Largest closure residual of a configuration from which a curve is followed."""
LANDING_STEPS = 12
"""Largest number of Newton steps to the point at which a curve reaches a limit."""
LANDING_STEP_RAD = 1e-14
"""The Newton steps to a limit end with a step that is smaller."""
SINGULAR_START = (
    "the start configuration of the curve is singular: two curves cross in it, or the "
    "mechanism has more than one degree of freedom; start from another configuration"
)


@dataclass(frozen=True)
class _ArcNodes(CurvePoints):
    """n points of configuration curves, with all that the next steps along them need.

    `values` are the pair variables, `tangents` and `bends` their first two derivatives with
    respect to the arc length, and `residual` is the closure residual, as in `CurvePoints`.
    A limit is a bound of a variable, or a state of a contact, at which a curve ends.

    Attributes
    ----------
    equations
        (n, equations + 1, variables) closure Jacobians, with the tangent as a further row.
    inverse
        (n, variables, equations + 1) their inverses.
    reciprocal_condition
        (n,) their reciprocal condition numbers.
    margins
        (n, limits) distances from the limits, negative beyond, see `CurveLimits.margins`.
    approach
        (n, limits) rates at which the margins decrease along the curve.
    """

    equations: Floats
    inverse: Floats
    reciprocal_condition: Floats
    margins: Floats
    approach: Floats

    @staticmethod
    def from_points(
        linearisation: Linearisation,
        points: CurvePoints,
        limits: CurveLimits,
        chosen: slice = slice(None),
    ) -> "_ArcNodes":
        """Return some points of curves as nodes, from which the curves are continued.

        A node is a point with the data for the next step along the curve: the equations of
        the curve and the margins (distances) to all limits.

        Parameters
        ----------
        linearisation
            The closure equations, linearised at all points.
        points
            The points.
        limits
            The limits at which curves end: bounds of variables, and equal curvatures of two
            profiles in contact. At equal curvatures, the motion of the links does not
            determine that of the point of contact.
        chosen
            Which of the points become nodes.
        """
        points = points.rows(chosen)
        # The closure Jacobian with the tangent as one more row (border). Redundant loop
        # equations can make it non-square, so its left inverse is used.
        equations = bordered(linearisation.jacobian[chosen], points.tangents)
        inverse = left_inverse(equations)
        # Margins, and their derivatives with respect to the variables. Margins of contacts
        # depend on the curvatures of the profiles.
        margins, gradients = limits.margins(
            points.values,
            linearisation.states.curvatures[chosen],
            linearisation.states.curvature_rates[chosen],
        )
        return _ArcNodes(
            **vars(points),
            equations=equations,
            inverse=inverse,
            reciprocal_condition=bordered_reciprocal_condition(equations, inverse),
            margins=margins,
            # The rate at which each margin decreases along the curve. In the sum, n is a
            # point, l a limit and v a variable.
            approach=-np.einsum("nlv,nv->nl", gradients, points.tangents),
        )


def follow_arc(
    closure: Closure,
    values: Floats,
    stops: Mapping[int, tuple[float, float]] | None = None,
    longest: float = MAX_CURVE_LENGTH_RAD,
) -> ArcCurve:
    """Return the configuration curve through a closed configuration.

    The curve consists of all configurations that the mechanism reaches from this one. The
    curve is closed, or open with two ends. The parameter is the arc length in the space of
    all variables.

    Parameters
    ----------
    closure
        The loops of the whole mechanism, in which each link is a body of its own (no groups
        of links are joined to one body).
    values
        (variables,) a configuration (rad) that closes, to 1e-6 rad or better.
    stops
        Lowest and highest value (rad) of some variables, by the index of the variable. The
        curve ends at these values. It is open if one of these variables makes whole turns.
    longest
        The curve is followed from the configuration in both senses. If it does not close,
        it is ended after this length (rad) in each sense.

    Raises
    ------
    SolveError
        If the configuration is not finite, does not close, does not move, is beyond a
        limit, or is singular. Also if no step is possible, because limits are close.
    """
    limits = CurveLimits.of_mechanism(closure, stops or {})
    start = _make_start_node(closure, np.asarray(values, dtype=float), limits)
    (curve,) = _follow_both_senses(closure, [start], limits, longest)
    if curve is None:
        raise SolveError(
            "no step is possible from the start configuration in either direction, for "
            "example because joint limits are close on both sides; widen the joint limits"
        )
    return curve


def follow_arcs(closure: Closure, starts: Floats, longest: float) -> list[ArcCurve | None]:
    """Return the configuration curves through several configurations.

    All curves are followed at the same time, in common arrays.

    Curves end at limits: at the ends of open profiles, and where two profiles in contact
    have equal curvatures, so that the contact does not determine how they move.

    Parameters
    ----------
    closure
        The loops of the whole mechanism. Values of locked variables can differ from
        configuration to configuration.
    starts
        (n, variables) closed configurations (rad).
    longest
        Curves are followed from their starts in both senses. A curve that does not close is
        ended after this arc length in each sense (rad).

    Returns
    -------
    n curves. None for a configuration that does not close, does not move, is beyond a
    limit, is singular, or from which no step is possible.
    """
    # No further limits (`stops`) are chosen.
    limits = CurveLimits.of_mechanism(closure, stops={})
    # The first node (point with its tangent) of each curve, by index of the configuration.
    # Configurations with an error are left out.
    start_nodes: dict[int, _ArcNodes] = {}
    for row, values in enumerate(starts):
        with suppress(SolveError):
            # `select_rows` gives the loops with the locked values of this configuration.
            start_nodes[row] = _make_start_node(
                closure.select_rows(np.array([row])), values, limits
            )
    rows = np.array([*start_nodes], dtype=np.intp)
    followed_curves = _follow_both_senses(
        closure.select_rows(rows), list(start_nodes.values()), limits, longest
    )
    curves: list[ArcCurve | None] = [None] * len(starts)
    for row, curve in zip(start_nodes, followed_curves, strict=True):
        curves[row] = curve
    return curves


def _follow_both_senses(
    closure: Closure,
    starts: Sequence[_ArcNodes],
    limits: CurveLimits,
    longest: float,
) -> list[ArcCurve | None]:
    """Follow the configuration curves through nodes, until they close or end.

    All curves are first followed along their tangents. Curves that do not close are
    followed from the same nodes in the opposite sense, and both parts are joined. A node is
    a computed point of a curve, with the linearised equations there and the distances from
    limits. A `plain` node is the point without these data.

    Parameters
    ----------
    closure
        The loops. Locked variables can have a value of their own for each of n nodes.
    starts
        n start nodes.
    limits
        The limits at which curves end.
    longest
        A curve that does not close is ended after this length (rad) in each sense.

    Returns
    -------
    n curves, in the order of the start nodes. None for a node from which no step is
    possible.
    """
    if not starts:
        return []
    start = _ArcNodes.concatenate(starts)
    periods = variable_periods(closure)
    # A lap in which a variable with bounds grows would lead beyond a bound at last, so it
    # does not close the curve.
    bounded_variables = [
        bound.variable for bound in limits.bounds if np.isfinite(bound.value)
    ]
    periods[bounded_variables] = np.inf
    # The same nodes with reversed tangents. Their equations are computed anew.
    reversed_start = replace(start.plain, tangents=-start.tangents)
    backward_start = _ArcNodes.from_points(
        closure.linearise(start.values), reversed_start, limits
    )
    forward = _ArcContinuation(
        start_nodes=start,
        periods=periods,
        max_length=longest,
        max_step=MAX_CONTINUATION_STEP_RAD,
        closure=closure,
        limits=limits,
    )
    forward.follow(FIRST_CONTINUATION_STEP_RAD)
    open_rows = np.flatnonzero(~forward.is_closed)
    backward = _ArcContinuation(
        start_nodes=backward_start.rows(open_rows),
        periods=periods,
        max_length=longest,
        max_step=MAX_CONTINUATION_STEP_RAD,
        closure=closure.select_rows(open_rows),
        limits=limits,
    )
    backward.follow(FIRST_CONTINUATION_STEP_RAD)
    # Position in `backward` of each open curve. Closed curves are not there.
    backward_row = {row: k for k, row in enumerate(open_rows.tolist())}
    return [
        _join_senses(forward, backward, row, backward_row.get(row))
        for row in range(len(starts))
    ]


def _join_senses(
    forward: "_ArcContinuation",
    backward: "_ArcContinuation",
    row: int,
    backward_row: int | None,
) -> ArcCurve | None:
    """Return one curve from the parts that were followed in both senses.

    A curve that did not close in the forward sense may close in the backward sense. The
    result is None if no step was possible in either sense, so that the start is the only
    node.

    Parameters
    ----------
    forward, backward
        The continuations in both senses.
    row
        Index of the curve in `forward`.
    backward_row
        Index of the same curve in `backward`. None if the curve closed in the forward
        sense, so that it was not followed backward.
    """
    # The nodes of a closed curve are those of one sense. A `plain` node is a point of the
    # curve, without the equations and the distances from limits that following needed.
    nodes = forward.collect_nodes(row).plain
    ends = (Status.OK, Status.OK)
    closed = True
    if backward_row is not None:
        backward_nodes = backward.collect_nodes(backward_row).plain
        closed = bool(backward.is_closed[backward_row])
        if closed:
            nodes = backward_nodes
        else:
            # The start is the last node of the reversed part, and is left out there.
            before_start = backward_nodes.reversed.rows(slice(-1))
            nodes = CurvePoints.concatenate([before_start, nodes])
            ends = (
                Status(backward.end_status[backward_row]),
                Status(forward.end_status[row]),
            )
    if len(nodes.values) == 1:
        return None
    # `closure` has the loops of all curves. Locked variables can have other values on each
    # curve, so the loops of this curve are selected.
    curve_closure = forward.closure.select_rows(np.array([row]))
    return ArcCurve(
        nodes=nodes,
        closure=curve_closure,
        periods=forward.periods,
        closed=closed,
        ends=ends,
    )


def _make_start_node(closure: Closure, values: Floats, limits: CurveLimits) -> _ArcNodes:
    """Close a configuration exactly, and return it as the first node of a curve.

    A node is a point of the curve with its tangent and equations.

    Parameters
    ----------
    closure
        The loops of the mechanism.
    values
        (variables,) a nearly closed configuration (rad).
    limits
        The limits at which curves end: bounds of variables, and equal curvatures of two
        profiles in contact.

    Raises
    ------
    SolveError
        If the configuration is not finite, does not close, does not move, is beyond a
        limit, or is singular.
    """
    if not all_finite(values):
        raise SolveError(
            "the start configuration of the curve is not finite; give finite pair variables"
        )
    residual = float(closure.linearise(values[None]).closure_residual[0])
    if not residual < MAX_START_RESIDUAL_RAD:
        raise SolveError(
            "the start configuration of the curve does not close: its residual is "
            f"{residual:.3g} rad, but at most {MAX_START_RESIDUAL_RAD:g} is allowed; start "
            "from a computed configuration"
        )
    # The rates of the only motion. This raises an error if the loops allow no motion. From
    # here on, all arrays have one row.
    motion = _find_motion(closure, values)[None]
    # Newton's method closes the loops and keeps motion . values constant, so that the point
    # does not move along the curve. This is one more equation, the border.
    start_values = values[None]
    closed_values, _ = correct(
        closure, start_values, borders=motion, targets=np.vecdot(motion, start_values)
    )
    points, linearisation = curve_points(closure, closed_values, borders=motion)
    node = _ArcNodes.from_points(linearisation, points, limits)
    # The loop equations with the border are singular if several motions are possible.
    # Newton's method can then lead away from the start.
    is_regular = node.reciprocal_condition[0] > SINGULAR_CURVE_CONDITION
    is_closed = node.residual[0] < SAME_POINT_RAD
    if not (is_regular and is_closed):
        raise SolveError(SINGULAR_START)
    # A margin is the distance from a limit, negative beyond it.
    for number, margin in enumerate(node.margins[0]):
        if margin < -CLOSURE_TOLERANCE:
            raise SolveError(
                f"the start configuration of the curve is {-margin:.3g} beyond "
                f"{limits.describe(number)}; start from a configuration within the limits"
            )
    return node


def _find_motion(closure: Closure, values: Floats) -> Floats:
    """Return the rates of all pair variables in the only motion at a configuration.

    The rates are a unit vector (variables,), the tangent of the configuration curve. The
    component of largest absolute value is positive, which defines the sense in which the
    curve is followed.

    Raises
    ------
    SolveError
        If the loops allow no motion.
    """
    # Rates with J rates = 0 keep the loops closed, with the closure Jacobian J. The last
    # right singular vector has this property if its singular value is zero. With more
    # variables than equations, singular values are missing, and count as zero.
    _, singular_values, right_vectors = np.linalg.svd(
        closure.linearise(values[None]).jacobian[0]
    )
    missing = len(right_vectors) - len(singular_values)
    singular_values = np.append(singular_values, np.zeros(missing))
    if singular_values[-1] > MIN_RIGID_RATIO * singular_values[0]:
        raise SolveError(
            "the start configuration of the curve cannot move: the loops leave no degree "
            "of freedom"
        )
    tangent = right_vectors[-1]
    return tangent * np.sign(tangent[np.argmax(np.abs(tangent))])


@dataclass
class _ArcContinuation(CurveContinuation[_ArcNodes]):
    """Follows curves of configurations by verified steps, each curve in one sense.

    Attributes
    ----------
    closure
        The loops, at one sample for each curve if variables are locked.
    limits
        The limits at which curves end.
    """

    step_tests = Verification()
    smallest_step = 1e-12
    same_point_rad = SAME_POINT_RAD
    max_nodes = 100_000

    closure: Closure
    limits: CurveLimits

    def end_finished_curves(self, rows: Indices) -> None:
        """End curves (k,) at crossings, and at limits that they approach."""
        nodes = self.last_nodes
        is_crossing = nodes.reciprocal_condition[rows] < SINGULAR_CURVE_CONDITION
        self.end_status[rows[is_crossing]] = Status.AT_SINGULARITY
        # Axes: curve, limit.
        reaches = nodes.margins[rows] < NEAR_END_RAD
        reaches &= nodes.approach[rows] > 0.0
        for k in np.flatnonzero(np.any(reaches, axis=1) & ~is_crossing):
            margins = np.where(reaches[k], nodes.margins[rows[k]], np.inf)
            self._land_on_limit(rows[k : k + 1], int(np.argmin(margins)))

    def limit_steps(self, rows: Indices, steps: Floats) -> Floats:
        """Return the steps (k,) that the curvature at the last nodes allows (rad)."""
        curvature = np.linalg.norm(self.last_nodes.bends[rows], axis=1)
        largest = np.minimum(self.max_step, MAX_STEP_ROTATION_RAD / (curvature + 1e-300))
        return np.minimum(steps, largest)

    def try_steps(
        self, rows: Indices, nodes: _ArcNodes, distances: Floats
    ) -> TriedSteps[_ArcNodes]:
        """Try a step on each of some curves, and test it.

        The middle and the end of a step are predicted by the tangent and the second
        derivative, and corrected by Newton's method in planes normal to the tangent. The
        step is verified if the corrections, the change of the equations, and the turn of
        the tangent are small, and if a curve interpolated between both ends passes through
        the middle (`verify_steps`). The equations are the closure Jacobian, bordered by the
        tangent: with the tangent as a further row.

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        nodes
            (k) nodes from which the steps start.
        distances
            (k,) lengths of the steps (rad), measured along the tangents at the nodes.
        """
        # Two points for each step: its middle and its end, one after the other. These
        # points are corrected in the planes tangent . values = target, at the distances
        # `parts`, which are half the step and the whole step.
        closure = self.closure.select_rows(np.repeat(rows, 2))
        parts = distances[:, None] * STEP_PARTS
        prediction = extrapolate(nodes.values, nodes.tangents, nodes.bends, parts)
        borders = np.repeat(nodes.tangents, 2, axis=0)
        targets = np.vecdot(nodes.tangents, nodes.values)[:, None] + parts
        values, newton_steps = correct(closure, prediction, borders, targets.ravel())
        # `is_good` (2 k,) collects the tests of all points.
        is_good = all_finite(values, 1)
        is_good &= self.step_tests.accepts_correction(newton_steps, np.repeat(distances, 2))
        # Points that failed are replaced by the node, at which everything is finite.
        values[~is_good] = np.repeat(nodes.values, 2, axis=0)[~is_good]
        points, linearisation = curve_points(closure, values, borders)
        is_good &= points.residual < CLOSURE_TOLERANCE
        # The change of the bordered Jacobian A from the node, relative to it: the norm of
        # A(node)^-1 (A - A(node)). The node stores A as `equations`, with its inverse.
        node_equations = np.repeat(nodes.equations, 2, axis=0)
        change = bordered(linearisation.jacobian, borders) - node_equations
        inverse = np.repeat(nodes.inverse, 2, axis=0)
        relative_change = np.linalg.norm(inverse @ change, axis=(1, 2))
        cosine = np.vecdot(points.tangents, borders)
        is_good &= self.step_tests.accepts_change(relative_change, cosine)
        # The ends of the steps, every second point, become nodes.
        new_nodes = _ArcNodes.from_points(
            linearisation, points, self.limits, chosen=slice(1, None, 2)
        )
        # Rounding errors of corrected points grow with the condition number.
        rounding_errors = POINT_ROUNDING_FACTOR * EPS / nodes.reciprocal_condition
        is_verified = self.verify_steps(
            starts=nodes,
            stops=new_nodes,
            middles=values[::2],
            distances=distances,
            is_good=is_good.reshape(-1, 2),
            rounding=rounding_errors,
        )
        changes = np.max(relative_change.reshape(-1, 2), axis=1)
        return TriedSteps(new_nodes, is_verified, changes)

    def select_steps(
        self, rows: Indices, steps: Floats, new_nodes: _ArcNodes, is_verified: Bools
    ) -> Bools:
        """Return a mask (k,) of the verified steps that do not lead beyond a limit."""
        return is_verified & np.all(new_nodes.margins >= 0.0, axis=1)

    def _land_on_limit(self, row: Indices, number: int) -> None:
        """End a curve exactly at a limit near its last node, if this is possible.

        A limit is a bound of a variable, or equal curvatures of two profiles in contact.
        Profiles with equal curvatures do not determine how they move. The margin of a node
        is its distance from the limit (rad, or difference of curvatures). A last step has
        to lead to the limit and pass the tests that it stays on the curve. If no such step
        exists, nothing is changed.

        Parameters
        ----------
        row
            (1,) index of the curve.
        number
            Index of the limit.
        """
        node = self.last_nodes.rows(row)
        # With a margin of zero, up to rounding, the node is at the limit already.
        is_before_limit = node.margins[0, number] > CLOSURE_TOLERANCE
        if is_before_limit:
            # Newton's method finds a point at the limit, perhaps on another curve. A tested
            # step of the same length must lead to the same point.
            landing = self._find_point_at_limit(row, node.values, number)
            distance = np.sum(node.tangents * (landing - node.values), axis=1)
            last_step = self.try_steps(row, node, distance)
            miss = max_abs(last_step.nodes.values - landing)
            is_ahead = distance[0] > 0.0
            is_same_point = miss < SAME_POINT_RAD
            if not (is_ahead and last_step.is_verified[0] and is_same_point):
                return
            self.append_nodes(row, last_step.nodes)
        self.end_status[row] = self.limits.statuses[number]

    def _find_point_at_limit(self, row: Indices, values: Floats, number: int) -> Floats:
        """Return a closed configuration that is exactly at a limit, by Newton's method.

        A limit is a bound of a variable, or equal curvatures of two profiles in contact. At
        the limit its margin (distance) is zero.

        Parameters
        ----------
        row
            (1,) index of the curve.
        values
            (1, variables) configuration (rad) at which Newton's method starts.
        number
            Index of the limit.

        Returns
        -------
        (1, variables) configuration (rad), which may be on another curve.
        """
        # Take the values of locked variables of this curve.
        closure = self.closure.select_rows(row)

        def compute_steps(values: Floats, _: Indices) -> Floats:
            """Return Newton's steps (1, variables) for closed loops and a margin of 0."""
            linearisation = closure.linearise(values)
            margins, gradients = self.limits.margins(
                values,
                linearisation.states.curvatures,
                linearisation.states.curvature_rates,
            )
            # The loop equations, and as a further equation: gradient . step = -margin.
            return bordered_step(linearisation, gradients[:, number], -margins[:, number])

        point, _ = newton(
            compute_steps, values, max_steps=LANDING_STEPS, last_step=LANDING_STEP_RAD
        )
        return point

    def end_stuck_curve(self, row: int) -> None:
        """End a curve that no step continues from its last node, and set a status.

        A limit is a bound of a variable, or equal curvatures of two profiles in contact. If
        the node is near a limit, the curve gets the status of the limit. Where two curves
        cross, their equations are singular. At another node with nearly singular equations,
        the status is therefore AT_SINGULARITY. In all other cases it is MODE_LOST.
        """
        reciprocal_condition = self.last_nodes.reciprocal_condition[row]
        is_near_crossing = reciprocal_condition < END_AT_SINGULARITY_CONDITION
        self.end_status[row] = (
            Status.AT_SINGULARITY if is_near_crossing else Status.MODE_LOST
        )
        # The margins are the distances from all limits.
        near_limits = np.flatnonzero(self.last_nodes.margins[row] < NEAR_END_RAD)
        if len(near_limits):
            self.end_status[row] = self.limits.statuses[near_limits[0]]
