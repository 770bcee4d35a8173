"""Times of alternating jobs, tables of results as Markdown, and facts of the machine."""

import math
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import spherekit
from spherekit.files.library import shipped

Cell = str | int | float | None
"""An entry of a table; None is shown as a dash."""

Job = Callable[[], object]
"""Something whose time is measured."""

TimesByJob = Mapping[str, Sequence[float]]
"""Seconds of each job, by its name: one number for each round."""

MIN_ROUND_SECONDS = 0.02
"""A job is repeated within a round for at least this time (s).

Larger: times are more exact. Smaller: benchmarks take less time.
"""

CLOCK_RESOLUTION_SECONDS = 1e-9
"""A job counts as taking at least this time (s), so that its repetitions are finite."""

PLAIN_NUMBER_LIMIT = 1000
"""Numbers from this size on are shown without decimals, others with three digits."""


@dataclass(frozen=True)
class Section:
    """A section of results: a table with its heading.

    Attributes
    ----------
    title
        The heading.
    text
        What is compared, and in which unit.
    columns
        Headings of the columns.
    rows
        The rows of the table.
    conclusion
        Sentences below the table.
    """

    title: str
    text: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    conclusion: str = ""


def format_section(section: Section, commit: str | None = None) -> str:
    """Return a section as Markdown.

    Parameters
    ----------
    section
        The section.
    commit
        The commit at which it was measured, if it is known.
    """
    lines = [f"## {section.title}", "", section.text, ""]
    if commit:
        lines += [f"Taken at commit {commit}.", ""]
    lines.append("| " + " | ".join(section.columns) + " |")
    is_numeric = [
        all(not isinstance(row[k], str) for row in section.rows)
        for k in range(len(section.columns))
    ]
    lines.append("|" + "|".join("---:" if x else "---" for x in is_numeric) + "|")
    lines += ["| " + " | ".join(map(format_cell, row)) + " |" for row in section.rows]
    if section.conclusion:
        lines += ["", section.conclusion]
    return "\n".join(lines)


def format_cell(cell: Cell) -> str:
    """Return an entry of a table as text. Numbers that are not whole have three digits."""
    if cell is None:
        return "-"
    if not isinstance(cell, float):
        return str(cell)
    return f"{cell:.0f}" if abs(cell) >= PLAIN_NUMBER_LIMIT else f"{cell:.3g}"


def measure_rounds(
    jobs: Mapping[str, Job],
    round_count: int,
    min_seconds: float = MIN_ROUND_SECONDS,
    clock: Callable[[], float] = time.perf_counter,
) -> TimesByJob:
    """Measure the times of jobs in rounds.

    The jobs alternate, so that a busy machine slows all of them alike. Each job runs once
    before the first round.

    Parameters
    ----------
    jobs
        The jobs by name.
    round_count
        Number of rounds.
    min_seconds
        A job is repeated within a round for about this time (s).
    clock
        Function that returns the time (s). By default it is that of a clock on the wall.
        For jobs of one thread that only compute, `time.process_time` is better, because
        other processes do not add to it.

    Returns
    -------
    The mean time (s) of a job in each round, by its name.
    """
    repetitions = {}
    for name, job in jobs.items():
        job()
        seconds = max(measure_mean_time(job, 1, clock), CLOCK_RESOLUTION_SECONDS)
        repetitions[name] = max(1, math.ceil(min_seconds / seconds))
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(round_count):
        for name, job in jobs.items():
            times[name].append(measure_mean_time(job, repetitions[name], clock))
    return times


def measure_mean_time(
    job: Job, repetitions: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the mean time (s) of some repetitions of a job."""
    started = clock()
    for _ in range(repetitions):
        job()
    return (clock() - started) / repetitions


def median_time(times: TimesByJob, name: str) -> float:
    """Return the median over the rounds of the time (s) of a job."""
    return statistics.median(times[name])


def median_ratio(times: TimesByJob, name: str, unit_name: str) -> float:
    """Return the time of job `name` over that of job `unit_name`: the median of rounds."""
    pairs = zip(times[name], times[unit_name], strict=True)
    return statistics.median(seconds / unit for seconds, unit in pairs)


def list_own_mechanisms() -> tuple[str, ...]:
    """Return the sorted names of the mechanisms that spherekit itself ships."""
    packs = [pack for pack in shipped() if pack.name == "spherekit"]
    return tuple(sorted(name for pack in packs for name in pack.files))


def describe_machine() -> dict[str, str]:
    """Return processor, cores, system and versions, without the name of the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
    return {
        "processor": processor_model(),
        "cores": str(cores or os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "spherekit": spherekit.__version__,
    }


def processor_model() -> str:
    """Return the model of the processor, or ``"unknown"``."""
    path = Path("/proc/cpuinfo")  # exists on Linux only
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    models = (line.partition(":")[2].strip() for line in lines if "model name" in line)
    return next(models, platform.processor() or "unknown")


def current_commit() -> str | None:
    """Return the commit of the working tree, with a plus if files were changed."""
    command = ["git", "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]
    try:
        process = subprocess.run(
            command, cwd=Path(__file__).parent, check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return process.stdout.strip()
