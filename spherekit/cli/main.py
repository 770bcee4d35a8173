"""The command `spherekit`: runs a subcommand and prints an error as one paragraph.

Data is written to stdout, messages to stderr. The exit status is 0 after success and
otherwise one of the constants below, or 2 if the command line cannot be read.
"""

import errno
import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from spherekit.cli.interrupts import interrupt_number, raise_on_interrupt
from spherekit.cli.progress_bar import hide_progress, progress_on_screen
from spherekit.escaping import json_text, terminal_text

BAD_INPUT = 1
"""Exit status if a file, an argument or the system does not allow the command."""

FAILED_SAMPLES = 3
"""Exit status of a run with ``--strict`` in which samples or accuracy checks failed."""

FAILED_ANALYSIS = 4
"""Exit status of a run in which an analysis failed."""

INTERRUPTED = 128
"""Exit status after a signal, less the number of the signal."""

MIN_ADDRESS_SPACE_BYTES = 500_000_000
"""Least address space; with less, numerical libraries end the process while they load."""

MEMORY_MESSAGES = (
    "failed to map segment",
    "annot allocate memory",
    "can't start new thread",
)
"""Parts of messages by which loaders and the system report a lack of memory."""

OUTPUT_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Error numbers (errno) that mean that standard output cannot be written any more."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    An interrupt, or a lack of memory or disk space, is reported in one sentence, without a
    traceback. If the program that reads the output ends early, as ``head`` does in
    ``spherekit ... | head``, the command ends without an error.

    Parameters
    ----------
    arguments
        The words after ``spherekit``; by default the command line of the process.
    """
    # Without arguments, the process was started for this command and ends after it.
    process_ends = arguments is None
    words = sys.argv[1:] if arguments is None else [*arguments]
    try:
        # Ctrl-C raises `KeyboardInterrupt` in this block. After the block, Ctrl-C ends the
        # process at once if `process_ends` is true. Otherwise the caller handles Ctrl-C.
        with raise_on_interrupt(process_ends):
            # If stdout is closed, the next opened file would get the file number of stdout,
            # and with it all output.
            _open_closed_streams()
            try:
                return _run_command(words)
            finally:
                sys.stdout.flush()
    except BrokenPipeError:  # the program that reads stdout has ended
        _discard_output()
        return 0
    except KeyboardInterrupt as interrupt:
        # Notes of the exception say, for example, how to continue the run.
        say("; ".join(["stopped", *getattr(interrupt, "__notes__", ())]))
        return INTERRUPTED + interrupt_number(interrupt)
    except (MemoryError, ImportError, RuntimeError, OSError) as error:
        # A lack of memory can also appear as an ImportError if a library cannot be loaded,
        # or as a RuntimeError if a thread cannot start. For errors with another cause the
        # message is empty.
        message = _system_message(error)
        if not message:
            raise
        if _is_output_error(error):
            _discard_output()
        say(message)
        return BAD_INPUT


def _run_command(words: list[str]) -> int:
    """Run the subcommand that a command line names, and return its exit status.

    An error of spherekit is printed as one sentence. With ``--traceback`` it is raised.

    Parameters
    ----------
    words
        The words after ``spherekit``, such as ``["run", "four_bar"]``.
    """
    from spherekit.cli.command_line import USAGE_ERROR, build_parser, command_parsers
    from spherekit.errors import SpherekitError
    from spherekit.library_warnings import warnings_as_sentences
    from spherekit.resources import need_space

    parser = build_parser()
    # With the Tab key the shell asks which words can follow, and sets this variable.
    if "_ARGCOMPLETE" in os.environ:
        from argcomplete.finders import CompletionFinder

        # The parser of a subcommand gets its arguments when the subcommand is used. This
        # call adds the arguments of the subcommand in the line that is to be completed.
        command_parsers(parser, os.environ["COMP_LINE"].split())
        CompletionFinder()(parser, always_complete_options="long")
    options = parser.parse_args(words)
    options.words = words
    if options.command is None:
        parser.print_help(sys.stderr)
        return USAGE_ERROR
    if options.traceback:
        import logging

        # Errors of plugins are caught and logged. This prints the log with their
        # tracebacks.
        log = logging.getLogger("spherekit.plugins")
        log.setLevel(logging.DEBUG)
        log.addHandler(logging.StreamHandler())
    try:
        # Without enough address space (virtual memory), libraries would end the process
        # without a message.
        need_space(MIN_ADDRESS_SPACE_BYTES, "numerical libraries need")
        with (
            progress_on_screen(options),
            warnings_as_sentences(say, options.traceback),
        ):
            return int(options.execute(options))
    except SpherekitError as error:
        if options.traceback:
            raise
        say("; ".join([str(error), *getattr(error, "__notes__", ())]))
        return BAD_INPUT


def _open_closed_streams() -> None:
    """Open the standard streams that are closed, on the null device.

    Otherwise a file that the command opens would get the number of a standard stream, and
    messages would be written into it.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: PTH123, SIM115
            setattr(sys, name, stream)


def _discard_output() -> None:
    """Redirect stdout to the null device, after it could not be written.

    When the process ends, Python writes what stdout still contains. Without the
    redirection, this writing would raise a second error.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _is_output_error(error: Exception) -> bool:
    """Return whether an error means that standard output cannot be written any more.

    Such an error occurs, for example, if the disk is full to which stdout is redirected. An
    error of another file has the name of the file; an error of standard output has no name.
    """
    return (
        isinstance(error, OSError) and error.errno in OUTPUT_ERRORS and not error.filename
    )


def _system_message(error: Exception) -> str:
    """Return a message if memory is short or if stdout cannot be written; otherwise "".

    Some libraries report a lack of memory by an error class of their own. So the errors
    from which `error` was raised are examined, too.
    """
    cause: BaseException | None = error
    while cause is not None:
        text = str(cause)
        if isinstance(cause, MemoryError) or any(part in text for part in MEMORY_MESSAGES):
            return (
                f"not enough memory ({text or 'the system gives no more'}); raise the "
                "memory limit of this process (ulimit -v), or request fewer samples"
            )
        # The error from which this one was raised, or during which it occurred.
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, OSError) and _is_output_error(error):
        return (
            f"standard output cannot be written: {error.strerror}; redirect it to another "
            "file or program"
        )
    return ""


def note(options: Namespace, *texts: str) -> None:
    """Print the texts that are not empty to stderr, unless ``--quiet`` is given."""
    hide_progress()
    # If the program that reads stderr has ended, the command goes on without these texts.
    with suppress(BrokenPipeError):
        for text in texts:
            if text and not options.quiet:
                print(terminal_text(text), file=sys.stderr, flush=True)


def print_json(data: Any) -> None:
    """Print data as JSON to stdout, for programs."""
    hide_progress()
    print(json_text(data, indent=2))


def say(text: str) -> None:
    """Print a message to stderr."""
    hide_progress()
    # If the program that reads stderr has ended, the exit status still tells of an error.
    with suppress(BrokenPipeError):
        print(f"spherekit: {terminal_text(text)}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
