"""Progress reports of long computations to a listener, such as a terminal."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

REPORT_INTERVAL_S = 2.0
"""Time (s) after which a computation reports its progress, for the first time and again.

Larger: fewer reports. Smaller: short computations report too.
"""

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def progress_listener(listener: Callable[[str], None] | None) -> Iterator[None]:
    """Pass the progress reports within the block to a function, one text at a time.

    With None, no reports are made.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


class ProgressReporter:
    """Reports the progress of one computation every few seconds.

    Parameters
    ----------
    what
        Name of the computation, with which each report begins.
    """

    def __init__(self, what: str) -> None:
        """Count the time to the first report from now on."""
        self.what = what
        self._last_report = time.monotonic()

    def report_if_due(self, how_far: Callable[[], str]) -> bool:
        """Report the progress if the last report is old enough.

        Parameters
        ----------
        how_far
            Function that returns the progress in words. It is called only for a report.

        Returns
        -------
        Whether it was time for a report.
        """
        if time.monotonic() - self._last_report < REPORT_INTERVAL_S:
            return False
        self._last_report = time.monotonic()
        listener = _listener.get()
        if listener is not None:
            listener(f"{self.what}: {how_far()}")
        return True


def announce(what: str, expected_seconds: float) -> None:
    """Report at once a computation whose progress is not known.

    Parameters
    ----------
    what
        The computation in words.
    expected_seconds
        Expected duration. Nothing is reported if it is less than `REPORT_INTERVAL_S`.
    """
    listener = _listener.get()
    if listener is not None and expected_seconds >= REPORT_INTERVAL_S:
        listener(what)
