"""Following the configuration curve in its own arc length, step by safe step.

The path is a `CurvePath` of `spherekit.motion.closure`. A step is predicted with exact
first and second derivatives and corrected in the hyperplane normal to the tangent. Two
curves that pass each other closely have bordered Jacobians of opposite orientation there,
so that the test of their change keeps them apart.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, EPS, EQUAL_CURVATURE, Status
from spherekit.errors import SolveError
from spherekit.motion.arc_curve import (
    ArcCurve,
    CurvePoints,
    Segments,
    bordered,
    bordered_condition,
    bordered_step,
    correct,
    curve_points,
)
from spherekit.motion.closure import (
    NEARLY_THERE,
    STEP_PARTS,
    Closure,
    CurvePath,
    Rows,
    Verification,
    newton,
    run_each,
    taylor,
)
from spherekit.motion.loops import Linearisation, contact_tracks, left_inverse
from spherekit.numeric.zeros import ArrayRows
from spherekit.sphere.rotation import Floats

LONGEST = 500.0
"""Length (rad) after which a curve that does not close is ended."""
LARGEST_STEP = 0.4
"""Longest step (rad of arc length)."""
FIRST_STEP = 0.1
"""The first step that is tried (rad)."""
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
class _Limit:
    """Where a curve has to end: a bound of a variable, or equal curvatures of profiles.

    `margin` says of variables (variables,), with `curvatures` and `rates` (pairs, 2) of the
    profiles, how far the limit is, negative beyond it, and the gradient of that.
    """

    status: Status
    words: str
    margin: Callable[[Floats, Floats, Floats], tuple[float, Floats]]


def _bound(variable: int, value: float, sense: float, status: Status) -> _Limit:
    """Return the limit of a variable from above (`sense` 1) or from below (-1)."""

    def margin(values: Floats, _: Floats, __: Floats) -> tuple[float, Floats]:
        gradient = sense * (np.arange(len(values)) == variable)
        return sense * (float(values[variable]) - value), gradient

    side = "lowest" if sense > 0.0 else "highest"
    words = f"the {side} value {value:.6g} rad of variable {variable}"
    return _Limit(status, words, margin)


def _equal_curvatures(pair: int, along: Sequence[int]) -> _Limit:
    """Return the limit of a contact pair, whose arc lengths are the variables `along`."""

    def margin(values: Floats, bends: Floats, rates: Floats) -> tuple[float, Floats]:
        gradient = np.zeros(len(values))
        np.add.at(gradient, along, rates[pair] * [1.0, -1.0])
        return float(bends[pair, 0] - bends[pair, 1]) - EQUAL_CURVATURE, gradient

    words = f"equal curvatures of the profiles of pair {pair}"
    return _Limit(Status.CURVATURE, words, margin)


def _limits_of(
    closure: Closure, stops: Mapping[int, tuple[float, float]]
) -> tuple[_Limit, ...]:
    """Return the ends of open profiles, equal curvatures, and stops.

    `stops` has the lowest and the highest value (rad) of variables by their numbers.
    """
    limits: list[_Limit] = []
    bounds = [(variable, *ends, Status.OK) for variable, ends in stops.items()]
    for pair, tracks in contact_tracks(closure.joints):
        limits.append(_equal_curvatures(pair, [track.variable for track in tracks]))
        for track in tracks:
            if not track.curve.closed:
                ends = -track.start, track.curve.length - track.start
                bounds.append((track.variable, *ends, Status.OFF_PROFILE))
    for variable, low, high, status in bounds:
        limits.append(_bound(variable, low, 1.0, status))
        limits.append(_bound(variable, high, -1.0, status))
    return tuple(limits)


@final
@dataclass(frozen=True)
class _Nodes(ArrayRows):
    """Points with their equations (n, 3 loops + 1, variables), bordered by the tangents.

    `inverse` and `reciprocal_condition` (n,) are those of the equations; `curvatures`,
    `curvature_rates` (n, pairs, 2) those of profiles. A single one is a node of a path.
    """

    points: CurvePoints
    equations: Floats
    inverse: Floats
    reciprocal_condition: Floats
    curvatures: Floats
    curvature_rates: Floats

    @staticmethod
    def of(at: Linearisation, points: CurvePoints) -> "_Nodes":
        """Return the nodes at points, the closure `at` these."""
        equations = bordered(at.jacobian, points.tangents)
        inverse = left_inverse(equations)
        condition = bordered_condition(equations, inverse)
        bends = at.states.curvatures, at.states.curvature_rates
        return _Nodes(points, equations, inverse, condition, *bends)

    @property
    def values(self) -> Floats:
        return np.asarray(self.points.values[0])

    @property
    def tangent(self) -> Floats:
        return np.asarray(self.points.tangents[0])

    @property
    def bend(self) -> Floats:
        return np.asarray(self.points.bends[0])

    def margin(self, limit: _Limit) -> tuple[float, Floats]:
        """Return how far the limit is, and the gradient (variables,) of that."""
        return limit.margin(self.values, self.curvatures[0], self.curvature_rates[0])


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
    paths = _begun(closure, values, stops or {}, longest, step)
    _run_both([paths])
    return _curve(*paths)


def follow_arcs(
    closures: Sequence[Closure], starts: Floats, longest: float = LONGEST
) -> list[ArcCurve | None]:
    """Return the curves through configurations (n, variables), side by side.

    Closures are alike but for their leads. None where `follow_arc` raises an error.
    """
    begun: dict[int, tuple[_ArcPath, _ArcPath]] = {}
    for number, (closure, values) in enumerate(zip(closures, starts, strict=True)):
        with suppress(SolveError):
            begun[number] = _begun(closure, values, {}, longest, LARGEST_STEP)
    _run_both(list(begun.values()))
    return [_curve(*begun[k]) if k in begun else None for k in range(len(starts))]


def _begun(
    closure: Closure,
    values: Floats,
    stops: Mapping[int, tuple[float, float]],
    longest: float,
    step: float,
) -> "tuple[_ArcPath, _ArcPath]":
    """Return the beginnings of a curve in both senses."""
    start, at = _started(closure, np.asarray(values, dtype=float))
    limits = _limits_of(closure, stops)
    periods = periods_of(closure)
    for limit in limits:
        margin, _ = start.margin(limit)
        if margin < -CLOSURE_TOLERANCE:
            raise SolveError(
                f"the configuration to follow is {-margin:.3g} beyond {limit.words}; start "
                "from one within its limits"
            )
    ahead, behind = (
        _ArcPath(first, periods, longest, step, closure, limits)
        for first in (start, _Nodes.of(at, start.points.reversed))
    )
    return ahead, behind


def _run_both(begun: "Sequence[tuple[_ArcPath, _ArcPath]]") -> None:
    """Follow curves in one sense, and in the other where they do not close."""
    run_each([ahead for ahead, _ in begun], FIRST_STEP)
    run_each([behind for ahead, behind in begun if not ahead.closed], FIRST_STEP)


def _curve(ahead: "_ArcPath", behind: "_ArcPath") -> ArcCurve:
    """Return the curve that was followed in both senses."""
    closure, periods = ahead.closure, ahead.periods
    for path in (ahead, behind):
        if path.closed:
            segments = Segments(closure, path.points)
            ends = (Status.OK, Status.OK)
            return ArcCurve(segments, periods, True, path.winding, ends, 0)
    count = len(behind.nodes)
    if count == 0 and not ahead.nodes:
        raise SolveError(
            "the configuration to follow has its limits on both sides; widen the stops"
        )
    back = behind.points.reversed.rows(slice(-1))
    points = CurvePoints.joined([back, ahead.points])
    winding = np.zeros(len(periods), dtype=np.int64)
    ends = (behind.end or Status.OK, ahead.end or Status.OK)
    return ArcCurve(Segments(closure, points), periods, False, winding, ends, count)


def periods_of(closure: Closure) -> Floats:
    """Return the growth (variables,) of each variable that gives the same configuration."""
    return np.array([period for joint in closure.joints for period in joint.periods])


def _started(closure: Closure, values: Floats) -> tuple[_Nodes, Linearisation]:
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
    points, at = curve_points(closure, values, border[None])
    node = _Nodes.of(at, points)
    if not node.reciprocal_condition[0] > SINGULAR:
        raise SolveError(SINGULAR_START)
    return node, at


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


@final
@dataclass
class _ArcPath(CurvePath[_Nodes]):
    """One sense of a configuration curve."""

    verification = Verification()
    smallest_step = 1e-12
    same = SAME
    most_nodes = 100_000

    closure: Closure
    limits: tuple[_Limit, ...]

    @property
    def points(self) -> CurvePoints:
        """All nodes, the start first."""
        return CurvePoints.joined([node.points for node in (self.start, *self.nodes)])

    def exhausted(self) -> Status | None:
        """Return AT_SINGULARITY at a crossing of curves."""
        return Status.AT_SINGULARITY if self.at.reciprocal_condition[0] < SINGULAR else None

    @property
    def allowed(self) -> float:
        """The step that the curvature allows."""
        bend = float(np.linalg.norm(self.at.bend))
        return min(self.largest, LARGEST_TURN / (bend + 1e-300))

    @staticmethod
    def steps_to(
        paths: "Sequence[CurvePath[_Nodes]]", ats: Sequence[_Nodes], ways: Floats
    ) -> list[tuple[_Nodes, float] | None]:
        """Return the nodes at projections (n,) on the tangents that pass all tests."""
        tests = _ArcPath.verification
        closures = [path.closure for path in paths if isinstance(path, _ArcPath)]
        closure = Closure.stacked(closures).take(np.repeat(np.arange(len(ats)), 2))
        nodes = _Nodes.joined(ats)
        here = nodes.points
        parts = ways[:, None] * STEP_PARTS
        guess = taylor(here.values, here.tangents, here.bends, parts)
        borders = np.repeat(here.tangents, 2, axis=0)
        targets = np.sum(here.tangents * here.values, axis=1)[:, None] + parts
        values, steps = correct(closure, guess, borders, targets.ravel())
        good = np.all(np.isfinite(values), axis=1)
        good &= tests.corrected(steps.first, steps.ratio, np.repeat(ways, 2))
        values[~good] = np.repeat(here.values, 2, axis=0)[~good]
        points, at = curve_points(closure, values, borders)
        good &= points.residual < CLOSURE_TOLERANCE
        before = np.repeat(nodes.equations, 2, axis=0)
        change = bordered(at.jacobian, borders) - before
        inverse = np.repeat(nodes.inverse, 2, axis=0)
        moved = np.linalg.norm(inverse @ change, axis=(1, 2))
        good &= tests.regular(moved, np.sum(points.tangents * borders, axis=1))
        ends = slice(1, None, 2)
        last = _Nodes.of(at.take(ends), points.rows(ends))
        middles, holds = values[::2], np.all(good.reshape(-1, 2), axis=1)
        miss = _misses(closure, here, last.points, middles, holds)
        holds &= tests.predicted(miss, ways, 8.0 * EPS / nodes.reciprocal_condition)
        most = np.max(moved.reshape(-1, 2), axis=1).tolist()
        return [
            (last.rows(slice(row, row + 1)), most[row]) if held else None
            for row, held in enumerate(holds.tolist())
        ]

    def again(self, at: _Nodes, values: Floats) -> _Nodes:
        """Return the start at values whole periods on."""
        points = replace(self.start.points, values=values[None])
        return replace(self.start, points=points)

    def within(self, step: float, node: _Nodes | None) -> bool:
        """Return whether a node is within all limits; land on one that a step passes."""
        if node is not None and not self._passed(node):
            return True
        landed = self._landing(step)
        if landed is not None:
            end, limit = landed
            self.nodes.append(end)
            self.end = limit.status
        return False

    def _passed(self, node: _Nodes) -> bool:
        """Return whether a node is beyond a limit."""
        return any(node.margin(limit)[0] < 0.0 for limit in self.limits)

    def _landing(self, step: float) -> tuple[_Nodes, _Limit] | None:
        """Return the first limit within a step, and the node exactly on it."""
        at = self.at
        best: tuple[_Nodes, _Limit, float] | None = None
        for limit in self.limits:
            margin, gradient = at.margin(limit)
            rate, bend = float(gradient @ at.tangent), float(gradient @ at.bend)
            way = _first_root(margin, rate, 0.5 * bend)
            if way <= self.smallest_step:
                return None
            if not way <= 1.5 * step:
                continue
            on = self._onto(limit, at.values + way * at.tangent + 0.5 * way**2 * at.bend)
            if on is None:
                continue
            way = float(at.tangent @ (on - at.values))
            if not 0.0 < way <= step or (best is not None and best[2] <= way):
                continue
            made = self.step_to(at, way)
            if made is not None and np.max(np.abs(made[0].values - on)) < SAME:
                best = made[0], limit, way
        return None if best is None else best[:2]

    def _onto(self, limit: _Limit, start: Floats) -> Floats | None:
        """Return the closed configuration (variables,) on a limit, by Newton's method."""

        def change(values: Floats, _: Rows) -> Floats:
            at = self.closure.at(values)
            margin, gradient = limit.margin(
                values[0], at.states.curvatures[0], at.states.curvature_rates[0]
            )
            return bordered_step(at, gradient[None], np.array([-margin]))

        values, _ = newton(change, start[None], 12, 1e-14)
        return values[0] if np.all(np.isfinite(values)) else None

    def beyond(self) -> Status:
        """Return the status of what lies beyond the last node."""
        at = self.at
        for limit in self.limits:
            margin, _ = at.margin(limit)
            if margin < NEARLY_THERE:
                return limit.status
        return (
            Status.AT_SINGULARITY
            if at.reciprocal_condition[0] < NEARLY_FLAT
            else Status.MODE_LOST
        )


def _misses(
    closure: Closure,
    start: CurvePoints,
    stop: CurvePoints,
    middles: Floats,
    holds: NDArray[np.bool_],
) -> Floats:
    """Return by how much (n,) steps miss middles (n, variables), where they hold so far."""
    miss = np.full(len(holds), np.inf)
    (some,) = np.nonzero(holds)
    count = len(some)
    both = CurvePoints.joined([start.rows(some), stop.rows(some)])
    order = np.arange(2 * count).reshape(2, count).T.ravel()
    chord = Segments(closure, both.rows(order))
    which = 2 * np.arange(count)
    away = middles[some] - start.values[some]
    along = np.sum(away * chord.directions[which], axis=1) / chord.chords[which]
    wrong = chord.predict(which, along) - middles[some]
    miss[some] = np.max(np.abs(wrong), axis=1, initial=0.0)
    return miss


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
