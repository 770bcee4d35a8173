"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `Tracer` and `evaluate`, as without it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import in_turn
from spherekit.analysis.running.kernel_columns import (
    MEMORY,
    SLICE,
    KernelColumns,
    Numbers,
    UnreadField,
    slices_of,
)
from spherekit.analysis.running.row_block import Positions, Rows, stops_of
from spherekit.analysis.running.sampling import Sampling
from spherekit.conventions import Status
from spherekit.engine.compiler import available
from spherekit.engine.row_kernel import RowKernel, row_kernel
from spherekit.motion.motion import Motion
from spherekit.rates.request import Request
from spherekit.rates.signs import (
    SignMemory,
    Stops,
    TurnedRows,
    sides_of,
    signs_at_stops,
)

FEWEST = 1 << 14
"""With fewer rows than this a kernel is not made."""
MANY = 1 << 19
"""From so many rows on it is compiled, where heyoka is installed."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 27
"""Of columns in a block, at most."""
JUDGED = 1 << 19
"""Numbers that decide about the rows of a slice: they stay in the cache."""
MORE = 32
"""Blocks have so many times the rows of those without a kernel, at most."""


@final
@dataclass(frozen=True)
class _Block:
    """What was found of a block: its `rows`, and by input where directions are looked at.

    `held` (modes, samples) are the rows with a configuration, `doubtful` (k,) those of
    them that the kernel does not vouch for. `errors` are the largest by input: of
    directions, rates and changes, NaN where nothing is vouched for.
    """

    rows: Rows
    held: NDArray[np.bool_]
    doubtful: Numbers
    stops: Sequence[Mapping[int, Stops]]
    errors: NDArray[np.float64]


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
    _found: dict[int, _Block] = field(default_factory=dict, repr=False)

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
    def block(self) -> int:
        """Samples in a block; where they are recorded, as many as without a kernel."""
        tracer = self.course.tracer
        if self.with_planes:
            return tracer.block
        many = BYTES // (8 * self.kernel.kept * len(tracer.assembly_modes))
        return max(1, min(many, MORE * tracer.block))

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples."""
        whole = len(self.course)
        starts = range(first, whole, size)
        samples = (np.arange(start, min(start + size, whole)) for start in starts)
        yield from in_turn(self.motion_at, samples, self.looks_ahead)

    def has_found(self, motion: Motion) -> bool:
        """Return whether a motion is one that was found, whose poles were not asked."""
        return id(motion) in self._found

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[UnreadField, ...]:
        """Return the poles of a motion that was found, for each input that moves.

        They are made when they are read.
        """
        block = self._found.pop(id(motion))
        asked = self.requests[: len(memories)]
        columns = KernelColumns(self.kernel, motion, asked, block.doubtful)
        columns.turn(
            [
                self._signs(motion, block, columns, number, memory)
                for number, memory in enumerate(memories[: len(asked)])
            ],
            motion.samples,
        )
        whole = cache(columns.whole)
        fields = tuple(
            UnreadField(columns, k, motion, block.rows.vouched, errors, whole)
            for k, errors in enumerate(block.errors[: len(asked)].tolist())
        )
        for made, wanted in zip(fields, asked, strict=True):
            for pole in wanted.planes if self.with_planes else ():
                _ = made.planes[pole]
        return fields

    def _signs(
        self,
        motion: Motion,
        block: _Block,
        columns: KernelColumns,
        number: int,
        memory: SignMemory,
    ) -> TurnedRows:
        """Return which directions of an input are turned round."""
        if not motion.is_path:
            return sides_of(motion, block.held, memory)
        signed = self.kernel.rates[number].signed
        at = partial(columns.relative_at, number)
        return signs_at_stops(motion, signed, block.stops[number], at, memory)

    def motion_at(self, samples: Numbers) -> Motion:
        """Return the motion at some samples, by their numbers."""
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        whole = count == int(samples[-1]) - int(samples[0]) + 1
        chosen = slice(int(samples[0]), int(samples[-1]) + 1) if whole else samples
        q = np.ascontiguousarray(tracer.input_grid.q[chosen].T)
        rows = Rows(self.kernel, self.positions, q)
        values = rows.values.reshape(-1, modes, count)
        if whole:
            self.positions.read(int(samples[0]), int(samples[-1]) + 1, values)
        else:
            for k, sample in enumerate(samples.tolist()):
                self.positions.read(sample, sample + 1, values[:, :, k : k + 1])
        width = self.positions.deciding.width
        # So many that little is left to do between.
        parts = slices_of(modes, count, max(1, round(JUDGED / (width * SLICE))) * SLICE)
        seen = rows.fill(parts)
        late = np.flatnonzero(~rows.vouched & (rows.status == Status.OK))
        if len(late):
            self._with_care(rows, samples, late)
            seen = [
                None if np.any((late >= some.start) & (late < some.stop)) else here
                for here, (_, some) in zip(seen, parts, strict=True)
            ]
        failed = (rows.status != Status.OK) & (rows.status != Status.AT_SINGULARITY)
        rows.leave_out(failed)
        rows.vouched &= rows.status == Status.OK
        doubtful = np.flatnonzero(~(rows.vouched | failed))
        timing = course.timing if self.with_times else None
        named = MEMORY.array(2 + len(q), modes * count)
        number, mode = named[0].view(np.int64), named[1].view(np.int64)
        for k, item in enumerate(tracer.assembly_modes):
            of_mode = slice(k * count, (k + 1) * count)
            number[of_mode], mode[of_mode], named[2:, of_mode] = samples, item.number, q
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=number,
            assembly_mode=mode,
            inputs=named[2:].T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.closure[0],
            is_path=tracer.input_grid.is_path,
            timing=None if timing is None else timing.rows(chosen).repeated(modes),
        )
        if len(doubtful):
            rows.closure[1, doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = rows.closure[1]
        stops: Sequence[Mapping[int, Stops]] = ()
        looked, held = rows.looked_through(seen, parts), ~failed.reshape(modes, count)
        if motion.is_path:
            every = range(len(self.requests))
            stops = [stops_of(looked, k, held, doubtful) for k in every]
        errors = [np.full((len(self.requests), 3), np.nan)]
        errors += map(np.array, [*(here.errors for _, here in looked), *rows.late])
        block = _Block(rows, held, doubtful, stops, np.fmax.reduce(np.array(errors)))
        self._found[id(motion)] = block
        return motion

    def _with_care(self, rows: Rows, samples: Numbers, late: Numbers) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer, count = self.course.tracer, len(samples)
        residual = np.empty(len(late))
        for number, mode in enumerate(tracer.assembly_modes):
            of_mode = late // count == number
            if not np.any(of_mode):
                continue
            at = late[of_mode]
            wanted = samples[at - number * count]
            evaluated = tracer.solver.evaluate(mode, tracer.input_grid.q[wanted], wanted)
            rows.values[:, at] = evaluated.values.T
            rows.status[at], residual[of_mode] = evaluated.status, evaluated.residual
        closed = np.isfinite(residual)
        rows.put(late[closed], residual[closed])
        rows.closure[0, late[~closed]] = np.nan
