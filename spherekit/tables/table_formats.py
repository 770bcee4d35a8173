"""File formats of tables, each declared once: ending, size, separator and default use.

The files themselves are written in `tables/table_files.py`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Format = Literal["csv", "parquet"]
"""Names of the file formats of tables: the keys of `TABLE_FORMATS`."""

MAX_CSV_BYTES = 1e8
"""Size of all CSV files of a run up to which they are written without being requested.

Larger: long runs write large text files. Smaller: more runs write Parquet files only.
"""


@dataclass(frozen=True)
class TableFormat:
    """A file format in which tables of results can be written, such as CSV or Parquet.

    Attributes
    ----------
    ending
        Ending of the file names, without the dot. Formats that are written together need
        different endings.
    relative_size
        Approximate size of the files divided by the size of the same numbers in memory. The
        ratio was measured on tables of motions and poles. It predicts the size of files
        before a run.
    separator
        Character between the cells of a CSV file; None for Parquet.
    is_default
        Whether the files are written when the user names no format. CSV files are left out
        if all of them together would exceed `MAX_CSV_BYTES`.
    """

    ending: str
    relative_size: float
    separator: str | None = None
    is_default: bool = True


TABLE_FORMATS: Mapping[Format, TableFormat] = {
    "csv": TableFormat("csv", relative_size=2.2, separator=","),
    "parquet": TableFormat("parquet", relative_size=0.6),
}
"""All file formats of tables by their names, in the order in which files are listed."""

DEFAULT_FORMATS: tuple[Format, ...] = tuple(
    name for name, table_format in TABLE_FORMATS.items() if table_format.is_default
)
"""Formats that are written when the user names none and the tables are small."""

FORMAT_CHOICES: Mapping[str, tuple[Format, ...]] = {
    "both": DEFAULT_FORMATS,
    **{name: (name,) for name in TABLE_FORMATS},
}
"""Formats for each value of the option ``--format``."""


def choose_formats(
    requested: Sequence[Format] | None, csv_bytes: float
) -> tuple[Format, ...]:
    """Return the formats in which the tables of a run are written.

    Parameters
    ----------
    requested
        Formats that the user requests. None means the default formats, without CSV if the
        tables are larger than `MAX_CSV_BYTES`.
    csv_bytes
        Approximate size of the tables as CSV.
    """
    if requested is not None:
        return tuple(requested)
    if csv_bytes <= MAX_CSV_BYTES:
        return DEFAULT_FORMATS
    return tuple(name for name in DEFAULT_FORMATS if not is_csv(name))


def is_csv(name: Format) -> bool:
    """Return whether the files of a format are text with separated cells."""
    return TABLE_FORMATS[name].separator is not None


def csv_separator(formats: Sequence[Format]) -> str:
    """Return the separator of the first CSV format in a list, a comma if there is none."""
    for name in formats:
        separator = TABLE_FORMATS[name].separator
        if separator is not None:
            return separator
    return ","
