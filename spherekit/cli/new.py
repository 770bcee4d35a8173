"""`spherekit new`: files to start from, one module a kind of file."""

import argparse

from spherekit.cli.grammar import CommandParser, home_of

FILES = {
    "mechanism": "a mechanism file: commented, complete, ready to run",
    "analysis": "a distribution with an analysis: complete, tested, ready to install",
}

EXAMPLES = (
    ("spherekit new mechanism wrist", "a four-bar to change, in wrist.toml"),
    ("spherekit new mechanism wrist --kind wrist", "two inputs that point an axis"),
    ("spherekit new mechanism mine --like stephenson", "as a shipped one"),
    ("spherekit new analysis swing", "a plugin to change, in the folder swing"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    kinds = parser.add_subparsers(
        dest="what", metavar="WHAT", required=True, parser_class=CommandParser
    )
    for name, summary in FILES.items():
        kinds.add_parser(name, module=f"new_{name}", help=summary, description=summary)


def execute(options: argparse.Namespace) -> int:
    """Write the file."""
    return int(home_of(f"new_{options.what}").execute(options))
