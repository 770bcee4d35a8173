"""Running settings against each other in one process, and against the reference.

Integrators and tolerances of a simulation, measured against one in more digits.

How far tables are off: the largest scaled deviation of their columns.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from spherekit.analysis.batch import Batch, Needs
from spherekit.analysis.computed import computed
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.rows import InMemory
from spherekit.analysis.running.evaluation import ENGINES, Evaluation, Integrator, Setting
from spherekit.analysis.running.kernel_columns import LazyField
from spherekit.analysis.running.sampling import Sampling, simulated_course
from spherekit.analysis.study import requests_for
from spherekit.analysis.tables import Column, Table, TableData, arrays
from spherekit.argument_validation import check_fields
from spherekit.arrays import Array, Floats, Indices
from spherekit.conventions import EPS, TURN, Status
from spherekit.dynamics.forward import LEAST, simulate
from spherekit.dynamics.reference import refined
from spherekit.dynamics.simulation import Simulation
from spherekit.engine.compiler import available
from spherekit.engine.fields import evaluate
from spherekit.errors import AnalysisError, EngineError, SpherekitError
from spherekit.model.study import Start, Study
from spherekit.motion.motion import AngleUnwrapping, Motion, Timing
from spherekit.numeric.crossings import wrap
from spherekit.progress import ProgressReporter
from spherekit.proof.balls import FEWEST, exactly, floats, pi
from spherekit.proof.rows import exact_field, exact_motion, exact_rows
from spherekit.rates.request import (
    ROUTES,
    PoleField,
    Request,
    SignContinuation,
    turn_round,
)
from spherekit.tradeoff.record import Measured

ROUNDS = 5
"""Times every setting is run, each round in another order; the best counts."""


@dataclass(frozen=True)
class Effort:
    """What is tried when settings are measured, and how long.

    `settings` are those to try; by default all that apply to samples, or to a simulation.
    Errors are measured at most at `checked` samples. Each setting is run in so many
    `rounds` for its time, and after `guarantee` seconds no round begins.
    """

    unused: ClassVar[tuple[str, ...]] = ("tolerance", "verify", "degrees")

    settings: Sequence[Setting] | None = None
    checked: int | None = None
    rounds: int = ROUNDS
    budget: float = 30.0

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "trade")


INTEGRATORS: tuple[Integrator, ...] = ("numpy", "compiled")
DECADES = range(3, 16)
"""Tolerances of simulations, as negative powers of ten."""


def of_samples() -> list[Setting]:
    """Return the settings for samples of the inputs: routes and engines."""
    every = [Setting(route=route) for route in ROUTES]
    return every + [Setting(engine=engine) for engine in ENGINES if engine != "numpy"]


def of_simulation() -> list[Setting]:
    """Return the settings for simulations: integrators and tolerances."""
    return [
        Setting(integrator=integrator, tolerance=float(f"1e-{decade}"))
        for integrator in INTEGRATORS
        for decade in DECADES
        if float(f"1e-{decade}") >= LEAST[integrator]
    ]


@dataclass(frozen=True)
class Deviation:
    """The largest deviation of one column from its reference.

    `error` is in units of `scale`: 1 for absolute errors, else the largest reference. It
    is never given below the rounding of float64. `compared` numbers have a reference;
    `missing` of these are not given.
    """

    table: str
    column: str
    error: float
    scale: float
    compared: int
    missing: int


def is_absolute(column: Column) -> bool:
    """Whether errors of a column are absolute, not relative to its largest number."""
    return column.scale == "absolute" or (column.scale == "unit" and column.unit == "rad")


def scale_words(column: Column) -> str:
    """Return how errors of a column are measured."""
    if is_absolute(column):
        return f"absolute {column.unit}".strip()
    in_unit = f" in {column.unit}" if column.unit else ""
    words = f"relative to the largest number{in_unit} of the table"
    whole = _integrated(column.unit)
    if whole is None:
        return words
    return f"{words}; if that is rounding, {f'in {whole}' if whole else 'without unit'}"


def _integrated(unit: str) -> str | None:
    """Return the unit of what a column is a derivative of by an angle, else None."""
    whole = unit.removesuffix("/rad")
    return None if whole == unit else whole.removeprefix("1")


def deviations(
    tables: Sequence[Table],
    given: Mapping[str, TableData],
    reference: Mapping[str, TableData],
) -> Iterator[Deviation]:
    """Yield the deviation of every column of numbers in tables of equal rows.

    Errors that are not absolute are over the largest reference of all such columns of the
    table with the same unit: a torque that balances others may itself be rounding. Where
    all derivatives by an angle are, they are over what they are derivatives of.
    """
    for table in tables:
        ours, theirs = (arrays(data[table.name]) for data in (given, reference))
        results = [c for c in table.columns if c.kind == "number" and c.scale != "none"]
        largest: dict[str, float] = {}
        for column in results:
            if is_absolute(column):
                continue
            values = np.abs(np.asarray(theirs[column.name], dtype=float))
            size = float(np.max(values[np.isfinite(values)], initial=0.0))
            largest[column.unit] = max(size, largest.get(column.unit, 0.0))
        for column in results:
            scale = 1.0 if is_absolute(column) else _scale(largest, column.unit)
            one = np.asarray(ours[column.name], dtype=float)
            other = np.asarray(theirs[column.name], dtype=float)
            yield _of_column(table.name, column, one, other, scale)


def _scale(largest: Mapping[str, float], unit: str) -> float:
    size, whole = largest[unit], _integrated(unit)
    before = 0.0 if whole is None else largest.get(whole, 0.0)
    return (size if size > EPS * before else before) or 1.0


def _of_column(
    table: str,
    column: Column,
    ours: Array,
    theirs: Array,
    scale: float,
) -> Deviation:
    if len(ours) != len(theirs):
        lost = int(np.sum(np.isfinite(theirs)))
        return Deviation(table, column.name, np.inf, scale, lost, lost)
    expected = np.isfinite(theirs)
    both = expected & np.isfinite(ours)
    off = np.abs(ours[both] - theirs[both])
    if column.unit == "rad":
        off = np.abs(wrap(off))
    error = max(float(np.max(off, initial=0.0)) / scale, EPS)
    missing = int(np.sum(expected & ~both))
    return Deviation(table, column.name, error, scale, int(np.sum(expected)), missing)


def worst(compared: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    told = [deviation for deviation in compared if deviation.compared > deviation.missing]
    return max(told, key=lambda deviation: deviation.error, default=None)


LEAST_ROUNDS = 2

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

Tables = Mapping[str, TableData]
Found = tuple[str, float, Tables, list[Measured]]
"""What the reference is in words, how well it is known, its tables, and the settings."""


Runner = Callable[[bool], tuple[Tables, float, float]]
"""Something that is run once, and timed: returns tables, and processor times (s).

First the time before any sample, then that of everything. It is told whether its tables
count, otherwise its times do."""


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
        evaluation = Evaluation(setting, course, self._wanted, self.needs)
        first = time.process_time() - started
        memories = [SignContinuation() for _ in evaluation.requests], AngleUnwrapping()
        store = InMemory()
        size = evaluation.block if analysis.rowwise else len(course)
        for motion in evaluation.blocks(size):
            modes = np.arange(len(motion.assembly_modes)) * len(course)
            rows = motion.sample + np.repeat(modes, motion.samples)
            made = self._evaluated(evaluation, motion, memories, toward, rows)
            for table in self.tables_of:
                store.add(analysis.name, table, made[table.name])
        whole = {table.name: store.table(analysis.name, table) for table in self.tables_of}
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
        total = len(self.course)
        rows = np.arange(total)
        if total > most:
            shares = (np.arange(most) + (np.arange(most) * GOLDEN) % 1.0) / most
            rows = np.unique((shares * total).astype(np.intp))
        evaluation, plain = (
            Evaluation(item, self.course, self._wanted, self.needs)
            for item in (setting, Setting())
        )
        reference = self.reference_at(plain.motion_at(rows))
        motion = evaluation.motion_at(rows)
        memories = [SignContinuation() for _ in evaluation.requests], AngleUnwrapping()
        every = np.arange(len(motion))
        given = self._evaluated(evaluation, motion, memories, reference, every)
        return self.deviations(given, reference.tables), len(motion)

    def _evaluated(
        self,
        evaluation: Evaluation,
        motion: Motion,
        memories: tuple[Sequence[SignContinuation], AngleUnwrapping],
        toward: Reference | None,
        rows: Indices,
    ) -> dict[str, TableData]:
        """Return tables at a motion, directions turned to a reference's at these rows."""
        fields: Sequence[PoleField | LazyField]
        fields = evaluation.fields(motion, memories[0])
        if toward is not None:
            both = zip(fields, toward.fields, strict=True)
            fields = [_toward(field.made, other, rows) for field, other in both]
        return self._computed(motion, fields, evaluation.angles(motion, memories[1]))

    def _computed(
        self,
        motion: Motion,
        fields: Sequence[PoleField | LazyField],
        angles: Mapping[str, Floats],
    ) -> dict[str, TableData]:
        course, plans = self.course, tuple(item.plan for item in self._wanted)
        made = motion.mechanism, plans, self.needs, motion, tuple(fields), angles
        batch = Batch(*made, course.timed, course.tracer)
        return computed(self.analysis, self.tables_of, batch)

    @property
    def tables_of(self) -> list[Table]:
        """The tables of the analysis."""
        return [table.of(self.course.tracer.mechanism) for table in self.analysis.tables]

    @property
    def _wanted(self) -> Sequence[Request]:
        tracer = self.course.tracer
        return requests_for(tracer.mechanism, self.needs, tracer.by_rank)

    def reference_at(self, motion: Motion, inputs: Array | None = None) -> Reference:
        """Return the tables at the rows of a motion, see `Reference`.

        They hold the float64 numbers nearest to configurations and rates that the closure
        equations give in 20 digits; see `spherekit.proof`. The motion's inputs are
        taken as exact, or else `inputs` (n, inputs), which they are rounded from.
        """
        wanted = self._wanted
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
        angles = self.course.angles(better, self.needs.continued_values, AngleUnwrapping())
        tables = self._computed(better, fields, angles)
        return Reference(tables, fields, int(np.sum(lacking)))

    def deviations(self, given: Tables, reference: Tables) -> list[Deviation]:
        """Return how far tables are off, column by column."""
        return list(deviations(self.tables_of, given, reference))


def _toward(field: PoleField, other: PoleField, rows: Indices) -> PoleField:
    """Return a field with directions on the side of another's at these rows of it."""
    for pole, u in field.direction.items():
        along = np.sum(u * other.direction[pole][rows], axis=1)
        turn_round(field, pole, np.where(along < 0.0, -1.0, 1.0))
    return field


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
    working = ProgressReporter("measuring settings")
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


def measured(bench: Benchmark, study: Study, effort: Effort) -> Found:
    """Return integrators and tolerances with their times and errors.

    `bench` has the course of the study's simulation. The reference is a simulation in
    more digits than float64; where none can be made, the tightest float64 one, and the
    words say why.
    """
    assert study.start is not None
    settings = of_simulation() if effort.settings is None else effort.settings
    solver = _Solver(bench, study.start, study.driving_torque)
    best, simulation, compiling = solver.tightest()
    try:
        right = solver.in_many_digits(simulation)
        tables: Tables = right.tables
        words, near = f"a simulation in {FEWEST} digits{right.without}", []
    except EngineError as reason:
        right = None
        tables, _, _ = solver.tables(best)
        other = replace(best, tolerance=10.0 * LEAST[best.integrator])
        near = bench.deviations(solver.tables(other)[0], tables)
        words = f"simulation {best}, known to {_largest(near):.1e} from {other} "
        words += f"({reason.fault})"
        settings = [setting for setting in settings if setting != best]

    def way(setting: Setting, judged: bool) -> tuple[Tables, float, float]:
        return solver.tables(setting, right if judged else None)

    floors = {(deviation.table, deviation.column): deviation.error for deviation in near}

    def judge(given: Tables) -> list[Deviation]:
        deviations = bench.deviations(given, tables)
        return [
            replace(
                deviation,
                error=max(
                    deviation.error, floors.get((deviation.table, deviation.column), EPS)
                ),
            )
            for deviation in deviations
        ]

    ways = [(str(setting), setting, partial(way, setting)) for setting in settings]
    results = timing_loop(ways, judge, len(bench.course), effort)
    results = [
        replace(result, compile=compiling)
        if result.setting and result.setting.integrator == "compiled" and not result.reason
        else result
        for result in results
    ]
    return words, _largest(near), tables, results


@dataclass(frozen=True)
class _Solver:
    """Runs one simulation by any setting, over the times of a bench's course."""

    bench: Benchmark
    start: Start
    torque: str | Mapping[str, str] | None

    @property
    def t(self) -> Floats:
        """The times (s) asked for."""
        course = self.bench.course
        assert course.duration is not None
        return np.linspace(0.0, course.duration, len(course))

    def simulation(self, setting: Setting) -> Simulation:
        """Return the simulation by a setting."""
        assert setting.tolerance is not None
        tracer = self.bench.course.tracer
        return simulate(
            tracer.mechanism,
            self.start,
            float(self.t[-1]),
            torque=self.torque,
            assembly_mode=tracer.assembly_modes[0].number,
            tolerance=setting.tolerance,
            engine=setting.integrator,
        )

    def course(self, simulation: Simulation, setting: Setting) -> Sampling:
        """Return a simulation as a course."""
        assert setting.tolerance is not None
        tracer = self.bench.course.tracer
        return simulated_course(tracer, simulation, self.t, setting.tolerance)

    def tables(
        self, setting: Setting, toward: Reference | None = None
    ) -> tuple[Tables, float, float]:
        """Return the tables by a setting with processor times, see `Bench.tables`."""
        started = time.process_time()
        course = self.course(self.simulation(setting), setting)
        solving = time.process_time() - started
        if toward is not None and len(course) != _rows(toward):
            toward = None
        tables, _, seconds = replace(self.bench, course=course).tables(Setting(), toward)
        return tables, solving, solving + seconds

    def tightest(self) -> tuple[Setting, Simulation, float]:
        """Return the tightest setting, its simulation, and what compiling took (s)."""
        setting, compiled = (
            Setting(integrator=integrator, tolerance=LEAST[integrator])
            for integrator in INTEGRATORS
        )
        if available():
            with suppress(EngineError):
                simulation = self.simulation(compiled)
                return compiled, simulation, simulation.engine.compile_seconds
        return setting, self.simulation(setting), 0.0

    def in_many_digits(self, simulation: Simulation) -> Reference:
        """Return the tables at the times of a simulation from one in more digits.

        Raises
        ------
        EngineError
            If there is none; see `spherekit.dynamics.reference.refined`.
        """
        exact = refined(simulation, self.start, float(self.t[-1]))
        course = self.course(simulation, Setting(tolerance=LEAST["numpy"]))
        assert course.t is not None
        (motion,) = course.blocks(len(course))
        states, (driven,) = exact.at(course.t), simulation.driven
        turns = np.round((floats(states.values) - motion.values) / TURN)
        with exact.arithmetic.within():
            values = floats(states.values - exactly(turns) * (2 * pi()))
        inputs = states.values[:, [driven]]
        values[:, driven] = floats(inputs)[:, 0]
        rates = [floats(x[:, [driven]]) for x in (states.rates, states.second)]
        if exact.kind == "sticking":
            # Dry friction jumps here, so nothing that depends on it is compared.
            stuck = course.t >= min(float(exact.end), simulation.end.t)
            for rate in rates:
                rate[stuck] = np.nan
        motion = replace(
            motion,
            values=values,
            inputs=floats(inputs),
            timing=Timing(floats(states.t), *rates),
        )
        return replace(self.bench, course=course).reference_at(motion, inputs)


def _largest(near: Sequence[Deviation]) -> float:
    """Return the largest error, no less than the rounding of float64."""
    return max([EPS, *(deviation.error for deviation in near)])


def _rows(reference: Reference) -> int:
    """Return how many rows the fields of a reference have."""
    return len(reference.fields[0].status) if reference.fields else 0
