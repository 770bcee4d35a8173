"""Following a curve of singular configurations, step by verified step.

The path is a `spherekit.motion.continuation.CurvePath`, its bend that of the last step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.budget import Budget
from spherekit.conventions import Status
from spherekit.motion.arc_length import periods_of
from spherekit.motion.continuation import (
    STEP_PARTS,
    CurvePath,
    Verification,
    run_each,
    taylor,
)
from spherekit.singular.curve import SingularCurve, predict
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

LARGEST_STEP = 0.3
"""Longest step (rad of arc length)."""
FREEDOMS = 2
"""Loci of mechanisms with so many are curves."""
FIRST_STEP = 0.05
"""The first step that is tried (rad)."""
NEARLY_FLAT = 1e-3
"""Equations of this reciprocal condition at a node that no step leaves are a crossing."""
SAME_MOTION = 0.8
"""Least cosine between the singular motions where a lap ends and starts."""


def trace_curves(
    locus: Locus,
    values: Floats,
    longest: float = 200.0,
    step: float = LARGEST_STEP,
    budget: Budget | None = None,
) -> list[SingularCurve | None]:
    """Return the curves of a locus through configurations (n, V) near it, side by side.

    Parameters
    ----------
    locus
        Singular configurations of a mechanism with two freedoms.
    values
        Where to start; Newton's method leads onto the curves.
    longest, step
        Length (rad) after which a curve that does not close is ended in each sense, and
        the longest step.
    budget
        Time after which curves are ended, MODE_LOST, unlimited by default.

    None where Newton's method does not arrive, or only at a crossing of curves.
    """
    near = locus.onto(values)
    (rows,) = np.nonzero(near.good & ~(near.reciprocal_condition < NEARLY_FLAT))
    near = near.rows(rows)
    starts = locus.correct(
        near.values,
        near.motions,
        np.swapaxes(near.tangents, 1, 2),
        np.einsum("nvk,nv->nk", near.tangents, near.values),
    )
    periods = periods_of(locus.closure)
    budget = budget or Budget()
    still = np.zeros(len(periods))
    ahead, behind = (
        [
            _LocusPath(
                _Node(_turned(starts.rows(slice(row, row + 1)), sense), still),
                periods,
                longest,
                step,
                locus,
                budget,
            )
            for row in range(len(rows))
        ]
        for sense in (1.0, -1.0)
    )
    for one, other in zip(ahead, behind, strict=True):
        other.twin = one
    run_each([*ahead, *behind], FIRST_STEP)
    curves: list[SingularCurve | None] = [None] * len(values)
    for row, one, other in zip(rows.tolist(), ahead, behind, strict=True):
        curves[row] = _curve(one, other)
    return curves


def _curve(ahead: "_LocusPath", behind: "_LocusPath") -> SingularCurve | None:
    """Return the curve that was followed in both senses; None where no step holds."""
    locus, periods = ahead.locus, ahead.periods
    for path in (ahead, behind):
        if path.closed:
            points = _points([path.start, *path.nodes])
            return SingularCurve(locus, points, periods, True, (Status.OK, Status.OK))
    back = [_turned(node.point, -1.0) for node in reversed(behind.nodes)]
    points = LocusPoints.joined([*back, _points([ahead.start, *ahead.nodes])])
    if len(points) < 2:
        return None
    ends = (behind.end or Status.OK, ahead.end or Status.OK)
    return SingularCurve(locus, points, periods, False, ends)


@final
@dataclass(frozen=True)
class _Node:
    """A point, its tangent in the sense of the path, and the bend of the last step."""

    point: LocusPoints
    bend: Floats
    inside: bool = True

    @property
    def values(self) -> Floats:
        return np.asarray(self.point.values[0])

    @property
    def tangent(self) -> Floats:
        return self.point.tangents[0, :, 0]


def _points(nodes: Sequence[_Node]) -> LocusPoints:
    return LocusPoints.joined([node.point for node in nodes])


def _turned(points: LocusPoints, sense: Floats | float) -> LocusPoints:
    """Return points with their tangents turned round where the sense (n,) is -1."""
    sense = np.reshape(sense, (-1, 1, 1))
    return replace(points, tangents=sense * points.tangents, turns=sense * points.turns)


def _bordered(points: LocusPoints, tangents: Floats) -> Floats:
    """Return the equations of points with borders along tangents (n, V)."""
    border = np.einsum("nv,nvg->ng", tangents, points.basis)
    border[:, FREEDOMS:] = 0.0
    return np.concatenate([points.equations, border[:, None]], axis=1)


@final
@dataclass
class _LocusPath(CurvePath[_Node]):
    """One sense of a curve of a locus."""

    verification = Verification(slack=1e-9, settled=1e-6, middle=1e-3)
    smallest_step = 2e-6
    same = 1e-8
    most_nodes = 20_000

    locus: Locus
    budget: Budget
    twin: "_LocusPath | None" = None

    def exhausted(self) -> Status | None:
        """Return MODE_LOST where the time is over, OK where the other sense has closed."""
        if self.twin is not None and self.twin.closed:
            return Status.OK
        goes_on = self.budget.goes_on("the rest of a singular curve")
        return None if goes_on else Status.MODE_LOST

    @staticmethod
    def steps_to(
        paths: "Sequence[CurvePath[_Node]]", ats: Sequence[_Node], ways: Floats
    ) -> list[tuple[_Node, float] | None]:
        """Return the nodes at projections (n,) on the tangents that pass all tests."""
        tests = _LocusPath.verification
        assert isinstance(paths[0], _LocusPath)
        locus = paths[0].locus
        here = _points(ats)
        tangents = here.tangents[:, :, 0]
        parts = ways[:, None] * STEP_PARTS
        borders = np.repeat(tangents, 2, axis=0)
        bends = np.array([at.bend for at in ats])
        turns = here.turns[:, :, 0]
        targets = np.sum(tangents * here.values, axis=1)[:, None] + parts
        points = locus.correct(
            taylor(here.values, tangents, bends, parts),
            taylor(here.motions, turns, np.zeros_like(turns), parts),
            borders[:, None],
            targets.reshape(-1, 1),
            np.repeat(here.basis, 2, axis=0),
        )
        # A step is one of the motion too, which turns fast where curves pass each other.
        sizes = ways * np.hypot(1.0, np.linalg.norm(turns, axis=1))
        good = points.good & tests.corrected(
            points.first_step, points.ratio, np.repeat(sizes, 2)
        )
        along = np.sum(points.tangents[:, :, 0] * borders, axis=1)
        points = _turned(points, np.sign(along))
        before = np.repeat(_bordered(here, tangents), 2, axis=0)
        change = np.linalg.pinv(before) @ (_bordered(points, borders) - before)
        moved = np.linalg.norm(change, axis=(1, 2))
        good &= tests.regular(moved, np.abs(along))
        holds = np.all(good.reshape(-1, 2), axis=1)
        last, middles = points.rows(slice(1, None, 2)), points.values[::2]
        (some,) = np.nonzero(holds)
        both = LocusPoints.joined([here.rows(some), last.rows(some)])
        order = np.arange(2 * len(some)).reshape(2, -1).T.ravel()
        chord = last.values - here.values
        length = np.linalg.norm(chord, axis=1)
        part = np.sum((middles - here.values) * chord, axis=1) / length**2
        guess, _ = predict(both.rows(order), 2 * np.arange(len(some)), part[some])
        wrong = np.max(np.abs(guess - middles[some]), axis=1, initial=0.0)
        holds[some] = tests.predicted(wrong, ways[some], tests.slack)
        bends = (last.tangents[:, :, 0] - tangents) / length[:, None]
        inside = np.all(locus.closure.at(last.values[holds]).states.inside, axis=1)
        most = np.max(moved.reshape(-1, 2), axis=1)
        steps: list[tuple[_Node, float] | None] = [None] * len(ats)
        for row, within in zip(
            np.flatnonzero(holds).tolist(), inside.tolist(), strict=True
        ):
            node = _Node(last.rows(slice(row, row + 1)), bends[row], within)
            steps[row] = node, float(most[row])
        return steps

    def again(self, at: _Node, values: Floats) -> _Node | None:
        """Return the start at values whole periods on, with the same singular motion."""
        start = self.start.point
        cosine = float(start.motions[0] @ at.point.motions[0])
        if abs(cosine) < SAME_MOTION:
            return None
        sense = np.sign(cosine)
        point = replace(
            start,
            values=values[None],
            motions=sense * start.motions,
            turns=sense * start.turns,
        )
        return _Node(point, self.start.bend)

    def within(self, step: float, node: _Node | None) -> bool:
        """Return whether there is a node, and on the profiles; end the curve where not."""
        if node is not None and not node.inside:
            self.end = Status.OFF_PROFILE
        return node is not None and node.inside

    def beyond(self) -> Status:
        """Return AT_SINGULARITY beside a crossing of curves of the locus."""
        flat = self.at.point.reciprocal_condition[0] < NEARLY_FLAT
        return Status.AT_SINGULARITY if flat else Status.MODE_LOST
