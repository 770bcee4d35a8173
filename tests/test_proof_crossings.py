"""Crossings of configuration curves, and gaps that are as narrow as one likes."""

import itertools
import json
from decimal import Decimal

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism
from test_proof_adversaries import FOUR_BAR, two_dyads
from test_proof_range import check_counts

from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.proof.balls import flint_library, pi_ball, working_precision
from spherekit.proof.certified_singularities import locate_singularities
from spherekit.proof.configuration_curves import certify_curves

TURN = ("0", "360")
FOLDS = ("80", "30", "50", "60")


def four_bar(arcs, unit="deg"):
    text = FOUR_BAR.format(*arcs).replace('"deg"', f'"{unit}"')
    if unit == "rad":
        text = text.replace("to = 360", "to = 6.28")
    return decimal_mechanism(text)


def nudged(arcs, link, step):
    arcs = [Decimal(arc) for arc in arcs]
    arcs[link] += Decimal(step)
    return [format(arc, "f") for arc in arcs]


def closes_at_half_a_turn(arcs):
    """Whether coupler and rocker span ground and crank in line at 180 degrees."""
    with working_precision(300):
        ground, crank, coupler, rocker = (
            flint_library().arb(arc) * pi_ball() / 180 for arc in arcs
        )
        apart = (ground + crank).cos()
        longest, shortest = (coupler + rocker).cos(), (coupler - rocker).cos()
        assert not (apart - longest).contains(0)
        return bool(longest < apart < shortest)


@pytest.mark.many(slow=11)
@pytest.mark.parametrize("step", ["1e-6", "1e-8", "1e-10", "1e-12", "1e-14", "1e-20"])
@pytest.mark.parametrize(("link", "sense"), [(0, ""), (1, "-"), (3, ""), (3, "-")])
def test_a_crossing_and_narrow_gaps_are_told_apart(step, link, sense):
    arcs = nudged(FOLDS, link, sense + step)
    curves = certify_curves(four_bar(arcs), TURN)
    closes = closes_at_half_a_turn(arcs)
    wide = [count for low, high, count in curves.intervals if high - low > 0.1]
    assert wide and set(wide) == {2}
    certified = curves.completeness.guarantee is Guarantee.CERTIFIED
    assert certified if closes else not certified or len(curves.turning_points) == 2
    for saddle in curves.saddles:
        # arms that differ in the side of the input are joined if it gets past
        assert saddle.level_sign in (1, -1)
        kept = 1 if saddle.level_sign > 0 else 0
        for one, other in itertools.combinations(saddle.outward_signs, 2):
            if one[kept] == other[kept]:
                sides = saddle.outward_signs[one][-1], saddle.outward_signs[other][-1]
                assert 0 not in sides and (sides[0] != sides[1]) == closes


@pytest.mark.many
@pytest.mark.parametrize(
    ("ends", "crossed"),
    [
        (("0", "180"), True),
        (("180", "300"), True),
        (("0", "180.00001"), True),
        (("179", "181"), True),
        (("179.9999", "200"), True),
        (("190", "500"), False),
    ],
)
def test_ranges_that_end_next_to_a_crossing_have_all_modes(ends, crossed):
    curves = certify_curves(four_bar(FOLDS), ends)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert len(curves.crossing_inputs) == int(crossed)
    assert all(count == 2 for _, _, count in curves.intervals)
    low, high = (np.radians(float(end)) for end in ends)
    assert sum(b - a for a, b, _ in curves.intervals) > (high - low) * (1 - 1e-9)


def crossing_dyads():
    """Two four-bars on one crank, of which the second is in line at one input."""
    text = two_dyads(60, 30, 70, 50, 40).document.text
    for old, new in (
        ("arcs = [50, 30]", "arcs = [30, 30]"),
        ('"f"]\narcs = [40]', '"f"]\narcs = [60]'),
        ('"f"]\narcs = [35]', '"f"]\narcs = [50]'),
    ):
        assert old in text
        text = text.replace(old, new)
    return decimal_mechanism(text)


@pytest.mark.slow
def test_curves_of_two_loops_cross_once_in_each_mode_of_the_other():
    curves = certify_curves(crossing_dyads(), TURN)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert [saddle.level_sign for saddle in curves.saddles] == [0, 0]
    assert np.ptp(curves.crossing_inputs) < 1e-9
    check_counts(curves, curves.intervals[:2])


def test_the_input_is_clear_of_crossings_as_far_as_is_said():
    curves = certify_curves(four_bar(FOLDS), TURN)
    clear = locate_singularities(curves).clearance(np.radians(170.0))
    assert np.radians(10.0) - 1e-9 < clear <= np.radians(10.0)


def test_links_in_radians_are_in_line_where_both_sides_are_the_same_sum():
    exact = four_bar(("1.4", "0.5", "0.9", "1.0"), "rad")
    curves = certify_curves(exact, ("2.5", "3.5"))
    assert [saddle.level_sign for saddle in curves.saddles] == [0]
    near = four_bar(("1.4", "0.5", "0.9", "1.00000000000001"), "rad")
    nearly = certify_curves(near, ("2.5", "3.5"))
    assert [saddle.level_sign for saddle in nearly.saddles] == [-1]


def test_a_tolerance_leaves_open_whether_curves_cross():
    written = decimal_mechanism(FOUR_BAR.format(*FOLDS), tolerance=1e-12)
    curves = certify_curves(written, TURN)
    assert curves.completeness.guarantee is Guarantee.TO_BOX
    assert [saddle.level_sign for saddle in curves.saddles] == [None]
    assert {count for _, _, count in curves.intervals} == {2}


def test_certificates_of_undecided_crossings_are_written(tmp_path):
    path = tmp_path / "fold.toml"
    path.write_text(FOUR_BAR.format(*FOLDS), encoding="utf-8")
    out = tmp_path / "certificate.json"
    assert main(["certify", str(path), "--tolerance", "1e-12", "-o", str(out)]) == 3
    certificate = json.loads(out.read_text(encoding="utf-8"))
    assert certificate["singularities"]["undecided_parts"] > 0


def test_the_command_says_where_curves_cross(tmp_path, capsys):
    path = tmp_path / "kite.toml"
    path.write_text(FOUR_BAR.format(40, 40, 70, 70), encoding="utf-8")
    assert main(["certify", str(path)]) == 0
    said = capsys.readouterr().out
    assert "curves cross at 0.000000000 deg, in 2 configurations" in said
    assert "a whole curve of modes at" in said
