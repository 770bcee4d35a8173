"""The rows of tables in memory: blocks as they came, joined in order when they are read."""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    CHUNK,
    SAMPLE,
    TYPES,
    Table,
    TableArrays,
    TableData,
)
from spherekit.arrays import Array, Indices
from spherekit.numeric.unread import Interleaved, Span, once, put

LARGEST_SHARE = 8
"""Columns that are a smaller part of an array than one of so many are kept as copies."""


class InMemory:
    """Keeps the blocks of tables as they come; columns that nobody read are not made."""

    def __init__(self) -> None:
        self._blocks: dict[tuple[str, str], list[TableData]] = defaultdict(list)

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""
        self._blocks[analysis, table.name].append(
            {name: _own(column) for name, column in data.items()}
        )

    def clear(self) -> None:
        """Forget all rows."""
        self._blocks.clear()

    def pieces(self, analysis: str, table: Table) -> Iterator[TableArrays]:
        """Yield all rows, mode after mode, in pieces as they are written."""
        return pieces_of(table, self.table(analysis, table))

    def table(self, analysis: str, table: Table) -> "JoinedBlocks":
        """Return all rows: by assembly mode, then sample, where they belong to these."""
        return JoinedBlocks(self._blocks[analysis, table.name], table)


class JoinedBlocks(Mapping[str, Array]):
    """The columns of blocks, joined when they are first read.

    By assembly mode, then sample, where rows belong to these.
    """

    def __init__(self, blocks: Sequence[TableData], table: Table) -> None:
        self._blocks = [dict(block) for block in blocks]
        self._types = {c.name: TYPES.get(c.kind) for c in table.columns}
        self._made: dict[str, Array] = {}
        self._spans: list[list[Span]] = []
        self._order: Indices | None = None
        self._in_modes = table.in_assembly_modes

    def join(self, names: Iterable[str]) -> None:
        """Put together the columns of these names: several at less cost than each."""
        if not self._spans:
            self._put_in_order()
        wanted = [name for name in names if name not in self._made]
        for name, made in self._joined(wanted).items():
            self._made[name] = made if self._order is None else made[self._order]
            for block in self._blocks:
                del block[name]

    def _put_in_order(self) -> None:
        """Find where the rows of blocks belong; columns are still there."""
        counts = [len(next(iter(block.values()))) for block in self._blocks]
        parts = [(number, slice(0, count)) for number, count in enumerate(counts)]
        self._spans = _spans(parts, len(counts))
        if len(counts) < 2 or not self._in_modes:
            return
        in_order = parts_in_order(self._blocks)
        if in_order is None:
            self._order = order_of(self._joined([SAMPLE.name, ASSEMBLY_MODE.name]))
        else:
            self._spans = _spans(in_order, len(counts))

    def _joined(self, names: Sequence[str]) -> dict[str, Array]:
        made = {name: self._empty(name) for name in names}
        for block, spans in zip(self._blocks, self._spans, strict=True):
            put([(block[name], out) for name, out in made.items()], spans)
        return made

    def _empty(self, name: str) -> Array:
        columns = [block[name] for block in self._blocks]
        kind = self._types[name] or np.result_type(*(part.dtype for part in columns))
        return np.empty(sum(map(len, columns)), dtype=kind)

    def __getitem__(self, name: str) -> Array:
        if name not in self._types:
            raise KeyError(name)
        self.join([name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._types)

    def __len__(self) -> int:
        return len(self._types)

    def __reduce__(self) -> tuple[Any, ...]:
        self.join(self)
        return dict, (self._made,)


def _own(column: Any) -> Any:
    """Return a column whose memory is not a small part of what it would keep alive."""
    if isinstance(column, Interleaved):
        once = {id(part): _own(part) for part in column.parts}
        return Interleaved([once[id(part)] for part in column.parts])
    whole = getattr(column, "base", None)
    is_part = isinstance(whole, np.ndarray) and whole.nbytes > LARGEST_SHARE * column.nbytes
    return column.copy() if is_part and column.strides[0] else column


def _spans(parts: Sequence[tuple[int, slice]], blocks: int) -> list[list[Span]]:
    """Return of each block which rows go where when its parts follow each other."""
    spans: list[list[Span]] = [[] for _ in range(blocks)]
    first = 0
    for number, rows in parts:
        spans[number].append((rows, first))
        first += rows.stop - rows.start
    return spans


def parts_in_order(blocks: Sequence[TableData]) -> list[tuple[int, slice]] | None:
    """Return rows of blocks by mode, then sample; None where these would need sorting.

    The samples of a block come after those of the blocks before.
    """
    parts: list[tuple[int, int, slice]] = []
    for number, block in enumerate(blocks):
        modes, repeats = once(block[ASSEMBLY_MODE.name])
        samples, _ = once(block[SAMPLE.name])
        is_new = modes[1:] != modes[:-1] if len(modes) == len(samples) else None
        if is_new is None or np.any(~is_new & (samples[1:] < samples[:-1])):
            return None
        edges = np.flatnonzero(np.concatenate([[True], is_new, [True]]))
        for start, stop in itertools.pairwise(edges.tolist() if len(modes) else []):
            rows = slice(repeats * start, repeats * stop)
            parts.append((int(modes[start]), number, rows))
    if len({part[:2] for part in parts}) < len(parts):
        return None
    return [(number, rows) for _, number, rows in sorted(parts, key=lambda part: part[:2])]


def order_of(data: TableArrays) -> Indices:
    """Return the order of rows by mode, then sample; rows of one sample keep theirs."""
    return np.lexsort((data[SAMPLE.name], data[ASSEMBLY_MODE.name]))


def typed(table: Table, data: TableArrays) -> dict[str, Array]:
    """Return columns in the type of their kind; text stays as it is."""
    if isinstance(data, JoinedBlocks):
        data.join(column.name for column in table.columns)
    return {c.name: np.asarray(data[c.name], TYPES.get(c.kind)) for c in table.columns}


def pieces_of(table: Table, data: TableArrays) -> Iterator[TableArrays]:
    """Yield the rows of a table in pieces as they are written."""
    columns = typed(table, data)
    for start in range(0, len(next(iter(columns.values()))), CHUNK):
        yield {name: x[start : start + CHUNK] for name, x in columns.items()}
