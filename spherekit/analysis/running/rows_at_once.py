"""Blocks of samples whose rows a kernel gives all at once, the doubtful ones with care.

Variables are predicted from nodes, the kernel says how far loops are open there and what
rates follow, and what all of that may be off by. Rows that it does not vouch for are
found by `Tracer` and `evaluate`, as without it.

A block of rows judged by a kernel, slice by slice, so that each stays in the cache.

Of each slice it is seen where directions of poles may reverse from one row to the next.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Literal, final

import numpy as np

from spherekit.analysis.running.in_turn import each_at_once, in_turn
from spherekit.analysis.running.kernel_columns import (
    MEMORY,
    SLICE,
    KernelColumns,
    Part,
    UnreadField,
    slices_of,
)
from spherekit.analysis.running.sampling import Sampling
from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Status
from spherekit.engine.compiler import available
from spherekit.engine.dyads import given_by
from spherekit.engine.row_kernel import RowFunction, RowKernel, row_kernel
from spherekit.motion.guides import ModeCurve
from spherekit.motion.motion import Motion, Tracer
from spherekit.motion.predicted import Predictor
from spherekit.rates.request import (
    Request,
    SignMemory,
    Stops,
    TurnedRows,
    sides_of,
    signs_at_stops,
)
from spherekit.sphere.rotation import max_abs, nans

SHORTEST_RUN = 64
"""Rows without a configuration that follow each other less often are left out by number."""
SMALL_STEP = 1e-6
"""A step of Newton's method (rad) from what was predicted stays in its mode."""

NONE: Indices = np.empty(0, dtype=np.intp)
FEW = 128
"""So many angular velocities are compared one by one where their box leaves it open."""
PARTS = 8
"""Parts that more of them are divided into."""
ASIDE = 1e-8
"""The least cosine of successive directions: those of rows that are still open may be off
by a tenth of that, as those that are vouched for."""


@final
class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample, whose inputs are `q` (inputs, samples). `values`
    (variables, n) are what is read of the variables, then all of them. `closure` (2, n) is
    by how much loops are open, and the error of the configuration. `vouched` (n,) says
    where the values close all loops and the kernel's numbers may be given. `late` are the
    errors of rows after their slice.
    """

    def __init__(self, kernel: RowKernel, positions: "Positions", q: Floats) -> None:
        self.kernel, self.positions, self._q = kernel, positions, q
        tracer = positions.tracer
        n = len(tracer.assembly_modes) * q.shape[1]
        self.values = MEMORY.array(len(tracer.mechanism.variable_owners), n)
        self.closure = MEMORY.array(2, n)
        self.vouched = np.ones(n, dtype=bool)
        self.status = np.zeros(n, dtype=np.int8)
        self.late: list[tuple[tuple[float, ...], ...]] = []

    def fill(self, parts: Sequence[Part]) -> "list[Seen | None]":
        """Fill all rows; return what was seen of parts whose rows are all vouched for."""
        made = each_at_once(self._fill, parts, self.kernel.in_threads)
        open_ = np.concatenate([rows for _, rows in made])
        if len(open_):
            self._close(open_)
        return [seen for seen, _ in made]

    def put(self, rows: Indices, residual: Floats | None = None) -> None:
        """Fill rows by their numbers, whose values are known, and the residual may be."""
        judging, values = self.kernel.judging, self.values[:, rows]
        judged = judging(values)
        if residual is not None:
            judging.closure(judged)[0] = residual
        self.closure[:, rows] = judging.closure(judged)
        good = judging.vouched(judged)
        if residual is None:
            good &= judging.closed(judged)
        self.vouched[rows] = good
        if np.any(good):
            self.late.append(largest(judging, judged, good))

    def leave_out(self, failed: Bools) -> None:
        """Give rows (n,) that hold no configuration no numbers."""
        edges = np.flatnonzero(np.diff(failed, prepend=False, append=False)).tolist()
        runs: list[slice | Indices] = [
            slice(*run) for run in zip(edges[::2], edges[1::2], strict=True)
        ]
        if len(runs) * SHORTEST_RUN > len(failed):
            runs = [np.flatnonzero(failed)]
        for rows in runs:
            self.values[:, rows] = self.closure[:, rows] = np.nan
            self.vouched[rows] = False

    def looked_through(
        self, seen: "Sequence[Seen | None]", parts: Sequence[Part]
    ) -> "list[tuple[int, Seen]]":
        """Return what is seen of each part that has rows vouched for, with its mode."""
        made = [
            (mode, here or self._looked_at(np.flatnonzero(self.vouched[rows]) + rows.start))
            for here, (mode, rows) in zip(seen, parts, strict=True)
        ]
        return [(mode, here) for mode, here in made if here is not None]

    def _looked_at(self, rows: Indices) -> "Seen | None":
        """Return what is seen of some rows, found again."""
        if not len(rows):
            return None
        judging = self.kernel.judging
        return Seen.of(judging, judging(self.values[:, rows]), rows)

    def _fill(self, part: Part) -> "tuple[Seen | None, Indices]":
        """Fill a slice; return what is seen of it, and rows that a step may close."""
        mode, rows = part
        lost: Bools | None = None
        first, count = mode * self._q.shape[1], rows.stop - rows.start
        q = self._q[:, rows.start - first : rows.stop - first]
        by_inputs, judging = self.positions.by_inputs, self.positions.deciding
        with MEMORY.room(judging.width + judging.given, count) as room:
            given, columns = room[: judging.given], room[judging.given :]
            if by_inputs:
                given_by(q, self.positions.signs(mode), given)
            else:
                given[:] = self.values[:, rows]
                lost = self.positions.lost(mode, q, given[list(self.kernel.free)])
            judging(given, columns)
            if by_inputs:
                self.values[:, rows] = columns[: judging.variables]
            self.closure[:, rows] = judging.closure(columns)
            numbers = np.arange(rows.start, rows.stop)
            if judging.is_well(columns):
                return Seen.of(judging, columns, numbers), NONE
            good, closed = judging.vouched(columns), judging.closed(columns)
            well = self.vouched[rows] = good & closed
            if by_inputs:
                lost = judging.lost(columns)
            if lost is not None:
                self.status[rows][lost] = Status.OUT_OF_REACH
            open_ = np.flatnonzero(~closed & np.isfinite(judging.closure(columns)[0]))
            seen = None
            if np.all(good):
                seen = Seen.of(judging, columns, numbers, closed)
            elif not len(open_) and np.any(well):
                seen = Seen.of(judging, columns[:, well], numbers[well])
            return seen, numbers[open_]

    def _close(self, open_: Indices) -> None:
        """Take a step of Newton's method at some rows; keep what that closes, near by."""
        before = self.values[:, open_]
        after = before.copy()
        after[list(self.kernel.free)] = self.kernel.closer(before)
        near = max_abs(after - before, axis=0) < SMALL_STEP
        rows = open_[near]
        self.values[:, rows] = after[:, near]
        self.put(rows)


@final
@dataclass(frozen=True)
class Positions:
    """The variables of samples, nearly closed, and which modes surely do not reach them.

    Where all groups are dyads the kernel of rows has the closed form in it; else a
    `predictor` reads samples that lie close together along a path. What lies beyond the
    curve that a mode follows is out of reach where that curve ends for this reason.
    """

    tracer: Tracer
    kernel: RowKernel
    predictor: Predictor | None

    @classmethod
    def of(cls, tracer: Tracer, kernel: RowKernel) -> "Positions":
        """Return those of a tracer's samples."""
        is_read = not kernel.has_closed_form
        return cls(tracer, kernel, Predictor.of(tracer) if is_read else None)

    @property
    def by_inputs(self) -> bool:
        """Whether all variables follow from inputs."""
        return self.kernel.has_closed_form

    @property
    def deciding(self) -> RowFunction:
        """What decides about rows: by inputs, or of variables that were read."""
        return self.kernel.by_inputs if self.by_inputs else self.kernel.judging

    def read(self, start: int, stop: int, out: Floats) -> None:
        """Write what is read between nodes of samples from `start` to `stop`.

        As variables (variables, modes, samples), NaN where nothing is.
        """
        if self.predictor is not None:
            self.predictor.read(start, stop, out)
        elif not self.by_inputs:
            out[:] = np.nan

    def signs(self, number: int) -> tuple[int, ...]:
        """Return the signs of a mode's dyads."""
        return self.tracer.assembly_modes[number].signs

    def lost(self, number: int, q: Floats, values: Floats) -> Bools:
        """Return (n,) which samples a mode surely does not reach.

        At inputs q (inputs, n), where no variables (variables, n) are read.
        """
        mode = self.tracer.assembly_modes[number]
        lost = np.isnan(values[0])
        if isinstance(mode.guide, ModeCurve):
            lost[lost] = mode.guide.ends_before(q[0, lost])
            return np.asarray(lost)
        return np.zeros(q.shape[1], dtype=bool)


@final
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
        deciding: RowFunction,
        columns: Floats,
        rows: Indices,
        counted: Bools | None = None,
    ) -> "Seen":
        """Return what is seen of successive rows; errors are those of the `counted`."""
        every = range(len(deciding.inputs))
        turning = [deciding.turning(columns, k) for k in every]
        boxes = [deciding.ends(columns, k) for k in every]
        at = [_gaps(deciding, turning[k], k, boxes[k][:2]) for k in every]
        errors = tuple(box[2] for box in boxes)
        return cls(
            int(rows[0]),
            int(rows[-1]),
            tuple(deciding.relative(k, turning[k][..., [0, -1]]) for k in every),
            tuple(np.array([rows[k], rows[k + 1]]) for k in at),
            errors if counted is None else largest(deciding, columns, counted),
        )


def largest(
    deciding: RowFunction, columns: Floats, chosen: Bools
) -> tuple[tuple[float, ...], ...]:
    """Return the largest errors of chosen rows by input: directions, rates, changes."""
    some = slice(None) if np.all(chosen) else chosen
    every = (deciding.errors(columns, k) for k in range(len(deciding.inputs)))
    return tuple(
        tuple(np.maximum.reduce(errors[:, some], axis=1, initial=0.0).tolist())
        for errors in every
    )


def stops_of(
    seen: Sequence[tuple[int, Seen]],
    number: int,
    held: Bools,
    careful: Indices,
) -> dict[int, Stops]:
    """Return where directions of an input are looked at, by the modes' places.

    `seen` are slices with their modes, in order; `held` (modes, samples) says which rows
    have a configuration, `careful` are those that were found with care.
    """
    gaps: dict[int, list[Indices]] = defaultdict(list)
    for mode, here in seen:
        gaps[mode].append(here.gaps[number])
    ends = np.array([here.ends[number] for _, here in seen])
    if len(seen) > 1:
        reverses = ~np.all(_along(ends[:-1, ..., 1], ends[1:, ..., 0]), axis=1)
        for k in np.flatnonzero(reverses).tolist():
            (mode, one), (other, two) = seen[k : k + 2]
            if mode == other:
                gaps[mode].append(np.array([[one.last], [two.first]]))
    stops: dict[int, Stops] = {}
    for mode, of_mode in enumerate(held):
        if not np.any(of_mode):
            continue
        start, count = mode * len(of_mode), len(of_mode)
        outer = int(np.argmax(of_mode)), count - 1 - int(np.argmax(of_mode[::-1]))
        some = careful[(careful >= start) & (careful < start + count)]
        if len(some):
            rows = np.flatnonzero(of_mode) + start
            at = np.searchsorted(rows, some)
            at, going_on = at[at > 0], at[at < len(rows) - 1]
            gaps[mode].append(np.array([rows[at - 1], rows[at]]))
            gaps[mode].append(np.array([rows[going_on], rows[going_on + 1]]))
        stops[mode] = _stops(np.array(outer) + start, gaps[mode])
    return stops


def _stops(ends: Indices, parts: Sequence[Indices]) -> Stops:
    gaps = np.concatenate([np.empty((2, 0), dtype=np.intp), *parts], axis=1)
    rows = np.unique(np.concatenate([ends, gaps.ravel()]))
    depth = np.zeros(len(rows), dtype=np.intp)
    first, second = np.searchsorted(rows, gaps)
    np.add.at(depth, first, 1)
    np.add.at(depth, second, -1)
    return Stops(rows, np.cumsum(depth)[:-1] > 0)


def _along(one: Floats, two: Floats) -> Bools:
    """Return which directions (..., 3) do not reverse from one to the other."""
    sizes = np.sum(one * one, axis=-1) * np.sum(two * two, axis=-1)
    return np.asarray(np.sum(one * two, axis=-1) >= ASIDE * np.sqrt(sizes))


def _gaps(
    deciding: RowFunction,
    turning: Floats,
    number: int,
    box: tuple[Floats, Floats] | None = None,
    first: int = 0,
) -> Indices:
    """Return after which rows a direction of an input may reverse to the next one.

    By the angular velocities (links, 3, n) of what turns: within their `box`, least and
    largest, first, then, where that leaves it open, in parts.
    """
    none = np.empty(0, dtype=np.intp)
    n = turning.shape[2]
    if not turning.size or n < 2:
        return none
    if n <= FEW:
        v = np.moveaxis(deciding.relative(number, turning), 1, 2)
        return first + np.flatnonzero(~np.all(_along(v[:, :-1], v[:, 1:]), axis=0))
    low, high = box or (
        np.minimum.reduce(turning, axis=2),
        np.maximum.reduce(turning, axis=2),
    )
    least, most = deciding.relative(number, low, high), deciding.relative(number, high, low)
    # No product of two in a box falls below the one, no size exceeds the other.
    across, one, other = least * most, least * least, most * most
    inner = np.where(across > 0.0, np.minimum(one, other), across)
    product, size = np.sum(inner, axis=1), np.sum(np.maximum(one, other), axis=1)
    if np.all(product >= ASIDE * size):
        return none
    step = -(-n // PARTS)
    starts = range(0, n - 1, step)
    parts = (
        _gaps(deciding, turning[..., k : k + step + 1], number, None, first + k)
        for k in starts
    )
    return np.concatenate([none, *parts])


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
    held: Bools
    doubtful: Indices
    stops: Sequence[Mapping[int, Stops]]
    errors: Floats


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
        rounded = any(item.plan.rounded_axes for item in requests)
        if made is None or made.rests or rounded or not made.free:
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

    def motion_at(self, samples: Indices) -> Motion:
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
        errors = [nans((len(self.requests), 3))]
        errors += map(np.array, [*(here.errors for _, here in looked), *rows.late])
        block = _Block(rows, held, doubtful, stops, np.fmax.reduce(np.array(errors)))
        self._found[id(motion)] = block
        return motion

    def _with_care(self, rows: Rows, samples: Indices, late: Indices) -> None:
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
