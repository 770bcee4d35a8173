"""Compares tables of an analysis and describes the first difference in words."""

import re
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import PluginError
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.tables.table import Column, Table, TableArrays, row_count

BLOCK_TOLERANCE = 1e-10
"""Largest difference of numbers that are computed in other blocks, as a part of the largest
number of their column (or of 1)."""

VARIANT_TOLERANCE = 1e-6
"""The same for a mechanism that is described in another way. Rounding errors grow where the
mechanism is nearly singular."""


def describe_difference(
    table: Table,
    expected: TableArrays,
    compared: TableArrays,
    is_variant: bool = False,
    rotation: Floats | None = None,
) -> str:
    """Return the first difference of two tables in words; an empty text if there is none.

    The checks of an analysis use it in two cases. Either both tables are of one mechanism,
    but computed with other blocks, with hidden data or with a failed row. Or `compared` is
    the table of a variant: the mechanism rotated as a whole, or with other names of links.

    Parameters
    ----------
    table
        The declaration of the table.
    expected, compared
        The columns of the two tables.
    is_variant
        Whether `compared` is of a variant. A larger tolerance applies to a variant. Columns
        that describe the computation, such as error bounds, are not compared.
    rotation
        (3, 3) rotation of the mechanism of `compared`, None if it is not rotated. Vectors
        of `expected` are rotated before they are compared. Columns that depend on axes in
        another way are left out. If such columns can change the rows, nothing is compared.
    """
    tolerance = VARIANT_TOLERANCE if is_variant else BLOCK_TOLERANCE
    if rotation is not None:
        # Columns that a rotation of the mechanism changes in another way than vectors, such
        # as the longitude of an axis.
        axis_dependent_columns = [
            column for column in table.columns if column.turns == "otherwise"
        ]
        # With such columns, the rotated mechanism may have other rows, which cannot be
        # compared. For example, a text column can name the longitude to which a row
        # belongs. A table without such a text keeps its rows if it has one for each
        # sample and assembly mode.
        if axis_dependent_columns:
            has_dependent_text = any(
                column.kind == "text" for column in axis_dependent_columns
            )
            if has_dependent_text or not table.in_assembly_modes:
                return ""
    expected_rows = row_count(expected)
    compared_rows = row_count(compared)
    if expected_rows != compared_rows:
        return f"table {table.name} has {compared_rows} rows instead of {expected_rows}"
    for column, values, compared_values in _column_pairs(
        table, expected, compared, rotation
    ):
        # The scale "none" marks columns that describe the computation.
        if is_variant and column.scale == "none":
            continue
        row = _first_different_row(column, values, compared_values, tolerance)
        if row is not None:
            return (
                f"table {table.name}, column {column.name}, row {row}: "
                f"{compared_values[row]} instead of {values[row]}"
            )
    return ""


def _column_pairs(
    table: Table, expected: TableArrays, compared: TableArrays, rotation: Floats | None
) -> Iterator[tuple[Column, Array, Array]]:
    """Yield each column that can be compared, with its expected and compared values.

    The compared table may be that of a mechanism that was rotated as a whole. Vectors of
    the expected table are then rotated too. A vector is three successive columns, its
    components. Other columns that depend on the axes are left out.

    Parameters
    ----------
    table
        The declaration of the table. `Column.turns` says how a column depends on axes.
    expected, compared
        Columns of the two tables.
    rotation
        (3, 3) rotation from the mechanism of `expected` to the mechanism of `compared`,
        None without a rotation.
    """
    vector_columns: list[Column] = []
    for column in table.columns:
        # `turns` is "no" for numbers that do not depend on axes, "vector" for components of
        # a vector, and "otherwise" for others.
        if rotation is None or column.kind == "text" or column.turns == "no":
            yield column, expected[column.name], compared[column.name]
            continue
        if column.turns == "vector":
            vector_columns.append(column)
        if len(vector_columns) == 3:
            vectors = np.stack([expected[component.name] for component in vector_columns])
            rotated_vectors = rotation @ vectors
            for component, values in zip(vector_columns, rotated_vectors, strict=True):
                yield component, values, compared[component.name]
            vector_columns = []


def _first_different_row(
    column: Column, expected: Array, compared: Array, tolerance: float
) -> int | None:
    """Return the first row in which two columns differ, or None.

    Numbers are different if they differ by more than the tolerance times the largest
    expected number (or 1). Angles are compared modulo whole turns. NaN equals NaN.

    Parameters
    ----------
    column
        The declaration of the column.
    expected, compared
        Its values (rows,) in both tables.
    tolerance
        Largest relative difference of numbers.
    """
    is_different = expected != compared
    if column.kind == "number":
        scale = max(1.0, max_abs(expected[np.isfinite(expected)]))
        if column.unit == "rad":
            # Angles that differ by whole turns are equal: move the compared angle to the
            # turn of the expected one.
            with np.errstate(invalid="ignore"):
                difference = wrap(compared - expected)
            is_finite = np.isfinite(difference)
            compared = np.where(is_finite, expected + difference, compared)
        is_different = ~np.isclose(
            compared, expected, rtol=0.0, atol=tolerance * scale, equal_nan=True
        )
    return int(np.argmax(is_different)) if np.any(is_different) else None


def replace_words(data: TableArrays, replacements: Mapping[str, str]) -> TableArrays:
    """Return a table with some words in its texts replaced, such as names of links.

    A check renames the links of a mechanism and computes its tables again. This function
    puts the old names back, so that both tables can be compared.

    Parameters
    ----------
    data
        The columns of the table by name.
    replacements
        The new word for each old word.
    """

    def replace_in(text: str) -> str:
        """Return a text with whole words replaced."""
        return re.sub(r"\w+", lambda match: replacements.get(match[0], match[0]), text)

    return {
        name: np.array([replace_in(text) for text in values.tolist()], dtype=str)
        if values.dtype.kind == "U"
        else values
        for name, values in data.items()
    }


def match_rows(
    table: Table, expected: TableArrays, compared: TableArrays, links: Collection[str]
) -> tuple[TableArrays, TableArrays]:
    """Return the rows that two tables share, in the same order.

    `compared` is the table of the same mechanism, computed with other names and indices of
    links. The old names have been put back. A row is identified by its key: its texts and
    whole numbers. If a key occurs twice, rows cannot be identified, and both tables are
    returned unchanged. They are also returned unchanged if `compared` has more or fewer
    rows, which `describe_difference` reports.

    A row about one link relative to another may be missing. With other numbers of links,
    the table may have a row about the second link relative to the first in its place.

    Parameters
    ----------
    table
        The declaration of the table.
    expected, compared
        The columns of the two tables.
    links
        The names of all links.

    Returns
    -------
    The rows of `expected` and of `compared`.

    Raises
    ------
    PluginError
        If a row is missing that should be there.
    """
    key_columns = [
        column.name for column in table.columns if column.kind in ("text", "integer")
    ]
    expected_row_of_key = _rows_by_key(expected, key_columns)
    compared_row_of_key = _rows_by_key(compared, key_columns)
    if len(expected_row_of_key) != row_count(expected) or len(
        compared_row_of_key
    ) != row_count(compared):
        return expected, compared
    shared_keys = []
    for key in expected_row_of_key:
        if key in compared_row_of_key:
            shared_keys.append(key)
            continue
        # A row may be missing only if it names two links.
        texts = [item for item in key if isinstance(item, str)]
        words = re.findall(r"\w+", " ".join(texts))
        if sum(word in links for word in words) < 2:
            raise PluginError(
                f"with other names or numbers of links, table {table.name} has no row of "
                f"{', '.join(map(str, key))} any more"
            )
    if row_count(expected) != row_count(compared):
        return expected, compared
    expected_rows = [expected_row_of_key[key] for key in shared_keys]
    compared_rows = [compared_row_of_key[key] for key in shared_keys]
    return (
        {name: values[expected_rows] for name, values in expected.items()},
        {name: values[compared_rows] for name, values in compared.items()},
    )


def _rows_by_key(
    data: TableArrays, key_columns: Collection[str]
) -> dict[tuple[object, ...], int]:
    """Return the index of the row for each combination of values of the key columns.

    The key columns identify the rows of a table. If several rows have the same combination,
    the index of the last one is returned.
    """
    columns = [data[name].tolist() for name in key_columns]
    return {key: row for row, key in enumerate(zip(*columns, strict=True))}
