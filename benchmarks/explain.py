"""What `explain` takes against the number of links."""

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import spherekit as sk
from benchmarks.harness import Cell, Section, median, ratio, rounds
from benchmarks.samples import grown

SIZES = (20, 40, 60, 80)
QUICK = (40,)
GEARS = "planetary_bevel"
"""A shipped mechanism with wheels."""


def run(quick: bool) -> list[Section]:
    """Return the table of chains of dyads and of a train of wheels, next to a four-bar."""
    with TemporaryDirectory() as folder:
        subjects = {"four_bar": "four_bar", GEARS: GEARS}
        for links in QUICK if quick else SIZES:
            path = Path(folder, f"{links}.toml")
            sk.dump(grown(np.random.default_rng(5), links, False), path)
            subjects[f"chain of {links} links"] = str(path)
        jobs: dict[str, Callable[[], object]] = {
            name: partial(_explain, subject) for name, subject in subjects.items()
        }
        times = rounds(jobs, 1 if quick else 3, 0.0, now=_processor_time_of_children)
    rows: list[tuple[Cell, ...]] = [
        (name, median(times, name), ratio(times, name, "four_bar")) for name in jobs
    ]
    return [
        Section(
            "Explain",
            "Processor time of the command `spherekit explain`, all poles, in a process of "
            "its own. Chains are a four-bar grown by dyads at random links. Up to 400 "
            "poles (28 links) all assembly modes are measured, and beyond that one of them "
            "and a sample of the poles, so a chain of 20 links may take longer than one of "
            "40.",
            ("mechanism", "s", "over the four-bar"),
            rows,
        )
    ]


def _explain(subject: str) -> None:
    """Run the command; a process that has explained a mechanism keeps its kernels."""
    command = [sys.executable, "-m", "spherekit", "explain", subject]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _processor_time_of_children() -> float:
    """Return the processor time (s) of all processes that were waited for."""
    times = os.times()
    return times.children_user + times.children_system
