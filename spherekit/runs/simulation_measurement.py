"""Integrators and tolerances of a simulation, measured against one in more digits."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from spherekit.argument_validation import check_fields
from spherekit.conventions import TURN
from spherekit.dynamics.forward_dynamics import MIN_TOLERANCE_BY_ENGINE, simulate
from spherekit.dynamics.reference_simulation import refined
from spherekit.errors import AnalysisError, EngineError, SpherekitError
from spherekit.files.study import Study
from spherekit.positions.timing import Timing
from spherekit.progress import ProgressReporter
from spherekit.proof.ball_frames import exactly
from spherekit.proof.balls import FEWEST, floats, pi
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.declaration_checks import declared
from spherekit.runs.evaluation_options import ORDINARY, Integrator, Setting
from spherekit.runs.run_plan import DeclaredNeeds, RunPlan, make_run_plan
from spherekit.runs.sampling import Sampling, sample_simulation
from spherekit.runs.table_deviation import Deviation, worst
from spherekit.runs.trade_measurement import (
    ReferenceTables,
    align_directions,
    compute_reference_tables,
    measure_deviations,
)
from spherekit.runs.trade_record import Measured
from spherekit.tables.table import Tables
from spherekit.tolerances import EPS
from spherekit.velocities.pole_field import PoleField

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


LEAST_ROUNDS = 2


Found = tuple[str, float, Tables, list[Measured]]
"""What the reference is in words, how well it is known, its tables, and the settings."""


Timed = tuple[Tables, float, float]
"""Tables, and processor times (s): before any sample, then that of everything."""


Runner = Callable[[bool], Timed]
"""Something that is run once, and timed. It is told whether its tables count, otherwise
its times do."""


def plan_of(
    sampling: Sampling, analysis: AbstractAnalysis, setting: Setting = ORDINARY
) -> RunPlan:
    """Return the run of one analysis; `AnalysisError` for bad parameters."""
    needs = declared(analysis, sampling.position_analysis.mechanism)
    return make_run_plan(sampling, [analysis], DeclaredNeeds((needs,), {}), setting=setting)


def tables_by(
    sampling: Sampling,
    analysis: AbstractAnalysis,
    setting: Setting,
    toward: Sequence[PoleField] = (),
) -> Timed:
    """Compute the tables of an analysis at all samples with a setting, and time it.

    The signs of directions follow from the samples, not from a setting. To compare
    errors they are turned `toward` those of a reference.
    """
    started = time.process_time()
    plan = plan_of(sampling, analysis, setting)
    first = time.process_time() - started

    def batches() -> Iterator[Batch]:
        blocks = plan.source.blocks(plan.block_size)
        for motion, fields, angles in plan.evaluate_blocks(blocks):
            if toward:
                modes = np.arange(len(motion.assembly_modes)) * len(sampling)
                rows = motion.sample + np.repeat(modes, motion.samples)
                fields = align_directions(fields, toward, rows)
            yield plan.make_batch(analysis, motion, fields, angles)

    tables = plan.join_tables(analysis, batches())
    return tables, first, time.process_time() - started


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

    `plan` has the samples of the study's simulation. The reference is a simulation in
    more digits than float64; where none can be made, the tightest float64 one, and the
    words say why.
    """
    settings = effort.settings or [
        Setting(integrator=integrator, tolerance=tolerance)
        for integrator in INTEGRATORS
        for tolerance in TOLERANCES
        if tolerance >= MIN_TOLERANCE_BY_ENGINE[integrator]
    ]
    best, sampling, compiling = _tightest(plan, study)
    try:
        reference = _in_many_digits(plan, study, sampling)
        tables = reference.tables
        poles = reference.pole_fields
        words = f"a simulation in {FEWEST} digits{reference.lacking}"
        near = []
    except EngineError as reason:
        poles = ()
        tables, *_ = _simulated_tables(plan, study, best)
        other = replace(best, tolerance=10.0 * MIN_TOLERANCE_BY_ENGINE[best.integrator])
        near = measure_deviations(plan, _simulated_tables(plan, study, other)[0], tables)
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
            for item in measure_deviations(plan, given, tables)
        ]

    ways = [(str(setting), setting, partial(way, setting)) for setting in settings]
    results = timing_loop(ways, judge, study.count / len(plan.sampling), effort)
    results = [
        replace(result, compile_seconds=compiling)
        if result.setting and result.setting.integrator == "compiled" and not result.reason
        else result
        for result in results
    ]
    return words, _largest(near), tables, results


def _solved(plan: RunPlan, study: Study, setting: Setting) -> Sampling:
    """Return the simulation of a study by a setting, over the times of a run."""
    sampling = plan.sampling
    assert study.start is not None and setting.tolerance is not None
    assert sampling.duration is not None
    simulation = simulate(
        plan.mechanism,
        study.start,
        sampling.duration,
        torque=study.driving_torque,
        assembly_mode=sampling.position_analysis.assembly_modes[0].number,
        tolerance=setting.tolerance,
        engine=setting.integrator,
    )
    t = np.linspace(0.0, sampling.duration, len(sampling))
    return sample_simulation(sampling.position_analysis, simulation, t, setting.tolerance)


def _simulated_tables(
    plan: RunPlan, study: Study, setting: Setting, toward: Sequence[PoleField] = ()
) -> Timed:
    """Return the tables of a simulation by a setting, see `tables_by`."""
    started = time.process_time()
    sampling = _solved(plan, study, setting)
    solving = time.process_time() - started
    if toward and len(sampling) != len(toward[0].status):
        toward = ()
    tables, _, seconds = tables_by(sampling, plan.analyses[0], ORDINARY, toward)
    return tables, solving, solving + seconds


def _tightest(plan: RunPlan, study: Study) -> tuple[Setting, Sampling, float]:
    """Return the tightest setting, its simulation, and what compiling took (s)."""
    setting, compiled = (
        Setting(integrator=integrator, tolerance=MIN_TOLERANCE_BY_ENGINE[integrator])
        for integrator in INTEGRATORS
    )
    with suppress(EngineError):
        sampling = _solved(plan, study, compiled)
        assert sampling.simulation is not None
        return compiled, sampling, sampling.simulation.engine.compile_seconds
    return setting, _solved(plan, study, setting), 0.0


def _in_many_digits(plan: RunPlan, study: Study, sampling: Sampling) -> ReferenceTables:
    """Return the tables at the times of a simulation from one in more digits.

    Raises
    ------
    EngineError
        If there is none; see `spherekit.dynamics.reference_simulation.refined`.
    """
    simulation = sampling.simulation
    end = plan.sampling.duration
    assert simulation is not None and study.start is not None and end is not None
    assert sampling.t is not None
    exact = refined(simulation, study.start, end)
    (motion,) = sampling.blocks(len(sampling))
    (states, *derived), (driven,) = exact.at(sampling.t), simulation.driven
    turns = np.round((floats(states) - motion.values) / TURN)
    with exact.arithmetic.within():
        values = floats(states - exactly(turns) * (2 * pi()))
    inputs = states[:, [driven]]
    values[:, driven] = floats(inputs)[:, 0]
    rates = [floats(x[:, [driven]]) for x in derived]
    if exact.kind == "sticking":
        # Dry friction jumps here, so nothing that depends on it is compared.
        stuck = sampling.t >= min(float(exact.end), simulation.end.t)
        for rate in rates:
            rate[stuck] = np.nan
    timing = Timing(np.minimum(sampling.t, float(exact.end)), *rates)
    motion = replace(motion, values=values, inputs=floats(inputs), timing=timing)
    run_plan = plan_of(sampling, plan.analyses[0])
    return compute_reference_tables(run_plan, motion, inputs)


def _largest(near: Sequence[Deviation]) -> float:
    """Return the largest error, the rounding of float64 where there is none."""
    return max((deviation.error for deviation in near), default=EPS)
