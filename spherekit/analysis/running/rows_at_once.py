"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `Tracer` and `evaluate`, as without it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import in_turn
from spherekit.analysis.running.made_columns import SLICE, MadeColumns
from spherekit.analysis.running.positions import Positions
from spherekit.analysis.running.reversals import (
    Numbers,
    Seen,
    largest_errors,
    numbered,
    stops_of,
)
from spherekit.analysis.running.row_block import Part, Rows, named_of, parts_of
from spherekit.analysis.running.sampling import Sampling
from spherekit.conventions import Status
from spherekit.engine.compiler import available
from spherekit.engine.row_kernel import RowFunction, RowKernel, row_kernel
from spherekit.motion.motion import Motion
from spherekit.numeric.lent_memory import LentMemory, Reader, Refilled, Template
from spherekit.rates.columns import Gaps
from spherekit.rates.from_columns import CarefulRows, field_unread
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.signs import (
    SignMemory,
    Stops,
    TurnedRows,
    sides_of,
    signs_at_stops,
)
from spherekit.rates.unread_columns import ShownColumns, UnreadColumns
from spherekit.sphere.rotation import Floats

FEWEST = 1 << 14
"""With fewer rows than this a kernel is not made."""
MANY = 1 << 19
"""From so many rows on it is compiled, where heyoka is installed."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 27
"""Of columns in a block, at most; of what they follow from, where they are not made."""
JUDGED = 1 << 19
"""Numbers that decide about the rows of a slice: they stay in the cache."""
GROWTH = 8
"""Times that a block grows at most: an analysis may begin to read arrays late."""
PROBE = 16
"""Part of a block that the first one is."""
MORE = 32
"""Blocks have so many times the rows of those without a kernel, at most."""


MEMORY = LentMemory()
"""What blocks are in, of this run and the next."""


@final
@dataclass(frozen=True)
class _Block:
    """What was found of a block: its `rows`, and by input where directions are looked at.

    `held` (modes, samples) are the rows with a configuration, `doubtful` (k,) those of
    them that the kernel does not vouch for. `errors` are the largest of slices and of rows
    after them.
    """

    rows: Rows
    held: NDArray[np.bool_]
    doubtful: Numbers
    stops: Sequence[Mapping[int, Stops]]
    errors: Sequence[tuple[tuple[float, ...], ...]]


@final
@dataclass
class RowsAtOnce:
    """The rows of a course by a kernel.

    Configurations that `positions` does not know are those of the tracer.
    """

    course: Sampling
    requests: tuple[Request, ...]
    kernel: RowKernel
    positions: Positions
    with_planes: bool
    looks_ahead: bool
    with_times: bool

    def __post_init__(self) -> None:
        self._found: dict[int, _Block] = {}
        self._left: Refilled | None = None
        self._was_read = False
        self._of_modes = np.empty(0, dtype=np.int64)
        self._shown: dict[tuple[bool, tuple[int, int]], list[ShownColumns]] = {}

    @classmethod
    def of(
        cls,
        course: Sampling,
        requests: Sequence[Request],
        with_planes: bool,
        looks_ahead: bool = False,
        with_times: bool = True,
    ) -> "RowsAtOnce | None":
        """Return it, None where rows are few or the terms do not hold.

        Where it `looks_ahead`, a block is found while the one before is made use of; the
        tracer is then for it alone. Motions come `with_times` where they have any.
        """
        tracer = course.tracer
        rows = len(course) * len(tracer.assembly_modes)
        if course.simulation is not None or rows < FEWEST:
            return None
        engine: Literal["numpy", "compiled"]
        engine = "compiled" if rows >= MANY and available() else "numpy"
        made = row_kernel(tracer.sparse(REFERENCES), requests, engine)
        if made is None:
            return None
        positions = Positions.of(tracer, made)
        wanted = tuple(requests)
        return cls(course, wanted, made, positions, with_planes, looks_ahead, with_times)

    @property
    def _slice(self) -> int:
        """Rows that are judged at once: so many that little is left to do between."""
        return max(1, round(JUDGED / (self._deciding.width * SLICE))) * SLICE

    @property
    def _deciding(self) -> RowFunction:
        """What decides about rows: by inputs, or of variables that were read."""
        return self.kernel.by_inputs if self.positions.by_inputs else self.kernel.judging

    @property
    def block(self) -> int:
        """Samples in a block; where they are recorded, as many as without a kernel."""
        tracer = self.course.tracer
        if self.with_planes:
            return tracer.block
        many = BYTES // (8 * self.kernel.kept * len(tracer.assembly_modes))
        return max(1, min(many, MORE * tracer.block))

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples.

        Of `size`, unless that is the ordinary one: then they grow while all columns are
        left to be made when they are read, which a small one tells that comes first.
        """
        ordinary = size == self.block and not self.with_planes
        start, whole = first, len(self.course)
        if ordinary and first == 0 and whole > size:
            start = -(-size // PROBE)
            yield self._motion(range(start))

        def blocks() -> Iterator[range]:
            stop = start
            while stop < whole:
                before = stop
                grows = ordinary and self._left is not None and not self._is_read
                stop = min(before + (self._grown if grows else size), whole)
                yield range(before, stop)

        yield from in_turn(self._motion, blocks(), self.looks_ahead)

    @property
    def _is_read(self) -> bool:
        """Whether all columns of a block were made at once, for arrays or files."""
        self._was_read |= self._left is not None and self._left.was_read
        return self._was_read

    @property
    def _grown(self) -> int:
        """Samples in a block of which only what columns follow from is kept."""
        tracer = self.course.tracer
        kept = len(tracer.mechanism.variable_owners) + len(tracer.inputs) + 3
        most = BYTES // (8 * kept * len(tracer.assembly_modes))
        return max(self.block, min(most, GROWTH * self.block))

    def motion_at(self, samples: NDArray[np.intp]) -> Motion:
        """Return the motion at some samples, by their numbers."""
        return self._motion(samples)

    def has_found(self, motion: Motion) -> bool:
        """Return whether a motion is one that was found, whose poles were not asked."""
        return id(motion) in self._found

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[PoleField, ...]:
        """Return the poles of a motion that was found, for each input that moves.

        They are made when they are read.
        """
        block = self._found.pop(id(motion))
        rows, doubtful = block.rows, block.doubtful
        asked = self.requests[: len(memories)]
        made = (CarefulRows.of(motion, wanted, doubtful) for wanted in asked)
        careful = tuple(item for item in made if item is not None)
        columns = MadeColumns(
            self.kernel,
            rows.values,
            parts_of(len(motion.assembly_modes), motion.samples, SLICE),
            MEMORY,
            rows.careful,
            rows.closure[:, rows.careful],
            careful,
        )
        columns.turned = [
            self._signs(motion, block, columns, number, memory)
            for number, memory in enumerate(memories[: len(asked)])
        ]
        self._left = left = columns.refilled()
        left.fills(rows.closure, columns.closure_row)
        shown = self._shown_of(columns, left.shape)
        gaps = Gaps(np.flatnonzero(motion.failed), MEMORY)
        fields = []
        for number, wanted in enumerate(asked):
            fields.append(
                field_unread(
                    motion,
                    wanted,
                    UnreadColumns(left, shown[number], partial(columns.read, number), gaps),
                    rows.vouched,
                    largest_errors(block.errors, number),
                    careful[number] if careful else None,
                )
            )
            for pole in wanted.planes if self.with_planes else ():
                _ = fields[-1].planes[pole]
        return tuple(fields)

    def _shown_of(self, columns: MadeColumns, shape: tuple[int, int]) -> list[ShownColumns]:
        """Return what columns of a shape look like, by input."""
        key = bool(columns.careful), shape
        if key not in self._shown:
            template = Template(*shape)
            self._shown[key] = [
                ShownColumns(template, columns.read(k, template.unmade))
                for k in range(len(columns.places))
            ]
        return self._shown[key]

    def _signs(
        self,
        motion: Motion,
        block: _Block,
        columns: MadeColumns,
        number: int,
        memory: SignMemory,
    ) -> TurnedRows:
        """Return which directions of an input are turned round."""
        if not motion.is_path:
            return sides_of(motion, block.held, memory)
        signed = columns.places[number].signed
        at = partial(columns.relative_at, number)
        return signs_at_stops(motion, signed, block.stops[number], at, memory)

    def _named(self, rows: Rows, count: int) -> Floats:
        """Return an array for the numbers of samples and the inputs of rows.

        It is filled with them, and made again when it is read.
        """
        modes, (inputs, _) = len(self.course.tracer.assembly_modes), rows.q.shape
        samples, q, shape = rows.samples, rows.q, (1 + inputs, modes * count)

        def pieces(reader: Reader) -> None:
            again = named_of(samples, q)
            for mode in range(modes):
                reader(slice(mode * count, (mode + 1) * count), again)

        Refilled(MEMORY, shape, pieces).fills(rows.named)
        return rows.named

    def _modes(self, count: int) -> NDArray[np.int64]:
        """Return the numbers of the modes of so many samples each, by row."""
        if len(self._of_modes) != count * len(self.course.tracer.assembly_modes):
            numbers = [mode.number for mode in self.course.tracer.assembly_modes]
            made = MEMORY.array(1, count * len(numbers))[0].view(np.int64)
            made.reshape(-1, count)[:] = np.array(numbers)[:, None]
            self._of_modes = made
        return self._of_modes

    def _motion(self, samples: Numbers | range) -> Motion:
        """Return the motion at samples, by their numbers."""
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        n, chosen = modes * count, _chosen(samples)
        values = MEMORY.array(len(tracer.mechanism.variable_owners), n)
        rows = Rows(
            self.kernel,
            self._deciding,
            self.positions,
            samples,
            np.ascontiguousarray(tracer.input_grid.q[chosen].T),
            values,
            MEMORY.array(2, n),
            MEMORY.array(1 + len(tracer.inputs), n),
            MEMORY,
        )
        self._read(chosen, values.reshape(-1, modes, count))
        parts = parts_of(modes, count, self._slice)
        seen = rows.fill(parts)
        held, doubtful = np.broadcast_to(True, (modes, count)), np.empty(0, dtype=np.intp)
        if not rows.is_whole:
            rest = np.flatnonzero(~rows.vouched & (rows.status == Status.OK))
            if len(rest):
                self._with_care(rows, samples, rest)
                seen = _without(seen, parts, rest)
            failed = (rows.status != Status.OK) & (rows.status != Status.AT_SINGULARITY)
            rows.leave_out(failed)
            rows.vouched &= rows.status == Status.OK
            doubtful = np.flatnonzero(~(rows.vouched | failed))
            held = ~failed.reshape(modes, count)
        timing = course.timing if self.with_times else None
        if timing is not None:
            timing = timing.rows(chosen).repeated(modes)
        named = self._named(rows, count)
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=named[0].view(np.int64),
            assembly_mode=self._modes(count),
            inputs=named[1:].T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.residual,
            is_path=tracer.input_grid.is_path,
            timing=timing,
        )
        if len(doubtful):
            rows.off[doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = rows.off
        stops: Sequence[Mapping[int, Stops]] = ()
        looked = rows.looked_through(seen, parts)
        if motion.is_path:
            every = range(len(self.requests))
            stops = [stops_of(looked, k, held, doubtful) for k in every]
        errors = [here.errors for _, here in looked] + rows.late
        self._found[id(motion)] = _Block(rows, held, doubtful, stops, errors)
        return motion

    def _read(self, chosen: slice | NDArray[np.intp], out: Floats) -> None:
        """Write what is read of samples (variables, modes, samples) between nodes."""
        if isinstance(chosen, slice):
            self.positions.read(chosen.start, chosen.stop, out)
            return
        for k, sample in enumerate(chosen.tolist()):
            self.positions.read(sample, sample + 1, out[:, :, k : k + 1])

    def _with_care(
        self,
        rows: Rows,
        samples: Numbers | range,
        rest: Numbers,
    ) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer, count = self.course.tracer, len(samples)
        residual = np.empty(len(rest))
        for number, mode in enumerate(tracer.assembly_modes):
            of_mode = rest // count == number
            if not np.any(of_mode):
                continue
            at = rest[of_mode]
            wanted = numbered(samples, at - number * count)
            evaluated = tracer.solver.evaluate(mode, tracer.input_grid.q[wanted], wanted)
            rows.values[:, at] = evaluated.values.T
            rows.status[at], residual[of_mode] = evaluated.status, evaluated.residual
        closed = np.isfinite(residual)
        rows.put(rest[closed], residual[closed])
        rows.residual[rest[~closed]] = np.nan


def _chosen(samples: Numbers | range) -> slice | Numbers:
    """Return what chooses samples, by their numbers: a slice where they are successive."""
    first, last = int(samples[0]), int(samples[-1])
    successive = last - first == len(samples) - 1
    if isinstance(samples, range) or (successive and np.all(np.diff(samples) == 1)):
        return slice(first, last + 1)
    return samples


def _without(
    seen: Sequence[Seen | None], parts: Sequence[Part], late: Numbers
) -> list[Seen | None]:
    """Return what was seen of parts, forgotten of those with rows that were found late."""
    return [
        None if np.any((late >= rows.start) & (late < rows.stop)) else here
        for here, (_, rows) in zip(seen, parts, strict=True)
    ]
