"""The errors of a run against reference values in many digits, column by column."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Indices
from spherekit.positions.motion import Motion
from spherekit.runs.batch import PoleFields
from spherekit.runs.run_plan import RunPlan, links_of
from spherekit.runs.table_deviation import Deviation, compute_deviations
from spherekit.runs.verification import GOLDEN, compute_reference
from spherekit.status import Status
from spherekit.tables.table import Tables
from spherekit.velocities.direction_signs import apply_signs
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField

CHECKED_SAMPLES = 61
"""Number of samples of a run at which its errors are measured.

Larger: the measurement takes longer; smaller: rows with large errors are missed.
"""


def reads_motion_quantities(run_plan: RunPlan) -> bool:
    """Return whether the analysis of a run reads poles, rates or positions of samples.

    Settings of the run, such as its engine, change only the errors of these quantities.
    """
    # `Needs.links` are the links in configurations that an analysis computes itself, which
    # are no samples.
    needs = replace(run_plan.needs[0], links=frozenset())
    return bool(links_of(run_plan.mechanism, needs))


def measure_run(run_plan: RunPlan) -> tuple[list[Deviation], int]:
    """Measure the errors of a run at some of its samples.

    The tables of the analysis are compared with reference tables, which are computed from
    values in many digits.

    Parameters
    ----------
    run_plan
        The run, which has one analysis.

    Returns
    -------
    deviations
        The largest deviation of each column of numbers.
    row_count
        Number of rows (samples in all assembly modes), with those that failed.
    """
    sample_count = len(run_plan.sampling)
    samples = np.arange(sample_count)
    if sample_count > CHECKED_SAMPLES:
        # One sample is taken from each of CHECKED_SAMPLES equal parts of the run. Its
        # position in the part varies irregularly, by multiples of the golden ratio. A
        # regular pattern could coincide with a pattern of the run.
        parts = samples[:CHECKED_SAMPLES]
        positions_in_parts = (parts * GOLDEN) % 1.0
        fractions = (parts + positions_in_parts) / CHECKED_SAMPLES
        samples = np.unique((fractions * sample_count).astype(np.intp))
    reference = compute_reference_tables(run_plan, run_plan.sampling.motion_at(samples))

    # The same samples as the run computes them, in a single block.
    (block,) = run_plan.evaluate_blocks([run_plan.source.motion_at(samples)])
    # The continued angles are pair variables without jumps of whole revolutions.
    motion, pole_fields, continued_angles = block
    # A pole (axis of the relative rotation of two links) may point either way. A reversed
    # direction is no error, so all directions get the sense of the reference.
    pole_fields = align_directions(
        pole_fields, reference.pole_fields, np.arange(len(motion))
    )
    (analysis,) = run_plan.analyses
    batch = run_plan.make_batch(analysis, motion, pole_fields, continued_angles)
    tables = run_plan.compute_tables(analysis, batch)
    return measure_deviations(run_plan, tables, reference.tables), len(motion)


@dataclass(frozen=True)
class ReferenceTables:
    """The tables of an analysis, computed from configurations and rates in many digits.

    The tables of an ordinary run are compared with these, which gives their errors.

    Attributes
    ----------
    tables
        The tables, by name.
    pole_fields
        The poles from which they are computed, for each input that moves while the other
        inputs are locked. A pole is the axis about which one link rotates relative to
        another.
    lacking
        Text such as ", 3 rows without", with the number of rows without reference values.
        The caller appends it to the name of the reference: "the closure equations in 20
        digits, 3 rows without". Empty if all rows have reference values.
    """

    tables: Tables
    pole_fields: tuple[PoleField, ...]
    lacking: str


def compute_reference_tables(
    run_plan: RunPlan, motion: Motion, inputs: Array | None = None
) -> ReferenceTables:
    """Compute the tables of the analysis of a run from reference values.

    The reference values are solutions of the closure equations (conditions that loops stay
    closed) in 20 digits, rounded to float64. The tables serve to measure the errors of a
    run.

    Parameters
    ----------
    run_plan
        A run with one analysis.
    motion
        Configurations of the run: n rows, for which tables are computed.
    inputs
        (n, inputs) inputs in more digits. By default the float64 inputs of the motion count
        as exact.
    """
    (analysis,) = run_plan.analyses
    # A pole is the axis about which one link rotates relative to another. There is a
    # request for each input. It lists the poles that are read while this input moves and
    # the other inputs are locked.
    requests = [request for request in run_plan.requests if request.poles]
    # The poles of all rows, in float64. A pole direction can be reversed without a change
    # of its axis. `compute_reference` gives its directions the same senses as these.
    pole_fields = [evaluate(motion, request) for request in requests]
    reference = compute_reference(motion, requests, pole_fields, inputs=inputs)
    # The attribute `samples` is the number of rows of each assembly mode (way to assemble
    # the mechanism). `compute_reference` has lost it, so it is taken from the run.
    reference_motion = replace(reference.motion, samples=motion.samples)
    # Rows of the run for which no solution in many digits was found. `exact` has an entry
    # for each moving input. The first one suffices, as all have the same configurations.
    is_lacking = (motion.status == Status.OK) & (reference.exact[0].status != Status.OK)
    lacking_count = np.sum(is_lacking)
    # Pair variables (joint angles) without jumps of whole revolutions. The empty dictionary
    # says that no block of samples comes before.
    continued_angles = run_plan.continue_angles(reference_motion, {})
    batch = run_plan.make_batch(
        analysis, reference_motion, reference.pole_fields, continued_angles
    )
    return ReferenceTables(
        tables=run_plan.compute_tables(analysis, batch),
        pole_fields=reference.pole_fields,
        # End of the phrase "the closure equations in 20 digits, 3 rows without".
        lacking=f", {lacking_count} rows without" if lacking_count else "",
    )


def measure_deviations(
    run_plan: RunPlan, tables: Tables, reference: Tables
) -> list[Deviation]:
    """Return the deviation of each column of the tables of a run from a reference."""
    return compute_deviations(run_plan.tables_of(run_plan.analyses[0]), tables, reference)


def align_directions(
    pole_fields: PoleFields, reference: Sequence[PoleField], rows: Indices
) -> tuple[PoleField, ...]:
    """Reverse the directions of poles that point opposite to the reference directions.

    A pole is the axis about which one link rotates relative to another. The two senses of
    this axis are equally right, so a reversed direction must not count as a deviation from
    the reference. A pole field has the poles in several rows (configurations), for one
    input.

    Parameters
    ----------
    pole_fields
        The fields. Their arrays are changed in place.
    reference
        The reference fields, for the same inputs.
    rows
        For each row of the fields, the index of the same configuration in the reference.

    Returns
    -------
    The changed fields.
    """
    computed_fields = tuple(field.as_arrays for field in pole_fields)
    for field, reference_field in zip(computed_fields, reference, strict=True):
        for pole, direction in field.direction.items():
            cosine = np.vecdot(direction, reference_field.direction[pole][rows])
            signs = np.where(cosine < 0.0, -1.0, 1.0)
            apply_signs(field, pole, signs)
    return computed_fields
