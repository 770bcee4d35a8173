"""Time of the command `explain` against the number of links."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import spherekit as sk
from benchmarks.harness import (
    Cell,
    Job,
    Section,
    measure_rounds,
    median_ratio,
    median_time,
)
from benchmarks.samples import grow_chain

EXPLAINED_LINK_COUNTS = (20, 40, 60, 80)
QUICK_EXPLAINED_LINK_COUNTS = (40,)

GEARS = "planetary_bevel"
"""A shipped mechanism with wheels."""


def run(quick: bool) -> list[Section]:
    """Return the table of chains of dyads and of a gear train, compared with a four-bar."""
    with TemporaryDirectory() as folder:
        subjects = {"four_bar": "four_bar", GEARS: GEARS}
        for links in QUICK_EXPLAINED_LINK_COUNTS if quick else EXPLAINED_LINK_COUNTS:
            path = Path(folder, f"{links}.toml")
            sk.dump(grow_chain(np.random.default_rng(5), links, False), path)
            subjects[f"chain of {links} links"] = str(path)
        jobs: dict[str, Job] = {
            name: partial(_run_explain, subject) for name, subject in subjects.items()
        }
        times = measure_rounds(
            jobs, 1 if quick else 3, min_seconds=0.0, clock=_processor_time_of_children
        )
    rows: list[tuple[Cell, ...]] = [
        (name, median_time(times, name), median_ratio(times, name, "four_bar"))
        for name in jobs
    ]
    return [
        Section(
            "Explain",
            "Processor time of the command `spherekit explain` for all poles, in a "
            "process of its own. Chains start as a four-bar and grow by dyads at random "
            "links. Up to 400 poles (28 links), all assembly modes are measured. Beyond "
            "that, one mode and a sample of the poles are measured, so a chain of 20 "
            "links may take longer than one of 40.",
            ("mechanism", "s", "over the four-bar"),
            rows,
        )
    ]


def _run_explain(subject: str) -> None:
    """Run the command in a new process, because a process keeps compiled kernels.

    `subject` is the name or the path of a mechanism.
    """
    command = [sys.executable, "-m", "spherekit", "explain", subject]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _processor_time_of_children() -> float:
    """Return the processor time (s) of all child processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system
