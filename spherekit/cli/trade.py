"""`spherekit trade`: the measured speed and accuracy of an analysis's settings."""

import argparse
import json
import sys
from typing import Any

from spherekit.cli.run import laws_of, sample_counts, start_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "file", metavar="FILE|STUDY", help="mechanism or study: path or shipped name"
    )
    parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        help="the analysis (default: the study's only one, or poles)",
    )
    parser.add_argument(
        "--tol",
        type=float,
        metavar="T",
        help="largest error of any column: the cheapest setting that meets it is named",
    )
    parser.add_argument(
        "--samples",
        type=sample_counts,
        metavar="N[xM...]",
        help="samples of the run that is planned, default 361; settings that pay only for "
        "many samples are recommended for many",
    )
    parser.add_argument("--input", action="append", metavar="PAIR", help="a driven pair")
    parser.add_argument(
        "--law", action="append", metavar="[PAIR=]KIND:...", help="as in run"
    )
    parser.add_argument("--start", metavar="q=Q[,dq=W]", help="as in run: a simulation")
    parser.add_argument("--torque", metavar="EXPR", help="driving torque, with --start")
    parser.add_argument("--duration", type=float, metavar="T", help="time in s, as in run")
    parser.add_argument("--branch", type=int, metavar="N", help="only this branch")
    parser.add_argument(
        "--no-search", action="store_true", help="only the mode of the reference pose"
    )
    parser.add_argument(
        "--rounds",
        type=int,
        default=5,
        metavar="N",
        help="times that every setting is timed, the best counts; default 5",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="write trade.csv, trade.json and trade.svg here",
    )
    parser.add_argument("--save", metavar="X.rrd", help="write a recording of the chart")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")


def execute(options: argparse.Namespace) -> int:
    """Measure, print, and write."""
    from spherekit.analysis.registry import create
    from spherekit.analysis.study import analyses_of
    from spherekit.errors import AnalysisError
    from spherekit.files.study import load_study
    from spherekit.motion.motion import DEFAULT_SAMPLES
    from spherekit.trade.record import check_tolerance
    from spherekit.trade.text import as_text
    from spherekit.trade.trade import trade

    study = load_study(options.file)
    mechanism = study.mechanism
    if options.tol is not None:
        check_tolerance(mechanism.name, options.tol)
    if options.rounds < 1:
        raise AnalysisError(f"--rounds {options.rounds}: give a whole number of at least 1")
    if options.analysis is not None:
        analysis = create(options.analysis)
    else:
        analysis, *others = analyses_of(study)
        if others:
            raise AnalysisError(
                f"{options.file}: names several analyses; say which with -a NAME"
            )
    _check_places(options)
    timed = options.law is not None or options.start is not None
    found = trade(
        mechanism,
        analysis,
        samples=options.samples or study.samples or DEFAULT_SAMPLES,
        input_pair=options.input,
        branch=study.branch if options.branch is None else options.branch,
        search=study.search and not options.no_search,
        path=_path(study, options),
        laws=laws_of(options.law, study) if options.law else {} if timed else study.laws,
        duration=study.duration if options.duration is None else options.duration,
        start=start_of(options.start) if options.start else None if timed else study.start,
        torque=options.torque or (None if timed else study.torque),
        rounds=options.rounds,
    )
    if options.json:
        print(json.dumps(found.as_dict(options.tol), indent=2, ensure_ascii=False))
    else:
        print(as_text(found, options.tol))
    sys.stdout.flush()
    if options.output is not None:
        _write(found, options)
    if options.save is not None:
        _record(found, options)
    return 0


def _path(study: Any, options: argparse.Namespace) -> Any:
    import numpy as np

    if study.path is None or options.samples is not None or options.input is not None:
        return None
    return np.array(study.path)


def _check_places(options: argparse.Namespace) -> None:
    """Refuse what cannot be written before minutes are spent on measuring it."""
    from pathlib import Path

    from spherekit.files.atomic import check_folder
    from spherekit.view.outputs import check_place

    if options.save is not None:
        check_place(Path(options.save))
    if options.output is not None:
        check_folder(options.output)


def _write(found: Any, options: argparse.Namespace) -> None:
    from spherekit.files.atomic import make_folder, write_text
    from spherekit.trade.chart import svg
    from spherekit.trade.text import as_csv

    folder = make_folder(options.output)
    data = json.dumps(found.as_dict(options.tol), indent=2, ensure_ascii=False)
    write_text(folder / "trade.csv", as_csv(found))
    write_text(folder / "trade.json", data + "\n")
    write_text(folder / "trade.svg", svg(found, options.tol))
    if not options.quiet:
        print(f"3 files in {folder}", file=sys.stderr)


def _record(found: Any, options: argparse.Namespace) -> None:
    from pathlib import Path

    import numpy as np

    from spherekit.trade.chart import scene
    from spherekit.view.rerun_view import Recorder

    with Recorder(found.mechanism, path=Path(options.save)) as recorder:
        recorder.start([], None)
        recorder.log(scene(found, options.tol), np.arange(1))
    if not options.quiet:
        print(f"recording in {options.save}", file=sys.stderr)
