"""The benchmarks page, made from a record of results.

A record is a mapping with the `machine` and the `benchmarks`: for each name the list of
its sections. Each section has the commit at which it was measured.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.comparison import SectionRecord, comparison_section
from benchmarks.harness import Section, format_section

HEADING = "# Benchmarks"
METHOD = """\
## How the times were taken

Each time is the median of several repetitions. If times of two tasks are compared, the
tasks alternate within one run, and the ratio is the median of the ratios of all rounds. On
other machines, or while other programs run, ratios are similar, but single times are not.

To repeat the measurements, run `pip install -e '.[test,peers]'` and then `python -m
benchmarks` in the root of the repository. The extra `peers` installs the other programs;
programs that are not installed are skipped. To run only some of the benchmarks, give their
names, as in `python -m benchmarks planning peers`; `--quick` shortens the run. `--add
docs/benchmarks.json` adds the results to the record of this page, and `python
docs/make_benchmarks.py` then writes the page. Other pages have further measurements: [rows
of a run](engine.md#rows-at-once), [long runs](runs.md#how-long-how-large), [cost](cost.md),
[accuracy](accuracy.md), [proof](proof.md) and [extreme cases](extremes.md)."""
"""How the results were measured, and how to measure them again."""


def record_sections(
    record: dict[str, Any],
    name: str,
    sections: Sequence[Section],
    machine: Mapping[str, str],
    commit: str | None,
) -> None:
    """Put the sections of a benchmark into a record, in place of earlier ones.

    Parameters
    ----------
    record
        The record, which may be empty.
    name
        Name of the benchmark.
    sections
        Its results.
    machine
        Description of the machine.
    commit
        The commit that was measured.

    Raises
    ------
    ValueError
        The record has results of another machine or of other versions.
    """
    if record.setdefault("machine", dict(machine)) != machine:
        raise ValueError(
            "the record has results of another machine or of other versions; "
            "name another file, or delete this one to measure everything anew"
        )
    benchmarks = record.setdefault("benchmarks", {})
    benchmarks[name] = [{**asdict(section), "commit": commit} for section in sections]


def read_record(path: Path) -> dict[str, Any]:
    """Return the record in a file, or an empty one if there is no file."""
    if not path.exists():
        return {}
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def write_record(record: Mapping[str, Any], path: Path) -> None:
    """Write a record as JSON."""
    path.write_text(json.dumps(record, indent=1, default=float) + "\n", encoding="utf-8")


def page_text(record: Mapping[str, Any]) -> str:
    """Return the page as Markdown.

    The page begins with the comparison with other programs. If all sections were measured
    at one commit, it is stated once; otherwise each section states its own.
    """
    benchmarks: Mapping[str, Sequence[SectionRecord]] = record["benchmarks"]
    commits = {
        section["commit"] for sections in benchmarks.values() for section in sections
    }
    parts = [HEADING]
    comparison = comparison_section(benchmarks)
    if comparison is not None:
        parts.append(format_section(comparison))
    machine = "; ".join(f"{key} {value}" for key, value in record["machine"].items())
    parts += [METHOD, f"Machine: {machine}."]
    if len(commits) == 1:
        parts.append(f"All results were taken at commit {next(iter(commits))}.")
    for sections in benchmarks.values():
        for section in sections:
            fields = {key: value for key, value in section.items() if key != "commit"}
            own_commit = section["commit"] if len(commits) > 1 else None
            parts.append(format_section(Section(**fields), own_commit))
    return "\n\n".join(parts) + "\n"
