"""Singular configurations of mechanisms with several inputs, with their poses and types."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.input_revolutions import in_range, into_range
from spherekit.positions.motion import make_motion
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.locus import LocusPoints, SingularityLocus
from spherekit.singularities.several_inputs import RowType, classify_rows
from spherekit.singularities.stationarity import InputsLocked, OutputStationary
from spherekit.singularities.tangent_space import (
    OutputPart,
    find_output_part,
    tangent_space,
)

LocusName = Literal["I", "II", "self-motion"]
"""What stands still in the singular motion: the output, the inputs, or both."""
ROW_TYPES_OF_LOCUS: Mapping[LocusName, tuple[RowType, ...]] = {
    "I": (RowType.I, RowType.III),
    "II": (RowType.II, RowType.III),
    "self-motion": (RowType.SELF_MOTION,),
}
"""Types of the configurations on each locus (set of singular configurations)."""


@dataclass(frozen=True)
class SingularPoints(ArrayRows):
    """n singular configurations of a mechanism with g inputs and V pair variables.

    In a singular configuration a motion exists in which the output rests (type I), the
    inputs rest (type II), or both rest while other links move (self-motion). It is called
    the singular motion: a vector of rates of the V variables that keep the loops closed.

    Attributes
    ----------
    kind
        The type that was looked for: "I", "II" or "self-motion". It is the type of the one
        singular motion in `motion`.
    type
        (n,) the type of each configuration, as a number of
        `spherekit.singularities.several_inputs.RowType`. It is decided from all singular
        motions of the configuration, so it can differ from `kind`. With a motion of type I
        and another motion of type II, it is type III.
    values
        (n, V) pair variables (rad).
    motion
        (n, V) rates of the singular motion, with norm 1. For types I and II, only the part
        of the mechanism that moves the output is examined. The rates of other pairs are 0.
    inputs
        (n, g) values of the inputs (rad). Whole periods are added to the pair variables, so
        that the inputs are in their declared ranges or as near to them as possible.
    inside
        (n,) whether all inputs are within their declared ranges.
    orientation
        (n, 3, 3) rotation matrices, from the axes of the output link to the axes of its
        reference link.
    pointing
        (n, 3) output direction in the reference link's axes. None if the output is the
        orientation of its link.
    input_rate, output_rate
        (n,) norms of the rates of the inputs and of the output in the singular motion.
    residual
        (n,) the larger of two errors: by how much the loops are open (rad), and the rates
        of the inputs or the output that should be zero in `motion`.
    """

    kind: LocusName
    type: SmallIntegers
    values: Floats
    motion: Floats
    inputs: Floats
    inside: Bools
    orientation: Floats
    pointing: Floats | None
    input_rate: Floats
    output_rate: Floats
    residual: Floats


@dataclass(frozen=True)
class SingularityReport:
    """Finds and describes the singular configurations of one type, for one output.

    At type I the output rests while inputs move, at type II the output can move while the
    inputs rest. In a self-motion other links move while both rest.

    Attributes
    ----------
    solver
        Position solver of the mechanism.
    output
        The output: the rotation of a link relative to another, and the equations of its
        rest.
    kind
        The type: "I", "II" or "self-motion".
    part
        The pairs (joints) that move the output, with their links. None if all pairs do.
    """

    solver: PositionSolver
    output: OutputStationary
    kind: LocusName
    part: OutputPart | None = None

    @staticmethod
    def for_output(
        solver: PositionSolver, output: OutputStationary, kind: LocusName
    ) -> "SingularityReport":
        """Return the report on one type of singularity of an output.

        In type I the output rests while an input moves. In type II the output can move
        while the inputs rest. For types I and II, only the part of the mechanism that moves
        the output is examined: the pairs (joints) that take part in the motion of the
        output. So only singularities of this output are counted. Self-motions, in which
        inputs and output rest, are searched in the whole mechanism.

        Parameters
        ----------
        solver
            Position solver of the mechanism.
        output
            The output: the rotation of a link relative to another, and the equations of its
            rest.
        kind
            "I", "II" or "self-motion".
        """
        part = None
        if kind != "self-motion":
            part = find_output_part(
                solver.mechanism, solver.assembly, output.link, output.relative_to
            )
        # The angular velocity of the output is the sum over the pairs on a path of links,
        # from the reference link to the output link. A sense (+1 or -1) says in which
        # direction the path passes a pair. The senses of a path within the part are used.
        if part is not None:
            output = replace(output, variable_senses=part.variable_senses)
        return SingularityReport(solver, output, kind, part)

    @cached_property
    def locus(self) -> SingularityLocus:
        """The singular configurations of the type."""
        return self._locus(self.kind)

    @cached_property
    def locus_of_other_type(self) -> SingularityLocus:
        """The singular configurations of type II if this type is I, otherwise of type I."""
        return self._locus("II" if self.kind == "I" else "I")

    def _locus(self, kind: LocusName) -> SingularityLocus:
        """Return the configurations of a type; for self-motions the ones of type II."""
        driven = self.solver.driven if self.part is None else self.part.driven
        constraint = self.output if kind == "I" else InputsLocked(driven)
        degrees_of_freedom = len(self.solver.driven)
        return SingularityLocus(
            self.solver.closure, degrees_of_freedom, constraint, self.part
        )

    def types(self, values: Floats) -> SmallIntegers:
        """Return the `RowType` (n,) of configurations (n, V) for the output."""
        motion = make_motion(self.solver, values)
        space = tangent_space(motion.linearisation, len(self.solver.driven))
        return classify_rows(motion, space, self.output).type

    def has_type(self, types: SmallIntegers) -> Bools:
        """Return a mask (n,) of the `types` that belong to this type of singularity."""
        return np.isin(types, ROW_TYPES_OF_LOCUS[self.kind])

    @cached_property
    def ranges(self) -> Floats:
        """(2, g) the lowest and the highest declared values of the inputs (rad)."""
        return np.transpose([item.range for item in self.solver.mechanism.inputs])

    def inputs_in_range(self, values: Floats) -> Floats:
        """Return the g inputs (n, g), in rad, of n configurations with V variables (n, V).

        Configurations repeat after whole periods of the inputs. Each input is shifted by
        whole periods into its declared range, or as near to it as possible.
        """
        q = values[:, list(self.solver.driven)]
        low, high = self.ranges
        return into_range(q, low, high, self.solver.periods)

    def points(self, locus_points: LocusPoints) -> SingularPoints:
        """Return the singular configurations of a locus with inputs, poses and types."""
        return self.describe(
            locus_points.values, locus_points.motions, locus_points.residual
        )

    def describe(self, values: Floats, motions: Floats, residual: Floats) -> SingularPoints:
        """Return singular configurations with their inputs, poses and types.

        In a singular motion the inputs rest (type II), the output rests (type I), or both
        (self-motion). The report looks for one of these types, which is the `kind` of all
        points. A point can have further singular motions. Its `type` is decided from all of
        them, so it can differ from `kind`.

        Parameters
        ----------
        values
            (n, V) pair variables (rad).
        motions
            (n, V) rates of the variables in the singular motions, with norm 1.
        residual
            (n,) the larger of two errors. One is by how much the loops are open (rad). The
            other is the rate of the inputs or the output that should rest, in a motion with
            norm 1.
        """
        linearisation = self.solver.closure.linearise(values)
        # Whole periods are added to the inputs, so that these are in their ranges or as
        # near to the ranges as possible.
        inputs = self.inputs_in_range(values)
        orientation = self.output.orientation(linearisation)
        pointing = None
        if self.output.pointing is not None:
            pointing = orientation @ np.array(self.output.pointing)
        # `equations` has the components of the output's angular velocity per unit rate of
        # each variable. A pointing output has two components, at right angles to its
        # direction. An orientation has three.
        output_rates = np.matvec(self.output.equations(linearisation), motions)
        return SingularPoints(
            kind=self.kind,
            type=self.types(values),
            values=values,
            motion=motions,
            inputs=inputs,
            inside=np.all(in_range(inputs, *self.ranges), axis=1),
            orientation=orientation,
            pointing=pointing,
            input_rate=np.linalg.norm(motions[:, list(self.solver.driven)], axis=1),
            output_rate=np.linalg.norm(output_rates, axis=1),
            residual=residual,
        )
