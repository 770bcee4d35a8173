"""Table columns that are computed only when they are read.

A source is an object that computes columns. One pass over it computes several columns at
less cost than one pass for each. The functions of this module therefore collect all columns
of a source before they read it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import DTypeLike

from spherekit.arrays import Array

Reader = Callable[[slice, Sequence[Array]], None]
"""Function of a slice of rows, and of the values of several columns in these rows.

The caller may overwrite the values as soon as the call returns.
"""


def _convert_to_array(
    column: "LazyColumn | Interleaved",
    dtype: DTypeLike | None = None,
    copy: bool | None = None,
) -> Array:
    """Return a column as an array. This is the `__array__` protocol of NumPy."""
    if copy is False:
        raise ValueError(
            "this array is computed when it is read, so it cannot be read without a "
            "copy; leave copy=False out"
        )
    (values,) = read_columns([column])
    return values if dtype is None else values.astype(dtype, copy=False)


@dataclass(frozen=True)
class LazyColumn:
    """A column of a table, of floats that are computed only when the column is read.

    Attributes
    ----------
    source
        An object with a method `read(keys, reader)`, which computes the columns with these
        keys. It passes the values on by calls of the function `reader`. Each call has a
        slice of rows and the values of all these columns in these rows. The slices may come
        in any order, and from several threads at once.
    key
        Identifies the column in the source.
    count
        Number of rows.
    """

    source: Any
    key: Hashable
    count: int
    dtype: ClassVar[np.dtype[Any]] = np.dtype(np.float64)
    ndim: ClassVar[int] = 1

    def __len__(self) -> int:
        return self.count

    __array__ = _convert_to_array


class Interleaved:
    """A column in which the rows of several subjects alternate.

    A table may have, for example, one row per pole (axis of relative rotation of two links)
    for each sample of a motion. Each pole is a subject. The first rows of all subjects come
    first, then their second rows, and so on. Some parts may be lazy (computed only when
    they are read). The rows are therefore put together only when the column becomes an
    array (`numpy.asarray`).

    Attributes
    ----------
    parts
        One column (n,) for each subject: an array, or a column that is still to be
        computed.
    """

    # A column is an array with one axis.
    ndim = 1

    def __init__(self, parts: Sequence[Array | LazyColumn]) -> None:
        """Make the column of one part (n,) for each subject."""
        self.parts: tuple[Array | LazyColumn, ...] = tuple(
            part if isinstance(part, LazyColumn) else np.asarray(part) for part in parts
        )
        dtypes = {part.dtype for part in self.parts}
        self.dtype = np.result_type(*dtypes) if dtypes else np.dtype(np.float64)

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    __array__ = _convert_to_array


def remove_repetitions(column: Array | Interleaved) -> tuple[Array, int]:
    """Return a column without repeated rows, and how often each row is repeated.

    A column is interleaved if the rows of several subjects alternate, such as the poles at
    each sample. Rows are repeated if all subjects share one array, as with the sample
    number. The repetition count is 1 for all other columns.
    """
    if isinstance(column, Interleaved) and len({id(part) for part in column.parts}) == 1:
        return np.asarray(column.parts[0]), len(column.parts)
    return np.asarray(column), 1


Column = Array | LazyColumn | Interleaved


class Span(NamedTuple):
    """Successive rows of a column that are to be copied into an output array.

    For example, rows 10 to 19 of a column become rows 0 to 9 of the output.

    Attributes
    ----------
    rows
        The rows of the column.
    first_output_row
        The row of the output to which the first of these rows is copied.

    Notes
    -----
    A column can have the rows of k subjects (such as poles) in turn: row 0 of each subject,
    then row 1 of each, and so on. A span must have the same rows of every subject, because
    they are copied subject by subject. So `rows.start`, `rows.stop` and `first_output_row`
    must be multiples of k.
    """

    rows: slice
    first_output_row: int

    @property
    def output_rows(self) -> slice:
        """The rows of the output to which the rows are copied."""
        row_count = self.rows.stop - self.rows.start
        return slice(self.first_output_row, self.first_output_row + row_count)


def read_columns(columns: Iterable[Column]) -> list[Array]:
    """Return columns of equal length as arrays.

    A lazy column is computed by its source when it is read. All columns of one source are
    computed together, which takes less time. Columns that are arrays already are returned
    as they are.
    """
    arrays: list[Array] = []
    # Columns that must be computed, each with the empty array that receives its values.
    unread: list[tuple[Column, Array]] = []
    length = 0
    for column in columns:
        if isinstance(column, np.ndarray):
            arrays.append(column)
            continue
        array = np.empty(len(column), column.dtype)
        arrays.append(array)
        unread.append((column, array))
        length = max(length, len(array))
    all_rows = Span(slice(0, length), first_output_row=0)
    copy_columns(unread, [all_rows])
    return arrays


class _PartCopy(NamedTuple):
    """A part of a table column, and the output rows to which `copy_columns` writes it.

    A table can have rows for several subjects. Each pole (axis of relative rotation of two
    links), for example, is a subject with one row for each sample of a motion. The rows of
    the subjects alternate in a column. A part of a column has the rows of one subject. A
    column of any other table is a single part.

    Attributes
    ----------
    part
        The part: an array, or a lazy column that a source computes.
    output
        View of the rows of the output array that belong to this part.
    spans
        Which rows of the part are copied, and to which rows of `output`.
    """

    part: Array | LazyColumn
    output: Array
    spans: Sequence[Span]


def copy_columns(columns: Iterable[tuple[Column, Array]], spans: Sequence[Span]) -> None:
    """Copy rows of columns into output arrays, and compute lazy columns at the same time.

    A lazy column is computed by its source only when it is read. The source computes all
    its columns in one pass, because that takes less time than one pass for each.

    Parameters
    ----------
    columns
        Columns, with the output array of each.
    spans
        Which rows of each column are copied, and to which rows of its output. Rows are
        numbered along the whole column.
    """
    # The key is the identity (`id`) of the source, because not every source is hashable.
    lazy_copies_by_source: defaultdict[int, list[_PartCopy]] = defaultdict(list)
    for column, output in columns:
        # A column with the rows of several subjects (such as poles) has a part for each
        # subject. Any other column is a single part.
        for part_copy in _divide_into_parts(column, output, spans):
            part = part_copy.part
            if isinstance(part, LazyColumn):
                lazy_copies_by_source[id(part.source)].append(part_copy)
            else:
                _copy_spans(part, part_copy.output, part_copy.spans)
    for lazy_copies in lazy_copies_by_source.values():
        _compute_and_copy(lazy_copies)


def _divide_into_parts(
    column: Column, output: Array, spans: Sequence[Span]
) -> list[_PartCopy]:
    """Return the parts of a column, each with its output rows and its rows to copy.

    A part has the rows of one subject, such as one of several poles. With three parts, rows
    0, 3, 6, ... of the column and of the output belong to the first part, rows 1, 4, 7, ...
    to the second, and rows 2, 5, 8, ... to the third.

    Parameters
    ----------
    column, output
        The column, and the array to which its rows are copied.
    spans
        Which rows are copied, and to where, as row numbers of the whole column and output.
    """
    if not isinstance(column, Interleaved):
        return [_PartCopy(column, output, spans)]
    count = len(column.parts)
    # A span begins with the first subject and ends with the last one. So the same rows are
    # copied in all parts. A column without subjects has no rows.
    part_spans = _count_in_part(spans, count) if count else []
    return [
        _PartCopy(part, output[subject::count], part_spans)
        for subject, part in enumerate(column.parts)
    ]


def _compute_and_copy(part_copies: Sequence[_PartCopy]) -> None:
    """Compute lazy columns of one source, and copy each slice of rows once it is computed.

    A source is an object that computes rows slice by slice, and calls a function with the
    values of each slice.

    Parameters
    ----------
    part_copies
        Each has a lazy column (`part`), the ranges of rows to copy (`spans`), and the array
        to which they are copied (`output`).
    """

    def copy_computed_rows(computed_rows: slice, values: Sequence[Array]) -> None:
        """Copy the values of all lazy columns in the rows that the source has computed.

        The source calls this function after each slice of rows. Only rows in the spans are
        copied to the output. `values` has an array for each column.
        """
        for part_copy, part_values in zip(part_copies, values, strict=True):
            # The spans as rows of `part_values`, whose row 0 is the first computed row.
            value_spans = _spans_of_values(part_copy.spans, computed_rows)
            _copy_spans(part_values, part_copy.output, value_spans)

    lazy_columns = [cast(LazyColumn, part_copy.part) for part_copy in part_copies]
    source = lazy_columns[0].source
    source.read([column.key for column in lazy_columns], copy_computed_rows)


def _copy_spans(values: Array, output: Array, spans: Sequence[Span]) -> None:
    """Copy spans of rows of an array into an output array."""
    for span in spans:
        output[span.output_rows] = values[span.rows]


def _count_in_part(spans: Sequence[Span], subject_count: int) -> list[Span]:
    """Return spans (ranges of rows) of a column as row numbers of one of its parts.

    The rows of all parts alternate, so each part has 1 / `subject_count` of the rows. With
    two parts, row 20 of the column is row 10 of the first part.
    """
    return [
        Span(
            slice(span.rows.start // subject_count, span.rows.stop // subject_count),
            span.first_output_row // subject_count,
        )
        for span in spans
    ]


def _spans_of_values(spans: Sequence[Span], computed_rows: slice) -> list[Span]:
    """Return the parts of spans that have been computed, as rows of the computed values.

    A span is a range of rows to be copied, with its place in the output. A source computes
    the rows of a column slice by slice. The caller has the values of one slice, and copies
    them with the result. For example, the values of rows 20 to 29 are an array of 10 rows,
    so row 20 of the column is row 0 of the array. Spans without computed rows are left out.

    Parameters
    ----------
    spans
        The spans, with row numbers of the column.
    computed_rows
        The slice of rows that has been computed.
    """
    value_spans = []
    for span in spans:
        start = max(computed_rows.start, span.rows.start)
        stop = min(computed_rows.stop, span.rows.stop)
        if start < stop:
            value_rows = slice(start - computed_rows.start, stop - computed_rows.start)
            output_row = span.first_output_row + start - span.rows.start
            value_spans.append(Span(value_rows, output_row))
    return value_spans
