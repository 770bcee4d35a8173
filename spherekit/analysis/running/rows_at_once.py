"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `Tracer` and `evaluate`, as without it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.in_turn import in_turn
from spherekit.analysis.running.lent_memory import LentMemory
from spherekit.analysis.running.positions import Positions
from spherekit.analysis.running.row_block import SLICE, Rooms, Rows
from spherekit.analysis.running.sampling import Sampling
from spherekit.conventions import Status
from spherekit.engine.columns import RowKernel, row_kernel
from spherekit.engine.compiler import available
from spherekit.motion.motion import Motion
from spherekit.rates.columns import RateColumns
from spherekit.rates.from_columns import field_of_columns
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.signs import SignMemory
from spherekit.sphere.rotation import Floats

FEWEST = 1 << 14
"""With fewer rows than this a kernel is not made."""
MANY = 1 << 19
"""From so many rows on it is compiled, where heyoka is installed."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 25
"""Of columns in a block, at most."""
MORE = 4
"""Blocks have so many times the rows of those without a kernel, at most."""

_Found = tuple[Sequence[RateColumns], NDArray[np.bool_], Sequence[bool]]


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

    def __post_init__(self) -> None:
        self._found: dict[int, _Found] = {}
        modes = len(self.course.tracer.assembly_modes)
        rates = self.kernel.rates
        self._rooms = Rooms(self.kernel.width * SLICE)
        self._memory = LentMemory()
        # Expected from the block before: then nothing has to be turned round later.
        self._senses = [np.ones((modes, len(places.signed))) for places in rates]

    @classmethod
    def of(
        cls,
        course: Sampling,
        requests: Sequence[Request],
        with_planes: bool,
        looks_ahead: bool = False,
    ) -> "RowsAtOnce | None":
        """Return it, None where rows are few or the terms do not hold.

        Where it `looks_ahead`, a block is found while the one before is made use of; the
        tracer is then for it alone.
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
        return cls(course, wanted, made, positions, engine, with_planes, looks_ahead)

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
            samples = np.arange(start, min(start + size, whole))
            return self._motion(samples, *self.positions.at(start, start + len(samples)))

        yield from in_turn(block, range(first, whole, size), self.looks_ahead)

    def motion_at(self, samples: NDArray[np.intp]) -> Motion:
        """Return the motion at some samples, by their numbers."""
        positions = [self.positions.at(sample, sample + 1) for sample in samples.tolist()]
        values, lost = zip(*positions, strict=True)
        return self._motion(samples, np.concatenate(values, 2), np.concatenate(lost, 1))

    def has_found(self, motion: Motion) -> bool:
        """Return whether a motion is one that was found, whose poles were not asked."""
        return id(motion) in self._found

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[PoleField, ...]:
        """Return the poles of a motion that was found, for each input that moves."""
        rates, vouched, steady = self._found.pop(id(motion))
        per_input = zip(self.requests, rates, memories, self._senses, strict=False)
        fields = []
        for (wanted, columns, memory, senses), is_steady in zip(
            per_input, steady, strict=True
        ):
            field = field_of_columns(
                motion, wanted, columns, vouched, memory, self.with_planes, is_steady
            )
            senses[:] = _senses_at_end(motion, columns, field)
            fields.append(field)
        return tuple(fields)

    def _motion(
        self, samples: NDArray[np.intp], values: Floats, lost: NDArray[np.bool_]
    ) -> Motion:
        """Return the motion at samples, from what is known (variables, modes, samples)."""
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        rows = Rows.of(
            self.kernel,
            values.reshape(len(values), modes * count),
            lost.reshape(modes * count),
            self._rooms,
            self._memory,
        )
        parts = [
            (mode, slice(start, min(start + SLICE, (mode + 1) * count)))
            for mode in range(modes)
            for start in range(mode * count, (mode + 1) * count, SLICE)
        ]
        flags = rows.fill(parts, [senses.copy() for senses in self._senses])
        rest = np.flatnonzero(~rows.vouched & (rows.status == Status.OK))
        if len(rest):
            self._with_care(rows, samples, rest)
        failed = (rows.status != Status.OK) & (rows.status != Status.AT_SINGULARITY)
        rows.leave_out(failed)
        vouched = rows.vouched & (rows.status == Status.OK)
        is_steady = tracer.input_grid.is_path and bool(np.all(vouched | failed))
        steady = [False] * len(self.requests)
        if is_steady:
            steady = rows.steady(flags, parts, ~failed)
        timing = course.timing
        if timing is not None:
            timing = timing.rows(samples).repeated(modes)
        numbers = [mode.number for mode in tracer.assembly_modes]
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=np.tile(samples, modes),
            assembly_mode=np.repeat(numbers, count),
            inputs=np.tile(course.inputs[samples], (modes, 1)),
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
        self._found[id(motion)] = self.kernel.read(rows.columns), vouched, steady
        return motion

    def _with_care(
        self, rows: Rows, samples: NDArray[np.intp], rest: NDArray[np.intp]
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
        rows.put(rest[np.isfinite(residual)])
        rows.residual[rest] = residual


def _senses_at_end(motion: Motion, columns: RateColumns, field: PoleField) -> Floats:
    """Return (modes, poles) the signs that directions without a sense have at the end."""
    signed = [pole for pole, pole_rates in columns.poles.items() if pole_rates.is_signed]
    made = np.ones((len(motion.assembly_modes), len(signed)))
    for k, pole in enumerate(signed):
        last = field.velocity_coefficient[pole][motion.samples - 1 :: motion.samples]
        made[:, k] = np.where(last < 0.0, -1.0, 1.0)
    return made
