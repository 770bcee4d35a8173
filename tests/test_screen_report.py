"""The order and the form of what commands print."""

from argparse import Namespace

import pytest

from spherekit.cli.screen_report import ScreenReport
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
    assert degree_range_text(-0.811, 6.283185307179586) == "-46.4669 to 360"
