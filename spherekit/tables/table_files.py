"""Tables as pandas frames and files; the only module that imports pandas.

A Parquet file has checksums of its pages, and one of its headings: what has changed in it
is told. It is there whole, or not at all.
"""

import csv
import io
import json
import warnings
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import Lines
from spherekit.errors import FileError
from spherekit.status import Status
from spherekit.storage.atomic_write import make_folder, writing
from spherekit.tables.table import CHUNK, FILE_SIZE, TYPES, Format, Table, TableArrays
from spherekit.tables.table_rows import JoinedBlocks, typed

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

NOTES = b"spherekit"
"""Where a Parquet file keeps the units of its columns and what it came from."""

CHECKSUM = b"spherekit checksum"
"""Where it keeps that of these and of the names of its columns."""

SPECIAL = set(',"\r\n')

STATUSES = [status.name for status in Status]


def to_frame(table: Table, data: TableArrays, degrees: bool = False) -> "pd.DataFrame":
    """Return a table as a frame, its units in ``attrs["units"]``.

    With `degrees`, angles and their rates are in degrees; what is per rad stays so.
    """
    import pandas as pd

    columns: dict[str, Any] = typed(table, data)
    for column in table.columns:
        values = columns[column.name]
        if column.kind == "status":
            columns[column.name] = pd.Categorical.from_codes(values, pd.Index(STATUSES))
        elif column.unit_in(degrees) != column.unit:
            columns[column.name] = np.degrees(values)
    units = {column.name: column.stated_unit(degrees) for column in table.columns}
    return frame_of(columns, {"units": units}, not isinstance(data, JoinedBlocks))


def frame_of(
    columns: Mapping[str, Any], notes: Mapping[str, Any], copy: bool = True
) -> "pd.DataFrame":
    """Return columns as a frame, texts as categories, with notes in its `attrs`."""
    import pandas as pd

    made = {
        name: _categories(x) if x.dtype.kind in "OU" else x for name, x in columns.items()
    }
    frame = pd.DataFrame(made, copy=copy)
    frame.attrs.update(notes)
    return frame


def _categories(texts: Array) -> "pd.Categorical[Any]":
    """Return texts as categories, told apart letter by letter: strings take longer."""
    import pandas as pd

    if texts.dtype.kind == "O":
        return pd.Categorical(texts)
    codes = np.zeros(len(texts), dtype=np.int64)
    letters = np.ascontiguousarray(texts).view(np.uint32)
    for column in letters.reshape(len(texts), texts.itemsize // 4).T:
        if np.any(column != column[:1]):
            here, kinds = pd.factorize(column)
            codes, _ = pd.factorize(codes * len(kinds) + here)
    first = np.flatnonzero(np.diff(np.maximum.accumulate(codes), prepend=-1))
    words: Lines = texts[first].tolist()
    places = np.argsort(np.argsort(words))
    return pd.Categorical.from_codes(places[codes], pd.Index(sorted(words), dtype=str))


def _arrow(table: Table, data: Mapping[str, Any], degrees: bool) -> "pa.Table":
    """Return rows with columns named as in files; NaN is null, status a dictionary."""
    import pyarrow as pa

    columns: dict[str, Any] = {}
    for column in table.columns:
        values = data[column.name]
        if column.kind == "status":
            codes = pa.array(values, pa.int8())
            values = pa.DictionaryArray.from_arrays(codes, pa.array(STATUSES))
        elif column.kind == "number":
            if column.unit_in(degrees) != column.unit:
                values = np.degrees(values)
            values = pa.array(values + 0.0, from_pandas=True)  # -0 is 0
        columns[column.header(degrees)] = values
    return pa.table(columns)


def write_table(
    stem: Path,
    table: Table,
    pieces: Iterable[Mapping[str, Any]],
    notes: Mapping[str, str],
    degrees: bool,
    formats: Sequence[Format] | None,
) -> list[str]:
    """Write the pieces of a table, CSV and Parquet side by side; return the files' names.

    The `stem` is their path without an ending.

    CSV holds every number with the fewest digits that give it back, and empty cells for
    NaN. Parquet carries units and `notes`. Memory does not grow with the rows.

    Raises
    ------
    OutputError
        If the disk is full; no file of this table is then left.
    """
    import pyarrow as pa
    import pyarrow.csv as pc

    none = {
        column.name: np.zeros(0, TYPES.get(column.kind, str)) for column in table.columns
    }
    rest = (_arrow(table, piece, degrees) for piece in pieces)
    first = next(rest, None) or _arrow(table, none, degrees)
    paths = {kind: stem.with_name(f"{stem.name}.{kind}") for kind in formats or FILE_SIZE}
    with ExitStack() as stack:
        if "parquet" in paths:
            schema = _noted(first.schema, {"units": table.units(degrees), **notes})
            parquet = stack.enter_context(_parquet(paths["parquet"], schema))
        if "csv" in paths:
            text = stack.enter_context(writing(paths["csv"]))
            text.write(csv_text([first.column_names]))
        for piece in chain([first], rest):
            if "parquet" in paths:
                parquet.write_table(piece.cast(schema))
            if "csv" in paths:
                texts = [x.unique() for x in piece.columns if pa.types.is_string(x.type)]
                words = "".join(word for x in texts for word in x.to_pylist())
                options = pc.WriteOptions(
                    include_header=False,
                    quoting_style="none" if SPECIAL.isdisjoint(words) else "needed",
                )
                pc.write_csv(_with_words(piece), text, options)
    return [path.name for path in paths.values()]


def pieces_in(groups: Iterable[tuple[Path, int]]) -> Iterator[Mapping[str, Any]]:
    """Yield rows in such pieces from row groups of files that `write_columns` wrote.

    Raises
    ------
    FileError
        If a file is damaged, or none.
    """
    import pyarrow as pa

    def plain(rows: pa.Table) -> Mapping[str, Any]:
        return {
            name: column if pa.types.is_string(column.type) else column.to_numpy()
            for name, column in zip(rows.column_names, rows.columns, strict=True)
        }

    held: list[pa.Table] = []
    for path, group in groups:
        with _opened(path) as file:
            held.append(file.read_row_group(group, use_threads=False))
        while sum(map(len, held)) >= CHUNK:
            whole = pa.concat_tables(held)
            held = [whole[CHUNK:]]
            yield plain(whole[:CHUNK])
    if sum(map(len, held)):
        yield plain(pa.concat_tables(held))


def _noted(schema: "pa.Schema", notes: Mapping[str, Any]) -> "pa.Schema":
    """Return a schema with notes, and a checksum of both: pages have theirs."""
    kept = json.dumps(notes).encode()
    return schema.with_metadata({NOTES: kept, CHECKSUM: _checksum(schema.names, kept)})


def _checksum(names: Sequence[str], notes: bytes) -> bytes:
    return b"%d" % zlib.crc32(notes, zlib.crc32("\n".join(names).encode()))


@contextmanager
def _parquet(
    path: Path, schema: "pa.Schema", compression: str = "zstd"
) -> "Iterator[pq.ParquetWriter]":
    """Give what writes a Parquet file, there when the block is left without a fault."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    floats = [item.name for item in schema if pa.types.is_floating(item.type)]
    texts = [item.name for item in schema if not pa.types.is_primitive(item.type)]
    with writing(path) as stream:
        writer = pq.ParquetWriter(
            stream,
            schema,
            compression=compression,
            write_page_checksum=True,
            use_dictionary=texts,
            use_byte_stream_split=floats if compression == "zstd" else False,
        )
        try:
            yield writer
            writer.close()
        finally:
            writer.is_open = False  # it would write its end to a closed file later


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
            file = pq.ParquetFile(stream, page_checksum_verification=True, pre_buffer=False)
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
        why = (
            f"is not a Parquet file, or is damaged: {' '.join(str(error).split())}; "
            "remove it and make it again"
        )
        if isinstance(error, OSError) and error.strerror:
            why = f"cannot be read: {error.strerror}; give the path of a Parquet file"
        raise FileError(f"{path}: {why}") from None


def _read(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return columns of a file, by default all; `FileError` if it is damaged or none."""
    with _opened(path) as file:
        table = file.read(columns=columns)
        table.validate(full=True)
        return table


def notes_of(path: Path) -> dict[str, Any]:
    """Return the notes with which a Parquet file was written, {} without."""
    with _opened(path) as file:
        return _notes(file.schema_arrow)


def _notes(schema: "pa.Schema") -> dict[str, Any]:
    return json.loads((schema.metadata or {}).get(NOTES, b"{}"))


def write_columns(
    path: Path,
    columns: Mapping[str, Any],
    notes: Mapping[str, Any],
    groups: Sequence[slice] = (slice(None),),
    compression: str = "zstd",
) -> None:
    """Write columns of numbers and texts to a Parquet file.

    Raises
    ------
    OutputError
        If it cannot be written; an older file is then unchanged.
    """
    import pyarrow as pa

    table = pa.table(
        {
            name: pa.array(values, pa.string() if values.dtype.kind in "OU" else None)
            for name, values in columns.items()
        }
    )
    with _parquet(path, _noted(table.schema, notes), compression) as file:
        for rows in groups:
            file.write_table(table[rows].cast(file.schema))


DESIGN = "design"
"""The column that says whose rows tables of many designs have."""


@contextmanager
def part_tables(
    folder: Path,
    name: str,
    degrees: bool,
    rows: Counter[str],
    notes: Mapping[str, Any],
) -> Iterator[Callable[[int, str, Table, TableArrays], None]]:
    """Give what takes the rows of a design in a table, called as a run's file.

    Each is a file `name` in a folder that is called so, below `folder`, there when the
    block is left; rows go there in groups of about `CHUNK`. `rows` counts those of each,
    and each carries the `notes`.

    Raises
    ------
    OutputError
        If they cannot be written.
    """
    import pyarrow as pa

    waiting: defaultdict[str, list[pa.Table]] = defaultdict(list)
    writers: dict[str, pq.ParquetWriter] = {}

    def write(stem: str) -> None:
        whole = pa.concat_tables(waiting.pop(stem))
        if stem not in writers:
            writers[stem] = files.enter_context(
                _parquet(make_folder(folder / stem) / name, whole.schema)
            )
        writers[stem].write_table(whole)

    def take(design: int, stem: str, table: Table, data: TableArrays) -> None:
        plain = _arrow(table, typed(table, data), degrees)
        whole = plain.add_column(0, DESIGN, pa.array(np.full(len(plain), design)))
        waiting[stem].append(
            whole.cast(_noted(whole.schema, {"units": table.units(degrees), **notes}))
        )
        rows[stem] += len(whole)
        if sum(map(len, waiting[stem])) >= CHUNK:
            write(stem)

    with ExitStack() as files:
        yield take
        for stem in list(waiting):
            write(stem)


def frame_of_parts(
    parts: Sequence[Path], notes: Sequence[Mapping[str, Any]] | None = None
) -> "pd.DataFrame":
    """Return the rows of Parquet files one after the other, with notes in `attrs`.

    Parameters
    ----------
    parts
        The files.
    notes
        Notes that each file has to carry; by default none has to.

    Raises
    ------
    FileError
        If a file is damaged, does not carry its notes, or has other columns than the first.
    """
    import pyarrow as pa

    tables: list[pa.Table] = []
    for path, required in zip(parts, notes or [{}] * len(parts), strict=True):
        table = _read(path)
        if not required.items() <= _notes(table.schema).items() or (
            tables and not table.schema.equals(tables[0].schema)
        ):
            raise FileError(
                f"{path}: is not the file that was written there, by what it says of "
                "itself; move it away, and the same command makes it again"
            )
        tables.append(table)
    whole = pa.concat_tables(tables)
    frame: pd.DataFrame = whole.to_pandas(strings_to_categorical=True)
    frame.attrs.update(_notes(whole.schema))
    return frame


def read_parquet(path: Path) -> "pd.DataFrame":
    """Return a frame written by `write_table`, with its units in `attrs`."""
    return frame_of_parts([path])


def read_csv(source: Path | io.BytesIO) -> "pd.DataFrame":
    """Return the cells of a CSV file as text, by lines after the header but blank ones.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or is no such file.
    """
    import pandas as pd

    # A comma at the end of every row is no column.
    with warnings.catch_warnings(action="ignore", category=pd.errors.ParserWarning):
        frame = pd.read_csv(
            source,
            dtype=str,
            keep_default_na=False,
            skip_blank_lines=False,
            index_col=False,
            encoding="utf-8-sig",
        )
    frame.columns = frame.columns.str.strip()
    return frame[(frame != "").any(axis=1)]


def _with_words(rows: "pa.Table") -> "pa.Table":
    """Return rows with words in place of their numbers."""
    import pyarrow as pa

    columns = [
        column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
        for column in rows.columns
    ]
    return pa.table(columns, names=rows.column_names)


def csv_text(rows: Iterable[Sequence[str]]) -> bytes:
    """Return rows of texts as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


class ParquetColumns(Mapping[str, Array]):
    """The columns of a Parquet file that `write_table` wrote, read when asked for.

    In rad, whatever the file has; status as codes, texts as such.
    """

    def __init__(self, path: Path, table: Table, degrees: bool) -> None:
        self._path = path
        self._degrees = degrees
        self._columns = {column.name: column for column in table.columns}

    def __len__(self) -> int:
        return len(self._columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __getitem__(self, name: str) -> Array:
        column = self._columns[name]
        header = column.header(self._degrees)
        series = _read(self._path, [header]).to_pandas()[header]
        if column.kind == "status":
            return np.asarray(series.cat.codes)
        if column.kind == "text":
            return np.asarray(series, dtype=str)
        values = np.asarray(series)
        if column.unit_in(self._degrees) != column.unit:
            return np.radians(values)
        return values
