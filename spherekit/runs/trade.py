"""Measurement of the trade of speed for accuracy, for one analysis of one mechanism.

`trade` is the public function. `places` chooses the samples at which errors are measured.
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
from spherekit.proof.balls import FEWEST as DIGITS
from spherekit.runs import batch_runner
from spherekit.runs.contract import AbstractAnalysis, Sweep
from spherekit.runs.evaluation_options import ENGINES, ORDINARY, Setting
from spherekit.runs.registry import create
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.runner import run
from spherekit.runs.sampling import Sampling, make_sampling
from spherekit.runs.simulation_measurement import (
    Effort,
    Found,
    Timed,
    measured,
    plan_of,
    tables_by,
    timing_loop,
)
from spherekit.runs.study_options import Subject, study_of, takes
from spherekit.runs.table_deviation import Deviation, scale_words
from spherekit.runs.trade_files import run_of
from spherekit.runs.trade_measurement import (
    compute_reference_tables,
    measure_deviations,
    reads_poles,
)
from spherekit.runs.trade_record import Measured, Trade
from spherekit.tables.table import TableArrays, Tables, arrays
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import ROUTES, Request

PEAKS = 8
"""Places of worst conditioning around which more samples are taken, in every step."""


def places(sampling: Sampling, most: int, wanted: Request) -> Indices:
    """Return numbers of samples: `most` evenly, and more where axes are least certain.

    There errors of rounding and of functions read from nodes are largest. Between the
    samples beside each peak of the error bounds the middle ones are added, until
    neighbours are reached.
    """
    q = sampling.inputs[:, 0]
    spread = np.linspace(0, len(q) - 1, most).astype(np.intp)
    rows = np.unique([*spread, np.argmin(q), np.argmax(q)])
    if sampling.inputs.shape[1] > 1 or not wanted.poles:
        return rows
    more = rows
    while len(more):
        motion = sampling.motion_at(rows)
        field = evaluate(motion, wanted, route="conditioned")
        bound = np.fmax.reduce([np.zeros(len(motion)), *field.direction_error.values()])
        sides = np.pad(bound.reshape(-1, len(rows)), ((0, 0), (1, 1)), constant_values=-1.0)
        bound, left, right = sides[:, 1:-1], sides[:, :-2], sides[:, 2:]
        which, at = np.nonzero((bound >= left) & (bound >= right))
        at = at[np.argsort(bound[which, at])[::-1][:PEAKS]]
        gaps = np.unique(np.clip([at - 1, at], 0, len(rows) - 2))
        more = np.setdiff1d((rows[gaps] + rows[gaps + 1]) // 2, rows)
        rows = np.union1d(rows, more)
    return rows


def at_places(sampling: Sampling, rows: Indices, search: bool) -> Sampling:
    """Return a sampling with a part of the samples of another, given by their numbers."""
    position_analysis = sampling.position_analysis
    only = (
        position_analysis.assembly_modes[0].number
        if len(position_analysis.assembly_modes) == 1
        else None
    )
    q = sampling.inputs[rows]
    timing = sampling.timing
    return replace(
        sampling,
        position_analysis=PositionAnalysis(
            position_analysis.mechanism,
            None,
            only,
            search,
            path=q,
            crossings=position_analysis.crossings,
        ),
        inputs=q,
        shape=(len(q),),
        timing=None if timing is None else timing.rows(rows),
    )


CHECKED = 361
"""Most samples at which errors are measured, and"""

CHECKED_ROWS = 1500
"""most rows, samples of all assembly modes, unless the samples would be too few."""

FEWEST = 31


@takes(Effort)
@checked(AnalysisError)
def trade(
    subject: Subject, analysis: str | AbstractAnalysis = "poles", **options: Any
) -> Trade:
    """Return the settings of an analysis with their times and true errors.

    Parameters
    ----------
    subject
        The run that settings are wanted for: a study, or a mechanism; or the path or the
        shipped name of either. Errors are measured at fewer samples over the same range,
        where there are many.
    analysis
        The analysis by its name with parameters, or as an object.
    options
        `input_pair`, names of the driven pairs, and fields of
        `spherekit.files.study.Study` and of `Effort` (settings, checked, rounds, budget).
        Those that are given replace what a study says.

    Raises
    ------
    AnalysisError
        If the analysis has nothing that trades speed for accuracy.
    PlanError, SolveError, ModelError
        See `spherekit.run`.
    """
    study, effort = study_of("trade", subject, options, Effort)
    # The step tolerance is what is traded.
    study = replace(study, tolerance=DEFAULT_TOLERANCE)
    chosen = create(analysis) if isinstance(analysis, str) else analysis
    sweeps = [sweep for sweep in chosen.trades if sweep.applies(study.mechanism)]
    if sweeps:
        return _of_parameters(study, chosen, sweeps, effort)
    few = study
    if study.start is not None:
        few = replace(study, samples=min(study.count, effort.checked or CHECKED))
    plan = plan_of(make_sampling(few), chosen)
    if not reads_poles(plan):
        raise AnalysisError(
            f"{chosen.name}: reads no poles, rates or positions of the samples and "
            "declares no parameter that trades speed for accuracy (`trades`); there is "
            "nothing to measure"
        )
    if study.start is not None:
        return _trade(plan, study, measured(plan, study, effort))
    return _of_samples(plan, study, effort)


def _of_samples(plan: RunPlan, study: Study, effort: Effort) -> Trade:
    """Return the settings of samples against reference values.

    The ordinary one is timed at successive samples, so many that a kernel gives their rows
    where it gives those of the run that is wanted. Errors are measured at fewer.
    """
    (analysis,), whole = plan.analyses, plan.sampling
    total = len(whole)
    modes = len(whole.position_analysis.assembly_modes)
    most = min(CHECKED, effort.checked or max(FEWEST, CHECKED_ROWS // modes))
    long = None
    if whole.shape == (total,) and total * modes >= batch_runner.MIN_KERNEL_ROWS:
        long = at_places(
            whole,
            np.arange(min(total, 4 * batch_runner.MIN_KERNEL_ROWS // modes)),
            study.search,
        )
    sampling = whole
    axes = len(whole.shape)
    if total > most and axes > 1:
        side = max(2, int(most ** (1.0 / axes)))
        sampling = make_sampling(
            replace(study, samples=tuple(min(count, side) for count in whole.shape))
        )
    elif total > most:
        sampling = at_places(whole, places(whole, most, plan.requests[0]), study.search)
    plan = plan_of(sampling, analysis)
    motion = sampling.motion_at(np.arange(len(sampling)))
    reference = compute_reference_tables(plan, motion)
    right = reference.tables
    poles = reference.pole_fields
    every = effort.settings or [
        *(Setting(route=route) for route in ROUTES),
        *(Setting(engine=engine) for engine in ENGINES if engine != "numpy"),
    ]

    def way(setting: Setting, judged: bool) -> Timed:
        if judged or long is None or setting != ORDINARY:
            return tables_by(sampling, analysis, setting, poles if judged else ())
        tables, first, seconds = tables_by(long, analysis, setting)
        return tables, first, first + (seconds - first) * len(sampling) / len(long)

    results = timing_loop(
        [(str(setting), setting, partial(way, setting)) for setting in every],
        lambda tables: measure_deviations(plan, tables, right),
        study.count / len(sampling),
        effort,
    )
    return _trade(
        plan,
        study,
        (
            f"the closure equations in {DIGITS} digits{reference.lacking}",
            EPS,
            right,
            results,
        ),
    )


def _trade(plan: RunPlan, study: Study, result: Found) -> Trade:
    words, floor, reference, measures = result
    (analysis,), sampling = plan.analyses, plan.sampling
    scales = {x.column: x.scale for x in measure_deviations(plan, reference, reference)}
    columns = [
        (name, scale_words(column), scales[name])
        for table in plan.tables_of(analysis)
        for column in table.columns
        if (name := f"{table.name}.{column.name}") in scales
    ]
    return Trade(
        plan.mechanism.name,
        analysis.name,
        study.count,
        len(sampling),
        len(sampling) * len(sampling.position_analysis.assembly_modes),
        words,
        floor,
        int(plan.needs[0].derivatives),
        tuple(columns),
        tuple(measures),
        run_of(study, analysis),
    )


def _of_parameters(
    study: Study, analysis: AbstractAnalysis, sweeps: Sequence[Sweep], effort: Effort
) -> Trade:
    """Return the values of an analysis's own parameters against the most accurate."""
    every: list[Measured] = []
    tightest: list[str] = []
    columns: dict[str, tuple[str, float]] = {}
    for sweep in sweeps:
        ways = [
            (f"{sweep.parameter}={x:g}", None, partial(_swept, study, analysis, sweep, x))
            for x in sweep.values
        ]
        tightest.append(ways[-1][0])
        reference = ways.pop()[2](True)[0]
        judge = partial(_compared, sweep, reference)
        every += timing_loop(ways, judge, 1.0, effort)
        (same,) = judge(reference)
        words = "absolute rad" if sweep.places else "over the largest"
        columns.setdefault(same.column, (words, same.scale))
    return Trade(
        study.mechanism.name,
        analysis.name,
        study.count,
        1,
        1,
        f"the tightest: {', '.join(tightest)}",
        min((x.error for x in every if np.isfinite(x.error)), default=EPS),
        None,
        tuple((name, *how) for name, how in columns.items()),
        tuple(every),
        run_of(study, analysis),
    )


def _swept(
    study: Study, analysis: AbstractAnalysis, sweep: Sweep, value: Any, _: bool
) -> Timed:
    """Run an analysis with one value of a parameter."""
    started = time.process_time()
    samples = min(study.count, FEWEST)
    changed = dict(sweep.beside)
    if sweep.parameter == "samples":
        samples = value
    else:
        changed[sweep.parameter] = value
    few = replace(study, samples=samples)
    result = run(few, replace(analysis, **changed))  # type: ignore[type-var]
    if result.failures:
        raise AnalysisError(result.failures[analysis.name])
    data = arrays(result.results[analysis.name].data[sweep.table])
    seconds = time.process_time() - started
    return {sweep.table: data}, seconds, seconds


def _compared(sweep: Sweep, reference: Tables, given: Tables) -> list[Deviation]:
    """Return the deviation of the column of a sweep from the reference.

    Each number is compared with the nearest in a row that matches, from either side: of
    places as angles (rad), of others over the largest of the reference.
    """
    from scipy.spatial import cKDTree

    right, ours = (_by_key(sweep, arrays(x[sweep.table])) for x in (reference, given))
    scale, estimate, off = 1.0, np.nan, [EPS]
    if not sweep.places:
        scale = max((max_abs(x) for x in right.values()), default=0.0) or 1.0
    every = ours | right if sweep.places else right
    shared = right.keys() & ours.keys()
    around: Facts = {"boxsize": TURN} if sweep.places else {}
    for key in shared:
        both = [right[key], ours[key]]
        if sweep.places:
            both = [x % TURN % TURN for x in both]  # what is next below none is a turn
        for one, other in (both, both[::-1]):
            nearest, _ = cKDTree(one, **around).query(other)
            off += np.divide(nearest, scale).tolist()
    missing = sum(len(numbers) for key, numbers in every.items() if key not in shared)
    if sweep.error:
        numbers, errors = (given[sweep.table][x] for x in (sweep.column, sweep.error))
        largest = np.nanmax(np.abs(numbers), initial=0.0) or 1.0
        estimate = np.nanmax(errors, initial=0.0) / largest
    name = f"{sweep.table}.{sweep.column}"
    return [Deviation(name, max(off), scale, len(off) - 1 + missing, missing, estimate)]


def _by_key(sweep: Sweep, data: TableArrays) -> dict[Names, Floats]:
    """Return the numbers (n, columns) of a sweep's column by the texts that match.

    That of each input where it is one of inputs.
    """
    names = [x for x in data if x == sweep.column or x.startswith(f"{sweep.column}_")]
    numbers = np.stack([data[name] for name in names], axis=1)
    texts = [data[name].astype(str) for name in sweep.match]
    made: dict[Names, list[Floats]] = {}
    for number, *key in zip(numbers, *texts, strict=True):
        if all_finite(number):
            made.setdefault(tuple(key), []).append(number)
    return {key: np.array(rows) for key, rows in made.items()}
