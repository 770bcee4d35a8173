"""A block of rows filled by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.lent_memory import LentMemory
from spherekit.conventions import Status
from spherekit.engine.columns import RowKernel
from spherekit.sphere.rotation import Floats

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""
SHORTEST_RUN = 64
"""Rows without a configuration that follow each other less often are left out by number."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""
Flags = list[bool] | None
"""For each input whether no direction reverses in a slice; None where that is not known."""


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

    `values` (variables, n), `columns` those of the kernel that are kept. `vouched` (n,)
    says where the values close all loops and the kernel's numbers may be given; `off`
    (n,) is the error of the configuration.
    """

    kernel: RowKernel
    values: Floats
    columns: Floats
    vouched: NDArray[np.bool_]
    off: Floats
    status: NDArray[np.int8]
    rooms: "Rooms"

    @classmethod
    def of(
        cls,
        kernel: RowKernel,
        values: Floats,
        lost: NDArray[np.bool_],
        rooms: "Rooms",
        memory: LentMemory,
    ) -> "Rows":
        """Return the rows of values (variables, n), NaN where none is known.

        `lost` (n,) says which are out of reach.
        """
        n = values.shape[1]
        return cls(
            kernel,
            values,
            memory.array(kernel.kept, n),
            np.empty(n, dtype=bool),
            np.empty(n),
            np.where(lost, Status.OUT_OF_REACH, Status.OK).astype(np.int8),
            rooms,
        )

    @property
    def residual(self) -> Floats:
        """(n,) by how much loops are open, rad."""
        return self.kernel.residual(self.columns)

    def fill(self, parts: Sequence[Part], senses: Sequence[Floats]) -> list[Flags]:
        """Fill all rows; return for each part whether no direction reverses in it.

        `senses[input]` (modes, poles) are the signs that directions get.
        """
        return each_at_once(lambda part: self._fill(part, senses), parts)

    def put(self, rows: NDArray[np.intp]) -> None:
        """Fill rows by their numbers, whose values are known."""
        columns = self.kernel(self.values[:, rows])
        self.columns[:, rows] = columns[: self.kernel.kept]
        self.vouched[rows], self.off[rows] = self.kernel.judged(columns)

    def leave_out(self, failed: NDArray[np.bool_]) -> None:
        """Give rows (n,) that hold no configuration no numbers."""
        if not np.any(failed):
            return
        edges = np.flatnonzero(np.diff(failed, prepend=False, append=False)).tolist()
        runs: list[slice | NDArray[np.intp]] = [
            slice(*run) for run in zip(edges[::2], edges[1::2], strict=True)
        ]
        if len(runs) * SHORTEST_RUN > len(failed):
            runs = [np.flatnonzero(failed)]
        for rows in runs:
            self.columns[:, rows] = self.values[:, rows] = self.off[rows] = np.nan
            self.vouched[rows] = False

    def steady(
        self, flags: Sequence[Flags], parts: Sequence[Part], good: NDArray[np.bool_]
    ) -> list[bool]:
        """Return for each input whether no direction reverses between `good` rows (n,).

        From one to the next of its mode; `flags` are what `fill` returned.
        """
        ends: list[tuple[int, int, int]] = []
        unknown: list[NDArray[np.intp]] = []
        for (mode, rows), flag in zip(parts, flags, strict=True):
            inside = np.flatnonzero(good[rows]) + rows.start
            if len(inside):
                ends.append((mode, int(inside[0]), int(inside[-1])))
            if flag is None:
                unknown.append(inside)
        unknown += [
            np.array([last, first])
            for (before, _, last), (mode, first, _) in pairwise(ends)
            if mode == before
        ]
        return [
            all(flag[number] for flag in flags if flag is not None)
            and all(self._goes_on(number, rows) for rows in unknown)
            for number in range(len(self.kernel.rates))
        ]

    def _goes_on(self, number: int, rows: NDArray[np.intp]) -> bool:
        """Return whether no direction reverses between successive ones of some rows."""
        unit = self._signed(self.columns, number)[:3][..., rows]
        return bool(np.all(np.sum(unit[..., 1:] * unit[..., :-1], axis=0) >= 0.0))

    def _signed(self, columns: Floats, number: int) -> Floats:
        places = self.kernel.rates[number]
        count = len(places.signed)
        block = columns[places.block : places.block + 8 * count]
        return block.reshape(8, count, columns.shape[1])

    def _fill(self, part: Part, senses: Sequence[Floats]) -> Flags:
        """Fill a slice; return for each input whether no direction reverses in it."""
        mode, rows = part
        if np.all(self.status[rows] != Status.OK):
            self.vouched[rows] = False
            return [True] * len(senses)
        kernel, values = self.kernel, np.ascontiguousarray(self.values[:, rows])
        room = self.rooms.taken()
        columns = kernel(
            values,
            room[: kernel.width * values.shape[1]].reshape(kernel.width, values.shape[1]),
        )
        closed = kernel.closed(columns)
        if not np.all(closed):
            open_ = np.flatnonzero(~closed & np.isfinite(kernel.residual(columns)))
            if len(open_):
                closed[open_] = self._close(rows, values, columns, open_)
        good, self.off[rows] = kernel.judged(columns)
        self.vouched[rows] = good & closed
        for number, of_input in enumerate(senses):
            signed = self._signed(columns, number)
            for pole in np.flatnonzero(of_input[mode] < 0.0):
                np.negative(signed[:, pole], out=signed[:, pole])
        self.columns[:, rows] = columns[: kernel.kept]
        flags = None
        if np.all(closed):
            flags = [self._is_steady(columns, number) for number in range(len(senses))]
        self.rooms.given_back(room)
        return flags

    def _is_steady(self, columns: Floats, number: int) -> bool:
        """Return whether no direction reverses in columns, which are written to."""
        unit = self._signed(columns, number)[:3]
        np.multiply(unit[..., 1:], unit[..., :-1], out=unit[..., 1:])
        unit[0, :, 1:] += unit[1, :, 1:]
        unit[0, :, 1:] += unit[2, :, 1:]
        return not unit.size or bool(np.min(unit[0, :, 1:], initial=1.0) >= 0.0)

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
