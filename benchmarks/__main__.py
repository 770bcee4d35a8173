"""Runs benchmarks, and writes their results as Markdown and as JSON."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

from benchmarks import extremes
from benchmarks.harness import current_commit, describe_machine, format_section
from benchmarks.page import read_record, record_sections, write_record

NAMES = (
    "planning",
    "inverse",
    "singularities",
    "proof",
    "engine",
    "stored",
    "designs",
    "peers",
    "region",
    "long_run",
    "pruning",
    "explain",
    "road",
    "source",
    "extremes",
)
"""Modules of this package, each with a function `run(quick)` that returns sections."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run benchmarks and print their sections.

    Parameters
    ----------
    arguments
        Arguments of the command, by default those of the process.

    Returns
    -------
    The exit status.
    """
    parser = _make_parser()
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark is named {unknown[0]}; choose from {NAMES}")
    only = options.only or []
    if options.list:
        print("\n".join(f"{name}: {case.text}" for name, case in extremes.cases().items()))
        return 0
    unknown_cases = [name for name in only if name not in extremes.cases()]
    if unknown_cases and "proof" not in options.names:
        parser.error(f"no case is named {unknown_cases[0]}; see --list")
    machine = describe_machine()
    print("# Benchmarks\n")
    print("Machine: " + "; ".join(f"{key} {value}" for key, value in machine.items()))
    commit = current_commit()
    sections_by_name = {}
    record_path = Path(options.add) if options.add else None
    for name in options.names or NAMES:
        started = time.perf_counter()
        module = import_module(f"benchmarks.{name}")
        settings: dict[str, object] = {}
        if name == "extremes":
            settings = {"only": only}
        elif name == "proof":
            settings = {"count": options.count, "first": options.first, "only": only}
        sections = module.run(options.quick, **settings)
        print(f"{name}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
        sections_by_name[name] = [asdict(section) for section in sections]
        for section in sections:
            print("\n" + format_section(section, commit), flush=True)
        if record_path is not None:
            # Written after each benchmark, so that an interruption loses only one of them.
            record = read_record(record_path)
            try:
                record_sections(record, name, sections, machine, commit)
            except ValueError as error:
                parser.error(f"{record_path}: {error}")
            write_record(record, record_path)
    if options.json:
        content = {"commit": commit, "machine": machine, "benchmarks": sections_by_name}
        text = json.dumps(content, indent=1, default=float)
        Path(options.json).write_text(text + "\n", encoding="utf-8")
    return 0


def _make_parser() -> argparse.ArgumentParser:
    """Return the parser of the arguments."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--quick", action="store_true", help="fewer sizes and rounds")
    parser.add_argument(
        "--count", type=int, metavar="N", help="mechanisms of a kind in proof"
    )
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        metavar="SEED",
        help="seed of the first mechanism of each kind in proof, so that runs add up",
    )
    parser.add_argument("--list", action="store_true", help="list the cases of extremes")
    parser.add_argument(
        "--only",
        action="append",
        metavar="CASE",
        help="of extremes this case, in full; of proof this group or mechanism",
    )
    parser.add_argument(
        "--json", metavar="FILE", help="also write the results to this file"
    )
    parser.add_argument(
        "--add",
        metavar="FILE",
        help="put the results into this record, from which the page is made",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
