"""Where the rows of a run go while it goes on: memory or nowhere; disks: `on_disk.py`."""

import itertools
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.folder.row_order import order_of, parts_in_order, pieces_of
from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    SAMPLE,
    TYPES,
    Interleaved,
    JoinedColumns,
    Table,
    TableData,
)
from spherekit.numeric.lent_memory import SetAside, set_aside

IN_CACHE = 2048
"""Rows that are taken apart or put together at once."""

Key = tuple[str, str]
"""The names of an analysis and of its table."""

_Kept = Mapping[str, NDArray[Any] | SetAside | Interleaved]
"""The columns of a table in one block; what can be made again is, when it is read."""


class AbstractStore(ABC):
    """Takes the tables of block after block."""

    @abstractmethod
    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""

    @abstractmethod
    def clear(self) -> None:
        """Forget all rows."""


@final
class Nowhere(AbstractStore):
    """Keeps nothing, for runs of which only the summary or the recording is wanted."""

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""

    def clear(self) -> None:
        """Forget all rows."""


@final
class InMemory(AbstractStore):
    """Keeps the blocks as they come."""

    def __init__(self) -> None:
        self._blocks: dict[Key, list[_Kept]] = defaultdict(list)

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""
        kept = {
            column.name: values.set_aside()
            if isinstance(values := data[column.name], Interleaved)
            else set_aside(np.asarray(values, dtype=TYPES.get(column.kind)))
            for column in table.columns
        }
        self._blocks[analysis, table.name].append(kept)

    def clear(self) -> None:
        """Forget all rows."""
        self._blocks.clear()

    def table(self, analysis: str, table: Table) -> Mapping[str, NDArray[Any]]:
        """Return all rows: by assembly mode, then sample, where they belong to these."""
        return _Joined(self._blocks[analysis, table.name], table)


@final
class _Joined(JoinedColumns):
    """The columns of blocks, each joined when it is first read.

    By assembly mode, then sample, where rows belong to these.
    """

    def __init__(self, blocks: Sequence[_Kept], table: Table) -> None:
        self._blocks = [dict(block) for block in blocks]
        self._names = [column.name for column in table.columns]
        self._types = {c.name: TYPES.get(c.kind) for c in table.columns}
        self._made: dict[str, NDArray[Any]] = {}
        self._order: NDArray[np.intp] | None = None
        self._in_modes = table.in_assembly_modes

    @cached_property
    def _parts(self) -> list[tuple[int, slice]]:
        """The pieces of blocks in order, found when the first column is read."""
        blocks = self._blocks
        whole = [(k, slice(0, len(next(iter(b.values()))))) for k, b in enumerate(blocks)]
        if len(blocks) < 2 or not self._in_modes:
            return whole
        in_order = parts_in_order([pieces_of(block) for block in blocks])
        if in_order is None:
            vars(self)["_parts"] = whole
            keys = SAMPLE.name, ASSEMBLY_MODE.name
            self._order = order_of(self._joined(keys))
        return in_order or whole

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._names:
            raise KeyError(name)
        self.join([name])
        return self._made[name]

    def join(self, names: Iterable[str]) -> None:
        """Put together the columns of these names, as far as they are not."""
        wanted = [name for name in names if name not in self._made]
        if not wanted:
            return
        _ = self._parts  # which says in which order, if in none of its own
        for name, made in self._joined(wanted).items():
            self._made[name] = made if self._order is None else made[self._order]
            for block in self._blocks:
                del block[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def _joined(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Return columns, block after block, so that each is made again once."""
        joined = {name: self._empty(name) for name in names}
        ends = itertools.accumulate(rows.stop - rows.start for _, rows in self._parts)
        places: dict[int, list[_Target]] = defaultdict(list)
        for (number, rows), end in zip(self._parts, ends, strict=True):
            places[number].append((rows, end - (rows.stop - rows.start)))
        for number, targets in places.items():
            block = self._blocks[number]
            _put_together({name: (block[name], joined[name]) for name in joined}, targets)
        return joined

    def _empty(self, name: str) -> NDArray[Any]:
        columns = [block[name] for block in self._blocks]
        kind = self._types[name] or np.result_type(*(part.dtype for part in columns))
        return np.empty(sum(len(part) for part in columns), dtype=kind)


_Target = tuple[slice, int]
"""Rows of a block's column, and from where on they belong in the joined one."""


def _put_together(
    columns: Mapping[str, tuple[NDArray[Any] | SetAside | Interleaved, NDArray[Any]]],
    targets: Sequence[_Target],
) -> None:
    """Write the columns of a block into joined ones; what is made again is made once."""
    left: dict[int, list[_Written]] = defaultdict(list)
    sources, reading = {}, []
    for column, out in columns.values():
        parts = column.parts if isinstance(column, Interleaved) else (column,)
        for number, part in enumerate(parts):
            written = _Written(part, out, number, len(parts), targets)
            if isinstance(part, SetAside) and part.row is not None:
                left[id(part.source)].append(written)
                sources[id(part.source)] = part.source
            else:
                reading.append(np.asarray(part))  # what it is a view of is made once
                written.put(slice(0, len(part)), reading[-1])
    for key, wanted in left.items():
        sources[key].read(partial(_read_slice, wanted))


def _read_slice(wanted: "Sequence[_Written]", rows: slice, held: NDArray[Any]) -> None:
    """Write some rows of what is wanted, given all columns of these, few at a time."""
    for start in range(rows.start, rows.stop, IN_CACHE):
        some = slice(start, min(start + IN_CACHE, rows.stop))
        few = held[:, some.start - rows.start : some.stop - rows.start]
        for written in wanted:
            row = written.part.row
            assert row is not None
            written.put(some, few[row].view(written.part.dtype))


@final
@dataclass(frozen=True)
class _Written:
    """A part of a column, and where it goes: one of `count` in turn."""

    part: Any
    out: NDArray[Any]
    number: int
    count: int
    targets: Sequence[_Target]

    def put(self, rows: slice, values: NDArray[Any]) -> None:
        """Write the part's values at some of its rows, as far as they are wanted."""
        for wanted, first in self.targets:
            start, stop = wanted.start // self.count, wanted.stop // self.count
            low, high = max(rows.start, start), min(rows.stop, stop)
            if low < high:
                at = first + (low - start) * self.count + self.number
                end = first + (high - start) * self.count
                self.out[at : end : self.count] = values[
                    low - rows.start : high - rows.start
                ]
