"""What a command prints: question, results, warnings, accuracy, files and next steps.

Every command that computes something fills a `ScreenReport`, so that all commands print
their results in the same order. How the results were computed is printed with ``--verbose``
only.
"""

import os
import sys
import textwrap
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from spherekit.cli.progress_bar import hide_progress
from spherekit.escaping import terminal_text
from spherekit.tables.screen_table import ScreenTable, row_sentences

if TYPE_CHECKING:
    from rich.console import Console

PLAIN_WIDTH = sys.maxsize
"""Width, in characters, of an output that is no terminal. Its lines are never broken."""

CELL_DISTANCE = 3
"""Characters between neighbouring columns of a table."""

INDENT = "  "
"""Space before lines and tables of results, which are below the question they answer."""


@dataclass
class ScreenReport:
    """The text that a command prints on the screen, in parts that are printed in order.

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
        How the results were computed: numbers of evaluations, methods, times. Printed with
        ``--verbose`` only.
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
            _print_commands(console, self.next_steps)
        if options.verbose and self.details:
            _print_line(console, "Details:")
            for line in self.details:
                _print_line(console, INDENT + line, style="dim")


def print_table(table: ScreenTable, console: "Console | None" = None) -> None:
    """Print a table with aligned columns to standard output.

    In a narrow terminal, headings are broken into several lines first, then cells. If even
    single words are too wide, each row is printed as a paragraph.
    """
    from rich.text import Text

    console = console or _console()
    if table.title:
        _print_line(console, INDENT + table.title)
    headings = [terminal_text(column.heading) for column in table.columns]
    # Texts of files could contain the markup of `rich`, so no cell is markup.
    rows = [[terminal_text(cell) for cell in row] for row in table.rows]
    available_width = console.width - len(INDENT) - CELL_DISTANCE * (len(headings) - 1)
    widths = _column_widths(headings, rows, available_width)
    if widths is None:
        for sentence in row_sentences(table):
            _print_line(console, INDENT + sentence)
        return
    alignments = [column.align for column in table.columns]
    for line in _row_lines(headings, widths, alignments):
        console.print(Text(line, style="bold"), no_wrap=True, crop=False)
    for row in rows:
        for line in _row_lines(row, widths, alignments):
            console.print(Text(line), no_wrap=True, crop=False)


def _column_widths(
    headings: Sequence[str], rows: Sequence[Sequence[str]], available_width: int
) -> list[int] | None:
    """Return the width of each column of a table, so that the table fits the terminal.

    The result is None if the table does not fit even with one word per line.

    Parameters
    ----------
    headings
        Text above each column.
    rows
        For each row the text of each cell.
    available_width
        Largest sum of the widths, in characters.
    """
    # Break headings first, into as few lines as possible.
    most_words = max([1, *(len(heading.split()) for heading in headings)])
    widths: list[int] = []
    for heading_lines in range(1, most_words + 1):
        widths = _widths_with_whole_cells(headings, rows, heading_lines)
        if sum(widths) <= available_width:
            return widths
    # The table is still too wide. Break cells, too, beginning with the widest column.
    least_widths = _longest_words(headings, rows)
    if sum(least_widths) > available_width:
        return None
    while sum(widths) > available_width:
        breakable_columns = [
            number for number, width in enumerate(widths) if width > least_widths[number]
        ]
        widest = max(breakable_columns, key=lambda number: widths[number])
        widths[widest] -= 1
    return widths


def _widths_with_whole_cells(
    headings: Sequence[str], rows: Sequence[Sequence[str]], heading_lines: int
) -> list[int]:
    """Return the least width of each column if headings may be broken, but cells not.

    The caller allows more and more lines for the headings, until the table fits the
    terminal.

    Parameters
    ----------
    headings
        Text above each column.
    rows
        For each row the text of each cell.
    heading_lines
        Largest number of lines into which a heading may be broken.
    """
    widths: list[int] = []
    for number, heading in enumerate(headings):
        width = _width_for_lines(heading, heading_lines)
        widths.append(max([width, *(len(row[number]) for row in rows)]))
    return widths


def _longest_words(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[int]:
    """Return the length of the longest word of each column, at least 1.

    A heading counts too. Words are not broken, so this is the least width of the column.
    """
    lengths: list[int] = []
    for number, heading in enumerate(headings):
        words = heading.split()
        for row in rows:
            words += row[number].split()
        lengths.append(max([1, *(len(word) for word in words)]))
    return lengths


def _width_for_lines(text: str, line_count: int) -> int:
    """Return the least width at which a text, broken between words, has few lines."""
    width = max((len(word) for word in text.split()), default=0)
    while len(_broken(text, width)) > line_count:
        width += 1
    return width


def _row_lines(
    cells: Sequence[str], widths: Sequence[int], alignments: Sequence[str]
) -> list[str]:
    """Return the lines of a row of a table, without spaces at their ends."""
    columns = [_broken(cell, width) for cell, width in zip(cells, widths, strict=True)]
    lines = []
    for number in range(max(map(len, columns), default=0)):
        texts = []
        for column, width, align in zip(columns, widths, alignments, strict=True):
            text = column[number] if number < len(column) else ""
            texts.append(text.rjust(width) if align == "right" else text.ljust(width))
        lines.append((INDENT + (" " * CELL_DISTANCE).join(texts)).rstrip())
    return lines


def _broken(text: str, width: int) -> list[str]:
    """Return a text in lines of at most a width, broken between words only."""
    if len(text) <= width:
        return [text]  # with all its spaces
    return textwrap.wrap(
        text, max(width, 1), break_long_words=False, break_on_hyphens=False
    ) or [""]


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
    # Without a system of colours, `rich` prints no bold text either.
    color_system: Literal["auto"] | None = None if os.environ.get("NO_COLOR") else "auto"
    return Console(
        width=width, color_system=color_system, highlight=False, markup=False, emoji=False
    )


def _print_line(console: "Console", line: str, style: str = "") -> None:
    """Print one line of a report, broken between words if the terminal is too narrow.

    Further lines are indented more than the first one. The whole line is printed in the
    style, such as "bold". Markup in the line, such as "[bold]", is printed as it is.
    """
    from rich.text import Text

    text = terminal_text(line)
    indent = " " * (len(text) - len(text.lstrip(" ")))
    if len(text) > console.width > len(indent) + len(INDENT):
        wrapped = textwrap.wrap(
            text,
            console.width,
            subsequent_indent=indent + INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
    else:
        wrapped = [text]
    for part in wrapped:
        console.print(Text(part, style=style), crop=False, soft_wrap=True)


def _print_commands(console: "Console", commands: Sequence[tuple[str, str]]) -> None:
    """Print commands, with their purposes beside them or, in a narrow terminal, below."""
    width = max(len(command) for command, _ in commands)
    fits = all(
        len(INDENT) + width + len(INDENT) + len(purpose) <= console.width
        for _, purpose in commands
    )
    for command, purpose in commands:
        if fits:
            _print_line(console, f"{INDENT}{command:{width}}{INDENT}{purpose}")
        else:
            # The terminal breaks a longer command itself, so that it can be copied.
            console.print(terminal_text(INDENT + command), soft_wrap=True)
            _print_line(console, f"{INDENT * 3}{purpose}")
