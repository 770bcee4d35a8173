"""`spherekit certify`: prove modes, curves and singularities, and write a certificate."""

import json
import math
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from spherekit.cli.completers import complete_mechanisms, set_completer
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.study_arguments import (
    UNIT_RULE,
    add_input_argument,
    add_lock_argument,
    read_angle,
    with_locks,
)
from spherekit.conventions import Facts, Lines
from spherekit.number_text import bound_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted

if TYPE_CHECKING:
    from spherekit.completeness import Completeness
    from spherekit.proof.certified_modes import CertifiedModes
    from spherekit.proof.certified_singularities import CertifiedSingularities
    from spherekit.proof.configuration_curves import CertifiedCurves
    from spherekit.proof.decimal_mechanism import DecimalMechanism
    from spherekit.proof.input_map import InputMap
    from spherekit.quantity import AngleUnit

INCOMPLETE = 3
"""Exit status if completeness is not proven."""

LOCKED_SIZE_ERROR_RAD = 1e-14
"""Bound of the error of sizes that follow from locked pairs, which are rounded."""

MAX_INPUT = 100000
"""Largest input, in the unit of the file, that options accept."""

MIN_CELL_RAD = 1e-4
MAX_CELL_RAD = 1.0
"""Limits of ``--cell``."""

MAX_LISTED_RANGES = 8
"""Number of undecided ranges that are printed."""

SINGULARITY_TYPES = {
    "I": "type I, output at rest",
    "I or III": "type I or III, output at rest",
    "II": "type II, dead centre",
    "II or III": "type II or III, dead centre",
}
"""The types of singularities on the screen, by their names in certificates."""

PRECISION_BITS = 80
"""Working precision of the few numbers that are computed here."""

EXAMPLES = """examples:
  # all modes, curves and singularities over the input's range, proven
  spherekit certify four_bar
  # all assembly modes at one input, with the certificate in a file
  spherekit certify four_bar --at 40 -o modes.json
  # at values of several inputs
  spherekit certify three_rrr --at 10,20,30
  # with two inputs: a map of the ranges without singularities of type II
  spherekit certify five_bar --figure map.png
  # with a locked input: two links become one, with sizes exact to 1e-14 rad
  spherekit certify five_bar --lock 51=80
  # for all sizes that deviate by at most 1e-9 rad from those of the file
  spherekit certify four_bar --tolerance 1e-9rad
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit certify`."""
    add_input_argument(parser)
    add_lock_argument(parser)  # --lock PAIR=VALUE holds a pair, so that its links are one
    file_argument = parser.add_argument(
        "file",
        metavar="FILE",
        help="mechanism: path of a file, or name of a shipped one",
    )
    set_completer(file_argument, complete_mechanisms)
    parser.add_argument(
        "--at",
        metavar="ANGLE[,ANGLE...]",
        help=(
            "prove which assembly modes exist at this value of the input, such as 40 or "
            "0.7rad, or at one value of each input, such as 10,20,30 (default: over the "
            f"range of the inputs); {UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "--poles",
        action="store_true",
        help=(
            "with --at: also compute proven bounds of every pole axis and velocity "
            "coefficient"
        ),
    )
    parser.add_argument(
        "--range",
        nargs=2,
        metavar=("FROM", "TO"),
        help=(
            "with one input: the range of the input for which the results are proved, in "
            f"place of the range in the file; {UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "--clear-of",
        metavar="ANGLE",
        help=(
            "with one input: print a proven distance from this value of the input "
            "within which there is no singularity"
        ),
    )
    parser.add_argument(
        "--cell",
        metavar="ANGLE",
        help=(
            "with two inputs: largest side of the small rectangles into which the ranges "
            f"of the inputs are divided (default: 0.01rad); {UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "--figure",
        metavar="PNG",
        help=(
            "with two inputs: draw a map of the number of modes over the inputs, and "
            "write it to this file"
        ),
    )
    parser.add_argument(
        "--tolerance",
        metavar="ANGLE",
        help=(
            "prove the results for all mechanisms whose dimensions deviate from those in "
            "the file by at most this angle, such as 1e-9rad (default: the dimensions are "
            f"exact); {UNIT_RULE}"
        ),
    )
    parser.add_argument(
        "-o",
        "--out",
        metavar="JSON",
        help="write the certificate, a record of the proof, into this file",
    )


@dataclass(frozen=True)
class Certification:
    """The result of a proof about one mechanism: the printed report and a certificate.

    Attributes
    ----------
    report
        The report for the screen.
    certificate
        The proven statements with their numbers, ready for JSON.
    is_complete
        Whether everything that was to be proven is proven.
    """

    report: ScreenReport
    certificate: Facts
    is_complete: bool


def execute(options: Namespace) -> int:
    """Prove assembly modes, curves and singularities; write the certificate.

    One of four proofs is made:

    - all assembly modes (ways to assemble the mechanism) at given inputs,
    - the ratios of a mechanism in which toothed wheels determine all angles,
    - a map of the number of modes over the ranges of two inputs,
    - the curves of configurations over the range of one input.

    Returns
    -------
    The exit status: 0, or `INCOMPLETE` if something stays undecided.
    """
    from spherekit.errors import AnalysisError
    from spherekit.files.mechanism_reader import checked_document, mechanism_from_document
    from spherekit.files.mechanism_writer import dumps
    from spherekit.files.toml_document import parse
    from spherekit.planning.assembly_plan import driven_at
    from spherekit.proof.construction import find_construction
    from spherekit.proof.decimal_mechanism import TOLERANCE_LIMIT_RAD, read_decimals
    from spherekit.storage.atomic_write import check_file, write_text

    document = checked_document(options.file)
    unit: AngleUnit = document.data["angle_unit"]
    tolerance = 0.0
    if options.tolerance is not None:
        tolerance = read_angle("--tolerance", options.tolerance, unit)
        if not 0.0 <= tolerance < TOLERANCE_LIMIT_RAD:
            raise AnalysisError(
                f"--tolerance {options.tolerance}: found {tolerance:g} rad, expected an "
                f"angle of at least 0 and less than {TOLERANCE_LIMIT_RAD:g}rad, such as "
                "1e-9rad"
            )
    if options.lock:
        # The proof reads decimal numbers, so the mechanism with locked pairs is written as
        # a new document. Its sizes are rounded.
        locked = with_locks(mechanism_from_document(document), options.lock)
        document = parse(dumps(locked, document.data["angle_unit"]), options.file)
        tolerance += LOCKED_SIZE_ERROR_RAD
    mechanism = driven_at(mechanism_from_document(document), options.input)
    decimal_mechanism = read_decimals(mechanism, document, tolerance)

    # Refuse options that do not belong to the proof that is asked for.
    is_at_inputs = options.at is not None
    input_count = len(mechanism.inputs)
    if is_at_inputs and options.range:
        raise AnalysisError(
            "--at and --range cannot be used together; give only one of them"
        )
    if options.poles and not is_at_inputs:
        raise AnalysisError(
            "--poles computes proven bounds of the pole axes at given input values, but no "
            "values are given; give them with --at Q"
        )
    if options.clear_of and (is_at_inputs or input_count > 1):
        raise AnalysisError(
            "--clear-of needs the range of a single input; leave it out with --at or "
            "several inputs"
        )
    is_map = input_count > 1 and not is_at_inputs
    if not is_map and (options.cell is not None or options.figure):
        contradiction = f"{mechanism.name} has {counted(input_count, 'input')}"
        if is_at_inputs:
            contradiction = "--at gives single values"
        raise AnalysisError(
            f"--cell and --figure need ranges of several inputs, but {contradiction}; "
            "leave --cell and --figure out"
        )
    # If nothing is unknown, wheels in mesh fix every angle.
    is_wheels_only = (
        not is_at_inputs
        and not find_construction(decimal_mechanism.structure).unknown_count
    )
    if is_wheels_only and (options.cell is not None or options.figure or options.clear_of):
        raise AnalysisError(
            f"{mechanism.name}: wheels determine every angle, so all inputs have one "
            "assembly mode and no dead centre; leave --cell, --figure and --clear-of out"
        )
    if options.figure:
        _check_figure_ending(options.figure)
    for target in (options.out, options.figure):
        if target:
            check_file(target)

    if is_at_inputs:
        result = _certify_inputs(decimal_mechanism, options.at, options.poles)
    elif is_wheels_only:
        result = _certify_wheels(decimal_mechanism)
    elif is_map:
        result = _certify_map(decimal_mechanism, options)
    else:
        result = _certify_range(decimal_mechanism, options.range, options.clear_of)
    report = result.report
    if options.out:
        write_text(Path(options.out), json.dumps(result.certificate, indent=1) + "\n")
        files = [f"certificate in {options.out}"]
    else:
        files = ["certificate not saved; add -o FILE.json"]
    if options.figure:
        files.append(f"figure in {options.figure}")
    report.files = ", ".join(files)
    report.print(options)
    return 0 if result.is_complete else INCOMPLETE


def _check_figure_ending(path: str) -> None:
    """Raise `AnalysisError` if a figure cannot be written in the format of its ending."""
    from spherekit.display.figures.figure_files import FORMATS
    from spherekit.errors import AnalysisError

    if Path(path).suffix.lower() not in [f".{kind}" for kind in FORMATS]:
        raise AnalysisError(
            f"--figure {path}: expected a file name that ends with "
            f"{' or '.join(f'.{kind}' for kind in FORMATS)}, such as map.png"
        )


def _make_report(
    question: str, completeness: "Completeness", proven_sentence: str
) -> ScreenReport:
    """Return a report that begins with what is proven, or warns that something is not.

    Parameters
    ----------
    question
        The first line of the report: the mechanism and what was to be proven.
    completeness
        Whether everything is proven, with the reason.
    proven_sentence
        The result if everything is proven.
    """
    from spherekit.completeness import Guarantee

    report = ScreenReport(question)
    if completeness.guarantee is Guarantee.CERTIFIED:
        report.results.append(f"Proven: {proven_sentence}")
        report.details.append(str(completeness))
    else:
        report.warnings.append(f"not everything is proven; {completeness}")
    return report


def _certify_inputs(
    decimal_mechanism: "DecimalMechanism", inputs_text: str, with_poles: bool
) -> Certification:
    """Prove which assembly modes (ways to assemble a mechanism) exist at fixed inputs.

    Returns the report and the certificate of the command ``spherekit certify --at``.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with the decimal numbers of its file.
    inputs_text
        The value of ``--at``: an angle for each input, with commas between them.
    with_poles
        Whether the result also has proven bounds of all pole axes (axes of relative
        rotation of two links) and velocity coefficients (relative angular velocity per unit
        rate of the input).
    """
    from spherekit.errors import AnalysisError
    from spherekit.proof.certificate import modes_certificate, pole_table
    from spherekit.proof.certified_modes import certify_modes

    mechanism = decimal_mechanism.mechanism
    values = [
        _decimal_text("--at", part, mechanism.angle_unit) for part in inputs_text.split(",")
    ]
    input_count = len(mechanism.inputs)
    if len(values) != input_count:
        raise AnalysisError(
            f"--at: found {counted(len(values), 'value')}, but {mechanism.name} has "
            f"{counted(input_count, 'input')}; give {counted(input_count, 'value')}"
            f"{', with commas between them' if input_count > 1 else ''}"
        )
    modes = certify_modes(decimal_mechanism, values)
    inputs = ", ".join(
        f"{pair} = {value} {mechanism.angle_unit}"
        for pair, value in zip(mechanism.input_pairs, values, strict=True)
    )
    mode_table = _mode_table(modes)
    verb = "is" if len(mode_table.rows) == 1 else "are"
    report = _make_report(
        f"{mechanism.name}: proof of all assembly modes at {inputs}",
        modes.completeness,
        f"there {verb} exactly {counted(len(mode_table.rows), 'assembly mode')}.",
    )
    report.results.append(mode_table)
    # Regions in which the proof does not decide whether there are modes.
    report.warnings += _describe_undecided_regions(modes)
    certificate = modes_certificate(modes)
    if with_poles:
        certificate["poles"] = pole_table(modes)
        report.results.append(_screen_table_of_poles(certificate["poles"]))
    return Certification(report, certificate, modes.is_complete)


def _screen_table_of_poles(rows: Sequence[Facts]) -> ScreenTable:
    """Return the proven pole axes and velocity coefficients as a table.

    Parameters
    ----------
    rows
        One mapping for each pole (axis of the relative rotation of two links). It has the
        assembly mode, the input that moves while the others are locked, and the two links.
        ``direction`` is the unit vector of the pole, or None. The velocity coefficient is
        the relative angular rate of the links per unit rate of the input. Keys that end
        with ``off`` have proven error bounds.
    """
    headings = ["mode", "moving input", "pole", "axis x", "y", "z", "error bound"]
    headings += ["velocity coefficient", "error bound"]
    cells = []
    for row in rows:
        # If the links may be at relative rest, no axis is proven.
        axis = ["may be at rest", "", "", ""]
        if row["direction"] is not None:
            axis = [f"{component:.12f}" for component in row["direction"]]
            axis.append(bound_text(row["direction_off"]))
        cells.append(
            (
                str(row["mode"]),
                row["moving"],
                f"{row['link']}/{row['relative_to']}",
                *axis,
                f"{row['velocity_coefficient']:.12g}",
                bound_text(row["velocity_coefficient_off"]),
            )
        )
    columns = tuple(
        ScreenColumn(heading, "left" if number < 3 else "right")
        for number, heading in enumerate(headings)
    )
    return ScreenTable(columns, tuple(cells), title="Pole axes and velocity coefficients:")


def _decimal_text(option: str, text: str, unit: "AngleUnit") -> str:
    """Return an angle of the command line as decimal text, for a proof.

    A proof uses the decimal number that the user wrote, without rounding to a float. The
    result has no exponent and is in the unit of the mechanism file.

    Parameters
    ----------
    option
        Name of the option with this value, for messages.
    text
        The text that the user wrote.
    unit
        Unit of angles of the mechanism file.

    Raises
    ------
    AnalysisError
        If the text is not an angle, or its size exceeds `MAX_INPUT`.
    """
    from decimal import InvalidOperation

    from spherekit.errors import AnalysisError
    from spherekit.files.angle_units import read_decimal_angle
    from spherekit.quantity import QuantityError

    with suppress(InvalidOperation):  # `<=` raises this error if the number is NaN
        try:
            number = read_decimal_angle(text, unit)
        except QuantityError as problem:
            raise AnalysisError(f"{option}: {problem}. Examples: 40, 12.5deg") from None
        if abs(number) <= MAX_INPUT:
            return f"{number:f}"
    raise AnalysisError(
        f"{option}: {text!r} is not in the range -{MAX_INPUT} to {MAX_INPUT}; give a value "
        "in this range, such as 40 or 12.5"
    )


def _mode_table(modes: "CertifiedModes") -> ScreenTable:
    """Return a table with the angles of all pairs (joints) in each proven assembly mode.

    An assembly mode is one way to assemble the mechanism. The angles are balls: numbers
    with a proven bound of their error. The last column has the largest bound of a row.

    Parameters
    ----------
    modes
        The proven assembly modes at fixed inputs.
    """
    import numpy as np

    from spherekit.proof.balls import centre_float, upper_magnitude

    pair_names = modes.decimal_mechanism.structure.pairs
    rows = []
    for mode_index, angles in enumerate(modes.angles()):
        degrees = np.degrees([centre_float(angle) for angle in angles])
        wrapped = 180.0 - np.remainder(180.0 - degrees, 360.0)  # above -180, up to 180
        # A ball minus its midpoint has only the error, so its magnitude is the bound.
        errors = [np.degrees(upper_magnitude(angle - angle.mid())) for angle in angles]
        angle_texts = [f"{angle:.9f}" for angle in wrapped]
        rows.append((str(mode_index), *angle_texts, bound_text(max(errors))))
    columns = [ScreenColumn("mode")]
    columns += [ScreenColumn(f"pair {name} (deg)", "right") for name in pair_names]
    columns.append(ScreenColumn("error bound (deg)", "right"))
    return ScreenTable(tuple(columns), tuple(rows))


def _describe_undecided_regions(modes: "CertifiedModes") -> Lines:
    """Return a line for each region in which the number of solutions is undecided."""
    import numpy as np

    lines = []
    for centre, half_widths in modes.clusters:
        centre_text = ", ".join(f"{angle:.6f}" for angle in np.degrees(centre))
        width = np.degrees(2.0 * np.max(half_widths))
        lines.append(
            f"undecided: several solutions, or none, near {centre_text} deg, within "
            f"{width:.1e} deg; compute with another input value close by"
        )
    return lines


def _certify_wheels(decimal_mechanism: "DecimalMechanism") -> Certification:
    """Certify a mechanism of wheels only, in which all angles are linear in the inputs.

    Such a mechanism has no closure equations. Each follower (pair that is not an input)
    turns by the sum of ratio times input angle over all inputs. The ratios are balls:
    numbers with a proven bound of their error.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with the decimal numbers of its file.

    Returns
    -------
    The report, with the ratios of each follower, and the certificate.
    """
    from spherekit.proof.balls import centre_float, upper_magnitude, working_precision
    from spherekit.proof.certificate import wheels_certificate

    structure = decimal_mechanism.structure
    # The balls are computed with `PRECISION_BITS` bits.
    with working_precision(PRECISION_BITS):
        ratios = decimal_mechanism.follower_ratios()  # (followers, inputs)
    inputs = structure.names_of(structure.inputs)
    report = ScreenReport(
        f"{structure.name}: proof of assembly modes and dead centres for all inputs"
    )
    report.results.append(
        "Proven: there is one assembly mode and no dead centre, because wheels in mesh "
        "determine every angle by the inputs."
    )
    for pair, pair_ratios in zip(structure.followers, ratios, strict=True):
        terms = " ".join(
            f"{centre_float(ratio):+.12g} x {name}"
            for ratio, name in zip(pair_ratios, inputs, strict=True)
        )
        # The bound of the error of all ratios that this line prints.
        error = max(upper_magnitude(ratio - ratio.mid()) for ratio in pair_ratios)
        report.results.append(
            f"{structure.pairs[pair]} turns by {terms}, "
            f"factors exact to {bound_text(error)}"
        )
    certificate = wheels_certificate(decimal_mechanism, list(ratios))
    return Certification(report, certificate, is_complete=True)


def _certify_range(
    decimal_mechanism: "DecimalMechanism",
    ends: Lines | None,
    clear_of: str | None,
) -> Certification:
    """Certify the assembly modes and the singularities over the range of the only input.

    Each assembly mode (way to assemble the links) follows a curve of configurations while
    the input moves through its range.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with the decimal numbers of its file.
    ends
        The values of ``--range``; by default the range of the file.
    clear_of
        The value of ``--clear-of``: an input whose distance to the next singularity is
        computed.
    """
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

    mechanism = decimal_mechanism.mechanism
    # Ends of the range as decimal texts, in the unit of the file.
    low, high = decimal_mechanism.input_range_text(mechanism.inputs[0].pair)
    if ends:
        low, high = (_decimal_text("--range", end, mechanism.angle_unit) for end in ends)
    if not float(low) < float(high):
        raise AnalysisError(f"the range {low} to {high} is empty; give FROM < TO")
    # A construction is an order of placing the links, and with it the choice of the pair
    # angles that are unknowns. The angles of output pairs are preferred as unknowns, so
    # that singularities of outputs are stationary points of one coordinate of the curves.
    construction = find_construction(
        decimal_mechanism.structure, find_output_pairs(decimal_mechanism).values()
    )
    curves = certify_curves(decimal_mechanism, (low, high), construction)
    located = locate_singularities(curves)
    input_pair = mechanism.input_pairs[0]
    report = _make_report(
        f"{mechanism.name}: proof of assembly modes and singularities, input {input_pair} "
        f"from {low} to {high} {mechanism.angle_unit}",
        curves.completeness,
        "all assembly modes and their curves were found over the whole range.",
    )
    _report_curves(report, curves)
    _report_singularities(report, curves, located)
    if clear_of:
        position = _decimal_text("--clear-of", clear_of, mechanism.angle_unit)
        is_in_range = float(low) <= float(position) <= float(high)
        if not (curves.is_full_cycle or is_in_range):
            raise AnalysisError(
                f"--clear-of {clear_of}: outside the range that is proven; give an input "
                f"from {low} to {high}, or another --range"
            )
        # The functions above set the precision of their balls (numbers with error bounds)
        # themselves. The angle below is the only ball that is computed here.
        with working_precision(PRECISION_BITS):
            q = centre_float(decimal_mechanism.input_angle(position))  # rad
        # Rounded down, so that it stays a proven distance.
        clearance = math.floor(math.degrees(located.clearance(q)) * 1e9) / 1e9
        # Outputs at rest along a whole curve are reported in other lines. Of outputs whose
        # angle no pair measures, only type II is examined.
        further = "further " if located.resting else ""
        types = " of type II" if located.skipped else ""
        report.results.append(
            f"Within {clearance:.9f} deg of input {clear_of} there is no {further}"
            f"singularity{types}, in any mode."
        )
    certificate = {**curves_certificate(curves), "singularities": singular_table(located)}
    is_certified = curves.completeness.guarantee is Guarantee.CERTIFIED
    is_complete = is_certified and not located.undecided
    return Certification(report, certificate, is_complete)


def _certify_map(
    decimal_mechanism: "DecimalMechanism", options: Namespace
) -> Certification:
    """Certify the number of assembly modes over the ranges of two inputs.

    The rectangle of the two ranges is divided into boxes (cells). The number of modes is
    proven in each box, unless the box contains singular inputs or stays undecided. With
    ``--figure`` the boxes are drawn.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with the decimal numbers of its file. It has two inputs or more.
    options
        Values of the arguments of the command.
    """
    from spherekit.errors import AnalysisError
    from spherekit.proof.certificate import map_certificate
    from spherekit.proof.input_map import (
        CONTAINS_TYPE_II,
        DEFAULT_CELL_RAD,
        UNDECIDED,
        certify_input_map,
    )

    mechanism = decimal_mechanism.mechanism
    names = mechanism.input_pairs
    # ``--range`` takes the range of one input only, so the ranges of the file are used.
    if len(names) > 2 or options.range:
        raise AnalysisError(
            f"{mechanism.name} has {len(names)} inputs; --range works with one input only. "
            "With two inputs, omit --range: the ranges in the file are used. With three or "
            "more inputs, give one value for each with --at"
        )
    largest_side = DEFAULT_CELL_RAD  # of a box
    if options.cell is not None:
        largest_side = read_angle("--cell", options.cell, mechanism.angle_unit)
    if not MIN_CELL_RAD <= largest_side <= MAX_CELL_RAD:
        raise AnalysisError(
            f"--cell {options.cell}: found {largest_side:g} rad, expected a side from "
            f"{MIN_CELL_RAD:g}rad to {MAX_CELL_RAD:g}rad"
        )
    # Ends of the two ranges as decimal texts, in the unit of the file.
    ranges = [decimal_mechanism.input_range_text(name) for name in names]
    input_map = certify_input_map(decimal_mechanism, ranges, largest_side)
    range_texts = [
        f"{name} from {low} to {high} {mechanism.angle_unit}"
        for name, (low, high) in zip(names, ranges, strict=True)
    ]
    has_singular_cells = input_map.share(CONTAINS_TYPE_II) > 0.0
    place = "outside of the cells with dead centres" if has_singular_cells else "everywhere"
    report = _make_report(
        f"{mechanism.name}: proof of the number of assembly modes, inputs "
        f"{' and '.join(range_texts)}",
        input_map.completeness,
        f"the number of assembly modes is known {place}.",
    )
    rows = [
        (str(mode_count), f"{100 * share:.3f}")
        for mode_count, share in input_map.mode_shares.items()
    ]
    columns = (
        ScreenColumn("assembly modes", "right"),
        ScreenColumn("share of the area of inputs (%)", "right"),
    )
    report.results.append(ScreenTable(columns, tuple(rows)))
    if options.figure:
        _draw_map(input_map, names, options.figure)
    is_complete = not input_map.share(UNDECIDED)
    return Certification(report, map_certificate(input_map), is_complete)


def _draw_map(input_map: "InputMap", names: Sequence[str], path: str) -> None:
    """Draw the number of assembly modes over the plane of two inputs.

    The plane is divided into boxes with a proven number of assembly modes (ways to assemble
    the mechanism). Boxes with equal numbers have one colour. Boxes with a type II
    singularity (input at a dead centre), and undecided boxes, have colours of their own.

    Parameters
    ----------
    input_map
        The proven map. Its arrays `centres` and `radii` (boxes, 2) are the centres and half
        widths of the boxes in rad. `modes` (boxes,) has the number of modes in each box.
    names
        The names of the two inputs.
    path
        The picture file to write.
    """
    import numpy as np

    from spherekit.display.figures import certified_map
    from spherekit.proof.input_map import CONTAINS_TYPE_II, UNDECIDED

    # For the label of each area, a mask (boxes,) of the boxes that belong to the area.
    is_in_area = {
        counted(mode_count, "mode"): input_map.modes == mode_count
        for mode_count in input_map.mode_shares
    }
    is_in_area[certified_map.TYPE_II_LABEL] = input_map.kind == CONTAINS_TYPE_II
    is_in_area[certified_map.UNDECIDED_LABEL] = input_map.kind == UNDECIDED
    areas = {
        label: (np.degrees(input_map.centres[boxes]), np.degrees(input_map.radii[boxes]))
        for label, boxes in is_in_area.items()
    }
    certified_map.draw_certified_map(areas, names).savefig(path)


def _degrees(q: float) -> str:
    """Return an input (rad) in degrees; a number that is zero by rounding has no sign."""
    return f"{round(math.degrees(q), 9) + 0.0:.9f}"


def _crossing_sentences(curves: "CertifiedCurves") -> Iterator[str]:
    """Yield a sentence for each crossing, or near miss, of configuration curves.

    A configuration curve shows the angles of the mechanism over the input. Near a crossing,
    the curves are the contour f = 0 of a function f with a saddle point. If f is zero at
    the saddle point, the curves cross. Otherwise they miss each other by a small gap.
    For each saddle, `level_sign` is the sign of f at the saddle point, or None if a
    crossing is neither proven nor excluded. `gap` is an upper bound of the gap. Crossings
    outside the range of the input are omitted.
    """
    for saddle in curves.saddles:
        # The centre of the saddle has an angle for each variable. One of them is the input.
        q = curves.wrap_into_range(curves.input_angle(saddle.centre))
        if q is None:  # outside the range
            continue
        gap = bound_text(saddle.gap)
        if saddle.level_sign == 0:
            sentence = "curves cross"
        elif saddle.level_sign is None:
            sentence = f"curves cross, or miss each other by at most {gap} rad"
        else:
            sentence = f"curves miss each other by at most {gap} rad"
        yield f"{sentence} at {_degrees(q)} deg"


def _report_curves(report: ScreenReport, curves: "CertifiedCurves") -> None:
    """Report the numbers of assembly modes, crossings of curves and undecided ranges.

    A configuration curve is a connected curve of configurations. The assembly modes at an
    input are the configurations with this input. The range of the input is divided into
    intervals with a constant number of modes.

    Singularities have types. At type I the output can rest while the input moves. At type
    II the mechanism can move while the input rests. Type III meets the two conditions, for
    example where curves cross.

    Parameters
    ----------
    report
        The report for the screen.
    curves
        The proven configuration curves over the range of the input (rad).
    """
    columns = (
        ScreenColumn("input from (deg)", "right"),
        ScreenColumn("to (deg)", "right"),
        ScreenColumn("assembly modes", "right"),
    )
    rows = [
        (_degrees(low), _degrees(high), str(mode_count))
        for low, high, mode_count in curves.intervals
    ]
    report.results.append(ScreenTable(columns, tuple(rows)))
    # Several crossings can have the same sentence, which is then printed once.
    for sentence, count in Counter(_crossing_sentences(curves)).items():
        configurations = f", in {count} configurations" if count > 1 else ""
        # The other sentences say that curves "miss each other", or "cross, or miss each
        # other". In the second case it is not decided whether the curves cross.
        is_proven_crossing = sentence.startswith("curves cross at")
        type_text = " (type III)" if is_proven_crossing else ""
        report.results.append(f"{sentence}{configurations}{type_text}")
    # At these inputs there is a curve along which the input is constant while other links
    # move. All its points are singularities of type II.
    for q in curves.constant_input_values:
        report.results.append(
            f"at {_degrees(q)} deg the mechanism can move while the input is at rest "
            "(type II)"
        )
    for low, high in curves.undecided_ranges[:MAX_LISTED_RANGES]:
        report.warnings.append(f"undecided from {_degrees(low)} to {_degrees(high)} deg")
    unlisted = len(curves.undecided_ranges) - MAX_LISTED_RANGES
    if unlisted > 0:
        report.warnings.append(f"undecided in {counted(unlisted, 'more range')}")


def _absence_sentence(curves: "CertifiedCurves", located: "CertifiedSingularities") -> str:
    """Return a sentence of the report: there are no singular points on the curves.

    The curves show the configurations over the input. Crossings of curves, curves with a
    constant input and outputs that are always at rest are reported in other lines. The
    sentence then starts with "Elsewhere".
    """
    may_cross = any(text.startswith("curves cross") for text in _crossing_sentences(curves))
    has_exceptions = may_cross or curves.constant_input_values or located.resting
    start = "Elsewhere there are" if has_exceptions else "There are"
    # Of outputs whose angle no pair measures, only type II is examined.
    types = " of type II" if located.skipped else ""
    return f"{start} no singularities{types}."


def _report_singularities(
    report: ScreenReport, curves: "CertifiedCurves", located: "CertifiedSingularities"
) -> None:
    """Report the singularities of all outputs, and what stays undecided.

    In a type I singularity the output is at rest while the input moves. In a type II
    singularity the input is at rest while the mechanism moves.

    Parameters
    ----------
    report
        The report to which the results are added.
    curves
        The certified curves of configurations over the range of the input.
    located
        The singularities on these curves.
    """
    import numpy as np

    rows = []
    singularities_outside = []
    for singularity in located.singularities:
        is_outside = curves.wrap_into_range(singularity.q) is None
        singularities_outside.append(is_outside)
        # The curve has a variable that makes one turn until all links are back in their
        # first pose. With toothed wheels, the input makes `cycle_turns` turns in this time,
        # otherwise one. The error of the input is larger than the error of the variable by
        # this factor.
        error = np.degrees(singularity.point.error * curves.cycle_turns)
        rows.append(
            (
                singularity.output,
                SINGULARITY_TYPES[singularity.type],
                f"{np.degrees(singularity.q):.9f}",
                bound_text(error),
                str(singularity.curve),
                "outside" if is_outside else "inside",
            )
        )
    if rows:
        columns = [
            ScreenColumn("output"),
            ScreenColumn("singularity"),
            ScreenColumn("input (deg)", "right"),
            ScreenColumn("error bound (deg)", "right"),
            ScreenColumn("curve", "right"),
        ]
        if any(singularities_outside):
            columns.append(ScreenColumn("range"))
        # Without this column, the last cell of each row is left out.
        cells = tuple(tuple(row[: len(columns)]) for row in rows)
        report.results.append(ScreenTable(tuple(columns), cells))
    elif not located.undecided:
        report.results.append(_absence_sentence(curves, located))
    if located.undecided:
        report.warnings.append(
            f"singularities are undecided in {counted(located.undecided, 'part')} of curves"
        )
    for name, curve in located.resting:
        report.results.append(f"output {name} is at rest all along curve {curve}")
    # The equations have no angle of these outputs, so it is unknown where they are at rest.
    for name in located.skipped:
        report.warnings.append(
            f"output {name}: only singularities of type II are proven, because no pair "
            "measures its angle"
        )
