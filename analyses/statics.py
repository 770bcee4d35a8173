"""Mechanisms at rest: holding torques, mechanical advantage and stiffness of outputs."""

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

LARGEST = "largest_holding_torque_Nm"

TORQUES = Column("tau", "N m", "torque that holds against all loads at", per_input=True)
ADVANTAGES = Column(
    "advantage",
    "",
    "moment on the output that a unit torque balances, the others locked, at",
    per_input=True,
)


@dataclass(frozen=True, kw_only=True)
class Statics(AbstractAnalysis):
    """Torques that hold the mechanism at rest, and how stiffly the inputs hold outputs.

    `stiffness` is that of the drives in N m/rad: one for all inputs, or one for each.
    `time` (s) is when loads that depend on it are taken.
    """

    name = "statics"
    version = "1"
    summary = "holding torques, mechanical advantage, stiffness of outputs"
    rowwise = True
    tables = (
        Table(
            "statics",
            "one row per sample and assembly mode",
            (SAMPLE, ASSEMBLY_MODE, INPUTS, TORQUES, RESIDUAL, STATUS),
        ),
        Table(
            "outputs",
            "one row per sample, assembly mode and output",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("output", "", "the output", "text"),
                ADVANTAGES,
                *(
                    column
                    for number, words in enumerate(("least", "middle", "largest"), 1)
                    for column in (
                        Column(
                            f"stiffness_{number}",
                            "N m/rad",
                            f"{words} principal stiffness of the output; infinite "
                            "where no input yields",
                        ),
                        *(
                            Column(
                                f"axis_{number}_{axis}",
                                "",
                                f"its axis in ground axes, {axis}; empty where it does not "
                                "yield",
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
    time: float = 0.0

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the configurations, with the variables that loads see."""
        self._each(mechanism)
        outputs = {name for o in mechanism.outputs for name in (o.link, o.relative_to)}
        return Needs(
            tracer=True,
            links=acting_links(mechanism) | {mechanism.link_number[o] for o in outputs},
            continued_values=used_pairs(mechanism),
        )

    def _each(self, mechanism: Mechanism) -> Floats:
        """Return the stiffness (inputs,) of each input."""
        inputs = mechanism.input_pairs
        given = np.array(self.stiffness, dtype=float)
        if len(given) not in (1, len(inputs)) or not np.all(
            (given > 0.0) & (given < np.inf)
        ):
            raise AnalysisError(
                f"statics: stiffness: found {'+'.join(f'{x:g}' for x in given)}, needs one "
                f"number above 0 N m/rad, or one for each input ({listing(inputs)})"
            )
        if not np.isfinite(self.time):
            raise AnalysisError(f"statics: time: found {self.time}, needs a finite time, s")
        return np.broadcast_to(given, (len(inputs),))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torques and of the outputs."""
        solution = self._found(batch)
        mechanism = batch.mechanism
        common = row_columns(batch)
        outputs = self._outputs(batch)
        held = list(outputs.values())
        n = len(batch)
        advantages = _beside([x.advantage for x in held], solution.torques.shape)
        sizes = _beside([x.stiffness for x in held], (n, 3))
        axes = _beside([x.axes for x in held], (n, 3, 3))
        principal: dict[str, NDArray[Any]] = {}
        for number in range(3):
            principal[f"stiffness_{number + 1}"] = sizes[:, number]
            for k, axis in enumerate("xyz"):
                principal[f"axis_{number + 1}_{axis}"] = axes[:, number, k]
        return {
            "statics": {
                **common,
                **input_columns(mechanism, solution.torques, "tau"),
                "residual": batch.residual,
                "status": solution.status,
            },
            "outputs": {
                **repeat_rows(common, list(outputs), "output"),
                **input_columns(mechanism, advantages, "advantage"),
                **principal,
                "status": np.repeat(solution.rate_status, len(outputs)),
            },
        }

    def _found(self, batch: Batch) -> InverseSolution:
        return batch.once(
            "torques", lambda: holding_torques(continue_load_angles(batch), self.time)
        )

    def _outputs(self, batch: Batch) -> Mapping[str, Stiffness]:
        solution = self._found(batch)
        drives = self._each(batch.mechanism)
        return batch.once(
            "outputs",
            lambda: {
                output.name: output_stiffness(
                    solution, output.link, output.relative_to, drives
                )
                for output in batch.mechanism.outputs
            },
        )

    def findings(self, batch: Batch) -> Findings:
        """Return the largest holding torque at each input."""
        torques = self._found(batch).sure_torques
        loads = bool(batch.mechanism.loads)
        return _said(find_largest_torques(batch, torques, LARGEST) if loads else {}, loads)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger torques of both."""
        largest = merge_largest(before.figures["inputs"], now.figures["inputs"], LARGEST)
        return _said(largest, now.figures["loads"])

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of holding torques, mechanical advantage and stiffness."""
        solution = self._found(batch)
        curves = [
            plot_series(
                "torque", f"at {name}", "holding torques", solution.torques[:, k], "N m"
            )
            for k, name in enumerate(batch.moving_inputs)
        ]
        for output, held in self._outputs(batch).items():
            for k, name in enumerate(batch.moving_inputs):
                label = f"{output} by {name}"
                values = held.advantage[:, k]
                curves.append(
                    plot_series("advantage", label, "mechanical advantage", values)
                )
            for k, word in enumerate(("least", "middle", "largest")):
                values = held.stiffness[:, k]
                if np.any(np.isfinite(values)):
                    label = f"{output}, {word}"
                    title = "principal stiffness"
                    curves.append(plot_series("stiffness", label, title, values, "N m/rad"))
        return plots_by_mode(batch, curves)


def _said(largest: Mapping[str, Any], loads: bool) -> Findings:
    remarks = describe_largest_torques(largest, LARGEST, "holding torque")
    if not loads:
        remarks = ("the file has no loads, so there is nothing to hold; see [loads.NAME]",)
    return Findings({"inputs": largest, "loads": loads}, (), remarks)


def _beside(parts: Sequence[Floats], shape: tuple[int, ...]) -> Floats:
    """Return k arrays of one shape (n, ...) as rows (n k, ...), one of each in turn."""
    whole = np.reshape(parts, (len(parts), *shape))
    return whole.swapaxes(0, 1).reshape(-1, *shape[1:])
