"""Storage of the rows of a run in its folder, block by block, until the run is complete."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from spherekit.tables.table import CHUNK_ROWS, Table, TableData, arrays
from spherekit.tables.table_rows import (
    MemoryTables,
    convert_columns,
    sort_by_mode,
    treat_as_one_mode,
)

MODES = "modes"
"""Key in a block file of the assembly modes of its groups of rows."""


class StoredTables:
    """The tables of an unfinished run: one Parquet file for each block of each table.

    A block is a group of successive samples. Memory does not grow with the number of rows.
    A file is complete or absent, and has checksums. The journal of the run has the number
    of files of each table (`to_journal`). Files above that number belong to a block that
    was not finished. Such files are ignored, and overwritten when the run is resumed.

    Parameters
    ----------
    folder
        Folder of the files.
    has_several_blocks
        Whether more than one block is stored, so that the rows of a file are grouped by
        assembly mode.
    file_counts
        Number of files of each table, from the journal: analysis, table, number.
    """

    def __init__(
        self,
        folder: Path,
        has_several_blocks: bool,
        file_counts: Iterable[tuple[str, str, int]],
    ) -> None:
        """Store the arguments, which the class explains; no file is read yet."""
        self.folder = folder
        self._has_several_blocks = has_several_blocks
        self._file_counts = Counter(
            {(analysis, table): count for analysis, table, count in file_counts}
        )

    def to_journal(self) -> list[Any]:
        """Return the number of files of each table, ready for JSON."""
        return [[*key, count] for key, count in self._file_counts.items()]

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Write the rows of one block of samples of a table to a file.

        Parameters
        ----------
        analysis
            Name of the analysis.
        table, data
            The declared table, and its columns for the block.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        from spherekit.tables.table_files import write_columns

        columns = convert_columns(table, arrays(data))
        if self._has_several_blocks and table.in_assembly_modes:
            # The final table has all rows of an assembly mode (way to assemble the
            # mechanism) together. So the rows of each block are sorted by mode.
            sorted_block = sort_by_mode(columns)
        else:
            # The rows keep their order, as rows of one mode.
            sorted_block = treat_as_one_mode(columns)
        # The file is divided into groups of at most CHUNK_ROWS rows of one mode. Its notes
        # list the mode of each group.
        group_modes = []
        group_rows = []
        for mode, rows in sorted_block.rows_of_modes:
            for start in range(rows.start, rows.stop, CHUNK_ROWS):
                group_modes.append(mode)
                group_rows.append(slice(start, min(start + CHUNK_ROWS, rows.stop)))
        key = (analysis, table.name)
        write_columns(
            self._path(key, self._file_counts[key]),
            columns=sorted_block.columns,
            notes={MODES: group_modes},
            groups=group_rows,
            # The file is only read when the run is resumed, and when the tables of the
            # complete run are written.
            compression="none",
        )
        self._file_counts[key] += 1

    def pieces(self, analysis: str, table: Table) -> Iterator[Mapping[str, Any]]:
        """Yield the columns of all rows of a table in pieces, sorted by assembly mode.

        An assembly mode is one of the ways to assemble the mechanism. A piece has
        `CHUNK_ROWS` successive rows of the table, so that a long table needs little memory.
        The last piece has the remaining rows.

        The rows are in one file for each block of samples. A file consists of groups, and
        the rows of a group belong to one assembly mode. The notes in the file list the mode
        of each group.

        Raises
        ------
        FileError
            If a file is missing or damaged.
        """
        from spherekit.tables.table_files import read_chunks, read_notes

        key = (analysis, table.name)
        paths = [self._path(key, block) for block in range(self._file_counts[key])]
        groups = []
        for block, path in enumerate(paths):
            for group, mode in enumerate(read_notes(path)[MODES]):
                groups.append((mode, block, group))
        # Sorted by mode, then by block, then by the group in the file of the block.
        groups.sort()
        return read_chunks((paths[block], group) for _, block, group in groups)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(path.stat().st_size for path in self.folder.glob("*.parquet"))

    def _path(self, key: tuple[str, str], block: int) -> Path:
        return self.folder / f"{'.'.join(key)}.{block:06d}.parquet"


TableStore = StoredTables | MemoryTables
"""Receives the rows of each block, in a folder or in memory."""
