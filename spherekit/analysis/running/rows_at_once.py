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

from spherekit.analysis.running.sampling import Sampling
from spherekit.conventions import Status
from spherekit.engine.columns import RowKernel, row_kernel
from spherekit.engine.compiler import available
from spherekit.motion.motion import Motion
from spherekit.motion.predicted import Predictor
from spherekit.rates.columns import RowColumns
from spherekit.rates.field import PoleField, SignMemory, field_of_columns
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats

FEWEST = 1 << 14
"""With fewer rows than this a kernel is not made."""
MANY = 1 << 19
"""From so many rows on it is compiled, where heyoka is installed."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 25
"""Of columns in a block."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""


@final
@dataclass
class RowsAtOnce:
    """The rows of a course by a kernel, run by `engine`.

    Without a `predictor`, where samples lie far apart, configurations are those of the
    tracer.
    """

    course: Sampling
    requests: tuple[Request, ...]
    kernel: RowKernel
    predictor: Predictor | None
    engine: Literal["numpy", "compiled"]
    with_planes: bool

    def __post_init__(self) -> None:
        self._found: tuple[Motion, RowColumns, NDArray[np.bool_]] | None = None

    @classmethod
    def of(
        cls, course: Sampling, requests: Sequence[Request], with_planes: bool
    ) -> "RowsAtOnce | None":
        """Return it, None where rows are few or the terms do not hold."""
        tracer = course.tracer
        rows = len(course) * len(tracer.assembly_modes)
        if course.simulation is not None or rows < FEWEST:
            return None
        engine: Literal["numpy", "compiled"]
        engine = "compiled" if rows >= MANY and available() else "numpy"
        made = row_kernel(tracer.sparse(REFERENCES), requests, engine)
        if made is None:
            return None
        predictor = Predictor.of(tracer)
        return cls(course, tuple(requests), made, predictor, engine, with_planes)

    @property
    def block(self) -> int:
        """Samples in a block; where they are recorded, as many as without a kernel."""
        tracer = self.course.tracer
        if self.with_planes:
            return tracer.block
        return max(1, BYTES // (8 * self.kernel.width * len(tracer.assembly_modes)))

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples."""
        for start in range(first, len(self.course), size):
            samples = np.arange(start, min(start + size, len(self.course)))
            yield self._motion(samples, self._predicted(start, start + len(samples)))

    def motion_at(self, samples: NDArray[np.intp]) -> Motion:
        """Return the motion at some samples, by their numbers."""
        each = [self._predicted(sample, sample + 1) for sample in samples.tolist()]
        return self._motion(samples, np.concatenate(each, axis=2))

    def has_found(self, motion: Motion) -> bool:
        """Return whether a motion is the one found last."""
        return self._found is not None and self._found[0] is motion

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[PoleField, ...]:
        """Return the poles of the motion found last, for each input that moves."""
        assert self._found is not None and self._found[0] is motion
        _, columns, vouched = self._found
        self._found = None
        each = zip(self.requests, columns.rates, memories, strict=False)
        return tuple(
            field_of_columns(motion, wanted, own, vouched, memory, self.with_planes)
            for wanted, own, memory in each
        )

    def _predicted(self, start: int, stop: int) -> Floats:
        """Return variables (variables, modes, samples), NaN where none is predicted."""
        if self.predictor is not None:
            return self.predictor.at(start, stop)
        tracer = self.course.tracer
        variables = len(tracer.mechanism.variable_owners)
        return np.full((variables, len(tracer.assembly_modes), stop - start), np.nan)

    def _motion(self, samples: NDArray[np.intp], predicted: Floats) -> Motion:
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        values = predicted.reshape(len(predicted), modes * count)
        raw = self.kernel(values)
        columns = self.kernel.read(raw)
        status = np.zeros(modes * count, dtype=np.int8)
        rows = _Rows(samples, values, raw, status, columns.residual)
        known = np.isfinite(values[0])
        with np.errstate(invalid="ignore"):
            open_ = np.flatnonzero(known & ~columns.closed)
        if len(open_):
            known[open_] = self._closed(rows, open_)
        rest = np.flatnonzero(~known)
        if len(rest):
            self._with_care(rows, rest)
        with np.errstate(invalid="ignore"):
            vouched = columns.vouched & (status == Status.OK)
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
            values=values.T,
            status=status,
            residual=rows.residual,
            timing=timing,
        )
        off = columns.configuration_error
        doubtful = np.flatnonzero(~vouched)
        if len(doubtful):
            off = off.copy()
            off[doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = off
        self._found = motion, columns, vouched
        return motion

    def _closed(self, rows: "_Rows", open_: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Take a step of Newton's method; return which rows that closes, near by."""
        free = list(self.kernel.free)
        before = rows.values[:, open_]
        after = before.copy()
        after[free] = self.kernel.closer(before)
        step = np.max(np.abs(after - before), axis=0)
        found = self.kernel(after)
        with np.errstate(invalid="ignore"):
            closed = self.kernel.read(found).closed & (step < SMALL_STEP)
        rows.values[:, open_[closed]] = after[:, closed]
        rows.columns[:, open_[closed]] = found[:, closed]
        return np.asarray(closed)

    def _with_care(self, rows: "_Rows", rest: NDArray[np.intp]) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer, count = self.course.tracer, len(rows.samples)
        rows.residual = rows.residual.copy()
        for number, mode in enumerate(tracer.assembly_modes):
            own = rest[rest // count == number]
            if not len(own):
                continue
            samples = rows.samples[own - number * count]
            found = tracer.solver.evaluate(mode, tracer.input_grid.q[samples], samples)
            rows.values[:, own] = found.values.T
            rows.status[own], rows.residual[own] = found.status, found.residual
        rows.columns[:, rest] = self.kernel(rows.values[:, rest])


@final
@dataclass
class _Rows:
    """The rows of some samples, mode after mode, while they are found.

    `values` (variables, n), `columns` those of the kernel.
    """

    samples: NDArray[np.intp]
    values: Floats
    columns: Floats
    status: NDArray[np.int8]
    residual: Floats
