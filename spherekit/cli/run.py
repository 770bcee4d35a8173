"""`spherekit run`: analyses over the motion, tables to a folder, scenes to a viewer."""

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
from spherekit.cli.run_report import progress, report
from spherekit.cli.study_arguments import (
    add_study_arguments,
    add_time_arguments,
    study_from,
)
from spherekit.conventions import Facts
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.files.study import Study
    from spherekit.runs.contract import AbstractAnalysis
    from spherekit.runs.run_result import RunResult
    from spherekit.tables.table import Format

FORMATS: dict[str, tuple["Format", ...]] = {
    "both": ("csv", "parquet"),
    "csv": ("csv",),
    "parquet": ("parquet",),
}

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
  spherekit run four_bar -a eksergian --start q=0.3,dq=1 --duration 10
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_study_arguments(parser)
    add_time_arguments(parser)
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        action="append",
        help="analysis to run, may be repeated (default: the study's, or poles)",
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write tables here",
    )
    parser.add_argument(
        "--format",
        choices=("both", "csv", "parquet"),
        help=(
            "which files; by default Parquet, and CSV up to 100 MB, which takes four times "
            "the space"
        ),
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--resume",
        action="store_true",
        help="go on with a run that was stopped in DIR; start, if there is none",
    )
    exclusive.add_argument(
        "--restart",
        action="store_true",
        help="throw away the work of a run that was stopped in DIR, and start",
    )
    parser.add_argument(
        "--deg",
        action="store_true",
        help=(
            "angles in tables, their rates and accelerations in degrees; what is per rad "
            "stays so"
        ),
    )
    parser.add_argument(
        "--figures",
        const="png",
        nargs="?",
        choices=("png", "pdf", "svg"),
        help="draw figures into DIR/figures: png (default), pdf or svg",
    )
    parser.add_argument(
        "--tol",
        metavar="T",
        type=number,
        help=(
            "tolerance of a simulation, default 1e-9; without one, the largest error of "
            "any column, for which the cheapest way to compute is taken"
        ),
    )
    parser.add_argument(
        "--trade",
        metavar="DIR",
        type=Path,
        action="append",
        help=(
            "with --tol: choose by the trade that `spherekit trade -o DIR` wrote for this "
            "run, once for each analysis; of a simulation --tol is then the error of its "
            "tables, and integrator and step tolerance are chosen"
        ),
    )
    parser.add_argument(
        "--engine",
        choices=("auto", "numpy", "compiled"),
        default="auto",
        help="what solves a simulation (--start), default auto: the quicker one",
    )
    parser.add_argument(
        "--verify",
        const=16,
        nargs="?",
        metavar="ROWS",
        type=row_count,
        help=(
            "compute so many rows (default 16) once more in 50 digits and print how far "
            "each table column is off"
        ),
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help=(
            "enclose every pole of every row by proof in a table proven_poles, and check "
            "the error bounds of the table poles against it"
        ),
    )
    parser.add_argument(
        "--only-needed",
        action="store_true",
        help=(
            "leave out links and pairs that no analysis needs; assembly modes are then "
            "those of the part that is left"
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
        help="exit with 3 if any sample failed or --tol is not met",
    )
    parser.add_argument(
        "--save",
        metavar="X.rrd",
        type=Path,
        help="write a recording",
    )
    parser.add_argument(
        "--log-every",
        metavar="K",
        type=whole_number,
        help="one of K samples goes to the recording; default 1, more in long runs",
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--serve",
        const=9876,
        nargs="?",
        metavar="PORT",
        type=whole_number,
        help="serve the recording to viewers while the run goes on",
    )
    exclusive.add_argument(
        "--connect",
        metavar="URL",
        help="stream into a running viewer",
    )
    exclusive.add_argument(
        "--view",
        action="store_true",
        help="open the viewer",
    )


def execute(options: Namespace) -> int:
    """Run, write, and print the summary."""
    from spherekit.errors import SpherekitError
    from spherekit.runs.study_analyses import chosen
    from spherekit.storage.atomic_write import check_folder, make_folder

    study = _wanted(options)
    analyses = chosen(study, options.analysis or ())
    _check_effect(study, options)
    if options.figures:
        import spherekit.display.figures.matplotlib_sdk  # noqa: F401  a missing library is told before the run
    if options.prove:
        from spherekit.runs.proven_poles import check_provable

        check_provable(study.mechanism, [x.name for x in analyses], not options.only_needed)
    made = None
    if study.folder:
        check_folder(study.folder)
        made = None if study.folder.exists() else study.folder
        make_folder(study.folder)
    try:
        result, exceeded = _executed(study, analyses, options)
    except (SpherekitError, KeyboardInterrupt) as stop:
        if made:
            with suppress(OSError):  # there is something in it
                made.rmdir()
        _add_hint(stop, study, options)
        raise
    if study.recording:
        note(options, f"recording in {study.recording}")
        if options.view:
            from spherekit.display.rerun.viewer import open_viewer

            note(options, open_viewer(study.recording))
    return _exit_status(result, exceeded, options.strict)


def _executed(
    study: "Study", analyses: "Sequence[AbstractAnalysis]", options: Namespace
) -> tuple["RunResult", int]:
    """Run, tell and draw; return the result, and how many proven bounds are exceeded."""
    from spherekit.display.figures.collector import Collector
    from spherekit.runs.runner import run

    with _recorder(options, study) as recorder:
        if options.serve is not None:
            # A viewer may come while the run is at work, so its address is said before.
            note(options, f"serving at {recorder.url}; open it with: rerun {recorder.url}")
        collector = Collector(recorder) if options.figures else None
        chosen = _accuracy(study, analyses, options)
        engine = options.engine
        if chosen and chosen["setting"].tolerance is not None:  # of a simulation
            study = replace(study, tolerance=chosen["setting"].tolerance)
            engine = chosen["setting"].integrator
        result = run(
            study,
            analyses,
            folder=study.folder,
            unfinished="resume"
            if options.resume
            else "discard"
            if options.restart
            else "refuse",
            formats=FORMATS.get(options.format),
            engine=engine,
            only_needed=options.only_needed,
            tables=options.prove,
            recorder=collector or recorder,
            log_every=options.log_every,
            progress=progress(),
            **chosen,
        )
        # The summary comes before the figures, so that it is not lost if one of them fails.
        _tell(options, study, result)
        if collector and study.folder:
            from spherekit.display.figures.contents import figures_of
            from spherekit.display.figures.figure_files import write_figures

            figures = figures_of(collector.scenes(), collector.titles)
            folder = study.folder / "figures"
            paths = write_figures(figures, folder, options.figures)
            note(options, f"{counted(len(paths), 'figure')} in {folder}")
        exceeded = _prove(options, study, result) if options.prove else 0
        if options.serve is not None:
            # The interrupt can arrive as soon as the message is printed, before the wait.
            with suppress(KeyboardInterrupt):
                note(options, "the run is done and still served; stop with Ctrl-C")
                recorder.serve_until_interrupted()
    return result, exceeded


def _exit_status(result: "RunResult", exceeded: int, strict: bool) -> int:
    """Return what a run ends with: of samples, proofs and tolerances if it is `strict`."""
    if result.failures:
        return FAILED_ANALYSIS
    summary = result.summary
    simulation = summary.get("simulation")
    lost = simulation and (simulation["missed"] or simulation["end"]["kind"] == "too_fast")
    failed = (
        {*summary["status"], *summary["pole_status"]} - {"OK"}
        or any(item["failed_rows"] for item in summary["analyses"])
        or exceeded
        or summary.get("verified", {}).get("beyond")
        or not summary.get("accuracy", {"met": True})["met"]
        or lost
    )
    return FAILED_SAMPLES if strict and failed else 0


def _prove(options: Namespace, study: "Study", result: "RunResult") -> int:
    """Prove the poles of a run, write and tell; return how many bounds are exceeded."""
    from spherekit.runs.proven_poles import prove_poles

    motion, poles = (result.results[name].data[name] for name in ("motion", "poles"))
    proven = prove_poles(study.mechanism, motion, poles)
    print(proven, file=sys.stderr if options.json else sys.stdout)
    if study.folder:
        hash_ = result.summary["mechanism_hash"]
        names = proven.write(
            study.folder, study.degrees, FORMATS.get(options.format), hash_
        )
        print(f"proven poles in {', '.join(names)}", file=sys.stderr)
    return proven.exceeded


def _tell(options: Namespace, study: "Study", result: "RunResult") -> None:
    """Print the summary to stdout, and what else there is to say to stderr."""
    from spherekit.runs.analysis_faults import failed
    from spherekit.tables.table import COLUMNS

    summary = result.summary
    if study.folder:
        note(
            options,
            f"{counted(len(result.files), 'file')} in {study.folder}, angles in "
            f"{'deg' if study.degrees else 'rad'}; the unit of every column is in "
            f"{COLUMNS}",
        )
    if options.json:
        print_json(summary)
    elif not options.quiet:
        print(report(summary))
    sys.stdout.flush()
    for name, why in result.failures.items():
        say(failed(name, why))
    if not (study.folder or options.json or _records(options, study)):
        note(options, "nothing was written: use -o DIR for tables")
    ended = summary.get("simulation", {}).get("end", {"kind": "time"})
    if ended["kind"] != "time":
        note(
            options,
            f"spherekit: the simulation ended at {ended['t']:.9g} s: "
            f"{ended['reason']}; what was found until then is kept",
        )
    logged = summary.get("recording", {"one_of": 1, "from_sample": 0})
    if logged["one_of"] > 1 or logged["from_sample"] > 0:
        note(
            options,
            f"the recording has one of {counted(logged['one_of'], 'sample')} of each "
            f"assembly mode, from sample {logged['from_sample']} on (--log-every K for "
            "another number)",
        )


def _check_effect(study: "Study", options: Namespace) -> None:
    """Refuse flags that would do nothing without another one.

    Raises
    ------
    AnalysisError
        If there is one.
    """
    from spherekit.errors import AnalysisError

    folder = "a folder: give that of the run with -o"
    simulation = "a simulation: give --start"
    recording = "a recording: give --save, --serve, --connect or --view"
    without = [
        (study.folder, options.resume, "--resume", folder),
        (study.folder, options.restart, "--restart", folder),
        (study.folder, options.format, "--format", "tables: write them with -o DIR"),
        (options.format != "csv", options.prove, "--prove", "Parquet files to read"),
        (study.folder, options.figures, "--figures", folder),
        (study.start, options.engine != "auto", "--engine", simulation),
        (_records(options, study), options.log_every is not None, "--log-every", recording),
    ]
    for needed, given, flag, hint in without:
        if given and not needed:
            raise AnalysisError(f"{flag} does nothing without {hint}")


def _add_hint(error: BaseException, study: "Study", options: Namespace) -> None:
    """Add the command by which a stopped run goes on, if there is one."""
    from spherekit.runs.run_folder import has_unfinished_work

    noted = getattr(error, "__notes__", ())
    if noted and study.folder and has_unfinished_work(study.folder):
        words = [word for word in options.words if word not in ("--resume", "--restart")]
        error.add_note(f"go on with: {shlex.join(['spherekit', *words, '--resume'])}")


def _accuracy(
    study: "Study", analyses: "Sequence[AbstractAnalysis]", options: Namespace
) -> Facts:
    """Return the setting for a tolerance of tables, and what it reaches."""
    from spherekit.errors import AnalysisError

    if options.tol is None and options.trade:
        raise AnalysisError("--trade: say for which tolerance to choose, with --tol T")
    if options.trade and study.start is not None and options.engine != "auto":
        raise AnalysisError(
            f"--engine {options.engine}: the trade chooses it; leave one of --engine and "
            "--trade out"
        )
    if options.tol is None or (study.start is not None and not options.trade):
        return {}
    from spherekit.runs.trade_choice import choose, stored_for

    stored = stored_for(study, analyses, options.trade) if options.trade else []
    setting, accuracy = choose(study, analyses, options.tol, stored)
    return {"setting": setting, "accuracy": accuracy}


def _wanted(options: Namespace) -> "Study":
    """Return the study in which the flags given explicitly replace what the file says."""
    more = {
        "folder": options.output,
        "recording": options.save,
        "tolerance": options.tol,
        "verify": options.verify,
        "degrees": options.deg or None,
    }
    study = study_from(options, more)
    if options.view and not study.recording:
        folder = study.folder or Path(tempfile.mkdtemp(prefix="spherekit-"))
        study = replace(study, recording=folder / f"{study.mechanism.name}.rrd")
    return study


def _records(options: Namespace, study: "Study") -> bool:
    """Return whether a recording is made, for a file or for viewers."""
    wanted = (study.recording, options.serve, options.connect)
    return any(where is not None for where in wanted)


def _recorder(options: Namespace, study: "Study") -> Any:
    if not _records(options, study):
        return nullcontext(None)
    from spherekit.display.rerun.recorder import RerunRecorder

    return RerunRecorder(
        study.mechanism.name,
        path=study.recording,
        port=options.serve,
        url=options.connect,
    )
