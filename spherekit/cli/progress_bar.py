"""Progress of long computations on the screen: a bar in a terminal, otherwise lines.

Progress is written to stderr, so that results on stdout can be redirected.
"""

import os
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from spherekit.escaping import terminal_text
from spherekit.progress import ProgressReport, ProgressReporter, remaining_time_text

if TYPE_CHECKING:
    from rich.progress import Progress, Task

    from spherekit.progress import ProgressListener

BAR_WIDTH = 30
"""Width of the bar in characters, which leaves most of a line to the text."""

REMAINING_TIME_WIDTH = 16
"""Characters that are left to the remaining time and the spaces around the bar."""

DUMB_TERMINALS = ("dumb", "unknown")
"""Values of the variable ``TERM`` of terminals in which `rich` draws no bar."""


class ProgressBar:
    """One line on stderr that shows the activity, a bar and the remaining time.

    The line appears with the first report, which comes a few seconds after the beginning,
    and is erased by `hide`. A message, such as that a process has ended, is a line of its
    own and remains on the screen.
    """

    def __init__(self) -> None:
        """Show nothing until the first report."""
        self._progress: Progress | None = None

    def show(self, report: ProgressReport) -> None:
        """Show a progress report in the bottom line of the terminal.

        Parameters
        ----------
        report
            The activity, its state as text, the finished share (0 to 1, or None) and the
            estimated remaining time.
        """
        if report.is_finished:
            self.hide()
            return
        if not report.state:
            # Such a report has no state of progress, only a message. The bar is hidden
            # while the message is printed as a line that stays on the screen.
            was_shown = self._progress is not None
            self.hide()
            print_progress_line(report)
            if was_shown:
                self._start()
            return
        progress = self._progress or self._start()
        finish_time = None
        if report.remaining_seconds is not None:
            finish_time = time.monotonic() + report.remaining_seconds
        # The terminal would break a longer line, which then could not be erased.
        text = terminal_text(f"{report.activity}: {report.state}")
        text_width = max(progress.console.width - BAR_WIDTH - REMAINING_TIME_WIDTH, 1)
        if len(text) > text_width:
            text = f"{text[: text_width - 1]}…"
        # Without a known share, the bar only moves to and fro.
        total = None if report.share is None else 1.0
        for task_id in progress.task_ids:
            progress.update(
                task_id,
                description=text,
                total=total,
                completed=report.share or 0.0,
                finish_time=finish_time,
                visible=True,
            )

    def hide(self) -> None:
        """Erase the line."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def _start(self) -> "Progress":
        """Start the progress bar, which is invisible until the first report, and return it.

        The bar has a text, a bar and the remaining time. It is drawn on stderr.
        """
        from rich.console import Console
        from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
        from rich.text import Text

        class RemainingTime(ProgressColumn):
            """The estimated remaining time, which decreases between reports."""

            def render(self, task: "Task") -> Text:
                """Return the text of the column."""
                finish_time = task.fields.get("finish_time")
                if finish_time is None:
                    return Text("")
                remaining_seconds = max(finish_time - time.monotonic(), 0.0)
                return Text(remaining_time_text(remaining_seconds))

        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=BAR_WIDTH),
            RemainingTime(),
            console=Console(stderr=True, markup=False, emoji=False, highlight=False),
            transient=True,
            # Do not redirect stdout and stderr: results on stdout may go to a file.
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._progress.add_task("", total=None, visible=False)
        self._progress.start()
        return self._progress


_bar = ProgressBar()


def hide_progress() -> None:
    """Erase the progress bar, if there is one, before something else is printed."""
    _bar.hide()


def print_progress_line(report: ProgressReport) -> None:
    """Print a report of unfinished work as a line of stderr."""
    if report.is_finished:
        return
    # If the program that reads stderr has ended, the computation goes on.
    with suppress(BrokenPipeError):
        print(f"spherekit: {terminal_text(report.text)}", file=sys.stderr, flush=True)


@contextmanager
def progress_on_screen(options: Namespace) -> Iterator[None]:
    """Show the progress of long computations within a `with` block.

    In a terminal a bar is drawn. Lines are printed without a terminal, or if the terminal
    cannot erase a line (``TERM=dumb``). With ``--quiet`` nothing is shown.
    """
    from spherekit.progress import progress_listener

    listener: ProgressListener | None
    if options.quiet:
        listener = None
    elif sys.stderr.isatty() and os.environ.get("TERM", "").lower() not in DUMB_TERMINALS:
        listener = _bar.show
    else:
        listener = print_progress_line
    try:
        # Computations in the block report their progress to this function.
        with progress_listener(listener):
            yield
    finally:
        _bar.hide()


def make_sample_reporter() -> Callable[[int, int], None]:
    """Return a function that reports the progress of a run from time to time.

    The returned function is called with the number of finished samples and the number of
    all samples.
    """
    reporter = ProgressReporter("computing")

    def report_samples(done: int, total: int) -> None:
        """Report how many samples of the total are done, and how long the rest takes."""
        reporter.report_if_due(lambda: f"{done} of {total} samples", done, total)

    return report_samples
