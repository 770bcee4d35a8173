"""`spherekit validate`: read files, check freedoms, and assemble once."""

import json
import shlex
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import replace

from spherekit.cli.completers import complete_studies, set_completer
from spherekit.cli.main import BAD_INPUT, say
from spherekit.cli.progress_bar import hide_progress
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import add_lock_argument, with_locks
from spherekit.conventions import Facts
from spherekit.errors import SolveError, SpherekitError
from spherekit.tables.screen_table import ScreenTable
from spherekit.wording import counted, numbered

ASSEMBLY_SAMPLES = 37
"""Number of samples at which a mechanism is assembled, on the path through all ranges."""

RANK_SAMPLES = 9
"""Number of the assembled samples at which the mobility by rank is computed."""

EXAMPLES = """examples:
  # one of the shipped mechanisms
  spherekit validate four_bar
  # files of your own, each on a line
  spherekit validate wrist.toml study.toml
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit validate`.

    This command checks mechanism or study files, and assembles the mechanism once.
    """
    add_lock_argument(parser)  # --lock PAIR=VALUE keeps the angle of a pair
    file_argument = parser.add_argument(
        "file",
        nargs="+",
        metavar="FILE|STUDY",
        help="mechanism or study: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_studies)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print one JSON object per file",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit validate``: check every file, and print a report on each.

    The exit status is `BAD_INPUT` if any file has a fault, otherwise 0. A faulty file does
    not prevent the check of the next files.
    """
    status = 0
    for name in options.file:
        try:
            # `options.lock` names pairs (joints) whose angles are kept constant.
            properties = validate_file(name, options.lock)
        except SpherekitError as error:
            status = BAD_INPUT
            if options.traceback:
                raise
            say(str(error))
            if options.json:
                print(json.dumps({"file": name, "ok": False, "error": str(error)}))
            continue
        if options.json:
            hide_progress()
            print(json.dumps({"file": name, "ok": True, **properties}))
        else:
            report = make_report(properties)
            if len(options.file) == 1:
                is_study = "study" in properties
                words = ["spherekit", "run", name]
                for locked_pair in options.lock or []:
                    words += ["--lock", locked_pair]
                report.next_steps = [
                    (
                        shlex.join(words),
                        "run the study" if is_study else "compute motion and pole axes",
                    )
                ]
                # The command `view` has no option --lock.
                if not is_study and not options.lock:
                    view = shlex.join(["spherekit", "view", name])
                    report.next_steps.append((view, "look at the mechanism in 3D"))
            report.print(options)
    return status


def validate_file(name: str, lock_texts: Sequence[str] | None = None) -> Facts:
    """Read a mechanism or study file, plan and assemble it, and return its properties.

    The properties are numbers of links, pairs and assembly modes, the mobility, the inputs
    and the groups of links whose positions are computed together.

    Parameters
    ----------
    name
        Path of the file, or the name of a shipped one.
    lock_texts
        The values of ``--lock``: pairs that are locked, with their angles.

    Raises
    ------
    SpherekitError
        If the file has a fault, or the mechanism cannot be assembled.
    """
    import numpy as np

    from spherekit.files.study_reader import load_study
    from spherekit.planning.mobility import graph_mobility
    from spherekit.planning.pole_planner import plans
    from spherekit.positions.loop_tree import rank_mobility
    from spherekit.positions.position_analysis import PositionAnalysis
    from spherekit.runs.sampling import check_time
    from spherekit.runs.study_analyses import make_study_analyses

    study = load_study(name)
    study = replace(study, mechanism=with_locks(study.mechanism, lock_texts))
    mechanism = study.mechanism
    properties: Facts = {
        "name": mechanism.name,
        "links": len(mechanism.links),
        "pairs": len(mechanism.pairs),
        "mobility": graph_mobility(mechanism),
    }
    is_study_file = study.locate is not None
    if is_study_file:
        check_time(study)
        properties["study"] = study.name
        properties["analyses"] = [analysis.name for analysis in make_study_analyses(study)]
    position_analysis = PositionAnalysis(mechanism, samples=ASSEMBLY_SAMPLES)
    if position_analysis.unused_mode_names:
        raise SolveError(
            f"{mechanism.name}: {'; '.join(position_analysis.unused_mode_names)}"
        )
    properties["irreducible_parts"] = sum(
        len(plan.blocks) for plan in plans(mechanism, position_analysis.by_rank)
    )
    properties["inputs"] = position_analysis.inputs
    motion = position_analysis.sparse(RANK_SAMPLES)
    assembled = motion.rows(~motion.failed)
    if len(assembled):
        # The rank drops at singular configurations, where the mobility is larger. So the
        # mobility of the mechanism is the smallest of several configurations.
        loop_tree = position_analysis.solver.closure.tree
        ranks = rank_mobility(loop_tree, assembled.vectors)
        properties["rank_mobility"] = int(np.min(ranks))
    properties["groups"] = [group.kind for group in position_analysis.assembly.groups]
    modes = position_analysis.assembly_modes
    properties["assembly_modes"] = len(modes)
    properties["modes"] = {mode.name: mode.number for mode in modes if mode.name}
    return properties


def make_report(properties: Facts) -> ScreenReport:
    """Return the report that is printed for a valid mechanism or study file.

    Parameters
    ----------
    properties
        The result of `validate_file`: facts of the mechanism by name.
    """
    name = properties["name"]
    study = properties.get("study")
    headline = f"{study}: valid study of {name}" if study else f"{name}: valid mechanism"
    # Counting links and pairs gives a wrong mobility (number of degrees of freedom) if axes
    # have special positions. The rank of the velocity equations is always right.
    counted_mobility = properties["mobility"]
    mobility = properties.get("rank_mobility", counted_mobility)
    degrees_of_freedom = f"{mobility} degree{'' if mobility == 1 else 's'} of freedom"
    results: list[str | ScreenTable] = [
        f"{counted(properties['links'], 'link')}, {counted(properties['pairs'], 'pair')}, "
        f"{degrees_of_freedom}, {numbered('input', properties['inputs'])}"
    ]
    if mobility != counted_mobility:
        results.append(
            f"Counting links and pairs (Gruebler) gives {counted_mobility}: the mechanism "
            "is over-constrained, and moves because of its dimensions."
        )
    mode_count = properties["assembly_modes"]
    # Modes to which the file gives names.
    named_modes = [
        f"mode {mode} ({mode_name})" for mode_name, mode in properties["modes"].items()
    ]
    # The modes of several inputs are counted at samples of one path only (see
    # `ASSEMBLY_SAMPLES`), on which all inputs move together. A group is a set of links that
    # are placed together to close loops. Without loops there are no groups, and exactly one
    # mode.
    has_loops = len(properties["groups"]) > 0
    is_one_path = has_loops and len(properties["inputs"]) > 1
    where = " on the straight path through the ranges of all inputs" if is_one_path else ""
    names = f"; named: {', '.join(named_modes)}" if named_modes else ""
    hint = "; a run on a grid can find more" if is_one_path else ""
    results.append(f"{counted(mode_count, 'assembly mode')}{where}{names}{hint}")
    if study:
        analyses = ", ".join(properties["analyses"])
        results.append(f"analyses: {analyses}")
    groups = ", ".join(properties["groups"]) or "none"
    # A pole (axis of relative rotation of two links) usually follows from the intersection
    # of great circles. In some parts of a mechanism there are too few circles, so the poles
    # follow from the velocity equations. This is the number of such parts.
    equation_part_count = properties["irreducible_parts"]
    return ScreenReport(
        headline,
        results=results,
        details=[
            f"Groups of links whose positions are computed together: {groups}",
            f"Parts whose poles follow from velocity equations: {equation_part_count}",
        ],
    )
