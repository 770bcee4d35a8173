"""All curves of singular configurations of a mechanism with two inputs.

Seeds are the singular configurations of slices with one input locked, found along whole
configuration curves, or those that random starts lead to; each that lies on no curve yet
is followed, wherever it leads, also out of the declared ranges. Type I of an orientation is
generally met at points only, which are not curves; where the output has two freedoms it is
met along curves.

Following a curve of singular configurations, step by verified step.

The bend of a node is that of the last step.

A curve of singular configurations of a mechanism with two freedoms.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.guarantee import Completeness, TimeLimit
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import NEAR, Chords, CurvePoints
from spherekit.motion.arc_length import periods_of
from spherekit.motion.steps import (
    GOING,
    STEP_PARTS,
    Curves,
    Verification,
    taylor,
)
from spherekit.numeric.crossings import bracketed_zeros
from spherekit.singular.locus import (
    LockedInputSection,
    LocusPoints,
    SingularityLocus,
    solver_of,
)
from spherekit.singular.several import (
    LocusName,
    SingularityReport,
    SingularPoints,
)
from spherekit.singular.starts import StartPoints
from spherekit.singular.stationarity import output_of
from spherekit.sphere.rotation import max_abs

GAUSS = np.polynomial.legendre.leggauss(8)
NOTHING = 1e-6
"""A function smaller than this at two nodes is taken to vanish between them."""

Along = Callable[[LocusPoints], Floats]
"""A function (n,) of points of a curve."""


@dataclass(frozen=True)
class SingularCurve:
    """A curve of a locus through verified nodes, in the arc length of the variables.

    Attributes
    ----------
    locus
        What the curve consists of.
    nodes
        The nodes in order, tangents running along; those of a closed curve end with the
        first one, its variables grown by whole periods.
    periods
        (V,) growth of each variable that changes nothing.
    closed
        Whether the curve closes.
    ends
        Why it goes no further at its start and at its end: OK if it is closed or the
        greatest length was reached, AT_SINGULARITY where curves cross, OFF_PROFILE,
        MODE_LOST.
    """

    locus: SingularityLocus
    nodes: LocusPoints
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def chord(self) -> Chords:
        """The chords between the nodes."""
        return Chords(_plain(self.nodes))

    @cached_property
    def s(self) -> Floats:
        """Arc lengths (n,) of the nodes (rad), of the Hermite polynomials through them."""
        tangents = self.nodes.tangents[:, None, :, 0]
        start = tangents[:-1]
        chord = self.chord.directions[:, None]
        places, weights = GAUSS
        x = 0.5 * (places[:, None] + 1.0)
        bent = start + tangents[1:] - 2.0 * chord
        speed = start + x * (2.0 * (chord - start - bent) + 3.0 * x * bent)
        lengths = np.linalg.norm(speed, axis=2) @ (0.5 * weights) * self.chord.chords
        return np.append(0.0, np.cumsum(lengths))

    def on(self, which: Indices, parts: Floats) -> LocusPoints:
        """Return the points whose projections divide chords `which` (n,) at parts (n,)."""
        chord, nodes, ahead = self.chord, self.nodes, which + 1
        direction = chord.directions[which]
        length = chord.chords[which]
        turning = nodes.motions[ahead] - nodes.motions[which]
        motions = nodes.motions[which] + parts[:, None] * turning
        targets = np.vecdot(direction, nodes.values[which]) + parts * length
        points = self.locus.correct(
            chord.predict(which, parts),
            motions,
            direction[:, None],
            targets[:, None],
            nodes.basis[which],
        )
        return _turned(
            points,
            np.where(np.vecdot(points.tangents[:, :, 0], direction) < 0.0, -1.0, 1.0),
        )

    def find(self, values: Floats, motions: Floats) -> Bools:
        """Return which configurations (n, V) with their singular motions are on the curve.

        Whole periods of the variables and signs of the motions do not matter.
        """
        row, which, away, along = self.chord.beside(values, self.periods)
        points = self.on(which, along / self.chord.chords[which])
        miss = max_abs((self.nodes.values[which] + away) - points.values, axis=1)
        same = np.abs(np.vecdot(points.motions, motions[row])) > 1.0 - 1e-6
        return np.isin(np.arange(len(values)), row[(miss < NEAR) & same])

    def zeros(self, function: Along) -> LocusPoints:
        """Return the points at which a function of points changes its sign.

        Those between the same two nodes are missed if they are two; a function that is
        zero to rounding has no zeros.
        """
        value = function(self.nodes)
        # Bases go on from node to node; those of the last one may be of the first.
        value[-1] = function(self.on(np.array([len(value) - 2]), np.ones(1)))[0]
        clear = np.maximum(np.abs(value[:-1]), np.abs(value[1:])) > NOTHING
        (which,) = np.nonzero(clear & ((value[:-1] >= 0.0) != (value[1:] >= 0.0)))
        part, _ = bracketed_zeros(
            lambda x, some: function(self.on(which[some], x)),
            np.zeros(len(which)),
            np.ones(len(which)),
            value[which],
            value[which + 1],
            tolerance=1e-14,
        )
        return self.on(which, part)

    def cusps(self) -> LocusPoints:
        """Return where the locus has a cusp in the plane of what stands still.

        There the singular motion runs along the curve: seen in the inputs (type II) or at
        the output (type I) the curve turns back.
        """
        if self.locus.motions < self.locus.freedoms:
            return self.nodes.rows(slice(0))

        def side(points: LocusPoints) -> Floats:
            ways = np.stack([points.motions, points.tangents[:, :, 0]], axis=2)
            return np.linalg.det(
                np.swapaxes(points.basis[:, :, self.locus.freedoms :], 1, 2) @ ways
            )

        return self.zeros(side)


def _plain(points: LocusPoints) -> CurvePoints:
    """Return what chords are made of; bends are not known."""
    tangents = points.tangents[:, :, 0]
    return CurvePoints(
        points.values, tangents, np.full_like(tangents, np.nan), points.residual
    )


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
    given = periods_of(locus.closure), LONGEST, LARGEST_STEP, locus, budget or TimeLimit()
    paths = _LocusCurves(start, *given)
    paths.follow(FIRST_STEP)
    return [paths.curve(number, count + number) for number in range(count)]


@dataclass(frozen=True)
class _Nodes(CurvePoints):
    """Points, tangents in the sense of the path, bends of the last step, or none."""

    point: LocusPoints


def _turned(points: LocusPoints, sense: Floats | float) -> LocusPoints:
    """Return points with their tangents turned round where the sense (n,) is -1."""
    sense = np.reshape(sense, (-1, 1, 1))
    return replace(points, tangents=sense * points.tangents, turns=sense * points.turns)


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


TOGETHER = 16
"""Curves that are followed side by side, from different starts."""


@dataclass(frozen=True)
class CurveSeen:
    """A curve of singular configurations of one type: its points, and those of type III.

    `s` (n,) is the place of the points on it (rad), `both` where it is singular of the
    other type too; the last point of one that is `closed` is its first. `why` says what is
    singular, where that is known of the curve, `modes` in which mode of a mid-plane
    architecture. `traced` is the curve between two changes of type, and what
    it is reported in.
    """

    points: SingularPoints
    both: SingularPoints
    s: Floats
    closed: bool
    why: str = ""
    modes: tuple[int, ...] = ()
    traced: tuple[SingularityReport, SingularCurve] | None = None

    @cached_property
    def cusps(self) -> SingularPoints:
        """Where it turns back in the plane of the inputs (type II) or at the output (I)."""
        if self.traced is None:
            return self.points.rows(slice(0))
        view, curve = self.traced
        return view.points(curve.cusps())

    def dense(self, parts: int) -> SingularPoints:
        """Return the curve, each way between two traced nodes divided into parts."""
        if self.traced is None:
            return self.points
        view, curve = self.traced
        which, part = np.divmod(np.arange(parts * (len(curve.nodes) - 1)), parts)
        made = curve.on(np.append(which, which[-1]), np.append(part / parts, 1.0))
        return view.points(made)


@dataclass(frozen=True)
class SingularCurves:
    """The curves of one type, and what is known of those not found.

    Where every configuration is of the type (`everywhere`) there are no curves. `stray`
    (n, V) are singular configurations that no curve could be followed from: the locus
    crosses itself there, or fills a part of the configurations.
    """

    kind: LocusName
    curves: tuple[CurveSeen, ...]
    claim: Completeness
    stray: Floats
    everywhere: bool = False


def moved_by_all(mechanism: Mechanism, output: str | None = None) -> bool:
    """Return whether all pairs move an output: type II of it has all self-motions then."""
    solver = solver_of(mechanism)
    return SingularityReport.of(solver, output_of(mechanism, output), "II").part is None


@checked(SolveError)
def singular_curves(
    mechanism: Mechanism,
    kind: LocusName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    slices_of_each: int = 12,
    made: LockedInputSection | None = None,
    budget: TimeLimit | None = None,
) -> SingularCurves:
    """Return the curves of singular configurations of a mechanism with two inputs.

    Parameters
    ----------
    mechanism, kind
        "II", inputs at rest in a motion of the output; "I", the output at rest while inputs
        move; or "self-motion", both at rest while other links move.
    output, pointing
        Which output, and which direction of it if not the link's orientation; see
        `spherekit.singular.stationarity.output_of`.
    slices_of_each
        Values at which each input is locked, evenly spread over its range. With 0 the
        locus is looked for from random closed configurations instead: quicker, with the
        claim "sampled", and only curves that meet the declared ranges.
    made, budget
        Slices that are there already, and the time to spend, unlimited by default.

    Raises
    ------
    AnalysisError, PlanError
        If there are not two inputs with a freedom each, or no such output.
    """
    source = StartPoints(
        mechanism, FREEDOMS, kind, output, pointing, made, slices_of_each, budget
    )
    traced: list[SingularCurve] = []
    stray = [np.zeros((0, len(mechanism.variable_owners)))]
    for points in source.batches():
        if source.cut is None:
            points = points.rows(source.view.points(points).inside)
        irregular = points.reciprocal_condition < NEARLY_FLAT
        stray.append(points.values[irregular])
        stray += _followed(source, points.rows(~irregular), traced)
    return SingularCurves(
        kind,
        tuple(part for curve in traced for part in _parts(curve, source.view)),
        source.claim("curve"),
        np.concatenate(stray),
        source.everywhere,
    )


def _followed(
    source: StartPoints, points: LocusPoints, traced: list[SingularCurve]
) -> list[Floats]:
    """Follow curves from points that lie on none traced yet; return those none leaves."""
    left, stray = np.ones(len(points), dtype=bool), []
    for curve in traced:
        left[left] &= ~curve.find(points.values[left], points.motions[left])
    locus = source.view.locus
    budget = source.budget
    kind = source.view.kind
    while np.any(left) and budget.goes_on(f"curve {len(traced) + 1} of type {kind}"):
        (rows,) = np.nonzero(left)
        rows = rows[:: -(-len(rows) // TOGETHER)]
        curves = trace_curves(locus, points.rows(rows), budget)
        for row, new_curve in zip(rows.tolist(), curves, strict=True):
            if not left[row]:
                continue
            left[row] = False
            if new_curve is None:
                stray.append(points.values[row : row + 1])
                continue
            source.met()
            traced.append(new_curve)
            left[left] &= ~new_curve.find(points.values[left], points.motions[left])
    return stray


def _parts(curve: SingularCurve, view: SingularityReport) -> Iterator[CurveSeen]:
    """Yield the parts of a traced curve that are of the type looked for."""

    def measured(nodes: LocusPoints) -> Floats:
        return view.other.measure(view.other.space(nodes.values)).value

    of_type = view.is_own(view.types(curve.nodes.values))
    starts = np.flatnonzero(np.diff(of_type, prepend=False) & of_type)
    stops = np.flatnonzero(np.diff(of_type, append=False) & of_type) + 1
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if stop - start > 1:
            nodes = curve.nodes.rows(slice(start, stop))
            closed = curve.closed and len(nodes) == len(of_type)
            part = replace(curve, nodes=nodes, closed=closed)
            points = view.points(nodes)
            both = view.points(part.zeros(measured))
            yield CurveSeen(points, both, part.s, closed, traced=(view, part))
