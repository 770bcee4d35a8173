"""All columns of a block of rows, made when they are read, as often as that is."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import final

import numpy as np

from spherekit.analysis.running.in_turn import each_at_once
from spherekit.analysis.running.reversals import Numbers
from spherekit.analysis.running.row_block import Part
from spherekit.engine.columns import RatePlaces
from spherekit.engine.row_kernel import RowKernel, read_columns, signed_columns
from spherekit.numeric.lent_memory import LentMemory, Reader, Refilled
from spherekit.rates.columns import RateColumns
from spherekit.rates.from_columns import CarefulRows
from spherekit.rates.signs import TurnedRows
from spherekit.sphere.rotation import Floats

SLICE = 8184
"""Rows of a slice: no power of two, for columns would then share the lines of the cache."""


@final
@dataclass
class MadeColumns:
    """The columns of a block's rows by a kernel, from their `values` (variables, n).

    By assembly mode, then sample, in `parts`. Rows where `values` are NaN have none.
    `careful` are, by input, the poles of the rows that the kernel does not vouch for; as
    what is alike of others need not be so there, columns are then parted. Of the rows
    `given` the closure (2, k) is known, see `Rows`. `turned` says by input which directions
    are turned round.
    """

    kernel: RowKernel
    values: Floats
    parts: Sequence[Part]
    memory: LentMemory
    given: Numbers
    closure: Floats
    careful: Sequence[CarefulRows] = ()
    turned: list[TurnedRows] = field(default_factory=list)

    @cached_property
    def places(self) -> tuple[RatePlaces, ...]:
        """Where the columns of each input are."""
        return self.kernel.parted.rates if self.careful else self.kernel.rates

    @property
    def closure_row(self) -> int:
        """Which of the columns is the first of the closure."""
        return self.kernel.parted.closure if self.careful else self.kernel.closure

    @property
    def count(self) -> int:
        """How many columns there are."""
        return len(self.kernel.parted.column) if self.careful else self.kernel.kept

    @cached_property
    def _careful(self) -> Floats:
        """The columns (columns, k) of rows that were found with care."""
        made = np.zeros((self.count, len(self.careful[0].rows)))
        for number, careful in enumerate(self.careful):
            careful.write(self.read(number, made), self.places[number].signed)
        return made

    def read(self, number: int, columns: Floats) -> RateColumns:
        """Return the rates of an input, as views of all columns."""
        return read_columns(self.places[number], columns)

    def relative_at(self, number: int, rows: Numbers) -> tuple[Floats, Floats, Floats]:
        """Return of an input the directions without a sense, not turned round, at rows.

        With relative angular velocities and their derivatives, each (3, poles, k).
        """
        parts = self.kernel.signed_at(self.values[:, rows])[number]
        unit, turn, rate, change = parts[:3], parts[3:6], parts[6], parts[7]
        with np.errstate(invalid="ignore", over="ignore"):  # of rows found with care
            v, dv = rate * unit, change * unit + rate * turn
        for careful in self.careful[number : number + 1]:
            at = np.searchsorted(careful.rows, rows)
            here = np.flatnonzero(np.isin(rows, careful.rows))
            late = signed_columns(self.places[number], self._careful[:, at[here]])
            unit[..., here] = late[:3]
            for k, pole in enumerate(self.places[number].signed):
                v[:, k, here], dv[:, k, here] = careful.relative(pole, at[here])
        return unit, v, dv

    def refilled(self) -> Refilled:
        """Return them as an array (columns, n), not made yet."""
        return Refilled(self.memory, (self.count, self.values.shape[1]), self._pieces)

    def _pieces(self, reader: Reader) -> None:
        whole, parted = self.kernel.whole, self.kernel.parted

        def fill(part: Part) -> None:
            rows = part[1]
            given = np.ascontiguousarray(self.values[:, rows])
            with self.memory.room(whole.width, given.shape[1]) as room:
                whole(given, room)
                if not self.careful:
                    reader(rows, self._finished(room, given, part))
                    return
                with self.memory.room(self.count, given.shape[1]) as apart:
                    parted.fill(room, apart)
                    reader(rows, self._finished(apart, given, part))

        each_at_once(fill, self.parts, self.kernel.in_threads)

    def _finished(self, columns: Floats, values: Floats, part: Part) -> Floats:
        """Return the columns of a part with what the kernel does not know, in place."""
        mode, rows = part
        for careful in self.careful[:1]:
            here = (careful.rows >= rows.start) & (careful.rows < rows.stop)
            columns[:, careful.rows[here] - rows.start] = self._careful[:, here]
        here = (self.given >= rows.start) & (self.given < rows.stop)
        of_closure = slice(self.closure_row, self.closure_row + 2)
        columns[of_closure, self.given[here] - rows.start] = self.closure[:, here]
        for number, turned in enumerate(self.turned):
            turned.turn(signed_columns(self.places[number], columns), mode, rows.start)
        empty = np.flatnonzero(np.isnan(values[0]))
        if len(empty):
            columns[:, empty] = np.nan
        return columns
