"""Where the rows of a run go while it goes on: memory, parts on disk, or nowhere."""

import itertools
import math
import os
import shutil
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    CHUNK,
    SAMPLE,
    TYPES,
    AbstractRows,
    Interleaved,
    JoinedColumns,
    Table,
    TableArrays,
    TableData,
    held,
)
from spherekit.errors import OutputError
from spherekit.files.atomic import refused
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
        in_order = _parts_in_order([_pieces(block) for block in blocks])
        if in_order is None:
            vars(self)["_parts"] = whole
            keys = SAMPLE.name, ASSEMBLY_MODE.name
            self._order = _order(self._joined(keys))
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


_Pieces = list[tuple[int, int, int, slice]] | None
"""Runs of rows of one block in one mode: it, the first and last sample, and the rows.

None where modes fall in a block, or samples in a mode.
"""


def _pieces(block: _Kept) -> _Pieces:
    """Return the runs of rows of a block, mode after mode."""
    (modes, repeats), (samples, _) = (
        _once(block[column.name]) for column in (ASSEMBLY_MODE, SAMPLE)
    )
    if len(modes) != len(samples):
        return None
    changes = np.flatnonzero(modes[1:] != modes[:-1]) + 1
    edges = [0, *changes.tolist(), len(modes)] if len(modes) else []
    if np.any(np.diff(modes[edges[:-1]]) < 0):
        return None
    pieces = []
    for start, stop in itertools.pairwise(edges):
        piece = samples[start:stop]
        if not np.all(piece[1:] >= piece[:-1]):
            return None
        rows = slice(repeats * start, repeats * stop)
        pieces.append((int(modes[start]), int(piece[0]), int(piece[-1]), rows))
    return pieces


def _parts_in_order(blocks: Sequence[_Pieces]) -> list[tuple[int, slice]] | None:
    """Return pieces of successive blocks, mode after mode; None if that is not their order.

    In each block modes rise, in each mode samples, and from block to block these go on.
    """
    parts: list[tuple[int, int, slice]] = []
    last: dict[int, int] = {}
    for number, pieces in enumerate(blocks):
        if pieces is None:
            return None
        for mode, lowest, highest, rows in pieces:
            if lowest < last.get(mode, lowest):
                return None
            last[mode] = highest
            parts.append((mode, number, rows))
    return [(number, rows) for _, number, rows in sorted(parts, key=lambda part: part[:2])]


def _once(column: NDArray[Any] | SetAside | Interleaved) -> tuple[NDArray[Any], int]:
    """Return a column without the rows that repeat, and how often each is there."""
    if not isinstance(column, Interleaved):
        return np.asarray(column), 1
    first = column.parts[0]
    if all(part is first for part in column.parts):
        return np.asarray(first), len(column.parts)
    return np.asarray(column), 1


@final
class OnDisk(AbstractStore):
    """Appends the blocks to files of packed rows, one for each table and assembly mode.

    Memory does not grow with the rows. `state` says how many rows count; what files hold
    beyond them is overwritten.
    """

    def __init__(self, folder: Path, split: bool, state: Mapping[str, Any]) -> None:
        """Go on in a folder from a `state`, empty at the start.

        `split` says that more blocks come, whose rows are put in order by assembly modes.
        """
        self.folder = folder
        self._split = split
        self._rows: dict[tuple[str, str, int], int] = {
            (analysis, table, assembly_mode): rows
            for analysis, table, assembly_mode, rows in state.get("rows", ())
        }
        self._words: dict[tuple[str, str, str], dict[str, int]] = {
            (analysis, table, column): {word: code for code, word in enumerate(words)}
            for analysis, table, column, words in state.get("words", ())
        }
        self._changed: set[Path] = set()

    def clear(self) -> None:
        """Forget all rows: those in files are overwritten."""
        self._rows.clear()
        self._words.clear()

    def state(self) -> dict[str, Any]:
        """Return what counts of the files, ready for JSON."""
        return {
            "rows": [[*key, rows] for key, rows in self._rows.items()],
            "words": [[*key, list(words)] for key, words in self._words.items()],
        }

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Append the rows of one block.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        columns = {column.name: data[column.name] for column in table.columns}
        reading = held(columns.values())
        for column in table.columns:
            if column.kind == "text":
                words = self._words.setdefault((analysis, table.name, column.name), {})
                columns[column.name] = _coded(columns[column.name], words)
        rows = _packed_rows(columns, packed(table))
        del reading
        if not (self._split and table.in_assembly_modes):
            self._append(analysis, table, 0, rows)
            return
        if not len(rows):
            return
        parts = _parts_in_order([_pieces(data)])
        if parts is None:
            rows = rows[_order({name: rows[name] for name in rows.dtype.names or ()})]
            modes = rows[ASSEMBLY_MODE.name]
            edges = np.flatnonzero(np.diff(modes, prepend=-1, append=-1)).tolist()
            parts = [(0, slice(*ends)) for ends in itertools.pairwise(edges)]
        for _, span in parts:
            mode = int(rows[ASSEMBLY_MODE.name][span.start])
            self._append(analysis, table, mode, rows[span])

    def _append(
        self, analysis: str, table: Table, assembly_mode: int, rows: NDArray[np.void]
    ) -> None:
        key = analysis, table.name, assembly_mode
        done = self._rows.get(key, 0)
        path = self._path(*key)
        try:
            handle = os.open(
                path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666
            )
            with open(handle, "r+b") as stream:  # noqa: PTH123 (an open descriptor)
                stream.seek(done * rows.dtype.itemsize)
                stream.write(rows.view(np.uint8).data)
        except OSError as error:
            raise refused(path, "written", error) from None
        self._rows[key] = done + len(rows)
        self._changed.add(path)

    def settle(self) -> None:
        """Wait until the disk holds all that was appended; `OutputError` if it cannot."""
        for path in sorted(self._changed):
            try:
                with path.open("rb+") as stream:
                    os.fsync(stream.fileno())
            except OSError as error:
                raise refused(path, "written", error) from None
        self._changed.clear()

    def table(self, analysis: str, table: Table) -> "RowsOnDisk":
        """Return all rows: mode after mode."""
        assembly_modes = sorted(
            b for a, t, b in self._rows if (a, t) == (analysis, table.name)
        )
        parts = [
            (self._path(analysis, table.name, assembly_mode), rows)
            for assembly_mode in assembly_modes
            if (rows := self._rows[analysis, table.name, assembly_mode])
        ]
        texts = [column.name for column in table.columns if column.kind == "text"]
        words = {
            name: list(self._words.get((analysis, table.name, name), ())) for name in texts
        }
        return RowsOnDisk(table, parts, words)

    def check(self, tables: Iterable[tuple[str, Table]]) -> None:
        """Raise `OutputError` if a file is gone, or shorter than the rows that count."""
        types = {(analysis, table.name): packed(table) for analysis, table in tables}
        for (analysis, name, assembly_mode), rows in self._rows.items():
            path = self._path(analysis, name, assembly_mode)
            size = path.stat().st_size if path.is_file() else 0
            if size < rows * types[analysis, name].itemsize:
                raise OutputError(f"{path.name} has lost rows")

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(path.stat().st_size for path in self.folder.glob("*.rows"))

    @property
    def free(self) -> int:
        """Bytes that the disk has left."""
        return shutil.disk_usage(self.folder).free

    def _path(self, analysis: str, table: str, assembly_mode: int) -> Path:
        return self.folder / f"{analysis}.{table}.{assembly_mode}.rows"


@final
class RowsOnDisk(AbstractRows):
    """The rows of successive files, each with so many rows that count."""

    def __init__(
        self,
        table: Table,
        parts: list[tuple[Path, int]],
        words: Mapping[str, list[str]],
    ) -> None:
        self._type, self._parts = packed(table), parts
        self.count = sum(rows for _, rows in parts)
        self.words = {name: sorted(texts) for name, texts in words.items()}
        # Words were numbered as they came.
        self._places = {
            name: np.argsort(np.argsort(np.array(texts, dtype=str))).astype(np.int32)
            for name, texts in words.items()
        }

    def chunks(self) -> Iterator[TableArrays]:
        """Yield pieces of the files, which may go on from one file into the next."""
        held: list[NDArray[np.void]] = []
        count = 0
        for path, rows in self._parts:
            with path.open("rb") as stream:
                while rows:
                    piece = np.fromfile(stream, self._type, min(rows, CHUNK - count))
                    if not len(piece):
                        raise OutputError(f"{path} has lost rows while it was read")
                    held.append(piece)
                    rows, count = rows - len(piece), count + len(piece)
                    if count == CHUNK:
                        yield self._columns(held)
                        held, count = [], 0
        if held or not self._parts:
            yield self._columns(held or [np.empty(0, dtype=self._type)])

    def _columns(self, pieces: list[NDArray[np.void]]) -> TableArrays:
        count = sum(len(piece) for piece in pieces)
        columns = {
            name: np.empty(count, dtype=self._type[name]) for name in self._type.names or ()
        }
        at = 0
        for piece in pieces:
            for start in range(0, len(piece), IN_CACHE):
                some = piece[start : start + IN_CACHE]
                for name, column in columns.items():
                    column[at : at + len(some)] = some[name]
                at += len(some)
        for name, places in self._places.items():
            columns[name] = places[columns[name]]
        return columns


def packed(table: Table) -> np.dtype[np.void]:
    """Return the type of one row of a table, texts as numbers of words."""
    return np.dtype([(c.name, TYPES.get(c.kind, np.int32)) for c in table.columns])


def _packed_rows(columns: TableData, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Return columns as rows, so many at a time that they stay in the cache."""
    rows = np.empty(len(next(iter(columns.values()))), dtype=kind)
    subjects = [
        len(values.parts) if isinstance(values, Interleaved) else 1
        for values in columns.values()
    ]
    together = math.lcm(*subjects)
    step = together * max(1, IN_CACHE // together)
    for start in range(0, len(rows), step):
        some = rows[start : start + step]
        for (name, values), repeats in zip(columns.items(), subjects, strict=True):
            if isinstance(values, Interleaved):
                span = slice(start // repeats, (start + len(some)) // repeats)
                values.put(some[name], span)
            else:
                some[name] = values[start : start + step]
    return rows


def _coded(
    values: NDArray[Any] | Interleaved, words: dict[str, int]
) -> NDArray[np.int32] | Interleaved:
    """Return texts as numbers of words; new words are added."""
    if isinstance(values, Interleaved):
        return Interleaved([_codes(np.asarray(part), words) for part in values.parts])
    return _codes(np.asarray(values), words)


def _codes(values: NDArray[Any], words: dict[str, int]) -> NDArray[np.int32]:
    if len(values) and values.strides == (0,):  # one word for all
        code = words.setdefault(str(values[0]), len(words))
        return np.broadcast_to(np.int32(code), values.shape)
    unique, inverse = np.unique(values, return_inverse=True)
    codes = [words.setdefault(str(word), len(words)) for word in unique]
    return np.array(codes, dtype=np.int32)[inverse]


def _order(data: TableArrays) -> NDArray[np.intp]:
    """Return the order of rows by mode, then sample; rows of one sample keep theirs."""
    return np.lexsort((data[SAMPLE.name], data[ASSEMBLY_MODE.name]))
