"""The search for configurations in boxes, and along curves up to a number of pieces."""

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism, mechanism_text
from test_proof_crossings import TURN, four_bar

from spherekit.proof import chains
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import pi_ball, working_precision
from spherekit.proof.configuration_curves import CURVE_PRECISION_BITS, certify_curves
from spherekit.proof.construction import find_construction
from spherekit.proof.paving import FIRST_ANGLE_RAD, VariableRanges, pave


def test_configurations_in_boxes_are_searched_at_the_input_that_has_one_value():
    """The search for configurations in boxes does not move an input that has one value.

    `pave` divides the space of all variables into boxes. Near small boxes it searches
    configurations by Newton's method, which may change only the variables before the input.
    The variables of this geared five-bar are an unknown angle, the input and the angle of a
    wheel. The angle of the wheel has a range, although it comes after the input. It must
    stay in this range.

    No configuration is known in advance, so `covers` is false for all boxes.
    `add_configuration` records each configuration that is found. It returns False, so that
    the search goes on.
    """
    text = mechanism_text("posed_geared_five_bar").format(20, 40, 0.0, 360.0)
    mechanism = decimal_mechanism(text)
    unknown_count = 1
    input_rad, wheel_rad = 0.5, -0.3
    configurations = []

    def add_configuration(position):
        configurations.append(position)
        return False

    with working_precision(CURVE_PRECISION_BITS):
        equations = ArcEquations(mechanism, find_construction(mechanism.structure))
        assert equations.unknown_count == unknown_count
        ranges = VariableRanges(
            low=[exact_ball(FIRST_ANGLE_RAD), exact_ball(input_rad), exact_ball(wheel_rad)],
            width=[2 * pi_ball(), exact_ball(0.0), exact_ball(1e-3)],
        )
        pave(
            equations,
            ranges,
            covers=lambda centres, _radii: np.zeros(len(centres), dtype=bool),
            add_configuration=add_configuration,
            max_boxes=300,
        )
    assert configurations
    inputs, wheels = np.array(configurations)[:, unknown_count:].T
    assert np.all(inputs == input_rad)
    assert np.all((wheels >= wheel_rad) & (wheels <= wheel_rad + 1e-3))


@pytest.mark.parametrize("range_text", [TURN, ("30", "40")])
def test_a_curve_of_the_largest_number_of_pieces_is_whole(monkeypatch, range_text):
    mechanism = four_bar(("80", "30", "60", "70"))
    curves = certify_curves(mechanism, range_text)
    largest = max(len(chain.pieces) for chain in curves.chains)

    monkeypatch.setattr(chains, "MAX_CHAIN_PIECES", largest)
    assert not certify_curves(mechanism, range_text).problems
    monkeypatch.setattr(chains, "MAX_CHAIN_PIECES", largest - 1)
    (problem, *_) = certify_curves(mechanism, range_text).problems
    assert problem == f"a curve has more than {largest - 1} pieces"
