"""Tables as pandas frames and as CSV and Parquet files; only this module imports pandas.

A Parquet file has checksums of its pages, and one of its headings and notes, so changes in
it are noticed. Files are written completely or not at all.
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
from spherekit.errors import FileError
from spherekit.status import Status
from spherekit.storage.atomic_write import make_folder, open_for_writing
from spherekit.tables.table import (
    CHUNK_ROWS,
    DTYPE_BY_KIND,
    Table,
    TableArrays,
)
from spherekit.tables.table_formats import (
    DEFAULT_FORMATS,
    TABLE_FORMATS,
    Format,
    csv_separator,
)
from spherekit.tables.table_rows import JoinedBlocks, convert_columns

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

NOTES_KEY = b"spherekit"
"""Key of a Parquet file for notes: the units of its columns and its origin."""

CHECKSUM_KEY = b"spherekit checksum"
"""Key of a Parquet file for the checksum of the notes and the names of its columns."""

QUOTED_CHARACTERS = frozenset('"\r\n')
"""Characters that make quotes necessary in a CSV file, besides the separator."""

STATUS_NAMES = [status.name for status in Status]
"""Names of the codes of a sample."""

DESIGN_COLUMN = "design"
"""The column with the number of the design, in tables of the rows of many designs."""


def to_frame(table: Table, data: TableArrays, degrees: bool = False) -> "pd.DataFrame":
    """Return a table as a pandas frame, with the units of columns in ``attrs["units"]``.

    Parameters
    ----------
    table
        Declaration of the table: name, kind and unit of each column.
    data
        The columns of the table by name.
    degrees
        Whether angles, their rates and accelerations are converted to degrees. Quantities
        per rad, such as Nm/rad, stay the same.
    """
    import pandas as pd

    columns: dict[str, Any] = convert_columns(table, data)
    for column in table.columns:
        values = columns[column.name]
        if column.kind == "status":
            columns[column.name] = pd.Categorical.from_codes(values, pd.Index(STATUS_NAMES))
        elif column.unit_in(degrees) != column.unit:
            columns[column.name] = np.degrees(values)
    # The unit after the conversion. Pure numbers have the unit "1".
    units = {column.name: column.stated_unit(degrees) for column in table.columns}
    # `JoinedBlocks` makes new arrays each time, which the frame can use without a copy.
    # Other data may be changed later, so the frame copies them.
    has_new_arrays = isinstance(data, JoinedBlocks)
    return make_frame(columns, {"units": units}, copy=not has_new_arrays)


def make_frame(
    columns: Mapping[str, Any], notes: Mapping[str, Any], copy: bool = True
) -> "pd.DataFrame":
    """Return columns as a pandas frame, with texts as categories (each text stored once).

    Parameters
    ----------
    columns
        Arrays (n,) by the name of the column.
    notes
        Facts about the table by name, such as units, which become the `attrs` of the frame.
    copy
        Whether the frame copies the arrays. Otherwise it may share them.
    """
    import pandas as pd

    # "O" (Python strings) and "U" (texts of fixed width) are the kinds of arrays with
    # texts.
    frame_columns = {
        name: _make_categories(values) if values.dtype.kind in "OU" else values
        for name, values in columns.items()
    }
    frame = pd.DataFrame(frame_columns, copy=copy)
    frame.attrs.update(notes)
    return frame


def _make_categories(texts: Array) -> "pd.Categorical[Any]":
    """Return texts (n,) as a pandas column of categories in alphabetical order.

    Each distinct text is stored once, which saves memory and time in large tables.
    """
    import pandas as pd

    has_python_strings = texts.dtype.kind == "O"
    if has_python_strings:
        return pd.Categorical(texts)

    # Equal texts have equal numbers: 0, 1, ... in the order in which they first occur.
    text_numbers = _number_distinct_texts(texts)
    # The first row of each distinct text. So `distinct_texts[k]` is the text number k.
    is_first_row = ~pd.Series(text_numbers).duplicated().to_numpy()
    distinct_texts: list[str] = texts[is_first_row].tolist()
    # Category k is the text at the position k in alphabetical order.
    categories = sorted(distinct_texts)
    category_by_text = {text: category for category, text in enumerate(categories)}
    category_by_number = np.array(
        [category_by_text[text] for text in distinct_texts], dtype=np.intp
    )
    return pd.Categorical.from_codes(
        category_by_number[text_numbers], pd.Index(categories, dtype=str)
    )


def _number_distinct_texts(texts: Array) -> Array:
    """Return a number for each text, with equal numbers for equal texts.

    Distinct texts are numbered 0, 1, ... in the order in which they first occur. The texts
    are a NumPy array of fixed width. The letters of the texts are compared as integers,
    which is faster than making Python strings.
    """
    import pandas as pd

    # Each letter is an integer of 4 bytes: (texts, letters of a text).
    letters = np.ascontiguousarray(texts).view(np.uint32)
    letters = letters.reshape(len(texts), texts.itemsize // 4)
    # `factorize` numbers distinct values in the order in which they first occur. After each
    # letter, two texts have the same number if they agree up to this letter.
    numbers = np.zeros(len(texts), dtype=np.int64)
    for letter_column in letters.T:
        all_letters_are_equal = np.all(letter_column == letter_column[:1])
        if all_letters_are_equal:
            continue
        letter_numbers, distinct_letters = pd.factorize(letter_column)
        # One integer for each combination of the number so far and this letter.
        pairs = numbers * len(distinct_letters) + letter_numbers
        numbers, _ = pd.factorize(pairs)
    return numbers


def _make_arrow_table(table: Table, data: Mapping[str, Any], degrees: bool) -> "pa.Table":
    """Return rows of a table as a table of the library Arrow, which writes Parquet and CSV.

    The name of each column becomes its header, such as ``q [deg]``. NaN becomes null (an
    empty cell), and status codes become names.

    Parameters
    ----------
    table
        Declaration of the table.
    data
        Columns (n,) by name.
    degrees
        Whether angles are converted to degrees.
    """
    import pyarrow as pa

    columns: dict[str, Any] = {}
    for column in table.columns:
        values = data[column.name]
        if column.kind == "status":
            codes = pa.array(values, pa.int8())
            values = pa.DictionaryArray.from_arrays(codes, pa.array(STATUS_NAMES))
        elif column.kind == "number":
            if column.unit_in(degrees) != column.unit:
                values = np.degrees(values)
            # Adding 0.0 changes -0.0 to 0.0. With `from_pandas`, NaN becomes null.
            values = pa.array(values + 0.0, from_pandas=True)
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
    """Write a table as CSV and Parquet files; return the names of the files.

    In CSV files every number has the fewest digits from which the same number is read
    again, and cells with NaN are empty. Parquet has the units and notes. The memory does
    not grow with the number of rows.

    Parameters
    ----------
    stem
        Path of the files without a suffix.
    table
        Declaration of the table.
    pieces
        Columns of the rows, one piece (group of rows) after another.
    notes
        Notes for the Parquet file.
    degrees
        Whether angles are converted to degrees.
    formats
        Formats to write, by default `DEFAULT_FORMATS`.

    Raises
    ------
    OutputError
        If a file cannot be written; it is then absent, or the older file is unchanged.
    """
    import pyarrow.csv as pc

    arrow_pieces = (_make_arrow_table(table, piece, degrees) for piece in pieces)
    first_piece = next(arrow_pieces, None)
    if first_piece is None:
        no_rows = {
            column.name: np.zeros(0, DTYPE_BY_KIND.get(column.kind, str))
            for column in table.columns
        }
        first_piece = _make_arrow_table(table, no_rows, degrees)
    paths = {
        name: stem.with_name(f"{stem.name}.{TABLE_FORMATS[name].ending}")
        for name in formats or DEFAULT_FORMATS
    }
    schema = _add_notes(first_piece.schema, {"units": table.units(degrees), **notes})
    separator_by_csv_stream = {}
    parquet_writers = []
    with ExitStack() as open_files:
        for name, path in paths.items():
            separator = TABLE_FORMATS[name].separator
            if separator is not None:
                csv_stream = open_files.enter_context(open_for_writing(path))
                csv_stream.write(format_csv([first_piece.column_names], separator))
                separator_by_csv_stream[csv_stream] = separator
            else:
                parquet_writers.append(
                    open_files.enter_context(_open_parquet_writer(path, schema))
                )
        for piece in chain([first_piece], arrow_pieces):
            for parquet_writer in parquet_writers:
                parquet_writer.write_table(piece.cast(schema))
            for csv_stream, separator in separator_by_csv_stream.items():
                options = pc.WriteOptions(
                    include_header=False,
                    delimiter=separator,
                    quoting_style="needed" if _needs_quotes(piece, separator) else "none",
                )
                pc.write_csv(_replace_codes_by_texts(piece), csv_stream, options)
    return [path.name for path in paths.values()]


def _needs_quotes(rows: "pa.Table", separator: str) -> bool:
    """Return whether a text in some rows has a character that CSV has to quote."""
    import pyarrow as pa

    distinct_texts = [x.unique() for x in rows.columns if pa.types.is_string(x.type)]
    characters = "".join(text for x in distinct_texts for text in x.to_pylist())
    return not {*QUOTED_CHARACTERS, separator}.isdisjoint(characters)


def read_chunks(groups: Iterable[tuple[Path, int]]) -> Iterator[Mapping[str, Any]]:
    """Yield the rows of several Parquet files in pieces of `CHUNK_ROWS` rows.

    A large table is never in memory as a whole. The rows of a Parquet file are divided into
    row groups, which can be read in any order.

    Parameters
    ----------
    groups
        For each row group, in the order of the result: the path of its file, which
        `write_columns` wrote, and the index of the group in this file.

    Yields
    ------
    Columns by name. The last piece has the remaining rows.

    Raises
    ------
    FileError
        If a file is missing or damaged.
    """
    import pyarrow as pa

    def to_arrays(rows: pa.Table) -> Mapping[str, Any]:
        """Return columns by name: numbers as NumPy arrays, texts as Arrow columns."""
        return {
            name: column if pa.types.is_string(column.type) else column.to_numpy()
            for name, column in zip(rows.column_names, rows.columns, strict=True)
        }

    # Row groups that were read and not yet yielded.
    pending: list[pa.Table] = []
    for path, group in groups:
        with _open_parquet_file(path) as file:
            pending.append(file.read_row_group(group, use_threads=False))
        # A row group can be longer or shorter than a piece.
        while sum(map(len, pending)) >= CHUNK_ROWS:
            rows = pa.concat_tables(pending)
            pending = [rows[CHUNK_ROWS:]]
            yield to_arrays(rows[:CHUNK_ROWS])
    if sum(map(len, pending)):
        yield to_arrays(pa.concat_tables(pending))


def _add_notes(schema: "pa.Schema", notes: Mapping[str, Any]) -> "pa.Schema":
    """Return a schema with notes, and a checksum of the notes and of the column names."""
    encoded_notes = json.dumps(notes).encode()
    checksum = _compute_checksum(schema.names, encoded_notes)
    return schema.with_metadata({NOTES_KEY: encoded_notes, CHECKSUM_KEY: checksum})


def _compute_checksum(names: Sequence[str], notes: bytes) -> bytes:
    """Return the checksum of column names and encoded notes, in decimal digits."""
    return b"%d" % zlib.crc32(notes, zlib.crc32("\n".join(names).encode()))


@contextmanager
def _open_parquet_writer(
    path: Path, schema: "pa.Schema", compression: str = "zstd"
) -> "Iterator[pq.ParquetWriter]":
    """Open a Parquet file for writing in a ``with`` block.

    If the block raises an error, no new file remains, and an older file is not changed.

    Parameters
    ----------
    path
        The file.
    schema
        Names and types of the columns, and notes.
    compression
        Name of the method that compresses the file, such as "zstd".
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    # Each distinct text is stored once, in a dictionary.
    texts = [item.name for item in schema if not pa.types.is_primitive(item.type)]
    # With compression by zstd, floats are stored byte by byte: their first bytes together,
    # then their second bytes, and so on. Equal bytes next to each other compress better.
    byte_by_byte: list[str] | bool = False
    if compression == "zstd":
        byte_by_byte = [item.name for item in schema if pa.types.is_floating(item.type)]
    with open_for_writing(path) as stream:
        writer = pq.ParquetWriter(
            stream,
            schema,
            compression=compression,
            write_page_checksum=True,
            use_dictionary=texts,
            use_byte_stream_split=byte_by_byte,
        )
        try:
            yield writer
            writer.close()
        finally:
            # After an error the writer is still open, and would write to the closed stream
            # when Python deletes the writer.
            writer.is_open = False


def _check_headings(file: "pq.ParquetFile") -> None:
    """Compare the column names and the notes of a Parquet file with their checksum.

    The checksum detects accidental changes. A file stores names and notes twice: once for
    the library Arrow and once for all programs. Files of other programs have no checksum
    and are accepted.

    Raises
    ------
    pyarrow.ArrowInvalid
        If the checksum differs.
    """
    import pyarrow as pa

    for schema, metadata in (
        (file.schema_arrow, file.schema_arrow.metadata),
        (file.schema, file.metadata.metadata),
    ):
        stored = metadata or {}
        checksum = _compute_checksum(schema.names, stored.get(NOTES_KEY, b""))
        # Without a stored checksum the comparison passes.
        if stored.get(CHECKSUM_KEY, checksum) != checksum:
            raise pa.ArrowInvalid("its headings have changed")


@contextmanager
def _open_parquet_file(path: Path) -> Iterator[Any]:
    """Open a Parquet file for reading in a ``with`` block, and check that it is undamaged.

    The checksum of column names and notes is compared at once. The data have other
    checksums, which pyarrow verifies when the ``with`` block reads them.

    Raises
    ------
    FileError
        If the file cannot be read, is not a Parquet file, or is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as stream:
            # `pre_buffer` would read ahead in background threads, which helps only with
            # slow file systems.
            file = pq.ParquetFile(stream, page_checksum_verification=True, pre_buffer=False)
            _check_headings(file)
            yield file
    # Errors of the caller's ``with`` block arrive here.
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        reason = (
            f"is not a Parquet file, or is damaged: {' '.join(str(error).split())}; remove "
            "it and make it again"
        )
        if isinstance(error, OSError) and error.strerror:
            reason = f"cannot be read: {error.strerror}; give the path of a Parquet file"
        raise FileError(f"{path}: {reason}") from None


def _read_arrow_table(
    path: Path,
    columns: Sequence[str] | None = None,
    metadata: "pq.FileMetaData | None" = None,
) -> "pa.Table":
    """Return columns of a Parquet file, by default all.

    Parameters
    ----------
    path
        The file.
    columns
        Names of the columns, None for all.
    metadata
        The metadata that the file had when it was opened first. They differ if another run
        has replaced the file since. None: they are not compared.

    Raises
    ------
    FileError
        If the file is missing or damaged, or has other metadata than the given ones.
    """
    with _open_parquet_file(path) as file:
        if metadata is not None and not file.metadata.equals(metadata):
            raise FileError(
                f"{path}: the file has been replaced since the run wrote it; do the run "
                "again, in a folder of its own"
            )
        table = file.read(columns=columns)
        table.validate(full=True)
        return table


def read_notes(path: Path) -> dict[str, Any]:
    """Return the notes of a Parquet file; an empty dictionary if it has none."""
    with _open_parquet_file(path) as file:
        return _decode_notes(file.schema_arrow)


def _decode_notes(schema: "pa.Schema") -> dict[str, Any]:
    """Return the notes of a schema; an empty dictionary if it has none."""
    return json.loads((schema.metadata or {}).get(NOTES_KEY, b"{}"))


def write_columns(
    path: Path,
    columns: Mapping[str, Any],
    notes: Mapping[str, Any],
    groups: Sequence[slice] = (slice(None),),
    compression: str = "zstd",
) -> None:
    """Write columns of numbers and texts to a Parquet file.

    Parameters
    ----------
    path
        The file.
    columns
        Arrays (n,) by the name of the column.
    notes
        Facts about the table by name, which are stored in the file. JSON must be able to
        represent them.
    groups
        The rows of each row group, a part of the file that can be read by itself. By
        default all rows are one group.
    compression
        Name of the method by which the pages of the file are compressed.

    Raises
    ------
    OutputError
        If the file cannot be written; an older file is then unchanged.
    """
    import pyarrow as pa

    table = pa.table(
        {
            name: pa.array(values, pa.string() if values.dtype.kind in "OU" else None)
            for name, values in columns.items()
        }
    )
    schema = _add_notes(table.schema, notes)
    with _open_parquet_writer(path, schema, compression) as writer:
        for rows in groups:
            writer.write_table(table[rows])


@contextmanager
def open_part_tables(
    folder: Path,
    name: str,
    degrees: bool,
    row_counts: Counter[str],
    notes: Mapping[str, Any],
) -> Iterator[Callable[[int, str, Table, TableArrays], None]]:
    """Open the tables in which a part of a sweep collects the rows of its designs.

    The context manager returns a function that appends rows. Its arguments are the number
    of the design, the stem of the table's file in a run, the declaration and the columns.
    Each table is a file called `name` in a subfolder called like the stem. The files appear
    when the block ends without error.

    Parameters
    ----------
    folder
        Folder of the subfolders.
    name
        Name of the file in each subfolder.
    degrees
        Whether angles are converted to degrees.
    row_counts
        Counter of the rows of each table by stem, which is updated.
    notes
        Notes of each file.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    import pyarrow as pa

    # By the stem of the table: rows that are not yet written, and the open file.
    pending: defaultdict[str, list[pa.Table]] = defaultdict(list)
    writers: dict[str, pq.ParquetWriter] = {}

    # `open_files` is set below, before these functions are called.
    def write_pending(stem: str) -> None:
        """Write the rows of a table that are not yet written; open its file if needed."""
        rows = pa.concat_tables(pending.pop(stem))
        if stem not in writers:
            path = make_folder(folder / stem) / name
            writers[stem] = open_files.enter_context(
                _open_parquet_writer(path, rows.schema)
            )
        writers[stem].write_table(rows)

    def append_rows(design: int, stem: str, table: Table, data: TableArrays) -> None:
        """Append the rows of one design; they are written in pieces of `CHUNK_ROWS`."""
        rows = _make_arrow_table(table, convert_columns(table, data), degrees)
        rows = rows.add_column(0, DESIGN_COLUMN, pa.array(np.full(len(rows), design)))
        schema = _add_notes(rows.schema, {"units": table.units(degrees), **notes})
        pending[stem].append(rows.cast(schema))
        row_counts[stem] += len(rows)
        if sum(map(len, pending[stem])) >= CHUNK_ROWS:
            write_pending(stem)

    with ExitStack() as open_files:
        yield append_rows
        for stem in list(pending):
            write_pending(stem)


def read_frame(
    parts: Sequence[Path], notes: Sequence[Mapping[str, Any]] | None = None
) -> "pd.DataFrame":
    """Return the rows of several Parquet files as one pandas frame.

    The `attrs` of the frame are the notes (facts about the table) in the first file. If
    pandas has written the files from a frame, the index of that frame becomes a column, and
    its `attrs` are kept.

    Parameters
    ----------
    parts
        The files, in the order of their rows.
    notes
        For each file the notes that it must have, so that no wrong file is read. By default
        no notes are required.

    Raises
    ------
    FileError
        If a file is damaged, lacks the required notes, or has other columns than the
        first file.
    """
    import pyarrow as pa

    tables: list[pa.Table] = []
    for path, required_notes in zip(parts, notes or [{}] * len(parts), strict=True):
        table = _read_arrow_table(path)
        has_notes = required_notes.items() <= _decode_notes(table.schema).items()
        has_other_columns = tables and not table.schema.equals(tables[0].schema)
        if not has_notes or has_other_columns:
            raise FileError(
                f"{path}: the file has been changed since it was written; move the file "
                "away, and run the same command to create it again"
            )
        tables.append(table)
    rows = pa.concat_tables(tables)
    # pandas stores in its files which columns are the index. Here they stay columns.
    frame: pd.DataFrame = rows.to_pandas(strings_to_categorical=True, ignore_metadata=True)
    # A file that pandas has written from a frame has the `attrs` of that frame.
    frame.attrs.update((rows.schema.pandas_metadata or {}).get("attributes") or {})
    frame.attrs.update(_decode_notes(rows.schema))
    return frame


def read_parquet(path: Path) -> "pd.DataFrame":
    """Return a Parquet file of `write_table` as a frame, with the units in `attrs`."""
    return read_frame([path])


def read_csv(source: Path | io.BytesIO) -> "pd.DataFrame":
    """Return the cells of a CSV file as strings, in a pandas frame.

    The index of the frame is the number of the row after the header, from 0, for messages.
    Blank lines are left out, so their numbers are missing in the index. Two columns may
    have the same name.

    Parameters
    ----------
    source
        The path of the file, or its content.

    Raises
    ------
    OSError, ValueError
        If the file cannot be read, is not a CSV file, or has a row with more cells than the
        header.
    """
    import pandas as pd

    # Read separately, because pandas numbers headers that occur again: `q`, `q.1`.
    header_row = _read_csv_rows(source, row_limit=1)
    headers = header_row.iloc[0].fillna("").str.strip()
    width = len(headers)
    # If the first row has more cells than the header, pandas drops cells and warns of it.
    with warnings.catch_warnings(action="error", category=pd.errors.ParserWarning):
        try:
            frame = _read_csv_rows(source, header=0)
        except pd.errors.ParserWarning:
            frame = _read_csv_rows(source, skipped_rows=1)
            surplus_cells = frame.iloc[:, width:].fillna("")
            # Every row may end with a comma. Then the cell after the comma is empty.
            if (surplus_cells != "").any(axis=None):
                raise ValueError(
                    f"a row has more cells than the header, which has {width}; write "
                    "numbers with a decimal point"
                ) from None
            frame = frame.iloc[:, :width]
    frame.columns = pd.Index(headers)
    return frame[(frame != "").any(axis=1)]


def _read_csv_rows(
    source: Path | io.BytesIO,
    header: int | None = None,
    skipped_rows: int = 0,
    row_limit: int | None = None,
) -> "pd.DataFrame":
    """Return rows of a CSV file as strings.

    Parameters
    ----------
    source
        The path of the file, or its content.
    header
        The row with the names of the columns. By default the columns are numbered.
    skipped_rows
        Number of rows at the beginning of the file that are left out.
    row_limit
        Largest number of rows, by default all.
    """
    import pandas as pd

    if isinstance(source, io.BytesIO):
        source.seek(0)
    return pd.read_csv(
        source,
        header=header,
        skiprows=skipped_rows,
        nrows=row_limit,
        dtype=str,
        keep_default_na=False,
        skip_blank_lines=False,
        index_col=False,
        encoding="utf-8-sig",
    )


def _replace_codes_by_texts(rows: "pa.Table") -> "pa.Table":
    """Return rows in which dictionary columns, such as a status, are texts."""
    import pyarrow as pa

    columns = [
        column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
        for column in rows.columns
    ]
    return pa.table(columns, names=rows.column_names)


def format_csv(rows: Iterable[Sequence[str]], separator: str = ",") -> bytes:
    """Return rows of texts as CSV."""
    text = io.StringIO()
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def format_column_list(
    tables: Mapping[str, Table], degrees: bool, formats: Sequence[Format]
) -> bytes:
    """Return the text of `columns.csv`: unit and meaning of the columns of some tables.

    Parameters
    ----------
    tables
        The tables, which declare their columns, by the names of their files without ending.
    degrees
        Whether the files have angles in degrees.
    formats
        Formats of the files. They determine the separator in `columns.csv`.
    """
    rows = [
        (file_stem, column.header(degrees), column.stated_unit(degrees), column.meaning)
        for file_stem, table in tables.items()
        for column in table.columns
    ]
    header = ("table", "column", "unit", "meaning")
    return format_csv([header, *rows], csv_separator(formats))


class ParquetColumns(Mapping[str, Array]):
    """The columns of a Parquet file by name. A column is read when it is used.

    The file was written by `write_table`. If angles in the file are in degrees, they are
    converted to rad. A status column has names in the file, and is returned as codes. If a
    later run has replaced the file, reading a column raises `FileError`.

    Parameters
    ----------
    path
        The file.
    table
        Declaration of the table.
    degrees
        Whether angles in the file are in degrees.
    """

    def __init__(self, path: Path, table: Table, degrees: bool) -> None:
        """Keep the path, the declarations and the metadata; no column is read yet."""
        self._path = path
        # Names, sizes and extreme values of the columns show if the file is replaced.
        with _open_parquet_file(path) as file:
            self._metadata = file.metadata
        self._degrees = degrees
        self._columns = {column.name: column for column in table.columns}

    def __len__(self) -> int:
        return len(self._columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __getitem__(self, name: str) -> Array:
        """Read a column: status codes, texts, or numbers with angles in rad."""
        column = self._columns[name]
        header = column.header(self._degrees)
        rows = _read_arrow_table(self._path, [header], self._metadata)
        series = rows.to_pandas()[header]
        if column.kind == "status":
            return np.asarray(series.cat.codes)
        if column.kind == "text":
            return np.asarray(series, dtype=str)
        values = np.asarray(series)
        if column.unit_in(self._degrees) != column.unit:
            return np.radians(values)
        return values
