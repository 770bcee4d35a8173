"""What a narrow request saves over all poles: time, sizes, and groups left out."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.harness import Cell, Section, median, ratio, rounds
from benchmarks.samples import grown
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.analysis_requests import collect_needs, plan_requests
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_cost import count_evaluations
from spherekit.runs.run_plan import extract_needed_part
from spherekit.runs.runner import run as run_analyses
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import Request

SAMPLES = 361
WIDE = "poles"
NARROW = {"one of the four-bar": "poles:only=4/1", "one of a dyad": "poles:only=6/1"}


def _sizes(mechanism: Mechanism, text: str, only_needed: bool) -> tuple[int, ...]:
    """Return rows, bytes of CSV and of Parquet, entities and bytes of a recording."""
    from spherekit.display.rerun.recorder import RerunRecorder

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.rrd"
        with RerunRecorder(mechanism.name, path=path) as recorder:
            cost = run_analyses(
                mechanism,
                text,
                samples=SAMPLES,
                assembly_mode=0,
                only_needed=only_needed,
                folder=Path(folder) / "out",
                recorder=recorder,
            ).summary["cost"]
    tables = cost["tables"].values()
    csv = sum(table["csv_bytes"] for table in tables)
    parquet = sum(table["parquet_bytes"] for table in tables)
    rows = sum(table["rows"] for table in tables)
    logged = cost["recording"]
    return rows, csv, parquet, logged["entities"], logged["bytes"]


def _request(mechanism: Mechanism, text: str) -> Request:
    """Return the request of an analysis of one input."""
    (wanted,) = plan_requests(mechanism, collect_needs(mechanism, [create_analysis(text)]))
    return wanted


def _job(motion: Callable[[], Motion], wanted: Request) -> Callable[[], object]:
    return lambda: evaluate(motion(), wanted)


def _case(name: str, mechanism: Mechanism, repeats: int) -> list[tuple[Cell, ...]]:
    """Return the rows of one mechanism, over all poles of it."""
    whole = PositionAnalysis(mechanism, search=False, samples=SAMPLES)
    jobs = {"all poles": _job(whole.motion, _request(mechanism, WIDE))}
    about = {"all poles": (mechanism, WIDE, False)}
    for what, text in NARROW.items():
        jobs[what] = _job(whole.motion, _request(mechanism, text))
        about[what] = (mechanism, text, False)
        part = extract_needed_part(
            Study(mechanism.name, mechanism), [create_analysis(text)]
        )
        tracer = PositionAnalysis(part, search=False, samples=SAMPLES)
        jobs[f"{what}, only needed"] = _job(tracer.motion, _request(part, text))
        about[f"{what}, only needed"] = (mechanism, text, True)
    times = rounds(jobs, repeats)
    sizes = {what: _sizes(*given) for what, given in about.items()}
    base = sizes["all poles"]
    rows: list[tuple[Cell, ...]] = []
    for what, (made, text, only) in about.items():
        solved = made
        if only:
            solved = extract_needed_part(Study(made.name, made), [create_analysis(text)])
        counts = count_evaluations(_request(solved, text))
        own = sizes[what]
        rows.append(
            (
                name,
                what,
                ratio(times, what, "all poles"),
                own[1] / base[1],
                own[2] / base[2],
                own[4] / base[4],
                len(solved.links),
                counts["poles"],
                counts["axis_derivatives"],
                1e6 * median(times, what) / SAMPLES,
                own[0],
                1e-6 * own[1],
                own[3],
                1e-6 * own[4],
            )
        )
    return rows


def run(quick: bool) -> list[Section]:
    """Return the cost of narrow requests over that of all poles."""
    repeats = 3 if quick else 7
    long = grown(np.random.default_rng(1), 30, False)
    rows = _case("twelve_bar", load("twelve_bar"), repeats)
    rows += _case("30 links", long, repeats)
    return [
        Section(
            "Pruning",
            f"Positions, poles and coefficients with derivatives of assembly mode 0 at "
            f"{SAMPLES} "
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
