"""`spherekit explain`: what will be planned, evaluated and logged."""

import math
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.study_arguments import add_study_arguments, study_from
from spherekit.conventions import Facts, Lines
from spherekit.wording import counted, numbered, size_text

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.runs.contract import AbstractAnalysis

EXAMPLES = """examples:
  # what one pole costs
  spherekit explain stephenson -a poles:only=31
  # sizes of tables and of a recording over a grid
  spherekit explain five_bar --samples 41x41 --recording
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_study_arguments(parser)
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        action="append",
        help="analysis to explain, may be repeated (default: the study's, or poles)",
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--only-needed",
        action="store_true",
        help="as `run --only-needed`: without links and pairs that no analysis needs",
    )
    parser.add_argument(
        "--recording",
        action="store_true",
        help="predict the recording too, from two short ones (needs a second or two)",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="as JSON",
    )


def execute(options: Namespace) -> int:
    """Print the closure of what the analyses need."""
    from spherekit.runs.expected_size import predict_recording
    from spherekit.runs.registry import create
    from spherekit.runs.run_plan import extract_needed_part
    from spherekit.runs.study_analyses import analyses_of

    study = study_from(options)
    analyses = [create(text) for text in options.analysis or ()] or analyses_of(study)
    if options.only_needed:
        study = replace(study, mechanism=extract_needed_part(study, analyses))
    facts = _facts(study, analyses)
    if options.recording and facts["predicted"].get("assembly_modes"):
        from spherekit.display.rerun.recorder import RerunRecorder

        with TemporaryDirectory() as folder:
            facts["predicted"]["recording"] = predict_recording(
                study,
                analyses,
                lambda n: RerunRecorder(study.name, path=Path(folder, f"{n}.rrd")),
            )
    if options.json:
        print_json(facts)
    else:
        _tell(facts, len(study.mechanism.links))
        print("\n".join(_predicted(facts["predicted"], options.recording)))
    return 0


def _facts(study: "Study", analyses: "list[AbstractAnalysis]") -> Facts:
    """Return what analyses ask for, and what that takes."""
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.planning.plan_text import describe
    from spherekit.positions.input_grid import check_sample_counts
    from spherekit.positions.motion_cache import (
        assembly_by_count_or_rank,
        is_mobile_by_rank_only,
    )
    from spherekit.runs.analysis_requests import needs_of, requests_for
    from spherekit.runs.expected_size import predict_run
    from spherekit.runs.resource_checks import evaluation_memory
    from spherekit.runs.run_cost import count_evaluations

    mechanism = study.mechanism
    check_sample_counts(mechanism, study.samples)
    assembly = assembly_by_count_or_rank(mechanism)
    by_rank = is_mobile_by_rank_only(mechanism)
    requests = requests_for(mechanism, needs_of(mechanism, analyses), by_rank)
    names = mechanism.links
    return {
        "mechanism": mechanism.name,
        "inputs": mechanism.names_of(driven_pairs(mechanism)),
        "analyses": [analysis.name for analysis in analyses],
        "positions": [
            {"group": group.kind, "pairs": mechanism.names_of(group.pairs)}
            for group in assembly.groups
        ],
        "asked": [
            f"P{names[j]}{names[i]}"
            if len(names[i]) == len(names[j]) == 1
            else f"P({names[j]},{names[i]})"
            for i, j in requests[0].poles
        ],
        "plans": [
            {
                "moving": mechanism.pairs[wanted.plan.input].name,
                "locked": mechanism.names_of(wanted.plan.locked),
                "counts": count_evaluations(wanted),
                "links_with_rates": [wanted.plan.name(body) for body in wanted.bodies],
                "derivatives": wanted.derivatives,
                "steps": [describe(wanted.plan, step) for step in wanted.plan.steps],
            }
            for wanted in requests
        ],
        "other_configurations": [
            analysis.name for analysis in analyses if analysis.needs(mechanism).tracer
        ],
        "predicted": predict_run(
            study, analyses, assembly, sum(len(wanted.poles) for wanted in requests)
        ),
        "at_once": {
            "analyses": [analysis.name for analysis in analyses if analysis.at_once],
            "bytes_a_row": evaluation_memory(mechanism, 1),
        },
    }


def _tell(facts: Facts, links: int) -> None:
    inputs = facts["inputs"]
    at_once = facts["at_once"]
    print(
        f"{facts['mechanism']}, {numbered('input', inputs)}, "
        f"analyses: {', '.join(facts['analyses'])}"
    )
    print(f"positions, group by group:{'' if facts['positions'] else ' no loop to close'}")
    for item in facts["positions"]:
        print(f"  {item['group']} of pairs {', '.join(item['pairs'])}")
    others = facts["other_configurations"]
    if others:
        print(f"configurations beside the samples, looked for by: {', '.join(others)}")
    if at_once["analyses"]:
        print(
            "all samples at once, so that a run that is stopped keeps nothing: "
            f"{', '.join(at_once['analyses'])}; about {size_text(at_once['bytes_a_row'])} "
            "of memory for each sample of each assembly mode"
        )
    asked = facts["asked"]
    if not asked:
        print("asked of the samples: no poles")
        return
    every = counted(math.comb(links, 2), "pole")
    print(f"asked: {len(asked)} of {every}: {', '.join(asked)}")
    for entry in facts["plans"]:
        if entry["locked"]:
            print(f"while {entry['moving']} moves, {', '.join(entry['locked'])} locked:")
        counts = entry["counts"]
        secondary = counts["secondary"] + counts["irreducible"]
        print(
            f"evaluated: {counts['primary']} primary and {secondary} secondary poles, "
            f"{counts['great_circles']} great circles"
        )
        for step in entry["steps"]:
            print(f"  {step}")
        orders = "first and second order" if entry["derivatives"] else "first order"
        print(f"rates of links {', '.join(entry['links_with_rates'])}, {orders}")


def _predicted(sizes: Facts, recording: bool) -> Lines:
    """Return the sizes in lines for people; perhaps those of a `recording` were asked."""
    if "reason" in sizes:
        return [f"sizes: not predicted; {sizes['reason']}"]
    modes = sizes["assembly_modes"]
    who = "for each assembly mode" if modes is None else counted(modes, "assembly mode")
    lines = [f"predicted, {who}: {counted(sizes['configurations'], 'configuration')}"]
    solves = sizes["velocity_equation_solves"]
    if solves and modes is not None:
        lines.append(
            f"  velocity equations solved about {solves} times, once for each input"
        )
    lines += [
        f"  table {name}: {counted(table['rows'], 'row')} of "
        f"{counted(table['columns'], 'column')}, "
        f"{size_text(table['csv_bytes'])} as CSV, "
        f"{size_text(table['parquet_bytes'])} as Parquet"
        for name, table in sizes["tables"].items()
    ]
    if recorded := sizes.get("recording"):
        lines.append(
            f"  recording: {recorded['entities']} entities, "
            f"{counted(recorded['rows'], 'row')}, {size_text(recorded['bytes'])}"
        )
    missing = [f"analysis {name}" for name in sizes["not_predicted"]]
    if modes is None:
        missing.insert(0, "the number of assembly modes")
        missing += ["the recording"] if recording else []
    if missing:
        lines.append(f"  not predicted: {', '.join(missing)}")
    return lines
