"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `PositionAnalysis` and `evaluate`, as without it. It is done slice by slice, so
that each stays in the cache; of each it is seen where directions of poles may reverse from
one row to the next.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np

from spherekit.analysis.running.in_turn import SCRATCH, each_at_once, in_turn
from spherekit.analysis.running.kernel_columns import (
    SLICE,
    ComputedColumns,
    LazyField,
    Part,
    slices_of,
)
from spherekit.analysis.running.sampling import Sampling
from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Status
from spherekit.engine.columns import MovingTerms
from spherekit.engine.compiler import available
from spherekit.engine.dyads import given_by, lost_by
from spherekit.engine.row_kernel import ColumnFunction, RowKernel, row_kernel
from spherekit.motion.guides import ModeCurve
from spherekit.motion.motion import Motion, PositionAnalysis
from spherekit.motion.predicted import predictor
from spherekit.rates.request import (
    Request,
    SignContinuation,
    Stops,
    Turning,
    sides_of,
    signs_at_stops,
)
from spherekit.sphere.rotation import max_abs, nans

SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

NONE: Indices = np.empty(0, dtype=np.intp)
ASIDE = 1e-8
"""The least cosine of successive directions: those of rows that are still open may be off
by a tenth of that, as those that are vouched for."""
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
GROWTH = 8
"""Times that a block grows at most: an analysis may begin to read arrays late."""
MORE = 32
"""Blocks have so many times the rows of those without a kernel, at most."""


class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample, whose inputs are `q` (inputs, samples). `values`
    (variables, n) are nearly closed where they were predicted, and follow from the inputs
    where the kernel has the closed form in it; in the end they are those of all variables.
    `closure` (2, n) is by how much loops are open, and the error of the configuration.
    `vouched` (n,) says where the values close all loops and the kernel's numbers may be
    given. `errors` are those of rows after their slice.
    """

    def __init__(self, kernel: RowKernel, tracer: PositionAnalysis, q: Floats) -> None:
        self.kernel, self._tracer, self._q = kernel, tracer, q
        n = len(tracer.assembly_modes) * q.shape[1]
        self.closure = np.empty((2, n))
        self.vouched = np.ones(n, dtype=bool)
        self.status = np.zeros(n, dtype=np.int8)
        self.errors: list[tuple[tuple[float, ...], ...]] = []
        by_inputs, shape = (
            kernel.has_closed_form,
            (len(tracer.mechanism.variable_owners), n),
        )
        self.values = np.empty(shape) if by_inputs else nans(shape)
        self._deciding = kernel.by_inputs if by_inputs else kernel.judging
        # So many that little is left to do between.
        size = max(1, round(JUDGED / (self._deciding.width * SLICE))) * SLICE
        self.parts = slices_of(len(tracer.assembly_modes), q.shape[1], size)

    def fill(self, samples: Indices) -> "list[tuple[int, Seen]]":
        """Fill all rows, of samples by their numbers.

        Return what is seen of each slice that has rows vouched for, with its mode.
        """
        made = each_at_once(self._fill, self.parts, self.kernel.in_threads)
        open_ = np.concatenate([rows for _, rows in made])
        if len(open_):
            self._close(open_)
        late = ~self.vouched & (self.status == Status.OK)
        if np.any(late):
            self._with_care(samples, np.flatnonzero(late))
        self.vouched &= self.status == Status.OK
        seen: list[tuple[int, Seen]] = []
        for (mode, rows), (here, _) in zip(self.parts, made, strict=True):
            if here is None or np.any(late[rows]):
                here = self._looked_at(rows)
            seen += [] if here is None else [(mode, here)]
        return seen

    def _fill(self, part: Part) -> "tuple[Seen | None, Indices]":
        """Fill a slice; return what is seen of it, and rows that a step may close."""
        mode, rows = part
        deciding, first = self._deciding, mode * self._q.shape[1]
        q, numbers = self._q[:, rows.start - first : rows.stop - first], np.r_[rows]
        by_form, signs = (
            self.kernel.has_closed_form,
            self._tracer.assembly_modes[mode].signs,
        )
        count = len(q) + len(signs) if by_form else len(self.values)
        with SCRATCH.room(count + deciding.width, len(numbers)) as room:
            given, columns = room[:count], room[count:]
            if by_form:
                given_by(q, signs, given)
            else:
                given[:] = self.values[:, rows]
            deciding(given, columns)
            places = deciding.places
            if by_form:
                self.values[:, rows] = columns[places["variables"]]
            doubt, closure = columns[places["doubt"]][0], columns[places["closure"]]
            self.closure[:, rows], rounding = closure, self.kernel.open_by_rounding
            if np.max(doubt) <= 1.0 and np.max(closure[0]) <= rounding:
                return Seen.of(self.kernel, deciding, columns, numbers), NONE
            good = np.all(columns[places["doubts"]] <= 1.0, axis=0)
            closed = closure[0] <= rounding
            self.vouched[rows] = good & closed
            squares = columns[places["squares"]] if by_form else None
            lost = self._lost(mode, q, given) if squares is None else lost_by(squares)
            self.status[rows][lost] = Status.OUT_OF_REACH
            open_ = numbers[~closed & np.isfinite(closure[0])]
            if not np.any(good) or not np.all(good | lost):
                return None, open_
            some = columns[:, good], numbers[good], closed[good]
            return Seen.of(self.kernel, deciding, *some), open_

    def _lost(self, number: int, q: Floats, values: Floats) -> Bools:
        """Return (n,) which samples a mode surely does not reach, at inputs (inputs, n).

        What lies beyond the curve that a mode follows, so that no variables (variables, n)
        were predicted, is out of reach where that curve ends for this reason.
        """
        guide = self._tracer.assembly_modes[number].guide
        lost = np.isnan(values[self.kernel.free[0]])
        if isinstance(guide, ModeCurve):
            lost[lost] = guide.ends_before(q[0, lost])
            return np.asarray(lost)
        return np.zeros(len(lost), dtype=bool)

    def _close(self, open_: Indices) -> None:
        """Take a step of Newton's method at some rows; keep what that closes, near by."""
        before = self.values[:, open_]
        after = before.copy()
        after[list(self.kernel.free)] = self.kernel.closer(before)
        near = max_abs(after - before, axis=0) < SMALL_STEP
        rows = open_[near]
        self.values[:, rows] = after[:, near]
        self._judge(rows)

    def _with_care(self, samples: Indices, late: Indices) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer, residual = self._tracer, np.empty(len(late))
        for number, mode in enumerate(tracer.assembly_modes):
            of_mode = late // len(samples) == number
            if not np.any(of_mode):
                continue
            at = late[of_mode]
            wanted = samples[at % len(samples)]
            evaluated = tracer.solver.evaluate(mode, tracer.input_grid.q[wanted], wanted)
            self.values[:, at] = evaluated.values.T
            self.status[at], residual[of_mode] = evaluated.status, evaluated.residual
        closed = np.isfinite(residual)
        self._judge(late[closed], residual[closed])
        self.closure[0, late[~closed]] = np.nan

    def _judge(self, rows: Indices, residual: Floats | None = None) -> None:
        """Judge rows by their numbers, whose values are known, and the residual may be."""
        judging = self.kernel.judging
        columns = judging(self.values[:, rows])
        good = np.all(columns[judging.places["doubts"]] <= 1.0, axis=0)
        closure = columns[judging.places["closure"]]
        if residual is None:
            good &= closure[0] <= self.kernel.open_by_rounding
        else:
            closure[0] = residual
        self.closure[:, rows], self.vouched[rows] = closure, good
        if np.any(good):
            self.errors.append(largest(judging, columns[:, good]))

    def _looked_at(self, part: slice) -> "Seen | None":
        """Return what is seen of the rows of a slice that are vouched for, found again."""
        rows = np.flatnonzero(self.vouched[part]) + part.start
        judging = self.kernel.judging
        if not len(rows):
            return None
        return Seen.of(self.kernel, judging, judging(self.values[:, rows]), rows)


@dataclass(frozen=True)
class Seen:
    """What was seen of a slice's rows that are vouched for, while they were in the cache.

    `first` and `last` are the numbers of the outermost, `ends` for each input the relative
    angular velocities (poles, 3, 2) there, and `gaps` (2, k) the rows between which some
    direction may reverse. `errors` are for each input the largest of directions, rates,
    changes.
    """

    first: int
    last: int
    ends: tuple[Floats, ...]
    gaps: tuple[Indices, ...]
    errors: tuple[tuple[float, ...], ...]

    @classmethod
    def of(
        cls,
        kernel: RowKernel,
        deciding: ColumnFunction,
        columns: Floats,
        rows: Indices,
        counted: Bools | None = None,
    ) -> "Seen":
        """Return what is seen of successive rows; errors are those of the `counted`."""
        ends, gaps = [], []
        for number, moving in enumerate(kernel.moving):
            spins = columns[deciding.places["spins", number]]
            at = _gaps(moving, spins)
            ends.append(moving.relative(spins[:, [0, -1]]))
            gaps.append(np.array([rows[at], rows[at + 1]]))
        whole = largest(deciding, columns if counted is None else columns[:, counted])
        return cls(int(rows[0]), int(rows[-1]), tuple(ends), tuple(gaps), whole)


def largest(deciding: ColumnFunction, columns: Floats) -> tuple[tuple[float, ...], ...]:
    """Return the largest errors of rows by input: directions, rates, changes."""
    parts = (columns[place] for key, place in deciding.places.items() if "errors" in key)
    return tuple(tuple(np.max(some, axis=1, initial=0.0).tolist()) for some in parts)


def _along(one: Floats, two: Floats) -> Bools:
    """Return which directions (..., 3) do not reverse from one to the other."""
    sizes = np.sum(one * one, axis=-1) * np.sum(two * two, axis=-1)
    return np.sum(one * two, axis=-1) >= ASIDE * np.sqrt(sizes)


def _gaps(moving: MovingTerms, spins: Floats) -> Indices:
    """Return after which rows a direction of an input may reverse to the next one.

    By how links turn (k, n), of which least and largest say most often that none does: no
    product of two in a box falls below the one of its corners, and no size exceeds the
    other.
    """
    if spins.shape[1] < 2:
        return NONE
    low, high = np.min(spins, axis=1), np.max(spins, axis=1)
    least, most = moving.relative(low, high), moving.relative(high, low)
    across, one, other = least * most, least * least, most * most
    inner = np.where(across > 0.0, np.minimum(one, other), across)
    product, size = np.sum(inner, axis=1), np.sum(np.maximum(one, other), axis=1)
    if np.all(product >= ASIDE * size):
        return NONE
    v = np.moveaxis(moving.relative(spins), 1, 2)
    return np.flatnonzero(~np.all(_along(v[:, :-1], v[:, 1:]), axis=0))


def stops_of(
    seen: Sequence[tuple[int, Seen]], number: int, held: Bools, careful: Indices
) -> dict[int, Stops]:
    """Return where directions of an input are looked at, by the modes' places.

    `seen` are slices with their modes, in order; `held` (modes, samples) says which rows
    have a configuration, `careful` are those that were found with care.
    """
    gaps: dict[int, list[Indices]] = defaultdict(list)
    for mode, here in seen:
        gaps[mode].append(here.gaps[number])
    for (mode, one), (other, two) in pairwise(seen):
        across = one.ends[number][..., 1], two.ends[number][..., 0]
        if mode == other and not np.all(_along(*across)):
            gaps[mode].append(np.array([[one.last], [two.first]]))
    stops: dict[int, Stops] = {}
    for mode, of_mode in enumerate(held):
        rows = np.flatnonzero(of_mode) + mode * len(of_mode)
        if len(rows):
            low, high = np.searchsorted(careful, [rows[0], rows[-1] + 1])
            at = np.searchsorted(rows, careful[low:high])
            for low in (at[at > 0] - 1, at[at < len(rows) - 1]):
                gaps[mode].append(np.array([rows[low], rows[low + 1]]))
            stops[mode] = _stops(rows[[0, -1]], gaps[mode])
    return stops


def _stops(ends: Indices, parts: Sequence[Indices]) -> Stops:
    gaps = np.concatenate(parts, axis=1)
    rows = np.unique(np.concatenate([ends, gaps.ravel()]))
    depth = np.zeros(len(rows), dtype=np.intp)
    first, second = np.searchsorted(rows, gaps)
    np.add.at(depth, first, 1)
    np.add.at(depth, second, -1)
    return Stops(rows, np.cumsum(depth)[:-1] > 0)


@dataclass
class BatchRunner:
    """The rows of a course by a kernel.

    Where all groups are dyads it has the closed form in it; else samples that
    lie close together along a path are `predicted`. Configurations that neither knows are
    those of the tracer. What is `unread` of blocks lies here until its poles are asked:
    the rows (n,) that the kernel vouches for, those (modes, samples) with a configuration,
    the others (k,) of these, by input where directions are looked at, and the largest
    errors by input, of directions, rates and changes: NaN where nothing is vouched for.
    """

    course: Sampling
    requests: tuple[Request, ...]
    kernel: RowKernel
    predicted: Callable[[int, int, Floats], None] | None
    recorded: bool
    looks_ahead: bool
    with_times: bool
    unread: dict[
        int, tuple[Bools, Bools, Indices, Sequence[Mapping[int, Stops]], Floats]
    ] = field(default_factory=dict, repr=False)
    _last: ComputedColumns | None = None

    @classmethod
    def of(
        cls,
        course: Sampling,
        requests: Sequence[Request],
        recorded: bool,
        looks_ahead: bool = False,
        with_times: bool = True,
    ) -> "BatchRunner | None":
        """Return it, None where rows are few, no poles asked or the terms do not hold.

        Where it `looks_ahead`, a block is found while the one before is made use of; the
        tracer is then for it alone. Motions come `with_times` where they have any.
        """
        tracer = course.tracer
        rows = len(course) * len(tracer.assembly_modes)
        if course.simulation is not None or rows < FEWEST or not requests:
            return None
        engine: Literal["numpy", "compiled"]
        engine = "compiled" if rows >= MANY and available() else "numpy"
        made = row_kernel(tracer.sparse(REFERENCES), requests, engine)
        if made is None or not made.vouches:
            return None
        predicted = None if made.has_closed_form else predictor(tracer)
        way = recorded, looks_ahead, with_times
        return cls(course, tuple(requests), made, predicted, *way)

    @property
    def block(self) -> int:
        """Samples in a block; where they are recorded, as many as without a kernel."""
        tracer = self.course.tracer
        if self.recorded:
            return tracer.block
        many = BYTES // (8 * self.kernel.kept * len(tracer.assembly_modes))
        return max(1, min(many, MORE * tracer.block))

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples.

        Of `size`, unless that is the ordinary one: then they grow while no column is read.
        """
        most = GROWTH * size if size == self.block and not self.recorded else size

        def samples() -> Iterator[Indices]:
            start, count = first, size
            while start < len(self.course):
                yield np.arange(start, min(start + count, len(self.course)))
                start += count
                if self._last is not None:
                    count = size if self._last.was_read else min(2 * count, most)

        yield from in_turn(self.motion_at, samples(), self.looks_ahead)

    def fields(
        self, motion: Motion, memories: Sequence[SignContinuation]
    ) -> tuple[LazyField, ...]:
        """Return the poles of a motion that was found, for each input that moves.

        They are made when they are read.
        """
        vouched, held, doubtful, stops, errors = self.unread.pop(id(motion))
        asked = self.requests[: len(memories)]
        self._last = columns = ComputedColumns(self.kernel, motion, asked, doubtful)
        turned: list[Turning] = []
        for k, (memory, _) in enumerate(zip(memories, asked, strict=False)):
            if motion.is_path:
                at = partial(columns.relative_at, k)
                signed = self.kernel.moving[k].signed
                turned.append(signs_at_stops(motion, signed, stops[k], at, memory))
            else:
                turned.append(sides_of(motion, held, memory))
        columns.turn(turned, motion.samples)
        return tuple(
            LazyField(columns, k, motion, vouched, errors[k].tolist())
            for k in range(len(asked))
        )

    def motion_at(self, samples: Indices) -> Motion:
        """Return the motion at some samples, by their numbers in rising order."""
        course, tracer = self.course, self.course.tracer
        modes, count = len(tracer.assembly_modes), len(samples)
        q = np.ascontiguousarray(tracer.input_grid.q[samples].T)
        rows = Rows(self.kernel, tracer, q)
        if self.predicted is not None:
            values = rows.values.reshape(-1, modes, count)
            edges = np.flatnonzero(np.diff(samples, prepend=-2, append=-2) != 1)
            for low, high in pairwise(edges.tolist()):
                ends = int(samples[low]), int(samples[high - 1]) + 1
                self.predicted(*ends, values[:, :, low:high])
        seen = rows.fill(samples)
        failed = (rows.status != Status.OK) & (rows.status != Status.AT_SINGULARITY)
        rows.values[:, failed] = rows.closure[:, failed] = np.nan
        doubtful = np.flatnonzero(~(rows.vouched | failed))
        timing = course.timing if self.with_times else None
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=np.tile(samples, modes),
            assembly_mode=np.repeat([m.number for m in tracer.assembly_modes], count),
            inputs=np.tile(q, modes).T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.closure[0],
            is_path=tracer.input_grid.is_path,
            timing=None if timing is None else timing.rows(samples).repeated(modes),
        )
        if len(doubtful):
            rows.closure[1, doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = rows.closure[1]
        held, every = ~failed.reshape(modes, count), range(len(self.requests))
        stops = [stops_of(seen, k, held, doubtful) for k in every if motion.is_path]
        errors = [nans((len(every), 3)), *(here.errors for _, here in seen), *rows.errors]
        whole = np.fmax.reduce(np.array(errors))
        self.unread[id(motion)] = rows.vouched, held, doubtful, stops, whole
        return motion
