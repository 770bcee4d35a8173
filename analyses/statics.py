"""Mechanisms at rest: torques that hold them, mechanical advantages, stiffness."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Scene,
    Table,
    TableData,
    input_columns,
    listing,
)
from spherekit.plugin.dynamics import (
    InverseSolution,
    Stiffness,
    acting_links,
    holding_torques,
    output_stiffness,
    used_pairs,
)
from spherekit.plugin.quantities import Seconds

from .common import (
    continue_load_angles,
    describe_largest_torques,
    find_largest_torques,
    merge_largest_torques,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

LARGEST_HOLDING_TORQUE = "largest_holding_torque_Nm"
"""Key of the largest torque at an input in the summary."""
PRINCIPAL_STIFFNESSES = ("smallest", "intermediate", "largest")
"""Names of the principal stiffnesses of an output, in their order."""

HOLDING_TORQUES = Column(
    "tau",
    "N m",
    "torque at the driven pair that holds the mechanism at rest against all loads",
    per_input=True,
)
ADVANTAGES = Column(
    "advantage",
    "",
    "moment on the output that a unit torque at the driven pair balances while the "
    "other inputs are locked (mechanical advantage)",
    per_input=True,
)


@dataclass(frozen=True, kw_only=True)
class Statics(AbstractAnalysis):
    """Torques that hold the mechanism at rest, and how stiffly the inputs hold outputs.

    Parameters
    ----------
    stiffness
        Stiffness of the drives (N m/rad): one for all inputs, or one for each.
    time
        Time (s) at which loads that depend on it are evaluated.
    """

    name = "statics"
    version = "1"
    summary = "holding torques, mechanical advantage, stiffness of outputs"
    rowwise = True
    tables = (
        Table(
            "statics",
            "one row per sample and assembly mode",
            (SAMPLE, ASSEMBLY_MODE, INPUTS, HOLDING_TORQUES, RESIDUAL, STATUS),
        ),
        Table(
            "outputs",
            "one row per sample, assembly mode and output",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("output", "", "name of the output", "text"),
                ADVANTAGES,
                *(
                    column
                    for number, words in enumerate(PRINCIPAL_STIFFNESSES, 1)
                    for column in (
                        Column(
                            f"stiffness_{number}",
                            "N m/rad",
                            f"{words} principal stiffness of the output (moment per "
                            "angle about a principal axis) while the inputs are held; "
                            "infinite if the output cannot turn about this axis",
                        ),
                        *(
                            Column(
                                f"axis_{number}_{axis}",
                                "",
                                f"{axis} component, in ground axes, of the axis of the "
                                f"{words} principal stiffness; empty if this stiffness "
                                "is infinite",
                                turns="vector",
                            )
                            for axis in "xyz"
                        ),
                    )
                ),
                STATUS,
            ),
        ),
    )

    stiffness: tuple[float, ...] = (1.0,)
    time: Seconds = 0.0

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check the parameters, and return what this analysis reads of a run.

        The analysis reads the position analysis of the run (`tracer`), and variables of
        pairs (joints) without jumps of 2 pi. Loads such as springs depend on these
        variables. The links are those on which masses and loads act, and both links of each
        output.

        Raises
        ------
        AnalysisError
            If a parameter is not valid for the mechanism.
        """
        # This call only raises an error if a parameter is not valid.
        self._drive_stiffness(mechanism)
        output_links: set[int] = set()
        for output in mechanism.outputs:
            output_links.add(mechanism.link_number[output.link])
            output_links.add(mechanism.link_number[output.relative_to])
        return Needs(
            tracer=True,
            links=acting_links(mechanism) | output_links,
            continued_values=used_pairs(mechanism),
        )

    def _drive_stiffness(self, mechanism: Mechanism) -> Floats:
        """Check all parameters, and return the stiffness (inputs,) of the drives (N m/rad).

        Raises
        ------
        AnalysisError
            If the parameters `stiffness` or `time` are not valid for the mechanism.
        """
        inputs = mechanism.input_pairs
        stiffness = np.array(self.stiffness, dtype=float)
        has_valid_count = len(stiffness) in (1, len(inputs))
        if not has_valid_count or not np.all((stiffness > 0.0) & (stiffness < np.inf)):
            raise AnalysisError(
                f"statics: stiffness: found {'+'.join(f'{x:g}' for x in stiffness)}, "
                f"expected one number above 0 N m/rad, or one for each input "
                f"({listing(inputs)})"
            )
        if not np.isfinite(self.time):
            raise AnalysisError(
                f"statics: time: found {self.time}, expected a finite time, s"
            )
        return np.broadcast_to(stiffness, (len(inputs),))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torques and of the outputs.

        The table ``statics`` has a row for each row of the batch (sample in one assembly
        mode). The columns are the torques and the closure residual.

        The table ``outputs`` has, for each row of the batch, a row for each output. The
        columns are the mechanical advantage of each input, and the stiffness of the output
        if the drives are elastic.
        The stiffness is a symmetric matrix: torque on the output per rotation. The columns
        have the three principal values of the matrix and their axes.
        """
        # The torques at the inputs that hold the mechanism at rest against all loads.
        solution = self._holding_solution(batch)
        mechanism = batch.mechanism
        row_identity = row_columns(batch)
        stiffness_of_output = self._output_stiffness(batch)
        results = list(stiffness_of_output.values())
        row_count, input_count = solution.torques.shape
        # `_interleave` lists the first row of all outputs, then the second row, and so on.
        # If there are no outputs, the lists are empty, so the shape is passed as well.
        advantages = _interleave(
            [result.advantage for result in results], (row_count, input_count)
        )
        stiffness = _interleave([result.stiffness for result in results], (row_count, 3))
        axes = _interleave([result.axes for result in results], (row_count, 3, 3))
        # `axes` has the axes: row of the table, principal axis, component.
        principal_columns: dict[str, NDArray[Any]] = {}
        for number in range(3):
            principal_columns[f"stiffness_{number + 1}"] = stiffness[:, number]
            for component, axis in enumerate("xyz"):
                column = axes[:, number, component]
                principal_columns[f"axis_{number + 1}_{axis}"] = column
        # Advantage and stiffness follow from velocities per unit rate of each input, not
        # from loads. The status is therefore that of the rates.
        output_status = np.repeat(solution.rate_status, len(results))
        return {
            "statics": {
                **row_identity,
                **input_columns(mechanism, solution.torques, "tau"),
                "residual": batch.residual,
                "status": solution.status,
            },
            "outputs": {
                **repeat_rows(row_identity, list(stiffness_of_output), "output"),
                **input_columns(mechanism, advantages, "advantage"),
                **principal_columns,
                "status": output_status,
            },
        }

    def _holding_solution(self, batch: Batch) -> InverseSolution:
        """Return the holding torques of a batch, which are computed once."""
        return batch.once(
            "torques", lambda: holding_torques(continue_load_angles(batch), self.time)
        )

    def _output_stiffness(self, batch: Batch) -> Mapping[str, Stiffness]:
        """Return the stiffness by name of the output. It is computed once."""
        solution = self._holding_solution(batch)
        drive_stiffness = self._drive_stiffness(batch.mechanism)
        return batch.once(
            "outputs",
            lambda: {
                output.name: output_stiffness(
                    solution, output.link, output.relative_to, drive_stiffness
                )
                for output in batch.mechanism.outputs
            },
        )

    def findings(self, batch: Batch) -> Findings:
        """Return the largest holding torque at each input."""
        torques = self._holding_solution(batch).sure_torques
        has_loads = bool(batch.mechanism.loads)
        largest: dict[str, Any] = {}
        if has_loads:
            largest = find_largest_torques(batch, torques, LARGEST_HOLDING_TORQUE)
        return _make_findings(largest, has_loads)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of two blocks of rows."""
        largest = merge_largest_torques(
            before.figures["inputs"], now.figures["inputs"], LARGEST_HOLDING_TORQUE
        )
        return _make_findings(largest, now.figures["loads"])

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of holding torques, mechanical advantage and stiffness."""
        solution = self._holding_solution(batch)
        plots = []
        # Arguments of `plot_series`: folder, label of the curve, title, values, unit.
        for number, name in enumerate(batch.moving_inputs):
            torque = solution.torques[:, number]
            plots.append(
                plot_series("torque", f"at {name}", "holding torques", torque, "N m")
            )
        for output, result in self._output_stiffness(batch).items():
            for number, name in enumerate(batch.moving_inputs):
                label = f"{output} by {name}"
                advantage = result.advantage[:, number]
                plots.append(
                    plot_series("advantage", label, "mechanical advantage", advantage)
                )
            for number, rank in enumerate(PRINCIPAL_STIFFNESSES):
                stiffness = result.stiffness[:, number]
                if np.any(np.isfinite(stiffness)):
                    label = f"{output}, {rank}"
                    title = "principal stiffness"
                    plots.append(
                        plot_series("stiffness", label, title, stiffness, "N m/rad")
                    )
        return plots_by_mode(batch, plots)


def _make_findings(largest: Mapping[str, Any], has_loads: bool) -> Findings:
    """Return what the analysis reports: the largest holding torques, also as sentences.

    Parameters
    ----------
    largest
        The largest holding torque by input, from `find_largest_torques`.
    has_loads
        Whether the mechanism has loads.
    """
    remarks = describe_largest_torques(largest, LARGEST_HOLDING_TORQUE, "holding torque")
    if not has_loads:
        remarks = ("The file has no loads, so there is nothing to hold; see [loads.NAME]",)
    return Findings({"inputs": largest, "loads": has_loads}, (), remarks)


def _interleave(arrays: Sequence[Floats], shape: tuple[int, ...]) -> Floats:
    """Return the rows of k arrays in turn: row 0 of each array, then row 1, and so on.

    Parameters
    ----------
    arrays
        The k arrays; there may be none.
    shape
        The common shape (n, ...) of the arrays.

    Returns
    -------
    (n k, ...) rows.
    """
    stacked = np.reshape(arrays, (len(arrays), *shape))
    return stacked.swapaxes(0, 1).reshape(-1, *shape[1:])
