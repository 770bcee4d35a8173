"""How far a run is, on stderr."""

import sys
import time
from collections.abc import Callable

from spherekit.cli.run_report import duration
from spherekit.conventions import counted
from spherekit.progress import ProgressReporter

BAR = 30


def progress(quiet: bool) -> Callable[[int, int], None] | None:
    """Return what is told how many samples are done: a line, or words now and then."""
    if quiet:
        return None
    if sys.stderr.isatty():
        return Bar(time.monotonic)
    working = ProgressReporter("computing")

    def tell(done: int, total: int) -> None:
        if done < total:
            working.tell(lambda: f"{done} of {total} samples")

    return tell


class Bar:
    """A line that says how many samples are done, and how long the others will take.

    That follows from those done since the first call; `now` gives seconds.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now, self._started = now, now()
        self._first: tuple[float, int] | None = None
        self._width = 0

    def __call__(self, done: int, total: int) -> None:
        """Print it; `done` of `total` samples are done."""
        now = self._now()
        since, before = self._first = self._first or (now, done)
        if now - self._started < 0.5 and done < total:
            return
        filled = BAR * done // total
        text = f"[{'#' * filled + '.' * (BAR - filled)}] {done}/{counted(total, 'sample')}"
        if before < done < total:
            rest = (now - since) * (total - done) / (done - before)
            text += f", {duration(rest)} s left"
        end = "\n" if done == total else ""
        shown = text.ljust(self._width)
        self._width = len(text)
        print(f"\r{shown}", end=end, file=sys.stderr, flush=True)
