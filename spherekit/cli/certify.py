"""`spherekit certify`: prove modes, curves and singularities, and write a certificate."""

import json
import math
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from spherekit.cli.argument_types import number
from spherekit.cli.completers import complete_mechanisms, set_completer
from spherekit.cli.main import say
from spherekit.cli.study_arguments import add_input_argument, add_lock_argument, with_locks
from spherekit.conventions import Facts, Lines
from spherekit.wording import counted

EXAMPLES = """examples:
  # all modes, curves and singularities over the input's range, proven
  spherekit certify four_bar
  # all assembly modes at one input; the certificate in a file
  spherekit certify four_bar --at 40 -o modes.json
  # at values of several inputs
  spherekit certify three_rrr --at 10,20,30
  # two inputs: where over their ranges no mode is singular, proven, drawn
  spherekit certify five_bar --figure map.png
  # an input locked: for all sizes within 1e-14 rad of the link that two become
  spherekit certify five_bar --lock 51=80
  # for every geometry whose sizes are off by at most 1e-9 rad
  spherekit certify four_bar --tolerance 1e-9
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_input_argument(parser)
    add_lock_argument(parser)
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="mechanism: path or shipped name",
    )
    set_completer(file_argument, complete_mechanisms)
    parser.add_argument(
        "--at",
        metavar="DECIMAL[,DECIMAL...]",
        help=(
            "values of the inputs, decimal numbers in the unit of the file, in place of "
            "the range of the only input"
        ),
    )
    parser.add_argument(
        "--poles",
        action="store_true",
        help="with --at: enclose every pole axis and velocity coefficient too",
    )
    parser.add_argument(
        "--range",
        nargs=2,
        metavar=("FROM", "TO"),
        help="another range of the only input, in the unit of the file",
    )
    parser.add_argument(
        "--clear-of",
        metavar="DECIMAL",
        help="over a range: how far the input may go from here before any singularity",
    )
    parser.add_argument(
        "--cell",
        metavar="RAD",
        type=number,
        help="with several inputs: largest side of the cells judged, 0.01 by default",
    )
    parser.add_argument(
        "--figure",
        metavar="PNG",
        help="with two inputs: draw their map",
    )
    parser.add_argument(
        "--tolerance",
        metavar="RAD",
        type=number,
        default=0.0,
        help="by how much sizes may be off (rad); by default the file is exact",
    )
    parser.add_argument(
        "-o",
        "--out",
        metavar="JSON",
        help="write the certificate here",
    )


INCOMPLETE = 3
"""Exit status where nothing wrong was found, but completeness is not proven."""
LOCKED = 1e-14
"""By how much (rad) sizes of a mechanism with locked pairs may be off: they are rounded."""
LARGEST = 100000
"""Largest input read."""


def execute(options: Namespace) -> int:
    """Prove what can be proven; 3 if that is not all."""
    from spherekit.errors import AnalysisError
    from spherekit.files.mechanism_reader import checked_document, mechanism_from_document
    from spherekit.files.mechanism_writer import dumps
    from spherekit.files.toml_document import parse
    from spherekit.planning.assembly_plan import driven_at
    from spherekit.proof.construction import find_construction
    from spherekit.proof.decimal_mechanism import read_decimals
    from spherekit.storage.atomic_write import check_file, write_text

    document = checked_document(options.file)
    tolerance = options.tolerance
    if options.lock:
        locked = with_locks(mechanism_from_document(document), options.lock, options.file)
        document = parse(dumps(locked, document.data["angle_unit"]), options.file)
        tolerance = max(tolerance, LOCKED)
    mechanism = driven_at(mechanism_from_document(document), options.input)
    written = read_decimals(mechanism, document, tolerance)
    at = options.at is not None
    if at and options.range:
        raise AnalysisError("--at and --range are two questions; give one of them")
    if options.poles and not at:
        raise AnalysisError("--poles are those of modes at inputs; give --at Q too")
    if options.clear_of and (at or len(mechanism.inputs) > 1):
        raise AnalysisError("--clear-of is for the range of one input, and not for --at")
    several = len(mechanism.inputs) > 1 and not at
    wheels = not at and not find_construction(written.structure).unknown_count
    if not several and (options.cell is not None or options.figure):
        raise AnalysisError(
            "--cell and --figure are for ranges of several inputs; "
            f"{mechanism.name} has {len(mechanism.inputs)}, or --at is given"
        )
    for target in filter(None, (options.out, options.figure)):
        check_file(target)
    if wheels:
        made = _wheels(written)
    elif several:
        made = _map(written, options)
    elif at:
        made = _at(written, options.at, options.poles)
    else:
        made = _over(written, options.range, options.clear_of)
    lines, certificate, complete = made
    if options.out:
        write_text(Path(options.out), json.dumps(certificate, indent=1) + "\n")
        say(f"wrote {options.out}")
    print("\n".join(lines))
    return 0 if complete else INCOMPLETE


Made = tuple[Lines, Facts, bool]


def _at(written: Any, text: str, with_poles: bool) -> Made:
    """Return lines and certificate of the modes at inputs."""
    from spherekit.errors import AnalysisError
    from spherekit.proof.certificate import modes_certificate, pole_table
    from spherekit.proof.certified_modes import certify_modes

    mechanism = written.mechanism
    values = [_decimal("--at", part) for part in text.split(",")]
    count = len(mechanism.inputs)
    if len(values) != count:
        raise AnalysisError(
            f"--at: {mechanism.name} has {counted(count, 'input')}, {len(values)} "
            "values were given; give one for each, with commas between them"
        )
    modes = certify_modes(written, values)
    lines = [f"{mechanism.name}: {modes.completeness}", *_mode_lines(modes)]
    certificate = modes_certificate(modes)
    if with_poles:
        certificate["poles"] = pole_table(modes)
        lines += map(_pole_line, certificate["poles"])
    return lines, certificate, modes.is_complete


def _pole_line(row: Facts) -> str:
    """Return one line for a pole."""
    where = "may rest"
    if row["direction"] is not None:
        axis = ", ".join(f"{entry:.12f}" for entry in row["direction"])
        where = f"axis {axis} to {row['direction_off']:.0e}"
    line = "  mode {mode}, {moving} moving, {link}/{relative_to}: {where}, coefficient "
    line += "{velocity_coefficient:.12g} to {velocity_coefficient_off:.0e}"
    return line.format(where=where, **row)


def _decimal(option: str, text: str) -> str:
    """Return the text of a decimal number."""
    from decimal import Decimal, InvalidOperation

    from spherekit.errors import AnalysisError

    with suppress(InvalidOperation):  # of what is no number too
        number = Decimal(text.strip())
        if abs(number) <= LARGEST:
            return f"{number:f}"
    raise AnalysisError(
        f"{option}: {text!r} is not a decimal number from -{LARGEST} to {LARGEST}; write "
        "40 or 12.5"
    )


def _mode_lines(modes: Any) -> Lines:
    """Return one line for each mode: the angles of all pairs with proven digits."""
    import numpy as np

    from spherekit.proof.balls import centre_float, upper_magnitude

    lines = []
    for mode_index, angles in enumerate(modes.angles()):
        degrees = np.degrees([*map(centre_float, angles)])
        wrapped = 180.0 - np.remainder(180.0 - degrees, 360.0)
        shown = ", ".join(
            f"{name} {angle:.9f}"
            for name, angle in zip(
                modes.decimal_mechanism.structure.pairs, wrapped, strict=True
            )
        )
        off = max(np.degrees(upper_magnitude(angle - angle.mid())) for angle in angles)
        lines.append(f"  mode {mode_index}, deg: {shown}; each to {off:.0e}")
    for centre, half in modes.clusters:
        place = ", ".join(f"{angle:.6f}" for angle in np.degrees(centre))
        width = np.degrees(2.0 * np.max(half))
        lines.append(f"  undecided: a cluster at {place} deg, {width:.1e} deg wide")
    return lines


def _wheels(written: Any) -> Made:
    """Return lines and certificate of a mechanism whose wheels fix all its angles."""
    from spherekit.proof.balls import centre_float, upper_magnitude, working_precision
    from spherekit.proof.certificate import wheels_certificate

    structure = written.structure
    with working_precision(80):
        ratios = written.follower_ratios()
    inputs = structure.names_of(structure.inputs)
    lines = [
        f"{structure.name}: certified: one mode at all inputs, no dead centre; wheels in "
        "mesh fix every angle by the inputs"
    ]
    for pair, row in zip(structure.followers, ratios, strict=True):
        parts = " ".join(
            f"{centre_float(ratio):+.12g} x {name}"
            for ratio, name in zip(row, inputs, strict=True)
        )
        off = max(upper_magnitude(ratio - ratio.mid()) for ratio in row)
        lines.append(f"  {structure.pairs[pair]} turns {parts}, factors to {off:.0e}")
    return lines, wheels_certificate(written, ratios), True


def _over(written: Any, given: Lines | None, clear_of: str | None) -> Made:
    """Return lines and certificate of the curves over the range of the only input."""
    import numpy as np

    from spherekit.completeness import Guarantee
    from spherekit.errors import AnalysisError
    from spherekit.proof.balls import centre_float, working_precision
    from spherekit.proof.certificate import curves_certificate, singular_table
    from spherekit.proof.certified_singularities import (
        find_output_pairs,
        locate_singularities,
    )
    from spherekit.proof.configuration_curves import certify_curves
    from spherekit.proof.construction import find_construction

    mechanism = written.mechanism
    low, high = written.input_range_text(mechanism.inputs[0].pair)
    if given:
        low, high = (_decimal("--range", end) for end in given)
    if not float(low) < float(high):
        raise AnalysisError(f"the range {low} to {high} is empty; give FROM < TO")
    made = find_construction(written.structure, find_output_pairs(written).values())
    curves = certify_curves(written, (low, high), made)
    located = locate_singularities(curves)
    lines = [f"{mechanism.name}: {curves.completeness}", *_curve_lines(curves, located)]
    if clear_of:
        position = _decimal("--clear-of", clear_of)
        if not (curves.is_full_cycle or float(low) <= float(position) <= float(high)):
            raise AnalysisError(
                f"--clear-of {clear_of}: nothing is proven there; give an input from {low} "
                f"to {high}, or another --range"
            )
        with working_precision(80):
            q = centre_float(written.input_angle(position))
        lines.append(
            f"  within {np.degrees(located.clearance(q)):.9f} deg of {clear_of} there is "
            "no singularity, in any mode"
        )
    certificate = {**curves_certificate(curves), "singularities": singular_table(located)}
    complete = (
        curves.completeness.guarantee is Guarantee.CERTIFIED and not located.undecided
    )
    return lines, certificate, complete


def _map(written: Any, options: Namespace) -> Made:
    """Return lines and certificate of boxes of two inputs, and draw them if asked."""
    from spherekit.errors import AnalysisError
    from spherekit.proof.certificate import map_certificate
    from spherekit.proof.input_map import DEFAULT_CELL_RAD, certify_input_map

    mechanism = written.mechanism
    names = mechanism.input_pairs
    if len(names) > 2 or options.range:
        raise AnalysisError(
            f"{mechanism.name} has {len(names)} inputs; ranges are proven of one input, or "
            "of two over those of the file: give values of all with --at"
        )
    cell = DEFAULT_CELL_RAD if options.cell is None else options.cell
    if not 1e-4 <= cell <= 1.0:
        raise AnalysisError(f"--cell {cell} rad is no use; give one from 0.0001 to 1")
    boxes = certify_input_map(written, [*map(written.input_range_text, names)], cell)
    lines = [f"{mechanism.name}: {boxes.completeness}"]
    lines += [
        f"  {counted(count, 'mode')} in {100 * share:.3f} % of the area"
        for count, share in boxes.mode_shares.items()
    ]
    if options.figure:
        _draw(boxes, names, options.figure)
        lines.append(f"  drawn in {options.figure}")
    return lines, map_certificate(boxes), not boxes.share(2)


def _draw(boxes: Any, names: Lines, path: str) -> None:
    import numpy as np

    from spherekit.display.figures import certified_map
    from spherekit.proof.input_map import CONTAINS, UNDECIDED

    of = {counted(count, "mode"): boxes.modes == count for count in boxes.mode_shares}
    of[certified_map.CONTAINS] = boxes.kind == CONTAINS
    of[certified_map.UNDECIDED] = boxes.kind == UNDECIDED
    areas = {
        word: (np.degrees(boxes.centres[here]), np.degrees(boxes.radii[here]))
        for word, here in of.items()
    }
    certified_map.draw_certified_map(areas, names).savefig(path)


def _degrees(q: float) -> str:
    """Return an input (rad) in degrees, zero but for rounding without a sign."""
    return f"{round(math.degrees(q), 9) + 0.0:.9f}"


def _crossings(curves: Any) -> Iterator[str]:
    """Return words for each place in the range where curves cross or nearly do."""
    words = {0: "curves cross", None: "curves cross, or miss each other by"}
    for saddle in curves.saddles:
        q = curves.wrap_into_range(curves.input_angle(saddle.centre))
        if q is not None:
            by = f" at most {saddle.gap:.0e} rad" if saddle.level_sign != 0 else ""
            what = words.get(saddle.level_sign, "curves miss each other by")
            yield f"{what}{by} at {_degrees(q)} deg"


def _curve_lines(curves: Any, located: Any) -> Lines:
    import numpy as np

    lines = []
    for low, high, count in curves.intervals:
        lines.append(f"  {_degrees(low)} to {_degrees(high)} deg: {counted(count, 'mode')}")
    for place, count in Counter(_crossings(curves)).items():
        lines.append(f"  {place}{f', in {count} configurations' if count > 1 else ''}")
    for q in curves.constant_input_values:
        lines.append(f"  a whole curve of modes at {_degrees(q)} deg")
    for low, high in curves.undecided_ranges[:8]:
        lines.append(f"  undecided: {_degrees(low)} to {_degrees(high)} deg")
    for singularity in located.singularities:
        is_outside = curves.wrap_into_range(singularity.q) is None
        where = ", out of the range" if is_outside else ""
        error = np.degrees(singularity.point.error * curves.cycle_turns)
        lines.append(
            f"  output {singularity.output}: type {singularity.type} at "
            f"{np.degrees(singularity.q):.9f} deg, to {error:.0e}, on curve "
            f"{singularity.curve}{where}"
        )
    if located.undecided:
        lines.append(f"  singularities undecided in {located.undecided} parts of curves")
    for name, curve in located.resting:
        lines.append(f"  output {name}: at rest all along curve {curve}")
    for name in located.skipped:
        lines.append(f"  output {name}: no pair measures it; type II only")
    return lines
