"""Sections of results as Markdown, times of jobs that alternate, and the machine."""

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

Times = Mapping[str, Sequence[float]]
"""Seconds of each job, one figure for each round."""


@dataclass(frozen=True)
class Section:
    """A heading, sentences, and a table of text and numbers."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    conclusion: str = ""


def markdown(section: Section, commit: str | None = None) -> str:
    """Return a section taken at a commit as Markdown; numbers have three digits."""
    lines = [f"## {section.title}", "", section.text, ""]
    if commit:
        lines += [f"Taken at commit {commit}.", ""]
    lines.append("| " + " | ".join(section.columns) + " |")
    numeric = [
        all(not isinstance(row[k], str) for row in section.rows)
        for k in range(len(section.columns))
    ]
    lines.append("|" + "|".join("---:" if right else "---" for right in numeric) + "|")
    lines += ["| " + " | ".join(map(shown, row)) + " |" for row in section.rows]
    if section.conclusion:
        lines += ["", section.conclusion]
    return "\n".join(lines)


def shown(cell: Cell) -> str:
    """Return a cell as text."""
    if cell is None:
        return "-"
    if not isinstance(cell, float):
        return str(cell)
    return f"{cell:.0f}" if abs(cell) >= 1000 else f"{cell:.3g}"


def rounds(
    jobs: Mapping[str, Callable[[], object]],
    repeats: int,
    least: float = 0.02,
    now: Callable[[], float] = time.perf_counter,
) -> Times:
    """Return the times of jobs, each repeated within a round for `least` seconds.

    Jobs alternate, so that a busy machine slows all of them alike. `now` tells the time:
    that of the clock on the wall, or, for jobs of one thread that only compute,
    `time.process_time`, which other processes do not add to.
    """
    number = {}
    for name, job in jobs.items():
        job()
        number[name] = max(1, math.ceil(least / max(clock(job, 1, now), 1e-9)))
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            times[name].append(clock(job, number[name], now))
    return times


def clock(
    job: Callable[[], object],
    number: int,
    now: Callable[[], float] = time.perf_counter,
) -> float:
    """Return the mean time of a job (s)."""
    started = now()
    for _ in range(number):
        job()
    return (now() - started) / number


def median(times: Times, name: str) -> float:
    """Return the median time of a job (s)."""
    return statistics.median(times[name])


def ratio(times: Times, name: str, unit: str) -> float:
    """Return the median over the rounds of one job's time over another's."""
    pairs = zip(times[name], times[unit], strict=True)
    return statistics.median(one / other for one, other in pairs)


def own_mechanisms() -> tuple[str, ...]:
    """Return the names of the mechanisms that spherekit itself ships, in order."""
    packs = [pack for pack in shipped() if pack.name == "spherekit"]
    return tuple(sorted(name for pack in packs for name in pack.files))


def describe() -> dict[str, str]:
    """Return processor, cores, system and versions, without names of the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
    return {
        "processor": processor(),
        "cores": str(cores or os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "spherekit": spherekit.__version__,
    }


def processor() -> str:
    """Return the model of the processor, as far as the system tells."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
    models = (line.partition(":")[2].strip() for line in lines if "model name" in line)
    return next(models, platform.processor() or "unknown")


def commit() -> str | None:
    """Return the commit of the working tree, with a plus if files were changed."""
    words = ["git", "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]
    try:
        done = subprocess.run(
            words, cwd=Path(__file__).parent, check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
