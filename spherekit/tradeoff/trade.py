"""Measuring the trade of speed for accuracy of one analysis of one mechanism."""

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Sweep
from spherekit.analysis.options import Subject, study_of, takes
from spherekit.analysis.registry import create
from spherekit.analysis.requests import requests_for
from spherekit.analysis.run import run
from spherekit.analysis.running import rows_at_once
from spherekit.analysis.running.sampling import course_of
from spherekit.analysis.running.setting import ORDINARY, Setting
from spherekit.analysis.tables import TableArrays
from spherekit.checked import checked
from spherekit.conventions import EPS
from spherekit.errors import AnalysisError
from spherekit.exact.arithmetic import wide
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import DEFAULT_TOLERANCE, Study
from spherekit.sphere.rotation import Floats
from spherekit.tradeoff.candidates import of_samples
from spherekit.tradeoff.check_samples import at_places, places
from spherekit.tradeoff.deviation import Deviation, scale_words
from spherekit.tradeoff.effort import Effort
from spherekit.tradeoff.measure import Benchmark, Found, Tables, timing_loop
from spherekit.tradeoff.record import Measured, Trade, gathered
from spherekit.tradeoff.simulated import measured
from spherekit.tradeoff.stored import run_of

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
        If the analysis reads nothing that depends on a setting.
    PlanError, SolveError, ModelError
        See `spherekit.run`.
    """
    study, effort = study_of("trade", subject, options, Effort)
    # The step tolerance is what is traded.
    study = replace(study, tolerance=DEFAULT_TOLERANCE)
    chosen = create(analysis) if isinstance(analysis, str) else analysis
    if chosen.trades:
        return _of_parameters(study, chosen, effort)
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
    most = effort.checked or max(
        FEWEST, CHECKED_ROWS // len(bench.course.tracer.assembly_modes)
    )
    long = _long(bench, study)
    bench = _at_fewer(bench, study, min(most, CHECKED))
    right = bench.reference()
    reference = right.tables
    words = f"the closure equations in {wide().name}{right.without}"
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
    tables = [table.of(mechanism) for table in bench.analysis.tables]
    scales = {
        (deviation.table, deviation.column): deviation.scale
        for deviation in bench.deviations(reference, reference)
    }
    columns = [
        (
            f"{table.name}.{column.name}",
            scale_words(column),
            scales[table.name, column.name],
        )
        for table in tables
        for column in table.columns
        if (table.name, column.name) in scales
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


def _of_parameters(study: Study, analysis: AbstractAnalysis, effort: Effort) -> Trade:
    """Return the values of an analysis's own parameters against the most accurate."""
    every: list[Measured] = []
    columns: list[tuple[str, str, float]] = []
    for sweep in analysis.trades:
        estimates: dict[str, float] = {}
        way = partial(_swept, study.mechanism, analysis, sweep, estimates)
        names = [_named(sweep, value) for value in sweep.values]
        reference = way(sweep.values[-1])[0]
        swept = _Swept(sweep)
        ways = [
            (name, None, partial(way, value))
            for name, value in zip(names[:-1], sweep.values[:-1], strict=True)
        ]
        results = timing_loop(ways, partial(swept.deviations, reference), 1, effort)
        every += [
            replace(result, estimate=estimates.get(result.name, np.nan))
            for result in results
        ]
        scale = float(np.nanmax(np.abs(swept.numbers(reference)), initial=0.0))
        columns.append((f"{sweep.table}.{sweep.column}", "over the largest", scale))
    floor = float(np.nanmin([result.error for result in every]))
    return Trade(
        study.mechanism.name,
        analysis.name,
        study.count,
        1,
        1,
        "the tightest: "
        + ", ".join(f"{s.parameter}={s.values[-1]:g}" for s in analysis.trades),
        floor,
        None,
        tuple(columns),
        tuple(every),
        run_of(study, analysis),
    )


def _swept(
    mechanism: Mechanism,
    analysis: AbstractAnalysis,
    sweep: Sweep,
    estimates: dict[str, float],
    value: Any,
    _: bool = True,
) -> tuple[Tables, float, float]:
    """Run an analysis with one value of a parameter, and note its own estimate."""
    started = time.process_time()
    varied = replace(analysis, **{sweep.parameter: value})  # type: ignore[type-var]
    result = run(mechanism, varied, samples=2, search=False)
    if result.failures:
        raise AnalysisError(result.failures[analysis.name])
    data = result.results[analysis.name].data[sweep.table]
    seconds = time.process_time() - started
    if sweep.error:
        estimates[_named(sweep, value)] = _estimate(data, sweep)
    return {sweep.table: data}, seconds, seconds


def _named(sweep: Sweep, value: Any) -> str:
    return f"{sweep.parameter}={value:g}"


def _estimate(data: TableArrays, sweep: Sweep) -> float:
    """Return the analysis's own largest relative error."""
    values = np.abs(np.asarray(data[sweep.column], dtype=float))
    errors = np.asarray(data[sweep.error], dtype=float)
    return float(np.nanmax(errors, initial=0.0) / (np.nanmax(values, initial=0.0) or 1.0))


class _Swept:
    """Compares the column of a sweep row by row, where the matching columns agree."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep

    def numbers(self, tables: Tables) -> Floats:
        """Return the column's numbers, one for each key, in the order first met."""
        return np.array(list(self._by_key(tables).values()), dtype=float)

    def _by_key(self, tables: Tables) -> dict[tuple[str, ...], float]:
        data = tables[self.sweep.table]
        keys = zip(
            *(np.asarray(data[name]).astype(str) for name in self.sweep.match), strict=True
        )
        numbers: dict[tuple[str, ...], float] = {}
        for key, value in zip(
            keys, np.asarray(data[self.sweep.column], dtype=float), strict=True
        ):
            numbers.setdefault(key, float(value))
        return numbers

    def deviations(self, reference: Tables, given: Tables) -> list[Deviation]:
        """Return the deviation of the column from the reference."""
        ours, theirs = self._by_key(given), self._by_key(reference)
        scale = max((abs(x) for x in theirs.values() if np.isfinite(x)), default=0.0) or 1.0
        shared = [key for key in theirs if key in ours and np.isfinite(theirs[key])]
        off = [abs(ours[key] - theirs[key]) / scale for key in shared]
        expected = sum(np.isfinite(x) for x in theirs.values())
        error = max([EPS, *off])
        return [
            Deviation(
                self.sweep.table,
                self.sweep.column,
                error,
                scale,
                expected,
                expected - len(shared),
            )
        ]
