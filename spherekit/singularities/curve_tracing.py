"""A curve of singular configurations followed by verified steps.

The bend of a node is that of the last step.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.completeness import TimeLimit
from spherekit.positions.curve_segment import CurvePoints
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.path_continuation import (
    GOING,
    STEP_PARTS,
    Curves,
    Verification,
    taylor,
)
from spherekit.singularities.singular_curve import SingularCurve, _plain, _turned
from spherekit.singularities.slices import LocusPoints, SingularityLocus
from spherekit.status import Status

LARGEST_STEP = 0.3
"""Longest step (rad of arc length)."""


LONGEST = 200.0
"""Length (rad) after which a curve that does not close is ended in each sense."""


FREEDOMS = 2
"""Loci of mechanisms with so many are curves."""


FIRST_STEP = 0.05
"""The first step that is tried (rad)."""


NEARLY_FLAT = 1e-3
"""Equations of this reciprocal condition at a node that no step leaves are a crossing."""


SAME_MOTION = 0.8
"""Least cosine between the singular motions where a lap ends and starts."""


def trace_curves(
    locus: SingularityLocus, starts: LocusPoints, budget: TimeLimit | None = None
) -> list[SingularCurve | None]:
    """Return the curves of a locus through points of it, side by side.

    Of singular configurations of a mechanism with two freedoms. Curves are ended,
    MODE_LOST, when the time is over, unlimited by default. None where no step holds.
    """
    count = len(starts)
    both = LocusPoints.joined([starts, _turned(starts, -1.0)])
    still = np.zeros(both.values.shape)
    start = _Nodes(both.values, both.tangents[:, :, 0], still, both.residual, both)
    given = (
        variable_periods(locus.closure),
        LONGEST,
        LARGEST_STEP,
        locus,
        budget or TimeLimit(),
    )
    paths = _LocusCurves(start, *given)
    paths.follow(FIRST_STEP)
    return [paths.curve(number, count + number) for number in range(count)]


@dataclass(frozen=True)
class _Nodes(CurvePoints):
    """Points, tangents in the sense of the path, bends of the last step, or none."""

    point: LocusPoints


def _bordered(points: LocusPoints, tangents: Floats) -> Floats:
    """Return the equations of points with borders along tangents (n, V)."""
    border = np.einsum("nv,nvg->ng", tangents, points.basis)
    border[:, FREEDOMS:] = 0.0
    return np.concatenate([points.equations, border[:, None]], axis=1)


@dataclass
class _LocusCurves(Curves[_Nodes]):
    """Curves of a locus: in one sense in the first half, in the other in the second."""

    tests = Verification(slack=1e-9, settled=1e-6, middle=1e-3)
    smallest_step = 2e-6
    same = 1e-8
    most_nodes = 20_000

    locus: SingularityLocus
    budget: TimeLimit

    def exhaust(self, rows: Indices) -> None:
        """End curves that have closed in the other sense, and all when time is over."""
        half = len(self.end) // 2
        second = rows[rows >= half]
        self.end[second[self.closed[second - half]]] = Status.OK
        left = rows[self.end[rows] == GOING]
        if len(left) and not self.budget.goes_on("the rest of a singular curve"):
            self.end[left] = Status.MODE_LOST

    def steps_to(
        self, rows: Indices, at: _Nodes, ways: Floats
    ) -> tuple[_Nodes, Bools, Floats]:
        """See `Curves`, as the further methods."""
        here, tangents = at.point, at.tangents
        parts = ways[:, None] * STEP_PARTS
        borders = np.repeat(tangents, 2, axis=0)
        turns = here.turns[:, :, 0]
        targets = np.vecdot(tangents, here.values)[:, None] + parts
        points = self.locus.correct(
            taylor(here.values, tangents, at.bends, parts),
            taylor(here.motions, turns, np.zeros_like(turns), parts),
            borders[:, None],
            targets.reshape(-1, 1),
            np.repeat(here.basis, 2, axis=0),
        )
        # A step is one of the motion too, which turns fast where curves pass each other.
        sizes = ways * np.hypot(1.0, np.linalg.norm(turns, axis=1))
        good = points.good & self.tests.corrected(
            (points.first_step, points.ratio), np.repeat(sizes, 2)
        )
        along = np.vecdot(points.tangents[:, :, 0], borders)
        points = _turned(points, np.sign(along))
        before = np.repeat(_bordered(here, tangents), 2, axis=0)
        change = np.linalg.pinv(before) @ (_bordered(points, borders) - before)
        moved = np.linalg.norm(change, axis=(1, 2))
        good &= self.tests.regular(moved, np.abs(along))
        last = points.rows(slice(1, None, 2))
        ahead = last.tangents[:, :, 0]
        middles, slack = points.values[::2], self.tests.slack
        holds = self.judged(_plain(here), _plain(last), middles, ways, good, slack)
        length = np.linalg.norm(last.values - here.values, axis=1, keepdims=True)
        bends = (ahead - tangents) / length
        new = _Nodes(last.values, ahead, bends, last.residual, last)
        return new, holds, np.max(moved.reshape(-1, 2), axis=1)

    def again(self, start: _Nodes, at: _Nodes, values: Floats) -> _Nodes:
        """Return starts with the sense of the singular motion here, where it is that."""
        cosine = np.vecdot(start.point.motions, at.point.motions)[:, None]
        sense = np.where(np.abs(cosine) < SAME_MOTION, np.nan, np.sign(cosine))
        point = replace(
            start.point,
            values=sense**2 * values,
            motions=sense * start.point.motions,
            turns=sense[:, None] * start.point.turns,
        )
        return replace(start, values=point.values, point=point)

    def within(self, rows: Indices, step: Floats, new: _Nodes, holds: Bools) -> Bools:
        """End curves that leave a profile."""
        inside = holds.copy()
        inside[holds] = np.all(
            self.locus.closure.at(new.values[holds]).states.inside, axis=1
        )
        self.end[rows[holds & ~inside]] = Status.OFF_PROFILE
        return inside

    def stop(self, row: int) -> None:
        """End a curve at its last node: at a singularity beside a crossing of curves."""
        flat = self.at.point.reciprocal_condition[row] < NEARLY_FLAT
        self.end[row] = Status.AT_SINGULARITY if flat else Status.MODE_LOST

    def curve(self, ahead: int, behind: int) -> SingularCurve | None:
        """Return the curve that was followed in both senses; None where no step holds."""
        for row in (ahead, behind):
            if self.closed[row]:
                points = self.nodes_of(row).point
                ends = (Status.OK, Status.OK)
                return SingularCurve(self.locus, points, self.periods, True, ends)
        back = self.nodes_of(behind).point.rows(slice(None, 0, -1))
        points = LocusPoints.joined([_turned(back, -1.0), self.nodes_of(ahead).point])
        if len(points) < 2:
            return None
        ends = Status(self.end[behind]), Status(self.end[ahead])
        return SingularCurve(self.locus, points, self.periods, False, ends)
