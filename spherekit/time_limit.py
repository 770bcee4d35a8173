"""Limits of the processor time of searches."""

import time

from spherekit.progress import ProgressReporter


class TimeLimit:
    """A limit of the processor time that a search may use, from its creation on.

    A search computes the most valuable parts first. When the time is used up, it returns
    what it has.

    Parameters
    ----------
    seconds
        Processor time (s); by default without a limit.
    what
        Name of the search, for progress reports.

    Attributes
    ----------
    note
        What was not computed, in words; empty if the time was sufficient.
    """

    def __init__(self, seconds: float = float("inf"), what: str = "search") -> None:
        """Start to measure the processor time."""
        self.seconds = seconds
        self.what = what
        self.note = ""
        self._start = time.process_time()
        self._progress = ProgressReporter(what)

    @property
    def taken(self) -> float:
        """The processor time (s) used until now."""
        return time.process_time() - self._start

    def part(self, share: float, what: str | None = None) -> "TimeLimit":
        """Return a limit for a share of the remaining time, for a part of a search.

        Parameters
        ----------
        share
            Share of the remaining processor time, from 0 to 1.
        what
            Name of the part, if it has progress reports of its own. By default the part
            continues the reports of the whole search.
        """
        remaining = self.seconds - self.taken
        part = TimeLimit(max(0.0, share * remaining), what or self.what)
        if what is None:
            # The part and the whole search share a reporter, which stores the time of its
            # last report. So the reports of both are at least some seconds apart.
            part._progress = self._progress
        return part

    def goes_on(self, doing: str) -> bool:
        """Return whether there is time for the next step, and report it.

        Parameters
        ----------
        doing
            The next step in words, such as ``"slice 3 of 12"``.
        """
        self.report_if_due(doing)
        if self.taken < self.seconds:
            return True
        self.note = f"stopped after {self.seconds:.3g} s of processor time before {doing}"
        return False

    def report_if_due(self, doing: str) -> None:
        """Report the current step (in words) if the last report is some seconds old."""
        self._progress.report_if_due(lambda: f"{doing}, {self.taken:.0f} s")
