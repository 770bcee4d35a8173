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


@final
class _Loan:
    """What an array and all its views keep alive: its end gives the memory back."""

    def __init__(self, memory: Floats, lender: "LentMemory") -> None:
        self.__array_interface__ = memory.__array_interface__
        self.lender = lender
        self.refilled: Refilled | None = None


@final
class Refilled:
    """What fills lent memory again with what it held, as long as somebody reads it."""

    def __init__(self, lent: Floats, fill: Callable[[Floats], None]) -> None:
        """Take an array that was lent, and what fills one like it."""
        self._shape, self._fill = lent.shape, fill
        loan = _loan_of(lent)
        assert loan is not None
        self._lender, loan.refilled = loan.lender, self
        self._loan: Callable[[], _Loan | None] = _nothing

    @property
    def memory(self) -> Floats:
        """An array like the one that was lent, with what that held."""
        rows, columns = self._shape
        loan = self._loan()
        if loan is not None:
            return np.asarray(loan)[: rows * columns].reshape(rows, columns)
        made = self._lender.array(rows, columns)
        self._fill(made)
        loan = _loan_of(made)
        assert loan is not None
        self._loan = weakref.ref(loan)
        return made


def _nothing() -> None:
    """Return what a reference to something that is gone does."""


@final
class SetAside:
    """A view of lent memory that went back, made again when it is read."""

    def __init__(self, view: NDArray[Any], offset: int, refilled: Refilled) -> None:
        self._refilled, self._offset = refilled, offset
        self._shape, self._strides = view.shape, view.strides
        self.dtype = view.dtype

    def __len__(self) -> int:
        return int(self._shape[0])

    def __getitem__(self, rows: Any) -> NDArray[Any]:
        return np.asarray(np.asarray(self)[rows])

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return the view."""
        memory = self._refilled.memory
        view = np.ndarray(self._shape, self.dtype, memory, self._offset, self._strides)
        view.flags.writeable = False
        return np.array(view, dtype, copy=copy) if copy or dtype else view

    @property
    def ndim(self) -> int:
        """The number of its dimensions."""
        return len(self._shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return np.array, (np.array(self),)


def set_aside(values: NDArray[Any]) -> "NDArray[Any] | SetAside":
    """Return what stands for a view of lent memory that can be filled again, or itself."""
    loan = _loan_of(values)
    if loan is None or loan.refilled is None:
        return values
    start = loan.__array_interface__["data"][0]
    offset = values.__array_interface__["data"][0] - start
    return SetAside(values, offset, loan.refilled)


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
