"""Running settings against each other in one process, and against the reference.

Integrators and tolerances of a simulation, measured against one in more digits.

How far tables are off: the largest scaled deviation of their columns.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from spherekit.analysis.batch import Batch, Fields
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.running.evaluation import ORDINARY, Integrator, Setting
from spherekit.analysis.running.sampling import Sampling, simulated_course
from spherekit.analysis.running.summary import RunPlan, job_of, links_of
from spherekit.analysis.running.verify import GOLDEN, in_many_digits
from spherekit.analysis.tables import Column, Table, Tables, arrays
from spherekit.argument_validation import check_fields
from spherekit.arrays import Array, Floats, Indices
from spherekit.conventions import EPS, TURN, Status
from spherekit.dynamics.forward import LEAST, simulate
from spherekit.dynamics.reference import refined
from spherekit.engine.fields import evaluate
from spherekit.errors import AnalysisError, EngineError, SpherekitError
from spherekit.model.study import Study
from spherekit.motion.motion import Motion, Timing
from spherekit.numeric.crossings import wrap
from spherekit.progress import ProgressReporter
from spherekit.proof.balls import FEWEST, exactly, floats, pi
from spherekit.rates.request import (
    PoleField,
    turn_round,
)
from spherekit.sphere.rotation import max_abs
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

    unused = ("tolerance", "verify", "degrees")

    settings: Sequence[Setting] | None = None
    checked: int | None = None
    rounds: int = ROUNDS
    budget: float = 30.0

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "trade")


INTEGRATORS: tuple[Integrator, ...] = ("numpy", "compiled")
TOLERANCES = [float(f"1e-{decade}") for decade in range(3, 16)]
"""Those of simulations."""


@dataclass(frozen=True)
class Deviation:
    """The largest deviation of one column, named ``TABLE.COLUMN``, from its reference.

    `error` is in units of `scale`: 1 for absolute errors, else the largest reference. It
    is never given below the rounding of float64. `compared` numbers have a reference;
    `missing` of these are not given. `estimate` is the analysis's own of its error.
    """

    column: str
    error: float
    scale: float
    compared: int
    missing: int
    estimate: float = np.nan


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
    given: Tables,
    reference: Tables,
) -> list[Deviation]:
    """Return the deviation of every column of numbers in tables of equal rows.

    Errors that are not absolute are over the largest reference of all such columns of the
    table with the same unit: a torque that balances others may itself be rounding. Where
    all derivatives by an angle are, they are over what they are derivatives of.
    """
    made = []
    for table in tables:
        ours, theirs = (arrays(data[table.name]) for data in (given, reference))
        results = [c for c in table.columns if c.kind == "number" and c.scale != "none"]
        largest: dict[str, float] = {}
        for column in results:
            if not is_absolute(column):
                values = theirs[column.name]
                size = max_abs(values[np.isfinite(values)])
                largest[column.unit] = max(size, largest.get(column.unit, 0.0))
        for column in results:
            scale = 1.0 if is_absolute(column) else _scale(largest, column.unit)
            off, count = _apart(column, ours[column.name], theirs[column.name])
            error = max(max_abs(off) / scale, EPS)
            name = f"{table.name}.{column.name}"
            made.append(Deviation(name, error, scale, count, count - len(off)))
    return made


def _scale(largest: Mapping[str, float], unit: str) -> float:
    size = largest[unit]
    whole = _integrated(unit)
    before = 0.0 if whole is None else largest.get(whole, 0.0)
    return (size if size > EPS * before else before) or 1.0


def _apart(column: Column, ours: Floats, theirs: Floats) -> tuple[Floats, int]:
    """Return by how much numbers differ that both have, and how many are expected."""
    expected = np.isfinite(theirs)
    count = int(np.sum(expected))
    if len(ours) != len(theirs):
        return np.zeros(0), count
    both = expected & np.isfinite(ours)
    off = ours[both] - theirs[both]
    return wrap(off) if column.unit == "rad" else off, count


def worst(compared: Sequence[Deviation]) -> Deviation | None:
    """Return the deviation with the largest error, None if nothing was compared."""
    told = [deviation for deviation in compared if deviation.compared > deviation.missing]
    return max(told, key=lambda deviation: deviation.error, default=None)


LEAST_ROUNDS = 2

Found = tuple[str, float, Tables, list[Measured]]
"""What the reference is in words, how well it is known, its tables, and the settings."""

Timed = tuple[Tables, float, float]
"""Tables, and processor times (s): before any sample, then that of everything."""

Runner = Callable[[bool], Timed]
"""Something that is run once, and timed. It is told whether its tables count, otherwise
its times do."""


def plan_of(
    course: Sampling, analysis: AbstractAnalysis, setting: Setting = ORDINARY
) -> RunPlan:
    """Return the run of one analysis; `AnalysisError` for bad parameters."""
    needs = declared(analysis, course.tracer.mechanism)
    return job_of(course, [analysis], ((needs,), {}), setting=setting)


def reads_poles(plan: RunPlan) -> bool:
    """Return whether anything of what is read depends on settings of the samples."""
    return bool(links_of(plan.mechanism, replace(plan.needs[0], links=frozenset())))


def tables_by(
    course: Sampling,
    analysis: AbstractAnalysis,
    setting: Setting,
    toward: Sequence[PoleField] = (),
) -> Timed:
    """Return the tables of an analysis over a course by a setting.

    The signs of directions follow from the samples, not from a setting. To compare
    errors they are turned `toward` those of a reference.
    """
    started = time.process_time()
    plan = plan_of(course, analysis, setting)
    first = time.process_time() - started

    def batches() -> Iterator[Batch]:
        for motion, fields, angles in plan.read(plan.source.blocks(plan.block)):
            if toward:
                modes = np.arange(len(motion.assembly_modes)) * len(course)
                rows = motion.sample + np.repeat(modes, motion.samples)
                fields = _toward(fields, toward, rows)
            yield plan.batch(analysis, motion, fields, angles)

    tables = plan.collected(analysis, batches())
    return tables, first, time.process_time() - started


CHECK_ROWS = 61
"""Samples at which what was reached is measured, spread over the run's own."""


def checked_rows(plan: RunPlan) -> tuple[list[Deviation], int]:
    """Return how far a run is off at some samples, and their number of rows.

    The samples are spread over the course: at most `CHECK_ROWS`, chosen apart from any
    regular pattern.
    """
    total = len(plan.course)
    rows = np.arange(total)
    if total > CHECK_ROWS:
        shares = (rows[:CHECK_ROWS] + rows[:CHECK_ROWS] * GOLDEN % 1.0) / CHECK_ROWS
        rows = np.unique((shares * total).astype(np.intp))
    right, poles, _ = reference_at(plan, plan.course.motion_at(rows))
    ((motion, fields, angles),) = plan.read([plan.source.motion_at(rows)])
    fields = _toward(fields, poles, np.arange(len(motion)))
    (analysis,) = plan.analyses
    given = plan.given(analysis, plan.batch(analysis, motion, fields, angles))
    return deviations_of(plan, given, right), len(motion)


def reference_at(
    plan: RunPlan, motion: Motion, inputs: Array | None = None
) -> tuple[Tables, tuple[PoleField, ...], str]:
    """Return the tables at the rows of a motion.

    With the poles behind them, and words on rows that have none. They hold the float64
    numbers nearest to configurations and rates that the closure equations give in 20
    digits; see `spherekit.proof`. The motion's inputs are taken as exact, or else `inputs`
    (n, inputs), which they are rounded from.
    """
    (analysis,) = plan.analyses
    wanted = [item for item in plan.requests if item.poles]
    exact, better, fields = in_many_digits(
        motion, wanted, [evaluate(motion, item) for item in wanted], inputs=inputs
    )
    better = replace(better, samples=motion.samples)
    lacking = np.sum((motion.status == Status.OK) & (exact[0].status != Status.OK))
    batch = plan.batch(analysis, better, fields, plan.angles(better, {}))
    tables = plan.given(analysis, batch)
    return tables, fields, f", {lacking} rows without" if lacking else ""


def deviations_of(plan: RunPlan, given: Tables, reference: Tables) -> list[Deviation]:
    """Return how far tables of a run are off, column by column."""
    return deviations(plan.tables_of(plan.analyses[0]), given, reference)


def _toward(
    fields: Fields, reference: Sequence[PoleField], rows: Indices
) -> tuple[PoleField, ...]:
    """Return fields with directions on the side of a reference's at these rows of it."""
    made = tuple(field.made for field in fields)
    for field, other in zip(made, reference, strict=True):
        for pole, u in field.direction.items():
            along = np.vecdot(u, other.direction[pole][rows])
            turn_round(field, pole, np.where(along < 0.0, -1.0, 1.0))
    return made


def timing_loop(
    ways: Sequence[tuple[str, Setting | None, Runner]],
    judge: Callable[[Tables], Sequence[Deviation]],
    longer: float,
    effort: Effort,
) -> list[Measured]:
    """Return every way with its error and its times over alternating rounds.

    `ways` are their names, settings, and what runs them, `judge` says how far tables are
    off, and the run that is wanted has `longer` times the samples.
    """
    began = time.monotonic()
    measured: dict[str, Measured] = {}
    working = ProgressReporter("measuring settings")
    for done, (name, setting, way) in enumerate(ways):
        working.tell(f"{name}, {done + 1} of {len(ways)}".__str__)
        try:
            tables, first, _ = way(True)
            off = judge(tables)
        except SpherekitError as problem:
            measured[name] = Measured(name, setting, reason=problem.fault)
            continue
        largest = worst(off) or Deviation("", np.nan, np.nan, 0, 0)
        measured[name] = Measured(
            name,
            setting,
            error=largest.error,
            worst_column=largest.column,
            own_estimate=largest.estimate,
            missing=sum(deviation.missing for deviation in off),
            compile_seconds=first,
        )
    alive = [(name, way) for name, _, way in ways if not measured[name].reason]
    times: dict[str, list[tuple[float, float]]] = {name: [] for name, _ in alive}
    for number in range(effort.rounds):
        if number >= LEAST_ROUNDS and time.monotonic() - began > effort.budget:
            break
        for name, way in alive if number % 2 == 0 else alive[::-1]:
            _, first, seconds = way(False)
            times[name].append((first, longer * (seconds - first)))
            working.tell(f"{name}, round {number + 1} of {effort.rounds}".__str__)
    for name, rounds in times.items():
        made = measured[name].setting or ORDINARY
        compiles = made.engine != "numpy" or made.integrator == "compiled"
        before, after = np.array(rounds).T
        first = float(np.min(before))
        measured[name] = replace(
            measured[name],
            seconds=first + np.min(after),
            seconds_median=first + np.median(after),
            first_seconds=first,
            compile_seconds=max(measured[name].compile_seconds - first, 0.0) * compiles,
        )
    return list(measured.values())


def measured(plan: RunPlan, study: Study, effort: Effort) -> Found:
    """Return integrators and tolerances with their times and errors.

    `plan` has the course of the study's simulation. The reference is a simulation in
    more digits than float64; where none can be made, the tightest float64 one, and the
    words say why.
    """
    settings = effort.settings or [
        Setting(integrator=integrator, tolerance=tolerance)
        for integrator in INTEGRATORS
        for tolerance in TOLERANCES
        if tolerance >= LEAST[integrator]
    ]
    best, course, compiling = _tightest(plan, study)
    try:
        tables, poles, without = _in_many_digits(plan, study, course)
        words = f"a simulation in {FEWEST} digits{without}"
        near = []
    except EngineError as reason:
        poles = ()
        tables, *_ = _simulated_tables(plan, study, best)
        other = replace(best, tolerance=10.0 * LEAST[best.integrator])
        near = deviations_of(plan, _simulated_tables(plan, study, other)[0], tables)
        words = (
            f"simulation {best}, known to {_largest(near):.1e} from {other} "
            f"({reason.fault})"
        )
        settings = [setting for setting in settings if setting != best]

    def way(setting: Setting, judged: bool) -> Timed:
        return _simulated_tables(plan, study, setting, poles if judged else ())

    floors = {deviation.column: deviation.error for deviation in near}

    def judge(given: Tables) -> list[Deviation]:
        return [
            replace(item, error=max(item.error, floors.get(item.column, EPS)))
            for item in deviations_of(plan, given, tables)
        ]

    ways = [(str(setting), setting, partial(way, setting)) for setting in settings]
    results = timing_loop(ways, judge, study.count / len(plan.course), effort)
    results = [
        replace(result, compile_seconds=compiling)
        if result.setting and result.setting.integrator == "compiled" and not result.reason
        else result
        for result in results
    ]
    return words, _largest(near), tables, results


def _solved(plan: RunPlan, study: Study, setting: Setting) -> Sampling:
    """Return the simulation of a study by a setting, over the times of a run."""
    course = plan.course
    assert study.start is not None and setting.tolerance is not None
    assert course.duration is not None
    simulation = simulate(
        plan.mechanism,
        study.start,
        course.duration,
        torque=study.driving_torque,
        assembly_mode=course.tracer.assembly_modes[0].number,
        tolerance=setting.tolerance,
        engine=setting.integrator,
    )
    t = np.linspace(0.0, course.duration, len(course))
    return simulated_course(course.tracer, simulation, t, setting.tolerance)


def _simulated_tables(
    plan: RunPlan, study: Study, setting: Setting, toward: Sequence[PoleField] = ()
) -> Timed:
    """Return the tables of a simulation by a setting, see `tables_by`."""
    started = time.process_time()
    course = _solved(plan, study, setting)
    solving = time.process_time() - started
    if toward and len(course) != len(toward[0].status):
        toward = ()
    tables, _, seconds = tables_by(course, plan.analyses[0], ORDINARY, toward)
    return tables, solving, solving + seconds


def _tightest(plan: RunPlan, study: Study) -> tuple[Setting, Sampling, float]:
    """Return the tightest setting, its simulation, and what compiling took (s)."""
    setting, compiled = (
        Setting(integrator=integrator, tolerance=LEAST[integrator])
        for integrator in INTEGRATORS
    )
    with suppress(EngineError):
        course = _solved(plan, study, compiled)
        assert course.simulation is not None
        return compiled, course, course.simulation.engine.compile_seconds
    return setting, _solved(plan, study, setting), 0.0


def _in_many_digits(
    plan: RunPlan, study: Study, course: Sampling
) -> tuple[Tables, tuple[PoleField, ...], str]:
    """Return the tables at the times of a simulation from one in more digits.

    Raises
    ------
    EngineError
        If there is none; see `spherekit.dynamics.reference.refined`.
    """
    simulation = course.simulation
    end = plan.course.duration
    assert simulation is not None and study.start is not None and end is not None
    assert course.t is not None
    exact = refined(simulation, study.start, end)
    (motion,) = course.blocks(len(course))
    (states, *derived), (driven,) = exact.at(course.t), simulation.driven
    turns = np.round((floats(states) - motion.values) / TURN)
    with exact.arithmetic.within():
        values = floats(states - exactly(turns) * (2 * pi()))
    inputs = states[:, [driven]]
    values[:, driven] = floats(inputs)[:, 0]
    rates = [floats(x[:, [driven]]) for x in derived]
    if exact.kind == "sticking":
        # Dry friction jumps here, so nothing that depends on it is compared.
        stuck = course.t >= min(float(exact.end), simulation.end.t)
        for rate in rates:
            rate[stuck] = np.nan
    timing = Timing(np.minimum(course.t, float(exact.end)), *rates)
    motion = replace(motion, values=values, inputs=floats(inputs), timing=timing)
    return reference_at(plan_of(course, plan.analyses[0]), motion, inputs)


def _largest(near: Sequence[Deviation]) -> float:
    """Return the largest error, the rounding of float64 where there is none."""
    return max((deviation.error for deviation in near), default=EPS)
