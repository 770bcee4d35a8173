"""`spherekit synthesize`: sizes for a wanted function, from a file."""

import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from spherekit.cli.argument_types import whole_number
from spherekit.cli.completers import complete_toml_files, set_completer
from spherekit.cli.main import note
from spherekit.wording import counted, with_units

if TYPE_CHECKING:
    from spherekit.designs.synthesis import Synthesis

MAX_PRINTED_DESIGNS = 5
"""Number of designs that are printed."""

EXAMPLES = """examples:
  # a four-bar whose rocker follows a function
  spherekit synthesize examples/synthesis/function.toml
  # a longer search, and the file of the best mechanism
  spherekit synthesize examples/synthesis/torque.toml --designs 65536 -o found.toml
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit synthesize`.

    The command evaluates many designs, and starts a local optimisation at the best ones.
    """
    synthesis_argument = parser.add_argument(
        "synthesis",
        metavar="SYNTHESIS",
        help="file with the wanted function, the free sizes and the conditions",
    )
    set_completer(synthesis_argument, complete_toml_files)
    parser.add_argument(
        "--designs",
        metavar="N",
        type=whole_number,
        default=16384,
        help="number of designs that are evaluated first; default 16384",
    )
    parser.add_argument(
        "--starts",
        metavar="K",
        type=whole_number,
        default=12,
        help="number of the best designs that are optimised further; default 12",
    )
    parser.add_argument(
        "--seed",
        metavar="K",
        type=whole_number,
        default=0,
        help="seed of the random numbers for the first designs; default 0",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="TOML",
        help="write the file of the best mechanism here",
    )


def execute(options: Namespace) -> int:
    """Find sizes that meet the conditions of a synthesis; print the best designs.

    With ``--output`` the mechanism of the best design is written to a file. Returns the
    exit status 0.
    """
    from spherekit.api.designs import synthesize
    from spherekit.errors import DesignError
    from spherekit.files.mechanism_writer import dump

    for name in ("designs", "starts"):
        if getattr(options, name) < 1:
            raise DesignError(f"--{name} {getattr(options, name)}: give at least 1")
    result = synthesize(
        options.synthesis, designs=options.designs, starts=options.starts, seed=options.seed
    )
    if options.output:
        dump(result.mechanism(), options.output)
    if not options.quiet:
        _print_result(result)
    sys.stdout.flush()
    if options.output:
        note(options, f"the best in {options.output}")
    else:
        note(options, "nothing was written: use -o FILE for the best mechanism")
    return 0


def _print_result(result: "Synthesis") -> None:
    """Print how far each objective fell, and the best designs.

    A synthesis looks at many designs in all their assembly modes (ways to assemble the
    loops). A row is one design in one mode. From the best rows that meet the conditions,
    local optimisations (descents) minimise the objectives.

    With one objective the best designs are printed. With several objectives, designs of the
    Pareto fronts are printed, evenly chosen. Each assembly mode has its own front.
    """
    import numpy as np

    synthesis = result.synthesis
    frame = result.frame()
    print(
        f"{synthesis.sweep.mechanism.name}: {counted(result.explored, 'design')} "
        f"looked at, conditions held in {counted(result.feasible, 'row')}"
    )
    # The least value of each objective: among the explored rows that meet the conditions
    # (`before`), and after the descents.
    least_objectives = result.objectives.min(axis=0)
    for name, text, before, after in zip(
        result.headings, synthesis.minimise, result.before, least_objectives, strict=True
    ):
        print(f"{name}: {text}, the least there {before:.6g}, after descents {after:.6g}")
    has_one_objective = len(result.headings) == 1
    if not has_one_objective:
        # One design beats another of the same assembly mode if it is better in all
        # objectives by more than these differences. The front has the designs that no
        # design of the synthesis beats.
        tolerances = " and ".join(f"{value:.2g}" for value in result.tolerance)
        print(
            f"{counted(len(result.objectives), 'design')} that none met beats, of their "
            f"mode, in all objectives by more than {tolerances}:"
        )
    if has_one_objective:
        rows = np.arange(min(MAX_PRINTED_DESIGNS, len(frame)))
    else:
        spaced = np.linspace(0, len(frame) - 1, MAX_PRINTED_DESIGNS)
        rows = np.unique(spaced.astype(int))
    # A matched column has the error of a design at one point of the wanted function. There
    # is a column for each point, so these are not printed.
    matched_columns = [name for name in frame.columns if name in synthesis.matched]
    printed = frame.drop(columns=matched_columns).iloc[rows]
    printed.columns = with_units(printed.columns, frame.attrs["units"])
    print(printed.to_string(index=False, float_format="%.8g"))
    if len(frame) > MAX_PRINTED_DESIGNS:
        print(f"... {counted(len(frame) - MAX_PRINTED_DESIGNS, 'more design')}")
