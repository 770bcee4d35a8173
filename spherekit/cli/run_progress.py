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
        return bar(time.monotonic)
    working = ProgressReporter("computing")

    def tell(done: int, total: int) -> None:
        if done < total:
            working.tell(lambda: f"{done} of {total} samples")

    return tell


def bar(now: Callable[[], float]) -> Callable[[int, int], None]:
    """Return what prints how many samples are done, and how long the others will take.

    That follows from those done since the first call; `now` gives seconds.
    """
    started, width = now(), 0
    first: tuple[float, int] | None = None

    def tell(done: int, total: int) -> None:
        nonlocal first, width
        at = now()
        since, before = first = first or (at, done)
        if at - started < 0.5 and done < total:
            return
        filled = BAR * done // total
        text = f"[{'#' * filled + '.' * (BAR - filled)}] {done}/{counted(total, 'sample')}"
        if before < done < total:
            rest = (at - since) * (total - done) / (done - before)
            text += f", {duration(rest)} s left"
        shown, width = text.ljust(width), len(text)
        print(f"\r{shown}", end="\n" * (done == total), file=sys.stderr, flush=True)

    return tell
