"""The largest scaled deviations between the columns of two tables."""

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
    """The largest deviation of the numbers of one column from reference values.

    There are two kinds of comparison. `compute_deviations` compares row by row.
    `spherekit.runs.trade` also compares runs with different values of a parameter of an
    analysis, such as its tolerance. Their columns can have different numbers of rows. Each
    number is therefore compared with the nearest reference value, and each reference value
    with the nearest number (comparison by nearest values). Only rows with the same texts,
    such as the kind of a singularity, are compared.

    Attributes
    ----------
    column
        Names of the table and the column: ``TABLE.COLUMN``.
    error
        The largest deviation, divided by `scale`. The smallest possible value is the
        rounding error of float64.
    scale
        1 for absolute errors, such as errors of angles. Otherwise the largest reference
        value of all columns of the table with the same unit, with the exceptions that
        `_find_scale` lists. In a comparison by nearest values, the largest reference value
        of this column alone.
    compared
        Number of comparisons, including those that `missing` counts: one for each reference
        value. A comparison by nearest values also has one for each number whose texts
        occur in the reference. Two tables without any position count as one comparison.
    missing
        Number of reference values for which the table has no number. In a comparison by
        nearest values, these are the values whose texts occur in no row of the table with a
        number. If the values are positions (such as dead centres), numbers whose texts
        occur in no row of the reference are counted, too.
    estimate
        Largest error that the analysis itself estimates, divided by the largest value in
        the column. NaN without an estimate.
    """

    column: str
    error: float
    scale: float
    compared: int
    missing: int
    estimate: float = np.nan


def is_absolute(column: Column) -> bool:
    """Return whether errors of a column are absolute, and not relative to its numbers."""
    return column.scale == "absolute" or (column.scale == "unit" and column.unit == "rad")


def describe_scale(column: Column) -> str:
    """Return how errors of a column are measured."""
    if is_absolute(column):
        return f"absolute {column.unit}".strip()
    in_unit = f"in {column.unit}" if column.unit else "without unit"
    words = f"relative to the largest number {in_unit} of the table"
    unit = _integrated_unit(column.unit)
    if unit is None:
        return words
    other_columns = f"in {unit}" if unit else "without unit"
    return f"{words}, or {other_columns} if that is only a rounding error"


def _integrated_unit(unit: str) -> str | None:
    """Return the unit of a quantity from the unit of its derivative per unit angle.

    For example N from N/rad, and no unit from 1/rad. None if the unit does not end with
    /rad.
    """
    integrated = unit.removesuffix("/rad")
    if integrated == unit:
        return None
    return "" if integrated == "1" else integrated


def compute_deviations(
    tables: Sequence[Table],
    given: Tables,
    reference: Tables,
) -> list[Deviation]:
    """Return the largest deviation of every column of numbers from reference values.

    Some errors are absolute, such as errors of angles. All other errors are relative to a
    scale: the largest reference value of all columns of the table with the same unit. A
    single column is no good scale, because all its values may be rounding errors, for
    example of a torque that is zero in theory.

    Parameters
    ----------
    tables
        The declared tables.
    given, reference
        Columns of these tables: the numbers, and the reference values. Tables with
        different numbers of rows have no deviation; all their numbers count as missing.
    """
    deviations = []
    for table in tables:
        columns = arrays(given[table.name])
        reference_columns = arrays(reference[table.name])
        # Columns with the scale "none" have no meaningful error.
        compared_columns = [
            column
            for column in table.columns
            if column.kind == "number" and column.scale != "none"
        ]
        # The scale of relative errors: the largest reference of all columns with one unit.
        largest_by_unit: dict[str, float] = {}
        for column in compared_columns:
            if not is_absolute(column):
                values = reference_columns[column.name]
                largest = max_abs(values[np.isfinite(values)])
                previous = largest_by_unit.get(column.unit, 0.0)
                largest_by_unit[column.unit] = max(largest, previous)
        for column in compared_columns:
            scale = 1.0
            if not is_absolute(column):
                scale = _find_scale(largest_by_unit, column.unit)
            # The differences in the rows in which both tables have a number, and the number
            # of rows in which the reference has one.
            differences, reference_count = _subtract(
                column, columns[column.name], reference_columns[column.name]
            )
            # A deviation below one rounding of float64 counts as one rounding.
            deviations.append(
                Deviation(
                    column=f"{table.name}.{column.name}",
                    error=max(max_abs(differences) / scale, EPS),
                    scale=scale,
                    compared=reference_count,
                    missing=reference_count - len(differences),
                )
            )
    return deviations


def _find_scale(largest_by_unit: Mapping[str, float], unit: str) -> float:
    """Return the number by which errors of columns with a certain unit are divided.

    The scale is usually the largest reference value with this unit. Derivatives with
    respect to an angle, for example in N m/rad, are only rounding errors if the columns in
    N m are constant. For such derivatives the scale is the largest value of the columns in
    N m.

    Parameters
    ----------
    largest_by_unit
        The largest reference value of the table by unit.
    unit
        The unit of the columns.

    Returns
    -------
    The scale, 1.0 if all values are 0.
    """
    largest = largest_by_unit[unit]
    # The unit of the functions, None if the unit is not the unit of a derivative with
    # respect to an angle.
    function_unit = _integrated_unit(unit)
    largest_function = 0.0
    if function_unit is not None:
        largest_function = largest_by_unit.get(function_unit, 0.0)
    is_rounding = largest <= EPS * largest_function
    return (largest_function if is_rounding else largest) or 1.0


def _subtract(column: Column, values: Floats, reference: Floats) -> tuple[Floats, int]:
    """Return the differences between the values in a column and reference values.

    The caller reports the largest difference, and how many reference values have no number
    to compare.

    Parameters
    ----------
    column
        The declaration of the column. If its unit is rad, differences are in (-pi, pi].
    values, reference
        (n,) numbers and reference values, NaN in failed rows.

    Returns
    -------
    differences
        (k,) differences in the rows with both a finite number and a finite reference. Empty
        if the two columns have different lengths.
    reference_count
        Number of finite reference values.
    """
    has_reference = np.isfinite(reference)
    reference_count = int(np.sum(has_reference))
    if len(values) != len(reference):
        return np.zeros(0), reference_count
    has_both = has_reference & np.isfinite(values)
    differences = values[has_both] - reference[has_both]
    if column.unit == "rad":
        differences = wrap(differences)
    return differences, reference_count


def find_largest_deviation(deviations: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    compared = [item for item in deviations if item.compared > item.missing]
    return max(compared, key=lambda deviation: deviation.error, default=None)
