"""Certificates: JSON tables of what was proven, from which a checker can prove it again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spherekit.completeness import Guarantee
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import (
    Ball,
    centre_float,
    upper_magnitude,
    working_precision,
)
from spherekit.proof.certified_modes import CertifiedModes
from spherekit.proof.certified_singularities import CertifiedSingularities
from spherekit.proof.collinear_loops import Arm
from spherekit.proof.configuration_curves import CertifiedCurves
from spherekit.proof.construction import Construction
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.enclosed_poles import enclose_poles
from spherekit.proof.input_map import CONTAINS_TYPE_II, REGULAR, UNDECIDED, InputMap
from spherekit.proof.modes_over_boxes import EquationSystem, SystemSolution
from spherekit.proof.root_ball import CertifiedRoot
from spherekit.proof.structure import Structure
from spherekit.proof.tubes import CertifiedArc
from spherekit.version import __version__

CERTIFICATE_FORMAT = 1
"""Version of the form of certificates, in their entry "certificate"."""

WHEEL_PRECISION_BITS = 80
"""Bits of ball centres for the angles of wheels in a certificate."""

CROSSING_WORDS = {
    0: "curves cross",
    1: "curves miss each other, above and below",
    -1: "curves miss each other, left and right",
    None: "curves cross or miss each other",
}
"""What is proven of a crossing, by the sign of its level.

The first row of its frame points to the right, the second one upwards.
"""


def _make_heading(statement: str, decimal_mechanism: DecimalMechanism) -> dict[str, Any]:
    """Return the entries with which all certificates begin."""
    return {
        "certificate": CERTIFICATE_FORMAT,
        "made_by": f"spherekit {__version__}",
        "statement": statement,
        "mechanism": decimal_mechanism.document.text or "",
        "tolerance_rad": decimal_mechanism.tolerance,
    }


def modes_certificate(modes: CertifiedModes) -> dict[str, Any]:
    """Return the certificate of the assembly modes at given inputs.

    A certificate is a table for a JSON file, from which a checking program can repeat the
    proof. An assembly mode (one way to assemble the mechanism) is a real root of the loop
    equations. The entries are:

    - "construction" is the order in which the proof places the links one after another.
    - "roots" are all proven complex roots, real roots among them.
    - "bound" is the largest possible number of complex roots. If as many are listed,
      "counted" is true, and none is missing.
    - "complete" is true if no real root is missing. There are two other ways to prove this:
      "systems", and a search of all angles by boxes.
    - "systems" are parts of the equations with all their solutions.
    - "undecided_rad" are the boxes that may contain further real roots.
    - "precision_bits" are the bits of the numbers in the proof.
    """
    decimal_mechanism = modes.decimal_mechanism
    construction = modes.construction
    input_names = decimal_mechanism.structure.names_of(construction.input_pairs)
    return {
        **_make_heading("modes at inputs", decimal_mechanism),
        "inputs": dict(zip(input_names, modes.inputs, strict=True)),
        "construction": _construction_table(decimal_mechanism, construction),
        "bound": modes.mode_bound,
        "complete": modes.is_complete,
        "counted": modes.is_counted,
        # Undecided boxes that touch are joined to clusters.
        "undecided_rad": [
            {"centre": centre.tolist(), "half": half_widths.tolist()}
            for centre, half_widths in modes.clusters
        ],
        "modes": len(modes.real),
        "precision_bits": modes.precision_bits,
        "systems": _system_tables(decimal_mechanism, construction, modes.systems),
        "roots": [_root_table(root) for root in modes.roots],
    }


def _construction_table(
    decimal_mechanism: DecimalMechanism, construction: Construction
) -> Mapping[str, Any]:
    """Return how a proof places the links of the mechanism one by one, as a table.

    The table is part of a certificate, from which a checking program can repeat the proof.

    The first link is the root. Each further link is placed in one of two ways. One pair
    (joint) joins it to a link placed before: it is turned about the axis of this pair. Or
    two pairs join it to two links placed before: it is put on the axes of both pairs.

    Parameters
    ----------
    decimal_mechanism
        The mechanism, which has the names of links and pairs.
    construction
        The order of placing the links, with numbers instead of names.

    Returns
    -------
    The entries of the table, with names of links and pairs:

    - "root": the first link;
    - "steps": how each further link is placed (`_step_tables`);
    - "unknowns": the pairs with unknown angles;
    - "couplers": the links that replace sliding contacts (`_coupler_tables`);
    - "follow": the pairs with angles that follow from the inputs through wheels.
    """
    structure = decimal_mechanism.structure
    unknown_pairs = construction.pairs[: construction.unknown_count]
    return {
        "root": structure.links[construction.root],
        "steps": _step_tables(structure, construction),
        "unknowns": structure.names_of(unknown_pairs),
        "couplers": _coupler_tables(decimal_mechanism),
        "follow": structure.names_of(structure.followers),
    }


def _step_tables(structure: Structure, construction: Construction) -> list[dict[str, Any]]:
    """Return for a certificate how each link is placed, in order.

    The root is the link that is placed first. It is left out. Each dictionary has the name
    of the link, the names of the one or two links placed before to which it is joined
    ("on"), and the names of the pairs that join it to those links ("by").
    """
    return [
        {
            "link": structure.links[step.link],
            "on": [structure.links[parent] for parent in step.parents],
            "by": structure.names_of(step.pairs),
        }
        for step in construction.steps
    ]


def _coupler_tables(decimal_mechanism: DecimalMechanism) -> dict[str, dict[str, Any]]:
    """Return the couplers: links by which a proof replaces sliding contacts of circles.

    When two circles slide on each other, the distance of their centres is constant. So a
    link between the centres, the coupler, allows the same motion as the contact. A revolute
    pair at each centre joins the coupler to one of the two links in contact.

    Returns
    -------
    For each sliding contact, keyed by the name of the contact: the name of the coupler
    ("link"), and the names of its two revolute pairs ("pairs").
    """
    structure = decimal_mechanism.structure
    tables = {}
    for coupler, contact in enumerate(structure.couplers):
        link, pairs = structure.coupler_parts(coupler)
        contact_name = decimal_mechanism.mechanism.pairs[contact].name
        tables[contact_name] = {
            "link": structure.links[link],
            "pairs": structure.names_of(pairs),
        }
    return tables


def curves_certificate(curves: CertifiedCurves) -> dict[str, Any]:
    """Return the certificate of the configuration curves over a range of the only input.

    A certificate is a table for a JSON file, from which a checker can repeat the proof.
    Each curve is a chain of pieces. A piece is a box in the space of the variables with
    exactly one arc of the curve. Each box contains the centre of the next box. Centres and
    frames of boxes are exact float64 numbers. Places where curves cross or nearly do are
    listed as crossings.

    If the input drives wheels, all wheels are back at their initial angles after
    "input_turns_of_its_variable" turns of the input. In the equations the input angle is
    this number times a variable. The wheel angles are whole multiples of the variable plus
    constants.

    "off" is the error bound (rad) of a configuration. "curves_at_one_input_rad" are the
    inputs at which a whole curve has one value of the input.
    """
    decimal_mechanism = curves.decimal_mechanism
    construction = curves.construction
    input_pair = construction.pairs[curves.input_variable]
    return {
        **_make_heading("curves over a range", decimal_mechanism),
        "inputs": {decimal_mechanism.structure.pairs[input_pair]: curves.range_text},
        "construction": _construction_table(decimal_mechanism, construction),
        "input_turns_of_its_variable": construction.cycle_turns,
        "wheels": _wheel_tables(decimal_mechanism, construction),
        "complete": curves.completeness.guarantee is Guarantee.CERTIFIED,
        "undecided_rad": curves.undecided_ranges,
        "problems": curves.problems,
        "boxes": curves.box_count,
        "turning_points_rad": curves.turning_points,
        "modes": curves.intervals,
        "curves_at_one_input_rad": curves.constant_input_values,
        "crossings": [
            {
                "centre": saddle.centre.tolist(),
                "frame": saddle.frame.T.tolist(),
                "limits": saddle.limits.tolist(),
                "is": CROSSING_WORDS[saddle.level_sign],
                "gap_at_most": saddle.gap,
            }
            for saddle in curves.saddles
        ],
        "curves": [
            {
                "closed": chain.closed,
                "ends_at_crossings": [_arm_entry(arm) for arm in arms],
                "at_one_input": is_constant,
                "input_stops": [
                    {"place": point.position.tolist(), "off": point.error}
                    for point in stationary_points.proven
                ],
                "pieces": [_piece_table(piece) for piece in chain.pieces],
            }
            for chain, stationary_points, arms, is_constant in zip(
                curves.chains,
                curves.input_stationary_points,
                curves.chain_arms,
                curves.has_constant_input,
                strict=True,
            )
        ],
    }


def _arm_entry(arm: Arm | None) -> list[int] | None:
    """Return what a certificate (proof to be checked) states about an end of a curve.

    A saddle is a place where curves cross or narrowly miss each other. Four branches, its
    arms, leave it, one in each quadrant of the first two coordinates of its frame. If the
    curve ends on an arm, the result is the index of the saddle and the signs of both
    coordinates in the quadrant. The result is None for an end on no arm.
    """
    if arm is None:
        return None
    saddle_number, quadrant = arm
    return [saddle_number, *quadrant]


def _piece_table(piece: CertifiedArc) -> dict[str, Any]:
    """Return the data of a certified arc (angles in rad)."""
    return {
        "centre": piece.centre.tolist(),
        "frame": piece.frame.T.tolist(),
        "half": piece.half_length,
        "radius": piece.radius,
    }


@dataclass(frozen=True)
class RoundedBalls:
    """Float64 numbers that stand for balls (numbers with error bounds), and error bounds.

    Attributes
    ----------
    numbers
        One number near each ball.
    errors
        For each number, a bound of its difference from every value inside its ball.
    """

    numbers: list[float]
    errors: list[float]


def _round_balls(balls: Sequence[Ball]) -> RoundedBalls:
    """Return float64 numbers near balls, with their error bounds."""
    numbers = [centre_float(ball) for ball in balls]
    errors = [
        upper_magnitude(ball - number) for ball, number in zip(balls, numbers, strict=True)
    ]
    return RoundedBalls(numbers, errors)


def _wheel_tables(
    decimal_mechanism: DecimalMechanism, construction: Construction
) -> list[dict[str, Any]]:
    """Return the rotation of each wheel as a function of one variable, for a certificate.

    After some whole turns of the input, all wheels are back at their initial angles. The
    variable is the angle of the input divided by this number of turns. So the angle of each
    wheel is a whole multiple of the variable plus a constant.

    Parameters
    ----------
    decimal_mechanism
        A mechanism with one input. The pairs (hinges) of its wheels are its followers,
        because the input drives them.
    construction
        The order in which links are placed. Each step places a link by one or two pairs.
        `angle_factor` is the turns of the link per turn of the variable.

    Returns
    -------
    For each wheel: the pair ("pair"), the turns of the wheel per turn of the variable
    ("turns"), the angle of the wheel (rad) where the variable is 0 ("at_zero_rad"), and the
    error bound of this angle ("off").
    """
    structure = decimal_mechanism.structure
    # A wheel is placed by a single pair.
    factor_by_pair = {
        step.pairs[0]: step.angle_factor
        for step in construction.steps
        if len(step.pairs) == 1
    }
    with working_precision(WHEEL_PRECISION_BITS):
        # The angles of the input and of the followers where the input, and so the variable,
        # is 0. The angles are balls: numbers of many digits with a bound of their error.
        _input_angle, *wheel_angles = decimal_mechanism.known_angles([exact_ball(0.0)])
        angles = _round_balls(wheel_angles)
    return [
        {
            "pair": structure.pairs[pair],
            "turns": factor_by_pair[pair],
            "at_zero_rad": angle,
            "off": error,
        }
        for pair, angle, error in zip(
            structure.followers, angles.numbers, angles.errors, strict=True
        )
    ]


def map_certificate(input_map: InputMap) -> dict[str, Any]:
    """Return the certificate of a map of assembly modes over several inputs.

    A certificate is a table for a JSON file, from which a checking program can repeat the
    proof. The map divides the ranges of the inputs into boxes. A box is regular if none of
    its configurations is singular with locked inputs (type II). The number of assembly
    modes (ways to assemble the mechanism) is then the same everywhere in the box. "shares"
    has for each kind of box the part of the area of all boxes that this kind covers.

    "construction" is the order in which links are placed. "systems" are the systems of loop
    equations that are solved one after another.
    """
    # The proof holds for the decimal numbers exactly as the mechanism file writes them.
    decimal_mechanism = input_map.decimal_mechanism
    construction = input_map.construction
    input_names = decimal_mechanism.structure.names_of(construction.input_pairs)
    kind_words = {
        REGULAR: "regular",
        CONTAINS_TYPE_II: "contains type II",
        UNDECIDED: "undecided",
    }
    return {
        **_make_heading("modes over boxes", decimal_mechanism),
        "inputs": dict(zip(input_names, input_map.range_texts, strict=True)),
        "construction": _construction_table(decimal_mechanism, construction),
        "systems": _system_tables(decimal_mechanism, construction, input_map.systems),
        "shares": {words: input_map.share(kind) for kind, words in kind_words.items()},
        "boxes": [
            {
                "centre_rad": centre.tolist(),
                "half_rad": half_widths.tolist(),
                "is": kind_words[kind],
                "modes": int(mode_count) if kind == REGULAR else None,
            }
            for centre, half_widths, kind, mode_count in zip(
                input_map.centres,
                input_map.radii,
                input_map.kind,
                input_map.modes,
                strict=True,
            )
        ],
    }


def wheels_certificate(
    decimal_mechanism: DecimalMechanism, ratios: Sequence[Sequence[Ball]]
) -> dict[str, Any]:
    """Return the certificate of a mechanism in which wheels determine all angles.

    All pairs but the inputs are followers: wheels drive them, and their angles are linear
    functions of the inputs. So there is one assembly mode (one way to assemble the links),
    and no dead centre. The certificate is a table for a JSON file, with an entry for each
    follower: its slopes ("ratios"), and the largest bound of their errors ("off"). Another
    program can check these numbers.

    Parameters
    ----------
    decimal_mechanism
        The mechanism.
    ratios
        (followers, inputs) rates of the followers at unit rates of the inputs. The rates
        are balls (numbers with a bound of their error).
    """
    structure = decimal_mechanism.structure
    rounded_ratios = [_round_balls(row) for row in ratios]
    return {
        **_make_heading("wheels fix all angles", decimal_mechanism),
        "inputs": structure.names_of(structure.inputs),
        "ratios": [
            {
                "pair": structure.pairs[pair],
                "ratios": rounded.numbers,
                "off": max(rounded.errors),
            }
            for pair, rounded in zip(structure.followers, rounded_ratios, strict=True)
        ],
    }


def pole_table(modes: CertifiedModes) -> list[dict[str, Any]]:
    """Return the table of poles for a certificate of assembly modes, with error bounds.

    A pole is the axis of the relative rotation of two links, while one input moves and the
    other inputs are locked. The velocity coefficient is the relative angular velocity of
    the links at unit rate of that input. An assembly mode is one way to assemble the
    mechanism. Balls are numbers with bounds of their errors.

    Returns
    -------
    A row for each mode, moving input and two links. Numbers are float64, with error bounds
    in the entries "..._off". The direction is None if the links may be at relative rest.
    """
    structure = modes.decimal_mechanism.structure
    rows = []
    # `balls_of_modes` has for each mode the balls of all variables. Within the context,
    # arithmetic has the number of bits with which the modes were proven.
    with modes.narrow_balls() as (equations, balls_of_modes):
        for mode, variables in enumerate(balls_of_modes):
            for pole in enclose_poles(equations, variables):
                coefficient = _round_balls([pole.coefficient])
                direction = _round_balls(
                    [] if pole.direction is None else [*pole.direction]
                )
                rows.append(
                    {
                        "mode": mode,
                        "moving": structure.pairs[pole.input_pair],
                        "link": structure.links[pole.link],
                        "relative_to": structure.links[pole.relative_to],
                        "direction": direction.numbers or None,
                        "direction_off": max(direction.errors, default=None),
                        "velocity_coefficient": coefficient.numbers[0],
                        "velocity_coefficient_off": coefficient.errors[0],
                    }
                )
    return rows


def singular_table(located: CertifiedSingularities) -> dict[str, Any]:
    """Return the part of a certificate that lists singularities over a range of the input.

    The configurations over the range are curves. A singularity is a point of a curve at
    which the output (type I) or the input (type II) is stationary. The entries are:

    - "found": a list with a dictionary for each singularity. "curve" is the index of the
      curve, "place" has the values (rad) of all variables, and "off" is their error bound.
    - "undecided_parts": number of parts of curves that may have further singularities.
    - "outputs_without_pair": outputs for which singularities of type I are not searched
      for. Their angles are not variables. Mostly no pair (joint) connects such an output
      link to its reference link.
    - "at_rest_along_curves": outputs that are stationary along a whole curve, each with the
      index of the curve.
    """
    return {
        "undecided_parts": located.undecided,
        "outputs_without_pair": located.skipped,
        "at_rest_along_curves": located.resting,
        "found": [
            {
                "output": singularity.output,
                "type": singularity.type,
                "curve": singularity.curve,
                "place": singularity.point.position.tolist(),
                "off": singularity.point.error,
            }
            for singularity in located.singularities
        ],
    }


def _system_tables(
    decimal_mechanism: DecimalMechanism,
    construction: Construction,
    systems: Sequence[EquationSystem],
) -> list[dict[str, Any]]:
    """Return systems of equations with approximations of all their solutions, as tables.

    A system is a smallest set of equations that can be solved separately, after the systems
    before it. Each solution of the systems before gives values to its other variables. So
    the system is solved several times, once for each set of given values.

    Parameters
    ----------
    decimal_mechanism
        The mechanism, which has the names of links and pairs.
    construction
        The order of placing the links. The construction numbers equations and variables.
    systems
        The systems in the order in which they are solved.
    """
    structure = decimal_mechanism.structure
    names = structure.names_of(construction.pairs)
    # An equation states that a link fits between two links placed before. The equation has
    # the name of this link.
    equation_names = [structure.links[step.link] for step in construction.equation_steps]
    tables = []
    for system in systems:
        given_names = [names[variable] for variable in system.given]
        tables.append(
            {
                "equations": [equation_names[row] for row in system.rows],
                "unknowns": [names[variable] for variable in system.unknowns],
                "solved": [
                    _system_solution_table(system_solution, given_names)
                    for system_solution in system.solved
                ],
            }
        )
    return tables


def _system_solution_table(
    system_solution: SystemSolution, given_names: Sequence[str]
) -> dict[str, Any]:
    """Return all solutions of a system of equations at one set of given angles.

    The equations are solved in several systems. A system is solved for its unknown angles.
    Its given angles are unknowns of other systems.

    Parameters
    ----------
    system_solution
        The given angles, and the solutions for the unknown angles.
    given_names
        Names of the given variables.
    """
    roots = system_solution.roots
    solutions = []
    # A root has for each unknown the complex number e^(i angle), or its inverse where
    # `is_inverse` is true.
    for is_inverse, numbers in zip(roots.inverse, roots.z, strict=True):
        real_and_imaginary_parts = [[z.real, z.imag] for z in numbers]
        solutions.append({"inverse": is_inverse.tolist(), "z": real_and_imaginary_parts})
    given_angles = dict(zip(given_names, system_solution.given.tolist(), strict=True))
    return {"given": given_angles, "solutions": solutions}


def _root_table(root: CertifiedRoot) -> dict[str, Any]:
    """Return a certified root with its exact centre."""
    centre = []
    for number in root.centre:
        real_part = list(map(int, number.real.man_exp()))
        imaginary_part = list(map(int, number.imag.man_exp()))
        centre.append([real_part, imaginary_part])
    return {
        "real": root.real,
        "centre": centre,
        "radius": root.radius,
        "alone_within": root.unique,
    }
