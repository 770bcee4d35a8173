"""Columns that are made when they are read: several of one source at less cost each."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Protocol, final

import numpy as np
from numpy.typing import DTypeLike, NDArray

IN_CACHE = 2048
"""Rows that are put in place at once."""

Reader = Callable[[slice, Sequence[NDArray[Any]]], None]
"""Takes some rows and what columns hold there, which is there during the call."""


class Source(Protocol):
    """What makes columns (n,) when they are read."""

    def read(self, keys: Sequence[Any], reader: Reader) -> None:
        """Have columns read, rows after rows until all were, in any order or at once."""


@final
@dataclass(frozen=True)
class Unread:
    """A column (n,) of numbers that `source` makes by its `key` when it is read."""

    source: Source
    key: Hashable
    count: int
    dtype: ClassVar[np.dtype[Any]] = np.dtype(np.float64)
    ndim: ClassVar[int] = 1

    def __len__(self) -> int:
        return self.count

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        return array_of([self], dtype, copy)


@final
class Interleaved:
    """A column with a row for each of several subjects at every row of a batch.

    `parts` (n,) are those of one subject each: their first rows come first, then their
    second ones. An array is made of them where one is wanted.
    """

    ndim = 1

    def __init__(self, parts: Sequence[NDArray[Any] | Unread]) -> None:
        self.parts: tuple[NDArray[Any] | Unread, ...] = tuple(
            part if isinstance(part, Unread) else np.asarray(part) for part in parts
        )
        self.dtype = np.result_type(*{part.dtype for part in self.parts})

    def __len__(self) -> int:
        return len(self.parts) * len(self.parts[0])

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        return array_of(self.parts, dtype, copy)


Column = NDArray[Any] | Unread | Interleaved
Span = tuple[slice, int]
"""Rows of a column, and from where on they belong in an array."""


def array_of(
    parts: Sequence[NDArray[Any] | Unread],
    dtype: DTypeLike | None = None,
    copy: bool | None = None,
) -> NDArray[Any]:
    """Return the rows of one or several subjects as an array (subjects n,)."""
    if copy is False:
        raise ValueError("what is put together cannot be read without a copy")
    column = Interleaved(parts)
    made = np.empty(len(column), dtype or column.dtype)
    put([(column, made)], [(slice(0, len(column)), 0)])
    return made


def read(columns: Iterable[Column]) -> list[NDArray[Any]]:
    """Return columns of equal length as arrays; those that are none are read together."""
    given = list(columns)
    made = [x if isinstance(x, np.ndarray) else np.empty(len(x), x.dtype) for x in given]
    new = [pair for pair in zip(given, made, strict=True) if pair[0] is not pair[1]]
    count = max((len(out) for _, out in new), default=0)
    put(new, [(slice(0, count), 0)])
    return made


def put(columns: Iterable[tuple[Column, NDArray[Any]]], spans: Sequence[Span]) -> None:
    """Write rows of columns into arrays; what a source makes is made once for all."""
    unread: dict[int, tuple[Source, defaultdict[Hashable, list[_Target]]]] = {}
    for column, out in columns:
        parts = column.parts if isinstance(column, Interleaved) else (column,)
        for number, part in enumerate(parts):
            target = out[number:], len(parts)
            if isinstance(part, Unread):
                kept = unread.setdefault(id(part.source), (part.source, defaultdict(list)))
                kept[1][part.key].append(target)
            else:
                _write([[target]], spans, slice(0, len(part)), [part])
    for source, wanted in unread.values():
        source.read(list(wanted), partial(_take, list(wanted.values()), spans))


_Target = tuple[NDArray[Any], int]
"""An array from the first row of a subject on, and how many subjects there are."""


def _take(
    targets: Sequence[Sequence[_Target]],
    spans: Sequence[Span],
    rows: slice,
    held: Sequence[NDArray[Any]],
) -> None:
    """Write some rows of all columns, few at a time."""
    for start in range(rows.start, rows.stop, IN_CACHE):
        stop = min(start + IN_CACHE, rows.stop)
        here = slice(start - rows.start, stop - rows.start)
        _write(targets, spans, slice(start, stop), [values[here] for values in held])


def _write(
    targets: Sequence[Sequence[_Target]],
    spans: Sequence[Span],
    rows: slice,
    held: Sequence[NDArray[Any]],
) -> None:
    """Write some rows of columns, as far as they are wanted."""
    counts = {count for every in targets for _, count in every}
    places = {count: _places(count, spans, rows) for count in counts}
    for values, every in zip(held, targets, strict=True):
        for out, count in every:
            for there, here in places[count]:
                out[there] = values[here]


def _places(
    count: int, spans: Sequence[Span], rows: slice
) -> list[tuple[slice, slice]]:
    """Return where rows of one of `count` subjects go, and which of these rows."""
    made = []
    for wanted, first in spans:
        start = wanted.start // count
        low, high = max(rows.start, start), min(rows.stop, wanted.stop // count)
        if low < high:
            at, end = first + (low - start) * count, first + (high - start) * count
            here = slice(low - rows.start, high - rows.start)
            made.append((slice(at, end, count), here))
    return made
