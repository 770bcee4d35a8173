"""Parts of a sweep computed by worker processes of this machine.

Each worker is a Python interpreter of its own, whose program is `part_worker.work`. It does
not import the program that called the sweep, so a script needs no main guard. What the
script defines itself (analyses, torques) is sent by value.
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

from spherekit.design.part_worker import Computed, Loaded
from spherekit.design.sweep import Sweep
from spherekit.errors import DesignError
from spherekit.progress import PATIENCE, tell

PROGRAM = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from spherekit.design.part_worker import work; work()"
)
"""What a worker runs. It finds modules where this process finds them."""

MAX_DEATHS_IN_COMPANY = 2
"""How many processes may end while they compute a part, as others are at work.

The part is then computed when no other process is at work, with all of the memory. More:
a part that needs much memory ends more processes. Fewer: parts wait for the end that a
single accident has hit.
"""

NONE_NEEDED = "workers=1 (--workers 1) needs no other process"


def can_start_workers() -> bool:
    """Return whether this process can start worker processes.

    Frozen programs and those with an embedded interpreter have no Python executable.
    """
    return bool(get_executable()) and not getattr(sys, "frozen", False)


def compute_in_processes(
    sweep: Sweep, folder: str, numbers: Sequence[int], workers: int
) -> Generator[int, None, None]:
    """Yield parts as worker processes finish them.

    A part whose process is ended by the system is computed by another process. No process
    outlives the generator, nor this process, whatever ends it.

    Parameters
    ----------
    sweep
        The sweep.
    folder
        The folder in which parts are written.
    numbers
        The parts.
    workers
        How many processes work at the same time.

    Raises
    ------
    DesignError
        If the sweep cannot be sent to processes, no process can be started, or a part ends
        every process that computes it.
    """
    parcel = _parcel(sweep), folder
    waiting_parts: queue.SimpleQueue[int] = queue.SimpleQueue()
    for number in numbers:
        waiting_parts.put(number)
    deaths = Counter[int]()
    left_over: list[int] = []
    company = _Crew(sweep, parcel, waiting_parts, min(workers, len(numbers)))
    with company:
        for event in company.events():
            if isinstance(event, int):
                yield event
                continue
            deaths[event.number] += 1
            if deaths[event.number] < MAX_DEATHS_IN_COMPANY:
                _tell_death(sweep, event, "another process computes it")
                company.compute_again(event.number)
            else:
                _tell_death(sweep, event, "it is computed again when no other is at work")
                left_over.append(event.number)
    for number in sorted(left_over):
        waiting_parts.put(number)
        with _Crew(sweep, parcel, waiting_parts, 1) as alone:
            for event in alone.events():
                if not isinstance(event, int):
                    raise DesignError(
                        f"{_part_in_words(sweep, number)}: the system ended each of "
                        f"{MAX_DEATHS_IN_COMPANY + 1} processes that computed it "
                        f"({event.cause}), perhaps for want of memory; parts that are "
                        "written stay, and the same command continues; ask for fewer "
                        "samples, or for --workers 1 in less memory"
                    )
                yield event


class _Death:
    """A process that ended while it computed a part, and the `cause` in words."""

    def __init__(self, number: int, status: int) -> None:
        self.number = number
        self.cause = f"exit status {status}"
        if status < 0:
            with suppress(ValueError):
                self.cause = f"signal {-status}, {signal.Signals(-status).name}"


def _part_in_words(sweep: Sweep, number: int) -> str:
    first = number * sweep.part_size
    last = min(first + sweep.part_size, sweep.space.count) - 1
    designs = f"design {first}" if first == last else f"designs {first} to {last}"
    return f"{sweep.mechanism.name}: part {number} ({designs})"


def _tell_death(sweep: Sweep, death: _Death, consequence: str) -> None:
    part = _part_in_words(sweep, death.number)
    tell(f"{part}: its process was ended ({death.cause}); {consequence}", PATIENCE)


def _parcel(sweep: Sweep) -> bytes:
    """Return a sweep as bytes, with what the calling script defines by value.

    Raises
    ------
    DesignError
        If something in it cannot be sent.
    """
    import cloudpickle

    try:
        return cloudpickle.dumps(sweep)  # type: ignore[no-any-return]
    except Exception as fault:
        raise DesignError(
            f"{sweep.mechanism.name}: the sweep cannot be sent to worker processes "
            f"({type(fault).__name__}: {fault}); keep locks, connections and the like out "
            f"of analyses, or ask for one process: {NONE_NEEDED}"
        ) from None


class _Process:
    """A worker process.

    Raises
    ------
    DesignError
        If it cannot be started.
    """

    def __init__(self, sweep: Sweep) -> None:
        self._name = sweep.mechanism.name
        # A process group of its own: Ctrl-C in a terminal goes to all processes of a group,
        # and would end a process that is half started.
        group: dict[str, Any] = {"process_group": 0}
        if os.name == "nt":
            group = {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
        self._python = os.fsdecode(get_executable() or "")
        flag = "-I" if sys.flags.isolated else "-P"  # no modules of the current folder
        command = [self._python, flag, "-c", PROGRAM]
        try:
            self.popen = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **group
            )
        except OSError as fault:
            raise DesignError(
                f"{self._name}: no worker process can be started from {self._python!r} "
                f"({fault.strerror}); {NONE_NEEDED}"
            ) from None
        assert self.popen.stdin is not None and self.popen.stdout is not None
        self._messages = self.popen.stdin
        self._answers = self.popen.stdout

    def load(self, parcel: tuple[bytes, str]) -> None:
        """Let the process load the sweep.

        Raises
        ------
        DesignError
            If it cannot, or it ended by itself.
        """
        answer = self._ask(sys.path) and self._ask(parcel) and self._answer()
        if isinstance(answer, Loaded):
            if answer.fault:
                raise DesignError(
                    f"{self._name}: a worker process cannot load the sweep "
                    f"({answer.fault}); define what it uses in the script itself or in a "
                    f"module that can be imported, or ask for one process: {NONE_NEEDED}"
                )
        elif self.end() >= 0:
            raise DesignError(
                f"{self._name}: a worker process ended as it started (exit status "
                f"{self.popen.returncode}, {self._python!r}), and its own words are "
                f"above; {NONE_NEEDED}"
            )

    def compute(self, number: int) -> Computed | None:
        """Return the answer of the process; None if it has ended."""
        answer = self._answer() if self._ask(number) else None
        return answer if isinstance(answer, Computed) else None

    def end(self) -> int:
        """End the process, if it has not ended, and return its exit status."""
        for pipe in (self._messages, self._answers):
            with suppress(OSError):
                pipe.close()
        return self.popen.wait()

    def _ask(self, message: object) -> bool:
        """Send a message; return whether there is somebody who reads it."""
        try:
            pickle.dump(message, self._messages)
            self._messages.flush()
        except (OSError, ValueError):  # the pipe is broken, or was closed by `end`
            return False
        return True

    def _answer(self) -> Loaded | Computed | None:
        try:
            return pickle.load(self._answers)  # type: ignore[no-any-return]
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            return None  # it ended before its answer, or within it


class _Crew:
    """Some processes that compute parts, each guarded by a thread of this process.

    Leaving the block ends all of them at once.
    """

    def __init__(
        self,
        sweep: Sweep,
        parcel: tuple[bytes, str],
        waiting_parts: "queue.SimpleQueue[int]",
        size: int,
    ) -> None:
        self._sweep = sweep
        self._parcel = parcel
        self._waiting_parts = waiting_parts
        self._events: queue.SimpleQueue[int | _Death | BaseException] = queue.SimpleQueue()
        self._open_parts = waiting_parts.qsize()
        self._is_over = threading.Event()
        self._processes: set[_Process] = set()
        self._threads = [
            threading.Thread(target=self._guard, daemon=True) for _ in range(size)
        ]

    def __enter__(self) -> "_Crew":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        while any(thread.is_alive() for thread in self._threads):
            for process in tuple(self._processes):
                process.popen.kill()
            for thread in self._threads:
                thread.join(0.05)

    def compute_again(self, number: int) -> None:
        """Put a part back among those that wait."""
        self._open_parts += 1
        self._waiting_parts.put(number)

    def events(self) -> Generator[int | _Death, None, None]:
        """Yield the numbers of parts that are written, and the deaths of processes.

        Raises
        ------
        Exception
            The error of a part that cannot be computed.
        """
        while self._open_parts:
            try:
                event = self._events.get(timeout=0.5)  # Windows has no Ctrl-C without
            except queue.Empty:
                continue
            if isinstance(event, BaseException):
                raise event
            self._open_parts -= 1
            yield event

    def _guard(self) -> None:
        """Let one process after another compute parts until all are done."""
        process: _Process | None = None
        try:
            while not self._is_over.is_set():
                try:
                    number = self._waiting_parts.get(timeout=0.05)
                except queue.Empty:
                    continue  # a part may come back whose process ends
                if process is None:
                    process = _Process(self._sweep)
                    self._processes.add(process)
                    process.load(self._parcel)
                answer = process.compute(number)
                if answer is None:
                    self._processes.discard(process)
                    self._events.put(_Death(number, process.end()))
                    process = None
                elif answer.error is not None:
                    self._events.put(answer.error)
                else:
                    self._events.put(answer.number)
        except BaseException as fault:
            self._events.put(fault)
        finally:
            if process is not None:
                self._processes.discard(process)
                process.popen.kill()
                process.end()
