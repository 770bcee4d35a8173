"""The largest scaled deviation between the columns of two tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.tables.table import Column, Table, Tables, arrays
from spherekit.tolerances import EPS


@dataclass(frozen=True)
class Deviation:
    """The largest deviation of one column, named ``TABLE.COLUMN``, from its reference.

    `error` is in units of `scale`: 1 for absolute errors, else the largest reference. It
    is never given below the rounding of float64. `compared` numbers have a reference;
    `missing` of these are not given. `estimate` is the analysis's own of its error.
    """

    column: str
    error: float
    scale: float
    compared: int
    missing: int
    estimate: float = np.nan


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
    given: Tables,
    reference: Tables,
) -> list[Deviation]:
    """Return the deviation of every column of numbers in tables of equal rows.

    Errors that are not absolute are over the largest reference of all such columns of the
    table with the same unit: a torque that balances others may itself be rounding. Where
    all derivatives by an angle are, they are over what they are derivatives of.
    """
    made = []
    for table in tables:
        ours, theirs = (arrays(data[table.name]) for data in (given, reference))
        results = [c for c in table.columns if c.kind == "number" and c.scale != "none"]
        largest: dict[str, float] = {}
        for column in results:
            if not is_absolute(column):
                values = theirs[column.name]
                size = max_abs(values[np.isfinite(values)])
                largest[column.unit] = max(size, largest.get(column.unit, 0.0))
        for column in results:
            scale = 1.0 if is_absolute(column) else _scale(largest, column.unit)
            off, count = _apart(column, ours[column.name], theirs[column.name])
            error = max(max_abs(off) / scale, EPS)
            name = f"{table.name}.{column.name}"
            made.append(Deviation(name, error, scale, count, count - len(off)))
    return made


def _scale(largest: Mapping[str, float], unit: str) -> float:
    size = largest[unit]
    whole = _integrated(unit)
    before = 0.0 if whole is None else largest.get(whole, 0.0)
    return (size if size > EPS * before else before) or 1.0


def _apart(column: Column, ours: Floats, theirs: Floats) -> tuple[Floats, int]:
    """Return by how much numbers differ that both have, and how many are expected."""
    expected = np.isfinite(theirs)
    count = int(np.sum(expected))
    if len(ours) != len(theirs):
        return np.zeros(0), count
    both = expected & np.isfinite(ours)
    off = ours[both] - theirs[both]
    return wrap(off) if column.unit == "rad" else off, count


def worst(compared: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    told = [deviation for deviation in compared if deviation.compared > deviation.missing]
    return max(told, key=lambda deviation: deviation.error, default=None)
