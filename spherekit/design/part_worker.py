"""What a worker process of a sweep does: it computes parts and reports them by a pipe.

The process that starts it, and the messages between both, are in `part_processes`.
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

if TYPE_CHECKING:
    from spherekit.design.sweep import Sweep


@dataclass(frozen=True)
class Loaded:
    """A worker has loaded the sweep; with a `fault`, in words, it could not."""

    fault: str = ""


@dataclass(frozen=True)
class Computed:
    """A worker has written a part; with an `error` it could not."""

    number: int
    error: BaseException | None = None


def work() -> None:
    """Compute the parts that are asked for by standard input, until that is closed.

    The first message is the sweep, as a pickle in bytes, with the folder of its parts. Each
    further one is the number of a part. The answers go to what was standard output.
    """
    # Ctrl-C is sent to all processes of a terminal. The parent answers it and ends this.
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
    numbers: queue.SimpleQueue[int] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(messages, numbers), daemon=True).start()
    while True:
        number = numbers.get()
        try:
            sweep.write(folder, number)
        except Exception as fault:
            _send(answers, Computed(number, _portable(fault)))
        else:
            _send(answers, Computed(number))


def _take_standard_output() -> BinaryIO:
    """Return standard output for answers; what libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "wb")
    try:
        os.dup2(2, 1)
    except OSError:  # the parent has no standard error
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return answers


def _receive(messages: BinaryIO, numbers: "queue.SimpleQueue[int]") -> None:
    """Take numbers of parts; end this process with the parent, whatever ended that."""
    while True:
        try:
            numbers.put(pickle.load(messages))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)


def _send(answers: BinaryIO, message: Loaded | Computed) -> None:
    try:
        pickle.dump(message, answers)
        answers.flush()
    except BrokenPipeError:
        os._exit(0)  # the parent has ended


def _portable(fault: Exception) -> BaseException:
    """Return an error that the parent can raise, with the traceback if it is a bug."""
    trace = traceback.format_exc()
    try:
        error: Any = pickle.loads(pickle.dumps(fault))
    except Exception:
        error = DesignError(f"{type(fault).__name__}: {fault}")
    if not isinstance(fault, SpherekitError):
        error.add_note(f"in a worker process of the sweep:\n{trace}")
    return error
