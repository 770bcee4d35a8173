"""Following a curve of singular configurations, step by verified step.

A step is accepted if the prediction was nearly right at its middle and its end, Newton's
method contracted at once, the tangent turned little, the equations bordered by the
tangent changed by less than would make them singular, and the polynomial through both
ends predicts the middle. Otherwise it is halved.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.budget import Budget
from spherekit.conventions import Status
from spherekit.motion.arc_length import periods_of
from spherekit.singular.curve import SingularCurve, predict
from spherekit.singular.locus import ON_LOCUS, Locus, LocusPoints
from spherekit.sphere.rotation import Floats

LARGEST_STEP = 0.3
"""Longest step (rad of arc length)."""
LARGEST_CHANGE = 0.6
"""Change of the bordered equations in one step, relative; at 1 they may be singular."""
LARGEST_CORRECTION = 0.05
"""A prediction may be wrong by this part of the step."""
LARGEST_MIDDLE = 1e-3
"""The prediction of the middle from both ends may be wrong by this part of the step."""
SMALLEST_STEP = 1e-6
"""A step below this (rad) ends the curve."""
NEARLY_FLAT = 1e-3
"""Equations of this reciprocal condition at a node that no step leaves are a crossing."""
NEARLY_THERE = 1e-6
SAME = 1e-8
"""A lap ends where it started to this (rad)."""
MOST_NODES = 20_000


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
        Time after which the curve is ended, BRANCH_LOST, unlimited by default.

    None if Newton's method does not arrive, or only at a crossing of curves.
    """
    start = locus.onto(values[None])
    if not start.good[0] or start.flatness[0] < NEARLY_FLAT:
        return None
    start = locus.correct(
        start.values,
        start.motions,
        np.swapaxes(start.tangents, 1, 2),
        np.einsum("nvk,nv->nk", start.tangents, start.values),
    )
    periods = periods_of(locus.closure)
    march = _March(locus, periods, longest, step, budget or Budget())
    ways: list[list[LocusPoints]] = []
    ends: list[Status] = []
    for first in (start, _reversed(start)):
        nodes, why, closes = march.run(first)
        if closes:
            joined = LocusPoints.joined([first, *nodes])
            return SingularCurve(locus, joined, periods, True, (Status.OK, Status.OK))
        ways.append(nodes)
        ends.append(why)
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
    low = np.concatenate([border, np.zeros_like(border)])
    return np.concatenate([node.equations[0], low[None]])


@final
@dataclass(frozen=True)
class _March:
    locus: Locus
    periods: Floats
    longest: float
    step: float
    budget: Budget

    def run(self, start: LocusPoints) -> tuple[list[LocusPoints], Status, bool]:
        """Return nodes after the start, why they end, and whether they close."""
        nodes: list[LocusPoints] = []
        at, step, way = start, 0.05, 0.0
        bend = np.zeros_like(start.values[0])
        while way < self.longest and len(nodes) < MOST_NODES:
            if not self.budget.goes_on("the rest of a singular curve"):
                break
            step = min(step, self.step)
            made = self._advance(at, bend, step)
            if made is None:
                step *= 0.5
                if step < SMALLEST_STEP:
                    flat = at.flatness[0] < NEARLY_FLAT
                    why = Status.AT_SINGULARITY if flat else Status.BRANCH_LOST
                    return nodes, why, False
                continue
            node, change = made
            if not self._inside(node):
                return nodes, Status.OFF_PROFILE, False
            if way > 4.0 * NEARLY_THERE:
                end = self._closing(start, at, bend, step, node)
                if end is not None:
                    if np.max(np.abs(end.values - at.values)) < NEARLY_THERE:
                        nodes.pop()
                    return [*nodes, end], Status.OK, True
            nodes.append(node)
            moved = float(np.linalg.norm(node.values - at.values))
            bend = (node.tangents - at.tangents)[0, :, 0] / moved
            way += moved
            at = node
            step *= min(2.0, max(0.5, 0.6 * LARGEST_CHANGE / (change + 1e-300)))
        why = Status.OK if way >= self.longest else Status.BRANCH_LOST
        return nodes, why, False

    def _taylor(self, at: LocusPoints, bend: Floats, way: Floats) -> Floats:
        """Return predictions (n, V) at ways (n,) along the tangent."""
        w = way[:, None]
        return np.asarray(at.values + w * at.tangents[0, :, 0] + 0.5 * w * w * bend)

    def _advance(
        self, at: LocusPoints, bend: Floats, step: float
    ) -> tuple[LocusPoints, float] | None:
        """Return the node at this projection on the tangent if it passes all tests."""
        way = np.array([0.5, 1.0]) * step
        tangent = at.tangents[0, :, 0]
        found = self.locus.correct(
            self._taylor(at, bend, way),
            at.motions + way[:, None] * at.turns[0, :, 0],
            np.stack([tangent, tangent])[:, None],
            (float(tangent @ at.values[0]) + way)[:, None],
            at.basis[0],
        )
        if not np.all(found.good):
            return None
        if np.any(found.first_step > LARGEST_CORRECTION * abs(step) + 1e-9):
            return None
        if np.any((found.first_step > 1e-6) & (found.ratio > 0.1)):
            return None
        turned = np.einsum("nv,v->n", found.tangents[:, :, 0], tangent)
        if not np.all(np.abs(turned) > 0.9):
            return None
        flip = np.sign(turned)[:, None, None]
        found.tangents[:] *= flip
        found.turns[:] *= flip
        before = _bordered(at, tangent)
        inverse = np.linalg.pinv(before)
        moved = [
            float(
                np.linalg.norm(
                    inverse @ (_bordered(found.rows(slice(k, k + 1)), tangent) - before)
                )
            )
            for k in (0, 1)
        ]
        if not max(moved) < LARGEST_CHANGE:
            return None
        node = found.rows(slice(1, 2))
        both = LocusPoints.joined([at, node])
        chord = (node.values - at.values)[0]
        part = (found.values[0] - at.values[0]) @ chord / (chord @ chord)
        middle, _ = predict(both, np.zeros(1, dtype=np.intp), np.array([part]))
        miss = np.max(np.abs(middle[0] - found.values[0]))
        if not miss < LARGEST_MIDDLE * abs(step) + 1e-9:
            return None
        return node, max(moved)

    def _inside(self, node: LocusPoints) -> bool:
        states = self.locus.closure.at(node.values).states
        return bool(np.all(states.inside))

    def _closing(
        self,
        start: LocusPoints,
        at: LocusPoints,
        bend: Floats,
        step: float,
        new: LocusPoints,
    ) -> LocusPoints | None:
        """Return the start, some periods on, if a verified step runs through it."""
        middle = 0.5 * (at.values[0] + new.values[0])
        finite = np.where(np.isfinite(self.periods), self.periods, 0.0)
        laps = np.round((middle - start.values[0]) / self.periods)
        again = start.values[0] + laps * finite
        tangent = at.tangents[0, :, 0]
        way = float(tangent @ (again - at.values[0]))
        if not -NEARLY_THERE < way <= step or start.tangents[0, :, 0] @ tangent < 0.8:
            return None
        guess = self._taylor(at, bend, np.array([way]))[0]
        if np.max(np.abs(again - guess)) > LARGEST_CORRECTION * step:
            return None
        sense = float(np.sign(start.motions[0] @ at.motions[0]))
        if sense * float(start.motions[0] @ at.motions[0]) < 0.8:
            return None
        if abs(way) > NEARLY_THERE:
            made = self._advance(at, bend, way)
            if made is None or np.max(np.abs(made[0].values[0] - again)) > SAME:
                return None
        elif np.max(np.abs(guess - again)) > SAME + ON_LOCUS:
            return None
        return replace(
            start,
            values=again[None],
            motions=sense * start.motions,
            turns=sense * start.turns,
        )
