"""Equations of motion of any number of inputs: inertia matrix, loads, driving torques."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    AbstractAnalysis,
    Batch,
    Column,
    Findings,
    Mechanism,
    Needs,
    Scene,
    Status,
    Table,
    TableData,
    counted,
    input_columns,
)
from spherekit.plugin.dynamics import (
    InverseSolution,
    acting_links,
    need_terms,
    needed_torques,
    of_parts,
    used_pairs,
)

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

TORQUE_KEY = "largest_torque_Nm"
"""Key of the largest torque at an input in the summary."""
RATES = Column("dq", "rad/s", "angular velocity of the driven pair", per_input=True)
ACCELERATIONS = Column(
    "ddq",
    "rad/s2",
    "angular acceleration of the driven pair",
    per_input=True,
)
DRIVING_TORQUES = Column(
    "tau", "N m", "driving torque (torque of the motor) at the driven pair", per_input=True
)
FORCES = Column(
    "Q",
    "N m",
    "generalised force: power of all loads per unit angular velocity of the driven pair",
    per_input=True,
)
PARTS = Column(
    "Q",
    "N m",
    "generalised force: power of the load per unit angular velocity of the driven pair",
    per_input=True,
)
DERIVATIVES = Column(
    "dM",
    "kg m2/rad",
    "derivative of the entry M with respect to the angle of the driven pair",
    per_input=True,
)


@dataclass(frozen=True, kw_only=True)
class Dynamics(AbstractAnalysis):
    """Torques at all inputs while the inputs move by their laws, or as the motion says.

    Without laws the inputs go along the straight path through their ranges, the fastest at
    1 rad/s. For a motion that follows from its loads they are the torques that act at the
    inputs in addition to the loads.
    """

    name = "dynamics"
    version = "1"
    summary = "inertia matrix, loads and driving torques of all inputs"
    rowwise = True
    tables = (
        Table(
            "dynamics",
            "one row per sample and assembly mode",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                RATES,
                ACCELERATIONS,
                DRIVING_TORQUES,
                FORCES,
                Column("kinetic_energy", "J", "kinetic energy of the mechanism"),
                Column("power", "W", "total power of the driving torques at all inputs"),
                RESIDUAL,
                STATUS,
            ),
        ),
        Table(
            "inertia",
            "one row per sample, assembly mode and entry in the upper triangle of the "
            "inertia matrix",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column(
                    "row", "", "driven pair to which the row of the entry M belongs", "text"
                ),
                Column(
                    "column",
                    "",
                    "driven pair to which the column of the entry M belongs",
                    "text",
                ),
                Column(
                    "M",
                    "kg m2",
                    "one entry of the symmetric inertia matrix; the kinetic energy is w^T "
                    "times this matrix times w / 2, where the vector w contains the "
                    "angular velocities of all inputs",
                ),
                DERIVATIVES,
                STATUS,
            ),
        ),
        Table(
            "loads",
            "one row per sample, assembly mode and load",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                Column("load", "", "name of the load in the mechanism file", "text"),
                PARTS,
                Column("power", "W", "power of the load"),
                STATUS,
            ),
        ),
    )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the quantities that this analysis reads, so that a run computes them.

        Raises
        ------
        ModelError
            If the mechanism has neither masses nor loads.
        """
        # This call raises the `ModelError` if there are neither masses nor loads.
        need_terms(mechanism)
        return Needs(
            # The time, and the rates and accelerations of the inputs.
            time=True,
            # Variables, with whole revolutions, on which loads such as springs depend.
            continued_values=used_pairs(mechanism),
            # The position analysis of the run. The inertia matrix is computed from it.
            tracer=True,
            # The links that have mass or loads.
            links=acting_links(mechanism),
        )

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torques, of the inertia matrix and of the loads.

        The batch has n rows. For each row the first table has one row, and the third table
        one row for each load. The second table has one row for each entry of the upper
        triangle of the inertia matrix.
        """
        # The solution has the inertia matrix M (n, inputs, inputs) and its derivatives
        # dM with respect to the inputs (last axis). Q_all (n, inputs) are the
        # generalised forces of all loads together, and Q_parts (n, inputs, loads) those
        # of each load.
        solution = self._inverse_solution(batch)
        mechanism = batch.mechanism
        inputs = batch.moving_inputs
        input_count = len(inputs)
        load_names = [load.name for load in mechanism.loads]
        row_identity = row_columns(batch, with_time=True)
        # The inertia matrix is symmetric, so the table has its upper triangle. An entry is
        # named by the inputs of its row and of its column.
        rows, columns = np.triu_indices(input_count)
        row_inputs = [inputs[row] for row in rows]
        entries = solution.M[:, rows, columns]
        entry_derivatives = solution.dM[:, rows, columns]
        # From (n, inputs, loads) to (n, loads, inputs).
        load_forces = np.swapaxes(solution.Q_parts, 1, 2)
        return {
            "dynamics": {
                **row_identity,
                **input_columns(mechanism, batch.input_rates, "dq"),
                **input_columns(mechanism, batch.input_accelerations, "ddq"),
                **input_columns(mechanism, solution.torques, "tau"),
                **input_columns(mechanism, solution.Q_all, "Q"),
                "kinetic_energy": solution.kinetic,
                "power": np.vecdot(solution.torques, batch.input_rates),
                "residual": batch.residual,
                "status": solution.status,
            },
            "inertia": {
                **repeat_rows(row_columns(batch), row_inputs, "row"),
                "column": np.tile(np.array(inputs)[columns], len(batch)),
                "M": entries.ravel(),
                **input_columns(
                    mechanism, entry_derivatives.reshape(-1, input_count), "dM"
                ),
                # Finite entries have the status OK, even if the torques of the row failed.
                # Any other entry has the status of its row.
                "status": of_parts(entries, solution.status).ravel(),
            },
            "loads": {
                **repeat_rows(row_identity, load_names, "load"),
                **input_columns(mechanism, load_forces.reshape(-1, input_count), "Q"),
                "power": solution.power.ravel(),
                "status": of_parts(solution.power, solution.status).ravel(),
            },
        }

    def _inverse_solution(self, batch: Batch) -> InverseSolution:
        """Return inertia, loads and torques of a batch, which are computed once."""
        return batch.once("torques", lambda: needed_torques(continue_load_angles(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque at each input, and where it occurs."""
        solution = self._inverse_solution(batch)
        mechanism = batch.mechanism
        is_lost = solution.status == Status.AT_SINGULARITY
        summary = {
            "inputs": find_largest_torques(batch, solution.sure_torques, TORQUE_KEY),
            "rows_at_singularities": int(np.count_nonzero(is_lost)),
            "masses": bool(mechanism.masses),
            "loads": bool(mechanism.loads),
        }
        return _make_findings(summary)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of two blocks of rows (parts of a long run)."""
        lost_rows = sum(
            findings.figures["rows_at_singularities"] for findings in (before, now)
        )
        largest = merge_largest_torques(
            before.figures["inputs"], now.figures["inputs"], TORQUE_KEY
        )
        return _make_findings(
            {**now.figures, "inputs": largest, "rows_at_singularities": lost_rows}
        )

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of torques, of the entries of the inertia matrix and of power.

        There is a page for each assembly mode (way to assemble the links). Every plot shows
        its values over the rows of the batch.
        """
        solution = self._inverse_solution(batch)
        inputs = batch.moving_inputs
        plots = []
        # Arguments of `plot_series`: folder, label of the curve, title, values, unit.
        for number, name in enumerate(inputs):
            torque = solution.torques[:, number]
            plots.append(
                plot_series("torque", f"at {name}", "driving torques", torque, "N m")
            )
        # The matrix is symmetric: only its upper triangle is drawn.
        for row, first in enumerate(inputs):
            for column, second in enumerate(inputs[row:], row):
                label = f"M {first} {second}"
                entry = solution.M[:, row, column]
                plots.append(
                    plot_series("inertia", label, "inertia matrix", entry, "kg m2")
                )
        power = np.vecdot(solution.torques, batch.input_rates)
        plots.append(plot_series("power", "driving torques", "power", power, "W"))
        for number, load in enumerate(batch.mechanism.loads):
            load_power = solution.power[:, number]
            plots.append(plot_series("power", load.name, "power", load_power, "W"))
        return plots_by_mode(batch, plots)


def _make_findings(summary: Mapping[str, Any]) -> Findings:
    """Return the findings: the summary with sentences and warnings for users.

    Parameters
    ----------
    summary
        The largest torque at each input ("inputs"), the number of rows at singularities,
        and whether the file has masses and loads.
    """
    remarks = describe_largest_torques(summary["inputs"], TORQUE_KEY, "driving torque")
    if not summary["masses"]:
        remarks += ("The file has no masses: the torques balance only the loads",)
    if not summary["loads"]:
        remarks += ("The file has no loads: the torques balance only the inertia",)
    warnings: tuple[str, ...] = ()
    # At a singularity the mechanism can move while the inputs rest.
    if summary["rows_at_singularities"]:
        warnings = (
            f"In {counted(summary['rows_at_singularities'], 'row')} the inputs do not hold "
            "the mechanism, so no torques at them can balance the loads (AT_SINGULARITY)",
        )
    return Findings(summary, warnings, remarks)
