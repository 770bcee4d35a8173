"""Where the rows of a run go while it goes on: memory, parts on disk, or nowhere."""

import os
import shutil
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
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
    Table,
    TableData,
)
from spherekit.errors import OutputError
from spherekit.files.atomic import refused

Key = tuple[str, str]
"""The names of an analysis and of its table."""


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
        self._blocks: dict[Key, list[TableData]] = defaultdict(list)

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Take the rows of one block."""
        self._blocks[analysis, table.name].append(table.typed(data))

    def clear(self) -> None:
        """Forget all rows."""
        self._blocks.clear()

    def table(self, analysis: str, table: Table) -> TableData:
        """Return all rows: by assembly mode, then sample, where they belong to these."""
        blocks = self._blocks[analysis, table.name]
        if len(blocks) == 1:
            return blocks[0]
        whole = {
            column.name: np.concatenate([block[column.name] for block in blocks])
            for column in table.columns
        }
        if not table.in_assembly_modes:
            return whole
        order = _order(whole)
        return {name: values[order] for name, values in whole.items()}


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
        typed = table.typed(data)
        rows = np.empty(len(next(iter(typed.values()))), dtype=packed(table))
        for column in table.columns:
            values = typed[column.name]
            if column.kind == "text":
                words = self._words.setdefault((analysis, table.name, column.name), {})
                values = _coded(values, words)
            rows[column.name] = values
        if not (self._split and table.in_assembly_modes):
            self._append(analysis, table, 0, rows)
            return
        if not len(rows):
            return
        rows = rows[_order(typed)]
        assembly_modes, starts = np.unique(rows[ASSEMBLY_MODE.name], return_index=True)
        for assembly_mode, own in zip(
            assembly_modes, np.split(rows, starts[1:]), strict=True
        ):
            self._append(analysis, table, int(assembly_mode), own)

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
                stream.write(rows.tobytes())
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
        self.words = {name: sorted(own) for name, own in words.items()}
        # Words were numbered as they came.
        self._places = {
            name: np.argsort(np.argsort(np.array(own, dtype=str))).astype(np.int32)
            for name, own in words.items()
        }

    def chunks(self) -> Iterator[TableData]:
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

    def _columns(self, pieces: list[NDArray[np.void]]) -> TableData:
        rows = np.concatenate(pieces)
        columns = {
            name: np.ascontiguousarray(rows[name]) for name in self._type.names or ()
        }
        for name, places in self._places.items():
            columns[name] = places[columns[name]]
        return columns


def packed(table: Table) -> np.dtype[np.void]:
    """Return the type of one row of a table, texts as numbers of words."""
    return np.dtype([(c.name, TYPES.get(c.kind, np.int32)) for c in table.columns])


def _coded(values: NDArray[Any], words: dict[str, int]) -> NDArray[np.int32]:
    """Return texts as numbers of words; new words are added."""
    unique, inverse = np.unique(values, return_inverse=True)
    codes = [words.setdefault(str(word), len(words)) for word in unique]
    return np.array(codes, dtype=np.int32)[inverse]


def _order(data: TableData) -> NDArray[np.intp]:
    """Return the order of rows by mode, then sample; rows of one sample keep theirs."""
    return np.lexsort((data[SAMPLE.name], data[ASSEMBLY_MODE.name]))
