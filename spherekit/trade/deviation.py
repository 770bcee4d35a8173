"""How far tables are off: the largest scaled deviation of their columns."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import Column, Table, TableData
from spherekit.conventions import EPS


@final
@dataclass(frozen=True)
class Deviation:
    """The largest deviation of one column from its reference.

    `error` is in units of `scale`: 1 for absolute errors, else the largest reference. It
    is never given below the rounding of float64. `compared` numbers have a reference;
    `missing` of these are not given.
    """

    table: str
    column: str
    error: float
    scale: float
    compared: int
    missing: int


def is_absolute(column: Column) -> bool:
    """Whether errors of a column are absolute, not relative to its largest number."""
    return column.scale == "absolute" or (column.scale == "unit" and column.unit == "rad")


def scale_words(column: Column) -> str:
    """Return how errors of a column are measured."""
    if column.scale == "none":
        return "not a result"
    return f"absolute {column.unit}".strip() if is_absolute(column) else "over the largest"


def deviations(
    tables: Sequence[Table],
    given: Mapping[str, TableData],
    reference: Mapping[str, TableData],
) -> Iterator[Deviation]:
    """Yield the deviation of every column of numbers in tables of equal rows."""
    for table in tables:
        for column in table.columns:
            if column.kind == "number" and column.scale != "none":
                ours = np.asarray(given[table.name][column.name], dtype=float)
                theirs = np.asarray(reference[table.name][column.name], dtype=float)
                if len(ours) == len(theirs):
                    yield _of_column(table.name, column, ours, theirs)


def _of_column(
    table: str, column: Column, ours: NDArray[Any], theirs: NDArray[Any]
) -> Deviation:
    known = np.isfinite(theirs)
    both = known & np.isfinite(ours)
    off = np.abs(ours[both] - theirs[both])
    if is_absolute(column):
        scale = 1.0
        if column.unit == "rad":
            off = np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi)))
    else:
        scale = float(np.max(np.abs(theirs[known]), initial=0.0)) or 1.0
    error = float(np.max(off, initial=0.0)) / scale
    missing = int(np.sum(known & ~both))
    return Deviation(
        table, column.name, max(error, EPS), scale, int(np.sum(known)), missing
    )


def worst(found: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    told = [each for each in found if each.compared > each.missing]
    return max(told, key=lambda each: each.error, default=None)
