"""Computes the parts of a sweep with worker processes of this machine.

A sweep computes many designs of one mechanism. It is divided into parts: a part is a group
of successive designs, which are computed together and written to a few Parquet files.

Each worker is a separate Python interpreter that runs `worker_program.work`. It does not
import the script that called the sweep, so the script needs no ``if __name__ ==
"__main__"``. Functions and classes that the script itself defines (analyses, torques) are
sent by value. Messages are pickled: this process writes them to the standard input of the
worker, and reads the answers from its standard output.
"""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import suppress
from multiprocessing.spawn import get_executable
from typing import Any

from spherekit.designs.sweep import Sweep
from spherekit.designs.worker_program import Computed, Loaded
from spherekit.errors import DesignError
from spherekit.progress import REPORT_INTERVAL_S, announce

WORKER_PROGRAM = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from spherekit.designs.worker_program import work; work()"
)
"""The Python code of a worker.

The code first reads the `sys.path` of this process, so that the worker imports the same
modules.
"""

MAX_DEATHS_AMONG_OTHERS = 2
"""Number of workers that may end during one part while other workers run.

Workers usually end because memory is short. After this number, the part is computed last,
by a single worker that has all of the memory. With a larger number, a part that needs much
memory ends more workers. With a smaller number, a part may be postponed although the cause
that ended its worker does not recur.
"""

SINGLE_PROCESS_HINT = "workers=1 (--workers 1) needs no other process"
"""The alternative that error messages suggest: this process computes all parts itself."""


def can_start_workers() -> bool:
    """Return whether this process can start worker processes.

    A worker needs the executable of Python. Programs that contain their own interpreter
    ("frozen" or embedded) have none.
    """
    return bool(get_executable()) and not getattr(sys, "frozen", False)


def compute_in_processes(
    sweep: Sweep, folder: str, part_numbers: Sequence[int], workers: int
) -> Generator[int, None, None]:
    """Compute parts of a sweep in worker processes, and yield the number of each.

    A part is a group of successive designs. If a worker ends while it computes a part
    (usually because the system has no memory left), another worker computes the part again.
    A part at which `MAX_DEATHS_AMONG_OTHERS` workers have ended is computed last, by a
    single worker, which then has all the memory.

    All workers are ended when the generator is closed. If this process ends in any way, the
    workers end themselves, because their standard input is closed.

    Parameters
    ----------
    sweep
        The sweep whose parts are computed.
    folder
        Path of the folder in which the workers write the parts.
    part_numbers
        Numbers of the parts to compute, counted from 0.
    workers
        Largest number of workers that run at the same time.

    Yields
    ------
    The number of each part as soon as its files are written, in the order in which the
    parts are finished.

    Raises
    ------
    DesignError
        If the sweep cannot be pickled, no worker can be started, a worker cannot load the
        sweep, or one part has ended `MAX_DEATHS_AMONG_OTHERS` + 1 workers.
    Exception
        The error that computing a part raised in a worker.
    """
    sweep_message = _sweep_message(sweep), folder
    waiting_parts: queue.SimpleQueue[int] = queue.SimpleQueue()
    for number in part_numbers:
        waiting_parts.put(number)
    death_counts = Counter[int]()
    postponed_parts: list[int] = []
    crew = _Crew(sweep, sweep_message, waiting_parts, min(workers, len(part_numbers)))
    with crew:
        for event in crew.events():
            if isinstance(event, int):  # the number of a finished part
                yield event
                continue
            death_counts[event.number] += 1
            if death_counts[event.number] < MAX_DEATHS_AMONG_OTHERS:
                _report_death(sweep, event, "another process computes it")
                crew.compute_again(event.number)
            else:
                _report_death(
                    sweep, event, "it is computed again when no other process is running"
                )
                postponed_parts.append(event.number)
    # The other workers have ended, so a single worker can use all of the memory.
    for number in sorted(postponed_parts):
        waiting_parts.put(number)
        with _Crew(sweep, sweep_message, waiting_parts, 1) as single_worker:
            for event in single_worker.events():
                if not isinstance(event, int):
                    raise DesignError(
                        f"{_describe_part(sweep, number)}: the system ended each of "
                        f"{MAX_DEATHS_AMONG_OTHERS + 1} processes that computed it "
                        f"({event.cause}), perhaps because memory ran out; parts that are "
                        "written are kept. Ask for fewer samples, or for --workers 1, "
                        "which needs less memory, and run the same command again to "
                        "continue"
                    )
                yield event


class _WorkerDeath:
    """Reports that a worker process ended while it computed a part of a sweep.

    A sweep evaluates many designs of a mechanism, in numbered parts.

    Attributes
    ----------
    number
        Number of the part.
    cause
        Exit status or signal in words, such as ``"signal 9, SIGKILL"``.
    """

    def __init__(self, number: int, status: int) -> None:
        """Describe the end of a worker; `status` is its exit status as in `Popen.wait`."""
        self.number = number
        self.cause = f"exit status {status}"
        # On POSIX systems a status -n means that signal n ended the process.
        if status < 0:
            with suppress(ValueError):  # this system has no name for the signal
                self.cause = f"signal {-status}, {signal.Signals(-status).name}"


def _describe_part(sweep: Sweep, number: int) -> str:
    """Return the name of the mechanism, the part and its designs for a message.

    An example is ``"four_bar: part 2 (designs 512 to 767)"``.
    """
    first = number * sweep.part_size
    last = min(first + sweep.part_size, sweep.space.count) - 1
    designs = f"design {first}" if first == last else f"designs {first} to {last}"
    return f"{sweep.mechanism.name}: part {number} ({designs})"


def _report_death(sweep: Sweep, death: _WorkerDeath, consequence: str) -> None:
    """Report the end of a worker to the user, with the measure that is taken."""
    part = _describe_part(sweep, death.number)
    announce(
        f"{part}: its process was ended ({death.cause}); {consequence}", REPORT_INTERVAL_S
    )


def _sweep_message(sweep: Sweep) -> bytes:
    """Return a sweep pickled for the workers.

    A sweep evaluates many designs of a mechanism, in numbered parts. Functions and classes
    that the calling script defines are included by value, because a worker cannot import
    the script.

    Raises
    ------
    DesignError
        If the sweep contains an object that cannot be pickled.
    """
    import cloudpickle

    try:
        return cloudpickle.dumps(sweep)  # type: ignore[no-any-return]
    except Exception as fault:
        raise DesignError(
            f"{sweep.mechanism.name}: the sweep cannot be sent to worker processes "
            f"({type(fault).__name__}: {fault}); keep thread locks, open connections and "
            f"the like out of analyses, or ask for one process: {SINGLE_PROCESS_HINT}"
        ) from None


class _WorkerProcess:
    """A process that computes parts of a sweep (groups of designs), and two pipes to it.

    One pipe is for messages to the process, the other for its answers. The constructor
    starts the process. `load` must be called before `compute`.

    Attributes
    ----------
    popen
        The process.
    """

    def __init__(self, sweep: Sweep) -> None:
        """Start a worker process, which will compute parts of a sweep.

        A sweep evaluates many designs of a mechanism, in numbered parts. The worker gets
        the sweep later, by `load`.

        Parameters
        ----------
        sweep
            The sweep, whose mechanism is named in error messages.

        Raises
        ------
        DesignError
            If the process cannot be started.
        """
        self._name = sweep.mechanism.name
        # A terminal sends Ctrl-C to all processes of a group. A group of its own protects
        # the worker, since only the parent process handles Ctrl-C.
        group_options: dict[str, Any] = {"process_group": 0}
        if os.name == "nt":
            group_options = {
                "creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
            }
        self._python = os.fsdecode(get_executable() or "")
        # With either option, Python does not search the current folder for modules. There,
        # a file such as pickle.py would replace the module `pickle` of Python.
        import_flag = "-I" if sys.flags.isolated else "-P"
        command = [self._python, import_flag, "-c", WORKER_PROGRAM]
        try:
            self.popen = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **group_options
            )
        except OSError as fault:
            raise DesignError(
                f"{self._name}: no worker process can be started from {self._python!r} "
                f"({fault.strerror}); {SINGLE_PROCESS_HINT}"
            ) from None
        assert self.popen.stdin is not None and self.popen.stdout is not None
        self._messages = self.popen.stdin
        self._answers = self.popen.stdout

    def load(self, sweep_message: tuple[bytes, str]) -> None:
        """Send a sweep to the worker process, and wait until the worker has loaded it.

        A sweep evaluates many designs of a mechanism, in numbered parts. If a signal ends
        the worker during this time, the next call of `compute` returns None.

        Parameters
        ----------
        sweep_message
            The pickled sweep, and the path of the folder in which parts are written.

        Raises
        ------
        DesignError
            If the worker cannot load the sweep, or ended by itself with an exit status.
        """
        # The worker needs the import path first, to load the sweep. `_send` returns whether
        # the message could be written.
        is_sent = self._send(sys.path) and self._send(sweep_message)
        # None: the worker ended before it answered.
        answer = self._receive_answer() if is_sent else None
        if isinstance(answer, Loaded):
            if answer.fault:
                raise DesignError(
                    f"{self._name}: a worker process cannot load the sweep "
                    f"({answer.fault}); define what it uses in the script itself or in a "
                    "module that can be imported, or ask for one process: "
                    f"{SINGLE_PROCESS_HINT}"
                )
            return
        # A negative status means that a signal ended the worker, for example for want of
        # memory. With any other status, Python has printed the error of the worker on this
        # screen.
        exit_status = self.end()
        if exit_status >= 0:
            raise DesignError(
                f"{self._name}: a worker process ended as it started (exit status "
                f"{exit_status}, {self._python!r}); its error message is above. Without "
                f"worker processes: {SINGLE_PROCESS_HINT}"
            )

    def compute(self, number: int) -> Computed | None:
        """Let the worker compute a part and wait for its answer.

        Parameters
        ----------
        number
            Number of the part, counted from 0.

        Returns
        -------
        The answer of the worker, or None if the worker ended without an answer.
        """
        answer = self._receive_answer() if self._send(number) else None
        return answer if isinstance(answer, Computed) else None

    def end(self) -> int:
        """Close the pipes, wait until the worker has ended, and return its exit status.

        A worker ends itself when its standard input is closed. The status is negative if a
        signal ended the worker.
        """
        for pipe in (self._messages, self._answers):
            with suppress(OSError):
                pipe.close()
        return self.popen.wait()

    def _send(self, message: object) -> bool:
        """Send a message to the worker; return False if the pipe is broken or closed."""
        try:
            pickle.dump(message, self._messages)
            self._messages.flush()
        except (OSError, ValueError):  # the pipe is broken, or was closed by `end`
            return False
        return True

    def _receive_answer(self) -> Loaded | Computed | None:
        """Wait for the next answer of the worker; return None if the worker has ended."""
        try:
            return pickle.load(self._answers)  # type: ignore[no-any-return]
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            return None  # the worker ended before or while it wrote the answer


class _Crew:
    """A group of workers that compute the parts in a queue at the same time.

    Each worker is controlled by a thread of this process, which waits for its answers. The
    threads report finished parts and the ends of workers in a second queue, which `events`
    reads. The crew is used in a ``with`` block: entering the block starts the threads, and
    leaving it kills all workers and waits for the threads.
    """

    def __init__(
        self,
        sweep: Sweep,
        sweep_message: tuple[bytes, str],
        waiting_parts: "queue.SimpleQueue[int]",
        worker_count: int,
    ) -> None:
        """Prepare threads that compute the parts of a sweep with worker processes.

        A sweep evaluates many designs of a mechanism, in numbered parts. Each thread runs
        one worker process at a time. Nothing is started yet.

        Parameters
        ----------
        sweep
            The sweep, for error messages.
        sweep_message
            The pickled sweep, and the path of the folder in which parts are written.
        waiting_parts
            Queue with the numbers of the parts to compute. The threads take them out.
        worker_count
            Number of threads, and of workers that run at the same time.
        """
        self._sweep = sweep
        self._sweep_message = sweep_message
        self._waiting_parts = waiting_parts
        # The threads put the number of each finished part, the report of an ended worker,
        # or an error into this queue. The method `events` takes them out.
        self._events: queue.SimpleQueue[int | _WorkerDeath | BaseException] = (
            queue.SimpleQueue()
        )
        # The number of parts whose event was not taken out yet. It says that the part is
        # finished, or that its worker ended.
        self._open_parts = waiting_parts.qsize()
        self._must_stop = threading.Event()
        self._running_workers: set[_WorkerProcess] = set()
        self._threads = [
            threading.Thread(target=self._run_worker, daemon=True)
            for _ in range(worker_count)
        ]

    def __enter__(self) -> "_Crew":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End all workers and threads, even if they are computing a part."""
        self._must_stop.set()
        # A thread that saw `_must_stop` too late may still start a worker. Therefore the
        # workers are killed repeatedly until all threads have ended.
        while any(thread.is_alive() for thread in self._threads):
            for process in tuple(self._running_workers):
                process.popen.kill()
            for thread in self._threads:
                thread.join(0.05)

    def compute_again(self, number: int) -> None:
        """Put the number of a part whose worker ended back into the queue.

        `events` yields the numbers of finished parts and the ends of workers. Call this
        method before the next event is taken, since `events` stops when no part is open.
        """
        self._open_parts += 1
        self._waiting_parts.put(number)

    def events(self) -> Generator[int | _WorkerDeath, None, None]:
        """Yield one event for each part of the sweep, until all parts are finished.

        A sweep evaluates many designs of a mechanism, in numbered parts. The parts are
        computed by worker processes.

        Yields
        ------
        The number of a part whose files are written, or a `_WorkerDeath` if the worker of a
        part ended. After a `_WorkerDeath` the part is not computed again unless
        `compute_again` is called.

        Raises
        ------
        DesignError
            If a worker cannot be started or cannot load the sweep.
        Exception
            The error that computing a part raised in a worker.
        """
        while self._open_parts:
            try:
                # On Windows, Ctrl-C does not interrupt a `get` without a timeout.
                event = self._events.get(timeout=0.5)
            except queue.Empty:
                continue
            if isinstance(event, BaseException):
                raise event
            self._open_parts -= 1
            yield event

    def _run_worker(self) -> None:
        """Start a worker process and let it compute parts of the sweep, one by one.

        Each thread of the crew runs this function until the crew is stopped. The thread
        takes the numbers of parts from a queue. For each part the thread puts one event
        into `_events`:

        - the number of the part, if it is written,
        - the error, if the part cannot be computed,
        - a `_WorkerDeath`, if the worker ended. A new worker is then started for the next
          part.

        Any other exception is put into `_events`, too, and ends the thread.
        """
        process: _WorkerProcess | None = None
        try:
            while not self._must_stop.is_set():
                try:
                    number = self._waiting_parts.get(timeout=0.05)
                except queue.Empty:
                    # Wait, since `compute_again` may still put a part into the queue.
                    continue
                # A worker is started only when there is a part for it.
                if process is None:
                    process = _WorkerProcess(self._sweep)
                    self._running_workers.add(process)
                    process.load(self._sweep_message)
                answer = process.compute(number)
                if answer is None:
                    self._running_workers.discard(process)
                    self._events.put(_WorkerDeath(number, process.end()))
                    process = None
                elif answer.error is not None:
                    self._events.put(answer.error)
                else:
                    self._events.put(answer.number)
        except BaseException as fault:
            self._events.put(fault)
        finally:
            if process is not None:
                self._running_workers.discard(process)
                process.popen.kill()
                process.end()
