"""Memory for arrays of blocks, used again once nobody reads them.

Memory that is new has to be handed over by the system, page by page, which takes longer
than filling it. So large arrays get the largest pages there are.
"""

import mmap
import sys
import weakref
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

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
