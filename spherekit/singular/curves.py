"""All curves of singular configurations of a mechanism with two inputs.

Seeds are the singular configurations of slices with one input locked, found along whole
configuration curves; each seed that lies on no curve yet is followed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.singular.curve import SingularCurve
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.singular.points import SingularPoints, TypeName, View, loci_of
from spherekit.singular.rest import output_of
from spherekit.singular.slices import seeds, slices, solver_of
from spherekit.singular.trace import LARGEST_STEP, NEARLY_FLAT, trace_curve
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class FoundCurve:
    """A curve of singular configurations: its nodes, its cusps, its type III points.

    `cusps` are where the curve turns back in the plane of the inputs (type II) or at the
    output (type I); `both` where it is singular of the other type too.
    """

    curve: SingularCurve
    points: SingularPoints
    cusps: SingularPoints
    both: SingularPoints
    view: View

    def dense(self, parts: int) -> SingularPoints:
        """Return the whole curve, each way between two nodes divided into parts."""
        count = len(self.curve.nodes.values) - 1
        which = np.repeat(np.arange(count), parts)
        along = np.tile(np.arange(parts) / parts, count)
        made = self.curve.on(np.append(which, count - 1), np.append(along, 1.0))
        return self.view.points(self.curve.locus, made)

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

    `box` is the distance (rad) between slices of each input: a curve that lies between
    two of each, and so within a box of these sides, may be missing. `slices` counts the
    configuration curves that were searched, `seeds` the singular configurations on them.
    `stray` (n, V) are singular configurations that no curve could be followed from.
    `branching` (n, V) are configurations next to those in which slices end, as the motions
    of the mechanism branch there: its closure equations lose rank, and no type is defined.
    """

    kind: TypeName
    curves: tuple[FoundCurve, ...]
    box: tuple[float, float]
    slices: int
    seeds: int
    stray: Floats
    branching: Floats

    @property
    def guarantee(self) -> str:
        """What the set of curves guarantees, in words."""
        sides = " by ".join(f"{np.degrees(side):.3g}" for side in self.box)
        return f"complete but for curves within a box of {sides} deg between slices"


def singular_curves(
    mechanism: Mechanism,
    kind: TypeName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    slices_of_each: int = 12,
    whole_turn: bool = False,
    step: float = LARGEST_STEP,
) -> SingularCurves:
    """Return the curves of singular configurations of a mechanism with two inputs.

    Parameters
    ----------
    mechanism
        A mechanism with two inputs.
    kind
        "II", inputs at rest in a motion, or "I", the output at rest.
    output, pointing
        Which output, and which direction of it if not the link's orientation; see
        `spherekit.singular.rest.output_of`.
    slices_of_each
        Values at which each input is locked, evenly spread over its declared range.
    whole_turn
        Whether to spread them over one turn instead.
    step
        Longest step (rad) along a curve.

    Raises
    ------
    AnalysisError
        If there are not two inputs, or no such output.
    PlanError
        If the mechanism has not one freedom for each input.

    Curves are found where slices meet them, and are followed wherever they lead, also out
    of the declared ranges. Type I of an orientation is generally met at points only, which
    are no curves; where the output has two freedoms it is met along curves.
    """
    rest = output_of(mechanism, output, pointing)
    solver = solver_of(mechanism)
    if len(solver.driven) != 2:
        raise AnalysisError(
            f"{mechanism.name} has {len(solver.driven)} inputs; curves of singular "
            "configurations are those of a mechanism with two"
        )
    locus, other = loci_of(solver, rest, kind)
    ranges = [
        (-np.pi, np.pi) if whole_turn else (item.start, item.stop)
        for item in mechanism.inputs
    ]
    traced: list[SingularCurve] = []
    none = np.zeros((0, len(mechanism.variable_owners)))
    stray, branching = [none], [none]
    count, hits, box = 0, 0, []
    for number, (low, high) in enumerate(ranges):
        gap = (high - low) / slices_of_each
        box.append(gap)
        spread = low + gap * (np.arange(slices_of_each) + 0.5)
        held = np.zeros((slices_of_each, 2))
        held[:, number] = spread
        for each in slices(solver, 1 - number, held):
            count += 1
            flat = locus.space(each.crossings).flatness < NEARLY_FLAT
            branching.append(each.crossings[flat])
            points = seeds(each, locus)
            hits += len(points)
            left = np.ones(len(points), dtype=bool)
            for curve in traced:
                left[left] &= ~curve.find(points.values[left], points.motions[left])
            while np.any(left):
                row = int(np.argmax(left))
                left[row] = False
                found = trace_curve(locus, points.values[row], step=step)
                if found is None:
                    stray.append(points.values[row : row + 1])
                    continue
                traced.append(found)
                left[left] &= ~found.find(points.values[left], points.motions[left])
    view = View(solver, rest, kind)
    return SingularCurves(
        kind,
        tuple(_found(curve, other, view) for curve in traced),
        (box[0], box[1]),
        count,
        hits,
        np.concatenate(stray),
        np.concatenate(branching),
    )


def _found(curve: SingularCurve, other: Locus, view: View) -> FoundCurve:
    def measured(nodes: LocusPoints) -> Floats:
        return other.measure(other.space(nodes.values)).value

    locus = curve.locus
    return FoundCurve(
        curve,
        view.points(locus, curve.nodes),
        view.points(locus, curve.cusps()),
        view.points(locus, curve.zeros(measured)),
        view,
    )
