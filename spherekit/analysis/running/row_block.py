"""A block of rows filled by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.positions import Positions
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

    @contextmanager
    def lent(self, rows: int, columns: int) -> Iterator[Floats]:
        """Lend an array (rows, columns) that nobody else has."""
        try:
            room = self._free.pop()
        except IndexError:
            room = np.empty(self._size)
        try:
            yield room[: rows * columns].reshape(rows, columns)
        finally:
            self._free.append(room)


@final
@dataclass
class Rows:
    """The rows of a block while they are found, with room for the columns of slices.

    By assembly mode, then sample. `q` (inputs, samples) are the inputs, `values`
    (variables, n) what was read of the variables, then all of them; `columns` those of the
    kernel that are kept. `vouched` (n,) says where the values close all loops and the
    kernel's numbers may be given; `off` (n,) is the error of the configuration. `replaced`
    are rows whose values were found after their slice had been filled, and their columns.
    """

    kernel: RowKernel
    positions: Positions
    q: Floats
    values: Floats
    columns: Floats
    off: Floats
    rooms: "Rooms"

    def __post_init__(self) -> None:
        n = self.values.shape[1]
        self.vouched: NDArray[np.bool_] = np.empty(n, dtype=bool)
        self.status: NDArray[np.int8] = np.empty(n, dtype=np.int8)
        self.replaced: list[tuple[NDArray[np.intp], Floats]] = []

    @property
    def residual(self) -> Floats:
        """(n,) by how much loops are open, rad."""
        return self.kernel.residual(self.columns)

    def fill(self, parts: Sequence[Part], senses: Sequence[Floats]) -> list[Flags]:
        """Fill all rows; return for each part whether no direction reverses in it.

        `senses[input]` (modes, poles) are the signs that directions get.
        """
        return each_at_once(lambda part: self._fill(part, senses), parts)

    def again(
        self, parts: Sequence[Part], senses: Sequence[Floats]
    ) -> Callable[[Floats], None]:
        """Return what writes the columns once more, to the last bit.

        `senses[input]` (modes, poles) are the signs that directions have. It does not keep
        the columns that there are.
        """
        kernel, rooms, values = self.kernel, self.rooms, self.values
        replaced = [(rows, columns[: kernel.kept]) for rows, columns in self.replaced]

        def write(out: Floats) -> None:
            def fill(part: Part) -> None:
                mode, rows = part
                given = np.ascontiguousarray(values[:, rows])
                with rooms.lent(kernel.width, given.shape[1]) as room:
                    kernel(given, room)
                    for numbers, columns in replaced:
                        here = (numbers >= rows.start) & (numbers < rows.stop)
                        room[: kernel.kept, numbers[here] - rows.start] = columns[:, here]
                    _turn(kernel, room, mode, senses)
                    out[:, rows] = room[: kernel.kept]

            each_at_once(fill, parts)
            empty = np.flatnonzero(np.isnan(values[0]))
            if len(empty):
                out[:, empty] = np.nan

        return write

    def put(
        self, rows: NDArray[np.intp], residual: Floats, senses: Sequence[Floats]
    ) -> None:
        """Fill rows by their numbers, whose values and residual are known."""
        columns = self.kernel(self.values[:, rows])
        self.vouched[rows], self.off[rows] = self.kernel.judged(columns)
        self.kernel.residual(columns)[:] = residual
        self.replaced.append((rows, columns.copy()))
        modes = rows // self.q.shape[1]
        for mode in np.unique(modes):
            of_mode = np.ascontiguousarray(columns[:, modes == mode])
            _turn(self.kernel, of_mode, mode, senses)
            self.columns[:, rows[modes == mode]] = of_mode[: self.kernel.kept]

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
        unit = _signed(self.kernel, self.columns, number)[:3][..., rows]
        return bool(np.all(np.sum(unit[..., 1:] * unit[..., :-1], axis=0) >= 0.0))

    def _fill(self, part: Part, senses: Sequence[Floats]) -> Flags:
        """Fill a slice; return for each input whether no direction reverses in it."""
        mode, rows = part
        first, count = mode * self.q.shape[1], rows.stop - rows.start
        q = self.q[:, rows.start - first : rows.stop - first]
        values, lost = self.positions.complete(mode, q, self.values[:, rows])
        self.status[rows] = Status.OK
        some = np.any(lost)
        if some:
            self.status[rows][lost] = Status.OUT_OF_REACH
        if some and np.all(lost):
            self.vouched[rows] = False
            return [True] * len(senses)
        self.values[:, rows] = values
        kernel = self.kernel
        with self.rooms.lent(kernel.width, count) as columns:
            kernel(values, columns)
            closed = kernel.closed(columns)
            if not np.all(closed):
                open_ = np.flatnonzero(~closed & np.isfinite(kernel.residual(columns)))
                if len(open_):
                    closed[open_] = self._close(rows, values, columns, open_)
            good, self.off[rows] = kernel.judged(columns)
            self.vouched[rows] = good & closed
            _turn(kernel, columns, mode, senses)
            self.columns[:, rows] = columns[: kernel.kept]
            if not np.all(closed):
                return None
            return [self._is_steady(columns, number) for number in range(len(senses))]

    def _is_steady(self, columns: Floats, number: int) -> bool:
        """Return whether no direction reverses in columns, which are written to."""
        unit = _signed(self.kernel, columns, number)[:3]
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
        numbers = rows.start + open_[closed]
        self.replaced.append((numbers, again[:, closed]))
        self.values[:, numbers] = after[:, closed]
        columns[:, open_[closed]] = again[:, closed]
        return np.asarray(closed)


def _signed(kernel: RowKernel, columns: Floats, number: int) -> Floats:
    """Return (8, poles, n) what has a sign of its own, of an input."""
    places = kernel.rates[number]
    count = len(places.signed)
    block = columns[places.block : places.block + 8 * count]
    return block.reshape(8, count, columns.shape[1])


def _turn(kernel: RowKernel, columns: Floats, mode: int, senses: Sequence[Floats]) -> None:
    """Give directions of a mode their signs, in place."""
    for number, of_input in enumerate(senses):
        signed = _signed(kernel, columns, number)
        for pole in np.flatnonzero(of_input[mode] < 0.0):
            np.negative(signed[:, pole], out=signed[:, pole])
