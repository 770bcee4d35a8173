"""Following the configuration curve in its own arc length, step by safe step.

A step is predicted with exact
first and second derivatives and corrected in the hyperplane normal to the tangent. Two
curves that pass each other closely have bordered Jacobians of opposite orientation there,
so that the test of their change keeps them apart.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
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
from spherekit.motion.closure import Closure, newton
from spherekit.motion.loops import Linearisation, contact_tracks, left_inverse
from spherekit.motion.steps import (
    GOING,
    NEARLY_THERE,
    STEP_PARTS,
    Curves,
    Verification,
    taylor,
)
from spherekit.sphere.rotation import all_finite, max_abs

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


Margin = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
"""How far (n,) the limit of a curve is, negative beyond, and the gradient (n, variables).

Of variables (n, variables), with curvatures and their rates (n, pairs, 2) of profiles.
"""


@dataclass(frozen=True)
class _Limit:
    """Where a curve has to end: a bound of a variable, or equal curvatures of profiles."""

    status: Status
    words: str
    margin: Margin

    def of(self, nodes: "_Nodes") -> tuple[Floats, Floats]:
        """Return the margins (n,) of nodes and the gradients."""
        return self.margin(nodes.values, nodes.curvatures, nodes.curvature_rates)


def _bound(variable: int, value: float, sense: float, status: Status) -> _Limit:
    """Return the limit of a variable from above (`sense` 1) or from below (-1)."""

    def margin(values: Floats, _: Floats, __: Floats) -> tuple[Floats, Floats]:
        gradient = np.zeros_like(values)
        gradient[:, variable] = sense
        return sense * (values[:, variable] - value), gradient

    side = "lowest" if sense > 0.0 else "highest"
    words = f"the {side} value {value:.6g} rad of variable {variable}"
    return _Limit(status, words, margin)


def _equal_curvatures(pair: int, along: Sequence[int]) -> _Limit:
    """Return the limit of a contact pair, whose arc lengths are the variables `along`."""

    def margin(values: Floats, bends: Floats, rates: Floats) -> tuple[Floats, Floats]:
        gradient = np.zeros_like(values)
        for variable, rate in zip(along, (rates[:, pair] * [1.0, -1.0]).T, strict=True):
            gradient[:, variable] += rate
        return bends[:, pair, 0] - bends[:, pair, 1] - EQUAL_CURVATURE, gradient

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


@dataclass(frozen=True)
class _Nodes(CurvePoints):
    """Points with their equations (n, 3 loops + 1, variables), bordered by the tangents.

    `inverse` and `reciprocal_condition` (n,) are those of the equations; `curvatures`,
    `curvature_rates` (n, pairs, 2) those of profiles.
    """

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
        return _Nodes(
            **vars(points),
            equations=equations,
            inverse=inverse,
            reciprocal_condition=condition,
            curvatures=bends[0],
            curvature_rates=bends[1],
        )


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
    limits = _limits_of(closure, stops or {})
    start = _started(closure, np.asarray(values, dtype=float), limits)
    return _followed([closure], [start], limits, longest, step)[0]


def follow_arcs(
    closures: Sequence[Closure], starts: Floats, longest: float = LONGEST
) -> list[ArcCurve | None]:
    """Return the curves through configurations (n, variables), side by side.

    Closures are alike but for their leads. None where `follow_arc` raises an error.
    """
    curves: list[ArcCurve | None] = [None] * len(starts)
    limits, begun = _limits_of(closures[0], {}), dict[int, _Nodes]()
    for number, (closure, values) in enumerate(zip(closures, starts, strict=True)):
        with suppress(SolveError):
            begun[number] = _started(closure, values, limits)
    those = [closures[number] for number in begun]
    made = _followed(those, list(begun.values()), limits, longest, LARGEST_STEP)
    for number, curve in zip(begun, made, strict=True):
        curves[number] = curve
    return curves


def _followed(
    closures: Sequence[Closure],
    starts: Sequence[_Nodes],
    limits: tuple[_Limit, ...],
    longest: float,
    step: float,
) -> list[ArcCurve]:
    """Return the curves through nodes, in both senses where they do not close."""
    if not starts:
        return []
    closure, start = Closure.stacked(closures), _Nodes.joined(starts)
    periods = periods_of(closure)
    back = replace(start.plain, tangents=-start.tangents)
    turned = _Nodes.of(closure.at(start.values), back)
    ahead = _Arcs(start, periods, longest, step, closure, limits)
    ahead.follow(FIRST_STEP)
    left = np.flatnonzero(~ahead.closed)
    given = periods, longest, step, closure.take(left), limits
    behind = _Arcs(turned.rows(left), *given)
    behind.follow(FIRST_STEP)
    place = {int(row): k for k, row in enumerate(left)}
    return [
        _curve(one, ahead, behind, row, place.get(row)) for row, one in enumerate(closures)
    ]


def _curve(
    closure: Closure, ahead: "_Arcs", behind: "_Arcs", row: int, other: int | None
) -> ArcCurve:
    """Return the curve of a row that was followed in both senses."""
    periods, nodes = ahead.periods, ahead.nodes_of(row).plain
    if other is None or behind.closed[other]:
        if other is not None:
            nodes = behind.nodes_of(other).plain
        laps = (nodes.values[-1] - nodes.values[0]) / periods
        winding = np.round(laps).astype(np.int64)
        ends = Status.OK, Status.OK
        return ArcCurve(Segments(nodes, closure), periods, True, winding, ends, 0)
    back = behind.nodes_of(other).plain.reversed.rows(slice(-1))
    count = len(back.values)
    if count == 0 and len(nodes.values) == 1:
        raise SolveError(
            "the configuration to follow has its limits on both sides; widen the "
            "joint limits"
        )
    points = CurvePoints.joined([back, nodes])
    winding = np.zeros(len(periods), dtype=np.int64)
    ends = Status(behind.end[other]), Status(ahead.end[row])
    return ArcCurve(Segments(points, closure), periods, False, winding, ends, count)


def periods_of(closure: Closure) -> Floats:
    """Return the growth (variables,) of each variable that gives the same configuration."""
    return np.array([period for joint in closure.joints for period in joint.periods])


def _started(closure: Closure, values: Floats, limits: tuple[_Limit, ...]) -> _Nodes:
    """Return the node of a configuration, after closing it exactly."""
    if not all_finite(values):
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
    for limit in limits:
        (margin,), _ = limit.of(node)
        if margin < -CLOSURE_TOLERANCE:
            raise SolveError(
                f"the configuration to follow is {-margin:.3g} beyond {limit.words}; start "
                "from one within its limits"
            )
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
    return tangent * np.sign(tangent[np.argmax(np.abs(tangent))])


@dataclass
class _Arcs(Curves[_Nodes]):
    """Configuration curves in one sense each."""

    tests = Verification()
    smallest_step = 1e-12
    same = SAME
    most_nodes = 100_000

    closure: Closure
    limits: tuple[_Limit, ...]

    def exhaust(self, rows: Indices) -> None:
        """End curves at crossings."""
        flat = self.at.reciprocal_condition[rows] < SINGULAR
        self.end[rows[flat]] = Status.AT_SINGULARITY

    def allowed(self, rows: Indices, step: Floats) -> Floats:
        """Return the steps (k,) that the curvature allows."""
        bend = np.linalg.norm(self.at.bends[rows], axis=1)
        largest = np.minimum(self.largest, LARGEST_TURN / (bend + 1e-300))
        return np.minimum(step, largest)

    def steps_to(
        self, rows: Indices, at: _Nodes, ways: Floats
    ) -> tuple[_Nodes, Bools, Floats]:
        """See `Curves`, as the further methods."""
        closure = self.closure.take(np.repeat(rows, 2))
        parts = ways[:, None] * STEP_PARTS
        guess = taylor(at.values, at.tangents, at.bends, parts)
        borders = np.repeat(at.tangents, 2, axis=0)
        targets = np.sum(at.tangents * at.values, axis=1)[:, None] + parts
        values, steps = correct(closure, guess, borders, targets.ravel())
        good = all_finite(values, 1)
        good &= self.tests.corrected(steps.first, steps.ratio, np.repeat(ways, 2))
        values[~good] = np.repeat(at.values, 2, axis=0)[~good]
        points, there = curve_points(closure, values, borders)
        good &= points.residual < CLOSURE_TOLERANCE
        change = bordered(there.jacobian, borders) - np.repeat(at.equations, 2, axis=0)
        inverse = np.repeat(at.inverse, 2, axis=0)
        moved = np.linalg.norm(inverse @ change, axis=(1, 2))
        good &= self.tests.regular(moved, np.sum(points.tangents * borders, axis=1))
        ends = slice(1, None, 2)
        last = _Nodes.of(there.take(ends), points.rows(ends))
        rounding = 8.0 * EPS / at.reciprocal_condition
        holds = self.judged(at, last, values[::2], ways, good, rounding)
        return last, holds, np.max(moved.reshape(-1, 2), axis=1)

    def within(self, rows: Indices, step: Floats, new: _Nodes, holds: Bools) -> Bools:
        """Take steps that pass no limit, and land on one that another passes."""
        taken = holds.copy()
        for limit in self.limits:
            taken &= ~(limit.of(new)[0] < 0.0)
        landing = ~taken & (self.end[rows] == GOING)
        for k in np.flatnonzero(landing) if self.limits else ():
            row = rows[k : k + 1]
            landed = self._landing(row, self.at.rows(row), float(step[k]))
            if landed is not None:
                self.reach(row, landed[0])
                self.end[row] = landed[1].status
        return taken

    def _landing(
        self, row: Indices, at: _Nodes, step: float
    ) -> tuple[_Nodes, _Limit] | None:
        """Return the first limit within a step, and the node exactly on it."""
        best: tuple[_Nodes, _Limit] | None = None
        for limit in self.limits:
            (margin,), (gradient,) = limit.of(at)
            rate, bend = float(gradient @ at.tangents[0]), float(gradient @ at.bends[0])
            way = _first_root(float(margin), rate, 0.5 * bend)
            if way <= self.smallest_step:
                return None
            if not way <= 1.5 * step:
                continue
            guess = taylor(at.values, at.tangents, at.bends, np.array([[way]]))
            on = self._onto(self.closure.take(row), limit, guess)
            way = float(at.tangents[0] @ (on - at.values)[0])
            if not 0.0 < way <= step:
                continue
            made, (holds,), _ = self.steps_to(row, at, np.array([way]))
            if holds and max_abs(made.values - on) < SAME:
                best, step = (made, limit), way
        return best

    def _onto(self, closure: Closure, limit: _Limit, start: Floats) -> Floats:
        """Return the closed configuration (1, variables) on a limit, by Newton's method."""

        def change(values: Floats, _: Indices) -> Floats:
            at = closure.at(values)
            bends = at.states.curvatures, at.states.curvature_rates
            margin, gradient = limit.margin(values, *bends)
            return bordered_step(at, gradient, -margin)

        values, _ = newton(change, start, 12, 1e-14)
        return values

    def stop(self, row: int) -> None:
        """End a curve at its last node, by what lies beyond."""
        at = self.at.rows(slice(row, row + 1))
        flat = at.reciprocal_condition[0] < NEARLY_FLAT
        self.end[row] = Status.AT_SINGULARITY if flat else Status.MODE_LOST
        for limit in reversed(self.limits):
            if limit.of(at)[0] < NEARLY_THERE:
                self.end[row] = limit.status


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
