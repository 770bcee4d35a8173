"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `Tracer` and `evaluate`, as without it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import in_turn
from spherekit.analysis.running.positions import Positions
from spherekit.analysis.running.row_block import (
    SLICE,
    Part,
    Rooms,
    Rows,
    Seen,
    largest_errors,
    steady,
)
from spherekit.analysis.running.sampling import Sampling
from spherekit.conventions import Status
from spherekit.engine.compiler import available
from spherekit.engine.row_kernel import RowKernel, row_kernel
from spherekit.motion.motion import Motion
from spherekit.numeric.lent_memory import LentMemory, Reader, Refilled, Template
from spherekit.rates.columns import Gaps, RateColumns
from spherekit.rates.from_columns import field_of_columns, field_unread
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.signs import SignMemory, steady_signs
from spherekit.rates.unread_columns import UnreadColumns
from spherekit.sphere.rotation import Floats

FEWEST = 1 << 14
"""With fewer rows than this a kernel is not made."""
MANY = 1 << 19
"""From so many rows on it is compiled, where heyoka is installed."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 27
"""Of columns in a block, at most."""
MORE = 16
"""Blocks have so many times the rows of those without a kernel, at most."""


@final
@dataclass(frozen=True)
class _Block:
    """What was found of a block: its `rows` in `parts`, and which inputs are `steady`.

    `seen` is what was seen of the parts while they were filled.
    """

    samples: NDArray[np.intp]
    rows: Rows
    parts: Sequence[Part]
    seen: Sequence[Seen]
    steady: Sequence[bool]


@final
@dataclass
class RowsAtOnce:
    """The rows of a course by a kernel, run by `engine`.

    Configurations that `positions` does not know are those of the tracer.
    """

    course: Sampling
    requests: tuple[Request, ...]
    kernel: RowKernel
    positions: Positions
    engine: Literal["numpy", "compiled"]
    with_planes: bool
    looks_ahead: bool
    with_times: bool

    def __post_init__(self) -> None:
        self._found: dict[int, _Block] = {}
        modes = len(self.course.tracer.assembly_modes)
        rates = self.kernel.rates
        self._rooms = Rooms()
        self._columns, self._values, self._gaps = (LentMemory() for _ in range(3))
        self._residuals, self._off, self._numbers = (LentMemory() for _ in range(3))
        # Expected from the block before: then nothing has to be turned round later.
        self._senses = [np.ones((modes, len(places.signed))) for places in rates]
        self._left: Refilled | None = None
        self._is_read, self._is_doubtful = self.with_planes, False
        self._template: tuple[Template, list[RateColumns]] | None = None

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
        positions = Positions.of(tracer, engine)
        wanted = tuple(requests)
        return cls(
            course, wanted, made, positions, engine, with_planes, looks_ahead, with_times
        )

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

        def block(start: int) -> Motion:
            return self._motion(np.arange(start, min(start + size, whole)))

        yield from in_turn(block, range(first, whole, size), self.looks_ahead)

    def motion_at(self, samples: NDArray[np.intp]) -> Motion:
        """Return the motion at some samples, by their numbers."""
        return self._motion(samples)

    def has_found(self, motion: Motion) -> bool:
        """Return whether a motion is one that was found, whose poles were not asked."""
        return id(motion) in self._found

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[PoleField, ...]:
        """Return the poles of a motion that was found, for each input that moves."""
        block = self._found.pop(id(motion))
        if block.rows.columns is None:
            return self._unread(motion, block, memories)
        rates = self.kernel.read(block.rows.columns)
        fields = []
        for number, (wanted, columns, memory) in enumerate(
            zip(self.requests, rates, memories, strict=False)
        ):
            field = field_of_columns(
                motion,
                wanted,
                columns,
                block.rows.vouched,
                memory,
                self.with_planes,
                block.steady[number],
                self._gaps,
            )
            self._senses[number] = _senses_at_end(motion, columns, field)
            fields.append(field)
        if all(block.steady):
            self._made_again(block).fills(block.rows.columns)
        return tuple(fields)

    def _unread(
        self, motion: Motion, block: _Block, memories: Sequence[SignMemory]
    ) -> tuple[PoleField, ...]:
        """Return the poles of a motion that are left to be made when they are read."""
        values, kernel, n = block.rows.values, self.kernel, len(motion)

        def signed_at(rows: Sequence[int], number: int) -> Floats:
            return kernel.signed_at(values[:, list(rows)])[number]

        for number, (places, memory) in enumerate(
            zip(kernel.rates, memories, strict=False)
        ):
            self._senses[number] = steady_signs(
                motion, places.signed, partial(signed_at, number=number), memory
            )
        self._left = left = self._made_again(block)
        left.fills(block.rows.residual[None], kernel.residual)
        if self._template is None or self._template[0].shape[1] != n:
            template = Template(kernel.kept, n)
            self._template = template, kernel.read(template.unmade)
        gaps = Gaps(np.flatnonzero(motion.failed), self._gaps)
        return tuple(
            field_unread(
                motion,
                wanted,
                UnreadColumns(
                    left, *self._template_of(number), partial(self._of, number), gaps
                ),
                block.rows.vouched,
                largest_errors([*block.seen, *block.rows.late], number),
            )
            for number, wanted in enumerate(self.requests[: len(memories)])
        )

    def _template_of(self, number: int) -> tuple[Template, RateColumns]:
        assert self._template is not None
        template, shown = self._template
        return template, shown[number]

    def _of(self, number: int, columns: Floats) -> RateColumns:
        return self.kernel.read(columns)[number]

    def _made_again(self, block: _Block) -> Refilled:
        """Return the columns of a block, made when they are read."""
        pieces = block.rows.again(block.parts, list(self._senses))
        return Refilled(self._columns, (self.kernel.kept, len(block.rows.off)), pieces)

    def _named(self, samples: NDArray[np.intp], chosen: slice | NDArray[np.intp]) -> Floats:
        """Return the numbers of samples and modes as bits of whole ones, and the inputs."""
        modes = self.course.tracer.assembly_modes
        numbers = np.array([mode.number for mode in modes])
        inputs, count = self.course.inputs[chosen].T, len(samples)
        shape = 2 + len(inputs), len(modes) * count

        def write(out: Floats) -> None:
            whole = out[:2].view(np.int64).reshape(2, len(modes), count)
            whole[0], whole[1] = samples, numbers[:, None]
            out[2:].reshape(-1, len(modes), count)[:] = inputs[:, None]

        def pieces(reader: Reader) -> None:
            again = np.empty(shape)
            write(again)
            reader(slice(0, shape[1]), again)

        named = self._numbers.array(*shape)
        write(named)
        Refilled(self._numbers, shape, pieces).fills(named)
        return named

    def _motion(self, samples: NDArray[np.intp]) -> Motion:
        """Return the motion at samples, by their numbers."""
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        n, chosen = modes * count, _chosen(samples)
        values = self._values.array(len(tracer.mechanism.variable_owners), n)
        self._is_read |= self._left is not None and self._left.was_read
        is_made = self._is_read or self._is_doubtful
        columns = self._columns.array(self.kernel.kept, n) if is_made else None
        rows = Rows(
            self.kernel,
            self.positions,
            np.ascontiguousarray(tracer.input_grid.q[chosen].T),
            values,
            columns,
            self._residuals.array(1, n)[0],
            self._off.array(1, n)[0],
            self._rooms,
        )
        self._read(chosen, values.reshape(-1, modes, count))
        parts = [
            (mode, slice(start, min(start + SLICE, (mode + 1) * count)))
            for mode in range(modes)
            for start in range(mode * count, (mode + 1) * count, SLICE)
        ]
        senses = [of_input.copy() for of_input in self._senses]
        seen = rows.fill(parts, senses)
        rest = np.flatnonzero(~rows.vouched & (rows.status == Status.OK))
        if len(rest):
            self._with_care(rows, samples, rest, senses)
            seen = _without(seen, parts, rest)
        failed = (rows.status != Status.OK) & (rows.status != Status.AT_SINGULARITY)
        rows.leave_out(failed)
        vouched = rows.vouched & (rows.status == Status.OK)
        is_steady = tracer.input_grid.is_path and bool(np.all(vouched | failed))
        goes_on = [False] * len(self.requests)
        if is_steady:
            seen = rows.looked_through(seen, parts, ~failed)
            goes_on = steady(seen, parts)
        rows.vouched = vouched
        self._is_doubtful = not all(goes_on)
        if self._is_doubtful:
            rows.make(parts, senses, self._columns)
        timing = course.timing if self.with_times else None
        if timing is not None:
            timing = timing.rows(samples).repeated(modes)
        named = self._named(samples, chosen)
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=named[0].view(np.int64),
            assembly_mode=named[1].view(np.int64),
            inputs=named[2:].T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.residual,
            is_path=tracer.input_grid.is_path,
            timing=timing,
        )
        doubtful = np.flatnonzero(~(vouched | failed))
        if len(doubtful):
            rows.off[doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = rows.off
        self._found[id(motion)] = _Block(samples, rows, parts, seen, goes_on)
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
        samples: NDArray[np.intp],
        rest: NDArray[np.intp],
        senses: Sequence[Floats],
    ) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer, count = self.course.tracer, len(samples)
        residual = np.empty(len(rest))
        for number, mode in enumerate(tracer.assembly_modes):
            of_mode = rest // count == number
            if not np.any(of_mode):
                continue
            at = rest[of_mode]
            wanted = samples[at - number * count]
            evaluated = tracer.solver.evaluate(mode, tracer.input_grid.q[wanted], wanted)
            rows.values[:, at] = evaluated.values.T
            rows.status[at], residual[of_mode] = evaluated.status, evaluated.residual
        closed = np.isfinite(residual)
        rows.put(rest[closed], senses, residual[closed])
        rows.residual[rest[~closed]] = np.nan


def _chosen(samples: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """Return what chooses samples, by their numbers: a slice where they are successive."""
    first, last = int(samples[0]), int(samples[-1])
    if last - first != len(samples) - 1 or np.any(samples[1:] <= samples[:-1]):
        return samples
    return slice(first, last + 1)


def _without(
    seen: Sequence[Seen], parts: Sequence[Part], late: NDArray[np.intp]
) -> list[Seen]:
    """Return what was seen of parts, forgotten of those with rows that were found late."""
    return [
        Seen() if np.any((late >= rows.start) & (late < rows.stop)) else here
        for here, (_, rows) in zip(seen, parts, strict=True)
    ]


def _senses_at_end(motion: Motion, columns: RateColumns, field: PoleField) -> Floats:
    """Return (modes, poles) signs of directions without a sense, at the last rows held."""
    modes = len(motion.assembly_modes)
    held = ~motion.failed.reshape(modes, motion.samples)
    last = motion.samples - 1 - np.argmax(held[:, ::-1], axis=1)
    rows = last + motion.samples * np.arange(modes)
    rates = [field.velocity_coefficient[pole][rows] for pole in columns.signed]
    return np.where(np.array(rates).reshape(-1, modes).T < 0.0, -1.0, 1.0)
