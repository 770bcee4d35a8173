"""Equations of motion of any number of inputs: inertia matrix, loads, driving torques."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

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
    Series,
    Status,
    Table,
    TableData,
    input_columns,
)
from spherekit.plugin.dynamics import (
    InverseSolution,
    need_terms,
    needed_torques,
    used_pairs,
)

from .load_motion import as_loads_see

Floats = NDArray[np.float64]

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
        return Needs(time=True, tracer=True, continued_values=used_pairs(mechanism))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torques, of the inertia matrix and of the loads."""
        solution, mechanism = self._found(batch), batch.mechanism
        inputs, loads = batch.moving_inputs, [load.name for load in mechanism.loads]
        count, m = len(batch), len(inputs)
        common = {"sample": batch.sample, "assembly_mode": batch.assembly_mode}
        timed = {**common, "t": batch.t}
        q = input_columns(mechanism, batch.inputs, "q")
        pairs = m * (m + 1) // 2
        rows, columns = np.triu_indices(m)
        names = np.array(inputs, dtype=str)
        slopes = solution.dM[:, rows, columns]
        forces = np.swapaxes(solution.Q_parts, 1, 2)
        return {
            "dynamics": {
                **timed,
                **q,
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
                **_repeated({**common, **q}, pairs),
                "row": np.tile(names[rows], count),
                "column": np.tile(names[columns], count),
                "M": solution.M[:, rows, columns].ravel(),
                **input_columns(mechanism, slopes.reshape(-1, m), "dM"),
                "status": np.repeat(solution.status, pairs),
            },
            "loads": {
                **_repeated({**timed, **q}, len(loads)),
                "load": np.tile(np.array(loads, dtype=str), count),
                **input_columns(mechanism, forces.reshape(-1, m), "Q"),
                "power": solution.power.ravel(),
                "status": np.repeat(solution.status, len(loads)),
            },
        }

    def _found(self, batch: Batch) -> InverseSolution:
        return batch.once("torques", lambda: needed_torques(as_loads_see(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque at each input, and where that is."""
        solution, figures = self._found(batch), {}
        for k, name in enumerate(batch.moving_inputs):
            torque = np.abs(solution.torques[:, k])
            if not np.any(np.isfinite(torque)):
                continue
            row = int(np.nanargmax(torque))
            figures[name] = {
                "largest_torque_Nm": float(solution.torques[row, k]),
                "at_sample": int(batch.sample[row]),
                "at_assembly_mode": int(batch.assembly_mode[row]),
                "at_rad": [float(x) for x in batch.inputs[row]],
            }
        lost = int(np.count_nonzero(solution.status == Status.AT_SINGULARITY))
        return _said(figures, lost)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of both."""
        figures = dict(before.figures.get("inputs", {}))
        for name, largest in now.figures.get("inputs", {}).items():
            old = figures.get(name)
            if old is None or abs(largest["largest_torque_Nm"]) > abs(
                old["largest_torque_Nm"]
            ):
                figures[name] = largest
        lost = sum(item.figures.get("rows_at_singularities", 0) for item in (before, now))
        return _said(figures, lost)

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of torques, of the entries of the inertia matrix and of power."""
        solution, inputs = self._found(batch), batch.moving_inputs
        curves: list[tuple[str, str, str, Floats, str]] = []
        for k, name in enumerate(inputs):
            curves.append(
                ("torque", f"at {name}", "driving torques", solution.torques[:, k], "N m")
            )
        for i, one in enumerate(inputs):
            for k, other in enumerate(inputs[i:], i):
                label = f"M {one} {other}"
                curves.append(
                    ("inertia", label, "inertia matrix", solution.M[:, i, k], "kg m2")
                )
        power = np.sum(solution.torques * batch.input_rates, axis=1)
        curves.append(("power", "driving torques", "power", power, "W"))
        for k, load in enumerate(batch.mechanism.loads):
            curves.append(("power", load.name, "power", solution.power[:, k], "W"))
        return tuple(
            Scene(
                number,
                tuple(
                    Series(
                        f"plots/{group}/{label.replace(' ', '_')}",
                        label,
                        title,
                        values[rows],
                        unit,
                        None,
                    )
                    for group, label, title, values, unit in curves
                ),
            )
            for number, rows in batch.assembly_mode_rows().items()
        )


def _said(figures: Mapping[str, Any], lost: int) -> Findings:
    remarks = tuple(
        f"largest driving torque at {name}: {largest['largest_torque_Nm']:.6g} N m at "
        f"sample {largest['at_sample']} of assembly mode {largest['at_assembly_mode']}"
        for name, largest in figures.items()
    )
    warnings = (
        (
            f"in {lost} {'row' if lost == 1 else 'rows'} the inputs do not hold the "
            "mechanism, so that no torques at them do it (AT_SINGULARITY)",
        )
        if lost
        else ()
    )
    return Findings(
        {"inputs": dict(figures), "rows_at_singularities": lost}, warnings, remarks
    )


def _repeated(columns: dict[str, NDArray[Any]], count: int) -> dict[str, NDArray[Any]]:
    return {name: np.repeat(values, count) for name, values in columns.items()}
