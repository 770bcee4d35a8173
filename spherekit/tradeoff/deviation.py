"""How far tables are off: the largest scaled deviation of their columns."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import Column, Table, TableArrays
from spherekit.conventions import EPS
from spherekit.numeric.turns import wrap


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
    if is_absolute(column):
        return f"absolute {column.unit}".strip()
    in_unit = f" in {column.unit}" if column.unit else ""
    words = f"relative to the largest number{in_unit} of the table"
    whole = _integrated(column.unit)
    if whole is None:
        return words
    return f"{words}; if that is rounding, {f'in {whole}' if whole else 'without unit'}"


def _integrated(unit: str) -> str | None:
    """Return the unit of what a column is a derivative of by an angle, else None."""
    whole = unit.removesuffix("/rad")
    return None if whole == unit else whole.removeprefix("1")


def deviations(
    tables: Sequence[Table],
    given: Mapping[str, TableArrays],
    reference: Mapping[str, TableArrays],
) -> Iterator[Deviation]:
    """Yield the deviation of every column of numbers in tables of equal rows.

    Errors that are not absolute are over the largest reference of all such columns of the
    table with the same unit: a torque that balances others may itself be rounding. Where
    all derivatives by an angle are, they are over what they are derivatives of.
    """
    for table in tables:
        ours, theirs = given[table.name], reference[table.name]
        results = [c for c in table.columns if c.kind == "number" and c.scale != "none"]
        largest: dict[str, float] = {}
        for column in results:
            if is_absolute(column):
                continue
            values = np.abs(np.asarray(theirs[column.name], dtype=float))
            size = float(np.max(values[np.isfinite(values)], initial=0.0))
            largest[column.unit] = max(size, largest.get(column.unit, 0.0))
        for column in results:
            scale = 1.0 if is_absolute(column) else _scale(largest, column.unit)
            one = np.asarray(ours[column.name], dtype=float)
            other = np.asarray(theirs[column.name], dtype=float)
            yield _of_column(table.name, column, one, other, scale)


def _scale(largest: Mapping[str, float], unit: str) -> float:
    size, whole = largest[unit], _integrated(unit)
    before = 0.0 if whole is None else largest.get(whole, 0.0)
    return (size if size > EPS * before else before) or 1.0


def _of_column(
    table: str,
    column: Column,
    ours: NDArray[Any],
    theirs: NDArray[Any],
    scale: float,
) -> Deviation:
    if len(ours) != len(theirs):
        lost = int(np.sum(np.isfinite(theirs)))
        return Deviation(table, column.name, np.inf, scale, lost, lost)
    expected = np.isfinite(theirs)
    both = expected & np.isfinite(ours)
    off = np.abs(ours[both] - theirs[both])
    if column.unit == "rad":
        off = np.abs(wrap(off))
    error = max(float(np.max(off, initial=0.0)) / scale, EPS)
    missing = int(np.sum(expected & ~both))
    return Deviation(table, column.name, error, scale, int(np.sum(expected)), missing)


def worst(compared: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    told = [deviation for deviation in compared if deviation.compared > deviation.missing]
    return max(told, key=lambda deviation: deviation.error, default=None)
