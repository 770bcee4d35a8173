"""Time and sizes of runs for one pole, compared with runs for all poles."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import (
    Cell,
    Job,
    Section,
    measure_rounds,
    median_ratio,
    median_time,
)
from benchmarks.samples import grow_chain
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.analysis_requests import plan_requests, unite_needs
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_cost import count_evaluations
from spherekit.runs.run_plan import extract_needed_part
from spherekit.runs.runner import run as run_analyses
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import Request

PRUNING_SAMPLES = 361
"""Number of samples of the input."""

ALL_POLES = "all poles"
"""Name of the run with which the others are compared."""

ALL_POLES_ANALYSIS = "poles"
ONE_POLE_ANALYSES = {
    "one of the four-bar": "poles:only=4/1",
    "one of a dyad": "poles:only=6/1",
}
"""Analyses for one pole, by their names in the table."""


@dataclass(frozen=True)
class MeasuredRun:
    """A run that is compared.

    Attributes
    ----------
    analysis
        The analysis with its options.
    only_needed
        Whether groups are left out on which the analysis does not depend.
    solved_mechanism
        The mechanism whose positions are solved.
    """

    analysis: str
    only_needed: bool
    solved_mechanism: Mechanism


@dataclass(frozen=True)
class RunSizes:
    """Sizes of the results of a run.

    Attributes
    ----------
    rows
        Number of rows of all tables.
    csv_bytes, parquet_bytes
        Sizes of the tables (bytes).
    entities, recording_bytes
        Number of entities of the recording, and its size (bytes).
    """

    rows: int
    csv_bytes: int
    parquet_bytes: int
    entities: int
    recording_bytes: int


def run(quick: bool) -> list[Section]:
    """Return the costs of runs for one pole relative to those of runs for all poles."""
    round_count = 3 if quick else 7
    long_chain = grow_chain(np.random.default_rng(1), 30, False)
    rows = _measure_mechanism("twelve_bar", load("twelve_bar"), round_count)
    rows += _measure_mechanism("30 links", long_chain, round_count)
    return [
        Section(
            "Pruning",
            f"Positions, poles and coefficients with derivatives of assembly mode 0 at "
            f"{PRUNING_SAMPLES} "
            "samples, for one coefficient and for all. Only needed: groups that nothing "
            "asked depends on are left out too. Sizes are those of a run with its tables "
            "and a recording. The chain of 30 links is a four-bar grown by dyads.",
            (
                "mechanism",
                "asked",
                "time",
                "CSV",
                "Parquet",
                "recording",
                "links",
                "poles evaluated",
                "derivatives",
                "us per sample",
                "rows",
                "CSV, MB",
                "entities",
                "recording, MB",
            ),
            rows,
            "The first four are over those of all poles.",
        )
    ]


def _measure_mechanism(
    name: str, mechanism: Mechanism, round_count: int
) -> list[tuple[Cell, ...]]:
    """Return the table rows that compare runs of one mechanism for one pole and for all.

    The first row is the run for all poles. Then each analysis of one pole has two rows. The
    first of them is a run of the whole mechanism. In the second, "only needed", groups of
    links on which the pole does not depend are left out. Times and sizes are stated
    relative to the first row of the table.

    Parameters
    ----------
    name
        Name of the mechanism in the table.
    mechanism
        The mechanism.
    round_count
        Number of rounds of time measurements.
    """
    runs = {ALL_POLES: MeasuredRun(ALL_POLES_ANALYSIS, False, mechanism)}
    for description, analysis in ONE_POLE_ANALYSES.items():
        runs[description] = MeasuredRun(analysis, False, mechanism)
        part = extract_needed_part(
            Study(mechanism.name, mechanism), [create_analysis(analysis)]
        )
        runs[f"{description}, only needed"] = MeasuredRun(analysis, True, part)
    whole = PositionAnalysis(mechanism, search=False, samples=PRUNING_SAMPLES)
    jobs: dict[str, Job] = {}
    for description, measured_run in runs.items():
        position_analysis = whole
        if measured_run.only_needed:
            position_analysis = PositionAnalysis(
                measured_run.solved_mechanism, search=False, samples=PRUNING_SAMPLES
            )
        pole_request = _make_request(measured_run)
        jobs[description] = _make_job(position_analysis.motion, pole_request)
    times = measure_rounds(jobs, round_count)
    sizes_by_run = {
        description: _measure_sizes(mechanism, measured_run)
        for description, measured_run in runs.items()
    }
    all_sizes = sizes_by_run[ALL_POLES]
    rows: list[tuple[Cell, ...]] = []
    for description, measured_run in runs.items():
        counts = count_evaluations(_make_request(measured_run))
        sizes = sizes_by_run[description]
        rows.append(
            (
                name,
                description,
                median_ratio(times, description, ALL_POLES),
                sizes.csv_bytes / all_sizes.csv_bytes,
                sizes.parquet_bytes / all_sizes.parquet_bytes,
                sizes.recording_bytes / all_sizes.recording_bytes,
                len(measured_run.solved_mechanism.links),
                counts["poles"],
                counts["axis_derivatives"],
                1e6 * median_time(times, description) / PRUNING_SAMPLES,
                sizes.rows,
                1e-6 * sizes.csv_bytes,
                sizes.entities,
                1e-6 * sizes.recording_bytes,
            )
        )
    return rows


def _make_request(measured_run: MeasuredRun) -> Request:
    """Return the poles that the analysis of a run needs."""
    mechanism = measured_run.solved_mechanism
    needs = unite_needs(mechanism, [create_analysis(measured_run.analysis)])
    (pole_request,) = plan_requests(mechanism, needs)
    return pole_request


def _make_job(compute_motion: Callable[[], Motion], pole_request: Request) -> Job:
    """Return a job that solves the positions and evaluates the poles."""
    return lambda: evaluate(compute_motion(), pole_request)


def _measure_sizes(mechanism: Mechanism, measured_run: MeasuredRun) -> RunSizes:
    """Run the analysis, and return the sizes of its tables and of its recording."""
    from spherekit.display.rerun.recorder import RerunRecorder

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.rrd"
        with RerunRecorder(mechanism.name, path=path) as recorder:
            result = run_analyses(
                mechanism,
                measured_run.analysis,
                samples=PRUNING_SAMPLES,
                assembly_mode=0,
                only_needed=measured_run.only_needed,
                folder=Path(folder) / "out",
                recorder=recorder,
            )
    cost = result.summary["cost"]
    tables = cost["tables"].values()
    return RunSizes(
        rows=sum(table["rows"] for table in tables),
        csv_bytes=sum(table["csv_bytes"] for table in tables),
        parquet_bytes=sum(table["parquet_bytes"] for table in tables),
        entities=cost["recording"]["entities"],
        recording_bytes=cost["recording"]["bytes"],
    )
