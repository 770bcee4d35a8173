"""`spherekit trade`: the measured speed and accuracy of an analysis's settings."""

import json
import shlex
from argparse import ArgumentParser, Namespace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherekit.cli.argument_types import number, whole_number
from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import (
    add_study_arguments,
    add_time_arguments,
    study_from,
)
from spherekit.tables.screen_table import ScreenColumn, ScreenTable

if TYPE_CHECKING:
    from spherekit.runs.trade_record import Trade

EXAMPLES = """examples:
  # the fastest setting that meets a tolerance
  spherekit trade stephenson --tol 1e-9
  # every setting with its time and error, as files
  spherekit trade four_bar -a eksergian -o traded
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit trade`.

    This command measures the time and error of each setting (one way to compute the tables
    of an analysis), so that the user can choose one.
    """
    add_study_arguments(parser)
    add_time_arguments(parser)
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        help=(
            "analysis whose run time and errors are measured (default: the only analysis "
            "of the study, or poles if it names none)"
        ),
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--tol",
        metavar="T",
        type=number,
        help=(
            "recommend the fastest setting with which the error of every column is below T"
        ),
    )
    parser.add_argument(
        "--rounds",
        metavar="N",
        type=whole_number,
        default=5,
        help=(
            "number of times that every setting is timed; the best time counts (default: 5)"
        ),
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help=(
            "write the results into this folder: trade.csv, trade.json and, if "
            "matplotlib is installed, trade.png"
        ),
    )
    parser.add_argument(
        "--save",
        metavar="X.rrd",
        type=Path,
        help=(
            "save a chart of all settings, with their run times and errors, to this file, "
            "for the Rerun viewer"
        ),
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print all results as JSON",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit trade``: measure the time and error of every setting.

    A setting is one way to compute the tables of an analysis, such as an integrator with a
    tolerance. The results are printed as a table. If the user asks for it, they are also
    written to files, and to a recording for the Rerun viewer. Returns the exit status 0.
    """
    from spherekit.api.trade import trade
    from spherekit.errors import AnalysisError
    from spherekit.runs.registry import create_analysis
    from spherekit.runs.study_analyses import make_study_analyses
    from spherekit.runs.trade_record import check_tolerance

    study = study_from(options)
    if options.tol is not None:
        check_tolerance(study.mechanism.name, options.tol)
    if options.rounds < 1:
        raise AnalysisError(f"--rounds {options.rounds}: give a whole number of at least 1")
    # An analysis on the command line counts. Without one, the analyses that the file of the
    # study names are taken. If it names none, the analysis `poles` is taken.
    analyses = (
        [create_analysis(options.analysis, study.mechanism.angle_unit)]
        if options.analysis
        else make_study_analyses(study)
    )
    if len(analyses) > 1:
        raise AnalysisError(
            f"{options.file}: the study has several analyses; choose one with -a NAME"
        )
    _check_destinations(options)
    result = trade(study, analyses[0], rounds=options.rounds)
    files = []
    if options.output:
        files.append(_write_files(result, options))
    if options.save:
        _write_recording(result, options)
        files.append(f"recording in {options.save}")
    if options.json:
        print_json(result.as_dict(options.tol))
    else:
        report = _make_report(result, options.tol)
        report.files = "; ".join(files) or "not saved; add -o DIR"
        if options.tol is None:
            words = [*options.words, "--tol", "1e-9"]
            command = (
                shlex.join(["spherekit", *words]),
                "recommend the fastest setting with this error",
            )
            report.next_steps = [command]
        report.print(options)
    return 0


def _make_report(result: "Trade", tolerance: float | None) -> ScreenReport:
    """Return the report of a trade: the recommended setting, then all settings.

    A setting is one way to compute the tables of an analysis. A trade has the measured time
    and error of each setting. Without a tolerance no setting is recommended.
    """
    from spherekit.runs.trade_text import (
        ALIGNMENTS,
        HEADINGS,
        MARK_TEXT,
        advise,
        describe_errors,
        list_inapplicable_settings,
        make_heading,
        make_rows,
    )

    report = ScreenReport(make_heading(result))
    if tolerance is not None:
        report.results.append(advise(result, tolerance))
    columns = tuple(
        ScreenColumn(heading, "left" if alignment == "<" else "right")
        for heading, alignment in zip(HEADINGS, ALIGNMENTS, strict=True)
    )
    report.results.append(ScreenTable(columns, tuple(make_rows(result))))
    # Explains the mark "*" of some settings in the table.
    report.results.append(MARK_TEXT)
    report.results += list_inapplicable_settings(result)
    report.accuracy = (
        "errors are absolute, or relative to the largest number of a table (--verbose "
        "says which)"
    )
    report.details = describe_errors(result)
    return report


def _check_destinations(options: Namespace) -> None:
    """Raise an error if a file of the results cannot be written.

    The command ``spherekit trade`` measures the time and error of several ways to compute
    an analysis. This takes minutes, so the files are checked in advance. An existing file
    is replaced only if spherekit wrote it. The check looks for a word that files of
    spherekit contain.
    """
    from spherekit.display.rerun.destination import check_place
    from spherekit.storage.atomic_write import (
        SOFTWARE_MARK,
        check_folder,
        check_made_by_spherekit,
    )

    # A recording, and a folder for tables and a figure.
    if options.save:
        check_place(options.save)
    if options.output:
        check_folder(options.output)
        # `worst_column` is the name of a column in these tables.
        check_made_by_spherekit(options.output / "trade.json", b"worst_column")
        check_made_by_spherekit(options.output / "trade.csv", b"worst_column")
        check_made_by_spherekit(options.output / "trade.png", SOFTWARE_MARK.encode())


def _write_files(result: Any, options: Namespace) -> str:
    """Write the times and errors of all settings as CSV, JSON and a figure.

    A setting is one way to compute the tables of an analysis. JSON and figure mark the
    fastest setting that meets the tolerance `options.tol`, if the user wrote one. The
    figure needs matplotlib. Returns a text that says what was written.
    """
    from spherekit.runs.trade_text import as_csv
    from spherekit.storage.atomic_write import SOFTWARE_MARK, make_folder, write_text

    folder = make_folder(options.output)
    data = json.dumps(result.as_dict(options.tol), indent=2, ensure_ascii=False)
    write_text(folder / "trade.csv", as_csv(result))
    write_text(folder / "trade.json", data + "\n")
    if find_spec("matplotlib") is None:
        command = 'pip install "spherekit-mechanisms[plot]"'
        files = f"2 files, and no figure without matplotlib: {command},"
    else:
        files = "3 files"
        result.plot(options.tol).savefig(
            folder / "trade.png", metadata={"Creator": SOFTWARE_MARK}
        )
    return f"{files} in {folder}"


def _write_recording(result: Any, options: Namespace) -> None:
    """Write the chart of run time against error as a recording for the Rerun viewer."""
    import numpy as np

    from spherekit.display.rerun.recorder import RerunRecorder
    from spherekit.runs.trade_chart import scene
    from spherekit.scenes.recording_head import RecordingHead

    with RerunRecorder(result.mechanism, path=options.save) as recorder:
        recorder.start(RecordingHead())
        recorder.log(scene(result, options.tol), np.arange(1))
