"""Work that may take seconds says what it is doing, to whoever listens."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

PATIENCE = 2.0
"""Time (s) after which work says what it is doing, and then again."""

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def progress_listener(listener: Callable[[str], None] | None) -> Iterator[None]:
    """Give what work says within the block to a listener, one text at a time."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


class ProgressReporter:
    """Work that says every few seconds what it is doing and how far it is."""

    def __init__(self, what: str) -> None:
        self.what = what
        self._said = time.monotonic()

    def tell(self, how_far: Callable[[], str]) -> bool:
        """Say so if it is time, and return whether; `how_far` makes the words."""
        if time.monotonic() - self._said < PATIENCE:
            return False
        self._said = time.monotonic()
        listener = _listener.get()
        if listener is not None:
            listener(f"{self.what}: {how_far()}")
        return True


def tell(what: str, seconds: float) -> None:
    """Say what begins and cannot say how far it is, if it will take long enough (s)."""
    listener = _listener.get()
    if listener is not None and seconds >= PATIENCE:
        listener(what)
