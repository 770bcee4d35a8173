"""Certified curves and singularities over a range, against modes, floats and a checker."""

import copy
import json
import random
from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import EIGHT_BARS, mechanism_from_chain, random_axes
from oracles.proof_checker import check, recorded, refuse

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.files.mechanism_reader import loads
from spherekit.mechanism.elements import Input
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import cosines_and_sines, working_precision
from spherekit.proof.certificate import curves_certificate, singular_table
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.certified_singularities import find_output_pairs, locate_singularities
from spherekit.proof.configuration_curves import certify_curves
from spherekit.proof.construction import find_construction
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.stationary_points import bound_rates
from spherekit.proof.structure import extract_structure

TURN = ("0", "360")


def curves_over_range(name, pair=None, ends=TURN, tolerance=0.0, wanted=()):
    """Return the proven configuration curves of a mechanism over a range of its input.

    Parameters
    ----------
    name
        A mechanism, or the name of a shipped one.
    pair
        Input pair; None leaves that of the mechanism.
    ends
        Ends of the range in degrees, as texts: proofs are about decimal numbers, which
        floats would round.
    tolerance
        The proof is then valid for all mechanisms whose arcs and angles differ from those
        of the file by this much (rad) at most.
    wanted
        Pairs whose singularities are proven as well. Their angles become variables of the
        equations.
    """
    mechanism = driven_at(sk.load(name), pair) if isinstance(name, str) else name
    # The order in which the links are placed one after another.
    construction = find_construction(extract_structure(mechanism), wanted)
    decimal_mechanism = read_decimals(mechanism, tolerance=tolerance)
    return certify_curves(decimal_mechanism, ends, construction)


def check_counts(curves, intervals):
    """Assert that proven counts of modes in intervals are those certified at their middles.

    An interval is (low, high, count) in rad; between turning points the count is constant.
    """
    for low, high, count in intervals:
        middle = repr(float(np.round(np.degrees(0.5 * (low + high)), 6)))
        modes = certify_modes(curves.decimal_mechanism, (middle,))
        assert modes.is_complete and len(modes.real) == count


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "pair", "ends", "turning"),
    [
        ("four_bar", None, TURN, 0),
        ("four_bar", "41", TURN, 4),
        ("four_bar", "41", ("-90", "10"), 1),
        ("watt", "23", ("10", "100"), 0),
        ("stephenson", "16", ("-30", "20"), 2),
    ],
)
def test_modes_between_turning_points_are_as_many_as_at_one_input(
    name, pair, ends, turning
):
    """Curves are proven over a range, with all dead centres of the input (turning points).

    `turning` is their number. Between them, the number of modes is that certified at one
    input by elimination.
    """
    curves = curves_over_range(name, pair, ends)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED, curves.completeness
    assert len(curves.turning_points) == turning
    check_counts(curves, curves.intervals[:4])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [62, 82])
def test_a_long_piece_beside_a_turning_point_does_not_hide_it(seed):
    """A turning point of the input beside a long piece of a curve is proven.

    A piece is a box with exactly one arc of the curve, by proof. s is the coordinate along
    the box. Rates are the derivatives of all variables by s on this arc. Rates and their
    own derivatives have a lower and an upper bound, which are wide in a long box. The two
    random eight-bars have pieces of nearly the largest possible length.

    No lower bound may be above its upper bound. The proof finds turning points from signs
    of the bounds, so it could miss one. The number of modes (ways to assemble the links)
    would then be wrong beside it. `check_counts` checks these numbers.
    """
    link_pairs = EIGHT_BARS[0]
    axes = random_axes(np.random.default_rng(seed), len(link_pairs.split()))
    mechanism = mechanism_from_chain(link_pairs, axes)
    mechanism = replace(
        mechanism, inputs=(Input(mechanism.pairs[0].name, 0.0, 2.0 * np.pi),)
    )
    curves = curves_over_range(mechanism)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED, curves.completeness
    for chain in curves.chains:
        for piece in chain.pieces:
            # Parts of the piece about its centre, up to the whole piece.
            for fraction in (0.25, 0.5, 0.9, 1.0):
                bounds = bound_rates(piece, fraction * piece.half_length)
                assert np.all(bounds.rate_low <= bounds.rate_high)
                assert np.all(bounds.derivative_low <= bounds.derivative_high)
    check_counts(curves, curves.intervals)


@pytest.mark.slow
def test_a_tolerance_loses_no_stop_where_its_sign_is_open_at_a_centre(capsys):
    assert main(["certify", "watt", "--tolerance", "1e-6rad"]) == 0
    output = capsys.readouterr().out
    assert output.count("type I,") == 10 and "undecided" not in output


@pytest.mark.many
@pytest.mark.parametrize(("name", "pair"), [("four_bar", None), ("stephenson", "35")])
def test_singularities_proven_are_those_that_a_run_reports(name, pair):
    """Proven singularities of types I and II are those of the analysis `singularities`.

    At a singularity of type I the output is momentarily at rest while the input moves. At
    one of type II the input is at rest. The analysis finds them in floating point; inputs
    agree to 1e-7 rad. The proof must decide all of them (`undecided` is empty) and leave
    out no output (`skipped`).
    """
    mechanism = driven_at(sk.load(name), pair)
    curves = curves_over_range(
        mechanism,
        wanted=find_output_pairs(read_decimals(mechanism)).values(),
    )
    proven = locate_singularities(curves)
    assert not proven.undecided and not proven.skipped
    frame = sk.run(mechanism, "singularities", samples=3).frame("singularities")
    assert len(frame) == len(proven.singularities)
    for kind in ("I", "II"):
        inputs = np.sort(frame["q"][frame["kind"] == kind].to_numpy())
        proven_inputs = np.sort([x.q for x in proven.singularities if x.type == kind])
        assert len(inputs) == len(proven_inputs)
        assert np.all(np.abs(inputs - proven_inputs) < 1e-7)


def test_all_sizes_within_a_tolerance_have_the_curves_proven(monkeypatch):
    """Curves are proven for all sizes within a tolerance of 1e-7 rad.

    The curves of a four-bar are proven over a whole turn of its input 41 (`TURN`). The
    input at a dead centre depends on the sizes. With 1e-5 rad, a range of the input
    about each of the four dead centres is therefore undecided, 0.01 to 0.02 rad wide.
    Between these ranges there are two modes or none. With 0.03 rad and at most 3000 boxes
    nothing is proven.
    """
    curves = curves_over_range("four_bar", "41", TURN, tolerance=1e-7)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert len(curves.turning_points) == 4
    coarse = curves_over_range("four_bar", "41", TURN, tolerance=1e-5)
    # What may be missing fits into a box of this width (rad).
    assert coarse.completeness.box < 0.022
    assert len(coarse.undecided_ranges) == 4
    # Each interval of the input has its ends and the number of modes.
    assert [count for _, _, count in coarse.intervals] == [0, 2, 0, 2, 0]
    decimal_mechanism = read_decimals(driven_at(sk.load("four_bar"), "41"), tolerance=0.03)
    monkeypatch.setattr("spherekit.proof.configuration_curves.MAX_CURVE_BOXES", 3000)
    undecided = certify_curves(decimal_mechanism, TURN)
    assert undecided.completeness.guarantee is not Guarantee.CERTIFIED


def test_inputs_near_a_position_may_be_wider_than_the_range():
    """An interval of inputs that contains the whole range is found, on every cycle.

    The range is 10 to 20 degrees. The position has its input at 50 degrees, so that the
    middle of the interval is outside of the range.
    """
    curves = curves_over_range("four_bar", ends=("10", "20"))
    position = np.zeros(curves.input_variable + 1)
    for input_deg in (50.0, 410.0):
        position[curves.input_variable] = np.radians(input_deg)
        ((low, high),) = curves.ranges_around(position, np.radians(60.0))
        assert np.allclose((low, high), np.radians((-10.0, 110.0)), rtol=0.0, atol=1e-12)
        assert curves.ranges_around(position, np.radians(29.0)) == []
        assert curves.ranges_around(position, np.inf) == [(curves.low, curves.high)]


def tampered(certificate, generator):
    """Return a certificate (file of a proof) of curves with one random falsification.

    A curve is missing or listed twice; the centre of a piece is shifted; a piece is far too
    wide to contain only one curve; two or three pieces in a row are missing; or a tangent
    is reversed. Tests check that it is refused. `generator` is a random number generator.
    """
    changed = copy.deepcopy(certificate)
    curves = changed["curves"]
    curve = generator.choice(curves)
    pieces = curve["pieces"]
    piece = generator.choice(pieces)
    index = generator.randrange(len(pieces) - 1)  # a piece with at least one after it
    kind = generator.randrange(6)
    coordinate = generator.randrange(2)
    if kind == 0:
        curves.remove(curve)
    elif kind == 1:
        # One of the first two coordinates: 0 is shifted upwards, 1 downwards.
        direction = 1 if coordinate == 0 else -1
        shift = direction * 10 ** -generator.randrange(1, 7)
        piece["centre"][coordinate] += shift
    elif kind == 2:
        piece["radius"] *= 30.0
    elif kind == 3:
        del pieces[index : index + 3]
    elif kind == 4:
        curves.append(copy.deepcopy(curve))
    else:
        # The first row of the frame is the tangent, the others are normals.
        tangent = pieces[index]["frame"][0]
        pieces[index]["frame"][0] = [-component for component in tangent]
    return changed


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("count", [4, 24])
def test_the_checker_proves_curves_again_and_refuses_tampered_ones(count):
    """An independent checker accepts a certificate of curves, and refuses `count` falsified
    ones.
    """
    certificate = recorded(
        curves_certificate(curves_over_range("four_bar", "41", ("-50", "-45")))
    )
    check(certificate)
    generator = random.Random(23)
    for _ in range(count):
        refuse(tampered(certificate, generator))


def singularities_certificate(name, pair, ends):
    """Return the recorded certificate of curves and singularities over a range (deg)."""
    mechanism = driven_at(sk.load(name), pair)
    curves = curves_over_range(
        mechanism,
        ends=ends,
        wanted=find_output_pairs(read_decimals(mechanism)).values(),
    )
    table = singular_table(locate_singularities(curves))
    return recorded({**curves_certificate(curves), "singularities": table})


@pytest.mark.slow
def test_the_checker_repeats_turning_points_and_singularities():
    """The checker accepts a certificate with one singularity and refuses it without it."""
    certificate = singularities_certificate("four_bar", "21", ("26", "30"))
    stops = [stop for curve in certificate["curves"] for stop in curve["input_stops"]]
    assert not stops and len(certificate["singularities"]["found"]) == 1
    check(certificate)
    without = copy.deepcopy(certificate)
    without["singularities"]["found"].clear()
    refuse(without)


@pytest.mark.long
def test_the_checker_repeats_dead_centres_and_refuses_those_left_out():
    """The checker accepts a certificate with dead centres, and refuses it without them."""
    certificate = singularities_certificate("four_bar", "41", ("45.5", "47.5"))
    check(certificate)
    for curve in certificate["curves"]:
        assert len(curve["input_stops"]) == 1
        curve["input_stops"].clear()
    refuse(certificate)


def test_the_input_is_clear_of_singularities_as_far_as_is_said():
    """The proven clearance of an input is its distance (rad) to the nearest singularity.

    It must never exceed the distance by the analysis `singularities`, and may be smaller by
    error bounds only (1e-6 rad). It also ends at the ends of the proven range.

    The analysis lists places where the input rests and places where the output rests. For
    the latter the proof needs the pair of the output as a variable (`wanted`).
    """
    mechanism = driven_at(sk.load("four_bar"), "41")
    output_pairs = find_output_pairs(read_decimals(mechanism)).values()
    curves = curves_over_range(mechanism, wanted=output_pairs)
    proven = locate_singularities(curves)
    frame = sk.run(mechanism, "singularities", samples=3).frame("singularities")
    for q in np.radians([-100.0, 77.7]):
        gaps = np.abs(wrap(frame["q"].to_numpy() - q))
        assert np.min(gaps) - 1e-6 < proven.clearance(q) <= np.min(gaps)
    # From 71 deg, the end of a range from 70 to 80 deg is 1 deg away. Only this end matters
    # here, so singularities of the output are not asked for.
    narrow = locate_singularities(curves_over_range(mechanism, ends=("70", "80")))
    assert narrow.clearance(np.radians(71.0)) <= np.radians(1.0)


@pytest.mark.parametrize(("name", "tolerance"), [("stephenson", 0.0), ("watt", 1e-6)])
def test_equations_by_coefficients_are_off_by_less_than_is_said(name, tolerance):
    """Derivatives of closure equations by coefficients have the stated error at most.

    An equation says that the arc between two placed axes is that of a link. As a
    trigonometric polynomial (`harmonics`) it has coefficients, and an error bound. The
    error of a derivative is at most this bound times the degree in each of its variables.
    The reference places the links in ball arithmetic (numbers with rigorous error bounds).

    `tolerance` is the uncertainty (rad) of all sizes, which the error bound contains. The
    bound must be less than 100 times as large.
    """
    mechanism = sk.load(name)
    with working_precision(80):
        with_tolerance = read_decimals(mechanism, tolerance=tolerance)
        construction = find_construction(with_tolerance.structure)
        harmonics = ArcEquations(with_tolerance, construction).harmonics
        exact = ArcEquations(read_decimals(mechanism), construction)
        degrees = construction.degrees
        random_angles = np.random.default_rng(6).uniform
        for angles in random_angles(-3.0, 3.0, (5, len(construction.pairs))):
            # Values, first and second derivatives of all equations by the angles.
            order = 2
            exact_derivatives = exact.evaluate([exact_ball(q) for q in angles], order)
            points = cosines_and_sines(angles)[None]
            derivatives = harmonics.derivatives(points, order)
            # The first axis of `derivatives` is the point; there is one.
            for expected, (values,) in zip(exact_derivatives, derivatives, strict=True):
                # The axes are the equation, then one variable for each differentiation.
                for index, ball in np.ndenumerate(expected):
                    equation, *variables = index
                    error = abs(float(ball) - values[index])
                    # Degrees of the equation in its variables; the product of none is 1.
                    factor = np.prod([degrees[equation, j] for j in variables])
                    assert error <= harmonics.error[equation] * factor
        rounding = 1e-12
        assert np.all(harmonics.error < 100.0 * tolerance + rounding)


@pytest.mark.slow
def test_curves_with_an_input_locked_are_those_with_it_held(tmp_path):
    """A locked input gives as many modes as the same input at this fixed value.

    The option --lock of the command joins the two links of the pair 51 to one, at 80 deg.
    Its certificate (file of a proof) contains the text of this mechanism; `check` checks
    it. The reference is the original five-bar with both inputs stated.
    """
    path = tmp_path / "certificate.json"
    assert main(["certify", "five_bar", "--lock", "51=80", "-o", str(path)]) == 0
    certificate = json.loads(path.read_text())
    assert certificate["complete"] and certificate["tolerance_rad"] == 1e-14
    check(certificate)
    five_bar = read_decimals(sk.load("five_bar"))
    for q in ("60", "100", "130"):
        modes_of_both_inputs = certify_modes(five_bar, (q, "80"))
        locked = loads(certificate["mechanism"], "locked")
        modes_of_locked = certify_modes(read_decimals(locked), (q,))
        assert modes_of_both_inputs.is_complete and modes_of_locked.is_complete
        assert len(modes_of_both_inputs.real) == len(modes_of_locked.real)


def test_rates_along_pieces_are_within_their_bounds():
    """First and second derivatives along proven curves are within stated bounds.

    Each piece of a curve is a box with exactly one arc. A point of the arc has the
    coordinate s along its tangent t, and the coordinates y along the normals N: centre + s
    t + N y. Newton's method finds y(s) from the closure equations, which are then
    differentiated. The first derivatives of the variables by s are the rates, the second
    ones the derivatives of the rates.

    The piece states bounds of both derivatives. It also bounds the length of y, the
    distance of the arc from the straight line centre + s t (`euclidean_distance`).
    """
    curves = curves_over_range("stephenson", pair="16", ends=("0", "60"))
    random = np.random.default_rng(3)
    pieces = [piece for chain in curves.chains for piece in chain.pieces]
    for piece in pieces[::5]:
        bounds = bound_rates(piece, piece.half_length)
        tangent = piece.frame[:, 0]
        normals = piece.frame[:, 1:]
        for s in random.uniform(-piece.half_length, piece.half_length, 3):
            y = np.zeros(normals.shape[1])
            for _ in range(8):  # Newton's method
                angles = piece.centre + s * tangent + normals @ y
                # Values, first and second derivatives of the closure equations by the
                # angles, at one point.
                points = cosines_and_sines(angles)[None]
                derivatives = curves.equations.harmonics.derivatives(points, order=2)
                (values,), (jacobian,), (hessian,) = derivatives
                y -= np.linalg.solve(jacobian @ normals, values)
            assert np.max(np.abs(y)) <= piece.euclidean_distance
            slope = np.linalg.solve(jacobian @ normals, jacobian @ tangent)
            rate = tangent - normals @ slope
            # Second derivatives (equations,) along the rates
            curvature = hessian @ rate @ rate
            second = -normals @ np.linalg.solve(jacobian @ normals, curvature)
            assert np.all(bounds.rate_low <= rate + 1e-12)
            assert np.all(rate <= bounds.rate_high + 1e-12)
            assert np.all(bounds.derivative_low <= second + 1e-12)
            assert np.all(second <= bounds.derivative_high + 1e-12)
