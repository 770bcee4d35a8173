"""What solves the poses of an output: a closed form, the graph, or one way only."""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.vectors import nans
from spherekit.mechanism.mechanism import Mechanism, chosen_output
from spherekit.outputs.dyad_chain import rates_of_turns
from spherekit.outputs.dyad_solver import DyadKinematics, geared
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_solver import MidPlaneKinematics
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.outputs.pose_constraints import (
    ClosedKinematics,
    InverseRows,
    OutputKinematics,
)
from spherekit.outputs.virtual_output import COORDINATES
from spherekit.positions.assembly_mode import label_of


def output_kinematics(
    mechanism: Mechanism, output: str | None = None, graph: bool = False
) -> OutputKinematics:
    """Return what solves the poses of an output.

    Parameters
    ----------
    mechanism, output
        The mechanism, and the name of its output if there are several.
    graph
        Whether to solve the graph of all links, though there is a mid-plane symmetric
        architecture.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown, or cannot take every pose.
    """
    if len(mechanism.inputs) not in COORDINATES:
        return OutputKinematics(mechanism, chosen_output(mechanism, output), points=False)
    inverse = InverseKinematics(mechanism, output)
    if inverse.has_closed_form or not graph:
        try:
            return _closed_form_of(inverse)
        except SolveError:
            pass
    return GraphKinematics(inverse)


def closed_kinematics(mechanism: Mechanism, output: str | None = None) -> ClosedKinematics:
    """Return the closed form of an output.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown or cannot take every pose.
    SolveError
        If there is no closed form that needs no start.
    """
    return _closed_form_of(InverseKinematics(mechanism, output))


def _closed_form_of(inverse: InverseKinematics) -> ClosedKinematics:
    if inverse.has_closed_form:
        return DyadKinematics(inverse)
    output = inverse.wrist.output
    turned = geared(inverse.own, output)
    if turned is not None:
        return turned
    try:
        form = mid_plane_form(inverse.own, output.name)
    except ModelError as problem:
        raise inverse.no_closed_form(
            f"dyads on the output alone would do. And {problem}"
        ) from None
    return MidPlaneKinematics(inverse.own, output, form)


class GraphKinematics(OutputKinematics):
    """An output whose poses are solved on the graph of all links, row by row."""

    def __init__(self, inverse: InverseKinematics) -> None:
        super().__init__(inverse.own, inverse.wrist.output, inverse.wrist.points)
        self.kinematics, self.modes, self.legs = inverse, inverse.modes, inverse.legs
        try:
            self.form = mid_plane_form(self.mechanism, self.output.name)
        except ModelError:
            self.form = None

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each configuration found, or one that says there is none."""
        solutions = self.kinematics.solutions(poses)
        labels = np.array([*map(label_of, solutions.signs), ""])
        kept = np.flatnonzero(np.isin(labels[:-1], modes))
        none = np.setdiff1d(np.arange(len(poses)), solutions.row[kept])
        at = np.append(kept, np.full(len(none), -1))
        seen = at >= 0

        def filled(array: Floats) -> Floats:
            return np.concatenate([array, nans((1, *array.shape[1:]))])[at]

        values = filled(solutions.values)
        turns = nans((len(values), 3, len(self.mechanism.inputs)))
        turns[seen] = self.turns(values[seen])
        directions = None
        if self.points and solutions.directions is not None:
            directions = filled(solutions.directions)
        rates, type_1 = rates_of_turns(turns, directions)
        owners = self.mechanism.variable_owners
        rows = InverseRows(
            np.append(solutions.row[kept], none),
            labels[at],
            filled(solutions.inputs),
            np.zeros(len(at), dtype=np.int8),
            np.where(seen, np.nan, -np.inf),
            np.full(len(at), -1),
            type_1,
            self.type_2(values),
            rates,
            values[:, [*map(owners.index, pairs)]],
            (),
        )
        return InverseRows.joined([rows.judged()])
