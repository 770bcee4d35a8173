"""`spherekit validate`: read files, check freedoms, and assemble once."""

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import replace

from spherekit.cli.completers import complete_studies, set_completer
from spherekit.cli.main import say
from spherekit.cli.study_arguments import add_lock_argument, with_locks
from spherekit.conventions import Facts
from spherekit.errors import SolveError, SpherekitError
from spherekit.wording import counted, numbered

EXAMPLES = """examples:
  # one of the shipped mechanisms
  spherekit validate four_bar
  # files of your own, each on a line
  spherekit validate wrist.toml study.toml
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        nargs="+",
        metavar="FILE|STUDY",
        help="mechanism or study: path or shipped name",
    )
    set_completer(file_argument, complete_studies)
    parser.add_argument(
        "--json",
        action="store_true",
        help="one JSON object per file",
    )


COARSE = 37
"""Samples over which a mechanism with several inputs is assembled."""


def execute(options: Namespace) -> int:
    """Check every file; 1 if any is bad, after all were looked at."""
    bad = 0
    for name in options.file:
        try:
            facts = check(name, options.lock)
        except SpherekitError as problem:
            bad = 1
            if options.traceback:
                raise
            say(str(problem))
            if options.json:
                print(json.dumps({"file": name, "ok": False, "error": str(problem)}))
            continue
        text = json.dumps({"file": name, "ok": True, **facts})
        print(text if options.json else line(facts))
    return bad


def check(name: str, locks: Sequence[str] | None = None) -> Facts:
    """Return what a mechanism or study file holds, having planned and assembled it."""
    import numpy as np

    from spherekit.files.study_reader import load_study
    from spherekit.planning.mobility import graph_mobility
    from spherekit.planning.pole_planner import plans
    from spherekit.positions.loop_tree import rank_mobility
    from spherekit.positions.position_analysis import PositionAnalysis
    from spherekit.runs.sampling import check_time
    from spherekit.runs.study_analyses import analyses_of

    study = load_study(name)
    study = replace(study, mechanism=with_locks(study.mechanism, locks, name))
    mechanism = study.mechanism
    facts: Facts = {
        "name": mechanism.name,
        "links": len(mechanism.links),
        "pairs": len(mechanism.pairs),
        "mobility": graph_mobility(mechanism),
    }
    if study.locate is not None:
        check_time(study)
        facts["study"] = study.name
        facts["analyses"] = [analysis.name for analysis in analyses_of(study)]
    tracer = PositionAnalysis(mechanism, samples=COARSE)
    if tracer.unused_mode_names:
        raise SolveError(f"{mechanism.name}: {'; '.join(tracer.unused_mode_names)}")
    facts["irreducible_parts"] = sum(
        len(plan.blocks) for plan in plans(mechanism, tracer.by_rank)
    )
    facts["inputs"] = tracer.inputs
    coarse = tracer.sparse(9)
    held = coarse.rows(~coarse.failed)
    if len(held):
        ranks = rank_mobility(tracer.solver.closure.tree, held.vectors)
        facts["rank_mobility"] = int(np.min(ranks))
    facts["groups"] = [group.kind for group in tracer.assembly.groups]
    facts["assembly_modes"] = len(tracer.assembly_modes)
    facts["modes"] = {m.name: m.number for m in tracer.assembly_modes if m.name}
    return facts


def line(facts: Facts) -> str:
    """Return one line that says what a good file holds."""
    mobility = facts["mobility"]
    study = facts.get("study")
    rank = facts.get("rank_mobility", mobility)
    by_rank = f" by the graph and {rank} by rank" if rank != mobility else ""
    heading = f"{study}: ok, study of {facts['name']}" if study else f"{facts['name']}: ok"
    named = ", ".join(f"{name} is {mode}" for name, mode in facts["modes"].items())
    text = (
        f"{heading}, {counted(facts['links'], 'link')}, {counted(facts['pairs'], 'pair')}, "
        f"mobility {mobility}{by_rank}, {numbered('input', facts['inputs'])}, groups: "
        f"{', '.join(facts['groups']) or 'none'}, assembly modes: {facts['assembly_modes']}"
        f"{f' ({named})' if named else ''}"
    )
    return text + f", analyses: {', '.join(facts['analyses'])}" if study else text
