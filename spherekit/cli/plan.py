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
    from spherekit.errors import CountError
    from spherekit.files.read import load
    from spherekit.motion.motion import Tracer
    from spherekit.planning.inputs import driven_pairs
    from spherekit.planning.plan import plan
    from spherekit.planning.poles import as_dict, as_markdown, as_text, describe

    mechanism = with_locks(load(options.file), options.lock, options.file)
    names = mechanism.names_of(driven_pairs(mechanism))
    moved = [options.input] if options.input else names
    try:
        planned = [plan(mechanism, options.poles, name) for name in moved]
    except CountError:
        one = moved[0] if len(names) == 1 else None
        if not Tracer(mechanism, one, samples=2).by_rank:
            raise
        planned = [plan(mechanism, options.poles, name, by_rank=True) for name in moved]
    if options.json:
        facts = [as_dict(made) for made in planned]
        shown = facts[0] if len(facts) == 1 else facts
        print(json.dumps(shown, indent=2, ensure_ascii=False))
        return 0
    for number, input_plan in enumerate(planned):
        if input_plan.locked:
            locked = ", ".join(mechanism.names_of(input_plan.locked))
            heading = f"input {mechanism.pairs[input_plan.input].name}, locked: {locked}"
            print("\n" * (number > 0) + heading)
        print(as_markdown(input_plan) if options.markdown else as_text(input_plan))
        if options.steps:
            print()
            for step in input_plan.steps:
                print(describe(input_plan, step))
    return 0
