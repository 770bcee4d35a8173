"""The command `spherekit`: its subcommands, and how errors become one paragraph.

stdout carries data, stderr talk. Exit status: 0 fine, 1 bad input, 2 usage, 3 some
samples failed under --strict, 4 an analysis failed, 128 and more stopped by a signal.
"""

import os
import sys
from collections.abc import Sequence

from spherekit.cli.grammar import USAGE, fill, home_of, parser
from spherekit.errors import SpherekitError
from spherekit.progress import heard_by

BAD_INPUT, FAILED_SAMPLES, FAILED_ANALYSIS = 1, 3, 4


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    grammar = parser()
    if "_ARGCOMPLETE" in os.environ:
        from argcomplete.finders import CompletionFinder

        fill(grammar, os.environ["COMP_LINE"].split())
        CompletionFinder()(grammar, always_complete_options="long")
    options = grammar.parse_args(words)
    options.words = words
    if options.command is None:
        grammar.print_help(sys.stderr)
        return USAGE
    if options.traceback:
        _trace_plugins()
    try:
        with heard_by(None if options.quiet else _say):
            status = int(home_of(options.command).execute(options))
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
