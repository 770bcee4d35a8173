"""Memory for arrays of blocks, used again once nobody reads them.

Memory that is new has to be handed over by the system, page by page, which takes longer
than filling it. So large arrays get the largest pages there are, and results that can be
made again are set aside until somebody reads them.
"""

import mmap
import sys
import weakref
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import DTypeLike, NDArray

Floats = NDArray[np.float64]

LARGE_PAGE = 1 << 21
"""Bytes of the pages that Linux hands over at once where it is asked for."""
WORTH_A_PAGE = 1 << 18
"""From so many bytes on an array gets one."""
MOST_IDLE = 1 << 27
"""Bytes at most that wait to be used again."""


Reader = Callable[[slice, Floats], None]
"""Takes some columns of an array, and what they hold, which is there during the call."""


@final
class _Loan:
    """What an array and all its views keep alive: its end gives the memory back.

    What it holds is found in `refilled` from the row `first` on, if that can be made again.
    """

    def __init__(self, memory: Floats, lender: "LentMemory") -> None:
        self.__array_interface__ = memory.__array_interface__
        self.lender = lender
        self.refilled: Refilled | None = None
        self.first = 0


@final
class Refilled:
    """An array (rows, columns) in lent memory, made when it is read, however often.

    `was_read` says that all of it was, at once.
    """

    def __init__(
        self, lender: "LentMemory", shape: tuple[int, int], pieces: Callable[[Reader], None]
    ) -> None:
        """Take what calls a reader with some columns after others, until it had all.

        At once on several cores, so the reader must not mind in which order.
        """
        self.shape, self._pieces, self._lender = shape, pieces, lender
        self._loan: Callable[[], _Loan | None] = _nothing
        self.was_read = False

    def fills(self, lent: Floats, first: int = 0) -> None:
        """Take lent memory (k, columns) that holds the rows from `first` on, for a while.

        Views of it are then set aside.
        """
        loan = _loan_of(lent)
        assert loan is not None
        loan.refilled, loan.first = self, first

    @property
    def memory(self) -> Floats:
        """All of it, in lent memory."""
        rows, columns = self.shape
        loan = self._loan()
        if loan is not None:
            return np.asarray(loan)[: rows * columns].reshape(rows, columns)
        self.was_read = True
        made = self._lender.array(rows, columns)

        def fill(some: slice, held: Floats) -> None:
            made[:, some] = held

        self._pieces(fill)
        loan = _loan_of(made)
        assert loan is not None
        loan.refilled, self._loan = self, weakref.ref(loan)
        return made

    def read(self, reader: Reader) -> None:
        """Have it read in pieces that stay in the cache, or at once where it is there."""
        if self._loan() is not None:
            reader(slice(0, self.shape[1]), self.memory)
        else:
            self._pieces(reader)


def _nothing() -> None:
    """Return what a reference to something that is gone does."""


@final
@dataclass(frozen=True)
class Cut:
    """Where a view lies in memory, from its `offset` in bytes on.

    `row` is the row of the array that it is, None if it is none.
    """

    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    dtype: np.dtype[Any]
    row: int | None

    @classmethod
    def of(cls, view: NDArray[Any], offset: int, columns: int) -> "Cut":
        """Return that of a view of an array with so many columns."""
        row, start = divmod(offset, 8 * max(1, columns))
        whole = not start and view.shape == (columns,) and view.strides == (8,)
        is_row = whole and view.dtype.itemsize == 8
        return cls(offset, view.shape, view.strides, view.dtype, row if is_row else None)


@final
class SetAside:
    """A view of lent memory that went back, made again when it is read."""

    __slots__ = ("cut", "source")

    def __init__(self, cut: Cut, source: Refilled) -> None:
        self.cut, self.source = cut, source

    @property
    def row(self) -> int | None:
        """The row of `source` that it is, None if it is none."""
        return self.cut.row

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of its numbers."""
        return self.cut.dtype

    def __len__(self) -> int:
        return self.cut.shape[0]

    def __getitem__(self, rows: Any) -> NDArray[Any]:
        return np.asarray(np.asarray(self)[rows])

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return the view."""
        memory, cut = self.source.memory, self.cut
        view = np.ndarray(cut.shape, cut.dtype, memory, cut.offset, cut.strides)
        view.flags.writeable = False
        return np.array(view, dtype, copy=copy) if copy or dtype else view

    @property
    def ndim(self) -> int:
        """The number of its dimensions."""
        return len(self.cut.shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return np.array, (np.array(self),)


def set_aside(values: "NDArray[Any] | SetAside") -> "NDArray[Any] | SetAside":
    """Return what stands for a view of lent memory that can be filled again, or itself."""
    loan = _loan_of(values)
    if loan is None or loan.refilled is None or isinstance(values, SetAside):
        return values
    start = loan.__array_interface__["data"][0]
    offset = values.__array_interface__["data"][0] - start
    columns = loan.refilled.shape[1]
    offset += 8 * loan.first * columns
    return SetAside(Cut.of(values, offset, columns), loan.refilled)


@final
class Template:
    """Views of an array (rows, columns) that was not made, for what is of its shape."""

    def __init__(self, rows: int, columns: int) -> None:
        self.shape = rows, columns
        # Places alone are asked of it, nothing is read or written.
        self.unmade = as_strided(np.empty(1), self.shape, (8 * columns, 8), writeable=False)
        self._start = self.unmade.__array_interface__["data"][0]

    def cut(self, view: NDArray[Any]) -> Cut:
        """Return where a view of `unmade` lies in any array of that shape."""
        offset = view.__array_interface__["data"][0] - self._start
        return Cut.of(view, offset, self.shape[1])


def _loan_of(view: Any) -> "_Loan | None":
    while isinstance(view, np.ndarray):
        view = view.base
    return view if isinstance(view, _Loan) else None


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
        loan = _Loan(memory, self)
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
