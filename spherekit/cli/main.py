"""The command `spherekit`: its subcommands, and how errors become one paragraph.

stdout carries data, stderr talk. Exit status: 0 fine, 1 bad input, 2 usage, 3 some
samples failed under --strict, 4 an analysis failed, 128 and more stopped by a signal.
"""

import errno
import os
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from typing import Any

from spherekit.cli.stopping import signal_of, stoppable
from spherekit.escaping import json_text, terminal_text

BAD_INPUT = 1
FAILED_SAMPLES = 3
FAILED_ANALYSIS = 4
STOPPED = 128
"""Exit statuses; of a command that was stopped, the number of the signal is added."""

LEAST_SPACE = 500_000_000
"""Bytes of addresses below which numerical libraries end the process as they load."""

NO_MEMORY = ("failed to map segment", "annot allocate memory", "can't start new thread")
"""What loaders and systems say of it."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Why standard output takes no more. Faults of files have the file's name."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    try:
        with stoppable(to_the_end=arguments is None):
            _open_streams()
            try:
                return _executed(list(sys.argv[1:] if arguments is None else arguments))
            finally:
                sys.stdout.flush()
    except BrokenPipeError:
        _drop_output()
        return 0
    except KeyboardInterrupt as stop:
        say("; ".join(["stopped", *getattr(stop, "__notes__", ())]))
        return STOPPED + signal_of(stop)
    except (MemoryError, ImportError, RuntimeError, OSError) as problem:
        why = _reason(problem)
        if not why:
            raise
        say(why)
        return BAD_INPUT


def _executed(words: list[str]) -> int:
    """Run a command line and return its exit status."""
    from spherekit.cli.grammar import USAGE, fill, home_of, parser
    from spherekit.errors import SpherekitError
    from spherekit.library_warnings import warnings_as_sentences
    from spherekit.progress import progress_listener
    from spherekit.resources import need_space

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
        import logging

        log = logging.getLogger("spherekit.plugins")  # what plugins raise, with its trace
        log.setLevel(logging.DEBUG)
        log.addHandler(logging.StreamHandler())
    try:
        need_space(LEAST_SPACE, "numerical libraries need")
        with (
            progress_listener(None if options.quiet else say),
            warnings_as_sentences(say, options.traceback),
        ):
            return int(home_of(options.command).execute(options))
    except SpherekitError as problem:
        if options.traceback:
            raise
        say("; ".join([str(problem), *getattr(problem, "__notes__", ())]))
        return BAD_INPUT


def _open_streams() -> None:
    """Open standard streams that are closed: files of ours would get their numbers."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115


def _drop_output() -> None:
    """Let what stdout still holds go nowhere, or Python would fail at it once more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _reason(problem: Exception) -> str:
    """Return why a command ended by the system's fault, empty if it is another one."""
    for cause in _causes(problem):
        if isinstance(cause, MemoryError) or any(x in str(cause) for x in NO_MEMORY):
            return (
                f"there is not enough memory ({str(cause) or 'no more is given'}); allow "
                "more (ulimit -v), or ask for fewer samples"
            )
    if isinstance(problem, OSError) and problem.errno in FULL and not problem.filename:
        _drop_output()
        return f"standard output cannot be written: {problem.strerror}; let it go elsewhere"
    return ""


def _causes(problem: BaseException | None) -> Iterator[BaseException]:
    while problem is not None:
        yield problem
        problem = problem.__cause__ or problem.__context__


def note(options: Namespace, *texts: str) -> None:
    """Print texts that are not empty to stderr, unless errors alone are wanted."""
    for text in texts:
        if text and not options.quiet:
            print(terminal_text(text), file=sys.stderr)


def print_json(facts: Any) -> None:
    """Print what a program reads to stdout."""
    print(json_text(facts, indent=2))


def say(text: str) -> None:
    """Print a message to stderr."""
    print(f"spherekit: {terminal_text(text)}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
