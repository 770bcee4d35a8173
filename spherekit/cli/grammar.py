"""The grammar of the command line, of which only what is asked for is loaded.

The page of help that each command has is the one declaration of its arguments: an entry
for each, what it takes in capitals as users read it, and below it what it is for. What
``[N=16]`` takes may be left out and is then 16, ``...`` may be repeated, ``= 5`` is the
default, ``!`` has to be given, and of neighbours that begin with ``|`` only one may be.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from spherekit.cli import suggest
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
    "synthesize": "find sizes for a wanted function, or the least of a figure of merit",
    "trade": "measure speed against accuracy, and find the cheapest setting",
    "export": "write a mechanism for others: C and other sources, LaTeX, MuJoCo, tables",
    "page": "write a mechanism as one page that any browser opens and moves",
    "import": "read a mechanism from a MuJoCo model (MJCF) or a URDF",
    "view": "open a recording, or a run's folder, in the viewer, or take a picture",
    "mechanisms": "list the mechanisms that come with spherekit or plugins",
    "analyses": "list the installed analyses, or describe one",
    "completion": "print what makes a shell complete spherekit's words",
}

EXAMPLES = """examples:
  # a file to start from
  spherekit new mechanism wrist
  # is a mechanism sound, in how many assembly modes?
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

EVERYWHERE = """
-T, --traceback
    show the Python trace of an error
-q, --quiet
    say nothing but errors
"""

ENTRY = re.compile(
    r"^(\| )?((?:-\w, )?--[\w-]+|[A-Z]+(?= \{)|) ?(\S.*?|)( \.\.\.)?( !)?(?: = (\S+))?\n"
    r"((?: {4}.*\n)+)",
    re.M,
)
_ABSENT = re.compile(r"\[([^\]]+?)(?:=(\w+))?( \.\.\.)?\]")


def sample_counts(text: str) -> int | tuple[int, ...]:
    """Return the number of samples that ``361`` or, for a grid, ``41x21`` names."""
    parts = text.split("x")
    if not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(
            f"needs whole numbers of at least 1, such as 361 or 41x21, not {text!r}"
        )
    first, *others = map(int, parts)
    return (first, *others) if others else first


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a list with commas."""
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a number, or several with commas between them"
        ) from None


def row_count(text: str) -> int:
    """Return the number of rows that a text names."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(
            f"needs a whole number of at least 1, such as 16, not {text!r}; write the "
            "file before --verify"
        )
    return int(text)


READ: Mapping[str, Callable[[str], Any]] = {
    "N": int,
    "K": int,
    "PORT": int,
    "T": float,
    "RAD": float,
    "METRES": float,
    "DIR": Path,
    "X.rrd": Path,
    "ROWS": row_count,
    "N[xM...]": sample_counts,
    "Q[,Q...]": numbers,
}
"""How what stands for a word of a page is read, where it is not a text."""

SUGGEST: Mapping[str, suggest.Suggest] = {
    "FILE": suggest.mechanisms,
    "FILE|STUDY": suggest.studies,
    "FILE|DIR": suggest.recordings,
    "SYNTHESIS": suggest.tables,
    "PAIR": suggest.pairs,
    "ANALYSIS": suggest.analyses,
    "NAME[:key=value,...]": suggest.analyses,
}
"""What a shell may complete where a word of a page stands."""


FORMATTER = partial(argparse.RawDescriptionHelpFormatter, max_help_position=20)
"""Help with the examples as they are, and words before what they mean."""


class Parser(argparse.ArgumentParser):
    """A parser that says what was meant, and shows examples."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=FORMATTER, **options)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Refuse an empty word, which as a path would mean the current folder."""
        if not arg_string and action.nargs != argparse.PARSER:
            raise argparse.ArgumentError(
                action,
                f"found an empty text for {action.metavar or action.dest.upper()} (an "
                "unset variable of the shell?)",
            )
        return super()._get_value(action, arg_string)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and how to learn more, and exit."""
        for wrong, right in (
            (r"invalid float value: (.*)", r"\1 is not a number"),
            (r"invalid int value: (.*)", r"\1 is not a whole number"),
            (
                r"argument (?:\S+/)?(--\S+): expected one argument$",
                r"\g<0>; one that starts with - is written \1=-VALUE",
            ),
        ):
            message = re.sub(wrong, right, message)
        print(
            f"{self.prog}: {message}{self._meant(message) or '.'} See: {self.prog} --help",
            file=sys.stderr,
        )
        sys.exit(USAGE)

    def _meant(self, message: str) -> str:
        """Return a hint at the word that was meant by a refused one."""
        from spherekit.wording import nearest

        wrong = re.search(
            r"unrecognized arguments: (-\S+)|invalid choice: '([^']*)'", message
        )
        if wrong is None:
            return ""
        flag, word = wrong.groups()
        if flag:
            return nearest(flag.partition("=")[0], self._option_string_actions)
        choices = (str(x) for action in self._actions for x in action.choices or ())
        return nearest(word, choices) or _as_file(word)


def _as_file(word: str) -> str:
    """Return a hint for a file or a shipped name where a command should be."""
    from spherekit.files.library import shipped

    if word.endswith((".toml", ".rrd")) or any(pack.path(word) for pack in shipped()):
        verb = "view" if word.endswith(".rrd") else "run"
        return f"; that is a file: spherekit {verb} {word}."
    return ""


class CommandParser(Parser):
    """The parser of a subcommand, whose module is loaded when the command is read."""

    def __init__(self, command: str, **options: Any) -> None:
        super().__init__(**options)
        self._command = command

    def fill(self) -> None:
        """Declare the arguments that the command's page has."""
        if self.epilog:
            return
        entries, mark, examples = home_of(self._command).PAGE.partition("examples:")
        self.epilog = mark + examples
        for either, matches in groupby(ENTRY.findall(EVERYWHERE + entries), itemgetter(0)):
            place = self.add_mutually_exclusive_group() if either else self
            for _, *entry in matches:
                _declare(place, entry)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read words after all."""
        self.fill()
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f"unrecognized arguments: {' '.join(rest)}")
        return parsed, rest


def _declare(place: Any, entry: Sequence[str]) -> None:
    """Declare an argument by the parts of its entry in a page."""
    names, word, again, needed, default, text = entry
    form: dict[str, Any] = {"help": " ".join(text.split())}
    absent, (first, *others) = _ABSENT.fullmatch(word), word.split(" ")
    if not word:
        form["action"] = "store_true"
    elif absent:
        first, form["const"], several = absent.groups()
        form["nargs"] = "*" if several else "?"
    elif others:
        form["nargs"] = "+" if others[-1] == "...]" else 1 + len(others)
    if others and form.get("nargs") == 2:
        form["metavar"] = (first, *others)
    elif first.startswith("{"):
        form["choices"] = first[1:-1].split(",")
    elif word:
        form["metavar"], form["type"] = first, READ.get(first)
    if again:
        form["action"] = "append"
    if default:
        form["default"] = default
    if needed:
        form["required"] = True
    named = names or re.sub(r"\W.*", "", first)
    flags = named.split(", ") if "-" in named else [named.lower()]
    argument = place.add_argument(*flags, **form)
    words = SUGGEST.get(first)
    if words:
        argument.completer = lambda prefix, parsed_args, **_: words(prefix, parsed_args)


def fill(parser: argparse.ArgumentParser, words: Iterable[str]) -> None:
    """Declare the arguments of the subcommands that words name."""
    for action in parser._subparsers._group_actions if parser._subparsers else ():
        assert isinstance(action.choices, dict)
        for word in action.choices.keys() & set(words):
            action.choices[word].fill()


def home_of(command: str) -> ModuleType:
    """Return the module of a subcommand."""
    return import_module(f"spherekit.cli.{command}")


def parser() -> Parser:
    """Return the command line's grammar."""
    top = Parser(
        prog="spherekit", description="Analysis of spherical mechanisms.", epilog=EXAMPLES
    )
    top.add_argument("--version", action="version", version=f"spherekit {__version__}")
    commands = top.add_subparsers(
        dest="command", metavar="COMMAND", parser_class=CommandParser
    )
    for name, summary in COMMANDS.items():
        commands.add_parser(
            name,
            command=name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
        )
    return top
