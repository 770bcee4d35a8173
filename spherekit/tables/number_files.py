"""Numbers from the columns of CSV and Parquet files, bad cells named by their place."""

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
from spherekit.files.toml_document import piped
from spherekit.tables.table import COLUMNS
from spherekit.tables.table_files import read_csv, read_parquet

if TYPE_CHECKING:
    import pandas as pd

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
    return {_NAMED.sub("", header): header for header in map(str, _frame(path).columns)}


def read_numbers(path: Path, names: Sequence[str]) -> Numbers:
    """Return columns of a CSV or Parquet file.

    Raises
    ------
    FileError
        If it cannot be read, or a cell is not a finite number, with line or row.
    """
    cells = _frame(path)[list(names)]
    word = "line"
    first = 2
    units = cells.attrs.get("units", {})
    if path.suffix == PARQUET:
        word = "row"
        first = 1
    else:
        with suppress(FileError, KeyError):  # what the folder of a run states
            stated = _frame(path.with_name(COLUMNS)).set_index("table").loc[[path.stem]]
            units = dict(zip(stated["column"], stated["unit"], strict=True))
    values = np.array([[_number(x) for x in row] for row in cells.itertuples(index=False)])
    values = values.reshape(-1, len(names))
    places = [f"{word} {number + first}" for number in cells.index]
    bad = [
        f"{places[row]}, column {names[k]}: {_shown(cells.iat[row, k])}"
        for row, k in np.argwhere(~np.isfinite(values)).tolist()
    ]
    if bad:
        more = f" and {len(bad) - MOST_SHOWN} more" if len(bad) > MOST_SHOWN else ""
        raise FileError(
            f"{path}: {'; '.join(bad[:MOST_SHOWN])}{more}; every cell has to be a number"
        )
    return Numbers(
        values,
        places,
        units | {name: match[1] for name in names if (match := _NAMED.search(name))},
    )


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return np.nan


def _shown(cell: object) -> str:
    text = str(cell).strip()
    return "empty" if text in ("nan", "") else f'"{text[:40]}" is not a finite number'


def _frame(path: Path) -> "pd.DataFrame":
    """Return the cells of a file; of CSV as text, by lines after the header."""
    if path.suffix == PARQUET:
        return read_parquet(path)
    try:
        data = piped(path)
        return read_csv(path if data is None else io.BytesIO(data))
    except OSError as problem:
        raise FileError(
            f"{path}: cannot be read: {problem.strerror or problem}; give the path of a "
            "CSV or Parquet file"
        ) from None
    except ValueError as problem:
        raise FileError(f"{path}: is not a CSV file with a header: {problem}") from None
