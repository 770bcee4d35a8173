"""Tables as pandas frames and files; the only module that imports pandas."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import Table, TableData
from spherekit.conventions import Status
from spherekit.errors import FileError

if TYPE_CHECKING:
    import pandas as pd

MOST_SHOWN = 5
"""Bad cells of a file that are named; of the others only the number."""


def to_frame(table: Table, data: TableData, degrees: bool = False) -> "pd.DataFrame":
    """Return a table as a frame; with `degrees`, columns in rad become deg, rates too."""
    import pandas as pd

    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for column in table.columns:
        values: Any = data[column.name]
        unit = column.unit
        if column.kind == "status":
            names = [status.name for status in Status]
            values = pd.Categorical.from_codes(values, categories=pd.Index(names))
        elif column.kind == "text":
            codes, words = _codes(np.asarray(values))
            values = pd.Categorical.from_codes(codes, categories=pd.Index(words))
        elif degrees and unit in ("rad", "rad/s", "rad/s2"):
            values, unit = np.degrees(values), unit.replace("rad", "deg")
        elif degrees and unit == "1/rad":
            values, unit = np.radians(values), "1/deg"
        columns[column.name] = values
        units[column.name] = unit
    frame = pd.DataFrame(columns)
    frame.attrs["units"] = units
    return frame


def _codes(words: NDArray[Any]) -> tuple[NDArray[Any], list[str]]:
    unique, codes = np.unique(words, return_inverse=True)
    return codes, [str(word) for word in unique]


def csv_bytes(frame: "pd.DataFrame") -> bytes:
    """Return a frame as CSV text: 17 significant digits, empty cells for NaN."""
    return frame.to_csv(index=False, lineterminator="\n").encode()


def parquet_bytes(frame: "pd.DataFrame", notes: dict[str, str]) -> bytes:
    """Return a frame as a Parquet file that carries its units and lineage."""
    import json

    import pyarrow as pa
    import pyarrow.parquet as pq

    units = dict(frame.attrs.get("units", {}))
    table = pa.Table.from_pandas(frame, preserve_index=False)
    metadata = dict(table.schema.metadata or {})
    metadata[b"spherekit"] = json.dumps({"units": units, **notes}).encode()
    stream = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(metadata), stream)
    return stream.getvalue()


def read_parquet(path: Path) -> "pd.DataFrame":
    """Return a frame written by `parquet_bytes`, with its units in `attrs`."""
    import json

    import pyarrow.parquet as pq

    table = pq.read_table(path)
    frame: pd.DataFrame = table.to_pandas()
    raw = (table.schema.metadata or {}).get(b"spherekit")
    if raw:
        frame.attrs.update(json.loads(raw))
    return frame


def columns_of(path: Path) -> tuple[str, ...]:
    """Return the names of the columns of a CSV or Parquet file.

    Raises
    ------
    FileError
        If it cannot be read, or is no such file.
    """
    if path.suffix == ".parquet":
        return tuple(map(str, _parquet(path).columns))
    return tuple(map(str, _csv(path, nrows=0).columns))


def read_numbers(path: Path, names: Sequence[str]) -> tuple[NDArray[Any], dict[str, str]]:
    """Return columns (rows, names) of a CSV or Parquet file, and their units if it says.

    Raises
    ------
    FileError
        If it cannot be read, or a cell is no finite number, with file and line.
    """
    if path.suffix == ".parquet":
        frame = _parquet(path)
        units = frame.attrs.get("units", {})
        frame = frame[list(names)]
        first = "row", 1
    else:
        try:
            frame, units = _csv(path, usecols=list(names), dtype=float), {}
        except FileError:
            frame, units = _csv(path, usecols=list(names), dtype=str), {}
        frame = frame[list(names)]
        first = "line", 2
    import pandas as pd

    numbers = frame.apply(pd.to_numeric, errors="coerce").to_numpy(float)
    bad = ~np.isfinite(numbers)
    if np.any(bad):
        rows, places = np.nonzero(bad)
        shown = [
            f"{first[0]} {row + first[1]}, column {names[k]}: {_cell(frame.iloc[row, k])}"
            for row, k in zip(rows[:MOST_SHOWN], places[:MOST_SHOWN], strict=True)
        ]
        more = f" and {len(rows) - MOST_SHOWN} more" if len(rows) > MOST_SHOWN else ""
        raise FileError(f"{path}: {'; '.join(shown)}{more}; every cell has to be a number")
    return numbers, units


def _cell(value: Any) -> str:
    text = str(value)
    return "empty" if text in ("nan", "") else f'"{text[:40]}" is no finite number'


def _csv(path: Path, **options: Any) -> "pd.DataFrame":
    import pandas as pd

    try:
        frame: pd.DataFrame = pd.read_csv(path, skip_blank_lines=False, **options)
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except ValueError as problem:  # of pandas: no columns, ragged rows, no text
        raise FileError(f"{path}: is no CSV file with a header: {problem}") from None
    return frame


def _parquet(path: Path) -> "pd.DataFrame":
    import pyarrow as pa

    try:
        return read_parquet(path)
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except pa.ArrowException as problem:
        raise FileError(f"{path}: is no Parquet file: {problem}") from None
