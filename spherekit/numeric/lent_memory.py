"""Memory for arrays of blocks, used again once nobody reads them.

Memory that is new has to be handed over by the system, page by page, which takes longer
than filling it. So large arrays get the largest pages there are, and results that can be
made again are set aside until somebody reads them.
"""

import mmap
import sys
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any, final

import numpy as np
from numpy.typing import DTypeLike, NDArray

Floats = NDArray[np.float64]

LARGE_PAGE = 1 << 21
"""Bytes of the pages that Linux hands over at once where it is asked for."""


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
    """An array (rows, columns) in lent memory, made when it is read, however often."""

    def __init__(
        self, lender: "LentMemory", shape: tuple[int, int], pieces: Callable[[Reader], None]
    ) -> None:
        """Take what calls a reader with some columns after others, until it had all.

        At once on several cores, so the reader must not mind in which order.
        """
        self.shape, self._pieces, self._lender = shape, pieces, lender
        self._loan: Callable[[], _Loan | None] = _nothing

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
class SetAside:
    """A view of lent memory that went back, made again when it is read.

    `row` is the row of `source` that it is, None if it is none.
    """

    def __init__(self, view: NDArray[Any], offset: int, source: Refilled) -> None:
        self.source, self._offset = source, offset
        self._shape, self._strides = view.shape, view.strides
        self.dtype = view.dtype
        row, start = divmod(offset, 8 * max(1, source.shape[1]))
        whole = not start and view.shape == source.shape[1:] and view.strides == (8,)
        self.row = row if whole and view.dtype.itemsize == 8 else None

    def __len__(self) -> int:
        return int(self._shape[0])

    def __getitem__(self, rows: Any) -> NDArray[Any]:
        return np.asarray(np.asarray(self)[rows])

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return the view."""
        memory = self.source.memory
        view = np.ndarray(self._shape, self.dtype, memory, self._offset, self._strides)
        view.flags.writeable = False
        return np.array(view, dtype, copy=copy) if copy or dtype else view

    @property
    def ndim(self) -> int:
        """The number of its dimensions."""
        return len(self._shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return np.array, (np.array(self),)


def set_aside(values: "NDArray[Any] | SetAside") -> "NDArray[Any] | SetAside":
    """Return what stands for a view of lent memory that can be filled again, or itself."""
    loan = _loan_of(values)
    if loan is None or loan.refilled is None or isinstance(values, SetAside):
        return values
    start = loan.__array_interface__["data"][0]
    offset = values.__array_interface__["data"][0] - start
    return SetAside(values, offset + 8 * loan.first * loan.refilled.shape[1], loan.refilled)


@final
class Template:
    """Views of an array (rows, columns) that was not made, for what is of its shape."""

    def __init__(self, rows: int, columns: int) -> None:
        self.shape = rows, columns
        self.unmade = np.empty(self.shape)
        self._start = self.unmade.__array_interface__["data"][0]

    def of(self, view: NDArray[Any], source: Refilled) -> SetAside:
        """Return what a view of `unmade` is of another array of that shape."""
        return SetAside(view, view.__array_interface__["data"][0] - self._start, source)


def _loan_of(view: Any) -> "_Loan | None":
    while isinstance(view, np.ndarray):
        view = view.base
    return view if isinstance(view, _Loan) else None


@final
class LentMemory:
    """Arrays whose memory comes back when they and their views are gone."""

    def __init__(self) -> None:
        self._free: list[Floats] = []

    def array(self, rows: int, columns: int) -> Floats:
        """Return an array (rows, columns) that holds anything."""
        size = rows * columns
        memory = self._taken(size)
        loan = _Loan(memory, self)
        weakref.finalize(loan, self._free.append, memory).atexit = False
        return np.asarray(loan)[:size].reshape(rows, columns)

    def _taken(self, size: int) -> Floats:
        while self._free:
            memory = self._free.pop()
            if len(memory) >= size:
                return memory
        return _new(size)


def _new(size: int) -> Floats:
    """Return memory for so many numbers."""
    if sys.platform == "linux" and 8 * size >= LARGE_PAGE:
        pages = -(-8 * size // LARGE_PAGE)
        private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
        mapped = mmap.mmap(-1, pages * LARGE_PAGE, flags=private)
        with suppress(OSError):  # a system without large pages
            mapped.madvise(mmap.MADV_HUGEPAGE)
        return np.frombuffer(mapped)
    return np.empty(size)
