"""`spherekit synthesize`: sizes for a wanted function, from a file."""

import sys
from argparse import ArgumentParser, Namespace

from spherekit.cli.argument_types import whole_number
from spherekit.cli.completers import complete_toml_files, set_completer
from spherekit.cli.main import note
from spherekit.wording import counted, with_units

EXAMPLES = """examples:
  # a four-bar whose rocker follows a function
  spherekit synthesize examples/synthesis/function.toml
  # a longer search, and the file of the best mechanism
  spherekit synthesize examples/synthesis/torque.toml --designs 65536 -o found.toml
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    synthesis_argument = parser.add_argument(
        "synthesis",
        metavar="SYNTHESIS",
        help="file of what is wanted",
    )
    set_completer(synthesis_argument, complete_toml_files)
    parser.add_argument(
        "--designs",
        metavar="N",
        type=whole_number,
        default=16384,
        help="designs that are looked at first; default 16384",
    )
    parser.add_argument(
        "--starts",
        metavar="K",
        type=whole_number,
        default=12,
        help="from how many of the best the objective is followed down; default 12",
    )
    parser.add_argument(
        "--seed",
        metavar="K",
        type=whole_number,
        default=0,
        help="of the designs; default 0",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="TOML",
        help="write the file of the best mechanism here",
    )


SHOWN = 5
"""Designs that are printed."""


def execute(options: Namespace) -> int:
    """Find sizes, and print the best designs."""
    import numpy as np

    from spherekit.api.designs import synthesize
    from spherekit.errors import DesignError
    from spherekit.files.mechanism_writer import dump

    for name in ("designs", "starts"):
        if getattr(options, name) < 1:
            raise DesignError(f"--{name} {getattr(options, name)}: give at least 1")
    sized = synthesize(
        options.synthesis, designs=options.designs, starts=options.starts, seed=options.seed
    )
    if options.output:
        dump(sized.mechanism(), options.output)
    if not options.quiet:
        frame = sized.frame()
        print(
            f"{sized.synthesis.sweep.mechanism.name}: {counted(sized.explored, 'design')} "
            f"looked at, conditions held in {counted(sized.feasible, 'row')}"
        )
        for name, text, before, after in zip(
            sized.headings,
            sized.synthesis.minimise,
            sized.before,
            sized.objectives.min(axis=0),
            strict=True,
        ):
            print(
                f"{name}: {text}, the least there {before:.6g}, after descents {after:.6g}"
            )
        if len(sized.headings) > 1:
            least = " and ".join(f"{value:.2g}" for value in sized.tolerance)
            print(
                f"{counted(len(sized.objectives), 'design')} that none met beats, of their "
                f"mode, in all objectives by more than {least}:"
            )
        hidden = [name for name in frame.columns if name in sized.synthesis.matched]
        few = np.unique(np.linspace(0, len(frame) - 1, SHOWN).astype(int))
        rows = slice(SHOWN) if len(sized.headings) == 1 else few
        shown = frame.drop(columns=hidden).iloc[rows]
        shown.columns = with_units(shown.columns, frame.attrs["units"])
        print(shown.to_string(index=False, float_format="%.8g"))
        if len(frame) > SHOWN:
            print(f"... {counted(len(frame) - SHOWN, 'more design')}")
    sys.stdout.flush()
    if options.output:
        note(options, f"the best in {options.output}")
    else:
        note(options, "nothing was written: use -o FILE for the best mechanism")
    return 0
