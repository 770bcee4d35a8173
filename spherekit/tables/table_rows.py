"""The rows of tables in memory: stored in blocks, which are joined in order when read."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Array
from spherekit.numerics.lazy_columns import Span, copy_columns, remove_repetitions
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    CHUNK_ROWS,
    DTYPE_BY_KIND,
    SAMPLE,
    Table,
    TableArrays,
    TableData,
    arrays,
    row_count,
)


class MemoryTables:
    """The tables of a run in memory, as blocks of rows in the order of computation.

    A run adds one block after another. The rows of several blocks are sorted when a table
    is read. Columns of a block can be lazy: their numbers are computed when they are read.
    """

    def __init__(self) -> None:
        # The blocks of each table, by names of the analysis and the table.
        self._blocks: dict[tuple[str, str], list[TableData]] = defaultdict(list)

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Append the rows of one block to a table of an analysis."""
        self._blocks[analysis, table.name].append(data)

    def pieces(self, analysis: str, table: Table) -> Iterator[TableArrays]:
        """Yield all rows of a table in pieces of `CHUNK_ROWS`.

        The rows have the same order as in the result of the method `table`.
        """
        return split_into_chunks(table, self.table(analysis, table))

    def table(self, analysis: str, table: Table) -> "JoinedBlocks":
        """Return all rows of a table; several blocks are sorted by mode and sample.

        An assembly mode (mode) is one of the ways to assemble the mechanism. A single block
        and a table without columns for mode and sample keep the order of their rows.
        """
        return JoinedBlocks(self._blocks[analysis, table.name], table)


class JoinedBlocks(Mapping[str, Array]):
    """The columns of a table whose rows are in several blocks.

    Rows of several blocks are sorted by assembly mode, then by sample, if the table has
    these columns. The blocks of a column are joined when the column is first read.

    Parameters
    ----------
    blocks
        Columns of each block (group of successive samples). The samples of a block follow
        those of the block before it.
    table
        Declaration of the table.
    """

    def __init__(self, blocks: Sequence[TableData], table: Table) -> None:
        """Keep the blocks; their order is found when the first column is read."""
        self._blocks = [dict(block) for block in blocks]
        self._table = table
        self._dtypes = {c.name: DTYPE_BY_KIND.get(c.kind) for c in table.columns}
        self._joined_columns: dict[str, Array] = {}
        # For each block: its slices (ranges of successive rows) and where they belong
        # in the joined column.
        self._spans: list[list[Span]] = []

    def join(self, names: Iterable[str]) -> dict[str, Array]:
        """Return columns of a table, joined from all blocks of rows.

        If there are several blocks, the rows are sorted by assembly mode (one of the ways
        to assemble the mechanism), unless the table has no such column.

        Parameters
        ----------
        names
            Names of the columns.

        Returns
        -------
        New arrays by name. This method does not store them. A column that is read by its
        name, as in ``blocks[name]``, is stored.
        """
        if not self._spans:
            self._order_rows()
        joined: dict[str, Array] = {}
        for name in names:
            parts = [block[name] for block in self._blocks]
            # Columns of texts have no declared type. The longest text determines the
            # width of the column.
            dtype = self._dtypes[name] or np.result_type(*(part.dtype for part in parts))
            joined[name] = np.empty(sum(map(len, parts)), dtype=dtype)
        # Write the rows of each block to their positions. A span states successive rows of
        # the block, and the row of the result to which the first of them is copied. All
        # columns of a block are copied together: some are lazy (computed when they are
        # copied) and share computations.
        for block, spans in zip(self._blocks, self._spans, strict=True):
            copy_columns([(block[name], column) for name, column in joined.items()], spans)
        return joined

    def _order_rows(self) -> None:
        """Find the row of the joined columns to which each row of a block belongs.

        Each block has the rows of successive samples, in all assembly modes (ways to
        assemble the mechanism). If there are several blocks, the rows are joined mode by
        mode. Within a mode they are in the order of the blocks. A single block keeps its
        order, and so do tables without assembly modes.

        This method sets `_spans`: for each block its slices of rows, with the row of the
        joined columns at which each slice begins.
        """
        if len(self._blocks) > 1 and self._table.in_assembly_modes:
            sorted_blocks = [sort_by_mode(block) for block in self._blocks]
        else:
            sorted_blocks = [treat_as_one_mode(block) for block in self._blocks]
        self._blocks = [dict(sorted_block.columns) for sorted_block in sorted_blocks]
        self._spans = _position_slices(sorted_blocks)

    def __getitem__(self, name: str) -> Array:
        if name not in self._dtypes:
            raise KeyError(name)
        if name not in self._joined_columns:
            self._joined_columns |= self.join([name])
        return self._joined_columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._dtypes)

    def __len__(self) -> int:
        return len(self._dtypes)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (self.join(self),)


@dataclass(frozen=True)
class SortedBlock:
    """Rows of a block of samples, in which the rows of each assembly mode are together.

    An assembly mode is one of the ways to assemble the mechanism. The slices of rows tell
    where the rows belong when blocks are joined mode by mode.

    Attributes
    ----------
    columns
        Columns of the block.
    rows_of_modes
        For each assembly mode its number and the slice of its rows, in the order of the
        rows.
    """

    columns: TableData
    rows_of_modes: list[tuple[int, slice]]


class _BlockSlice(NamedTuple):
    """Successive rows of one assembly mode in one block of a table.

    An assembly mode is one of the ways to assemble the mechanism. The rows of a table are
    computed in blocks. Slices of all blocks are joined mode by mode.

    Attributes
    ----------
    mode
        Number of the assembly mode.
    block_number
        Number of the block.
    rows
        The rows in the block.
    """

    mode: int
    block_number: int
    rows: slice


def treat_as_one_mode(block: TableData) -> SortedBlock:
    """Return the unchanged columns of a block, whose rows count as those of mode 0."""
    return SortedBlock(block, [(0, slice(0, row_count(block)))])


def sort_by_mode(block: TableData) -> SortedBlock:
    """Sort the rows of a block of a table by assembly mode, and each mode by sample.

    An assembly mode is one of the ways to assemble the mechanism. Rows of one mode and
    sample keep their order. If all rows are in order already, the block is returned
    unchanged, with its lazy columns (computed when they are read).

    Parameters
    ----------
    block
        Columns of the block by name. They include the mode and the sample.

    Returns
    -------
    The columns, and the slice of rows of each mode.
    """
    rows_of_modes = _find_modes_in_order(block)
    if rows_of_modes is not None:
        return SortedBlock(block, rows_of_modes)
    columns = arrays(block)
    # `lexsort` sorts by its last key first: by mode, then by sample.
    order = np.lexsort((columns[SAMPLE.name], columns[ASSEMBLY_MODE.name]))
    sorted_columns = {name: column[order] for name, column in columns.items()}
    rows_of_modes = _find_modes_in_order(sorted_columns)
    assert rows_of_modes is not None  # the rows are in order now
    return SortedBlock(sorted_columns, rows_of_modes)


def _find_modes_in_order(block: TableData) -> list[tuple[int, slice]] | None:
    """Return the slice of rows of each assembly mode in a block, None if out of order.

    An assembly mode is one of the ways to assemble the mechanism. The rows are in order if
    all rows of a mode follow each other, with samples that never decrease.

    Each sample in a mode can have several rows, one for each subject, such as a pole. With
    k subjects, k successive rows have the same mode and sample. `remove_repetitions`
    returns columns with only one of these rows, which take less time to compare.
    """
    modes, repeats = remove_repetitions(block[ASSEMBLY_MODE.name])
    samples, sample_repeats = remove_repetitions(block[SAMPLE.name])
    # The short columns cannot be compared if they have different lengths.
    if sample_repeats != repeats:
        return None
    slices = _find_slices_in_order(modes, samples)
    if slices is None:
        return None
    # Each row of the short columns stands for `repeats` rows of the block.
    return [
        (mode, slice(rows.start * repeats, rows.stop * repeats)) for mode, rows in slices
    ]


def _find_slices_in_order(modes: Array, samples: Array) -> list[tuple[int, slice]] | None:
    """Return each assembly mode with its slice of rows, None if they are out of order.

    Rows in order need not be sorted. An assembly mode is one of the ways to assemble the
    mechanism. Rows are in order if all rows of a mode follow each other, with samples that
    never decrease.

    Parameters
    ----------
    modes, samples
        (n,) number of the assembly mode, and of the sample, of each row.
    """
    if not len(modes):
        return []
    mode_steps = np.diff(modes)
    sample_steps = np.diff(samples)
    falls_within_mode = (mode_steps == 0) & (sample_steps < 0)
    # Divide the rows where the mode changes from one row to the next.
    starts = [0, *(np.flatnonzero(mode_steps) + 1).tolist()]
    stops = [*starts[1:], len(modes)]
    modes_of_slices = [int(modes[start]) for start in starts]
    has_each_mode_once = len(set(modes_of_slices)) == len(modes_of_slices)
    if not has_each_mode_once or np.any(falls_within_mode):
        return None
    slices = [slice(start, stop) for start, stop in zip(starts, stops, strict=True)]
    return list(zip(modes_of_slices, slices, strict=True))


def _position_slices(sorted_blocks: Sequence[SortedBlock]) -> list[list[Span]]:
    """Return where the rows of each block belong in the joined columns.

    The blocks are joined by assembly mode (one of the ways to assemble the mechanism).
    Within a mode they are joined in the order of the blocks.

    Parameters
    ----------
    sorted_blocks
        The blocks, with the slice of rows of each mode.

    Returns
    -------
    For each block its slices of rows. The `Span` of a slice states these rows, and the row
    of the joined columns at which they begin.
    """
    block_slices = [
        _BlockSlice(mode, block_number, rows)
        for block_number, sorted_block in enumerate(sorted_blocks)
        for mode, rows in sorted_block.rows_of_modes
    ]
    block_slices.sort(key=lambda item: (item.mode, item.block_number))
    spans: list[list[Span]] = [[] for _ in sorted_blocks]
    first_row = 0
    for block_slice in block_slices:
        rows = block_slice.rows
        spans[block_slice.block_number].append(Span(rows, first_output_row=first_row))
        first_row += rows.stop - rows.start
    return spans


def convert_columns(table: Table, data: TableArrays) -> dict[str, Array]:
    """Return the columns of a table in the types of their kinds; text is unchanged."""
    if isinstance(data, JoinedBlocks):
        data = data.join(data)
    return {
        c.name: np.asarray(data[c.name], DTYPE_BY_KIND.get(c.kind)) for c in table.columns
    }


def split_into_chunks(table: Table, data: TableArrays) -> Iterator[TableArrays]:
    """Yield the rows of a table in pieces of `CHUNK_ROWS`."""
    columns = convert_columns(table, data)
    for start in range(0, row_count(columns), CHUNK_ROWS):
        yield {name: x[start : start + CHUNK_ROWS] for name, x in columns.items()}
