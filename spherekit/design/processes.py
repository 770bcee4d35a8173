"""Processes that compute parts of a sweep and end with the one that asked them to."""

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from traceback import format_exc

from spherekit.errors import SpherekitError

Part = Callable[[int], int]
"""Makes a part by its number, and returns that."""


def made_by(make: Part, numbers: Sequence[int], workers: int) -> Generator[int, None, None]:
    """Yield numbers as processes have made their parts, but those of processes that ended.

    No process outlives the generator, nor this process, whatever ends it.

    Raises
    ------
    Exception
        What `make` raises in a process.
    """
    context, left = get_context("spawn"), deque(numbers)
    with ExitStack() as ended:
        lines: list[Connection] = []
        for _ in range(min(workers, len(left))):
            here, there = context.Pipe()
            process = context.Process(target=_serve, args=(there,), daemon=True)
            with _no_stop():
                process.start()
                ended.callback(_end, process)
            there.close()
            with suppress(OSError):  # it has ended: told below
                here.send(make)
                here.send(left.popleft())
            lines.append(here)
        while lines:
            for line in wait(lines):
                assert isinstance(line, Connection)
                try:
                    answer = line.recv()
                except (EOFError, OSError):
                    lines.remove(line)
                    continue
                if isinstance(answer, Exception):
                    raise answer
                if left:
                    with suppress(OSError):
                        line.send(left.popleft())
                else:
                    lines.remove(line)
                yield answer


def _end(process: BaseProcess) -> None:
    process.kill()
    process.join()


@contextmanager
def _no_stop() -> Iterator[None]:
    """Put off what stops this process, and keep it from processes that are started.

    A terminal sends Ctrl-C to all of them, and one half started would speak of a fault.
    Where any thread takes a signal, its handler is called in the main one.
    """
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    came: list[int] = []
    stops = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    handlers = {x: signal.getsignal(x) for x in stops if callable(signal.getsignal(x))}
    if threading.current_thread() is not threading.main_thread():
        handlers = {}  # it handles none
    resource_tracker.ensure_running()  # it would let go of the mask
    for number in handlers:
        signal.signal(number, lambda number, _: came.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, stops)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for put_off in came:
            signal.raise_signal(put_off)


def _serve(line: Connection) -> None:
    """Make the parts whose numbers come, in a process of its own.

    What makes them comes first: libraries are loaded for it, and the parent may end then.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, [])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # of a line whose other end has gone
        make = line.recv()
        while True:
            line.send(_answer(make, line.recv()))


def _answer(make: Part, number: int) -> int | Exception:
    try:
        return make(number)
    except Exception as problem:
        if not isinstance(problem, SpherekitError):
            problem.add_note(format_exc())
        return problem


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
