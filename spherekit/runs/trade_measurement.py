"""Running settings against each other in one process, and against the reference."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.arrays import Array, Indices
from spherekit.positions.motion import Motion
from spherekit.runs.run_plan import RunPlan, links_of
from spherekit.runs.table_deviation import Deviation, deviations
from spherekit.runs.table_scenes import Fields
from spherekit.runs.verification import GOLDEN, in_many_digits
from spherekit.status import Status
from spherekit.tables.table import Tables
from spherekit.velocities.direction_signs import turn_round
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField


def reads_poles(plan: RunPlan) -> bool:
    """Return whether anything of what is read depends on settings of the samples."""
    return bool(links_of(plan.mechanism, replace(plan.needs[0], links=frozenset())))


CHECK_ROWS = 61
"""Samples at which what was reached is measured, spread over the run's own."""


def checked_rows(plan: RunPlan) -> tuple[list[Deviation], int]:
    """Return how far a run is off at some samples, and their number of rows.

    The samples are spread over the course: at most `CHECK_ROWS`, chosen apart from any
    regular pattern.
    """
    total = len(plan.course)
    rows = np.arange(total)
    if total > CHECK_ROWS:
        shares = (rows[:CHECK_ROWS] + rows[:CHECK_ROWS] * GOLDEN % 1.0) / CHECK_ROWS
        rows = np.unique((shares * total).astype(np.intp))
    right, poles, _ = reference_at(plan, plan.course.motion_at(rows))
    ((motion, fields, angles),) = plan.read([plan.source.motion_at(rows)])
    fields = _toward(fields, poles, np.arange(len(motion)))
    (analysis,) = plan.analyses
    given = plan.given(analysis, plan.batch(analysis, motion, fields, angles))
    return deviations_of(plan, given, right), len(motion)


def reference_at(
    plan: RunPlan, motion: Motion, inputs: Array | None = None
) -> tuple[Tables, tuple[PoleField, ...], str]:
    """Return the tables at the rows of a motion.

    With the poles behind them, and words on rows that have none. They hold the float64
    numbers nearest to configurations and rates that the closure equations give in 20
    digits; see `spherekit.proof`. The motion's inputs are taken as exact, or else `inputs`
    (n, inputs), which they are rounded from.
    """
    (analysis,) = plan.analyses
    wanted = [item for item in plan.requests if item.poles]
    exact, better, fields = in_many_digits(
        motion, wanted, [evaluate(motion, item) for item in wanted], inputs=inputs
    )
    better = replace(better, samples=motion.samples)
    lacking = np.sum((motion.status == Status.OK) & (exact[0].status != Status.OK))
    batch = plan.batch(analysis, better, fields, plan.angles(better, {}))
    tables = plan.given(analysis, batch)
    return tables, fields, f", {lacking} rows without" if lacking else ""


def deviations_of(plan: RunPlan, given: Tables, reference: Tables) -> list[Deviation]:
    """Return how far tables of a run are off, column by column."""
    return deviations(plan.tables_of(plan.analyses[0]), given, reference)


def _toward(
    fields: Fields, reference: Sequence[PoleField], rows: Indices
) -> tuple[PoleField, ...]:
    """Return fields with directions on the side of a reference's at these rows of it."""
    made = tuple(field.made for field in fields)
    for field, other in zip(made, reference, strict=True):
        for pole, u in field.direction.items():
            along = np.vecdot(u, other.direction[pole][rows])
            turn_round(field, pole, np.where(along < 0.0, -1.0, 1.0))
    return made
