"""`spherekit import`: a mechanism file from a MuJoCo model or a URDF."""

import shlex
from argparse import ArgumentParser, Namespace
from pathlib import Path

from spherekit.cli.argument_types import number
from spherekit.cli.screen_report import ScreenReport

EXAMPLES = """examples:
  # a MuJoCo model as a mechanism file
  spherekit import wrist.xml -o wrist.toml
  # axes may miss the centre by 0.1 mm
  spherekit import wrist.urdf --within 1e-4
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit import`.

    This command converts a model of another program to a mechanism file.
    """
    parser.add_argument(
        "model",
        metavar="MODEL",
        help="MuJoCo model (.xml) or robot description (.urdf)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="X",
        help="file to write (default: the name of the model, with the extension .toml)",
    )
    parser.add_argument(
        "--within",
        metavar="METRES",
        type=number,
        help=(
            "largest permitted distance, in metres, between an axis and the common point "
            "of all axes (default: 1e-6 times the size of the model)"
        ),
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit import``: write a mechanism file from a MuJoCo model or URDF.

    In a spherical mechanism all axes meet in one point. The axes of a model may pass this
    point at a distance of up to `options.within` (m); None stands for the default. By
    default the new file gets the name of the model. Its links, pairs and inputs are
    printed. Returns the exit status 0.
    """
    from spherekit.errors import OutputError
    from spherekit.exchange.mechanism_import import import_mechanism
    from spherekit.files.library import STUDY_SUFFIX, is_study
    from spherekit.wording import counted, numbered

    imported = import_mechanism(options.model, within=options.within)
    target = Path(options.output or f"{Path(options.model).stem}.toml")
    if target.suffix != ".toml":
        raise OutputError(
            f"{target}: mechanism files are named *.toml; give it that ending"
        )
    if is_study(target):
        raise OutputError(
            f"{target}: only study files are named *{STUDY_SUFFIX}; choose another name"
        )
    imported.save(target)
    mechanism = imported.mechanism
    file = shlex.quote(str(target))
    ScreenReport(
        f"{options.model}: imported as the mechanism {mechanism.name}",
        results=[
            f"{counted(len(mechanism.links), 'link')}, "
            f"{counted(len(mechanism.pairs), 'pair')}, "
            f"{numbered('input', mechanism.input_pairs)}",
            *(f"Note: {text}" for text in imported.notes),
        ],
        files=str(target),
        next_steps=[
            (f"spherekit validate {file}", "check the mechanism and assemble it"),
            (f"spherekit run {file}", "compute motion and pole axes"),
        ],
    ).print(options)
    return 0
