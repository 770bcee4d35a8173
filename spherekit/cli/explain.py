"""`spherekit explain`: what a run will plan, evaluate and log."""

import math
import shlex
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import add_study_arguments, study_from
from spherekit.conventions import Facts
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted, numbered, size_text

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.runs.contract import AbstractAnalysis

EXPLAIN_OPTIONS = ("--recording", "--json", "-v", "--verbose")
"""Words of the command line that the suggested command `run` does not get."""

EXAMPLES = """examples:
  # what one pole costs
  spherekit explain stephenson -a poles:only=31
  # sizes of tables and of a recording over a grid
  spherekit explain five_bar --samples 41x41 --recording
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit explain`.

    This command predicts what a run would compute, and its cost, without running it.
    """
    add_study_arguments(parser)
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        action="append",
        help=(
            "analysis to explain; may be repeated (default: those of the study, "
            "otherwise poles)"
        ),
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--only-needed",
        action="store_true",
        help=(
            "leave out links and pairs that no analysis needs, as `run --only-needed` does"
        ),
    )
    parser.add_argument(
        "--recording",
        action="store_true",
        # The size of the recording follows from the sizes of two short recordings, which
        # are made for this purpose.
        help=(
            "also predict the size of the recording, by making two short ones (takes a "
            "second or two)"
        ),
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print as JSON",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit explain``: print what a run would compute, and its cost.

    The report lists the poles (axes of relative rotation of two links), the tables, and the
    groups of links whose positions are computed together. With ``--recording``, two short
    recordings are written to a temporary folder. The size of the whole recording is
    predicted from their sizes. Returns the exit status 0.
    """
    from spherekit.runs.expected_size import predict_recording
    from spherekit.runs.registry import create_analysis
    from spherekit.runs.run_plan import extract_needed_part
    from spherekit.runs.study_analyses import make_study_analyses

    study = study_from(options)
    # The analyses of the command line, otherwise those that the file names.
    analyses = [
        create_analysis(text, study.mechanism.angle_unit) for text in options.analysis or ()
    ] or make_study_analyses(study)
    if options.only_needed:
        study = replace(study, mechanism=extract_needed_part(study, analyses))
    description = _describe_run(study, analyses)
    # The number of assembly modes (ways to assemble the mechanism) is missing if it takes
    # long to find, or if no sizes are predicted. The size of the recording cannot be
    # predicted then.
    if options.recording and description["predicted"].get("assembly_modes"):
        from spherekit.display.rerun.recorder import RerunRecorder

        with TemporaryDirectory() as folder:
            description["predicted"]["recording"] = predict_recording(
                study,
                analyses,
                lambda samples: RerunRecorder(
                    study.name, path=Path(folder, f"{samples}.rrd")
                ),
            )
    if options.json:
        print_json(description)
    else:
        report = _make_report(description, len(study.mechanism.links), options.recording)
        # The next step is the command ``run`` with the same words, without the options
        # that only ``explain`` has.
        words = [word for word in options.words[1:] if not _is_explain_option(word)]
        command = shlex.join(["spherekit", "run", *words])
        report.next_steps = [(command, "compute this")]
        report.print(options)
    return 0


def _is_explain_option(word: str) -> bool:
    """Return whether a word is one of `EXPLAIN_OPTIONS`, perhaps abbreviated."""
    is_long = word.startswith("--") and word != "--"
    return word in EXPLAIN_OPTIONS or (
        is_long and any(option.startswith(word) for option in EXPLAIN_OPTIONS)
    )


def _describe_run(study: "Study", analyses: "list[AbstractAnalysis]") -> Facts:
    """Describe what a run would compute, how, and at which cost, without running it.

    Parameters
    ----------
    study
        The mechanism with its samples.
    analyses
        The analyses of the run.

    Returns
    -------
    Data for ``--json``: the groups of links whose positions are computed together, the
    poles (axes of the relative rotation of two links) that analyses ask for, one plan for
    each input that moves while the others are locked, and the predicted sizes of the
    tables.
    """
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.planning.plan_text import describe
    from spherekit.positions.input_grid import check_sample_counts
    from spherekit.positions.motion_cache import (
        assembly_by_count_or_rank,
        is_mobile_by_rank_only,
    )
    from spherekit.runs.analysis_requests import plan_requests, unite_needs
    from spherekit.runs.expected_size import predict_run
    from spherekit.runs.resource_checks import evaluation_memory
    from spherekit.runs.run_cost import count_evaluations

    mechanism = study.mechanism
    check_sample_counts(mechanism, study.samples)
    assembly = assembly_by_count_or_rank(mechanism)
    is_overconstrained = is_mobile_by_rank_only(mechanism)
    # One request for each input that moves while the others are locked.
    requests = plan_requests(
        mechanism, unite_needs(mechanism, analyses), is_overconstrained
    )
    pole_count = sum(len(request.poles) for request in requests)
    return {
        "mechanism": mechanism.name,
        "inputs": mechanism.names_of(driven_pairs(mechanism)),
        "analyses": [analysis.name for analysis in analyses],
        "positions": [
            {"group": group.kind, "pairs": mechanism.names_of(group.pairs)}
            for group in assembly.groups
        ],
        "asked": [_pole_name(mechanism.links, pole) for pole in requests[0].poles],
        "plans": [
            {
                "moving": mechanism.pairs[request.plan.input].name,
                "locked": mechanism.names_of(request.plan.locked),
                "counts": count_evaluations(request),
                "links_with_rates": [request.plan.name(body) for body in request.bodies],
                "derivatives": request.derivatives,
                "steps": [describe(request.plan, step) for step in request.plan.steps],
            }
            for request in requests
        ],
        "other_configurations": [
            analysis.name for analysis in analyses if analysis.needs(mechanism).tracer
        ],
        "predicted": predict_run(study, analyses, assembly, pole_count),
        "needs_all_samples": {
            "analyses": [analysis.name for analysis in analyses if analysis.at_once],
            "bytes_per_row": evaluation_memory(mechanism, 1),
        },
    }


def _pole_name(links: Sequence[str], pole: tuple[int, int]) -> str:
    """Return the name of a pole: ``P31``, or ``P(coupler,ground)`` for long names."""
    first, second = (links[number] for number in pole)
    if len(first) == len(second) == 1:
        return f"P{second}{first}"
    return f"P({second},{first})"


def _make_report(description: Facts, link_count: int, with_recording: bool) -> ScreenReport:
    """Return the printed report: the predicted sizes, then what is computed and how.

    Parameters
    ----------
    description
        The description of the run from `_describe_run`.
    link_count
        Number of links of the mechanism.
    with_recording
        Whether the user asked for the size of the recording.
    """
    names = description["analyses"]
    analyses = f"{'analysis' if len(names) == 1 else 'analyses'} {', '.join(names)}"
    report = ScreenReport(
        f"{description['mechanism']}: what a run would compute, "
        f"{numbered('input', description['inputs'])}, {analyses}"
    )
    report.results = [*_predicted_sizes(description["predicted"], with_recording)]
    # Some analyses also compute configurations between samples, for example singular ones.
    analyses_with_search = description["other_configurations"]
    if analyses_with_search:
        report.results.append(
            "Analyses that compute further configurations between the samples: "
            f"{', '.join(analyses_with_search)}"
        )
    # Most analyses work block by block. A run that is stopped keeps the tables of complete
    # blocks. Analyses that need all samples at once have no such tables.
    at_once = description["needs_all_samples"]
    if at_once["analyses"]:
        report.warnings.append(
            f"{', '.join(at_once['analyses'])} can only be computed from all samples at "
            "once. A run that is interrupted starts again from the beginning, and needs "
            f"about {size_text(at_once['bytes_per_row'])} of memory for each sample of "
            "each assembly mode."
        )
    # A pole is the instantaneous axis of two links. The poles that the analyses need at
    # each sample are printed first. Each input that moves while the others are locked has a
    # plan, which evaluates these poles and the poles from which they follow.
    poles = description["asked"]
    if poles:
        all_poles = counted(math.comb(link_count, 2), "pole")
        report.results.append(
            f"Poles at each sample ({len(poles)} of {all_poles}): {', '.join(poles)}"
        )
        for plan in description["plans"]:
            report.results.append(_describe_evaluations(plan))
            locked = f" while {plan['moving']} moves" if plan["locked"] else ""
            report.details.append(f"Construction of the poles{locked}:")
            for step in plan["steps"]:
                report.details += [f"  {line}" for line in step.splitlines()]
    else:
        report.results.append("No poles are computed at the samples.")
    # Positions are solved group by group: links that are closed together.
    groups = [
        f"{group['group']}: pairs {', '.join(group['pairs'])}"
        for group in description["positions"]
    ]
    if groups:
        report.results.append("Positions are solved in this order:")
        report.results += [f"  {number}. {text}" for number, text in enumerate(groups, 1)]
    else:
        report.results.append(
            "Positions follow from the inputs; there is no loop to close."
        )
    return report


def _describe_evaluations(plan: Facts) -> str:
    """Return a sentence on the poles and rates that a run evaluates while one input moves.

    A pole is the axis about which one link rotates relative to another.

    Parameters
    ----------
    plan
        The construction of the poles for one moving input: an item of the list ``plans`` in
        the description of a run.
    """
    # Primary poles are axes of pairs (joints), all others are secondary. Most secondary
    # poles are intersections of great circles. In some parts of a mechanism (irreducible
    # parts) there are no such circles. In such parts the poles follow from velocity
    # equations and are counted separately.
    counts = plan["counts"]
    evaluations = [counted(counts["primary"], "primary pole")]
    if counts["secondary"]:
        evaluations.append(
            f"{counted(counts['secondary'], 'secondary pole')} from "
            f"{counted(counts['great_circles'], 'great circle')}"
        )
    if counts["irreducible"]:
        evaluations.append(
            f"{counted(counts['irreducible'], 'secondary pole')} from velocity equations"
        )
    # Angular velocities of links are per unit rate of the input. Some analyses also need
    # the derivatives of these angular velocities with respect to the input.
    rates = "angular velocities"
    if plan["derivatives"]:
        rates += " and their derivatives"
    sentence = (
        f"evaluated for this: {', '.join(evaluations)}; {rates} for links "
        f"{', '.join(plan['links_with_rates'])}"
    )
    if plan["locked"]:
        locked = ", ".join(plan["locked"])
        verb = "is" if len(plan["locked"]) == 1 else "are"
        return f"  while {plan['moving']} moves and {locked} {verb} locked, {sentence}"
    return f"  {sentence}"


def _size_table(sizes_by_table: Mapping[str, Facts]) -> ScreenTable:
    """Return a table with the predicted sizes of the result tables of a run."""
    columns = [ScreenColumn("table", "left")]
    for heading in ("rows", "columns", "CSV", "Parquet"):
        columns.append(ScreenColumn(heading, "right"))
    rows = []
    for name, table in sizes_by_table.items():
        row = (
            name,
            str(table["rows"]),
            str(table["columns"]),
            size_text(table["csv_bytes"]),
            size_text(table["parquet_bytes"]),
        )
        rows.append(row)
    return ScreenTable(tuple(columns), tuple(rows))


def _predicted_sizes(sizes: Facts, with_recording: bool) -> list[str | ScreenTable]:
    """Return the predicted sizes of a run as lines of text and a table.

    The table lists the tables that the run would write.

    Parameters
    ----------
    sizes
        The value under the key ``predicted`` in the description of a run.
    with_recording
        Whether the user asked for the size of the recording, a file for the viewer rerun.
    """
    if "reason" in sizes:
        return [f"sizes: not predicted; {sizes['reason']}"]
    mode_count = sizes["assembly_modes"]
    if mode_count is None:
        modes = "for each assembly mode"
    else:
        modes = f"in {counted(mode_count, 'assembly mode')}"
    results: list[str | ScreenTable] = [
        f"{counted(sizes['configurations'], 'configuration')} {modes}"
    ]
    # Poles (axes of relative rotation) usually follow from simple geometry. Where this
    # loses digits, the velocity equations are solved, at one configuration for one moving
    # input at a time. This is slow, so the number is printed.
    solves = sizes["velocity_equation_solves"]
    if solves and mode_count is not None:
        results.append(
            f"velocity equations solved about {solves} times, once for each input"
        )
    if sizes["tables"]:
        results.append(_size_table(sizes["tables"]))
    if recording := sizes.get("recording"):
        results.append(
            f"recording: {recording['entities']} entities, "
            f"{counted(recording['rows'], 'row')}, {size_text(recording['bytes'])}"
        )
    # What is not predicted: sizes of analyses, and what depends on the number of modes.
    missing = [f"analysis {name}" for name in sizes["not_predicted"]]
    if mode_count is None:
        missing.insert(0, "the number of assembly modes")
        if with_recording:
            missing.append("the recording")
    if missing:
        results.append(f"not predicted: {', '.join(missing)}")
    return results
