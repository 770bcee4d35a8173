"""The parser of the command line: all subcommands, and how it refuses what it cannot read.

Each subcommand is a module ``spherekit.cli.NAME`` with three parts: `EXAMPLES`, shown at
the end of its help, ``add_arguments(parser)``, and ``execute(options)``, which returns the
exit status. A module is imported only when its subcommand is read, so that help and
refusals appear at once.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

from spherekit.version import __version__

USAGE_ERROR = 2
"""Exit status of a command line that the parser refuses."""

COMMAND_GROUPS = {
    "describe a mechanism": {
        "new": "write a file to start from: a mechanism, or an analysis of your own",
        "validate": "check mechanism and study files",
        "import": "make a mechanism file from a MuJoCo model or a URDF",
        "mechanisms": "list the mechanisms that come with spherekit and its plugins",
    },
    "analyse": {
        "run": "compute motion and analyses; write tables, figures and a recording",
        "plan": "show how the pole axes can be constructed one after another",
        "explain": "predict what a run would compute, and the sizes of its tables",
        "analyses": "list the analyses, or describe one",
        "certify": "prove assembly modes and singularities; write a certificate",
        "trade": "measure how fast and how accurate each setting of a run is",
    },
    "design": {
        "sweep": "compare designs: vary dimensions and compute figures of merit",
        "synthesize": "find dimensions with which the output follows a function, or that "
        "minimise an objective",
    },
    "show and export": {
        "view": "show a recording or a mechanism in the viewer, or make a picture",
        "page": "write a mechanism as one HTML page on which it moves",
        "export": "write source code, tables, LaTeX or a MuJoCo model",
        "completion": "print a shell completion script",
    },
}
"""The subcommands, grouped by their purpose, and what each subcommand does."""

COMMANDS = {
    name: summary for group in COMMAND_GROUPS.values() for name, summary in group.items()
}
"""The subcommands, and what each subcommand is for."""

EXAMPLES = """examples:
  # a file to start from
  spherekit new mechanism wrist
  # check a file, and count its assembly modes
  spherekit validate four_bar
  # how its pole axes are constructed
  spherekit plan stephenson --steps
  # what an analysis finds
  spherekit run four_bar -a singularities
  # tables and a recording
  spherekit run four_bar -o out --save out/four_bar.rrd
  # the recording in the viewer
  spherekit view out
"""


class CommandLineParser(argparse.ArgumentParser):
    """Parses the command line; errors name the nearest allowed word and where to read more.

    Other than in `argparse`, help texts keep the line breaks of their examples.
    """

    def __init__(self, **options: Any) -> None:
        """Make a parser with the options of `argparse.ArgumentParser`."""
        formatter = partial(argparse.RawDescriptionHelpFormatter, max_help_position=20)
        super().__init__(formatter_class=formatter, **options)
        # A word such as -40deg or -10,20 is a value. argparse itself takes only numbers
        # such as -0.5 for values.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the options that the words of a command line state, or exit."""
        options, unread_words = self.parse_known_args(args, namespace)
        if unread_words:
            self.refuse_words(unread_words)
        return options

    def refuse_words(self, unread_words: Sequence[str]) -> NoReturn:
        """Exit with a message on words that no argument takes."""
        from spherekit.wording import nearest

        flags = [word.partition("=")[0] for word in unread_words if word.startswith("-")]
        hint = nearest(flags[0], self._option_string_actions) if flags else ""
        self.error(f"unrecognized arguments: {' '.join(unread_words)}{hint}")

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where to read more, and exit."""
        if message.endswith("expected one argument"):
            # argparse takes the value -x for an option.
            message += "; a value that starts with - is written --OPTION=-VALUE"
        end = "" if message.endswith(("?", ".")) else "."
        print(f"{self.prog}: {message}{end} See: {self.prog} --help", file=sys.stderr)
        sys.exit(USAGE_ERROR)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value of an argument; refuse an empty text.

        An empty text usually comes from a shell variable that is not set. As a path, it
        would be the current folder. `argparse` calls this method for each argument.
        """
        if not arg_string and action.nargs != argparse.PARSER:
            raise argparse.ArgumentError(
                action,
                "the value is empty; perhaps a shell variable is not set",
            )
        return super()._get_value(action, arg_string)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise `argparse.ArgumentError` if a value is not among the choices.

        `argparse` calls this method for each argument. The message suggests the nearest
        choice. If a user wrote a file instead of a command, the message names the command
        for such a file.

        Parameters
        ----------
        action
            The declaration of the argument, with its choices.
        value
            The value that the user gave.
        """
        from spherekit.wording import nearest

        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            hint = nearest(str(value), map(str, action.choices or ()))
            # `argparse.PARSER` marks the argument that is the name of a command.
            if not hint and action.nargs == argparse.PARSER:
                hint = _suggest_command_for_file(str(value))
            error.message += hint
            raise


def _suggest_command_for_file(word: str) -> str:
    """Return a hint if a word is a file or a shipped one, else an empty text."""
    from spherekit.files.library import shipped

    is_recording = word.endswith(".rrd")
    if is_recording or word.endswith(".toml") or any(pack.path(word) for pack in shipped()):
        command = "view" if is_recording else "run"
        return f". {word!r} is a file, not a command; try: spherekit {command} {word}."
    return ""


class CommandParser(CommandLineParser):
    """The parser of one subcommand of spherekit, such as ``run``.

    The module of the subcommand declares its arguments. It is imported only if this
    subcommand is used, so that the program starts quickly.
    """

    def __init__(self, command: str, **options: Any) -> None:
        """Create a parser that has no arguments yet."""
        super().__init__(**options)
        self._command = command
        self._has_arguments = False

    def import_command(self) -> None:
        """Import the module of this subcommand, and add its arguments and examples.

        Further calls have no effect.
        """
        if self._has_arguments:
            return
        self._has_arguments = True
        module = import_module(f"spherekit.cli.{self._command}")
        self.epilog = module.EXAMPLES
        self.set_defaults(execute=module.execute)
        self.add_argument(
            "-T",
            "--traceback",
            action="store_true",
            help="if an error occurs, also print its Python traceback",
        )
        self.add_argument(
            "-q", "--quiet", action="store_true", help="print nothing but errors"
        )
        self.add_argument(
            "-v",
            "--verbose",
            action="store_true",
            help="also print details of the computation",
        )
        module.add_arguments(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read the words of the command, and refuse words that no argument takes."""
        self.import_command()
        options, unread_words = super().parse_known_args(args, namespace)
        if unread_words:
            self.refuse_words(unread_words)
        return options, unread_words


def build_parser() -> CommandLineParser:
    """Return the parser of the whole command line.

    Each command has a parser of its own. It imports the module of the command, such as
    `spherekit.cli.run`, only if the command is used. The module then declares its options.
    """
    parser = CommandLineParser(
        prog="spherekit", description=_describe_commands(), epilog=EXAMPLES
    )
    parser.add_argument("--version", action="version", version=f"spherekit {__version__}")
    commands = parser.add_subparsers(
        dest="command",
        metavar="COMMAND",
        parser_class=CommandParser,
        help="one of these commands; spherekit COMMAND --help describes it",
    )
    for name, summary in COMMANDS.items():
        commands.add_parser(
            name,
            command=name,
            description=f"{summary[0].upper()}{summary[1:]}.",
        )
    return parser


def _describe_commands() -> str:
    """Return the beginning of the help: all commands, by their purpose."""
    lines = ["Analysis of spherical mechanisms."]
    width = max(map(len, COMMANDS))
    for purpose, summaries in COMMAND_GROUPS.items():
        lines += ["", f"commands to {purpose}:"]
        lines += [f"  {name:{width}}  {summary}" for name, summary in summaries.items()]
    return "\n".join(lines)


def command_parsers(
    parser: CommandLineParser, names: Iterable[str] = COMMANDS
) -> dict[str, CommandParser]:
    """Return the parsers of subcommands by name, with all arguments declared.

    `build_parser` leaves the arguments out, so that the program starts quickly. A parser
    otherwise gets them only when it reads a command line. They are needed earlier to
    complete a command line with the Tab key, and to write the documentation of all
    subcommands.

    Parameters
    ----------
    parser
        The parser from `build_parser`.
    names
        Names of subcommands. Other words are ignored.
    """
    # argparse has no public way to list subcommands.
    assert parser._subparsers is not None
    action = parser._subparsers._group_actions[0]
    assert isinstance(action.choices, dict)
    parsers = {name: action.choices[name] for name in names if name in action.choices}
    for command_parser in parsers.values():
        command_parser.import_command()
    return parsers
