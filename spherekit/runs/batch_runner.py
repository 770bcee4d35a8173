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

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.rotation import max_abs, nans
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.mode_predictor import ModeCurve
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.sample_prediction import predictor
from spherekit.runs.kernel_columns import SLICE, ComputedColumns, LazyField, Part, slices_of
from spherekit.runs.prefetch import each_at_once, in_turn
from spherekit.runs.run_folder import memory_at_once
from spherekit.runs.sampling import Sampling
from spherekit.status import Status
from spherekit.symbolic.compiler import available
from spherekit.velocities.direction_signs import (
    SignContinuation,
    Stops,
    Turning,
    sides_of,
    signs_at_stops,
)
from spherekit.velocities.dyad_expressions import given_by, lost_by
from spherekit.velocities.pole_request import Request
from spherekit.velocities.row_expressions import MovingTerms
from spherekit.velocities.row_kernel import ColumnFunction, RowKernel, row_kernel

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
FEW = 256
"""Rows that are compared one by one, where the box of all does not say enough."""
REFERENCES = 64
"""Samples of which the kernel learns in which order variables are eliminated."""
BYTES = 1 << 27
"""Of columns in a block, or of frames where they are read, at most."""
JUDGED = 1 << 19
"""Numbers that decide about the rows of a slice: they stay in the cache."""
GROWTH = 8
"""Times that a block grows at most: an analysis may begin to read arrays late."""
MORE = 32
"""Blocks have so many times the rows of those without a kernel, at most."""


class Rows:
    """The rows of a block while they are found, slice by slice.

    By assembly mode, then sample; `q` (inputs, n) are their inputs. `values`
    (variables, n) are nearly closed where they were predicted, and follow from the inputs
    where the kernel has the closed form in it; in the end they are those of all variables.
    `closure` (2, n) is by how much loops are open, and the error of the configuration.
    `vouched` (n,) says where the values close all loops and the kernel's numbers may be
    given. `singular_error` (n,) is that of a `Motion`.
    """

    def __init__(self, kernel: RowKernel, tracer: PositionAnalysis, q: Floats) -> None:
        self.kernel, self._tracer, self._q = kernel, tracer, q
        modes = len(tracer.assembly_modes)
        n = q.shape[1]
        self.closure = np.empty((2, n))
        self.vouched = np.ones(n, dtype=bool)
        self.status = np.zeros(n, dtype=np.int8)
        self.singular_error = nans(n)
        # What has no closed form is predicted, or not known.
        blank = np.empty if kernel.has_closed_form else nans
        self.values = blank((len(tracer.mechanism.variable_owners), n))
        self._deciding = kernel.by_inputs if kernel.has_closed_form else kernel.judging
        # So many that little is left to do between.
        size = max(1, round(JUDGED / (self._deciding.width * SLICE))) * SLICE
        self.parts = slices_of(modes, n // modes, size)

    def fill(self, samples: Indices) -> "list[tuple[int, Seen]]":
        """Fill all rows, of samples by their numbers.

        Return what is seen of each slice that has rows vouched for, with its mode.
        """
        made = each_at_once(self._fill, self.parts, self.kernel.in_threads)
        late = np.flatnonzero(~self.vouched & (self.status == Status.OK))
        if len(late):
            self._with_care(samples, late)
        self.vouched &= self.status == Status.OK
        seen: list[tuple[int, Seen]] = []
        judging = self.kernel.judging
        for (mode, part), here in zip(self.parts, made, strict=True):
            rows = part.start + np.flatnonzero(self.vouched[part])
            if here is None and len(rows):
                here = Seen(self.kernel, judging, judging(self.values[:, rows]), rows)
            if here:
                seen.append((mode, here))
        return seen

    def _fill(self, part: Part) -> "Seen | None":
        """Fill a slice; return what is seen of it if all of its rows are vouched for."""
        mode, rows = part
        deciding = self._deciding
        numbers = np.arange(rows.start, rows.stop)
        q = self._q[:, rows]
        by_form = self.kernel.has_closed_form
        signs = self._tracer.assembly_modes[mode].signs_along(q)
        count = len(q) + len(signs) if by_form else len(self.values)
        room = np.empty((count + deciding.width, len(numbers)))
        given = room[:count]
        columns = room[count:]
        if by_form:
            given_by(q, signs, given)
        else:
            given[:] = self.values[:, rows]
        deciding(given, columns)
        places = deciding.places
        if by_form:
            self.values[:, rows] = columns[places["variables"]]
        rounding = self.kernel.open_by_rounding
        closure = columns[places["closure"]]
        self.closure[:, rows] = closure
        if np.max(columns[places["doubt"]]) <= 1.0 and np.max(closure[0]) <= rounding:
            return Seen(self.kernel, deciding, columns, numbers)
        if by_form:
            lost = lost_by(columns[places["squares"]])
        else:
            # Where nothing was predicted, beyond the end of the curve.
            lost = np.isnan(given[self.kernel.free[0]])
            assembly_mode = self._tracer.assembly_modes[mode]
            guide = assembly_mode.guide
            if isinstance(guide, ModeCurve) and not assembly_mode.pieces:
                lost[lost] = guide.at(q[:, lost].T, None)[2] == Status.OUT_OF_REACH
            else:
                lost[:] = False
            is_open = (closure[0] > rounding) & np.isfinite(closure[0])
            self._close(columns, numbers, np.flatnonzero(is_open))
            self.closure[:, rows] = closure
        well = np.all(columns[places["doubts"]] <= 1.0, axis=0) & (closure[0] <= rounding)
        self.vouched[rows] = well
        self.status[rows][lost] = Status.OUT_OF_REACH
        if not np.any(well) or not np.all(well | lost):
            return None
        return Seen(self.kernel, deciding, columns[:, well], numbers[well])

    def _close(self, columns: Floats, numbers: Indices, at: Indices) -> None:
        """Take a step of Newton's method at some rows of a slice; keep what is near by."""
        if len(at):
            before = self.values[:, numbers[at]]
            after = before.copy()
            after[list(self.kernel.free)] = self.kernel.closer(before)
            near = max_abs(after - before, axis=0) < SMALL_STEP
            at = at[near]
            after = np.ascontiguousarray(after[:, near])
            self.values[:, numbers[at]] = after
            columns[:, at] = self.kernel.judging(after)

    def _with_care(self, samples: Indices, late: Indices) -> None:
        """Find rows as the tracer does, and what the kernel says of them."""
        tracer = self._tracer
        residual = np.empty(len(late))
        modes = late // len(samples)
        for number in np.unique(modes):
            of_mode = modes == number
            at = late[of_mode]
            wanted = samples[at % len(samples)]
            q = tracer.input_grid.q[wanted]
            evaluated = tracer.solver.evaluate(tracer.assembly_modes[number], q, wanted)
            self.values[:, at] = evaluated.values.T
            self.status[at] = evaluated.status
            self.singular_error[at] = evaluated.singular_error
            residual[of_mode] = evaluated.residual
        judged = late[np.isfinite(residual)]
        judging = self.kernel.judging
        columns = judging(self.values[:, judged])
        self.closure[:, judged] = columns[judging.places["closure"]]
        self.vouched[judged] = np.all(columns[judging.places["doubts"]] <= 1.0, axis=0)
        self.closure[0, late] = residual


class Seen:
    """What was seen of a slice's rows that are vouched for, while they were in the cache.

    `rows` are the numbers of the outermost, `ends` for each input the relative angular
    velocities (poles, 3, 2) there, and `gaps` (2, k) the rows between which some direction
    may reverse. `errors` are for each input the largest of directions, rates, changes.
    """

    def __init__(
        self, kernel: RowKernel, deciding: ColumnFunction, columns: Floats, rows: Indices
    ) -> None:
        self.rows = rows[[0, -1]]
        self.ends: list[Floats] = []
        self.gaps: list[Indices] = []
        for number, moving in enumerate(kernel.moving):
            spins = columns[deciding.places["spins", number]]
            at = _gaps(moving, spins)
            self.ends.append(moving.relative(spins[:, [0, -1]]))
            self.gaps.append(np.array([rows[at], rows[at + 1]]))
        self.errors = [
            np.max(columns[place], axis=1, initial=0.0)
            for key, place in deciding.places.items()
            if "errors" in key
        ]


def _along(one: Floats, two: Floats) -> Bools:
    """Return which directions (..., 3) do not reverse from one to the other."""
    sizes = np.vecdot(one, one) * np.vecdot(two, two)
    return np.vecdot(one, two) >= ASIDE * np.sqrt(sizes)


def _gaps(moving: MovingTerms, spins: Floats) -> Indices:
    """Return after which rows a direction of an input may reverse to the next one.

    By how links turn (k, n), of which least and largest say most often that none does: no
    product of two in a box falls below the one of its corners, and no size exceeds the
    other. Else both halves are looked at.
    """
    low = np.min(spins, axis=1)
    high = np.max(spins, axis=1)
    least = moving.relative(low, high)
    most = moving.relative(high, low)
    across = least * most
    one = least * least
    other = most * most
    inner = np.where(across > 0.0, np.minimum(one, other), across)
    size = np.sum(np.maximum(one, other), axis=1)
    if np.all(np.sum(inner, axis=1) >= ASIDE * size):
        return NONE
    half = spins.shape[1] // 2
    if half > FEW:
        return np.append(
            _gaps(moving, spins[:, : half + 1]), _gaps(moving, spins[:, half:]) + half
        )
    v = np.moveaxis(moving.relative(spins), 1, 2)
    return np.flatnonzero(~np.all(_along(v[:, :-1], v[:, 1:]), axis=0))


def stops_of(
    seen: Sequence[tuple[int, Seen]], number: int, held: Bools, careful: Bools
) -> dict[int, Stops]:
    """Return where directions of an input are looked at, by the modes' places.

    `seen` are slices with their modes, in order; `held` (modes, samples) says which rows
    have a configuration, `careful` which of these were found with care.
    """
    gaps: dict[int, list[Indices]] = defaultdict(list)
    for mode, here in seen:
        gaps[mode].append(here.gaps[number])
    for (mode, one), (other, two) in pairwise(seen):
        across = one.ends[number][..., 1], two.ends[number][..., 0]
        if mode == other and not np.all(_along(*across)):
            gaps[mode].append(np.array([one.rows[1:], two.rows[:1]]))
    stops: dict[int, Stops] = {}
    for mode, of_mode in enumerate(held):
        rows = np.flatnonzero(of_mode)
        if len(rows):
            late = np.flatnonzero(careful[mode, rows])
            at = np.setdiff1d([late - 1, late], [-1, len(rows) - 1])
            rows += mode * len(of_mode)
            every = np.concatenate([*gaps[mode], [rows[at], rows[at + 1]]], axis=1)
            some = np.unique(np.concatenate([rows[[0, -1]], every.ravel()]))
            first, last = np.searchsorted(some, every)
            begun = np.bincount(first, minlength=len(some))
            ended = np.bincount(last, minlength=len(some))
            stops[mode] = some, np.cumsum(begun - ended)[:-1] > 0
    return stops


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
    requests: Sequence[Request]
    kernel: RowKernel
    predicted: Callable[[int, int, Floats], None] | None
    recorded: bool
    looks_ahead: bool
    timed: bool
    reads_frames: bool = False
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
        timed: bool = True,
        reads_frames: bool = False,
    ) -> "BatchRunner | None":
        """Return it, None where rows are few, no poles asked or the terms do not hold.

        Where it `looks_ahead`, a block is found while the one before is made use of; the
        tracer is then for it alone. Motions are `timed` where that is asked. Blocks are
        smaller where an analysis `reads_frames` of links, which take more than columns.
        """
        tracer = course.tracer
        rows = len(course) * len(tracer.assembly_modes)
        if course.simulation is not None or rows < FEWEST or not requests:
            return None
        compiles = rows >= MANY and available()
        made = row_kernel(
            tracer.sparse(REFERENCES), requests, "compiled" if compiles else "numpy"
        )
        if made is None or not made.vouches:
            return None
        predicted = None if made.has_closed_form else predictor(tracer)
        return cls(
            course, requests, made, predicted, recorded, looks_ahead, timed, reads_frames
        )

    @property
    def block(self) -> int:
        """Samples in a block; where they are recorded, as many as without a kernel."""
        tracer = self.course.tracer
        bytes_a_row = 8 * self.kernel.kept
        if self.reads_frames:
            bytes_a_row = max(bytes_a_row, memory_at_once(tracer.mechanism, 1))
        many = BYTES // (bytes_a_row * len(tracer.assembly_modes))
        return max(1, min(many, tracer.block * (1 if self.recorded else MORE)))

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples.

        Of `size`, unless that is the ordinary one: then they grow while no column is read.
        """
        may_grow = size == self.block and not (self.recorded or self.reads_frames)
        most = GROWTH * size if may_grow else size

        def samples() -> Iterator[Indices]:
            start = first
            count = size
            while start < len(self.course):
                yield np.arange(start, min(start + count, len(self.course)))
                start += count
                if self._last is not None:
                    count = size if self._last.was_read else min(2 * count, most)

        return in_turn(self.motion_at, samples(), self.looks_ahead)

    def fields(
        self, motion: Motion, memories: Sequence[SignContinuation]
    ) -> tuple[LazyField, ...]:
        """Return the poles of a motion that was found, for each input that moves.

        They are made when they are read.
        """
        vouched, held, doubtful, stops, errors = self.unread.pop(id(motion))
        self._last = columns = ComputedColumns(self.kernel, motion, self.requests, doubtful)
        turned: list[Turning] = []
        inputs = zip(self.kernel.moving, memories, strict=False)
        for k, (moving, memory) in enumerate(inputs):
            if motion.is_path:
                at = partial(columns.relative_at, k)
                turned.append(signs_at_stops(motion, moving.signed, stops[k], at, memory))
            else:
                turned.append(sides_of(motion, held, memory))
        columns.turn(turned, motion.samples)
        return tuple(
            LazyField(columns, k, motion, vouched, of_input)
            for k, of_input in enumerate(errors)
        )

    def motion_at(self, samples: Indices) -> Motion:
        """Return the motion at some samples, by their numbers in rising order."""
        timing = self.course.timing if self.timed else None
        tracer = self.course.tracer
        modes = len(tracer.assembly_modes)
        count = len(samples)
        q = np.tile(tracer.input_grid.q[samples].T, modes)
        rows = Rows(self.kernel, tracer, q)
        if self.predicted is not None:
            values = rows.values.reshape(-1, modes, count)
            edges = np.flatnonzero(np.diff(samples, prepend=-2, append=-2) != 1)
            for low, high in pairwise(edges):
                out = values[:, :, low:high]
                self.predicted(samples[low], samples[high - 1] + 1, out)
        seen = rows.fill(samples)
        failed = ~has_configuration(rows.status)
        rows.values[:, failed] = rows.closure[:, failed] = np.nan
        careful = ~(rows.vouched | failed)
        doubtful = np.flatnonzero(careful)
        motion = Motion(
            mechanism=tracer.mechanism,
            joints=tracer.solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=count,
            sample=np.tile(samples, modes),
            assembly_mode=np.repeat([m.number for m in tracer.assembly_modes], count),
            inputs=q.T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.closure[0].copy(),
            is_path=tracer.input_grid.is_path,
            timing=None if timing is None else timing.rows(samples).repeated(modes),
            singular_error=rows.singular_error,
        )
        if len(doubtful):
            rows.closure[1, doubtful] = motion.rows(doubtful).configuration_error
        vars(motion)["configuration_error"] = rows.closure[1]
        held = ~failed.reshape(modes, count)
        careful = careful.reshape(held.shape)
        every = range(len(self.requests))
        stops = [stops_of(seen, k, held, careful) for k in every if motion.is_path]
        largest = np.fmax.reduce(
            [nans((len(every), 3)), *(np.array(here.errors) for _, here in seen)]
        )
        self.unread[id(motion)] = rows.vouched, held, doubtful, stops, largest
        return motion
