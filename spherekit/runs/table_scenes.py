"""Scenes of an analysis that defines none: the columns of its tables."""

from collections.abc import Iterator, Sequence

import numpy as np

from spherekit.arrays import Indices, Integers
from spherekit.runs.batch import Batch
from spherekit.scenes.scene import Primitive, Scene, Series
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    TIME,
    Column,
    Table,
    TableArrays,
    Tables,
    arrays,
)

MAX_SUBJECTS = 60
"""Number of subjects of rows, such as poles, above which a table is not drawn.

Larger: figures with more lines than a reader can tell apart.
"""


def table_scenes(tables: Sequence[Table], data: Tables, batch: Batch) -> list[Scene]:
    """Return drawings of the tables of an analysis that makes no drawings of its own.

    Each drawing has curves of the numbers in the tables over the samples of the run. Only
    tables with rows at the samples are drawn.

    A table can have several rows at a sample, for example one for each pole. The pole is
    then the subject of the row, and the texts in the row name it. There is one curve for
    each column of numbers and each subject.

    Parameters
    ----------
    tables
        The declared tables of an analysis.
    data
        The columns of each table, by name of the table.
    batch
        The samples that the analysis has read.

    Returns
    -------
    A scene (drawing) for each assembly mode (way to assemble the mechanism) with at least
    one curve.
    """
    # With several inputs, each input has a column of its own.
    input_columns = (
        Table("inputs", "inputs of the run", (INPUTS,)).of(batch.mechanism).columns
    )
    scenes = []
    for mode, rows in batch.assembly_mode_rows().items():
        # The samples in this mode, each of them once.
        mode_samples = batch.sample[rows]
        series: list[Primitive] = []
        for table in tables:
            has_rows_at_samples = table.in_assembly_modes
            if has_rows_at_samples:
                series += _column_series(
                    table, arrays(data[table.name]), input_columns, mode, mode_samples
                )
        if series:
            scenes.append(Scene(mode, tuple(series)))
    return scenes


def _column_series(
    table: Table,
    data: TableArrays,
    input_columns: Sequence[Column],
    mode: int,
    samples: Integers,
) -> Iterator[Primitive]:
    """Yield a curve (series) over the samples for each column and subject of a table.

    A table can have several rows at a sample, for example one for each pole, which is then
    the subject of the row. The texts in the row name the subject. With more than
    `MAX_SUBJECTS` subjects nothing is drawn. A subject needs exactly one row at each
    sample, because a curve has a value at every sample.

    Parameters
    ----------
    table, data
        The declared table, and its columns by name.
    input_columns
        The columns with the inputs of the run, which are not drawn.
    mode
        Number of the assembly mode (way to assemble the mechanism).
    samples
        (k,) indices of the samples (instants of the run) in this mode.
    """
    mode_rows = np.flatnonzero(data[ASSEMBLY_MODE.name] == mode)
    subjects = np.array(_name_subjects(table, data, mode_rows), dtype=str)
    # A dictionary keeps the order of the subjects.
    distinct_subjects = dict.fromkeys(subjects.tolist())
    if len(distinct_subjects) > MAX_SUBJECTS:
        return
    for subject in distinct_subjects:
        subject_rows = mode_rows[subjects == subject]
        # The rows of a table are in the order of the samples.
        if not np.array_equal(data[SAMPLE.name][subject_rows], samples):
            continue
        for column in table.columns:
            if column in input_columns or not _is_result(column):
                continue
            yield Series(
                path=f"tables/{table.name}/{column.name}/{subject}",
                label=subject or column.name,
                group=column.meaning,
                values=data[column.name][subject_rows],
                unit=column.unit,
            )


def _name_subjects(table: Table, data: TableArrays, rows: Indices) -> list[str]:
    """Return what each of k rows of a table is about: its texts, joined by commas.

    The names are empty if the table has no column of texts.
    """
    text_columns = [column.name for column in table.columns if column.kind == "text"]
    subjects = []
    for row in rows:
        texts = [str(data[name][row]) for name in text_columns]
        subjects.append(", ".join(text for text in texts if text))
    return subjects


def _is_result(column: Column) -> bool:
    """Return whether a column has numbers that are results, and is not the time."""
    return column.kind == "number" and column.scale != "none" and column != TIME
