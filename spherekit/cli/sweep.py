"""`spherekit sweep`: figures of merit and result tables of many designs."""

import json
import shlex
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from spherekit.cli.argument_types import whole_number
from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.progress_bar import hide_progress
from spherekit.cli.study_arguments import (
    add_study_arguments,
    add_time_arguments,
    study_from,
)
from spherekit.tables.screen_table import ScreenTable
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.designs.sweep_parts import SweepResult

FIGURES_FOLDER = "_figures"
"""Name of the folder of the figures, in the folder of the sweep.

Programs that read a folder of Parquet files ignore names that begin with an underscore.
"""

EXAMPLES = """examples:
  # the least transmission angle over a grid of two arcs
  spherekit sweep four_bar --vary links.2.arc=10:40:31 --vary links.3.arc=50:90:41 \
-a singularities -o designs
  # all poles and coefficients of each design at each sample
  spherekit sweep four_bar --vary links.2.arc=10:40:31 -a poles --tables -o designs
  # those of a thousand designs that transmit well
  spherekit sweep four_bar --vary links.2.arc=10:40 --vary links.4.arc=30:60 \
--designs 1000 -a singularities --where "least_transmission_angle_43 > 40"
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit sweep`."""
    add_study_arguments(parser)
    add_time_arguments(parser)
    parser.add_argument(
        "--vary",
        metavar="KEY=VALUES",
        action="append",
        required=True,
        help=(
            "a number of the mechanism file, such as links.2.arc, and its values in the "
            "unit of the file: LOW:HIGH:COUNT, a list A,B,C, or LOW:HIGH with "
            "--designs; may be repeated"
        ),
    )
    analysis_argument = parser.add_argument(
        "-a",
        "--analysis",
        metavar="NAME[:key=value,...]",
        action="append",
        help="use the figures of merit of this analysis; may be repeated",
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--reduce",
        metavar="[NAME=]HOW(EXPR)",
        action="append",
        help=(
            "a figure of merit: one number that a reduction (min, max, mean, rms, "
            "range, swing, sum, argmin, argmax, at) computes from the values of an "
            "expression over the motion, such as max(theta_41). range is the largest value "
            "minus the smallest one; swing is the range of an angle, without jumps "
            "of whole turns; at(theta_41, 40deg) is the value at an input of "
            "40 deg. Angles are in rad; may be repeated"
        ),
    )
    parser.add_argument(
        "--tables",
        action="store_true",
        help=(
            "also write all tables of the analyses for every design, into subfolders of "
            "the output folder (-o)"
        ),
    )
    parser.add_argument(
        "--where",
        metavar="A<B",
        action="append",
        help=(
            "keep only designs and assembly modes that meet this comparison (<, <=, > or "
            ">=) of two expressions of columns of the result, such as closes>0.99 (the "
            "loops close at more than 99 %% of the samples); may be repeated"
        ),
    )
    parser.add_argument(
        "--designs",
        metavar="N",
        type=whole_number,
        help=(
            "compute this many designs, spread over the ranges LOW:HIGH, instead of a grid"
        ),
    )
    parser.add_argument(
        "--scheme",
        metavar="NAME",
        help="how --designs are chosen: sobol (default), latin or random",
    )
    parser.add_argument(
        "--seed",
        metavar="K",
        type=whole_number,
        default=0,
        help="seed of the random numbers that --scheme uses (default: 0)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help=(
            "write all rows into this folder as Parquet; run the same command again "
            "to continue an interrupted sweep"
        ),
    )
    parser.add_argument(
        "--figures",
        const="png",
        nargs="?",
        choices=("png", "pdf", "svg"),
        help=(
            "plot the figures of merit against the varied dimensions, and write the plots "
            "into DIR/_figures"
        ),
    )
    parser.add_argument(
        "--workers",
        metavar="N",
        type=whole_number,
        help="number of processes that compute in parallel (default: one for each core)",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="compute the sweep on the Dask cluster whose scheduler has this address",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the rows as JSON, one object per line",
    )


def execute(options: Namespace) -> int:
    """Compute the figures of merit of all designs, and print the best designs.

    A figure of merit is one number for a design and assembly mode, such as its least
    transmission angle. Returns the exit status 0.
    """
    from dataclasses import replace

    from spherekit.api.sweep import perform, sweep_of
    from spherekit.cli.sweep_report import sweep_report
    from spherekit.designs.design_space import DesignSpace, parse_variation
    from spherekit.errors import DesignError
    from spherekit.files.library import find, is_study
    from spherekit.runs.registry import create_analysis
    from spherekit.storage.json_data import finite_or_none

    if options.figures:
        if not options.output:
            raise DesignError("--figures needs an output folder; give -o DIR")
        # Imported here so that a missing library is reported before the sweep.
        import spherekit.display.figures.matplotlib_sdk  # noqa: F401
    if options.tables and not options.output:
        raise DesignError("--tables needs an output folder; give -o DIR")
    study = study_from(options)
    angle_unit = study.mechanism.angle_unit
    variations = []
    for text in options.vary:
        key, equals, values = text.partition("=")
        if not equals:
            raise DesignError(
                f"--vary {text}: write KEY=VALUES, such as links.2.arc=10:40:31"
            )
        variations.append(parse_variation(key.strip(), values, angle_unit))
    sweep = sweep_of(
        study,
        DesignSpace.from_variations(
            variations, options.designs, options.scheme, options.seed
        ),
        options.reduce or (),
        [create_analysis(text, angle_unit) for text in options.analysis or ()],
        source=options.file,
        tables=options.tables,
    )
    sweep = replace(sweep, where=tuple(options.where or ()))
    result = perform(sweep, options.output, options.workers, options.dask)
    if options.json:
        hide_progress()
        for row in result.frame().to_dict("records"):
            record = {
                key: finite_or_none(value) if isinstance(value, float) else value
                for key, value in row.items()
            }
            print(json.dumps(record, ensure_ascii=False))
        if options.figures:
            _write_figures(result, options)
    else:
        report = sweep_report(result)
        # Without numbers there is no table of the best designs, and nothing to draw.
        can_draw = any(isinstance(part, ScreenTable) for part in report.results)
        if options.figures:
            report.files += f"; {_write_figures(result, options)}"
        elif options.output and can_draw:
            words = [*options.words, "--figures"]
            command = (shlex.join(["spherekit", *words]), "draw diagrams of the sweep")
            report.next_steps = [command]
        elif not options.output:
            words = [*options.words, "-o", "DIR"]
            purpose = "save all rows"
            if can_draw:
                words.append("--figures")
                purpose += " and draw diagrams"
            report.next_steps = [(shlex.join(["spherekit", *words]), purpose)]
        if not is_study(find(options.file)):
            name = f"new_{Path(options.file).stem}"
            words = ["spherekit", "new", "mechanism", name, "--like", options.file]
            purpose = "copy the mechanism, to enter the dimensions of the best design"
            report.next_steps.append((shlex.join(words), purpose))
        report.print(options)
    return 0


def _write_figures(result: "SweepResult", options: Namespace) -> str:
    """Draw the figures of a sweep into its folder; return how many there are, and where."""
    from spherekit.display.figures.figure_files import write_figures

    folder = options.output / FIGURES_FOLDER
    paths = write_figures(result.plot(), folder, options.figures)
    return f"{counted(len(paths), 'figure')} in {folder}"
