"""Ctrl-C and the signals to terminate, as one exception at a place that takes it."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def stoppable(to_the_end: bool) -> Iterator[None]:
    """Let these signals end the block by `KeyboardInterrupt`, with the signal's number.

    What is ignored, as Ctrl-C in jobs that a shell has put into the background, stays so.
    One that comes after the block ends the process at once, where it goes on `to_the_end`.
    """
    signals = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in signals}
    taken = [number for number in signals if before[number] not in (signal.SIG_IGN, None)]
    unraisable = sys.unraisablehook
    try:
        signal.signal(signal.SIGINT, before[signal.SIGINT])
    except (ValueError, TypeError):  # not the main thread, or not of Python
        yield
        return

    def lost(what: Any) -> None:
        """Raise again where Python had to drop the exception, as in a finalizer."""
        if isinstance(what.exc_value, KeyboardInterrupt):
            _raise_at(sys._getframe(1), what.exc_value)
        else:
            unraisable(what)

    sys.unraisablehook = lost
    try:
        for number in taken:
            signal.signal(number, _stop)
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL if to_the_end else before[number])
        sys.unraisablehook = unraisable


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise, but not while a library is imported: some take that for a fault of theirs."""
    here = outside = frame
    while frame is not None:
        if "importlib" in frame.f_code.co_filename:
            outside = frame.f_back
        frame = frame.f_back
    if outside is None or outside is here:
        raise KeyboardInterrupt(number)
    _raise_at(outside, KeyboardInterrupt(number))


def _raise_at(frame: FrameType, stop: KeyboardInterrupt) -> None:
    """Raise as soon as what is called in this frame has returned."""

    def raising(*_: Any) -> None:
        sys.settrace(None)
        raise stop

    frame.f_trace = raising
    sys.settrace(lambda *_: None)


def signal_of(stop: KeyboardInterrupt) -> int:
    """Return the number of the signal that stopped a command."""
    return int(stop.args[0]) if stop.args else signal.SIGINT
