"""The table of the configurations of a run, one row per sample and assembly mode."""

from collections.abc import Sequence
from typing import Any

from spherekit.analysis.batch import run_status
from spherekit.analysis.result import MOTION
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.running.sampling import Sampling
from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    Column,
    Table,
    TableArrays,
    input_columns,
)
from spherekit.motion.motion import Motion
from spherekit.rates.pole_field import PoleField


def motion_table(course: Sampling) -> Table:
    """Return the table of the configurations of a course."""
    mechanism = course.tracer.mechanism
    variables = [
        Column(name, "rad", f"variable of pair {mechanism.pairs[owner].name}")
        for name, owner in zip(
            mechanism.variable_names, mechanism.variable_owners, strict=True
        )
    ]
    return Table(
        MOTION,
        "the configurations: one row per sample and assembly mode",
        (
            SAMPLE,
            ASSEMBLY_MODE,
            *([TIME] if course.timed else []),
            INPUTS,
            *variables,
            RESIDUAL,
            STATUS,
        ),
    ).of(mechanism)


def motion_rows(
    course: Sampling, motion: Motion, fields: Sequence[PoleField | UnreadField]
) -> TableArrays:
    """Return the rows of a block of a course whose poles were found."""
    mechanism = course.tracer.mechanism
    rows: dict[str, Any] = {"sample": motion.sample, "assembly_mode": motion.assembly_mode}
    if course.timed and motion.timing is not None:
        rows["t"] = motion.timing.t
    rows |= input_columns(mechanism, motion.inputs)
    rows |= dict(zip(mechanism.variable_names, motion.values.T, strict=True))
    return rows | {"residual": motion.residual, "status": run_status(motion, fields)}
