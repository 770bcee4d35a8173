"""The grammar of the command line, of which only what is asked for is loaded."""

import argparse
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, NoReturn, final

from spherekit.version import __version__

USAGE = 2
"""Exit status of a command line that the grammar refuses."""

COMMANDS = {
    "new": "write files to start from: a mechanism or an analysis of your own",
    "validate": "check mechanism and study files and say what they hold",
    "plan": "print the Table and the steps that give every pole axis",
    "explain": "say what an analysis will compute, before anything is computed",
    "certify": "prove modes, curves and singularities; write a certificate",
    "run": "run analyses over the motion; write tables and a recording",
    "sweep": "compare designs: figures of merit while sizes are varied",
    "size": "find sizes for a wanted function, or the least of a figure of merit",
    "trade": "measure speed against accuracy, and find the cheapest setting",
    "export": "write a mechanism for others: stored functions, MuJoCo model, table in C",
    "import": "read a mechanism from a MuJoCo model (MJCF) or a URDF",
    "view": "open a recording, or a run's folder, in the viewer, or take a picture",
    "mechanisms": "list the mechanisms that come with spherekit or plugins",
    "analyses": "list the installed analyses, or describe one",
    "completion": "print what makes a shell complete spherekit's words",
}

EXAMPLES = (
    ("spherekit new mechanism wrist", "a file to start from"),
    ("spherekit validate four_bar", "is a mechanism sound, in how many assembly modes?"),
    ("spherekit plan stephenson --steps", "how its pole axes are constructed"),
    ("spherekit run four_bar -a singularities", "what an analysis finds"),
    ("spherekit run four_bar -o out --save out/four_bar.rrd", "tables and a recording"),
    ("spherekit view out", "the recording in the viewer"),
)

Examples = Sequence[tuple[str, str]]


@final
class Formatter(argparse.RawDescriptionHelpFormatter):
    """Help with the examples as they are, and words before what they mean."""

    def __init__(self, prog: str, **options: Any) -> None:
        super().__init__(prog, max_help_position=20, **options)


class Parser(argparse.ArgumentParser):
    """A parser that says what was meant, and shows examples."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=Formatter, **options)

    def show(self, examples: Examples) -> None:
        """Take examples, each a command and what it is for, into the help."""
        lines = [line for command, what in examples for line in (f"  # {what}", command)]
        indented = ["  " + line.lstrip() for line in lines]
        self.epilog = "\n".join(["examples:", *indented])

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Refuse an empty word, which as a path would mean the current folder."""
        if not arg_string and action.nargs != argparse.PARSER:
            where = action.metavar or action.dest.upper()
            raise argparse.ArgumentError(
                action, f"found an empty text for {where} (an unset variable of the shell?)"
            )
        return super()._get_value(action, arg_string)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and how to learn more, and exit."""
        message = re.sub(r"invalid float value: (.*)", r"\1 is not a number", message)
        message = re.sub(r"invalid int value: (.*)", r"\1 is not a whole number", message)
        message = re.sub(
            r"argument (?:\S+/)?(--\S+): expected one argument$",
            r"\g<0>; one that starts with - is written \1=-VALUE",
            message,
        )
        hint = self._meant(message) or "."
        print(f"{self.prog}: {message}{hint} See: {self.prog} --help", file=sys.stderr)
        sys.exit(USAGE)

    def _meant(self, message: str) -> str:
        """Return a hint at the word that was meant by a refused one."""
        from spherekit.conventions import nearest

        wrong = re.search(
            r"unrecognized arguments: (-\S+)|invalid choice: '([^']*)'", message
        )
        if wrong is None:
            return ""
        flag, word = wrong.groups()
        if flag:
            return nearest(flag.partition("=")[0], self._option_string_actions)
        choices = (action.choices or () for action in self._actions)
        hint = nearest(word, (str(choice) for offered in choices for choice in offered))
        return hint or _as_file(word)


def _as_file(word: str) -> str:
    """Return a hint for a file or a shipped name where a command should be."""
    from spherekit.files.library import shipped

    if word.endswith((".toml", ".rrd")) or any(pack.path(word) for pack in shipped()):
        verb = "view" if word.endswith(".rrd") else "run"
        return f"; that is a file: spherekit {verb} {word}."
    return ""


@final
class CommandParser(Parser):
    """The parser of a subcommand, whose module is loaded when the command is read."""

    def __init__(self, module: str = "", **options: Any) -> None:
        super().__init__(**options)
        self._module = module
        for short, long, what in (
            ("-T", "--traceback", "show the Python trace of an error"),
            ("-q", "--quiet", "say nothing but errors"),
        ):
            self.add_argument(
                short, long, action="store_true", default=argparse.SUPPRESS, help=what
            )

    def fill(self) -> None:
        """Declare the arguments."""
        if self._module:
            module, self._module = home_of(self._module), ""
            module.add_arguments(self)
            self.show(module.EXAMPLES)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read words after all."""
        self.fill()
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f"unrecognized arguments: {' '.join(rest)}")
        return parsed, rest


def fill(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Declare the arguments of the subcommands that words name."""
    for action in parser._subparsers._group_actions if parser._subparsers else ():
        assert isinstance(action.choices, dict)
        for word in action.choices.keys() & set(words):
            action.choices[word].fill()
            fill(action.choices[word], words)


def home_of(command: str) -> ModuleType:
    """Return the module of a subcommand."""
    return import_module(f"spherekit.cli.{command}")


def parser() -> Parser:
    """Return the command line's grammar."""
    top = Parser(prog="spherekit", description="Analysis of spherical mechanisms.")
    top.show(EXAMPLES)
    top.set_defaults(traceback=False, quiet=False)
    top.add_argument("--version", action="version", version=f"spherekit {__version__}")
    commands = top.add_subparsers(
        dest="command", metavar="COMMAND", parser_class=CommandParser
    )
    for name, summary in COMMANDS.items():
        commands.add_parser(
            name,
            module=name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
        )
    return top
