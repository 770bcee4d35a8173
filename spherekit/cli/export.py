"""`spherekit export`: a mechanism for other programs."""

import argparse
import sys
from pathlib import Path

from spherekit.errors import OutputError, SolveError


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
        default=1e-13,
        metavar="T",
        help="model: error of every function, relative to its largest value",
    )
    parser.add_argument(
        "--at",
        type=float,
        metavar="Q",
        help="mjcf: input (rad) of the pose (default: the start of its range)",
    )


def execute(options: argparse.Namespace) -> int:
    """Write the file and say what it holds."""
    import numpy as np

    from spherekit.files.read import load

    suffix = {"model": ".npz", "mjcf": ".xml"}[options.to]
    if options.output is not None and Path(options.output).suffix != suffix:
        raise OutputError(
            f"{options.output}: --to {options.to} writes a file named *{suffix}; give it "
            "that ending"
        )
    mechanism = load(options.file)
    target = options.output or str(Path(mechanism.name).with_suffix(suffix))
    if options.to == "model":
        from spherekit.dynamics.offline import online_model

        model = online_model(
            mechanism,
            input_pair=options.input,
            branch=options.branch,
            poles=options.poles,
            tolerance=options.tol,
        )
        model.save(target)
        heading = model.heading
        text = (
            f"{len(heading.functions)} functions of {heading.coordinate}, errors up to "
            f"{model.error:.2g} of the largest value of each"
        )
    else:
        from spherekit.dynamics.mjcf import mjcf
        from spherekit.files.atomic import write_text
        from spherekit.motion.motion import Tracer

        tracer = Tracer(mechanism, options.input, options.branch)
        q = tracer.range[0] if options.at is None else options.at
        motion = tracer.at(np.array([q]))
        if motion.failed[0]:
            raise SolveError(
                f"{mechanism.name}: branch {options.branch} has no configuration at "
                f"{q:.6g} rad; give another input with --at"
            )
        write_text(target, mjcf(tracer.mechanism, motion.values[0]))
        text = "a MuJoCo model"
    if not options.quiet:
        print(f"{target}: {text}", file=sys.stderr)
    return 0
