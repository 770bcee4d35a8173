"""Stationary points of the input along proven configuration curves."""

import numpy as np

import spherekit as sk
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.proof.balls import working_precision
from spherekit.proof.chains import find_chain
from spherekit.proof.configuration_curves import CURVE_PRECISION_BITS, certify_curves
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.stationary_points import find_stationary_points
from spherekit.proof.tubes import LONGEST_ARC_RAD, correct_configuration, find_piece


def test_a_closed_curve_that_begins_at_a_dead_centre_has_the_same_dead_centres():
    """The curve of a four-bar is followed again, from each of its dead centres on.

    At the dead centre the rate of the input has no proven sign.
    """
    mechanism = driven_at(sk.load("four_bar"), "41")
    curves = certify_curves(read_decimals(mechanism), ("0", "360"))
    chain, points = curves.chains[0], curves.input_stationary_points[0]
    assert chain.closed and len(points.proven) == 2
    equations = curves.equations
    with working_precision(CURVE_PRECISION_BITS):
        for start in points.proven:
            centre = correct_configuration(equations, start.position)
            tangent = chain.pieces[start.piece].tangent
            first = find_piece(equations, centre, tangent, LONGEST_ARC_RAD)
            new_chain = find_chain(equations, first, lambda *_: 0, curves.crossings)
            assert new_chain.closed
            new_points = find_stationary_points(equations, new_chain, curves.input_variable)
            assert not new_points.undecided
            assert len(new_points.proven) == 2
            for point in points.proven:
                distances = [
                    np.max(np.abs(wrap(new_point.position - point.position)))
                    for new_point in new_points.proven
                ]
                assert min(distances) < 1e-9
