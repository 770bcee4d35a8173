"""A block of rows filled by a kernel, slice by slice, so that each stays in the cache."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.positions import Positions
from spherekit.conventions import Status
from spherekit.engine.row_kernel import RowFunction, RowKernel
from spherekit.numeric.lent_memory import LentMemory, Reader
from spherekit.sphere.rotation import Floats

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""
FEW = 128
"""So many angular velocities are compared one by one where their box leaves it open."""
PARTS = 8
"""Parts that more of them are divided into."""
SHORTEST_RUN = 64
"""Rows without a configuration that follow each other less often are left out by number."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""
ASIDE = 1e-8
"""The least cosine of successive directions: those of rows that are still open may be off
by a tenth of that, as those that are vouched for."""

Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""


@final
@dataclass(frozen=True)
class Seen:
    """What was seen of a slice while its columns were in the cache.

    `ends` are for each input the relative angular velocities (poles, 3, 2) at its first
    and last row, and `steady` says that none reverses between them; both are None where
    not all rows are vouched for. `errors` are for each input the largest of directions,
    rates, changes.
    """

    steady: tuple[bool, ...] | None = None
    ends: tuple[Floats, ...] | None = None
    errors: tuple[tuple[float, ...], ...] = ()


@final
class Rooms:
    """Memory for slices that are filled at the same time, used again and again."""

    def __init__(self) -> None:
        self._free: list[Floats] = []

    @contextmanager
    def lent(self, rows: int, columns: int) -> Iterator[Floats]:
        """Lend an array (rows, columns) that nobody else has."""
        size = rows * columns
        try:
            room = self._free.pop()
        except IndexError:
            room = np.empty(size)
        if len(room) < size:
            room = np.empty(size)
        try:
            yield room[:size].reshape(rows, columns)
        finally:
            self._free.append(room)


@final
@dataclass
class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample. `q` (inputs, samples) are the inputs, `values`
    (variables, n) what was read of the variables, then all of them. `columns` are those of
    the kernel that are kept, None where these are left to be made when they are read.
    `vouched` (n,) says where the values close all loops and the kernel's numbers may be
    given; `residual` (n,) is by how much loops are open, `off` (n,) the error of the
    configuration. `replaced` are rows whose columns are not what the kernel makes of a
    slice, and these; `late` is what was seen of rows after their slice.
    """

    kernel: RowKernel
    positions: Positions
    q: Floats
    values: Floats
    columns: Floats | None
    residual: Floats
    off: Floats
    rooms: "Rooms"

    def __post_init__(self) -> None:
        n = self.values.shape[1]
        self.vouched: NDArray[np.bool_] = np.empty(n, dtype=bool)
        self.status: NDArray[np.int8] = np.empty(n, dtype=np.int8)
        self.replaced: list[tuple[NDArray[np.intp], Floats]] = []
        self.late: list[Seen] = []
        whole = self.columns is not None
        self._deciding = self.kernel.whole if whole else self.kernel.judging

    def fill(self, parts: Sequence[Part], senses: Sequence[Floats]) -> list[Seen]:
        """Fill all rows; return what was seen of each part.

        `senses[input]` (modes, poles) are the signs that directions get.
        """
        made = each_at_once(lambda part: self._fill(part, senses), parts)
        open_ = np.concatenate([rows for _, rows in made])
        if len(open_):
            self._close(open_, senses)
        return [seen for seen, _ in made]

    def again(
        self, parts: Sequence[Part], senses: Sequence[Floats]
    ) -> Callable[[Reader], None]:
        """Return what has the columns read once more, to the last bit, slice by slice.

        `senses[input]` (modes, poles) are the signs that directions have. It does not keep
        the columns that there are.
        """
        kernel, rooms, values = self.kernel, self.rooms, self.values
        replaced = self.replaced

        def pieces(reader: Reader) -> None:
            whole = kernel.whole

            def fill(part: Part) -> None:
                mode, rows = part
                given = np.ascontiguousarray(values[:, rows])
                with rooms.lent(whole.width, given.shape[1]) as room:
                    whole(given, room)
                    for numbers, columns in replaced:
                        here = (numbers >= rows.start) & (numbers < rows.stop)
                        room[: kernel.kept, numbers[here] - rows.start] = columns[:, here]
                    _turn(kernel, room, mode, senses)
                    empty = np.flatnonzero(np.isnan(given[0]))
                    if len(empty):
                        room[: kernel.kept, empty] = np.nan
                    reader(rows, room[: kernel.kept])

            each_at_once(fill, parts)

        return pieces

    def make(
        self, parts: Sequence[Part], senses: Sequence[Floats], memory: LentMemory
    ) -> None:
        """Make the columns that were left to be made when they are read."""
        if self.columns is None:
            self.columns = made = memory.array(self.kernel.kept, len(self.off))

            def fill(some: slice, held: Floats) -> None:
                made[:, some] = held

            self.again(parts, senses)(fill)

    def put(
        self,
        rows: NDArray[np.intp],
        senses: Sequence[Floats],
        residual: Floats | None = None,
    ) -> None:
        """Fill rows by their numbers, whose values are known, and the residual may be."""
        kernel, judging, values = self.kernel, self.kernel.judging, self.values[:, rows]
        judged = judging(values)
        if residual is not None:
            judging.residual(judged)[:] = residual
        self.residual[rows] = judging.residual(judged)
        self.off[rows] = judging.off(judged)
        good = judging.vouched(judged)
        if residual is None:
            good &= judging.closed(judged)
        self.vouched[rows] = good
        if np.any(good):
            self.late.append(Seen(errors=_largest(judging, judged[:, good])))
        if residual is None and self.columns is None:
            return
        columns = kernel.whole(values)
        kernel.whole.residual(columns)[:] = self.residual[rows]
        self.replaced.append((rows, columns[: kernel.kept].copy()))
        if self.columns is None:
            return
        modes = rows // self.q.shape[1]
        for mode in np.unique(modes):
            of_mode = np.ascontiguousarray(columns[:, modes == mode])
            _turn(kernel, of_mode, mode, senses)
            self.columns[:, rows[modes == mode]] = of_mode[: kernel.kept]

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
            self.values[:, rows] = self.off[rows] = self.residual[rows] = np.nan
            if self.columns is not None:
                self.columns[:, rows] = np.nan
            self.vouched[rows] = False

    def looked_through(
        self, seen: Sequence[Seen], parts: Sequence[Part], good: NDArray[np.bool_]
    ) -> list[Seen]:
        """Return what is seen of each part, of its `good` rows (n,) where not all were."""
        return [
            self._looked_at(np.flatnonzero(good[rows]) + rows.start)
            if here.ends is None
            else here
            for here, (_, rows) in zip(seen, parts, strict=True)
        ]

    def _looked_at(self, rows: NDArray[np.intp]) -> Seen:
        """Return what is seen of some rows, found again."""
        judging = self.kernel.judging
        if not len(rows):
            return Seen((True,) * len(judging.inputs))
        return _seen(judging, judging(self.values[:, rows]))

    def _fill(self, part: Part, senses: Sequence[Floats]) -> tuple[Seen, NDArray[np.intp]]:
        """Fill a slice; return what was seen of it, and which rows are not quite closed."""
        mode, rows = part
        first, count = mode * self.q.shape[1], rows.stop - rows.start
        q = self.q[:, rows.start - first : rows.stop - first]
        values, lost = self.positions.complete(mode, q, self.values[:, rows])
        self.status[rows] = Status.OK
        none = np.empty(0, dtype=np.intp)
        if np.any(lost):
            self.status[rows][lost] = Status.OUT_OF_REACH
            if np.all(lost):
                self.vouched[rows] = False
                return Seen(), none
        self.values[:, rows] = values
        deciding = self._deciding
        with self.rooms.lent(deciding.width, count) as columns:
            deciding(values, columns)
            self.residual[rows] = deciding.residual(columns)
            self.off[rows] = deciding.off(columns)
            good = deciding.vouched(columns)
            closed = deciding.closed(columns)
            whole = bool(np.all(closed))
            seen = Seen()
            if np.all(good):
                seen = _seen(deciding, columns, slice(None) if whole else closed)
            if self.columns is not None:
                _turn(self.kernel, columns, mode, senses)
                self.columns[:, rows] = columns[: self.kernel.kept]
            if whole:
                self.vouched[rows] = good
                return seen, none
            np.logical_and(good, closed, out=self.vouched[rows])
            open_ = np.flatnonzero(~closed & np.isfinite(self.residual[rows]))
            return seen, open_ + rows.start

    def _close(self, open_: NDArray[np.intp], senses: Sequence[Floats]) -> None:
        """Take a step of Newton's method at some rows; keep what that closes, near by."""
        before = self.values[:, open_]
        after = before.copy()
        after[list(self.kernel.free)] = self.kernel.closer(before)
        step = np.max(np.abs(after - before), axis=0)
        near = step < SMALL_STEP
        rows = open_[near]
        self.values[:, rows] = after[:, near]
        self.put(rows, senses)


def steady(seen: Sequence[Seen], parts: Sequence[Part]) -> list[bool]:
    """Return for each input whether no direction reverses within a mode of a block."""
    inputs = [here.steady for here in seen if here.steady is not None]
    ends = [
        (mode, here.ends)
        for (mode, _), here in zip(parts, seen, strict=True)
        if here.ends is not None
    ]
    modes = np.array([mode for mode, _ in ends])
    goes_on = modes[1:] == modes[:-1]
    return [
        all(of_part)
        and not (
            np.any(goes_on) and np.any(~_joined([v[number] for _, v in ends])[goes_on])
        )
        for number, of_part in enumerate(zip(*inputs, strict=True))
    ]


def _joined(ends: Sequence[Floats]) -> NDArray[np.bool_]:
    """Return which directions (slices - 1, poles) do not reverse from slice to slice.

    `ends` are (poles, 3, 2) angular velocities at the first and last row of each.
    """
    v = np.array(ends)
    return _along(v[:-1, ..., 1], v[1:, ..., 0])


def largest_errors(seen: Sequence[Seen], number: int) -> list[float | None]:
    """Return the largest errors of an input's directions, rates and changes in a block."""
    parts = [here.errors[number] for here in seen if here.errors]
    return [max(of_kind) for of_kind in zip(*parts, strict=True)] or [None] * 3


def _along(one: Floats, two: Floats) -> NDArray[np.bool_]:
    """Return which directions (..., 3) and (..., 3) do not reverse."""
    sizes = np.sum(one * one, axis=-1) * np.sum(two * two, axis=-1)
    return np.asarray(np.sum(one * two, axis=-1) >= ASIDE * np.sqrt(sizes))


def _seen(
    deciding: RowFunction,
    columns: Floats,
    closed: slice | NDArray[np.bool_] = slice(None),
) -> Seen:
    """Return what is seen of successive rows; errors count where loops are `closed`."""
    every = range(len(deciding.inputs))
    ends = columns[:, [0, -1]]
    return Seen(
        tuple(_is_steady(deciding, deciding.turning(columns, k), k) for k in every),
        tuple(deciding.relative(k, deciding.turning(ends, k)) for k in every),
        _largest(deciding, columns, closed),
    )


def _largest(
    deciding: RowFunction,
    columns: Floats,
    chosen: slice | NDArray[np.bool_] = slice(None),
) -> tuple[tuple[float, ...], ...]:
    every = (deciding.errors(columns, k) for k in range(len(deciding.inputs)))
    return tuple(
        tuple(np.maximum.reduce(errors[:, chosen], axis=1, initial=0.0).tolist())
        for errors in every
    )


def _is_steady(deciding: RowFunction, turning: Floats, number: int) -> bool:
    """Return whether no direction of an input reverses from one row to the next.

    By the angular velocities (links, 3, n) of what turns: within their least and largest
    first, then, where that leaves it open, in parts.
    """
    if not turning.size:
        return True
    n = turning.shape[2]
    if n <= FEW:
        v = np.moveaxis(deciding.relative(number, turning), 1, 2)
        return bool(np.all(_along(v[:, :-1], v[:, 1:])))
    low, high = np.minimum.reduce(turning, axis=2), np.maximum.reduce(turning, axis=2)
    least, most = deciding.relative(number, low, high), deciding.relative(number, high, low)
    # No product of two in a box falls below the one, no size exceeds the other.
    across, one, other = least * most, least * least, most * most
    inner = np.where(across > 0.0, np.minimum(one, other), across)
    product, size = np.sum(inner, axis=1), np.sum(np.maximum(one, other), axis=1)
    if np.all(product >= ASIDE * size):
        return True
    step = -(-n // PARTS)
    return all(
        _is_steady(deciding, turning[..., start : start + step + 1], number)
        for start in range(0, n - 1, step)
    )


def _turn(kernel: RowKernel, columns: Floats, mode: int, senses: Sequence[Floats]) -> None:
    """Give directions of a mode their signs, in place."""
    for number, of_input in enumerate(senses):
        signed = kernel.signed(columns, number)
        for pole in np.flatnonzero(of_input[mode] < 0.0):
            np.negative(signed[:, pole], out=signed[:, pole])
