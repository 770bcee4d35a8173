"""Equations of motion of any number of inputs: inertia matrix, loads, driving torques."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

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

from .of_rows import (
    as_loads_see,
    curve,
    largest_of,
    largest_torques,
    plotted,
    repeated,
    row_columns,
    said_of_torques,
)

RATES = Column("dq", "rad/s", "rate of the variable of", per_input=True)
ACCELERATIONS = Column("ddq", "rad/s2", "acceleration of the variable of", per_input=True)
TORQUES = Column("tau", "N m", "driving torque at", per_input=True)
FORCES = Column("Q", "N m", "generalised force of all loads at", per_input=True)
PARTS = Column("Q", "N m", "part of the load in the generalised force at", per_input=True)
DERIVATIVES = Column("dM", "kg m2/rad", "derivative of the entry by", per_input=True)


@final
@dataclass(frozen=True, kw_only=True)
class Dynamics(AbstractAnalysis):
    """Torques at all inputs as they move: by their laws, or from the motion itself.

    Without laws the inputs go along the straight path through their ranges, the fastest at
    1 rad/s. For a motion that follows from its loads they are the torques that act at the
    inputs beside these.
    """

    name: ClassVar[str] = "dynamics"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "inertia matrix, loads and driving torques of all inputs"
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
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
                Column("kinetic", "J", "kinetic energy"),
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
        solution, mechanism = self._found(batch), batch.mechanism
        inputs, loads = batch.moving_inputs, [load.name for load in mechanism.loads]
        m, timed = len(inputs), row_columns(batch, timed=True)
        rows, columns = np.triu_indices(m)
        ones = [inputs[row] for row in rows]
        slopes = solution.dM[:, rows, columns]
        forces = np.swapaxes(solution.Q_parts, 1, 2)
        return {
            "dynamics": {
                **timed,
                **input_columns(mechanism, batch.input_rates, "dq"),
                **input_columns(mechanism, batch.input_accelerations, "ddq"),
                **input_columns(mechanism, solution.torques, "tau"),
                **input_columns(mechanism, solution.Q_all, "Q"),
                "kinetic": solution.kinetic,
                "power": np.sum(solution.torques * batch.input_rates, axis=1),
                "residual": batch.residual,
                "status": solution.status,
            },
            "inertia": {
                **repeated(row_columns(batch), ones, "row"),
                "column": np.tile(np.array(inputs, dtype=str)[columns], len(batch)),
                "M": solution.M[:, rows, columns].ravel(),
                **input_columns(mechanism, slopes.reshape(-1, m), "dM"),
                "status": of_parts(solution.M[:, rows, columns], solution.status).ravel(),
            },
            "loads": {
                **repeated(timed, loads, "load"),
                **input_columns(mechanism, forces.reshape(-1, m), "Q"),
                "power": solution.power.ravel(),
                "status": of_parts(solution.power, solution.status).ravel(),
            },
        }

    def _found(self, batch: Batch) -> InverseSolution:
        return batch.once("torques", lambda: needed_torques(as_loads_see(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque at each input, and where that is."""
        solution, mechanism = self._found(batch), batch.mechanism
        figures = largest_torques(batch, solution.sure_torques, "largest_torque_Nm")
        lost = int(np.count_nonzero(solution.status == Status.AT_SINGULARITY))
        return _said(figures, lost, bool(mechanism.masses), bool(mechanism.loads))

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of both."""
        both = before.figures["inputs"], now.figures["inputs"]
        figures = largest_of(*both, "largest_torque_Nm")
        lost = sum(item.figures["rows_at_singularities"] for item in (before, now))
        return _said(figures, lost, now.figures["masses"], now.figures["loads"])

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of torques, of the entries of the inertia matrix and of power."""
        solution, inputs = self._found(batch), batch.moving_inputs
        curves = [
            curve("torque", f"at {name}", "driving torques", solution.torques[:, k], "N m")
            for k, name in enumerate(inputs)
        ]
        for i, one in enumerate(inputs):
            for k, other in enumerate(inputs[i:], i):
                label, entry = f"M {one} {other}", solution.M[:, i, k]
                curves.append(curve("inertia", label, "inertia matrix", entry, "kg m2"))
        power = np.sum(solution.torques * batch.input_rates, axis=1)
        curves.append(curve("power", "driving torques", "power", power, "W"))
        for k, load in enumerate(batch.mechanism.loads):
            curves.append(curve("power", load.name, "power", solution.power[:, k], "W"))
        return plotted(batch, curves)


def _said(figures: Mapping[str, Any], lost: int, masses: bool, loads: bool) -> Findings:
    remarks = said_of_torques(figures, "largest_torque_Nm", "driving torque")
    if not masses:
        remarks.append("the file has no masses: the torques are against loads alone")
    if not loads:
        remarks.append("the file has no loads: the torques are against inertia alone")
    warnings = (
        (
            f"in {lost} {'row' if lost == 1 else 'rows'} the inputs do not hold the "
            "mechanism, so that no torques at them do it (AT_SINGULARITY)",
        )
        if lost
        else ()
    )
    return Findings(
        {
            "inputs": dict(figures),
            "rows_at_singularities": lost,
            "masses": masses,
            "loads": loads,
        },
        warnings,
        tuple(remarks),
    )
