"""The program of a worker process, which computes parts of a sweep.

A part is a group of successive designs of the sweep. The parent process
(`worker_processes`) sends the numbers of the parts through the standard input of the
worker, and the worker reports each part through its standard output. All messages are
pickled objects.
"""

import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

from spherekit.errors import DesignError, SpherekitError
from spherekit.library_warnings import warnings_as_sentences

if TYPE_CHECKING:
    from spherekit.designs.sweep import Sweep


@dataclass(frozen=True)
class Loaded:
    """The first answer of a worker: it has loaded the sweep, or cannot load it.

    `fault` is the error message, empty if the sweep is loaded.
    """

    fault: str = ""


@dataclass(frozen=True)
class Computed:
    """The answer of a worker on a part (group of designs): it is written, or has failed.

    `number` is the number of the part. `error` is the exception that computing it raised,
    None if the part is written.
    """

    number: int
    error: BaseException | None = None


def work() -> None:
    """Compute parts of a sweep, until the parent process closes standard input.

    A sweep evaluates many designs of a mechanism, in numbered parts. This function runs in
    a worker process. Messages of the parent come through standard input, and answers go to
    standard output. Both are pickled. Texts that other code prints go to standard error.

    The first message is a tuple: the pickled sweep, and the folder in which parts are
    written. The answer is `Loaded`, with the error if the sweep cannot be loaded. Each
    further message is the number of a part, and the answer is `Computed`.
    """
    # Only the parent process handles Ctrl-C, and then ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = _take_standard_output()
    messages = sys.stdin.buffer
    pickled_sweep, folder = pickle.load(messages)
    try:
        sweep: Sweep = pickle.loads(pickled_sweep)
    except Exception as fault:
        _send(answers, Loaded(f"{type(fault).__name__}: {fault}"))
        return
    _send(answers, Loaded())
    waiting_numbers: queue.SimpleQueue[int] = queue.SimpleQueue()
    # This thread receives the numbers, and ends this process when standard input is closed,
    # even during a part.
    threading.Thread(
        target=_receive_numbers, args=(messages, waiting_numbers), daemon=True
    ).start()
    with warnings_as_sentences(_report_warning, shows_source=False):
        while True:
            number = waiting_numbers.get()
            try:
                sweep.write_part(folder, number)
            except Exception as fault:
                _send(answers, Computed(number, _picklable_error(fault)))
            else:
                _send(answers, Computed(number))


def _report_warning(text: str) -> None:
    """Print a warning to standard error, which this process shares with its parent."""
    print(f"spherekit: {text}", file=sys.stderr, flush=True)


def _take_standard_output() -> BinaryIO:
    """Reserve standard output for answers, and return it as a stream.

    File descriptor 1 is redirected to standard error, so that printed text cannot get
    between the pickled answers.
    """
    try:
        os.fstat(2)
    except OSError:
        # There is no standard error, so printed text is dropped. This comes before `dup`,
        # which could otherwise return 2 for the answers.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers


def _receive_numbers(messages: BinaryIO, waiting_numbers: "queue.SimpleQueue[int]") -> None:
    """Put the numbers of parts from standard input into a queue, in a thread of its own.

    When standard input is closed, the parent has ended or needs no more parts. The function
    then ends this process at once, even if a part is being computed.
    """
    while True:
        try:
            waiting_numbers.put(pickle.load(messages))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)


def _send(answers: BinaryIO, message: Loaded | Computed) -> None:
    """Write an answer; end this process if the parent no longer reads the answers."""
    try:
        pickle.dump(message, answers)
        answers.flush()
    except BrokenPipeError:
        os._exit(0)


def _picklable_error(fault: Exception) -> BaseException:
    """Return an exception that the parent process can unpickle and raise.

    Call this in the ``except`` block of `fault`, since the traceback is read here. The
    result is a copy of `fault`. If this is impossible, it is a `DesignError` with the type
    and message of `fault`. An error that is not a `SpherekitError` is a bug, so its
    traceback is added as a note.
    """
    # Unpickling is tried too, since some exceptions can be pickled but not unpickled.
    traceback_text = traceback.format_exc()
    try:
        error: Any = pickle.loads(pickle.dumps(fault))
    except Exception:
        error = DesignError(f"{type(fault).__name__}: {fault}")
    if not isinstance(fault, SpherekitError):
        error.add_note(f"in a worker process of the sweep:\n{traceback_text}")
    return error
