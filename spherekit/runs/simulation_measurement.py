"""Times and errors of the settings of a simulation, and the loop that measures settings.

A simulation is compared with one in more digits than float64. The loop `measure_candidates`
is also used for settings of samples (`spherekit.runs.trade`).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from spherekit.argument_validation import check_fields
from spherekit.arrays import Indices
from spherekit.conventions import TURN
from spherekit.dynamics.forward_dynamics import MIN_TOLERANCE_BY_ENGINE, simulate
from spherekit.dynamics.reference_simulation import refined
from spherekit.errors import AnalysisError, EngineError, SpherekitError
from spherekit.files.study import Study
from spherekit.positions.motion import Motion
from spherekit.positions.timing import Timing
from spherekit.progress import ProgressReporter
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import MIN_DIGITS, centre_floats, pi_ball
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.declaration_checks import check_needs
from spherekit.runs.evaluation_options import ORDINARY, Integrator, Setting
from spherekit.runs.run_plan import DeclaredNeeds, RunPlan, make_run_plan
from spherekit.runs.sampling import Sampling, sample_simulation
from spherekit.runs.table_deviation import Deviation, find_largest_deviation
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

DEFAULT_ROUNDS = 5
"""Number of times that every setting is run; the best time counts.

Larger: times that scatter less, in more time.
"""

MIN_ROUNDS = 2
"""Number of rounds after which the measurement may end because of its budget.

Smaller: a single disturbed round decides. Larger: the budget is exceeded by slow settings.
"""


@dataclass(frozen=True)
class TradeOptions:
    """Options of `spherekit.trade` that no other function shares.

    The function measures how much accuracy a run trades for speed: the time and the error
    of each setting. A setting is one way to compute the run, such as an engine. Most fields
    of a `Study` (a mechanism with its motion) are options of the function, too.

    Attributes
    ----------
    excluded_study_fields
        Names of fields of a `Study` that are no options of this function.
    settings
        Settings to measure. By default they are all settings of a simulation if the run is
        one, otherwise all settings with which velocities at samples are computed.
    checked
        Largest number of samples that are spread over the run to measure errors there. None
        stands for 361. In a run at given inputs with more than four assembly modes, None
        stands for fewer samples. If such a run has a single input and more samples than
        this number, further samples are added between the spread ones. They lie at peaks of
        the error bounds of poles (axes of relative rotation), where errors can be large.
    rounds
        Number of times that each setting is run. Each round has another order.
    budget
        Time (s) after which no further round begins.
    """

    # Each setting has its own tolerance. `verify` and `degrees` concern the tables of a
    # run, which a trade does not have.
    excluded_study_fields = ("tolerance", "verify", "degrees")

    settings: Sequence[Setting] | None = None
    checked: int | None = None
    rounds: int = DEFAULT_ROUNDS
    budget: float = 30.0

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "trade")
        for name, number in (("checked", self.checked), ("rounds", self.rounds)):
            if number is not None and number < 1:
                raise AnalysisError(f"trade: {name} must be at least 1, not {number}")


INTEGRATORS: tuple[Integrator, ...] = ("numpy", "compiled")
"""Integrators of a simulation that are measured."""

TOLERANCES_RAD = [float(f"1e-{decade}") for decade in range(3, 16)]
"""Tolerances (rad) of a simulation that are measured."""


@dataclass(frozen=True)
class SettingMeasurement:
    """The times and errors of the settings of an analysis.

    A setting is one way to compute a run. Errors are differences from reference values of
    higher accuracy.

    Attributes
    ----------
    reference
        Words that describe the reference values for users.
    floor
        Error of the reference values themselves. Smaller errors cannot be measured.
    reference_tables
        Result tables of the analysis, computed from the reference values. They give the
        scale of each column, relative to which its errors are stated.
    settings
        The settings with their times and errors.
    """

    reference: str
    floor: float
    reference_tables: Tables
    settings: list[Measured]


class TimedTables(NamedTuple):
    """Tables of an analysis, and the processor time that was needed to compute them.

    From the two times, the time for another number of samples is estimated.

    Attributes
    ----------
    tables
        The tables by name.
    first_seconds
        Time (s) before the first sample. It does not depend on the number of samples.
    seconds
        Total time (s), including `first_seconds`.
    """

    tables: Tables
    first_seconds: float
    seconds: float


@dataclass(frozen=True)
class Candidate:
    """A way to run an analysis, to be compared with other ways by time and error.

    Candidates differ either in a setting of the run (such as an engine), or in the value of
    a parameter of the analysis.

    Attributes
    ----------
    name
        Name in tables and messages.
    setting
        The setting. None if the candidates differ in the value of a parameter.
    run
        Function that runs the analysis once in this way. Its argument is True if the
        tables will be compared with the reference, and False if only the times count.
    """

    name: str
    setting: Setting | None
    run: Callable[[bool], TimedTables]


def make_analysis_plan(
    sampling: Sampling, analysis: AbstractAnalysis, setting: Setting = ORDINARY
) -> RunPlan:
    """Return the run of one analysis at some samples, with a setting.

    A setting is a way to compute the run, such as an engine.

    An `AnalysisError` says if the parameters of the analysis are wrong.
    """
    needs = check_needs(analysis, sampling.position_analysis.mechanism)
    return make_run_plan(sampling, [analysis], DeclaredNeeds((needs,), {}), setting=setting)


def compute_timed_tables(
    sampling: Sampling,
    analysis: AbstractAnalysis,
    setting: Setting,
    reference_fields: Sequence[PoleField] = (),
) -> TimedTables:
    """Compute the tables of an analysis with a setting, and measure the processor time.

    The time for planning the run does not depend on the number of samples. This time is
    returned separately, so that the time of a run with more samples can be estimated.

    Parameters
    ----------
    sampling
        The samples.
    analysis
        The analysis.
    setting
        The way to compute the quantities that the analysis reads.
    reference_fields
        Reference poles with which the computed poles are compared, one field for each input
        that moves while all other inputs are locked. A pole is the axis about which one
        link rotates relative to another. Both directions along it are equally right, so
        computed directions get the sense of the reference. Empty if only the time is
        measured.
    """
    start = time.process_time()
    run_plan = make_analysis_plan(sampling, analysis, setting)
    planning_seconds = time.process_time() - start

    batches = _make_batches(run_plan, analysis, reference_fields)
    tables = run_plan.join_tables(analysis, batches)
    return TimedTables(tables, planning_seconds, time.process_time() - start)


def _make_batches(
    run_plan: RunPlan,
    analysis: AbstractAnalysis,
    reference_fields: Sequence[PoleField],
) -> Iterator[Batch]:
    """Yield the data of each block of samples, in the form that an analysis reads.

    The error of a setting is the difference of the tables of the analysis from tables of
    higher accuracy, the reference. A pole is an axis, so both directions along it are
    right. Computed poles get the sense of the reference poles, so that the tables can be
    compared.

    Parameters
    ----------
    run_plan
        The run of this analysis.
    analysis
        The analysis.
    reference_fields
        Reference poles (axes of the relative rotation of two links) at all samples. There
        is a field for each input that moves while the other inputs are locked. Empty if
        only the time is measured.
    """
    motions = run_plan.source.blocks(run_plan.block_size)
    # Continued angles are pair variables (joint angles) without jumps of whole revolutions.
    for motion, pole_fields, continued_angles in run_plan.evaluate_blocks(motions):
        if reference_fields:
            # A reversed direction must not count as an error.
            reference_rows = _find_reference_rows(motion, len(run_plan.sampling))
            pole_fields = align_directions(pole_fields, reference_fields, reference_rows)
        yield run_plan.make_batch(analysis, motion, pole_fields, continued_angles)


def _find_reference_rows(motion: Motion, sample_count: int) -> Indices:
    """Return the row (n,) of the whole run to which each row of a block belongs.

    A row is one sample in one assembly mode (way to assemble the mechanism). The whole run
    first has the rows of all samples in the first mode, then the rows in the next mode. A
    block has the same order, but only those samples that are computed together. With these
    rows, the caller finds the reference poles to which the poles of the block are aligned.

    Parameters
    ----------
    motion
        The configurations of the block.
    sample_count
        Number of samples of the whole run.
    """
    mode_indices = np.repeat(np.arange(len(motion.assembly_modes)), motion.samples)
    first_rows_of_modes = mode_indices * sample_count
    return first_rows_of_modes + motion.sample


def measure_candidates(
    candidates: Sequence[Candidate],
    compare: Callable[[Tables], Sequence[Deviation]],
    sample_ratio: float,
    trade_options: TradeOptions,
) -> list[Measured]:
    """Measure the error of every candidate, and its time in several rounds.

    A candidate is one way to compute a run: with a setting such as an engine, or with a
    value of a parameter.

    Parameters
    ----------
    candidates
        The settings or parameter values.
    compare
        Function that returns the deviations of tables from the reference.
    sample_ratio
        Number of samples of the requested run, divided by the number of samples of the
        measured runs.
    trade_options
        Number of rounds, and the time after which no round begins.

    Returns
    -------
    The candidates in their order. Those that fail have the reason.
    """
    start = time.monotonic()
    measured_by_name: dict[str, Measured] = {}
    progress = ProgressReporter("measuring settings")
    # First run every candidate once, to measure its error.
    for number, candidate in enumerate(candidates, 1):
        # `report_if_due` calls the function before it returns, and only for a report. The
        # loop variable therefore still has its present value (B023).
        progress.report_if_due(
            lambda: f"{candidate.name}, {number} of {len(candidates)}"  # noqa: B023
        )
        try:
            timed_tables = candidate.run(True)
            deviations = compare(timed_tables.tables)
        except SpherekitError as problem:
            measured_by_name[candidate.name] = Measured(
                candidate.name, candidate.setting, reason=problem.fault
            )
            continue
        largest = find_largest_deviation(deviations) or Deviation("", np.nan, np.nan, 0, 0)
        measured_by_name[candidate.name] = Measured(
            candidate.name,
            candidate.setting,
            error=largest.error,
            worst_column=largest.column,
            own_estimate=largest.estimate,
            missing=sum(deviation.missing for deviation in deviations),
            # This is the time before the first sample, with compiling. All other parts of
            # this time are subtracted below.
            compile_seconds=timed_tables.first_seconds,
        )

    applicable = [item for item in candidates if not measured_by_name[item.name].reason]
    # Then measure times in several rounds: the time before the first sample, and the time
    # of all samples.
    first_seconds: dict[str, list[float]] = {item.name: [] for item in applicable}
    sample_seconds: dict[str, list[float]] = {item.name: [] for item in applicable}
    for round_number in range(trade_options.rounds):
        if round_number >= MIN_ROUNDS and time.monotonic() - start > trade_options.budget:
            break
        # The order alternates, so that no candidate suffers if the machine becomes slower.
        order = applicable if round_number % 2 == 0 else applicable[::-1]
        for candidate in order:
            timed_tables = candidate.run(False)
            seconds = timed_tables.seconds - timed_tables.first_seconds
            first_seconds[candidate.name].append(timed_tables.first_seconds)
            sample_seconds[candidate.name].append(sample_ratio * seconds)
            text = f"{candidate.name}, round {round_number + 1} of {trade_options.rounds}"
            progress.report_if_due(lambda: text)  # noqa: B023

    for name, seconds_of_rounds in sample_seconds.items():
        setting = measured_by_name[name].setting or ORDINARY
        compiles = setting.engine != "numpy" or setting.integrator == "compiled"
        least_first_seconds = float(np.min(first_seconds[name]))
        compile_seconds = measured_by_name[name].compile_seconds - least_first_seconds
        measured_by_name[name] = replace(
            measured_by_name[name],
            seconds=least_first_seconds + np.min(seconds_of_rounds),
            seconds_median=least_first_seconds + np.median(seconds_of_rounds),
            first_seconds=least_first_seconds,
            compile_seconds=max(compile_seconds, 0.0) * compiles,
        )
    return list(measured_by_name.values())


def measure_simulation_settings(
    run_plan: RunPlan, study: Study, trade_options: TradeOptions
) -> SettingMeasurement:
    """Measure the times and errors of a simulation with several integrators and tolerances.

    Errors are differences from a reference, a simulation in more digits than float64. If
    such a simulation is not possible, the reference is the float64 simulation with the
    smallest tolerance. The text `reference` of the result then says why.

    Parameters
    ----------
    run_plan
        The run with the samples of the study's simulation.
    study
        The study.
    trade_options
        The settings that are measured, and how long.
    """
    settings = trade_options.settings or [
        Setting(integrator=integrator, tolerance=tolerance)
        for integrator in INTEGRATORS
        for tolerance in TOLERANCES_RAD
        if tolerance >= MIN_TOLERANCE_BY_ENGINE[integrator]
    ]
    for given_setting in settings:
        if given_setting.tolerance is None:
            raise AnalysisError(
                f'trade: settings: the setting "{given_setting}" has no tolerance; give '
                'one, such as Setting(integrator="numpy", tolerance=1e-9)'
            )
    tightest = _simulate_tightest(run_plan, study)
    reference_fields: tuple[PoleField, ...]
    try:
        reference = _compute_exact_tables(run_plan, study, tightest.sampling)
        reference_tables = reference.tables
        reference_fields = reference.pole_fields
        words = f"a simulation in {MIN_DIGITS} digits{reference.lacking}"
        reference_deviations: list[Deviation] = []
    except EngineError as reason:
        reference_fields = ()
        best = tightest.setting
        reference_tables = _simulate_tables(run_plan, study, best).tables
        # The error of the reference is estimated with a tolerance that is ten times larger.
        looser = replace(best, tolerance=10.0 * MIN_TOLERANCE_BY_ENGINE[best.integrator])
        reference_deviations = measure_deviations(
            run_plan, _simulate_tables(run_plan, study, looser).tables, reference_tables
        )
        words = (
            f"simulation {best}, known to {_largest_error(reference_deviations):.1e} from "
            f"{looser} ({reason.fault})"
        )
        settings = [setting for setting in settings if setting != best]

    def run_setting(setting: Setting, is_compared: bool) -> TimedTables:
        """Run the simulation once with a setting."""
        fields = reference_fields if is_compared else ()
        return _simulate_tables(run_plan, study, setting, fields)

    # No error can be stated below the error of the reference.
    floors = {deviation.column: deviation.error for deviation in reference_deviations}

    def compare(tables: Tables) -> list[Deviation]:
        """Return the deviations of tables, each at least the error of the reference."""
        deviations = measure_deviations(run_plan, tables, reference_tables)
        return [
            replace(item, error=max(item.error, floors.get(item.column, EPS)))
            for item in deviations
        ]

    candidates = [
        Candidate(str(setting), setting, partial(run_setting, setting))
        for setting in settings
    ]
    sample_ratio = study.count / len(run_plan.sampling)
    results = []
    for measured in measure_candidates(candidates, compare, sample_ratio, trade_options):
        setting = measured.setting
        is_compiled = setting is not None and setting.integrator == "compiled"
        if is_compiled and not measured.reason:
            # All compiled settings share the functions that the simulation `tightest` has
            # compiled. So the compile time of `tightest` is stated for all of them.
            measured = replace(measured, compile_seconds=tightest.compile_seconds)
        results.append(measured)
    return SettingMeasurement(
        reference=words,
        floor=_largest_error(reference_deviations),
        reference_tables=reference_tables,
        settings=results,
    )


def _simulate(run_plan: RunPlan, study: Study, setting: Setting) -> Sampling:
    """Solve the simulation of a study with a setting, and return its samples.

    The samples serve to measure the time and the error of the setting.

    Parameters
    ----------
    run_plan
        A run of the same study, with the same duration and number of samples. Like every
        run of a simulation, it has one assembly mode (way to assemble the mechanism).
    study
        Start and driving torques of the simulation.
    setting
        Integrator and tolerance.
    """
    sampling = run_plan.sampling
    assert study.start is not None and setting.tolerance is not None
    assert sampling.duration is not None
    simulation = simulate(
        run_plan.mechanism,
        study.start,
        sampling.duration,
        torque=study.driving_torque,
        assembly_mode=sampling.position_analysis.assembly_modes[0].number,
        tolerance=setting.tolerance,
        crossings=study.crossings,
        engine=setting.integrator,
    )
    t = np.linspace(0.0, sampling.duration, len(sampling))
    return sample_simulation(sampling.position_analysis, simulation, t, setting.tolerance)


def _simulate_tables(
    run_plan: RunPlan,
    study: Study,
    setting: Setting,
    reference_fields: Sequence[PoleField] = (),
) -> TimedTables:
    """Solve a simulation with a setting, compute the tables, and measure the times.

    Parameters
    ----------
    run_plan
        A run with one analysis, for which the tables are computed.
    study
        Start and driving torques of the simulation.
    setting
        Integrator and tolerance of the simulation.
    reference_fields
        Poles (axes of the rotation of one link relative to another) of a more accurate
        simulation, one field for each input. Both directions along a pole axis are equally
        right. Computed directions are therefore reversed if they are opposite to those of
        the reference. Empty if the poles are not compared.

    Returns
    -------
    The tables with their times. The time of the simulation hardly grows with the number of
    samples. It is therefore part of `first_seconds`, the time before the first sample.
    """
    start = time.process_time()
    sampling = _simulate(run_plan, study, setting)
    simulation_seconds = time.process_time() - start
    # A simulation that ends early has other samples than the reference, so its directions
    # cannot be compared.
    if reference_fields and len(sampling) != len(reference_fields[0].status):
        reference_fields = ()
    (analysis,) = run_plan.analyses
    # `setting` is a way to solve the simulation. The tables at its samples are always
    # computed with the default setting `ORDINARY`.
    timed_tables = compute_timed_tables(sampling, analysis, ORDINARY, reference_fields)
    return TimedTables(
        timed_tables.tables,
        first_seconds=simulation_seconds + timed_tables.first_seconds,
        seconds=simulation_seconds + timed_tables.seconds,
    )


@dataclass(frozen=True)
class _TightestSimulation:
    """The most accurate float64 simulation (smallest tolerance).

    All settings are compared with a reference. The reference, a simulation in more digits,
    is computed by an iteration that starts from this simulation. If it cannot be computed,
    the setting of this simulation gives the reference.

    Attributes
    ----------
    setting
        Integrator and tolerance of the simulation.
    sampling
        The samples of the simulation.
    compile_seconds
        Time (s) for compiling the equations, 0 if they are not compiled.
    """

    setting: Setting
    sampling: Sampling
    compile_seconds: float


def _simulate_tightest(run_plan: RunPlan, study: Study) -> _TightestSimulation:
    """Simulate with the smallest tolerance, by the compiled integrator if there is one."""
    numpy_setting, compiled_setting = (
        Setting(integrator=integrator, tolerance=MIN_TOLERANCE_BY_ENGINE[integrator])
        for integrator in INTEGRATORS
    )
    with suppress(EngineError):
        sampling = _simulate(run_plan, study, compiled_setting)
        assert sampling.simulation is not None
        compile_seconds = sampling.simulation.engine.compile_seconds
        return _TightestSimulation(compiled_setting, sampling, compile_seconds)
    sampling = _simulate(run_plan, study, numpy_setting)
    return _TightestSimulation(numpy_setting, sampling, 0.0)


def _compute_exact_tables(
    run_plan: RunPlan, study: Study, sampling: Sampling
) -> ReferenceTables:
    """Compute the tables of an analysis from a simulation in more digits than float64.

    Errors of float64 simulations are measured by these tables. The simulation has one
    input.

    Parameters
    ----------
    run_plan
        The run with one analysis.
    study
        Start of the simulation.
    sampling
        The samples of a float64 simulation. The tables are at the same times.

    Raises
    ------
    EngineError
        If there is no such simulation; see
        `spherekit.dynamics.reference_simulation.refined`.
    """
    simulation = sampling.simulation
    duration = run_plan.sampling.duration
    assert simulation is not None and study.start is not None and duration is not None
    assert sampling.t is not None
    # `refined` repeats the simulation in many digits.
    exact = refined(simulation, study.start, duration)
    # The motion of the float64 simulation, at all samples in one block.
    (motion,) = sampling.blocks(len(sampling))
    # Variables (n, variables), then their first and second derivatives with respect to
    # time, as balls: numbers of many digits with error bounds.
    states, *derivatives = exact.at(sampling.t)
    (driven,) = simulation.driven

    # A simulation counts revolutions, but a motion has angles in (-pi, pi]. So the exact
    # variables are shifted by whole revolutions to the variables of the motion. Only the
    # input keeps its revolutions, in the motion too.
    revolutions = np.round((centre_floats(states) - motion.values) / TURN)
    with exact.arithmetic.within():
        values = centre_floats(states - exact_balls(revolutions) * (2 * pi_ball()))
    inputs = states[:, [driven]]
    values[:, driven] = centre_floats(inputs)[:, 0]

    # Rates and accelerations of the input.
    input_rates = [centre_floats(derivative[:, [driven]]) for derivative in derivatives]
    if exact.kind == "sticking":
        # The simulation ends where a pair begins to stick. Dry friction jumps there, and
        # with it the accelerations. The values before and after the jump are equally right.
        # Rates and accelerations are made NaN from there on, so that columns computed from
        # them have no reference value and no error.
        is_sticking = sampling.t >= min(float(exact.end), simulation.end.t)
        for rate in input_rates:
            rate[is_sticking] = np.nan
    # By its error, the float64 simulation may end later than the exact one. Samples after
    # the exact end have the exact state at that end, and so its time.
    timing = Timing(np.minimum(sampling.t, float(exact.end)), *input_rates)
    motion = replace(motion, values=values, inputs=centre_floats(inputs), timing=timing)
    (analysis,) = run_plan.analyses
    return compute_reference_tables(make_analysis_plan(sampling, analysis), motion, inputs)


def _largest_error(deviations: Sequence[Deviation]) -> float:
    """Return the largest of some errors; without any, the rounding error of float64."""
    return max((deviation.error for deviation in deviations), default=EPS)
