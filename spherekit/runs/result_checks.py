"""Calls the methods of an analysis and checks what they return.

An analysis that breaks its declaration is refused with a sentence.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Array, Indices
from spherekit.errors import PluginError
from spherekit.numerics.lazy_columns import Interleaved
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings
from spherekit.scenes.scene import Scene
from spherekit.scenes.scene_checks import check_scene
from spherekit.status import Status
from spherekit.tables.screen_table import ScreenTable
from spherekit.tables.table import DTYPE_BY_KIND, Column, Table, TableData, row_count
from spherekit.wording import listing

WORDS_BY_KIND = {
    "number": "numbers",
    "integer": "whole numbers of 64 bits",
    "status": "codes of Status",
    "text": "texts",
}
"""Words for the kinds of columns in messages."""

VALUE_RANGES = {"integer": range(-(2**63), 2**63), "status": range(len(Status))}
"""Values that a column of each kind of whole numbers can have."""


def compute_checked_tables(
    analysis: AbstractAnalysis, tables: Sequence[Table], batch: Batch
) -> dict[str, TableData]:
    """Compute the tables of an analysis for a block of samples, and check them.

    The analysis may be a plugin by other people, so its results can have any fault.

    Parameters
    ----------
    analysis
        The analysis.
    tables
        The tables that it has declared.
    batch
        The samples, in all assembly modes.

    Returns
    -------
    The columns of each table, by name of the table. The columns are converted to the
    declared kinds (numbers, whole numbers, texts and so on).

    Raises
    ------
    PluginError
        If `compute` fails, or if its tables are not the declared tables.
    SpherekitError
        If the analysis itself refuses the samples.
    """
    with convert_plugin_errors(analysis.name, "compute"):
        returned_tables = analysis.compute(batch)
    declared_names = [table.name for table in tables]
    returned_names = _describe_keys(returned_tables)
    if sorted(returned_names) != sorted(declared_names):
        raise PluginError(
            f"{analysis.name}: compute returned {listing(returned_names) or 'no tables'}, "
            f"it has to return the declared tables by name: {listing(declared_names)}"
        )
    data: dict[str, TableData] = {}
    for table in tables:
        where = f"{analysis.name}: table {table.name}"
        columns = _check_columns(where, table, returned_tables[table.name])
        data[table.name] = columns
        rows = row_count(columns)
        # The batch has a row for each sample in each assembly mode. An analysis can read
        # samples and treat each row of the batch separately (`rowwise`). Its tables with
        # columns for sample and assembly mode (`in_assembly_modes`) must then have equally
        # many rows for each row of the batch.
        has_rows_of_samples = (
            analysis.rowwise and analysis.reads_samples and table.in_assembly_modes
        )
        if has_rows_of_samples and rows % max(len(batch), 1):
            raise PluginError(
                f"{where} has {rows} rows for the {len(batch)} of the batch; give each "
                "sample of each assembly mode as many rows as the others, NaN where it "
                "failed"
            )
    return data


def _describe_keys(data: Any) -> list[str]:
    """Return the keys of a mapping, or the type of data that is no mapping."""
    return [*map(str, data)] if isinstance(data, Mapping) else [type(data).__name__]


def _check_columns(where: str, table: Table, data: Any) -> dict[str, Array | Interleaved]:
    """Return the columns of a table, checked and converted to their declared kinds.

    An analysis has computed the columns. Their kind is number, whole number or text.

    Parameters
    ----------
    where
        Names of the analysis and the table, for messages.
    table
        The declared table.
    data
        The columns by name, as the analysis returned them.

    Raises
    ------
    PluginError
        If the columns are not the declared columns, or their lengths differ.
    """
    names = [column.name for column in table.columns]
    returned_names = _describe_keys(data)
    if returned_names != names:
        raise PluginError(
            f"{where} was declared with columns {names}, but compute returned "
            f"{returned_names}"
        )
    columns = {
        column.name: _check_column(
            f"{where}: column {column.name}", column, data[column.name]
        )
        for column in table.columns
    }
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise PluginError(f"{where} has columns of unequal length: {lengths}")
    return columns


def _check_column(where: str, column: Column, data: Any) -> Array | Interleaved:
    """Return a column as an array (n,) of the type that belongs to its declared kind.

    Parameters
    ----------
    where
        Names of analysis, table and column, for messages.
    column
        The declared column. Its kind is "number", "text" or one of several kinds of whole
        numbers.
    data
        The values that the analysis returned: an array, or an `Interleaved` column. An
        `Interleaved` column has an array for each of several subjects, such as poles, and
        their rows alternate in the table.

    Raises
    ------
    PluginError
        If the values have another type or shape, or if some of them are masked.
    """
    kind = column.kind
    if isinstance(data, Interleaved) and _has_type_of_kind(data, kind):
        return data
    if np.ma.is_masked(data):
        # The conversion to an array would show the numbers under the mask.
        raise PluginError(
            f"{where} has masked values; return an array without a mask, with NaN where a "
            "number is missing"
        )
    try:
        values = np.asarray(data)
    except ValueError:
        raise PluginError(
            f"{where} is not an array with one number or one text in each row"
        ) from None
    if values.ndim != 1:
        raise PluginError(
            f"{where} has the shape {values.shape}, but needs one value in each row"
        )
    # An empty array fits any kind.
    unsuitable_rows = _find_unsuitable_rows(values, kind)
    if len(unsuitable_rows):
        (first,) = values[unsuitable_rows[:1]].tolist()
        raise PluginError(
            f"{where} was declared to contain {WORDS_BY_KIND[kind]}, but contains {first!r}"
        )
    return values.astype(DTYPE_BY_KIND.get(kind, str), copy=False)


def _has_type_of_kind(column: Interleaved, kind: str) -> bool:
    """Return whether a column already has the data type that belongs to its kind."""
    if kind == "text":
        return column.dtype.kind == "U"  # NumPy's letter for texts
    return bool(column.dtype == DTYPE_BY_KIND[kind])


def _find_unsuitable_rows(values: Array, kind: str) -> Indices:
    """Return the indices of values (n,) that cannot be converted to the kind of a column.

    The kinds are ``number`` (float), ``integer``, ``text`` and ``status`` (a whole number).
    Texts may also be Python objects, but numbers may not. Floats without a fraction are
    accepted as whole numbers.
    """
    # NumPy's letters are f, i, u and b for floats, signed and unsigned integers and
    # booleans, and U for texts.
    type_letter = values.dtype.kind
    if kind == "text":
        if type_letter == "U":
            return np.zeros(0, np.intp)
        return np.flatnonzero([not isinstance(text, str) for text in values])
    if type_letter not in "fiub":
        # The array does not have a type of numbers, so it is refused. It can be an array of
        # objects, which NumPy makes of [1.0, None], but also of [10**30]. The rows of
        # values that are no numbers are returned. If all values are numbers, all rows are
        # returned.
        is_other = [not isinstance(value, int | float) for value in values]
        return np.flatnonzero(is_other if any(is_other) else np.ones(len(values), bool))
    if kind == "number" or type_letter == "b":
        return np.zeros(0, np.intp)
    if type_letter == "f":
        # The limits of integers, such as 2**63, are infinite in half precision.
        values = values.astype(np.float64)
    allowed = VALUE_RANGES[kind]
    # The conversion of other values would change them without an error.
    is_suitable = (values >= allowed.start) & (values < allowed.stop)
    if type_letter == "f":
        is_suitable &= values == np.floor(values)
    return np.flatnonzero(~is_suitable)


def compute_findings(
    analysis: AbstractAnalysis, batch: Batch, before: Findings | None
) -> Findings:
    """Return the findings of an analysis in a block, joined with all earlier findings.

    A run is analysed block by block. A block is a group of samples. Findings are results of
    an analysis that are not in its stored tables: values for the summary (figures),
    warnings, remarks and small tables of texts for the screen.

    Parameters
    ----------
    analysis
        The analysis.
    batch
        The samples of the block.
    before
        Findings in earlier blocks, None in the first one.

    Raises
    ------
    PluginError
        If a method of the analysis fails, or if its values have another type or cannot be
        written as JSON.
    """
    with convert_plugin_errors(analysis.name, "findings"):
        findings = analysis.findings(batch)
    if before is not None and isinstance(findings, Findings):
        with convert_plugin_errors(analysis.name, "joined"):
            findings = analysis.joined(before, findings)
    if not isinstance(findings, Findings):
        raise PluginError(
            f"{analysis.name}: findings returned a {type(findings).__name__}; it has to "
            "return Findings(...)"
        )
    for key, item_type in (("warnings", str), ("remarks", str), ("tables", ScreenTable)):
        items = getattr(findings, key)
        # A single text is a sequence of texts, too.
        is_sequence = isinstance(items, Sequence) and not isinstance(items, str)
        if not is_sequence or not all(isinstance(item, item_type) for item in items):
            type_name = "texts" if item_type is str else item_type.__name__
            raise PluginError(
                f"{analysis.name}: findings: {key} has to be a tuple of {type_name}"
            )
    for table in findings.tables:
        for cell in (cell for row in table.rows for cell in row):
            if not isinstance(cell, str):
                raise PluginError(
                    f"{analysis.name}: findings: tables: the cell {cell!r} is a "
                    f"{type(cell).__name__}; it has to be a text; number_text makes one"
                )
    # The figures are stored as JSON at the end of the run. The text is not used here. The
    # call only finds values that cannot be written.
    with convert_plugin_errors(analysis.name, "findings: making JSON of its figures"):
        json.dumps(dict(findings.figures))
    return findings


def compute_scenes(analysis: AbstractAnalysis, batch: Batch) -> tuple[Scene, ...]:
    """Return the scenes (drawings) of an analysis for a block of samples, after checks.

    The analysis may be a plugin by other people. The arrays of a scene must have one value
    at each sample.

    Parameters
    ----------
    analysis
        The analysis.
    batch
        The samples of the block, in all assembly modes (ways to assemble the mechanism).

    Raises
    ------
    PluginError
        If the method of the analysis fails, or if a scene is faulty.
    """
    with convert_plugin_errors(analysis.name, "scene"):
        scenes = tuple(analysis.scene(batch))
    # The batch has a row for each sample in each assembly mode.
    modes = [*batch.assembly_mode_rows()]
    sample_count = len(batch) // max(len(modes), 1)
    input_count = batch.inputs.shape[1]
    return tuple(
        check_scene(analysis.name, scene, modes, sample_count, input_count)
        for scene in scenes
    )
