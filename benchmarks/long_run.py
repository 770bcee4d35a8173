"""Time, memory and sizes of runs of many samples, and the best length of a block."""

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

RUNS = (("stephenson", "poles:only=31"), ("four_bar", "poles"), ("four_bar", "eksergian"))
"""Mechanisms and analyses that are measured."""

SAMPLE_COUNTS = (10_000, 100_000, 1_000_000)

LARGEST_SAMPLE_COUNT = 10_000_000
"""Number of samples of the first run only: 15 minutes, and 25 GB while it runs."""

LARGEST_RUN_BYTES = 30e9
"""Free space (bytes) on the disk without which the largest run is left out."""

RUN_PROGRAM = """
import json, resource, sys
from spherekit.cli.main import main
status = main(sys.argv[1:])
peak = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([status, peak.ru_maxrss * 1024, peak.ru_utime + peak.ru_stime]))
"""
"""Program of a process that runs a command.

It prints the exit status, the largest memory (bytes) and the processor time (s).
"""

MEASURED_BLOCK_SIZES = (
    BLOCK_ROWS >> 5,
    BLOCK_ROWS >> 3,
    BLOCK_ROWS >> 1,
    BLOCK_ROWS,
    BLOCK_ROWS << 1,
    BLOCK_ROWS << 3,
)
"""Numbers of rows in a block that are compared."""


def run(quick: bool) -> list[Section]:
    """Return the costs of long runs, and the times of different block sizes."""
    return [_measure_runs(quick), _measure_blocks(quick)]


def _measure_runs(quick: bool) -> Section:
    """Measure whole processes of the command `run`."""
    sample_counts = SAMPLE_COUNTS[:2] if quick else SAMPLE_COUNTS
    measured = [(*names, count) for names in RUNS for count in sample_counts]
    if not quick:
        measured.append((*RUNS[0], LARGEST_SAMPLE_COUNT))
    rows: list[tuple[Cell, ...]] = []
    for name, analysis, samples in measured:
        with tempfile.TemporaryDirectory() as folder:
            free_bytes = shutil.disk_usage(folder).free
        if samples == LARGEST_SAMPLE_COUNT and free_bytes < LARGEST_RUN_BYTES:
            rows.append((name, analysis, samples, *[None] * 6))
        else:
            rows.append((name, analysis, samples, *_measure_run(name, analysis, samples)))
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


def _measure_run(name: str, analysis: str, samples: int) -> tuple[Cell, ...]:
    """Run an analysis in a process of its own.

    Returns
    -------
    Wall time and processor time (s), time (us) for each configuration, largest memory (MB),
    and sizes (MB) of the CSV and the Parquet files.
    """
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", name, "-a", analysis, "--samples", str(samples), "-q"]
        started = time.perf_counter()
        process = subprocess.run(
            [sys.executable, "-c", RUN_PROGRAM, *arguments, "-o", folder],
            check=True,
            capture_output=True,
            text=True,
        )
        wall_seconds = time.perf_counter() - started
        last_line = process.stdout.splitlines()[-1]
        status, peak_bytes, processor_seconds = json.loads(last_line)
        assert status == 0, process.stderr
        summary = json.loads((Path(folder) / "summary.json").read_text())
        megabytes = {
            ending: 1e-6 * sum(x.stat().st_size for x in Path(folder).glob(f"*.{ending}"))
            for ending in ("csv", "parquet")
        }
    configurations = samples * len(summary["assembly_modes"])
    return (
        wall_seconds,
        processor_seconds,
        1e6 * processor_seconds / configurations,
        peak_bytes / 1e6,
        megabytes["csv"],
        megabytes["parquet"],
    )


def _measure_blocks(quick: bool) -> Section:
    """Measure the same run in blocks of different sizes."""
    mechanism = load("stephenson")
    mode_count = len(PositionAnalysis(mechanism, samples=2).assembly_modes)
    samples = MEASURED_BLOCK_SIZES[-1] // mode_count
    best_seconds = dict.fromkeys(MEASURED_BLOCK_SIZES, float("inf"))
    for _ in range(2 if quick else 5):
        for size in MEASURED_BLOCK_SIZES:
            started = time.process_time()
            run_analyses(
                mechanism,
                "poles:only=31",
                samples=samples,
                block=size // mode_count,
                tables=False,
            )
            seconds = time.process_time() - started
            best_seconds[size] = min(best_seconds[size], seconds)
    rows: list[tuple[Cell, ...]] = [
        (
            size,
            1e6 * seconds / (samples * mode_count),
            seconds / best_seconds[BLOCK_ROWS],
        )
        for size, seconds in best_seconds.items()
    ]
    return Section(
        "Rows evaluated at once",
        f"The Stephenson mechanism, `poles:only=31`, {samples} samples of {mode_count} "
        f"assembly modes, no tables kept; best processor time of the rounds. A run takes "
        f"{BLOCK_ROWS} rows of all assembly modes together.",
        ("rows in a block", "us per configuration", f"over {BLOCK_ROWS}"),
        rows,
    )
