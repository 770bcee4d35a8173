"""`spherekit plan`: the Table of the lecture and the steps behind it."""

import argparse
import json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("file", metavar="FILE", help="path or shipped name")
    parser.add_argument("--input", metavar="PAIR", help="the driven pair")
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
    parser.add_argument("--steps", action="store_true", help="print the steps as well")


def execute(options: argparse.Namespace) -> int:
    """Print the plan."""
    from spherekit.files.read import load
    from spherekit.planning.poles import plan
    from spherekit.planning.table import as_dict, as_markdown, as_text, describe

    planned = plan(load(options.file), options.poles, options.input)
    if options.json:
        print(json.dumps(as_dict(planned), indent=2, ensure_ascii=False))
        return 0
    print(as_markdown(planned) if options.markdown else as_text(planned))
    if options.steps:
        print()
        for step in planned.steps:
            print(describe(planned, step))
    return 0
