"""Numbers from the columns of CSV and Parquet files, with the positions of bad cells."""

import io
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.files.toml_document import read_pipe
from spherekit.tables.table import COLUMNS
from spherekit.tables.table_files import read_csv, read_parquet
from spherekit.wording import listing

if TYPE_CHECKING:
    import pandas as pd

PARQUET_SUFFIX = ".parquet"

MAX_BAD_CELLS_SHOWN = 5
"""Largest number of bad cells that a message names. The others are counted."""

_UNIT_IN_HEADER = re.compile(r" \[(deg|rad)\]$")
"""The unit of an angle at the end of a header, as in ``q [deg]``."""


@dataclass(frozen=True)
class FileNumbers:
    """Columns of numbers that were read from a CSV or Parquet file.

    Attributes
    ----------
    values
        (rows, columns) numbers, in the units of the file.
    places
        (rows,) position of each row in the file, such as ``line 2``, for messages.
    units
        Units by name of the column. Columns whose unit is not known are left out.
    """

    values: Floats
    places: Sequence[str]
    units: dict[str, str]


def columns_of(path: Path) -> dict[str, str]:
    """Return the headers of the columns of a CSV or Parquet file, by column name.

    A header is the name of a column, often with a unit after it, such as ``q [deg]``. The
    caller finds columns by name, whether or not the file states units.

    Raises
    ------
    FileError
        If the file cannot be read, is neither CSV nor Parquet, or has a column in two
        units.
    """
    header_by_name: dict[str, str] = {}
    for header in map(str, _read_cells(path).columns):
        name = _UNIT_IN_HEADER.sub("", header)
        first_header = header_by_name.setdefault(name, header)
        if header != first_header:
            raise FileError(
                f"{path}: the columns {listing([first_header, header])} have the same "
                "name; remove or rename one of them"
            )
    return header_by_name


def read_numbers(path: Path, names: Sequence[str]) -> FileNumbers:
    """Read some columns of numbers from a CSV or Parquet file.

    The units of the columns are stated in the Parquet file, or in a file in the folder of
    the CSV file. A unit in the header of a column, as in ``q [deg]``, replaces the stated
    unit.

    Parameters
    ----------
    path
        The file.
    names
        Headers of the columns to read.

    Raises
    ------
    FileError
        If the file cannot be read, if several columns have one of the names, or if a cell
        is not a finite number.
    """
    cells = _read_cells(path)[list(names)]
    if cells.shape[1] > len(names):
        repeated = sorted(set(cells.columns[cells.columns.duplicated()]))
        raise FileError(
            f"{path}: several columns have the name {listing(repeated)}; remove or rename "
            "one of them"
        )
    if path.suffix == PARQUET_SUFFIX:
        row_word = "row"
        first_number = 1
        units = cells.attrs.get("units", {})
    else:
        # Line 1 is the header, so the first row of numbers is line 2.
        row_word = "line"
        first_number = 2
        units = _read_units_of_folder(path)
    rows = [[_parse_number(cell) for cell in row] for row in cells.itertuples(index=False)]
    # Without rows, the shape (0,) becomes (0, columns).
    values = np.array(rows).reshape(-1, len(names))
    places = [f"{row_word} {index + first_number}" for index in cells.index]
    bad_cells = [
        f"{places[row]}, column {names[k]}: {_describe_bad_cell(cells.iat[row, k])}"
        for row, k in np.argwhere(~np.isfinite(values)).tolist()
    ]
    if bad_cells:
        unnamed = len(bad_cells) - MAX_BAD_CELLS_SHOWN
        more = f" and {unnamed} more" if unnamed > 0 else ""
        raise FileError(
            f"{path}: {'; '.join(bad_cells[:MAX_BAD_CELLS_SHOWN])}{more}; every cell has "
            "to be a number"
        )
    for name in names:
        if unit_in_header := _UNIT_IN_HEADER.search(name):
            units = units | {name: unit_in_header[1]}
    return FileNumbers(values, places, units)


def _read_units_of_folder(path: Path) -> dict[str, str]:
    """Return the units that the folder of a run states for the columns of a CSV file.

    The units are in the file `COLUMNS` beside the tables. The dictionary is empty if there
    is no such file, or if it does not have this table.
    """
    # The file may be another program's: without these columns, or with two of a name.
    with suppress(FileError, KeyError, ValueError):
        descriptions = _read_cells(path.with_name(COLUMNS)).set_index("table")
        columns = descriptions.loc[[path.stem]]
        return dict(zip(columns["column"], columns["unit"], strict=True))
    return {}


def _parse_number(cell: Any) -> float:
    """Return a cell as a number; NaN if the cell is not a number."""
    try:
        return float(cell)
    except (TypeError, ValueError):
        return np.nan


def _describe_bad_cell(cell: object) -> str:
    """Return what is wrong with a cell, for a message."""
    text = str(cell).strip()
    return "empty" if text in ("nan", "") else f'"{text[:40]}" is not a finite number'


def _read_cells(path: Path) -> "pd.DataFrame":
    """Return the cells of a CSV or Parquet file as a pandas frame.

    The cells of a CSV file are still texts. The index of the frame counts the lines after
    the header (the rows of a Parquet file) from 0, for messages about bad cells.

    Raises
    ------
    FileError
        If the file cannot be read.
    """
    if path.suffix == PARQUET_SUFFIX:
        return read_parquet(path)
    try:
        # If the file is a pipe of the shell, such as /dev/stdin, its content is read here.
        data = read_pipe(path)
        return read_csv(path if data is None else io.BytesIO(data))
    except OSError as error:
        raise FileError(
            f"{path}: cannot be read: {error.strerror or error}; give the path of a "
            "CSV or Parquet file"
        ) from None
    except ValueError as error:
        reason = str(error).strip()
        raise FileError(f"{path}: is not a CSV file with a header: {reason}") from None
