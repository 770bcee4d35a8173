"""What a run will cost, extrapolated from a few of its own samples.

Counts follow from the plan. Seconds and bytes are measured: a few samples go through the
same steps as the run, in two sizes, and a straight line through both is followed to the
number of samples asked for. The clock is that of the process, which other processes do
not add to. What does not grow with the samples is not predicted.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Batch, Needs, run_status
from spherekit.analysis.cost import AXES, TABLES, Ledger
from spherekit.analysis.course import Course
from spherekit.analysis.result import MOTION, stem_of
from spherekit.analysis.sizes import Growth, csv_row, parquet_row
from spherekit.analysis.tables import TableData
from spherekit.motion.continued import AngleMemory
from spherekit.motion.motion import Motion
from spherekit.rates.field import evaluate
from spherekit.rates.request import Request

ENOUGH = 5000
"""Configurations below which a run is over before its forecast would pay."""

LEAST = 4
"""Samples below which no trial is smaller than the run."""

FEW = 48
"""Configurations of the smaller of two trials."""

PATIENCE = 0.12
"""Seconds that the larger one may take, as far as the smaller one tells."""

LARGER = 6
"""How many times as many it has at least, so that a line through both is no guess."""

WRITING = 0.45
"""Time to write a number as CSV and Parquet, over that of writing its shortest text."""


@final
@dataclass(frozen=True)
class Trial:
    """Seconds by stage, and the tables, of a few configurations."""

    rows: int
    seconds: Mapping[str, float]
    tables: Mapping[str, TableData]
    by_equations: int
    failed: tuple[str, ...]


def forecast(
    course: Course,
    chosen: Sequence[AbstractAnalysis],
    own: Sequence[Needs],
    wanted: Sequence[Request],
    samples: int,
    block: int,
) -> dict[str, Any]:
    """Return the cost of a run over a course whose branches are known, ready for JSON.

    Parameters
    ----------
    course
        The run's course, or one over the same ranges with fewer samples.
    chosen, own, wanted
        The analyses, what each needs, and the requests for all of them.
    samples, block
        Samples of the run, and those evaluated at once.
    """
    tracer = course.tracer

    def few(count: int) -> Motion:
        motion = tracer.sparse(count)
        if course.timing is None:
            return motion
        rows = np.unique(np.linspace(0, len(course) - 1, motion.samples).astype(np.intp))
        timing = course.timing.rows(rows).repeated(len(motion.branches))
        return replace(motion, timing=timing)

    def batch(motion: Motion, needs: Needs, found: Any) -> Batch:
        plans = tuple(item.plan for item in wanted)
        angles = AngleMemory().continued(motion, needs.continued_values)
        return Batch(
            motion.mechanism, plans, needs, motion, found, angles, course.timed, tracer
        )

    branches = len(tracer.branches)
    found = extrapolated(few, batch, chosen, own, wanted, branches, samples, block)
    return {"branches": branches, **found}


def extrapolated(
    few: Callable[[int], Motion],
    batch: Callable[[Motion, Needs, Any], Batch],
    chosen: Sequence[AbstractAnalysis],
    own: Sequence[Needs],
    wanted: Sequence[Request],
    branches: int,
    samples: int,
    block: int,
) -> dict[str, Any]:
    """Return the cost of so many samples of so many branches from two trials.

    `few(count)` gives the configurations of some samples, `batch` what an analysis sees.
    """
    able = [
        (analysis, needs)
        for analysis, needs in zip(chosen, own, strict=True)
        if analysis.rowwise
    ]

    count = max(1, min(max(2, FEW // branches), samples // 2))
    small = _best(_trial(count, few, batch, able, wanted) for _ in range(2))
    if any(analysis.at_once for analysis in chosen):
        block = samples
    most = min(samples, block, int(PATIENCE / sum(small.seconds.values()) * count))
    large = _trial(max(LARGER * count, most), few, batch, able, wanted)
    rows = samples * branches
    blocks = -(-samples // block)
    seconds = {}
    for stage, more in large.seconds.items():
        less = small.seconds[stage]
        slope = max((more - less) / (large.rows - small.rows), 0.0)
        seconds[stage] = blocks * max(less - slope * small.rows, 0.0) + rows * slope
    tables, cells = {}, 0
    for name, data in large.tables.items():
        growth = Growth.between(
            (small.rows, small.tables[name]), (large.rows, data), rows, samples
        )
        tables[name] = {
            "rows": growth.rows,
            "columns": len(data),
            "csv_bytes": round(growth.rows * csv_row(data, samples)),
            "parquet_bytes": round(growth.rows * parquet_row(data, growth)),
        }
        cells += growth.rows * sum(v.dtype.kind == "f" for v in data.values())
    seconds[TABLES] = WRITING * cells * _seconds_of_a_number()
    names = {analysis.name for analysis, _ in able} - set(large.failed)
    return {
        "configurations": rows,
        "seconds": seconds,
        "tables": tables,
        "velocity_equation_solves": round(rows * large.by_equations / large.rows),
        "not_predicted": [a.name for a in chosen if a.name not in names],
    }


def _trial(
    count: int,
    few: Callable[[int], Motion],
    batch: Callable[[Motion, Needs, Any], Batch],
    able: Sequence[tuple[AbstractAnalysis, Needs]],
    wanted: Sequence[Request],
) -> Trial:
    ledger = Ledger(time.process_time)
    with ledger.stage("positions"):
        motion = few(count)
    with ledger.stage(AXES):
        found = tuple(evaluate(motion, item) for item in wanted if item.poles)
    tables = {MOTION: _motion_columns(motion, found)}
    failed = []
    for analysis, needs in able:
        try:
            with ledger.stage(f"analysis {analysis.name}"):
                made = analysis.compute(batch(motion, needs, found))
        except Exception:  # what a plugin cannot do here it reports in the run
            failed.append(analysis.name)
            continue
        for table in analysis.tables:
            data = {name: np.asarray(values) for name, values in made[table.name].items()}
            tables[stem_of(analysis.name, analysis.tables, table)] = data
    used = sum(int(np.sum(field.by_equations)) for field in found)
    return Trial(len(motion), ledger.seconds, tables, used, tuple(failed))


def _best(trials: Iterable[Trial]) -> Trial:
    """Return a trial with the least seconds that any of several took."""
    every = list(trials)
    least = {
        stage: min(trial.seconds[stage] for trial in every) for stage in every[0].seconds
    }
    return replace(every[0], seconds=least)


def _motion_columns(motion: Motion, found: Any) -> TableData:
    """Return the columns of the table of configurations."""
    names = motion.mechanism.variable_names
    return {
        "sample": motion.sample,
        "branch": motion.branch,
        **{f"q{k}": column for k, column in enumerate(motion.inputs.T)},
        **dict(zip(names, motion.values.T, strict=True)),
        "residual": motion.residual,
        "status": run_status(motion, found),
    }


def _seconds_of_a_number() -> float:
    """Return the time that the shortest text of a number takes on this machine."""
    numbers: list[float] = np.random.default_rng(1).normal(size=500).tolist()
    taken = []
    for _ in range(5):
        started = time.process_time()
        sum(len(repr(number)) for number in numbers)
        taken.append(time.process_time() - started)
    return min(taken) / len(numbers)
