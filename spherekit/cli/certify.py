"""`spherekit certify`: prove which assembly modes there are, and write a certificate."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from spherekit.cli.suggest import mechanisms, suggesting

EXAMPLES = (
    (
        "spherekit certify four_bar --at 40",
        "all assembly modes at an input of 40 degrees, proven",
    ),
    (
        "spherekit certify three_rrr --at 10,20,30 -o three_rrr.json",
        "with several inputs; the certificate in a file",
    ),
    (
        "spherekit certify four_bar --at 40 --tolerance 1e-9",
        "for every geometry whose sizes are off by at most 1e-9 rad",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    suggesting(
        parser.add_argument("file", metavar="FILE", help="mechanism: path or shipped name"),
        mechanisms,
    )
    parser.add_argument(
        "--at",
        required=True,
        metavar="Q[,Q...]",
        help="values of the inputs, decimal numbers in the unit of the file",
    )
    parser.add_argument(
        "--input", action="append", metavar="PAIR", help="drive this pair instead"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.0,
        metavar="RAD",
        help="by how much sizes may be off (rad); by default the file is exact",
    )
    parser.add_argument("-o", "--out", metavar="JSON", help="write the certificate here")


def execute(options: argparse.Namespace) -> int:
    """Prove what can be proven; 3 if the list of modes is not proven complete."""
    from spherekit.files.document import parse, read_text
    from spherekit.files.library import find
    from spherekit.files.read import read
    from spherekit.planning.inputs import driven_at, driven_pairs
    from spherekit.proof.certificate import modes_certificate
    from spherekit.proof.modes import certified_modes
    from spherekit.proof.written import Written

    path = find(options.file)
    document = parse(read_text(path), str(path))
    mechanism = driven_at(read(document), options.input)
    count = len(driven_pairs(mechanism))
    written = Written.of(mechanism, document, options.tolerance)
    modes = certified_modes(written, _values(options.at, count, mechanism.name))
    print(f"{mechanism.name}: {modes.claim}")
    for line in mode_lines(modes):
        print(line)
    if options.out:
        write(Path(options.out), modes_certificate(modes))
    return 0 if modes.complete else 3


def _values(text: str, count: int, name: str) -> list[str]:
    """Return the decimal numbers of the inputs."""
    from decimal import Decimal, InvalidOperation

    from spherekit.errors import AnalysisError

    values = [each.strip() for each in text.split(",")]
    for value in values:
        try:
            finite = Decimal(value).is_finite()
        except InvalidOperation:
            finite = False
        if not finite:
            raise AnalysisError(
                f"--at: {value!r} is not a decimal number; write 40 or 12.5"
            )
    if len(values) != count:
        raise AnalysisError(
            f"--at: {name} has {count} inputs, {len(values)} values were given; give one "
            "for each, with commas between them"
        )
    return values


def mode_lines(modes: Any) -> list[str]:
    """Return one line for each mode: the angles of all pairs with proven digits."""
    import numpy as np

    from spherekit.proof.balls import middle, upper

    names = [pair.name for pair in modes.written.mechanism.pairs]
    lines = []
    for number, angles in enumerate(modes.angles()):
        shown = (
            f"{name} {np.degrees(middle(angle)):.9f}"
            for name, angle in zip(names, angles, strict=True)
        )
        off = max(np.degrees(upper(angle - angle.mid())) for angle in angles)
        lines.append(f"  mode {number}, deg: {', '.join(shown)}; each to {off:.0e}")
    return lines


def write(path: Path, certificate: dict[str, Any]) -> None:
    """Write a certificate."""
    from spherekit.files.atomic import write_text

    write_text(path, json.dumps(certificate, indent=1) + "\n")
    print(f"spherekit: wrote {path}", file=sys.stderr)
