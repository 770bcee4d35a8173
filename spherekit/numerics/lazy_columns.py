"""Table columns that are computed only when they are read.

One pass over a source computes several of its columns at less cost than one pass for each.
The functions here therefore collect all columns of a source before they read it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from spherekit.arrays import Array

Reader = Callable[[slice, Sequence[Array]], None]
"""Takes a slice of rows and the values of several columns in these rows.

The values may be overwritten as soon as the call returns.
"""


def _convert_to_array(
    column: "LazyColumn | Interleaved",
    dtype: DTypeLike | None = None,
    copy: bool | None = None,
) -> Array:
    """Return a column as an array. This is the `__array__` protocol of NumPy."""
    if copy is False:
        raise ValueError(
            "this array is put together when it is read, so it cannot be read without a "
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

Span = tuple[slice, int]
"""Rows of a column, and the row of an output array at which the first of them belongs.

In a column with several subjects, a span has complete groups of one row for each subject.
"""


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
    # All rows are copied. The first one belongs in row 0 of the arrays.
    first_output_row = 0
    copy_columns(unread, [(slice(0, length), first_output_row)])
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

    A column is an array, or a lazy column, which a source computes when it is read. It can
    also consist of several of these (parts) whose rows alternate. For example, the rows of
    several poles alternate in a table of poles; each pole is called a subject. All parts of
    one source are computed in one pass.

    Parameters
    ----------
    columns
        Columns, with the output array of each.
    spans
        The rows of a column to copy, as slices. Each has the row of the output to which its
        first row is copied. They apply to all columns.
    """
    # Columns to compute, by the identity of their source. A source need not be hashable.
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
                # All rows of an array are available.
                all_rows = slice(0, len(part))
                _copy_rows([target], spans, all_rows, [part])
    for parts_and_targets in targets_by_source.values():
        keys = [part.key for part, _ in parts_and_targets]
        targets = [target for _, target in parts_and_targets]
        source = parts_and_targets[0][0].source
        # The source computes the columns with these keys. It calls the reader for slices of
        # rows, with the values in them.
        reader: Reader = partial(_copy_rows, targets, spans)
        source.read(keys, reader)


def _copy_rows(
    targets: Sequence[_Target],
    spans: Sequence[Span],
    rows: slice,
    values_of_parts: Sequence[Array],
) -> None:
    """Copy rows of several parts of columns into output arrays.

    Rows are copied that are both wanted (`spans`) and available (`rows`). In some columns
    the rows of several subjects, such as poles, alternate. Such a column has a part for
    each subject. Other columns are one part.

    Parameters
    ----------
    targets
        For each part, where its rows are written. The output arrays are changed in place.
    spans
        The wanted rows of a column, as slices. Each has the row of the output to which its
        first row is copied.
    rows
        The available rows, counted among the rows of a part.
    values_of_parts
        The values of each part in the available rows.
    """
    # Pairs of slices: rows of the output, and rows among the available values. They are
    # the same for all parts of columns with equally many subjects.
    slices_by_count: dict[int, list[tuple[slice, slice]]] = {}
    for target in targets:
        subject_count = target.subject_count
        if subject_count not in slices_by_count:
            slices_by_count[subject_count] = _match_rows(subject_count, spans, rows)
    for values, target in zip(values_of_parts, targets, strict=True):
        for output_slice, value_slice in slices_by_count[target.subject_count]:
            target.output[output_slice] = values[value_slice]


def _match_rows(
    subject_count: int, spans: Sequence[Span], rows: slice
) -> list[tuple[slice, slice]]:
    """Return which output rows receive which of the available rows of one subject.

    In the column, the rows of all subjects (such as poles) alternate: row r of subject s is
    row r * subject_count + s of the column. A source delivers the rows of one subject.

    Parameters
    ----------
    subject_count
        Number of subjects, whose rows alternate in the column and in the output.
    spans
        The rows of the column to copy, as slices. Each has the row of the output to which
        its first row is copied. A span has complete groups of one row for each subject, so
        its ends are multiples of `subject_count`.
    rows
        The available rows, counted among the rows of the subject.

    Returns
    -------
    For each span that contains some of the available rows: the slice of the output that
    receives them, and their slice among the available rows. The caller applies the first
    slice to ``output[s:]`` for subject s, so it is the same for all subjects. With three
    subjects, rows 0 and 1 of a subject go to the rows ``0:6:3`` of ``output[s:]``.
    """
    matches = []
    for span, first_output_row in spans:
        # Rows of the column are converted to rows of the subject.
        span_start = span.start // subject_count
        span_stop = span.stop // subject_count
        # The rows that are in the span and available.
        low = max(rows.start, span_start)
        high = min(rows.stop, span_stop)
        if low < high:
            output_start = first_output_row + (low - span_start) * subject_count
            output_stop = first_output_row + (high - span_start) * subject_count
            matches.append(
                (
                    slice(output_start, output_stop, subject_count),
                    slice(low - rows.start, high - rows.start),
                )
            )
    return matches
