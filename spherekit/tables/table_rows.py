"""The rows of tables in memory: blocks as they came, joined in order when they are read."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.numerics.lazy_columns import Span, once, put
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    CHUNK,
    SAMPLE,
    TYPES,
    Table,
    TableArrays,
    TableData,
    arrays,
    row_count,
)


class InMemory:
    """Keeps the blocks of tables as they come; columns that nobody read are not made."""

    def __init__(self) -> None:
        self._blocks: dict[tuple[str, str], list[TableData]] = defaultdict(list)

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""
        self._blocks[analysis, table.name].append(data)

    def pieces(self, analysis: str, table: Table) -> Iterator[TableArrays]:
        """Yield all rows, mode after mode, in pieces as they are written."""
        return pieces_of(table, self.table(analysis, table))

    def table(self, analysis: str, table: Table) -> "JoinedBlocks":
        """Return all rows: by assembly mode, then sample, where they belong to these."""
        return JoinedBlocks(self._blocks[analysis, table.name], table)


class JoinedBlocks(Mapping[str, Array]):
    """The columns of blocks, joined when they are first read, or anew for many at once.

    By assembly mode, then sample, where rows belong to these.
    """

    def __init__(self, blocks: Sequence[TableData], table: Table) -> None:
        self._blocks = [dict(block) for block in blocks]
        self._table = table
        self._types = {c.name: TYPES.get(c.kind) for c in table.columns}
        self._made: dict[str, Array] = {}
        self._spans: list[list[Span]] = []

    def join(self, names: Iterable[str]) -> dict[str, Array]:
        """Return columns put together anew: several at less cost than each."""
        if not self._spans:  # where rows belong; samples of a block follow the others'
            parts = []
            for number, block in enumerate(self._blocks):
                several = len(self._blocks) > 1 and self._table.in_assembly_modes
                ordered, runs = in_modes(block, several)
                self._blocks[number] = dict(ordered)
                parts += [(mode, number, rows) for mode, rows in runs]
            self._spans = [[] for _ in self._blocks]
            first = 0
            for _, number, rows in sorted(parts, key=lambda part: part[:2]):
                self._spans[number].append((rows, first))
                first += rows.stop - rows.start
        made: dict[str, Array] = {}
        for name in names:
            columns = [block[name] for block in self._blocks]
            made[name] = np.empty(
                sum(map(len, columns)),
                dtype=self._types[name] or np.result_type(*(x.dtype for x in columns)),
            )
        for block, spans in zip(self._blocks, self._spans, strict=True):
            put([(block[name], out) for name, out in made.items()], spans)
        return made

    def __getitem__(self, name: str) -> Array:
        if name not in self._types:
            raise KeyError(name)
        if name not in self._made:
            self._made |= self.join([name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._types)

    def __len__(self) -> int:
        return len(self._types)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (self.join(self),)


def in_modes(
    block: TableData, several: bool = True
) -> tuple[TableData, list[tuple[int, slice]]]:
    """Return the rows of a block by assembly mode, then sample, and where each mode is.

    They are as they were unless a mode is there twice, or its samples do not rise; rows of
    one sample keep their order. Without `several` blocks of modes all are one.
    """
    if not several:
        return block, [(0, slice(0, row_count(block)))]
    modes, repeats = once(block[ASSEMBLY_MODE.name])
    samples, alike = once(block[SAMPLE.name])
    if alike == repeats:
        step = np.diff(modes)
        edges = [0, *(np.flatnonzero(step) + 1).tolist(), len(modes)]
        runs = [
            (int(modes[low]), slice(low * repeats, high * repeats))
            for low, high in pairwise(edges)
            if low < high
        ]
        falls = (step == 0) & (np.diff(samples) < 0)
        if len(dict(runs)) == len(runs) and not np.any(falls):
            return block, runs
    rows = arrays(block)
    order = np.lexsort((rows[SAMPLE.name], rows[ASSEMBLY_MODE.name]))
    return in_modes({name: column[order] for name, column in rows.items()})


def typed(table: Table, data: TableArrays) -> dict[str, Array]:
    """Return columns in the type of their kind; text stays as it is."""
    if isinstance(data, JoinedBlocks):
        data = data.join(data)
    return {c.name: np.asarray(data[c.name], TYPES.get(c.kind)) for c in table.columns}


def pieces_of(table: Table, data: TableArrays) -> Iterator[TableArrays]:
    """Yield the rows of a table in pieces as they are written."""
    columns = typed(table, data)
    for start in range(0, row_count(columns), CHUNK):
        yield {name: x[start : start + CHUNK] for name, x in columns.items()}
