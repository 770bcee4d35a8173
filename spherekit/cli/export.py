"""`spherekit export`: a mechanism for other programs."""

import argparse
import sys
from pathlib import Path

from spherekit.cli.study import (
    add_input_argument,
    add_lock_argument,
    sample_counts,
    with_locks,
)
from spherekit.cli.suggest import mechanisms, pairs, suggesting
from spherekit.errors import OutputError

EXAMPLES = (
    (
        "spherekit export four_bar --to model -o four_bar.npz",
        "functions for use without the mechanism",
    ),
    (
        "spherekit export four_bar --to mjcf --at 30",
        "a MuJoCo model, posed at 30 deg",
    ),
    (
        "spherekit export four_bar --to coupling --pairs 41 -o four_bar.h",
        "a table for a controller, in C",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    suggesting(
        parser.add_argument("file", metavar="FILE", help="path or shipped name"), mechanisms
    )
    add_lock_argument(parser)
    parser.add_argument(
        "--to",
        required=True,
        choices=("model", "mjcf", "coupling"),
        help="model: its functions for use without it (.npz); mjcf: a MuJoCo model; "
        "coupling: a table for controllers (.csv, .npz or .h)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="X",
        help="file to write (default: NAME.npz, NAME.xml, NAME.csv)",
    )
    add_input_argument(parser)
    parser.add_argument(
        "--assembly-mode",
        metavar="N",
        help="assembly mode, by number or name (default: 0; coupling: all)",
    )
    _add_arguments_of_kinds(parser)


def _add_arguments_of_kinds(parser: argparse.ArgumentParser) -> None:
    """Declare what only some of the kinds of files are asked with."""
    parser.add_argument(
        "--poles",
        nargs="*",
        metavar="POLE",
        help="model, coupling: only these poles, as 3/1 (default: all; coupling, and "
        "model of several inputs: none)",
    )
    suggesting(
        parser.add_argument(
            "--pairs",
            nargs="*",
            metavar="PAIR",
            help="coupling: only these passive pairs (default: all)",
        ),
        pairs,
    )
    parser.add_argument(
        "--samples",
        type=sample_counts,
        metavar="N[xM...]",
        help="coupling: nodes along each input (default: as many as --tol needs)",
    )
    parser.add_argument(
        "--tol",
        type=float,
        metavar="T",
        help="model: error of every function, relative to its largest value (default: "
        "1e-13, of several inputs 1e-11); coupling: error of angles, rad (default: 1e-6)",
    )
    parser.add_argument(
        "--at",
        type=numbers,
        metavar="Q[,Q...]",
        help="mjcf: inputs of the pose, in the angle_unit of the file (default: the first "
        "on the way through their ranges)",
    )


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a list with commas."""
    values = []
    for part in text.split(","):
        try:
            values.append(float(part))
        except ValueError:
            raise argparse.ArgumentTypeError(f"{part!r} is not a number") from None
    return tuple(values)


def execute(options: argparse.Namespace) -> int:
    """Write the file and say what it holds."""
    from spherekit.files.read import angle_unit_of, load
    from spherekit.files.units import to_radians
    from spherekit.front.export import OWN, SUFFIXES, export

    for name, kinds in OWN.items():
        flag = "tol" if name == "tolerance" else name
        if options.to not in kinds and getattr(options, flag) is not None:
            raise OutputError(
                f"--{flag} does nothing without --to {' or --to '.join(kinds)}"
            )
    endings = SUFFIXES[options.to]
    if options.output is not None and Path(options.output).suffix not in endings:
        raise OutputError(
            f"{options.output}: --to {options.to} writes a file named "
            f"*{' or *'.join(endings)}; give it that ending"
        )
    mechanism = with_locks(load(options.file), options.lock, options.file)
    unit = angle_unit_of(options.file)
    made = export(
        mechanism,
        options.output or f"{mechanism.name}{endings[0]}",
        to=options.to,
        input_pair=options.input,
        assembly_mode=options.assembly_mode,
        poles=options.poles,
        pairs=options.pairs,
        samples=options.samples,
        tolerance=options.tol,
        at=options.at and tuple(to_radians(angle, unit) for angle in options.at),
    )
    if not options.quiet:
        for text in (made.holds, *made.notes):
            print(f"{made.path}: {text}", file=sys.stderr)
    return 0
