"""All curves of singular configurations of a mechanism with two inputs.

Seeds are the singular configurations of slices with one input locked, found along whole
configuration curves; each seed that lies on no curve yet is followed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.segments import CurvePoints
from spherekit.singular.curve import SingularCurve
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.singular.rest import InputsRest, OutputRest, Rest, output_of
from spherekit.singular.slices import Slice, slices, solver_of
from spherekit.singular.trace import LARGEST_STEP, trace_curve
from spherekit.sphere.rotation import Floats

Kind = Literal["I", "II"]

MOVES = 1e-9
"""A singular motion whose rate of inputs or output is below this leaves them at rest."""


@final
@dataclass(frozen=True)
class SingularPoints:
    """n singular configurations, as what stands still and what moves sees them.

    Attributes
    ----------
    kind
        II: the inputs stand still in the singular motion; I: the output does.
    values, motion
        The variables and the unit rates of the singular motion, (n, V).
    inputs
        (n, g) values of the inputs (rad).
    inside
        (n,) whether all inputs are within their declared ranges, whole turns apart.
    orientation, pointing
        (n, 3, 3) from the output link's axes to those of its reference link, and the
        output direction (n, 3) there, or None.
    input_rate, output_rate
        (n,) norms of the rates of the inputs and of the output in the singular motion.
        Type II with an output rate of zero leaves some other link loose, not the output.
    residual
        (n,) the larger of the loops' residual (rad) and that of the singularity.
    """

    kind: Kind
    values: Floats
    motion: Floats
    inputs: Floats
    inside: np.ndarray[tuple[int], np.dtype[np.bool_]]
    orientation: Floats
    pointing: Floats | None
    input_rate: Floats
    output_rate: Floats
    residual: Floats


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
    """

    kind: Kind
    curves: tuple[FoundCurve, ...]
    box: tuple[float, float]
    slices: int
    seeds: int
    stray: Floats

    @property
    def guarantee(self) -> str:
        """What the set of curves guarantees, in words."""
        sides = " by ".join(f"{np.degrees(side):.3g}" for side in self.box)
        return f"complete but for curves within a box of {sides} deg between slices"


def singular_curves(
    mechanism: Mechanism,
    kind: Kind = "II",
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
    chosen: dict[Kind, Rest] = {"II": InputsRest(solver.driven), "I": rest}
    locus = Locus(solver.closure, 2, chosen[kind])
    other = Locus(solver.closure, 2, chosen["I" if kind == "II" else "II"])
    ranges = [
        (-np.pi, np.pi) if whole_turn else (item.start, item.stop)
        for item in mechanism.inputs
    ]
    traced: list[SingularCurve] = []
    stray: list[Floats] = []
    count, seeds, box = 0, 0, []
    for number, (low, high) in enumerate(ranges):
        gap = (high - low) / slices_of_each
        box.append(gap)
        spread = low + gap * (np.arange(slices_of_each) + 0.5)
        for each in slices(solver, number, spread):
            count += 1
            points = _seeds(each, locus)
            seeds += len(points)
            left = np.ones(len(points), dtype=bool)
            for curve in traced:
                left[left] &= ~curve.find(points.values[left], points.motions[left])
            while np.any(left):
                row = int(np.argmax(left))
                left[row] = False
                found = trace_curve(locus, points.values[row], step=step)
                if found is None:
                    stray.append(points.values[row])
                    continue
                traced.append(found)
                left[left] &= ~found.find(points.values[left], points.motions[left])
    watch = _Watch(mechanism, solver.driven, rest, kind)
    return SingularCurves(
        kind,
        tuple(_found(curve, other, watch) for curve in traced),
        (box[0], box[1]),
        count,
        seeds,
        np.array(stray).reshape(-1, len(mechanism.variable_owners)),
    )


def _seeds(each: Slice, locus: Locus) -> LocusPoints:
    """Return the singular configurations on a slice."""

    def along(points: CurvePoints) -> tuple[Floats, Floats]:
        space = locus.space(each.locked.whole(points.values))
        measure = locus.measure(space)
        ways = np.swapaxes(space.basis, 1, 2) @ each.locked.rates(points.tangents)[..., None]
        return measure.value, np.sum(measure.gradient * ways[..., 0], axis=1)

    places = each.curve.locate(along).places
    values = each.locked.whole(each.curve.at(places).values)
    found = locus.onto(values)
    return found.rows(np.flatnonzero(found.good))


@final
@dataclass(frozen=True)
class _Watch:
    """What of singular configurations is reported."""

    mechanism: Mechanism
    driven: tuple[int, ...]
    output: OutputRest
    kind: Kind

    def points(self, locus: Locus, nodes: LocusPoints) -> SingularPoints:
        space = locus.space(nodes.values)
        inputs = nodes.values[:, list(self.driven)]
        low = np.array([item.start for item in self.mechanism.inputs])
        high = np.array([item.stop for item in self.mechanism.inputs])
        lapped = low + np.mod(inputs - low, 2.0 * np.pi)
        orientation = self.output.orientation(space)
        pointing = None
        if self.output.pointing is not None:
            pointing = orientation @ np.array(self.output.pointing)
        rows, _ = self.output.rows(space)
        moving = np.einsum("nmv,nv->nm", rows, nodes.motions)
        return SingularPoints(
            self.kind,
            nodes.values,
            nodes.motions,
            inputs,
            np.asarray(np.all(lapped <= high, axis=1)),
            orientation,
            pointing,
            np.linalg.norm(nodes.motions[:, list(self.driven)], axis=1),
            np.linalg.norm(moving, axis=1),
            nodes.residual,
        )


def _found(curve: SingularCurve, other: Locus, watch: _Watch) -> FoundCurve:
    def measured(nodes: LocusPoints) -> Floats:
        return other.measure(other.space(nodes.values)).value

    locus = curve.locus
    return FoundCurve(
        curve,
        watch.points(locus, curve.nodes),
        watch.points(locus, curve.cusps()),
        watch.points(locus, curve.zeros(measured)),
    )
