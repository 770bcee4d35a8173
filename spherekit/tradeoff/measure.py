"""Running settings against each other in one process, and against the reference."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.batch import Batch
from spherekit.analysis.computed import computed
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.needs import Needs
from spherekit.analysis.requests import requests_for
from spherekit.analysis.rows import InMemory
from spherekit.analysis.running.evaluation import Evaluation
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.running.sampling import Sampling
from spherekit.analysis.running.setting import Setting
from spherekit.analysis.tables import TableArrays, arrays
from spherekit.conventions import Status
from spherekit.errors import SpherekitError
from spherekit.motion.continued import AngleMemory
from spherekit.motion.motion import Motion
from spherekit.progress import Working
from spherekit.proof.balls import Balls
from spherekit.proof.rows import exact_field, exact_motion, exact_rows
from spherekit.rates.field import evaluate
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.signs import SignMemory
from spherekit.sphere.rotation import Floats
from spherekit.tradeoff.deviation import Deviation, deviations, worst
from spherekit.tradeoff.effort import Effort
from spherekit.tradeoff.record import Measured

LEAST_ROUNDS = 2

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

Tables = Mapping[str, TableArrays]
Found = tuple[str, float, Tables, list[Measured]]
"""What the reference is in words, how well it is known, its tables, and the settings."""


class Runner(Protocol):
    """Something that can be run and timed: returns tables, and processor times (s).

    First the time before any sample, then that of everything.
    """

    def __call__(self, judged: bool) -> tuple[Tables, float, float]:
        """Run it once; `judged` says that its tables count, otherwise its times do."""


@final
@dataclass(frozen=True)
class Reference:
    """Tables from reference values, the fields behind them, and rows without any."""

    tables: Tables
    fields: tuple[PoleField, ...]
    lacking: int

    @property
    def without(self) -> str:
        """What is to be said of rows without reference values."""
        return f", {self.lacking} rows without" if self.lacking else ""


@final
@dataclass(frozen=True)
class Benchmark:
    """An analysis over a course, to be run by any setting."""

    course: Sampling
    analysis: AbstractAnalysis
    needs: Needs

    @staticmethod
    def of(course: Sampling, analysis: AbstractAnalysis) -> "Benchmark":
        """Return the bench of an analysis; `AnalysisError` for bad parameters."""
        return Benchmark(course, analysis, declared(analysis, course.tracer.mechanism))

    @property
    def reads_poles(self) -> bool:
        """Whether anything of what is read depends on settings of the samples."""
        needs = self.needs
        return bool(
            needs.directions
            or needs.rates
            or needs.link_rates
            or needs.pair_rates
            or needs.pair_values
            or needs.continued_values
            or needs.rotations
        )

    def tables(
        self, setting: Setting, toward: Reference | None = None
    ) -> tuple[Tables, float, float]:
        """Return the tables by a setting, see `Runner`.

        The signs of directions follow from the samples, not from a setting. To compare
        errors they are those of a reference, `toward` which they are turned.
        """
        started = time.process_time()
        course, analysis = self.course, self.analysis
        wanted = self._wanted()
        evaluation = Evaluation(setting, course, wanted, self.needs)
        first = time.process_time() - started
        signs, memory = [SignMemory() for _ in evaluation.requests], AngleMemory()
        mechanism, store = course.tracer.mechanism, InMemory()
        tables = [table.of(mechanism) for table in analysis.tables]
        size = evaluation.block if analysis.rowwise else len(course)
        for motion in evaluation.blocks(size):
            fields: tuple[PoleField | UnreadField, ...]
            fields = evaluation.fields(motion, signs)
            angles = evaluation.angles(motion, memory)
            if toward is not None:
                rows = motion.sample + np.repeat(
                    np.arange(len(motion.assembly_modes)) * len(course), motion.samples
                )
                fields = tuple(
                    _turned(field.made, other, rows)
                    for field, other in zip(fields, toward.fields, strict=True)
                )
            made = self._computed(self._batch(wanted, motion, fields, angles))
            for table in tables:
                store.add(analysis.name, table, made[table.name])
        whole = {table.name: store.table(analysis.name, table) for table in tables}
        return whole, first, time.process_time() - started

    def reference(self) -> Reference:
        """Return the tables from reference values at all samples."""
        (motion,) = self.course.blocks(len(self.course))
        return self.reference_at(motion)

    def checked(self, setting: Setting, most: int) -> tuple[list[Deviation], int]:
        """Return how far a setting is off at some samples, and their number of rows.

        The samples are spread over the course: at most so many, chosen apart from any
        regular pattern.
        """
        course, needs = self.course, self.needs
        total = len(course)
        rows = np.arange(total)
        if total > most:
            shares = (np.arange(most) + (np.arange(most) * GOLDEN) % 1.0) / most
            rows = np.unique((shares * total).astype(np.intp))
        wanted = self._wanted()
        evaluation = Evaluation(setting, course, wanted, needs)
        motion = evaluation.motion_at(rows)
        plain = Evaluation(Setting(), course, wanted, needs).motion_at(rows)
        reference = self.reference_at(plain)
        memories = [SignMemory() for _ in evaluation.requests]
        every = np.arange(len(motion))
        fields = tuple(
            _turned(field.made, other, every)
            for field, other in zip(
                evaluation.fields(motion, memories), reference.fields, strict=True
            )
        )
        angles = evaluation.angles(motion, AngleMemory())
        given = self._computed(self._batch(wanted, motion, fields, angles))
        return self.deviations(given, reference.tables), len(motion)

    def _computed(self, batch: Batch) -> Tables:
        tables = [table.of(batch.mechanism) for table in self.analysis.tables]
        made = computed(self.analysis, tables, batch)
        return {name: arrays(data) for name, data in made.items()}

    def _batch(
        self,
        wanted: Sequence[Request],
        motion: Motion,
        fields: tuple[PoleField | UnreadField, ...],
        angles: Mapping[str, Floats],
    ) -> Batch:
        course, plans = self.course, tuple(item.plan for item in wanted)
        made = motion.mechanism, plans, self.needs, motion, fields, angles
        return Batch(*made, course.timed, course.tracer)

    def _wanted(self) -> Sequence[Request]:
        tracer = self.course.tracer
        return requests_for(tracer.mechanism, self.needs, tracer.by_rank)

    def reference_at(self, motion: Motion, inputs: Balls | None = None) -> Reference:
        """Return the tables at the rows of a motion, see `Reference`.

        They hold the float64 numbers nearest to configurations and rates that the closure
        equations give in 20 digits; see `spherekit.proof`. The motion's inputs are
        taken as exact, or else `inputs` (n, inputs), which they are rounded from.
        """
        wanted = self._wanted()
        every = np.ones(len(motion), dtype=bool)
        exact = [
            exact_rows(motion, every, item.plan.input, inputs=inputs) for item in wanted
        ]
        better = replace(exact_motion(motion, every, exact[0]), samples=motion.samples)
        fields = tuple(
            exact_field(rows, item, evaluate(motion, item))
            for rows, item in zip(exact, wanted, strict=True)
            if item.poles
        )
        lacking = (motion.status == Status.OK) & (exact[0].status != Status.OK)
        angles = self.course.angles(better, self.needs.continued_values, AngleMemory())
        tables = self._computed(self._batch(wanted, better, fields, angles))
        return Reference(tables, fields, int(np.sum(lacking)))

    def deviations(self, given: Tables, reference: Tables) -> list[Deviation]:
        """Return how far tables are off, column by column."""
        mechanism = self.course.tracer.mechanism
        tables = [table.of(mechanism) for table in self.analysis.tables]
        return list(deviations(tables, given, reference))


def _turned(field: PoleField, toward: PoleField, rows: NDArray[np.intp]) -> PoleField:
    """Return a field with directions on the side of another's at these rows of it."""
    signs = {
        pole: np.where(np.sum(u * toward.direction[pole][rows], axis=1) < 0.0, -1.0, 1.0)
        for pole, u in field.direction.items()
    }
    return replace(
        field,
        direction={pole: u * signs[pole][:, None] for pole, u in field.direction.items()},
        velocity_coefficient={
            pole: x * signs[pole] for pole, x in field.velocity_coefficient.items()
        },
        acceleration_coefficient={
            pole: x * signs[pole] for pole, x in field.acceleration_coefficient.items()
        },
        direction_dq={
            pole: u * signs[pole][:, None] for pole, u in field.direction_dq.items()
        },
    )


def timing_loop(
    ways: Sequence[tuple[str, Setting | None, Runner]],
    judge: Callable[[Tables], Sequence[Deviation]],
    samples: int,
    effort: Effort,
) -> list[Measured]:
    """Return every way with its error and its times over alternating rounds.

    Parameters
    ----------
    ways
        Their names, settings, and what runs them.
    judge
        How far tables are off.
    samples
        How many samples each runs.
    effort
        How often, and after how many seconds no further round begins.
    """
    began = time.monotonic()
    measured: dict[str, Measured] = {}
    working = Working("measuring settings")
    for done, (name, setting, way) in enumerate(ways):
        working.tell(f"{name}, {done + 1} of {len(ways)}".__str__)
        measured[name] = _judged(name, setting, way, judge)
    alive = [(name, way) for name, _, way in ways if not measured[name].reason]
    times: dict[str, list[tuple[float, float]]] = {name: [] for name, _ in alive}
    for number in range(effort.rounds):
        if number >= LEAST_ROUNDS and time.monotonic() - began > effort.budget:
            break
        for name, way in alive if number % 2 == 0 else alive[::-1]:
            _, first, seconds = way(False)
            times[name].append((first, seconds - first))
            working.tell(f"{name}, round {number + 1} of {effort.rounds}".__str__)
    for name, rounds in times.items():
        made = measured[name].setting
        compiles = made is not None and made.compiles
        before, after = np.array(rounds).T
        first = float(np.min(before))
        measured[name] = replace(
            measured[name],
            first=first,
            per_sample=float(np.min(after)) / samples,
            per_sample_median=float(np.median(after)) / samples,
            compile=max(measured[name].compile - first, 0.0) if compiles else 0.0,
        )
    return list(measured.values())


def _judged(
    name: str,
    setting: Setting | None,
    way: Runner,
    judge: Callable[[Tables], Sequence[Deviation]],
) -> Measured:
    """Return a way with its error, or the reason why it does not apply."""
    try:
        tables, first, _ = way(True)
        off = judge(tables)
    except SpherekitError as problem:
        return Measured(name, setting, reason=problem.fault)
    largest = worst(off)
    return Measured(
        name,
        setting,
        error=np.nan if largest is None else largest.error,
        column="" if largest is None else f"{largest.table}.{largest.column}",
        missing=sum(deviation.missing for deviation in off),
        compile=first,
    )
