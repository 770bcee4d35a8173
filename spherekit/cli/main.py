"""The command `spherekit`: its subcommands, and how errors become one paragraph.

stdout carries data, stderr talk. Exit status: 0 fine, 1 bad input, 2 usage, 3 some
samples failed under --strict, 4 an analysis failed, 128 and more stopped by a signal.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from spherekit.errors import SpherekitError
from spherekit.progress import heard_by
from spherekit.version import __version__

BAD_INPUT, USAGE, FAILED_SAMPLES, FAILED_ANALYSIS = 1, 2, 3, 4

COMMANDS = {
    "validate": "check mechanism and study files and say what they hold",
    "plan": "print the Table and the steps that give every pole axis",
    "explain": "say what an analysis will compute, before anything is computed",
    "run": "run analyses over the motion; write tables and a recording",
    "trade": "measure speed against accuracy, and find the cheapest setting",
    "export": "write a mechanism for other programs: stored functions, MuJoCo model",
    "view": "open a recording, or a run's folder, in the viewer, or take a picture",
    "mechanisms": "list the mechanisms that come with spherekit or plugins",
    "analyses": "list the installed analyses, or describe one",
}


def parser() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    top = argparse.ArgumentParser(
        prog="spherekit", description="Analysis of spherical mechanisms."
    )
    top.add_argument("--version", action="version", version=f"spherekit {__version__}")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "-T",
        "--traceback",
        action="store_true",
        help="show the Python trace of an error",
    )
    common.add_argument("-q", "--quiet", action="store_true", help="no messages on stderr")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        sub = commands.add_parser(
            name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
            parents=[common],
        )
        _module(name).add_arguments(sub)
    return top


def _module(name: str):  # type: ignore[no-untyped-def]
    return import_module(f"spherekit.cli.{name}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(words)
    options.words = words
    if options.traceback:
        _trace_plugins()
    try:
        with heard_by(None if options.quiet else _say):
            status = int(_module(options.command).execute(options))
        sys.stdout.flush()
        return status
    except SpherekitError as problem:
        if options.traceback:
            raise
        notes = getattr(problem, "__notes__", ())
        print("; ".join([f"spherekit: {problem}", *notes]), file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("spherekit: stopped", file=sys.stderr)
        return 130


def _trace_plugins() -> None:
    """Print the trace of what a plugin raises, beside the sentence that says so."""
    import logging

    log = logging.getLogger("spherekit.plugins")
    log.setLevel(logging.DEBUG)
    log.addHandler(logging.StreamHandler())


def _say(text: str) -> None:
    print(f"spherekit: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
