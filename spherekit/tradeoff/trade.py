"""Measuring the trade of speed for accuracy of one analysis of one mechanism.

The samples of a course at which errors are measured.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Sweep
from spherekit.analysis.registry import create
from spherekit.analysis.run import run
from spherekit.analysis.running import rows_at_once
from spherekit.analysis.running.evaluation import ORDINARY, Setting
from spherekit.analysis.running.sampling import Sampling, course_of
from spherekit.analysis.study import Subject, requests_for, study_of, takes
from spherekit.analysis.tables import TableData
from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Indices
from spherekit.conventions import EPS
from spherekit.engine.fields import evaluate
from spherekit.errors import AnalysisError
from spherekit.model.study import DEFAULT_TOLERANCE, Study
from spherekit.motion.motion import PositionAnalysis
from spherekit.proof.balls import FEWEST as DIGITS
from spherekit.rates.request import Request
from spherekit.sphere.rotation import all_finite, max_abs
from spherekit.tradeoff.measure import (
    Benchmark,
    Deviation,
    Effort,
    Found,
    Tables,
    measured,
    of_samples,
    scale_words,
    timing_loop,
)
from spherekit.tradeoff.record import Measured, Trade, gathered, run_of

PEAKS = 8
"""Places of worst conditioning around which more samples are taken, in every step."""


def places(course: Sampling, most: int, wanted: Request) -> Indices:
    """Return numbers of samples: `most` evenly, and more where axes are least certain.

    There errors of rounding and of functions read from nodes are largest. Between the
    samples beside each peak of the error bounds the middle ones are added, until
    neighbours are reached.
    """
    total, q = len(course), course.inputs[:, 0]
    ends = [0, total - 1, int(np.argmin(q)), int(np.argmax(q))]
    rows = np.unique([*np.linspace(0, total - 1, most).astype(np.intp), *ends])
    if course.inputs.shape[1] > 1 or not wanted.poles:
        return np.asarray(rows, dtype=np.intp)
    bound = _bounds(course, rows, wanted)
    while True:
        at = np.unravel_index(_peaks(bound), bound.shape)[1]
        gaps = np.unique(np.concatenate([at, at - 1]))
        gaps = gaps[(gaps >= 0) & (gaps < len(rows) - 1)]
        more = np.setdiff1d((rows[gaps] + rows[gaps + 1]) // 2, rows)
        if not len(more):
            return np.asarray(rows, dtype=np.intp)
        order = np.argsort(np.concatenate([rows, more]), kind="stable")
        rows = np.concatenate([rows, more])[order]
        bound = np.concatenate([bound, _bounds(course, more, wanted)], axis=1)[:, order]


def at_places(course: Sampling, rows: Indices, search: bool) -> Sampling:
    """Return the course that runs through some samples of another only."""
    tracer = course.tracer
    only = tracer.assembly_modes[0].number if len(tracer.assembly_modes) == 1 else None
    q, timing = course.inputs[rows], course.timing
    return replace(
        course,
        tracer=PositionAnalysis(tracer.mechanism, None, only, search, path=q),
        inputs=q,
        shape=(len(q),),
        timing=None if timing is None else timing.rows(rows),
    )


def _bounds(course: Sampling, rows: Indices, wanted: Request) -> Floats:
    """Return (assembly modes, samples) the largest bound of a direction of the plan."""
    motion = course.tracer.samples(rows)
    field = evaluate(motion, wanted, route="conditioned")
    largest = np.zeros(len(motion))
    for error in field.error.values():
        largest = np.fmax(largest, error)
    return largest.reshape(-1, motion.samples)


def _peaks(bound: Floats) -> Indices:
    """Return the flat numbers of the highest local maxima along the samples."""
    beside = np.pad(bound, ((0, 0), (1, 1)), constant_values=-1.0)
    tops = np.flatnonzero((bound >= beside[:, :-2]) & (bound >= beside[:, 2:]))
    return tops[np.argsort(bound.ravel()[tops])[::-1][:PEAKS]]


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
        `spherekit.model.study.Study` and of `Effort` (settings, checked, rounds, budget).
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
    bench = Benchmark.of(course_of(few), chosen)
    if not bench.reads_poles:
        raise AnalysisError(
            f"{chosen.name}: reads no poles, rates or positions of the samples and "
            "declares no parameter that trades speed for accuracy (`trades`); there is "
            "nothing to measure"
        )
    if study.start is not None:
        return _trade(bench, study, measured(bench, study, effort))
    return _of_samples(bench, study, effort)


def _of_samples(bench: Benchmark, study: Study, effort: Effort) -> Trade:
    """Return the settings of samples against reference values."""
    most = effort.checked or max(
        FEWEST, CHECKED_ROWS // len(bench.course.tracer.assembly_modes)
    )
    long = _long(bench, study)
    bench = _at_fewer(bench, study, min(most, CHECKED))
    right = bench.reference()
    reference = right.tables
    words = f"the closure equations in {DIGITS} digits{right.without}"
    every = of_samples() if effort.settings is None else effort.settings

    def way(setting: Setting, judged: bool) -> tuple[Tables, float, float]:
        if judged or long is None or setting != ORDINARY:
            return bench.tables(setting, right if judged else None)
        tables, first, seconds = long.tables(setting)
        share = len(bench.course) / len(long.course)
        return tables, first, first + (seconds - first) * share

    results = timing_loop(
        [(str(setting), setting, partial(way, setting)) for setting in every],
        lambda tables: bench.deviations(tables, reference),
        len(bench.course),
        effort,
    )
    return _trade(bench, study, (words, EPS, reference, results))


def _long(bench: Benchmark, study: Study) -> Benchmark | None:
    """Return the bench at successive samples, so many that a kernel gives their rows.

    None where the run that is wanted has fewer: then it has none either.
    """
    course = bench.course
    modes = len(course.tracer.assembly_modes)
    if course.shape != (len(course),) or len(course) * modes < rows_at_once.FEWEST:
        return None
    samples = min(len(course), 4 * rows_at_once.FEWEST // modes)
    return replace(bench, course=at_places(course, np.arange(samples), study.search))


def _at_fewer(bench: Benchmark, study: Study, most: int) -> Benchmark:
    """Return the bench at about so many samples of the same range, or all of them."""
    course = bench.course
    if len(course) <= most:
        return bench
    axes = len(course.shape)
    if axes > 1:
        side = max(2, int(most ** (1.0 / axes)))
        fewer = tuple(min(count, side) for count in course.shape)
        return replace(bench, course=course_of(replace(study, samples=fewer)))
    tracer = course.tracer
    wanted = requests_for(tracer.mechanism, bench.needs, tracer.by_rank)
    rows = places(course, most, wanted[0])
    return replace(bench, course=at_places(course, rows, study.search))


def _trade(bench: Benchmark, study: Study, result: Found) -> Trade:
    reference_words, floor, reference, measures = result
    mechanism = bench.course.tracer.mechanism
    scales = {
        (item.table, item.column): item.scale
        for item in bench.deviations(reference, reference)
    }
    columns = [
        (f"{table.name}.{column.name}", scale_words(column), scale)
        for table in bench.tables_of
        for column in table.columns
        if (scale := scales.get((table.name, column.name))) is not None
    ]
    rows = len(bench.course) * len(bench.course.tracer.assembly_modes)
    return Trade(
        mechanism.name,
        bench.analysis.name,
        study.count,
        len(bench.course),
        rows,
        reference_words,
        floor,
        int(bench.needs.derivatives),
        gathered(columns),
        tuple(measures),
        run_of(study, bench.analysis),
    )


def _of_parameters(
    study: Study, analysis: AbstractAnalysis, sweeps: Sequence[Sweep], effort: Effort
) -> Trade:
    """Return the values of an analysis's own parameters against the most accurate."""
    every: list[Measured] = []
    columns: list[tuple[str, str, float]] = []
    for sweep in sweeps:
        estimates: dict[str, float] = {}
        way = partial(_swept, study, analysis, sweep, estimates)
        names = [_named(sweep, value) for value in sweep.values]
        reference = way(sweep.values[-1])[0]
        ways = [
            (name, None, partial(way, value))
            for name, value in zip(names[:-1], sweep.values[:-1], strict=True)
        ]
        judge = partial(_compared, sweep, reference)
        results = timing_loop(ways, judge, 1, effort)
        every += [
            replace(result, estimate=estimates.get(result.name, np.nan))
            for result in results
        ]
        (same,) = judge(reference)
        words = "absolute rad" if sweep.places else "over the largest"
        columns.append((f"{sweep.table}.{sweep.column}", words, same.scale))
    errors = [result.error for result in every if np.isfinite(result.error)]
    return Trade(
        study.mechanism.name,
        analysis.name,
        study.count,
        1,
        1,
        "the tightest: " + ", ".join(_named(sweep, sweep.values[-1]) for sweep in sweeps),
        min(errors, default=EPS),
        None,
        gathered(columns),
        tuple(every),
        run_of(study, analysis),
    )


def _swept(
    study: Study,
    analysis: AbstractAnalysis,
    sweep: Sweep,
    estimates: dict[str, float],
    value: Any,
    _: bool = True,
) -> tuple[Tables, float, float]:
    """Run an analysis with one value of a parameter, and note its own estimate."""
    started = time.process_time()
    few = replace(study, samples=min(study.count, FEWEST))
    changed = dict(sweep.beside)
    if sweep.parameter == "samples":
        few = replace(study, samples=value)
    else:
        changed[sweep.parameter] = value
    varied = replace(analysis, **changed)  # type: ignore[type-var]
    result = run(few, varied)
    if result.failures:
        raise AnalysisError(result.failures[analysis.name])
    data = result.results[analysis.name].data[sweep.table]
    seconds = time.process_time() - started
    if sweep.error:
        estimates[_named(sweep, value)] = _estimate(data, sweep)
    return {sweep.table: data}, seconds, seconds


def _named(sweep: Sweep, value: Any) -> str:
    return f"{sweep.parameter}={value:g}"


def _estimate(data: TableData, sweep: Sweep) -> float:
    """Return the analysis's own largest relative error."""
    values = np.abs(np.asarray(data[sweep.column], dtype=float))
    errors = np.asarray(data[sweep.error], dtype=float)
    return float(np.nanmax(errors, initial=0.0) / (np.nanmax(values, initial=0.0) or 1.0))


def _compared(sweep: Sweep, reference: Tables, given: Tables) -> list[Deviation]:
    """Return the deviation of the column of a sweep from the reference."""
    compare = _places_apart if sweep.places else _numbers_apart
    off, scale, missing = compare(sweep, reference[sweep.table], given[sweep.table])
    error = max([EPS, *off.tolist()])
    return [Deviation(sweep.table, sweep.column, error, scale, len(off) + missing, missing)]


def _by_key(sweep: Sweep, data: TableData) -> dict[tuple[str, ...], Floats]:
    """Return the numbers (n, columns) of a sweep's column by the texts that match."""
    names = [name for name in data if _is_of(name, sweep.column)]
    numbers = np.stack([np.asarray(data[name], dtype=float) for name in names], axis=1)
    texts = [np.asarray(data[name]).astype(str) for name in sweep.match]
    made: dict[tuple[str, ...], list[Floats]] = {}
    for number, *key in zip(numbers, *texts, strict=True):
        if all_finite(number):
            made.setdefault(tuple(key), []).append(number)
    return {key: np.array(rows) for key, rows in made.items()}


def _is_of(name: str, column: str) -> bool:
    """Return whether a column is one of a column for each input."""
    return name == column or name.startswith(f"{column}_")


def _numbers_apart(
    sweep: Sweep, theirs: TableData, ours: TableData
) -> tuple[Floats, float, int]:
    """Return differences over the largest number, that, and how many have none."""
    right, given = _by_key(sweep, theirs), _by_key(sweep, ours)
    scale = max((max_abs(x) for x in right.values()), default=0.0) or 1.0
    shared = [key for key in right if key in given]
    off = [max_abs(given[key][0] - right[key][0]) / scale for key in shared]
    return np.array(off), float(scale), len(right) - len(shared)


def _places_apart(
    sweep: Sweep, theirs: TableData, ours: TableData
) -> tuple[Floats, float, int]:
    """Return the distances (rad) of places from the nearest of the same kind.

    Of ours from theirs too; then 1, and how many have none of their kind.
    """
    from scipy.spatial import cKDTree

    right, given = _by_key(sweep, theirs), _by_key(sweep, ours)
    off, missing = [np.zeros(0)], 0
    for key in right.keys() | given.keys():
        if key in right and key in given:
            both = [_on_circles(rows[key]) for rows in (right, given)]
            one, other = (cKDTree(rows) for rows in both)
            chords = [one.query(both[1])[0], other.query(both[0])[0]]
            off += [2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) for chord in chords]
        else:
            missing += len(right.get(key, given.get(key, ())))
    return np.concatenate(off), 1.0, missing


def _on_circles(angles: Floats) -> Floats:
    """Return angles (n, inputs) as points (n, 2 inputs), a turn on being the same."""
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
