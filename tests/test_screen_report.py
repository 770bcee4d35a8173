"""The order and the form of what commands print."""

import math
from argparse import Namespace
from pathlib import Path

import pytest

from spherekit.cli.main import main
from spherekit.cli.screen_report import ScreenReport, print_lines
from spherekit.number_text import degree_range_text, degrees_text, number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable

TABLE = ScreenTable(
    (ScreenColumn("mode"), ScreenColumn("swing (deg)", "right")),
    (("0 (+) [red]", "71.3"), ("10 (-)", "-117.8")),
)


def printed(capsys, **options):
    """Return the lines that a report with every part prints."""
    report = ScreenReport(
        question="four_bar: input 21 from 0 to 360 deg",
        results=[TABLE, "All modes were found."],
        warnings=["half of the samples are out of reach; narrow the range"],
        accuracy="positions to 1e-14 rad",
        files="6 files in out",
        next_steps=[("spherekit view out", "the recording")],
        details=["0.3 s"],
    )
    report.print(Namespace(**{"quiet": False, "verbose": False} | options))
    return capsys.readouterr().out.splitlines()


def test_results_come_before_warnings_accuracy_files_and_next_steps(capsys):
    assert printed(capsys) == [
        "four_bar: input 21 from 0 to 360 deg",
        "  mode          swing (deg)",
        "  0 (+) [red]          71.3",
        "  10 (-)             -117.8",
        "  All modes were found.",
        "Warning: half of the samples are out of reach; narrow the range",
        "Accuracy: positions to 1e-14 rad",
        "Files: 6 files in out",
        "Next:",
        "  spherekit view out  the recording",
    ]


def test_details_are_printed_with_verbose_only(capsys):
    assert printed(capsys, verbose=True)[-2:] == ["Details:", "  0.3 s"]


def test_quiet_prints_nothing(capsys):
    assert printed(capsys, quiet=True) == []


def test_long_lines_are_not_broken_without_a_terminal(capsys):
    ScreenReport("x" * 500).print(Namespace(quiet=False, verbose=False))
    assert capsys.readouterr().out == "x" * 500 + "\n"


def in_terminal(monkeypatch, capsys, width, **parts):
    """Return the lines of a report in a terminal of some columns."""
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    ScreenReport("question", **parts).print(Namespace(quiet=False, verbose=False))
    return capsys.readouterr().out.splitlines()


def test_further_lines_of_a_sentence_are_indented(monkeypatch, capsys):
    sentence = "All assembly modes were found at fifteen values of the input."
    lines = in_terminal(monkeypatch, capsys, 40, results=[sentence], warnings=[sentence])
    assert lines[1:] == [
        "  All assembly modes were found at",
        "    fifteen values of the input.",
        "Warning: All assembly modes were found",
        "  at fifteen values of the input.",
    ]


WIDE_TABLE = ScreenTable(
    (
        ScreenColumn("mode"),
        ScreenColumn("least transmission angle at pair 43 (deg)", "right"),
        ScreenColumn("comes to rest near 21 (deg)"),
    ),
    (("0 (p1)", "33.4", "132.09, 332.19"), ("1 (p0)", "33.4", "0.253, 1.69 and 8 more")),
)


@pytest.mark.parametrize("width", [30, 40, 60, 80, 100])
def test_a_narrow_table_keeps_every_word(monkeypatch, capsys, width):
    lines = in_terminal(monkeypatch, capsys, width, results=[WIDE_TABLE])
    assert max(map(len, lines)) <= width
    printed = " ".join(lines).replace(",", "").replace(";", "").split()
    for text in (
        *[column.heading for column in WIDE_TABLE.columns],
        *sum(WIDE_TABLE.rows, ()),
    ):
        for word in text.replace(",", "").split():
            assert word in printed


def test_headings_are_broken_before_cells(monkeypatch, capsys):
    assert in_terminal(monkeypatch, capsys, 65, results=[WIDE_TABLE])[1:] == [
        "  mode         least transmission   comes to rest near 21",
        "           angle at pair 43 (deg)   (deg)",
        "  0 (p1)                     33.4   132.09, 332.19",
        "  1 (p0)                     33.4   0.253, 1.69 and 8 more",
    ]


def test_purposes_are_below_commands_that_leave_no_room(monkeypatch, capsys):
    steps = [("spherekit run four_bar -o DIR --figures", "tables and figures")]
    assert in_terminal(monkeypatch, capsys, 50, next_steps=steps)[2:] == [
        "  spherekit run four_bar -o DIR --figures",
        "      tables and figures",
    ]


def test_a_row_needs_a_cell_for_each_column():
    with pytest.raises(ValueError, match="has 1 cells, the table has 2 columns"):
        ScreenTable(TABLE.columns, (("0",),))


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (-0.0, 0.0, "0"),
        (2e-9, 3e-9, "0"),
        (-2e-9, 1e-9, "-2e-09"),
        (float("nan"), 0.0, "-"),
        (71.293249, 0.0, "71.2932"),
    ],
)
def test_numbers_below_their_error_are_zero(value, error, text):
    assert number_text(value, error) == text


def test_angles_are_rounded_to_what_a_drawing_resolves():
    assert degrees_text(1e-13) == "0"
    assert degrees_text(-1e-13) == "0"


def test_every_finite_angle_has_a_text_in_degrees():
    assert degrees_text(math.radians(5e305)) == "5e+305"
    assert degrees_text(math.radians(-5e305)) == "-5e+305"
    assert degree_range_text(-0.811, 6.283185307179586) == "-46.4669 to 360"


@pytest.mark.slow
@pytest.mark.parametrize("options", [["--lock", "51=60deg"], ["--input", "51"]])
def test_suggested_commands_keep_inputs_and_locked_pairs(capsys, options):
    """Without them a command would analyse another mechanism than the run before it."""
    lock = [] if "--lock" in options else ["--lock", "21=60deg"]
    words = ["run", "five_bar", *options, *lock, "--samples", "5"]
    assert main(words) == 0
    commands = suggested_commands(capsys.readouterr().out)
    assert commands
    for command in commands:
        assert command.partition("five_bar ")[2].startswith(" ".join(options))


def suggested_commands(screen: str) -> list[str]:
    """Return the commands that a screen lists under "Next:"."""
    lines = screen.partition("Next:\n")[2].splitlines()
    return [line.strip().split("  ")[0] for line in lines]


def test_suggested_commands_after_a_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["page", "five_bar", "--lock", "51=60deg"]) == 0
    commands = suggested_commands(capsys.readouterr().out)
    assert commands == [
        "spherekit run five_bar --lock 51=60deg",
        "spherekit export five_bar --lock 51=60deg --to js",
    ]
    assert main([*commands[1].split()[1:], "--quiet"]) == 0
    assert Path("five_bar.mjs").exists()


@pytest.mark.parametrize(
    ("format_name", "files", "first_command"),
    [
        ("c", "four_bar.c (the comment at its head", "cc -O2 -c four_bar.c"),
        ("python", "four_bar.py (the comment at its head", "spherekit page four_bar"),
        ("latex", "four_bar.tex", "pdflatex four_bar.tex"),
        ("mjcf", "four_bar.xml", "python -m mujoco.viewer --mjcf=four_bar.xml"),
    ],
)
def test_an_export_says_how_its_file_is_used(
    tmp_path, monkeypatch, capsys, format_name, files, first_command
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "four_bar", "--to", format_name]) == 0
    screen = capsys.readouterr().out
    assert f"Files: {files}" in screen
    assert suggested_commands(screen)[0] == first_command


def test_a_line_of_any_length_is_not_broken_without_a_terminal(capsys):
    print_lines(["word " * 3000 + "end"])
    assert capsys.readouterr().out.count("\n") == 1


def test_a_run_of_a_study_suggests_no_command_that_refuses_studies(capsys, tmp_path):
    words = ["run", "stephenson_output", "--samples", "3", "-o", str(tmp_path / "tables")]
    assert main(words) == 0
    commands = suggested_commands(capsys.readouterr().out)
    assert commands
    assert all(command.startswith("spherekit run ") for command in commands)
