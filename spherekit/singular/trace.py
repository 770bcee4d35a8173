"""Following a curve of singular configurations, step by verified step.

The path is a `spherekit.motion.curve_path.CurvePath`, its bend that of the last step.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.budget import Budget
from spherekit.conventions import Status
from spherekit.motion.arc_length import periods_of
from spherekit.motion.continuation import Verification
from spherekit.motion.curve_path import STEP_PARTS, CurvePath, taylor
from spherekit.singular.curve import SingularCurve, predict
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

LARGEST_STEP = 0.3
"""Longest step (rad of arc length)."""
FREEDOMS = 2
"""Loci of mechanisms with so many are curves."""
NEARLY_FLAT = 1e-3
"""Equations of this reciprocal condition at a node that no step leaves are a crossing."""
SAME_MOTION = 0.8
"""Least cosine between the singular motions where a lap ends and starts."""


def trace_curve(
    locus: Locus,
    values: Floats,
    longest: float = 200.0,
    step: float = LARGEST_STEP,
    budget: Budget | None = None,
) -> SingularCurve | None:
    """Return the curve of a locus through a configuration (V,) near it.

    Parameters
    ----------
    locus
        Singular configurations of a mechanism with two freedoms.
    values
        Where to start; Newton's method leads onto the curve.
    longest, step
        Length (rad) after which a curve that does not close is ended in each sense, and
        the longest step.
    budget
        Time after which the curve is ended, MODE_LOST, unlimited by default.

    None if Newton's method does not arrive, or only at a crossing of curves.
    """
    start = locus.onto(values[None])
    if not start.good[0] or start.reciprocal_condition[0] < NEARLY_FLAT:
        return None
    start = locus.correct(
        start.values,
        start.motions,
        np.swapaxes(start.tangents, 1, 2),
        np.einsum("nvk,nv->nk", start.tangents, start.values),
    )
    periods = periods_of(locus.closure)
    ways: list[list[LocusPoints]] = []
    ends: list[Status] = []
    still = np.zeros_like(start.values[0])
    for first in (start, _reversed(start)):
        begin = _Node(first, still)
        path = _LocusPath(begin, periods, longest, step, locus, budget or Budget())
        nodes = [node.point for node in path.run(0.05).nodes]
        if path.closed:
            joined = LocusPoints.joined([first, *nodes])
            return SingularCurve(locus, joined, periods, True, (Status.OK, Status.OK))
        ways.append(nodes)
        ends.append(path.end or Status.OK)
    behind = [_reversed(node) for node in reversed(ways[1])]
    joined = LocusPoints.joined([*behind, start, *ways[0]])
    if len(joined) < 2:
        return None
    return SingularCurve(locus, joined, periods, False, (ends[1], ends[0]))


def _reversed(node: LocusPoints) -> LocusPoints:
    return replace(node, tangents=-node.tangents, turns=-node.turns)


def _bordered(node: LocusPoints, tangent: Floats) -> Floats:
    """Return the equations of one point with a border along a tangent (V,)."""
    border = tangent @ node.basis[0]
    border[FREEDOMS:] = 0.0
    return np.concatenate([node.equations[0], border[None]])


@final
@dataclass(frozen=True)
class _Node:
    """One point of the curve, and the bend of the last step."""

    point: LocusPoints
    bend: Floats

    @property
    def values(self) -> Floats:
        return np.asarray(self.point.values[0])

    @property
    def tangent(self) -> Floats:
        return np.asarray(self.point.tangents[0, :, 0])


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

    def exhausted(self) -> Status | None:
        """Return MODE_LOST where the time is over."""
        goes_on = self.budget.goes_on("the rest of a singular curve")
        return None if goes_on else Status.MODE_LOST

    def step_to(self, at: _Node, way: float) -> tuple[_Node, float] | None:
        """Return the node at this projection on the tangent if it passes all tests."""
        tests, parts, point = self.verification, way * STEP_PARTS, at.point
        points = self.locus.correct(
            taylor(at, parts),
            point.motions + parts[:, None] * point.turns[0, :, 0],
            np.stack([at.tangent, at.tangent])[:, None],
            (float(at.tangent @ at.values) + parts)[:, None],
            point.basis[0],
        )
        if not np.all(points.good):
            return None
        if not np.all(tests.corrected(points.first_step, points.ratio, way)):
            return None
        turned = np.einsum("nv,v->n", points.tangents[:, :, 0], at.tangent)
        flip = np.sign(turned)[:, None, None]
        points.tangents[:] *= flip
        points.turns[:] *= flip
        before = _bordered(point, at.tangent)
        inverse = np.linalg.pinv(before)
        moved = [
            float(
                np.linalg.norm(
                    inverse @ (_bordered(points.rows(slice(k, k + 1)), at.tangent) - before)
                )
            )
            for k in (0, 1)
        ]
        if not tests.regular(np.array(moved), np.abs(turned)):
            return None
        last = points.rows(slice(1, 2))
        both = LocusPoints.joined([point, last])
        chord = last.values[0] - at.values
        part = (points.values[0] - at.values) @ chord / (chord @ chord)
        middle, _ = predict(both, np.zeros(1, dtype=np.intp), np.array([part]))
        miss = float(np.max(np.abs(middle[0] - points.values[0])))
        if not tests.predicted(miss, way, tests.slack):
            return None
        bend = (last.tangents[0, :, 0] - at.tangent) / float(np.linalg.norm(chord))
        return _Node(last, bend), max(moved)

    def again(self, at: _Node, values: Floats) -> _Node | None:
        """Return the start at values whole periods on, with the same singular motion."""
        start = self.start.point
        cosine = float(start.motions[0] @ at.point.motions[0])
        if abs(cosine) < SAME_MOTION:
            return None
        sense = float(np.sign(cosine))
        point = replace(
            start,
            values=values[None],
            motions=sense * start.motions,
            turns=sense * start.turns,
        )
        return _Node(point, self.start.bend)

    def within(self, step: float, node: _Node | None) -> bool:
        """Return whether there is a node, and on the profiles; end the curve where not."""
        if node is None:
            return False
        inside = bool(np.all(self.locus.closure.at(node.values[None]).states.inside))
        if not inside:
            self.end = Status.OFF_PROFILE
        return inside

    def beyond(self) -> Status:
        """Return AT_SINGULARITY beside a crossing of curves of the locus."""
        flat = self.at.point.reciprocal_condition[0] < NEARLY_FLAT
        return Status.AT_SINGULARITY if flat else Status.MODE_LOST
