"""Measuring the trade of speed for accuracy of one analysis of one mechanism."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Sweep
from spherekit.analysis.course import DEFAULT_TOLERANCE, course_of
from spherekit.analysis.registry import create
from spherekit.analysis.requests import requests_for
from spherekit.analysis.run import run
from spherekit.analysis.setting import Setting
from spherekit.analysis.tables import TableData
from spherekit.checked import checked
from spherekit.conventions import EPS
from spherekit.errors import AnalysisError
from spherekit.exact.arithmetic import wide
from spherekit.model.laws import Law, Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import DEFAULT_SAMPLES
from spherekit.sphere.rotation import Floats
from spherekit.trade.candidates import of_samples, of_simulation
from spherekit.trade.deviation import Deviation, scale_words
from spherekit.trade.measure import ROUNDS, Bench, Tables, race
from spherekit.trade.places import at_places, places
from spherekit.trade.record import Measured, Trade, check_tolerance, gathered
from spherekit.trade.simulated import measured
from spherekit.trade.stored import run_of

CHECKED = 361
"""Most samples at which errors are measured, and"""

CHECKED_ROWS = 1500
"""most rows, samples of all branches, unless the samples would be too few."""

FEWEST = 31


@checked(AnalysisError)
def trade(
    mechanism: Mechanism,
    analysis: str | AbstractAnalysis = "poles",
    *,
    samples: int | Sequence[int] = DEFAULT_SAMPLES,
    input_pair: str | Sequence[str] | None = None,
    branch: int | None = None,
    search: bool = True,
    path: Floats | None = None,
    laws: Mapping[str, Law] | None = None,
    duration: float | None = None,
    start: Start | None = None,
    torque: str | None = None,
    tolerance: float | None = None,
    settings: Sequence[Setting] | None = None,
    checked: int | None = None,
    rounds: int = ROUNDS,
    budget: float = 30.0,
) -> Trade:
    """Return the settings of an analysis with their times and true errors.

    Parameters
    ----------
    mechanism, analysis
        What is analysed; the analysis by its name with parameters, or as an object.
    samples, input_pair, branch, search, path, laws, duration, start, torque
        The run that settings are wanted for; see `spherekit.run`. Errors are measured at
        fewer samples over the same range, where there are many.
    tolerance
        Only checked here; see `Trade.cheapest`.
    settings
        Those to try; by default all that apply to samples, or to a simulation.
    checked
        How many samples to measure at.
    rounds, budget
        How often each is run for its time, and after how many seconds no round begins.

    Raises
    ------
    AnalysisError
        If the analysis reads nothing that depends on a setting, or the tolerance is none.
    PlanError, SolveError, ModelError
        See `spherekit.run`.
    """
    if tolerance is not None:
        check_tolerance(mechanism.name, tolerance)
    chosen = create(analysis) if isinstance(analysis, str) else analysis
    asked = samples if isinstance(samples, int) else int(np.prod(samples))
    if path is not None:
        asked = len(path)
    common: dict[str, Any] = {
        "input_pair": input_pair,
        "branch": branch,
        "search": search,
        "grid": False,
        "laws": laws or {},
        "duration": duration,
        "start": start,
        "torque": torque,
        "tolerance": DEFAULT_TOLERANCE,
    }
    made_for = run_of(
        mechanism,
        chosen,
        samples=samples,
        input_pair=input_pair,
        branch=branch,
        search=search,
        path=path,
        laws=laws,
        duration=duration,
        start=start,
        torque=torque,
    )
    if chosen.trades:
        return _of_parameters(mechanism, chosen, asked, rounds, budget, made_for)
    if start is not None:
        few = min(asked, checked or CHECKED)
        course = course_of(mechanism, samples=few, path=None, **common)
    else:
        course = course_of(mechanism, samples=samples, path=path, **common)
    bench = Bench.of(course, chosen)
    if not bench.reads_poles:
        raise AnalysisError(
            f"{chosen.name}: reads no poles, rates or positions of the samples and "
            "declares no parameter that trades speed for accuracy (`trades`); there is "
            "nothing to measure"
        )
    if start is not None:
        every = of_simulation() if settings is None else settings
        words, floor, reference, found = measured(
            bench, start, torque, every, rounds, budget
        )
        return _trade(bench, asked, words, floor, reference, found, made_for)
    most = checked or max(FEWEST, CHECKED_ROWS // len(course.tracer.branches))
    bench = _at_fewer(bench, samples, min(most, CHECKED), search, common)
    course = bench.course
    right = bench.reference()
    reference = right.tables
    words = f"the closure equations in {wide().name}{right.without}"
    every = of_samples() if settings is None else settings

    def way(setting: Setting, judged: bool) -> tuple[Tables, float, float]:
        return bench.tables(setting, right if judged else None)

    ways = [(str(each), each, partial(way, each)) for each in every]
    found = race(
        ways,
        lambda tables: bench.deviations(tables, reference),
        len(course),
        rounds,
        budget,
    )
    return _trade(bench, asked, words, EPS, reference, found, made_for)


def _at_fewer(
    bench: Bench,
    samples: int | Sequence[int],
    most: int,
    search: bool,
    common: Mapping[str, Any],
) -> Bench:
    """Return the bench at about so many samples of the same range, or all of them."""
    course = bench.course
    if len(course) <= most:
        return bench
    if len(course.shape) > 1 and not isinstance(samples, int):
        side = max(2, int(most ** (1.0 / len(samples))))
        fewer = tuple(min(count, side) for count in samples)
        course = course_of(course.tracer.mechanism, samples=fewer, path=None, **common)
        return replace(bench, course=course)
    tracer = course.tracer
    wanted = requests_for(tracer.mechanism, bench.needs, tracer.by_rank)
    rows = places(course, most, wanted[0])
    return replace(bench, course=at_places(course, rows, search))


def _trade(
    bench: Bench,
    asked: int,
    reference_words: str,
    floor: float,
    reference: Tables,
    found: Sequence[Measured],
    made_for: Mapping[str, Any],
) -> Trade:
    mechanism = bench.course.tracer.mechanism
    own = [table.of(mechanism) for table in bench.analysis.tables]
    scales = {
        (each.table, each.column): each.scale
        for each in bench.deviations(reference, reference)
    }
    columns = [
        (
            f"{table.name}.{column.name}",
            scale_words(column),
            scales[table.name, column.name],
        )
        for table in own
        for column in table.columns
        if (table.name, column.name) in scales
    ]
    rows = len(bench.course) * len(bench.course.tracer.branches)
    return Trade(
        mechanism.name,
        bench.analysis.name,
        asked,
        len(bench.course),
        rows,
        reference_words,
        floor,
        int(bench.needs.derivatives),
        gathered(columns),
        tuple(found),
        made_for,
    )


def _of_parameters(
    mechanism: Mechanism,
    analysis: AbstractAnalysis,
    asked: int,
    rounds: int,
    budget: float,
    made_for: Mapping[str, Any],
) -> Trade:
    """Return the values of an analysis's own parameters against the most accurate."""
    every: list[Measured] = []
    columns: list[tuple[str, str, float]] = []
    for sweep in analysis.trades:
        estimates: dict[str, float] = {}
        way = partial(_swept, mechanism, analysis, sweep, estimates)
        names = [f"{sweep.parameter}={value:g}" for value in sweep.values]
        reference = way(names[-1], sweep.values[-1])[0]
        own = _Swept(sweep)
        ways = [
            (name, None, partial(way, name, value))
            for name, value in zip(names[:-1], sweep.values[:-1], strict=True)
        ]
        found = race(ways, partial(own.deviations, reference), 1, rounds, budget)
        every += [
            replace(each, estimate=estimates.get(each.name, np.nan)) for each in found
        ]
        scale = float(np.nanmax(np.abs(own.numbers(reference)), initial=0.0))
        columns.append((f"{sweep.table}.{sweep.column}", "over the largest", scale))
    floor = float(np.nanmin([each.error for each in every]))
    return Trade(
        mechanism.name,
        analysis.name,
        asked,
        1,
        1,
        "the tightest: "
        + ", ".join(f"{s.parameter}={s.values[-1]:g}" for s in analysis.trades),
        floor,
        None,
        tuple(columns),
        tuple(every),
        made_for,
    )


def _swept(
    mechanism: Mechanism,
    analysis: AbstractAnalysis,
    sweep: Sweep,
    estimates: dict[str, float],
    name: str,
    value: Any,
    _: bool = True,
) -> tuple[Tables, float, float]:
    """Run an analysis with one value of a parameter, and note its own estimate."""
    started = time.process_time()
    own = replace(analysis, **{sweep.parameter: value})  # type: ignore[type-var]
    result = run(mechanism, own, samples=2, search=False)
    if result.failures:
        raise AnalysisError(result.failures[analysis.name])
    data = result.results[analysis.name].data[sweep.table]
    seconds = time.process_time() - started
    if sweep.error:
        estimates[name] = _estimate(data, sweep)
    return {sweep.table: data}, seconds, seconds


def _estimate(data: TableData, sweep: Sweep) -> float:
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
        found: dict[tuple[str, ...], float] = {}
        for key, value in zip(
            keys, np.asarray(data[self.sweep.column], dtype=float), strict=True
        ):
            found.setdefault(key, float(value))
        return found

    def deviations(self, reference: Tables, given: Tables) -> list[Deviation]:
        """Return the deviation of the column from the reference."""
        ours, theirs = self._by_key(given), self._by_key(reference)
        scale = max((abs(x) for x in theirs.values() if np.isfinite(x)), default=0.0) or 1.0
        shared = [key for key in theirs if key in ours and np.isfinite(theirs[key])]
        off = [abs(ours[key] - theirs[key]) / scale for key in shared]
        known = sum(np.isfinite(x) for x in theirs.values())
        error = max([EPS, *off])
        return [
            Deviation(
                self.sweep.table,
                self.sweep.column,
                error,
                scale,
                known,
                known - len(shared),
            )
        ]
