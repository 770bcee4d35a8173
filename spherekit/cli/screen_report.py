"""What a command prints: question, results, warnings, accuracy, files and next steps.

Every command that computes something fills a `ScreenReport`, so that all commands print
their results in the same order. How the results were computed is printed with ``--verbose``
only.
"""

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from spherekit.cli.progress_bar import hide_progress
from spherekit.escaping import terminal_text
from spherekit.tables.screen_table import ScreenTable

if TYPE_CHECKING:
    from rich.console import Console

PLAIN_WIDTH = 10_000
"""Columns of an output that is not a terminal. Lines and tables are then never broken."""

CELL_DISTANCE = 3
"""Characters between neighbouring columns of a table."""

INDENT = "  "
"""Space before lines and tables that belong to the question above them."""


@dataclass
class ScreenReport:
    """The text that a command prints, by its purpose.

    Attributes
    ----------
    question
        What was asked: the mechanism, its inputs and their ranges, in one line.
    results
        What was found, as lines and tables in the order of their importance.
    warnings
        Faults and failures, each with its cause and its cure.
    accuracy
        One line on the accuracy of the results; empty if there is nothing to say.
    files
        One line on the files that were written, or how to write them.
    next_steps
        Commands that the user may want next, each with a few words on its purpose.
    details
        How the results were computed: numbers of evaluations, methods, times.
    """

    question: str
    results: list[str | ScreenTable] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    accuracy: str = ""
    files: str = ""
    next_steps: list[tuple[str, str]] = field(default_factory=list)
    details: list[str] = field(default_factory=list)

    def print(self, options: Namespace) -> None:
        """Print the report to standard output, unless ``--quiet`` is given.

        Colours are used in a terminal, unless the environment has ``NO_COLOR``.
        """
        if options.quiet:
            return
        console = _console()
        _print_line(console, self.question, style="bold")
        for result in self.results:
            if isinstance(result, ScreenTable):
                print_table(result, console)
            else:
                _print_line(console, INDENT + result)
        for warning in self.warnings:
            _print_line(console, f"Warning: {warning}", style="yellow")
        for label, text in (("Accuracy", self.accuracy), ("Files", self.files)):
            if text:
                _print_line(console, f"{label}: {text}")
        if self.next_steps:
            _print_line(console, "Next:")
            width = max(len(command) for command, _ in self.next_steps)
            for command, purpose in self.next_steps:
                _print_line(console, f"{INDENT}{command:{width}}{INDENT}{purpose}")
        if options.verbose and self.details:
            _print_line(console, "Details:")
            for line in self.details:
                _print_line(console, INDENT + line, style="dim")


def print_table(table: ScreenTable, console: "Console | None" = None) -> None:
    """Print a table with aligned columns to standard output."""
    from rich.padding import Padding
    from rich.segment import Segment, Segments
    from rich.table import Table
    from rich.text import Text

    console = console or _console()
    if table.title:
        _print_line(console, INDENT + table.title)
    screen_table = Table(box=None, padding=(0, CELL_DISTANCE, 0, 0))
    # In a narrow terminal headings are broken first, so that cells stay whole if they fit.
    widths = [
        max((len(row[number]) for row in table.rows), default=0)
        for number in range(len(table.columns))
    ]
    needed_width = len(INDENT) + sum(widths) + CELL_DISTANCE * len(widths)
    cells_fit = needed_width <= console.width
    for column, width in zip(table.columns, widths, strict=True):
        heading = Text(terminal_text(column.heading), style="bold")
        min_width = width if cells_fit else None
        screen_table.add_column(heading, justify=column.align, min_width=min_width)
    for row in table.rows:
        # Texts of files could contain the markup of `rich`, so no cell is markup.
        screen_table.add_row(*(Text(terminal_text(cell)) for cell in row))
    indented_table = Padding(screen_table, (0, 0, 0, len(INDENT)), expand=False)
    for segments in console.render_lines(indented_table, pad=False):
        # The last column ends with spaces, which would be copied with the lines.
        while segments and not segments[-1].text.strip():
            segments.pop()
        if segments:
            last = segments[-1]
            segments[-1] = Segment(last.text.rstrip(), last.style)
        console.print(Segments([*segments, Segment.line()]), end="")


def print_lines(lines: Sequence[str]) -> None:
    """Print lines of text to standard output, broken between words in a terminal only."""
    console = _console()
    for line in lines:
        _print_line(console, line)


def _console() -> "Console":
    """Return the console of standard output; without a terminal it breaks no line."""
    from rich.console import Console

    hide_progress()
    width = None if sys.stdout.isatty() else PLAIN_WIDTH
    return Console(width=width, highlight=False, markup=False, emoji=False)


def _print_line(console: "Console", line: str, style: str = "") -> None:
    """Print one line as it is, without the markup of `rich`."""
    from rich.text import Text

    console.print(Text(terminal_text(line), style=style))
