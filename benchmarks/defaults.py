"""Every analysis of every shipped mechanism by the default command: what it costs."""

import os
import subprocess
import sys

from benchmarks.harness import Cell, Section, own_mechanisms
from spherekit.analysis.registry import names as analysis_names

QUICK = ("four_bar", "five_bar", "bevel_pair")
TARGET = 10.0


def run(quick: bool) -> list[Section]:
    """Return the processor time of each run, and what is refused with its reason."""
    names = [name for name in own_mechanisms() if not quick or name in QUICK]
    analyses = analysis_names()
    rows: list[tuple[Cell, ...]] = []
    refused: list[tuple[Cell, ...]] = []
    longest: list[tuple[float, str]] = []
    for name in names:
        cells: list[Cell] = [name]
        for analysis in analyses:
            status, seconds, reason = of_command("run", name, "-a", analysis)
            print(f"{name} {analysis}: {status}, {seconds:.1f} s", file=sys.stderr)
            cells.append(seconds if status == 0 else f"{seconds:.2g} refused")
            longest.append((seconds, f"{name} {analysis}"))
            if status:
                refused.append((name, analysis, status, reason))
        rows.append(tuple(cells))
    over = [
        f"{which} {seconds:.3g} s" for seconds, which in sorted(longest) if seconds > TARGET
    ]
    return [
        Section(
            "Default runs",
            "Processor time of `spherekit run MECHANISM -a ANALYSIS` (s), of all its "
            "processes and threads, system time included, once each.",
            ("mechanism", *analyses),
            rows,
            f"Over {TARGET:g} s: {', '.join(over) or 'none'}.",
        ),
        Section(
            "Default runs that are refused",
            "The exit status and the first line of the message.",
            ("mechanism", "analysis", "status", "reason"),
            refused,
        ),
    ]


def of_command(*words: str) -> tuple[int, float, str]:
    """Return exit status, processor time (s) and the message's first line of a command."""
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-m", "spherekit", *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    after = os.times()
    spent = after.children_user - before.children_user
    spent += after.children_system - before.children_system
    lines = [line for line in done.stderr.splitlines() if line.startswith("spherekit:")]
    return done.returncode, spent, lines[0] if lines else ""
