"""Poles of a block by a kernel, of which nothing is made until it is read."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.numerics.lazy_columns import LazyColumn, Reader, put
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.runs.prefetch import each_at_once
from spherekit.status import Status
from spherekit.velocities.direction_signs import SignFunction, apply_signs
from spherekit.velocities.pole_evaluation import add_locked_pole, evaluate_unsigned
from spherekit.velocities.pole_field import REPORTED_ERRORS, PoleField
from spherekit.velocities.pole_request import Request
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.velocities.row_kernel import RowKernel

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""
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


class ComputedColumns:
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
        self.was_read = False
        self._values = motion.values.T
        self._failed = motion.failed
        self._odd = motion.failed.copy()
        self._odd[doubtful] = True
        self._parts = slices_of(len(motion.assembly_modes), motion.samples, SLICE)
        self._turned: Sequence[SignFunction] = ()
        if len(doubtful):
            rows = motion.rows(doubtful)
            for wanted, at in zip(requests, kernel.input_columns, strict=True):
                late = evaluate_unsigned(rows, replace(wanted, planes=frozenset()))
                for pole in at.signed_poles:
                    turned = np.where(late.velocity_coefficient[pole] < 0.0, -1.0, 1.0)
                    apply_signs(late, pole, turned)
                self.careful.append(late)

    def relative_at(self, number: int, rows: Indices) -> tuple[Floats, Floats, Floats]:
        """Return of an input the directions without a sense, not turned round, at rows.

        With relative angular velocities and their derivatives, each (3, poles, k).
        """
        parts = self.kernel.input_columns[number].signed_part(
            self.kernel.all_columns(self._values[:, rows])
        )
        unit, turn, (rate, change) = np.split(parts, [3, 6])
        with np.errstate(invalid="ignore", over="ignore"):  # of rows found with care
            v = rate * unit
            dv = change * unit + rate * turn
        here = np.flatnonzero(np.isin(rows, self.doubtful))
        at = np.searchsorted(self.doubtful, rows[here])
        for k, (i, j) in enumerate(
            self.kernel.input_columns[number].signed_poles if len(here) else ()
        ):
            field = self.careful[number]
            unit[:, k, here] = field.direction[i, j][at].T
            v[:, k, here] = (field.w[j] - field.w[i])[at].T
            dv[:, k, here] = (field.dw[j] - field.dw[i])[at].T
        return unit, v, dv

    def turn(self, turned: Sequence[SignFunction], samples: int) -> None:
        """Turn directions round, of modes with so many samples each."""
        self._turned = turned
        rows = self.doubtful
        for number, field in enumerate(self.careful):
            poles = self.kernel.input_columns[number].signed_poles
            unit = np.array([field.direction[pole].T for pole in poles])
            unit = unit.reshape(-1, 3, len(rows)).swapaxes(0, 1)
            for pole, of_pole in zip(
                poles, turned[number](unit, rows, rows // samples), strict=True
            ):
                apply_signs(field, pole, of_pole)

    def read(self, keys: Sequence[ColumnKey], reader: Reader) -> None:
        """Have columns read, rows after rows."""
        self.was_read = True
        places = [
            self.kernel.input_columns[k].column_indices[name][of][c]
            for k, name, of, c in keys
        ]

        def fill(part: Part) -> None:
            mode, rows = part
            given = np.ascontiguousarray(self._values[:, rows])
            whole = np.empty((self.kernel.all_columns.width, given.shape[1]))
            self.kernel.all_columns(given, whole)
            for turned, at in zip(self._turned, self.kernel.input_columns, strict=False):
                signed = at.signed_part(whole)
                signs = turned(signed[:3], rows, mode)
                for k in np.flatnonzero(np.any(signs < 0, axis=1)):
                    signed[:, k] *= signs[k]
            made = [whole[place] for place in places]
            if np.any(self._odd[rows]):
                made = [
                    self._mended(key, column, rows)
                    for key, column in zip(keys, made, strict=True)
                ]
            reader(rows, made)

        each_at_once(fill, self._parts, self.kernel.is_compiled)

    def _mended(self, key: ColumnKey, column: Floats, rows: slice) -> Floats:
        """Return what the kernel gives of some rows, with those it does not know."""
        number, name, of, k = key
        made = np.where(self._failed[rows], np.nan, column)
        low, high = np.searchsorted(self.doubtful, [rows.start, rows.stop])
        if low < high:
            late = getattr(self.careful[number], name)[of].reshape(len(self.doubtful), -1)
            made[self.doubtful[low:high] - rows.start] = late[low:high, k]
        return made


class LazyField:
    """The poles of a motion in which one input moves, as `PoleField` has them.

    Columns are made when they are read: one by one by `column`, or all as arrays where any
    is asked for by its name. A kernel vouches for rows (n,); `errors` are its largest of
    directions, rates and changes, NaN where there are none, `largest` those of all rows.
    """

    KNOWN = (
        "status",
        "pole_status",
        "is_quad_precision",
        "is_certified",
        "is_decimal",
        "relative_error_bound",
    )

    def __init__(
        self,
        source: ComputedColumns,
        number: int,
        motion: Motion,
        vouched: Bools,
        errors: Sequence[float],
    ) -> None:
        self._source, self._number, self._motion = source, number, motion
        self._places = source.kernel.input_columns[number].column_indices
        wanted = source.requests[number]
        rows = source.doubtful
        n = len(motion)
        self.largest = dict(zip(REPORTED_ERRORS, errors, strict=True))
        status = motion.status
        is_quad_precision, is_decimal = np.zeros((2, n), dtype=bool)
        relative_error_bound = np.where(motion.failed, np.nan, 0.0)
        pole_status = dict.fromkeys(self._places["direction"], status)
        for late in source.careful[number : number + 1]:
            status = _with(status, rows, late.status)
            relative_error_bound[rows] = late.relative_error_bound
            is_quad_precision[rows] = late.is_quad_precision
            is_decimal[rows] = late.is_decimal
            for pole in pole_status:
                pole_status[pole] = _with(status, rows, late.pole_status[pole])
            for name, error in largest_errors(late).items():
                self.largest[name] = np.fmax(self.largest[name], error)
        self._field = PoleField(
            **{name: {} for name in self._places},
            status=status,
            pole_status=pole_status,
            is_quad_precision=is_quad_precision,
            is_certified=vouched,
            is_decimal=is_decimal,
            relative_error_bound=relative_error_bound,
        )
        for pole in set(wanted.poles) - pole_status.keys():
            add_locked_pole(self._field, motion, pole)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._field if name in self.KNOWN else self.as_arrays, name)

    @cached_property
    def as_arrays(self) -> PoleField:
        """All of it, as arrays."""
        n = len(self._field.status)
        columns: list[tuple[LazyColumn, Floats]] = []
        for name, places in self._places.items():
            for of, place in places.items():
                made = np.empty((len(place), n))
                for k, out in enumerate(made):
                    key = self._number, name, of, k
                    columns.append((LazyColumn(self._source, key, n), out))
                getattr(self._field, name)[of] = made.T if len(made) > 1 else made[0]
        put(columns, [(slice(0, n), 0)])
        wanted = self._source.requests[self._number]
        drawn = PlannedPoles(wanted.plan, self._motion)
        self._field.planes.update({x: drawn.great_circles(x) for x in wanted.planes})
        return self._field

    def column(self, name: str, pole: Pole, k: int) -> LazyColumn | Floats:
        """Return a component of a part (n,), which is made when it is read."""
        if pole in self._places.get(name, {}):
            return LazyColumn(
                self._source, (self._number, name, pole, k), len(self._field.status)
            )
        part: Floats = getattr(self._field, name)[pole]
        return part.reshape(len(part), -1)[:, k]


def largest_errors(field: PoleField) -> dict[str, float]:
    """Return the largest finite `REPORTED_ERRORS` of rows that are well, by name."""
    well = field.status == Status.OK
    return {
        name: max(
            (
                np.max(bound, initial=-np.inf, where=well & np.isfinite(bound))
                for bound in getattr(field, name).values()
            ),
            default=-np.inf,
        )
        for name in REPORTED_ERRORS
    }


def _with(codes: SmallIntegers, rows: Indices, some: SmallIntegers) -> SmallIntegers:
    """Return codes (n,) with those of some rows."""
    made = codes.copy()
    made[rows] = some
    return made
