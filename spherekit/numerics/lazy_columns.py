"""Columns that are made when they are read: several of one source at less cost each."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike

from spherekit.arrays import Array

Reader = Callable[[slice, Sequence[Array]], None]
"""Takes some rows and what columns hold there, which is there during the call."""


def _array(
    column: "LazyColumn | Interleaved",
    dtype: DTypeLike | None = None,
    copy: bool | None = None,
) -> Array:
    """Return a column as an array."""
    if copy is False:
        raise ValueError("what is put together cannot be read without a copy")
    (made,) = read([column])
    return made if dtype is None else made.astype(dtype, copy=False)


@dataclass(frozen=True)
class LazyColumn:
    """A column (n,) of numbers that `source` makes by its `key` when it is read.

    Its `read(keys, reader)` has columns read, rows after rows until all were, in any order
    or at once.
    """

    source: Any
    key: Hashable
    count: int
    dtype: ClassVar[np.dtype[Any]] = np.dtype(np.float64)
    ndim: ClassVar[int] = 1

    def __len__(self) -> int:
        return self.count

    __array__ = _array


class Interleaved:
    """A column with a row for each of several subjects at every row of a batch.

    `parts` (n,) are those of one subject each: their first rows come first, then their
    second ones. An array is made of them where one is wanted.
    """

    ndim = 1

    def __init__(self, parts: Sequence[Array | LazyColumn]) -> None:
        self.parts: tuple[Array | LazyColumn, ...] = tuple(
            part if isinstance(part, LazyColumn) else np.asarray(part) for part in parts
        )
        self.dtype = np.result_type(*{part.dtype for part in self.parts})

    def __len__(self) -> int:
        return len(self.parts) * len(self.parts[0])

    __array__ = _array


def once(column: Array | Interleaved) -> tuple[Array, int]:
    """Return a column without the rows that repeat, and how often each is there."""
    if isinstance(column, Interleaved) and len({id(part) for part in column.parts}) == 1:
        return np.asarray(column.parts[0]), len(column.parts)
    return np.asarray(column), 1


Column = Array | LazyColumn | Interleaved
Span = tuple[slice, int]
"""Rows of a column, and from where on they belong in an array."""


def read(columns: Iterable[Column]) -> list[Array]:
    """Return columns of equal length as arrays; those that are none are read together."""
    given = list(columns)
    made = [x if isinstance(x, np.ndarray) else np.empty(len(x), x.dtype) for x in given]
    new = [pair for pair in zip(given, made, strict=True) if pair[0] is not pair[1]]
    put(new, [(slice(0, max((len(out) for _, out in new), default=0)), 0)])
    return made


_Target = tuple[Array, int]
"""An array from the first row of a subject on, and how many subjects there are."""


def put(columns: Iterable[tuple[Column, Array]], spans: Sequence[Span]) -> None:
    """Write rows of columns into arrays; what a source makes is made once for all."""
    unread: defaultdict[int, list[tuple[LazyColumn, _Target]]] = defaultdict(list)
    for column, out in columns:
        parts = column.parts if isinstance(column, Interleaved) else (column,)
        for number, part in enumerate(parts):
            target = out[number:], len(parts)
            if isinstance(part, LazyColumn):
                unread[id(part.source)].append((part, target))
            else:
                _write([target], spans, slice(0, len(part)), [part])
    for wanted in unread.values():
        reader = partial(_write, [target for _, target in wanted], spans)
        wanted[0][0].source.read([part.key for part, _ in wanted], reader)


def _write(
    targets: Sequence[_Target], spans: Sequence[Span], rows: slice, held: Sequence[Array]
) -> None:
    """Write some rows of columns, as far as they are wanted."""
    places = {count: _places(count, spans, rows) for count in {k for _, k in targets}}
    for values, (out, count) in zip(held, targets, strict=True):
        for there, here in places[count]:
            out[there] = values[here]


def _places(count: int, spans: Sequence[Span], rows: slice) -> list[tuple[slice, slice]]:
    """Return where rows of one of `count` subjects go, and which of these rows."""
    made = []
    for wanted, first in spans:
        start = wanted.start // count
        low = max(rows.start, start)
        high = min(rows.stop, wanted.stop // count)
        if low < high:
            at, end = (first + (row - start) * count for row in (low, high))
            made.append((slice(at, end, count), slice(low - rows.start, high - rows.start)))
    return made
