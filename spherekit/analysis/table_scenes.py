"""What is to be seen of an analysis that says nothing of it: the columns of its tables."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.batch import Batch
from spherekit.analysis.scene import Primitive, Scene, Series
from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    TIME,
    Column,
    Table,
    TableData,
)

MOST_SUBJECTS = 60
"""A table with more rows at a sample is not drawn."""


def table_scenes(
    tables: Sequence[Table], data: Mapping[str, TableData], batch: Batch
) -> tuple[Scene, ...]:
    """Return the numbers of tables with rows at the samples, over these, by mode.

    Rows that belong to one sample are told apart by what their columns of text say.
    """
    sampled = [table for table in tables if table.in_assembly_modes]
    scenes = []
    for mode, rows in batch.assembly_mode_rows().items():
        parts = [
            part
            for table in sampled
            for part in _parts(table, data[table.name], mode, batch.sample[rows])
        ]
        if parts:
            scenes.append(Scene(mode, tuple(parts)))
    return tuple(scenes)


def _parts(
    table: Table, data: TableData, mode: int, samples: NDArray[np.int64]
) -> Iterator[Primitive]:
    """Yield the columns of one mode, of each subject that has a row at every sample."""
    here = np.asarray(data[ASSEMBLY_MODE.name]) == mode
    texts = [
        np.asarray(data[column.name]).astype(str)[here]
        for column in table.columns
        if column.kind == "text"
    ]
    subjects = np.array([", ".join(words) for words in zip(*texts, strict=True)], dtype=str)
    if not texts:
        subjects = np.full(int(np.sum(here)), "")
    names = list(dict.fromkeys(subjects.tolist()))
    if len(names) > MOST_SUBJECTS:
        return
    for subject in names:
        chosen = np.flatnonzero(here)[subjects == subject]
        if not np.array_equal(np.asarray(data[SAMPLE.name])[chosen], samples):
            continue
        for column in table.columns:
            if _shown(column):
                path = f"tables/{table.name}/{column.name}/{subject}"
                values = np.asarray(data[column.name], dtype=float)[chosen]
                label = subject or column.name
                yield Series(path, label, column.meaning, values, column.unit)


def _shown(column: Column) -> bool:
    """Return whether a column is a result, and not an input, the time or an error."""
    given = (INPUTS.name, TIME.name, RESIDUAL.name)
    is_input = column.name.startswith(f"{INPUTS.name}_") and column.meaning.startswith(
        INPUTS.meaning
    )
    return (
        column.kind == "number"
        and column.scale != "none"
        and column.name not in given
        and not is_input
    )
