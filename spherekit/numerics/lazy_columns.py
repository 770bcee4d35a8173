"""Table columns that are computed only when they are read.

A source is an object that computes columns. One pass over it computes several columns at
less cost than one pass for each. The functions of this module therefore collect all columns
of a source before they read it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

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
    """A column of floats that a source computes when the column is read.

    Attributes
    ----------
    source
        An object with a method `read(keys, reader)`. The method computes the columns with
        these keys. It calls the reader with a slice of rows and the values of the columns
        in these rows, until all rows were passed. The slices may come in any order and from
        several threads at once.
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
    for each sample of a motion. Each pole is then a subject. The first rows of all subjects
    come first, then their second rows, and so on. The rows are put together only when the
    column is converted to an array (`numpy.asarray`), since some parts may be lazy: a
    source computes them only then.

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
        self.dtype = np.result_type(*{part.dtype for part in self.parts})

    def __len__(self) -> int:
        return len(self.parts) * len(self.parts[0])

    __array__ = _convert_to_array


def remove_repetitions(column: Array | Interleaved) -> tuple[Array, int]:
    """Return a column without repeated rows, and how often each row is repeated.

    Rows are repeated if all subjects of an interleaved column share one array, as the
    sample number does. The repetition count is 1 otherwise.
    """
    if isinstance(column, Interleaved) and len({id(part) for part in column.parts}) == 1:
        return np.asarray(column.parts[0]), len(column.parts)
    return np.asarray(column), 1


Column = Array | LazyColumn | Interleaved


class Span(NamedTuple):
    """Successive rows of a column that are to be copied into an output array.

    For example, rows 10 to 19 of a column become the rows 0 to 9 of the output.

    Attributes
    ----------
    rows
        The rows of the column. In a column in which the rows of k subjects alternate, start
        and stop are multiples of k, so that each subject has equally many rows.
    first_output_row
        The row of the output to which the first of them is copied.
    """

    rows: slice
    first_output_row: int


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


class _Target(NamedTuple):
    """Where the rows of one subject (such as a pole) of a column are written.

    Attributes
    ----------
    output
        The output array from the first row of the subject on.
    subject_count
        Number of subjects. The rows of this subject belong in every `subject_count`-th row.
    """

    output: Array
    subject_count: int


def copy_columns(columns: Iterable[tuple[Column, Array]], spans: Sequence[Span]) -> None:
    """Copy rows of columns into output arrays.

    There are three kinds of columns:

    - an array;
    - a lazy column, which its source computes when it is read. The columns of one source
      are computed in one pass, because that takes less time;
    - an interleaved column. It consists of several parts of the first two kinds, whose rows
      alternate. In a table of poles, for example, each part has the rows of one pole. What
      a part belongs to is called its subject.

    Parameters
    ----------
    columns
        Columns, with the output array of each.
    spans
        Which rows of each column are copied, and to which rows of its output. Rows of an
        interleaved column are counted over all its parts.
    """
    # Lazy columns and where their rows are written, by the identity (`id`) of their source.
    # A source need not be hashable.
    targets_by_source: defaultdict[int, list[tuple[LazyColumn, _Target]]]
    targets_by_source = defaultdict(list)
    for column, output in columns:
        parts = column.parts if isinstance(column, Interleaved) else (column,)
        for subject, part in enumerate(parts):
            # Subjects alternate in the output: row 0 is the first row of subject 0, row 1
            # the first row of subject 1, and so on.
            target = _Target(output[subject:], subject_count=len(parts))
            if isinstance(part, LazyColumn):
                targets_by_source[id(part.source)].append((part, target))
            else:
                all_rows = slice(0, len(part))
                _copy_rows([target], spans, available_rows=all_rows, values_of_parts=[part])
    for parts_and_targets in targets_by_source.values():
        keys = [part.key for part, _ in parts_and_targets]
        targets = [target for _, target in parts_and_targets]
        source = parts_and_targets[0][0].source

        def copy_computed_rows(
            rows: slice, values: Sequence[Array], targets: list[_Target] = targets
        ) -> None:
            """Copy the values (one array for each key) that the source has in some rows."""
            _copy_rows(targets, spans, available_rows=rows, values_of_parts=values)

        # The source computes the columns with these keys, slice by slice of their rows, and
        # calls the function with each slice.
        source.read(keys, copy_computed_rows)


def _copy_rows(
    targets: Sequence[_Target],
    spans: Sequence[Span],
    available_rows: slice,
    values_of_parts: Sequence[Array],
) -> None:
    """Copy the available rows of several parts of columns into output arrays.

    In some columns the rows of several subjects, such as poles, alternate. Such a column
    has a part for each subject: with three poles, row r of the part of pole k is row
    3 r + k of the column. Other columns are one part. Rows that are not in `spans` are left
    out.

    Parameters
    ----------
    targets
        For each part, where its rows are written. The output arrays are changed in place.
    spans
        Which rows of a column are wanted, and to which rows of the output they are copied.
    available_rows
        The rows of which the values are given, counted among the rows of a part.
    values_of_parts
        The values of each part in the available rows.
    """
    # Pairs of slices: rows of the output, and rows among the available values. They are
    # the same for all parts of columns with equally many subjects.
    slices_by_count: dict[int, list[tuple[slice, slice]]] = {}
    for target in targets:
        subject_count = target.subject_count
        if subject_count not in slices_by_count:
            slices_by_count[subject_count] = _match_rows(
                subject_count, spans, available_rows
            )
    for values, target in zip(values_of_parts, targets, strict=True):
        for output_slice, value_slice in slices_by_count[target.subject_count]:
            target.output[output_slice] = values[value_slice]


def _match_rows(
    subject_count: int, spans: Sequence[Span], available_rows: slice
) -> list[tuple[slice, slice]]:
    """Return which output rows receive which of the available rows of one subject.

    In the column, the rows of all subjects (such as poles) alternate: row r of subject s is
    row r * subject_count + s of the column. A source delivers the rows of one subject.

    Parameters
    ----------
    subject_count
        Number of subjects, whose rows alternate in the column and in the output.
    spans
        Which rows of the column are copied, and to which rows of the output. The ends of a
        span are multiples of `subject_count`.
    available_rows
        The available rows, counted among the rows of the subject.

    Returns
    -------
    For each span that contains some of the available rows: the slice of the output that
    receives them, and their slice among the available rows. The caller applies the first
    slice to ``output[s:]`` for subject s, so it is the same for all subjects. With three
    subjects, rows 0 and 1 of a subject go to the rows ``0:6:3`` of ``output[s:]``.
    """
    matches = []
    for span in spans:
        # Rows of the column are converted to rows of the subject.
        span_start = span.rows.start // subject_count
        span_stop = span.rows.stop // subject_count
        # The rows that are in the span and available.
        low = max(available_rows.start, span_start)
        high = min(available_rows.stop, span_stop)
        if low < high:
            output_start = span.first_output_row + (low - span_start) * subject_count
            output_stop = span.first_output_row + (high - span_start) * subject_count
            matches.append(
                (
                    slice(output_start, output_stop, subject_count),
                    slice(low - available_rows.start, high - available_rows.start),
                )
            )
    return matches
