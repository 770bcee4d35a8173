"""Runs of many samples: time, memory and sizes, and how long a block should be."""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.harness import Cell, Section
from spherekit.files.mechanism_reader import load
from spherekit.positions.position_analysis import BLOCK_ROWS, PositionAnalysis
from spherekit.runs.runner import run as run_analyses

JOBS = (("stephenson", "poles:only=31"), ("four_bar", "poles"), ("four_bar", "eksergian"))
SAMPLES = (10_000, 100_000, 1_000_000)
MANY = 10_000_000
"""Of the first job only: a quarter of an hour, and 25 GB while it goes on."""

ROOM = 30e9
CODE = """
import json, resource, sys
from spherekit.cli.main import main
status = main(sys.argv[1:])
peak = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([status, peak.ru_maxrss * 1024, peak.ru_utime + peak.ru_stime]))
"""


def run(quick: bool) -> list[Section]:
    """Return what long runs take, and the time and memory of blocks."""
    return [_runs(quick), _blocks(quick)]


def _runs(quick: bool) -> Section:
    wanted = [(*job, count) for job in JOBS for count in SAMPLES[: 2 if quick else None]]
    if not quick:
        wanted.append((*JOBS[0], MANY))
    rows: list[tuple[Cell, ...]] = []
    for name, analysis, samples in wanted:
        with tempfile.TemporaryDirectory() as folder:
            if samples == MANY and shutil.disk_usage(folder).free < ROOM:
                rows.append((name, analysis, samples, *[None] * 6))
                continue
            rows.append((name, analysis, samples, *_measured(name, analysis, samples)))
    return Section(
        "Runs of many samples",
        "`spherekit run NAME -a ANALYSIS --samples N -o DIR`, whole processes, tables as "
        "CSV and Parquet; a configuration is one sample of one assembly mode. Memory is "
        "the "
        "largest resident set.",
        (
            "mechanism",
            "analysis",
            "samples",
            "wall s",
            "processor s",
            "us per configuration",
            "peak MB",
            "CSV MB",
            "Parquet MB",
        ),
        rows,
    )


def _measured(name: str, analysis: str, samples: int) -> tuple[Cell, ...]:
    with tempfile.TemporaryDirectory() as folder:
        words = ["run", name, "-a", analysis, "--samples", str(samples), "-q"]
        started = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", CODE, *words, "-o", folder],
            check=True,
            capture_output=True,
            text=True,
        )
        wall = time.perf_counter() - started
        status, peak, seconds = json.loads(done.stdout.splitlines()[-1])
        assert status == 0, done.stderr
        summary = json.loads((Path(folder) / "summary.json").read_text())
        size = {
            kind: sum(path.stat().st_size for path in Path(folder).glob(f"*.{kind}")) / 1e6
            for kind in ("csv", "parquet")
        }
    configurations = samples * len(summary["assembly_modes"])
    each = 1e6 * seconds / configurations
    return wall, seconds, each, peak / 1e6, size["csv"], size["parquet"]


def _blocks(quick: bool) -> Section:
    made = load("stephenson")
    assembly_modes = len(PositionAnalysis(made, samples=2).assembly_modes)
    sizes = [
        BLOCK_ROWS >> 5,
        BLOCK_ROWS >> 3,
        BLOCK_ROWS >> 1,
        BLOCK_ROWS,
        BLOCK_ROWS << 1,
        BLOCK_ROWS << 3,
    ]
    samples = sizes[-1] // assembly_modes
    best = dict.fromkeys(sizes, float("inf"))
    for _ in range(2 if quick else 5):
        for size in sizes:
            started = time.process_time()
            run_analyses(
                made,
                "poles:only=31",
                samples=samples,
                block=size // assembly_modes,
                tables=False,
            )
            best[size] = min(best[size], time.process_time() - started)
    rows: list[tuple[Cell, ...]] = [
        (size, 1e6 * seconds / (samples * assembly_modes), seconds / best[BLOCK_ROWS])
        for size, seconds in best.items()
    ]
    return Section(
        "Rows evaluated at once",
        f"The Stephenson mechanism, `poles:only=31`, {samples} samples of {assembly_modes} "
        f"assembly modes, no tables kept; best processor time of the rounds. A run takes "
        f"{BLOCK_ROWS} rows of all assembly modes together.",
        ("rows in a block", "us per configuration", f"over {BLOCK_ROWS}"),
        rows,
    )
