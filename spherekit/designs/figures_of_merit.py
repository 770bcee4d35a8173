"""Figures of merit of designs in their assembly modes, from the samples of a kernel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Array, Floats, Indices, Integers
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel, RedundantKernel
from spherekit.designs.design_variables import OK, reason_of
from spherekit.designs.profile_numbers import columns_of
from spherekit.errors import (
    DesignError,
    FileError,
    ModelError,
    PlanError,
    SolveError,
    SpherekitError,
)
from spherekit.files.study import Crossings, Study
from spherekit.files.time_law import ConstantSpeed
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.joint import ContactProfile
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import SAME_ANGLE_RAD, return_after_revolutions, wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.input_grid import InputGrid, make_input_grid
from spherekit.positions.timing import evaluate_time_laws
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.sampling import check_time
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.velocities.row_quantities import row_quantities, sample_names
from spherekit.wording import counted, listing

BLOCK = 4096
"""Designs evaluated together: their rows stay in the cache."""
INERTIAL = ("B", "dB_dq", "kinetic_energy", *LOAD_DEPENDENT_PREFIXES)
"""How quantities begin that depend on masses or loads."""
NEVER_CLOSES = "NEVER_CLOSES"
IMPOSSIBLE = "IMPOSSIBLE"
"""The numbers of a design make no mechanism that moves as the file's does."""
FAILED = "FAILED"
"""The design may be fine; what was asked of it failed."""
NEVER = "does not close at any sample"


@dataclass(frozen=True)
class DesignSamples:
    """The inputs at every sample.

    `rows` (samples, 3 inputs + 1): angles (rad) of the `inputs`, rates, accelerations, and
    the time. `shape` counts the samples along a path, or along each axis of a grid.
    `crossings` says whether modes follow smooth curves where curves cross ("pass").
    """

    inputs: Names
    rows: Floats
    shape: tuple[int, ...]
    crossings: Crossings = "end"

    @staticmethod
    def of(study: Study) -> "DesignSamples":
        """Return the samples of a study, by its laws if it has some.

        Raises
        ------
        DesignError
            If it is a simulation.
        SolveError
            If a range is empty, or so many samples are of another number of inputs.
        """
        mechanism = driven_at(study.mechanism)
        if study.start is not None:
            raise DesignError(
                f"{study.name}: designs are compared at samples of inputs, not along "
                "simulations; drive them"
            )
        check_time(study)
        names = mechanism.input_pairs
        if study.duration is not None:
            assert isinstance(study.samples, int)
            t = np.linspace(0.0, study.duration, study.samples)
            laws = {
                driven.pair: ConstantSpeed(driven.sense, driven.start)
                for driven in mechanism.inputs
            }
            q, timing = evaluate_time_laws(names, {**laws, **study.laws}, t)
            rows = np.column_stack([q, timing.dq, timing.ddq, t])
            return DesignSamples(names, rows, (len(t),), study.crossings)
        lattice = make_input_grid(mechanism, study.samples, study.grid, study.path)
        start, sense = np.array([(x.start, x.sense) for x in mechanism.inputs]).T
        if study.path is not None:
            start = np.min(lattice.q, axis=0) if len(names) == 1 else lattice.q[0]
            sense = np.ones(len(names))
        samples = DesignSamples.at(names, lattice.q, start, sense, lattice.shape)
        return replace(samples, crossings=study.crossings)

    @staticmethod
    def at(
        inputs: Names,
        q: Floats,
        start: Floats,
        sense: Floats,
        shape: tuple[int, ...] | None = None,
    ) -> "DesignSamples":
        """Return samples q (n, inputs) of inputs that turn at 1 rad/s from a start.

        `sense` (inputs,) is 1 of those that rise and -1 of those that fall.
        """
        rates = np.broadcast_to(sense, q.shape)
        time = (q[:, 0] - start[0]) * sense[0]
        return DesignSamples(
            inputs, np.column_stack([q, rates, np.zeros_like(q), time]), shape or (len(q),)
        )

    @property
    def returns(self) -> bool:
        """Whether a path ends at the inputs of its start, after whole turns."""
        first, last = self.rows[[0, -1], : len(self.inputs)]
        return len(self.shape) == 1 and return_after_revolutions(first, last)

    @property
    def lattice(self) -> InputGrid:
        """The inputs with their neighbours."""
        return InputGrid(self.rows[:, : len(self.inputs)], self.shape)


@dataclass(frozen=True)
class Evaluated(ArrayRows):
    """Designs in their assembly modes: one row for each that closes, one for the others.

    `design` (n,) counts within what was given, `mode` (n,) says which assembly mode, ""
    where none closes; `closes` (n,) is the share of samples that do, `status` (n,) a word,
    `reason` (n,) why there are no figures, "" where there are, `claim` (n,) what is
    guaranteed of the modes of the design at the samples, `merits` the figures (n,) by name,
    in rad and SI.
    """

    design: Integers
    mode: NDArray[np.object_]
    closes: Floats
    status: NDArray[np.object_]
    reason: NDArray[np.object_]
    claim: NDArray[np.object_]
    merits: Mapping[str, Floats]

    @staticmethod
    def of(
        design: Any,
        merits: Mapping[str, Floats] | Sequence[str],
        mode: Any = "",
        closes: Any = 0.0,
        status: Any = OK,
        reason: Any = "",
        claim: Any = "",
    ) -> "Evaluated":
        """Return rows, what is one for all said once; of figures by name alone none is."""
        numbers = np.asarray(design, np.int64)
        if not isinstance(merits, Mapping):
            merits = {name: nans(len(numbers)) for name in merits}

        def each(item: Any, kind: type = object) -> Array:
            return np.broadcast_to(np.asarray(item, kind), len(numbers))

        shares = each(closes, float)
        words = (each(status), each(reason), each(claim))
        return Evaluated(numbers, each(mode), shares, *words, merits)

    @staticmethod
    def in_order(parts: "Sequence[Evaluated]", names: Sequence[str]) -> "Evaluated":
        """Return several with figures of these names by design, then as they come."""
        made = Evaluated.joined([Evaluated.of([], names), *parts])
        return made.rows(np.argsort(made.design, kind="stable"))


def refused(problem: SpherekitError, names: Sequence[str]) -> Evaluated:
    """Return the row of one design that ended in an error, without figures of `names`."""
    status = FAILED
    if isinstance(problem, FileError | ModelError | PlanError):
        status = IMPOSSIBLE
    elif isinstance(problem, SolveError):
        status = NEVER_CLOSES
    return Evaluated.of([0], names, status=status, reason=reason_of(problem))


class KernelFigures:
    """What figures of merit read of samples, and what they make of it.

    Their `expressions` are of the `sample` itself and of the `columns` of a kernel.
    `points` (m, 3 inputs + 1) are further samples, for figures at given inputs.

    Raises
    ------
    DesignError
        If a figure is at inputs that the mechanism has not.
    AnalysisError
        If it reads what is no quantity of a row.
    """

    def __init__(
        self, mechanism: Mechanism, merits: Sequence[FigureOfMerit], samples: DesignSamples
    ) -> None:
        self.merits, self.inputs, self.samples = merits, samples.inputs, samples
        self.names = [merit.name for merit in merits]
        names = row_quantities(mechanism.with_inputs(*self.inputs))
        self._check(mechanism)
        self.expressions = [merit.parsed(names) for merit in merits]
        used = set[str]().union(*(item.names for item in self.expressions))
        self.sample = sample_names(self.inputs)
        self.columns = sorted(used.difference(self.sample))
        count = len(self.inputs)
        points = sorted({merit.point for merit in merits if merit.point})
        start, sense = np.split(samples.rows[0, : 2 * count], 2)
        self.points = DesignSamples.at(
            self.inputs, np.reshape(points, (-1, count)), start, np.sign(sense)
        ).rows
        self.rows = np.concatenate([samples.rows, self.points])

    def _check(self, mechanism: Mechanism) -> None:
        """Raise `DesignError` where a figure is at inputs that the mechanism has not."""
        count = len(self.inputs)
        for merit in self.merits:
            said = ""
            if merit.point and len(merit.point) != count:
                said = (
                    f"at needs {counted(count, 'input')} ({listing(self.inputs)}), not "
                    f"{len(merit.point)}"
                )
            elif merit.reduction.startswith("arg") and count > 1 and not merit.place:
                said = (
                    f"there are {counted(count, 'input')}: say whose value is wanted, "
                    f"{merit.reduction}({merit.expression}, {self.inputs[0]})"
                )
            elif merit.place not in ("", *self.inputs):
                said = f"{merit.place} is not driven; driven are {listing(self.inputs)}"
            if merit.reduction == "swing" and len(self.samples.shape) > 1:
                said = (
                    "swing follows an angle along a path, and the samples are a grid; take "
                    "the range of a sine or cosine"
                )
            if said:
                raise DesignError(f"{mechanism.name}: {merit.name}: {said}")

    def rows_of(self, merit: FigureOfMerit) -> Indices:
        """Return the numbers of the `rows` that a figure is of: samples, or its point."""
        count = len(self.samples.rows)
        if not merit.point:
            return np.arange(count)
        return count + np.flatnonzero(
            np.all(self.points[:, : len(self.inputs)] == merit.point, axis=1)
        )

    def reduced(self, merit: FigureOfMerit, values: Floats) -> Floats:
        """Return the figure (n,) of values (rows, n) at `rows_of` it."""
        place = self.inputs.index(merit.place) if merit.place else 0
        q = self.rows[self.rows_of(merit), place]
        return reduced(merit.reduction, q, values, self.samples.returns)

    def of(
        self,
        kernel: DesignKernel | RedundantKernel,
        prepared: Floats,
        places: Floats,
        turns: Floats,
        modes: Any,
        claim: str,
        tracks: Sequence[ContactProfile] = (),
    ) -> Evaluated:
        """Return the figures of the rows (n,) that close at a sample, by their numbers.

        Parameters
        ----------
        kernel, prepared
            (k, n), what the kernel has of the designs.
        places, turns
            (w, samples and points, n) and (pairs, samples and points, n) rad.
        modes, claim
            What modes are called, (n,) or one, and what is guaranteed of them.
        tracks
            The profiles of all, where some are handed in.
        """
        n, count = prepared.shape[1], len(self.rows)
        values = np.empty((len(self.merits), count, n))
        closed = np.empty((count, n), bool)
        together = max(1, BLOCK // max(1, n))
        with np.errstate(all="ignore"):
            for start in range(0, count, together) if n else ():
                some = slice(start, start + together)
                placed, shape = places[:, some], closed[some].shape
                sample = np.broadcast_to(
                    self.rows[some].T[:, :, None], (len(self.sample), *shape)
                )
                parts = [sample, placed]
                if tracks:
                    columns = columns_of(tracks, placed.reshape(len(placed), -1).T)
                    parts.append(columns.reshape(-1, *shape))
                fixed = np.broadcast_to(prepared[:, None], (len(prepared), *shape))
                rows = np.concatenate([*parts, turns[:, some], fixed])
                outputs = kernel.evaluate(rows.reshape(len(rows), -1)).reshape(-1, *shape)
                closed[some] = all_finite(placed[:1], 0) & np.all(
                    outputs[: kernel.reaches] >= 0.0, axis=0
                )
                quantities = dict(zip(self.sample, sample, strict=True))
                quantities |= zip(self.columns, outputs[kernel.reaches :], strict=True)
                for made, expression in zip(values, self.expressions, strict=True):
                    given = {name: quantities[name] for name in expression.names}
                    made[some] = expression.evaluate(given)
            values[:, ~closed] = np.nan
            closes = np.mean(closed[: len(self.samples.rows)], axis=0)
            chosen = np.flatnonzero(closes)
            by_name = {
                merit.name: self.reduced(merit, of_merit[self.rows_of(merit)])[chosen]
                for merit, of_merit in zip(self.merits, values, strict=True)
            }
        labels = np.broadcast_to(np.asarray(modes, object), n)[chosen]
        return Evaluated.of(chosen, by_name, labels, closes[chosen], claim=claim)


def reduced(kind: str, q: Floats, values: Floats, returns: bool = False) -> Floats:
    """Return a figure (n,) of values (k, n), NaN where there is none, at inputs q (k,).

    `returns` says that the inputs of the last row are those of the first but for turns.
    """
    if not len(values):
        return nans(values.shape[1])
    if kind == "swing":
        return widest_swings(values, returns)[0]
    if kind == "at":
        return values[-1]
    if kind.startswith("arg"):
        signed = values if kind == "argmin" else -values
        row = np.argmin(np.nan_to_num(signed, nan=np.inf), axis=0)
        return np.where(np.any(np.isfinite(values), axis=0), q[row], np.nan)
    with np.errstate(all="ignore"):
        if kind in ("min", "max"):
            return np.asarray((np.fmin if kind == "min" else np.fmax).reduce(values))
        if kind == "range":
            return np.fmax.reduce(values) - np.fmin.reduce(values)
        finite = np.isfinite(values)
        part = values * values if kind == "rms" else values
        total = np.sum(part, axis=0, where=finite)
        count = np.sum(finite, axis=0)
        if kind == "sum":
            return np.where(count > 0, total, np.nan)
        return np.sqrt(total / count) if kind == "rms" else np.asarray(total / count)


def widest_swings(angles: Floats, returns: bool) -> tuple[Floats, Indices, Indices]:
    """Return how far angles (k, n) rad swing in one piece, and where they end (n,).

    NaN parts pieces; where the way `returns`, the last goes on with the first if they meet.
    """
    # Once more round leads from the last piece into the first, where there are several.
    meets = np.abs(wrap(angles[-1] - angles[0])) < SAME_ANGLE_RAD
    again = np.where(meets & np.any(np.isnan(angles), axis=0), angles, np.nan)
    every = np.concatenate([angles, again]) if returns else angles
    steps = wrap(np.diff(every, axis=0, prepend=np.nan)).T
    starts = np.flatnonzero(np.isnan(steps))
    piece = np.cumsum(np.isnan(steps)) - 1
    reached = np.cumsum(np.nan_to_num(steps), axis=1).ravel()
    sides = [x.reduceat(reached, starts) for x in (np.minimum, np.maximum)]
    swings = sides[1] - sides[0]
    columns = starts // len(every)
    order = np.lexsort((-swings, columns))
    widest = order[np.searchsorted(columns, np.arange(angles.shape[1]))]
    ends = [np.flatnonzero(reached == side[piece]) for side in sides]
    low, high = (
        x[np.searchsorted(x, starts[widest])] % len(every) % len(angles) for x in ends
    )
    return np.where(np.any(np.isfinite(angles), axis=0), swings[widest], np.nan), low, high
