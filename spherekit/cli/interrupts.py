"""Signals that end a command: Ctrl-C, ``kill`` and the end of the terminal."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
]
"""The signals that end a command; Windows has no SIGHUP."""


@contextmanager
def raise_on_interrupt(process_ends: bool) -> Iterator[None]:
    """Let signals such as Ctrl-C raise `KeyboardInterrupt` within a `with` block.

    The signals are those in `INTERRUPTS`. The argument of the exception is the number of
    the signal. A signal that was ignored before the block stays ignored. For example, a
    shell lets its background jobs ignore Ctrl-C. In other threads than the main thread, the
    block has no effect, because Python allows signal handlers only there.

    Parameters
    ----------
    process_ends
        Whether the process ends after the block. If so, a signal after the block ends the
        process at once, without an exception. Otherwise the previous handlers are restored.
    """
    former_handlers = {number: signal.getsignal(number) for number in INTERRUPTS}
    handled = [
        number
        for number, handler in former_handlers.items()
        # None: a handler that was not set from Python.
        if handler not in (signal.SIG_IGN, None)
    ]
    try:
        for number in handled:
            signal.signal(number, _raise_interrupt)
    except ValueError:  # raised by `signal.signal` outside the main thread
        handled = []
    try:
        yield
    finally:
        for number in handled:
            # `SIG_DFL` is the default of the system, which ends the process.
            former = signal.SIG_DFL if process_ends else former_handlers[number]
            signal.signal(number, former)


def _raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt` with the number of a signal; a handler of signals."""
    raise KeyboardInterrupt(number)


def interrupt_number(interrupt: KeyboardInterrupt) -> int:
    """Return the number of the signal that raised an exception."""
    return int(interrupt.args[0]) if interrupt.args else signal.SIGINT
