"""Columns that are made when they are read: several of one source at less cost each.

Memory for arrays of blocks, used again once nobody reads them.

Memory that is new has to be handed over by the system, page by page, which takes longer
than filling it. So large arrays get the largest pages there are.
"""

import mmap
import sys
import weakref
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Protocol, final

import numpy as np
from numpy.typing import DTypeLike

from spherekit.arrays import Array, Floats

IN_CACHE = 2048
"""Rows that are put in place at once."""

Reader = Callable[[slice, Sequence[Array]], None]
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

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        return array_of([self], dtype, copy)


@final
class Interleaved:
    """A column with a row for each of several subjects at every row of a batch.

    `parts` (n,) are those of one subject each: their first rows come first, then their
    second ones. An array is made of them where one is wanted.
    """

    ndim = 1

    def __init__(self, parts: Sequence[Array | Unread]) -> None:
        self.parts: tuple[Array | Unread, ...] = tuple(
            part if isinstance(part, Unread) else np.asarray(part) for part in parts
        )
        self.dtype = np.result_type(*{part.dtype for part in self.parts})

    def __len__(self) -> int:
        return len(self.parts) * len(self.parts[0])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        return array_of(self.parts, dtype, copy)


Column = Array | Unread | Interleaved
Span = tuple[slice, int]
"""Rows of a column, and from where on they belong in an array."""


def array_of(
    parts: Sequence[Array | Unread],
    dtype: DTypeLike | None = None,
    copy: bool | None = None,
) -> Array:
    """Return the rows of one or several subjects as an array (subjects n,)."""
    if copy is False:
        raise ValueError("what is put together cannot be read without a copy")
    column = Interleaved(parts)
    made = np.empty(len(column), dtype or column.dtype)
    put([(column, made)], [(slice(0, len(column)), 0)])
    return made


def read(columns: Iterable[Column]) -> list[Array]:
    """Return columns of equal length as arrays; those that are none are read together."""
    given = list(columns)
    made = [x if isinstance(x, np.ndarray) else np.empty(len(x), x.dtype) for x in given]
    new = [pair for pair in zip(given, made, strict=True) if pair[0] is not pair[1]]
    count = max((len(out) for _, out in new), default=0)
    put(new, [(slice(0, count), 0)])
    return made


def put(columns: Iterable[tuple[Column, Array]], spans: Sequence[Span]) -> None:
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


_Target = tuple[Array, int]
"""An array from the first row of a subject on, and how many subjects there are."""


def _take(
    targets: Sequence[Sequence[_Target]],
    spans: Sequence[Span],
    rows: slice,
    held: Sequence[Array],
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
    held: Sequence[Array],
) -> None:
    """Write some rows of columns, as far as they are wanted."""
    counts = {count for every in targets for _, count in every}
    places = {count: _places(count, spans, rows) for count in counts}
    for values, every in zip(held, targets, strict=True):
        for out, count in every:
            for there, here in places[count]:
                out[there] = values[here]


def _places(count: int, spans: Sequence[Span], rows: slice) -> list[tuple[slice, slice]]:
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


LARGE_PAGE = 1 << 21
"""Bytes of the pages that Linux hands over at once where it is asked for."""
WORTH_A_PAGE = 1 << 18
"""From so many bytes on an array gets one."""
MOST_IDLE = 1 << 27
"""Bytes at most that wait to be used again."""


@final
class _Loan:
    """What an array and all its views keep alive: its end gives the memory back."""

    def __init__(self, memory: Floats) -> None:
        self.__array_interface__ = memory.__array_interface__
        self.memory = memory


@final
class LentMemory:
    """Arrays whose memory comes back when they and their views are gone.

    At most so many bytes stay for others while nobody has them.
    """

    def __init__(self, most: int = MOST_IDLE) -> None:
        self._most, self._idle = most, 0
        self._free: defaultdict[int, list[Floats]] = defaultdict(list)

    def array(self, rows: int, columns: int) -> Floats:
        """Return an array (rows, columns) that holds anything."""
        size = rows * columns
        memory = self._taken(size)
        loan = _Loan(memory)
        weakref.finalize(loan, self._take_back, memory).atexit = False
        return np.asarray(loan)[:size].reshape(rows, columns)

    @contextmanager
    def room(self, rows: int, columns: int) -> Iterator[Floats]:
        """Lend an array (rows, columns) that holds anything, for as long as a context."""
        size = rows * columns
        memory = self._taken(size)
        try:
            yield memory[:size].reshape(rows, columns)
        finally:
            self._take_back(memory)

    def _taken(self, size: int) -> Floats:
        pages = _pages(size)
        try:
            memory = self._free[pages].pop()
        except IndexError:
            return _new(pages) if pages else np.empty(size)
        self._idle -= memory.nbytes
        return memory

    def _take_back(self, memory: Floats) -> None:
        # Of what several threads do here, no step depends on another.
        pages = memory.nbytes // LARGE_PAGE
        if pages and self._idle + memory.nbytes <= self._most:
            self._idle += memory.nbytes
            self._free[pages].append(memory)


def _pages(size: int) -> int:
    """Return how many large pages hold so many numbers, none if these are few.

    In steps of a quarter at most, so that what comes back is of use again.
    """
    if 8 * size < WORTH_A_PAGE:
        return 0
    pages = -(-8 * size // LARGE_PAGE)
    step = 1 << max(0, pages.bit_length() - 3)
    return -(-pages // step) * step


def _new(pages: int) -> Floats:
    """Return memory of so many large pages, where the system has these."""
    size = pages * LARGE_PAGE
    if sys.platform != "linux":
        return np.empty(size // 8)
    mapped = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    with suppress(OSError):  # a system without large pages
        mapped.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(mapped)
