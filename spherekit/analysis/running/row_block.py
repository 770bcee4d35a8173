"""A block of rows filled by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.engine.columns import RowKernel
from spherekit.sphere.rotation import Floats

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""


@final
class Rooms:
    """Memory for slices that are filled at the same time, used again and again."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._free: list[Floats] = []

    def taken(self) -> Floats:
        """Return memory that nobody else has."""
        try:
            return self._free.pop()
        except IndexError:
            return np.empty(self._size)

    def given_back(self, room: Floats) -> None:
        """Take memory back."""
        self._free.append(room)


@final
@dataclass(frozen=True)
class Rows:
    """The rows of a block while they are found, with room for the columns of slices.

    `values` (variables, n), `columns` those of the kernel that are kept. `closed` (n,) says
    where the values close all loops, `vouched` (n,) where the kernel's numbers may be
    given; `off` (n,) is the error of the configuration.
    """

    kernel: RowKernel
    values: Floats
    columns: Floats
    closed: NDArray[np.bool_]
    vouched: NDArray[np.bool_]
    off: Floats
    status: NDArray[np.int8]
    rooms: "Rooms"

    @classmethod
    def of(cls, kernel: RowKernel, values: Floats, rooms: "Rooms") -> "Rows":
        """Return the rows of values (variables, n), NaN where none is predicted."""
        n = values.shape[1]
        return cls(
            kernel,
            values,
            np.empty((kernel.kept, n)),
            np.empty(n, dtype=bool),
            np.empty(n, dtype=bool),
            np.empty(n),
            np.zeros(n, dtype=np.int8),
            rooms,
        )

    @property
    def residual(self) -> Floats:
        """(n,) by how much loops are open, rad."""
        return self.kernel.residual(self.columns)

    def fill(self, parts: Sequence[Part], senses: Sequence[Floats]) -> list[bool]:
        """Fill all rows; return for each input whether no direction reverses in its modes.

        `senses[input]` (modes, poles) are the signs that directions get.
        """
        made = each_at_once(lambda part: self._fill(part, senses), parts)
        return [
            all(flags[number] for flags in made) and self._joins(number, parts)
            for number in range(len(senses))
        ]

    def put(self, rows: NDArray[np.intp]) -> None:
        """Fill rows by their numbers, whose values are known."""
        columns = self.kernel(self.values[:, rows])
        self.columns[:, rows] = columns[: self.kernel.kept]
        self.vouched[rows], self.off[rows] = self.kernel.judged(columns)

    def _joins(self, number: int, parts: Sequence[Part]) -> bool:
        """Return whether directions go on from each slice to the next of its mode."""
        same = [
            rows.start for (before, _), (mode, rows) in pairwise(parts) if mode == before
        ]
        at = np.array(same, dtype=np.intp)
        unit = self._signed(self.columns, number)[:3]
        return bool(np.all(np.sum(unit[..., at] * unit[..., at - 1], axis=0) >= 0.0))

    def _signed(self, columns: Floats, number: int) -> Floats:
        places = self.kernel.rates[number]
        count = len(places.signed)
        block = columns[places.block : places.block + 8 * count]
        return block.reshape(8, count, columns.shape[1])

    def _fill(self, part: Part, senses: Sequence[Floats]) -> list[bool]:
        """Fill a slice; return for each input whether no direction reverses in it."""
        mode, rows = part
        kernel, values = self.kernel, np.ascontiguousarray(self.values[:, rows])
        room = self.rooms.taken()
        columns = kernel(
            values,
            room[: kernel.width * values.shape[1]].reshape(kernel.width, values.shape[1]),
        )
        closed = kernel.closed(columns)
        if not np.all(closed):
            open_ = np.flatnonzero(~closed & np.isfinite(values[0]))
            if len(open_):
                closed[open_] = self._close(rows, values, columns, open_)
        self.closed[rows] = closed
        self.vouched[rows], self.off[rows] = kernel.judged(columns)
        for number, of_input in enumerate(senses):
            signed = self._signed(columns, number)
            for pole in np.flatnonzero(of_input[mode] < 0.0):
                np.negative(signed[:, pole], out=signed[:, pole])
        self.columns[:, rows] = columns[: kernel.kept]
        steady = []
        for number in range(len(senses)):
            signed = self._signed(columns, number)
            unit = signed[:3]
            np.multiply(unit[..., 1:], unit[..., :-1], out=unit[..., 1:])
            unit[0, :, 1:] += unit[1, :, 1:]
            unit[0, :, 1:] += unit[2, :, 1:]
            steady.append(not unit.size or bool(np.min(unit[0, :, 1:], initial=1.0) >= 0.0))
        self.rooms.given_back(room)
        return steady

    def _close(
        self, rows: slice, values: Floats, columns: Floats, open_: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Take a step of Newton's method; return which rows that closes, near by."""
        before = values[:, open_]
        after = before.copy()
        after[list(self.kernel.free)] = self.kernel.closer(before)
        again = self.kernel(after)
        step = np.max(np.abs(after - before), axis=0)
        closed = self.kernel.closed(again) & (step < SMALL_STEP)
        self.values[:, rows.start + open_[closed]] = after[:, closed]
        columns[:, open_[closed]] = again[:, closed]
        return np.asarray(closed)
