"""Progress on the screen: a bar in a terminal, lines without one, nothing with -q."""

import io
import re
from argparse import Namespace

import pytest

from spherekit import progress
from spherekit.cli.main import main, note
from spherekit.cli.progress_bar import progress_on_screen


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


def open_terminal(monkeypatch):
    """Let stderr be a terminal, and let every report be due.

    Tests call this themselves: pytest replaces stderr again after its fixtures.
    """
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    return stream


def report_three_times():
    reporter = progress.ProgressReporter("computing")
    for done in (0, 40, 60):
        reporter.report_if_due(lambda done=done: f"{done} of 100 samples", done, 100)


def test_a_terminal_shows_a_bar_that_is_erased_before_other_output(monkeypatch, capsys):
    terminal = open_terminal(monkeypatch)
    with progress_on_screen(Namespace(quiet=False)):
        report_three_times()
        note(Namespace(quiet=False), "finished")
    text = terminal.getvalue()
    bar, _, end = text.rpartition("finished")
    assert "computing: 60 of 100 samples" in bar
    assert "s left" in bar
    assert "\x1b[2K" in bar.rpartition("60 of 100")[2]  # the line is erased
    assert end == "\n"
    assert capsys.readouterr().out == ""


def shown_lines(text, width):
    """Return the lines that a terminal shows after it has received a text.

    It understands what the progress bar uses: carriage return, line feed, wrapping at
    `width` characters, and the escape sequences A (cursor up) and K (erase the line).
    """
    lines = [[]]  # each line is a list of characters
    row = 0
    column = 0
    for count, command, character in re.findall(
        r"\x1b\[([?0-9;]*)([A-Za-z])|(.|\n)", text, re.S
    ):
        if character == "\r":
            column = 0
        elif character == "\n" or (character and column >= width):
            row += 1
            column = 0
            if row == len(lines):
                lines.append([])
        if character and character not in "\r\n":
            line = lines[row]
            # The cursor can be behind the end of the line; then spaces fill the gap.
            while len(line) <= column:
                line.append(" ")
            line[column] = character
            column += 1
        if command == "A":
            row = max(row - int(count or 1), 0)
        elif command == "K":
            lines[row] = []
    return ["".join(line).rstrip() for line in lines]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_long_text_leaves_nothing_on_the_terminal(monkeypatch, width):
    terminal = open_terminal(monkeypatch)
    monkeypatch.setenv("COLUMNS", str(width))
    with progress_on_screen(Namespace(quiet=False)):
        reporter = progress.ProgressReporter("searching assembly modes")
        for count in range(4):
            reporter.report_if_due(lambda count=count: f"{count} curves found {'x' * 200}")
    text = terminal.getvalue()
    assert "searching" in text
    assert not any(shown_lines(text, width))


def test_messages_stay_on_the_terminal(monkeypatch):
    terminal = open_terminal(monkeypatch)
    with progress_on_screen(Namespace(quiet=False)):
        report_three_times()
        progress.announce("a process has ended", expected_seconds=2.0)
        report_three_times()
    assert "spherekit: a process has ended\n" in terminal.getvalue()


def test_without_a_terminal_progress_is_plain_lines(monkeypatch, capsys):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    with progress_on_screen(Namespace(quiet=False)):
        report_three_times()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "spherekit: computing: 0 of 100 samples"
    assert lines[2].startswith("spherekit: computing: 60 of 100 samples, ")
    assert lines[2].endswith(" s left")


def test_quiet_commands_show_no_progress(monkeypatch):
    terminal = open_terminal(monkeypatch)
    with progress_on_screen(Namespace(quiet=True)):
        report_three_times()
    assert terminal.getvalue() == ""


@pytest.mark.parametrize("kind", ["dumb", "unknown"])
def test_a_terminal_that_cannot_erase_a_line_shows_progress_as_lines(monkeypatch, kind):
    terminal = open_terminal(monkeypatch)
    monkeypatch.setenv("TERM", kind)
    with progress_on_screen(Namespace(quiet=False)):
        report_three_times()
    lines = terminal.getvalue().splitlines()
    assert lines[0] == "spherekit: computing: 0 of 100 samples"
    assert len(lines) == 3


class ClosedPipe(io.StringIO):
    """A stream whose reader has ended."""

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")


def test_a_run_goes_on_if_nobody_reads_its_progress(monkeypatch, capsys):
    """A line that cannot be written is no reason to end the run without results."""
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    monkeypatch.setattr("sys.stderr", ClosedPipe())
    assert main(["run", "four_bar", "--samples", "5"]) == 0
    assert "2 assembly modes" in capsys.readouterr().out


def test_a_note_that_nobody_reads_is_no_error(monkeypatch):
    """The address of a served recording is a note, printed before the run computes."""
    monkeypatch.setattr("sys.stderr", ClosedPipe())
    note(Namespace(quiet=False), "serving at rerun+http://127.0.0.1:9876")
