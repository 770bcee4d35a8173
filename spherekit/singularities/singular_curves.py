"""All curves of singular configurations of a mechanism with two inputs.

Seeds are the singular configurations of slices with one input locked, found along whole
configuration curves, or those that random starts lead to; each that lies on no curve yet
is followed, wherever it leads, also out of the declared ranges. Type I of an orientation is
generally met at points only, which are not curves; where the output has two freedoms it is
met along curves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.completeness import Completeness, TimeLimit
from spherekit.errors import SolveError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.singularities.curve_starts import StartPoints
from spherekit.singularities.curve_tracing import FREEDOMS, NEARLY_FLAT, trace_curves
from spherekit.singularities.several_inputs import (
    LocusName,
    SingularityReport,
    SingularPoints,
)
from spherekit.singularities.singular_curve import SingularCurve
from spherekit.singularities.slices import LockedInputSection, LocusPoints, solver_of
from spherekit.singularities.stationarity import output_of

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
        `spherekit.singularities.stationarity.output_of`.
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
