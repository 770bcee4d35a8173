"""All curves of singular configurations of a mechanism with two inputs.

Seeds are the singular configurations of slices with one input locked, found along whole
configuration curves, or those that random starts lead to; each that lies on no curve yet
is followed, wherever it leads, also out of the declared ranges. Type I of an orientation is
generally met at points only, which are not curves; where the output has two freedoms it is
met along curves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.budget import Budget
from spherekit.checked import checked
from spherekit.errors import AnalysisError, SolveError
from spherekit.guarantee import Claim
from spherekit.model.mechanism import Mechanism
from spherekit.singular.curve import SingularCurve
from spherekit.singular.locus import LocusPoints
from spherekit.singular.points import (
    CurveSeen,
    LocusName,
    SingularPoints,
    View,
)
from spherekit.singular.slices import Cut, solver_of
from spherekit.singular.starts import EVERYWHERE, Seeding
from spherekit.singular.stationarity import output_of
from spherekit.singular.trace import LARGEST_STEP, NEARLY_FLAT, trace_curves
from spherekit.sphere.rotation import Floats

TOGETHER = 16
"""Curves that are followed side by side, from different starts."""


@final
@dataclass(frozen=True)
class FoundCurve:
    """A curve of singular configurations of one type: its nodes, cusps, type III points.

    It is what a traced `curve` has between two changes of type. `cusps` are where it turns
    back in the plane of the inputs (type II) or at the output (type I); `both` where it is
    singular of the other type too.
    """

    curve: SingularCurve
    points: SingularPoints
    cusps: SingularPoints
    both: SingularPoints
    view: View
    why: str = ""

    def dense(self, parts: int) -> SingularPoints:
        """Return the whole curve, each way between two nodes divided into parts."""
        count = len(self.curve.nodes.values) - 1
        which = np.repeat(np.arange(count), parts)
        along = np.tile(np.arange(parts) / parts, count)
        made = self.curve.on(np.append(which, count - 1), np.append(along, 1.0))
        return self.view.points(made)

    @property
    def s(self) -> Floats:
        """Arc lengths (n,) of the points in the variables (rad)."""
        return self.curve.s

    @property
    def closed(self) -> bool:
        """Whether the curve closes; its last point is then its first."""
        return self.curve.closed


@final
@dataclass(frozen=True)
class SingularCurves:
    """The curves of one type, and what is known of those not found.

    Where every configuration is of the type (`everywhere`) there are no curves. `stray`
    (n, V) are singular configurations that no curve could be followed from: the locus
    crosses itself there, or fills a part of the configurations. `traced` are whole curves
    of the locus.
    """

    kind: LocusName
    curves: tuple[CurveSeen, ...]
    claim: Claim
    stray: Floats
    everywhere: bool = False
    traced: tuple[SingularCurve, ...] = ()

    def seen_by(
        self, mechanism: Mechanism, kind: LocusName, output: str | None = None
    ) -> "SingularCurves":
        """Return the curves of another type or output whose locus is the same.

        See `locus_key`.
        """
        view = View.of(solver_of(mechanism), output_of(mechanism, output), kind)
        curves = tuple(part for curve in self.traced for part in _parts(curve, view))
        return replace(self, kind=kind, curves=curves)


def locus_key(
    mechanism: Mechanism, kind: LocusName, output: str | None = None
) -> tuple[object, ...]:
    """Return what the locus of a type follows from: equal for outputs that share it.

    Type II is the same for all outputs that the same pairs move; self-motions are on the
    locus of those that all pairs move.
    """
    view = View.of(solver_of(mechanism), output_of(mechanism, output), kind)
    moving = None if view.part is None else view.part.variables
    return moving, view.output if kind == "I" else None


@checked(SolveError)
def singular_curves(
    mechanism: Mechanism,
    kind: LocusName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    slices_of_each: int = 12,
    whole_turn: bool = False,
    step: float = LARGEST_STEP,
    made: Cut | None = None,
    budget: Budget | None = None,
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
    slices_of_each, whole_turn
        Values at which each input is locked, evenly spread over its declared range, or over
        one turn. With 0 the locus is looked for from random closed configurations instead:
        quicker, with the claim "sampled", and only curves that meet the declared ranges.
    step, made, budget
        Longest step (rad) along a curve, slices that are there already, and the time to
        spend, unlimited by default.

    Raises
    ------
    AnalysisError, PlanError
        If there are not two inputs with a freedom each, or no such output.
    """
    rest, solver = output_of(mechanism, output, pointing), solver_of(mechanism)
    if len(solver.driven) != 2:
        raise AnalysisError(
            f"{mechanism.name} has {len(solver.driven)} inputs; curves of singular "
            "configurations are those of a mechanism with two"
        )
    view, budget = View.of(solver, rest, kind), budget or Budget()
    source = Seeding(view, whole_turn, made, slices_of_each, budget)
    none = np.zeros((0, len(mechanism.variable_owners)))
    if source.everywhere:
        return SingularCurves(kind, (), EVERYWHERE, none, everywhere=True)
    traced: list[SingularCurve] = []
    stray = [none]
    for points in source.batches():
        if source.cut is None and not whole_turn:
            points = points.rows(view.points(points).inside)
        irregular = points.reciprocal_condition < NEARLY_FLAT
        stray.append(points.values[irregular])
        stray += _followed(source, points.rows(~irregular), traced, step)
    return SingularCurves(
        kind,
        tuple(part for curve in traced for part in _parts(curve, view)),
        source.claim("curve"),
        np.concatenate(stray),
        traced=tuple(traced),
    )


def _followed(
    source: Seeding, points: LocusPoints, traced: list[SingularCurve], step: float
) -> list[Floats]:
    """Follow curves from points that lie on none traced yet; return those none leaves."""
    left, stray = np.ones(len(points), dtype=bool), []
    for curve in traced:
        left[left] &= ~curve.find(points.values[left], points.motions[left])
    locus, budget, kind = source.view.locus, source.budget, source.view.kind
    while np.any(left) and budget.goes_on(f"curve {len(traced) + 1} of type {kind}"):
        (rows,) = np.nonzero(left)
        rows = rows[:: -(-len(rows) // TOGETHER)]
        curves = trace_curves(locus, points.values[rows], step=step, budget=budget)
        for row, new_curve in zip(rows.tolist(), curves, strict=True):
            if not left[row]:
                continue
            left[row] = False
            if new_curve is None:
                stray.append(points.values[row : row + 1])
                continue
            source.met(True)
            traced.append(new_curve)
            left[left] &= ~new_curve.find(points.values[left], points.motions[left])
    return stray


def _parts(curve: SingularCurve, view: View) -> Iterator[FoundCurve]:
    """Yield the parts of a traced curve that are of the type looked for."""
    of_type = view.is_own(view.types(curve.nodes.values))
    if np.all(of_type):
        yield _found(curve, view)
        return
    starts = np.flatnonzero(np.diff(of_type, prepend=False) & of_type)
    stops = np.flatnonzero(np.diff(of_type, append=False) & of_type) + 1
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if stop - start > 1:
            nodes = curve.nodes.rows(slice(start, stop))
            yield _found(replace(curve, nodes=nodes, closed=False), view)


def _found(curve: SingularCurve, view: View) -> FoundCurve:
    def measured(nodes: LocusPoints) -> Floats:
        return view.other.measure(view.other.space(nodes.values)).value

    return FoundCurve(
        curve,
        view.points(curve.nodes),
        view.points(curve.cusps()),
        view.points(curve.zeros(measured)),
        view,
    )
