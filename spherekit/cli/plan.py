"""`spherekit plan`: the Table of the lecture and the steps behind it."""

import argparse
import json

from spherekit.cli.study import add_lock_argument, with_locks
from spherekit.cli.suggest import mechanisms, pairs, suggesting

EXAMPLES = (
    (
        "spherekit plan stephenson",
        "the Table: which pole is found in which pass",
    ),
    (
        "spherekit plan stephenson --steps --for 5/2",
        "how one pole is constructed",
    ),
    (
        "spherekit plan five_bar --markdown",
        "a Table for each input, for a document",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    suggesting(
        parser.add_argument("file", metavar="FILE", help="path or shipped name"), mechanisms
    )
    suggesting(
        parser.add_argument(
            "--input",
            metavar="PAIR",
            help="the pair that moves (default: each input in turn, the others locked)",
        ),
        pairs,
    )
    parser.add_argument(
        "--for",
        dest="poles",
        nargs="+",
        metavar="POLE",
        help="only these poles, as 3/1",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="table and steps as JSON")
    form.add_argument("--markdown", action="store_true", help="the Table as Markdown")
    add_lock_argument(parser)
    parser.add_argument("--steps", action="store_true", help="print the steps as well")


def execute(options: argparse.Namespace) -> int:
    """Print the plan, or one plan for each of several inputs."""
    from spherekit.files.read import load
    from spherekit.planning.inputs import driven_pairs
    from spherekit.planning.poles import plan
    from spherekit.planning.table import as_dict, as_markdown, as_text, describe

    mechanism = with_locks(load(options.file), options.lock, options.file)
    names = [mechanism.pairs[pair].name for pair in driven_pairs(mechanism)]
    moved = [options.input] if options.input else names
    planned = [plan(mechanism, options.poles, name) for name in moved]
    if options.json:
        found = [as_dict(each) for each in planned]
        shown = found[0] if len(found) == 1 else found
        print(json.dumps(shown, indent=2, ensure_ascii=False))
        return 0
    for number, each in enumerate(planned):
        if each.locked:
            locked = ", ".join(mechanism.pairs[pair].name for pair in each.locked)
            heading = f"input {mechanism.pairs[each.input].name}, locked: {locked}"
            print("\n" * (number > 0) + heading)
        print(as_markdown(each) if options.markdown else as_text(each))
        if options.steps:
            print()
            for step in each.steps:
                print(describe(each, step))
    return 0
