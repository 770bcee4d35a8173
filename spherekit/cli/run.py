"""`spherekit run`: runs analyses, with tables to a folder and drawings to a viewer."""

import shlex
import sys
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherekit.cli.argument_types import number, row_count, whole_number
from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import FAILED_ANALYSIS, FAILED_SAMPLES, note, print_json, say
from spherekit.cli.progress_bar import make_sample_reporter
from spherekit.cli.run_report import RunOutput, make_report
from spherekit.cli.screen_report import print_lines
from spherekit.cli.study_arguments import (
    add_study_arguments,
    add_time_arguments,
    mechanism_options,
    study_from,
)
from spherekit.conventions import Facts
from spherekit.tables.table_formats import FORMAT_CHOICES, is_csv
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.runs.contract import AbstractAnalysis
    from spherekit.runs.run_result import RunResult

EXAMPLES = """examples:
  # every pole axis in every assembly mode
  spherekit run four_bar
  # tables and a recording
  spherekit run four_bar -o out --save out/four_bar.rrd
  # two analyses at once
  spherekit run stephenson -a singularities -a poles:only=31
  # a grid of two inputs
  spherekit run five_bar --samples 21x21 -o grid
  # the motion that follows from the loads
  spherekit run four_bar -a eksergian --start q=20deg,dq=60deg/s --duration 10
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit run`."""
    add_study_arguments(parser)
    add_time_arguments(parser)
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        action="append",
        help=(
            "analysis to run; may be repeated (default: those of the study, "
            "otherwise poles)"
        ),
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write the tables into this folder",
    )
    parser.add_argument(
        "--format",
        choices=tuple(FORMAT_CHOICES),
        help=(
            "format of the tables (default: Parquet, plus CSV if it stays below 100 "
            "MB; CSV is about four times larger)"
        ),
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--resume",
        action="store_true",
        help="continue the interrupted run in DIR; start a new run if there is none",
    )
    exclusive.add_argument(
        "--restart",
        action="store_true",
        help="discard the interrupted run in DIR and start again from the beginning",
    )
    parser.add_argument(
        "--deg",
        action="store_true",
        help=(
            "in the tables, write angles, angular rates and angular accelerations in "
            "degrees; quantities per rad are not converted"
        ),
    )
    parser.add_argument(
        "--figures",
        const="png",
        nargs="?",
        choices=("png", "pdf", "svg"),
        help="draw figures into DIR/figures, as png (default), pdf or svg",
    )
    parser.add_argument(
        "--tol",
        metavar="T",
        type=number,
        help=(
            "for a simulation: error tolerance of the integration (default: 1e-9). "
            "Otherwise: largest accepted error of any column; the fastest settings that "
            "meet it are chosen"
        ),
    )
    parser.add_argument(
        "--trade",
        metavar="DIR",
        type=Path,
        action="append",
        help=(
            "use the fastest settings whose errors are at most --tol, according to the "
            "measurements that `spherekit trade -o DIR` has saved in DIR. With this "
            "option, --tol is the largest accepted error of any column, even for a "
            "simulation. For several analyses, repeat the option"
        ),
    )
    parser.add_argument(
        "--engine",
        choices=("auto", "numpy", "compiled"),
        default="auto",
        help=(
            "integrator of a simulation (default: auto, which chooses the one that is "
            "expected to be faster)"
        ),
    )
    parser.add_argument(
        "--verify",
        const=16,
        nargs="?",
        metavar="ROWS",
        type=row_count,
        help=(
            "recompute this many rows (default: 16) with 50 digits, and print the error "
            "of each table column"
        ),
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help=(
            "compute proven bounds for every pole in every row (table proven_poles), and "
            "compare the error bounds of the table `poles` with them"
        ),
    )
    parser.add_argument(
        "--only-needed",
        action="store_true",
        help=(
            "leave out links and pairs that no analysis needs; the assembly modes are "
            "then those of the remaining part"
        ),
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the summary as JSON",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help=(
            "exit with status 3 if any sample failed, --tol was not met, or an error bound "
            "proved to be too small"
        ),
    )
    parser.add_argument(
        "--save",
        metavar="X.rrd",
        type=Path,
        help="write a recording to this file, for the Rerun viewer",
    )
    parser.add_argument(
        "--log-every",
        metavar="K",
        type=whole_number,
        help="record only every K-th sample (default: every sample, or fewer in long runs)",
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--serve",
        const=9876,
        nargs="?",
        metavar="PORT",
        type=whole_number,
        help=(
            "serve the recording to viewers at this network port while the run is in "
            "progress (default: 9876)"
        ),
    )
    exclusive.add_argument(
        "--connect",
        metavar="URL",
        help="send the recording to a viewer that is already open at this address",
    )
    exclusive.add_argument(
        "--view",
        action="store_true",
        help="open the recording in the viewer after the run",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit run``: run analyses and report their results.

    Tables, figures and a recording are written, and the summary is printed. Options are
    checked before the run, since a run may take long.

    Returns
    -------
    The exit status of the command.
    """
    from spherekit.errors import SpherekitError
    from spherekit.runs.study_analyses import make_run_analyses
    from spherekit.storage.atomic_write import check_folder, make_folder

    # The study is the mechanism, its motion, and the folder for the results.
    study = _study(options)
    analyses = make_run_analyses(study, options.analysis or ())
    _check_options(study, options)
    if options.figures:
        # If the drawing library is missing, this import fails before the run begins.
        import spherekit.display.figures.matplotlib_sdk  # noqa: F401
    if options.prove:
        # Proven error bounds were requested. They are not possible for every run: proofs
        # need all links and pairs, and ``--only-needed`` leaves out some of them.
        from spherekit.runs.proven_poles import check_provable

        analysis_names = [analysis.name for analysis in analyses]
        has_all_pairs = not options.only_needed
        check_provable(study.mechanism, analysis_names, has_all_pairs)
    # The folder, if this run creates it. A run that fails removes it if it is still empty.
    new_folder = None
    if study.folder:
        check_folder(study.folder)
        new_folder = None if study.folder.exists() else study.folder
        make_folder(study.folder)
    try:
        result, exceeded_bounds = _run_and_report(study, analyses, options)
    except (SpherekitError, KeyboardInterrupt) as error:
        if new_folder:
            # `rmdir` fails if the folder has saved results, which stay there.
            with suppress(OSError):
                new_folder.rmdir()
        # Add to the message how to continue the run, if a part of it was saved.
        _add_resume_hint(error, study, options)
        raise
    if study.recording and options.view:
        from spherekit.display.rerun.viewer import open_viewer

        note(options, open_viewer(study.recording))
    return _exit_status(result, exceeded_bounds, options.strict)


def _run_and_report(
    study: "Study", analyses: "Sequence[AbstractAnalysis]", options: Namespace
) -> tuple["RunResult", int]:
    """Run a study, print the summary and draw the figures.

    Parameters
    ----------
    study
        The mechanism, its motion, and the folder for the tables.
    analyses
        The analyses to run.
    options
        Values of the arguments of the command.

    Returns
    -------
    The result, and the number of error bounds that the proof of ``--prove`` refutes.
    """
    from spherekit.display.figures.collector import Collector
    from spherekit.runs.runner import run

    with _recorder(options, study) as recorder:
        if options.serve is not None:
            # Viewers may connect during the run, so the address of the recorder is printed
            # before.
            note(options, f"serving at {recorder.url}; open it with: rerun {recorder.url}")
        # A collector keeps the scenes (drawings at all samples) for the figures, and passes
        # them on to the recorder.
        collector = Collector(recorder) if options.figures else None
        # The setting (way to compute, such as an integrator with its tolerance) that meets
        # --tol, and the accuracy of the setting; empty without --tol.
        choice = _setting_for_tolerance(study, analyses, options)
        engine = options.engine
        if choice and choice["setting"].tolerance is not None:  # chosen for a simulation
            study = replace(study, tolerance=choice["setting"].tolerance)
            engine = choice["setting"].integrator
        # What to do with the work of a run that was stopped in the same folder.
        if options.resume:
            unfinished = "resume"
        elif options.restart:
            unfinished = "discard"
        else:
            unfinished = "refuse"
        result = run(
            study,
            analyses,
            folder=study.folder,
            unfinished=unfinished,
            formats=FORMAT_CHOICES.get(options.format),
            engine=engine,
            only_needed=options.only_needed,
            tables=options.prove,
            recorder=collector or recorder,
            log_every=options.log_every,
            progress=make_sample_reporter(),
            **choice,
        )
        figures = ""
        try:
            if collector and study.folder:
                figures = _draw_figures(collector, study.folder, options.figures)
        finally:
            # A figure that fails does not hide the results.
            _print_result(options, study, result, figures)
        exceeded_bounds = _prove_poles(options, study, result) if options.prove else 0
        if options.serve is not None:
            # Ctrl-C may come as soon as the message is printed, before the wait begins.
            with suppress(KeyboardInterrupt):
                note(
                    options,
                    "the run is done, and its recording is still served; stop with Ctrl-C",
                )
                recorder.serve_until_interrupted()
    return result, exceeded_bounds


def _draw_figures(collector: Any, folder: Path, file_format: Any) -> str:
    """Draw the figures of a run into its folder; return how many, and where they are."""
    from spherekit.display.figures.contents import plan_figures
    from spherekit.display.figures.figure_files import write_figures

    figures = plan_figures(collector.scenes(), collector.titles)
    figure_folder = folder / "figures"
    paths = write_figures(figures, figure_folder, file_format)
    return f"{counted(len(paths), 'figure')} in {figure_folder}"


def _exit_status(result: "RunResult", exceeded_bounds: int, is_strict: bool) -> int:
    """Return the exit status of a run: 0, or a number that says that something failed.

    Parameters
    ----------
    result
        The result of the run.
    exceeded_bounds
        Number of error bounds that proved to be too small.
    is_strict
        Whether samples without a result, wrong error bounds and missed tolerances count as
        failures (option ``--strict``).
    """
    if result.failures:
        return FAILED_ANALYSIS
    if not is_strict:
        return 0
    summary = result.summary
    # Each of the two dicts has the number of rows (samples) for each status that occurs.
    # The status of a row without a result is not "OK". NO_POLE is no failure: the two links
    # do not rotate relative to each other.
    statuses = {*summary["status"], *summary["pole_status"]}
    problems = [
        bool(statuses - {"OK", "NO_POLE"}),
        any(analysis["failed_rows"] for analysis in summary["analyses"]),
        exceeded_bounds > 0,
    ]
    if "verified" in summary:
        # Option --verify computes some rows again, with many digits. These columns of the
        # tables differ from the new values by more than rounding can explain.
        wrong_columns = summary["verified"].get("beyond", [])
        problems.append(len(wrong_columns) > 0)
    if "accuracy" in summary:
        # Option --tol states a tolerance for the errors of the results.
        is_tolerance_met = summary["accuracy"]["met"]
        problems.append(not is_tolerance_met)
    if simulation := summary.get("simulation"):
        # "too_fast": no step was short enough, so the solver stopped. Other ends, such as a
        # joint limit or a singularity, are proper results.
        problems += [
            bool(simulation["missed"]),  # the error exceeds the tolerance
            simulation["end"]["kind"] == "too_fast",
        ]
    return FAILED_SAMPLES if any(problems) else 0


def _prove_poles(options: Namespace, study: "Study", result: "RunResult") -> int:
    """Prove bounds of the pole axes of a run, print the outcome and write a table.

    A pole is the instantaneous axis of relative rotation of two links. The proof computes
    each pole with many digits and a proven bound of its error. The axis from the run must
    not be farther from the proven axis than the error bound of the run states. The table is
    written only if the run has a folder.

    Returns
    -------
    The number of error bounds of the run that are too small.
    """
    from spherekit.runs.proven_poles import prove_poles

    motion = result.results["motion"].data["motion"]
    poles = result.results["poles"].data["poles"]
    proven = prove_poles(study.mechanism, motion, poles)
    if options.json:
        # Standard output has the JSON text only.
        note(options, str(proven))
    elif not options.quiet:
        print_lines(str(proven).splitlines())
    if study.folder:
        names = proven.write(
            study.folder,
            study.degrees,
            # The formats of table files, such as CSV; None for the default.
            FORMAT_CHOICES.get(options.format),
            result.summary["mechanism_hash"],
        )
        note(options, f"proven poles in {', '.join(names)}")
    return proven.exceeded


def _print_result(
    options: Namespace, study: "Study", result: "RunResult", figures: str
) -> None:
    """Print the report of a run to stdout, and failed analyses to stderr.

    With ``--json`` the summary is printed as JSON instead of the report.

    Parameters
    ----------
    options
        Values of the command-line arguments.
    study, result
        The mechanism and motion of the run, and its results.
    figures
        How many figures were drawn, and where. Empty without figures.
    """
    from spherekit.runs.analysis_faults import describe_failure

    if options.json:
        print_json(result.summary)
    else:
        output = RunOutput(
            file=options.file,
            words=options.words,
            mechanism_options=mechanism_options(options),
            folder=str(study.folder) if study.folder else None,
            file_names=[path.name for path in result.files],
            is_in_degrees=study.degrees,
            recording=str(study.recording) if study.recording else None,
            figures=figures,
        )
        make_report(result.summary, output).print(options)
    # Let the report appear before the failures.
    sys.stdout.flush()
    for name, why in result.failures.items():
        say(describe_failure(name, why))


def _check_options(study: "Study", options: Namespace) -> None:
    """Raise `AnalysisError` for an option that has no effect without another option.

    An example is ``--resume`` (continue a run) without a folder for the results.
    """
    from spherekit.errors import AnalysisError

    folder = "a folder; give the folder of the run with -o DIR"
    simulation = "a simulation; start one from an initial state with --start"
    recording = "a recording; make one with --save, --serve, --connect or --view"
    # Without --format the tables are Parquet files. Option `--prove` needs such files.
    formats = FORMAT_CHOICES.get(options.format)
    parquet = "Parquet files; leave out --format csv"
    writes_parquet = formats is None or not all(is_csv(name) for name in formats)
    # Each rule: what the option needs, whether the user wrote it, its name, a hint.
    rules = [
        (study.folder, options.resume, "--resume", folder),
        (study.folder, options.restart, "--restart", folder),
        (study.folder, options.format, "--format", "tables; write them with -o DIR"),
        (writes_parquet, options.prove, "--prove", parquet),
        (study.folder, options.figures, "--figures", folder),
        (study.start, options.engine != "auto", "--engine", simulation),
        (
            _makes_recording(options, study),
            options.log_every is not None,
            "--log-every",
            recording,
        ),
    ]
    for requirement, is_given, option, hint in rules:
        if is_given and not requirement:
            raise AnalysisError(f"{option} has no effect without {hint}")


def _add_resume_hint(error: BaseException, study: "Study", options: Namespace) -> None:
    """Add to an error the command that continues the run, if a part of it was saved.

    The hint is a note of the exception, which is printed after its message.

    Parameters
    ----------
    error
        The error that ended the run. If a part of the run was saved, the error has a note
        that says so.
    study
        What the run computes, and its folder.
    options
        Values of the command-line arguments. `words` has the words of the command line.
    """
    from spherekit.runs.run_folder import has_unfinished_work

    has_notes = bool(getattr(error, "__notes__", ()))
    if has_notes and study.folder and has_unfinished_work(study.folder):
        words = [word for word in options.words if word not in ("--resume", "--restart")]
        error.add_note(f"go on with: {shlex.join(['spherekit', *words, '--resume'])}")


def _setting_for_tolerance(
    study: "Study", analyses: "Sequence[AbstractAnalysis]", options: Namespace
) -> Facts:
    """Return the fastest way to compute that meets the tolerance ``--tol``.

    A setting is one way to compute, such as an integrator with its own tolerance. A trade
    is a measurement of the time and error of each setting. The setting is chosen from the
    stored trades that ``--trade`` names. Without ``--trade``, a run of many samples makes
    a trade itself. A run of few samples has the ordinary setting (see `choose`).

    A simulation without ``--trade`` is different: ``--tol`` is the tolerance of its
    integration. Then no setting is chosen.

    Returns
    -------
    Keyword arguments of `run`: ``setting``, and ``accuracy`` with the expected error. Empty
    if no setting is to be chosen.

    Raises
    ------
    AnalysisError
        If ``--trade`` is given without ``--tol``, or together with the ``--engine`` of a
        simulation.
    """
    from spherekit.errors import AnalysisError

    # A simulation starts from a state at t = 0. Only simulations have ``--engine``.
    is_simulation = study.start is not None
    if options.tol is None and options.trade:
        raise AnalysisError(
            "--trade chooses the settings of the run for a tolerance, but none is given; "
            "give it with --tol T"
        )
    if options.trade and is_simulation and options.engine != "auto":
        raise AnalysisError(
            f"--engine {options.engine}: --trade already chooses the engine; leave one "
            "of the two options out"
        )
    if options.tol is None or (is_simulation and not options.trade):
        return {}
    from spherekit.runs.trade_choice import choose, read_stored_trades

    stored_trades = []
    if options.trade:
        stored_trades = read_stored_trades(study, analyses, options.trade)
    setting, accuracy = choose(study, analyses, options.tol, stored_trades)
    return {"setting": setting, "accuracy": accuracy}


def _study(options: Namespace) -> "Study":
    """Return the study (mechanism, motion and outputs) that the command line describes.

    The study is read from a file, and options of the command line replace values of the
    file. With ``--view``, the motion is recorded as an animation, which is then shown.
    Without ``--save``, its file is in the folder of the run, or in a temporary folder.
    """
    fields = {
        "folder": options.output,
        "recording": options.save,
        "tolerance": options.tol,
        "verify": options.verify,
        # Whether result tables have angles in degrees. Without the option `--deg`, None
        # keeps what the file says.
        "degrees": options.deg or None,
    }
    study = study_from(options, fields)
    if options.view and not study.recording:
        folder = study.folder or Path(tempfile.mkdtemp(prefix="spherekit-"))
        study = replace(study, recording=folder / f"{study.mechanism.name}.rrd")
    return study


def _makes_recording(options: Namespace, study: "Study") -> bool:
    """Return whether a recording is made, for a file or for viewers."""
    destinations = (study.recording, options.serve, options.connect)
    return any(destination is not None for destination in destinations)


def _recorder(options: Namespace, study: "Study") -> Any:
    """Return a context manager whose value is the recorder, or None without recording."""
    if not _makes_recording(options, study):
        return nullcontext(None)
    from spherekit.display.rerun.recorder import RerunRecorder

    return RerunRecorder(
        study.mechanism.name,
        path=study.recording,
        port=options.serve,
        url=options.connect,
    )
