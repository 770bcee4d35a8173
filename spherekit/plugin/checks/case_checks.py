"""The checks of an analysis on one mechanism.

Each check takes a `ConformanceCase` and returns a note for the report. It raises
`PluginError` if the analysis fails, and `NotApplicableError` if the check does not apply.
"""

import json
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import PluginError, SpherekitError, UndeclaredNeed
from spherekit.files.study import Study
from spherekit.geometry.rotation import from_quaternion
from spherekit.plugin.checks.case import ConformanceCase, Tables, fail_row
from spherekit.plugin.checks.report import NotApplicableError
from spherekit.plugin.checks.table_comparison import (
    describe_difference,
    match_rows,
    replace_words,
)
from spherekit.plugin.checks.variants import (
    rename_links,
    rename_parameters,
    rotate_mechanism,
)
from spherekit.runs.contract import Findings
from spherekit.runs.execution import Execution
from spherekit.runs.result_checks import compute_findings, compute_scenes
from spherekit.runs.runner import run_study
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, arrays, row_count
from spherekit.wording import counted

BLOCK_SIZES = (1, 4)
"""Sizes (in samples) of the blocks that are compared with one block of all samples."""

ROTATION = from_quaternion(np.array([[0.1, -0.7, 0.5, 0.5]]))[0]
"""The rotation (3, 3) of the mechanism as a whole: large, and about no axis of its own."""

READ_ONLY = "read-only"
"""A word in NumPy's message about an array that cannot be written to."""


def check_reads(case: ConformanceCase) -> str:
    """Check that an analysis reads only quantities that it has declared as its needs.

    Reading an undeclared public attribute raises an error. To detect other ways of reading,
    undeclared orientations of links and variables of pairs are replaced by NaN. The tables
    must then stay the same.

    If an analysis declares that it needs the tracer (the position analysis, which can
    compute any configuration), only the errors are checked.

    Returns
    -------
    A note for the report, perhaps empty.
    """
    for method, error in case.errors.items():
        if isinstance(error, UndeclaredNeed):
            raise PluginError(f"{method}: {error}") from error
    # A plan has the needs of each of its analyses. Here there is one analysis.
    if case.run_plan.needs[0].tracer:
        return "all configurations, by the tracer"
    try:
        # The tables and findings of all samples in one block.
        expected, _ = case.whole_results
    except SpherekitError:
        return ""  # another check reports it
    block_size = len(case.sampling)
    tables, _ = case.compute_results(block_size, change_read_motion=case.hide_undeclared)
    _require_same(case, expected, tables, "where what was not declared is NaN")
    return ""


def check_inputs(case: ConformanceCase) -> str:
    """Check that the analysis does not write to the arrays of its input data.

    Such arrays are read-only, so that writing to them raises an error. The case has called
    each method of the analysis and kept its error (`ConformanceCase.errors`). This check
    looks for errors of this kind.

    Returns
    -------
    An empty text, as there is nothing to note in the report.
    """
    for method, error in case.errors.items():
        if READ_ONLY in str(error):
            raise PluginError(
                f"{method} writes to an array that it was given to read; copy it first "
                f"({error})"
            ) from error
    return ""


def check_tables(case: ConformanceCase) -> str:
    """Check that tables have the columns, types and rows that the analysis declared.

    A sample is one choice of the inputs. A table whose rows belong to samples needs equally
    many rows for each sample of each assembly mode. A table without any rows is allowed,
    unless it is the main (first) table.

    Returns
    -------
    An empty text, as there is nothing to note in the report.

    Raises
    ------
    PluginError
        If a table is not as declared.
    NotApplicableError
        If there is no table, or if the main table has no rows.
    """
    # `compute_tables` raises an error if columns or types are not those that were declared.
    # All samples are computed in one batch.
    (batch,) = case.batches(len(case.sampling))
    computed = case.run_plan.compute_tables(case.analysis, batch)
    tables = case.run_plan.tables_of(case.analysis)
    for table in tables:
        if not (table.in_assembly_modes and case.analysis.reads_samples):
            continue  # the rows do not belong to samples
        data = arrays(computed[table.name])
        counts = Counter(zip(data[SAMPLE.name], data[ASSEMBLY_MODE.name], strict=True))
        required_rows = set(zip(batch.sample, batch.assembly_mode, strict=True))
        has_equal_counts = len(set(counts.values())) == 1
        # `counts` is empty if the table has no rows.
        if counts and (set(counts) != required_rows or not has_equal_counts):
            raise PluginError(
                f"table {table.name} does not have the same number of rows for every "
                "sample of every assembly mode; keep rows that fail, with NaN in them"
            )
    if not tables:
        raise NotApplicableError("it has no tables")
    main_table = tables[0]
    if row_count(computed[main_table.name]) == 0:
        raise NotApplicableError(
            f"the main table {main_table.name} is empty, so its rows cannot be checked; "
            "try a mechanism for which it has rows"
        )
    return ""


def check_findings(case: ConformanceCase) -> str:
    """Check that findings can be written as JSON.

    Returns
    -------
    An empty text, as there is nothing to note in the report.
    """
    (batch,) = case.batches(len(case.sampling))
    compute_findings(case.analysis, batch, None)
    return ""


def check_blocks(case: ConformanceCase) -> str:
    """Check that an analysis gives the same results if samples come in smaller blocks.

    Returns
    -------
    The block sizes as a text. The report prints it in the line that begins with "blocks".
    """
    if not case.analysis.reads_samples:
        raise NotApplicableError("it reads no samples")
    # `rowwise` means that rows (samples) are computed independently.
    if not case.analysis.rowwise:
        raise NotApplicableError("it receives all samples at once")
    # Findings are results in addition to the tables.
    expected_tables, expected_findings = case.whole_results
    for block_size in BLOCK_SIZES:
        tables, findings = case.compute_results(block_size)
        where = f"in blocks of {counted(block_size, 'sample')}"
        _require_same(case, expected_tables, tables, where)
        # `_comparable` rounds numbers to 8 digits.
        comparable = _comparable(findings)
        for part, expected in _comparable(expected_findings).items():
            if comparable[part] != expected:
                raise PluginError(
                    f"{part} of the findings {where} are {comparable[part]}, but for all "
                    f"samples at once they are {expected}; both have to be the same"
                )
    return f"of {' and '.join(map(str, BLOCK_SIZES))} samples"


def _comparable(findings: Findings) -> dict[str, Any]:
    """Return findings as they are read from JSON, with numbers rounded.

    Numbers keep 8 significant digits, and at most 9 decimal places.
    """

    def read_rounded(text: str) -> float:
        """Return a number of a JSON text, rounded."""
        return float(f"{round(float(text), 9):.8g}")

    # `asdict` copies no mapping that is not a dictionary.
    findings = replace(findings, figures=dict(findings.figures))
    text = json.dumps(asdict(findings))
    return json.loads(text, parse_float=read_rounded, parse_constant=str)


def check_failed_rows(case: ConformanceCase) -> str:
    """Check how an analysis treats a sample for which the mechanism cannot be assembled.

    The motion, which the analysis reads, has a row for each sample in each assembly mode
    (way to assemble the links). The analysis is computed twice. In the second computation
    one row of the motion has no configuration. The tables of both computations are
    compared:

    - In the table rows of this sample and mode, a number has to be NaN or the same as in
      the first computation. Texts, whole numbers and statuses may be different, because
      they have no NaN.
    - All other table rows have to be the same.

    Returns
    -------
    An empty text, as there is nothing to note in the report.
    """
    if not case.analysis.reads_samples:
        raise NotApplicableError("it reads no samples")
    # All samples are computed in one block. So row number `row` of its motion is also row
    # `row` of `batch`, which tells the sample and the mode of this row.
    count = len(case.sampling)
    row = count // 2
    tables, _ = case.compute_results(block_size=count, change_motion=fail_row(row))
    (batch,) = case.batches(count)
    sample_tables = [
        table for table in case.run_plan.tables_of(case.analysis) if table.in_assembly_modes
    ]
    for table in sample_tables:
        # The table of the first computation is expected.
        complete_tables, _ = case.whole_results
        expected = dict(complete_tables[table.name])
        computed = tables[table.name]
        # The rows of the table with the sample and the assembly mode that failed.
        is_failed = expected[SAMPLE.name] == batch.sample[row]
        is_failed &= expected[ASSEMBLY_MODE.name] == batch.assembly_mode[row]
        # If the second table has another number of rows, `describe_difference` finds this
        # fault below.
        if len(is_failed) == len(computed[SAMPLE.name]):
            for column in table.columns:
                values = computed[column.name]
                # Values in the rows of the failed sample that may differ from the first
                # computation: numbers that are NaN, and all values that are no numbers.
                is_allowed = is_failed
                if column.kind == "number":
                    is_allowed = is_failed & np.isnan(values)
                # These values replace the expected ones, so that the comparison below
                # finds no difference in them.
                expected[column.name] = np.where(is_allowed, values, expected[column.name])
        if fault := describe_difference(table, expected, computed):
            raise PluginError(
                f"where a configuration is missing, {fault}; rows of the missing "
                "configuration must hold NaN, and other rows must not change"
            )
    if not sample_tables:
        raise NotApplicableError("no table has rows of samples")
    return ""


def check_rotation(case: ConformanceCase) -> str:
    """Check that the analysis does not depend on the direction of the ground axes.

    The analysis of the plugin runs on the mechanism of the case, and on a copy that is
    rotated as a whole. The tables of both runs must have the same rows, with the vectors
    rotated.

    Returns
    -------
    An empty text, as there is nothing to note in the report.
    """
    rotated_case = replace(case, mechanism=rotate_mechanism(case.mechanism, ROTATION))
    expected, _ = case.whole_results
    rotated_tables, _ = rotated_case.whole_results
    _require_same(case, expected, rotated_tables, "turned as a whole", ROTATION)
    return ""


def check_names(case: ConformanceCase) -> str:
    """Check that an analysis gives the same tables if links have other names and numbers.

    The analysis runs on two variants of the mechanism. In both, links are called "body_0",
    "body_1", ... In the second one, the moving links are also in the reverse order. The old
    names are put back into the tables before they are compared.

    Returns
    -------
    An empty text, as there is nothing to note in the report.

    Raises
    ------
    PluginError
        If the tables differ.
    """
    mechanism = case.mechanism
    ground, *moving_links = mechanism.links
    expected_tables, _ = case.whole_results
    for order in (moving_links, moving_links[::-1]):
        new_names = {link: f"body_{number}" for number, link in enumerate([ground, *order])}
        # `rename_links` also sorts the links into the order of these names.
        renamed_case = ConformanceCase(
            rename_parameters(case.analysis, new_names),
            rename_links(mechanism, new_names),
            case.samples,
        )
        renamed_tables, _ = renamed_case.whole_results
        old_names = {new: old for old, new in new_names.items()}
        for table, renamed_table in zip(
            case.run_plan.tables_of(case.analysis),
            renamed_case.run_plan.tables_of(renamed_case.analysis),
            strict=True,
        ):
            # Names of columns can have names of links in them, such as "s_contact_cam".
            renamed_columns = {
                column.name: renamed_tables[table.name][renamed_column.name]
                for column, renamed_column in zip(
                    table.columns, renamed_table.columns, strict=True
                )
            }
            compared = replace_words(renamed_columns, old_names)
            # Other indices of links can change the order of the rows. `match_rows` returns
            # both tables in the same order.
            expected, compared = match_rows(
                table, expected_tables[table.name], compared, mechanism.links
            )
            fault = describe_difference(table, expected, compared, is_variant=True)
            if fault:
                raise PluginError(f"with other names or numbers of links, {fault}")
    return ""


def check_scene(case: ConformanceCase) -> str:
    """Check that the viewer accepts the scenes of an analysis in its strict mode.

    The mechanism is run with the analysis, and recorded to a temporary file.

    Returns
    -------
    The number of scenes as a text, such as "2 pages". Each scene is one page of the
    recording.
    """
    # The import switches on the strict mode, in which wrong shapes of data raise errors.
    from spherekit.display.rerun.recorder import RerunRecorder

    mechanism = case.mechanism
    study = Study(mechanism.name, mechanism, samples=case.samples)
    (batch,) = case.batches(len(case.sampling))
    scene_count = len(compute_scenes(case.analysis, batch))
    with (
        tempfile.TemporaryDirectory() as folder,
        RerunRecorder(mechanism.name, path=Path(folder) / "scene.rrd") as recorder,
    ):
        result = run_study(study, [case.analysis], Execution(recorder=recorder))
    for fault in result.failures.values():
        raise PluginError(fault)
    return counted(scene_count, "page")


def _require_same(
    case: ConformanceCase,
    expected: Tables,
    compared: Tables,
    where: str,
    rotation: Floats | None = None,
) -> None:
    """Raise `PluginError` if the tables of two runs of an analysis differ.

    A check runs the analysis twice. The second run differs in a way that must not change
    the results. For example, the samples come in smaller blocks, or the whole mechanism is
    rotated.

    Parameters
    ----------
    case
        The analysis and mechanism, for the declarations of the tables.
    expected, compared
        Tables of the first and the second run, by name.
    where
        What was different in the second run, for the message.
    rotation
        (3, 3) rotation of the whole mechanism in the second run, None if it was not
        rotated.
    """
    for table in case.run_plan.tables_of(case.analysis):
        fault = describe_difference(
            table,
            expected[table.name],
            compared[table.name],
            # A rotated mechanism is another input, with other rounding errors. The
            # tolerance is therefore larger than for a second run of the same mechanism.
            is_variant=rotation is not None,
            rotation=rotation,
        )
        if fault:
            raise PluginError(f"{where}, {fault}")


CASE_CHECKS: dict[str, Callable[[ConformanceCase], str]] = {
    "reads": check_reads,
    "inputs": check_inputs,
    "tables": check_tables,
    "findings": check_findings,
    "blocks": check_blocks,
    "failed rows": check_failed_rows,
    "rotation": check_rotation,
    "names": check_names,
    "scene": check_scene,
}
"""The checks on each mechanism by the names of their lines, in the order of the report."""
