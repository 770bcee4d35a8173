"""Singular configurations as the inputs and the output see them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.assembly_modes import Solver
from spherekit.motion.motion import motion_of
from spherekit.motion.turns import in_range, into_range
from spherekit.numeric.rows import ArrayRows
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.singular.several import RowType, by_motions
from spherekit.singular.stationarity import InputsLocked, OutputPart, OutputStationary
from spherekit.sphere.rotation import Floats

TypeName = Literal["I", "II"]
LocusName = Literal["I", "II", "self-motion"]
OWN: Mapping[LocusName, tuple[RowType, ...]] = {
    "I": (RowType.I, RowType.III),
    "II": (RowType.II, RowType.III),
    "self-motion": (RowType.SELF_MOTION,),
}
"""Types of the configurations on each locus."""


@final
@dataclass(frozen=True)
class SingularPoints(ArrayRows):
    """n singular configurations, as what stands still and what moves sees them.

    Attributes
    ----------
    kind
        The locus that they are on. II: the inputs stand still in the singular motion; I:
        the output does; self-motion: both.
    type
        (n,) what each is for the output, a `spherekit.singular.several.RowType`.
    values, motion
        The variables and the unit rates of the singular motion, (n, V), of the pairs that
        move the output.
    inputs
        (n, g) values of the inputs (rad), less whole turns in their declared ranges or as
        near to these as can be.
    inside
        (n,) whether all are within those ranges.
    orientation, pointing
        (n, 3, 3) from the output link's axes to those of its reference link, and the
        output direction (n, 3) there, or None.
    input_rate, output_rate
        (n,) norms of the rates of the inputs and of the output in the singular motion.
    residual
        (n,) the larger of the loops' residual (rad) and that of the singularity.
    """

    kind: LocusName
    type: NDArray[np.int8]
    values: Floats
    motion: Floats
    inputs: Floats
    inside: NDArray[np.bool_]
    orientation: Floats
    pointing: Floats | None
    input_rate: Floats
    output_rate: Floats
    residual: Floats


class CurveSeen(Protocol):
    """A curve of singular configurations: its points, and those of type III.

    `s` (n,) rad is the place of the points on it.
    """

    @property
    def points(self) -> SingularPoints:
        """The points in order."""

    @property
    def both(self) -> SingularPoints:
        """Those that are singular of the other type too."""

    @property
    def s(self) -> Floats:
        """The places (n,) of the points on the curve (rad)."""

    @property
    def closed(self) -> bool:
        """Whether it closes; its last point is then its first."""

    @property
    def why(self) -> str:
        """What is singular, in words, where that is known of the curve; else nothing."""

    def dense(self, parts: int) -> SingularPoints:
        """Return the curve, each way between two points divided into parts."""


@final
@dataclass(frozen=True)
class View:
    """The singular configurations of a type, and what of them is reported."""

    solver: Solver
    output: OutputStationary
    kind: LocusName
    part: OutputPart | None = None

    @staticmethod
    def of(solver: Solver, output: OutputStationary, kind: LocusName) -> "View":
        """Return what is singular of an output: of the part alone that moves it.

        Self-motions are those of the whole mechanism.
        """
        if kind == "self-motion":
            return View(solver, output, kind)
        links = output.link, output.relative_to
        part = OutputPart.of(solver.mechanism, solver.assembly, *links)
        if part is None:
            return View(solver, output, kind)
        return View(solver, replace(output, way=part.way), kind, part)

    @cached_property
    def locus(self) -> Locus:
        """The configurations of the type."""
        return self._locus(self.kind)

    @cached_property
    def other(self) -> Locus:
        """Those of the other type."""
        return self._locus("II" if self.kind == "I" else "I")

    def _locus(self, kind: LocusName) -> Locus:
        driven = self.solver.driven if self.part is None else self.part.driven
        rest = self.output if kind == "I" else InputsLocked(driven)
        return Locus(self.solver.closure, len(self.solver.driven), rest, self.part)

    def types(self, values: Floats) -> NDArray[np.int8]:
        """Return the types (n,) of configurations for the output."""
        return by_motions(motion_of(self.solver, values), self.output).type

    def is_own(self, types: NDArray[np.int8]) -> NDArray[np.bool_]:
        """Return which types (n,) are those of the locus."""
        return np.isin(types, OWN[self.kind])

    @cached_property
    def ranges(self) -> tuple[Floats, Floats]:
        """The lowest and the highest declared values (g,) of the inputs (rad)."""
        ends = [item.range for item in self.solver.mechanism.inputs]
        low, high = np.array(ends).T
        return low, high

    def inputs_of(self, values: Floats) -> Floats:
        """Return the inputs (n, g) of configurations (n, V), as in `SingularPoints`."""
        driven = list(self.solver.driven)
        return into_range(values[:, driven], *self.ranges, self.solver.periods)

    def points(self, nodes: LocusPoints) -> SingularPoints:
        """Return what points of the locus look like."""
        return self.seen(nodes.values, nodes.motions, nodes.residual)

    def seen(self, values: Floats, motions: Floats, residual: Floats) -> SingularPoints:
        """Return what configurations and singular motions (n, V) look like."""
        at = self.solver.closure.at(values)
        driven = list(self.solver.driven)
        low, high = self.ranges
        inputs = self.inputs_of(values)
        orientation = self.output.orientation(at)
        pointing = None
        if self.output.pointing is not None:
            pointing = orientation @ np.array(self.output.pointing)
        moving = np.einsum("nmv,nv->nm", self.output.equations(at), motions)
        return SingularPoints(
            self.kind,
            self.types(values),
            values,
            motions,
            inputs,
            np.all(in_range(inputs, low, high), axis=1),
            orientation,
            pointing,
            np.linalg.norm(motions[:, driven], axis=1),
            np.linalg.norm(moving, axis=1),
            residual,
        )
