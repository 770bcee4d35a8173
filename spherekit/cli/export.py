"""`spherekit export`: a mechanism for other programs."""

import argparse
import sys
from pathlib import Path

from spherekit.cli.study import add_lock_argument, with_locks
from spherekit.cli.suggest import mechanisms, suggesting
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
        choices=("model", "mjcf"),
        help="model: its functions for use without it (.npz); mjcf: a MuJoCo model",
    )
    parser.add_argument(
        "-o", "--output", metavar="X", help="file to write (default: NAME.npz, NAME.xml)"
    )
    parser.add_argument("--input", metavar="PAIR", help="the driven pair")
    parser.add_argument(
        "--assembly-mode",
        type=int,
        default=0,
        metavar="N",
        help="assembly mode (default: 0)",
    )
    parser.add_argument(
        "--poles",
        nargs="*",
        metavar="POLE",
        help="model: only these poles, as 3/1 (default: all)",
    )
    parser.add_argument(
        "--tol",
        type=float,
        metavar="T",
        help="model: error of every function, relative to its largest value (default: "
        "1e-13)",
    )
    parser.add_argument(
        "--at",
        type=float,
        metavar="Q",
        help="mjcf: input of the pose, in the angle_unit of the file (default: the start "
        "of its range)",
    )


FLAGS = {"model": ("poles", "tol"), "mjcf": ("at",)}
"""The flags that only one kind of export has."""


def execute(options: argparse.Namespace) -> int:
    """Write the file and say what it holds."""
    from spherekit.files.angles import to_radians
    from spherekit.files.read import angle_unit_of, load
    from spherekit.front.export import export

    for kind, flags in FLAGS.items():
        for flag in flags:
            if kind != options.to and getattr(options, flag) is not None:
                raise OutputError(f"--{flag} does nothing without --to {kind}")
    suffix = {"model": ".npz", "mjcf": ".xml"}[options.to]
    if options.output is not None and Path(options.output).suffix != suffix:
        raise OutputError(
            f"{options.output}: --to {options.to} writes a file named *{suffix}; give it "
            "that ending"
        )
    mechanism = with_locks(load(options.file), options.lock, options.file)
    given = options.at
    made = export(
        mechanism,
        options.output or str(Path(mechanism.name).with_suffix(suffix)),
        input_pair=options.input,
        assembly_mode=options.assembly_mode,
        poles=options.poles,
        tolerance=options.tol,
        at=None if given is None else to_radians(given, angle_unit_of(options.file)),
    )
    if not options.quiet:
        for text in (made.holds, *made.notes):
            print(f"{made.path}: {text}", file=sys.stderr)
    return 0
