"""Poles of a block by a kernel, of which nothing is made until it is read."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.conventions import Status
from spherekit.engine.columns import ERRORS, SIGNED
from spherekit.engine.fields import add_locked, found
from spherekit.engine.row_kernel import RowKernel
from spherekit.motion.motion import Motion
from spherekit.numeric.unread import LentMemory, Reader, Unread
from spherekit.planning.poles import Pole
from spherekit.rates.request import PoleField, Request, TurnedRows
from spherekit.rates.sequence import PlannedPoles
from spherekit.sphere.rotation import nans

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""
MEMORY = LentMemory()
"""What blocks are in, of this run and the next."""

Part = tuple[int, slice]
"""A slice of successive rows, and the number of their assembly mode."""
ColumnKey = tuple[int, str, Any, int]
"""An input, a part of its field, a pole or link, and a component."""


def slices_of(modes: int, count: int, size: int) -> list[Part]:
    """Return the rows of modes with `count` samples each in slices of a size."""
    return [
        (mode, slice(start, min(start + size, (mode + 1) * count)))
        for mode in range(modes)
        for start in range(mode * count, (mode + 1) * count, size)
    ]


@final
class KernelColumns:
    """The columns of a block's rows by a kernel, from the values of its motion.

    Those at the rows `doubtful` (k,), which the kernel does not vouch for, are of `careful`
    fields, one for each input. Directions that have no sense follow their angular velocity
    until `turned` says, by input, which of them are turned round.
    """

    def __init__(
        self,
        kernel: RowKernel,
        motion: Motion,
        requests: Sequence[Request],
        doubtful: Indices,
    ) -> None:
        self.kernel, self.doubtful, self.requests = kernel, doubtful, requests
        self.careful: list[PoleField] = []
        self._values, self._failed = motion.values.T, motion.failed
        self._odd = motion.failed.copy()
        self._odd[doubtful] = True
        self._parts = slices_of(len(motion.assembly_modes), motion.samples, SLICE)
        self._turned: Sequence[TurnedRows] = ()
        if len(doubtful):
            rows = motion.rows(doubtful)
            pairs = zip(requests, kernel.rates, strict=False)
            self.careful = [_careful(rows, item, at.signed) for item, at in pairs]

    def relative_at(self, number: int, rows: Indices) -> tuple[Floats, Floats, Floats]:
        """Return of an input the directions without a sense, not turned round, at rows.

        With relative angular velocities and their derivatives, each (3, poles, k).
        """
        parts = self.kernel.signed_at(self._values[:, rows])[number]
        unit, turn, rate, change = parts[:3], parts[3:6], parts[6], parts[7]
        with np.errstate(invalid="ignore", over="ignore"):  # of rows found with care
            v, dv = rate * unit, change * unit + rate * turn
        here = np.flatnonzero(np.isin(rows, self.doubtful))
        at = np.searchsorted(self.doubtful, rows[here])
        for field in self.careful[number : number + 1]:
            for k, (i, j) in enumerate(self.kernel.rates[number].signed):
                unit[:, k, here] = field.direction[i, j][at].T
                v[:, k, here] = (field.w[j] - field.w[i])[at].T
                dv[:, k, here] = (field.dw[j] - field.dw[i])[at].T
        return unit, v, dv

    def turn(self, turned: Sequence[TurnedRows], samples: int) -> None:
        """Turn directions round, of modes with so many samples each."""
        self._turned, rows = turned, self.doubtful
        for number, field in enumerate(self.careful):
            for k, pole in enumerate(self.kernel.rates[number].signed):
                unit = field.direction[pole]
                _turn(field, pole, turned[number].signs(k, unit, rows, rows // samples))

    def read(self, keys: Sequence[ColumnKey], reader: Reader) -> None:
        """Have columns read, rows after rows."""
        places = [self.kernel.rates[k].of[name][of] for k, name, of, _ in keys]
        components = [key[-1] for key in keys]
        at = [
            np.broadcast_to(place.numbers[k], SLICE)
            if place.numbers
            else place.first + k * place.step
            for place, k in zip(places, components, strict=True)
        ]

        def take(rows: slice, room: Floats) -> None:
            count = rows.stop - rows.start
            made = [room[x] if isinstance(x, int) else x[:count] for x in at]
            if np.any(self._odd[rows]):
                pairs = zip(keys, made, strict=True)
                made = [self._mended(key, column, rows) for key, column in pairs]
            reader(rows, made)

        self._fill(take)

    def whole(self) -> Floats:
        """Return all that the kernel gives (columns, n)."""
        made = MEMORY.array(self.kernel.kept, len(self._failed))

        def keep(rows: slice, room: Floats) -> None:
            made[:, rows] = room

        self._fill(keep)
        return made

    def all_of(self, number: int, whole: Floats) -> dict[str, dict[Any, Floats]]:
        """Return all parts of an input's field, in `whole` as far as they can be."""
        every = slice(0, len(self._failed))
        made: dict[str, dict[Any, Floats]] = {}
        for name, places in self.kernel.rates[number].of.items():
            made[name] = {}
            for key, place in places.items():
                view = place.of(whole)
                if self.careful or (place.numbers and np.any(self._failed)):
                    mended = (
                        self._mended((number, name, key, k), column, every)
                        for k, column in enumerate(view)
                    )
                    view = np.array(list(mended))
                made[name][key] = view.T if place.count > 1 else view[0]
        return made

    def _fill(self, take: Callable[[slice, Floats], None]) -> None:
        """Hand over all that the kernel gives of rows after rows, turned round."""

        def fill(part: Part) -> None:
            mode, rows = part
            given = np.ascontiguousarray(self._values[:, rows])
            with MEMORY.room(self.kernel.whole.width, given.shape[1]) as room:
                self.kernel.whole(given, room)
                for turned, places in zip(self._turned, self.kernel.rates, strict=False):
                    turned.turn(places.with_sign(room), mode, rows.start)
                failed = self._failed[rows]
                if np.any(failed):
                    room[:, failed] = np.nan
                take(rows, room)

        each_at_once(fill, self._parts, self.kernel.in_threads)

    def _mended(self, key: ColumnKey, column: Floats, rows: slice) -> Floats:
        """Return what the kernel gives of some rows, with those it does not know."""
        number, name, of, k = key
        made = np.where(self._failed[rows], np.nan, column)
        low, high = np.searchsorted(self.doubtful, [rows.start, rows.stop]).tolist()
        if low < high:
            late = getattr(self.careful[number], name)[of]
            at = self.doubtful[low:high] - rows.start
            made[at] = late.reshape(len(late), -1)[low:high, k]
        return made


def _careful(rows: Motion, wanted: Request, signed: Sequence[Pole]) -> PoleField:
    """Return the poles of rows by themselves; rates `signed` not negative."""
    field = found(rows, replace(wanted, planes=frozenset()))
    for pole in signed:
        _turn(field, pole, np.where(field.velocity_coefficient[pole] < 0.0, -1.0, 1.0))
    return field


def _turn(field: PoleField, pole: Pole, signs: Floats) -> None:
    """Turn a pole round at some rows, in place."""
    for name in SIGNED:
        part = getattr(field, name)[pole].T
        part *= signs


@final
class UnreadField:
    """The poles of a motion in which one input moves, as `PoleField` has them.

    Columns are made when they are read: one by one by `column`, or all as arrays where any
    is asked for by its name. A kernel vouches for rows (n,); `errors` are its largest of
    directions, rates and changes, NaN where there are none, `largest` those of all rows.
    `whole` gives all that the kernel gives.
    """

    KNOWN = ("status", "pole_status", "by_equations", "by_kernel", "loss", "planes")

    def __init__(
        self,
        source: KernelColumns,
        number: int,
        motion: Motion,
        vouched: Bools,
        errors: Sequence[float],
        whole: Callable[[], Floats],
    ) -> None:
        self._source, self._number, self._whole = source, number, whole
        wanted = source.requests[number]
        self._places = source.kernel.rates[number].of
        self._is_made = False
        late = source.careful[number] if source.careful else None
        n, rows = len(motion), source.doubtful

        def put(column: Array, name: str, pole: Pole | None = None) -> Array:
            if late is None:
                return column
            values = getattr(late, name)
            made = column.copy()
            made[rows] = values if pole is None else values[pole]
            return made

        loss = np.broadcast_to(0.0, n)
        if np.any(motion.failed):
            loss = np.where(motion.failed, np.nan, 0.0)
        status = put(motion.status, "status")
        alike = {
            pole: late is None or np.array_equal(late.pole_status[pole], late.status)
            for pole in self._places["direction"]
        }
        self._field = PoleField(
            **{name: {} for name in self._places},
            planes=_PlanesWhenRead(wanted, motion),
            status=status,
            pole_status={
                pole: status if alike[pole] else put(status, "pole_status", pole)
                for pole in alike
            },
            by_equations=put(np.broadcast_to(False, n), "by_equations"),
            by_kernel=vouched,
            loss=put(loss, "loss"),
        )
        for pole in wanted.poles:
            if pole not in alike:
                add_locked(self._field, motion, pole)
        self.largest = dict(zip(ERRORS, errors, strict=True))
        if late is not None:
            well = late.status == Status.OK
            for name in ERRORS:
                every = np.hstack([bound[well] for bound in getattr(late, name).values()])
                finite = every[np.isfinite(every)]
                self.largest[name] = np.fmax.reduce([self.largest[name], *finite])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._field if name in self.KNOWN else self.made, name)

    @property
    def made(self) -> PoleField:
        """All of it, as arrays."""
        if not self._is_made:
            self._is_made = True
            for part, made in self._source.all_of(self._number, self._whole()).items():
                getattr(self._field, part).update(made)
        return self._field

    def column(self, name: str, pole: Pole, k: int) -> Unread | Floats:
        """Return a component of a part (n,), which is made when it is read."""
        if pole in self._places.get(name, {}):
            key = self._number, name, pole, k
            return Unread(self._source, key, len(self._field.status))
        part: Floats = getattr(self._field, name)[pole]
        return part.reshape(len(part), -1)[:, k]


@final
class _PlanesWhenRead(dict[Pole, Floats]):
    """The great circles of poles, drawn when they are first read."""

    def __init__(self, wanted: Request, motion: Motion) -> None:
        super().__init__()
        self._wanted, self._motion = wanted, motion

    def __missing__(self, pole: Pole) -> Floats:
        self[pole] = nans((len(self._motion), 2, 3))
        if pole in self._wanted.planes:
            self[pole] = PlannedPoles(self._wanted.plan, self._motion).circles(pole)
        return self[pole]
