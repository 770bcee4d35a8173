"""Following the configuration curve in its own arc length, step by safe step.

A step is predicted with exact
first and second derivatives and corrected in the hyperplane normal to the tangent. Two
curves that pass each other closely have bordered Jacobians of opposite orientation there,
so that the test of their change keeps them apart.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_segment import (
    CurvePoints,
    bordered,
    bordered_condition,
    bordered_step,
    correct,
    curve_points,
)
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, newton
from spherekit.positions.path_continuation import (
    NEARLY_THERE,
    STEP_PARTS,
    Curves,
    Limits,
    Verification,
    taylor,
)
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS

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


@dataclass(frozen=True)
class _Nodes(CurvePoints):
    """Points with their equations (n, 3 loops + 1, variables), bordered by the tangents.

    `inverse` and `reciprocal_condition` (n,) are those of the equations; `margins`
    (n, limits) say how far limits are, `approach` by how much they decrease along the
    curve.
    """

    equations: Floats
    inverse: Floats
    reciprocal_condition: Floats
    margins: Floats
    approach: Floats

    @staticmethod
    def of(
        at: Linearisation,
        points: CurvePoints,
        limits: Limits,
        some: slice = slice(None),
    ) -> "_Nodes":
        """Return the nodes at some of points, the closure `at` these."""
        points = points.rows(some)
        equations = bordered(at.jacobian[some], points.tangents)
        inverse = left_inverse(equations)
        bends = at.states.curvatures[some], at.states.curvature_rates[some]
        margins, gradients = limits.margins(points.values, *bends)
        return _Nodes(
            **vars(points),
            equations=equations,
            inverse=inverse,
            reciprocal_condition=bordered_condition(equations, inverse),
            margins=margins,
            approach=-np.einsum("nlv,nv->nl", gradients, points.tangents),
        )


def follow_arc(
    closure: Closure,
    values: Floats,
    stops: Mapping[int, tuple[float, float]] | None = None,
    longest: float = LONGEST,
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

    Raises
    ------
    SolveError
        If the configuration does not close, does not move, is beyond a limit, or is a
        singular one.
    """
    limits = Limits.of(closure, stops or {})
    start = _started(closure, np.asarray(values, dtype=float), limits)
    return _followed(closure, [start], limits, longest)[0]


def follow_arcs(closure: Closure, starts: Floats, longest: float) -> list[ArcCurve | None]:
    """Return the curves through configurations (n, variables), side by side.

    What is locked is so at values of each. None where `follow_arc` raises an error.
    """
    curves: list[ArcCurve | None] = [None] * len(starts)
    limits, begun = Limits.of(closure, {}), dict[int, _Nodes]()
    for number, values in enumerate(starts):
        with suppress(SolveError):
            begun[number] = _started(closure.take(np.array([number])), values, limits)
    those = closure.take(np.array([*begun], dtype=np.intp))
    made = _followed(those, list(begun.values()), limits, longest)
    for number, curve in zip(begun, made, strict=True):
        curves[number] = curve
    return curves


def _followed(
    closure: Closure,
    starts: Sequence[_Nodes],
    limits: Limits,
    longest: float,
) -> list[ArcCurve]:
    """Return the curves through nodes, in both senses where they do not close."""
    if not starts:
        return []
    start, periods = _Nodes.joined(starts), variable_periods(closure)
    back = replace(start.plain, tangents=-start.tangents)
    turned = _Nodes.of(closure.at(start.values), back, limits)
    ahead = _Arcs(start, periods, longest, LARGEST_STEP, closure, limits)
    ahead.follow(FIRST_STEP)
    left = np.flatnonzero(~ahead.closed)
    given = periods, longest, LARGEST_STEP, closure.take(left), limits
    behind = _Arcs(turned.rows(left), *given)
    behind.follow(FIRST_STEP)
    place = {row: k for k, row in enumerate(left.tolist())}
    return [_curve(ahead, behind, row, place.get(row)) for row in range(len(starts))]


def _curve(ahead: "_Arcs", behind: "_Arcs", row: int, other: int | None) -> ArcCurve:
    """Return the curve of a row that was followed in both senses."""
    nodes, ends = ahead.nodes_of(row).plain, (Status.OK, Status.OK)
    closed = other is None or bool(behind.closed[other])
    if other is not None:
        back = behind.nodes_of(other).plain
        if not closed:
            back = CurvePoints.joined([back.reversed.rows(slice(-1)), nodes])
            ends = Status(behind.end[other]), Status(ahead.end[row])
        nodes = back
    if len(nodes.values) == 1:
        raise SolveError(
            "the configuration to follow has its limits on both sides; widen the "
            "joint limits"
        )
    return ArcCurve(nodes, ahead.closure.take(np.array([row])), ahead.periods, closed, ends)


def _started(closure: Closure, values: Floats, limits: Limits) -> _Nodes:
    """Return the node of a configuration (variables,), after closing it exactly."""
    if not all_finite(values):
        raise SolveError("the configuration to follow has to be finite, but is not")
    gap = float(closure.at(values[None]).gap[0])
    if not gap < CLOSED_START:
        raise SolveError(
            f"the configuration to follow does not close: its residual is {gap:.3g} rad, "
            f"but at most {CLOSED_START:g} is allowed; start from one that was solved for"
        )
    values, border = values[None], _motion(closure, values)[None]
    values, _ = correct(closure, values, border, np.vecdot(border, values))
    points, at = curve_points(closure, values, border)
    node = _Nodes.of(at, points, limits)
    if not node.reciprocal_condition[0] > SINGULAR:
        raise SolveError(SINGULAR_START)
    for number, margin in enumerate(node.margins[0]):
        if margin < -CLOSURE_TOLERANCE:
            raise SolveError(
                f"the configuration to follow is {-margin:.3g} beyond "
                f"{limits.words(number)}; start from one within its limits"
            )
    return node


def _motion(closure: Closure, values: Floats) -> Floats:
    """Return the unit vector (variables,) of the only motion, its largest part positive."""
    _, sizes, right = np.linalg.svd(closure.at(values[None]).jacobian[0])
    sizes = np.append(sizes, np.zeros(len(right) - len(sizes)))
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
    limits: Limits

    def exhaust(self, rows: Indices) -> None:
        """End curves at crossings, and at limits that they come to."""
        flat = self.at.reciprocal_condition[rows] < SINGULAR
        self.end[rows[flat]] = Status.AT_SINGULARITY
        comes = (self.at.margins[rows] < NEARLY_THERE) & (self.at.approach[rows] > 0.0)
        for k in np.flatnonzero(np.any(comes, axis=1) & ~flat):
            margins = np.where(comes[k], self.at.margins[rows[k]], np.inf)
            self._land(rows[k : k + 1], int(np.argmin(margins)))

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
        targets = np.vecdot(at.tangents, at.values)[:, None] + parts
        values, steps = correct(closure, guess, borders, targets.ravel())
        good = all_finite(values, 1)
        good &= self.tests.corrected(steps, np.repeat(ways, 2))
        values[~good] = np.repeat(at.values, 2, axis=0)[~good]
        points, there = curve_points(closure, values, borders)
        good &= points.residual < CLOSURE_TOLERANCE
        change = bordered(there.jacobian, borders) - np.repeat(at.equations, 2, axis=0)
        moved = np.linalg.norm(np.repeat(at.inverse, 2, axis=0) @ change, axis=(1, 2))
        good &= self.tests.regular(moved, np.vecdot(points.tangents, borders))
        last = _Nodes.of(there, points, self.limits, slice(1, None, 2))
        rounding = 8.0 * EPS / at.reciprocal_condition
        holds = self.judged(at, last, values[::2], ways, good, rounding)
        return last, holds, np.max(moved.reshape(-1, 2), axis=1)

    def within(self, rows: Indices, step: Floats, new: _Nodes, holds: Bools) -> Bools:
        """Take steps that pass no limit."""
        return holds & np.all(new.margins >= 0.0, axis=1)

    def _land(self, row: Indices, number: int) -> None:
        """End a curve (1,) on a limit beside its last node, if it comes to it."""
        at, closure = self.at.rows(row), self.closure.take(row)
        if at.margins[0, number] > CLOSURE_TOLERANCE:

            def change(values: Floats, _: Indices) -> Floats:
                there = closure.at(values)
                bends = there.states.curvatures, there.states.curvature_rates
                margins, gradients = self.limits.margins(values, *bends)
                return bordered_step(there, gradients[:, number], -margins[:, number])

            on, _ = newton(change, at.values, 12, 1e-14)
            way = np.sum(at.tangents * (on - at.values), axis=1)
            made, (holds,), _ = self.steps_to(row, at, way)
            if not (way[0] > 0.0 and holds and max_abs(made.values - on) < SAME):
                return
            self.reach(row, made)
        self.end[row] = self.limits.statuses[number]

    def stop(self, row: int) -> None:
        """End a curve at its last node, by what lies beyond."""
        flat = self.at.reciprocal_condition[row] < NEARLY_FLAT
        self.end[row] = Status.AT_SINGULARITY if flat else Status.MODE_LOST
        for number in np.flatnonzero(self.at.margins[row] < NEARLY_THERE)[:1]:
            self.end[row] = self.limits.statuses[number]
