"""Figures of merit of designs in their assembly modes, from the samples of a kernel."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.contract import Merit, Reducing
from spherekit.analysis.running.sampling import UNIT_SPEED, check_time
from spherekit.arrays import Array, Bools, Floats, Integers
from spherekit.conventions import counted, listing
from spherekit.design.profile_numbers import columns_of
from spherekit.design.variables import OK, reason_of
from spherekit.engine.design_kernel import DesignKernel
from spherekit.engine.row_quantities import row_quantities, sample_names
from spherekit.errors import (
    DesignError,
    FileError,
    ModelError,
    PlanError,
    SolveError,
    SpherekitError,
)
from spherekit.model.joints import Track
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import ConstantSpeed, Study
from spherekit.motion.input_grid import InputGrid, given_path, grid, straight
from spherekit.motion.motion import by_laws
from spherekit.numeric.crossings import return_by_turns
from spherekit.numeric.zeros import ArrayRows
from spherekit.planning.inputs import driven_pairs
from spherekit.sphere.rotation import all_finite, nans

BLOCK = 4096
"""Designs evaluated together: their rows stay in the cache."""
INERTIAL = ("B", "dB_dq", "torque")
"""How quantities begin that depend on masses or loads."""
NEVER_CLOSES = "NEVER_CLOSES"
IMPOSSIBLE = "IMPOSSIBLE"
"""The numbers of a design make no mechanism that moves as the file's does."""
FAILED = "FAILED"
"""The design may be fine; what was asked of it failed."""
NEVER = "does not close at any sample"


@final
@dataclass(frozen=True)
class DesignSamples:
    """The inputs at every sample.

    `rows` (samples, 3 inputs + 1): angles (rad) of the `inputs`, rates, accelerations, and
    the time. `shape` counts the samples along a path, or along each axis of a grid.
    """

    inputs: tuple[str, ...]
    rows: Floats
    shape: tuple[int, ...]

    @staticmethod
    def of(study: Study) -> "DesignSamples":
        """Return the samples of a study, by its laws if it has some.

        Raises
        ------
        DesignError
            If it is a simulation, or so many samples are of another number of inputs.
        """
        mechanism = study.mechanism
        if study.start is not None:
            raise DesignError(
                f"{study.name}: designs are compared at samples of inputs, not along "
                "simulations; drive them"
            )
        check_time(study)
        if not mechanism.inputs:
            (pair,) = driven_pairs(mechanism)
            mechanism = mechanism.with_inputs(mechanism.pairs[pair].name)
        names = mechanism.input_pairs
        start = np.array([driven.start for driven in mechanism.inputs])
        if study.path is not None:
            path = given_path(study.path, len(names)).q
            start = np.min(path, axis=0) if len(names) == 1 else path[0]
            return DesignSamples.at(names, path, start, np.ones(len(names)))
        if study.duration is not None:
            return DesignSamples._timed(study, mechanism, names)
        lattice = _lattice(study, mechanism)
        sense = np.array([driven.sense for driven in mechanism.inputs])
        return DesignSamples.at(names, lattice.q, start, sense, lattice.shape)

    @staticmethod
    def _timed(
        study: Study, mechanism: Mechanism, names: tuple[str, ...]
    ) -> "DesignSamples":
        if not isinstance(study.samples, int):
            raise DesignError(f"{study.name}: over a time give one number of samples")
        assert study.duration is not None
        t = np.linspace(0.0, study.duration, study.samples)
        laws = {
            driven.pair: ConstantSpeed(driven.sense * UNIT_SPEED, driven.start)
            for driven in mechanism.inputs
        }
        q, timing = by_laws(names, {**laws, **study.laws}, t)
        rows = np.concatenate([q, timing.dq, timing.ddq, t[:, None]], axis=1)
        return DesignSamples(names, rows, (len(t),))

    @staticmethod
    def at(
        inputs: Sequence[str],
        q: Floats,
        start: Floats,
        sense: Floats,
        shape: tuple[int, ...] | None = None,
    ) -> "DesignSamples":
        """Return samples q (n, inputs) of inputs that turn at unit speed from a start.

        `sense` (inputs,) is 1 of those that rise and -1 of those that fall.
        """
        n = len(q)
        rates = np.broadcast_to(UNIT_SPEED * sense, q.shape)
        time = (q[:, :1] - start[0]) * sense[0] / UNIT_SPEED
        rows = np.concatenate([q, rates, np.zeros_like(q), time], axis=1)
        return DesignSamples(tuple(inputs), rows, shape or (n,))

    @property
    def returns(self) -> bool:
        """Whether a path ends at the inputs of its start, after whole turns."""
        first, last = self.rows[[0, -1], : len(self.inputs)]
        return len(self.shape) == 1 and return_by_turns(first, last)

    @property
    def lattice(self) -> InputGrid:
        """The inputs with their neighbours."""
        return InputGrid(self.rows[:, : len(self.inputs)], self.shape)


def _lattice(study: Study, mechanism: Mechanism) -> InputGrid:
    count, samples = len(mechanism.inputs), study.samples
    if isinstance(samples, int):
        if study.grid:
            return grid(mechanism.inputs, [samples] * count)
        return straight(mechanism.inputs, samples)
    if len(samples) != count:
        raise DesignError(
            f"{study.name}: samples: {'x'.join(map(str, samples))} is of {len(samples)} "
            f"inputs, but there are {count}; give one number for each"
        )
    return grid(mechanism.inputs, samples)


@final
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
        numbers = np.asarray(design, dtype=np.int64)
        if not isinstance(merits, Mapping):
            merits = {name: nans(len(numbers)) for name in merits}

        def each(item: Any, kind: type = object) -> Array:
            return np.broadcast_to(np.asarray(item, dtype=kind), len(numbers))

        shares, words = each(closes, float), (each(status), each(reason), each(claim))
        return Evaluated(numbers, each(mode), shares, *words, merits)

    @staticmethod
    def in_order(parts: "Sequence[Evaluated]") -> "Evaluated":
        """Return several in order of design, then as they come."""
        made = Evaluated.joined(parts)
        return made.rows(np.argsort(made.design, kind="stable"))


def refused(problem: SpherekitError, names: Sequence[str]) -> Evaluated:
    """Return the row of one design that ended in an error, without figures of `names`."""
    status = FAILED
    if isinstance(problem, FileError | ModelError | PlanError):
        status = IMPOSSIBLE
    elif isinstance(problem, SolveError):
        status = NEVER_CLOSES
    return Evaluated.of([0], names, status=status, reason=reason_of(problem))


@final
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
        self, mechanism: Mechanism, merits: Sequence[Merit], samples: DesignSamples
    ) -> None:
        self.merits, self.inputs, self.samples = tuple(merits), samples.inputs, samples
        self.names = [merit.name for merit in merits]
        names = row_quantities(mechanism.with_inputs(*self.inputs))
        self._check(mechanism)
        self.expressions = [merit.parsed(names) for merit in merits]
        used = sorted(set().union(*(item.names for item in self.expressions)))
        self.sample = sample_names(self.inputs)
        self.columns = [name for name in used if name not in self.sample]
        count = len(self.inputs)
        points = sorted({merit.point for merit in merits if merit.point})
        start, sense = np.split(samples.rows[0, : 2 * count], 2)
        q = np.array(points).reshape(-1, count)
        self.points = DesignSamples.at(self.inputs, q, start, np.sign(sense)).rows
        self.rows = np.concatenate([samples.rows, self.points])

    def _check(self, mechanism: Mechanism) -> None:
        """Raise `DesignError` where a figure is at inputs that the mechanism has not."""
        name, count = mechanism.name, len(self.inputs)
        for merit in self.merits:
            if merit.point and len(merit.point) != count:
                raise DesignError(
                    f"{name}: {merit.name}: at needs {counted(count, 'input')} "
                    f"({listing(self.inputs)}), not {len(merit.point)}"
                )
            if merit.reduction.startswith("arg") and count > 1:
                if merit.place not in self.inputs:
                    raise DesignError(
                        f"{name}: {merit.name}: there are {counted(count, 'input')}: say "
                        f"whose value is wanted, {merit.reduction}({merit.expression}, "
                        f"{self.inputs[0]})"
                    )
            elif merit.place not in ("", *self.inputs):
                raise DesignError(
                    f"{name}: {merit.name}: {merit.place} is not driven; driven are "
                    f"{listing(self.inputs)}"
                )
            if merit.reduction == "swing" and len(self.samples.shape) > 1:
                raise DesignError(
                    f"{name}: {merit.name}: swing follows an angle along a path, and the "
                    "samples are a grid; take the range of a sine or cosine"
                )

    @property
    def read_inertia(self) -> bool:
        """Whether a figure depends on masses or loads."""
        return any(name.split("_by_")[0].startswith(INERTIAL) for name in self.columns)

    def of(
        self,
        kernel: DesignKernel,
        prepared: Floats,
        places: Floats,
        turns: Floats,
        modes: Any,
        claim: str,
        tracks: Sequence[Track] = (),
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
        n, samples = prepared.shape[1], len(self.samples.rows)
        returns, closes = self.samples.returns, np.zeros(n)
        reducing = [Reducing(merit, n, returns) for merit in self.merits]
        evaluated = _sampled(kernel, prepared, self.rows, places, turns, tracks)
        with np.errstate(all="ignore"):
            for number, (sample, columns, closed) in enumerate(evaluated):
                at_point = number >= samples
                if not at_point:
                    closes += closed
                self._take(reducing, sample, columns, closed, at_point)
        rows = np.flatnonzero(closes > 0)
        figures = {
            name: reduction.result()[rows]
            for name, reduction in zip(self.names, reducing, strict=True)
        }
        labels = np.broadcast_to(np.asarray(modes, dtype=object), n)[rows]
        return Evaluated.of(rows, figures, labels, closes[rows] / samples, claim=claim)

    def _take(
        self,
        reducing: Sequence[Reducing],
        sample: Floats,
        columns: Floats,
        closed: Bools,
        at_point: bool,
    ) -> None:
        """Take the columns (c, n) at a sample, of designs that `closed` (n,).

        By figures over all samples, or by those `at_point`, that sample.
        """
        point = tuple(map(float, sample[: len(self.inputs)])) if at_point else ()
        quantities: dict[str, Any] = dict(zip(self.columns, columns, strict=True))
        quantities |= dict(zip(self.sample, sample, strict=True))
        for merit, expression, reduction in zip(
            self.merits, self.expressions, reducing, strict=True
        ):
            if merit.point == point:
                given = {name: quantities[name] for name in expression.names}
                values = np.broadcast_to(expression.evaluate(given), len(closed))
                place = self.inputs.index(merit.place) if merit.place else 0
                reduction.take(float(sample[place]), np.where(closed, values, np.nan))


def _sampled(
    kernel: DesignKernel,
    prepared: Floats,
    samples: Floats,
    places: Floats,
    turns: Floats,
    tracks: Sequence[Track],
) -> Iterator[tuple[Floats, Floats, Bools]]:
    """Yield each sample (of k), the columns (c, n) there and who closes (n,).

    As many at once as pay.
    """
    n, together = prepared.shape[1], max(1, BLOCK // max(1, prepared.shape[1]))
    for start in range(0, len(samples), together) if n else ():
        some = slice(start, start + together)
        here, placed = samples[some], places[:, some]
        shape = len(here), n
        parts = [np.broadcast_to(here.T[:, :, None], (samples.shape[1], *shape)), placed]
        if tracks:
            columns = columns_of(tracks, placed.reshape(len(placed), -1).T)
            parts.append(columns.reshape(-1, *shape))
        parts += [
            turns[:, some],
            np.broadcast_to(prepared[:, None], (len(prepared), *shape)),
        ]
        rows = np.concatenate(parts).reshape(-1, len(here) * n)
        outputs = np.reshape(kernel.evaluate(rows), (-1, *shape))
        closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0)
        closed &= all_finite(placed[:1], 0)
        for k, sample in enumerate(here):
            yield sample, outputs[kernel.reaches :, k], closed[k]
