"""What solves the poses of an output: a closed form, the graph, or one way only."""

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import ModelError, SolveError
from spherekit.guidance.symmetry import mid_plane_form
from spherekit.model.mechanism import Mechanism
from spherekit.model.outputs import chosen_output
from spherekit.motion.assembly_modes import label_of
from spherekit.output.inverse import InverseKinematics
from spherekit.output.measures import InputRates
from spherekit.output.virtual_output import COORDINATES, with_wrist
from spherekit.sphere.rotation import Floats
from spherekit.workspace.dyads import DyadKinematics, geared
from spherekit.workspace.kinematics import ClosedKinematics, OutputKinematics
from spherekit.workspace.mid_plane import MidPlaneKinematics
from spherekit.workspace.rows import InverseRows


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
        return ForwardOnly(mechanism, output)
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


@final
class ForwardOnly(OutputKinematics):
    """An output with another number of inputs than a pose has coordinates: one way only."""

    solved_by = "graph"

    def __init__(self, mechanism: Mechanism, output: str | None) -> None:
        super().__init__(mechanism, chosen_output(mechanism, output), points=False)

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Raise the `PlanError` that says why there is none."""
        with_wrist(self.mechanism, self.output.name)
        raise AssertionError(self.mechanism.inputs)


@final
class GraphKinematics(OutputKinematics):
    """An output whose poses are solved on the graph of all links, row by row."""

    solved_by = "graph"

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
        labels = np.array([label_of(signs) for signs in solutions.signs], dtype=str)
        kept = np.flatnonzero(np.isin(labels, list(modes)))
        none = np.setdiff1d(np.arange(len(poses)), solutions.row[kept])
        lost = np.full(len(kept) + len(none), -1)
        lost[: len(kept)] = kept
        values = _filled(solutions.values, lost)
        owner = list(self.mechanism.variable_owners)
        moved = self._moved(values, _filled(solutions.rotations, lost))
        rows = InverseRows.judged(
            np.concatenate([solutions.row[kept], none]),
            np.concatenate([labels[kept], np.full(len(none), "")]),
            (np.where(lost < 0, -np.inf, np.nan), np.full(len(lost), -1), ()),
            inputs=_filled(solutions.inputs, lost),
            type_1=moved.type_1,
            type_2=self.type_2(values),
            rates=moved.rates,
            values=values[:, [owner.index(pair) for pair in pairs]],
        )
        return InverseRows.joined([rows])

    def _moved(self, values: Floats, rotations: Floats) -> InputRates:
        """Return the rates at configurations (k, variables), NaN where they are."""
        finite = np.isfinite(values[:, 0])
        turns = np.full((len(values), 3, len(self.mechanism.inputs)), np.nan)
        turns[finite] = self.turns(values[finite])
        direction = self.output.direction if self.points else None
        return InputRates.of_turns(
            turns, None if direction is None else rotations @ np.array(direction)
        )


def _filled(array: Floats, rows: NDArray[np.intp]) -> Floats:
    """Return some rows, NaN where their number is negative."""
    filled = np.full((len(rows), *array.shape[1:]), np.nan)
    filled[rows >= 0] = array[rows[rows >= 0]]
    return filled
