"""Numbers from the columns of CSV and Parquet files, bad cells named by their place."""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.analysis.frames import read_parquet
from spherekit.analysis.tables import COLUMNS
from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.files.document import piped

PARQUET = ".parquet"
MOST_SHOWN = 5
"""Bad cells of a file that are named; of the others only the number."""
_NAMED = re.compile(r" \[(deg|rad)\]$")
"""The unit of an angle at the end of a header."""


@dataclass(frozen=True)
class Numbers:
    """Columns (n, names) of a file, the place of each row in it, and units if it says."""

    values: Floats
    places: Sequence[str]
    units: dict[str, str]


def columns_of(path: Path) -> dict[str, str]:
    """Return the headers of the columns of a CSV or Parquet file by their names.

    A header may say a unit, as that of ``q`` in ``q [deg]``.

    Raises
    ------
    FileError
        If it cannot be read, or is no such file.
    """
    if path.suffix == PARQUET:
        headers = list(map(str, read_parquet(path).columns))
    else:
        with _rows(path) as rows:
            headers = list(_header(path, rows))
    return {_NAMED.sub("", header): header for header in headers}


def read_numbers(path: Path, names: Sequence[str]) -> Numbers:
    """Return columns of a CSV or Parquet file.

    Raises
    ------
    FileError
        If it cannot be read, or a cell is not a finite number, with line or row.
    """
    rows: list[tuple[str, Sequence[Any]]] = []
    if path.suffix == PARQUET:
        frame = read_parquet(path)
        units = dict(frame.attrs.get("units", {}))
        cells = frame[list(names)].itertuples(index=False)
        rows += ((f"row {number}", row) for number, row in enumerate(cells, 1))
    else:
        units = _units_beside(path)
        with _rows(path) as reader:
            header = _header(path, reader)
            order = [header.index(name) for name in names]
            for row in filter(None, reader):
                picked = [row[k] if k < len(row) else "" for k in order]
                rows.append((f"line {reader.line_num}", picked))
    values = [[_number(cell) for cell in row] for _, row in rows]
    bad = [
        f"{place}, column {name}: {_shown(cell)}"
        for (place, row), numbers in zip(rows, values, strict=True)
        for name, cell, number in zip(names, row, numbers, strict=True)
        if not np.isfinite(number)
    ]
    if bad:
        more = f" and {len(bad) - MOST_SHOWN} more" if len(bad) > MOST_SHOWN else ""
        raise FileError(
            f"{path}: {'; '.join(bad[:MOST_SHOWN])}{more}; every cell has to be a number"
        )
    said = {name: match[1] for name in names if (match := _NAMED.search(name))}
    places = [place for place, _ in rows]
    return Numbers(np.array(values).reshape(-1, len(names)), places, units | said)


def _units_beside(path: Path) -> dict[str, str]:
    """Return the units of the columns of a CSV file that the folder of a run states."""
    with suppress(FileError, OSError), _rows(path.with_name(COLUMNS)) as rows:
        stated = [row for row in rows if len(row) > 2 and row[0] == path.stem]
        return {column: unit for _, column, unit, *_ in stated}
    return {}


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return np.nan


def _shown(cell: Any) -> str:
    text = str(cell).strip()
    return "empty" if text in ("nan", "") else f'"{text[:40]}" is not a finite number'


def _header(path: Path, rows: Iterator[list[str]]) -> list[str]:
    header = [name.strip() for name in next(rows, [])]
    if not any(header):
        raise FileError(f"{path}: is not a CSV file with a header: its first line is empty")
    return header


@contextmanager
def _rows(path: Path) -> "Iterator[Any]":
    """Yield the reader of a CSV file."""
    try:
        data = piped(path)
        if data is not None:
            yield csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""))
            return
        with path.open(newline="", encoding="utf-8-sig") as file:
            yield csv.reader(file)
    except OSError as problem:
        raise FileError(
            f"{path}: cannot be read: {problem.strerror or problem}; give the path of a "
            "CSV or Parquet file"
        ) from None
    except (csv.Error, UnicodeDecodeError) as problem:
        raise FileError(f"{path}: is not a CSV file: {problem}") from None
