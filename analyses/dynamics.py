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
    merge_largest,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

RATES = Column("dq", "rad/s", "rate of the variable of", per_input=True)
ACCELERATIONS = Column("ddq", "rad/s2", "acceleration of the variable of", per_input=True)
TORQUES = Column("tau", "N m", "driving torque at", per_input=True)
FORCES = Column("Q", "N m", "generalised force of all loads at", per_input=True)
PARTS = Column("Q", "N m", "part of the load in the generalised force at", per_input=True)
DERIVATIVES = Column("dM", "kg m2/rad", "derivative of the entry by", per_input=True)


@dataclass(frozen=True, kw_only=True)
class Dynamics(AbstractAnalysis):
    """Torques at all inputs as they move: by their laws, or from the motion itself.

    Without laws the inputs go along the straight path through their ranges, the fastest at
    1 rad/s. For a motion that follows from its loads they are the torques that act at the
    inputs beside these.
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
                TORQUES,
                FORCES,
                Column("kinetic_energy", "J", "kinetic energy"),
                Column("power", "W", "power of all driving torques"),
                RESIDUAL,
                STATUS,
            ),
        ),
        Table(
            "inertia",
            "one row per sample, assembly mode and two inputs",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("row", "", "the one input", "text"),
                Column("column", "", "the other input, or the same", "text"),
                Column("M", "kg m2", "entry of the inertia matrix"),
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
                Column("load", "", "the load", "text"),
                PARTS,
                Column("power", "W", "its power"),
                STATUS,
            ),
        ),
    )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the motion in time, with the variables that loads see."""
        need_terms(mechanism)
        return Needs(
            time=True,
            tracer=True,
            links=acting_links(mechanism),
            continued_values=used_pairs(mechanism),
        )

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torques, of the inertia matrix and of the loads."""
        solution = self._found(batch)
        mechanism = batch.mechanism
        inputs = batch.moving_inputs
        loads = [load.name for load in mechanism.loads]
        m = len(inputs)
        timed = row_columns(batch, with_time=True)
        rows, columns = np.triu_indices(m)
        entries = solution.M[:, rows, columns]
        slopes = solution.dM[:, rows, columns]
        forces = np.swapaxes(solution.Q_parts, 1, 2)
        return {
            "dynamics": {
                **timed,
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
                **repeat_rows(row_columns(batch), [inputs[row] for row in rows], "row"),
                "column": np.tile(np.array(inputs)[columns], len(batch)),
                "M": entries.ravel(),
                **input_columns(mechanism, slopes.reshape(-1, m), "dM"),
                "status": of_parts(entries, solution.status).ravel(),
            },
            "loads": {
                **repeat_rows(timed, loads, "load"),
                **input_columns(mechanism, forces.reshape(-1, m), "Q"),
                "power": solution.power.ravel(),
                "status": of_parts(solution.power, solution.status).ravel(),
            },
        }

    def _found(self, batch: Batch) -> InverseSolution:
        return batch.once("torques", lambda: needed_torques(continue_load_angles(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque at each input, and where that is."""
        solution = self._found(batch)
        mechanism = batch.mechanism
        lost = solution.status == Status.AT_SINGULARITY
        figures = {
            "inputs": find_largest_torques(
                batch, solution.sure_torques, "largest_torque_Nm"
            ),
            "rows_at_singularities": int(np.count_nonzero(lost)),
            "masses": bool(mechanism.masses),
            "loads": bool(mechanism.loads),
        }
        return _said(figures)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of both."""
        lost = sum(item.figures["rows_at_singularities"] for item in (before, now))
        largest = merge_largest(
            before.figures["inputs"], now.figures["inputs"], "largest_torque_Nm"
        )
        return _said({**now.figures, "inputs": largest, "rows_at_singularities": lost})

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of torques, of the entries of the inertia matrix and of power."""
        solution = self._found(batch)
        inputs = batch.moving_inputs
        curves = [
            plot_series(
                "torque", f"at {name}", "driving torques", solution.torques[:, k], "N m"
            )
            for k, name in enumerate(inputs)
        ]
        for i, one in enumerate(inputs):
            for k, other in enumerate(inputs[i:], i):
                label = f"M {one} {other}"
                entry = solution.M[:, i, k]
                curves.append(
                    plot_series("inertia", label, "inertia matrix", entry, "kg m2")
                )
        power = np.vecdot(solution.torques, batch.input_rates)
        curves.append(plot_series("power", "driving torques", "power", power, "W"))
        for k, load in enumerate(batch.mechanism.loads):
            curves.append(
                plot_series("power", load.name, "power", solution.power[:, k], "W")
            )
        return plots_by_mode(batch, curves)


def _said(figures: Mapping[str, Any]) -> Findings:
    remarks = describe_largest_torques(
        figures["inputs"], "largest_torque_Nm", "driving torque"
    )
    for given, other in (("masses", "loads"), ("loads", "inertia")):
        if not figures[given]:
            remarks += (f"the file has no {given}: the torques are against {other} alone",)
    warnings: tuple[str, ...] = ()
    if figures["rows_at_singularities"]:
        warnings = (
            f"in {counted(figures['rows_at_singularities'], 'row')} the inputs do not hold "
            "the mechanism, so that no torques at them do it (AT_SINGULARITY)",
        )
    return Findings(figures, warnings, remarks)
