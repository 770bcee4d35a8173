"""Measurement of the trade of speed for accuracy, for one analysis of one mechanism.

`trade` is the public function. It measures either the settings of a run, at samples or in a
simulation, or the values of parameters that the analysis declares.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN, Facts, Names
from spherekit.errors import AnalysisError
from spherekit.files.study import DEFAULT_TOLERANCE, Study
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.balls import MIN_DIGITS as REFERENCE_DIGITS
from spherekit.runs import batch_runner
from spherekit.runs.contract import AbstractAnalysis, ParameterTrade
from spherekit.runs.evaluation_options import ENGINES, ORDINARY, Setting
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.runner import run
from spherekit.runs.sampling import Sampling, make_sampling
from spherekit.runs.simulation_measurement import (
    Candidate,
    SettingMeasurement,
    TimedTables,
    TradeOptions,
    compute_timed_tables,
    make_analysis_plan,
    measure_candidates,
    measure_simulation_settings,
)
from spherekit.runs.study_options import Subject, apply_study_options, takes_study_options
from spherekit.runs.table_deviation import Deviation, describe_scale
from spherekit.runs.trade_files import describe_run
from spherekit.runs.trade_measurement import (
    compute_reference_tables,
    measure_deviations,
    reads_motion_quantities,
)
from spherekit.runs.trade_record import Measured, Trade
from spherekit.tables.table import TableArrays, Tables, arrays
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import ROUTES, Request

MAX_REFINED_PEAKS = 8
"""Number of largest peaks of the error bounds around which samples are added in each step.

Larger: fewer large errors are missed, in more time.
"""

MAX_CHECKED_SAMPLES = 361
"""Default number of samples at which errors are measured, before peaks are refined.

Larger: fewer large errors are missed, in more time.
"""

MAX_CHECKED_ROWS = 1500
"""Default number of rows, samples of all assembly modes, at which errors are measured.

It is exceeded if less than `MIN_CHECKED_SAMPLES` samples would remain. Larger: more time
for mechanisms with many modes.
"""

MIN_CHECKED_SAMPLES = 31
"""Number of samples at which errors are measured however many modes there are.

Smaller: large errors are missed.
"""

MAX_SAMPLES_OF_PARAMETER_RUN = 31
"""Largest number of samples of a run that compares values of a parameter.

Larger: more time. Smaller: large errors are missed.
"""

KERNEL_SAMPLE_FACTOR = 4
"""Rows of a run that is timed with a kernel, in units of the fewest rows of a kernel.

Larger: times that scatter less, in more time.
"""


def spread_samples(sampling: Sampling, count: int) -> Indices:
    """Return indices of samples that are spread evenly over a run along a path.

    Settings are tried at these few samples to save time.

    The samples with the least and the greatest value of the first input are added to these
    `count` samples, so that the range of the input stays the same.
    """
    first_input = sampling.inputs[:, 0]
    even_samples = np.linspace(0, len(first_input) - 1, count).astype(np.intp)
    return np.unique([*even_samples, np.argmin(first_input), np.argmax(first_input)])


def refine_at_error_peaks(
    sampling: Sampling, samples: Indices, request: Request
) -> Indices:
    """Add samples where large errors are expected: at peaks of the error bounds of poles.

    The errors of each setting of a run are measured only at the chosen samples, to save
    time. Evenly spread samples could miss the largest errors. Bounds of rounding errors
    show where these are. The bounds are those of the directions of poles. A pole is the
    axis about which one link rotates relative to another.

    At the `MAX_REFINED_PEAKS` highest peaks of the bounds, the intervals to the next chosen
    samples on both sides are halved. This is repeated until no sample of the run is skipped
    beside these peaks.

    Parameters
    ----------
    sampling
        The samples of a run with a single input.
    samples
        (n,) indices of the chosen samples, rising.
    request
        The poles. Without poles nothing is added.

    Returns
    -------
    Indices of the chosen samples and of the added ones, rising.
    """
    if not request.poles:
        return samples
    new_samples = samples
    while len(new_samples):
        largest_bounds = _largest_direction_errors(sampling, samples, request)
        peaks = _find_highest_peaks(largest_bounds)
        # The intervals before and after each peak, by the index of their first sample.
        gaps = np.unique(np.clip([peaks - 1, peaks], 0, len(samples) - 2))
        middles = (samples[gaps] + samples[gaps + 1]) // 2
        new_samples = np.setdiff1d(middles, samples)
        samples = np.union1d(samples, new_samples)
    return samples


def _largest_direction_errors(
    sampling: Sampling, samples: Indices, request: Request
) -> Floats:
    """Return the largest error bound (rad) of any pole direction, as (modes, samples).

    A pole is the axis about which one link rotates relative to another. The result is 0 if
    no pole has a bound.
    """
    motion = sampling.motion_at(samples)
    # Poles as intersections of the best conditioned great circles (a route to compute
    # them), with error bounds.
    field = evaluate(motion, request, route="conditioned")
    bounds = [np.zeros(len(motion)), *field.direction_error.values()]
    return np.fmax.reduce(bounds).reshape(-1, len(samples))


def _find_highest_peaks(values: Floats) -> Indices:
    """Return the samples of the highest `MAX_REFINED_PEAKS` peaks of some values.

    `values` (modes, samples) are not negative, with one row for each assembly mode. A peak
    is at least as large as its two neighbours in the row.
    """
    # With a column of -1 on both sides, the first and the last sample can be peaks.
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-1.0)
    is_peak = (values >= padded[:, :-2]) & (values >= padded[:, 2:])
    modes, peaks = np.nonzero(is_peak)
    order = np.argsort(values[modes, peaks])[::-1]
    return peaks[order[:MAX_REFINED_PEAKS]]


def take_samples(sampling: Sampling, rows: Indices, search: bool) -> Sampling:
    """Return some of the samples of a run as the samples of a smaller run.

    Parameters
    ----------
    sampling
        All samples.
    rows
        (n,) indices of the samples that the result has.
    search
        Whether all assembly modes (ways to assemble the mechanism) are searched at these
        samples. Otherwise only the mode of a given reference pose is found.
    """
    position_analysis = sampling.position_analysis
    modes = position_analysis.assembly_modes
    q = sampling.inputs[rows]
    timing = None  # times of the samples, and rates of the inputs
    if sampling.timing is not None:
        timing = sampling.timing.rows(rows)
    # A run in a single assembly mode stays restricted to this mode.
    only_mode = modes[0].number if len(modes) == 1 else None
    # With `input_pair=None` the mechanism keeps its inputs. `path` lists the input values,
    # one sample after another. `crossings` says which curve a mode follows at a point where
    # two curves of configurations cross.
    smaller_analysis = PositionAnalysis(
        position_analysis.mechanism,
        input_pair=None,
        assembly_mode=only_mode,
        search=search,
        path=q,
        crossings=position_analysis.crossings,
    )
    return replace(
        sampling,
        position_analysis=smaller_analysis,
        inputs=q,
        shape=(len(q),),
        timing=timing,
    )


@takes_study_options(TradeOptions)
@checked(AnalysisError)
def trade(
    subject: Subject, analysis: str | AbstractAnalysis = "poles", **options: Any
) -> Trade:
    """Measure the times and the true errors of the settings of a run.

    A setting is one way to compute the run, such as an engine or a tolerance. The result, a
    trade, has the time and the error of each setting, so that you can choose one. The error
    is the difference from results in more digits than float64. If a simulation in more
    digits is not possible, the simulation with the smallest tolerance takes their place.

    Some analyses have parameters that make them faster and less accurate. For these
    analyses, values of the parameters are measured instead of settings. The results are
    then compared with those of the most accurate value.

    Parameters
    ----------
    subject
        The run for which a setting is sought: a study or a mechanism, as an object, as the
        path of a file, or as the name of a shipped example. In a run with many samples,
        errors are measured at fewer samples over the same range (see `checked`).
    analysis
        The analysis, as an object or as a name with parameters.
    options
        - `input_pair`: names of the driven pairs;
        - `angle_unit`: unit of `path` and of the values in a mapping `start`, by default
          ``"rad"``;
        - fields of `spherekit.files.study.Study`, which replace the values in the study;
        - `settings`: the settings to measure, by default all that apply;
        - `checked`: largest number of samples, spread over the run, at which errors are
          measured. The default is 361. If a run has more than four assembly modes, the
          default is 1500 divided by the number of modes, but at least 31. With a single
          input, samples are added to these where the error bounds of poles are largest;
        - `rounds`: number of times that each setting is run, 5 by default;
        - `budget`: time (s) after which no third or later round begins, 30 by default.

    Raises
    ------
    AnalysisError
        If the analysis has nothing that trades speed for accuracy.
    FileError, PlanError, SolveError, ModelError
        See `spherekit.run`.
    """
    study, trade_options = apply_study_options("trade", subject, options, TradeOptions)
    # Each setting of a simulation has its own tolerance, in place of the tolerance of the
    # study.
    study = replace(study, tolerance=DEFAULT_TOLERANCE)
    if isinstance(analysis, str):
        analysis = create_analysis(analysis, study.mechanism.angle_unit)
    # Parameters of the analysis that trade speed for accuracy.
    parameter_trades = [
        parameter_trade
        for parameter_trade in analysis.trades
        if parameter_trade.applies(study.mechanism)
    ]
    if parameter_trades:
        return _trade_parameters(study, analysis, parameter_trades, trade_options)
    # A study with a start is a simulation. A simulation is computed again with each
    # setting, so fewer samples are used.
    is_simulation = study.start is not None
    shortened_study = study
    if is_simulation:
        sample_count = min(study.count, trade_options.checked or MAX_CHECKED_SAMPLES)
        shortened_study = replace(study, samples=sample_count)
    run_plan = make_analysis_plan(make_sampling(shortened_study), analysis)
    if not reads_motion_quantities(run_plan):
        raise AnalysisError(
            f"{analysis.name}: reads no poles, rates or positions of the samples and "
            "declares no parameter that trades speed for accuracy (`trades`); there is "
            "nothing to measure"
        )
    if is_simulation:
        measurement = measure_simulation_settings(run_plan, study, trade_options)
        return _make_trade(run_plan, study, measurement)
    return _trade_samples(run_plan, study, trade_options)


def _choose_sampling(
    run_plan: RunPlan, study: Study, trade_options: TradeOptions
) -> Sampling:
    """Return the samples at which the errors of settings are measured.

    A setting is one way to compute a run, such as an engine. The samples are the samples of
    the run, or fewer over the same range, because reference values in many digits take
    time.

    Parameters
    ----------
    run_plan
        The run of one analysis, with the samples. For each input, `requests` has the poles
        (axes of relative rotation) that this analysis reads while the input moves.
    study
        The study of the run.
    trade_options
        Its attribute `checked` is the largest number of samples at which errors are
        measured; None for the default. Samples at peaks of error bounds are added to these.
    """
    sampling = run_plan.sampling
    max_count = _max_checked_samples(sampling, trade_options)
    if len(sampling) <= max_count:
        return sampling
    is_grid = len(sampling.shape) > 1
    if is_grid:
        return _make_coarser_grid(study, sampling.shape, max_count)
    samples = spread_samples(sampling, max_count)
    # With a single input, samples are added where the error bounds of the poles are
    # largest.
    has_single_input = sampling.inputs.shape[1] == 1
    if has_single_input:
        samples = refine_at_error_peaks(sampling, samples, run_plan.requests[0])
    # Assembly modes are searched again at these samples if the study asks for it.
    return take_samples(sampling, samples, study.search)


def _max_checked_samples(sampling: Sampling, trade_options: TradeOptions) -> int:
    """Return the largest number of samples at which errors are measured, without peaks.

    The time depends on the number of configurations: one for each sample in each assembly
    mode (way to assemble the mechanism). By default this number is limited. With many modes
    at least `MIN_CHECKED_SAMPLES` samples remain.
    """
    mode_count = len(sampling.position_analysis.assembly_modes)
    default_count = max(MIN_CHECKED_SAMPLES, MAX_CHECKED_ROWS // mode_count)
    return trade_options.checked or min(MAX_CHECKED_SAMPLES, default_count)


def _make_coarser_grid(study: Study, shape: tuple[int, ...], max_count: int) -> Sampling:
    """Return a grid over the inputs of a study with at most about `max_count` samples.

    Errors of settings are measured at these fewer samples, to save time.

    `shape` has the number of samples of each input in the study.
    """
    return make_sampling(replace(study, samples=_coarsen_grid(shape, max_count)))


def _coarsen_grid(shape: tuple[int, ...], max_count: int) -> tuple[int, ...]:
    """Return the shape of a grid with at most about `max_count` samples.

    `shape` has the number of samples of each input. Inputs with at least two samples keep
    at least two of them.
    """
    largest_side = max(2, int(max_count ** (1.0 / len(shape))))
    return tuple(min(axis_samples, largest_side) for axis_samples in shape)


def _choose_kernel_sampling(run_plan: RunPlan, study: Study) -> Sampling | None:
    """Return the samples at which the default setting is timed, None for the usual samples.

    A setting is one way to compute a run. With the default setting, long runs use a kernel
    (compiled functions for many rows; a row is a sample in one assembly mode). Settings are
    usually timed at the samples at which errors are measured, and these are too few for a
    kernel.

    For a long run along a path, samples that are spread evenly over the run are therefore
    returned. They have about `KERNEL_SAMPLE_FACTOR` times the number of rows that a kernel
    needs. The result is None for a run that is too short for a kernel, and for a grid of
    several inputs.
    """
    sampling = run_plan.sampling
    sample_count = len(sampling)
    mode_count = len(sampling.position_analysis.assembly_modes)
    min_rows = batch_runner.MIN_KERNEL_ROWS
    is_path = sampling.shape == (sample_count,)
    is_long = sample_count * mode_count >= min_rows
    if not (is_path and is_long):
        return None
    timed_count = min(sample_count, KERNEL_SAMPLE_FACTOR * min_rows // mode_count)
    return take_samples(sampling, spread_samples(sampling, timed_count), study.search)


def _trade_samples(run_plan: RunPlan, study: Study, trade_options: TradeOptions) -> Trade:
    """Measure the settings of a run that is no simulation.

    A setting is a way to compute the velocities at the samples: one of the `ENGINES`, and
    for NumPy one of the `ROUTES` to the pole axes. Its tables are compared with tables from
    solutions of the closure equations in more digits than float64. The result, a trade, has
    the time and the error of each setting.

    Parameters
    ----------
    run_plan
        The run for which a setting is sought, with one analysis.
    study
        The study of this run.
    trade_options
        The settings to measure, and how long.
    """
    (analysis,) = run_plan.analyses
    # Long runs with the default setting, `ORDINARY`, use a kernel: compiled functions for
    # many rows. The default setting is timed at `kernel_sampling`, which is None if the run
    # is too short for a kernel.
    kernel_sampling = _choose_kernel_sampling(run_plan, study)
    # Samples at which errors are measured.
    sampling = _choose_sampling(run_plan, study, trade_options)
    checked_plan = make_analysis_plan(sampling, analysis)
    motion = sampling.motion_at(np.arange(len(sampling)))
    reference = compute_reference_tables(checked_plan, motion)
    settings = trade_options.settings or [
        *(Setting(route=route) for route in ROUTES),
        *(Setting(engine=engine) for engine in ENGINES if engine != "numpy"),
    ]

    def run_setting(setting: Setting, is_compared: bool) -> TimedTables:
        """Run the analysis once with a setting (a way to compute velocities).

        Parameters
        ----------
        setting
            The setting.
        is_compared
            Whether the tables will be compared with the reference. Otherwise only the times
            count.
        """
        if is_compared:
            # A pole (axis of relative rotation) is given by a unit vector, and the opposite
            # vector is equally right. Computed vectors get the signs of the reference, so
            # that they can be compared.
            return compute_timed_tables(sampling, analysis, setting, reference.pole_fields)
        # Long runs with the default setting, `ORDINARY`, use a kernel (compiled functions
        # for many rows). So this setting is timed at enough samples for a kernel.
        # `kernel_sampling` is None if the run of the user is too short for a kernel.
        timed_sampling = kernel_sampling if setting == ORDINARY else None
        if timed_sampling is None:
            return compute_timed_tables(sampling, analysis, setting)
        timed_tables = compute_timed_tables(timed_sampling, analysis, setting)
        # `first_seconds` is the time before the first sample, which does not depend on the
        # number of samples. The rest of the time is scaled to the sample counts of the
        # other settings.
        sample_seconds = timed_tables.seconds - timed_tables.first_seconds
        sample_seconds = sample_seconds * len(sampling) / len(timed_sampling)
        return timed_tables._replace(seconds=timed_tables.first_seconds + sample_seconds)

    measured_settings = measure_candidates(
        [
            Candidate(str(setting), setting, partial(run_setting, setting))
            for setting in settings
        ],
        compare=lambda tables: measure_deviations(checked_plan, tables, reference.tables),
        sample_ratio=study.count / len(sampling),
        trade_options=trade_options,
    )
    measurement = SettingMeasurement(
        reference=f"the closure equations in {REFERENCE_DIGITS} digits{reference.lacking}",
        floor=EPS,  # error of the reference values, which are rounded to float64
        reference_tables=reference.tables,
        settings=measured_settings,
    )
    return _make_trade(checked_plan, study, measurement)


def _make_trade(run_plan: RunPlan, study: Study, measurement: SettingMeasurement) -> Trade:
    """Return the result of `trade` from measured settings.

    A trade shows how much accuracy is lost for speed. It has the time and the error of each
    setting (way to compute a run).

    Parameters
    ----------
    run_plan
        The measured run, with one analysis. Errors were measured at its samples, which can
        be fewer than the samples of the user's run.
    study
        The user's run: the mechanism, all samples and the analyses. A setting is sought for
        this run.
    measurement
        The settings with their times and errors, and the reference.
    """
    (analysis,) = run_plan.analyses
    sampling = run_plan.sampling
    # Errors are relative to the scale of a column. The reference is compared with itself
    # only to get these scales.
    reference_tables = measurement.reference_tables
    deviations = measure_deviations(run_plan, reference_tables, reference_tables)
    scales = {deviation.column: deviation.scale for deviation in deviations}
    columns = []
    for table in run_plan.tables_of(analysis):
        for column in table.columns:
            name = f"{table.name}.{column.name}"
            # Columns that are not compared, such as texts, have no scale.
            if name in scales:
                columns.append((name, describe_scale(column), scales[name]))
    return Trade(
        mechanism=run_plan.mechanism.name,
        analysis=analysis.name,
        # Number of samples of the user's run, and number at which errors were measured.
        samples=study.count,
        checked=len(sampling),
        # Number of configurations at the latter.
        rows=len(sampling) * len(sampling.position_analysis.assembly_modes),
        reference=measurement.reference,
        floor=measurement.floor,  # error of the reference values
        # 1 if the analysis also reads derivatives of velocities by the input, otherwise 0.
        derivatives=int(run_plan.needs[0].derivatives),
        columns=tuple(columns),
        settings=tuple(measurement.settings),
        made_for=describe_run(study, analysis),
    )


def _trade_parameters(
    study: Study,
    analysis: AbstractAnalysis,
    parameter_trades: Sequence[ParameterTrade],
    trade_options: TradeOptions,
) -> Trade:
    """Measure how parameters of an analysis change its speed and accuracy.

    The analysis is run with each value of a parameter. One column of a table is compared
    with the same column at the most accurate value. The result, a trade, has the time and
    the error of each value.

    Parameters
    ----------
    study
        The study of the run for which values are sought.
    analysis
        The analysis.
    parameter_trades
        The parameters with their values and the compared columns. The last value of each is
        the most accurate one.
    trade_options
        Number of repetitions, and the time after which measuring ends.
    """
    all_measured: list[Measured] = []
    reference_names: list[str] = []
    columns: dict[str, tuple[str, float]] = {}
    for parameter_trade in parameter_trades:
        candidates = [
            Candidate(
                name=f"{parameter_trade.parameter}={value:g}",
                setting=None,
                run=partial(_run_with_value, study, analysis, parameter_trade, value),
            )
            for value in parameter_trade.values
        ]
        reference_candidate = candidates.pop()
        reference_names.append(reference_candidate.name)
        reference = reference_candidate.run(True).tables
        compare = partial(_compare_column, parameter_trade, reference)
        all_measured += measure_candidates(
            candidates, compare, sample_ratio=1.0, trade_options=trade_options
        )
        # Comparing the reference with itself gives the scale of errors. The compared column
        # has either positions (`places`) or other numbers. Positions are, for example,
        # inputs (rad) at which something happens. Errors of other numbers are relative to
        # the largest one.
        (deviation,) = compare(reference)
        scale_words = "absolute rad" if parameter_trade.places else "over the largest"
        columns.setdefault(deviation.column, (scale_words, deviation.scale))
    finite_errors = [item.error for item in all_measured if np.isfinite(item.error)]
    return Trade(
        mechanism=study.mechanism.name,
        analysis=analysis.name,
        samples=study.count,
        # Errors were measured in the results of one run, not sample by sample.
        checked=1,
        rows=1,
        reference=f"the tightest: {', '.join(reference_names)}",
        # The error of the reference is not known. It is taken as the smallest error that
        # was measured.
        floor=min(finite_errors, default=EPS),
        derivatives=None,
        columns=tuple((name, words, scale) for name, (words, scale) in columns.items()),
        settings=tuple(all_measured),
        made_for=describe_run(study, analysis),
    )


def _run_with_value(
    study: Study,
    analysis: AbstractAnalysis,
    parameter_trade: ParameterTrade,
    value: Any,
    is_compared: bool,
) -> TimedTables:
    """Run an analysis with one value of a parameter, and measure the time.

    The parameter trades speed for accuracy. The caller compares times and tables of all
    values. The parameter may be the number of samples of the run. With any other parameter
    only a few samples are computed, to save time. The result has the time of these few
    samples.

    Parameters
    ----------
    study
        The study of the run of the user.
    analysis
        The analysis.
    parameter_trade
        The parameter, and the table of the analysis that is compared between its values.
    value
        The value of the parameter.
    is_compared
        Not used. The function `run` of every `Candidate` has this argument.
    """
    start = time.process_time()
    # The values of other parameters, which are the same in all runs.
    parameters = dict(parameter_trade.beside)
    if parameter_trade.parameter == "samples":
        study = replace(study, samples=value)
    else:
        study = _take_few_samples(study)
        parameters[parameter_trade.parameter] = value
    result = run(study, replace(analysis, **parameters))  # type: ignore[type-var]
    if result.failures:
        raise AnalysisError(result.failures[analysis.name])
    data = arrays(result.results[analysis.name].data[parameter_trade.table])
    seconds = time.process_time() - start
    # `first_seconds` is the part of the time that does not depend on the number of samples.
    # The parts are not measured here. All of the time counts as this part, so that nobody
    # scales it to another number of samples.
    return TimedTables(
        {parameter_trade.table: data}, first_seconds=seconds, seconds=seconds
    )


def _take_few_samples(study: Study) -> Study:
    """Return a study with at most about `MAX_SAMPLES_OF_PARAMETER_RUN` samples.

    The first and the last sample remain, and a grid remains a grid.
    """
    max_count = MAX_SAMPLES_OF_PARAMETER_RUN
    if study.count <= max_count:
        return study
    if study.path is not None:
        samples = np.linspace(0, study.count - 1, max_count).astype(np.intp)
        return replace(study, path=study.path[samples])
    if len(study.shape) > 1:
        return replace(study, samples=_coarsen_grid(study.shape, max_count))
    return replace(study, samples=max_count)


def _compare_column(
    parameter_trade: ParameterTrade, reference: Tables, tables: Tables
) -> list[Deviation]:
    """Return the deviation of a column, computed with one value of a parameter.

    The reference is the same column, computed with the most accurate value of the
    parameter. Each value in the column is compared with the nearest value in the reference,
    among rows with the same texts. Each value in the reference is compared with the nearest
    value in the column in the same way. Positions are compared as angles (rad). Other
    values are compared relative to the largest value in the reference.

    Parameters
    ----------
    parameter_trade
        The parameter, with the column that is compared.
    reference, tables
        Tables with the most accurate value of the parameter, and with another one.
    """
    from scipy.spatial import cKDTree

    # Values (n, columns), keyed by the texts of their rows.
    reference_numbers = _group_numbers(
        parameter_trade, arrays(reference[parameter_trade.table])
    )
    numbers = _group_numbers(parameter_trade, arrays(tables[parameter_trade.table]))
    scale = 1.0
    if not parameter_trade.places:
        # The scale is 1 if all numbers are 0.
        sizes = [max_abs(values) for values in reference_numbers.values()]
        scale = max(sizes, default=0.0) or 1.0
    # Distances to the nearest number, for positions along the circle of a turn. Errors are
    # not below the rounding error.
    errors = [EPS]
    shared_keys = reference_numbers.keys() & numbers.keys()
    tree_options: Facts = {"boxsize": TURN} if parameter_trade.places else {}
    for key in shared_keys:
        both = [reference_numbers[key], numbers[key]]
        if parameter_trade.places:
            # The search needs angles below a whole turn. A tiny negative angle modulo a
            # turn is rounded to a whole turn, and the second operation changes this to 0.
            both = [values % TURN % TURN for values in both]
        for first, second in (both, both[::-1]):
            distances, _ = cKDTree(first, **tree_options).query(second)
            errors += np.divide(distances, scale).tolist()
    # A position with texts that only one of the two tables has counts as missing. Other
    # numbers count as missing only if the reference has them.
    expected = numbers | reference_numbers if parameter_trade.places else reference_numbers
    missing = sum(len(values) for key, values in expected.items() if key not in shared_keys)
    compared = len(errors) - 1 + missing
    if parameter_trade.places and not expected:
        # Two tables without any position agree.
        compared = 1
    # The error that the analysis itself estimates, relative to the largest number.
    estimate = np.nan
    if parameter_trade.error:
        column = tables[parameter_trade.table][parameter_trade.column]
        estimates = tables[parameter_trade.table][parameter_trade.error]
        largest = np.nanmax(np.abs(column), initial=0.0) or 1.0
        estimate = np.nanmax(estimates, initial=0.0) / largest
    return [
        Deviation(
            column=f"{parameter_trade.table}.{parameter_trade.column}",
            error=max(errors),
            scale=scale,
            compared=compared,
            missing=missing,
            estimate=estimate,
        )
    ]


def _group_numbers(
    parameter_trade: ParameterTrade, data: TableArrays
) -> dict[Names, Floats]:
    """Return the finite values in a column, grouped by the texts in their rows.

    Two runs with different accuracy are compared, and may find different numbers of rows. A
    number is therefore only compared with numbers in rows with the same texts, such as the
    kind of a singularity.

    Parameters
    ----------
    parameter_trade
        A parameter of an analysis that is varied, with the columns by which its results are
        compared: `column` has the numbers, and `match` are the columns of texts. If the
        column has a number for each of several inputs, the table has one column for each
        input instead, such as ``q_21`` and ``q_31`` for ``q``.
    data
        The columns of the table by name.

    Returns
    -------
    Values (n, numeric columns), keyed by the texts of their rows.
    """
    number_columns = [parameter_trade.column]
    if parameter_trade.column not in data:
        prefix = f"{parameter_trade.column}_"
        number_columns = [name for name in data if name.startswith(prefix)]
    rows = np.stack([data[name] for name in number_columns], axis=1)
    text_columns = [data[name].astype(str) for name in parameter_trade.match]
    numbers_by_texts: dict[Names, list[Floats]] = {}
    for row, *texts in zip(rows, *text_columns, strict=True):
        if all_finite(row):
            numbers_by_texts.setdefault(tuple(texts), []).append(row)
    return {texts: np.array(numbers) for texts, numbers in numbers_by_texts.items()}
