"""The rows of a run on disk while it goes on: packed, with words as numbers."""

import itertools
import os
import shutil
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.rows import AbstractRows, order_of, parts_in_order
from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    CHUNK,
    TYPES,
    Table,
    TableArrays,
    TableData,
    arrays,
)
from spherekit.errors import OutputError
from spherekit.files.atomic import refused
from spherekit.numeric.unread import IN_CACHE


@final
class OnDisk:
    """Appends the blocks to files of packed rows, one for each table and assembly mode.

    Memory does not grow with the rows. `state` says how many rows count, and their
    checksum; what files hold beyond them is overwritten.
    """

    def __init__(self, folder: Path, split: bool, state: Mapping[str, Any]) -> None:
        """Go on in a folder from a `state`, empty at the start.

        `split` says that more blocks come, whose rows are put in order by assembly modes.
        """
        self.folder = folder
        self._split = split
        self._rows: dict[tuple[str, str, int], tuple[int, int]] = {
            (analysis, table, assembly_mode): (rows, checksum)
            for analysis, table, assembly_mode, rows, checksum in state.get("rows", ())
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
            "rows": [[*key, *counted] for key, counted in self._rows.items()],
            "words": [[*key, list(words)] for key, words in self._words.items()],
        }

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Append the rows of one block.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        columns = arrays({column.name: data[column.name] for column in table.columns})
        for column in table.columns:
            if column.kind == "text":
                words = self._words.setdefault((analysis, table.name, column.name), {})
                columns[column.name] = _codes(columns[column.name], words)
        rows = _packed_rows(columns, packed(table))
        if not (self._split and table.in_assembly_modes):
            self._append(analysis, table, 0, rows)
            return
        if not len(rows):
            return
        parts = parts_in_order([data])
        if parts is None:
            rows = rows[order_of({name: rows[name] for name in rows.dtype.names or ()})]
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
        done, checksum = self._rows.get(key, (0, 0))
        data = rows.view(np.uint8).data
        path = self._path(*key)
        try:
            handle = os.open(
                path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666
            )
            with open(handle, "r+b") as stream:  # noqa: PTH123 (an open descriptor)
                stream.seek(done * rows.dtype.itemsize)
                stream.write(data)
        except OSError as error:
            raise refused(path, "written", error) from None
        self._rows[key] = done + len(rows), zlib.crc32(data, checksum)
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
            (self._path(analysis, table.name, assembly_mode), *counted)
            for assembly_mode in assembly_modes
            if (counted := self._rows[analysis, table.name, assembly_mode])[0]
        ]
        texts = [column.name for column in table.columns if column.kind == "text"]
        words = {
            name: list(self._words.get((analysis, table.name, name), ())) for name in texts
        }
        return RowsOnDisk(table, parts, words)

    def check(self, tables: Iterable[tuple[str, Table]]) -> None:
        """Raise `OutputError` if rows that count are gone from a file, or have changed."""
        for analysis, table in tables:
            for _ in self.table(analysis, table).pieces():
                pass

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
    """The rows of successive files, each with so many that count, and their checksum."""

    def __init__(
        self,
        table: Table,
        parts: list[tuple[Path, int, int]],
        words: Mapping[str, list[str]],
    ) -> None:
        self._type, self._parts = packed(table), parts
        self.count = sum(rows for _, rows, _ in parts)
        self.words = {name: sorted(texts) for name, texts in words.items()}
        # Words were numbered as they came.
        self._places = {
            name: np.argsort(np.argsort(np.array(texts, dtype=str))).astype(np.int32)
            for name, texts in words.items()
        }

    def chunks(self) -> Iterator[TableArrays]:
        """Yield pieces of the files, which may go on from one file into the next."""
        held: list[NDArray[np.void]] = []
        for piece in self.pieces():
            held.append(piece)
            if sum(map(len, held)) == CHUNK:
                yield self._columns(held)
                held = []
        if held or not self._parts:
            yield self._columns(held or [np.empty(0, dtype=self._type)])

    def pieces(self) -> Iterator[NDArray[np.void]]:
        """Yield the rows as they are in the files, `CHUNK` together at most.

        Raises
        ------
        OutputError
            If rows are gone, or not those that were written.
        """
        count = 0
        for path, rows, checksum in self._parts:
            summed = 0
            try:
                with path.open("rb") as stream:
                    while rows:
                        piece = np.fromfile(stream, self._type, min(rows, CHUNK - count))
                        if not len(piece):
                            raise OutputError(f"{path.name} has lost rows")
                        summed = zlib.crc32(piece.view(np.uint8).data, summed)
                        rows, count = rows - len(piece), (count + len(piece)) % CHUNK
                        yield piece
            except OSError as error:
                raise refused(path, "read", error) from None
            if summed != checksum:
                raise OutputError(f"rows in {path.name} are not those that were written")

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


def _packed_rows(columns: TableArrays, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Return columns as rows, so many at a time that they stay in the cache."""
    rows = np.empty(len(next(iter(columns.values()))), dtype=kind)
    for start in range(0, len(rows), IN_CACHE):
        some = rows[start : start + IN_CACHE]
        for name, values in columns.items():
            some[name] = values[start : start + IN_CACHE]
    return rows


def _codes(values: NDArray[Any], words: dict[str, int]) -> NDArray[np.int32]:
    if len(values) and values.strides == (0,):  # one word for all
        code = words.setdefault(str(values[0]), len(words))
        return np.broadcast_to(np.int32(code), values.shape)
    unique, inverse = np.unique(values, return_inverse=True)
    codes = [words.setdefault(str(word), len(words)) for word in unique]
    return np.array(codes, dtype=np.int32)[inverse]
