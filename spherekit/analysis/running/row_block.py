"""A block of rows judged by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.positions import Positions
from spherekit.analysis.running.reversals import Numbers, Seen, largest
from spherekit.conventions import Status
from spherekit.engine.row_kernel import RowKernel
from spherekit.numeric.lent_memory import Rooms
from spherekit.sphere.rotation import Floats

SHORTEST_RUN = 64
"""Rows without a configuration that follow each other less often are left out by number."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""


def parts_of(modes: int, count: int, size: int) -> list[Part]:
    """Return the rows of modes with `count` samples each in slices of a size."""
    return [
        (mode, slice(start, min(start + size, (mode + 1) * count)))
        for mode in range(modes)
        for start in range(mode * count, (mode + 1) * count, size)
    ]


@final
@dataclass
class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample. `q` (inputs, samples) are the inputs, `values`
    (variables, n) what was read of the variables, then all of them. `vouched` (n,) says
    where the values close all loops and the kernel's numbers may be given; `residual` (n,)
    is by how much loops are open, `off` (n,) the error of the configuration. `careful` are
    the rows that were found with care, `late` the errors of rows after their slice. The
    block `is_whole` if its slices were vouched for as they were filled.
    """

    kernel: RowKernel
    positions: Positions
    q: Floats
    values: Floats
    residual: Floats
    off: Floats
    vouched: NDArray[np.bool_]
    status: NDArray[np.int8]
    rooms: Rooms

    def __post_init__(self) -> None:
        self.careful: Numbers = np.empty(0, dtype=np.intp)
        self.late: list[tuple[tuple[float, ...], ...]] = []
        self.is_whole = False

    def fill(self, parts: Sequence[Part]) -> list[Seen | None]:
        """Fill all rows; return what was seen of parts whose rows are all vouched for."""
        made = each_at_once(self._fill, parts)
        self.is_whole = all(is_whole for *_, is_whole in made)
        open_ = np.concatenate([rows for _, rows, _ in made])
        if len(open_):
            self._close(open_)
        return [seen for seen, *_ in made]

    def put(self, rows: Numbers, residual: Floats | None = None) -> None:
        """Fill rows by their numbers, whose values are known, and the residual may be."""
        judging, values = self.kernel.judging, self.values[:, rows]
        judged = judging(values)
        if residual is not None:
            judging.residual(judged)[:] = residual
            self.careful = rows
        self.residual[rows] = judging.residual(judged)
        self.off[rows] = judging.off(judged)
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
            self.values[:, rows] = self.off[rows] = self.residual[rows] = np.nan
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
        counted = np.ones(len(rows), dtype=bool)
        return Seen.of(judging, judging(self.values[:, rows]), rows, counted)

    def _fill(self, part: Part) -> tuple[Seen | None, Numbers, bool]:
        """Fill a slice; return what was seen, rows that are open, and if all are well."""
        mode, rows = part
        first, count = mode * self.q.shape[1], rows.stop - rows.start
        q = self.q[:, rows.start - first : rows.stop - first]
        judging, positions = self.kernel.judging, self.positions
        none = np.empty(0, dtype=np.intp)
        with (
            self.rooms.lent(positions.width, count) as room,
            self.rooms.lent(judging.width, count) as columns,
        ):
            values, lost = positions.complete(mode, q, self.values[:, rows], room)
            self.status[rows] = Status.OK
            if np.any(lost):
                self.status[rows][lost] = Status.OUT_OF_REACH
                if np.all(lost):
                    self.vouched[rows] = False
                    return None, none, False
            self.values[:, rows] = values
            judging(values, columns)
            self.residual[rows] = judging.residual(columns)
            self.off[rows] = judging.off(columns)
            good = judging.vouched(columns)
            closed = judging.closed(columns)
            np.logical_and(good, closed, out=self.vouched[rows])
            seen, is_good = None, bool(np.all(good))
            if is_good:
                seen = Seen.of(judging, columns, np.arange(rows.start, rows.stop), closed)
            if np.all(closed):
                return seen, none, is_good
            open_ = np.flatnonzero(~closed & np.isfinite(self.residual[rows]))
            return seen, open_ + rows.start, False

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
