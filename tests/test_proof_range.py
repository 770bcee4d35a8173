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


def over(name, pair=None, ends=TURN, tolerance=0.0, wanted=()):
    mechanism = driven_at(sk.load(name), pair) if isinstance(name, str) else name
    made = find_construction(extract_structure(mechanism), wanted)
    return certify_curves(read_decimals(mechanism, tolerance=tolerance), ends, made)


def check_counts(curves, intervals):
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
    curves = over(name, pair, ends)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED, curves.completeness
    assert len(curves.turning_points) == turning
    check_counts(curves, curves.intervals[:4])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [62, 82])
def test_a_long_piece_beside_a_turning_point_does_not_hide_it(seed):
    """Where a piece is all but too long to prove, its bounds are those of the piece."""
    chain = EIGHT_BARS[0]
    axes = random_axes(np.random.default_rng(seed), len(chain.split()))
    made = mechanism_from_chain(chain, axes)
    made = replace(made, inputs=(Input(made.pairs[0].name, 0.0, 2.0 * np.pi),))
    curves = over(made)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED, curves.completeness
    for chain in curves.chains:
        for piece in chain.pieces:
            for part in (0.25, 0.5, 0.9, 1.0):
                bounds = bound_rates(piece, part * piece.half_length)
                assert np.all(bounds.rate_low <= bounds.rate_high)
                assert np.all(bounds.derivative_low <= bounds.derivative_high)
    check_counts(curves, curves.intervals)


@pytest.mark.slow
def test_a_tolerance_loses_no_stop_where_its_sign_is_open_at_a_centre(capsys):
    assert main(["certify", "watt", "--tolerance", "1e-6"]) == 0
    told = capsys.readouterr().out
    assert told.count("type I at") == 10 and "undecided" not in told


@pytest.mark.many
@pytest.mark.parametrize(("name", "pair"), [("four_bar", None), ("stephenson", "35")])
def test_singularities_proven_are_those_that_a_run_reports(name, pair):
    mechanism = driven_at(sk.load(name), pair)
    curves = over(
        mechanism,
        wanted=find_output_pairs(read_decimals(mechanism)).values(),
    )
    proven = locate_singularities(curves)
    assert not proven.undecided and not proven.skipped
    frame = sk.run(mechanism, "singularities", samples=3).frame("singularities")
    assert len(frame) == len(proven.singularities)
    for kind in ("I", "II"):
        inputs = np.sort(frame["q"][frame["kind"] == kind].to_numpy())
        found = np.sort([x.q for x in proven.singularities if x.type == kind])
        assert len(inputs) == len(found)
        assert np.all(np.abs(inputs - found) < 1e-7)


def test_all_sizes_within_a_tolerance_have_the_curves_proven(monkeypatch):
    curves = over("four_bar", "41", TURN, tolerance=1e-7)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert len(curves.turning_points) == 4
    # beside dead centres the sizes leave open where the input stops
    parts = over("four_bar", "41", TURN, tolerance=1e-5)
    assert parts.completeness.box < 0.022 and len(parts.undecided_ranges) == 4
    assert [count for _, _, count in parts.intervals] == [0, 2, 0, 2, 0]
    wide = read_decimals(driven_at(sk.load("four_bar"), "41"), tolerance=0.03)
    monkeypatch.setattr("spherekit.proof.configuration_curves.MAX_CURVE_BOXES", 3000)
    undecided = certify_curves(wide, TURN)
    assert undecided.completeness.guarantee is not Guarantee.CERTIFIED


def tampered(certificate, moves):
    changed = copy.deepcopy(certificate)
    curves = changed["curves"]
    pieces = (curve := moves.choice(curves))["pieces"]
    piece, at = moves.choice(pieces), moves.randrange(len(pieces) - 1)
    kind, side = moves.randrange(6), moves.randrange(2)
    if kind == 0:
        curves.remove(curve)
    elif kind == 1:
        piece["centre"][side] += (-1) ** side * 10 ** -moves.randrange(1, 7)
    elif kind == 2:
        piece["radius"] *= 30.0
    elif kind == 3:
        del pieces[at : at + 3]
    elif kind == 4:
        curves.append(copy.deepcopy(curve))
    else:
        # any but the last, after which none comes
        pieces[at]["frame"][0] = [-each for each in pieces[at]["frame"][0]]
    return changed


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("count", [4, 24])
def test_the_checker_proves_curves_again_and_refuses_tampered_ones(count):
    whole = recorded(curves_certificate(over("four_bar", "41", ("-50", "-45"))))
    check(whole)
    moves = random.Random(23)
    for _ in range(count):
        refuse(tampered(whole, moves))


def with_singularities(name, pair, ends):
    mechanism = driven_at(sk.load(name), pair)
    curves = over(
        mechanism,
        ends=ends,
        wanted=find_output_pairs(read_decimals(mechanism)).values(),
    )
    table = singular_table(locate_singularities(curves))
    return recorded({**curves_certificate(curves), "singularities": table})


@pytest.mark.slow
def test_the_checker_repeats_turning_points_and_singularities():
    whole = with_singularities("four_bar", "21", ("26", "30"))
    stops = [stop for curve in whole["curves"] for stop in curve["input_stops"]]
    assert not stops and len(whole["singularities"]["found"]) == 1
    check(whole)
    without = copy.deepcopy(whole)
    without["singularities"]["found"].clear()
    refuse(without)


@pytest.mark.long
def test_the_checker_repeats_dead_centres_and_refuses_those_left_out():
    dead = with_singularities("four_bar", "41", ("45.5", "47.5"))
    check(dead)
    for curve in dead["curves"]:
        assert len(curve["input_stops"]) == 1
        curve["input_stops"].clear()
    refuse(dead)


def test_the_input_is_clear_of_singularities_as_far_as_is_said():
    mechanism = driven_at(sk.load("four_bar"), "41")
    curves = over(
        mechanism,
        wanted=find_output_pairs(read_decimals(mechanism)).values(),
    )
    found = locate_singularities(curves)
    frame = sk.run(mechanism, "singularities", samples=3).frame("singularities")
    for q in np.radians([-100.0, 77.7]):
        gaps = np.abs(wrap(frame["q"].to_numpy() - q))
        assert np.min(gaps) - 1e-6 < found.clearance(q) <= np.min(gaps)
    part = locate_singularities(over(mechanism, ends=("70", "80")))
    assert part.clearance(np.radians(71.0)) <= np.radians(1.0)


@pytest.mark.parametrize(("name", "tolerance"), [("stephenson", 0.0), ("watt", 1e-6)])
def test_equations_by_coefficients_are_off_by_less_than_is_said(name, tolerance):
    # placing the links in balls is the other way to the same values
    mechanism = sk.load(name)
    with working_precision(80):
        wide = read_decimals(mechanism, tolerance=tolerance)
        made = find_construction(wide.structure)
        real, exactly = (
            ArcEquations(wide, made).harmonics,
            ArcEquations(read_decimals(mechanism), made),
        )
        degrees = made.degrees
        for place in np.random.default_rng(6).uniform(-3.0, 3.0, (5, len(made.pairs))):
            balls_of = exactly.evaluate([exact_ball(q) for q in place], 2)
            made_of = real.derivatives(cosines_and_sines(place)[None], 2)
            for balls, (got,) in zip(balls_of, made_of, strict=True):
                for (k, *key), ball in np.ndenumerate(balls):
                    off = abs(float(ball) - got[(k, *key)])
                    assert off <= real.error[k] * np.prod([degrees[k, j] for j in key])
        assert np.all(real.error < 100.0 * tolerance + 1e-12)


@pytest.mark.slow
def test_curves_with_an_input_locked_are_those_with_it_held(tmp_path):
    """The text in the certificate has the two links of the pair as one."""
    path = tmp_path / "certificate.json"
    assert main(["certify", "five_bar", "--lock", "51=80", "-o", str(path)]) == 0
    certificate = json.loads(path.read_text())
    assert certificate["complete"] and certificate["tolerance_rad"] == 1e-14
    check(certificate)
    five_bar = sk.load("five_bar")
    written = read_decimals(five_bar)
    for q in ("60", "100", "130"):
        held = certify_modes(written, (q, "80"))
        locked = loads(certificate["mechanism"], "locked")
        alone = certify_modes(read_decimals(locked), (q,))
        assert held.is_complete and alone.is_complete
        assert len(held.real) == len(alone.real)


def test_rates_along_pieces_are_within_their_bounds():
    curves = over("stephenson", "16", ("0", "60"))
    moves = np.random.default_rng(3)
    for piece in [piece for chain in curves.chains for piece in chain.pieces][::5]:
        bounds = bound_rates(piece, piece.half_length)
        t, normals = piece.frame[:, 0], piece.frame[:, 1:]
        for s in moves.uniform(-piece.half_length, piece.half_length, 3):
            y = np.zeros(normals.shape[1])
            for _ in range(8):
                place = cosines_and_sines(piece.centre + s * t + normals @ y)
                made = curves.equations.harmonics.derivatives(place[None], 2)
                values, slopes, curvatures = (part[0] for part in made)
                y -= np.linalg.solve(slopes @ normals, values)
            assert np.max(np.abs(y)) <= piece.distance_bound
            rate = t - normals @ np.linalg.solve(slopes @ normals, slopes @ t)
            bent = np.einsum("ijl,j,l->i", curvatures, rate, rate)
            bend = -normals @ np.linalg.solve(slopes @ normals, bent)
            for value, low, high in (
                (rate, bounds.rate_low, bounds.rate_high),
                (bend, bounds.derivative_low, bounds.derivative_high),
            ):
                assert np.all(low <= value + 1e-12) and np.all(value <= high + 1e-12)
