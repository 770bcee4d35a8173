"""`spherekit export`: a mechanism for other programs."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from spherekit.conventions import listing
from spherekit.errors import OutputError, SolveError

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("file", metavar="FILE", help="path or shipped name")
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
        "--branch", type=int, default=0, metavar="N", help="assembly mode (default: 0)"
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
    from spherekit.files.read import load

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
    mechanism = load(options.file)
    target = options.output or str(Path(mechanism.name).with_suffix(suffix))
    write = _model if options.to == "model" else _mjcf
    text, notes = write(mechanism, target, options)
    if not options.quiet:
        print(f"{target}: {text}", file=sys.stderr)
        for note in notes:
            print(f"{target}: {note}", file=sys.stderr)
    return 0


def _model(
    mechanism: "Mechanism", target: str, options: argparse.Namespace
) -> tuple[str, tuple[str, ...]]:
    """Write stored functions; return what they are, and what they leave out."""
    from spherekit.dynamics.offline import online_model

    accuracy = {} if options.tol is None else {"tolerance": options.tol}
    model = online_model(
        mechanism,
        input_pair=options.input,
        branch=options.branch,
        poles=options.poles,
        **accuracy,
    )
    model.save(target)
    heading = model.heading
    text = (
        f"{len(heading.functions)} functions of {heading.coordinate}, errors up to "
        f"{model.error:.2g} of the largest value of each"
    )
    notes = []
    if mechanism.outputs:
        names = listing(output.name for output in mechanism.outputs)
        notes.append(f"outputs left out: {names}")
    if not mechanism.masses:
        notes.append("no inertia: the mechanism has no masses")
    return text, tuple(notes)


def _mjcf(
    mechanism: "Mechanism", target: str, options: argparse.Namespace
) -> tuple[str, tuple[str, ...]]:
    """Write a MuJoCo model; return what it is, and what it leaves out."""
    import numpy as np

    from spherekit.dynamics.mjcf import left_out, mjcf, rigid_bodies
    from spherekit.files.angles import to_radians, to_text
    from spherekit.files.atomic import write_text
    from spherekit.files.read import angle_unit_of
    from spherekit.motion.motion import Tracer

    tracer = Tracer(mechanism, options.input, options.branch)
    unit = angle_unit_of(options.file)
    q = tracer.range[0] if options.at is None else to_radians(options.at, unit)
    if not np.isfinite(q):
        raise SolveError(f"--at {options.at}: needs a finite number of {unit}")
    where = f"{listing(tracer.inputs)} = {float(to_text(q, unit)):.6g} {unit}"
    motion = tracer.at(np.array([q]))
    if motion.failed[0]:
        raise SolveError(
            f"{mechanism.name}: branch {options.branch} has no configuration at {where}; "
            "give another input with --at"
        )
    made = tracer.mechanism
    write_text(target, mjcf(made, motion.values[0]))
    return f"a MuJoCo model at {where}", left_out(rigid_bodies(made, motion.values[0]))
