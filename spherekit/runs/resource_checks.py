"""Checks that a run fits into memory and onto the disk, before it takes long."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from spherekit.errors import AnalysisError, OutputError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.resources import usable_memory
from spherekit.runs.table_store import StoredTables
from spherekit.tables.table_formats import TABLE_FORMATS, Format, choose_formats, is_csv
from spherekit.wording import listing, size_text

FRAMES_IN_MEMORY = 8
"""Copies of the frame of each link and pair that are in memory at once, for each row.

Measured: 5 to 7.6. Larger: runs that would fit are refused; smaller: runs start that end
without memory.
"""

FRAME_BYTES = 72
"""Bytes of a (3, 3) rotation matrix."""


def evaluation_memory(mechanism: Mechanism, row_count: int) -> int:
    """Estimate the memory in bytes for evaluating rows at once.

    A row is one configuration. The rotation matrices of the frames of links and pairs need
    most of the memory.
    """
    frame_count = len(mechanism.links) + len(mechanism.pairs)
    return row_count * FRAMES_IN_MEMORY * FRAME_BYTES * frame_count


def need_memory(
    mechanism: Mechanism, row_count: int, whole_analyses: Sequence[str]
) -> None:
    """Raise `AnalysisError` if a run of all samples at once needs too much memory.

    Parameters
    ----------
    mechanism
        The mechanism of the run.
    row_count
        Number of samples times number of assembly modes (ways to assemble the mechanism).
    whole_analyses
        Names of the analyses that read all samples at once.
    """
    needed = evaluation_memory(mechanism, row_count)
    usable = usable_memory()
    if needed > usable:
        # The estimate is rough, so only half of the rows that would fit are advised.
        advised_row_count = max(1, int(row_count * usable / needed / 2))
        raise AnalysisError(
            f"{listing(whole_analyses)} needs all samples at once. This takes about "
            f"{size_text(needed)} of memory for {row_count} rows, but this process may use "
            f"only {size_text(usable)}; request {advised_row_count} rows (samples of "
            "all assembly modes) or fewer, or only one assembly mode"
        )


def need_disk(
    folder: Path, written_bytes: float, total_bytes: float, subject: str, advice: str
) -> None:
    """Raise `OutputError` if the disk has no room for the rest of the files of a run.

    Parameters
    ----------
    folder
        A folder on the disk.
    written_bytes
        Size of the files that exist already.
    total_bytes
        Expected size of all files in the end.
    subject
        The data that need the space, as the subject of the sentence in the message.
    advice
        What the user can do, for the end of the message.
    """
    free = shutil.disk_usage(folder).free
    if total_bytes - written_bytes > free:
        raise OutputError(
            f"{str(folder)!r}: {subject} will take about {size_text(total_bytes)}, but the "
            f"disk has only {size_text(free)} left; {advice}"
        )


def need_disk_for_run(
    store: StoredTables,
    samples_done: int,
    sample_count: int,
    formats: Sequence[Format] | None,
) -> None:
    """Raise `OutputError` if the disk has no room for the tables of a run.

    The rows of a run are first stored in a work folder, one block (group of samples) after
    another. At the end the tables are written from them, and only then the stored rows are
    removed. So the stored rows and the tables need space at the same time. The sizes are
    extrapolated from the rows stored so far.

    Parameters
    ----------
    store
        The rows that the run has stored so far.
    samples_done, sample_count
        How many samples have stored rows, and how many samples there are in all.
    formats
        Formats of the tables. None for the default, which includes CSV only if the tables
        are small enough in this format.
    """
    written_bytes = store.size
    stored_bytes = written_bytes * sample_count / samples_done
    # Sizes of files are predicted as multiples (`relative_size`) of the size of the stored
    # rows.
    csv_bytes = TABLE_FORMATS["csv"].relative_size * stored_bytes
    formats = choose_formats(formats, csv_bytes)
    relative_size = sum(TABLE_FORMATS[name].relative_size for name in formats)
    total_bytes = stored_bytes * (1.0 + relative_size)
    hint = ""
    if any(is_csv(name) for name in formats):
        parquet_size = TABLE_FORMATS["parquet"].relative_size
        parquet_bytes = size_text(stored_bytes * (1.0 + parquet_size))
        hint = f"; Parquet alone (--format parquet) takes {parquet_bytes}"
    need_disk(
        store.folder.parent,
        written_bytes,
        total_bytes,
        subject="the run, work and files together,",
        advice=f"choose another folder or fewer samples{hint}",
    )
