"""Following the configuration curve in its own arc length, step by safe step.

A step is predicted with exact first and second derivatives and corrected in the
hyperplane normal to the tangent. It is accepted only if the prediction was nearly right,
Newton's method contracted at once, the tangent turned little, and the bordered Jacobian
changed by less than would make it singular on the way; two curves that pass each other
closely have Jacobians of opposite orientation there, so the last test keeps them apart.
The Hermite polynomial of the step must also predict its middle. Otherwise it is halved.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, EPS, Status
from spherekit.errors import SolveError
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.closure import Closure
from spherekit.motion.limits import Limit, limits_of
from spherekit.motion.loops import left_inverse
from spherekit.motion.segments import (
    CurvePoints,
    Linearised,
    Segments,
    bordered,
    correct,
    curve_points,
)
from spherekit.sphere.rotation import Floats

LARGEST_STEP = 0.4
"""Longest step (rad of arc length)."""
LARGEST_TURN = 0.4
"""Angle (rad) by which the tangent may turn in one step, by the curvature at its start."""
LARGEST_CHANGE = 0.6
"""Change of the bordered Jacobian in one step, relative; at 1 it may become singular."""
LARGEST_CORRECTION = 0.05
"""A prediction from the start of a step may be wrong by this part of it."""
LARGEST_MIDDLE = 1e-4
"""The prediction of its middle from both ends may be wrong by this part of it."""
SMALLEST_STEP = 1e-12
SINGULAR = 1e-6
"""A node whose equations have this reciprocal condition is a crossing of curves: nearer to
one, rounding moves points by more than a small part of the steps left. It is met by
four-bars that are longer or shorter than a folding one by less than about 1e-11 rad."""
NEARLY_FLAT = 1e-3
"""The same for a node that no step leaves, to name the reason."""
NEARLY_THERE = 1e-6
"""How near to a limit (rad) the last node is, to name it as the reason of an end."""
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
MOST_NODES = 100_000
MOST_TEETH = 10_000
"""Lengths of rolling profiles have a ratio of whole numbers up to this, or none."""


@final
@dataclass(frozen=True)
class _Node:
    """One point of the curve with its linearised equations, bordered by its tangent."""

    point: CurvePoints
    equations: Linearised

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
    def flatness(self) -> float:
        return float(self.equations.flatness[0])

    def margin(self, limit: Limit) -> tuple[float, Floats]:
        """Return how far the limit is, and the gradient (variables,) of that."""
        equations = self.equations
        return limit.margin(
            self.values, equations.curvatures[0], equations.curvature_rates[0]
        )

    def taylor(self, way: Floats) -> Floats:
        """Return the curve (n, variables) at arc lengths (n,) from here, second order."""
        way = way[:, None]
        out: Floats = self.values + way * self.tangent + 0.5 * way**2 * self.bend
        return out


@final
@dataclass(frozen=True)
class _Step:
    """A verified step, and how much of the allowed change it took."""

    node: _Node
    change: float


def follow_arc(
    closure: Closure,
    values: Floats,
    stops: Mapping[int, tuple[float, float]] | None = None,
    longest: float = 500.0,
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
    march = _March(closure, limits, periods, longest, step)
    ways: list[CurvePoints] = []
    ends: list[Status] = []
    for first in (start, _turned(start)):
        nodes, why, winding = march.run(first)
        points = CurvePoints.joined([node.point for node in [first, *nodes]])
        if winding is not None:
            closed = (Status.OK, Status.OK)
            return ArcCurve(Segments(closure, points), periods, True, winding, closed, 0)
        ways.append(points)
        ends.append(why)
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
    gap = float(np.max(np.abs(closure.linearise(values[None])[0]), initial=0.0))
    if not gap < CLOSED_START:
        raise SolveError(
            f"the configuration to follow does not close: its residual is {gap:.3g} rad, "
            f"but at most {CLOSED_START:g} is allowed; start from one that was solved for"
        )
    border = _motion(closure, values)
    target = np.array([border @ values])
    values = correct(closure, values[None], border[None], target).values
    point, equations = curve_points(closure, values, border[None])
    node = _Node(point, equations.rebordered(0, point.tangents[0]))
    if not node.flatness > SINGULAR:
        raise SolveError(SINGULAR_START)
    return node


def _motion(closure: Closure, values: Floats) -> Floats:
    """Return the unit vector (variables,) of the only motion, its largest part positive."""
    _, jacobian = closure.linearise(values[None])
    _, sizes, right = np.linalg.svd(jacobian[0])
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
@dataclass(frozen=True)
class _March:
    closure: Closure
    limits: tuple[Limit, ...]
    periods: Floats
    longest: float
    step: float

    def run(self, start: _Node) -> tuple[list[_Node], Status, NDArray[np.int64] | None]:
        """Return nodes after the start, why they end, and the winding if they close."""
        nodes: list[_Node] = []
        at, step, way = start, 0.1, 0.0
        while len(nodes) < MOST_NODES and way < self.longest:
            if at.flatness < SINGULAR:
                return nodes, Status.AT_SINGULARITY, None
            bend = float(np.linalg.norm(at.bend))
            step = min(step, self.step, LARGEST_TURN / (bend + 1e-300))
            made = self._advance(at, step)
            if made is not None and way > 4.0 * NEARLY_THERE:
                end = self._closing(start, at, step, made.node)
                if end is not None:
                    if np.max(np.abs(end.values - at.values)) < NEARLY_THERE:
                        nodes.pop()
                    nodes.append(end)
                    laps = (end.values - start.values) / self.periods
                    return nodes, Status.OK, np.round(laps).astype(np.int64)
            if made is None or self._passed(made.node) is not None:
                landed = self._landing(at, step)
                if landed is not None:
                    end, limit = landed
                    return [*nodes, end], limit.status, None
                if step <= SMALLEST_STEP:
                    return nodes, self._why(at), None
                step *= 0.5
                continue
            nodes.append(made.node)
            way += float(np.linalg.norm(made.node.values - at.values))
            at = made.node
            step *= min(2.0, max(0.5, 0.6 * LARGEST_CHANGE / (made.change + 1e-300)))
        return nodes, Status.OK if way >= self.longest else Status.BRANCH_LOST, None

    def _advance(self, at: _Node, step: float) -> _Step | None:
        """Return the node at this projection on the tangent if it passes all tests."""
        way = np.array([0.5, 1.0]) * step
        guess = at.taylor(way)
        borders = np.stack([at.tangent, at.tangent])
        targets = float(at.tangent @ at.values) + way
        found = correct(self.closure, guess, borders, targets)
        if not np.all(np.isfinite(found.values)):
            return None
        if np.any(found.first_step > LARGEST_CORRECTION * step + CLOSURE_TOLERANCE):
            return None
        if np.any((found.first_step > 1e-7) & (found.ratio > 0.1)):
            return None
        points, equations = curve_points(self.closure, found.values, borders)
        if not np.all(points.residual < CLOSURE_TOLERANCE):
            return None
        change = equations.jacobian - at.equations.jacobian
        moved = np.linalg.norm(at.equations.inverse @ change, axis=(1, 2))
        turned = points.tangents @ at.tangent
        if not (np.all(moved < LARGEST_CHANGE) and np.all(turned > 0.9)):
            return None
        last = points.rows(slice(1, 2))
        chord = Segments(self.closure, CurvePoints.joined([at.point, last]))
        along = (found.values[0] - at.values) @ chord.directions[0] / chord.chords
        middle = chord.predict(np.zeros(1, dtype=np.intp), along)[0]
        rounding = 8.0 * EPS / at.flatness
        if np.max(np.abs(middle - found.values[0])) > LARGEST_MIDDLE * step + rounding:
            return None
        node = _Node(last, equations.rebordered(1, last.tangents[0]))
        return _Step(node, float(np.max(moved)))

    def _passed(self, node: _Node) -> Limit | None:
        """Return a limit that a node is beyond."""
        for limit in self.limits:
            margin, _ = node.margin(limit)
            if margin < 0.0:
                return limit
        return None

    def _landing(self, at: _Node, step: float) -> tuple[_Node, Limit] | None:
        """Return the first limit within a step, and the node exactly on it."""
        best: tuple[_Node, Limit, float] | None = None
        for limit in self.limits:
            margin, gradient = at.margin(limit)
            rate, bend = float(gradient @ at.tangent), float(gradient @ at.bend)
            way = _first_root(margin, rate, 0.5 * bend)
            if way <= SMALLEST_STEP:
                return None
            if not way <= 1.5 * step:
                continue
            on = self._onto(limit, at.taylor(np.array([way])))
            if on is None:
                continue
            way = float(at.tangent @ (on - at.values))
            if not 0.0 < way <= step or (best is not None and best[2] <= way):
                continue
            made = self._advance(at, way)
            if made is not None and np.max(np.abs(made.node.values - on)) < SAME:
                best = made.node, limit, way
        return None if best is None else best[:2]

    def _onto(self, limit: Limit, values: Floats) -> Floats | None:
        """Return the closed configuration (variables,) on a limit, by Newton's method."""
        for _ in range(12):
            placed, states = self.closure.place(values)
            jacobian = self.closure.tree.jacobian(self.closure.vectors(placed, states))
            margin, gradient = limit.margin(
                values[0], states.curvatures[0], states.curvature_rates[0]
            )
            inverse = left_inverse(bordered(jacobian, gradient[None]))[0]
            gap = np.append(self.closure.residual(placed, states)[0], margin)
            change = -inverse @ gap
            if not np.all(np.isfinite(change)):
                return None
            values = values + change
            if np.max(np.abs(change)) < 1e-14:
                break
        return np.asarray(values[0])

    def _closing(self, start: _Node, at: _Node, step: float, new: _Node) -> _Node | None:
        """Return the start, some periods on, if a verified step runs through it."""
        middle = 0.5 * (at.values + new.values)
        laps = np.round((middle - start.values) / self.periods)
        finite = np.where(np.isfinite(self.periods), self.periods, 0.0)
        again = start.values + laps * finite
        way = float(at.tangent @ (again - at.values))
        if not -NEARLY_THERE < way <= step or start.tangent @ at.tangent < 0.8:
            return None
        if np.max(np.abs(again - at.taylor(np.array([way])))) > LARGEST_CORRECTION * step:
            return None
        if abs(way) > NEARLY_THERE:
            made = self._advance(at, way)
            if made is None or np.max(np.abs(made.node.values - again)) > SAME:
                return None
        elif np.max(np.abs(at.taylor(np.array([way])) - again)) > SAME:
            return None
        point = CurvePoints(
            again[None], start.point.tangents, start.point.bends, start.point.residual
        )
        return _Node(point, start.equations)

    def _why(self, at: _Node) -> Status:
        """Return the status of what lies beyond a node that no step leaves."""
        for limit in self.limits:
            margin, _ = at.margin(limit)
            if margin < NEARLY_THERE:
                return limit.status
        return Status.AT_SINGULARITY if at.flatness < NEARLY_FLAT else Status.BRANCH_LOST


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
