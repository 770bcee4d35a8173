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
    """Let Ctrl-C and other `INTERRUPTS` raise `KeyboardInterrupt` within a `with` block.

    The argument of the exception is the number of the signal. A signal that was ignored
    before stays ignored: a shell ignores Ctrl-C in jobs that it runs in the background.
    Outside the main thread, where Python allows no handlers, the block has no effect.

    Parameters
    ----------
    process_ends
        True if the process ends after the block. A signal that arrives after the block then
        ends the process at once. Otherwise the previous handlers are restored.
    """
    former_handlers = {number: signal.getsignal(number) for number in INTERRUPTS}
    handled = [
        number
        for number, handler in former_handlers.items()
        if handler not in (signal.SIG_IGN, None)
    ]
    try:
        for number in handled:
            signal.signal(number, _raise_interrupt)
    except ValueError:  # raised by `signal.signal` outside the main thread
        yield
        return
    try:
        yield
    finally:
        for number in handled:
            former = signal.SIG_DFL if process_ends else former_handlers[number]
            signal.signal(number, former)


def _raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt` with the number of a signal; a handler of signals."""
    raise KeyboardInterrupt(number)


def interrupt_number(interrupt: KeyboardInterrupt) -> int:
    """Return the number of the signal that raised an exception."""
    return int(interrupt.args[0]) if interrupt.args else signal.SIGINT
