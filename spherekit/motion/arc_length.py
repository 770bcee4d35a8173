"""Following the configuration curve in its own arc length, step by safe step.

The path is a `spherekit.motion.curve_path.CurvePath`. A step is predicted with exact first
and second derivatives and corrected in the hyperplane normal to the tangent. Two curves
that pass each other closely have bordered Jacobians of opposite orientation there, so that
the test of their change keeps them apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, EPS, Status
from spherekit.errors import SolveError
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.closure import Closure
from spherekit.motion.continuation import Rows, Verification
from spherekit.motion.curve_path import NEARLY_THERE, STEP_PARTS, CurvePath, taylor
from spherekit.motion.limits import Limit, limits_of
from spherekit.motion.loops import left_inverse
from spherekit.motion.segments import (
    Bordered,
    CurvePoints,
    Segments,
    bordered,
    correct,
    curve_points,
)
from spherekit.sphere.rotation import Floats

LONGEST = 500.0
"""Length (rad) after which a curve that does not close is ended."""
LARGEST_STEP = 0.4
"""Longest step (rad of arc length)."""
LARGEST_TURN = 0.4
"""Angle (rad) by which the tangent may turn in one step, by the curvature at its start."""
SINGULAR = 1e-6
"""A node whose equations have this reciprocal condition is a crossing of curves: nearer to
one, rounding moves points by more than a small part of the steps left. It is met by
four-bars that are longer or shorter than a folding one by less than about 1e-11 rad."""
NEARLY_FLAT = 1e-3
"""The same for a node that no step leaves, to name the reason."""
SAME = 1e-9
"""A lap ends where it started to this (rad)."""
MOVING = 1e-4
"""Redundant equations agree to this, relative, where a start is closed as it has to be."""
CLOSED_START = 1e-6
"""A configuration to follow may be as far from closed as this (rad)."""
SINGULAR_START = (
    "the configuration to follow is singular: two curves cross in it, or the mechanism "
    "has more than one freedom; start from another one"
)
MOST_TEETH = 10_000
"""Lengths of rolling profiles have a ratio of whole numbers up to this, or none."""


@final
@dataclass(frozen=True)
class _Node:
    """One point of the curve with its linearised equations, bordered by its tangent."""

    point: CurvePoints
    equations: Bordered

    @property
    def values(self) -> Floats:
        return np.asarray(self.point.values[0])

    @property
    def tangent(self) -> Floats:
        return np.asarray(self.point.tangents[0])

    @property
    def bend(self) -> Floats:
        return np.asarray(self.point.bends[0])

    @property
    def reciprocal_condition(self) -> float:
        return float(self.equations.reciprocal_condition[0])

    def margin(self, limit: Limit) -> tuple[float, Floats]:
        """Return how far the limit is, and the gradient (variables,) of that."""
        states = self.equations.at.states
        return limit.margin(self.values, states.curvatures[0], states.curvature_rates[0])


def follow_arc(
    closure: Closure,
    values: Floats,
    stops: Mapping[int, tuple[float, float]] | None = None,
    longest: float = LONGEST,
    step: float = LARGEST_STEP,
) -> ArcCurve:
    """Return the configuration curve through a closed configuration.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism (constant pair frames).
    values
        (variables,) a configuration that closes, to 1e-6 rad or better.
    stops
        Lowest and highest value (rad) of variables by their numbers.
    longest
        Length (rad) after which the curve is ended in each sense, open.
    step
        Longest step (rad); a smaller one makes it even less likely to miss anything.

    Raises
    ------
    SolveError
        If the configuration does not close, does not move, is beyond a limit, or is a
        singular one.
    """
    start = _started(closure, np.asarray(values, dtype=float))
    limits = limits_of(closure, stops or {})
    periods = periods_of(closure)
    for limit in limits:
        margin, _ = start.margin(limit)
        if margin < -CLOSURE_TOLERANCE:
            raise SolveError(
                f"the configuration to follow is {-margin:.3g} beyond {limit.words}; start "
                "from one within its limits"
            )
    ways: list[CurvePoints] = []
    ends: list[Status] = []
    for first in (start, _turned(start)):
        path = _ArcPath(first, periods, longest, step, closure, limits).run(0.1)
        points = CurvePoints.joined([node.point for node in [first, *path.nodes]])
        if path.closed:
            closed = (Status.OK, Status.OK)
            segments = Segments(closure, points)
            return ArcCurve(segments, periods, True, path.winding, closed, 0)
        ways.append(points)
        ends.append(path.end or Status.OK)
    ahead, behind = ways
    count = len(behind.values) - 1
    if count == 0 and len(ahead.values) == 1:
        raise SolveError(
            "the configuration to follow has its limits on both sides; widen the stops"
        )
    points = CurvePoints.joined([behind.reversed, ahead.rows(slice(1, None))])
    winding = np.zeros(len(periods), dtype=np.int64)
    why_ahead, why_behind = ends
    return ArcCurve(
        Segments(closure, points), periods, False, winding, (why_behind, why_ahead), count
    )


def periods_of(closure: Closure) -> Floats:
    """Return the growth (variables,) of each variable that gives the same configuration."""
    return np.array([period for joint in closure.joints for period in joint.periods])


def _started(closure: Closure, values: Floats) -> _Node:
    """Return the node of a configuration, after closing it exactly."""
    if not np.all(np.isfinite(values)):
        raise SolveError("the configuration to follow has to be finite, but is not")
    gap = float(closure.at(values[None]).gap[0])
    if not gap < CLOSED_START:
        raise SolveError(
            f"the configuration to follow does not close: its residual is {gap:.3g} rad, "
            f"but at most {CLOSED_START:g} is allowed; start from one that was solved for"
        )
    border = _motion(closure, values)
    target = np.array([border @ values])
    values, _ = correct(closure, values[None], border[None], target)
    point, equations = curve_points(closure, values, border[None])
    node = _Node(point, equations.rebordered(0, point.tangents[0]))
    if not node.reciprocal_condition > SINGULAR:
        raise SolveError(SINGULAR_START)
    return node


def _motion(closure: Closure, values: Floats) -> Floats:
    """Return the unit vector (variables,) of the only motion, its largest part positive."""
    _, sizes, right = np.linalg.svd(closure.at(values[None]).jacobian[0])
    sizes = np.append(sizes, np.zeros(max(0, len(right) - len(sizes))))
    if len(sizes) > 1 and sizes[-2] < SINGULAR * sizes[0]:
        raise SolveError(SINGULAR_START)
    if sizes[-1] > MOVING * sizes[0]:
        raise SolveError(
            "the configuration to follow cannot move: the loops leave it no freedom"
        )
    tangent = right[-1]
    return np.asarray(tangent * np.sign(tangent[np.argmax(np.abs(tangent))]))


def _turned(node: _Node) -> _Node:
    """Return the node with the curve run backwards."""
    back = node.point.reversed
    return _Node(back, node.equations.rebordered(0, back.tangents[0]))


@final
@dataclass
class _ArcPath(CurvePath[_Node]):
    """One sense of a configuration curve."""

    verification = Verification()
    smallest_step = 1e-12
    same = SAME
    most_nodes = 100_000

    closure: Closure
    limits: tuple[Limit, ...]

    def exhausted(self) -> Status | None:
        """Return AT_SINGULARITY at a crossing of curves."""
        return Status.AT_SINGULARITY if self.at.reciprocal_condition < SINGULAR else None

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """Return the step that the curvature allows."""
        bend = float(np.linalg.norm(self.at.bend))
        return np.minimum(step, min(self.largest, LARGEST_TURN / (bend + 1e-300)))

    def step_to(self, at: _Node, way: float) -> tuple[_Node, float] | None:
        """Return the node at this projection on the tangent if it passes all tests."""
        tests, parts = self.verification, way * STEP_PARTS
        borders = np.stack([at.tangent, at.tangent])
        targets = float(at.tangent @ at.values) + parts
        values, steps = correct(self.closure, taylor(at, parts), borders, targets)
        if not np.all(np.isfinite(values)):
            return None
        if not np.all(tests.corrected(steps.first, steps.ratio, way)):
            return None
        points, equations = curve_points(self.closure, values, borders)
        if not np.all(points.residual < CLOSURE_TOLERANCE):
            return None
        change = equations.jacobian - at.equations.jacobian
        moved = np.linalg.norm(at.equations.inverse @ change, axis=(1, 2))
        if not tests.regular(moved, points.tangents @ at.tangent):
            return None
        last = points.rows(slice(1, 2))
        chord = Segments(self.closure, CurvePoints.joined([at.point, last]))
        along = (values[0] - at.values) @ chord.directions[0] / chord.chords
        middle = chord.predict(np.zeros(1, dtype=np.intp), along)[0]
        miss = float(np.max(np.abs(middle - values[0])))
        if not tests.predicted(miss, way, 8.0 * EPS / at.reciprocal_condition):
            return None
        node = _Node(last, equations.rebordered(1, last.tangents[0]))
        return node, float(np.max(moved))

    def again(self, at: _Node, values: Floats) -> _Node:
        """Return the start at values whole periods on."""
        start = self.start
        return _Node(replace(start.point, values=values[None]), start.equations)

    def within(self, step: float, node: _Node | None) -> bool:
        """Return whether a node is within all limits; land on one that a step passes."""
        if node is not None and not self._passed(node):
            return True
        landed = self._landing(step)
        if landed is not None:
            end, limit = landed
            self.nodes.append(end)
            self.end = limit.status
        return False

    def _passed(self, node: _Node) -> bool:
        """Return whether a node is beyond a limit."""
        return any(node.margin(limit)[0] < 0.0 for limit in self.limits)

    def _landing(self, step: float) -> tuple[_Node, Limit] | None:
        """Return the first limit within a step, and the node exactly on it."""
        at = self.at
        best: tuple[_Node, Limit, float] | None = None
        for limit in self.limits:
            margin, gradient = at.margin(limit)
            rate, bend = float(gradient @ at.tangent), float(gradient @ at.bend)
            way = _first_root(margin, rate, 0.5 * bend)
            if way <= self.smallest_step:
                return None
            if not way <= 1.5 * step:
                continue
            on = self._onto(limit, taylor(at, np.array([way])))
            if on is None:
                continue
            way = float(at.tangent @ (on - at.values))
            if not 0.0 < way <= step or (best is not None and best[2] <= way):
                continue
            made = self.step_to(at, way)
            if made is not None and np.max(np.abs(made[0].values - on)) < SAME:
                best = made[0], limit, way
        return None if best is None else best[:2]

    def _onto(self, limit: Limit, values: Floats) -> Floats | None:
        """Return the closed configuration (variables,) on a limit, by Newton's method."""
        for _ in range(12):
            at = self.closure.at(values)
            margin, gradient = limit.margin(
                values[0], at.states.curvatures[0], at.states.curvature_rates[0]
            )
            inverse = left_inverse(bordered(at.jacobian, gradient[None]))[0]
            gap = np.append(at.residual[0], margin)
            change = -inverse @ gap
            if not np.all(np.isfinite(change)):
                return None
            values = values + change
            if np.max(np.abs(change)) < 1e-14:
                break
        return np.asarray(values[0])

    def beyond(self) -> Status:
        """Return the status of what lies beyond the last node."""
        at = self.at
        for limit in self.limits:
            margin, _ = at.margin(limit)
            if margin < NEARLY_THERE:
                return limit.status
        return (
            Status.AT_SINGULARITY
            if at.reciprocal_condition < NEARLY_FLAT
            else Status.MODE_LOST
        )


def _first_root(a: float, b: float, c: float) -> float:
    """Return the smallest positive x with a + b x + c x^2 = 0 for a >= 0, or infinity."""
    if abs(c) * a < 1e-12 * b * b:
        return -a / b if b < 0.0 else np.inf
    square = b * b - 4.0 * a * c
    if square < 0.0:
        return np.inf
    q = -0.5 * (b + np.copysign(np.sqrt(square), b))
    roots = [x for x in (q / c if c else np.inf, a / q if q else np.inf) if x > 0.0]
    return min(roots, default=np.inf)
