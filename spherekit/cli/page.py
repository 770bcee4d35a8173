"""`spherekit page`: a mechanism as one HTML file that any browser opens and moves."""

import shlex
from argparse import ArgumentParser, Namespace
from pathlib import Path

from spherekit.cli.completers import complete_mechanisms, set_completer
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import (
    add_input_argument,
    add_lock_argument,
    mechanism_options,
    with_locks,
)

EXAMPLES = """examples:
  # a page to send to a colleague, who opens it with a double click
  spherekit page four_bar -o four_bar.html
  # other curves, and one slider
  spherekit page stephenson --quantities "theta_*" --vary links.2.arc
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit page`.

    This command writes an HTML page on which the mechanism moves.
    """
    add_input_argument(parser)
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="mechanism: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_mechanisms)
    parser.add_argument(
        "-o",
        "--output",
        metavar="X",
        help="file to write (default: NAME.html)",
    )
    parser.add_argument(
        "--vary",
        nargs="*",
        metavar="KEY",
        help=(
            "numbers of the mechanism file that the page lets you change with a slider, "
            "such as links.2.arc (default: all arcs and angles of links, or, if the file "
            "describes the mechanism by a reference pose, the axes of this pose)"
        ),
    )
    parser.add_argument(
        "--quantities",
        nargs="*",
        metavar="NAME",
        help=(
            "quantities whose curves the page shows, as names or patterns such as "
            "theta_* (default: velocity coefficients of outputs, transmission angles "
            "and, if links have masses, driving torques)"
        ),
    )
    # A configuration curve shows the angles of the mechanism over the input. Two curves can
    # cross where two assembly modes (ways to assemble) meet. A mode is selected by a sign
    # for each dyad (group of two links). Such a sign changes along a smooth curve at a
    # crossing.
    parser.add_argument(
        "--crossings",
        choices=("end", "pass"),
        help=(
            "how an assembly mode continues where two curves of configurations cross. A "
            "dyad (two links) can be assembled in two ways, and its sign selects one of "
            "them. end = the mode keeps the signs of its dyads and leaves its smooth curve "
            "(default); pass = the mode follows its smooth curve, on which the sign of a "
            "dyad changes"
        ),
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit page``: write a mechanism as an HTML page that browsers show.

    By default the page gets the name of the mechanism file. A summary of what the page
    shows is printed. Returns the exit status 0.
    """
    from spherekit.api.page import page
    from spherekit.files.mechanism_reader import load

    file = options.file
    # With ``--lock``, pairs (joints) are locked, and the page shows the changed mechanism.
    mechanism = with_locks(load(file), options.lock) if options.lock else file
    written_page = page(
        mechanism,
        options.output or f"{Path(file).stem}.html",
        vary=options.vary,
        quantities=options.quantities,
        input_pair=options.input,
        # The configurations of an assembly mode (way to assemble the mechanism) form a
        # curve over the input. Where two smooth curves cross, the mode keeps the signs of
        # its dyads ("end"), or follows its smooth curve ("pass").
        crossings=options.crossings or "end",
    )
    # The file and options of this mechanism, for a command that the summary suggests.
    same_mechanism = shlex.join([file, *mechanism_options(options)])
    ScreenReport(
        f"{Path(file).stem}: page for browsers",
        # What the page shows, and what it leaves out.
        results=[written_page.holds, *(f"Note: {text}" for text in written_page.notes)],
        files=f"{written_page.path} (open it in any browser; it needs no network)",
        next_steps=[
            (f"spherekit run {same_mechanism}", "ranges of outputs and velocity ratios"),
            (
                f"spherekit export {same_mechanism} --to js",
                "the formulas as a JavaScript module",
            ),
        ],
    ).print(options)
    return 0
