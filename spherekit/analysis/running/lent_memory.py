"""Memory for arrays of blocks, used again once nobody reads them.

Memory that is new has to be handed over by the system, page by page, which takes longer
than filling it.
"""

import weakref
from typing import final

import numpy as np

from spherekit.sphere.rotation import Floats


@final
class _Loan:
    """What an array and all its views keep alive: its end gives the memory back."""

    def __init__(self, memory: Floats) -> None:
        self.__array_interface__ = memory.__array_interface__


@final
class LentMemory:
    """Arrays whose memory comes back when they and their views are gone."""

    def __init__(self) -> None:
        self._free: list[Floats] = []

    def array(self, rows: int, columns: int) -> Floats:
        """Return an array (rows, columns) that holds anything."""
        size = rows * columns
        memory = self._taken(size)
        loan = _Loan(memory)
        weakref.finalize(loan, self._free.append, memory).atexit = False
        return np.asarray(loan)[:size].reshape(rows, columns)

    def _taken(self, size: int) -> Floats:
        while self._free:
            memory = self._free.pop()
            if len(memory) >= size:
                return memory
        return np.empty(size)
