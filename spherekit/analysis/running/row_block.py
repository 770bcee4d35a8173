"""A block of rows judged by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.positions import Positions
from spherekit.analysis.running.reversals import Numbers, Seen, largest
from spherekit.conventions import Status
from spherekit.engine.closed_positions import given_by
from spherekit.engine.row_kernel import RowFunction, RowKernel
from spherekit.numeric.lent_memory import LentMemory
from spherekit.sphere.rotation import Floats

SHORTEST_RUN = 64
"""Rows without a configuration that follow each other less often are left out by number."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

NONE: Numbers = np.empty(0, dtype=np.intp)
Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""


def parts_of(modes: int, count: int, size: int) -> list[Part]:
    """Return the rows of modes with `count` samples each in slices of a size."""
    return [
        (mode, slice(start, min(start + size, (mode + 1) * count)))
        for mode in range(modes)
        for start in range(mode * count, (mode + 1) * count, size)
    ]


def named_of(samples: Numbers | range, q: Floats) -> Floats:
    """Return the numbers of samples as bits of whole ones, and the inputs (inputs, n)."""
    made = np.empty((1 + len(q), q.shape[1]))
    numbers: NDArray[Any] = made[0].view(np.int64)
    numbers[:] = (
        np.arange(samples.start, samples.stop) if isinstance(samples, range) else samples
    )
    made[1:] = q
    return made


@final
@dataclass(frozen=True)
class _Filled:
    """What a slice was filled with: what was `seen`, and which rows are `open_`.

    Of a slice with rows that are not well also which are `vouched` for, and their `status`.
    """

    seen: Seen | None
    open_: Numbers
    vouched: NDArray[np.bool_] | None = None
    status: NDArray[np.int8] | None = None


@final
@dataclass
class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample. `deciding` is what decides about slices, by inputs or
    variables as `positions` are. `q` (inputs, samples) are the inputs, `named` what rows
    get of the numbers of `samples`, as bits of whole ones, and of the inputs. `values`
    (variables, n) what was read of the variables, then all of them. `closure` (2, n) is by
    how much loops are open, and the error of the configuration. `vouched` (n,) says where
    the values close all loops and the kernel's numbers may be given; the block `is_whole`
    where that is everywhere. `careful` are the rows that were found with care, `late` the
    errors of rows after their slice.
    """

    kernel: RowKernel
    deciding: RowFunction
    positions: Positions
    samples: Numbers | range
    q: Floats
    values: Floats
    closure: Floats
    named: Floats
    memory: LentMemory

    def __post_init__(self) -> None:
        n = self.values.shape[1]
        self.vouched: NDArray[np.bool_] = np.broadcast_to(True, n)
        self.status: NDArray[np.int8] = np.broadcast_to(np.int8(Status.OK), n)
        self.careful = NONE
        self.late: list[tuple[tuple[float, ...], ...]] = []
        self.is_whole = True

    @property
    def residual(self) -> Floats:
        """(n,) by how much loops are open, rad."""
        return np.asarray(self.closure[0])

    @property
    def off(self) -> Floats:
        """(n,) the errors of configurations."""
        return np.asarray(self.closure[1])

    def fill(self, parts: Sequence[Part]) -> list[Seen | None]:
        """Fill all rows; return what was seen of parts whose rows are all vouched for."""
        made = each_at_once(self._fill, parts, self.kernel.in_threads)
        self.is_whole = all(item.vouched is None for item in made)
        if not self.is_whole:
            self.vouched, self.status = self.vouched.copy(), self.status.copy()
        for (_, rows), item in zip(parts, made, strict=True):
            if item.vouched is not None and item.status is not None:
                self.vouched[rows], self.status[rows] = item.vouched, item.status
        open_ = np.concatenate([item.open_ for item in made])
        if len(open_):
            self._close(open_)
        return [item.seen for item in made]

    def put(self, rows: Numbers, residual: Floats | None = None) -> None:
        """Fill rows by their numbers, whose values are known, and the residual may be."""
        judging, values = self.kernel.judging, self.values[:, rows]
        judged = judging(values)
        if residual is not None:
            judging.closure(judged)[0] = residual
            self.careful = rows
        self.closure[:, rows] = judging.closure(judged)
        good = judging.vouched(judged)
        if residual is None:
            good &= judging.closed(judged)
        self.vouched[rows] = good
        if np.any(good):
            self.late.append(largest(judging, judged, good))

    def leave_out(self, failed: NDArray[np.bool_]) -> None:
        """Give rows (n,) that hold no configuration no numbers."""
        if not np.any(failed):
            return
        edges = np.flatnonzero(np.diff(failed, prepend=False, append=False)).tolist()
        runs: list[slice | Numbers] = [
            slice(*run) for run in zip(edges[::2], edges[1::2], strict=True)
        ]
        if len(runs) * SHORTEST_RUN > len(failed):
            runs = [np.flatnonzero(failed)]
        for rows in runs:
            self.values[:, rows] = self.closure[:, rows] = np.nan
            self.vouched[rows] = False

    def looked_through(
        self, seen: Sequence[Seen | None], parts: Sequence[Part]
    ) -> list[tuple[int, Seen]]:
        """Return what is seen of each part that has rows vouched for, with its mode."""
        made = [
            (mode, here or self._looked_at(np.flatnonzero(self.vouched[rows]) + rows.start))
            for here, (mode, rows) in zip(seen, parts, strict=True)
        ]
        return [(mode, here) for mode, here in made if here is not None]

    def _looked_at(self, rows: Numbers) -> Seen | None:
        """Return what is seen of some rows, found again."""
        if not len(rows):
            return None
        judging = self.kernel.judging
        return Seen.of(judging, judging(self.values[:, rows]), rows)

    def _fill(self, part: Part) -> _Filled:
        """Fill a slice."""
        mode, rows = part
        lost: NDArray[np.bool_] | None = None
        first, count = mode * self.q.shape[1], rows.stop - rows.start
        here = slice(rows.start - first, rows.stop - first)
        q = self.q[:, here]
        self.named[:, rows] = named_of(self.samples[here], q)
        by_inputs, judging = self.positions.by_inputs, self.deciding
        with self.memory.room(judging.width + judging.given, count) as room:
            given, columns = room[: judging.given], room[judging.given :]
            if by_inputs:
                given_by(q, self.positions.signs(mode), given)
            else:
                given[:] = self.values[:, rows]
                if np.isnan(np.min(given[0])):
                    lost = self.positions.complete(mode, q, given)
            judging(given, columns)
            if by_inputs or lost is not None:
                self.values[:, rows] = columns[: judging.variables] if by_inputs else given
            self.closure[:, rows] = judging.closure(columns)
            numbers = range(rows.start, rows.stop)
            if judging.is_well(columns):
                return _Filled(Seen.of(judging, columns, numbers), NONE)
            good, closed = judging.vouched(columns), judging.closed(columns)
            status = np.zeros(count, dtype=np.int8)
            if by_inputs:
                lost = judging.lost(columns)
            if lost is not None:
                status[lost] = Status.OUT_OF_REACH
            well, seen = good & closed, None
            open_ = np.flatnonzero(~closed & np.isfinite(judging.closure(columns)[0]))
            if np.all(good):
                seen = Seen.of(judging, columns, numbers, closed)
            elif not len(open_) and np.any(well):
                seen = Seen.of(judging, columns[:, well], np.flatnonzero(well) + rows.start)
            return _Filled(seen, open_ + rows.start, well, status)

    def _close(self, open_: Numbers) -> None:
        """Take a step of Newton's method at some rows; keep what that closes, near by."""
        before = self.values[:, open_]
        after = before.copy()
        after[list(self.kernel.free)] = self.kernel.closer(before)
        step = np.max(np.abs(after - before), axis=0)
        near = step < SMALL_STEP
        rows = open_[near]
        self.values[:, rows] = after[:, near]
        self.put(rows)
