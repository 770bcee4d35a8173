"""`spherekit certify`: prove modes, curves and singularities, and write a certificate."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from spherekit.cli.suggest import mechanisms, suggesting

EXAMPLES = (
    (
        "spherekit certify four_bar",
        "all modes, curves and singularities over the input's range, proven",
    ),
    (
        "spherekit certify four_bar --at 40 -o modes.json",
        "all assembly modes at one input; the certificate in a file",
    ),
    (
        "spherekit certify three_rrr --at 10,20,30",
        "at values of several inputs",
    ),
    (
        "spherekit certify four_bar --tolerance 1e-9",
        "for every geometry whose sizes are off by at most 1e-9 rad",
    ),
)
INCOMPLETE = 3
"""Exit status where nothing wrong was found, but completeness is not proven."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    suggesting(
        parser.add_argument("file", metavar="FILE", help="mechanism: path or shipped name"),
        mechanisms,
    )
    parser.add_argument(
        "--at",
        metavar="Q[,Q...]",
        help="values of the inputs, decimal numbers in the unit of the file, in place of "
        "the range of the only input",
    )
    parser.add_argument(
        "--range",
        nargs=2,
        metavar=("FROM", "TO"),
        help="another range of the only input, in the unit of the file",
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
    """Prove what can be proven; 3 if that is not all."""
    from spherekit.files.document import parse, read_text
    from spherekit.files.library import find
    from spherekit.files.read import read
    from spherekit.planning.inputs import driven_at
    from spherekit.proof.written import Written

    path = find(options.file)
    document = parse(read_text(path), str(path))
    mechanism = driven_at(read(document), options.input)
    written = Written.of(mechanism, document, options.tolerance)
    made = _at(written, options.at) if options.at else _over(written, options.range)
    lines, certificate, complete = made
    print("\n".join(lines))
    if options.out:
        from spherekit.files.atomic import write_text

        write_text(Path(options.out), json.dumps(certificate, indent=1) + "\n")
        print(f"spherekit: wrote {options.out}", file=sys.stderr)
    return 0 if complete else INCOMPLETE


Made = tuple[list[str], dict[str, Any], bool]


def _at(written: Any, text: str) -> Made:
    """Return lines and certificate of the modes at inputs."""
    from spherekit.errors import AnalysisError
    from spherekit.planning.inputs import driven_pairs
    from spherekit.proof.certificate import modes_certificate
    from spherekit.proof.modes import certified_modes

    mechanism = written.mechanism
    values = [_decimal("--at", each) for each in text.split(",")]
    count = len(driven_pairs(mechanism))
    if len(values) != count:
        raise AnalysisError(
            f"--at: {mechanism.name} has {count} input{'s' * (count > 1)}, {len(values)} "
            "values were given; give one for each, with commas between them"
        )
    modes = certified_modes(written, values)
    lines = [f"{mechanism.name}: {modes.claim}", *_mode_lines(modes)]
    return lines, modes_certificate(modes), modes.complete


def _decimal(option: str, text: str) -> str:
    """Return the text of a decimal number."""
    from decimal import Decimal, InvalidOperation

    from spherekit.errors import AnalysisError

    text = text.strip()
    try:
        finite = Decimal(text).is_finite()
    except InvalidOperation:
        finite = False
    if not finite:
        raise AnalysisError(f"{option}: {text!r} is not a decimal number; write 40 or 12.5")
    return text


def _mode_lines(modes: Any) -> list[str]:
    """Return one line for each mode: the angles of all pairs with proven digits."""
    import numpy as np

    from spherekit.proof.balls import middle, upper

    names = [pair.name for pair in modes.written.mechanism.pairs]
    lines = []
    for number, angles in enumerate(modes.angles()):
        degrees = np.degrees([middle(angle) for angle in angles])
        wrapped = 180.0 - np.remainder(180.0 - degrees, 360.0)
        shown = (f"{name} {angle:.9f}" for name, angle in zip(names, wrapped, strict=True))
        off = max(np.degrees(upper(angle - angle.mid())) for angle in angles)
        lines.append(f"  mode {number}, deg: {', '.join(shown)}; each to {off:.0e}")
    for centre, half in modes.clusters:
        place = ", ".join(f"{angle:.6f}" for angle in np.degrees(centre))
        width = np.degrees(2.0 * np.max(half))
        lines.append(f"  undecided: a cluster at {place} deg, {width:.1e} deg wide")
    return lines


def _over(written: Any, given: list[str] | None) -> Made:
    """Return lines and certificate of the curves over the range of the only input."""
    from spherekit.errors import AnalysisError
    from spherekit.guarantee import Guarantee
    from spherekit.planning.inputs import driven_pairs
    from spherekit.proof.certificate import curves_certificate, singular_table
    from spherekit.proof.construction import construct
    from spherekit.proof.curves import certified_curves
    from spherekit.proof.singular import output_pairs, singularities

    mechanism = written.mechanism
    driven = driven_pairs(mechanism)
    if len(driven) != 1:
        raise AnalysisError(
            f"{mechanism.name} has {len(driven)} inputs; ranges are proven of one input: "
            "give values of all with --at"
        )
    ends = [_decimal("--range", end) for end in given] if given else None
    ends = ends or list(written.input_range(mechanism.pairs[driven[0]].name))
    if not float(ends[0]) < float(ends[1]):
        raise AnalysisError(f"the range {ends[0]} to {ends[1]} is empty; give FROM < TO")
    made = construct(mechanism, output_pairs(mechanism))
    curves = certified_curves(written, (ends[0], ends[1]), made)
    found = singularities(curves)
    lines = [f"{mechanism.name}: {curves.claim}", *_curve_lines(curves, found)]
    certificate = {**curves_certificate(curves), "singularities": singular_table(found)}
    complete = curves.claim.guarantee is Guarantee.CERTIFIED and not found.undecided
    return lines, certificate, complete


def _curve_lines(curves: Any, found: Any) -> list[str]:
    import numpy as np

    lines = []
    for low, high, count in curves.intervals:
        lines.append(
            f"  {np.degrees(low):.9f} to {np.degrees(high):.9f} deg: "
            f"{count} mode{'s' * (count != 1)}"
        )
    for low, high in curves.undecided[:8]:
        lines.append(f"  undecided: {np.degrees(low):.9f} to {np.degrees(high):.9f} deg")
    for each in found.found:
        where = "" if each.inside else ", out of the range"
        lines.append(
            f"  output {each.output}: type {each.kind} at {np.degrees(each.q):.9f} deg, "
            f"to {np.degrees(each.stop.off):.0e}, on curve {each.curve}{where}"
        )
    if found.undecided:
        lines.append(f"  singularities undecided in {found.undecided} parts of curves")
    for name in found.skipped:
        lines.append(f"  output {name}: no pair measures it; type II only")
    return lines
