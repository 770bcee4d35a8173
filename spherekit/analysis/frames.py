"""Tables as pandas frames and files; the only module that imports pandas."""

import csv
import io
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.rows import AbstractRows, RowsInMemory
from spherekit.analysis.tables import CHUNK, FILE_SIZE, Files, Table, TableArrays
from spherekit.conventions import Status
from spherekit.errors import FileError
from spherekit.files.atomic import make_folder, writing

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

NOTES = b"spherekit"
"""Where a Parquet file keeps the units of its columns and what it came from."""

CHECKSUM = b"spherekit checksum"
"""Where it keeps that of these and of the names of its columns."""

SPECIAL = set(',"\r\n')


def to_frame(table: Table, data: TableArrays, degrees: bool = False) -> "pd.DataFrame":
    """Return a table as a frame, its units in ``attrs["units"]``.

    With `degrees`, angles and their rates are in degrees; what is per rad stays so.
    """
    rows = RowsInMemory(table, data)
    return _frame(table, rows.columns, rows.words, degrees)


def _frame(
    table: Table, data: TableArrays, words: Mapping[str, Sequence[str]], degrees: bool
) -> "pd.DataFrame":
    """Return rows as a frame; texts are places in `words`."""
    import pandas as pd

    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for column in table.columns:
        values: Any = data[column.name]
        if column.kind == "status":
            names = [status.name for status in Status]
            values = pd.Categorical.from_codes(values, categories=pd.Index(names))
        elif column.kind == "text":
            categories = pd.Index(list(words[column.name]))
            values = pd.Categorical.from_codes(values, categories=categories)
        elif column.unit_in(degrees) != column.unit:
            values = np.degrees(values)
        columns[column.name] = values
        units[column.name] = column.stated_unit(degrees)
    frame = pd.DataFrame(columns)
    frame.attrs["units"] = units
    return frame


def _arrow(
    table: Table, data: TableArrays, words: Mapping[str, Sequence[str]], degrees: bool
) -> "pa.Table":
    """Return rows with columns named as in files; NaN is null, texts are dictionaries."""
    import pyarrow as pa

    def dictionary(places: NDArray[Any], names: Sequence[str]) -> "pa.Array":
        texts = pa.array(list(names), pa.string())
        kind = pa.int8() if len(names) < 128 else pa.int32()
        return pa.DictionaryArray.from_arrays(pa.array(places).cast(kind), texts)

    columns: dict[str, Any] = {}
    for column in table.columns:
        values = data[column.name]
        if column.kind == "status":
            made = dictionary(values, [status.name for status in Status])
        elif column.kind == "text":
            made = dictionary(values, words[column.name])
        elif column.unit_in(degrees) != column.unit:
            made = pa.array(np.degrees(values) + 0.0, from_pandas=True)
        elif column.kind == "number":
            made = pa.array(values + 0.0, from_pandas=True)  # -0 is 0
        else:
            made = pa.array(values, from_pandas=True)
        columns[column.header(degrees)] = made
    return pa.table(columns)


def write_table(
    folder: Path,
    stem: str,
    table: Table,
    rows: AbstractRows,
    notes: Mapping[str, str],
    wanted: Files,
) -> list[str]:
    """Write a table in pieces, CSV and Parquet side by side; return the files' names.

    CSV holds every number with the fewest digits that give it back, and empty cells for
    NaN. Parquet carries units and `notes`. Memory does not grow with the rows.

    Raises
    ------
    OutputError
        If the disk is full; no file of this table is then left.
    """
    import pyarrow as pa
    import pyarrow.csv as pc
    import pyarrow.parquet as pq

    names = {
        kind: f"{stem}.{kind}"
        for kind in FILE_SIZE
        if kind in (wanted.formats or FILE_SIZE)
    }
    plain = not any(
        SPECIAL & set(word) for categories in rows.words.values() for word in categories
    )
    options = pc.WriteOptions(
        include_header=False, quoting_style="none" if plain else "needed"
    )
    with ExitStack() as stack:
        streams = {
            kind: stack.enter_context(writing(folder / name))
            for kind, name in names.items()
        }
        schema, parquet, text = None, None, None
        try:
            for piece in rows.chunks():
                whole = _arrow(table, piece, rows.words, wanted.degrees)
                if schema is None:
                    units = {
                        column.header(wanted.degrees): column.stated_unit(wanted.degrees)
                        for column in table.columns
                    }
                    schema = _noted(whole.schema, {"units": units, **notes})
                    if "parquet" in streams:
                        floats = [f.name for f in schema if pa.types.is_floating(f.type)]
                        texts = [f.name for f in schema if pa.types.is_dictionary(f.type)]
                        parquet = pq.ParquetWriter(
                            streams["parquet"],
                            schema,
                            **PAGES,
                            use_dictionary=texts,
                            use_byte_stream_split=floats,
                        )
                    if "csv" in streams:
                        streams["csv"].write(_header(whole.column_names))
                        words = _with_words(whole).schema
                        text = pc.CSVWriter(streams["csv"], words, write_options=options)
                if parquet is not None:
                    parquet.write_table(whole.cast(schema))
                if text is not None:
                    text.write(_with_words(whole))
            for writer in (parquet, text):
                if writer is not None:
                    writer.close()
        except BaseException:
            if parquet is not None:
                parquet.is_open = False  # it would write its end to a closed file later
            raise
    return list(names.values())


PAGES: Mapping[str, Any] = {"compression": "zstd", "write_page_checksum": True}
"""How pages of Parquet are written."""


def _noted(schema: "pa.Schema", notes: Mapping[str, Any]) -> "pa.Schema":
    """Return a schema with notes, and a checksum of both: pages have theirs."""
    import json

    kept = json.dumps(notes).encode()
    return schema.with_metadata({NOTES: kept, CHECKSUM: _checksum(schema.names, kept)})


def _checksum(names: Sequence[str], notes: bytes) -> bytes:
    return b"%d" % zlib.crc32(notes, zlib.crc32("\n".join(names).encode()))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Give a Parquet file of which headings and pages are what was written.

    The headings are there twice, for Arrow and for all.

    Raises
    ------
    FileError
        If the file cannot be read, is not of Parquet, or is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as stream:
            file = pq.ParquetFile(stream, page_checksum_verification=True)
            for schema, metadata in (
                (file.schema_arrow, file.schema_arrow.metadata),
                (file.schema, file.metadata.metadata),
            ):
                kept = metadata or {}
                checksum = _checksum(schema.names, kept.get(NOTES, b""))
                if kept.get(CHECKSUM, checksum) != checksum:
                    raise pa.ArrowInvalid("its headings have changed")
            yield file
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        said = str(error).strip()
        why = f"is not a Parquet file, or is damaged: {said}; remove it and make it again"
        if isinstance(error, OSError) and error.strerror:
            why = f"cannot be read: {error.strerror}; give the path of a Parquet file"
        raise FileError(f"{path}: {why}") from None


def _read(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return columns of a file, by default all; `FileError` if it is damaged or none."""
    with _opened(path) as file:
        table = file.read(columns=columns)
        table.validate(full=True)
        return table


def write_columns(path: Path, columns: Mapping[str, Any], notes: Mapping[str, Any]) -> None:
    """Write columns of numbers and texts to a Parquet file, texts as dictionaries.

    Raises
    ------
    OutputError
        If it cannot be written; an older file is then unchanged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {
        name: pa.array(values, pa.string()).dictionary_encode()
        if np.asarray(values).dtype.kind in "OU"
        else pa.array(values)
        for name, values in columns.items()
    }
    table = pa.table(arrays)
    table = table.cast(_noted(table.schema, notes))
    with writing(path) as stream:
        pq.write_table(table, stream, **PAGES)


def columns_of_files(paths: Sequence[Path]) -> dict[str, NDArray[Any]]:
    """Return the columns of files that `write_columns` wrote, one after the other."""
    import pyarrow as pa

    whole = pa.concat_tables([_with_words(_read(path)) for path in paths])
    return {name: whole[name].to_numpy() for name in whole.column_names}


DESIGN = "design"
"""The column that says whose rows tables of many designs have."""


@final
class PartTables:
    """The tables of the designs of one part, taken design by design.

    Each is a file `name` in a folder that is called as a run's file, below `folder`; rows
    go there in groups of about `CHUNK`. Without a folder they stay, in `made`. `rows`
    counts those of each table.
    """

    def __init__(
        self, folder: Path | None, name: str, degrees: bool, files: ExitStack
    ) -> None:
        self.made: dict[str, pa.Table] = {}
        self.rows: Counter[str] = Counter()
        self._folder, self._name = folder, name
        self._degrees, self._files = degrees, files
        self._schemas: dict[str, pa.Schema] = {}
        self._waiting: defaultdict[str, list[pa.Table]] = defaultdict(list)
        self._writers: dict[str, Any] = {}

    def take(self, design: int, stem: str, table: Table, data: TableArrays) -> None:
        """Take the rows of a design in a table."""
        import pyarrow as pa

        rows = RowsInMemory(table, data)
        plain = _with_words(_arrow(table, rows.columns, rows.words, self._degrees))
        columns = [
            column.dictionary_encode() if pa.types.is_string(column.type) else column
            for column in plain.columns
        ]
        numbers = pa.array(np.full(rows.count, design))
        whole = pa.table([numbers, *columns], names=[DESIGN, *plain.column_names])
        if stem not in self._schemas:
            units = {
                column.header(self._degrees): column.stated_unit(self._degrees)
                for column in table.columns
            }
            self._schemas[stem] = _noted(whole.schema, {"units": units})
        waiting = self._waiting[stem]
        waiting.append(whole.cast(self._schemas[stem]))
        self.rows[stem] += rows.count
        if self._folder is not None and sum(piece.num_rows for piece in waiting) >= CHUNK:
            self._write(stem)

    def _write(self, stem: str) -> None:
        import pyarrow.parquet as pq

        whole = _joined(self._waiting.pop(stem))
        if stem not in self._writers:
            assert self._folder is not None
            path = make_folder(self._folder / stem) / self._name
            stream = self._files.enter_context(writing(path))
            schema = self._schemas[stem]
            self._writers[stem] = pq.ParquetWriter(stream, schema, **PAGES)
        self._writers[stem].write_table(whole)

    def finish(self) -> None:
        """Write what waits."""
        for stem in list(self._waiting):
            if self._folder is None:
                self.made[stem] = _joined(self._waiting.pop(stem))
            else:
                self._write(stem)
        for writer in self._writers.values():
            writer.close()

    def give_up(self) -> None:
        """Leave the writers: they would write their ends to closed files later."""
        for writer in self._writers.values():
            writer.is_open = False


@contextmanager
def part_tables(folder: Path | None, name: str, degrees: bool) -> Iterator[PartTables]:
    """Give what takes the tables of a part: files are there when the block is left.

    Raises
    ------
    OutputError
        If they cannot be written.
    """
    with ExitStack() as files:
        parts = PartTables(folder, name, degrees, files)
        try:
            yield parts
            parts.finish()
        except BaseException:
            parts.give_up()
            raise


def _joined(pieces: "Sequence[pa.Table]") -> "pa.Table":
    """Return rows one after the other, with one dictionary for each column of texts."""
    import pyarrow as pa

    return pa.concat_tables(pieces).unify_dictionaries().combine_chunks()


def frame_of_parts(parts: "Sequence[Path | pa.Table]") -> "pd.DataFrame":
    """Return the rows of `PartTables`, in files or not, with units in `attrs`."""
    import json

    whole = _joined([_read(part) if isinstance(part, Path) else part for part in parts])
    frame: pd.DataFrame = whole.to_pandas()
    frame.attrs.update(json.loads(whole.schema.metadata[NOTES]))
    return frame


def notes_of(path: Path) -> dict[str, Any]:
    """Return the notes with which a Parquet file was written, {} without."""
    import json

    with _opened(path) as file:
        kept = file.schema_arrow.metadata or {}
    notes: dict[str, Any] = json.loads(kept.get(NOTES, b"{}"))
    return notes


def frame_of(
    columns: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]
) -> "pd.DataFrame":
    """Return columns as a frame, texts as categories, with notes in its `attrs`."""
    import pandas as pd

    frame = pd.DataFrame(
        {
            name: pd.Categorical(values) if values.dtype.kind in "OU" else values
            for name, values in columns.items()
        }
    )
    frame.attrs.update(notes)
    return frame


def _with_words(rows: "pa.Table") -> "pa.Table":
    """Return rows with words in place of their numbers."""
    import pyarrow as pa

    columns = [
        column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
        for column in rows.columns
    ]
    return pa.table(columns, names=rows.column_names)


def _header(names: Sequence[str]) -> bytes:
    return _csv([names])


def _csv(rows: Iterable[Sequence[str]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def columns_text(tables: Mapping[str, Table], degrees: bool) -> bytes:
    """Return the text of `COLUMNS`: of tables by their files' stems, column by column."""
    rows = [
        (stem, column.header(degrees), column.stated_unit(degrees), column.meaning)
        for stem, table in tables.items()
        for column in table.columns
    ]
    return _csv([("table", "column", "unit", "meaning"), *rows])


def read_parquet(path: Path) -> "pd.DataFrame":
    """Return a frame written by `write_table`, with its units in `attrs`."""
    import json

    table = _read(path)
    frame: pd.DataFrame = table.to_pandas()
    raw = (table.schema.metadata or {}).get(NOTES)
    if raw:
        frame.attrs.update(json.loads(raw))
    return frame


@final
class ParquetColumns(Mapping[str, NDArray[Any]]):
    """The columns of a Parquet file that `write_table` wrote, read when asked for.

    In rad, whatever the file has; status as codes, texts as such.
    """

    def __init__(self, path: Path, table: Table, degrees: bool) -> None:
        self._path, self._degrees = path, degrees
        self._columns = {column.name: column for column in table.columns}

    def __len__(self) -> int:
        return len(self._columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __getitem__(self, name: str) -> NDArray[Any]:

        column = self._columns[name]
        header = column.header(self._degrees)
        series = _read(self._path, [header]).to_pandas()[header]
        if column.kind == "status":
            return np.asarray(series.cat.codes)
        if column.kind == "text":
            return np.asarray(series, dtype=str)
        values = np.asarray(series)
        if column.unit_in(self._degrees) != column.unit:
            return np.asarray(np.radians(values))
        return values
