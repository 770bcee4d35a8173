"""All curves of singular configurations of a mechanism with two inputs.

The search starts from singular configurations of slices with one input locked, or from
those that random starts lead to. Every singular configuration that is not on a curve yet is
followed, also beyond the declared ranges of the inputs. Type I of an orientation generally
occurs at isolated points, which are not found as curves. If the output has two degrees of
freedom, type I occurs along curves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats
from spherekit.completeness import Completeness
from spherekit.errors import SolveError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.singularities.curve_starts import LocusPointSearch
from spherekit.singularities.curve_tracing import CURVE_FREEDOMS, trace_curves
from spherekit.singularities.locus import LocusPoints
from spherekit.singularities.singular_curve import SingularCurve
from spherekit.singularities.singularity_report import (
    LocusName,
    SingularityReport,
    SingularPoints,
)
from spherekit.singularities.slices import LockedInputSection, solver_of
from spherekit.singularities.stationarity import output_of
from spherekit.time_limit import TimeLimit
from spherekit.tolerances import END_AT_SINGULARITY_CONDITION

CURVES_AT_ONCE = 16
"""Number of curves that are followed at the same time, from different starts. Larger:
more curves are followed twice; smaller: slower."""


@dataclass(frozen=True)
class CurveSeen:
    """A curve of singular configurations of one type, in the form for reports and drawings.

    At a singularity of type I the output rests while an input moves. At type II the output
    can move while the inputs rest.

    Attributes
    ----------
    points
        n points of the curve. The last point of a closed curve is its first.
    both
        The points at which both types I and II occur. On a followed curve, only those at
        which the determinant of the other type changes its sign.
    s
        (n,) arc lengths (rad) of the points, in the space of the pair variables. For a
        mid-plane symmetric architecture, the path of the normal of the mid-plane.
    closed
        Whether the curve is closed.
    why
        The geometric reason of the singularity, if it is the same on the whole curve,
        otherwise empty.
    modes
        For a mid-plane symmetric architecture, the sign of each leg on the curve, 1 or -1.
    traced
        Only for a curve that was followed numerically. The first object computes inputs
        and poses of the points of the curve. The second object is the followed curve,
        as far as it is of this type. None for a curve in closed form.
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
        """Points at which the curve turns back in the plane of the inputs or of the output.

        Such points are cusps: in the plane of the two inputs for type II, in the plane of
        the output for type I. Cusps are not computed for curves in closed form.
        """
        if self.traced is None:
            return self.points.rows(slice(0))
        report, curve = self.traced
        return report.points(curve.cusps())

    def dense(self, parts: int) -> SingularPoints:
        """Return points of the curve, `parts` for each chord between two successive nodes.

        The points are for drawings, in which the curve is smooth if there are many points.
        Nodes are the points that were computed when the curve was followed. The end of the
        last chord is one more point.

        A curve in closed form was not followed and has no nodes. Its `points` are returned.
        """
        if self.traced is None:  # the curve has a closed form
            return self.points
        report, curve = self.traced
        chord_count = len(curve.nodes) - 1
        chord_numbers, part_numbers = np.divmod(np.arange(parts * chord_count), parts)
        # The first point of each chord is its start, so the end of the last one is added.
        chord_numbers = np.append(chord_numbers, chord_numbers[-1])
        positions = np.append(part_numbers / parts, 1.0)
        points = curve.points_on_chords(chord_numbers, positions)
        # The report adds the inputs, poses and types of the points.
        return report.points(points)


@dataclass(frozen=True)
class SingularCurves:
    """All curves of singular configurations of one type, of a mechanism with two inputs.

    Along a curve of type II the output can move while the inputs rest. Along a curve of
    type I the output rests while an input moves. In a self-motion both rest while other
    links move.

    Attributes
    ----------
    kind
        The type: "I", "II" or "self-motion".
    curves
        The curves; none if every configuration is of the type.
    claim
        What is known of curves that the search may have missed.
    stray
        (n, V) values of the V pair variables (rad) at n singular configurations from which
        no curve could be followed. Either curves cross at these configurations, or all
        configurations around them are singular.
    everywhere
        Whether every configuration is of the type.
    """

    kind: LocusName
    curves: tuple[CurveSeen, ...]
    claim: Completeness
    stray: Floats
    everywhere: bool = False


def moved_by_all(mechanism: Mechanism, output: str | None = None) -> bool:
    """Return whether all pairs take part in the motion of an output.

    At type II the output can move while the inputs rest. In a self-motion other links move
    while inputs and output rest. If all pairs take part, the singularities of type II
    include all self-motions.
    """
    stationary_output = output_of(mechanism, output)
    report = SingularityReport.for_output(solver_of(mechanism), stationary_output, "II")
    return report.part is None


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
    mechanism
        The mechanism.
    kind
        Type of the singularity: "II", the output can move while the inputs are at rest;
        "I", inputs can move while the output is at rest; or "self-motion", other links can
        move while inputs and output are at rest.
    output, pointing
        The output, and a direction of it if this has to rest instead of the whole link; see
        `spherekit.singularities.stationarity.output_of`.
    slices_of_each
        The search follows curves on which one of the inputs is locked. This is the number
        of values at which each input is locked, evenly spread over its range. With 0 the
        search starts from random closed configurations. It is quicker, but gives only
        curves that meet the declared ranges, and its completeness is "sampled".
    made
        Curves with one locked input that were followed before, or None.
    budget
        The time to spend, unlimited by default.

    Returns
    -------
    The curves, with what is known of curves that were not found.

    Raises
    ------
    AnalysisError, ModelError, PlanError
        If the mechanism does not have two inputs and two degrees of freedom, if it has no
        such output, or if `slices_of_each` is negative.
    """
    search = LocusPointSearch(
        mechanism,
        input_count=CURVE_FREEDOMS,
        kind=kind,
        output=output,
        pointing=pointing,
        section=made,
        slices_of_each=slices_of_each,
        time_limit=budget,
    )
    curves: list[SingularCurve] = []
    stray = [np.zeros((0, len(mechanism.variable_owners)))]
    for points in search.batches():
        if search.section is None:
            # Newton's method from random starts may end outside of the ranges of the
            # inputs.
            points = points.rows(search.report.points(points).inside)
        # Where curves cross, no single curve can be followed.
        is_irregular = points.reciprocal_condition < END_AT_SINGULARITY_CONDITION
        stray.append(points.values[is_irregular])
        stray += _follow_new_curves(search, points.rows(~is_irregular), curves)
    curve_parts: list[CurveSeen] = []
    for curve in curves:
        curve_parts += _parts_of_type(curve, search.report)
    return SingularCurves(
        kind=kind,
        curves=tuple(curve_parts),
        claim=search.completeness("curve"),
        stray=np.concatenate(stray),
        everywhere=search.is_everywhere,
    )


def _follow_new_curves(
    search: LocusPointSearch, points: LocusPoints, curves: list[SingularCurve]
) -> list[Floats]:
    """Follow curves from the singular configurations that are on none of the known curves.

    Parameters
    ----------
    search
        The search for singular configurations of one type (the locus), with its time limit.
    points
        Singular configurations from which curves may be followed.
    curves
        The curves that were followed before. New curves are appended, in place.

    Returns
    -------
    For each point from which no curve could be followed, its V pair variables (1, V) in
    rad.
    """
    # Points that are on no curve yet.
    is_remaining = np.ones(len(points), dtype=bool)
    for curve in curves:
        _remove_points_on_curve(is_remaining, points, curve)
    stray: list[Floats] = []
    locus = search.report.locus
    kind = search.report.kind
    while np.any(is_remaining):
        if not search.time_limit.goes_on(f"curve {len(curves) + 1} of type {kind}"):
            break
        (rows,) = np.nonzero(is_remaining)
        # At most CURVES_AT_ONCE starts, spread evenly over the remaining points. Together
        # they take less time than one by one.
        stride = -(-len(rows) // CURVES_AT_ONCE)
        start_rows = rows[::stride]
        new_curves = trace_curves(locus, points.rows(start_rows), search.time_limit)
        for row, new_curve in zip(start_rows.tolist(), new_curves, strict=True):
            if not is_remaining[row]:
                # A curve from another start passes this point.
                continue
            is_remaining[row] = False
            if new_curve is None:
                stray.append(points.values[row : row + 1])
                continue
            search.record_new_result()
            curves.append(new_curve)
            _remove_points_on_curve(is_remaining, points, new_curve)
    return stray


def _remove_points_on_curve(
    is_remaining: Bools, points: LocusPoints, curve: SingularCurve
) -> None:
    """Set `is_remaining` (n,) to False for the remaining points that are on a curve."""
    values = points.values[is_remaining]
    motions = points.motions[is_remaining]
    is_remaining[is_remaining] &= ~curve.find(values, motions)


def _parts_of_type(curve: SingularCurve, report: SingularityReport) -> Iterator[CurveSeen]:
    """Yield the parts of a followed curve that are singular in the type of the report.

    A curve was followed as a series of singular configurations (its nodes). In type I the
    output rests while an input moves. In type II the output can move while the inputs rest.
    Some nodes of a curve can be of another type. Such nodes separate the parts.

    A part that passes the first node of a closed curve is yielded as two parts.

    Parameters
    ----------
    curve
        The followed curve of singular configurations.
    report
        The search for one type of singularity. It determines the type of each node.
    """
    other_locus = report.locus_of_other_type

    def measure_other_type(points: LocusPoints) -> Floats:
        """Return a determinant (n,), zero at points that are of the other type, too."""
        space = other_locus.tangent_space(points.values)
        return other_locus.measure(space).value

    is_of_type = report.has_type(report.types(curve.nodes.values))
    for start, stop in _find_runs(is_of_type):
        if stop - start == 1:
            # A single node is no curve.
            continue
        nodes = curve.nodes.rows(slice(start, stop))
        # A part of a closed curve is closed only if it has all nodes.
        is_closed = curve.closed and len(nodes) == len(is_of_type)
        part = replace(curve, nodes=nodes, closed=is_closed)
        yield CurveSeen(
            points=report.points(nodes),
            # The points that are of types I and II at once, if the determinant changes its
            # sign there.
            both=report.points(part.zeros(measure_other_type)),
            # Arc lengths are counted from the start of the part.
            s=part.s,
            closed=is_closed,
            # From these nodes, further points of the part can be computed later.
            traced=(report, part),
        )


def _find_runs(is_included: Bools) -> list[tuple[int, int]]:
    """Return where the runs of successive true items are in a sequence of truth values.

    For example, F T T F T has the runs (1, 3) and (4, 5).

    Returns
    -------
    For each run the index of its first item, and the index after its last item.
    """
    runs: list[tuple[int, int]] = []
    start = 0
    for has_value, items in groupby(is_included.tolist()):
        stop = start + len(list(items))
        if has_value:
            runs.append((start, stop))
        start = stop
    return runs
