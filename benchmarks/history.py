"""Ratios kept from run to run, and how they changed.

A file of JSON lines, one for each run: date, commit, machine, and every ratio by
benchmark, section, row and column. Single times are not kept: they hold for one machine
at one moment.
"""

import json
import statistics
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.report import Section

HISTORY = Path(__file__).parent / "history.jsonl"
NOISE = 0.25
"""Relative change of a ratio that load and chance cause on a shared machine."""

ALIKE = ("processor", "cores", "system")
"""What two machines have in common whose ratios are compared."""

Entry = dict[str, Any]


def entry_of(
    sections: Mapping[str, Sequence[Section]], machine: Mapping[str, str], quick: bool
) -> Entry:
    """Return what is kept of a run: its ratios, and what they were taken on."""
    figures = {
        f"{name} | {section.title} | {key}": float(f"{value:.4g}")
        for name, own in sections.items()
        for section in own
        for key, value in section.figures().items()
    }
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit(),
        "quick": quick,
        "machine": dict(machine),
        "ratios": figures,
    }


def commit() -> str | None:
    """Return the commit of the working tree, with a plus if files were changed."""
    root = Path(__file__).parent
    try:
        found = [
            subprocess.run(
                ["git", *words], cwd=root, check=True, capture_output=True, text=True
            ).stdout.strip()
            for words in (
                ("rev-parse", "--short=12", "HEAD"),
                ("status", "--porcelain", "--untracked-files=no"),
            )
        ]
    except (OSError, subprocess.CalledProcessError):
        return None
    return found[0] + ("+" if found[1] else "")


def keep(entry: Entry, path: Path = HISTORY) -> None:
    """Append an entry."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, sort_keys=True) + "\n")


def kept(path: Path = HISTORY) -> list[Entry]:
    """Return all entries, the oldest first."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.strip()]


def comparison(entry: Entry, earlier: Sequence[Entry]) -> list[str]:
    """Return lines that say how each ratio changed against the last like run that has it.

    A change is flagged beyond `NOISE`, or beyond three times the median deviation of all
    earlier values where that is more.
    """
    alike = [one for one in earlier if _alike(one, entry)]
    if not alike:
        return ["no earlier run on a like machine was kept"]
    lines = []
    for name, value in entry["ratios"].items():
        known = [one["ratios"][name] for one in alike if name in one["ratios"]]
        if not known or known[-1] == 0.0:
            lines.append(f"      new  {value:.4g}  {name}")
            continue
        change = value / known[-1] - 1.0
        flag = "  " if abs(change) <= _noise(known) else "!!"
        lines.append(f"{flag} {100 * change:+6.1f} %  {value:.4g}  {name}")
    return lines


def _noise(known: Sequence[float]) -> float:
    middle = statistics.median(known)
    spread = statistics.median(abs(value / middle - 1.0) for value in known)
    return max(NOISE, 3.0 * spread)


def _alike(one: Entry, other: Entry) -> bool:
    same = all(one["machine"].get(key) == other["machine"].get(key) for key in ALIKE)
    return same and one["quick"] == other["quick"]
