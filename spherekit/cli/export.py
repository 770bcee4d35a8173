"""`spherekit export`: a mechanism for other programs."""

import shlex
from argparse import ArgumentParser, Namespace

from spherekit.cli.argument_types import number, sample_counts
from spherekit.cli.completers import complete_mechanisms, complete_pairs, set_completer
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import (
    UNIT_RULE,
    add_input_argument,
    add_lock_argument,
    mechanism_options,
    read_angle,
    with_locks,
)

FORMAT_NAMES = {
    "c": "C source",
    "cpp": "C++ header",
    "js": "JavaScript module",
    "python": "Python module",
    "julia": "Julia module",
    "casadi": "CasADi functions",
    "latex": "LaTeX",
    "model": "stored functions",
    "mjcf": "MuJoCo model",
    "coupling": "coupling table",
}
"""The formats of ``--to``, and their names on the screen."""

COMMANDS_FOR_FILE = {
    ".c": ("cc -O2 -c {path}", "compile the functions"),
    ".tex": ("pdflatex {path}", "print the formulas"),
    ".xml": ("python -m mujoco.viewer --mjcf={path}", "open the model in MuJoCo"),
}
"""For each file ending, a command of another program that reads it, and its purpose."""

EXAMPLES = """examples:
  # the formulas of all angles and coefficients as C, with a size as an argument
  spherekit export four_bar --to c --vary links.2.arc
  # functions for use without the mechanism
  spherekit export four_bar --to model -o four_bar.npz
  # a MuJoCo model, posed at 30 deg
  spherekit export four_bar --to mjcf --at 30
  # a table for a controller, in C
  spherekit export four_bar --to coupling --pairs 41 -o four_bar.h
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit export`."""
    add_input_argument(parser)
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="mechanism: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_mechanisms)
    parser.add_argument(
        "--to",
        choices=tuple(FORMAT_NAMES),
        required=True,
        help=(
            "format of the file. c, cpp, js, python, julia, casadi: source code of all "
            "formulas; latex: formulas for papers; model: a reduced model, which stores "
            "pair variables, inertia and poles as Chebyshev series (.npz or source code); "
            "mjcf: a MuJoCo model; coupling: a table of passive angles on a grid of "
            "inputs, for controllers (.csv, .npz or .h)"
        ),
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="X",
        help="file to write (default: NAME.c, NAME.npz and so on)",
    )
    parser.add_argument(
        "--quantities",
        nargs="*",
        metavar="NAME",
        help=(
            "only for source code and latex: quantities to compute, as names or "
            "patterns such as theta_* (default: angles, velocity and acceleration "
            "coefficients of links, transmission angles, inertia, its derivative with "
            "respect to the input, and driving torque)"
        ),
    )
    parser.add_argument(
        "--vary",
        nargs="*",
        metavar="KEY",
        help=(
            "numbers of the mechanism file that become arguments of the functions (source "
            "code) or symbols (latex), such as links.2.arc"
        ),
    )
    parser.add_argument(
        "--assembly-mode",
        metavar="N-or-NAME",
        help=(
            "number or name of the assembly mode (default: all for source code and with "
            "--to coupling, otherwise 0)"
        ),
    )
    parser.add_argument(
        "--crossings",
        choices=("end", "pass"),
        help=(
            "only for source code: how an assembly mode continues where two curves of "
            "configurations cross. A dyad (two links) can be assembled in two ways, and "
            "its sign selects one of them. end = the mode keeps the signs of its dyads and "
            "leaves its smooth curve (default); pass = the mode follows its smooth curve, "
            "on which the sign of a dyad changes"
        ),
    )
    parser.add_argument(
        "--poles",
        nargs="*",
        metavar="POLE",
        help=(
            "only with --to model and --to coupling: poles to include, such as 3/1 for the "
            "pole of links 3 and 1 (default: all for a model with one input, otherwise "
            "none)"
        ),
    )
    pairs_argument = parser.add_argument(
        "--pairs",
        nargs="*",
        metavar="PAIR",
        help=(
            "only with --to coupling: passive pairs (pairs that are not inputs) to include "
            "(default: all)"
        ),
    )
    set_completer(pairs_argument, complete_pairs)
    parser.add_argument(
        "--samples",
        metavar="N[xM...]",
        type=sample_counts,
        help=(
            "only with --to coupling: number of values of each input in the table "
            "(default: as many as --tol needs)"
        ),
    )
    parser.add_argument(
        "--tol",
        metavar="T",
        type=number,
        help=(
            "with --to model: permitted error of each stored function, relative to the "
            "largest value of this function (default: 1e-13; with several inputs 1e-11); "
            "with --to coupling: permitted error of angles, in rad (default: 1e-6)"
        ),
    )
    parser.add_argument(
        "--at",
        metavar="Q[,Q...]",
        help=(
            "only with --to mjcf: values of the inputs at which the model is posed, such "
            "as 30deg (default: the first ones in their ranges at which it can be "
            "assembled); "
            f"{UNIT_RULE}"
        ),
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit export``: write a mechanism in a format of another program.

    What was written is printed. Returns the exit status 0.

    Parameters
    ----------
    options
        Values of the command-line arguments. Without ``output`` the file gets the name of
        the mechanism.
    """
    from spherekit.api.export import SOURCES, SUFFIXES, export
    from spherekit.files.mechanism_reader import load

    mechanism_of_file = load(options.file)
    mechanism = with_locks(mechanism_of_file, options.lock)
    # If no pairs are locked, `export` is given the file. The file has the sizes as the user
    # wrote them, such as 30 deg. The loaded mechanism has them in rad, rounded to floats.
    has_locks = mechanism is not mechanism_of_file
    # Inputs (rad) of the pose in which a MuJoCo model starts.
    inputs_of_pose = None
    if options.at:
        inputs_of_pose = tuple(
            read_angle("--at", text, mechanism.angle_unit) for text in options.at.split(",")
        )
    exported = export(
        mechanism if has_locks else options.file,
        options.output or f"{mechanism.name}{SUFFIXES[options.to][0]}",
        to=options.to,
        input_pair=options.input,
        assembly_mode=options.assembly_mode,
        poles=options.poles,
        pairs=options.pairs,
        samples=options.samples,
        tolerance=options.tol,
        quantities=options.quantities,
        vary=options.vary,
        crossings=options.crossings,
        at=inputs_of_pose,
    )
    path = exported.path
    files = str(path)
    if options.to == "model" and path.suffix == ".npz":
        files += f' (in Python: spherekit.load_reduced("{path}"))'
    elif options.to in SOURCES:
        files += " (the comment at its head lists arguments and results)"
    next_steps = []
    if path.suffix in COMMANDS_FOR_FILE:
        command, purpose = COMMANDS_FOR_FILE[path.suffix]
        next_steps.append((command.format(path=shlex.quote(str(path))), purpose))
    page_words = ["spherekit", "page", options.file, *mechanism_options(options)]
    next_steps.append((shlex.join(page_words), "a page on which the mechanism moves"))
    ScreenReport(
        f"{mechanism.name}: export as {FORMAT_NAMES[options.to]}",
        # What the file contains, and what it leaves out.
        results=[exported.holds, *(f"Note: {text}" for text in exported.notes)],
        files=files,
        next_steps=next_steps,
    ).print(options)
    return 0
