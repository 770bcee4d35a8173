"""What an analysis gives for a batch: as it was declared, or refused in a sentence."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.errors import PluginError
from spherekit.numerics.lazy_columns import Interleaved
from spherekit.runs.analysis_faults import faults_of
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings
from spherekit.scenes.scene import Scene
from spherekit.scenes.scene_checks import check_scene
from spherekit.tables.table import DTYPE_BY_KIND, Column, Table, TableData, row_count
from spherekit.wording import listing

_WORDS = {
    "number": "numbers",
    "integer": "whole numbers",
    "status": "codes of Status",
    "text": "texts",
}


def computed(
    analysis: AbstractAnalysis, tables: Sequence[Table], batch: Batch
) -> dict[str, TableData]:
    """Return the tables of a batch, columns in the types of their kinds.

    Raises
    ------
    PluginError
        If `compute` fails, or its tables are not those declared.
    SpherekitError
        With which the analysis, or what it reads, says that it does not apply.
    """
    with faults_of(analysis.name, "compute"):
        given = analysis.compute(batch)
    names = [table.name for table in tables]
    returned = _keys(given)
    if sorted(returned) != sorted(names):
        raise PluginError(
            f"{analysis.name}: compute returned {listing(returned) or 'no tables'}, it has "
            f"to return the declared tables by name: {listing(names)}"
        )
    data: dict[str, TableData] = {}
    for table in tables:
        where = f"{analysis.name}: table {table.name}"
        data[table.name] = columns = _columns(where, table, given[table.name])
        rows = row_count(columns)
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


def _keys(data: Any) -> list[str]:
    """Return the keys of data, or what it is if it has none."""
    return [*map(str, data)] if isinstance(data, Mapping) else [type(data).__name__]


def _columns(where: str, table: Table, data: Any) -> dict[str, Array | Interleaved]:
    names = [column.name for column in table.columns]
    if _keys(data) != names:
        raise PluginError(
            f"{where} was declared with columns {names}, but compute returned {_keys(data)}"
        )
    made = {
        c.name: _typed(f"{where}: column {c.name}", c, data[c.name]) for c in table.columns
    }
    lengths = {name: len(values) for name, values in made.items()}
    if len(set(lengths.values())) > 1:
        raise PluginError(f"{where} has columns of unequal length: {lengths}")
    return made


def _typed(where: str, column: Column, data: Any) -> Array | Interleaved:
    kind = column.kind
    if isinstance(data, Interleaved) and (
        data.dtype.kind == "U" if kind == "text" else data.dtype == DTYPE_BY_KIND[kind]
    ):
        return data
    try:
        values = np.asarray(data)
    except ValueError:
        raise PluginError(f"{where} is no array of one number or text a row") from None
    if values.ndim != 1:
        raise PluginError(f"{where} has the shape {values.shape}, it needs one value a row")
    fits = values.dtype.kind in ("U" if kind == "text" else "fiub")
    if kind == "text" and not fits:
        fits = all(isinstance(text, str) for text in values)
    elif kind != "number" and values.dtype.kind == "f":
        fits = bool(np.all(values == np.floor(values)))
    if not fits and len(values):
        (first,) = values[:1].tolist()
        raise PluginError(
            f"{where} was declared to hold {_WORDS[kind]}, but holds {first!r}"
        )
    return values.astype(DTYPE_BY_KIND.get(kind, str), copy=False)


def findings_of(
    analysis: AbstractAnalysis, batch: Batch, before: Findings | None
) -> Findings:
    """Return what is found in a batch, joined with what was found `before`.

    Raises
    ------
    PluginError
        If that fails, or is not ready for JSON.
    """
    with faults_of(analysis.name, "findings"):
        findings = analysis.findings(batch)
    if before is not None and isinstance(findings, Findings):
        with faults_of(analysis.name, "joined"):
            findings = analysis.joined(before, findings)
    if not isinstance(findings, Findings):
        raise PluginError(
            f"{analysis.name}: findings returned a {type(findings).__name__}, it has to "
            "return Findings(...)"
        )
    with faults_of(analysis.name, "findings: making JSON of its figures"):
        json.dumps(dict(findings.figures))
    return findings


def scenes_of(analysis: AbstractAnalysis, batch: Batch) -> tuple[Scene, ...]:
    """Return what is to be seen of a batch, with arrays of the right shapes.

    Raises
    ------
    PluginError
        If that fails, or `check_scene` refuses one of the scenes.
    """
    with faults_of(analysis.name, "scene"):
        scenes = tuple(analysis.scene(batch))
    modes = [*batch.assembly_mode_rows()]
    samples = len(batch) // max(len(modes), 1)
    inputs = batch.inputs.shape[1]
    return tuple(
        check_scene(analysis.name, scene, modes, samples, inputs) for scene in scenes
    )
