"""`spherekit synthesize`: finds sizes for a function that a file describes."""

import shlex
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from spherekit.cli.argument_types import whole_number
from spherekit.cli.completers import complete_toml_files, set_completer
from spherekit.cli.screen_report import ScreenReport
from spherekit.number_text import number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.designs.synthesis import Synthesis

MAX_PRINTED_DESIGNS = 5
"""Largest number of designs that are printed."""

ROUNDING = 1e-12
"""Numbers smaller than this, relative to the largest of their column, print as 0."""

EXAMPLES = """examples:
  # a four-bar whose rocker follows a function
  spherekit synthesize examples/synthesis/function.toml
  # a longer search, and the file of the best mechanism
  spherekit synthesize examples/synthesis/torque.toml --designs 65536 -o found.toml
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit synthesize`.

    This command finds sizes with which a mechanism meets requirements. It evaluates many
    designs, and starts a local optimisation at the best ones.
    """
    synthesis_argument = parser.add_argument(
        "synthesis",
        metavar="SYNTHESIS",
        help=(
            "synthesis file, which states the desired function or the objectives, the "
            "dimensions that may vary, and conditions"
        ),
    )
    set_completer(synthesis_argument, complete_toml_files)
    parser.add_argument(
        "--designs",
        metavar="N",
        type=whole_number,
        default=16384,
        help=(
            "number of designs that are evaluated before the best ones are optimised "
            "(default: 16384)"
        ),
    )
    parser.add_argument(
        "--starts",
        metavar="K",
        type=whole_number,
        default=12,
        help=(
            "number of the best designs from which local optimisations start (default: 12)"
        ),
    )
    parser.add_argument(
        "--seed",
        metavar="K",
        type=whole_number,
        default=0,
        help="seed of the random numbers that choose the first designs (default: 0)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="TOML",
        help="write the mechanism file of the best design here",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit synthesize``: find sizes that meet requirements of a file.

    The best designs are printed. With ``--output`` the mechanism of the best design, number
    0, is written to a file. Returns the exit status 0.
    """
    from spherekit.api.designs import synthesize
    from spherekit.errors import DesignError
    from spherekit.files.mechanism_writer import dump
    from spherekit.storage.atomic_write import check_file

    for name in ("designs", "starts"):
        if getattr(options, name) < 1:
            raise DesignError(f"--{name} {getattr(options, name)}: give at least 1")
    if options.output:
        # A search can take minutes, so the file is checked in advance.
        check_file(options.output)
        if Path(options.output).resolve() == Path(options.synthesis).resolve():
            raise DesignError(
                f"-o {options.output}: is the synthesis file; choose another file"
            )
    result = synthesize(
        options.synthesis, designs=options.designs, starts=options.starts, seed=options.seed
    )
    if options.output:
        dump(result.mechanism(), options.output)
    report = _make_report(result)
    if options.output:
        report.files = f"mechanism of design 0 in {options.output}"
        path = shlex.quote(options.output)
        report.next_steps = [
            (f"spherekit run {path}", "compute its motion and pole axes"),
            (f"spherekit page {path}", "a page on which it moves"),
        ]
    else:
        report.files = "not saved; add -o FILE.toml for the mechanism of design 0"
    report.print(options)
    return 0


def _make_report(result: "Synthesis") -> ScreenReport:
    """Return what is printed: the best designs, and how far each objective fell.

    A synthesis evaluates many designs (choices of sizes) in all their assembly modes (ways
    to assemble the loops). A row is one design in one mode. Local optimisations, which
    minimise the objectives, start from the best rows that meet the conditions.

    With one objective the best designs are printed. With several objectives, designs that
    are evenly spread over the Pareto fronts are printed. Each assembly mode has its own
    front.
    """
    import numpy as np

    synthesis = result.synthesis
    frame = result.frame()
    units = frame.attrs["units"]
    name = synthesis.sweep.mechanism.name
    report = ScreenReport(
        f"{name}: dimensions that minimise {' and '.join(synthesis.minimise)}"
    )
    has_one_objective = len(result.headings) == 1
    if has_one_objective:
        printed_rows = np.arange(min(MAX_PRINTED_DESIGNS, len(frame)))
        title = "Best designs:"
    else:
        spaced = np.linspace(0, len(frame) - 1, MAX_PRINTED_DESIGNS)
        printed_rows = np.unique(spaced.astype(int))
        # One design beats another of the same assembly mode if it is better in all
        # objectives by more than these differences. The front has the designs that no
        # design of the synthesis beats.
        tolerances = " and ".join(f"{value:.2g}" for value in result.tolerance)
        title = (
            f"Pareto front: {counted(len(frame), 'design')}, for none of which a design "
            f"was found that is better in all objectives (by more than {tolerances}):"
        )
    if len(frame) > len(printed_rows):
        title = title.removesuffix(":") + f"; {len(printed_rows)} of {len(frame)}:"
    # A matched column has the error of a design at one point of the desired function. There
    # is a column for each point, which would be too many to print. An objective that is
    # itself a figure of merit has two equal columns, of which only one is printed.
    repeated = [figure for figure in synthesis.minimise if figure in result.figures]
    skipped = {*synthesis.matched, *repeated}
    names = [column for column in frame.columns if column not in skipped]
    # The least value of each objective: among the evaluated rows that meet the conditions
    # (`before`), and after the local optimisation.
    titles = dict(zip(result.headings, synthesis.minimise, strict=True))
    columns = [ScreenColumn("design", "right")]
    for column in names:
        heading = titles.get(column, column)
        unit = units.get(column) or units.get(heading)
        heading = f"{heading} ({unit})" if unit else heading
        columns.append(ScreenColumn(heading, "left" if column == "mode" else "right"))
    # Infinite figures would make all others of their column 0.
    numbers = frame[names].drop(columns="mode").abs().replace(np.inf, np.nan)
    largest_by_column = numbers.max()
    rows = []
    for number in printed_rows:
        row = frame.iloc[number]
        cells = [
            str(row[column])
            if column == "mode"
            else number_text(row[column], error=ROUNDING * float(largest_by_column[column]))
            for column in names
        ]
        rows.append((str(number), *cells))
    report.results.append(ScreenTable(tuple(columns), tuple(rows), title))
    if "match" in synthesis.minimise:
        report.results.append(
            "match is the root mean square of the deviations from the desired function, in "
            f"{synthesis.sweep.angle}."
        )
    least_objectives = result.objectives.min(axis=0)
    for text, before, after in zip(
        synthesis.minimise, result.before, least_objectives, strict=True
    ):
        report.results.append(
            f"{text}: {number_text(after)} after local optimisation, {number_text(before)} "
            "in the best of the designs that were tried first"
        )
    report.results.append(
        f"{counted(result.explored, 'design')} were tried first; their conditions were met "
        f"in {result.feasible} assembly modes. A longer search (--designs) may find better "
        "ones."
    )
    return report
