"""Statements of proofs over ranges with undecided parts or doubtful curves."""

from dataclasses import replace

import pytest
from test_proof_crossings import FOLDS, TURN, four_bar

from spherekit.completeness import Guarantee
from spherekit.conventions import TURN as TURN_RAD
from spherekit.proof.configuration_curves import certify_curves
from spherekit.proof.curve_search import OVERLAPPING

STRETCHED_AT_ZERO = ("80", "20", "30", "30")
"""Arcs (deg) of a four-bar that can be assembled at the input 0 only, as 80 - 20 = 60."""


def test_undecided_parts_at_both_ends_of_a_full_turn_are_one_part():
    curves = certify_curves(four_bar(STRETCHED_AT_ZERO), TURN)
    assert curves.completeness.guarantee is Guarantee.TO_BOX
    (_, first_end), (last_start, _) = curves.undecided_ranges
    assert curves.completeness.box == pytest.approx(first_end + TURN_RAD - last_start)


def test_one_undecided_part_is_in_the_singular():
    curves = certify_curves(four_bar(STRETCHED_AT_ZERO), ("-10", "10"))
    assert len(curves.undecided_ranges) == 1
    assert "1 part of the range is undecided" in str(curves.completeness)


def test_curves_that_may_be_one_are_stated_once():
    curves = certify_curves(four_bar(FOLDS), ("20", "25"))
    doubtful = replace(curves, problems=[OVERLAPPING])
    assert str(doubtful.completeness).startswith(f"component only: {OVERLAPPING}; ")
    assert str(doubtful.completeness).count(OVERLAPPING) == 1
    broken = replace(curves, problems=["a curve is cut off", OVERLAPPING])
    assert "component only: a curve is cut off; two curves" in str(broken.completeness)
