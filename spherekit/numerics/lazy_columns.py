"""Table columns that are computed only when they are read.

One pass over a source computes several of its columns at less cost than one pass for each.
The functions here therefore collect all columns of a source before they read it.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

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
        raise ValueError("what is put together cannot be read without a copy")
    (values,) = read([column])
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
    come first, then their second rows, and so on.

    Attributes
    ----------
    parts
        One column (n,) for each subject.
    """

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


def once(column: Array | Interleaved) -> tuple[Array, int]:
    """Return a column without repeated rows, and how often each row is repeated.

    Rows are repeated if all subjects of an interleaved column share one array, as the
    sample number does. The repetition count is 1 otherwise.
    """
    if isinstance(column, Interleaved) and len({id(part) for part in column.parts}) == 1:
        return np.asarray(column.parts[0]), len(column.parts)
    return np.asarray(column), 1


Column = Array | LazyColumn | Interleaved

Span = tuple[slice, int]
"""Rows of a column, and the row of an output array at which the first of them belongs."""


def read(columns: Iterable[Column]) -> list[Array]:
    """Return columns of equal length as arrays. Columns of one source are read together.

    Columns that are arrays already are returned as they are.
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
    # All rows, to be written from row 0 of the arrays.
    put(unread, [(slice(0, length), 0)])
    return arrays


_Target = tuple[Array, int]
"""An output array from the first row of one subject on, and the number of subjects."""


def put(columns: Iterable[tuple[Column, Array]], spans: Sequence[Span]) -> None:
    """Copy rows of columns into output arrays.

    A column is an array, a column that a source computes when it is read, or several of
    these whose rows alternate (one for each subject). All parts of a source are read in one
    pass.

    Parameters
    ----------
    columns
        Columns, with the output array of each.
    spans
        The rows to copy, and where they belong. They apply to all columns.
    """
    # Columns to compute, by the identity of their source. A source need not be hashable.
    targets_by_source: defaultdict[int, list[tuple[LazyColumn, _Target]]]
    targets_by_source = defaultdict(list)
    for column, out in columns:
        parts = column.parts if isinstance(column, Interleaved) else (column,)
        for subject, part in enumerate(parts):
            # The rows of a subject go to every len(parts)-th row of the output.
            target = out[subject:], len(parts)
            if isinstance(part, LazyColumn):
                targets_by_source[id(part.source)].append((part, target))
            else:
                _copy_rows([target], spans, slice(0, len(part)), [part])
    for parts_and_targets in targets_by_source.values():
        keys = [part.key for part, _ in parts_and_targets]
        targets = [target for _, target in parts_and_targets]
        source = parts_and_targets[0][0].source
        source.read(keys, partial(_copy_rows, targets, spans))


def _copy_rows(
    targets: Sequence[_Target],
    spans: Sequence[Span],
    rows: slice,
    values_of_parts: Sequence[Array],
) -> None:
    """Copy some rows of several parts to their targets, as far as the spans contain them.

    A part is a column, or the rows of one subject of a column in which the rows of several
    subjects (such as poles) alternate.

    Parameters
    ----------
    targets
        For each part, the output array from the first row of its subject on, which is
        changed in place, and the number of subjects whose rows alternate in it.
    spans
        The rows of the columns to copy, each with the first output row of these rows.
    rows
        The rows of the parts that are available.
    values_of_parts
        The values of each part in these rows.
    """
    # The slices are the same for all parts of columns with equally many subjects.
    slices_by_count = {
        count: _match_rows(count, spans, rows) for count in {count for _, count in targets}
    }
    for values, (out, count) in zip(values_of_parts, targets, strict=True):
        for out_slice, value_slice in slices_by_count[count]:
            out[out_slice] = values[value_slice]


def _match_rows(
    subject_count: int, spans: Sequence[Span], rows: slice
) -> list[tuple[slice, slice]]:
    """Return which output rows receive which of the available rows of one subject.

    In the column, the rows of all subjects (such as poles) alternate: row r of subject s is
    row r * subject_count + s. A source delivers the rows of one subject.

    Parameters
    ----------
    subject_count
        Number of subjects, whose rows alternate in the column and in the output.
    spans
        Rows of the column to copy, each with the first output row of these rows.
    rows
        The available rows of the subject.

    Returns
    -------
    For each span that contains some of the rows, the slice of the output, counted from the
    first row of the subject, and the slice of the available rows.
    """
    matches = []
    for span, first_out_row in spans:
        # Rows of a column are converted to rows of one subject.
        span_start = span.start // subject_count
        low = max(rows.start, span_start)
        high = min(rows.stop, span.stop // subject_count)
        if low < high:
            out_start = first_out_row + (low - span_start) * subject_count
            out_stop = first_out_row + (high - span_start) * subject_count
            matches.append(
                (
                    slice(out_start, out_stop, subject_count),
                    slice(low - rows.start, high - rows.start),
                )
            )
    return matches
