"""Times of jobs that alternate, so that a busy machine slows all of them alike."""

import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence

Times = Mapping[str, Sequence[float]]
"""Seconds of each job, one figure for each round."""


def rounds(
    jobs: Mapping[str, Callable[[], object]],
    repeats: int,
    least: float = 0.02,
    now: Callable[[], float] = time.perf_counter,
) -> Times:
    """Return the times of jobs, each repeated within a round for `least` seconds.

    `now` tells the time: that of the clock on the wall, or, for jobs of one thread that
    only compute, `time.process_time`, which other processes do not add to.
    """
    number = {}
    for name, job in jobs.items():
        job()
        once = clock(job, 1, now)
        number[name] = max(1, math.ceil(least / max(once, 1e-9)))
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


def process(*arguments: str) -> Callable[[], object]:
    """Return a job: a fresh Python process with these arguments, to its end."""

    def job() -> object:
        return subprocess.run(
            [sys.executable, *arguments],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    return job
