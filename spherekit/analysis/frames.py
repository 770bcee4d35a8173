"""Tables as pandas frames and files; the only module that imports pandas."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import Table, TableData
from spherekit.conventions import Status

if TYPE_CHECKING:
    import pandas as pd


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
