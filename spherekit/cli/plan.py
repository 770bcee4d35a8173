"""`spherekit plan`: the pass and the steps in which each pole axis is constructed."""

import shlex
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from spherekit.cli.completers import complete_mechanisms, complete_pairs, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.screen_report import ScreenReport, print_lines
from spherekit.cli.study_arguments import add_lock_argument, with_locks
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.planning.pole_plan import LinePole, Plan

EXAMPLES = """examples:
  # the table: which pole is found in which pass
  spherekit plan stephenson
  # how one pole is constructed
  spherekit plan stephenson --steps --for 5/2
  # a table for each input, for a document
  spherekit plan five_bar --markdown
"""

CASE_TEXTS = {
    "a": "the pole is the intersection of great circles through two known poles each",
    "b": "the pole is the intersection of a great circle through two known poles with a "
    "contact plane",
    "c": "the pole is the intersection of two contact planes",
}
"""What each case of a step means. The cases are named as in Di Gregorio's lecture."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit plan`.

    This command prints a table of all poles (instantaneous axes of relative rotation of two
    links). It says in which pass of the construction each pole is found. A pass finds all
    poles that follow from poles of earlier passes. With ``--steps`` the command also prints
    how each pole is constructed.
    """
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="mechanism: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_mechanisms)
    input_argument = parser.add_argument(
        "--input",
        metavar="PAIR",
        help=(
            "plan how poles are constructed if this input moves and the others are locked "
            "(default: one plan for each input)"
        ),
    )
    set_completer(input_argument, complete_pairs)
    parser.add_argument(
        "--for",
        dest="poles",
        nargs="+",
        metavar="POLE",
        help=(
            "plan only the construction of these poles, and of the other poles that are "
            "needed for it; 3/1 is the pole of link 3 relative to link 1"
        ),
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--json",
        action="store_true",
        help="print table and steps as JSON",
    )
    exclusive.add_argument(
        "--markdown",
        action="store_true",
        help="print the table as Markdown",
    )
    parser.add_argument(
        "--steps",
        action="store_true",
        help="also print how each pole is constructed",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit plan``: print how pole axes are constructed.

    A pole is the axis about which one link rotates relative to another. With several inputs
    there is a plan for each: one input moves while the others are locked. Returns the exit
    status 0.
    """
    from spherekit.planning.plan_text import as_dict

    plans = _make_plans(options)
    if options.json:
        data = [as_dict(input_plan) for input_plan in plans]
        print_json(data[0] if len(data) == 1 else data)
        return 0
    for index, input_plan in enumerate(plans):
        if index > 0 and not options.quiet:
            print()
        if options.markdown:
            _print_markdown(input_plan)
            continue
        # The line that introduces the plan, and the plan below this line.
        report = ScreenReport(
            _question(input_plan), results=_plan_results(input_plan, options.steps)
        )
        # Suggest next commands below the last plan.
        is_last = index == len(plans) - 1
        if is_last and not options.steps:
            same_plan = shlex.join(["spherekit", *options.words])
            run_words = ["spherekit", "run", options.file]
            for locked_pair in options.lock or []:
                run_words += ["--lock", locked_pair]
            # With one input, `--input` names the pair that is driven instead, and the run
            # drives the same pair. With several inputs, it only chooses which of them moves
            # in the plan. The run drives all of them, so it does not get the option.
            if options.input and not input_plan.locked:
                run_words += ["--input", options.input]
            run = shlex.join(run_words)
            report.next_steps = [
                (f"{same_plan} --steps", "how each pole is constructed"),
                (run, "compute the poles during the motion"),
            ]
        report.print(options)
    return 0


def _make_plans(options: Namespace) -> list["Plan"]:
    """Return a plan to construct poles for each input that moves.

    A pole is the axis about which one link rotates relative to another. While one input
    moves, the others are locked.

    Raises
    ------
    CountError
        If counting links and pairs (joints) gives too few degrees of freedom, and the
        velocity equations do not give more.
    """
    from spherekit.errors import CountError
    from spherekit.files.mechanism_reader import load
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.planning.pole_planner import plan
    from spherekit.positions.position_analysis import PositionAnalysis

    mechanism = with_locks(load(options.file), options.lock)
    driven = mechanism.names_of(driven_pairs(mechanism))
    # The user can choose one of the inputs.
    moving_inputs = [options.input] if options.input else driven
    try:
        return [plan(mechanism, options.poles, name) for name in moving_inputs]
    except CountError:
        # Counting gives too few degrees of freedom for overconstrained mechanisms. For
        # these, the position analysis takes the number from the rank of the velocity
        # equations, and sets `by_rank`. Its positions are not used here, so two samples
        # suffice. With several inputs, the analysis must drive all of them. None stands for
        # all inputs that the file declares.
        input_pair = moving_inputs[0] if len(driven) == 1 else None
        if not PositionAnalysis(mechanism, input_pair, samples=2).by_rank:
            raise
    return [plan(mechanism, options.poles, name, by_rank=True) for name in moving_inputs]


def _print_markdown(plan: "Plan") -> None:
    """Print a plan in the format Markdown, for a document.

    With several inputs, the line above says which input moves and which are locked.
    """
    from spherekit.planning.plan_text import as_markdown

    if plan.locked:
        print_lines([_question(plan), ""])
    print_lines(as_markdown(plan).splitlines())


def _plan_results(plan: "Plan", with_steps: bool) -> list[str | ScreenTable]:
    """Return the table of all poles with its legend, and how each pole is constructed.

    A pole is the axis about which one link rotates relative to another. `with_steps` says
    whether the construction is described.
    """
    results: list[str | ScreenTable] = [_pole_table(plan), *_legend(plan)]
    if with_steps:
        results += ["How each pole is constructed:", *_step_lines(plan), *_case_lines(plan)]
    return results


def _case_lines(plan: "Plan") -> list[str]:
    """Return lines that explain the letters (a), (b) and (c) in the steps of a plan.

    A letter says how a pole is found as an intersection: of two great circles, of a great
    circle and a contact plane, or of two contact planes. Only letters of the plan are
    explained.
    """
    letters = {step.case for step in _intersection_steps(plan)}
    return [f"case ({letter}): {CASE_TEXTS[letter]}" for letter in sorted(letters)]


def _intersection_steps(plan: "Plan") -> list["LinePole"]:
    """Return the steps of a plan that find a pole as an intersection."""
    from spherekit.planning.pole_plan import BlockPoles, LinePole

    steps = list(plan.steps)
    # After the velocity equations of an irreducible part, further steps can follow.
    for step in plan.steps:
        if isinstance(step, BlockPoles):
            steps += step.steps_from_opening
    return [step for step in steps if isinstance(step, LinePole)]


def _question(plan: "Plan") -> str:
    """Return the first line for a plan: the mechanism, the poles, and what moves."""
    pairs = plan.mechanism.pairs
    text = (
        f"{plan.mechanism.name}: order in which {counted(len(plan.pass_numbers), 'pole')} "
        f"can be constructed, while input {pairs[plan.input].name} moves"
    )
    if plan.locked:
        locked = ", ".join(plan.mechanism.names_of(plan.locked))
        text += f" and {locked} {'is' if len(plan.locked) == 1 else 'are'} locked"
    return text


def _pole_table(plan: "Plan") -> ScreenTable:
    """Return a table with the pass that finds the pole of each pair of links."""
    from spherekit.planning.pole_plan import titled_rows

    titles, *rows = titled_rows(plan)
    columns = tuple(ScreenColumn(title) for title in titles)
    return ScreenTable(columns, tuple(tuple(row) for row in rows))


def _legend(plan: "Plan") -> list[str]:
    """Return lines that explain the marks in the pole table of a plan.

    A pole is the axis about which one link rotates relative to another. The mark of a pole
    says how it is constructed. Only marks that occur in the table are explained.

    Poles are constructed in passes. Pass 0 takes the poles that are known from the pairs
    (joints). The poles of a later pass follow from those of earlier passes, and have the
    number of their pass as a Roman numeral. A pole of two links in sliding contact lies in
    their contact plane, which contains the normal of both curves at the point of contact.
    """
    from spherekit.planning.pole_plan import PRIMARY_MARK, PrimaryPole, table_cells

    marks = {mark for row in table_cells(plan) for mark in row}
    # These steps take a pole from a pair: the axis of a revolute pair, or the contact line
    # of a rolling pair.
    pair_steps = [step for step in plan.steps if isinstance(step, PrimaryPole)]
    source = "the axis of a pair"
    if any(plan.mechanism.pairs[step.pair].rolls for step in pair_steps):
        source += ", or the contact line of two links that roll on each other"
    lines = []
    if PRIMARY_MARK in marks:
        lines.append(f"{PRIMARY_MARK}: known from the start, because it is {source}")
    has_roman_numeral = any(set(mark) <= set("IVXLC") for mark in marks if mark)
    if has_roman_numeral:
        circles = "two great circles through poles of earlier passes"
        if any(step.contacts for step in _intersection_steps(plan)):
            circles += ", or in contact planes,"
        line = f"I, II, ...: found in this pass, where {circles} intersect"
        # After pass 0, a pole that comes from pairs is the common axis of several pairs.
        if any(step.pass_number > 0 for step in pair_steps):
            line += ", or as the common axis of coaxial pairs"
        lines.append(line)
    if any("*" in mark for mark in marks):
        lines.append(
            "*: computed from velocity equations, because no two such great circles exist"
        )
    if "" in marks:
        lines.append("empty: not needed for the requested poles")
    return lines


def _step_lines(plan: "Plan") -> list[str]:
    """Return lines that say how each pole of a plan is constructed, in their order."""
    from spherekit.planning.plan_text import describe

    return [line for step in plan.steps for line in describe(plan, step).splitlines()]
