"""Progress reports of long computations to a listener, such as a terminal."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

REPORT_INTERVAL_S = 2.0
"""Time (s) after which a computation reports its progress, for the first time and again.

Larger: fewer reports. Smaller: short computations report too.
"""

SECONDS_PER_MINUTE = 60.0
SECONDS_PER_HOUR = 3600.0

LARGEST_TIME_IN_SMALLER_UNIT = 2.0
"""Times from this number of minutes (or hours) on are stated in minutes (or hours)."""


@dataclass(frozen=True)
class ProgressReport:
    """How far a long computation is; this is what a listener receives.

    Attributes
    ----------
    activity
        The computation in words.
    state
        How far it is, in words, such as ``"120 of 361 samples"``; empty if this is unknown.
    share
        Finished share of the work, from 0 to 1; None if it is unknown.
    remaining_seconds
        Estimated time (s) that the remaining work takes; None if it is unknown.
    """

    activity: str
    state: str = ""
    share: float | None = None
    remaining_seconds: float | None = None

    @property
    def is_finished(self) -> bool:
        """Whether all of the work is done."""
        return self.share is not None and self.share >= 1.0

    @property
    def text(self) -> str:
        """The report in one line."""
        text = f"{self.activity}: {self.state}" if self.state else self.activity
        if self.remaining_seconds is None:
            return text
        return f"{text}, {remaining_time_text(self.remaining_seconds)}"


ProgressListener = Callable[[ProgressReport], object]

_listener: ContextVar[ProgressListener | None] = ContextVar("listener", default=None)


@contextmanager
def progress_listener(listener: ProgressListener | None) -> Iterator[None]:
    """Pass all progress reports within a `with` block to a function.

    Long computations in the block call it with a `ProgressReport` every few seconds. If the
    function is None, progress is not reported.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def remaining_time_text(seconds: float) -> str:
    """Return a remaining time as text, such as ``28 s left`` or ``3.5 min left``."""
    if seconds >= LARGEST_TIME_IN_SMALLER_UNIT * SECONDS_PER_HOUR:
        return f"{_short_number(seconds / SECONDS_PER_HOUR)} h left"
    if seconds >= LARGEST_TIME_IN_SMALLER_UNIT * SECONDS_PER_MINUTE:
        return f"{_short_number(seconds / SECONDS_PER_MINUTE)} min left"
    return f"{seconds:.0f} s left"


def _short_number(number: float) -> str:
    """Return a number with two digits below 10, and otherwise as a whole number."""
    return f"{number:.2g}" if number < 10.0 else f"{number:.0f}"


class ProgressReporter:
    """Reports the progress of one computation every few seconds.

    If the computation states its progress in numbers, the reports also estimate the
    remaining time. The estimate uses the mean speed since the first number was stated. So
    parts that were finished earlier, as in a resumed run, do not distort the speed.

    Parameters
    ----------
    what
        Name of the computation, with which each report begins.
    """

    def __init__(self, what: str) -> None:
        """Count the time to the first report from now on."""
        self.what = what
        self._last_report = time.monotonic()
        # Time (s) and finished work when the first numbers were stated.
        self._first_numbers: tuple[float, float] | None = None
        self._total: float | None = None

    def report_if_due(
        self,
        how_far: Callable[[], str],
        done: float | None = None,
        total: float | None = None,
    ) -> bool:
        """Report the progress to the listener, if the last report is old enough.

        It can be called often, since most calls do nothing.

        Parameters
        ----------
        how_far
            Function that returns the progress in words. It is called only for a report.
        done
            Finished amount of work, in any unit. None if it cannot be stated as a number.
        total
            Whole amount of work in the same unit; None if it is not known.

        Returns
        -------
        Whether it was time for a report.
        """
        now = time.monotonic()
        if done is not None and (self._first_numbers is None or total != self._total):
            # The remaining time is estimated from these numbers. A new total means a new
            # stage of the computation, so the estimate begins again.
            self._first_numbers = (now, done)
            self._total = total
        if now - self._last_report < REPORT_INTERVAL_S:
            return False
        self._last_report = now
        listener = _listener.get()
        if listener is not None:
            share = done / total if done is not None and total else None
            remaining_seconds = self._estimate_remaining_time(now, done, total)
            listener(ProgressReport(self.what, how_far(), share, remaining_seconds))
        return True

    def _estimate_remaining_time(
        self, now: float, done: float | None, total: float | None
    ) -> float | None:
        """Return the time (s) that the rest will take, or None if it cannot be estimated.

        The mean speed since `_first_numbers` is assumed to continue. These are the time and
        the finished work when numbers were first stated for this total.

        Parameters
        ----------
        now
            Present time (s).
        done, total
            Finished and whole amount of work in the same unit, or None.
        """
        if done is None or total is None or self._first_numbers is None:
            return None
        first_time, first_done = self._first_numbers
        if done <= first_done:
            return None
        return (now - first_time) / (done - first_done) * max(total - done, 0.0)


def announce(what: str, expected_seconds: float) -> None:
    """Report the beginning of a computation that cannot report its progress later.

    Parameters
    ----------
    what
        The computation in words.
    expected_seconds
        Expected duration. Nothing is reported if it is less than `REPORT_INTERVAL_S`.
    """
    listener = _listener.get()
    if listener is not None and expected_seconds >= REPORT_INTERVAL_S:
        listener(ProgressReport(what))
