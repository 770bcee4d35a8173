"""`spherekit plan`: in which pass each pole axis is constructed, and the steps to it."""

from argparse import ArgumentParser, Namespace

from spherekit.cli.completers import complete_mechanisms, complete_pairs, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.study_arguments import add_lock_argument, with_locks

EXAMPLES = """examples:
  # the table: which pole is found in which pass
  spherekit plan stephenson
  # how one pole is constructed
  spherekit plan stephenson --steps --for 5/2
  # a table for each input, for a document
  spherekit plan five_bar --markdown
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit plan`.

    The command prints a table of all poles (instantaneous axes of two links). The table
    says in which pass of the construction a pole is known. The steps say how each pole is
    constructed.
    """
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="path or shipped name",
    )
    set_completer(file_argument, complete_mechanisms)
    input_argument = parser.add_argument(
        "--input",
        metavar="PAIR",
        help="the pair that moves (default: each input in turn, the others locked)",
    )
    set_completer(input_argument, complete_pairs)
    parser.add_argument(
        "--for",
        dest="poles",
        nargs="+",
        metavar="POLE",
        help="only these poles: 3/1 is that of link 3 relative to link 1",
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--json",
        action="store_true",
        help="table and steps as JSON",
    )
    exclusive.add_argument(
        "--markdown",
        action="store_true",
        help="the table as Markdown",
    )
    parser.add_argument(
        "--steps",
        action="store_true",
        help="print how each pole is constructed, too",
    )


def execute(options: Namespace) -> int:
    """Print the plan by which pole axes are constructed, one for each moving input.

    With several inputs, one moves at a time while the others are locked. Returns the exit
    status 0.
    """
    from spherekit.errors import CountError
    from spherekit.files.mechanism_reader import load
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.planning.plan_text import as_dict, as_markdown, as_text, describe
    from spherekit.planning.pole_planner import plan
    from spherekit.positions.position_analysis import PositionAnalysis

    mechanism = with_locks(load(options.file), options.lock, options.file)
    driven = mechanism.names_of(driven_pairs(mechanism))
    moving_inputs = [options.input] if options.input else driven
    try:
        plans = [plan(mechanism, options.poles, name) for name in moving_inputs]
    except CountError:
        # The number of links and pairs gives too small a mobility for overconstrained
        # mechanisms. The analysis counts too. If this fails, it uses the rank of the
        # velocity equations and sets `by_rank`. Its positions are not used here, so two
        # samples suffice.
        only_input = moving_inputs[0] if len(driven) == 1 else None
        if not PositionAnalysis(mechanism, only_input, samples=2).by_rank:
            raise
        plans = [
            plan(mechanism, options.poles, name, by_rank=True) for name in moving_inputs
        ]
    if options.json:
        data = [as_dict(input_plan) for input_plan in plans]
        print_json(data[0] if len(data) == 1 else data)
        return 0
    for index, input_plan in enumerate(plans):
        if input_plan.locked:
            locked = ", ".join(mechanism.names_of(input_plan.locked))
            heading = f"input {mechanism.pairs[input_plan.input].name}, locked: {locked}"
            blank_line = "\n" if index > 0 else ""
            print(blank_line + heading)
        print(as_markdown(input_plan) if options.markdown else as_text(input_plan))
        if options.steps:
            print("", *(describe(input_plan, step) for step in input_plan.steps), sep="\n")
    return 0
